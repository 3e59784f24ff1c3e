//! The binary form of a COLMAP model, which GLOMAP writes as well: `cameras.bin`, `images.bin`,
//! `points3D.bin`. Numbers are little-endian. Source: `scene/reconstruction_io_binary.cc` there.
//!
//! Not read: `rigs.bin` and `frames.bin` of COLMAP 3.12 and later, since `images.bin` still has the
//! pose of each image.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::camera_models::ColmapCameraModel;
use super::model::{Cameras, FilePosition, ImageRecord, ModelImage, ModelImages, POSE_FIELDS, add_camera};
use crate::recording::{Landmark, RecordingError};
use crate::text::{count, number, quoted};

/// Smallest camera: number, model, width, height, and the three parameters of SIMPLE_PINHOLE.
const MIN_CAMERA_BYTES: usize = 4 + 4 + 8 + 8 + 3 * 8;
/// Smallest image: number, pose, camera, the end of its name, the count of points.
const MIN_IMAGE_BYTES: usize = 4 + 7 * 8 + 4 + 1 + 8;
/// A point: two coordinates and the landmark's number.
const POINT_BYTES: usize = 3 * 8;
/// Smallest landmark: number, position, colour, error, the count of images. An image that shows it:
/// the image's number and that of the point.
const MIN_LANDMARK_BYTES: usize = 8 + 3 * 8 + 3 + 8 + 8;
const TRACK_ENTRY_BYTES: usize = 8;
/// Landmark number of points without a landmark.
const NO_LANDMARK: u64 = u64::MAX;

const REMEDY: &str = "copy the file again, or export the model again: colmap model_converter --output_type BIN";

pub fn parse_cameras(bytes: &[u8], file: &Path) -> Result<Cameras, RecordingError> {
    let mut reader = BinaryReader { bytes, at: 0, file };
    let mut cameras = Cameras::new();
    for _ in 0..reader.count("cameras", MIN_CAMERA_BYTES)? {
        let start = reader.at;
        let id = reader.u32("CAMERA_ID")?;
        let model_at = reader.at;
        let model = ColmapCameraModel::numbered(reader.u32("MODEL_ID")?.cast_signed());
        let model = model.map_err(|problem| FilePosition::Byte(model_at).error(file, problem))?;
        let size_px = [reader.u64("WIDTH")? as f64, reader.u64("HEIGHT")? as f64];
        let parameters: Vec<f64> =
            model.parameters().iter().map(|name| reader.finite(name)).collect::<Result<_, _>>()?;
        let geometry = model.geometry(size_px, &parameters);
        let added = geometry.and_then(|geometry| add_camera(&mut cameras, id, geometry));
        added.map_err(|problem| FilePosition::Byte(start).error(file, problem))?;
    }
    reader.end("camera")?;
    Ok(cameras)
}

pub fn parse_images(
    bytes: &[u8],
    file: &Path,
    metres_per_unit: f64,
) -> Result<(Vec<ModelImage>, Vec<String>), RecordingError> {
    let mut reader = BinaryReader { bytes, at: 0, file };
    let mut images = ModelImages::default();
    for _ in 0..reader.count("images", MIN_IMAGE_BYTES)? {
        let place = FilePosition::Byte(reader.at);
        let _: u32 = reader.u32("IMAGE_ID")?;
        let mut pose = [0.0; 7];
        for (field, name) in pose.iter_mut().zip(POSE_FIELDS) {
            *field = reader.finite(name)?;
        }
        let camera = reader.u32("CAMERA_ID")?;
        let name = reader.name()?;
        let added = images.add(ImageRecord { pose, camera, name }, metres_per_unit, place);
        let image = added.map_err(|problem| place.error(file, problem))?;
        for _ in 0..reader.count("points of an image", POINT_BYTES)? {
            let at_px = [reader.f64("X")? as f32, reader.f64("Y")? as f32];
            let number = reader.u64("POINT3D_ID")?;
            if number != NO_LANDMARK {
                image.landmarks.push(Landmark { number, at_px });
            }
        }
    }
    reader.end("image")?;
    Ok(images.finish(file))
}

/// The positions of a model's landmarks by their numbers.
pub fn parse_landmarks(bytes: &[u8], file: &Path) -> Result<BTreeMap<u64, DVec3>, RecordingError> {
    let mut reader = BinaryReader { bytes, at: 0, file };
    let mut landmarks = BTreeMap::new();
    for _ in 0..reader.count("landmarks", MIN_LANDMARK_BYTES)? {
        let number = reader.u64("POINT3D_ID")?;
        let position = DVec3::new(reader.finite("X")?, reader.finite("Y")?, reader.finite("Z")?);
        let _: [u8; 3] = reader.take("the colour")?;
        let _: f64 = reader.f64("ERROR")?;
        for _ in 0..reader.count("images of a landmark", TRACK_ENTRY_BYTES)? {
            let _: [u8; TRACK_ENTRY_BYTES] = reader.take("an image of a landmark")?;
        }
        landmarks.insert(number, position);
    }
    reader.end("landmark")?;
    Ok(landmarks)
}

/// Reads values in order. Errors name the file, the byte and the value.
struct BinaryReader<'a> {
    bytes: &'a [u8],
    at: usize,
    file: &'a Path,
}

impl BinaryReader<'_> {
    fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn error(&self, problem: String) -> RecordingError {
        FilePosition::Byte(self.at).error(self.file, problem)
    }

    fn take<const N: usize>(&mut self, name: &str) -> Result<[u8; N], RecordingError> {
        let Some(bytes) = self.bytes[self.at..].first_chunk() else {
            let left = self.left();
            return Err(self.error(format!("{name} needs {N} bytes, {left} are left: the file is cut off; {REMEDY}")));
        };
        self.at += N;
        Ok(*bytes)
    }

    fn u32(&mut self, name: &str) -> Result<u32, RecordingError> {
        self.take(name).map(u32::from_le_bytes)
    }

    fn u64(&mut self, name: &str) -> Result<u64, RecordingError> {
        self.take(name).map(u64::from_le_bytes)
    }

    fn f64(&mut self, name: &str) -> Result<f64, RecordingError> {
        self.take(name).map(f64::from_le_bytes)
    }

    fn finite(&mut self, name: &str) -> Result<f64, RecordingError> {
        let before = self.at;
        let value = self.f64(name)?;
        if value.is_finite() {
            return Ok(value);
        }
        let problem = format!("{name} is {}; a finite number is needed; {REMEDY}", number(value));
        Err(FilePosition::Byte(before).error(self.file, problem))
    }

    /// A number of records of at least `min_bytes` each, which must fit into the rest of the file.
    fn count(&mut self, things: &str, min_bytes: usize) -> Result<u64, RecordingError> {
        let before = self.at;
        let count = self.u64(&format!("the number of {things}"))?;
        let max_count = (self.left() / min_bytes) as u64;
        if count > max_count {
            let left = self.left();
            let problem = format!(
                "the number of {things} is {count}, and the {left} bytes left hold at most {max_count}: the file is cut off \
                 or damaged; {REMEDY}"
            );
            return Err(FilePosition::Byte(before).error(self.file, problem));
        }
        Ok(count)
    }

    /// A text that ends with a zero byte.
    fn name(&mut self) -> Result<String, RecordingError> {
        let rest = &self.bytes[self.at..];
        let Some(length) = rest.iter().position(|byte| *byte == 0) else {
            return Err(
                self.error(format!("NAME has no zero byte at its end: the file is cut off or damaged; {REMEDY}"))
            );
        };
        let name = str::from_utf8(&rest[..length]).map_err(|_| {
            let name = quoted(&String::from_utf8_lossy(&rest[..length]));
            self.error(format!("NAME is `{name}`, which is not UTF-8; rename the picture, or {REMEDY}"))
        })?;
        self.at += length + 1;
        Ok(name.to_owned())
    }

    /// Checks that the file ends.
    fn end(&self, thing: &str) -> Result<(), RecordingError> {
        match self.left() {
            0 => Ok(()),
            left => Err(self.error(format!("after the last {thing}, {} follow; {REMEDY}", count(left, "byte")))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::colmap::text;
    use proptest::prelude::*;

    /// A binary file from its fields.
    #[derive(Clone, Default)]
    struct Written(Vec<u8>);

    impl Written {
        fn u32(mut self, value: u32) -> Self {
            self.0.extend(value.to_le_bytes());
            self
        }

        fn u64(mut self, value: u64) -> Self {
            self.0.extend(value.to_le_bytes());
            self
        }

        fn numbers(mut self, values: &[f64]) -> Self {
            self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            self
        }

        fn name(mut self, name: &[u8]) -> Self {
            self.0.extend(name);
            self.0.push(0);
            self
        }

        /// An image without points.
        fn image(self, pose: [f64; 7], name: &[u8]) -> Self {
            self.u32(1).numbers(&pose).u32(1).name(name).u64(0)
        }
    }

    /// A landmark with `images` images.
    fn landmark(number: u64, at: [f64; 3], images: u64) -> Written {
        let Written(mut bytes) = Written::default().u64(number).numbers(&at);
        bytes.extend([9, 8, 7]);
        let start = Written(bytes).numbers(&[0.5]).u64(images);
        (0..images).fold(start, |written, _| written.u32(1).u32(2))
    }

    #[test]
    fn landmarks_are_read_and_damaged_ones_refused() {
        let file = Path::new("points3D.bin");
        let two = [landmark(7, [1.0, 2.0, 3.0], 2), landmark(9, [-1.0, 0.5, 4.0], 0)];
        let bytes: Vec<u8> = Written::default().u64(2).0.into_iter().chain(two.into_iter().flat_map(|w| w.0)).collect();
        let read = parse_landmarks(&bytes, file).unwrap();
        assert_eq!(read, [(7, DVec3::new(1.0, 2.0, 3.0)), (9, DVec3::new(-1.0, 0.5, 4.0))].into());
        for end in 0..bytes.len() {
            assert!(parse_landmarks(&bytes[..end], file).is_err(), "{end}");
        }
        let infinite = [Written::default().u64(1).0, landmark(7, [1.0, f64::INFINITY, 3.0], 0).0].concat();
        let error = parse_landmarks(&infinite, file).unwrap_err().to_string();
        assert!(error.starts_with("points3D.bin, byte 24: Y is inf"), "{error}");
    }

    const UNTURNED: [f64; 7] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

    fn pinhole() -> Written {
        Written::default().u64(1).u32(1).u32(1).u64(640).u64(480).numbers(&[500.0, 400.0, 320.0, 240.0])
    }

    fn cameras(Written(bytes): &Written) -> Result<Cameras, String> {
        parse_cameras(bytes, Path::new("cameras.bin")).map_err(|e| e.to_string())
    }

    fn images(Written(bytes): &Written) -> Result<Vec<ModelImage>, String> {
        parse_images(bytes, Path::new("images.bin"), 0.5).map(|r| r.0).map_err(|e| e.to_string())
    }

    #[test]
    fn text_and_binary_form_of_a_model_are_the_same() {
        let of_text = |text: &str| text::parse_cameras(text, Path::new("cameras.txt")).unwrap();
        assert_eq!(cameras(&pinhole()).unwrap(), of_text("1 PINHOLE 640 480 500 400 320 240"));
        let radial = Written::default().u64(1).u32(7).u32(3).u64(64).u64(48).numbers(&[50.0, 32.0, 24.0, -0.1, 0.4]);
        assert_eq!(cameras(&radial).unwrap(), of_text("7 RADIAL 64 48 50 32 24 -0.1 0.4"));

        let points = Written::default().u64(1).u32(7).numbers(&[0.6, 0.0, 0.0, 0.8, 1.0, 2.0, 3.0]).u32(9);
        let points = points.name(b"a b.png").u64(2);
        let points = points.numbers(&[1.5, 2.0]).u64(u64::MAX).numbers(&[3.0, 4.0]).u64(5);
        let read = images(&points).unwrap();
        let line = "7 0.6 0 0 0.8 1 2 3 9 a b.png\n1.5 2 -1 3 4 5\n";
        let (expected, _) = text::parse_images(line, Path::new("images.txt"), 0.5).unwrap();
        let parts =
            |image: &ModelImage| (image.name.clone(), image.camera, image.camera_from_world, image.landmarks.clone());
        assert_eq!(parts(&read[0]), parts(&expected[0]));
        assert_eq!(read[0].landmarks, [Landmark { number: 5, at_px: [3.0, 4.0] }]);
    }

    #[test]
    fn camera_refusals_name_file_byte_and_remedy() {
        let with_model = |model: u32| Written::default().u64(1).u32(1).u32(model).u64(6).u64(4).numbers(&[1.0; 16]);
        let cut = |bytes: usize| Written(pinhole().0[..bytes].to_vec());
        let not_finite = Written::default().u64(1).u32(1).u32(0).u64(6).u64(4).numbers(&[5.0, f64::NAN, 2.0]);
        let mut twice = pinhole().u32(1).u32(0).u64(6).u64(4).numbers(&[5.0, 3.0, 2.0]);
        twice.0[0] = 2;
        for (file, said) in [
            (with_model(18), "cameras.bin, byte 12: the camera model has the number 18; expected 0 to 17"),
            (with_model(u32::MAX), "cameras.bin, byte 12: the camera model has the number -1"),
            (
                with_model(11),
                "cameras.bin, byte 12: the camera model `RAD_TAN_THIN_PRISM_FISHEYE` is not supported; exp",
            ),
            (cut(5), "cameras.bin, byte 0: the number of cameras needs 8 bytes, 5 are left: the file is cut off; copy"),
            (
                cut(30),
                "cameras.bin, byte 0: the number of cameras is 1, and the 22 bytes left hold at most 0: the file",
            ),
            (
                cut(60),
                "cameras.bin, byte 56: cy_px needs 8 bytes, 4 are left: the file is cut off; copy the file again",
            ),
            (not_finite, "cameras.bin, byte 40: cx_px is NaN; a finite number is needed"),
            (Written::default().u64(1 << 60), "cameras.bin, byte 0: the number of cameras is 1152921504606846976, and"),
            (pinhole().u32(0), "cameras.bin, byte 64: after the last camera, 4 bytes follow"),
            (twice, "cameras.bin, byte 64: camera 1 occurs twice"),
        ] {
            let error = cameras(&file).unwrap_err();
            assert!(error.starts_with(said), "{error}");
        }
        assert!(cameras(&with_model(12)).unwrap_err().contains("colmap image_undistorter"));
    }

    #[test]
    fn image_refusals_name_file_and_byte() {
        let one = |pose, name: &[u8]| Written::default().u64(1).image(pose, name);
        let infinite = [1.0, 0.0, 0.0, 0.0, 0.0, f64::INFINITY, 0.0];
        let mut unended = one(UNTURNED, &[b'a'; 40]);
        unended.0.truncate(110);
        let mut points = one(UNTURNED, b"a.png");
        points.0.truncate(78);
        let twice = Written::default().u64(2).image(UNTURNED, b"a.png").image(UNTURNED, b"a.png");
        for (file, said) in [
            (one(infinite, b"a.png"), "images.bin, byte 52: TY is inf; a finite number is needed"),
            (one([0.5; 7].map(|v| v * 0.5), b"a.png"), "images.bin, byte 8: the quaternion has length 0.5"),
            (one(UNTURNED, b""), "images.bin, byte 8: NAME is missing"),
            (one(UNTURNED, &[0xff]), "images.bin, byte 72: NAME is `"),
            (one(UNTURNED, &[b'a'; 5000]), "images.bin, byte 8: the file's name is `aaa"),
            (unended, "images.bin, byte 72: NAME has no zero byte at its end"),
            (points.clone().u64(9), "images.bin, byte 78: the number of points of an image is 9, and the 0 bytes left"),
            (twice, "images.bin, byte 86: the image a.png occurs twice"),
        ] {
            let error = images(&file).unwrap_err();
            assert!(error.starts_with(said), "{error}");
        }
        assert_eq!(images(&points.u64(0)).unwrap().len(), 1);
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in 0usize..100, with in any::<u8>(), cut in 0usize..200, bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let image = Written::default().u64(1).image(UNTURNED, b"a.png");
            for Written(mut file) in [pinhole(), image, Written(bytes)] {
                if let Some(byte) = file.get_mut(at) {
                    *byte = with;
                }
                file.truncate(cut);
                let _ = (cameras(&Written(file.clone())), images(&Written(file)));
            }
        }
    }
}
