//! Whether something stands between two places: a grid of the room's surfaces, marched through.

use glam::{DVec3, IVec3};

use super::lit::{Place, of_lamp};

/// A cell's side, m.
const SIDE_M: f64 = 0.04;
/// Nothing blocks its own neighbourhood: how far from a surface a way begins, m.
const CLEAR_M: f64 = 0.07;
/// Cells at most.
const MOST: f64 = 3e8;

#[derive(Clone, Debug)]
pub struct Blocked {
    low: DVec3,
    side_m: f64,
    size: IVec3,
    bits: Vec<u64>,
}

impl Blocked {
    pub fn new(solid: &[DVec3]) -> Self {
        let low = solid.iter().copied().fold(DVec3::INFINITY, DVec3::min) - 1e-6;
        let high = solid.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) + 1e-6;
        if solid.is_empty() {
            return Self { low: DVec3::ZERO, side_m: SIDE_M, size: IVec3::ZERO, bits: Vec::new() };
        }
        let mut side_m = SIDE_M;
        let cells = |side_m: f64| ((high - low) / side_m).ceil();
        while cells(side_m).x * cells(side_m).y * cells(side_m).z > MOST {
            side_m *= 1.25;
        }
        let size = cells(side_m).as_ivec3().max(IVec3::ONE);
        let count = size.x as usize * size.y as usize * size.z as usize;
        let mut grid = Self { low, side_m, size, bits: vec![0; count.div_ceil(64)] };
        for at in solid {
            if let Some(n) = grid.cell(*at) {
                grid.bits[n / 64] |= 1 << (n % 64);
            }
        }
        grid
    }

    fn cell(&self, at: DVec3) -> Option<usize> {
        let c = ((at - self.low) / self.side_m).floor().as_ivec3();
        let is_within = c.cmpge(IVec3::ZERO).all() && c.cmplt(self.size).all();
        is_within.then(|| (c.z as usize * self.size.y as usize + c.y as usize) * self.size.x as usize + c.x as usize)
    }

    /// From a surface at `from` that looks along `normal` to `to`.
    pub fn is_blocked(&self, from: DVec3, normal: DVec3, to: DVec3) -> bool {
        let begin = from + CLEAR_M * normal;
        let way = to - begin;
        let length = way.length();
        let step = way * (0.5 * self.side_m / length.max(1e-9));
        let mut at = begin + step;
        for _ in 0..(2.0 * length / self.side_m) as usize {
            match self.cell(at) {
                Some(n) if self.bits[n / 64] >> (n % 64) & 1 == 1 => return true,
                // Out of the box there is nothing to come, but for ways that begin out of it.
                None if self.leaves(at, step) => return false,
                _ => {}
            }
            at += step;
        }
        false
    }

    /// Of a lamp, on a surface at `at` that looks along `normal`: nothing if something stands between.
    pub fn of_lamp(&self, at: DVec3, normal: DVec3, lamp: &Place) -> f64 {
        let share = of_lamp(at, normal, lamp);
        if share > 0.0 && self.is_blocked(at, normal, lamp.at) { 0.0 } else { share }
    }

    fn leaves(&self, at: DVec3, step: DVec3) -> bool {
        let high = self.low + self.size.as_dvec3() * self.side_m;
        let gone = |axis: usize| {
            (at[axis] < self.low[axis] && step[axis] <= 0.0) || (at[axis] >= high[axis] && step[axis] >= 0.0)
        };
        gone(0) || gone(1) || gone(2)
    }
}
