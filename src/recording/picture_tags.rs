//! The camera's settings by the EXIF and telemetry of pictures and videos.

use std::path::PathBuf;

use crate::frame::PhotoSettings;
use crate::source::exif::{self, Exif};
use crate::source::orientation::Orientation;
use crate::source::telemetry;
use crate::source::video::Video;
use crate::text;

/// The camera's settings of each frame of a video with telemetry. If it cannot be read, a warning.
pub fn of_video(video: &Video, times_s: &[f64], warnings: &mut Vec<String>) -> Vec<PhotoSettings> {
    if video.is_retimed {
        return Vec::new();
    }
    match telemetry::read(&video.file) {
        Ok(Some(telemetry)) => {
            let zero_s = times_s.first().copied().unwrap_or_default();
            times_s.iter().map(|time_s| telemetry.at(video.start_s + time_s - zero_s)).collect()
        }
        Ok(None) => Vec::new(),
        Err(error) => {
            warnings.push(format!("the camera's telemetry is not read: {error}"));
            Vec::new()
        }
    }
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
