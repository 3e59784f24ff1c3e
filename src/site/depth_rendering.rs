//! Depth of a scan in a camera's picture.
//!
//! A disc at p with normal n meets a pixel's ray r at the depth t = n·p / n·r, at the distance ρ =
//! |t·r − p| from its center. Its weight is 1 − ρ²/R². The depth of a pixel is the weighted mean
//! over the discs near the nearest one (surface splatting; Zwicker et al. 2001). On a surface the
//! weights sum to about πR²/2s² for voxels of side s. Beyond the rim of a surface they fall to 0.
//! Below a threshold the surface behind is visible, so that a surface does not grow by the radius
//! of its discs.
//!
//! Triangles are met by the pixel's ray exactly (Möller and Trumbore 1997). Rays through pixel
//! centers include the lens's distortion; the projection of a center or a corner only bounds the
//! pixels that are tested.
//!
//! Rolling shutter: each band of rows has the pose of its middle row, as if the camera stood still
//! while the band is read.

use std::f32::consts::PI;
use std::ops::Range;

use glam::{DVec2, DVec3, Mat3, Vec2, Vec3};

use super::point_octree::{Disc, OctreeNode, PointOctree};
use super::triangle_blocks::{ScanTriangle, TriangleBlocks};
use crate::camera::Geometry;
use crate::depth::Rays;
use crate::parallel::{over_rows, processors};
use crate::pixels::{Rect, floor};
use crate::pose::Pose;

/// Radius of a disc in sides of its voxel: discs of neighbouring voxels overlap.
const DISC_RADIUS_VOXELS: f32 = 1.0;
/// Largest difference from the nearest disc along the ray that counts as the same surface, in
/// radii.
const SURFACE_THICKNESS_RADII: f32 = 0.75;
/// Smallest sum of weights of a known pixel: a third of the mean on a surface.
const MIN_WEIGHT: f32 = 0.5;
/// Barycentric coordinates by which a triangle extends over its edges: more than rounding, so that
/// a ray through an edge that two triangles share hits one of them.
const EDGE_TOLERANCE: f32 = 1e-5;
/// Surfaces nearer to the camera are not drawn, m: the operator's own equipment.
pub const MIN_DISTANCE_M: f32 = 0.05;
/// Smallest cosine between a disc's normal and the ray.
const MIN_COSINE: f32 = 0.05;
/// Side of a voxel in the picture down to which octants are refined, px.
const MIN_VOXEL_PX: f32 = 1.0;
/// Rows of the picture that are drawn at a time and have one pose: at 1000 px/s and a readout of
/// 30 ms for 480 rows the pose of the first one is off by 0.5 px.
const BAND_ROWS: usize = 16;
/// A triangle is split if it is longer than this fraction of its distance, since the lens bends its
/// edges.
const MAX_TRIANGLE_ANGLE: f32 = 0.15;
/// Splits of a triangle at most: each halves its longest edge.
const MAX_SPLITS: u32 = 12;
/// Largest distance of a triangle's bent edge from its chord, as a fraction of the triangle's size.
const MAX_BEND: f64 = 0.05;
/// Over a larger part the magnification of the picture varies, rad.
const MAX_UNIFORM_ANGLE_RAD: f32 = 0.1;
/// Margin for the variation over a smaller one.
const MAGNIFICATION_MARGIN: f32 = 1.2;
/// Step of the numerical derivative of a projection, rad.
const STEP_RAD: f64 = 1e-3;

/// Geometry of a scan, m.
#[derive(Clone, Debug)]
pub enum ScanSurface {
    Points(PointOctree),
    Triangles(TriangleBlocks),
}

/// A camera's view of a scan, in some rows of its picture.
struct ScanView<'a> {
    rays: &'a Rays,
    rotation: Mat3,
    translation_m: Vec3,
    /// Largest angle of a ray from the optical axis, rad.
    max_angle_rad: f32,
    /// Pixels from the left to the right border of a 360° picture.
    turn_px: Option<i32>,
    rows: Range<i32>,
    /// Surfaces nearer to the camera are not drawn, m.
    min_distance_m: f32,
}

/// A visible part of a scan.
struct VisiblePart {
    /// Magnification of the picture, px/rad; `None` if it varies over the part.
    px_per_rad: Option<f32>,
}

/// A surface at a pixel.
#[derive(Clone, Copy)]
struct SurfaceLayer {
    /// Depth of its nearest disc, m.
    nearest_m: f32,
    /// Weighted sum of depths, m, and sum of weights.
    sum_m: f32,
    weight: f32,
}

/// The nearest surface at a pixel, and the next one behind it.
#[derive(Clone, Copy)]
struct PixelLayers {
    front: SurfaceLayer,
    back: SurfaceLayer,
}

const NO_LAYER: SurfaceLayer = SurfaceLayer { nearest_m: f32::INFINITY, sum_m: 0.0, weight: 0.0 };

impl SurfaceLayer {
    fn new(depth_m: f32, weight: f32) -> Self {
        Self { nearest_m: depth_m, sum_m: weight * depth_m, weight }
    }

    fn add(&mut self, depth_m: f32, weight: f32) {
        self.nearest_m = self.nearest_m.min(depth_m);
        self.sum_m += weight * depth_m;
        self.weight += weight;
    }

    fn depth_m(self) -> Option<f32> {
        (self.weight >= MIN_WEIGHT).then(|| self.sum_m / self.weight)
    }
}

impl PixelLayers {
    /// Adds a surface of a thickness along the ray.
    fn add(&mut self, depth_m: f32, weight: f32, thickness_m: f32) {
        if depth_m < self.front.nearest_m - thickness_m {
            *self = Self { front: SurfaceLayer::new(depth_m, weight), back: self.front };
        } else if depth_m <= self.front.nearest_m + thickness_m {
            self.front.add(depth_m, weight);
        } else if depth_m < self.back.nearest_m - thickness_m {
            self.back = SurfaceLayer::new(depth_m, weight);
        } else if depth_m <= self.back.nearest_m + thickness_m {
            self.back.add(depth_m, weight);
        }
    }

    /// Depth of the nearest surface with enough weight; 0 if there is none.
    fn depth_m(self) -> f32 {
        self.front.depth_m().or(self.back.depth_m()).unwrap_or(0.0)
    }
}

/// Depth of a scan at each pixel of a camera's picture, row by row, scaled as in a depth map of the
/// camera ([`Geometry::depth_ray`]); 0 where there is no surface. `camera_from_scan`: the pose at a
/// time relative to the frame's, s. Surfaces nearer than `min_distance_m` are not drawn.
pub fn rendered_depth_m(
    surface: &ScanSurface,
    rays: &Rays,
    camera_from_scan: &(dyn Fn(f64) -> Pose + Sync),
    min_distance_m: f32,
) -> Vec<f32> {
    let full = rays.full();
    rays.prepare(full.y0..full.y1);
    let (width, height) = (full.width() as usize, full.height() as usize);
    let mut depth_m = vec![0.0; width * height];
    over_rows(&mut depth_m, width * BAND_ROWS, processors(), |band, depth_m| {
        let first_row = (band * BAND_ROWS) as i32;
        let rows = first_row..first_row + (depth_m.len() / width) as i32;
        let middle_px = 0.5 * f64::from(rows.start + rows.end);
        let pose = camera_from_scan(rays.geometry().row_time_s(middle_px));
        let mut layers = vec![PixelLayers { front: NO_LAYER, back: NO_LAYER }; depth_m.len()];
        let view = ScanView { min_distance_m, ..ScanView::new(rays, &pose, rows) };
        Band { view, layers: &mut layers }.draw(surface);
        depth_m.iter_mut().zip(&layers).for_each(|(depth_m, layers)| *depth_m = layers.depth_m());
    });
    fill_single_pixels(&mut depth_m, width);
    depth_m
}

/// Fills an unknown pixel from its left and right neighbours, or from those above and below, if
/// their depths differ by less than 3 %.
fn fill_single_pixels(depth_m: &mut [f32], width: usize) {
    const MAX_RELATIVE_STEP: f32 = 0.03;
    let height = depth_m.len() / width.max(1);
    let before = depth_m.to_vec();
    let between = |a: f32, b: f32| {
        let is_surface = a > 0.0 && b > 0.0 && (a - b).abs() < MAX_RELATIVE_STEP * a.min(b);
        is_surface.then(|| 2.0 / (a.recip() + b.recip()))
    };
    for y in 1..height.saturating_sub(1) {
        for i in (y * width + 1..(y + 1) * width - 1).filter(|i| before[*i] == 0.0) {
            let across = between(before[i - 1], before[i + 1]);
            depth_m[i] = across.or_else(|| between(before[i - width], before[i + width])).unwrap_or(0.0);
        }
    }
}

impl<'a> ScanView<'a> {
    fn new(rays: &'a Rays, camera_from_scan: &Pose, rows: Range<i32>) -> Self {
        let geometry = rays.geometry();
        let (width, height) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
        // The rim holds the largest angles. Where it has no ray, the lens may see any direction.
        let rim_rows = [0, height / 2, height.saturating_sub(1)];
        let rim = rim_rows.into_iter().filter_map(|y| rays.row(y as usize)).flat_map(|row| {
            [0, row.len() / 2, row.len().saturating_sub(1)]
                .map(|x| row.get(x).map_or(Vec3::NAN, |ray| Vec3::from(*ray)))
        });
        let angle_rad = |ray: Vec3| if ray.is_finite() { ray.angle_between(Vec3::Z) } else { PI };
        let max_angle_rad = rim.map(angle_rad).fold(0.0, f32::max);
        let rotation = Mat3::from_quat(camera_from_scan.rotation.as_quat());
        let turn_px = geometry.is_equirectangular().then_some(width as i32);
        let translation_m = camera_from_scan.translation_m.as_vec3();
        Self { rays, rotation, translation_m, max_angle_rad, turn_px, rows, min_distance_m: MIN_DISTANCE_M }
    }

    fn geometry(&self) -> &Geometry {
        self.rays.geometry()
    }

    fn in_camera(&self, point_m: Vec3) -> Vec3 {
        self.rotation * point_m + self.translation_m
    }

    /// A part within a sphere; `None` outside the rows of the picture.
    fn part(&self, center_m: Vec3, radius_m: f32) -> Option<VisiblePart> {
        let center = self.in_camera(center_m);
        let distance_m = center.length();
        if distance_m <= 1.5 * radius_m {
            return Some(VisiblePart { px_per_rad: None });
        }
        let angle_rad = (radius_m / distance_m).asin();
        if center.angle_between(Vec3::Z) > self.max_angle_rad + angle_rad {
            return None;
        }
        let direction = (center / distance_m).as_dvec3();
        let at_px = self.geometry().project(direction).filter(|_| angle_rad <= MAX_UNIFORM_ANGLE_RAD);
        let Some((at_px, px_per_rad)) = at_px.zip(px_per_rad(self.geometry(), direction)) else {
            return Some(VisiblePart { px_per_rad: None });
        };
        let px_per_rad = MAGNIFICATION_MARGIN * px_per_rad;
        let rect = rect_around(at_px.as_vec2(), angle_rad.tan() * px_per_rad + 1.0);
        (!rect.intersection(&self.rect()).is_empty()).then_some(VisiblePart { px_per_rad: Some(px_per_rad) })
    }

    /// The rows. In a 360° picture columns continue beyond the borders.
    fn rect(&self) -> Rect {
        let width = self.geometry().intrinsics.width_px as i32;
        let beyond = self.turn_px.unwrap_or(0);
        Rect::new(-beyond, self.rows.start, width + beyond, self.rows.end)
    }
}

impl ScanView<'_> {
    /// Pixels that a small triangle may cover. The lens bends its edges by a small part of its
    /// size.
    fn triangle_rect(&self, mut corners: [DVec2; 3]) -> Rect {
        let width = |corners: &[DVec2; 3]| {
            let along = corners.map(|corner| corner.x);
            along.into_iter().fold(f64::NEG_INFINITY, f64::max) - along.into_iter().fold(f64::INFINITY, f64::min)
        };
        let turn = self.turn_px.map_or(f64::INFINITY, f64::from);
        let is_across_seam = width(&corners) > 0.5 * turn;
        if is_across_seam {
            corners.iter_mut().filter(|corner| corner.x < 0.5 * turn).for_each(|corner| corner.x += turn);
        }
        let [a, b, c] = corners;
        let (mut low, mut high) = (a.min(b).min(c), a.max(b).max(c));
        if is_across_seam && width(&corners) > 0.5 * turn {
            // Around a pole, which is in the first or last row.
            let height = f64::from(self.geometry().intrinsics.height_px);
            (low.x, high.x) = (0.0, turn);
            if low.y + high.y < height { low.y = 0.0 } else { high.y = height }
        }
        let margin = DVec2::ONE + MAX_BEND * (high - low);
        let (low, high) = ((low - margin).as_vec2(), (high + margin).as_vec2());
        rect_between(low, high)
    }
}

/// Magnification of a camera around a direction of unit length, px/rad: the larger of two
/// perpendicular ones. `None` outside its field of view.
fn px_per_rad(geometry: &Geometry, direction: DVec3) -> Option<f32> {
    let at = geometry.project(direction)?;
    let across = direction.any_orthonormal_vector();
    let steps = [across, direction.cross(across)];
    let shift_px = |step: DVec3| {
        let to = geometry.project(direction + STEP_RAD * step)?;
        Some(geometry.displacement_px(at, to).length())
    };
    let [a, b] = steps.map(|step| shift_px(step).unwrap_or(0.0) / STEP_RAD);
    Some(a.max(b) as f32)
}

/// Pixels around a position.
fn rect_around(at_px: Vec2, radius_px: f32) -> Rect {
    rect_between(at_px - radius_px, at_px + radius_px)
}

/// Pixels between two positions, whose own pixels are included.
fn rect_between(low_px: Vec2, high_px: Vec2) -> Rect {
    let [x1, y1] = [high_px.x, high_px.y].map(|along| floor(along).saturating_add(1));
    Rect::new(floor(low_px.x), floor(low_px.y), x1, y1)
}

/// Rows of the picture that one thread draws.
struct Band<'a> {
    view: ScanView<'a>,
    layers: &'a mut [PixelLayers],
}

impl Band<'_> {
    fn draw(&mut self, surface: &ScanSurface) {
        match surface {
            ScanSurface::Points(octree) => (0..octree.root_count).for_each(|node| self.draw_node(octree, node)),
            ScanSurface::Triangles(mesh) => {
                for block in mesh.blocks.iter() {
                    if self.view.part(block.center_m, block.radius_m).is_some() {
                        self.draw_block(&mesh.triangles[block.triangles.clone()]);
                    }
                }
            }
        }
    }

    /// Draws the visible octants of a node, refined down to the size of a pixel.
    fn draw_node(&mut self, octree: &PointOctree, node: usize) {
        let OctreeNode { voxel_m, octants } = &octree.nodes[node];
        let (octant_radius_m, disc_radius_m) = (octree.nodes[node].octant_radius_m(), DISC_RADIUS_VOXELS * voxel_m);
        for octant in octants.iter().filter(|octant| !octant.discs.is_empty()) {
            let Some(part) = self.view.part(octant.center_m, octant_radius_m + disc_radius_m) else { continue };
            let center = self.view.in_camera(octant.center_m);
            let distance_m = (center.length() - octant_radius_m).max(MIN_DISTANCE_M);
            let is_coarse = part.px_per_rad.is_none_or(|px_per_rad| voxel_m * px_per_rad > MIN_VOXEL_PX * distance_m);
            match octant.refined.filter(|_| is_coarse) {
                Some(refined) => self.draw_node(octree, refined as usize),
                None => {
                    for disc in &octree.discs[octant.discs.start as usize..octant.discs.end as usize] {
                        self.draw_disc(disc, disc_radius_m, part.px_per_rad);
                    }
                }
            }
        }
    }

    fn draw_block(&mut self, triangles: &[ScanTriangle]) {
        for corners in triangles {
            self.draw_triangle(corners.map(|corner| self.view.in_camera(corner)), MAX_SPLITS);
        }
    }

    fn draw_disc(&mut self, disc: &Disc, radius_m: f32, of_part: Option<f32>) {
        let center = self.view.in_camera(disc.position_m);
        let distance_m = center.length();
        if distance_m < self.view.min_distance_m.max(radius_m) {
            return;
        }
        let Some(at_px) = self.view.geometry().project(center.as_dvec3()) else { return };
        let own = || px_per_rad(self.view.geometry(), (center / distance_m).as_dvec3());
        let Some(px_per_rad) = of_part.or_else(own) else { return };
        let radius_px = radius_m / distance_m * px_per_rad;
        let rect = rect_around((at_px - 0.5).as_vec2(), radius_px);
        let normal = if disc.normal == Vec3::ZERO { center / distance_m } else { self.view.rotation * disc.normal };
        let offset_m = normal.dot(center);
        let inverse_radius2 = (radius_m * radius_m).recip();
        self.for_pixels(rect, |ray, layers| {
            let cosine = normal.dot(ray);
            if cosine.abs() < MIN_COSINE * ray.length() {
                return;
            }
            let depth_m = offset_m / cosine;
            let weight = 1.0 - (depth_m * ray - center).length_squared() * inverse_radius2;
            if weight > 0.0 && depth_m > 0.0 {
                layers.add(depth_m, weight, SURFACE_THICKNESS_RADII * radius_m);
            }
        });
    }

    fn draw_triangle(&mut self, corners: ScanTriangle, splits: u32) {
        let [a, b, c] = corners;
        let lengths2 = [(c - b).length_squared(), (a - c).length_squared(), (b - a).length_squared()];
        let longest = (0..3).fold(0, |longest, n| if lengths2[n] > lengths2[longest] { n } else { longest });
        let nearest_m = corners.iter().map(|corner| corner.length()).fold(f32::INFINITY, f32::min);
        let is_long = lengths2[longest] > (MAX_TRIANGLE_ANGLE * nearest_m).powi(2);
        if is_long && splits > 0 {
            // Halves the longest edge, which is opposite to the corner of its index.
            let [apex, from, to] = std::array::from_fn(|n| corners[(longest + n) % 3]);
            let middle = 0.5 * (from + to);
            self.draw_triangle([apex, from, middle], splits - 1);
            self.draw_triangle([apex, middle, to], splits - 1);
            return;
        }
        let corners_px = corners.map(|corner| self.view.geometry().project(corner.as_dvec3()));
        let [Some(p), Some(q), Some(r)] = corners_px else { return };
        let rect = self.view.triangle_rect([p, q, r]);
        let (ab, ac) = (b - a, c - a);
        let min_distance_m = self.view.min_distance_m;
        self.for_pixels(rect, |ray, layers| {
            let across = ray.cross(ac);
            let inverse = ab.dot(across).recip();
            let u = -a.dot(across) * inverse;
            let normal = (-a).cross(ab);
            let v = ray.dot(normal) * inverse;
            let depth_m = ac.dot(normal) * inverse;
            let is_inside = u >= -EDGE_TOLERANCE && v >= -EDGE_TOLERANCE && u + v <= 1.0 + EDGE_TOLERANCE;
            if is_inside && depth_m * ray.length() > min_distance_m {
                layers.add(depth_m, 1.0, 0.0);
            }
        });
    }

    /// Calls `draw` with the ray and the layers of each pixel of the band within a rectangle.
    #[inline]
    fn for_pixels(&mut self, rect: Rect, mut draw: impl FnMut(Vec3, &mut PixelLayers)) {
        let width = self.view.geometry().intrinsics.width_px as usize;
        let turn_px = self.view.turn_px;
        let rect = match turn_px {
            Some(turn) => Rect { x1: rect.x1.min(rect.x0.saturating_add(turn)), ..rect },
            None => rect,
        };
        let rect = rect.intersection(&self.view.rect());
        for y in rect.y0..rect.y1 {
            let Some(rays) = self.view.rays.row(y as usize) else { continue };
            let row = (y - self.view.rows.start) as usize * width;
            for x in rect.x0..rect.x1 {
                let x = turn_px.map_or(x, |turn| x.rem_euclid(turn)) as usize;
                draw(Vec3::from(rays[x]), &mut self.layers[row + x]);
            }
        }
    }
}
