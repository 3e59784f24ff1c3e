//! Selection of the model, the coefficients and the views of a calibration.

use glam::DVec2;
use nalgebra::DMatrix;

use super::calibration::{CameraCalibration, LensOptions, MIN_VIEWS, NamedView, RECOMMENDED_VIEWS, RejectedView};
use super::missing::missing;
use super::model::LensVector;
use super::parameter::Parameter;
use super::solve::{LensFit, finish, fit};
use crate::calibrate::board::{BoardDetection, ChessboardSize, DetectedTarget};
use crate::camera::{Geometry, LensModel};
use crate::fit::quantile::upper_median;
use crate::text::{count, fixed};

/// Reason why a calibration failed.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum LensCalibrationError {
    #[error(
        "{} of {all} can be used; {MIN_VIEWS} with the board tilted differently are needed, {RECOMMENDED_VIEWS} are good{}",
        count(*usable, "view"), first_reason(refused)
    )]
    Few { usable: usize, all: usize, refused: Vec<RejectedView> },
    #[error("no camera explains the views together: are they of one camera, with one zoom, and of a flat board?")]
    Unexplained,
    #[error("the views do not determine the camera: tilt the board by 20° to 45°, differently in each view")]
    Undetermined,
    #[error("a 360° picture's camera follows from its size; there is nothing to calibrate")]
    Panorama,
    #[error("this lens model is not calibrated; expected opencv or opencv_fisheye")]
    Model,
}

fn first_reason(refused: &[RejectedView]) -> String {
    refused.first().map_or(String::new(), |refused| format!("; {}: {}", refused.name, refused.reason))
}

/// The fisheye model is chosen if its residuals are at most this share of the other model's.
const MAX_FISHEYE_RESIDUAL_RATIO: f64 = 0.75;
/// Positions of tags are in metres.
const METRE_MM: f64 = 1000.0;
/// A coefficient below this many standard deviations is not significant.
const MIN_SIGNIFICANCE: f64 = 2.0;
/// A view is an outlier if its median residual exceeds this many times that of the median view...
const OUTLIER_RATIO: f64 = 3.0;
/// ... and this, px: corners are hardly more accurate.
const OUTLIER_PX: f64 = 0.5;

/// Calibrates a camera from views of a picture of this size. `refused` are views that were rejected
/// before.
pub fn calibrate(
    (width_px, height_px): (u32, u32),
    views: Vec<NamedView>,
    mut refused: Vec<RejectedView>,
    options: &LensOptions,
) -> Result<CameraCalibration, LensCalibrationError> {
    let all = views.len() + refused.len();
    let size_px = DVec2::new(f64::from(width_px), f64::from(height_px));
    let enough = |views: &[NamedView], refused: &[RejectedView]| match views.len() {
        usable if usable < MIN_VIEWS => Err(LensCalibrationError::Few { usable, all, refused: refused.to_vec() }),
        _ => Ok(()),
    };
    enough(&views, &refused)?;
    let (first, mut notes) = choose_model(size_px, &detections(&views), options.model)?;
    let mut views = views;
    let (mut fit, mut covariance) = final_fit(&detections(&views), &first)?;
    loop {
        let outliers = outlier_views(&fit);
        if outliers.is_empty() {
            break;
        }
        let mut kept = Vec::new();
        let mut stands = Vec::new();
        for (i, view) in views.into_iter().enumerate() {
            match outliers.iter().find(|(n, _)| *n == i) {
                Some((_, reason)) => refused.push(RejectedView { name: view.name, reason: reason.clone() }),
                None => {
                    stands.push(fit.stands[i]);
                    kept.push(view);
                }
            }
        }
        views = kept;
        enough(&views, &refused)?;
        (fit, covariance) = final_fit(&detections(&views), &LensFit { stands, ..fit })?;
    }
    let geometry = fit.lens.geometry(width_px, height_px);
    let sigma = |i: usize| covariance[(i, i)].sqrt();
    let named = fit.lens.names().into_iter().enumerate();
    let parameters: Vec<Parameter> =
        named.map(|(i, name)| Parameter { name, value: fit.lens.values[i], sigma: sigma(i) }).collect();
    notes.extend(remarks(&fit.lens, &parameters, &geometry, &views));
    let (target, unit_mm) = match largest(&views) {
        tags @ DetectedTarget::Tags(_) => (tags, Some(METRE_MM)),
        chessboard => (options.board.map_or(chessboard, DetectedTarget::Chessboard), options.square_mm),
    };
    let missing = missing(size_px, &parameters, &detections(&views), &fit.stands, RECOMMENDED_VIEWS);
    Ok(CameraCalibration {
        rms_px: fit.rms_px(),
        median_px: fit.median_px(),
        geometry,
        parameters,
        covariance,
        target,
        unit_mm,
        views,
        stands: fit.stands,
        residuals_px: fit.residuals_px,
        refused,
        missing,
        notes,
    })
}

fn detections(views: &[NamedView]) -> Vec<&BoardDetection> {
    views.iter().map(|view| &view.detection).collect()
}

/// The largest visible part of a board.
fn largest(views: &[NamedView]) -> DetectedTarget {
    let larger = |a: DetectedTarget, b: DetectedTarget| match (a, b) {
        (DetectedTarget::Chessboard(a), DetectedTarget::Chessboard(b)) => {
            DetectedTarget::Chessboard(ChessboardSize::new(a.columns.max(b.columns), a.rows.max(b.rows)))
        }
        (tags @ DetectedTarget::Tags(_), _) | (_, tags) => tags,
    };
    views.iter().map(|view| view.detection.target).reduce(larger).unwrap_or(DetectedTarget::Tags(0))
}

/// Chooses the model. Also returns remarks.
fn choose_model(
    size_px: DVec2,
    views: &[&BoardDetection],
    requested_model: Option<LensModel>,
) -> Result<(LensFit, Vec<String>), LensCalibrationError> {
    let fit_of = |model| fit(model, size_px, views);
    match requested_model {
        Some(model @ (LensModel::Opencv | LensModel::OpencvFisheye)) => {
            fit_of(model).map(|fit| (fit, Vec::new())).ok_or(LensCalibrationError::Unexplained)
        }
        Some(LensModel::Equirectangular) => Err(LensCalibrationError::Panorama),
        Some(LensModel::OpencvRational | LensModel::Fov | LensModel::ThinPrismFisheye | LensModel::StMap) => {
            Err(LensCalibrationError::Model)
        }
        None => match (fit_of(LensModel::Opencv), fit_of(LensModel::OpencvFisheye)) {
            (Some(brown), Some(fisheye)) if fisheye.mean_px() < MAX_FISHEYE_RESIDUAL_RATIO * brown.mean_px() => {
                let [own, other] = [&fisheye, &brown].map(|fit| fixed(fit.mean_px(), 2));
                let note = format!(
                    "the model opencv_fisheye is taken: its residuals are {own} px in the mean, those of opencv {other} px"
                );
                Ok((fisheye, vec![note]))
            }
            (brown, fisheye) => brown.or(fisheye).map(|fit| (fit, Vec::new())).ok_or(LensCalibrationError::Unexplained),
        },
    }
}

/// Final fit. The last radial coefficient is left out if it is not significant, because it would
/// bend the picture beyond the views. The covariance treats it as unknown all the same.
fn final_fit(views: &[&BoardDetection], from: &LensFit) -> Result<(LensFit, DMatrix<f64>), LensCalibrationError> {
    let at = |with_last| {
        let fit = finish(views, from.lens, from.stands.clone(), with_last).ok_or(LensCalibrationError::Unexplained)?;
        let covariance = fit.covariance(views).ok_or(LensCalibrationError::Undetermined)?;
        Ok((fit, covariance))
    };
    let (whole, covariance) = at(true)?;
    let last = whole.lens.count() - 1;
    if whole.lens.values[last].abs() < MIN_SIGNIFICANCE * covariance[(last, last)].sqrt() {
        return at(false);
    }
    Ok((whole, covariance))
}

/// Views that the common camera does not explain, by index, with the reason.
fn outlier_views(fit: &LensFit) -> Vec<(usize, String)> {
    // The median is insensitive to a few misread corners.
    let medians: Vec<f64> = (0..fit.stands.len()).map(|view| fit.view_median_px(view)).collect();
    let usual = upper_median(medians.iter().copied()).unwrap_or(0.0);
    let outliers = medians.iter().enumerate().filter(|(_, own)| **own > (OUTLIER_RATIO * usual).max(OUTLIER_PX));
    outliers.map(|(view, own)| {
        let (own, usual) = (fixed(*own, 2), fixed(usual, 2));
        let reason = format!(
            "does not fit the other views: half of its corners are off by more than {own} px where {usual} px is usual (did the \
             board move or bend, or the zoom change?)"
        );
        (view, reason)
    })
    .collect()
}

/// Remarks on the reliability of the camera.
fn remarks(lens: &LensVector, parameters: &[Parameter], geometry: &Geometry, views: &[NamedView]) -> Vec<String> {
    let mut notes = Vec::new();
    let last = &parameters[parameters.len() - 1];
    if last.value == 0.0 {
        let sigma = fixed(last.sigma, 3);
        notes.push(format!(
            "{} is left at 0: the views determine it only to ±{sigma}; the other ± treat it as unknown",
            last.name
        ));
    }
    let (fx, fy) = (lens.values[0], lens.values[1]);
    if (fx / fy - 1.0).abs() > 0.02 {
        let percent = fixed(100.0 * (fx / fy - 1.0).abs(), 1);
        notes.push(format!("fx and fy differ by {percent} %: pixels of few cameras are that far from square"));
    }
    let centre = DVec2::new(lens.values[2], lens.values[3]);
    let size = DVec2::new(geometry.intrinsics.width_px.into(), geometry.intrinsics.height_px.into());
    let farthest_seen =
        views.iter().flat_map(|view| &view.detection.corners_px).map(|at| at.distance(centre)).fold(0.0, f64::max);
    let corners = [DVec2::ZERO, DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y), size];
    let farthest = corners.into_iter().map(|corner| corner.distance(centre)).fold(0.0, f64::max);
    let folds = corners.into_iter().filter_map(|corner| geometry.direction(corner)).any(|direction| {
        let angle = direction.truncate().length().atan2(direction.z);
        let radius = if lens.model == LensModel::OpencvFisheye { angle } else { angle.tan() };
        radius > geometry.valid_radius()
    });
    if folds {
        notes.push("the distortion folds back within the picture's corners, where no view holds it".to_owned());
    } else if farthest > 1.25 * farthest_seen {
        let (farthest_seen, farthest) = (fixed(farthest_seen, 0), fixed(farthest, 0));
        notes.push(format!("corners are seen up to {farthest_seen} px from the principal point; from there to the picture's corners, {farthest} px away, the distortion is a guess"));
    }
    notes
}
