//! Clips the image of a convex hull to a rectangle: the visible extent of an object beside, around
//! or behind the camera.
//!
//! The hull is clipped at the near plane, where projection is undefined. In front of it, the image
//! of a convex hull is the convex hull of its corners' images, a polygon, which is clipped at the
//! rectangle's sides. Both steps are exact.

use glam::{DVec2, DVec3};

use super::view::NEAR_M;
use crate::fit::convex_hull;

/// A rectangle of normalised coordinates (x/z, y/z).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenExtent {
    pub low: DVec2,
    pub high: DVec2,
}

impl ScreenExtent {
    /// The bounding rectangle of points; `None` if there are none.
    pub fn of(points: impl IntoIterator<Item = DVec2>) -> Option<Self> {
        points.into_iter().fold(None, |all: Option<Self>, p| {
            Some(all.map_or(Self { low: p, high: p }, |e| Self { low: e.low.min(p), high: e.high.max(p) }))
        })
    }

    pub fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

/// The extent within `area` of the visible part of the points' hull (in the camera's axes, metres).
pub fn visible_extent(points: &[DVec3], area: ScreenExtent) -> Option<ScreenExtent> {
    let images = clipped_at_near_plane(points, NEAR_M).iter().map(|p| p.truncate() / p.z).collect();
    let visible = clipped_to(&convex_hull(images), area);
    ScreenExtent::of(visible.into_iter().map(|p| p.clamp(area.low, area.high)))
}

/// Corners of the part of a hull with z of at least `near_m`, and some points inside it: the points
/// in front of that plane, and the intersections of the plane with lines to the others.
pub fn clipped_at_near_plane(points: &[DVec3], near_m: f64) -> Vec<DVec3> {
    let (mut front, back): (Vec<DVec3>, Vec<DVec3>) = points.iter().partition(|p| p.z >= near_m);
    let meets = |f: &DVec3, b: &DVec3| f.lerp(*b, (f.z - near_m) / (f.z - b.z)).with_z(near_m);
    let crossing: Vec<_> = front.iter().flat_map(|f| back.iter().map(move |b| meets(f, b))).collect();
    front.extend(crossing);
    front
}

/// Clips a convex polygon to a rectangle (Sutherland and Hodgman 1974).
fn clipped_to(polygon: &[DVec2], area: ScreenExtent) -> Vec<DVec2> {
    // Signed distance of a point inside each side.
    let sides: [&dyn Fn(DVec2) -> f64; 4] =
        [&|p| p.x - area.low.x, &|p| area.high.x - p.x, &|p| p.y - area.low.y, &|p| area.high.y - p.y];
    sides.iter().fold(polygon.to_vec(), |polygon, inside| {
        let next = polygon.iter().cycle().skip(1);
        let kept = polygon.iter().zip(next).flat_map(|(a, b)| {
            let (from, to) = (inside(*a), inside(*b));
            let crossing = (from < 0.0) != (to < 0.0);
            let meets = crossing.then(|| a.lerp(*b, from / (from - to)));
            (from >= 0.0).then_some(*a).into_iter().chain(meets)
        });
        kept.collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: ScreenExtent = ScreenExtent { low: DVec2::new(-1.0, -0.5), high: DVec2::new(1.0, 0.5) };

    fn extent_of(points: &[[f64; 3]]) -> Option<ScreenExtent> {
        visible_extent(&points.iter().copied().map(DVec3::from).collect::<Vec<_>>(), AREA)
    }

    #[track_caller]
    fn is(extent: Option<ScreenExtent>, low: [f64; 2], high: [f64; 2]) {
        let close = |a: DVec2, b: [f64; 2]| a.distance(b.into()) < 1e-12;
        assert!(
            extent.is_some_and(|e| close(e.low, low) && close(e.high, high)),
            "{extent:?}, by hand {low:?} {high:?}"
        );
    }

    #[test]
    fn visible_extent_matches_hand_calculation() {
        // In front, inside: its own extent. A point, a line.
        is(extent_of(&[[0.0, 0.0, 2.0], [1.0, 0.5, 2.0], [-0.5, 0.25, 1.0]]), [-0.5, 0.0], [0.5, 0.25]);
        is(extent_of(&[[0.5, 0.5, 2.0]]), [0.25, 0.25], [0.25, 0.25]);
        // Over a corner: from (0.75, 0) to (1.25, 0.5) and (0.75, 0.5), cut at x = 1.
        is(extent_of(&[[0.75, 0.0, 1.0], [1.25, 0.5, 1.0], [0.75, 0.5, 1.0]]), [0.75, 0.0], [1.0, 0.5]);
        // Beside the corner, although its extent covers it.
        assert_eq!(extent_of(&[[0.9, 2.0, 1.0], [4.0, 0.4, 1.0], [4.0, 2.0, 1.0]]), None);
        // Behind. Across the near plane, beside the picture. Nothing.
        assert_eq!(extent_of(&[[0.0, 0.0, -1.0], [0.1, 0.0, -1.0], [0.0, 0.1, -2.0]]), None);
        assert_eq!(extent_of(&[[1.0, 0.0, -1.0], [1.0, 0.1, 0.5], [1.2, 0.0, 0.5]]), None);
        assert_eq!(extent_of(&[]), None);
        // From straight ahead through the camera's plane on its right: up to the right side, level.
        is(extent_of(&[[0.0, 0.0, 1.0], [1.0, 0.0, -1.0]]), [0.0, 0.0], [1.0, 0.0]);
        // All around the camera.
        let around: Vec<[f64; 3]> =
            (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|side| f64::from(side) - 0.5)).collect();
        is(extent_of(&around), [-1.0, -0.5], [1.0, 0.5]);
    }
}
