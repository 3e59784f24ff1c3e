//! Smooths the edges of a depth map.
//!
//! Aligned edges are irregular where the picture has no contrast, and by a pixel where it has: each
//! pixel was assigned independently. Here the pixels around vote for the nearer or the farther
//! surface (a joint bilateral filter, Kopf et al. 2007, of the two labels). The weight of a vote is
//! the product of its similarity in colour, its proximity, and its distance from the edge, where
//! labels are more certain. A straight edge becomes straight. A thin object stays, since pixels of
//! its colour are its own.

use super::nearest_edge::{DepthEdge, edges};
use super::pad::pad;
use crate::parallel::{over_rows, processors};

/// Radius of the filter's window, px.
const RADIUS_PX: usize = 5;
/// Side of the window, px.
const WINDOW_PX: usize = 2 * RADIUS_PX + 1;
/// Length of a row of the window, padded to whole vectors.
const LANES: usize = 16;
/// σ of the spatial kernel, px.
const SPATIAL_SIGMA_PX: f32 = 3.0;
/// σ of the kernel over colours (square roots of light).
const COLOR_SIGMA: f32 = 0.06;
/// Weight of colours without any similarity.
const MIN_COLOR_WEIGHT: f32 = 0.15;
/// Smallest distance from the edge of a pixel with full weight, px.
const CERTAIN_PX: f32 = 4.0;
/// Weight of a pixel at the edge.
const MIN_EDGE_WEIGHT: f32 = 0.15;
/// Largest distance from an edge of a pixel that may change, px.
const REACH_PX: f32 = 4.0;

/// Smooths edges of `depth_m`, row by row. `sqrt_colors` are square roots of its picture's light,
/// and `max_depth_m` is the depth up to which each pixel is relevant.
pub fn smooth(depth_m: &mut [f32], sqrt_colors: &[[f32; 3]], width: usize, max_depth_m: &[f32]) {
    let edges = edges(depth_m, width, CERTAIN_PX.max(REACH_PX + 1.0));
    let inputs = BilateralInputs::new(depth_m, sqrt_colors, &edges, width);
    let spatial_weights = spatial_weights();
    over_rows(depth_m, width, processors(), |y, row| {
        for (x, z) in row.iter_mut().enumerate() {
            let edge = &edges[y * width + x];
            if edge.distance_px <= REACH_PX && edge.near_m.min(*z) < max_depth_m[y * width + x] {
                let both_m = edge.surface_depths_m(*z);
                let is_near = inputs.vote_balance(x, y, sqrt_colors[y * width + x], both_m, &spatial_weights) > 0.0;
                *z = if is_near { both_m[0] } else { both_m[1] };
            }
        }
    });
}

/// Spatial weights of the window, row by row, each padded with 0.
fn spatial_weights() -> Vec<[f32; LANES]> {
    let weight = |x: i32, y: i32| (-0.5 * (x * x + y * y) as f32 / (SPATIAL_SIGMA_PX * SPATIAL_SIGMA_PX)).exp();
    let row = |y: i32| {
        let lane = |lane: usize| if lane < WINDOW_PX { weight(lane as i32 - RADIUS_PX as i32, y) } else { 0.0 };
        std::array::from_fn(lane)
    };
    (-(RADIUS_PX as i32)..=RADIUS_PX as i32).map(row).collect()
}

/// Inputs of the votes, as one array for each quantity, so that a row of a window is a few vectors.
/// The border's pixels have the weight 0.
struct BilateralInputs {
    row_len: usize,
    sqrt_colors: [Vec<f32>; 3],
    edge_weight: Vec<f32>,
    depth_m: Vec<f32>,
}

impl BilateralInputs {
    fn new(depth_m: &[f32], sqrt_colors: &[[f32; 3]], edges: &[DepthEdge], width: usize) -> Self {
        let row_len = width + LANES;
        let filled = |of: &(dyn Fn(usize) -> f32 + Sync)| pad(depth_m.len(), width, RADIUS_PX, row_len, of);
        Self {
            row_len,
            sqrt_colors: [0, 1, 2].map(|c| filled(&|i| sqrt_colors[i][c])),
            edge_weight: filled(&|i| (edges[i].distance_px / CERTAIN_PX).clamp(MIN_EDGE_WEIGHT, 1.0)),
            depth_m: filled(&|i| depth_m[i]),
        }
    }

    /// Weight of the votes for the nearer of two surfaces minus that for the farther one.
    fn vote_balance(
        &self,
        x: usize,
        y: usize,
        sqrt_colors: [f32; 3],
        [near_m, far_m]: [f32; 2],
        spatial_weights: &[[f32; LANES]],
    ) -> f32 {
        let mut sums = [0.0f32; LANES];
        for (row, spatial_weight) in spatial_weights.iter().enumerate() {
            let start = (y + row) * self.row_len + x;
            let [r, g, b] = [0, 1, 2].map(|c| &self.sqrt_colors[c][start..start + LANES]);
            let (edge_weight, depth_m) = (&self.edge_weight[start..start + LANES], &self.depth_m[start..start + LANES]);
            for (n, sum) in sums.iter_mut().enumerate() {
                let (r, g, b) = (r[n] - sqrt_colors[0], g[n] - sqrt_colors[1], b[n] - sqrt_colors[2]);
                let unlike = 1.0 + (r * r + g * g + b * b) / (COLOR_SIGMA * COLOR_SIGMA);
                let weight = (MIN_COLOR_WEIGHT + 1.0 / (unlike * unlike)) * edge_weight[n] * spatial_weight[n];
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
    fn irregular_edge_without_contrast_becomes_straight() {
        let irregular = |y: usize| [22, 22, 23, 24, 24, 25, 25, 24, 24, 23][y % 10];
        let mut depth = stepped(|x, y| x < irregular(y));
        smooth(&mut depth, &[[0.4; 3]; WIDTH * 40], WIDTH, &ALL);
        let edge = |y: usize| (0..WIDTH).filter(|x| depth[y * WIDTH + x] < 1.5).count();
        let [min, max] = [(8..32).map(edge).min(), (8..32).map(edge).max()].map(Option::unwrap);
        assert!(max - min <= 1 && (23..=24).contains(&min), "{min} {max}");
    }

    #[test]
    fn thin_post_stays() {
        // A dark post 3 px wide before a bright wall.
        let post = |x: usize, _| (20..23).contains(&x);
        let sqrt_colors: Vec<_> = (0..WIDTH * 40).map(|i| [if post(i % WIDTH, 0) { 0.2 } else { 0.8 }; 3]).collect();
        let mut depth = stepped(post);
        smooth(&mut depth, &sqrt_colors, WIDTH, &ALL);
        assert_eq!(depth, stepped(post));
    }
}
