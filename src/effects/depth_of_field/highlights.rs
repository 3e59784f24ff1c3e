//! Highlights, for `layered`: bokeh sprites of bright points.
//!
//! Gathering at a quarter of the resolution draws an image of the aperture in steps of four pixels.
//! If the image is brighter than the picture's white, its rim is visible, and so are the steps.
//! Therefore highlights are removed from the pyramid before gathering: blocks of 4×4 px whose mean
//! exceeds twice white and eight times the mean of the 48×48 px around, and their neighbours unless
//! these are as dark as the surroundings. Their images are drawn over the result: the aperture's
//! outline around the centroid of the block's light, with a rim across each side as wide as that
//! light (a square's variance is its side² / 12), and with the total light that was removed.
//! Coverage is gathered as usual: highlights cover next to nothing.
//!
//! In a block with two surfaces, the pyramid has only the nearer one's light. The farther one's
//! light is then read from the layer itself, so that a highlight at an edge, or half behind it, is
//! not lost.
//!
//! Not modelled: occlusion of a farther highlight by more than the nearer of two surfaces. Of large
//! bright areas only the highlights are drawn this way; the rest is gathered.

use super::surroundings::LensUniform;
use crate::gpu::{PassRecorder, Shader, ShaderEntry, Texture};
use crate::render::Layer;

/// Radius from which on highlights are drawn as sprites, px; below it texels are fine enough. The
/// same as in the shader.
pub const MIN_RADIUS_PX: f32 = 2.9;
/// Pixels per side of a cell, blocks of a cell, and largest number of highlights; the same as in
/// the shader.
const CELL_PX: u32 = 16;
const BLOCKS: u64 = 16;
const MAX_HIGHLIGHTS: u64 = 8192;
/// Size of a highlight, and of the list's head.
const BYTES: u64 = 32;
const HEAD_BYTES: u64 = 16;

/// Multiplies the existing light; coverage stays.
const TIMES: wgpu::BlendState = wgpu::BlendState {
    color: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::Zero,
        dst_factor: wgpu::BlendFactor::Src,
        operation: wgpu::BlendOperation::Add,
    },
    alpha: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::Zero,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    },
};

/// Adds to the existing light. The pixel counts as covered afterwards.
pub const ADDED: wgpu::BlendState = wgpu::BlendState {
    color: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    },
    alpha: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Max,
    },
};

fn storage(gpu: &crate::gpu::Gpu, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("highlights"),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT,
        mapped_at_creation: false,
    })
}

#[derive(Clone, Copy, PartialEq)]
struct HighlightListKey;

/// The list of highlights with its head, the arguments of the indirect draw.
pub fn list(recorder: &mut PassRecorder) -> wgpu::Buffer {
    recorder.memoized(HighlightListKey, |gpu, _| storage(gpu, HEAD_BYTES + MAX_HIGHLIGHTS * BYTES))
}

/// Key of the buffers for a number of cells: the remaining light of each block, and the number of
/// highlights.
#[derive(Clone, Copy, PartialEq)]
struct Cells(u64);

/// Finds the highlights of a layer and its pyramid.
pub fn find(
    recorder: &mut PassRecorder,
    lens: &LensUniform,
    layer: &Layer,
    [colors, circles]: [&Texture; 2],
    highlights: &wgpu::Buffer,
) {
    let cells = (layer.size.0.div_ceil(CELL_PX), layer.size.1.div_ceil(CELL_PX));
    let count = u64::from(cells.0.max(1)) * u64::from(cells.1.max(1));
    // Rounded up, so that a moving object's rectangle does not need new buffers each frame.
    let [left, numbers] = recorder.memoized(Cells(count.next_power_of_two()), |gpu, Cells(count)| {
        [storage(gpu, 4 * BLOCKS * count), storage(gpu, 4 * count)]
    });
    for (entry, groups) in [("find", (cells.0.div_ceil(8), cells.1.div_ceil(8))), ("list", (1, 1))] {
        recorder
            .pass(Shader::DepthOfFieldHighlights, entry)
            .uniform("lens", lens)
            .texture("colors", colors)
            .texture("circles", circles)
            .buffer("left", &left)
            .buffer("numbers", &numbers)
            .buffer("highlights", highlights)
            .texture("color", &layer.color)
            .texture("geometry", &layer.geometry)
            .dispatch(groups);
    }
}

/// Removes the highlights from the first two levels of the pyramid, which have these sizes.
pub fn dim(
    recorder: &mut PassRecorder,
    lens: &LensUniform,
    highlights: &wgpu::Buffer,
    levels: [(&Texture, (u32, u32)); 2],
) {
    for (texels, (level, size)) in [2.0, 1.0].into_iter().zip(levels) {
        let entry = ShaderEntry::with_vertex("block_corner", "dim").choose("texels_to_block", texels);
        let pass =
            recorder.pass(Shader::DepthOfFieldHighlights, entry).uniform("lens", lens).buffer("drawn", highlights);
        pass.blend(TIMES).indirect(highlights).draw_into(&[level], size);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn constants_equal_the_shaders() {
        let shader = Shader::DepthOfFieldHighlights.module();
        let value = |name| constant(&shader, name);
        assert_eq!(value("MIN_RADIUS_PX") as f32, MIN_RADIUS_PX);
        assert_eq!(value("BLOCK_PX") * value("CELL"), f64::from(CELL_PX));
        assert_eq!([value("BLOCKS"), value("MAX_HIGHLIGHTS")], [BLOCKS as f64, MAX_HIGHLIGHTS as f64]);
        assert_eq!(value("CELL") * value("CELL"), BLOCKS as f64);
    }
}
