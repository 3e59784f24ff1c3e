//! Statistics of 8×8 discrete cosine transforms: traces of block coding.
//!
//! The patch lies on the grid of blocks. Per patch: of Y', the logarithm of the mean magnitude of
//! each of the 63 AC coefficients over its 16 blocks; of Cb and Cr, the same by diagonals u + v; of
//! all planes, the share of coefficients that vanish, by diagonals; blockiness, the mean difference
//! of neighbours across block edges over that elsewhere, along rows and columns (after Fan and de
//! Queiroz 2003); the same between even and odd pixels of Cb and Cr, in which subsampled chroma
//! shows. With quantised coefficients, how well those of a patch lie on the comb of the quantiser
//! ([`CombFit`]).

use super::patches::{BLOCK_PX, PATCH_PX, Planes};
use crate::coding::dct;
use crate::grey_image::GreyImage;
use std::f64::consts::TAU;

const COEFFICIENTS: usize = BLOCK_PX * BLOCK_PX;
/// Diagonals of AC coefficients: u + v from 1 to 14.
const DIAGONALS: usize = 2 * (BLOCK_PX - 1);
/// A coefficient below this vanishes, codes: half of the finest quantiser's step.
const VANISHING: f64 = 0.5;
/// Keeps logarithms of magnitudes and ratios finite, codes.
const MIN_MAGNITUDE: f64 = 0.05;
/// Coefficients whose quantiser is sought: those with u + v up to this.
const COMB_DIAGONALS: usize = 4;
/// Steps of quantisers that are sought, codes.
const COMB_STEPS: std::ops::RangeInclusive<usize> = 2..=40;
/// Probability of any comb being found in coefficients that were never quantised.
const COMB_FALSE_ALARM: f64 = 0.01;
/// Fewest coefficients outside the zero bin by which a comb is sought.
const MIN_COMB_COEFFICIENTS: usize = 50;

/// The coefficients of a block, row-major: 8 v + u.
type DctBlock = [f64; COEFFICIENTS];

/// The blocks of Y', Cb and Cr of a patch.
pub(super) type PatchBlocks = [Vec<DctBlock>; 3];

/// Transforms the blocks of a patch.
pub(super) fn transform(ycbcr: &Planes) -> PatchBlocks {
    [0, 1, 2].map(|plane: usize| {
        let per_row = PATCH_PX / BLOCK_PX;
        (0..per_row * per_row)
            .map(|n| block_dct(&ycbcr[plane], [BLOCK_PX * (n % per_row), BLOCK_PX * (n / per_row)]))
            .collect()
    })
}

fn block_dct(plane: &GreyImage, [x0, y0]: [usize; 2]) -> DctBlock {
    let value = |i: usize| plane.values[(y0 + i / BLOCK_PX) * plane.width + x0 + i % BLOCK_PX];
    dct::forward(&std::array::from_fn(value)).map(f64::from)
}

/// u + v of a coefficient.
fn diagonal(coefficient: usize) -> usize {
    coefficient % BLOCK_PX + coefficient / BLOCK_PX
}

/// The features of a patch.
pub(super) fn features(ycbcr: &Planes, blocks: &PatchBlocks, combs: &CombFit) -> Vec<f64> {
    let mut features = Vec::new();
    for (channel, blocks) in blocks.iter().enumerate() {
        let mut magnitudes = [0.0; COEFFICIENTS];
        let mut vanishing = [0.0; COEFFICIENTS];
        for block in blocks {
            for (i, coefficient) in block.iter().enumerate() {
                magnitudes[i] += coefficient.abs() / blocks.len() as f64;
                vanishing[i] += f64::from(u8::from(coefficient.abs() < VANISHING)) / blocks.len() as f64;
            }
        }
        if channel == 0 {
            features.extend(magnitudes[1..].iter().map(|m| (m + MIN_MAGNITUDE).ln()));
        } else {
            features.extend(by_diagonal(&magnitudes).map(|m| (m + MIN_MAGNITUDE).ln()));
        }
        features.extend(by_diagonal(&vanishing));
    }
    for (channel, plane) in ycbcr.iter().enumerate() {
        for strides in [[1, PATCH_PX], [PATCH_PX, 1]] {
            features.push(edge_contrast(plane, strides, BLOCK_PX));
            if channel > 0 {
                features.push(edge_contrast(plane, strides, 2));
            }
        }
    }
    features.extend(combs.agreement(&blocks[0]));
    features
}

/// Means over the coefficients of each diagonal but the DC's.
fn by_diagonal(values: &DctBlock) -> [f64; DIAGONALS] {
    let (mut sums, mut counts) = ([0.0; DIAGONALS], [0.0; DIAGONALS]);
    for (i, value) in values.iter().enumerate().skip(1) {
        sums[diagonal(i) - 1] += value;
        counts[diagonal(i) - 1] += 1.0;
    }
    std::array::from_fn(|i| sums[i] / counts[i])
}

/// Logarithm of the ratio of neighbours' mean absolute differences: across multiples of `period`
/// over elsewhere. `strides` along a line and across lines.
fn edge_contrast(plane: &GreyImage, [along, across]: [usize; 2], period: usize) -> f64 {
    let (mut edge, mut inside) = (Mean::default(), Mean::default());
    for line in 0..PATCH_PX {
        let at = |i: usize| f64::from(plane.values[line * across + i * along]);
        for i in 1..PATCH_PX {
            let mean = if i % period == 0 { &mut edge } else { &mut inside };
            mean.add((at(i) - at(i - 1)).abs());
        }
    }
    ((edge.value() + MIN_MAGNITUDE) / (inside.value() + MIN_MAGNITUDE)).ln()
}

#[derive(Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1.0;
    }

    fn value(&self) -> f64 {
        if self.count > 0.0 { self.sum / self.count } else { 0.0 }
    }
}

/// Steps of the quantiser of low luma coefficients, from the combs of their histograms.
///
/// Coefficients c that were rounded to multiples of q have a mean of cos(2πc/q) near 1 (the
/// characteristic function at the comb's frequency; Fan and de Queiroz 2003 use the histograms'
/// likelihood). Those with |c| < q/2 are left out, because the peak at 0 of any histogram would
/// count as a tooth. For a smooth, falling density the mean of the others is below 0. It is
/// significant if it exceeds √(2 ln(M/α)/n): by Hoeffding 1963, theorem 2, n cosines of random
/// phase exceed it in any of M pairs of coefficient and step with a probability of at most α.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CombFit {
    /// Coefficient (8 v + u) and its step, codes.
    pub steps: Vec<(usize, usize)>,
}

impl CombFit {
    /// Seeks combs in the blocks of a plane.
    pub(super) fn new<'a>(blocks: impl Iterator<Item = &'a DctBlock> + Clone) -> Self {
        let coefficients: Vec<usize> = (1..COEFFICIENTS).filter(|i| diagonal(*i) <= COMB_DIAGONALS).collect();
        let hypotheses = (coefficients.len() * COMB_STEPS.count()) as f64;
        let mut steps = Vec::new();
        for i in coefficients {
            let mut best: Option<(f64, usize)> = None;
            for step in COMB_STEPS {
                let (cosine, count) = comb_cosine(blocks.clone().map(|block| block[i]), step);
                let bound = (2.0 * (hypotheses / COMB_FALSE_ALARM).ln() / count).sqrt();
                let is_significant = count >= MIN_COMB_COEFFICIENTS as f64 && cosine > bound;
                if is_significant && best.is_none_or(|(largest, _)| cosine > largest) {
                    best = Some((cosine, step));
                }
            }
            steps.extend(best.map(|(_, step)| (i, step)));
        }
        Self { steps }
    }

    /// Mean of cos(2πc/q) over all coefficients of a patch with a comb, and their number relative
    /// to all. Both are 0 without combs.
    fn agreement(&self, blocks: &[DctBlock]) -> [f64; 2] {
        let (mut cosines, mut count, mut all) = (0.0, 0.0, 0.0);
        for &(i, step) in &self.steps {
            let (cosine, outside) = comb_cosine(blocks.iter().map(|block| block[i]), step);
            cosines += cosine * outside;
            count += outside;
            all += blocks.len() as f64;
        }
        if count > 0.0 { [cosines / count, count / all] } else { [0.0; 2] }
    }
}

/// Mean of cos(2πc/q) over coefficients outside the zero bin, and their number.
fn comb_cosine(coefficients: impl Iterator<Item = f64>, step: usize) -> (f64, f64) {
    let mut mean = Mean::default();
    let step = step as f64;
    for c in coefficients.filter(|c| c.abs() >= 0.5 * step) {
        mean.add((TAU * c / step).cos());
    }
    (mean.value(), mean.count)
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::Normals;
    use super::*;
    use std::f64::consts::PI;

    fn plane(value: impl Fn(usize, usize) -> f32) -> GreyImage {
        GreyImage::from_fn(PATCH_PX, PATCH_PX, value)
    }

    #[test]
    fn dct_of_a_basis_function_is_one_coefficient() {
        let basis = |u: usize, x: usize| 0.5 * (PI * (2 * (x % 8) + 1) as f64 * u as f64 / 16.0).cos();
        let wave = plane(|x, y| (40.0 * basis(3, x) * basis(5, y)) as f32);
        for block in &transform(&[wave.clone(), wave.clone(), wave])[0] {
            for (i, c) in block.iter().enumerate() {
                let expected = if i == 8 * 5 + 3 { 40.0 } else { 0.0 };
                assert!((c - expected).abs() < 1e-4, "{i}: {c}");
            }
        }
    }

    #[test]
    fn dct_of_a_constant_block_is_8_times_its_value() {
        let flat = plane(|_, _| 10.0);
        assert!((transform(&[flat.clone(), flat.clone(), flat])[2][15][0] - 80.0).abs() < 1e-9);
    }

    #[test]
    fn edge_contrast_of_steps_at_block_edges_matches_hand_calculation() {
        // Steps of 4 at block edges, of 1 elsewhere, along rows; constant along columns.
        let steps = plane(|x, _| (x + 3 * (x / 8)) as f32);
        assert!((edge_contrast(&steps, [1, PATCH_PX], 8) - (4.05_f64 / 1.05).ln()).abs() < 1e-9);
        assert_eq!(edge_contrast(&steps, [PATCH_PX, 1], 8), 0.0);
    }

    #[test]
    fn comb_of_quantised_coefficients_is_found_and_of_others_is_not() {
        let mut normals = Normals::new(3);
        let mut blocks = |step: f64| -> Vec<DctBlock> {
            let rounded = |c: f64| if step > 0.0 { step * (c / step).round() } else { c };
            (0..1200).map(|_| std::array::from_fn(|_| rounded(14.0 * normals.next()) + 0.3 * normals.next())).collect()
        };
        let fit = CombFit::new(blocks(7.0).iter());
        assert_eq!(fit.steps.len(), 14, "{fit:?}");
        assert!(fit.steps.iter().all(|(i, step)| *step == 7 && diagonal(*i) <= 4), "{fit:?}");
        assert_eq!(CombFit::new(blocks(0.0).iter()), CombFit::default());
        let (quantised, other) = (blocks(7.0), blocks(0.0));
        assert!(fit.agreement(&quantised)[0] > 0.9 && fit.agreement(&other)[0].abs() < 0.1);
        assert_eq!(CombFit::default().agreement(&other), [0.0; 2]);
    }

    #[test]
    fn peak_at_zero_is_not_a_comb() {
        let mut normals = Normals::new(4);
        let blocks: Vec<DctBlock> = (0..1200).map(|_| std::array::from_fn(|_| 1.5 * normals.next())).collect();
        assert_eq!(CombFit::new(blocks.iter()), CombFit::default());
    }
}
