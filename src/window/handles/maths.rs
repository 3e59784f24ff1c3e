//! Lines of sight, planes, axes and angles: what a pointer's way over the picture is in the room.
//!
//! Lengths in metres, angles in radians, places of the picture in px with y down.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use locard_engine::shot::Ray;

/// A plane or an axis that is seen at less than this angle is not followed: the pointer's steps would be huge. 2°.
const GRAZING: f64 = 0.035;
/// Nearer than this to the centre a pointer has no direction, px.
const NO_DIRECTION_PX: f64 = 6.0;

/// A plane through a point; `normal` has unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    pub point_m: DVec3,
    pub normal: DVec3,
}

impl Plane {
    /// Where a line of sight meets it, in front of the camera. `None` where it is seen edge-on or not at all.
    pub fn seen_at(&self, ray: &Ray) -> Option<DVec3> {
        let slope = ray.direction.dot(self.normal);
        let distance_m = (self.point_m - ray.origin_m).dot(self.normal) / slope;
        (slope.abs() > GRAZING && distance_m > 0.0 && distance_m.is_finite()).then(|| ray.at(distance_m))
    }

    /// The point above or below `point_m`, along `up`. `None` where the plane is upright.
    pub fn beneath(&self, point_m: DVec3, up: DVec3) -> Option<DVec3> {
        let slope = up.dot(self.normal);
        (slope.abs() > GRAZING).then(|| point_m + up * ((self.point_m - point_m).dot(self.normal) / slope))
    }
}

/// How far along an axis (unit length, from `origin_m`) a line of sight passes nearest to it. `None` if it looks along
/// the axis.
///
/// Of the two lines' shortest connection (Ericson 2005, *Real-Time Collision Detection*, 5.1.8).
pub fn along_axis(ray: &Ray, origin_m: DVec3, axis: DVec3) -> Option<f64> {
    let cos = ray.direction.dot(axis);
    let sin2 = 1.0 - cos * cos;
    if sin2 < GRAZING * GRAZING {
        return None;
    }
    let to_ray = ray.origin_m - origin_m;
    let along_m = (to_ray.dot(axis) - cos * to_ray.dot(ray.direction)) / sin2;
    // Behind the camera two lines of sight that part meet again.
    let distance_m = cos * along_m - to_ray.dot(ray.direction);
    (distance_m > 0.0 && along_m.is_finite()).then_some(along_m)
}

/// The turn about `axis` from one point to another, seen from `centre_m`; counter-clockwise seen from the axis' tip.
pub fn turn_about(axis: DVec3, centre_m: DVec3, from_m: DVec3, to_m: DVec3) -> Option<f64> {
    let [from, to] = [from_m, to_m].map(|p| (p - centre_m).reject_from_normalized(axis));
    let (sin, cos) = (from.cross(to).dot(axis), from.dot(to));
    (sin != 0.0 || cos != 0.0).then(|| sin.atan2(cos))
}

/// The turn on the screen about a place, counter-clockwise as it is seen. `None` too near to it.
pub fn turn_on_screen(centre_px: DVec2, from_px: DVec2, to_px: DVec2) -> Option<f64> {
    let (from, to) = (from_px - centre_px, to_px - centre_px);
    // y points down, so that a positive turn of the coordinates is clockwise to the eye.
    (from.length().min(to.length()) >= NO_DIRECTION_PX).then(|| -from.angle_to(to))
}

/// The angle that is `turn` or whole turns more or less, next to `near`: so that a turn goes on past 180°.
pub fn wound(turn: f64, near: f64) -> f64 {
    turn + TAU * ((near - turn) / TAU).round()
}

/// How much farther from the centre a pointer is than it was. `None` if it began too near to it.
pub fn growth(centre_px: DVec2, from_px: DVec2, to_px: DVec2) -> Option<f64> {
    let begun = from_px.distance(centre_px);
    (begun >= NO_DIRECTION_PX).then(|| to_px.distance(centre_px) / begun)
}

/// The nearest whole number of steps.
pub fn snapped(value: f64, step: f64) -> f64 {
    // Divided by the steps to one, which are whole numbers: 3 · 0.1 is 0.30000000000000004.
    let to_one = (1.0 / step).round();
    if step < 1.0 { (value * to_one).round() / to_one } else { (value / step).round() * step }
}

/// The two directions along a plane of that normal: those of the world's axes that lie in it best, made perpendicular.
/// On a level floor they are two axes of the world.
pub fn along_plane(normal: DVec3) -> [DVec3; 2] {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let steepest = (0..3).max_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(2);
    let first = axes[(0..3).find(|i| *i != steepest).unwrap_or(0)].reject_from_normalized(normal).normalize();
    let second = axes[(0..3).rfind(|i| *i != steepest).unwrap_or(1)];
    let second = (second.reject_from_normalized(normal).reject_from_normalized(first)).normalize();
    [first, second]
}

/// The world's axis that lies nearest to a direction, and whether it points the same way: 1 or −1.
pub fn nearest_axis(direction: DVec3, among: impl IntoIterator<Item = DVec3>) -> Option<(DVec3, f64)> {
    let best = among.into_iter().max_by(|a, b| a.dot(direction).abs().total_cmp(&b.dot(direction).abs()))?;
    Some((best, if best.dot(direction) < 0.0 { -1.0 } else { 1.0 }))
}

/// The convex polygon around points (Andrew 1979, *Another efficient algorithm for convex hulls in two dimensions*).
pub fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(p - a) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    [half(&mut points.iter().copied()), half(&mut points.iter().rev().copied())].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From 2 m above the floor z = 0, looking down and along y: the middle meets the floor 2 m ahead.
    fn sight(x: f64, y: f64) -> Ray {
        let direction = DVec3::new(x, 1.0 + y, -1.0).normalize();
        Ray { origin_m: DVec3::new(0.0, 0.0, 2.0), direction }
    }

    const FLOOR: Plane = Plane { point_m: DVec3::new(5.0, 5.0, 0.0), normal: DVec3::Z };

    #[test]
    fn a_line_of_sight_meets_the_floor_where_it_is_seen() {
        assert!(FLOOR.seen_at(&sight(0.0, 0.0)).unwrap().abs_diff_eq(DVec3::new(0.0, 2.0, 0.0), 1e-12));
        assert!(FLOOR.seen_at(&sight(0.5, 0.0)).unwrap().abs_diff_eq(DVec3::new(1.0, 2.0, 0.0), 1e-12));
        let sky = Ray { direction: DVec3::new(0.0, 0.6, 0.8), ..sight(0.0, 0.0) };
        // 1° below the horizon the floor is 115 m away, and a px there is metres.
        let far = Ray { direction: DVec3::new(0.0, 1.0, -0.0175).normalize(), ..sky };
        assert_eq!((FLOOR.seen_at(&sky), FLOOR.seen_at(&far)), (None, None));
        // A slope of 45° that rises along y: 1 m below the point is 1 m before it.
        let slope = Plane { point_m: DVec3::new(0.0, 1.0, 1.0), normal: DVec3::new(0.0, -1.0, 1.0).normalize() };
        let beneath = slope.beneath(DVec3::new(3.0, 0.25, 7.0), DVec3::Z).unwrap();
        assert!(beneath.abs_diff_eq(DVec3::new(3.0, 0.25, 0.25), 1e-12), "{beneath}");
        assert_eq!(Plane { normal: DVec3::X, ..slope }.beneath(DVec3::ZERO, DVec3::Z), None);
    }

    #[test]
    fn an_axis_is_followed_where_the_pointer_is_nearest_to_it() {
        // The axis x through (0, 2, 0) crosses the picture; 45° to the side is 2 m to the side of it, wherever above.
        let at = |ray: &Ray| along_axis(ray, DVec3::new(0.0, 2.0, 0.0), DVec3::X);
        assert!((at(&sight(0.5, 0.0)).unwrap() - 1.0).abs() < 1e-12);
        // Upwards: x = 0 is met 2 m up, at the camera's own height, by the level line of sight.
        let level = Ray { direction: DVec3::Y, ..sight(0.0, 0.0) };
        assert!((along_axis(&level, DVec3::new(0.0, 2.0, 0.0), DVec3::Z).unwrap() - 2.0).abs() < 1e-12);
        // Along the axis there is no place on it, and none behind the camera.
        assert_eq!(along_axis(&level, DVec3::new(1.0, 0.0, 0.0), DVec3::Y), None);
        assert_eq!(along_axis(&level, DVec3::new(0.0, -2.0, 0.0), DVec3::Z), None);
    }

    #[test]
    fn turns_are_counter_clockwise_from_the_axis_tip_and_go_past_half_a_turn() {
        let centre = DVec3::new(1.0, 1.0, 4.0);
        let turn = |axis, to| turn_about(axis, centre, centre + DVec3::X, centre + to).unwrap().to_degrees();
        // Heights along the axis do not count.
        assert!((turn(DVec3::Z, DVec3::new(1.0, 1.0, 9.0)) - 45.0).abs() < 1e-9);
        assert!((turn(DVec3::NEG_Z, DVec3::new(0.0, 1.0, 0.0)) + 90.0).abs() < 1e-9);
        assert_eq!(turn_about(DVec3::Z, centre, centre, centre + DVec3::X), None);
        // To the eye: from the right to the top, where y is smaller.
        let eye = |to: (f64, f64)| turn_on_screen(DVec2::splat(100.0), DVec2::new(150.0, 100.0), to.into());
        assert!((eye((100.0, 40.0)).unwrap().to_degrees() - 90.0).abs() < 1e-9);
        assert_eq!(eye((103.0, 100.0)), None);
        assert!((wound(-170f64.to_radians(), 175f64.to_radians()).to_degrees() - 190.0).abs() < 1e-9);
        assert!((wound(0.1, -12.0) - (0.1 - 2.0 * TAU)).abs() < 1e-9);
    }

    #[test]
    fn steps_are_round_numbers_and_growth_is_by_distance() {
        assert_eq!([0.294, 0.286, -0.006, 0.004].map(|m| snapped(m, 0.01)), [0.29, 0.29, -0.01, 0.0]);
        assert_eq!([43.0, -2.4].map(|deg| snapped(deg, 5.0)), [45.0, -0.0]);
        assert_eq!(snapped(0.3 + 1e-9, 0.1), 0.3);
        let centre = DVec2::new(10.0, 10.0);
        assert_eq!(growth(centre, DVec2::new(40.0, 50.0), DVec2::new(10.0, 110.0)), Some(2.0));
        assert_eq!(growth(centre, DVec2::new(13.0, 14.0), DVec2::new(10.0, 110.0)), None);
    }

    #[test]
    fn a_level_floors_directions_are_the_worlds() {
        assert_eq!(along_plane(DVec3::Z), [DVec3::X, DVec3::Y]);
        assert_eq!(along_plane(DVec3::NEG_Y), [DVec3::X, DVec3::Z]);
        let [a, b] = along_plane(DVec3::new(0.1, 0.2, 1.0).normalize());
        assert!(a.dot(b).abs() < 1e-12 && a.x > 0.9 && b.y > 0.9, "{a} {b}");
        let (axis, sign) = nearest_axis(DVec3::new(0.2, -0.9, 0.3), [DVec3::X, DVec3::Y]).unwrap();
        assert_eq!((axis, sign), (DVec3::Y, -1.0));
    }

    #[test]
    fn a_hull_leaves_out_what_is_inside() {
        let points = [(0.0, 0.0), (4.0, 0.0), (2.0, 1.0), (4.0, 3.0), (0.0, 3.0), (2.0, 3.0)].map(DVec2::from);
        let corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)].map(DVec2::from);
        assert_eq!(hull(points.to_vec()), corners);
        assert!(hull(Vec::new()).is_empty());
    }
}
