//! Single pictures of linear light: PNG for viewing, OpenEXR for further processing.

use std::io::Write;
use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::atomic::write_atomically;
use super::exr::label_attributes;
use super::{SinkError, check_file, of_exr, of_image};
use crate::camera::Response;
use crate::label::{Chunk, SourceLabel, with_chunks, xmp_chunk};
use crate::pixels::LinearImage;

/// Writes `.png` (8 bits, encoded by the response, with alpha if any pixel is transparent) or
/// `.exr` (32-bit linear premultiplied R, G, B, A). The file is either complete or absent; an
/// existing one is kept unless `force`.
pub fn write(
    path: &Path,
    image: &LinearImage,
    response: &Response,
    label: Option<&SourceLabel>,
    force: bool,
) -> Result<(), SinkError> {
    check(path, force)?;
    if extension(path) == "png" {
        write_png(path, image, response, label, force)
    } else {
        write_exr(path, image, label, force)
    }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Checks that a picture can be written: known extension, existing folder, and nothing replaced
/// without `force`.
pub fn check(path: &Path, force: bool) -> Result<(), SinkError> {
    match extension(path).as_str() {
        "png" | "exr" => check_file(path, force),
        other => {
            let extension = if other.is_empty() { "no ending".to_owned() } else { format!(".{other}") };
            let problem = format!("a picture cannot be written with {extension}; expected .png or .exr");
            Err(SinkError::Refused { path: path.to_owned(), problem })
        }
    }
}

fn write_png(
    path: &Path,
    image: &LinearImage,
    response: &Response,
    label: Option<&SourceLabel>,
    force: bool,
) -> Result<(), SinkError> {
    let code = |light: f32| (255.0 * response.encode(f64::from(light))).round() as u8;
    // Less than half a code below full alpha counts as opaque.
    let opaque = image.rgba.iter().all(|p| p[3] >= 1.0 - 0.5 / 255.0);
    let channels = if opaque { 3 } else { 4 };
    let mut bytes = Vec::with_capacity(channels * image.rgba.len());
    for &[r, g, b, a] in &image.rgba {
        let whole = if a > 0.0 { 1.0 / a } else { 0.0 };
        bytes.extend([r, g, b].map(|light| code(light * whole)));
        if !opaque {
            bytes.push((255.0 * a.clamp(0.0, 1.0)).round() as u8);
        }
    }
    let color = if opaque { ExtendedColorType::Rgb8 } else { ExtendedColorType::Rgba8 };
    let chunks: Vec<Chunk> = label.map(|label| xmp_chunk(&label.xmp())).into_iter().collect();
    write_atomically(path, force, |writer| {
        let mut png = Vec::new();
        PngEncoder::new(&mut png).write_image(&bytes, image.width, image.height, color).map_err(of_image)?;
        writer.write_all(&with_chunks(&png, &chunks))
    })
}

fn write_exr(path: &Path, image: &LinearImage, label: Option<&SourceLabel>, force: bool) -> Result<(), SinkError> {
    use exr::prelude::*;
    let (width, height) = (image.width as usize, image.height as usize);
    let channels = SpecificChannels::rgba(|at: Vec2<usize>| {
        let [r, g, b, a] = image.rgba[at.1 * width + at.0];
        (r, g, b, a)
    });
    // Blocks are compressed in parallel; without a fixed order the file's bytes would depend on
    // timing.
    let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::FAST_LOSSLESS };
    let mut out = Image::from_encoded_channels((width, height), encoding, channels);
    label_attributes(&mut out.layer_data.attributes, label);
    write_atomically(path, force, |writer| out.write().to_buffered(writer).map_err(of_exr))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exr_and_png_read_back_as_linear_light() {
        let folder = tempfile::tempdir().unwrap();
        // Linear 0.18 is code 117.6. Half covered, it is the same colour at half the alpha.
        let rgba = vec![[0.18, 1.0, 0.0, 1.0], [0.09, 0.5, 0.0, 0.5], [0.0; 4]];
        let mut picture = LinearImage { width: 3, height: 1, rgba };
        let [png, exr] = ["a.png", "a.exr"].map(|name| folder.path().join(name));
        write(&png, &picture, &Response::default(), None, false).unwrap();
        let read = image::open(&png).unwrap().to_rgba8();
        assert_eq!(read.into_raw(), [118, 255, 0, 255, 118, 255, 0, 128, 0, 0, 0, 0]);
        write(&exr, &picture, &Response::default(), None, false).unwrap();
        let read = exr::prelude::read_first_flat_layer_from_file(&exr).unwrap();
        let values: Vec<Vec<f32>> =
            read.layer_data.channel_data.list.iter().map(|c| c.sample_data.values_as_f32().collect()).collect();
        assert_eq!(
            values,
            [vec![1.0, 0.5, 0.0], vec![0.0; 3], vec![1.0, 0.5, 0.0], vec![0.18, 0.09, 0.0]],
            "A, B, G, R"
        );

        assert!(write(&png, &picture, &Response::default(), None, false).unwrap_err().to_string().contains("--force"));
        picture.rgba.iter_mut().for_each(|p| p[3] = 1.0);
        write(&png, &picture, &Response::default(), None, true).unwrap();
        assert_eq!(image::open(&png).unwrap().color(), image::ColorType::Rgb8, "no alpha where nothing is transparent");
        let refused = write(Path::new("a.gif"), &picture, &Response::default(), None, true).unwrap_err().to_string();
        assert_eq!(refused, "a.gif: a picture cannot be written with .gif; expected .png or .exr");
    }

    #[test]
    fn written_picture_is_deterministic() {
        let folder = tempfile::tempdir().unwrap();
        let rgba = (0..600 * 400).map(|i| [(i % 91) as f32, (i / 600) as f32, 0.5, 1.0]).collect();
        let picture = LinearImage { width: 600, height: 400, rgba };
        let written = |name: String| {
            let path = folder.path().join(name);
            write(&path, &picture, &Response::default(), None, false).unwrap();
            std::fs::read(path).unwrap()
        };
        let first = written("first.exr".to_owned());
        assert!((0..10).all(|n| written(format!("{n}.exr")) == first));
    }
}
