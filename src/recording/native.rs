//! Locard's own format: `recording.toml` references all files. docs/recordings.md documents every
//! key.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::camera_file::{self, SensorPose};
use super::cameras::parse_cameras;
use super::depth::{DepthEncoding, DepthFiles};
use super::parts::{Parts, Pictures, RecordingFormat, file_or_in_folder, track_from};
use super::{OpenOptions, RecordingError, listing};
use crate::coding::{ColorMatrix, ColorRange};
use crate::depth::DepthCamera;
use crate::document;
use crate::pose::Pose;
use crate::source::unsupported;
use crate::source::video::{self, Overrides};
use crate::text::number;
use crate::tracking::matchmove::{self, FrameNumbering};
use crate::tracking::records;
use crate::tracking::tum::{Trajectory, parse_trajectory};

pub const FILE_NAME: &str = "recording.toml";
/// Number of the first frame in camera files, as in Nuke and Blender.
const DEFAULT_FIRST_FRAME: i64 = 1;

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: FILE_NAME,
    has_times: true,
    is_metric: true,
    find: |path| {
        if path.is_file() && path.extension().is_some_and(|ending| ending == "toml") {
            Some(path.to_owned())
        } else {
            file_or_in_folder(path, FILE_NAME)
        }
    },
    open: |file, _, options| open(file, options),
};

/// The contents of `recording.toml`. Paths are relative to its folder.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    pub version: u32,
    pub name: Option<String>,
    /// Any length but 0.
    pub up: Option<[f64; 3]>,
    /// True if the plane through the world's origin, perpendicular to `up`, is a surface.
    #[serde(default, skip_serializing_if = "is_default")]
    pub floor: bool,
    pub frames: FrameFiles,
    #[serde(default, skip_serializing_if = "is_default")]
    pub poses: PoseFile,
    pub depth: Option<DepthList>,
    pub exposure: Option<ExposureList>,
    pub camera: Option<CameraFile>,
    pub live: Option<LiveMetadata>,
}

/// Exactly one of `list`, `images` and `video`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FrameFiles {
    pub list: Option<PathBuf>,
    pub images: Option<PathBuf>,
    pub video: Option<PathBuf>,
    pub fps: Option<f64>,
    pub range: Option<ColorRange>,
    pub matrix: Option<ColorMatrix>,
    pub rotation: Option<VideoRotation>,
}

/// Treatment of the rotation that a video states.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum VideoRotation {
    /// Frames are turned on reading, as players and other programs do.
    Applied,
    /// Frames are read as stored, for poses of the sensor.
    Stored,
}

/// The table `[poses]`: file of the trajectory, and times in s.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PoseFile {
    pub trajectory: Option<PathBuf>,
    /// Number of the first frame in the camera file of another program; [`DEFAULT_FIRST_FRAME`]
    /// without it.
    pub first_frame: Option<i64>,
    /// Frames per second of a glTF camera at a constant rate.
    pub fps: Option<f64>,
    pub time_offset_s: Option<f64>,
    pub max_gap_s: Option<f64>,
}

/// The table `[depth]`: list of the depth maps, and their encoding.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DepthList {
    pub list: PathBuf,
    /// Code values per metre.
    pub scale: f64,
    /// The file whose table `[camera]` describes the depth camera, if it is not the frames'.
    pub camera: Option<PathBuf>,
    /// Pose of the depth camera in the axes of the frames' camera; identity if missing.
    pub colour_from_depth: Option<SensorPose>,
}

/// The table `[exposure]`: list of the frames' exposures.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureList {
    pub list: PathBuf,
}

/// A camera file with at least one of `profile`, `kind` and `list`; `kind` and `list` exclude each
/// other.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFile {
    pub profile: Option<PathBuf>,
    pub kind: Option<CameraKind>,
    /// The camera and lens of each frame, as reported by a tracking system: they override the
    /// profile's.
    pub list: Option<PathBuf>,
}

/// Kind of camera, if the recording states it.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraKind {
    Equirectangular,
}

/// Metadata of a recording of a live camera (recorder.rs).
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LiveMetadata {
    /// Nominal interval between frames, seconds, regardless of drops.
    pub interval_s: f64,
    /// Name of the camera.
    pub camera: Option<String>,
    pub delivered: Option<String>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Parses the description and checks all rules that need no other files.
pub fn parse(text: &str, file: &Path) -> Result<Description, RecordingError> {
    let description: Description = document::read(text).map_err(|e| RecordingError::content(file, e))?;
    check(&description).map_err(|problem| RecordingError::content(file, problem))?;
    Ok(description)
}

fn check(d: &Description) -> Result<(), String> {
    if d.version != 1 {
        return Err(format!("version = {} is not known; expected 1", d.version));
    }
    if d.floor && d.up.is_none() {
        return Err("floor = true needs up: the floor is perpendicular to it, through the origin".to_owned());
    }
    if let Some(up) = d.up.filter(|up| DVec3::from_array(*up).try_normalize().is_none()) {
        return Err(format!("up = {up:?} is not a direction"));
    }
    let f = &d.frames;
    match (&f.list, &f.images, &f.video) {
        (Some(_), None, None) if f.fps.is_some() => return Err("frames.fps does not go with frames.list".to_owned()),
        (None, Some(_), None) if f.fps.is_none() => return Err("frames.images needs frames.fps".to_owned()),
        (Some(_), None, None) | (None, Some(_), None) | (None, None, Some(_)) => {}
        _ => return Err("[frames] needs exactly one of list, images, video".to_owned()),
    }
    if f.video.is_none() && (f.range.is_some() || f.matrix.is_some() || f.rotation.is_some()) {
        return Err("frames.range, frames.matrix and frames.rotation go with frames.video only".to_owned());
    }
    match &d.camera {
        Some(CameraFile { profile: None, kind: None, list: None }) => {
            return Err("[camera] needs profile, kind = \"equirectangular\" or list".to_owned());
        }
        Some(CameraFile { kind: Some(_), list: Some(_), .. }) => {
            return Err("camera.kind and camera.list do not go together: a 360° picture has no lens".to_owned());
        }
        _ => {}
    }
    if d.live.is_some() && f.list.is_none() {
        return Err("[live] goes with frames.list only".to_owned());
    }
    above_zero("live.interval_s", d.live.as_ref().map(|live| live.interval_s))?;
    if let Some(depth) = d.depth.as_ref().filter(|depth| depth.colour_from_depth.is_some()) {
        if depth.camera.is_none() {
            return Err("depth.colour_from_depth goes with depth.camera only".to_owned());
        }
        depth.colour_from_depth.iter().try_for_each(|placement| placement.pose().map(drop))?;
    }
    above_zero("frames.fps", f.fps)?;
    above_zero("poses.max_gap_s", d.poses.max_gap_s)?;
    above_zero("depth.scale", d.depth.as_ref().map(|depth| depth.scale))?;
    let is_camera_file = d.poses.trajectory.as_deref().is_some_and(matchmove::is_camera_file);
    if (d.poses.first_frame.is_some() || d.poses.fps.is_some()) && !is_camera_file {
        let files = "a trajectory that is a .chan, .usda, .gltf or .glb file";
        return Err(format!("poses.first_frame and poses.fps go with {files}"));
    }
    above_zero("poses.fps", d.poses.fps)?;
    match d.poses.time_offset_s {
        Some(offset) if !offset.is_finite() => Err(format!("poses.time_offset_s = {offset} must be finite")),
        _ => Ok(()),
    }
}

fn above_zero(name: &str, value: Option<f64>) -> Result<(), String> {
    match value {
        Some(v) if !(v.is_finite() && v > 0.0) => Err(format!("{name} = {} must be finite and above 0", number(v))),
        _ => Ok(()),
    }
}

fn open(file: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let description = parse(&records::read_description(file)?, file)?;
    let folder = file.parent().unwrap_or(Path::new(""));
    // After a power cut the file may end in the middle of a line.
    let mut unended = Vec::new();
    let is_live = description.live.is_some();
    let mut read = |path: &Path| -> Result<String, RecordingError> {
        let mut text = records::read(path)?;
        if is_live && let Some(line) = records::drop_unended(&mut text) {
            unended.push(format!("{}: the last line, {line}, is incomplete and left out", path.display()));
        }
        Ok(text)
    };
    let frames = open_frames(&description.frames, folder, file, &mut read)?;
    let mut parts = Parts::new(folder, frames.pictures, frames.timestamps_s);
    parts.opacity = frames.opacity;
    parts.warnings = frames.warnings;
    parts.interval_s = description.live.as_ref().map(|live| live.interval_s);
    parts.estimates_coding = !is_live;
    if let Some(name) = description.name {
        parts.name = name;
    }
    parts.up = description.up.and_then(|up| DVec3::from_array(up).try_normalize());
    parts.has_floor = description.floor;
    let (trajectory, named) = match &description.poses.trajectory {
        Some(name) => {
            let path = folder.join(name);
            if matchmove::is_camera_file(&path) {
                (open_camera_file(&path, &description.poses, &mut parts)?, path)
            } else {
                (parse_trajectory(&read(&path)?, &path)?, path)
            }
        }
        None => (Trajectory::default(), file.to_owned()),
    };
    parts.warnings.extend(trajectory.warnings);
    let track = track_from(trajectory.poses, options.max_gap_s.or(description.poses.max_gap_s), &named)?;
    parts.track = track.with_clock_offset_s(description.poses.time_offset_s.unwrap_or(0.0));
    if let Some(depth) = &description.depth {
        let files = listing::read_pictures(&folder.join(&depth.list))?;
        let mut stored = DepthEncoding::plain(depth.scale);
        if let Some(camera) = &depth.camera {
            let camera = folder.join(camera);
            let placed = depth.colour_from_depth.map_or(Ok(Pose::IDENTITY), |placement| placement.pose());
            let colour_from_depth = placed.map_err(|problem| RecordingError::content(file, problem))?;
            stored.camera = Some(DepthCamera::new(camera_file::read(&camera)?, colour_from_depth));
            parts.description_files.push(camera);
        }
        parts.depth = Some(DepthFiles { by_time: files, stored });
    }
    if let Some(exposure) = &description.exposure {
        let path = folder.join(&exposure.list);
        parts.exposure = listing::parse_exposures(&read(&path)?, &path)?;
    }
    let cameras = description.camera.as_ref().and_then(|camera| camera.list.clone());
    if let Some(list) = &cameras {
        let path = folder.join(list);
        parts.cameras = Some(parse_cameras(&read(&path)?, &path)?);
    }
    parts.warnings.extend(unended);
    let lists =
        [description.depth.map(|depth| depth.list), description.exposure.map(|exposure| exposure.list), cameras];
    let named = [description.frames.list, description.poses.trajectory].into_iter().chain(lists);
    parts.description_files.push(file.to_owned());
    parts.description_files.extend(named.flatten().map(|name| folder.join(name)));
    if let Some(camera) = description.camera {
        parts.equirectangular = camera.kind == Some(CameraKind::Equirectangular);
        parts.camera_profile = camera.profile.map(|profile| folder.join(profile));
    }
    Ok(parts)
}

/// The trajectory of another program's camera file. Without the recording's own up, up is that of
/// the file.
fn open_camera_file(path: &Path, poses: &PoseFile, parts: &mut Parts) -> Result<Trajectory, RecordingError> {
    let camera = matchmove::read(path)?;
    let first_frame = poses.first_frame.unwrap_or(DEFAULT_FIRST_FRAME) as f64;
    let clock = FrameNumbering { first_frame, fps: poses.fps };
    let trajectory = camera.trajectory(&parts.timestamps_s, clock, parts.up);
    parts.up = parts.up.or(Some(camera.up));
    let warnings = camera.warnings.iter().map(|text| format!("{}: {text}", path.display())).collect();
    Ok(Trajectory { poses: trajectory, warnings })
}

/// The frames, by whichever key references them.
struct OpenedFrames {
    pictures: Pictures,
    timestamps_s: Vec<f64>,
    /// [`Parts::opacity`].
    opacity: Vec<f64>,
    warnings: Vec<String>,
}

fn open_frames(
    frames: &FrameFiles,
    folder: &Path,
    file: &Path,
    mut read: impl FnMut(&Path) -> Result<String, RecordingError>,
) -> Result<OpenedFrames, RecordingError> {
    if let Some(name) = &frames.video {
        let as_stored = frames.rotation == Some(VideoRotation::Stored);
        let overrides = Overrides { fps: frames.fps, range: frames.range, matrix: frames.matrix, as_stored };
        let video = video::probe(&folder.join(name), &overrides)?;
        let (timestamps_s, warnings) = (video.timestamps_s.clone(), video.warnings.clone());
        return Ok(OpenedFrames {
            pictures: Pictures::Video(Box::new(video), None),
            timestamps_s,
            opacity: Vec::new(),
            warnings,
        });
    }
    if let (Some(name), Some(fps)) = (&frames.images, frames.fps) {
        return open_images(&folder.join(name), fps);
    }
    let list = frames.list.as_ref().ok_or_else(|| RecordingError::content(file, "[frames] names nothing"))?;
    let list = folder.join(list);
    let (mut files, mut timestamps_s, mut opacity) = (Vec::new(), Vec::new(), Vec::new());
    for (time_s, file, present) in listing::frames(&read(&list)?, &list)? {
        files.push(file);
        timestamps_s.push(time_s);
        opacity.push(present);
    }
    Ok(OpenedFrames { pictures: Pictures::Stills(files), timestamps_s, opacity, warnings: Vec::new() })
}

/// The pictures of a folder at a constant rate. An unsupported picture is no frame, but keeps its
/// place in time.
fn open_images(folder: &Path, fps: f64) -> Result<OpenedFrames, RecordingError> {
    let mut files = listing::pictures_in(folder)?;
    let unread = unsupported::in_folder(folder);
    let mut warnings: Vec<String> = unsupported::unread_warning(&unread).into_iter().collect();
    if let Some(message) = warnings.first().filter(|_| files.is_empty()) {
        return Err(RecordingError::content(folder, message));
    }
    files.extend(unread.iter().cloned());
    files.sort_by(|a, b| listing::natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    warnings.extend(listing::missing_numbers(&files));
    let unread: HashSet<PathBuf> = unread.into_iter().collect();
    let timed = files.into_iter().enumerate().map(|(i, file)| (i as f64 / fps, file));
    let (timestamps_s, files) = timed.filter(|(_, file)| !unread.contains(file)).unzip();
    Ok(OpenedFrames { pictures: Pictures::Stills(files), timestamps_s, opacity: Vec::new(), warnings })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn refused(text: &str) -> String {
        parse(text, Path::new("recording.toml")).unwrap_err().to_string()
    }

    #[test]
    fn unknown_key_error_names_file_line_and_accepted_keys() {
        let error = refused("version = 1\n[frames]\nlist = \"rgb.txt\"\nfsp = 3.0\n");
        assert!(error.starts_with("recording.toml: line 4, frames.fsp: unknown field `fsp`"), "{error}");
        for key in ["list", "images", "video", "fps", "range", "matrix"] {
            assert!(error.contains(&format!("`{key}`")), "{error}");
        }
    }

    #[test]
    fn contradictory_descriptions_are_refused() {
        for (text, said) in [
            ("version = 2\n[frames]\nlist = \"a\"", "version = 2"),
            ("version = 1\n[frames]", "exactly one of list, images, video"),
            ("version = 1\n[frames]\nlist = = 3", "line 3, frames.list: "),
            ("version = 1\n[frames]\nlist = \"a\"\nvideo = \"b\"", "exactly one of list, images, video"),
            ("version = 1\n[frames]\nimages = \"a\"", "needs frames.fps"),
            ("version = 1\n[frames]\nlist = \"a\"\nfps = 3.0", "does not go with"),
            ("version = 1\n[frames]\nlist = \"a\"\nrange = \"full\"", "frames.video only"),
            ("version = 1\n[frames]\nlist = \"a\"\nrotation = \"stored\"", "frames.video only"),
            ("version = 1\n[frames]\nvideo = \"a\"\nrotation = \"left\"", "unknown variant `left`"),
            ("version = 1\n[frames]\nvideo = \"a\"\nrange = \"wide\"", "unknown variant `wide`"),
            ("version = 1\n[frames]\nimages = \"a\"\nfps = nan", "frames.fps = NaN"),
            ("version = 1\nup = [0, 0, 0]\n[frames]\nlist = \"a\"", "up = [0.0, 0.0, 0.0]"),
            ("version = 1\nfloor = true\n[frames]\nlist = \"a\"", "floor = true needs up"),
            ("version = 1\n[frames]\nlist = \"a\"\n[depth]\nlist = \"d\"\nscale = 0.0", "depth.scale = 0"),
            ("version = 1\n[frames]\nlist = \"a\"\n[camera]", "[camera] needs profile, kind"),
            ("version = 1\n[frames]\nlist = \"a\"\n[camera]\nkind = \"round\"", "expected `equirectangular`"),
            ("version = 1", "missing field `frames`"),
            (
                "version = 1\n[frames]\nlist = \"a\"\n[poses]\ntrajectory = \"a.txt\"\nfirst_frame = 1",
                "poses.first_frame and poses.fps go",
            ),
            ("version = 1\n[frames]\nvideo = \"a\"\n[live]\ninterval_s = 0.1", "[live] goes with frames.list only"),
            ("version = 1\n[frames]\nlist = \"a\"\n[live]\ninterval_s = 0.0", "live.interval_s = 0"),
        ] {
            let error = refused(text);
            assert!(error.contains(said) && error.starts_with("recording.toml: ") && !error.contains('\n'), "{error}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "version = 1\n\\[frames\\]\n[a-z_]{2,6} = [\"a-z0-9.\\[\\]]{0,9}\n") {
            let _ = parse(&text, Path::new("recording.toml"));
            let _ = parse(&near, Path::new("recording.toml"));
        }
    }
}
