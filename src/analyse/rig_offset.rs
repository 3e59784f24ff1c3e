//! Systematic error of all recorded poses: the hand-eye offset between camera and tracked body, and
//! the clock offset.
//!
//! If every pose lacks the same motion c (in the camera's axes) and is read δ too early, a link
//! from i to j measures
//!
//!   e_ij = (1 − A)·c + δ·(ξ_i − A·ξ_j),   A = Ad(T_i⁻¹ T_j)
//!
//! Iteratively reweighted least squares over all links, in px of displacement. Links between frames
//! that differ in motion blur have less weight ([`link_blur`]).

use nalgebra::{SMatrix, SVector};

use super::align::Link;
use super::link_blur;
use super::state::CameraState;
use crate::fit::quantile::upper_median;
use crate::fit::twist::{self, Twist};

const REWEIGHTINGS: usize = 10;
/// Parts of the recording for the jackknife.
const JACKKNIFE_PARTS: usize = 8;
/// Displacements below this are not observable, px.
const UNOBSERVABLE_PX: f64 = 0.02;
/// Prior standard deviations of the seven parameters, m, rad and s. They matter where the footage
/// has no information, such as with a camera at rest.
const PRIOR_SIGMAS: [f64; 7] = [0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.05];

/// Error of a link between sharp frames, px.
const SHARP_LINK_SIGMA_PX: f64 = 0.2;

/// Hand-eye offset and clock offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigOffset {
    /// Appended to every pose, in the camera's axes.
    pub hand_eye: Twist,
    /// Added to a frame's time to look up its pose, s.
    pub clock_s: f64,
    /// One standard deviation of each: jackknife over parts of the recording, combined with the
    /// unobservable part.
    pub hand_eye_sigma: Twist,
    pub clock_sigma_s: f64,
}

/// Sum of six squared t numbers that chance exceeds once in 1000 times: of 7 degrees of freedom
/// ([`JACKKNIFE_PARTS`]), two pairs of which correlate by 0.9, by simulation.
const SIGNIFICANT_SQUARES: f64 = 74.0;

impl RigOffset {
    /// True if the hand-eye offset differs from zero by more than chance.
    pub fn is_hand_eye_significant(&self) -> bool {
        let squares = self.hand_eye.zip_map(&self.hand_eye_sigma, |offset, sigma| (offset / sigma.max(1e-9)).powi(2));
        squares.sum() > SIGNIFICANT_SQUARES
    }
}

/// Hand-eye twist and clock offset.
type Parameters = SVector<f64, 7>;

/// Estimates the offset; `None` without links. `has_body`: whether there is a hand-eye offset.
pub fn estimate(links: &[Link], states: &[Option<CameraState>], has_body: bool, exposure_s: f64) -> Option<RigOffset> {
    let frames = states.len().max(1);
    let terms: Vec<(&Link, SMatrix<f64, 6, 7>, f64)> = links
        .iter()
        .filter_map(|link| {
            let (i, j) = (states[link.from]?, states[link.to]?);
            let a = twist::adjoint(&(i.world_from_camera.inverse() * j.world_from_camera));
            let mut b = SMatrix::<f64, 6, 7>::zeros();
            if has_body {
                b.fixed_view_mut::<6, 6>(0, 0).copy_from(&(nalgebra::Matrix6::identity() - a));
            }
            b.set_column(6, &(i.twist - a * j.twist));
            let by_blur = link_blur::error_px(link, [&i, &j], &a, exposure_s);
            Some((link, b, 1.0 / (1.0 + (by_blur / SHARP_LINK_SIGMA_PX).powi(2))))
        })
        .collect();
    let solve = |without: Option<usize>| -> Option<(Parameters, Parameters)> {
        let kept: Vec<_> =
            terms.iter().filter(|(link, ..)| Some(link.from * JACKKNIFE_PARTS / frames) != without).collect();
        let mut weights: Vec<f64> = kept.iter().map(|(.., by_blur)| *by_blur).collect();
        let (mut x, mut unseen) = (Parameters::zeros(), Parameters::zeros());
        for _ in 0..REWEIGHTINGS {
            let (mut h, mut g) = (SMatrix::<f64, 7, 7>::zeros(), Parameters::zeros());
            for ((link, b, _), w) in kept.iter().zip(&weights) {
                let by = b.transpose() * link.metric * *w;
                h += by * b;
                g += by * link.e;
            }
            let count = kept.len().max(1) as f64;
            for k in 0..7 {
                h[(k, k)] += count * (UNOBSERVABLE_PX / PRIOR_SIGMAS[k]).powi(2);
                unseen[k] = UNOBSERVABLE_PX * (count / h[(k, k)]).sqrt();
            }
            x = h.cholesky()?.solve(&g);
            let residuals_px: Vec<f64> = kept.iter().map(|(link, b, _)| link.displaced_px(&(link.e - b * x))).collect();
            let scale = upper_median(residuals_px.iter().copied()).unwrap_or(0.0).max(1e-6);
            let weight = |(px, (.., by_blur)): (&f64, &&(_, _, f64))| by_blur / (1.0 + (px / (2.0 * scale)).powi(2));
            weights = residuals_px.iter().zip(&kept).map(weight).collect();
        }
        Some((x, unseen))
    };
    let (x, unseen) = solve(None)?;
    let without: Vec<Parameters> = (0..JACKKNIFE_PARTS).filter_map(|part| Some(solve(Some(part))?.0)).collect();
    let n = without.len() as f64;
    let mean = without.iter().sum::<Parameters>() / n;
    let spread = without.iter().fold(Parameters::zeros(), |sum, x| sum + (x - mean).component_mul(&(x - mean)));
    let sigma = (spread * ((n - 1.0) / n)).zip_map(&unseen, |spread, unseen| spread.sqrt().hypot(unseen));
    Some(RigOffset {
        hand_eye: x.fixed_rows::<6>(0).clone_owned(),
        clock_s: x[6],
        hand_eye_sigma: sigma.fixed_rows::<6>(0).clone_owned(),
        clock_sigma_s: sigma[6],
    })
}

/// A correction of the readout time, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadoutStep {
    pub step_s: f64,
    /// One standard deviation by the scatter of links.
    pub sigma_s: f64,
    /// One standard deviation by the spread between parts of the recording, which also contains
    /// errors that neighbouring links share. `None` of fewer than three parts.
    pub parts_sigma_s: Option<f64>,
}

/// The correction by the links of a recording of `frames` frames.
pub fn readout(links: &[Link], frames: usize) -> Option<ReadoutStep> {
    /// Number of points that count as one independent value, because errors of neighbouring points
    /// are correlated.
    const CORRELATED_POINTS: f64 = 50.0;
    /// Additional error of each pair, s.
    const PAIR_SIGMA_S: f64 = 0.003;
    let steps: Vec<(usize, f64, f64)> = links
        .iter()
        .filter_map(|link| Some((link.from, link.readout.filter(|(information, _)| *information > 0.0)?)))
        .map(|(from, (information, slope))| {
            (from, -slope / information, CORRELATED_POINTS / information + PAIR_SIGMA_S * PAIR_SIGMA_S)
        })
        .collect();
    let mut weights = vec![1.0; steps.len()];
    let (mut mean, mut sigma) = (0.0, f64::INFINITY);
    for _ in 0..20 {
        let sums = steps
            .iter()
            .zip(&weights)
            .fold((0.0, 0.0), |(top, sum), ((_, d, var), w)| (top + w / var * d, sum + w / var));
        if sums.1 <= 0.0 {
            return None;
        }
        mean = sums.0 / sums.1;
        weights = steps.iter().map(|(_, d, var)| 1.0 / (1.0 + (d - mean).powi(2) / var / 4.0)).collect();
        let spread: f64 = steps.iter().zip(&weights).map(|((_, d, var), w)| (w / var * (d - mean)).powi(2)).sum();
        sigma = spread.sqrt() / sums.1;
    }
    let weighted = steps.iter().zip(&weights).map(|((from, d, var), w)| (*from, *d, w / var));
    Some(ReadoutStep { step_s: mean, sigma_s: sigma, parts_sigma_s: parts_sigma(weighted, frames) })
}

/// The standard deviation of a weighted mean by the means of [`JACKKNIFE_PARTS`] parts of a
/// recording: σ² = Σ W_p·(m_p − m)² / ((P − 1)·Σ W_p). Values come with their frame and weight.
fn parts_sigma(values: impl Iterator<Item = (usize, f64, f64)>, frames: usize) -> Option<f64> {
    let mut parts = [(0.0, 0.0); JACKKNIFE_PARTS];
    for (frame, value, weight) in values {
        let part = &mut parts[(frame * JACKKNIFE_PARTS / frames.max(1)).min(JACKKNIFE_PARTS - 1)];
        *part = (part.0 + weight * value, part.1 + weight);
    }
    let parts: Vec<(f64, f64)> = parts.into_iter().filter(|(_, weight)| *weight > 0.0).collect();
    if parts.len() < 3 {
        return None;
    }
    let (top, sum) = parts.iter().fold((0.0, 0.0), |(top, sum), part| (top + part.0, sum + part.1));
    let spread: f64 = parts.iter().map(|(top_p, w)| w * (top_p / w - top / sum).powi(2)).sum();
    Some((spread / ((parts.len() - 1) as f64 * sum)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigma_by_parts_is_the_standard_error_of_their_means() {
        // Eight parts of equal weight, in turn 0 and 2: mean 1, Σ(m − 1)²/(7·8) = 1/7.
        let values = (0..80).map(|frame| (frame, f64::from((frame / 10 % 2) as u32) * 2.0, 0.5));
        let sigma = parts_sigma(values, 80).unwrap();
        assert!((sigma - (1.0f64 / 7.0).sqrt()).abs() < 1e-12, "{sigma}");
        // Scatter within a part averages out.
        let values = (0..80).map(|frame| (frame, f64::from((frame % 2) as u32), 1.0));
        assert!(parts_sigma(values, 80).unwrap() < 1e-12);
        // Two parts do not suffice.
        assert_eq!(parts_sigma((0..20).map(|frame| (frame, 0.0, 1.0)), 80), None);
    }

    #[test]
    fn hand_eye_offset_within_its_uncertainty_is_not_significant() {
        let rig_offset = |sigmas: f64| RigOffset {
            hand_eye: Twist::repeat(0.001 * sigmas),
            clock_s: 0.0,
            hand_eye_sigma: Twist::repeat(0.001),
            clock_sigma_s: 0.0,
        };
        // Sums of 73.5 and 75.3.
        assert!(!rig_offset(3.5).is_hand_eye_significant() && rig_offset(3.55).is_hand_eye_significant());
    }
}
