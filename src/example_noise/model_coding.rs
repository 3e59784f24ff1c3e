//! The coding for which a model's residuals hold.
//!
//! Residuals belong to the planes of one coding and to one decoder. Another coding shares them if
//! it has the same colour conversion, chroma sampling and decoder, and if both are quantised or
//! both are not. Quantisation tables and the grid's origin may differ: cameras scale their tables
//! by content, and noise is added before the quantisation.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::coding::{ChromaSampling, Decoder, PictureCoding, YcbcrColor};

/// The properties of a [`PictureCoding`] on which a model depends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelCoding {
    pub color: YcbcrColor,
    pub chroma: ChromaSampling,
    /// True with quantised DCT coefficients.
    pub quantized: bool,
    pub decoder: Decoder,
}

/// The first property in which a picture's coding differs from that of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodingDifference {
    /// The picture is grey.
    Grey,
    /// The picture has more than 8 bits.
    Depth,
    Color,
    Chroma,
    Quantization,
    Decoder,
}

impl ModelCoding {
    /// `None` for a grey picture.
    pub fn of(coding: &PictureCoding) -> Option<Self> {
        let quantized = coding.quantization.is_some();
        Some(Self { color: coding.color, chroma: coding.chroma?, quantized, decoder: coding.decoder })
    }

    /// The first difference that makes the model unusable for a picture; `None` if it is usable.
    pub fn difference(&self, coding: &PictureCoding) -> Option<CodingDifference> {
        let Some(other) = Self::of(coding) else { return Some(CodingDifference::Grey) };
        // The siting has no meaning along an axis of full resolution.
        let sitings = |chroma: ChromaSampling| [0, 1].map(|i| (chroma.factor[i] > 1).then_some(chroma.siting[i]));
        if self.color != other.color {
            Some(CodingDifference::Color)
        } else if self.chroma.factor != other.chroma.factor || sitings(self.chroma) != sitings(other.chroma) {
            Some(CodingDifference::Chroma)
        } else if self.quantized != other.quantized {
            Some(CodingDifference::Quantization)
        } else if self.decoder != other.decoder {
            Some(CodingDifference::Decoder)
        } else {
            None
        }
    }
}

impl fmt::Display for CodingDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Grey => "the picture is grey",
            Self::Depth => "the picture has more than 8 bits",
            Self::Color => "the picture has another colour matrix or range",
            Self::Chroma => "the picture has another resolution or position of chroma",
            Self::Quantization => "only one of the picture and the calibration's pictures was JPEG",
            Self::Decoder => "the picture was decoded by another decoder",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coding::{BlockQuantization, ChromaSiting, ColorMatrix};

    fn jpeg(step: u16) -> PictureCoding {
        PictureCoding {
            color: YcbcrColor::JFIF,
            chroma: Some(ChromaSampling::centered([2, 1])),
            quantization: Some(BlockQuantization { steps: [[step; 64]; 3], origin: [0, 0] }),
            decoder: Decoder::ZuneJpeg,
        }
    }

    #[test]
    fn model_of_one_quality_fits_another_quality_and_grid() {
        let model = ModelCoding::of(&jpeg(4)).unwrap();
        let mut cropped = jpeg(12);
        cropped.quantization.as_mut().unwrap().origin = [-8, -3];
        assert!([&jpeg(12), &cropped].iter().all(|coding| model.difference(coding).is_none()));
        // Full resolution down: its siting has no meaning.
        let sited = ChromaSampling { factor: [2, 1], siting: [ChromaSiting::Centered, ChromaSiting::Cosited] };
        assert_eq!(model.difference(&PictureCoding { chroma: Some(sited), ..jpeg(4) }), None);
    }

    #[test]
    fn first_difference_of_a_coding_is_named() {
        let model = ModelCoding::of(&jpeg(4)).unwrap();
        let difference = |coding: PictureCoding| model.difference(&coding);
        let color = YcbcrColor { matrix: ColorMatrix::Bt709, ..YcbcrColor::JFIF };
        assert_eq!(difference(PictureCoding { color, ..jpeg(4) }), Some(CodingDifference::Color));
        let chroma = |chroma| difference(PictureCoding { chroma, ..jpeg(4) });
        assert_eq!(chroma(None), Some(CodingDifference::Grey));
        assert_eq!(chroma(Some(ChromaSampling::centered([2, 2]))), Some(CodingDifference::Chroma));
        assert_eq!(chroma(Some(ChromaSampling::left([2, 1]))), Some(CodingDifference::Chroma));
        let plain = PictureCoding { quantization: None, ..jpeg(4) };
        assert_eq!(difference(plain), Some(CodingDifference::Quantization));
        let libjpeg = PictureCoding { decoder: Decoder::Libjpeg, ..jpeg(4) };
        assert_eq!(difference(libjpeg), Some(CodingDifference::Decoder));
        assert!(ModelCoding::of(&PictureCoding { chroma: None, ..jpeg(4) }).is_none());
    }
}
