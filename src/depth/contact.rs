//! Snaps depth near a support plane to the plane.
//!
//! A sensor's error grows with the square of the distance. At 4 m a floor is off by centimetres,
//! more than the height of a cartridge case, so that noise of the floor would occlude the case.
//! Depth within the sensor's error of a support plane is therefore set to that of the plane.
//!
//! Of several planes the nearest to the measured depth counts, so that their order has no effect.
//! Planes are unbounded: a surface beside a table at the height of its top is flattened too.
//!
//! Not modelled: 360° pictures; thin objects on the plane, if they are within the sensor's error of
//! it.

use super::discontinuity::DEPTH_STEP;
use super::{Rays, SENSOR_ERROR};
use crate::parallel::{over_rows, processors};
use crate::pixels::Rect;
use crate::plane::Plane;
use crate::pose::Pose;

/// Distance from a plane up to which measured points belong to it, m, at least.
pub const PLANE_TOLERANCE_M: f64 = 0.015;
/// Growth of that distance with depth², 1/m: three times the sensor's error.
pub const PLANE_TOLERANCE_PER_DEPTH2: f32 = 3.0 * SENSOR_ERROR as f32;
/// Height over a plane from which on measured points belong to other objects, m.
pub const MIN_HEIGHT_OVER_PLANE_M: f64 = 2.0 * PLANE_TOLERANCE_M;
/// Largest snapping distance as a fraction of the depth. A depth discontinuity is larger.
const MAX_TOLERANCE_PER_DEPTH: f32 = 0.5 * (DEPTH_STEP - 1.0);

/// Snaps the depth of a part of a map, seen from `pose`, to the planes. `depth_m`: row by row, m; 0
/// where unknown.
pub fn snap_to_planes(depth_m: &mut [f32], rays: &Rays, pose: &Pose, part: Rect, planes: &[Plane]) {
    let visible = part.intersection(&rays.full());
    if planes.is_empty() || visible.is_empty() || rays.geometry().needs_cube_map() {
        return;
    }
    rays.prepare(visible.y0..visible.y1);
    // z of a plane along a ray r with z = 1: c / (n·r), with the normal n in the camera's axes and
    // the plane's distance c along it.
    let in_camera = |plane: &Plane| {
        let point = pose.transform_point(plane.point_m);
        let normal = pose.transform_point(plane.point_m + plane.normal) - point;
        (normal.as_vec3().to_array(), normal.dot(point) as f32)
    };
    let planes: Vec<_> = planes.iter().map(in_camera).collect();
    let width = part.width() as usize;
    let rows = &mut depth_m[(visible.y0 - part.y0) as usize * width..][..visible.height() as usize * width];
    over_rows(rows, width, processors(), |y, row| {
        let Some(rays) = rays.row(visible.y0 as usize + y) else { return };
        let row = &mut row[(visible.x0 - part.x0) as usize..][..visible.width() as usize];
        for (z, ray) in row.iter_mut().zip(&rays[visible.x0 as usize..]).filter(|(z, _)| **z > 0.0) {
            let tolerance_m = PLANE_TOLERANCE_PER_DEPTH2 * *z * *z;
            let tolerance_m = (PLANE_TOLERANCE_M as f32).max(tolerance_m).min(MAX_TOLERANCE_PER_DEPTH * *z);
            let (mut error_m, mut snapped_m) = (tolerance_m, *z);
            for (n, c) in &planes {
                let plane_m = c / (n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2]);
                let plane_error_m = (*z - plane_m).abs();
                if plane_m > 0.0 && (plane_error_m < error_m || (plane_error_m == error_m && plane_m < snapped_m)) {
                    (error_m, snapped_m) = (plane_error_m, plane_m);
                }
            }
            *z = snapped_m;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Geometry;
    use glam::{DQuat, DVec3};

    #[test]
    fn noisy_floor_snaps_to_its_plane_and_objects_on_it_keep_their_depth() {
        // The camera is 1.5 m above a floor and pitched down by 0.4 rad.
        let (width, height) = (64usize, 48usize);
        let rays = Rays::new(&Geometry::pinhole(64, 48, 60.0));
        let pose = Pose::from_camera_in_world(DVec3::new(0.2, -1.5, 0.1), DQuat::from_rotation_x(-0.4));
        let floor = Plane { point_m: DVec3::new(3.0, 0.0, 1.0), normal: DVec3::NEG_Y };
        rays.prepare(0..48);
        let plane_m = |i: usize| {
            let ray = DVec3::from(rays.row(i / width).unwrap()[i % width].map(f64::from));
            let [eye, towards] = [DVec3::ZERO, ray].map(|p| pose.inverse_transform_point(p));
            (-eye.y / (towards - eye).y) as f32
        };
        // Noise of up to twice the sensor's error; an object 0.3 m in front of the floor.
        let noise = |i: usize, z: f32| 2.0 * ((i * 37 % 101) as f32 / 50.0 - 1.0) * SENSOR_ERROR as f32 * z * z;
        let is_object = |i: usize| i % width > 40 && i / width > 30;
        let truth = |i: usize| plane_m(i) - if is_object(i) { 0.3 } else { 0.0 };
        let measured: Vec<f32> =
            (0..width * height).map(|i| if plane_m(i) > 0.0 { truth(i) + noise(i, truth(i)) } else { 9.0 }).collect();
        // A part that extends beyond the picture.
        let part = Rect::new(-4, 20, 60, 48);
        let is_inside = |x: i32, y: i32| (0..64).contains(&x) && part.contains(x, y);
        let at = |x: i32, y: i32| if is_inside(x, y) { measured[y as usize * width + x as usize] } else { 0.0 };
        let places: Vec<_> = (20..48).flat_map(|y| (-4..60).map(move |x| (x, y))).collect();
        let before: Vec<f32> = places.iter().map(|(x, y)| at(*x, *y)).collect();
        let mut depth_m = before.clone();
        snap_to_planes(&mut depth_m, &rays, &pose, part, &[floor]);
        for (((x, y), before), actual_m) in places.iter().zip(&before).zip(&depth_m) {
            let i = *y as usize * width + (*x).max(0) as usize;
            let expected = if is_inside(*x, *y) && !is_object(i) { plane_m(i) } else { *before };
            assert!((actual_m - expected).abs() <= 1e-4 * expected, "{x} {y}: {actual_m} is not {expected}");
        }
        assert!(before.iter().zip(&depth_m).any(|(a, b)| (a - b).abs() > 0.02), "the noise was nothing");
    }
}
