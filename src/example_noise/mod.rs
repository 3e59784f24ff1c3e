//! Camera noise by example: residuals of real frames, normalised by their predicted amplitude, are
//! reassembled on other content.
//!
//! Noise lives in the planes Y', Cb and Cr of the camera's coding (`PictureCoding`), after chroma
//! subsampling and before the DCT. Without quantisation the same planes are rounded to 8 bits.
//! Places are px of the coded picture: the picture with the padding that its block grid needs
//! before its first pixel.
//!
//! Calibration, once: [`content`] (features φ), [`bands`], [`regression`] (amplitudes),
//! [`latent`] (clipping), [`atlas`] (normalised innovations), [`calibration`] (indirect inference
//! of amplitudes and clipping). Synthesis, for each frame: [`cells`] and [`synthesis`]. Everything
//! there is a function of the key, the place and the content within 80 px: no state, no order.
//!
//! Steps of the synthesis. The second is three passes of shaders, the others are one each:
//!
//! | step | result | reads around a px |
//! |---|---|---|
//! | brightness, its squared gradient and fine detail | 2 values per px | 1 px |
//! | their means and smoothed means over 2 × 2 px | 3 values per block | 4 blocks |
//! | source of each cell, by its descriptor | frame, x, y, mirroring per cell | the cell |
//! | standardised features, and noise of Y' | 8 values per px | at most 4 cells |
//! | noise of Cb and Cr | 2 values per chroma sample | at most 4 cells |
//!
//! Sources: Starck and Murtagh 1994 (bands), McCullagh and Nelder 1989 (gamma regression),
//! Gourieroux, Monfort and Renault 1993 (indirect inference), Efros and Freeman 2001 (texture from
//! an example's tiles), Jarzynski and Olano 2020 (hash).
//!
//! Not modelled: correlation in time of moving content, fixed-pattern noise, correlation beyond a
//! cell, covariance of noise and content.

pub mod atlas;
pub mod bands;
pub mod calibration;
pub mod cells;
pub mod content;
pub mod descriptor;
pub mod file;
mod filling;
pub mod flat_places;
pub mod latent;
pub mod masked_blur;
pub mod model_coding;
mod numbers;
pub mod parametric;
pub mod path;
pub mod persistence;
mod registration;
pub mod regression;
pub mod source_picture;
pub mod synthesis;
#[cfg(test)]
pub mod tests;
mod tile;

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use crate::memo::ByAddress;
use atlas::{AtlasFrame, CLASSES, MIN_CLASS_TILES, SourceFrame, TileCandidate};
use descriptor::DescriptorScale;
pub use numbers::{BandGains, ModelNumbers};

/// Calibrated noise of a camera at one setting.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseModel {
    pub numbers: ModelNumbers,
    /// Residuals and content from which the atlas is made; the form that files hold.
    pub sources: Vec<SourceFrame>,
    pub frames: Vec<AtlasFrame>,
    pub candidates: [Vec<TileCandidate>; CLASSES],
    pub descriptor_scale: DescriptorScale,
    parametric: ParametricField,
}

/// A model's parametric field, made when it is first drawn. No memo: it is derived from the model
/// alone, so that comparisons ignore it.
#[derive(Clone, Debug, Default)]
struct ParametricField(OnceLock<Arc<NoiseModel>>);

impl PartialEq for ParametricField {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// A camera's noise model with its file. Equal if both models are the same object in memory.
#[derive(Clone, Debug)]
pub struct NoiseModelFile {
    pub file: PathBuf,
    pub model: ByAddress<NoiseModel>,
}

impl PartialEq for NoiseModelFile {
    fn eq(&self, other: &Self) -> bool {
        self.model == other.model
    }
}

/// Why no model results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    #[error(
        "the frames have too few unmasked tiles of 80 × 80 px: {actual:?} in the four classes, expected at least \
         {MIN_CLASS_TILES} in each; use more frames, larger ones (160 × 160 px at least), or a smaller mask"
    )]
    TooFewTiles { actual: [usize; CLASSES] },
    #[error("there is no frame to calibrate from; give at least one")]
    NoFrames,
    #[error("frame {frame} of the calibration has another coding than the first; use frames of one recording")]
    Coding { frame: usize },
    #[error("frame {frame} of the calibration is {actual:?} px, expected {expected:?}; use frames of one recording")]
    Size { frame: usize, actual: [usize; 2], expected: [usize; 2] },
    #[error("{count} frames of a resting camera are too few for a mean picture, expected at least 4; record longer")]
    TooFewFrames { count: usize },
    #[error("the numbers of the model are not finite or not ordered; calibrate again")]
    Numbers,
    #[error("the picture is coded in grey; noise by example needs Y'CbCr")]
    Grey,
}

impl NoiseModel {
    /// The model of these numbers and frames; makes the atlas and its candidates.
    pub fn new(numbers: ModelNumbers, sources: Vec<SourceFrame>) -> Result<Self, ModelError> {
        let gains = [numbers.gains, numbers.atlas_gains];
        let finite = gains.iter().flatten().flatten().chain([&numbers.frame_correlation]).all(|v| v.is_finite());
        let factor = numbers.chroma_factor().iter().all(|factor| matches!(factor, 1 | 2));
        if !(finite && factor && numbers.scale.is_valid() && numbers.latent.is_valid()) {
            return Err(ModelError::Numbers);
        }
        let (frames, candidates, descriptor_scale) = atlas::build(&numbers, &sources);
        let counts = candidates.each_ref().map(Vec::len);
        if counts.iter().any(|&count| count < MIN_CLASS_TILES) {
            return Err(ModelError::TooFewTiles { actual: counts });
        }
        Ok(Self { numbers, sources, frames, candidates, descriptor_scale, parametric: ParametricField::default() })
    }

    /// The model with a correlation of the noise of consecutive frames. Values that do not differ
    /// from chance count as none.
    pub fn with_frame_correlation(mut self, correlation: f32) -> Self {
        let is_modelled = correlation >= persistence::MIN_FRAME_CORRELATION;
        self.numbers.frame_correlation = if is_modelled { correlation.min(1.0) } else { 0.0 };
        self
    }

    /// The model with activity clamped to `deviations` standard deviations about its mean, where
    /// residuals of active content contain errors that are not noise.
    pub fn with_clamped_activity(self, deviations: f32) -> Result<Self, ModelError> {
        let scale = self.numbers.scale.with_clamped_activity(deviations);
        Self::new(ModelNumbers { scale, ..self.numbers }, self.sources)
    }
}
