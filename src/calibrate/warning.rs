//! Warnings about a noise calibration.

use std::fmt;
use std::path::PathBuf;

use crate::text::count;

/// A doubtful measurement. Displays as one line.
#[derive(Clone, Debug, PartialEq)]
pub enum Warning {
    /// The whole picture moves a little from frame to frame. `percent` of the changes is explained
    /// by that.
    Unsteady { scene: usize, percent: f64, known_mean: bool },
    /// Much of the picture moves or drifts.
    Moving { scene: usize, percent: f64 },
    /// Consecutive frames are alike by more than the scene: `percent` of the variance.
    Filtered { scene: usize, percent: f64 },
    /// The whole picture's brightness varies, 8-bit codes.
    Flicker { scene: usize, codes: f64 },
    /// Intensities with fewer independent samples than needed are filled from their neighbours.
    Filled { channel: &'static str, needed: f64, filled: usize, bins: usize },
    /// The frames lie beside the mean that was given, 8-bit codes.
    OffMean { channel: &'static str, code: f64, off: f64 },
    /// A correlation could not be measured.
    NoCorrelation(&'static str),
    /// A correlation is lower than noise can have it.
    LowCorrelation { of: &'static str, measured: f64, written: f64 },
    /// Texture that is everywhere counts as noise.
    Texture,
    /// Compression has changed the noise.
    Jpeg,
    /// Longest stretch at rest of `count` frames; only it is used.
    Stretch { path: PathBuf, first: usize, last: usize, count: usize },
    /// Footage without a stretch at rest beside others that have one.
    LeftOut { path: PathBuf, needed: usize },
    /// Textureless places are used.
    NoSceneAtRest,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsteady { scene, percent, known_mean } => write!(
                f,
                "scene {scene}: the whole picture moves a little from frame to frame ({percent:.0} % of the change); \
                 sigma is too large: is the camera fixed{}?",
                if *known_mean { ", and the mean taken from the same place" } else { "" }
            ),
            Self::Moving { scene, percent } => {
                write!(f, "scene {scene}: {percent:.0} % of the pixels move or drift; is the camera fixed?")
            }
            Self::Filtered { scene, percent } => write!(
                f,
                "scene {scene}: consecutive frames are correlated ({percent:.0} % of the variance in half the \
                 picture): the camera filters over time, or the light drifts; sigma is that of the whole"
            ),
            Self::Flicker { scene, codes } => write!(
                f,
                "scene {scene}: the whole picture's brightness varies by {codes:.2} codes from frame to frame (flicker or \
                 auto-exposure); it is counted as noise"
            ),
            Self::Filled { channel, needed, filled, bins } => write!(
                f,
                "{channel}: fewer than {needed} independent samples in {filled} of {}; filled from the neighbours",
                count(*bins, "bin")
            ),
            Self::OffMean { channel, code, off } => write!(
                f,
                "{channel}: at code {code:.0} the frames lie {off:.1} from the mean given; is it of the same scene and \
                 exposure?"
            ),
            Self::NoCorrelation(of) => {
                write!(f, "correlation {of} could not be measured (too quiet or clipped); 0 is written")
            }
            Self::LowCorrelation { of, measured, written } => {
                write!(f, "correlation {of} is {measured:.2}; {written} is written (sharpening in the camera?)")
            }
            Self::Texture => f.write_str(
                "the intervals are those of chance; texture that is everywhere counts as noise, so sigma may be too large",
            ),
            Self::Jpeg => f.write_str(
                "some frames are JPEG: compression has changed their noise; use lossless frames where you can",
            ),
            Self::Stretch { path, first, last, count } => write!(
                f,
                "{}: frames {first} to {last}, counted from 0, of {count} are at rest and were used",
                path.display()
            ),
            Self::LeftOut { path, needed } => write!(
                f,
                "{}: left out, because nowhere {needed} consecutive frames are at rest",
                path.display()
            ),
            Self::NoSceneAtRest => f.write_str(
                "no scene at rest was found, so the noise is that of textureless places, which is less exact: hold the \
                 camera still for two seconds, or put it on a tripod",
            ),
        }
    }
}
