//! Modal transform of one thing: move, turn or scale, by the pointer or by typed numbers. Two
//! fifths of the file are its tests.

use glam::{DVec2, DVec3};

use super::amount::{Typed, Unit};
use super::maths::{
    closest_on_axis_m, distance_ratio, intersect_plane, plane_axes, project_along, screen_angle_rad, signed_angle_rad,
    snapped, unwrapped_angle,
};
use locard_engine::plane::Plane;
use locard_engine::scene::ItemPlacement;
use locard_engine::shot::ViewRay;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransformKind {
    Move,
    Turn,
    Scale,
}

/// Constraint of a transform: the axis or plane of a move or scale, or the axis of a turn. Axes are
/// 0, 1, 2 for x, y, z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Constraint {
    /// Moves over the visible surface, turns about the world's up, scales uniformly.
    Free,
    /// Moves in the level plane through the lowest point of the thing.
    Level,
    /// `is_local`: the axis is the thing's own, otherwise the world's.
    Axis { axis: usize, is_local: bool },
    /// Acts in the plane of the other two axes.
    Plane { axis: usize, is_local: bool },
}

/// Steps while Ctrl is held, m, ° and 1.
const SNAP_STEP_M: f64 = 0.01;
const SNAP_STEP_DEG: f64 = 5.0;
const SNAP_STEP_FACTOR: f64 = 0.1;
/// Steps of the pointer without Ctrl, so that the displayed amount is the exact one.
const FINE_STEP_M: f64 = 1e-4;
const FINE_STEP_DEG: f64 = 0.1;
const FINE_STEP_FACTOR: f64 = 1e-3;
/// Smallest scale factor of one drag.
const MIN_DRAG_FACTOR: f64 = 0.01;

/// Position of the pointer, px of the picture, with its modifiers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pointer {
    pub at_px: DVec2,
    /// Snaps to whole steps.
    pub snaps: bool,
    /// Moves in the level plane instead of over the surface.
    pub level: bool,
}

/// A thing at the start of a transform.
#[derive(Clone, Debug)]
pub struct DragState {
    pub placement: ItemPlacement,
    /// Axes of the model, unit length.
    pub local_axes: [DVec3; 3],
    pub up: DVec3,
    /// Points that include the lowest one, relative to the position, metres. Empty: the position
    /// itself is the support point.
    pub support_points_m: Vec<DVec3>,
    /// Unit normal of the plane of free moves. `None`: free moves follow the visible surface.
    pub free_plane_normal: Option<DVec3>,
    /// Projection of the position, px.
    pub centre_px: DVec2,
    /// Projection of the point that follows the pointer, px.
    pub anchor_px: DVec2,
    /// The pointer, px.
    pub grip_px: DVec2,
}

impl DragState {
    /// Signed distance of the lowest point from the position along a plane's normal, metres: mostly
    /// 0 or less.
    fn lowest_m(&self, normal: DVec3) -> f64 {
        self.support_points_m.iter().map(|p| p.dot(normal)).reduce(f64::min).unwrap_or(0.0)
    }

    /// The level plane through the lowest point.
    pub fn support(&self) -> Plane {
        Plane { point_m: self.placement.position_m + self.up * self.lowest_m(self.up), normal: self.up }
    }
}

/// A modal transform of a thing.
#[derive(Clone, Debug)]
pub struct Transform {
    pub kind: TransformKind,
    pub constraint: Constraint,
    pub typed: Typed,
    start: DragState,
    /// Turns by the pointer's intersection with the plane of the ring handle.
    on_ring: bool,
    /// Translation so far. Stays where the pointer has no intersection.
    moved_m: DVec3,
    /// Unwrapped angle of the pointer.
    unwrapped_rad: f64,
    turned_deg: f64,
    factor: f64,
    support: Plane,
}

/// State of a transform after an update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    pub placement: ItemPlacement,
    /// The plane below the thing.
    pub support: Plane,
}

impl Transform {
    pub fn new(kind: TransformKind, constraint: Constraint, start: DragState) -> Self {
        let support = start.support();
        Self {
            kind,
            constraint,
            typed: Typed::default(),
            start,
            on_ring: false,
            moved_m: DVec3::ZERO,
            unwrapped_rad: 0.0,
            turned_deg: 0.0,
            factor: 1.0,
            support,
        }
    }

    pub fn on_ring(self) -> Self {
        Self { on_ring: true, ..self }
    }

    /// A transform of another kind from the same start, with the pointer at `grip_px`.
    #[must_use]
    pub fn restarted(&self, kind: TransformKind, grip_px: DVec2) -> Self {
        Self::new(kind, Constraint::Free, DragState { grip_px, ..self.start.clone() })
    }

    /// Points along the axis of the constraint, metres of the world.
    pub fn axis_line(&self) -> Option<Vec<DVec3>> {
        let Constraint::Axis { axis, is_local } = self.constraint else { return None };
        let along = self.axis(axis, is_local);
        Some((-60..=60).map(|n| self.start.placement.position_m + along * (0.05 * f64::from(n))).collect())
    }

    /// Cycles the constraint of an axis: world axis, local axis, none. `as_plane`: the plane of the
    /// other two axes.
    pub fn toggle_constraint(&mut self, axis: usize, as_plane: bool) {
        let to = |is_local| {
            if as_plane { Constraint::Plane { axis, is_local } } else { Constraint::Axis { axis, is_local } }
        };
        self.constraint = match self.constraint {
            // Scaling supports local axes only.
            current if self.kind == TransformKind::Scale => {
                if current == to(true) {
                    Constraint::Free
                } else {
                    to(true)
                }
            }
            current if current == to(false) => to(true),
            current if current == to(true) => Constraint::Free,
            _ => to(false),
        };
        self.moved_m = DVec3::ZERO;
        self.unwrapped_rad = 0.0;
        self.turned_deg = 0.0;
        self.factor = 1.0;
    }

    /// Unit of a typed number.
    pub fn unit(&self) -> Unit {
        match self.kind {
            TransformKind::Move => Unit::Length,
            TransformKind::Turn => Unit::Angle,
            TransformKind::Scale => Unit::Factor,
        }
    }

    /// Axis of a typed distance: that of the constraint, by default x or the first axis of the
    /// plane.
    fn typed_axis(&self) -> DVec3 {
        match self.constraint {
            Constraint::Axis { axis, is_local } => self.axis(axis, is_local),
            Constraint::Free => DVec3::X,
            Constraint::Level => plane_axes(self.start.up)[0],
            Constraint::Plane { axis, is_local } => self.axis((axis + 1) % 3, is_local),
        }
    }

    fn axis(&self, axis: usize, is_local: bool) -> DVec3 {
        if is_local { self.start.local_axes[axis] } else { DVec3::AXES[axis] }
    }

    /// Applies the pointer or the typed number. `ray` returns the view ray of a pixel, `surface`
    /// the visible surface there.
    pub fn update(
        &mut self,
        pointer: Pointer,
        ray: impl Fn(DVec2) -> Option<ViewRay>,
        surface: impl FnOnce(DVec2) -> Option<Plane>,
    ) -> Update {
        let start = self.start.placement;
        let typed = self.typed.value(self.unit());
        let up = self.start.up;
        let placement = match self.kind {
            TransformKind::Move => {
                self.update_move(pointer, typed, ray, surface);
                ItemPlacement { position_m: start.position_m + self.moved_m, ..start }
            }
            TransformKind::Turn => {
                let axis = self.turn_axis();
                self.turned_deg = typed.unwrap_or_else(|| self.pointer_turn_deg(axis, pointer, ray));
                start.turned(axis, self.turned_deg, up)
            }
            TransformKind::Scale => {
                let (centre, grip) = (self.start.centre_px, self.start.grip_px);
                let by_pointer = || {
                    let step = if pointer.snaps { SNAP_STEP_FACTOR } else { FINE_STEP_FACTOR };
                    distance_ratio(centre, grip, pointer.at_px).map(|factor| snapped(factor, step).max(MIN_DRAG_FACTOR))
                };
                let typed = typed.filter(|factor| *factor > 0.0);
                self.factor = typed.or_else(by_pointer).unwrap_or(self.factor);
                let mut factors = DVec3::ONE;
                match self.constraint {
                    Constraint::Axis { axis, .. } => factors[axis] = self.factor,
                    Constraint::Plane { axis, .. } => {
                        factors = DVec3::splat(self.factor);
                        factors[axis] = 1.0;
                    }
                    Constraint::Free | Constraint::Level => factors = DVec3::splat(self.factor),
                }
                start.scaled(factors)
            }
        };
        Update { placement, support: self.support }
    }

    /// Translates by the typed distance, or to the pointer.
    fn update_move(
        &mut self,
        pointer: Pointer,
        typed: Option<f64>,
        ray: impl Fn(DVec2) -> Option<ViewRay>,
        surface: impl FnOnce(DVec2) -> Option<Plane>,
    ) {
        let (start, up) = (self.start.placement.position_m, self.start.up);
        let step = if pointer.snaps { SNAP_STEP_M } else { FINE_STEP_M };
        let at = self.start.anchor_px + pointer.at_px - self.start.grip_px;
        let start_support = self.start.support();
        self.support = start_support;
        if typed.is_none() && pointer.at_px == self.start.grip_px {
            self.moved_m = DVec3::ZERO;
            return;
        }
        let line = match self.constraint {
            Constraint::Axis { axis, is_local } => Some(self.axis(axis, is_local)),
            _ => typed.map(|_| self.typed_axis()),
        };
        if let Some(axis) = line {
            let along_m = |px| ray(px).and_then(|ray| closest_on_axis_m(&ray, start, axis));
            let by_pointer = || Some(snapped(along_m(at)? - along_m(self.start.anchor_px)?, step));
            if let Some(amount_m) = typed.or_else(by_pointer) {
                self.moved_m = axis * amount_m;
            }
            return;
        }
        if self.constraint == Constraint::Free
            && !pointer.level
            && self.start.free_plane_normal.is_none()
            && let Some(plane) = surface(at)
        {
            let in_contact = plane.point_m - plane.normal * self.start.lowest_m(plane.normal);
            let mut position = in_contact;
            if pointer.snaps {
                let [a, b] = plane_axes(up);
                let by = in_contact - start;
                let level = a * snapped(by.dot(a), step) + b * snapped(by.dot(b), step);
                let parallel = Plane { point_m: in_contact, normal: plane.normal };
                position = project_along(&parallel, start + level, up).unwrap_or(in_contact);
            }
            self.moved_m = (position - start).map(|m| snapped(m, FINE_STEP_M));
            self.support = plane;
            return;
        }
        let normal = match self.constraint {
            Constraint::Plane { axis, is_local } => self.axis(axis, is_local),
            Constraint::Free if !pointer.level => self.start.free_plane_normal.unwrap_or(up),
            _ => up,
        };
        let plane = Plane { normal, ..start_support };
        let on_plane = |px| ray(px).and_then(|ray| intersect_plane(&plane, &ray));
        if let (Some(from), Some(to)) = (on_plane(self.start.anchor_px), on_plane(at)) {
            let by = to - from;
            let [a, b] = plane_axes(normal);
            self.moved_m = a * snapped(by.dot(a), step) + b * snapped(by.dot(b), step);
        }
    }

    fn turn_axis(&self) -> DVec3 {
        match self.constraint {
            Constraint::Free | Constraint::Level => self.start.up,
            Constraint::Axis { axis, is_local } | Constraint::Plane { axis, is_local } => self.axis(axis, is_local),
        }
    }

    fn pointer_turn_deg(&mut self, axis: DVec3, pointer: Pointer, ray: impl Fn(DVec2) -> Option<ViewRay>) -> f64 {
        let DragState { centre_px, grip_px, placement, .. } = self.start;
        let plane = Plane { point_m: placement.position_m, normal: axis };
        let on_plane = |px| ray(px).and_then(|ray| intersect_plane(&plane, &ray));
        let in_plane = || signed_angle_rad(axis, placement.position_m, on_plane(grip_px)?, on_plane(pointer.at_px)?);
        let by_ring = if self.on_ring { in_plane() } else { None };
        let on_screen = || {
            // An axis that points away from the camera is seen from below.
            let away = ray(centre_px)?.direction.dot(axis) > 0.0;
            let turn = screen_angle_rad(centre_px, grip_px, pointer.at_px)?;
            Some(if away { -turn } else { turn })
        };
        if let Some(turn) = by_ring.or_else(on_screen) {
            self.unwrapped_rad = unwrapped_angle(turn, self.unwrapped_rad);
        }
        snapped(self.unwrapped_rad.to_degrees(), if pointer.snaps { SNAP_STEP_DEG } else { FINE_STEP_DEG })
    }

    /// Amount of the transform: metres along the axis or in a straight line, degrees, or a factor.
    pub fn amount(&self) -> f64 {
        match (self.kind, self.constraint) {
            (TransformKind::Move, Constraint::Axis { axis, is_local }) => self.moved_m.dot(self.axis(axis, is_local)),
            (TransformKind::Move, _) if !self.typed.is_empty() => self.moved_m.dot(self.typed_axis()),
            (TransformKind::Move, _) => self.moved_m.length(),
            (TransformKind::Turn, _) => self.turned_deg,
            (TransformKind::Scale, _) => self.factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::labels::{history, status};
    use super::*;
    use glam::DQuat;
    use locard_engine::scene::Size;

    /// View from above: 1 px is 1 cm, the world's y points up in the picture.
    fn from_above(px: DVec2) -> Option<ViewRay> {
        Some(ViewRay { origin_m: DVec3::new(0.01 * px.x, -0.01 * px.y, 2.0), direction: DVec3::NEG_Z })
    }

    /// View from the side, along y.
    fn from_the_side(px: DVec2) -> Option<ViewRay> {
        Some(ViewRay { origin_m: DVec3::new(0.01 * px.x, -2.0, -0.01 * px.y), direction: DVec3::Y })
    }

    /// A thing 1 m above the floor at (1, 0), with its origin 2 cm above its lowest point. Its
    /// local x is the world's y.
    fn start() -> DragState {
        let placement = ItemPlacement {
            position_m: DVec3::new(1.0, 0.0, 1.02),
            rotation: DQuat::IDENTITY,
            heading_deg: 90.0,
            size: Size::Scale(DVec3::ONE),
        };
        let local_axes = [DVec3::Y, DVec3::NEG_X, DVec3::Z];
        let support_points_m = vec![DVec3::new(0.1, 0.0, -0.02), DVec3::new(-0.1, 0.0, -0.01)];
        let px = DVec2::new(100.0, 0.0);
        DragState {
            placement,
            local_axes,
            up: DVec3::Z,
            support_points_m,
            free_plane_normal: None,
            centre_px: px,
            anchor_px: px,
            grip_px: DVec2::new(150.0, 0.0),
        }
    }

    fn pointer(x: f64, y: f64) -> Pointer {
        Pointer { at_px: DVec2::new(x, y), snaps: false, level: false }
    }

    const NO_DEPTH: fn(DVec2) -> Option<Plane> = |_| None;

    fn typed(transform: &mut Transform, text: &str) {
        text.chars().for_each(|c| transform.typed.push(c));
    }

    #[test]
    fn free_move_without_depth_is_level_and_typed_moves_follow_an_axis() {
        let mut transform = Transform::new(TransformKind::Move, Constraint::Free, start());
        let update = transform.update(pointer(153.2, -4.0), from_above, NO_DEPTH);
        assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.032, 0.04, 1.02), 1e-9), "{update:?}");
        assert_eq!((history(&transform), status(&transform)), ("moved 5.12 cm".to_owned(), "Move: 5.12 cm".to_owned()));
        assert_eq!(update.support, Plane { point_m: DVec3::new(1.0, 0.0, 1.0), normal: DVec3::Z });
        // Whole centimetres.
        let snapping = Pointer { snaps: true, ..pointer(153.2, -4.4) };
        let update = transform.update(snapping, from_above, NO_DEPTH);
        assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.03, 0.04, 1.02), 1e-9), "{update:?}");
        // Typed distance: along x by default, then along the local x, which is the world's y.
        typed(&mut transform, "-0,1");
        let at = |transform: &mut Transform| {
            transform.update(pointer(999.0, 7.0), from_above, NO_DEPTH).placement.position_m
        };
        assert!(at(&mut transform).abs_diff_eq(DVec3::new(0.9, 0.0, 1.02), 1e-12));
        assert_eq!(status(&transform), "Move along x: [-0,1]  -10 cm");
        transform.toggle_constraint(0, false);
        transform.toggle_constraint(0, false);
        assert!(at(&mut transform).abs_diff_eq(DVec3::new(1.0, -0.1, 1.02), 1e-12));
        assert_eq!(status(&transform), "Move along its own x: [-0,1]  -10 cm");
        transform.toggle_constraint(0, false);
        assert_eq!(transform.constraint, Constraint::Free);
    }

    #[test]
    fn free_move_keeps_the_lowest_point_on_the_surface() {
        // A slope with a gradient of 3/4 along x, through (0, 0, 2).
        let normal = DVec3::new(-0.6, 0.0, 0.8);
        let slope = |px: DVec2| {
            let x = 0.01 * px.x;
            Some(Plane { point_m: DVec3::new(x, -0.01 * px.y, 2.0 + 0.75 * x), normal })
        };
        let mut transform = Transform::new(TransformKind::Move, Constraint::Free, start());
        // The grip is 50 px beside the anchor: 200 px is x = 1.5 m.
        let update = transform.update(pointer(200.0, 0.0), from_above, slope);
        let position = update.placement.position_m;
        // The lowest point lies 0.1 · 0.6 + 0.02 · 0.8 = 0.076 m below the position, against the
        // normal.
        assert!(position.abs_diff_eq(DVec3::new(1.5 - 0.0456, 0.0, 3.125 + 0.0608), 1e-4), "{position}");
        assert!((slope(DVec2::ZERO).unwrap().point_m - position).dot(normal) + 0.076 < 1e-4);
        assert_eq!(update.support.normal, normal);
        // Shift: level, regardless of the surface.
        let level = Pointer { level: true, ..pointer(200.0, 0.0) };
        let update = transform.update(level, from_above, slope);
        assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.5, 0.0, 1.02), 1e-9), "{update:?}");
        // Whole centimetres from the start, projected onto the slope.
        let snapping = Pointer { snaps: true, ..pointer(200.0, 0.0) };
        let position = transform.update(snapping, from_above, slope).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.45, 0.0, 3.1858 - 0.0044 * 0.75), 2e-4), "{position}");
    }

    #[test]
    fn free_move_with_a_plane_normal_ignores_the_surface_behind() {
        let floor = |px: DVec2| Some(Plane { point_m: DVec3::new(0.01 * px.x, 9.0, 0.0), normal: DVec3::Z });
        let at_px = DVec2::new(100.0, -102.0);
        let hanging = DragState {
            support_points_m: Vec::new(),
            free_plane_normal: Some(DVec3::NEG_Y),
            anchor_px: at_px,
            grip_px: at_px,
            ..start()
        };
        let mut transform = Transform::new(TransformKind::Move, Constraint::Free, hanging);
        // 50 px to the right and 30.04 px up; 1 px is 1 cm.
        let position = transform.update(pointer(150.0, -132.04), from_the_side, floor).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.5, 0.0, 1.3204), 1e-9), "{position}");
        let snapping = Pointer { snaps: true, ..pointer(150.3, -132.04) };
        let position = transform.update(snapping, from_the_side, floor).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.5, 0.0, 1.32), 1e-9), "{position}");
        // Shift: the level plane is edge-on from the side, so that the thing stays; from above it
        // follows.
        let level = Pointer { level: true, ..pointer(170.0, -102.0) };
        assert_eq!(transform.update(level, from_the_side, floor).placement.position_m, position);
        let position = transform.update(level, from_above, floor).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.7, 0.0, 1.02), 1e-9), "{position}");
    }

    #[test]
    fn axis_constrained_move_follows_the_pointer_along_the_axis_only() {
        let mut transform = Transform::new(TransformKind::Move, Constraint::Axis { axis: 2, is_local: false }, start());
        let mut side = start();
        side.anchor_px = DVec2::new(100.0, -102.0);
        transform.start = side;
        let update = transform.update(pointer(180.0, -25.04), from_the_side, NO_DEPTH);
        // 25.04 px above the grip.
        assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.0, 0.0, 1.2704), 1e-9), "{update:?}");
        assert_eq!(status(&transform), "Move along z: 25.04 cm");
        // A view along the axis: the thing stays.
        let same = transform.update(pointer(300.0, 0.0), from_above, NO_DEPTH);
        assert_eq!(same.placement, update.placement);
        // The plane of x and z: from the side y does not move.
        transform.toggle_constraint(1, true);
        assert_eq!(transform.constraint, Constraint::Plane { axis: 1, is_local: false });
        let update = transform.update(pointer(160.0, -20.0), from_the_side, NO_DEPTH);
        assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.1, 0.0, 1.22), 1e-9), "{update:?}");
    }

    #[test]
    fn turn_follows_the_pointer_on_screen_or_on_the_ring() {
        let mut transform = Transform::new(TransformKind::Turn, Constraint::Free, start());
        let mut turned = |x: f64, y: f64, snaps| {
            let update = transform.update(Pointer { snaps, ..pointer(x, y) }, from_above, NO_DEPTH);
            update.placement.heading_deg - 90.0
        };
        // From the right over the top to the left and on to below: 90°, 180°, 270°.
        assert!((turned(100.0, -50.0, false) - 90.0).abs() < 1e-9);
        assert!((turned(50.0, -1e-6, false).abs() - 90.0).abs() < 1e-9 || turned(50.0, -1e-6, false).abs() < 360.0);
        turned(100.0, 50.0, false);
        let steps = Pointer { snaps: true, ..pointer(104.0, 50.0) };
        transform.update(steps, from_above, NO_DEPTH);
        assert_eq!(
            (history(&transform), status(&transform)),
            ("turned 275°".to_owned(), "Turn about up: 275°".to_owned())
        );
        // From below the same motion of the pointer turns the other way.
        let from_below = |px: DVec2| Some(ViewRay { origin_m: DVec3::new(px.x, px.y, -9.0), direction: DVec3::Z });
        let mut below = Transform::new(TransformKind::Turn, Constraint::Free, start());
        below.update(pointer(100.0, -50.0), from_below, NO_DEPTH);
        assert_eq!(status(&below), "Turn about up: -90°");
        // On a ring seen at 30°, 50 px to the right and 25 px up are 45°.
        let sin = 0.5f64;
        let oblique = |px: DVec2| {
            let direction = DVec3::new(0.0, 0.75f64.sqrt(), -sin);
            let up = DVec3::new(0.0, sin, 0.75f64.sqrt());
            let middle = DVec3::new(1.0, 0.0, 1.02) - 5.0 * direction;
            Some(ViewRay { origin_m: middle + 0.01 * (DVec3::X * (px.x - 100.0) - up * px.y), direction })
        };
        let mut ring = Transform::new(TransformKind::Turn, Constraint::Free, start()).on_ring();
        ring.update(pointer(150.0, -25.0), oblique, NO_DEPTH);
        assert_eq!(status(&ring), "Turn about up: 45°");
        // A typed turn about the world's x: the heading stays.
        ring.toggle_constraint(0, false);
        typed(&mut ring, "45");
        let placement = ring.update(pointer(0.0, 0.0), oblique, NO_DEPTH).placement;
        assert_eq!((placement.heading_deg, status(&ring).as_str()), (90.0, "Turn about x: [45]  45°"));
        let heading = DQuat::from_rotation_z(90f64.to_radians());
        let whole = heading * placement.rotation * DVec3::Y;
        // The local y was the world's −x, which the turn leaves; the local x rises.
        assert!(whole.abs_diff_eq(DVec3::NEG_X, 1e-9), "{whole}");
        let rises = heading * placement.rotation * DVec3::X;
        assert!(rises.abs_diff_eq(DVec3::new(0.0, 0.5f64.sqrt(), 0.5f64.sqrt()), 1e-9), "{rises}");
    }

    #[test]
    fn scale_factor_is_the_ratio_of_pointer_distances() {
        let mut transform = Transform::new(TransformKind::Scale, Constraint::Free, start());
        let size = |transform: &mut Transform, x: f64, snaps| {
            transform.update(Pointer { snaps, ..pointer(x, 0.0) }, from_above, NO_DEPTH).placement.size
        };
        assert_eq!(size(&mut transform, 200.0, false), Size::Scale(DVec3::splat(2.0)));
        assert_eq!(size(&mut transform, 161.0, true), Size::Scale(DVec3::splat(1.2)));
        assert_eq!(
            (history(&transform), size(&mut transform, 100.0, false)),
            ("scaled to 120 %".into(), Size::Scale(DVec3::splat(MIN_DRAG_FACTOR)))
        );
        transform.toggle_constraint(1, false);
        typed(&mut transform, "50%");
        assert_eq!(size(&mut transform, 0.0, false), Size::Scale(DVec3::new(1.0, 0.5, 1.0)));
        assert_eq!(status(&transform), "Scale along its own y: [50%]  50 %");
    }
}
