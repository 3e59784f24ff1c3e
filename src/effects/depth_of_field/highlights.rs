//! Lights that stand out, for `layered`: their images drawn one by one.
//!
//! Gathering at a quarter of the resolution draws an image of the opening in steps of four pixels. Where the image is
//! brighter than the picture shows, its rim is seen, and the steps with it. So blocks of 4×4 px whose mean is brighter
//! than twice white and eight times brighter than the 48×48 px around, with those beside them that are not as dark as
//! all around, are taken out of the pyramid before anything is gathered. Their images are drawn over the result as they
//! are: the opening's outline around the middle of the block's light, its rim across each side as wide as that light is
//! (a square's variance is its side² / 12), the whole as bright as what was taken out. Coverage is gathered as ever:
//! what is so bright covers next to nothing.
//!
//! Where a block holds two surfaces the pyramid has the nearer one's light alone. There the farther one's is looked for
//! in the layer itself, so that a light at an edge, or half behind it, is not lost.
//!
//! Not modelled: a farther light is hidden by the nearer one of two surfaces alone, as all else is; of lights that make
//! up large areas only those that stand out are drawn so, the rest is gathered.

use super::surroundings::Lens;
use crate::gpu::{Entry, Recorder, Shader, Texture};
use crate::render::Layer;

/// From this radius on lights are drawn one by one, px; below it texels are fine enough. As in the shader.
pub const LEAST_RADIUS_PX: f32 = 2.9;
/// As in the shader: pixels to a cell's side, blocks in it, lights that are listed at most.
const CELL_PX: u32 = 16;
const BLOCKS: u64 = 16;
const MOST: u64 = 8192;
/// Of a light, and of what stands before the first one.
const BYTES: u64 = 32;
const HEAD_BYTES: u64 = 16;

/// Multiplies the light that is there; coverage stays.
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

/// Adds to the light that is there; something is covered after it.
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
struct List;

/// Where those that are found last are listed, for the shader that draws them, and how many there are.
pub fn list(recorder: &mut Recorder) -> wgpu::Buffer {
    recorder.kept(List, |gpu, _| storage(gpu, HEAD_BYTES + MOST * BYTES))
}

/// For so many cells: what is left of each block, and how many stand out.
#[derive(Clone, Copy, PartialEq)]
struct Cells(u64);

/// Finds them in a layer and its pyramid.
pub fn find(
    recorder: &mut Recorder,
    lens: &Lens,
    layer: &Layer,
    [colors, circles]: [&Texture; 2],
    found: &wgpu::Buffer,
) {
    let cells = (layer.size.0.div_ceil(CELL_PX), layer.size.1.div_ceil(CELL_PX));
    let count = u64::from(cells.0.max(1)) * u64::from(cells.1.max(1));
    // Room for more, so that a moving object's rectangle does not make new ones each frame.
    let [left, numbers] = recorder.kept(Cells(count.next_power_of_two()), |gpu, Cells(count)| {
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
            .buffer("found", found)
            .texture("color", &layer.color)
            .texture("geometry", &layer.geometry)
            .dispatch(groups);
    }
}

/// Takes them out of the first two levels of the pyramid, of these sizes.
pub fn dim(recorder: &mut Recorder, lens: &Lens, found: &wgpu::Buffer, levels: [(&Texture, (u32, u32)); 2]) {
    for (texels, (level, size)) in [2.0, 1.0].into_iter().zip(levels) {
        let entry = Entry::over("block_corner", "dim").choose("texels_to_block", texels);
        let pass = recorder.pass(Shader::DepthOfFieldHighlights, entry).uniform("lens", lens).buffer("drawn", found);
        pass.blend(TIMES).listed(found).draw_into(&[level], size);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn sizes_are_the_shaders() {
        let shader = Shader::DepthOfFieldHighlights.module();
        let value = |name| constant(&shader, name);
        assert_eq!(value("LEAST_RADIUS_PX") as f32, LEAST_RADIUS_PX);
        assert_eq!(value("BLOCK_PX") * value("CELL"), f64::from(CELL_PX));
        assert_eq!([value("BLOCKS"), value("MOST")], [BLOCKS as f64, MOST as f64]);
        assert_eq!(value("CELL") * value("CELL"), BLOCKS as f64);
    }
}
