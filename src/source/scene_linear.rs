//! Frames of linear light: OpenEXR (DWA by another program, developed.rs) and pictures of
//! floating-point numbers. They are encoded by the sRGB curve (IEC 61966-2-1) with 16 bits, which a
//! default profile decodes again: the code is exact to 8·10⁻⁶ of full scale.
//!
//! Light above 1 clips, as white does in a camera. Not modelled: the attribute `chromaticities`
//! (Rec. 709 is assumed), deep pictures, layers beside the first with colour.

use std::io::{BufRead, Cursor};

use exr::compression::Compression;
use exr::meta::header::Header;
use exr::prelude::MetaData;

use super::exr_layer::{self, damaged};
use super::still_format::PictureHeader;
use crate::camera::Response;
use crate::pixels::{Codes, Pixels};

/// Largest number of pixels, as 12 bytes of light each.
const MAX_PIXELS: u64 = 1 << 26;

/// The sRGB code of linear light with 16 bits.
fn code(light: f32) -> u16 {
    (65535.0 * Response::default().encode(f64::from(light))).round() as u16
}

/// Linear light as sRGB codes of 16 bits: R, G, B interleaved.
pub fn encoded(light: &[f32]) -> Vec<u16> {
    light.iter().map(|light| code(*light)).collect()
}

/// Linear codes of 16 bits as sRGB codes.
pub fn srgb_encoded(linear: Pixels) -> Pixels {
    let table: Vec<u16> = (0..=u16::MAX).map(|value| code(f32::from(value) / 65535.0)).collect();
    let codes = match linear.codes {
        Codes::U16(codes) => codes.into_iter().map(|value| table[usize::from(value)]).collect(),
        Codes::U8(codes) => codes.into_iter().map(|value| table[257 * usize::from(value)]).collect(),
    };
    Pixels::uncoded(linear.width, linear.height, Codes::U16(codes))
}

/// True if a part of an OpenEXR file is compressed by DWA. False for damaged files.
pub fn is_dwa(reader: impl BufRead) -> bool {
    let headers = MetaData::read_from_buffered(reader, false).map(|meta| meta.headers).unwrap_or_default();
    headers.iter().any(|header| matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)))
}

/// The channels of colour among those of a layer: R, G and B, also with the name of a layer before
/// them, or one of luminance.
fn color_channels(names: &[String]) -> Option<[usize; 3]> {
    let position = |name: &str| names.iter().position(|other| other == name);
    let of_layer = |layer: &str| {
        Some([position(&format!("{layer}R"))?, position(&format!("{layer}G"))?, position(&format!("{layer}B"))?])
    };
    let layers = names.iter().filter_map(|name| name.strip_suffix('R'));
    of_layer("").or_else(|| layers.map(of_layer).find_map(|channels| channels)).or_else(|| Some([position("Y")?; 3]))
}

/// Header of an OpenEXR frame.
pub fn exr_header(reader: impl BufRead) -> Result<PictureHeader, String> {
    let meta = MetaData::read_from_buffered(reader, false).map_err(|e| damaged(&e))?;
    let names = |header: &Header| -> Vec<String> {
        header.channels.list.iter().map(|channel| channel.name.to_string()).collect()
    };
    let has_color = |header: &&Header| !header.deep && color_channels(&names(header)).is_some();
    let Some(header) = meta.headers.iter().find(has_color) else {
        let names: Vec<String> = meta.headers.iter().flat_map(names).take(8).collect();
        return Err(format!("has no flat layer with the channels R, G and B, or Y (found: {})", names.join(", ")));
    };
    let size = header.shared_attributes.display_window.size;
    for size in [size].into_iter().chain(meta.headers.iter().map(|header| header.layer_size)) {
        if (size.0 as u64).saturating_mul(size.1 as u64) > MAX_PIXELS {
            return Err(format!("is {}x{}; at most {MAX_PIXELS} pixels are decoded", size.0, size.1));
        }
    }
    // Both sides are below the limit, unless the other one is 0.
    let side = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
    Ok(PictureHeader { width: side(size.0), height: side(size.1), bits: 16 })
}

/// Pixels of an OpenEXR frame in its display window.
pub fn exr_pixels(bytes: &[u8]) -> Result<Pixels, String> {
    let PictureHeader { width, height, .. } = exr_header(Cursor::new(bytes))?;
    // Its decoder allocates the sizes that a damaged file states.
    if is_dwa(Cursor::new(bytes)) {
        return Err("is compressed by DWA, which is decoded by ffmpeg and from a file only".to_owned());
    }
    let layer = exr_layer::read(bytes, color_channels)?.ok_or("has no channels of colour")?;
    let [red, green, blue] = &layer.channels;
    let light: Vec<f32> = red.iter().zip(green).zip(blue).flat_map(|((r, g), b)| [*r, *g, *b]).collect();
    let [dx, dy] = layer.corner_px.map(i64::from);
    // Outside the data window the picture is black.
    let mut codes = vec![0; 3 * width as usize * height as usize];
    for (row, y) in encoded(&light).chunks_exact((3 * layer.width).max(1)).zip(dy..) {
        for (pixel, x) in row.as_chunks::<3>().0.iter().zip(dx..) {
            if (0..i64::from(width)).contains(&x) && (0..i64::from(height)).contains(&y) {
                let i = 3 * (y as usize * width as usize + x as usize);
                codes[i..i + 3].copy_from_slice(pixel);
            }
        }
    }
    Ok(Pixels::uncoded(width, height, Codes::U16(codes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{
        Encoding, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes, SpecificChannels, Vec2, WritableImage,
    };

    fn exr(attributes: LayerAttributes, window: IntegerBounds) -> Vec<u8> {
        let light = |at: Vec2<usize>| if at == Vec2(0, 0) { (0.18f32, 1.0f32, 4.0f32) } else { (0.0, -0.1, 0.5) };
        let layer = Layer::new((2, 1), attributes, Encoding::FAST_LOSSLESS, SpecificChannels::rgb(light));
        let mut out = Cursor::new(Vec::new());
        Image::empty(ImageAttributes::new(window)).with_layer(layer).write().to_buffered(&mut out).unwrap();
        out.into_inner()
    }

    #[test]
    fn exr_light_is_encoded_by_the_srgb_curve_and_clips_at_1() {
        let pixels = exr_pixels(&exr(LayerAttributes::default(), IntegerBounds::from_dimensions((2, 1)))).unwrap();
        // 1.055 · 0.18^(1/2.4) − 0.055 = 0.461356.
        assert_eq!(pixels.at(0, 0), [30235, 65535, 65535]);
        assert_eq!(pixels.at(1, 0), [0, 0, 48192]);
    }

    #[test]
    fn data_window_is_placed_in_the_display_window() {
        let attributes = LayerAttributes { layer_position: Vec2(12, 21), ..LayerAttributes::default() };
        let bytes = exr(attributes, IntegerBounds::new((10, 20), (3, 2)));
        let header = exr_header(Cursor::new(&bytes)).unwrap();
        assert_eq!((header.width, header.height, header.bits), (3, 2, 16));
        let pixels = exr_pixels(&bytes).unwrap();
        // The second pixel of the data is to the right of the window.
        assert_eq!((pixels.at(2, 1)[0], pixels.at(1, 1), pixels.at(2, 0)), (30235, [0; 3], [0; 3]));
    }

    #[test]
    fn colour_is_found_in_a_layers_channels_and_in_luminance() {
        let chosen = |names: &[&str]| color_channels(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        assert_eq!(chosen(&["A", "B", "G", "R", "beauty.R"]), Some([3, 2, 1]));
        assert_eq!(chosen(&["Z", "beauty.B", "beauty.G", "beauty.R"]), Some([3, 2, 1]));
        assert_eq!(chosen(&["Y"]), Some([0; 3]));
        assert_eq!(chosen(&["R", "G", "N.X"]), None);
    }

    #[test]
    fn every_truncation_and_a_missing_channel_are_errors() {
        let bytes = exr(LayerAttributes::default(), IntegerBounds::from_dimensions((2, 1)));
        for length in 0..bytes.len() {
            assert!(exr_pixels(&bytes[..length]).is_err(), "{length} of {} bytes pass", bytes.len());
        }
    }

    #[test]
    fn developed_light_round_trips_through_the_default_response() {
        let linear = Pixels::from_u16(1, 1, vec![0, 11796, 65535]).unwrap();
        let [black, grey, white] = srgb_encoded(linear).at(0, 0);
        let light = |code: u32| Response::default().decode(f64::from(code) / 65535.0);
        assert_eq!((black, white), (0, 65535));
        assert!((light(grey) - 11796.0 / 65535.0).abs() < 8e-6, "{}", light(grey));
    }
}
