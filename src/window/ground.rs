//! Controls of the placement surface and of the scale without depth.

use eframe::egui::{Key, RichText, Ui};
use glam::DVec3;

use super::Project;
use super::fields::{numeric, rounded};
use super::ground_pick::{GroundPick, GroundPurpose};
use super::picked_ground::PickedGround;
use super::point_picker::is_scaled;
use super::tool::ToolStack;
use locard_engine::scene::SceneFile;
use locard_engine::shot::metres_per_unit;
use locard_engine::text::fixed;

/// State of the surface and scale controls.
#[derive(Clone, Debug)]
pub struct GroundPanel {
    pub picked: PickedGround,
    /// True distance of the two points of a scale, as entered.
    distance_m: f64,
}

impl Default for GroundPanel {
    fn default() -> Self {
        Self { picked: PickedGround::default(), distance_m: 1.0 }
    }
}

impl GroundPanel {
    fn begin(&mut self, purpose: GroundPurpose, tools: &mut ToolStack) {
        self.picked.cancel_scale();
        if purpose == GroundPurpose::Plane {
            self.picked.plane = None;
        }
        tools.pick_ground(GroundPick::new(purpose));
    }

    /// Shows the controls. Returns a message or an error.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        project: &mut Project,
        tools: &mut ToolStack,
    ) -> Option<Result<String, String>> {
        let has_depth = project.shot().recording.has_depth();
        let is_metric = project.shot().recording.kind.is_metric();
        ui.horizontal_wrapped(|ui| {
            ui.label("Placement");
            match self.picked.plane {
                Some(_) => {
                    ui.label("on a plane");
                    let back = if has_depth {
                        "On measured depth"
                    } else if project.shot().floor().is_some() {
                        "On the floor"
                    } else {
                        "By two frames"
                    };
                    if ui.button(back).clicked() {
                        self.picked.plane = None;
                    }
                }
                None if has_depth => _ = ui.label("on measured depth"),
                None if project.shot().floor().is_some() => {
                    let hint = "The plane through the world's origin: a sheet of tags, a stage's floor.";
                    ui.label("on the floor").on_hover_text(hint);
                }
                None => _ = ui.label("by two frames"),
            }
            let hint = "Click three points of a floor or a desk; evidence is placed on the plane through them.";
            if ui.button("Define plane…").on_hover_text(hint).clicked() {
                self.begin(GroundPurpose::Plane, tools);
            }
        });
        if is_metric {
            return None;
        }
        ui.horizontal_wrapped(|ui| {
            ui.label("Scale");
            if is_scaled(project.shot()) {
                ui.label(format!("1 unit = {} m", fixed(project.shot().recording.metres_per_unit, 5)));
            } else {
                ui.label("unknown");
            }
            let hint = "Click two points whose true distance you know.";
            if ui.button("Set scale…").on_hover_text(hint).clicked() {
                self.begin(GroundPurpose::Scale, tools);
            }
        });
        let [a, b] = self.picked.scale_points_m?;
        let mut result = None;
        ui.horizontal_wrapped(|ui| {
            ui.label("Distance");
            let field = numeric(ui, "true distance", &mut self.distance_m, 0.005, " m");
            let is_entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if ui.button("Set").clicked() || is_entered {
                result = Some(set_scale(project, a, b, self.distance_m));
            }
            if ui.button("Cancel").clicked() {
                self.picked.cancel_scale();
            }
        });
        let unit = if is_scaled(project.shot()) { "m" } else { "units" };
        ui.label(RichText::new(format!("Present distance: {} {unit}.", fixed(a.distance(b), 4))).weak());
        if matches!(result, Some(Ok(_))) {
            self.picked.cancel_scale();
            self.picked.plane = None;
        }
        result
    }
}

/// Sets the scale. Placed evidence keeps its projected position and its true size.
fn set_scale(project: &mut Project, a: DVec3, b: DVec3, distance_m: f64) -> Result<String, String> {
    let now = project.shot().recording.metres_per_unit;
    let unit = metres_per_unit(a, b, distance_m, now).ok_or("The distance must be above 0, and the points apart.")?;
    // More digits than the accuracy of picked points.
    let unit: f64 = format!("{unit:.5e}").parse().unwrap_or(unit);
    let factor = unit / now;
    let changed = project.change_scene("scale set", |scene| {
        scene.metres_per_unit = Some(unit);
        scale_positions(scene, factor);
    });
    changed.map_err(|e| e.to_string())?;
    project.close_step();
    if project.shot().recording.metres_per_unit != unit {
        return Err(
            "The recording was opened with a scale of its own, which takes precedence: open it again to use the scene's"
                .to_owned(),
        );
    }
    Ok(format!("1 unit of the recording is {unit} m; the scene file keeps it."))
}

/// Scales all positions of a scene about the world's origin. Sizes stay, and lamps keep the
/// irradiance on surfaces that scale along.
fn scale_positions(scene: &mut SceneFile, factor: f64) {
    let moved = |c: &mut f64| *c = (*c * factor * 1e4).round() / 1e4;
    for object in &mut scene.objects {
        let own = object.position_m.iter_mut();
        let all = own.chain(object.instances.iter_mut().filter_map(|instance| instance.position_m.as_mut()));
        all.flatten().for_each(moved);
    }
    for lamp in &mut scene.light.lamp {
        lamp.at_m.iter_mut().for_each(moved);
        // Inverse-square law.
        lamp.intensity = Some(rounded(lamp.intensity.unwrap_or(1.0) * factor * factor));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::scene::document::PlacedModel;

    #[test]
    fn scaled_positions_raise_lamp_intensities_by_the_square() {
        let mut scene = SceneFile::default();
        scene.objects.push(PlacedModel { position_m: Some([0.1, -2.0, 0.0]), ..PlacedModel::default() });
        scene.add_lamp(DVec3::new(1.0, 0.5, 0.25));
        scale_positions(&mut scene, 3.0);
        let lamp = &scene.light.lamp[0];
        assert_eq!((lamp.at_m, lamp.intensity, lamp.diameter_m), ([3.0, 1.5, 0.75], Some(9.0), None));
        assert_eq!(scene.objects[0].position_m, Some([0.3, -6.0, 0.0]));
    }
}
