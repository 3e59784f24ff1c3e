//! The light that reaches each part's surface, on the GPU. What it is worked out from: shadow/lightmap.rs.

use std::sync::Arc;

use crate::gpu::{Gpu, half_texels};

/// A part's lightmap.
#[derive(Clone, Debug, PartialEq)]
pub struct Lightmap {
    /// Texels along each side.
    pub side: u32,
    /// As shaders/raster.wgsl reads them, each row by row. First the share of the surroundings' light that arrives (r, g, b) and of
    /// the first light; then the light that other things throw, and the share of the second light; then the shares of four more
    /// lights each. Suns come before lamps. For a double-sided surface those of its back follow.
    pub layers: Vec<Vec<[f32; 4]>>,
}

/// Those of a scene's parts, in turn.
#[derive(Debug)]
pub struct LitParts {
    of_parts: Vec<Option<Arc<Lightmap>>>,
    known: Vec<(Arc<Lightmap>, wgpu::BindGroup)>,
    none: wgpu::BindGroup,
    pub strength: f32,
}

impl LitParts {
    pub fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout) -> Self {
        let none = upload(gpu, layout, &Lightmap { side: 1, layers: vec![vec![[1.0; 4]]; 2] });
        Self { of_parts: Vec::new(), known: Vec::new(), none, strength: 1.0 }
    }

    pub fn take(
        &mut self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        of_parts: &[Option<Arc<Lightmap>>],
        strength: f32,
    ) {
        self.strength = strength;
        let is_same = |(a, b): (&Option<Arc<Lightmap>>, &Option<Arc<Lightmap>>)| match (a, b) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        if self.of_parts.len() == of_parts.len() && self.of_parts.iter().zip(of_parts).all(is_same) {
            return;
        }
        self.known.retain(|(known, _)| of_parts.iter().flatten().any(|map| Arc::ptr_eq(map, known)));
        for map in of_parts.iter().flatten() {
            if !self.known.iter().any(|(known, _)| Arc::ptr_eq(map, known)) {
                self.known.push((map.clone(), upload(gpu, layout, map)));
            }
        }
        self.of_parts = of_parts.to_vec();
    }

    pub fn is_of(&self, part: usize) -> bool {
        self.of_parts.get(part).is_some_and(Option::is_some)
    }

    pub fn of(&self, part: usize) -> &wgpu::BindGroup {
        let map = self.of_parts.get(part).and_then(Option::as_ref);
        let known = map.and_then(|map| self.known.iter().find(|(known, _)| Arc::ptr_eq(map, known)));
        known.map_or(&self.none, |(_, group)| group)
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
