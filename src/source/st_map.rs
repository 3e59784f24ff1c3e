//! ST maps as files: OpenEXR of 32-bit floats, and PNG and TIFF of 16 bits. Each pixel has the
//! place in another picture where its value comes from.

use std::io::Cursor;
use std::path::Path;

use exr::compression::Compression;
use exr::meta::attribute::SampleType;
use exr::prelude::MetaData;
use image::DynamicImage;

use super::exr_layer::{self, damaged};
use super::still_decoder::decode;
use super::still_format::StillFormat;
use super::tiff_samples::{self, SampleKind, TiffHeader};
use super::{SourceError, file as plain};

/// Largest number of pixels.
const MAX_PIXELS: u64 = 1 << 26;
/// Largest file, bytes: four uncompressed channels of 32 bits.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// The formats for messages.
const FORMATS: &str = "OpenEXR of 32-bit float, or PNG or TIFF of 16 bits";
/// Names of the channels S and T, without a layer's name.
const CHANNELS: [[&str; 2]; 3] = [["R", "G"], ["u", "v"], ["S", "T"]];

/// The pixels of an ST map.
#[derive(Clone, Debug, PartialEq)]
pub struct StPicture {
    /// Size of the picture to which the map belongs, px: the display window.
    pub size_px: [u32; 2],
    /// Upper left corner of the pixels in it, px; negative for overscan.
    pub corner_px: [i32; 2],
    pub width: usize,
    pub height: usize,
    /// S and T, row by row from the upper left.
    pub st: Vec<[f32; 2]>,
}

/// Reads an ST map.
pub fn read(file: &Path) -> Result<StPicture, SourceError> {
    let bytes =
        plain::read(file, MAX_FILE_BYTES).map_err(|source| SourceError::Read { file: file.to_owned(), source })?;
    let picture = match StillFormat::of_content(&bytes) {
        Some(StillFormat::Exr) => exr_map(&bytes),
        Some(format @ (StillFormat::Png | StillFormat::Tiff)) => {
            check_tiff(&bytes, format).and_then(|()| decode(&bytes, format)).and_then(coded_map)
        }
        Some(other) => Err(format!("is {}; an ST map is {FORMATS}", other.name())),
        None => Err(format!("is no picture; an ST map is {FORMATS}")),
    };
    picture.map_err(|problem| SourceError::content(file, problem))
}

/// Refuses a TIFF of half floats.
fn check_tiff(bytes: &[u8], format: StillFormat) -> Result<(), String> {
    if format != StillFormat::Tiff {
        return Ok(());
    }
    match tiff_samples::header(Cursor::new(bytes))? {
        Some(TiffHeader { width, kind: SampleKind::Float { bits: 16 }, .. }) => Err(half_floats(f64::from(width))),
        _ => Ok(()),
    }
}

/// The refusal of half floats: between 0.5 and 1 they are 1/2048 apart.
fn half_floats(width: f64) -> String {
    format!("has half floats, steps of up to {:.1} px: write it with 32 bits", width / 2048.0)
}

/// A map of integers, full scale being 1, or a TIFF of floats.
fn coded_map(picture: DynamicImage) -> Result<StPicture, String> {
    let (width, height) = (picture.width(), picture.height());
    let st = match picture {
        DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_) => {
            let fraction = |code: u16| f32::from(code) / f32::from(u16::MAX);
            picture.into_rgb16().pixels().map(|rgb| [rgb[0], rgb[1]].map(fraction)).collect()
        }
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            picture.into_rgb32f().pixels().map(|rgb| [rgb[0], rgb[1]]).collect()
        }
        other if other.color().has_color() => {
            let step_px = f64::from(width) / 255.0;
            return Err(format!("has 8 bits, steps of {step_px:.1} px: write it as {FORMATS}"));
        }
        _ => return Err("is grey; S is in its red and T in its green".to_owned()),
    };
    Ok(StPicture { size_px: [width, height], corner_px: [0; 2], width: width as usize, height: height as usize, st })
}

/// The channels of S and T: of a layer without a name, or else of the first with both.
fn st_channels(names: &[String]) -> Option<[usize; 2]> {
    let position = |name: String| names.iter().position(|other| *other == name);
    let layers = || names.iter().map(|name| name.rfind('.').map_or("", |dot| &name[..=dot]));
    let pair =
        |layer: &str, [s, t]: [&str; 2]| Some([position(format!("{layer}{s}"))?, position(format!("{layer}{t}"))?]);
    let of_layer = |layer: &str| CHANNELS.into_iter().find_map(|channels| pair(layer, channels));
    of_layer("").or_else(|| layers().find_map(of_layer))
}

/// Checks sizes and types before anything is decoded.
fn check_header(bytes: &[u8]) -> Result<(), String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| damaged(&e))?;
    let mut names = Vec::new();
    for header in &meta.headers {
        let display = header.shared_attributes.display_window.size;
        for (width, height) in [(header.layer_size.0, header.layer_size.1), (display.0, display.1)] {
            if (width as u64).saturating_mul(height as u64) > MAX_PIXELS {
                return Err(format!("is {width}x{height}; at most {MAX_PIXELS} pixels are read"));
            }
        }
        if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
            return Err("is compressed by DWA, which loses precision; write it with ZIP".to_owned());
        }
        let own: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
        if let Some(channels) = st_channels(&own) {
            if channels.iter().any(|at| header.channels.list[*at].sample_type != SampleType::F32) {
                return Err(half_floats(display.0 as f64));
            }
            return Ok(());
        }
        names.extend(own);
    }
    names.truncate(8);
    Err(format!("has the channels {}; expected S in R and T in G, 32-bit float", names.join(", ")))
}

fn exr_map(bytes: &[u8]) -> Result<StPicture, String> {
    check_header(bytes)?;
    let layer = exr_layer::read(bytes, st_channels)?.ok_or("has no channels of S and T")?;
    let side = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
    let [s, t] = layer.channels;
    Ok(StPicture {
        size_px: layer.display_px.map(side),
        corner_px: layer.corner_px,
        width: layer.width,
        height: layer.height,
        st: s.into_iter().zip(t).map(|(s, t)| [s, t]).collect(),
    })
}

#[cfg(test)]
mod tests {
    use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes};
    use exr::prelude::{ImageAttributes, WritableImage};

    use super::*;

    fn exr(channels: Vec<(&str, FlatSamples)>, corner: (i32, i32)) -> Vec<u8> {
        let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect();
        let attributes = LayerAttributes { layer_position: corner.into(), ..LayerAttributes::default() };
        let layer = Layer::new((2, 1), attributes, Encoding::UNCOMPRESSED, AnyChannels::sort(channels));
        let display = ImageAttributes::new(IntegerBounds::from_dimensions((4, 3)));
        let mut bytes = Cursor::new(Vec::new());
        Image::empty(display).with_layer(layer).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn read_bytes(bytes: &[u8]) -> Result<StPicture, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("map");
        std::fs::write(&file, bytes).unwrap();
        read(&file).map_err(|error| error.to_string())
    }

    fn floats(values: [f32; 2]) -> FlatSamples {
        FlatSamples::F32(values.to_vec())
    }

    #[test]
    fn exr_map_has_its_display_window_and_named_channels() {
        let expected =
            StPicture { size_px: [4, 3], corner_px: [-1, 2], width: 2, height: 1, st: vec![[0.25, 1.5], [0.5, -0.5]] };
        for [s, t] in [["R", "G"], ["forward.u", "forward.v"], ["lens.R", "lens.G"]] {
            let channels = vec![(s, floats([0.25, 0.5])), (t, floats([1.5, -0.5])), ("Z", floats([9.0; 2]))];
            assert_eq!(read_bytes(&exr(channels, (-1, 2))).unwrap(), expected);
        }
        let half = FlatSamples::F16(vec![half::f16::ONE; 2]);
        for (channels, problem) in [
            (vec![("Y", floats([0.0; 2]))], "has the channels Y; expected S in R and T in G"),
            (vec![("R", half.clone()), ("G", half)], "has half floats, steps of up to 0.0 px"),
        ] {
            let error = read_bytes(&exr(channels, (0, 0))).unwrap_err();
            assert!(error.contains(problem), "{error}");
        }
    }

    #[test]
    fn integers_of_16_bits_are_fractions_of_full_scale() {
        let png = |picture: DynamicImage| {
            let mut bytes = Cursor::new(Vec::new());
            picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
            read_bytes(bytes.get_ref())
        };
        let codes = vec![0, 65535, 7, 13107, 32768, 0];
        let map = png(image::ImageBuffer::from_raw(2, 1, codes).map(DynamicImage::ImageRgb16).unwrap()).unwrap();
        assert_eq!((map.size_px, map.st[0], map.st[1][0]), ([2, 1], [0.0, 1.0], 0.2));
        for (picture, problem) in [
            (DynamicImage::new_rgb8(510, 1), "has 8 bits, steps of 2.0 px"),
            (DynamicImage::new_luma16(2, 2), "is grey"),
        ] {
            let error = png(picture).unwrap_err();
            assert!(error.contains(problem), "{error}");
        }
        assert!(read_bytes(b"P6 1 1 255 abc").unwrap_err().contains("an ST map is OpenEXR"));
        assert!(read_bytes(b"none").unwrap_err().contains("is no picture"));
    }

    #[test]
    fn damaged_map_is_an_error() {
        let bytes = exr(vec![("R", floats([0.5; 2])), ("G", floats([0.5; 2]))], (0, 0));
        for at in 0..bytes.len() {
            assert!(read_bytes(&bytes[..at]).is_err(), "{at}");
            let mut flipped = bytes.clone();
            flipped[at] ^= 0x55;
            let _ = read_bytes(&flipped);
        }
    }
}
