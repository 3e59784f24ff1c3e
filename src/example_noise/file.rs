//! The model as a file beside a profile.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `LOCNOISE` |
//! | 4 | version, little endian like all numbers |
//! | 4 | crc32 of the rest |
//! | 4 | length of the header |
//! | | header, JSON: the numbers, and for each frame its size and the lengths of its PNG files |
//! | | five PNG files for each frame |
//!
//! They are content (RGB, 8 bits), flags (grey, 8 bits) and residuals of Y', Cb and Cr (grey,
//! 16 bits, 32768 is 0).

use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::{ExtendedColorType, ImageDecoder, ImageEncoder};
use serde::{Deserialize, Serialize};

use super::atlas::SourceFrame;
use super::source_picture::SourcePicture;
use super::{ModelError, ModelNumbers, NoiseModel};

const MAGIC: &[u8; 8] = b"LOCNOISE";
const VERSION: u32 = 1;
/// Bytes before the header.
const PREFIX: usize = 20;
/// Largest side of a frame, px.
const MAX_SIDE: usize = 1 << 14;
/// Largest number of px of all frames.
const MAX_PX: usize = 1 << 23;
const PARTS: usize = 5;
/// Stored value of a residual of 0.
const ZERO: i32 = 1 << 15;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    numbers: ModelNumbers,
    frames: Vec<AtlasFrameHeader>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AtlasFrameHeader {
    size: [usize; 2],
    lengths: [usize; PARTS],
    /// Missing in older files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    picture: Option<SourcePicture>,
}

/// Why a model cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    #[error("this is no noise model: it does not start with LOCNOISE; give a file of `locard calibrate noise`")]
    NoModel,
    #[error("the noise model has version {actual}, expected {VERSION}; calibrate again with this release")]
    Version { actual: u32 },
    #[error("the noise model is damaged or cut short at {length} bytes; copy it again or calibrate again")]
    Damaged { length: usize },
    #[error("the noise model's header is not valid; calibrate again")]
    Header(#[source] serde_json::Error),
    #[error(
        "picture {part} of frame {frame} in the noise model is {actual:?} px, expected {expected:?}; calibrate again"
    )]
    Size { frame: usize, part: usize, actual: [usize; 2], expected: [usize; 2] },
    #[error("picture {part} of frame {frame} in the noise model is not valid; calibrate again")]
    Picture { frame: usize, part: usize, source: image::ImageError },
    #[error("the noise model has frames of {actual} px in all, expected at most {MAX_PX}; calibrate again")]
    TooLarge { actual: usize },
    #[error("the noise model cannot be encoded")]
    Encoding(#[source] image::ImageError),
    #[error(transparent)]
    Model(#[from] ModelError),
}

fn part_size(size: [usize; 2], part: usize, factor: [usize; 2]) -> [usize; 2] {
    if part < 3 { size } else { [size[0] / factor[0], size[1] / factor[1]] }
}

fn color(part: usize) -> (image::ColorType, ExtendedColorType) {
    match part {
        0 => (image::ColorType::Rgb8, ExtendedColorType::Rgb8),
        1 => (image::ColorType::L8, ExtendedColorType::L8),
        _ => (image::ColorType::L16, ExtendedColorType::L16),
    }
}

fn encoded(bytes: &[u8], size: [usize; 2], part: usize) -> Result<Vec<u8>, ModelFileError> {
    let mut png = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Default, FilterType::Adaptive);
    let [width, height] = size.map(|side| side as u32);
    encoder.write_image(bytes, width, height, color(part).1).map_err(ModelFileError::Encoding)?;
    Ok(png)
}

/// The bytes of a model's file.
pub fn to_bytes(model: &NoiseModel) -> Result<Vec<u8>, ModelFileError> {
    let factor = model.numbers.chroma_factor();
    let (mut frames, mut pictures) = (Vec::new(), Vec::new());
    for source in &model.sources {
        let mut lengths = [0; PARTS];
        for (part, length) in lengths.iter_mut().enumerate() {
            let stored = |v: &i16| (i32::from(*v) + ZERO) as u16;
            let bytes = match part {
                0 => source.content.as_flattened().to_vec(),
                1 => source.flags.clone(),
                _ => source.residuals[part - 2].iter().flat_map(|v| stored(v).to_ne_bytes()).collect(),
            };
            let png = encoded(&bytes, part_size(source.size, part, factor), part)?;
            *length = png.len();
            pictures.extend(png);
        }
        frames.push(AtlasFrameHeader { size: source.size, lengths, picture: source.picture });
    }
    let header = serde_json::to_vec(&Header { numbers: model.numbers, frames }).map_err(ModelFileError::Header)?;
    let body = [&(header.len() as u32).to_le_bytes()[..], &header, &pictures].concat();
    Ok([&MAGIC[..], &VERSION.to_le_bytes(), &crc32fast::hash(&body).to_le_bytes(), &body].concat())
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

/// The model in a file's bytes.
pub fn from_bytes(bytes: &[u8]) -> Result<NoiseModel, ModelFileError> {
    let damaged = || ModelFileError::Damaged { length: bytes.len() };
    if bytes.get(..MAGIC.len()) != Some(&MAGIC[..]) {
        return Err(ModelFileError::NoModel);
    }
    let version = u32_at(bytes, 8).ok_or_else(damaged)?;
    if version != VERSION {
        return Err(ModelFileError::Version { actual: version });
    }
    let (sum, length) = u32_at(bytes, 12).zip(u32_at(bytes, 16)).ok_or_else(damaged)?;
    if crc32fast::hash(&bytes[16..]) != sum {
        return Err(damaged());
    }
    let (header, mut rest) = bytes[PREFIX..].split_at_checked(length as usize).ok_or_else(damaged)?;
    let header: Header = serde_json::from_slice(header).map_err(ModelFileError::Header)?;
    // Before any division by them.
    if header.numbers.chroma_factor().iter().any(|factor| !matches!(factor, 1 | 2)) {
        return Err(ModelError::Numbers.into());
    }
    let area = |frame: &AtlasFrameHeader| frame.size[0].saturating_mul(frame.size[1]);
    let area_px = header.frames.iter().map(area).fold(0, usize::saturating_add);
    if area_px > MAX_PX {
        return Err(ModelFileError::TooLarge { actual: area_px });
    }
    let mut sources = Vec::new();
    for (frame, AtlasFrameHeader { size, lengths, picture }) in header.frames.into_iter().enumerate() {
        let mut parts: [Vec<u8>; PARTS] = Default::default();
        for (part, length) in lengths.into_iter().enumerate() {
            let (png, after) = rest.split_at_checked(length).ok_or_else(damaged)?;
            rest = after;
            parts[part] = decoded(png, part_size(size, part, header.numbers.chroma_factor()), frame, part)?;
        }
        let [content, flags, residuals @ ..] = parts;
        let residual = |bytes: Vec<u8>| {
            let stored = bytes.as_chunks::<2>().0.iter().map(|pair| u16::from_ne_bytes(*pair));
            stored.map(|v| (i32::from(v) - ZERO) as i16).collect()
        };
        let content = content.as_chunks::<3>().0.to_vec();
        sources.push(SourceFrame { size, content, residuals: residuals.map(residual), flags, picture });
    }
    Ok(NoiseModel::new(header.numbers, sources)?)
}

/// The samples of a PNG of the expected size and format.
fn decoded(png: &[u8], expected: [usize; 2], frame: usize, part: usize) -> Result<Vec<u8>, ModelFileError> {
    let invalid = |source| ModelFileError::Picture { frame, part, source };
    let decoder = PngDecoder::new(std::io::Cursor::new(png)).map_err(invalid)?;
    let (width, height) = decoder.dimensions();
    let size_px = [width as usize, height as usize];
    let is_small = expected.iter().all(|side| (1..=MAX_SIDE).contains(side));
    if size_px != expected || !is_small || decoder.color_type() != color(part).0 {
        return Err(ModelFileError::Size { frame, part, actual: size_px, expected });
    }
    let mut samples = vec![0; decoder.total_bytes() as usize];
    decoder.read_image(&mut samples).map_err(invalid)?;
    Ok(samples)
}
