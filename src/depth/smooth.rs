//! Smooths the edges of a depth map.
//!
//! Edges that were moved to the picture's go astray where the picture shows none, and wander by a pixel where it shows one:
//! each pixel was decided by itself. Here the pixels around decide, near or far, each by how much it looks like this one, how
//! close it is, and how far from the edge, where it is more certain (a joint bilateral filter, Kopf et al. 2007, of the two
//! surfaces' names). A straight edge becomes straight. A thin thing stays, since what looks like it is the thing.

use super::nearest_edge::{Edge, edges};
use super::pad::pad;
use crate::parallel::{over_rows, processors};

/// Pixels around that decide: so many to each side, with this σ, px.
const AROUND: usize = 5;
const WINDOW: usize = 2 * AROUND + 1;
/// A row of a window, filled up to whole vectors.
const LANES: usize = 16;
const NEAR_PX: f32 = 3.0;
/// σ of colours (square roots of light) that look alike, and the weight of those that do not.
const ALIKE: f32 = 0.06;
const UNLIKE: f32 = 0.15;
/// From this far from the edge on a pixel is certain, px; at the edge it counts so much.
const CERTAIN_PX: f32 = 4.0;
const UNCERTAIN: f32 = 0.15;
/// Pixels this far from an edge may change, px.
const REACH_PX: f32 = 4.0;

/// Smooths edges of `depth_m`, row by row. `sqrt_colors` are square roots of its picture's light, and `max_depth_m` is up to which depth
/// each pixel matters.
pub fn smooth(depth_m: &mut [f32], sqrt_colors: &[[f32; 3]], width: usize, max_depth_m: &[f32]) {
    let edges = edges(depth_m, width, CERTAIN_PX.max(REACH_PX + 1.0));
    let around = Around::new(depth_m, sqrt_colors, &edges, width);
    let places = places();
    over_rows(depth_m, width, processors(), |y, row| {
        for (x, z) in row.iter_mut().enumerate() {
            let edge = &edges[y * width + x];
            if edge.distance_px <= REACH_PX && edge.near_m.min(*z) < max_depth_m[y * width + x] {
                let both_m = edge.both_m(*z);
                let is_near = around.balance(x, y, sqrt_colors[y * width + x], both_m, &places) > 0.0;
                *z = if is_near { both_m[0] } else { both_m[1] };
            }
        }
    });
}

/// Weights of the pixels of a window by their place, row by row; each row is filled up with nothing.
fn places() -> Vec<[f32; LANES]> {
    let weight = |x: i32, y: i32| (-0.5 * (x * x + y * y) as f32 / (NEAR_PX * NEAR_PX)).exp();
    let row = |y: i32| {
        let lane = |lane: usize| if lane < WINDOW { weight(lane as i32 - AROUND as i32, y) } else { 0.0 };
        std::array::from_fn(lane)
    };
    (-(AROUND as i32)..=AROUND as i32).map(row).collect()
}

/// What decides, each quantity by itself, so that a row of a window is a few vectors. Beyond the map nothing is certain.
struct Around {
    wide: usize,
    sqrt_colors: [Vec<f32>; 3],
    certain: Vec<f32>,
    depth_m: Vec<f32>,
}

impl Around {
    fn new(depth_m: &[f32], sqrt_colors: &[[f32; 3]], edges: &[Edge], width: usize) -> Self {
        let wide = width + LANES;
        let filled = |of: &(dyn Fn(usize) -> f32 + Sync)| pad(depth_m.len(), width, AROUND, wide, of);
        Self {
            wide,
            sqrt_colors: [0, 1, 2].map(|c| filled(&|i| sqrt_colors[i][c])),
            certain: filled(&|i| (edges[i].distance_px / CERTAIN_PX).clamp(UNCERTAIN, 1.0)),
            depth_m: filled(&|i| depth_m[i]),
        }
    }

    /// Positive where more around a pixel belongs to the nearer of two surfaces.
    fn balance(
        &self,
        x: usize,
        y: usize,
        sqrt_colors: [f32; 3],
        [near_m, far_m]: [f32; 2],
        places: &[[f32; LANES]],
    ) -> f32 {
        let mut sums = [0.0f32; LANES];
        for (row, place) in places.iter().enumerate() {
            let start = (y + row) * self.wide + x;
            let [r, g, b] = [0, 1, 2].map(|c| &self.sqrt_colors[c][start..start + LANES]);
            let (certain, depth_m) = (&self.certain[start..start + LANES], &self.depth_m[start..start + LANES]);
            for (n, sum) in sums.iter_mut().enumerate() {
                let (r, g, b) = (r[n] - sqrt_colors[0], g[n] - sqrt_colors[1], b[n] - sqrt_colors[2]);
                let unlike = 1.0 + (r * r + g * g + b * b) / (ALIKE * ALIKE);
                let weight = (UNLIKE + 1.0 / (unlike * unlike)) * certain[n] * place[n];
                *sum += if depth_m[n] * depth_m[n] < near_m * far_m { weight } else { -weight };
            }
        }
        sums.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 48;
    const ALL: [f32; WIDTH * 40] = [9.0; WIDTH * 40];

    fn stepped(is_near: impl Fn(usize, usize) -> bool) -> Vec<f32> {
        (0..WIDTH * 40).map(|i| if is_near(i % WIDTH, i / WIDTH) { 1.0 } else { 2.0 }).collect()
    }

    #[test]
    fn a_wandering_edge_becomes_straight_where_nothing_is_seen_of_it() {
        let wandering = |y: usize| [22, 22, 23, 24, 24, 25, 25, 24, 24, 23][y % 10];
        let mut depth = stepped(|x, y| x < wandering(y));
        smooth(&mut depth, &[[0.4; 3]; WIDTH * 40], WIDTH, &ALL);
        let edge = |y: usize| (0..WIDTH).filter(|x| depth[y * WIDTH + x] < 1.5).count();
        let [least, most] = [(8..32).map(edge).min(), (8..32).map(edge).max()].map(Option::unwrap);
        assert!(most - least <= 1 && (23..=24).contains(&least), "{least} {most}");
    }

    #[test]
    fn a_thin_thing_stays() {
        // A dark post 3 px wide before a bright wall.
        let post = |x: usize, _| (20..23).contains(&x);
        let sqrt_colors: Vec<_> = (0..WIDTH * 40).map(|i| [if post(i % WIDTH, 0) { 0.2 } else { 0.8 }; 3]).collect();
        let mut depth = stepped(post);
        smooth(&mut depth, &sqrt_colors, WIDTH, &ALL);
        assert_eq!(depth, stepped(post));
    }
}
