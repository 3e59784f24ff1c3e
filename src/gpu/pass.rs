//! One pass over every pixel of some targets.

use super::{Gpu, Texture};

/// What stands at a binding: numbered in the order given, group 0.
#[derive(Clone, Copy, Debug)]
pub enum Slot<'a> {
    Texture(&'a wgpu::TextureView),
    Buffer(&'a wgpu::Buffer),
    Sampler(&'a wgpu::Sampler),
}

/// What a module holds, where it is not one fragment entry `main` with `shared/fullscreen`.
#[derive(Clone, Copy, Debug)]
pub struct Options<'a> {
    pub vertex: &'a str,
    pub fragment: &'a str,
    /// Values of the module's `override`s.
    pub constants: &'a [(&'a str, f64)],
    /// What stands at each binding, where passes of which not all read everything share their slots; else empty, and
    /// the bindings are those that the shader reads.
    pub bindings: &'a [Binding],
    /// How what is drawn goes with what is there; none replaces it.
    pub blend: Option<wgpu::BlendState>,
}

/// What a shader of group 0 finds at a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binding {
    Uniform,
    /// Of floats, which a sampler may read between texels.
    Floats,
    /// Of whole numbers.
    Integers,
    Sampler,
    /// A storage buffer that is read.
    Storage,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self { vertex: "fullscreen_vertex", fragment: "main", constants: &[], bindings: &[], blend: None }
    }
}

/// A pipeline that draws over all of its targets, or over tiles of them.
#[derive(Debug)]
pub struct FullscreenPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    label: String,
}

impl FullscreenPass {
    pub fn new(gpu: &Gpu, label: &str, wgsl: &str, formats: &[wgpu::TextureFormat]) -> Self {
        Self::with(gpu, label, wgsl, formats, &Options::default())
    }

    pub fn with(gpu: &Gpu, label: &str, wgsl: &str, formats: &[wgpu::TextureFormat], options: &Options<'_>) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        });
        let compilation_options =
            wgpu::PipelineCompilationOptions { constants: options.constants, ..Default::default() };
        let given = (!options.bindings.is_empty()).then(|| group_layout(gpu, label, options.bindings));
        let given = given.as_ref().map(|group| {
            gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &[Some(group)],
                immediate_size: 0,
            })
        });
        let targets: Vec<_> = formats
            .iter()
            .map(|&format| Some(wgpu::ColorTargetState { blend: options.blend, ..format.into() }))
            .collect();
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            layout: given.as_ref(),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(options.vertex),
                compilation_options: compilation_options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState { topology: wgpu::PrimitiveTopology::TriangleStrip, ..Default::default() },
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(options.fragment),
                compilation_options,
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
        size: (u32, u32),
    ) {
        draw(gpu, encoder, &[self], slots, targets, size, Corners::Counted(3, 1));
    }
}

fn group_layout(gpu: &Gpu, label: &str, bindings: &[Binding]) -> wgpu::BindGroupLayout {
    let texture = |sample_type| wgpu::BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let entries: Vec<_> = bindings
        .iter()
        .enumerate()
        .map(|(i, binding)| wgpu::BindGroupLayoutEntry {
            binding: i as u32,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: match binding {
                Binding::Uniform => wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                Binding::Floats => texture(wgpu::TextureSampleType::Float { filterable: true }),
                Binding::Integers => texture(wgpu::TextureSampleType::Uint),
                Binding::Sampler => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                Binding::Storage => wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: true },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
            },
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

/// Draws one quad (a strip of four corners) for each of `tiles` with each of some pipelines
/// that read the same slots.
pub fn run_tiles(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    passes: &[&FullscreenPass],
    slots: &[Slot<'_>],
    targets: &[&Texture],
    size: (u32, u32),
    tiles: u32,
) {
    draw(gpu, encoder, passes, slots, targets, size, Corners::Counted(4, tiles));
}

/// Draws over what the targets hold as many quads as a buffer says that the GPU wrote: four corners, their number, two zeros.
pub fn run_listed(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    pass: &FullscreenPass,
    slots: &[Slot<'_>],
    targets: &[&Texture],
    size: (u32, u32),
    list: &wgpu::Buffer,
) {
    draw(gpu, encoder, &[pass], slots, targets, size, Corners::Listed(list));
}

enum Corners<'a> {
    /// Of a strip, and how many of them.
    Counted(u32, u32),
    Listed(&'a wgpu::Buffer),
}

fn draw(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    passes: &[&FullscreenPass],
    slots: &[Slot<'_>],
    targets: &[&Texture],
    (width, height): (u32, u32),
    corners: Corners<'_>,
) {
    let label = passes.first().map(|p| p.label.as_str());
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
    let load = match corners {
        Corners::Counted(..) => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
        Corners::Listed(_) => wgpu::LoadOp::Load,
    };
    let attachments: Vec<_> = targets
        .iter()
        .map(|target| {
            Some(wgpu::RenderPassColorAttachment {
                view: &target.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })
        })
        .collect();
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label,
        color_attachments: &attachments,
        depth_stencil_attachment: None,
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    });
    pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
    pass.set_scissor_rect(0, 0, width, height);
    for one in passes {
        // Layouts that are derived from shaders fit their own pipeline only.
        let bind_group =
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout: &one.layout, entries: &entries });
        pass.set_pipeline(&one.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        match corners {
            Corners::Counted(vertices, instances) => pass.draw(0..vertices, 0..instances),
            Corners::Listed(list) => pass.draw_indirect(list, 0),
        }
    }
}
