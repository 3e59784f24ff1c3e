//! Composites layer and camera picture, with the mixed stage's effects in the same pass; and draws
//! the whole picture into a view.

use super::dirty_tiles::dirty_tiles;
use super::example_noise::UncodedPicture;
use super::job::Job;
use super::rgba::rgba;
use crate::camera::exposure::photographic_gain;
use crate::camera::{Camera, NoiseProfile};
use crate::effects::{MixedPart, curve_choice, response_samples};
use crate::gpu::{Bytes, Gpu, PassRecorder, Shader, ShaderEntry, Texture, constants};
use crate::pixels::{Codes, Pixels, Rect};
use crate::render::Layer;

/// A part of the picture that is composited in one pass: all of it, or one side of the seam if a
/// layer lies across the seam of a 360° picture.
#[derive(Clone, Copy, Debug)]
pub struct CompositePiece {
    /// Its rectangle in the picture.
    pub rect: Rect,
    /// The layer's rectangle in this piece's coordinates; may extend beyond the picture. Elsewhere
    /// the layer is empty.
    pub drawn: Rect,
    /// The shadow mask's rectangle in this piece's coordinates.
    pub shadowed: Rect,
}

/// The part of the camera's picture that the composite reads, on the GPU.
#[derive(Clone, Debug)]
pub struct CameraUpload {
    pub texture: Texture,
    /// Its rectangle in the picture.
    pub rect: Rect,
    max_code: f32,
}

impl CameraUpload {
    /// Uploads a rectangle of the camera's codes.
    pub fn new(recorder: &PassRecorder, pixels: &Pixels, rect: Rect) -> Self {
        let (width, height) = (rect.width(), rect.height());
        let picture = (pixels.width, pixels.height);
        let gpu = &recorder.gpu;
        let texture = recorder.pool.lend_to_write(gpu, (width, height), format_of(pixels));
        match &pixels.codes {
            Codes::U8(c) => texture.write(gpu, width, height, &rgba(c, picture, rect, |code| code)),
            Codes::U16(c) => texture.write(gpu, width, height, &rgba(c, picture, rect, |code| code)),
        }
        Self { texture, rect, max_code: pixels.max_code() as f32 }
    }

    /// Records a copy of a rectangle of the picture into a texture.
    pub fn copy(&self, recorder: &mut PassRecorder, rect: Rect, to: &Texture) {
        let (from, size) = self.part(rect);
        recorder.encoder().copy_texture_to_texture(from, to.texture.as_image_copy(), size);
    }

    fn part(&self, rect: Rect) -> (wgpu::TexelCopyTextureInfo<'_>, wgpu::Extent3d) {
        let origin = wgpu::Origin3d { x: (rect.x0 - self.rect.x0) as u32, y: (rect.y0 - self.rect.y0) as u32, z: 0 };
        let size = wgpu::Extent3d { width: rect.width(), height: rect.height(), depth_or_array_layers: 1 };
        (wgpu::TexelCopyTextureInfo { origin, ..self.texture.texture.as_image_copy() }, size)
    }

    /// Records a copy of a composited piece into this picture.
    pub fn copy_piece(&self, recorder: &mut PassRecorder, made: &Texture, rect: Rect) {
        let (to, size) = self.part(rect);
        recorder.encoder().copy_texture_to_texture(made.texture.as_image_copy(), to, size);
    }

    /// Draws the whole picture into a view of its size.
    pub fn show(&self, recorder: &mut PassRecorder, view: &wgpu::TextureView, format: wgpu::TextureFormat) {
        let entry = ShaderEntry::from("main").choose("encodes", format.is_srgb());
        let pass = recorder.pass(Shader::Show, entry).uniform("show", &ShowUniform { max_code: self.max_code });
        pass.texture("codes", &self.texture).draw_views(&[(view, format)], (self.rect.width(), self.rect.height()));
    }
}

fn format_of(pixels: &Pixels) -> wgpu::TextureFormat {
    match pixels.codes {
        Codes::U8(_) => wgpu::TextureFormat::Rgba8Uint,
        Codes::U16(_) => wgpu::TextureFormat::Rgba16Uint,
    }
}

crate::uniform! {
    struct CompositeUniform {
        in_picture: [i32; 2],
        in_camera: [i32; 2],
        in_layer: [i32; 2],
        in_shadow_mask: [i32; 2],
        camera_size: [i32; 2],
        layer_size: [i32; 2],
        shadow_mask_size: [i32; 2],
        made_size: [i32; 2],
        max_code: f32,
        gain: f32,
        noise_left: f32,
        gamma: f32,
        opacity: f32,
    }
}

crate::uniform! {
    struct ShowUniform { max_code: f32 }
}

/// Key of the table of noise σ at 256 code values.
#[derive(Clone, Debug, PartialEq)]
struct SigmaKey(Option<NoiseProfile>);

fn sigma_table(gpu: &Gpu, SigmaKey(noise): &SigmaKey) -> Bytes {
    let table: Vec<[f32; 4]> = match noise {
        Some(noise) => noise.table().into_iter().map(|[r, g, b]| [r, g, b, 0.0]).collect(),
        None => vec![[0.0; 4]; 256],
    };
    Bytes::from(&constants(gpu, "sigma", bytemuck::cast_slice(&table)))
}

/// The shader files of a composite with the effects' parts, in order, and the source of the
/// function that calls the parts one after another.
pub fn mixed_module(parts: &[(Shader, &str)], acted_on_real: bool) -> (Vec<Shader>, String) {
    let real = if acted_on_real { Shader::CompositeReal } else { Shader::CompositeRecorded };
    let shaders = [Shader::Composite, real].into_iter().chain(parts.iter().map(|(shader, _)| *shader)).collect();
    let calls: String = parts.iter().map(|(_, name)| format!("    pixel = apply_{name}(p, pixel);\n")).collect();
    let tail = format!(
        "fn apply_effects(p: vec2<i32>, before: Mixed) -> Mixed {{\n    var pixel = before;\n{calls}    return pixel;\n}}\n"
    );
    (shaders, tail)
}

/// The inputs of a composite.
#[derive(Clone, Copy, Debug)]
pub struct MixInputs<'a> {
    pub camera: &'a Camera,
    pub job: &'a Job<'a>,
    pub upload: &'a CameraUpload,
    pub layer: &'a Layer,
    /// The fraction of the real light that is removed.
    pub shadow_mask: Option<&'a Texture>,
}

/// Records the composite of a piece. Outside the rectangles `changed` of the picture, layer and
/// shadow mask are empty.
pub fn mix(
    recorder: &mut PassRecorder,
    inputs: &MixInputs<'_>,
    piece: &CompositePiece,
    changed: &[Rect],
    parts: &[MixedPart],
) -> Texture {
    let (upload, rect) = (inputs.upload, piece.rect);
    let tiles = dirty_tiles(rect, changed);
    let out = recorder.pool.lend(&recorder.gpu, (rect.width(), rect.height()), upload.texture.format);
    if tiles != [rect] {
        upload.copy(recorder, rect, &out);
    }
    composite(recorder, inputs, piece, &tiles, parts, CompositeTarget::Codes(&out));
    out
}

/// Rectangles of the picture as corners in a texture whose origin is at `origin`.
pub fn corners_in(rects: &[Rect], origin: Rect) -> Vec<[i32; 4]> {
    let corners = |part: &Rect| [part.x0 - origin.x0, part.y0 - origin.y0, part.x1 - origin.x0, part.y1 - origin.y0];
    rects.iter().map(corners).collect()
}

/// Textures of a composite, of the piece's size.
#[derive(Clone, Copy, Debug)]
pub enum CompositeTarget<'a> {
    /// Codes, over those of the camera.
    Codes(&'a Texture),
    /// The picture before it is coded.
    Uncoded(&'a Texture),
    /// The picture before it is coded, cleared outside the rectangles, with the factor on the
    /// amplitude of its noise.
    UncodedWithFactor(UncodedPicture<'a>),
}

/// Records the composite of rectangles of a piece.
pub fn composite(
    recorder: &mut PassRecorder,
    inputs: &MixInputs<'_>,
    piece: &CompositePiece,
    tiles: &[Rect],
    parts: &[MixedPart],
    target: CompositeTarget<'_>,
) {
    if tiles.is_empty() {
        return;
    }
    let MixInputs { camera, job, upload, layer, shadow_mask } = *inputs;
    let (CompositePiece { rect, drawn, shadowed }, capture) = (*piece, &job.capture);
    let size = (rect.width(), rect.height());
    let uniform = CompositeUniform {
        in_picture: [rect.x0, rect.y0],
        in_camera: [rect.x0 - upload.rect.x0, rect.y0 - upload.rect.y0],
        in_layer: [rect.x0 - drawn.x0, rect.y0 - drawn.y0],
        in_shadow_mask: [rect.x0 - shadowed.x0, rect.y0 - shadowed.y0],
        camera_size: [upload.rect.width() as i32, upload.rect.height() as i32],
        layer_size: [drawn.width() as i32, drawn.height() as i32],
        shadow_mask_size: [shadowed.width() as i32, shadowed.height() as i32],
        made_size: [size.0 as i32, size.1 as i32],
        max_code: upload.max_code,
        gain: photographic_gain(capture.over_ev) as f32,
        noise_left: capture.noise_left as f32,
        gamma: camera.response.gamma as f32,
        opacity: job.frame.opacity as f32,
    };
    let sigma = recorder.memoized(SigmaKey(camera.noise.clone()), sigma_table);
    let samples = response_samples(recorder, &camera.response);
    let quads = corners_in(tiles, rect);
    let list = recorder.storage(bytemuck::cast_slice(&quads));
    let entry = match target {
        CompositeTarget::Codes(_) => "main",
        CompositeTarget::Uncoded(_) => "uncoded",
        CompositeTarget::UncodedWithFactor(_) => "uncoded_with_factor",
    };
    let entry = ShaderEntry::with_vertex("part", entry)
        .choose("curve", curve_choice(&camera.response))
        .choose("whole", capture.whole)
        .choose("parted", layer.coverage.is_some())
        .choose("light_alone", layer.light_alone)
        .choose("shadowed", shadow_mask.is_some())
        .choose("fringed", layer.fringe.is_some());
    let named: Vec<_> = parts.iter().map(|part| (part.shader, part.name)).collect();
    let (shaders, tail) = mixed_module(&named, layer.real.is_some());
    let mut pass = recorder
        .pass_of(&shaders, || tail, entry)
        .uniform("composite", &uniform)
        .buffer("sigma_table", sigma)
        .buffer("response_samples", samples)
        .buffer("parts", list)
        .texture("camera", &upload.texture)
        .texture("layer", &layer.color)
        .texture("coverage", layer.coverage.as_ref().unwrap_or(&layer.color))
        .texture("shadow_mask", shadow_mask.unwrap_or(&layer.color))
        .texture("fringes", layer.fringe.as_ref().unwrap_or(&layer.color));
    for part in parts {
        pass = pass.packed(part.name, &part.uniform);
        for (name, texture) in &part.textures {
            pass = pass.texture(name, texture);
        }
    }
    if let Some(real) = &layer.real {
        pass = pass.texture("real_light", &real.light);
    }
    let pass = pass.tiles(quads.len() as u32);
    match target {
        CompositeTarget::Codes(out) | CompositeTarget::Uncoded(out) => pass.load_targets().draw_into(&[out], size),
        CompositeTarget::UncodedWithFactor(UncodedPicture { codes, amplitude_factor }) => {
            pass.draw_into(&[codes, amplitude_factor], size);
        }
    }
}
