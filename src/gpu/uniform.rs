//! Values for `var<uniform>`: declared once in Rust, and compared with the shader's struct when
//! bound.

use super::Gpu;

/// A struct of plain values as a shader sees it. Declared by [`uniform!`](crate::uniform!).
pub trait Uniform: bytemuck::Pod {
    /// Name and offset of each member, in order.
    const MEMBERS: &'static [(&'static str, usize)];
}

/// Declares a uniform. Its members have the names of the shader's struct and are scalars, `[T; 2]`,
/// `[T; 4]` or arrays of `[T; 4]`, without padding after the last one. Offsets equal WGSL's if
/// pairs begin at multiples of 8 bytes and fours at multiples of 16. A mistake is found when the
/// uniform is bound ([`Pass::uniform`](super::Pass::uniform)).
#[macro_export]
macro_rules! uniform {
    ($(#[$meta:meta])* $vis:vis struct $name:ident { $($(#[$fmeta:meta])* $field:ident : $type:ty),* $(,)? }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
        $vis struct $name { $($(#[$fmeta])* pub $field: $type),* }
        impl $crate::gpu::Uniform for $name {
            const MEMBERS: &'static [(&'static str, usize)] =
                &[$((stringify!($field), std::mem::offset_of!($name, $field))),*];
        }
    };
}

/// A table of vec4 is a uniform without a struct.
impl<const N: usize> Uniform for [[f32; 4]; N]
where
    Self: bytemuck::Pod,
{
    const MEMBERS: &'static [(&'static str, usize)] = &[];
}

/// A type-erased uniform with its layout.
#[derive(Clone, Debug)]
pub struct UniformBytes {
    pub(super) bytes: Vec<u8>,
    pub(super) members: &'static [(&'static str, usize)],
}

impl UniformBytes {
    pub fn new<U: Uniform>(value: &U) -> Self {
        Self { bytes: bytemuck::bytes_of(value).to_vec(), members: U::MEMBERS }
    }
}

/// Part of a buffer.
#[derive(Clone, Debug)]
pub struct Bytes {
    pub buffer: wgpu::Buffer,
    pub offset: u64,
    /// `None`: the rest of the buffer.
    pub size: Option<wgpu::BufferSize>,
}

impl Bytes {
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.buffer,
            offset: self.offset,
            size: self.size,
        })
    }
}

impl From<&wgpu::Buffer> for Bytes {
    fn from(buffer: &wgpu::Buffer) -> Self {
        Self { buffer: buffer.clone(), offset: 0, size: None }
    }
}

/// Size of a chunk. A larger value gets its own chunk.
const CHUNK_BYTES: u64 = 1 << 18;
/// An alignment supported by every adapter.
const UNIFORM_ALIGNMENT_BYTES: u64 = 256;

/// The uniforms of a recording, in a few shared buffers. They are written at submission and reused
/// after it: the queue orders the next write after earlier reads.
#[derive(Debug, Default)]
pub struct Uniforms {
    chunks: Vec<wgpu::Buffer>,
    /// The bytes to write into the chunk of the same index.
    staged: Vec<Vec<u8>>,
}

impl Uniforms {
    /// Reserves space for bytes, padded to a multiple of `padded_to`.
    pub fn push(&mut self, gpu: &Gpu, bytes: &[u8], padded_to: u64) -> Bytes {
        let size = (bytes.len() as u64).next_multiple_of(padded_to).max(padded_to);
        let fits = |staged: &Vec<u8>, chunk: &wgpu::Buffer| staged.len() as u64 + size <= chunk.size();
        let last = self.staged.len().checked_sub(1).filter(|&i| fits(&self.staged[i], &self.chunks[i]));
        let number = last.unwrap_or_else(|| self.next_chunk(gpu, size));
        let staged = &mut self.staged[number];
        let offset = staged.len() as u64;
        staged.extend_from_slice(bytes);
        // The next value must be aligned.
        staged.resize(((offset + size).next_multiple_of(UNIFORM_ALIGNMENT_BYTES)) as usize, 0);
        Bytes { buffer: self.chunks[number].clone(), offset, size: wgpu::BufferSize::new(size) }
    }

    fn next_chunk(&mut self, gpu: &Gpu, size: u64) -> usize {
        let number = self.staged.len();
        self.staged.push(Vec::new());
        if self.chunks.get(number).is_none_or(|chunk| chunk.size() < size) {
            let chunk = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("uniforms"),
                size: size.next_multiple_of(UNIFORM_ALIGNMENT_BYTES).max(CHUNK_BYTES),
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            self.chunks.insert(number, chunk);
        }
        number
    }

    /// Writes all pushed values, ahead of the next submission.
    pub fn write(&mut self, gpu: &Gpu) {
        for (chunk, staged) in self.chunks.iter().zip(&mut self.staged) {
            staged.truncate(chunk.size() as usize);
            gpu.queue.write_buffer(chunk, 0, staged);
        }
        self.staged.clear();
    }
}

/// A buffer with `bytes`, padded to 16, for a persistent `var<uniform>`.
///
/// No uniform value may determine a branch or a loop by itself: a software driver (lavapipe)
/// compiles such values into the shader, again for each value, up to a second each time. A choice
/// is an `override` of the pipeline; a count is read from a storage buffer, or is its length.
pub fn constants(gpu: &Gpu, label: &str, bytes: &[u8]) -> wgpu::Buffer {
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().next_multiple_of(16).max(16), 0);
    gpu.buffer(label, &padded, wgpu::BufferUsages::UNIFORM)
}
