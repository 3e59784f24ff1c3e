//! A sensor's map brought into the frames' picture, when it has another size, or a camera of its own.
//!
//! On a plane n·X = d the inverse depth w = 1/z is (n/d)·ray: linear in the picture. So between neighbours that belong
//! to one surface w is interpolated linearly, which is exact for planes. Neighbours belong to one surface if their w
//! are equal but for noise, or if the difference goes on as it comes from either side, and a plane seen under 5° may
//! still have it. Where they do not, each sample covers its own quarter of the cell between four samples, with the
//! slope that it has towards the neighbours on its surface: edges lie midway, and `repaired` moves them to the
//! picture's.
//!
//! Not modelled: the depth sensor's own readout; surfaces that the depth camera does not see (they are holes).

use std::sync::OnceLock;

use glam::{DVec2, DVec3};

use crate::camera::Geometry;
use crate::pixels::DepthMap;
use crate::pose::Pose;

/// Smaller differences of inverse depth, as a share of it, are noise: a Kinect's step at 4 m is 1.1 % (an eighth of a
/// pixel of disparity over 75 mm at 585 px), a phone's sensor is stated to be within 1 %.
const NOISE: f32 = 0.015;
/// tan 85°. Seen under 5°, w changes from one pixel to the next by this divided by the focal length in pixels.
const GRAZING: f64 = 11.43;
/// No cell covers more of a picture's width than this, or than so many cells of the map side by side.
const MOST_OF_PICTURE: f64 = 1.0 / 8.0;
const MOST_CELLS: f64 = 4.0;

/// Whether a map of one size shows the whole view of a picture of another: the shapes agree within a pixel of the map.
pub fn is_same_view(map: (u32, u32), picture: (u32, u32)) -> bool {
    let [(w, h), (width, height)] = [map, picture].map(|(w, h)| (f64::from(w), f64::from(h)));
    (w - h * width / height).abs() <= 1.0 || (h - w * height / width).abs() <= 1.0
}

/// The share of a map's pixels at which nothing is known, 0 to 1.
pub fn holes(map: &DepthMap) -> f64 {
    let unknown = map.depth_m.iter().filter(|z| z.is_nan() || **z <= 0.0).count();
    unknown as f64 / map.depth_m.len().max(1) as f64
}

/// A map of the same view in a picture's size. Where nothing was measured it stays 0.
pub fn enlarged(map: &DepthMap, width: u32, height: u32) -> DepthMap {
    let samples = Samples::new(map, f64::from(map.width));
    let columns = Along::all(samples.width, width);
    let rows = Along::all(samples.height, height);
    let pixel = |row: &Along, column: &Along| {
        let i = row.nearest * samples.width + column.nearest;
        let w = samples.inverse(i, *column, row.scaled(samples.width));
        if w > 0.0 { w.recip() } else { 0.0 }
    };
    let depth_m = rows.iter().flat_map(|row| columns.iter().map(move |column| pixel(row, column))).collect();
    DepthMap { width, height, depth_m, timestamp_s: map.timestamp_s }
}

/// A place between samples, along one axis.
#[derive(Clone, Copy)]
struct Along {
    nearest: usize,
    /// What is added to an index to get the next sample towards the place; 0 at the rim.
    step: isize,
    /// How far towards it, 0 to 0.5.
    share: f32,
}

impl Along {
    /// The places of a picture's pixel centres among `samples`.
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

/// A map's inverse depths, and which neighbours belong to one surface.
struct Samples {
    width: usize,
    height: usize,
    /// 1/m; 0 where unknown.
    w: Vec<f32>,
    /// Whether a sample belongs to one surface with the next to the right, and below.
    right: Vec<bool>,
    below: Vec<bool>,
}

impl Samples {
    fn new(map: &DepthMap, focal_px: f64) -> Self {
        let (width, height) = (map.width as usize, map.height as usize);
        let inverse = |z: &f32| if *z > 0.0 && z.is_finite() { z.recip() } else { 0.0 };
        let w: Vec<f32> = map.depth_m.iter().map(inverse).collect();
        let steepest = (GRAZING / focal_px) as f32;
        let joined = |i: usize, step: usize, at: usize, side: usize| {
            let known = |i: usize| w.get(i).copied().filter(|w| *w > 0.0);
            let Some((a, b)) = known(i).filter(|_| at + 1 < side).zip(known(i + step)) else { return false };
            let (most, difference) = (a.max(b), b - a);
            let is_alike = |difference: f32| difference.abs() <= NOISE * most;
            let before = if at > 0 { known(i - step) } else { None };
            let after = if at + 2 < side { known(i + 2 * step) } else { None };
            let goes_on = || {
                before.is_some_and(|before| is_alike(a - before - difference))
                    || after.is_some_and(|after| is_alike(after - b - difference))
            };
            is_alike(difference) || (difference.abs() <= steepest * most && goes_on())
        };
        let right = (0..w.len()).map(|i| joined(i, 1, i % width, width)).collect();
        let below = (0..w.len()).map(|i| joined(i, width, i / width, height)).collect();
        Self { width, height, w, right, below }
    }

    /// Whether a sample belongs to one surface with the one that lies `step` beside it.
    fn joins(&self, i: usize, step: isize) -> bool {
        let first = if step < 0 { i.wrapping_add_signed(step) } else { i };
        let links = if step.unsigned_abs() == 1 && self.width != 1 { &self.right } else { &self.below };
        step != 0 && links.get(first).copied().unwrap_or(false)
    }

    /// Inverse depth within the quarter cell of a sample, 0 if it is unknown. Steps are those of indices.
    fn inverse(&self, i: usize, x: Along, y: Along) -> f32 {
        let w = self.w[i];
        if w <= 0.0 {
            return 0.0;
        }
        let at = |step: isize| i.wrapping_add_signed(step);
        let slope = |along: Along| if self.joins(i, along.step) { self.w[at(along.step)] - w } else { 0.0 };
        let (dx, dy) = (slope(x), slope(y));
        let is_whole = self.joins(i, x.step)
            && self.joins(i, y.step)
            && self.joins(at(x.step), y.step)
            && self.joins(at(y.step), x.step);
        let twist = if is_whole { self.w[at(x.step + y.step)] - w - dx - dy } else { 0.0 };
        w + x.share * dx + y.share * dy + x.share * y.share * twist
    }

    /// Whether the four samples of the cell right of and below a sample belong to one surface.
    fn is_whole(&self, i: usize) -> bool {
        self.right[i] && self.below[i] && self.below[i + 1] && self.right[i + self.width]
    }
}

/// A depth sensor's camera beside the one that takes the frames.
#[derive(Debug)]
pub struct DepthCamera {
    geometry: Geometry,
    colour_from_depth: Pose,
    /// Through the pixel centres, in the axes of the camera that takes the frames, scaled so that depth × ray is the point from the
    /// depth camera's centre; NaN where there is none.
    rays: OnceLock<Vec<DVec3>>,
}

impl DepthCamera {
    /// Itself and where it is, in words that change with them.
    pub fn told(&self) -> String {
        format!("{:?} {:?}", self.geometry, self.colour_from_depth)
    }

    /// `colour_from_depth` takes a point in the depth camera's axes to those of the camera that takes the frames,
    /// metres.
    pub fn new(geometry: Geometry, colour_from_depth: Pose) -> Self {
        Self { geometry, colour_from_depth, rays: OnceLock::new() }
    }

    /// The size of its maps, px.
    pub fn size(&self) -> (u32, u32) {
        (self.geometry.intrinsics.width_px, self.geometry.intrinsics.height_px)
    }

    /// The map as `colour` would have measured it at the same moment: its picture's size, 0 where the depth camera saw
    /// nothing. Of several surfaces the nearest stays. A map that is not of this camera's size is unknown everywhere.
    pub fn registered(&self, map: &DepthMap, colour: &Geometry) -> DepthMap {
        let mut canvas = Canvas::new(colour, map.width);
        if (map.width, map.height) == self.size() {
            self.draw(map, colour, &mut canvas);
        }
        let depth_m = canvas.nearest.into_iter().map(|w| if w > 0.0 { w.recip() } else { 0.0 }).collect();
        let (width, height) = (canvas.width as u32, canvas.height as u32);
        DepthMap { width, height, depth_m, timestamp_s: map.timestamp_s }
    }

    fn draw(&self, map: &DepthMap, colour: &Geometry, canvas: &mut Canvas) {
        let samples = Samples::new(map, self.geometry.intrinsics.fx_px);
        let rays = self.rays.get_or_init(|| self.rays(samples.width, samples.height));
        let is_equirectangular = colour.is_equirectangular();
        let seen = |ray: DVec3, w: f32| {
            let point = ray * f64::from(w).recip() + self.colour_from_depth.translation_m;
            let at_px = colour.project(point)?;
            let told = if is_equirectangular { point.length() } else { point.z };
            Some(Corner { at_px, w: told.recip() })
        };
        let known = |i: usize| (samples.w[i] > 0.0).then(|| seen(rays[i], samples.w[i])).flatten();
        let corners: Vec<Option<Corner>> = (0..samples.w.len()).map(known).collect();
        let width = samples.width;
        for y in 0..samples.height.saturating_sub(1) {
            for i in (0..width.saturating_sub(1)).map(|x| y * width + x) {
                if samples.is_whole(i) {
                    canvas.quad([corners[i], corners[i + 1], corners[i + width + 1], corners[i + width]]);
                    continue;
                }
                let cell = [(i, 1, 1), (i + 1, -1, 1), (i + width, 1, -1), (i + width + 1, -1, -1)];
                for (sample, right, down) in cell.into_iter().filter(|(sample, ..)| samples.w[*sample] > 0.0) {
                    let down = down * width as isize;
                    // Along the sides from the sample, and to the cell's middle.
                    let corner = |share_x: f32, share_y: f32| {
                        let x = Along { nearest: sample, step: right, share: share_x };
                        let y = Along { nearest: sample, step: down, share: share_y };
                        let ray = |step: isize| rays[sample.wrapping_add_signed(step)];
                        let (sx, sy) = (f64::from(share_x), f64::from(share_y));
                        let between = ray(0) + sx * (ray(right) - ray(0)) + sy * (ray(down) - ray(0));
                        seen(between, samples.inverse(sample, x, y))
                    };
                    canvas.quad([corners[sample], corner(0.5, 0.0), corner(0.5, 0.5), corner(0.0, 0.5)]);
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

/// A corner of a triangle in the picture.
#[derive(Clone, Copy)]
struct Corner {
    at_px: DVec2,
    /// Inverse depth, 1/m.
    w: f64,
}

/// The nearest surfaces so far, as inverse depths; 0 is nothing.
struct Canvas {
    width: usize,
    height: usize,
    /// A triangle that is wider or higher is no surface: it passes beside the camera, or across a 360° picture's seam.
    widest_px: f64,
    nearest: Vec<f32>,
}

impl Canvas {
    fn new(colour: &Geometry, map_width: u32) -> Self {
        let (width, height) = (colour.intrinsics.width_px as usize, colour.intrinsics.height_px as usize);
        let share = MOST_OF_PICTURE.max(MOST_CELLS / f64::from(map_width.max(1)));
        Self { width, height, widest_px: share * width as f64, nearest: vec![0.0; width * height] }
    }

    /// A quadrilateral by its corners, one after another around it.
    fn quad(&mut self, corners: [Option<Corner>; 4]) {
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return };
        self.triangle([a, b, c]);
        self.triangle([a, c, d]);
    }

    /// Covers the pixel centres within a triangle, its sides too; 1/z is linear.
    fn triangle(&mut self, [a, b, c]: [Corner; 3]) {
        let low = a.at_px.min(b.at_px).min(c.at_px);
        let high = a.at_px.max(b.at_px).max(c.at_px);
        let area = (b.at_px - a.at_px).perp_dot(c.at_px - a.at_px);
        let is_drawn = (high - low).max_element() <= self.widest_px && area.abs() > 1e-12;
        if !is_drawn {
            return;
        }
        // Range of the pixels whose centres the bounding box contains. Truncation by `as` is one
        // instruction; on the baseline target `ceil` is a function call, slower than most triangles.
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
                // Twice the areas of the sub-triangles opposite to b and c: unnormalised barycentric
                // coordinates. They are divided by the whole area only inside the triangle.
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

    /// The depth of the plane y = 1 m below a camera of this height in pixels, in the pixel row `y`.
    fn floor_m(y: f64, height: f64, focal_px: f64) -> f64 {
        focal_px / (y + 0.5 - 0.5 * height)
    }

    #[test]
    fn what_shows_the_same_view() {
        assert!(is_same_view((256, 192), (1920, 1440)) && is_same_view((640, 480), (640, 480)));
        // 1080 / 1920 · 256 = 144; a row less is still the same picture, two less are not.
        assert!(is_same_view((256, 143), (1920, 1080)) && !is_same_view((256, 142), (1920, 1080)));
        assert!(!is_same_view((320, 200), (640, 480)));
    }

    #[test]
    fn an_enlarged_floor_is_the_floor() {
        // The lower half of a picture: rows 30 to 47 of 48 see a floor under 7 to 26° at f = 48 px.
        let z = |y: u32| if y < 30 { 0.0 } else { floor_m(y.into(), 48.0, 48.0) };
        let large = enlarged(&map(64, 48, |_, y| z(y)), 480, 360);
        assert_eq!((large.width, large.height, large.timestamp_s), (480, 360, 7.0));
        // Between the centres of rows 30 and 47: 7.5 · 30.5 = 228.75.
        for y in 230..355 {
            let expected = floor_m(y.into(), 360.0, 360.0);
            for z in [row(&large, y)[3], row(&large, y)[250]] {
                assert!((f64::from(z) / expected - 1.0).abs() < 1e-5, "row {y}: {z} is not {expected}");
            }
        }
        // An unknown sample is unknown as far as half-way to the next.
        assert!(row(&large, 224).iter().all(|z| *z == 0.0) && row(&large, 226).iter().all(|z| *z > 0.0));
    }

    #[test]
    fn a_step_lies_midway_and_nothing_lies_between() {
        let large = enlarged(&map(8, 6, |x, _| if x < 4 { 1.0 } else { 1.3 }), 80, 60);
        assert_eq!(row(&large, 31), [[1.0f32; 40], [1.3f32; 40]].concat());
        // 1 % is noise, and is levelled: half of it half-way, in 1/z.
        let noise = enlarged(&map(2, 2, |x, _| if x < 1 { 1.0 } else { 1.01 }), 3, 2);
        assert!((row(&noise, 0)[1] - 2.0 / (1.0 + 1.0 / 1.01)).abs() < 1e-6, "{:?}", noise.depth_m);
    }

    #[test]
    fn the_same_size_stays_as_it_is() {
        let ragged = map(9, 7, |x, y| if (x * y) % 5 == 1 { 0.0 } else { 1.0 + f64::from((x * 7 + y * 3) % 4) });
        let same = enlarged(&ragged, 9, 7);
        for (a, b) in same.depth_m.iter().zip(&ragged.depth_m) {
            assert!((a - b).abs() <= 1e-6 * b, "{a} {b}");
        }
        assert_eq!(holes(&same), holes(&ragged));
    }

    /// The colour camera stands 0.1 m to the right of the depth camera.
    fn beside() -> Pose {
        Pose::from_camera_in_world(DVec3::new(0.1, 0.0, 0.0), DQuat::IDENTITY)
    }

    #[test]
    fn a_shifted_camera_sees_the_parallax() {
        // f·b/z: a wall at 2 m moves left by 100 · 0.1 / 2 = 5 px, a board at 1 m, columns 20 to 39, by 10.
        let board = |x: u32| (20..40).contains(&x);
        let seen = DepthCamera::new(Geometry::pinhole(64, 48, 100.0), beside())
            .registered(&map(64, 48, |x, _| if board(x) { 1.0 } else { 2.0 }), &Geometry::pinhole(64, 48, 100.0));
        let row = row(&seen, 24);
        let of = |range: std::ops::Range<usize>, z: f32| row[range].iter().all(|found| (found - z).abs() < 1e-6);
        // The board's edges lie midway between samples: at 20 and 40 in its camera, at 10 and 30 here.
        assert!(of(0..10, 2.0) && of(10..30, 1.0), "{row:?}");
        // The depth camera saw the wall again from 40 on: from 35 here. Between, the board hid it.
        assert!(of(30..35, 0.0) && of(35..58, 2.0), "{row:?}");
        // The rim of its view.
        assert!(of(59..64, 0.0), "{row:?}");
    }

    #[test]
    fn a_turned_camera_with_a_lens_of_its_own_sees_the_plane_where_it_is() {
        // A wall 2 m away, seen by a coarse depth camera that looks 5° to the side, and by a distorting lens.
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
        let seen = DepthCamera::new(small, colour_from_depth).registered(&of_map, &colour);
        assert_eq!(holes(&seen), 0.0);
        for z in &seen.depth_m {
            assert!((z - 2.0).abs() < 2e-4, "{z}");
        }
    }

    #[test]
    fn maps_of_another_size_and_damaged_depths_make_holes() {
        let of = DepthCamera::new(Geometry::pinhole(8, 6, 8.0), beside());
        assert_eq!(holes(&of.registered(&map(9, 6, |_, _| 1.0), &Geometry::pinhole(8, 6, 8.0))), 1.0);
        let odd = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e-30, 1e30];
        let odd = map(8, 6, |x, y| odd[(x + 3 * y) as usize % odd.len()]);
        let seen = of.registered(&odd, &Geometry::pinhole(8, 6, 8.0));
        assert!(seen.depth_m.iter().all(|z| z.is_finite() && *z >= 0.0), "{:?}", seen.depth_m);
        assert!(enlarged(&odd, 16, 12).depth_m.iter().all(|z| z.is_finite() && *z >= 0.0));
        assert_eq!(enlarged(&map(1, 1, |_, _| 3.0), 2, 2).depth_m, [3.0; 4]);
    }
}
