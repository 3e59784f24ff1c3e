//! Noise, planes and blocks of a run of tiles.

use std::ops::Range;

use super::blocks::BlockCoding;
use super::lanes::rounded_code;
use super::noise::{NoiseScratch, NoiseSynthesis, RowInputs, RunRow};
use super::pixels::{LatentLookup, PixelRow};
use super::{CodedRows, CpuCoding, TILE, UncodedTexel, UncodedTexels};
use crate::coding::{BLOCK, Decoder};

/// Noise, planes and blocks of a run of tiles.
pub struct CodingPass<'a> {
    pub region: &'a CpuCoding,
    pub texels: &'a UncodedTexels<'a>,
    pub noise: Option<&'a (NoiseSynthesis<'a>, LatentLookup)>,
    /// `None` without quantisation.
    pub components: &'a Option<[BlockCoding; 3]>,
}

/// Space of a [`CodingPass`].
struct CodingScratch {
    pixels: PixelRow,
    noise: NoiseScratch,
    /// Samples of Y', Cb and Cr.
    samples: [Vec<f32>; 3],
    /// Cb and Cr of the pixels of up to three rows, from the one before a chroma sample's first;
    /// with a pixel before the run's first.
    chroma: [[Vec<f32>; 2]; 3],
}

impl CodingScratch {
    fn new(length: usize, [across, down]: [usize; 2]) -> Self {
        let chroma = TILE / down * (length / across);
        Self {
            pixels: PixelRow::new(length),
            noise: NoiseScratch::new(length),
            samples: [TILE * length, chroma, chroma].map(|count| vec![0.0; count]),
            chroma: [0; 3].map(|_| [0; 2].map(|_| vec![0.0; length + 1])),
        }
    }
}

impl CodingPass<'_> {
    /// Fills in the run's samples and noise. `top` is the first row of the tiles.
    #[inline(always)]
    pub fn run(&self, run: &Range<usize>, top: usize, rows: &mut CodedRows<'_>) {
        let [_, down] = self.region.factor();
        let mut scratch = CodingScratch::new(run.len(), self.region.factor());
        let activity = self.noise.map(|(noise, _)| noise.activity(run, top));
        if self.region.uniform.taps_down[0] != 0.0 {
            let before = top.saturating_sub(1);
            self.load(&mut scratch, run, before);
            if let Some((_, latent)) = self.noise {
                latent.apply(&mut scratch.pixels);
            }
            self.chroma_of_pixels(&mut scratch, run, before, down);
        }
        for first in (0..TILE).step_by(down) {
            // The row before these.
            scratch.chroma.swap(0, down);
            let noise = self.noise.zip(activity.as_ref());
            if noise.is_some() {
                let factors: [&[f32]; 2] = std::array::from_fn(|k| self.factors(run, top + first + k.min(down - 1)));
                scratch.noise.begin(&factors[..down]);
            }
            for j in first..first + down {
                self.load(&mut scratch, run, top + j);
                if let Some(((noise, latent), activity)) = noise {
                    let width = self.region.place.size[0];
                    let out = &mut rows.noise[0][j * width..][run.clone()];
                    let factors = self.factors(run, top + j);
                    let inputs = RowInputs { activity, pixels: &scratch.pixels, factors };
                    noise.luma_row(&mut scratch.noise, RunRow { run, top, j }, &inputs, out);
                    latent.apply(&mut scratch.pixels);
                }
                self.luma_samples(&mut scratch, run, j, rows);
                self.chroma_of_pixels(&mut scratch, run, top + j, 1 + j - first);
            }
            self.chroma_samples(&mut scratch, RunRow { run, top, j: first }, rows);
        }
        self.code_blocks(&scratch, run, rows);
    }

    fn is_coded(&self) -> bool {
        self.region.coding.decoder != Decoder::Unrounded
    }

    fn texels(&self, run: &Range<usize>, y: usize) -> &[UncodedTexel] {
        &self.texels.codes[y * self.region.place.size[0]..][run.clone()]
    }

    fn factors(&self, run: &Range<usize>, y: usize) -> &[f32] {
        &self.texels.amplitude_factors[y * self.region.place.size[0]..][run.clone()]
    }

    #[inline(always)]
    fn load(&self, scratch: &mut CodingScratch, run: &Range<usize>, y: usize) {
        scratch.pixels.load(self.texels(run, y));
    }

    /// Rounded samples of Y' of the j-th row.
    #[inline(always)]
    fn luma_samples(&self, scratch: &mut CodingScratch, run: &Range<usize>, j: usize, rows: &CodedRows<'_>) {
        if !self.is_coded() {
            return;
        }
        let weights = &self.region.uniform.luma;
        let out = &mut scratch.samples[0][j * run.len()..][..run.len()];
        weighted(&scratch.pixels, weights, out);
        if self.noise.is_some() {
            let noise = &rows.noise[0][j * self.region.place.size[0]..][run.clone()];
            out.iter_mut().zip(noise).for_each(|(sample, noise)| *sample += noise);
        }
        out.iter_mut().for_each(|sample| *sample = rounded_code(*sample));
    }

    /// Cb and Cr of the pixels of row `y`, and of the one before them, into the n-th row.
    #[inline(always)]
    fn chroma_of_pixels(&self, scratch: &mut CodingScratch, run: &Range<usize>, y: usize, n: usize) {
        if !self.is_coded() {
            return;
        }
        let uniform = &self.region.uniform;
        let before = run.start.saturating_sub(1);
        for (plane, weights) in [&uniform.blue, &uniform.red].into_iter().enumerate() {
            let out = &mut scratch.chroma[n][plane];
            weighted(&scratch.pixels, weights, &mut out[1..]);
            if uniform.taps_across[0] != 0.0 {
                let [r, g, b, share] = self.texels(&(before..before + 1), y)[0];
                let mut rgb = [r, g, b];
                if let Some((_, latent)) = self.noise {
                    rgb = std::array::from_fn(|c| rgb[c] + share * (latent.at(c, rgb[c]) - rgb[c]));
                }
                out[0] = weights[0] * rgb[0] + weights[1] * rgb[1] + weights[2] * rgb[2] + weights[3];
            }
        }
    }

    /// Noise and rounded samples of Cb and Cr of the rows of a chroma sample.
    #[inline(always)]
    fn chroma_samples(&self, scratch: &mut CodingScratch, at: RunRow<'_>, rows: &mut CodedRows<'_>) {
        let [across, down] = self.region.factor();
        let columns = at.run.start / across..at.run.end / across;
        let (width, row) = (self.region.place.size[0] / across, at.j / down);
        if let Some((noise, _)) = self.noise {
            let [_, blue, red] = &mut rows.noise;
            let out = [blue, red].map(|plane| &mut plane[row * width..][columns.clone()]);
            noise.chroma_row(&mut scratch.noise, at, out);
        }
        if !self.is_coded() {
            return;
        }
        let uniform = &self.region.uniform;
        let mut sums = vec![0.0f32; at.run.len() + 1];
        for plane in 0..2 {
            sums.fill(0.0);
            for (pixels, tap) in scratch.chroma.iter().zip(uniform.taps_down).filter(|(_, tap)| *tap != 0.0) {
                sums.iter_mut().zip(&pixels[plane]).for_each(|(sum, v)| *sum += tap * v);
            }
            let [before, first, second, _] = uniform.taps_across;
            let out = &mut scratch.samples[1 + plane][row * columns.len()..][..columns.len()];
            if across == 2 {
                for (out, three) in out.iter_mut().zip(sums.windows(3).step_by(2)) {
                    *out = before * three[0] + first * three[1] + second * three[2];
                }
            } else {
                out.iter_mut().zip(&sums[1..]).for_each(|(out, sum)| *out = first * sum);
            }
            if self.noise.is_some() {
                let noise = &rows.noise[1 + plane][row * width..][columns.clone()];
                out.iter_mut().zip(noise).for_each(|(sample, noise)| *sample += noise);
            }
            out.iter_mut().for_each(|sample| *sample = rounded_code(*sample));
        }
    }

    /// Decoded samples of the run's blocks; the rounded samples without quantisation.
    #[inline(always)]
    fn code_blocks(&self, scratch: &CodingScratch, run: &Range<usize>, rows: &mut CodedRows<'_>) {
        if !self.is_coded() {
            return;
        }
        let [across, down] = self.region.factor();
        for (plane, samples) in scratch.samples.iter().enumerate() {
            let [across, down] = if plane == 0 { [1, 1] } else { [across, down] };
            let columns = run.start / across..run.end / across;
            let (length, width) = (columns.len(), self.region.place.size[0] / across);
            let out = &mut rows.samples[plane][..];
            let Some(components) = self.components else {
                for j in 0..TILE / down {
                    let out = &mut out[j * width..][columns.clone()];
                    out.iter_mut().zip(&samples[j * length..]).for_each(|(out, sample)| *out = *sample as u8);
                }
                continue;
            };
            for row in (0..TILE / down).step_by(BLOCK) {
                for column in (0..length).step_by(BLOCK) {
                    let line = |y: usize| -> [f32; BLOCK] {
                        let line = &samples[(row + y) * length + column..][..BLOCK];
                        std::array::from_fn(|x| line[x])
                    };
                    let block = components[plane].code(&std::array::from_fn(line));
                    for (y, line) in block.iter().enumerate() {
                        out[(row + y) * width + columns.start + column..][..BLOCK].copy_from_slice(line);
                    }
                }
            }
        }
    }
}

/// A plane's samples at pixels: weights of R', G' and B', and the sample of black.
#[inline(always)]
fn weighted(pixels: &PixelRow, weights: &[f32; 4], out: &mut [f32]) {
    let [red, green, blue] = &pixels.rgb;
    for (out, ((r, g), b)) in out.iter_mut().zip(red.iter().zip(green).zip(blue)) {
        *out = weights[0] * r + weights[1] * g + weights[2] * b + weights[3];
    }
}
