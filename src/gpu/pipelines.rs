//! Shader modules and pipelines of a device, each compiled on first use.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::interface::{Global, Interface, layouts};
use super::{Gpu, Shader, shader};
use crate::memo::Memo;

/// A module's entry points, and the values of its `override`s. Each combination is a separate
/// pipeline: a method, a feature. Varying numbers are uniforms.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ShaderEntry {
    pub vertex: &'static str,
    pub fragment: &'static str,
    /// Names, with the bits of their values.
    choices: Vec<(&'static str, u64)>,
}

impl From<&'static str> for ShaderEntry {
    /// A fragment entry over the whole target.
    fn from(fragment: &'static str) -> Self {
        Self { vertex: "fullscreen_vertex", fragment, choices: Vec::new() }
    }
}

impl ShaderEntry {
    /// A fragment entry over quads placed by a vertex entry.
    pub fn with_vertex(vertex: &'static str, fragment: &'static str) -> Self {
        Self { vertex, fragment, choices: Vec::new() }
    }

    /// Sets one of the shader's `override`s, a number or a bool.
    pub fn choose(mut self, name: &'static str, value: impl Into<f64>) -> Self {
        self.choices.push((name, value.into().to_bits()));
        self
    }

    fn constants(&self) -> Vec<(&'static str, f64)> {
        self.choices.iter().map(|(name, bits)| (*name, f64::from_bits(*bits))).collect()
    }
}

/// A compiled module, and its interface.
#[derive(Debug)]
pub struct Module {
    pub label: &'static str,
    pub interface: Interface,
    module: wgpu::ShaderModule,
}

/// A pipeline, with the layouts of its bind groups.
#[derive(Debug)]
pub struct CompiledPipeline<P> {
    pub pipeline: P,
    pub groups: Vec<Option<wgpu::BindGroupLayout>>,
    pub globals: BTreeMap<String, Global>,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct RenderPipelineKey {
    module: Vec<Shader>,
    entry: ShaderEntry,
    formats: Vec<wgpu::TextureFormat>,
    blend: Option<wgpu::BlendState>,
}

/// Compiled modules and pipelines of a device, all of which stay.
#[derive(Debug)]
pub struct Pipelines {
    modules: Memo<Vec<Shader>, Arc<Module>>,
    drawn: Memo<RenderPipelineKey, Arc<CompiledPipeline<wgpu::RenderPipeline>>>,
    computed: Memo<(Vec<Shader>, ShaderEntry), Arc<CompiledPipeline<wgpu::ComputePipeline>>>,
}

impl Default for Pipelines {
    fn default() -> Self {
        Self { modules: Memo::unbounded(), drawn: Memo::unbounded(), computed: Memo::unbounded() }
    }
}

impl Pipelines {
    /// The module of some files, named after the first. `tail` is appended when the module is
    /// compiled, and must depend only on the files.
    pub fn module(&self, gpu: &Gpu, shaders: &[Shader], tail: impl FnOnce() -> String) -> Arc<Module> {
        self.modules.get_or_insert_with(shaders.to_vec(), |shaders| {
            let text = shader::module(shaders) + &tail();
            let label = shaders.first().map_or("", |shader| shader.name());
            let interface = Interface::new(label, &text);
            let source = wgpu::ShaderSource::Wgsl(text.into());
            let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source });
            Arc::new(Module { label, interface, module })
        })
    }

    pub fn drawn(
        &self,
        gpu: &Gpu,
        shaders: &[Shader],
        module: &Module,
        entry: &ShaderEntry,
        formats: &[wgpu::TextureFormat],
        blend: Option<wgpu::BlendState>,
    ) -> Arc<CompiledPipeline<wgpu::RenderPipeline>> {
        let key =
            RenderPipelineKey { module: shaders.to_vec(), entry: entry.clone(), formats: formats.to_vec(), blend };
        self.drawn.get_or_insert_with(key, |_| {
            let globals = module.interface.globals(&[entry.vertex, entry.fragment]);
            let (groups, layout) = layouts(&gpu.device, module.label, &globals);
            let constants = entry.constants();
            let compilation_options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
            let targets: Vec<_> =
                formats.iter().map(|&format| Some(wgpu::ColorTargetState { blend, ..format.into() })).collect();
            let pipeline = gpu.render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(&format!("{} {}", module.label, entry.fragment)),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &module.module,
                    entry_point: Some(entry.vertex),
                    compilation_options: compilation_options.clone(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState {
                    topology: wgpu::PrimitiveTopology::TriangleStrip,
                    ..Default::default()
                },
                depth_stencil: None,
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module.module,
                    entry_point: Some(entry.fragment),
                    compilation_options,
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            });
            Arc::new(CompiledPipeline { pipeline, groups, globals })
        })
    }

    pub fn computed(
        &self,
        gpu: &Gpu,
        shaders: &[Shader],
        module: &Module,
        entry: &ShaderEntry,
    ) -> Arc<CompiledPipeline<wgpu::ComputePipeline>> {
        self.computed.get_or_insert_with((shaders.to_vec(), entry.clone()), |_| {
            let globals = module.interface.globals(&[entry.fragment]);
            let (groups, layout) = layouts(&gpu.device, module.label, &globals);
            let pipeline = gpu.compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(&format!("{} {}", module.label, entry.fragment)),
                layout: Some(&layout),
                module: &module.module,
                entry_point: Some(entry.fragment),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &entry.constants(),
                    ..Default::default()
                },
                cache: None,
            });
            Arc::new(CompiledPipeline { pipeline, groups, globals })
        })
    }
}
