//! A COLMAP model, as text or binary: cameras, and images with poses. Poses are world to camera
//! with OpenCV's axes, quaternions w x y z, an arbitrary unit; pixel centres are at +0.5 already.
//! Source: <https://colmap.github.io/format.html>.

mod binary;
mod camera_models;
mod model;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::parts::{NOMINAL_FPS, Parts, Pictures, RecordingFormat, folder_of, track_from};
use super::{OpenOptions, RecordingError, listing};
use crate::camera::Geometry;
use crate::source::{file, unsupported};
use crate::text::quoted;
use crate::tracking::records::{self, TextError};
pub use camera_models::camera_parameters;
use model::Cameras;
pub use model::ModelImage;

/// Names of the files with the cameras and the images, as binary and as text. In a folder with
/// both forms the binary one is read, as COLMAP does.
const FORMS: [[&str; 2]; 2] = [["cameras.bin", "images.bin"], ["cameras.txt", "images.txt"]];

/// Name of the file with the landmarks' positions, as binary.
const POINTS_NAME: &str = "points3D.bin";

/// Locations of a model in a folder.
const MODEL_FOLDERS: [&str; 4] = ["", "colmap", "sparse/0", "sparse"];

pub static FORMAT: RecordingFormat = RecordingFormat { name: "COLMAP", has_times: false, is_metric: false, find, open };

/// The file with the images of the model at a path. A named file decides between the two forms.
fn find(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        let [_, images] = FORMS.into_iter().find(|names| names.iter().any(|name| path.ends_with(name)))?;
        return Some(folder_of(path).join(images));
    }
    let folders = MODEL_FOLDERS.iter().map(|at| path.join(at));
    folders.into_iter().find_map(|folder| {
        let is_complete = |names: &&[&str; 2]| names.iter().all(|name| folder.join(name).exists());
        let has_images = |[_, images]: &&[&str; 2]| folder.join(images).exists();
        let [_, images] = FORMS.iter().find(is_complete).or_else(|| FORMS.iter().find(has_images))?;
        Some(folder.join(images))
    })
}

/// A model with its landmarks, in its own arbitrary unit.
#[derive(Debug)]
pub struct ColmapModel {
    pub cameras: BTreeMap<u32, Geometry>,
    pub images: Vec<ModelImage>,
    /// Positions of the landmarks by their numbers.
    pub landmarks: BTreeMap<u64, DVec3>,
}

impl ColmapModel {
    /// Reads the binary files of a model's folder.
    pub fn read_binary(folder: &Path) -> Result<Self, RecordingError> {
        let [_, images_name] = FORMS[0];
        let ModelContents { cameras, images, .. } = read_model(&folder.join(images_name), 1.0)?;
        let file = folder.join(POINTS_NAME);
        let bytes =
            file::read(&file, file::MAX_TEXT_BYTES).map_err(|source| TextError::Read { file: file.clone(), source })?;
        Ok(Self { cameras, images, landmarks: binary::parse_landmarks(&bytes, &file)? })
    }
}

/// The contents of a model, and the file of its cameras.
struct ModelContents {
    cameras_file: PathBuf,
    cameras: Cameras,
    images: Vec<ModelImage>,
    warnings: Vec<String>,
}

/// Reads the model of a file with images and of the cameras beside it.
fn read_model(images_file: &Path, metres_per_unit: f64) -> Result<ModelContents, RecordingError> {
    let is_binary = images_file.extension().is_some_and(|ending| ending == "bin");
    let [cameras_name, _] = if is_binary { FORMS[0] } else { FORMS[1] };
    let cameras_file = images_file.with_file_name(cameras_name);
    let bytes = |file: &Path| {
        file::read(file, file::MAX_TEXT_BYTES).map_err(|source| TextError::Read { file: file.to_owned(), source })
    };
    let (cameras, (images, warnings)) = if is_binary {
        let cameras = binary::parse_cameras(&bytes(&cameras_file)?, &cameras_file)?;
        (cameras, binary::parse_images(&bytes(images_file)?, images_file, metres_per_unit)?)
    } else {
        let cameras = text::parse_cameras(&records::read(&cameras_file)?, &cameras_file)?;
        (cameras, text::parse_images(&records::read(images_file)?, images_file, metres_per_unit)?)
    };
    Ok(ModelContents { cameras_file, cameras, images, warnings })
}

/// Opens the model of the file `images_file`. `path` is the user's argument: its folder, a parent,
/// or one of the model's files.
fn open(images_file: &Path, path: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let model_folder = folder_of(images_file);
    let path = if path.is_dir() { path } else { &model_folder };
    let ModelContents { cameras_file, cameras, images, warnings } = read_model(images_file, options.metres_per_unit)?;
    let folder = image_folder(images_file, path, &images)?;
    let registered: BTreeMap<&str, &ModelImage> = images.iter().map(|image| (image.name.as_str(), image)).collect();
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
            let cameras = cameras_file.file_name().unwrap_or_default().display();
            let problem = format!("{} names camera {}, which {cameras} does not have", quoted(name), image.camera);
            image.place.error(images_file, problem)
        })?;
        poses.push((i as f64 / NOMINAL_FPS, image.camera_from_world));
        geometries.push(Some(camera.clone()));
        landmarks.push(image.landmarks.clone());
    }
    let files = names.iter().map(|name| folder.join(name)).collect();
    let mut parts = Parts::new(path, Pictures::Stills(files), timestamps_s);
    // An unregistered image has no pose; its neighbours do not determine it.
    parts.track = track_from(poses, options.max_gap_s.or(Some(1.5 / NOMINAL_FPS)), images_file)?;
    parts.geometries = geometries;
    parts.landmarks = landmarks;
    parts.description_files = vec![cameras_file, images_file.to_owned()];
    parts.warnings.push(format!("COLMAP stores no timestamps: {NOMINAL_FPS} frames a second are assumed"));
    parts.warnings.extend(warnings);
    parts.warnings.extend(unsupported::unread_warning(&unread));
    Ok(parts)
}

/// The folder that the images' names are relative to.
fn image_folder(images_file: &Path, path: &Path, images: &[ModelImage]) -> Result<PathBuf, RecordingError> {
    let Some(first) = images.first() else {
        return Err(RecordingError::content(images_file, "the model has no images"));
    };
    let model = folder_of(images_file);
    let candidates = [
        path.join("images"),
        model.join("images"),
        model.join("../images"),
        model.join("../../images"),
        path.to_owned(),
    ];
    candidates.iter().find(|folder| folder.join(&first.name).is_file()).cloned().ok_or_else(|| {
        let looked = candidates.iter().map(|c| c.display().to_string()).collect::<Vec<_>>().join(", ");
        RecordingError::content(images_file, format!("{} is in none of {looked}", quoted(&first.name)))
    })
}

/// The frames: the model's images and further ones in the same folders, which have no pose, in the
/// order of their names. Also returns the pictures there that cannot be decoded.
fn frame_names(
    folder: &Path,
    registered: &BTreeMap<&str, &ModelImage>,
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
