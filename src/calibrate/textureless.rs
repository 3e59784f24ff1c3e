//! Noise from frames of a moving camera: where a picture has no texture, the residual from a plane
//! is noise.
//!
//! The picture's content only adds to a block's residual variance, so the lowest blocks of each
//! channel and intensity show the noise. Their variances follow a truncated χ² distribution
//! (derived in docs/calibration.md). Its degrees of freedom, and the share that the plane removed,
//! follow from the noise's own correlation (plane.rs).
//!
//! Blocks as in Liu, Freeman, Szeliski and Kang 2006 (noise level functions from one picture) and
//! in Pyatykh, Hesser and Zheng 2013: whole blocks, judged by variance, not by edges. Two things
//! cannot be separated from noise: texture in every block of an intensity, and a pattern fixed on
//! the sensor.

use statrs::function::gamma::gamma_lr;

use super::bins::{BinReport, chi_square_interval, fill_unmeasured};
use super::censoring::{NEAREST_USABLE, kept_variance};
use super::noise::{
    CHANNELS, CalibrateError, NoiseCalibration, NoiseOptions, SceneMotion, check_bins, reported_correlation, round4,
};
use super::plane::{ByLag, LAGS, NEIGHBOURS, PlaneDetrend, SIDE, WHITE};
use super::rounding::{CODES16_PER_CODE8, Rounding};
use super::warning::Warning;
use crate::camera::{NoiseBin, NoiseProfile};
use crate::pixels::{Codes, Pixels};

/// Blocks with up to this many times the noise's variance are used. That is past the middle of χ²,
/// because the noise of one intensity varies a little with colour. It is not far past it, because
/// higher variances are texture.
const CUT: f64 = 1.2;
/// The search begins at this quantile of a bin's blocks.
const START_QUANTILE: f64 = 0.05;
/// Minimum number of blocks below the cut for an estimate.
const NEEDED_BLOCKS: usize = 40;
/// Blocks below the cut whose spread exceeds that of χ² by this factor are not noise but weak
/// texture. Measured: 1.0 to 1.25 where σ is right, 1.25 to 1.4 where texture was taken for noise.
const MAX_SPREAD_RATIO: f64 = 1.25;
/// Blocks below the cut are not noise either if there are more than this many times as many between
/// the cut and 1.5 times the cut: the density of noise decreases there.
const MAX_UPPER_RATIO: f64 = 1.5;
/// Pictures with this many times the samples that one intensity needs should have enough of them
/// somewhere. If not, they are textured.
const TEXTURED_FACTOR: f64 = 10.0;
/// σ and correlation depend on each other; they settle within three rounds.
const ROUNDS: usize = 4;
/// A block is unusable if more than this share of any channel's pixels is at an end of the code
/// range. Cameras mix channels after clipping, and clipped values carry no noise.
const MAX_CLIPPED_SHARE: f64 = 0.02;
/// Below this variance (8-bit codes squared, times the frames' step squared) a block was clipped
/// within the camera.
const MIN_VARIANCE: f64 = 0.1;
/// Number of randomly chosen blocks for each sixteenth of green's code range.
const CAPACITY: usize = 16_384;
const STRATA: usize = 16;

/// The data kept of a block, in 8-bit code values.
#[derive(Clone, Debug)]
struct SampledBlock {
    mean: [f32; 3],
    /// Mean products of residuals by distance. The first is the variance.
    products: [[f32; LAGS]; 3],
    /// R·G, R·B, G·B.
    cross: [f32; 3],
}

/// A uniform random sample of blocks (Vitter 1985, algorithm R).
#[derive(Debug, Default)]
struct Reservoir {
    /// Number of blocks that were added.
    count: u64,
    /// Sampled blocks, at most [`CAPACITY`].
    blocks: Vec<SampledBlock>,
}

impl Reservoir {
    fn add(&mut self, block: SampledBlock) {
        self.count += 1;
        if self.blocks.len() < CAPACITY {
            return self.blocks.push(block);
        }
        let hashed = self.count.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let place = ((hashed ^ (hashed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 16) % self.count;
        if let Some(old) = self.blocks.get_mut(place as usize) {
            *old = block;
        }
    }
}

/// The pixels that fell into an intensity bin.
#[derive(Clone, Copy, Debug, Default)]
struct PixelCounts {
    pixels: u64,
    clipped: u64,
}

/// A calibration in progress, frame by frame. Memory: 60 MB at most.
#[derive(Debug)]
pub struct TexturelessCalibrator {
    options: NoiseOptions,
    plane: PlaneDetrend,
    frame_bits: Option<u32>,
    frames: usize,
    blocks: u64,
    /// Samples by strata of green's mean.
    strata: [Reservoir; STRATA],
    pixel_counts: [Vec<PixelCounts>; 3],
}

/// Variances at the bins' middles, rounding included, and the other estimates.
#[derive(Clone, Debug)]
struct NoiseEstimate {
    /// Variance and independent samples of each bin of each channel.
    variance: [Vec<f64>; 3],
    independent: [Vec<f64>; 3],
    measured: [Vec<bool>; 3],
    /// The noise's covariance by distance, rounding included, normalised to variance 1.
    covariance: [ByLag; 3],
    channel: [Option<f64>; 3],
    neighbour: [Option<f64>; 2],
    flat: usize,
}

impl TexturelessCalibrator {
    /// Fails unless `bins` is 1 to 256.
    pub fn new(options: NoiseOptions) -> Result<Self, CalibrateError> {
        if options.bins == 0 || options.bins > 256 {
            return Err(CalibrateError::Bins { actual: options.bins });
        }
        let pixel_counts = std::array::from_fn(|_| vec![PixelCounts::default(); options.bins]);
        let plane = PlaneDetrend::new();
        Ok(Self { options, plane, frame_bits: None, frames: 0, blocks: 0, strata: Default::default(), pixel_counts })
    }

    /// Adds a frame. Frames may differ in size. Fails if it is empty or its bit depth differs from
    /// the frames before.
    pub fn add_frame(&mut self, frame: &Pixels) -> Result<(), CalibrateError> {
        if frame.width == 0 || frame.height == 0 {
            return Err(CalibrateError::Empty);
        }
        let bits = if frame.max_code() == 255 { 8 } else { 16 };
        let expected = *self.frame_bits.get_or_insert(bits);
        if bits != expected {
            return Err(CalibrateError::Depth { expected, actual: bits });
        }
        self.frames += 1;
        for y in 0..frame.height as usize / SIDE {
            for x in 0..frame.width as usize / SIDE {
                self.blocks += 1;
                if let Some(block) = self.block(frame, x * SIDE, y * SIDE) {
                    self.strata[bin_of(f64::from(block.mean[1]), STRATA)].add(block);
                }
            }
        }
        Ok(())
    }

    /// A block's sums. `None` if it is clipped or too quiet.
    fn block(&mut self, frame: &Pixels, x0: usize, y0: usize) -> Option<SampledBlock> {
        let pixels = (SIDE * SIDE) as f64;
        let quiet = MIN_VARIANCE * self.rounding().frame_step.powi(2);
        let mut block = SampledBlock { mean: [0.0; 3], products: [[0.0; LAGS]; 3], cross: [0.0; 3] };
        let mut usable = true;
        let mut residuals = [[0.0; SIDE * SIDE]; 3];
        for (channel, values) in residuals.iter_mut().enumerate() {
            for (i, value) in values.iter_mut().enumerate() {
                let place = 3 * ((y0 + i / SIDE) * frame.width as usize + x0 + i % SIDE) + channel;
                *value = match &frame.codes {
                    Codes::U8(codes) => codes.get(place).copied().map_or(0.0, f64::from),
                    Codes::U16(codes) => codes.get(place).copied().map_or(0.0, f64::from) / CODES16_PER_CODE8 as f64,
                };
            }
            let mean = values.iter().sum::<f64>() / pixels;
            let clipped = values.iter().filter(|v| **v <= 0.0 || **v >= 255.0).count();
            let bin = bin_of(mean, self.options.bins);
            let counts = &mut self.pixel_counts[channel][bin];
            *counts = PixelCounts { pixels: counts.pixels + pixels as u64, clipped: counts.clipped + clipped as u64 };
            self.plane.subtract(values);
            let products = PlaneDetrend::products(values);
            block.mean[channel] = mean as f32;
            block.products[channel] = products.map(|p| p as f32);
            usable &= clipped as f64 <= MAX_CLIPPED_SHARE * pixels && products[0] >= quiet;
        }
        for (cross, (a, b)) in block.cross.iter_mut().zip(PAIRS) {
            *cross = (residuals[a].iter().zip(&residuals[b]).map(|(a, b)| a * b).sum::<f64>() / pixels) as f32;
        }
        usable.then_some(block)
    }

    fn rounding(&self) -> Rounding {
        let frame_step = if self.frame_bits == Some(16) { 1.0 / CODES16_PER_CODE8 as f64 } else { 1.0 };
        Rounding { frame_step, mean_step: None }
    }

    fn blocks(&self) -> impl Iterator<Item = &SampledBlock> {
        self.strata.iter().flat_map(|stratum| &stratum.blocks)
    }

    /// The profile and its table.
    pub fn finish(self) -> Result<NoiseCalibration, CalibrateError> {
        if self.frames == 0 {
            return Err(CalibrateError::NoFrames);
        }
        let (rounding, noise) = (self.rounding(), self.estimate());
        let mut warnings = Vec::new();
        let bins = [0, 1, 2].map(|c| self.reports(c, &noise, &rounding));
        for (channel, bins) in CHANNELS.into_iter().zip(&bins) {
            check_bins(channel, bins, self.options.min_independent, &mut warnings)
                .map_err(|error| self.cause(error))?;
        }
        warnings.push(Warning::Texture);
        let mut reported = |value, name, low| reported_correlation(value, name, low, &mut warnings);
        let [rg, rb, gb] = noise.channel;
        let channel_correlation = [reported(rg, "R-G", -1.0), reported(rb, "R-B", -1.0), reported(gb, "G-B", -1.0)];
        let [right, below] = noise.neighbour;
        let neighbour_correlation = [reported(right, "to the right", 0.0), reported(below, "below", 0.0)];
        let profile = NoiseProfile {
            example: None,
            bins: [0, 1, 2]
                .map(|c| bins[c].iter().map(|b| NoiseBin { code: b.code, sigma: round4(b.sigma) }).collect::<Vec<_>>()),
            channel_correlation,
            neighbour_correlation,
        };
        // The discarded blocks are assumed to be like the kept ones.
        let kept = self.blocks().count().max(1) as f64;
        let all = self.strata.iter().map(|stratum| stratum.count).sum::<u64>() as f64;
        let excluded_share = 1.0 - noise.flat as f64 / kept * all / self.blocks.max(1) as f64;
        let (scenes, frames, motion) = (1, self.frames, SceneMotion::Moving);
        Ok(NoiseCalibration { profile, bins, motion, scenes, frames, excluded_share, warnings })
    }

    /// If there were pixels enough, texture is why too few samples remain.
    fn cause(&self, error: CalibrateError) -> CalibrateError {
        match error {
            CalibrateError::TooFew { channel, needed, best }
                if self.blocks as f64 * (SIDE * SIDE) as f64 > TEXTURED_FACTOR * needed =>
            {
                CalibrateError::Textured { channel, needed, best, frames: self.frames }
            }
            other => other,
        }
    }

    fn reports(&self, channel: usize, estimate: &NoiseEstimate, rounding: &Rounding) -> Vec<BinReport> {
        let mut reports: Vec<BinReport> = (0..self.options.bins)
            .map(|bin| {
                let (variance, independent) = (estimate.variance[channel][bin], estimate.independent[channel][bin]);
                let PixelCounts { pixels, clipped } = self.pixel_counts[channel][bin];
                let code_range = range_of(bin, self.options.bins);
                BinReport {
                    code_range,
                    code: 0.5 * (code_range[0] + code_range[1]),
                    count: pixels,
                    clipped_share: clipped as f64 / pixels.max(1) as f64,
                    independent_count: independent,
                    mu: 0.0,
                    sigma: rounding.sigma(variance),
                    sigma_ci95: chi_square_interval(independent)
                        .map(|ci| ci.map(|factor| rounding.sigma(variance * factor))),
                    filled_from_neighbours: !estimate.measured[channel][bin],
                }
            })
            .collect();
        fill_unmeasured(&mut reports);
        reports
    }

    fn estimate(&self) -> NoiseEstimate {
        let bins = self.options.bins;
        let mut noise_estimate = NoiseEstimate {
            variance: std::array::from_fn(|_| vec![1.0; bins]),
            independent: std::array::from_fn(|_| vec![0.0; bins]),
            measured: std::array::from_fn(|_| vec![false; bins]),
            covariance: [WHITE; 3],
            channel: [None; 3],
            neighbour: [None; 2],
            flat: 0,
        };
        for round in 0..ROUNDS {
            // Before the correlation is known, noise seems to spread too much.
            let strict = round >= ROUNDS / 2;
            let freedom = noise_estimate.covariance.map(|r| self.plane.freedom(&r));
            let remaining_share = noise_estimate.covariance.map(|r| self.plane.remaining_variance_share(&r));
            for channel in 0..3 {
                self.variances(&mut noise_estimate, channel, (freedom[channel], remaining_share[channel]), strict);
            }
            self.correlations(&mut noise_estimate, freedom, remaining_share);
        }
        noise_estimate
    }

    /// Moves one channel's variances towards those of its lowest blocks.
    fn variances(&self, estimate: &mut NoiseEstimate, channel: usize, (freedom, kept): (f64, f64), strict: bool) {
        let bins = self.options.bins;
        let mut ratios: Vec<Vec<f64>> = vec![Vec::new(); bins];
        for block in self.blocks() {
            let ratio = ratio(block, channel, &estimate.variance[channel]);
            ratios[bin_of(f64::from(block.mean[channel]), bins)].extend(ratio.map(|r| r / kept));
        }
        let lowest: Vec<Option<(f64, f64)>> = ratios
            .iter_mut()
            .map(|r| fit_lower_tail(r, freedom).filter(|l| l.like_noise || !strict).map(|l| (l.scale, l.blocks)))
            .collect();
        for (bin, lowest) in lowest.iter().enumerate() {
            let (factor, blocks) = lowest.unwrap_or((1.0, 0.0));
            estimate.variance[channel][bin] *= factor;
            estimate.independent[channel][bin] = blocks * freedom;
            estimate.measured[channel][bin] = lowest.is_some() && blocks * freedom >= self.options.min_independent;
        }
        // The other bins are interpolated: blocks near a bin's edge need both sides.
        let good: Vec<(f64, f64)> = (0..bins)
            .filter(|bin| estimate.measured[channel][*bin])
            .map(|bin| (bin as f64, estimate.variance[channel][bin]))
            .collect();
        for bin in 0..bins {
            if let Some(variance) = interpolate(&good, bin as f64).filter(|_| !estimate.measured[channel][bin]) {
                estimate.variance[channel][bin] = variance;
            }
        }
    }

    /// The noise's correlations, from blocks that are flat in every channel.
    fn correlations(&self, estimate: &mut NoiseEstimate, freedom: [f64; 3], kept: [f64; 3]) {
        let (bins, rounding) = (self.options.bins, self.rounding());
        let rounded: [Vec<f64>; 3] =
            [0, 1, 2].map(|c| estimate.variance[c].iter().map(|v| 1.0 - rounding.sigma(*v).powi(2) / v).collect());
        let max_ratio = freedom.map(|nu| 1.0 + (2.0 / nu).sqrt());
        let (mut products, mut cross, mut shares) = ([[0.0; LAGS]; 3], [0.0; 3], [0.0; 3]);
        let mut flat = 0usize;
        for block in self.blocks() {
            let ratios =
                [0, 1, 2].map(|c| ratio(block, c, &estimate.variance[c]).filter(|r| *r <= max_ratio[c] * kept[c]));
            let [Some(r), Some(g), Some(b)] = ratios else { continue };
            flat += 1;
            let scale: [f64; 3] = std::array::from_fn(|c| [r, g, b][c] / f64::from(block.products[c][0]));
            for c in 0..3 {
                for (sum, product) in products[c].iter_mut().zip(block.products[c]) {
                    *sum += f64::from(product) * scale[c];
                }
                shares[c] += rounded[c][bin_of(f64::from(block.mean[c]), bins)];
            }
            for (sum, (cross, (a, b))) in cross.iter_mut().zip(block.cross.iter().zip(PAIRS)) {
                *sum += f64::from(*cross) * (scale[a] * scale[b]).sqrt();
            }
        }
        estimate.flat = flat;
        if flat == 0 {
            return;
        }
        let n = flat as f64;
        let covariance = products.map(|sums| self.plane.covariance(&sums.map(|s| s / n)));
        if covariance.iter().any(|r| r[0] <= 0.0) {
            return;
        }
        estimate.covariance = covariance.map(|r| r.map(|v| (v / r[0]).clamp(-1.0, 1.0)));
        // Rounding is independent from pixel to pixel.
        let own: [f64; 3] = std::array::from_fn(|c| covariance[c][0] - shares[c] / n);
        if own.iter().any(|v| *v <= 0.0) {
            return;
        }
        estimate.neighbour = NEIGHBOURS.map(|k| {
            let covariance: f64 = covariance.iter().map(|r| r[k]).sum();
            Some(covariance / own.iter().sum::<f64>())
        });
        estimate.channel = std::array::from_fn(|i| {
            let (a, b) = PAIRS[i];
            Some(cross[i] / n / (kept[a] * kept[b] * own[a] * own[b]).sqrt())
        });
    }
}

const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

fn bin_of(code: f64, bins: usize) -> usize {
    ((code * bins as f64 / 256.0) as usize).min(bins - 1)
}

fn range_of(bin: usize, bins: usize) -> [f64; 2] {
    [bin, bin + 1].map(|edge| (edge as f64 * 256.0 / bins as f64).min(255.0))
}

/// Linear between points, constant beyond.
fn interpolate(points: &[(f64, f64)], at: f64) -> Option<f64> {
    let after = points.partition_point(|p| p.0 <= at);
    match (points.get(after.wrapping_sub(1)), points.get(after)) {
        (Some(a), Some(b)) => Some(a.1 + (b.1 - a.1) * (at - a.0) / (b.0 - a.0)),
        (Some(a), None) | (None, Some(a)) => Some(a.1),
        (None, None) => None,
    }
}

/// A block's variance relative to the one expected at its intensity, clipping included. `variance`
/// is at the bins' middles. `None` too near to an end.
fn ratio(block: &SampledBlock, channel: usize, variance: &[f64]) -> Option<f64> {
    let code = f64::from(block.mean[channel]);
    let bins = variance.len();
    let at = (code * bins as f64 / 256.0 - 0.5).clamp(0.0, bins as f64 - 1.0);
    let (low, high) = (at as usize, (at as usize + 1).min(bins - 1));
    let expected = variance[low] + (variance[high] - variance[low]) * at.fract();
    let from_end = code.min(255.0 - code) / expected.sqrt();
    (from_end >= NEAREST_USABLE)
        .then(|| f64::from(block.products[channel][0]) / (expected * kept_variance(from_end, 0.0)))
}

/// Estimate from the lowest of a bin's blocks.
#[derive(Clone, Copy, Debug)]
struct LowerTail {
    scale: f64,
    /// The estimated number of blocks that contain only noise, including those above the cut.
    blocks: f64,
    /// True if the blocks spread as noise does; otherwise they are weak texture.
    like_noise: bool,
}

/// Estimates the variance of noise from the lowest of these values.
///
/// For x like χ² with ν degrees over ν, times s, those below a cut T have the mean s·F_(ν+2)(νT/s)
/// / F_ν(νT/s) and the mean square s²·(1+2/ν)·F_(ν+4)(νT/s) / F_ν(νT/s). At T = CUT·s these are
/// fixed factors. The solution is the lowest s at which the first holds, because texture only adds.
fn fit_lower_tail(values: &mut [f64], freedom: f64) -> Option<LowerTail> {
    values.sort_by(f64::total_cmp);
    let below = |degrees: f64| gamma_lr(0.5 * degrees, 0.5 * freedom * CUT);
    let (share, mean) = (below(freedom), below(freedom + 2.0) / below(freedom));
    let square = (1.0 + 2.0 / freedom) * below(freedom + 4.0) / share;
    let sums: Vec<f64> = values
        .iter()
        .scan(0.0, |sum, v| {
            *sum += v;
            Some(*sum)
        })
        .collect();
    let mut scale = *values.get((START_QUANTILE * values.len() as f64) as usize)?;
    let mut count = 0;
    for _ in 0..200 {
        count = values.partition_point(|v| *v <= CUT * scale);
        let next = sums.get(count.checked_sub(1)?)? / count as f64 / mean;
        let done = (next - scale).abs() < 1e-7 * scale;
        scale = next;
        if done {
            break;
        }
    }
    if count < NEEDED_BLOCKS || scale <= 0.0 {
        return None;
    }
    let n = count as f64;
    let spread = values.iter().take(count).map(|v| (v / scale - mean).powi(2)).sum::<f64>() / n;
    let next = (values.partition_point(|v| *v <= 1.5 * CUT * scale) - count) as f64;
    let like_noise =
        spread <= MAX_SPREAD_RATIO * MAX_SPREAD_RATIO * (square - mean * mean) && next <= MAX_UPPER_RATIO * n;
    Some(LowerTail { scale, blocks: n / share, like_noise })
}

/// Calibrates from frames in memory. Errors as for [`TexturelessCalibrator::add_frame`]
/// and [`TexturelessCalibrator::finish`].
pub fn from_frames(frames: &[Pixels], options: &NoiseOptions) -> Result<NoiseCalibration, CalibrateError> {
    let mut calibrator = TexturelessCalibrator::new(options.clone())?;
    frames.iter().try_for_each(|frame| calibrator.add_frame(frame))?;
    calibrator.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::{ChiSquared, ContinuousCDF};

    /// χ² at evenly spaced quantiles for a third of the values. The rest is texture, twice to
    /// ninety times as strong.
    #[test]
    fn lower_tail_is_estimated_among_texture() {
        let chi = ChiSquared::new(40.0).unwrap();
        let mut values: Vec<f64> =
            (0..1000).map(|i| 3.0 * chi.inverse_cdf((f64::from(i) + 0.5) / 1000.0) / 40.0).collect();
        let alone = fit_lower_tail(&mut values.clone(), 40.0).unwrap();
        assert!((alone.scale / 3.0 - 1.0).abs() < 0.01 && (alone.blocks / 1000.0 - 1.0).abs() < 0.02, "{alone:?}");
        values.extend((0..2000).map(|i| 6.0 * (1.0 + 0.0002 * f64::from(i * i))));
        let among = fit_lower_tail(&mut values, 40.0).unwrap();
        assert!((among.scale / 3.0 - 1.0).abs() < 0.02 && (among.blocks / 1000.0 - 1.0).abs() < 0.04, "{among:?}");
        assert!(alone.like_noise && among.like_noise);
        assert!(fit_lower_tail(&mut [], 40.0).is_none() && fit_lower_tail(&mut [0.0; 50], 40.0).is_none());
        assert!(fit_lower_tail(&mut [1.0; 39], 40.0).is_none());
        // Texture alone: nothing below 1, then ever more.
        let mut texture: Vec<f64> = (0..2000).map(|i| 1.0 + 0.2 * f64::from(i).sqrt()).collect();
        assert!(!fit_lower_tail(&mut texture, 40.0).unwrap().like_noise);
        let mut from_nothing: Vec<f64> = (0..2000).map(|i| f64::from(i).sqrt()).collect();
        assert!(fit_lower_tail(&mut from_nothing, 40.0).is_none());
    }
}
