//! A picture's file.

use std::borrow::Cow;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::pixels::Pixels;
use crate::webcam::Picture;

/// A picture on its way to the disk.
#[derive(Clone, Debug, PartialEq)]
pub enum Encoded {
    /// A JPEG file, as the camera delivered it.
    Jpeg(Vec<u8>),
    /// To be made a PNG file.
    Pixels(Pixels),
}

/// What is kept of a picture, whose pixels are known: what they are decoded from, if that is a file, else the pixels.
pub fn encoded(picture: &Picture, pixels: &Pixels) -> Encoded {
    match picture.jpeg() {
        Some(file) => Encoded::Jpeg(file.into_owned()),
        None => Encoded::Pixels(pixels.clone()),
    }
}

impl Encoded {
    /// What it takes in memory.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Jpeg(file) => file.len(),
            Self::Pixels(pixels) => 3 * pixels.width as usize * pixels.height as usize,
        }
    }

    /// The file's ending and bytes.
    pub fn file(&self) -> std::io::Result<(&'static str, Cow<'_, [u8]>)> {
        let pixels = match self {
            Self::Jpeg(file) => return Ok(("jpg", file.into())),
            Self::Pixels(pixels) => pixels,
        };
        let codes = pixels.codes.to_eight_bit();
        let mut file = Vec::with_capacity(codes.len());
        // A filter that is chosen row by row takes twice the time and gains nothing.
        PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Paeth)
            .write_image(&codes, pixels.width, pixels.height, ExtendedColorType::Rgb8)
            .map_err(std::io::Error::other)?;
        Ok(("png", file.into()))
    }
}
