//! Decoding of the formats that need no other program, from bytes.

use std::borrow::Cow;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;
use std::sync::Arc;

use image::{DynamicImage, ImageDecoder};

use super::jpeg::{self, Ending};
use super::still_format::{FORMATS, JPEG_SIGNATURE, PNG_SIGNATURE, PictureHeader, StillFormat};
use super::tiff_samples::{self, SampleKind, TiffHeader};
use super::{SourceError, file as plain, jpeg_header, jpeg_marker, jpeg_tables, scene_linear};
use crate::pixels::{Codes, Pixels};

/// The file of a picture of a known format, limited to the size that such a picture can have.
pub fn read(file: &Path, format: StillFormat) -> Result<Vec<u8>, SourceError> {
    let PictureHeader { width, height, bits } = read_header(file, format)?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels.saturating_mul(3 * u64::from(bits / 8)) > MAX_DECODED_BYTES {
        let problem = format!("is {width}x{height} with {bits} bits; at most {MAX_DECODED_BYTES} bytes are decoded");
        return Err(SourceError::content(file, problem));
    }
    // Four channels of 16 bits, uncompressed, times two for a poor compressor.
    plain::read(file, 16 * pixels + MAX_EXTRA_BYTES)
        .map_err(|source| SourceError::Read { file: file.to_owned(), source })
}

/// Reads only the part of a file that contains its header.
pub fn read_header(file: &Path, format: StillFormat) -> Result<PictureHeader, SourceError> {
    let reader = plain::open(file).map_err(|source| SourceError::Read { file: file.to_owned(), source })?;
    header(&mut BufReader::new(reader), format).map_err(|problem| SourceError::content(file, problem))
}

/// The picture in a file of a known format. A truncated file is an error.
pub fn read_pixels(file: &Path, format: StillFormat) -> Result<Pixels, SourceError> {
    decode_pixels(&read(file, format)?).map_err(|problem| SourceError::content(file, problem))
}

/// Decodes a picture. The error describes the problem.
pub fn decode_pixels(bytes: &[u8]) -> Result<Pixels, String> {
    let format = StillFormat::of_content(bytes).ok_or_else(no_picture)?;
    if format == StillFormat::Exr {
        return scene_linear::exr_pixels(bytes);
    }
    let picture = decode(bytes, format)?;
    let (width, height) = (picture.width(), picture.height());
    let codes = match picture {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            Codes::U16(scene_linear::encoded(&picture.into_rgb32f().into_raw()))
        }
        _ if picture.color().bytes_per_pixel() / picture.color().channel_count() > 1 => {
            Codes::U16(picture.into_rgb16().into_raw())
        }
        _ => Codes::U8(picture.into_rgb8().into_raw()),
    };
    let coding = (format == StillFormat::Jpeg).then(|| jpeg_header::coding(bytes).ok()).flatten().map(Arc::new);
    Ok(Pixels { coding, ..Pixels::uncoded(width, height, codes) })
}

/// Steps through the chunks to the last. Each has its length, its name, that many bytes and a
/// checksum of four bytes.
pub fn png_end(bytes: &[u8]) -> Result<(), String> {
    let mut rest = bytes.get(PNG_SIGNATURE.len()..);
    while let Some((length, after)) = rest.and_then(<[u8]>::split_first_chunk) {
        let last = after.starts_with(b"IEND");
        rest = after.get(u32::from_be_bytes(*length) as usize + 8..);
        if last && rest.is_some() {
            return Ok(());
        }
    }
    Err("the PNG is truncated: its last chunk is missing".to_owned())
}

/// Largest memory of a decoded picture, bytes; also the decoders' limit.
const MAX_DECODED_BYTES: u64 = 512 << 20;
/// Largest size of other content in a file, bytes: previews, or a video appended by a phone.
const MAX_EXTRA_BYTES: u64 = 64 << 20;

/// A PNG reduced to the chunks of its pixels: texts and colour profiles may unpack to a thousand
/// times their length, and anything after the end is ignored.
pub(crate) fn bare_png(bytes: &[u8]) -> Cow<'_, [u8]> {
    let Some(mut rest) = bytes.strip_prefix(PNG_SIGNATURE) else { return Cow::Borrowed(bytes) };
    let mut bare = PNG_SIGNATURE.to_vec();
    while let Some((length, after)) = rest.split_first_chunk() {
        let Some(end) = (u32::from_be_bytes(*length) as usize).checked_add(12).filter(|end| *end <= rest.len()) else {
            break;
        };
        let (chunk, behind) = rest.split_at(end);
        if [b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"].iter().any(|name| after.starts_with(*name)) {
            bare.extend(chunk);
        }
        rest = if after.starts_with(b"IEND") { &[] } else { behind };
    }
    // Truncated data stays truncated, for the decoder to report.
    bare.extend(rest);
    Cow::Owned(bare)
}

pub fn decode(bytes: &[u8], format: StillFormat) -> Result<DynamicImage, String> {
    use image::codecs::{bmp::BmpDecoder, jpeg::JpegDecoder, png::PngDecoder, pnm::PnmDecoder, tiff::TiffDecoder};
    match format {
        StillFormat::Png => {
            let bare = bare_png(bytes);
            from_decoder(PngDecoder::with_limits(Cursor::new(&*bare), limits()).map_err(damaged)?)
        }
        StillFormat::Jpeg => {
            let bytes = jpeg_tables::with_tables(bytes);
            // The decoder fills in missing data, and takes a missing end marker for missing pixels.
            let bytes = match jpeg::check(&bytes)? {
                Ending::Marked => bytes,
                Ending::Unmarked => Cow::Owned([&bytes, &b"\xff\xd9"[..]].concat()),
            };
            from_decoder(JpegDecoder::new(Cursor::new(&*bytes)).map_err(damaged)?)
        }
        StillFormat::Tiff => {
            if let Some(picture) = tiff_samples::picture(bytes, MAX_DECODED_BYTES)? {
                return Ok(picture);
            }
            from_decoder(TiffDecoder::new(Cursor::new(bytes)).map_err(damaged)?)
        }
        StillFormat::WebP => from_decoder(image::codecs::webp::WebPDecoder::new(Cursor::new(bytes)).map_err(damaged)?),
        StillFormat::Bmp => from_decoder(BmpDecoder::new(Cursor::new(bytes)).map_err(damaged)?),
        StillFormat::Pnm => from_decoder(PnmDecoder::new(Cursor::new(bytes)).map_err(damaged)?),
        _ => Err(format!("is {}, which is not decoded here", format.name())),
    }
}

/// The ICC profile of a PNG, JPEG, TIFF or WebP. `None` without one, and for damaged files.
pub fn icc_profile(bytes: &[u8], format: StillFormat) -> Option<Vec<u8>> {
    use image::codecs::{jpeg::JpegDecoder, png::PngDecoder, webp::WebPDecoder};
    let reader = Cursor::new(bytes);
    let profile = match format {
        StillFormat::Png => PngDecoder::with_limits(reader, limits()).ok()?.icc_profile(),
        StillFormat::Jpeg => JpegDecoder::new(reader).ok()?.icc_profile(),
        StillFormat::Tiff => return tiff_samples::icc_profile(bytes),
        StillFormat::WebP => WebPDecoder::new(reader).ok()?.icc_profile(),
        _ => return None,
    };
    profile.ok()?
}

fn limits() -> image::Limits {
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    limits
}

fn from_decoder(mut decoder: impl ImageDecoder) -> Result<DynamicImage, String> {
    // Not every decoder has limits of its own.
    if decoder.total_bytes() > MAX_DECODED_BYTES {
        let (width, height) = decoder.dimensions();
        return Err(format!("is {width}x{height}; at most {MAX_DECODED_BYTES} bytes are decoded"));
    }
    decoder.set_limits(limits()).map_err(|e| e.to_string())?;
    DynamicImage::from_decoder(decoder).map_err(damaged)
}

fn damaged(error: image::ImageError) -> String {
    match error {
        image::ImageError::Unsupported(what) => {
            format!("a picture of this kind is not supported: {what}; convert it to a PNG or a TIFF of 16 bits")
        }
        error => format!("the picture is damaged or truncated: {error}"),
    }
}

/// The refusal of a file that is no picture.
pub fn no_picture() -> String {
    format!("is no picture; expected {FORMATS}")
}

pub fn header(reader: &mut (impl BufRead + Seek), format: StillFormat) -> Result<PictureHeader, String> {
    use image::codecs::{bmp::BmpDecoder, pnm::PnmDecoder, tiff::TiffDecoder, webp::WebPDecoder};
    match format {
        StillFormat::Png => png_header(reader),
        StillFormat::Jpeg => jpeg_header(reader),
        StillFormat::Exr => scene_linear::exr_header(reader),
        StillFormat::Tiff => {
            if let Some(TiffHeader { width, height, kind }) = tiff_samples::header(&mut *reader)? {
                return Ok(PictureHeader { width, height, bits: if kind == SampleKind::Palette { 8 } else { 16 } });
            }
            reader.rewind().map_err(|error| damaged(error.into()))?;
            TiffDecoder::new(reader).map_err(damaged).map(|decoder| header_of(&decoder))
        }
        StillFormat::WebP => WebPDecoder::new(reader).map_err(damaged).map(|decoder| header_of(&decoder)),
        StillFormat::Bmp => BmpDecoder::new(reader).map_err(damaged).map(|decoder| header_of(&decoder)),
        StillFormat::Pnm => PnmDecoder::new(reader).map_err(damaged).map(|decoder| header_of(&decoder)),
        _ => Err(format!("is {}, which is not decoded here", format.name())),
    }
}

fn header_of(decoder: &impl ImageDecoder) -> PictureHeader {
    let ((width, height), color) = (decoder.dimensions(), decoder.color_type());
    let is_wide = color.bytes_per_pixel() / color.channel_count() > 1;
    PictureHeader { width, height, bits: if is_wide { 16 } else { 8 } }
}

/// Signature, length and name of the first chunk, width, height, bit depth.
fn png_header(reader: &mut impl Read) -> Result<PictureHeader, String> {
    let mut head = [0; 25];
    let whole = reader.read_exact(&mut head);
    whole.map_err(|_| "the PNG is truncated in its header".to_owned())?;
    let number = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    Ok(PictureHeader { width: number(16), height: number(20), bits: if head[24] == 16 { 16 } else { 8 } })
}

/// Walks a JPEG's segments and stops after the header of its first scan. Source: ITU-T T.81, annex
/// B (SOS is DA).
fn jpeg_header(reader: &mut (impl Read + Seek)) -> Result<PictureHeader, String> {
    let truncated = |_| "the JPEG is truncated in its header".to_owned();
    // The signature's last byte belongs to the first marker.
    reader.seek_relative(JPEG_SIGNATURE.len() as i64 - 1).map_err(truncated)?;
    let mut header = None;
    loop {
        let mut byte = || -> Result<u8, String> {
            let mut one = [0];
            reader.read_exact(&mut one).map(|()| one[0]).map_err(truncated)
        };
        if byte()? != 0xff {
            return Err("the JPEG's header is damaged: a marker is missing".to_owned());
        }
        let mut marker = byte()?;
        while marker == 0xff {
            marker = byte()?;
        }
        let length = u16::from_be_bytes([byte()?, byte()?]);
        let mut left = i64::from(length) - 2;
        match marker {
            _ if jpeg_marker::is_frame(marker) => {
                let frame = [byte()?, byte()?, byte()?, byte()?, byte()?];
                left -= 5;
                if let Some(problem) = jpeg_marker::unsupported(marker, frame[0]) {
                    return Err(problem);
                }
                let size = |at: usize| u32::from(u16::from_be_bytes([frame[at], frame[at + 1]]));
                header = Some(PictureHeader { width: size(3), height: size(1), bits: 8 });
            }
            0xda => return header.ok_or_else(|| "the JPEG's header is damaged: it has no size".to_owned()),
            _ => {}
        }
        if left < 0 {
            return Err("the JPEG's header is damaged: a segment has no length".to_owned());
        }
        reader.seek_relative(left).map_err(truncated)?;
    }
}
