//! The variance that integer codes add, exactly, and how to remove it.
//!
//! A code is q = round(y), y = m + σz. The rounding error is the sawtooth q − y = Σ (−1)^k
//! sin(2πky)/(πk), so E[q|m] = m + Σ (−1)^k e^(−2π²k²σ²) sin(2πkm)/(πk). With the fraction of m
//! spread evenly, E[(q−m)²] = σ² + 1/12. Subtracting how far the mean of q itself deviates leaves
//!
//! V(σ) = σ² + 1/12 − Σ e^(−4π²k²σ²)/(2π²k²)
//!
//! (Sheppard's σ² + 1/12 is its limit for σ ≥ 0.5.) Against a mean A = round(m) on the same grid,
//! E[(q−A)²] = σ² + 1/6 − Σ e^(−2π²k²σ²)/(π²k²). Both are 0 at σ = 0.

use std::f64::consts::PI;

/// 16-bit codes in one 8-bit code.
pub(crate) const CODES16_PER_CODE8: i64 = 257;
/// Terms of the sums. The last is below 3e-4 of the first even at σ = 0, where the sums are not
/// used.
const TERMS: u32 = 60;

/// Rounding of the frames, and of the mean that variations are relative to. Steps in 8-bit code
/// values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rounding {
    /// One code of the frames.
    pub frame_step: f64,
    /// One code of a known mean. `None` if the mean is that of the frames themselves.
    pub mean_step: Option<f64>,
}

impl Rounding {
    /// The expected variance of the variations if the noise has the standard deviation `sigma`.
    pub fn variance(&self, sigma: f64) -> f64 {
        let frame = self.frame_step * self.frame_step / 12.0;
        match self.mean_step {
            None if sigma <= 0.0 => 0.0,
            Some(step) if sigma <= 0.0 && step == self.frame_step => 0.0,
            None => sigma * sigma + frame - self.sum(sigma, 4.0, 2.0),
            Some(step) if step == self.frame_step => sigma * sigma + 2.0 * frame - self.sum(sigma, 2.0, 1.0),
            Some(step) => sigma * sigma + frame + step * step / 12.0,
        }
    }

    /// The noise's standard deviation if the variations have this variance. 0 if rounding explains
    /// it all.
    pub fn sigma(&self, variance: f64) -> f64 {
        if variance.is_nan() || variance <= self.variance(0.0) {
            return 0.0;
        }
        let (mut low, mut high) = (0.0, variance.sqrt());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.variance(middle) < variance {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Σ step² e^(−exponent·π²k²σ²/step²) / (divisor·π²k²).
    fn sum(&self, sigma: f64, exponent: f64, divisor: f64) -> f64 {
        let step = self.frame_step;
        let mut total = 0.0;
        for k in 1..=TERMS {
            let pk2 = (PI * f64::from(k)).powi(2);
            let decay = (-exponent * pk2 * (sigma / step).powi(2)).exp();
            if decay < 1e-18 {
                break;
            }
            total += decay / (divisor * pk2);
        }
        total * step * step
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::censoring::cdf;

    const OWN: Rounding = Rounding { frame_step: 1.0, mean_step: None };
    const KNOWN: Rounding = Rounding { frame_step: 1.0, mean_step: Some(1.0) };

    /// The variance by brute force: a sum over codes, averaged over 400 evenly spaced fractions of
    /// the mean.
    fn by_counting(sigma: f64, known_mean: bool) -> f64 {
        let n = 400;
        let total: f64 = (0..n)
            .map(|i| {
                let m = (f64::from(i) + 0.5) / f64::from(n) - 0.5;
                let (mut s1, mut s2) = (0.0, 0.0);
                for q in -40..=40 {
                    let q = f64::from(q);
                    let p = cdf((q + 0.5 - m) / sigma) - cdf((q - 0.5 - m) / sigma);
                    s1 += p * q;
                    s2 += p * q * q;
                }
                // m lies in −0.5..0.5, so that the rounded mean is 0.
                if known_mean { s2 } else { s2 - s1 * s1 }
            })
            .sum();
        total / f64::from(n)
    }

    #[test]
    fn variance_matches_the_sum_over_codes() {
        for sigma in [0.1, 0.2, 0.3, 0.5, 0.9, 2.0, 6.0] {
            approx::assert_relative_eq!(OWN.variance(sigma), by_counting(sigma, false), max_relative = 2e-3);
            approx::assert_relative_eq!(KNOWN.variance(sigma), by_counting(sigma, true), max_relative = 2e-3);
        }
    }

    #[test]
    fn rounding_inflates_by_15_percent_at_half_a_code_and_5_at_0_9() {
        assert!((OWN.variance(0.5).sqrt() / 0.5 - 1.155).abs() < 1e-3);
        assert!((OWN.variance(0.9).sqrt() / 0.9 - 1.050).abs() < 1e-3);
    }

    #[test]
    fn sigma_inverts_the_variance_for_every_step() {
        let fine = Rounding { frame_step: 1.0 / 257.0, mean_step: None };
        let mixed = Rounding { frame_step: 1.0, mean_step: Some(1.0 / 257.0) };
        for rounding in [OWN, KNOWN, fine, mixed] {
            for sigma in [0.05, 0.15, 0.3, 0.5, 1.0, 3.0, 20.0] {
                approx::assert_relative_eq!(rounding.sigma(rounding.variance(sigma)), sigma, max_relative = 1e-6);
            }
            assert_eq!(rounding.sigma(0.0), 0.0);
            assert_eq!(rounding.sigma(f64::NAN), 0.0);
        }
    }
}
