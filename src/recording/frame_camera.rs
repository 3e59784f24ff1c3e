//! A frame's own camera.

use crate::camera::Geometry;
use crate::frame::FrameLens;

/// The camera that took a frame, as far as it is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameCamera {
    /// Without a readout time, which the profile says. Of the model `opencv`.
    pub geometry: Option<Geometry>,
    pub lens: FrameLens,
}
