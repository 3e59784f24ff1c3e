//! DCT of 8×8 blocks: forward in floating point, inverse in the decoders' integer arithmetic.
//!
//! F(v, u) = ¼ C(u) C(v) Σ f(y, x) cos((2x + 1) u π/16) cos((2y + 1) v π/16), C(0) = 1/√2 (ITU-T
//! T.81, A.3.3). Blocks are row-major: index 8 v + u, or 8 y + x.
//!
//! The integer inverse is the one-dimensional transform of Loeffler, Ligtenberg and Moschytz
//! (*Practical Fast 1-D DCT Algorithms with 11 Multiplications*, ICASSP 1989), over columns, then
//! rows, scaled by √8 in each pass. Decoders differ in the bits of its constants and in the
//! fraction that they keep between both passes. Sums wrap as the decoders' do; only coefficients
//! far beyond those of 8-bit samples get there.

use std::sync::LazyLock;

use super::BLOCK;

/// Values of a block.
pub const BLOCK_LEN: usize = BLOCK * BLOCK;

/// Index 8 v + u of each coefficient in the order of a JPEG file (T.81, figure A.6): along
/// diagonals, by turns upwards and downwards. No memo: a constant table.
pub static ZIGZAG: LazyLock<[usize; BLOCK_LEN]> = LazyLock::new(|| {
    let mut order = std::array::from_fn(|i| i);
    order.sort_by_key(|i| {
        let (v, u) = (i / BLOCK, i % BLOCK);
        (u + v, if (u + v) % 2 == 0 { u } else { v })
    });
    order
});

/// Row u has the samples of the frequency u, times √8: those of the frequencies 0 and 4 are ±1.
/// No memo: a constant table.
static BASIS: LazyLock<[[f32; BLOCK]; BLOCK]> = LazyLock::new(|| {
    let sample = |u: usize, x: usize| {
        let angle = ((2 * x + 1) * u) as f64 * std::f64::consts::PI / 16.0;
        if u == 0 { 1.0 } else { (2f64.sqrt() * angle.cos()) as f32 }
    };
    std::array::from_fn(|u| std::array::from_fn(|x| sample(u, x)))
});

/// Coefficients of samples that are centred about 0. Each sum runs over its index upwards, over
/// columns first, then over rows. Of whole samples the coefficients of the frequencies 0 and 4
/// are exact, so that halves of their steps are rounded as an encoder rounds them.
pub fn forward(samples: &[f32; BLOCK_LEN]) -> [f32; BLOCK_LEN] {
    let basis = &*BASIS;
    let mut columns = [0.0; BLOCK_LEN];
    for v in 0..BLOCK {
        for (y, weight) in basis[v].iter().enumerate() {
            for x in 0..BLOCK {
                columns[BLOCK * v + x] += weight * samples[BLOCK * y + x];
            }
        }
    }
    let row = |v: usize, u: usize| (0..BLOCK).fold(0.0, |sum, x| sum + basis[u][x] * columns[BLOCK * v + x]);
    std::array::from_fn(|i| row(i / BLOCK, i % BLOCK) / 8.0)
}

/// Samples, centred about 0, of coefficients: the transpose of [`forward`], without rounding.
pub fn inverse(coefficients: &[f32; BLOCK_LEN]) -> [f32; BLOCK_LEN] {
    let basis = &*BASIS;
    let mut columns = [0.0; BLOCK_LEN];
    for v in 0..BLOCK {
        for (y, weight) in basis[v].iter().enumerate() {
            for u in 0..BLOCK {
                columns[BLOCK * y + u] += weight * coefficients[BLOCK * v + u];
            }
        }
    }
    let row = |y: usize, x: usize| (0..BLOCK).fold(0.0, |sum, u| sum + basis[u][x] * columns[BLOCK * y + u]);
    std::array::from_fn(|i| row(i / BLOCK, i % BLOCK) / 8.0)
}

/// Multiples of the quantisation steps that are nearest to coefficients; halves away from 0, as
/// encoders round.
pub fn quantize(coefficients: &[f32; BLOCK_LEN], steps: &[u16; BLOCK_LEN]) -> [i32; BLOCK_LEN] {
    std::array::from_fn(|i| {
        let step = steps[i].max(1);
        ((coefficients[i] / f32::from(step)).round() as i32).wrapping_mul(step.into())
    })
}

/// Fixed point of an inverse DCT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InverseDct {
    /// Fraction of the constants, bits.
    pub constant_bits: u32,
    /// Fraction of the values between both passes, bits.
    pub pass_bits: u32,
    /// Added before the last rounding, in units of 2^-(`constant_bits` + `pass_bits` + 3).
    pub bias: i32,
    /// √2 times cosines of multiples of π/16 and their sums, in units of 2^-`constant_bits`.
    pub constants: InverseDctConstants,
}

/// Constants of an inverse DCT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InverseDctConstants {
    /// Rotation by 6π/16 of the frequencies 2 and 6.
    pub even: [i32; 3],
    /// √2 cos(3π/16), common to all odd frequencies.
    pub shared: i32,
    /// Factors of the frequencies 7, 5, 3 and 1.
    pub single: [i32; 4],
    /// Factors of the pairs (7, 1), (5, 3), (7, 3) and (5, 1).
    pub paired: [i32; 4],
}

impl InverseDct {
    /// 12 and 2 bits: the `image` crate's JPEG decoder. Its shortcuts for blocks of few
    /// coefficients have the same results.
    pub const ZUNE: Self = Self {
        constant_bits: 12,
        pass_bits: 2,
        bias: 1 << 9,
        constants: InverseDctConstants {
            even: [2217, -7567, 3135],
            shared: 4816,
            single: [1223, 8410, 12586, 6149],
            paired: [-3685, -10497, -8034, -1597],
        },
    };
    /// 13 and 2 bits: libjpeg's `islow`.
    pub const LIBJPEG: Self = Self {
        constant_bits: 13,
        pass_bits: 2,
        bias: 0,
        constants: InverseDctConstants {
            even: [4433, -15137, 6270],
            shared: 9633,
            single: [2446, 16819, 25172, 12299],
            paired: [-7373, -20995, -16069, -3196],
        },
    };

    /// Samples of a block of coefficients: + 128, cut off at 0 and 255.
    pub fn samples(&self, coefficients: &[i32; BLOCK_LEN]) -> [u8; BLOCK_LEN] {
        let mut columns = [0; BLOCK_LEN];
        for x in 0..BLOCK {
            let column = self.pass(std::array::from_fn(|v| coefficients[BLOCK * v + x]));
            for (y, value) in column.into_iter().enumerate() {
                columns[BLOCK * y + x] = rounded_shift(value, self.constant_bits - self.pass_bits);
            }
        }
        // √8 in each pass: 8 in total.
        let shift = self.constant_bits + self.pass_bits + 3;
        let mut samples = [0; BLOCK_LEN];
        for (row, sample_row) in columns.as_chunks::<BLOCK>().0.iter().zip(samples.as_chunks_mut::<BLOCK>().0) {
            *sample_row = self.pass(*row).map(|value| {
                let sample = rounded_shift(value.wrapping_add(self.bias), shift);
                sample.wrapping_add(128).clamp(0, 255) as u8
            });
        }
        samples
    }

    /// The one-dimensional inverse, times √8 · 2^`constant_bits`.
    fn pass(&self, f: [i32; BLOCK]) -> [i32; BLOCK] {
        let InverseDctConstants { even, shared, single, paired } = self.constants;
        let add = i32::wrapping_add;
        let mul = i32::wrapping_mul;
        let rotation = mul(add(f[2], f[6]), even[0]);
        let even_2 = add(rotation, mul(f[6], even[1]));
        let even_3 = add(rotation, mul(f[2], even[2]));
        let even_0 = add(f[0], f[4]).wrapping_shl(self.constant_bits);
        let even_1 = f[0].wrapping_sub(f[4]).wrapping_shl(self.constant_bits);
        let evens =
            [add(even_0, even_3), add(even_1, even_2), even_1.wrapping_sub(even_2), even_0.wrapping_sub(even_3)];
        let common = mul(add(add(f[7], f[3]), add(f[5], f[1])), shared);
        let by_71 = mul(add(f[7], f[1]), paired[0]);
        let by_53 = mul(add(f[5], f[3]), paired[1]);
        let by_73 = add(common, mul(add(f[7], f[3]), paired[2]));
        let by_51 = add(common, mul(add(f[5], f[1]), paired[3]));
        let odds = [
            add(mul(f[1], single[3]), add(by_71, by_51)),
            add(mul(f[3], single[2]), add(by_53, by_73)),
            add(mul(f[5], single[1]), add(by_53, by_51)),
            add(mul(f[7], single[0]), add(by_71, by_73)),
        ];
        std::array::from_fn(|i| match i {
            0..4 => add(evens[i], odds[i]),
            _ => evens[7 - i].wrapping_sub(odds[7 - i]),
        })
    }
}

/// Nearest to value / 2^bits, halves up.
fn rounded_shift(value: i32, bits: u32) -> i32 {
    value.wrapping_add(1 << (bits - 1)) >> bits
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, term by term.
    fn exact(samples: &[f32; BLOCK_LEN], v: usize, u: usize) -> f64 {
        let scale = |k: usize| if k == 0 { 0.5f64.sqrt() } else { 1.0 };
        let wave = |k: usize, x: usize| (((2 * x + 1) * k) as f64 * std::f64::consts::PI / 16.0).cos();
        let term = |i: usize| f64::from(samples[i]) * wave(v, i / BLOCK) * wave(u, i % BLOCK);
        0.25 * scale(u) * scale(v) * (0..BLOCK_LEN).map(term).sum::<f64>()
    }

    fn samples(seed: usize) -> [f32; BLOCK_LEN] {
        std::array::from_fn(|i| ((i * i * 37 + i * seed) % 251) as f32 - 125.0)
    }

    #[test]
    fn forward_matches_its_definition() {
        for seed in 0..20 {
            let coefficients = forward(&samples(seed));
            for (i, value) in coefficients.iter().enumerate() {
                let expected = exact(&samples(seed), i / BLOCK, i % BLOCK);
                assert!((f64::from(*value) - expected).abs() < 2e-4, "{seed} {i}: {value} {expected}");
            }
        }
    }

    #[test]
    fn inverse_returns_the_samples() {
        for seed in 0..20 {
            let original = samples(seed);
            for (a, b) in inverse(&forward(&original)).iter().zip(original) {
                assert!((a - b).abs() < 1e-3, "{seed}: {a} {b}");
            }
        }
    }

    #[test]
    fn zigzag_runs_along_diagonals() {
        assert_eq!(&ZIGZAG[..10], &[0, 1, 8, 16, 9, 2, 3, 10, 17, 24]);
        assert_eq!(&ZIGZAG[60..], &[47, 55, 62, 63][..]);
    }

    #[test]
    fn halves_of_a_step_are_rounded_away_from_zero() {
        let mut coefficients = [0.0; BLOCK_LEN];
        coefficients[..4].copy_from_slice(&[15.0, -15.0, 14.9, -25.0]);
        assert_eq!(quantize(&coefficients, &[10; BLOCK_LEN])[..4], [20, -20, 10, -30]);
        // 4 samples of 1: a coefficient of exactly ½ at the frequency 0.
        let few: [f32; BLOCK_LEN] = std::array::from_fn(|i| f32::from(i < 4));
        assert_eq!(forward(&few)[0], 0.5);
    }

    #[test]
    fn both_inverses_return_samples_within_rounding() {
        for inverse in [InverseDct::ZUNE, InverseDct::LIBJPEG] {
            for seed in 0..50 {
                let original = samples(seed);
                let again = inverse.samples(&forward(&original).map(|value| value.round() as i32));
                for (a, b) in original.iter().zip(again) {
                    // Coefficients are rounded to whole ones, samples after that.
                    assert!((a + 128.0 - f32::from(b)).abs() <= 2.0, "{inverse:?} {seed}: {a} {b}");
                }
            }
        }
    }

    /// 4 of a DC is half a sample: up. Values beyond the 8 bits are cut off.
    #[test]
    fn dc_is_rounded_up_and_samples_are_cut_off() {
        for inverse in [InverseDct::ZUNE, InverseDct::LIBJPEG] {
            let samples_of_dc = |dc: i32| inverse.samples(&std::array::from_fn(|i| if i == 0 { dc } else { 0 }));
            assert_eq!([4, 3, -4, -5, 2000, -2000].map(|dc| samples_of_dc(dc)[9]), [129, 128, 128, 127, 255, 0]);
            assert!(samples_of_dc(4).iter().all(|sample| *sample == 129));
        }
    }
}
