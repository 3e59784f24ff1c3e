//! Depth of proxy geometry: models that stand in for real objects.
//!
//! Each triangle is subdivided until its sides are short in the picture, to support lens distortion
//! and a pose for each row. Over a small triangle 1/z is linear in the picture.
//!
//! Not modelled: shadows on proxies.

use glam::{DVec2, DVec3};

use crate::pixels::Rect;

/// Depth of pixels without a sensor and without a proxy, m: so large that nothing is occluded.
/// `FAR_M` of shaders/shadow_mask.wgsl is the same.
pub const FAR_M: f32 = 1e4;
/// Longest side of a triangle that is rasterized, px. Lens distortion between its corners is less
/// than a tenth of a pixel.
const MAX_SIDE_PX: f64 = 16.0;
/// Maximum number of subdivisions of a triangle into four.
const MAX_SUBDIVISIONS: u32 = 9;
/// Maximum number of subdivisions of a triangle whose corners are all out of view. Its middle may
/// be in view.
const MAX_OUTSIDE_SUBDIVISIONS: u32 = 3;
/// Pixel centres up to this far outside an edge are covered, px, so that there are no seams.
const SEAM_PX: f64 = 0.01;

/// Triangles in the world, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Proxies {
    pub triangles: Vec<[DVec3; 3]>,
}

/// Image position of a point, px, and its depth, m; `None` out of view.
pub type ProjectedPoint = Option<(DVec2, f64)>;

/// 0 (unknown) in place of [`FAR_M`].
pub fn unknown_if_far_m(depth_m: f32) -> f32 {
    if depth_m < FAR_M { depth_m } else { 0.0 }
}

impl Proxies {
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Rasterizes the proxies into the depth of a part of a picture, m, row by row, 0 where
    /// unknown. The nearer depth wins. `project` is the camera.
    pub fn rasterize(&self, depth_m: &mut [f32], part: Rect, project: impl Fn(DVec3) -> ProjectedPoint) {
        let mut rasterizer = Rasterizer { depth_m, part, project };
        for corners in &self.triangles {
            rasterizer.subdivide(corners.map(|point| (point, (rasterizer.project)(point))), 0);
        }
    }
}

struct Rasterizer<'a, S> {
    depth_m: &'a mut [f32],
    part: Rect,
    project: S,
}

impl<S: Fn(DVec3) -> ProjectedPoint> Rasterizer<'_, S> {
    fn subdivide(&mut self, corners: [(DVec3, ProjectedPoint); 3], subdivisions: u32) {
        let [a, b, c] = corners;
        if let (Some(p), Some(q), Some(r)) = (a.1, b.1, c.1) {
            let side_px = p.0.distance(q.0).max(q.0.distance(r.0)).max(r.0.distance(p.0));
            if side_px <= MAX_SIDE_PX || subdivisions == MAX_SUBDIVISIONS {
                // A triangle that is still longer crosses the rim of a 360° picture, or extends
                // behind the camera.
                return if side_px <= 4.0 * MAX_SIDE_PX {
                    self.fill([p, q, r])
                };
            }
            // Distortion displaces a side by less than its length.
            let (low, high) = (p.0.min(q.0).min(r.0) - side_px, p.0.max(q.0).max(r.0) + side_px);
            let Rect { x0, y0, x1, y1 } = self.part;
            let is_beside = high.x < f64::from(x0) || low.x > f64::from(x1);
            if is_beside || high.y < f64::from(y0) || low.y > f64::from(y1) {
                return;
            }
        } else if subdivisions == MAX_SUBDIVISIONS
            || corners.iter().all(|(_, projected)| projected.is_none()) && subdivisions >= MAX_OUTSIDE_SUBDIVISIONS
        {
            return;
        }
        let middle = |p: DVec3, q: DVec3| {
            let point = 0.5 * (p + q);
            (point, (self.project)(point))
        };
        let [ab, bc, ca] = [middle(a.0, b.0), middle(b.0, c.0), middle(c.0, a.0)];
        for corners in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            self.subdivide(corners, subdivisions + 1);
        }
    }

    fn fill(&mut self, corners: [(DVec2, f64); 3]) {
        let places = corners.map(|(at, _)| at);
        let [per_a, per_b, per_c] = corners.map(|(_, depth_m)| depth_m.recip());
        let [a, b, c] = places;
        let twice = (b - a).perp_dot(c - a);
        let all = Rect::new(
            a.x.min(b.x).min(c.x).floor() as i32,
            a.y.min(b.y).min(c.y).floor() as i32,
            a.x.max(b.x).max(c.x).ceil() as i32,
            a.y.max(b.y).max(c.y).ceil() as i32,
        );
        let all = all.intersection(&self.part);
        if twice.abs() < 1e-9 || all.is_empty() {
            return;
        }
        // Barycentric coordinate of a position, for the corner opposite to the side pq, and the
        // tolerance.
        let barycentric = |at: DVec2, p: DVec2, q: DVec2| {
            ((q - p).perp_dot(at - p) / twice, SEAM_PX * (q - p).length() / twice.abs())
        };
        for y in all.y0..all.y1 {
            for x in all.x0..all.x1 {
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let weights = [barycentric(at, b, c), barycentric(at, c, a), barycentric(at, a, b)];
                if weights.iter().any(|(weight, seam)| *weight < -seam) {
                    continue;
                }
                let per_m = weights[0].0 * per_a + weights[1].0 * per_b + weights[2].0 * per_c;
                let i = (y - self.part.y0) as usize * self.part.width() as usize + (x - self.part.x0) as usize;
                let (old_m, new_m) = (&mut self.depth_m[i], per_m.recip() as f32);
                if new_m > 0.0 && (*old_m <= 0.0 || new_m < *old_m) {
                    *old_m = new_m;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics};

    fn rasterize(geometry: &Geometry, triangles: Vec<[DVec3; 3]>, part: Rect) -> Vec<f32> {
        let mut depth_m = vec![0.0; part.width() as usize * part.height() as usize];
        Proxies { triangles }.rasterize(&mut depth_m, part, |p| geometry.project(p).map(|at| (at, p.z)));
        depth_m
    }

    /// A slanted rectangle: z = 1.5 + 0.4·x.
    fn slanted_board() -> Vec<[DVec3; 3]> {
        let at = |x: f64, y: f64| DVec3::new(x, y, 1.5 + 0.4 * x);
        let [a, b, c, d] = [at(-0.5, -0.3), at(0.5, -0.3), at(0.5, 0.4), at(-0.5, 0.4)];
        vec![[a, b, c], [c, d, a]]
    }

    #[test]
    fn slanted_board_has_the_depth_of_its_rays_with_and_without_distortion() {
        let i = Intrinsics {
            width_px: 200,
            height_px: 150,
            fx_px: 180.0,
            fy_px: 180.0,
            cx_px: 98.0,
            cy_px: 77.0,
            ..Default::default()
        };
        let bends = Distortion { k1: -0.25, k2: 0.06, ..Distortion::default() };
        for distortion in [Distortion::default(), bends] {
            let geometry = Geometry::new(i.clone(), distortion);
            let whole = Rect::full(200, 150);
            let depth_m = rasterize(&geometry, slanted_board(), whole);
            let mut on_board = 0;
            for (n, depth_m) in depth_m.iter().enumerate() {
                let ray = geometry.depth_ray(DVec2::new((n % 200) as f64 + 0.5, (n / 200) as f64 + 0.5)).unwrap();
                let z = 1.5 / (1.0 - 0.4 * ray.x);
                let is_inside = |margin: f64| {
                    (z * ray.x).abs() < 0.5 + margin && (-0.3 - margin..0.4 + margin).contains(&(z * ray.y))
                };
                if is_inside(-0.003) {
                    on_board += 1;
                    assert!((f64::from(*depth_m) / z - 1.0).abs() < 3e-4, "{n}: {depth_m} is not {z}");
                } else if !is_inside(0.003) {
                    assert_eq!(*depth_m, 0.0, "{n}");
                }
            }
            assert!(on_board > 5000, "{on_board}");
            // A part of the picture has the same depth.
            let part = Rect::new(-10, 40, 90, 160);
            for (n, in_part) in rasterize(&geometry, slanted_board(), part).iter().enumerate() {
                let (x, y) = (n as i32 % 100 - 10, n as i32 / 100 + 40);
                let expected = if whole.contains(x, y) { depth_m[(y * 200 + x) as usize] } else { *in_part };
                assert_eq!(*in_part, expected, "{x} {y}");
            }
        }
    }

    #[test]
    fn nearer_depth_wins_and_floor_from_behind_the_camera_has_its_depth() {
        let geometry = Geometry::pinhole(64, 48, 60.0);
        let whole = Rect::full(64, 48);
        let mut depth_m: Vec<f32> = (0..64 * 48).map(|i| if i % 64 < 32 { 1.0 } else { 3.0 }).collect();
        let project = |p: DVec3| geometry.project(p).map(|at| (at, p.z));
        let wall = |z: f64| [[-9.0, -9.0], [9.0, -9.0], [0.0, 12.0]].map(|[x, y]| DVec3::new(x, y, z));
        Proxies { triangles: vec![wall(2.0)] }.rasterize(&mut depth_m, whole, project);
        assert!((0..64 * 48).all(|i| (depth_m[i] - if i % 64 < 32 { 1.0 } else { 2.0 }).abs() < 1e-5));
        // A floor 1 m below the camera that extends behind it: z = fy / (row − cy).
        let [a, b, c, d] =
            [[-20.0, -5.0], [20.0, -5.0], [20.0, 40.0], [-20.0, 40.0]].map(|[x, z]| DVec3::new(x, 1.0, z));
        let depth_m = rasterize(&geometry, vec![[a, b, c], [c, d, a]], whole);
        for (i, depth_m) in depth_m.iter().enumerate().filter(|(i, _)| i / 64 > 28) {
            let expected = 60.0 / ((i / 64) as f32 + 0.5 - 24.0);
            assert!((depth_m / expected - 1.0).abs() < 1e-3, "{i}: {depth_m} is not {expected}");
        }
        assert!(depth_m[..64 * 22].iter().all(|z| *z == 0.0));
    }
}
