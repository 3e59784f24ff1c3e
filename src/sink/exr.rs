//! The virtual layer of a frame, and ST maps, as OpenEXR, for compositors.

use std::path::Path;

use exr::prelude::*;
use half::f16;

use super::atomic::write_atomically;
use super::{SinkError, of_exr};
use crate::label::{PROGRAM, SourceLabel};
use crate::pixels::LayerImage;

/// Writes one layer with the channels virtual.R, .G, .B, .A, shadow.R, .G, .B and noise.R, .G, .B
/// (half), depth.Z, velocity.X, .Y (float), ZIP-compressed. The shadow is a factor on the real
/// light; noise is added last. The file is either complete or absent. An existing one is kept
/// unless `force`.
pub fn write_layers(
    path: &Path,
    layers: &LayerImage,
    label: Option<&SourceLabel>,
    force: bool,
) -> std::result::Result<(), SinkError> {
    let (width, height) = (layers.width as usize, layers.height as usize);
    let lengths =
        [layers.rgba.len(), layers.depth_m.len(), layers.velocity.len(), layers.left.len(), layers.noise.len()];
    if lengths != [width * height; 5] || width * height == 0 {
        let problem = format!("layers of {lengths:?} values do not make a picture of {width}x{height}");
        return Err(SinkError::Refused { path: path.to_owned(), problem });
    }
    let color = |name: &'static str, i: usize| {
        let samples = layers.rgba.iter().map(|pixel| f16::from_f32(pixel[i])).collect();
        AnyChannel::new(name, FlatSamples::F16(samples))
    };
    let by_color = |name: &'static str, values: &[[f32; 3]], i: usize| {
        let samples = values.iter().map(|value| f16::from_f32(value[i])).collect();
        AnyChannel::new(name, FlatSamples::F16(samples))
    };
    let velocity = |name: &'static str, i: usize| {
        AnyChannel::new(name, FlatSamples::F32(layers.velocity.iter().map(|pixel| pixel[i]).collect()))
    };
    let channels = [
        color("virtual.R", 0),
        color("virtual.G", 1),
        color("virtual.B", 2),
        color("virtual.A", 3),
        AnyChannel::new("depth.Z", FlatSamples::F32(layers.depth_m.clone())),
        by_color("shadow.R", &layers.left, 0),
        by_color("shadow.G", &layers.left, 1),
        by_color("shadow.B", &layers.left, 2),
        by_color("noise.R", &layers.noise, 0),
        by_color("noise.G", &layers.noise, 1),
        by_color("noise.B", &layers.noise, 2),
        velocity("velocity.X", 0),
        velocity("velocity.Y", 1),
    ];
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let mut attributes = LayerAttributes::default();
    label_attributes(&mut attributes, label);
    let image = Image::from_layer(Layer::new((width, height), attributes, encoding, channels));
    write_atomically(path, force, |writer| image.write().to_buffered(writer).map_err(of_exr))
}

/// Adds a label: the attribute `xmp`, and the program's name.
pub fn label_attributes(attributes: &mut LayerAttributes, label: Option<&SourceLabel>) {
    let Some(label) = label else { return };
    attributes.software_name = Some(PROGRAM.into());
    // The format's text has no byte order mark, and without one a packet is UTF-8.
    let packet = Text::new_or_none(label.xmp().replace('\u{feff}', ""));
    attributes.other.extend(packet.map(|packet| ("xmp".into(), AttributeValue::Text(packet))));
}

/// A map of places in another picture: S to the right and T upwards, 0 to 1 across it.
#[derive(Clone, Debug, PartialEq)]
pub struct StMap {
    pub width: u32,
    pub height: u32,
    /// Row by row from the upper left.
    pub st: Vec<[f32; 2]>,
}

/// Writes S as R and T as G, 32-bit float, with a B of zeros, ZIP-compressed. The file is either
/// complete or absent. An existing one is kept unless `force`.
pub fn write_st_map(path: &Path, map: &StMap, force: bool) -> std::result::Result<(), SinkError> {
    let (width, height) = (map.width as usize, map.height as usize);
    if map.st.len() != width * height || map.st.is_empty() {
        let problem = format!("an ST map of {} values does not make a picture of {width}x{height}", map.st.len());
        return Err(SinkError::Refused { path: path.to_owned(), problem });
    }
    let channel = |name: &'static str, value: &dyn Fn(&[f32; 2]) -> f32| {
        AnyChannel::new(name, FlatSamples::F32(map.st.iter().map(value).collect()))
    };
    let channels = [channel("R", &|st| st[0]), channel("G", &|st| st[1]), channel("B", &|_| 0.0)];
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let image = Image::from_layer(Layer::new((width, height), LayerAttributes::default(), encoding, channels));
    write_atomically(path, force, |writer| image.write().to_buffered(writer).map_err(of_exr))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_read_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frame_000002.exr");
        let count = 5 * 40;
        let layers = LayerImage {
            width: 5,
            height: 40,
            rgba: (0..count).map(|i| [i as f32 * 0.25, 0.5, -1.0, 1.0]).collect(),
            depth_m: (0..count).map(|i| 1.0 + i as f32 * 1e-5).collect(),
            velocity: (0..count).map(|i| [i as f32 * 1.1, -3.3e5]).collect(),
            light_alone: false,
            left: (0..count).map(|i| [0.5, 1.0, i as f32 / 256.0]).collect(),
            noise: (0..count).map(|i| [-0.25, 0.0, i as f32 / 512.0]).collect(),
        };
        let label = SourceLabel::composite(Path::new("wide")).of_frame(2);
        write_layers(&path, &layers, Some(&label), false).unwrap();
        let image = read_first_flat_layer_from_file(&path).unwrap();
        assert_eq!((image.layer_data.size.0, image.layer_data.size.1), (5, 40));
        assert_eq!(image.layer_data.encoding.compression, Compression::ZIP16);
        let AttributeValue::Text(xmp) = &image.layer_data.attributes.other[&Text::from("xmp")] else {
            panic!("no text")
        };
        assert!(xmp.to_string().contains("compositeSynthetic") && xmp.to_string().contains("frame=\"2\""), "{xmp}");
        let channels = &image.layer_data.channel_data.list;
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        let of_virtual = ["virtual.A", "virtual.B", "virtual.G", "virtual.R"];
        let noise = ["noise.B", "noise.G", "noise.R"];
        let before = ["shadow.B", "shadow.G", "shadow.R", "velocity.X", "velocity.Y"];
        assert_eq!(names, [&["depth.Z"], noise.as_slice(), &before, &of_virtual].concat());
        let values = |name: &str| -> Vec<f32> {
            channels.iter().find(|c| c.name.eq(name)).unwrap().sample_data.values_as_f32().collect()
        };
        for (i, name) in ["virtual.R", "virtual.G", "virtual.B", "virtual.A"].iter().enumerate() {
            assert_eq!(values(name), layers.rgba.iter().map(|p| p[i]).collect::<Vec<_>>(), "{name}");
        }
        for (i, name) in ["shadow.R", "shadow.G", "shadow.B"].iter().enumerate() {
            assert_eq!(values(name), layers.left.iter().map(|p| p[i]).collect::<Vec<_>>(), "{name}");
        }
        for (i, name) in ["noise.R", "noise.G", "noise.B"].iter().enumerate() {
            assert_eq!(values(name), layers.noise.iter().map(|p| p[i]).collect::<Vec<_>>(), "{name}");
        }
        assert!(matches!(channels[6].sample_data, FlatSamples::F16(_)));
        assert!(matches!(channels[0].sample_data, FlatSamples::F32(_)));
        assert_eq!(values("depth.Z"), layers.depth_m);
        assert_eq!(values("velocity.X"), layers.velocity.iter().map(|v| v[0]).collect::<Vec<_>>());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn st_map_reads_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("undistort.exr");
        let st = (0..6).map(|i| [i as f32 / 7.0, -1.0 - i as f32]).collect();
        let map = StMap { width: 3, height: 2, st };
        write_st_map(&path, &map, false).unwrap();
        let image = read_first_flat_layer_from_file(&path).unwrap();
        let channels = &image.layer_data.channel_data.list;
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["B", "G", "R"]);
        let values = |i: usize| -> Vec<f32> { channels[i].sample_data.values_as_f32().collect() };
        assert_eq!(values(1), map.st.iter().map(|st| st[1]).collect::<Vec<_>>());
        assert_eq!(values(2), map.st.iter().map(|st| st[0]).collect::<Vec<_>>());
        assert!(matches!(channels[2].sample_data, FlatSamples::F32(_)));
        let error = write_st_map(&path, &StMap { width: 4, ..map }, true).unwrap_err().to_string();
        assert!(error.ends_with("an ST map of 6 values does not make a picture of 4x2"), "{error}");
    }

    #[test]
    fn layers_of_wrong_length_are_refused() {
        let error = write_layers(Path::new("a.exr"), &LayerImage { width: 3, ..LayerImage::empty(2, 2) }, None, false)
            .unwrap_err();
        assert_eq!(error.to_string(), "a.exr: layers of [4, 4, 4, 4, 4] values do not make a picture of 3x2");
    }
}
