//! Similarity transforms, as from the arbitrary frame of a reconstruction to the world's.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::Matrix3;

use crate::pose::Pose;

/// x ↦ scale · rotation · x + translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimilarityTransform {
    /// Metres per unit of the source.
    pub scale: f64,
    pub rotation: DQuat,
    pub translation_m: DVec3,
}

impl SimilarityTransform {
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DQuat::IDENTITY, translation_m: DVec3::ZERO };

    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation_m
    }

    /// The pose of a camera in the other frame.
    pub fn transform_pose(&self, camera_from_source: &Pose) -> Pose {
        Pose::from_camera_in_world(
            self.transform_point(camera_from_source.position_in_world_m()),
            self.rotation * camera_from_source.world_from_camera_rotation(),
        )
    }

    /// The transform that takes the first points of the pairs nearest to the second ones: Umeyama
    /// 1991, equations 40 to 42. `None` for fewer than three points, and for points on a line.
    pub fn between(pairs: &[(DVec3, DVec3)]) -> Option<Self> {
        let count = pairs.len() as f64;
        let from_mean = pairs.iter().map(|(from, _)| from).sum::<DVec3>() / count;
        let to_mean = pairs.iter().map(|(_, to)| to).sum::<DVec3>() / count;
        let (mut covariance, mut variance) = (Matrix3::zeros(), 0.0);
        for (from, to) in pairs {
            let (from, to) = (from - from_mean, to - to_mean);
            let column = |v: DVec3| nalgebra::Vector3::new(v.x, v.y, v.z);
            covariance += column(to) * column(from).transpose() / count;
            variance += from.length_squared() / count;
        }
        let svd = covariance.try_svd(true, true, 1e-15, 1000)?;
        let (u, v_t) = (svd.u?, svd.v_t?);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
        // Of points on a line the second singular value is 0.
        if pairs.len() < 3 || variance <= 0.0 || svd.singular_values[order[1]] < 1e-9 * svd.singular_values[order[0]] {
            return None;
        }
        let mut sign = Matrix3::identity();
        if (u.determinant() * v_t.determinant()) < 0.0 {
            sign[(order[2], order[2])] = -1.0;
        }
        let rotation = u * sign * v_t;
        let trace: f64 = (0..3).map(|i| svd.singular_values[i] * sign[(i, i)]).sum();
        let scale = trace / variance;
        let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(rotation.as_slice())).normalize();
        let translation_m = to_mean - scale * (rotation * from_mean);
        let transform = Self { scale, rotation, translation_m };
        (scale > 0.0 && scale.is_finite() && rotation.is_finite()).then_some(transform)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_between_points_is_recovered() {
        let truth = SimilarityTransform {
            scale: 0.37,
            rotation: DQuat::from_euler(glam::EulerRot::ZYX, 2.0, -0.4, 0.9),
            translation_m: DVec3::new(3.0, -1.0, 0.5),
        };
        // Flat, as the corners of a sheet are.
        let flat = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.5)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let pairs = flat.map(|point| (point, truth.transform_point(point)));
        let transform = SimilarityTransform::between(&pairs).unwrap();
        assert!((transform.scale - truth.scale).abs() < 1e-12);
        assert!(transform.rotation.angle_between(truth.rotation) < 1e-7);
        assert!((transform.translation_m - truth.translation_m).length() < 1e-12);
        let line = [0.0, 1.0, 2.0].map(|x| (DVec3::X * x, DVec3::Y * x));
        assert_eq!(SimilarityTransform::between(&line), None);
        assert_eq!(SimilarityTransform::between(&pairs[..2]), None);
    }

    #[test]
    fn pose_moves_with_its_points() {
        let move_by = SimilarityTransform {
            scale: 2.0,
            rotation: DQuat::from_rotation_z(0.7),
            translation_m: DVec3::new(1.0, 2.0, 3.0),
        };
        let pose = Pose::from_camera_in_world(DVec3::new(0.3, 0.1, -1.0), DQuat::from_rotation_x(0.2));
        let point = DVec3::new(0.5, -0.4, 4.0);
        let after = move_by.transform_pose(&pose).transform_point(move_by.transform_point(point));
        assert!((after - 2.0 * pose.transform_point(point)).length() < 1e-12);
    }
}
