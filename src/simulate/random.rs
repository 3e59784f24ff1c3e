//! Counter-based random numbers: the same keys give the same numbers, in any order, on any thread.

/// The finaliser of SplitMix64 (Steele, Lea, Flood 2014): a bijection that mixes all 64 bits.
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// SplitMix64 seeded from a few keys, such as seed, frame and pixel.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    pub fn new(keys: [u64; 4]) -> Self {
        Self(keys.iter().fold(0x243f_6a88_85a3_08d3, |state, key| mix(state.wrapping_add(*key).rotate_left(23))))
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix(self.0) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Two independent standard normal numbers (Box and Muller 1958).
    pub fn normals(&mut self) -> [f64; 2] {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        [radius * cos, radius * sin]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_have_mean_0_variance_1_and_kurtosis_3() {
        let n = 200_000;
        let (mut m1, mut m2, mut m4) = (0.0, 0.0, 0.0);
        for i in 0..n {
            for v in Random::new([7, 0, 0, i]).normals() {
                m1 += v;
                m2 += v * v;
                m4 += v.powi(4);
            }
        }
        let count = 2.0 * n as f64;
        // Five standard errors: 1/√n, √2/√n, √96/√n.
        assert!((m1 / count).abs() < 0.008, "{}", m1 / count);
        assert!((m2 / count - 1.0).abs() < 0.0112, "{}", m2 / count);
        assert!((m4 / count - 3.0).abs() < 0.08, "{}", m4 / count);
    }
}
