//! Calibrated noise by example, and its report.

use std::fmt;

use crate::example_noise::{ModelError, NoiseModel};
use crate::text::count;

/// Fewest frames of a scene without a clean picture.
pub const MIN_FRAMES: usize = 4;
/// Frames of half a second to a second, from which the mean has little noise left.
const RECOMMENDED_FRAMES: usize = 16;
/// Width of the range of codes below which more content is recommended.
const RECOMMENDED_CODE_RANGE: f32 = 128.0;

/// How the clean picture was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExampleMethod {
    /// The mean of `frames` frames at rest.
    Resting { frames: usize },
    /// The given picture.
    Pairs,
    /// A Gaussian mean over textureless pixels.
    Textureless,
}

/// A model with a description of its origin; prints as lines of a report.
#[derive(Clone, Debug, PartialEq)]
pub struct ExampleCalibration {
    pub model: NoiseModel,
    pub method: ExampleMethod,
    /// Share of the pixels that did not move, 0 to 1.
    pub usable_share: f64,
    /// Codes of the clean pictures between which 98 % of their values are.
    pub code_range: [f32; 2],
    /// Median over intensities of the relative difference between the standard deviations of
    /// synthesised and real noise. `None` if there are too few pixels.
    pub sigma_error: Option<f64>,
}

/// Why there is no noise by example.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoExample {
    #[error(
        "{} at rest; at least {MIN_FRAMES} are needed, {RECOMMENDED_FRAMES} are better: hold the camera still for two seconds",
        count(*frames, "frame")
    )]
    TooFewFrames { frames: usize },
    #[error("the pictures have 16 bits for each channel, but noise by example needs pictures of 8 bits")]
    Depth,
    #[error("the scenes have different sizes; give scenes of one size")]
    Sizes,
    #[error(
        "too little of the pictures is without texture: hold the camera still for two seconds, or use `locard analyse`, \
         which makes it from a recording with measured depth"
    )]
    Textured,
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl fmt::Display for ExampleCalibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sources = &self.model.sources;
        let megapixels = sources.iter().map(|source| source.size[0] * source.size[1]).sum::<usize>() as f64 / 1e6;
        let parts = count(sources.len(), "part");
        match self.method {
            ExampleMethod::Resting { frames } => {
                write!(f, "noise by example, from {} at rest", count(frames, "frame"))?;
            }
            ExampleMethod::Pairs => write!(f, "noise by example, from frames with a clean picture")?,
            ExampleMethod::Textureless => write!(f, "noise by example, from places without texture")?,
        }
        writeln!(f, ": {parts} of {megapixels:.1} Mpx in all, {:.0} % of it usable", 100.0 * self.usable_share)?;
        if let Some(error) = self.sigma_error {
            writeln!(
                f,
                "its sigma differs from that of the frames by {:.0} % (median over intensities)",
                100.0 * error
            )?;
        }
        match self.method {
            ExampleMethod::Resting { frames } if frames < RECOMMENDED_FRAMES => writeln!(
                f,
                "note: {RECOMMENDED_FRAMES} or more frames give a cleaner mean: hold the camera still for two seconds"
            )?,
            _ => {}
        }
        if self.method == ExampleMethod::Textureless {
            writeln!(
                f,
                "note: a camera at rest gives examples of textures and edges too: hold it still for two seconds. For a \
                 recording with measured depth `locard analyse` makes better ones by its neighbouring frames; composite \
                 it without this profile, whose examples come first"
            )?;
        }
        let [dark, bright] = self.code_range;
        if bright - dark < RECOMMENDED_CODE_RANGE {
            writeln!(
                f,
                "note: the pictures have codes from {dark:.0} to {bright:.0} alone; other content gets the noise of the \
                 most similar: record dark and bright, smooth and detailed surfaces"
            )?;
        }
        Ok(())
    }
}
