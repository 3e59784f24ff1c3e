//! The camera's settings by the EXIF and telemetry of pictures and videos.

use std::path::PathBuf;

use crate::frame::PhotoSettings;
use crate::source::exif::{self, Exif};
use crate::source::orientation::Orientation;
use crate::source::telemetry;
use crate::source::video::Video;
use crate::text;

/// Largest difference between the ends of a video and of the subtitles beside it, s. Subtitles of a
/// video that was cut since do not fit.
const MAX_SIDECAR_DIFFERENCE_S: f64 = 1.5;

/// The camera's settings of each frame of a video with telemetry, and the file beside the video
/// that they are from. If it cannot be used, a warning.
pub fn of_video(video: &Video, times_s: &[f64], warnings: &mut Vec<String>) -> (Vec<PhotoSettings>, Option<PathBuf>) {
    if video.is_retimed {
        return Default::default();
    }
    let telemetry = match telemetry::read(&video.file) {
        Ok(Some(telemetry)) => telemetry,
        Ok(None) => return Default::default(),
        Err(error) => {
            warnings.push(format!("the camera's telemetry is not read: {error}"));
            return Default::default();
        }
    };
    let zero_s = times_s.first().copied().unwrap_or_default();
    let after_start_s = |time_s: &f64| video.start_s + time_s - zero_s;
    let end_s = times_s.last().map_or(0.0, after_start_s);
    if let Some(sidecar) =
        telemetry.sidecar.as_ref().filter(|_| (telemetry.end_s() - end_s).abs() > MAX_SIDECAR_DIFFERENCE_S)
    {
        warnings.push(format!(
            "{}: ends at {} s, the video at {} s, so it belongs to another cut; exposures are not read from it",
            sidecar.display(),
            text::fixed(telemetry.end_s(), 1),
            text::fixed(end_s, 1)
        ));
        return Default::default();
    }
    let settings = times_s.iter().map(|time_s| telemetry.at(after_start_s(time_s))).collect();
    (settings, telemetry.sidecar)
}

/// The camera's settings of each picture by EXIF, and their common orientation. Damaged EXIF is
/// skipped with a warning. An orientation is warned about and not applied.
pub fn of_stills(files: &[PathBuf], warnings: &mut Vec<String>) -> (Vec<PhotoSettings>, Orientation) {
    // Unreadable files were refused before.
    let read = |file: &PathBuf| exif::read(file).unwrap_or_default();
    let photos: Vec<(&PathBuf, Exif)> = files.iter().map(|file| (file, read(file))).collect();
    let mut damaged = photos.iter().filter_map(|(file, exif)| Some((file, exif.damage.as_ref()?)));
    if let Some((file, first)) = damaged.next() {
        let number = text::count(1 + damaged.count(), "picture");
        warnings.push(format!("{}: {first}; such data is left out, in {number}", file.display()));
    }
    let mut turned = photos.iter().filter_map(|(file, exif)| Some((file, exif.orientation?)));
    let mut common = Orientation::default();
    if let Some((file, orientation)) = turned.next() {
        let shown = Orientation::of_exif(orientation);
        let number = text::count(1 + turned.count(), "picture");
        let are_alike = photos.iter().all(|(_, exif)| exif.orientation == Some(orientation));
        let output = if are_alike {
            "a written .mp4 has the same tag, which players apply; a .mkv has no such tag"
        } else {
            "a written video has no such tag, since the others differ"
        };
        warnings.push(format!(
            "{}: is tagged to be shown {shown} (EXIF orientation {orientation}); read as stored, in {number} with this \
             tag; {output}",
            file.display()
        ));
        if are_alike {
            common = shown;
        }
    }
    (photos.into_iter().map(|(_, exif)| exif.settings).collect(), common)
}
