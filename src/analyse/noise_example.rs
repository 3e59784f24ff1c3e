//! Noise by example from a moving camera: the difference between a frame and its neighbours at the
//! same places of the scene.
//!
//! At each pixel of a frame with known depth, up to 8 neighbouring frames are sampled by cubic
//! convolution (Keys 1981) where they see the same point, by the poses of the analysis and with
//! their rolling shutter. Each is scaled by a factor for each channel, for its exposure. Samples
//! that differ from their median by more than noise are left out: they see another surface. The
//! mean of the others is the picture without noise.
//!
//! The residual of a pixel is its own code minus that mean, so the frame's noise is not
//! interpolated. The mean of n samples with factors gᵢ, whose squared weights sum to cᵢ, adds the
//! variance σ² Σ gᵢ² cᵢ / n²; [`CalibrationFrame::variance_gain`] takes it out.
//!
//! A place is used if poses that are wrong by 0.15 px change its codes by less than noise: where
//! the mean's gradient is small. That depends on the content alone, so that it selects no noise.
//! Where the residual's variance over 7 × 7 px exceeds 9 times that of noise, something moved.
//! The residual's own mean about a place, by a Gaussian of 24 px over usable pixels, is taken out:
//! light and vignetting differ between frames by more than noise does over such distances.
//!
//! Errors of registration at edges are not noise, but grow with the content's activity. Activity
//! is therefore clamped at half a standard deviation below its mean: noise at edges has the
//! strength of that beside them.
//!
//! Correlation of noise with the nearest frame (in time): Σ (own − mean)(sample − mean) over
//! Σ (own − mean)². Of independent noise it is 0, because the sample's part in the mean cancels the
//! mean's variance.
//!
//! Not modelled: the mean's own spectrum (interpolation smooths it), and detail that interpolation
//! removes from it.

use std::fmt;

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

use super::box_blur::cubic_weights;
use super::camera_model::CameraModel;
use super::depth_source::DepthSource;
use super::registration_result::RegistrationError;
use super::state::{CameraState, move_point, project_rolling_shutter};
use crate::camera::NoiseProfile;
use crate::coding::PictureCoding;
use crate::exemplar_noise::calibration::{CalibrationFrame, CodedFrame, calibrate_coded};
use crate::exemplar_noise::{NoiseModel, path::Planes};
use crate::fit::twist;
use crate::frame::Frame;
use crate::grey_image::GreyImage;
use crate::parallel::over_rows;
use crate::pixels::Codes;
use crate::recording::Recording;
use crate::text::count;

/// Number of frames whose noise becomes examples.
const FRAMES: usize = 6;
/// Largest sum of their pixels.
const MAX_PIXELS: usize = 1 << 22;
/// Distance of neighbours that are tried, and number of those that are used.
const REACH: usize = 10;
const NEIGHBOURS: usize = 8;
/// Fewest samples of a place.
const MIN_SAMPLES: usize = 4;
/// Frames that differ by less, in standard deviations of the noise, repeat each other. Independent
/// noise alone differs by 1.13.
const REPEATED: f64 = 0.4;
/// Largest difference of a sample from the median, standard deviations of the noise, and codes.
const MAX_DEVIATION: f32 = 4.0;
const MAX_DEVIATION_CODES: f32 = 2.0;
/// Half side of the areas over which residuals and gradients are averaged, px.
const AREA_RADIUS_PX: usize = 3;
/// Largest variance of an area's residual, relative to that of the noise of G.
const MAX_VARIANCE: f32 = 9.0;
/// Assumed error of the poses in the picture, px, and the largest variance by it, relative to that
/// of the noise of G.
const POSE_ERROR_PX: f32 = 0.15;
const MAX_POSE_VARIANCE: f32 = 0.5;
/// Standard deviation of the blur by which drift is found, px, and smallest share of usable pixels
/// that determine it.
const DRIFT_PX: f64 = 24.0;
const MIN_DRIFT_WEIGHT: f32 = 0.02;
/// Smallest share of an area's pixels with samples.
const MIN_KNOWN_SHARE: f32 = 0.7;
/// Smallest standard deviation of noise, codes: that of rounding.
const MIN_SIGMA: f32 = 0.3;
/// Codes of a channel by which exposures are compared.
const COMPARED_CODES: std::ops::RangeInclusive<f32> = 20.0..=235.0;
/// Distance of the pixels by which exposures and repeats are compared, px.
const COMPARED_STEP_PX: usize = 8;
/// Distance of samples from the picture's edge, px.
const MARGIN_PX: f64 = 2.0;
/// Blur of a frame where it has no samples, px: a picture without much noise.
const BLUR_PX: f64 = 2.0;
/// Smallest share of a frame's pixels that must be usable.
const MIN_USABLE_SHARE: f64 = 0.1;
/// Upper limit of activity, standard deviations from its mean.
const MAX_ACTIVITY_DEVIATIONS: f32 = -0.5;
/// Seed of the calibration's noise.
const SEED: u32 = 1;
/// Weights of brightness.
const BRIGHTNESS: [f32; 3] = [0.25, 0.5, 0.25];

/// Noise by example of a recording, without the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseExampleFindings {
    /// Why the recording has no noise by example.
    pub why: Option<String>,
    /// Number of frames that gave examples.
    pub frames: usize,
    /// Share of their pixels that were usable.
    pub usable_share: f64,
    /// Correlation of a frame's noise with that of the nearest frame, at the same points of the
    /// scene. Not drawn.
    pub frame_correlation: f64,
    /// SHA-256 of the model's file, hexadecimal.
    pub sha256: Option<String>,
}

impl fmt::Display for NoiseExampleFindings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.sha256.is_none() {
            return write!(f, "none of noise: {}", self.why.as_deref().unwrap_or("no reason is given"));
        }
        write!(
            f,
            "of noise, from {}, {:.0} % of their pixels; noise of neighbouring frames correlates by {:.2}",
            count(self.frames, "frame"),
            100.0 * self.usable_share,
            self.frame_correlation
        )
    }
}

/// The result of a search for examples.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct NoiseExamples {
    pub why: Option<String>,
    pub frames: usize,
    pub usable_share: f64,
    pub frame_correlation: f64,
    /// The model's file; empty without one.
    pub file: Vec<u8>,
}

/// The recording and its analysis, from which examples are taken.
pub struct ExampleInputs<'a> {
    pub recording: &'a Recording,
    pub model: &'a CameraModel,
    /// One for each frame.
    pub states: &'a [Option<CameraState>],
    /// Added to the depth maps' times, s.
    pub later_s: f64,
    pub noise: &'a NoiseProfile,
    pub threads: usize,
}

impl NoiseExamples {
    pub fn none(why: impl Into<String>) -> Self {
        Self { why: Some(why.into()), ..Self::default() }
    }
}

/// Searches a recording for examples.
pub fn examples(inputs: &ExampleInputs<'_>) -> Result<NoiseExamples, RegistrationError> {
    let (width, height) = inputs.model.size();
    let wanted = FRAMES.min(MAX_PIXELS / (width * height).max(1));
    if wanted == 0 {
        return Ok(NoiseExamples::none("the frames are too large for examples of their noise"));
    }
    if !inputs.recording.has_depth() || inputs.model.geometry.needs_cube_map() {
        return Ok(NoiseExamples::none("examples of a moving camera's noise need measured depth"));
    }
    let mut found: Vec<FrameExample> = Vec::new();
    let (mut usable, mut products) = (0.0, [0.0; 2]);
    let mut why = None;
    for target in slowest_frames(inputs, wanted) {
        match example(inputs, target)? {
            Ok(example) => {
                let frame = &example.0;
                let share = frame.mask.iter().filter(|usable| **usable).count() as f64 / frame.mask.len().max(1) as f64;
                if share < MIN_USABLE_SHARE {
                    why = Some(format!("only {:.0} % of a frame repeat in its neighbours", 100.0 * share));
                    continue;
                }
                usable += share;
                products.iter_mut().zip(example.2).for_each(|(sum, v)| *sum += v);
                found.push(example);
            }
            Err(reason) => why = Some(reason),
        }
    }
    if found.is_empty() {
        return Ok(NoiseExamples::none(why.unwrap_or_else(|| "no frame has neighbours with known poses".to_owned())));
    }
    let frames: Vec<CodedFrame<'_>> = found.iter().map(|(frame, coding, _)| CodedFrame { frame, coding }).collect();
    let model = calibrate_coded(&frames, SEED).and_then(|model| model.with_clamped_activity(MAX_ACTIVITY_DEVIATIONS));
    Ok(match model.map_err(|error| error.to_string()).and_then(|model| to_file(&model)) {
        Ok(file) => NoiseExamples {
            why: None,
            frames: frames.len(),
            usable_share: usable / frames.len() as f64,
            frame_correlation: products[0] / products[1].max(f64::MIN_POSITIVE),
            file,
        },
        Err(why) => NoiseExamples::none(why),
    })
}

fn to_file(model: &NoiseModel) -> Result<Vec<u8>, String> {
    crate::exemplar_noise::file::to_bytes(model).map_err(|error| error.to_string())
}

/// The slowest frame of each of `count` parts of the recording, in order.
fn slowest_frames(inputs: &ExampleInputs<'_>, count: usize) -> Vec<usize> {
    let frames = inputs.states.len();
    let focal_px = inputs.model.geometry.intrinsics.fx_px;
    let speed = |n: usize| {
        let state = inputs.states[n]?;
        let turning = twist::rotation_vector(&state.twist).length();
        let moving = twist::translation(&state.twist).length();
        Some(focal_px * (turning + moving / inputs.model.typical_depth_m))
    };
    let part = |k: usize| k * frames / count..(k + 1) * frames / count;
    let slowest = |k: usize| {
        let known = part(k).filter_map(|n| Some((n, speed(n)?)));
        known.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(n, _)| n)
    };
    (0..count).filter_map(slowest).collect()
}

/// A neighbour, and the factor for each channel by which it is scaled.
struct SampledFrame {
    planes: Planes,
    state: CameraState,
    gain: [f32; 3],
}

/// A frame with the mean of its neighbours, its coding, and two sums: of the products of its
/// residuals with those of the nearest frame, and of their squares.
type FrameExample = (CalibrationFrame, PictureCoding, [f64; 2]);

fn example(inputs: &ExampleInputs<'_>, target: usize) -> Result<Result<FrameExample, String>, RegistrationError> {
    let ExampleInputs { recording, model, states, noise, threads, .. } = *inputs;
    let (width, height) = model.size();
    let range = target.saturating_sub(REACH)..(target + REACH + 1).min(recording.frame_count());
    let mut read: Vec<Frame> = Vec::new();
    for frame in recording.frames(range.clone())? {
        read.push(frame?);
    }
    let frame = &read[target - range.start];
    let Some(state) = states[target] else { return Ok(Err("the frame's pose is unknown".to_owned())) };
    let Codes::U8(codes) = &frame.pixels.codes else {
        return Ok(Err("examples need frames of 8 bits".to_owned()));
    };
    let coding = frame.pixels.coding.as_deref().cloned().unwrap_or(PictureCoding::UNROUNDED);
    let is_grey = codes.as_chunks::<3>().0.iter().all(|[r, g, b]| r == g && g == b);
    if coding.chroma.is_none() || is_grey {
        return Ok(Err("examples need frames in colour".to_owned()));
    }
    let own = planes(codes, width, height);
    let mut source = DepthSource::new(model, recording, states, inputs.later_s, threads)?;
    let depth = source.of(model, frame, &state)?;
    let view = DepthView { model, state, depth: &depth };

    // The nearest first.
    let mut order: Vec<usize> = range.clone().filter(|n| *n != target && states[*n].is_some()).collect();
    order.sort_by_key(|n| n.abs_diff(target));
    let mut neighbours: Vec<SampledFrame> = Vec::new();
    for n in order {
        let (Codes::U8(codes), Some(state)) = (&read[n - range.start].pixels.codes, states[n]) else { continue };
        let planes = planes(codes, width, height);
        let repeats = std::iter::once(&own).chain(neighbours.iter().map(|other| &other.planes));
        if repeats.into_iter().any(|other| is_repeated(other, &planes, noise)) {
            continue;
        }
        let mut neighbour = SampledFrame { planes, state, gain: [1.0; 3] };
        if let Some(gain) = view.gain(&own, &neighbour) {
            neighbour.gain = gain;
            neighbours.push(neighbour);
        }
        if neighbours.len() == NEIGHBOURS {
            break;
        }
    }
    if neighbours.len() < MIN_SAMPLES {
        return Ok(Err(format!("a frame has {} different neighbours, expected {MIN_SAMPLES}", neighbours.len())));
    }
    // Mean, and the variance that it adds relative to that of a pixel; not finite without samples.
    let mut means = vec![[f32::NAN; 4]; width * height];
    let table = noise.table();
    over_rows(&mut means, width, threads, |y, row| {
        for (x, mean) in row.iter_mut().enumerate() {
            if let Some(found) = view.mean(&neighbours, x, y, &table) {
                *mean = found;
            }
        }
    });
    let frame = calibration_frame(&own, codes.clone(), &means, &table);
    let products = view.products(&own, &neighbours[0], &frame, &table);
    Ok(Ok((frame, coding, products)))
}

fn planes(codes: &[u8], width: usize, height: usize) -> Planes {
    let pixels = codes.as_chunks::<3>().0;
    std::array::from_fn(|c| GreyImage { width, height, values: pixels.iter().map(|p| f32::from(p[c])).collect() })
}

/// Whether two frames have the same noise.
fn is_repeated(a: &Planes, b: &Planes, noise: &NoiseProfile) -> bool {
    let pairs = a[1].values.iter().zip(&b[1].values).step_by(COMPARED_STEP_PX + 1);
    let (mut differences, mut sigmas) = (0.0, 0.0);
    for (a, b) in pairs {
        differences += f64::from((a - b).abs());
        sigmas += noise.sigma(1, f64::from(*a));
    }
    differences < REPEATED * sigmas
}

/// A frame's view of the scene.
struct DepthView<'a> {
    model: &'a CameraModel,
    state: CameraState,
    /// One for each pixel, m; 0 where unknown.
    depth: &'a [f32],
}

impl DepthView<'_> {
    /// The point at a pixel, world axes.
    fn point(&self, x: usize, y: usize) -> Option<DVec3> {
        let i = y * self.model.size().0 + x;
        let (z, ray) = (self.depth[i], self.model.rays[i]);
        if !(z > 0.0 && ray[0].is_finite()) {
            return None;
        }
        let at_row = f64::from(z) * DVec3::from(ray.map(f64::from));
        let row_s = self.model.geometry.row_time_s(y as f64 + 0.5);
        Some(self.state.world_from_camera.transform_point3(move_point(at_row, &self.state.twist, row_s)))
    }

    /// A neighbour's codes at a point near row `y`, before its gain, and the sum of the squared
    /// weights.
    fn sample(
        &self,
        neighbour: &SampledFrame,
        camera_from_world: &DAffine3,
        point: DVec3,
        y: usize,
    ) -> Option<[f32; 4]> {
        let there = camera_from_world.transform_point3(point);
        let geometry = &self.model.geometry;
        if there.z <= 0.0 {
            return None;
        }
        let (at, _) = project_rolling_shutter(geometry, there, &neighbour.state.twist, Some(y as f64 + 0.5), 2)?;
        let (width, height) = self.model.size();
        let inside =
            at.x > MARGIN_PX && at.y > MARGIN_PX && at.x < width as f64 - MARGIN_PX && at.y < height as f64 - MARGIN_PX;
        if !inside {
            return None;
        }
        let (u, v) = (at.x - 0.5, at.y - 0.5);
        let (column, row) = (u.floor() as usize - 1, v.floor() as usize - 1);
        let across = cubic_weights((u - u.floor()) as f32);
        let down = cubic_weights((v - v.floor()) as f32);
        let mut sums = [0.0f32; 4];
        for (c, plane) in neighbour.planes.iter().enumerate() {
            for (dy, weight) in down.iter().enumerate() {
                let values = &plane.values[(row + dy) * width + column..][..4];
                sums[c] += weight * values.iter().zip(across).map(|(v, w)| v * w).sum::<f32>();
            }
        }
        sums[3] = across.iter().map(|w| w * w).sum::<f32>() * down.iter().map(|w| w * w).sum::<f32>();
        Some(sums)
    }

    /// The factors on a neighbour's codes that make it as bright as this frame. `None` if they
    /// share too few pixels.
    fn gain(&self, own: &Planes, neighbour: &SampledFrame) -> Option<[f32; 3]> {
        let (width, height) = self.model.size();
        let camera_from_world = neighbour.state.world_from_camera.inverse();
        let mut ratios: [Vec<f32>; 3] = Default::default();
        for y in (0..height).step_by(COMPARED_STEP_PX) {
            for x in (0..width).step_by(COMPARED_STEP_PX) {
                let Some(point) = self.point(x, y) else { continue };
                let Some(found) = self.sample(neighbour, &camera_from_world, point, y) else { continue };
                for (c, ratios) in ratios.iter_mut().enumerate() {
                    let code = own[c].values[y * width + x];
                    if COMPARED_CODES.contains(&code) && COMPARED_CODES.contains(&found[c]) {
                        ratios.push(code / found[c]);
                    }
                }
            }
        }
        let mut gain = [1.0; 3];
        for (gain, ratios) in gain.iter_mut().zip(&mut ratios) {
            if ratios.len() < 50 {
                return None;
            }
            let middle = ratios.len() / 2;
            *gain = *ratios.select_nth_unstable_by(middle, f32::total_cmp).1;
        }
        Some(gain)
    }

    /// Sums over usable pixels: of the products of the frame's residual and a neighbour's, and of
    /// the squares of the frame's.
    fn products(
        &self,
        own: &Planes,
        neighbour: &SampledFrame,
        frame: &CalibrationFrame,
        table: &[[f32; 3]],
    ) -> [f64; 2] {
        let (width, height) = self.model.size();
        let camera_from_world = neighbour.state.world_from_camera.inverse();
        let mut sums = [0.0; 2];
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let i = y * width + x;
            let Some(point) = self.point(x, y).filter(|_| frame.mask[i]) else { continue };
            let Some(sample) = self.sample(neighbour, &camera_from_world, point, y) else { continue };
            let mean = frame.mean[1].values[i];
            let [residual, other] = [own[1].values[i] - mean, neighbour.gain[1] * sample[1] - mean];
            let sigma = table[mean.clamp(0.0, 255.0) as usize][1];
            if other.abs() > MAX_DEVIATION * sigma + MAX_DEVIATION_CODES {
                // Another surface.
                continue;
            }
            sums[0] += f64::from(residual * other);
            sums[1] += f64::from(residual * residual);
        }
        sums
    }

    /// Mean of the neighbours' samples at a pixel, and Σ gᵢ² cᵢ / n². `table`: σ by code.
    fn mean(&self, neighbours: &[SampledFrame], x: usize, y: usize, table: &[[f32; 3]]) -> Option<[f32; 4]> {
        let point = self.point(x, y)?;
        let mut samples: Vec<([f32; 4], f32)> = Vec::with_capacity(neighbours.len());
        for neighbour in neighbours {
            let camera_from_world = neighbour.state.world_from_camera.inverse();
            if let Some(mut sample) = self.sample(neighbour, &camera_from_world, point, y) {
                (0..3).for_each(|c| sample[c] *= neighbour.gain[c]);
                sample[3] *= neighbour.gain[1].powi(2);
                samples.push((sample, brightness(&sample)));
            }
        }
        if samples.len() < MIN_SAMPLES {
            return None;
        }
        samples.sort_by(|a, b| a.1.total_cmp(&b.1));
        let median = samples[samples.len() / 2].1;
        let sigma = table[median.clamp(0.0, 255.0) as usize][1];
        let within = MAX_DEVIATION * sigma + MAX_DEVIATION_CODES;
        let mut sum = [0.0; 4];
        let mut count = 0;
        for (sample, _) in samples.iter().filter(|(_, light)| (light - median).abs() <= within) {
            sum.iter_mut().zip(sample).for_each(|(sum, v)| *sum += v);
            count += 1;
        }
        let n = count as f32;
        (count >= MIN_SAMPLES).then(|| [sum[0] / n, sum[1] / n, sum[2] / n, sum[3] / (n * n)])
    }
}

fn brightness(rgb: &[f32; 4]) -> f32 {
    BRIGHTNESS.iter().zip(rgb).map(|(weight, v)| weight * v).sum()
}

/// Adds the residual's low frequencies to the means.
fn remove_drift(own: &Planes, mean: &mut Planes, mask: &[bool]) {
    let (width, height) = (own[0].width, own[0].height);
    let blurred = |value: &dyn Fn(usize) -> f32| {
        let value = |i: usize| if mask[i] { value(i) } else { 0.0 };
        GreyImage { width, height, values: (0..width * height).map(value).collect() }.blurred(DRIFT_PX)
    };
    let weights = blurred(&|_| 1.0);
    for (own, mean) in own.iter().zip(mean) {
        let sums = blurred(&|i| own.values[i] - mean.values[i]);
        for ((mean, sum), weight) in mean.values.iter_mut().zip(&sums.values).zip(&weights.values) {
            *mean += sum / weight.max(MIN_DRIFT_WEIGHT);
        }
    }
}

/// A frame with its means, where the residual is noise.
fn calibration_frame(own: &Planes, codes: Vec<u8>, means: &[[f32; 4]], table: &[[f32; 3]]) -> CalibrationFrame {
    let (width, height) = (own[0].width, own[0].height);
    let blurred = own.each_ref().map(|plane| plane.blurred(BLUR_PX));
    let mean: Planes = std::array::from_fn(|c| {
        let value = |(i, mean): (usize, &[f32; 4])| if mean[3].is_finite() { mean[c] } else { blurred[c].values[i] };
        GreyImage { width, height, values: means.iter().enumerate().map(value).collect() }
    });
    let light = |rgb: &Planes, i: usize| {
        BRIGHTNESS.iter().zip(rgb).map(|(weight, plane)| weight * plane.values[i]).sum::<f32>()
    };
    let (along, down) = GreyImage::from_fn(width, height, |x, y| light(&mean, y * width + x)).sobel();
    // Of each pixel with samples: 1, the residual's variance and that by the poses' error, relative
    // to that of noise. 0 without.
    let relative = |i: usize| {
        let sigma = table[light(&mean, i).clamp(0.0, 255.0) as usize][1].max(MIN_SIGMA);
        let residual = light(own, i) - light(&mean, i);
        let gradient = along.values[i].powi(2) + down.values[i].powi(2);
        let variances = [residual * residual / (1.0 + means[i][3]), POSE_ERROR_PX * POSE_ERROR_PX * gradient];
        if means[i][3].is_finite() {
            [1.0, variances[0] / (sigma * sigma), variances[1] / (sigma * sigma)]
        } else {
            [0.0; 3]
        }
    };
    let relative: Vec<[f32; 3]> = (0..width * height).map(relative).collect();
    let kernel = [1.0; AREA_RADIUS_PX + 1];
    let sums: [GreyImage; 3] = std::array::from_fn(|k| {
        GreyImage { width, height, values: relative.iter().map(|v| v[k]).collect() }.filtered(&kernel)
    });
    let whole = (2 * AREA_RADIUS_PX + 1).pow(2) as f32;
    let mask: Vec<bool> = (0..width * height)
        .map(|i| {
            let [n, residual, by_poses] = sums.each_ref().map(|sum| sum.values[i]);
            n > MIN_KNOWN_SHARE * whole
                && means[i][3].is_finite()
                && residual < MAX_VARIANCE * n
                && by_poses < MAX_POSE_VARIANCE * n
        })
        .collect();
    let mut mean = mean;
    remove_drift(own, &mut mean, &mask);
    let added = || means.iter().zip(&mask).filter(|(_, usable)| **usable).map(|(mean, _)| f64::from(mean[3]));
    let mean_added = added().sum::<f64>() / added().count().max(1) as f64;
    CalibrationFrame { mean, noisy: codes, mask, variance_gain: (1.0 / (1.0 + mean_added)) as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Geometry, NoiseBin};
    use crate::fit::twist::Twist;
    use crate::hash::pcg3d;

    const WIDTH: usize = 160;
    const HEIGHT: usize = 120;
    const SIGMA: f32 = 3.0;

    fn noise(i: usize, seed: u32) -> f32 {
        let word = pcg3d([i as u32, seed, 0])[0];
        (word as f32 / u32::MAX as f32 - 0.5) * 12.0f32.sqrt() * SIGMA
    }

    /// A camera `step` cm to the right of the first, before a wall at 2 m with a step of brightness
    /// at its middle.
    fn neighbour(step: f64, seed: u32, exposure: f32) -> SampledFrame {
        let shift_px = 100.0 * 0.01 * step / 2.0;
        let light = |x: f64| if x + shift_px < 80.0 { 60.0 } else { 140.0 };
        let plane = |c: u32| {
            GreyImage::from_fn(WIDTH, HEIGHT, |x, y| exposure * light(x as f64) + noise(y * WIDTH + x, 3 * seed + c))
        };
        let world_from_camera = DAffine3::from_translation(DVec3::X * 0.01 * step);
        let state = CameraState { world_from_camera, twist: Twist::zeros() };
        SampledFrame { planes: [0, 1, 2].map(plane), state, gain: [1.0; 3] }
    }

    fn table() -> NoiseProfile {
        let bins = vec![NoiseBin { code: 128.0, sigma: f64::from(SIGMA) }];
        NoiseProfile {
            bins: [bins.clone(), bins.clone(), bins],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
            example: None,
        }
    }

    #[test]
    fn mean_of_neighbours_follows_exposure_and_leaves_out_what_moved() {
        let model = CameraModel::new(Geometry::pinhole(WIDTH as u32, HEIGHT as u32, 100.0));
        let own = neighbour(0.0, 0, 1.0);
        let view = DepthView { model: &model, state: own.state, depth: &[2.0; WIDTH * HEIGHT] };
        let mut neighbours: Vec<SampledFrame> = (1..=8)
            .map(|n| {
                let mut neighbour = neighbour(2.0 * f64::from(n) - 9.0, n, if n == 3 { 0.8 } else { 1.0 });
                neighbour.gain = view.gain(&own.planes, &neighbour).expect("enough pixels");
                neighbour
            })
            .collect();
        assert!((neighbours[2].gain[1] - 1.25).abs() < 0.02, "{:?}", neighbours[2].gain);
        // Something white passes before one of them.
        neighbours[5].planes.iter_mut().for_each(|plane| plane.values.fill(250.0));
        let table = table().table();
        let (mut squares, mut added, mut count) = (0.0, 0.0, 0.0);
        for (x, y) in (20..60).flat_map(|x| (10..110).map(move |y| (x, y))) {
            let mean = view.mean(&neighbours, x, y, &table).expect("eight samples");
            squares += (mean[1] - 60.0).powi(2);
            added += mean[3];
            count += 1.0;
        }
        // Seven samples; the scaled one has 1.25² of their variance.
        let expected = SIGMA * SIGMA * added / count;
        assert!((squares / count / expected - 1.0).abs() < 0.15, "{} {expected}", squares / count);
        assert!(added / count < 1.1 / 7.0 && added / count > 0.4 / 7.0, "interpolation averages: {}", added / count);
    }

    #[test]
    fn edges_changes_and_places_without_samples_are_masked() {
        let own = neighbour(0.0, 0, 1.0).planes;
        let mean = |i: usize| if i % WIDTH < 80 { 60.0 } else { 140.0 };
        let mut means: Vec<[f32; 4]> = (0..WIDTH * HEIGHT).map(|i| [mean(i), mean(i), mean(i), 0.1]).collect();
        for (x, y) in (20..40).flat_map(|x| (30..50).map(move |y| (x, y))) {
            means[y * WIDTH + x] = [90.0, 90.0, 90.0, 0.1];
        }
        for (x, y) in (120..140).flat_map(|x| (30..50).map(move |y| (x, y))) {
            means[y * WIDTH + x] = [f32::NAN; 4];
        }
        let codes = own[0].values.iter().flat_map(|v| [v.round() as u8; 3]).collect();
        let frame = calibration_frame(&own, codes, &means, &table().table());
        let usable = |x: usize, y: usize| frame.mask[y * WIDTH + x];
        assert!(usable(30, 90) && usable(110, 90) && usable(60, 40));
        assert!(!usable(79, 90) && !usable(82, 60), "the edge");
        assert!(!usable(30, 40), "a change by 30 codes");
        assert!(!usable(130, 40) && frame.mean[1].values[40 * WIDTH + 130].is_finite());
        assert!((frame.variance_gain - 1.0 / 1.1).abs() < 1e-3);
    }

    #[test]
    fn repeated_frames_are_recognised() {
        let frames = [1, 2].map(|seed| neighbour(0.0, seed, 1.0).planes);
        let mut again = frames[0].clone();
        again.iter_mut().flat_map(|plane| &mut plane.values).for_each(|v| *v = v.round());
        assert!(is_repeated(&frames[0], &again, &table()) && !is_repeated(&frames[0], &frames[1], &table()));
    }
}
