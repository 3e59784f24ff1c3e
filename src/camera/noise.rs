//! The sensor's noise: a standard deviation for each channel and intensity (Fischer, noise
//! calibration), and how neighbours and channels move together.

/// σ of one intensity bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseBin {
    /// Middle of the bin, in 8-bit code values (0 to 255).
    pub code: f64,
    /// Standard deviation in 8-bit code values, before rounding to whole ones.
    pub sigma: f64,
}

/// What was measured of a camera's noise. Code values are on the 8-bit scale for every depth.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseProfile {
    /// Bins of R, G and B, ascending in `code`, at least one each.
    pub bins: [Vec<NoiseBin>; 3],
    /// Correlation of the channels' noise at one pixel: R-G, R-B, G-B; -1 to 1.
    pub channel_correlation: [f64; 3],
    /// Correlation of a pixel with its neighbour to the right and with the one below; 0 to 1.
    pub neighbour_correlation: [f64; 2],
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_bins_it_is_linear_and_beyond_constant() {
        let bins = vec![NoiseBin { code: 64.0, sigma: 2.0 }, NoiseBin { code: 128.0, sigma: 4.0 }];
        let profile = NoiseProfile {
            bins: [bins.clone(), bins.clone(), bins],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        assert_eq!(profile.sigma(0, 96.0), 3.0);
        assert_eq!(profile.sigma(1, 10.0), 2.0);
        assert_eq!(profile.sigma(2, 200.0), 4.0);
    }
}
