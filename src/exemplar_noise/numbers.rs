//! The numbers of a noise model.

use serde::{Deserialize, Serialize};

use super::bands::ALL_BANDS;
use super::content::FeatureScale;
use super::latent::LatentTable;
use super::model_coding::{CodingDifference, ModelCoding};
use super::regression::COEFFICIENTS;
use crate::coding::PictureCoding;

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
    /// Luma px for each chroma sample, across and down: 1 or 2.
    pub chroma_factor: [usize; 2],
    /// Coding of the calibration's pictures; `None` if the file does not state it.
    #[serde(default)]
    pub coding: Option<ModelCoding>,
}

impl ModelNumbers {
    /// The reason why the model does not fit pictures of a coding; `None` if it fits.
    pub fn coding_difference(&self, coding: &PictureCoding) -> Option<CodingDifference> {
        let is_same = coding.chroma_factor().map(|factor| factor as usize) == self.chroma_factor;
        match self.coding {
            _ if coding.chroma.is_none() => Some(CodingDifference::Grey),
            Some(own) => own.difference(coding),
            None => (!is_same).then_some(CodingDifference::Chroma),
        }
    }
}
