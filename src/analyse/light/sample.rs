//! A place of the room as one frame saw it.

use glam::Vec3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// World axes, m.
    pub at: Vec3,
    /// Linear, as the frame of usual brightness would show it: red, green, blue.
    pub light: [f32; 3],
    /// It is as bright, or brighter: the camera's white was reached.
    pub is_clipped: bool,
}

/// The mean of the colours.
pub fn luminance(light: [f32; 3]) -> f32 {
    (light[0] + light[1] + light[2]) / 3.0
}
