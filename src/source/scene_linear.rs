//! Frames of linear light: OpenEXR (DWA by another program, developed.rs) and pictures of
//! floating-point numbers. They are encoded by the sRGB curve (IEC 61966-2-1) with 16 bits, which a
//! default profile decodes again: the code is exact to 8·10⁻⁶ of full scale.
//!
//! Light above 1 clips, as white does in a camera. Not modelled: the attribute `chromaticities`
//! (Rec. 709 is assumed), deep pictures, layers beside the first with colour.

use std::io::{self, BufRead, Cursor, Seek, SeekFrom};

use exr::compression::Compression;
use exr::meta::BlockDescription;
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

/// Names of the channels of colour, in lower case: OpenEXR's own, and those of Nuke's layers.
const COLOR_NAMES: [[&str; 3]; 2] = [["r", "g", "b"], ["red", "green", "blue"]];
/// Names of layers that hold the whole picture, in lower case. Other layers with colour are its
/// parts, such as albedo.
const PICTURE_LAYERS: [&str; 6] = ["beauty", "combined", "rgba", "rgb", "color", "colour"];

/// The layer with the picture's colour.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColorLayer {
    /// Name before the channels' last dot; may be empty.
    name: String,
    /// The channels of R, G and B, three times one of luminance.
    channels: [usize; 3],
}

/// The layer with the picture's colour by the names of all channels: without a name, else one that
/// is named as the whole picture, else the first. A layer with R, G and B takes precedence over
/// luminance alone.
fn color_layer(names: &[String]) -> Option<ColorLayer> {
    let split = |name: &str| {
        let (layer, channel) = name.rsplit_once('.').unwrap_or(("", name));
        (layer.to_owned(), channel.to_ascii_lowercase())
    };
    let split_names: Vec<(String, String)> = names.iter().map(|name| split(name)).collect();
    let position =
        |layer: &str, channel: &str| split_names.iter().position(|(of, name)| of == layer && name == channel);
    let rank = |layer: &str| {
        let last = split(layer).1;
        if layer.is_empty() { 0 } else { 1 + u8::from(!PICTURE_LAYERS.contains(&last.as_str())) }
    };
    let mut layers: Vec<&String> = split_names.iter().map(|(layer, _)| layer).collect();
    layers.sort_by_key(|layer| rank(layer));
    let rgb = |layer: &str| {
        COLOR_NAMES.iter().find_map(|[r, g, b]| Some([position(layer, r)?, position(layer, g)?, position(layer, b)?]))
    };
    // Not the Y of a vector.
    let luminance = |layer: &str| position(layer, "y").filter(|_| position(layer, "x").is_none()).map(|y| [y; 3]);
    let first = |channels: &dyn Fn(&str) -> Option<[usize; 3]>| {
        layers.iter().find_map(|layer| Some(ColorLayer { name: (*layer).clone(), channels: channels(layer)? }))
    };
    first(&rgb).or_else(|| first(&luminance))
}

/// The flat part of a file with the picture's colour, by its index, and the layer in it.
fn color_part(meta: &MetaData) -> Result<(usize, ColorLayer), String> {
    let names = |header: &Header| -> Vec<String> {
        header.channels.list.iter().map(|channel| channel.name.to_string()).collect()
    };
    let parts = || meta.headers.iter().enumerate().filter(|(_, header)| !header.deep);
    let Some((part, names, layer)) =
        parts().find_map(|(part, header)| Some((part, names(header), color_layer(&names(header))?)))
    else {
        let names: Vec<String> = meta.headers.iter().flat_map(names).take(8).collect();
        return Err(format!("has no flat layer with the channels R, G and B, or Y (found: {})", names.join(", ")));
    };
    let is_chroma = |name: &String| matches!(name.rsplit('.').next(), Some("RY" | "BY"));
    if layer.channels[0] == layer.channels[1] && names.iter().any(is_chroma) {
        return Err("has luminance and chroma (Y, RY, BY), which are not read; save it as R, G and B".to_owned());
    }
    Ok((part, layer))
}

/// The part with the picture's colour in a file with DWA. `ffmpeg` decodes that compression for
/// channels R, G and B without a layer's name only, and returns a damaged picture of others. It
/// returns black for missing chunks, so that a file that ends too early is refused here.
pub fn dwa_part(mut reader: impl BufRead + Seek) -> Result<usize, String> {
    let meta = MetaData::read_from_buffered(&mut reader, false).map_err(|e| damaged(&e))?;
    match ends_after_last_chunk(&mut reader, &meta) {
        Ok(true) => {}
        Ok(false) | Err(_) => return Err("ends too early; copy it again, or leave it out".to_owned()),
    }
    let (part, layer) = color_part(&meta)?;
    if layer.name.is_empty() && layer.channels[0] != layer.channels[1] {
        Ok(part)
    } else {
        Err("is compressed by DWA, which is read with the channels R, G and B only; save it with ZIP".to_owned())
    }
}

/// Whether a file holds all chunks that its tables list. `reader` is behind the headers. Source:
/// OpenEXR, *file layout*: each part's table has the places of its chunks; a chunk is its part's
/// number (of several), coordinates (one number of a block of rows, four of a tile), a length and
/// data.
fn ends_after_last_chunk(reader: &mut (impl BufRead + Seek), meta: &MetaData) -> io::Result<bool> {
    let mut chunks = Vec::new();
    for header in &meta.headers {
        let coordinates = if header.blocks == BlockDescription::ScanLines { 1 } else { 4 };
        let part = usize::from(meta.headers.len() > 1);
        for _ in 0..header.chunk_count {
            let mut place = [0; 8];
            reader.read_exact(&mut place)?;
            chunks.push((u64::from_le_bytes(place), 4 * (coordinates + part) as u64));
        }
    }
    let end = reader.seek(SeekFrom::End(0))?;
    for (place, before_length) in chunks {
        let mut length = [0; 4];
        reader.seek(SeekFrom::Start(place.saturating_add(before_length)))?;
        reader.read_exact(&mut length)?;
        let data = place.saturating_add(before_length + 4);
        if place == 0 || data.saturating_add(u32::from_le_bytes(length).into()) > end {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Header of an OpenEXR frame.
pub fn exr_header(reader: impl BufRead) -> Result<PictureHeader, String> {
    let meta = MetaData::read_from_buffered(reader, false).map_err(|e| damaged(&e))?;
    let header = &meta.headers[color_part(&meta)?.0];
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
    let layer = exr_layer::read(bytes, |names| color_layer(names).map(|layer| layer.channels))?
        .ok_or("has no channels of colour")?;
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
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
        SpecificChannels, Vec2, WritableImage,
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
    fn colour_is_found_in_layers_and_in_luminance() {
        let chosen = |names: &[&str]| color_layer(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        for (names, layer, channels) in [
            (&["A", "B", "G", "R", "beauty.R"][..], "", [3, 2, 1]),
            (&["Z", "beauty.B", "beauty.G", "beauty.R"], "beauty", [3, 2, 1]),
            // The first layer by name is a part of the picture.
            (&["V.AO.B", "V.AO.G", "V.AO.R", "V.Combined.B", "V.Combined.G", "V.Combined.R"], "V.Combined", [5, 4, 3]),
            (&["diffuse.blue", "diffuse.green", "diffuse.red", "spec.blue"], "diffuse", [2, 1, 0]),
            (&["Y"], "", [0; 3]),
            (&["A", "beauty.Y"], "beauty", [1; 3]),
            (&["Y", "albedo.B", "albedo.G", "albedo.R"], "albedo", [3, 2, 1]),
        ] {
            assert_eq!(chosen(names), Some(ColorLayer { name: layer.to_owned(), channels }), "{names:?}");
        }
        for names in [&["R", "G", "N.X"][..], &["N.X", "N.Y", "N.Z"]] {
            assert_eq!(chosen(names), None, "{names:?}");
        }
    }

    fn named_channels(names: &[&str]) -> Vec<u8> {
        let channels = names.iter().map(|name| AnyChannel::new(*name, FlatSamples::F32(vec![0.18]))).collect();
        let mut out = Cursor::new(Vec::new());
        Image::from_channels((1, 1), AnyChannels::sort(channels)).write().to_buffered(&mut out).unwrap();
        out.into_inner()
    }

    #[test]
    fn layered_and_luminance_files_are_decoded_and_chroma_is_refused() {
        for names in [&["beauty.R", "beauty.G", "beauty.B"][..], &["Y"], &["beauty.Y", "Z"]] {
            assert_eq!(exr_pixels(&named_channels(names)).unwrap().at(0, 0), [30235; 3], "{names:?}");
        }
        let refused = exr_pixels(&named_channels(&["Y", "RY", "BY"])).unwrap_err();
        assert!(refused.contains("luminance and chroma"), "{refused}");
        assert_eq!(dwa_part(Cursor::new(named_channels(&["R", "G", "B"]))), Ok(0));
        for names in [&["beauty.R", "beauty.G", "beauty.B"][..], &["Y"]] {
            assert!(dwa_part(Cursor::new(named_channels(names))).unwrap_err().contains("DWA"), "{names:?}");
        }
    }

    #[test]
    fn every_truncation_and_a_missing_channel_are_errors() {
        let bytes = exr(LayerAttributes::default(), IntegerBounds::from_dimensions((2, 1)));
        for length in 0..bytes.len() {
            assert!(exr_pixels(&bytes[..length]).is_err(), "{length} of {} bytes pass", bytes.len());
        }
        let colored = named_channels(&["R", "G", "B"]);
        for length in 0..colored.len() {
            assert!(dwa_part(Cursor::new(&colored[..length])).is_err(), "{length} of {} bytes pass", colored.len());
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
