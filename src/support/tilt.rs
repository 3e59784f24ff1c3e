//! Tilted support surfaces: the footprint of an upright object touches them on one side alone.

use glam::DVec3;

use super::footprint::{footprint_height_m, lowest_points};
use crate::plane::Plane;

/// TiltedSupport from which on a surface counts as tilted, degrees.
const MIN_TILT_DEG: f64 = 1.0;
/// Largest tilt of a support, degrees.
const MAX_TILT_DEG: f64 = 40.0;
/// Smallest visible gap, m.
const MIN_GAP_M: f64 = 0.0005;

/// The tilted surface below an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiltedSupport {
    /// Index into [`Scene::objects`](crate::scene::Scene::objects).
    pub object: usize,
    pub support: Plane,
    /// Angle between the surface and the level, degrees.
    pub degrees: f64,
    /// Gap between the surface and the far side of an upright footprint, m.
    pub gap_m: f64,
}

impl TiltedSupport {
    /// The tilt of the support of an object with these points. `None` if the support is level or
    /// too steep, or if the gap is too small to see.
    pub fn of(object: usize, support: Plane, points_m: &[DVec3], up: DVec3) -> Option<Self> {
        let degrees = support.tilt_deg(up);
        if !(MIN_TILT_DEG..MAX_TILT_DEG).contains(&degrees) {
            return None;
        }
        let heights = || points_m.iter().map(|point| point.dot(up));
        let (low, high) = (heights().reduce(f64::min)?, heights().reduce(f64::max)?);
        let foot = lowest_points(points_m, up, footprint_height_m(high - low))?;
        let above: Vec<f64> = foot.iter().map(|point| support.height_m(*point)).collect();
        let gap_m = above.iter().copied().reduce(f64::max)? - above.iter().copied().reduce(f64::min)?;
        (gap_m > MIN_GAP_M).then_some(Self { object, support, degrees, gap_m })
    }
}
