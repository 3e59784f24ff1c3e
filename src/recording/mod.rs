//! Recordings: frames and camera poses on one clock, opened by what they contain.
//!
//! Each format has a file of its own, which converts axes, units, pixel centres and times at
//! its border; docs/recordings.md tells every convention.

mod colmap;
mod error;
mod euroc;
mod frames;
mod listing;
mod nerfstudio;
mod own;
mod parts;
mod rigid;
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
pub use parts::Format;
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

/// The formats, in the order in which they are looked for. A new one is a file of this room and a line here.
static FORMATS: [&Format; 5] = [&own::FORMAT, &nerfstudio::FORMAT, &tum::FORMAT, &euroc::FORMAT, &colmap::FORMAT];

/// When a depth picture was measured, seconds, and its file.
type DepthFile = (f64, PathBuf);

/// An opened recording: everything but the pixels and depths, which [`Recording::frames`] streams.
#[derive(Debug)]
pub struct Recording {
    pub name: String,
    pub path: PathBuf,
    pub kind: &'static Format,
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
        let (format, at) = find(path)?;
        let mut parts = (format.open)(&at, path, options)?;
        if options.metres_per_unit != 1.0 && format.is_metric() {
            parts.warnings.push(format!("a {format} recording is in metres; metres_per_unit is left out"));
        }
        parts.assemble(format, options)
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

    /// The frames' pictures; none where they are a video's.
    pub fn stills(&self) -> impl Iterator<Item = &Path> {
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

/// Which format a path is of, and the file or folder that holds it.
fn find(path: &Path) -> Result<(&'static Format, PathBuf), RecordingError> {
    if let Some(found) = FORMATS.iter().find_map(|format| Some((*format, (format.find)(path)?))) {
        return Ok(found);
    }
    let binary = colmap::MODELS_AT.iter().any(|at| path.join(at).join("images.bin").exists());
    let found = match path {
        _ if path.is_file() => "it is a file of another kind (frames or a video alone: name them in a recording.toml)",
        _ if binary => {
            "it holds a binary COLMAP model (`colmap model_converter --output_type TXT` makes a text model of it)"
        }
        _ if path.is_dir() => "the folder holds none of the files that tell one",
        _ if path.exists() => "it is a pipe or a device",
        _ => "there is nothing at this path",
    };
    let accepted = FORMATS.map(|format| format.marker).join(", ");
    Err(RecordingError::NotARecording { path: path.to_owned(), found: found.to_owned(), accepted })
}
