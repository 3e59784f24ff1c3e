//! The room's surfaces as voxels of 2 cm with position, normal and light.
//!
//! A voxel stores one mean for each frame that saw it, separately for the two halves of the
//! recording, at most [`MAX_FRAME_MEANS`] of each. The lamp search uses their lower third, which
//! excludes specular reflections of lamps: they are seen from a few positions only. The white level
//! uses the median of each channel by Kaplan and Meier, because clipped channels are lower bounds.
//! The normal is the direction of the smallest variance in the neighbourhood. Not modelled: moving
//! objects.

use std::collections::HashMap;

use glam::{DMat3, DVec3, Vec3};

use super::sample::{LightSample, mean_channel, relative_luminance};
use crate::fit::kaplan_meier::{CensoredSample, kaplan_meier};
use crate::fit::symmetric_eigen;
use crate::frame::SURFEL_SPACING_M;
use crate::hash::mix64;
use crate::parallel::over_rows;

/// Side of a voxel, m.
pub const SIDE_M: f64 = SURFEL_SPACING_M;
/// Largest number of voxels for the light, and of frame means in a voxel for each half of the
/// recording.
const MAX_VOXELS: usize = 200_000;
const MAX_FRAME_MEANS: usize = 6;
/// Largest distance of measured depth, m: farther points are too inaccurate for voxels of 2 cm.
const MAX_DISTANCE_M: f32 = 4.0;
/// Quantile of a voxel's frames, by brightness, from which the lamp search takes its light.
const LIGHT_QUANTILE: f64 = 0.34;
/// Neighbourhood of a normal: radius in voxels, and smallest number of voxels.
const NORMAL_RADIUS: i32 = 2;
const MIN_NORMAL_VOXELS: usize = 6;
/// Largest ratio of the smallest to the middle variance of a surface's neighbourhood.
const MAX_FLATNESS: f64 = 0.4;

type VoxelKey = [i32; 3];

/// One frame's mean of a voxel.
#[derive(Clone, Copy, Debug)]
struct FrameMean {
    light: [f32; 3],
    code: [f32; 3],
    clipped: [bool; 3],
}

#[derive(Clone, Debug, Default)]
struct Cube {
    sum_at: DVec3,
    count: u32,
    /// Sum of unit vectors to the camera.
    towards: Vec3,
    /// Sums of the frame that is being added.
    now: [f32; 3],
    now_code: [f32; 3],
    now_count: u32,
    now_clipped: [bool; 3],
    now_brightest: f32,
    /// Sum over frames of the brightest sample of each.
    brightest: f32,
    /// Numbers of frames so far by half, and the means of some of them.
    frames: [u32; 2],
    means: [Vec<FrameMean>; 2],
    clipped: [u32; 2],
}

/// A well-observed voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voxel {
    pub position_m: DVec3,
    /// Unit length, towards the cameras.
    pub normal: DVec3,
    /// Linear light by the first half of the frames, by the second, and by all; `None` where too
    /// few saw it.
    pub light: [Option<[f32; 3]>; 3],
    /// Whether it is clipped in most of the frames.
    pub is_clipped: bool,
    /// Median light of all frames, with clipped channels as lower bounds, and whether each median
    /// is one.
    pub median: [f32; 3],
    pub is_bound: [bool; 3],
    /// Median light of the frames themselves, not divided by their gains.
    pub code: [f32; 3],
    /// Luminance of its brightest sample, mean over frames.
    pub brightest: f32,
}

#[cfg(test)]
impl Voxel {
    /// A voxel with the same light in all frames.
    pub fn of_surface(at: DVec3, normal: DVec3, light: [f32; 3]) -> Self {
        Self {
            position_m: at,
            normal,
            light: [Some(light); 3],
            is_clipped: false,
            median: light,
            is_bound: [false; 3],
            code: light,
            brightest: relative_luminance(light.map(f64::from)) as f32,
        }
    }
}

/// Voxels in cubes, by their place, up to a limit.
#[derive(Clone, Debug)]
pub struct Voxels {
    index: HashMap<VoxelKey, u32>,
    cubes: Vec<Cube>,
    /// Largest number of cubes.
    limit: usize,
}

impl Default for Voxels {
    fn default() -> Self {
        Self::with_limit(MAX_VOXELS)
    }
}

fn key(at: Vec3) -> VoxelKey {
    (at.as_dvec3() / SIDE_M).floor().as_ivec3().to_array()
}

impl Voxels {
    pub fn with_limit(limit: usize) -> Self {
        Self { index: HashMap::new(), cubes: Vec::new(), limit }
    }

    /// Adds the samples of a frame. `camera_at`: the camera's position; `half`: 0 in the first half
    /// of the frames, 1 in the second.
    pub fn add(&mut self, samples: &[LightSample], camera_at: Vec3, half: usize) {
        let mut touched = Vec::new();
        for sample in samples.iter().filter(|sample| sample.position_m.distance(camera_at) < MAX_DISTANCE_M) {
            let key = key(sample.position_m);
            let at = match self.index.get(&key) {
                Some(at) => *at as usize,
                None if self.cubes.len() < self.limit => {
                    self.index.insert(key, self.cubes.len() as u32);
                    self.cubes.push(Cube::default());
                    self.cubes.len() - 1
                }
                None => continue,
            };
            let cube = &mut self.cubes[at];
            if cube.now_count == 0 {
                touched.push(at);
            }
            cube.sum_at += sample.position_m.as_dvec3();
            cube.count += 1;
            cube.towards += (camera_at - sample.position_m).normalize_or_zero();
            for c in 0..3 {
                cube.now[c] += sample.light[c];
                cube.now_code[c] += sample.code[c];
                cube.now_clipped[c] |= sample.clipped[c];
            }
            cube.now_count += 1;
            cube.now_brightest = cube.now_brightest.max(relative_luminance(sample.light.map(f64::from)) as f32);
        }
        for at in touched {
            let cube = &mut self.cubes[at];
            let mean_of = |sums: [f32; 3]| sums.map(|sum| sum / cube.now_count as f32);
            let clipped = cube.now_clipped;
            let mean = FrameMean { light: mean_of(cube.now), code: mean_of(cube.now_code), clipped };
            cube.clipped[half] += u32::from(clipped.contains(&true));
            cube.brightest += cube.now_brightest;
            let n = cube.frames[half] as usize;
            cube.frames[half] += 1;
            let means = &mut cube.means[half];
            if means.len() < MAX_FRAME_MEANS {
                means.push(mean);
            } else {
                // Reservoir sampling (Vitter), with a hash as random number.
                let place = (hash(at as u64, n as u64) % (n as u64 + 1)) as usize;
                if place < MAX_FRAME_MEANS {
                    means[place] = mean;
                }
            }
            (cube.now, cube.now_code, cube.now_count, cube.now_clipped) = ([0.0; 3], [0.0; 3], 0, [false; 3]);
            cube.now_brightest = 0.0;
        }
    }

    /// Positions of all voxels that at least two frames saw.
    pub fn solid(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.cubes.iter().filter(|cube| cube.frames[0] + cube.frames[1] >= 2).map(|cube| cube.middle())
    }

    /// Voxels with a normal that are visible in at least `min_frames`, in an order in which any
    /// prefix is spread evenly over the room.
    pub fn surfaces(&self, min_frames: u32, threads: usize) -> Vec<Voxel> {
        let mut keys: Vec<(u64, VoxelKey, u32)> =
            self.index.iter().map(|(key, at)| (hash_of(key), *key, *at)).collect();
        keys.sort_unstable();
        let mut voxels: Vec<((u64, VoxelKey, u32), Option<Voxel>)> = keys.into_iter().map(|key| (key, None)).collect();
        over_rows(&mut voxels, 1, threads, |_, slot| {
            let ((_, key, at), voxel) = &mut slot[0];
            *voxel = self.voxel(*key, *at as usize, min_frames);
        });
        voxels.into_iter().filter_map(|(_, voxel)| voxel).collect()
    }

    fn voxel(&self, key: VoxelKey, at: usize, min_frames: u32) -> Option<Voxel> {
        let cube = &self.cubes[at];
        let frames = cube.frames[0] + cube.frames[1];
        if frames < min_frames {
            return None;
        }
        let normal = self.normal(key, cube, min_frames)?;
        let means = cube.means.concat();
        let light_of = |half: usize| (cube.frames[half] >= 2).then(|| lower(&cube.means[half])).flatten();
        let light = [light_of(0), light_of(1), lower(&means)];
        let median_of = |of: &dyn Fn(&FrameMean) -> (f32, bool)| {
            let mut values: Vec<CensoredSample> =
                means.iter().map(of).map(|(value, clip)| (value, 1.0, clip)).collect();
            kaplan_meier(&mut values, 0.5).unwrap_or_default()
        };
        let median = [0, 1, 2].map(|c| median_of(&|mean| (mean.light[c], mean.clipped[c])));
        Some(Voxel {
            position_m: cube.middle(),
            normal,
            light,
            is_clipped: 2 * (cube.clipped[0] + cube.clipped[1]) > frames,
            median: median.map(|(value, _)| value),
            is_bound: median.map(|(_, is_bound)| is_bound),
            code: [0, 1, 2].map(|c| median_of(&|mean| (mean.code[c], false)).0),
            brightest: cube.brightest / frames as f32,
        })
    }

    fn normal(&self, [x, y, z]: VoxelKey, cube: &Cube, min_frames: u32) -> Option<DVec3> {
        let mut near = Vec::new();
        for dz in -NORMAL_RADIUS..=NORMAL_RADIUS {
            for dy in -NORMAL_RADIUS..=NORMAL_RADIUS {
                for dx in -NORMAL_RADIUS..=NORMAL_RADIUS {
                    if let Some(at) = self.index.get(&[x + dx, y + dy, z + dz]) {
                        let other = &self.cubes[*at as usize];
                        if other.frames[0] + other.frames[1] >= min_frames {
                            near.push(other.middle());
                        }
                    }
                }
            }
        }
        if near.len() < MIN_NORMAL_VOXELS {
            return None;
        }
        let middle = near.iter().sum::<DVec3>() / near.len() as f64;
        let mut spread = DMat3::ZERO;
        for at in &near {
            let d = *at - middle;
            spread += DMat3::from_cols(d * d.x, d * d.y, d * d.z) * (1.0 / near.len() as f64);
        }
        let [(smallest, normal), (between, _), _] = symmetric_eigen(spread);
        let towards = cube.towards.as_dvec3();
        (smallest < MAX_FLATNESS * between).then(|| normal * normal.dot(towards).signum())
    }
}

impl Cube {
    fn middle(&self) -> DVec3 {
        self.sum_at / f64::from(self.count.max(1))
    }
}

/// The light at [`LIGHT_QUANTILE`] of the frame means.
fn lower(means: &[FrameMean]) -> Option<[f32; 3]> {
    let mut light: Vec<[f32; 3]> = means.iter().map(|mean| mean.light).collect();
    light.sort_by(|a, b| mean_channel(*a).total_cmp(&mean_channel(*b)));
    let at = (LIGHT_QUANTILE * light.len() as f64) as usize;
    light.get(at).copied()
}

fn hash(a: u64, b: u64) -> u64 {
    mix64(a.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ b.wrapping_add(0x632b_e59b_d9b4_e019))
}

fn hash_of([x, y, z]: &VoxelKey) -> u64 {
    hash(hash(*x as u64, *y as u64), *z as u64)
}
