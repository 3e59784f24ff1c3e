//! Noise by example from frames at rest, and from pairs of a noisy picture and a clean one.
//!
//! Frames are sampled while a scene is summed: whole ones, evenly spaced, or windows of large ones,
//! each at another quarter of the picture. Their mean and the blocks that stood still come from the
//! scene's sums. Pictures of anything give their textureless places.

use super::blocks::BlockVerdict;
use super::example_report::{ExampleCalibration, ExampleMethod, MIN_FRAMES, NoExample};
use super::sampling_plan::{AtlasWindow, MAX_ATLAS_PX, SamplingPlan};
use super::scene_sums::{BLOCK, SceneSums};
use crate::camera::NoiseProfile;
use crate::coding::PictureCoding;
use crate::coding::estimate::estimate;
use crate::example_noise::calibration::{CalibrationFrame, CodedFrame, calibrate_coded, synthesise};
use crate::example_noise::flat_places::textureless_places;
use crate::example_noise::path::Planes;
use crate::example_noise::{ModelError, NoiseModel};
use crate::fit::quantile::midpoint_median;
use crate::grey_image::GreyImage;
use crate::pixels::{Codes, Pixels};

/// Largest number of scenes that are sampled; more would leave too small windows.
const MAX_SCENES: usize = 8;
/// Border of a window that is left out, where chroma and features depend on pixels outside, px.
const WINDOW_MARGIN_PX: usize = 16;
/// Key of the synthesised noise that is compared with the frames' own.
const CHECK_KEY: [u32; 3] = [0, 99, 0];
const SEED: u32 = 1;
/// Smallest share of a frame's pixels without texture.
const MIN_TEXTURELESS_SHARE: f64 = 0.1;
/// Codes of a bin of the comparison, and its smallest number of samples.
const BIN_CODES: usize = 16;
const MIN_BIN_SAMPLES: usize = 2000;
/// Largest correlation of consecutive frames that is corrected for.
const MAX_CORRELATION: f64 = 0.95;
/// Smallest number of independent frames in a mean.
const MIN_INDEPENDENT_FRAMES: f64 = 2.0;

/// Codes of a window, and their coding.
#[derive(Clone, Debug)]
struct SampledWindow {
    window: AtlasWindow,
    noisy: Vec<u8>,
    coding: PictureCoding,
    /// Size of the whole picture.
    picture_px: [usize; 2],
}

/// A frame of the calibration.
#[derive(Clone, Debug)]
struct ExampleFrame {
    frame: CalibrationFrame,
    coding: PictureCoding,
    /// Size of the picture of which the frame is a part.
    picture_px: [usize; 2],
}

/// Samples frames during a calibration.
#[derive(Clone, Debug)]
pub(super) struct ExampleSampler {
    budget_px: usize,
    /// Distance of the scenes that are sampled.
    scene_step: usize,
    scenes: usize,
    expected_frames: usize,
    plan: Option<SamplingPlan>,
    /// Size of the scene's first frame; frames of other sizes are not sampled.
    size: Option<[usize; 2]>,
    next_frame: usize,
    /// Estimated coding of the first sampled frame that has no JPEG tables.
    estimated_coding: Option<PictureCoding>,
    samples: Vec<SampledWindow>,
    frames: Vec<ExampleFrame>,
    /// Frames of the scenes that were used.
    resting_frames: usize,
    /// Sum over these frames of the correlation of consecutive frames' noise.
    correlation_sum: f64,
    known_mean: bool,
    is_textureless: bool,
    /// The first reason against a model.
    problem: Option<NoExample>,
    /// Most frames of a scene that had too few.
    longest_run_frames: usize,
}

impl ExampleSampler {
    /// Samples up to [`MAX_SCENES`] of `scenes` scenes, spread evenly.
    pub fn new(scenes: usize) -> Self {
        let scene_step = scenes.div_ceil(MAX_SCENES).max(1);
        Self {
            budget_px: MAX_ATLAS_PX / scenes.div_ceil(scene_step).max(1),
            scene_step,
            scenes: 0,
            expected_frames: 0,
            plan: None,
            size: None,
            next_frame: 0,
            estimated_coding: None,
            samples: Vec::new(),
            frames: Vec::new(),
            resting_frames: 0,
            correlation_sum: 0.0,
            known_mean: false,
            is_textureless: false,
            problem: None,
            longest_run_frames: 0,
        }
    }

    /// Starts a scene of `frames` frames.
    pub fn begin_scene(&mut self, frames: usize) {
        self.expected_frames = frames;
        let is_sampled = self.scenes.is_multiple_of(self.scene_step);
        self.scenes += 1;
        self.plan = (!is_sampled).then(SamplingPlan::default);
        self.size = None;
        self.next_frame = 0;
        self.samples.clear();
    }

    pub fn add_frame(&mut self, pixels: &Pixels) {
        let index = self.next_frame;
        self.next_frame += 1;
        let size = [pixels.width as usize, pixels.height as usize];
        if *self.size.get_or_insert(size) != size {
            // Frames of a scene at rest have one size; only unrelated pictures differ.
            return;
        }
        let plan = self.plan.get_or_insert_with(|| SamplingPlan::of(size, self.expected_frames, self.budget_px));
        let Codes::U8(codes) = &pixels.codes else {
            self.problem.get_or_insert(NoExample::Depth);
            return;
        };
        let sampled: Vec<AtlasWindow> =
            plan.samples.iter().filter(|(frame, _)| *frame == index).map(|(_, window)| *window).collect();
        if sampled.is_empty() {
            return;
        }
        let coding = match pixels.coding.as_deref() {
            Some(stated) => stated.clone(),
            None => {
                let estimated = || estimate(codes, size).map_or(PictureCoding::UNROUNDED, |estimate| estimate.coding);
                self.estimated_coding.get_or_insert_with(estimated).clone()
            }
        };
        for window in &sampled {
            let AtlasWindow { at: [x, y], size: [width, height] } = *window;
            let row = |row: usize| &codes[3 * ((y + row) * size[0] + x)..][..3 * width];
            let noisy = (0..height).flat_map(row).copied().collect();
            self.samples.push(SampledWindow {
                window: *window,
                noisy,
                coding: cropped(&coding, window.at),
                picture_px: size,
            });
        }
    }

    /// Ends a scene.
    pub fn end_scene(&mut self, scene: &SceneSums, verdict: &BlockVerdict) {
        let frames = scene.frames as usize;
        if self.samples.is_empty() {
            return;
        }
        if !scene.known_mean && frames < MIN_FRAMES {
            self.longest_run_frames = self.longest_run_frames.max(frames);
            return;
        }
        self.known_mean |= scene.known_mean;
        self.resting_frames += frames;
        let size = [scene.width, scene.height];
        // Von Neumann's ratio gives the correlation of consecutive frames (calibrate/blocks.rs).
        let correlation = if scene.known_mean { 0.0 } else { verdict.median_drift.clamp(0.0, MAX_CORRELATION) };
        self.correlation_sum += correlation * frames as f64;
        // Effective number of samples of first-order autoregressive noise: n (1 − ρ) / (1 + ρ)
        // (Bayley and Hammersley 1946).
        let independent = (frames as f64 * (1.0 - correlation) / (1.0 + correlation)).max(MIN_INDEPENDENT_FRAMES);
        let gain = if scene.known_mean { 1.0 } else { (independent / (independent - 1.0)) as f32 };
        for SampledWindow { window, noisy, coding, picture_px } in self.samples.drain(..) {
            let [width, height] = window.size;
            let place = |x: usize, y: usize| (window.at[1] + y) * size[0] + window.at[0] + x;
            let mean: Planes = std::array::from_fn(|c| {
                GreyImage::from_fn(width, height, |x, y| scene.pixel(3 * place(x, y) + c).mean as f32)
            });
            let is_inside = |v: usize, axis: usize| {
                let (first, last) = (window.at[axis], window.at[axis] + window.size[axis]);
                (first == 0 || v >= WINDOW_MARGIN_PX)
                    && (last == size[axis] || v + WINDOW_MARGIN_PX < window.size[axis])
            };
            let mask = (0..width * height).map(|i| {
                let (x, y) = (i % width, i / width);
                let block = (window.at[1] + y) / BLOCK * size[0].div_ceil(BLOCK) + (window.at[0] + x) / BLOCK;
                verdict.still[block] && is_inside(x, 0) && is_inside(y, 1)
            });
            let frame = CalibrationFrame { mean, noisy, mask: mask.collect(), variance_gain: gain };
            self.frames.push(ExampleFrame { frame, coding, picture_px });
        }
    }

    /// Calibrates the model from textureless places of the sampled frames, where `table` is the
    /// strength of their noise.
    pub fn finish_textureless(mut self, table: &NoiseProfile) -> Result<ExampleCalibration, NoExample> {
        let table = table.table();
        for SampledWindow { window, noisy, coding, picture_px } in std::mem::take(&mut self.samples) {
            let frame = textureless_places(noisy, window.size, &table);
            self.frames.push(ExampleFrame { frame, coding, picture_px });
        }
        let usable = |frame: &ExampleFrame| frame.frame.mask.iter().filter(|usable| **usable).count();
        self.frames.retain(|frame| usable(frame) as f64 >= MIN_TEXTURELESS_SHARE * frame.frame.mask.len() as f64);
        if self.frames.is_empty() && self.problem.is_none() {
            return Err(NoExample::Textured);
        }
        self.is_textureless = true;
        self.finish()
    }

    /// Calibrates the model from frames at rest, or, if they are too few for a mean without noise,
    /// from their textureless places.
    pub fn finish_resting(self, table: &NoiseProfile) -> Result<ExampleCalibration, NoExample> {
        if !self.frames.is_empty() || self.problem.is_some() || self.samples.is_empty() {
            return self.finish();
        }
        let too_few = NoExample::TooFewFrames { frames: self.longest_run_frames };
        self.finish_textureless(table).map_err(|_| too_few)
    }

    /// Calibrates the model.
    pub fn finish(self) -> Result<ExampleCalibration, NoExample> {
        if let Some(problem) = self.problem {
            return Err(problem);
        }
        let Some(first) = self.frames.first() else {
            return Err(NoExample::TooFewFrames { frames: self.longest_run_frames });
        };
        let size = |frame: &ExampleFrame| [frame.frame.mean[0].width, frame.frame.mean[0].height];
        if self.frames.iter().any(|frame| size(frame) != size(first)) {
            return Err(NoExample::Sizes);
        }
        let coded = self.frames.iter().map(|ExampleFrame { frame, coding, .. }| CodedFrame { frame, coding });
        let coded: Vec<CodedFrame<'_>> = coded.collect();
        let sizes_px = self.frames.iter().map(|frame| frame.picture_px);
        let correlation = self.correlation_sum / self.resting_frames.max(1) as f64;
        let model =
            calibrate_coded(&coded, SEED)?.with_picture_sizes(sizes_px).with_frame_correlation(correlation as f32);
        let method = if self.is_textureless {
            ExampleMethod::Textureless
        } else if self.known_mean {
            ExampleMethod::Pairs
        } else {
            ExampleMethod::Resting { frames: self.resting_frames }
        };
        let usable = |frame: &ExampleFrame| frame.frame.mask.iter().filter(|usable| **usable).count();
        let pixels = self.frames.iter().map(|frame| frame.frame.mask.len()).sum::<usize>().max(1);
        let usable_share = self.frames.iter().map(usable).sum::<usize>() as f64 / pixels as f64;
        let sigma_error = sigma_error(&model, first)?;
        let code_range = code_range(&self.frames);
        Ok(ExampleCalibration { model, method, usable_share, code_range, sigma_error })
    }
}

/// The coding of a picture that is cut at a pixel.
fn cropped(coding: &PictureCoding, at: [usize; 2]) -> PictureCoding {
    let mut coding = coding.clone();
    let unit = coding.unit_px();
    if let Some(quantization) = &mut coding.quantization {
        let origin = quantization.origin;
        quantization.origin = [0, 1].map(|axis| -((at[axis] as i32 - origin[axis]).rem_euclid(unit[axis] as i32)));
    }
    coding
}

/// Codes between which 98 % of the usable pixels of the clean pictures are, over all channels.
fn code_range(frames: &[ExampleFrame]) -> [f32; 2] {
    let mut histogram = [0usize; 256];
    for frame in frames.iter().map(|frame| &frame.frame) {
        for plane in &frame.mean {
            for (value, _) in plane.values.iter().zip(&frame.mask).filter(|(_, usable)| **usable) {
                histogram[value.round().clamp(0.0, 255.0) as usize] += 1;
            }
        }
    }
    let total: usize = histogram.iter().sum();
    let at = |share: f64| {
        let mut below = 0;
        let reached = |n: &usize| {
            below += n;
            below as f64 > share * total as f64
        };
        histogram.iter().position(reached).unwrap_or(255) as f32
    };
    [at(0.01), at(0.99)]
}

/// Median over intensities of |σ of synthesised noise / σ of real noise − 1| in a frame.
fn sigma_error(model: &NoiseModel, frame: &ExampleFrame) -> Result<Option<f64>, ModelError> {
    let ExampleFrame { frame, coding, .. } = frame;
    let synthesised = synthesise(model, &frame.mean, coding, CHECK_KEY)?;
    // Samples, and squared differences from the mean of both.
    let mut bins = [(0usize, 0.0f64, 0.0f64); 256 / BIN_CODES];
    for (i, _) in frame.mask.iter().enumerate().filter(|(_, usable)| **usable) {
        for c in 0..3 {
            let mean = frame.mean[c].values[i];
            let bin = &mut bins[(mean.clamp(0.0, 255.0) as usize) / BIN_CODES];
            let square = |codes: &[u8]| f64::from(f32::from(codes[3 * i + c]) - mean).powi(2);
            *bin = (bin.0 + 1, bin.1 + square(&frame.noisy), bin.2 + square(&synthesised));
        }
    }
    let gain = f64::from(frame.variance_gain);
    let full = bins.iter().filter(|bin| bin.0 >= MIN_BIN_SAMPLES && bin.1 > 0.0);
    Ok(midpoint_median(full.map(|(_, real, drawn)| ((drawn / (gain * real)).sqrt() - 1.0).abs())))
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::path::{Path, PathBuf};

    use super::*;
    use crate::calibrate::{NoiseOptions, NoiseSource, SceneMotion, Warning, noise_from_paths};
    use crate::coding::{BlockQuantization, ChromaSampling, Decoder, YcbcrColor};
    use crate::example_noise::atlas::USABLE;
    use crate::example_noise::file::{from_bytes, to_bytes};
    use crate::hash::pcg3d;

    const SIDE: usize = 208;
    /// First column and row of a patch that moves.
    const MOVING_PX: usize = 184;

    /// A picture of a camera at rest: left half dark with σ 2, right half bright with σ 5.
    fn picture(frame: u32) -> image::RgbImage {
        image::RgbImage::from_fn(SIDE as u32, SIDE as u32, |x, y| {
            let (level, sigma) = if (x as usize) < SIDE / 2 { (60.0, 2.0) } else { (180.0, 5.0) };
            let moves = x as usize >= MOVING_PX && y as usize >= MOVING_PX;
            let level = if moves { 40.0 + 30.0 * frame as f32 } else { level };
            let words = pcg3d([x, y, frame]);
            image::Rgb(words.map(|word| {
                let uniform = (word as f32 / u32::MAX as f32 - 0.5) * 12.0f32.sqrt();
                (level + sigma * uniform).round() as u8
            }))
        })
    }

    fn write_frames(folder: &Path, frames: u32) -> Vec<PathBuf> {
        let file = |frame| {
            let file = folder.join(format!("{frame}.png"));
            picture(frame).save(&file).unwrap();
            file
        };
        (0..frames).map(file).collect()
    }

    fn example(frames: &[PathBuf], means: &[PathBuf]) -> Result<ExampleCalibration, NoExample> {
        let mut progress = |_, _| ControlFlow::Continue(());
        let options = NoiseOptions { min_independent: 100.0, with_example: true, ..NoiseOptions::default() };
        let source = if means.is_empty() { NoiseSource::Rest } else { NoiseSource::KnownMeans(means) };
        noise_from_paths(frames, source, &options, &mut progress).unwrap().example.unwrap()
    }

    #[test]
    fn uncoded_frames_at_rest_give_a_model_without_the_moving_part() {
        let folder = tempfile::tempdir().unwrap();
        let example = example(&write_frames(folder.path(), 4), &[]).unwrap();
        let numbers = &example.model.numbers;
        assert_eq!((example.method, example.model.sources.len()), (ExampleMethod::Resting { frames: 4 }, 4));
        assert_eq!(numbers.coding.difference(&PictureCoding::UNROUNDED), None);
        for source in &example.model.sources {
            assert_eq!(source.picture.map(|picture| picture.size_px), Some([SIDE; 2]));
            let usable = |x: usize, y: usize| source.flags[y * SIDE + x] & USABLE != 0;
            assert!(usable(20, 20) && usable(120, 190) && !usable(MOVING_PX, MOVING_PX) && !usable(207, 207));
        }
        // Blocks of 8 px: 24² of 208² px.
        let moving = (24.0f64 / 208.0).powi(2);
        assert!((example.usable_share - (1.0 - moving)).abs() < 0.01, "{}", example.usable_share);
        // The mean of 4 frames has half of the noise's deviation: 1 and 2.5 codes, uniform.
        let [dark, bright] = example.code_range;
        assert!((55.0..=60.0).contains(&dark) && (180.0..=190.0).contains(&bright), "{dark} to {bright}");
        let error = example.sigma_error.unwrap();
        assert!(error < 0.08, "{error}");
        let text = example.to_string();
        assert!(text.contains("from 4 frames at rest") && text.contains("hold the camera still"), "{text}");
        assert!(from_bytes(&to_bytes(&example.model).unwrap()).unwrap() == example.model);
    }

    #[test]
    fn noisy_picture_and_its_mean_give_a_model() {
        let folder = tempfile::tempdir().unwrap();
        let mean = folder.path().join("mean.png");
        let levels = image::RgbImage::from_fn(SIDE as u32, SIDE as u32, |x, y| {
            let is_patch = x as usize >= MOVING_PX && y as usize >= MOVING_PX;
            let level = if (x as usize) < SIDE / 2 { 60 } else { 180 };
            image::Rgb([if is_patch { 40 } else { level }; 3])
        });
        levels.save(&mean).unwrap();
        let example = example(&write_frames(folder.path(), 1), &[mean]).unwrap();
        assert_eq!((example.method, example.model.sources.len()), (ExampleMethod::Pairs, 1));
        assert!(example.sigma_error.unwrap() < 0.08 && example.to_string().contains("clean picture"), "{example}");
    }

    /// A surface in smoothly varying light, moved to the right by `shifts[i]` px in picture i.
    fn write_shifted(folder: &Path, shifts: &[f32]) {
        for (frame, shift) in shifts.iter().enumerate() {
            let picture = image::RgbImage::from_fn(SIDE as u32, SIDE as u32, |x, y| {
                let light = 115.0 + 50.0 * ((x as f32 - shift) / 32.0).sin() * (y as f32 / 40.0).cos();
                let words = pcg3d([x, y, 50 + frame as u32]);
                image::Rgb(words.map(|word| (light + 10.0 * (word as f32 / u32::MAX as f32 - 0.5)).round() as u8))
            });
            picture.save(folder.join(format!("{frame:02}.png"))).unwrap();
        }
    }

    // Slow: calibrates two models.
    #[test]
    fn best_method_is_a_stretch_at_rest_or_textureless_places() {
        let best = |shifts: &[f32]| {
            let folder = tempfile::tempdir().unwrap();
            write_shifted(folder.path(), shifts);
            let options = NoiseOptions { min_independent: 100.0, with_example: true, ..NoiseOptions::default() };
            let mut progress = |_, _| ControlFlow::Continue(());
            let frames = [folder.path().to_owned()];
            let noise = noise_from_paths(&frames, NoiseSource::Best, &options, &mut progress).unwrap();
            let (table, example) = (noise.table, noise.example.unwrap());
            // Uniform noise of 10 codes: σ = 10 / √12 = 2.89.
            let sigma = table.profile.sigma(1, 115.0);
            assert!((sigma - 2.89).abs() < 0.3, "{shifts:?}: {sigma}");
            (table, example.unwrap())
        };
        let (table, example) =
            best(&[0.0, 8.0, 16.0, 24.0, 24.0, 24.0, 24.0, 24.0, 24.0, 24.0, 24.0, 24.0, 32.0, 40.0]);
        assert_eq!((table.motion, example.method), (SceneMotion::Resting, ExampleMethod::Resting { frames: 9 }));
        let is_stretch = |w: &Warning| matches!(w, Warning::Stretch { first: 3, last: 11, count: 14, .. });
        assert!(table.warnings.iter().any(is_stretch), "{:?}", table.warnings);
        let (table, example) = best(&[0.0]);
        assert_eq!((table.motion, example.method), (SceneMotion::Moving, ExampleMethod::Textureless));
        assert!(table.warnings.contains(&Warning::NoSceneAtRest));
    }

    #[test]
    fn png_files_that_were_jpegs_give_a_model_of_their_coding() {
        let folder = tempfile::tempdir().unwrap();
        let file = |frame: u32| {
            let picture = image::RgbImage::from_fn(SIDE as u32, SIDE as u32, |x, y| {
                let wave = 128.0 + 50.0 * (x as f32 * 0.09).sin() * (y as f32 * 0.05).cos();
                let noise = pcg3d([x, y, frame]).map(|word| 16.0 * (word as f32 / u32::MAX as f32 - 0.5));
                image::Rgb(noise.map(|noise| (wave + noise) as u8))
            });
            let mut jpeg = Vec::new();
            image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 85).encode_image(&picture).unwrap();
            let file = folder.path().join(format!("{frame}.png"));
            image::load_from_memory(&jpeg).unwrap().save(&file).unwrap();
            file
        };
        let files: Vec<PathBuf> = (0..5).map(file).collect();
        let coding = example(&files, &[]).unwrap().model.numbers.coding;
        assert_eq!((coding.quantized, coding.decoder), (true, Decoder::Libjpeg));
    }

    #[test]
    fn few_or_deep_frames_give_no_model_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        // Their textureless places serve, if they have any.
        let plain = example(&write_frames(folder.path(), 3), &[]).unwrap();
        assert_eq!(plain.method, ExampleMethod::Textureless);
        let textured = |frame: u32| {
            let file = folder.path().join(format!("textured{frame}.png"));
            let mut picture = picture(frame);
            picture.enumerate_pixels_mut().for_each(|(x, y, pixel)| {
                let stripe = 10 * ((x / 2 + y / 3) % 4) as u8;
                pixel.0.iter_mut().for_each(|code| *code += stripe);
            });
            picture.save(&file).unwrap();
            file
        };
        let few = example(&(0..3).map(textured).collect::<Vec<_>>(), &[]).map(|example| example.method).unwrap_err();
        assert_eq!(few, NoExample::TooFewFrames { frames: 3 });
        let deep = |frame: u32| {
            let file = folder.path().join(format!("deep{frame}.png"));
            let wide = picture(frame).into_raw().into_iter().map(|code| u16::from(code) * 257).collect();
            let wide = image::ImageBuffer::<image::Rgb<u16>, Vec<u16>>::from_raw(SIDE as u32, SIDE as u32, wide);
            wide.unwrap().save(&file).unwrap();
            file
        };
        let deep: Vec<PathBuf> = (0..4).map(deep).collect();
        assert_eq!(example(&deep, &[]).unwrap_err(), NoExample::Depth);
    }

    #[test]
    fn cropped_coding_keeps_the_grid_in_place() {
        let coding = PictureCoding {
            color: YcbcrColor::JFIF,
            chroma: Some(ChromaSampling::centered([2, 1])),
            quantization: Some(BlockQuantization { steps: [[4; 64]; 3], origin: [-8, 0] }),
            decoder: Decoder::ZuneJpeg,
        };
        let origin = |at| cropped(&coding, at).quantization.unwrap().origin;
        // Units start at x = 8, 24, 40 and at y = 0, 8.
        assert_eq!((origin([0, 0]), origin([16, 16]), origin([24, 9])), ([-8, 0], [-8, 0], [0, -1]));
        let uncoded = PictureCoding::UNROUNDED;
        assert_eq!(cropped(&uncoded, [3, 5]), uncoded);
    }
}
