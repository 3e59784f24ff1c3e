//! Pose graph: corrections of all frames, solved jointly from links and recorded poses.
//!
//! A link measures e_ij = c_i − A·c_j, A = Ad(T_i⁻¹ T_j), with the information H/50, because errors
//! of neighbouring points are correlated. Residuals are displacements in the picture, with Cauchy
//! weights of scale max(median, 0.15 px). Links beyond six scales are rejected. A difference in
//! motion blur adds to a link's variance ([`link_blur`]).
//!
//! Each frame has a prior at its recorded pose of 1 cm and 0.5°. A second solution adds the
//! information metric/m², where m is the median displacement of the linked frames in the first. It
//! estimates the error of the recorded poses; less accurate links do not move them. Links span a
//! few frames, so the normal equations are banded. Cholesky solves them in time linear in the
//! frames.

use nalgebra::Matrix6;

use super::align::Link;
use super::link_blur;
use super::state::CameraState;
use crate::fit::band::BandMatrix;
use crate::fit::quantile::upper_median;
use crate::fit::twist::{self, Twist};

const REWEIGHTINGS: usize = 6;
/// Number of points that count as one independent value.
const CORRELATED_POINTS: f64 = 50.0;
const MIN_SCALE_PX: f64 = 0.15;
/// Links with residuals of more scales are rejected.
const MAX_RESIDUAL_SCALES: f64 = 6.0;
const PRIOR_SIGMA_M: f64 = 0.01;
const PRIOR_SIGMA_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// One correction per frame, in its camera's axes; `prior_mean` for a frame without links.
/// `prior_mean`: one per frame, the correction that leads back to the recorded pose. `None` if the
/// equations have no solution.
pub fn solve(
    links: &[Link],
    states: &[Option<CameraState>],
    prior_mean: &[Twist],
    exposure_s: f64,
) -> Option<Vec<Twist>> {
    let metric = links.iter().map(|link| link.metric).sum::<Matrix6<f64>>() / links.len().max(1) as f64;
    let first = solve_with_prior(links, states, prior_mean, &Matrix6::zeros(), exposure_s)?;
    let mut is_linked = vec![false; states.len()];
    links.iter().for_each(|link| (is_linked[link.from], is_linked[link.to]) = (true, true));
    let moved_px =
        (first.iter().zip(prior_mean).zip(is_linked)).filter(|(_, is_linked)| *is_linked).map(|((by, prior), _)| {
            let moved = by - prior;
            (moved.transpose() * metric * moved)[0].max(0.0).sqrt()
        });
    let error_px = upper_median(moved_px).unwrap_or(0.0).max(MIN_SCALE_PX);
    solve_with_prior(links, states, prior_mean, &(metric / error_px.powi(2)), exposure_s)
}

/// Solves with the information `by_metric` added to each frame's prior.
fn solve_with_prior(
    links: &[Link],
    states: &[Option<CameraState>],
    prior_mean: &[Twist],
    by_metric: &Matrix6<f64>,
    exposure_s: f64,
) -> Option<Vec<Twist>> {
    let count = states.len();
    let band = links.iter().map(|link| link.from.abs_diff(link.to)).max().unwrap_or(0);
    let prior = Matrix6::from_diagonal(&twist::twist(
        glam::DVec3::splat(PRIOR_SIGMA_M.powi(-2)),
        glam::DVec3::splat(PRIOR_SIGMA_RAD.powi(-2)),
    )) + by_metric;
    let adjoints: Vec<Matrix6<f64>> = links
        .iter()
        .map(|link| {
            let (i, j) = (states[link.from]?, states[link.to]?);
            Some(twist::adjoint(&(i.world_from_camera.inverse() * j.world_from_camera)))
        })
        .collect::<Option<_>>()?;
    let links_per_frame = 2.0 * links.len() as f64 / count.max(1) as f64;
    let blurred: Vec<f64> = links
        .iter()
        .zip(&adjoints)
        .map(|(link, a)| {
            let (Some(i), Some(j)) = (states[link.from], states[link.to]) else { return 1.0 };
            let Some(inverse) = link.information.try_inverse() else { return 1.0 };
            let own = CORRELATED_POINTS * (link.metric * inverse).trace();
            let by_blur = links_per_frame * link_blur::error_px(link, [&i, &j], a, exposure_s).powi(2);
            own / (own + by_blur).max(1e-12)
        })
        .collect();
    let mut weights = blurred.clone();
    let mut corrections = prior_mean.to_vec();
    for _ in 0..REWEIGHTINGS {
        let mut equations = BandMatrix::new(6 * count, 6 * band + 5);
        for (frame, at) in prior_mean.iter().enumerate() {
            add(&mut equations, frame, frame, &prior);
            add_right(&mut equations, frame, &(prior * at));
        }
        for ((link, a), w) in links.iter().zip(&adjoints).zip(&weights) {
            let information = link.information * (w / CORRELATED_POINTS);
            let across = a.transpose() * information;
            add(&mut equations, link.from, link.from, &information);
            add(&mut equations, link.to, link.to, &(across * a));
            if link.from > link.to {
                add(&mut equations, link.from, link.to, &-(information * a));
            } else {
                add(&mut equations, link.to, link.from, &-across);
            }
            add_right(&mut equations, link.from, &(information * link.e));
            add_right(&mut equations, link.to, &-(across * link.e));
        }
        corrections = equations.solved()?.chunks(6).map(Twist::from_column_slice).collect();
        let left = |(link, a): (&Link, &Matrix6<f64>)| {
            link.displaced_px(&(link.e - corrections[link.from] + a * corrections[link.to]))
        };
        let residuals_px: Vec<f64> = links.iter().zip(&adjoints).map(left).collect();
        let scale = upper_median(residuals_px.iter().copied()).unwrap_or(0.0).max(MIN_SCALE_PX);
        let weight = |off: f64| {
            if off > MAX_RESIDUAL_SCALES * scale { 0.0 } else { 1.0 / (1.0 + (off / (2.0 * scale)).powi(2)) }
        };
        weights = residuals_px.iter().zip(&blurred).map(|(off, blurred)| weight(*off) * blurred).collect();
    }
    Some(corrections)
}

/// Adds a block at rows and columns of frames; `row` ≥ `column`.
fn add(equations: &mut BandMatrix, row: usize, column: usize, block: &Matrix6<f64>) {
    for (r, c) in (0..6).flat_map(|r| (0..6).map(move |c| (r, c))) {
        let (at_row, at_column) = (6 * row + r, 6 * column + c);
        if at_column <= at_row {
            equations.add(at_row, at_column, block[(r, c)]);
        }
    }
}

fn add_right(equations: &mut BandMatrix, frame: usize, values: &Twist) {
    values.iter().enumerate().for_each(|(k, value)| equations.add_right(6 * frame + k, *value));
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::super::link_blur::tests::link;
    use super::*;

    /// Frames at rest, each linked with the next two, of which one moves fast. Their recorded poses
    /// lack 1 mm by turns, which links see; links of the fast frame err by `error_m` besides.
    fn corrections_m(fast_m_per_s: f64, error_m: f64) -> Vec<f64> {
        const FAST: usize = 6;
        let twist_along_x = |m: f64| twist::twist(DVec3::X * m, DVec3::ZERO);
        let lacking = |n: usize| if n.is_multiple_of(2) { 0.5e-3 } else { -0.5e-3 };
        let state = |n: usize| {
            let twist = if n == FAST { twist_along_x(fast_m_per_s) } else { Twist::zeros() };
            Some(CameraState { world_from_camera: DAffine3::IDENTITY, twist })
        };
        let states: Vec<_> = (0..12).map(state).collect();
        let pairs = (0..12).flat_map(|from| [from + 1, from + 2].map(|to| (from, to))).filter(|(_, to)| *to < 12);
        let links: Vec<Link> = pairs
            .map(|(from, to)| {
                let error = [(from, 1.0), (to, -1.0)]
                    .into_iter()
                    .find(|(n, _)| *n == FAST)
                    .map_or(0.0, |(_, sign)| sign * error_m);
                link(from, to, twist_along_x(lacking(from) - lacking(to) + error))
            })
            .collect();
        let corrections = solve(&links, &states, &[Twist::zeros(); 12], 0.01).unwrap();
        corrections.iter().enumerate().map(|(n, by)| by[0] - lacking(n)).collect()
    }

    #[test]
    fn sharp_links_are_followed() {
        let left_m = corrections_m(0.0, 0.0);
        assert!(left_m.iter().all(|m| m.abs() < 0.1e-3), "{left_m:?}");
    }

    #[test]
    fn blurred_frame_stays_near_its_recorded_pose() {
        // Blur of 20 px, and links that err by 2 px, 4 mm.
        let (sharp, blurred) = (corrections_m(0.0, 4e-3), corrections_m(4.0, 4e-3));
        assert!(sharp[6].abs() > 2e-3, "links that nothing makes doubtful are believed: {sharp:?}");
        assert!(blurred[6].abs() < 1e-3, "{blurred:?}");
        assert!((0..12).filter(|n| *n != 6).all(|n| blurred[n].abs() < 0.3e-3), "{blurred:?}");
    }
}
