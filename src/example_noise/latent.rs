//! Means of clipped pixels: the value before clipping whose noisy, clipped mean was observed.
//!
//! Noise that is clipped at 0 raises the mean of dark pixels, at 255 it lowers that of bright ones.
//! A table of 20 nodes for each channel maps the observed mean to the latent value. It is linear
//! between nodes, and the identity between 24 and 231.
//!
//! Below 3 code values a mean is mostly rounding; it is replaced gradually by its Gaussian blur of
//! 2 px, which reads 6 px around a pixel.

use serde::{Deserialize, Serialize};

use crate::grey_image::GreyImage;

/// Observed means at the table's nodes, code values.
pub const NODES: [f32; 20] = [
    0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 40.0, 215.0, 231.0, 239.0, 247.0, 251.0, 253.0, 254.0,
    255.0,
];
/// Nodes between these stay the identity.
const IDENTITY: std::ops::RangeInclusive<f32> = 24.0..=231.0;
/// Means below this are smoothed, code values.
const SMOOTHED_BELOW: f32 = 3.0;
/// Standard deviation of their blur, px.
const BLUR_PX: f64 = 2.0;
/// Fewest pixels of a node for a step.
const MIN_PIXELS: usize = 150;
/// Range of latent values.
const RANGE: [f64; 2] = [-40.0, 295.0];

/// Latent values at [`NODES`], for R, G, B, code values, ascending.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatentTable {
    pub values: [[f32; NODES.len()]; 3],
}

impl Default for LatentTable {
    fn default() -> Self {
        Self { values: [NODES; 3] }
    }
}

/// A channel with smoothed dark means.
pub fn smoothed(channel: &GreyImage) -> GreyImage {
    let mut out = channel.clone();
    if channel.values.iter().any(|&v| v < SMOOTHED_BELOW) {
        let blurred = channel.blurred(BLUR_PX);
        for (v, b) in out.values.iter_mut().zip(&blurred.values) {
            let own = (v.min(SMOOTHED_BELOW) / SMOOTHED_BELOW).clamp(0.0, 1.0);
            *v = own * *v + (1.0 - own) * b.min(SMOOTHED_BELOW);
        }
    }
    out
}

impl LatentTable {
    /// The latent value of a smoothed mean.
    pub fn at(&self, channel: usize, mean: f32) -> f32 {
        let table = &self.values[channel];
        let next = NODES.partition_point(|&node| node <= mean).clamp(1, NODES.len() - 1);
        let share = ((mean - NODES[next - 1]) / (NODES[next] - NODES[next - 1])).clamp(0.0, 1.0);
        table[next - 1] + share * (table[next] - table[next - 1])
    }

    /// Latent R', G', B' of a picture without noise, code values.
    pub fn latent(&self, rgb: &[GreyImage; 3]) -> [GreyImage; 3] {
        std::array::from_fn(|c| {
            let mut out = smoothed(&rgb[c]);
            out.values.iter_mut().for_each(|v| *v = self.at(c, *v));
            out
        })
    }

    /// True if all values are finite and ascending.
    pub fn is_valid(&self) -> bool {
        self.values.iter().all(|t| t.iter().all(|v| v.is_finite()) && t.windows(2).all(|w| w[0] <= w[1]))
    }
}

/// Sums of a channel's codes at each node.
#[derive(Clone, Copy, Debug, Default)]
struct NodeSums {
    pixels: usize,
    real: f64,
    synthesised: f64,
    unclipped: usize,
}

/// Means of real and synthesised codes by observed mean, for one step of the table.
#[derive(Clone, Debug, Default)]
pub struct LatentStep {
    sums: [[NodeSums; NODES.len()]; 3],
}

impl LatentStep {
    /// Counts a pixel of a channel.
    pub fn add(&mut self, channel: usize, smoothed_mean: f32, real: u8, synthesised: u8) {
        let node = NODES.windows(2).filter(|w| smoothed_mean >= 0.5 * (w[0] + w[1])).count();
        let sums = &mut self.sums[channel][node];
        sums.pixels += 1;
        sums.real += f64::from(real);
        sums.synthesised += f64::from(synthesised);
        sums.unclipped += usize::from(synthesised > 0 && synthesised < 255);
    }

    /// Moves the table so that the means of synthesised codes approach those of real ones.
    pub fn apply(&self, table: &mut LatentTable) {
        for (sums, values) in self.sums.iter().zip(&mut table.values) {
            let mut largest = RANGE[0];
            for ((sum, value), node) in sums.iter().zip(values).zip(NODES) {
                let count = sum.pixels.max(1) as f64;
                let free = sum.unclipped as f64 / count;
                let wanted = sum.pixels > MIN_PIXELS && (node < *IDENTITY.start() || node > *IDENTITY.end());
                let step = ((sum.real - sum.synthesised) / count / free.max(0.08)).clamp(-4.0, 4.0);
                let moved = f64::from(*value) + if wanted { 0.8 * step } else { 0.0 };
                largest = moved.clamp(RANGE[0], RANGE[1]).max(largest);
                *value = largest as f32;
            }
        }
    }
}
