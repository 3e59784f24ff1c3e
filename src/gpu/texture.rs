//! Textures, and a texture pool.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytemuck::Pod;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};

use super::Gpu;

/// A 2-D texture with its view. Cheap to clone: handles only. A texture lent by a [`TexturePool`]
/// returns to it when its last clone is dropped.
#[derive(Clone, Debug)]
pub struct Texture {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
    pub width: u32,
    pub height: u32,
    pub format: wgpu::TextureFormat,
    _lease: Option<Arc<Lease>>,
}

/// Textures are equal if they are the same memory.
impl PartialEq for Texture {
    fn eq(&self, other: &Self) -> bool {
        self.texture == other.texture && self.view == other.view
    }
}

/// A texture's size, format, samples and levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureSpec {
    pub width: u32,
    pub height: u32,
    pub format: wgpu::TextureFormat,
    pub samples: u32,
    pub levels: u32,
}

impl Texture {
    /// A texture outside any pool.
    pub fn new(gpu: &Gpu, label: &str, width: u32, height: u32, format: wgpu::TextureFormat, samples: u32) -> Self {
        Self::of(gpu, label, TextureSpec { width, height, format, samples, levels: 1 })
    }

    fn of(gpu: &Gpu, label: &str, spec: TextureSpec) -> Self {
        use wgpu::TextureUsages as U;
        let TextureSpec { format, samples, levels, .. } = spec;
        let (width, height) = (spec.width.max(1), spec.height.max(1));
        let mut usage = U::TEXTURE_BINDING;
        if samples == 1 {
            usage |= U::COPY_DST | U::COPY_SRC;
        }
        if format != wgpu::TextureFormat::R16Sint {
            usage |= U::RENDER_ATTACHMENT;
        }
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: levels,
            sample_count: samples,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { texture, view, width, height, format, _lease: None }
    }

    fn spec(&self) -> TextureSpec {
        let (samples, levels) = (self.texture.sample_count(), self.texture.mip_level_count());
        TextureSpec { width: self.width, height: self.height, format: self.format, samples, levels }
    }

    /// Writes texels into the upper left corner, ahead of the next submission. Nothing recorded
    /// since the last submission may use this texture: it must be outside the pool, or from
    /// [`TexturePool::lend_to_write`].
    pub fn write<T: Pod>(&self, gpu: &Gpu, width: u32, height: u32, texels: &[T]) {
        if width == 0 || height == 0 {
            return;
        }
        let bytes: &[u8] = bytemuck::cast_slice(texels);
        gpu.queue.write_texture(
            self.texture.as_image_copy(),
            bytes,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some((bytes.len() / height as usize) as u32),
                rows_per_image: None,
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
}

/// Texture sizes are multiples of this, none of which is a power of two. Software drivers recompile
/// a shader for each combination of power-of-two and other sides, a second each time.
const SIZE_STEP_PX: u32 = 48;
/// Number of submissions for which unused textures are kept.
const MAX_IDLE_SUBMISSIONS: u64 = 24;
/// Margin of passes' textures beyond the drawn rectangle, px: neighbours, the noise's lattice.
const MARGIN_PX: u32 = 16;
/// Size of the largest texture format: multisampled colour.
const BYTES_PER_PX: u64 = 32;

/// Lends textures, and reclaims each when its last clone is dropped. It may then be lent to later
/// work in the same recording, because the GPU executes in the order of recording.
///
/// Sizes are rounded up to `SIZE_STEP_PX`, so that a moving object's rectangle does not create new
/// textures each frame. Beyond the requested size a texture is transparent once drawn into, because
/// passes clear all of their targets.
#[derive(Clone, Debug, Default)]
pub struct TexturePool(Arc<Mutex<Idle>>);

/// Idle textures, each with the submission number at its return.
#[derive(Debug, Default)]
struct Idle {
    textures: Vec<(Texture, u64)>,
    submission: u64,
}

#[derive(Debug)]
struct Lease {
    /// Has no lease itself.
    texture: Texture,
    pool: TexturePool,
}

impl Drop for Lease {
    fn drop(&mut self) {
        let mut idle = self.pool.idle();
        let submission = idle.submission;
        idle.textures.push((self.texture.clone(), submission));
    }
}

impl TexturePool {
    /// Maximum side that can be drawn, px.
    pub fn max_side_px(gpu: &Gpu) -> u32 {
        gpu.max_side_px() / SIZE_STEP_PX * SIZE_STEP_PX - MARGIN_PX
    }

    /// Maximum area that can be drawn, px, estimated from the adapter's maximum buffer size.
    pub fn max_area_px(gpu: &Gpu) -> u32 {
        (gpu.device.limits().max_buffer_size / BYTES_PER_PX).try_into().unwrap_or(u32::MAX)
    }

    fn idle(&self) -> MutexGuard<'_, Idle> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A texture of at least this size to draw into.
    pub fn lend(&self, gpu: &Gpu, size: (u32, u32), format: wgpu::TextureFormat) -> Texture {
        self.of(gpu, size, format, 1, false)
    }

    /// A multisampled texture to draw into.
    pub fn lend_samples(&self, gpu: &Gpu, size: (u32, u32), format: wgpu::TextureFormat, samples: u32) -> Texture {
        self.of(gpu, size, format, samples, false)
    }

    /// A texture to [`Texture::write`] into.
    pub fn lend_to_write(&self, gpu: &Gpu, size: (u32, u32), format: wgpu::TextureFormat) -> Texture {
        self.of(gpu, size, format, 1, true)
    }

    fn of(&self, gpu: &Gpu, size: (u32, u32), format: wgpu::TextureFormat, samples: u32, to_write: bool) -> Texture {
        let [width, height] = [size.0, size.1].map(|side| side.div_ceil(SIZE_STEP_PX).max(1) * SIZE_STEP_PX);
        self.find(gpu, TextureSpec { width, height, format, samples, levels: 1 }, to_write)
    }

    fn find(&self, gpu: &Gpu, spec: TextureSpec, to_write: bool) -> Texture {
        let mut idle = self.idle();
        let now = idle.submission;
        let fits = |(texture, used): &(Texture, u64)| texture.spec() == spec && (!to_write || *used < now);
        let idle_texture = idle.textures.iter().rposition(fits).map(|i| idle.textures.swap_remove(i).0);
        drop(idle);
        let texture = idle_texture.unwrap_or_else(|| Texture::of(gpu, "lent", spec));
        let lease = Lease { texture: texture.clone(), pool: self.clone() };
        Texture { _lease: Some(Arc::new(lease)), ..texture }
    }

    /// To be called at each submission: textures used before it may be written after it.
    pub fn submitted(&self) {
        let mut idle = self.idle();
        idle.submission += 1;
        let now = idle.submission;
        idle.textures.retain(|(_, used)| used + MAX_IDLE_SUBMISSIONS > now);
    }

    /// A pyramid to draw into, with `levels` levels starting at half the size. Level l (1 is the
    /// half) has texels of 2^l pixels for any size, up to level 4.
    pub fn lend_pyramid(&self, gpu: &Gpu, size: (u32, u32), format: wgpu::TextureFormat, levels: u32) -> Pyramid {
        let [width, height] = [size.0, size.1].map(|side| side.div_ceil(SIZE_STEP_PX).max(1) * SIZE_STEP_PX / 2);
        let all = self.find(gpu, TextureSpec { width, height, format, samples: 1, levels }, false);
        let levels = (0..levels)
            .map(|level| {
                let view = all.texture.create_view(&wgpu::TextureViewDescriptor {
                    base_mip_level: level,
                    mip_level_count: Some(1),
                    ..Default::default()
                });
                Texture { view, width: width >> level, height: height >> level, ..all.clone() }
            })
            .collect();
        Pyramid { all, levels }
    }
}

/// A picture at half, a quarter, an eighth of a size and so on.
#[derive(Clone, Debug)]
pub struct Pyramid {
    /// All levels, for samplers. Level 0 is the half.
    pub all: Texture,
    /// Each level, to draw into. The first is the half.
    pub levels: Vec<Texture>,
}

/// Converts four 32-bit floats per texel to half floats, as bits.
pub fn half_texels(texels: &[[f32; 4]]) -> Vec<[u16; 4]> {
    let mut out = vec![[0; 4]; texels.len()];
    out.as_flattened_mut().reinterpret_cast_mut::<half::f16>().convert_from_f32_slice(texels.as_flattened());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dropped_texture_is_reused_and_written_only_after_a_submission() {
        let gpu = Gpu::open().expect("an adapter");
        let pool = TexturePool::default();
        let format = wgpu::TextureFormat::Rgba8Uint;
        let first = pool.lend(&gpu, (50, 20), format);
        assert_eq!((first.width, first.height), (96, 48));
        let other = pool.lend(&gpu, (50, 20), format);
        assert_ne!(first.texture, other.texture);
        let kept = first.texture.clone();
        let clone = first.clone();
        drop(first);
        assert_ne!(pool.lend(&gpu, (50, 20), format).texture, kept, "a clone holds it still");
        drop(clone);
        // A pass may draw into it at once, but writes are executed before all passes.
        let written = pool.lend_to_write(&gpu, (50, 20), format);
        assert_ne!(written.texture, kept);
        pool.submitted();
        drop((written, other));
        let again = pool.lend_to_write(&gpu, (50, 20), format);
        assert_eq!(again.texture, kept);
        // Unused for long.
        drop(again);
        (0..=MAX_IDLE_SUBMISSIONS).for_each(|_| pool.submitted());
        assert!(pool.idle().textures.is_empty());
    }
}
