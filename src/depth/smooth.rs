//! Smooths the edges of a depth map.
//!
//! Edges that were moved to the picture's go astray where the picture shows none, and wander by a pixel where it shows one:
//! each pixel was decided by itself. Here the pixels around decide, near or far, each by how much it looks like this one, how
//! close it is, and how far from the edge, where it is more certain (a joint bilateral filter, Kopf et al. 2007, of the two
//! surfaces' names). A straight edge becomes straight. A thin thing stays, since what looks like it is the thing.

use super::apart::apart;
use super::nearest_edge::{edges, is_near};
use crate::rows::{over_rows, processors};

/// Pixels around that decide: so many to each side, with this σ, px.
const AROUND: i32 = 6;
const NEAR_PX: f32 = 3.0;
/// σ of colours (square roots of light) that look alike, and the weight of those that do not.
const ALIKE: f32 = 0.06;
const UNLIKE: f32 = 0.15;
/// From this far from the edge on a pixel is certain, px; at the edge it counts so much.
const CERTAIN_PX: f32 = 4.0;
const UNCERTAIN: f32 = 0.15;
/// Pixels this far from an edge may change, px.
const REACH_PX: f32 = 4.0;

/// Smooths the edges of `depth_m`, row by row. `looks` are square roots of its picture's light.
pub fn smooth(depth_m: &mut [f32], looks: &[[f32; 3]], width: usize) {
    let by_place: Vec<f32> = (-AROUND..=AROUND)
        .flat_map(|y| (-AROUND..=AROUND).map(move |x| (x * x + y * y) as f32))
        .map(|r2| (-0.5 * r2 / (NEAR_PX * NEAR_PX)).exp())
        .collect();
    let (edges, before, height) = (edges(depth_m, width), depth_m.to_vec(), depth_m.len() / width.max(1));
    let decided = |i: usize| {
        let both_m = edges[i].both_m(before[i]);
        let (x, y) = ((i % width) as i32, (i / width) as i32);
        let mut balance = 0.0;
        for py in (y - AROUND).max(0)..=(y + AROUND).min(height as i32 - 1) {
            for px in (x - AROUND).max(0)..=(x + AROUND).min(width as i32 - 1) {
                let q = py as usize * width + px as usize;
                let unlike = apart(&looks[i], &looks[q]) / ALIKE;
                let like = UNLIKE + 1.0 / (1.0 + unlike * unlike).powi(2);
                let certain = (edges[q].distance_px / CERTAIN_PX).clamp(UNCERTAIN, 1.0);
                let place = by_place[((py - y + AROUND) * (2 * AROUND + 1) + px - x + AROUND) as usize];
                balance += if is_near(before[q], both_m) { like * certain * place } else { -like * certain * place };
            }
        }
        if balance > 0.0 { both_m[0] } else { both_m[1] }
    };
    over_rows(depth_m, width, processors(), |y, row| {
        for (x, z) in row.iter_mut().enumerate() {
            let i = y * width + x;
            if edges[i].distance_px <= REACH_PX {
                *z = decided(i);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 48;

    fn stepped(is_near: impl Fn(usize, usize) -> bool) -> Vec<f32> {
        (0..WIDTH * 40).map(|i| if is_near(i % WIDTH, i / WIDTH) { 1.0 } else { 2.0 }).collect()
    }

    #[test]
    fn a_wandering_edge_becomes_straight_where_nothing_is_seen_of_it() {
        let wandering = |y: usize| [22, 22, 23, 24, 24, 25, 25, 24, 24, 23][y % 10];
        let mut depth = stepped(|x, y| x < wandering(y));
        smooth(&mut depth, &[[0.4; 3]; WIDTH * 40], WIDTH);
        let edge = |y: usize| (0..WIDTH).filter(|x| depth[y * WIDTH + x] < 1.5).count();
        let [least, most] = [(8..32).map(edge).min(), (8..32).map(edge).max()].map(Option::unwrap);
        assert!(most - least <= 1 && (23..=24).contains(&least), "{least} {most}");
    }

    #[test]
    fn a_thin_thing_stays() {
        // A dark post 3 px wide before a bright wall.
        let post = |x: usize, _| (20..23).contains(&x);
        let looks: Vec<_> = (0..WIDTH * 40).map(|i| [if post(i % WIDTH, 0) { 0.2 } else { 0.8 }; 3]).collect();
        let mut depth = stepped(post);
        smooth(&mut depth, &looks, WIDTH);
        assert_eq!(depth, stepped(post));
    }
}
