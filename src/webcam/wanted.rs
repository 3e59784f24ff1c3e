//! What is asked of a camera, and what it gives.

use super::picture::{Delivered, Layout};
use crate::source::video::{ColorMatrix, ColorRange};

/// A camera gives what comes nearest to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Width and height, px.
    pub size: (u32, u32),
    /// Pictures a second.
    pub rate_hz: f64,
    /// `None`: the first of [`Layout::PREFERRED`] that the camera has in this size at this rate.
    pub layout: Option<Layout>,
    /// Override what the driver says of its Y'CbCr.
    pub range: Option<ColorRange>,
    pub matrix: Option<ColorMatrix>,
}

impl Default for Wanted {
    fn default() -> Self {
        Self { size: (640, 480), rate_hz: 30.0, layout: None, range: None, matrix: None }
    }
}

/// What a camera gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    pub name: String,
    pub delivered: Delivered,
    /// Pictures a second, as its driver says.
    pub rate_hz: Option<f64>,
    /// Whether its pictures say how long they were exposed.
    pub has_exposure: bool,
    /// What its pictures do not keep of a video that stands in for it, a sentence each.
    pub warnings: Vec<String>,
}
