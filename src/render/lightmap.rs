//! Lightmaps of the parts on the GPU. They are computed in shadow/lightmap.rs.

use std::sync::Arc;

use crate::gpu::{Gpu, half_texels};

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

/// Lightmaps of a scene's parts, in order.
#[derive(Debug)]
pub struct PartLightmaps {
    of_parts: Vec<Option<Arc<Lightmap>>>,
    bound: Vec<(Arc<Lightmap>, wgpu::BindGroup)>,
    none: wgpu::BindGroup,
    pub strength: f32,
}

impl PartLightmaps {
    pub fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout) -> Self {
        let none = upload(gpu, layout, &Lightmap { side: 1, layers: vec![vec![[1.0; 4]]; 2] });
        Self { of_parts: Vec::new(), bound: Vec::new(), none, strength: 1.0 }
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
        let is_same = |(a, b): (&Option<Arc<Lightmap>>, &Option<Arc<Lightmap>>)| match (a, b) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        if self.of_parts.len() == of_parts.len() && self.of_parts.iter().zip(of_parts).all(is_same) {
            return previous_strength != strength;
        }
        self.bound.retain(|(bound, _)| of_parts.iter().flatten().any(|map| Arc::ptr_eq(map, bound)));
        for map in of_parts.iter().flatten() {
            if !self.bound.iter().any(|(bound, _)| Arc::ptr_eq(map, bound)) {
                self.bound.push((map.clone(), upload(gpu, layout, map)));
            }
        }
        self.of_parts = of_parts.to_vec();
        true
    }

    pub fn has_lightmap(&self, part: usize) -> bool {
        self.of_parts.get(part).is_some_and(Option::is_some)
    }

    pub fn of(&self, part: usize) -> &wgpu::BindGroup {
        let map = self.of_parts.get(part).and_then(Option::as_ref);
        let bound = map.and_then(|map| self.bound.iter().find(|(bound, _)| Arc::ptr_eq(map, bound)));
        bound.map_or(&self.none, |(_, group)| group)
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
