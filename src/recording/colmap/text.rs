//! The text form of a COLMAP model: `cameras.txt`, `images.txt`. Source:
//! <https://colmap.github.io/format.html#text-format>.

use std::path::Path;

use super::camera_models::ColmapCameraModel;
use super::model::{Cameras, FilePosition, ImageRecord, ModelImage, ModelImages, POSE_FIELDS, add_camera};
use crate::camera::Geometry;
use crate::recording::{Landmark, RecordingError};
use crate::text::quoted;
use crate::tracking::records;

pub fn parse_cameras(text: &str, file: &Path) -> Result<Cameras, RecordingError> {
    let mut cameras = Cameras::new();
    for (line, record) in records::records(text) {
        let added = parse_camera(record).and_then(|(id, geometry)| add_camera(&mut cameras, id, geometry));
        added.map_err(|problem| FilePosition::Line(line).error(file, problem))?;
    }
    Ok(cameras)
}

fn parse_camera(mut record: &str) -> Result<(u32, Geometry), String> {
    let id = parse_u32(&mut record, "CAMERA_ID")?;
    let model = records::word(&mut record);
    let width = records::number(&mut record, "WIDTH")?;
    let height = records::number(&mut record, "HEIGHT")?;
    let model = ColmapCameraModel::named(model)?;
    let parameters: Vec<f64> =
        model.parameters().iter().map(|name| records::number(&mut record, name)).collect::<Result<_, _>>()?;
    records::end(record)?;
    Ok((id, model.geometry([width, height], &parameters)?))
}

/// Two lines per image: the pose, then the observed points, of which there may be none.
pub fn parse_images(
    text: &str,
    file: &Path,
    metres_per_unit: f64,
) -> Result<(Vec<ModelImage>, Vec<String>), RecordingError> {
    let mut images = ModelImages::default();
    let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    while let Some((line, record)) = lines.next() {
        if record.is_empty() || record.starts_with('#') {
            continue;
        }
        let place = FilePosition::Line(line);
        let added = parse_image(record).and_then(|record| images.add(record, metres_per_unit, place));
        let image = added.map_err(|problem| place.error(file, problem))?;
        let (line, points) = lines.next().unwrap_or_default();
        image.landmarks = landmarks(points).ok_or_else(|| {
            let problem = "the line after an image's pose must list its points (X Y POINT3D_ID each), or be blank";
            FilePosition::Line(line).error(file, problem.to_owned())
        })?;
    }
    Ok(images.finish(file))
}

fn parse_image(mut rest: &str) -> Result<ImageRecord, String> {
    let _: u32 = parse_u32(&mut rest, "IMAGE_ID")?;
    let mut pose = [0.0; 7];
    for (field, name) in pose.iter_mut().zip(POSE_FIELDS) {
        *field = records::number(&mut rest, name)?;
    }
    let camera = parse_u32(&mut rest, "CAMERA_ID")?;
    Ok(ImageRecord { pose, camera, name: rest.to_owned() })
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

fn parse_u32(rest: &mut &str, name: &str) -> Result<u32, String> {
    let word = records::word(rest);
    word.parse().map_err(|_| format!("{name} is `{}`; a whole number is needed", quoted(word)))
}
#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};
    use proptest::prelude::*;

    fn cameras(text: &str) -> Result<Cameras, String> {
        parse_cameras(text, Path::new("cameras.txt")).map_err(|e| e.to_string())
    }

    fn images(text: &str, metres_per_unit: f64) -> Result<Vec<ModelImage>, String> {
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
            // denominator 1 + 0.005 + 0.001 − 0.00025; tangential 0.003 and 0.0015
            (
                "1 FULL_OPENCV 640 480 500 400 320 240 -0.1 0.4 0.01 0.02 8 0.1 0.4 -2",
                (320.0 + 500.0 * (0.1994 / 1.00575 + 0.003), 240.0 + 400.0 * (0.0997 / 1.00575 + 0.0015)),
            ),
            // r = 0.2236068, 2 tan 0.25 = 0.5106838: atan(0.1141924)/0.5 = 0.2273996. The direction
            // is (2, 1)/√5.
            ("1 FOV 640 480 500 400 320 240 0.5", (421.696_258_85, 280.678_503_54)),
        ] {
            let landed = cameras(text).unwrap()[&1].project(DVec3::new(0.4, 0.2, 2.0)).unwrap();
            assert!((landed - DVec2::from(expected)).length() < 1e-7, "{text}: {landed}");
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
            ("1 THIN_PRISM_FISHEYE 640 480 100 100 320 240 0.1 -0.2 0 0 0.3 -0.4 0 0", 0.940_401_4),
            ("1 SIMPLE_FISHEYE 640 480 100 320 240", 1.0),
            ("1 FISHEYE 640 480 100 100 320 240", 1.0),
        ] {
            let landed = cameras(text).unwrap()[&1].project(DVec3::new(1.5, 2.0, 2.0)).unwrap();
            let expected = DVec2::new(320.0, 240.0) + 89.605_5 * radial * DVec2::new(0.6, 0.8);
            assert!((landed - expected).length() < 1e-3, "{text}: {landed} {expected}");
        }
    }

    #[test]
    fn camera_errors_name_file_line_and_accepted_values() {
        for (text, said) in [
            (
                "# c\n1 EUCM 640 480 500 500 320 240 0.9 1",
                "cameras.txt, line 2: the camera model `EUCM` is not supported; exp",
            ),
            ("1 FOV 64 48 5 5 3 2 -0.1", "cameras.txt, line 1: camera.distortion.omega = -0.1: expected"),
            ("1 PINHOLE 640 480 500 400 320", "cameras.txt, line 1: cy_px is missing"),
            ("1 PINHOLE 640 480 -500 400 320 240", "cameras.txt, line 1: camera.fx_px = -500: expected"),
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
