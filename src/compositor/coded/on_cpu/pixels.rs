//! Pixels of a row in planes, and their latent values (example_noise/latent.rs).

use super::UncodedTexel;
use crate::example_noise::latent::{LatentTable, NODES};

/// Planar pixels of a run of tiles in a row.
#[derive(Debug)]
pub struct PixelRow {
    pub rgb: [Vec<f32>; 3],
    pub share: Vec<f32>,
}

impl PixelRow {
    pub fn new(length: usize) -> Self {
        Self { rgb: [const { Vec::new() }; 3].map(|_: Vec<f32>| vec![0.0; length]), share: vec![0.0; length] }
    }

    #[inline(always)]
    pub fn load(&mut self, texels: &[UncodedTexel]) {
        let [red, green, blue] = &mut self.rgb;
        let channels = red.iter_mut().zip(green).zip(blue).zip(&mut self.share);
        for ((((r, g), b), share), texel) in channels.zip(texels) {
            [*r, *g, *b, *share] = *texel;
        }
    }
}

/// A table of latent values at multiples of half a code, where all of its nodes are.
#[derive(Debug)]
pub struct LatentLookup {
    channels: [Vec<f32>; 3],
    /// Codes that stay as they are.
    identity: std::ops::RangeInclusive<f32>,
}

impl LatentLookup {
    const PER_CODE: f32 = 2.0;
    /// Nodes that usually stay the identity: 24 to 231.
    const FIRST: usize = 10;
    const END: usize = 14;

    pub fn new(table: &LatentTable) -> Self {
        let last = (255.0 * Self::PER_CODE) as usize;
        // A second entry for the last code, so that each has a next one.
        let channel = |c: usize| (0..=last + 1).map(|i| table.at(c, (i as f32 / Self::PER_CODE).min(255.0))).collect();
        let is_identity =
            table.values.iter().all(|values| values[Self::FIRST..Self::END] == NODES[Self::FIRST..Self::END]);
        let identity = if is_identity { NODES[Self::FIRST]..=NODES[Self::END - 1] } else { 1.0..=0.0 };
        Self { channels: [0, 1, 2].map(channel), identity }
    }

    pub fn at(&self, channel: usize, code: f32) -> f32 {
        let at = Self::PER_CODE * code.clamp(0.0, 255.0);
        let first = at as usize;
        let [low, high] = [self.channels[channel][first], self.channels[channel][first + 1]];
        let latent = low + (at - first as f32) * (high - low);
        // Values above the largest code are latent already.
        if code > 255.0 { latent.max(code) } else { latent }
    }

    /// Replaces changed pixels by their latent values.
    pub fn apply(&self, pixels: &mut PixelRow) {
        for (c, channel) in pixels.rgb.iter_mut().enumerate() {
            for (value, share) in channel.iter_mut().zip(&pixels.share) {
                if *share > 0.0 && !self.identity.contains(value) {
                    *value += share * (self.at(c, *value) - *value);
                }
            }
        }
    }
}
