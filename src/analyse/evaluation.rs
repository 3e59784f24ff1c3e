//! Evaluates refined poses against recorded ones by links, and aligns their gauge.

use glam::DAffine3;
use nalgebra::Matrix6;

use super::align::Link;
use super::registration_result::HeldOutResidual;
use super::state::CameraState;
use crate::fit::quantile::upper_median;
use crate::fit::twist::{self, Twist};

/// Residuals of the poses `before` and `after`, px, by links that were aligned with the poses
/// `used`.
pub fn held_out_residuals(
    links: &[Link],
    before: &[Option<CameraState>],
    after: &[Option<CameraState>],
    used: &[Option<CameraState>],
) -> Vec<HeldOutResidual> {
    let residual = |link: &Link| {
        let (recorded_px, refined_px) = (residual_px(link, before, used)?, residual_px(link, after, used)?);
        Some(HeldOutResidual { from: link.from, to: link.to, recorded_px, refined_px })
    };
    links.iter().filter_map(residual).collect()
}

/// Median residual of the poses of `states`, px, by links that were aligned with the poses `used`.
pub fn median_residual_px(links: &[Link], states: &[Option<CameraState>], used: &[Option<CameraState>]) -> f64 {
    upper_median(links.iter().filter_map(|link| residual_px(link, states, used))).unwrap_or(0.0)
}

fn residual_px(link: &Link, states: &[Option<CameraState>], used: &[Option<CameraState>]) -> Option<f64> {
    let motion =
        |of: &[Option<CameraState>]| Some(of[link.to]?.world_from_camera.inverse() * of[link.from]?.world_from_camera);
    let measured = motion(used)? * twist::exp(&link.e);
    Some(link.displaced_px(&twist::log(&(motion(states)?.inverse() * measured))))
}

/// Links fix the relative poses only. Moves all refined poses rigidly so that they agree best with
/// the recorded ones: least squares over the frames in the links' mean metric.
pub fn align_gauge(
    refined: &[Option<CameraState>],
    recorded: &[Option<CameraState>],
    links: &[Link],
) -> Vec<Option<CameraState>> {
    let metric = links.iter().map(|link| link.metric).sum::<Matrix6<f64>>() / links.len().max(1) as f64;
    let mut whole = DAffine3::IDENTITY;
    for _ in 0..3 {
        let (mut h, mut g) = (Matrix6::zeros(), Twist::zeros());
        for (now, was) in refined.iter().zip(recorded).filter_map(|(now, was)| Some(((*now)?, (*was)?))) {
            let here = whole * now.world_from_camera;
            // log(W⁻¹·exp(x)·here) ≈ off + Ad(here⁻¹)·x.
            let off = twist::log(&(was.world_from_camera.inverse() * here));
            let by = twist::adjoint(&here.inverse());
            let across = by.transpose() * metric;
            h += across * by;
            g -= across * off;
        }
        let Some(step) = h.cholesky().map(|h| h.solve(&g)) else { break };
        whole = twist::exp(&step) * whole;
    }
    let moved = |state: CameraState| CameraState { world_from_camera: whole * state.world_from_camera, ..state };
    refined.iter().map(|state| state.map(moved)).collect()
}

/// Gives each frame that repeats the previous picture the state of the previous frame.
pub fn copy_repeated_states(mut states: Vec<Option<CameraState>>, repeats: &[bool]) -> Vec<Option<CameraState>> {
    for n in 1..states.len() {
        if repeats[n] {
            states[n] = states[n - 1];
        }
    }
    states
}
