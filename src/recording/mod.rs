//! Recordings: frames and camera poses on one clock. The format is recognized by the contents.
//!
//! Each format has its own file, which converts axes, units, pixel centres and times as it reads them.
//! docs/recordings.md has every convention.

mod arriving;
mod beside;
mod camera_file;
mod cameras;
mod colmap;
mod depth;
mod error;
mod euroc;
mod folder;
mod foreign;
mod frame_camera;
mod frames;
mod listing;
mod nerfstudio;
mod own;
mod parts;
pub mod recorder;
mod repeats;
mod rigid;
mod seven_scenes;
mod stray;
mod tum;
pub mod write;

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

pub use beside::{EACH_WAY, FramesBeside};
pub use cameras::can_say;
pub use depth::Registration;
pub use error::RecordingError;
pub use frame_camera::FrameCamera;
pub use frames::Frames;

use crate::camera::Geometry;
use crate::frame::{FrameExposure, SeenBrightness, Surfel, interval_s};
use crate::pose::Pose;
use crate::source::presentation::Presentation;
use crate::source::{SourceError, still, unsupported};
use crate::tracking::{NoPose, PoseTrack};
use depth::Depth;
pub use parts::Format;
use parts::Pictures;
pub use repeats::Repeats;

/// Facts that a recording cannot know about itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenOptions {
    /// Length of one world unit for nerfstudio and COLMAP, whose scale is arbitrary.
    pub metres_per_unit: f64,
    /// Added to frame times to look up poses, in addition to the recording's own offset, seconds.
    pub time_offset_s: f64,
    /// The longest interval across which poses are interpolated, seconds. `None`: the recording's own, or three usual
    /// intervals.
    pub max_gap_s: Option<f64>,
    /// Leave out frames whose picture has the code values of the one before. Every picture is decoded to find them.
    pub skip_duplicates: bool,
    /// Leave out frames whose picture is missing, instead of refusing the recording.
    pub skip_missing: bool,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { metres_per_unit: 1.0, time_offset_s: 0.0, max_gap_s: None, skip_duplicates: false, skip_missing: false }
    }
}

/// The formats, in the order in which they are tried. A new one is a file of this room and a line here.
static FORMATS: [&Format; 7] = [
    &own::FORMAT,
    &nerfstudio::FORMAT,
    &tum::FORMAT,
    &euroc::FORMAT,
    &stray::FORMAT,
    &colmap::FORMAT,
    &seven_scenes::FORMAT,
];

/// An opened recording: everything except the pixels and depths, which [`Recording::frames`] streams.
#[derive(Clone, Debug)]
pub struct Recording {
    pub name: String,
    pub path: PathBuf,
    pub kind: &'static Format,
    /// The world's up direction, unit length; `None` if the format does not give it.
    pub up: Option<DVec3>,
    /// Whether the plane through the world's origin, across `up`, is a surface on which things stand.
    pub has_floor: bool,
    /// Size of every frame, px.
    pub width: u32,
    pub height: u32,
    /// 8 or 16 bits per code value, the same in every frame.
    pub bits: u32,
    /// One per frame, never descending: the middle of the middle row's exposure.
    pub timestamps_s: Arc<[f64]>,
    /// One per frame, or empty where all are 1: the share of the virtual layer that is seen ([`crate::frame::Frame::presence`]).
    presence: Arc<[f64]>,
    /// The median interval between frames, or what the recording says; 1/30 s for a single frame.
    pub frame_interval_s: f64,
    /// Whether [`Recording::interval_s`] is that for every frame: of a camera whose pictures were dropped now and then,
    /// which opens its shutter no longer for that.
    has_even_intervals: bool,
    pub track: PoseTrack,
    /// Length of the format's unit by which the track is in metres; 1 where the format is.
    pub metres_per_unit: f64,
    /// Added to a frame's time to get the track's.
    pub time_offset_s: f64,
    /// The camera of all frames, if the format knows it and it is the same in all. No format knows film width and
    /// readout time; they are at their defaults.
    pub geometry: Option<Geometry>,
    /// Where the camera's profile should be; it is not opened here.
    pub camera_profile: Option<PathBuf>,
    /// One per frame; empty values if unknown.
    pub exposure: Arc<[FrameExposure]>,
    /// Warnings, each given once, except [`Recording::missing_poses`].
    pub warnings: Vec<String>,
    described_by: Vec<PathBuf>,
    geometries: Arc<[Option<Geometry>]>,
    landmarks: Arc<[Vec<Landmark>]>,
    /// See [`Recording::frames_say_cameras`].
    has_frame_cameras: bool,
    /// See [`Recording::set_cameras`].
    given_cameras: Option<Arc<[Option<Geometry>]>>,
    pictures: Arc<Pictures>,
    /// See [`Recording::presentation`].
    presentation: Presentation,
    depth: Option<Arc<Depth>>,
    /// Added to the depth maps' times, seconds.
    depth_later_s: f64,
    /// [`Refinement::surfels`], and the length of the unit by which they were found.
    surfels: Arc<[Surfel]>,
    surfels_unit_m: f64,
}

/// A place of the room that was recognised in a frame, as structure from motion does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landmark {
    /// The same in all frames that show it.
    pub number: u64,
    /// In the frame, px.
    pub at_px: [f32; 2],
}

/// What pictures say of a recording beyond what was recorded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refinement {
    /// In place of the recorded poses, by the frames' own times.
    pub track: Option<PoseTrack>,
    /// Added to the depth maps' times, seconds.
    pub depth_later_s: f64,
    /// One per frame, or empty.
    pub seen: Vec<SeenBrightness>,
    /// [`FrameExposure::blurred_s`], one per frame, or empty.
    pub blurred_s: Vec<f64>,
    /// Surfaces that its depth maps show together, in the world of the track.
    pub surfels: Arc<[Surfel]>,
}

impl Recording {
    /// Opens a recording: a folder, or the file that describes it. Headers of all frames are read, pixels are not.
    /// Poses that do not cover the frames are a warning, not an error.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self, RecordingError> {
        check(options)?;
        let (format, at) = find(path)?;
        let opened = (format.open)(&at, path, options);
        let mut parts = opened.map_err(|error| error.without_foreign_text(path, &at))?;
        if options.metres_per_unit != 1.0 && format.is_metric() {
            parts.warnings.push(format!("a {format} recording is in metres; metres_per_unit is left out"));
        }
        parts.assemble(format, options)
    }

    /// Takes over what was found out about it.
    pub fn refine(&mut self, by: &Refinement) {
        if let Some(track) = &by.track {
            (self.track, self.time_offset_s) = (track.clone(), 0.0);
        }
        self.depth_later_s = by.depth_later_s;
        let mut exposure = self.exposure.to_vec();
        if by.seen.len() == self.frame_count() {
            exposure.iter_mut().zip(&by.seen).for_each(|(frame, seen)| frame.seen = Some(*seen));
        }
        if by.blurred_s.len() == self.frame_count() {
            exposure.iter_mut().zip(&by.blurred_s).for_each(|(frame, s)| frame.blurred_s = Some(*s));
        }
        self.exposure = exposure.into();
        (self.surfels, self.surfels_unit_m) = (Arc::clone(&by.surfels), self.metres_per_unit);
    }

    /// The world, as world_from_other, in which the camera stands where `pose` says in a frame that was taken at `time_s`. `None`
    /// if it stands there already (within 1e-9 m and rad), and if this is not the frame that is meant: it was taken at another time,
    /// or stands farther away than poses are wrong by.
    pub fn held_at(&self, frame: usize, time_s: f64, pose: &Pose) -> Option<Pose> {
        const MOST_WRONG_M: f64 = 0.3;
        const MOST_WRONG_RAD: f64 = 0.2;
        let now = self.pose_at_frame(frame).ok().filter(|_| self.timestamps_s[frame] == time_s)?;
        let far_m = (now.position_in_world_m() - pose.position_in_world_m()).length();
        let turned = now.rotation.angle_between(pose.rotation);
        let is_same = far_m < 1e-9 && turned < 1e-9;
        if is_same || far_m > MOST_WRONG_M || turned > MOST_WRONG_RAD {
            return None;
        }
        // world_from_other = camera_from_world⁻¹ · camera_from_other.
        let back = now.world_from_camera_rotation();
        Some(Pose::new(back * pose.rotation, now.inverse_transform_point(pose.translation_m)))
    }

    /// Surfaces of the room. Empty while the unit has another length than they were found by: depth is in metres by itself, so
    /// that its points lie elsewhere then.
    pub fn surfels(&self) -> Arc<[Surfel]> {
        if self.metres_per_unit == self.surfels_unit_m { Arc::clone(&self.surfels) } else { Arc::default() }
    }

    /// Expresses the track and the surfels in another world.
    pub fn move_to_world(&mut self, world_from_other: &Pose) {
        self.track = self.track.in_world(world_from_other);
        self.surfels = self.surfels.iter().map(|surfel| surfel.in_world(world_from_other)).collect();
    }

    /// Takes another length for the format's unit, above 0. A recording in metres stays as it is.
    pub fn rescale(&mut self, metres_per_unit: f64) {
        if !self.kind.is_metric() {
            self.track = self.track.scaled(metres_per_unit / self.metres_per_unit);
            self.metres_per_unit = metres_per_unit;
        }
    }

    /// Whether there is one at a path, by the files that tell one. Nothing in them is read.
    pub fn is_at(path: &Path) -> bool {
        Self::refusal_at(path).is_none()
    }

    /// Why there is none at a path, and what would make one; `None` if there is one.
    pub fn refusal_at(path: &Path) -> Option<RecordingError> {
        find(path).err()
    }

    /// Seconds from a frame to the next.
    pub fn interval_s(&self, frame: usize) -> f64 {
        let timestamps_s: &[f64] = if self.has_even_intervals { &[] } else { &self.timestamps_s };
        interval_s(timestamps_s, frame, self.frame_interval_s)
    }

    /// All frames' times, unless those of the range are within 2 ms of a steady rate: containers round to a millisecond or so.
    pub fn times_unless_steady(&self, range: Range<usize>) -> Option<Arc<[f64]>> {
        const TOLERANCE_S: f64 = 2e-3;
        let times_s = self.timestamps_s.get(range)?;
        let first_s = times_s.first()?;
        let steady_s = (0..).map(|i| first_s + f64::from(i) * self.frame_interval_s);
        let is_steady = times_s.iter().zip(steady_s).all(|(time_s, steady_s)| (time_s - steady_s).abs() < TOLERANCE_S);
        (!is_steady).then(|| Arc::clone(&self.timestamps_s))
    }

    /// How the pictures are meant to be shown: as a video says it, or as the EXIF of all stills does.
    pub fn presentation(&self) -> Presentation {
        self.presentation
    }

    /// The share of the virtual layer that is seen in a frame, 0 to 1: below 1 where live let it fade.
    pub fn presence(&self, frame: usize) -> f64 {
        self.presence.get(frame).copied().unwrap_or(1.0)
    }

    pub fn frame_count(&self) -> usize {
        self.timestamps_s.len()
    }

    /// The camera's pose at a frame's timestamp. A frame that does not exist counts as after the last pose.
    pub fn pose_at_frame(&self, index: usize) -> Result<Pose, NoPose> {
        let time_s = self.timestamps_s.get(index).map_or(f64::INFINITY, |t| t + self.time_offset_s);
        self.track.at(time_s)
    }

    /// How many frames of a range have no pose, and why the first has none; `None` if all have one.
    pub fn missing_poses(&self, range: Range<usize>) -> Option<String> {
        let mut missing = range.clone().filter_map(|i| self.pose_at_frame(i).err().map(|why| (i, why)));
        let (first, why) = missing.next()?;
        let (number, count) = (1 + missing.count(), range.len());
        Some(format!("no pose for {number} of {count} frames (frame {first}: {why}): passed through untouched"))
    }

    /// What was recognised in a frame; nothing where the format keeps no such places.
    pub fn landmarks(&self, index: usize) -> &[Landmark] {
        self.landmarks.get(index).map_or(&[], Vec::as_slice)
    }

    /// The camera of a frame, even if frames differ; `None` if the format does not know it.
    pub fn geometry_at_frame(&self, index: usize) -> Option<&Geometry> {
        // Of what is arriving there is the newest frame alone.
        let index = if self.is_arriving() { self.geometries.len().saturating_sub(1) } else { index };
        self.geometry.as_ref().or_else(|| self.geometries.get(index)?.as_ref())
    }

    /// Whether frames say themselves which camera and lens took them, as a tracking system said it, and override a profile
    /// by that: those of a camera that is still to come, and those that were recorded of one.
    pub fn frames_say_cameras(&self) -> bool {
        self.has_frame_cameras
    }

    /// Every file that is read of the recording, except the camera's profile.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let pictures = match &*self.pictures {
            Pictures::Stills(files) => files,
            Pictures::Video(video, _) => std::slice::from_ref(&video.file),
        };
        self.described_by.iter().chain(pictures).map(PathBuf::as_path).chain(self.depth_files())
    }

    /// The files of pictures, a video's own among them, and of depth.
    pub fn pictures(&self) -> impl Iterator<Item = &Path> {
        let video = match &*self.pictures {
            Pictures::Stills(_) => None,
            Pictures::Video(video, _) => Some(video.file.as_path()),
        };
        self.stills().chain(video).chain(self.depth_files())
    }

    /// The folders that contain its pictures, including depth, each once.
    pub fn folders(&self) -> BTreeSet<&Path> {
        self.stills().chain(self.depth_files()).filter_map(Path::parent).collect()
    }

    /// The frames' pictures; empty for a video.
    pub fn stills(&self) -> impl Iterator<Item = &Path> {
        let files = match &*self.pictures {
            Pictures::Stills(files) => files.as_slice(),
            Pictures::Video(..) => &[],
        };
        files.iter().map(PathBuf::as_path)
    }

    fn depth_files(&self) -> impl Iterator<Item = &Path> {
        self.depth.iter().flat_map(|depth| depth.files())
    }

    /// The number of pictures, including depth, and an error for each whose file ends too early. Pixels are not
    /// decoded; videos are not checked. [`Recording::undecoded_depth`] then warns about the frames whose depth is missing.
    pub fn check_ends(&self) -> (usize, Vec<SourceError>) {
        let stills: BTreeSet<&Path> = self.stills().collect();
        let (of_depth, depth_problems) = self.depth.as_ref().map(|depth| depth.check_ends()).unwrap_or_default();
        let problems = stills.iter().filter_map(|file| still::check_end(file).err()).chain(depth_problems);
        (stills.len() + of_depth, problems.collect())
    }

    pub fn has_depth(&self) -> bool {
        self.depth.as_ref().is_some_and(|depth| depth.has_any())
    }

    /// A warning about depth pictures that turned out damaged when they were decoded; their frames have no depth.
    pub fn undecoded_depth(&self) -> Option<String> {
        self.depth.as_ref()?.undecoded()
    }

    /// How depth is stored, in words that change with it; empty without depth.
    pub fn depth_stored(&self) -> String {
        self.depth.as_ref().map_or_else(String::new, |depth| depth.stored())
    }

    /// How the depth comes into the frames' picture; `None` without depth.
    pub fn registration(&self) -> Option<Registration> {
        self.depth.as_ref().filter(|depth| depth.has_any()).map(|depth| depth.registration)
    }

    /// Depth from a camera of its own is seen from the frames' camera: from here on from the one that `given` makes of
    /// each frame's own.
    pub fn set_cameras(&mut self, given: impl Fn(Option<&Geometry>) -> Option<Geometry>) {
        if matches!(self.registration(), Some(Registration::OtherCamera(..))) {
            let own = self.cameras();
            let all: Vec<_> = own.iter().map(|camera| given(camera.as_ref())).collect();
            self.given_cameras = Some(if all.is_empty() { Arc::from([given(None)]) } else { all.into() });
        }
    }

    /// The frames' cameras; a single one if all are alike.
    fn cameras(&self) -> Arc<[Option<Geometry>]> {
        match (&self.given_cameras, &self.geometry) {
            (Some(given), _) => Arc::clone(given),
            (None, Some(_)) => Arc::from([self.geometry.clone()]),
            (None, None) => Arc::clone(&self.geometries),
        }
    }

    /// The same recording without its depth maps, which reading its frames then saves.
    pub fn without_depth(&self) -> Self {
        Self { depth: None, ..self.clone() }
    }

    /// Streams the frames of a half-open range in order, decoded ahead on separate threads. Memory does not depend on
    /// the range's length. An error ends the stream.
    pub fn frames(&self, range: Range<usize>) -> Result<Frames, RecordingError> {
        if range.start > range.end || range.end > self.frame_count() {
            return Err(RecordingError::Range { start: range.start, end: range.end, count: self.frame_count() });
        }
        if self.is_arriving() && !range.is_empty() {
            return Err(RecordingError::content(
                &self.path,
                "a camera's frames are gone once they were seen; freeze it",
            ));
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

/// The format of a path, and the file or folder of the recording.
fn find(path: &Path) -> Result<(&'static Format, PathBuf), RecordingError> {
    if let Some(found) = FORMATS.iter().find_map(|format| Some((*format, (format.find)(path)?))) {
        return Ok(found);
    }
    let binary = colmap::MODELS_AT.iter().any(|at| path.join(at).join("images.bin").exists());
    let unread = unsupported::by_name(path).filter(|_| path.is_file()).map(|kind| format!("it {}", kind.refusal()));
    let in_folder = || {
        let unread = unsupported::unread_warning(&unsupported::in_folder(path))?;
        Some(format!("{unread}, and no file describes a recording"))
    };
    let foreign = foreign::refusal(path).map(str::to_owned).or(unread).or_else(in_folder);
    let found = match path {
        _ if foreign.is_some() => foreign.as_deref().unwrap_or_default(),
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
