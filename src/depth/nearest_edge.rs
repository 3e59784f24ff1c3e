//! The edge of a depth map that matters at each pixel: the nearest one, and of several close ones the largest step.

use super::apart::JUMP;

/// A step by a factor e counts as much as being so much nearer, px; at most so much.
const PER_STEP_PX: f32 = 10.0;
const MOST_PX: f32 = 4.0;

/// An edge of the map.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    pub distance_px: f32,
    /// Depths on either side.
    pub near_m: f32,
    pub far_m: f32,
}

impl Edge {
    /// The depths of the two surfaces at a pixel of which the map says `own_m`.
    pub fn both_m(&self, own_m: f32) -> [f32; 2] {
        let Self { near_m, far_m, .. } = *self;
        if is_near(own_m, [near_m, far_m]) { [own_m, far_m] } else { [near_m, own_m] }
    }
}

/// Whether a depth belongs to the nearer of two surfaces: it is less than their geometric mean.
pub fn is_near(z_m: f32, [near_m, far_m]: [f32; 2]) -> bool {
    z_m * z_m < near_m * far_m
}

/// For each pixel the edge of the map that matters, by straight and diagonal steps (a chamfer distance, Borgefors 1986).
pub fn edges(depth_m: &[f32], width: usize) -> Vec<Edge> {
    // The edges, with what their steps are worth, px. The first is none.
    let mut found = vec![(Edge { distance_px: f32::INFINITY, near_m: 0.0, far_m: 0.0 }, 0.0)];
    let mut ways = Ways::new(depth_m.len(), width);
    pairs(depth_m, width, |[i, beside], [a, b]| {
        let (near_m, far_m) = (a.min(b), a.max(b));
        if near_m > 0.0 && far_m > JUMP * near_m {
            let worth_px = (PER_STEP_PX * (far_m / near_m).ln()).min(MOST_PX);
            [i, beside].into_iter().for_each(|at| ways.begin(at, 0.5 - worth_px, found.len() as u32));
            found.push((Edge { distance_px: 0.5, near_m, far_m }, worth_px));
        }
    });
    ways.spread();
    let edge = |(cost, from): (f32, u32)| {
        let (edge, worth_px) = found[from as usize];
        Edge { distance_px: cost + worth_px, ..edge }
    };
    ways.inside().map(edge).collect()
}

/// Distance from each pixel's centre to the nearest edge, px, by the same steps.
pub fn distances_px(depth_m: &[f32], width: usize, is_edge: impl Fn(f32, f32) -> bool) -> Vec<f32> {
    let mut ways = Ways::new(depth_m.len(), width);
    pairs(depth_m, width, |[i, beside], [a, b]| {
        if is_edge(a, b) {
            [i, beside].into_iter().for_each(|at| ways.begin(at, 0.5, 0));
        }
    });
    ways.spread();
    ways.inside().map(|(cost, _)| cost).collect()
}

/// Calls `of` with all pairs of neighbours: where they are, and their depths.
fn pairs(depth_m: &[f32], width: usize, mut of: impl FnMut([usize; 2], [f32; 2])) {
    for (y, row) in depth_m.chunks_exact(width.max(1)).enumerate() {
        let first = y * width;
        let below = depth_m.get(first + width..first + 2 * width).unwrap_or(&[]);
        for x in 0..width {
            if x + 1 < width {
                of([first + x, first + x + 1], [row[x], row[x + 1]]);
            }
            if let Some(below) = below.get(x) {
                of([first + x, first + x + width], [row[x], *below]);
            }
        }
    }
}

/// For each pixel the cheapest way from where ways begin, and which one. A rim of a pixel lies around.
struct Ways {
    width: usize,
    cost: Vec<f32>,
    from: Vec<u32>,
}

impl Ways {
    fn new(count: usize, width: usize) -> Self {
        let all = (width + 2) * (count / width.max(1) + 2);
        Self { width, cost: vec![f32::INFINITY; all], from: vec![0; all] }
    }

    fn begin(&mut self, i: usize, cost: f32, from: u32) {
        let at = (i / self.width + 1) * (self.width + 2) + i % self.width + 1;
        if cost < self.cost[at] {
            (self.cost[at], self.from[at]) = (cost, from);
        }
    }

    /// Takes the cheapest ways on to all pixels: from the left and above, then from the right and below. A picture read
    /// backwards is turned by 180°.
    fn spread(&mut self) {
        for _ in 0..2 {
            self.onward();
            self.cost.reverse();
            self.from.reverse();
        }
    }

    fn onward(&mut self) {
        let (wide, diagonal) = (self.width + 2, std::f32::consts::SQRT_2);
        for y in 1..self.cost.len() / wide {
            let (cost_above, cost) = self.cost[(y - 1) * wide..(y + 1) * wide].split_at_mut(wide);
            let (from_above, from) = self.from[(y - 1) * wide..(y + 1) * wide].split_at_mut(wide);
            // Each neighbour for the whole row: vectors.
            for (dx, step) in [(0, diagonal), (1, 1.0), (2, diagonal)] {
                let beside = cost_above[dx..].iter().zip(&from_above[dx..]);
                for ((cost, from), (above, from_there)) in
                    cost[1..wide - 1].iter_mut().zip(&mut from[1..wide - 1]).zip(beside)
                {
                    let is_less = above + step < *cost;
                    *cost = if is_less { above + step } else { *cost };
                    *from = if is_less { *from_there } else { *from };
                }
            }
            for x in 1..wide - 1 {
                if cost[x - 1] + 1.0 < cost[x] {
                    (cost[x], from[x]) = (cost[x - 1] + 1.0, from[x - 1]);
                }
            }
        }
    }

    /// Those of the pixels, row by row.
    fn inside(&self) -> impl Iterator<Item = (f32, u32)> {
        let (wide, width) = (self.width + 2, self.width);
        let rows = self.cost.chunks_exact(wide).zip(self.from.chunks_exact(wide)).skip(1);
        let rows = rows.take((self.cost.len() / wide).saturating_sub(2));
        rows.flat_map(move |(cost, from)| cost[1..=width].iter().copied().zip(from[1..=width].iter().copied()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_edge_and_of_close_ones_the_larger_step() {
        // 1 m, then 1.06 m from column 10 on, then 2 m from column 13 on.
        let row: Vec<f32> = (0..30)
            .map(|x| {
                if x < 10 {
                    1.0
                } else if x < 13 {
                    1.06
                } else {
                    2.0
                }
            })
            .collect();
        let found = edges(&row.repeat(5), 30);
        let at = |x: usize| (found[60 + x].distance_px, found[60 + x].near_m, found[60 + x].far_m);
        assert_eq!(at(13), (0.5, 1.06, 2.0));
        assert_eq!(at(20), (7.5, 1.06, 2.0));
        // The step to 2 m is 3 px farther away from here, and worth more than that.
        assert_eq!(at(9), (3.5, 1.06, 2.0));
        assert_eq!(found[60 + 9].both_m(1.0), [1.0, 2.0]);
        assert_eq!(found[60 + 15].both_m(1.99), [1.06, 1.99]);
        assert!(edges(&[1.0; 20], 5).iter().all(|edge| edge.distance_px.is_infinite()));
        assert!(edges(&[], 0).is_empty());
    }
}
