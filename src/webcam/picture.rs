//! A picture as it is delivered.

use std::borrow::Cow;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::coding::yuv::Table;
use crate::coding::{ColorMatrix, ColorRange};
use crate::pixels::Pixels;
use crate::source::{jpeg_end, jpeg_tables, still};

/// How a picture's bytes lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// Packed 4:2:2: Y0 Cb Y1 Cr.
    Yuyv,
    /// 4:2:0 in two planes: Y', then Cb and Cr by turns.
    Nv12,
    /// A JPEG file.
    Mjpeg,
    /// R, G, B.
    Rgb,
    /// Y' alone.
    Grey,
}

impl Layout {
    /// Without loss first, then by how little of the colour's resolution is lost; without colour
    /// last.
    pub const PREFERRED: [Self; 5] = [Self::Rgb, Self::Yuyv, Self::Nv12, Self::Mjpeg, Self::Grey];

    /// Whether a range and a matrix have to be known.
    pub fn is_ycbcr(self) -> bool {
        matches!(self, Self::Yuyv | Self::Nv12 | Self::Grey)
    }

    /// Bytes of a row without padding; of JPEG nothing.
    pub fn row_bytes(self, width: u32) -> usize {
        let width = width as usize;
        match self {
            Self::Yuyv => 2 * width,
            Self::Nv12 | Self::Grey => width,
            Self::Rgb => 3 * width,
            Self::Mjpeg => 0,
        }
    }

    /// The usual name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Self::Yuyv => "yuyv",
            Self::Nv12 => "nv12",
            Self::Mjpeg => "mjpeg",
            Self::Rgb => "rgb",
            Self::Grey => "grey",
        }
    }

    pub fn of_name(name: &str) -> Option<Self> {
        Self::PREFERRED.into_iter().find(|layout| layout.name() == name.to_ascii_lowercase())
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Format shared by all pictures of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureFormat {
    pub layout: Layout,
    pub width: u32,
    pub height: u32,
    /// Bytes from row to row. 0 of JPEG, and of a buffer that does not hold such rows.
    pub stride: usize,
    /// Range of Y'CbCr. JPEG's is always full and BT.601 (JFIF).
    pub range: ColorRange,
    pub matrix: ColorMatrix,
}

impl PictureFormat {
    /// True if a buffer holds all rows of a picture, or a JPEG file up to its end.
    pub fn is_complete(&self, bytes: &[u8]) -> bool {
        let Self { layout, width, height, stride, .. } = *self;
        if layout == Layout::Mjpeg {
            return jpeg_end::length(bytes).is_some();
        }
        let (row, height) = (layout.row_bytes(width), height as usize);
        let rows = if layout == Layout::Nv12 { height + height.div_ceil(2) } else { height };
        stride >= row && bytes.len() >= rows.saturating_sub(1) * stride + row
    }
}

impl fmt::Display for PictureFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{} {}", self.width, self.height, self.layout)?;
        let range = if self.range == ColorRange::Full { "full" } else { "limited" };
        let matrix = match self.matrix {
            _ if self.layout == Layout::Grey => return write!(f, " ({range} range)"),
            ColorMatrix::Rgb => return Ok(()),
            ColorMatrix::Bt601 => "BT.601",
            ColorMatrix::Bt709 => "BT.709",
            ColorMatrix::Bt2020 => "BT.2020",
        };
        write!(f, " ({matrix}, {range} range)")
    }
}

/// A picture with the driver's time.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub picture_format: PictureFormat,
    pub bytes: Vec<u8>,
    /// Seconds of [`super::monotonic_s`].
    pub time_s: f64,
    /// Exposure time of each row, seconds, if the camera reports it.
    pub exposure_s: Option<f64>,
}

/// Why a picture cannot be used. Cameras deliver such now and then.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a picture is damaged: {0}")]
pub struct PictureError(String);

impl Picture {
    /// The file of a JPEG picture as it was delivered; tables that cameras leave out are put in.
    /// `None` of other layouts.
    pub fn jpeg(&self) -> Option<Cow<'_, [u8]>> {
        (self.picture_format.layout == Layout::Mjpeg).then(|| jpeg_tables::with_tables(&self.bytes))
    }

    /// The pixels, R'G'B' of 8 bits.
    pub fn pixels(&self) -> Result<Pixels, PictureError> {
        let PictureFormat { layout, width, height, stride, range, matrix } = self.picture_format;
        let table = || Table::new(matrix, range);
        let codes = match layout {
            Layout::Yuyv => table().yuyv(&self.bytes, width, height, stride),
            Layout::Nv12 => table().nv12(&self.bytes, width, height, stride),
            Layout::Rgb => rows(&self.bytes, 3 * width as usize, height, stride).map(|rows| rows.concat()),
            Layout::Grey => rows(&self.bytes, width as usize, height, stride).map(|rows| {
                let codes = rows.into_iter().flatten();
                let table = table();
                codes.flat_map(|code| table.rgb([*code, 128, 128])).collect()
            }),
            Layout::Mjpeg => {
                let pixels = still::decode_pixels(&self.bytes).map_err(PictureError)?;
                if (pixels.width, pixels.height) != (width, height) || pixels.max_code() != 255 {
                    let (w, h) = (pixels.width, pixels.height);
                    return Err(PictureError(format!("it is {w}x{h}, and {width}x{height} was announced")));
                }
                return Ok(pixels);
            }
        };
        let short = || PictureError(format!("{} bytes are not {width}x{height} px {layout}", self.bytes.len()));
        codes.and_then(|codes| Pixels::from_u8(width, height, codes)).ok_or_else(short)
    }
}

/// Rows of `length` bytes, `stride` bytes apart. `None` if there are not enough bytes.
fn rows(bytes: &[u8], length: usize, height: u32, stride: usize) -> Option<Vec<&[u8]>> {
    if stride < length {
        return None;
    }
    (0..height as usize).map(|row| bytes.get(row * stride..row * stride + length)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::ExtendedColorType;

    fn picture(layout: Layout, stride: usize, bytes: &[u8]) -> Picture {
        let (range, matrix) = (ColorRange::Full, ColorMatrix::Bt601);
        let picture_format = PictureFormat { layout, width: 2, height: 2, stride, range, matrix };
        Picture { picture_format, bytes: bytes.to_vec(), time_s: 0.0, exposure_s: None }
    }

    #[test]
    fn each_layout_gives_its_codes() {
        let rgb = picture(Layout::Rgb, 7, &[1, 2, 3, 4, 5, 6, 0, 7, 8, 9, 10, 11, 12]).pixels().unwrap();
        assert_eq!(rgb.codes.eight_bit().unwrap(), (1..=12).collect::<Vec<u8>>());
        let yuyv = picture(Layout::Yuyv, 4, &[1, 128, 2, 128, 3, 128, 4, 128]).pixels().unwrap();
        let nv12 = picture(Layout::Nv12, 2, &[1, 2, 3, 4, 128, 128]).pixels().unwrap();
        assert_eq!((yuyv.at(1, 1), &nv12), ([4; 3], &yuyv));
        let grey = picture(Layout::Grey, 3, &[1, 2, 0, 3, 4]).pixels().unwrap();
        assert_eq!(grey, yuyv);
        let mut limited = picture(Layout::Grey, 2, &[16, 126, 235, 255]);
        limited.picture_format.range = ColorRange::Limited;
        let codes = limited.pixels().unwrap();
        assert_eq!([(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| codes.at(x, y)[1]), [0, 128, 255, 255]);
    }

    #[test]
    fn buffer_is_complete_from_its_last_row_on() {
        for (layout, stride, length) in [
            (Layout::Yuyv, 4, 8),
            (Layout::Yuyv, 6, 10),
            (Layout::Nv12, 2, 6),
            (Layout::Rgb, 7, 13),
            (Layout::Grey, 3, 5),
        ] {
            let is_complete = |length: usize| {
                let picture = picture(layout, stride, &vec![128; length]);
                assert_eq!(
                    picture.pixels().is_ok(),
                    picture.picture_format.is_complete(&picture.bytes),
                    "{layout} {length}"
                );
                picture.pixels().is_ok()
            };
            assert!(is_complete(length) && !is_complete(length - 1), "{layout}");
        }
        assert!(!picture(Layout::Grey, 0, &[128; 9]).picture_format.is_complete(&[128; 9]));
    }

    #[test]
    fn a_jpeg_is_kept_whole_and_another_size_is_refused() {
        let mut file = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, 100);
        image::ImageEncoder::write_image(encoder, &[90; 12], 2, 2, ExtendedColorType::Rgb8).unwrap();
        let whole = picture(Layout::Mjpeg, 0, &file);
        assert_eq!(whole.jpeg().unwrap(), file);
        assert_eq!(whole.pixels().unwrap().at(0, 0), [90; 3]);
        let mut other = whole.clone();
        other.picture_format.width = 4;
        assert_eq!(other.pixels().unwrap_err().to_string(), "a picture is damaged: it is 2x2, and 4x2 was announced");
        let cut = picture(Layout::Mjpeg, 0, &file[..file.len() - 9]);
        assert!(cut.pixels().is_err());
        assert_eq!(
            picture(Layout::Yuyv, 4, &[1; 7]).pixels().unwrap_err().to_string(),
            "a picture is damaged: 7 bytes are not 2x2 px yuyv"
        );
    }
}
