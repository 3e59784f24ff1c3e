//! The numbers of a noise model.

use serde::{Deserialize, Serialize};

use super::bands::ALL_BANDS;
use super::content::FeatureScale;
use super::latent::LatentTable;
use super::model_coding::ModelCoding;
use super::regression::COEFFICIENTS;

/// Logarithm of each band's variance as a linear function of the constant 1 and the features.
pub type BandGains = [[f32; COEFFICIENTS]; ALL_BANDS];

/// Numbers of a model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelNumbers {
    pub scale: FeatureScale,
    /// Amplitudes of the synthesis.
    pub gains: BandGains,
    /// Amplitudes by which the atlas was normalised.
    pub atlas_gains: BandGains,
    pub latent: LatentTable,
    /// Coding of the calibration's pictures.
    pub coding: ModelCoding,
    /// Correlation of the noise of consecutive frames; 0 if it is unknown.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub frame_correlation: f32,
}

fn is_zero(value: &f32) -> bool {
    *value == 0.0
}

impl ModelNumbers {
    /// Luma px for each chroma sample, across and down.
    pub fn chroma_factor(&self) -> [usize; 2] {
        self.coding.chroma.factor.map(|factor| factor as usize)
    }
}
