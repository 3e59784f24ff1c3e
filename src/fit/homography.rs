//! Pose of a plane from its homography (Zhang 2000).

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{DMatrix, Matrix3};

use super::rigid_pose::RigidPose;

/// The pose of a plane from points on it and their rays, each given at z = 1. `None` for fewer than
/// four, and if they do not determine it.
pub fn plane_pose(on_plane: &[DVec2], rays: &[DVec2]) -> Option<RigidPose> {
    let h = homography(on_plane, rays)?;
    let columns = [0, 1, 2].map(|i| DVec3::new(h[(0, i)], h[(1, i)], h[(2, i)]));
    let scale = 2.0 / (columns[0].length() + columns[1].length());
    // The plane is in front of the camera.
    let middle = on_plane.iter().sum::<DVec2>() / on_plane.len() as f64;
    let depth = columns[0].z * middle.x + columns[1].z * middle.y + columns[2].z;
    let [x, y, translation] = columns.map(|column| column * scale * depth.signum());
    let rotation = nearest_rotation(DMat3::from_cols(x, y, x.cross(y)))?;
    translation.is_finite().then_some(RigidPose { rotation, translation })
}

/// The direct linear transform with normalised coordinates (Hartley 1997).
fn homography(from: &[DVec2], to: &[DVec2]) -> Option<Matrix3<f64>> {
    if from.len() < 4 {
        return None;
    }
    let ([from_scale, to_scale], [from_middle, to_middle]) = {
        let sizes = [from, to].map(unit);
        (sizes.map(|(scale, _)| scale), sizes.map(|(_, middle)| middle))
    };
    let mut normal = DMatrix::<f64>::zeros(9, 9);
    for (a, b) in from.iter().zip(to) {
        let (a, b) = ((*a - from_middle) * from_scale, (*b - to_middle) * to_scale);
        let rows = [
            [a.x, a.y, 1.0, 0.0, 0.0, 0.0, -b.x * a.x, -b.x * a.y, -b.x],
            [0.0, 0.0, 0.0, a.x, a.y, 1.0, -b.y * a.x, -b.y * a.y, -b.y],
        ];
        for row in rows {
            for i in 0..9 {
                for j in 0..9 {
                    normal[(i, j)] += row[i] * row[j];
                }
            }
        }
    }
    if normal.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let eigen = normal.symmetric_eigen();
    let smallest = (0..9).min_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]))?;
    let h = Matrix3::from_fn(|i, j| eigen.eigenvectors[(3 * i + j, smallest)]);
    let into = Matrix3::new(
        from_scale,
        0.0,
        -from_scale * from_middle.x,
        0.0,
        from_scale,
        -from_scale * from_middle.y,
        0.0,
        0.0,
        1.0,
    );
    let back = Matrix3::new(1.0 / to_scale, 0.0, to_middle.x, 0.0, 1.0 / to_scale, to_middle.y, 0.0, 0.0, 1.0);
    Some(back * h * into)
}

/// Scale that brings points to a mean distance of √2 from their centroid, and the centroid.
fn unit(places: &[DVec2]) -> (f64, DVec2) {
    let middle = places.iter().sum::<DVec2>() / places.len() as f64;
    let mean = places.iter().map(|p| p.distance(middle)).sum::<f64>() / places.len() as f64;
    (2f64.sqrt() / mean.max(1e-12), middle)
}

/// The nearest rotation in the least-squares sense.
fn nearest_rotation(m: DMat3) -> Option<DMat3> {
    if !m.is_finite() {
        return None;
    }
    let svd = Matrix3::from_column_slice(&m.to_cols_array()).try_svd(true, true, 1e-14, 200)?;
    let rotation = svd.u? * svd.v_t?;
    let rotation = DMat3::from_cols_slice(rotation.as_slice());
    (rotation.determinant() > 0.0).then_some(rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plane_pose_matches_hand_calculation() {
        // A square of 2 at z = 4, its x axis up in the picture and its y axis to the left.
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(DVec2::from);
        let rays = [(0.5, 0.25), (0.5, 0.0), (0.25, 0.0), (0.25, 0.25)].map(DVec2::from);
        let pose = plane_pose(&square, &rays).unwrap();
        assert!(pose.translation.distance(DVec3::new(2.0, 1.0, 4.0)) < 1e-9, "{pose:?}");
        assert!(pose.rotation.abs_diff_eq(DMat3::from_cols(-DVec3::Y, -DVec3::X, -DVec3::Z), 1e-9), "{pose:?}");
        assert!(plane_pose(&square[..3], &rays[..3]).is_none());
        assert!(plane_pose(&[DVec2::ZERO; 4], &[DVec2::NAN; 4]).is_none());
    }
}
