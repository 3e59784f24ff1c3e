//! The real part of a photograph as input of effects: its light, and the depth of its surfaces.

use super::rgba::rgba;
use crate::camera::Response;
use crate::depth::Surfaces;
use crate::effects::{curve_choice, response_samples};
use crate::gpu::{PassRecorder, Shader, ShaderEntry, Texture, half_texels};
use crate::pixels::{Codes, Pixels, Rect};
use crate::render::{COLOR, GEOMETRY, RealLayer};

crate::uniform! {
    struct GridUniform { size: [i32; 2], in_picture: [i32; 2], step: f32, gamma: f32 }
}

/// The real part over `drawn`, which may extend beyond the picture: edge pixels are repeated there.
/// `shadow_mask` is the fraction of its light that virtual objects remove.
pub fn real_layer(
    recorder: &mut PassRecorder,
    pixels: &Pixels,
    surfaces: &Surfaces,
    drawn: Rect,
    tolerance_m: Option<f32>,
    response: &Response,
    shadow_mask: Option<&Texture>,
) -> RealLayer {
    let gpu = recorder.gpu.clone();
    let size = (drawn.width(), drawn.height());
    let camera = recorder.pool.lend_to_write(&gpu, size, wgpu::TextureFormat::Rgba16Uint);
    let picture = (pixels.width, pixels.height);
    let codes = match &pixels.codes {
        Codes::U8(codes) => rgba(codes, picture, drawn, |code| 257 * u16::from(code)),
        Codes::U16(codes) => rgba(codes, picture, drawn, |code| code),
    };
    camera.write(&gpu, size.0, size.1, &codes);

    let grid = (surfaces.nearest.width, surfaces.nearest.height);
    let [near, behind] = [&surfaces.nearest.light, &surfaces.background_light].map(|light| {
        let texture = recorder.pool.lend_to_write(&gpu, grid, COLOR);
        let texels: Vec<_> = light.iter().map(|l| [l[0], l[1], l[2], 1.0]).collect();
        texture.write(&gpu, grid.0, grid.1, &half_texels(&texels));
        texture
    });
    let depths = recorder.pool.lend_to_write(&gpu, grid, GEOMETRY);
    let words = |z: &f32| [z.to_bits() as u16, (z.to_bits() >> 16) as u16];
    let both: Vec<[u16; 4]> = surfaces
        .nearest
        .depth_m
        .iter()
        .zip(&surfaces.background_m)
        .map(|(z, behind)| {
            let ([a, b], [c, d]) = (words(z), words(behind));
            [a, b, c, d]
        })
        .collect();
    depths.write(&gpu, grid.0, grid.1, &both);

    let uniform = GridUniform {
        size: [grid.0 as i32, grid.1 as i32],
        in_picture: [drawn.x0, drawn.y0],
        step: surfaces.nearest.enlargement.recip() as f32,
        gamma: response.gamma as f32,
    };
    let entry =
        ShaderEntry::from("main").choose("curve", curve_choice(response)).choose("shadowed", shadow_mask.is_some());
    let samples = response_samples(recorder, response);
    let pass = recorder.pass(Shader::RealPart, entry).uniform("grid", &uniform).texture("codes", &camera);
    let pass = pass.buffer("response_samples", samples);
    let pass = pass.texture("near_light", &near).texture("far_light", &behind).texture("depths", &depths);
    let pass = pass.texture("shadow_mask", shadow_mask.unwrap_or(&near));
    let [light, behind, depths] = pass.draw([COLOR, COLOR, GEOMETRY], size);
    let ranges_m = surfaces.ranges_m(drawn, RealLayer::SIDE_PX);
    RealLayer { light, behind, depths, tolerance_m, ranges_m }
}
