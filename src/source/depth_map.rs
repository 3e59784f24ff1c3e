//! Depth pictures: 16-bit grey PNG, TIFF and PGM, grey TIFF of floating-point numbers or integers
//! of 32 bits, OpenEXR and NumPy's `.npy` (NEP 1), distinguished by content.
//!
//! Not modelled: deep OpenEXR, arrays of several maps.

use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::Path;

use exr::compression::Compression;
use exr::meta::attribute::SampleType;
use exr::prelude::{MetaData, ReadChannels, ReadLayers};
use half::f16;

use super::still_format::{EXR_SIGNATURE, StillFormat};
use super::tiff_samples::{self, SampleKind, TiffHeader};
use super::unsupported::DEPTH_FORMATS;
use super::{SourceError, file as plain, still};
use crate::pixels::DepthMap;

pub const NPY_SIGNATURE: &[u8] = b"\x93NUMPY";

/// Number of bytes that determine the kind of a file.
const SIGNATURE_BYTES: u64 = 16;
/// Largest number of samples of all channels together, as of a decoded picture.
const MAX_SAMPLES: u64 = 1 << 27;
/// Largest file, bytes: eight for each sample, and a header.
const MAX_FILE_BYTES: u64 = 8 * MAX_SAMPLES + (1 << 20);
/// Longest header of an array, bytes. NumPy pads a short text to 64 or 128.
const MAX_NPY_HEADER_BYTES: usize = 1 << 16;

/// The contents of a depth picture's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthHeader {
    pub width: u32,
    pub height: u32,
    /// True for floating-point values, which are metres as often as millimetres.
    pub is_float: bool,
}

/// A format of depth pictures, by content.
enum DepthFormat {
    Still,
    /// A TIFF of floating-point numbers or integers of 32 bits.
    TiffNumbers(DepthHeader),
    Exr,
    Npy,
}

fn format_of(file: &Path) -> Result<DepthFormat, SourceError> {
    let failed = |source| SourceError::Read { file: file.to_owned(), source };
    let mut start = Vec::new();
    plain::open(file).map_err(failed)?.take(SIGNATURE_BYTES).read_to_end(&mut start).map_err(failed)?;
    match start {
        _ if start.starts_with(EXR_SIGNATURE) => Ok(DepthFormat::Exr),
        _ if start.starts_with(NPY_SIGNATURE) => Ok(DepthFormat::Npy),
        _ => match StillFormat::of_content(&start) {
            Some(StillFormat::Png | StillFormat::Pnm) => Ok(DepthFormat::Still),
            Some(StillFormat::Tiff) => {
                let reader = BufReader::new(plain::open(file).map_err(failed)?);
                let header = tiff_samples::header(reader).map_err(|problem| SourceError::content(file, problem))?;
                let is_number = |kind| kind != SampleKind::Palette;
                Ok(header.filter(|header| is_number(header.kind)).map_or(DepthFormat::Still, |header| {
                    let TiffHeader { width, height, kind } = header;
                    DepthFormat::TiffNumbers(DepthHeader { width, height, is_float: kind != SampleKind::Integer })
                }))
            }
            other => {
                let format = other.map(|format| format!(", but {}", format.name()));
                let problem = format!("is not a depth picture{}; expected {DEPTH_FORMATS}", format.unwrap_or_default());
                Err(SourceError::content(file, problem))
            }
        },
    }
}

/// Reads only the part of the file that contains the header.
pub fn read_header(file: &Path) -> Result<DepthHeader, SourceError> {
    let failed = |source| SourceError::Read { file: file.to_owned(), source };
    let bad = |problem: String| SourceError::content(file, problem);
    match format_of(file)? {
        DepthFormat::Still => {
            let still::PictureHeader { width, height, bits } = still::read_header(file)?;
            if bits != 16 {
                return Err(bad(format!("has {bits} bits; depth must be a 16-bit grey picture")));
            }
            Ok(DepthHeader { width, height, is_float: false })
        }
        DepthFormat::TiffNumbers(header) => Ok(header),
        DepthFormat::Exr => {
            let reader = BufReader::new(plain::open(file).map_err(failed)?);
            exr_header(reader).map_err(bad)
        }
        DepthFormat::Npy => {
            let mut start = Vec::new();
            let opened = plain::open(file).map_err(failed)?;
            opened.take(MAX_NPY_HEADER_BYTES as u64).read_to_end(&mut start).map_err(failed)?;
            npy_header(&start).map(|array| array.header).map_err(bad)
        }
    }
}

/// The depth in a file: value / `codes_per_metre`, 0 where nothing was measured.
pub fn read(file: &Path, codes_per_metre: f64, timestamp_s: f64) -> Result<DepthMap, SourceError> {
    let bytes =
        || plain::read(file, MAX_FILE_BYTES).map_err(|source| SourceError::Read { file: file.to_owned(), source });
    let decoded = match format_of(file)? {
        DepthFormat::Still => return still::read_depth(file, codes_per_metre, timestamp_s),
        DepthFormat::TiffNumbers(header) => tiff_values(header, &bytes()?),
        DepthFormat::Exr => exr_values(&bytes()?),
        DepthFormat::Npy => npy_values(&bytes()?),
    };
    let (DepthHeader { width, height, .. }, values) = decoded.map_err(|problem| SourceError::content(file, problem))?;
    let metres = |value: f64| (value / codes_per_metre) as f32;
    // Infinite, negative and invalid values are not measured.
    let measured = |z: f32| if z.is_finite() && z > 0.0 { z } else { 0.0 };
    let depth_m = values.into_iter().map(|value| measured(metres(value))).collect();
    Ok(DepthMap { width, height, depth_m, timestamp_s })
}

/// Checks that a depth picture's file is complete.
pub fn check_end(file: &Path) -> Result<(), SourceError> {
    match format_of(file)? {
        DepthFormat::Still => still::check_end(file),
        // None of these formats has an end marker.
        DepthFormat::TiffNumbers(_) | DepthFormat::Exr | DepthFormat::Npy => read(file, 1.0, 0.0).map(drop),
    }
}

fn size(width: usize, height: usize, channels: usize) -> Result<(u32, u32), String> {
    let sides = u32::try_from(width).ok().zip(u32::try_from(height).ok());
    let samples = (width as u64).saturating_mul(height as u64).saturating_mul(channels as u64);
    sides.filter(|_| (1..=MAX_SAMPLES).contains(&samples)).ok_or_else(|| {
        format!("is {width}x{height} with {channels} channels; at least one and at most {MAX_SAMPLES} numbers are read")
    })
}

fn tiff_values(header: DepthHeader, bytes: &[u8]) -> Result<(DepthHeader, Vec<f64>), String> {
    size(header.width as usize, header.height as usize, 1)?;
    let samples = tiff_samples::samples(bytes, MAX_FILE_BYTES)?;
    if samples.channel_count != 1 {
        return Err("is a picture in colour; depth must be grey".to_owned());
    }
    Ok((header, samples.values.into_iter().map(f64::from).collect()))
}

/// The depth channel: the one with that name, or the only one. Programs that only support colour
/// write the same map three times.
fn depth_channel(names: &[String]) -> Option<usize> {
    // The Z of a vector, such as a normal, has an X in its layer.
    let is_of_vector =
        |layer: &str| names.iter().any(|name| matches!(name.rsplit_once('.'), Some((of, "X" | "x")) if of == layer));
    let is_depth = |name: &String| {
        let (layer, last) = name.rsplit_once('.').unwrap_or(("", name));
        last.eq_ignore_ascii_case("depth") || last.eq_ignore_ascii_case("z") && !is_of_vector(layer)
    };
    let only = (names.len() == 1).then_some(0);
    let named = |channel: &str| names.iter().position(|name| name == channel);
    let grey = (names.len() == 3 && named("G").is_some() && named("B").is_some()).then(|| named("R")).flatten();
    names.iter().position(is_depth).or(only).or_else(|| named("Y")).or(grey)
}

/// Header of the first part, which is the one that is read.
fn exr_header(reader: impl BufRead) -> Result<DepthHeader, String> {
    let meta = MetaData::read_from_buffered(reader, false).map_err(|e| damaged(&e))?;
    let first = meta.headers.first().filter(|header| !header.deep);
    let header = first.ok_or("begins with deep pixels, which are not read; save flat ones")?;
    if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Err("is compressed by DWA, which loses precision and is not read as depth; save it with ZIP".to_owned());
    }
    let names: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
    size(header.layer_size.0, header.layer_size.1, names.len())?;
    let display = header.shared_attributes.display_window.size;
    let (width, height) = size(display.0, display.1, 1)?;
    let Some(chosen) = depth_channel(&names) else {
        let channels = names.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
        return Err(format!("has the channels {channels}; depth is the channel Z, or the only one"));
    };
    let is_float = header.channels.list[chosen].sample_type != SampleType::U32;
    Ok(DepthHeader { width, height, is_float })
}

fn damaged(error: &exr::error::Error) -> String {
    format!("the OpenEXR picture is damaged or truncated: {error}")
}

fn exr_values(bytes: &[u8]) -> Result<(DepthHeader, Vec<f64>), String> {
    let header = exr_header(Cursor::new(bytes))?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| damaged(&e))?;
    let layer = &image.layer_data;
    let channels = &layer.channel_data.list;
    let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
    let chosen = depth_channel(&names).and_then(|at| channels.get(at)).ok_or("has no channel of depth")?;
    let samples: Vec<f32> = chosen.sample_data.values_as_f32().collect();
    let is_grey = chosen.name.eq("R");
    if is_grey && channels.iter().any(|other| !other.sample_data.values_as_f32().eq(samples.iter().copied())) {
        return Err("is a picture in colour; depth is the channel Z, or the only one".to_owned());
    }
    if samples.len() != layer.size.area() {
        return Err("its depth has fewer samples than the picture has pixels".to_owned());
    }
    // The data window may be smaller than the picture.
    let (corner, origin) = (layer.attributes.layer_position, image.attributes.display_window.position);
    let (dx, dy) = (i64::from(corner.0) - i64::from(origin.0), i64::from(corner.1) - i64::from(origin.1));
    let mut values = vec![0.0; header.width as usize * header.height as usize];
    for (row, y) in samples.chunks_exact(layer.size.0).zip(dy..) {
        for (value, x) in row.iter().zip(dx..) {
            if (0..i64::from(header.width)).contains(&x) && (0..i64::from(header.height)).contains(&y) {
                values[y as usize * header.width as usize + x as usize] = f64::from(*value);
            }
        }
    }
    Ok((header, values))
}

/// The header of a NumPy array.
struct NpyHeader {
    header: DepthHeader,
    /// Type such as `f4`, without the byte order.
    kind: String,
    is_big_endian: bool,
    is_by_columns: bool,
    /// Offset of the numbers, bytes.
    data_at: usize,
}

/// Signature, version, length of the text (two bytes, four from version 2 on), and the text of a
/// Python dictionary such as `{'descr': '<f4', 'fortran_order': False, 'shape': (192, 256), }`.
fn npy_header(bytes: &[u8]) -> Result<NpyHeader, String> {
    let cut = || "the array is truncated in its header".to_owned();
    let version = *bytes.get(6).ok_or_else(cut)?;
    let (length, text_at) = match (version, bytes.get(8..12)) {
        (1, Some(b)) => (usize::from(u16::from_le_bytes([b[0], b[1]])), 10),
        (_, Some(b)) => (u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize, 12),
        (_, None) => return Err(cut()),
    };
    let data_at = text_at + length;
    let text = String::from_utf8_lossy(bytes.get(text_at..data_at).ok_or_else(cut)?);
    let value = |key: &str| {
        let after = text.split_once(&format!("'{key}'"))?.1;
        Some(after.trim_start().strip_prefix(':')?.trim_start())
    };
    let unclear = || format!("its header is unclear: {}", crate::text::quoted(text.trim()));
    let kind = value("descr").and_then(|text| text.strip_prefix('\'')?.split('\'').next()).ok_or_else(unclear)?;
    let is_by_columns = value("fortran_order").ok_or_else(unclear)?.starts_with("True");
    let sides = value("shape").and_then(|text| text.strip_prefix('(')?.split(')').next()).ok_or_else(unclear)?;
    let sides = sides.split(',').map(str::trim).filter(|side| !side.is_empty());
    let shape: Vec<usize> = sides.map(str::parse).collect::<Result<_, _>>().map_err(|_| unclear())?;
    let (height, width) = match shape[..] {
        [height, width] | [height, width, 1] | [1, height, width] => (height, width),
        _ => return Err(format!("is an array of {shape:?}; a depth map has rows and columns")),
    };
    let (width, height) = size(width, height, 1)?;
    let is_big_endian = kind.starts_with('>');
    let kind = kind.trim_start_matches(['<', '>', '|', '=']).to_owned();
    let header = DepthHeader { width, height, is_float: kind.starts_with('f') };
    Ok(NpyHeader { header, kind, is_big_endian, is_by_columns, data_at })
}

fn npy_values(bytes: &[u8]) -> Result<(DepthHeader, Vec<f64>), String> {
    let NpyHeader { header, kind, is_big_endian, is_by_columns, data_at } = npy_header(bytes)?;
    let (width, height) = (header.width as usize, header.height as usize);
    let (data, value_count) = (bytes.get(data_at..).unwrap_or_default(), width * height);
    let values: Vec<f64> = match kind.as_str() {
        "f2" => numbers(data, value_count, is_big_endian, |b| f16::from_le_bytes(b).to_f64()),
        "f4" => numbers(data, value_count, is_big_endian, |b| f64::from(f32::from_le_bytes(b))),
        "f8" => numbers(data, value_count, is_big_endian, f64::from_le_bytes),
        "u1" => numbers(data, value_count, is_big_endian, |b| f64::from(u8::from_le_bytes(b))),
        "u2" => numbers(data, value_count, is_big_endian, |b| f64::from(u16::from_le_bytes(b))),
        "i2" => numbers(data, value_count, is_big_endian, |b| f64::from(i16::from_le_bytes(b))),
        "u4" => numbers(data, value_count, is_big_endian, |b| f64::from(u32::from_le_bytes(b))),
        "i4" => numbers(data, value_count, is_big_endian, |b| f64::from(i32::from_le_bytes(b))),
        other => {
            let kind = crate::text::quoted(other);
            return Err(format!("holds numbers of the type {kind}; expected f2, f4, f8, u1, u2, u4, i2 or i4"));
        }
    };
    if values.len() < width * height {
        return Err(format!("the array is truncated: {} of {} numbers are there", values.len(), width * height));
    }
    let at = |i: usize| if is_by_columns { i % width * height + i / width } else { i };
    Ok((header, (0..width * height).map(|i| values[at(i)]).collect()))
}

/// The first `value_count` numbers, or as many as there are.
fn numbers<const N: usize>(
    bytes: &[u8],
    value_count: usize,
    is_big_endian: bool,
    number: impl Fn([u8; N]) -> f64,
) -> Vec<f64> {
    let little_endian = |mut bytes: [u8; N]| {
        if is_big_endian {
            bytes.reverse();
        }
        bytes
    };
    bytes.as_chunks::<N>().0.iter().take(value_count).map(|bytes| number(little_endian(*bytes))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
    use proptest::prelude::*;
    use std::path::PathBuf;

    #[test]
    fn depth_channel_is_not_the_z_of_a_normal() {
        let chosen = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            depth_channel(&names).map(|at| names[at].clone())
        };
        let normal = ["L.Denoising Normal.X", "L.Denoising Normal.Y", "L.Denoising Normal.Z"];
        let with_depth = [&normal[..], &["L.Depth.Z"]].concat();
        assert_eq!(chosen(&with_depth).as_deref(), Some("L.Depth.Z"));
        assert_eq!(chosen(&normal), None);
        assert_eq!(chosen(&["B", "G", "R", "Z"]).as_deref(), Some("Z"));
    }

    fn saved(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("d");
        std::fs::write(&file, bytes).unwrap();
        (folder, file)
    }

    /// A file in the format of `numpy.save`, version 1.
    fn npy(kind: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let text = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let length = u16::try_from(text.len()).unwrap().to_le_bytes();
        [NPY_SIGNATURE, &[1, 0], &length, text.as_bytes(), data].concat()
    }

    fn exr(channels: &[(&str, Vec<f32>)], size: (usize, usize)) -> Vec<u8> {
        let channel = |(name, values): &(&str, Vec<f32>)| AnyChannel::new(*name, FlatSamples::F32(values.clone()));
        let channels = AnyChannels::sort(channels.iter().map(channel).collect());
        let mut bytes = Cursor::new(Vec::new());
        Image::from_channels(size, channels).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    #[track_caller]
    fn reads(bytes: &[u8], codes_per_metre: f64, is_float: bool, expected_m: &[f32]) {
        let (_folder, file) = saved(bytes);
        assert_eq!(read_header(&file).unwrap(), DepthHeader { width: 3, height: 2, is_float });
        let map = read(&file, codes_per_metre, 4.5).unwrap();
        assert_eq!(map, DepthMap { width: 3, height: 2, depth_m: expected_m.to_vec(), timestamp_s: 4.5 });
        check_end(&file).unwrap();
    }

    #[test]
    fn arrays_of_every_layout_are_read_by_their_scale() {
        let metres = [1.0f32, 1.5, 0.0, 2.0, f32::NAN, f32::INFINITY];
        let expected = [1.0, 1.5, 0.0, 2.0, 0.0, 0.0];
        let little: Vec<u8> = metres.iter().flat_map(|z| z.to_le_bytes()).collect();
        let big: Vec<u8> = metres.iter().flat_map(|z| f64::from(*z).to_be_bytes()).collect();
        let half: Vec<u8> = metres.iter().flat_map(|z| f16::from_f32(*z).to_le_bytes()).collect();
        reads(&npy("<f4", "False", "(2, 3)", &little), 1.0, true, &expected);
        reads(&npy(">f8", "False", "(2, 3, 1)", &big), 1.0, true, &expected);
        reads(&npy("<f2", "False", "(1, 2, 3)", &half), 1.0, true, &expected);
        // Column by column.
        let columns: Vec<u8> = [0, 3, 1, 4, 2, 5].iter().flat_map(|i| metres[*i].to_le_bytes()).collect();
        reads(&npy("<f4", "True", "(2, 3)", &columns), 1.0, true, &expected);
        let whole = AnyChannel::new("Z", FlatSamples::U32(vec![1000, 1500, 0, 2000, 1, 65535]));
        let mut file = Cursor::new(Vec::new());
        Image::from_channels((3, 2), AnyChannels::sort([whole].into_iter().collect()))
            .write()
            .to_buffered(&mut file)
            .unwrap();
        reads(&file.into_inner(), 1000.0, false, &[1.0, 1.5, 0.0, 2.0, 0.001, 65.535]);
        let millimetres: Vec<u8> = [1000u16, 1500, 0, 2000, 1, 65535].iter().flat_map(|z| z.to_le_bytes()).collect();
        reads(&npy("<u2", "False", "(2, 3)", &millimetres), 1000.0, false, &[1.0, 1.5, 0.0, 2.0, 0.001, 65.535]);
    }

    #[test]
    fn openexr_depth_is_the_channel_named_so_or_the_only_one() {
        let depth = vec![1.0, 1.5, 0.0, 2.0, -1.0, f32::INFINITY];
        let expected = [1.0, 1.5, 0.0, 2.0, 0.0, 0.0];
        let other = vec![9.0; 6];
        for channels in [
            vec![("Y", depth.clone())],
            vec![("A", other.clone()), ("depth.Z", depth.clone())],
            vec![("R", depth.clone()), ("G", depth.clone()), ("B", depth.clone())],
        ] {
            reads(&exr(&channels, (3, 2)), 1.0, true, &expected);
        }
        for (channels, message) in [
            (vec![("R", depth.clone()), ("G", other.clone()), ("B", depth.clone())], "a picture in colour"),
            (vec![("N", depth.clone()), ("M", other)], "depth is the channel Z"),
        ] {
            let (_folder, file) = saved(&exr(&channels, (3, 2)));
            let error = read(&file, 1.0, 0.0).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn cut_files_and_other_arrays_are_refused() {
        let whole = npy("<f4", "False", "(2, 3)", &[0; 24]);
        let depth = exr(&[("Z", vec![1.0; 6])], (3, 2));
        for bytes in [&whole[..whole.len() - 1], &whole[..30], &whole[..7], &depth[..depth.len() - 3], &depth[..20]] {
            let (_folder, file) = saved(bytes);
            let error = check_end(&file).unwrap_err().to_string();
            assert!(error.contains("truncated"), "{error}");
        }
        for (bytes, message) in [
            (npy("|O", "False", "(2, 3)", &[0; 48]), "numbers of the type O;"),
            (npy("<f4", "False", "(6,)", &[0; 24]), "a depth map has rows and columns"),
            (npy("<f4", "False", "(99999999, 99999999)", &[]), "at most 134217728 numbers"),
            (npy("<f4", "False", "(-1, 3)", &[]), "its header is unclear"),
        ] {
            let (_folder, file) = saved(&bytes);
            let error = read(&file, 1.0, 0.0).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    proptest! {
        #[test]
        fn damaged_maps_never_panic(at in 0usize..500, value in any::<u8>()) {
            for mut bytes in [npy("<f4", "False", "(2, 3)", &[0; 24]), exr(&[("Z", vec![1.0; 6])], (3, 2))] {
                let at = at % bytes.len();
                bytes[at] = value;
                let _ = (npy_header(&bytes).map(drop), npy_values(&bytes), exr_values(&bytes));
            }
        }
    }
}
