//! TIFF files with samples that `image` does not decode: floating-point numbers, integers of 32
//! bits and palettes. Source: TIFF 6.0 (Adobe, 1992) and its supplements for half floats and
//! BigTIFF.
//!
//! Not modelled: signed integers and integers of 64 bits, alpha and other extra samples.

use std::io::{Cursor, Read, Seek};

use image::{DynamicImage, ImageBuffer};
use tiff::TiffError;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{PhotometricInterpretation, SampleFormat, Tag};

/// Kinds of samples that are decoded here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleKind {
    /// Indices of a palette.
    Palette,
    /// Floating-point numbers of 16, 32 or 64 bits.
    Float { bits: u16 },
    /// Unsigned integers of 32 bits.
    Integer,
}

/// The contents of a header, if the samples are decoded here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TiffHeader {
    pub width: u32,
    pub height: u32,
    pub kind: SampleKind,
}

/// Samples of grey or R, G, B, interleaved, as stored.
#[derive(Debug)]
pub struct TiffSamples {
    pub width: u32,
    pub height: u32,
    /// 1 or 3.
    pub channel_count: usize,
    pub values: Vec<f32>,
}

/// Reads the header. `None` if `image` decodes the samples.
pub fn header(reader: impl Read + Seek) -> Result<Option<TiffHeader>, String> {
    let mut decoder = Decoder::new(reader).map_err(damaged)?;
    let kind = kind(&mut decoder).map_err(damaged)?;
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    Ok(kind.map(|kind| TiffHeader { width, height, kind }))
}

fn kind<R: Read + Seek>(decoder: &mut Decoder<R>) -> Result<Option<SampleKind>, TiffError> {
    let mut first =
        |tag| decoder.find_tag_unsigned_vec::<u16>(tag).map(|values| values.and_then(|values| values.first().copied()));
    let photometric = first(Tag::PhotometricInterpretation)?;
    let format = first(Tag::SampleFormat)?.unwrap_or(SampleFormat::Uint.to_u16());
    let bits = first(Tag::BitsPerSample)?.unwrap_or(1);
    let (is_float, is_integer) = (format == SampleFormat::IEEEFP.to_u16(), format == SampleFormat::Uint.to_u16());
    Ok(match bits {
        _ if photometric == Some(PhotometricInterpretation::RGBPalette.to_u16()) => Some(SampleKind::Palette),
        bits if is_float => Some(SampleKind::Float { bits }),
        32 if is_integer => Some(SampleKind::Integer),
        _ => None,
    })
}

/// Decodes a picture, within a limit on its memory. `None` if `image` decodes its samples.
/// Floating-point numbers are linear light; integers and palettes are codes.
pub fn picture(bytes: &[u8], max_bytes: u64) -> Result<Option<DynamicImage>, String> {
    let Some(TiffHeader { kind, .. }) = header(Cursor::new(bytes))? else { return Ok(None) };
    if kind == SampleKind::Palette {
        return palette_picture(bytes, max_bytes).map(Some);
    }
    let TiffSamples { width, height, channel_count, values } = samples(bytes, max_bytes)?;
    let rgb = values
        .chunks_exact(channel_count)
        .flat_map(|pixel| std::array::from_fn::<_, 3, _>(|c| pixel[c % channel_count]));
    let picture = if kind == SampleKind::Integer {
        let code = |value: f32| (f64::from(value) / f64::from(u32::MAX) * f64::from(u16::MAX)).round() as u16;
        ImageBuffer::from_raw(width, height, rgb.map(code).collect()).map(DynamicImage::ImageRgb16)
    } else {
        ImageBuffer::from_raw(width, height, rgb.collect()).map(DynamicImage::ImageRgb32F)
    };
    picture.ok_or_else(incomplete).map(Some)
}

/// Decodes floating-point numbers and integers of 32 bits, within a limit on their memory.
pub fn samples(bytes: &[u8], max_bytes: u64) -> Result<TiffSamples, String> {
    let mut decoder = decoder(bytes, max_bytes)?;
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    let stored_count = usize::from(decoder.colortype().map_err(damaged)?.num_samples());
    let mut buffer = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut buffer).map_err(damaged)?;
    let stored: Vec<f32> = match buffer {
        DecodingResult::F16(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::F32(values) => values,
        DecodingResult::F64(values) => values.into_iter().map(|value| value as f32).collect(),
        DecodingResult::U32(values) => values.into_iter().map(|value| value as f32).collect(),
        _ => return Err("its samples are neither floating-point numbers nor integers of 32 bits".to_owned()),
    };
    let pixel_count = width as usize * height as usize;
    let channel_count = if stored_count < 3 { 1 } else { 3 };
    if stored.len() < pixel_count * stored_count {
        return Err(incomplete());
    }
    let (pixel_stride, channel_stride) = if layout.planes > 1 { (1, pixel_count) } else { (stored_count, 1) };
    let value = |i: usize| stored[i / channel_count * pixel_stride + i % channel_count * channel_stride];
    let values = (0..pixel_count * channel_count).map(value).collect();
    Ok(TiffSamples { width, height, channel_count, values })
}

/// The colours of a palette, 8 bits each.
fn palette_picture(bytes: &[u8], max_bytes: u64) -> Result<DynamicImage, String> {
    let palette = decoder(bytes, max_bytes)?.get_tag_u16_vec(Tag::ColorMap).map_err(damaged)?;
    // The decoder has no palettes, but returns the samples of a grey picture as they are.
    let grey = as_grey(bytes).ok_or_else(incomplete)?;
    let mut decoder = decoder(&grey, max_bytes)?;
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    let bits = usize::from(decoder.colortype().map_err(damaged)?.bit_depth());
    if ![1, 2, 4, 8, 16].contains(&bits) {
        return Err(format!("the indices of its palette have {bits} bits; 1, 2, 4, 8 and 16 are read"));
    }
    let mut buffer = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut buffer).map_err(damaged)?;
    let indices: Vec<usize> = match buffer {
        DecodingResult::U8(packed) if bits <= 8 => {
            let stride = layout.row_stride.map_or(packed.len(), std::num::NonZero::get);
            let index =
                |row: &[u8], x: usize| usize::from(row[x * bits / 8]) >> (8 - bits - x * bits % 8) & ((1 << bits) - 1);
            packed.chunks_exact(stride).flat_map(|row| (0..width as usize).map(move |x| index(row, x))).collect()
        }
        DecodingResult::U16(indices) => indices.into_iter().map(usize::from).collect(),
        _ => return Err(incomplete()),
    };
    // Red, green, blue one after another, 16 bits each; 8 bits from some programs.
    let color_count = 1 << bits;
    if palette.len() != 3 * color_count {
        return Err(format!("has a palette of {} values for indices of {bits} bits", palette.len()));
    }
    let shift = if palette.iter().all(|value| *value < 256) { 0 } else { 8 };
    let code = |index: usize, c: usize| (palette[c * color_count + index] >> shift) as u8;
    let rgb = indices.into_iter().flat_map(|index| [0, 1, 2].map(|c| code(index, c))).collect();
    ImageBuffer::from_raw(width, height, rgb).map(DynamicImage::ImageRgb8).ok_or_else(incomplete)
}

/// The file with its first picture declared as grey instead of a palette's.
fn as_grey(bytes: &[u8]) -> Option<Vec<u8>> {
    let is_big_endian = bytes.starts_with(b"MM");
    let number = |at: usize, length: usize| -> Option<usize> {
        let field = bytes.get(at..at.checked_add(length)?)?;
        let append = |value: usize, byte: &u8| value << 8 | usize::from(*byte);
        Some(if is_big_endian { field.iter().fold(0, append) } else { field.iter().rev().fold(0, append) })
    };
    let is_big_tiff = number(2, 2)? == 43;
    let (offset_at, offset_bytes, count_bytes) = if is_big_tiff { (8, 8, 8) } else { (4, 4, 2) };
    // Tag and type, two bytes each; number of values; value or offset.
    let entry_bytes = 4 + 2 * offset_bytes;
    let directory = number(offset_at, offset_bytes)?;
    let entries = bytes.get(directory.checked_add(count_bytes)?..)?.chunks_exact(entry_bytes);
    let is_photometric = |i: usize| {
        number(directory + count_bytes + i * entry_bytes, 2)
            == Some(usize::from(Tag::PhotometricInterpretation.to_u16()))
    };
    let entry = (0..entries.len().min(number(directory, count_bytes)?)).find(|i| is_photometric(*i))?;
    let value_at = directory + count_bytes + (entry + 1) * entry_bytes - offset_bytes;
    let grey = PhotometricInterpretation::BlackIsZero.to_u16();
    let mut changed = bytes.to_vec();
    let value = if is_big_endian { grey.to_be_bytes() } else { grey.to_le_bytes() };
    changed[value_at..value_at + 2].copy_from_slice(&value);
    Some(changed)
}

/// The ICC profile. `None` without one, and for damaged files.
pub fn icc_profile(bytes: &[u8]) -> Option<Vec<u8>> {
    Decoder::new(Cursor::new(bytes)).ok()?.get_tag_u8_vec(Tag::IccProfile).ok()
}

fn decoder(bytes: &[u8], max_bytes: u64) -> Result<Decoder<Cursor<&[u8]>>, String> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = usize::try_from(max_bytes).unwrap_or(usize::MAX);
    Ok(Decoder::new(Cursor::new(bytes)).map_err(damaged)?.with_limits(limits))
}

fn incomplete() -> String {
    "the picture is damaged or truncated: it has too few samples".to_owned()
}

fn damaged(error: TiffError) -> String {
    match error {
        TiffError::UnsupportedError(what) => {
            format!("a picture of this kind is not supported: {what}; convert it to a PNG or a TIFF of 16 bits")
        }
        error => format!("the picture is damaged or truncated: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::*;
    use proptest::prelude::*;

    const MAX_BYTES: u64 = 16 << 20;
    /// Values of the tag SampleFormat.
    const UINT: u64 = 1;
    const FLOAT: u64 = 3;
    /// Values of the tag PhotometricInterpretation.
    const GREY: u64 = 1;
    const RGB: u64 = 2;
    const PALETTE: u64 = 3;

    /// The variant of a file.
    #[derive(Clone, Copy)]
    struct Variant {
        is_big_endian: bool,
        is_big_tiff: bool,
    }

    const VARIANTS: [Variant; 4] = [
        Variant { is_big_endian: false, is_big_tiff: false },
        Variant { is_big_endian: true, is_big_tiff: false },
        Variant { is_big_endian: false, is_big_tiff: true },
        Variant { is_big_endian: true, is_big_tiff: true },
    ];

    /// The contents of a file with one row.
    #[derive(Clone)]
    struct Picture {
        width: u64,
        bits: u64,
        format: u64,
        photometric: u64,
        palette: Vec<u16>,
        planes: Vec<Vec<u8>>,
        sample_count: usize,
    }

    impl Picture {
        fn palette(width: u64, bits: u64, palette: &[u16], indices: &[u8]) -> Self {
            let (palette, planes) = (palette.to_vec(), vec![indices.to_vec()]);
            Self { width, bits, format: UINT, photometric: PALETTE, palette, planes, sample_count: 1 }
        }
    }

    impl Variant {
        fn number(self, value: u64, length: usize) -> Vec<u8> {
            if self.is_big_endian {
                value.to_be_bytes()[8 - length..].to_vec()
            } else {
                value.to_le_bytes()[..length].to_vec()
            }
        }

        /// A file with one strip for each plane. Each tag has values of 16 bits, or one of 32 bits
        /// for offsets.
        fn file(self, picture: &Picture) -> Vec<u8> {
            let Picture { width, bits, format, photometric, sample_count, .. } = *picture;
            let Picture { palette, planes, .. } = picture;
            let offset_bytes = if self.is_big_tiff { 8 } else { 4 };
            let mut out = if self.is_big_endian { b"MM".to_vec() } else { b"II".to_vec() };
            out.extend(self.number(if self.is_big_tiff { 43 } else { 42 }, 2));
            if self.is_big_tiff {
                out.extend([self.number(8, 2), self.number(0, 2)].concat());
            }
            let header_bytes = out.len() + offset_bytes;
            let mut body = Vec::new();
            let place = |body: &mut Vec<u8>, bytes: &[u8]| {
                let at = header_bytes + body.len();
                body.extend_from_slice(bytes);
                body.resize(body.len().next_multiple_of(8), 0);
                at as u64
            };
            let strips: Vec<u64> = planes.iter().map(|plane| place(&mut body, plane)).collect();
            let lengths: Vec<u64> = planes.iter().map(|plane| plane.len() as u64).collect();
            let planar = if planes.len() > 1 { 2 } else { 1 };
            let mut tags: Vec<(u64, u64, Vec<u64>)> = vec![
                (256, 3, vec![width]),
                (257, 3, vec![1]),
                (258, 3, vec![bits; sample_count]),
                (259, 3, vec![1]),
                (262, 3, vec![photometric]),
                (273, 4, strips),
                (277, 3, vec![sample_count as u64]),
                (278, 3, vec![1]),
                (279, 4, lengths),
                (284, 3, vec![planar]),
            ];
            if !palette.is_empty() {
                tags.push((320, 3, palette.iter().map(|value| u64::from(*value)).collect()));
            }
            tags.push((339, 3, vec![format; sample_count]));
            let mut entries = self.number(tags.len() as u64, if self.is_big_tiff { 8 } else { 2 });
            for (tag, kind, values) in tags {
                let length = if kind == 3 { 2 } else { 4 };
                let mut bytes: Vec<u8> = values.iter().flat_map(|value| self.number(*value, length)).collect();
                if bytes.len() > offset_bytes {
                    let at = place(&mut body, &bytes);
                    bytes = self.number(at, offset_bytes);
                }
                bytes.resize(offset_bytes, 0);
                entries.extend(
                    [self.number(tag, 2), self.number(kind, 2), self.number(values.len() as u64, offset_bytes), bytes]
                        .concat(),
                );
            }
            entries.extend(self.number(0, offset_bytes));
            let directory = place(&mut body, &entries);
            out.extend(self.number(directory, offset_bytes));
            out.extend(body);
            out
        }

        /// A picture of 2×1 pixels by its samples, pixel by pixel.
        fn numbers(self, bits: u64, format: u64, samples: &[u64], sample_count: usize) -> Vec<u8> {
            let plane = samples.iter().flat_map(|value| self.number(*value, bits as usize / 8)).collect();
            let photometric = if sample_count < 3 { GREY } else { RGB };
            self.file(&Picture {
                width: 2,
                bits,
                format,
                photometric,
                palette: vec![],
                planes: vec![plane],
                sample_count,
            })
        }
    }

    const LIGHT: [f32; 6] = [0.25, 0.5, 1.0, 4.0, 0.0, -1.0];

    fn half(value: f32) -> u64 {
        u64::from(f16::from_f32(value).to_bits())
    }

    fn light(bytes: &[u8]) -> Vec<f32> {
        let Some(DynamicImage::ImageRgb32F(picture)) = picture(bytes, MAX_BYTES).unwrap() else { panic!("no light") };
        picture.into_raw()
    }

    #[test]
    fn floats_of_each_size_are_the_light_as_stored() {
        for variant in VARIANTS {
            let single = LIGHT.map(|value| u64::from(value.to_bits()));
            let double = LIGHT.map(|value| f64::from(value).to_bits());
            for (bits, samples) in [(16, LIGHT.map(half)), (32, single), (64, double)] {
                let bytes = variant.numbers(bits, FLOAT, &samples, 3);
                assert_eq!(light(&bytes), LIGHT);
                let expected = TiffHeader { width: 2, height: 1, kind: SampleKind::Float { bits: bits as u16 } };
                assert_eq!(header(Cursor::new(&bytes)).unwrap(), Some(expected));
            }
        }
    }

    #[test]
    fn planes_alpha_and_grey_become_colours() {
        let variant = VARIANTS[0];
        let planes: Vec<Vec<u8>> = (0..3)
            .map(|c| [0, 3].iter().flat_map(|pixel| variant.number(half(LIGHT[pixel + c]), 2)).collect())
            .collect();
        let planar =
            Picture { width: 2, bits: 16, format: FLOAT, photometric: RGB, palette: vec![], planes, sample_count: 3 };
        assert_eq!(light(&variant.file(&planar)), LIGHT);
        let with_alpha = [0.25, 0.5, 1.0, 0.125, 4.0, 0.0, -1.0, 0.125].map(half);
        assert_eq!(light(&variant.numbers(16, FLOAT, &with_alpha, 4)), LIGHT);
        let grey = [0.25, 0.75].map(half);
        assert_eq!(light(&variant.numbers(16, FLOAT, &grey, 1)), [0.25, 0.25, 0.25, 0.75, 0.75, 0.75]);
    }

    #[test]
    fn integers_of_32_bits_are_fractions_of_full_scale() {
        let samples = [0, u64::from(u32::MAX), 65537 * 12345, 65537, 1 << 31, 7];
        for variant in VARIANTS {
            let bytes = variant.numbers(32, UINT, &samples, 3);
            let Some(DynamicImage::ImageRgb16(codes)) = picture(&bytes, MAX_BYTES).unwrap() else { panic!("no codes") };
            assert_eq!(codes.into_raw(), [0, 65535, 12345, 1, 32768, 0]);
            assert_eq!(super::samples(&bytes, MAX_BYTES).unwrap().values[5], 7.0);
        }
    }

    #[test]
    fn palettes_of_every_depth_are_their_colours() {
        for variant in VARIANTS {
            for bits in [1u64, 2, 4, 8, 16] {
                let color_count = 1usize << bits;
                let index = |x: usize| (5 * x + 1) % color_count.min(200);
                // 11 pixels in a row: its last byte is not full.
                let mut row = vec![0u8; (11 * bits as usize).div_ceil(8)];
                for x in 0..11 {
                    if bits == 16 {
                        row[2 * x..2 * x + 2].copy_from_slice(&variant.number(index(x) as u64, 2));
                    } else {
                        row[x * bits as usize / 8] |= (index(x) << (8 - bits as usize - x * bits as usize % 8)) as u8;
                    }
                }
                for scale in [1u16, 256, 257] {
                    let code = |i: usize| (i % color_count * 3 + i / color_count * 50) % 251;
                    let palette: Vec<u16> = (0..3 * color_count).map(|i| code(i) as u16 * scale).collect();
                    let bytes = variant.file(&Picture::palette(11, bits, &palette, &row));
                    let expected: Vec<u8> = (0..33).map(|i| code(i % 3 * color_count + index(i / 3)) as u8).collect();
                    let Some(DynamicImage::ImageRgb8(codes)) = picture(&bytes, MAX_BYTES).unwrap() else {
                        panic!("{bits}")
                    };
                    assert_eq!(codes.into_raw(), expected, "{bits} bits");
                }
            }
        }
    }

    #[test]
    fn truncated_files_and_short_palettes_are_errors() {
        let variant = VARIANTS[0];
        let whole = variant.file(&Picture::palette(2, 8, &[7; 12], &[1, 0]));
        assert!(picture(&whole, MAX_BYTES).unwrap_err().contains("palette of 12 values for indices of 8 bits"));
        let floats = variant.numbers(16, FLOAT, &LIGHT.map(half), 3);
        assert!(picture(&floats, 4).is_err(), "a limit of 4 bytes");
        // The directory is behind the samples.
        for length in 0..floats.len() - 8 {
            assert!(picture(&floats[..length], MAX_BYTES).is_err(), "{length} of {} bytes pass", floats.len());
        }
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in 0usize..2000, value in any::<u8>()) {
            for variant in VARIANTS {
                let palette = variant.file(&Picture::palette(11, 4, &[7; 48], &[1; 6]));
                for mut bytes in [palette, variant.numbers(16, FLOAT, &LIGHT.map(half), 3)] {
                    let at = at % bytes.len();
                    bytes[at] = value;
                    let _ = (picture(&bytes, MAX_BYTES), header(Cursor::new(&bytes)), icc_profile(&bytes));
                }
            }
        }
    }
}
