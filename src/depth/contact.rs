//! What things stand on, where a depth map shows it: as flat as it is.
//!
//! A sensor's error grows with the square of the distance. At 4 m a floor is off by centimetres, more than a cartridge case is
//! high, and pieces of the floor would hide it. So what a map shows within the sensor's error of such a plane is the plane.
//!
//! Of several planes the nearest to what was measured counts, so that their order is nobody's business. They have no ends: what
//! lies level with a table beside it is as flat as the table.
//!
//! Not modelled: pictures that see all around; thin things that lie on the plane, as long as the plane is within the error of
//! them.

use glam::DVec3;

use super::discontinuity::JUMP;
use super::{Rays, SENSOR_ERROR};
use crate::parallel::{over_rows, processors};
use crate::pixels::Rect;
use crate::pose::Pose;

/// What lies this near to a plane is the plane, metres, or three times the sensor's error if that is more.
const WITHIN_M: f32 = 0.015;
const PER_DEPTH2: f32 = 3.0 * SENSOR_ERROR as f32;
/// Never more than this share of the depth: a step that is an edge is none of the sensor's noise.
const MOST_OF_DEPTH: f32 = 0.5 * (JUMP - 1.0);

/// A plane in the world; `normal` has unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    pub point_m: DVec3,
    pub normal: DVec3,
}

/// Makes a part of a map, seen from `pose`, as flat as the planes are that it shows. Row by row, metres, 0 where unknown.
pub fn flatten(depth_m: &mut [f32], rays: &Rays, pose: &Pose, part: Rect, planes: &[Plane]) {
    let seen = part.intersection(&rays.full());
    if planes.is_empty() || seen.is_empty() || rays.geometry().needs_cube_map() {
        return;
    }
    rays.prepare(seen.y0..seen.y1);
    // z of a plane along a ray r with z = 1: c / (n·r), with n in the camera's axes and c the plane's distance along it.
    let in_camera = |plane: &Plane| {
        let point = pose.transform_point(plane.point_m);
        let normal = pose.transform_point(plane.point_m + plane.normal) - point;
        (normal.as_vec3().to_array(), normal.dot(point) as f32)
    };
    let planes: Vec<_> = planes.iter().map(in_camera).collect();
    let width = part.width() as usize;
    let rows = &mut depth_m[(seen.y0 - part.y0) as usize * width..][..seen.height() as usize * width];
    over_rows(rows, width, processors(), |y, row| {
        let Some(rays) = rays.row(seen.y0 as usize + y) else { return };
        let row = &mut row[(seen.x0 - part.x0) as usize..][..seen.width() as usize];
        for (z, ray) in row.iter_mut().zip(&rays[seen.x0 as usize..]).filter(|(z, _)| **z > 0.0) {
            let within_m = WITHIN_M.max(PER_DEPTH2 * *z * *z).min(MOST_OF_DEPTH * *z);
            let (mut off_m, mut on_m) = (within_m, *z);
            for (n, c) in &planes {
                let plane_m = c / (n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2]);
                let plane_off_m = (*z - plane_m).abs();
                if plane_m > 0.0 && (plane_off_m < off_m || (plane_off_m == off_m && plane_m < on_m)) {
                    (off_m, on_m) = (plane_off_m, plane_m);
                }
            }
            *z = on_m;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Geometry;
    use glam::DQuat;

    #[test]
    fn a_noisy_floor_is_flat_and_what_stands_on_it_stays() {
        // The camera stands 1.5 m above a floor and looks down by 0.4 rad.
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
        // Noise of the sensor's σ, twice that at most; things 0.3 m before it.
        let noise = |i: usize, z: f32| 2.0 * ((i * 37 % 101) as f32 / 50.0 - 1.0) * SENSOR_ERROR as f32 * z * z;
        let is_thing = |i: usize| i % width > 40 && i / width > 30;
        let truth = |i: usize| plane_m(i) - if is_thing(i) { 0.3 } else { 0.0 };
        let measured: Vec<f32> =
            (0..width * height).map(|i| if plane_m(i) > 0.0 { truth(i) + noise(i, truth(i)) } else { 9.0 }).collect();
        // A part that hangs over the rim.
        let part = Rect::new(-4, 20, 60, 48);
        let inside = |x: i32, y: i32| (0..64).contains(&x) && part.contains(x, y);
        let at = |x: i32, y: i32| if inside(x, y) { measured[y as usize * width + x as usize] } else { 0.0 };
        let places: Vec<_> = (20..48).flat_map(|y| (-4..60).map(move |x| (x, y))).collect();
        let before: Vec<f32> = places.iter().map(|(x, y)| at(*x, *y)).collect();
        let mut depth_m = before.clone();
        flatten(&mut depth_m, &rays, &pose, part, &[floor]);
        for (((x, y), before), found) in places.iter().zip(&before).zip(&depth_m) {
            let i = *y as usize * width + (*x).max(0) as usize;
            let expected = if inside(*x, *y) && !is_thing(i) { plane_m(i) } else { *before };
            assert!((found - expected).abs() <= 1e-4 * expected, "{x} {y}: {found} is not {expected}");
        }
        assert!(before.iter().zip(&depth_m).any(|(a, b)| (a - b).abs() > 0.02), "the noise was nothing");
    }
}
