//! View rays, planes, axes and angles: mapping of pointer motion to the world.
//!
//! Lengths in metres, angles in radians, positions in the picture in px with y down.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use locard_engine::plane::Plane;
use locard_engine::shot::ViewRay;

/// Sine of the smallest angle between a view ray and a plane or an axis, 2°: at smaller angles a
/// pixel is a huge step.
const MIN_GRAZING_SIN: f64 = 0.035;
/// Smallest distance of the pointer from the centre at which its direction counts, px.
const MIN_LEVER_PX: f64 = 6.0;

/// Intersection of a plane with a view ray. `None` where it is behind the camera or the plane is
/// seen edge-on.
pub fn intersect_plane(plane: &Plane, ray: &ViewRay) -> Option<DVec3> {
    let distance_m = plane.distance_along_m(ray.origin_m, ray.direction);
    let is_visible = is_crossed(plane, ray.direction) && distance_m > 0.0 && distance_m.is_finite();
    is_visible.then(|| ray.at(distance_m))
}

/// Projection of a point onto a plane along `up`. `None` if the plane is upright.
pub fn project_along(plane: &Plane, point_m: DVec3, up: DVec3) -> Option<DVec3> {
    is_crossed(plane, up).then(|| point_m + up * plane.distance_along_m(point_m, up))
}

/// True unless a direction of unit length is nearly parallel to a plane.
fn is_crossed(plane: &Plane, direction: DVec3) -> bool {
    direction.dot(plane.normal).abs() > MIN_GRAZING_SIN
}

/// Coordinate on an axis (unit length, from `origin_m`) of its point closest to a view ray, metres.
/// `None` if the ray is parallel to the axis or the closest point of the ray is behind the camera.
///
/// Closest points of two lines (Ericson 2005, *Real-Time Collision Detection*, 5.1.8).
pub fn closest_on_axis_m(ray: &ViewRay, origin_m: DVec3, axis: DVec3) -> Option<f64> {
    let cos = ray.direction.dot(axis);
    let sin2 = 1.0 - cos * cos;
    if sin2 < MIN_GRAZING_SIN * MIN_GRAZING_SIN {
        return None;
    }
    let to_ray = ray.origin_m - origin_m;
    let along_m = (to_ray.dot(axis) - cos * to_ray.dot(ray.direction)) / sin2;
    let distance_m = cos * along_m - to_ray.dot(ray.direction);
    (distance_m > 0.0 && along_m.is_finite()).then_some(along_m)
}

/// Signed angle about `axis` from one point to another around `centre_m`; counter-clockwise seen
/// from the axis' tip.
pub fn signed_angle_rad(axis: DVec3, centre_m: DVec3, from_m: DVec3, to_m: DVec3) -> Option<f64> {
    let [from, to] = [from_m, to_m].map(|p| (p - centre_m).reject_from_normalized(axis));
    let (sin, cos) = (from.cross(to).dot(axis), from.dot(to));
    (sin != 0.0 || cos != 0.0).then(|| sin.atan2(cos))
}

/// Angle on the screen around a point, counter-clockwise as displayed. `None` within
/// [`MIN_LEVER_PX`] of it.
pub fn screen_angle_rad(centre_px: DVec2, from_px: DVec2, to_px: DVec2) -> Option<f64> {
    let (from, to) = (from_px - centre_px, to_px - centre_px);
    // y points down: a positive angle of the coordinates is clockwise on the screen.
    (from.length().min(to.length()) >= MIN_LEVER_PX).then(|| -from.angle_to(to))
}

/// `turn` plus the multiple of 2π that brings it nearest to `near`: continues past 180°.
pub fn unwrapped_angle(turn: f64, near: f64) -> f64 {
    turn + TAU * ((near - turn) / TAU).round()
}

/// Ratio of the pointer's distances from the centre. `None` if the first is below [`MIN_LEVER_PX`].
pub fn distance_ratio(centre_px: DVec2, from_px: DVec2, to_px: DVec2) -> Option<f64> {
    let from = from_px.distance(centre_px);
    (from >= MIN_LEVER_PX).then(|| to_px.distance(centre_px) / from)
}

/// Rounds to a multiple of `step`.
pub fn snapped(value: f64, step: f64) -> f64 {
    // Divided by the number of steps per unit, a whole number: 3 · 0.1 is 0.30000000000000004.
    let per_unit = (1.0 / step).round();
    if step < 1.0 { (value * per_unit).round() / per_unit } else { (value / step).round() * step }
}

/// Orthonormal basis of a plane, from the two world axes nearest to it. For a level plane these are
/// world axes.
pub fn plane_axes(normal: DVec3) -> [DVec3; 2] {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let steepest = (0..3).max_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(2);
    let first = axes[(0..3).find(|i| *i != steepest).unwrap_or(0)].reject_from_normalized(normal).normalize();
    let second = axes[(0..3).rfind(|i| *i != steepest).unwrap_or(1)];
    let second = (second.reject_from_normalized(normal).reject_from_normalized(first)).normalize();
    [first, second]
}

/// The axis nearest to a direction, with the sign of their dot product: 1 or −1.
pub fn nearest_axis(direction: DVec3, axes: impl IntoIterator<Item = DVec3>) -> Option<(DVec3, f64)> {
    let best = axes.into_iter().max_by(|a, b| a.dot(direction).abs().total_cmp(&b.dot(direction).abs()))?;
    Some((best, if best.dot(direction) < 0.0 { -1.0 } else { 1.0 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view ray from 2 m above the floor z = 0, down and along y: the central one meets the floor
    /// 2 m ahead.
    fn view_ray(x: f64, y: f64) -> ViewRay {
        let direction = DVec3::new(x, 1.0 + y, -1.0).normalize();
        ViewRay { origin_m: DVec3::new(0.0, 0.0, 2.0), direction }
    }

    const FLOOR: Plane = Plane { point_m: DVec3::new(5.0, 5.0, 0.0), normal: DVec3::Z };

    #[test]
    fn view_ray_intersects_a_plane_in_front_of_the_camera_only() {
        assert!(intersect_plane(&FLOOR, &view_ray(0.0, 0.0)).unwrap().abs_diff_eq(DVec3::new(0.0, 2.0, 0.0), 1e-12));
        assert!(intersect_plane(&FLOOR, &view_ray(0.5, 0.0)).unwrap().abs_diff_eq(DVec3::new(1.0, 2.0, 0.0), 1e-12));
        let sky = ViewRay { direction: DVec3::new(0.0, 0.6, 0.8), ..view_ray(0.0, 0.0) };
        // 1° below the horizon the floor is 115 m away; a pixel there spans metres.
        let far = ViewRay { direction: DVec3::new(0.0, 1.0, -0.0175).normalize(), ..sky };
        assert_eq!((intersect_plane(&FLOOR, &sky), intersect_plane(&FLOOR, &far)), (None, None));
        // A slope of 45° that rises along y.
        let slope = Plane { point_m: DVec3::new(0.0, 1.0, 1.0), normal: DVec3::new(0.0, -1.0, 1.0).normalize() };
        let projected = project_along(&slope, DVec3::new(3.0, 0.25, 7.0), DVec3::Z).unwrap();
        assert!(projected.abs_diff_eq(DVec3::new(3.0, 0.25, 0.25), 1e-12), "{projected}");
        assert_eq!(project_along(&Plane { normal: DVec3::X, ..slope }, DVec3::ZERO, DVec3::Z), None);
    }

    #[test]
    fn closest_point_on_an_axis_follows_the_view_ray() {
        // The axis x through (0, 2, 0) crosses the picture.
        let at = |ray: &ViewRay| closest_on_axis_m(ray, DVec3::new(0.0, 2.0, 0.0), DVec3::X);
        assert!((at(&view_ray(0.5, 0.0)).unwrap() - 1.0).abs() < 1e-12);
        // A vertical axis: the level view ray is closest at the camera's height, 2 m.
        let level = ViewRay { direction: DVec3::Y, ..view_ray(0.0, 0.0) };
        assert!((closest_on_axis_m(&level, DVec3::new(0.0, 2.0, 0.0), DVec3::Z).unwrap() - 2.0).abs() < 1e-12);
        // No result for a ray along the axis, or for an axis behind the camera.
        assert_eq!(closest_on_axis_m(&level, DVec3::new(1.0, 0.0, 0.0), DVec3::Y), None);
        assert_eq!(closest_on_axis_m(&level, DVec3::new(0.0, -2.0, 0.0), DVec3::Z), None);
    }

    #[test]
    fn signed_angles_are_counter_clockwise_from_the_axis_tip_and_unwrap() {
        let centre = DVec3::new(1.0, 1.0, 4.0);
        let turn = |axis, to| signed_angle_rad(axis, centre, centre + DVec3::X, centre + to).unwrap().to_degrees();
        // Offsets along the axis have no effect.
        assert!((turn(DVec3::Z, DVec3::new(1.0, 1.0, 9.0)) - 45.0).abs() < 1e-9);
        assert!((turn(DVec3::NEG_Z, DVec3::new(0.0, 1.0, 0.0)) + 90.0).abs() < 1e-9);
        assert_eq!(signed_angle_rad(DVec3::Z, centre, centre, centre + DVec3::X), None);
        // On the screen: from the right to the top, where y is smaller.
        let screen = |to: (f64, f64)| screen_angle_rad(DVec2::splat(100.0), DVec2::new(150.0, 100.0), to.into());
        assert!((screen((100.0, 40.0)).unwrap().to_degrees() - 90.0).abs() < 1e-9);
        assert_eq!(screen((103.0, 100.0)), None);
        assert!((unwrapped_angle(-170f64.to_radians(), 175f64.to_radians()).to_degrees() - 190.0).abs() < 1e-9);
        assert!((unwrapped_angle(0.1, -12.0) - (0.1 - 2.0 * TAU)).abs() < 1e-9);
    }

    #[test]
    fn snapping_is_exact_and_scale_follows_the_distance_ratio() {
        assert_eq!([0.294, 0.286, -0.006, 0.004].map(|m| snapped(m, 0.01)), [0.29, 0.29, -0.01, 0.0]);
        assert_eq!([43.0, -2.4].map(|deg| snapped(deg, 5.0)), [45.0, -0.0]);
        assert_eq!(snapped(0.3 + 1e-9, 0.1), 0.3);
        let centre = DVec2::new(10.0, 10.0);
        assert_eq!(distance_ratio(centre, DVec2::new(40.0, 50.0), DVec2::new(10.0, 110.0)), Some(2.0));
        assert_eq!(distance_ratio(centre, DVec2::new(13.0, 14.0), DVec2::new(10.0, 110.0)), None);
    }

    #[test]
    fn plane_axes_of_a_level_plane_are_world_axes() {
        assert_eq!(plane_axes(DVec3::Z), [DVec3::X, DVec3::Y]);
        assert_eq!(plane_axes(DVec3::NEG_Y), [DVec3::X, DVec3::Z]);
        let [a, b] = plane_axes(DVec3::new(0.1, 0.2, 1.0).normalize());
        assert!(a.dot(b).abs() < 1e-12 && a.x > 0.9 && b.y > 0.9, "{a} {b}");
        let (axis, sign) = nearest_axis(DVec3::new(0.2, -0.9, 0.3), [DVec3::X, DVec3::Y]).unwrap();
        assert_eq!((axis, sign), (DVec3::Y, -1.0));
    }
}
