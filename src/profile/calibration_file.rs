//! Cameras in the calibration files of other programs: OpenCV's YAML and XML, ROS's `camera_info`,
//! Kalibr's camchain. Pixel centres are at whole numbers in all of them; Locard's are half a pixel
//! further. Sources: OpenCV's sample `camera_calibration`; `sensor_msgs/CameraInfo`;
//! <https://github.com/ethz-asl/kalibr/wiki/yaml-formats>.
//!
//! | model there | coefficients in order | lens model |
//! |---|---|---|
//! | OpenCV, `plumb_bob`, `radtan` | k1 k2 p1 p2 k3 | `opencv` |
//! | OpenCV, `rational_polynomial` | k1 k2 p1 p2 k3 k4 k5 k6 | `opencv_rational` |
//! | OpenCV's `fisheye_model: 1`, `equidistant`, `fisheye` | k1 k2 k3 k4 | `opencv_fisheye` |
//! | Kalibr's `fov` | ω | `fov` |

use std::path::Path;

use roxmltree::Document;

use crate::camera::LensModel;
use crate::params::{Params, Value};
use crate::text::quoted;
use crate::yaml::{self, YamlKeys};

/// A value of a profile: table, name and value.
pub type ProfileValue = (&'static str, &'static str, Value);

const INTRINSICS_TABLE: &str = "camera";
const DISTORTION_TABLE: &str = "camera.distortion";

/// Names of the keys, by OpenCV's samples old and new, by ROS's files and messages.
const WIDTH: &[&str] = &["image_width", "image_Width", "width"];
const HEIGHT: &[&str] = &["image_height", "image_Height", "height"];
const MATRIX: &[&str] = &["camera_matrix", "Camera_Matrix", "cameraMatrix", "CameraMatrix", "K", "k"];
const COEFFICIENTS: &[&str] =
    &["distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "D", "d"];
const MODEL: &[&str] = &["distortion_model"];
const FISHEYE_FLAG: &[&str] = &["fisheye_model"];

/// OpenCV's order of the coefficients.
const OPENCV_ORDER: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
const FISHEYE_ORDER: [&str; 4] = ["k1", "k2", "k3", "k4"];

/// True for a file of another program, by its name or its first characters.
pub fn is_calibration(path: &Path, text: &str) -> bool {
    let is_named = path
        .extension()
        .is_some_and(|own| ["yaml", "yml", "xml"].iter().any(|ending| own.eq_ignore_ascii_case(ending)));
    let start = text.trim_start_matches('\u{feff}').trim_start();
    is_named || ["%YAML", "<?xml", "<opencv_storage"].iter().any(|word| start.starts_with(word))
}

/// The values of `[camera]` and `[camera.distortion]`. Ranges are not checked.
pub fn read(text: &str) -> Result<Vec<ProfileValue>, String> {
    let start = text.trim_start_matches('\u{feff}').trim_start();
    let keys = if start.starts_with('<') { opencv_xml(start)? } else { yaml::parse(text) };
    match kalibr_cameras(&keys).as_slice() {
        [] => opencv(&CalibrationKeys { keys: &keys, prefix: String::new() }),
        [camera] => kalibr(&CalibrationKeys { keys: &keys, prefix: format!("{camera}.") }),
        cameras => Err(format!(
            "holds {} cameras ({}); a profile describes one: keep the block of the recording's camera alone",
            cameras.len(),
            cameras.join(", ")
        )),
    }
}

/// The keys of a file's camera.
struct CalibrationKeys<'a> {
    keys: &'a YamlKeys,
    prefix: String,
}

impl CalibrationKeys<'_> {
    /// The value of the first of the names, with the name.
    fn find<'n>(&self, names: &[&'n str]) -> Option<(&'n str, &(usize, String))> {
        names.iter().find_map(|name| {
            let key = format!("{}{name}", self.prefix);
            // A matrix is a value itself, or has its numbers below.
            let data = self.keys.get(&format!("{key}.data"));
            Some((*name, data.or_else(|| self.keys.get(&key))?))
        })
    }

    fn word(&self, names: &[&str]) -> Option<&str> {
        self.find(names).map(|(_, (_, value))| yaml::word(value)).filter(|value| !value.is_empty())
    }

    fn refuse(&self, names: &[&str], problem: &str) -> String {
        match self.find(names) {
            Some((name, (line, _))) => format!("line {line}: {}{name} {problem}", self.prefix),
            None => format!("{}{} is missing", self.prefix, names.first().unwrap_or(&"")),
        }
    }

    /// Finite numbers; `None` if there is no such key.
    fn numbers(&self, names: &[&str]) -> Result<Option<Vec<f64>>, String> {
        let Some((_, (_, value))) = self.find(names) else { return Ok(None) };
        match yaml::numbers(value) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.refuse(names, &format!("is `{}`; finite numbers are needed", quoted(value)))),
        }
    }

    fn exactly<const N: usize>(&self, names: &[&str]) -> Result<[f64; N], String> {
        let numbers = self.numbers(names)?.ok_or_else(|| self.refuse(names, ""))?;
        let count = numbers.len();
        numbers.try_into().map_err(|_| self.refuse(names, &format!("holds {count} numbers; expected {N}")))
    }
}

/// The camera of OpenCV's or ROS's keys.
fn opencv(keys: &CalibrationKeys<'_>) -> Result<Vec<ProfileValue>, String> {
    if keys.find(MATRIX).is_none() {
        return Err("holds no camera: expected camera_matrix, distortion_coefficients, image_width and image_height \
                    (OpenCV, ROS), or cam0 with intrinsics and resolution (Kalibr)"
            .to_owned());
    }
    let [width] = keys.exactly(WIDTH)?;
    let [height] = keys.exactly(HEIGHT)?;
    let [fx, skew, cx, below, fy, cy, last @ ..] = keys.exactly::<9>(MATRIX)?;
    if last != [0.0, 0.0, 1.0] || below != 0.0 || skew != 0.0 {
        return Err(keys.refuse(MATRIX, "must have the rows fx 0 cx, 0 fy cy, 0 0 1"));
    }
    let coefficients = keys.numbers(COEFFICIENTS)?.unwrap_or_default();
    let is_fisheye = keys.numbers(FISHEYE_FLAG)?.is_some_and(|flag| flag.iter().any(|flag| *flag != 0.0));
    let lens = match keys.word(MODEL) {
        _ if is_fisheye => fisheye(&coefficients),
        None | Some("plumb_bob" | "rational_polynomial" | "radtan") => polynomial(&coefficients),
        Some("equidistant" | "fisheye") => fisheye(&coefficients),
        // A message without a calibration.
        Some("none") if coefficients.is_empty() => polynomial(&coefficients),
        Some(other) => {
            let problem =
                format!("is {}; expected plumb_bob, rational_polynomial, equidistant or fisheye", quoted(other));
            return Err(keys.refuse(MODEL, &problem));
        }
    };
    let lens = lens.map_err(|problem| keys.refuse(COEFFICIENTS, &problem))?;
    Ok(values([width, height], [fx, fy, cx, cy], lens))
}

/// The names of Kalibr's cameras.
fn kalibr_cameras(keys: &YamlKeys) -> Vec<String> {
    let camera = |key: &String| {
        let name = key.strip_suffix(".camera_model")?;
        (name.starts_with("cam") && !name.contains('.')).then(|| name.to_owned())
    };
    keys.keys().filter_map(camera).collect()
}

fn kalibr(keys: &CalibrationKeys<'_>) -> Result<Vec<ProfileValue>, String> {
    let model = keys.word(&["camera_model"]).unwrap_or_default();
    if model != "pinhole" {
        let problem = format!(
            "is {}; expected pinhole: calibrate again with --models pinhole-radtan or pinhole-equi",
            quoted(model)
        );
        return Err(keys.refuse(&["camera_model"], &problem));
    }
    let [width, height] = keys.exactly(&["resolution"])?;
    let intrinsics: [f64; 4] = keys.exactly(&["intrinsics"])?;
    const COEFFICIENTS: &[&str] = &["distortion_coeffs"];
    let coefficients = keys.numbers(COEFFICIENTS)?.unwrap_or_default();
    let lens = match keys.word(MODEL) {
        Some("radtan") => polynomial(&coefficients),
        Some("equidistant") => fisheye(&coefficients),
        Some("none") => polynomial(&[]),
        Some("fov") => match coefficients.as_slice() {
            [omega] => Ok(CalibratedLens { model: LensModel::Fov, coefficients: vec![("omega", *omega)] }),
            other => Err(format!("holds {} numbers; expected 1", other.len())),
        },
        other => {
            let problem =
                format!("is {}; expected radtan, equidistant, fov or none", quoted(other.unwrap_or("missing")));
            return Err(keys.refuse(MODEL, &problem));
        }
    };
    Ok(values([width, height], intrinsics, lens.map_err(|problem| keys.refuse(COEFFICIENTS, &problem))?))
}

/// A lens model with its coefficients by Locard's names.
struct CalibratedLens {
    model: LensModel,
    coefficients: Vec<(&'static str, f64)>,
}

/// OpenCV's model with 0, 4, 5, 8, 12 or 14 coefficients.
fn polynomial(coefficients: &[f64]) -> Result<CalibratedLens, String> {
    if !matches!(coefficients.len(), 0 | 4 | 5 | 8 | 12 | 14) {
        return Err(format!("holds {} numbers; expected 0, 4, 5, 8, 12 or 14", coefficients.len()));
    }
    if coefficients.iter().skip(OPENCV_ORDER.len()).any(|value| *value != 0.0) {
        return Err("has thin-prism or tilt terms, which are not supported: calibrate again without them".to_owned());
    }
    let has_denominator = coefficients.iter().skip(5).any(|value| *value != 0.0);
    let model = if has_denominator { LensModel::OpencvRational } else { LensModel::Opencv };
    Ok(CalibratedLens { model, coefficients: OPENCV_ORDER.into_iter().zip(coefficients.iter().copied()).collect() })
}

/// OpenCV's fisheye.
fn fisheye(coefficients: &[f64]) -> Result<CalibratedLens, String> {
    if !matches!(coefficients.len(), 0 | 4) {
        return Err(format!("holds {} numbers; expected the 4 of a fisheye", coefficients.len()));
    }
    let coefficients = FISHEYE_ORDER.into_iter().zip(coefficients.iter().copied()).collect();
    Ok(CalibratedLens { model: LensModel::OpencvFisheye, coefficients })
}

/// All values of a camera's geometry: coefficients that the file does not have are 0.
fn values([width, height]: [f64; 2], [fx, fy, cx, cy]: [f64; 4], lens: CalibratedLens) -> Vec<ProfileValue> {
    let intrinsics = [
        ("width_px", width),
        ("height_px", height),
        ("fx_px", fx),
        ("fy_px", fy),
        ("cx_px", cx + 0.5),
        ("cy_px", cy + 0.5),
    ];
    let mut all: Vec<ProfileValue> =
        intrinsics.into_iter().map(|(name, value)| (INTRINSICS_TABLE, name, Value::Number(value))).collect();
    let distortion = crate::camera::Distortion { model: lens.model, ..Default::default() };
    for spec in distortion.specs() {
        let coefficient = lens.coefficients.iter().find(|(name, _)| *name == spec.name);
        let value = coefficient.map(|(_, value)| Value::Number(*value)).or_else(|| distortion.get(spec.name));
        all.extend(value.map(|value| (DISTORTION_TABLE, spec.name, value)));
    }
    all
}

/// The keys of OpenCV's XML: scalars, and the numbers of matrices as a list.
fn opencv_xml(text: &str) -> Result<YamlKeys, String> {
    let document = Document::parse(text).map_err(|error| format!("is not well-formed XML ({error})"))?;
    let root = document.root_element();
    if !root.has_tag_name("opencv_storage") {
        return Err(format!("has the root <{}>; expected <opencv_storage>", quoted(root.tag_name().name())));
    }
    let line = |node: roxmltree::Node<'_, '_>| document.text_pos_at(node.range().start).row as usize;
    let mut keys = YamlKeys::new();
    for node in root.children().filter(roxmltree::Node::is_element) {
        let name = node.tag_name().name();
        let data = node.children().find(|child| child.has_tag_name("data"));
        let text = data.unwrap_or(node).text().unwrap_or_default();
        let words: Vec<&str> = text.split_whitespace().collect();
        // Lines of few keys are looked up: only those that a camera has.
        if WIDTH.iter().chain(HEIGHT).chain(MATRIX).chain(COEFFICIENTS).chain(FISHEYE_FLAG).any(|key| *key == name) {
            keys.insert(name.to_owned(), (line(node), format!("[{}]", words.join(", "))));
        }
    }
    Ok(keys)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics};
    use glam::{DVec2, DVec3};
    use proptest::prelude::*;

    const OPENCV: &str = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
        cols: 3\n   dt: d\n   data: [ 500., 0., 319.5, 0.,\n       400., 239.5, 0., 0., 1. ]\ndistortion_coefficients: \
        !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.1, 0.4, 0.01, 0.02, 8. ]\n";

    const ROS: &str = "image_width: 640\nimage_height: 480\ncamera_name: narrow\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: \
        [500, 0, 319.5, 0, 400, 239.5, 0, 0, 1]\ndistortion_model: rational_polynomial\ndistortion_coefficients:\n  rows: 1\n  \
        cols: 8\n  data: [-0.1, 0.4, 0.01, 0.02, 8, 0.1, 0.4, -2]\nprojection_matrix:\n  rows: 3\n  cols: 4\n  data: [1, 0, 0, \
        0, 0, 1, 0, 0, 0, 0, 1, 0]\n";

    const KALIBR: &str = "cam0:\n  cam_overlaps: []\n  camera_model: pinhole\n  distortion_coeffs: [0.1, -0.2, 0.3, -0.4]\n  \
        distortion_model: equidistant\n  intrinsics: [100.0, 100.0, 319.5, 239.5]\n  resolution: [640, 480]\n  rostopic: \
        /cam0/image_raw\n";

    fn geometry(text: &str) -> Result<Geometry, String> {
        let (mut intrinsics, mut distortion) = (Intrinsics::default(), Distortion::default());
        for (table, name, value) in read(text)? {
            let table: &mut dyn Params = if table == INTRINSICS_TABLE { &mut intrinsics } else { &mut distortion };
            table.set(name, &value).map_err(|e| e.to_string())?;
        }
        Ok(Geometry::new(intrinsics, distortion))
    }

    fn projected(text: &str, point: [f64; 3]) -> DVec2 {
        geometry(text).unwrap().project(DVec3::from(point)).unwrap()
    }

    #[test]
    fn opencv_files_match_the_formula() {
        // u = 0.2, v = 0.1, r² = 0.05: radial 1 − 0.005 + 0.001 + 0.001 = 0.997; x' = 0.1994 +
        // 2·0.01·0.02 + 0.02·(0.05 + 0.08) = 0.2024; y' = 0.0997 + 0.01·(0.05 + 0.02) + 2·0.02·0.02
        // = 0.1012. The principal point is half a pixel further.
        let expected = DVec2::new(320.0 + 500.0 * 0.2024, 240.0 + 400.0 * 0.1012);
        assert!((projected(OPENCV, [0.4, 0.2, 2.0]) - expected).length() < 1e-9);
        let xml = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>640</image_width>\n<image_height>480</image_height>\n\
                   <camera_matrix type_id=\"opencv-matrix\">\n<rows>3</rows><cols>3</cols><dt>d</dt>\n<data>\n500. 0. 319.5 0.\n\
                   400. 239.5 0. 0. 1.</data></camera_matrix>\n<distortion_coefficients type_id=\"opencv-matrix\">\n<data>-0.1 \
                   0.4 0.01 0.02 8.</data></distortion_coefficients>\n</opencv_storage>\n";
        assert_eq!(geometry(xml), geometry(OPENCV));
        let message = "height: 480\nwidth: 640\ndistortion_model: plumb_bob\nd:\n- -0.1\n- 0.4\n- 0.01\n- 0.02\n- 8\nk:\n- 500\n- \
                       0\n- 319.5\n- 0\n- 400\n- 239.5\n- 0\n- 0\n- 1\n";
        assert_eq!(geometry(message), geometry(OPENCV));
        let fisheye = OPENCV.replace("image_width", "fisheye_model: 1\nimage_width").replace(", 8. ]", " ]");
        assert_eq!(geometry(&fisheye).unwrap().distortion.model, LensModel::OpencvFisheye);
        assert_eq!(geometry(&fisheye.replace("model: 1", "model: 0")).unwrap().distortion.p1, 0.01);
    }

    #[test]
    fn ros_rational_model_matches_the_formula() {
        // As above, over the denominator 1 + 0.005 + 0.001 − 0.00025; tangential 0.003 and 0.0015.
        let expected =
            DVec2::new(320.0 + 500.0 * (0.1994 / 1.00575 + 0.003), 240.0 + 400.0 * (0.0997 / 1.00575 + 0.0015));
        assert!((projected(ROS, [0.4, 0.2, 2.0]) - expected).length() < 1e-9);
    }

    #[test]
    fn kalibr_fisheye_matches_the_formula() {
        // θ = atan 1.25, θ_d/θ = 0.9404014 along (0.6, 0.8), as of COLMAP's OPENCV_FISHEYE.
        let expected = DVec2::new(320.0, 240.0) + 89.605_5 * 0.940_401_4 * DVec2::new(0.6, 0.8);
        assert!((projected(KALIBR, [1.5, 2.0, 2.0]) - expected).length() < 1e-3);
        let fov = KALIBR.replace("equidistant", "fov").replace("0.1, -0.2, 0.3, -0.4", "0.9");
        assert_eq!(geometry(&fov).unwrap().distortion.omega, 0.9);
        let radtan = geometry(&KALIBR.replace("equidistant", "radtan")).unwrap().distortion;
        assert_eq!((radtan.k1, radtan.k2, radtan.p1, radtan.p2), (0.1, -0.2, 0.3, -0.4));
    }

    #[test]
    fn refusals_name_line_and_key() {
        for (text, expected) in [
            (OPENCV.replace("camera_matrix", "matrix"), "holds no camera: expected camera_matrix"),
            (OPENCV.replace("image_width: 640\n", ""), "image_width is missing"),
            (OPENCV.replace("0., 0., 1. ]", "0., 1. ]"), "line 9: camera_matrix holds 8 numbers; expected 9"),
            (OPENCV.replace("500., 0.", "500., 1."), "line 9: camera_matrix must have the rows"),
            (OPENCV.replace("500.", ".nan"), "line 9: camera_matrix is `[ .nan, 0., 319.5"),
            (OPENCV.replace(", 8. ]", ", 8., 9. ]"), "line 15: distortion_coefficients holds 6 numbers"),
            (ROS.replace("rational_polynomial", "thin"), "line 8: distortion_model is thin; expected plumb_bob"),
            (ROS.replace("0.4, -2]", "0.4, -2, 1, 0, 0, 0]"), "line 12: distortion_coefficients has thin-prism"),
            (KALIBR.replace("pinhole", "omni"), "line 3: cam0.camera_model is omni; expected pinhole"),
            (KALIBR.replace("equidistant", "x"), "line 5: cam0.distortion_model is x; expected radtan"),
            (KALIBR.replace("[640, 480]", "[640]"), "line 7: cam0.resolution holds 1 numbers; expected 2"),
            (format!("{KALIBR}{}", KALIBR.replace("cam0:", "cam1:")), "holds 2 cameras (cam0, cam1); a profile"),
            ("<a/>".to_owned(), "has the root <a>; expected <opencv_storage>"),
            ("<opencv_storage>".to_owned(), "is not well-formed XML"),
            (String::new(), "holds no camera"),
        ] {
            let error = read(&text).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", cut in 0usize..600, value in "[-0-9.eNa]{1,6}") {
            let _ = read(&text);
            for file in [OPENCV, ROS, KALIBR] {
                let _ = (read(&file[..cut.min(file.len())]), read(&file.replace("319.5", &value)));
            }
        }
    }
}
