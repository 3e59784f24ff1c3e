//! Which model, which coefficients and which views a calibration rests on.

use glam::DVec2;
use nalgebra::DMatrix;

use super::calibrated::{Calibrated, ENOUGH_VIEWS, LEAST_VIEWS, LensOptions, NamedView, Refused};
use super::missing::missing;
use super::model::Lens;
use super::parameter::Parameter;
use super::solve::{Fit, finish, fit};
use crate::calibrate::board::{Board, Seen, Target};
use crate::camera::{Geometry, LensModel};
use crate::text::{count, fixed};

/// Why there is no calibration.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum LensError {
    #[error(
        "{} of {all} can be used; {LEAST_VIEWS} with the board tilted differently are needed, {ENOUGH_VIEWS} are good{}",
        count(*usable, "view"), first_reason(refused)
    )]
    Few { usable: usize, all: usize, refused: Vec<Refused> },
    #[error("no camera explains the views together: are they of one camera, with one zoom, and of a flat board?")]
    Unexplained,
    #[error("the views do not determine the camera: tilt the board by 20° to 45°, differently in each view")]
    Undetermined,
    #[error("a 360° picture's camera follows from its size; there is nothing to calibrate")]
    Round,
}

fn first_reason(refused: &[Refused]) -> String {
    refused.first().map_or(String::new(), |refused| format!("; {}: {}", refused.name, refused.reason))
}

/// The fisheye's model is chosen if its residuals are this share of the other's.
const FAR_BETTER: f64 = 0.75;
/// Places of tags are in metres.
const METRE_MM: f64 = 1000.0;
/// A coefficient below this many of its deviations might as well be 0.
const TELLING: f64 = 2.0;
/// A view whose median residual is this many times that of most views does not belong to them...
const ODD_VIEW: f64 = 3.0;
/// ... if it is larger than this, px: corners are hardly read better.
const ODD_VIEW_PX: f64 = 0.5;

/// Calibrates a camera from views of a picture of this size. `refused` are those that were given up before.
pub fn calibrate(
    (width_px, height_px): (u32, u32),
    views: Vec<NamedView>,
    mut refused: Vec<Refused>,
    options: &LensOptions,
) -> Result<Calibrated, LensError> {
    let all = views.len() + refused.len();
    let size_px = DVec2::new(f64::from(width_px), f64::from(height_px));
    let enough = |views: &[NamedView], refused: &[Refused]| match views.len() {
        usable if usable < LEAST_VIEWS => Err(LensError::Few { usable, all, refused: refused.to_vec() }),
        _ => Ok(()),
    };
    enough(&views, &refused)?;
    let (first, mut notes) = chosen(size_px, &seen(&views), options.model)?;
    let mut views = views;
    let (mut fit, mut covariance) = determined(&seen(&views), &first)?;
    loop {
        let odd = odd_views(&fit);
        if odd.is_empty() {
            break;
        }
        let mut kept = Vec::new();
        let mut stands = Vec::new();
        for (i, view) in views.into_iter().enumerate() {
            match odd.iter().find(|(n, _)| *n == i) {
                Some((_, reason)) => refused.push(Refused { name: view.name, reason: reason.clone() }),
                None => {
                    stands.push(fit.stands[i]);
                    kept.push(view);
                }
            }
        }
        views = kept;
        enough(&views, &refused)?;
        (fit, covariance) = determined(&seen(&views), &Fit { stands, ..fit })?;
    }
    let geometry = fit.lens.geometry(width_px, height_px);
    let sigma = |i: usize| covariance[(i, i)].sqrt();
    let named = fit.lens.names().into_iter().enumerate();
    let parameters: Vec<Parameter> =
        named.map(|(i, name)| Parameter { name, value: fit.lens.values[i], sigma: sigma(i) }).collect();
    notes.extend(odd_things(&fit.lens, &parameters, &geometry, &views));
    let (target, unit_mm) = match largest(&views) {
        tags @ Target::Tags(_) => (tags, Some(METRE_MM)),
        chessboard => (options.board.map_or(chessboard, Target::Chessboard), options.square_mm),
    };
    let missing = missing(size_px, &parameters, &seen(&views), &fit.stands, ENOUGH_VIEWS);
    Ok(Calibrated {
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

fn seen(views: &[NamedView]) -> Vec<&Seen> {
    views.iter().map(|view| &view.seen).collect()
}

/// The most that was seen of a board.
fn largest(views: &[NamedView]) -> Target {
    let larger = |a: Target, b: Target| match (a, b) {
        (Target::Chessboard(a), Target::Chessboard(b)) => {
            Target::Chessboard(Board::new(a.columns.max(b.columns), a.rows.max(b.rows)))
        }
        (tags @ Target::Tags(_), _) | (_, tags) => tags,
    };
    views.iter().map(|view| view.seen.of).reduce(larger).unwrap_or(Target::Tags(0))
}

/// The model, and what to say about it.
fn chosen(size_px: DVec2, views: &[&Seen], wanted: Option<LensModel>) -> Result<(Fit, Vec<String>), LensError> {
    let of = |model| fit(model, size_px, views);
    match wanted {
        Some(model @ (LensModel::Opencv | LensModel::OpencvFisheye)) => {
            of(model).map(|fit| (fit, Vec::new())).ok_or(LensError::Unexplained)
        }
        Some(LensModel::Equirectangular) => Err(LensError::Round),
        None => match (of(LensModel::Opencv), of(LensModel::OpencvFisheye)) {
            (Some(brown), Some(fisheye)) if fisheye.mean_px() < FAR_BETTER * brown.mean_px() => {
                let [own, other] = [&fisheye, &brown].map(|fit| fixed(fit.mean_px(), 2));
                let note = format!(
                    "the model opencv_fisheye is taken: its residuals are {own} px in the mean, those of opencv {other} px"
                );
                Ok((fisheye, vec![note]))
            }
            (brown, fisheye) => brown.or(fisheye).map(|fit| (fit, Vec::new())).ok_or(LensError::Unexplained),
        },
    }
}

/// The fit to its end. The last radial coefficient is left out where the views do not tell it from 0: it would bend what
/// lies beyond them. The covariance counts it as unknown all the same.
fn determined(views: &[&Seen], from: &Fit) -> Result<(Fit, DMatrix<f64>), LensError> {
    let at = |with_last| {
        let fit = finish(views, from.lens, from.stands.clone(), with_last).ok_or(LensError::Unexplained)?;
        let covariance = fit.covariance(views).ok_or(LensError::Undetermined)?;
        Ok((fit, covariance))
    };
    let (whole, covariance) = at(true)?;
    let last = whole.lens.count() - 1;
    if whole.lens.values[last].abs() < TELLING * covariance[(last, last)].sqrt() {
        return at(false);
    }
    Ok((whole, covariance))
}

/// Views that the others' camera does not explain, by number, and why.
fn odd_views(fit: &Fit) -> Vec<(usize, String)> {
    // The median, since a misread corner or two do little.
    let medians: Vec<f64> = (0..fit.stands.len()).map(|view| fit.view_median_px(view)).collect();
    let mut sorted = medians.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let odd = medians.iter().enumerate().filter(|(_, own)| **own > (ODD_VIEW * usual).max(ODD_VIEW_PX));
    odd.map(|(view, own)| {
        let (own, usual) = (fixed(*own, 2), fixed(usual, 2));
        let reason = format!(
            "does not fit the other views: half of its corners are off by more than {own} px where {usual} px is usual (did the \
             board move or bend, or the zoom change?)"
        );
        (view, reason)
    })
    .collect()
}

/// What a person should know before trusting the camera.
fn odd_things(lens: &Lens, parameters: &[Parameter], geometry: &Geometry, views: &[NamedView]) -> Vec<String> {
    let mut notes = Vec::new();
    let last = &parameters[parameters.len() - 1];
    if last.value == 0.0 {
        let sigma = fixed(last.sigma, 3);
        notes.push(format!(
            "{} is left at 0: the views tell it to ±{sigma} only; the other ± count it as unknown",
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
    let seen = views.iter().flat_map(|view| &view.seen.at_px).map(|at| at.distance(centre)).fold(0.0, f64::max);
    let corners = [DVec2::ZERO, DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y), size];
    let farthest = corners.into_iter().map(|corner| corner.distance(centre)).fold(0.0, f64::max);
    let folds = corners.into_iter().filter_map(|corner| geometry.direction(corner)).any(|direction| {
        let angle = direction.truncate().length().atan2(direction.z);
        let radius = if lens.model == LensModel::OpencvFisheye { angle } else { angle.tan() };
        radius > geometry.valid_radius()
    });
    if folds {
        notes.push("the distortion folds back within the picture's corners, where no view holds it".to_owned());
    } else if farthest > 1.25 * seen {
        let (seen, farthest) = (fixed(seen, 0), fixed(farthest, 0));
        notes.push(format!("corners are seen up to {seen} px from the principal point; from there to the picture's corners, {farthest} px away, the distortion is a guess"));
    }
    notes
}
