//! The noise at lattice points: white normal noise, filtered and mixed as described in
//! src/effects/noise.rs; variance 1.
//!
//! Computed by shaders. On a software adapter it is computed on the CPU, in a fifth of the shaders'
//! time: software drivers are slow at texel lookups.

use std::sync::LazyLock;

use statrs::distribution::{ContinuousCDF, Normal};

use crate::camera::{NoiseProfile, side_tap};
use crate::fit::cholesky::correlation_factor;
use crate::gpu::{Gpu, PassRecorder, Shader, Texture};
pub use crate::hash::pcg3d;
use crate::pixels::Rect;

/// Format of the pattern, in units of σ/4096.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Sint;

/// Identifies a noise pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    key: [u32; 3],
    /// Side taps a of the filters (a, 1, a), across and down.
    taps: [f64; 2],
    /// [`correlation_factor`] of the channels.
    factor: [f64; 5],
}

/// Side of the square table of quantiles.
const TABLE_SIDE: u32 = 64;
/// The table's unit, σ.
pub const TABLE_UNIT: f64 = 1.0 / 4096.0;

/// Quantiles of the normal distribution at (i + ½)/4096, rounded to units of σ/4096 and scaled so
/// that the table's own variance is 1. No memo: a constant table.
pub static NORMAL_TABLE: LazyLock<Vec<i16>> = LazyLock::new(|| {
    let count = TABLE_SIDE * TABLE_SIDE;
    let normal = Normal::standard();
    let quantiles: Vec<f64> = (0..count).map(|i| normal.inverse_cdf((f64::from(i) + 0.5) / f64::from(count))).collect();
    let variance = quantiles.iter().map(|q| q * q).sum::<f64>() / f64::from(count);
    quantiles.iter().map(|q| (q / variance.sqrt() / TABLE_UNIT).round() as i16).collect()
});

crate::uniform! {
    struct WhiteUniform { key: [u32; 4], origin: [i32; 2] }
}

crate::uniform! {
    struct FilterUniform { side: [f32; 2], norm: f32, l21: f32, l22: f32, l31: f32, l32: f32, l33: f32 }
}

/// The table of quantiles on the GPU.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Quantiles;

fn quantiles(gpu: &Gpu, _: &Quantiles) -> Texture {
    let table = Texture::new(gpu, "normal quantiles", TABLE_SIDE, TABLE_SIDE, wgpu::TextureFormat::R16Sint, 1);
    table.write(gpu, TABLE_SIDE, TABLE_SIDE, &NORMAL_TABLE);
    table
}

impl Pattern {
    /// The pattern of a frame. `delay`: number of frames with the same pattern. Without a profile
    /// it is white, and independent in each channel.
    pub fn new(profile: Option<&NoiseProfile>, seed: u64, frame: usize, delay: u32) -> Self {
        let (neighbours, channels) =
            profile.map_or(([0.0; 2], [0.0; 3]), |n| (n.neighbour_correlation, n.channel_correlation));
        let key = pattern_key(seed, frame, delay);
        Self { key, taps: neighbours.map(side_tap), factor: correlation_factor(channels) }
    }

    /// The neighbour correlation that the filter achieves, which may be below the measured one.
    pub fn achieved_correlation(&self) -> [f32; 2] {
        self.taps.map(|a| (2.0 * a / (1.0 + 2.0 * a * a)) as f32)
    }

    /// Factor that normalizes the variance to 1.
    fn norm(&self) -> f32 {
        self.taps.iter().map(|a| 1.0 + 2.0 * a * a).product::<f64>().sqrt().recip() as f32
    }

    /// The pattern at the points of a rectangle.
    pub fn texture(&self, recorder: &mut PassRecorder, lattice: Rect) -> Texture {
        if recorder.gpu.software() { self.on_cpu(recorder, lattice) } else { self.on_gpu(recorder, lattice) }
    }

    fn on_gpu(&self, recorder: &mut PassRecorder, lattice: Rect) -> Texture {
        let [x, y, z] = self.key;
        let white = WhiteUniform { key: [x, y, z, 0], origin: [lattice.x0 - 1, lattice.y0 - 1] };
        let around = (lattice.width() + 2, lattice.height() + 2);
        let table = recorder.memoized(Quantiles, quantiles);
        let pass = recorder.pass(Shader::NoiseWhite, "main").uniform("white", &white);
        let [white] = pass.texture("normal_table", &table).draw([FORMAT], around);

        let [l21, l22, l31, l32, l33] = self.factor.map(|v| v as f32);
        let filter =
            FilterUniform { side: self.taps.map(|tap| tap as f32), norm: self.norm(), l21, l22, l31, l32, l33 };
        let entry = if self.taps == [0.0; 2] { "unfiltered" } else { "filtered" };
        let pass = recorder.pass(Shader::NoisePattern, entry).uniform("pattern", &filter).texture("white", &white);
        let [pattern] = pass.draw([FORMAT], (lattice.width(), lattice.height()));
        pattern
    }

    fn on_cpu(&self, recorder: &mut PassRecorder, lattice: Rect) -> Texture {
        let pattern = recorder.pool.lend(&recorder.gpu, (lattice.width(), lattice.height()), FORMAT);
        let texel = size_of::<[i16; 4]>() as u32;
        let stride = (lattice.width() * texel).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let mut texels = vec![[0; 4]; (stride / texel * lattice.height()) as usize];
        self.fill(lattice, (stride / texel) as usize, &mut texels);
        let bytes = bytemuck::cast_slice(&texels);
        let buffer = recorder.gpu.buffer("noise pattern", bytes, wgpu::BufferUsages::COPY_SRC);
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: None };
        recorder.encoder().copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            pattern.texture.as_image_copy(),
            wgpu::Extent3d { width: lattice.width(), height: lattice.height(), depth_or_array_layers: 1 },
        );
        pattern
    }

    /// The same as shaders/noise_white.wgsl and shaders/noise_pattern.wgsl, in the same order; rows
    /// are `stride` apart.
    fn fill(&self, lattice: Rect, stride: usize, texels: &mut [[i16; 4]]) {
        let (width, table) = (lattice.width() as usize, NORMAL_TABLE.as_slice());
        let [a, b] = self.taps.map(|tap| tap as f32);
        let norm = self.norm();
        let [l21, l22, l31, l32, l33] = self.factor.map(|v| v as f32);
        let quantile = |hash: u32| f32::from(table[(hash >> 20) as usize]);
        let mut white = vec![[0.0f32; 3]; width + 2];
        // Filtered across: the row and its neighbours.
        let mut rows = [const { Vec::new() }; 3].map(|_: Vec<[f32; 3]>| vec![[0.0f32; 3]; width]);
        for (n, y) in (lattice.y0 - 1..=lattice.y1).enumerate() {
            for (x, texel) in (lattice.x0 - 1..).zip(&mut white) {
                let [kx, ky, kz] = self.key;
                *texel = pcg3d([(x as u32).wrapping_add(kx), (y as u32).wrapping_add(ky), kz]).map(quantile);
            }
            rows.rotate_left(1);
            for (out, three) in rows[2].iter_mut().zip(white.windows(3)) {
                *out = std::array::from_fn(|c| three[1][c] + a * (three[0][c] + three[2][c]));
            }
            let Some(out) = n.checked_sub(2).and_then(|row| texels.get_mut(row * stride..row * stride + width)) else {
                continue;
            };
            let [above, own, below] = &rows;
            for (((texel, above), own), below) in out.iter_mut().zip(above).zip(own).zip(below) {
                let [x, y, z]: [f32; 3] = std::array::from_fn(|c| (own[c] + b * (above[c] + below[c])) * norm);
                *texel = [rounded(x), rounded(l21 * x + l22 * y), rounded(l31 * x + l32 * y + l33 * z), 0];
            }
        }
    }
}

/// Rounds to the nearest 16-bit integer, halves to even: adding the constant leaves no fractional
/// bits.
fn rounded(value: f32) -> i16 {
    const UNIT: f32 = 12_582_912.0;
    ((value + UNIT) - UNIT) as i16
}

/// Offset of a frame's pattern in the hash's domain. Offsets are so far apart that no two frames or
/// seeds have shifted copies of each other.
pub fn pattern_key(seed: u64, frame: usize, delay: u32) -> [u32; 3] {
    let pattern = frame as u64 / u64::from(delay.max(1));
    let folded = pcg3d([seed as u32, (seed >> 32) as u32, 0x6c6f_6361]);
    pcg3d([pattern as u32 ^ folded[0], (pattern >> 32) as u32 ^ folded[1], folded[2]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::ReadbackSet;

    #[test]
    fn pattern_of_the_shaders_equals_that_of_the_cpu() {
        let mut recorder = PassRecorder::new(Gpu::open().expect("an adapter"));
        let lattice = Rect::new(-7, 11, 70, 52);
        let profile = |neighbour_correlation| NoiseProfile {
            example: None,
            channel_correlation: [0.5, -0.3, 0.2],
            neighbour_correlation,
            bins: Default::default(),
        };
        for neighbours in [[0.0, 0.0], [0.6, 0.3]] {
            let pattern = Pattern::new(Some(&profile(neighbours)), 7, 3, 1);
            let [drawn, written] = [true, false].map(|by_shaders| {
                let size = (lattice.width(), lattice.height());
                let texture = if by_shaders {
                    pattern.on_gpu(&mut recorder, lattice)
                } else {
                    pattern.on_cpu(&mut recorder, lattice)
                };
                let mut readback = recorder.read_back(&mut ReadbackSet::default(), &texture, size);
                readback.submitted(recorder.submit());
                let mut words: Vec<i16> = Vec::new();
                let read = readback.rows(&recorder.gpu, |_, row| {
                    words.extend(row.chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])));
                });
                read.expect("read back");
                words
            });
            assert_eq!(drawn.len(), 4 * 77 * 41);
            assert!(drawn.iter().filter(|&&v| v.abs() > 2048).count() > 3000, "half of a σ is exceeded often");
            // A driver may fuse a product and a sum: one unit, σ/4096.
            let off = drawn.iter().zip(&written).map(|(d, w)| d.abs_diff(*w)).max();
            assert!(off <= Some(1), "{neighbours:?}: {off:?}");
        }
    }

    #[test]
    fn taps_achieve_the_requested_correlation() {
        for rho in [0.0, 0.1, 0.45, 0.6, 0.7] {
            let a = side_tap(rho);
            assert!((2.0 * a / (1.0 + 2.0 * a * a) - rho).abs() < 1e-9, "{rho}");
        }
    }

    #[test]
    fn quantile_table_has_the_moments_of_a_normal_distribution() {
        let t: Vec<f64> = NORMAL_TABLE.iter().map(|&v| f64::from(v) * TABLE_UNIT).collect();
        let n = t.len() as f64;
        let moment = |p: i32| t.iter().map(|v| v.powi(p)).sum::<f64>() / n;
        assert!(moment(1).abs() < 1e-3);
        assert!((moment(2) - 1.0).abs() < 1e-3);
        // The normal distribution's fourth moment is 3; a table of 4096 lacks the far tails.
        assert!((moment(4) - 3.0).abs() < 0.1, "{}", moment(4));
    }

    #[test]
    fn pcg3d_matches_the_papers_listing() {
        // Worked by hand through the paper's listing with 32-bit wrap-around, for the zero vector:
        // after the affine step all three are 1013904223.
        let c: u32 = 1_013_904_223;
        let x = c.wrapping_add(c.wrapping_mul(c));
        let y = c.wrapping_add(c.wrapping_mul(x));
        let z = c.wrapping_add(x.wrapping_mul(y));
        let (x, y, z) = (x ^ (x >> 16), y ^ (y >> 16), z ^ (z >> 16));
        let x = x.wrapping_add(y.wrapping_mul(z));
        let y = y.wrapping_add(z.wrapping_mul(x));
        let z = z.wrapping_add(x.wrapping_mul(y));
        assert_eq!(pcg3d([0, 0, 0]), [x, y, z]);
    }
}
