//! Recordings: frames and camera poses on one clock, opened by what they contain.
//!
//! Each format has a file of its own, which converts axes, units, pixel centres and times at
//! its border; docs/recordings.md tells every convention.

mod colmap;
mod error;
mod frames;
mod listing;
mod nerfstudio;
mod own;
mod parts;
mod tum;
pub mod write;

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

pub use error::RecordingError;
pub use frames::Frames;

use crate::camera::Geometry;
use crate::frame::FrameExposure;
use crate::pose::Pose;
use crate::source::{SourceError, still};
use crate::tracking::{NoPose, PoseTrack};
use parts::Pictures;

/// What a recording cannot know of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenOptions {
    /// How long one unit of the world is, for nerfstudio and COLMAP, whose scale is arbitrary.
    pub metres_per_unit: f64,
    /// Added to frame times when poses are looked up, on top of what the recording says, seconds.
    pub time_offset_s: f64,
    /// The longest interval across which poses are interpolated, seconds; `None`: as the
    /// recording says, or three usual intervals.
    pub max_gap_s: Option<f64>,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { metres_per_unit: 1.0, time_offset_s: 0.0, max_gap_s: None }
    }
}

/// The format that a recording was opened from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Own,
    Tum,
    Nerfstudio,
    Colmap,
}

impl Kind {
    /// Whether the format says when a picture was taken; else times are nominal.
    pub fn has_times(self) -> bool {
        match self {
            Self::Own | Self::Tum => true,
            Self::Nerfstudio | Self::Colmap => false,
        }
    }

    /// Whether the format's unit is the metre; else it is arbitrary.
    pub fn is_metric(self) -> bool {
        match self {
            Self::Own | Self::Tum => true,
            Self::Nerfstudio | Self::Colmap => false,
        }
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Own => "recording.toml",
            Self::Tum => "TUM RGB-D",
            Self::Nerfstudio => "nerfstudio",
            Self::Colmap => "COLMAP",
        })
    }
}

/// When a depth picture was measured, seconds, and its file.
type DepthFile = (f64, PathBuf);

/// An opened recording: everything but the pixels and depths, which [`Recording::frames`] streams.
#[derive(Debug)]
pub struct Recording {
    pub name: String,
    pub path: PathBuf,
    pub kind: Kind,
    /// The world's up, unit length; `None` where the format does not say.
    pub up: Option<DVec3>,
    /// Size of every frame, px.
    pub width: u32,
    pub height: u32,
    /// 8 or 16 bits a code value, the same in every frame.
    pub bits: u32,
    /// One a frame, never descending; the middle of the middle row's exposure.
    pub timestamps_s: Arc<[f64]>,
    /// The median interval between frames; 1/30 s for a single frame.
    pub frame_interval_s: f64,
    pub track: PoseTrack,
    /// Added to a frame's time to get the track's.
    pub time_offset_s: f64,
    /// The camera of all frames, where the format knows it and it is the same in all;
    /// film width and readout time are not known to any and stand at their defaults.
    pub geometry: Option<Geometry>,
    /// Where the camera's profile should be; it is not looked at here.
    pub camera_profile: Option<PathBuf>,
    /// One a frame; empty values where nothing is known.
    pub exposure: Arc<[FrameExposure]>,
    /// What is odd, each said once; [`Recording::missing_poses`] aside.
    pub warnings: Vec<String>,
    described_by: Vec<PathBuf>,
    geometries: Vec<Option<Geometry>>,
    pictures: Arc<Pictures>,
    /// The nearest in time, one a frame.
    depth: Option<Arc<[Option<DepthFile>]>>,
    codes_per_metre: f64,
}

impl Recording {
    /// Opens a recording: a folder, or the file that describes it. Headers of all frames are
    /// read, pixels are not. Poses that do not cover the frames are a warning, not an error.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self, RecordingError> {
        check(options)?;
        let mut parts = match find(path)? {
            Found::Own(file) => own::open(&file, options)?,
            Found::Tum(folder) => tum::open(&folder, options)?,
            Found::Nerfstudio(file) => nerfstudio::open(&file, options)?,
            Found::Colmap(model) => colmap::open(&model, path, options)?,
        };
        if options.metres_per_unit != 1.0 && parts.kind.is_metric() {
            parts.warnings.push(format!("a {} recording is in metres; metres_per_unit is left out", parts.kind));
        }
        parts.assemble(options)
    }

    pub fn frame_count(&self) -> usize {
        self.timestamps_s.len()
    }

    /// The camera's pose at a frame's timestamp. A frame that there is not lies after the last pose.
    pub fn pose_at_frame(&self, index: usize) -> Result<Pose, NoPose> {
        let time_s = self.timestamps_s.get(index).map_or(f64::INFINITY, |t| t + self.time_offset_s);
        self.track.at(time_s)
    }

    /// How many frames of a range have no pose, and why the first of them has none; `None` where all have one.
    pub fn missing_poses(&self, range: Range<usize>) -> Option<String> {
        let mut missing = range.clone().filter_map(|i| self.pose_at_frame(i).err().map(|why| (i, why)));
        let (first, why) = missing.next()?;
        let (number, count) = (1 + missing.count(), range.len());
        Some(format!("no pose for {number} of {count} frames (frame {first}: {why}): passed through untouched"))
    }

    /// The camera of a frame, also where frames differ; `None` where the format does not know it.
    pub fn geometry_at_frame(&self, index: usize) -> Option<&Geometry> {
        self.geometry.as_ref().or_else(|| self.geometries.get(index)?.as_ref())
    }

    /// Every file that is read of it, the camera's profile aside.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let pictures = match &*self.pictures {
            Pictures::Stills(files) => files,
            Pictures::Video(video) => std::slice::from_ref(&video.file),
        };
        self.described_by.iter().chain(pictures).map(PathBuf::as_path).chain(self.depth_files())
    }

    /// The folders that its pictures lie in, depth too, each once.
    pub fn folders(&self) -> BTreeSet<&Path> {
        self.stills().chain(self.depth_files()).filter_map(Path::parent).collect()
    }

    fn stills(&self) -> impl Iterator<Item = &Path> {
        let files = match &*self.pictures {
            Pictures::Stills(files) => files.as_slice(),
            Pictures::Video(_) => &[],
        };
        files.iter().map(PathBuf::as_path)
    }

    fn depth_files(&self) -> impl Iterator<Item = &Path> {
        self.depth.iter().flat_map(|depth| depth.iter().flatten()).map(|(_, file)| file.as_path())
    }

    /// How many pictures there are, depth too, and what is wrong with those whose files end too early. Pixels are not
    /// decoded; of a video nothing is looked at.
    pub fn check_ends(&self) -> (usize, Vec<SourceError>) {
        let mut files: Vec<&Path> = self.stills().chain(self.depth_files()).collect();
        // One depth picture may serve several frames.
        files.sort_unstable();
        files.dedup();
        (files.len(), files.into_iter().filter_map(|file| still::check_end(file).err()).collect())
    }

    pub fn has_depth(&self) -> bool {
        self.depth.as_ref().is_some_and(|depth| depth.iter().any(Option::is_some))
    }

    /// Streams the frames of a half-open range in order, decoded ahead on threads of their own.
    /// Memory does not depend on the range's length. After an error there is nothing more.
    pub fn frames(&self, range: Range<usize>) -> Result<Frames, RecordingError> {
        if range.start > range.end || range.end > self.frame_count() {
            return Err(RecordingError::Range { start: range.start, end: range.end, count: self.frame_count() });
        }
        Frames::new(self, range)
    }
}

fn check(options: &OpenOptions) -> Result<(), RecordingError> {
    let refuse = |name, found, accepted| Err(RecordingError::Option { name, found, accepted });
    let above_zero = |v: f64| v.is_finite() && v > 0.0;
    match options {
        o if !above_zero(o.metres_per_unit) => refuse("metres_per_unit", o.metres_per_unit, "a finite number above 0"),
        o if !o.time_offset_s.is_finite() => refuse("time_offset_s", o.time_offset_s, "a finite number"),
        OpenOptions { max_gap_s: Some(gap), .. } if !above_zero(*gap) => {
            refuse("max_gap_s", *gap, "a finite number above 0")
        }
        _ => Ok(()),
    }
}

/// Which format, and its main file or folder.
enum Found {
    Own(PathBuf),
    Tum(PathBuf),
    Nerfstudio(PathBuf),
    Colmap(PathBuf),
}

fn folder_of(file: &Path) -> PathBuf {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned()
}

fn find(path: &Path) -> Result<Found, RecordingError> {
    let refuse = |found: &str| RecordingError::NotARecording { path: path.to_owned(), found: found.to_owned() };
    if path.is_file() {
        return match path.extension().and_then(|e| e.to_str()) {
            Some("toml") => Ok(Found::Own(path.to_owned())),
            Some("json") => Ok(Found::Nerfstudio(path.to_owned())),
            _ if path.ends_with(tum::FRAME_LIST) => Ok(Found::Tum(folder_of(path))),
            _ if path.ends_with(colmap::CAMERAS) || path.ends_with(colmap::IMAGES) => {
                Ok(Found::Colmap(folder_of(path)))
            }
            _ => Err(refuse("it is a file of another kind (frames or a video alone: name them in a recording.toml)")),
        };
    }
    if !path.is_dir() {
        return Err(refuse("there is nothing at this path"));
    }
    let has = |name: &str| path.join(name).exists();
    if has(own::FILE_NAME) {
        return Ok(Found::Own(path.join(own::FILE_NAME)));
    }
    if has(nerfstudio::FILE_NAME) {
        return Ok(Found::Nerfstudio(path.join(nerfstudio::FILE_NAME)));
    }
    if has(tum::FRAME_LIST) {
        return Ok(Found::Tum(path.to_owned()));
    }
    let models = ["", "colmap", "sparse/0", "sparse"];
    if let Some(model) = models.iter().map(|at| path.join(at)).find(|at| at.join(colmap::IMAGES).exists()) {
        return Ok(Found::Colmap(model));
    }
    if models.iter().any(|at| path.join(at).join("images.bin").exists()) {
        return Err(refuse(
            "it holds a binary COLMAP model (`colmap model_converter --output_type TXT` makes a text model of it)",
        ));
    }
    Err(refuse("the folder holds none of the files that tell one"))
}
