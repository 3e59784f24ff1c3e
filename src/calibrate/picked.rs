//! Noise of places that a person picked: rectangles of plain colour, in frames at rest or in any.
//!
//! At rest each rectangle is a scene (noise.rs): noise is what varies from frame to frame, texture does no harm. In a single
//! frame, or while the camera moves, noise is what blocks of 12×12 pixels show beside a plane (plane.rs). Other than
//! moving.rs it is not searched for among texture: all blocks count, and a place whose blocks differ by more than noise does
//! is refused. (Texture that is alike all over a place counts as noise here too.)
//!
//! Few intensities are picked. Beyond and between them the profile goes on as the present one does, scaled by the ratio of
//! what was measured to what it says there.

use super::bins::chi_square_interval;
use super::noise::{
    CHANNELS, CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions, SceneMotion, round4, told_correlation,
};
use super::plane::{ByLag, LAGS, NEIGHBOURS, Plane, SIDE};
use super::rounding::{Rounding, UNIT};
use crate::camera::{NoiseBin, NoiseProfile};
use crate::pixels::{Codes, Pixels, Rect};

/// Independent samples that make a point: σ within 7 %.
const NEEDED: f64 = 400.0;
/// Blocks that make a place.
const FEWEST_BLOCKS: usize = 4;
/// Blocks may spread this many times as much as noise does, and by chance.
const WIDEST: f64 = 1.6;
/// A block is left out if more than this share of it is at an end of the code range, as in moving.rs.
const CLIPPED: f64 = 0.02;
/// Points nearer than this become one, 8-bit codes.
const NEAR: f64 = 8.0;
const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// σ at an intensity, 8-bit codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoisePoint {
    pub code: f64,
    pub sigma: f64,
    /// 95 % confidence interval (χ²).
    pub sigma_ci95: [f64; 2],
    pub independent_count: f64,
}

impl NoiseCalibration {
    /// What was measured, without what is filled from neighbours; of R, G, B, ascending.
    pub fn points(&self) -> [Vec<NoisePoint>; 3] {
        self.bins.each_ref().map(|bins| {
            let measured = bins.iter().filter(|bin| !bin.filled_from_neighbours);
            let point = measured.filter_map(|bin| {
                let sigma_ci95 = bin.sigma_ci95?;
                let (code, sigma, independent_count) = (bin.code, bin.sigma, bin.independent_count);
                Some(NoisePoint { code, sigma, sigma_ci95, independent_count })
            });
            point.collect()
        })
    }
}

/// What picked places tell.
#[derive(Clone, Debug, PartialEq)]
pub struct PickedNoise {
    pub profile: NoiseProfile,
    /// What was measured, ascending, of R, G, B.
    pub points: [Vec<NoisePoint>; 3],
    pub motion: SceneMotion,
    pub frames: usize,
    /// Things a person should know before taking it.
    pub warnings: Vec<String>,
}

impl PickedNoise {
    /// The intensities that were measured, 8-bit codes.
    pub fn covered(&self) -> [f64; 2] {
        let codes = || self.points.iter().flatten().map(|point| point.code);
        [codes().fold(255.0, f64::min), codes().fold(0.0, f64::max)]
    }
}

/// Why picked places give no noise.
#[derive(Debug, thiserror::Error)]
pub enum PickedError {
    #[error("no place is picked: choose one or more rectangles of plain colour")]
    NoPlace,
    #[error("place {place}: {width}x{height} px is too small; {SIDE}x{SIDE} px and more are needed")]
    Small { place: usize, width: u32, height: u32 },
    #[error(
        "place {place}: only {blocks} of its pieces can be used, {FEWEST_BLOCKS} are needed: it is too small, or over- or underexposed"
    )]
    Few { place: usize, blocks: usize },
    #[error(
        "place {place} is not plain: its pieces differ {times:.1} times as much as noise does; choose one without texture or shadows"
    )]
    Textured { place: usize, times: f64 },
    #[error(
        "place {place} moves or changes from frame to frame; choose frames at rest, or measure within single frames"
    )]
    Moves { place: usize },
    #[error("noise at rest shows in the difference of frames: choose two or more")]
    OneFrame,
    #[error("{0} was not measured: its noise is too quiet, or clipped")]
    Channel(&'static str),
    #[error(transparent)]
    Calibrate(CalibrateError),
}

/// Noise of places (px, the same in every frame). `present` is the profile beyond what was measured; without one σ is
/// constant there.
pub fn picked_noise(
    frames: &[&Pixels],
    places: &[Rect],
    motion: SceneMotion,
    present: Option<&NoiseProfile>,
) -> Result<PickedNoise, PickedError> {
    let Some(first) = frames.first() else { return Err(PickedError::Calibrate(CalibrateError::NoFrames)) };
    let whole = Rect::full(first.width, first.height);
    let places: Vec<Rect> = places.iter().map(|place| place.intersection(&whole)).collect();
    if places.is_empty() {
        return Err(PickedError::NoPlace);
    }
    for (n, place) in places.iter().enumerate() {
        let (width, height) = (place.width(), place.height());
        if width.min(height) < SIDE as u32 {
            return Err(PickedError::Small { place: n + 1, width, height });
        }
    }
    let wrong = frames.iter().find(|frame| (frame.width, frame.height) != (first.width, first.height));
    if let Some(frame) = wrong {
        let size = |p: &Pixels| format!("{}x{}", p.width, p.height);
        let (expected, found) = (size(first), size(frame));
        return Err(PickedError::Calibrate(CalibrateError::Size { expected, found }));
    }
    let mut warnings = Vec::new();
    let found = match motion {
        SceneMotion::Resting => at_rest(frames, &places, &mut warnings)?,
        SceneMotion::Moving => in_frames(frames, &places, &mut warnings)?,
    };
    let Found { points, channel_correlation, neighbour_correlation } = found;
    let points = points.map(merged);
    if let Some(missing) = (0..3).find(|c| points[*c].is_empty()) {
        return Err(PickedError::Channel(CHANNELS[missing]));
    }
    let bins = [0, 1, 2].map(|c| continued(&points[c], present.map(|present| (present, c))));
    let profile = NoiseProfile { bins, channel_correlation, neighbour_correlation };
    Ok(PickedNoise { profile, points, motion, frames: frames.len(), warnings })
}

struct Found {
    points: [Vec<NoisePoint>; 3],
    channel_correlation: [f64; 3],
    neighbour_correlation: [f64; 2],
}

fn at_rest(frames: &[&Pixels], places: &[Rect], warnings: &mut Vec<String>) -> Result<Found, PickedError> {
    if frames.len() < 2 {
        return Err(PickedError::OneFrame);
    }
    let failed = |error| match error {
        CalibrateError::CameraMoves { scene, .. } | CalibrateError::SceneChanges { scene, .. } => {
            PickedError::Moves { place: scene }
        }
        error => PickedError::Calibrate(error),
    };
    let options = NoiseOptions { min_independent: NEEDED, ..NoiseOptions::default() };
    let mut calibrator = NoiseCalibrator::new(options).map_err(failed)?;
    for place in places {
        calibrator.begin_scene(None).map_err(failed)?;
        for frame in frames {
            calibrator.add_frame(&cut(frame, place)).map_err(failed)?;
        }
    }
    let calibration = calibrator.finish().map_err(failed)?;
    // Which bins are filled from others is plain from the range that is covered.
    let points = calibration.points();
    warnings.extend(calibration.warnings.into_iter().filter(|warning| !warning.contains("filled from")));
    let NoiseProfile { channel_correlation, neighbour_correlation, .. } = calibration.profile;
    Ok(Found { points, channel_correlation, neighbour_correlation })
}

/// A part of a picture.
fn cut(frame: &Pixels, place: &Rect) -> Pixels {
    let width = place.width() as usize;
    let rows = (place.y0..place.y1).map(|y| 3 * (y as usize * frame.width as usize + place.x0 as usize));
    let codes = match &frame.codes {
        Codes::U8(codes) => Codes::U8(rows.flat_map(|start| codes[start..start + 3 * width].iter().copied()).collect()),
        Codes::U16(codes) => {
            Codes::U16(rows.flat_map(|start| codes[start..start + 3 * width].iter().copied()).collect())
        }
    };
    Pixels { width: place.width(), height: place.height(), codes }
}

/// The sums over a place's blocks.
#[derive(Clone, Debug, Default)]
struct Sums {
    blocks: f64,
    mean: [f64; 3],
    products: [ByLag; 3],
    /// Squares of the blocks' variances.
    squares: [f64; 3],
    cross: [f64; 3],
}

fn in_frames(frames: &[&Pixels], places: &[Rect], warnings: &mut Vec<String>) -> Result<Found, PickedError> {
    let plane = Plane::new();
    let sums: Vec<Sums> = places.iter().map(|place| sums(&plane, frames, place)).collect();
    let too_few = sums.iter().position(|sums| (sums.blocks as usize) < FEWEST_BLOCKS);
    if let Some(n) = too_few {
        return Err(PickedError::Few { place: n + 1, blocks: sums[n].blocks as usize });
    }
    // The noise's correlation, from all places, each over its own variance.
    let total: f64 = sums.iter().map(|sums| sums.blocks).sum();
    let mut relative = [[0.0; LAGS]; 3];
    let mut cross = [0.0; 3];
    for sums in &sums {
        for c in 0..3 {
            for (sum, product) in relative[c].iter_mut().zip(sums.products[c]) {
                *sum += product / sums.products[c][0] * sums.blocks / total;
            }
            let (a, b) = PAIRS[c];
            cross[c] += sums.cross[c] / (sums.products[a][0] * sums.products[b][0]).sqrt() * sums.blocks / total;
        }
    }
    let covariance = relative.map(|relative| plane.covariance(&relative));
    let correlation = covariance.map(|r| r.map(|v| (v / r[0]).clamp(-1.0, 1.0)));
    let (kept, freedom) = (correlation.map(|r| plane.kept(&r)), correlation.map(|r| plane.freedom(&r)));
    let step = if frames.iter().any(|frame| frame.max_code() != 255) { 1.0 / UNIT as f64 } else { 1.0 };
    let rounding = Rounding { frame_step: step, mean_step: None };
    let mut points: [Vec<NoisePoint>; 3] = Default::default();
    let mut own = [0.0; 3];
    for (n, sums) in sums.iter().enumerate() {
        for c in 0..3 {
            let mean = sums.products[c][0] / sums.blocks;
            let spread = sums.squares[c] / sums.blocks / (mean * mean) - 1.0;
            let times = (spread / (2.0 / freedom[c])).sqrt();
            if times > WIDEST + (8.0 / sums.blocks).sqrt() {
                return Err(PickedError::Textured { place: n + 1, times });
            }
            let (variance, independent_count) = (mean / kept[c], sums.blocks * freedom[c]);
            let Some(factors) = chi_square_interval(independent_count) else { continue };
            let sigma_ci95 = factors.map(|factor| rounding.sigma(variance * factor));
            let (code, sigma) = (sums.mean[c] / sums.blocks, rounding.sigma(variance));
            own[c] += (sigma * sigma / variance) * sums.blocks / total;
            points[c].push(NoisePoint { code, sigma, sigma_ci95, independent_count });
        }
    }
    // Rounding is independent from pixel to pixel: it is no part of what neighbours share.
    let shared = |c: usize, k: usize| correlation[c][k] / own[c].max(1e-6);
    let neighbour = NEIGHBOURS.map(|k| Some((0..3).map(|c| shared(c, k)).sum::<f64>() / 3.0).filter(|r| r.is_finite()));
    let channel = [0, 1, 2].map(|i| {
        let (a, b) = PAIRS[i];
        Some(cross[i] / (own[a] * own[b]).sqrt()).filter(|r: &f64| r.is_finite())
    });
    let mut told = |value, name: &str, low| told_correlation(value, name, low, warnings);
    let [rg, rb, gb] = channel;
    let channel_correlation = [told(rg, "R-G", -1.0), told(rb, "R-B", -1.0), told(gb, "G-B", -1.0)];
    let [right, below] = neighbour;
    let neighbour_correlation = [told(right, "to the right", 0.0), told(below, "below", 0.0)];
    Ok(Found { points, channel_correlation, neighbour_correlation })
}

fn sums(plane: &Plane, frames: &[&Pixels], place: &Rect) -> Sums {
    let mut sums = Sums::default();
    let pixels = (SIDE * SIDE) as f64;
    let starts = |from: i32, to: i32| (from..=to - SIDE as i32).step_by(SIDE);
    for frame in frames {
        let scale = 255.0 / f64::from(frame.max_code());
        for (y0, x0) in starts(place.y0, place.y1).flat_map(|y| starts(place.x0, place.x1).map(move |x| (y, x))) {
            let mut residuals = [[0.0; SIDE * SIDE]; 3];
            let mut clipped = [0.0; 3];
            let at = |i: usize| frame.at((x0 as usize + i % SIDE) as u32, (y0 as usize + i / SIDE) as u32);
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
            if clipped.iter().any(|n| *n > CLIPPED * pixels) || products.iter().any(|p| p[0] <= 0.0) {
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

/// Ascending, with those that lie close together as one.
fn merged(mut points: Vec<NoisePoint>) -> Vec<NoisePoint> {
    points.sort_by(|a, b| a.code.total_cmp(&b.code));
    let mut out: Vec<NoisePoint> = Vec::new();
    for point in points {
        match out.last_mut() {
            Some(last) if point.code - last.code < NEAR => {
                let total = last.independent_count + point.independent_count;
                let mean = |a: f64, b: f64| (a * last.independent_count + b * point.independent_count) / total;
                let (code, variance) = (mean(last.code, point.code), mean(last.sigma.powi(2), point.sigma.powi(2)));
                let sigma = variance.sqrt();
                // What chance alone leaves, but no less than how far the two lie apart.
                let chance = chi_square_interval(total).unwrap_or([0.0, 2.0]).map(|factor| sigma * factor.sqrt());
                let sigma_ci95 =
                    [chance[0].min(last.sigma).min(point.sigma), chance[1].max(last.sigma).max(point.sigma)];
                *last = NoisePoint { code, sigma, sigma_ci95, independent_count: total };
            }
            _ => out.push(point),
        }
    }
    out
}

/// A channel's bins: the points, and beyond and between them the present profile, scaled to meet them.
fn continued(points: &[NoisePoint], present: Option<(&NoiseProfile, usize)>) -> Vec<NoiseBin> {
    let bin = |code: f64, sigma: f64| NoiseBin { code: round4(code), sigma: round4(sigma) };
    let mut bins: Vec<NoiseBin> = points.iter().map(|point| bin(point.code, point.sigma)).collect();
    if let Some((present, channel)) = present {
        let ratio = |point: &NoisePoint| point.sigma / present.sigma(channel, point.code).max(1e-3);
        for of_present in &present.bins[channel] {
            let after = points.partition_point(|point| point.code <= of_present.code);
            let (below, above) = (points.get(after.wrapping_sub(1)), points.get(after));
            if [below, above].into_iter().flatten().any(|point| (point.code - of_present.code).abs() < NEAR) {
                continue;
            }
            let ratio = match (below, above) {
                (Some(a), Some(b)) => {
                    let share = (of_present.code - a.code) / (b.code - a.code);
                    ratio(a) + share * (ratio(b) - ratio(a))
                }
                (Some(only), None) | (None, Some(only)) => ratio(only),
                (None, None) => 1.0,
            };
            bins.push(bin(of_present.code, of_present.sigma * ratio));
        }
    }
    bins.sort_by(|a, b| a.code.total_cmp(&b.code));
    bins
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(code: f64, sigma: f64) -> NoisePoint {
        NoisePoint { code, sigma, sigma_ci95: [0.9 * sigma, 1.1 * sigma], independent_count: 500.0 }
    }

    #[test]
    fn beyond_the_points_the_present_profile_goes_on_scaled() {
        let present =
            [0.0, 50.0, 100.0, 150.0, 200.0].map(|code| NoiseBin { code, sigma: 1.0 + code / 100.0 }).to_vec();
        let present = NoiseProfile {
            bins: [present.clone(), present.clone(), present],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        // At 50 it says 1.5 and 3 is found: twice. At 150 2.5 and 2.5: once. Between them 1.5 times.
        let bins = continued(&[point(50.0, 3.0), point(150.0, 2.5)], Some((&present, 1)));
        let expected = [(0.0, 2.0), (50.0, 3.0), (100.0, 3.0), (150.0, 2.5), (200.0, 3.0)];
        assert_eq!(bins.iter().map(|b| (b.code, b.sigma)).collect::<Vec<_>>(), expected);
        assert_eq!(continued(&[point(50.0, 3.0)], None), [NoiseBin { code: 50.0, sigma: 3.0 }]);
    }

    #[test]
    fn points_that_lie_close_become_one() {
        let all = merged(vec![point(90.0, 1.0), point(20.0, 2.0), point(24.0, 3.0)]);
        assert_eq!(all.len(), 2);
        assert!((all[0].code - 22.0).abs() < 1e-12 && (all[0].sigma - 6.5f64.sqrt()).abs() < 1e-12, "{all:?}");
        assert!(all[0].sigma_ci95[0] <= 2.0 && all[0].sigma_ci95[1] >= 3.0 && all[0].independent_count == 1000.0);
    }
}
