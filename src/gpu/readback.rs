//! Texels back to the CPU, with several frames in flight.

use std::sync::{
    Arc,
    atomic::{AtomicU8, Ordering},
};

use super::{Gpu, GpuError, Recorder, Texture};

/// Buffers that readbacks borrow and return.
#[derive(Debug, Default)]
pub struct ReadbackSet {
    free: Vec<wgpu::Buffer>,
}

/// A copy in progress.
#[derive(Debug)]
pub struct Readback {
    buffer: wgpu::Buffer,
    size: u64,
    row_bytes: usize,
    padded_row_bytes: usize,
    state: Arc<AtomicU8>,
    submission: Option<wgpu::SubmissionIndex>,
}

const PENDING: u8 = 0;
const READY: u8 = 1;

impl ReadbackSet {
    /// Records a copy of the upper left `width` × `height` of a texture.
    pub fn copy(&mut self, recorder: &mut Recorder, texture: &Texture, (width, height): (u32, u32)) -> Readback {
        let texel_bytes = texture.format.block_copy_size(None).unwrap_or(4);
        let row_bytes = width * texel_bytes;
        let padded = row_bytes.div_ceil(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT) * wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;
        let size = u64::from(padded) * u64::from(height);
        let buffer = match self.free.iter().position(|b| b.size() >= size) {
            Some(i) => self.free.swap_remove(i),
            None => {
                // A buffer that is too small would never be used again.
                self.free.pop();
                recorder.gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("readback"),
                    size: size.next_power_of_two(),
                    usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                    mapped_at_creation: false,
                })
            }
        };
        recorder.encoder().copy_texture_to_buffer(
            texture.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        Readback {
            buffer,
            size,
            row_bytes: row_bytes as usize,
            padded_row_bytes: padded as usize,
            state: Arc::new(AtomicU8::new(PENDING)),
            submission: None,
        }
    }

    /// Keeps a finished readback's buffer for the next one.
    pub fn give_back(&mut self, readback: Readback) {
        self.free.push(readback.buffer);
    }
}

impl Readback {
    /// To be called once, after the encoder was submitted.
    pub fn submitted(&mut self, submission: wgpu::SubmissionIndex) {
        let state = Arc::clone(&self.state);
        self.buffer.map_async(wgpu::MapMode::Read, 0..self.size, move |result| {
            state.store(if result.is_ok() { READY } else { 2 }, Ordering::Release);
        });
        self.submission = Some(submission);
    }

    /// Whether [`Readback::rows`] would return without waiting. Never waits itself.
    pub fn is_ready(&self, gpu: &Gpu) -> Result<bool, GpuError> {
        if self.state.load(Ordering::Acquire) == PENDING {
            gpu.poll()?;
        }
        Ok(self.state.load(Ordering::Acquire) != PENDING)
    }

    /// Waits, then passes each row's bytes to `take(row, bytes)`.
    pub fn rows(&self, gpu: &Gpu, mut take: impl FnMut(usize, &[u8])) -> Result<(), GpuError> {
        gpu.check()?;
        if self.state.load(Ordering::Acquire) == PENDING {
            gpu.wait(self.submission.clone())?;
        }
        if self.state.load(Ordering::Acquire) != READY {
            return Err(GpuError::Failed("a readback could not be mapped".to_owned()));
        }
        {
            let range =
                self.buffer.get_mapped_range(0..self.size).map_err(|e| GpuError::Failed(format!("readback: {e}")))?;
            for (row, bytes) in range.chunks(self.padded_row_bytes.max(1)).enumerate() {
                take(row, &bytes[..self.row_bytes]);
            }
        }
        self.buffer.unmap();
        Ok(())
    }

    /// Waits, then returns all bytes, rows without padding.
    pub fn bytes(&self, gpu: &Gpu) -> Result<Vec<u8>, GpuError> {
        let mut out = Vec::with_capacity(self.size as usize);
        self.rows(gpu, |_, row| out.extend_from_slice(row))?;
        Ok(out)
    }
}
