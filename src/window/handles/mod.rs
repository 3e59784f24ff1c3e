//! Objects in the picture: a click selects one, handles and keys move, turn and scale it.
//!
//! - `maths`: lines of sight, planes, axes, angles. `amount`: lengths, angles and factors, typed and told.
//! - `tool`: one go at changing where a thing stands. `keys`: what is typed meanwhile.
//!   `words`: what is told of it.
//! - `ghost`: the thing that the next click would place.
//! - `gizmo`: the handles around a selected thing. `look`: its border and where it stands. `draw`: all of it, drawn.

mod amount;
mod draw;
mod ghost;
mod gizmo;
mod keys;
mod look;
mod maths;
mod tool;
mod words;

use eframe::egui::{Context, CursorIcon, Event, PointerButton, Pos2, Rect, vec2};
use glam::{DVec2, DVec3};

use self::gizmo::{Gizmo, Handle, is_inside};
use self::keys::Stroke;
use self::look::{Border, border, feet, footprint};
use self::tool::{Along, Held, Kind, Pointer, Tool};
use super::Project;
use super::picture::{GRIP, Seen, View};
use crate::frame::Frame;
use crate::scene::{Entry, SceneFile};
use crate::shot::Eye;

pub use self::ghost::{Ghost, Would};
pub use self::maths::Plane;

/// A step of the arrow keys.
const NUDGE_M: f64 = 1e-3;
/// How far a pressed pointer goes before it drags, points.
const DRAGS_FROM: f32 = 3.0;

/// What a key begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Begin {
    Move,
    Turn,
    Scale,
    /// A second one, which is moved.
    Duplicate,
}

/// The picture that the handles are in.
pub struct Over<'a> {
    pub seen: &'a Seen,
    pub view: &'a View,
    /// The one that is shown.
    pub frame: &'a Frame,
    /// Clicks and drags are for nothing else.
    pub is_free: bool,
    /// Nothing is drawn over the picture: it plays, or it is the camera's own.
    pub is_hidden: bool,
}

/// A thing that is being changed.
#[derive(Debug)]
struct Running {
    tool: Tool,
    entry: Entry,
    /// The scene that it began from, and what was selected before.
    base: SceneFile,
    selected_before: Entry,
    is_copy: bool,
    /// Begun by pressing a button of the pointer: letting go ends it.
    is_dragged: bool,
    pointer: Pointer,
    footprint: Border,
}

/// A thing's border, as long as nothing changes.
#[derive(Debug)]
struct Look {
    version: u64,
    frame: usize,
    object: usize,
    border: Border,
}

/// Selecting, and changing what is selected.
#[derive(Debug, Default)]
pub struct Handles {
    begins: Option<Begin>,
    strokes: Vec<Stroke>,
    /// Typed behind the end of a change.
    later: Vec<Event>,
    running: Option<Running>,
    /// Pressed and not moved yet: the handle and where, on the screen.
    pressed: Option<(Handle, Pos2)>,
    /// The press has ended something: letting go is no click.
    is_spent: bool,
    hot: Option<Handle>,
    look: Option<Look>,
}

impl Handles {
    /// To be begun as soon as it is known how the thing is seen.
    pub fn begin(&mut self, what: Begin) {
        self.begins = Some(what);
    }

    /// While something is being changed all keys are for that. So are keys typed
    /// right behind the one that begins to change what is selected.
    pub fn keys(&mut self, ctx: &Context, has_selected: bool) {
        if self.running.is_some() || has_selected && !ctx.egui_wants_keyboard_input() {
            self.strokes.extend(keys::taken(ctx, self.running.is_some(), &mut self.later));
        } else {
            ctx.input_mut(|i| i.events.splice(0..0, self.later.drain(..)).for_each(drop));
        }
    }

    /// Whether dragging in the picture changes something of the scene.
    pub fn takes_drags(&self) -> bool {
        self.running.is_some() || self.pressed.is_some()
    }

    /// Does what the pointer and the keys ask for, and draws over the picture. Gives what was done, or what is wrong.
    pub fn show(
        &mut self,
        over: &Over<'_>,
        project: &mut Project,
        selected: &mut Option<Entry>,
    ) -> Option<Result<String, String>> {
        *selected = selected.filter(|entry| project.edit().scene.stance(*entry).is_some());
        let (begins, strokes) = (self.begins.take(), std::mem::take(&mut self.strokes));
        let Ok(eye) = project.shot().eye(over.frame.index) else {
            self.cancel(project, selected);
            return None;
        };
        if let (Some(what), Some(entry), None) = (begins, *selected, &self.running) {
            self.begin_by_key(what, over, project, &eye, entry, selected);
        }
        let said = if self.running.is_some() {
            self.run(over, project, &eye, strokes, selected)
        } else {
            self.point(over, project, &eye, selected);
            None
        };
        if !over.is_hidden {
            self.paint(over, project, &eye, *selected);
        }
        said
    }

    fn begin_by_key(
        &mut self,
        what: Begin,
        over: &Over<'_>,
        project: &Project,
        eye: &Eye,
        entry: Entry,
        selected: &mut Option<Entry>,
    ) {
        let pointer = over.seen.response.ctx.input(|i| i.pointer.latest_pos());
        let grip = pointer.map(|at| px(over, at));
        let Some(held) = held(project, eye, entry, grip, None) else { return };
        let kind = match what {
            Begin::Move | Begin::Duplicate => Kind::Move,
            Begin::Turn => Kind::Turn,
            Begin::Scale => Kind::Scale,
        };
        let mut base = project.edit().scene.clone();
        let is_copy = what == Begin::Duplicate;
        let copy = if is_copy { base.duplicate(entry) } else { None };
        let at_px = held.grip_px;
        self.running = Some(Running {
            tool: Tool::new(kind, Along::Free, held),
            entry: copy.unwrap_or(entry),
            base,
            selected_before: entry,
            is_copy,
            is_dragged: false,
            pointer: Pointer { at_px, snaps: false, level: false },
            footprint: Border::new(),
        });
        *selected = Some(copy.unwrap_or(entry));
    }

    fn begin_by_drag(&mut self, handle: Handle, at: Pos2, over: &Over<'_>, project: &Project, eye: &Eye, entry: Entry) {
        let grip = px(over, at);
        // The thing itself goes where the pointer goes, from where it stands; a handle from where it is held.
        let anchor = (handle != Handle::Slide).then_some(grip);
        let Some(held) = held(project, eye, entry, Some(grip), anchor) else { return };
        let tool = match handle {
            Handle::Slide => Tool::new(Kind::Move, Along::Free, held),
            Handle::Axis(axis) => Tool::new(Kind::Move, Along::Axis { axis, own: false }, held),
            Handle::Ground => Tool::new(Kind::Move, Along::Level, held),
            Handle::Heading => Tool::new(Kind::Turn, Along::Free, held).on_ring(),
            Handle::Size => Tool::new(Kind::Scale, Along::Free, held),
        };
        self.running = Some(Running {
            tool,
            entry,
            base: project.edit().scene.clone(),
            selected_before: entry,
            is_copy: false,
            is_dragged: true,
            pointer: Pointer { at_px: grip, snaps: false, level: false },
            footprint: Border::new(),
        });
        self.hot = Some(handle);
    }

    /// Moves a thing by a millimetre along the level axis that lies nearest to a direction of the picture: to the right,
    /// or up and so away. One after another are one step.
    pub fn nudge(project: &mut Project, frame: usize, entry: Entry, right: i8, up: i8) -> Result<(), String> {
        let Ok(eye) = project.shot().eye(frame) else { return Ok(()) };
        let Some(mut stance) = project.edit().scene.stance(entry) else { return Ok(()) };
        let Some(along) = level_direction(&eye, stance.position_m, project.up(), right, up) else { return Ok(()) };
        stance.position_m += along * NUDGE_M;
        let what = format!("{}: moved by keys", project.edit().scene.title(entry));
        project.change_scene(&what, |scene| scene.put(entry, &stance)).map_err(|error| error.to_string())
    }

    /// Goes on with what is being changed.
    fn run(
        &mut self,
        over: &Over<'_>,
        project: &mut Project,
        eye: &Eye,
        strokes: Vec<Stroke>,
        selected: &mut Option<Entry>,
    ) -> Option<Result<String, String>> {
        let running = self.running.as_mut()?;
        let (at, modifiers, pressed, released, right) = over.seen.response.ctx.input(|i| {
            let pointer = &i.pointer;
            let right = pointer.button_pressed(PointerButton::Secondary);
            (pointer.latest_pos(), i.modifiers, pointer.primary_pressed(), pointer.primary_released(), right)
        });
        if let Some(at) = at {
            running.pointer.at_px = px(over, at);
        }
        (running.pointer.snaps, running.pointer.level) = (modifiers.command, modifiers.shift);
        let (mut is_done, mut is_cancelled) = (if running.is_dragged { released } else { pressed }, right);
        for stroke in strokes {
            match stroke {
                Stroke::Kind(kind) => running.tool = running.tool.again(kind, running.pointer.at_px),
                Stroke::Axis { axis, without } => running.tool.constrain(axis, without),
                Stroke::Letter(letter) => running.tool.typed.push(letter),
                Stroke::Back => running.tool.typed.pop(),
                Stroke::Done => is_done = true,
                Stroke::Cancel => is_cancelled = true,
            }
        }
        if is_cancelled {
            self.is_spent = true;
            self.cancel(project, selected);
            return None;
        }
        let frame = over.frame;
        let reached = {
            let shot = project.shot();
            let surface = |at_px: DVec2| {
                let surface = frame.depth.as_ref().and_then(|_| shot.surface_at(frame, at_px).ok())?;
                Some(maths::Plane { point_m: surface.point_m, normal: surface.normal_in_world })
            };
            running.tool.reach(running.pointer, |px| eye.ray(px), surface)
        };
        let mut scene = running.base.clone();
        scene.put(running.entry, &reached.stance);
        // What does not load is not shown, and it stays where it was.
        let tried = project.try_scene(scene).map_err(|error| Err(error.to_string())).err();
        if running.tool.kind == Kind::Move {
            let of = project.edit().scene.entries().iter().position(|entry| *entry == running.entry);
            let scene = &project.shot().scene;
            let object = of.and_then(|of| scene.objects.get(of));
            running.footprint =
                object.map_or_else(Border::new, |object| footprint(eye, scene, object, &reached.support, project.up()));
        }
        if !is_done {
            return tried;
        }
        self.is_spent = pressed || released;
        let running = self.running.take()?;
        self.pressed = None;
        let title = project.edit().scene.title(running.entry);
        let done = words::done(&running.tool);
        let is_in_place = running.base.stance(running.entry) == project.edit().scene.stance(running.entry);
        let what = match (running.is_copy, is_in_place) {
            (true, true) => format!("{title}: duplicated"),
            (true, false) => format!("{title}: duplicated, {done}"),
            (false, _) => format!("{title}: {done}"),
        };
        let is_kept = project.keep_tried(&what);
        tried.or(is_kept.then_some(Ok(what)))
    }

    /// Takes back what is being changed: everything is as it was.
    fn cancel(&mut self, project: &mut Project, selected: &mut Option<Entry>) {
        self.pressed = None;
        if let Some(running) = self.running.take() {
            project.drop_tried();
            *selected = Some(running.selected_before);
        }
    }

    /// Nothing is being changed: what is under the pointer, and what is pressed.
    fn point(&mut self, over: &Over<'_>, project: &Project, eye: &Eye, selected: &mut Option<Entry>) {
        let response = &over.seen.response;
        let (pressed, down, latest, origin) = response.ctx.input(|i| {
            let pointer = &i.pointer;
            (pointer.primary_pressed(), pointer.primary_down(), pointer.latest_pos(), pointer.press_origin())
        });
        let line_x = over.view.wipe.map(|share| over.seen.placed.rect.min.x + share * over.seen.placed.rect.width());
        let on_line = |at: Pos2| line_x.is_some_and(|x| (at.x - x).abs() <= GRIP);
        let usable = over.is_free && !over.is_hidden && response.contains_pointer();
        // A quick hand has moved on since it pressed.
        let at = if pressed { origin.or(latest) } else { latest };
        let pointer = at.filter(|at| usable && !on_line(*at) && !over.seen.camera.contains(*at));
        if self.pressed.is_none() {
            self.hot = pointer.zip(*selected).and_then(|(at, entry)| self.handle_at(over, project, eye, entry, at));
        }
        if pressed {
            self.is_spent = false;
            self.pressed = self.hot.zip(pointer);
        }
        match self.hot {
            Some(Handle::Slide) => response.ctx.set_cursor_icon(CursorIcon::Grab),
            Some(_) => response.ctx.set_cursor_icon(CursorIcon::PointingHand),
            None => {}
        }
        if let (Some((handle, from)), Some(to), Some(entry), true) = (self.pressed, latest, *selected, down)
            && from.distance(to) > DRAGS_FROM
        {
            self.begin_by_drag(handle, from, over, project, eye, entry);
        }
        let is_on_handle = self.pressed.is_some_and(|(handle, _)| handle != Handle::Slide);
        if let Some(at) = over.seen.clicked.filter(|_| over.is_free && !self.is_spent && !is_on_handle) {
            let hit = eye.object_at(&project.shot().scene, DVec2::new(at.x.into(), at.y.into()));
            *selected = hit.and_then(|hit| project.edit().scene.entries().get(hit.object).copied());
        }
        if !down {
            self.pressed = None;
        }
    }

    fn handle_at(&mut self, over: &Over<'_>, project: &Project, eye: &Eye, entry: Entry, at: Pos2) -> Option<Handle> {
        if project.edit().scene.is_hidden(entry) {
            return None;
        }
        let border = self.border(over, project, eye, entry)?;
        let on_gizmo = gizmo(over, project, eye, entry, border)?.at(DVec2::new(at.x.into(), at.y.into()));
        on_gizmo.or_else(|| is_within(px(over, at), border).then_some(Handle::Slide))
    }

    /// The border of a thing, px of the picture.
    fn border(&mut self, over: &Over<'_>, project: &Project, eye: &Eye, entry: Entry) -> Option<&Border> {
        let object = project.edit().scene.entries().iter().position(|known| *known == entry)?;
        let scene = &project.shot().scene;
        let (version, frame) = (project.version(), over.frame.index);
        let is_same = |look: &Look| (look.version, look.frame, look.object) == (version, frame, object);
        if !self.look.as_ref().is_some_and(is_same) {
            let border = border(eye, scene, scene.objects.get(object)?);
            self.look = Some(Look { version, frame, object, border });
        }
        self.look.as_ref().map(|look| &look.border)
    }

    fn paint(&mut self, over: &Over<'_>, project: &Project, eye: &Eye, selected: Option<Entry>) {
        let Some(entry) = selected.filter(|entry| !project.edit().scene.is_hidden(*entry)) else { return };
        let placed = over.seen.placed;
        // Nothing is drawn over the camera's own picture.
        let clip = if over.seen.camera.is_positive() { over.seen.composite } else { Rect::EVERYTHING };
        let painter = over.seen.painter.with_clip_rect(over.seen.painter.clip_rect().intersect(clip));
        let on_screen = |border: &Border| -> Vec<Vec<Pos2>> {
            let screen = |p: &DVec2| placed.screen(vec2(p.x as f32, p.y as f32));
            border.iter().map(|polygon| polygon.iter().map(screen).collect()).collect()
        };
        if let Some(running) = &self.running {
            draw::footprint(&painter, &on_screen(&running.footprint));
            if let (Along::Axis { axis, .. }, Some(line)) = (running.tool.along, running.tool.line()) {
                let points = line.into_iter().filter_map(|p| eye.project(p)).map(|p| screen(over, p));
                draw::axis_line(&painter, points.map(draw::at).collect(), axis);
            }
        }
        let (held, hot) = (self.running.as_ref().map(|running| running.is_dragged), self.hot);
        if let Some(border) = self.border(over, project, eye, entry) {
            draw::outline(&painter, &on_screen(border));
            if let Some(gizmo) = gizmo(over, project, eye, entry, border).filter(|_| held != Some(false)) {
                draw::gizmo(&painter, &gizmo, hot, held == Some(true));
            }
        }
        if let Some(running) = &self.running {
            let corner = over.seen.painter.clip_rect().min + vec2(10.0, 10.0);
            draw::told(&over.seen.painter, corner, &words::told(&running.tool), words::hint(&running.tool));
        }
    }
}

/// The level axis nearest to a way in the picture, right or up, at a place of the world.
fn level_direction(eye: &Eye, at_m: DVec3, up_in_world: DVec3, right: i8, up: i8) -> Option<DVec3> {
    let px = eye.project(at_m)?;
    let (here, there) = (eye.ray(px)?, eye.ray(px + DVec2::new(f64::from(right), -f64::from(up)))?);
    // A pixel's step, enlarged to be told from nothing. What is seen level goes away where it goes up.
    let step = (there.direction - here.direction).normalize_or_zero() + here.direction * f64::from(up);
    let (axis, sign) = maths::nearest_axis(step.reject_from_normalized(up_in_world), maths::along_plane(up_in_world))?;
    Some(axis * sign)
}

/// A place of the screen in the picture, px.
fn px(over: &Over<'_>, at: Pos2) -> DVec2 {
    let at = over.seen.placed.picture_px(at);
    DVec2::new(at.x.into(), at.y.into())
}

fn screen(over: &Over<'_>, at_px: DVec2) -> DVec2 {
    let at = over.seen.placed.screen(vec2(at_px.x as f32, at_px.y as f32));
    DVec2::new(at.x.into(), at.y.into())
}

/// Whether a place lies in what has that border. A hole has a border of its own.
fn is_within(at_px: DVec2, border: &Border) -> bool {
    border.iter().filter(|polygon| is_inside(at_px, polygon)).count() % 2 == 1
}

fn gizmo(over: &Over<'_>, project: &Project, eye: &Eye, entry: Entry, border: &Border) -> Option<Gizmo> {
    let stance = project.edit().scene.stance(entry)?;
    let covers = |at: DVec2| is_within(px(over, draw::at(at)), border);
    let seen = |point_m: DVec3| eye.project(point_m).map(|px| screen(over, px));
    Gizmo::new(stance.position_m, project.up(), eye.position_m(), seen, covers)
}

/// Takes hold of a thing. Without a grip it is held where it is seen; without an anchor where it stands.
fn held(project: &Project, eye: &Eye, entry: Entry, grip: Option<DVec2>, anchor: Option<DVec2>) -> Option<Held> {
    let file = &project.edit().scene;
    let stance = file.stance(entry)?;
    if file.is_hidden(entry) {
        return None;
    }
    let scene = &project.shot().scene;
    let object = scene.objects.get(file.entries().iter().position(|known| *known == entry)?)?;
    let is_grounded = file.objects[entry.object].ground;
    let model = object.world_from_model.matrix3;
    let own = [model.x_axis, model.y_axis, model.z_axis];
    let mut held = Held {
        stance,
        own: [0, 1, 2].map(|i| own[i].try_normalize().unwrap_or(DVec3::AXES[i])),
        up: project.up(),
        feet_m: if is_grounded { Vec::new() } else { feet(scene, object, stance.position_m) },
        centre_px: eye.project(stance.position_m)?,
        anchor_px: DVec2::ZERO,
        grip_px: DVec2::ZERO,
    };
    held.anchor_px = anchor.or_else(|| eye.project(held.support().point_m)).unwrap_or(held.centre_px);
    held.grip_px = grip.unwrap_or(held.centre_px);
    Some(held)
}
