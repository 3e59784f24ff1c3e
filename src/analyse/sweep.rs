//! Depth for footage that has none: for each place the plane through which a frame's neighbours look most like it.
//!
//! A plane sweep (Collins 1996) over inverse depth, in which the costs of all neighbours add up (Okutomi and Kanade 1993).
//! The cost is how many signs differ of the brightness around a place against its own, three kinds of them (a census, Zabih and
//! Woodfill 1994), which no exposure changes; semi-global matching makes it smooth (Hirschmüller 2008). It needs poses that hold
//! within a pixel or so, in any unit of length.
//!
//! What comes of it is good for light, flow and edges, which bear a pixel of error. It is not good for poses: those it would
//! only repeat. Not modelled: rows that are read one after another, what moves by itself.

use std::collections::VecDeque;

use glam::{DAffine3, DVec2, DVec3};

use super::eye::Eye;
use super::pyramid::{Plane, gaussian};
use super::robust::median;
use super::state::State;
use crate::camera::Geometry;
use crate::frame::Frame;
use crate::parallel::over_rows;
use crate::recording::{Frames, Recording, RecordingError};

/// Pictures are halved until they are not wider than this, px.
const WIDEST: usize = 200;
/// Distances at which neighbours are looked for, on both sides, frames.
const APART: [usize; 5] = [1, 2, 4, 8, 16];
const REACH: usize = 16;
/// Neighbours at most: those farthest away that look the same way within this angle, rad.
const NEIGHBOURS: usize = 4;
const SAME_WAY: f64 = 0.35;
/// Inverse depths that are tried. At the greatest, what is seen moves by this share of the width to the usual farthest
/// neighbour.
const PLANES: usize = 64;
const WIDEST_SHARE: f64 = 0.3;
/// Distance between places of which it is known where they lie in a neighbour, px of the small picture.
const CELL: usize = 8;
/// Codes that differ by less are alike.
const ALIKE: f32 = 2.0;
/// Half the side of a place's square, px of the small picture.
const HALF: usize = 2;
/// The cost of a place that no neighbour shows, of 48 bits, and in what unit costs add up.
const UNSEEN: u32 = 14;
const UNIT: u32 = 4;
/// How many planes' distances inverse depths of one surface may lie apart, and at which share of them things usually are.
const LOOSE: f64 = 1.5;
const USUAL: f64 = 0.3;
/// What a step of one plane, and of more, costs between places that touch.
const STEP: u16 = 12;
const LEAP: u16 = 96;
/// Depth is evened out over so many places to each side that are within so many planes.
const AROUND: usize = 4;
const NEAR: f32 = 1.5;

/// Makes depth of frames as they come, in order. It reads the recording ahead of them.
pub struct Sweep<'a> {
    eye: &'a Eye,
    states: &'a [Option<State>],
    threads: usize,
    frames: Frames,
    window: VecDeque<Small>,
    /// Between two planes, 1/m or the recording's unit.
    step: f64,
}

struct Small {
    index: usize,
    width: usize,
    height: usize,
    census: Vec<u64>,
}

/// How places of a frame lie in a neighbour: by cell corner and plane, px of the small pictures.
struct Mapped<'a> {
    to: &'a Small,
    across: usize,
    at: Vec<[f32; 2]>,
}

impl<'a> Sweep<'a> {
    pub fn new(
        eye: &'a Eye,
        recording: &Recording,
        states: &'a [Option<State>],
        threads: usize,
    ) -> Result<Self, RecordingError> {
        let frames = recording.frames(0..recording.frame_count())?;
        let step = step(&eye.geometry, states);
        Ok(Self { eye, states, threads, frames, window: VecDeque::new(), step })
    }

    /// A frame's depth at full size, 0 where unknown. Frames are asked for in order.
    pub fn depth(&mut self, index: usize) -> Result<Vec<f32>, RecordingError> {
        while self.window.back().is_none_or(|last| last.index < index + REACH) {
            let Some(frame) = self.frames.next() else { break };
            self.window.push_back(Small::new(self.eye, &frame?));
        }
        while self.window.front().is_some_and(|first| first.index + REACH < index) {
            self.window.pop_front();
        }
        let (width, height) = self.eye.size();
        let small = self.window.iter().find(|small| small.index == index);
        let (Some(small), Some(state)) = (small, self.states[index]) else { return Ok(vec![0.0; width * height]) };
        let near = neighbours(self.states, index);
        let to = |n: usize| self.window.iter().find(|small| small.index == n);
        let mapped: Vec<Mapped<'_>> = near
            .iter()
            .filter_map(|(_, n)| Some((to(*n)?, self.states[*n]?)))
            .map(|(to, there)| self.mapped(small, to, &(there.world_from_camera.inverse() * state.world_from_camera)))
            .collect();
        let (w, h) = (small.width, small.height);
        let mut costs = vec![0u16; w * h * PLANES];
        over_rows(&mut costs, w * PLANES, self.threads, |y, row| row_costs(small, &mapped, y, row));
        let planes = even(&matched(&costs, w, h, self.threads), w, self.threads);
        let scale = width.div_ceil(w).max(1);
        let of = |i: usize| {
            let plane = planes[(i / width / scale).min(h - 1) * w + (i % width / scale).min(w - 1)];
            // What is as far as the first plane may be anywhere beyond it.
            (1.0 / (self.step * f64::from(plane).max(0.25)).max(1e-9)) as f32
        };
        Ok((0..width * height).map(of).collect())
    }

    /// Where the small picture's cell corners lie in another frame for each plane.
    fn mapped<'b>(&self, small: &Small, to: &'b Small, motion: &DAffine3) -> Mapped<'b> {
        let (width, height) = self.eye.size();
        let (across, down) = (small.width.div_ceil(CELL) + 1, small.height.div_ceil(CELL) + 1);
        let scale = width.div_ceil(small.width).max(1);
        let mut at = vec![[f32::NAN; 2]; across * down * PLANES];
        let (eye, step) = (self.eye, self.step);
        over_rows(&mut at, across * PLANES, self.threads, |cy, row| {
            for (cx, planes) in row.chunks_mut(PLANES).enumerate() {
                let (x, y) = ((cx * CELL * scale).min(width - 1), (cy * CELL * scale).min(height - 1));
                let ray = DVec3::from(eye.rays[y * width + x].map(f64::from));
                // A corner beyond the picture goes on as the picture does.
                let beyond = DVec2::new((cx * CELL * scale) as f64 - x as f64, (cy * CELL * scale) as f64 - y as f64);
                let turned = motion.transform_vector3(ray);
                for (k, at) in planes.iter_mut().enumerate() {
                    let there = turned + step * k as f64 * motion.translation;
                    if there.z > 1e-3
                        && let Some(found) = eye.geometry.project(there)
                    {
                        *at = ((found + beyond - 0.5) / scale as f64).as_vec2().to_array();
                    }
                }
            }
        });
        Mapped { to, across, at }
    }
}

/// Between two planes of the recording's sweep, 1/m or its unit; 0 if the camera never moves.
fn step(geometry: &Geometry, states: &[Option<State>]) -> f64 {
    let mut ways: Vec<f64> = (0..states.len()).filter_map(|n| neighbours(states, n).first().map(|n| n.0)).collect();
    let usual = median(&mut ways);
    let widest = WIDEST_SHARE * f64::from(geometry.intrinsics.width_px) / geometry.intrinsics.fx_px;
    if usual > 0.0 { widest / usual / (PLANES - 1) as f64 } else { 0.0 }
}

/// A recording's camera, whose depth comes from sweeps where there is none.
pub fn eye_of(geometry: Geometry, recording: &Recording, states: &[Option<State>]) -> Eye {
    let eye = Eye::new(geometry);
    if recording.has_depth() {
        return eye;
    }
    let step = step(&eye.geometry, states);
    let usual_m = if step > 0.0 { 1.0 / (USUAL * PLANES as f64 * step) } else { eye.usual_m };
    Eye { loose: LOOSE * step, usual_m, ..eye }
}

/// The neighbours that are looked at: how far away, and which, the farthest first.
fn neighbours(states: &[Option<State>], n: usize) -> Vec<(f64, usize)> {
    let Some(here) = states[n] else { return Vec::new() };
    let mut found = Vec::new();
    for other in APART.iter().flat_map(|gap| [n.checked_sub(*gap), Some(n + gap)]).flatten() {
        let Some(there) = states.get(other).copied().flatten() else { continue };
        let motion = here.world_from_camera.inverse() * there.world_from_camera;
        if motion.matrix3.z_axis.z.clamp(-1.0, 1.0).acos() < SAME_WAY {
            found.push((motion.translation.length(), other));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.truncate(NEIGHBOURS);
    found
}

impl Small {
    fn new(eye: &Eye, frame: &Frame) -> Self {
        let mut plane = Plane::of(&frame.pixels);
        while plane.width > WIDEST {
            plane = plane.halved();
        }
        assert!(plane.width <= eye.size().0);
        let plane = plane.filtered(&gaussian(0.7));
        Self { index: frame.index, width: plane.width, height: plane.height, census: census(&plane) }
    }

    fn at(&self, x: f32, y: f32) -> Option<u64> {
        let (x, y) = (x + 0.5, y + 0.5);
        let is_inside = x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32;
        is_inside.then(|| self.census[y as usize * self.width + x as usize])
    }
}

/// For the 24 places around each: two bits, darker and brighter.
fn census(plane: &Plane) -> Vec<u64> {
    let (w, h) = (plane.width, plane.height);
    let mut out = vec![0; w * h];
    for y in HALF..h.saturating_sub(HALF) {
        for x in HALF..w.saturating_sub(HALF) {
            let own = plane.values[y * w + x];
            let mut bits = 0u64;
            for dy in 0..=2 * HALF {
                let row = &plane.values[(y + dy - HALF) * w + x - HALF..][..2 * HALF + 1];
                for value in row {
                    bits = bits << 2 | u64::from(*value < own - ALIKE) | u64::from(*value > own + ALIKE) << 1;
                }
            }
            // The place itself is alike.
            out[y * w + x] = bits & !(3 << 24);
        }
    }
    out
}

/// A row of the costs: the mean over the neighbours of the bits that differ.
fn row_costs(small: &Small, mapped: &[Mapped<'_>], y: usize, row: &mut [u16]) {
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
                *sum += neighbour.to.at(at[0], at[1]).map_or(UNSEEN, |there| (own ^ there).count_ones());
            }
        }
        for (cost, sum) in costs.iter_mut().zip(sums) {
            *cost = (UNIT * sum / (mapped.len() as u32).max(1)) as u16;
        }
    }
}

/// The plane of each place, in planes: along four directions the least sum of its cost and of steps to where it came from; the
/// least of all directions' sums, between planes by a parabola.
fn matched(costs: &[u16], w: usize, h: usize, threads: usize) -> Vec<f32> {
    let mut whole = vec![0u16; costs.len()];
    // Along rows, both ways: each row by itself.
    over_rows(&mut whole, w * PLANES, threads, |y, row| {
        let costs = &costs[y * w * PLANES..(y + 1) * w * PLANES];
        let mut before = [0u16; PLANES];
        let mut go = |x: usize, is_first: bool| {
            let at = x * PLANES..(x + 1) * PLANES;
            follow(&mut before, &costs[at.clone()], is_first);
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
                follow(before, costs, n == 0);
                sums.iter_mut().zip(before.iter()).for_each(|(sum, path)| *sum += *path);
            }
        }
    }
    whole.chunks(PLANES).map(least).collect()
}

/// One step of a path: L(k) = C(k) + min(L'(k), L'(k ± 1) + STEP, min L' + LEAP) − min L'.
fn follow(path: &mut [u16], costs: &[u16], is_first: bool) {
    if is_first {
        path.copy_from_slice(costs);
        return;
    }
    let floor = path.iter().copied().min().unwrap_or(0);
    let mut before = u16::MAX - STEP;
    for k in 0..path.len() {
        let own = path[k];
        let after = path.get(k + 1).map_or(u16::MAX - STEP, |after| *after);
        let stepped = before.min(after) + STEP;
        before = own;
        path[k] = costs[k] + own.min(stepped).min(floor + LEAP) - floor;
    }
}

/// The mean of what is around each place and near it in depth (a sigma filter, Lee 1983).
fn even(planes: &[f32], w: usize, threads: usize) -> Vec<f32> {
    let h = planes.len() / w.max(1);
    let mut out = vec![0.0; planes.len()];
    over_rows(&mut out, w, threads, |y, row| {
        for (x, even) in row.iter_mut().enumerate() {
            let own = planes[y * w + x];
            let (mut sum, mut count) = (0.0, 0.0);
            for y in y.saturating_sub(AROUND)..(y + AROUND + 1).min(h) {
                for plane in &planes[y * w + x.saturating_sub(AROUND)..y * w + (x + AROUND + 1).min(w)] {
                    if (plane - own).abs() < NEAR {
                        (sum, count) = (sum + plane, count + 1.0);
                    }
                }
            }
            *even = sum / count;
        }
    });
    out
}

fn least(sums: &[u16]) -> f32 {
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

    /// A wall of blotches, seen `shift` px farther to the left for each place right of `from`, through a gain.
    fn seen(index: usize, shift: f32, from: usize, gain: f32) -> Small {
        let blotch = |x: usize, y: usize| (scattered((y * 1000 + x) as u64) % 100) as f32;
        let wall = Plane { width: 200, height: 48, values: (0..200 * 48).map(|i| blotch(i % 200, i / 200)).collect() };
        let wall = wall.filtered(&gaussian(1.5));
        let value = |i: usize| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let by = if x >= from { shift } else { 0.0 };
            gain * wall.at(x as f32 + 50.0 + by, y.min(46) as f32).unwrap()
        };
        let plane = Plane { width: SIZE.0, height: SIZE.1, values: (0..SIZE.0 * SIZE.1).map(value).collect() };
        Small { index, width: SIZE.0, height: SIZE.1, census: census(&plane) }
    }

    /// Half a pixel to the left for each plane.
    fn mapped(to: &Small, sign: f32) -> Mapped<'_> {
        let (across, down) = (SIZE.0 / CELL + 1, SIZE.1 / CELL + 1);
        let place = |n: usize| {
            let (cell, k) = (n / PLANES, n % PLANES);
            [(cell % across * CELL) as f32 + sign * 0.5 * k as f32, (cell / across * CELL) as f32]
        };
        Mapped { to, across, at: (0..across * down * PLANES).map(place).collect() }
    }

    #[test]
    fn a_wall_is_found_at_its_plane_whatever_the_exposure() {
        let here = seen(0, 0.0, 0, 1.0);
        let (left, right) = (seen(1, 5.0, 0, 0.8), seen(2, -5.0, 0, 1.3));
        let both = [mapped(&left, -1.0), mapped(&right, 1.0)];
        let mut costs = vec![0; SIZE.0 * SIZE.1 * PLANES];
        over_rows(&mut costs, SIZE.0 * PLANES, 2, |y, row| row_costs(&here, &both, y, row));
        let planes = even(&matched(&costs, SIZE.0, SIZE.1, 2), SIZE.0, 2);
        // 5 px are ten planes. At the rim one neighbour sees nothing, and no census is whole.
        let is_inside = |i: &usize| (8..56).contains(&(i % SIZE.0)) && (6..42).contains(&(i / SIZE.0));
        let mut planes: Vec<f32> = (0..planes.len()).filter(is_inside).map(|i| planes[i]).collect();
        let near = planes.iter().filter(|plane| (**plane - 10.0).abs() < 1.0).count();
        assert!(near > planes.len() * 95 / 100, "{near} of {}", planes.len());
        planes.sort_by(f32::total_cmp);
        assert!((planes[planes.len() / 2] - 10.0).abs() < 0.3, "{}", planes[planes.len() / 2]);
    }

    #[test]
    fn a_path_pays_for_steps_and_for_leaps_once() {
        let mut path = [0u16; 4];
        follow(&mut path, &[5, 900, 900, 900], true);
        assert_eq!(path, [5, 900, 900, 900]);
        // From the least, 5: to stay costs nothing, one plane on STEP, more LEAP; less the least.
        follow(&mut path, &[1, 2, 3, 4], false);
        assert_eq!(path, [1, 2 + STEP, 3 + LEAP, 4 + LEAP]);
        assert_eq!(least(&[9, 4, 1, 2]), 2.0 + 0.5 * (4.0 - 2.0) / (4.0 - 2.0 + 2.0));
        assert_eq!((least(&[1, 2, 3]), least(&[3, 2, 1])), (0.0, 2.0));
    }

    #[test]
    fn evening_out_keeps_edges() {
        let planes: Vec<f32> = (0..16 * 16).map(|i| if i % 16 < 8 { 3.0 + (i % 2) as f32 } else { 20.0 }).collect();
        let found = even(&planes, 16, 1);
        assert!(found.iter().enumerate().all(|(i, p)| if i % 16 < 8 { (p - 3.5).abs() < 0.3 } else { *p == 20.0 }));
    }
}
