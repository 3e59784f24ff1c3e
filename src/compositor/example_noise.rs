//! Noise by example (example_noise/) over the changed pixels of a region: latent content, and the
//! noise of the planes Y', Cb and Cr, which are added before the coding's quantisation.
//!
//! On a software adapter the processor computes it instead (coded/on_cpu/).
//!
//! The passes are the steps of example_noise/mod.rs, over the tiles that are coded anew. The
//! result at a pixel depends on the picture within 12 px, and on the changed pixels of its cells.

use crate::effects::ExampleNoise;
use crate::example_noise::atlas::{CELL_PX, CLASSES, OVERLAP_PX};
use crate::example_noise::bands::{ALL_BANDS, BANDS, FIRST_BAND};
use crate::example_noise::content::FEATURES;
use crate::example_noise::descriptor::DESCRIPTORS;
use crate::example_noise::latent::NODES;
use crate::example_noise::persistence::{FrameKeys, MAX_PERSISTENCE_FRAMES};
use crate::example_noise::{ModelNumbers, NoiseModel};
use crate::gpu::{Gpu, PassRecorder, Shader, ShaderEntry, Texture};
use crate::memo::ByAddress;

/// Distance to which the noise of a pixel reads the content, px: 10 for its features, and the
/// pixels of its chroma sample.
pub const CONTENT_REACH_PX: i32 = 12;
const BLOCK_PX: i32 = 2;

const ENERGIES: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;
const BLOCKS: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
const ACTIVITY: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;
const LATENT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const STANDARDISED: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
const LUMA_NOISE: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
const CHROMA_NOISE: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

crate::uniform! {
    struct ExampleUniform {
        extent: [i32; 4],
        first_cell: [i32; 2],
        cells: [i32; 2],
        region: [i32; 2],
        factor: [i32; 2],
        keys: [[u32; 4]; MAX_PERSISTENCE_FRAMES],
        key_count: u32,
        kept_below: u32,
        unused: [u32; 2],
        classes: [[u32; 4]; 2],
        latent: [[f32; 4]; NODES.len()],
        features: [[f32; 4]; 8],
        gains: [[f32; 4]; 2 * ALL_BANDS],
        descriptors: [[f32; 4]; 8],
    }
}

/// Noise of a region's planes, and its content.
#[derive(Debug)]
pub struct NoisePlanes {
    /// R'G'B' of the content, latent where pixels change; alpha is the changed share.
    pub latent: Texture,
    /// Noise of Y', code values.
    pub luma: Texture,
    /// Noise of Cb and Cr, code values.
    pub chroma: Texture,
}

/// The picture before it is coded.
#[derive(Clone, Copy, Debug)]
pub struct UncodedPicture<'a> {
    /// R'G'B' codes that are not clipped; alpha is the changed share, 0 outside the tiles.
    pub codes: &'a Texture,
    /// Factor on the noise's amplitude.
    pub amplitude_factor: &'a Texture,
}

/// The region of a picture over which noise is synthesised.
#[derive(Clone, Copy, Debug)]
pub struct NoiseRegion<'a> {
    /// Size, px.
    pub size: (u32, u32),
    /// The coded picture with its padding, in the region's coordinates: x0, y0, x1, y1.
    pub extent: [i32; 4],
    /// Corners of the tiles that are coded, in the region's coordinates.
    pub tiles: &'a [[i32; 4]],
}

impl NoisePlanes {
    /// Records the passes over tiles of the picture.
    pub fn record(
        recorder: &mut PassRecorder,
        noise: &ExampleNoise,
        region: &NoiseRegion<'_>,
        picture: &UncodedPicture<'_>,
    ) -> Self {
        let atlas = recorder.memoized_large(noise.model.clone(), GpuAtlas::new);
        let uniform = ExampleUniform::new(noise, region, &atlas);
        let example = recorder.uniform(bytemuck::bytes_of(&uniform));
        let (size, [across, down]) = (region.size, uniform.factor);
        let blocks_size = (size.0 / BLOCK_PX as u32, size.1 / BLOCK_PX as u32);
        let parts = recorder.storage(bytemuck::cast_slice(region.tiles));
        let count = region.tiles.len() as u32;
        let lend = |recorder: &mut PassRecorder, size, format| recorder.pool.lend(&recorder.gpu, size, format);

        let sources = sources_buffer(recorder, uniform.cells);
        recorder
            .pass(Shader::NoiseSources, "main")
            .buffer("example", example.clone())
            .texture("uncoded", picture.codes)
            .buffer("candidates", &atlas.candidates)
            .buffer("sources", &sources)
            .dispatch((uniform.cells[0] as u32, uniform.cells[1] as u32));

        let [latent, energies] = [LATENT, ENERGIES].map(|format| lend(recorder, size, format));
        let of_blocks = |recorder: &mut PassRecorder, format| lend(recorder, blocks_size, format);
        let [means, smoothed] = [BLOCKS; 2].map(|format| of_blocks(recorder, format));
        let activity = of_blocks(recorder, ACTIVITY);
        let mut of_content = |entry, energies: Option<&Texture>, targets: &[&Texture], size| {
            recorder
                .pass(Shader::NoiseContent, ShaderEntry::with_vertex("part", entry))
                .buffer("example", example.clone())
                .texture("uncoded", picture.codes)
                .texture("energies", energies.unwrap_or(picture.codes))
                .buffer("parts", parts.clone())
                .tiles(count)
                .load_targets()
                .draw_into(targets, size);
        };
        of_content("content", None, &[&latent, &energies], size);
        of_content("blocks", Some(&energies), &[&means], blocks_size);
        of_content("smoothed", Some(&means), &[&smoothed], blocks_size);
        of_content("activity", Some(&smoothed), &[&activity], blocks_size);

        let luma = lend(recorder, size, LUMA_NOISE);
        let [low, high] = [STANDARDISED; 2].map(|format| lend(recorder, size, format));
        recorder
            .pass(Shader::NoisePlanes, ShaderEntry::with_vertex("part", "luma"))
            .buffer("example", example.clone())
            .texture("uncoded", picture.codes)
            .texture("amplitude_factor", picture.amplitude_factor)
            .texture("activity", &activity)
            .texture("energies", &energies)
            .buffer("parts", parts.clone())
            .buffer("sources", &sources)
            .buffer("atlas_luma", &atlas.luma)
            .tiles(count)
            .load_targets()
            .draw_into(&[&luma, &low, &high], size);
        let chroma_size = (size.0 / across as u32, size.1 / down as u32);
        let chroma = lend(recorder, chroma_size, CHROMA_NOISE);
        recorder
            .pass(Shader::NoisePlanes, ShaderEntry::with_vertex("part", "chroma"))
            .buffer("example", example)
            .texture("amplitude_factor", picture.amplitude_factor)
            .texture("features_low", &low)
            .texture("features_high", &high)
            .buffer("parts", parts)
            .buffer("sources", &sources)
            .buffer("atlas_chroma", &atlas.chroma)
            .tiles(count)
            .load_targets()
            .draw_into(&[&chroma], chroma_size);
        Self { latent, luma, chroma }
    }
}

/// Size of a buffer of cells' sources, bytes.
#[derive(Clone, Debug, PartialEq)]
struct SourcesKey(u64);

/// Frames run one after another on the GPU, so they share a buffer.
fn sources_buffer(recorder: &mut PassRecorder, [columns, rows]: [i32; 2]) -> wgpu::Buffer {
    let bytes = (columns as u64 * rows as u64 * size_of::<[u32; 4]>() as u64).next_power_of_two();
    recorder.memoized(SourcesKey(bytes), |gpu, SourcesKey(size)| {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("sources of the noise's cells"),
            size: *size,
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        })
    })
}

/// A model's atlas on the GPU.
#[derive(Clone, Debug)]
struct GpuAtlas {
    /// Six half floats for each px.
    luma: wgpu::Buffer,
    /// Eight half floats for each chroma sample.
    chroma: wgpu::Buffer,
    candidates: wgpu::Buffer,
    /// First candidate of each class, and their numbers.
    classes: [[u32; CLASSES]; 2],
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct GpuCandidate {
    luma: u32,
    chroma: u32,
    stride: u32,
    descriptor: [f32; DESCRIPTORS],
}

impl GpuAtlas {
    fn new(gpu: &Gpu, model: &ByAddress<NoiseModel>) -> Self {
        let factor = model.numbers.chroma_factor();
        let (mut luma, mut chroma): (Vec<u16>, Vec<u16>) = Default::default();
        // First px and chroma sample, and width, of each frame.
        let mut frames = Vec::new();
        for frame in &model.frames {
            frames.push((luma.len() / BANDS[0], chroma.len() / (BANDS[1] + BANDS[2]), frame.bands[0].width));
            let (of_luma, of_chroma) = frame.bands.split_at(FIRST_BAND[1]);
            for (out, bands) in [(&mut luma, of_luma), (&mut chroma, of_chroma)] {
                let halves = |i: usize| bands.iter().map(move |band| half::f16::from_f32(band.values[i]).to_bits());
                out.extend((0..bands[0].values.len()).flat_map(halves));
            }
        }
        let mut classes = [[0; CLASSES]; 2];
        let mut candidates = Vec::new();
        for (class, tiles) in model.candidates.iter().enumerate() {
            classes[0][class] = candidates.len() as u32;
            classes[1][class] = tiles.len() as u32;
            candidates.extend(tiles.iter().map(|tile| {
                let (first_luma, first_chroma, width) = frames[tile.frame as usize];
                let [x, y] = tile.at.map(|v| v as usize);
                let chroma = first_chroma + (y / factor[1]) * (width / factor[0]) + x / factor[0];
                GpuCandidate {
                    luma: (first_luma + y * width + x) as u32,
                    chroma: chroma as u32,
                    stride: width as u32,
                    descriptor: tile.descriptor,
                }
            }));
        }
        let buffer = |label, bytes: &[u8]| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        Self {
            luma: buffer("atlas of Y'", bytemuck::cast_slice(&luma)),
            chroma: buffer("atlas of Cb and Cr", bytemuck::cast_slice(&chroma)),
            candidates: buffer("candidates of the atlas", bytemuck::cast_slice(&candidates)),
            classes,
        }
    }
}

/// Four lists of at most eight numbers, each padded with 0 to two vectors.
fn padded_to_vectors<const N: usize>(lists: [[f32; N]; 4]) -> [[f32; 4]; 8] {
    std::array::from_fn(|i| std::array::from_fn(|k| lists[i / 2].get(4 * (i % 2) + k).copied().unwrap_or(0.0)))
}

/// Keys of frames as vectors; the rest is 0.
fn padded_keys(keys: &FrameKeys) -> [[u32; 4]; MAX_PERSISTENCE_FRAMES] {
    std::array::from_fn(|age| keys.keys().get(age).map_or([0; 4], |[x, y, z]| [*x, *y, *z, 0]))
}

impl ExampleUniform {
    fn new(noise: &ExampleNoise, region: &NoiseRegion<'_>, atlas: &GpuAtlas) -> Self {
        let numbers = &noise.model.numbers;
        let ModelNumbers { scale, gains, latent, .. } = numbers;
        let extent = region.extent;
        let in_cells = |px: i32| (px + OVERLAP_PX as i32) / CELL_PX as i32;
        let axes = [0, 1];
        let size = [region.size.0 as i32, region.size.1 as i32];
        let first_cell = axes.map(|axis| (in_cells((-extent[axis]).max(0)) - 1).max(0));
        let end = axes.map(|axis| size[axis].min(extent[2 + axis]) - extent[axis]);
        let inverse: [f32; FEATURES] = scale.deviation.map(|deviation| 1.0 / deviation);
        let descriptors = &noise.model.descriptor_scale;
        Self {
            extent,
            first_cell,
            cells: axes.map(|axis| in_cells(end[axis] - 1) + 1 - first_cell[axis]),
            region: size,
            factor: numbers.chroma_factor().map(|factor| factor as i32),
            keys: padded_keys(&noise.keys),
            key_count: noise.keys.keys().len() as u32,
            kept_below: noise.keys.kept_below(),
            unused: [0; 2],
            classes: atlas.classes,
            latent: std::array::from_fn(|i| {
                let [r, g, b] = latent.values.map(|values| values[i]);
                [r, g, b, NODES[i]]
            }),
            features: padded_to_vectors([scale.low, scale.high, scale.mean, inverse]),
            gains: std::array::from_fn(|i| std::array::from_fn(|k| gains[i / 2][4 * (i % 2) + k])),
            descriptors: padded_to_vectors([
                descriptors.low,
                descriptors.high,
                descriptors.mean,
                descriptors.inverse_deviation,
            ]),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::coded::CodedRegion;
    use super::super::dirty_tiles::tiles_on_grid;
    use super::super::mix::corners_in;
    use super::*;
    use crate::coding::{BlockQuantization, ChromaSampling, Decoder, PictureCoding, YcbcrColor};
    use crate::example_noise::path::Planes;
    use crate::example_noise::synthesis::NoiseContent;
    use crate::example_noise::tests::model;
    use crate::gpu::{Readback, ReadbackSet};
    use crate::grey_image::GreyImage;
    use crate::pixels::Rect;

    /// Several of the cells keep the noise of earlier frames.
    fn resting_keys() -> FrameKeys {
        FrameKeys::new(0.6, 9, |before| [3, 500 - before as u32, 77])
    }

    const PICTURE: [usize; 2] = [235, 150];
    /// The changed pixels.
    const CHANGED: Rect = Rect { x0: 70, y0: 20, x1: 235, y1: 131 };

    fn coding(factor: [u32; 2], origin: Option<[i32; 2]>) -> PictureCoding {
        PictureCoding {
            color: YcbcrColor::JFIF,
            chroma: Some(ChromaSampling::centered(factor)),
            quantization: origin.map(|origin| BlockQuantization { steps: [[8; 64]; 3], origin }),
            decoder: Decoder::Libjpeg,
        }
    }

    /// Red, green and blue at a place: a dark, a bright and a coloured part with stripes, partly
    /// beyond the codes.
    fn content(x: i32, y: i32) -> [f32; 3] {
        let stripe = if (x / 3 + y / 5) % 7 == 0 { 40.0 } else { 0.0 };
        let base = -10.0 + 1.2 * x as f32 + 0.3 * y as f32;
        [base + stripe, base, 0.5 * base + 60.0]
    }

    /// Share and factor.
    fn weights(x: i32, y: i32) -> [f32; 2] {
        if !CHANGED.contains(x, y) {
            return [0.0, 0.0];
        }
        [if x % 11 == 0 { 0.5 } else { 1.0 }, if x % 13 == 0 { 0.25 } else { 1.0 }]
    }

    fn floats(recorder: &mut PassRecorder, texture: &Texture, size: (u32, u32)) -> Vec<f32> {
        let mut set = ReadbackSet::default();
        let mut readback: Readback = recorder.read_back(&mut set, texture, size);
        readback.submitted(recorder.submit());
        let mut values = Vec::new();
        let rows = readback.rows(&recorder.gpu, |_, row| {
            values.extend(row.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
        });
        rows.expect("read back");
        values
    }

    #[test]
    fn noise_of_the_shaders_equals_that_of_the_cpu() {
        let mut recorder = PassRecorder::new(Gpu::open().expect("an adapter"));
        for (factor, origin) in [([2, 2], Some([-8, -3])), ([2, 1], Some([0, 0])), ([1, 1], None)] {
            let coding = coding(factor, origin);
            let model = ByAddress(Arc::new(model(factor)));
            let picture = Rect::full(PICTURE[0] as u32, PICTURE[1] as u32);
            let region = CodedRegion::new(&coding, CHANGED, picture, CONTENT_REACH_PX);
            let origin = coding.quantization.as_ref().map_or([0, 0], |quantization| quantization.origin);
            let tiles = tiles_on_grid(region.rect, origin, &[CHANGED.grown(CONTENT_REACH_PX)]);
            let size = (region.rect.width(), region.rect.height());
            let place = |i: u32| ((i % size.0) as i32 + region.rect.x0, (i / size.0) as i32 + region.rect.y0);
            let inside = |(x, y): (i32, i32)| (x.clamp(0, PICTURE[0] as i32 - 1), y.clamp(0, PICTURE[1] as i32 - 1));
            let texels: Vec<[f32; 4]> = (0..size.0 * size.1)
                .map(|i| {
                    let (x, y) = inside(place(i));
                    let [r, g, b] = content(x, y);
                    [r, g, b, weights(x, y)[0]]
                })
                .collect();
            let factors: Vec<f32> = (0..size.0 * size.1)
                .map(|i| {
                    let (x, y) = inside(place(i));
                    weights(x, y)[1]
                })
                .collect();
            let gpu = recorder.gpu.clone();
            let codes = recorder.pool.lend_to_write(&gpu, size, LATENT);
            codes.write(&gpu, size.0, size.1, &texels);
            let amplitude_factor = recorder.pool.lend_to_write(&gpu, size, LUMA_NOISE);
            amplitude_factor.write(&gpu, size.0, size.1, &factors);
            let corners = corners_in(&tiles, region.rect);
            let noise_region = NoiseRegion { size, extent: region.extent(), tiles: &corners };
            let noise = ExampleNoise { model: model.clone(), keys: resting_keys() };
            let uncoded = UncodedPicture { codes: &codes, amplitude_factor: &amplitude_factor };
            let planes = NoisePlanes::record(&mut recorder, &noise, &noise_region, &uncoded);
            let luma = floats(&mut recorder, &planes.luma, size);
            let chroma_size = (size.0 / factor[0], size.1 / factor[1]);
            let chroma = floats(&mut recorder, &planes.chroma, chroma_size);
            let latent = floats(&mut recorder, &planes.latent, size);

            // The whole coded picture.
            let extent = region.extent();
            let [width, height] = [extent[2] - extent[0], extent[3] - extent[1]].map(|side| side as usize);
            let at = |x: usize, y: usize| {
                inside((x as i32 + extent[0] + region.rect.x0, y as i32 + extent[1] + region.rect.y0))
            };
            let plane = |value: &dyn Fn(i32, i32) -> f32| {
                GreyImage::from_fn(width, height, |x, y| {
                    let (x, y) = at(x, y);
                    value(x, y)
                })
            };
            let rgb: Planes = std::array::from_fn(|c| plane(&|x, y| content(x, y)[c].clamp(0.0, 255.0)));
            let (share, factor_plane) = (plane(&|x, y| weights(x, y)[0]), plane(&|x, y| weights(x, y)[1]));
            let cpu = NoiseContent { rgb: &rgb, share: Some(&share), factor: Some(&factor_plane) };
            let expected = model.noise(&cpu, &noise.keys);
            let mut energy = 0.0;
            for (i, actual) in (0..).zip(&luma) {
                let (x, y) = place(i);
                if !CHANGED.contains(x, y) {
                    continue;
                }
                let in_extent = ((y - region.rect.y0 - extent[1]) as usize, (x - region.rect.x0 - extent[0]) as usize);
                let expected_luma = expected[0].values[in_extent.0 * width + in_extent.1];
                energy += expected_luma * expected_luma;
                // Half floats of the atlas, and of the features.
                let tolerance = 0.01 + 0.01 * expected_luma.abs();
                assert!((actual - expected_luma).abs() < tolerance, "({x}, {y}): {actual} {expected_luma}");
                let [across, down] = factor.map(|factor| factor as usize);
                let sample = in_extent.0 / down * (width / across) + in_extent.1 / across;
                let local = ((y - region.rect.y0) as u32 / factor[1] * chroma_size.0
                    + (x - region.rect.x0) as u32 / factor[0]) as usize;
                for plane in 0..2 {
                    let (actual, expected) = (chroma[2 * local + plane], expected[1 + plane].values[sample]);
                    let tolerance = 0.01 + 0.01 * expected.abs();
                    assert!((actual - expected).abs() < tolerance, "chroma ({x}, {y}): {actual} {expected}");
                }
                let share = weights(x, y)[0];
                for (c, code) in content(x, y).into_iter().enumerate() {
                    let table = model.numbers.latent.at(c, code.clamp(0.0, 255.0));
                    let whole = if code > 255.0 { table.max(code) } else { table };
                    let expected = code + share * (whole - code);
                    let value = latent[4 * i as usize + c];
                    assert!((value - expected).abs() < 1e-2, "({x}, {y}): {value} {expected}");
                }
            }
            let changed = (CHANGED.width() * CHANGED.height()) as f32;
            assert!(energy / changed > 1.0, "there is noise: σ² {}", energy / changed);
        }
    }
}
