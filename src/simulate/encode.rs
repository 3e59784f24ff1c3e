//! Frames and depth as files.

use std::io::Cursor;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};

use super::render::SimulatedPicture;
use super::{Format, Options, SimulateError};

pub fn encoding(what: &str) -> impl FnOnce(ImageError) -> SimulateError {
    let what = what.to_owned();
    move |source| SimulateError::Encode { what, source }
}

pub fn extension(format: Format) -> &'static str {
    match format {
        Format::Png => "png",
        Format::Jpg => "jpg",
    }
}

pub fn frame(options: &Options, picture: &SimulatedPicture, codes: &[u8]) -> Result<Vec<u8>, ImageError> {
    let (w, h) = (picture.width, picture.height);
    let mut file = Vec::new();
    match options.format {
        Format::Png => {
            let encoder = PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive);
            encoder.write_image(codes, w, h, ExtendedColorType::Rgb8)?;
        }
        Format::Jpg => {
            let quality = options.jpeg_quality.clamp(1, 100) as u8;
            JpegEncoder::new_with_quality(&mut file, quality).encode(codes, w, h, ExtendedColorType::Rgb8)?;
        }
    }
    Ok(file)
}

/// 16-bit depth, `scale` per metre; 0 for nothing and beyond 65535.
pub fn depth_png(picture: &SimulatedPicture, scale: f64) -> Result<Vec<u8>, ImageError> {
    let value = |depth_m: &f32| {
        let value = (f64::from(*depth_m) * scale).round();
        if (0.0..=65535.0).contains(&value) { value as u16 } else { 0 }
    };
    // The encoder takes 16-bit samples in native byte order.
    let bytes: Vec<u8> = picture.depth_m.iter().flat_map(|d| value(d).to_ne_bytes()).collect();
    grey_png(&bytes, picture, ExtendedColorType::L16)
}

/// How sure a phone is of each depth: 2 up to `far_m`, 0 beyond it and where nothing was measured.
pub fn confidence_png(picture: &SimulatedPicture, far_m: f32) -> Result<Vec<u8>, ImageError> {
    let sure = |depth_m: &f32| if *depth_m > 0.0 && *depth_m <= far_m { 2 } else { 0 };
    let bytes: Vec<u8> = picture.depth_m.iter().map(sure).collect();
    grey_png(&bytes, picture, ExtendedColorType::L8)
}

fn grey_png(bytes: &[u8], picture: &SimulatedPicture, kind: ExtendedColorType) -> Result<Vec<u8>, ImageError> {
    let mut file = Cursor::new(Vec::new());
    PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive).write_image(
        bytes,
        picture.width,
        picture.height,
        kind,
    )?;
    Ok(file.into_inner())
}
