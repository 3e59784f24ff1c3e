//! Decodes textures and panoramas, after checking their size.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use image::codecs::hdr::HdrDecoder;
use image::{ImageDecoder, ImageFormat, ImageReader, Limits};

use super::SceneError;
use super::bytes;
use crate::source::still;

/// Longest side of a texture.
pub(super) const MAX_SIDE_PX: u32 = 16384;
/// Pixels of all textures of a scene together: as many as one of the largest, 1 GiB.
pub(super) const MAX_PIXELS: u64 = 1 << 28;
/// Pixels of a panorama: 8192 by 4096.
const MAX_PANORAMA_PIXELS: u64 = 1 << 25;

/// A decoded picture, with 8 bits per channel as in the file.
#[derive(Clone)]
pub(super) struct Rgba {
    pub width: u32,
    pub height: u32,
    pub rgba: Arc<Vec<u8>>,
}

/// Decodes a PNG or JPEG of at most `pixels_left` pixels. `what` is its place in `file`.
pub(super) fn decode(file: &Path, what: &str, bytes: &[u8], pixels_left: u64) -> Result<Rgba, SceneError> {
    let bad = |found: String, accepted: &str| SceneError::bad(file, what, found, accepted);
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
        Ok(other) => return Err(bad(format!("a picture of format {other:?}"), "PNG or JPEG")),
        Err(_) => return Err(bad("bytes that start like no picture".to_owned(), "PNG or JPEG")),
    };
    let bare = still::bare_png(bytes);
    let failed = |e: image::ImageError| bad(format!("a damaged picture ({e})"), "a whole PNG or JPEG");
    let limited = || {
        let mut reader = ImageReader::with_format(Cursor::new(&*bare), format);
        let mut limits = Limits::no_limits();
        limits.max_alloc = Some(16 * MAX_PIXELS);
        reader.limits(limits);
        reader
    };
    let (width, height) = limited().into_dimensions().map_err(failed)?;
    if width.max(height) > MAX_SIDE_PX {
        return Err(bad(format!("{width}×{height} pixels"), &format!("up to {MAX_SIDE_PX} pixels a side")));
    }
    if u64::from(width) * u64::from(height) > pixels_left {
        let found = format!("{width}×{height} pixels, with {pixels_left} left");
        return Err(bad(found, &format!("up to {MAX_PIXELS} pixels in all textures together")));
    }
    let rgba = limited().decode().map_err(failed)?.into_rgba8();
    Ok(Rgba { width: rgba.width(), height: rgba.height(), rgba: Arc::new(rgba.into_raw()) })
}

/// Of a panorama, bytes. Renderers write a few lines.
const MAX_HDR_HEADER: usize = 1 << 16;

/// A Radiance HDR picture as linear RGB, row by row from the top left.
pub(super) fn decode_hdr(file: &Path, named_in: &Path) -> Result<(u32, u32, Vec<[f32; 3]>), SceneError> {
    let bytes = bytes::read(file, Some(named_in))?;
    hdr_of(&bytes).map_err(|(found, accepted)| SceneError::bad(file, "the panorama", found, accepted))
}

/// Width, height, and linear light row by row.
pub(super) type Hdr = (u32, u32, Vec<[f32; 3]>);

/// Of a Radiance HDR picture's bytes; otherwise what was found, and what is accepted.
pub(super) fn hdr_of(bytes: &[u8]) -> Result<Hdr, (String, String)> {
    let bad = |found: String, accepted: &str| (found, accepted.to_owned());
    let failed = |e: image::ImageError| bad(format!("bytes that do not decode ({e})"), "a whole Radiance .hdr file");
    if !bytes.starts_with(b"#?") {
        return Err(bad("a file that does not begin with #?".to_owned(), "a Radiance .hdr file"));
    }
    // The decoder reads any header, of any length, word by word.
    let head = &bytes[..bytes.len().min(MAX_HDR_HEADER)];
    if !head.windows(2).any(|pair| pair == b"\n\n") && !head.windows(3).any(|three| three == b"\n\r\n") {
        return Err(bad(format!("no empty line in the first {} bytes", head.len()), "a header, which ends with one"));
    }
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(failed)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if width == 0 || height == 0 || width.max(height) > MAX_SIDE_PX || pixels > MAX_PANORAMA_PIXELS {
        let accepted = format!("1 to {MAX_PANORAMA_PIXELS} pixels, up to {MAX_SIDE_PX} a side");
        return Err(bad(format!("{width}×{height} pixels"), &accepted));
    }
    let mut samples = vec![0.0f32; pixels as usize * 3];
    decoder.read_image(bytemuck::cast_slice_mut(&mut samples)).map_err(failed)?;
    Ok((width, height, samples.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()))
}

#[cfg(test)]
mod tests {
    use image::ImageEncoder;

    use super::*;

    #[test]
    fn the_pixels_of_all_textures_are_counted_together() {
        let mut png = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut png);
        encoder.write_image(&[9; 64], 4, 4, image::ExtendedColorType::Rgba8).unwrap();
        assert_eq!(*decode(Path::new("a.glb"), "images[0]", &png, 16).unwrap().rgba, [9; 64]);
        let error = decode(Path::new("a.glb"), "images[0]", &png, 15).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("4×4 pixels, with 15 left"), "{error}");
    }
}
