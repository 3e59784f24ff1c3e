//! One moment of a recording.

use crate::image::{DepthMap, Pixels};

/// A frame as the camera delivered it. Never changed in place.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the recording's order, from 0.
    pub index: usize,
    /// The middle of the middle row's exposure, seconds on the recording's clock.
    pub timestamp_s: f64,
    pub pixels: Pixels,
    /// What stands where in the room, registered to the colour picture; `None` without a sensor.
    pub depth: Option<DepthMap>,
    pub exposure: FrameExposure,
}

/// What the camera said of this frame's exposure; `None` where it said nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameExposure {
    /// How long each row gathered light, seconds.
    pub time_s: Option<f64>,
    /// Amplification relative to the recording's base, a factor.
    pub gain: Option<f64>,
}
