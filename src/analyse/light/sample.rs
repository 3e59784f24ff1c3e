//! A place of the room as one frame saw it.

use glam::Vec3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// World axes, m.
    pub at: Vec3,
    /// Linear, as the frame of usual brightness would show it: red, green, blue.
    pub light: [f32; 3],
    /// Linear, as the frame itself shows it.
    pub code: [f32; 3],
    /// Channels in which the camera's white was reached: their light is a lower bound.
    pub clipped: [bool; 3],
}

/// Relative luminance of linear light with the primaries of BT.709.
pub fn relative_luminance(light: [f64; 3]) -> f64 {
    0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2]
}

/// The mean of the colours.
pub fn luminance(light: [f32; 3]) -> f32 {
    (light[0] + light[1] + light[2]) / 3.0
}
