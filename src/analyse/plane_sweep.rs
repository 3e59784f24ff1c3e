//! Plane-sweep stereo: depth of a frame from its neighbours, for footage without a depth sensor.
//!
//! A plane sweep (Collins 1996) over inverse depth that sums the costs of all neighbours (Okutomi
//! and Kanade 1993). The cost is the Hamming distance of ternary census transforms (Zabih and
//! Woodfill 1994), which do not depend on exposure. Semi-global matching regularizes the result
//! (Hirschmüller 2008). Poses must be accurate to about a pixel, in any unit of length.
//!
//! The depth is sufficient for light, flow and edges, which tolerate a pixel of error. It is not
//! used for poses, whose errors it reproduces. Not modelled: rolling shutter, moving objects.

use std::collections::VecDeque;

use glam::{DAffine3, DVec2, DVec3};

use super::camera_model::CameraModel;
use super::state::CameraState;
use crate::camera::Geometry;
use crate::fit::quantile::upper_median;
use crate::frame::Frame;
use crate::grey_image::{GreyImage, gaussian};
use crate::parallel::over_rows;
use crate::recording::{Frames, Recording, RecordingError};

/// Largest width of the reduced pictures, px.
const MAX_WIDTH_PX: usize = 200;
/// Distances of candidate neighbours on both sides, and the largest, frames.
const NEIGHBOUR_GAPS: [usize; 5] = [1, 2, 4, 8, 16];
const MAX_GAP: usize = 16;
/// Largest number of neighbours: those with the longest baselines among those with a similar
/// viewing direction, rad.
const MAX_NEIGHBOURS: usize = 4;
const MAX_VIEW_ANGLE_RAD: f64 = 0.35;
/// Number of inverse depths. At the largest, the disparity to the farthest neighbour is usually
/// this fraction of the width.
const PLANES: usize = 64;
const MAX_DISPARITY_SHARE: f64 = 0.3;
/// Distance between the points at which the warp to a neighbour is computed, px of the reduced
/// picture.
const CELL: usize = 8;
/// Codes that differ by less count as equal in the census.
const CENSUS_THRESHOLD: f32 = 2.0;
/// Half-width of the census window, px of the reduced picture.
const CENSUS_RADIUS: usize = 2;
/// Cost of a pixel outside a neighbour's picture, bits of 48, and scale of the costs.
const OUTSIDE_COST: u32 = 14;
const COST_SCALE: u32 = 4;
/// Largest difference between inverse depths of one surface, planes, and typical depth of the scene
/// by the largest inverse depth.
const DEPTH_TOLERANCE_PLANES: f64 = 1.5;
const TYPICAL_PLANE_SHARE: f64 = 0.3;
/// Penalties of semi-global matching for steps of one plane and of more.
const SMALL_STEP_PENALTY: u16 = 12;
const LARGE_STEP_PENALTY: u16 = 96;
/// Sigma filter of the result: half-width of its window, and largest difference, planes.
const FILTER_RADIUS: usize = 4;
const FILTER_RANGE_PLANES: f32 = 1.5;

/// Computes depth of frames in order. It reads the recording ahead of them.
pub struct PlaneSweep<'a> {
    model: &'a CameraModel,
    states: &'a [Option<CameraState>],
    threads: usize,
    frames: Frames,
    window: VecDeque<Small>,
    /// Distance between two planes, 1/m or in the inverse of the recording's unit.
    step: f64,
}

struct Small {
    index: usize,
    width: usize,
    height: usize,
    census: Vec<u64>,
}

/// Positions in a neighbour by cell corner and plane, px of the reduced pictures.
struct NeighbourPositions<'a> {
    to: &'a Small,
    across: usize,
    at: Vec<[f32; 2]>,
}

impl<'a> PlaneSweep<'a> {
    pub fn new(
        model: &'a CameraModel,
        recording: &Recording,
        states: &'a [Option<CameraState>],
        threads: usize,
    ) -> Result<Self, RecordingError> {
        let frames = recording.frames(0..recording.frame_count())?;
        let step = step(&model.geometry, states);
        Ok(Self { model, states, threads, frames, window: VecDeque::new(), step })
    }

    /// A frame's depth at full size, 0 where unknown. Frames must be requested in ascending order.
    pub fn depth(&mut self, index: usize) -> Result<Vec<f32>, RecordingError> {
        while self.window.back().is_none_or(|last| last.index < index + MAX_GAP) {
            let Some(frame) = self.frames.next() else { break };
            self.window.push_back(Small::new(self.model, &frame?));
        }
        while self.window.front().is_some_and(|first| first.index + MAX_GAP < index) {
            self.window.pop_front();
        }
        let (width, height) = self.model.size();
        let small = self.window.iter().find(|small| small.index == index);
        let (Some(small), Some(state)) = (small, self.states[index]) else { return Ok(vec![0.0; width * height]) };
        let near = neighbours(self.states, index);
        let to = |n: usize| self.window.iter().find(|small| small.index == n);
        let mapped: Vec<NeighbourPositions<'_>> = near
            .iter()
            .filter_map(|(_, n)| Some((to(*n)?, self.states[*n]?)))
            .map(|(to, there)| self.mapped(small, to, &(there.world_from_camera.inverse() * state.world_from_camera)))
            .collect();
        let (w, h) = (small.width, small.height);
        let mut costs = vec![0u16; w * h * PLANES];
        over_rows(&mut costs, w * PLANES, self.threads, |y, row| row_costs(small, &mapped, y, row));
        let planes = sigma_filtered(&semi_global_planes(&costs, w, h, self.threads), w, self.threads);
        let scale = width.div_ceil(w).max(1);
        let pixel_depth = |i: usize| {
            let plane = planes[(i / width / scale).min(h - 1) * w + (i % width / scale).min(w - 1)];
            // Clamped to a quarter of a plane: the first plane stands for all depths up to
            // infinity.
            (1.0 / (self.step * f64::from(plane).max(0.25)).max(1e-9)) as f32
        };
        Ok((0..width * height).map(pixel_depth).collect())
    }

    /// Projects the cell corners of the reduced picture into another frame for each plane.
    fn mapped<'b>(&self, small: &Small, to: &'b Small, motion: &DAffine3) -> NeighbourPositions<'b> {
        let (width, height) = self.model.size();
        let (across, down) = (small.width.div_ceil(CELL) + 1, small.height.div_ceil(CELL) + 1);
        let scale = width.div_ceil(small.width).max(1);
        let mut at = vec![[f32::NAN; 2]; across * down * PLANES];
        let (model, step) = (self.model, self.step);
        over_rows(&mut at, across * PLANES, self.threads, |cy, row| {
            for (cx, planes) in row.chunks_mut(PLANES).enumerate() {
                let (x, y) = ((cx * CELL * scale).min(width - 1), (cy * CELL * scale).min(height - 1));
                let ray = DVec3::from(model.rays[y * width + x].map(f64::from));
                // Corners beyond the picture are extrapolated.
                let beyond = DVec2::new((cx * CELL * scale) as f64 - x as f64, (cy * CELL * scale) as f64 - y as f64);
                let turned = motion.transform_vector3(ray);
                for (k, at) in planes.iter_mut().enumerate() {
                    let there = turned + step * k as f64 * motion.translation;
                    if there.z > 1e-3
                        && let Some(projected) = model.geometry.project(there)
                    {
                        *at = ((projected + beyond - 0.5) / scale as f64).as_vec2().to_array();
                    }
                }
            }
        });
        NeighbourPositions { to, across, at }
    }
}

/// Inverse depth between two planes, 1/m or by the recording's unit; 0 if the camera never moves.
fn step(geometry: &Geometry, states: &[Option<CameraState>]) -> f64 {
    let ways = (0..states.len()).filter_map(|n| neighbours(states, n).first().map(|n| n.0));
    let usual = upper_median(ways).unwrap_or(0.0);
    let widest = MAX_DISPARITY_SHARE * f64::from(geometry.intrinsics.width_px) / geometry.intrinsics.fx_px;
    if usual > 0.0 { widest / usual / (PLANES - 1) as f64 } else { 0.0 }
}

/// Camera model of a recording, with the depth tolerance of plane sweeps if it has no measured
/// depth.
pub fn camera_model_for(geometry: Geometry, recording: &Recording, states: &[Option<CameraState>]) -> CameraModel {
    let model = CameraModel::new(geometry);
    if recording.has_depth() {
        return model;
    }
    let step = step(&model.geometry, states);
    let typical_depth_m =
        if step > 0.0 { 1.0 / (TYPICAL_PLANE_SHARE * PLANES as f64 * step) } else { model.typical_depth_m };
    CameraModel { inverse_depth_tolerance: DEPTH_TOLERANCE_PLANES * step, typical_depth_m, ..model }
}

/// Baselines and indices of a frame's neighbours, the longest baseline first.
fn neighbours(states: &[Option<CameraState>], n: usize) -> Vec<(f64, usize)> {
    let Some(here) = states[n] else { return Vec::new() };
    let mut matches = Vec::new();
    for other in NEIGHBOUR_GAPS.iter().flat_map(|gap| [n.checked_sub(*gap), Some(n + gap)]).flatten() {
        let Some(there) = states.get(other).copied().flatten() else { continue };
        let motion = here.world_from_camera.inverse() * there.world_from_camera;
        if motion.matrix3.z_axis.z.clamp(-1.0, 1.0).acos() < MAX_VIEW_ANGLE_RAD {
            matches.push((motion.translation.length(), other));
        }
    }
    matches.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    matches.truncate(MAX_NEIGHBOURS);
    matches
}

impl Small {
    fn new(model: &CameraModel, frame: &Frame) -> Self {
        let mut plane = GreyImage::luma_601(&frame.pixels);
        while plane.width > MAX_WIDTH_PX {
            plane = plane.halved();
        }
        assert!(plane.width <= model.size().0);
        let plane = plane.filtered(&gaussian(0.7));
        Self { index: frame.index, width: plane.width, height: plane.height, census: census(&plane) }
    }

    fn at(&self, x: f32, y: f32) -> Option<u64> {
        let (x, y) = (x + 0.5, y + 0.5);
        let is_inside = x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32;
        is_inside.then(|| self.census[y as usize * self.width + x as usize])
    }
}

/// Ternary census: two bits, darker and brighter, for each of the 24 pixels around.
fn census(plane: &GreyImage) -> Vec<u64> {
    let (w, h) = (plane.width, plane.height);
    let mut out = vec![0; w * h];
    for y in CENSUS_RADIUS..h.saturating_sub(CENSUS_RADIUS) {
        for x in CENSUS_RADIUS..w.saturating_sub(CENSUS_RADIUS) {
            let own = plane.values[y * w + x];
            let mut bits = 0u64;
            for dy in 0..=2 * CENSUS_RADIUS {
                let row = &plane.values[(y + dy - CENSUS_RADIUS) * w + x - CENSUS_RADIUS..][..2 * CENSUS_RADIUS + 1];
                for value in row {
                    bits = bits << 2
                        | u64::from(*value < own - CENSUS_THRESHOLD)
                        | u64::from(*value > own + CENSUS_THRESHOLD) << 1;
                }
            }
            // The pixel itself has no bits.
            out[y * w + x] = bits & !(3 << 24);
        }
    }
    out
}

/// Matching costs of a row: mean Hamming distance over the neighbours.
fn row_costs(small: &Small, mapped: &[NeighbourPositions<'_>], y: usize, row: &mut [u16]) {
    let fy = (y % CELL) as f32 / CELL as f32;
    let mut sums = [0u32; PLANES];
    for (x, costs) in row.chunks_mut(PLANES).enumerate() {
        let own = small.census[y * small.width + x];
        let fx = (x % CELL) as f32 / CELL as f32;
        sums.fill(0);
        for neighbour in mapped {
            let corner = ((y / CELL) * neighbour.across + x / CELL) * PLANES;
            let below = corner + neighbour.across * PLANES;
            let [a, b] = [corner, corner + PLANES].map(|n| &neighbour.at[n..n + PLANES]);
            let [c, d] = [below, below + PLANES].map(|n| &neighbour.at[n..n + PLANES]);
            for (k, sum) in sums.iter_mut().enumerate() {
                let at = [0, 1].map(|axis| {
                    let upper = a[k][axis] + fx * (b[k][axis] - a[k][axis]);
                    let lower = c[k][axis] + fx * (d[k][axis] - c[k][axis]);
                    upper + fy * (lower - upper)
                });
                *sum += neighbour.to.at(at[0], at[1]).map_or(OUTSIDE_COST, |there| (own ^ there).count_ones());
            }
        }
        for (cost, sum) in costs.iter_mut().zip(sums) {
            *cost = (COST_SCALE * sum / (mapped.len() as u32).max(1)) as u16;
        }
    }
}

/// Semi-global matching along four directions: the plane with the least summed cost at each pixel,
/// interpolated by a parabola.
fn semi_global_planes(costs: &[u16], w: usize, h: usize, threads: usize) -> Vec<f32> {
    let mut whole = vec![0u16; costs.len()];
    // Along rows, both ways: each row by itself.
    over_rows(&mut whole, w * PLANES, threads, |y, row| {
        let costs = &costs[y * w * PLANES..(y + 1) * w * PLANES];
        let mut before = [0u16; PLANES];
        let mut go = |x: usize, is_first: bool| {
            let at = x * PLANES..(x + 1) * PLANES;
            path_step(&mut before, &costs[at.clone()], is_first);
            row[at].iter_mut().zip(&before).for_each(|(sum, path)| *sum += path);
        };
        (0..w).for_each(|x| go(x, x == 0));
        (0..w).rev().for_each(|x| go(x, x + 1 == w));
    });
    // Along columns.
    for is_down in [true, false] {
        let mut before = vec![0u16; w * PLANES];
        for n in 0..h {
            let y = if is_down { n } else { h - 1 - n };
            let at = y * w * PLANES..(y + 1) * w * PLANES;
            let rows = before.chunks_mut(PLANES).zip(costs[at.clone()].chunks(PLANES));
            for ((before, costs), sums) in rows.zip(whole[at].chunks_mut(PLANES)) {
                path_step(before, costs, n == 0);
                sums.iter_mut().zip(before.iter()).for_each(|(sum, path)| *sum += *path);
            }
        }
    }
    whole.chunks(PLANES).map(minimum).collect()
}

/// One step of a path: L(k) = C(k) + min(L'(k), L'(k ± 1) + P₁, min L' + P₂) − min L', with the
/// penalties P₁ and P₂ of small and large steps.
fn path_step(path: &mut [u16], costs: &[u16], is_first: bool) {
    if is_first {
        path.copy_from_slice(costs);
        return;
    }
    let floor = path.iter().copied().min().unwrap_or(0);
    let mut before = u16::MAX - SMALL_STEP_PENALTY;
    for k in 0..path.len() {
        let own = path[k];
        let after = path.get(k + 1).map_or(u16::MAX - SMALL_STEP_PENALTY, |after| *after);
        let stepped = before.min(after) + SMALL_STEP_PENALTY;
        before = own;
        path[k] = costs[k] + own.min(stepped).min(floor + LARGE_STEP_PENALTY) - floor;
    }
}

/// Sigma filter (Lee 1983): mean of the pixels around each with a similar depth.
fn sigma_filtered(planes: &[f32], w: usize, threads: usize) -> Vec<f32> {
    let h = planes.len() / w.max(1);
    let mut out = vec![0.0; planes.len()];
    over_rows(&mut out, w, threads, |y, row| {
        for (x, even) in row.iter_mut().enumerate() {
            let own = planes[y * w + x];
            let (mut sum, mut count) = (0.0, 0.0);
            for y in y.saturating_sub(FILTER_RADIUS)..(y + FILTER_RADIUS + 1).min(h) {
                for plane in &planes[y * w + x.saturating_sub(FILTER_RADIUS)..y * w + (x + FILTER_RADIUS + 1).min(w)] {
                    if (plane - own).abs() < FILTER_RANGE_PLANES {
                        (sum, count) = (sum + plane, count + 1.0);
                    }
                }
            }
            *even = sum / count;
        }
    });
    out
}

fn minimum(sums: &[u16]) -> f32 {
    let k = (0..sums.len()).min_by_key(|k| sums[*k]).unwrap_or(0);
    if k == 0 || k + 1 == sums.len() {
        return k as f32;
    }
    let [before, here, after] = [sums[k - 1], sums[k], sums[k + 1]].map(f32::from);
    let bend = before - 2.0 * here + after;
    if bend > 0.0 { k as f32 + 0.5 * (before - after) / bend } else { k as f32 }
}

#[cfg(test)]
mod tests {
    use super::super::view::scattered;
    use super::*;

    const SIZE: (usize, usize) = (64, 48);

    /// A textured wall with a gain, shifted by `shift` px to the left for columns from `from` on.
    fn view_of(index: usize, shift: f32, from: usize, gain: f32) -> Small {
        let blotch = |x: usize, y: usize| (scattered((y * 1000 + x) as u64) % 100) as f32;
        let wall =
            GreyImage { width: 200, height: 48, values: (0..200 * 48).map(|i| blotch(i % 200, i / 200)).collect() };
        let wall = wall.filtered(&gaussian(1.5));
        let value = |i: usize| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let by = if x >= from { shift } else { 0.0 };
            gain * wall.sample_inside(x as f32 + 50.0 + by, y.min(46) as f32).unwrap()
        };
        let plane = GreyImage { width: SIZE.0, height: SIZE.1, values: (0..SIZE.0 * SIZE.1).map(value).collect() };
        Small { index, width: SIZE.0, height: SIZE.1, census: census(&plane) }
    }

    /// A disparity of half a pixel per plane.
    fn mapped(to: &Small, sign: f32) -> NeighbourPositions<'_> {
        let (across, down) = (SIZE.0 / CELL + 1, SIZE.1 / CELL + 1);
        let place = |n: usize| {
            let (cell, k) = (n / PLANES, n % PLANES);
            [(cell % across * CELL) as f32 + sign * 0.5 * k as f32, (cell / across * CELL) as f32]
        };
        NeighbourPositions { to, across, at: (0..across * down * PLANES).map(place).collect() }
    }

    #[test]
    fn wall_is_found_at_its_plane_at_any_exposure() {
        let here = view_of(0, 0.0, 0, 1.0);
        let (left, right) = (view_of(1, 5.0, 0, 0.8), view_of(2, -5.0, 0, 1.3));
        let both = [mapped(&left, -1.0), mapped(&right, 1.0)];
        let mut costs = vec![0; SIZE.0 * SIZE.1 * PLANES];
        over_rows(&mut costs, SIZE.0 * PLANES, 2, |y, row| row_costs(&here, &both, y, row));
        let planes = sigma_filtered(&semi_global_planes(&costs, SIZE.0, SIZE.1, 2), SIZE.0, 2);
        // 5 px are ten planes. Near the edges one neighbour has no match, and the census is
        // incomplete.
        let is_inside = |i: &usize| (8..56).contains(&(i % SIZE.0)) && (6..42).contains(&(i / SIZE.0));
        let mut planes: Vec<f32> = (0..planes.len()).filter(is_inside).map(|i| planes[i]).collect();
        let near = planes.iter().filter(|plane| (**plane - 10.0).abs() < 1.0).count();
        assert!(near > planes.len() * 95 / 100, "{near} of {}", planes.len());
        planes.sort_by(f32::total_cmp);
        assert!((planes[planes.len() / 2] - 10.0).abs() < 0.3, "{}", planes[planes.len() / 2]);
    }

    #[test]
    fn path_costs_include_the_step_penalties() {
        let mut path = [0u16; 4];
        path_step(&mut path, &[5, 900, 900, 900], true);
        assert_eq!(path, [5, 900, 900, 900]);
        // From the minimum, 5: no penalty at the same plane, the small one beside it, else the
        // large one; minus the minimum.
        path_step(&mut path, &[1, 2, 3, 4], false);
        assert_eq!(path, [1, 2 + SMALL_STEP_PENALTY, 3 + LARGE_STEP_PENALTY, 4 + LARGE_STEP_PENALTY]);
        assert_eq!(minimum(&[9, 4, 1, 2]), 2.0 + 0.5 * (4.0 - 2.0) / (4.0 - 2.0 + 2.0));
        assert_eq!((minimum(&[1, 2, 3]), minimum(&[3, 2, 1])), (0.0, 2.0));
    }

    #[test]
    fn sigma_filter_keeps_edges() {
        let planes: Vec<f32> = (0..16 * 16).map(|i| if i % 16 < 8 { 3.0 + (i % 2) as f32 } else { 20.0 }).collect();
        let filtered = sigma_filtered(&planes, 16, 1);
        assert!(filtered.iter().enumerate().all(|(i, p)| if i % 16 < 8 { (p - 3.5).abs() < 0.3 } else { *p == 20.0 }));
    }
}
