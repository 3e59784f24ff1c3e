//! Y'CbCr planes to R'G'B' codes in the arithmetic of ffmpeg's scaler, with the flags `bicubic`,
//! `accurate_rnd`, `full_chroma_int` and `full_chroma_inp`.
//!
//! Chroma is interpolated with Keys' kernel (Keys 1981) of the parameter −0.6, horizontally with
//! 14-bit weights and a result of 7 fractional bits, then vertically with 12-bit weights. Colour
//! has 13-bit constants. Rounding errors of the weights are carried on from tap to tap.

use super::{ChromaSiting, ColorMatrix, ColorRange, SamplePlane, YcbcrColor};

const TAPS: usize = 4;
const HORIZONTAL_BITS: u32 = 14;
const VERTICAL_BITS: u32 = 12;
/// Fraction of horizontally interpolated samples, bits.
const FRACTION_BITS: u32 = 7;

/// Interpolation of one sample: four weights from a first sample on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct TapRow {
    first: usize,
    weights: [i32; TAPS],
}

/// Interpolation away from the ends of an axis: for the first and the second pixel of a chroma
/// sample, the weights, and the first weight's sample relative to the pixel's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Phases {
    pub first: [i32; 2],
    pub weights: [[i32; TAPS]; 2],
}

impl Phases {
    pub fn across(factor: u32, siting: ChromaSiting) -> Self {
        Self::new(factor, siting, HORIZONTAL_BITS)
    }

    pub fn down(factor: u32, siting: ChromaSiting) -> Self {
        Self::new(factor, siting, VERTICAL_BITS)
    }

    fn new(factor: u32, siting: ChromaSiting, bits: u32) -> Self {
        // Any sample that is far from both ends.
        const SAMPLE: usize = 8;
        let pixel = factor as usize * SAMPLE;
        let all = taps(pixel + 2, 2 * SAMPLE, factor, siting, bits);
        let tap = |phase: usize| all[pixel + phase % factor as usize];
        Self {
            first: [0, 1].map(|phase| tap(phase).first as i32 - SAMPLE as i32),
            weights: [0, 1].map(|phase| tap(phase).weights),
        }
    }
}

/// Keys' kernel of the parameter −0.6 at a distance in samples.
pub fn kernel(distance: f64) -> f64 {
    const A: f64 = -0.6;
    let d = distance.abs();
    if d < 1.0 {
        ((A + 2.0) * d - (A + 3.0)) * d * d + 1.0
    } else if d < 2.0 {
        ((A * d - 5.0 * A) * d + 8.0 * A) * d - 4.0 * A
    } else {
        0.0
    }
}

/// Position of a pixel on the axis of its chroma samples, in samples.
pub fn position(at: usize, factor: u32, siting: ChromaSiting) -> f64 {
    match (factor, siting) {
        (1, _) => at as f64,
        (_, ChromaSiting::Centered) => at as f64 / 2.0 - 0.25,
        (_, ChromaSiting::Cosited) => at as f64 / 2.0,
    }
}

/// Weights in units of 2^-`bits` for each pixel of an axis of `samples` chroma samples. Samples
/// beyond an end count as the one at the end.
fn taps(pixels: usize, samples: usize, factor: u32, siting: ChromaSiting, bits: u32) -> Vec<TapRow> {
    let taps_at = |at: usize| {
        let position = position(at, factor, siting);
        let nominal = position.floor() as isize - 1;
        let last_start = samples.saturating_sub(TAPS);
        let first = nominal.clamp(0, last_start as isize) as usize;
        let mut exact = [0.0; TAPS];
        // Where the kernel begins before the plane, the scaler leaves its first tap out.
        let begin = (position - 1.5) as isize;
        for i in (0..TAPS as isize).filter(|i| nominal + i >= begin) {
            let place = (nominal + i).clamp(0, samples as isize - 1) as usize - first;
            exact[place] += kernel(position - (nominal + i) as f64);
        }
        TapRow { first, weights: rounded(exact, bits) }
    };
    (0..pixels).map(taps_at).collect()
}

/// Weights in units of 2^-`bits` of their sum; each takes the rounding error of the one before it.
fn rounded(exact: [f64; TAPS], bits: u32) -> [i32; TAPS] {
    let one = f64::from(1 << bits) / exact.iter().sum::<f64>();
    let mut error = 0.0;
    exact.map(|weight| {
        let value = weight * one + error;
        let whole = value.round();
        error = value - whole;
        whole as i32
    })
}

/// A chroma plane at the resolution of luma, with [`FRACTION_BITS`] + [`VERTICAL_BITS`] fractional
/// bits.
fn interpolated(
    plane: &SamplePlane<u8>,
    size: [usize; 2],
    factor: [u32; 2],
    siting: [ChromaSiting; 2],
) -> SamplePlane<i32> {
    let sum = |taps: &TapRow, sample: &dyn Fn(usize) -> i32, length: usize| -> i32 {
        (0..TAPS.min(length)).map(|i| taps.weights[i] * sample(taps.first + i)).sum()
    };
    let columns = taps(size[0], plane.width, factor[0], siting[0], HORIZONTAL_BITS);
    let wide = SamplePlane::new(size[0], plane.height, |x, y| {
        let value = sum(&columns[x], &|at| plane.at(at, y).into(), plane.width);
        (value >> (HORIZONTAL_BITS - FRACTION_BITS)).min((1 << 15) - 1)
    });
    let rows = taps(size[1], plane.height, factor[1], siting[1], VERTICAL_BITS);
    SamplePlane::new(size[0], size[1], |x, y| sum(&rows[y], &|at| wide.at(x, at), plane.height))
}

/// Constants of the conversion in units of 2^-13.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conversion {
    pub black: i32,
    pub luma: i32,
    pub red_cr: i32,
    pub green_cb: i32,
    pub green_cr: i32,
    pub blue_cb: i32,
}

impl Conversion {
    pub fn new(color: YcbcrColor) -> Self {
        // Limited range, in units of 2^-16, as the scaler's tables have them.
        let [red_cr, blue_cb, green_cb, green_cr] = match color.matrix {
            ColorMatrix::Rgb | ColorMatrix::Bt601 => [104_597, 132_201, 25_675, 53_279],
            ColorMatrix::Bt709 => [117_489, 138_438, 13_975, 34_925],
            ColorMatrix::Bt2020 => [110_013, 140_363, 12_277, 42_626],
        };
        let (luma, black, ranged): (i64, i32, fn(i64) -> i64) = match color.range {
            ColorRange::Limited => ((1 << 16) * 255 / 219, 16, |c| c),
            ColorRange::Full => (1 << 16, 0, |c| c * 224 / 255),
        };
        let scaled = |c: i64| ((c * (1 << 13) + (1 << 15)) >> 16) as i32;
        Self {
            black,
            luma: scaled(luma),
            red_cr: scaled(ranged(red_cr)),
            green_cb: scaled(ranged(-green_cb)),
            green_cr: scaled(ranged(-green_cr)),
            blue_cb: scaled(ranged(blue_cb)),
        }
    }
}

/// R'G'B' codes of a picture from its planes of Y', Cb and Cr.
pub fn rgb(
    planes: &[SamplePlane<u8>; 3],
    size: [usize; 2],
    factor: [u32; 2],
    siting: [ChromaSiting; 2],
    color: YcbcrColor,
) -> Vec<u8> {
    let conversion = Conversion::new(color);
    let [cb, cr] = [1, 2].map(|i| interpolated(&planes[i], size, factor, siting));
    let mut codes = Vec::with_capacity(3 * size[0] * size[1]);
    for y in 0..size[1] {
        for x in 0..size[0] {
            // Nine fractional bits.
            let luma = (i32::from(planes[0].at(x, y)) - conversion.black) << 9;
            let chroma = |plane: &SamplePlane<i32>| (plane.at(x, y) + (1 << 9) - (128 << 19)) >> 10;
            let [cb, cr] = [chroma(&cb), chroma(&cr)];
            let luma = luma * conversion.luma + (1 << 21);
            let code = |sum: i32| (luma.wrapping_add(sum).clamp(0, (1 << 30) - 1) >> 22) as u8;
            codes.push(code(cr * conversion.red_cr));
            codes.push(code(cr * conversion.green_cr + cb * conversion.green_cb));
            codes.push(code(cb * conversion.blue_cb));
        }
    }
    codes
}
