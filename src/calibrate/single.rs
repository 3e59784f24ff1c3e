//! Noise of picked places in single frames: what blocks of 12×12 pixels show beside a plane (plane.rs).

use super::bins::chi_square_interval;
use super::noise::{SceneMotion, told_correlation};
use super::places::{FEWEST_BLOCKS, Found, PickedError, Place, Unfit, least_px};
use super::plane::{ByLag, LAGS, NEIGHBOURS, Plane, SIDE};
use super::points::NoisePoint;
use super::rounding::{Rounding, UNIT};
use super::warning::Warning;
use crate::pixels::Pixels;

/// Blocks may spread this many times as much as noise does, and by chance.
const WIDEST: f64 = 1.6;
/// A block is left out if more than this share of it is at an end of the code range, as in moving.rs.
const CLIPPED: f64 = 0.02;
const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// The sums over a place's blocks.
#[derive(Clone, Debug, Default)]
struct Sums {
    blocks: f64,
    /// Blocks that are left out: at an end of the code range, and without noise.
    clipped: usize,
    quiet: usize,
    mean: [f64; 3],
    products: [ByLag; 3],
    /// Squares of the blocks' variances.
    squares: [f64; 3],
    cross: [f64; 3],
}

impl Sums {
    /// Whether it can be looked at for noise.
    fn verdict(&self, (width, height): (u32, u32)) -> Result<f64, Unfit> {
        match () {
            () if self.blocks as usize >= FEWEST_BLOCKS => Ok(self.mean.iter().sum::<f64>() / 3.0 / self.blocks),
            () if self.clipped > self.quiet => Err(Unfit::Clipped),
            () if self.quiet > 0 => Err(Unfit::Quiet),
            () => Err(Unfit::Small { width, height, least: least_px(SceneMotion::Moving) }),
        }
    }

    /// How many times as much its blocks' variances differ as noise's of that freedom do.
    fn times(&self, c: usize, freedom: f64) -> f64 {
        let mean = self.products[c][0] / self.blocks;
        let spread = self.squares[c] / self.blocks / (mean * mean) - 1.0;
        (spread / (2.0 / freedom)).sqrt()
    }
}

/// Judges places by their blocks, and gives what those that are good say. Each gets a verdict.
pub(super) fn in_frames(
    places: &[Place],
    verdicts: &mut Vec<Result<f64, Unfit>>,
    warnings: &mut Vec<Warning>,
) -> Result<Found, PickedError> {
    let plane = Plane::new();
    let mut good: Vec<(usize, Sums)> = Vec::new();
    for (n, place) in places.iter().enumerate() {
        let sums = sums(&plane, place.frames());
        let verdict = sums.verdict(place.size_px());
        good.extend(verdict.is_ok().then_some((n, sums)));
        verdicts.push(verdict);
    }
    let shared = loop {
        if good.is_empty() {
            return Err(PickedError::NoneFit);
        }
        let shared = Shared::of(&plane, &good);
        // A textured one makes the noise look more alike than it is, which excuses others: the worst goes first.
        let times = |sums: &Sums| (0..3).map(|c| sums.times(c, shared.freedom[c])).fold(0.0, f64::max);
        let most = |sums: &Sums| WIDEST + (8.0 / sums.blocks).sqrt();
        let worst = good.iter().enumerate().map(|(i, (_, sums))| (i, times(sums) / most(sums)));
        match worst.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, beyond)| *beyond > 1.0) {
            Some((worst, _)) => {
                let (n, sums) = good.remove(worst);
                verdicts[n] = Err(Unfit::Textured { times: times(&sums) });
            }
            None => break shared,
        }
    };
    Ok(shared.found(&plane, places, &good, warnings))
}

/// What all places' noise has in common.
struct Shared {
    blocks: f64,
    correlation: [ByLag; 3],
    cross: [f64; 3],
    freedom: [f64; 3],
}

impl Shared {
    /// From all places, each over its own variance.
    fn of(plane: &Plane, good: &[(usize, Sums)]) -> Self {
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

    fn found(&self, plane: &Plane, places: &[Place], good: &[(usize, Sums)], warnings: &mut Vec<Warning>) -> Found {
        let kept = self.correlation.map(|r| plane.kept(&r));
        let mut frames = good.iter().flat_map(|(n, _)| places[*n].frames());
        let step = if frames.any(|frame| frame.max_code() != 255) { 1.0 / UNIT as f64 } else { 1.0 };
        let rounding = Rounding { frame_step: step, mean_step: None };
        let mut points: [Vec<NoisePoint>; 3] = Default::default();
        let mut own = [0.0; 3];
        for (_, sums) in good {
            for c in 0..3 {
                let variance = sums.products[c][0] / sums.blocks / kept[c];
                let independent_count = sums.blocks * self.freedom[c];
                let Some(factors) = chi_square_interval(independent_count) else { continue };
                let sigma_ci95 = factors.map(|factor| rounding.sigma(variance * factor));
                let (code, sigma) = (sums.mean[c] / sums.blocks, rounding.sigma(variance));
                own[c] += (sigma * sigma / variance) * sums.blocks / self.blocks;
                points[c].push(NoisePoint { code, sigma, sigma_ci95, independent_count });
            }
        }
        // Rounding is independent from pixel to pixel: it is no part of what neighbours share.
        let shared = |c: usize, k: usize| self.correlation[c][k] / own[c].max(1e-6);
        let mean = |k: usize| (0..3).map(|c| shared(c, k)).sum::<f64>() / 3.0;
        let neighbour = NEIGHBOURS.map(|k| Some(mean(k)).filter(|r| r.is_finite()));
        let channel = [0, 1, 2].map(|i| {
            let (a, b) = PAIRS[i];
            Some(self.cross[i] / (own[a] * own[b]).sqrt()).filter(|r: &f64| r.is_finite())
        });
        let mut told = |value, name, low| told_correlation(value, name, low, warnings);
        let [rg, rb, gb] = channel;
        let channel_correlation = [told(rg, "R-G", -1.0), told(rb, "R-B", -1.0), told(gb, "G-B", -1.0)];
        let [right, below] = neighbour;
        let neighbour_correlation = [told(right, "to the right", 0.0), told(below, "below", 0.0)];
        Found { points, channel_correlation, neighbour_correlation }
    }
}

fn sums(plane: &Plane, frames: &[Pixels]) -> Sums {
    let mut sums = Sums::default();
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
            residuals.iter_mut().for_each(|values| plane.take_off(values));
            let products = residuals.each_ref().map(Plane::products);
            if clipped.iter().any(|n| *n > CLIPPED * pixels) {
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
