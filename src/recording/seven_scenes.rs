//! A sequence of Microsoft's 7-Scenes: `frame-000000.color.png` (or `.jpg`), `.depth.png`,
//! `.pose.txt`. The pose is a 4×4 matrix of the *depth* camera in the world (camera to world),
//! OpenCV axes, metres. Depth is in millimetres, of the depth camera's own view, not the colour
//! picture's; 0 and 65535 are nothing. There are no times: 30 frames a second are taken. Up is not
//! known. Source: Shotton et al., "Scene coordinate regression forests", CVPR 2013,
//! <https://www.microsoft.com/en-us/research/project/rgb-d-dataset-7-scenes/>.
//!
//! The depth camera's intrinsics are published. The colour camera's, and its offset from the depth
//! camera, are not: a Kinect's usual focal length is assumed, and the offset that aligns edges of
//! depth and colour best.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use super::depth::{DepthEncoding, DepthFiles};
use super::parts::{NOMINAL_FPS, Parts, Pictures, RecordingFormat, geometry_from, track_from};
use super::rigid::{NOT_RIGID, is_lost, rigid};
use super::{OpenOptions, RecordingError, listing};
use crate::camera::{Geometry, LensModel};
use crate::depth::DepthCamera;
use crate::pose::Pose;
use crate::source::still;
use crate::tracking::records::{self, TextError};
use crate::tracking::tum::PoseNotes;

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "7-Scenes",
    // The Kinect's 30 frames a second, although no times are stored.
    has_times: true,
    is_metric: true,
    find: |path| (path.is_dir() && has_picture(path)).then(|| path.to_owned()),
    open: |folder, _, options| open(folder, options),
};

const CODES_PER_METRE: f64 = 1000.0;
/// Focal lengths for pictures of 640×480.
const DEPTH_FOCAL_PX: f64 = 585.0;
const COLOUR_FOCAL_PX: f64 = 525.0;
/// Position of the colour camera in the depth camera's axes: to its right.
const COLOUR_AT_M: DVec3 = DVec3::new(0.025, 0.0, 0.0);

/// `frame-000000`, from the name of a colour picture.
fn stem(file: &Path) -> Option<&str> {
    let name = file.file_name()?.to_str()?;
    let stem = [".color.png", ".color.jpg"].into_iter().find_map(|ending| name.strip_suffix(ending))?;
    stem.strip_prefix("frame-")?.bytes().all(|c| c.is_ascii_digit()).then_some(stem)
}

fn has_picture(folder: &Path) -> bool {
    std::fs::read_dir(folder)
        .is_ok_and(|entries| entries.flatten().any(|entry| stem(Path::new(&entry.file_name())).is_some()))
}

fn open(folder: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let mut files = listing::pictures_in(folder)?;
    files.retain(|file| stem(file).is_some());
    let sibling_file = |file: &Path, ending: &str| folder.join(format!("{}{ending}", stem(file).unwrap_or_default()));
    let number_of = |file: &PathBuf| {
        let digits = stem(file).and_then(|stem| stem.strip_prefix("frame-")).unwrap_or_default();
        digits.parse::<u32>().map_err(|_| RecordingError::content(file, "its number is too large"))
    };
    let numbers = files.iter().map(number_of).collect::<Result<Vec<u32>, _>>()?;
    // Missing frames keep their time.
    let times_s: Vec<f64> = numbers.iter().map(|n| f64::from(n - numbers[0]) / NOMINAL_FPS).collect();
    let (mut poses, mut description_files, mut depths) = (Vec::new(), Vec::new(), Vec::new());
    let mut odd = PoseNotes::default();
    for (file, time_s) in files.iter().zip(&times_s) {
        let pose = sibling_file(file, ".pose.txt");
        // A frame with lost tracking may have no pose file.
        if pose.exists() {
            match parse_pose(&records::read(&pose)?, &pose)? {
                Some(pose) => poses.push((*time_s, pose)),
                None => odd.count_lost(pose.file_name().unwrap_or_default().to_string_lossy().into_owned()),
            }
            description_files.push(pose);
        }
        let depth = sibling_file(file, ".depth.png");
        if depth.exists() {
            depths.push((*time_s, depth));
        }
    }
    let colour = camera_of(files.iter(), COLOUR_FOCAL_PX)?;
    let depth_camera = camera_of(depths.iter().map(|(_, file)| file), DEPTH_FOCAL_PX)?;
    let mut parts = Parts::new(folder, Pictures::Stills(files), times_s);
    parts.warnings = odd.warnings(folder, poses.len());
    parts.track = track_from(poses, options.max_gap_s.or(Some(1.5 / NOMINAL_FPS)), folder)?;
    parts.geometries = vec![colour; parts.timestamps_s.len()];
    parts.depth = depth_camera.map(|camera| {
        let camera = Some(DepthCamera::new(camera, colour_from_depth()));
        let stored = DepthEncoding { invalid_from: Some(u16::MAX), camera, ..DepthEncoding::plain(CODES_PER_METRE) };
        DepthFiles { by_time: depths, stored }
    });
    parts.description_files = description_files;
    parts.warnings.push(format!(
        "7-Scenes has neither timestamps nor a calibration of its cameras: assumed are {NOMINAL_FPS} frames a second, \
         f = {DEPTH_FOCAL_PX} px for depth and {COLOUR_FOCAL_PX} px for colour at 640x480, and colour {} mm to the \
         right of depth",
        1e3 * COLOUR_AT_M.x
    ));
    Ok(parts)
}

fn colour_from_depth() -> Pose {
    Pose::new(DQuat::IDENTITY, -COLOUR_AT_M)
}

/// The camera of the first readable picture; `None` without any picture.
fn camera_of<'a>(files: impl Iterator<Item = &'a PathBuf>, focal_px: f64) -> Result<Option<Geometry>, RecordingError> {
    let mut problem = None;
    for file in files {
        match camera(file, focal_px) {
            Ok(camera) => return Ok(Some(camera)),
            Err(error) => problem = problem.or(Some(error)),
        }
    }
    problem.map_or(Ok(None), Err)
}

/// The camera of a picture, with a focal length that refers to a width of 640 pixels.
fn camera(file: &Path, focal_px: f64) -> Result<Geometry, RecordingError> {
    let header = still::read_header(file)?;
    let (width, height) = (f64::from(header.width), f64::from(header.height));
    let focal_px = focal_px * width / 640.0;
    let values = [
        ("width_px", width),
        ("height_px", height),
        ("fx_px", focal_px),
        ("fy_px", focal_px),
        ("cx_px", 0.5 * width),
        ("cy_px", 0.5 * height),
    ];
    geometry_from(LensModel::Opencv, &values).map_err(|e| RecordingError::content(file, e))
}

/// The colour camera's pose, from the depth camera's in the world. `None` if tracking was lost: the
/// file is empty, or the matrix is not finite or without a rotation.
fn parse_pose(text: &str, file: &Path) -> Result<Option<Pose>, RecordingError> {
    if records::records(text).next().is_none() {
        return Ok(None);
    }
    let mut rows = [[0.0; 4]; 4];
    let mut records = records::records(text);
    for row in &mut rows {
        let (line, mut rest) = records.next().unwrap_or((text.lines().count().max(1), ""));
        let refuse =
            |problem: String| TextError::line(file, line, format!("{problem} (a pose is four rows of four numbers)"));
        for (value, column) in row.iter_mut().zip(["column 1", "column 2", "column 3", "column 4"]) {
            *value = records::pose_number(&mut rest, column).map_err(refuse)?;
        }
        records::end(rest).map_err(refuse)?;
    }
    if is_lost(&rows) {
        return Ok(None);
    }
    let [a, b, c, last] = rows;
    let refuse = || RecordingError::content(file, format!("the pose {NOT_RIGID}"));
    let (turn, at_m) = rigid([a, b, c]).filter(|_| last == [0.0, 0.0, 0.0, 1.0]).ok_or_else(refuse)?;
    let world_from_depth = DQuat::from_mat3(&turn).normalize();
    let colour_at_m = at_m + world_from_depth * COLOUR_AT_M;
    Ok(Some(Pose::from_camera_in_world(colour_at_m, world_from_depth)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use proptest::prelude::*;

    #[test]
    fn projected_point_matches_hand_calculation() {
        // The depth camera is at (1, 2, 3) and rotated by 90° about z: its x is the world's y. So
        // the colour camera is at (1, 2.025, 3).
        let text = "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n";
        let pose = parse_pose(text, Path::new("a.pose.txt")).unwrap().unwrap();
        assert!((pose.position_in_world_m() - DVec3::new(1.0, 2.025, 3.0)).length() < 1e-12);
        // 2 m ahead of the depth camera, 0.4 m to its right: f·x/z = 525 · 0.375 / 2 right of the
        // picture's centre.
        let in_depth = DVec3::new(0.4, 0.0, 2.0);
        let in_camera = pose.transform_point(DVec3::new(1.0, 2.4, 5.0));
        assert!((in_camera - colour_from_depth().transform_point(in_depth)).length() < 1e-12, "{in_camera}");
        let camera = geometry_from(LensModel::Opencv, &[("fx_px", 525.0), ("cx_px", 320.0)]).unwrap();
        let at = camera.project(in_camera).unwrap();
        assert!((at - DVec2::new(418.4375, 240.0)).length() < 1e-9, "{at}");
    }

    #[test]
    fn non_finite_or_empty_pose_is_lost() {
        let of_rows = |value: &str| format!("{value} {value} {value} {value}\n").repeat(4);
        let not_finite = [of_rows("-inf"), of_rows("nan"), of_rows("inf"), of_rows("0")];
        let zeros = "0 0 0 0\n0 0 0 0\n0 0 0 0\n0 0 0 1\n".to_owned();
        for text in not_finite.into_iter().chain([zeros, String::new(), "\n".to_owned()]) {
            assert!(parse_pose(&text, Path::new("a.pose.txt")).unwrap().is_none(), "{text}");
        }
    }

    #[test]
    fn refusals_name_file_and_line() {
        for (text, said) in [
            ("1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1", "a.pose.txt, line 2: column 4 is missing"),
            ("1 0 0 0\n0 1 0 x\n0 0 1 0\n0 0 0 1", "line 2: column 4 is `x`; a finite number"),
            ("1 0 0 0 0\n", "line 1: there is more than expected: `0`"),
            ("1 0 0 0\n0 2 0 0\n0 0 1 0\n0 0 0 1", "the pose is not a rotation and a translation"),
            ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1 1", "the pose is not a rotation and a translation"),
        ] {
            let error = parse_pose(text, Path::new("a.pose.txt")).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn picture_names_are_recognised() {
        assert_eq!(stem(Path::new("a/frame-000012.color.jpg")), Some("frame-000012"));
        for other in ["frame-000012.depth.png", "frame-x.color.png", "frame.color.png", "12.color.png"] {
            assert_eq!(stem(Path::new(other)), None, "{other}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.eNa]{0,5}[ \n]){0,20}") {
            let _ = parse_pose(&text, Path::new("a"));
            let _ = parse_pose(&near, Path::new("a"));
        }
    }
}
