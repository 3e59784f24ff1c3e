//! Whether a pixel near an edge of the map looks like the surface that the map gives it, or like the other one.
//!
//! A sensor's depth runs over a dark rim of which it measured nothing, by more than its edges are off elsewhere and alike in every
//! frame: what lies behind it is measured there. Surfaces tell by their colours whose the rim is. Around each pixel, pixels far
//! from all edges show what either surface looks like; how many of each look like this pixel is a kernel estimate of the
//! likelihood of its colour (Parzen 1962). A dark stripe of a floor looks like the dark leg before it, and somewhat like the floor:
//! then little is said.

use super::apart::apart;
use super::nearest_edge::{edges, is_near};
use crate::rows::{over_rows, processors};

/// Places around a pixel at which surfaces are looked at, and how far they lie, in ranges of doubt.
const PLACES: usize = 96;
const AROUND: f32 = 5.0;
/// Pixels this far from an edge show one surface, in ranges of doubt.
const CERTAIN: f32 = 0.75;
/// Of each surface so many have to be seen.
const FEWEST: f32 = 4.0;
/// σ of colours (square roots of light) that look alike, and the likelihood of those that nothing around has.
const ALIKE: f32 = 0.06;
const UNSEEN: f32 = 0.05;

/// For each pixel of the map that is nearer than `within_px` to an edge: ln of how much likelier its colour is on the other
/// surface than on the one that the map gives it. 0 where it is not, or where nothing can be said: that a colour fits makes no
/// depth right, since where three surfaces meet one of them may look alike. `looks`: square roots of light; `reach_px`: the range of
/// doubt.
pub fn otherness(depth_m: &[f32], looks: &[[f32; 3]], width: usize, reach_px: f32, within_px: f32) -> Vec<f32> {
    let (edges, height) = (edges(depth_m, width), depth_m.len() / width.max(1));
    let places = places(AROUND * reach_px);
    let mut out = vec![0.0; depth_m.len()];
    over_rows(&mut out, width, processors(), |y, row| {
        for (x, ln) in row.iter_mut().enumerate() {
            let i = y * width + x;
            if edges[i].distance_px >= within_px {
                continue;
            }
            let both_m = edges[i].both_m(depth_m[i]);
            // Of the farther and of the nearer surface: places that show it, and how many of them look alike.
            let mut sums = [(0.0f32, 0.0f32); 2];
            for [dx, dy] in &places {
                let (x, y) = (x as i32 + dx, y as i32 + dy);
                if x < 0 || y < 0 || x >= width as i32 || y >= height as i32 {
                    continue;
                }
                let q = y as usize * width + x as usize;
                if edges[q].distance_px >= CERTAIN * reach_px {
                    let (all, alike) = &mut sums[usize::from(is_near(depth_m[q], both_m))];
                    let apart = apart(&looks[q], &looks[i]) / ALIKE;
                    let unlike = 1.0 + apart * apart;
                    *all += 1.0;
                    *alike += 1.0 / (unlike * unlike);
                }
            }
            if sums.iter().all(|(all, _)| *all >= FEWEST) {
                let [far, near] = sums.map(|(all, alike)| UNSEEN + alike / all);
                let ratio = if is_near(depth_m[i], both_m) { far / near } else { near / far };
                *ln = ratio.ln().max(0.0);
            }
        }
    });
    out
}

/// A spiral of Vogel's.
fn places(radius_px: f32) -> Vec<[i32; 2]> {
    let place = |n: usize| {
        let r = radius_px * ((n as f32 + 0.5) / PLACES as f32).sqrt();
        let (sin, cos) = (2.399_963_2 * n as f32).sin_cos();
        [r * cos, r * sin].map(|at| at.round() as i32)
    };
    (0..PLACES).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 48;

    /// What row 28 looks like: a thing at 1 m up to a row before a desk at 1.2 m that a map shows from row 24 on.
    fn other(thing: impl Fn(usize) -> f32, desk: impl Fn(usize) -> f32, ends: usize) -> f32 {
        let looks: Vec<_> = (0..WIDTH * HEIGHT)
            .map(|i| [if i / WIDTH < ends { thing(i % WIDTH) } else { desk(i % WIDTH) }; 3])
            .collect();
        let depth: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if i / WIDTH < 24 { 1.0 } else { 1.2 }).collect();
        otherness(&depth, &looks, WIDTH, 4.0, 8.0)[28 * WIDTH + 32]
    }

    #[test]
    fn a_dark_rim_is_the_dark_things_and_stripes_say_little() {
        // Up to ln(1.05 / 0.05); the rim takes part in what the desk looks like.
        let rim = other(|_| 0.1, |_| 0.8, 30);
        assert!(rim > 1.0 && rim < 21f32.ln(), "{rim}");
        assert_eq!(other(|_| 0.1, |_| 0.8, 24), 0.0);
        // One colour, and what looks like neither.
        assert_eq!(other(|_| 0.1, |_| 0.1, 24), 0.0);
        assert!(other(|_| 0.1, |x| if x == 32 { 0.5 } else { 0.8 }, 24).abs() < 0.1);
        // The dark half of a striped desk: ln(1.05 / 0.55).
        let striped = other(|_| 0.1, |x| if x % 8 < 4 { 0.1 } else { 0.8 }, 24);
        assert!((striped - 0.65).abs() < 0.2, "{striped}");
    }

    #[test]
    fn nothing_is_said_of_what_is_far_from_edges_or_too_narrow_to_be_known() {
        let is_post = |i: usize| (20..24).contains(&(i % WIDTH));
        let depth: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if is_post(i) { 1.0 } else { 2.0 }).collect();
        let looks: Vec<_> = (0..depth.len()).map(|i| [if is_post(i) { 0.1 } else { 0.8 }; 3]).collect();
        assert!(otherness(&depth, &looks, WIDTH, 4.0, 8.0).iter().all(|ln| *ln == 0.0));
        let wide: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if i % WIDTH < 32 { 1.0 } else { 2.0 }).collect();
        let said = otherness(&wide, &looks, WIDTH, 4.0, 8.0);
        assert!((0..said.len()).all(|i| said[i] == 0.0 || (24..40).contains(&(i % WIDTH))));
        assert!(otherness(&[], &[], 0, 8.0, 8.0).is_empty());
    }
}
