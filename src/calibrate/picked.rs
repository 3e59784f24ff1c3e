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
    CHANNELS, CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions, SceneMotion, told_correlation,
};
use super::plane::{ByLag, LAGS, NEIGHBOURS, Plane, SIDE};
use super::points::{NoisePoint, continued, merged};
use super::rounding::{Rounding, UNIT};
use crate::camera::NoiseProfile;
use crate::pixels::{Codes, Pixels, Rect};

/// Independent samples that make a point: σ within 7 %.
const NEEDED: f64 = 400.0;
/// Blocks that make a place.
const FEWEST_BLOCKS: usize = 4;
/// Blocks may spread this many times as much as noise does, and by chance.
const WIDEST: f64 = 1.6;
/// A block is left out if more than this share of it is at an end of the code range, as in moving.rs.
const CLIPPED: f64 = 0.02;
const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

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

/// Picked places (px, the same in every frame), with their pixels of each frame: of a frame nothing else is held.
#[derive(Clone, Debug)]
pub struct PickedPlaces {
    places: Vec<Rect>,
    /// Of the frames.
    size: Option<(u32, u32)>,
    frames: usize,
    /// Of each place, in the order of the frames.
    cuts: Vec<Vec<Pixels>>,
}

impl PickedPlaces {
    pub fn new(places: &[Rect]) -> Self {
        Self { places: places.to_vec(), size: None, frames: 0, cuts: vec![Vec::new(); places.len()] }
    }

    /// Takes what a frame shows in the places. Refuses a place that is too small in it, and a frame of another size.
    pub fn add(&mut self, frame: &Pixels) -> Result<(), PickedError> {
        let (width, height) = *self.size.get_or_insert((frame.width, frame.height));
        if (frame.width, frame.height) != (width, height) {
            let (expected, found) = (format!("{width}x{height}"), format!("{}x{}", frame.width, frame.height));
            return Err(PickedError::Calibrate(CalibrateError::Size { expected, found }));
        }
        for (n, (place, cuts)) in self.places.iter().zip(&mut self.cuts).enumerate() {
            let place = place.intersection(&Rect::full(width, height));
            let (width, height) = (place.width(), place.height());
            if width.min(height) < SIDE as u32 {
                return Err(PickedError::Small { place: n + 1, width, height });
            }
            cuts.push(cut(frame, &place));
        }
        self.frames += 1;
        Ok(())
    }

    /// The noise of what was taken. `present` is the profile beyond what was measured; without one σ is constant there.
    pub fn noise(&self, motion: SceneMotion, present: Option<&NoiseProfile>) -> Result<PickedNoise, PickedError> {
        if self.frames == 0 {
            return Err(PickedError::Calibrate(CalibrateError::NoFrames));
        }
        if self.places.is_empty() {
            return Err(PickedError::NoPlace);
        }
        let mut warnings = Vec::new();
        let found = match motion {
            SceneMotion::Resting => at_rest(&self.cuts, &mut warnings)?,
            SceneMotion::Moving => in_frames(&self.cuts, &mut warnings)?,
        };
        let Found { points, channel_correlation, neighbour_correlation } = found;
        let points = points.map(merged);
        if let Some(missing) = (0..3).find(|c| points[*c].is_empty()) {
            return Err(PickedError::Channel(CHANNELS[missing]));
        }
        let bins = [0, 1, 2].map(|c| continued(&points[c], present.map(|present| (present, c))));
        let profile = NoiseProfile { bins, channel_correlation, neighbour_correlation };
        Ok(PickedNoise { profile, points, motion, frames: self.frames, warnings })
    }
}

/// The same of frames that are there already.
pub fn picked_noise(
    frames: &[&Pixels],
    places: &[Rect],
    motion: SceneMotion,
    present: Option<&NoiseProfile>,
) -> Result<PickedNoise, PickedError> {
    let mut picked = PickedPlaces::new(places);
    frames.iter().try_for_each(|frame| picked.add(frame))?;
    picked.noise(motion, present)
}

struct Found {
    points: [Vec<NoisePoint>; 3],
    channel_correlation: [f64; 3],
    neighbour_correlation: [f64; 2],
}

fn at_rest(places: &[Vec<Pixels>], warnings: &mut Vec<String>) -> Result<Found, PickedError> {
    if places.iter().any(|frames| frames.len() < 2) {
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
        place.iter().try_for_each(|frame| calibrator.add_frame(frame)).map_err(failed)?;
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

fn in_frames(places: &[Vec<Pixels>], warnings: &mut Vec<String>) -> Result<Found, PickedError> {
    let plane = Plane::new();
    let sums: Vec<Sums> = places.iter().map(|frames| sums(&plane, frames)).collect();
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
    let step = if places.iter().flatten().any(|frame| frame.max_code() != 255) { 1.0 / UNIT as f64 } else { 1.0 };
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

/// Of one place, as the frames show it.
fn sums(plane: &Plane, frames: &[Pixels]) -> Sums {
    let mut sums = Sums::default();
    let pixels = (SIDE * SIDE) as f64;
    let starts = |length: u32| (0..=length as usize - SIDE).step_by(SIDE);
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
