//! Noise of picked regions in single frames: deviation from a plane in blocks of 12×12 pixels
//! (plane.rs).

use super::bins::chi_square_interval;
use super::noise::{SceneMotion, reported_correlation};
use super::picked_region::{MIN_BLOCKS, PickedError, PickedRegion, RegionError, RegionNoise, min_side_px};
use super::plane::{ByLag, LAGS, NEIGHBOURS, PlaneDetrend, SIDE};
use super::points::NoisePoint;
use super::rounding::{CODES16_PER_CODE8, Rounding};
use super::warning::Warning;
use crate::pixels::Pixels;

/// Largest accepted ratio of observed to expected spread of the block variances; a margin for
/// chance is added.
const MAX_SPREAD_RATIO: f64 = 1.6;
/// Largest share of a block's pixels at an end of the code range, as in textureless.rs.
const MAX_CLIPPED_SHARE: f64 = 0.02;
const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// Sums over a region's blocks.
#[derive(Clone, Debug, Default)]
struct RegionSums {
    blocks: f64,
    /// Rejected blocks: at an end of the code range, and without noise.
    clipped: usize,
    quiet: usize,
    mean: [f64; 3],
    products: [ByLag; 3],
    /// Squares of the blocks' variances.
    squares: [f64; 3],
    cross: [f64; 3],
}

impl RegionSums {
    /// Mean code of a usable region.
    fn mean_code(&self, (width, height): (u32, u32)) -> Result<f64, RegionError> {
        if self.blocks as usize >= MIN_BLOCKS {
            Ok(self.mean.iter().sum::<f64>() / 3.0 / self.blocks)
        } else if self.clipped > self.quiet {
            Err(RegionError::Clipped)
        } else if self.quiet > 0 {
            Err(RegionError::Quiet)
        } else {
            Err(RegionError::Small { width, height, min_side_px: min_side_px(SceneMotion::Moving) })
        }
    }

    /// Ratio of the observed standard deviation of the block variances to that expected of noise
    /// with this many degrees of freedom.
    fn spread_ratio(&self, c: usize, freedom: f64) -> f64 {
        let mean = self.products[c][0] / self.blocks;
        let spread = self.squares[c] / self.blocks / (mean * mean) - 1.0;
        (spread / (2.0 / freedom)).sqrt()
    }
}

/// Checks regions by their blocks and measures the usable ones. Adds a verdict for each region.
pub(super) fn from_single_frames(
    places: &[PickedRegion],
    verdicts: &mut Vec<Result<f64, RegionError>>,
    warnings: &mut Vec<Warning>,
) -> Result<RegionNoise, PickedError> {
    let plane = PlaneDetrend::new();
    let mut good: Vec<(usize, RegionSums)> = Vec::new();
    for (n, place) in places.iter().enumerate() {
        let sums = sums(&plane, place.frames());
        let verdict = sums.mean_code(place.size_px());
        good.extend(verdict.is_ok().then_some((n, sums)));
        verdicts.push(verdict);
    }
    let shared = loop {
        if good.is_empty() {
            return Err(PickedError::NoneFit);
        }
        let shared = PooledCorrelation::of(&plane, &good);
        // A textured region raises the estimated correlation, which excuses others. So the worst
        // one is removed first.
        let ratio = |sums: &RegionSums| (0..3).map(|c| sums.spread_ratio(c, shared.freedom[c])).fold(0.0, f64::max);
        let max_ratio = |sums: &RegionSums| MAX_SPREAD_RATIO + (8.0 / sums.blocks).sqrt();
        let worst = good.iter().enumerate().map(|(i, (_, sums))| (i, ratio(sums) / max_ratio(sums)));
        match worst.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, beyond)| *beyond > 1.0) {
            Some((worst, _)) => {
                let (n, sums) = good.remove(worst);
                verdicts[n] = Err(RegionError::Textured { times: ratio(&sums) });
            }
            None => break shared,
        }
    };
    Ok(shared.region_noise(&plane, places, &good, warnings))
}

/// Correlation of the noise, common to all regions.
struct PooledCorrelation {
    blocks: f64,
    correlation: [ByLag; 3],
    cross: [f64; 3],
    freedom: [f64; 3],
}

impl PooledCorrelation {
    /// Pooled over all regions, each normalized by its own variance.
    fn of(plane: &PlaneDetrend, good: &[(usize, RegionSums)]) -> Self {
        let blocks: f64 = good.iter().map(|(_, sums)| sums.blocks).sum();
        let mut relative = [[0.0; LAGS]; 3];
        let mut cross = [0.0; 3];
        for (_, sums) in good {
            for c in 0..3 {
                for (sum, product) in relative[c].iter_mut().zip(sums.products[c]) {
                    *sum += product / sums.products[c][0] * sums.blocks / blocks;
                }
                let (a, b) = PAIRS[c];
                cross[c] += sums.cross[c] / (sums.products[a][0] * sums.products[b][0]).sqrt() * sums.blocks / blocks;
            }
        }
        let covariance = relative.map(|relative| plane.covariance(&relative));
        let correlation = covariance.map(|r| r.map(|v| (v / r[0]).clamp(-1.0, 1.0)));
        Self { blocks, cross, freedom: correlation.map(|r| plane.freedom(&r)), correlation }
    }

    fn region_noise(
        &self,
        plane: &PlaneDetrend,
        places: &[PickedRegion],
        good: &[(usize, RegionSums)],
        warnings: &mut Vec<Warning>,
    ) -> RegionNoise {
        let remaining_share = self.correlation.map(|r| plane.remaining_variance_share(&r));
        let mut frames = good.iter().flat_map(|(n, _)| places[*n].frames());
        let step = if frames.any(|frame| frame.max_code() != 255) { 1.0 / CODES16_PER_CODE8 as f64 } else { 1.0 };
        let rounding = Rounding { frame_step: step, mean_step: None };
        let mut points: [Vec<NoisePoint>; 3] = Default::default();
        let mut own = [0.0; 3];
        for (_, sums) in good {
            for c in 0..3 {
                let variance = sums.products[c][0] / sums.blocks / remaining_share[c];
                let independent_count = sums.blocks * self.freedom[c];
                let Some(factors) = chi_square_interval(independent_count) else { continue };
                let sigma_ci95 = factors.map(|factor| rounding.sigma(variance * factor));
                let (code, sigma) = (sums.mean[c] / sums.blocks, rounding.sigma(variance));
                own[c] += (sigma * sigma / variance) * sums.blocks / self.blocks;
                points[c].push(NoisePoint { code, sigma, sigma_ci95, independent_count });
            }
        }
        // Rounding is independent from pixel to pixel, so it has no share in the covariance of
        // neighbours.
        let shared = |c: usize, k: usize| self.correlation[c][k] / own[c].max(1e-6);
        let mean = |k: usize| (0..3).map(|c| shared(c, k)).sum::<f64>() / 3.0;
        let neighbour = NEIGHBOURS.map(|k| Some(mean(k)).filter(|r| r.is_finite()));
        let channel = [0, 1, 2].map(|i| {
            let (a, b) = PAIRS[i];
            Some(self.cross[i] / (own[a] * own[b]).sqrt()).filter(|r: &f64| r.is_finite())
        });
        let mut reported = |value, name, low| reported_correlation(value, name, low, warnings);
        let [rg, rb, gb] = channel;
        let channel_correlation = [reported(rg, "R-G", -1.0), reported(rb, "R-B", -1.0), reported(gb, "G-B", -1.0)];
        let [right, below] = neighbour;
        let neighbour_correlation = [reported(right, "to the right", 0.0), reported(below, "below", 0.0)];
        RegionNoise { points, channel_correlation, neighbour_correlation }
    }
}

fn sums(plane: &PlaneDetrend, frames: &[Pixels]) -> RegionSums {
    let mut sums = RegionSums::default();
    let pixels = (SIDE * SIDE) as f64;
    let starts = |length: u32| (0..(length as usize + 1).saturating_sub(SIDE)).step_by(SIDE);
    for frame in frames {
        let scale = 255.0 / f64::from(frame.max_code());
        for (y0, x0) in starts(frame.height).flat_map(|y| starts(frame.width).map(move |x| (y, x))) {
            let mut residuals = [[0.0; SIDE * SIDE]; 3];
            let mut clipped = [0.0; 3];
            let at = |i: usize| frame.at((x0 + i % SIDE) as u32, (y0 + i / SIDE) as u32);
            let picture: [[u32; 3]; SIDE * SIDE] = std::array::from_fn(at);
            for (c, (values, clipped)) in residuals.iter_mut().zip(&mut clipped).enumerate() {
                for (value, codes) in values.iter_mut().zip(&picture) {
                    *value = scale * f64::from(codes[c]);
                    *clipped += f64::from(u8::from(codes[c] == 0 || codes[c] == frame.max_code()));
                }
            }
            let means = residuals.map(|values| values.iter().sum::<f64>() / pixels);
            residuals.iter_mut().for_each(|values| plane.subtract(values));
            let products = residuals.each_ref().map(PlaneDetrend::products);
            if clipped.iter().any(|n| *n > MAX_CLIPPED_SHARE * pixels) {
                sums.clipped += 1;
                continue;
            }
            if products.iter().any(|p| p[0] <= 0.0) {
                sums.quiet += 1;
                continue;
            }
            sums.blocks += 1.0;
            for c in 0..3 {
                sums.mean[c] += means[c];
                sums.squares[c] += products[c][0].powi(2);
                sums.products[c].iter_mut().zip(products[c]).for_each(|(sum, product)| *sum += product);
                let (a, b) = PAIRS[c];
                sums.cross[c] += residuals[a].iter().zip(&residuals[b]).map(|(a, b)| a * b).sum::<f64>() / pixels;
            }
        }
    }
    sums
}
