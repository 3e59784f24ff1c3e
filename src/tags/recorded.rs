//! Writes a tracked video as a recording: a folder that appears once it is complete.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::board::Board;
use super::continuity::ChosenPose;
use super::track::Track;
use crate::cleanup::{MadeFolder, Undo, Unfinished};
use crate::recording::RecordingError;
use crate::recording::write::{self, CameraFile, Description, FILE_NAME, FrameFiles, Line, PoseFile};
use crate::source::video::Video;
use crate::text::reason;

const POSES: &str = "poses.txt";
const COVARIANCE: &str = "covariance.txt";
const CAMERA: &str = "camera.toml";
const BOARD: &str = "board.toml";
const VIDEO: &str = "video";

/// Reason why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("{}: exists already; choose another folder, or give --force to replace a recording that was tracked", .0.display())]
    Exists(PathBuf),
    #[error("{}: contains {foreign}, which does not belong to a tracked recording; nothing was removed: choose another \
             folder", folder.display())]
    Foreign { folder: PathBuf, foreign: String },
    #[error("{}: cannot be created as a folder", .0.display())]
    NoFolder(PathBuf),
    #[error("{}: lies in the folder that would be replaced; choose another folder", .0.display())]
    Within(PathBuf),
    #[error("{}: cannot be written: {}", path.display(), reason(source))]
    Write { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

fn writing(path: &Path) -> impl FnOnce(io::Error) -> RecordError {
    let path = path.to_owned();
    move |source| RecordError::Write { path, source }
}

fn is_ours(name: &str) -> bool {
    [FILE_NAME, POSES, COVARIANCE, CAMERA, BOARD].contains(&name)
        || Path::new(name).file_stem().is_some_and(|stem| stem == VIDEO)
}

/// Checks that a recording of these inputs may be written to a place: one that does not exist, an
/// empty folder, or with `force` a folder that only contains files of such a recording.
pub fn check(place: &Path, force: bool, inputs: &[&Path]) -> Result<(), RecordError> {
    let Ok(there) = fs::symlink_metadata(place) else { return Ok(()) };
    let folder = || place.to_owned();
    if !there.is_dir() {
        return Err(RecordError::Exists(folder()));
    }
    let own = place.canonicalize().map_err(writing(place))?;
    if let Some(input) = inputs.iter().find(|input| input.canonicalize().is_ok_and(|input| input.starts_with(&own))) {
        return Err(RecordError::Within(input.to_path_buf()));
    }
    let mut names = Vec::new();
    for entry in fs::read_dir(place).map_err(writing(place))? {
        let entry = entry.map_err(writing(place))?;
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        names.push((entry.file_name().to_string_lossy().into_owned(), is_file));
    }
    names.sort();
    let foreign = names.iter().find(|(name, is_file)| !(*is_file && is_ours(name)));
    match foreign {
        _ if names.is_empty() => Ok(()),
        _ if !force => Err(RecordError::Exists(folder())),
        Some((foreign, _)) => Err(RecordError::Foreign { folder: folder(), foreign: foreign.clone() }),
        None => Ok(()),
    }
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

/// Writes a recording to a place that [`check`] accepts. The video is copied into it.
pub fn record(place: &Path, force: bool, parts: &RecordingInputs<'_>) -> Result<(), RecordError> {
    let name = place.file_name().ok_or_else(|| RecordError::NoFolder(place.to_owned()))?.to_string_lossy().into_owned();
    let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let made = MadeFolder::make(parent).map_err(writing(parent))?;
    let (part, unfinished) = Unfinished::begin(|| {
        let mut builder = tempfile::Builder::new();
        let prefix = format!(".{name}.part-");
        builder.prefix(&prefix);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Like any folder: subject to the umask.
            builder.permissions(fs::Permissions::from_mode(0o777));
        }
        let part = builder.tempdir_in(parent)?;
        let path = part.path().to_owned();
        let undo: Undo = Box::new(move || _ = fs::remove_dir_all(path));
        Ok::<_, io::Error>((part, undo))
    })
    .map_err(writing(place))?;
    for (name, text) in texts(&name, parts)? {
        fs::write(part.path().join(&name), text).map_err(writing(&place.join(&name)))?;
    }
    let video = video_name(parts.video);
    fs::copy(&parts.video.file, part.path().join(&video)).map_err(writing(&place.join(&video)))?;
    unfinished.finish(|| {
        // Checked again: it may have changed meanwhile.
        check(place, force, &[])?;
        if place.exists() {
            for entry in fs::read_dir(place).map_err(writing(place))? {
                let path = entry.map_err(writing(place))?.path();
                fs::remove_file(&path).map_err(writing(&path))?;
            }
            fs::remove_dir(place).map_err(writing(place))?;
        }
        fs::rename(part.path(), place).map_err(writing(place))
    })?;
    made.keep();
    Ok(())
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
        poses: PoseFile { trajectory: Some(POSES.into()), time_offset_s: None, max_gap_s: Some(track.max_gap_s()) },
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
