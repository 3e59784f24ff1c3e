//! Occupancy grid of the room's surfaces, for visibility by ray marching. Most of a room is free
//! space, so empty blocks of cells are skipped in one step.
//!
//! [`Room`](crate::shadow::Room) is another walk: a sparse set of finer voxels with several
//! points each. Its rays skip the voxels of the receiver plane and those around the lamp.

use glam::{DVec3, IVec3};

use super::lamp_fit::{LampSource, lamp_irradiance};

/// Side of a cell, m.
const CELL_M: f64 = 0.04;
/// Distance from a surface at which a ray begins, so that the surface does not occlude itself, m.
const RAY_OFFSET_M: f64 = 0.07;
/// Largest number of cells.
const MAX_CELLS: f64 = 3e8;
/// Binary logarithm of the number of cells along a block's side.
const BLOCK_LOG2: u32 = 3;
/// A ray leaves a block earlier by this number of steps, so that rounding errors skip no cell.
const EXIT_MARGIN_STEPS: f64 = 1e-6;

/// Occupied cells of 4 cm in the box around the points; larger cells if the box needs too many.
/// Lengths in m.
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    low: DVec3,
    side_m: f64,
    size: IVec3,
    /// One bit per cell: whether it is occupied.
    bits: Vec<u64>,
    /// One bit per block: whether any of its cells is occupied.
    blocks: Vec<u64>,
    /// Number of blocks along x and y.
    block_counts: [usize; 2],
}

fn is_set(bits: &[u64], n: usize) -> bool {
    bits.get(n / 64).is_some_and(|bits| bits >> (n % 64) & 1 == 1)
}

impl OccupancyGrid {
    pub fn new(solid: &[DVec3]) -> Self {
        let low = solid.iter().copied().fold(DVec3::INFINITY, DVec3::min) - 1e-6;
        let high = solid.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) + 1e-6;
        if solid.is_empty() {
            let (bits, blocks) = (Vec::new(), Vec::new());
            return Self { low: DVec3::ZERO, side_m: CELL_M, size: IVec3::ZERO, bits, blocks, block_counts: [0; 2] };
        }
        let mut side_m = CELL_M;
        let cells = |side_m: f64| ((high - low) / side_m).ceil();
        while cells(side_m).x * cells(side_m).y * cells(side_m).z > MAX_CELLS {
            side_m *= 1.25;
        }
        let size = cells(side_m).as_ivec3().max(IVec3::ONE);
        let room_for = |size: IVec3| vec![0; (size.x as usize * size.y as usize * size.z as usize).div_ceil(64)];
        let of_blocks = (size - 1) / (1 << BLOCK_LOG2) + 1;
        let block_counts = [of_blocks.x as usize, of_blocks.y as usize];
        let mut grid = Self { low, side_m, size, bits: room_for(size), blocks: room_for(of_blocks), block_counts };
        for at in solid {
            if let Some(at) = grid.within_box(*at) {
                let (cell, block) = (grid.cell(at), grid.block(at));
                grid.bits[cell / 64] |= 1 << (cell % 64);
                grid.blocks[block / 64] |= 1 << (block % 64);
            }
        }
        grid
    }

    /// Indices of the cell of a point by axis; `None` outside the grid.
    fn within_box(&self, at: DVec3) -> Option<[usize; 3]> {
        let c = ((at - self.low) / self.side_m).floor().as_ivec3();
        let is_within = c.cmpge(IVec3::ZERO).all() && c.cmplt(self.size).all();
        is_within.then(|| c.to_array().map(|c| c as usize))
    }

    fn cell(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size.y as usize + y) * self.size.x as usize + x
    }

    fn block(&self, at: [usize; 3]) -> usize {
        let [x, y, z] = at.map(|n| n >> BLOCK_LOG2);
        (z * self.block_counts[1] + y) * self.block_counts[0] + x
    }

    /// True if the ray from a surface at `from` with `normal` to `to` is occluded. Steps of half a
    /// cell.
    pub fn is_occluded(&self, from: DVec3, normal: DVec3, to: DVec3) -> bool {
        let begin = from + RAY_OFFSET_M * normal;
        let way = to - begin;
        let length = way.length();
        // The ray in units of cells, with steps of half a cell.
        let start = (begin - self.low) / self.side_m;
        let step = 0.5 * way / length.max(1e-9);
        let (first, last) = self.step_range_inside(start, step, 2.0 * length / self.side_m);
        let per_step = step.recip();
        let mut n = first;
        while n <= last {
            // Coordinates are not negative, so truncation is the floor.
            let at = (start + n * step).to_array().map(|at| at as usize);
            if !is_set(&self.blocks, self.block(at)) {
                n = last_step_in_block(start, per_step, at).max(n + 1.0);
                continue;
            }
            if is_set(&self.bits, self.cell(at)) {
                return true;
            }
            n += 1.0;
        }
        false
    }

    /// The first and the last of up to `max_steps` from `start` inside the grid; the last is
    /// before the first if there is none.
    fn step_range_inside(&self, start: DVec3, step: DVec3, max_steps: f64) -> (f64, f64) {
        let (mut first, mut last) = (1.0f64, max_steps.floor());
        for axis in 0..3 {
            let (at, by, size) = (start[axis], step[axis], f64::from(self.size[axis]));
            if by == 0.0 {
                if !(0.0..size).contains(&at) {
                    return (1.0, 0.0);
                }
                continue;
            }
            let (enters, leaves) = (-at / by, (size - at) / by);
            first = first.max(enters.min(leaves).ceil());
            last = last.min(enters.max(leaves).floor());
        }
        // Positions are monotonic in the steps despite rounding, so all steps between two inside
        // are inside. Steps that are rounded onto the border are not.
        let is_in = |n: f64| {
            let at = start + n * step;
            at.cmpge(DVec3::ZERO).all() && at.cmplt(self.size.as_dvec3()).all()
        };
        while first <= last && !is_in(first) {
            first += 1.0;
        }
        while first <= last && !is_in(last) {
            last -= 1.0;
        }
        (first, last)
    }

    /// Irradiance by a lamp on a surface at `at` with `normal`; 0 if it is occluded.
    pub fn lamp_irradiance(&self, at: DVec3, normal: DVec3, lamp: &LampSource) -> f64 {
        let share = lamp_irradiance(at, normal, lamp);
        if share > 0.0 && self.is_occluded(at, normal, lamp.position_m) { 0.0 } else { share }
    }
}

/// The last step in the block of a cell, or a slightly earlier one.
fn last_step_in_block(start: DVec3, per_step: DVec3, at: [usize; 3]) -> f64 {
    let of_axis = |axis: usize| {
        let first = at[axis] >> BLOCK_LOG2 << BLOCK_LOG2;
        let side = if per_step[axis] > 0.0 { first + (1 << BLOCK_LOG2) } else { first };
        // A ray parallel to a face never crosses it.
        if per_step[axis].is_finite() { (side as f64 - start[axis]) * per_step[axis] } else { f64::INFINITY }
    };
    ((0..3).map(of_axis).fold(f64::INFINITY, f64::min) - EXIT_MARGIN_STEPS).floor()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays within the grid, out of it, into it and past it, against a march that tests every half
    /// cell.
    #[test]
    fn occlusion_matches_a_march_without_block_skipping() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut place = |low: f64, high: f64| DVec3::from_array([(); 3].map(|()| low + (high - low) * random()));
        // All over, and in the middle of a room that is empty but for that.
        let spread: Vec<DVec3> = (0..400).map(|_| place(-0.5, 0.5)).collect();
        let mut heap: Vec<DVec3> = (0..1500).map(|_| place(-0.5, 0.5)).collect();
        heap.extend([DVec3::splat(-1.4), DVec3::splat(1.4)]);
        for (solid, reach) in [(spread, 0.9), (heap, 1.2)] {
            let grid = OccupancyGrid::new(&solid);
            let mut counts = [0, 0];
            for _ in 0..2000 {
                let (from, to) = (place(-reach, reach), place(-reach, reach));
                let normal = place(-1.0, 1.0).normalize();
                let begin = from + RAY_OFFSET_M * normal;
                let (way, length) = (to - begin, (to - begin).length());
                let steps =
                    (1..=(2.0 * length / CELL_M) as usize).map(|n| begin + way * (0.5 * CELL_M / length) * n as f64);
                let expected = steps.filter_map(|at| grid.within_box(at)).any(|at| is_set(&grid.bits, grid.cell(at)));
                assert_eq!(grid.is_occluded(from, normal, to), expected, "{from} {normal} {to}");
                counts[usize::from(expected)] += 1;
            }
            assert!(counts.iter().all(|count| *count > 300), "{counts:?}");
        }
        // Along an axis, and in an empty grid.
        let wall: Vec<DVec3> = (0..50).map(|n| DVec3::new(0.02 * f64::from(n), 0.0, 0.0)).collect();
        let grid = OccupancyGrid::new(&wall);
        let up = |x: f64, z: f64| grid.is_occluded(DVec3::new(x, 0.0, -z), DVec3::Z, DVec3::new(x, 0.0, z));
        assert_eq!([up(0.5, 1.0), up(-0.5, 1.0), up(1.5, 1.0)], [true, false, false]);
        assert!(!OccupancyGrid::new(&[]).is_occluded(DVec3::ZERO, DVec3::Z, DVec3::ONE));
    }
}
