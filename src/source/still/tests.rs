use std::io::Cursor;
use std::path::PathBuf;

use image::{ExtendedColorType as Color, ImageEncoder};
use proptest::prelude::*;

use super::super::still_decoder::header;
use super::super::still_format::{JPEG_SIGNATURE, PNG_SIGNATURE};
use super::*;
use crate::pixels::Codes;

#[test]
fn file_without_a_picture_is_distinguished_from_a_missing_one() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("f.png");
    let gif = *b"GIF89a\0\0\0\0\0\0";
    for bytes in [&gif[..], &[], b"x\n", &[0; 64], PNG_SIGNATURE] {
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

/// A header by content.
fn any_header(bytes: &[u8]) -> Result<PictureHeader, String> {
    header(&mut Cursor::new(bytes), StillFormat::of_content(bytes).ok_or_else(no_picture)?)
}

fn encoded(format: image::ImageFormat, picture: &DynamicImage) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    picture.write_to(&mut out, format).unwrap();
    out.into_inner()
}

fn rgb(width: u32, height: u32) -> DynamicImage {
    let codes = (0..3 * width * height).map(|i| (i * 7 % 251) as u8).collect();
    DynamicImage::ImageRgb8(image::RgbImage::from_raw(width, height, codes).unwrap())
}

#[test]
fn lossless_formats_return_the_codes_of_the_png() {
    use image::ImageFormat::{Bmp, Pnm, Tiff, WebP};
    let picture = rgb(5, 3);
    for format in [Tiff, WebP, Bmp, Pnm] {
        let (_folder, file) = saved(&encoded(format, &picture));
        let pixels = read_pixels(&file).unwrap();
        assert_eq!(pixels.codes, Codes::U8(picture.to_rgb8().into_raw()), "{format:?}");
        assert_eq!(read_header(&file).unwrap(), PictureHeader { width: 5, height: 3, bits: 8 }, "{format:?}");
        check_end(&file).unwrap();
    }
}

#[test]
fn tiff_keeps_16_bits_and_encodes_light() {
    let wide = DynamicImage::ImageRgb16(image::ImageBuffer::from_raw(1, 1, vec![1u16, 256, 65535]).unwrap());
    let (_folder, file) = saved(&encoded(image::ImageFormat::Tiff, &wide));
    assert_eq!(read_pixels(&file).unwrap().at(0, 0), [1, 256, 65535]);
    assert_eq!(read_header(&file).unwrap().bits, 16);
    let light = DynamicImage::ImageRgb32F(image::ImageBuffer::from_raw(1, 1, vec![0.18f32, 1.5, 0.0]).unwrap());
    let (_folder, file) = saved(&encoded(image::ImageFormat::Tiff, &light));
    assert_eq!(read_pixels(&file).unwrap().at(0, 0), [30235, 65535, 0]);
    assert_eq!(read_header(&file).unwrap().bits, 16);
    let depth = DynamicImage::ImageLuma16(image::ImageBuffer::from_raw(2, 1, vec![0u16, 5000]).unwrap());
    for format in [image::ImageFormat::Tiff, image::ImageFormat::Pnm] {
        let (_folder, file) = saved(&encoded(format, &depth));
        assert_eq!(read_depth(&file, 5000.0, 0.0).unwrap().depth_m, [0.0, 1.0]);
    }
}

#[test]
fn truncated_pictures_of_every_format_are_errors() {
    use image::ImageFormat::{Bmp, Pnm, Tiff, WebP};
    for format in [Tiff, WebP, Bmp, Pnm] {
        let whole = encoded(format, &rgb(5, 3));
        for length in 0..whole.len() - 1 {
            // A TIFF's directory and a WebP's padding are behind the pixels.
            let is_cut = decode_pixels(&whole[..length]).is_err_and(|problem| !problem.is_empty());
            let _ = any_header(&whole[..length]);
            assert!(is_cut || length + 8 > whole.len(), "{format:?}: {length} of {} bytes pass", whole.len());
        }
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
        decode_pixels(&whole).unwrap();
        // Without (part of) its end chunk a PNG's pixels are still complete and checked, as are
        // a JPEG's without its end marker.
        let end = if whole.starts_with(PNG_SIGNATURE) { 12 } else { 2 };
        for length in 0..whole.len() - end {
            assert!(decode_pixels(&whole[..length]).is_err(), "{length} of {} bytes pass", whole.len());
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
        let error = decode_pixels(&cut).unwrap_err();
        assert!(error.contains("truncated"), "{length} of {} bytes: {error}", whole.len());
    }
    // Harmless: bytes after the end, bytes and fill before it, no end marker.
    let pixels = decode_pixels(&whole).unwrap();
    let body = &whole[..whole.len() - 2];
    for odd in [
        [&whole[..], b"trailing \xff\xd8\xff\xd9"].concat(),
        [body, b"\0\0\xff\xff\xff\xd9"].concat(),
        body.to_vec(),
        [body, b"\xff"].concat(),
    ] {
        assert_eq!(decode_pixels(&odd).unwrap(), pixels);
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
    assert!(read_depth(&file, 5000.0, 0.0).unwrap_err().to_string().contains("16-bit grey picture"));
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(kind in 0usize..8, bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let start: &[u8] = [PNG_SIGNATURE, JPEG_SIGNATURE, b"", b"II*\0\x08\0\0\0", b"BM", b"P6 ", b"RIFF\x90\0\0\0WEBPVP8L", b"\x76\x2f\x31\x01\x02\0\0\0"][kind];
        let bytes = [start, &bytes].concat();
        let _ = decode_pixels(&bytes);
        let _ = any_header(&bytes);
        let _ = (png_end(&bytes), jpeg::check(&bytes));
    }

    #[test]
    fn damaged_pictures_never_panic(at in 0usize..2000, value in any::<u8>()) {
        for mut bytes in [jpeg(), png(&[7; 300], 10, 10, Color::Rgb8)] {
            let at = at % bytes.len();
            bytes[at] = value;
            let _ = decode_pixels(&bytes);
            let _ = any_header(&bytes);
        }
    }
}
