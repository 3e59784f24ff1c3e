//! Which way is up where neither recording nor scene says it: by how people hold cameras, and by what a first thing stands on.

use glam::DVec3;

use super::Shot;
use crate::pose::Pose;

/// Surfaces that lean by less from what cameras had above them are floors and tables (cosine of 50°: people look down at them).
const LEVEL: f64 = 0.643;

impl Shot {
    /// The world's up as the recording and the scene say it.
    pub fn up(&self) -> Option<DVec3> {
        self.scene.up_in_world.or(self.recording.up)
    }

    /// What the cameras had above them on the mean, unit length; z without any.
    pub fn held_up(&self) -> DVec3 {
        let above = |(_, pose): &(f64, Pose)| pose.world_from_camera_rotation() * DVec3::NEG_Y;
        self.recording.track.poses().iter().map(above).sum::<DVec3>().normalize_or(DVec3::Z)
    }

    /// Up for the first object of a scene on a surface whose normal faces the camera: the normal, if the surface is level or
    /// seen by a camera that is mounted upside down, else what cameras had above them. Unit length.
    pub fn up_on(&self, normal: Option<DVec3>) -> DVec3 {
        let held = self.held_up();
        normal.filter(|normal| normal.dot(held).abs() > LEVEL).unwrap_or(held)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::OpenOptions;
    use crate::shot::Given;
    use std::path::Path;

    #[test]
    fn a_floor_is_level_and_a_wall_is_not() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        // Its z is up, and its camera looks down by some 30°.
        assert_eq!(shot.up(), Some(DVec3::Z));
        let held = shot.held_up();
        assert!((0.7..0.99).contains(&held.z), "{held}");
        // A camera that hangs upside down sees the floor's upper side, too: that is where things stand.
        let lean = DVec3::new(0.02, 0.01, 1.0).normalize();
        for normal in [lean, -lean] {
            assert_eq!(shot.up_on(Some(normal)), normal);
        }
        assert_eq!([shot.up_on(Some(held.any_orthonormal_vector())), shot.up_on(None)], [held, held]);
    }
}
