//! A transform in progress, and its start by a key or by a drag of a handle.

use eframe::egui::Pos2;
use glam::DVec3;

use super::super::Project;
use super::drag_state::{drag_state, gizmo_offset_m};
use super::gizmo::Handle;
use super::outline::Outline;
use super::overlay::Overlay;
use super::transform::{Constraint, Pointer, Transform, TransformKind};
use locard_engine::scene::{ItemPlacement, SceneFile, SceneItem};
use locard_engine::shot::PosedCamera;

/// Modal command of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransformCommand {
    Move,
    Turn,
    Scale,
    /// Duplicates the item and moves the copy.
    Duplicate,
}

/// A transform in progress.
#[derive(Debug)]
pub struct ActiveTransform {
    pub(super) transform: Transform,
    pub(super) item: SceneItem,
    /// The scene at the start.
    pub(super) base: SceneFile,
    /// The selection at the start.
    pub(super) selected_before: SceneItem,
    /// Offset of the item from its gizmo ([`gizmo_offset_m`]).
    pub(super) gizmo_offset_m: DVec3,
    pub(super) is_copy: bool,
    /// Begun by a press of the pointer; the release ends it.
    pub(super) is_dragged: bool,
    pub(super) pointer: Pointer,
    pub(super) footprint: Outline,
}

impl ActiveTransform {
    /// Placement of the item for a placement of its gizmo. Coordinates that the transform leaves
    /// unchanged are bit-exact.
    pub(super) fn item_placement(&self, gizmo: ItemPlacement) -> Option<ItemPlacement> {
        let from_m = self.base.placement(self.item)?.position_m;
        Some(ItemPlacement { position_m: from_m + (gizmo.position_m - (from_m - self.gizmo_offset_m)), ..gizmo })
    }
}

/// The transform that a key begins. A duplicate is selected instead of its original.
pub(super) fn begin_by_key(
    command: TransformCommand,
    over: &Overlay<'_>,
    project: &Project,
    eye: &PosedCamera,
    item: SceneItem,
    selected: &mut Option<SceneItem>,
) -> Option<Box<ActiveTransform>> {
    let pointer = over.picture.response.ctx.input(|i| i.pointer.latest_pos());
    let grip = pointer.map(|at| over.px(at));
    let gizmo_offset_m = gizmo_offset_m(over, project, eye, item);
    let start = drag_state(project, eye, item, gizmo_offset_m, grip, None)?;
    let kind = match command {
        TransformCommand::Move | TransformCommand::Duplicate => TransformKind::Move,
        TransformCommand::Turn => TransformKind::Turn,
        TransformCommand::Scale => TransformKind::Scale,
    };
    let mut base = project.edit().scene.clone();
    let is_copy = command == TransformCommand::Duplicate;
    let copy = if is_copy { base.duplicate(item) } else { None };
    let at_px = start.grip_px;
    *selected = Some(copy.unwrap_or(item));
    Some(Box::new(ActiveTransform {
        transform: Transform::new(kind, Constraint::Free, start),
        item: copy.unwrap_or(item),
        base,
        selected_before: item,
        gizmo_offset_m,
        is_copy,
        is_dragged: false,
        pointer: Pointer { at_px, snaps: false, level: false },
        footprint: Outline::new(),
    }))
}

/// The transform that a drag of a handle begins.
pub(super) fn begin_by_drag(
    handle: Handle,
    at: Pos2,
    over: &Overlay<'_>,
    project: &Project,
    eye: &PosedCamera,
    item: SceneItem,
) -> Option<Box<ActiveTransform>> {
    let grip = over.px(at);
    // The item itself is anchored at its support point, a handle at the pointer.
    let anchor = (handle != Handle::Slide).then_some(grip);
    let gizmo_offset_m = gizmo_offset_m(over, project, eye, item);
    let start = drag_state(project, eye, item, gizmo_offset_m, Some(grip), anchor)?;
    let transform = match handle {
        Handle::Slide => Transform::new(TransformKind::Move, Constraint::Free, start),
        Handle::Axis(axis) => Transform::new(TransformKind::Move, Constraint::Axis { axis, is_local: false }, start),
        Handle::Ground => Transform::new(TransformKind::Move, Constraint::Level, start),
        Handle::Heading => Transform::new(TransformKind::Turn, Constraint::Free, start).on_ring(),
        Handle::Size => Transform::new(TransformKind::Scale, Constraint::Free, start),
    };
    Some(Box::new(ActiveTransform {
        transform,
        item,
        base: project.edit().scene.clone(),
        selected_before: item,
        gizmo_offset_m,
        is_copy: false,
        is_dragged: true,
        pointer: Pointer { at_px: grip, snaps: false, level: false },
        footprint: Outline::new(),
    }))
}
