//! Initial estimate for the solver: a guessed focal length, and each board's pose from its
//! homography (Zhang 2000).

use glam::DVec2;

use super::model::LensVector;
use crate::camera::LensModel;
use crate::fit::{RigidPose, homography};

/// Largest angle from the axis, rad: rays beyond do not intersect a plane in front of the camera.
const MAX_ANGLE_RAD: f64 = 1.3;
/// Smallest number of corners, so that a misread one is detectable.
const MIN_CORNERS: usize = 6;

/// Pose of a board seen by a lens without distortion. `None` if it is not determined.
pub fn stand(lens: &LensVector, board: &[DVec2], seen_px: &[DVec2]) -> Option<RigidPose> {
    let (on_board, rays): (Vec<DVec2>, Vec<DVec2>) =
        board.iter().zip(seen_px).filter_map(|(b, p)| Some((*b, ray_on_plane(lens, *p)?))).unzip();
    if on_board.len() < MIN_CORNERS { None } else { homography::plane_pose(&on_board, &rays) }
}

/// Intersection of a point's ray with the plane z = 1.
fn ray_on_plane(lens: &LensVector, corners_px: DVec2) -> Option<DVec2> {
    let [fx, fy, cx, cy, ..] = lens.values;
    let at = DVec2::new((corners_px.x - cx) / fx, (corners_px.y - cy) / fy);
    if lens.model != LensModel::OpencvFisheye {
        return Some(at);
    }
    let theta = at.length();
    (theta < MAX_ANGLE_RAD).then(|| at.normalize_or_zero() * theta.tan())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn initial_pose_is_the_true_one() {
        for model in [LensModel::Opencv, LensModel::OpencvFisheye] {
            let lens = LensVector::plain(model, 600.0, DVec2::new(320.0, 240.0));
            let stood = RigidPose {
                rotation: DMat3::from_quat(glam::DQuat::from_scaled_axis(DVec3::new(0.5, -0.4, 2.0))),
                translation: DVec3::new(-1.0, -2.0, 12.0),
            };
            let board: Vec<DVec2> = (0..20).map(|i| DVec2::new(f64::from(i % 5), f64::from(i / 5))).collect();
            let projections: Vec<DVec2> =
                board.iter().map(|b| lens.project(stood.point(b.extend(0.0))).unwrap().0).collect();
            let pose = stand(&lens, &board, &projections).unwrap();
            assert!(pose.translation.distance(stood.translation) < 1e-6, "{pose:?}");
            assert!(pose.rotation.abs_diff_eq(stood.rotation, 1e-7), "{pose:?}");
            assert!(stand(&lens, &board[..5], &projections[..5]).is_none());
            assert!(stand(&lens, &[DVec2::ZERO; 8], &[DVec2::ZERO; 8]).is_none_or(|s| s.translation.is_finite()));
        }
    }
}
