//! Still pictures: PNG with 8 or 16 bits, grey or colour, and JPEG, distinguished by content, not
//! by name. Pixels come as stored: no colour profile, gamma or rotation is applied, and
//! transparency is dropped.

use std::borrow::Cow;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;
use std::sync::Arc;

use image::{DynamicImage, ImageDecoder};

use super::jpeg::{self, Ending};
use super::{SourceError, file as plain, jpeg_header, jpeg_marker, jpeg_tables, unsupported};
use crate::pixels::{Codes, DepthMap, Pixels};

const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG_SIGNATURE: &[u8] = b"\xff\xd8\xff";

/// The contents of a picture's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PictureHeader {
    pub width: u32,
    pub height: u32,
    /// 8 or 16: depth of the result of [`read_pixels`].
    pub bits: u32,
}

/// True if a file with these first bytes is a picture that can be decoded.
pub fn is_still(start: &[u8]) -> bool {
    start.starts_with(PNG_SIGNATURE) || start.starts_with(JPEG_SIGNATURE)
}

/// True if an error of [`read_header`] is about the file's content (another kind of file, damage,
/// or a Git LFS pointer file), not about access to it.
pub fn is_no_picture(error: &SourceError) -> bool {
    match error {
        SourceError::Read { source, .. } => plain::is_lfs_pointer(source),
        SourceError::Content { .. } => true,
        _ => false,
    }
}

/// True if a file is a JPEG by its content.
pub fn is_jpeg(file: &Path) -> Result<bool, SourceError> {
    let failed = |source| SourceError::Read { file: file.to_owned(), source };
    let mut start = Vec::new();
    plain::open(file).map_err(failed)?.take(JPEG_SIGNATURE.len() as u64).read_to_end(&mut start).map_err(failed)?;
    Ok(start == JPEG_SIGNATURE)
}

/// Reads only the part of the file that contains the header.
pub fn read_header(file: &Path) -> Result<PictureHeader, SourceError> {
    let reader = plain::open(file).map_err(|source| SourceError::Read { file: file.to_owned(), source })?;
    let problem = |problem: String| match unsupported::by_name(file).filter(|_| problem == NEITHER) {
        Some(kind) => SourceError::content(file, kind.refusal()),
        None => SourceError::content(file, problem),
    };
    header(&mut BufReader::new(reader)).map_err(problem)
}

/// The picture in a file. A truncated file is an error.
pub fn read_pixels(file: &Path) -> Result<Pixels, SourceError> {
    decode_pixels(&read(file)?).map_err(|problem| SourceError::content(file, problem))
}

/// Decodes a picture. The error describes the problem.
pub fn decode_pixels(bytes: &[u8]) -> Result<Pixels, String> {
    let picture = decode(bytes)?;
    let (width, height) = (picture.width(), picture.height());
    let codes = if picture.color().bytes_per_pixel() / picture.color().channel_count() > 1 {
        Codes::U16(picture.into_rgb16().into_raw())
    } else {
        Codes::U8(picture.into_rgb8().into_raw())
    };
    let coding = bytes.starts_with(JPEG_SIGNATURE).then(|| jpeg_header::coding(bytes).ok()).flatten().map(Arc::new);
    Ok(Pixels { coding, ..Pixels::uncoded(width, height, codes) })
}

/// The depth in a 16-bit grey PNG: value / `codes_per_metre`, 0 where nothing was measured.
pub fn read_depth(file: &Path, codes_per_metre: f64, timestamp_s: f64) -> Result<DepthMap, SourceError> {
    let picture = decode(&read(file)?).map_err(|problem| SourceError::content(file, problem))?;
    let DynamicImage::ImageLuma16(grey) = picture else {
        let problem = format!("holds {:?} pixels; depth must be a 16-bit grey PNG", picture.color());
        return Err(SourceError::content(file, problem));
    };
    let (width, height) = grey.dimensions();
    let depth_m = grey.into_raw().into_iter().map(|code| (f64::from(code) / codes_per_metre) as f32).collect();
    Ok(DepthMap { width, height, depth_m, timestamp_s })
}

/// Checks that a picture's file is complete, without decoding its pixels.
pub fn check_end(file: &Path) -> Result<(), SourceError> {
    let bytes = read(file)?;
    let end = match bytes {
        _ if bytes.starts_with(PNG_SIGNATURE) => png_end(&bytes),
        _ if bytes.starts_with(JPEG_SIGNATURE) => jpeg::check(&jpeg_tables::with_tables(&bytes)).map(drop),
        _ => Err(neither(&bytes)),
    };
    end.map_err(|problem| SourceError::content(file, problem))
}

/// Steps through the chunks to the last. Each has its length, its name, that many bytes and a
/// checksum of four bytes.
fn png_end(bytes: &[u8]) -> Result<(), String> {
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

/// A picture's file, limited to the size that such a picture can have.
pub fn read(file: &Path) -> Result<Vec<u8>, SourceError> {
    let PictureHeader { width, height, bits } = read_header(file)?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels.saturating_mul(3 * u64::from(bits / 8)) > MAX_DECODED_BYTES {
        let problem = format!("is {width}x{height} with {bits} bits; at most {MAX_DECODED_BYTES} bytes are decoded");
        return Err(SourceError::content(file, problem));
    }
    // Four channels of 16 bits, uncompressed, times two for a poor compressor.
    plain::read(file, 16 * pixels + MAX_EXTRA_BYTES)
        .map_err(|source| SourceError::Read { file: file.to_owned(), source })
}

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

fn decode(bytes: &[u8]) -> Result<DynamicImage, String> {
    if bytes.starts_with(PNG_SIGNATURE) {
        let bare = bare_png(bytes);
        return from_decoder(
            image::codecs::png::PngDecoder::with_limits(Cursor::new(&*bare), limits()).map_err(damaged)?,
        );
    }
    if bytes.starts_with(JPEG_SIGNATURE) {
        let bytes = jpeg_tables::with_tables(bytes);
        // The decoder fills in missing data, and takes a missing end marker for missing pixels.
        let bytes = match jpeg::check(&bytes)? {
            Ending::Marked => bytes,
            Ending::Unmarked => Cow::Owned([&bytes, &b"\xff\xd9"[..]].concat()),
        };
        return from_decoder(image::codecs::jpeg::JpegDecoder::new(Cursor::new(&*bytes)).map_err(damaged)?);
    }
    Err(neither(bytes))
}

fn limits() -> image::Limits {
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    limits
}

fn from_decoder(mut decoder: impl ImageDecoder) -> Result<DynamicImage, String> {
    decoder.set_limits(limits()).map_err(|e| e.to_string())?;
    DynamicImage::from_decoder(decoder).map_err(damaged)
}

fn damaged(error: image::ImageError) -> String {
    match error {
        image::ImageError::Unsupported(what) => format!("a picture of this kind is not supported: {what}"),
        error => format!("the picture is damaged or truncated: {error}"),
    }
}

/// The refusal of a file that begins neither as a PNG nor as a JPEG.
fn neither(start: &[u8]) -> String {
    unsupported::by_content(start).map_or_else(|| NEITHER.to_owned(), unsupported::UnsupportedKind::refusal)
}

const NEITHER: &str = "is neither a PNG nor a JPEG picture";

fn header(reader: &mut (impl BufRead + Seek)) -> Result<PictureHeader, String> {
    let start = reader.fill_buf().map_err(|e| e.to_string())?;
    if start.starts_with(JPEG_SIGNATURE) {
        return jpeg_header(reader);
    }
    // PNG: signature, length and name of the first chunk, width, height, bit depth.
    if !start.starts_with(PNG_SIGNATURE) {
        return Err(neither(start));
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ExtendedColorType as Color, ImageEncoder};
    use proptest::prelude::*;
    use std::path::PathBuf;

    #[test]
    fn file_without_a_picture_is_distinguished_from_a_missing_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("f.png");
        let heic = *b"\0\0\0\x18ftypheic";
        for bytes in [&heic[..], &[], b"x\n", &[0; 64], PNG_SIGNATURE] {
            std::fs::write(&file, bytes).unwrap();
            assert!(is_no_picture(&read_header(&file).unwrap_err()), "{bytes:?}");
        }
        assert!(!is_no_picture(&read_header(&folder.path().join("missing.png")).unwrap_err()));
    }

    fn png(bytes: &[u8], width: u32, height: u32, color: Color) -> Vec<u8> {
        let mut out = Vec::new();
        image::codecs::png::PngEncoder::new(&mut out).write_image(bytes, width, height, color).unwrap();
        out
    }

    fn jpeg() -> Vec<u8> {
        let mut out = Vec::new();
        let grey: Vec<u8> = (0..32u32 * 24 * 3).map(|i| (i * 7 % 251) as u8).collect();
        image::codecs::jpeg::JpegEncoder::new(&mut out).write_image(&grey, 32, 24, Color::Rgb8).unwrap();
        out
    }

    fn saved(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        // The extension is deliberately wrong: the content decides.
        let file = folder.path().join("picture.jpg");
        std::fs::write(&file, bytes).unwrap();
        (folder, file)
    }

    #[test]
    fn codes_are_returned_as_stored() {
        let words: Vec<u8> = [1u16, 256, 65535].iter().flat_map(|w| w.to_ne_bytes()).collect();
        for (bytes, color, expected, bits) in [
            (vec![1, 2, 3], Color::Rgb8, [1, 2, 3], 8),
            (vec![1, 2, 3, 99], Color::Rgba8, [1, 2, 3], 8),
            (vec![77], Color::L8, [77, 77, 77], 8),
            (words.clone(), Color::Rgb16, [1, 256, 65535], 16),
            (words[2..4].to_vec(), Color::L16, [256, 256, 256], 16),
        ] {
            let (_folder, file) = saved(&png(&bytes, 1, 1, color));
            let pixels = read_pixels(&file).unwrap();
            assert_eq!(pixels.at(0, 0), expected, "{color:?}");
            assert_eq!(pixels.max_code() == 65535, bits == 16);
            assert_eq!(read_header(&file).unwrap(), PictureHeader { width: 1, height: 1, bits });
        }
    }

    #[test]
    fn jpeg_header_and_pixels_agree() {
        let (_folder, file) = saved(&jpeg());
        let pixels = read_pixels(&file).unwrap();
        assert_eq!(read_header(&file).unwrap(), PictureHeader { width: pixels.width, height: pixels.height, bits: 8 });
        assert_eq!((pixels.width, pixels.height), (32, 24));
    }

    #[test]
    fn every_truncation_is_an_error_with_its_path() {
        for whole in [jpeg(), png(&[7; 300], 10, 10, Color::Rgb8)] {
            decode(&whole).unwrap();
            // Without (part of) its end chunk a PNG's pixels are still complete and checked, as are
            // a JPEG's without its end marker.
            let end = if whole.starts_with(PNG_SIGNATURE) { 12 } else { 2 };
            for length in 0..whole.len() - end {
                assert!(decode(&whole[..length]).is_err(), "{length} of {} bytes pass", whole.len());
            }
            let (_folder, file) = saved(&whole);
            check_end(&file).unwrap();
            let end = if whole.starts_with(PNG_SIGNATURE) { 0 } else { 2 };
            for length in 0..whole.len() - end {
                std::fs::write(&file, &whole[..length]).unwrap();
                assert!(check_end(&file).is_err(), "the end of {length} of {} bytes passes", whole.len());
            }
        }
        let (_folder, file) = saved(&jpeg()[..400]);
        let error = read_pixels(&file).unwrap_err().to_string();
        assert!(error.starts_with(&file.display().to_string()) && error.contains("truncated"), "{error}");
    }

    /// Cut off anywhere in its data and ended with a marker, as left by programs that save a
    /// partial read.
    #[test]
    fn an_end_marker_does_not_make_a_jpeg_whole() {
        let whole = jpeg();
        let data = whole.windows(2).position(|pair| pair == b"\xff\xda").unwrap() + 14;
        for length in data..whole.len() - 2 {
            let cut = [&whole[..length], b"\xff\xd9"].concat();
            let error = decode(&cut).unwrap_err();
            assert!(error.contains("truncated"), "{length} of {} bytes: {error}", whole.len());
        }
        // Harmless: bytes after the end, bytes and fill before it, no end marker.
        let pixels = decode(&whole).unwrap();
        let body = &whole[..whole.len() - 2];
        for odd in [
            [&whole[..], b"trailing \xff\xd8\xff\xd9"].concat(),
            [body, b"\0\0\xff\xff\xff\xd9"].concat(),
            body.to_vec(),
            [body, b"\xff"].concat(),
        ] {
            assert_eq!(decode(&odd).unwrap(), pixels);
        }
    }

    /// A colour profile of 32 MB that packs into a few KB, and 100 GB after the end of a picture of
    /// 3 pixels.
    #[test]
    fn content_besides_pixels_is_neither_unpacked_nor_read() {
        let plain = png(&[1, 2, 3, 4, 5, 6, 7, 8, 9], 3, 1, Color::Rgb8);
        let mut heavy = Vec::new();
        let mut encoder = image::codecs::png::PngEncoder::new(&mut heavy);
        encoder.set_icc_profile(vec![0; 32 << 20]).unwrap();
        encoder.write_image(&[1, 2, 3, 4, 5, 6, 7, 8, 9], 3, 1, Color::Rgb8).unwrap();
        let contains = |bytes: &[u8], name: &[u8]| bytes.windows(4).any(|at| at == name);
        assert!(contains(&heavy, b"iCCP") && !contains(&bare_png(&heavy), b"iCCP"));
        assert_eq!(*bare_png(&heavy), *bare_png(&plain));
        assert_eq!(*bare_png(&plain), *plain);
        assert_eq!(*bare_png(&[&plain[..], &[7; 99]].concat()), *plain);
        let (_folder, file) = saved(&heavy);
        assert_eq!(read_pixels(&file).unwrap().at(2, 0), [7, 8, 9]);

        let (_folder, file) = saved(&plain);
        std::fs::OpenOptions::new().write(true).open(&file).unwrap().set_len(100 << 30).unwrap();
        assert_eq!(read_header(&file).unwrap().width, 3);
        for error in [read_pixels(&file).map(drop), check_end(&file)] {
            let error = error.unwrap_err().to_string();
            assert!(error.contains("it holds 107374182400 bytes; at most 67108912 are read"), "{error}");
        }
        // A header that promises more than is allowed.
        let mut vast = plain;
        vast[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        let (_folder, file) = saved(&vast);
        assert!(read_pixels(&file).unwrap_err().to_string().contains("is 65536x65536 with 8 bits; at most"));
    }

    #[cfg(unix)]
    #[test]
    fn pipe_is_refused_as_a_picture() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("a.png");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert!(read_header(&pipe).unwrap_err().to_string().contains("a pipe or a device"));
        assert!(read_pixels(&pipe).is_err() && read_depth(&pipe, 1.0, 0.0).is_err() && check_end(&pipe).is_err());
        assert!(crate::source::exif::read(&pipe).is_err());
        assert!(crate::source::video::probe(&pipe, &Default::default()).unwrap_err().to_string().contains("a pipe"));
    }

    #[test]
    fn endless_scans_are_refused_quickly() {
        let whole = std::fs::read("tests/jpeg/progressive-420.jpg").unwrap();
        let scans: Vec<usize> = (0..whole.len() - 1).filter(|at| whole[*at..*at + 2] == [0xff, 0xda]).collect();
        // The second scan has coefficients of one component; repeating it changes nothing.
        let second = &whole[scans[1]..scans[2]];
        let many = [&whole[..scans[2]], &second.repeat(100), &whole[scans[2]..]].concat();
        let (_folder, file) = saved(&many);
        for error in [read_pixels(&file).map(drop), check_end(&file)] {
            let error = error.unwrap_err().to_string();
            assert!(error.contains("more than 100 scans"), "{error}");
        }
    }

    #[test]
    fn depth_is_in_metres_and_needs_16_bit_grey() {
        let words: Vec<u8> = [0u16, 5000, 12345].iter().flat_map(|w| w.to_ne_bytes()).collect();
        let (_folder, file) = saved(&png(&words, 3, 1, Color::L16));
        let depth = read_depth(&file, 5000.0, 4.5).unwrap();
        assert_eq!(depth, DepthMap { width: 3, height: 1, depth_m: vec![0.0, 1.0, 2.469], timestamp_s: 4.5 });
        let (_folder, file) = saved(&png(&[1, 2, 3], 3, 1, Color::L8));
        assert!(read_depth(&file, 5000.0, 0.0).unwrap_err().to_string().contains("16-bit grey PNG"));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(kind in 0usize..3, bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let start: &[u8] = [PNG_SIGNATURE, JPEG_SIGNATURE, b""][kind];
            let bytes = [start, &bytes].concat();
            let _ = decode(&bytes);
            let _ = header(&mut Cursor::new(&bytes));
            let _ = (png_end(&bytes), jpeg::check(&bytes));
        }

        #[test]
        fn damaged_pictures_never_panic(at in 0usize..2000, value in any::<u8>()) {
            for mut bytes in [jpeg(), png(&[7; 300], 10, 10, Color::Rgb8)] {
                let at = at % bytes.len();
                bytes[at] = value;
                let _ = decode(&bytes);
                let _ = header(&mut Cursor::new(&bytes));
            }
        }
    }
}
