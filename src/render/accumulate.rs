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
    color: wgpu::Buffer,
    nearest: wgpu::Buffer,
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
                size: 16 * u64::from(size.0.max(1)) * u64::from(size.1.max(1)),
                usage: wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            })
        };
        Sum { stride: size.0, color: buffer(), nearest: buffer() }
    }

    /// Adds `weight` times a layer.
    pub fn add(&self, run: &mut LayerRun<'_>, sum: &Sum, layer: &Layer, weight: f32) {
        let step: [u32; 8] = [layer.size.0, layer.size.1, sum.stride, 0, weight.to_bits(), 0, 0, 0];
        let step = constants(run.gpu, "accumulate", bytemuck::cast_slice(&step));
        let entries = [
            wgpu::BindGroupEntry { binding: 0, resource: step.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&layer.color.view) },
            wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(&layer.geometry.view) },
            wgpu::BindGroupEntry { binding: 3, resource: sum.color.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 4, resource: sum.nearest.as_entire_binding() },
        ];
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
        self.finish.run(
            run.gpu,
            run.encoder,
            &[Slot::Buffer(&uniform), Slot::Buffer(&sum.color), Slot::Buffer(&sum.nearest)],
            &[&out.color, &out.geometry],
            out.size,
        );
    }
}
