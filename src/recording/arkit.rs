//! A log of ARKit as `ios_logger` writes it: `ARposes.txt`, `Frames.txt`, `Frames.m4v`. Lines of
//! `ARposes.txt` are time, x, y, z, qw, qx, qy, qz: the camera in the world, metres, with ARKit's
//! axes (x right, y up, looking along −z). The world's y is up. Lines of `Frames.txt` are time,
//! number, fx, fy, cx, cy: the focal length changes with focus. Line i is frame i of the video; the
//! principal point is relative to the picture's upper left corner. Source:
//! <https://github.com/PyojinKim/ios_logger>.
//!
//! Not read: the other sensors' logs. Distortion and readout time are not logged: ARKit delivers
//! pictures that are nearly free of distortion.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use super::parts::{Parts, Pictures, RecordingFormat, file_or_in_folder, folder_of, pinhole_geometry, track_from};
use super::{OpenOptions, RecordingError};
use crate::pose::Pose;
use crate::source::video::{self, Overrides};
use crate::text::count;
use crate::tracking::records::{self, TextError};
use crate::tracking::tum::{PoseNotes, Trajectory, ascends, is_lost, unit_quaternion};

const POSES: &str = "ARposes.txt";
const FRAMES: &str = "Frames.txt";
/// Names of the video; the first is the app's.
const VIDEOS: [&str; 2] = ["Frames.m4v", "frames.m4v"];

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "ARKit log",
    has_times: true,
    is_metric: true,
    find: |path| file_or_in_folder(path, POSES).map(|list| folder_of(&list)),
    open: |folder, _, options| open(folder, options),
};

fn open(folder: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let [poses_file, frames_file] = [POSES, FRAMES].map(|name| folder.join(name));
    let Trajectory { poses, mut warnings } = parse_poses(&records::read(&poses_file)?, &poses_file)?;
    let frames = parse_frames(&records::read(&frames_file)?, &frames_file)?;
    let videos: Vec<PathBuf> = VIDEOS.iter().map(|name| folder.join(name)).collect();
    let video_file = videos.iter().find(|file| file.exists()).or(videos.first()).cloned().unwrap_or_default();
    let video = video::probe(&video_file, &Overrides { as_stored: true, ..Overrides::default() })?;
    warnings.extend(video.warnings.clone());
    let frame_count = frames.len().min(video.timestamps_s.len());
    if frames.len() != video.timestamps_s.len() {
        warnings.push(format!(
            "{} has {}, the video {}: the first {frame_count} of both are paired",
            frames_file.display(),
            count(frames.len(), "line"),
            count(video.timestamps_s.len(), "frame")
        ));
    }
    let frames = &frames[..frame_count];
    let (width, height) = (video.width, video.height);
    let geometry = |frame: &LoggedFrame| {
        let geometry = pinhole_geometry(frame.intrinsics, width, height);
        geometry.map(Some).map_err(|e| TextError::line(&frames_file, frame.line, e))
    };
    let geometries = frames.iter().map(geometry).collect::<Result<Vec<_>, _>>()?;
    let mut parts =
        Parts::new(folder, Pictures::Video(Box::new(video), None), frames.iter().map(|frame| frame.time_s).collect());
    parts.geometries = geometries;
    parts.up = Some(DVec3::Y);
    parts.track = track_from(poses, options.max_gap_s, &poses_file)?;
    parts.description_files = vec![poses_file, frames_file];
    parts.warnings = warnings;
    Ok(parts)
}

/// The fields of a line, separated by commas or blanks, with their names.
fn fields<const N: usize>(record: &str, names: [&str; N]) -> Result<[f64; N], String> {
    let spaced = record.replace(',', " ");
    let mut rest = spaced.as_str();
    let mut values = [0.0; N];
    for (value, name) in values.iter_mut().zip(names) {
        *value = records::pose_number(&mut rest, name)?;
    }
    records::end(rest)?;
    Ok(values)
}

/// Poses by time, and warnings.
fn parse_poses(text: &str, file: &Path) -> Result<Trajectory, TextError> {
    let (mut poses, mut notes): (Vec<(f64, Pose)>, _) = (Vec::new(), PoseNotes::default());
    for (line, record) in records::records(text) {
        let refuse = |problem| TextError::line(file, line, problem);
        let [time_s, x, y, z, qw, qx, qy, qz] =
            fields(record, ["time", "x", "y", "z", "qw", "qx", "qy", "qz"]).map_err(refuse)?;
        let (position, rotation) = (DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw));
        if !time_s.is_finite() {
            return Err(refuse(format!("time is {time_s}; a finite number is needed")));
        }
        if is_lost(position, rotation) {
            notes.count_lost(format!("line {line}"));
            continue;
        }
        ascends(poses.last().map(|before| before.0), time_s).map_err(refuse)?;
        let (rotation, norm_error) = unit_quaternion(rotation).map_err(refuse)?;
        notes.note(norm_error, format!("line {line}"));
        // OpenCV's y and z axes are ARKit's, reversed: half a turn about x.
        let world_from_camera = rotation * DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
        poses.push((time_s, Pose::from_camera_in_world(position, world_from_camera)));
    }
    let warnings = notes.warnings(file, poses.len());
    Ok(Trajectory { poses, warnings })
}

/// A line of `Frames.txt`.
#[derive(Debug)]
struct LoggedFrame {
    line: usize,
    time_s: f64,
    /// fx, fy, cx, cy.
    intrinsics: [f64; 4],
}

fn parse_frames(text: &str, file: &Path) -> Result<Vec<LoggedFrame>, TextError> {
    let mut frames: Vec<LoggedFrame> = Vec::new();
    for (line, record) in records::records(text) {
        let refuse = |problem| TextError::line(file, line, problem);
        let [time_s, _, fx, fy, cx, cy] = fields(record, ["time", "number", "fx", "fy", "cx", "cy"]).map_err(refuse)?;
        if !time_s.is_finite() || frames.last().is_some_and(|before| time_s < before.time_s) {
            return Err(refuse(format!(
                "time is {time_s}; a finite number is needed, not below that of the line before"
            )));
        }
        frames.push(LoggedFrame { line, time_s, intrinsics: [fx, fy, cx, cy] });
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn poses(text: &str) -> Result<Vec<(f64, Pose)>, String> {
        parse_poses(text, Path::new(POSES)).map(|read| read.poses).map_err(|e| e.to_string())
    }

    #[test]
    fn arkit_axes_become_opencv_axes() {
        // Unturned at (1, 2, 3): the camera's axis is the world's −z, the world's y is up.
        let read = poses("# t\n5.5,1,2,3,1,0,0,0\n").unwrap();
        assert_eq!(read[0].0, 5.5);
        let p = read[0].1.transform_point(DVec3::new(1.5, 3.0, 1.0));
        assert!((p - DVec3::new(0.5, -1.0, 2.0)).length() < 1e-12, "{p}");
        // A quarter turn about y: the camera's axis is −x, its right is −z.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let read = poses(&format!("0,0,0,0,{half},0,{half},0\n")).unwrap();
        let p = read[0].1.transform_point(DVec3::new(-2.0, 0.5, -1.0));
        assert!((p - DVec3::new(1.0, -0.5, 2.0)).length() < 1e-12, "{p}");
    }

    #[test]
    fn lost_poses_are_left_out_and_mistakes_name_the_line() {
        assert_eq!(poses("1,0,0,0,1,0,0,0\n2,nan,0,0,1,0,0,0\n3,0,0,0,0,0,0,0\n").unwrap().len(), 1);
        for (text, said) in [
            ("1,0,0,0,1,0,0", "ARposes.txt, line 1: qz is missing"),
            ("1,0,0,0,1,0,0,x", "ARposes.txt, line 1: qz is `x`"),
            ("1,0,0,0,1,0,0,0,9", "ARposes.txt, line 1: there is more than expected"),
            ("1,0,0,0,0.5,0,0,0", "ARposes.txt, line 1: the quaternion has length 0.5"),
            ("nan,0,0,0,1,0,0,0", "ARposes.txt, line 1: time is NaN"),
            ("2,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0", "ARposes.txt, line 2: the time runs backwards"),
        ] {
            let error = poses(text).unwrap_err();
            assert!(error.starts_with(said), "{error}");
        }
        let error = parse_frames("1,0,5,5,2,1\n0.5,1,5,5,2,1", Path::new(FRAMES)).unwrap_err().to_string();
        assert!(error.starts_with("Frames.txt, line 2: time is 0.5"), "{error}");
        let frames = parse_frames("1,0,5,6,2,1", Path::new(FRAMES)).unwrap();
        assert_eq!((frames[0].time_s, frames[0].intrinsics), (1.0, [5.0, 6.0, 2.0, 1.0]));
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.eNa]{0,5}[,\n]){0,40}") {
            for text in [&text, &near] {
                let _ = poses(text);
                let _ = parse_frames(text, Path::new(FRAMES));
            }
        }
    }
}
