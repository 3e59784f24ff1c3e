//! Whether a pixel near an edge of the map looks like the surface that the map gives it, or like the other one.
//!
//! A sensor's depth runs over a dark rim of which it measured nothing, by more than its edges are off elsewhere and alike in every
//! frame: what lies behind it is measured there. Surfaces tell by their colours whose the rim is. Around each pixel, pixels far
//! from all edges show what either surface looks like; how many of each look like this pixel is a kernel estimate of the
//! likelihood of its colour (Parzen 1962). A dark stripe of a floor looks like the dark leg before it, and somewhat like the floor:
//! then little is said.

use super::nearest_edge::edges;
use super::pad::pad;
use crate::parallel::{over_rows, processors};

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

/// So many pixels of a row are asked at a time.
const LANES: usize = 16;

/// For each pixel of the map that is nearer than `within_px` to an edge: ln of how much likelier its colour is on the other
/// surface than on the one that the map gives it. 0 where it is not, or where nothing can be said: that a colour fits makes no
/// depth right, since where three surfaces meet one of them may look alike. `sqrt_colors`: square roots of light; `reach_px`: the range of
/// doubt.
pub fn otherness(depth_m: &[f32], sqrt_colors: &[[f32; 3]], width: usize, reach_px: f32, within_px: f32) -> Vec<f32> {
    let edges = edges(depth_m, width, within_px.max(CERTAIN * reach_px));
    let is_certain = |i: usize| edges[i].distance_px >= CERTAIN * reach_px;
    let around = Around::new(depth_m, sqrt_colors, width, is_certain, AROUND * reach_px);
    let mut out = vec![0.0; depth_m.len()];
    over_rows(&mut out, width, processors(), |y, row| {
        for (n, lns) in row.chunks_mut(LANES).enumerate() {
            let (x, first) = (n * LANES, y * width + n * LANES);
            let is_asked = |lane: usize| lane < lns.len() && edges[first + lane].distance_px < within_px;
            let asked: [bool; LANES] = std::array::from_fn(is_asked);
            if asked == [false; LANES] {
                continue;
            }
            // What parts the two surfaces: the square of their geometric mean.
            let mut parts_m2 = [0.0; LANES];
            let mut own_sqrt_colors = [[0.0; LANES]; 3];
            for lane in (0..LANES).filter(|lane| asked[*lane]) {
                let [near_m, far_m] = edges[first + lane].both_m(depth_m[first + lane]);
                parts_m2[lane] = near_m * far_m;
                (0..3).for_each(|c| own_sqrt_colors[c][lane] = sqrt_colors[first + lane][c]);
            }
            let [far, near] = around.shown(x, y, &own_sqrt_colors, &parts_m2);
            for lane in (0..LANES).filter(|lane| asked[*lane]) {
                if far.all[lane] >= FEWEST && near.all[lane] >= FEWEST {
                    let [far, near] = [&far, &near].map(|of| UNSEEN + of.alike[lane] / of.all[lane]);
                    let z_m = depth_m[first + lane];
                    let ratio = if z_m * z_m < parts_m2[lane] { far / near } else { near / far };
                    lns[lane] = ratio.ln().max(0.0);
                }
            }
        }
    });
    out
}

/// Of one surface, for each of some pixels: how many places around show it, and how many of them look like the pixel.
#[derive(Default)]
struct Shown {
    all: [f32; LANES],
    alike: [f32; LANES],
}

/// The map with a rim on all sides, each quantity by itself, so that a place beside many pixels is a few vectors. Nothing is
/// certain in the rim.
struct Around {
    wide: usize,
    rim: usize,
    sqrt_colors: [Vec<f32>; 3],
    /// 1 where a pixel shows one surface, else 0.
    certain: Vec<f32>,
    depth_m: Vec<f32>,
    places: Vec<[i32; 2]>,
}

impl Around {
    fn new(
        depth_m: &[f32],
        sqrt_colors: &[[f32; 3]],
        width: usize,
        is_certain: impl Fn(usize) -> bool + Sync,
        radius_px: f32,
    ) -> Self {
        let rim = radius_px.ceil() as usize + 1;
        let wide = width + 2 * rim + LANES;
        let filled = |of: &(dyn Fn(usize) -> f32 + Sync)| pad(depth_m.len(), width, rim, wide, of);
        Self {
            wide,
            rim,
            sqrt_colors: [0, 1, 2].map(|c| filled(&|i| sqrt_colors[i][c])),
            certain: filled(&|i| f32::from(u8::from(is_certain(i)))),
            depth_m: filled(&|i| depth_m[i]),
            places: places(radius_px),
        }
    }

    /// The farther and the nearer surface around pixels of a row, from `x` on.
    fn shown(&self, x: usize, y: usize, own_sqrt_colors: &[[f32; LANES]; 3], parts_m2: &[f32; LANES]) -> [Shown; 2] {
        let [mut far, mut near] = [Shown::default(), Shown::default()];
        let middle = (y + self.rim) * self.wide + x + self.rim;
        let [own_r, own_g, own_b] = own_sqrt_colors;
        for [dx, dy] in &self.places {
            let start = middle.wrapping_add_signed(*dy as isize * self.wide as isize + *dx as isize);
            let lanes = |of: &Vec<f32>| -> [f32; LANES] { std::array::from_fn(|n| of[start..start + LANES][n]) };
            let certain = lanes(&self.certain);
            if certain == [0.0; LANES] {
                continue;
            }
            let ([r, g, b], depth_m) = ([0, 1, 2].map(|c| lanes(&self.sqrt_colors[c])), lanes(&self.depth_m));
            for n in 0..LANES {
                let (r, g, b) = (r[n] - own_r[n], g[n] - own_g[n], b[n] - own_b[n]);
                let unlike = 1.0 + (r * r + g * g + b * b) / (ALIKE * ALIKE);
                let alike = certain[n] / (unlike * unlike);
                let is_near = depth_m[n] * depth_m[n] < parts_m2[n];
                near.all[n] += if is_near { certain[n] } else { 0.0 };
                near.alike[n] += if is_near { alike } else { 0.0 };
                far.all[n] += if is_near { 0.0 } else { certain[n] };
                far.alike[n] += if is_near { 0.0 } else { alike };
            }
        }
        [far, near]
    }
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
        let sqrt_colors: Vec<_> = (0..WIDTH * HEIGHT)
            .map(|i| [if i / WIDTH < ends { thing(i % WIDTH) } else { desk(i % WIDTH) }; 3])
            .collect();
        let depth: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if i / WIDTH < 24 { 1.0 } else { 1.2 }).collect();
        otherness(&depth, &sqrt_colors, WIDTH, 4.0, 8.0)[28 * WIDTH + 32]
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
        let sqrt_colors: Vec<_> = (0..depth.len()).map(|i| [if is_post(i) { 0.1 } else { 0.8 }; 3]).collect();
        assert!(otherness(&depth, &sqrt_colors, WIDTH, 4.0, 8.0).iter().all(|ln| *ln == 0.0));
        let wide: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if i % WIDTH < 32 { 1.0 } else { 2.0 }).collect();
        let said = otherness(&wide, &sqrt_colors, WIDTH, 4.0, 8.0);
        assert!((0..said.len()).all(|i| said[i] == 0.0 || (24..40).contains(&(i % WIDTH))));
        assert!(otherness(&[], &[], 0, 8.0, 8.0).is_empty());
    }
}
