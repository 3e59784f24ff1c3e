//! Rigid poses, and the derivatives of image points with respect to them.

use glam::{DMat3, DVec3};
use nalgebra::SMatrix;

/// Transform from an object's axes to the camera's, in the object's unit of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidPose {
    pub rotation: DMat3,
    pub translation: DVec3,
}

impl RigidPose {
    pub fn point(&self, own: DVec3) -> DVec3 {
        self.rotation * own + self.translation
    }

    /// Applies a rotation vector (rad) about the camera's axes and a translation.
    pub fn after_step(&self, turn: DVec3, by: DVec3) -> Self {
        let rotation = DMat3::from_quat(glam::DQuat::from_scaled_axis(turn)) * self.rotation;
        Self { rotation, translation: self.translation + by }
    }
}

/// Jacobian of a point's image with respect to rotation (rad) and translation of the pose: six
/// columns. `by_point` is that with respect to the point in the camera's axes.
pub fn pose_jacobian(stand: &RigidPose, own: DVec3, by_point: &SMatrix<f64, 2, 3>) -> SMatrix<f64, 2, 6> {
    let arm = stand.rotation * own;
    // d(ω × arm)/dω = −[arm]×.
    let turned = [DVec3::new(0.0, -arm.z, arm.y), DVec3::new(arm.z, 0.0, -arm.x), DVec3::new(-arm.y, arm.x, 0.0)];
    let mut by = SMatrix::<f64, 2, 6>::zeros();
    for (i, turn) in turned.into_iter().enumerate() {
        let column = by_point * nalgebra::Vector3::from(turn.to_array());
        by.set_column(i, &column);
        by.set_column(i + 3, &by_point.column(i));
    }
    by
}
