//! The transform gizmo of a selected item: screen positions of its handles, and picking.
//!
//! Positions are points of the screen, y down. The size of the gizmo on the screen is constant.

use glam::{DVec2, DVec3};

use super::maths::plane_axes;

/// A handle of the gizmo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// The centre or the item itself: moves over the surface.
    Slide,
    /// Moves along an axis of the world: 0, 1, 2 for x, y, z.
    Axis(usize),
    /// Moves in the level plane.
    Ground,
    /// Turns about the world's up.
    Heading,
    /// Scales uniformly.
    Size,
}

/// Smallest distance from the centre to the start of an arrow, points.
const ARROW_START_PT: f64 = 15.0;
const ARROW_LENGTH_PT: f64 = 69.0;
/// Gap between the outline of the item and the start of an arrow, points: the item itself can be
/// dragged.
const ARROW_GAP_PT: f64 = 8.0;
/// Largest distance from the centre to the start of an arrow, points.
const MAX_ARROW_START_PT: f64 = 130.0;
const RING_RADIUS_PT: f64 = 60.0;
/// Range of the level-plane handle along both axes, points.
const SQUARE_RANGE_PT: [f64; 2] = [22.0, 40.0];
/// Offset of the scale handle from the centre, points.
const SIZE_OFFSET_PT: DVec2 = DVec2::new(68.0, -68.0);
/// A foreshortened arrow below this length is hidden, points.
const MIN_ARROW_LENGTH_PT: f64 = 26.0;
/// Pick radii, points.
const CENTRE_PICK_PT: f64 = 10.0;
const SIZE_PICK_PT: f64 = 12.0;
const TIP_PICK_PT: f64 = 11.0;
const LINE_PICK_PT: f64 = 6.0;
/// Level handles are hidden below this sine of the view ray's elevation.
const MIN_LEVEL_SIN: f64 = 0.08;
const RING_SIDES: usize = 64;

/// The handles on the screen.
#[derive(Clone, Debug, PartialEq)]
pub struct Gizmo {
    pub centre: DVec2,
    /// Start and end. `None` for an axis close to the view direction.
    pub arrows: [Option<[DVec2; 2]>; 3],
    pub square: Option<[DVec2; 4]>,
    /// Closed polygon; the flag marks vertices on the side towards the camera. Empty if the ring is
    /// seen edge-on or partly out of view.
    pub ring: Vec<(DVec2, bool)>,
    pub size: DVec2,
}

impl Gizmo {
    /// The gizmo at a point of the world. `project` maps points to the screen, `covers` is true
    /// inside the outline of the item. `None` if the point has no projection.
    pub fn new(
        centre_m: DVec3,
        up: DVec3,
        eye_m: DVec3,
        project: impl Fn(DVec3) -> Option<DVec2>,
        covers: impl Fn(DVec2) -> bool,
    ) -> Option<Self> {
        let centre = project(centre_m)?;
        let view = (centre_m - eye_m).try_normalize()?;
        // Scale of the screen, by a small step perpendicular to the view ray.
        let step_m = 1e-3 * centre_m.distance(eye_m);
        let across = view.any_orthonormal_vector();
        let points_per_metre = project(centre_m + across * step_m)?.distance(centre) / step_m;
        let metres = |points: f64| points / points_per_metre;
        let at = |direction: DVec3, points: f64| project(centre_m + direction * metres(points));

        let arrows = DVec3::AXES.map(|axis| {
            let vector = at(axis, ARROW_START_PT + ARROW_LENGTH_PT)? - centre;
            let along = vector.try_normalize().filter(|_| vector.length() >= MIN_ARROW_LENGTH_PT)?;
            let foreshortening = vector.length() / (ARROW_START_PT + ARROW_LENGTH_PT);
            let steps = (0..=(MAX_ARROW_START_PT / 4.0) as u32).map(|n| 4.0 * f64::from(n));
            let covered = steps.filter(|s| covers(centre + along * *s)).last().map_or(0.0, |s| s + ARROW_GAP_PT);
            let from = covered.clamp(ARROW_START_PT * foreshortening, MAX_ARROW_START_PT);
            Some([centre + along * from, centre + along * (from + ARROW_LENGTH_PT * foreshortening)])
        });
        let [a, b] = plane_axes(up);
        let corner = |s: f64, t: f64| project(centre_m + a * metres(s) + b * metres(t));
        let corners = || {
            let [from, to] = SQUARE_RANGE_PT;
            Some([corner(from, from)?, corner(to, from)?, corner(to, to)?, corner(from, to)?])
        };
        let is_edge_on = view.dot(up).abs() < MIN_LEVEL_SIN;
        let square = if is_edge_on { None } else { corners() };
        let on_ring = |n: usize| {
            let (sin, cos) = (n as f64 / RING_SIDES as f64 * std::f64::consts::TAU).sin_cos();
            let direction = a * cos + b * sin;
            Some((at(direction, RING_RADIUS_PT)?, direction.dot(view) <= 0.0))
        };
        let ring = (0..RING_SIDES).map(on_ring).collect::<Option<Vec<_>>>().unwrap_or_default();
        let ring = if is_edge_on { Vec::new() } else { ring };
        Some(Self { centre, arrows, square, ring, size: centre + SIZE_OFFSET_PT })
    }

    /// The nearest handle within its pick radius.
    pub fn pick(&self, pointer: DVec2) -> Option<Handle> {
        let near = |distance: f64, radius: f64, handle| (distance <= radius).then_some((distance, handle));
        let arrows = (0..3).filter_map(|axis| {
            let [from, to] = self.arrows[axis]?;
            let tip = near(to.distance(pointer), TIP_PICK_PT, Handle::Axis(axis));
            tip.or_else(|| near(segment_distance(pointer, from, to), LINE_PICK_PT, Handle::Axis(axis)))
        });
        let square = self.square.filter(|square| is_inside(pointer, square));
        let square = square.map(|_| (0.5 * LINE_PICK_PT, Handle::Ground));
        let sides = self.ring.iter().zip(self.ring.iter().cycle().skip(1));
        let ring = sides.map(|((p, _), (q, _))| segment_distance(pointer, *p, *q)).reduce(f64::min);
        let others = [
            near(self.centre.distance(pointer), CENTRE_PICK_PT, Handle::Slide),
            near(self.size.distance(pointer), SIZE_PICK_PT, Handle::Size),
            ring.and_then(|distance| near(distance, LINE_PICK_PT, Handle::Heading)),
            square,
        ];
        let candidates = arrows.chain(others.into_iter().flatten());
        candidates.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, handle)| handle)
    }
}

/// Distance of a point from a line segment.
fn segment_distance(p: DVec2, from: DVec2, to: DVec2) -> f64 {
    let vector = to - from;
    let share = ((p - from).dot(vector) / vector.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    p.distance(from + vector * share)
}

/// True if a point lies in a polygon, by the number of sides that a ray from the point crosses
/// (even-odd rule).
pub fn is_inside(p: DVec2, polygon: &[DVec2]) -> bool {
    let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let crosses =
        |(a, b): (&DVec2, &DVec2)| (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x);
    sides.filter(|side| crosses(*side)).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The gizmo of an item seen at 45° from `distance` before and above it; the focal length is
    /// 500 points.
    fn gizmo(distance: f64, covers: fn(DVec2) -> bool) -> Gizmo {
        let eye = DVec3::new(0.0, -distance, distance);
        let pose = locard_engine::pose::Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
        let project = |p: DVec3| {
            let p = pose.transform_point(p);
            (p.z > 0.0).then(|| DVec2::new(400.0 + 500.0 * p.x / p.z, 300.0 + 500.0 * p.y / p.z))
        };
        Gizmo::new(DVec3::ZERO, DVec3::Z, eye, project, |p| covers(p - DVec2::new(400.0, 300.0))).unwrap()
    }

    const NOTHING: fn(DVec2) -> bool = |_| false;

    #[test]
    fn gizmo_has_the_same_screen_size_at_every_distance() {
        for distance in [0.3, 1.0, 20.0] {
            let gizmo = gizmo(distance, NOTHING);
            let [x, y, z] = gizmo.arrows.map(|arrow| arrow.unwrap()[1] - gizmo.centre);
            // x is perpendicular to the view direction; y and z are at 45° to it. An arrow is
            // 84/500 of the distance long: the tip of y is 0.1188 of the distance farther away,
            // that of z nearer.
            assert!((x - DVec2::new(84.0, 0.0)).length() < 0.2, "{x}");
            let at_45 = 84.0 * 0.5f64.sqrt();
            assert!((y - DVec2::new(0.0, -at_45 / 1.1188)).length() < 0.2, "{y}");
            assert!((z - DVec2::new(0.0, -at_45 / 0.8812)).length() < 0.2, "{z}");
        }
        // An item that extends 40 points to the right, and one that covers everything.
        let beside = gizmo(1.0, |p| p.x <= 41.0).arrows[0].unwrap().map(|p| p.x - 400.0);
        assert!((beside[0] - 48.0).abs() < 1e-6 && (beside[1] - 117.0).abs() < 0.1, "{beside:?}");
        let inside = gizmo(1.0, |_| true).arrows[0].unwrap();
        assert!((inside[0].x - 400.0 - MAX_ARROW_START_PT).abs() < 1e-6, "{inside:?}");
    }

    #[test]
    fn pick_returns_the_nearest_handle() {
        let gizmo = gizmo(1.0, NOTHING);
        let at = |x: f64, y: f64| gizmo.pick(gizmo.centre + DVec2::new(x, y));
        assert_eq!(at(1.0, 2.0), Some(Handle::Slide));
        assert_eq!(
            (at(84.0, 8.0), at(70.0, 4.0), at(78.0, 8.0)),
            (Some(Handle::Axis(0)), Some(Handle::Axis(0)), Some(Handle::Axis(0)))
        );
        assert_eq!(at(-60.0, 0.0), Some(Handle::Heading));
        assert_eq!(at(68.0, -68.0), Some(Handle::Size));
        // The square lies between x and y: 31 points along both, with y at 45° to the view
        // direction.
        assert_eq!(at(31.0, -21.5), Some(Handle::Ground));
        assert_eq!((at(-30.0, 10.0), at(200.0, 0.0)), (None, None));
    }

    #[test]
    fn handles_along_the_view_direction_are_hidden() {
        let eye = DVec3::new(0.0, 0.0, 2.0);
        // From above: x to the right, y up, z towards the camera.
        let project = |p: DVec3| (p.z < 2.0).then(|| DVec2::new(p.x, -p.y) * 500.0 / (2.0 - p.z));
        let above = Gizmo::new(DVec3::ZERO, DVec3::Z, eye, project, NOTHING).unwrap();
        assert!(above.arrows[2].is_none() && above.arrows[0].is_some() && above.ring.len() == RING_SIDES);
        assert!(above.ring.iter().all(|(p, front)| (p.length() - RING_RADIUS_PT).abs() < 1.0 && *front));
        assert_eq!(Gizmo::new(DVec3::Z * 3.0, DVec3::Z, eye, project, NOTHING), None);
        // At the height of the camera level planes are edge-on.
        let level = |p: DVec3| (p.y > -2.0).then(|| DVec2::new(p.x, -p.z) * 500.0 / (p.y + 2.0));
        let level = Gizmo::new(DVec3::ZERO, DVec3::Z, DVec3::new(0.0, -2.0, 0.0), level, NOTHING).unwrap();
        assert!(level.ring.is_empty() && level.square.is_none() && level.arrows[1].is_none());
        let l = [(0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)].map(DVec2::from);
        assert!(is_inside(DVec2::new(0.5, 2.5), &l) && !is_inside(DVec2::new(2.0, 2.0), &l));
    }
}
