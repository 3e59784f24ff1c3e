//! What is wrong in all recorded poses alike: the camera's place on what was tracked, and the clock.
//!
//! If every pose lacks the same motion c (in the camera's axes) and is read δ too early, a link from i to j corrects by
//!
//!   e_ij = (1 − A)·c + δ·(ξ_i − A·ξ_j),   A = Ad(T_i⁻¹ T_j)
//!
//! Iteratively reweighted least squares over all links, in px of displacement. Links between frames
//! that differ in motion blur have less weight ([`link_blur`]).

use nalgebra::{SMatrix, SVector};

use super::align::Link;
use super::link_blur;
use super::robust::median;
use super::state::State;
use crate::fit::twist::{self, Twist};

const ROUNDS: usize = 10;
/// Parts of which each is left out once to see how sure the numbers are.
const PARTS: usize = 8;
/// What moves things between frames by less is not seen, px.
const UNSEEN_PX: f64 = 0.02;
/// What is believed of each number before the footage is asked, where that says nothing (a camera at rest): one standard
/// deviation, m, rad and s.
const BELIEVED: [f64; 7] = [0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.05];

/// Error of a link between sharp frames, px.
const SHARP_PX: f64 = 0.2;

/// Seven numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Global {
    /// Appended to every pose, in the camera's axes.
    pub hand_eye: Twist,
    /// Added to a frame's time to look up its pose, seconds.
    pub clock_s: f64,
    /// One standard deviation of each, by jackknife over parts of the recording, and by what is not seen.
    pub hand_eye_sigma: Twist,
    pub clock_sigma_s: f64,
}

/// Sum of six squared t numbers that chance exceeds once in 1000 times: of 7 degrees of freedom
/// ([`PARTS`] of the jackknife), two pairs of which correlate by 0.9, by simulation.
const SIGNIFICANT_SQUARES: f64 = 74.0;

impl Global {
    /// Whether the camera's place differs from where the poses say by more than chance.
    pub fn is_hand_eye_significant(&self) -> bool {
        let off = self.hand_eye.zip_map(&self.hand_eye_sigma, |off, sigma| (off / sigma.max(1e-9)).powi(2));
        off.sum() > SIGNIFICANT_SQUARES
    }
}

type Seven = SVector<f64, 7>;

/// `None` without links.
pub fn global(links: &[Link], states: &[Option<State>], has_body: bool, exposure_s: f64) -> Option<Global> {
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
            Some((link, b, 1.0 / (1.0 + (by_blur / SHARP_PX).powi(2))))
        })
        .collect();
    let solve = |without: Option<usize>| -> Option<(Seven, Seven)> {
        let kept: Vec<_> = terms.iter().filter(|(link, ..)| Some(link.from * PARTS / frames) != without).collect();
        let mut weights: Vec<f64> = kept.iter().map(|(.., by_blur)| *by_blur).collect();
        let (mut x, mut unseen) = (Seven::zeros(), Seven::zeros());
        for _ in 0..ROUNDS {
            let (mut h, mut g) = (SMatrix::<f64, 7, 7>::zeros(), Seven::zeros());
            for ((link, b, _), w) in kept.iter().zip(&weights) {
                let by = b.transpose() * link.metric * *w;
                h += by * b;
                g += by * link.e;
            }
            let count = kept.len().max(1) as f64;
            for k in 0..7 {
                h[(k, k)] += count * (UNSEEN_PX / BELIEVED[k]).powi(2);
                unseen[k] = UNSEEN_PX * (count / h[(k, k)]).sqrt();
            }
            x = h.cholesky()?.solve(&g);
            let off: Vec<f64> = kept.iter().map(|(link, b, _)| link.displaced_px(&(link.e - b * x))).collect();
            let usual = median(&mut off.clone()).max(1e-6);
            let weight = |(off, (.., by_blur)): (&f64, &&(_, _, f64))| by_blur / (1.0 + (off / (2.0 * usual)).powi(2));
            weights = off.iter().zip(&kept).map(weight).collect();
        }
        Some((x, unseen))
    };
    let (x, unseen) = solve(None)?;
    let without: Vec<Seven> = (0..PARTS).filter_map(|part| Some(solve(Some(part))?.0)).collect();
    let n = without.len() as f64;
    let mean = without.iter().sum::<Seven>() / n;
    let spread = without.iter().fold(Seven::zeros(), |sum, x| sum + (x - mean).component_mul(&(x - mean)));
    let sigma = (spread * ((n - 1.0) / n)).zip_map(&unseen, |spread, unseen| spread.sqrt().hypot(unseen));
    Some(Global {
        hand_eye: x.fixed_rows::<6>(0).clone_owned(),
        clock_s: x[6],
        hand_eye_sigma: sigma.fixed_rows::<6>(0).clone_owned(),
        clock_sigma_s: sigma[6],
    })
}

/// What the links say the readout time lacks, seconds, with one standard deviation by their scatter.
pub fn readout(links: &[Link]) -> Option<(f64, f64)> {
    /// Information counts this much less, as neighbouring points err alike, and each pair errs by this besides, s.
    const ALIKE: f64 = 50.0;
    const EACH_S: f64 = 0.003;
    let told: Vec<(f64, f64)> = links
        .iter()
        .filter_map(|link| link.readout.filter(|(information, _)| *information > 0.0))
        .map(|(information, slope)| (-slope / information, ALIKE / information + EACH_S * EACH_S))
        .collect();
    let mut weights = vec![1.0; told.len()];
    let (mut mean, mut sigma) = (0.0, f64::INFINITY);
    for _ in 0..20 {
        let sums =
            told.iter().zip(&weights).fold((0.0, 0.0), |(top, sum), ((d, var), w)| (top + w / var * d, sum + w / var));
        if sums.1 <= 0.0 {
            return None;
        }
        mean = sums.0 / sums.1;
        weights = told.iter().map(|(d, var)| 1.0 / (1.0 + (d - mean).powi(2) / var / 4.0)).collect();
        let spread: f64 = told.iter().zip(&weights).map(|((d, var), w)| (w / var * (d - mean)).powi(2)).sum();
        sigma = spread.sqrt() / sums.1;
    }
    Some((mean, sigma))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_eye_within_its_uncertainty_is_chance() {
        let of = |sigmas: f64| Global {
            hand_eye: Twist::repeat(0.001 * sigmas),
            clock_s: 0.0,
            hand_eye_sigma: Twist::repeat(0.001),
            clock_sigma_s: 0.0,
        };
        // Sums of 73.5 and 75.3.
        assert!(!of(3.5).is_hand_eye_significant() && of(3.55).is_hand_eye_significant());
    }
}
