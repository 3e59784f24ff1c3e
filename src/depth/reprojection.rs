//! Reprojection of depth maps into another pose of the camera, 16 points at a time.
//!
//! A frame needs millions of points. Single precision is exact to a thousandth of a pixel, and
//! loops without branches compile to vector instructions. Points outside the validity of the
//! distortion formula are projected by the exact camera model.
//!
//! Only the corners of a tile of a map are reprojected, at its nearest and its farthest depth;
//! other points are interpolated. At one depth the new position is a smooth function of the old
//! one, and along a ray it is nearly linear in inverse depth. Probes at the tile's centre verify
//! both.

use glam::{DVec3, Mat3, Vec2, Vec3};

use crate::camera::{Distortion, Geometry, LensModel};
use crate::pixels::{DepthMap, Rect, floor, floor_of_small};
use crate::pose::Pose;

/// Number of points in a vector.
pub const LANES: usize = 16;

/// Largest interpolation error at a tile's centre, px.
const MAX_INTERPOLATION_ERROR_PX: f32 = 0.1;
/// Number of a tile's probes: its corners and its centre, each at the nearest and at the farthest
/// depth, and the centre at the mean inverse depth.
const PROBES: usize = 11;

/// Points in camera coordinates, m.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointBatch {
    x: [f32; LANES],
    y: [f32; LANES],
    z: [f32; LANES],
    is_measured: [bool; LANES],
}

/// Image positions and depths of reprojected points.
#[derive(Clone, Copy, Debug)]
pub struct ReprojectedPoints {
    pub x_px: [f32; LANES],
    pub y_px: [f32; LANES],
    /// m; 0 for points that are not visible.
    pub depth_m: [f32; LANES],
}

impl ReprojectedPoints {
    /// Row-major indices of their pixels in a rectangle; one past the last for points that are not
    /// visible or outside. Without branches, for vector instructions.
    pub fn pixels(&self, of: Rect) -> [usize; LANES] {
        let [x0, x1, y0, y1] = [of.x0, of.x1, of.y0, of.y1].map(|edge| edge as f32);
        let [width, height] = [of.width() as i32, of.height() as i32];
        let at: [i32; LANES] = std::array::from_fn(|n| {
            let (x, y) = (self.x_px[n], self.y_px[n]);
            let [column, row] = [floor_of_small(x).wrapping_sub(of.x0), floor_of_small(y).wrapping_sub(of.y0)];
            let inside = (self.depth_m[n] > 0.0) & (x >= x0) & (x < x1) & (y >= y0) & (y < y1);
            if inside { row.wrapping_mul(width).wrapping_add(column) } else { width * height }
        });
        at.map(|at| at as usize)
    }
}

impl PointBatch {
    /// Points of a part of a map's row, by the rays of its pixels.
    pub fn of(depth_m: &[f32], rays: &[[f32; 3]]) -> Self {
        let mut points = Self::default();
        for (lane, (z, ray)) in depth_m.iter().zip(rays).take(LANES).enumerate() {
            points.set(lane, *z, *ray);
        }
        points
    }

    /// Sets a point at `depth_m` along a ray; unknown if that is not positive.
    pub fn set(&mut self, lane: usize, depth_m: f32, ray: [f32; 3]) {
        let is_measured = depth_m > 0.0 && ray[2].is_finite();
        let z = if is_measured { depth_m } else { 0.0 };
        (self.x[lane], self.y[lane], self.z[lane], self.is_measured[lane]) =
            (z * ray[0], z * ray[1], z * ray[2], is_measured);
    }

    fn at(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }
}

/// Projection of points in the axes of one camera pose into the picture from another.
pub struct Reprojection<'a> {
    geometry: &'a Geometry,
    turn: Mat3,
    shift_m: Vec3,
    focal_px: Vec2,
    middle_px: Vec2,
    radial: [f32; 3],
    tangential: Vec2,
    /// Squared radius up to which the formula is valid; negative for nowhere.
    valid2: f32,
    /// Depths are distances from the camera, not z.
    is_radial: bool,
}

impl<'a> Reprojection<'a> {
    pub fn new(geometry: &'a Geometry, from: &Pose, to: &Pose) -> Self {
        let transform = |point: DVec3| to.transform_point(from.inverse_transform_point(point));
        let origin = transform(DVec3::ZERO);
        let axis = |axis: DVec3| (transform(axis) - origin).as_vec3();
        let (i, Distortion { model, k1, k2, k3, p1, p2, .. }) = (&geometry.intrinsics, &geometry.distortion);
        let valid = if *model == LensModel::Opencv { geometry.valid_radius().min(1e6) as f32 } else { -1.0 };
        Self {
            geometry,
            turn: Mat3::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z)),
            shift_m: origin.as_vec3(),
            focal_px: Vec2::new(i.fx_px as f32, i.fy_px as f32),
            middle_px: Vec2::new(i.cx_px as f32, i.cy_px as f32),
            radial: [k1, k2, k3].map(|k| *k as f32),
            tangential: Vec2::new(*p1 as f32, *p2 as f32),
            valid2: valid * valid.abs(),
            is_radial: geometry.needs_cube_map(),
        }
    }

    /// Reprojects points with the distortion formula of camera/distortion.rs.
    pub fn reproject(&self, points: &PointBatch) -> ReprojectedPoints {
        let Self { turn, shift_m, focal_px, middle_px, radial: [k1, k2, k3], valid2, .. } = *self;
        let Vec2 { x: p1, y: p2 } = self.tangential;
        let mut reprojected = ReprojectedPoints { x_px: [0.0; LANES], y_px: [0.0; LANES], depth_m: [0.0; LANES] };
        let mut is_left = [false; LANES];
        for (n, is_left) in is_left.iter_mut().enumerate() {
            let (x, y, z) = (points.x[n], points.y[n], points.z[n]);
            let to_x = turn.x_axis.x * x + turn.y_axis.x * y + turn.z_axis.x * z + shift_m.x;
            let to_y = turn.x_axis.y * x + turn.y_axis.y * y + turn.z_axis.y * z + shift_m.y;
            let to_z = turn.x_axis.z * x + turn.y_axis.z * y + turn.z_axis.z * z + shift_m.z;
            let per = 1.0 / to_z;
            let (x, y) = (to_x * per, to_y * per);
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let tangential_x = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
            let tangential_y = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
            reprojected.x_px[n] = (x * radial + tangential_x) * focal_px.x + middle_px.x;
            reprojected.y_px[n] = (y * radial + tangential_y) * focal_px.y + middle_px.y;
            let is_valid = (to_z > 0.0) & (r2 <= valid2);
            reprojected.depth_m[n] = if points.is_measured[n] & is_valid { to_z } else { 0.0 };
            *is_left = points.is_measured[n] & !is_valid;
        }
        for n in (0..LANES).filter(|&n| is_left[n]) {
            let point = turn * points.at(n) + shift_m;
            if let Some(at) = self.geometry.project(point.as_dvec3()) {
                (reprojected.x_px[n], reprojected.y_px[n]) = (at.x as f32, at.y as f32);
                reprojected.depth_m[n] = (if self.is_radial { point.length() } else { point.z }).max(0.0);
            }
        }
        reprojected
    }
}

/// A rectangle of a depth map, of at most [`LANES`] points a side.
pub struct ReprojectedTile {
    rect: Rect,
    /// Smallest depth of the tile, m.
    nearest_m: f32,
    /// Inverse of the smallest depth, 1/m.
    per_nearest: f32,
    /// Inverse of the range of inverse depths, m; 0 if all depths are equal.
    per_range: f32,
    probes: PointBatch,
}

impl ReprojectedTile {
    /// `None` without any depth, or without a ray at a corner. `ray` returns a pixel's ray.
    pub fn of(rect: Rect, map: &DepthMap, ray: impl Fn(i32, i32) -> Option<[f32; 3]>) -> Option<Self> {
        let (nearest, farthest) = range_of(map, rect)?;
        let [per_nearest, per_farthest] = [nearest, farthest].map(f32::recip);
        let range = per_farthest - per_nearest;
        let (last, (x, y)) = ((rect.x1 - 1, rect.y1 - 1), Self::middle(rect));
        let places = [(rect.x0, rect.y0), (last.0, rect.y0), (rect.x0, last.1), last, (rect.x0 + x, rect.y0 + y)];
        let mut probes = PointBatch::default();
        for (n, (x, y)) in places.into_iter().enumerate() {
            let ray = ray(x, y).filter(|ray| ray[2].is_finite())?;
            probes.set(2 * n, nearest, ray);
            probes.set(2 * n + 1, farthest, ray);
            if n == 4 {
                probes.set(PROBES - 1, 2.0 / (per_nearest + per_farthest), ray);
            }
        }
        let per_range = if range < 0.0 { range.recip() } else { 0.0 };
        Some(Self { rect, nearest_m: nearest, per_nearest, per_range, probes })
    }

    /// Offset of its central pixel from its corner.
    fn middle(rect: Rect) -> (i32, i32) {
        ((rect.width() as i32 - 1) / 2, (rect.height() as i32 - 1) / 2)
    }
}

/// The nearest and the farthest depth in a rectangle of a map, m; `None` without any depth.
fn range_of(map: &DepthMap, rect: Rect) -> Option<(f32, f32)> {
    // One lane for each column.
    let (mut nearest, mut farthest) = ([f32::INFINITY; LANES], [0.0f32; LANES]);
    for y in rect.y0..rect.y1 {
        let mut row = [0.0; LANES];
        let depth_m = row_of(map, rect, y);
        row[..depth_m.len()].copy_from_slice(depth_m);
        for (z, (nearest, farthest)) in row.iter().zip(nearest.iter_mut().zip(&mut farthest)) {
            *nearest = if (*z > 0.0) & (*z < *nearest) { *z } else { *nearest };
            *farthest = if *z > *farthest { *z } else { *farthest };
        }
    }
    let all = |of: [f32; LANES], which: fn(f32, f32) -> f32| of.into_iter().reduce(which).unwrap_or_default();
    let farthest = all(farthest, f32::max);
    (farthest > 0.0).then(|| (all(nearest, f32::min), farthest))
}

/// A rectangle's part of a row of a map.
fn row_of(map: &DepthMap, rect: Rect, y: i32) -> &[f32] {
    &map.depth_m[y as usize * map.width as usize..][rect.x0 as usize..rect.x1 as usize]
}

/// Bilinear interpolation between the corners of a tile: v + a·x + b·y + c·x·y.
#[derive(Clone, Copy)]
struct Bilinear<V>([V; 4]);

impl<V> Bilinear<V>
where
    V: Copy + std::ops::Add<Output = V> + std::ops::Sub<Output = V> + std::ops::Mul<f32, Output = V>,
{
    fn of([v00, v10, v01, v11]: [V; 4], across: f32, down: f32) -> Self {
        let (a, b) = (v10 - v00, v01 - v00);
        Self([v00, a * across, b * down, (v11 - v10 - b) * (across * down)])
    }

    /// The first value of a row, and its increment from pixel to pixel.
    fn row(&self, y: f32) -> (V, V) {
        let Self([v, a, b, c]) = *self;
        (v + b * y, a + c * y)
    }
}

/// Reprojection of a tile's points.
pub struct TileReprojection<'a> {
    reprojection: &'a Reprojection<'a>,
    tile: &'a ReprojectedTile,
    reprojected: ReprojectedPoints,
    interpolation: Option<Interpolation>,
}

/// Interpolation within a tile.
struct Interpolation {
    /// Position at the nearest depth, px.
    near: Bilinear<Vec2>,
    /// Difference of the position at the farthest depth, px.
    farther: Bilinear<Vec2>,
    /// Derivative of the new depth by the old one.
    stretch: Bilinear<f32>,
}

impl<'a> TileReprojection<'a> {
    pub fn new(tile: &'a ReprojectedTile, reprojection: &'a Reprojection<'a>) -> Self {
        let reprojected = reprojection.reproject(&tile.probes);
        let mut tile_reprojection = Self { reprojection, tile, reprojected, interpolation: None };
        tile_reprojection.interpolation = tile_reprojection.interpolation();
        tile_reprojection
    }

    fn interpolation(&self) -> Option<Interpolation> {
        let Self { reprojection, tile, reprojected, .. } = self;
        if reprojection.is_radial || reprojected.depth_m[..PROBES].contains(&0.0) {
            return None;
        }
        let place = |n: usize| Vec2::new(reprojected.x_px[n], reprojected.y_px[n]);
        let [across, down] = [tile.rect.width(), tile.rect.height()].map(|side| (side.max(2) as f32 - 1.0).recip());
        let near = Bilinear::of([0, 2, 4, 6].map(place), across, down);
        let farther = Bilinear::of([1, 3, 5, 7].map(|n| place(n) - place(n - 1)), across, down);
        let stretch = [0, 2, 4, 6].map(|n| (reprojected.depth_m[n] - reprojection.shift_m.z) / tile.nearest_m);
        let (x, y) = ReprojectedTile::middle(tile.rect);
        let at = |of: &Bilinear<Vec2>| {
            let (first, step) = of.row(y as f32);
            first + step * x as f32
        };
        let is_accurate = [(8, 0.0), (9, 1.0), (10, 0.5)].into_iter().all(|(n, fraction)| {
            (at(&near) + at(&farther) * fraction).distance(place(n)) <= MAX_INTERPOLATION_ERROR_PX
        });
        is_accurate.then(|| Interpolation { near, farther, stretch: Bilinear::of(stretch, across, down) })
    }

    /// A rectangle that contains all reprojected points; `None` if it is unknown.
    pub fn bounds(&self, margin_px: i32) -> Option<Rect> {
        let corners = 0..8;
        if self.reprojected.depth_m[corners.clone()].contains(&0.0) {
            return None;
        }
        let range = |at: &[f32; LANES]| {
            let low = at[corners.clone()].iter().fold(f32::INFINITY, |low, at| low.min(*at));
            (floor(low), floor(at[corners.clone()].iter().fold(f32::NEG_INFINITY, |high, at| high.max(*at))))
        };
        let ((x0, x1), (y0, y1)) = (range(&self.reprojected.x_px), range(&self.reprojected.y_px));
        Some(Rect::new(x0, y0, x1 + 1, y1 + 1).grown(margin_px))
    }

    /// Reprojects a row of the tile. `rays` are those of all pixels of the map's row.
    pub fn reproject(&self, map: &DepthMap, y: i32, rays: &[[f32; 3]]) -> ReprojectedPoints {
        let ReprojectedTile { rect, per_nearest, per_range, .. } = *self.tile;
        let depth_m = row_of(map, rect, y);
        let Some(Interpolation { near, farther, stretch }) = &self.interpolation else {
            return self.reprojection.reproject(&PointBatch::of(depth_m, &rays[rect.x0 as usize..rect.x1 as usize]));
        };
        let mut old_m = [0.0f32; LANES];
        old_m.iter_mut().zip(depth_m).for_each(|(here, z)| *here = if *z > 0.0 { *z } else { 0.0 });
        let down = (y - rect.y0) as f32;
        let ((near, near_step), (more, more_step), (stretch, stretch_step)) =
            (near.row(down), farther.row(down), stretch.row(down));
        let mut reprojected = ReprojectedPoints { x_px: [0.0; LANES], y_px: [0.0; LANES], depth_m: [0.0; LANES] };
        for (n, z) in old_m.iter().enumerate() {
            let x = n as f32;
            let fraction = (1.0 / z - per_nearest) * per_range;
            reprojected.x_px[n] = near.x + near_step.x * x + (more.x + more_step.x * x) * fraction;
            reprojected.y_px[n] = near.y + near_step.y * x + (more.y + more_step.y * x) * fraction;
            let new_m = z * (stretch + stretch_step * x) + self.reprojection.shift_m.z;
            reprojected.depth_m[n] = if *z > 0.0 { new_m.max(0.0) } else { 0.0 };
        }
        reprojected
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Intrinsics;
    use glam::{DQuat, DVec2};

    #[test]
    fn pixels_of_points_match_an_example_by_hand() {
        let at =
            [(-0.1, 0.0), (0.0, 0.0), (3.999, 2.999), (4.0, 1.0), (1.5, 3.0), (2.0, 1.0), (1e9, 0.0), (f32::NAN, 1.0)];
        let mut reprojected = ReprojectedPoints { x_px: [0.0; LANES], y_px: [0.0; LANES], depth_m: [0.0; LANES] };
        for (n, (x, y)) in at.into_iter().enumerate() {
            (reprojected.x_px[n], reprojected.y_px[n], reprojected.depth_m[n]) = (x, y, 1.0);
        }
        assert_eq!(reprojected.pixels(Rect::full(4, 3))[..9], [12, 0, 11, 12, 12, 6, 12, 12, 12]);
        assert_eq!(reprojected.pixels(Rect::new(-2, 1, 3, 3))[..9], [10, 10, 10, 10, 10, 4, 10, 10, 10]);
        (reprojected.x_px[0], reprojected.y_px[0]) = (-0.1, 2.5);
        assert_eq!(reprojected.pixels(Rect::new(-2, 1, 3, 3))[0], 6);
    }

    #[test]
    fn single_precision_matches_the_exact_camera_model() {
        let i = Intrinsics { fx_px: 517.3, fy_px: 516.5, cx_px: 319.1, cy_px: 255.8, ..Intrinsics::default() };
        let k = Distortion { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633, ..Distortion::default() };
        let fisheye = Distortion { model: LensModel::OpencvFisheye, k1: 0.02, ..Distortion::default() };
        let from = Pose::from_camera_in_world(DVec3::new(0.3, 0.1, -0.2), DQuat::from_rotation_y(0.05));
        let to = Pose::from_camera_in_world(DVec3::new(0.32, 0.08, -0.21), DQuat::from_rotation_x(0.04));
        let fov = Distortion { model: LensModel::Fov, omega: 0.9, ..Distortion::default() };
        for distortion in [k, Distortion::default(), fisheye, fov] {
            let geometry = Geometry::new(i.clone(), distortion);
            let reprojection = Reprojection::new(&geometry, &from, &to);
            // Some points are outside the corners.
            for y in -6..=6 {
                let rays: Vec<_> = (-7..=7).map(|x| [0.1 * x as f32, 0.1 * y as f32, 1.0]).collect();
                let reprojected = reprojection.reproject(&PointBatch::of(&[1.7; 15], &rays));
                for (n, ray) in rays.iter().enumerate() {
                    let point = 1.7 * DVec3::from(ray.map(f64::from));
                    let in_target = to.transform_point(from.inverse_transform_point(point));
                    let exact = geometry.project(in_target).unwrap();
                    let approximate = DVec2::new(reprojected.x_px[n].into(), reprojected.y_px[n].into());
                    assert!((approximate - exact).length() < 1e-3, "{ray:?}: {approximate} is not {exact}");
                    let depth = if geometry.needs_cube_map() { in_target.length() } else { in_target.z };
                    assert!((f64::from(reprojected.depth_m[n]) - depth).abs() < 1e-5);
                }
                assert_eq!(reprojected.depth_m[15], 0.0);
            }
            let nothing = PointBatch::of(
                &[0.0, -1.0, f32::NAN, 1.0],
                &[[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [f32::NAN; 3]],
            );
            assert_eq!(reprojection.reproject(&nothing).depth_m, [0.0; LANES]);
        }
    }
}
