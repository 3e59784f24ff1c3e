//! A texture as PNG.

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::scene::SceneTexture;

/// The file's bytes: its code values, with alpha if any texel is transparent.
pub fn png(texture: &SceneTexture) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    let is_opaque = texture.rgba.chunks_exact(4).all(|texel| texel[3] == 255);
    let encoder = PngEncoder::new(&mut bytes);
    if is_opaque {
        let rgb: Vec<u8> = texture.rgba.chunks_exact(4).flat_map(|texel| [texel[0], texel[1], texel[2]]).collect();
        encoder.write_image(&rgb, texture.width, texture.height, ExtendedColorType::Rgb8)?;
    } else {
        encoder.write_image(&texture.rgba, texture.width, texture.height, ExtendedColorType::Rgba8)?;
    }
    Ok(bytes)
}
