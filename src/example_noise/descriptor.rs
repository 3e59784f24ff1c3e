//! Descriptors of an 80 × 80 px tile's content, by which cells of the synthesis find tiles of the
//! atlas.
//!
//! Sampled at every other px of the coded picture, from an even place. With m and y as for the
//! [features](super::content), and each sample weighted by its share w in the noise:
//!
//! | | formula |
//! |---|---|
//! | 0 | ȳ |
//! | 1 | √(max(ȳ, 0) + 0.002) |
//! | 2 | mean of R − G |
//! | 3 | mean of B − G |
//! | 4 | ln(0.5 + e) |
//!
//! e: half of the mean of (255 Δy)² over neighbouring samples, to the right and below, within
//! blocks of 8 × 8 px, weighted by the product of their shares. It is about the squared gradient,
//! codes² per px².
//!
//! Sums are kept for each block, so that a tile's are sums over its blocks.

use super::content::brightness;
use super::tile::TILE_PX;
use crate::grey_image::GreyImage;

/// Numbers of a descriptor.
pub const DESCRIPTORS: usize = 5;
/// Side of the blocks, luma px. Cells and candidates start at its multiples.
pub const DESCRIPTOR_BLOCK_PX: usize = 8;
/// Distance of samples, px.
const SAMPLE_STEP_PX: usize = 2;

/// Content of a tile, by the rows of the table above.
pub type Descriptor = [f32; DESCRIPTORS];

/// Weighted sums over the samples of a block or a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DescriptorSums {
    /// Sum of the weights.
    pub weight: f32,
    /// Sums of y, R − G and B − G.
    pub color: [f32; 3],
    /// Sum of the weights of pairs.
    pub pair_weight: f32,
    /// Sum of (255 Δy)².
    pub energy: f32,
}

impl DescriptorSums {
    /// Adds the sums of other samples.
    pub fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.color.iter_mut().zip(other.color).for_each(|(sum, v)| *sum += v);
        self.pair_weight += other.pair_weight;
        self.energy += other.energy;
    }

    /// The descriptor; that of black without any weight.
    pub fn descriptor(&self) -> Descriptor {
        let [y, red, blue] = self.color.map(|sum| sum / self.weight.max(f32::MIN_POSITIVE));
        let energy = 0.5 * self.energy / self.pair_weight.max(f32::MIN_POSITIVE);
        [y, (y.max(0.0) + 0.002).sqrt(), red, blue, (0.5 + energy).ln()]
    }
}

/// Sums of the blocks of a coded picture, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct DescriptorBlocks {
    size: [usize; 2],
    sums: Vec<DescriptorSums>,
}

impl DescriptorBlocks {
    /// Of R', G', B' codes on the 8-bit scale. `share`: weight of each pixel; 1 without one.
    pub fn of(rgb: &[GreyImage; 3], share: Option<&GreyImage>) -> Self {
        let width = rgb[0].width;
        let size = [width, rgb[0].height].map(|length| length / DESCRIPTOR_BLOCK_PX);
        let sample = |x: usize, y: usize| {
            let i = y * width + x;
            let [r, g, b] = rgb.each_ref().map(|plane| plane.values[i].clamp(0.0, 255.0) / 255.0);
            (share.map_or(1.0, |share| share.values[i]), [brightness([r, g, b]), r - g, b - g])
        };
        let block = |column: usize, row: usize| {
            let mut sums = DescriptorSums::default();
            let place = |k: usize, block: usize| DESCRIPTOR_BLOCK_PX * block + SAMPLE_STEP_PX * k;
            let count = DESCRIPTOR_BLOCK_PX / SAMPLE_STEP_PX;
            for j in 0..count {
                for i in 0..count {
                    let (w, color) = sample(place(i, column), place(j, row));
                    sums.weight += w;
                    sums.color.iter_mut().zip(color).for_each(|(sum, v)| *sum += w * v);
                    for (i, j) in [(i + 1, j), (i, j + 1)].into_iter().filter(|(i, j)| i.max(j) < &count) {
                        let (other, other_color) = sample(place(i, column), place(j, row));
                        let difference = 255.0 * (other_color[0] - color[0]);
                        sums.pair_weight += w * other;
                        sums.energy += w * other * difference * difference;
                    }
                }
            }
            sums
        };
        let sums = (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| (column, row)));
        Self { size, sums: sums.map(|(column, row)| block(column, row)).collect() }
    }

    /// The descriptor of a tile, from its upper left block `first`. Blocks beyond the picture are
    /// left out.
    pub fn tile(&self, first: [i64; 2]) -> Descriptor {
        let side = (TILE_PX / DESCRIPTOR_BLOCK_PX) as i64;
        let range = |axis: usize| {
            let count = self.size[axis] as i64;
            first[axis].clamp(0, count) as usize..(first[axis] + side).clamp(0, count) as usize
        };
        let mut sums = DescriptorSums::default();
        for row in range(1) {
            self.sums[row * self.size[0]..][range(0)].iter().for_each(|block| sums.add(block));
        }
        sums.descriptor()
    }
}

/// Range, mean and standard deviation of each number over a list of descriptors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DescriptorScale {
    pub low: Descriptor,
    pub high: Descriptor,
    pub mean: Descriptor,
    /// Reciprocals.
    pub inverse_deviation: Descriptor,
}

impl DescriptorScale {
    pub fn of(descriptors: &[Descriptor]) -> Self {
        let mut scale = Self::default();
        let count = descriptors.len().max(1) as f32;
        for k in 0..DESCRIPTORS {
            let values = descriptors.iter().map(|descriptor| descriptor[k]);
            let mean = values.clone().sum::<f32>() / count;
            let variance = values.clone().map(|v| (v - mean).powi(2)).sum::<f32>() / count;
            scale.low[k] = values.clone().fold(f32::INFINITY, f32::min);
            scale.high[k] = values.fold(f32::NEG_INFINITY, f32::max);
            scale.mean[k] = mean;
            scale.inverse_deviation[k] = 1.0 / (variance.sqrt() + 1e-6);
        }
        scale
    }

    /// A descriptor clamped to the range and standardised.
    pub fn standardised(&self, descriptor: &Descriptor) -> Descriptor {
        std::array::from_fn(|k| {
            (descriptor[k].clamp(self.low[k], self.high[k]) - self.mean[k]) * self.inverse_deviation[k]
        })
    }
}
