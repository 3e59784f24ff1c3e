//! A camera and a source of poses by what a person calls them.

use std::path::Path;
use std::time::{Duration, Instant};

use glam::DVec3;

use super::asked::{Asked, LiveFrom};
use super::delayed::delayed;
use super::error::LiveError;
use super::lenses::{Lenses, camera_of};
use super::listening::Streamed;
use super::playing::RecordedPoses;
use super::source::PoseSource;
use super::tagged::TaggedPoses;
use crate::camera::Camera;
use crate::pose::Pose;
use crate::profile::Rig;
use crate::recording::recorder::About;
use crate::recording::{FrameCamera, Recording};
use crate::stream::Protocol;
use crate::text::{fixed, shown};
use crate::webcam::{self, Wanted};

/// The camera that a profile describes. `poses` are those that are wanted: tags need a whole camera, if the profile has any.
pub fn profiled(path: &Path, poses: &str) -> Result<Camera, LiveError> {
    let rig = Rig::of_file(path)?;
    let missing = rig.missing_keys();
    if poses.starts_with("tags") && rig.gives_geometry() && !missing.is_empty() {
        return Err(LiveError::PartOfCamera { path: path.to_owned(), missing });
    }
    Ok(rig.camera())
}

/// A camera that has agreed on what it gives, and where its poses come from.
pub struct Opened {
    pub camera: webcam::Camera,
    pub poses: Box<dyn PoseSource>,
    /// From a picture to the next, seconds.
    pub interval_s: f64,
    /// What the camera gives, and what was asked for where that is something else.
    pub said: String,
    /// What was heard of the stream's lens so far, if it is one that says it.
    pub lens: Option<StreamLens>,
}

/// What is known of a stream's lens before the first picture.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamLens {
    /// What it makes of the pictures' camera.
    pub camera: FrameCamera,
    /// What of it is used, or why it makes no camera.
    pub told: String,
}

/// Senders say what stays the same once a second, or a little less often, seconds.
const LENS_WITHIN_S: f64 = 2.0;

/// Waits for what a stream says of its lens, for pictures of a size, one every `interval_s`.
fn hear_lens(poses: &mut dyn PoseSource, url: &str, size_px: (u32, u32), interval_s: f64) -> StreamLens {
    let until = Instant::now() + Duration::from_secs_f64(LENS_WITHIN_S);
    let Some(state) = poses.first_lens(size_px, until) else {
        let why = poses.lacks().map_or_else(String::new, |why| format!(": {why}"));
        let told = format!("no lens is known from {url} within {LENS_WITHIN_S} s{why}");
        return StreamLens { camera: FrameCamera::default(), told };
    };
    let (camera, told) = camera_of(&state, size_px, interval_s);
    let told = match (&camera.geometry, told) {
        (Some(_), None) => format!("the lens is the stream's: {state}"),
        (Some(_), Some(told)) => format!("the lens is the stream's: {state}; {told}"),
        (None, why) => format!("the stream's lens makes no camera: {}", why.unwrap_or_default()),
    };
    StreamLens { camera, told }
}

/// Opens a camera by its number or device, or a video in its place, and its poses ([`open_poses`]). Without a size it is the
/// profile's.
pub fn open(from: &LiveFrom, profiled: Option<&Camera>) -> Result<Opened, LiveError> {
    let Asked { driver, size, rate_hz, layout, range, matrix, delay, smooth_s } = from.asked;
    let mut poses = delayed(open_poses(&from.poses, profiled, smooth_s)?, delay, profiled)?;
    let geometry = profiled.and_then(|camera| camera.geometry.as_ref());
    let profile_px = geometry.map(|geometry| (geometry.intrinsics.width_px, geometry.intrinsics.height_px));
    let usual = Wanted::default();
    let size = size.or(profile_px).unwrap_or(usual.size);
    let wanted = Wanted { driver, size, rate_hz: rate_hz.unwrap_or(usual.rate_hz), layout, range, matrix };
    let camera = webcam::open(&from.camera, &wanted)?;
    let given = &camera.given;
    let rate_hz = given.rate_hz.unwrap_or(wanted.rate_hz);
    let hz = |rate: f64| fixed(rate, 2);
    let gives = format!("{} gives {} at {} Hz", shown(&given.name), given.delivered, hz(rate_hz));
    let as_asked = (given.delivered.width, given.delivered.height) == wanted.size
        && (rate_hz - wanted.rate_hz).abs() < 0.05
        && wanted.layout.is_none_or(|layout| layout == given.delivered.layout);
    let layout = wanted.layout.map_or(String::new(), |layout| format!("{layout} "));
    let asked = format!("{}x{} {layout}at {} Hz", wanted.size.0, wanted.size.1, hz(wanted.rate_hz));
    let said = if as_asked { gives } else { format!("{gives}; asked for was {asked}") };
    let said = format!("{said}; {}", given.notes());
    let (size_px, interval_s) = ((given.delivered.width, given.delivered.height), 1.0 / rate_hz);
    let lens = poses.says_lens().then(|| hear_lens(&mut *poses, &from.poses, size_px, interval_s));
    Ok(Opened { interval_s, camera, poses, said, lens })
}

impl std::fmt::Debug for Opened {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.said)
    }
}

impl Opened {
    /// What a recording says of its camera and poses; `profile` is the camera's, as text.
    pub fn about(&self, profile: Option<String>) -> About {
        let given = &self.camera.given;
        About {
            interval_s: self.interval_s,
            max_gap_s: self.poses.max_gap_s(),
            up: self.poses.up(),
            has_floor: self.poses.has_floor(),
            camera: Some(given.name.clone()),
            delivered: Some(given.delivered.to_string()),
            has_exposure: given.has_exposure,
            has_cameras: self.lens.is_some(),
            profile,
        }
    }

    /// A recording of what is to come, for the camera, the scene and the settings to be put to.
    pub fn recording(&self) -> Recording {
        let (given, poses) = (&self.camera.given, &self.poses);
        let (width, height) = (given.delivered.width, given.delivered.height);
        let mut recording = Recording::arriving(&given.name, width, height, self.interval_s, poses.up());
        recording.has_floor = poses.has_floor();
        recording.warnings.clone_from(&given.warnings);
        self.lens.iter().for_each(|lens| recording.expect(&lens.camera));
        recording
    }

    /// The frames' cameras under what a rig sets, where a stream says its lens.
    pub fn lenses(&self, rig: &Rig) -> Option<Lenses> {
        let first = self.lens.as_ref()?.camera.clone();
        let delivered = &self.camera.given.delivered;
        Some(Lenses::new((delivered.width, delivered.height), self.interval_s, rig.clone(), first))
    }

    /// How long frames wait for their poses at most, seconds.
    pub fn patience_s(&self) -> f64 {
        if self.poses.are_awaited() { self.interval_s } else { 0.0 }
    }
}

/// `tags`, `tags:BOARD.toml`, `opentrackio://…`, `freed://…`, `file:RECORDING`, or `none`. Tags are seen by a camera; their poses
/// alone are smoothed.
pub fn open_poses(
    asked: &str,
    camera: Option<&Camera>,
    smooth_s: Option<f64>,
) -> Result<Box<dyn PoseSource>, LiveError> {
    let board = asked.strip_prefix("tags:").map(Path::new);
    let is_tags = asked == "tags" || board.is_some();
    if smooth_s.is_some() && !is_tags {
        return Err(LiveError::NoSmoothing);
    }
    if asked == "none" {
        return Ok(Box::new(NoPoses));
    }
    if is_tags {
        return Ok(Box::new(TaggedPoses::open(board, camera.ok_or(LiveError::NoCamera)?, smooth_s)?));
    }
    if let Some(path) = asked.strip_prefix("file:") {
        return Ok(Box::new(RecordedPoses::open(Path::new(path))?));
    }
    match Protocol::of(asked) {
        Some(_) => Ok(Box::new(Streamed::open(asked)?)),
        None => Err(LiveError::Poses { asked: asked.to_owned() }),
    }
}

struct NoPoses;

impl PoseSource for NoPoses {
    fn poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        Ok(Vec::new())
    }
    fn up(&self) -> Option<DVec3> {
        None
    }
    fn are_awaited(&self) -> bool {
        false
    }
    fn has_clock(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_gives_no_poses_is_refused() {
        let error = open_poses("http://x", None, None).err().unwrap().to_string();
        assert!(error.contains("opentrackio://…, freed://…, file:RECORDING, none"), "{error}");
        let error = open_poses("tags", None, None).err().unwrap().to_string();
        assert!(error.contains("--profile"), "{error}");
        let error = open_poses("none", None, Some(0.05)).err().unwrap().to_string();
        assert!(error.contains("for poses from tags; leave --smooth out"), "{error}");
        assert!(open_poses("none", None, None).unwrap().poses(1e9).unwrap().is_empty());
    }
}
