//! Recordings by photogrammetry programs: pictures that a file names by labels, each with a pose
//! and a camera, without times.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::parts::{NOMINAL_FPS, Parts, Pictures, folder_of, track_from};
use super::{OpenOptions, RecordingError, listing};
use crate::camera::Geometry;
use crate::pose::Pose;
use crate::source::{still_format, unsupported};
use crate::text::quoted;
use crate::tracking::records::TextError;

/// A picture of the program's file, with data of the format.
#[derive(Debug)]
pub struct LabelledPicture<T> {
    /// The picture's file name, also without its extension, or with folders.
    pub label: String,
    /// Line in the file, from 1.
    pub line: usize,
    pub data: T,
}

/// A frame with the data of its label; `None` for other pictures in the same folder.
#[derive(Debug)]
pub struct LocatedPicture<T> {
    pub file: PathBuf,
    pub data: Option<T>,
}

/// A frame with its pose and camera.
#[derive(Debug)]
pub struct PosedPicture {
    pub file: PathBuf,
    pub camera_from_world: Option<Pose>,
    pub geometry: Option<Geometry>,
}

/// Folders, relative to that of the program's file, in which the pictures may be.
const PICTURE_FOLDERS: [&str; 6] = ["", "images", "rgb", "photos", "..", "../images"];

/// A label as a relative path: programs on Windows write backslashes.
fn relative(label: &str) -> PathBuf {
    let label = label.replace('\\', "/");
    let is_absolute = label.starts_with('/') || label.get(1..3) == Some(":/");
    // The folders of another machine.
    if is_absolute { label.rsplit('/').next().unwrap_or_default().into() } else { label.into() }
}

/// The picture of a label in a folder: with its folders, or by its name alone.
fn picture_of(folder: &Path, label: &Path) -> Option<PathBuf> {
    let name = label.file_name()?;
    [label, Path::new(name)].into_iter().find_map(|label| {
        let whole = folder.join(label);
        if whole.is_file() {
            return Some(whole);
        }
        still_format::with_omitted_extension(folder, &label.to_string_lossy())
    })
}

/// Finds the pictures of labels: in the first of the usual folders that has most of them. Other
/// pictures in the same folders are frames without data. In the order of file names. Also returns
/// the pictures there that cannot be decoded.
///
/// `path` is the user's argument: a folder, or the program's file.
pub fn locate<T>(
    file: &Path,
    path: &Path,
    pictures: Vec<LabelledPicture<T>>,
) -> Result<(Vec<LocatedPicture<T>>, Vec<PathBuf>), RecordingError> {
    let own = folder_of(file);
    let mut folders: Vec<PathBuf> = PICTURE_FOLDERS.iter().map(|at| own.join(at)).collect();
    if path.is_dir() {
        folders.extend(["", "images"].map(|at| path.join(at)));
    }
    let labels: Vec<PathBuf> = pictures.iter().map(|picture| relative(&picture.label)).collect();
    let count = |folder: &PathBuf| labels.iter().filter(|label| picture_of(folder, label).is_some()).count();
    // The first one wins a tie.
    let best = folders.iter().map(|folder| (count(folder), folder)).rev().max_by_key(|(count, _)| *count);
    let Some((located_count, folder)) = best.filter(|(located_count, _)| *located_count > 0) else {
        let first = pictures.first().map_or("", |picture| picture.label.as_str());
        let looked = folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(", ");
        let problem = format!(
            "none of its {} pictures (first: {}) is in {looked}; put this file beside the pictures",
            pictures.len(),
            quoted(first)
        );
        return Err(RecordingError::content(file, problem));
    };
    let mut located: BTreeMap<PathBuf, Option<T>> = BTreeMap::new();
    let mut inner: BTreeSet<PathBuf> = BTreeSet::new();
    for (LabelledPicture { label, line, data }, name) in pictures.into_iter().zip(labels) {
        // A missing one causes an error when headers are read.
        let picture = picture_of(folder, &name).unwrap_or_else(|| folder.join(&name));
        inner.extend(picture.parent().filter(|parent| parent.is_dir()).map(Path::to_owned));
        if located.insert(picture, Some(data)).is_some() {
            let problem = format!("the picture {} occurs twice; labels must be unique", quoted(&label));
            return Err(TextError::line(file, line, problem).into());
        }
    }
    debug_assert!(located_count <= located.len());
    let mut unread = Vec::new();
    for folder in &inner {
        for picture in listing::pictures_in(folder)? {
            located.entry(picture).or_insert(None);
        }
        unread.extend(unsupported::in_folder(folder).into_iter().filter(|picture| !located.contains_key(picture)));
    }
    let mut located: Vec<_> = located.into_iter().map(|(file, data)| LocatedPicture { file, data }).collect();
    located.sort_by(|a, b| listing::natural_order(&a.file.to_string_lossy(), &b.file.to_string_lossy()));
    Ok((located, unread))
}

/// A recording of pictures without times, of the program `name`. `file` is named if there is no
/// pose at all; `unread` are pictures that cannot be decoded.
pub fn parts(
    path: &Path,
    file: &Path,
    name: &str,
    pictures: Vec<PosedPicture>,
    unread: &[PathBuf],
    options: &OpenOptions,
) -> Result<Parts, RecordingError> {
    let folder = if path.is_dir() { path.to_owned() } else { folder_of(file) };
    let (mut files, mut timestamps_s) = (Vec::new(), Vec::new());
    let (mut poses, mut geometries) = (Vec::new(), Vec::new());
    for (i, PosedPicture { file, camera_from_world, geometry }) in pictures.into_iter().enumerate() {
        let time_s = i as f64 / NOMINAL_FPS;
        files.push(file);
        timestamps_s.push(time_s);
        poses.extend(camera_from_world.map(|pose| (time_s, pose)));
        geometries.push(geometry);
    }
    let mut parts = Parts::new(&folder, Pictures::Stills(files), timestamps_s);
    // A picture without a pose has none; its neighbours do not determine it.
    parts.track = track_from(poses, options.max_gap_s.or(Some(1.5 / NOMINAL_FPS)), file)?;
    parts.geometries = geometries;
    parts.warnings.push(format!("{name} stores no timestamps: {NOMINAL_FPS} frames a second are assumed"));
    parts.warnings.extend(unsupported::unread_warning(unread));
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labelled(labels: &[&str]) -> Vec<LabelledPicture<usize>> {
        let picture =
            |(data, label): (usize, &&str)| LabelledPicture { label: (*label).to_owned(), line: data + 1, data };
        labels.iter().enumerate().map(picture).collect()
    }

    #[test]
    fn labels_are_found_without_extension_with_folders_and_from_windows() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cameras.xml");
        std::fs::create_dir_all(folder.path().join("images/left")).unwrap();
        for name in ["a.1.JPG", "left/b10.png", "left/b9.png", "d.png"] {
            std::fs::write(folder.path().join("images").join(name), "").unwrap();
        }
        let (pictures, _) =
            locate(&file, folder.path(), labelled(&["left\\b10.png", "a.1", "left/b9", "D:\\x\\d.png"])).unwrap();
        let names: Vec<_> = pictures
            .iter()
            .map(|picture| (picture.file.strip_prefix(folder.path()).unwrap().to_str().unwrap(), picture.data))
            .collect();
        let expected =
            [("images/a.1.JPG", 1), ("images/d.png", 3), ("images/left/b9.png", 2), ("images/left/b10.png", 0)];
        assert_eq!(names, expected.map(|(name, data)| (name, Some(data))));
    }

    #[test]
    fn other_pictures_of_the_folder_are_frames_without_data() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cameras.xml");
        for name in ["a.png", "b.png", "c.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let (pictures, _) = locate(&file, &file, labelled(&["b"])).unwrap();
        assert_eq!(pictures.iter().map(|picture| picture.data).collect::<Vec<_>>(), [None, Some(0)]);
    }

    #[test]
    fn missing_and_repeated_pictures_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cameras.xml");
        let error = locate(&file, &file, labelled(&["a", "b"])).unwrap_err().to_string();
        assert!(
            error.contains("none of its 2 pictures (first: a) is in ") && error.contains("beside the pictures"),
            "{error}"
        );
        std::fs::write(folder.path().join("a.png"), "").unwrap();
        let error = locate(&file, &file, labelled(&["a", "a.png"])).unwrap_err().to_string();
        assert!(error.contains("cameras.xml, line 2: the picture a.png occurs twice"), "{error}");
        let (pictures, _) = locate(&file, &file, labelled(&["a", "z.png"])).unwrap();
        assert!(pictures.len() == 2 && pictures[1].file.ends_with("z.png"));
    }
}
