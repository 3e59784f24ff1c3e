//! Finds the blocks of a scene at rest. Moving or drifting content varies more than noise.
//!
//! Whole blocks are judged, because leaving out single pixels would cut the tails of the noise.
//! Each block has two statistics. Both are compared with the scene's own median and the median
//! spread below it, so that correlated noise does not count as motion:
//!
//! - *excess*: mean of s²/V(a), V the scene's robust variance at that code; its cube root is nearly
//!   normal (Wilson and Hilferty). Detects motion, and a known mean that does not fit.
//! - *drift*: 1 − δ²/s² with δ² = Σ(f_(j+1) − f_j)²/(2(J−1)) (von Neumann's ratio): variance that
//!   consecutive frames do not show. Finds slow changes. Needs four frames.

use super::rounding::CODES16_PER_CODE8;
use super::scene_sums::{BLOCK, SceneSums};
use crate::fit::quantile::{SIGMA_PER_MAD, upper_median, upper_median_in_place};

/// Blocks whose statistic lies this many standard deviations above the median: one in a million by
/// chance.
const SIGNIFICANT_Z: f64 = 4.75;
/// A smaller share of excess variance is accepted, however significant.
const RELEVANT_EXCESS: f64 = 0.25;
/// A smaller share of slow drift in a block's variance is accepted.
const RELEVANT_DRIFT: f64 = 0.10;
/// Smallest number of pixels that give a block's variance in a bin.
const CELL_PIXELS: usize = 8;
/// A camera's σ² grows by at most this factor, times the distance in bins, from one bin to another.
const MAX_GROWTH: f64 = 8.0;

/// The findings for a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct BlockVerdict {
    /// True for each block that stood still.
    pub still: Vec<bool>,
    /// Approximate variance of each block and channel, expected at its mean code; above 0.
    pub scales: Vec<[f64; 3]>,
    /// Pixels in blocks left out because they vary too much, and in those left out because they
    /// drift.
    pub moving_pixels: u64,
    pub drifting_pixels: u64,
    /// The median block's drift: from temporal filtering in the camera, or slowly changing light.
    pub median_drift: f64,
}

/// A block's statistic and how many values went into it. `None` if there were too few.
type Statistic = Option<(f64, usize)>;

/// The blocks that stand out: beyond chance, and by more than `relevant(statistic, median)`
/// accepts. Motion only adds, so the spread is measured below the median. Blocks that stand out are
/// removed and the rest is judged again. Also returns the median of the rest.
fn outliers(
    statistics: &[Statistic],
    chance: impl Fn(f64) -> f64,
    relevant: impl Fn(f64, f64) -> bool,
) -> (Vec<bool>, f64) {
    let mut out = vec![false; statistics.len()];
    let max_count = statistics.iter().flatten().map(|s| s.1).max().unwrap_or(0) as f64;
    let mut middle = 0.0;
    for _ in 0..5 {
        let whole = |s: &Statistic| s.filter(|s| s.1 as f64 >= 0.75 * max_count).map(|s| s.0);
        let mut rest: Vec<f64> =
            statistics.iter().zip(&out).filter(|(_, out)| !**out).filter_map(|(s, _)| whole(s)).collect();
        let Some(median) = upper_median_in_place(&mut rest) else { break };
        middle = median;
        let below = rest.iter().filter(|v| **v <= middle).map(|v| middle - v);
        let spread = (SIGMA_PER_MAD * upper_median(below).unwrap_or(0.0)).max(chance(middle));
        let stands_out = |s: &Statistic| {
            s.is_some_and(|(value, n)| {
                value - middle > SIGNIFICANT_Z * spread * (max_count / n as f64).sqrt() && relevant(value, middle)
            })
        };
        let now: Vec<bool> = statistics.iter().map(stands_out).collect();
        if now == out {
            break;
        }
        out = now;
    }
    (out, middle)
}

/// A scene's variance by code, from the median over blocks: up to half of a bin may move.
struct RobustVariance {
    /// Mean code and variance of each non-empty bin, ascending.
    points: Vec<(f64, f64)>,
    floor: f64,
}

const BINS: usize = 16;

fn bin_of(code: f64) -> usize {
    ((code * BINS as f64 / 256.0) as usize).min(BINS - 1)
}

impl RobustVariance {
    fn new(scene: &SceneSums, channel: usize, floor: f64) -> Self {
        // For each bin: blocks as (variance, pixels, sum of codes).
        let mut cells: [Vec<(f64, usize, f64)>; BINS] = Default::default();
        for block in 0..scene.blocks.len() {
            let mut here = [(0usize, 0.0, 0.0); BINS];
            for i in scene.places(scene.area(block), channel) {
                let p = scene.pixel(i);
                if !p.touched {
                    let cell = &mut here[bin_of(p.mean)];
                    *cell = (cell.0 + 1, cell.1 + p.squares, cell.2 + p.mean);
                }
            }
            for (cell, (n, squares, codes)) in cells.iter_mut().zip(here) {
                if n >= CELL_PIXELS {
                    cell.push((squares / (n as f64 * scene.freedom()), n, codes));
                }
            }
        }
        let mut bins: Vec<(usize, usize, f64, f64)> = Vec::new();
        for (bin, cells) in cells.iter_mut().enumerate() {
            cells.sort_by(|a, b| a.0.total_cmp(&b.0));
            let total: usize = cells.iter().map(|c| c.1).sum();
            let mut below = 0;
            let middle = cells.iter().find(|c| {
                below += c.1;
                2 * below >= total
            });
            if let Some(middle) = middle {
                bins.push((total, bin, cells.iter().map(|c| c.2).sum::<f64>() / total as f64, middle.0));
            }
        }
        // A bin that contains only moving things has a high median too, so well-filled bins bound
        // the others.
        bins.sort_by_key(|b| std::cmp::Reverse(b.0));
        let mut trusted: Vec<(usize, f64, f64)> = Vec::new();
        for (_, bin, code, variance) in bins {
            let bound = trusted
                .iter()
                .map(|t| t.2.max(floor) * MAX_GROWTH * t.0.abs_diff(bin) as f64)
                .fold(f64::INFINITY, f64::min);
            trusted.push((bin, code, variance.min(bound)));
        }
        trusted.sort_by_key(|t| t.0);
        Self { points: trusted.iter().map(|t| (t.1, t.2)).collect(), floor }
    }

    /// Linear between the bins, constant beyond. `None` if the scene has no usable bin.
    fn at(&self, code: f64) -> Option<f64> {
        let after = self.points.partition_point(|p| p.0 <= code);
        let (low, high) = (self.points.get(after.wrapping_sub(1)), self.points.get(after));
        let variance = match (low, high) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (code - a.0) / (b.0 - a.0),
            (Some(a), None) | (None, Some(a)) => a.1,
            (None, None) => return None,
        };
        Some(variance.max(self.floor))
    }
}

/// Judges every block of a scene. `frame_step` is one code of the frames in 8-bit code values.
pub(crate) fn judge(scene: &SceneSums, frame_step: f64) -> BlockVerdict {
    let floor = 0.01 * frame_step * frame_step;
    let variance = [0, 1, 2].map(|c| RobustVariance::new(scene, c, floor));
    let freedom = scene.freedom();
    // Standard deviation of the cube root of χ²/ν.
    let chance = |middle: f64| middle * (2.0 / (3.0 * (BLOCK * BLOCK) as f64 * freedom)).sqrt() / 3.0;
    let matters = |root: f64, middle: f64| root.powi(3) > middle.powi(3).max(1.0) * (1.0 + RELEVANT_EXCESS);
    let (moves, _) = outliers(&excesses(scene, &variance), chance, matters);
    let (drifts, median_drift) = outliers(&drifts(scene), |_| 0.0, |drift, middle| drift - middle > RELEVANT_DRIFT);
    let mut verdict = BlockVerdict { median_drift, ..BlockVerdict::default() };
    for (block, (moves, drifts)) in moves.into_iter().zip(drifts).enumerate() {
        let pixels = scene.area(block).pixels() as u64;
        if moves {
            verdict.moving_pixels += pixels;
        } else if drifts {
            verdict.drifting_pixels += pixels;
        }
        verdict.still.push(!moves && !drifts);
        verdict.scales.push(scales(scene, block, &variance));
    }
    verdict
}

fn scales(scene: &SceneSums, block: usize, variance: &[RobustVariance; 3]) -> [f64; 3] {
    let area = scene.area(block);
    [0, 1, 2].map(|c| {
        let code = scene.places(area, c).map(|i| scene.pixel(i).mean).sum::<f64>() / area.pixels() as f64;
        variance[c].at(code).unwrap_or(1.0)
    })
}

/// The cube root of the mean of s²/V over the unclipped pixels of each block.
fn excesses(scene: &SceneSums, variance: &[RobustVariance; 3]) -> Vec<Statistic> {
    let freedom = scene.freedom();
    (0..scene.blocks.len())
        .map(|block| {
            let (mut total, mut n) = (0.0, 0);
            for (channel, variance) in variance.iter().enumerate() {
                for i in scene.places(scene.area(block), channel) {
                    let p = scene.pixel(i);
                    if let (false, Some(expected)) = (p.touched, variance.at(p.mean)) {
                        total += p.squares / (freedom * expected);
                        n += 1;
                    }
                }
            }
            (n >= CELL_PIXELS).then(|| ((total / n as f64).cbrt(), n))
        })
        .collect()
}

/// The share of each block's variance that consecutive frames lack.
fn drifts(scene: &SceneSums) -> Vec<Statistic> {
    if scene.known_mean || scene.frames < 4 {
        return vec![None; scene.blocks.len()];
    }
    (0..scene.blocks.len())
        .map(|block| {
            let unit = CODES16_PER_CODE8 as f64;
            let squares: f64 =
                (0..3).flat_map(|c| scene.places(scene.area(block), c)).map(|i| scene.pixel(i).squares).sum();
            let differences: f64 = scene.blocks[block].squares.iter().map(|&d| d as f64 / (unit * unit)).sum();
            (squares > 0.0).then(|| (1.0 - 0.5 * differences / squares, scene.area(block).pixels()))
        })
        .collect()
}
