//! What is known of how a recording was taken.

use crate::camera::{NoiseProfile, Response};
use crate::frame::Frame;

/// What is known of the camera besides its geometry.
pub struct Taken<'a> {
    pub response: &'a Response,
    /// Its noise, if that was calibrated.
    pub noise: Option<&'a NoiseProfile>,
    /// How long a frame's rows gather light, s, by what is known of the frame.
    pub exposure_s: &'a dyn Fn(&Frame) -> f64,
}
