//! Surfaces below objects that are not level: the foot of an upright object touches them on one
//! side alone.

use super::Shot;
use crate::scene::{Object, Support};

/// A surface that is level within this is level, degrees; a steeper one is no ground.
const LEVEL_DEG: f64 = 1.0;
const MAX_DEG: f64 = 40.0;
/// Points this near to an object's lowest one are its foot: share of its height, and metres.
const FOOT: f64 = 0.02;
const FOOT_M: f64 = 0.002;
/// A smaller gap is not seen, m.
const MIN_GAP_M: f64 = 0.0005;

/// The tilted surface below an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Index into [`Scene::objects`](crate::scene::Scene::objects).
    pub object: usize,
    pub support: Support,
    /// Of the surface, from level.
    pub degrees: f64,
    /// Between the surface and the far side of an upright foot, m.
    pub gap_m: f64,
}

impl Shot {
    /// The tilted surfaces below the scene's objects, as far as depth or the recording's floor tell
    /// them. The recording's depth is read on first use.
    pub fn tilts(&self) -> Vec<Tilt> {
        let Some(up) = self.up() else { return Vec::new() };
        let of = |(object, placed): (usize, Object)| {
            let support = placed.support.filter(|_| !placed.is_missing && !placed.hidden)?;
            let degrees = support.normal.dot(up).clamp(-1.0, 1.0).acos().to_degrees();
            if !(LEVEL_DEG..MAX_DEG).contains(&degrees) {
                return None;
            }
            let points: Vec<_> = placed.points_m(&self.scene).collect();
            let heights = || points.iter().map(|point| point.dot(up));
            let (low, high) = (heights().reduce(f64::min)?, heights().reduce(f64::max)?);
            let near = FOOT_M.max(FOOT * (high - low));
            let foot = points.iter().filter(|point| point.dot(up) - low <= near);
            let above: Vec<f64> = foot.map(|point| (*point - support.point_m).dot(support.normal)).collect();
            let gap_m = above.iter().copied().reduce(f64::max)? - above.iter().copied().reduce(f64::min)?;
            (gap_m > MIN_GAP_M).then_some(Tilt { object, support, degrees, gap_m })
        };
        self.objects().into_iter().enumerate().filter_map(of).collect()
    }
}
