//! Materials and textures on the GPU.

use std::sync::Arc;

use crate::digest::{Digest, Digester};
use crate::gpu::{Gpu, constants};
use crate::memo::Memo;
use crate::scene::{Alpha, Material, Scene, SceneTexture, TextureUse, Wrap};

crate::uniform! {
    /// `Material` in shaders/raster.wgsl.
    pub struct MaterialUniform {
        base_color: [f32; 4],
        emissive: [f32; 4],
        metallic: f32,
        roughness: f32,
        normal_scale: f32,
        occlusion: f32,
        cutoff: f32,
        unused: [f32; 3],
        transforms: [[f32; 4]; 10],
    }
}

impl MaterialUniform {
    fn new(m: &Material) -> Self {
        let mut transforms = [[0.0; 4]; 10];
        for (i, slot) in slots(m).iter().enumerate() {
            let rows = slot.map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], |t| t.transform);
            let set = slot.map_or(0.0, |t| t.uv_set as f32);
            transforms[2 * i] = [rows[0][0], rows[0][1], rows[0][2], set];
            transforms[2 * i + 1] = [rows[1][0], rows[1][1], rows[1][2], 0.0];
        }
        let cutoff = if let Alpha::Mask(cutoff) = m.alpha { cutoff } else { 0.0 };
        Self {
            base_color: m.base_color,
            emissive: [m.emissive[0], m.emissive[1], m.emissive[2], 0.0],
            metallic: m.metallic,
            roughness: m.roughness,
            normal_scale: m.normal_scale,
            occlusion: m.occlusion_strength,
            cutoff,
            unused: [0.0; 3],
            transforms,
        }
    }
}

/// A material's textures in the shader's order.
fn slots(m: &Material) -> [Option<TextureUse>; 5] {
    [m.base_color_texture, m.metallic_roughness_texture, m.normal_texture, m.occlusion_texture, m.emissive_texture]
}

/// A bind group for each material of a scene.
pub fn bind_groups(gpu: &Gpu, layout: &wgpu::BindGroupLayout, scene: &Scene) -> Vec<wgpu::BindGroup> {
    // A missing texture is replaced by white, so that factors act alone.
    let white = SceneTexture {
        width: 1,
        height: 1,
        rgba: Arc::new(vec![255; 4]),
        srgb: false,
        wrap: [Wrap::Repeat; 2],
        smooth: false,
        mipmaps: false,
    };
    let white = upload(gpu, &white);
    let textures: Vec<_> = scene.textures.iter().map(|t| upload(gpu, t)).collect();
    scene
        .materials
        .iter()
        .map(|material| {
            let uniform = constants(gpu, "material", bytemuck::bytes_of(&MaterialUniform::new(material)));
            let mut entries = vec![wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() }];
            for (i, slot) in slots(material).iter().enumerate() {
                let (view, sampler) = slot.and_then(|s| textures.get(s.texture)).unwrap_or(&white);
                let binding = 1 + 2 * i as u32;
                entries.push(wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) });
                entries.push(wgpu::BindGroupEntry {
                    binding: binding + 1,
                    resource: wgpu::BindingResource::Sampler(sampler),
                });
            }
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(&material.name),
                layout,
                entries: &entries,
            })
        })
        .collect()
}

fn upload(gpu: &Gpu, texture: &SceneTexture) -> (wgpu::TextureView, wgpu::Sampler) {
    let format = if texture.srgb { wgpu::TextureFormat::Rgba8UnormSrgb } else { wgpu::TextureFormat::Rgba8Unorm };
    let levels = if texture.mipmaps { memoized_mip_chain(texture) } else { Arc::default() };
    let gpu_texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("scene texture"),
        size: wgpu::Extent3d { width: texture.width, height: texture.height, depth_or_array_layers: 1 },
        mip_level_count: 1 + levels.len() as u32,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let base = std::iter::once((texture.width, texture.height, texture.rgba.as_slice()));
    let rest = levels.iter().map(|(w, h, rgba)| (*w, *h, rgba.as_slice()));
    for (level, (width, height, rgba)) in base.chain(rest).enumerate() {
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &gpu_texture,
                mip_level: level as u32,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::All,
            },
            rgba,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
    let address = texture.wrap.map(|w| match w {
        Wrap::Repeat => wgpu::AddressMode::Repeat,
        Wrap::Mirror => wgpu::AddressMode::MirrorRepeat,
        Wrap::Clamp => wgpu::AddressMode::ClampToEdge,
    });
    let smooth = if texture.smooth { wgpu::FilterMode::Linear } else { wgpu::FilterMode::Nearest };
    let trilinear = texture.smooth && texture.mipmaps;
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("scene texture"),
        address_mode_u: address[0],
        address_mode_v: address[1],
        mag_filter: smooth,
        min_filter: smooth,
        mipmap_filter: if trilinear { wgpu::MipmapFilterMode::Linear } else { wgpu::MipmapFilterMode::Nearest },
        ..Default::default()
    });
    (gpu_texture.create_view(&Default::default()), sampler)
}

/// Width, height, texels row by row.
type TextureLevel = (u32, u32, Vec<u8>);

/// Memory for the mipmaps of textures, bytes.
const MIPMAP_BUDGET_BYTES: usize = 64 << 20;

/// Mipmaps by the digest of their texture's size, texels and encoding. Each compositor of a scene
/// uploads the same ones: that of the window, of an export and of a photograph.
static MIPMAPS: Memo<Digest, Arc<Vec<TextureLevel>>> =
    Memo::with_budget(MIPMAP_BUDGET_BYTES, |levels| levels.iter().map(|(.., texels)| texels.len()).sum());

fn memoized_mip_chain(texture: &SceneTexture) -> Arc<Vec<TextureLevel>> {
    let mut digester = Digester::default();
    digester.add(&texture.width);
    digester.add(&texture.height);
    digester.add(&texture.srgb);
    digester.add_numbers(texture.rgba.as_slice());
    MIPMAPS.get_or_insert_with(digester.finish(), |_| Arc::new(mip_chain(texture)))
}

/// Each level is the mean of 2×2 texels of the previous one (3 wide if a side is odd), averaged in
/// linear light for colours.
fn mip_chain(texture: &SceneTexture) -> Vec<TextureLevel> {
    let to_linear: Vec<f32> = (0..=255).map(|code| texture.linear(code)).collect();
    let from_linear = |v: f32| {
        let code = if !texture.srgb {
            v
        } else if v <= 0.003_130_8 {
            12.92 * v
        } else {
            1.055 * v.powf(1.0 / 2.4) - 0.055
        };
        (code * 255.0).round().clamp(0.0, 255.0) as u8
    };
    let (mut w, mut h) = (texture.width as usize, texture.height as usize);
    let mut level: Vec<[f32; 4]> = texture
        .rgba
        .chunks_exact(4)
        .map(|t| {
            let lin = |v: u8| to_linear[usize::from(v)];
            [lin(t[0]), lin(t[1]), lin(t[2]), f32::from(t[3]) / 255.0]
        })
        .collect();
    let mut out = Vec::new();
    while w > 1 || h > 1 {
        let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
        let mut next = vec![[0.0f32; 4]; nw * nh];
        for y in 0..nh {
            let rows = y * h / nh..((y + 1) * h).div_ceil(nh);
            for x in 0..nw {
                let columns = x * w / nw..((x + 1) * w).div_ceil(nw);
                let mut sum = [0.0f32; 4];
                for row in rows.clone() {
                    for column in columns.clone() {
                        (0..4).for_each(|c| sum[c] += level[row * w + column][c]);
                    }
                }
                let count = (rows.len() * columns.len()) as f32;
                next[y * nw + x] = sum.map(|s| s / count);
            }
        }
        let bytes = next
            .iter()
            .flat_map(|t| [from_linear(t[0]), from_linear(t[1]), from_linear(t[2]), (t[3] * 255.0).round() as u8])
            .collect();
        out.push((nw as u32, nh as u32, bytes));
        (w, h, level) = (nw, nh, next);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mipmaps_average_linear_light() {
        let rgba = vec![255, 255, 255, 255, 0, 0, 0, 255, 255, 255, 255, 255, 0, 0, 0, 255];
        let texture = SceneTexture {
            width: 2,
            height: 2,
            rgba: Arc::new(rgba),
            srgb: true,
            wrap: [Wrap::Repeat; 2],
            smooth: true,
            mipmaps: true,
        };
        // Half the light is sRGB code 188.
        assert_eq!(mip_chain(&texture), vec![(1, 1, vec![188, 188, 188, 255])]);
    }
}
