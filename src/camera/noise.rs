//! The sensor's noise: a standard deviation for each channel and intensity (Fischer, noise
//! calibration), and the correlation of neighbours and channels.

use crate::example_noise::NoiseModelFile;

/// σ of one intensity bin.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NoiseBin {
    /// Middle of the bin, in 8-bit code values (0 to 255).
    pub code: f64,
    /// Standard deviation in 8-bit code values, before rounding to integers.
    pub sigma: f64,
}

/// A camera's measured noise. Code values are on the 8-bit scale for every bit depth.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NoiseProfile {
    /// Bins of R, G and B, ascending in `code`, at least one each.
    pub bins: [Vec<NoiseBin>; 3],
    /// Correlation of the channels' noise at one pixel: R-G, R-B, G-B; -1 to 1.
    pub channel_correlation: [f64; 3],
    /// Correlation of a pixel with its neighbour to the right and with the one below; 0 to 1.
    pub neighbour_correlation: [f64; 2],
    /// Noise by example of the same camera and setting.
    #[serde(skip)]
    pub example: Option<NoiseModelFile>,
}

impl NoiseProfile {
    /// σ at a code value (8-bit scale): linear between the bins' middles, constant beyond.
    pub fn sigma(&self, channel: usize, code: f64) -> f64 {
        let bins = &self.bins[channel];
        let after = bins.partition_point(|b| b.code <= code);
        if after == 0 {
            return bins.first().map_or(0.0, |b| b.sigma);
        }
        if after == bins.len() {
            return bins[after - 1].sigma;
        }
        let (a, b) = (bins[after - 1], bins[after]);
        a.sigma + (b.sigma - a.sigma) * (code - a.code) / (b.code - a.code)
    }

    /// σ at the 256 code values of each channel.
    pub fn table(&self) -> Vec<[f32; 3]> {
        (0..256).map(|code| [0, 1, 2].map(|c| self.sigma(c, f64::from(code)) as f32)).collect()
    }
}

/// The side tap a of (a, 1, a) whose output has neighbour correlation ρ = 2a/(1 + 2a²). The filter
/// reaches at most 1/√2; larger correlations are reduced to that.
pub fn side_tap(correlation: f64) -> f64 {
    let rho = correlation.clamp(0.0, std::f64::consts::FRAC_1_SQRT_2);
    if rho < 1e-6 { 0.0 } else { (1.0 - (1.0 - 2.0 * rho * rho).max(0.0).sqrt()) / (2.0 * rho) }
}

/// Correlation of pixels zero, one and two apart along an axis, from that of neighbours, for white
/// noise filtered by (a, 1, a). Pixels further apart are uncorrelated.
pub fn correlations(neighbour: f64) -> [f64; 3] {
    let a = side_tap(neighbour);
    let whole = 1.0 + 2.0 * a * a;
    [1.0, 2.0 * a / whole, a * a / whole]
}

/// The remaining share of the variance under weights along an axis: Σᵢⱼ wᵢ wⱼ ρ(i − j).
pub fn variance_left(weights: &[f32], correlations: &[f64; 3]) -> f64 {
    let weight_product = |n: usize| -> f64 {
        weights.iter().zip(weights.iter().skip(n)).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    };
    correlations[0] * weight_product(0)
        + 2.0 * (correlations[1] * weight_product(1) + correlations[2] * weight_product(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remaining_variance_matches_hand_calculation() {
        // (1/2, 1, 1/2): ρ = 1 / 1.5, and 1/4 / 1.5 two apart.
        let half = correlations(2.0 / 3.0);
        assert!((half[1] - 2.0 / 3.0).abs() < 1e-12 && (half[2] - 1.0 / 6.0).abs() < 1e-12, "{half:?}");
        // Three thirds: 1/3 if independent; (3 + 4 · 2/3 + 2 · 1/6) / 9 = 2/3 with these
        // correlations.
        let thirds = [1.0f32 / 3.0; 3];
        assert!((variance_left(&thirds, &correlations(0.0)) - 1.0 / 3.0).abs() < 1e-6);
        assert!((variance_left(&thirds, &half) - 2.0 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn sigma_is_linear_between_bins_and_constant_beyond() {
        let bins = vec![NoiseBin { code: 64.0, sigma: 2.0 }, NoiseBin { code: 128.0, sigma: 4.0 }];
        let profile = NoiseProfile {
            example: None,
            bins: [bins.clone(), bins.clone(), bins],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        assert_eq!(profile.sigma(0, 96.0), 3.0);
        assert_eq!(profile.sigma(1, 10.0), 2.0);
        assert_eq!(profile.sigma(2, 200.0), 4.0);
    }
}
