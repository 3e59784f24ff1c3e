//! Where a solver may begin: a focal length guessed, and each board's stand from its homography (Zhang 2000).

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{DMatrix, Matrix3};

use super::model::{Lens, Stand};
use crate::camera::LensModel;

/// Rays farther off the axis do not fit a plane in front of the camera, rad.
const WIDEST: f64 = 1.3;

/// The stand of a board whose corners are seen by a lens without distortion. `None` if they do not say.
pub fn stand(lens: &Lens, board: &[DVec2], seen_px: &[DVec2]) -> Option<Stand> {
    let (on_board, rays): (Vec<DVec2>, Vec<DVec2>) =
        board.iter().zip(seen_px).filter_map(|(b, p)| Some((*b, on_plane(lens, *p)?))).unzip();
    let h = homography(&on_board, &rays)?;
    let columns = [0, 1, 2].map(|i| DVec3::new(h[(0, i)], h[(1, i)], h[(2, i)]));
    let scale = 2.0 / (columns[0].length() + columns[1].length());
    // The board is in front of the camera.
    let middle = on_board.iter().sum::<DVec2>() / on_board.len() as f64;
    let depth = columns[0].z * middle.x + columns[1].z * middle.y + columns[2].z;
    let [x, y, translation] = columns.map(|column| column * scale * depth.signum());
    let rotation = nearest_rotation(DMat3::from_cols(x, y, x.cross(y)))?;
    translation.is_finite().then_some(Stand { rotation, translation })
}

/// The ray of a place, where it crosses the plane z = 1.
fn on_plane(lens: &Lens, at_px: DVec2) -> Option<DVec2> {
    let [fx, fy, cx, cy, ..] = lens.values;
    let at = DVec2::new((at_px.x - cx) / fx, (at_px.y - cy) / fy);
    if lens.model != LensModel::OpencvFisheye {
        return Some(at);
    }
    let theta = at.length();
    (theta < WIDEST).then(|| at.normalize_or_zero() * theta.tan())
}

/// The direct linear transform, with both sides brought to unit size (Hartley 1997).
fn homography(from: &[DVec2], to: &[DVec2]) -> Option<Matrix3<f64>> {
    if from.len() < 6 {
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
    let least = (0..9).min_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]))?;
    let h = Matrix3::from_fn(|i, j| eigen.eigenvectors[(3 * i + j, least)]);
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

/// What brings places to a mean distance of √2 from their middle, and that middle.
fn unit(places: &[DVec2]) -> (f64, DVec2) {
    let middle = places.iter().sum::<DVec2>() / places.len() as f64;
    let mean = places.iter().map(|p| p.distance(middle)).sum::<f64>() / places.len() as f64;
    (2f64.sqrt() / mean.max(1e-12), middle)
}

/// In the sense of least squares.
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
    fn a_board_stands_where_it_stood() {
        for model in [LensModel::Opencv, LensModel::OpencvFisheye] {
            let lens = Lens::plain(model, 600.0, DVec2::new(320.0, 240.0));
            let stood = Stand {
                rotation: DMat3::from_quat(glam::DQuat::from_scaled_axis(DVec3::new(0.5, -0.4, 2.0))),
                translation: DVec3::new(-1.0, -2.0, 12.0),
            };
            let board: Vec<DVec2> = (0..20).map(|i| DVec2::new(f64::from(i % 5), f64::from(i / 5))).collect();
            let seen: Vec<DVec2> = board.iter().map(|b| lens.project(stood.point(*b)).unwrap().0).collect();
            let found = stand(&lens, &board, &seen).unwrap();
            assert!(found.translation.distance(stood.translation) < 1e-6, "{found:?}");
            assert!(found.rotation.abs_diff_eq(stood.rotation, 1e-7), "{found:?}");
            assert!(stand(&lens, &board[..5], &seen[..5]).is_none());
            assert!(stand(&lens, &[DVec2::ZERO; 8], &[DVec2::ZERO; 8]).is_none_or(|s| s.translation.is_finite()));
        }
    }
}
