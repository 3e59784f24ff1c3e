//! The real part of a photograph as effects see it: its light, and how far away its surfaces are.

use crate::camera::Response;
use crate::depth::Surfaces;
use crate::effects::response_constants;
use crate::gpu::{FullscreenPass, Options, Slot, assemble, constants, half_texels};
use crate::image::{Codes, Pixels, Rect};
use crate::render::{COLOR, GEOMETRY, LayerRun, RealLayer};

/// `Grid` of shaders/real_part.wgsl.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct GridUniform {
    size: [i32; 4],
    scale: [f32; 4],
}

/// Makes it.
#[derive(Debug)]
pub struct RealPart {
    pass: Option<FullscreenPass>,
    constants: [(&'static str, f64); 2],
}

impl RealPart {
    pub fn new(response: &Response) -> Self {
        Self { pass: None, constants: response_constants(response) }
    }

    /// Over `drawn`, which may reach beyond the picture: what lies there is as its edge.
    pub fn make(
        &mut self,
        run: &mut LayerRun<'_>,
        pixels: &Pixels,
        surfaces: &Surfaces,
        drawn: Rect,
        tolerance_m: Option<f32>,
    ) -> RealLayer {
        let gpu = run.gpu;
        let size = (drawn.width(), drawn.height());
        let camera = run.pool.get(gpu, "real codes", 0, size, wgpu::TextureFormat::Rgba16Uint, 1);
        camera.write(gpu, size.0, size.1, &codes(pixels, drawn));

        let grid = (surfaces.width, surfaces.height);
        let near = run.pool.get(gpu, "grid light", 0, grid, COLOR, 1);
        let behind = run.pool.get(gpu, "grid light", 1, grid, COLOR, 1);
        let depths = run.pool.get(gpu, "grid depths", 0, grid, GEOMETRY, 1);
        for (texture, light) in [(&near, &surfaces.light), (&behind, &surfaces.behind_light)] {
            let texels: Vec<_> = light.iter().map(|l| [l[0], l[1], l[2], 1.0]).collect();
            texture.write(gpu, grid.0, grid.1, &half_texels(&texels));
        }
        let words = |z: &f32| [z.to_bits() as u16, (z.to_bits() >> 16) as u16];
        let both: Vec<[u16; 4]> = surfaces
            .depth_m
            .iter()
            .zip(&surfaces.behind_m)
            .map(|(z, behind)| {
                let ([a, b], [c, d]) = (words(z), words(behind));
                [a, b, c, d]
            })
            .collect();
        depths.write(gpu, grid.0, grid.1, &both);

        let uniform = GridUniform {
            size: [grid.0 as i32, grid.1 as i32, drawn.x0, drawn.y0],
            scale: [surfaces.enlargement.recip() as f32, 0.0, 0.0, 0.0],
        };
        let uniform = constants(gpu, "grid", bytemuck::bytes_of(&uniform));
        let out = [0, 1].map(|slot| run.pool.get(gpu, "real light", slot, size, COLOR, 1));
        let out_depths = run.pool.get(gpu, "real depths", 0, size, GEOMETRY, 1);
        let pass = self.pass.get_or_insert_with(|| {
            let options = Options { constants: &self.constants, ..Options::default() };
            FullscreenPass::with(gpu, "real part", &assemble("real_part"), &[COLOR, COLOR, GEOMETRY], &options)
        });
        let slots = [
            Slot::Buffer(&uniform),
            Slot::Texture(&camera.view),
            Slot::Texture(&near.view),
            Slot::Texture(&behind.view),
            Slot::Texture(&depths.view),
        ];
        pass.run(gpu, run.encoder, &slots, &[&out[0], &out[1], &out_depths], size);
        let [light, behind] = out;
        let ranges_m = surfaces.ranges_m(drawn, RealLayer::SIDE_PX);
        RealLayer { light, behind, depths: out_depths, tolerance_m, ranges_m }
    }
}

/// 16 bits over a rectangle; beyond the picture those of its edge.
fn codes(pixels: &Pixels, rect: Rect) -> Vec<[u16; 4]> {
    let scale = (65535 / pixels.max_code()) as u16;
    let place = |at: i32, side: u32| at.clamp(0, side as i32 - 1) as usize;
    let columns: Vec<usize> = (rect.x0..rect.x1).map(|x| place(x, pixels.width)).collect();
    let mut out = Vec::with_capacity(columns.len() * rect.height() as usize);
    for y in rect.y0..rect.y1 {
        let start = 3 * place(y, pixels.height) * pixels.width as usize;
        match &pixels.codes {
            Codes::U8(c) => out.extend(columns.iter().map(|x| {
                let c = &c[start + 3 * x..start + 3 * x + 3];
                [scale * u16::from(c[0]), scale * u16::from(c[1]), scale * u16::from(c[2]), 0]
            })),
            Codes::U16(c) => out.extend(columns.iter().map(|x| {
                let c = &c[start + 3 * x..start + 3 * x + 3];
                [c[0], c[1], c[2], 0]
            })),
        }
    }
    out
}
