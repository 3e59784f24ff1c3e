//! The contents of a COLMAP model, common to its text and its binary form. Poses are world to
//! camera with OpenCV's axes, in an arbitrary unit.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DQuat, DVec3};

use crate::camera::Geometry;
use crate::pose::Pose;
use crate::recording::{Landmark, RecordingError, listing};
use crate::text::quoted;
use crate::tracking::records::TextError;
use crate::tracking::tum::{PoseNotes, unit_quaternion};

/// Position of a record in its file.
#[derive(Clone, Copy, Debug)]
pub enum FilePosition {
    /// Line, counted from 1.
    Line(usize),
    /// Byte, counted from 0.
    Byte(usize),
}

impl FilePosition {
    pub fn error(self, file: &Path, problem: String) -> RecordingError {
        match self {
            Self::Line(line) => TextError::line(file, line, problem).into(),
            Self::Byte(offset) => RecordingError::Bytes { file: file.to_owned(), offset, problem },
        }
    }

    fn name(self) -> String {
        match self {
            Self::Line(line) => format!("line {line}"),
            Self::Byte(offset) => format!("byte {offset}"),
        }
    }
}

/// Cameras by their numbers.
pub type Cameras = BTreeMap<u32, Geometry>;

/// Adds a camera; its number must be new.
pub fn add_camera(cameras: &mut Cameras, number: u32, geometry: Geometry) -> Result<(), String> {
    if cameras.insert(number, geometry).is_some() {
        return Err(format!("camera {number} occurs twice"));
    }
    Ok(())
}

/// A registered image.
#[derive(Debug)]
pub struct ModelImage {
    pub name: String,
    pub camera: u32,
    pub camera_from_world: Pose,
    pub landmarks: Vec<Landmark>,
    pub place: FilePosition,
}

/// The fields of an image as they are stored.
#[derive(Debug)]
pub struct ImageRecord {
    /// QW, QX, QY, QZ, TX, TY, TZ.
    pub pose: [f64; 7],
    pub camera: u32,
    pub name: String,
}

/// The names of [`ImageRecord::pose`].
pub const POSE_FIELDS: [&str; 7] = ["QW", "QX", "QY", "QZ", "TX", "TY", "TZ"];

/// Collects images and checks them.
#[derive(Debug, Default)]
pub struct ModelImages {
    images: Vec<ModelImage>,
    names: BTreeSet<String>,
    notes: PoseNotes,
}

impl ModelImages {
    /// Adds an image without landmarks. One unit of the model is `metres_per_unit`.
    pub fn add(
        &mut self,
        record: ImageRecord,
        metres_per_unit: f64,
        place: FilePosition,
    ) -> Result<&mut ModelImage, String> {
        let ImageRecord { pose: [qw, qx, qy, qz, tx, ty, tz], camera, name } = record;
        let name = listing::file_name(&name, "NAME is missing")?;
        let (rotation, norm_error) = unit_quaternion(DQuat::from_xyzw(qx, qy, qz, qw))?;
        if !self.names.insert(name.clone()) {
            return Err(format!("the image {} occurs twice", quoted(&name)));
        }
        self.notes.note(norm_error, place.name());
        let camera_from_world = Pose::new(rotation, DVec3::new(tx, ty, tz) * metres_per_unit);
        let image = ModelImage { name, camera, camera_from_world, landmarks: Vec::new(), place };
        Ok(self.images.push_mut(image))
    }

    /// The images, and the warnings about them.
    pub fn finish(self, file: &Path) -> (Vec<ModelImage>, Vec<String>) {
        let warnings = self.notes.warnings(file, self.images.len());
        (self.images, warnings)
    }
}
