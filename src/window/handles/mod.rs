//! Objects and lamps in the picture: a click selects one, handles and keys move, turn and scale it.
//!
//! - `maths`: view rays, planes, axes, angles. `amount`: parsing and formatting of lengths, angles
//!   and factors.
//! - `overlay`: the picture below the handles. `drag_state`: the state of an item when its
//!   transform begins.
//! - `active`: a transform in progress. `transform`: its maths. `keys`: its keyboard input.
//!   `labels`: its texts.
//! - `placement_preview`: outline of the item that the next click places.
//! - `gizmo`: the handles around a selected item. `outline`: its outline and its footprint.
//!   `lamp`: markers of lamps. `draw`: paints all of these.

mod active;
mod amount;
mod drag_state;
mod draw;
mod gizmo;
mod keys;
mod labels;
mod lamp;
mod maths;
mod outline;
mod overlay;
mod placement_preview;
mod transform;

use std::sync::Arc;

use eframe::egui::{Context, CursorIcon, Event, Painter, PointerButton, Pos2, vec2};
use glam::{DVec2, DVec3};

use self::active::{begin_by_drag, begin_by_key};
use self::drag_state::{gizmo, gizmo_offset_m, is_hidden, is_within, lamp_markers, level_direction, object_of};
use self::gizmo::Handle;
use self::keys::TransformKey;
use self::outline::{Outline, footprint, outline, sphere_outline};
use self::transform::{Constraint, TransformKind};
use super::Project;
use super::picture::WIPE_GRIP_PT;
use super::theme;
use locard_engine::memo::Memo;
use locard_engine::scene::{ItemPlacement, SceneItem, Size};
use locard_engine::shot::PosedCamera;

pub use self::active::{ActiveTransform, TransformCommand};
pub use self::maths::intersect_plane;
pub use self::overlay::Overlay;
pub use self::placement_preview::{PlacementPreview, PreviewKey};

/// Step of the arrow keys.
const NUDGE_M: f64 = 1e-3;
/// Distance from the press at which a drag begins, points.
const DRAG_THRESHOLD_PT: f32 = 3.0;

/// Selection, and the handles of the selected item.
#[derive(Debug, Default)]
pub struct Handles {
    pending: Option<TransformCommand>,
    keys: Vec<TransformKey>,
    /// Keyboard events after the end of a transform, for the next frame of the window.
    deferred: Vec<Event>,
    /// A handle that is pressed and not dragged yet, and the position on the screen.
    pressed: Option<(Handle, Pos2)>,
    /// The press ended a transform: its release is no click.
    press_is_consumed: bool,
    hovered: Option<Handle>,
    /// Outlines by version of the project, frame and item.
    outlines: Memo<(u64, usize, SceneItem), Option<Arc<Outline>>>,
}

impl Handles {
    /// Begins a transform at the next [`Self::show`], which has the camera's pose.
    pub fn begin(&mut self, command: TransformCommand) {
        self.pending = Some(command);
    }

    /// Consumes the keyboard input of a transform: all keys while one is active, and the keys that
    /// follow a key which begins one.
    pub fn consume_keys(&mut self, ctx: &Context, is_active: bool, has_selected: bool) {
        if is_active || has_selected && !ctx.egui_wants_keyboard_input() {
            self.keys.extend(keys::consume(ctx, is_active, &mut self.deferred));
        } else {
            ctx.input_mut(|i| i.events.splice(0..0, self.deferred.drain(..)).for_each(drop));
        }
    }

    /// True if a handle is pressed, whose drag begins a transform.
    pub fn is_pressed(&self) -> bool {
        self.pressed.is_some()
    }

    /// True if the last press ended a transform: no other tool receives it.
    pub fn has_consumed_press(&self) -> bool {
        self.press_is_consumed
    }

    /// Handles pointer and keyboard input and paints over the picture. Returns the history label of
    /// a finished transform, or an error.
    pub fn show(
        &mut self,
        over: &Overlay<'_>,
        project: &mut Project,
        selected: &mut Option<SceneItem>,
        transform: &mut Option<Box<ActiveTransform>>,
    ) -> Option<Result<String, String>> {
        *selected = selected.filter(|item| project.edit().scene.placement(*item).is_some());
        let pending = self.pending.take();
        let keys = std::mem::take(&mut self.keys);
        let Ok(eye) = project.shot().posed_camera(over.frame.index) else {
            self.cancel(project, selected, transform);
            return None;
        };
        let mut refused = None;
        match (pending, *selected, transform.is_some()) {
            (Some(TransformCommand::Turn), Some(SceneItem::Lamp(_)), false) => {
                refused = Some(Err("A lamp shines equally in all directions and cannot be turned.".to_owned()));
            }
            (Some(command), Some(item), false) => {
                *transform = begin_by_key(command, over, project, &eye, item, selected);
            }
            _ => {}
        }
        let result = if transform.is_some() {
            self.update_transform(over, project, &eye, keys, selected, transform)
        } else {
            *transform = self.update_pointer(over, project, &eye, selected);
            None
        };
        if !over.is_hidden {
            self.paint(over, project, &eye, *selected, transform.as_deref());
        }
        refused.or(result)
    }

    /// Moves an item by [`NUDGE_M`] along the level axis nearest to a direction of the picture: to
    /// the right, or up and thus away. Consecutive nudges merge into one undo step.
    pub fn nudge(project: &mut Project, frame: usize, item: SceneItem, right: i8, up: i8) -> Result<(), String> {
        let Ok(eye) = project.shot().posed_camera(frame) else { return Ok(()) };
        let Some(mut placement) = project.edit().scene.placement(item) else { return Ok(()) };
        let Some(along) = level_direction(&eye, placement.position_m, project.up(), right, up) else { return Ok(()) };
        placement.position_m += along * NUDGE_M;
        let what = format!("{}: moved by keys", project.edit().scene.title(item));
        project.change_scene(&what, |scene| scene.put(item, &placement)).map_err(|error| error.to_string())
    }

    /// Advances the active transform.
    fn update_transform(
        &mut self,
        over: &Overlay<'_>,
        project: &mut Project,
        eye: &PosedCamera,
        keys: Vec<TransformKey>,
        selected: &mut Option<SceneItem>,
        transform: &mut Option<Box<ActiveTransform>>,
    ) -> Option<Result<String, String>> {
        let active = transform.as_mut()?;
        let (at, modifiers, pressed, released, right) = over.picture.response.ctx.input(|i| {
            let pointer = &i.pointer;
            let right = pointer.button_pressed(PointerButton::Secondary);
            (pointer.latest_pos(), i.modifiers, pointer.primary_pressed(), pointer.primary_released(), right)
        });
        if let Some(at) = at {
            active.pointer.at_px = over.px(at);
        }
        active.pointer.snaps = modifiers.command;
        active.pointer.level = modifiers.shift;
        let mut is_done = if active.is_dragged { released } else { pressed };
        let mut is_cancelled = right;
        for key in keys {
            match key {
                TransformKey::Kind(TransformKind::Turn) if matches!(active.item, SceneItem::Lamp(_)) => {}
                TransformKey::Kind(kind) => active.transform = active.transform.restarted(kind, active.pointer.at_px),
                TransformKey::Axis { axis, as_plane } => active.transform.toggle_constraint(axis, as_plane),
                TransformKey::Letter(letter) => active.transform.typed.push(letter),
                TransformKey::Back => active.transform.typed.pop(),
                TransformKey::Done => is_done = true,
                TransformKey::Cancel => is_cancelled = true,
            }
        }
        if is_cancelled {
            self.press_is_consumed = true;
            self.cancel(project, selected, transform);
            return None;
        }
        let frame = over.frame;
        let update = {
            let shot = project.shot();
            let surface = |at_px: DVec2| {
                frame.depth.as_ref().and_then(|_| Some(shot.placement_preview(frame, at_px).ok()?.plane))
            };
            active.transform.update(active.pointer, |px| eye.ray(px), surface)
        };
        let mut scene = active.base.clone();
        active.item_placement(update.placement).iter().for_each(|placement| scene.put(active.item, placement));
        // A scene that fails to load is not shown; the last one stays.
        let error = project.set_uncommitted_scene(scene).map_err(|error| Err(error.to_string())).err();
        if active.transform.kind == TransformKind::Move {
            let scene = &project.shot().scene;
            let object = object_of(project, active.item).and_then(|of| scene.objects.get(of));
            active.footprint =
                object.map_or_else(Outline::new, |object| footprint(eye, scene, object, &update.support, project.up()));
        }
        if !is_done {
            return error;
        }
        self.press_is_consumed = pressed || released;
        let active = transform.take()?;
        self.pressed = None;
        let title = project.edit().scene.title(active.item);
        let done = labels::history(&active.transform);
        let is_in_place = active.base.placement(active.item) == project.edit().scene.placement(active.item);
        let what = match (active.is_copy, is_in_place) {
            (true, true) => format!("{title}: duplicated"),
            (true, false) => format!("{title}: duplicated, {done}"),
            (false, _) => format!("{title}: {done}"),
        };
        let is_kept = project.commit(&what);
        error.or(is_kept.then_some(Ok(what)))
    }

    /// Cancels the active transform and restores scene and selection.
    fn cancel(
        &mut self,
        project: &mut Project,
        selected: &mut Option<SceneItem>,
        transform: &mut Option<Box<ActiveTransform>>,
    ) {
        self.pressed = None;
        if let Some(active) = transform.take() {
            project.discard_uncommitted();
            *selected = Some(active.selected_before);
        }
    }

    /// Hover, press, drag start and click, while no transform is active. Returns a transform that a
    /// drag begins.
    fn update_pointer(
        &mut self,
        over: &Overlay<'_>,
        project: &Project,
        eye: &PosedCamera,
        selected: &mut Option<SceneItem>,
    ) -> Option<Box<ActiveTransform>> {
        let response = &over.picture.response;
        let (pressed, down, latest, origin) = response.ctx.input(|i| {
            let pointer = &i.pointer;
            (pointer.primary_pressed(), pointer.primary_down(), pointer.latest_pos(), pointer.press_origin())
        });
        let line_x =
            over.view.wipe.map(|share| over.picture.placed.rect.min.x + share * over.picture.placed.rect.width());
        let on_line = |at: Pos2| line_x.is_some_and(|x| (at.x - x).abs() <= WIPE_GRIP_PT);
        let usable = over.is_free && !over.is_hidden && response.contains_pointer();
        // The pointer may have moved since the press, within one frame of the window.
        let at = if pressed { origin.or(latest) } else { latest };
        let pointer = at.filter(|at| usable && !on_line(*at) && !over.picture.camera.contains(*at));
        if self.pressed.is_none() {
            self.hovered = pointer.zip(*selected).and_then(|(at, item)| self.handle_at(over, project, eye, item, at));
        }
        if pressed {
            self.press_is_consumed = false;
            self.pressed = self.hovered.zip(pointer);
        }
        match self.hovered {
            Some(Handle::Slide) => response.ctx.set_cursor_icon(CursorIcon::Grab),
            Some(_) => response.ctx.set_cursor_icon(CursorIcon::PointingHand),
            None => {}
        }
        let mut begun = None;
        if let (Some((handle, from)), Some(to), Some(item), true) = (self.pressed, latest, *selected, down)
            && from.distance(to) > DRAG_THRESHOLD_PT
        {
            begun = begin_by_drag(handle, from, over, project, eye, item);
            if begun.is_some() {
                self.hovered = Some(handle);
            }
        }
        let is_on_handle = self.pressed.is_some_and(|(handle, _)| handle != Handle::Slide);
        let is_click = over.is_free && !self.press_is_consumed && !is_on_handle;
        if let Some(at) = over.picture.clicked.filter(|_| is_click) {
            let at = DVec2::new(at.x.into(), at.y.into());
            let lamps = if over.is_hidden { Vec::new() } else { lamp_markers(over, project, eye) };
            let lamp = lamp::pick(&lamps, over.screen(at)).map(SceneItem::Lamp);
            let object = || {
                let hit = eye.object_at(&project.shot().scene, at)?;
                project.edit().scene.entries().get(hit.object).copied().map(SceneItem::from)
            };
            *selected = lamp.or_else(object);
        }
        if !down {
            self.pressed = None;
        }
        begun
    }

    fn handle_at(
        &mut self,
        over: &Overlay<'_>,
        project: &Project,
        eye: &PosedCamera,
        item: SceneItem,
        at: Pos2,
    ) -> Option<Handle> {
        if is_hidden(project, item) {
            return None;
        }
        let gizmo_offset_m = gizmo_offset_m(over, project, eye, item);
        let outline = self.outline(over, project, eye, item)?;
        let gizmo = gizmo(over, project, eye, item, gizmo_offset_m, &outline)?;
        let handle = gizmo.pick(DVec2::new(at.x.into(), at.y.into()));
        handle.or_else(|| is_within(over.px(at), &outline).then_some(Handle::Slide))
    }

    /// Outline of an item, px of the picture.
    fn outline(
        &self,
        over: &Overlay<'_>,
        project: &Project,
        eye: &PosedCamera,
        item: SceneItem,
    ) -> Option<Arc<Outline>> {
        let scene = &project.shot().scene;
        self.outlines.get_or_insert_with((project.version(), over.frame.index, item), |_| {
            Some(Arc::new(match (item, project.edit().scene.placement(item)?) {
                (SceneItem::Lamp(_), ItemPlacement { position_m, size: Size::LargestM(diameter_m), .. }) => {
                    sphere_outline(eye, position_m, 0.5 * diameter_m)
                }
                _ => outline(eye, scene, scene.objects.get(object_of(project, item)?)?),
            }))
        })
    }

    fn paint(
        &mut self,
        over: &Overlay<'_>,
        project: &Project,
        eye: &PosedCamera,
        selected: Option<SceneItem>,
        active: Option<&ActiveTransform>,
    ) {
        let placed = over.picture.placed;
        let painter = over.picture.painter.with_clip_rect(over.clip());
        self.paint_lamps(over, &painter, project, eye, selected, active.is_some());
        let Some(item) = selected.filter(|item| !is_hidden(project, *item)) else { return };
        let on_screen = |outline: &Outline| -> Vec<Vec<Pos2>> {
            let screen = |p: &DVec2| placed.screen(vec2(p.x as f32, p.y as f32));
            outline.iter().map(|polygon| polygon.iter().map(screen).collect()).collect()
        };
        if let Some(active) = active {
            draw::footprint(&painter, &on_screen(&active.footprint));
            if let (Constraint::Axis { axis, .. }, Some(line)) =
                (active.transform.constraint, active.transform.axis_line())
            {
                let points = line.into_iter().filter_map(|p| eye.project(p)).map(|p| over.screen(p));
                draw::axis_line(&painter, points.map(draw::at).collect(), axis);
            }
        }
        let gizmo_offset_m = match active {
            Some(active) => active.gizmo_offset_m,
            None => gizmo_offset_m(over, project, eye, item),
        };
        let is_dragged = active.map(|active| active.is_dragged);
        let hovered = self.hovered;
        if let Some(outline) = self.outline(over, project, eye, item) {
            draw::outline(&painter, &on_screen(&outline));
            let gizmo = gizmo(over, project, eye, item, gizmo_offset_m, &outline);
            if let Some(gizmo) = gizmo.filter(|_| is_dragged != Some(false)) {
                draw::gizmo(&painter, &gizmo, hovered, is_dragged == Some(true));
            }
        }
        if let Some(active) = active {
            let corner = over.picture.painter.clip_rect().min + vec2(10.0, 10.0);
            draw::status(
                &over.picture.painter,
                corner,
                &labels::status(&active.transform),
                labels::hint(&active.transform),
            );
        }
    }

    /// Paints a marker for each lamp; lamps are not rendered in the picture.
    fn paint_lamps(
        &self,
        over: &Overlay<'_>,
        painter: &Painter,
        project: &Project,
        eye: &PosedCamera,
        selected: Option<SceneItem>,
        is_transforming: bool,
    ) {
        let markers = lamp_markers(over, project, eye);
        let pointer = over.picture.response.hover_pos().filter(|_| over.is_free && !is_transforming);
        let hovered = pointer.and_then(|at| lamp::pick(&markers, DVec2::new(at.x.into(), at.y.into())));
        let scene = &project.edit().scene;
        for (n, (marker, lamp)) in markers.iter().zip(&scene.light.lamp).enumerate() {
            let is_selected = selected == Some(SceneItem::Lamp(n));
            let named = || {
                let title = scene.title(SceneItem::Lamp(n));
                let distance_m = DVec3::from(lamp.at_m).distance(eye.position_m());
                marker.off_screen.map_or_else(
                    || title.clone(),
                    |_| format!("{title}, {} away", amount::length((distance_m * 100.0).round() / 100.0)),
                )
            };
            let label = (is_selected || hovered == Some(n)).then(named);
            draw::lamp(painter, marker, theme::of_light(lamp.rgb()), is_selected, label.as_deref());
        }
    }
}
