//! The state of a selected item when its transform begins, its gizmo, and directions of the
//! picture in the world.

use glam::{DVec2, DVec3};

use super::super::Project;
use super::draw;
use super::gizmo::{Gizmo, is_inside};
use super::lamp::{self, Marker};
use super::maths;
use super::outline::{Outline, support_points_m};
use super::overlay::Overlay;
use super::transform::DragState;
use locard_engine::scene::{ItemPlacement, SceneItem};
use locard_engine::shot::PosedCamera;

/// Index of an item in the loaded scene's objects. `None` for a lamp or a missing object.
pub fn object_of(project: &Project, item: SceneItem) -> Option<usize> {
    project.edit().scene.entries().iter().position(|entry| item == (*entry).into())
}

/// True if an item is left out of the picture.
pub fn is_hidden(project: &Project, item: SceneItem) -> bool {
    matches!(item, SceneItem::Object(entry) if project.edit().scene.is_hidden(entry))
}

/// The level axis nearest to a direction of the picture, right or up, at a point of the world.
pub fn level_direction(eye: &PosedCamera, at_m: DVec3, up_in_world: DVec3, right: i8, up: i8) -> Option<DVec3> {
    // Points outside the picture use its centre.
    let intrinsics = &eye.geometry().intrinsics;
    let size = DVec2::new(intrinsics.width_px.into(), intrinsics.height_px.into());
    let is_in_picture = |px: &DVec2| px.cmpge(DVec2::ZERO).all() && px.cmple(size).all();
    let px = eye.project(at_m).filter(is_in_picture).unwrap_or(0.5 * size);
    let (here, there) = (eye.ray(px)?, eye.ray(px + DVec2::new(f64::from(right), -f64::from(up)))?);
    // The step of one pixel, normalized. For a level view, up in the picture is away from the
    // camera.
    let step = (there.direction - here.direction).normalize_or_zero() + here.direction * f64::from(up);
    let (axis, sign) = maths::nearest_axis(step.reject_from_normalized(up_in_world), maths::plane_axes(up_in_world))?;
    Some(axis * sign)
}

/// True if a pixel lies inside an outline, by the even-odd rule.
pub fn is_within(at_px: DVec2, outline: &Outline) -> bool {
    outline.iter().filter(|polygon| is_inside(at_px, polygon)).count() % 2 == 1
}

/// Markers of all lamps; none if no part of the picture is visible.
pub fn lamp_markers(over: &Overlay<'_>, project: &Project, eye: &PosedCamera) -> Vec<Marker> {
    let visible = over.visible();
    let lamps = project.edit().scene.light.lamp.iter().filter(|_| visible.is_positive());
    lamps.map(|lamp| lamp::marker(eye, lamp.at_m.into(), visible, |px| over.screen(px))).collect()
}

/// Offset of an item from its gizmo, metres: not zero for lamps outside the picture, whose gizmo
/// stays inside.
pub fn gizmo_offset_m(over: &Overlay<'_>, project: &Project, eye: &PosedCamera, item: SceneItem) -> DVec3 {
    let (SceneItem::Lamp(_), Some(placement)) = (item, project.edit().scene.placement(item)) else {
        return DVec3::ZERO;
    };
    let visible = over.visible();
    let at_m = placement.position_m;
    let marker = visible.is_positive().then(|| lamp::marker(eye, at_m, visible, |px| over.screen(px)));
    let gizmo_m = marker
        .and_then(|marker| lamp::gizmo_position_m(eye, at_m, marker.off_screen?, visible, |at| over.px(draw::at(at))));
    gizmo_m.map_or(DVec3::ZERO, |gizmo_m| at_m - gizmo_m)
}

/// The gizmo of an item with that outline, at the item less `gizmo_offset_m`.
pub fn gizmo(
    over: &Overlay<'_>,
    project: &Project,
    eye: &PosedCamera,
    item: SceneItem,
    gizmo_offset_m: DVec3,
    outline: &Outline,
) -> Option<Gizmo> {
    let placement = project.edit().scene.placement(item)?;
    let covers = |at: DVec2| is_within(over.px(draw::at(at)), outline);
    let project_point = |point_m: DVec3| eye.project(point_m).map(|px| over.screen(px));
    let centre_m = placement.position_m - gizmo_offset_m;
    let mut gizmo = Gizmo::new(centre_m, project.up(), eye.position_m(), project_point, covers)?;
    if matches!(item, SceneItem::Lamp(_)) {
        // Lamps emit isotropically.
        gizmo.ring.clear();
    }
    Some(gizmo)
}

/// State of an item at the start of a transform, moved by −`gizmo_offset_m`. The default grip is
/// the projection of its position, the default anchor that of its support point.
pub fn drag_state(
    project: &Project,
    eye: &PosedCamera,
    item: SceneItem,
    gizmo_offset_m: DVec3,
    grip: Option<DVec2>,
    anchor: Option<DVec2>,
) -> Option<DragState> {
    let file = &project.edit().scene;
    let placement = file.placement(item)?;
    if is_hidden(project, item) {
        return None;
    }
    let placement = ItemPlacement { position_m: placement.position_m - gizmo_offset_m, ..placement };
    let scene = &project.shot().scene;
    let (local_axes, support_points_m, free_plane_normal) = match item {
        SceneItem::Object(entry) => {
            let object = scene.objects.get(object_of(project, item)?)?;
            let model = object.world_from_model.matrix3;
            let axes = [model.x_axis, model.y_axis, model.z_axis];
            let is_grounded = file.objects[entry.object].ground;
            let points_m = if is_grounded { Vec::new() } else { support_points_m(scene, object, placement.position_m) };
            ([0, 1, 2].map(|i| axes[i].try_normalize().unwrap_or(DVec3::AXES[i])), points_m, None)
        }
        SceneItem::Lamp(_) => (DVec3::AXES, Vec::new(), (eye.position_m() - placement.position_m).try_normalize()),
    };
    let mut state = DragState {
        placement,
        local_axes,
        up: project.up(),
        support_points_m,
        free_plane_normal,
        centre_px: eye.project(placement.position_m)?,
        anchor_px: DVec2::ZERO,
        grip_px: DVec2::ZERO,
    };
    state.anchor_px = anchor.or_else(|| eye.project(state.support().point_m)).unwrap_or(state.centre_px);
    state.grip_px = grip.unwrap_or(state.centre_px);
    Some(state)
}
