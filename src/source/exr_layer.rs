//! Channels of an OpenEXR layer as floats, with the layer's place in the display window.

use std::io::Cursor;

use exr::prelude::{ReadChannels, ReadLayers};

/// The channels of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrLayer<const N: usize> {
    /// Size of the display window, px.
    pub display_px: [usize; 2],
    /// Upper left corner of the layer in the display window, px.
    pub corner_px: [i32; 2],
    pub width: usize,
    pub height: usize,
    /// Row by row from the upper left.
    pub channels: [Vec<f32>; N],
}

/// The message for a file that cannot be decoded.
pub fn damaged(error: &exr::error::Error) -> String {
    format!("the OpenEXR picture is damaged or truncated: {error}")
}

/// Reads the first flat layer in which `select` finds its channels among their names; `None`
/// without one. Sizes must have been checked: the decoder allocates those that the file states.
pub fn read<const N: usize>(
    bytes: &[u8],
    select: impl Fn(&[String]) -> Option<[usize; N]>,
) -> Result<Option<ExrLayer<N>>, String> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| damaged(&error))?;
    let selected = image.layer_data.iter().find_map(|layer| {
        let channels = &layer.channel_data.list;
        let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
        Some((layer, select(&names)?.map(|at| &channels[at].sample_data)))
    });
    let Some((layer, samples)) = selected else { return Ok(None) };
    let channels: [Vec<f32>; N] = samples.map(|samples| samples.values_as_f32().collect());
    if channels.iter().any(|channel| channel.len() != layer.size.area()) {
        return Err("has channels of several resolutions, which are not read; save them at one".to_owned());
    }
    let (corner, display) = (layer.attributes.layer_position, image.attributes.display_window);
    Ok(Some(ExrLayer {
        display_px: [display.size.0, display.size.1],
        corner_px: [corner.0.saturating_sub(display.position.0), corner.1.saturating_sub(display.position.1)],
        width: layer.size.0,
        height: layer.size.1,
        channels,
    }))
}
