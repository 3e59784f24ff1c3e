//! From sums at each code to σ in each bin, and correlations from the blocks that stood still.

use super::censoring::{NEAREST_USABLE, clipped_variance};
use super::noise::BinReport;
use super::rounding::Rounding;
use super::scene_sums::{PixelSums, SceneSums, UNIT};

/// Variances are kept apart at four places in each 8-bit code, so that clipping can be told by the mean.
const LEVELS: usize = 1024;
/// Normal quantile of a two-sided 95 % interval.
const Z95: f64 = 1.959_964;
/// Below this variance (8-bit codes squared, times the frames' step squared) a block tells nothing of correlation.
const TOO_QUIET: f64 = 0.1;

/// All pixels whose mean lies in a quarter of a code.
#[derive(Clone, Copy, Debug, Default)]
struct Level {
    samples: u64,
    touched: u64,
    freedom: f64,
    /// Σ freedom · (1/J): how noisy the means are.
    mean_noise: f64,
    /// Σ freedom · mean.
    codes: f64,
    squares: f64,
    sum: f64,
}

impl Level {
    fn code(&self) -> f64 {
        self.codes / self.freedom
    }
}

/// Sums over every pixel of every scene that stood still.
#[derive(Clone, Debug)]
pub(crate) struct Pool {
    levels: [Vec<Level>; 3],
    channel: [Ratio; 3],
    neighbour: [Ratio; 2],
}

/// A correlation on its way: covariance, and the two variances.
#[derive(Clone, Copy, Debug, Default)]
struct Ratio {
    covariance: f64,
    a: f64,
    b: f64,
}

impl Ratio {
    fn add(&mut self, weight: f64, covariance: f64, a: f64, b: f64) {
        self.covariance += weight * covariance;
        self.a += weight * a;
        self.b += weight * b;
    }
    fn value(&self) -> Option<f64> {
        let product = self.a * self.b;
        (product > 0.0).then(|| (self.covariance / product.sqrt()).clamp(-1.0, 1.0))
    }
}

impl Default for Pool {
    fn default() -> Self {
        Self {
            levels: std::array::from_fn(|_| vec![Level::default(); LEVELS]),
            channel: Default::default(),
            neighbour: Default::default(),
        }
    }
}

impl Pool {
    /// Adds the blocks of a scene that stood still.
    pub fn add(&mut self, scene: &SceneSums, still: &[bool], rounding: &Rounding) {
        for (block, _) in still.iter().enumerate().filter(|(_, still)| **still) {
            for channel in 0..3 {
                for i in scene.places(scene.area(block), channel) {
                    self.add_pixel(channel, scene.pixel(i), scene);
                }
            }
            self.add_block(scene, block, rounding);
        }
    }

    fn add_pixel(&mut self, channel: usize, pixel: PixelSums, scene: &SceneSums) {
        let place = ((pixel.mean * LEVELS as f64 / 256.0) as usize).min(LEVELS - 1);
        let level = &mut self.levels[channel][place];
        let freedom = scene.freedom();
        level.samples += u64::from(scene.frames);
        level.touched += u64::from(pixel.touched) * u64::from(scene.frames);
        level.freedom += freedom;
        level.mean_noise += freedom * scene.mean_noise();
        level.codes += freedom * pixel.mean;
        level.squares += pixel.squares;
        level.sum += pixel.sum;
    }

    fn add_block(&mut self, scene: &SceneSums, block: usize, rounding: &Rounding) {
        let area = scene.area(block);
        let (count, times) = scene.differences();
        let unit = (UNIT * UNIT) as f64 * times * count;
        let (n, right, below) = (area.pixels() as f64, area.pairs_right() as f64, area.pairs_below() as f64);
        let sums = &scene.blocks[block];
        let measured = sums.squares.map(|s| s as f64 / (unit * n));
        let sigma = measured.map(|v| rounding.sigma(v));
        let clipped = (0..3).any(|c| scene.places(area, c).any(|i| scene.pixel(i).touched));
        let quiet = TOO_QUIET * rounding.frame_step * rounding.frame_step;
        if clipped || measured.iter().any(|&v| v < quiet) || sigma.contains(&0.0) {
            return;
        }
        let variance = sigma.map(|s| s * s);
        for (ratio, (place, (a, b))) in self.channel.iter_mut().zip([(0, 1), (0, 2), (1, 2)].into_iter().enumerate()) {
            let covariance = sums.cross[place] as f64 / (unit * n);
            ratio.add(n / (variance[a] * variance[b]).sqrt(), covariance, variance[a], variance[b]);
        }
        for c in 0..3 {
            for (ratio, (sum, pairs)) in self.neighbour.iter_mut().zip([(sums.right[c], right), (sums.below[c], below)])
            {
                if pairs > 0.0 {
                    let covariance = sum as f64 / (unit * pairs);
                    ratio.add(pairs / variance[c], covariance, variance[c], variance[c]);
                }
            }
        }
    }

    /// Correlation of R-G, R-B, G-B; `None` where nothing told it.
    pub fn channel_correlation(&self) -> [Option<f64>; 3] {
        self.channel.map(|r| r.value())
    }

    /// Correlation with the neighbours to the right and below; `None` where nothing told it.
    pub fn neighbour_correlation(&self) -> [Option<f64>; 2] {
        self.neighbour.map(|r| r.value())
    }

    /// σ of each bin of a channel. `independent_share`: what a sample counts among correlated neighbours.
    pub fn bins(
        &self,
        channel: usize,
        bins: usize,
        rounding: &Rounding,
        needed: f64,
        independent_share: f64,
    ) -> Vec<BinReport> {
        let levels = &self.levels[channel];
        let mut out: Vec<Bin> = (0..bins)
            .map(|bin| {
                let edge = |k: usize| (k as f64 * 256.0 / bins as f64).min(255.0);
                let first = (bin * LEVELS).div_ceil(bins);
                let last = ((bin + 1) * LEVELS).div_ceil(bins);
                Bin::new(edge(bin), edge(bin + 1), &levels[first..last], rounding, independent_share)
            })
            .collect();
        for bin in &mut out {
            bin.report.filled_from_neighbours = bin.report.independent_count < needed;
        }
        to_the_middle(&mut out, rounding);
        let mut reports: Vec<BinReport> = out.into_iter().map(|b| b.report).collect();
        fill(&mut reports);
        reports
    }
}

/// A bin's estimate on its way: the variance of the unclipped variations, rounding included, at its own mean code.
struct Bin {
    report: BinReport,
    mean_code: f64,
    variance: f64,
}

impl Bin {
    fn new(low: f64, high: f64, levels: &[Level], rounding: &Rounding, independent_share: f64) -> Self {
        let seen: Vec<&Level> = levels.iter().filter(|l| l.freedom > 0.0).collect();
        let samples: u64 = seen.iter().map(|l| l.samples).sum();
        let touched: u64 = seen.iter().map(|l| l.touched).sum();
        let (mu, variance, usable) = unclipped(&seen);
        let freedom: f64 = usable.iter().map(|l| l.freedom).sum();
        let codes: f64 = usable.iter().map(|l| l.codes).sum();
        let independent = freedom * independent_share;
        let sigma = rounding.sigma(variance);
        let ci =
            chi_square_interval(independent).map(|[l, h]| [rounding.sigma(variance * l), rounding.sigma(variance * h)]);
        Self {
            report: BinReport {
                code_range: [low, high],
                code: 0.5 * (low + high),
                count: samples,
                clipped_share: if samples > 0 { touched as f64 / samples as f64 } else { 0.0 },
                independent_count: independent,
                mu,
                sigma,
                sigma_ci95: ci,
                filled_from_neighbours: false,
            },
            mean_code: if freedom > 0.0 { codes / freedom } else { 0.5 * (low + high) },
            variance,
        }
    }
}

/// μ, the unclipped variance, and the levels that are far enough from the ends to tell it.
fn unclipped<'a>(levels: &[&'a Level]) -> (f64, f64, Vec<&'a Level>) {
    // clipping only takes: the largest of the levels' variances is where to start
    let most = levels.iter().map(|l| l.freedom).fold(0.0, f64::max);
    let start = levels.iter().filter(|l| l.freedom >= 0.1 * most).map(|l| l.squares / l.freedom).fold(0.0, f64::max);
    let mut sigma = start.sqrt();
    let (mut mu, mut usable) = (0.0, Vec::new());
    for _ in 0..8 {
        usable = levels.iter().copied().filter(|l| clipped_variance(l.code(), sigma, 0.0).is_some()).collect();
        let samples: u64 = usable.iter().map(|l| l.samples).sum();
        if samples == 0 {
            return (0.0, 0.0, usable);
        }
        mu = usable.iter().map(|l| l.sum).sum::<f64>() / samples as f64;
        let squares = usable.iter().map(|l| l.squares).sum::<f64>() - mu * mu * samples as f64;
        let next = solve(&usable, squares, sigma);
        if (next - sigma).abs() < 1e-9 * sigma {
            break;
        }
        sigma = next;
    }
    (mu, sigma * sigma, usable)
}

/// The σ at which the levels' expected squares sum to `squares`.
fn solve(levels: &[&Level], squares: f64, start: f64) -> f64 {
    let expected = |sigma: f64| -> f64 {
        levels
            .iter()
            .map(|l| {
                // a level that this σ would make unusable stays in, as near as is allowed
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

/// What a variance estimated with `freedom` degrees is to be multiplied with for its 95 % interval, by Wilson and
/// Hilferty's approximation of χ²; `None` below two degrees.
fn chi_square_interval(freedom: f64) -> Option<[f64; 2]> {
    (freedom >= 2.0).then(|| {
        let a = 2.0 / (9.0 * freedom);
        [Z95, -Z95].map(|z| 1.0 / (1.0 - a + z * a.sqrt()).max(0.05).powi(3))
    })
}

/// Moves each estimate from its pixels' mean code to the middle of its bin, along the slope between its neighbours.
fn to_the_middle(bins: &mut [Bin], rounding: &Rounding) {
    let points: Vec<Option<(f64, f64)>> =
        bins.iter().map(|b| (!b.report.filled_from_neighbours).then_some((b.mean_code, b.variance))).collect();
    for (i, bin) in bins.iter_mut().enumerate() {
        let Some(here) = points[i] else { continue };
        let before = i.checked_sub(1).and_then(|k| points[k]).unwrap_or(here);
        let after = points.get(i + 1).copied().flatten().unwrap_or(here);
        if after.0 - before.0 <= 0.0 {
            continue;
        }
        let slope = (after.1 - before.1) / (after.0 - before.0);
        let moved = here.1 + slope * (bin.report.code - here.0);
        let factor = if here.1 > 0.0 { (moved / here.1).clamp(0.5, 2.0) } else { 1.0 };
        bin.report.sigma = rounding.sigma(here.1 * factor);
        bin.report.sigma_ci95 =
            bin.report.sigma_ci95.map(|ci| ci.map(|s| rounding.sigma(rounding.variance(s) * factor)));
    }
}

/// Gives bins that could not be measured the σ between their nearest good neighbours, or the nearest one's at the ends.
fn fill(reports: &mut [BinReport]) {
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
    fn the_interval_is_chi_square_by_the_table() {
        // χ² with 100 degrees: 2.5 % at 74.222, 97.5 % at 129.561
        let [low, high] = chi_square_interval(100.0).unwrap();
        assert!((low - 100.0 / 129.561).abs() < 1e-3 && (high - 100.0 / 74.222).abs() < 1e-3, "{low} {high}");
        assert!(chi_square_interval(1.0).is_none());
    }

    #[test]
    fn bins_without_samples_lie_between_their_neighbours() {
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
        fill(&mut bins);
        assert_eq!(bins.map(|b| b.sigma), [2.0, 2.0, 3.0, 4.0, 4.0]);
    }
}
