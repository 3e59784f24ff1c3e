//! Writes a tracked video as a recording.

use std::path::Path;

use super::board::Board;
use super::continuity::ChosenPose;
use super::track::Track;
use crate::recording::new_folder::{FileContents, NewFolder, RecordError, name_of};
use crate::recording::write::{self, CameraFile, Description, FILE_NAME, FrameFiles, Line, PoseFile};
use crate::source::video::Video;

const POSES: &str = "poses.txt";
const COVARIANCE: &str = "covariance.txt";
const CAMERA: &str = "camera.toml";
const BOARD: &str = "board.toml";
const VIDEO: &str = "video";

fn is_ours(name: &str) -> bool {
    [FILE_NAME, POSES, COVARIANCE, CAMERA, BOARD].contains(&name)
        || (!name.contains('/') && Path::new(name).file_stem().is_some_and(|stem| stem == VIDEO))
}

/// The place of a tracked recording.
pub fn new_folder(place: &Path, force: bool) -> NewFolder<'_> {
    NewFolder { place, force, is_own: is_ours }
}

/// Inputs of a recording.
#[derive(Debug)]
pub struct RecordingInputs<'a> {
    pub video: &'a Video,
    /// Text of the camera's profile.
    pub profile: &'a str,
    pub board: &'a Board,
    pub track: &'a Track,
}

/// Writes a recording. The video is copied into it.
pub fn record(folder: &NewFolder<'_>, parts: &RecordingInputs<'_>) -> Result<(), RecordError> {
    let texts = texts(&name_of(folder.place)?, parts)?;
    let mut files: Vec<_> = texts.map(|(name, text)| (name, FileContents::Text(text))).into();
    files.push((video_name(parts.video), FileContents::Copy(&parts.video.file)));
    folder.write(&files)
}

fn video_name(video: &Video) -> String {
    let ending = video.file.extension().map(|ending| format!(".{}", ending.to_string_lossy()));
    format!("{VIDEO}{}", ending.unwrap_or_default())
}

fn texts(
    name: &str,
    RecordingInputs { video, profile, board, track }: &RecordingInputs<'_>,
) -> Result<[(String, String); 5], RecordError> {
    let description = Description {
        version: 1,
        name: Some(name.to_owned()),
        up: Some([0.0, 0.0, 1.0]),
        floor: true,
        frames: FrameFiles {
            video: Some(video_name(video).into()),
            range: Some(video.range),
            matrix: Some(video.matrix),
            ..FrameFiles::default()
        },
        poses: PoseFile { trajectory: Some(POSES.into()), max_gap_s: Some(track.max_gap_s()), ..PoseFile::default() },
        depth: None,
        exposure: None,
        live: None,
        camera: Some(CameraFile { profile: Some(CAMERA.into()), kind: None, list: None }),
    };
    let lines: Vec<Line> = track.chosen().map(|chosen| Line::new(chosen.time_s, &chosen.solved.pose)).collect();
    let covariances: Vec<_> = track.chosen().map(ChosenPose::covariance).collect();
    Ok([
        (FILE_NAME.to_owned(), write::description(description)?.to_string()),
        (POSES.to_owned(), write::trajectory(&lines)),
        (COVARIANCE.to_owned(), write::covariances(&covariances, true)),
        (CAMERA.to_owned(), (*profile).to_owned()),
        (BOARD.to_owned(), board.to_string()),
    ])
}
