//! Coded samples to R'G'B' codes in the arithmetic of the frame's decoder, as
//! shaders/coding_decode.wgsl does.

use std::ops::Range;

use super::super::{CodingUniform, ScalerUniform};
use super::lanes::rounded_code;
use super::pixels::LatentLookup;
use super::{CodedPlanes, CpuCoding, TILE, UncodedTexel, UncodedTexels};
use crate::coding::{ColorMatrix, Decoder, PictureCoding};

/// Arithmetic of a decoder.
#[derive(Clone, Debug)]
pub struct RowDecoder {
    decoder: Decoder,
    uniform: CodingUniform,
    scaler: ScalerUniform,
    factor: [usize; 2],
    /// The columns and rows of chroma samples that are read.
    chroma_columns: [i32; 2],
    chroma_rows: [i32; 2],
}

/// DecodedSamples of Y', Cb and Cr of a region, row by row.
#[derive(Clone, Copy, Debug)]
pub struct DecodedSamples<'a> {
    pub planes: [&'a [u8]; 3],
    /// Luma samples of a row.
    pub width: usize,
}

/// Space for Cb and Cr of a row's pixels.
#[derive(Debug, Default)]
pub struct DecodeScratch {
    between: Vec<i32>,
    chroma: [Vec<i32>; 2],
}

impl RowDecoder {
    pub fn new(coding: &PictureCoding, uniform: CodingUniform) -> Self {
        // The samples of an R'G'B' file are codes.
        let is_rgb = coding.color.matrix == ColorMatrix::Rgb;
        let decoder = if is_rgb { Decoder::Nearest } else { coding.decoder };
        let inside = |axis: usize| {
            let factor = uniform.factor[axis];
            let last = (uniform.inside[2 + axis] - 1) / factor;
            let low = (uniform.inside[axis] / factor).max(0);
            [low, last.min(uniform.region[axis] / factor - 1).max(low)]
        };
        Self {
            decoder,
            uniform,
            scaler: ScalerUniform::new(coding),
            factor: uniform.factor.map(|factor| factor as usize),
            chroma_columns: inside(0),
            chroma_rows: inside(1),
        }
    }

    /// Codes of a row's pixels, not all of them within 0 to 255.
    #[inline(always)]
    pub fn row(
        &self,
        samples: &DecodedSamples<'_>,
        columns: &Range<usize>,
        y: usize,
        scratch: &mut DecodeScratch,
        out: &mut [[i32; 3]],
    ) {
        let DecodeScratch { between, chroma } = scratch;
        for (plane, chroma) in chroma.iter_mut().enumerate() {
            chroma.clear();
            chroma.resize(columns.len(), 0);
            let plane = &samples.planes[1 + plane];
            let width = samples.width / self.factor[0];
            let row =
                |row: i32| &plane[row.clamp(self.chroma_rows[0], self.chroma_rows[1]) as usize * width..][..width];
            if matches!(self.decoder, Decoder::Swscale { .. }) {
                self.scaled(row, columns, y, between, chroma);
            } else {
                self.upsampled(row, columns, y, between, chroma);
            }
        }
        let luma = &samples.planes[0][y * samples.width..][columns.clone()];
        let pixels = luma.iter().zip(chroma[0].iter().zip(&chroma[1]));
        for (out, (y, (cb, cr))) in out.iter_mut().zip(pixels) {
            *out = self.rgb(i32::from(*y), [*cb, *cr]);
        }
    }

    /// Cb or Cr at a row's pixels. Interpolating decoders weigh the sample of the pixel 3 to 1
    /// against the nearest other along each axis.
    #[inline(always)]
    fn upsampled<'a>(
        &self,
        row: impl Fn(i32) -> &'a [u8],
        columns: &Range<usize>,
        y: usize,
        between: &mut Vec<i32>,
        out: &mut [i32],
    ) {
        let [across, down] = self.factor;
        let is_libjpeg = self.decoder == Decoder::Libjpeg;
        let own = (y / down) as i32;
        let is_second = !y.is_multiple_of(down);
        // DecodedSamples from the one before the first pixel's on.
        let first = (columns.start / across) as i32 - 1;
        let count = (columns.end - 1) / across - columns.start / across + 3;
        let [low, high] = self.chroma_columns;
        between.clear();
        let sample = |line: &[u8], k: usize| i32::from(line[(first + k as i32).clamp(low, high) as usize]);
        if down == 1 || self.decoder == Decoder::Nearest {
            let line = row(own);
            between.extend((0..count).map(|k| sample(line, k)));
        } else {
            let [near, far] = [row(own), row(if is_second { own + 1 } else { own - 1 })];
            let sums = (0..count).map(|k| 3 * sample(near, k) + sample(far, k));
            match (across, is_libjpeg) {
                (2, true) => between.extend(sums),
                (_, true) => {
                    let rounding = if is_second { 2 } else { 1 };
                    between.extend(sums.map(|sum| (sum + rounding) >> 2));
                }
                (_, false) => between.extend(sums.map(|sum| (sum + 2) >> 2)),
            }
        }
        if across == 1 {
            out.copy_from_slice(&between[1..1 + out.len()]);
            return;
        }
        let (shift, rounding) = match (is_libjpeg, down) {
            (true, 2) => (4, [8, 7]),
            (true, _) => (2, [1, 2]),
            (false, _) => (2, [2, 2]),
        };
        // Pairs begin at even columns.
        debug_assert!(columns.start.is_multiple_of(2), "columns begin with a chroma sample");
        for (pair, three) in out.chunks_mut(2).zip(between.windows(3)) {
            let [before, own, after] = [three[0], three[1], three[2]];
            let both = if self.decoder == Decoder::Nearest {
                [own, own]
            } else {
                [(3 * own + before + rounding[0]) >> shift, (3 * own + after + rounding[1]) >> shift]
            };
            pair.iter_mut().zip(both).for_each(|(out, v)| *out = v);
        }
    }

    /// Cb or Cr at a row's pixels by ffmpeg's scaler, in units of 2⁻¹⁹ codes.
    #[inline(always)]
    fn scaled<'a>(
        &self,
        row: impl Fn(i32) -> &'a [u8],
        columns: &Range<usize>,
        y: usize,
        wide: &mut Vec<i32>,
        out: &mut [i32],
    ) {
        let [across, down] = self.factor;
        let (phase, own) = (y % down, (y / down) as i32);
        let [low, high] = self.chroma_columns;
        wide.clear();
        wide.resize(out.len(), 0);
        for (n, weight) in (0..).zip(self.scaler.down[phase]) {
            let line = row(own + self.scaler.first_down[phase] + n);
            for (x, out) in columns.clone().zip(out.iter_mut()) {
                let phase = x % across;
                let first = (x / across) as i32 + self.scaler.first_across[phase];
                let taps = (0..).zip(self.scaler.across[phase]);
                let sum: i32 =
                    taps.map(|(k, weight)| weight * i32::from(line[(first + k).clamp(low, high) as usize])).sum();
                *out += weight * (sum >> 7).min(32_767);
            }
        }
    }

    #[inline(always)]
    fn rgb(&self, y: i32, [cb, cr]: [i32; 2]) -> [i32; 3] {
        let uniform = &self.uniform;
        match self.decoder {
            Decoder::ZuneJpeg => {
                // In units of 2⁻¹⁴, rounded with a little less than a half.
                let (light, cb, cr) = (16_384 * y + 8_191, cb - 128, cr - 128);
                [light + 22_970 * cr, light - 5_638 * cb - 11_700 * cr, light + 29_032 * cb].map(|v| v >> 14)
            }
            Decoder::Libjpeg => {
                let (cb, cr, half) = (cb - 128, cr - 128, 32_768);
                [91_881 * cr + half, half - 22_554 * cb - 46_802 * cr, 116_130 * cb + half].map(|v| y + (v >> 16))
            }
            Decoder::Swscale { .. } => {
                let [red_cr, green_cb, green_cr, blue_cb] = self.scaler.chroma;
                let [cb, cr] = [cb, cr].map(|c| (c + 512 - (128 << 19)) >> 10);
                let light = ((y - self.scaler.black) << 9) * self.scaler.luma + (1 << 21);
                let sums = [red_cr * cr, green_cb * cb + green_cr * cr, blue_cb * cb];
                sums.map(|sum| light.wrapping_add(sum).clamp(0, (1 << 30) - 1) >> 22)
            }
            Decoder::Nearest | Decoder::Unrounded => {
                let light = y as f32 - uniform.luma[3];
                let [cb, cr] = [cb as f32 - uniform.blue[3].trunc(), cr as f32 - uniform.red[3].trunc()];
                std::array::from_fn(|c| {
                    let code = light * uniform.from_luma[c] + cb * uniform.from_blue[c] + cr * uniform.from_red[c];
                    (code + 0.5).floor() as i32
                })
            }
        }
    }
}

/// Codes of a run of tiles from the decoded samples.
pub struct DecodePass<'a> {
    pub region: &'a CpuCoding,
    pub texels: &'a UncodedTexels<'a>,
    pub latent: Option<&'a LatentLookup>,
    pub planes: &'a CodedPlanes,
    pub decoding: &'a RowDecoder,
}

impl DecodePass<'_> {
    /// Fills in the codes of the run's changed pixels. `top` is the first row of the tiles.
    #[inline(always)]
    pub fn run(&self, run: &Range<usize>, top: usize, codes: &mut [[u8; 4]]) {
        let width = self.region.place.size[0];
        let mut scratch = DecodeScratch::default();
        let mut decoded = vec![[0; 3]; run.len()];
        let planes = self.planes.samples.each_ref().map(|plane| &plane[..]);
        for j in 0..TILE {
            let texels = &self.texels.codes[(top + j) * width..][run.clone()];
            if texels.iter().all(|texel| texel[3] == 0.0) {
                continue;
            }
            if self.region.coding.decoder != Decoder::Unrounded {
                self.decoding.row(&DecodedSamples { planes, width }, run, top + j, &mut scratch, &mut decoded);
            }
            let out = &mut codes[j * width..][run.clone()];
            for (i, ((out, texel), decoded)) in out.iter_mut().zip(texels).zip(&decoded).enumerate() {
                let share = texel[3];
                if share == 0.0 {
                    continue;
                }
                let code = decoded.map(|code| code.clamp(0, 255) as u8);
                let is_whole = share == 1.0 && self.region.coding.decoder != Decoder::Unrounded;
                let [r, g, b] = if is_whole { code } else { self.mixed(*texel, code, [run.start + i, top + j]) };
                *out = [r, g, b, 255];
            }
        }
    }

    /// Codes of a pixel that is coded in part, or not at all.
    fn mixed(&self, [r, g, b, share]: UncodedTexel, coded: [u8; 3], [x, y]: [usize; 2]) -> [u8; 3] {
        let uniform = &self.region.uniform;
        let mut content = [r, g, b];
        let is_coded = self.region.coding.decoder != Decoder::Unrounded;
        if let Some(latent) = self.latent {
            if !is_coded {
                content = std::array::from_fn(|c| content[c] + share * (latent.at(c, content[c]) - content[c]));
            }
            let [across, down] = self.region.factor();
            let width = self.region.place.size[0];
            let [luma, cb, cr] = self.planes.noise.each_ref();
            let chroma = y / down * (width / across) + x / across;
            let (luma, cb, cr) = (luma[y * width + x], cb[chroma], cr[chroma]);
            for (c, content) in content.iter_mut().enumerate() {
                *content += luma * uniform.from_luma[c] + cb * uniform.from_blue[c] + cr * uniform.from_red[c];
            }
        }
        std::array::from_fn(|c| {
            let whole = content[c] * (1.0 - share) + f32::from(coded[c]) * share;
            rounded_code(if is_coded { whole } else { content[c] }) as u8
        })
    }
}
