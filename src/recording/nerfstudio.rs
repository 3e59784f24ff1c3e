//! A nerfstudio `transforms.json`: camera to world with OpenGL's axes (x right, y up, looking along
//! −z), intrinsics with pixel centres at +0.5, depth in millimetres. Source:
//! <https://docs.nerf.studio/quickstart/data_conventions.html>.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Deserializer};

use super::depth::{DepthEncoding, DepthFiles};
use super::parts::{
    NOMINAL_FPS, Parts, Pictures, RecordingFormat, equirectangular, file_or_in_folder, geometry_from, track_from,
};
use super::rigid::{NOT_RIGID, is_lost, rigid};
use super::{OpenOptions, RecordingError, listing};
use crate::camera::{Geometry, LensModel};
use crate::pose::Pose;
use crate::source::{still, still_format};
use crate::text::quoted;
use crate::tracking::records;
use crate::tracking::tum::PoseNotes;

const FILE_NAME: &str = "transforms.json";

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "nerfstudio",
    has_times: false,
    is_metric: false,
    find: |path| {
        if path.is_file() && path.extension().is_some_and(|ending| ending == "json") {
            Some(path.to_owned())
        } else {
            file_or_in_folder(path, FILE_NAME)
        }
    },
    open: |file, _, options| open(file, options),
};

/// Unused keys are ignored: other programs add their own.
#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    camera: TransformsCamera,
    frames: Vec<FrameEntry>,
    /// Metres per depth code.
    depth_unit_scale_factor: Option<f64>,
}

#[derive(Deserialize)]
struct FrameEntry {
    file_path: String,
    /// Empty if the frame has no pose.
    #[serde(default, deserialize_with = "matrix_rows")]
    transform_matrix: Vec<Vec<f64>>,
    depth_file_path: Option<String>,
    #[serde(flatten)]
    camera: TransformsCamera,
}

/// A number of a matrix. Only in a matrix are non-finite numbers meaningful: the tracker lost the
/// pose.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a matrix of numbers is needed")]
enum MatrixEntry {
    Number(f64),
    NotFinite(NotFiniteToken),
}

/// The string that replaces every non-finite number.
#[derive(Deserialize)]
enum NotFiniteToken {
    #[serde(rename = "NaN")]
    Token,
}

/// The rows of a matrix, NaN for all non-finite numbers; none for `null`.
fn matrix_rows<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vec<f64>>, D::Error> {
    let number = |entry| match entry {
        MatrixEntry::Number(number) => number,
        MatrixEntry::NotFinite(NotFiniteToken::Token) => f64::NAN,
    };
    let rows = Option::<Vec<Vec<MatrixEntry>>>::deserialize(from)?.unwrap_or_default();
    Ok(rows.into_iter().map(|row| row.into_iter().map(number).collect()).collect())
}

/// Camera parameters, common to all frames or of one frame.
#[derive(Clone, Deserialize)]
struct TransformsCamera {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

impl TransformsCamera {
    /// A frame's own values override the common ones.
    fn or(self, all: &Self) -> Self {
        Self {
            camera_model: self.camera_model.or_else(|| all.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(all.is_fisheye),
            camera_angle_x: self.camera_angle_x.or(all.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(all.camera_angle_y),
            fl_x: self.fl_x.or(all.fl_x),
            fl_y: self.fl_y.or(all.fl_y),
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
            k1: self.k1.or(all.k1),
            k2: self.k2.or(all.k2),
            k3: self.k3.or(all.k3),
            k4: self.k4.or(all.k4),
            p1: self.p1.or(all.p1),
            p2: self.p2.or(all.p2),
        }
    }

    /// The geometry. A missing size is that of the picture. `None` without a focal length.
    fn geometry(&self, file: &Path) -> Result<Option<Geometry>, String> {
        let supported = || MODELS.iter().chain(&FISHEYES).chain(&EQUIRECTANGULAR_NAMES);
        if let Some(model) = self.camera_model.as_deref().filter(|m| !supported().any(|k| k == m)) {
            let names: Vec<_> = supported().copied().collect();
            return Err(format!(
                "camera_model is {}; expected {} (of others, undistort the pictures: colmap image_undistorter)",
                quoted(model),
                names.join(", ")
            ));
        }
        let named = self.camera_model.as_deref().is_some_and(|m| FISHEYES.contains(&m));
        let model = if named || self.is_fisheye == Some(true) { LensModel::OpencvFisheye } else { LensModel::Opencv };
        let (w, h) = match (self.w, self.h) {
            (Some(w), Some(h)) => (w, h),
            _ => match still::read_header(file) {
                Ok(header) => (header.width.into(), header.height.into()),
                // The frame is skipped.
                Err(error) if still::is_no_picture(&error) => return Ok(None),
                Err(error) => return Err(error.to_string()),
            },
        };
        // Its angles follow from its size: focal lengths are ignored.
        if self.camera_model.as_deref().is_some_and(|m| EQUIRECTANGULAR_NAMES.contains(&m)) {
            return equirectangular(w as u32, h as u32).map(Some);
        }
        // Ignoring distortion.
        let from_angle = |angle: Option<f64>, side_px: f64| {
            angle.map(|angle| match model {
                LensModel::Opencv => 0.5 * side_px / (0.5 * angle).tan(),
                _ => side_px / angle,
            })
        };
        let fl_x = self.fl_x.or_else(|| from_angle(self.camera_angle_x, w));
        let fl_y = self.fl_y.or_else(|| from_angle(self.camera_angle_y, h));
        // Pixels are square unless both are given.
        let Some(fl_x) = fl_x.or(fl_y) else { return Ok(None) };
        let values = [
            ("width_px", w),
            ("height_px", h),
            ("fx_px", fl_x),
            ("fy_px", fl_y.unwrap_or(fl_x)),
            ("cx_px", self.cx.unwrap_or(0.5 * w)),
            ("cy_px", self.cy.unwrap_or(0.5 * h)),
            ("k1", self.k1.unwrap_or(0.0)),
            ("k2", self.k2.unwrap_or(0.0)),
            ("k3", self.k3.unwrap_or(0.0)),
            ("k4", self.k4.unwrap_or(0.0)),
            ("p1", self.p1.unwrap_or(0.0)),
            ("p2", self.p2.unwrap_or(0.0)),
        ];
        let geometry = geometry_from(model, &values).map_err(|e| e.to_string())?;
        match (geometry.distortion.missing(), model) {
            (None, _) => Ok(Some(geometry)),
            (Some(name), LensModel::Opencv) => Err(format!("{name} is not 0, which is supported of a fisheye alone")),
            (Some(name), _) => Err(format!("{name} is not 0, and a fisheye has none")),
        }
    }
}

const MODELS: [&str; 6] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "perspective"];
/// nerfstudio's names for OpenCV's fisheye model.
const FISHEYES: [&str; 2] = ["OPENCV_FISHEYE", "fisheye"];

/// Names of equirectangular 360° pictures.
const EQUIRECTANGULAR_NAMES: [&str; 2] = ["EQUIRECTANGULAR", "equirectangular"];

fn parse(json: &str, file: &Path) -> Result<Transforms, RecordingError> {
    let json = with_not_finite_quoted(json.trim_start_matches('\u{feff}'));
    serde_json::from_str(&json).map_err(|e| RecordingError::content(file, e))
}

/// Replaces `NaN`, `Infinity` and `-Infinity` outside strings by the string `"NaN"`. Python writes
/// them, but JSON does not allow them.
fn with_not_finite_quoted(json: &str) -> Cow<'_, str> {
    const NOT_FINITE: [&str; 3] = ["NaN", "Infinity", "-Infinity"];
    if !NOT_FINITE.iter().any(|word| json.contains(word)) {
        return Cow::Borrowed(json);
    }
    let mut valid = String::with_capacity(json.len());
    let mut is_in_string = false;
    let mut rest = json;
    while let Some(next) = rest.chars().next() {
        let behind_word = NOT_FINITE.iter().find_map(|word| rest.strip_prefix(word));
        if let Some(behind) = behind_word.filter(|_| !is_in_string) {
            valid += "\"NaN\"";
            rest = behind;
            continue;
        }
        is_in_string ^= next == '"';
        // The character after a backslash neither ends the string nor escapes another.
        let count = if is_in_string && next == '\\' { 2 } else { 1 };
        let (taken, behind) = rest.split_at(rest.chars().take(count).map(char::len_utf8).sum());
        valid += taken;
        rest = behind;
    }
    Cow::Owned(valid)
}

fn open(file: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let Transforms { camera, mut frames, depth_unit_scale_factor } = parse(&records::read_listing(file)?, file)?;
    let folder = file.parent().unwrap_or(Path::new(""));
    // The order in the file is arbitrary; the names have the camera's order.
    frames.sort_by(|a, b| listing::natural_order(&a.file_path, &b.file_path));
    let metres_per_code = depth_unit_scale_factor.unwrap_or(1e-3);
    if !(metres_per_code.is_finite() && metres_per_code > 0.0) {
        let problem = format!("depth_unit_scale_factor is {metres_per_code}; it must be finite and above 0");
        return Err(RecordingError::content(file, problem));
    }
    let (mut files, mut poses, mut geometries, mut depths) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut timestamps_s, mut odd) = (Vec::new(), PoseNotes::default());
    for (i, frame) in frames.into_iter().enumerate() {
        let time_s = i as f64 / NOMINAL_FPS;
        let refuse = |problem| RecordingError::content(file, format!("frame {}: {problem}", quoted(&frame.file_path)));
        let picture = picture_file(folder, &frame.file_path);
        match pose(&frame.transform_matrix, options.metres_per_unit).map_err(refuse)? {
            Some(pose) => poses.push((time_s, pose)),
            None => odd.count_lost(format!("frame {}", quoted(&frame.file_path))),
        }
        timestamps_s.push(time_s);
        geometries.push(frame.camera.clone().or(&camera).geometry(&picture).map_err(refuse)?);
        depths.extend(frame.depth_file_path.map(|name| (time_s, folder.join(name))));
        files.push(picture);
    }
    let is_frame = |file: &PathBuf| !still::read_header(file).is_err_and(|error| still::is_no_picture(&error));
    let lacks_focal_length = geometries.iter().zip(&files).any(|(geometry, file)| geometry.is_none() && is_frame(file));
    let mut parts = Parts::new(folder, Pictures::Stills(files), timestamps_s);
    parts.up = Some(DVec3::Z);
    parts.description_files.push(file.to_owned());
    parts.warnings = odd.warnings(file, poses.len());
    parts.track = track_from(poses, options.max_gap_s.or(Some(1.5 / NOMINAL_FPS)), file)?;
    parts
        .warnings
        .push(format!("nerfstudio keeps no times: frames are taken to follow each other at {NOMINAL_FPS} a second"));
    if lacks_focal_length {
        parts.warnings.push(format!("{}: some frames have no focal length (fl_x)", file.display()));
    }
    parts.geometries = geometries;
    if !depths.is_empty() {
        let unit_advice =
            depth_unit_scale_factor.is_none().then_some("write \"depth_unit_scale_factor\": 1.0 into the file");
        let stored = DepthEncoding { unit_advice, ..DepthEncoding::plain(1.0 / metres_per_code) };
        parts.depth = Some(DepthFiles { by_time: depths, stored });
    }
    Ok(parts)
}

/// The picture of a name, whose extension may be omitted, as in older synthetic sets.
fn picture_file(folder: &Path, name: &str) -> PathBuf {
    let file = folder.join(name);
    if file.exists() {
        return file;
    }
    still_format::with_omitted_extension(folder, name).unwrap_or(file)
}

/// The pose of a camera-to-world matrix (3 or 4 rows of 4) with OpenGL's axes. `None` if it is
/// lost: empty, non-finite or without a rotation.
fn pose(matrix: &[Vec<f64>], metres_per_unit: f64) -> Result<Option<Pose>, String> {
    if matrix.is_empty() {
        return Ok(None);
    }
    let wrong = || "transform_matrix must have 4 rows of 4 numbers, the last 0 0 0 1".to_owned();
    let rows: Vec<[f64; 4]> =
        matrix.iter().map(|row| row.as_slice().try_into()).collect::<Result<_, _>>().map_err(|_| wrong())?;
    if !matches!(rows.len(), 3 | 4) {
        return Err(wrong());
    }
    if is_lost(&rows) {
        return Ok(None);
    }
    let (a, b, c) = match rows.as_slice() {
        [a, b, c] | [a, b, c, [0.0, 0.0, 0.0, 1.0]] => (a, b, c),
        _ => return Err(wrong()),
    };
    let (turn, shift) = rigid([*a, *b, *c]).ok_or_else(|| format!("transform_matrix {NOT_RIGID}"))?;
    // OpenCV's y and z axes are OpenGL's, reversed.
    let world_from_camera = DMat3::from_cols(turn.x_axis, -turn.y_axis, -turn.z_axis);
    Ok(Some(Pose::from_camera_in_world(shift * metres_per_unit, DQuat::from_mat3(&world_from_camera))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn row(values: [f64; 4]) -> Vec<f64> {
        values.to_vec()
    }

    #[test]
    fn opengl_axes_become_opencv_axes() {
        // At (1, 2, 3), unrotated: faces world −z, world y is up in the picture.
        let m = [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]].map(row);
        for matrix in [&m[..], &m[..3]] {
            let p = pose(matrix, 2.0).unwrap().unwrap().transform_point(DVec3::new(2.5, 5.0, 2.0));
            assert!((p - DVec3::new(0.5, -1.0, 4.0)).length() < 1e-12, "{p}");
        }
    }

    #[test]
    fn non_rigid_transform_is_refused() {
        let good = [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]].map(row);
        let with = |row: usize, column: usize, value: f64| {
            let mut m = good.clone();
            m[row][column] = value;
            pose(&m, 1.0).is_err()
        };
        assert!(!with(0, 0, 1.009), "a rounding error passes");
        assert!(with(0, 0, 1.02) && with(0, 0, -1.0) && with(0, 1, 0.05));
        assert!(pose(&good[..2], 1.0).is_err());
        assert!(pose(&[vec![1.0; 3], vec![1.0; 3], vec![1.0; 3]], 1.0).is_err());
    }

    #[test]
    fn matrix_of_zeros_or_null_is_a_lost_pose() {
        let zeros = [[0.0; 4]; 4].map(row);
        assert!(pose(&zeros, 1.0).unwrap().is_none());
        for entry in ["", r#", "transform_matrix": null"#, r#", "transform_matrix": []"#] {
            let json = format!(r#"{{"frames": [{{"file_path": "a"{entry}}}]}}"#);
            let t = parse(&json, Path::new("t.json")).unwrap();
            assert!(pose(&t.frames[0].transform_matrix, 1.0).unwrap().is_none(), "{json}");
        }
    }

    #[test]
    fn non_finite_matrix_is_a_lost_pose() {
        let json = r#"{"frames": [{"file_path": "NaN \" Infinity\\", "transform_matrix":
            [[1, 0, 0, NaN], [0, 1, 0, -Infinity], [0, 0, 1, Infinity], [0, 0, 0, 1]]}]}"#;
        let t = parse(json, Path::new("t.json")).unwrap();
        assert_eq!(t.frames[0].file_path, "NaN \" Infinity\\");
        assert!(pose(&t.frames[0].transform_matrix, 1.0).unwrap().is_none());
        assert!(pose(&[row([f64::NAN; 4]), row([0.0; 4]), row([0.0; 4])], 1.0).unwrap().is_none());
    }

    #[test]
    fn non_finite_value_outside_a_matrix_is_refused() {
        let error = |text: &str| parse(text, Path::new("t.json")).map(drop).unwrap_err().to_string();
        for name in ["fl_x", "k1", "depth_unit_scale_factor"] {
            let error = error(&format!(r#"{{"{name}": NaN, "frames": []}}"#));
            assert!(error.starts_with("t.json: ") && error.contains("NaN"), "{error}");
        }
        let matrix = |entry| format!(r#"{{"frames": [{{"file_path": "a", "transform_matrix": [[{entry}]]}}]}}"#);
        let error = error(&matrix("\"one\""));
        assert!(error.contains("a matrix of numbers is needed"), "{error}");
        assert!(parse(&matrix("-Infinity"), Path::new("t.json")).is_ok());
    }

    #[test]
    fn focal_lengths_follow_from_either_angle() {
        let focal_px = |angles: &str| {
            let json = format!(r#"{{"w": 64, "h": 48, {angles}, "frames": []}}"#);
            let t = parse(&json, Path::new("t.json")).unwrap();
            let i = t.camera.geometry(Path::new("")).unwrap().unwrap().intrinsics;
            (i.fx_px, i.fy_px)
        };
        let (x, y) = (32.0 / 0.5f64.tan(), 24.0 / 0.4f64.tan());
        assert_eq!(focal_px(r#""camera_angle_x": 1.0, "camera_angle_y": 0.8"#), (x, y));
        assert_eq!(focal_px(r#""camera_angle_x": 1.0"#), (x, x));
        assert_eq!(focal_px(r#""camera_angle_y": 0.8"#), (y, y));
        assert_eq!(focal_px(r#""fl_x": 50, "camera_angle_y": 0.8"#), (50.0, y));
    }

    #[test]
    fn frame_camera_overrides_the_common_one() {
        let t = parse(
            r#"{"fl_x": 500, "w": 640, "h": 480, "k1": 0.1, "camera_model": "OPENCV", "aabb_scale": 16, "frames":
            [{"file_path": "a.png", "transform_matrix": [], "fl_x": 400, "cx": 300.5}]}"#,
            Path::new("t.json"),
        )
        .unwrap();
        let g = t.frames[0].camera.clone().or(&t.camera).geometry(Path::new("")).unwrap().unwrap();
        let i = &g.intrinsics;
        assert_eq!((i.fx_px, i.fy_px, i.cx_px, i.cy_px, g.distortion.k1), (400.0, 400.0, 300.5, 240.0, 0.1));
        let model = |name: &str, k4| {
            let camera = TransformsCamera { camera_model: Some(name.to_owned()), k4, ..t.camera.clone() };
            camera.geometry(Path::new("")).map(|g| g.unwrap().distortion)
        };
        for name in ["SIMPLE_RADIAL", "RADIAL"] {
            let d = model(name, None).unwrap();
            assert_eq!((d.model, d.k1), (LensModel::Opencv, 0.1));
        }
        for name in ["OPENCV_FISHEYE", "fisheye"] {
            let d = model(name, Some(0.2)).unwrap();
            assert_eq!((d.model, d.k1, d.k4), (LensModel::OpencvFisheye, 0.1, 0.2));
        }
        let instant = TransformsCamera { is_fisheye: Some(true), camera_model: None, ..t.camera.clone() };
        assert_eq!(instant.geometry(Path::new("")).unwrap().unwrap().distortion.model, LensModel::OpencvFisheye);
        assert!(model("OPENCV", Some(0.2)).unwrap_err().contains("k4 is not 0"));
        assert!(model("FOV", None).unwrap_err().contains("expected OPENCV, PINHOLE"));
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", matrix in prop::collection::vec(prop::collection::vec(any::<f64>(), 0..6), 0..6)) {
            let _ = parse(&text, Path::new("t.json"));
            let _ = pose(&matrix, 1.0);
        }
    }
}
