//! A folder as laboratories keep it: pictures in `rgb/` (`color/`, `images/`), poses in `poses.txt`
//! (`traj.txt`; a pose a line) or in `pose/` (`poses/`; a file a pose), a camera matrix in `K.txt`
//! (`intrinsics.txt`, `intrinsic/intrinsic_color.txt`), optionally `depth/`. ScanNet's exported
//! scans have this form.
//!
//! A pose is a 3×4 or 4×4 matrix, row by row: camera to world with OpenCV's axes, metres, unless a
//! comment at the start of its file names another convention. With depth the convention is checked:
//! depth of one frame must agree with that of others ([`pose_convention`]). Pixel centres of the
//! camera matrix are at whole numbers, as OpenCV counts. Depth is in millimetres. There are no
//! times.

mod matrices;
mod pose_convention;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::depth::{DepthEncoding, DepthFiles};
use super::parts::{NOMINAL_FPS, Parts, Pictures, RecordingFormat, folder_of, pinhole_geometry, track_from};
use super::{OpenOptions, RecordingError, listing};
use crate::camera::Geometry;
use crate::depth::{DepthCamera, is_same_aspect};
use crate::pose::Pose;
use crate::source::depth_map;
use crate::source::still;
use crate::text::count;
use crate::tracking::records;
use crate::tracking::tum::PoseNotes;
use glam::{DQuat, DVec3};
use matrices::{PoseLine, parse_camera, parse_pose_file, parse_pose_list};
use pose_convention::{PoseConvention, PosedDepth, check};

const PICTURE_FOLDERS: [&str; 3] = ["rgb", "color", "images"];
const POSE_LISTS: [&str; 2] = ["poses.txt", "traj.txt"];
const POSE_FOLDERS: [&str; 2] = ["pose", "poses"];
const CAMERA_FILES: [&str; 4] = ["K.txt", "intrinsics.txt", "intrinsic.txt", "intrinsic/intrinsic_color.txt"];
const DEPTH_CAMERA_FILE: &str = "intrinsic/intrinsic_depth.txt";
const DEPTH_FOLDER: &str = "depth";
const DEPTH_EXTENSIONS: [&str; 3] = ["png", "exr", "npy"];
const CODES_PER_METRE: f64 = 1000.0;

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "plain folder",
    has_times: false,
    is_metric: false,
    find: |path| {
        let names = POSE_LISTS.iter().chain(&CAMERA_FILES);
        let folder = if path.is_dir() {
            path.to_owned()
        } else {
            names.clone().any(|name| path.ends_with(name)).then(|| folder_of(path))?
        };
        let has_poses = POSE_LISTS.iter().chain(&POSE_FOLDERS).any(|name| folder.join(name).exists());
        (has_poses && first_existing(&folder, &PICTURE_FOLDERS).is_some()).then_some(folder)
    },
    open: |folder, _, options| open(folder, options),
};

fn first_existing(folder: &Path, names: &[&str]) -> Option<PathBuf> {
    names.iter().map(|name| folder.join(name)).find(|path| path.exists())
}

fn open(folder: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let missing = |names: &[&str]| RecordingError::content(folder, format!("holds none of {}", names.join(", ")));
    let pictures_folder = first_existing(folder, &PICTURE_FOLDERS).ok_or_else(|| missing(&PICTURE_FOLDERS))?;
    let pictures = listing::pictures_in(&pictures_folder)?;
    if pictures.is_empty() {
        return Err(RecordingError::content(&pictures_folder, "holds no pictures"));
    }
    let PoseFiles { files, of_picture, stated } = poses(folder, &pictures)?;
    let (geometry, camera_file) = camera(folder, &pictures)?;
    let mut warnings = Vec::new();
    if geometry.is_none() {
        let names = CAMERA_FILES.join(", ");
        warnings.push(format!("{}: holds none of {names}: the camera must come from a profile", folder.display()));
    }
    let depth_files = match folder.join(DEPTH_FOLDER) {
        depth if depth.is_dir() => matched(&pictures, &depth_pictures(&depth)?, &depth, &pictures_folder)?,
        _ => Vec::new(),
    };
    let depth_camera = depth_camera(folder, &depth_files)?;
    let named = files.first().map_or(folder, PathBuf::as_path);
    let views = depth_views(&of_picture, &depth_files, geometry.as_ref(), depth_camera.as_ref());
    let (convention, assumed) =
        check(stated, &views, options.metres_per_unit).map_err(|problem| RecordingError::content(named, problem))?;
    warnings.extend(assumed.map(|assumed| format!("{}: {assumed}", named.display())));

    let (mut poses, mut notes) = (Vec::new(), PoseNotes::default());
    let mut without_pose = 0;
    for (i, line) in of_picture.iter().enumerate() {
        match line {
            Some(PoseLine { matrix: Some(matrix), .. }) => {
                let Pose { rotation, translation_m } = convention.camera_from_world(matrix);
                let pose = Pose::new(rotation, translation_m * options.metres_per_unit);
                poses.push((i as f64 / NOMINAL_FPS, pose));
            }
            Some(PoseLine { place, .. }) => notes.count_lost(place.clone()),
            None => without_pose += 1,
        }
    }
    warnings.extend(notes.warnings(named, poses.len()));
    if without_pose > 0 {
        warnings.push(format!("no pose file for {without_pose} of {}", count(pictures.len(), "picture")));
    }
    warnings.push(format!(
        "a plain folder has no timestamps: {NOMINAL_FPS} frames a second are assumed, and pixel centres at whole \
         numbers in its camera matrix"
    ));
    let by_time = depth_files.into_iter().enumerate().filter_map(|(i, file)| Some((i as f64 / NOMINAL_FPS, file?)));
    let by_time: Vec<(f64, PathBuf)> = by_time.collect();
    let times_s = (0..pictures.len()).map(|i| i as f64 / NOMINAL_FPS).collect();
    let mut parts = Parts::new(folder, Pictures::Stills(pictures), times_s);
    parts.track = track_from(poses, options.max_gap_s.or(Some(1.5 / NOMINAL_FPS)), named)?;
    parts.geometries = vec![geometry; parts.timestamps_s.len()];
    if !by_time.is_empty() {
        let camera = depth_camera.map(|camera| DepthCamera::new(camera, Pose::new(DQuat::IDENTITY, DVec3::ZERO)));
        let unit_advice = Some("describe the folder by a recording.toml");
        let stored = DepthEncoding { camera, unit_advice, ..DepthEncoding::plain(CODES_PER_METRE) };
        parts.depth = Some(DepthFiles { by_time, stored });
    }
    parts.description_files = files.into_iter().chain(camera_file).collect();
    parts.warnings = warnings;
    Ok(parts)
}

/// The poses, one per picture.
struct PoseFiles {
    files: Vec<PathBuf>,
    of_picture: Vec<Option<PoseLine>>,
    /// The convention in a comment of the first file.
    stated: Option<PoseConvention>,
}

fn poses(folder: &Path, pictures: &[PathBuf]) -> Result<PoseFiles, RecordingError> {
    if let Some(list) = first_existing(folder, &POSE_LISTS) {
        let text = records::read(&list)?;
        let lines = parse_pose_list(&text, &list)?;
        if lines.len() != pictures.len() {
            let problem = format!(
                "holds {}, beside {}; a pose for each is expected, in the order of the pictures' names: remove the \
                 surplus, or keep the poses in pose/ by the pictures' numbers",
                count(lines.len(), "pose"),
                count(pictures.len(), "picture")
            );
            return Err(RecordingError::content(&list, problem));
        }
        let stated = PoseConvention::stated(&text).map_err(|problem| RecordingError::content(&list, problem))?;
        return Ok(PoseFiles { files: vec![list], of_picture: lines.into_iter().map(Some).collect(), stated });
    }
    let pose_folder = first_existing(folder, &POSE_FOLDERS)
        .ok_or_else(|| RecordingError::content(folder, "holds neither poses.txt nor pose/"))?;
    let files = files_with(&pose_folder, &["txt"])?;
    let pictures_folder = pictures.first().map_or_else(|| folder.to_owned(), |picture| folder_of(picture));
    let matched = matched(pictures, &files, &pose_folder, &pictures_folder)?;
    let (mut of_picture, mut stated, mut read) = (Vec::new(), None, Vec::new());
    for file in matched {
        let Some(file) = file else {
            of_picture.push(None);
            continue;
        };
        let text = records::read(&file)?;
        if read.is_empty() {
            stated = PoseConvention::stated(&text).map_err(|problem| RecordingError::content(&file, problem))?;
        }
        of_picture.push(Some(parse_pose_file(&text, &file)?));
        read.push(file);
    }
    Ok(PoseFiles { files: read, of_picture, stated })
}

/// The camera matrix for the size of the first readable picture, and its file.
fn camera(folder: &Path, pictures: &[PathBuf]) -> Result<(Option<Geometry>, Option<PathBuf>), RecordingError> {
    let Some(file) = first_existing(folder, &CAMERA_FILES) else { return Ok((None, None)) };
    let intrinsics = parse_camera(&records::read_description(&file)?, &file)?;
    let Some(header) = pictures.iter().find_map(|picture| still::read_header(picture).ok()) else {
        return Ok((None, Some(file)));
    };
    Ok((Some(geometry(intrinsics, header.width, header.height, &file)?), Some(file)))
}

/// The geometry of fx, fy, cx, cy whose pixel centres are at whole numbers.
fn geometry([fx, fy, cx, cy]: [f64; 4], width: u32, height: u32, file: &Path) -> Result<Geometry, RecordingError> {
    pinhole_geometry([fx, fy, cx + 0.5, cy + 0.5], width, height).map_err(|error| RecordingError::content(file, error))
}

/// The camera of depth with a matrix of its own; `None` if depth has the pictures' view.
fn depth_camera(folder: &Path, depth: &[Option<PathBuf>]) -> Result<Option<Geometry>, RecordingError> {
    let file = folder.join(DEPTH_CAMERA_FILE);
    let header = depth.iter().flatten().find_map(|depth| depth_map::read_header(depth).ok());
    let Some(header) = header.filter(|_| file.is_file()) else { return Ok(None) };
    let intrinsics = parse_camera(&records::read_description(&file)?, &file)?;
    geometry(intrinsics, header.width, header.height, &file).map(Some)
}

fn files_with(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>, RecordingError> {
    let failed = |source| crate::source::SourceError::Read { file: folder.to_owned(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let file = entry.map_err(failed)?.path();
        let extension = file.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if extensions.contains(&extension.as_str()) {
            files.push(file);
        }
    }
    files.sort_by(|a, b| listing::natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

fn depth_pictures(folder: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    files_with(folder, &DEPTH_EXTENSIONS)
}

/// The last number in a file's name.
fn number_of(file: &Path) -> Option<u64> {
    let stem = file.file_stem()?.to_string_lossy();
    let digits = stem.trim_end_matches(|c: char| !c.is_ascii_digit());
    let start = digits.rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
    digits.get(start..)?.parse().ok()
}

/// Files by their numbers; `None` if any has none, or two have the same.
fn by_number(files: &[PathBuf]) -> Option<BTreeMap<u64, &PathBuf>> {
    let numbered: BTreeMap<u64, &PathBuf> =
        files.iter().map(|file| Some((number_of(file)?, file))).collect::<Option<_>>()?;
    (numbered.len() == files.len()).then_some(numbered)
}

/// The file of each picture: by the last number in the names, or in order if not all have one.
fn matched(
    pictures: &[PathBuf],
    files: &[PathBuf],
    folder: &Path,
    pictures_folder: &Path,
) -> Result<Vec<Option<PathBuf>>, RecordingError> {
    if let Some((numbers, files)) = by_number(pictures).zip(by_number(files)) {
        let shared = numbers.keys().filter(|number| files.contains_key(number)).count();
        if shared > 0 {
            let file = |picture: &PathBuf| files.get(&number_of(picture)?).map(|file| (*file).clone());
            return Ok(pictures.iter().map(file).collect());
        }
    }
    if files.len() == pictures.len() {
        return Ok(files.iter().cloned().map(Some).collect());
    }
    let problem = format!(
        "holds {}, {} {}; name them by the pictures' numbers, or keep one for each picture",
        count(files.len(), "file"),
        pictures_folder.display(),
        count(pictures.len(), "picture")
    );
    Err(RecordingError::content(folder, problem))
}

/// Largest number of frames whose depth is compared.
const MAX_DEPTH_VIEWS: usize = 12;

/// Depth and matrices of a few frames, evenly spread over those that have both.
fn depth_views(
    poses: &[Option<PoseLine>],
    depth: &[Option<PathBuf>],
    geometry: Option<&Geometry>,
    depth_camera: Option<&Geometry>,
) -> Vec<PosedDepth> {
    let candidates: Vec<_> =
        poses.iter().zip(depth).filter_map(|(pose, depth)| Some((pose.as_ref()?.matrix?, depth.as_ref()?))).collect();
    let picked = candidates.len().min(MAX_DEPTH_VIEWS);
    let view = |i: usize| {
        let (matrix, file) = candidates.get((2 * i + 1) * candidates.len() / (2 * picked))?;
        let map = depth_map::read(file, CODES_PER_METRE, 0.0).ok()?;
        let size = (map.width, map.height);
        let fits = |camera: &&Geometry| is_same_aspect(size, (camera.intrinsics.width_px, camera.intrinsics.height_px));
        let camera = depth_camera.or(geometry).filter(fits)?.resized(map.width, map.height);
        Some(PosedDepth { matrix: *matrix, camera, map })
    };
    (0..picked).filter_map(view).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_matched_by_the_last_number_or_by_order() {
        let files = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let pairs_of = |pictures: &[&str], others: &[&str]| {
            matched(&files(pictures), &files(others), Path::new("pose"), Path::new("rgb")).map(|pairs| {
                pairs.into_iter().map(|file| file.map(|file| file.display().to_string())).collect::<Vec<_>>()
            })
        };
        let some = |names: &[&str]| names.iter().map(|name| Some((*name).to_owned())).collect::<Vec<_>>();
        assert_eq!(
            pairs_of(&["f-000009.color.jpg", "f-000010.color.jpg"], &["9.txt", "10.txt"]).unwrap(),
            some(&["9.txt", "10.txt"])
        );
        assert_eq!(
            pairs_of(&["1.jpg", "2.jpg"], &["pose_0002.txt"]).unwrap(),
            [None, Some("pose_0002.txt".to_owned())]
        );
        assert_eq!(pairs_of(&["a.jpg", "b.jpg"], &["x.txt", "y.txt"]).unwrap(), some(&["x.txt", "y.txt"]));
        let error = pairs_of(&["a.jpg", "b.jpg"], &["x.txt"]).unwrap_err().to_string();
        assert!(error.starts_with("pose: holds 1 file, rgb 2 pictures; name them by"), "{error}");
    }
}
