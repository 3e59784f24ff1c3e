//! The weighted sum of a plan's samples, in 32-bit floats.

use super::pipeline::{COLOR, GEOMETRY};
use super::plan::{Layer, LayerRun};
use crate::gpu::{FullscreenPass, Gpu, Slot, assemble, constants};

#[derive(Debug)]
pub struct Accumulate {
    add: wgpu::ComputePipeline,
    finish: FullscreenPass,
}

/// A sum on its way.
#[derive(Debug)]
pub struct Sum {
    stride: u32,
    /// Red and green, blue and alpha, the nearest's geometry.
    parts: [wgpu::Buffer; 3],
}

/// Of each part, bytes a pixel.
const BYTES_PER_PX: u64 = 8;

/// No more pixels are summed: an adapter binds no more of a buffer.
pub fn largest_area_px(gpu: &Gpu) -> u32 {
    let limits = gpu.device.limits();
    let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    (bytes / BYTES_PER_PX).try_into().unwrap_or(u32::MAX)
}

impl Accumulate {
    pub fn new(gpu: &Gpu) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("accumulate"),
            source: wgpu::ShaderSource::Wgsl(assemble("accumulate").into()),
        });
        Self {
            add: gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("accumulate"),
                layout: None,
                module: &module,
                entry_point: Some("add"),
                compilation_options: Default::default(),
                cache: None,
            }),
            finish: FullscreenPass::new(gpu, "accumulated", &assemble("accumulated"), &[COLOR, GEOMETRY]),
        }
    }

    /// An empty sum of layers of this size. New buffers are zero.
    pub fn begin(&self, gpu: &Gpu, size: (u32, u32)) -> Sum {
        let buffer = || {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("sum"),
                size: BYTES_PER_PX * u64::from(size.0.max(1)) * u64::from(size.1.max(1)),
                usage: wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            })
        };
        Sum { stride: size.0, parts: std::array::from_fn(|_| buffer()) }
    }

    /// Adds `weight` times a layer, which begins at a column and row of the sum.
    pub fn add(&self, run: &mut LayerRun<'_>, sum: &Sum, layer: &Layer, from: (u32, u32), weight: f32) {
        let first = from.1 * sum.stride + from.0;
        let step: [u32; 8] = [layer.size.0, layer.size.1, sum.stride, first, weight.to_bits(), 0, 0, 0];
        let step = constants(run.gpu, "accumulate", bytemuck::cast_slice(&step));
        let resources = [
            step.as_entire_binding(),
            wgpu::BindingResource::TextureView(&layer.color.view),
            wgpu::BindingResource::TextureView(&layer.geometry.view),
        ];
        let parts = sum.parts.iter().map(wgpu::Buffer::as_entire_binding);
        let entries: Vec<_> = (0..)
            .zip(resources.into_iter().chain(parts))
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let group = run.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("accumulate"),
            layout: &self.add.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut pass = run.encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.add);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(layer.size.0.div_ceil(8), layer.size.1.div_ceil(8), 1);
    }

    /// The finished sum into a layer.
    pub fn finish(&self, run: &mut LayerRun<'_>, sum: &Sum, out: &Layer) {
        let uniform = constants(run.gpu, "accumulated", bytemuck::cast_slice(&[sum.stride, 0, 0, 0]));
        let [red_green, blue_alpha, nearest] = sum.parts.each_ref().map(Slot::Buffer);
        self.finish.run(
            run.gpu,
            run.encoder,
            &[Slot::Buffer(&uniform), red_green, blue_alpha, nearest],
            &[&out.color, &out.geometry],
            out.size,
        );
    }
}
