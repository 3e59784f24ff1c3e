//! Modal transform of one item: move, turn or scale, by the pointer or by typed numbers.

use glam::{DVec2, DVec3};

use super::amount::{TypedAmount, Unit};
use super::maths::{
    closest_on_axis_m, distance_ratio, intersect_plane, plane_axes, project_along, screen_angle_rad, signed_angle_rad,
    snapped, unwrapped_angle,
};
use locard_engine::plane::Plane;
use locard_engine::scene::ItemPlacement;
use locard_engine::shot::ViewRay;

/// Kind of a modal transform.
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
    /// Moves in the level plane through the lowest point of the item.
    Level,
    /// `is_local`: the axis is the item's own, otherwise the world's.
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

/// An item at the start of a transform.
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

/// A modal transform of an item.
#[derive(Clone, Debug)]
pub struct Transform {
    pub kind: TransformKind,
    pub constraint: Constraint,
    pub typed: TypedAmount,
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
    /// The plane below the item.
    pub support: Plane,
}

impl Transform {
    pub fn new(kind: TransformKind, constraint: Constraint, start: DragState) -> Self {
        let support = start.support();
        Self {
            kind,
            constraint,
            typed: TypedAmount::default(),
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
mod tests;
