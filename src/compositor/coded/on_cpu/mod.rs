//! The coding of composited pixels, with their noise by example, on the processor: the same as the
//! passes of coded.rs and example_noise.rs, for software adapters. These read texels and storage
//! buffers so slowly that the passes take several times as long there.

mod blocks;
mod coding_pass;
mod content;
mod decode;
mod lanes;
mod noise;
mod pixels;
#[cfg(test)]
mod tests;

use std::ops::Range;

use fearless_simd::{Level, dispatch};

use self::blocks::BlockCoding;
use self::coding_pass::CodingPass;
use self::content::ContentPlanes;
use self::decode::{DecodePass, RowDecoder};
use self::noise::NoiseSynthesis;
use self::pixels::LatentLookup;
use super::CodingUniform;
use crate::coding::PictureCoding;
use crate::compositor::dirty_tiles::TILE_PX;
use crate::effects::ExampleNoise;
use crate::parallel::{over_items, processors};

// Within `dispatch!` runs are visited by loops: the closure of a `for_each` would not be compiled
// for the processor's vector instructions.

/// Rows and columns of a tile.
const TILE: usize = TILE_PX as usize;

/// R'G'B' codes that are not clipped, and the changed share.
pub type UncodedTexel = [f32; 4];

/// A region within a coded picture.
#[derive(Clone, Copy, Debug)]
pub struct RegionPlace {
    /// Px.
    pub size: [usize; 2],
    /// The coded picture with its padding, in the region's coordinates: x0, y0, x1, y1.
    pub extent: [i32; 4],
}

impl RegionPlace {
    /// The part of the coded picture in the region, by axis. Its rim repeats beyond it.
    fn bounds(&self) -> [Range<usize>; 2] {
        [0, 1].map(|axis| {
            let end = (self.extent[2 + axis].max(1) as usize).min(self.size[axis]);
            (self.extent[axis].max(0) as usize).min(end - 1)..end
        })
    }

    /// Clears the values of a row on the border of the coded picture and beyond it.
    fn clear_border(&self, row: &mut [f32], run: &Range<usize>, y: usize) {
        let [x0, y0, x1, y1] = self.extent;
        if y as i32 <= y0 || y as i32 >= y1 - 1 {
            row.fill(0.0);
            return;
        }
        let column = |x: i32| (x - run.start as i32).clamp(0, run.len() as i32) as usize;
        row[..column(x0 + 1)].fill(0.0);
        row[column(x1 - 1)..].fill(0.0);
    }
}

/// A region of a picture that is coded anew on the processor.
#[derive(Clone, Debug)]
pub struct CpuCoding {
    coding: PictureCoding,
    uniform: CodingUniform,
    place: RegionPlace,
    /// Runs of tiles of each row of tiles.
    rows: Vec<Vec<Range<usize>>>,
    noise: Option<ExampleNoise>,
}

/// Texels of a region, row by row.
#[derive(Clone, Copy, Debug)]
pub struct UncodedTexels<'a> {
    pub codes: &'a [UncodedTexel],
    /// Factors on the amplitude of noise; read only if there is noise.
    pub amplitude_factors: &'a [f32],
}

/// Decoded samples and noise of a region's planes.
#[derive(Debug)]
struct CodedPlanes {
    samples: [Vec<u8>; 3],
    noise: [Vec<f32>; 3],
}

/// The part of [`CodedPlanes`] in a row of tiles.
#[derive(Debug)]
struct CodedRows<'a> {
    samples: [&'a mut [u8]; 3],
    noise: [&'a mut [f32]; 3],
}

impl CpuCoding {
    /// `tiles` are runs of tiles in the region: x0, y0, x1, y1.
    pub fn new(
        coding: &PictureCoding,
        uniform: CodingUniform,
        place: RegionPlace,
        tiles: &[[i32; 4]],
        noise: Option<&ExampleNoise>,
    ) -> Self {
        let mut rows = vec![Vec::new(); place.size[1] / TILE];
        for [x0, y0, x1, _] in tiles {
            if let Some(row) = rows.get_mut(*y0 as usize / TILE) {
                row.push(*x0 as usize..*x1 as usize);
            }
        }
        Self { coding: coding.clone(), uniform, place, rows, noise: noise.cloned() }
    }

    /// Whether texels have amplitude factors.
    pub fn has_noise(&self) -> bool {
        self.noise.is_some()
    }

    /// Size of the region, px.
    pub fn size(&self) -> [usize; 2] {
        self.place.size
    }

    /// R'G'B' codes of the region, row by row; the fourth is 255 where pixels change, otherwise 0.
    pub fn code(&self, texels: &UncodedTexels<'_>) -> Vec<[u8; 4]> {
        let noise = self.noise.as_ref().map(|noise| {
            let content = self.content(texels);
            (NoiseSynthesis::new(noise, self.place, content), LatentLookup::new(&noise.model.numbers.latent))
        });
        let planes = self.coded_planes(texels, noise.as_ref());
        self.decoded(texels, noise.as_ref().map(|(_, latent)| latent), &planes)
    }

    fn content(&self, texels: &UncodedTexels<'_>) -> ContentPlanes {
        let level = Level::new();
        let mut content = ContentPlanes::new(self.place.size);
        self.over_tile_rows(content.tile_rows(), |row, runs, mut rows| {
            dispatch!(level, _ => for run in runs {
                rows.fill(texels.codes, &self.place, run, TILE * row);
            });
        });
        content
    }

    fn coded_planes(
        &self,
        texels: &UncodedTexels<'_>,
        noise: Option<&(NoiseSynthesis<'_>, LatentLookup)>,
    ) -> CodedPlanes {
        let level = Level::new();
        let mut planes = self.planes();
        let components = self.components();
        self.over_tile_rows(self.coded_rows(&mut planes), |row, runs, mut rows| {
            let pass = CodingPass { region: self, texels, noise, components: &components };
            dispatch!(level, _ => for run in runs {
                pass.run(run, TILE * row, &mut rows);
            });
        });
        planes
    }

    fn decoded(&self, texels: &UncodedTexels<'_>, latent: Option<&LatentLookup>, planes: &CodedPlanes) -> Vec<[u8; 4]> {
        let level = Level::new();
        let mut codes = vec![[0; 4]; self.place.size[0] * self.place.size[1]];
        let decoding = RowDecoder::new(&self.coding, self.uniform);
        let rows = codes.chunks_mut(TILE * self.place.size[0]);
        self.over_tile_rows(rows, |row, runs, rows| {
            let pass = DecodePass { region: self, texels, latent, planes, decoding: &decoding };
            dispatch!(level, _ => for run in runs {
                pass.run(run, TILE * row, rows);
            });
        });
        codes
    }

    /// Calls `work` for each row of tiles that has any, on all processors.
    fn over_tile_rows<T: Send>(&self, rows: impl Iterator<Item = T>, work: impl Fn(usize, &[Range<usize>], T) + Sync) {
        let rows: Vec<_> = rows.zip(&self.rows).enumerate().filter(|(_, (_, runs))| !runs.is_empty()).collect();
        over_items(rows, processors(), |(row, (part, runs))| work(row, runs, part));
    }

    fn factor(&self) -> [usize; 2] {
        self.uniform.factor.map(|factor| factor as usize)
    }

    fn planes(&self) -> CodedPlanes {
        let [width, height] = self.place.size;
        let [across, down] = self.factor();
        let lengths = [width * height, width / across * (height / down), width / across * (height / down)];
        let noise = |length: usize| if self.has_noise() { length } else { 0 };
        CodedPlanes {
            samples: lengths.map(|length| vec![0; length]),
            noise: lengths.map(|length| vec![0.0; noise(length)]),
        }
    }

    fn coded_rows<'a>(&self, planes: &'a mut CodedPlanes) -> impl Iterator<Item = CodedRows<'a>> + use<'a> {
        let [across, down] = self.factor();
        let width = self.place.size[0];
        let lengths = [TILE * width, TILE / down * (width / across), TILE / down * (width / across)];
        let mut samples = planes.samples.each_mut().map(|plane| &mut plane[..]);
        let mut noise = planes.noise.each_mut().map(|plane| &mut plane[..]);
        let count = self.place.size[1] / TILE;
        (0..count).map(move |_| CodedRows {
            samples: std::array::from_fn(|i| split(&mut samples[i], lengths[i])),
            noise: std::array::from_fn(|i| split(&mut noise[i], lengths[i])),
        })
    }

    /// Arithmetic of the blocks of Y', Cb and Cr; `None` without quantisation.
    fn components(&self) -> Option<[BlockCoding; 3]> {
        let quantization = self.coding.quantization.as_ref()?;
        Some(quantization.steps.each_ref().map(|steps| BlockCoding::new(steps, self.coding.decoder)))
    }
}

/// Splits off the first values; all of a shorter list.
fn split<'a, T>(values: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let all = std::mem::take(values);
    let (first, rest) = all.split_at_mut(count.min(all.len()));
    *values = rest;
    first
}
