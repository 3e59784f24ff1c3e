//! The look of a scan: a light at the camera by the surface's normals, and darker pixels behind the
//! edges of nearer surfaces, in the manner of eye-dome lighting (Boucheny 2009):
//!
//! > s = (a + (1 − a)·|n·v|) · exp(−k·Σ min(max(0, ln z − ln zᵢ), m))
//!
//! with the normal n by differences of depth, the view direction v, the depth z and those zᵢ of
//! eight neighbours.

use eframe::egui::{Color32, ColorImage};
use glam::{DVec2, Vec3};

use locard_engine::camera::Geometry;
use locard_engine::parallel::{over_rows, processors};
use locard_engine::pixels::DepthMap;

/// Shade of a surface seen at a grazing angle.
const AMBIENT: f32 = 0.3;
/// Weight of the darkening behind edges, and its limit for each neighbour.
const EDGE_GAIN: f32 = 4.0;
const MAX_EDGE: f32 = 0.1;
/// Distance of the compared neighbours, px.
const NEIGHBOUR_PX: isize = 2;
/// Largest relative difference of depths of one surface.
const SAME_SURFACE: f32 = 0.05;
/// Colour of a surface that faces the camera.
const COLOR: [f32; 3] = [226.0, 220.0, 208.0];
/// Colour without a surface.
pub const BACKGROUND: Color32 = Color32::from_rgb(24, 26, 30);

/// A shaded picture of a view's depth.
pub fn shaded(camera: &Geometry, map: &DepthMap) -> ColorImage {
    let (width, height) = (map.width as usize, map.height as usize);
    let ray = |x: usize, y: usize| {
        let at_px = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        camera.depth_ray(at_px).map_or(Vec3::Z, |ray| ray.as_vec3())
    };
    let depth = |x: usize, y: usize, dx: isize, dy: isize| {
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        let z = *map.depth_m.get(y * width + x)?;
        (x < width && z > 0.0).then_some((x, y, z))
    };
    let mut pixels = vec![BACKGROUND; width * height];
    over_rows(&mut pixels, width, processors(), |y, row| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let Some((_, _, z)) = depth(x, y, 0, 0) else { continue };
            let point = z * ray(x, y);
            // The difference to the neighbour of nearer depth: the other may be beyond an edge.
            let difference = |dx: isize, dy: isize| {
                let sides = [1, -1].map(|side| (side, depth(x, y, side * dx, side * dy)));
                let sides = sides.into_iter().filter_map(|(side, at)| Some((side, at?)));
                let (side, (nx, ny, nz)) =
                    sides.min_by(|(_, a), (_, b)| (a.2 - z).abs().total_cmp(&(b.2 - z).abs()))?;
                let is_same = (nz - z).abs() < SAME_SURFACE * z;
                is_same.then(|| side as f32 * (nz * ray(nx, ny) - point))
            };
            let normal = difference(NEIGHBOUR_PX, 0).zip(difference(0, NEIGHBOUR_PX)).map(|(a, b)| a.cross(b));
            let facing = normal.map_or(0.5, |n| (n.normalize_or_zero().dot(point.normalize_or_zero())).abs());
            let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
            let edges = around.iter().filter_map(|(dx, dy)| depth(x, y, NEIGHBOUR_PX * dx, NEIGHBOUR_PX * dy));
            let edge: f32 = edges.map(|(_, _, nz)| (z / nz).ln().clamp(0.0, MAX_EDGE)).sum();
            let shade = (AMBIENT + (1.0 - AMBIENT) * facing) * (-EDGE_GAIN * edge).exp();
            let [r, g, b] = COLOR.map(|channel| (shade * channel).round() as u8);
            *pixel = Color32::from_rgb(r, g, b);
        }
    });
    ColorImage::new([width, height], pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_are_lit_by_their_normals_and_dark_behind_edges() {
        let camera = Geometry::pinhole(60, 20, 50.0);
        // A wall that faces the camera at the left, a sloped one at the right, and nothing below.
        let depth = |x: u32, y: u32| match (x, y) {
            (_, 18..) => 0.0,
            (0..30, _) => 1.0,
            _ => 2.0 / (1.0 - 0.01 * (x as f32 - 30.0)),
        };
        let depth_m = (0..20).flat_map(|y| (0..60).map(move |x| depth(x, y))).collect();
        let picture = shaded(&camera, &DepthMap { width: 60, height: 20, depth_m, timestamp_s: 0.0 });
        let at = |x: usize| picture.pixels[8 * 60 + x].r();
        assert!(at(15) > 200 && (80..190).contains(&at(45)), "{} {}", at(15), at(45));
        assert!(at(31) < at(36) - 20 && at(28) > 200, "{} {} {}", at(28), at(31), at(36));
        assert_eq!(picture.pixels[19 * 60 + 5], BACKGROUND);
    }
}
