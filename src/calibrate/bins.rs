//! From sums per code to σ per bin, and correlations from the blocks that stood still.

use super::censoring::{NEAREST_USABLE, clipped_variance};
use super::rounding::{CODES16_PER_CODE8, Rounding};
use super::scene_sums::{PixelSums, SceneSums};

/// Variances are kept for every quarter of an 8-bit code, so that clipping can be recognised by the
/// mean.
const LEVELS_PER_CODE: f64 = 4.0;
const LEVELS: usize = 255 * 4 + 1;
/// Means within this many levels of an end are not used. Where σ is below a code, the quiet middle
/// of the last code would otherwise be separated from its noisy edge.
const EXCLUDED_END_LEVELS: usize = 4;
/// Normal quantile of a two-sided 95 % interval.
const Z95: f64 = 1.959_964;
/// A level with this many degrees of freedom gives its variance well enough to start from.
const MIN_START_FREEDOM: f64 = 100.0;
/// Blocks with a smaller variance (8-bit codes squared, times the frames' step squared) are not
/// used for correlations.
const MIN_VARIANCE: f64 = 0.1;

/// Measurements of one intensity bin of one channel. Code values are on the 8-bit scale.
#[derive(Clone, Debug, PartialEq)]
pub struct BinReport {
    /// Half-open range of the means in this bin.
    pub code_range: [f64; 2],
    /// The bin's middle.
    pub code: f64,
    /// Samples: pixels times frames.
    pub count: u64,
    /// Share of the samples in pixels that touched an end of the code range, 0 to 1.
    pub clipped_share: f64,
    /// Independent samples among the usable ones: degrees of freedom, reduced for correlated
    /// neighbours.
    pub independent_count: f64,
    /// Mean variation; 0 by construction unless the mean was given.
    pub mu: f64,
    /// Standard deviation of the noise at the bin's middle.
    pub sigma: f64,
    /// 95 % confidence interval of `sigma` (χ²). `None` if it was not measured.
    pub sigma_ci95: Option<[f64; 2]>,
    /// Too few samples: `sigma` is interpolated from the nearest good bins.
    pub filled_from_neighbours: bool,
}

/// All pixels whose mean rounds to one quarter of a code.
#[derive(Clone, Copy, Debug, Default)]
struct CodeLevel {
    /// Pixels times frames: all of them, and those in pixels that touched an end of the code range.
    pixels: u64,
    touched: u64,
    /// Usable pixels times frames. This and the following fields count only usable ones.
    samples: f64,
    freedom: f64,
    /// Σ freedom · (1/J): how noisy the means are.
    mean_noise: f64,
    /// Σ freedom · mean.
    codes: f64,
    squares: f64,
    sum: f64,
}

impl CodeLevel {
    fn code(&self) -> f64 {
        self.codes / self.freedom
    }
}

/// Sums over the pixels of one scene that stood still. Their size does not depend on the number of
/// frames.
#[derive(Clone, Debug)]
pub(crate) struct Pool {
    levels: [Vec<CodeLevel>; 3],
    channel: [CorrelationSums; 3],
    neighbour: [CorrelationSums; 2],
}

/// How a bin is measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BinRules {
    pub bins: usize,
    pub rounding: Rounding,
    /// Bins with fewer independent samples are filled from their neighbours.
    pub needed: f64,
    /// The weight of a sample among correlated neighbours, 0 to 1.
    pub independent_share: f64,
}

/// A correlation being summed: covariance, and the two variances.
#[derive(Clone, Copy, Debug, Default)]
struct CorrelationSums {
    covariance: f64,
    a: f64,
    b: f64,
}

impl CorrelationSums {
    fn add(&mut self, weight: f64, covariance: f64, a: f64, b: f64) {
        self.covariance += weight * covariance;
        self.a += weight * a;
        self.b += weight * b;
    }
    fn total(parts: impl Iterator<Item = Self>) -> Option<f64> {
        let mut all = Self::default();
        parts.for_each(|p| all.add(1.0, p.covariance, p.a, p.b));
        let product = all.a * all.b;
        (product > 0.0).then(|| (all.covariance / product.sqrt()).clamp(-1.0, 1.0))
    }
}

impl Default for Pool {
    fn default() -> Self {
        Self {
            levels: std::array::from_fn(|_| vec![CodeLevel::default(); LEVELS]),
            channel: Default::default(),
            neighbour: Default::default(),
        }
    }
}

impl Pool {
    /// Sums the blocks of a scene that stood still. `scales`: the approximate noise variance of
    /// each block.
    pub fn new(scene: &SceneSums, still: &[bool], scales: &[[f64; 3]], rounding: &Rounding) -> Self {
        let mut pool = Self::default();
        for (block, (_, scale)) in still.iter().zip(scales).enumerate().filter(|(_, (still, _))| **still) {
            for channel in 0..3 {
                for i in scene.places(scene.area(block), channel) {
                    pool.add_pixel(channel, scene.pixel(i), scene);
                }
            }
            pool.add_block(scene, block, scale, rounding);
        }
        pool
    }

    fn add_pixel(&mut self, channel: usize, pixel: PixelSums, scene: &SceneSums) {
        let place = ((pixel.mean * LEVELS_PER_CODE).round() as usize).min(LEVELS - 1);
        let level = &mut self.levels[channel][place];
        level.pixels += u64::from(scene.frames);
        level.touched += u64::from(pixel.touched) * u64::from(scene.frames);
        if place.min(LEVELS - 1 - place) < EXCLUDED_END_LEVELS {
            return;
        }
        let freedom = scene.freedom();
        level.samples += f64::from(scene.frames);
        level.freedom += freedom;
        level.mean_noise += freedom * scene.mean_noise();
        level.codes += freedom * pixel.mean;
        level.squares += pixel.squares;
        level.sum += pixel.sum;
    }

    fn add_block(&mut self, scene: &SceneSums, block: usize, scale: &[f64; 3], rounding: &Rounding) {
        let area = scene.area(block);
        let (count, times) = scene.differences();
        let unit = (CODES16_PER_CODE8 * CODES16_PER_CODE8) as f64 * times * count;
        let (n, right, below) = (area.pixels() as f64, area.pairs_right() as f64, area.pairs_below() as f64);
        let sums = &scene.blocks[block];
        let offset = scene.offset();
        let measured = [0, 1, 2].map(|c| sums.squares[c] as f64 / (unit * n) - offset[c] * offset[c]);
        let clipped = (0..3).any(|c| scene.places(area, c).any(|i| scene.pixel(i).touched));
        let quiet = MIN_VARIANCE * rounding.frame_step * rounding.frame_step;
        if clipped || measured.iter().any(|&v| v < quiet) {
            return;
        }
        let variance = measured.map(|v| rounding.sigma(v).powi(2));
        for (place, (a, b)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
            let covariance = sums.cross[place] as f64 / (unit * n) - offset[a] * offset[b];
            let shared = covariance / (scale[a] * scale[b]).sqrt();
            self.channel[place].add(n, shared, variance[a] / scale[a], variance[b] / scale[b]);
        }
        for c in 0..3 {
            for (direction, (sum, pairs)) in [(sums.right[c], right), (sums.below[c], below)].into_iter().enumerate() {
                if pairs > 0.0 {
                    let covariance = (sum as f64 / (unit * pairs) - offset[c] * offset[c]) / scale[c];
                    let own = variance[c] / scale[c];
                    self.neighbour[direction].add(pairs, covariance, own, own);
                }
            }
        }
    }

    /// Correlation of R-G, R-B, G-B over all scenes. `None` if nothing determined it.
    pub fn channel_correlation(pools: &[Self]) -> [Option<f64>; 3] {
        [0, 1, 2].map(|i| CorrelationSums::total(pools.iter().map(|p| p.channel[i])))
    }

    /// Correlation with the neighbours to the right and below over all scenes. `None` if nothing
    /// determined it.
    pub fn neighbour_correlation(pools: &[Self]) -> [Option<f64>; 2] {
        [0, 1].map(|i| CorrelationSums::total(pools.iter().map(|p| p.neighbour[i])))
    }

    /// σ of each bin of a channel, over all scenes.
    pub fn bins(pools: &[Self], channel: usize, rules: &BinRules) -> Vec<BinReport> {
        let mut bins: Vec<BinFit> = (0..rules.bins)
            .map(|bin| {
                let first = (bin * 256 * LEVELS_PER_CODE as usize).div_ceil(rules.bins).min(LEVELS);
                let last = ((bin + 1) * 256 * LEVELS_PER_CODE as usize).div_ceil(rules.bins).min(LEVELS);
                let levels: Vec<&[CodeLevel]> = pools.iter().map(|p| &p.levels[channel][first..last]).collect();
                BinFit::new(bin, &levels, rules)
            })
            .collect();
        shift_to_bin_centres(&mut bins, &rules.rounding);
        let mut reports: Vec<BinReport> = bins.into_iter().map(|b| b.report).collect();
        fill_unmeasured(&mut reports);
        reports
    }
}

/// One scene's estimate for a bin: the unclipped variance, rounding included, and the mean code of
/// its pixels.
#[derive(Clone, Copy, Debug)]
struct VarianceEstimate {
    mu: f64,
    variance: f64,
    code: f64,
    independent: f64,
}

impl VarianceEstimate {
    fn new(levels: &[CodeLevel], independent_share: f64) -> Option<Self> {
        let informative: Vec<&CodeLevel> = levels.iter().filter(|l| l.freedom > 0.0).collect();
        let (mu, variance, usable) = unclipped(&informative);
        let freedom: f64 = usable.iter().map(|l| l.freedom).sum();
        let codes: f64 = usable.iter().map(|l| l.codes).sum();
        let independent = freedom * independent_share;
        (freedom > 0.0).then(|| Self { mu, variance, code: codes / freedom, independent })
    }
}

/// Combines the scenes' estimates, and returns how many independent samples the result is worth.
/// Scenes of one camera may differ by more than chance, and then a large scene must not outvote the
/// others. The result is the mean of σ with weights 1/(1/(2ν) + τ²): ν are a scene's degrees of
/// freedom, τ² is the relative variance of σ between scenes (DerSimonian and Laird 1986; 0 if they
/// agree). A single σ is low by 1/(4ν) on average; that is corrected.
fn combined(estimates: &[VarianceEstimate]) -> Option<(VarianceEstimate, f64)> {
    if let [only] = estimates {
        return Some((*only, only.independent));
    }
    let mean = |weights: &[f64], of: &dyn Fn(&VarianceEstimate) -> f64| -> f64 {
        let total: f64 = weights.iter().sum();
        weights.iter().zip(estimates).map(|(w, e)| w * of(e)).sum::<f64>() / total
    };
    let sigma = |e: &VarianceEstimate| e.variance.sqrt() * (1.0 + 0.25 / e.independent.max(1.0));
    let by_size: Vec<f64> = estimates.iter().map(|e| 2.0 * e.independent).collect();
    let total: f64 = by_size.iter().sum();
    if total <= 0.0 {
        return None;
    }
    let middle = mean(&by_size, &sigma);
    let mut between = 0.0;
    if middle > 0.0 {
        let spread: f64 = by_size.iter().zip(estimates).map(|(w, e)| w * (sigma(e) / middle - 1.0).powi(2)).sum();
        let divisor = total - by_size.iter().map(|w| w * w).sum::<f64>() / total;
        between = ((spread - (estimates.len() as f64 - 1.0)) / divisor).max(0.0);
    }
    let weights: Vec<f64> = by_size.iter().map(|w| 1.0 / (1.0 / w + between)).collect();
    let estimate = VarianceEstimate {
        mu: mean(&weights, &|e| e.mu),
        variance: mean(&weights, &sigma).powi(2),
        code: mean(&weights, &|e| e.code),
        independent: 0.5 * total,
    };
    Some((estimate, 0.5 * weights.iter().sum::<f64>()))
}

/// A bin being estimated, with the variance at its pixels' own mean code if there is one.
struct BinFit {
    report: BinReport,
    estimate: Option<VarianceEstimate>,
}

impl BinFit {
    fn new(bin: usize, scenes: &[&[CodeLevel]], rules: &BinRules) -> Self {
        let edge = |k: usize| (k as f64 * 256.0 / rules.bins as f64).min(255.0);
        let (low, high) = (edge(bin), edge(bin + 1));
        let samples: u64 = scenes.iter().flat_map(|s| s.iter()).map(|l| l.pixels).sum();
        let touched: u64 = scenes.iter().flat_map(|s| s.iter()).map(|l| l.touched).sum();
        let estimates: Vec<VarianceEstimate> =
            scenes.iter().filter_map(|levels| VarianceEstimate::new(levels, rules.independent_share)).collect();
        let combined_estimate = combined(&estimates);
        let worth = combined_estimate.map_or(0.0, |f| f.1);
        let combined_estimate = combined_estimate.map(|f| f.0);
        let variance = combined_estimate.map_or(0.0, |e| e.variance);
        let independent_count = combined_estimate.map_or(0.0, |e| e.independent);
        let sigma_ci95 = chi_square_interval(worth).map(|ci| ci.map(|factor| rules.rounding.sigma(variance * factor)));
        let report = BinReport {
            code_range: [low, high],
            code: 0.5 * (low + high),
            count: samples,
            clipped_share: if samples > 0 { touched as f64 / samples as f64 } else { 0.0 },
            independent_count,
            mu: combined_estimate.map_or(0.0, |e| e.mu),
            sigma: rules.rounding.sigma(variance),
            sigma_ci95,
            filled_from_neighbours: independent_count < rules.needed || combined_estimate.is_none(),
        };
        Self { report, estimate: combined_estimate }
    }
}

/// μ, the unclipped variance, and the levels far enough from the ends to determine it.
fn unclipped<'a>(levels: &[&'a CodeLevel]) -> (f64, f64, Vec<&'a CodeLevel>) {
    // Clipping only reduces variance, so start from the largest of the levels' variances.
    let min_freedom = levels.iter().map(|l| l.freedom).fold(0.0, f64::max).min(MIN_START_FREEDOM);
    let well_sampled = levels.iter().filter(|l| l.freedom >= min_freedom);
    let start = well_sampled.map(|l| l.squares / l.freedom).fold(0.0, f64::max);
    let mut sigma = start.sqrt();
    let (mut mu, mut usable) = (0.0, Vec::new());
    for _ in 0..8 {
        usable = levels.iter().copied().filter(|l| clipped_variance(l.code(), sigma, 0.0).is_some()).collect();
        let samples: f64 = usable.iter().map(|l| l.samples).sum();
        if samples <= 0.0 {
            return (0.0, 0.0, usable);
        }
        mu = usable.iter().map(|l| l.sum).sum::<f64>() / samples;
        let squares = usable.iter().map(|l| l.squares).sum::<f64>() - mu * mu * samples;
        let next = solve(&usable, squares, sigma);
        if (next - sigma).abs() < 1e-9 * sigma {
            break;
        }
        sigma = next;
    }
    (mu, sigma * sigma, usable)
}

/// The σ at which the levels' expected squares sum to `squares`.
fn solve(levels: &[&CodeLevel], squares: f64, start: f64) -> f64 {
    let expected = |sigma: f64| -> f64 {
        levels
            .iter()
            .map(|l| {
                // A level that this σ would make unusable stays in, as near to the end as is
                // allowed.
                let code = l.code();
                let nearest = NEAREST_USABLE * sigma * (1.0 + 1e-12);
                let code = if code < 127.5 { code.max(nearest) } else { code.min(255.0 - nearest) };
                clipped_variance(code, sigma, l.mean_noise / l.freedom).unwrap_or(0.0) * l.freedom
            })
            .sum()
    };
    let (mut low, mut high) = (0.0, 2.0 * start + 1e-12);
    if expected(high) < squares {
        return high;
    }
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if expected(middle) < squares {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Factors that turn a variance estimated with `freedom` degrees into its 95 % interval, by Wilson
/// and Hilferty's approximation of χ². `None` below two degrees.
pub(crate) fn chi_square_interval(freedom: f64) -> Option<[f64; 2]> {
    (freedom >= 2.0).then(|| {
        let a = 2.0 / (9.0 * freedom);
        [Z95, -Z95].map(|z| 1.0 / (1.0 - a + z * a.sqrt()).max(0.05).powi(3))
    })
}

/// Moves each estimate from its pixels' mean code to the middle of its bin, along the slope between
/// its neighbours.
fn shift_to_bin_centres(bins: &mut [BinFit], rounding: &Rounding) {
    let points: Vec<Option<(f64, f64)>> = bins
        .iter()
        .map(|b| b.estimate.filter(|_| !b.report.filled_from_neighbours).map(|e| (e.code, e.variance)))
        .collect();
    for (i, bin) in bins.iter_mut().enumerate() {
        let Some(here) = points[i] else { continue };
        let before = i.checked_sub(1).and_then(|k| points[k]).unwrap_or(here);
        let after = points.get(i + 1).copied().flatten().unwrap_or(here);
        if after.0 <= before.0 || here.1 <= 0.0 {
            continue;
        }
        let slope = (after.1 - before.1) / (after.0 - before.0);
        let factor = (1.0 + slope * (bin.report.code - here.0) / here.1).clamp(0.5, 2.0);
        let moved = |sigma: f64| rounding.sigma(rounding.variance(sigma) * factor);
        let report = &mut bin.report;
        report.sigma = moved(report.sigma);
        report.sigma_ci95 = report.sigma_ci95.map(|ci| ci.map(moved));
    }
}

/// Gives bins that could not be measured a σ interpolated between their nearest good neighbours, or
/// the nearest one's at the ends.
pub(crate) fn fill_unmeasured(reports: &mut [BinReport]) {
    let good: Vec<(f64, f64)> =
        reports.iter().filter(|r| !r.filled_from_neighbours).map(|r| (r.code, r.sigma)).collect();
    for report in reports.iter_mut().filter(|r| r.filled_from_neighbours) {
        let after = good.partition_point(|g| g.0 < report.code);
        let (low, high) = (good.get(after.wrapping_sub(1)), good.get(after));
        report.sigma = match (low, high) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (report.code - a.0) / (b.0 - a.0),
            (Some(a), None) | (None, Some(a)) => a.1,
            (None, None) => 0.0,
        };
        report.sigma_ci95 = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidence_interval_matches_the_chi_square_table() {
        // χ² with 100 degrees: 2.5 % at 74.222, 97.5 % at 129.561
        let [low, high] = chi_square_interval(100.0).unwrap();
        assert!((low - 100.0 / 129.561).abs() < 1e-3 && (high - 100.0 / 74.222).abs() < 1e-3, "{low} {high}");
        assert!(chi_square_interval(1.0).is_none());
    }

    #[test]
    fn scenes_that_agree_are_weighted_by_size_and_others_equally() {
        let scene = |variance: f64, independent: f64| VarianceEstimate { mu: 0.0, variance, code: 8.0, independent };
        let (agreed, worth) = combined(&[scene(1.0, 9000.0), scene(1.02, 1000.0)]).unwrap();
        assert!((agreed.variance - 1.002).abs() < 1e-4 && (worth - 10000.0).abs() < 1e-6, "{agreed:?} {worth}");
        let (apart, worth) = combined(&[scene(1.0, 9_000_000.0), scene(4.0, 1_000_000.0)]).unwrap();
        assert!((apart.variance.sqrt() - 1.5).abs() < 0.01 && worth < 20.0, "{apart:?} {worth}");
        assert!(combined(&[]).is_none());
    }

    #[test]
    fn bins_without_samples_are_interpolated() {
        let bin = |code: f64, sigma: f64, filled: bool| BinReport {
            code_range: [code - 8.0, code + 8.0],
            code,
            count: 0,
            clipped_share: 0.0,
            independent_count: 0.0,
            mu: 0.0,
            sigma,
            sigma_ci95: None,
            filled_from_neighbours: filled,
        };
        let mut bins = [
            bin(8.0, 9.0, true),
            bin(24.0, 2.0, false),
            bin(40.0, 9.0, true),
            bin(56.0, 4.0, false),
            bin(72.0, 9.0, true),
        ];
        fill_unmeasured(&mut bins);
        assert_eq!(bins.map(|b| b.sigma), [2.0, 2.0, 3.0, 4.0, 4.0]);
    }
}
