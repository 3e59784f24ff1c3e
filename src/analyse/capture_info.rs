//! Response, noise and exposure of the camera that took a recording.

use crate::camera::{NoiseProfile, Response};
use crate::frame::Frame;

/// Properties of the camera besides its geometry.
pub struct CaptureInfo<'a> {
    pub response: &'a Response,
    /// `None` if it was not calibrated.
    pub noise: Option<&'a NoiseProfile>,
    /// Exposure time of a frame's rows, s.
    pub exposure_s: &'a dyn Fn(&Frame) -> f64,
}
