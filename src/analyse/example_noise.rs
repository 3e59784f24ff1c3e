//! Noise by example from a moving camera: the difference between a frame and its neighbours at the
//! same places of the scene, where depth is measured. Without it, the textureless places of single
//! frames ([`flat_places`](crate::example_noise::flat_places)).
//!
//! The mean of up to 8 neighbouring frames at the same points, by measured depth and the poses of
//! the analysis, is a frame's picture without noise ([`neighbour_mean`](super::neighbour_mean)).
//!
//! The residual of a pixel is its own code minus that mean, so the frame's noise is not
//! interpolated. The mean of n samples with factors gᵢ, whose squared weights sum to cᵢ, adds the
//! variance σ² Σ gᵢ² cᵢ / n²; [`CalibrationFrame::variance_gain`] takes it out.
//!
//! A place is used if poses that are wrong by 0.15 px change its codes by less than 0.22 σ of the
//! noise: where the mean's gradient is small. That depends on the content alone, so that it selects
//! no noise.
//! Where the residual's variance over 7 × 7 px exceeds 9 times that of noise, something moved.
//! The residual's own mean about a place, by a Gaussian of 24 px over usable pixels, is taken out:
//! light and vignetting differ between frames by more than noise does over such distances.
//!
//! Errors of registration at edges are not noise, but grow with the content's activity. Activity
//! is therefore clamped at half a standard deviation below its mean: noise at edges has the
//! strength of that beside them. Textureless places contain no activity to calibrate from, so the
//! same limit holds.
//!
//! Correlation of noise with the nearest frame (in time): Σ (own − mean)(sample − mean) over
//! Σ (own − mean)². Of independent noise it is 0, because the sample's part in the mean cancels the
//! mean's variance.
//!
//! Not modelled: the mean's own spectrum (interpolation smooths it), and detail that interpolation
//! removes from it.

use std::ops::Range;

use super::camera_model::CameraModel;
use super::depth_source::SingleFrameDepth;
use super::example_noise_findings::{ExampleNoiseEstimate, ExampleOrigin};
use super::neighbour_mean::{DepthView, MAX_NEIGHBOURS, MIN_SAMPLES, SampledFrame};
use super::registration_result::RegistrationError;
use super::spread::stillest_frames;
use super::state::CameraState;
use crate::calibrate::RestingExample;
use crate::camera::NoiseProfile;
use crate::coding::PictureCoding;
use crate::example_noise::calibration::{CalibrationFrame, CodedFrame, calibrate_coded, calibrate_smooth_places};
use crate::example_noise::content::brightness;
use crate::example_noise::flat_places::textureless_places;
use crate::example_noise::masked_blur::MaskedBlur;
use crate::example_noise::path::{Planes, rgb_of_codes};
use crate::frame::Frame;
use crate::grey_image::GreyImage;
use crate::parallel::over_rows;
use crate::pixels::Codes;
use crate::recording::Recording;

/// Number of frames from which noise is taken, with neighbours and by textureless places.
const FRAMES: usize = 6;
const TEXTURELESS_FRAMES: usize = 12;
/// Fewest and largest number of frames of a stretch at rest.
const MIN_REST_FRAMES: usize = 12;
const MAX_REST_FRAMES: usize = 64;
/// Largest sum of their pixels.
const MAX_PIXELS: usize = 1 << 22;
/// Distance of neighbours that are tried.
const REACH: usize = 10;
/// Frames that differ by less, in standard deviations of the noise, repeat each other. Independent
/// noise alone differs by 1.13.
const REPEATED: f64 = 0.4;
/// Half side of the areas over which residuals and gradients are averaged, px.
const AREA_RADIUS_PX: usize = 3;
/// Largest variance of an area's residual, relative to that of the noise of G.
const MAX_VARIANCE: f32 = 9.0;
/// Assumed error of the poses in the picture, px, and the largest variance by it, relative to that
/// of the noise of G.
const POSE_ERROR_PX: f32 = 0.15;
const MAX_POSE_VARIANCE: f32 = 0.05;
/// Standard deviation of the blur by which drift is found, px.
const DRIFT_PX: f64 = 24.0;
/// Smallest share of an area's pixels with samples.
const MIN_KNOWN_SHARE: f32 = 0.7;
/// Smallest standard deviation of noise, codes: that of rounding.
const MIN_SIGMA: f32 = 0.3;
/// Step in pixel index between the pixels that are compared to recognise repeated frames.
const REPEAT_STEP: usize = 9;
/// Blur of a frame where it has no samples, px: a picture without much noise.
const BLUR_PX: f64 = 2.0;
/// Smallest share of a frame's pixels that must be usable.
const MIN_USABLE_SHARE: f64 = 0.1;
/// Upper limit of activity, standard deviations from its mean.
const MAX_ACTIVITY_DEVIATIONS: f32 = -0.5;
/// Seed of the calibration's noise.
const SEED: u32 = 1;

/// The recording and its analysis, from which examples are taken.
pub struct ExampleInputs<'a> {
    pub recording: &'a Recording,
    pub model: &'a CameraModel,
    /// One for each frame.
    pub states: &'a [Option<CameraState>],
    /// Whether the states are reliable.
    pub has_poses: bool,
    /// The longest stretch in which camera and scene are at rest.
    pub rest: Range<usize>,
    /// Added to the depth maps' times, s.
    pub later_s: f64,
    pub noise: &'a NoiseProfile,
    pub threads: usize,
}

/// Searches a recording for examples: in a stretch at rest, by neighbouring frames where depth is
/// measured, or in textureless places. The inner error is the reason for which there are none.
pub fn examples(inputs: &ExampleInputs<'_>) -> Result<Result<ExampleNoiseEstimate, String>, RegistrationError> {
    let (width, height) = inputs.model.size();
    let possible = MAX_PIXELS / (width * height).max(1);
    if possible == 0 {
        return Ok(Err("the frames are too large for examples of their noise".to_owned()));
    }
    if inputs.rest.len() >= MIN_REST_FRAMES
        && let Ok(examples) = of_rest(inputs)?
    {
        return Ok(Ok(examples));
    }
    let has_neighbours = inputs.has_poses && inputs.recording.has_depth() && !inputs.model.geometry.needs_cube_map();
    if has_neighbours {
        let max_frames = possible.min(FRAMES);
        let examples =
            of_frames(inputs, max_frames, ExampleOrigin::Neighbours, by_neighbours, "repeats in its neighbours")?;
        if examples.is_ok() {
            return Ok(examples);
        }
    }
    let max_frames = possible.min(TEXTURELESS_FRAMES);
    of_frames(inputs, max_frames, ExampleOrigin::Textureless, by_textureless_places, "is without texture")
}

/// Examples of the stretch at rest. The inner error is the reason for which there are none.
fn of_rest(inputs: &ExampleInputs<'_>) -> Result<Result<ExampleNoiseEstimate, String>, RegistrationError> {
    let rest = inputs.rest.start..inputs.rest.end.min(inputs.rest.start + MAX_REST_FRAMES);
    let mut example = match RestingExample::new(rest.len()) {
        Ok(example) => example,
        Err(error) => return Ok(Err(error.to_string())),
    };
    for frame in inputs.recording.frames(rest)? {
        if let Err(error) = example.add(&frame?.pixels) {
            return Ok(Err(error.to_string()));
        }
    }
    let finished = match example.finish() {
        Ok(Ok(example)) => example,
        Ok(Err(error)) => return Ok(Err(error.to_string())),
        Err(error) => return Ok(Err(error.to_string())),
    };
    let frames = finished.model.sources.len();
    Ok(ExampleNoiseEstimate::of(&finished.model, ExampleOrigin::Rest, frames, finished.usable_share, None))
}

/// Examples of up to `max_frames` frames by a method; `usable_places` describes its places. The
/// inner error is the reason for which there are none.
fn of_frames(
    inputs: &ExampleInputs<'_>,
    max_frames: usize,
    origin: ExampleOrigin,
    method: impl Fn(&ExampleInputs<'_>, usize) -> Result<Result<FrameExample, String>, RegistrationError>,
    usable_places: &str,
) -> Result<Result<ExampleNoiseEstimate, String>, RegistrationError> {
    let mut examples: Vec<FrameExample> = Vec::new();
    let (mut usable, mut products) = (0.0, [0.0; 2]);
    let mut why = None;
    for target in targets(inputs, max_frames) {
        match method(inputs, target)? {
            Ok(example) => {
                let frame = &example.0;
                let share = frame.mask.iter().filter(|usable| **usable).count() as f64 / frame.mask.len().max(1) as f64;
                if share < MIN_USABLE_SHARE {
                    why = Some(format!("only {:.0} % of a frame {usable_places}", 100.0 * share));
                    continue;
                }
                usable += share;
                products.iter_mut().zip(example.2).for_each(|(sum, v)| *sum += v);
                examples.push(example);
            }
            Err(reason) => why = Some(reason),
        }
    }
    if examples.is_empty() {
        return Ok(Err(why.unwrap_or_else(|| "no frame has a known pose".to_owned())));
    }
    let frames: Vec<CodedFrame<'_>> = examples.iter().map(|(frame, coding, _)| CodedFrame { frame, coding }).collect();
    let calibrate = match origin {
        ExampleOrigin::Neighbours => calibrate_smooth_places,
        _ => calibrate_coded,
    };
    let model = calibrate(&frames, SEED).and_then(|model| model.with_clamped_activity(MAX_ACTIVITY_DEVIATIONS));
    let usable_share = usable / frames.len() as f64;
    let correlation = (products[1] > 0.0).then(|| products[0] / products[1]);
    Ok(match model {
        Ok(model) => ExampleNoiseEstimate::of(
            &model.with_frame_correlation(correlation.unwrap_or(0.0) as f32),
            origin,
            frames.len(),
            usable_share,
            correlation,
        ),
        Err(error) => Err(error.to_string()),
    })
}

/// Frames that give examples: those with the slowest camera, or evenly spaced ones without poses.
fn targets(inputs: &ExampleInputs<'_>, max_frames: usize) -> Vec<usize> {
    if inputs.has_poses {
        return stillest_frames(inputs.states, max_frames);
    }
    inputs.recording.spread_frames(max_frames).collect()
}

/// A frame with its picture without noise, its coding, and two sums: of the products of its
/// residuals with those of the nearest frame, and of their squares.
type FrameExample = (CalibrationFrame, PictureCoding, [f64; 2]);

/// Codes of a frame and their coding, if a model can be made of them.
fn coded(recording: &Recording, frame: &Frame) -> Result<(Vec<u8>, PictureCoding), String> {
    let Codes::U8(codes) = &frame.pixels.codes else {
        return Err("examples need frames of 8 bits".to_owned());
    };
    // As composites have it.
    let coding = frame.pixels.coding.clone().or_else(|| recording.estimated_coding());
    let coding = coding.as_deref().cloned().unwrap_or(PictureCoding::UNROUNDED);
    let is_grey = codes.as_chunks::<3>().0.iter().all(|[r, g, b]| r == g && g == b);
    if coding.chroma.is_none() || is_grey {
        return Err("examples need frames in colour".to_owned());
    }
    Ok((codes.clone(), coding))
}

fn by_textureless_places(
    inputs: &ExampleInputs<'_>,
    target: usize,
) -> Result<Result<FrameExample, String>, RegistrationError> {
    let (width, height) = inputs.model.size();
    let Some(frame) = inputs.recording.frames(target..target + 1)?.next() else {
        return Ok(Err("a frame is missing".to_owned()));
    };
    Ok(coded(inputs.recording, &frame?).map(|(codes, coding)| {
        let frame = textureless_places(codes, [width, height], &inputs.noise.table());
        (frame, coding, [0.0; 2])
    }))
}

fn by_neighbours(inputs: &ExampleInputs<'_>, target: usize) -> Result<Result<FrameExample, String>, RegistrationError> {
    let ExampleInputs { recording, model, states, noise, threads, .. } = *inputs;
    let (width, height) = model.size();
    let range = target.saturating_sub(REACH)..(target + REACH + 1).min(recording.frame_count());
    let mut read: Vec<Frame> = Vec::new();
    for frame in recording.frames(range.clone())? {
        read.push(frame?);
    }
    let frame = &read[target - range.start];
    let Some(state) = states[target] else { return Ok(Err("the frame's pose is unknown".to_owned())) };
    let (codes, coding) = match coded(recording, frame) {
        Ok(coded) => coded,
        Err(why) => return Ok(Err(why)),
    };
    let own = rgb_of_codes(&codes, [width, height]);
    let depth = SingleFrameDepth::new(recording, inputs.later_s).of(model, frame, &state);
    let view = DepthView { model, state, depth: &depth };

    // The nearest first.
    let mut order: Vec<usize> = range.clone().filter(|n| *n != target && states[*n].is_some()).collect();
    order.sort_by_key(|n| n.abs_diff(target));
    let mut neighbours: Vec<SampledFrame> = Vec::new();
    for n in order {
        let (Codes::U8(codes), Some(state)) = (&read[n - range.start].pixels.codes, states[n]) else { continue };
        let planes = rgb_of_codes(codes, [width, height]);
        let repeats = std::iter::once(&own).chain(neighbours.iter().map(|other| &other.planes));
        if repeats.into_iter().any(|other| is_repeated(other, &planes, noise)) {
            continue;
        }
        let mut neighbour = SampledFrame::new(planes, &state);
        if let Some(gain) = view.gain(&own, &neighbour) {
            neighbour.gain = gain;
            neighbours.push(neighbour);
        }
        if neighbours.len() == MAX_NEIGHBOURS {
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
            if let Some(value) = view.mean(&neighbours, x, y, &table) {
                *mean = value;
            }
        }
    });
    let frame = calibration_frame(&own, codes, &means, &table);
    let products = view.products(&own, &neighbours[0], &frame, &table);
    Ok(Ok((frame, coding, products)))
}

/// Whether two frames have the same noise.
fn is_repeated(a: &Planes, b: &Planes, noise: &NoiseProfile) -> bool {
    let pairs = a[1].values.iter().zip(&b[1].values).step_by(REPEAT_STEP);
    let (mut differences, mut sigmas) = (0.0, 0.0);
    for (a, b) in pairs {
        differences += f64::from((a - b).abs());
        sigmas += noise.sigma(1, f64::from(*a));
    }
    differences < REPEATED * sigmas
}

/// Adds the residual's low frequencies to the means.
fn remove_drift(own: &Planes, mean: &mut Planes, mask: &[bool]) {
    let blur = MaskedBlur::new(mask, [own[0].width, own[0].height], DRIFT_PX);
    for (own, mean) in own.iter().zip(mean) {
        let drift = blur.mean_of(|i| own.values[i] - mean.values[i]);
        mean.values.iter_mut().zip(&drift.values).for_each(|(mean, drift)| *mean += drift);
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
    let light = |rgb: &Planes, i: usize| brightness(rgb.each_ref().map(|plane| plane.values[i]));
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
    use super::super::neighbour_mean::tests::{HEIGHT, WIDTH, neighbour, table};
    use super::*;
    use crate::camera::Geometry;
    use crate::hash::pcg3d;
    use crate::recording::OpenOptions;

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

    // Slow: calibrates two models.
    #[test]
    fn recording_without_depth_gives_examples_of_its_rest_or_of_textureless_places() {
        const SIDE: u32 = 176;
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("rgb")).unwrap();
        for frame in 0..MIN_REST_FRAMES as u32 {
            let picture = image::RgbImage::from_fn(SIDE, SIDE, |x, y| {
                let words = pcg3d([x, y, frame]);
                image::Rgb(words.map(|word| (80.0 + 0.4 * x as f32 + 10.0 * (word as f32 / u32::MAX as f32)) as u8))
            });
            picture.save(temp.path().join(format!("rgb/{frame:02}.png"))).unwrap();
        }
        std::fs::write(temp.path().join("recording.toml"), "version = 1\n[frames]\nimages = \"rgb\"\nfps = 30.0\n")
            .unwrap();
        let recording = Recording::open(temp.path(), &OpenOptions::default()).unwrap();
        let model = CameraModel::new(Geometry::pinhole(SIDE, SIDE, 150.0));
        let examples_of_rest = |rest: Range<usize>| {
            let states = &[None; MIN_REST_FRAMES];
            let (noise, threads) = (&table(), 1);
            let inputs = ExampleInputs {
                recording: &recording,
                model: &model,
                states,
                has_poses: false,
                rest,
                later_s: 0.0,
                noise,
                threads,
            };
            examples(&inputs).unwrap().unwrap().findings
        };
        let at_rest = examples_of_rest(0..MIN_REST_FRAMES);
        assert_eq!((at_rest.origin, at_rest.frames, at_rest.why), (ExampleOrigin::Rest, MIN_REST_FRAMES, None));
        let in_motion = examples_of_rest(0..0);
        assert_eq!((in_motion.origin, in_motion.why.as_deref()), (ExampleOrigin::Textureless, None));
        assert!(in_motion.usable_share > 0.9 && in_motion.to_string().contains("without texture"), "{in_motion}");
    }
}
