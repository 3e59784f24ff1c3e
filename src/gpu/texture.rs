//! Textures and a pool that lends them again.

use std::collections::HashMap;

use bytemuck::Pod;

use super::Gpu;

/// A 2-D texture with its view. Cheap to clone: handles only.
#[derive(Clone, Debug)]
pub struct Texture {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
    pub width: u32,
    pub height: u32,
    pub format: wgpu::TextureFormat,
}

impl Texture {
    pub fn new(gpu: &Gpu, label: &str, width: u32, height: u32, format: wgpu::TextureFormat, samples: u32) -> Self {
        Self::with_levels(gpu, label, width, height, format, samples, 1)
    }

    fn with_levels(
        gpu: &Gpu,
        label: &str,
        width: u32,
        height: u32,
        format: wgpu::TextureFormat,
        samples: u32,
        levels: u32,
    ) -> Self {
        use wgpu::TextureUsages as U;
        let mut usage = U::TEXTURE_BINDING;
        if samples == 1 {
            usage |= U::COPY_DST | U::COPY_SRC;
        }
        if format != wgpu::TextureFormat::R32Float && format != wgpu::TextureFormat::R16Sint {
            usage |= U::RENDER_ATTACHMENT;
        }
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: width.max(1), height: height.max(1), depth_or_array_layers: 1 },
            mip_level_count: levels,
            sample_count: samples,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { texture, view, width: width.max(1), height: height.max(1), format }
    }

    /// Writes rows of texels into the upper left corner.
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

/// No multiple of it is a power of two: software drivers compile a shader anew for each mixture
/// of sides that are powers of two and sides that are not, a second each time.
const STEP_PX: u32 = 48;

/// Lends textures by purpose, which is one word for the whole program: who uses another's gets another's texture. One is
/// made anew only when its size class, format, samples or levels change.
///
/// Sizes are rounded up to `STEP_PX`, so that a moving object's rectangle does not make new
/// textures each frame; what lies beyond the asked size is empty, for passes clear all of
/// their targets.
#[derive(Debug, Default)]
pub struct TexturePool {
    lent: HashMap<(&'static str, usize), Texture>,
}

/// What passes ask for beyond the rectangle that is drawn, px: neighbours, the lattice of the noise.
const MARGIN_PX: u32 = 16;
/// Of the largest texture: multisampled colour.
const BYTES_PER_PX: u64 = 32;

impl TexturePool {
    /// No side of what is drawn may be longer, px.
    pub fn largest_side_px(gpu: &Gpu) -> u32 {
        gpu.max_side_px() / STEP_PX * STEP_PX - MARGIN_PX
    }

    /// What is drawn may have no more pixels; as far as the adapter tells, by the largest piece of memory that it gives.
    pub fn largest_area_px(gpu: &Gpu) -> u32 {
        (gpu.device.limits().max_buffer_size / BYTES_PER_PX).try_into().unwrap_or(u32::MAX)
    }

    /// A texture of at least this size for `purpose`; the same purpose and `slot` gets the
    /// same texture again.
    pub fn get(
        &mut self,
        gpu: &Gpu,
        purpose: &'static str,
        slot: usize,
        (width, height): (u32, u32),
        format: wgpu::TextureFormat,
        samples: u32,
    ) -> Texture {
        let (w, h) = (width.div_ceil(STEP_PX) * STEP_PX, height.div_ceil(STEP_PX) * STEP_PX);
        if let Some(t) = self.lent.get(&(purpose, slot))
            && (t.width, t.height, t.format) == (w, h, format)
            && (t.texture.sample_count(), t.texture.mip_level_count()) == (samples, 1)
        {
            return t.clone();
        }
        let texture = Texture::new(gpu, purpose, w, h, format, samples);
        self.lent.insert((purpose, slot), texture.clone());
        texture
    }
}

/// A picture at half, a quarter, an eighth of a size and so on.
#[derive(Clone, Debug)]
pub struct Pyramid {
    /// All levels, for samplers; level 0 is the half.
    pub view: wgpu::TextureView,
    /// Each level to be drawn into; the first is the half.
    pub levels: Vec<Texture>,
}

impl TexturePool {
    /// As [`TexturePool::get`], at half the size and `levels` levels in all. Level l (1 is the half) has texels of 2^l
    /// pixels whatever the size, up to level 4.
    pub fn pyramid(
        &mut self,
        gpu: &Gpu,
        purpose: &'static str,
        (width, height): (u32, u32),
        format: wgpu::TextureFormat,
        levels: u32,
    ) -> Pyramid {
        let [w, h] = [width, height].map(|side| side.div_ceil(STEP_PX).max(1) * STEP_PX / 2);
        let known = self
            .lent
            .get(&(purpose, 0))
            .filter(|t| (t.width, t.height, t.format, t.texture.mip_level_count()) == (w, h, format, levels));
        let all = known.cloned().unwrap_or_else(|| Texture::with_levels(gpu, purpose, w, h, format, 1, levels));
        self.lent.insert((purpose, 0), all.clone());
        let levels = (0..levels)
            .map(|level| {
                let view = all.texture.create_view(&wgpu::TextureViewDescriptor {
                    base_mip_level: level,
                    mip_level_count: Some(1),
                    ..Default::default()
                });
                Texture { view, width: w >> level, height: h >> level, ..all.clone() }
            })
            .collect();
        Pyramid { view: all.view, levels }
    }
}

/// A buffer that holds `bytes`, padded to 16, for `var<uniform>`.
///
/// No value in it may decide a branch by itself: a software driver (lavapipe) writes such
/// values into the shader and compiles it anew, up to a second each time, with every new buffer.
/// What decides branches and stays for a run is an `override` of the pipeline.
pub fn constants(gpu: &Gpu, label: &str, bytes: &[u8]) -> wgpu::Buffer {
    use wgpu::util::DeviceExt;
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().div_ceil(16).max(1) * 16, 0);
    gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some(label),
        contents: &padded,
        usage: wgpu::BufferUsages::UNIFORM,
    })
}

/// Four 32-bit floats a texel to the bits of 16-bit ones.
pub fn half_texels(texels: &[[f32; 4]]) -> Vec<[u16; 4]> {
    texels.iter().map(|t| t.map(|v| half::f16::from_f32(v).to_bits())).collect()
}
