//! Lightmaps of the parts on the GPU. They are computed in shadow/lightmap.rs.

use std::sync::Arc;

use crate::gpu::{Gpu, half_texels};
use crate::memo::ByAddress;

/// A part's lightmap.
#[derive(Clone, Debug, PartialEq)]
pub struct Lightmap {
    /// Texels along each side.
    pub side: u32,
    /// Texels row by row, in the layout of shaders/raster.wgsl. First the share of the
    /// environment's light that arrives (r, g, b) and of the first light; then the indirect light
    /// from other objects, and the share of the second light; then the shares of four more lights
    /// each. Suns come before lamps. For a double-sided surface the layers of its back follow.
    pub layers: Vec<Vec<[f32; 4]>>,
}

/// The lightmaps that a scene's parts are drawn with. No memo: it holds exactly the textures in
/// use, however many parts there are.
#[derive(Debug)]
pub struct PartLightmaps {
    /// Lightmaps in the order of the parts.
    of_parts: Vec<Option<BoundLightmap>>,
    none: wgpu::BindGroup,
    pub strength: f32,
}

/// A lightmap on the GPU.
#[derive(Clone, Debug)]
struct BoundLightmap {
    map: ByAddress<Lightmap>,
    group: wgpu::BindGroup,
}

impl PartLightmaps {
    pub fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout) -> Self {
        let none = upload(gpu, layout, &Lightmap { side: 1, layers: vec![vec![[1.0; 4]]; 2] });
        Self { of_parts: Vec::new(), none, strength: 1.0 }
    }

    /// Returns false if nothing changed.
    pub fn take(
        &mut self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        of_parts: &[Option<Arc<Lightmap>>],
        strength: f32,
    ) -> bool {
        let previous_strength = std::mem::replace(&mut self.strength, strength);
        let of_parts: Vec<_> = of_parts.iter().map(|map| map.clone().map(ByAddress)).collect();
        let before = self.of_parts.iter().map(|bound| bound.as_ref().map(|bound| &bound.map));
        if before.eq(of_parts.iter().map(Option::as_ref)) {
            return previous_strength != strength;
        }
        let mut bound: Vec<Option<BoundLightmap>> = Vec::new();
        for map in of_parts {
            let of_part = map.map(|map| {
                let mut bound_maps = self.of_parts.iter().chain(&bound).flatten();
                let same = bound_maps.find(|bound_maps| bound_maps.map == map).cloned();
                same.unwrap_or_else(|| BoundLightmap { group: upload(gpu, layout, &map), map })
            });
            bound.push(of_part);
        }
        self.of_parts = bound;
        true
    }

    pub fn has_lightmap(&self, part: usize) -> bool {
        self.of_part(part).is_some()
    }

    pub fn of(&self, part: usize) -> &wgpu::BindGroup {
        self.of_part(part).map_or(&self.none, |bound| &bound.group)
    }

    fn of_part(&self, part: usize) -> Option<&BoundLightmap> {
        self.of_parts.get(part)?.as_ref()
    }
}

fn upload(gpu: &Gpu, layout: &wgpu::BindGroupLayout, map: &Lightmap) -> wgpu::BindGroup {
    let size = wgpu::Extent3d { width: map.side, height: map.side, depth_or_array_layers: map.layers.len() as u32 };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("lightmap"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let texels: Vec<[f32; 4]> = map.layers.iter().flatten().copied().collect();
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture: &texture,
            mip_level: 0,
            origin: wgpu::Origin3d::ZERO,
            aspect: wgpu::TextureAspect::All,
        },
        bytemuck::cast_slice(&half_texels(&texels)),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * map.side), rows_per_image: Some(map.side) },
        size,
    );
    let view = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("lightmap"),
        layout,
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) }],
    })
}
