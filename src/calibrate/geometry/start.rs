//! Where a solver may begin: a focal length guessed, and each board's stand from its homography (Zhang 2000).

use glam::DVec2;

use super::model::Lens;
use crate::camera::LensModel;
use crate::fit::{Stand, homography};

/// Rays farther off the axis do not fit a plane in front of the camera, rad.
const WIDEST: f64 = 1.3;
/// Fewer corners do not show whether one of them was misread.
const LEAST: usize = 6;

/// The stand of a board whose corners are seen by a lens without distortion. `None` if they do not say.
pub fn stand(lens: &Lens, board: &[DVec2], seen_px: &[DVec2]) -> Option<Stand> {
    let (on_board, rays): (Vec<DVec2>, Vec<DVec2>) =
        board.iter().zip(seen_px).filter_map(|(b, p)| Some((*b, on_plane(lens, *p)?))).unzip();
    if on_board.len() < LEAST { None } else { homography::stand(&on_board, &rays) }
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn a_board_stands_where_it_stood() {
        for model in [LensModel::Opencv, LensModel::OpencvFisheye] {
            let lens = Lens::plain(model, 600.0, DVec2::new(320.0, 240.0));
            let stood = Stand {
                rotation: DMat3::from_quat(glam::DQuat::from_scaled_axis(DVec3::new(0.5, -0.4, 2.0))),
                translation: DVec3::new(-1.0, -2.0, 12.0),
            };
            let board: Vec<DVec2> = (0..20).map(|i| DVec2::new(f64::from(i % 5), f64::from(i / 5))).collect();
            let seen: Vec<DVec2> = board.iter().map(|b| lens.project(stood.point(b.extend(0.0))).unwrap().0).collect();
            let found = stand(&lens, &board, &seen).unwrap();
            assert!(found.translation.distance(stood.translation) < 1e-6, "{found:?}");
            assert!(found.rotation.abs_diff_eq(stood.rotation, 1e-7), "{found:?}");
            assert!(stand(&lens, &board[..5], &seen[..5]).is_none());
            assert!(stand(&lens, &[DVec2::ZERO; 8], &[DVec2::ZERO; 8]).is_none_or(|s| s.translation.is_finite()));
        }
    }
}
