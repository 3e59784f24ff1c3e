//! Moving, turning and scaling one thing: from the pointer's way, or from typed numbers, to where it stands.

use glam::{DVec2, DVec3};

use super::amount::{Typed, Unit};
use super::maths::{Plane, along_axis, along_plane, growth, snapped, turn_about, turn_on_screen, wound};
use locard_engine::scene::ItemPlacement;
use locard_engine::shot::Ray;

/// What is done to a thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Move,
    Turn,
    Scale,
}

/// Along what it is moved or scaled, or about what it is turned. Axes are 0, 1, 2 for x, y, z: the world's, or the
/// thing's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Along {
    /// Moved over the surface that is seen, turned about the world's up, scaled alike in all directions.
    Free,
    /// Moved in the level plane that it stands on.
    Level,
    Axis {
        axis: usize,
        own: bool,
    },
    /// In the plane of the other two.
    Without {
        axis: usize,
        own: bool,
    },
}

/// Steps while Ctrl is held, m, ° and 1.
const STEP_M: f64 = 0.01;
const STEP_DEG: f64 = 5.0;
const STEP_FACTOR: f64 = 0.1;
/// A pointer's amounts are no finer, so that what is told is what is done.
const FINEST_M: f64 = 1e-4;
const FINEST_DEG: f64 = 0.1;
const FINEST_FACTOR: f64 = 1e-3;
/// A pointer makes nothing smaller, in one go.
const LEAST_FACTOR: f64 = 0.01;

/// Where the pointer is, px of the picture, and what is held with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pointer {
    pub at_px: DVec2,
    /// Whole steps.
    pub snaps: bool,
    /// Not over the surface: level.
    pub level: bool,
}

/// A thing as it is taken hold of.
#[derive(Clone, Debug)]
pub struct Held {
    pub placement: ItemPlacement,
    /// The axes of its model, unit length.
    pub own: [DVec3; 3],
    pub up: DVec3,
    /// Points that its lowest one is among, from its position, metres. Empty: its position is what stands.
    pub feet_m: Vec<DVec3>,
    /// It hangs: what it is freely moved in is the plane with this normal, unit length. `None`: over the surface that is seen.
    pub hangs: Option<DVec3>,
    /// Where its position, or the handle that holds it, and the pointer are seen, px.
    pub centre_px: DVec2,
    pub anchor_px: DVec2,
    pub grip_px: DVec2,
}

impl Held {
    /// How far its lowest point lies from its position against a plane's normal, metres: 0 or less for most.
    fn below_m(&self, normal: DVec3) -> f64 {
        self.feet_m.iter().map(|p| p.dot(normal)).reduce(f64::min).unwrap_or(0.0)
    }

    /// The level plane that it stands on.
    pub fn support(&self) -> Plane {
        Plane { point_m: self.placement.position_m + self.up * self.below_m(self.up), normal: self.up }
    }
}

/// One go at moving a thing, from taking hold of it to letting go.
#[derive(Clone, Debug)]
pub struct Tool {
    pub kind: Kind,
    pub along: Along,
    pub typed: Typed,
    held: Held,
    /// Turned with the pointer on a ring around it, which is where the ring is in the room.
    on_ring: bool,
    /// What it has come to: kept where the pointer points to nothing.
    moved_m: DVec3,
    /// As the pointer went round, whole turns counted.
    wound_rad: f64,
    turned_deg: f64,
    factor: f64,
    support: Plane,
}

/// What a go has come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    pub placement: ItemPlacement,
    /// What it stands on, or stood on.
    pub support: Plane,
}

impl Tool {
    pub fn new(kind: Kind, along: Along, held: Held) -> Self {
        let support = held.support();
        Self {
            kind,
            along,
            typed: Typed::default(),
            held,
            on_ring: false,
            moved_m: DVec3::ZERO,
            wound_rad: 0.0,
            turned_deg: 0.0,
            factor: 1.0,
            support,
        }
    }

    pub fn on_ring(self) -> Self {
        Self { on_ring: true, ..self }
    }

    /// Another kind of change of the same thing as it was, from where the pointer is now.
    #[must_use]
    pub fn again(&self, kind: Kind, grip_px: DVec2) -> Self {
        Self::new(kind, Along::Free, Held { grip_px, ..self.held.clone() })
    }

    /// Places along the axis that it is moved along, scaled along or turned about, metres of the world.
    pub fn line(&self) -> Option<Vec<DVec3>> {
        let Along::Axis { axis, own } = self.along else { return None };
        let along = self.axis(axis, own);
        Some((-60..=60).map(|n| self.held.placement.position_m + along * (0.05 * f64::from(n))).collect())
    }

    /// A key of an axis: the world's, at the second time the thing's own, at the third none. `without`: all but it.
    pub fn constrain(&mut self, axis: usize, without: bool) {
        let of = |own| if without { Along::Without { axis, own } } else { Along::Axis { axis, own } };
        self.along = match self.along {
            // A thing is scaled along its own axes alone.
            along if self.kind == Kind::Scale => {
                if along == of(true) {
                    Along::Free
                } else {
                    of(true)
                }
            }
            along if along == of(false) => of(true),
            along if along == of(true) => Along::Free,
            _ => of(false),
        };
        (self.moved_m, self.wound_rad, self.turned_deg, self.factor) = (DVec3::ZERO, 0.0, 0.0, 1.0);
    }

    /// A typed number's unit.
    pub fn unit(&self) -> Unit {
        match self.kind {
            Kind::Move => Unit::Length,
            Kind::Turn => Unit::Angle,
            Kind::Scale => Unit::Factor,
        }
    }

    /// What a typed number counts along where no axis was said: x, or the next in its plane.
    fn typed_axis(&self) -> DVec3 {
        match self.along {
            Along::Axis { axis, own } => self.axis(axis, own),
            Along::Free => DVec3::X,
            Along::Level => along_plane(self.held.up)[0],
            Along::Without { axis, own } => self.axis((axis + 1) % 3, own),
        }
    }

    fn axis(&self, axis: usize, own: bool) -> DVec3 {
        if own { self.held.own[axis] } else { DVec3::AXES[axis] }
    }

    /// Where the thing stands now. `ray` gives a place's line of sight, `surface` the surface that is seen there.
    pub fn reach(
        &mut self,
        pointer: Pointer,
        ray: impl Fn(DVec2) -> Option<Ray>,
        surface: impl FnOnce(DVec2) -> Option<Plane>,
    ) -> Reached {
        let start = self.held.placement;
        let typed = self.typed.value(self.unit());
        let up = self.held.up;
        let placement = match self.kind {
            Kind::Move => {
                self.follow(pointer, typed, ray, surface);
                ItemPlacement { position_m: start.position_m + self.moved_m, ..start }
            }
            Kind::Turn => {
                let axis = self.turn_axis();
                self.turned_deg = typed.unwrap_or_else(|| self.turn(axis, pointer, ray));
                start.turned(axis, self.turned_deg, up)
            }
            Kind::Scale => {
                let (centre, grip) = (self.held.centre_px, self.held.grip_px);
                let by_pointer = || {
                    let step = if pointer.snaps { STEP_FACTOR } else { FINEST_FACTOR };
                    growth(centre, grip, pointer.at_px).map(|factor| snapped(factor, step).max(LEAST_FACTOR))
                };
                // Nothing and less are nothing to look at.
                let typed = typed.filter(|factor| *factor > 0.0);
                self.factor = typed.or_else(by_pointer).unwrap_or(self.factor);
                let mut factors = DVec3::ONE;
                match self.along {
                    Along::Axis { axis, .. } => factors[axis] = self.factor,
                    Along::Without { axis, .. } => {
                        factors = DVec3::splat(self.factor);
                        factors[axis] = 1.0;
                    }
                    Along::Free | Along::Level => factors = DVec3::splat(self.factor),
                }
                start.scaled(factors)
            }
        };
        Reached { placement, support: self.support }
    }

    /// Moves it by what was typed, or to where the pointer is.
    fn follow(
        &mut self,
        pointer: Pointer,
        typed: Option<f64>,
        ray: impl Fn(DVec2) -> Option<Ray>,
        surface: impl FnOnce(DVec2) -> Option<Plane>,
    ) {
        let (start, up) = (self.held.placement.position_m, self.held.up);
        let step = if pointer.snaps { STEP_M } else { FINEST_M };
        let at = self.held.anchor_px + pointer.at_px - self.held.grip_px;
        let standing = self.held.support();
        self.support = standing;
        if typed.is_none() && pointer.at_px == self.held.grip_px {
            self.moved_m = DVec3::ZERO;
            return;
        }
        let line = match self.along {
            Along::Axis { axis, own } => Some(self.axis(axis, own)),
            _ => typed.map(|_| self.typed_axis()),
        };
        if let Some(axis) = line {
            let along = |px| ray(px).and_then(|ray| along_axis(&ray, start, axis));
            let pointed = || Some(snapped(along(at)? - along(self.held.anchor_px)?, step));
            if let Some(amount_m) = typed.or_else(pointed) {
                self.moved_m = axis * amount_m;
            }
            return;
        }
        if self.along == Along::Free
            && !pointer.level
            && self.held.hangs.is_none()
            && let Some(plane) = surface(at)
        {
            let stands = plane.point_m - plane.normal * self.held.below_m(plane.normal);
            let mut position = stands;
            if pointer.snaps {
                let [a, b] = along_plane(up);
                let by = stands - start;
                let level = a * snapped(by.dot(a), step) + b * snapped(by.dot(b), step);
                let over = Plane { point_m: stands, normal: plane.normal };
                position = over.beneath(start + level, up).unwrap_or(stands);
            }
            self.moved_m = (position - start).map(|m| snapped(m, FINEST_M));
            self.support = plane;
            return;
        }
        let normal = match self.along {
            Along::Without { axis, own } => self.axis(axis, own),
            Along::Free if !pointer.level => self.held.hangs.unwrap_or(up),
            _ => up,
        };
        let plane = Plane { normal, ..standing };
        let on = |px| ray(px).and_then(|ray| plane.seen_at(&ray));
        if let (Some(from), Some(to)) = (on(self.held.anchor_px), on(at)) {
            let by = to - from;
            let [a, b] = along_plane(normal);
            self.moved_m = a * snapped(by.dot(a), step) + b * snapped(by.dot(b), step);
        }
    }

    fn turn_axis(&self) -> DVec3 {
        match self.along {
            Along::Free | Along::Level => self.held.up,
            Along::Axis { axis, own } | Along::Without { axis, own } => self.axis(axis, own),
        }
    }

    fn turn(&mut self, axis: DVec3, pointer: Pointer, ray: impl Fn(DVec2) -> Option<Ray>) -> f64 {
        let Held { centre_px, grip_px, placement, .. } = self.held;
        let plane = Plane { point_m: placement.position_m, normal: axis };
        let on = |px| ray(px).and_then(|ray| plane.seen_at(&ray));
        let round = || turn_about(axis, placement.position_m, on(grip_px)?, on(pointer.at_px)?);
        let by_ring = if self.on_ring { round() } else { None };
        let on_screen = || {
            // What points away from the eye is seen from below.
            let away = ray(centre_px)?.direction.dot(axis) > 0.0;
            let turn = turn_on_screen(centre_px, grip_px, pointer.at_px)?;
            Some(if away { -turn } else { turn })
        };
        if let Some(turn) = by_ring.or_else(on_screen) {
            self.wound_rad = wound(turn, self.wound_rad);
        }
        snapped(self.wound_rad.to_degrees(), if pointer.snaps { STEP_DEG } else { FINEST_DEG })
    }

    /// How far it is: metres along its line, or as the crow flies; degrees; a factor.
    pub fn amount(&self) -> f64 {
        match (self.kind, self.along) {
            (Kind::Move, Along::Axis { axis, own }) => self.moved_m.dot(self.axis(axis, own)),
            (Kind::Move, _) if !self.typed.is_empty() => self.moved_m.dot(self.typed_axis()),
            (Kind::Move, _) => self.moved_m.length(),
            (Kind::Turn, _) => self.turned_deg,
            (Kind::Scale, _) => self.factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::words::{done, told};
    use super::*;
    use glam::DQuat;
    use locard_engine::scene::Size;

    /// Seen from above, a px a centimetre, y of the world upwards.
    fn from_above(px: DVec2) -> Option<Ray> {
        Some(Ray { origin_m: DVec3::new(0.01 * px.x, -0.01 * px.y, 2.0), direction: DVec3::NEG_Z })
    }

    /// Seen from the side, along y.
    fn from_the_side(px: DVec2) -> Option<Ray> {
        Some(Ray { origin_m: DVec3::new(0.01 * px.x, -2.0, -0.01 * px.y), direction: DVec3::Y })
    }

    /// Stands 1 m above the floor at (1, 0); its origin is 2 cm above its foot. Its own x is the world's y.
    fn held() -> Held {
        let placement = ItemPlacement {
            position_m: DVec3::new(1.0, 0.0, 1.02),
            rotation: DQuat::IDENTITY,
            heading_deg: 90.0,
            size: Size::Scale(DVec3::ONE),
        };
        let own = [DVec3::Y, DVec3::NEG_X, DVec3::Z];
        let feet_m = vec![DVec3::new(0.1, 0.0, -0.02), DVec3::new(-0.1, 0.0, -0.01)];
        let px = DVec2::new(100.0, 0.0);
        Held {
            placement,
            own,
            up: DVec3::Z,
            feet_m,
            hangs: None,
            centre_px: px,
            anchor_px: px,
            grip_px: DVec2::new(150.0, 0.0),
        }
    }

    fn pointer(x: f64, y: f64) -> Pointer {
        Pointer { at_px: DVec2::new(x, y), snaps: false, level: false }
    }

    const NO_DEPTH: fn(DVec2) -> Option<Plane> = |_| None;

    fn typed(tool: &mut Tool, text: &str) {
        text.chars().for_each(|c| tool.typed.push(c));
    }

    #[test]
    fn without_depth_it_moves_level_and_along_an_axis_by_what_is_typed() {
        let mut tool = Tool::new(Kind::Move, Along::Free, held());
        let reached = tool.reach(pointer(153.2, -4.0), from_above, NO_DEPTH);
        assert!(reached.placement.position_m.abs_diff_eq(DVec3::new(1.032, 0.04, 1.02), 1e-9), "{reached:?}");
        assert_eq!((done(&tool), told(&tool)), ("moved 5.12 cm".to_owned(), "Move: 5.12 cm".to_owned()));
        assert_eq!(reached.support, Plane { point_m: DVec3::new(1.0, 0.0, 1.0), normal: DVec3::Z });
        // In whole centimetres.
        let snapping = Pointer { snaps: true, ..pointer(153.2, -4.4) };
        let reached = tool.reach(snapping, from_above, NO_DEPTH);
        assert!(reached.placement.position_m.abs_diff_eq(DVec3::new(1.03, 0.04, 1.02), 1e-9), "{reached:?}");
        // Typed: along x where no axis was said, then along its own x, which is the world's y.
        typed(&mut tool, "-0,1");
        let at = |tool: &mut Tool| tool.reach(pointer(999.0, 7.0), from_above, NO_DEPTH).placement.position_m;
        assert!(at(&mut tool).abs_diff_eq(DVec3::new(0.9, 0.0, 1.02), 1e-12));
        assert_eq!(told(&tool), "Move along x: [-0,1]  -10 cm");
        tool.constrain(0, false);
        tool.constrain(0, false);
        assert!(at(&mut tool).abs_diff_eq(DVec3::new(1.0, -0.1, 1.02), 1e-12));
        assert_eq!(told(&tool), "Move along its own x: [-0,1]  -10 cm");
        tool.constrain(0, false);
        assert_eq!(tool.along, Along::Free);
    }

    #[test]
    fn it_slides_over_the_surface_and_its_lowest_point_touches() {
        // A slope that rises along x, 3 in 4, through (0, 0, 2).
        let normal = DVec3::new(-0.6, 0.0, 0.8);
        let slope = |px: DVec2| {
            let x = 0.01 * px.x;
            Some(Plane { point_m: DVec3::new(x, -0.01 * px.y, 2.0 + 0.75 * x), normal })
        };
        let mut tool = Tool::new(Kind::Move, Along::Free, held());
        // The pointer holds it 50 px beside where it stands: 200 px is x = 1.5 m.
        let reached = tool.reach(pointer(200.0, 0.0), from_above, slope);
        let position = reached.placement.position_m;
        // Its feet reach 0.1 · 0.6 + 0.02 · 0.8 = 0.076 m below it, against the normal.
        assert!(position.abs_diff_eq(DVec3::new(1.5 - 0.0456, 0.0, 3.125 + 0.0608), 1e-4), "{position}");
        assert!((slope(DVec2::ZERO).unwrap().point_m - position).dot(normal) + 0.076 < 1e-4);
        assert_eq!(reached.support.normal, normal);
        // Shift: level, whatever is seen there.
        let level = Pointer { level: true, ..pointer(200.0, 0.0) };
        let reached = tool.reach(level, from_above, slope);
        assert!(reached.placement.position_m.abs_diff_eq(DVec3::new(1.5, 0.0, 1.02), 1e-9), "{reached:?}");
        // Whole centimetres from where it began, and on the slope there.
        let snapping = Pointer { snaps: true, ..pointer(200.0, 0.0) };
        let position = tool.reach(snapping, from_above, slope).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.45, 0.0, 3.1858 - 0.0044 * 0.75), 2e-4), "{position}");
    }

    #[test]
    fn what_hangs_is_moved_in_the_plane_that_faces_the_eye_whatever_is_seen_behind() {
        let floor = |px: DVec2| Some(Plane { point_m: DVec3::new(0.01 * px.x, 9.0, 0.0), normal: DVec3::Z });
        let side =
            || Held { feet_m: Vec::new(), hangs: Some(DVec3::NEG_Y), grip_px: DVec2::new(100.0, -102.0), ..held() };
        let mut tool = Tool::new(Kind::Move, Along::Free, Held { anchor_px: DVec2::new(100.0, -102.0), ..side() });
        // 50 px to the right and 30.04 up, a px a centimetre.
        let position = tool.reach(pointer(150.0, -132.04), from_the_side, floor).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.5, 0.0, 1.3204), 1e-9), "{position}");
        let snapping = Pointer { snaps: true, ..pointer(150.3, -132.04) };
        let position = tool.reach(snapping, from_the_side, floor).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.5, 0.0, 1.32), 1e-9), "{position}");
        // Shift: level, which is seen edge-on from the side, so that it stays; from above it follows.
        let level = Pointer { level: true, ..pointer(170.0, -102.0) };
        assert_eq!(tool.reach(level, from_the_side, floor).placement.position_m, position);
        let position = tool.reach(level, from_above, floor).placement.position_m;
        assert!(position.abs_diff_eq(DVec3::new(1.7, 0.0, 1.02), 1e-9), "{position}");
    }

    #[test]
    fn an_axis_takes_the_pointers_way_along_it_alone() {
        let mut tool = Tool::new(Kind::Move, Along::Axis { axis: 2, own: false }, held());
        let mut side = held();
        side.anchor_px = DVec2::new(100.0, -102.0);
        tool.held = side;
        let reached = tool.reach(pointer(180.0, -25.04), from_the_side, NO_DEPTH);
        // 25.04 px up from where it was taken hold of.
        assert!(reached.placement.position_m.abs_diff_eq(DVec3::new(1.0, 0.0, 1.2704), 1e-9), "{reached:?}");
        assert_eq!(told(&tool), "Move along z: 25.04 cm");
        // Looked along: it stays where it was.
        let same = tool.reach(pointer(300.0, 0.0), from_above, NO_DEPTH);
        assert_eq!(same.placement, reached.placement);
        // All but x: in the plane that is seen edge-on from above it stays, too; from the side y does not move.
        tool.constrain(1, true);
        assert_eq!(tool.along, Along::Without { axis: 1, own: false });
        let reached = tool.reach(pointer(160.0, -20.0), from_the_side, NO_DEPTH);
        assert!(reached.placement.position_m.abs_diff_eq(DVec3::new(1.1, 0.0, 1.22), 1e-9), "{reached:?}");
    }

    #[test]
    fn a_turn_follows_the_pointer_round_and_its_ring_where_that_is_seen() {
        let mut tool = Tool::new(Kind::Turn, Along::Free, held());
        let mut turned = |x: f64, y: f64, snaps| {
            let reached = tool.reach(Pointer { snaps, ..pointer(x, y) }, from_above, NO_DEPTH);
            reached.placement.heading_deg - 90.0
        };
        // From the right over the top to the left and on to below: 90°, 180°, 270°.
        assert!((turned(100.0, -50.0, false) - 90.0).abs() < 1e-9);
        assert!((turned(50.0, -1e-6, false).abs() - 90.0).abs() < 1e-9 || turned(50.0, -1e-6, false).abs() < 360.0);
        turned(100.0, 50.0, false);
        let steps = Pointer { snaps: true, ..pointer(104.0, 50.0) };
        tool.reach(steps, from_above, NO_DEPTH);
        assert_eq!((done(&tool), told(&tool)), ("turned 275°".to_owned(), "Turn about up: 275°".to_owned()));
        // From below the same way is the other way round.
        let from_below = |px: DVec2| Some(Ray { origin_m: DVec3::new(px.x, px.y, -9.0), direction: DVec3::Z });
        let mut below = Tool::new(Kind::Turn, Along::Free, held());
        below.reach(pointer(100.0, -50.0), from_below, NO_DEPTH);
        assert_eq!(told(&below), "Turn about up: -90°");
        // On a ring that is seen at 30° a way of 50 px to the right and 25 px up is 45° round.
        let sin = 0.5f64;
        let oblique = |px: DVec2| {
            let direction = DVec3::new(0.0, 0.75f64.sqrt(), -sin);
            let up = DVec3::new(0.0, sin, 0.75f64.sqrt());
            let middle = DVec3::new(1.0, 0.0, 1.02) - 5.0 * direction;
            Some(Ray { origin_m: middle + 0.01 * (DVec3::X * (px.x - 100.0) - up * px.y), direction })
        };
        let mut ring = Tool::new(Kind::Turn, Along::Free, held()).on_ring();
        ring.reach(pointer(150.0, -25.0), oblique, NO_DEPTH);
        assert_eq!(told(&ring), "Turn about up: 45°");
        // Typed, about the world's x: the heading stays.
        ring.constrain(0, false);
        typed(&mut ring, "45");
        let placement = ring.reach(pointer(0.0, 0.0), oblique, NO_DEPTH).placement;
        assert_eq!((placement.heading_deg, told(&ring).as_str()), (90.0, "Turn about x: [45]  45°"));
        let heading = DQuat::from_rotation_z(90f64.to_radians());
        let whole = heading * placement.rotation * DVec3::Y;
        // Its own y was the world's −x, which the axis leaves; its own x rises.
        assert!(whole.abs_diff_eq(DVec3::NEG_X, 1e-9), "{whole}");
        let rises = heading * placement.rotation * DVec3::X;
        assert!(rises.abs_diff_eq(DVec3::new(0.0, 0.5f64.sqrt(), 0.5f64.sqrt()), 1e-9), "{rises}");
    }

    #[test]
    fn twice_as_far_is_twice_as_large() {
        let mut tool = Tool::new(Kind::Scale, Along::Free, held());
        let size = |tool: &mut Tool, x: f64, snaps| {
            tool.reach(Pointer { snaps, ..pointer(x, 0.0) }, from_above, NO_DEPTH).placement.size
        };
        assert_eq!(size(&mut tool, 200.0, false), Size::Scale(DVec3::splat(2.0)));
        assert_eq!(size(&mut tool, 161.0, true), Size::Scale(DVec3::splat(1.2)));
        assert_eq!(
            (done(&tool), size(&mut tool, 100.0, false)),
            ("scaled to 120 %".into(), Size::Scale(DVec3::splat(LEAST_FACTOR)))
        );
        tool.constrain(1, false);
        typed(&mut tool, "50%");
        assert_eq!(size(&mut tool, 0.0, false), Size::Scale(DVec3::new(1.0, 0.5, 1.0)));
        assert_eq!(told(&tool), "Scale along its own y: [50%]  50 %");
    }
}
