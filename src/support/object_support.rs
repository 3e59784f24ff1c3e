//! The support plane of an object: the real surface below it, which receives its shadow.
//!
//! It is fitted to the measured points around the object's footprint (RANSAC, then least squares),
//! or is the dominant plane of the room that explains them as well. It is the same for all frames,
//! so that nothing flickers. An object within `SNAP_M` of it stands on it: a gap of the sensor's
//! error would be visible as a line of light.
//!
//! Without depth, it is the recording's floor, or else the level plane through the object's lowest
//! point.

use std::ops::Range;

use glam::DVec3;

use super::footprint::{bounds, footprint_height_m, lowest_points};
use super::plane_fit::rounded_normal;
use super::ransac::{MeasuredPoint, ransac_plane};
use super::report::PlaneSource;
use super::room_points::RoomPoints;
use crate::depth::PLANE_TOLERANCE_M;
use crate::plane::{HessePlane, Plane};
use crate::scene::{MIN_SUPPORT_COSINE, Object, Scene};

/// Radius of the points around a footprint, as a multiple of its radius, with its limits.
const SEARCH_PER_RADIUS: f64 = 1.5;
const MIN_SEARCH_M: f64 = 0.08;
const MAX_SEARCH_M: f64 = 0.4;
/// Largest distance of a supporting surface above or below the footprint, m. Over a lower surface,
/// down to `MAX_DROP_M`, the object floats.
const MAX_CONTACT_M: f64 = 0.06;
const MAX_DROP_M: f64 = 1.0;
/// Largest gap at which an object stands on the surface, m.
const SNAP_M: f64 = PLANE_TOLERANCE_M;

/// The support plane of an object, and its source. `floor`: that of the recording.
pub fn object_support(
    scene: &Scene,
    object: &Object,
    up: DVec3,
    floor: Option<HessePlane>,
    measured: &RoomPoints,
) -> Option<(Plane, PlaneSource)> {
    let foot = ObjectFootprint::of(scene, object, up)?;
    let measured = foot.support(measured).map(|plane| (plane, PlaneSource::Depth));
    let plane_with_source = measured.or_else(|| {
        let is_near = |plane: &HessePlane| foot.height_m(plane).abs() < MAX_DROP_M;
        floor.filter(is_near).map(|plane| (plane, PlaneSource::Recording))
    });
    Some(match plane_with_source {
        Some((plane, known_by)) => (foot.on(&plane.facing(up)), known_by),
        None => (Plane { point_m: foot.lowest(up), normal: up }, PlaneSource::Foot),
    })
}

/// Height of an object's lowest point over the plane of the points vertically below it, m.
pub fn height_over_points_m(scene: &Scene, object: &Object, up: DVec3, points: Vec<MeasuredPoint>) -> Option<f64> {
    let foot = ObjectFootprint::of(scene, object, up)?;
    foot.support(&RoomPoints { points, ..RoomPoints::default() }).map(|plane| foot.height_m(&plane))
}

/// The lowest points of an object.
struct ObjectFootprint {
    points: Vec<DVec3>,
    middle: DVec3,
    /// Distance from the middle to the outermost point.
    radius_m: f64,
    up: DVec3,
}

impl ObjectFootprint {
    fn of(scene: &Scene, object: &Object, up: DVec3) -> Option<Self> {
        let all: Vec<DVec3> = object.points_m(scene).collect();
        let (low, high) = bounds(all.iter().copied());
        let points = lowest_points(&all, up, footprint_height_m((high - low).max_element()))?;
        let (low, high) = bounds(points.iter().copied());
        let middle = 0.5 * (low + high);
        let radius_m = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        middle.is_finite().then_some(Self { points, middle, radius_m, up })
    }

    fn lowest(&self, up: DVec3) -> DVec3 {
        let height = |p: &DVec3| p.dot(up);
        let lowest = self.points.iter().map(height).fold(f64::INFINITY, f64::min);
        self.middle + (lowest - height(&self.middle)) * up
    }

    /// Height of its lowest point over a plane, m.
    fn height_m(&self, plane: &HessePlane) -> f64 {
        let plane = plane.facing(self.up);
        self.points.iter().map(|p| plane.height_m(*p)).fold(f64::INFINITY, f64::min)
    }

    /// The plane with a rounded normal, moved to the lowest point if that is within `SNAP_M`.
    fn on(&self, plane: &HessePlane) -> Plane {
        let off = plane.height_m(self.middle);
        let normal = rounded_normal(plane.normal).unwrap_or(plane.normal);
        // Rotated about the point below the footprint.
        let plane = HessePlane { normal, offset_m: normal.dot(self.middle) - off };
        let height_m = self.height_m(&plane);
        let moved_m = if height_m.abs() <= SNAP_M { height_m } else { 0.0 };
        Plane { point_m: self.middle + (moved_m - off) * plane.normal, normal: plane.normal }
    }

    /// The plane of the points around that supports it: one in contact, or else one below that it
    /// floats over.
    fn support(&self, measured: &RoomPoints) -> Option<HessePlane> {
        self.support_within(measured, -MAX_CONTACT_M..MAX_CONTACT_M)
            .or_else(|| self.support_within(measured, -MAX_DROP_M..-MAX_CONTACT_M))
    }

    /// The plane with most inliers among the points around, in a range of heights over the
    /// footprint, m.
    fn support_within(&self, measured: &RoomPoints, heights_m: Range<f64>) -> Option<HessePlane> {
        let around_m = (SEARCH_PER_RADIUS * self.radius_m).clamp(MIN_SEARCH_M, MAX_SEARCH_M);
        let foot = self.lowest(self.up);
        let near: Vec<MeasuredPoint> = measured
            .points
            .iter()
            .filter(|point| {
                let (off, height) = (point.at_m - foot, (point.at_m - foot).dot(self.up));
                heights_m.contains(&height) && (off - height * self.up).length() < around_m
            })
            .copied()
            .collect();
        let plane = ransac_plane(&near, |normal| normal.dot(self.up).abs() >= MIN_SUPPORT_COSINE)?.facing(self.up);
        let below_foot_m = foot - plane.height_m(foot) / plane.normal.dot(self.up) * self.up;
        let is_ground = |normal: DVec3| normal.dot(self.up).abs() >= MIN_SUPPORT_COSINE;
        Some(measured.planes.or_dominant(plane, below_foot_m, &near, is_ground).facing(self.up))
    }
}

#[cfg(test)]
mod tests {
    use super::super::ransac::random_index;
    use super::*;
    use glam::DVec2;

    fn foot(height_m: f64) -> ObjectFootprint {
        let corner = |x: f64, y: f64| DVec3::new(x, y, height_m);
        let points = vec![corner(-0.05, -0.05), corner(0.05, -0.05), corner(0.05, 0.05), corner(-0.05, 0.05)];
        ObjectFootprint { points, middle: DVec3::new(0.0, 0.0, height_m), radius_m: 0.07, up: DVec3::Z }
    }

    /// A table at height 0 with a box on it, and noise of 2 mm.
    fn room() -> Vec<MeasuredPoint> {
        let noise = |n: usize| (random_index(n, 4001) as f64 / 2000.0 - 1.0) * 0.002;
        let place = |i: usize| DVec2::new((i % 40) as f64, (i / 40) as f64) * 0.01 - 0.2;
        let height = |at: DVec2| if at.x > 0.06 { 0.05 } else { 0.0 };
        let at_m = |i: usize| place(i).extend(height(place(i)) + noise(i));
        (0..1600).map(|i| MeasuredPoint { at_m: at_m(i), tolerance_m: 0.005, camera_m: DVec3::Z }).collect()
    }

    #[test]
    fn support_of_an_object_is_the_table_and_not_the_box_beside_it() {
        let plane =
            foot(0.004).support_within(&RoomPoints::new(vec![(0, room())]), -MAX_CONTACT_M..MAX_CONTACT_M).unwrap();
        assert!(plane.normal.z > 0.999 && plane.offset_m.abs() < 0.002, "{plane:?}");
        // The footprint is 4 mm above the measured plane: the plane moves to it.
        let support = foot(0.004).on(&plane);
        assert!((support.point_m.z - 0.004).abs() < 0.0005, "{support:?}");
        // 3 cm above, it floats.
        let support = foot(0.03).on(&plane);
        assert!(support.point_m.z.abs() < 0.002, "{support:?}");
    }

    #[test]
    fn support_normals_that_differ_by_less_than_their_accuracy_are_rounded_to_one() {
        let tilted = |by: f64| {
            let normal = DVec3::new(by, 0.0, 1.0).normalize();
            HessePlane::from(Plane { point_m: DVec3::new(3.0, -2.0, 0.0), normal })
        };
        let foot = ObjectFootprint { middle: DVec3::new(3.0, -2.0, 0.03), ..foot(0.03) };
        let [a, b] = [0.0021, 0.0022].map(|by| foot.on(&tilted(by)));
        assert_eq!(a.normal, b.normal);
        assert!(foot.on(&tilted(0.01)).normal != a.normal);
        // Rotated about the world's origin, it would be off by half a millimetre.
        assert!(a.point_m.z.abs() < 1e-4, "{a:?}");
    }

    #[test]
    fn wall_and_too_few_points_are_no_support() {
        let wall: Vec<MeasuredPoint> = (0..900)
            .map(|i| DVec3::new(0.01, (i % 30) as f64 * 0.005 - 0.07, (i / 30) as f64 * 0.003 - 0.05))
            .map(|at_m| MeasuredPoint { at_m, tolerance_m: 0.003, camera_m: DVec3::X })
            .collect();
        assert!(foot(0.0).support_within(&RoomPoints::new(vec![(0, wall)]), -MAX_CONTACT_M..MAX_CONTACT_M).is_none());
        assert!(
            foot(0.0)
                .support_within(&RoomPoints::new(vec![(0, room()[..20].to_vec())]), -MAX_CONTACT_M..MAX_CONTACT_M)
                .is_none()
        );
    }
}
