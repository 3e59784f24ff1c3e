//! Energies of the content of a row of tiles (example_noise/content.rs), and the sums of its
//! blocks for descriptors (example_noise/descriptor.rs).

use std::ops::Range;

use super::lanes::{LANES, Lanes, ln};
use super::{RegionPlace, TILE, UncodedTexel};
use crate::example_noise::content::{FEATURES, FeatureScale, brightness};
use crate::example_noise::descriptor::{DESCRIPTOR_BLOCK_PX, DescriptorSums};

/// Side of the blocks of gradients, px.
const BLOCK_PX: usize = 2;
/// Rows of blocks of a row of tiles, and of those that its smoothed energies read on either side.
const BLOCK_ROWS: usize = TILE / BLOCK_PX;
const BLOCK_REACH: usize = 4;

/// Energies of a region's content.
#[derive(Clone, Debug)]
pub struct ContentPlanes {
    width: usize,
    /// Energy of fine detail of each pixel, codes².
    detail: Vec<f32>,
    /// Mean squared gradients of blocks of 2 × 2 px, codes².
    gradients: Vec<f32>,
    /// Of blocks of 8 × 8 px.
    pub sums: Vec<DescriptorSums>,
}

/// The part of [`ContentPlanes`] in a row of tiles.
#[derive(Debug)]
pub struct ContentRows<'a> {
    detail: &'a mut [f32],
    gradients: &'a mut [f32],
    sums: &'a mut [DescriptorSums],
}

impl ContentPlanes {
    /// Planes without any energy.
    pub fn new([width, height]: [usize; 2]) -> Self {
        let blocks = |side: usize| (width / side) * (height / side);
        Self {
            width,
            detail: vec![0.0; width * height],
            gradients: vec![0.0; blocks(BLOCK_PX)],
            sums: vec![DescriptorSums::default(); blocks(DESCRIPTOR_BLOCK_PX)],
        }
    }

    /// The rows of tiles, from the first on.
    pub fn tile_rows(&mut self) -> impl Iterator<Item = ContentRows<'_>> {
        let blocks = |side: usize| (TILE / side) * (self.width / side);
        let detail = self.detail.chunks_mut(TILE * self.width);
        let gradients = self.gradients.chunks_mut(blocks(BLOCK_PX));
        let sums = self.sums.chunks_mut(blocks(DESCRIPTOR_BLOCK_PX));
        let rows = detail.zip(gradients).zip(sums);
        rows.map(|((detail, gradients), sums)| ContentRows { detail, gradients, sums })
    }
}

/// Repeats a row's ends beyond the columns of `bounds`. The row begins at column `first`.
#[inline(always)]
fn repeat_ends(row: &mut [f32], first: isize, bounds: &Range<usize>) {
    let inside = |at: usize| (at as isize - first).clamp(0, row.len() as isize - 1) as usize;
    let (low, last) = (inside(bounds.start), inside(bounds.end - 1));
    let (before, after) = (row[low], row[last]);
    row[..low].fill(before);
    row[last + 1..].fill(after);
}

/// Clamps a coordinate to a range.
fn within(at: isize, range: &Range<usize>) -> usize {
    at.clamp(range.start as isize, range.end as isize - 1) as usize
}

impl ContentRows<'_> {
    /// Fills in the energies and sums of a run of tiles whose first row is `top`.
    #[inline(always)]
    pub fn fill(&mut self, texels: &[UncodedTexel], place: &RegionPlace, run: &Range<usize>, top: usize) {
        let width = place.size[0];
        let bounds = place.bounds();
        let length = run.len() + 2;
        let bright = brightness_rows(texels, width, run, top, &bounds);
        let mut pair = vec![0.0f32; run.len()];
        let mut gradient = vec![0.0f32; run.len()];
        let (mut sum, mut difference) = (vec![0.0f32; length], vec![0.0f32; length]);
        for j in 0..TILE {
            let rows: [&[f32]; 3] = std::array::from_fn(|k| &bright[(j + k) * length..][..length]);
            let [upper, middle, lower] = rows;
            for ((s, d), ((u, m), l)) in sum.iter_mut().zip(&mut difference).zip(upper.iter().zip(middle).zip(lower)) {
                *s = u + 2.0 * m + l;
                *d = l - u;
            }
            let detail = &mut self.detail[j * width..][run.clone()];
            let three = sum.windows(3).zip(difference.windows(3)).zip(&middle[1..]);
            for ((detail, gradient), ((s, d), middle)) in detail.iter_mut().zip(&mut gradient).zip(three) {
                let along = s[2] - s[0];
                let down = d[0] + 2.0 * d[1] + d[2];
                let fine = middle - (s[0] + 2.0 * s[1] + s[2]) * (1.0 / 16.0);
                *detail = fine * fine;
                *gradient = (along * along + down * down) * (1.0 / 64.0);
            }
            place.clear_border(&mut gradient, run, top + j);
            if j.is_multiple_of(2) {
                pair.copy_from_slice(&gradient);
                continue;
            }
            let gradients = &mut self.gradients[j / 2 * (width / 2)..][run.start / 2..run.end / 2];
            let pairs = pair.as_chunks::<2>().0.iter().zip(gradient.as_chunks::<2>().0);
            for (out, (upper, lower)) in gradients.iter_mut().zip(pairs) {
                *out = 0.25 * (upper[0] + upper[1] + lower[0] + lower[1]);
            }
        }
        self.add_sums(texels, width, run, top, &bounds);
    }

    /// Sums of the blocks of 8 × 8 px that lie within the coded picture.
    #[inline(always)]
    fn add_sums(
        &mut self,
        texels: &[UncodedTexel],
        width: usize,
        run: &Range<usize>,
        top: usize,
        bounds: &[Range<usize>; 2],
    ) {
        const SIDE: usize = DESCRIPTOR_BLOCK_PX;
        let across = width / SIDE;
        for row in 0..TILE / SIDE {
            let y = top + row * SIDE;
            if y < bounds[1].start || y + SIDE > bounds[1].end {
                continue;
            }
            let rows: [&[UncodedTexel]; SIDE / 2] = std::array::from_fn(|k| &texels[(y + 2 * k) * width..][..width]);
            for column in run.start / SIDE..run.end / SIDE {
                let x = column * SIDE;
                if x >= bounds[0].start && x + SIDE <= bounds[0].end {
                    self.sums[row * across + column] = block_sums(&rows.map(|row| &row[x..x + SIDE]));
                }
            }
        }
    }
}

/// Sums over every other pixel of a block, of every other of its rows.
#[inline(always)]
fn block_sums(rows: &[&[UncodedTexel]; DESCRIPTOR_BLOCK_PX / 2]) -> DescriptorSums {
    let mut sums = DescriptorSums::default();
    if rows.iter().all(|row| row.iter().step_by(2).all(|texel| texel[3] == 0.0)) {
        return sums;
    }
    let mut above = [[0.0f32; 2]; DESCRIPTOR_BLOCK_PX / 2];
    for row in rows {
        let mut before = [0.0f32; 2];
        for (texel, above) in row.iter().step_by(2).zip(&mut above) {
            let [r, g, b] = [texel[0], texel[1], texel[2]].map(|v| v.clamp(0.0, 255.0) / 255.0);
            let own = [texel[3], brightness([r, g, b])];
            sums.weight += own[0];
            for (sum, v) in sums.color.iter_mut().zip([own[1], r - g, b - g]) {
                *sum += own[0] * v;
            }
            for other in [before, *above] {
                let (weight, difference) = (own[0] * other[0], 255.0 * (own[1] - other[1]));
                sums.pair_weight += weight;
                sums.energy += weight * difference * difference;
            }
            (*above, before) = (own, own);
        }
    }
    sums
}

/// Brightness of a run of tiles with a margin of 1 px, row by row.
#[inline(always)]
fn brightness_rows(
    texels: &[UncodedTexel],
    width: usize,
    run: &Range<usize>,
    top: usize,
    bounds: &[Range<usize>; 2],
) -> Vec<f32> {
    let length = run.len() + 2;
    let first = run.start as isize - 1;
    let columns = run.start.saturating_sub(1).max(bounds[0].start)..(run.end + 1).min(bounds[0].end);
    let offset = (columns.start as isize - first) as usize;
    let mut bright = vec![0.0f32; (TILE + 2) * length];
    for (j, row) in bright.chunks_exact_mut(length).enumerate() {
        let y = within((top + j) as isize - 1, &bounds[1]);
        for (value, [r, g, b, _]) in row[offset..].iter_mut().zip(&texels[y * width..][columns.clone()]) {
            let code = |v: f32| v.clamp(0.0, 255.0);
            *value = brightness([code(*r), code(*g), code(*b)]);
        }
        repeat_ends(row, first, &bounds[0]);
    }
    bright
}

/// Smoothed energies of a run of tiles: of coarse and fine gradients, for the rows and columns of
/// blocks from the one before the run to the one after it.
#[derive(Debug)]
pub struct Activity {
    /// Columns.
    length: usize,
    coarse: Vec<f32>,
    fine: Vec<f32>,
}

impl ContentPlanes {
    /// Smoothed energies of gradients about a run of tiles whose first row is `top`.
    #[inline(always)]
    pub fn activity(&self, place: &RegionPlace, run: &Range<usize>, top: usize) -> Activity {
        let bounds = place.bounds().map(|bounds| bounds.start / BLOCK_PX..bounds.end / BLOCK_PX);
        let (width, length) = (self.width / BLOCK_PX, run.len() / BLOCK_PX + 2 * BLOCK_REACH);
        let first = [run.start / BLOCK_PX, top / BLOCK_PX].map(|at| at as isize - BLOCK_REACH as isize);
        let columns = within(first[0], &bounds[0])..within(first[0] + length as isize - 1, &bounds[0]) + 1;
        let offset = (columns.start as isize - first[0]) as usize;
        let rows = BLOCK_ROWS + 2 * BLOCK_REACH;
        let mut blocks = vec![0.0f32; rows * length];
        for (j, row) in blocks.chunks_exact_mut(length).enumerate() {
            let y = within(first[1] + j as isize, &bounds[1]);
            row[offset..][..columns.len()].copy_from_slice(&self.gradients[y * width..][columns.clone()]);
            repeat_ends(row, first[0], &bounds[0]);
        }
        let smoothed = |from: &[f32], apart: usize| {
            let mut out = vec![0.0f32; from.len()];
            let mut sums = vec![0.0f32; length];
            for j in apart..rows - apart {
                // Beyond the picture its rim of smoothed blocks repeats.
                let y = (within(first[1] + j as isize, &bounds[1]) as isize - first[1]) as usize;
                let y = y.clamp(apart, rows - 1 - apart);
                let [above, own, below] = [y - apart, y, y + apart].map(|y| &from[y * length..][..length]);
                for (sum, ((a, o), b)) in sums.iter_mut().zip(above.iter().zip(own).zip(below)) {
                    *sum = 0.25 * a + 0.5 * o + 0.25 * b;
                }
                let row = &mut out[j * length..][..length];
                for (v, taps) in row[apart..].iter_mut().zip(sums.windows(2 * apart + 1)) {
                    *v = 0.25 * taps[0] + 0.5 * taps[apart] + 0.25 * taps[2 * apart];
                }
                repeat_ends(row, first[0], &bounds[0]);
            }
            out
        };
        let fine = smoothed(&blocks, 1);
        let coarse = smoothed(&fine, 2);
        Activity { length, coarse, fine }
    }

    /// Energies of fine detail of the region's pixels of `columns` in a row, smoothed.
    #[inline(always)]
    pub fn smoothed_detail(
        &self,
        place: &RegionPlace,
        columns: &Range<usize>,
        y: usize,
        sums: &mut Vec<f32>,
        out: &mut [f32],
    ) {
        let bounds = place.bounds();
        let (first, length) = (columns.start as isize - 1, columns.len() + 2);
        let columns = within(first, &bounds[0])..within(first + length as isize - 1, &bounds[0]) + 1;
        let offset = (columns.start as isize - first) as usize;
        let row = |y: isize| &self.detail[within(y, &bounds[1]) * self.width..][columns.clone()];
        let y = y as isize;
        sums.clear();
        sums.resize(length, 0.0);
        for (sum, ((a, o), b)) in sums[offset..].iter_mut().zip(row(y - 1).iter().zip(row(y)).zip(row(y + 1))) {
            *sum = 0.25 * a + 0.5 * o + 0.25 * b;
        }
        repeat_ends(sums, first, &bounds[0]);
        for (v, ((before, own), after)) in out.iter_mut().zip(sums.iter().zip(&sums[1..]).zip(&sums[2..])) {
            *v = 0.25 * before + 0.5 * own + 0.25 * after;
        }
    }
}

impl Activity {
    /// Energies in the j-th row of the tiles, interpolated between the centres of blocks: coarse
    /// and fine. `columns` of the run are an even number from an even one on.
    #[inline(always)]
    pub fn at_row(&self, j: usize, columns: &Range<usize>, mixed: &mut Vec<f32>, out: [&mut [f32]; 2]) {
        // Rows and columns begin `BLOCK_REACH` blocks before the tiles.
        let upper = BLOCK_REACH + j / 2 - (j + 1) % 2;
        let share = if j.is_multiple_of(2) { 0.75 } else { 0.25 };
        let first = BLOCK_REACH - 1 + columns.start / BLOCK_PX;
        let count = columns.len() / BLOCK_PX + 2;
        for (out, blocks) in out.into_iter().zip([&self.coarse, &self.fine]) {
            let [above, below] = [upper, upper + 1].map(|row| &blocks[row * self.length + first..][..count]);
            mixed.clear();
            mixed.extend(above.iter().zip(below).map(|(a, b)| a + share * (b - a)));
            let pairs = out[columns.clone()].as_chunks_mut::<2>().0;
            for (pair, ((left, own), right)) in pairs.iter_mut().zip(mixed.iter().zip(&mixed[1..]).zip(&mixed[2..])) {
                *pair = [left + 0.75 * (own - left), own + 0.25 * (right - own)];
            }
        }
    }
}

/// Ranges, means and reciprocals of deviations of the features.
#[derive(Clone, Copy, Debug)]
pub struct Standardisation {
    low: [f32; FEATURES],
    high: [f32; FEATURES],
    mean: [f32; FEATURES],
    inverse: [f32; FEATURES],
}

impl Standardisation {
    pub fn new(scale: &FeatureScale) -> Self {
        let FeatureScale { low, high, mean, deviation } = *scale;
        Self { low, high, mean, inverse: deviation.map(|deviation| 1.0 / deviation) }
    }

    /// Standardised features of pixels: of their R', G' and B' codes, and of their energies of
    /// coarse and fine gradients and of fine detail.
    #[inline(always)]
    pub fn features(&self, rgb: [&Lanes; 3], energies: [&Lanes; 3]) -> [Lanes; FEATURES] {
        let mut out = [[0.0; LANES]; FEATURES];
        for i in 0..LANES {
            let [r, g, b] = rgb.map(|channel| channel[i].clamp(0.0, 255.0));
            let y = brightness([r, g, b]) / 255.0;
            let [r, g, b] = [r, g, b].map(|code| code / 255.0);
            let features = [
                y,
                (y + 0.002).sqrt(),
                r - g,
                b - g,
                ln(0.5 + energies[0][i]),
                ln(0.5 + energies[1][i]),
                ln(0.05 + energies[2][i]),
            ];
            for k in 0..FEATURES {
                let bounded = features[k].max(self.low[k]).min(self.high[k]);
                out[k][i] = (bounded - self.mean[k]) * self.inverse[k];
            }
        }
        out
    }
}
