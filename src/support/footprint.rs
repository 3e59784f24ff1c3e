//! Footprint of an object: its lowest points.

use glam::DVec3;

use crate::scene::{Object, Scene};

/// Height of a footprint above the lowest point: share of the object's size, and at least, m.
const FOOTPRINT_SHARE: f64 = 0.02;
const MIN_FOOTPRINT_M: f64 = 0.002;
/// Directions in which a footprint's outline is sampled.
const DIRECTIONS: usize = 8;

/// Height of the footprint of an object of a size, m.
pub fn footprint_height_m(size_m: f64) -> f64 {
    (FOOTPRINT_SHARE * size_m).max(MIN_FOOTPRINT_M)
}

/// The points at most `height_m` above the lowest one. `None` without points.
pub fn lowest_points(points_m: &[DVec3], up: DVec3, height_m: f64) -> Option<Vec<DVec3>> {
    let lowest = points_m.iter().map(|p| p.dot(up)).reduce(f64::min)?;
    Some(points_m.iter().copied().filter(|p| p.dot(up) - lowest <= height_m).collect())
}

/// Minimum and maximum of points along the world's axes; infinite without points.
pub fn bounds(points_m: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points_m.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

/// Samples of an object's footprint: along its outline, inside it, and its middle, which is last.
#[derive(Clone, Debug)]
pub struct FootprintSamples {
    pub points_m: Vec<DVec3>,
    /// The object's largest extent along the world's axes.
    pub size_m: f64,
}

impl FootprintSamples {
    /// `None` if the object has no points.
    pub fn of(scene: &Scene, object: &Object, up: DVec3) -> Option<Self> {
        let points: Vec<DVec3> = object.points_m(scene).collect();
        let (low, high) = bounds(points.iter().copied());
        let size_m = (high - low).max_element();
        let standing = lowest_points(&points, up, FOOTPRINT_SHARE * size_m)?;
        let (x, y) = up.any_orthonormal_pair();
        let outermost = (0..DIRECTIONS).filter_map(|n| {
            let (s, c) = (std::f64::consts::TAU * n as f64 / DIRECTIONS as f64).sin_cos();
            let towards = c * x + s * y;
            standing.iter().copied().max_by(|a, b| a.dot(towards).total_cmp(&b.dot(towards)))
        });
        let mut points_m: Vec<DVec3> = outermost.collect();
        let middle = points_m.iter().sum::<DVec3>() / points_m.len() as f64;
        points_m.extend(points_m.clone().iter().map(|point| 0.5 * (*point + middle)));
        points_m.push(middle);
        Some(Self { points_m, size_m })
    }
}
