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
    let none = Edge { distance_px: f32::INFINITY, near_m: 0.0, far_m: 0.0 };
    // With each edge its distance, less what its step is worth.
    let mut edges = vec![(f32::INFINITY, none); depth_m.len()];
    for i in 0..depth_m.len() {
        for beside in [(i % width + 1 < width).then_some(i + 1), Some(i + width)].into_iter().flatten() {
            let Some(other) = depth_m.get(beside) else { continue };
            let (near_m, far_m) = (depth_m[i].min(*other), depth_m[i].max(*other));
            if near_m > 0.0 && far_m > JUMP * near_m {
                let edge = Edge { distance_px: 0.5, near_m, far_m };
                let cost = 0.5 - (PER_STEP_PX * (far_m / near_m).ln()).min(MOST_PX);
                for at in [i, beside] {
                    if cost < edges[at].0 {
                        edges[at] = (cost, edge);
                    }
                }
            }
        }
    }
    let far = std::f32::consts::SQRT_2;
    let rows = (depth_m.len() / width.max(1)) as isize;
    let mut step = |i: usize, steps: [(isize, isize, f32); 4]| {
        for (dx, dy, length) in steps {
            let (x, y) = ((i % width) as isize + dx, (i / width) as isize + dy);
            if x >= 0 && y >= 0 && x < width as isize && y < rows {
                let (cost, from) = edges[(y * width as isize + x) as usize];
                if cost + length < edges[i].0 {
                    edges[i] = (cost + length, Edge { distance_px: from.distance_px + length, ..from });
                }
            }
        }
    };
    let before = [(-1, -1, far), (0, -1, 1.0), (1, -1, far), (-1, 0, 1.0)];
    (0..depth_m.len()).for_each(|i| step(i, before));
    let after = before.map(|(dx, dy, length)| (-dx, -dy, length));
    (0..depth_m.len()).rev().for_each(|i| step(i, after));
    edges.into_iter().map(|(_, edge)| edge).collect()
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
