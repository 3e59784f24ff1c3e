//! The handles around a selected thing: where they are on the screen, and which one the pointer is on.
//!
//! Places are points of the screen, y down. The handles are as large on the screen wherever the thing stands.

use glam::{DVec2, DVec3};

use super::maths::along_plane;

/// What can be taken hold of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// The middle, and the thing itself: over the surface.
    Slide,
    /// Along an axis of the world: 0, 1, 2 for x, y, z.
    Axis(usize),
    /// In the level plane.
    Ground,
    /// About the world's up.
    Heading,
    Size,
}

/// Lengths on the screen, points: where arrows begin and how long they are, the ring, the square of the plane from and to,
/// the handle of the size. An arrow begins beside the thing, which is there to be dragged itself, but no farther off than
/// `FARTHEST`.
const ARROW: [f64; 2] = [15.0, 69.0];
const BESIDE: f64 = 8.0;
const FARTHEST: f64 = 130.0;
const RING: f64 = 60.0;
const SQUARE: [f64; 2] = [22.0, 40.0];
const SIZE: DVec2 = DVec2::new(68.0, -68.0);
/// An arrow that is seen shorter than this is not drawn, points.
const SHORTEST: f64 = 26.0;
/// How near the pointer has to be, points.
const NEAR_MIDDLE: f64 = 10.0;
const NEAR_SIZE: f64 = 12.0;
const NEAR_TIP: f64 = 11.0;
const NEAR_LINE: f64 = 6.0;
const RING_SIDES: usize = 64;

/// The handles as they are seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Gizmo {
    pub centre: DVec2,
    /// From, to. `None` for an axis that is looked along.
    pub arrows: [Option<[DVec2; 2]>; 3],
    pub square: Option<[DVec2; 4]>,
    /// Closed; each place with whether it lies on the side towards the eye. Empty where it is seen edge-on or not whole.
    pub ring: Vec<(DVec2, bool)>,
    pub size: DVec2,
}

impl Gizmo {
    /// Around a point of the world; `seen` says where a point is on the screen, `covers` whether the thing is seen there.
    /// `None` if the point is not seen.
    pub fn new(
        centre_m: DVec3,
        up: DVec3,
        eye_m: DVec3,
        seen: impl Fn(DVec3) -> Option<DVec2>,
        covers: impl Fn(DVec2) -> bool,
    ) -> Option<Self> {
        let centre = seen(centre_m)?;
        let sight = (centre_m - eye_m).try_normalize()?;
        // A small step across the line of sight tells how large a metre is there.
        let step_m = 1e-3 * centre_m.distance(eye_m);
        let across = sight.any_orthonormal_vector();
        let points_a_metre = seen(centre_m + across * step_m)?.distance(centre) / step_m;
        let metres = |points: f64| points / points_a_metre;
        let at = |direction: DVec3, points: f64| seen(centre_m + direction * metres(points));

        let arrows = DVec3::AXES.map(|axis| {
            let way = at(axis, ARROW[0] + ARROW[1])? - centre;
            let along = way.try_normalize().filter(|_| way.length() >= SHORTEST)?;
            let share = way.length() / (ARROW[0] + ARROW[1]);
            let steps = (0..=(FARTHEST / 4.0) as u32).map(|n| 4.0 * f64::from(n));
            let covered = steps.filter(|s| covers(centre + along * *s)).last().map_or(0.0, |s| s + BESIDE);
            let from = covered.clamp(ARROW[0] * share, FARTHEST);
            Some([centre + along * from, centre + along * (from + ARROW[1] * share)])
        });
        let [a, b] = along_plane(up);
        let corner = |s: f64, t: f64| seen(centre_m + a * metres(s) + b * metres(t));
        let corners = || {
            let [from, to] = SQUARE;
            Some([corner(from, from)?, corner(to, from)?, corner(to, to)?, corner(from, to)?])
        };
        // Level things at the eye's height are lines.
        let is_flat = sight.dot(up).abs() < 0.08;
        let square = if is_flat { None } else { corners() };
        let on_ring = |n: usize| {
            let (sin, cos) = (n as f64 / RING_SIDES as f64 * std::f64::consts::TAU).sin_cos();
            let direction = a * cos + b * sin;
            Some((at(direction, RING)?, direction.dot(sight) <= 0.0))
        };
        let ring = (0..RING_SIDES).map(on_ring).collect::<Option<Vec<_>>>().unwrap_or_default();
        Some(Self { centre, arrows, square, ring: if is_flat { Vec::new() } else { ring }, size: centre + SIZE })
    }

    /// The handle that a pointer is on: the nearest.
    pub fn at(&self, pointer: DVec2) -> Option<Handle> {
        let near = |distance: f64, most: f64, handle| (distance <= most).then_some((distance, handle));
        let arrows = (0..3).filter_map(|axis| {
            let [from, to] = self.arrows[axis]?;
            let tip = near(to.distance(pointer), NEAR_TIP, Handle::Axis(axis));
            tip.or_else(|| near(to_segment(pointer, from, to), NEAR_LINE, Handle::Axis(axis)))
        });
        let square = self.square.filter(|square| is_inside(pointer, square)).map(|_| (0.5 * NEAR_LINE, Handle::Ground));
        let sides = self.ring.iter().zip(self.ring.iter().cycle().skip(1));
        let ring = sides.map(|((p, _), (q, _))| to_segment(pointer, *p, *q)).reduce(f64::min);
        let others = [
            near(self.centre.distance(pointer), NEAR_MIDDLE, Handle::Slide),
            near(self.size.distance(pointer), NEAR_SIZE, Handle::Size),
            ring.and_then(|distance| near(distance, NEAR_LINE, Handle::Heading)),
            square,
        ];
        let found = arrows.chain(others.into_iter().flatten());
        found.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, handle)| handle)
    }
}

fn to_segment(p: DVec2, from: DVec2, to: DVec2) -> f64 {
    let way = to - from;
    let share = ((p - from).dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    p.distance(from + way * share)
}

/// Whether a place lies in a polygon, of any winding: the number of sides that a ray from it crosses.
pub fn is_inside(p: DVec2, polygon: &[DVec2]) -> bool {
    let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let crosses =
        |(a, b): (&DVec2, &DVec2)| (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x);
    sides.filter(|side| crosses(*side)).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera 1 m above the floor, 1 m before the thing, that looks at it: 500 points to one at 1 m.
    fn gizmo(distance: f64, covers: fn(DVec2) -> bool) -> Gizmo {
        let eye = DVec3::new(0.0, -distance, distance);
        let pose = locard_engine::pose::Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
        let seen = |p: DVec3| {
            let p = pose.transform_point(p);
            (p.z > 0.0).then(|| DVec2::new(400.0 + 500.0 * p.x / p.z, 300.0 + 500.0 * p.y / p.z))
        };
        Gizmo::new(DVec3::ZERO, DVec3::Z, eye, seen, |p| covers(p - DVec2::new(400.0, 300.0))).unwrap()
    }

    const NOTHING: fn(DVec2) -> bool = |_| false;

    #[test]
    fn handles_are_as_large_wherever_the_thing_stands() {
        for distance in [0.3, 1.0, 20.0] {
            let gizmo = gizmo(distance, NOTHING);
            let [x, y, z] = gizmo.arrows.map(|arrow| arrow.unwrap()[1] - gizmo.centre);
            // x lies across the sight; y and z are seen at 45°. An arrow is 84/500 of the distance long, so that y's tip is
            // 0.1188 of it farther off and z's nearer.
            assert!((x - DVec2::new(84.0, 0.0)).length() < 0.2, "{x}");
            let at_45 = 84.0 * 0.5f64.sqrt();
            assert!((y - DVec2::new(0.0, -at_45 / 1.1188)).length() < 0.2, "{y}");
            assert!((z - DVec2::new(0.0, -at_45 / 0.8812)).length() < 0.2, "{z}");
        }
        // Beside a thing that is 40 points wide to the right, and only so far beside one that covers all.
        let beside = gizmo(1.0, |p| p.x <= 41.0).arrows[0].unwrap().map(|p| p.x - 400.0);
        assert!((beside[0] - 48.0).abs() < 1e-6 && (beside[1] - 117.0).abs() < 0.1, "{beside:?}");
        let inside = gizmo(1.0, |_| true).arrows[0].unwrap();
        assert!((inside[0].x - 400.0 - FARTHEST).abs() < 1e-6, "{inside:?}");
    }

    #[test]
    fn the_nearest_handle_is_the_one() {
        let gizmo = gizmo(1.0, NOTHING);
        let at = |x: f64, y: f64| gizmo.at(gizmo.centre + DVec2::new(x, y));
        assert_eq!(at(1.0, 2.0), Some(Handle::Slide));
        assert_eq!(
            (at(84.0, 8.0), at(70.0, 4.0), at(78.0, 8.0)),
            (Some(Handle::Axis(0)), Some(Handle::Axis(0)), Some(Handle::Axis(0)))
        );
        assert_eq!(at(-60.0, 0.0), Some(Handle::Heading));
        assert_eq!(at(68.0, -68.0), Some(Handle::Size));
        // The square lies between x and y; at 31 points along both, y is seen at 45°.
        assert_eq!(at(31.0, -21.5), Some(Handle::Ground));
        assert_eq!((at(-30.0, 10.0), at(200.0, 0.0)), (None, None));
    }

    #[test]
    fn what_is_looked_along_is_no_handle() {
        let eye = DVec3::new(0.0, 0.0, 2.0);
        // From above: x to the right, y up, z to the eye.
        let seen = |p: DVec3| (p.z < 2.0).then(|| DVec2::new(p.x, -p.y) * 500.0 / (2.0 - p.z));
        let above = Gizmo::new(DVec3::ZERO, DVec3::Z, eye, seen, NOTHING).unwrap();
        assert!(above.arrows[2].is_none() && above.arrows[0].is_some() && above.ring.len() == RING_SIDES);
        assert!(above.ring.iter().all(|(p, front)| (p.length() - RING).abs() < 1.0 && *front));
        assert_eq!(Gizmo::new(DVec3::Z * 3.0, DVec3::Z, eye, seen, NOTHING), None);
        // At the eye's height the floor's directions are a line.
        let level = |p: DVec3| (p.y > -2.0).then(|| DVec2::new(p.x, -p.z) * 500.0 / (p.y + 2.0));
        let level = Gizmo::new(DVec3::ZERO, DVec3::Z, DVec3::new(0.0, -2.0, 0.0), level, NOTHING).unwrap();
        assert!(level.ring.is_empty() && level.square.is_none() && level.arrows[1].is_none());
        let l = [(0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)].map(DVec2::from);
        assert!(is_inside(DVec2::new(0.5, 2.5), &l) && !is_inside(DVec2::new(2.0, 2.0), &l));
    }
}
