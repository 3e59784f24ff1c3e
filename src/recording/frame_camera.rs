//! Camera parameters of a single frame.

use crate::camera::Geometry;
use crate::frame::FrameLens;

/// The camera that took a frame, as far as known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameCamera {
    /// Without a readout time, which is in the profile. Of the model `opencv`.
    pub geometry: Option<Geometry>,
    pub lens: FrameLens,
}
