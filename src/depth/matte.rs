//! Alpha matte of the nearer of two surfaces, at the edges of a depth map.
//!
//! Near an edge a pixel shows I = α·F + (1 − α)·B, with the light of the nearer surface F and of
//! the farther surface B. An object between the two is visible by 1 − α. α is estimated twice, and
//! both estimates are weighted by their variances:
//!
//! - From the map: the nearer surface's fraction of the pixel's footprint, along its motion during
//!   the exposure. Its variance is that of the edge's position: large near the edge, 0 away from
//!   it.
//! - From the picture (Porter and Duff's equation solved for α, as matting does):
//!   (I − B)·(F − B)/|F − B|², with the means F and B of the surroundings on either side, away from
//!   the edge. Its variance is that of these surroundings.
//!
//! The map thus decides where both sides have the same colour, and the picture where they differ.
//! Far from an edge the map has no variance, and the picture has no influence.
//!
//! Not modelled: pixels that show three surfaces; surfaces whose depths differ by less than
//! `DEPTH_STEP`.

use glam::{Vec3, Vec4};

use super::nearest_edge::{DepthEdge, MAX_BONUS_PX, edges, is_near};
use super::smear::MotionField;
use crate::parallel::{over_rows, processors};
use crate::pixels::{Rect, floor_of_small};

/// Standard error of an aligned edge's position, px.
const EDGE_SIGMA_PX: f32 = 1.5;
/// The pixel's footprint, at (−1, 0, 1) px in each direction: σ is 0.7 px.
const FOOTPRINT: [f32; 3] = [0.25, 0.5, 0.25];
/// Largest distance of a matte's pixel from the map's edge, beyond the motion blur, px.
const MATTE_RADIUS_PX: f32 = 4.0;
/// Motion between two samples of the exposure, px.
const STEP_PX: f32 = 1.5;
/// Smallest motion that is sampled, px.
const MIN_MOTION_PX: f32 = 2.0;
/// Longer motion is shortened to this, px.
const MAX_MOTION_PX: f32 = 32.0;
/// Number of samples of the two sides around a pixel.
const SAMPLES: usize = 24;
/// Radius of these samples beyond the motion blur, px.
const SAMPLE_RADIUS_PX: f32 = 7.0;
/// Largest distance of a pixel that affects a matte, px.
pub const MAX_REACH_PX: i32 = (SAMPLE_RADIUS_PX + 0.5 * MAX_MOTION_PX) as i32 + 1;
/// Smallest distance from an edge, beyond the motion blur, of a pixel that shows one surface alone,
/// px.
const CERTAIN_PX: f32 = 3.0;
/// Weight of a sample at the edge.
const MIN_EDGE_WEIGHT: f32 = 0.1;
/// Largest distance of an edge that affects a matte, px.
const MAX_EDGE_DISTANCE_PX: f32 = MATTE_RADIUS_PX.max(CERTAIN_PX) + 0.5 * MAX_MOTION_PX + 1.0;
/// Largest bonus of an edge in `nearest_edge` for its step, px.
const MAX_STEP_BONUS_PX: i32 = MAX_BONUS_PX as i32 + 1;
/// Total weight of samples at which the error of their mean is [`SPARSE_SIGMA`].
const SPARSE_WEIGHT: f32 = 0.5;
/// Samples nearer by this factor than the nearer surface belong to another object.
const OTHER_OBJECT_RATIO: f32 = 1.15;
/// Smallest standard error of a mean, linear light.
const MIN_SIGMA: f32 = 0.01;
/// Standard error of a mean of few samples, linear light.
const SPARSE_SIGMA: f32 = 0.1;
/// Smaller alphas are 0: less than half a code.
const MIN_ALPHA: f32 = 0.002;
/// Smallest variation of a side's light, as a fraction of it.
const MIN_VARIATION: f32 = 0.08;

/// The two surfaces of a pixel. With one surface `near_m` equals `far_m` and `alpha` is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MattePixel {
    /// Depth of the nearer and of the farther surface, m; 0 if unknown.
    pub near_m: f32,
    pub far_m: f32,
    /// α of the nearer surface.
    pub alpha: f32,
    /// α·(F − B), the difference of the pixel's light from the farther surface's.
    pub fringe: [f32; 3],
}

/// A map and its picture.
struct MatteInput<'a> {
    depth_m: &'a [f32],
    /// Square roots of light.
    sqrt_colors: &'a [[f32; 3]],
    edges: Vec<DepthEdge>,
    width: usize,
    height: usize,
    smear: &'a MotionField,
    /// The map's upper left pixel, in the part that `smear` covers.
    corner: [usize; 2],
    samples: DiscSamples,
}

/// The mattes of a part's pixels, row by row, where a surface is nearer than `max_depth_m`. The
/// map's edges are aligned with the picture's. `sqrt_colors` are square roots of its light.
pub fn mattes(
    depth_m: &[f32],
    sqrt_colors: &[[f32; 3]],
    width: usize,
    smear: &MotionField,
    part: Rect,
    max_depth_m: &[f32],
) -> Vec<MattePixel> {
    let columns = part.width() as usize;
    let at = |x: usize, y: usize| (part.y0 as usize + y) * width + part.x0 as usize + x;
    let opaque = |z: f32| MattePixel { near_m: z, far_m: z, alpha: 1.0, fringe: [0.0; 3] };
    let row = |y: usize| depth_m[at(0, y)..][..columns].iter().map(|z| opaque(*z));
    let mut out: Vec<MattePixel> = (0..part.height() as usize).flat_map(row).collect();
    // The region that affects the part.
    let whole = Rect::full(width as u32, (depth_m.len() / width.max(1)) as u32);
    let near = part.grown(MAX_REACH_PX + MAX_EDGE_DISTANCE_PX as i32 + MAX_STEP_BONUS_PX).intersection(&whole);
    let (depth_m, sqrt_colors) = (&whole.part(depth_m, near), &whole.part(sqrt_colors, near));
    let [width, height] = [near.width() as usize, near.height() as usize];
    let edges = edges(depth_m, width, MAX_EDGE_DISTANCE_PX);
    let Some(nearest_m) = edges.iter().filter(|e| e.distance_px < 1.0).map(|e| e.near_m).reduce(f32::min) else {
        return out;
    };
    let corner = [near.x0 as usize, near.y0 as usize];
    let input = MatteInput { depth_m, sqrt_colors, edges, width, height, smear, corner, samples: DiscSamples::new() };
    let first = [(part.x0 - near.x0) as usize, (part.y0 - near.y0) as usize];
    let reach_px = MATTE_RADIUS_PX + 0.5 * smear.max_length_px(nearest_m).min(MAX_MOTION_PX);
    over_rows(&mut out, columns, processors(), |y, row| {
        let start = (first[1] + y) * width + first[0];
        let row = row.iter_mut().zip(&input.edges[start..]).zip(&depth_m[start..]).zip(&max_depth_m[y * columns..]);
        for (x, (((matte, edge), z), max_depth_m)) in row.enumerate() {
            if edge.distance_px <= reach_px
                && edge.near_m.min(*z) < *max_depth_m
                && let Some(solved) = input.matte_at(&input.pixel(first[0] + x, first[1] + y))
            {
                *matte = solved;
            }
        }
    });
    out
}

/// Samples of the unit disc and their weights: a spiral of Vogel's.
struct DiscSamples {
    across: [f32; SAMPLES],
    down: [f32; SAMPLES],
    weights: [f32; SAMPLES],
}

impl DiscSamples {
    fn new() -> Self {
        let radius = |n: usize| ((n as f32 + 0.5) / SAMPLES as f32).sqrt();
        let turn = |n: usize| 2.399_963_2 * n as f32;
        Self {
            across: std::array::from_fn(|n| radius(n) * turn(n).cos()),
            down: std::array::from_fn(|n| radius(n) * turn(n).sin()),
            weights: std::array::from_fn(|n| (-2.0 * radius(n) * radius(n)).exp()),
        }
    }
}

/// Rounds a small number to the nearest integer, without a call into the mathematics library.
fn round(x: f32) -> i32 {
    let above = floor_of_small(x.abs() + 0.5);
    if x < 0.0 { -above } else { above }
}

/// A pixel with the motion of its nearer surface during the exposure.
struct MovingPixel {
    i: usize,
    x: i32,
    y: i32,
    motion_px: [f32; 2],
    /// Length of the motion, px.
    motion_length_px: f32,
}

impl MatteInput<'_> {
    fn pixel(&self, x: usize, y: usize) -> MovingPixel {
        let i = y * self.width + x;
        let [across, down] = self.smear.at(self.corner[0] + x, self.corner[1] + y, self.edges[i].near_m);
        let motion_length_px = (across * across + down * down).sqrt();
        let shorter = (MAX_MOTION_PX / motion_length_px.max(1e-3)).min(1.0);
        let motion_px = [shorter * across, shorter * down];
        MovingPixel { i, x: x as i32, y: y as i32, motion_px, motion_length_px: shorter * motion_length_px }
    }

    fn offset_index(&self, at: &MovingPixel, dx: i32, dy: i32) -> Option<usize> {
        let (x, y) = (at.x + dx, at.y + dy);
        let inside = x >= 0 && y >= 0 && x < self.width as i32 && y < self.height as i32;
        inside.then(|| y as usize * self.width + x as usize)
    }

    /// α from the map alone. `None` if its depth is unknown.
    fn map_alpha(&self, at: &MovingPixel, both_m: [f32; 2]) -> Option<f32> {
        let (mut near, mut all) = (0.0, 0.0);
        let mut sample = |[dx, dy]: [i32; 2], weight: f32| {
            if let Some(i) = self.offset_index(at, dx, dy) {
                all += weight;
                near += if is_near(self.depth_m[i], both_m) { weight } else { 0.0 };
            }
        };
        let footprint = || (-1..).zip(FOOTPRINT);
        if at.motion_length_px >= MIN_MOTION_PX {
            // Motion replaces the footprint along its direction.
            let steps = round(at.motion_length_px / STEP_PX + 0.5);
            let [x, y] = at.motion_px;
            for step in 0..steps {
                let along = (step as f32 + 0.5) / steps as f32 - 0.5;
                for (beside, weight) in footprint() {
                    let aside = beside as f32 / at.motion_length_px;
                    sample([round(along * x - aside * y), round(along * y + aside * x)], weight);
                }
            }
        } else {
            footprint().for_each(|(dy, down)| footprint().for_each(|(dx, across)| sample([dx, dy], down * across)));
        }
        (both_m[0] > 0.0 && all > 0.0).then(|| near / all)
    }

    fn matte_at(&self, at: &MovingPixel) -> Option<MattePixel> {
        let i = at.i;
        if self.edges[i].distance_px > MATTE_RADIUS_PX + 0.5 * at.motion_length_px {
            return None;
        }
        let both_m = self.edges[i].surface_depths_m(self.depth_m[i]);
        let ([near_m, far_m], map_alpha) = (both_m, self.map_alpha(at, both_m)?);
        // Of a Bernoulli variable, with an edge that is displaced by its error.
        let sigma2 = EDGE_SIGMA_PX * EDGE_SIGMA_PX + at.motion_length_px * at.motion_length_px / 12.0;
        let distance_px = self.edges[i].distance_px;
        let map_variance = 0.25 * (-0.5 * distance_px * distance_px / sigma2).exp();
        let [r, g, b] = self.sqrt_colors[i];
        let light = [r * r, g * g, b * b];
        let [near, far] = self.sides(at, both_m);
        let Some(far) = far else { return Some(MattePixel { near_m, far_m, alpha: map_alpha, fringe: [0.0; 3] }) };
        // An object too thin for samples: the pixel's own light replaces its.
        let Some(near) = near else {
            let fringe = fringe(map_alpha, light, light, far.light, 0.0);
            return Some(MattePixel { near_m, far_m, alpha: map_alpha, fringe });
        };
        let (near_light, far_light) = (Vec3::from(near.light), Vec3::from(far.light));
        let difference = near_light - far_light;
        let square = difference.length_squared();
        let along = (Vec3::from(light) - far_light).dot(difference);
        let picture_alpha = (along / square.max(1e-9)).clamp(0.0, 1.0);
        let picture_variance =
            (near.variance * picture_alpha + far.variance * (1.0 - picture_alpha)) / square.max(1e-9);
        let picture_weight = map_variance / (map_variance + picture_variance).max(1e-12);
        let alpha = map_alpha + picture_weight * (picture_alpha - map_alpha);
        // A pixel that is fully covered keeps the camera's light exactly.
        let alpha = if (MIN_ALPHA..=1.0 - MIN_ALPHA).contains(&alpha) { alpha } else { alpha.round() };
        let fringe = fringe(alpha, light, near.light, far.light, near.variance.sqrt());
        Some(MattePixel { near_m, far_m, alpha, fringe })
    }

    /// Light of the nearer and of the farther side around a pixel. `None` for a side without
    /// samples.
    fn sides(&self, at: &MovingPixel, both_m: [f32; 2]) -> [Option<EdgeSide>; 2] {
        let per_margin = 1.0 / (CERTAIN_PX + 0.5 * at.motion_length_px);
        let radius_px = SAMPLE_RADIUS_PX + 0.5 * at.motion_length_px;
        let [mut near, mut far] = [ColorMoments::default(); 2];
        // A loop without branches, which is vectorised. `array::map` is not inlined in a
        // development build.
        let (mut across, mut down) = ([0; SAMPLES], [0; SAMPLES]);
        for n in 0..SAMPLES {
            across[n] = round(radius_px * self.samples.across[n]);
            down[n] = round(radius_px * self.samples.down[n]);
        }
        for ((dx, dy), weight) in across.into_iter().zip(down).zip(&self.samples.weights) {
            let Some(q) = self.offset_index(at, dx, dy) else { continue };
            let z = self.depth_m[q];
            let is_far = !is_near(z, both_m);
            // All farther samples count for the far side. A much nearer one is another object.
            let is_side = is_far || z * OTHER_OBJECT_RATIO > both_m[0];
            let certain = (self.edges[q].distance_px * per_margin).clamp(MIN_EDGE_WEIGHT, 1.0);
            let weight = if is_side { weight * certain * certain } else { 0.0 };
            // Added to both sides, with the weight 0 to one of them: a branch would be
            // unpredictable.
            let light = Vec3::from(self.sqrt_colors[q]).extend(1.0);
            near.add(light * light, if is_far { 0.0 } else { weight });
            far.add(light * light, if is_far { weight } else { 0.0 });
        }
        [near, far].map(|sums| sums.side())
    }
}

/// α·(F − B), the light to add per covered fraction of a pixel where the farther surface is
/// covered, so that α·F remains. F is clamped to the colours of the nearer surface around, or
/// between them and the pixel's own: a farther surface that is darker here than around must not
/// cause a dark rim.
fn fringe(alpha: f32, light: [f32; 3], near: [f32; 3], far: [f32; 3], variation: f32) -> [f32; 3] {
    let rest = (1.0 - alpha).max(1e-3);
    let channel = |c: usize| {
        let [low, high] = [near[c] - 2.0 * variation, near[c] + 2.0 * variation];
        let left = light[c] + rest * (near[c] - far[c]);
        alpha * (left.clamp(low.min(light[c]).max(0.0), high.max(light[c])) - light[c]) / rest
    };
    [channel(0), channel(1), channel(2)]
}

/// Mean light of one side of an edge, and the variance of a pixel's light along the difference of
/// both sides.
#[derive(Clone, Copy)]
struct EdgeSide {
    light: [f32; 3],
    variance: f32,
}

/// Weighted sums over samples. The last component of `light` is the sum of the weights.
#[derive(Clone, Copy, Default)]
struct ColorMoments {
    light: Vec4,
    squares: Vec4,
}

impl ColorMoments {
    fn add(&mut self, light: Vec4, weight: f32) {
        let weighted = weight * light;
        self.light += weighted;
        self.squares += weighted * light;
    }

    fn side(&self) -> Option<EdgeSide> {
        let [r, g, b, weight] = self.light.to_array();
        if weight == 0.0 {
            return None;
        }
        let light = [r / weight, g / weight, b / weight];
        let variation = |c: usize| (self.squares[c] / weight - light[c] * light[c]).max(0.0);
        let min_sigma = MIN_SIGMA + MIN_VARIATION * light.iter().fold(0.0f32, |brightest, l| brightest.max(*l));
        // The largest variance of the three channels approximates that along the difference.
        let variance = (0..3).map(variation).fold(min_sigma * min_sigma, f32::max);
        let few = SPARSE_WEIGHT / weight;
        Some(EdgeSide { light, variance: variance + few * few * SPARSE_SIGMA * SPARSE_SIGMA })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Geometry;
    use crate::pose::Pose;
    use glam::{DQuat, DVec3};

    const WIDTH: usize = 64;
    const HEIGHT: usize = 48;
    const FAR: [f32; 3] = [0.7, 0.5, 0.3];

    /// An object at 1 m in front of a wall at 2 m. It ends at `edge_px`, and in the map `off`
    /// pixels farther right.
    fn mattes_of_edge(near: [f32; 3], edge_px: f32, off: i32, moved_px: f64) -> Vec<MattePixel> {
        let covered = |x: usize| (edge_px - x as f32).clamp(0.0, 1.0);
        let light = |x: usize| [0, 1, 2].map(|c| covered(x) * near[c] + (1.0 - covered(x)) * FAR[c]);
        let sqrt_colors: Vec<_> = (0..WIDTH * HEIGHT).map(|i| light(i % WIDTH).map(f32::sqrt)).collect();
        let ends = edge_px.round() as i32 + off;
        let depth: Vec<f32> =
            (0..WIDTH * HEIGHT).map(|i| if ((i % WIDTH) as i32) < ends { 1.0 } else { 2.0 }).collect();
        let at = |x: f64| Pose::from_camera_in_world(DVec3::new(x, 0.0, 0.0), DQuat::IDENTITY);
        let whole = Rect::full(WIDTH as u32, HEIGHT as u32);
        let half_m = 0.5 * moved_px / 100.0;
        let camera = Geometry::pinhole(WIDTH as u32, HEIGHT as u32, 100.0);
        let smear = MotionField::new(&camera, &at(0.0), [&at(-half_m), &at(half_m)], whole);
        let all = mattes(&depth, &sqrt_colors, WIDTH, &smear, whole, &[9.0; WIDTH * HEIGHT]);
        // A part has the mattes of the whole.
        let part = Rect::new(9, 7, 50, 40);
        assert_eq!(mattes(&depth, &sqrt_colors, WIDTH, &smear, part, &[9.0; WIDTH * HEIGHT]), whole.part(&all, part));
        all
    }

    #[test]
    fn part_has_the_mattes_of_the_whole() {
        let (width, height) = (240, 200);
        // Objects at many depths, also around the part and beyond its region.
        let depth: Vec<f32> = (0..width * height)
            .map(|i| {
                let (x, y): (usize, usize) = (i % width, i / width);
                if (x / 17 + y / 13).is_multiple_of(3) { 1.0 + 0.1 * ((x / 17 + 5 * (y / 13)) % 7) as f32 } else { 3.0 }
            })
            .collect();
        let sqrt_colors: Vec<[f32; 3]> =
            depth.iter().enumerate().map(|(i, z)| [0.2 * z, 0.4, (i % 29) as f32 / 40.0]).collect();
        let camera = Geometry::pinhole(width as u32, height as u32, 200.0);
        let at = |turn: f64| Pose::from_camera_in_world(DVec3::ZERO, DQuat::from_rotation_z(turn));
        let (all, part) = (Rect::full(width as u32, height as u32), Rect::new(100, 80, 130, 110));
        assert!(!part.grown(MAX_REACH_PX + MAX_EDGE_DISTANCE_PX as i32 + MAX_STEP_BONUS_PX).contains(0, 0));
        let max_depth_m = vec![9.0; width * height];
        for turned in [0.0, 0.3] {
            let smear = MotionField::new(&camera, &at(0.0), [&at(-turned), &at(turned)], all);
            let whole = mattes(&depth, &sqrt_colors, width, &smear, all, &max_depth_m);
            let of_part = mattes(&depth, &sqrt_colors, width, &smear, part, &max_depth_m[..30 * 30]);
            assert_eq!(of_part, all.part(&whole, part), "{turned}");
            assert!(of_part.iter().filter(|matte| matte.near_m < matte.far_m).count() > 100);
        }
    }

    fn row(all: &[MattePixel]) -> &[MattePixel] {
        &all[HEIGHT / 2 * WIDTH..][..WIDTH]
    }

    #[test]
    fn alpha_follows_the_picture_if_the_map_is_a_pixel_off() {
        for off in [-1, 0, 1] {
            let all = mattes_of_edge([0.05; 3], 30.3, off, 0.0);
            for (x, matte) in row(&all).iter().enumerate() {
                let truth = (30.3 - x as f32).clamp(0.0, 1.0);
                assert!((matte.alpha - truth).abs() < 0.1 || matte.near_m == matte.far_m, "{off}, {x}: {matte:?}");
                if matte.near_m < matte.far_m {
                    assert_eq!((matte.near_m, matte.far_m), (1.0, 2.0));
                }
            }
        }
    }

    #[test]
    fn virtual_copy_of_the_background_restores_the_picture() {
        // A virtual copy of the wall between both: A = 1, V = B (1).
        let all = mattes_of_edge([0.05, 0.2, 0.6], 30.4, 0, 0.0);
        for (x, matte) in row(&all).iter().enumerate().filter(|(_, matte)| matte.near_m < matte.far_m) {
            let truth = (30.4 - x as f32).clamp(0.0, 1.0);
            for c in 0..3 {
                let light = truth * [0.05, 0.2, 0.6][c] + (1.0 - truth) * FAR[c];
                let left = 1.0 - matte.alpha;
                let out = left * FAR[c] + (1.0 - left) * light + left * matte.fringe[c];
                // Two codes of 255 at this brightness.
                assert!((out - light).abs() < 0.012, "{x}: {out} is not {light}, {matte:?}");
            }
        }
    }

    #[test]
    fn alpha_of_equal_colours_is_the_maps_along_the_motion() {
        let still = mattes_of_edge(FAR, 30.0, 0, 0.0);
        let alphas = |all: &[MattePixel]| [26, 29, 30, 33].map(|x| row(all)[x].alpha);
        let is = |actual: [f32; 4], expected: [f32; 4], within: f32| {
            assert!(actual.iter().zip(expected).all(|(f, e)| (f - e).abs() < within), "{actual:?}");
        };
        is(alphas(&still), [1.0, 0.75, 0.25, 0.0], 1e-5);
        // 8 px: a ramp as long.
        is(alphas(&mattes_of_edge(FAR, 30.0, 0, 8.0)), [0.94, 0.56, 0.44, 0.06], 0.08);
        assert!(row(&still).iter().all(|matte| matte.fringe.iter().all(|f| f.abs() < 1e-4)));
    }
}
