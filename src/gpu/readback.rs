//! Readback of texels to the CPU, with several frames in flight.

use std::sync::{Arc, OnceLock};

use super::{Gpu, GpuError, Texture};

/// Pool of readback buffers.
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
    /// Result of mapping the buffer, once known.
    mapped: Arc<OnceLock<bool>>,
    submission: Option<wgpu::SubmissionIndex>,
}

/// Reports the result of mapping. Dropped without a result it reports failure, so that no waiter
/// hangs.
struct MapReporter(Arc<OnceLock<bool>>);

impl Drop for MapReporter {
    fn drop(&mut self) {
        let _ = self.0.set(false);
    }
}

impl ReadbackSet {
    /// Records a copy of the upper left `width` × `height` of a texture.
    pub(super) fn copy(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        texture: &Texture,
        (width, height): (u32, u32),
    ) -> Readback {
        let (_, padded) = row_bytes(&texture.texture, width);
        let size = u64::from(padded) * u64::from(height);
        let buffer = match self.free.iter().position(|b| b.size() >= size) {
            Some(i) => self.free.swap_remove(i),
            None => {
                // A buffer that is too small would never be used again.
                self.free.pop();
                buffer_of(gpu, size.next_power_of_two())
            }
        };
        Readback::begin(encoder, &texture.texture, buffer, (width, height))
    }

    /// Returns a finished readback's buffer to the pool.
    pub fn give_back(&mut self, readback: Readback) {
        self.free.push(readback.buffer);
    }
}

/// Bytes of a row of texels, and of a row of their copy.
fn row_bytes(texture: &wgpu::Texture, width: u32) -> (u32, u32) {
    let row = width * texture.format().block_copy_size(None).unwrap_or(4);
    (row, row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT))
}

pub(super) fn buffer_of(gpu: &Gpu, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("readback"),
        size,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    })
}

/// All texels of an external texture, rows without padding. Waits for them.
pub fn read_back(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Vec<u8>, GpuError> {
    let (width, height) = (texture.width(), texture.height());
    let size = u64::from(row_bytes(texture, width).1) * u64::from(height);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut readback = Readback::begin(&mut encoder, texture, buffer_of(gpu, size), (width, height));
    readback.submitted(gpu.queue.submit([encoder.finish()]));
    readback.bytes(gpu)
}

impl Readback {
    /// Records a copy of the upper left of a texture into a buffer that is large enough.
    fn begin(
        encoder: &mut wgpu::CommandEncoder,
        texture: &wgpu::Texture,
        buffer: wgpu::Buffer,
        (width, height): (u32, u32),
    ) -> Self {
        let (row, padded) = row_bytes(texture, width);
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        Self {
            buffer,
            size: u64::from(padded) * u64::from(height),
            row_bytes: row as usize,
            padded_row_bytes: padded as usize,
            mapped: Arc::default(),
            submission: None,
        }
    }

    /// Records a copy of a buffer into one that is at least as large. Its bytes are returned as one
    /// row.
    pub(super) fn of_buffer(encoder: &mut wgpu::CommandEncoder, from: &wgpu::Buffer, buffer: wgpu::Buffer) -> Self {
        let size = from.size();
        encoder.copy_buffer_to_buffer(from, 0, &buffer, 0, size);
        let bytes = size as usize;
        Self { buffer, size, row_bytes: bytes, padded_row_bytes: bytes, mapped: Arc::default(), submission: None }
    }

    /// To be called once, after the encoder was submitted.
    pub fn submitted(&mut self, submission: wgpu::SubmissionIndex) {
        let tell = MapReporter(Arc::clone(&self.mapped));
        self.buffer.map_async(wgpu::MapMode::Read, 0..self.size, move |result| {
            let _ = tell.0.set(result.is_ok());
        });
        self.submission = Some(submission);
    }

    /// True if [`Readback::rows`] would return without waiting. Does not wait itself.
    pub fn is_ready(&self, gpu: &Gpu) -> Result<bool, GpuError> {
        if self.mapped.get().is_none() {
            gpu.poll()?;
        }
        Ok(self.mapped.get().is_some())
    }

    /// Waits, then passes each row's bytes to `take(row, bytes)`.
    pub fn rows(&self, gpu: &Gpu, mut take: impl FnMut(usize, &[u8])) -> Result<(), GpuError> {
        gpu.check()?;
        if self.submission.is_none() {
            return Err(GpuError::Failed("a readback was never submitted".to_owned()));
        }
        if self.mapped.get().is_none() {
            gpu.wait(self.submission.clone())?;
        }
        // The thread that polls the device runs all callbacks: the copy is done, but another thread
        // may not have run the callback yet.
        if !*self.mapped.wait() {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The first waiter runs the callbacks of both threads, and the other must not continue before
    /// its own callback.
    #[test]
    fn threads_sharing_a_device_wait_for_their_own_readback() {
        let gpu = Gpu::open().unwrap();
        let size = wgpu::Extent3d { width: 4, height: 4, depth_or_array_layers: 1 };
        let read = |value: u8| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::R8Unorm,
                usage: wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            });
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4), rows_per_image: None };
            for _ in 0..400 {
                gpu.queue.write_texture(texture.as_image_copy(), &[value; 16], layout, size);
                assert_eq!(read_back(&gpu, &texture).unwrap(), [value; 16]);
            }
        };
        let read = &read;
        std::thread::scope(|scope| {
            for value in 1..=4 {
                std::thread::Builder::new().spawn_scoped(scope, move || read(value)).unwrap();
            }
        });
    }
}
