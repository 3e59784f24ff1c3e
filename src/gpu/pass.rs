//! One pass over every pixel of some targets, over quads in them, or over a grid of workgroups.

use std::sync::Arc;

use super::pipelines::{CompiledPipeline, Module, ShaderEntry};
use super::timing::Stamps;
use super::uniform::{Bytes, Uniform, UniformBytes};
use super::{Gpu, PassRecorder, Shader, Texture};

/// A resource bound to one of a shader's globals.
#[derive(Clone, Debug)]
enum Binding {
    Texture(wgpu::TextureView),
    Buffer(Bytes),
}

impl Binding {
    fn resource(&self) -> wgpu::BindingResource<'_> {
        match self {
            Self::Texture(view) => wgpu::BindingResource::TextureView(view),
            Self::Buffer(bytes) => bytes.binding(),
        }
    }
}

/// A uniform's layout: name, size, and name and offset of each member.
type UniformLayout = (&'static str, usize, &'static [(&'static str, usize)]);

/// The vertices to draw.
#[derive(Clone, Debug)]
enum DrawShape {
    Whole,
    Tiles(u32),
    Indirect(wgpu::Buffer),
}

/// Builder of a pass: its inputs are bound by the names in the shader's text, then it is drawn
/// once.
///
/// Names that the entry does not read may be bound, so that entries of a module can share their
/// inputs.
///
/// # Panics
/// On programming errors: an unknown name, a missing binding, a wrong layout.
#[derive(Debug)]
#[must_use = "a pass is recorded by draw, draw_into or dispatch"]
pub struct Pass<'a> {
    recorder: &'a mut PassRecorder,
    shaders: Vec<Shader>,
    module: Arc<Module>,
    entries: Vec<ShaderEntry>,
    bound: Vec<(&'static str, Binding)>,
    layouts: Vec<UniformLayout>,
    blend: Option<wgpu::BlendState>,
    shape: DrawShape,
    load: wgpu::LoadOp<wgpu::Color>,
}

impl PassRecorder {
    /// Begins a pass with a shader.
    pub fn pass(&mut self, shader: Shader, entry: impl Into<ShaderEntry>) -> Pass<'_> {
        self.pass_of(&[shader], String::new, entry)
    }

    /// Begins a pass with a module of several files. `tail` is appended to their texts when the
    /// module is compiled, and must depend only on the files.
    pub fn pass_of(
        &mut self,
        shaders: &[Shader],
        tail: impl FnOnce() -> String,
        entry: impl Into<ShaderEntry>,
    ) -> Pass<'_> {
        let module = self.pipelines.module(&self.gpu, shaders, tail);
        Pass::new(self, shaders, module, entry.into())
    }
}

impl<'a> Pass<'a> {
    fn new(recorder: &'a mut PassRecorder, shaders: &[Shader], module: Arc<Module>, entry: ShaderEntry) -> Self {
        Self {
            recorder,
            shaders: shaders.to_vec(),
            module,
            entries: vec![entry],
            bound: Vec::new(),
            layouts: Vec::new(),
            blend: None,
            shape: DrawShape::Whole,
            load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
        }
    }

    /// Adds another entry over the same targets, drawn after those before.
    pub fn also(mut self, entry: impl Into<ShaderEntry>) -> Self {
        self.entries.push(entry.into());
        self
    }

    fn bind(mut self, name: &'static str, bound: Binding) -> Self {
        assert!(self.module.interface.has_global(name), "{} has no global that is called {name}", self.module.label);
        self.bound.push((name, bound));
        self
    }

    pub fn texture(self, name: &'static str, texture: &Texture) -> Self {
        self.bind(name, Binding::Texture(texture.view.clone()))
    }

    pub fn uniform<U: Uniform>(self, name: &'static str, value: &U) -> Self {
        self.packed(name, &UniformBytes::new(value))
    }

    /// Binds a uniform from an effect.
    pub fn packed(mut self, name: &'static str, value: &UniformBytes) -> Self {
        let bytes = self.recorder.uniform(&value.bytes);
        self.layouts.push((name, value.bytes.len(), value.members));
        self.bind(name, Binding::Buffer(bytes))
    }

    /// Binds a `var<storage, read>`: for values that bound loops (see
    /// [`constants`](super::constants)).
    pub fn storage<U: Uniform>(mut self, name: &'static str, value: &U) -> Self {
        let bytes = self.recorder.storage(bytemuck::bytes_of(value));
        self.layouts.push((name, size_of::<U>(), U::MEMBERS));
        self.bind(name, Binding::Buffer(bytes))
    }

    /// Binds a uniform shared by several passes, or a persistent buffer.
    pub fn buffer(self, name: &'static str, bytes: impl Into<Bytes>) -> Self {
        self.bind(name, Binding::Buffer(bytes.into()))
    }

    /// Sets the blend state. Without it, the pass overwrites the target.
    pub fn blend(mut self, blend: wgpu::BlendState) -> Self {
        self.blend = Some(blend);
        self
    }

    /// Draws one quad (a strip of four vertices) for each of `count` tiles.
    pub fn tiles(mut self, count: u32) -> Self {
        self.shape = DrawShape::Tiles(count);
        self
    }

    /// Draws over the targets' existing contents.
    pub fn load_targets(mut self) -> Self {
        self.load = wgpu::LoadOp::Load;
        self
    }

    /// Draws quads over the targets' existing contents. Their number is in a buffer written by the
    /// GPU (indirect draw): four vertices, the number of quads, two zeros.
    pub fn indirect(mut self, list: &wgpu::Buffer) -> Self {
        self.shape = DrawShape::Indirect(list.clone());
        self.load_targets()
    }

    /// Draws into the upper left `size` of pooled textures, which are transparent beyond it.
    pub fn draw<const N: usize>(self, formats: [wgpu::TextureFormat; N], size: (u32, u32)) -> [Texture; N] {
        let targets = formats.map(|format| self.recorder.pool.lend(&self.recorder.gpu, size, format));
        self.draw_into(&targets.each_ref(), size);
        targets
    }

    /// Draws into the upper left `size` of targets.
    pub fn draw_into(self, targets: &[&Texture], size: (u32, u32)) {
        let targets: Vec<_> = targets.iter().map(|t| (&t.view, t.format)).collect();
        self.draw_views(&targets, size);
    }

    /// Draws into any views.
    pub fn draw_views(self, targets: &[(&wgpu::TextureView, wgpu::TextureFormat)], (width, height): (u32, u32)) {
        let formats: Vec<_> = targets.iter().map(|(_, format)| *format).collect();
        let gpu = self.recorder.gpu.clone();
        let mut ready = Vec::new();
        for entry in &self.entries {
            let pipelines = &self.recorder.pipelines;
            let made = pipelines.drawn(&gpu, &self.shaders, &self.module, entry, &formats, self.blend);
            let groups = self.groups(&gpu, &made);
            ready.push((made, groups));
        }
        let load = self.load;
        let attachments: Vec<_> = targets
            .iter()
            .map(|(view, _)| {
                Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
                })
            })
            .collect();
        let stamps = self.recorder.stamps();
        let mut pass = self.recorder.encoder().begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(self.module.label),
            color_attachments: &attachments,
            depth_stencil_attachment: None,
            timestamp_writes: stamps.as_ref().map(Stamps::drawn),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        for (made, groups) in &ready {
            pass.set_pipeline(&made.pipeline);
            for (number, group) in (0..).zip(groups) {
                pass.set_bind_group(number, group.as_ref(), &[]);
            }
            match &self.shape {
                DrawShape::Whole => pass.draw(0..3, 0..1),
                DrawShape::Tiles(count) => pass.draw(0..4, 0..*count),
                DrawShape::Indirect(list) => pass.draw_indirect(list, 0),
            }
        }
    }

    /// Runs the entries, which are `@compute`, over a grid of workgroups.
    pub fn dispatch(self, (columns, rows): (u32, u32)) {
        let gpu = self.recorder.gpu.clone();
        for entry in &self.entries {
            let made = self.recorder.pipelines.computed(&gpu, &self.shaders, &self.module, entry);
            let groups = self.groups(&gpu, &made);
            let stamps = self.recorder.stamps();
            let mut pass = self.recorder.encoder().begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(self.module.label),
                timestamp_writes: stamps.as_ref().map(Stamps::computed),
            });
            pass.set_pipeline(&made.pipeline);
            for (number, group) in (0..).zip(&groups) {
                pass.set_bind_group(number, group.as_ref(), &[]);
            }
            pass.dispatch_workgroups(columns, rows, 1);
        }
    }

    fn groups<P>(&self, gpu: &Gpu, made: &CompiledPipeline<P>) -> Vec<Option<wgpu::BindGroup>> {
        let label = self.module.label;
        let linear = wgpu::BindingResource::Sampler(&self.recorder.linear);
        let resource = |name: &str, kind: &wgpu::BindingType| {
            let resource = self.bound.iter().find(|(n, _)| *n == name).map(|(_, bound)| bound.resource());
            let sampler = || matches!(kind, wgpu::BindingType::Sampler(_)).then(|| linear.clone());
            resource.or_else(sampler).unwrap_or_else(|| panic!("{label} reads {name}, and nothing was given for it"))
        };
        if cfg!(development) {
            self.check_layouts(made);
        }
        let group = |(number, layout): (u32, &Option<wgpu::BindGroupLayout>)| {
            let layout = layout.as_ref()?;
            let own = made.globals.values().filter(|g| g.group == number);
            let entries: Vec<_> = own
                .map(|g| wgpu::BindGroupEntry { binding: g.binding, resource: resource(&g.name, &g.kind) })
                .collect();
            Some(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(label),
                layout,
                entries: &entries,
            }))
        };
        (0..).zip(&made.groups).map(group).collect()
    }

    /// Checks that uniform layouts match the shader.
    fn check_layouts<P>(&self, made: &CompiledPipeline<P>) {
        for (name, size, members) in &self.layouts {
            if let Some(global) = made.globals.get(*name) {
                global.check_layout(*size, members);
            }
        }
    }
}
