//! Synthesis of the noise planes from the atlas.
//!
//! N(p) = f(p) Σ_b exp(g_b · φ(p) / 2) Σ_cells w(p) n_b(source(p))
//!
//! in code values, for each plane at its own resolution. f is the amplitude factor for partly
//! covered pixels; at a chroma sample it is the mean over its pixels.

use super::NoiseModel;
use super::atlas::{CELL_PX, OVERLAP_PX, TILE_PX};
use super::bands::{BANDS, FIRST_BAND};
use super::cells::{TileSource, cell_count, sources, weight};
use super::content::{Features, block_means};
use super::descriptor::DescriptorBlocks;
use super::path::Planes;
use super::persistence::FrameKeys;
use super::regression::amplitude;
use crate::grey_image::GreyImage;
use crate::parallel::{over_rows, processors};

/// Content of a coded picture (with its padding), on which noise is synthesised.
#[derive(Clone, Copy, Debug)]
pub struct NoiseContent<'a> {
    /// R', G', B' codes on the 8-bit scale, without noise.
    pub rgb: &'a Planes,
    /// Weight of each pixel in its cells' descriptors; 1 without one.
    pub share: Option<&'a GreyImage>,
    /// Amplitude factor at each luma px, at least 0; 1 without one.
    pub factor: Option<&'a GreyImage>,
}

impl NoiseModel {
    /// Noise planes Y', Cb, Cr of a picture, code values.
    pub fn noise(&self, content: &NoiseContent<'_>, keys: &FrameKeys) -> Planes {
        let NoiseContent { rgb, share, factor } = *content;
        let features = &self.numbers.scale.standardised(Features::of(rgb));
        let chroma_factor = self.numbers.chroma_factor();
        let blocks = DescriptorBlocks::of(rgb, share);
        let size = [features.width(), features.height()];
        let sources = sources(&blocks, size, &self.descriptor_scale, &self.candidates, keys);
        let columns = cell_count(features.width());
        let chroma = features.reduced(chroma_factor);
        let chroma_amplitude = factor.map(|plane| block_means(plane, chroma_factor));
        std::array::from_fn(|plane| {
            let (features, down, factor) = if plane == 0 {
                (features, [1, 1], factor)
            } else {
                (&chroma, chroma_factor, chroma_amplitude.as_ref())
            };
            let mut out = GreyImage::uniform(features.width(), features.height(), 0.0);
            let width = out.width;
            over_rows(&mut out.values, width, processors(), |y, row| {
                self.noise_row(plane, features, down, (&sources, columns), y, row);
                if let Some(factor) = factor {
                    row.iter_mut().zip(&factor.values[y * width..]).for_each(|(v, f)| *v *= f);
                }
            });
            out
        })
    }

    fn noise_row(
        &self,
        plane: usize,
        features: &Features,
        factor: [usize; 2],
        (sources, columns): (&[TileSource], usize),
        y: usize,
        row: &mut [f32],
    ) {
        let bands = FIRST_BAND[plane]..FIRST_BAND[plane] + BANDS[plane];
        let width = row.len();
        let mut field = vec![0.0f32; width * bands.len()];
        let [tile, cell, overlap] = [TILE_PX, CELL_PX, OVERLAP_PX].map(|v| [v / factor[0], v / factor[1]]);
        let last = (y + overlap[1]) / cell[1];
        // The later cell of an overlap first.
        for j in [Some(last), last.checked_sub(1)].into_iter().flatten() {
            let t = y + overlap[1] - j * cell[1];
            if t >= tile[1] {
                continue;
            }
            let down = weight(t, factor[1]);
            for i in 0..columns {
                let source = &sources[j * columns + i];
                let first = (i * cell[0]).saturating_sub(overlap[0]);
                let end = (i * cell[0] + cell[0]).min(width);
                let line = if source.mirrored[1] { tile[1] - 1 - t } else { t } + source.at[1] as usize / factor[1];
                for (b, field) in bands.clone().zip(field.chunks_exact_mut(width)) {
                    let image = &self.frames[source.frame as usize].bands[b];
                    let line = &image.values[line * image.width + source.at[0] as usize / factor[0]..][..tile[0]];
                    for (x, out) in field.iter_mut().enumerate().take(end).skip(first) {
                        let s = x + overlap[0] - i * cell[0];
                        let at = if source.mirrored[0] { tile[0] - 1 - s } else { s };
                        *out += down * weight_at(s, cell[0], overlap[0]) * line[at];
                    }
                }
            }
        }
        for (x, out) in row.iter_mut().enumerate() {
            let phi = std::array::from_fn(|f| features.0[f].values[y * width + x]);
            *out = bands
                .clone()
                .enumerate()
                .map(|(k, b)| field[k * width + x] * amplitude(&self.numbers.gains[b], &phi))
                .sum();
        }
    }
}

/// [`weight`] with a shortcut where there is no overlap.
fn weight_at(t: usize, cell: usize, overlap: usize) -> f32 {
    if t >= overlap && t < cell { 1.0 } else { weight(t, CELL_PX / cell) }
}
