//! Calibration from files, folders, recordings and videos, read one frame at a time; and the choice
//! of the method.

use super::example::ExampleSampler;
use super::example_report::{ExampleCalibration, NoExample};
use super::footage::{Footage, is_picture, read};
use super::noise::{CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions};
use super::rest::RestSearch;
use super::scene_sums::MAX_FRAMES;
use super::textureless::TexturelessCalibrator;
use super::warning::Warning;
use crate::pixels::Pixels;
use crate::source::unsupported;
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

/// Fewest frames of a stretch at rest.
const MIN_REST_FRAMES: usize = 8;

/// Called with the number of completed frames and of all frames. Each pass counts from 0 with its
/// own total: the search for rest in each scene, then the calibration. A break stops it.
pub type LoadProgress<'a> = &'a mut dyn FnMut(usize, usize) -> ControlFlow<()>;

fn report_progress(progress: LoadProgress<'_>, done: usize, all: usize) -> Result<(), CalibrateError> {
    if progress(done, all).is_break() { Err(CalibrateError::Stopped) } else { Ok(()) }
}

/// Source of a calibration's noise.
#[derive(Clone, Copy, Debug)]
pub enum NoiseSource<'a> {
    /// In scenes at rest, in their longest stretches at rest, or in textureless places: the first
    /// of these that the frames permit.
    Best,
    /// In scenes at rest. Of recordings and videos the longest stretch at rest is used.
    Rest,
    /// In the difference from the scenes' known means: one for everything, or one for each entry
    /// (each loose file is then a scene of its own).
    KnownMeans(&'a [PathBuf]),
    /// Noise is measured in textureless places.
    Textureless,
}

/// Calibrated noise.
#[derive(Clone, Debug)]
pub struct MeasuredNoise {
    pub table: NoiseCalibration,
    /// From the same frames, if [`NoiseOptions::with_example`].
    pub example: Option<Result<ExampleCalibration, NoExample>>,
}

/// Calibrates from pictures, folders, recordings and videos. Each folder, recording and video is a
/// scene; all loose files together are one.
pub fn noise_from_paths(
    frames: &[PathBuf],
    source: NoiseSource<'_>,
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<MeasuredNoise, CalibrateError> {
    match source {
        NoiseSource::KnownMeans(means) => resting(&group(frames, means)?, options, progress),
        NoiseSource::Textureless => textureless(frames, options, progress),
        NoiseSource::Rest => {
            let scenes = group(frames, &[])?;
            stretches(scenes, |footage| !matches!(footage, Footage::Files(_)), options, progress)
        }
        NoiseSource::Best => {
            let noise = noise_from_paths(frames, NoiseSource::Rest, options, progress);
            if !matches!(&noise, Err(error) if error.lacks_scene_at_rest()) {
                return noise;
            }
            let scenes = group(frames, &[])?;
            if scenes.iter().any(|scene| matches!(scene.footage, Footage::Files(_))) {
                let noise = stretches(scenes, |_| true, options, progress);
                if !matches!(&noise, Err(error) if error.lacks_scene_at_rest()) {
                    return noise;
                }
            }
            let mut noise = textureless(frames, options, progress)?;
            noise.table.warnings.push(Warning::NoSceneAtRest);
            Ok(noise)
        }
    }
}

/// Calibrates from scenes at rest, after those for which `is_limited` are limited to their longest
/// stretches at rest.
fn stretches(
    scenes: Vec<SceneFootage>,
    is_limited: impl Fn(&Footage) -> bool,
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<MeasuredNoise, CalibrateError> {
    let (mut used, mut warnings) = (Vec::new(), Vec::new());
    for mut scene in scenes {
        if !is_limited(&scene.footage) {
            used.push(scene);
            continue;
        }
        let count = scene.footage.count();
        let mut search = RestSearch::default();
        for (done, pixels) in scene.footage.pixels(0..count)?.enumerate() {
            report_progress(progress, done, count)?;
            search.add(&pixels?);
        }
        let Range { start, end } = search.longest();
        let path = scene.footage.path().to_owned();
        if end - start < MIN_REST_FRAMES.min(count).max(2) {
            warnings.push(Warning::LeftOut { path, needed: MIN_REST_FRAMES });
            continue;
        }
        scene.range = start..end.min(start + MAX_FRAMES as usize);
        if scene.range.len() < count {
            warnings.push(Warning::Stretch { path, first: start, last: scene.range.end - 1, count });
        }
        used.push(scene);
    }
    if used.is_empty() {
        return Err(CalibrateError::NeverAtRest { needed: MIN_REST_FRAMES });
    }
    let mut noise = resting(&used, options, progress)?;
    noise.table.warnings.extend(warnings);
    Ok(noise)
}

fn resting(
    scenes: &[SceneFootage],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<MeasuredNoise, CalibrateError> {
    let mut calibrator = NoiseCalibrator::new(options.clone())?;
    calibrator.sample_examples(options.with_example.then(|| ExampleSampler::new(scenes.len())));
    let mut done = 0;
    let all = scenes.iter().map(|scene| scene.range.len()).sum();
    let mut jpeg = false;
    for (number, SceneFootage { mean, footage, range }) in scenes.iter().enumerate() {
        if mean.is_none() && range.len() == 1 {
            footage.pixels(range.clone())?.next().transpose()?;
            return Err(in_file(footage.path())(CalibrateError::OneFrame { scene: number + 1 }));
        }
        calibrator.expect_frames(range.len());
        calibrator.begin_scene(mean.as_deref().map(read).transpose()?)?;
        for (i, pixels) in footage.pixels(range.clone())?.enumerate() {
            report_progress(progress, done, all)?;
            done += 1;
            calibrator.add_frame(&pixels?).map_err(in_file(footage.frame_path(range.start + i)))?;
        }
        jpeg |= footage.contains_jpeg()?;
        calibrator.end_scene().map_err(in_file(footage.path()))?;
    }
    let sampler = calibrator.take_sampler();
    let mut table = calibrator.finish()?;
    table.warnings.extend(jpeg.then_some(Warning::Jpeg));
    let example = sampler.map(|sampler| sampler.finish_resting(&table.profile));
    Ok(MeasuredNoise { table, example })
}

/// Approximate number of frames, evenly spaced, in which textureless places are measured.
const MAX_TEXTURELESS_FRAMES: usize = 120;

fn textureless(
    frames: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<MeasuredNoise, CalibrateError> {
    let mut calibrator = TexturelessCalibrator::new(options.clone())?;
    let mut sampler = options.with_example.then(|| ExampleSampler::new(1));
    let footage = frames.iter().map(|path| Footage::open(path)).collect::<Result<Vec<_>, _>>()?;
    let every = footage.iter().map(Footage::count).sum::<usize>().div_ceil(MAX_TEXTURELESS_FRAMES).max(1);
    // All inputs count as one sequence, so that the step also spans short folders.
    let mut first = 0;
    let used =
        |footage: &Footage, first: usize| (0..footage.count()).skip((every - first % every) % every).step_by(every);
    let mut plan = Vec::new();
    for footage in &footage {
        plan.push(used(footage, first));
        first += footage.count();
    }
    let all = plan.iter().map(|used| used.clone().count()).sum();
    if let Some(sampler) = &mut sampler {
        sampler.begin_scene(all);
    }
    let (mut done, mut jpeg) = (0, false);
    for (footage, used) in footage.iter().zip(plan) {
        let mut used = used.peekable();
        if used.peek().is_none() {
            continue;
        }
        jpeg |= footage.contains_jpeg()?;
        let mut take = |i: usize, pixels: Pixels| -> Result<(), CalibrateError> {
            report_progress(progress, done, all)?;
            done += 1;
            calibrator.add_frame(&pixels).map_err(in_file(footage.frame_path(i)))?;
            if let Some(sampler) = &mut sampler {
                sampler.add_frame(&pixels);
            }
            Ok(())
        };
        if let Footage::Files(_) = footage {
            // The others need not be read.
            for i in used {
                for pixels in footage.pixels(i..i + 1)? {
                    take(i, pixels?)?;
                }
            }
        } else {
            for (i, pixels) in footage.pixels(0..footage.count())?.enumerate() {
                let pixels = pixels?;
                if used.next_if_eq(&i).is_some() {
                    take(i, pixels)?;
                }
            }
        }
    }
    let mut table = calibrator.finish()?;
    table.warnings.extend(jpeg.then_some(Warning::Jpeg));
    let example = sampler.map(|sampler| sampler.finish_textureless(&table.profile));
    Ok(MeasuredNoise { table, example })
}

fn in_file(path: &Path) -> impl Fn(CalibrateError) -> CalibrateError {
    let path = path.to_owned();
    move |source| CalibrateError::InFile { path: path.clone(), source: Box::new(source) }
}

/// Frames of one scene, with its known mean if there is one.
struct SceneFootage {
    mean: Option<PathBuf>,
    footage: Footage,
    range: Range<usize>,
}

impl SceneFootage {
    fn new(mean: Option<PathBuf>, footage: Footage) -> Self {
        let range = 0..footage.count();
        Self { mean, footage, range }
    }
}

fn group(frames: &[PathBuf], means: &[PathBuf]) -> Result<Vec<SceneFootage>, CalibrateError> {
    if frames.is_empty() {
        return Err(CalibrateError::NoFrames);
    }
    let paired = means.len() > 1;
    if paired && means.len() != frames.len() {
        return Err(CalibrateError::MeansCount { means: means.len(), entries: frames.len() });
    }
    let mut scenes = Vec::new();
    let mut loose = Vec::new();
    for (i, path) in frames.iter().enumerate() {
        let mean = if paired { means.get(i) } else { means.first() }.cloned();
        // Reading refuses other files with the reason.
        let is_file = is_picture(path) || unsupported::by_name(path).is_some() || !path.exists();
        if !is_file {
            scenes.push(SceneFootage::new(mean, Footage::open(path)?));
        } else if paired {
            scenes.push(SceneFootage::new(mean, Footage::Files(vec![path.clone()])));
        } else {
            loose.push(path.clone());
        }
    }
    if !loose.is_empty() {
        scenes.push(SceneFootage::new(means.first().cloned(), Footage::Files(loose)));
    }
    Ok(scenes)
}
