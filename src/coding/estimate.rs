//! Coding of a picture that was a JPEG and was saved without loss after decoding.
//!
//! 1. Coefficients of a JPEG's luma are multiples of their quantisation steps q, up to the
//!    rounding of samples to whole codes. So the mean of cos(2π F/q) over coefficients beyond the
//!    zero bin is near exp(−2π² σ²/q²), σ = 0.3, on the right grid of blocks, and near 0 or below
//!    on any other (Neelamani et al.: *JPEG Compression History Estimation for Color Images*, IEEE
//!    TIP 15(6), 2006). It is tried at all 64 positions of the grid, for tables that are a scale of
//!    annex K.1's.
//! 2. At the best position, the scale of the greatest likelihood, and single steps that differ
//!    from it by 1.
//! 3. Chroma's sampling and the position of its blocks are those by which the picture returns
//!    unchanged from its own path in the largest share of its codes.
//!
//! Not found: tables of other families (Photoshop's, and many cameras'), steps of 1 throughout
//! (quality 99 and up), pictures that were resized or rotated after decoding.

use super::annex_k::{CHROMINANCE, LUMINANCE, scaled};
use super::comb::{CombSum, StepLikelihoods};
use super::dct::{self, BLOCK_LEN};
use super::path::unquantized_coefficients;
use super::{BLOCK, BlockQuantization, ChromaSampling, Decoder, PictureCoding, SamplePlane, YcbcrColor};

/// Scales of annex K's tables that are tried: 0.02 is libjpeg's quality 99, 1.2 its quality 42.
const MIN_SCALE: f64 = 0.02;
const MAX_SCALE: f64 = 1.2;
/// Largest ratio of a scale to the one before.
const SCALE_RATIO: f64 = 1.012;
/// Largest difference between neighbouring scales.
const SCALE_STEP: f64 = 0.002;
/// Blocks by which the position of the grid is found.
const POSITION_BLOCKS: usize = 220;
/// Blocks by which the tables are found.
const TABLE_BLOCKS: usize = 1200;
/// Frequencies u + v by which the position of the grid is found.
const POSITION_FREQUENCIES: std::ops::RangeInclusive<usize> = 1..=4;
/// Scales by which the position of the grid is found, each this many times the one before.
const POSITION_SCALE_RATIO: f64 = 1.05;
/// Codes nearer than this to 0 or 255 may be clipped.
const CLIP_MARGIN: u8 = 2;
/// Smallest score of a grid, standard deviations of pictures without one.
const MIN_SCORE: f64 = 6.5;
/// Smallest ratio of the best position's score to the second's.
const MIN_SCORE_RATIO: f64 = 1.8;
/// Log likelihood by which a step that differs by 1 must be better than its table's.
const STEP_MARGIN: f64 = 8.0;
/// Side of the part of a picture by which chroma's sampling is found, px.
const TRIAL_PX: usize = 160;
/// Smallest share of codes that return unchanged from the path.
const MIN_EQUAL_SHARE: f64 = 0.6;

/// An estimated coding.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedCoding {
    pub coding: PictureCoding,
    /// Scale of annex K's tables; single steps of the coding may differ from it by 1.
    pub scale: f64,
    /// Share of the codes of a part of the picture that return unchanged from the path.
    pub equal_share: f64,
}

/// Coding of a picture of interleaved R'G'B' codes. `None` if it never was a JPEG, or if that is
/// not sure.
pub fn estimate(codes: &[u8], size: [usize; 2]) -> Option<EstimatedCoding> {
    if size.iter().any(|side| *side < 4 * BLOCK) || codes.len() != 3 * size[0] * size[1] {
        return None;
    }
    let luma = Luma::new(codes, size);
    let position = grid_position(&luma)?;
    let blocks = luma.coefficients(position, TABLE_BLOCKS);
    let mut likelihoods = StepLikelihoods::new(&blocks);
    let table = likelihoods.best_scale(&scales(SCALE_RATIO, SCALE_STEP)).filter(|table| table.log_likelihood > 0.0)?;
    let luma_steps = likelihoods.adjusted(scaled(&LUMINANCE, table.scale), STEP_MARGIN);
    let chroma_steps = scaled(&CHROMINANCE, table.scale);
    let is_grey = codes.as_chunks::<3>().0.iter().all(|[r, g, b]| r == g && g == b);
    let trial = TrialPart::new(codes, size);
    let estimated = |candidate: &ChromaCandidate| {
        let coding = PictureCoding {
            color: YcbcrColor::JFIF,
            chroma: candidate.chroma,
            quantization: Some(BlockQuantization {
                steps: [luma_steps, chroma_steps, chroma_steps],
                origin: candidate.origin(position),
            }),
            decoder: Decoder::Libjpeg,
        };
        let equal_share = trial.equal_share(&coding);
        EstimatedCoding { coding, scale: table.scale, equal_share }
    };
    let all: Vec<EstimatedCoding> = candidates(is_grey).iter().map(estimated).collect();
    let mut best = all.into_iter().max_by(|a, b| a.equal_share.total_cmp(&b.equal_share))?;
    adjust_chroma(&mut best, &trial);
    (best.equal_share >= MIN_EQUAL_SHARE).then_some(best)
}

/// Scales to try, each at most `ratio` times the one before, and `step` more.
fn scales(ratio: f64, step: f64) -> Vec<f64> {
    let next = |scale: &f64| Some(scale + step.min(scale * (ratio - 1.0)));
    std::iter::successors(Some(MIN_SCALE), next).take_while(|scale| *scale <= MAX_SCALE).collect()
}

/// Luma of a picture, and where no channel is near its limits.
struct Luma {
    samples: SamplePlane<f32>,
    unclipped: SamplePlane<bool>,
}

impl Luma {
    fn new(codes: &[u8], size: [usize; 2]) -> Self {
        let (rows, _) = YcbcrColor::JFIF.forward();
        let [r, g, b] = rows[0].map(|weight| weight as f32);
        let pixels = codes.as_chunks::<3>().0;
        let at = |x: usize, y: usize| pixels[y * size[0] + x];
        // A JPEG's luma is whole.
        let samples = SamplePlane::new(size[0], size[1], |x, y| {
            let code = at(x, y).map(f32::from);
            (r * code[0] + g * code[1] + b * code[2]).round()
        });
        let range = CLIP_MARGIN + 1..255 - CLIP_MARGIN;
        let unclipped = SamplePlane::new(size[0], size[1], |x, y| at(x, y).iter().all(|code| range.contains(code)));
        Self { samples, unclipped }
    }

    /// Coefficients of up to `count` unclipped blocks of a grid, spread over the picture.
    fn coefficients(&self, position: [usize; 2], count: usize) -> Vec<[f32; BLOCK_LEN]> {
        let across = (self.samples.width - position[0]) / BLOCK;
        let down = (self.samples.height - position[1]) / BLOCK;
        let step = (across * down / count).max(1);
        let corner = |i: usize| [position[0] + i % across * BLOCK, position[1] + i / across * BLOCK];
        let is_unclipped =
            |[x, y]: &[usize; 2]| (0..BLOCK_LEN).all(|i| self.unclipped.at(x + i % BLOCK, y + i / BLOCK));
        let block = |[x, y]: [usize; 2]| {
            dct::forward(&std::array::from_fn(|i| self.samples.at(x + i % BLOCK, y + i / BLOCK) - 128.0))
        };
        (0..across * down).step_by(step).map(corner).filter(is_unclipped).map(block).collect()
    }
}

/// Position of the first whole block of a JPEG's luma. `None` if no grid is found.
fn grid_position(luma: &Luma) -> Option<[usize; 2]> {
    let scales = scales(POSITION_SCALE_RATIO, f64::INFINITY);
    let frequencies: Vec<usize> =
        (0..BLOCK_LEN).filter(|i| POSITION_FREQUENCIES.contains(&(i / BLOCK + i % BLOCK))).collect();
    let score = |position: [usize; 2]| {
        let blocks = luma.coefficients(position, POSITION_BLOCKS);
        let mut sums = vec![vec![None; 256]; BLOCK_LEN];
        let of_scale = |&scale: &f64| {
            let steps = scaled(&LUMINANCE, scale);
            let mut total = CombSum::default();
            for &frequency in &frequencies {
                let step = steps[frequency];
                let slot = &mut sums[frequency][usize::from(step)];
                let values = blocks.iter().map(|block| block[frequency]);
                total.add(*slot.get_or_insert_with(|| CombSum::of(values, step)));
            }
            total.score()
        };
        scales.iter().map(of_scale).fold(0.0, f64::max)
    };
    let mut scored: Vec<(f64, [usize; 2])> =
        (0..BLOCK_LEN).map(|i| [i % BLOCK, i / BLOCK]).map(|position| (score(position), position)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let [(best, position), (second, _), ..] = scored[..] else { return None };
    (best >= MIN_SCORE && best >= MIN_SCORE_RATIO * second).then_some(position)
}

/// A sampling of chroma and a position of its blocks.
#[derive(Clone, Copy, Debug)]
struct ChromaCandidate {
    chroma: Option<ChromaSampling>,
    /// Whether a unit begins a block later than luma's first whole one, across and down.
    is_shifted: [bool; 2],
}

fn candidates(is_grey: bool) -> Vec<ChromaCandidate> {
    if is_grey {
        return vec![ChromaCandidate { chroma: None, is_shifted: [false; 2] }];
    }
    let mut all = Vec::new();
    for factor in [[1, 1], [2, 1], [2, 2], [1, 2]] {
        for is_shifted in [[false, false], [true, false], [false, true], [true, true]] {
            if (0..2).all(|axis| factor[axis] == 2 || !is_shifted[axis]) {
                all.push(ChromaCandidate { chroma: Some(ChromaSampling::centered(factor)), is_shifted });
            }
        }
    }
    all
}

impl ChromaCandidate {
    /// Of the grid of units, for the position of luma's first whole block.
    fn origin(&self, position: [usize; 2]) -> [i32; 2] {
        let factor = self.chroma.map_or([1, 1], |chroma| chroma.factor);
        [0, 1].map(|axis| {
            let unit = BLOCK * factor[axis] as usize;
            let start = position[axis] + if self.is_shifted[axis] { BLOCK } else { 0 };
            start as i32 - if start == 0 { 0 } else { unit as i32 }
        })
    }
}

/// A part of a picture that starts at a multiple of 16 px, so that grids have the same origin in
/// it.
struct TrialPart {
    codes: Vec<u8>,
    size: [usize; 2],
}

impl TrialPart {
    /// The middle of the picture.
    fn new(codes: &[u8], size: [usize; 2]) -> Self {
        let part = size.map(|side| side.min(TRIAL_PX));
        let corner = [0, 1].map(|axis| (size[axis] - part[axis]) / 2 / (2 * BLOCK) * (2 * BLOCK));
        let row = |y: usize| {
            let start = 3 * ((corner[1] + y) * size[0] + corner[0]);
            &codes[start..start + 3 * part[0]]
        };
        Self { codes: (0..part[1]).flat_map(row).copied().collect(), size: part }
    }

    /// Share of codes that return unchanged, without a margin that depends on pixels outside.
    fn equal_share(&self, coding: &PictureCoding) -> f64 {
        let again = coding.recode(&self.codes, self.size);
        let [width, height] = self.size;
        let margin = self.size.map(|side| (2 * BLOCK).min(side / 4));
        let inner_samples = |y: usize| 3 * (y * width + margin[0])..3 * (y * width + width - margin[0]);
        let rows = (margin[1]..height - margin[1]).map(inner_samples);
        let (mut equal, mut count) = (0, 0);
        for row in rows {
            let pairs = again[row.clone()].iter().zip(&self.codes[row]);
            count += pairs.len();
            equal += pairs.filter(|(a, b)| a == b).count();
        }
        equal as f64 / count.max(1) as f64
    }
}

/// Single chroma steps that differ by 1 from the scaled table, if more codes return with them.
fn adjust_chroma(best: &mut EstimatedCoding, trial: &TrialPart) {
    if best.coding.chroma.is_none() {
        return;
    }
    let planes = best.coding.recovered_planes(&trial.codes, trial.size);
    let mut adjusted = best.coding.clone();
    let Some(quantization) = &mut adjusted.quantization else { return };
    let blocks: Vec<[f32; BLOCK_LEN]> = planes[1..].iter().flat_map(unquantized_coefficients).collect();
    let steps = StepLikelihoods::new(&blocks).adjusted(quantization.steps[1], STEP_MARGIN);
    quantization.steps[1] = steps;
    quantization.steps[2] = steps;
    let equal_share = trial.equal_share(&adjusted);
    if equal_share > best.equal_share {
        best.coding = adjusted;
        best.equal_share = equal_share;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::coding::SamplePlane;

    /// Smooth content with noise of a camera's size, R'G'B' codes.
    fn scene(size: [usize; 2]) -> Vec<[f32; 3]> {
        let noise = |seed: usize| {
            let mut x = (seed as u32).wrapping_mul(0x9e37_79b9);
            x = (x ^ x >> 15).wrapping_mul(0x85eb_ca6b);
            x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
            ((x ^ x >> 16) % 31) as f32 - 15.0
        };
        let plane = |offset: usize| {
            SamplePlane::new(size[0], size[1], |x, y| {
                let wave = 50.0 * (x as f32 * 0.09 + offset as f32).sin() * (y as f32 * 0.05).cos();
                128.0 + wave + noise((y * size[0] + x) * 3) * 0.7 + noise((y * size[0] + x) * 3 + 1 + offset) * 0.3
            })
        };
        let [r, g, b] = [plane(0), plane(1), plane(2)];
        (0..size[0] * size[1]).map(|i| [r.samples[i], g.samples[i], b.samples[i]]).collect()
    }

    fn coded(factor: [u32; 2], scale: f64) -> PictureCoding {
        let chroma = scaled(&CHROMINANCE, scale);
        PictureCoding {
            color: YcbcrColor::JFIF,
            chroma: Some(ChromaSampling::centered(factor)),
            quantization: Some(BlockQuantization::at_corner([scaled(&LUMINANCE, scale), chroma, chroma])),
            decoder: Decoder::Libjpeg,
        }
    }

    fn decoded(coding: &PictureCoding, size: [usize; 2]) -> Vec<u8> {
        coding.decode(&coding.quantized(&coding.planes(&scene(size), size)), size)
    }

    fn cropped(codes: &[u8], width: usize, [left, top]: [usize; 2], size: [usize; 2]) -> Vec<u8> {
        let row = |y: usize| codes[3 * ((top + y) * width + left)..][..3 * size[0]].to_vec();
        (0..size[1]).flat_map(row).collect()
    }

    #[test]
    fn sampling_tables_and_grid_of_a_cropped_jpeg_are_found() {
        let size = [208, 176];
        for (factor, corner, origin) in [
            ([2, 2], [0, 0], [0, 0]),
            ([2, 1], [8, 0], [-8, 0]),
            ([2, 2], [13, 6], [-13, -6]),
            ([1, 1], [3, 5], [-3, -5]),
            ([1, 2], [0, 9], [0, -9]),
        ] {
            let coding = coded(factor, 0.3);
            let cut = [0, 1].map(|axis| size[axis] - corner[axis]);
            let codes = cropped(&decoded(&coding, size), size[0], corner, cut);
            let estimated = estimate(&codes, cut).unwrap();
            let quantization = estimated.coding.quantization.unwrap();
            assert_eq!((estimated.coding.chroma, quantization.origin), (coding.chroma, origin));
            assert_eq!(quantization.steps, coding.quantization.unwrap().steps);
            assert!(estimated.equal_share > 0.98, "{factor:?}: {}", estimated.equal_share);
        }
    }

    #[test]
    fn single_step_that_differs_from_the_table_is_found() {
        let size = [208, 176];
        let mut coding = coded([2, 1], 0.3);
        let quantization = coding.quantization.as_mut().unwrap();
        quantization.steps[0][9] += 1;
        let estimated = estimate(&decoded(&coding, size), size).unwrap();
        assert_eq!(estimated.coding.quantization.unwrap().steps[0], coding.quantization.unwrap().steps[0]);
    }

    #[test]
    fn pictures_without_a_grid_are_refused() {
        let size = [208, 176];
        let plain: Vec<u8> = scene(size).iter().flatten().map(|code| code.round() as u8).collect();
        assert_eq!(estimate(&plain, size), None);
        let jpeg = decoded(&coded([2, 2], 0.3), size);
        assert!(estimate(&jpeg, size).is_some());
        // Scaled to 7/8 by linear interpolation.
        let small = size.map(|side| side * 7 / 8);
        let at = |x: usize, y: usize, c: usize| f32::from(jpeg[3 * (y * size[0] + x) + c]);
        let resized: Vec<u8> = (0..3 * small[0] * small[1])
            .map(|i| {
                let (x, y, c) = (i / 3 % small[0] * 8, i / 3 / small[0] * 8, i % 3);
                let (left, top) = (x / 7, y / 7);
                let [u, v] = [x % 7, y % 7].map(|rest| rest as f32 / 7.0);
                let row = |y: usize| at(left, y, c) * (1.0 - u) + at((left + 1).min(size[0] - 1), y, c) * u;
                (row(top) * (1.0 - v) + row((top + 1).min(size[1] - 1)) * v).round() as u8
            })
            .collect();
        assert_eq!(estimate(&resized, small), None);
        assert_eq!(estimate(&jpeg[..300], size), None);
        assert_eq!(estimate(&vec![7; 3 * 64 * 64], [64, 64]), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn arbitrary_pictures_never_panic(width in 0usize..70, height in 0usize..50, seed in any::<u8>()) {
            let codes: Vec<u8> = (0..3 * width * height).map(|i| (i * i % 251) as u8 ^ seed).collect();
            let _ = estimate(&codes, [width, height]);
        }
    }
}
