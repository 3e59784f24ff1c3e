//! A Stray Scanner export from a phone: `rgb.mp4`, `odometry.csv`, `camera_matrix.csv`, `depth/`,
//! `confidence/`. Frame i is line i of `odometry.csv`: seconds since boot, and the camera in the
//! world with OpenCV's axes, metres, y up. The principal point is relative to the picture's upper
//! left corner, as in ARKit. Depth is in millimetres, smaller than the video, with the same field
//! of view; pixels with confidence 0 count as not measured. Source:
//! <https://github.com/strayrobots/scanner>.
//!
//! Not read: `imu.csv`. The lens's distortion and the sensor's readout time are not in the export:
//! ARKit delivers pictures that are nearly free of distortion.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::depth::{DepthEncoding, DepthFiles};
use super::parts::{Parts, Pictures, RecordingFormat, file_or_in_folder, folder_of, pinhole_geometry, track_from};
use super::{OpenOptions, RecordingError};
use crate::pose::Pose;
use crate::source::video::{self, Overrides};
use crate::text::{count, number, quoted};
use crate::tracking::records::{self, TextError};
use crate::tracking::tum::{PoseNotes, is_lost, unit_quaternion};

const ODOMETRY: &str = "odometry.csv";
const MATRIX: &str = "camera_matrix.csv";
const CODES_PER_METRE: f64 = 1000.0;

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "Stray Scanner",
    has_times: true,
    is_metric: true,
    find: |path| file_or_in_folder(path, ODOMETRY).map(|list| folder_of(&list)),
    open: |folder, _, options| open(folder, options),
};

fn open(folder: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let odometry = folder.join(ODOMETRY);
    let mut list = records::read(&odometry)?;
    // If the phone ran out of power or storage, the last line is incomplete.
    let unended = if list.contains('\n') { records::drop_unended(&mut list) } else { None };
    let (lines, odd) = parse_odometry(&list, &odometry)?;
    let video = video::probe(&folder.join("rgb.mp4"), &Overrides { as_stored: true, ..Overrides::default() })?;
    let frames = lines.len().min(video.timestamps_s.len());
    let mut warnings = video.warnings.clone();
    warnings.extend(odd);
    let message = |line| format!("{}: the last line, {line}, is incomplete and left out", odometry.display());
    warnings.extend(unended.map(message));
    if lines.len() != video.timestamps_s.len() {
        warnings.push(format!(
            "{} has {}, the video {}: the first {frames} of both are paired",
            odometry.display(),
            count(lines.len(), "line"),
            count(video.timestamps_s.len(), "frame")
        ));
    }
    let mut description_files = vec![odometry.clone()];
    let matrix = folder.join(MATRIX);
    // Newer versions write each frame's intrinsics; the matrix is the last frame's.
    let of_all = if lines.iter().any(|line| line.intrinsics.is_none()) {
        description_files.push(matrix.clone());
        Some(parse_matrix(&records::read(&matrix)?, &matrix)?)
    } else {
        None
    };
    let of_size = |intrinsics| pinhole_geometry(intrinsics, video.width, video.height);
    let of_all = of_all.map(of_size).transpose().map_err(|e| RecordingError::content(&matrix, e))?;
    let camera = |line: &OdometryLine| {
        let own = line.intrinsics.map(of_size).transpose().map_err(|e| TextError::line(&odometry, line.at, e))?;
        Ok(own.or_else(|| of_all.clone()))
    };
    let geometries = lines[..frames].iter().map(camera).collect::<Result<Vec<_>, RecordingError>>()?;
    let mut parts =
        Parts::new(folder, Pictures::Video(Box::new(video), None), lines[..frames].iter().map(|l| l.time_s).collect());
    parts.geometries = geometries;
    parts.up = Some(DVec3::Y);
    let mut poses: Vec<(f64, Pose)> = Vec::new();
    let timed_poses = || lines.iter().filter_map(|line| Some((line.time_s, line.pose?)));
    for (time_s, pose) in timed_poses() {
        // Of two poses at one time the first is kept.
        if poses.last().is_none_or(|before| before.0 < time_s) {
            poses.push((time_s, pose));
        }
    }
    let repeated = timed_poses().count() - poses.len();
    if repeated > 0 {
        warnings.push(format!("{}: {} left out, with the time of the one before", odometry.display(), {
            if repeated == 1 { "1 pose is".to_owned() } else { format!("{repeated} poses are") }
        }));
    }
    parts.track = track_from(poses, options.max_gap_s, &odometry)?;
    if folder.join("depth").is_dir() {
        let (by_time, warning) = depth_pictures(folder, &lines[..frames], &odometry);
        warnings.extend(warning);
        let confidence = folder.join("confidence");
        let confidence_folder = confidence.is_dir().then_some(confidence);
        parts.depth = Some(DepthFiles {
            by_time,
            stored: DepthEncoding { confidence_folder, ..DepthEncoding::plain(CODES_PER_METRE) },
        });
    }
    parts.warnings = warnings;
    parts.description_files = description_files;
    Ok(parts)
}

/// Existing depth pictures, and a warning that names the first missing one.
fn depth_pictures(
    folder: &Path,
    lines: &[OdometryLine],
    odometry: &Path,
) -> (Vec<(f64, std::path::PathBuf)>, Option<String>) {
    let named = |line: &OdometryLine| folder.join("depth").join(format!("{}.png", line.name));
    let (there, missing): (Vec<_>, Vec<_>) = lines.iter().partition(|line| named(line).exists());
    let warning = missing.first().map(|first| {
        format!(
            "{}: {} of {} have no depth picture (first: line {}, {})",
            odometry.display(),
            missing.len(),
            count(lines.len(), "line"),
            first.at,
            named(first).display()
        )
    });
    (there.into_iter().map(|line| (line.time_s, named(line))).collect(), warning)
}

/// A line of `odometry.csv`.
#[derive(Debug)]
struct OdometryLine {
    /// Line number in the file, from 1.
    at: usize,
    time_s: f64,
    /// Stem of its pictures' names.
    name: String,
    /// `None` if tracking was lost.
    pose: Option<Pose>,
    /// fx, fy, cx, cy.
    intrinsics: Option<[f64; 4]>,
}

const COLUMNS: [&str; 9] = ["timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw"];

fn parse_odometry(text: &str, file: &Path) -> Result<(Vec<OdometryLine>, Vec<String>), TextError> {
    let mut records = records::records(text);
    let (at, header) = records.next().unwrap_or((1, ""));
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |name: &str| names.iter().position(|n| *n == name);
    if let Some(missing) = COLUMNS.into_iter().find(|name| column(name).is_none()) {
        let problem = format!("column {missing} is missing; the header is `{}`", COLUMNS.join(", "));
        return Err(TextError::line(file, at, problem));
    }
    let own_intrinsics = ["fx", "fy", "cx", "cy"].iter().all(|name| column(name).is_some());
    let (mut lines, mut odd): (Vec<OdometryLine>, _) = (Vec::new(), PoseNotes::default());
    for (at, record) in records {
        let fields: Vec<&str> = record.split(',').map(str::trim).collect();
        let refuse = |problem: String| TextError::line(file, at, problem);
        let field = |name: &str| {
            let text = column(name).and_then(|i| fields.get(i).copied()).filter(|text| !text.is_empty());
            text.ok_or_else(|| refuse(format!("column {name} is missing")))
        };
        let not_finite =
            |name: &str, text: &str| refuse(format!("column {name} is `{}`; a finite number is needed", quoted(text)));
        let any = |name: &str| {
            let text = field(name)?;
            text.parse::<f64>().map_err(|_| not_finite(name, text))
        };
        let value = |name: &str| match any(name)? {
            n if n.is_finite() => Ok(n),
            _ => Err(not_finite(name, field(name)?)),
        };
        let time_s = value("timestamp")?;
        if let Some(before) = lines.last().filter(|before| time_s < before.time_s) {
            let (time, before) = (number(time_s), number(before.time_s));
            return Err(refuse(format!("column timestamp runs backwards: {time} after {before}")));
        }
        let name = field("frame")?;
        if name.len() > 20 || !name.bytes().all(|c| c.is_ascii_digit()) {
            return Err(refuse(format!("column frame is `{}`; digits are needed", quoted(name))));
        }
        let mut fields = [0.0; 7];
        for (field, name) in fields.iter_mut().zip(["x", "y", "z", "qx", "qy", "qz", "qw"]) {
            *field = any(name)?;
        }
        let [x, y, z, qx, qy, qz, qw] = fields;
        let (at_m, turn) = (DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw));
        let pose = if is_lost(at_m, turn) {
            odd.count_lost(format!("line {at}"));
            None
        } else {
            let (turn, norm_error) = unit_quaternion(turn).map_err(|e| refuse(format!("columns qx to qw: {e}")))?;
            odd.note(norm_error, format!("line {at}"));
            Some(Pose::from_camera_in_world(at_m, turn))
        };
        let intrinsics =
            if own_intrinsics { Some([value("fx")?, value("fy")?, value("cx")?, value("cy")?]) } else { None };
        lines.push(OdometryLine { at, time_s, name: name.to_owned(), pose, intrinsics });
    }
    let posed = lines.iter().filter(|line| line.pose.is_some()).count();
    Ok((lines, odd.warnings(file, posed)))
}

/// fx, fy, cx, cy of a 3×3 matrix, row by row.
fn parse_matrix(text: &str, file: &Path) -> Result<[f64; 4], TextError> {
    let mut rows = [[0.0; 3]; 3];
    let mut records = records::records(text);
    for row in &mut rows {
        let (at, record) = records.next().unwrap_or((text.lines().count().max(1), ""));
        let finite = |field: &str| field.trim().parse().ok().filter(|n: &f64| n.is_finite());
        let numbers: Option<Vec<f64>> = record.split(',').map(finite).collect();
        *row = numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
            TextError::line(
                file,
                at,
                format!("is `{}`; three finite numbers are needed, as in 1600, 0, 960", quoted(record)),
            )
        })?;
    }
    let [[fx, _, cx], [_, fy, cy], last] = rows;
    if last == [0.0, 0.0, 1.0] {
        Ok([fx, fy, cx, cy])
    } else {
        Err(TextError::line(file, 3, "the matrix's last row must be 0, 0, 1".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HEAD: &str = "timestamp, frame, x, y, z, qx, qy, qz, qw";

    fn parse(lines: &str) -> Result<Vec<OdometryLine>, String> {
        parse_odometry(lines, Path::new(ODOMETRY)).map(|read| read.0).map_err(|e| e.to_string())
    }

    #[test]
    fn projected_point_matches_hand_calculation() {
        // At (1, 2, 3), rotated by 180° about x: the camera's y is the world's −y, which is down,
        // and it faces −z.
        let line = format!("{HEAD}\n5021.25, 000007, 1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0\n");
        let lines = parse(&line).unwrap();
        let OdometryLine { at, time_s, name, pose, intrinsics } = &lines[0];
        assert_eq!((*at, *time_s, name.as_str(), *intrinsics), (2, 5021.25, "000007", None));
        // 2 m ahead, 0.5 m to the right, 0.25 m down.
        let in_camera = pose.unwrap().transform_point(DVec3::new(1.5, 1.75, 1.0));
        assert!((in_camera - DVec3::new(0.5, 0.25, 2.0)).length() < 1e-12, "{in_camera}");
        let matrix = parse_matrix("1600.0,0.0,960.5\n0.0,1601.0,720.25\n0,0,1\n", Path::new(MATRIX)).unwrap();
        let at = pinhole_geometry(matrix, 1920, 1440).unwrap().project(in_camera).unwrap();
        assert!((at - glam::DVec2::new(1360.5, 920.375)).length() < 1e-9, "{at}");
    }

    #[test]
    fn intrinsics_columns_are_read_in_any_order() {
        let lines = parse("frame,timestamp,x,y,z,qx,qy,qz,qw,fx,fy,cx,cy\n0,1,0,0,0,0,0,0,1,9,8,7,6\n").unwrap();
        assert_eq!((lines[0].time_s, lines[0].intrinsics), (1.0, Some([9.0, 8.0, 7.0, 6.0])));
    }

    #[test]
    fn frame_without_a_finite_pose_is_kept() {
        let text = format!("{HEAD}\n1, 000000, 0, 0, 0, 0, 0, 0, 1\n2, 000001, 0, 0, inf, 0, 0, 0, 1\n");
        let (lines, warnings) = parse_odometry(&text, Path::new(ODOMETRY)).unwrap();
        assert_eq!(lines.iter().map(|line| line.pose.is_some()).collect::<Vec<_>>(), [true, false]);
        assert!(
            warnings[0].contains("1 of 2 poses is not finite or has no rotation (first at line 3)"),
            "{warnings:?}"
        );
    }

    #[test]
    fn quaternion_of_zeros_is_a_lost_pose() {
        let text = format!("{HEAD}\n1, 000000, 0, 0, 0, 0, 0, 0, 0");
        let (lines, warnings) = parse_odometry(&text, Path::new(ODOMETRY)).unwrap();
        assert!(lines[0].pose.is_none() && warnings[0].contains("has no rotation (first at line 2)"), "{warnings:?}");
    }

    #[test]
    fn refusals_name_file_line_and_column() {
        let good = "1, 000000, 0, 0, 0, 0, 0, 0, 1";
        for (text, said) in [
            (String::new(), "odometry.csv, line 1: column timestamp is missing"),
            (HEAD.replace("qz", "q"), "odometry.csv, line 1: column qz is missing"),
            (format!("{HEAD}\n{good}\n2, 000001, 0, x, 0, 0, 0, 0, 1"), "line 3: column y is `x`; a finite number"),
            (format!("{HEAD}\ninf, 000000, 0, 0, 0, 0, 0, 0, 1"), "line 2: column timestamp is `inf`"),
            (format!("{HEAD}\n1, 000000, 0, 0, 0, 0, 0, 0"), "line 2: column qw is missing"),
            (
                format!("{HEAD}\n1, 000000, 0, 0, 0, 0, 0, 0, 2"),
                "line 2: columns qx to qw: the quaternion has length 2",
            ),
            (format!("{HEAD}\n1, ../a, 0, 0, 0, 0, 0, 0, 1"), "line 2: column frame is `../a`; digits"),
            (format!("{HEAD}\n{good}\n0.5, 000001, 0, 0, 0, 0, 0, 0, 1"), "line 3: column timestamp runs backwards"),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(error.contains(said) && error.starts_with(ODOMETRY), "{error}");
        }
        for (text, said) in [
            ("1,0,2\n0,1\n0,0,1", "camera_matrix.csv, line 2: is `0,1`"),
            ("1,0,2\n0,1,nan\n0,0,1", "line 2: is `0,1,nan`"),
            ("1,0,2\n0,1,2", "line 2: is ``"),
            ("1,0,2\n0,1,2\n0,0,2", "line 3: the matrix's last row"),
        ] {
            let error = parse_matrix(text, Path::new(MATRIX)).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.eNa]{0,5}[,\n]){0,40}") {
            for text in [&text, &near, &format!("{HEAD}\n{near}")] {
                let _ = parse_odometry(text, Path::new(ODOMETRY));
                let _ = parse_matrix(text, Path::new(MATRIX));
            }
        }
    }
}
