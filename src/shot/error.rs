//! Errors of opening a shot and of compositing it.

use std::path::PathBuf;

use crate::camera::LensError;
use crate::compositor::{FrameStreamError, SubmitError};
use crate::effects::EffectError;
use crate::gpu::GpuError;
use crate::params::Value;
use crate::profile::{ProfileError, SetError};
use crate::recording::RecordingError;
use crate::scene::SceneError;
use crate::text::count;
use crate::tracking::NoPose;

/// Why a shot could not be opened, or a frame not be composited.
#[derive(Debug, thiserror::Error)]
pub enum ShotError {
    #[error("{}: {problem}; analyse the recording again, or name another folder", folder.display())]
    Analysis { folder: std::path::PathBuf, problem: String },
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Profile(#[from] ProfileError),
    #[error(transparent)]
    Set(#[from] SetError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error("frame {frame}: {source}")]
    Submit { frame: usize, source: SubmitError },
    #[error("frame {frame}: {source}")]
    Gpu { frame: usize, source: GpuError },
    #[error(
        "the camera of {} is unknown: give a profile whose table [camera] has its focal length and principal point \
         (--profile; profiles/ has examples)",
        path.display()
    )]
    NoCamera { path: PathBuf },
    #[error(
        "the given camera is incomplete, and {} has none of its own to complete it: {} must be given too (--profile, \
         --set)",
        path.display(), missing.iter().map(|key| format!("camera.{key}")).collect::<Vec<_>>().join(", ")
    )]
    IncompleteCamera { path: PathBuf, missing: Vec<&'static str> },
    #[error(
        "camera.response.curve is table, and no table is given: camera.response.table has its points, or in a profile \
         the name of a file"
    )]
    NoResponseTable,
    #[error(
        "camera.distortion.model is st_map, and no ST map is given: `undistort` or `redistort` in a profile's table \
         [camera.distortion] name its file"
    )]
    NoLensMap,
    #[error("[camera.distortion]: the ST map {problem}")]
    LensMap { problem: String },
    #[error(
        "the camera's picture is {}x{} px, the recording's frames are {}x{}: camera.width_px and camera.height_px must \
         be the picture size of the intrinsics{}",
        camera.0, camera.1, frames.0, frames.1,
        if (camera.1, camera.0) == *frames { " (frames of a video are turned on reading as it is tagged; [frames] rotation = \"stored\" in recording.toml reads them as stored)" } else { "" }
    )]
    Size { camera: (u32, u32), frames: (u32, u32) },
    #[error("camera.distortion.{name} is not 0, but the model {model} has no {name}; set it to 0, or name its model")]
    Coefficient { name: &'static str, model: Value },
    #[error(
        "the recording has 360° pictures, but the profile's table [camera] describes another camera: omit that table, \
         or set model = \"equirectangular\" in [camera.distortion]"
    )]
    PanoramaCamera,
    #[error("a 360° picture (equirectangular) must be twice as wide as high; found: {width_px}x{height_px}")]
    PanoramaSize { width_px: u32, height_px: u32 },
    #[error(
        "camera.readout_time_s = {actual}: the rows of a 360° picture, which is stitched from \
         several sensors, have no times of their own; expected 0"
    )]
    PanoramaReadout { actual: f64 },
    #[error("{problem}; without that file nothing is written: locate it, or hide the objects that need it")]
    MissingFile { problem: String },
    #[error("frame {frame} has no pose: {source}")]
    NoPose { frame: usize, source: NoPose },
    #[error("none of the recording's {} has a pose; its first one: {source}", count(*frames, "frame"))]
    NoPoses { frames: usize, source: NoPose },
    #[error(
        "the brightness of the scene is unknown: {} of frame {frame} is in neither EXIF nor a profile; give it (--set \
         camera.lens.f_number=…, camera.exposure.time_s=…, camera.exposure.iso=…), or the light (--lux)",
        missing.join(" and ")
    )]
    NoLight { frame: usize, missing: Vec<&'static str> },
    #[error("frame {frame} is black, so the brightness of the scene cannot be estimated; give the light (--lux)")]
    Black { frame: usize },
}

impl From<FrameStreamError<ShotError>> for ShotError {
    fn from(error: FrameStreamError<ShotError>) -> Self {
        match error {
            FrameStreamError::Source(error) => error,
            FrameStreamError::Gpu { frame, source } => Self::Gpu { frame, source },
            FrameStreamError::Submit { frame, source } => Self::Submit { frame, source },
        }
    }
}
