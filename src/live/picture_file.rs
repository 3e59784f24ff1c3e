//! Pictures as image files.

use std::borrow::Cow;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::pixels::Pixels;
use crate::webcam::Picture;

/// A picture to be written to disk.
#[derive(Clone, Debug, PartialEq)]
pub enum PictureFile {
    /// The JPEG file that the camera delivered.
    Jpeg(Vec<u8>),
    /// Pixels, encoded as PNG.
    Pixels(Pixels),
}

/// Returns the picture's JPEG file if the camera delivered one, else the decoded pixels.
pub fn picture_file(picture: &Picture, pixels: &Pixels) -> PictureFile {
    match picture.jpeg() {
        Some(file) => PictureFile::Jpeg(file.into_owned()),
        None => PictureFile::Pixels(pixels.clone()),
    }
}

impl PictureFile {
    /// Size in memory, bytes.
    pub fn size_bytes(&self) -> usize {
        match self {
            Self::Jpeg(file) => file.len(),
            Self::Pixels(pixels) => 3 * pixels.width as usize * pixels.height as usize,
        }
    }

    /// The file's extension and content.
    pub fn encode(&self) -> std::io::Result<(&'static str, Cow<'_, [u8]>)> {
        let pixels = match self {
            Self::Jpeg(file) => return Ok(("jpg", file.into())),
            Self::Pixels(pixels) => pixels,
        };
        let codes = pixels.codes.to_eight_bit();
        let mut file = Vec::with_capacity(codes.len());
        // An adaptive filter takes twice the time and saves nothing.
        PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Paeth)
            .write_image(&codes, pixels.width, pixels.height, ExtendedColorType::Rgb8)
            .map_err(std::io::Error::other)?;
        Ok(("png", file.into()))
    }
}
