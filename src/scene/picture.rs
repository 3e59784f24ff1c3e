//! Decodes textures after checking their size.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use image::{ImageFormat, ImageReader, Limits};

use super::{SceneError, extension};
use crate::source::still;

/// Maximum side of a texture.
pub(super) const MAX_SIDE_PX: u32 = 16384;
/// Maximum number of pixels of all textures of a scene: one of the largest size, 1 GiB.
pub(super) const MAX_PIXELS: u64 = 1 << 28;
const KTX2_SIGNATURE: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";

/// A decoded picture, with 8 bits per channel as in the file.
#[derive(Clone)]
pub(super) struct Rgba {
    pub width: u32,
    pub height: u32,
    pub rgba: Arc<Vec<u8>>,
}

/// Decodes a PNG or JPEG of at most `pixels_left` pixels. `location` is its place in `file`.
pub(super) fn decode(file: &Path, location: &str, bytes: &[u8], pixels_left: u64) -> Result<Rgba, SceneError> {
    let bad = |actual: String, accepted: &str| SceneError::bad(file, location, actual, accepted);
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
        Ok(other) => {
            let name = match other {
                ImageFormat::WebP => extension::WEBP,
                ImageFormat::Avif => extension::AVIF,
                _ => "",
            };
            let accepted = extension::with_conversion("PNG or JPEG", name, file);
            return Err(bad(format!("a picture of format {other:?}"), &accepted));
        }
        Err(_) if bytes.starts_with(KTX2_SIGNATURE) => {
            let accepted = extension::with_conversion("PNG or JPEG", extension::KTX2, file);
            return Err(bad("a picture of format KTX2".to_owned(), &accepted));
        }
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
        let actual = format!("{width}×{height} pixels, with {pixels_left} left");
        return Err(bad(actual, &format!("up to {MAX_PIXELS} pixels in all textures together")));
    }
    let rgba = limited().decode().map_err(failed)?.into_rgba8();
    Ok(Rgba { width: rgba.width(), height: rgba.height(), rgba: Arc::new(rgba.into_raw()) })
}

#[cfg(test)]
mod tests {
    use image::ImageEncoder;

    use super::*;

    #[test]
    fn pixel_limit_applies_to_all_textures_together() {
        let mut png = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut png);
        encoder.write_image(&[9; 64], 4, 4, image::ExtendedColorType::Rgba8).unwrap();
        assert_eq!(*decode(Path::new("a.glb"), "images[0]", &png, 16).unwrap().rgba, [9; 64]);
        let error = decode(Path::new("a.glb"), "images[0]", &png, 15).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("4×4 pixels, with 15 left"), "{error}");
    }
}
