//! Pictures of one camera in order: files, a recording or a video.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::noise::CalibrateError;
use crate::pixels::Pixels;
use crate::recording::{OpenOptions, Recording, RecordingError};
use crate::source::video::{Overrides, Video, probe};
use crate::source::{still, still_format, unsupported};

/// Source of the pictures of one camera.
#[derive(Debug)]
pub enum Footage {
    /// A folder's pictures by name, or loose files in the given order.
    Files(Vec<PathBuf>),
    Recording(Box<Recording>),
    Video(Box<Video>),
}

/// Pictures in order, decoded on demand; an error ends them.
pub type FootagePixels<'a> = Box<dyn Iterator<Item = Result<Pixels, CalibrateError>> + 'a>;

impl Footage {
    /// A picture, a recording, a folder of pictures or a video.
    pub fn open(path: &Path) -> Result<Self, CalibrateError> {
        if is_picture(path) {
            return Ok(Self::Files(vec![path.to_owned()]));
        }
        let refused = match Recording::open(path, &OpenOptions::default()) {
            Ok(recording) => return Ok(Self::Recording(Box::new(recording))),
            Err(error) => error,
        };
        if path.is_dir() {
            return match refused {
                RecordingError::NotARecording { .. } => pictures_in(path).map(Self::Files),
                error => Err(CalibrateError::Read { path: path.to_owned(), reason: error.to_string() }),
            };
        }
        let unread = match probe(path, &Overrides::default()) {
            Ok(video) => return Ok(Self::Video(Box::new(video))),
            Err(error) => error,
        };
        Err(match refused {
            RecordingError::NotARecording { .. } if path.is_file() && !is_video_name(path) => {
                CalibrateError::Read { path: path.to_owned(), reason: NO_FOOTAGE.to_owned() }
            }
            // A missing file, or a damaged video.
            RecordingError::NotARecording { .. } => unread.into(),
            error => CalibrateError::Read { path: path.to_owned(), reason: error.to_string() },
        })
    }

    pub fn count(&self) -> usize {
        match self {
            Self::Files(files) => files.len(),
            Self::Recording(recording) => recording.frame_count(),
            Self::Video(video) => video.timestamps_s.len(),
        }
    }

    /// The only picture's file, the pictures' folder, the recording or the video.
    pub fn path(&self) -> &Path {
        match self {
            Self::Files(files) => {
                let first = files.first().map_or(Path::new(""), PathBuf::as_path);
                let folder = first.parent().filter(|folder| files.len() > 1 && !folder.as_os_str().is_empty());
                folder.unwrap_or(first)
            }
            Self::Recording(recording) => &recording.path,
            Self::Video(video) => &video.file,
        }
    }

    /// The file of a frame, as far as it has its own.
    pub fn frame_path(&self, frame: usize) -> &Path {
        match self {
            Self::Files(files) => files.get(frame).map_or(Path::new(""), PathBuf::as_path),
            _ => self.path(),
        }
    }

    /// Whether a frame is a JPEG file.
    pub fn contains_jpeg(&self) -> Result<bool, CalibrateError> {
        let files: Box<dyn Iterator<Item = &Path> + '_> = match self {
            Self::Files(files) => Box::new(files.iter().map(PathBuf::as_path)),
            Self::Recording(recording) => Box::new(recording.stills()),
            Self::Video(_) => Box::new(std::iter::empty()),
        };
        for file in files {
            if still::is_jpeg(file)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The frames of a range, in order.
    pub fn pixels(&self, range: Range<usize>) -> Result<FootagePixels<'_>, CalibrateError> {
        Ok(match self {
            Self::Files(files) => Box::new(files[range].iter().map(|file| read(file))),
            Self::Recording(recording) => {
                let failed = |error: RecordingError| CalibrateError::Read {
                    path: recording.path.clone(),
                    reason: error.to_string(),
                };
                let frames = recording.frames(range).map_err(failed)?;
                Box::new(frames.map(move |frame| Ok(Arc::unwrap_or_clone(frame.map_err(failed)?.pixels))))
            }
            Self::Video(video) => Box::new(video.read(range)?.map(|frame| Ok(frame?))),
        })
    }
}

/// Problem of a file of another kind, with advice.
const NO_FOOTAGE: &str = "neither pictures, a recording nor a video; give a picture, a folder of pictures, a recording \
                          or an .mp4, .mov or .mkv file";

/// Extensions of videos: a file of such a name that cannot be read is reported as a video.
const VIDEO_EXTENSIONS: [&str; 6] = ["mp4", "mov", "mkv", "m4v", "webm", "avi"];

/// True if a file has the extension of a video.
fn is_video_name(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    extension.is_some_and(|extension| VIDEO_EXTENSIONS.contains(&extension.as_str()))
}

/// True if a file has the extension of a picture.
pub fn is_picture(path: &Path) -> bool {
    path.is_file() && still_format::is_picture_name(path)
}

fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, CalibrateError> {
    let failed = |reason: String| CalibrateError::Read { path: folder.to_owned(), reason };
    let mut files = still_format::pictures_in(folder).map_err(|e| failed(e.to_string()))?;
    if files.is_empty()
        && let Some(message) = unsupported::unread_warning(&unsupported::in_folder(folder))
    {
        return Err(failed(message));
    }
    if files.is_empty() {
        return Err(failed(
            "no pictures in this folder, and no recording; give pictures, folders of them, recordings or videos"
                .to_owned(),
        ));
    }
    files.sort();
    Ok(files)
}

/// Reads a file as recordings do: a truncated file is an error.
pub fn read(path: &Path) -> Result<Pixels, CalibrateError> {
    Ok(still::read_pixels(path)?)
}
