//! What the work of a frame is recorded with.

use super::kept::{FEW, Kept, MANY};
use super::pass::Pass;
use super::pipelines::{Entry, Pipelines};
use super::uniform::{Bytes, Uniforms};
use super::{Gpu, Shader, TexturePool};

/// Records passes, and has what they need for longer than a frame: pipelines, textures, uniforms, what was worked out
/// from values.
#[derive(Debug)]
pub struct Recorder {
    pub gpu: Gpu,
    pub pool: TexturePool,
    /// Reads between texels, and at the edge takes the last one: what every shader's sampler is, unless it is given another.
    pub(super) linear: wgpu::Sampler,
    pub(super) pipelines: Pipelines,
    uniforms: Uniforms,
    kept: Kept,
    encoder: Option<wgpu::CommandEncoder>,
    parts: Vec<wgpu::SubmissionIndex>,
}

impl Recorder {
    pub fn new(gpu: Gpu) -> Self {
        let linear = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("between texels"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Self {
            gpu,
            linear,
            pool: TexturePool::default(),
            pipelines: Pipelines::default(),
            uniforms: Uniforms::default(),
            kept: Kept::default(),
            encoder: None,
            parts: Vec::new(),
        }
    }

    /// Where to record what is no pass of ours.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        let gpu = &self.gpu;
        self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()))
    }

    /// A pass over targets with a shader.
    pub fn pass(&mut self, shader: Shader, entry: impl Into<Entry>) -> Pass<'_> {
        self.pass_of(&[shader], String::new, entry)
    }

    /// A pass with a module of several files; `tail` is added to their texts where the module is made, and must follow
    /// from them.
    pub fn pass_of(&mut self, shaders: &[Shader], tail: impl FnOnce() -> String, entry: impl Into<Entry>) -> Pass<'_> {
        let module = self.pipelines.module(&self.gpu, shaders, tail);
        Pass::new(self, shaders, module, entry.into())
    }

    /// Bytes for a `var<uniform>` of what is recorded until the next submission.
    pub fn uniform(&mut self, bytes: &[u8]) -> Bytes {
        self.uniforms.push(&self.gpu, bytes, 16)
    }

    /// The same for a `var<storage, read>`, which knows how long it is.
    pub fn storage(&mut self, bytes: &[u8]) -> Bytes {
        self.uniforms.push(&self.gpu, bytes, 4)
    }

    /// What was made of a key; made where it is not known. The type of the key tells what it is.
    pub fn kept<K, V>(&mut self, key: K, make: impl FnOnce(&Gpu, &K) -> V) -> V
    where
        K: PartialEq + Send + Sync + 'static,
        V: Clone + Send + Sync + 'static,
    {
        let gpu = &self.gpu;
        self.kept.get(MANY, key, |key| make(gpu, key))
    }

    /// The same for what takes megabytes: of those no more than a few are kept.
    pub fn kept_few<K, V>(&mut self, key: K, make: impl FnOnce(&Gpu, &K) -> V) -> V
    where
        K: PartialEq + Send + Sync + 'static,
        V: Clone + Send + Sync + 'static,
    {
        let gpu = &self.gpu;
        self.kept.get(FEW, key, |key| make(gpu, key))
    }

    /// Hands what was recorded to the GPU.
    pub fn submit(&mut self) -> wgpu::SubmissionIndex {
        self.encoder();
        self.uniforms.write(&self.gpu);
        let submission = self.gpu.queue.submit(self.encoder.take().map(wgpu::CommandEncoder::finish));
        self.pool.submitted();
        submission
    }

    /// Hands over a part of something long: a long plan in one submission would hold all its buffers at once.
    pub fn submit_part(&mut self) {
        let part = self.submit();
        self.parts.push(part);
    }

    /// The parts that were handed over since this was last asked, in order.
    pub fn parts(&mut self) -> Vec<wgpu::SubmissionIndex> {
        std::mem::take(&mut self.parts)
    }
}
