//! Recursive accumulation, vSLRcam (13) and (14), as a finite sum.
//!
//! Each step mixes the newest frame with the previous result: step_n = (1 − α)·F_n + α·step_(n−1),
//! step_0 = F_0. Expanded, that is a sum of n + 1 frames, newest first:
//!
//! (1 − α)·F_n + α(1 − α)·F_(n−1) + … + α^(n−1)(1 − α)·F_1 + α^n·F_0       (13)
//!
//! The first n weights sum to 1 − α^n, the last is α^n: together 1. Being a finite sum, frame n is
//! independent of the starting frame. It trails, newest strongest, unlike a shutter's box; with α
//! from (14) the oldest frame has weight ε. The frame times are chosen by effects/motion_blur.rs,
//! which centres their mean on the exposure.

use crate::text::number;

/// ε of vSLRcam (14): the weight of the oldest frame.
pub const OLDEST_FRAME_WEIGHT: f64 = 1.0 / 50.0;
/// Maximum number of steps.
pub const MAX_STEPS: usize = 10_000;

/// An exposure that cannot be accumulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "accumulating {} s at {} frames a second: expected finite numbers from 0 whose product is at most \
     {MAX_STEPS}",
    number(*time_s), number(*frames_per_s)
)]
pub struct AccumulationError {
    pub time_s: f64,
    pub frames_per_s: f64,
}

/// n = t·fps of vSLRcam (14), rounded to whole frames.
pub fn steps(time_s: f64, frames_per_s: f64) -> Result<usize, AccumulationError> {
    let n = (time_s * frames_per_s).round();
    let fits = time_s >= 0.0 && frames_per_s >= 0.0 && n <= MAX_STEPS as f64;
    fits.then_some(n as usize).ok_or(AccumulationError { time_s, frames_per_s })
}

/// vSLRcam (14): α = ε^(1/n), 0 to 1. 0 for no steps, which keeps the newest frame alone.
pub fn alpha(steps: usize) -> f64 {
    if steps == 0 { 0.0 } else { OLDEST_FRAME_WEIGHT.powf(1.0 / steps as f64) }
}

/// The weights of vSLRcam (13), newest frame first: `steps + 1` of them, summing to 1.
pub fn weights(steps: usize) -> Vec<f64> {
    let alpha = alpha(steps);
    let mut weight = 1.0;
    let mut weights: Vec<f64> = Vec::with_capacity(steps + 1);
    for _ in 0..steps {
        weights.push((1.0 - alpha) * weight);
        weight *= alpha;
    }
    weights.push(weight);
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn weights_match_the_example_of_the_paper() {
        // t = 1/8 s at 80 frames a second: n = 10, α = 0.676, the newest frame weighs 0.32.
        let n = steps(0.125, 80.0).unwrap();
        assert_eq!(n, 10);
        assert!((alpha(n) - 0.676_243).abs() < 1e-6);
        let w = weights(n);
        assert_eq!(w.len(), 11);
        assert!((w[0] - 0.323_757).abs() < 1e-6);
        // α(1 − α), and α^10 = 1/50.
        assert!((w[1] - 0.218_938).abs() < 1e-6);
        assert!((w[10] - 0.02).abs() < 1e-12);
    }

    #[test]
    fn zero_exposure_is_the_newest_frame() {
        assert_eq!(steps(0.0, 80.0), Ok(0));
        assert_eq!(weights(0), [1.0]);
        // One step: 49/50 of the newest and 1/50 of the one before.
        assert!((weights(1)[0] - 0.98).abs() < 1e-12);
    }

    #[test]
    fn excessive_exposure_is_refused() {
        for (t, fps) in [(f64::NAN, 30.0), (-1.0, 30.0), (1.0, f64::INFINITY), (60.0, 1e6), (-1.0, -30.0)] {
            assert!(steps(t, fps).unwrap_err().to_string().contains("at most 10000"));
        }
    }

    proptest! {
        #[test]
        fn weighted_sum_equals_the_recursion(n in 0usize..60, frames in prop::collection::vec(0.0f64..1.0, 60)) {
            let w = weights(n);
            prop_assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let a = alpha(n);
            let recursive = frames[1..=n].iter().fold(frames[0], |step, frame| (1.0 - a) * frame + a * step);
            let summed: f64 = frames[..=n].iter().rev().zip(&w).map(|(frame, w)| frame * w).sum();
            prop_assert!((recursive - summed).abs() < 1e-12);
        }
    }
}
