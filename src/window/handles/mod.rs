//! Objects and lamps in the picture: a click selects one, handles and keys move, turn and scale it.
//!
//! - `maths`: lines of sight, planes, axes, angles. `amount`: lengths, angles and factors, typed and told.
//! - `over`: what they are drawn over. `grasp`: how a thing is taken hold of.
//! - `tool`: one go at changing where a thing stands. `keys`: what is typed meanwhile.
//!   `words`: what is told of it.
//! - `ghost`: the thing that the next click would place.
//! - `gizmo`: the handles around a selected thing. `look`: its border and where it stands. `lamp`: where lamps are shown.
//!   `draw`: all of it, drawn.

mod amount;
mod draw;
mod ghost;
mod gizmo;
mod grasp;
mod keys;
mod lamp;
mod look;
mod maths;
mod over;
mod tool;
mod words;

use eframe::egui::{Context, CursorIcon, Event, Painter, PointerButton, Pos2, vec2};
use glam::{DVec2, DVec3};

use self::gizmo::Handle;
use self::grasp::{beyond_m, gizmo, held, is_hidden, is_within, level_direction, marks, object_of};
use self::keys::Stroke;
use self::look::{Border, ball, border, footprint};
use self::tool::{Along, Kind, Pointer, Tool};
use super::Project;
use super::picture::GRIP;
use super::theme;
use locard_engine::scene::{ItemPlacement, SceneFile, SceneItem, Size};
use locard_engine::shot::Eye;

pub use self::ghost::{Ghost, Would};
pub use self::maths::Plane;
pub use self::over::Over;

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

/// A thing that is being changed.
#[derive(Debug)]
struct Running {
    tool: Tool,
    thing: SceneItem,
    /// The scene that it began from, and what was selected before.
    base: SceneFile,
    selected_before: SceneItem,
    /// How far it stands from where it is taken hold of ([`beyond_m`]).
    beyond_m: DVec3,
    is_copy: bool,
    /// Begun by pressing a button of the pointer: letting go ends it.
    is_dragged: bool,
    pointer: Pointer,
    footprint: Border,
}

impl Running {
    /// Where it stands in the scene when that is reached with what is taken hold of. What it is not moved along stays to the last bit.
    fn reached(&self, held: ItemPlacement) -> Option<ItemPlacement> {
        let from_m = self.base.placement(self.thing)?.position_m;
        Some(ItemPlacement { position_m: from_m + (held.position_m - (from_m - self.beyond_m)), ..held })
    }
}

/// A thing's border, as long as nothing changes.
#[derive(Debug)]
struct Look {
    version: u64,
    frame: usize,
    thing: SceneItem,
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
        selected: &mut Option<SceneItem>,
    ) -> Option<Result<String, String>> {
        *selected = selected.filter(|thing| project.edit().scene.placement(*thing).is_some());
        let (begins, strokes) = (self.begins.take(), std::mem::take(&mut self.strokes));
        let Ok(eye) = project.shot().eye(over.frame.index) else {
            self.cancel(project, selected);
            return None;
        };
        let mut refused = None;
        match (begins, *selected, &self.running) {
            (Some(Begin::Turn), Some(SceneItem::Lamp(_)), None) => {
                refused = Some(Err("A lamp shines alike into all directions: there is nothing to turn.".to_owned()));
            }
            (Some(what), Some(thing), None) => self.begin_by_key(what, over, project, &eye, thing, selected),
            _ => {}
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
        refused.or(said)
    }

    fn begin_by_key(
        &mut self,
        what: Begin,
        over: &Over<'_>,
        project: &Project,
        eye: &Eye,
        thing: SceneItem,
        selected: &mut Option<SceneItem>,
    ) {
        let pointer = over.seen.response.ctx.input(|i| i.pointer.latest_pos());
        let grip = pointer.map(|at| over.px(at));
        let beyond_m = beyond_m(over, project, eye, thing);
        let Some(held) = held(project, eye, thing, beyond_m, grip, None) else { return };
        let kind = match what {
            Begin::Move | Begin::Duplicate => Kind::Move,
            Begin::Turn => Kind::Turn,
            Begin::Scale => Kind::Scale,
        };
        let mut base = project.edit().scene.clone();
        let is_copy = what == Begin::Duplicate;
        let copy = if is_copy { base.duplicate(thing) } else { None };
        let at_px = held.grip_px;
        self.running = Some(Running {
            tool: Tool::new(kind, Along::Free, held),
            thing: copy.unwrap_or(thing),
            base,
            selected_before: thing,
            beyond_m,
            is_copy,
            is_dragged: false,
            pointer: Pointer { at_px, snaps: false, level: false },
            footprint: Border::new(),
        });
        *selected = Some(copy.unwrap_or(thing));
    }

    fn begin_by_drag(
        &mut self,
        handle: Handle,
        at: Pos2,
        over: &Over<'_>,
        project: &Project,
        eye: &Eye,
        thing: SceneItem,
    ) {
        let grip = over.px(at);
        // The thing itself goes where the pointer goes, from where it stands; a handle from where it is held.
        let anchor = (handle != Handle::Slide).then_some(grip);
        let beyond_m = beyond_m(over, project, eye, thing);
        let Some(held) = held(project, eye, thing, beyond_m, Some(grip), anchor) else { return };
        let tool = match handle {
            Handle::Slide => Tool::new(Kind::Move, Along::Free, held),
            Handle::Axis(axis) => Tool::new(Kind::Move, Along::Axis { axis, own: false }, held),
            Handle::Ground => Tool::new(Kind::Move, Along::Level, held),
            Handle::Heading => Tool::new(Kind::Turn, Along::Free, held).on_ring(),
            Handle::Size => Tool::new(Kind::Scale, Along::Free, held),
        };
        self.running = Some(Running {
            tool,
            thing,
            base: project.edit().scene.clone(),
            selected_before: thing,
            beyond_m,
            is_copy: false,
            is_dragged: true,
            pointer: Pointer { at_px: grip, snaps: false, level: false },
            footprint: Border::new(),
        });
        self.hot = Some(handle);
    }

    /// Moves a thing by a millimetre along the level axis that lies nearest to a direction of the picture: to the right,
    /// or up and so away. One after another are one step.
    pub fn nudge(project: &mut Project, frame: usize, thing: SceneItem, right: i8, up: i8) -> Result<(), String> {
        let Ok(eye) = project.shot().eye(frame) else { return Ok(()) };
        let Some(mut placement) = project.edit().scene.placement(thing) else { return Ok(()) };
        let Some(along) = level_direction(&eye, placement.position_m, project.up(), right, up) else { return Ok(()) };
        placement.position_m += along * NUDGE_M;
        let what = format!("{}: moved by keys", project.edit().scene.title(thing));
        project.change_scene(&what, |scene| scene.put(thing, &placement)).map_err(|error| error.to_string())
    }

    /// Goes on with what is being changed.
    fn run(
        &mut self,
        over: &Over<'_>,
        project: &mut Project,
        eye: &Eye,
        strokes: Vec<Stroke>,
        selected: &mut Option<SceneItem>,
    ) -> Option<Result<String, String>> {
        let running = self.running.as_mut()?;
        let (at, modifiers, pressed, released, right) = over.seen.response.ctx.input(|i| {
            let pointer = &i.pointer;
            let right = pointer.button_pressed(PointerButton::Secondary);
            (pointer.latest_pos(), i.modifiers, pointer.primary_pressed(), pointer.primary_released(), right)
        });
        if let Some(at) = at {
            running.pointer.at_px = over.px(at);
        }
        (running.pointer.snaps, running.pointer.level) = (modifiers.command, modifiers.shift);
        let (mut is_done, mut is_cancelled) = (if running.is_dragged { released } else { pressed }, right);
        for stroke in strokes {
            match stroke {
                Stroke::Kind(Kind::Turn) if matches!(running.thing, SceneItem::Lamp(_)) => {}
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
                let surface = frame.depth.as_ref().and_then(|_| shot.placement_preview(frame, at_px).ok())?;
                Some(maths::Plane { point_m: surface.point_m, normal: surface.normal_in_world })
            };
            running.tool.reach(running.pointer, |px| eye.ray(px), surface)
        };
        let mut scene = running.base.clone();
        running.reached(reached.placement).iter().for_each(|placement| scene.put(running.thing, placement));
        // What does not load is not shown, and it stays where it was.
        let tried = project.set_uncommitted_scene(scene).map_err(|error| Err(error.to_string())).err();
        if running.tool.kind == Kind::Move {
            let scene = &project.shot().scene;
            let object = object_of(project, running.thing).and_then(|of| scene.objects.get(of));
            running.footprint =
                object.map_or_else(Border::new, |object| footprint(eye, scene, object, &reached.support, project.up()));
        }
        if !is_done {
            return tried;
        }
        self.is_spent = pressed || released;
        let running = self.running.take()?;
        self.pressed = None;
        let title = project.edit().scene.title(running.thing);
        let done = words::done(&running.tool);
        let is_in_place = running.base.placement(running.thing) == project.edit().scene.placement(running.thing);
        let what = match (running.is_copy, is_in_place) {
            (true, true) => format!("{title}: duplicated"),
            (true, false) => format!("{title}: duplicated, {done}"),
            (false, _) => format!("{title}: {done}"),
        };
        let is_kept = project.commit(&what);
        tried.or(is_kept.then_some(Ok(what)))
    }

    /// Takes back what is being changed: everything is as it was.
    fn cancel(&mut self, project: &mut Project, selected: &mut Option<SceneItem>) {
        self.pressed = None;
        if let Some(running) = self.running.take() {
            project.discard_uncommitted();
            *selected = Some(running.selected_before);
        }
    }

    /// Nothing is being changed: what is under the pointer, and what is pressed.
    fn point(&mut self, over: &Over<'_>, project: &Project, eye: &Eye, selected: &mut Option<SceneItem>) {
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
            self.hot = pointer.zip(*selected).and_then(|(at, thing)| self.handle_at(over, project, eye, thing, at));
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
        if let (Some((handle, from)), Some(to), Some(thing), true) = (self.pressed, latest, *selected, down)
            && from.distance(to) > DRAGS_FROM
        {
            self.begin_by_drag(handle, from, over, project, eye, thing);
        }
        let is_on_handle = self.pressed.is_some_and(|(handle, _)| handle != Handle::Slide);
        if let Some(at) = over.seen.clicked.filter(|_| over.is_free && !self.is_spent && !is_on_handle) {
            let at = DVec2::new(at.x.into(), at.y.into());
            let lamps = if over.is_hidden { Vec::new() } else { marks(over, project, eye) };
            let lamp = lamp::at(&lamps, over.screen(at)).map(SceneItem::Lamp);
            let object = || {
                let hit = eye.object_at(&project.shot().scene, at)?;
                project.edit().scene.entries().get(hit.object).copied().map(SceneItem::from)
            };
            *selected = lamp.or_else(object);
        }
        if !down {
            self.pressed = None;
        }
    }

    fn handle_at(
        &mut self,
        over: &Over<'_>,
        project: &Project,
        eye: &Eye,
        thing: SceneItem,
        at: Pos2,
    ) -> Option<Handle> {
        if is_hidden(project, thing) {
            return None;
        }
        let beyond_m = beyond_m(over, project, eye, thing);
        let border = self.border(over, project, eye, thing)?;
        let on_gizmo = gizmo(over, project, eye, thing, beyond_m, border)?.at(DVec2::new(at.x.into(), at.y.into()));
        on_gizmo.or_else(|| is_within(over.px(at), border).then_some(Handle::Slide))
    }

    /// The border of a thing, px of the picture.
    fn border(&mut self, over: &Over<'_>, project: &Project, eye: &Eye, thing: SceneItem) -> Option<&Border> {
        let scene = &project.shot().scene;
        let (version, frame) = (project.version(), over.frame.index);
        let is_same = |look: &Look| (look.version, look.frame, look.thing) == (version, frame, thing);
        if !self.look.as_ref().is_some_and(is_same) {
            let border = match (thing, project.edit().scene.placement(thing)?) {
                (SceneItem::Lamp(_), ItemPlacement { position_m, size: Size::LargestM(diameter_or_default_m), .. }) => {
                    ball(eye, position_m, 0.5 * diameter_or_default_m)
                }
                _ => border(eye, scene, scene.objects.get(object_of(project, thing)?)?),
            };
            self.look = Some(Look { version, frame, thing, border });
        }
        self.look.as_ref().map(|look| &look.border)
    }

    fn paint(&mut self, over: &Over<'_>, project: &Project, eye: &Eye, selected: Option<SceneItem>) {
        let placed = over.seen.placed;
        let painter = over.seen.painter.with_clip_rect(over.clip());
        self.paint_lamps(over, &painter, project, eye, selected);
        let Some(thing) = selected.filter(|thing| !is_hidden(project, *thing)) else { return };
        let on_screen = |border: &Border| -> Vec<Vec<Pos2>> {
            let screen = |p: &DVec2| placed.screen(vec2(p.x as f32, p.y as f32));
            border.iter().map(|polygon| polygon.iter().map(screen).collect()).collect()
        };
        if let Some(running) = &self.running {
            draw::footprint(&painter, &on_screen(&running.footprint));
            if let (Along::Axis { axis, .. }, Some(line)) = (running.tool.along, running.tool.line()) {
                let points = line.into_iter().filter_map(|p| eye.project(p)).map(|p| over.screen(p));
                draw::axis_line(&painter, points.map(draw::at).collect(), axis);
            }
        }
        let beyond_m =
            self.running.as_ref().map_or_else(|| beyond_m(over, project, eye, thing), |running| running.beyond_m);
        let (held, hot) = (self.running.as_ref().map(|running| running.is_dragged), self.hot);
        if let Some(border) = self.border(over, project, eye, thing) {
            draw::outline(&painter, &on_screen(border));
            if let Some(gizmo) = gizmo(over, project, eye, thing, beyond_m, border).filter(|_| held != Some(false)) {
                draw::gizmo(&painter, &gizmo, hot, held == Some(true));
            }
        }
        if let Some(running) = &self.running {
            let corner = over.seen.painter.clip_rect().min + vec2(10.0, 10.0);
            draw::told(&over.seen.painter, corner, &words::told(&running.tool), words::hint(&running.tool));
        }
    }

    /// A mark for each lamp, which no picture shows itself.
    fn paint_lamps(
        &self,
        over: &Over<'_>,
        painter: &Painter,
        project: &Project,
        eye: &Eye,
        selected: Option<SceneItem>,
    ) {
        let marks = marks(over, project, eye);
        let pointer = over.seen.response.hover_pos().filter(|_| over.is_free && self.running.is_none());
        let pointed = pointer.and_then(|at| lamp::at(&marks, DVec2::new(at.x.into(), at.y.into())));
        let scene = &project.edit().scene;
        for (n, (mark, lamp)) in marks.iter().zip(&scene.light.lamp).enumerate() {
            let is_selected = selected == Some(SceneItem::Lamp(n));
            let named = || {
                let title = scene.title(SceneItem::Lamp(n));
                let far_m = DVec3::from(lamp.at_m).distance(eye.position_m());
                mark.beyond.map_or_else(
                    || title.clone(),
                    |_| format!("{title}, {} away", amount::length((far_m * 100.0).round() / 100.0)),
                )
            };
            let named = (is_selected || pointed == Some(n)).then(named);
            draw::lamp(painter, mark, theme::of_light(lamp.rgb()), is_selected, named.as_deref());
        }
    }
}
