//! Errors of live compositing and recording.

use std::path::PathBuf;

use crate::camera::LensError;
use crate::compositor::SubmitError;
use crate::gpu::GpuError;
use crate::profile::ProfileError;
use crate::recording::RecordingError;
use crate::recording::recorder::RecorderError;
use crate::shot::ShotError;
use crate::stream::StreamError;
use crate::tags::{BoardError, DetectError};
use crate::webcam::CameraError;

/// Why a live session could not start, or had to end.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    #[error(
        "{name}: is not a source of poses; expected tags, tags:BOARD.toml, opentrackio://…, freed://…, \
         file:RECORDING, none"
    )]
    Poses { name: String },
    #[error("{}: the recording has no poses", path.display())]
    NoPoses { path: PathBuf },
    #[error(
        "poses from tags need the camera's focal length, from its profile (--profile; `locard calibrate camera` writes \
         one)"
    )]
    NoCamera,
    #[error("{}: [camera] lacks {}: poses from tags need a complete camera", path.display(), missing.join(", "))]
    IncompleteCamera { path: PathBuf, missing: Vec<&'static str> },
    #[error(transparent)]
    Profile(#[from] ProfileError),
    #[error("a delay is refused: these poses come from the pictures themselves, or there are none; leave --delay out")]
    NoDelay,
    #[error("smoothing is refused: it is for poses from tags; leave --smooth out")]
    NoSmoothing,
    #[error(
        "--delay auto needs the camera's focal length, and pictures that fit a plane: name its --profile, as `locard calibrate camera` writes one, or give --delay in seconds"
    )]
    DelayNeedsCamera,
    #[error(transparent)]
    Camera(#[from] CameraError),
    #[error(transparent)]
    Board(#[from] BoardError),
    #[error(transparent)]
    Detect(#[from] DetectError),
    #[error(transparent)]
    Stream(#[from] StreamError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    #[error("a thread could not be started: {0}")]
    Thread(std::io::Error),
    #[error(transparent)]
    Shot(#[from] ShotError),
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error("frame {frame}: {source}")]
    Submit { frame: usize, source: SubmitError },
    #[error("frame {frame}: {source}")]
    Gpu { frame: usize, source: GpuError },
}
