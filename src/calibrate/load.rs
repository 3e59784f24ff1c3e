//! Frames for a calibration, from files and folders, one at a time.

use super::example::{ExampleCalibration, ExampleSampler, NoExample};
use super::moving::MovingCalibrator;
use super::noise::{CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions};
use super::warning::Warning;
use crate::pixels::Pixels;
use crate::recording::{OpenOptions, Recording};
use crate::source::{still, unsupported};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Called with the number of completed frames and of all frames, first with (0, all). A break stops
/// the calibration.
pub type LoadProgress<'a> = &'a mut dyn FnMut(usize, usize) -> ControlFlow<()>;

fn report_progress(progress: &mut LoadProgress<'_>, done: usize, all: usize) -> Result<(), CalibrateError> {
    if progress(done, all).is_break() { Err(CalibrateError::Stopped) } else { Ok(()) }
}

/// Calibrates from picture files. Each folder among `frames` is a scene (its PNG and JPEG files, in
/// order of name); all loose files together are one scene. `means` is empty, or has one for
/// everything, or one for each entry of `frames` (each loose file is then a scene of its own).
pub fn noise_from_paths(
    frames: &[PathBuf],
    means: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<NoiseCalibration, CalibrateError> {
    let scenes = group(frames, means)?;
    calibrated(&scenes, NoiseCalibrator::new(options.clone())?, progress).map(|(calibration, _)| calibration)
}

/// [`noise_from_paths`], and noise by example from the same frames.
pub fn noise_and_example_from_paths(
    frames: &[PathBuf],
    means: &[PathBuf],
    options: &NoiseOptions,
    progress: LoadProgress<'_>,
) -> Result<(NoiseCalibration, Result<ExampleCalibration, NoExample>), CalibrateError> {
    let scenes = group(frames, means)?;
    let calibrator = NoiseCalibrator::with_example(options.clone(), scenes.len())?;
    let (calibration, sampler) = calibrated(&scenes, calibrator, progress)?;
    let example = sampler.map_or(Err(NoExample::TooFewFrames { frames: 0 }), ExampleSampler::finish);
    Ok((calibration, example))
}

fn calibrated(
    scenes: &Scenes,
    mut calibrator: NoiseCalibrator,
    mut progress: LoadProgress<'_>,
) -> Result<(NoiseCalibration, Option<ExampleSampler>), CalibrateError> {
    let (mut done, all) = (0, scenes.iter().map(|(_, files)| files.len()).sum());
    let mut jpeg = false;
    for (number, (mean, files)) in scenes.iter().enumerate() {
        if let (None, [only]) = (mean, files.as_slice()) {
            read(only)?;
            return Err(in_file(only)(CalibrateError::OneFrame { scene: number + 1 }));
        }
        calibrator.expect_frames(files.len());
        calibrator.begin_scene(mean.as_deref().map(read).transpose()?)?;
        for file in files {
            report_progress(&mut progress, done, all)?;
            done += 1;
            calibrator.add_frame(&read(file)?).map_err(in_file(file))?;
            jpeg |= still::is_jpeg(file)?;
        }
        let first = files.first().map_or(Path::new(""), PathBuf::as_path);
        let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty());
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

/// Calibrates from frames of a moving camera: picture files, folders of them (in order of name) and
/// recordings.
pub fn moving_noise_from_paths(
    frames: &[PathBuf],
    options: &NoiseOptions,
    mut progress: LoadProgress<'_>,
) -> Result<NoiseCalibration, CalibrateError> {
    let mut calibrator = MovingCalibrator::new(options.clone())?;
    let (mut pictures, mut recordings) = (Vec::new(), Vec::new());
    for path in frames {
        match pictures_in(path) {
            _ if is_picture(path) => pictures.push(path.clone()),
            Ok(files) => pictures.extend(files),
            Err(_) => recordings.push(Recording::open(path, &OpenOptions::default()).map_err(|e| {
                let reason = format!("neither a picture nor a folder of PNG or JPEG files, nor a recording: {e}");
                CalibrateError::Read { path: path.clone(), reason }
            })?),
        }
    }
    let all = pictures.len() + recordings.iter().map(Recording::frame_count).sum::<usize>();
    let every = all.div_ceil(MAX_MOVING_FRAMES).max(1);
    let mut jpeg = false;
    let used = |frames: usize| frames.div_ceil(every);
    let all = used(pictures.len()) + recordings.iter().map(|r| used(r.frame_count())).sum::<usize>();
    let mut done = 0;
    for file in pictures.iter().step_by(every) {
        report_progress(&mut progress, done, all)?;
        done += 1;
        calibrator.add_frame(&read(file)?).map_err(in_file(file))?;
        jpeg |= still::is_jpeg(file)?;
    }
    for recording in &recordings {
        let failed = |e: crate::recording::RecordingError| CalibrateError::Read {
            path: recording.path.clone(),
            reason: e.to_string(),
        };
        for file in recording.stills() {
            jpeg |= still::is_jpeg(file)?;
        }
        for frame in recording.frames(0..recording.frame_count()).map_err(failed)?.step_by(every) {
            report_progress(&mut progress, done, all)?;
            done += 1;
            calibrator.add_frame(&frame.map_err(failed)?.pixels).map_err(in_file(&recording.path))?;
        }
    }
    let mut calibration = calibrator.finish()?;
    calibration.warnings.extend(jpeg.then_some(Warning::Jpeg));
    Ok(calibration)
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

/// Scenes as (known mean, files).
type Scenes = Vec<(Option<PathBuf>, Vec<PathBuf>)>;

fn group(frames: &[PathBuf], means: &[PathBuf]) -> Result<Scenes, CalibrateError> {
    if frames.is_empty() {
        return Err(CalibrateError::NoFrames);
    }
    let paired = means.len() > 1;
    if paired && means.len() != frames.len() {
        return Err(CalibrateError::MeansCount { means: means.len(), entries: frames.len() });
    }
    let mut scenes = Scenes::new();
    let mut loose = Vec::new();
    for (i, path) in frames.iter().enumerate() {
        let mean = if paired { means.get(i) } else { means.first() }.cloned();
        if path.is_dir() {
            scenes.push((mean, pictures_in(path)?));
        } else if paired {
            scenes.push((mean, vec![path.clone()]));
        } else {
            loose.push(path.clone());
        }
    }
    if !loose.is_empty() {
        scenes.push((means.first().cloned(), loose));
    }
    Ok(scenes)
}

fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, CalibrateError> {
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
            "no PNG or JPEG files in this folder; of a recording give the folder of its frames, or the recording itself \
             with --moving for a camera that was not at rest"
                .to_owned(),
        ));
    }
    files.sort();
    Ok(files)
}

/// Reads a file as recordings do: a truncated file is an error.
fn read(path: &Path) -> Result<Pixels, CalibrateError> {
    Ok(still::read_pixels(path)?)
}
