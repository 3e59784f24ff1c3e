//! The table `gauge` of a scene file: the world in which its objects were placed.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::pose::Pose;

/// Camera pose of one frame in the scene's world. If poses are refined later, the recording is
/// transformed so that they agree, and objects stay on the surface of that frame.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Gauge {
    pub frame: usize,
    /// Time of the frame. It identifies the recording.
    pub time_s: f64,
    /// Camera position, metres.
    pub position_m: [f64; 3],
    /// World from camera (OpenCV axes): x, y, z, w.
    pub quaternion: [f64; 4],
}

impl Gauge {
    pub fn of(frame: usize, time_s: f64, pose: &Pose) -> Self {
        let quaternion = pose.world_from_camera_rotation().to_array();
        Self { frame, time_s, position_m: pose.position_in_world_m().to_array(), quaternion }
    }

    /// `None` if the numbers are no valid pose.
    pub fn pose(&self) -> Option<Pose> {
        let (position, turn) = (DVec3::from(self.position_m), DQuat::from_array(self.quaternion));
        let is_sound = position.is_finite() && (turn.length() - 1.0).abs() < 1e-3;
        is_sound.then(|| Pose::from_camera_in_world(position, turn))
    }
}
