//! The method `poisson`: vSLRcam 2008, section 3.2, Depth of Field.
//!
//! Each pixel becomes the mean over a Poisson disc around it, as wide as its own circle of
//! confusion (8). The regular pattern of so few points is removed by a second Poisson disc over the
//! result. As in the paper, a sharp surface leaks into the blurred one next to it, and a blurred
//! one ends sharply at a sharp one: points of other depths are neither rejected nor weighted. The
//! aperture is a disc, whatever its blades.
//!
//! Two extensions of the paper: an empty pixel uses the widest circle around it, so that
//! silhouettes dissolve over the camera's pixels; and the first disc is narrower by the variance
//! that the second one adds.

use crate::camera::Opening;
use crate::effects::LayerRun;
use crate::gpu::{Bytes, Gpu, Shader};
use crate::render::{COLOR, Layer};

use super::layered::{largest_radius_px, reach_px};
use super::surroundings::{LensUniform, Tiling, surroundings, with_color};

/// Points of the second disc; the same as in shaders/depth_of_field_poisson.wgsl.
const SECOND_POINTS: usize = 16;
/// Radius of the second disc, in radii of a disc as large as one point's share of the first.
const OVERLAP: f32 = 1.5;

/// Poisson-disc samples of the unit disc (Cook 1986: dart throwing; the distance shrinks until all
/// fit). They are then shifted and scaled to the disc's own middle and variance, 1/4.
pub fn poisson_disc(count: usize) -> Vec<[f64; 2]> {
    // Knuth's generator (TAOCP 2, 3.3.4): the same points on every machine.
    let mut state = 1u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut points: Vec<[f64; 2]> = Vec::with_capacity(count);
    let mut apart = 2.0;
    while points.len() < count {
        let dart = [2.0 * random() - 1.0, 2.0 * random() - 1.0];
        let free = points.iter().all(|p| (p[0] - dart[0]).hypot(p[1] - dart[1]) >= apart);
        if free && dart[0].hypot(dart[1]) <= 1.0 {
            points.push(dart);
        }
        apart *= 0.9999;
    }
    let n = count.max(1) as f64;
    let middle = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
    points.iter_mut().for_each(|p| *p = [p[0] - middle[0], p[1] - middle[1]]);
    let variance = points.iter().map(|p| p[0] * p[0] + p[1] * p[1]).sum::<f64>() / (2.0 * n);
    let scale = if variance > 0.0 { 0.5 / variance.sqrt() } else { 1.0 };
    points.iter().map(|p| p.map(|c| c * scale)).collect()
}

/// Radii of both discs relative to the circle's; their squares sum to 1.
fn radii(points: usize) -> [f32; 2] {
    let second = OVERLAP / (points as f32).sqrt();
    [(1.0 - second * second).max(0.0).sqrt(), second]
}

/// Both discs for a number of points, as the shader reads them: radii relative to the circle's,
/// second disc, first disc.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Discs(usize);

fn discs(gpu: &Gpu, Discs(points): &Discs) -> Bytes {
    let [first, second] = radii(*points);
    let texels = |count| poisson_disc(count).into_iter().map(|[x, y]| [x as f32, y as f32]);
    let all: Vec<_> = std::iter::once([first, second]).chain(texels(SECOND_POINTS)).chain(texels(*points)).collect();
    Bytes::from(&gpu.buffer("discs", bytemuck::cast_slice(&all), wgpu::BufferUsages::STORAGE))
}

/// `points`: of the first disc.
pub fn run(run: &mut LayerRun<'_>, points: usize, opening: &Opening, layer: Layer) -> Layer {
    let tiling = Tiling::coarse(layer.size, reach_px(run.context));
    let lens = LensUniform::new(run, opening, &layer, tiling, largest_radius_px(run.context), 0);
    let around = surroundings(run, &lens, &layer, tiling);
    let discs = run.recorder.memoized(Discs(points), discs);
    let pass =
        run.recorder.pass(Shader::DepthOfFieldPoisson, "first").uniform("lens", &lens).buffer("discs", discs.clone());
    let pass =
        pass.texture("color", &layer.color).texture("geometry", &layer.geometry).texture("around_tiles", &around);
    let [filtered, radii] = pass.draw([COLOR; 2], layer.size);
    let pass = run.recorder.pass(Shader::DepthOfFieldPoisson, "second").uniform("lens", &lens).buffer("discs", discs);
    let [out] = pass.texture("color", &filtered).texture("radii", &radii).draw([COLOR], layer.size);
    with_color(run, &lens, &around, layer, out)
}

/// A layer by the formula: each pixel is the mean over the disc of its own circle, `circles_px`
/// wide (where nothing was drawn, the widest one). `rgba` has `width * height` premultiplied
/// pixels; outside is empty.
pub fn twin(rgba: &[[f64; 4]], width: usize, circles_px: &[f64]) -> Vec<[f64; 4]> {
    let height = rgba.len() / width.max(1);
    let widest = circles_px.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    // Subdivisions of a pixel along a side.
    const PARTS: i64 = 4;
    let mean = |i: usize| {
        let radius = 0.5 * if rgba[i][3] > 0.0 { circles_px[i].abs() } else { widest };
        let (x, y) = ((i % width) as i64, (i / width) as i64);
        let reach = radius.ceil() as i64 + 1;
        let (mut sum, mut area) = ([0.0; 4], 0.0);
        for v in y - reach..=y + reach {
            for u in x - reach..=x + reach {
                let inside = (0..PARTS * PARTS)
                    .filter(|k| {
                        let part = |k: i64| (k as f64 + 0.5) / PARTS as f64 - 0.5;
                        ((u - x) as f64 + part(k % PARTS)).hypot((v - y) as f64 + part(k / PARTS)) <= radius
                    })
                    .count() as f64;
                area += inside;
                if u >= 0 && v >= 0 && u < width as i64 && v < height as i64 {
                    let q = rgba[v as usize * width + u as usize];
                    (0..4).for_each(|c| sum[c] += inside * q[c]);
                }
            }
        }
        if area > 0.0 { sum.map(|c| c / area) } else { rgba[i] }
    };
    (0..rgba.len()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn second_disc_has_as_many_points_as_in_the_shader() {
        assert_eq!(constant(&Shader::DepthOfFieldPoisson.module(), "SECOND_POINTS"), SECOND_POINTS as f64);
    }

    #[test]
    fn poisson_disc_points_keep_their_distance_and_have_the_discs_variance() {
        for count in [8, SECOND_POINTS, 48, 64] {
            let points = poisson_disc(count);
            assert_eq!(points.len(), count);
            let mut nearest = f64::INFINITY;
            for (i, p) in points.iter().enumerate() {
                assert!(p[0].hypot(p[1]) < 1.3, "{count}: {p:?}");
                for q in &points[..i] {
                    nearest = nearest.min((p[0] - q[0]).hypot(p[1] - q[1]));
                }
            }
            // The densest packing's distance.
            let hexagonal = (2.0 * std::f64::consts::PI / (3f64.sqrt() * count as f64)).sqrt();
            assert!(nearest > 0.6 * hexagonal, "{count}: {nearest} of {hexagonal}");
            let mean = |f: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(f).sum::<f64>() / count as f64;
            assert!(mean(&|p| p[0]).abs() < 1e-12 && mean(&|p| p[1]).abs() < 1e-12);
            assert!((mean(&|p| p[0] * p[0] + p[1] * p[1]) - 0.5).abs() < 1e-12);
        }
    }

    #[test]
    fn squared_radii_of_both_discs_sum_to_1() {
        let [first, second] = radii(48);
        assert!((first * first + second * second - 1.0).abs() < 1e-6);
    }
}
