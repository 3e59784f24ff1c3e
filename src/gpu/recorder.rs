//! Records the work of a frame.

use std::sync::Arc;

use super::pipelines::Pipelines;
use super::readback::{Readback, ReadbackSet};
use super::timing::{PendingTimes, Stamps, Timer};
use super::type_map::TypeMap;
use super::uniform::{Bytes, Uniforms};
use super::{Gpu, Texture, TexturePool};
use crate::memo::Memo;

/// Memo capacity per pair of key and value types; and for values of several megabytes.
const MEMO_CAPACITY: usize = 64;
const LARGE_MEMO_CAPACITY: usize = 4;

/// Records passes, and owns resources that outlast a frame: textures, uniforms, cached values.
/// Pipelines belong to the device.
#[derive(Debug)]
pub struct PassRecorder {
    pub gpu: Gpu,
    pub pool: TexturePool,
    /// Bilinear sampler, clamped to the edge. Default of every shader's sampler.
    pub(super) linear: wgpu::Sampler,
    pub(super) pipelines: Arc<Pipelines>,
    uniforms: Uniforms,
    memos: TypeMap,
    encoder: Option<wgpu::CommandEncoder>,
    parts: Vec<wgpu::SubmissionIndex>,
    timer: Option<Timer>,
    timed: Vec<PendingTimes>,
}

impl PassRecorder {
    pub fn new(gpu: Gpu) -> Self {
        let linear = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("between texels"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let pipelines = gpu.shared(|_| Pipelines::default());
        Self {
            gpu,
            linear,
            pool: TexturePool::default(),
            pipelines,
            uniforms: Uniforms::default(),
            memos: TypeMap::default(),
            encoder: None,
            parts: Vec::new(),
            timer: None,
            timed: Vec::new(),
        }
    }

    /// The encoder, for commands other than passes.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        let gpu = &self.gpu;
        self.encoder.get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()))
    }

    /// Records a copy of the upper left `width` × `height` of a texture, into a buffer of the set.
    pub fn read_back(&mut self, set: &mut ReadbackSet, texture: &Texture, size: (u32, u32)) -> Readback {
        let gpu = self.gpu.clone();
        set.copy(&gpu, self.encoder(), texture, size)
    }

    /// Stores bytes for a `var<uniform>`, valid until the next submission.
    pub fn uniform(&mut self, bytes: &[u8]) -> Bytes {
        self.uniforms.push(&self.gpu, bytes, 16)
    }

    /// Stores bytes for a `var<storage, read>` of a fixed length.
    pub fn storage(&mut self, bytes: &[u8]) -> Bytes {
        self.uniforms.push(&self.gpu, bytes, 4)
    }

    /// Returns the memoized value of a key. Each pair of key and value types has a memo of its own.
    pub fn memoized<K, V>(&mut self, key: K, make: impl FnOnce(&Gpu, &K) -> V) -> V
    where
        K: PartialEq + Send + Sync + 'static,
        V: Clone + Send + Sync + 'static,
    {
        let gpu = &self.gpu;
        self.memos.get(|| Memo::new(MEMO_CAPACITY)).get_or_insert_with(key, |key| make(gpu, key))
    }

    /// [`PassRecorder::memoized`] for values of several megabytes, with a small capacity.
    pub fn memoized_large<K, V>(&mut self, key: K, make: impl FnOnce(&Gpu, &K) -> V) -> V
    where
        K: PartialEq + Send + Sync + 'static,
        V: Clone + Send + Sync + 'static,
    {
        let gpu = &self.gpu;
        self.memos.get(|| Memo::new(LARGE_MEMO_CAPACITY)).get_or_insert_with(key, |key| make(gpu, key))
    }

    /// Submits the recorded work to the GPU.
    pub fn submit(&mut self) -> wgpu::SubmissionIndex {
        let gpu = self.gpu.clone();
        let timed = self.timer.take().and_then(|timer| timer.end(&gpu, self.encoder()));
        self.encoder();
        self.uniforms.write(&self.gpu);
        let submission = self.gpu.queue.submit(self.encoder.take().map(wgpu::CommandEncoder::finish));
        self.timed.extend(timed.map(|timed| timed.submitted(&submission)));
        self.pool.submitted();
        submission
    }

    /// Times the recorded passes until the next submission. No effect on devices without
    /// timestamps.
    pub fn time(&mut self) {
        self.timer = self.gpu.timestamps.then(|| Timer::new(&self.gpu, ""));
    }

    /// Assigns the following passes to the part of this name.
    pub fn part(&mut self, name: &'static str) {
        if let Some(timer) = &mut self.timer {
            timer.part = name;
        }
    }

    /// Timestamps for the next pass, if it is timed.
    pub fn stamps(&mut self) -> Option<Stamps> {
        self.timer.as_mut()?.next()
    }

    /// Timings since the last call.
    pub fn timed(&mut self) -> Vec<PendingTimes> {
        std::mem::take(&mut self.timed)
    }

    /// Submits a part of a long frame: a long plan in one submission would occupy all its buffers
    /// at once.
    pub fn submit_part(&mut self) -> wgpu::SubmissionIndex {
        let timed = self.timer.as_ref().map(|timer| timer.part);
        let part = self.submit();
        self.timer = timed.map(|part| Timer::new(&self.gpu, part));
        self.parts.push(part.clone());
        part
    }

    /// The parts submitted since the last call, in order.
    pub fn parts(&mut self) -> Vec<wgpu::SubmissionIndex> {
        std::mem::take(&mut self.parts)
    }
}
