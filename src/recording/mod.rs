//! Recordings: frames and camera poses on one clock. The format is recognised by the contents.
//!
//! Each format has its own module, which converts axes, units, pixel centres and times while
//! reading. docs/recordings.md documents every convention.

mod arkit;
mod as_video;
mod brown_camera;
mod camera_file;
mod cameras;
mod coding;
pub mod colmap;
mod depth;
mod depth_reader;
mod duplicates;
mod error;
mod euroc;
mod files;
mod folder;
mod frame_camera;
mod frames;
mod listing;
mod live;
mod metashape;
mod native;
mod neighbours;
mod nerfstudio;
pub mod new_folder;
mod parts;
mod photogrammetry;
mod picture_tags;
mod plain_folder;
mod realitycapture;
pub mod recorder;
mod rigid;
mod scanner_app;
mod seven_scenes;
mod stray;
mod tum;
mod unsupported_capture;
pub mod write;
mod xml;

use std::fmt::Debug;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

pub use cameras::is_representable;
pub use depth::DepthRegistration;
pub use error::RecordingError;
pub use frame_camera::FrameCamera;
pub use frames::Frames;
pub use listing::pictures_in;
pub use neighbours::{FramesWithNeighbours, NEIGHBOURS_EACH_WAY};

use crate::camera::{Geometry, Response};
use crate::frame::{FrameExposure, RelativeBrightness, Surfel, interval_s};
use crate::pose::Pose;
use crate::site::ScannedSite;
use crate::source::presentation::Presentation;
use crate::source::{still_format, unsupported};
use crate::tracking::{NoPose, PoseTrack};
use coding::CodingEstimate;
use depth::Depth;
pub use duplicates::Duplicates;
use parts::Pictures;
pub use parts::RecordingFormat;

/// Parameters that a recording does not contain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenOptions {
    /// Length of one world unit in formats without a metric scale, m.
    pub metres_per_unit: f64,
    /// Added to frame times to look up poses, in addition to the recording's own offset, seconds.
    pub time_offset_s: f64,
    /// Maximum interval across which poses are interpolated, seconds. `None`: the recording's own,
    /// or three usual intervals.
    pub max_gap_s: Option<f64>,
    /// Skip frames with the same code values as the previous one. Every picture is decoded to find
    /// them.
    pub skip_duplicates: bool,
    /// Skip frames whose picture is missing, instead of refusing the recording.
    pub skip_missing: bool,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self { metres_per_unit: 1.0, time_offset_s: 0.0, max_gap_s: None, skip_duplicates: false, skip_missing: false }
    }
}

/// The formats, in the order in which they are tried. A new format is a file in this module and a
/// line here.
static FORMATS: [&RecordingFormat; 12] = [
    &native::FORMAT,
    &nerfstudio::FORMAT,
    &tum::FORMAT,
    &euroc::FORMAT,
    &stray::FORMAT,
    &arkit::FORMAT,
    &scanner_app::FORMAT,
    &colmap::FORMAT,
    &metashape::FORMAT,
    &realitycapture::FORMAT,
    &seven_scenes::FORMAT,
    &plain_folder::FORMAT,
];

/// An opened recording: everything except the pixels and depths, which [`Recording::frames`]
/// streams.
#[derive(Clone, Debug)]
pub struct Recording {
    pub name: String,
    pub path: PathBuf,
    pub kind: &'static RecordingFormat,
    /// The world's up direction, unit length; `None` if the format does not give it.
    pub up: Option<DVec3>,
    /// True if the plane through the world's origin, perpendicular to `up`, is a supporting
    /// surface.
    pub has_floor: bool,
    /// Size of every frame, px.
    pub width: u32,
    pub height: u32,
    /// 8 or 16 bits per code value, the same in every frame.
    pub bits: u32,
    /// One per frame, never descending: the middle of the middle row's exposure.
    pub timestamps_s: Arc<[f64]>,
    /// One per frame, or empty if all are 1: the opacity of the virtual layer
    /// ([`crate::frame::Frame::opacity`]).
    opacity: Arc<[f64]>,
    /// The median interval between frames, or the recording's own value; 1/30 s for a single frame.
    pub frame_interval_s: f64,
    /// True if [`Recording::interval_s`] is constant: a camera that occasionally drops pictures
    /// does not expose longer because of it.
    has_even_intervals: bool,
    pub track: PoseTrack,
    /// Length of the format's unit by which the track is in metres; 1 for metric formats.
    pub metres_per_unit: f64,
    /// The common camera of all frames, if the format contains it. No format contains film width
    /// and readout time; they are at their defaults.
    pub geometry: Option<Geometry>,
    /// Expected path of the camera's profile; it is not opened here.
    pub camera_profile: Option<PathBuf>,
    /// One per frame; empty values if unknown.
    pub exposure: Arc<[FrameExposure]>,
    /// Warnings without duplicates, except [`Recording::missing_poses`].
    pub warnings: Vec<String>,
    description_files: Vec<PathBuf>,
    geometries: Arc<[Option<Geometry>]>,
    landmarks: Arc<[Vec<Landmark>]>,
    /// See [`Recording::has_individual_cameras`].
    has_frame_cameras: bool,
    /// See [`Recording::set_cameras`].
    registration_cameras: Option<Arc<[Option<Geometry>]>>,
    pictures: Arc<Pictures>,
    estimated_coding: CodingEstimate,
    /// See [`Recording::presentation`].
    presentation: Presentation,
    /// See [`Recording::response`].
    response: Response,
    depth: Option<Arc<Depth>>,
    /// See [`Recording::set_site`].
    site: Option<ScannedSite>,
    /// Added to the depth maps' times, seconds.
    depth_later_s: f64,
    /// [`Refinement::surfels`], and the unit's length at their estimation.
    surfels: Arc<[Surfel]>,
    surfels_unit_m: f64,
    /// Kept as long as any clone of the recording exists, such as the lock of its folder.
    pub guard: Option<Arc<dyn Debug + Send + Sync>>,
}

/// A landmark observed in a frame, as in structure from motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landmark {
    /// Identifies the landmark across frames.
    pub number: u64,
    /// Position in the frame, px.
    pub at_px: [f32; 2],
}

/// Estimates from the pictures that refine a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refinement {
    /// Replaces the recorded poses, by the frames' own times.
    pub track: Option<PoseTrack>,
    /// Added to the depth maps' times, seconds.
    pub depth_later_s: f64,
    /// One per frame, or empty.
    pub brightness: Vec<RelativeBrightness>,
    /// [`FrameExposure::blur_estimate_s`], one per frame, or empty.
    pub blur_estimate_s: Vec<f64>,
    /// Surfaces fused from the depth maps, in the world of the track.
    pub surfels: Arc<[Surfel]>,
}

impl Recording {
    /// Opens a recording: a folder, or the file that describes it. Headers of all frames are read,
    /// pixels are not. Poses that do not cover the frames are a warning, not an error.
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

    /// Applies estimates from the pictures.
    pub fn refine(&mut self, by: &Refinement) {
        if let Some(track) = &by.track {
            self.track = track.clone();
        }
        self.depth_later_s = by.depth_later_s;
        let mut exposure = self.exposure.to_vec();
        if by.brightness.len() == self.frame_count() {
            exposure
                .iter_mut()
                .zip(&by.brightness)
                .for_each(|(frame, brightness)| frame.brightness = Some(*brightness));
        }
        if by.blur_estimate_s.len() == self.frame_count() {
            exposure.iter_mut().zip(&by.blur_estimate_s).for_each(|(frame, s)| frame.blur_estimate_s = Some(*s));
        }
        self.exposure = exposure.into();
        (self.surfels, self.surfels_unit_m) = (Arc::clone(&by.surfels), self.metres_per_unit);
    }

    /// World correction, as world_from_other, that moves the camera to `pose` in the frame taken at
    /// `time_s`. `None` if the camera is there already (within 1e-9 m and rad), and if this is a
    /// different frame: it was taken at another time, or its distance exceeds plausible pose
    /// errors.
    pub fn correction_to_gauge(&self, frame: usize, time_s: f64, pose: &Pose) -> Option<Pose> {
        const MAX_POSE_ERROR_M: f64 = 0.3;
        const MAX_POSE_ERROR_RAD: f64 = 0.2;
        let now = self.pose_at_frame(frame).ok().filter(|_| self.timestamps_s[frame] == time_s)?;
        let far_m = (now.position_in_world_m() - pose.position_in_world_m()).length();
        let turned = now.rotation.angle_between(pose.rotation);
        let is_same = far_m < 1e-9 && turned < 1e-9;
        if is_same || far_m > MAX_POSE_ERROR_M || turned > MAX_POSE_ERROR_RAD {
            return None;
        }
        // world_from_other = camera_from_world⁻¹ · camera_from_other.
        let back = now.world_from_camera_rotation();
        Some(Pose::new(back * pose.rotation, now.inverse_transform_point(pose.translation_m)))
    }

    /// Surfaces of the room. Empty if the unit's length differs from that at their estimation:
    /// depth is metric by itself, so its points would move.
    pub fn surfels(&self) -> Arc<[Surfel]> {
        if self.metres_per_unit == self.surfels_unit_m { Arc::clone(&self.surfels) } else { Arc::default() }
    }

    /// Expresses the track, the surfels and the site in another world.
    pub fn move_to_world(&mut self, world_from_other: &Pose) {
        self.track = self.track.in_world(world_from_other);
        self.site = self.site.take().map(|site| site.in_world(world_from_other));
        self.surfels = self.surfels.iter().map(|surfel| surfel.in_world(world_from_other)).collect();
    }

    /// Sets the length of the format's unit, above 0. A metric recording is unchanged.
    pub fn rescale(&mut self, metres_per_unit: f64) {
        if !self.kind.is_metric() {
            self.track = self.track.scaled(metres_per_unit / self.metres_per_unit);
            self.metres_per_unit = metres_per_unit;
        }
    }

    /// True if there is a recording at a path, by its file names. Of files of any name with the
    /// right extension the start is read.
    pub fn is_at(path: &Path) -> bool {
        Self::refusal_at(path).is_none()
    }

    /// Reason why a path is no recording, with advice; `None` if it is one.
    pub fn refusal_at(path: &Path) -> Option<RecordingError> {
        find(path).err()
    }

    /// Interval from a frame to the next, seconds.
    pub fn interval_s(&self, frame: usize) -> f64 {
        let timestamps_s: &[f64] = if self.has_even_intervals { &[] } else { &self.timestamps_s };
        interval_s(timestamps_s, frame, self.frame_interval_s)
    }

    /// Opacity of the virtual layer in a frame, 0 to 1: below 1 where the live mode faded it.
    pub fn opacity(&self, frame: usize) -> f64 {
        self.opacity.get(frame).copied().unwrap_or(1.0)
    }

    pub fn frame_count(&self) -> usize {
        self.timestamps_s.len()
    }

    /// The camera's pose at a frame's timestamp. A frame index beyond the end counts as after the
    /// last pose.
    pub fn pose_at_frame(&self, index: usize) -> Result<Pose, NoPose> {
        self.track.at(self.timestamps_s.get(index).copied().unwrap_or(f64::INFINITY))
    }

    /// Number of frames of a range without a pose, with the reason for the first; `None` if all
    /// have one.
    pub fn missing_poses(&self, range: Range<usize>) -> Option<String> {
        let mut missing = range.clone().filter_map(|i| self.pose_at_frame(i).err().map(|why| (i, why)));
        let (first, why) = missing.next()?;
        let (number, count) = (1 + missing.count(), range.len());
        Some(format!("no pose for {number} of {count} frames (frame {first}: {why}): passed through untouched"))
    }

    /// True if the exposure time of any frame was recorded, or estimated from motion blur.
    pub fn has_exposure_times(&self) -> bool {
        self.exposure.iter().any(|frame| frame.time_s.or(frame.blur_estimate_s).is_some())
    }

    /// Landmarks observed in a frame; empty if the format has none.
    pub fn landmarks(&self, index: usize) -> &[Landmark] {
        self.landmarks.get(index).map_or(&[], Vec::as_slice)
    }

    /// The camera of a frame, even if frames differ; `None` if unknown.
    pub fn geometry_at_frame(&self, index: usize) -> Option<&Geometry> {
        // A live recording has the newest frame only.
        let index = if self.is_live() { self.geometries.len().saturating_sub(1) } else { index };
        self.geometry.as_ref().or_else(|| self.geometries.get(index)?.as_ref())
    }

    /// True if frames have individual cameras and lenses, reported by a tracking system, which
    /// override a profile: those of a live camera, and those recorded from one.
    pub fn has_individual_cameras(&self) -> bool {
        self.has_frame_cameras
    }

    /// True if frames have depth: measured, or of a scan.
    pub fn has_depth(&self) -> bool {
        self.has_measured_depth() || self.site.is_some()
    }

    /// True if a sensor measured depth.
    pub fn has_measured_depth(&self) -> bool {
        self.depth.as_ref().is_some_and(|depth| depth.has_any())
    }

    /// Sets a scan in the recording's world. It gives depth to frames for which none was measured.
    pub fn set_site(&mut self, site: Option<ScannedSite>) {
        self.site = site;
    }

    pub fn site(&self) -> Option<&ScannedSite> {
        self.site.as_ref()
    }

    /// A warning about depth pictures that were found damaged when decoded; their frames have no
    /// depth.
    pub fn undecoded_depth(&self) -> Option<String> {
        self.depth.as_ref()?.undecoded()
    }

    /// The encoding of measured depth, or else the scan, as text that changes with it; empty
    /// without depth.
    pub fn depth_stored(&self) -> String {
        match (&self.depth, &self.site) {
            (Some(depth), _) => depth.stored(),
            (None, site) => site.as_ref().map_or_else(String::new, ScannedSite::identity),
        }
    }

    /// Registration of the depth to the frames' picture; `None` without depth.
    pub fn registration(&self) -> Option<DepthRegistration> {
        self.depth.as_ref().filter(|depth| depth.has_any()).map(|depth| depth.registration)
    }

    /// Sets the cameras to which the depth of a separate camera is registered, and in which a scan
    /// is rendered: `camera_for` maps each frame's own camera to the one used from now on.
    pub fn set_cameras(&mut self, camera_for: impl Fn(Option<&Geometry>) -> Option<Geometry>) {
        if self.site.is_some() || matches!(self.registration(), Some(DepthRegistration::OtherCamera(..))) {
            let own = self.cameras();
            let all: Vec<_> = own.iter().map(|camera| camera_for(camera.as_ref())).collect();
            self.registration_cameras = Some(if all.is_empty() { Arc::from([camera_for(None)]) } else { all.into() });
        }
    }

    /// The frames' cameras; a single one if all are equal.
    fn cameras(&self) -> Arc<[Option<Geometry>]> {
        match (&self.registration_cameras, &self.geometry) {
            (Some(cameras), _) => Arc::clone(cameras),
            (None, Some(_)) => Arc::from([self.geometry.clone()]),
            (None, None) => Arc::clone(&self.geometries),
        }
    }

    /// The recording without its depth maps, which makes reading frames cheaper.
    pub fn without_depth(&self) -> Self {
        Self { depth: None, site: None, ..self.clone() }
    }

    /// At most `max_count` frames, spread evenly: the middles of as many equal parts.
    pub fn spread_frames(&self, max_count: usize) -> impl Iterator<Item = usize> + use<> {
        middles_of_parts(self.frame_count(), max_count)
    }

    /// Streams the frames of a half-open range in order, decoded ahead on separate threads. Memory
    /// does not depend on the range's length. An error ends the stream.
    pub fn frames(&self, range: Range<usize>) -> Result<Frames, RecordingError> {
        if range.start > range.end || range.end > self.frame_count() {
            return Err(RecordingError::Range { start: range.start, end: range.end, count: self.frame_count() });
        }
        if self.is_live() && !range.is_empty() {
            return Err(RecordingError::content(&self.path, "a live camera keeps no frames; freeze it"));
        }
        Frames::new(self, range)
    }
}

/// Middles of at most `max_count` equal parts of `count` frames.
fn middles_of_parts(count: usize, max_count: usize) -> impl Iterator<Item = usize> + use<> {
    let parts = max_count.min(count);
    (0..parts).map(move |n| (2 * n + 1) * count / (2 * parts))
}

fn check(options: &OpenOptions) -> Result<(), RecordingError> {
    let refuse = |name, actual, accepted| Err(RecordingError::Option { name, actual, accepted });
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
fn find(path: &Path) -> Result<(&'static RecordingFormat, PathBuf), RecordingError> {
    if let Some(format) = FORMATS.iter().find_map(|format| Some((*format, (format.find)(path)?))) {
        return Ok(format);
    }
    let unread = unsupported::by_name(path).filter(|_| path.is_file()).map(|kind| format!("it {}", kind.refusal()));
    let in_folder = || {
        let unread = unsupported::unread_warning(&unsupported::in_folder(path))?;
        Some(format!("{unread}, and no file describes a recording"))
    };
    let unposed = || {
        let pictures = still_format::pictures_in(path).unwrap_or_default();
        let problem = format!(
            "it holds {} without poses; `locard solve` finds them",
            crate::text::count(pictures.len(), "picture")
        );
        (!pictures.is_empty()).then_some(problem)
    };
    let foreign = unsupported_capture::refusal(path).map(str::to_owned).or(unread).or_else(in_folder).or_else(unposed);
    let problem = match path {
        _ if foreign.is_some() => foreign.as_deref().unwrap_or_default(),
        _ if is_empty_file(path) => "the file is empty",
        _ if path.is_file() => "this file is not a recording; for a video or pictures alone run `locard solve`",
        _ if path.is_dir() => "the folder has none of the files that identify one",
        _ if path.exists() => "it is a pipe or a device",
        _ => "no such file or folder",
    };
    Err(RecordingError::NotARecording { path: path.to_owned(), actual: problem.to_owned() })
}

fn is_empty_file(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_frames_are_the_middles_of_equal_parts() {
        let spread_frames = |count, max_count| middles_of_parts(count, max_count).collect::<Vec<_>>();
        assert_eq!(spread_frames(240, 24)[..3], [5, 15, 25]);
        assert_eq!(
            (spread_frames(0, 24), spread_frames(3, 24), spread_frames(5, 3)),
            (vec![], vec![0, 1, 2], vec![0, 2, 4])
        );
    }
}
