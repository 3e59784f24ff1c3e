//! Errors of solving, and its stages.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use glam::DVec2;

use crate::camera::LensModel;
use crate::params::Field;
use crate::program::ProgramError;
use crate::recording::RecordingError;
use crate::source::SourceError;
use crate::tags::DetectError;
use crate::text::{count, fixed, number, reason};

/// The stages of solving that are shown to a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolveStage {
    Selection,
    Features,
    Matches,
    Mapping,
    Poses,
}

impl SolveStage {
    pub fn name(self) -> &'static str {
        match self {
            Self::Selection => "sharp frames",
            Self::Features => "features",
            Self::Matches => "matches",
            Self::Mapping => "camera path",
            Self::Poses => "frames between",
        }
    }
}

/// Advice for footage that cannot be solved.
const FOOTAGE_ADVICE: &str = "the camera must move sideways, not only turn; neighbouring frames must overlap by most of \
                              the picture; surfaces need texture; move slowly, in good light";

/// Why there is no solution.
#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Detect(#[from] DetectError),
    #[error(transparent)]
    Program(#[from] ProgramError),
    #[error("{}: cannot be written: {}", path.display(), reason(source))]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{}: holds no pictures", .0.display())]
    NoPictures(PathBuf),
    #[error("{}: is {}x{} px, but {} is {}x{}: pictures of one camera and one size are needed", file.display(), size.0, size.1, first.display(), expected.0, expected.1)]
    Sizes { file: PathBuf, size: (u32, u32), first: PathBuf, expected: (u32, u32) },
    #[error("the footage is {}x{} px and the profile's camera {}x{}: name the profile of the camera as it was when it recorded", footage.0, footage.1, camera.0, camera.1)]
    CameraSize { footage: (u32, u32), camera: (u32, u32) },
    #[error("{}: its pixels are not square but {}:{}, and the lens is estimated for square ones: give the camera's profile (`locard calibrate camera` makes one), or make them square first (ffmpeg -i FILE -vf scale=iw*sar:ih,setsar=1 -c:v ffv1 NEW.mkv)", file.display(), aspect.0, aspect.1)]
    PixelAspect { file: PathBuf, aspect: (u32, u32) },
    #[error("COLMAP has no lens of the model {}; omit --profile: the lens is estimated then", Field::to_value(.0))]
    Lens(LensModel),
    #[error("{}; at least 3 are needed", count(*.0, "frame"))]
    TooFew(usize),
    #[error("no frames fit together; {FOOTAGE_ADVICE}")]
    NoModel,
    #[error("only {frames} of {} fit together, frames {} to {}; {FOOTAGE_ADVICE}", count(*chosen, "chosen frame"), span.start(), span.end())]
    SmallModel { frames: usize, chosen: usize, span: RangeInclusive<usize> },
    #[error("the estimated focal length is {} px in a picture {width_px} px wide: the motion does not determine it; give the camera's profile (`locard calibrate camera` makes one), or {FOOTAGE_ADVICE}", fixed(*focal_px, 0))]
    Focal { focal_px: f64, width_px: u32 },
    #[error("the board's file does not describe the tags in the pictures: their corners are {} mm off a board of {} mm", fixed(1e3 * rms_m, 1), fixed(1e3 * extent_m, 0))]
    Board { rms_m: f64, extent_m: f64 },
    #[error("the measured distance is in frame {frame}: expected a frame below {count}, and points within {}x{} px", size.0, size.1)]
    DistanceOutside { frame: usize, count: usize, size: (u32, u32) },
    #[error("frame {frame} of the measured distance is not among the solved frames; the nearest is {nearest}")]
    DistanceFrame { frame: usize, nearest: usize },
    #[error("the point {}, {} of frame {frame} is not found in other frames; pick a corner or a spot with texture that several frames show from different sides", number(at_px.x), number(at_px.y))]
    DistancePoint { frame: usize, at_px: DVec2 },
    #[error("stopped")]
    Stopped,
}

impl SolveError {
    pub(super) fn writing(path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Write { path, source }
    }
}
