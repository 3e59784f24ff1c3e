//! Planes in measured points of the room (RANSAC, Fischler and Bolles 1981, then least squares).

use glam::DVec3;

use super::plane_fit::plane_through;
use crate::depth::SENSOR_ERROR;
use crate::plane::{HessePlane, Plane};

/// RANSAC iterations.
const ITERATIONS: usize = 240;
/// Least-squares fits to the inliers of the one before.
const REFITS: usize = 3;
/// Smallest number of a plane's points.
const MIN_POINTS: usize = 40;
/// Largest number of points by which hypotheses are scored; the best one is then fitted to all
/// points.
const MAX_SCORED_POINTS: usize = 2048;
/// Inlier distance: constant part, m, and its growth with depth², 1/m (twice a structured-light
/// sensor's error).
const INLIER_M: f64 = 0.004;
const INLIER_PER_DEPTH2: f64 = 2.0 * SENSOR_ERROR;

/// A measured point.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredPoint {
    pub at_m: DVec3,
    /// Tolerance of its position, m.
    pub tolerance_m: f64,
    /// Position of the camera that measured it.
    pub camera_m: DVec3,
}

impl MeasuredPoint {
    /// `depth_m`: its depth in that camera.
    pub fn new(at_m: DVec3, depth_m: f64, camera_m: DVec3) -> Self {
        Self { at_m, tolerance_m: Self::tolerance_m(depth_m), camera_m }
    }

    /// Tolerance of the position of a point at a depth, m.
    pub fn tolerance_m(depth_m: f64) -> f64 {
        INLIER_M + INLIER_PER_DEPTH2 * depth_m * depth_m
    }

    pub fn is_inlier(&self, plane: &HessePlane) -> bool {
        plane.height_m(self.at_m).abs() < self.tolerance_m
    }
}

/// The plane with most inliers, among those with an accepted normal. `accepts` must not depend on
/// the normal's sign.
pub fn ransac_plane(points: &[MeasuredPoint], accepts: impl Fn(DVec3) -> bool) -> Option<HessePlane> {
    if points.len() < MIN_POINTS {
        return None;
    }
    let sample = |n: usize| [0, 1, 2].map(|k| points[random_index(3 * n + k, points.len())].at_m);
    let mut plane = best_hypothesis(points, (0..ITERATIONS).map(sample), &accepts, MIN_POINTS)?;
    for _ in 0..REFITS {
        let members: Vec<DVec3> = points.iter().filter(|p| p.is_inlier(&plane)).map(|p| p.at_m).collect();
        plane = plane_through(&members).ok()?.plane.facing(plane.normal);
    }
    Some(plane).filter(|plane| accepts(plane.normal))
}

/// The plane with most inliers among those through three sampled points. `min_points`: smallest
/// number of inliers, approximately, because only some of the points are scored.
pub fn best_hypothesis(
    points: &[MeasuredPoint],
    samples: impl Iterator<Item = [DVec3; 3]>,
    accepts: impl Fn(DVec3) -> bool,
    min_points: usize,
) -> Option<HessePlane> {
    let step = points.len().div_ceil(MAX_SCORED_POINTS).max(1);
    let scored: Vec<MeasuredPoint> = points.iter().step_by(step).copied().collect();
    let min_count = min_points.checked_sub(1).map_or(0, |n| n.div_ceil(step) + 1);
    let mut best: Option<(usize, HessePlane)> = None;
    for [a, b, c] in samples {
        let Some(normal) = (b - a).cross(c - a).try_normalize().filter(|normal| accepts(*normal)) else { continue };
        let plane = HessePlane::from(Plane { point_m: a, normal });
        let count = scored.iter().filter(|point| point.is_inlier(&plane)).count();
        if best.map_or(count >= min_count, |(max_count, _)| count > max_count) {
            best = Some((count, plane));
        }
    }
    best.map(|(_, plane)| plane)
}

/// Reproducible pseudo-random index into a list (Wang's hash).
pub fn random_index(n: usize, among: usize) -> usize {
    let mut x = n as u32;
    x = (x ^ 61) ^ (x >> 16);
    x = x.wrapping_mul(9);
    x = (x ^ (x >> 4)).wrapping_mul(0x27d4_eb2d);
    x ^= x >> 15;
    x as usize % among
}
