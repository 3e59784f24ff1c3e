//! Frames for a calibration, from files and folders, one at a time.

use super::noise::{CalibrateError, NoiseCalibration, NoiseCalibrator, NoiseOptions};
use crate::image::Pixels;
use crate::source::still;
use std::path::{Path, PathBuf};

const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Calibrates from picture files. Each folder among `frames` is a scene (its PNG and JPEG files, in order of name);
/// all loose files together are one scene. `means`: none, one for everything, or one for each entry of `frames` (each
/// loose file is then a scene of its own).
pub fn noise_from_paths(
    frames: &[PathBuf],
    means: &[PathBuf],
    options: &NoiseOptions,
) -> Result<NoiseCalibration, CalibrateError> {
    let scenes = group(frames, means)?;
    let mut calibrator = NoiseCalibrator::new(options.clone())?;
    let mut jpeg = false;
    for (number, (mean, files)) in scenes.iter().enumerate() {
        if let (None, [only]) = (mean, files.as_slice()) {
            read(only)?;
            return Err(in_file(only)(CalibrateError::OneFrame { scene: number + 1 }));
        }
        calibrator.begin_scene(mean.as_deref().map(read).transpose()?)?;
        for file in files {
            calibrator.add_frame(&read(file)?).map_err(in_file(file))?;
            jpeg |= file.extension().is_some_and(|e| e.to_string_lossy().to_lowercase().starts_with('j'));
        }
        let first = files.first().map_or(Path::new(""), PathBuf::as_path);
        let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty());
        calibrator.end_scene().map_err(in_file(folder.unwrap_or(first)))?;
    }
    let mut calibration = calibrator.finish()?;
    if jpeg {
        let text = "some frames are JPEG: compression has changed their noise; use lossless frames where you can";
        calibration.warnings.push(text.to_owned());
    }
    Ok(calibration)
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
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if path.is_file() && ending.is_some_and(|e| ENDINGS.contains(&e.as_str())) {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(failed("no PNG or JPEG files in this folder".to_owned()));
    }
    files.sort();
    Ok(files)
}

/// As recordings are read: a file that ends too early is an error.
fn read(path: &Path) -> Result<Pixels, CalibrateError> {
    Ok(still::read_pixels(path)?)
}
