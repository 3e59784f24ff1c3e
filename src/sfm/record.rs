//! Writes solved footage as a recording.

use std::path::Path;

use super::footage::{FootageFrames, NOMINAL_FPS};
use super::gauge::UpSource;
use super::solution::Solution;
use crate::recording::new_folder::{FileContents, NewFolder, RecordError, name_of};
use crate::recording::write::{self, CameraFile, Description, FILE_NAME, FrameFiles, Line, PoseFile};
use crate::source::still_format;

const POSES: &str = "poses.txt";
const CAMERA: &str = "camera.toml";
const VIDEO: &str = "video";
const PICTURES: &str = "images";
/// Photographs a second: no motion is interpolated from one to the next.
const PHOTOGRAPH_FPS: f64 = 1.0;

fn is_own(name: &str) -> bool {
    let path = Path::new(name);
    let is_picture = || path.starts_with(PICTURES) && still_format::is_picture_name(path);
    let is_video = || !name.contains('/') && path.file_stem().is_some_and(|stem| stem == VIDEO);
    [FILE_NAME, POSES, CAMERA].contains(&name) || is_video() || is_picture()
}

/// The place of a solved recording.
pub fn new_folder(place: &Path, force: bool) -> NewFolder<'_> {
    NewFolder { place, force, is_own }
}

/// Writes a recording with a camera's `profile`. The footage is copied into it.
pub fn record(
    folder: &NewFolder<'_>,
    footage: &FootageFrames,
    solution: &Solution,
    profile: String,
) -> Result<(), RecordError> {
    let fps = if footage.is_unordered() { PHOTOGRAPH_FPS } else { NOMINAL_FPS };
    let (frames, times_s): (FrameFiles, Vec<f64>) = match footage {
        FootageFrames::Video(video) => {
            let ending = video.file.extension().map(|ending| format!(".{}", ending.to_string_lossy()));
            let video_name = format!("{VIDEO}{}", ending.unwrap_or_default());
            let frames = FrameFiles {
                video: Some(video_name.into()),
                range: Some(video.range),
                matrix: Some(video.matrix),
                ..FrameFiles::default()
            };
            (frames, solution.times_s.clone())
        }
        FootageFrames::Pictures { files, .. } => {
            let frames = FrameFiles { images: Some(PICTURES.into()), fps: Some(fps), ..FrameFiles::default() };
            (frames, (0..files.len()).map(|i| i as f64 / fps).collect())
        }
    };
    let lines: Vec<Line> = times_s
        .iter()
        .zip(&solution.frames)
        .filter_map(|(time_s, frame)| Some(Line::new(*time_s, &frame.as_ref()?.pose)))
        .collect();
    let description = Description {
        version: 1,
        name: Some(name_of(folder.place)?),
        up: Some([0.0, 0.0, 1.0]),
        floor: solution.gauge.up != UpSource::Cameras,
        frames: frames.clone(),
        poses: PoseFile {
            trajectory: Some(POSES.into()),
            max_gap_s: Some(max_gap_s(&times_s, footage.is_unordered())),
            ..PoseFile::default()
        },
        depth: None,
        exposure: None,
        live: None,
        camera: Some(CameraFile { profile: Some(CAMERA.into()), kind: None, list: None }),
    };
    let mut contents = vec![
        (FILE_NAME.to_owned(), FileContents::Text(write::description(description)?.to_string())),
        (POSES.to_owned(), FileContents::Text(write::trajectory(&lines))),
        (CAMERA.to_owned(), FileContents::Text(profile)),
    ];
    match footage {
        FootageFrames::Video(video) => {
            let name = frames.video.unwrap_or_default().to_string_lossy().into_owned();
            contents.push((name, FileContents::Copy(&video.file)));
        }
        FootageFrames::Pictures { files, .. } => contents.extend(files.iter().map(|file| {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            (format!("{PICTURES}/{name}"), FileContents::Copy(file.as_path()))
        })),
    }
    folder.write(&contents)
}

/// Longest interval across which poses are interpolated, s: one and a half frame intervals of a
/// video. No frame without a pose gets one.
fn max_gap_s(times_s: &[f64], is_unordered: bool) -> f64 {
    let longest_s = times_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    let shortest_s = times_s.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    match is_unordered {
        true => 0.5 / PHOTOGRAPH_FPS,
        false => (1.5 * longest_s).min(1.9 * shortest_s).max(1e-3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_files_are_those_that_are_written() {
        for name in ["recording.toml", "poses.txt", "camera.toml", "video.mp4", "images/IMG_1.JPG"] {
            assert!(is_own(name), "{name}");
        }
        for name in ["notes.txt", "images/notes.txt", "other/a.png", "sub/video.mp4", "a.png"] {
            assert!(!is_own(name), "{name}");
        }
    }

    #[test]
    fn gap_is_longer_than_an_interval_and_shorter_than_two() {
        assert_eq!(max_gap_s(&[0.0, 0.5, 1.0], false), 0.75);
        assert_eq!(max_gap_s(&[0.0, 1.0, 2.0], true), 0.5);
    }
}
