//! The weighted sum of a plan's samples, in 32-bit floats.

use super::plan::Layer;
use crate::gpu::{Gpu, PassRecorder, Shader};

crate::uniform! {
    struct StepUniform { size: [u32; 2], stride: u32, first: u32, weight: f32 }
}

crate::uniform! {
    struct StrideUniform { stride: u32 }
}

/// A running weighted sum.
#[derive(Debug)]
pub struct WeightedSum {
    stride: u32,
    /// Red and green, blue and alpha, geometry of the nearest sample.
    parts: [wgpu::Buffer; 3],
}

/// Bytes per pixel of each part.
const BYTES_PER_PX: u64 = 8;

/// Maximum area that can be summed, limited by the adapter's buffer binding size.
pub fn max_area_px(gpu: &Gpu) -> u32 {
    let limits = gpu.device.limits();
    let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    (bytes / BYTES_PER_PX).try_into().unwrap_or(u32::MAX)
}

impl WeightedSum {
    /// A zero sum for layers of this size. New buffers are zero-initialised.
    pub fn new(gpu: &Gpu, size: (u32, u32)) -> Self {
        let buffer = || {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("sum"),
                size: BYTES_PER_PX * u64::from(size.0.max(1)) * u64::from(size.1.max(1)),
                usage: wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            })
        };
        Self { stride: size.0, parts: std::array::from_fn(|_| buffer()) }
    }

    /// Adds `weight` times a layer whose corner is at this column and row of the sum.
    pub fn add(&self, recorder: &mut PassRecorder, layer: &Layer, from: (u32, u32), weight: f32) {
        let first = from.1 * self.stride + from.0;
        let step = StepUniform { size: [layer.size.0, layer.size.1], stride: self.stride, first, weight };
        let [red_green, blue_alpha, nearest] = &self.parts;
        recorder
            .pass(Shader::Accumulate, "add")
            .uniform("sample_step", &step)
            .texture("color", &layer.color)
            .texture("geometry", &layer.geometry)
            .buffer("red_green", red_green)
            .buffer("blue_alpha", blue_alpha)
            .buffer("nearest", nearest)
            .dispatch((layer.size.0.div_ceil(8), layer.size.1.div_ceil(8)));
    }

    /// Writes the sum into a layer.
    pub fn finish(&self, recorder: &mut PassRecorder, out: &Layer) {
        let [red_green, blue_alpha, nearest] = &self.parts;
        recorder
            .pass(Shader::Accumulated, "main")
            .uniform("sum", &StrideUniform { stride: self.stride })
            .buffer("red_green", red_green)
            .buffer("blue_alpha", blue_alpha)
            .buffer("nearest", nearest)
            .draw_into(&[&out.color, &out.geometry], out.size);
    }
}
