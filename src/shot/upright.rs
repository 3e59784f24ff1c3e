//! The world's up if neither recording nor scene defines it: from the room's largest level surface,
//! the support of a first object, or the usual orientation of cameras.

use glam::DVec3;

use super::Shot;
use super::supports::Scan;
use crate::pose::camera_up;
use crate::scene::Environment;
use crate::support::up_on_surface;

impl Shot {
    /// The world's up according to the scene or the recording.
    pub fn up(&self) -> Option<DVec3> {
        self.scene.up_in_world.or(self.recording.up)
    }

    /// Up by the orientation of the recording's cameras ([`camera_up`]).
    pub fn camera_up(&self) -> DVec3 {
        camera_up(self.recording.track.poses().iter().map(|(_, pose)| pose.world_from_camera_rotation()))
    }

    /// Up of the environment map that an analysis estimated.
    fn estimated_up(&self) -> Option<DVec3> {
        match &self.estimated_lighting.as_ref()?.environment {
            Environment::Map(map) => (map.map_from_world.as_dquat().inverse() * DVec3::Y).try_normalize(),
            _ => None,
        }
    }

    /// Up for the first object of a scene on a surface with this normal, which faces the camera:
    /// the analysis's estimate, or the normal of the largest level surface that depth shows, or the
    /// surface's own if it is nearly level, else [`Shot::camera_up`]. Cameras see floors from
    /// above: a normal against the camera's own up means an upside-down camera. Unit length.
    pub fn up_on(&self, normal: Option<DVec3>) -> DVec3 {
        let camera_up = self.camera_up();
        self.estimated_up()
            .or_else(|| self.up_of_room(camera_up, Scan::Awaited))
            .unwrap_or_else(|| up_on_surface(normal, camera_up))
    }

    /// [`Shot::up_on`] for a preview: without the room's surfaces until the recording's depth has
    /// been read.
    pub fn up_preview(&self, normal: Option<DVec3>) -> DVec3 {
        let camera_up = self.camera_up();
        self.estimated_up()
            .or_else(|| self.up_of_room(camera_up, Scan::IfReady))
            .unwrap_or_else(|| up_on_surface(normal, camera_up))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::OpenOptions;
    use crate::scene::{EnvironmentMap, Lighting};
    use crate::shot::ShotOptions;
    use glam::{DQuat, Vec3};
    use std::path::Path;
    use std::sync::Arc;

    #[test]
    fn up_is_the_normal_of_a_floor_and_not_of_a_wall() {
        let camera_up = DVec3::new(0.0, 0.5, 0.866);
        let lean = DVec3::new(0.02, 0.01, 1.0).normalize();
        // An upside-down camera sees the floor too; a wall at 55° against its up is none.
        for normal in [lean, -lean] {
            assert_eq!(up_on_surface(Some(normal), camera_up), normal);
        }
        assert_eq!(
            [up_on_surface(Some(camera_up.any_orthonormal_vector()), camera_up), up_on_surface(None, camera_up)],
            [camera_up, camera_up]
        );
        let wall = DVec3::new(0.0, -0.819, 0.574);
        assert_eq!(up_on_surface(Some(wall), DVec3::Y), DVec3::Y);
    }

    #[test]
    fn up_of_the_analysis_overrides_the_cameras_orientation() {
        let mut shot =
            Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let up = DVec3::new(0.6, 0.0, -0.8);
        let map = EnvironmentMap {
            width: 2,
            height: 1,
            rgb: Arc::new(vec![[1.0; 3]; 2]),
            map_from_world: DQuat::from_rotation_arc(up, DVec3::Y).as_quat(),
            color: Vec3::ONE,
        };
        let lighting = Lighting { environment: Environment::Map(map), ..Lighting::default() };
        shot.estimated_lighting = Some(Arc::new(lighting));
        for up_estimate in [shot.up_on(None), shot.up_preview(Some(DVec3::Z))] {
            assert!(up_estimate.angle_between(up).to_degrees() < 0.01, "{up_estimate}");
        }
    }

    #[test]
    fn up_of_the_demonstration_is_its_floors_normal_for_any_surface() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        // Its z is up, and its camera points down by some 30°.
        assert_eq!(shot.up(), Some(DVec3::Z));
        let camera_up = shot.camera_up();
        assert!((0.7..0.99).contains(&camera_up.z), "{camera_up}");
        for normal in [None, Some(DVec3::new(0.1, -0.1, 1.0).normalize()), Some(DVec3::X)] {
            let up = shot.up_on(normal);
            assert!(up.angle_between(DVec3::Z).to_degrees() < 0.5, "{normal:?}: {up}");
        }
    }
}
