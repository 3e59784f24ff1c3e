//! Bounds of the objects in 360° and wide fisheye pictures (170° and more).
//!
//! A box's outline consists of edges, so points along them bound its image, unless it contains a
//! pole of the picture (straight up or down in a 360° picture, straight back in a fisheye's). In a
//! 360° picture columns continue beyond the borders: an object across the seam has one rectangle,
//! which extends beyond the right border.

use glam::{DVec2, DVec3};

use super::bounds::{Bounds, Footprint, rotation_speed_px_per_s};
use super::view::{NEAR_M, Shutter, ViewKeys};
use crate::camera::Geometry;
use crate::pixels::Rect;
use crate::scene::Scene;

/// Sample points along each edge of a box.
const POINTS_PER_EDGE: u32 = 16;

/// Maximum reported speed, px/s. Near the poles of a 360° picture speeds are unbounded and motion
/// is not straight. Blur is limited to an eighth of the picture's width per exposure.
pub fn max_speed_px_per_s(geometry: &Geometry, shutter: Shutter) -> f64 {
    f64::from(geometry.intrinsics.width_px) / 8.0 / (2.0 * shutter.velocity_step_s())
}

/// Image bounds of a box.
struct BoxExtent {
    /// May lie beyond the picture if the box extends over a border.
    low: DVec2,
    high: DVec2,
    max_speed_px_per_s: f64,
}

/// Points along a box's edges, corners included, in the same order for each box.
fn along_edges(corners: &[DVec3; 8]) -> impl Iterator<Item = DVec3> {
    (0..8usize).flat_map(move |a| {
        (0..3).filter(move |bit| a >> bit & 1 == 0).flat_map(move |bit| {
            let (from, to) = (corners[a], corners[a | 1 << bit]);
            (0..=POINTS_PER_EDGE).map(move |n| from.lerp(to, f64::from(n) / f64::from(POINTS_PER_EDGE)))
        })
    })
}

/// Bounds of a box (corners in the camera's axes) at moments `dt_s` apart. `None` if unbounded.
fn box_extent(geometry: &Geometry, moments: &[[DVec3; 8]], dt_s: f64) -> Option<BoxExtent> {
    let poles: &[DVec3] = if geometry.is_equirectangular() { &[DVec3::Y, DVec3::NEG_Y] } else { &[DVec3::NEG_Z] };
    for corners in moments {
        let centre = 0.5 * (corners[0] + corners[7]);
        let radius = centre.distance(corners[0]) + NEAR_M;
        let free = |pole: DVec3| centre.angle_between(pole) > (radius / centre.length()).asin();
        if centre.length() <= radius || !poles.iter().all(|pole| free(*pole)) {
            return None;
        }
    }
    let middle = moments.get(moments.len() / 2)?;
    let start = geometry.project_extended_px(0.5 * (middle[0] + middle[7]));
    let places = moments.iter().map(|corners| {
        let mut last = None;
        along_edges(corners)
            .map(|p| {
                let at = start + geometry.displacement_px(start, geometry.project_extended_px(p));
                // An edge is curved between two points: it deviates by at most half their distance
                // to each side.
                let step = last.replace(at).map_or(0.0, |last: DVec2| last.distance(at));
                (at, step)
            })
            .collect::<Vec<_>>()
    });
    let places: Vec<_> = places.collect();
    let (mut low, mut high, mut max_speed_px_per_s) = (DVec2::INFINITY, DVec2::NEG_INFINITY, 0.0f64);
    for moment in &places {
        for (n, (at, step)) in moment.iter().enumerate() {
            let around = if (n as u32).is_multiple_of(POINTS_PER_EDGE + 1) { 0.0 } else { 0.5 * step };
            (low, high) = (low.min(*at - around), high.max(*at + around));
        }
    }
    for pair in places.windows(2) {
        for ((a, _), (b, _)) in pair[0].iter().zip(&pair[1]) {
            max_speed_px_per_s = max_speed_px_per_s.max(a.distance(*b) / dt_s);
        }
    }
    Some(BoxExtent { low: low - 1.0, high: high + 1.0, max_speed_px_per_s })
}

/// The footprint of all parts.
pub fn footprint_around(
    scene: &Scene,
    bounds: &[Option<Bounds>],
    geometry: &Geometry,
    keys: &ViewKeys,
    shutter: Shutter,
) -> Footprint {
    let i = &geometry.intrinsics;
    let (width, height) = (f64::from(i.width_px), f64::from(i.height_px));
    let max_px_per_s = max_speed_px_per_s(geometry, shutter);
    let (moments, step_s) = keys.sampled();
    let (mut nearest, mut farthest, mut max_speed_px_per_s) = (f64::INFINITY, NEAR_M, 0.0f64);
    let mut anywhere = false;
    let mut all: Vec<BoxExtent> = Vec::new();
    for part in scene.objects.iter().flat_map(|o| &o.parts) {
        let Some(b) = bounds[part.mesh] else { continue };
        let corners = b.corners().map(|c| part.world_from_mesh.transform_point3(c));
        let in_camera: Vec<_> = moments.iter().map(|pose| corners.map(|c| pose.transform_point(c))).collect();
        for corners in &in_camera {
            let (centre, radius) = (0.5 * (corners[0] + corners[7]), 0.5 * corners[0].distance(corners[7]));
            nearest = nearest.min((centre.length() - radius).max(NEAR_M));
            farthest = farthest.max(centre.length() + radius);
        }
        match box_extent(geometry, &in_camera, step_s) {
            Some(box_extent) => {
                max_speed_px_per_s = max_speed_px_per_s.max(box_extent.max_speed_px_per_s);
                all.push(box_extent);
            }
            None => {
                anywhere = true;
                let resting = keys.poses.iter().all(|pose| *pose == keys.middle());
                if resting {
                    continue;
                }
                max_speed_px_per_s = max_speed_px_per_s.max(if geometry.is_equirectangular() {
                    max_px_per_s
                } else {
                    rotation_speed_px_per_s(geometry, keys)
                });
            }
        }
    }
    let (mut low, mut high) =
        all.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), s| (l.min(s.low), h.max(s.high)));
    if geometry.is_equirectangular() && !all.is_empty() {
        (low.x, high.x) = shortest_arc(all.iter().map(|s| (s.low.x, s.high.x)), width);
    }
    if anywhere {
        // The whole picture, and beyond its borders.
        let over = if geometry.is_equirectangular() { DVec2::new(0.5 * width, height) } else { DVec2::splat(64.0) };
        (low, high) = (-over, DVec2::new(width, height) + over);
    }
    let rect = if low.x <= high.x {
        let whole = |v: DVec2| v.clamp(DVec2::splat(-1e6), DVec2::splat(1e6));
        let (low, high) = (whole(low).floor(), whole(high).ceil());
        Rect::new(low.x as i32, low.y as i32, high.x as i32, high.y as i32)
    } else {
        Rect::new(0, 0, 0, 0)
    };
    let parts = if rect.is_empty() { Vec::new() } else { vec![(rect, farthest)] };
    let depths_m = [nearest.min(farthest), farthest];
    Footprint { rect, fastest_px_per_s: (1.1 * max_speed_px_per_s).min(max_px_per_s) as f32, depths_m, parts }
}

/// The shortest arc of a circle of this length that contains all the given arcs. It starts on the
/// first turn.
fn shortest_arc(stretches: impl Iterator<Item = (f64, f64)>, length: f64) -> (f64, f64) {
    let mut arcs: Vec<(f64, f64)> = stretches
        .map(|(low, high)| {
            let turns = (low / length).floor() * length;
            (low - turns, high - turns)
        })
        .collect();
    arcs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let reached: Vec<f64> = arcs
        .iter()
        .scan(f64::NEG_INFINITY, |reached, arc| {
            *reached = reached.max(arc.1);
            Some(*reached)
        })
        .collect();
    let (Some(first), Some(last)) = (arcs.first(), reached.last()) else { return (0.0, 0.0) };
    // The widest gap, starting with the one across the seam.
    let mut best = (first.0 + length - last, first.0, *last);
    for n in 1..arcs.len() {
        let gap = arcs[n].0 - reached[n - 1].max(last - length);
        if gap > best.0 {
            best = (gap, arcs[n].0, reached[n - 1].max(last - length) + length);
        }
    }
    (best.1, best.2.max(*last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shortest_arc_matches_hand_calculation() {
        let arc = |list: &[(f64, f64)]| shortest_arc(list.iter().copied(), 100.0);
        assert_eq!(arc(&[(10.0, 20.0), (40.0, 45.0)]), (10.0, 45.0));
        // Shorter across the seam: from 90 to 12 on the next turn.
        assert_eq!(arc(&[(5.0, 12.0), (90.0, 97.0)]), (90.0, 112.0));
        assert_eq!(arc(&[(-8.0, 3.0), (30.0, 35.0)]), (92.0, 135.0));
        assert_eq!(arc(&[(95.0, 106.0)]), (95.0, 106.0));
        // One contains another; one extends over the seam into the next.
        assert_eq!(arc(&[(10.0, 60.0), (20.0, 30.0), (95.0, 115.0)]), (95.0, 160.0));
        assert_eq!(arc(&[(0.0, 40.0), (35.0, 90.0)]), (0.0, 90.0));
    }
}
