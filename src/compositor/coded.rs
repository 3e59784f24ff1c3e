//! Takes composited pixels through the coding of the camera's picture: subsampling of chroma,
//! quantisation of 8×8 blocks, and the arithmetic of its decoder (coding/).
//!
//! Blocks that contain changed pixels are coded as a whole. Only the changed pixels are written,
//! and partly real ones only in part: real light has come through the coding already.
//! The result at a pixel depends on the picture within its blocks and those beside them, not on the
//! rectangle that is composited.
//!
//! On a software adapter the uncoded picture is read back and coded on the processor
//! (coded/pending.rs).
//!
//! Not modelled: a change within a block also changes the block's other pixels in a camera. Here
//! those keep their codes.

mod on_cpu;
mod pending;
#[cfg(test)]
mod tests;

pub use pending::{PendingCoding, composite_uncoded};

use super::dirty_tiles::{TILE_PX, tiles_on_grid};
use super::example_noise::{NoisePlanes, NoiseRegion, UncodedPicture};
use super::mix::{CameraUpload, CompositePiece, CompositeTarget, MixInputs, composite, corners_in};
use crate::coding::chroma::ChromaFilter;
use crate::coding::swscale::{Conversion, Phases};
use crate::coding::{BLOCK, ChromaSampling, ColorMatrix, Decoder, PictureCoding};
use crate::effects::{ExampleNoise, MixedPart};
use crate::gpu::{PassRecorder, Shader, ShaderEntry, Texture};
use crate::pixels::Rect;

/// Distance at which a changed pixel depends on others through chroma, px: two samples of bicubic
/// interpolation, and the pixels of the farthest.
pub const CHROMA_REACH_PX: i32 = 6;
/// Blocks for each workgroup of shaders/coding_blocks.wgsl.
const BLOCKS_PER_GROUP: u32 = 8;
/// Number of workgroups along an axis of a dispatch that every adapter allows.
const MAX_GROUPS_IN_ROW: u32 = 65_535;

const UNCODED: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const AMPLITUDE_FACTOR: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
const CHROMA: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

crate::uniform! {
    /// Numbers of a region's coding.
    pub struct CodingUniform {
        luma: [f32; 4],
        blue: [f32; 4],
        red: [f32; 4],
        from_luma: [f32; 4],
        from_blue: [f32; 4],
        from_red: [f32; 4],
        taps_across: [f32; 4],
        taps_down: [f32; 4],
        inside: [i32; 4],
        region: [i32; 2],
        factor: [i32; 2],
        tile_count: u32,
        groups_in_row: u32,
    }
}

crate::uniform! {
    struct PlacementUniform { made_size: [i32; 2], in_region: [i32; 2], in_camera: [i32; 2] }
}

crate::uniform! {
    /// Integers of ffmpeg's scaler.
    pub struct ScalerUniform {
        across: [[i32; 4]; 2],
        down: [[i32; 4]; 2],
        first_across: [i32; 2],
        first_down: [i32; 2],
        chroma: [i32; 4],
        black: i32,
        luma: i32,
    }
}

impl ScalerUniform {
    /// Zeros for other decoders.
    fn new(coding: &PictureCoding) -> Self {
        let Decoder::Swscale { siting } = coding.decoder else { return bytemuck::Zeroable::zeroed() };
        let factor = coding.chroma_factor();
        let (across, down) = (Phases::across(factor[0], siting[0]), Phases::down(factor[1], siting[1]));
        let Conversion { black, luma, red_cr, green_cb, green_cr, blue_cb } = Conversion::new(coding.color);
        Self {
            across: across.weights,
            down: down.weights,
            first_across: across.first,
            first_down: down.first,
            chroma: [red_cr, green_cb, green_cr, blue_cb],
            black,
            luma,
        }
    }
}

/// The region of a picture that is coded anew to change the pixels of `rect`.
#[derive(Clone, Debug)]
pub struct CodedRegion<'a> {
    coding: &'a PictureCoding,
    picture: Rect,
    /// Distance at which a changed pixel depends on others, px.
    reach_px: i32,
    /// Whole tiles on the coding's grid. It may extend beyond the picture.
    pub rect: Rect,
}

impl<'a> CodedRegion<'a> {
    pub fn new(coding: &'a PictureCoding, rect: Rect, picture: Rect, reach_px: i32) -> Self {
        let [x, y] = grid_origin(coding);
        let down = |edge: i32, origin: i32| (edge - origin).div_euclid(TILE_PX) * TILE_PX + origin;
        let up = |edge: i32, origin: i32| down(edge + TILE_PX - 1, origin);
        let needed = rect.grown(reach_px).intersection(&picture);
        let rect = Rect::new(down(needed.x0, x), down(needed.y0, y), up(needed.x1, x), up(needed.y1, y));
        Self { coding, picture, reach_px, rect }
    }

    /// The tiles that are coded if pixels of `changed` change.
    fn tiles(&self, changed: &[Rect]) -> Vec<Rect> {
        let reached: Vec<Rect> = changed.iter().map(|rect| rect.grown(self.reach_px)).collect();
        tiles_on_grid(self.rect, grid_origin(self.coding), &reached)
    }

    /// The pixels that decoders read chroma from, in the region's coordinates. The picture's rim is
    /// repeated beyond them.
    fn inside(&self) -> [i32; 4] {
        let Rect { x0, y0, mut x1, mut y1 } = self.picture;
        if self.coding.decoder == Decoder::ZuneJpeg {
            // It interpolates towards the padding of the last blocks.
            let [unit_x, unit_y] = self.coding.unit_px().map(|px| px as i32);
            (x1, y1) = (x1 + (-x1).rem_euclid(unit_x), y1 + (-y1).rem_euclid(unit_y));
        }
        [x0 - self.rect.x0, y0 - self.rect.y0, x1 - self.rect.x0, y1 - self.rect.y0]
    }

    /// The coded picture with its padding, in the region's coordinates: x0, y0, x1, y1.
    pub fn extent(&self) -> [i32; 4] {
        let extent = self.coding.extent([self.picture.width() as usize, self.picture.height() as usize]);
        let [x, y] = [0, 1].map(|axis| -(extent.before[axis] as i32) - [self.rect.x0, self.rect.y0][axis]);
        [x, y, x + extent.padded[0] as i32, y + extent.padded[1] as i32]
    }

    fn uniform(&self, tile_count: u32, groups_in_row: u32) -> CodingUniform {
        let (rows, black) = self.coding.color.forward();
        let mut rows: [[f32; 4]; 3] =
            std::array::from_fn(|i| [rows[i][0], rows[i][1], rows[i][2], black[i]].map(|value| value as f32));
        if self.coding.chroma.is_none() {
            // A grey camera's picture has no colour.
            rows[1..].iter_mut().for_each(|row| row[..3].fill(0.0));
        }
        let back = self.coding.color.inverse();
        let column = |i: usize| [back[0][i] as f32, back[1][i] as f32, back[2][i] as f32, 0.0];
        let chroma = self.coding.chroma.unwrap_or(ChromaSampling::FULL);
        CodingUniform {
            luma: rows[0],
            blue: rows[1],
            red: rows[2],
            from_luma: column(0),
            from_blue: column(1),
            from_red: column(2),
            taps_across: taps(chroma, 0),
            taps_down: taps(chroma, 1),
            inside: self.inside(),
            region: [self.rect.width() as i32, self.rect.height() as i32],
            factor: chroma.factor.map(|factor| factor as i32),
            tile_count,
            groups_in_row,
        }
    }
}

/// Corner of the grid of tiles, px.
fn grid_origin(coding: &PictureCoding) -> [i32; 2] {
    coding.quantization.as_ref().map_or([0, 0], |quantization| quantization.origin)
}

/// Weights of the pixels of a chroma sample along an axis, from the one before its first.
fn taps(chroma: ChromaSampling, axis: usize) -> [f32; 4] {
    let filter = ChromaFilter::mean(chroma.factor[axis], chroma.siting[axis]);
    let mut taps = [0.0; 4];
    taps[(1 + filter.first) as usize..][..filter.weights.len()].copy_from_slice(&filter.weights);
    taps
}

/// A piece of a picture that is coded.
#[derive(Clone, Copy, Debug)]
pub struct CodedPiece<'a> {
    pub region: &'a CodedRegion<'a>,
    pub piece: &'a CompositePiece,
    /// Outside these rectangles of the picture, layer and shadow mask are empty.
    pub changed: &'a [Rect],
    /// Pieces of the composite in the region.
    pub parts: &'a [MixedPart],
    pub noise: Option<&'a ExampleNoise>,
}

/// A composited region before it is coded.
struct UncodedRegion {
    /// R'G'B' codes that are not clipped, and the changed share.
    codes: Texture,
    /// If there is noise by example.
    amplitude_factor: Option<Texture>,
}

/// Records the composite of a piece's region.
fn composite_region(
    recorder: &mut PassRecorder,
    inputs: &MixInputs<'_>,
    coded: &CodedPiece<'_>,
    tiles: &[Rect],
) -> UncodedRegion {
    let CodedPiece { region, piece, parts, noise, .. } = *coded;
    let size = (region.rect.width(), region.rect.height());
    let codes = recorder.pool.lend(&recorder.gpu, size, UNCODED);
    let amplitude_factor = noise.map(|_| recorder.pool.lend(&recorder.gpu, size, AMPLITUDE_FACTOR));
    let target = match &amplitude_factor {
        Some(amplitude_factor) => {
            CompositeTarget::UncodedWithFactor(UncodedPicture { codes: &codes, amplitude_factor })
        }
        None => CompositeTarget::Uncoded(&codes),
    };
    let piece = CompositePiece { rect: region.rect, ..*piece };
    composite(recorder, inputs, &piece, tiles, parts, target);
    UncodedRegion { codes, amplitude_factor }
}

/// Records the composite of a piece through the coding.
pub fn mix_coded(recorder: &mut PassRecorder, inputs: &MixInputs<'_>, coded: &CodedPiece<'_>) -> Texture {
    let rect = coded.piece.rect;
    let tiles = coded.region.tiles(coded.changed);
    if tiles.is_empty() {
        return camera_copy(recorder, inputs.upload, rect);
    }
    let uncoded = composite_region(recorder, inputs, coded, &tiles);
    code_region(recorder, coded, inputs.upload, &tiles, &uncoded)
}

/// Records a copy of the camera's pixels in a rectangle of the picture.
fn camera_copy(recorder: &mut PassRecorder, upload: &CameraUpload, rect: Rect) -> Texture {
    let copy = recorder.pool.lend(&recorder.gpu, (rect.width(), rect.height()), upload.texture.format);
    upload.copy(recorder, rect, &copy);
    copy
}

/// Records the coding of a region's tiles. The piece has the decoded pixels where they changed, and
/// the camera's elsewhere.
fn code_region(
    recorder: &mut PassRecorder,
    coded: &CodedPiece<'_>,
    upload: &CameraUpload,
    tiles: &[Rect],
    UncodedRegion { codes: uncoded, amplitude_factor }: &UncodedRegion,
) -> Texture {
    let CodedPiece { region, piece: &CompositePiece { rect, .. }, noise, .. } = *coded;
    let out = camera_copy(recorder, upload, rect);
    let planes = noise.zip(amplitude_factor.as_ref()).map(|(noise, amplitude_factor)| {
        let size = (region.rect.width(), region.rect.height());
        let noise_region = NoiseRegion { size, extent: region.extent(), tiles: &corners_in(tiles, region.rect) };
        NoisePlanes::record(recorder, noise, &noise_region, &UncodedPicture { codes: uncoded, amplitude_factor })
    });
    let samples = CodedSamples::new(recorder, region, tiles);
    let is_coded = region.coding.decoder != Decoder::Unrounded;
    if is_coded {
        samples.record(recorder, region.coding, uncoded, planes.as_ref());
    }

    let shown: Vec<Rect> = tiles.iter().map(|tile| tile.intersection(&rect)).filter(|tile| !tile.is_empty()).collect();
    let corners = corners_in(&shown, rect);
    let list = recorder.storage(bytemuck::cast_slice(&corners));
    let placement = PlacementUniform {
        made_size: [rect.width() as i32, rect.height() as i32],
        in_region: [rect.x0 - region.rect.x0, rect.y0 - region.rect.y0],
        in_camera: [rect.x0 - upload.rect.x0, rect.y0 - upload.rect.y0],
    };
    let entry = ShaderEntry::with_vertex("part", "main").choose("decoder", decoder_choice(region.coding));
    let entry = entry.choose("noisy", planes.is_some());
    // Content that is shown without coding is latent, too.
    let shown_content = planes.as_ref().filter(|_| !is_coded).map_or(uncoded, |planes| &planes.latent);
    recorder
        .pass(Shader::CodingDecode, entry)
        .uniform("coding", &samples.uniform)
        .uniform("placement", &placement)
        .uniform("scaler", &ScalerUniform::new(region.coding))
        .texture("uncoded", shown_content)
        .texture("luma_noise", planes.as_ref().map_or(uncoded, |planes| &planes.luma))
        .texture("chroma_noise", planes.as_ref().map_or(uncoded, |planes| &planes.chroma))
        .texture("camera", &upload.texture)
        .buffer("samples", &samples.samples)
        .buffer("parts", list)
        .tiles(corners.len() as u32)
        .load_targets()
        .draw_into(&[&out], (rect.width(), rect.height()));
    out
}

/// The value of the `override` decoder in shaders/coding_decode.wgsl.
fn decoder_choice(coding: &PictureCoding) -> f64 {
    match coding.decoder {
        // The samples are codes.
        _ if coding.color.matrix == ColorMatrix::Rgb => 2.0,
        Decoder::ZuneJpeg => 0.0,
        Decoder::Libjpeg => 1.0,
        Decoder::Nearest => 2.0,
        Decoder::Swscale { .. } => 3.0,
        Decoder::Unrounded => 4.0,
    }
}

/// The coded samples of a region.
struct CodedSamples {
    uniform: CodingUniform,
    /// Runs of tiles, in chroma samples of the region.
    chroma_parts: Vec<[i32; 4]>,
    /// Corners of tiles in the region.
    tiles: Vec<[i32; 2]>,
    groups: (u32, u32),
    /// Decoded samples: planes of Y', Cb and Cr, a byte each.
    samples: wgpu::Buffer,
}

/// Size of a buffer of samples, bytes.
#[derive(Clone, Debug, PartialEq)]
struct SamplesKey(u64);

impl CodedSamples {
    fn new(recorder: &mut PassRecorder, region: &CodedRegion<'_>, tiles: &[Rect]) -> Self {
        let factor = region.coding.chroma_factor().map(|factor| factor as i32);
        let scaled = |[x0, y0, x1, y1]: [i32; 4]| [x0 / factor[0], y0 / factor[1], x1 / factor[0], y1 / factor[1]];
        let chroma_parts = corners_in(tiles, region.rect).into_iter().map(scaled).collect();
        let tiles: Vec<[i32; 2]> = tiles.iter().flat_map(|run| corners_of_tiles(run, region.rect)).collect();
        let (count, chroma_share) = (tiles.len() as u32, (factor[0] * factor[1]) as u32);
        let groups = (count * (4 + 8 / chroma_share)).div_ceil(BLOCKS_PER_GROUP);
        let groups = (groups.min(MAX_GROUPS_IN_ROW), groups.div_ceil(MAX_GROUPS_IN_ROW));
        let luma_bytes = u64::from(region.rect.width()) * u64::from(region.rect.height());
        // Frames run one after another on the GPU, so they share a buffer. Powers of two, because a
        // moving object's region changes its size with each frame.
        let bytes = (luma_bytes + 2 * luma_bytes / u64::from(chroma_share)).next_power_of_two();
        let samples = recorder.memoized(SamplesKey(bytes), |gpu, SamplesKey(size)| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("coded samples"),
                size: *size,
                usage: wgpu::BufferUsages::STORAGE,
                mapped_at_creation: false,
            })
        });
        Self { uniform: region.uniform(count, groups.0), chroma_parts, tiles, groups, samples }
    }

    /// Records the passes that code the uncoded picture.
    fn record(
        &self,
        recorder: &mut PassRecorder,
        coding: &PictureCoding,
        uncoded: &Texture,
        noise: Option<&NoisePlanes>,
    ) {
        let uncoded = noise.map_or(uncoded, |planes| &planes.latent);
        let size = [0, 1].map(|axis| (self.uniform.region[axis] / self.uniform.factor[axis]) as u32);
        let size = (size[0], size[1]);
        let chroma = recorder.pool.lend(&recorder.gpu, size, CHROMA);
        let parts = recorder.storage(bytemuck::cast_slice(&self.chroma_parts));
        recorder
            .pass(Shader::CodingChroma, ShaderEntry::with_vertex("part", "main").choose("noisy", noise.is_some()))
            .uniform("coding", &self.uniform)
            .texture("uncoded", uncoded)
            .texture("chroma_noise", noise.map_or(uncoded, |planes| &planes.chroma))
            .buffer("parts", parts)
            .tiles(self.chroma_parts.len() as u32)
            .load_targets()
            .draw_into(&[&chroma], size);
        let steps: Vec<f32> = match &coding.quantization {
            Some(quantization) => quantization.steps.as_flattened().iter().map(|&step| f32::from(step)).collect(),
            None => vec![1.0; 3 * BLOCK * BLOCK],
        };
        let is_libjpeg = coding.decoder == Decoder::Libjpeg;
        let entry = ShaderEntry::from("main")
            .choose("quantized", coding.quantization.is_some())
            .choose("noisy", noise.is_some())
            .choose("factor_bits", if is_libjpeg { 13.0 } else { 12.0 })
            .choose("negative_half", if is_libjpeg { 0.5 } else { -0.5 })
            .choose("last_bias", if is_libjpeg { 0.0 } else { 512.0 });
        let tiles = recorder.storage(bytemuck::cast_slice(&self.tiles));
        let steps = recorder.storage(bytemuck::cast_slice(&steps));
        recorder
            .pass(Shader::CodingBlocks, entry)
            .uniform("coding", &self.uniform)
            .texture("uncoded", uncoded)
            .texture("luma_noise", noise.map_or(uncoded, |planes| &planes.luma))
            .texture("chroma", &chroma)
            .buffer("tiles", tiles)
            .buffer("quantizers", steps)
            .buffer("samples", &self.samples)
            .dispatch(self.groups);
    }
}

/// Corners of the tiles of a run, in a region.
fn corners_of_tiles(run: &Rect, region: Rect) -> impl Iterator<Item = [i32; 2]> + use<> {
    let (x0, y0) = (run.x0 - region.x0, run.y0 - region.y0);
    (0..run.width() as i32 / TILE_PX).map(move |tile| [x0 + tile * TILE_PX, y0])
}
