//! How a picture was coded before it became R'G'B' codes.
//!
//! A camera's file holds Y'CbCr planes, chroma often at a lower resolution, often quantised as
//! blocks of DCT coefficients (JPEG), and a decoder with an integer arithmetic of its own turns
//! them into R'G'B' codes. Virtual pixels that take the same path have the same traces.
//!
//! The path of a picture:
//! 1. R'G'B' codes as floats, not clipped, to Y'CbCr in the scale of the coded samples: 0 to 255,
//!    chroma about 128 ([`YcbcrColor`]).
//! 2. Chroma samples are weighted means of pixels ([`ChromaSampling`]).
//! 3. With [`BlockQuantization`]: samples − 128, DCT of 8×8 blocks, coefficients rounded to
//!    multiples of their quantisation step. Without: samples rounded to 8 bits.
//! 4. The decoder's integer inverse DCT, chroma upsampling and colour conversion ([`Decoder`]).
//!
//! Sources: ITU-T T.81 (JPEG), ITU-T T.871 (JFIF), ITU-R BT.601-7, BT.709-6 and BT.2020-2.

mod annex_k;
pub mod chroma;
mod color;
mod comb;
pub mod conversion;
pub mod dct;
pub mod estimate;
#[cfg(test)]
pub(crate) mod jpeg_writer;
pub mod path;
#[cfg(test)]
mod path_tests;
mod plane;
pub mod swscale;
pub mod upsampling;
pub mod yuv;

use std::fmt;

use serde::{Deserialize, Serialize};

pub use color::{ColorMatrix, ColorRange, YcbcrColor};
pub use plane::SamplePlane;

/// Samples of a block, rows and columns each.
pub const BLOCK: usize = 8;

/// How a picture was coded before it became R'G'B' codes, and how it was decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureCoding {
    pub color: YcbcrColor,
    /// `None` for a grey picture, which has a plane of luma only.
    pub chroma: Option<ChromaSampling>,
    /// `None` if samples were rounded to 8 bits and not quantised otherwise (YUYV, NV12), or if the
    /// quantisation is not known (video).
    pub quantization: Option<BlockQuantization>,
    pub decoder: Decoder,
}

/// Resolution and position of the chroma samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChromaSampling {
    /// Luma samples for each chroma sample, across and down: 1 or 2. 4:2:0 is `[2, 2]`, 4:2:2 is
    /// `[2, 1]`.
    pub factor: [u32; 2],
    /// Across and down. Without meaning where the factor is 1.
    pub siting: [ChromaSiting; 2],
}

/// Position of a chroma sample among its two luma samples, along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChromaSiting {
    /// Between them: the mean of both (JPEG; vertically also MPEG-2 and H.264).
    Centered,
    /// At the first of them: weights 1, 2, 1 of four about it (horizontally MPEG-2 and H.264).
    Cosited,
}

/// Quantisation of DCT coefficients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockQuantization {
    /// Quantisation steps of Y', Cb and Cr, row-major: index 8 v + u for the vertical frequency v
    /// and the horizontal frequency u. At least 1.
    pub steps: [[u16; BLOCK * BLOCK]; 3],
    /// Top left corner of the grid of minimum coded units, px of the picture. A unit has 8 × the
    /// chroma's factor pixels across and down. Each coordinate is from 1 − the unit's size to 0; it
    /// is below 0 where a picture was cropped after decoding. Luma blocks start at every 8 px from
    /// here.
    pub origin: [i32; 2],
}

/// The integer arithmetic that made R'G'B' codes from coded samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decoder {
    /// The `image` crate's JPEG decoder: inverse DCT with 12-bit constants, chroma interpolated
    /// with weights 3 and 1 (4:2:0: rounded once vertically and once horizontally; both ends of
    /// the padded plane repeated), colour with 14-bit constants.
    ZuneJpeg,
    /// libjpeg and libjpeg-turbo: inverse DCT with 13-bit constants (`islow`), "fancy" upsampling
    /// with weights 3 and 1 (4:2:0: 9, 3, 3, 1, rounded once), colour with 16-bit constants.
    Libjpeg,
    /// ffmpeg's scaler as this program calls it: bicubic chroma with 14-bit and 12-bit weights,
    /// colour with 13-bit constants.
    Swscale {
        /// Position that the scaler assumes for chroma samples, across and down. ffmpeg 5.1 assumes
        /// the centre, wherever the file has them.
        siting: [ChromaSiting; 2],
    },
    /// Pixels share a chroma sample without interpolation; the nearest code of the exact
    /// conversion (webcams' YUYV and NV12).
    Nearest,
    /// No coding: R'G'B' codes nearest to the exact conversion of planes that were not rounded.
    Unrounded,
}

impl PictureCoding {
    /// Of R'G'B' codes that never were Y'CbCr: raw pictures, or a PNG of a camera's R'G'B'.
    pub const UNROUNDED: Self = Self {
        color: YcbcrColor::JFIF,
        chroma: Some(ChromaSampling::FULL),
        quantization: None,
        decoder: Decoder::Unrounded,
    };

    /// Luma samples for each chroma sample, across and down; 1 for a grey picture.
    pub fn chroma_factor(&self) -> [u32; 2] {
        self.chroma.map_or([1, 1], |chroma| chroma.factor)
    }

    /// Pixels of a minimum coded unit, across and down.
    pub fn unit_px(&self) -> [u32; 2] {
        self.chroma_factor().map(|factor| BLOCK as u32 * factor)
    }

    /// 1 for a grey picture, otherwise 3.
    pub fn plane_count(&self) -> usize {
        if self.chroma.is_some() { 3 } else { 1 }
    }
}

/// As in "chroma 4:2:0, quantisation steps 6 to 120".
impl fmt::Display for PictureCoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.chroma.map(|chroma| chroma.factor) {
            None => "grey",
            Some([1, 1]) => "chroma 4:4:4",
            Some([2, 1]) => "chroma 4:2:2",
            Some([1, _]) => "chroma 4:4:0",
            Some(_) => "chroma 4:2:0",
        })?;
        let Some(quantization) = &self.quantization else { return Ok(()) };
        let steps = || quantization.steps.iter().take(self.plane_count()).flatten();
        let range = steps().min().zip(steps().max());
        range.map_or(Ok(()), |(min, max)| write!(f, ", quantisation steps {min} to {max}"))
    }
}

impl ChromaSampling {
    /// A chroma sample for each luma sample.
    pub const FULL: Self = Self { factor: [1, 1], siting: [ChromaSiting::Centered; 2] };

    /// As in JPEG files: each sample between its luma samples.
    pub fn centered(factor: [u32; 2]) -> Self {
        Self { factor, siting: [ChromaSiting::Centered; 2] }
    }

    /// As in MPEG-2 and H.264 without a stated position: horizontally at the first luma sample,
    /// vertically between two.
    pub fn left(factor: [u32; 2]) -> Self {
        Self { factor, siting: [ChromaSiting::Cosited, ChromaSiting::Centered] }
    }
}
