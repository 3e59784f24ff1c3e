//! A EuRoC MAV folder: `mav0/cam0/data.csv` and `sensor.yaml`,
//! `mav0/state_groundtruth_estimate0/data.csv` (TUM VI: `mav0/mocap0/data.csv`). Poses are the
//! body's in the world (R_RS, p_RS; metres, quaternions w x y z, z up); `T_BS` takes a sensor's
//! axes to the body's. Times are in nanoseconds, a picture's at the middle of its exposure; the
//! shutter is global. Pixel centres are at whole numbers. Source: Burri et al., "The EuRoC micro
//! aerial vehicle datasets", IJRR 2016,
//! <https://projects.asl.ethz.ch/datasets/doku.php?id=kmavvisualinertialdatasets>.
//!
//! Only a subset of YAML is parsed ([`crate::yaml`]). The files contain no more.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use super::listing::file_name;
use super::parts::{Parts, Pictures, RecordingFormat, folder_of, geometry_from, track_from};
use super::rigid::{NOT_RIGID, rigid};
use super::{OpenOptions, RecordingError};
use crate::camera::{Geometry, LensModel};
use crate::pose::Pose;
use crate::text::quoted;
use crate::tracking::records::{self, TextError};
use crate::tracking::tum::{PoseNotes, ascends, is_lost, unit_quaternion};
use crate::yaml::{self, YamlKeys};

const PICTURES: &str = "cam0/data.csv";
/// Folders of ground truth with full poses, in order of preference: EuRoC, TUM VI, a Vicon system.
const GROUND_TRUTH_FOLDERS: [&str; 3] = ["state_groundtruth_estimate0", "mocap0", "vicon0"];

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "EuRoC MAV",
    has_times: true,
    is_metric: true,
    find,
    open: |mav, _, options| open(mav, options),
};

/// The folder `mav0`, given itself, its parent, or its camera's list.
fn find(path: &Path) -> Option<PathBuf> {
    if path.is_dir() {
        [path.join("mav0"), path.to_owned()].into_iter().find(|mav| mav.join(PICTURES).exists())
    } else {
        path.ends_with(PICTURES).then(|| folder_of(&folder_of(path)))
    }
}

fn open(mav: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let (list, sensor) = (mav.join(PICTURES), mav.join("cam0/sensor.yaml"));
    let pictures = parse_pictures(&records::read(&list)?, &list)?;
    let sensor_text = records::read_description(&sensor)?;
    let camera = Yaml { keys: yaml::parse(&sensor_text), file: &sensor };
    let (geometry, body_from_camera) = (camera.geometry()?, camera.body_from_sensor()?);

    let truths = GROUND_TRUTH_FOLDERS.map(|name| mav.join(name).join("data.csv"));
    let truth = truths.iter().find(|truth| truth.exists()).ok_or_else(|| {
        let tried = GROUND_TRUTH_FOLDERS.map(|name| format!("{name}/data.csv")).join(", ");
        let problem = format!(
            "holds no ground truth; expected {tried}. For poses from another source, write a trajectory and name it, \
             with the pictures, in a recording.toml"
        );
        RecordingError::content(mav, problem)
    })?;
    let mut description_files = vec![list.clone(), sensor.clone(), truth.clone()];
    let truth_sensor = truth.with_file_name("sensor.yaml");
    // Without a transform of its own, the ground truth is that of the body.
    let body_from_truth = if truth_sensor.exists() {
        let text = records::read_description(&truth_sensor)?;
        description_files.push(truth_sensor.clone());
        Yaml { keys: yaml::parse(&text), file: &truth_sensor }.body_from_sensor()?
    } else {
        RigidTransform { turn: DQuat::IDENTITY, shift_m: DVec3::ZERO }
    };
    let truth_from_camera = body_from_truth.inverse().after(&body_from_camera);
    let (poses, odd) = parse_poses(&records::read(truth)?, truth, &truth_from_camera)?;

    let folder = list.parent().unwrap_or(Path::new("")).join("data");
    let (times_s, names): (Vec<f64>, Vec<String>) = pictures.into_iter().unzip();
    let files: Vec<_> = names.iter().map(|name| folder.join(name)).collect();
    let named = if mav.ends_with("mav0") { folder_of(mav) } else { mav.to_owned() };
    let mut parts = Parts::new(&named, Pictures::Stills(files), times_s);
    parts.up = Some(DVec3::Z);
    parts.geometries = vec![Some(geometry); parts.timestamps_s.len()];
    parts.track = track_from(poses, options.max_gap_s, truth)?;
    parts.description_files = description_files;
    parts.warnings.extend(odd);
    Ok(parts)
}

/// A rigid transform between two frames of reference.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RigidTransform {
    turn: DQuat,
    shift_m: DVec3,
}

impl RigidTransform {
    fn inverse(&self) -> Self {
        let turn = self.turn.conjugate();
        Self { turn, shift_m: -(turn * self.shift_m) }
    }

    /// `a_from_b.after(b_from_c)` is `a_from_c`.
    fn after(&self, other: &Self) -> Self {
        Self { turn: self.turn * other.turn, shift_m: self.turn * other.shift_m + self.shift_m }
    }
}

/// Nanoseconds as seconds, rounded only once.
fn seconds(nanoseconds: &str, name: &str) -> Result<f64, String> {
    let text = nanoseconds.trim();
    let refuse = |_| format!("{name} is `{}`; whole nanoseconds are needed", quoted(text));
    let nanoseconds: u64 = text.parse().map_err(refuse)?;
    Ok((nanoseconds / 1_000_000_000) as f64 + (nanoseconds % 1_000_000_000) as f64 * 1e-9)
}

fn parse_pictures(text: &str, list: &Path) -> Result<Vec<(f64, String)>, TextError> {
    let mut pictures: Vec<(f64, String)> = Vec::new();
    for (line, record) in records::records(text) {
        let refuse = |problem: String| TextError::line(list, line, problem);
        let (time, name) = record.split_once(',').unwrap_or((record, ""));
        let time_s = seconds(time, "timestamp").map_err(refuse)?;
        let name = file_name(name, "the file's name is missing (a line is `timestamp,filename`)").map_err(refuse)?;
        if pictures.last().is_some_and(|before| time_s < before.0) {
            return Err(refuse("the time runs backwards".to_owned()));
        }
        pictures.push((time_s, name));
    }
    Ok(pictures)
}

type TimedPoses = Vec<(f64, Pose)>;

fn parse_poses(
    text: &str,
    file: &Path,
    truth_from_camera: &RigidTransform,
) -> Result<(TimedPoses, Vec<String>), TextError> {
    let (mut poses, mut odd) = (TimedPoses::new(), PoseNotes::default());
    for (line, record) in records::records(text) {
        let refuse = |problem: String| TextError::line(file, line, problem);
        let (time, rest) = record.split_once(',').unwrap_or((record, ""));
        let time_s = seconds(time, "timestamp").map_err(refuse)?;
        ascends(poses.last().map(|before| before.0), time_s).map_err(refuse)?;
        // Velocities and biases follow.
        let spaced = rest.replace(',', " ");
        let (mut rest, mut fields) = (spaced.as_str(), [0.0; 7]);
        for (field, name) in fields.iter_mut().zip(["p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z"]) {
            *field = records::pose_number(&mut rest, name).map_err(refuse)?;
        }
        let [px, py, pz, qw, qx, qy, qz] = fields;
        let (shift_m, turn) = (DVec3::new(px, py, pz), DQuat::from_xyzw(qx, qy, qz, qw));
        if is_lost(shift_m, turn) {
            odd.count_lost(format!("line {line}"));
            continue;
        }
        let (turn, norm_error) = unit_quaternion(turn).map_err(refuse)?;
        odd.note(norm_error, format!("line {line}"));
        let camera = RigidTransform { turn, shift_m }.after(truth_from_camera);
        poses.push((time_s, Pose::from_camera_in_world(camera.shift_m, camera.turn)));
    }
    let warnings = odd.warnings(file, poses.len());
    Ok((poses, warnings))
}

/// A `sensor.yaml`.
struct Yaml<'a> {
    keys: YamlKeys,
    file: &'a Path,
}

impl Yaml<'_> {
    fn refuse(&self, key: &str, problem: &str) -> RecordingError {
        match self.keys.get(key) {
            Some((line, _)) => TextError::line(self.file, *line, format!("{key} {problem}")).into(),
            None => RecordingError::content(self.file, format!("{key} is missing")),
        }
    }

    fn word(&self, key: &str) -> &str {
        self.keys.get(key).map_or("", |value| yaml::word(&value.1))
    }

    fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N], RecordingError> {
        let numbers = yaml::numbers(self.word(key));
        let problem = format!("must be {N} finite numbers, as in [1, 2]");
        numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| self.refuse(key, &problem))
    }

    fn body_from_sensor(&self) -> Result<RigidTransform, RecordingError> {
        let key = "T_BS.data";
        let n: [f64; 16] = self.numbers(key)?;
        let row = |i: usize| [n[4 * i], n[4 * i + 1], n[4 * i + 2], n[4 * i + 3]];
        let refuse = || self.refuse(key, NOT_RIGID);
        let (turn, shift_m) =
            rigid([row(0), row(1), row(2)]).filter(|_| row(3) == [0.0, 0.0, 0.0, 1.0]).ok_or_else(refuse)?;
        Ok(RigidTransform { turn: DQuat::from_mat3(&turn).normalize(), shift_m })
    }

    fn geometry(&self) -> Result<Geometry, RecordingError> {
        if self.word("camera_model") != "pinhole" {
            let problem = format!("is `{}`; expected pinhole", quoted(self.word("camera_model")));
            return Err(self.refuse("camera_model", &problem));
        }
        let (model, names) = match self.word("distortion_model") {
            "radial-tangential" | "radtan" | "plumb_bob" => (LensModel::Opencv, ["k1", "k2", "p1", "p2"]),
            "equidistant" => (LensModel::OpencvFisheye, ["k1", "k2", "k3", "k4"]),
            other => {
                let problem = format!("is `{}`; expected radial-tangential or equidistant", quoted(other));
                return Err(self.refuse("distortion_model", &problem));
            }
        };
        let [width, height] = self.numbers("resolution")?;
        let [fu, fv, cu, cv] = self.numbers("intrinsics")?;
        let distortion: [f64; 4] = self.numbers("distortion_coefficients")?;
        // EuRoC's pixel centres are at whole numbers, Locard's half a pixel further.
        let values = [
            ("width_px", width),
            ("height_px", height),
            ("fx_px", fu),
            ("fy_px", fv),
            ("cx_px", cu + 0.5),
            ("cy_px", cv + 0.5),
        ];
        let values: Vec<_> = values.into_iter().chain(names.into_iter().zip(distortion)).collect();
        geometry_from(model, &values).map_err(|e| RecordingError::content(self.file, e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use proptest::prelude::*;

    /// Faces along the body's x from 0.1 m in front of it: the picture's x is the body's −y, its y
    /// the body's −z.
    const SENSOR: &str = "%YAML:1.0\n# a camera\nsensor_type: camera\ncomment: \"cam0: grey\"\nT_BS:\n  cols: 4\n  rows: 4\n  \
        data: [0.0, 0.0, 1.0, 0.1, # along x\n         -1.0, 0.0, 0.0, 0.0,\n         0.0, -1.0, 0.0, 0.0,\n         \
        0.0, 0.0, 0.0, 1.0]\nrate_hz: 20\nresolution: [752, 480]\ncamera_model: pinhole\n\
        intrinsics: [400.0, 500.0, 367.0, 248.0] #fu, fv, cu, cv\ndistortion_model: radial-tangential\n\
        distortion_coefficients: [-0.1, 0.4, 0.01, 0.02]\n";

    fn yaml(text: &str) -> Yaml<'_> {
        Yaml { keys: yaml::parse(text), file: Path::new("sensor.yaml") }
    }

    #[test]
    fn projected_point_matches_hand_calculation() {
        let sensor = yaml(SENSOR);
        let camera = sensor.body_from_sensor().unwrap();
        // The body is at (1, 2, 3), rotated by 90° about z: its x is the world's y. So the camera
        // is at (1, 2.1, 3).
        let line = "#time, p, q\n1403636579763555584, 1, 2, 3, 0.70710678, 0, 0, 0.70710678, 9, 9, 9\n";
        let (poses, odd) = parse_poses(line, Path::new("data.csv"), &camera).unwrap();
        assert_eq!((poses.len(), odd.len()), (1, 0));
        assert!((poses[0].0 - 1_403_636_579.763_555_6).abs() < 3e-7);
        assert!((poses[0].1.position_in_world_m() - DVec3::new(1.0, 2.1, 3.0)).length() < 1e-7);
        // 2 m ahead, 0.4 m to the right (the world's x), 0.2 m down.
        let in_camera = poses[0].1.transform_point(DVec3::new(1.4, 4.1, 2.8));
        assert!((in_camera - DVec3::new(0.4, 0.2, 2.0)).length() < 1e-6, "{in_camera}");
        // u = 0.2, v = 0.1, r² = 0.05: radial 0.996; x: 0.1992 + 2·0.01·0.02 + 0.02·(0.05 + 0.08) =
        // 0.2022; y: 0.0996 + 0.01·(0.05 + 0.02) + 2·0.02·0.02 = 0.1011. Then half a pixel for the
        // different pixel centres.
        let at = sensor.geometry().unwrap().project(in_camera).unwrap();
        assert!((at - DVec2::new(367.5 + 80.88, 248.5 + 50.55)).length() < 1e-3, "{at}");
    }

    #[test]
    fn ground_truth_sensor_transform_is_removed() {
        // With the same transform for ground truth and camera, the camera is at the poses.
        let camera = yaml(SENSOR).body_from_sensor().unwrap();
        let none = camera.inverse().after(&camera);
        assert!(none.shift_m.length() < 1e-12 && none.turn.angle_between(DQuat::IDENTITY) < 1e-6);
    }

    #[test]
    fn yaml_fisheyes_and_lists_are_read() {
        let text = SENSOR.replace("radial-tangential", "equidistant");
        let distortion = yaml(&text).geometry().unwrap().distortion;
        assert_eq!((distortion.model, distortion.k3, distortion.k4), (LensModel::OpencvFisheye, 0.01, 0.02));
        let pictures =
            parse_pictures("#timestamp [ns],filename\r\n5,a b.png\r\n1000000006 , c.png\n", Path::new("data.csv"));
        assert_eq!(pictures.unwrap(), [(5e-9, "a b.png".to_owned()), (1.000_000_006, "c.png".to_owned())]);
    }

    #[test]
    fn refusals_name_file_line_and_key() {
        for (from, to, message) in [
            ("pinhole", "omni", "sensor.yaml, line 14: camera_model is `omni`; expected pinhole"),
            ("radial-tangential", "fov", "sensor.yaml, line 16: distortion_model is `fov`; expected radial"),
            ("[752, 480]", "[752]", "sensor.yaml, line 13: resolution must be 2 finite numbers"),
            ("[752, 480]", "[752, nan]", "sensor.yaml, line 13: resolution must be 2"),
            ("resolution", "size", "sensor.yaml: resolution is missing"),
            (
                "0.0, 0.0, 1.0, 0.1",
                "0.0, 0.0, 2.0, 0.1",
                "sensor.yaml, line 8: T_BS.data is not a rotation and a translation",
            ),
            ("0.0, 0.0, 0.0, 1.0]", "0.0, 0.0, 0.0, 2.0]", "line 8: T_BS.data is not a rotation"),
            ("[400.0,", "[-400.0,", "camera.fx_px = -400: expected"),
        ] {
            let text = SENSOR.replace(from, to);
            let (geometry, placed) = (yaml(&text).geometry().map(drop), yaml(&text).body_from_sensor().map(drop));
            let error = geometry.and(placed).unwrap_err().to_string();
            assert!(error.contains(message), "{error}\n{message}");
        }
        let poses = |text: &str| {
            let none = RigidTransform { turn: DQuat::IDENTITY, shift_m: DVec3::ZERO };
            parse_poses(text, Path::new("data.csv"), &none).map(drop).unwrap_err().to_string()
        };
        assert!(poses("1.5,0,0,0,1,0,0,0").contains("data.csv, line 1: timestamp is `1.5`; whole nanoseconds"));
        assert!(poses("2,0,0,0,1,0,0,0\n2,0,0,0,1,0,0,0").contains("line 2: the time stands twice"));
        assert!(poses("2,0,0,0,1,0,0").contains("line 1: q_z is missing"));
        assert!(poses("2,0,0,0,2,0,0,0").contains("the quaternion has length 2"));
        let none = RigidTransform { turn: DQuat::IDENTITY, shift_m: DVec3::ZERO };
        let without_rotation = parse_poses("2,0,0,0,0,0,0,0\n3,0,0,0,1,0,0,0", Path::new("data.csv"), &none).unwrap();
        assert!(
            without_rotation.0.len() == 1 && without_rotation.1[0].contains("has no rotation (first at line 1)"),
            "{without_rotation:?}"
        );
        assert!(parse_pictures("7", Path::new("data.csv")).unwrap_err().to_string().contains("name is missing"));
        assert!(parse_pictures("7,a\n6,b", Path::new("data.csv")).unwrap_err().to_string().contains("runs backwards"));
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([a-zTBS_]{0,4}:? ?\\[?[0-9., #]{0,9}\\]?\n ?){0,20}") {
            for text in [text, near] {
                let none = RigidTransform { turn: DQuat::IDENTITY, shift_m: DVec3::ZERO };
                let _ = (yaml(&text).geometry(), yaml(&text).body_from_sensor());
                let _ = parse_pictures(&text, Path::new("data.csv"));
                let _ = parse_poses(&text, Path::new("data.csv"), &none);
            }
        }
    }
}
