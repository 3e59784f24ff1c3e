//! A lens's table for the shader: `lens_table` in shaders/raster.wgsl.

use crate::camera::BoundMap;
use crate::gpu::{Gpu, Texture};

/// The control points of a table, a texel each.
pub fn lens_table(gpu: &Gpu, table: &BoundMap) -> Texture {
    let width = (table.cells[0] + BoundMap::OVERLAP) as u32;
    let texels: Vec<[f32; 4]> = table
        .displacements
        .iter()
        .map(|displacement| displacement.as_vec2().extend(0.0).extend(0.0).to_array())
        .collect();
    let height = texels.len() as u32 / width;
    let texture = Texture::new(gpu, "lens table", width, height, wgpu::TextureFormat::Rgba32Float, 1);
    texture.write(gpu, width, height, &texels);
    texture
}
