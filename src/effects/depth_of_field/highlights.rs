//! Lights that stand out, for `layered`: their images drawn one by one.
//!
//! Gathering at a quarter of the resolution draws an image of the opening in steps of four pixels. Where the image is brighter
//! than the picture shows, its rim is seen, and the steps with it. So blocks of 4×4 px whose mean is brighter than twice white
//! and eight times brighter than the 48×48 px around, with those beside them that are not as dark as all around, are taken out
//! of the pyramid before anything is gathered. Their images are drawn over the result as they are: the opening's outline around
//! the middle of the block's light, its rim across each side as wide as that light is (a square's variance is its side² / 12),
//! the whole as bright as what was taken out. Coverage is gathered as ever: what is so bright covers next to nothing.
//!
//! Where a block holds two surfaces the pyramid has the nearer one's light alone. There the farther one's is looked for in the
//! layer itself, so that a light at an edge, or half behind it, is not lost.
//!
//! Not modelled: a farther light is hidden by the nearer one of two surfaces alone, as all else is; of lights that make up large
//! areas only those that stand out are drawn so, the rest is gathered.

use crate::gpu::{FullscreenPass, Gpu, Options, Slot, assemble, run_listed};
use crate::render::{COLOR, Layer, LayerRun};

/// From this radius on lights are drawn one by one, px; below it texels are fine enough. As in the shader.
pub const LEAST_RADIUS_PX: f32 = 2.9;
/// As in the shader: pixels to a cell's side, blocks in it, lights that are listed at most.
const CELL_PX: u32 = 16;
const BLOCKS: u64 = 16;
const MOST: u64 = 8192;
/// Of a light, and of what stands before the first one.
const BYTES: u64 = 32;
const HEAD_BYTES: u64 = 16;

#[derive(Debug)]
pub struct Highlights {
    find: wgpu::ComputePipeline,
    list: wgpu::ComputePipeline,
    /// In the pyramid's first level and in its second.
    dim: [FullscreenPass; 2],
    /// For so many cells: what is left of each block, and how many stand out.
    cells: Option<(u64, [wgpu::Buffer; 2])>,
    found: wgpu::Buffer,
}

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

impl Highlights {
    pub fn new(gpu: &Gpu) -> Self {
        let text = assemble("depth_of_field_highlights");
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("highlights"),
            source: wgpu::ShaderSource::Wgsl(text.as_str().into()),
        });
        let compute = |entry| {
            gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("highlights"),
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let dim = |texels: f64| {
            let constants = [("texels_to_block", texels)];
            let options = Options {
                vertex: "block_corner",
                fragment: "dim",
                constants: &constants,
                blend: Some(TIMES),
                ..Options::default()
            };
            FullscreenPass::with(gpu, "without highlights", &text, &[COLOR], &options)
        };
        Self {
            find: compute("find"),
            list: compute("list"),
            dim: [dim(2.0), dim(1.0)],
            cells: None,
            found: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("highlights"),
                size: HEAD_BYTES + MOST * BYTES,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT,
                mapped_at_creation: false,
            }),
        }
    }

    /// Those that were found last, for the shader that draws them, and how many there are.
    pub fn found(&self) -> &wgpu::Buffer {
        &self.found
    }

    /// Finds them in a layer and its pyramid.
    pub fn find(
        &mut self,
        run: &mut LayerRun<'_>,
        lens: &wgpu::Buffer,
        layer: &Layer,
        pyramid: [&wgpu::TextureView; 2],
    ) {
        let (gpu, size) = (run.gpu, layer.size);
        let cells = (size.0.div_ceil(CELL_PX), size.1.div_ceil(CELL_PX));
        let count = u64::from(cells.0.max(1)) * u64::from(cells.1.max(1));
        let buffer = |label, size| {
            let usage = wgpu::BufferUsages::STORAGE;
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let (_, [left, numbers]) = match self.cells.take().filter(|(room, _)| *room >= count) {
            Some(cells) => self.cells.insert(cells),
            None => {
                let buffers = [buffer("left of blocks", 4 * BLOCKS * count), buffer("highlights of cells", 4 * count)];
                self.cells.insert((count, buffers))
            }
        };
        let [colors, circles] = pyramid.map(wgpu::BindingResource::TextureView);
        let buffers = [left.as_entire_binding(), numbers.as_entire_binding(), self.found.as_entire_binding()];
        let layer = [&layer.color.view, &layer.geometry.view].map(wgpu::BindingResource::TextureView);
        let resources: Vec<_> =
            (0..).zip([lens.as_entire_binding(), colors, circles].into_iter().chain(buffers).chain(layer)).collect();
        for (pipeline, bindings, groups) in [
            (&self.find, &[0, 1, 2, 3, 4, 6, 7][..], (cells.0.div_ceil(8), cells.1.div_ceil(8))),
            (&self.list, &[0, 1, 2, 3, 4, 5, 6, 7], (1, 1)),
        ] {
            let read = resources.iter().filter(|(binding, _)| bindings.contains(binding));
            let entries: Vec<_> = read
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
                .collect();
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("highlights"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            let mut pass = run.encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(groups.0, groups.1, 1);
        }
    }

    /// Takes them out of the first two levels of the pyramid, of these sizes.
    pub fn dim(&self, run: &mut LayerRun<'_>, lens: &wgpu::Buffer, levels: [(&crate::gpu::Texture, (u32, u32)); 2]) {
        let slots = [Slot::Buffer(lens), Slot::Buffer(&self.found)];
        for (pass, (level, size)) in self.dim.iter().zip(levels) {
            run_listed(run.gpu, run.encoder, pass, &slots, &[level], size, &self.found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn sizes_are_the_shaders() {
        let shader = assemble("depth_of_field_highlights");
        let value = |name| constant(&shader, name);
        assert_eq!(value("LEAST_RADIUS_PX") as f32, LEAST_RADIUS_PX);
        assert_eq!(value("BLOCK_PX") * value("CELL"), f64::from(CELL_PX));
        assert_eq!([value("BLOCKS"), value("MOST")], [BLOCKS as f64, MOST as f64]);
        assert_eq!(value("CELL") * value("CELL"), BLOCKS as f64);
    }
}
