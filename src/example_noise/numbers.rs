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
}

impl ModelNumbers {
    /// Luma px for each chroma sample, across and down.
    pub fn chroma_factor(&self) -> [usize; 2] {
        self.coding.chroma.factor.map(|factor| factor as usize)
    }
}
