//! How clipping reduces a variance: a normal distribution censored at the ends of the code range.
//!
//! For y ~ N(m, 1) clipped from below at 0 (all in units of σ), with Φ and φ at m: mean x = mΦ + φ,
//! variance h = (m²+1)Φ + mφ − x². As functions of the *observed* mean x: dx/dm = Φ, dh/dx =
//! 2x(1−Φ)/Φ, d²h/dx² = 2(1−Φ)/Φ − 2xφ/Φ³. The mean of J frames is itself noisy by h/J, so that on
//! average s² = h(x) − ½·h″(x)·h/J (second order of the expansion around the noisy x).

use statrs::function::erf::erf;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Nearer to an end than this, in σ of the noise, too much is clipped to be of use.
pub(crate) const NEAREST_USABLE: f64 = 0.4;
/// Farther from the ends than this, in σ, clipping is negligible.
const NEGLIGIBLE_CLIPPING: f64 = 4.5;

/// The normal distribution's cumulative probability.
pub(crate) fn cdf(z: f64) -> f64 {
    0.5 * (1.0 + erf(z * FRAC_1_SQRT_2))
}

fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / (2.0 * PI).sqrt()
}

/// The share of the variance that clipping leaves, at an observed mean `x` standard deviations from
/// the end. `per_frames` is 1/J for the mean of J frames, 0 for a known mean. `x` must be at least
/// [`NEAREST_USABLE`].
pub(crate) fn kept_variance(x: f64, per_frames: f64) -> f64 {
    if x >= NEGLIGIBLE_CLIPPING {
        return 1.0;
    }
    let mut m = x;
    for _ in 0..30 {
        let step = (m * cdf(m) + density(m) - x) / cdf(m);
        m -= step;
        if step.abs() < 1e-12 {
            break;
        }
    }
    let (big, small) = (cdf(m), density(m));
    let h = (m * m + 1.0) * big + m * small - x * x;
    let curvature = 2.0 * (1.0 - big) / big - 2.0 * x * small / big.powi(3);
    h * (1.0 - 0.5 * curvature * per_frames)
}

/// The expected variance of variations around the observed mean `code` (8-bit scale), whose
/// unclipped standard deviation is `sigma`. `None` too near to an end.
pub(crate) fn clipped_variance(code: f64, sigma: f64, per_frames: f64) -> Option<f64> {
    let distance = code.min(255.0 - code);
    if sigma <= 0.0 {
        return Some(0.0);
    }
    let x = distance / sigma;
    (x >= NEAREST_USABLE).then(|| sigma * sigma * kept_variance(x, per_frames))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clipping_at_the_mean_gives_the_half_normal_variance() {
        // m = 0: x = 1/√(2π) = 0.39894, h = 1/2 − 1/(2π) = 0.34085
        let x = 1.0 / (2.0 * PI).sqrt() + 1e-12;
        assert!((kept_variance(x, 0.0) - (0.5 - 0.5 / PI)).abs() < 1e-9);
        assert_eq!(kept_variance(5.0, 0.1), 1.0);
        assert!((kept_variance(4.4, 0.1) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn curvature_is_the_second_derivative_of_the_variance() {
        for x in [0.5, 1.0, 2.0, 3.0] {
            let d = 1e-3;
            let [a, b, c] = [x - d, x, x + d].map(|x| kept_variance(x, 0.0));
            let expected = b * (1.0 - 0.5 * (a - 2.0 * b + c) / (d * d) * 0.1);
            assert!((kept_variance(x, 0.1) - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn both_ends_are_symmetric_and_too_close_is_refused() {
        assert_eq!(clipped_variance(3.0, 2.0, 0.1), clipped_variance(252.0, 2.0, 0.1));
        assert_eq!(clipped_variance(0.5, 2.0, 0.1), None);
        assert_eq!(clipped_variance(128.0, 2.0, 0.1), Some(4.0));
    }
}
