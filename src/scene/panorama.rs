//! Environment panoramas: Radiance HDR (Ward 1991, *Real pixels*; Radiance's *File formats*) and
//! OpenEXR.
//!
//! Not modelled: primaries other than sRGB's (`PRIMARIES`, `chromaticities`), non-square pixels
//! (`PIXASPECT`).

use std::fmt;
use std::io::{Cursor, Read};
use std::path::Path;

use exr::meta::attribute::EnvironmentMap;
use exr::prelude::{MetaData, ReadChannels, ReadLayers, ReadSpecificChannel, Vec2};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;

use super::picture::MAX_SIDE_PX;
use super::{SceneError, bytes};

/// 8192 by 4096.
const MAX_PIXELS: u64 = 1 << 25;
/// Maximum size of a Radiance header, bytes. Renderers write a few lines.
const MAX_HEADER_BYTES: usize = 1 << 16;
const OPENEXR_SIGNATURE: &[u8] = b"\x76\x2f\x31\x01";
/// The largest half-precision number replaces infinite light.
const MAX_HALF: f32 = 65504.0;

/// Linear light row by row from the top left.
pub(super) struct PanoramaPixels {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<[f32; 3]>,
}

/// Error of a panorama.
pub(super) struct PanoramaError {
    actual: String,
    accepted: String,
}

impl PanoramaError {
    fn new(actual: impl Into<String>, accepted: impl Into<String>) -> Self {
        Self { actual: actual.into(), accepted: accepted.into() }
    }
}

impl fmt::Display for PanoramaError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; expected {}", self.actual, self.accepted)
    }
}

/// Reads a panorama; all values are finite and non-negative. The text is a warning about replaced
/// values.
pub(super) fn read(file: &Path, named_in: &Path) -> Result<(PanoramaPixels, Option<String>), SceneError> {
    let bytes = bytes::read(file, Some(named_in))?;
    let decode = if bytes.starts_with(OPENEXR_SIGNATURE) { openexr_of } else { radiance_of };
    let mut light = decode(&bytes)
        .map_err(|PanoramaError { actual, accepted }| SceneError::bad(file, "the panorama", actual, accepted))?;
    let warning = make_finite(&mut light);
    Ok((light, warning))
}

fn check_size(width: usize, height: usize) -> Result<(u32, u32), PanoramaError> {
    let side = |length: usize| u32::try_from(length).ok().filter(|length| (1..=MAX_SIDE_PX).contains(length));
    match (side(width), side(height)) {
        (Some(width), Some(height)) if u64::from(width) * u64::from(height) <= MAX_PIXELS => Ok((width, height)),
        _ => {
            let accepted = format!("1 to {MAX_PIXELS} pixels, up to {MAX_SIDE_PX} a side");
            Err(PanoramaError::new(format!("{width}×{height} pixels"), accepted))
        }
    }
}

fn make_finite(light: &mut PanoramaPixels) -> Option<String> {
    let mut changed = 0;
    for value in light.rgb.as_flattened_mut().iter_mut().filter(|v| !(v.is_finite() && **v >= 0.0)) {
        *value = if *value == f32::INFINITY { MAX_HALF } else { 0.0 };
        changed += 1;
    }
    let location = "negative, infinite or not a number";
    (changed > 0)
        .then(|| format!("{changed} of its values are {location}: 0 is used, and {MAX_HALF} for infinite ones"))
}

/// Decodes a Radiance HDR picture, in W/(sr·m²) if its header contains the exposure.
pub(super) fn radiance_of(bytes: &[u8]) -> Result<PanoramaPixels, PanoramaError> {
    if !bytes.starts_with(b"#?") {
        let actual = "a file that does not begin with #?, nor as OpenEXR does";
        return Err(PanoramaError::new(actual, "a Radiance .hdr file or an OpenEXR .exr file"));
    }
    let (exposure, pixels) = radiance_header(bytes)?;
    let failed = |e: image::ImageError| {
        PanoramaError::new(
            format!("bytes that do not decode ({e})"),
            "a whole Radiance .hdr file, its rows from the top",
        )
    };
    // The decoder accepts one of the usual signatures, and ignores the header's factors.
    let decoder = HdrDecoder::new((&b"#?RADIANCE\n\n"[..]).chain(pixels)).map_err(failed)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = check_size(width as usize, height as usize)?;
    let mut rgb = vec![[0.0f32; 3]; width as usize * height as usize];
    decoder.read_image(bytemuck::cast_slice_mut(&mut rgb)).map_err(failed)?;
    if exposure != [1.0; 3] {
        for pixel in &mut rgb {
            *pixel = std::array::from_fn(|i| (f64::from(pixel[i]) / exposure[i]) as f32);
        }
    }
    Ok(PanoramaPixels { width, height, rgb })
}

/// Combined factors of the header, and the bytes from the resolution on. All `EXPOSURE` and
/// `COLORCORR` lines apply; indented lines belong to source pictures.
fn radiance_header(bytes: &[u8]) -> Result<([f64; 3], &[u8]), PanoramaError> {
    let head = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let mut factors = [1.0; 3];
    let mut at = 0;
    while let Some(length) = head[at..].iter().position(|&byte| byte == b'\n') {
        let line = String::from_utf8_lossy(head[at..at + length].trim_ascii_end());
        at += length + 1;
        if line.is_empty() {
            return Ok((factors, &bytes[at..]));
        }
        let bad = |accepted: &str| PanoramaError::new(format!("the header line {line:?}"), accepted);
        match line.split_once('=') {
            Some(("FORMAT", format)) if format.trim() == "32-bit_rle_xyze" => {
                return Err(bad("FORMAT=32-bit_rle_rgbe; Radiance's `ra_xyze -r FROM TO` converts it"));
            }
            Some(("FORMAT", format)) if format.trim() != "32-bit_rle_rgbe" => {
                return Err(bad("FORMAT=32-bit_rle_rgbe"));
            }
            Some(("EXPOSURE", value)) => {
                let [factor] = positive(value).ok_or_else(|| bad("EXPOSURE= and a number above 0"))?;
                factors = factors.map(|f| f * factor);
            }
            Some(("COLORCORR", value)) => {
                let by: [f64; 3] = positive(value).ok_or_else(|| bad("COLORCORR= and three numbers above 0"))?;
                factors = std::array::from_fn(|i| factors[i] * by[i]);
            }
            _ => {}
        }
    }
    let actual = format!("no empty line in the first {} bytes", head.len());
    Err(PanoramaError::new(actual, "a header, which ends with one"))
}

/// `N` positive numbers.
fn positive<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers = text.split_whitespace().map(|word| word.parse().ok().filter(|v: &f64| *v > 0.0 && v.is_finite()));
    numbers.collect::<Option<Vec<_>>>()?.try_into().ok()
}

/// Decodes the first part of an OpenEXR picture that has R, G and B. Transparent pixels are dark,
/// as alpha is premultiplied.
fn openexr_of(bytes: &[u8]) -> Result<PanoramaPixels, PanoramaError> {
    let failed =
        |e: exr::error::Error| PanoramaError::new(format!("bytes that do not decode ({e})"), "a whole .exr file");
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(failed)?;
    let names = |header: &exr::meta::header::Header| -> Vec<String> {
        header.channels.list.iter().map(|channel| channel.name.to_string()).collect()
    };
    let is_rgb = |names: &[String]| ["R", "G", "B"].iter().all(|name| names.iter().any(|n| n == name));
    let Some(header) = meta.headers.iter().find(|header| !header.deep && is_rgb(&names(header))) else {
        let channels: Vec<String> = meta.headers.iter().flat_map(names).take(8).collect();
        let accepted = "R, G and B; save it as plain OpenEXR, not MultiLayer";
        return Err(PanoramaError::new(format!("the channels {}", channels.join(", ")), accepted));
    };
    if header.own_attributes.environment_map == Some(EnvironmentMap::Cube) {
        return Err(PanoramaError::new("a cube of six views", "a panorama by longitude and latitude (envmap latlong)"));
    }
    check_size(header.layer_size.0, header.layer_size.1)?;
    let display = header.shared_attributes.display_window;
    let (width, height) = check_size(display.size.0, display.size.1)?;
    // The data window may be smaller than the display window.
    let (corner, origin) = (header.own_attributes.layer_position, display.position);
    let index_in_window = |at: usize, corner: i32, origin: i32, side: u32| {
        let at = at as i64 + i64::from(corner) - i64::from(origin);
        (0..i64::from(side)).contains(&at).then_some(at as usize)
    };
    let place = move |at: Vec2<usize>| {
        let row = index_in_window(at.1, corner.1, origin.1, height)?;
        Some(row * width as usize + index_in_window(at.0, corner.0, origin.0, width)?)
    };
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("R")
        .required("G")
        .required("B")
        .collect_pixels(
            move |_, _| vec![[0.0f32; 3]; width as usize * height as usize],
            move |rgb, at, (r, g, b): (f32, f32, f32)| {
                if let Some(pixel) = place(at) {
                    rgb[pixel] = [r, g, b];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(failed)?;
    Ok(PanoramaPixels { width, height, rgb: image.layer_data.channel_data.pixels })
}
