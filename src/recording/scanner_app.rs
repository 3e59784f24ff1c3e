//! An export of all data by the 3D Scanner App (Laan Labs) from a phone: `frame_00000.json` with
//! the picture `frame_00000.jpg`, and `depth_00000.png` of a phone with a depth sensor. Many frames
//! have no picture; their poses serve the track. A JSON file has `time` in seconds,
//! `cameraPoseARFrame`, the camera in the world as a 4×4 matrix row by row, metres, with ARKit's
//! axes (x right, y up, looking along −z; the world's y is up), and `intrinsics` as a 3×3 matrix
//! row by row, px of the picture. Depth is in millimetres, smaller than the picture, with the same
//! field of view.
//!
//! Not read: `conf_00000.png`, meshes. Distortion and readout time are not exported: ARKit delivers
//! pictures that are nearly free of distortion.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;

use super::depth::{DepthEncoding, DepthFiles};
use super::listing::natural_order;
use super::parts::{Parts, Pictures, RecordingFormat, pinhole_geometry, track_from};
use super::rigid::{NOT_RIGID, is_lost, rigid};
use super::{OpenOptions, RecordingError};
use crate::pose::Pose;
use crate::source::{file, still};

const CODES_PER_METRE: f64 = 1000.0;
/// A key of every frame, by which an export is recognised.
const POSE_KEY: &str = "cameraPoseARFrame";

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "3D Scanner App",
    has_times: true,
    is_metric: true,
    find: |path| {
        let first = frame_files(path).into_iter().next()?;
        read_text(&first).is_ok_and(|text| text.contains(POSE_KEY)).then(|| path.to_owned())
    },
    open: |folder, _, options| open(folder, options),
};

/// A frame's JSON file.
#[derive(Debug, Deserialize)]
struct ScannedFrame {
    time: f64,
    #[serde(rename = "cameraPoseARFrame")]
    pose: Vec<f64>,
    intrinsics: Vec<f64>,
}

/// The frames' JSON files in the order of their numbers.
fn frame_files(folder: &Path) -> Vec<PathBuf> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_frame = |path: &PathBuf| name(path).starts_with("frame_") && path.extension().is_some_and(|e| e == "json");
    let mut files: Vec<PathBuf> = entries.filter(is_frame).collect();
    files.sort_by(|a, b| natural_order(&name(a), &name(b)));
    files
}

fn read_text(path: &Path) -> std::io::Result<String> {
    file::read_text(path, file::MAX_DOCUMENT_BYTES)
}

fn open(folder: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let (mut poses, mut pictures, mut times_s, mut geometries, mut depths) =
        (Vec::<(f64, Pose)>::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let files = frame_files(folder);
    for file in &files {
        let refuse = |problem: String| RecordingError::content(file, problem);
        let text = read_text(file).map_err(|error| refuse(crate::text::reason(&error)))?;
        let frame: ScannedFrame = serde_json::from_str(&text)
            .map_err(|error| refuse(format!("is no frame of the 3D Scanner App: {error}; export all data again")))?;
        if poses.last().is_some_and(|(before_s, _)| frame.time <= *before_s) || !frame.time.is_finite() {
            return Err(refuse(format!("time is {}; expected one after that of the frame before", frame.time)));
        }
        poses.extend(pose(&frame.pose).map_err(refuse)?.map(|pose| (frame.time, pose)));
        let depth = depth_file(file);
        depths.extend(depth.is_file().then_some((frame.time, depth)));
        let picture = file.with_extension("jpg");
        if !picture.is_file() {
            continue;
        }
        let header = still::read_header(&picture)?;
        let intrinsics = pinhole(&frame.intrinsics).map_err(refuse)?;
        let geometry = pinhole_geometry(intrinsics, header.width, header.height);
        geometries.push(Some(geometry.map_err(|error| RecordingError::content(file, error))?));
        times_s.push(frame.time);
        pictures.push(picture);
    }
    let list = folder.join("frame_*.json");
    let mut parts = Parts::new(folder, Pictures::Stills(pictures), times_s);
    parts.geometries = geometries;
    parts.up = Some(DVec3::Y);
    parts.track = track_from(poses, options.max_gap_s, &list)?;
    if !depths.is_empty() {
        parts.depth = Some(DepthFiles { by_time: depths, stored: DepthEncoding::plain(CODES_PER_METRE) });
    }
    parts.description_files = files;
    Ok(parts)
}

/// `depth_00000.png` of `frame_00000.json`.
fn depth_file(frame: &Path) -> PathBuf {
    let name = frame.file_stem().unwrap_or_default().to_string_lossy().replacen("frame_", "depth_", 1);
    frame.with_file_name(name + ".png")
}

/// `None` if tracking was lost.
fn pose(values: &[f64]) -> Result<Option<Pose>, String> {
    let (rows, rest) = values.as_chunks::<4>();
    let ([a, b, c, _], []) = (rows, rest) else {
        return Err(format!("{POSE_KEY} holds {} numbers; 16 are needed, row by row", values.len()));
    };
    if is_lost(rows) {
        return Ok(None);
    }
    let (turn, position_m) = rigid([*a, *b, *c]).ok_or_else(|| format!("{POSE_KEY} {NOT_RIGID}"))?;
    // OpenCV's y and z axes are ARKit's, reversed.
    let world_from_camera = DMat3::from_cols(turn.x_axis, -turn.y_axis, -turn.z_axis);
    Ok(Some(Pose::from_camera_in_world(position_m, DQuat::from_mat3(&world_from_camera))))
}

/// fx, fy, cx, cy of a matrix row by row.
fn pinhole(values: &[f64]) -> Result<[f64; 4], String> {
    match values {
        [fx, _, cx, _, fy, cy, _, _, _] => Ok([*fx, *fy, *cx, *cy]),
        _ => Err(format!("intrinsics holds {} numbers; 9 are needed, row by row", values.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The camera at (x, 2, 3), unrotated: it faces the world's −z.
    fn frame(time_s: f64, x_m: f64) -> String {
        format!(
            "{{\"time\":{time_s},\"frame_index\":1,\"motionQuality\":1,\
             \"cameraPoseARFrame\":[1,0,0,{x_m},0,1,0,2,0,0,1,3,0,0,0,1],\"intrinsics\":[20,0,8,0,21,6,0,0,1]}}"
        )
    }

    fn open_frames(texts: &[String]) -> Result<Parts, RecordingError> {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: String, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        texts.iter().enumerate().for_each(|(n, text)| write(format!("frame_{n:05}.json"), text));
        image::RgbImage::new(16, 12).save(folder.path().join("frame_00001.jpg")).unwrap();
        image::ImageBuffer::from_pixel(4, 3, image::Luma([1500u16]))
            .save(folder.path().join("depth_00001.png"))
            .unwrap();
        assert_eq!((FORMAT.find)(folder.path()).as_deref(), Some(folder.path()));
        open(folder.path(), &OpenOptions::default())
    }

    #[test]
    fn frame_with_a_picture_has_pose_camera_and_depth() {
        let parts = open_frames(&[frame(5.0, 0.0), frame(5.1, 1.0), frame(5.2, 2.0)]).unwrap();
        assert_eq!((parts.timestamps_s.as_slice(), parts.up), (&[5.1][..], Some(DVec3::Y)));
        // One metre ahead of the camera, above and to the right of the picture's middle.
        let point = parts.track.at(5.1).unwrap().transform_point(DVec3::new(1.5, 2.5, 2.0));
        assert!(point.distance(DVec3::new(0.5, -0.5, 1.0)) < 1e-12, "{point}");
        // Frames without a picture give poses.
        assert!(parts.track.at(5.15).is_ok());
        let intrinsics = &parts.geometries[0].as_ref().unwrap().intrinsics;
        assert_eq!((intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px), (20.0, 21.0, 8.0, 6.0));
        assert_eq!(parts.depth.unwrap().by_time.len(), 1);
    }

    #[test]
    fn damaged_frames_are_named() {
        let refused = |text: String| open_frames(&[frame(5.0, 0.0), text]).err().unwrap().to_string();
        assert!(refused(frame(5.0, 0.0)).contains("frame_00001.json: time is 5"));
        assert!(refused("{\"time\":1".to_owned()).contains("export all data again"));
        assert!(refused(frame(5.1, 0.0).replace("[1,0,0,", "[2,0,0,")).contains(NOT_RIGID));
        assert!(refused(frame(5.1, 0.0).replace("20,0,8,", "20,0,")).contains("intrinsics holds 8 numbers"));
    }

    proptest! {
        #[test]
        fn any_numbers_never_panic(values in prop::collection::vec(any::<f64>(), 0..20)) {
            let _ = (pose(&values), pinhole(&values));
        }
    }
}
