//! The noise at lattice points: white normal noise, filtered and mixed as src/effects/noise.rs says; variance 1.
//!
//! By shaders; where the adapter is this machine's processor, by the processor itself, which takes a fifth of the shaders'
//! time: looking up texels is what drivers in software are slow at.

use std::sync::LazyLock;

use statrs::distribution::{ContinuousCDF, Normal};

use crate::camera::{NoiseProfile, side_tap};
use crate::gpu::{FullscreenPass, Gpu, Options, Slot, Texture, assemble, constants};
use crate::image::Rect;
use crate::render::LayerRun;

/// 4096ths of σ.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Sint;

/// Which noise it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    key: [u32; 3],
    /// Of (a, 1, a) across and down.
    taps: [f64; 2],
    /// Of the channels' correlation.
    cholesky: [f64; 5],
}

/// The shaders, with what they read.
#[derive(Debug)]
pub struct Passes {
    normal_table: Texture,
    white: FullscreenPass,
    /// Without and with correlation of neighbours.
    pattern: [FullscreenPass; 2],
}

/// Side of the square table of quantiles.
const TABLE_SIDE: u32 = 64;
/// The table's unit, σ.
pub const TABLE_UNIT: f64 = 1.0 / 4096.0;

/// The normal distribution's quantiles at (i + ½)/4096 in whole 4096ths of σ, scaled so that
/// the table's own variance is 1.
pub static NORMAL_TABLE: LazyLock<Vec<i16>> = LazyLock::new(|| {
    let count = TABLE_SIDE * TABLE_SIDE;
    let normal = Normal::standard();
    let quantiles: Vec<f64> = (0..count).map(|i| normal.inverse_cdf((f64::from(i) + 0.5) / f64::from(count))).collect();
    let variance = quantiles.iter().map(|q| q * q).sum::<f64>() / f64::from(count);
    quantiles.iter().map(|q| (q / variance.sqrt() / TABLE_UNIT).round() as i16).collect()
});

/// `White` of shaders/noise_white.wgsl.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct WhiteUniform {
    key: [u32; 4],
    origin: [i32; 4],
}

/// `Pattern` of shaders/noise_pattern.wgsl.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct PatternUniform {
    filter_shape: [f32; 4],
    mix_a: [f32; 4],
    mix_b: [f32; 4],
}

/// pcg3d of Jarzynski and Olano 2020.
pub fn pcg3d(v: [u32; 3]) -> [u32; 3] {
    let [mut x, mut y, mut z] = v.map(|c| c.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    for round in 0..2 {
        x = x.wrapping_add(y.wrapping_mul(z));
        y = y.wrapping_add(z.wrapping_mul(x));
        z = z.wrapping_add(x.wrapping_mul(y));
        if round == 0 {
            x ^= x >> 16;
            y ^= y >> 16;
            z ^= z >> 16;
        }
    }
    [x, y, z]
}

/// Lower triangle (l21, l22, l31, l32, l33) of the Cholesky factor of the channels'
/// correlation (r-g, r-b, g-b); correlations that no three channels can have are drawn
/// towards 0 until they can.
pub fn cholesky(correlation: [f64; 3]) -> [f64; 5] {
    let mut shrink = 1.0f64;
    loop {
        let [rg, rb, gb] = correlation.map(|c| c.clamp(-1.0, 1.0) * shrink);
        let l22 = (1.0 - rg * rg).max(0.0).sqrt();
        let l32 = if l22 > 1e-9 { (gb - rb * rg) / l22 } else { 0.0 };
        let rest = 1.0 - rb * rb - l32 * l32;
        if rest >= 0.0 {
            return [rg, l22, rb, l32, rest.sqrt()];
        }
        shrink *= 0.98;
    }
}

impl Passes {
    fn new(gpu: &Gpu) -> Self {
        let table = Texture::new(gpu, "normal quantiles", TABLE_SIDE, TABLE_SIDE, wgpu::TextureFormat::R16Sint, 1);
        table.write(gpu, TABLE_SIDE, TABLE_SIDE, &NORMAL_TABLE);
        let pass = |name, fragment| {
            let options = Options { fragment, ..Options::default() };
            FullscreenPass::with(gpu, name, &assemble(name), &[FORMAT], &options)
        };
        Self {
            normal_table: table,
            white: pass("noise_white", "main"),
            pattern: ["unfiltered", "filtered"].map(|fragment| pass("noise_pattern", fragment)),
        }
    }
}

impl Pattern {
    /// Of a frame; `delay`: for how many frames a pattern stays. Without a profile white, and equal in no two channels.
    pub fn new(profile: Option<&NoiseProfile>, seed: u64, frame: usize, delay: u32) -> Self {
        let (neighbours, channels) =
            profile.map_or(([0.0; 2], [0.0; 3]), |n| (n.neighbour_correlation, n.channel_correlation));
        let key = pattern_key(seed, frame, delay);
        Self { key, taps: neighbours.map(side_tap), cholesky: cholesky(channels) }
    }

    /// The neighbour correlation that the filter gives, where the wish lies beyond its reach.
    pub fn given(&self) -> [f32; 2] {
        self.taps.map(|a| (2.0 * a / (1.0 + 2.0 * a * a)) as f32)
    }

    /// Factor to variance 1.
    fn norm(&self) -> f32 {
        self.taps.iter().map(|a| 1.0 + 2.0 * a * a).product::<f64>().sqrt().recip() as f32
    }

    /// At the points of a rectangle.
    pub fn texture(&self, run: &mut LayerRun<'_>, passes: &mut Option<Passes>, lattice: Rect) -> Texture {
        let pattern = run.pool.get(run.gpu, "noise pattern", 0, (lattice.width(), lattice.height()), FORMAT, 1);
        if run.gpu.software() {
            self.write(run, lattice, &pattern);
        } else {
            self.draw(run, passes.get_or_insert_with(|| Passes::new(run.gpu)), lattice, &pattern);
        }
        pattern
    }

    fn draw(&self, run: &mut LayerRun<'_>, passes: &Passes, lattice: Rect, pattern: &Texture) {
        let gpu = run.gpu;
        let [x, y, z] = self.key;
        let white = WhiteUniform { key: [x, y, z, 0], origin: [lattice.x0 - 1, lattice.y0 - 1, 0, 0] };
        let white = constants(gpu, "noise_white", bytemuck::bytes_of(&white));
        let around = (lattice.width() + 2, lattice.height() + 2);
        let lattice_noise = run.pool.get(gpu, "white noise", 0, around, FORMAT, 1);
        let slots = [Slot::Buffer(&white), Slot::Texture(&passes.normal_table.view)];
        passes.white.run(gpu, run.encoder, &slots, &[&lattice_noise], around);

        let l = self.cholesky.map(|v| v as f32);
        let uniform = PatternUniform {
            filter_shape: [self.taps[0] as f32, self.taps[1] as f32, self.norm(), 0.0],
            mix_a: [l[0], l[1], l[2], l[3]],
            mix_b: [l[4], 0.0, 0.0, 0.0],
        };
        let uniform = constants(gpu, "noise_pattern", bytemuck::bytes_of(&uniform));
        let slots = [Slot::Buffer(&uniform), Slot::Texture(&lattice_noise.view)];
        let pass = &passes.pattern[usize::from(self.taps != [0.0; 2])];
        pass.run(gpu, run.encoder, &slots, &[pattern], (lattice.width(), lattice.height()));
    }

    fn write(&self, run: &mut LayerRun<'_>, lattice: Rect, pattern: &Texture) {
        use wgpu::util::DeviceExt;
        let texel = size_of::<[i16; 4]>() as u32;
        let stride = (lattice.width() * texel).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let mut texels = vec![[0; 4]; (stride / texel * lattice.height()) as usize];
        self.fill(lattice, (stride / texel) as usize, &mut texels);
        // Copied on the way, and not ahead of all that is recorded: another part of the frame may use the texture before.
        let buffer = run.gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("noise pattern"),
            contents: bytemuck::cast_slice(&texels),
            usage: wgpu::BufferUsages::COPY_SRC,
        });
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride), rows_per_image: None };
        run.encoder.copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            pattern.texture.as_image_copy(),
            wgpu::Extent3d { width: lattice.width(), height: lattice.height(), depth_or_array_layers: 1 },
        );
    }

    /// As shaders/noise_white.wgsl and shaders/noise_pattern.wgsl do, in the same order; rows `stride` apart.
    fn fill(&self, lattice: Rect, stride: usize, texels: &mut [[i16; 4]]) {
        let (width, table) = (lattice.width() as usize, NORMAL_TABLE.as_slice());
        let [a, b] = self.taps.map(|tap| tap as f32);
        let norm = self.norm();
        let [l21, l22, l31, l32, l33] = self.cholesky.map(|v| v as f32);
        let quantile = |hash: u32| f32::from(table[(hash >> 20) as usize]);
        let mut white = vec![[0.0f32; 3]; width + 2];
        // Filtered across: of the row and of its neighbours.
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
                *texel = [whole(x), whole(l21 * x + l22 * y), whole(l31 * x + l32 * y + l33 * z), 0];
            }
        }
    }
}

/// The nearest whole number of 16 bits, halves to the even one: what is added leaves no bits behind the point.
fn whole(value: f32) -> i16 {
    const UNIT: f32 = 12_582_912.0;
    ((value + UNIT) - UNIT) as i16
}

/// Where in the endless hash a frame's pattern lies: so far apart that no two frames or seeds
/// show shifted copies of each other.
pub fn pattern_key(seed: u64, frame: usize, delay: u32) -> [u32; 3] {
    let pattern = frame as u64 / u64::from(delay.max(1));
    let folded = pcg3d([seed as u32, (seed >> 32) as u32, 0x6c6f_6361]);
    pcg3d([pattern as u32 ^ folded[0], (pattern >> 32) as u32 ^ folded[1], folded[2]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{ReadbackSet, TexturePool};

    #[test]
    fn shaders_and_processor_make_the_same_pattern() {
        let gpu = Gpu::open().expect("an adapter");
        let mut pool = TexturePool::default();
        let passes = Passes::new(&gpu);
        let lattice = Rect::new(-7, 11, 70, 52);
        let profile = |neighbour_correlation| NoiseProfile {
            channel_correlation: [0.5, -0.3, 0.2],
            neighbour_correlation,
            bins: Default::default(),
        };
        for neighbours in [[0.0, 0.0], [0.6, 0.3]] {
            let pattern = Pattern::new(Some(&profile(neighbours)), 7, 3, 1);
            let [drawn, written] = [true, false].map(|by_shaders| {
                let mut encoder = gpu.device.create_command_encoder(&Default::default());
                let size = (lattice.width(), lattice.height());
                let mut run = LayerRun { gpu: &gpu, encoder: &mut encoder, pool: &mut pool, geometry_is_read: false };
                let texture = run.pool.get(&gpu, "noise pattern", 0, size, FORMAT, 1);
                match by_shaders {
                    true => pattern.draw(&mut run, &passes, lattice, &texture),
                    false => pattern.write(&mut run, lattice, &texture),
                }
                let mut readback = ReadbackSet::default().copy(&gpu, &mut encoder, &texture, size);
                readback.submitted(gpu.queue.submit([encoder.finish()]));
                let mut words: Vec<i16> = Vec::new();
                let read = readback.rows(&gpu, |_, row| {
                    words.extend(row.chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])));
                });
                read.expect("read back");
                words
            });
            assert_eq!(drawn.len(), 4 * 77 * 41);
            assert!(drawn.iter().filter(|&&v| v.abs() > 2048).count() > 3000, "half of a σ is passed often");
            // A driver may fuse a product and a sum: a 4096th of σ.
            let off = drawn.iter().zip(&written).map(|(d, w)| d.abs_diff(*w)).max();
            assert!(off <= Some(1), "{neighbours:?}: {off:?}");
        }
    }

    #[test]
    fn taps_give_the_correlation_asked_for() {
        for rho in [0.0, 0.1, 0.45, 0.6, 0.7] {
            let a = side_tap(rho);
            assert!((2.0 * a / (1.0 + 2.0 * a * a) - rho).abs() < 1e-9, "{rho}");
        }
    }

    #[test]
    fn cholesky_by_hand() {
        // rg = 0.6: l21 = 0.6, l22 = 0.8; rb = 0: l31 = 0; gb = 0.4: l32 = 0.5; l33 = √0.75.
        let l = cholesky([0.6, 0.0, 0.4]);
        for (got, want) in l.iter().zip([0.6, 0.8, 0.0, 0.5, 0.75f64.sqrt()]) {
            assert!((got - want).abs() < 1e-12, "{l:?}");
        }
        assert!(cholesky([1.0, -1.0, 1.0]).iter().all(|v| v.is_finite()));
    }

    #[test]
    fn the_table_is_normal() {
        let t: Vec<f64> = NORMAL_TABLE.iter().map(|&v| f64::from(v) * TABLE_UNIT).collect();
        let n = t.len() as f64;
        let moment = |p: i32| t.iter().map(|v| v.powi(p)).sum::<f64>() / n;
        assert!(moment(1).abs() < 1e-3);
        assert!((moment(2) - 1.0).abs() < 1e-3);
        // The normal distribution's fourth moment is 3; a table of 4096 lacks the far tails.
        assert!((moment(4) - 3.0).abs() < 0.1, "{}", moment(4));
    }

    #[test]
    fn pcg3d_reference_values() {
        // Worked through the paper's listing with 32-bit wrap-around by hand for the zero
        // vector: after the affine step all three are 1013904223.
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
