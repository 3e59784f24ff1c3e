//! The 8×8 blocks of a component: forward DCT, quantiser and the decoder's inverse DCT, in the
//! order of operations of shaders/coding_blocks.wgsl. A transform runs over the rows of a block,
//! for its eight columns at once.

use super::lanes::{ROUNDING, floor};
use crate::coding::dct::{InverseDct, InverseDctConstants};
use crate::coding::{BLOCK, Decoder};

type Block8x8<T> = [[T; BLOCK]; BLOCK];

/// Arithmetic of a component's blocks.
#[derive(Clone, Debug)]
pub struct BlockCoding {
    steps: Block8x8<f32>,
    inverse: InverseDct,
}

impl BlockCoding {
    /// `steps` are those of the component, row by row.
    pub fn new(steps: &[u16; BLOCK * BLOCK], decoder: Decoder) -> Self {
        let steps = std::array::from_fn(|v| std::array::from_fn(|u| f32::from(steps[BLOCK * v + u])));
        let inverse = if decoder == Decoder::Libjpeg { InverseDct::LIBJPEG } else { InverseDct::ZUNE };
        Self { steps, inverse }
    }

    /// Decoded samples of a block of samples that are whole codes.
    #[inline(always)]
    pub fn code(&self, samples: &Block8x8<f32>) -> Block8x8<u8> {
        let centred = samples.map(|row| row.map(|sample| sample - 128.0));
        let along = transposed(&forward(&transposed(&centred)));
        let mut coefficients = [[0; BLOCK]; BLOCK];
        for ((out, row), steps) in coefficients.iter_mut().zip(&forward(&along)).zip(&self.steps) {
            for ((out, c), step) in out.iter_mut().zip(row).zip(steps) {
                *out = quantized(*c, *step);
            }
        }
        let InverseDct { constant_bits, pass_bits, bias, .. } = self.inverse;
        let shift = constant_bits - pass_bits;
        let columns = inverse(&self.inverse, &coefficients, 1 << (shift - 1), shift);
        // √8 in each pass.
        let last = constant_bits + pass_bits + 3;
        let bias = (1 << (last - 1)) + (128 << last) + bias;
        let rows = transposed(&inverse(&self.inverse, &transposed(&columns), bias, last));
        rows.map(|row| row.map(|sample| sample.clamp(0, 255) as u8))
    }
}

/// The multiple of a step that is nearest to an eighth of a value; halves away from 0.
#[inline(always)]
fn quantized(value: f32, step: f32) -> i32 {
    let magnitude = floor(0.125 * value.abs() / step + 0.5) * step;
    // Whole and below 2²²: its bits are those of the sum.
    let bits = (magnitude + ROUNDING).to_bits().wrapping_sub(ROUNDING.to_bits()) as i32;
    if value < 0.0 { bits.wrapping_neg() } else { bits }
}

#[inline(always)]
fn transposed<T: Copy + Default>(block: &Block8x8<T>) -> Block8x8<T> {
    let mut out = [[T::default(); BLOCK]; BLOCK];
    for (i, row) in block.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            out[j][i] = *value;
        }
    }
    out
}

/// The forward DCT over the rows, times √8, by even and odd halves. Frequencies 0 and 4 of whole
/// numbers are exact.
#[inline(always)]
fn forward(x: &Block8x8<f32>) -> Block8x8<f32> {
    // √2 cos(kπ/16).
    const C: [f32; 8] = [0.0, 1.387_039_8, 1.306_563, 1.175_875_6, 0.0, 0.785_695, 0.541_196_1, 0.275_899_38];
    let mut out = [[0.0; BLOCK]; BLOCK];
    for i in 0..BLOCK {
        let e = [x[0][i] + x[7][i], x[1][i] + x[6][i], x[2][i] + x[5][i], x[3][i] + x[4][i]];
        let o = [x[0][i] - x[7][i], x[1][i] - x[6][i], x[2][i] - x[5][i], x[3][i] - x[4][i]];
        let dot = |v: [f32; 4], w: [f32; 4]| v[0] * w[0] + v[1] * w[1] + v[2] * w[2] + v[3] * w[3];
        out[0][i] = e[0] + e[1] + e[2] + e[3];
        out[1][i] = dot(o, [C[1], C[3], C[5], C[7]]);
        out[2][i] = dot(e, [C[2], C[6], -C[6], -C[2]]);
        out[3][i] = dot(o, [C[3], -C[7], -C[1], -C[5]]);
        out[4][i] = e[0] - e[1] - e[2] + e[3];
        out[5][i] = dot(o, [C[5], -C[1], C[7], C[3]]);
        out[6][i] = dot(e, [C[6], -C[2], C[2], -C[6]]);
        out[7][i] = dot(o, [C[7], -C[5], C[3], -C[1]]);
    }
    out
}

/// The inverse DCT over the rows, times √8 · 2^`constant_bits`, plus a bias, shifted. Sums wrap as
/// the decoders' do.
#[inline(always)]
fn inverse(fixed: &InverseDct, f: &Block8x8<i32>, bias: i32, shift: u32) -> Block8x8<i32> {
    let InverseDctConstants { even, shared, single, paired } = fixed.constants;
    let add = i32::wrapping_add;
    let sub = i32::wrapping_sub;
    let mul = i32::wrapping_mul;
    let mut out = [[0i32; BLOCK]; BLOCK];
    for i in 0..BLOCK {
        let [f0, f1, f2, f3, f4, f5, f6, f7] = f.map(|row| row[i]);
        let rotation = mul(add(f2, f6), even[0]);
        let even_2 = add(rotation, mul(f6, even[1]));
        let even_3 = add(rotation, mul(f2, even[2]));
        let even_0 = add(f0, f4).wrapping_shl(fixed.constant_bits);
        let even_1 = sub(f0, f4).wrapping_shl(fixed.constant_bits);
        let evens = [add(even_0, even_3), add(even_1, even_2), sub(even_1, even_2), sub(even_0, even_3)];
        let common = mul(add(add(f7, f3), add(f5, f1)), shared);
        let by_71 = mul(add(f7, f1), paired[0]);
        let by_53 = mul(add(f5, f3), paired[1]);
        let by_73 = add(common, mul(add(f7, f3), paired[2]));
        let by_51 = add(common, mul(add(f5, f1), paired[3]));
        let odds = [
            add(mul(f1, single[3]), add(by_71, by_51)),
            add(mul(f3, single[2]), add(by_53, by_73)),
            add(mul(f5, single[1]), add(by_53, by_51)),
            add(mul(f7, single[0]), add(by_71, by_73)),
        ];
        for k in 0..4 {
            let even = add(evens[k], bias);
            out[k][i] = add(even, odds[k]) >> shift;
            out[7 - k][i] = sub(even, odds[k]) >> shift;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coding::dct::{self, InverseDct};
    use crate::hash::pcg3d;

    /// Halves of steps may be rounded differently, so that steps are such that there are none.
    #[test]
    fn blocks_equal_those_of_the_reference() {
        for (decoder, inverse) in [(Decoder::ZuneJpeg, InverseDct::ZUNE), (Decoder::Libjpeg, InverseDct::LIBJPEG)] {
            let steps: [u16; 64] = std::array::from_fn(|i| 7 + 2 * i as u16);
            let coding = BlockCoding::new(&steps, decoder);
            let mut differing = 0;
            for seed in 0..400 {
                let sample = |i: usize| (pcg3d([i as u32, seed, 5])[0] >> (24 + seed % 4)) as f32;
                let samples: [f32; 64] = std::array::from_fn(sample);
                let block = std::array::from_fn(|y| std::array::from_fn(|x| samples[8 * y + x]));
                let expected = inverse.samples(&dct::quantize(&dct::forward(&samples.map(|s| s - 128.0)), &steps));
                differing += usize::from(coding.code(&block).as_flattened() != expected);
            }
            assert!(differing <= 2, "{decoder:?}: {differing} of 400 blocks, where a half was rounded differently");
        }
    }
}
