//! Figures of noise in flat patches, real beside virtual.
//!
//! All are of residuals of [`QuadraticSurface`]s, except the contrast at the edges of blocks.

use std::collections::BTreeMap;

use super::flat_patches::{CodePlanes, QuadraticSurface, luma, patch_of};
use crate::coding::BLOCK;
use crate::example_noise::bands;
use crate::fit::quantile::midpoint_median;
use crate::grey_image::GreyImage;
use crate::measure::detectors::PATCH_PX;

/// Width of a bin of intensity, codes, and fewest patches in it.
const BIN_CODES: f64 = 16.0;
const MIN_BIN_PATCHES: usize = 4;
/// Octaves of spatial frequency: periods of about 2 to 4, 4 to 8, 8 to 16 and from 16 px on.
pub const OCTAVES: usize = 4;
/// Octaves of the bands of Y' ([`bands::split`]): three of its six are of the finest one.
const OCTAVE_OF_BAND: [usize; 6] = [0, 0, 0, 1, 2, 3];
/// Pairs of channels whose correlation is measured.
const CHANNEL_PAIRS: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

/// A figure of the camera's noise and of the virtual one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RealAndVirtual {
    pub real: f64,
    pub virtual_: f64,
}

impl RealAndVirtual {
    /// Virtual over real.
    pub fn ratio(&self) -> f64 {
        self.virtual_ / self.real
    }
}

/// σ in a bin of intensity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SigmaBin {
    /// 0 to 2: R, G, B.
    pub channel: usize,
    /// Middle of the bin, codes.
    pub code: f64,
    /// Codes.
    pub sigma: RealAndVirtual,
}

/// Figures of the noise of all patches.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseFigures {
    /// Bins with enough patches, by channel and intensity.
    pub sigma: Vec<SigmaBin>,
    /// Mean square of Y' in octaves, fine to coarse, codes².
    pub octaves: [RealAndVirtual; OCTAVES],
    /// Correlations R-G, R-B and G-B at the same pixel.
    pub channel_correlation: [RealAndVirtual; 3],
    /// Excess kurtosis of Y'; 0 for normal noise.
    pub kurtosis: RealAndVirtual,
    /// Mean difference of neighbours in Y' across edges of 8×8 blocks, over that elsewhere.
    pub block_contrast: RealAndVirtual,
}

impl NoiseFigures {
    /// The median ratio of σ, virtual over real, and the bin that is farthest from 1.
    pub fn sigma_ratio(&self) -> Option<(f64, SigmaBin)> {
        let far = |bin: &&SigmaBin| bin.sigma.ratio().ln().abs();
        let worst = self.sigma.iter().max_by(|a, b| far(a).total_cmp(&far(b)))?;
        Some((midpoint_median(self.sigma.iter().map(|bin| bin.sigma.ratio()))?, *worst))
    }
}

/// Sums over the patches of one side.
#[derive(Debug, Default)]
struct NoiseSums {
    /// By channel and bin of intensity: mean square, and number of patches.
    sigma: BTreeMap<[usize; 2], (f64, usize)>,
    octaves: [f64; OCTAVES],
    products: [[f64; 3]; 3],
    fourth: f64,
    across_edges: [f64; 2],
    elsewhere: [f64; 2],
    patches: usize,
}

impl NoiseSums {
    fn add(&mut self, patch: &CodePlanes, real_means: [f64; 3]) {
        let residuals: [GreyImage; 3] = std::array::from_fn(|c| QuadraticSurface::fit(&patch[c]).residual(&patch[c]));
        let mean_product = |a: &GreyImage, b: &GreyImage| {
            let products = a.values.iter().zip(&b.values).map(|(a, b)| f64::from(*a) * f64::from(*b));
            products.sum::<f64>() / a.values.len() as f64
        };
        for (a, b) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))) {
            self.products[a][b] += mean_product(&residuals[a], &residuals[b]);
        }
        for (channel, residual) in residuals.iter().enumerate() {
            let bin = (real_means[channel].max(0.0) / BIN_CODES) as usize;
            let (sum, patches) = self.sigma.entry([channel, bin]).or_default();
            (*sum, *patches) = (*sum + mean_product(residual, residual), *patches + 1);
        }
        let residual = luma(&residuals);
        for (band, octave) in bands::split(&residual, 0).iter().zip(OCTAVE_OF_BAND) {
            self.octaves[octave] += mean_product(band, band);
        }
        let square = mean_product(&residual, &residual);
        if square > 0.0 {
            let fourth: f64 = residual.values.iter().map(|value| f64::from(*value).powi(4)).sum();
            self.fourth += fourth / residual.values.len() as f64 / (square * square) - 3.0;
        }
        self.patches += 1;
        self.add_edges(&luma(patch));
    }

    fn add_edges(&mut self, luma: &GreyImage) {
        for i in 0..PATCH_PX * PATCH_PX {
            for (at, apart) in [(i % PATCH_PX, 1), (i / PATCH_PX, PATCH_PX)] {
                if at + 1 < PATCH_PX {
                    let difference = f64::from((luma.values[i + apart] - luma.values[i]).abs());
                    let sum = if (at + 1).is_multiple_of(BLOCK) { &mut self.across_edges } else { &mut self.elsewhere };
                    *sum = [sum[0] + difference, sum[1] + 1.0];
                }
            }
        }
    }

    fn correlation(&self, [a, b]: [usize; 2]) -> f64 {
        let squares = self.products[a][a] * self.products[b][b];
        if squares > 0.0 { self.products[a][b] / squares.sqrt() } else { 0.0 }
    }

    fn block_contrast(&self) -> f64 {
        let mean = |[sum, count]: [f64; 2]| sum / count.max(1.0);
        let elsewhere = mean(self.elsewhere);
        if elsewhere > 0.0 { mean(self.across_edges) / elsewhere } else { 1.0 }
    }
}

/// Collects the patches of both sides.
#[derive(Debug, Default)]
pub struct NoiseMeasurement {
    real: NoiseSums,
    virtual_: NoiseSums,
}

impl NoiseMeasurement {
    /// Adds the patch at a left upper pixel of both pictures, which lies on the grid of blocks.
    pub fn add(&mut self, real: &CodePlanes, virtual_: &CodePlanes, at: [usize; 2]) {
        let [real, virtual_] = [real, virtual_].map(|planes| [0, 1, 2].map(|c: usize| patch_of(&planes[c], at)));
        let means = [0, 1, 2].map(|c: usize| QuadraticSurface::fit(&real[c]).mean());
        self.real.add(&real, means);
        self.virtual_.add(&virtual_, means);
    }

    pub fn figures(&self) -> NoiseFigures {
        let both =
            |of: &dyn Fn(&NoiseSums) -> f64| RealAndVirtual { real: of(&self.real), virtual_: of(&self.virtual_) };
        let mean = |sum: f64, sums: &NoiseSums| sum / sums.patches.max(1) as f64;
        let is_filled =
            |(_, (square, patches)): &(&[usize; 2], &(f64, usize))| *patches >= MIN_BIN_PATCHES && *square > 0.0;
        let bin = |(&[channel, bin], _): (&[usize; 2], &(f64, usize))| {
            let sigma = |sums: &NoiseSums| {
                let (square, patches) = sums.sigma.get(&[channel, bin]).copied().unwrap_or_default();
                (square / patches.max(1) as f64).sqrt()
            };
            SigmaBin { channel, code: BIN_CODES * (bin as f64 + 0.5), sigma: both(&sigma) }
        };
        NoiseFigures {
            sigma: self.real.sigma.iter().filter(is_filled).map(bin).collect(),
            octaves: std::array::from_fn(|octave| both(&|sums| mean(sums.octaves[octave], sums))),
            channel_correlation: CHANNEL_PAIRS.map(|pair| both(&|sums| sums.correlation(pair))),
            kurtosis: both(&|sums| mean(sums.fourth, sums)),
            block_contrast: both(&NoiseSums::block_contrast),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::random::Random;

    /// Patches in a row around a code, of noise that `noise(normal numbers)` makes of four numbers
    /// for each pixel.
    fn planes(code: f32, patches: usize, seed: u64, noise: impl Fn([f64; 4]) -> [f64; 3]) -> CodePlanes {
        let mut random = Random::new([seed, 0, 0, 0]);
        let (width, height) = (patches * PATCH_PX, PATCH_PX);
        let pixels: Vec<[f64; 3]> = (0..width * height)
            .map(|_| {
                let ([a, b], [c, d]) = (random.normals(), random.normals());
                noise([a, b, c, d])
            })
            .collect();
        std::array::from_fn(|c| GreyImage::from_fn(width, height, |x, y| code + pixels[y * width + x][c] as f32))
    }

    fn measured(real: &CodePlanes, virtual_: &CodePlanes) -> NoiseFigures {
        let mut measurement = NoiseMeasurement::default();
        (0..real[0].width / PATCH_PX).for_each(|n| measurement.add(real, virtual_, [n * PATCH_PX, 0]));
        measurement.figures()
    }

    #[test]
    fn sigma_and_correlation_of_known_noise_are_measured() {
        let real = planes(100.0, 16, 1, |[a, b, c, _]| [2.0 * a, 2.0 * b, 2.0 * c]);
        // R and G share 0.6 of their variance.
        let share = |own: f64, common: f64| 3.0 * (0.4f64.sqrt() * own + 0.6f64.sqrt() * common);
        let virtual_ = planes(100.0, 16, 2, |[a, b, c, common]| [share(a, common), share(b, common), 1.0 * c]);
        let figures = measured(&real, &virtual_);
        let ratios: Vec<f64> = figures.sigma.iter().map(|bin| bin.sigma.ratio()).collect();
        assert_eq!(figures.sigma.iter().map(|bin| bin.channel).collect::<Vec<_>>(), [0, 1, 2]);
        assert!(figures.sigma.iter().all(|bin| bin.code == 104.0), "the bin from 96 to 112");
        // Of 16384 pixels a side: one standard error is 0.8 %.
        for (ratio, expected) in ratios.iter().zip([1.5, 1.5, 0.5]) {
            assert!((ratio / expected - 1.0).abs() < 0.03, "{ratios:?}");
        }
        let (median, worst) = figures.sigma_ratio().unwrap();
        assert!((median - 1.5).abs() < 0.03 && worst.channel == 2, "{median} {worst:?}");
        let [red_green, red_blue, _] = figures.channel_correlation;
        assert!(red_green.real.abs() < 0.03 && (red_green.virtual_ - 0.6).abs() < 0.02, "{red_green:?}");
        assert!(red_blue.virtual_.abs() < 0.03, "{red_blue:?}");
        assert!(figures.kurtosis.real.abs() < 0.1 && (figures.block_contrast.real - 1.0).abs() < 0.02);
    }

    #[test]
    fn coarse_noise_is_strong_in_coarse_octaves_alone() {
        let white = planes(100.0, 12, 3, |[a, ..]| [2.0 * a; 3]);
        let coarse: CodePlanes = white.clone().map(|plane| plane.blurred(2.0));
        let octaves = measured(&white, &coarse).octaves.map(|octave| octave.ratio());
        // The blur's power response exp(−(2πfσ)²) at a period of 12 px is 0.33.
        assert!(octaves[0] < 0.01 && octaves[1] < 0.1 && (0.25..0.45).contains(&octaves[2]), "{octaves:?}");
        assert!(octaves.is_sorted(), "{octaves:?}");
    }

    #[test]
    fn steps_between_blocks_and_light_tails_are_measured() {
        let normal = planes(100.0, 8, 4, |[a, ..]| [a; 3]);
        let mut blocks = normal.clone();
        for plane in &mut blocks {
            for (i, value) in plane.values.iter_mut().enumerate() {
                *value += if (i % plane.width / BLOCK).is_multiple_of(2) { 2.0 } else { -2.0 };
            }
        }
        let contrast = measured(&normal, &blocks).block_contrast;
        // Half of the edges have steps of 4 codes in noise of 1: (4 + 1.13) / 2 over 1.13.
        assert!((contrast.real - 1.0).abs() < 0.05 && (contrast.virtual_ - 2.27).abs() < 0.1, "{contrast:?}");
        // Two equally frequent values have the kurtosis 1, 2 less than normal noise.
        let two_valued = planes(100.0, 8, 5, |[a, ..]| [a.signum(); 3]);
        let kurtosis = measured(&normal, &two_valued).kurtosis;
        assert!(kurtosis.real.abs() < 0.2 && (kurtosis.virtual_ + 2.0).abs() < 0.05, "{kurtosis:?}");
    }
}
