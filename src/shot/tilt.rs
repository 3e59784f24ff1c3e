//! Tilted support surfaces: the footprint of an upright object touches them on one side alone.

use super::Shot;
use crate::plane::Plane;
use crate::scene::Object;

/// Tilt from which on a surface counts as tilted, degrees.
const MIN_TILT_DEG: f64 = 1.0;
/// Largest tilt of a support, degrees.
const MAX_TILT_DEG: f64 = 40.0;
/// Height of the footprint above an object's lowest point: share of its height, and at least, m.
const FOOTPRINT_SHARE: f64 = 0.02;
const MIN_FOOTPRINT_M: f64 = 0.002;
/// Smallest visible gap, m.
const MIN_GAP_M: f64 = 0.0005;

/// The tilted surface below an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Index into [`Scene::objects`](crate::scene::Scene::objects).
    pub object: usize,
    pub support: Plane,
    /// Angle between the surface and the level, degrees.
    pub degrees: f64,
    /// Gap between the surface and the far side of an upright footprint, m.
    pub gap_m: f64,
}

impl Shot {
    /// The tilted surfaces below the scene's objects, by depth or the recording's floor. Reads the
    /// recording's depth on first use.
    pub fn tilts(&self) -> Vec<Tilt> {
        let Some(up) = self.up() else { return Vec::new() };
        let of = |(object, placed): (usize, Object)| {
            let support = placed.support.filter(|_| !placed.is_missing && !placed.hidden)?;
            let degrees = support.tilt_deg(up);
            if !(MIN_TILT_DEG..MAX_TILT_DEG).contains(&degrees) {
                return None;
            }
            let points: Vec<_> = placed.points_m(&self.scene).collect();
            let heights = || points.iter().map(|point| point.dot(up));
            let (low, high) = (heights().reduce(f64::min)?, heights().reduce(f64::max)?);
            let near = MIN_FOOTPRINT_M.max(FOOTPRINT_SHARE * (high - low));
            let foot = points.iter().filter(|point| point.dot(up) - low <= near);
            let above: Vec<f64> = foot.map(|point| support.height_m(*point)).collect();
            let gap_m = above.iter().copied().reduce(f64::max)? - above.iter().copied().reduce(f64::min)?;
            (gap_m > MIN_GAP_M).then_some(Tilt { object, support, degrees, gap_m })
        };
        self.objects().into_iter().enumerate().filter_map(of).collect()
    }
}
