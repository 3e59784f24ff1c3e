//! The pose of a frame from landmarks that neighbouring frames of the model show (resection).
//!
//! The landmarks' patches are tracked from those frames into this one ([`super::patch`]). Their
//! positions give the pose by robust least squares ([`solve_pose`]). Landmarks on moving things do
//! not fit and are left out.

use glam::{DMat2, DVec2, DVec3};

use super::patch::{LumaPyramid, PredictedPatch, track_patch};
use crate::camera::Geometry;
use crate::fit::robust::median_length;
use crate::plane::{HessePlane, Plane};
use crate::pose::Pose;
use crate::tags::{Corners, solve_pose};

/// Largest number of landmarks of a neighbour that are tracked.
const MAX_LANDMARKS: usize = 250;
/// Rounds of tracking, each with the predictions of the pose of the one before.
const ROUNDS: usize = 2;
/// Largest residual of a landmark that fits: the larger of [`MAX_RESIDUAL_MEDIANS`] median
/// residuals and [`MIN_OUTLIER_PX`].
const MAX_RESIDUAL_MEDIANS: f64 = 3.0;
const MIN_OUTLIER_PX: f64 = 1.0;
/// Smallest number of landmarks that fit, and their smallest share of those that were tracked.
const MIN_FITTING: usize = 20;
const MIN_FITTING_SHARE: f64 = 0.5;
/// Largest root mean square residual of the landmarks that fit, px.
const MAX_RMS_PX: f64 = 2.0;

/// A frame with a known pose, and the landmarks that it shows.
#[derive(Debug)]
pub struct PosedFrame {
    pub frame: usize,
    pub pose: Pose,
    /// Position in the world, and in the frame, px.
    pub landmarks: Vec<(DVec3, DVec2)>,
}

/// A pose, with the number of landmarks that fit it and their root mean square residual.
#[derive(Clone, Copy, Debug)]
pub struct Resection {
    pub pose: Pose,
    pub fitting: usize,
    pub rms_px: f64,
}

/// The pose of the frame `target`, near `initial`. `None` if too few landmarks are found or fit.
pub fn resect(
    geometry: &Geometry,
    neighbours: &[(&PosedFrame, &LumaPyramid)],
    target: &LumaPyramid,
    initial: &Pose,
) -> Option<Resection> {
    let mut resection = Resection { pose: *initial, fitting: 0, rms_px: f64::INFINITY };
    for _ in 0..ROUNDS {
        let mut tracked = Corners::default();
        for (neighbour, picture) in neighbours {
            let step = neighbour.landmarks.len().div_ceil(MAX_LANDMARKS).max(1);
            for (in_world, at_px) in neighbour.landmarks.iter().step_by(step) {
                let predicted = predict(geometry, &neighbour.pose, &resection.pose, *in_world, *at_px);
                if let Some(matched_px) = predicted.and_then(|predicted| track_patch(picture, target, &predicted)) {
                    tracked.in_world_m.push(*in_world);
                    tracked.seen_px.push(matched_px);
                }
            }
        }
        resection = fit(geometry, &tracked, &resection.pose)?;
    }
    Some(resection)
}

/// Where a patch of one camera appears in another, if its surface faces the first.
fn predict(geometry: &Geometry, first: &Pose, second: &Pose, in_world: DVec3, at_px: DVec2) -> Option<PredictedPatch> {
    let normal = first.world_from_camera_rotation() * DVec3::Z;
    let surface = HessePlane::from(Plane { point_m: in_world, normal });
    predict_on(geometry, first, second, &surface, in_world, at_px)
}

/// Where a patch of one camera around `in_world` appears in another, on a plane through that point.
pub fn predict_on(
    geometry: &Geometry,
    first: &Pose,
    second: &Pose,
    surface: &HessePlane,
    in_world: DVec3,
    at_px: DVec2,
) -> Option<PredictedPatch> {
    let project = |point: DVec3| geometry.project(second.transform_point(point));
    let camera = first.position_in_world_m();
    let predicted_px = |step: DVec2| {
        let ray = first.world_from_camera_rotation() * geometry.unproject(at_px + step)?;
        let along = -surface.height_m(camera) / surface.normal.dot(ray);
        project(camera + along * ray)
    };
    let slope = |step: DVec2| Some(0.5 * (predicted_px(step)? - predicted_px(-step)?));
    let by = DMat2::from_cols(slope(DVec2::X)?, slope(DVec2::Y)?);
    Some(PredictedPatch { from: at_px, to: project(in_world)?, by }).filter(|patch| patch.by.is_finite())
}

/// The pose by those landmarks that fit one.
fn fit(geometry: &Geometry, tracked: &Corners, initial: &Pose) -> Option<Resection> {
    if tracked.in_world_m.len() < MIN_FITTING {
        return None;
    }
    let first = solve_pose(geometry, tracked, initial)?;
    let limit_px = (MAX_RESIDUAL_MEDIANS * median_length(first.residuals_px.iter())).max(MIN_OUTLIER_PX);
    let mut fitting = Corners::default();
    for ((in_world, matched_px), residual) in tracked.in_world_m.iter().zip(&tracked.seen_px).zip(&first.residuals_px) {
        if residual.length() <= limit_px {
            fitting.in_world_m.push(*in_world);
            fitting.seen_px.push(*matched_px);
        }
    }
    let count = fitting.in_world_m.len();
    if count < MIN_FITTING || (count as f64) < MIN_FITTING_SHARE * tracked.in_world_m.len() as f64 {
        return None;
    }
    let solved = solve_pose(geometry, &fitting, &first.pose)?;
    let rms_px = solved.rms_px();
    (rms_px <= MAX_RMS_PX).then_some(Resection { pose: solved.pose, fitting: count, rms_px })
}
