//! Trajectories of the TUM RGB-D benchmark: one pose per line, `timestamp tx ty tz qx qy qz qw`,
//! the camera in the world (camera to world), OpenCV axes, metres, seconds. Source:
//! <https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats>.

use std::fmt;
use std::path::Path;

use glam::{DQuat, DVec3};

use super::records::{self, TextError};
use super::{PoseTrack, default_max_gap_s};
use crate::pose::Pose;
use crate::text::number;

/// A quaternion whose length is further from 1 than this is refused.
pub const MAX_NORM_ERROR: f64 = 1e-2;
/// A quaternion whose length is further from 1 than this causes a warning: four decimals, as the
/// benchmark writes them, round it by at most 1e-4.
const REPORTED_NORM_ERROR: f64 = 1e-3;

/// A line of a trajectory, with its numbers as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    pub time_s: f64,
    /// Position of the camera in the world, metres.
    pub position_m: DVec3,
    /// `world_from_camera`, with the length as written, about 1.
    pub rotation: DQuat,
}

impl Line {
    pub fn new(time_s: f64, pose: &Pose) -> Self {
        Self { time_s, position_m: pose.position_in_world_m(), rotation: pose.world_from_camera_rotation() }
    }

    pub fn pose(&self) -> Pose {
        // Normalised there once more: the last bit may differ, and files already read this way must
        // give the same poses.
        Pose::from_camera_in_world(self.position_m, self.rotation.normalize())
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { time_s, position_m: p, rotation: q } = self;
        write!(f, "{}", number(*time_s))?;
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].into_iter().try_for_each(|v| write!(f, " {}", number(v)))
    }
}

/// A trajectory as text; [`parse_lines`] reads back the same numbers, bit for bit.
pub fn write_trajectory(lines: &[Line]) -> String {
    let head = "# timestamp tx ty tz qx qy qz qw\n".to_owned();
    lines.iter().fold(head, |text, line| text + &format!("{line}\n"))
}

/// The contents of a trajectory file.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    /// (timestamp in seconds, pose), strictly ascending in time.
    pub poses: Vec<(f64, Pose)>,
    /// Warnings, each given once.
    pub warnings: Vec<String>,
}

/// Reads a trajectory. If `max_gap_s` is `None`, [`default_max_gap_s`] applies.
pub fn read_trajectory(path: &Path, max_gap_s: Option<f64>) -> Result<PoseTrack, TextError> {
    let trajectory = parse_trajectory(&records::read(path)?, path)?;
    let max_gap_s = max_gap_s.unwrap_or_else(|| default_max_gap_s(trajectory.poses.iter().map(|p| p.0)));
    PoseTrack::new(trajectory.poses, max_gap_s).map_err(|e| TextError::line(path, 0, e))
}

/// Parses a trajectory's text; `file` is named in errors. Timestamps that do not ascend, words that
/// are no numbers and quaternions further than [`MAX_NORM_ERROR`] from unit length are errors with
/// their line. A pose that is not finite is lost: it is left out with a warning.
pub fn parse_trajectory(text: &str, file: &Path) -> Result<Trajectory, TextError> {
    let (lines, warnings) = parse_lines(text, file)?;
    Ok(Trajectory { poses: lines.iter().map(|line| (line.time_s, line.pose())).collect(), warnings })
}

/// Like [`parse_trajectory`], with the numbers as written; and the warnings about them.
pub fn parse_lines(text: &str, file: &Path) -> Result<(Vec<Line>, Vec<String>), TextError> {
    let mut lines: Vec<Line> = Vec::new();
    let mut odd = PoseNotes::default();
    for (at, record) in records::records(text) {
        let Some((line, norm_error)) = parse_line(record).map_err(|problem| TextError::line(file, at, problem))? else {
            odd.count_lost(format!("line {at}"));
            continue;
        };
        ascends(lines.last().map(|before| before.time_s), line.time_s).map_err(|e| TextError::line(file, at, e))?;
        odd.note(norm_error, format!("line {at}"));
        lines.push(line);
    }
    let warnings = odd.warnings(file, lines.len());
    Ok((lines, warnings))
}

/// Checks that a pose comes after the previous one.
pub fn ascends(before_s: Option<f64>, time_s: f64) -> Result<(), String> {
    let Some(before_s) = before_s.filter(|before_s| time_s <= *before_s) else { return Ok(()) };
    let how = if time_s == before_s { "stands twice" } else { "runs backwards" };
    let [time_s, before_s] = [time_s, before_s].map(number);
    Err(format!("the time {how}: {time_s} after {before_s}; poses must ascend in time"))
}

/// The line and the norm error of its quaternion. `None` if its pose is lost.
fn parse_line(record: &str) -> Result<Option<(Line, f64)>, String> {
    let mut rest = record;
    let mut fields = [0.0; 7];
    let refuse = |problem| format!("{problem} (a pose is `timestamp tx ty tz qx qy qz qw`)");
    let time_s = records::number(&mut rest, "timestamp").map_err(refuse)?;
    for (field, name) in fields.iter_mut().zip(["tx", "ty", "tz", "qx", "qy", "qz", "qw"]) {
        *field = records::pose_number(&mut rest, name).map_err(refuse)?;
    }
    records::end(rest)?;
    let [tx, ty, tz, qx, qy, qz, qw] = fields;
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    let position_m = DVec3::new(tx, ty, tz);
    if is_lost(position_m, rotation) {
        return Ok(None);
    }
    let (_, norm_error) = unit_quaternion(rotation)?;
    Ok(Some((Line { time_s, position_m, rotation }, norm_error)))
}

/// Whether a pose is lost, as trackers write it: `nan`, or a quaternion of zeros.
pub fn is_lost(position_m: DVec3, rotation: DQuat) -> bool {
    !position_m.is_finite() || !rotation.is_finite() || rotation.to_array() == [0.0; 4]
}

/// The quaternion normalised, and how far its length was from 1; refused beyond [`MAX_NORM_ERROR`].
pub fn unit_quaternion(q: DQuat) -> Result<(DQuat, f64), String> {
    let error = (q.length() - 1.0).abs();
    if error.is_nan() || error > MAX_NORM_ERROR {
        return Err(format!("the quaternion has length {}; 1 is needed (within {MAX_NORM_ERROR})", q.length()));
    }
    Ok((q.normalize(), error))
}

/// Collects poses that are lost, and quaternions that are not of unit length, into one warning
/// each.
#[derive(Debug, Default)]
pub struct PoseNotes {
    count: usize,
    worst: f64,
    first: String,
    lost_count: usize,
    first_lost_place: String,
}

impl PoseNotes {
    /// Counts a lost pose.
    pub fn count_lost(&mut self, place: String) {
        if self.lost_count == 0 {
            self.first_lost_place = place;
        }
        self.lost_count += 1;
    }

    pub fn note(&mut self, norm_error: f64, place: String) {
        if norm_error <= REPORTED_NORM_ERROR {
            return;
        }
        if self.count == 0 {
            self.first = place;
        }
        self.count += 1;
        self.worst = self.worst.max(norm_error);
    }

    /// The warnings about a file with `of` poses besides the lost ones.
    pub fn warnings(&self, file: &Path, of: usize) -> Vec<String> {
        let Self { count, worst, first, lost_count, first_lost_place } = self;
        let file = file.display();
        let off_unit = (*count > 0).then(|| {
            format!(
                "{file}: {count} of {of} quaternions do not have unit length, by up to {worst:.4} (first at \
                     {first}): normalised"
            )
        });
        let without_rotation = (*lost_count > 0).then(|| {
            let [are, have] = if *lost_count == 1 { ["is", "has"] } else { ["are", "have"] };
            let all = lost_count + of;
            format!(
                "{file}: {lost_count} of {all} poses {are} not finite or {have} no rotation (first at {first_lost_place}): lost by the tracker, left out"
            )
        });
        off_unit.into_iter().chain(without_rotation).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<Trajectory, String> {
        parse_trajectory(text, Path::new("t.txt")).map_err(|e| e.to_string())
    }

    #[test]
    fn camera_to_world_pose_matches_computed_values() {
        // The camera is at (1, 2, 3), rotated by 90° about world z: its x axis is world y.
        let t = parse("# c\n\n 5.5\t1 2 3  0 0 0.70710678 0.70710678\r\n").unwrap();
        let (time_s, pose) = t.poses[0];
        assert_eq!(time_s, 5.5);
        assert!((pose.transform_point(DVec3::new(1.0, 4.0, 3.0)) - DVec3::new(2.0, 0.0, 0.0)).length() < 1e-7);
        assert!(t.warnings.is_empty());
    }

    #[test]
    fn refusals_name_file_and_line() {
        let good = "1 0 0 0 0 0 0 1\n";
        for (bad, message) in [
            ("1 0 0 0 0 0 0 1", "t.txt, line 3: the time stands twice"),
            ("0.5 0 0 0 0 0 0 1", "t.txt, line 3: the time runs backwards"),
            ("2 0 0 0 0 0 0 1.02", "t.txt, line 3: the quaternion has length 1.02"),
            ("2 0 0 0 0 0 0 0.5", "t.txt, line 3: the quaternion has length 0.5"),
            ("NaN 0 0 0 0 0 0 1", "t.txt, line 3: timestamp is `NaN`; a finite number is needed"),
            ("2 0 x 0 0 0 0 1", "t.txt, line 3: ty is `x`; a finite number is needed"),
            ("2 0 0 0 0 0 0", "t.txt, line 3: qw is missing"),
            ("2 0 0 0 0 0 0 1 7", "t.txt, line 3: there is more than expected: `7`"),
        ] {
            let error = parse(&format!("# comment\n{good}{bad}\n{good}")).unwrap_err();
            assert!(error.starts_with(message), "{error}");
        }
    }

    #[test]
    fn lost_poses_are_left_out_and_counted() {
        let invalid = "2 0 nan 0 0 0 0 1\n3 -inf 0 0 0 0 0 1\n3.5 0 0 0 0 0 0 0\n";
        let t = parse(&format!("1 0 0 0 0 0 0 1\n{invalid}4 0 0 0 0 0 0 1\n")).unwrap();
        assert_eq!(t.poses.iter().map(|pose| pose.0).collect::<Vec<_>>(), [1.0, 4.0]);
        assert_eq!(
            t.warnings,
            ["t.txt: 3 of 5 poses are not finite or have no rotation (first at line 2): lost by the tracker, left out"]
        );
    }

    #[test]
    fn slightly_off_quaternion_is_normalised_with_a_warning() {
        let t = parse("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1.005").unwrap();
        assert!((t.poses[1].1.rotation.length() - 1.0).abs() < 1e-12);
        assert!(t.warnings[0].contains("1 of 2") && t.warnings[0].contains("line 2"), "{:?}", t.warnings);
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*") {
            let _ = parse(&text);
        }

        #[test]
        fn nearly_right_text_never_panics(text in "([-0-9.eNaINf#]{0,6}[ \n\t]){0,40}") {
            let _ = parse(&text);
        }

        #[test]
        fn a_valid_trajectory_round_trips(
            rows in prop::collection::vec((1e-6f64..10.0, prop::array::uniform3(-1e4f64..1e4), prop::array::uniform4(-1.0f64..1.0)), 0..20)
        ) {
            let mut time_s = 1.3e9;
            let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
            let mut expected = Vec::new();
            for (step, p, q) in rows {
                let q = DQuat::from_array(q);
                prop_assume!(q.length() > 0.1);
                let q = q.normalize();
                time_s += step;
                text += &format!("{time_s} {} {} {} {} {} {} {}\n", p[0], p[1], p[2], q.x, q.y, q.z, q.w);
                expected.push((time_s, DVec3::from_array(p), q));
            }
            let read = parse(&text).unwrap();
            prop_assert_eq!(read.poses.len(), expected.len());
            for ((time_s, pose), (t, p, q)) in read.poses.iter().zip(&expected) {
                prop_assert_eq!(time_s, t);
                prop_assert!((pose.position_in_world_m() - *p).length() < 1e-9);
                prop_assert!(pose.world_from_camera_rotation().dot(*q).abs() > 1.0 - 1e-12);
            }
            let line = |(time_s, position_m, rotation)| Line { time_s, position_m, rotation };
            let lines: Vec<Line> = expected.into_iter().map(line).collect();
            let (again, _) = parse_lines(&write_trajectory(&lines), Path::new("t.txt")).unwrap();
            // The shortest text of a number has every bit of it.
            prop_assert_eq!(format!("{again:?}"), format!("{lines:?}"));
        }
    }
}
