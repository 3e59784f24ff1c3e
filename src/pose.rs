//! Camera poses.
//!
//! OpenCV axes everywhere: x right, y down, z forward, metres. Readers of formats with other axes
//! convert them.

use glam::{DMat3, DQuat, DVec3};

/// A rigid transform `camera_from_world`: takes a point in the world to the camera's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// The world's origin in the camera's axes, metres.
    pub translation_m: DVec3,
}

impl Pose {
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation_m: DVec3::ZERO };

    /// Pose with a `camera_from_world` rotation and translation.
    pub fn new(rotation: DQuat, translation_m: DVec3) -> Self {
        Self { rotation: rotation.normalize(), translation_m }
    }

    /// Pose of a camera at a position (metres) with an orientation (`world_from_camera`).
    pub fn from_camera_in_world(position_in_world_m: DVec3, world_from_camera: DQuat) -> Self {
        let rotation = world_from_camera.normalize().conjugate();
        Self { rotation, translation_m: -(rotation * position_in_world_m) }
    }

    /// A camera at `eye` that points at `target`; `up` points up in the picture. `None` if the
    /// three do not define a view.
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Option<Self> {
        let z = (target - eye).try_normalize()?;
        let x = z.cross(up).try_normalize()?;
        let y = z.cross(x);
        Some(Self::from_camera_in_world(eye, DQuat::from_mat3(&DMat3::from_cols(x, y, z))))
    }

    pub fn transform_point(&self, point_in_world: DVec3) -> DVec3 {
        self.rotation * point_in_world + self.translation_m
    }

    /// The camera's position, metres.
    pub fn position_in_world_m(&self) -> DVec3 {
        -(self.rotation.conjugate() * self.translation_m)
    }

    pub fn world_from_camera_rotation(&self) -> DQuat {
        self.rotation.conjugate()
    }

    /// Takes a point from the camera's axes to the world.
    pub fn inverse_transform_point(&self, point_in_camera: DVec3) -> DVec3 {
        self.rotation.conjugate() * (point_in_camera - self.translation_m)
    }

    /// Interpolates between `self` (0) and `other` (1): the camera's position linearly, its
    /// rotation by slerp.
    pub fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        let position = self.position_in_world_m().lerp(other.position_in_world_m(), fraction);
        let turn = self.world_from_camera_rotation().slerp(other.world_from_camera_rotation(), fraction);
        Self::from_camera_in_world(position, turn)
    }
}

/// Mean of the cameras' own up directions, unit length; z without cameras. `world_from_camera`: one
/// rotation per camera.
pub fn camera_up(world_from_camera: impl Iterator<Item = DQuat>) -> DVec3 {
    world_from_camera.map(|rotation| rotation * DVec3::NEG_Y).sum::<DVec3>().normalize_or(DVec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_has_opencv_axes() {
        let pose = Pose::look_at(DVec3::new(0.0, -5.0, 1.0), DVec3::new(0.0, 0.0, 1.0), DVec3::Z).unwrap();
        let right = pose.transform_point(DVec3::new(1.0, 0.0, 1.0));
        let above = pose.transform_point(DVec3::new(0.0, 0.0, 2.0));
        assert!((right - DVec3::new(1.0, 0.0, 5.0)).length() < 1e-12, "{right}");
        assert!((above - DVec3::new(0.0, -1.0, 5.0)).length() < 1e-12, "{above}");
    }

    #[test]
    fn there_and_back() {
        let pose = Pose::from_camera_in_world(DVec3::new(1.0, 2.0, 3.0), DQuat::from_rotation_y(0.7));
        assert!((pose.position_in_world_m() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        let p = DVec3::new(-0.3, 4.0, 0.5);
        assert!((pose.inverse_transform_point(pose.transform_point(p)) - p).length() < 1e-12);
    }

    #[test]
    fn halfway_is_half_the_way_and_half_the_turn() {
        let a = Pose::from_camera_in_world(DVec3::ZERO, DQuat::IDENTITY);
        let b = Pose::from_camera_in_world(DVec3::new(2.0, 0.0, 0.0), DQuat::from_rotation_z(1.0));
        let half = a.interpolate(&b, 0.5);
        assert!((half.position_in_world_m() - DVec3::new(1.0, 0.0, 0.0)).length() < 1e-12);
        assert!(half.world_from_camera_rotation().angle_between(DQuat::from_rotation_z(0.5)) < 1e-9);
    }

    #[test]
    fn held_up_is_the_mean_of_the_cameras_own() {
        // Rolled by 10° to either side of a camera whose y points along −z.
        let level = DQuat::from_rotation_x(-0.5 * std::f64::consts::PI);
        let rolled = [-10.0, 10.0].map(|deg: f64| level * DQuat::from_rotation_z(deg.to_radians()));
        assert!((camera_up(rolled.into_iter()) - DVec3::Z).length() < 1e-12);
        assert_eq!(camera_up(std::iter::empty()), DVec3::Z);
    }
}
