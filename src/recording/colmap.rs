//! A COLMAP text model: `cameras.txt`, `images.txt`. Poses are world to camera with OpenCV's
//! axes, quaternions w x y z, an arbitrary unit; pixel centres are at +0.5 already.
//! Source: <https://colmap.github.io/format.html#text-format>,
//! <https://colmap.github.io/cameras.html>.
//!
//! To add a camera model: a line in [`camera_parameters`], and its name in [`MODELS`].

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use super::parts::{NOMINAL_FPS, Parts, Pictures, RecordingFormat, folder_of, geometry_from, track_from};
use super::{Landmark, OpenOptions, RecordingError, listing};
use crate::camera::{Geometry, LensModel};
use crate::pose::Pose;
use crate::source::unsupported;
use crate::text::quoted;
use crate::tracking::records::{self, TextError};
use crate::tracking::tum::{PoseNotes, unit_quaternion};

const MODELS: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV (with k4 = k5 = k6 = 0), \
                      SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE";

/// Advice for unsupported models.
const UNDISTORT_ADVICE: &str = "make pictures without distortion: colmap image_undistorter --image_path IMAGES --input_path \
                         sparse/0 --output_path NEW, then colmap model_converter --input_path NEW/sparse --output_path \
                         NEW/sparse --output_type TXT";

const CAMERAS: &str = "cameras.txt";
const IMAGES: &str = "images.txt";

/// Locations of a model in a folder.
pub const MODEL_FOLDERS: [&str; 4] = ["", "colmap", "sparse/0", "sparse"];

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "COLMAP",
    marker: "a COLMAP text model (cameras.txt, images.txt, here, in colmap/ or in sparse/0/)",
    has_times: false,
    is_metric: false,
    find: |path| {
        if path.is_file() {
            (path.ends_with(CAMERAS) || path.ends_with(IMAGES)).then(|| folder_of(path))
        } else {
            MODEL_FOLDERS.iter().map(|at| path.join(at)).find(|at| at.join(IMAGES).exists())
        }
    },
    open,
};

/// A registered image.
#[derive(Debug)]
struct ColmapImage {
    name: String,
    camera: u32,
    camera_from_world: Pose,
    landmarks: Vec<Landmark>,
    line: usize,
}

/// Opens the model in the folder `model`. `path` is the user's argument: that folder, a parent, or
/// one of its files.
fn open(model: &Path, path: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let path = if path.is_dir() { path } else { model };
    let cameras_file = model.join(CAMERAS);
    let cameras = parse_cameras(&records::read(&cameras_file)?, &cameras_file)?;
    let images_file = model.join(IMAGES);
    let (images, odd) = parse_images(&records::read(&images_file)?, &images_file, options.metres_per_unit)?;
    let folder = image_folder(model, path, &images)?;
    let registered: BTreeMap<&str, &ColmapImage> = images.iter().map(|image| (image.name.as_str(), image)).collect();
    let (names, unread) = frame_names(&folder, &registered)?;

    let (mut poses, mut geometries, mut landmarks) = (Vec::new(), Vec::new(), Vec::new());
    let mut timestamps_s = Vec::new();
    for (i, name) in names.iter().enumerate() {
        timestamps_s.push(i as f64 / NOMINAL_FPS);
        let Some(image) = registered.get(name.as_str()) else {
            geometries.push(None);
            landmarks.push(Vec::new());
            continue;
        };
        let camera = cameras.get(&image.camera).ok_or_else(|| {
            let problem = format!("{} names camera {}, which cameras.txt does not have", quoted(name), image.camera);
            TextError::line(&images_file, image.line, problem)
        })?;
        poses.push((i as f64 / NOMINAL_FPS, image.camera_from_world));
        geometries.push(Some(camera.clone()));
        landmarks.push(image.landmarks.clone());
    }
    let files = names.iter().map(|name| folder.join(name)).collect();
    let mut parts = Parts::new(path, Pictures::Stills(files), timestamps_s);
    // An unregistered image has no pose; its neighbours do not determine it.
    parts.track = track_from(poses, options.max_gap_s.or(Some(1.5 / NOMINAL_FPS)), &images_file)?;
    parts.geometries = geometries;
    parts.landmarks = landmarks;
    parts.description_files = vec![cameras_file, images_file];
    parts.warnings.push(format!("COLMAP stores no timestamps: {NOMINAL_FPS} frames a second are assumed"));
    parts.warnings.extend(odd);
    parts.warnings.extend(unsupported::unread_warning(&unread));
    Ok(parts)
}

fn parse_cameras(text: &str, file: &Path) -> Result<BTreeMap<u32, Geometry>, TextError> {
    let mut cameras = BTreeMap::new();
    for (line, record) in records::records(text) {
        let (id, geometry) = parse_camera(record).map_err(|problem| TextError::line(file, line, problem))?;
        if cameras.insert(id, geometry).is_some() {
            return Err(TextError::line(file, line, format!("camera {id} occurs twice")));
        }
    }
    Ok(cameras)
}

fn parse_camera(mut record: &str) -> Result<(u32, Geometry), String> {
    let id = whole(&mut record, "CAMERA_ID")?;
    let model = records::word(&mut record);
    let width = records::number(&mut record, "WIDTH")?;
    let height = records::number(&mut record, "HEIGHT")?;
    let names = camera_parameters(model).ok_or_else(|| {
        format!("the camera model `{}` is not supported; expected {MODELS}; {UNDISTORT_ADVICE}", quoted(model))
    })?;
    let mut values = vec![("width_px", width), ("height_px", height)];
    for name in names {
        let value = records::number(&mut record, name)?;
        match *name {
            "f" => values.extend([("fx_px", value), ("fy_px", value)]),
            // These are in a denominator.
            "k4" | "k5" | "k6" if model == "FULL_OPENCV" && value == 0.0 => {}
            "k4" | "k5" | "k6" if model == "FULL_OPENCV" => {
                return Err(format!(
                    "FULL_OPENCV with {name} = {value} is not supported, 0 is needed; {UNDISTORT_ADVICE}"
                ));
            }
            name => values.push((name, value)),
        }
    }
    records::end(record)?;
    let lens = if model.ends_with("_FISHEYE") { LensModel::OpencvFisheye } else { LensModel::Opencv };
    geometry_from(lens, &values).map(|geometry| (id, geometry)).map_err(|e| e.to_string())
}

/// A camera model's parameters in COLMAP's order, with Locard's names. `f` sets both focal lengths.
fn camera_parameters(model: &str) -> Option<&'static [&'static str]> {
    Some(match model {
        "SIMPLE_PINHOLE" => &["f", "cx_px", "cy_px"],
        "PINHOLE" => &["fx_px", "fy_px", "cx_px", "cy_px"],
        "SIMPLE_RADIAL" => &["f", "cx_px", "cy_px", "k1"],
        "RADIAL" => &["f", "cx_px", "cy_px", "k1", "k2"],
        "OPENCV" => &["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2"],
        "FULL_OPENCV" => &["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
        "SIMPLE_RADIAL_FISHEYE" => &["f", "cx_px", "cy_px", "k1"],
        "RADIAL_FISHEYE" => &["f", "cx_px", "cy_px", "k1", "k2"],
        "OPENCV_FISHEYE" => &["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "k3", "k4"],
        _ => return None,
    })
}

/// Two lines per image: the pose, then the observed points, of which there may be none.
fn parse_images(text: &str, file: &Path, metres_per_unit: f64) -> Result<(Vec<ColmapImage>, Vec<String>), TextError> {
    let (mut images, mut names, mut odd) = (Vec::new(), BTreeSet::new(), PoseNotes::default());
    let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    while let Some((line, record)) = lines.next() {
        if record.is_empty() || record.starts_with('#') {
            continue;
        }
        let refuse = |problem: String| TextError::line(file, line, problem);
        let (image, norm_error) = parse_image(record, line, metres_per_unit).map_err(refuse)?;
        if !names.insert(image.name.clone()) {
            return Err(refuse(format!("the image {} occurs twice", quoted(&image.name))));
        }
        odd.note(norm_error, format!("line {line}"));
        let (line, points) = lines.next().unwrap_or_default();
        let landmarks = landmarks(points).ok_or_else(|| {
            let problem = "the line after an image's pose must list its points (X Y POINT3D_ID each), or be blank";
            TextError::line(file, line, problem)
        })?;
        images.push(ColmapImage { landmarks, ..image });
    }
    let warnings = odd.warnings(file, images.len());
    Ok((images, warnings))
}

fn parse_image(record: &str, line: usize, metres_per_unit: f64) -> Result<(ColmapImage, f64), String> {
    let mut rest = record;
    let _: u32 = whole(&mut rest, "IMAGE_ID")?;
    let mut fields = [0.0; 7];
    for (field, name) in fields.iter_mut().zip(["QW", "QX", "QY", "QZ", "TX", "TY", "TZ"]) {
        *field = records::number(&mut rest, name)?;
    }
    let [qw, qx, qy, qz, tx, ty, tz] = fields;
    let (rotation, norm_error) = unit_quaternion(DQuat::from_xyzw(qx, qy, qz, qw))?;
    let camera = whole(&mut rest, "CAMERA_ID")?;
    let name = listing::file_name(rest, "NAME is missing")?;
    let camera_from_world = Pose::new(rotation, DVec3::new(tx, ty, tz) * metres_per_unit);
    Ok((ColmapImage { name, camera, camera_from_world, landmarks: Vec::new(), line }, norm_error))
}

/// Landmarks observed in an image. Points without a landmark have the number −1.
fn landmarks(points: &str) -> Option<Vec<Landmark>> {
    let mut words = points.split_whitespace();
    let mut landmarks = Vec::new();
    while let Some(x) = words.next() {
        let (y, number) = (words.next()?, words.next()?);
        // Invalid coordinates are skipped.
        if let (Ok(x), Ok(y), Ok(number)) = (x.parse(), y.parse(), number.parse()) {
            landmarks.push(Landmark { number, at_px: [x, y] });
        }
    }
    Some(landmarks)
}

fn whole(rest: &mut &str, name: &str) -> Result<u32, String> {
    let found = records::word(rest);
    found.parse().map_err(|_| format!("{name} is `{}`; a whole number is needed", quoted(found)))
}

/// The folder that the images' names are relative to.
fn image_folder(model: &Path, path: &Path, images: &[ColmapImage]) -> Result<PathBuf, RecordingError> {
    let Some(first) = images.first() else {
        return Err(RecordingError::content(&model.join(IMAGES), "the model has no images"));
    };
    let candidates = [
        path.join("images"),
        model.join("images"),
        model.join("../images"),
        model.join("../../images"),
        path.to_owned(),
    ];
    candidates.iter().find(|folder| folder.join(&first.name).is_file()).cloned().ok_or_else(|| {
        let looked = candidates.iter().map(|c| c.display().to_string()).collect::<Vec<_>>().join(", ");
        RecordingError::content(&model.join(IMAGES), format!("{} is in none of {looked}", quoted(&first.name)))
    })
}

/// The frames: the model's images and further ones in the same folders, which have no pose, in the
/// order of their names. Also returns the pictures there that cannot be decoded.
fn frame_names(
    folder: &Path,
    registered: &BTreeMap<&str, &ColmapImage>,
) -> Result<(Vec<String>, Vec<PathBuf>), RecordingError> {
    let mut unread = Vec::new();
    let mut names: BTreeSet<String> = registered.keys().map(|name| (*name).to_owned()).collect();
    let folders: BTreeSet<&Path> = registered.keys().filter_map(|name| Path::new(name).parent()).collect();
    for inner in folders {
        for file in listing::pictures_in(&folder.join(inner))? {
            let name = file.file_name().map(|name| inner.join(name).to_string_lossy().into_owned());
            names.extend(name);
        }
        // An undecodable image of the model remains a frame and causes an error.
        let is_registered = |file: &PathBuf| names.iter().any(|name| folder.join(name) == *file);
        unread.extend(unsupported::in_folder(&folder.join(inner)).into_iter().filter(|file| !is_registered(file)));
    }
    let mut names: Vec<String> = names.into_iter().collect();
    names.sort_by(|a, b| listing::natural_order(a, b));
    Ok((names, unread))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use proptest::prelude::*;

    fn cameras(text: &str) -> Result<BTreeMap<u32, Geometry>, String> {
        parse_cameras(text, Path::new("cameras.txt")).map_err(|e| e.to_string())
    }

    fn images(text: &str, metres_per_unit: f64) -> Result<Vec<ColmapImage>, String> {
        parse_images(text, Path::new("images.txt"), metres_per_unit).map(|r| r.0).map_err(|e| e.to_string())
    }

    #[test]
    fn camera_models_match_their_formulas() {
        // u = 0.2, v = 0.1: r² = 0.05, r⁴ = 0.0025, r⁶ = 0.000125.
        for (text, expected) in [
            ("1 SIMPLE_PINHOLE 640 480 500 320 240", (420.0, 290.0)),
            ("1 PINHOLE 640 480 500 400 320 240", (420.0, 280.0)),
            ("1 SIMPLE_RADIAL 640 480 500 320 240 -0.1", (419.5, 289.75)),
            ("1 RADIAL 640 480 500 320 240 -0.1 0.4", (419.6, 289.8)),
            // radial 0.996; x: 0.1992 + 2·0.01·0.02 + 0.02·(0.05 + 0.08); y: 0.0996 + 0.01·(0.05 +
            // 0.02) + 2·0.02·0.02
            ("1 OPENCV 640 480 500 400 320 240 -0.1 0.4 0.01 0.02", (421.1, 280.44)),
            // radial 0.997: x 0.1994, y 0.0997
            ("1 FULL_OPENCV 640 480 500 400 320 240 -0.1 0.4 0.01 0.02 8 0 0 0", (421.2, 280.48)),
        ] {
            let landed = cameras(text).unwrap()[&1].project(DVec3::new(0.4, 0.2, 2.0)).unwrap();
            assert!((landed - DVec2::from(expected)).length() < 1e-9, "{text}: {landed}");
        }
    }

    #[test]
    fn fisheye_models_match_their_formulas() {
        // u = 0.75, v = 1: r = 1.25, θ = 0.896055, θ² = 0.802915; along (0.6, 0.8).
        for (text, radial) in [
            ("1 SIMPLE_RADIAL_FISHEYE 640 480 100 320 240 0.1", 1.080_291_5),
            ("1 RADIAL_FISHEYE 640 480 100 320 240 0.1 -0.2", 0.951_357_1),
            // θ⁶ = 0.517617, θ⁸ = 0.415602
            ("1 OPENCV_FISHEYE 640 480 100 100 320 240 0.1 -0.2 0.3 -0.4", 0.940_401_4),
        ] {
            let landed = cameras(text).unwrap()[&1].project(DVec3::new(1.5, 2.0, 2.0)).unwrap();
            let expected = DVec2::new(320.0, 240.0) + 89.605_5 * radial * DVec2::new(0.6, 0.8);
            assert!((landed - expected).length() < 1e-3, "{text}: {landed} {expected}");
        }
    }

    #[test]
    fn camera_refusals_name_file_line_and_what_is_accepted() {
        for (text, said) in [
            (
                "# c\n1 FOV 640 480 500 500 320 240 0.9",
                "cameras.txt, line 2: the camera model `FOV` is not supported; exp",
            ),
            ("1 FULL_OPENCV 64 48 5 5 3 2 0 0 0 0 0 0.1 0 0", "cameras.txt, line 1: FULL_OPENCV with k4 = 0.1"),
            ("1 PINHOLE 640 480 500 400 320", "cameras.txt, line 1: cy_px is missing"),
            ("1 PINHOLE 640 480 -500 400 320 240", "cameras.txt, line 1: camera.fx_px = -500 is refused"),
            ("1 PINHOLE 640 480 NaN 400 320 240", "cameras.txt, line 1: fx_px is `NaN`"),
            ("1 SIMPLE_PINHOLE 640 480 500 320 240 7", "cameras.txt, line 1: there is more than expected"),
            ("1 SIMPLE_PINHOLE 6 4 5 3 2\n1 SIMPLE_PINHOLE 6 4 5 3 2", "cameras.txt, line 2: camera 1 occurs twice"),
        ] {
            let error = cameras(text).unwrap_err();
            assert!(error.starts_with(said), "{error}");
        }
    }

    #[test]
    fn images_are_world_to_camera_and_scaled() {
        // 90° about z: camera x is world −y... (x, y, z) → (−y, x, z), then + t.
        let text = "# c\n7 0.70710678 0 0 0.70710678 1 2 3 1 a b.png\n\n8 1 0 0 0 0 0 0 1 c.png\n1 2 -1 3 4 5\n";
        let read = images(text, 0.5).unwrap();
        assert_eq!((read.len(), read[0].name.as_str(), read[1].name.as_str()), (2, "a b.png", "c.png"));
        // Of two points of the second image the first is none of the model's.
        assert_eq!(
            (read[0].landmarks.len(), &read[1].landmarks[..]),
            (0, &[Landmark { number: 5, at_px: [3.0, 4.0] }][..])
        );
        let p = read[0].camera_from_world.transform_point(DVec3::new(1.0, 0.0, 0.0));
        assert!((p - DVec3::new(0.5, 2.0, 1.5)).length() < 1e-7, "{p}");
    }

    #[test]
    fn image_refusals_name_file_and_line() {
        for (text, said) in [
            ("1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b.png", "images.txt, line 2: the line after an image's pose"),
            ("1 0.5 0 0 0 0 0 0 1 a.png\n\n", "images.txt, line 1: the quaternion has length 0.5"),
            ("1 1 0 0 0 0 0 0 1\n\n", "images.txt, line 1: NAME is missing"),
            (
                "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 0 0 0 1 a.png\n",
                "images.txt, line 3: the image a.png occurs twice",
            ),
        ] {
            let error = images(text, 1.0).unwrap_err();
            assert!(error.starts_with(said), "{error}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.eNaINf#]{0,5}[ \n]){0,60}", camera in "1 (FULL_)?OPENCV( [-0-9.e]{1,9}){9,15}") {
            for text in [text, near, camera] {
                let _ = cameras(&text);
                let _ = images(&text, 1.0);
            }
        }
    }
}
