//! An upright object on a tilted surface: the gap below its foot, and a button that turns it onto
//! the surface.

use eframe::egui::{RichText, Ui};
use glam::{DQuat, DVec3};

use super::Project;
use locard_engine::scene::{Entry, ItemPlacement, SceneError};
use locard_engine::support::TiltedSupport;
use locard_engine::text::{fixed, millimetres};

/// Cosine of the largest tilt of an upright object, half a degree.
const MIN_UPRIGHT_COS: f64 = 0.99996;

/// True if an object stands along the world's up.
fn is_upright(project: &Project, entry: Entry) -> bool {
    let up = project.up();
    project.edit().scene.placement(entry).is_some_and(|placement| (placement.rotation * up).dot(up) > MIN_UPRIGHT_COS)
}

/// Message about the gap below an upright object's foot.
pub fn text(project: &Project, entry: Entry, tilt: &TiltedSupport) -> Option<String> {
    is_upright(project, entry).then(|| {
        let (degrees, gap) = (fixed(tilt.degrees, 1), millimetres(tilt.gap_m));
        format!("The surface is tilted by {degrees}°: the foot hovers by up to {gap}")
    })
}

/// Shows the message with the button. Returns an error.
pub fn show(ui: &mut Ui, project: &mut Project, entry: Entry, tilt: &TiltedSupport) -> Option<String> {
    let text = text(project, entry, tilt)?;
    ui.label(RichText::new(text).small().color(ui.visuals().warn_fg_color));
    let button = ui.button("On the surface");
    if !button.on_hover_text("Turns it from the vertical onto the surface").clicked() {
        return None;
    }
    put_on_surface(project, entry, tilt).err().map(|error| error.to_string())
}

/// Turns an object so that its foot lies in the surface.
pub fn put_on_surface(project: &mut Project, entry: Entry, tilt: &TiltedSupport) -> Result<(), SceneError> {
    let (scene, up) = (&project.edit().scene, project.up());
    let is_ground = scene.objects.get(entry.object).is_some_and(|object| object.ground);
    let loaded = &project.shot().scene;
    let (Some(placement), Some(object)) = (scene.placement(entry), loaded.objects.get(tilt.object)) else {
        return Ok(());
    };
    let origin = object.world_from_model.translation;
    let points: Vec<DVec3> = object.points_m(loaded).map(|point| point - origin).collect();
    let laid = stance_on_surface(&placement, origin, &points, tilt, up, is_ground);
    let what = format!("{}: on the surface", scene.title(entry));
    project.change_scene(&what, |scene| scene.put(entry, &laid))?;
    project.close_step();
    Ok(())
}

/// The stance on the surface of an object with these points, from its origin. `is_ground`: its
/// position is that of its lowest point.
fn stance_on_surface(
    placement: &ItemPlacement,
    origin: DVec3,
    points: &[DVec3],
    tilt: &TiltedSupport,
    up: DVec3,
    is_ground: bool,
) -> ItemPlacement {
    let normal = tilt.support.normal;
    let turn = DQuat::from_rotation_arc(up, normal);
    let (axis, angle) = turn.to_axis_angle();
    let lowest = |along: DVec3| points.iter().map(|point| (turn * *point).dot(along)).fold(f64::MAX, f64::min);
    // Moved along the world's up, so that its position seen from above stays.
    let off_m = (tilt.support.point_m - origin).dot(normal) - lowest(normal);
    let placed = origin + up * (off_m / up.dot(normal));
    let position_m = if is_ground { placed + up * lowest(up) } else { placed };
    ItemPlacement { position_m, ..placement.turned(axis, angle.to_degrees(), up) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::plane::Plane;
    use locard_engine::scene::Size;

    #[test]
    fn foot_lies_in_the_surface_after_the_turn() {
        let normal = DVec3::new(0.1, -0.05, 1.0).normalize();
        let support = Plane { point_m: DVec3::new(0.3, 0.2, 0.4), normal };
        let tilt = TiltedSupport { object: 0, support, degrees: 6.4, gap_m: 0.01 };
        let corners = [-0.05, 0.05].map(|x| [-0.03, 0.03].map(|y| [0.0, 0.1].map(|z| DVec3::new(x, y, z))));
        let points: Vec<DVec3> = corners.into_iter().flatten().flatten().collect();
        let placement = ItemPlacement {
            position_m: support.point_m,
            rotation: DQuat::IDENTITY,
            heading_deg: 30.0,
            size: Size::Scale(DVec3::ONE),
        };
        let heading = DQuat::from_axis_angle(DVec3::Z, 30f64.to_radians());
        let turned: Vec<DVec3> = points.iter().map(|point| heading * *point).collect();
        for is_ground in [false, true] {
            let laid = stance_on_surface(&placement, support.point_m, &turned, &tilt, DVec3::Z, is_ground);
            let rotation = heading * laid.rotation;
            let low = points.iter().map(|point| (rotation * *point).z).fold(f64::MAX, f64::min);
            let origin = laid.position_m - if is_ground { low * DVec3::Z } else { DVec3::ZERO };
            for point in points.iter().filter(|point| point.z == 0.0) {
                let off_m = (origin + rotation * *point - support.point_m).dot(normal);
                assert!(off_m.abs() < 1e-9, "{off_m}");
            }
        }
    }
}
