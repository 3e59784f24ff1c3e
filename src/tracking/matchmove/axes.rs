//! The axes of camera files. Nuke, USD and glTF share them: the world's y is up, a camera faces
//! along its −z, its y is up in the picture, lengths are metres.
//!
//! OpenCV's camera has y down and z forward: half a turn about x leads from one to the other. The
//! world is rotated by the shortest rotation that takes its up to y. For up = z this is
//! (x, y, z) → (x, z, −y).

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::pose::Pose;

/// Half a turn about x: from OpenCV's camera axes to those of camera files, and back.
pub const HALF_TURN_ABOUT_X: DQuat = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);

/// Rotation from a world with the given up (unit length) to a file's world, whose y is up.
pub fn file_from_world(up: DVec3) -> DQuat {
    if up.dot(DVec3::Y) > -1.0 + 1e-12 { DQuat::from_rotation_arc(up, DVec3::Y) } else { HALF_TURN_ABOUT_X }
}

/// A camera in a file's world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPlacement {
    /// Metres.
    pub position_m: DVec3,
    /// `file_from_camera`: the camera's x is right, its y up, its −z forward. Unit length.
    pub rotation: DQuat,
}

impl CameraPlacement {
    pub fn of_pose(pose: &Pose, file_from_world: DQuat) -> Self {
        let rotation = file_from_world * pose.world_from_camera_rotation() * HALF_TURN_ABOUT_X;
        Self { position_m: file_from_world * pose.position_in_world_m(), rotation: rotation.normalize() }
    }

    pub fn pose(&self, file_from_world: DQuat) -> Pose {
        let world_from_file = file_from_world.conjugate();
        let rotation = world_from_file * self.rotation * HALF_TURN_ABOUT_X;
        Pose::from_camera_in_world(world_from_file * self.position_m, rotation)
    }

    pub fn file_from_camera(&self) -> DAffine3 {
        DAffine3::from_rotation_translation(self.rotation, self.position_m)
    }

    /// The placement of a camera whose transform may be scaled: the scale has no effect on a
    /// camera's view. `None` for a mirrored, sheared or singular transform.
    pub fn of_transform(file_from_camera: DAffine3) -> Option<Self> {
        const MAX_SHEAR: f64 = 1e-4;
        let axes = [
            file_from_camera.matrix3.x_axis.try_normalize()?,
            file_from_camera.matrix3.y_axis.try_normalize()?,
            file_from_camera.matrix3.z_axis.try_normalize()?,
        ];
        let [x, y, z] = axes;
        let is_sheared = [x.dot(y), y.dot(z), z.dot(x)].into_iter().any(|cosine| cosine.abs() > MAX_SHEAR);
        let rotation = DMat3::from_cols(x, y, z);
        let is_valid = file_from_camera.is_finite() && !is_sheared && rotation.determinant() > 0.0;
        is_valid.then(|| Self {
            position_m: file_from_camera.translation,
            rotation: DQuat::from_mat3(&rotation).normalize(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn world_with_z_up_becomes_y_up() {
        let turned = file_from_world(DVec3::Z) * DVec3::new(1.0, 2.0, 3.0);
        assert!((turned - DVec3::new(1.0, 3.0, -2.0)).length() < 1e-12, "{turned}");
        for up in [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::new(0.6, -0.8, 0.0), DVec3::NEG_Z] {
            assert!((file_from_world(up) * up - DVec3::Y).length() < 1e-12, "{up}");
        }
    }

    #[test]
    fn placement_of_a_pose_leads_back_to_it() {
        let pose = Pose::look_at(DVec3::new(1.0, -2.0, 1.5), DVec3::new(0.2, 0.1, 0.3), DVec3::Z).unwrap();
        for up in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.0, 0.6, 0.8)] {
            let turn = file_from_world(up);
            let placed = CameraPlacement::of_pose(&pose, turn);
            let back = placed.pose(turn);
            assert!(back.translation_m.distance(pose.translation_m) < 1e-12);
            assert!(back.rotation.angle_between(pose.rotation) < 1e-7);
            // A point half a metre ahead in the picture's upper right.
            let ahead = placed.file_from_camera().transform_point3(DVec3::new(0.1, 0.2, -0.5));
            let world = pose.inverse_transform_point(DVec3::new(0.1, -0.2, 0.5));
            assert!((ahead - turn * world).length() < 1e-12);
        }
    }

    #[test]
    fn scaled_transform_has_a_placement_and_a_mirrored_one_has_none() {
        let turn = DQuat::from_rotation_y(0.3);
        let placement = |scale: DVec3| {
            let placed = DAffine3::from_scale_rotation_translation(scale, turn, DVec3::X);
            CameraPlacement::of_transform(placed)
        };
        let scaled = placement(DVec3::new(2.0, 0.5, 1.0)).unwrap();
        assert!(scaled.position_m == DVec3::X && scaled.rotation.angle_between(turn) < 1e-7);
        assert_eq!((placement(DVec3::new(-1.0, 1.0, 1.0)), placement(DVec3::new(0.0, 1.0, 1.0))), (None, None));
    }
}
