//! Which way is up where neither recording nor scene says it: by how people hold cameras, and by what a first thing stands on.

use glam::DVec3;

use super::Shot;
use crate::pose::held_up;

/// Surfaces that lean by less from what cameras had above them are floors and tables (cosine of 50°: people look down at them).
const LEVEL: f64 = 0.643;

impl Shot {
    /// The world's up as the recording and the scene say it.
    pub fn up(&self) -> Option<DVec3> {
        self.scene.up_in_world.or(self.recording.up)
    }

    /// Up by how the recording's cameras were held ([`held_up`]).
    pub fn held_up(&self) -> DVec3 {
        held_up(self.recording.track.poses().iter().map(|(_, pose)| pose.world_from_camera_rotation()))
    }

    /// Up for the first object of a scene on a surface with this normal: the normal on its upper side, if the surface is nearly
    /// level, else [`Shot::held_up`]. Unit length.
    pub fn up_on(&self, normal: Option<DVec3>) -> DVec3 {
        let held = self.held_up();
        let upper = normal.map(|normal| if normal.dot(held) < 0.0 { -normal } else { normal });
        upper.filter(|normal| normal.dot(held) > LEVEL).unwrap_or(held)
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
        let lean = DVec3::new(0.02, 0.01, 1.0).normalize();
        for normal in [lean, -lean] {
            assert_eq!(shot.up_on(Some(normal)), lean);
        }
        assert_eq!([shot.up_on(Some(held.any_orthonormal_vector())), shot.up_on(None)], [held, held]);
    }
}
