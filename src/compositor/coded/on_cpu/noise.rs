//! Noise by example of a row of tiles (example_noise/synthesis.rs): innovations of the atlas times
//! amplitudes by the content's features.

use std::ops::Range;

use super::RegionPlace;
use super::content::{Activity, ContentPlanes, Standardisation};
use super::lanes::{LANES, Lanes, exp2};
use super::pixels::PixelRow;
use crate::effects::ExampleNoise;
use crate::example_noise::NoiseModel;
use crate::example_noise::atlas::{CELL_PX, OVERLAP_PX, TILE_PX};
use crate::example_noise::bands::{ALL_BANDS, BANDS, FIRST_BAND};
use crate::example_noise::cells::{TileSource, source, weight};
use crate::example_noise::content::FEATURES;
use crate::example_noise::descriptor::{DESCRIPTOR_BLOCK_PX, DescriptorSums};
use crate::example_noise::regression::{COEFFICIENTS, EXPONENT_LIMIT};

/// Bands of Y', and of Cb and Cr together.
const LUMA_BANDS: usize = BANDS[0];
const CHROMA_BANDS: usize = BANDS[1] + BANDS[2];

/// Content, cells and weights of the noise of a region.
#[derive(Debug)]
pub struct NoiseSynthesis<'a> {
    model: &'a NoiseModel,
    place: RegionPlace,
    content: ContentPlanes,
    standardisation: Standardisation,
    /// Coefficients of the exponents to the base 2 of the bands' amplitudes.
    gains: [[f32; COEFFICIENTS]; ALL_BANDS],
    cells: CellSources,
    /// Luma px for each chroma sample.
    factor: [usize; 2],
    /// Weights of a cell along an axis, for Y', and for Cb and Cr by axis.
    luma_weights: Vec<f32>,
    chroma_weights: [Vec<f32>; 2],
}

/// Resolution of a plane.
#[derive(Clone, Copy, Debug)]
struct PlaneLayout<'a> {
    /// Luma px per sample.
    factor: [usize; 2],
    /// Weights of a cell at its samples, by axis.
    weights: [&'a [f32]; 2],
}

/// Sources of the cells that a region needs.
#[derive(Debug)]
struct CellSources {
    first: [usize; 2],
    columns: usize,
    sources: Vec<TileSource>,
}

impl CellSources {
    fn new(noise: &ExampleNoise, place: &RegionPlace, sums: &[DescriptorSums]) -> Self {
        const SIDE: i32 = DESCRIPTOR_BLOCK_PX as i32;
        const TILE_BLOCKS: i32 = TILE_PX as i32 / SIDE;
        let extent = place.extent;
        let in_cells = |px: i32| (px + OVERLAP_PX as i32) / CELL_PX as i32;
        let first = [0, 1].map(|axis| (in_cells((-extent[axis]).max(0)) - 1).max(0));
        let end = [0, 1].map(|axis| (place.size[axis] as i32).min(extent[2 + axis]) - extent[axis]);
        let count = [0, 1].map(|axis| (in_cells(end[axis] - 1) + 1 - first[axis]).max(1));
        let blocks = place.size.map(|side| side as i32 / SIDE);
        let of_cell = |i: i32, j: i32| {
            let corner = [i, j].map(|n| n * CELL_PX as i32 - OVERLAP_PX as i32);
            let range = |axis: usize| {
                let low = (extent[axis] + corner[axis]) / SIDE;
                low.clamp(0, blocks[axis]) as usize..(low + TILE_BLOCKS).clamp(0, blocks[axis]) as usize
            };
            let mut all = DescriptorSums::default();
            for row in range(1) {
                sums[row * blocks[0] as usize..][range(0)].iter().for_each(|block| all.add(block));
            }
            let descriptor = noise.model.descriptor_scale.standardised(&all.descriptor());
            source([i as u32, j as u32], &descriptor, &noise.model.candidates, &noise.keys)
        };
        let rows = first[1]..first[1] + count[1];
        let cells = rows.flat_map(|j| (first[0]..first[0] + count[0]).map(move |i| (i, j)));
        Self {
            first: first.map(|cell| cell as usize),
            columns: count[0] as usize,
            sources: cells.map(|(i, j)| of_cell(i, j)).collect(),
        }
    }
}

impl<'a> NoiseSynthesis<'a> {
    /// The synthesis on content with its energies.
    pub fn new(noise: &'a ExampleNoise, place: RegionPlace, content: ContentPlanes) -> Self {
        let numbers = &noise.model.numbers;
        let factor = numbers.chroma_factor();
        let weights = |factor: usize| (0..TILE_PX / factor).map(|t| weight(t, factor)).collect::<Vec<f32>>();
        let to_base_2 = 0.5 * std::f32::consts::LOG2_E;
        Self {
            model: &noise.model,
            standardisation: Standardisation::new(&numbers.scale),
            gains: numbers.gains.map(|gains| gains.map(|gain| gain * to_base_2)),
            cells: CellSources::new(noise, &place, &content.sums),
            factor,
            luma_weights: weights(1),
            chroma_weights: factor.map(weights),
            place,
            content,
        }
    }

    pub fn activity(&self, run: &Range<usize>, top: usize) -> Activity {
        self.content.activity(&self.place, run, top)
    }

    /// exp(g · φ / 2) of a band at some pixels.
    #[inline(always)]
    fn amplitude(&self, band: usize, features: &[Lanes; FEATURES]) -> Lanes {
        const LIMIT: f32 = 0.5 * std::f32::consts::LOG2_E * EXPONENT_LIMIT;
        let g = &self.gains[band];
        let mut exponents = [g[0]; LANES];
        for (gain, feature) in g[1..].iter().zip(features) {
            for (exponent, feature) in exponents.iter_mut().zip(feature) {
                *exponent += gain * feature;
            }
        }
        exponents.map(|exponent| exp2(exponent.clamp(-LIMIT, LIMIT)))
    }

    /// Adds the cells' innovations of `N` bands in a row of a plane to `field`, band by band.
    /// `columns` and `y` are samples of the region's plane.
    #[inline(always)]
    fn add_innovations<const N: usize>(
        &self,
        first_band: usize,
        layout: &PlaneLayout<'_>,
        columns: &Range<usize>,
        y: usize,
        field: &mut [f32],
    ) {
        let PlaneLayout { factor, weights } = *layout;
        let [tile, cell, overlap] = [TILE_PX, CELL_PX, OVERLAP_PX].map(|px| [px / factor[0], px / factor[1]]);
        let origin = [0, 1].map(|axis| self.place.extent[axis] / factor[axis] as i32);
        // Places in the coded plane.
        let in_plane = |at: usize, axis: usize| (at as i32 - origin[axis]).max(0) as usize;
        let (x0, x1, y) = (in_plane(columns.start, 0), in_plane(columns.end, 0), in_plane(y, 1));
        let length = columns.len();
        let mut line_weights = [0.0f32; TILE_PX];
        let last = (y + overlap[1]) / cell[1];
        // The later cell of an overlap first.
        for row in [Some(last), last.checked_sub(1)].into_iter().flatten() {
            let t = y + overlap[1] - row * cell[1];
            let Some(row) = row.checked_sub(self.cells.first[1]).filter(|_| t < tile[1]) else { continue };
            for (weight, across) in line_weights.iter_mut().zip(weights[0]) {
                *weight = weights[1][t] * across;
            }
            let first = ((x0 + overlap[0]) / cell[0]).saturating_sub(1).max(self.cells.first[0]);
            for column in first..(x1 + overlap[0]).div_ceil(cell[0]) {
                let at = row * self.cells.columns + column - self.cells.first[0];
                let Some(source) = self.cells.sources.get(at) else { continue };
                // Samples of the tile: the first is `begin` samples after the columns' first.
                let begin = (column * cell[0]) as isize - overlap[0] as isize - x0 as isize;
                let from = (-begin).max(0) as usize;
                let to = (length as isize - begin).clamp(0, tile[0] as isize) as usize;
                if from >= to {
                    continue;
                }
                let out_first = (begin + from as isize) as usize;
                let line = if source.mirrored[1] { tile[1] - 1 - t } else { t } + source.at[1] as usize / factor[1];
                let bands = &self.model.frames[source.frame as usize].bands[first_band..first_band + N];
                for (band, field) in bands.iter().zip(field.chunks_exact_mut(length)) {
                    let line = &band.values[line * band.width + source.at[0] as usize / factor[0]..][..tile[0]];
                    let out = field[out_first..].iter_mut().zip(&line_weights[from..to]);
                    if source.mirrored[0] {
                        let line = line[tile[0] - to..tile[0] - from].iter().rev();
                        out.zip(line).for_each(|((out, weight), v)| *out += weight * v);
                    } else {
                        out.zip(&line[from..to]).for_each(|((out, weight), v)| *out += weight * v);
                    }
                }
            }
        }
    }
}

/// Space for the noise of a run of tiles.
#[derive(Debug)]
pub struct NoiseScratch {
    energies: [Vec<f32>; 3],
    /// A row of energies before their interpolation.
    row: Vec<f32>,
    field: Vec<f32>,
    /// Sums of the features of a chroma sample's rows, feature by feature.
    features: Vec<f32>,
    factors: Vec<f32>,
    /// Pixels that have noise, in the rows of a chroma sample.
    span: Range<usize>,
}

impl NoiseScratch {
    pub fn new(length: usize) -> Self {
        Self {
            energies: [const { Vec::new() }; 3].map(|_: Vec<f32>| vec![0.0; length]),
            row: Vec::new(),
            field: Vec::new(),
            features: vec![0.0; FEATURES * length],
            factors: vec![0.0; length],
            span: 0..0,
        }
    }

    /// Begins the rows of a chroma sample with these amplitude factors.
    pub fn begin(&mut self, factors: &[&[f32]]) {
        let is_noisy = |i: usize| factors.iter().any(|row| row[i] > 0.0);
        let length = self.factors.len();
        let first = (0..length).find(|&i| is_noisy(i));
        let last = (0..length).rfind(|&i| is_noisy(i));
        self.span = first.zip(last).map_or(0..0, |(first, last)| first / LANES * LANES..(last / LANES + 1) * LANES);
        self.features.fill(0.0);
        self.factors.fill(0.0);
    }
}

/// Content of a row of a run of tiles.
#[derive(Clone, Copy, Debug)]
pub struct RowInputs<'a> {
    pub activity: &'a Activity,
    pub pixels: &'a PixelRow,
    /// Amplitude factors.
    pub factors: &'a [f32],
}

/// A row of a run of tiles.
#[derive(Clone, Copy, Debug)]
pub struct RunRow<'a> {
    pub run: &'a Range<usize>,
    /// First row of the tiles, and the row within them.
    pub top: usize,
    pub j: usize,
}

impl NoiseSynthesis<'_> {
    /// Noise of Y' of a run's pixels in a row, code values. Their features are added for chroma.
    #[inline(always)]
    pub fn luma_row(&self, scratch: &mut NoiseScratch, at: RunRow<'_>, inputs: &RowInputs<'_>, out: &mut [f32]) {
        let RowInputs { activity, pixels, factors } = *inputs;
        out.fill(0.0);
        let span = scratch.span.clone();
        if span.is_empty() {
            return;
        }
        let length = span.len();
        let columns = at.run.start + span.start..at.run.start + span.end;
        let [coarse, fine, detail] = &mut scratch.energies;
        activity.at_row(at.j, &span, &mut scratch.row, [coarse, fine]);
        let detail = &mut detail[span.clone()];
        self.content.smoothed_detail(&self.place, &columns, at.top + at.j, &mut scratch.row, detail);
        scratch.field.clear();
        scratch.field.resize(LUMA_BANDS * length, 0.0);
        let weights = [&self.luma_weights[..]; 2];
        self.add_innovations::<LUMA_BANDS>(
            FIRST_BAND[0],
            &PlaneLayout { factor: [1, 1], weights },
            &columns,
            at.top + at.j,
            &mut scratch.field,
        );
        let run_length = scratch.factors.len();
        for x in (0..length).step_by(LANES) {
            let px = span.start + x;
            let lanes = |row: &[f32]| -> Lanes { std::array::from_fn(|i| row[px..px + LANES][i]) };
            let energies = scratch.energies.each_ref().map(|row| lanes(row));
            let rgb = pixels.rgb.each_ref().map(|row| lanes(row));
            let features = self.standardisation.features(rgb.each_ref(), energies.each_ref());
            for (k, feature) in features.iter().enumerate() {
                let sums = &mut scratch.features[k * run_length + px..][..LANES];
                sums.iter_mut().zip(feature).for_each(|(sum, v)| *sum += v);
            }
            let factor = lanes(factors);
            scratch.factors[px..px + LANES].iter_mut().zip(&factor).for_each(|(sum, v)| *sum += v);
            let mut noise = [0.0; LANES];
            for band in 0..LUMA_BANDS {
                let amplitude = self.amplitude(FIRST_BAND[0] + band, &features);
                let field = &scratch.field[band * length + x..][..LANES];
                for i in 0..LANES {
                    noise[i] += field[i] * amplitude[i];
                }
            }
            for (out, (noise, factor)) in out[px..px + LANES].iter_mut().zip(noise.iter().zip(&factor)) {
                *out = if *factor > 0.0 { factor * noise } else { 0.0 };
            }
        }
    }

    /// Noise of Cb and Cr of a run's chroma samples, from the rows since [`NoiseScratch::begin`].
    #[inline(always)]
    pub fn chroma_row(&self, scratch: &mut NoiseScratch, at: RunRow<'_>, out: [&mut [f32]; 2]) {
        let [blue, red] = out;
        blue.fill(0.0);
        red.fill(0.0);
        let [across, down] = self.factor;
        let share = 1.0 / (across * down) as f32;
        let span = scratch.span.start / across..scratch.span.end / across;
        if span.is_empty() {
            return;
        }
        let run_length = scratch.factors.len();
        let length = span.len().next_multiple_of(LANES);
        let rows = scratch.features.chunks_exact_mut(run_length).chain([&mut scratch.factors[..]]);
        for row in rows {
            for x in span.clone() {
                row[x] = share * if across == 2 { row[2 * x] + row[2 * x + 1] } else { row[x] };
            }
            // Lanes beyond the span.
            let padded = (span.start + length).min(run_length);
            row[span.end..padded].fill(0.0);
        }
        let first = at.run.start / across + span.start;
        scratch.field.clear();
        scratch.field.resize(CHROMA_BANDS * length, 0.0);
        let weights = self.chroma_weights.each_ref().map(|weights| &weights[..]);
        self.add_innovations::<CHROMA_BANDS>(
            FIRST_BAND[1],
            &PlaneLayout { factor: self.factor, weights },
            &(first..first + length),
            (at.top + at.j) / down,
            &mut scratch.field,
        );
        for x in (0..length).step_by(LANES) {
            let begin = span.start + x;
            let count = LANES.min(blue.len() - begin);
            let lanes =
                |row: &[f32]| -> Lanes { std::array::from_fn(|i| if i < count { row[begin + i] } else { 0.0 }) };
            let features: [Lanes; FEATURES] = std::array::from_fn(|k| lanes(&scratch.features[k * run_length..]));
            let factor = lanes(&scratch.factors);
            for (plane, out) in [&mut *blue, &mut *red].into_iter().enumerate() {
                let mut noise = [0.0; LANES];
                for band in 0..BANDS[1] {
                    let band = plane * BANDS[1] + band;
                    let amplitude = self.amplitude(FIRST_BAND[1] + band, &features);
                    let field = &scratch.field[band * length + x..][..LANES];
                    for i in 0..LANES {
                        noise[i] += field[i] * amplitude[i];
                    }
                }
                for (out, (noise, factor)) in out[begin..begin + count].iter_mut().zip(noise.iter().zip(&factor)) {
                    *out = if *factor > 0.0 { factor * noise } else { 0.0 };
                }
            }
        }
    }
}
