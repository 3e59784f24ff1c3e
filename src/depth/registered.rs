//! Registration of a depth map with the frames' picture, if it has another size or a camera of its
//! own.
//!
//! On a plane n·X = d the inverse depth w = 1/z is (n/d)·ray: linear in the picture. Between
//! neighbours on one surface w is therefore interpolated linearly, which is exact for planes.
//! Neighbours belong to one surface if their w are equal but for noise. They also do if their
//! difference is the same as on either side, and possible for a plane under 5°. At a discontinuity
//! each sample covers its own quarter of the cell between four samples, with the slope towards the
//! neighbours on its surface. Edges are then midway, and `repair` aligns them with the picture's.
//!
//! Not modelled: the depth sensor's own readout; surfaces that are hidden from the depth camera
//! (they are holes).

use std::sync::OnceLock;

use glam::{DVec2, DVec3};

use crate::camera::Geometry;
use crate::pixels::DepthMap;
use crate::pose::Pose;

/// Smaller relative differences of inverse depth are noise: a Kinect's step at 4 m is 1.1 % (an
/// eighth of a pixel of disparity over 75 mm at 585 px), a phone's sensor is specified to be within
/// 1 %.
const NOISE: f32 = 0.015;
/// tan 85°. On a plane under 5°, w changes by this over the focal length in pixels, from pixel to
/// pixel.
const GRAZING: f64 = 11.43;
/// Largest width of a triangle, as a fraction of the picture's.
const MAX_TRIANGLE_WIDTH: f64 = 1.0 / 8.0;
/// Largest width of a triangle of a small map, in cells.
const MAX_TRIANGLE_CELLS: f64 = 4.0;

/// True if a map has the aspect ratio of a picture, within a pixel of the map.
pub fn is_same_aspect(map: (u32, u32), picture: (u32, u32)) -> bool {
    let [(w, h), (width, height)] = [map, picture].map(|(w, h)| (f64::from(w), f64::from(h)));
    (w - h * width / height).abs() <= 1.0 || (h - w * height / width).abs() <= 1.0
}

/// Fraction of a map's pixels without depth, 0 to 1.
pub fn unknown_fraction(map: &DepthMap) -> f64 {
    let unknown = map.depth_m.iter().filter(|z| z.is_nan() || **z <= 0.0).count();
    unknown as f64 / map.depth_m.len().max(1) as f64
}

/// A map upsampled to a picture of the same view. Unknown depth stays 0.
pub fn upsampled(map: &DepthMap, width: u32, height: u32) -> DepthMap {
    let samples = InverseDepthMap::new(map, f64::from(map.width));
    let columns = AxisPosition::all(samples.width, width);
    let rows = AxisPosition::all(samples.height, height);
    let pixel = |row: &AxisPosition, column: &AxisPosition| {
        let i = row.nearest * samples.width + column.nearest;
        let w = samples.inverse_depth(i, *column, row.scaled(samples.width));
        if w > 0.0 { w.recip() } else { 0.0 }
    };
    let depth_m = rows.iter().flat_map(|row| columns.iter().map(move |column| pixel(row, column))).collect();
    DepthMap { width, height, depth_m, timestamp_s: map.timestamp_s }
}

/// A position between samples, along one axis.
#[derive(Clone, Copy)]
struct AxisPosition {
    nearest: usize,
    /// Index offset of the next sample in the direction of the position; 0 at the rim.
    step: isize,
    /// Distance to the nearest sample, in samples, 0 to 0.5.
    share: f32,
}

impl AxisPosition {
    /// The positions of a picture's pixel centres between `samples`.
    fn all(samples: usize, pixels: u32) -> Vec<Self> {
        let scale = samples as f64 / f64::from(pixels);
        let place = |pixel: u32| {
            let at = (f64::from(pixel) + 0.5) * scale - 0.5;
            let nearest = at.round().clamp(0.0, samples as f64 - 1.0);
            let step = if at < nearest { -1 } else { 1 };
            let is_beyond = at < 0.0 || at > samples as f64 - 1.0;
            let (step, share) = if is_beyond { (0, 0.0) } else { (step, (at - nearest).abs() as f32) };
            let is_last = step == 1 && nearest as usize + 1 == samples;
            Self { nearest: nearest as usize, step: if is_last { 0 } else { step }, share }
        };
        (0..pixels).map(place).collect()
    }

    fn scaled(self, stride: usize) -> Self {
        Self { step: self.step * stride as isize, ..self }
    }
}

/// A map's inverse depths, with links between neighbours on one surface.
struct InverseDepthMap {
    width: usize,
    height: usize,
    /// 1/m; 0 where unknown.
    w: Vec<f32>,
    /// True if a sample and its right, or lower, neighbour belong to one surface.
    right: Vec<bool>,
    below: Vec<bool>,
}

impl InverseDepthMap {
    fn new(map: &DepthMap, focal_px: f64) -> Self {
        let (width, height) = (map.width as usize, map.height as usize);
        let inverse_depth = |z: &f32| if *z > 0.0 && z.is_finite() { z.recip() } else { 0.0 };
        let w: Vec<f32> = map.depth_m.iter().map(inverse_depth).collect();
        let steepest = (GRAZING / focal_px) as f32;
        let is_joined = |i: usize, step: usize, at: usize, side: usize| {
            let inverse_depth = |i: usize| w.get(i).copied().filter(|w| *w > 0.0);
            let Some((a, b)) = inverse_depth(i).filter(|_| at + 1 < side).zip(inverse_depth(i + step)) else {
                return false;
            };
            let (largest, difference) = (a.max(b), b - a);
            let is_alike = |difference: f32| difference.abs() <= NOISE * largest;
            let before = if at > 0 { inverse_depth(i - step) } else { None };
            let after = if at + 2 < side { inverse_depth(i + 2 * step) } else { None };
            let is_continued = || {
                before.is_some_and(|before| is_alike(a - before - difference))
                    || after.is_some_and(|after| is_alike(after - b - difference))
            };
            is_alike(difference) || (difference.abs() <= steepest * largest && is_continued())
        };
        let right = (0..w.len()).map(|i| is_joined(i, 1, i % width, width)).collect();
        let below = (0..w.len()).map(|i| is_joined(i, width, i / width, height)).collect();
        Self { width, height, w, right, below }
    }

    /// True if a sample and the one at the index offset `step` belong to one surface.
    fn is_joined_with(&self, i: usize, step: isize) -> bool {
        let first = if step < 0 { i.wrapping_add_signed(step) } else { i };
        let links = if step.unsigned_abs() == 1 && self.width != 1 { &self.right } else { &self.below };
        step != 0 && links.get(first).copied().unwrap_or(false)
    }

    /// Inverse depth within the quarter cell of a sample; 0 if it is unknown. Steps are index
    /// offsets.
    fn inverse_depth(&self, i: usize, x: AxisPosition, y: AxisPosition) -> f32 {
        let w = self.w[i];
        if w <= 0.0 {
            return 0.0;
        }
        let at = |step: isize| i.wrapping_add_signed(step);
        let slope =
            |axis: AxisPosition| if self.is_joined_with(i, axis.step) { self.w[at(axis.step)] - w } else { 0.0 };
        let (dx, dy) = (slope(x), slope(y));
        let is_whole = self.is_joined_with(i, x.step)
            && self.is_joined_with(i, y.step)
            && self.is_joined_with(at(x.step), y.step)
            && self.is_joined_with(at(y.step), x.step);
        let twist = if is_whole { self.w[at(x.step + y.step)] - w - dx - dy } else { 0.0 };
        w + x.share * dx + y.share * dy + x.share * y.share * twist
    }

    /// True if the four samples of the cell to the lower right of a sample belong to one surface.
    fn is_whole(&self, i: usize) -> bool {
        self.right[i] && self.below[i] && self.below[i + 1] && self.right[i + self.width]
    }
}

/// A depth camera beside the colour camera.
#[derive(Debug)]
pub struct DepthCamera {
    geometry: Geometry,
    colour_from_depth: Pose,
    /// Rays through the pixel centres in the axes of the colour camera, scaled so that depth × ray
    /// is the point relative to the depth camera's centre; NaN for pixels without a ray. No memo:
    /// they depend on the other fields alone.
    rays: OnceLock<Vec<DVec3>>,
}

impl DepthCamera {
    /// A text that identifies the geometry and the pose.
    pub fn identity(&self) -> String {
        format!("{:?} {:?}", self.geometry, self.colour_from_depth)
    }

    /// `colour_from_depth` transforms points from the depth camera's axes to the colour camera's,
    /// m.
    pub fn new(geometry: Geometry, colour_from_depth: Pose) -> Self {
        Self { geometry, colour_from_depth, rays: OnceLock::new() }
    }

    /// The size of its maps, px.
    pub fn size(&self) -> (u32, u32) {
        (self.geometry.intrinsics.width_px, self.geometry.intrinsics.height_px)
    }

    /// The map from the colour camera at the same time, in the size of its picture; 0 where
    /// unknown. The nearest surface wins. A map of another size than this camera's is unknown
    /// everywhere.
    pub fn registered(&self, map: &DepthMap, colour: &Geometry) -> DepthMap {
        let mut buffer = DepthBuffer::new(colour, map.width);
        if (map.width, map.height) == self.size() {
            self.draw(map, colour, &mut buffer);
        }
        let depth_m = buffer.nearest.into_iter().map(|w| if w > 0.0 { w.recip() } else { 0.0 }).collect();
        let (width, height) = (buffer.width as u32, buffer.height as u32);
        DepthMap { width, height, depth_m, timestamp_s: map.timestamp_s }
    }

    fn draw(&self, map: &DepthMap, colour: &Geometry, buffer: &mut DepthBuffer) {
        let samples = InverseDepthMap::new(map, self.geometry.intrinsics.fx_px);
        let rays = self.rays.get_or_init(|| self.rays(samples.width, samples.height));
        let is_equirectangular = colour.is_equirectangular();
        let project = |ray: DVec3, w: f32| {
            let point = ray * f64::from(w).recip() + self.colour_from_depth.translation_m;
            let at_px = colour.project(point)?;
            let depth = if is_equirectangular { point.length() } else { point.z };
            Some(ProjectedVertex { at_px, w: depth.recip() })
        };
        let projected = |i: usize| (samples.w[i] > 0.0).then(|| project(rays[i], samples.w[i])).flatten();
        let vertices: Vec<Option<ProjectedVertex>> = (0..samples.w.len()).map(projected).collect();
        let width = samples.width;
        for y in 0..samples.height.saturating_sub(1) {
            for i in (0..width.saturating_sub(1)).map(|x| y * width + x) {
                if samples.is_whole(i) {
                    buffer.quad([vertices[i], vertices[i + 1], vertices[i + width + 1], vertices[i + width]]);
                    continue;
                }
                let cell = [(i, 1, 1), (i + 1, -1, 1), (i + width, 1, -1), (i + width + 1, -1, -1)];
                for (sample, right, down) in cell.into_iter().filter(|(sample, ..)| samples.w[*sample] > 0.0) {
                    let down = down * width as isize;
                    // At a fraction of the way along the sides from the sample.
                    let vertex = |share_x: f32, share_y: f32| {
                        let x = AxisPosition { nearest: sample, step: right, share: share_x };
                        let y = AxisPosition { nearest: sample, step: down, share: share_y };
                        let ray = |step: isize| rays[sample.wrapping_add_signed(step)];
                        let (sx, sy) = (f64::from(share_x), f64::from(share_y));
                        let between = ray(0) + sx * (ray(right) - ray(0)) + sy * (ray(down) - ray(0));
                        project(between, samples.inverse_depth(sample, x, y))
                    };
                    buffer.quad([vertices[sample], vertex(0.5, 0.0), vertex(0.5, 0.5), vertex(0.0, 0.5)]);
                }
            }
        }
    }

    fn rays(&self, width: usize, height: usize) -> Vec<DVec3> {
        let centre = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let turn = self.colour_from_depth.rotation;
        (0..width * height).map(|i| turn * self.geometry.depth_ray(centre(i)).unwrap_or(DVec3::NAN)).collect()
    }
}

/// A vertex of a triangle in the picture.
#[derive(Clone, Copy)]
struct ProjectedVertex {
    at_px: DVec2,
    /// Inverse depth, 1/m.
    w: f64,
}

/// A depth buffer of inverse depths; 0 where empty.
struct DepthBuffer {
    width: usize,
    height: usize,
    /// Larger triangles are skipped: they pass beside the camera, or cross a 360° picture's seam.
    max_triangle_px: f64,
    nearest: Vec<f32>,
}

impl DepthBuffer {
    fn new(colour: &Geometry, map_width: u32) -> Self {
        let (width, height) = (colour.intrinsics.width_px as usize, colour.intrinsics.height_px as usize);
        let share = MAX_TRIANGLE_WIDTH.max(MAX_TRIANGLE_CELLS / f64::from(map_width.max(1)));
        Self { width, height, max_triangle_px: share * width as f64, nearest: vec![0.0; width * height] }
    }

    /// A quadrilateral by its corners in order.
    fn quad(&mut self, vertices: [Option<ProjectedVertex>; 4]) {
        let [Some(a), Some(b), Some(c), Some(d)] = vertices else { return };
        self.triangle([a, b, c]);
        self.triangle([a, c, d]);
    }

    /// Rasterizes a triangle, with the pixel centres on its sides. 1/z is linear.
    fn triangle(&mut self, [a, b, c]: [ProjectedVertex; 3]) {
        let low = a.at_px.min(b.at_px).min(c.at_px);
        let high = a.at_px.max(b.at_px).max(c.at_px);
        let area = (b.at_px - a.at_px).perp_dot(c.at_px - a.at_px);
        let is_drawn = (high - low).max_element() <= self.max_triangle_px && area.abs() > 1e-12;
        if !is_drawn {
            return;
        }
        // Range of the pixels whose centres the bounding box contains. Truncation by `as` is one
        // instruction; on the baseline target `ceil` is a function call, slower than most
        // triangles.
        let first = |low: f64| {
            let at = (low - 0.5).max(0.0);
            (at as usize).saturating_add(usize::from((at as usize as f64) < at))
        };
        let end =
            |high: f64, side: usize| if high < 0.5 { 0 } else { ((high - 0.5) as usize).saturating_add(1).min(side) };
        let columns = first(low.x)..end(high.x, self.width);
        let (to_b_px, to_c_px) = (b.at_px - a.at_px, c.at_px - a.at_px);
        // Rounding must not leave a seam between two triangles.
        let (sign, whole) = (area.signum(), area.abs());
        let tolerance = 1e-9 * whole;
        for y in first(low.y)..end(high.y, self.height) {
            for x in columns.clone() {
                let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a.at_px;
                // Twice the areas of the sub-triangles opposite to b and c: unnormalised
                // barycentric coordinates. They are divided by the whole area only inside the
                // triangle.
                let (area_b, area_c) = (sign * at.perp_dot(to_c_px), sign * to_b_px.perp_dot(at));
                if area_b >= -tolerance && area_c >= -tolerance && area_b + area_c <= whole + tolerance {
                    let w = (a.w + area_b / whole * (b.w - a.w) + area_c / whole * (c.w - a.w)) as f32;
                    let nearest = &mut self.nearest[y * self.width + x];
                    *nearest = nearest.max(w);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Distortion;
    use glam::DQuat;

    fn map(width: u32, height: u32, z: impl Fn(u32, u32) -> f64) -> DepthMap {
        let depth_m = (0..width * height).map(|i| z(i % width, i / width) as f32).collect();
        DepthMap { width, height, depth_m, timestamp_s: 7.0 }
    }

    fn row(map: &DepthMap, y: u32) -> &[f32] {
        &map.depth_m[(y * map.width) as usize..((y + 1) * map.width) as usize]
    }

    /// The depth of the plane y = 1 m below a camera of this height in pixels, in the pixel row
    /// `y`.
    fn floor_m(y: f64, height: f64, focal_px: f64) -> f64 {
        focal_px / (y + 0.5 - 0.5 * height)
    }

    #[test]
    fn aspect_is_the_same_within_a_pixel_of_the_map() {
        assert!(is_same_aspect((256, 192), (1920, 1440)) && is_same_aspect((640, 480), (640, 480)));
        // 1080 / 1920 · 256 = 144; a row less is still the same picture, two less are not.
        assert!(is_same_aspect((256, 143), (1920, 1080)) && !is_same_aspect((256, 142), (1920, 1080)));
        assert!(!is_same_aspect((320, 200), (640, 480)));
    }

    #[test]
    fn upsampled_floor_has_the_depth_of_its_plane() {
        // The lower half of a picture: rows 30 to 47 of 48 see a floor under 7 to 26° at f = 48 px.
        let z = |y: u32| if y < 30 { 0.0 } else { floor_m(y.into(), 48.0, 48.0) };
        let large = upsampled(&map(64, 48, |_, y| z(y)), 480, 360);
        assert_eq!((large.width, large.height, large.timestamp_s), (480, 360, 7.0));
        // Between the centres of rows 30 and 47: 7.5 · 30.5 = 228.75.
        for y in 230..355 {
            let expected = floor_m(y.into(), 360.0, 360.0);
            for z in [row(&large, y)[3], row(&large, y)[250]] {
                assert!((f64::from(z) / expected - 1.0).abs() < 1e-5, "row {y}: {z} is not {expected}");
            }
        }
        // Unknown depth extends half-way to the next sample.
        assert!(row(&large, 224).iter().all(|z| *z == 0.0) && row(&large, 226).iter().all(|z| *z > 0.0));
    }

    #[test]
    fn upsampled_step_is_sharp_and_midway() {
        let large = upsampled(&map(8, 6, |x, _| if x < 4 { 1.0 } else { 1.3 }), 80, 60);
        assert_eq!(row(&large, 31), [[1.0f32; 40], [1.3f32; 40]].concat());
        // 1 % is noise and is interpolated, linearly in 1/z.
        let noise = upsampled(&map(2, 2, |x, _| if x < 1 { 1.0 } else { 1.01 }), 3, 2);
        assert!((row(&noise, 0)[1] - 2.0 / (1.0 + 1.0 / 1.01)).abs() < 1e-6, "{:?}", noise.depth_m);
    }

    #[test]
    fn map_of_the_same_size_is_unchanged() {
        let ragged = map(9, 7, |x, y| if (x * y) % 5 == 1 { 0.0 } else { 1.0 + f64::from((x * 7 + y * 3) % 4) });
        let same = upsampled(&ragged, 9, 7);
        for (a, b) in same.depth_m.iter().zip(&ragged.depth_m) {
            assert!((a - b).abs() <= 1e-6 * b, "{a} {b}");
        }
        assert_eq!(unknown_fraction(&same), unknown_fraction(&ragged));
    }

    /// The colour camera stands 0.1 m to the right of the depth camera.
    fn beside() -> Pose {
        Pose::from_camera_in_world(DVec3::new(0.1, 0.0, 0.0), DQuat::IDENTITY)
    }

    #[test]
    fn shifted_camera_has_the_parallax() {
        // f·b/z: a wall at 2 m moves left by 100 · 0.1 / 2 = 5 px, a board at 1 m, columns 20 to
        // 39, by 10.
        let board = |x: u32| (20..40).contains(&x);
        let registered = DepthCamera::new(Geometry::pinhole(64, 48, 100.0), beside())
            .registered(&map(64, 48, |x, _| if board(x) { 1.0 } else { 2.0 }), &Geometry::pinhole(64, 48, 100.0));
        let row = row(&registered, 24);
        let is_uniform =
            |range: std::ops::Range<usize>, z: f32| row[range].iter().all(|depth| (depth - z).abs() < 1e-6);
        // The board's edges are midway between samples: at 20 and 40 in its camera, at 10 and 30
        // here.
        assert!(is_uniform(0..10, 2.0) && is_uniform(10..30, 1.0), "{row:?}");
        // The wall is visible to the depth camera from 40 on, which is 35 here. Between them the
        // board hides it.
        assert!(is_uniform(30..35, 0.0) && is_uniform(35..58, 2.0), "{row:?}");
        // Outside the view of the depth camera.
        assert!(is_uniform(59..64, 0.0), "{row:?}");
    }

    #[test]
    fn rotated_camera_with_another_lens_measures_the_same_plane() {
        // A wall 2 m away, in a coarse depth camera that is turned by 5°, and in a distorting lens.
        let turn = DQuat::from_rotation_y(5f64.to_radians());
        let colour_from_depth = Pose::new(turn, DVec3::new(-0.03, 0.01, 0.005));
        let small = Geometry::pinhole(80, 60, 50.0);
        // In the colour camera's axes n·X = 2 with n = z.
        let (n, d) = (turn.inverse() * DVec3::Z, 2.0 - colour_from_depth.translation_m.z);
        let z = |x: u32, y: u32| {
            let ray = small.depth_ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
            d / n.dot(ray)
        };
        let of_map = map(80, 60, z);
        let mut colour = Geometry::pinhole(320, 240, 300.0);
        colour = Geometry::new(colour.intrinsics, Distortion { k1: -0.1, k2: 0.02, ..Default::default() });
        let registered = DepthCamera::new(small, colour_from_depth).registered(&of_map, &colour);
        assert_eq!(unknown_fraction(&registered), 0.0);
        for z in &registered.depth_m {
            assert!((z - 2.0).abs() < 2e-4, "{z}");
        }
    }

    #[test]
    fn map_of_another_size_and_damaged_depths_are_unknown() {
        let of = DepthCamera::new(Geometry::pinhole(8, 6, 8.0), beside());
        assert_eq!(unknown_fraction(&of.registered(&map(9, 6, |_, _| 1.0), &Geometry::pinhole(8, 6, 8.0))), 1.0);
        let odd = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e-30, 1e30];
        let odd = map(8, 6, |x, y| odd[(x + 3 * y) as usize % odd.len()]);
        let registered = of.registered(&odd, &Geometry::pinhole(8, 6, 8.0));
        assert!(registered.depth_m.iter().all(|z| z.is_finite() && *z >= 0.0), "{:?}", registered.depth_m);
        assert!(upsampled(&odd, 16, 12).depth_m.iter().all(|z| z.is_finite() && *z >= 0.0));
        assert_eq!(upsampled(&map(1, 1, |_, _| 3.0), 2, 2).depth_m, [3.0; 4]);
    }
}
