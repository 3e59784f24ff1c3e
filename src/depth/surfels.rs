//! Depth from the surfaces of the whole recording, where a frame and its neighbours have none.
//!
//! A depth sensor measures only a few pixels of a black screen, and different ones in each frame.
//! All seven frames of a consensus can miss a part of it that earlier ones measured. An analysis
//! fuses the maps of the recording into surfels, oriented discs (Pfister et al. 2000; Keller et al.
//! 2013). This module splats them into the pixels without a consensus. A disc at p with normal n
//! meets a pixel's ray r at the depth d = n·p / n·r, if |d·r − p| is at most its radius. The
//! nearest disc wins.
//!
//! Objects may have moved. The depth of a surfel is used only if the pixel has its colour, after
//! the same gain correction as in the vote.
//!
//! Not modelled: rolling shutter; cameras that see 180° or more.

use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};

use super::requested::{RequestedPixels, color_gain};
use super::vote::TargetView;
use crate::frame::{SURFEL_SPACING_M, Surfel};
use crate::parallel::{over_rows, processors};
use crate::pixels::{Rect, floor};

/// Radius of a disc, m: half of a voxel's diagonal.
const RADIUS_M: f32 = 0.87 * SURFEL_SPACING_M as f32;
/// Smallest distance from the camera of a surfel that is splatted, m.
const MIN_DISTANCE_M: f32 = 0.1;
/// Largest relative difference of the map from a surfel on the same surface.
const DEPTH_TOLERANCE: f32 = 0.03;
/// Smallest cosine between the normal and the direction to the camera.
const MIN_COSINE: f32 = 0.05;
/// Largest distance of a disc's centre from the picture's part, px.
const MAX_OUTSIDE_PX: i32 = 128;

/// Largest distance of a disc's centre outside the frustum, m: its radius, and rounding errors of
/// 32-bit positions.
const FRUSTUM_MARGIN_M: f32 = 1.1 * RADIUS_M;
/// Surfels that a thread works on at a time.
const SURFELS_PER_BLOCK: usize = 1024;

/// A surfel in a camera's view.
#[derive(Clone)]
struct Splat {
    /// Position in the camera's axes, m.
    position_m: Vec3,
    normal: Vec3,
    sqrt_color: [f32; 3],
    center_px: DVec2,
    radius_px: f64,
}

impl TargetView<'_> {
    /// Replaces unknown depths of the part (0) by those of surfels of the pixels' colour.
    pub fn fill_unknown(&self, depth_m: &mut [f32], surfels: &[Surfel]) {
        let unknown = depth_m.iter().zip(self.max_depth_m).map(|(z, max_depth_m)| *z <= 0.0 && *max_depth_m > 0.0);
        let is_unknown: Vec<bool> = unknown.collect();
        let visible = self.part.intersection(&self.rays.full());
        let needs_cube_map = self.rays.geometry().needs_cube_map();
        if surfels.is_empty() || visible.is_empty() || needs_cube_map || !is_unknown.contains(&true) {
            return;
        }
        self.rays.prepare(visible.y0..visible.y1);
        let frustum = self.frustum(visible);
        let is_near = |surfel: &&Surfel| {
            let at_m = surfel.position_m.extend(1.0);
            frustum.iter().all(|side| side.dot(at_m) > -FRUSTUM_MARGIN_M)
        };
        let mut blocks = vec![Vec::new(); surfels.len().div_ceil(SURFELS_PER_BLOCK)];
        over_rows(&mut blocks, 1, processors(), |n, block| {
            let surfels = surfels[n * SURFELS_PER_BLOCK..].iter().take(SURFELS_PER_BLOCK);
            block[0] = surfels.filter(is_near).filter_map(|surfel| self.splat(surfel, visible)).collect();
        });
        let splats: Vec<Splat> = blocks.into_iter().flatten().collect();
        let requested = RequestedPixels::new(&is_unknown, self.sqrt_colors, self.part.width() as usize);
        // Depth and index of the nearest disc at each pixel.
        let mut nearest = vec![(f32::INFINITY, usize::MAX); requested.places.len()];
        for (index, splat) in splats.iter().enumerate() {
            let rect = splat.rect().intersection(&visible);
            if !requested.any_in(rect.moved(-self.part.x0, -self.part.y0)) {
                continue;
            }
            for y in rect.y0..rect.y1 {
                let Some(rays) = self.rays.row(y as usize) else { continue };
                let row = (y - self.part.y0) as usize * self.part.width() as usize;
                for x in rect.x0..rect.x1 {
                    let Some(n) = requested.rank(row + (x - self.part.x0) as usize) else { continue };
                    if let Some(z) = splat.depth_m(Vec3::from(rays[x as usize])).filter(|z| *z < nearest[n].0) {
                        nearest[n] = (z, index);
                    }
                }
            }
        }
        let gain = color_gain(&self.color_pairs(&splats, depth_m));
        for (n, (at, (z, index))) in requested.places.iter().zip(nearest).enumerate() {
            let Some(splat) = splats.get(index) else { continue };
            if requested.has_color_near(n, [0, 1, 2].map(|c| gain[c] * splat.sqrt_color[c])) {
                depth_m[*at as usize] = z;
            }
        }
    }

    /// Side planes of the view frustum of a rectangle: inward unit normal in the world (x, y, z)
    /// and signed distance of the world's origin, m (w).
    fn frustum(&self, rect: Rect) -> [Vec4; 4] {
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for ray in (rect.y0..rect.y1)
            .filter_map(|y| self.rays.row(y as usize))
            .flat_map(|row| &row[rect.x0 as usize..rect.x1 as usize])
        {
            // Rays have z = 1, or NaN. The minimum of NaN and a number is the number.
            low = Vec2::new(low.x.min(ray[0]), low.y.min(ray[1]));
            high = Vec2::new(high.x.max(ray[0]), high.y.max(ray[1]));
        }
        let sides = [
            Vec3::new(1.0, 0.0, -low.x),
            Vec3::new(-1.0, 0.0, high.x),
            Vec3::new(0.0, 1.0, -low.y),
            Vec3::new(0.0, -1.0, high.y),
        ];
        sides.map(|side| {
            let normal = side.normalize().as_dvec3();
            (self.pose.rotation.inverse() * normal).extend(normal.dot(self.pose.translation_m)).as_vec4()
        })
    }

    /// `None` if the surfel's disc does not touch the rectangle, or faces away from the camera.
    fn splat(&self, surfel: &Surfel, rect: Rect) -> Option<Splat> {
        let geometry = self.rays.geometry();
        let in_camera = self.pose.transform_point(surfel.position_m.as_dvec3());
        let (position_m, normal) = (in_camera.as_vec3(), (self.pose.rotation * surfel.normal.as_dvec3()).as_vec3());
        let distance_m = position_m.length();
        if -normal.dot(position_m) < MIN_COSINE * distance_m || distance_m < MIN_DISTANCE_M {
            return None;
        }
        let center_px = geometry.project(in_camera)?;
        let [x, y] = center_px.as_vec2().to_array().map(floor);
        if !rect.grown(MAX_OUTSIDE_PX).contains(x, y) {
            return None;
        }
        // The image of a sphere of the same radius contains that of the disc. Distortion changes
        // little within it.
        let (across, down) = in_camera.normalize().any_orthonormal_pair();
        let rim_px = |by: DVec3| Some((geometry.project(in_camera + f64::from(RADIUS_M) * by)? - center_px).length());
        let radius_px = 1.2 * rim_px(across)?.hypot(rim_px(down)?) + 0.5;
        let splat = Splat { position_m, normal, sqrt_color: surfel.sqrt_color, center_px, radius_px };
        (!splat.rect().intersection(&rect).is_empty()).then_some(splat)
    }

    /// Pairs of the frame's colour and a surfel's, where the depth map agrees with the surfel.
    fn color_pairs(&self, splats: &[Splat], depth_m: &[f32]) -> Vec<([f32; 3], [f32; 3])> {
        let pair = |splat: &Splat| {
            let [x, y] = splat.center_px.as_vec2().to_array().map(floor);
            let row = self.part.contains(x, y).then(|| (y - self.part.y0) as usize * self.part.width() as usize)?;
            let (at, z) = (row + (x - self.part.x0) as usize, splat.position_m.z);
            ((depth_m[at] - z).abs() < DEPTH_TOLERANCE * z).then(|| (self.sqrt_colors[at], splat.sqrt_color))
        };
        splats.iter().filter_map(pair).collect()
    }
}

impl Splat {
    /// The pixels that its disc can touch.
    fn rect(&self) -> Rect {
        let [low, high] = [-self.radius_px, self.radius_px].map(|by| (self.center_px + by).as_vec2());
        Rect::new(floor(low.x), floor(low.y), floor(high.x).saturating_add(1), floor(high.y).saturating_add(1))
    }

    /// Depth along a ray with z = 1, m; `None` if it misses the disc.
    fn depth_m(&self, ray: Vec3) -> Option<f32> {
        let depth_m = self.normal.dot(self.position_m) / self.normal.dot(ray);
        let is_met = depth_m > 0.0 && (depth_m * ray).distance_squared(self.position_m) <= RADIUS_M * RADIUS_M;
        is_met.then_some(depth_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Geometry;
    use crate::depth::Rays;
    use crate::pose::Pose;
    use glam::{DQuat, DVec3};

    const WIDTH: usize = 96;
    const HEIGHT: usize = 64;
    const DARK: f32 = 0.2;
    const BRIGHT: f32 = 0.7;

    /// A dark wall at z = 1 m, 1.2 m wide, that faces the camera.
    fn wall() -> Vec<Surfel> {
        let at = |n: i32| SURFEL_SPACING_M as f32 * n as f32;
        let places = (-30..30).flat_map(|x| (-30..30).map(move |y| Vec3::new(at(x), at(y), 1.0)));
        let surfel = |position_m| Surfel { position_m, normal: Vec3::NEG_Z, sqrt_color: [DARK; 3] };
        places.map(surfel).collect()
    }

    /// A map of the wall with a hole of 20 columns, filled by surfels. The picture is dark in the
    /// left half of the hole and bright in the right half, with all colours scaled by `light`.
    fn filled(surfels: &[Surfel], pose: Pose, light: f32) -> Vec<f32> {
        let column = |i: usize| i % WIDTH;
        let sqrt_colors: Vec<[f32; 3]> = (0..WIDTH * HEIGHT)
            .map(|i| [light * if (50..60).contains(&column(i)) { BRIGHT } else { DARK }; 3])
            .collect();
        let mut depth_m: Vec<f32> =
            (0..WIDTH * HEIGHT).map(|i| if (40..60).contains(&column(i)) { 0.0 } else { 1.0 }).collect();
        let rays = Rays::new(&Geometry::pinhole(WIDTH as u32, HEIGHT as u32, 80.0));
        let part = Rect::full(WIDTH as u32, HEIGHT as u32);
        let max_depth_m = [9.0; WIDTH * HEIGHT];
        TargetView { rays: &rays, pose, part, sqrt_colors: &sqrt_colors, max_depth_m: &max_depth_m }
            .fill_unknown(&mut depth_m, surfels);
        depth_m
    }

    /// Columns of the middle row with known depth.
    fn columns_with_depth(depth_m: &[f32]) -> Vec<usize> {
        (0..WIDTH).filter(|x| depth_m[HEIGHT / 2 * WIDTH + x] > 0.0).collect()
    }

    #[test]
    fn hole_takes_the_depth_of_surfels_of_its_color() {
        let depth_m = filled(&wall(), Pose::IDENTITY, 1.0);
        assert!(depth_m.iter().all(|z| *z == 0.0 || (z - 1.0).abs() < 1e-5));
        // The first and the last pixel of the bright half border on dark ones.
        assert_eq!(columns_with_depth(&depth_m), (0..51).chain(59..WIDTH).collect::<Vec<_>>());
        assert_eq!(columns_with_depth(&filled(&[], Pose::IDENTITY, 1.0)), (0..40).chain(60..WIDTH).collect::<Vec<_>>());
    }

    #[test]
    fn darker_or_brighter_picture_takes_the_same_surfels() {
        let usual = filled(&wall(), Pose::IDENTITY, 1.0);
        for light in [0.7, 1.35] {
            assert_eq!(filled(&wall(), Pose::IDENTITY, light), usual, "{light}");
        }
    }

    #[test]
    fn measured_depth_is_not_replaced() {
        let near: Vec<Surfel> = wall().iter().map(|s| Surfel { position_m: 0.5 * s.position_m, ..*s }).collect();
        let depth_m = filled(&near, Pose::IDENTITY, 1.0);
        assert!(depth_m.iter().enumerate().all(|(i, z)| (40..60).contains(&(i % WIDTH)) || *z == 1.0));
    }

    #[test]
    fn nearest_surfel_wins_and_back_faces_are_skipped() {
        let before = |normal| wall().into_iter().map(move |s| Surfel { position_m: 0.8 * s.position_m, normal, ..s });
        let with = |normal| -> Vec<Surfel> { before(normal).chain(wall()).collect() };
        let middle = HEIGHT / 2 * WIDTH + 45;
        assert!((filled(&with(Vec3::NEG_Z), Pose::IDENTITY, 1.0)[middle] - 0.8).abs() < 1e-5);
        assert!((filled(&with(Vec3::Z), Pose::IDENTITY, 1.0)[middle] - 1.0).abs() < 1e-5);
    }

    #[test]
    fn slanted_wall_has_the_depth_of_its_plane() {
        // Turned by 30 degrees about the vertical through (0, 0, 1): z = 1 + x tan 30°.
        let turn = DQuat::from_rotation_y(-30f64.to_radians());
        let turned = |s: &Surfel| {
            let position_m = (turn * (s.position_m.as_dvec3() - DVec3::Z) + DVec3::Z).as_vec3();
            Surfel { position_m, normal: (turn * s.normal.as_dvec3()).as_vec3(), ..*s }
        };
        let surfels: Vec<Surfel> = wall().iter().map(turned).collect();
        let depth_m = filled(&surfels, Pose::IDENTITY, 1.0);
        for x in 40..50 {
            let ray = (x as f64 + 0.5 - 48.0) / 80.0;
            let expected = 1.0 / (1.0 - ray * 30f64.to_radians().tan());
            let z = f64::from(depth_m[HEIGHT / 2 * WIDTH + x]);
            assert!((z - expected).abs() < 1e-4, "{x}: {z} {expected}");
        }
    }

    #[test]
    fn nearest_surfel_of_another_color_hides_those_behind_it() {
        let bright = |s: &Surfel| Surfel { position_m: 0.8 * s.position_m, sqrt_color: [BRIGHT; 3], ..*s };
        let surfels: Vec<Surfel> =
            wall().iter().chain(&wall().iter().map(bright).collect::<Vec<_>>()).copied().collect();
        let depth_m = filled(&surfels, Pose::IDENTITY, 1.0);
        assert_eq!(columns_with_depth(&depth_m)[..40], (0..40).collect::<Vec<_>>());
        assert_eq!(depth_m[HEIGHT / 2 * WIDTH + 45], 0.0);
    }

    #[test]
    fn surfels_far_outside_the_picture_are_skipped() {
        // Beside the camera, at up to 8e10 px.
        let beside =
            |x: f32| Surfel { position_m: Vec3::new(x, 0.1, 1e-6), normal: Vec3::NEG_X, sqrt_color: [DARK; 3] };
        let surfels: Vec<Surfel> = wall().into_iter().chain([0.2, 1.0, 1e3].map(beside)).collect();
        assert_eq!(filled(&surfels, Pose::IDENTITY, 1.0), filled(&wall(), Pose::IDENTITY, 1.0));
    }

    #[test]
    fn surfels_are_projected_by_the_pose_of_the_camera() {
        let (shift, turn) = (DVec3::new(0.2, -0.1, 0.3), DQuat::from_rotation_y(0.5));
        let moved = |s: &Surfel| Surfel {
            position_m: (turn * s.position_m.as_dvec3() + shift).as_vec3(),
            normal: (turn * s.normal.as_dvec3()).as_vec3(),
            ..*s
        };
        let moved: Vec<Surfel> = wall().iter().map(moved).collect();
        let there = Pose::from_camera_in_world(shift, turn);
        let [here, there] = [(wall(), Pose::IDENTITY), (moved, there)].map(|(s, pose)| filled(&s, pose, 1.0));
        assert!(here.iter().zip(&there).all(|(a, b)| (a - b).abs() < 1e-4));
    }
}
