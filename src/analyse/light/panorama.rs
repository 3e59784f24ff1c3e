//! Panorama around a place from the frames' points with depth, by their direction from there.
//!
//! A texel stores one mean per frame. Its light is their median, weighted by their numbers of
//! points, with clipped values as lower bounds. Points behind nearer ones are ignored. Small holes
//! are filled with the mean of their neighbours.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, Vec2, Vec3};

use super::sample::LightSample;
use crate::fit::kaplan_meier::{CensoredSample, kaplan_meier};
use crate::render::panorama;

pub const WIDTH: usize = 256;
pub const HEIGHT: usize = 128;
/// Largest number of frame means in a texel.
const MAX_FRAME_MEANS: usize = 10;
/// Smallest ratio of distances on one surface. A smaller one is an occlusion.
const OCCLUSION_RATIO: f32 = 0.8;
/// Iterations of hole filling, and smallest number of known neighbours.
const FILL_ITERATIONS: usize = 3;
const MIN_NEIGHBOURS: usize = 3;

#[derive(Clone, Debug)]
struct Texel {
    /// Distance of its surface, m.
    far_m: f32,
    /// Frame means: light, weight, clipped channels.
    kept: Vec<([f32; 3], f32, [bool; 3])>,
    frames: usize,
    now: [f32; 3],
    now_count: f32,
    now_clipped: [bool; 3],
    now_far_m: f32,
}

/// Observations of each direction from a place, world axes, m.
pub struct PanoramaBuilder {
    middle: Vec3,
    map_from_world: DQuat,
    texels: Vec<Texel>,
}

/// Linear light by texel; `None` where unseen.
pub type PartialPanorama = Vec<Option<[f32; 3]>>;

/// The direction through a texel's centre, in the panorama's axes: y is up, −z in the middle.
pub fn direction(n: usize) -> DVec3 {
    panorama::direction((n % WIDTH) as u32, (n / WIDTH) as u32, WIDTH as u32, HEIGHT as u32).as_dvec3()
}

/// A texel's solid angle, sr.
pub fn solid_sr(n: usize) -> f64 {
    f64::from(panorama::solid_sr((n / WIDTH) as u32, WIDTH as u32, HEIGHT as u32))
}

fn texel_of(d: Vec3) -> usize {
    let Vec2 { x, y } = panorama::texel_coordinates(d, WIDTH as u32, HEIGHT as u32);
    (y as usize).min(HEIGHT - 1) * WIDTH + (x as usize).min(WIDTH - 1)
}

impl PanoramaBuilder {
    pub fn new(middle: Vec3, map_from_world: DQuat) -> Self {
        let none = Texel {
            far_m: f32::INFINITY,
            kept: Vec::new(),
            frames: 0,
            now: [0.0; 3],
            now_count: 0.0,
            now_clipped: [false; 3],
            now_far_m: 0.0,
        };
        Self { middle, map_from_world, texels: vec![none; WIDTH * HEIGHT] }
    }

    /// Adds the samples of one frame.
    pub fn add(&mut self, samples: &[LightSample]) {
        let turn = self.map_from_world.as_quat();
        let mut touched = Vec::new();
        for sample in samples {
            let way = sample.position_m - self.middle;
            let far_m = way.length();
            if far_m < 1e-3 {
                continue;
            }
            let n = texel_of(turn * (way / far_m));
            let texel = &mut self.texels[n];
            if texel.now_count == 0.0 {
                touched.push(n);
            } else if far_m > texel.now_far_m / OCCLUSION_RATIO {
                continue;
            }
            if texel.now_count > 0.0 && far_m < OCCLUSION_RATIO * texel.now_far_m {
                (texel.now, texel.now_count, texel.now_clipped) = ([0.0; 3], 0.0, [false; 3]);
            }
            texel.now_far_m = if texel.now_count == 0.0 { far_m } else { texel.now_far_m.min(far_m) };
            (0..3).for_each(|c| texel.now[c] += sample.light[c]);
            texel.now_count += 1.0;
            (0..3).for_each(|c| texel.now_clipped[c] |= sample.clipped[c]);
        }
        for n in touched {
            self.texels[n].kept_frame();
        }
    }

    /// The light of each texel.
    pub fn finish(&self) -> PartialPanorama {
        let texel_light = |texel: &Texel| -> Option<[f32; 3]> {
            let light = |c: usize| {
                let mut values: Vec<CensoredSample> =
                    texel.kept.iter().map(|(light, w, clip)| (light[c], *w, clip[c])).collect();
                Some(kaplan_meier(&mut values, 0.5)?.0)
            };
            Some([light(0)?, light(1)?, light(2)?])
        };
        let mut texels: PartialPanorama = self.texels.iter().map(texel_light).collect();
        for _ in 0..FILL_ITERATIONS {
            texels = filled(&texels);
        }
        texels
    }
}

impl Texel {
    fn kept_frame(&mut self) {
        let mean = self.now.map(|sum| sum / self.now_count);
        if self.now_far_m < OCCLUSION_RATIO * self.far_m {
            self.kept.clear();
            (self.frames, self.far_m) = (0, self.now_far_m);
        }
        if self.now_far_m <= self.far_m / OCCLUSION_RATIO {
            let new = (mean, self.now_count, self.now_clipped);
            // If there are too many, every third frame replaces an earlier one.
            if self.kept.len() < MAX_FRAME_MEANS {
                self.kept.push(new);
            } else if self.frames.is_multiple_of(3) {
                self.kept[self.frames / 3 % MAX_FRAME_MEANS] = new;
            }
            self.frames += 1;
        }
        (self.now, self.now_count, self.now_clipped, self.now_far_m) = ([0.0; 3], 0.0, [false; 3], 0.0);
    }
}

fn filled(partial: &PartialPanorama) -> PartialPanorama {
    let at = |x: i64, y: i64| -> Option<[f32; 3]> {
        let y = usize::try_from(y).ok().filter(|y| *y < HEIGHT)?;
        partial[y * WIDTH + x.rem_euclid(WIDTH as i64) as usize]
    };
    let filled_texel = |n: usize| {
        let (x, y) = ((n % WIDTH) as i64, (n / WIDTH) as i64);
        let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
        let neighbours: Vec<[f32; 3]> = around.iter().filter_map(|(dx, dy)| at(x + dx, y + dy)).collect();
        let mean = |c: usize| neighbours.iter().map(|light| light[c]).sum::<f32>() / neighbours.len() as f32;
        (neighbours.len() >= MIN_NEIGHBOURS).then(|| [mean(0), mean(1), mean(2)])
    };
    (0..partial.len()).map(|n| partial[n].or_else(|| filled_texel(n))).collect()
}

/// Fractions of all directions, and of those above the horizon, that were seen.
pub fn coverage(partial: &PartialPanorama) -> (f64, f64) {
    let sum = |from: usize, to: usize| {
        let covered_sr = |n: usize| if partial[n].is_some() { solid_sr(n) } else { 0.0 };
        (from..to).map(covered_sr).sum::<f64>()
    };
    (sum(0, WIDTH * HEIGHT) / (4.0 * PI), sum(0, WIDTH * HEIGHT / 2) / (2.0 * PI))
}

/// Light of an upward-facing matt white surface: the irradiance from above by π.
pub fn upward(rgb: &[[f32; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|c| {
        let irradiance =
            |(n, light): (usize, &[f32; 3])| f64::from(light[c]) * direction(n).y.max(0.0) * solid_sr(n) / PI;
        rgb.iter().enumerate().map(irradiance).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_sky_lights_white_by_its_radiance_and_directions_map_back_to_their_texels() {
        let [r, g, b] = upward(&vec![[0.5, 1.0, 2.0]; WIDTH * HEIGHT]);
        assert!((r - 0.5).abs() < 1e-3 && (g - 1.0).abs() < 2e-3 && (b - 2.0).abs() < 4e-3, "{r} {g} {b}");
        for n in (0..WIDTH * HEIGHT).step_by(37) {
            assert_eq!(texel_of(direction(n).as_vec3()), n);
        }
    }

    #[test]
    fn points_behind_nearer_ones_are_ignored() {
        let mut splat = PanoramaBuilder::new(Vec3::ZERO, DQuat::IDENTITY);
        let sample = |far_m: f32, light: f32| LightSample {
            position_m: -far_m * Vec3::Z,
            light: [light; 3],
            code: [light; 3],
            clipped: [false; 3],
        };
        splat.add(&[sample(3.0, 0.9)]);
        splat.add(&[sample(1.0, 0.2), sample(1.02, 0.4)]);
        splat.add(&[sample(3.0, 0.9)]);
        let n = texel_of(-Vec3::Z);
        let [light, ..] = splat.finish()[n].unwrap();
        assert!((light - 0.3).abs() < 1e-6, "{light}");
    }
}
