//! How much of each pixel at an edge belongs to the nearer of the two surfaces that meet there.
//!
//! Near an edge of the depth map a pixel shows I = α·F + (1 − α)·B, light of the nearer surface F
//! and of the farther B. An object between the two shows by 1 − α. α is estimated twice, and both
//! estimates are weighted by their variances:
//!
//! - From the map: the nearer side's share under the pixel's own spread, along its motion while the
//!   shutter is open. Its variance is that of the edge's position: large near the edge, none away
//!   from it.
//! - From the picture (Porter and Duff's equation solved for α, as matting does):
//!   (I − B)·(F − B)/|F − B|², with F and B the means of the surroundings on either side, away from
//!   the edge. Its variance is that of these surroundings.
//!
//! So where both sides look alike the map decides, and where they differ the picture does. Far from
//! an edge the map is certain whatever the picture shows.
//!
//! Not modelled: pixels that show three surfaces; surfaces whose depths differ by less than `JUMP`.

use glam::{Vec3, Vec4};

use super::nearest_edge::{Edge, MOST_PX, edges, is_near};
use super::smear::Smear;
use crate::parallel::{over_rows, processors};
use crate::pixels::{Rect, floor_of_small};

/// How far an edge that was moved to the picture's is still off, σ in px.
const MISPLACED_PX: f32 = 1.5;
/// The pixel's own spread, at (−1, 0, 1) px in each direction: σ is 0.7 px.
const SPREAD: [f32; 3] = [0.25, 0.5, 0.25];
/// Beyond the blur, the edge may matter this far from where the map has it, px.
const BESIDE_PX: f32 = 4.0;
/// The picture moves by so much between two samples of the exposure, px.
const STEP_PX: f32 = 1.5;
/// From here on it moves, px.
const MOVES_PX: f32 = 2.0;
/// A longer way is treated as this one, px.
const LONGEST_PX: f32 = 32.0;
/// Places around a pixel at which the two sides are sampled, and how far beyond the blur they may
/// lie, px.
const PLACES: usize = 24;
const AROUND_PX: f32 = 7.0;
/// Nothing farther away is looked at, px.
pub const FARTHEST_PX: i32 = (AROUND_PX + 0.5 * LONGEST_PX) as i32 + 1;
/// At this distance from an edge, beyond the blur, a pixel shows one surface alone, px; and the
/// weight of a pixel at the edge.
const CERTAIN_PX: f32 = 3.0;
const UNCERTAIN: f32 = 0.1;
/// Beyond this no edge matters, px.
const FARTHEST_EDGE_PX: f32 = BESIDE_PX.max(CERTAIN_PX) + 0.5 * LONGEST_PX + 1.0;
/// By so much an edge counts as nearer than it is, at most, because its step is large, px.
const STEP_WORTH_PX: i32 = MOST_PX as i32 + 1;
/// Places of this weight in all tell half of how a side looks.
const HALF: f32 = 0.5;
/// Something nearer by this factor is another thing.
const ANOTHER: f32 = 1.15;
/// σ of a mean's error that is always there, linear light.
const LEAST_SIGMA: f32 = 0.01;
/// σ of the light of a side that few places tell.
const UNKNOWN: f32 = 0.1;
/// A smaller share of a pixel is none: under half a code.
const LEAST: f32 = 0.002;
/// A side is at least this uneven: a share of its light.
const UNEVEN: f32 = 0.08;

/// What a pixel shows of two surfaces. Where there is one, `near_m` is `far_m` and `share` is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MattePixel {
    /// Depth of the nearer and of the farther surface, m; 0 if unknown.
    pub near_m: f32,
    pub far_m: f32,
    /// α, the nearer one's.
    pub share: f32,
    /// α·(F − B): by how much the pixel's light differs from the farther surface's.
    pub fringe: [f32; 3],
}

/// A map and its picture.
struct Seen<'a> {
    depth_m: &'a [f32],
    /// Square roots of light.
    sqrt_colors: &'a [[f32; 3]],
    edges: Vec<Edge>,
    width: usize,
    height: usize,
    smear: &'a Smear,
    /// Its upper left pixel, in the part that `smear` covers.
    corner: [usize; 2],
    places: Places,
}

/// The mattes of a part's pixels, row by row, where a surface is nearer than `max_depth_m`. The
/// map's edges lie on the picture's; `sqrt_colors` are square roots of its light.
pub fn shares(
    depth_m: &[f32],
    sqrt_colors: &[[f32; 3]],
    width: usize,
    smear: &Smear,
    part: Rect,
    max_depth_m: &[f32],
) -> Vec<MattePixel> {
    let columns = part.width() as usize;
    let at = |x: usize, y: usize| (part.y0 as usize + y) * width + part.x0 as usize + x;
    let unshared = |z: f32| MattePixel { near_m: z, far_m: z, share: 1.0, fringe: [0.0; 3] };
    let row = |y: usize| depth_m[at(0, y)..][..columns].iter().map(|z| unshared(*z));
    let mut out: Vec<MattePixel> = (0..part.height() as usize).flat_map(row).collect();
    // All that is looked at.
    let whole = Rect::full(width as u32, (depth_m.len() / width.max(1)) as u32);
    let near = part.grown(FARTHEST_PX + FARTHEST_EDGE_PX as i32 + STEP_WORTH_PX).intersection(&whole);
    let (depth_m, sqrt_colors) = (&whole.part(depth_m, near), &whole.part(sqrt_colors, near));
    let [width, height] = [near.width() as usize, near.height() as usize];
    let edges = edges(depth_m, width, FARTHEST_EDGE_PX);
    let Some(nearest_m) = edges.iter().filter(|e| e.distance_px < 1.0).map(|e| e.near_m).reduce(f32::min) else {
        return out;
    };
    let corner = [near.x0 as usize, near.y0 as usize];
    let seen = Seen { depth_m, sqrt_colors, edges, width, height, smear, corner, places: Places::new() };
    let first = [(part.x0 - near.x0) as usize, (part.y0 - near.y0) as usize];
    let reach_px = BESIDE_PX + 0.5 * smear.longest_px(nearest_m).min(LONGEST_PX);
    over_rows(&mut out, columns, processors(), |y, row| {
        let start = (first[1] + y) * width + first[0];
        let row = row.iter_mut().zip(&seen.edges[start..]).zip(&depth_m[start..]).zip(&max_depth_m[y * columns..]);
        for (x, (((shared, edge), z), max_depth_m)) in row.enumerate() {
            if edge.distance_px <= reach_px
                && edge.near_m.min(*z) < *max_depth_m
                && let Some(found) = seen.shared(&seen.pixel(first[0] + x, first[1] + y))
            {
                *shared = found;
            }
        }
    });
    out
}

/// Places around a pixel, within a radius of 1, and their weights: a spiral of Vogel's.
struct Places {
    across: [f32; PLACES],
    down: [f32; PLACES],
    weights: [f32; PLACES],
}

impl Places {
    fn new() -> Self {
        let radius = |n: usize| ((n as f32 + 0.5) / PLACES as f32).sqrt();
        let turn = |n: usize| 2.399_963_2 * n as f32;
        Self {
            across: std::array::from_fn(|n| radius(n) * turn(n).cos()),
            down: std::array::from_fn(|n| radius(n) * turn(n).sin()),
            weights: std::array::from_fn(|n| (-2.0 * radius(n) * radius(n)).exp()),
        }
    }
}

/// The nearest whole number of what is small: without a call into the mathematics library.
fn whole(x: f32) -> i32 {
    let above = floor_of_small(x.abs() + 0.5);
    if x < 0.0 { -above } else { above }
}

/// A pixel, and how far what it shows of the nearer surface moves while the shutter is open, px.
struct Pixel {
    i: usize,
    x: i32,
    y: i32,
    way_px: [f32; 2],
    /// Its length.
    far_px: f32,
}

impl Seen<'_> {
    fn pixel(&self, x: usize, y: usize) -> Pixel {
        let i = y * self.width + x;
        let [across, down] = self.smear.at(self.corner[0] + x, self.corner[1] + y, self.edges[i].near_m);
        let far_px = (across * across + down * down).sqrt();
        let shorter = (LONGEST_PX / far_px.max(1e-3)).min(1.0);
        let way_px = [shorter * across, shorter * down];
        Pixel { i, x: x as i32, y: y as i32, way_px, far_px: shorter * far_px }
    }

    fn beside(&self, at: &Pixel, dx: i32, dy: i32) -> Option<usize> {
        let (x, y) = (at.x + dx, at.y + dy);
        let inside = x >= 0 && y >= 0 && x < self.width as i32 && y < self.height as i32;
        inside.then(|| y as usize * self.width + x as usize)
    }

    /// α by the map alone. `None` where nothing is known.
    fn expected(&self, at: &Pixel, both_m: [f32; 2]) -> Option<f32> {
        let (mut near, mut all) = (0.0, 0.0);
        let mut look = |[dx, dy]: [i32; 2], weight: f32| {
            if let Some(i) = self.beside(at, dx, dy) {
                all += weight;
                near += if is_near(self.depth_m[i], both_m) { weight } else { 0.0 };
            }
        };
        let spread = || (-1..).zip(SPREAD);
        if at.far_px >= MOVES_PX {
            // Along its way the pixel is spread by moving.
            let steps = whole(at.far_px / STEP_PX + 0.5);
            let [x, y] = at.way_px;
            for step in 0..steps {
                let along = (step as f32 + 0.5) / steps as f32 - 0.5;
                for (beside, weight) in spread() {
                    let aside = beside as f32 / at.far_px;
                    look([whole(along * x - aside * y), whole(along * y + aside * x)], weight);
                }
            }
        } else {
            spread().for_each(|(dy, down)| spread().for_each(|(dx, across)| look([dx, dy], down * across)));
        }
        (both_m[0] > 0.0 && all > 0.0).then(|| near / all)
    }

    fn shared(&self, at: &Pixel) -> Option<MattePixel> {
        let i = at.i;
        if self.edges[i].distance_px > BESIDE_PX + 0.5 * at.far_px {
            return None;
        }
        let both_m = self.edges[i].both_m(self.depth_m[i]);
        let ([near_m, far_m], expected) = (both_m, self.expected(at, both_m)?);
        // Whose the pixel is, where the edge may be misplaced: the variance of a yes or no.
        let spread2 = MISPLACED_PX * MISPLACED_PX + at.far_px * at.far_px / 12.0;
        let distance_px = self.edges[i].distance_px;
        let map_variance = 0.25 * (-0.5 * distance_px * distance_px / spread2).exp();
        let [r, g, b] = self.sqrt_colors[i];
        let light = [r * r, g * g, b * b];
        let [near, far] = self.sides(at, both_m);
        let Some(far) = far else { return Some(MattePixel { near_m, far_m, share: expected, fringe: [0.0; 3] }) };
        // A thing too thin to show its own light: what the pixel shows stands for it.
        let Some(near) = near else {
            let fringe = fringe(expected, light, light, far.light, 0.0);
            return Some(MattePixel { near_m, far_m, share: expected, fringe });
        };
        let (near_light, far_light) = (Vec3::from(near.light), Vec3::from(far.light));
        let apart = near_light - far_light;
        let square = apart.length_squared();
        let along = (Vec3::from(light) - far_light).dot(apart);
        let seen = (along / square.max(1e-9)).clamp(0.0, 1.0);
        let seen_variance = (near.variance * seen + far.variance * (1.0 - seen)) / square.max(1e-9);
        let by_picture = map_variance / (map_variance + seen_variance).max(1e-12);
        let share = expected + by_picture * (seen - expected);
        // What is hidden whole stays the camera's to the last bit.
        let share = if (LEAST..=1.0 - LEAST).contains(&share) { share } else { share.round() };
        let fringe = fringe(share, light, near.light, far.light, near.variance.sqrt());
        Some(MattePixel { near_m, far_m, share, fringe })
    }

    /// How the two sides look around a pixel, where any of them is seen.
    fn sides(&self, at: &Pixel, both_m: [f32; 2]) -> [Option<Side>; 2] {
        let per_margin = 1.0 / (CERTAIN_PX + 0.5 * at.far_px);
        let radius_px = AROUND_PX + 0.5 * at.far_px;
        let [mut near, mut far] = [Sums::default(); 2];
        // A loop without branches, which is vectorised. `array::map` is not inlined in a
        // development build.
        let (mut across, mut down) = ([0; PLACES], [0; PLACES]);
        for n in 0..PLACES {
            across[n] = whole(radius_px * self.places.across[n]);
            down[n] = whole(radius_px * self.places.down[n]);
        }
        for ((dx, dy), weight) in across.into_iter().zip(down).zip(&self.places.weights) {
            let Some(q) = self.beside(at, dx, dy) else { continue };
            let z = self.depth_m[q];
            let is_far = !is_near(z, both_m);
            // Whatever is farther lies behind, and what is much nearer is another thing.
            let is_side = is_far || z * ANOTHER > both_m[0];
            let certain = (self.edges[q].distance_px * per_margin).clamp(UNCERTAIN, 1.0);
            let weight = if is_side { weight * certain * certain } else { 0.0 };
            // Added to both sides, to one of them as nothing: a branch could not be predicted.
            let light = Vec3::from(self.sqrt_colors[q]).extend(1.0);
            near.add(light * light, if is_far { 0.0 } else { weight });
            far.add(light * light, if is_far { weight } else { 0.0 });
        }
        [near, far].map(|sums| sums.side())
    }
}

/// Light that is added where the farther surface is covered, per covered share of a pixel:
/// α·(F − B), so that α·F of the pixel's light is left. F lies within the colours of the nearer
/// surface around, or between them and the pixel's own: a farther surface that is darker here than
/// around must not leave a dark rim.
fn fringe(share: f32, light: [f32; 3], near: [f32; 3], far: [f32; 3], uneven: f32) -> [f32; 3] {
    let rest = (1.0 - share).max(1e-3);
    let channel = |c: usize| {
        let [low, high] = [near[c] - 2.0 * uneven, near[c] + 2.0 * uneven];
        let left = light[c] + rest * (near[c] - far[c]);
        share * (left.clamp(low.min(light[c]).max(0.0), high.max(light[c])) - light[c]) / rest
    };
    [channel(0), channel(1), channel(2)]
}

/// The light of one side of an edge, and the variance of a pixel's about it, along the difference
/// of the two.
#[derive(Clone, Copy)]
struct Side {
    light: [f32; 3],
    variance: f32,
}

/// Of places by their weights; the last of the light is the weights themselves.
#[derive(Clone, Copy, Default)]
struct Sums {
    light: Vec4,
    squares: Vec4,
}

impl Sums {
    fn add(&mut self, light: Vec4, weight: f32) {
        let weighted = weight * light;
        self.light += weighted;
        self.squares += weighted * light;
    }

    fn side(&self) -> Option<Side> {
        let [r, g, b, weight] = self.light.to_array();
        if weight == 0.0 {
            return None;
        }
        let light = [r / weight, g / weight, b / weight];
        let uneven = |c: usize| (self.squares[c] / weight - light[c] * light[c]).max(0.0);
        let least = LEAST_SIGMA + UNEVEN * light.iter().fold(0.0f32, |most, l| most.max(*l));
        // The largest of the three channels' stands for that along the difference.
        let variance = (0..3).map(uneven).fold(least * least, f32::max);
        let few = HALF / weight;
        Some(Side { light, variance: variance + few * few * UNKNOWN * UNKNOWN })
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

    /// A thing at 1 m before a wall at 2 m. It ends at `edge_px`, in the map `off` pixels beside.
    fn found(near: [f32; 3], edge_px: f32, off: i32, moved_px: f64) -> Vec<MattePixel> {
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
        let smear = Smear::new(&camera, &at(0.0), [&at(-half_m), &at(half_m)], whole);
        let all = shares(&depth, &sqrt_colors, WIDTH, &smear, whole, &[9.0; WIDTH * HEIGHT]);
        // A part is a part of the whole.
        let part = Rect::new(9, 7, 50, 40);
        assert_eq!(shares(&depth, &sqrt_colors, WIDTH, &smear, part, &[9.0; WIDTH * HEIGHT]), whole.part(&all, part));
        all
    }

    #[test]
    fn a_part_is_a_part_of_the_whole_though_less_is_looked_at() {
        let (width, height) = (240, 200);
        // Things of many depths, also around the part and a little beyond what can matter.
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
        assert!(!part.grown(FARTHEST_PX + FARTHEST_EDGE_PX as i32 + STEP_WORTH_PX).contains(0, 0));
        let max_depth_m = vec![9.0; width * height];
        for turned in [0.0, 0.3] {
            let smear = Smear::new(&camera, &at(0.0), [&at(-turned), &at(turned)], all);
            let whole = shares(&depth, &sqrt_colors, width, &smear, all, &max_depth_m);
            let of_part = shares(&depth, &sqrt_colors, width, &smear, part, &max_depth_m[..30 * 30]);
            assert_eq!(of_part, all.part(&whole, part), "{turned}");
            assert!(of_part.iter().filter(|shared| shared.near_m < shared.far_m).count() > 100);
        }
    }

    fn row(all: &[MattePixel]) -> &[MattePixel] {
        &all[HEIGHT / 2 * WIDTH..][..WIDTH]
    }

    #[test]
    fn the_picture_says_where_a_pixel_is_shared_even_if_the_map_is_off() {
        for off in [-1, 0, 1] {
            let all = found([0.05; 3], 30.3, off, 0.0);
            for (x, shared) in row(&all).iter().enumerate() {
                let truth = (30.3 - x as f32).clamp(0.0, 1.0);
                assert!((shared.share - truth).abs() < 0.1 || shared.near_m == shared.far_m, "{off}, {x}: {shared:?}");
                if shared.near_m < shared.far_m {
                    assert_eq!((shared.near_m, shared.far_m), (1.0, 2.0));
                }
            }
        }
    }

    #[test]
    fn what_looks_like_the_wall_behind_gives_the_wall_back() {
        // A virtual copy of the wall between both: A = 1, V = B (1).
        let all = found([0.05, 0.2, 0.6], 30.4, 0, 0.0);
        for (x, shared) in row(&all).iter().enumerate().filter(|(_, shared)| shared.near_m < shared.far_m) {
            let truth = (30.4 - x as f32).clamp(0.0, 1.0);
            for c in 0..3 {
                let light = truth * [0.05, 0.2, 0.6][c] + (1.0 - truth) * FAR[c];
                let left = 1.0 - shared.share;
                let out = left * FAR[c] + (1.0 - left) * light + left * shared.fringe[c];
                // Two codes of 255 at this brightness.
                assert!((out - light).abs() < 0.012, "{x}: {out} is not {light}, {shared:?}");
            }
        }
    }

    #[test]
    fn where_both_look_alike_the_map_decides_along_the_way_of_the_camera() {
        let still = found(FAR, 30.0, 0, 0.0);
        let shares = |all: &[MattePixel]| [26, 29, 30, 33].map(|x| row(all)[x].share);
        let is = |found: [f32; 4], expected: [f32; 4], within: f32| {
            assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < within), "{found:?}");
        };
        is(shares(&still), [1.0, 0.75, 0.25, 0.0], 1e-5);
        // 8 px: a ramp as long.
        is(shares(&found(FAR, 30.0, 0, 8.0)), [0.94, 0.56, 0.44, 0.06], 0.08);
        assert!(row(&still).iter().all(|shared| shared.fringe.iter().all(|f| f.abs() < 1e-4)));
    }
}
