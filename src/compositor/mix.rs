//! The composite, and the mixed stage's effects in the same pass.

use std::collections::HashMap;

use crate::camera::Camera;
use crate::camera::exposure::photographic_gain;
use crate::effects::{MixedInputs, Photograph, response_constants};
use crate::gpu::{FullscreenPass, Gpu, Options, Slot, Texture, constants, expand, source};
use crate::image::{Codes, Pixels, Rect};
use crate::render::{Layer, LayerRun};

/// The first binding that is an effect's.
const FIRST_EFFECT_BINDING: usize = 4;

/// What of the picture is composited at once: all, or one side of the seam where a layer lies across that of a 360° picture.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    pub shown: Rect,
    /// What the layer covers, as seen from this piece; reaches beyond the picture. Elsewhere the layer is empty.
    pub drawn: Rect,
    /// Pieces that are submitted together have one each.
    pub slot: usize,
}

/// An effect's part of the composite, for one frame.
#[derive(Debug)]
pub struct MixedEffect {
    pub name: &'static str,
    pub wgsl: &'static str,
    pub inputs: MixedInputs,
}

/// `Composite` of shaders/composite.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct CompositeUniform {
    origin: [i32; 4],
    size: [i32; 4],
    layer: [i32; 4],
    scale: [f32; 4],
}

/// Names and texts of a composite's effects, in order.
type Effects = Vec<(&'static str, &'static str)>;

/// Mixes camera and layer. Keeps a pass for each combination of effects that was asked for.
#[derive(Debug)]
pub struct Mixer {
    /// For effects, a format, whether it is a photograph, and whether effects acted on its real part.
    passes: HashMap<(Effects, wgpu::TextureFormat, [bool; 2]), FullscreenPass>,
    sigma: wgpu::Buffer,
    /// The response, for the shader.
    constants: [(&'static str, f64); 2],
}

impl Mixer {
    pub fn new(gpu: &Gpu, camera: &Camera) -> Self {
        let sigma: Vec<[f32; 4]> = match &camera.noise {
            Some(noise) => noise.table().into_iter().map(|[r, g, b]| [r, g, b, 0.0]).collect(),
            None => vec![[0.0; 4]; 256],
        };
        Self {
            passes: HashMap::new(),
            sigma: constants(gpu, "sigma", bytemuck::cast_slice(&sigma)),
            constants: response_constants(&camera.response),
        }
    }

    /// Records the composite of a piece.
    pub fn mix(
        &mut self,
        run: &mut LayerRun<'_>,
        pixels: &Pixels,
        layer: &Layer,
        piece: &Piece,
        effects: &[MixedEffect],
        photograph: Option<&Photograph>,
    ) -> Texture {
        let gpu = run.gpu;
        let Piece { shown, drawn, slot } = *piece;
        let format = match pixels.codes {
            Codes::U8(_) => wgpu::TextureFormat::Rgba8Uint,
            Codes::U16(_) => wgpu::TextureFormat::Rgba16Uint,
        };
        // One pixel more on each side, for effects that look at neighbours.
        let sent = shown.grown(1).intersection(&Rect::full(pixels.width, pixels.height));
        let camera = run.pool.get(gpu, "camera", slot, (sent.width(), sent.height()), format, 1);
        send(gpu, &camera, pixels, sent);
        let size = (shown.width(), shown.height());
        let out = run.pool.get(gpu, "composite", slot, size, format, 1);

        let (gain, left) = photograph.map_or((1.0, 1.0), |p| (photographic_gain(p.over_ev), p.noise_left));
        let uniform = CompositeUniform {
            origin: [shown.x0, shown.y0, shown.x0 - sent.x0, shown.y0 - sent.y0],
            size: [size.0 as i32, size.1 as i32, sent.width() as i32, sent.height() as i32],
            layer: [shown.x0 - drawn.x0, shown.y0 - drawn.y0, drawn.width() as i32, drawn.height() as i32],
            scale: [pixels.max_code() as f32, gain as f32, left as f32, 0.0],
        };
        let uniform = constants(gpu, "composite", bytemuck::bytes_of(&uniform));
        let uniform_of =
            |e: &MixedEffect| (!e.inputs.uniform.is_empty()).then(|| constants(gpu, e.name, &e.inputs.uniform));
        let uniforms: Vec<_> = effects.iter().map(uniform_of).collect();
        let names: Effects = effects.iter().map(|e| (e.name, e.wgsl)).collect();
        let kind = [photograph.is_some(), layer.real.is_some()];
        let pass = self.passes.entry((names.clone(), format, kind)).or_insert_with(|| {
            let [curve, gamma] = self.constants;
            let whole = ("photograph", f64::from(u8::from(photograph.is_some())));
            let options = Options { constants: &[curve, gamma, whole], ..Options::default() };
            FullscreenPass::with(gpu, "composite", &shader(&names, kind[1]), &[format], &options)
        });
        let mut slots = vec![
            Slot::Texture(&camera.view),
            Slot::Texture(&layer.color.view),
            Slot::Buffer(&uniform),
            Slot::Buffer(&self.sigma),
        ];
        for (effect, uniform) in effects.iter().zip(&uniforms) {
            slots.extend(uniform.iter().map(Slot::Buffer));
            slots.extend(effect.inputs.textures.iter().map(|t| Slot::Texture(&t.view)));
        }
        slots.extend(layer.real.iter().map(|real| Slot::Texture(&real.light.view)));
        pass.run(gpu, run.encoder, &slots, &[&out], size);
        out
    }
}

/// The composite's shader with the functions and calls of effects (name and WGSL), their
/// bindings renumbered so that each stands behind the one before; last the real part's light, where effects acted on it.
pub fn shader(effects: &[(&str, &str)], acted_on_real: bool) -> String {
    let mut seen = Vec::new();
    let base = expand(source("composite"), &mut seen);
    let mut functions = String::new();
    let mut calls = String::new();
    let mut shift = 0;
    for (name, wgsl) in effects {
        let mut wgsl = expand(wgsl, &mut seen);
        let count = wgsl.matches("@binding(").count();
        for own in (FIRST_EFFECT_BINDING..FIRST_EFFECT_BINDING + count).rev() {
            wgsl = wgsl.replace(&format!("@binding({own})"), &format!("@binding({})", own + shift));
        }
        functions.push_str(&wgsl);
        calls.push_str(&format!("    pixel = apply_{name}(p, pixel);\n"));
        shift += count;
    }
    // Between its two marks stands how the camera's light is read.
    let base = match base.split("// @real\n").collect::<Vec<_>>().as_slice() {
        [before, _, after] if acted_on_real => {
            let binding = format!("@binding({})", FIRST_EFFECT_BINDING + shift);
            let real_at = expand(source("composite_real"), &mut seen).replace("@binding(4)", &binding);
            [before, real_at.as_str(), after].concat()
        }
        _ => base,
    };
    base.replace("// @effects\n", &functions).replace("    // @calls\n", &calls)
}

/// Uploads a rectangle of the camera's codes.
fn send(gpu: &Gpu, texture: &Texture, pixels: &Pixels, rect: Rect) {
    fn rgba<T: Copy + Default>(codes: &[T], picture_width: usize, rect: Rect) -> Vec<[T; 4]> {
        let columns = rect.width() as usize;
        let mut out = Vec::with_capacity(columns * rect.height() as usize);
        for y in rect.y0 as usize..rect.y1 as usize {
            let start = 3 * (y * picture_width + rect.x0 as usize);
            out.extend(codes[start..start + 3 * columns].chunks_exact(3).map(|c| [c[0], c[1], c[2], T::default()]));
        }
        out
    }
    let (width, height) = (rect.width(), rect.height());
    match &pixels.codes {
        Codes::U8(c) => texture.write(gpu, width, height, &rgba(c, pixels.width as usize, rect)),
        Codes::U16(c) => texture.write(gpu, width, height, &rgba(c, pixels.width as usize, rect)),
    }
}
