//! Planes among points of the room that were measured (RANSAC, Fischler and Bolles 1981, then least squares).

use glam::DVec3;

use super::points::{FittedPlane, plane_through};
use crate::depth::SENSOR_ERROR;

/// Planes that are tried, and the fewest points of one.
const TRIES: usize = 240;
const FEWEST: usize = 40;
/// Tried planes are compared by so many points; the best is then fitted to all.
const COMPARED: usize = 2048;
/// Points this near are on a plane: metres, and times z² (twice a structured-light sensor's error).
const ON_M: f64 = 0.004;
const ON_PER_DEPTH2: f64 = 2.0 * SENSOR_ERROR;

/// A measured point.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub at_m: DVec3,
    /// How far it may be off, metres.
    pub off_m: f64,
    /// Where the camera stood that saw it.
    pub eye_m: DVec3,
}

impl Point {
    /// `depth_m`: how deep the camera saw it.
    pub fn new(at_m: DVec3, depth_m: f64, eye_m: DVec3) -> Self {
        Self { at_m, off_m: ON_M + ON_PER_DEPTH2 * depth_m * depth_m, eye_m }
    }

    pub fn is_on(&self, normal: DVec3, d_m: f64) -> bool {
        (normal.dot(self.at_m) - d_m).abs() < self.off_m
    }
}

/// The plane that most points agree on, of those with a normal that is accepted to either side.
pub fn agreed(points: &[Point], accepts: impl Fn(DVec3) -> bool) -> Option<FittedPlane> {
    if points.len() < FEWEST {
        return None;
    }
    let step = points.len().div_ceil(COMPARED);
    let compared: Vec<Point> = points.iter().step_by(step).copied().collect();
    let (mut best, mut most) = (None, (FEWEST - 1).div_ceil(step));
    for n in 0..TRIES {
        let [a, b, c] = [0, 1, 2].map(|k| points[pick(3 * n + k, points.len())].at_m);
        let Some(normal) = (b - a).cross(c - a).try_normalize().filter(|normal| accepts(*normal)) else { continue };
        let count = compared.iter().filter(|point| point.is_on(normal, normal.dot(a))).count();
        if count > most {
            (best, most) = (Some((normal, normal.dot(a))), count);
        }
    }
    let (mut normal, mut d_m) = best?;
    let mut found = None;
    for _ in 0..3 {
        let members: Vec<DVec3> = points.iter().filter(|p| p.is_on(normal, d_m)).map(|p| p.at_m).collect();
        let plane = plane_through(&members).ok()?.facing(normal);
        (normal, d_m, found) = (plane.normal, plane.d_m, Some(plane));
    }
    found.filter(|plane| accepts(plane.normal))
}

/// Numbers that are spread over a list, the same in every run (a hash of Wang's).
pub fn pick(n: usize, among: usize) -> usize {
    let mut x = n as u32;
    x = (x ^ 61) ^ (x >> 16);
    x = x.wrapping_mul(9);
    x = (x ^ (x >> 4)).wrapping_mul(0x27d4_eb2d);
    x ^= x >> 15;
    x as usize % among
}
