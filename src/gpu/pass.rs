//! One pass over every pixel of some targets.

use super::{Gpu, Texture};

/// What stands at a binding: numbered in the order given, group 0.
#[derive(Clone, Copy, Debug)]
pub enum Slot<'a> {
    Texture(&'a wgpu::TextureView),
    Buffer(&'a wgpu::Buffer),
    Sampler(&'a wgpu::Sampler),
}

/// A pipeline that draws one triangle over the targets. The module must define the fragment
/// entry `main` and import `shared/fullscreen`.
#[derive(Debug)]
pub struct FullscreenPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    label: String,
}

impl FullscreenPass {
    pub fn new(gpu: &Gpu, label: &str, wgsl: &str, formats: &[wgpu::TextureFormat]) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        });
        let targets: Vec<_> = formats.iter().map(|&f| Some(wgpu::ColorTargetState::from(f))).collect();
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("fullscreen_vertex"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("main"),
                compilation_options: Default::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        });
        let layout = pipeline.get_bind_group_layout(0);
        Self { pipeline, layout, label: label.to_owned() }
    }

    /// Draws into the upper left `width` × `height` of the targets.
    pub fn run(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        slots: &[Slot<'_>],
        targets: &[&Texture],
        (width, height): (u32, u32),
    ) {
        let entries: Vec<_> = slots
            .iter()
            .enumerate()
            .map(|(i, slot)| wgpu::BindGroupEntry {
                binding: i as u32,
                resource: match slot {
                    Slot::Texture(view) => wgpu::BindingResource::TextureView(view),
                    Slot::Buffer(buffer) => buffer.as_entire_binding(),
                    Slot::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
                },
            })
            .collect();
        let bind_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&self.label),
            layout: &self.layout,
            entries: &entries,
        });
        let attachments: Vec<_> = targets
            .iter()
            .map(|target| {
                Some(wgpu::RenderPassColorAttachment {
                    view: &target.view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        // Every pixel that is read later is written here, so nothing is cleared;
                        // clearing is only the cheapest way of not loading.
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })
            })
            .collect();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(&self.label),
            color_attachments: &attachments,
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.draw(0..3, 0..1);
    }
}
