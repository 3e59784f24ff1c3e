//! How a selected thing is taken hold of: where it is held, the handles around it, and which way is right and up.

use glam::{DVec2, DVec3};

use super::super::Project;
use super::draw;
use super::gizmo::{Gizmo, is_inside};
use super::lamp::{self, Mark};
use super::look::{Border, feet};
use super::maths;
use super::over::Over;
use super::tool::Held;
use locard_engine::scene::{ItemPlacement, SceneItem};
use locard_engine::shot::Eye;

/// The place of a thing in the loaded scene's objects. `None` for a lamp, and for what is not there.
pub fn object_of(project: &Project, thing: SceneItem) -> Option<usize> {
    project.edit().scene.entries().iter().position(|known| thing == (*known).into())
}

/// Whether a thing is left out of the picture.
pub fn is_hidden(project: &Project, thing: SceneItem) -> bool {
    matches!(thing, SceneItem::Object(entry) if project.edit().scene.is_hidden(entry))
}

/// The level axis nearest to a way in the picture, right or up, at a place of the world.
pub fn level_direction(eye: &Eye, at_m: DVec3, up_in_world: DVec3, right: i8, up: i8) -> Option<DVec3> {
    // What is not in the picture goes as what is in its middle does.
    let of = &eye.geometry().intrinsics;
    let size = DVec2::new(of.width_px.into(), of.height_px.into());
    let inside = |px: &DVec2| px.cmpge(DVec2::ZERO).all() && px.cmple(size).all();
    let px = eye.project(at_m).filter(inside).unwrap_or(0.5 * size);
    let (here, there) = (eye.ray(px)?, eye.ray(px + DVec2::new(f64::from(right), -f64::from(up)))?);
    // A pixel's step, enlarged to be told from nothing. What is seen level goes away where it goes up.
    let step = (there.direction - here.direction).normalize_or_zero() + here.direction * f64::from(up);
    let (axis, sign) = maths::nearest_axis(step.reject_from_normalized(up_in_world), maths::along_plane(up_in_world))?;
    Some(axis * sign)
}

/// Whether a place lies in what has that border. A hole has a border of its own.
pub fn is_within(at_px: DVec2, border: &Border) -> bool {
    border.iter().filter(|polygon| is_inside(at_px, polygon)).count() % 2 == 1
}

/// Where each lamp is shown; nothing where none of the picture is seen.
pub fn marks(over: &Over<'_>, project: &Project, eye: &Eye) -> Vec<Mark> {
    let visible = over.visible();
    let lamps = project.edit().scene.light.lamp.iter().filter(|_| visible.is_positive());
    lamps.map(|lamp| lamp::mark(eye, lamp.at_m.into(), visible, |px| over.screen(px))).collect()
}

/// How far a thing stands from the place that its handles are around: a lamp that is not in the picture has them within it.
pub fn beyond_m(over: &Over<'_>, project: &Project, eye: &Eye, thing: SceneItem) -> DVec3 {
    let (SceneItem::Lamp(_), Some(placement)) = (thing, project.edit().scene.placement(thing)) else {
        return DVec3::ZERO;
    };
    let (visible, at_m) = (over.visible(), placement.position_m);
    let mark = visible.is_positive().then(|| lamp::mark(eye, at_m, visible, |px| over.screen(px)));
    let there = mark.and_then(|mark| lamp::stand_in(eye, at_m, mark.beyond?, visible, |at| over.px(draw::at(at))));
    there.map_or(DVec3::ZERO, |there| at_m - there)
}

/// The handles around a thing that has that border; `beyond_m` as above.
pub fn gizmo(
    over: &Over<'_>,
    project: &Project,
    eye: &Eye,
    thing: SceneItem,
    beyond_m: DVec3,
    border: &Border,
) -> Option<Gizmo> {
    let placement = project.edit().scene.placement(thing)?;
    let covers = |at: DVec2| is_within(over.px(draw::at(at)), border);
    let seen = |point_m: DVec3| eye.project(point_m).map(|px| over.screen(px));
    let mut gizmo = Gizmo::new(placement.position_m - beyond_m, project.up(), eye.position_m(), seen, covers)?;
    if matches!(thing, SceneItem::Lamp(_)) {
        // It shines alike into all directions.
        gizmo.ring.clear();
    }
    Some(gizmo)
}

/// Takes hold of a thing. Without a grip it is held where it is seen; without an anchor where it stands, less `beyond_m`.
pub fn held(
    project: &Project,
    eye: &Eye,
    thing: SceneItem,
    beyond_m: DVec3,
    grip: Option<DVec2>,
    anchor: Option<DVec2>,
) -> Option<Held> {
    let file = &project.edit().scene;
    let placement = file.placement(thing)?;
    if is_hidden(project, thing) {
        return None;
    }
    let placement = ItemPlacement { position_m: placement.position_m - beyond_m, ..placement };
    let scene = &project.shot().scene;
    let (own, feet_m, hangs) = match thing {
        SceneItem::Object(entry) => {
            let object = scene.objects.get(object_of(project, thing)?)?;
            let model = object.world_from_model.matrix3;
            let own = [model.x_axis, model.y_axis, model.z_axis];
            let is_grounded = file.objects[entry.object].ground;
            let feet_m = if is_grounded { Vec::new() } else { feet(scene, object, placement.position_m) };
            ([0, 1, 2].map(|i| own[i].try_normalize().unwrap_or(DVec3::AXES[i])), feet_m, None)
        }
        SceneItem::Lamp(_) => (DVec3::AXES, Vec::new(), (eye.position_m() - placement.position_m).try_normalize()),
    };
    let mut held = Held {
        placement,
        own,
        up: project.up(),
        feet_m,
        hangs,
        centre_px: eye.project(placement.position_m)?,
        anchor_px: DVec2::ZERO,
        grip_px: DVec2::ZERO,
    };
    held.anchor_px = anchor.or_else(|| eye.project(held.support().point_m)).unwrap_or(held.centre_px);
    held.grip_px = grip.unwrap_or(held.centre_px);
    Some(held)
}
