//! A surface point observed in one frame.

use glam::Vec3;

use crate::pixels::luma_709;

/// Light and place of a surface point, as one frame shows them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// World axes, m.
    pub position_m: Vec3,
    /// Linear light divided by the frame's gain: red, green, blue.
    pub light: [f32; 3],
    /// Linear light of the frame itself.
    pub code: [f32; 3],
    /// Clipped channels: their light is a lower bound.
    pub clipped: [bool; 3],
}

/// Relative luminance of linear light with the primaries of BT.709.
pub fn relative_luminance(light: [f64; 3]) -> f64 {
    luma_709(light)
}

/// Mean of the channels.
pub fn mean_channel(light: [f32; 3]) -> f32 {
    (light[0] + light[1] + light[2]) / 3.0
}
