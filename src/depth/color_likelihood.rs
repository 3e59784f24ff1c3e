//! Likelihood of a pixel's colour on either surface of a depth edge.
//!
//! A sensor measures nothing on the dark rim of an object, and the depth of the background there.
//! This error is larger than that of other edges, and the same in every frame. The colours of the
//! two surfaces decide which one the rim belongs to. Pixels around that are far from all edges are
//! samples of either surface. The number of samples with a pixel's colour is a kernel estimate of
//! its likelihood (Parzen 1962). A dark stripe of a floor is likely on a dark leg in front of it,
//! and somewhat likely on the floor. The ratio is then near 1.

use super::nearest_edge::edges;
use super::pad::pad;
use crate::parallel::{over_rows, processors};

/// Number of samples around a pixel.
const SAMPLES: usize = 96;
/// Radius of the samples around a pixel, in unreliable ranges.
const SAMPLE_RADIUS: f32 = 5.0;
/// Smallest distance from an edge of a pixel that shows one surface, in unreliable ranges.
const CERTAIN: f32 = 0.75;
/// Minimum number of samples of each surface.
const MIN_SAMPLES: f32 = 4.0;
/// σ of the kernel over colours (square roots of light).
const COLOR_SIGMA: f32 = 0.06;
/// Likelihood of a colour without any similar sample.
const MIN_LIKELIHOOD: f32 = 0.05;

/// Number of pixels of a row that are processed at a time.
const LANES: usize = 16;

/// The log of the ratio of two likelihoods of the colour of each pixel nearer than `within_px` to
/// an edge: on the other surface, and on the surface that the map has there. It is 0 if negative or
/// unknown. A matching colour does not confirm a depth: where three surfaces meet, two may have the
/// same colour. `sqrt_colors`: square roots of light; `reach_px`: the unreliable range.
pub fn other_surface_log_ratio(
    depth_m: &[f32],
    sqrt_colors: &[[f32; 3]],
    width: usize,
    reach_px: f32,
    within_px: f32,
) -> Vec<f32> {
    let edges = edges(depth_m, width, within_px.max(CERTAIN * reach_px));
    let is_certain = |i: usize| edges[i].distance_px >= CERTAIN * reach_px;
    let color_samples = ColorSamples::new(depth_m, sqrt_colors, width, is_certain, SAMPLE_RADIUS * reach_px);
    let mut out = vec![0.0; depth_m.len()];
    over_rows(&mut out, width, processors(), |y, row| {
        for (n, lns) in row.chunks_mut(LANES).enumerate() {
            let (x, first) = (n * LANES, y * width + n * LANES);
            let is_near_edge = |lane: usize| lane < lns.len() && edges[first + lane].distance_px < within_px;
            let near_edge: [bool; LANES] = std::array::from_fn(is_near_edge);
            if near_edge == [false; LANES] {
                continue;
            }
            // The square of the geometric mean of the two depths separates the surfaces.
            let mut threshold_m2 = [0.0; LANES];
            let mut own_colors = [[0.0; LANES]; 3];
            for lane in (0..LANES).filter(|lane| near_edge[*lane]) {
                let [near_m, far_m] = edges[first + lane].surface_depths_m(depth_m[first + lane]);
                threshold_m2[lane] = near_m * far_m;
                (0..3).for_each(|c| own_colors[c][lane] = sqrt_colors[first + lane][c]);
            }
            let [far, near] = color_samples.surface_samples(x, y, &own_colors, &threshold_m2);
            for lane in (0..LANES).filter(|lane| near_edge[*lane]) {
                if far.all[lane] >= MIN_SAMPLES && near.all[lane] >= MIN_SAMPLES {
                    let [far, near] = [&far, &near].map(|of| MIN_LIKELIHOOD + of.similar[lane] / of.all[lane]);
                    let z_m = depth_m[first + lane];
                    let ratio = if z_m * z_m < threshold_m2[lane] { far / near } else { near / far };
                    lns[lane] = ratio.ln().max(0.0);
                }
            }
        }
    });
    out
}

/// Weights of the samples of one surface, for each of some pixels: of all, and of those with the
/// pixel's colour.
#[derive(Default)]
struct SurfaceSamples {
    all: [f32; LANES],
    similar: [f32; LANES],
}

/// The map with a border on all sides, as one array for each quantity, so that a neighbour of many
/// pixels is a few vectors. The border's pixels have the weight 0.
struct ColorSamples {
    row_len: usize,
    border: usize,
    sqrt_colors: [Vec<f32>; 3],
    /// 1 for a pixel that shows one surface, otherwise 0.
    certain: Vec<f32>,
    depth_m: Vec<f32>,
    offsets: Vec<[i32; 2]>,
}

impl ColorSamples {
    fn new(
        depth_m: &[f32],
        sqrt_colors: &[[f32; 3]],
        width: usize,
        is_certain: impl Fn(usize) -> bool + Sync,
        radius_px: f32,
    ) -> Self {
        let border = radius_px.ceil() as usize + 1;
        let row_len = width + 2 * border + LANES;
        let filled = |of: &(dyn Fn(usize) -> f32 + Sync)| pad(depth_m.len(), width, border, row_len, of);
        Self {
            row_len,
            border,
            sqrt_colors: [0, 1, 2].map(|c| filled(&|i| sqrt_colors[i][c])),
            certain: filled(&|i| f32::from(u8::from(is_certain(i)))),
            depth_m: filled(&|i| depth_m[i]),
            offsets: offsets(radius_px),
        }
    }

    /// Samples of the farther and the nearer surface around [`LANES`] pixels of a row from `x` on.
    fn surface_samples(
        &self,
        x: usize,
        y: usize,
        own_colors: &[[f32; LANES]; 3],
        threshold_m2: &[f32; LANES],
    ) -> [SurfaceSamples; 2] {
        let [mut far, mut near] = [SurfaceSamples::default(), SurfaceSamples::default()];
        let middle = (y + self.border) * self.row_len + x + self.border;
        let [own_r, own_g, own_b] = own_colors;
        for [dx, dy] in &self.offsets {
            let start = middle.wrapping_add_signed(*dy as isize * self.row_len as isize + *dx as isize);
            let lanes = |of: &Vec<f32>| -> [f32; LANES] { std::array::from_fn(|n| of[start..start + LANES][n]) };
            let certain = lanes(&self.certain);
            if certain == [0.0; LANES] {
                continue;
            }
            let ([r, g, b], depth_m) = ([0, 1, 2].map(|c| lanes(&self.sqrt_colors[c])), lanes(&self.depth_m));
            for n in 0..LANES {
                let (r, g, b) = (r[n] - own_r[n], g[n] - own_g[n], b[n] - own_b[n]);
                let unlike = 1.0 + (r * r + g * g + b * b) / (COLOR_SIGMA * COLOR_SIGMA);
                let similar = certain[n] / (unlike * unlike);
                let is_near = depth_m[n] * depth_m[n] < threshold_m2[n];
                near.all[n] += if is_near { certain[n] } else { 0.0 };
                near.similar[n] += if is_near { similar } else { 0.0 };
                far.all[n] += if is_near { 0.0 } else { certain[n] };
                far.similar[n] += if is_near { 0.0 } else { similar };
            }
        }
        [far, near]
    }
}

/// Offsets of the samples: a spiral of Vogel's.
fn offsets(radius_px: f32) -> Vec<[i32; 2]> {
    let place = |n: usize| {
        let r = radius_px * ((n as f32 + 0.5) / SAMPLES as f32).sqrt();
        let (sin, cos) = (2.399_963_2 * n as f32).sin_cos();
        [r * cos, r * sin].map(|at| at.round() as i32)
    };
    (0..SAMPLES).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 64;
    const HEIGHT: usize = 48;

    /// The log ratio in row 28: an object at 1 m up to row `ends`, in front of a desk at 1.2 m,
    /// whose depth starts at row 24.
    fn log_ratio(object: impl Fn(usize) -> f32, desk: impl Fn(usize) -> f32, ends: usize) -> f32 {
        let sqrt_colors: Vec<_> = (0..WIDTH * HEIGHT)
            .map(|i| [if i / WIDTH < ends { object(i % WIDTH) } else { desk(i % WIDTH) }; 3])
            .collect();
        let depth: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if i / WIDTH < 24 { 1.0 } else { 1.2 }).collect();
        other_surface_log_ratio(&depth, &sqrt_colors, WIDTH, 4.0, 8.0)[28 * WIDTH + 32]
    }

    #[test]
    fn dark_rim_is_likelier_on_the_dark_object_than_on_the_desk() {
        // At most ln(1.05 / 0.05); some samples of the desk are on the rim.
        let rim = log_ratio(|_| 0.1, |_| 0.8, 30);
        assert!(rim > 1.0 && rim < 21f32.ln(), "{rim}");
        assert_eq!(log_ratio(|_| 0.1, |_| 0.8, 24), 0.0);
        // Surfaces of one colour, and a colour of neither surface.
        assert_eq!(log_ratio(|_| 0.1, |_| 0.1, 24), 0.0);
        assert!(log_ratio(|_| 0.1, |x| if x == 32 { 0.5 } else { 0.8 }, 24).abs() < 0.1);
        // The dark half of a striped desk: ln(1.05 / 0.55).
        let striped = log_ratio(|_| 0.1, |x| if x % 8 < 4 { 0.1 } else { 0.8 }, 24);
        assert!((striped - 0.65).abs() < 0.2, "{striped}");
    }

    #[test]
    fn ratio_is_zero_far_from_edges_and_beside_a_post_without_samples() {
        let is_post = |i: usize| (20..24).contains(&(i % WIDTH));
        let depth: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if is_post(i) { 1.0 } else { 2.0 }).collect();
        let sqrt_colors: Vec<_> = (0..depth.len()).map(|i| [if is_post(i) { 0.1 } else { 0.8 }; 3]).collect();
        assert!(other_surface_log_ratio(&depth, &sqrt_colors, WIDTH, 4.0, 8.0).iter().all(|ln| *ln == 0.0));
        let wall: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| if i % WIDTH < 32 { 1.0 } else { 2.0 }).collect();
        let log_ratios = other_surface_log_ratio(&wall, &sqrt_colors, WIDTH, 4.0, 8.0);
        assert!((0..log_ratios.len()).all(|i| log_ratios[i] == 0.0 || (24..40).contains(&(i % WIDTH))));
        assert!(other_surface_log_ratio(&[], &[], 0, 8.0, 8.0).is_empty());
    }
}
