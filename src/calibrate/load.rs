//! Calibration from files, folders, recordings and videos, read one frame at a time; and the choice
//! of the method.

use super::example::{ExampleCalibration, ExampleSampler, NoExample};
use super::footage::Footage;
use super::moving::MovingCalibrator;
use super::noise::{CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions};
use super::rest::RestSearch;
use super::warning::Warning;
use crate::pixels::Pixels;
use crate::source::{still, unsupported};
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

/// Fewest frames of a stretch at rest.
const MIN_REST_FRAMES: usize = 8;
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Called with the number of completed frames and of all frames, first with (0, all). A break stops
/// the calibration.
pub type LoadProgress<'a> = &'a mut dyn FnMut(usize, usize) -> ControlFlow<()>;

fn report_progress(progress: LoadProgress<'_>, done: usize, all: usize) -> Result<(), CalibrateError> {
    if progress(done, all).is_break() { Err(CalibrateError::Stopped) } else { Ok(()) }
}

/// Calibrates from scenes at rest. Each folder, recording and video among `frames` is a scene; all
/// loose files together are one. Of recordings and videos the longest stretch at rest is used.
/// `means` is empty, or has one for everything, or one for each entry of `frames` (each loose file
/// is then a scene of its own).
pub fn noise_from_paths(
    frames: &[PathBuf],
    means: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseCalibration, CalibrateError> {
    let (scenes, stretches) = at_rest(group(frames, means)?, false, progress)?;
    let (mut calibration, _) = calibrated(&scenes, NoiseCalibrator::new(options.clone())?, progress)?;
    calibration.warnings.extend(stretches);
    Ok(calibration)
}

/// A noise table, and noise by example from the same frames.
pub type NoiseWithExample = (NoiseCalibration, Result<ExampleCalibration, NoExample>);

/// [`noise_from_paths`], and noise by example from the same frames.
pub fn noise_and_example_from_paths(
    frames: &[PathBuf],
    means: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseWithExample, CalibrateError> {
    let (scenes, stretches) = at_rest(group(frames, means)?, false, progress)?;
    let (mut calibration, example) = with_example(&scenes, options, progress)?;
    calibration.warnings.extend(stretches);
    Ok((calibration, example))
}

fn with_example(
    scenes: &[SceneFootage],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseWithExample, CalibrateError> {
    let calibrator = NoiseCalibrator::with_example(options.clone(), scenes.len())?;
    let (calibration, sampler) = calibrated(scenes, calibrator, progress)?;
    let example = sampler.map_or(Err(NoExample::TooFewFrames { frames: 0 }), ExampleSampler::finish);
    Ok((calibration, example))
}

/// Calibrates by the best method that the frames permit: scenes at rest, their longest stretches at
/// rest, or textureless places.
pub fn best_noise_from_paths(
    frames: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseCalibration, CalibrateError> {
    best(
        frames,
        &mut |scenes, progress| {
            calibrated(scenes, NoiseCalibrator::new(options.clone())?, progress)
                .map(|(calibration, _)| (calibration, ()))
        },
        &mut |progress| Ok((moving_noise_from_paths(frames, options, progress)?, ())),
        progress,
    )
    .map(|(calibration, ())| calibration)
}

/// [`best_noise_from_paths`], and noise by example by the same method.
pub fn best_noise_and_example_from_paths(
    frames: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseWithExample, CalibrateError> {
    best(
        frames,
        &mut |scenes, progress| with_example(scenes, options, progress),
        &mut |progress| moving_noise_and_example_from_paths(frames, options, progress),
        progress,
    )
}

type AtRest<'a, E> =
    &'a mut dyn FnMut(&[SceneFootage], LoadProgress<'_>) -> Result<(NoiseCalibration, E), CalibrateError>;
type Moving<'a, E> = &'a mut dyn FnMut(LoadProgress<'_>) -> Result<(NoiseCalibration, E), CalibrateError>;

fn best<E>(
    frames: &[PathBuf],
    resting: AtRest<'_, E>,
    moving: Moving<'_, E>,
    progress: LoadProgress<'_>,
) -> Result<(NoiseCalibration, E), CalibrateError> {
    for searches_files in [false, true] {
        let found = at_rest(group(frames, &[])?, searches_files, progress).and_then(|(scenes, stretches)| {
            let (mut calibration, example) = resting(&scenes, progress)?;
            calibration.warnings.extend(stretches);
            Ok((calibration, example))
        });
        match found {
            Err(error) if error.is_motion() => {}
            done => return done,
        }
    }
    let (mut calibration, example) = moving(progress)?;
    calibration.warnings.push(Warning::NotAtRest);
    Ok((calibration, example))
}

/// Limits recordings and videos, and files too if `searches_files`, to their longest stretches at
/// rest. Scenes without one are left out.
fn at_rest(
    scenes: Vec<SceneFootage>,
    searches_files: bool,
    progress: LoadProgress<'_>,
) -> Result<(Vec<SceneFootage>, Vec<Warning>), CalibrateError> {
    let (mut found, mut stretches) = (Vec::new(), Vec::new());
    for mut scene in scenes {
        let is_searched = searches_files || !matches!(scene.footage, Footage::Files(_));
        if scene.mean.is_some() || !is_searched {
            found.push(scene);
            continue;
        }
        let count = scene.footage.count();
        let mut search = RestSearch::default();
        for (done, pixels) in scene.footage.pixels(0..count)?.enumerate() {
            report_progress(progress, done, count)?;
            search.add(&pixels?);
        }
        scene.range = search.longest();
        if scene.range.len() >= MIN_REST_FRAMES {
            let path = scene.footage.path().to_owned();
            stretches.push(Warning::Stretch { path, first: scene.range.start, last: scene.range.end - 1, count });
            found.push(scene);
        }
    }
    if found.is_empty() { Err(CalibrateError::NeverAtRest { needed: MIN_REST_FRAMES }) } else { Ok((found, stretches)) }
}

fn calibrated(
    scenes: &[SceneFootage],
    mut calibrator: NoiseCalibrator,
    progress: LoadProgress<'_>,
) -> Result<(NoiseCalibration, Option<ExampleSampler>), CalibrateError> {
    let (mut done, all) = (0, scenes.iter().map(|scene| scene.range.len()).sum());
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
        jpeg |= footage.has_jpeg()?;
        let first = footage.path();
        let folder = match footage {
            Footage::Files(_) => first.parent().filter(|folder| !folder.as_os_str().is_empty()),
            _ => None,
        };
        calibrator.end_scene().map_err(in_file(folder.unwrap_or(first)))?;
    }
    let sampler = calibrator.take_sampler();
    let mut calibration = calibrator.finish()?;
    calibration.warnings.extend(jpeg.then_some(Warning::Jpeg));
    Ok((calibration, sampler))
}

/// Approximate number of frames of a moving camera that are used, evenly spaced: they contain
/// enough textureless areas.
const MAX_MOVING_FRAMES: usize = 120;

/// Calibrates from textureless places of any pictures, folders of them, recordings and videos.
pub fn moving_noise_from_paths(
    frames: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseCalibration, CalibrateError> {
    textureless(frames, options, None, progress).map(|(calibration, _)| calibration)
}

/// [`moving_noise_from_paths`], and noise by example from the same places.
pub fn moving_noise_and_example_from_paths(
    frames: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseWithExample, CalibrateError> {
    let (calibration, sampler) = textureless(frames, options, Some(ExampleSampler::new(1)), progress)?;
    let example = match sampler {
        Some(sampler) => sampler.finish_textureless(&calibration.profile),
        None => Err(NoExample::TooFewFrames { frames: 0 }),
    };
    Ok((calibration, example))
}

fn textureless(
    frames: &[PathBuf],
    options: &NoiseOptions,
    mut sampler: Option<ExampleSampler>,
    progress: LoadProgress<'_>,
) -> Result<(NoiseCalibration, Option<ExampleSampler>), CalibrateError> {
    let mut calibrator = MovingCalibrator::new(options.clone())?;
    let footage = frames.iter().map(|path| Footage::open(path)).collect::<Result<Vec<_>, _>>()?;
    let every = footage.iter().map(Footage::count).sum::<usize>().div_ceil(MAX_MOVING_FRAMES).max(1);
    // Loose files count as one sequence.
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
        jpeg |= footage.has_jpeg()?;
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
    let mut calibration = calibrator.finish()?;
    calibration.warnings.extend(jpeg.then_some(Warning::Jpeg));
    Ok((calibration, sampler))
}

/// True if a file has the extension of a picture.
pub fn is_picture(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    path.is_file() && ending.is_some_and(|e| EXTENSIONS.contains(&e.as_str()))
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

pub fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, CalibrateError> {
    let failed = |reason: String| CalibrateError::Read { path: folder.to_owned(), reason };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| failed(e.to_string()))? {
        let path = entry.map_err(|e| failed(e.to_string()))?.path();
        if is_picture(&path) {
            files.push(path);
        }
    }
    if files.is_empty()
        && let Some(message) = unsupported::unread_warning(&unsupported::in_folder(folder))
    {
        return Err(failed(message));
    }
    if files.is_empty() {
        return Err(failed(
            "no PNG or JPEG files in this folder, and no recording; give pictures, folders of them, recordings or videos"
                .to_owned(),
        ));
    }
    files.sort();
    Ok(files)
}

/// Reads a file as recordings do: a truncated file is an error.
pub fn read(path: &Path) -> Result<Pixels, CalibrateError> {
    Ok(still::read_pixels(path)?)
}
