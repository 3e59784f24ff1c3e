//! Opens a camera and its pose source by their names.

use std::path::Path;
use std::time::{Duration, Instant};

use glam::DVec3;

use super::delayed::delayed;
use super::error::LiveError;
use super::lens_track::{LensTrack, camera_of};
use super::options::{LiveOptions, LiveSpec};
use super::pose_source::PoseSource;
use super::recorded_poses::RecordedPoses;
use super::stream_poses::StreamPoses;
use super::tag_poses::TagPoses;
use crate::camera::Camera;
use crate::pose::Pose;
use crate::profile::Rig;
use crate::recording::recorder::RecordingInfo;
use crate::recording::{FrameCamera, Recording};
use crate::stream::Protocol;
use crate::text::{fixed, shown};
use crate::webcam::{self, FormatRequest};

/// Reads the camera of a profile. Poses from tags need a complete geometry, if the profile has any.
pub fn camera_of_profile(path: &Path, poses: &str) -> Result<Camera, LiveError> {
    let rig = Rig::of_file(path)?;
    let missing = rig.missing_keys();
    if poses.starts_with("tags") && rig.gives_geometry() && !missing.is_empty() {
        return Err(LiveError::IncompleteCamera { path: path.to_owned(), missing });
    }
    Ok(rig.camera())
}

/// A camera with a negotiated format, and its pose source.
pub struct LiveInput {
    pub camera: webcam::WebcamSource,
    pub poses: Box<dyn PoseSource>,
    /// Frame interval, seconds.
    pub interval_s: f64,
    /// The camera's format, and the requested one if it differs.
    pub description: String,
    /// The stream's lens so far, if the pose source has lens data.
    pub lens: Option<StreamLens>,
}

/// A stream's lens before the first picture.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamLens {
    /// Camera made from the lens data.
    pub camera: FrameCamera,
    /// Description of the lens, or the reason why it gives no camera.
    pub description: String,
}

/// Time limit for the first lens data, seconds. Senders repeat static data about once a second.
const LENS_TIMEOUT_S: f64 = 2.0;

/// Waits for the stream's lens data, for pictures of a size, one every `interval_s`.
fn wait_for_lens_data(poses: &mut dyn PoseSource, url: &str, size_px: (u32, u32), interval_s: f64) -> StreamLens {
    let until = Instant::now() + Duration::from_secs_f64(LENS_TIMEOUT_S);
    let Some(state) = poses.wait_for_lens(size_px, until) else {
        let why = poses.no_pose_reason().map_or_else(String::new, |why| format!(": {why}"));
        let description = format!("no lens was received from {url} within {LENS_TIMEOUT_S} s{why}");
        return StreamLens { camera: FrameCamera::default(), description };
    };
    let (camera, remark) = camera_of(&state, size_px, interval_s);
    let description = match (&camera.geometry, remark) {
        (Some(_), None) => format!("the lens is the stream's: {state}"),
        (Some(_), Some(remark)) => format!("the lens is the stream's: {state}; {remark}"),
        (None, why) => format!("the stream's lens is not a complete camera: {}", why.unwrap_or_default()),
    };
    StreamLens { camera, description }
}

/// Opens a camera, or a video in its place, by its number or path, and its poses ([`open_poses`]).
/// The default size is the profile's.
pub fn open(spec: &LiveSpec, profile_camera: Option<&Camera>) -> Result<LiveInput, LiveError> {
    let LiveOptions { driver, size, rate_hz, layout, range, matrix, delay, smooth_s } = spec.options;
    let mut poses = delayed(open_poses(&spec.poses, profile_camera, smooth_s)?, delay, profile_camera)?;
    let geometry = profile_camera.and_then(|camera| camera.geometry.as_ref());
    let profile_px = geometry.map(|geometry| (geometry.intrinsics.width_px, geometry.intrinsics.height_px));
    let defaults = FormatRequest::default();
    let size = size.or(profile_px).unwrap_or(defaults.size);
    let request = FormatRequest { driver, size, rate_hz: rate_hz.unwrap_or(defaults.rate_hz), layout, range, matrix };
    let camera = webcam::open(&spec.camera, &request)?;
    let negotiated = &camera.negotiated;
    let rate_hz = negotiated.rate_hz.unwrap_or(request.rate_hz);
    let hz = |rate: f64| fixed(rate, 2);
    let delivers = format!("{} delivers {} at {} Hz", shown(&negotiated.name), negotiated.picture_format, hz(rate_hz));
    let is_as_requested = (negotiated.picture_format.width, negotiated.picture_format.height) == request.size
        && (rate_hz - request.rate_hz).abs() < 0.05
        && request.layout.is_none_or(|layout| layout == negotiated.picture_format.layout);
    let layout = request.layout.map_or(String::new(), |layout| format!("{layout} "));
    let requested = format!("{}x{} {layout}at {} Hz", request.size.0, request.size.1, hz(request.rate_hz));
    let description = if is_as_requested { delivers } else { format!("{delivers}; {requested} was requested") };
    let description = format!("{description}; {}", negotiated.notes());
    let (size_px, interval_s) = ((negotiated.picture_format.width, negotiated.picture_format.height), 1.0 / rate_hz);
    let lens = poses.has_lens_data().then(|| wait_for_lens_data(&mut *poses, &spec.poses, size_px, interval_s));
    Ok(LiveInput { interval_s, camera, poses, description, lens })
}

impl std::fmt::Debug for LiveInput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.description)
    }
}

impl LiveInput {
    /// Metadata of a recording of this camera. `profile` is the profile's text.
    pub fn about(&self, profile: Option<String>) -> RecordingInfo {
        let negotiated = &self.camera.negotiated;
        RecordingInfo {
            interval_s: self.interval_s,
            max_gap_s: self.poses.max_gap_s(),
            up: self.poses.up(),
            has_floor: self.poses.has_floor(),
            camera: Some(negotiated.name.clone()),
            delivered: Some(negotiated.picture_format.to_string()),
            has_exposure: negotiated.has_exposure,
            has_cameras: self.lens.is_some(),
            profile,
        }
    }

    /// An empty recording of this camera, to build a shot on.
    pub fn recording(&self) -> Recording {
        let (negotiated, poses) = (&self.camera.negotiated, &self.poses);
        let (width, height) = (negotiated.picture_format.width, negotiated.picture_format.height);
        let mut recording = Recording::live(&negotiated.name, width, height, self.interval_s, poses.up());
        recording.has_floor = poses.has_floor();
        recording.warnings.clone_from(&negotiated.warnings);
        self.lens.iter().for_each(|lens| recording.expect(&lens.camera));
        recording
    }

    /// The camera of each frame, if the stream has lens data. The rig's settings override it.
    pub fn lens_track(&self, rig: &Rig) -> Option<LensTrack> {
        let first = self.lens.as_ref()?.camera.clone();
        let format = &self.camera.negotiated.picture_format;
        Some(LensTrack::new((format.width, format.height), self.interval_s, rig.clone(), first))
    }

    /// Longest time that a frame waits for its poses, seconds.
    pub fn max_wait_s(&self) -> f64 {
        if self.poses.has_latency() { self.interval_s } else { 0.0 }
    }
}

/// Opens a pose source: `tags`, `tags:BOARD.toml`, `opentrackio://…`, `freed://…`, `file:RECORDING`
/// or `none`. Tags need the camera's geometry. Only their poses can be smoothed.
pub fn open_poses(
    name: &str,
    camera: Option<&Camera>,
    smooth_s: Option<f64>,
) -> Result<Box<dyn PoseSource>, LiveError> {
    let board = name.strip_prefix("tags:").map(Path::new);
    let is_tags = name == "tags" || board.is_some();
    if smooth_s.is_some() && !is_tags {
        return Err(LiveError::NoSmoothing);
    }
    if name == "none" {
        return Ok(Box::new(NoPoses));
    }
    if is_tags {
        return Ok(Box::new(TagPoses::open(board, camera.ok_or(LiveError::NoCamera)?, smooth_s)?));
    }
    if let Some(path) = name.strip_prefix("file:") {
        return Ok(Box::new(RecordedPoses::open(Path::new(path))?));
    }
    match Protocol::of(name) {
        Some(_) => Ok(Box::new(StreamPoses::open(name)?)),
        None => Err(LiveError::Poses { name: name.to_owned() }),
    }
}

struct NoPoses;

impl PoseSource for NoPoses {
    fn take_poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        Ok(Vec::new())
    }
    fn up(&self) -> Option<DVec3> {
        None
    }
    fn has_latency(&self) -> bool {
        false
    }
    fn has_own_clock(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_pose_source_is_refused() {
        let error = open_poses("http://x", None, None).err().unwrap().to_string();
        assert!(error.contains("opentrackio://…, freed://…, file:RECORDING, none"), "{error}");
        let error = open_poses("tags", None, None).err().unwrap().to_string();
        assert!(error.contains("--profile"), "{error}");
        let error = open_poses("none", None, Some(0.05)).err().unwrap().to_string();
        assert!(error.contains("for poses from tags; leave --smooth out"), "{error}");
        assert!(open_poses("none", None, None).unwrap().take_poses(1e9).unwrap().is_empty());
    }
}
