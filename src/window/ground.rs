//! Placement surface and scale without depth: a plane through three picked points, and the scale by
//! two points and their true distance.

use eframe::egui::{Key, RichText, Ui, vec2};
use glam::{DVec2, DVec3};

use super::Project;
use super::fields::{numeric, rounded};
use super::picture::PictureOutput;
use super::point_picker::{Click, PointPicker, is_scaled, paint_ring};
use super::tool::{ClickContext, Tools};
use locard_engine::plane::HessePlane;
use locard_engine::scene::SceneFile;
use locard_engine::shot::metres_per_unit;
use locard_engine::support::plane_through;
use locard_engine::text::fixed;

/// Purpose of picked points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum GroundPurpose {
    Plane,
    Scale,
}

impl GroundPurpose {
    fn points(self) -> usize {
        match self {
            Self::Plane => 3,
            Self::Scale => 2,
        }
    }
}

/// Picks the points of a plane or of a scale.
#[derive(Clone, Debug)]
pub struct GroundPick {
    purpose: GroundPurpose,
    picker: PointPicker,
    points_m: Vec<DVec3>,
}

impl GroundPick {
    fn new(purpose: GroundPurpose) -> Self {
        Self { purpose, picker: PointPicker::default(), points_m: Vec::new() }
    }

    /// True if no further point is needed.
    pub fn is_complete(&self) -> bool {
        self.points_m.len() == self.purpose.points()
    }

    /// Handles a click. Returns a message.
    pub fn click(&mut self, context: ClickContext<'_>, at_px: DVec2) -> Result<Option<String>, String> {
        let ClickContext { project, ground, frame, .. } = context;
        let (shot, plane, up) = (project.shot(), ground.plane, project.up());
        let (support, accuracy) = match self.picker.click(plane, shot, up, frame, at_px)? {
            Click::SecondView(text) => return Ok(Some(text)),
            Click::Point { support, accuracy } => (support, accuracy),
        };
        self.points_m.push(support.point_m);
        match (self.purpose, self.points_m.as_slice()) {
            (GroundPurpose::Scale, [a, b]) => ground.scale_points_m = Some([*a, *b]),
            (GroundPurpose::Plane, [a, _, _]) => {
                let eye = shot.recording.pose_at_frame(frame.index).map_err(|e| e.to_string())?.position_in_world_m();
                let towards = shot.recording.up.unwrap_or(eye - *a);
                let plane = plane_through(&self.points_m).map(|fit| fit.plane.facing(towards));
                ground.plane = Some(plane.map_err(|e| e.to_string())?);
                return Ok(Some("Things are placed on the plane through the three points.".to_owned()));
            }
            _ => {}
        }
        Ok(accuracy)
    }

    /// Paints the picked points and an instruction.
    pub fn paint(&self, picture: &PictureOutput, project: &Project, frame: usize) {
        paint_points(&self.points_m, picture, project, frame);
        if !self.picker.awaits_second_view() {
            let (number, all) = (self.points_m.len() + 1, self.purpose.points());
            picture.prompt(&match self.purpose {
                GroundPurpose::Plane => format!("Click three points of the surface ({number} of {all})"),
                GroundPurpose::Scale => format!("Click two points whose distance you know ({number} of {all})"),
            });
        }
        self.picker.paint(picture, project.shot(), frame);
    }
}

fn paint_points(points_m: &[DVec3], picture: &PictureOutput, project: &Project, frame: usize) {
    let Ok(eye) = project.shot().posed_camera(frame) else { return };
    for (n, point) in points_m.iter().enumerate() {
        if let Some(px) = eye.project(*point) {
            paint_ring(picture, picture.placed.screen(vec2(px.x as f32, px.y as f32)), &(n + 1).to_string());
        }
    }
}

/// State of the surface and scale controls.
#[derive(Clone, Debug)]
pub struct GroundPanel {
    /// Surface to place on, instead of the one that the depth shows.
    pub plane: Option<HessePlane>,
    /// Picked points whose true distance the user enters.
    scale_points_m: Option<[DVec3; 2]>,
    /// True distance of the two points, as entered.
    distance_m: f64,
}

impl Default for GroundPanel {
    fn default() -> Self {
        Self { plane: None, scale_points_m: None, distance_m: 1.0 }
    }
}

impl GroundPanel {
    /// Drops the picked points of a scale. Returns false if there are none.
    pub fn cancel_scale(&mut self) -> bool {
        self.scale_points_m.take().is_some()
    }

    fn begin(&mut self, purpose: GroundPurpose, tools: &mut Tools) {
        self.cancel_scale();
        if purpose == GroundPurpose::Plane {
            self.plane = None;
        }
        tools.pick_ground(GroundPick::new(purpose));
    }

    /// Paints the picked points of a scale.
    pub fn paint(&self, picture: &PictureOutput, project: &Project, frame: usize) {
        paint_points(self.scale_points_m.as_ref().map_or(&[], |points| points), picture, project, frame);
    }

    /// Shows the controls. Returns a message or an error.
    pub fn show(&mut self, ui: &mut Ui, project: &mut Project, tools: &mut Tools) -> Option<Result<String, String>> {
        let has_depth = project.shot().recording.has_depth();
        let is_metric = project.shot().recording.kind.is_metric();
        ui.horizontal_wrapped(|ui| {
            ui.label("Surface");
            match self.plane {
                Some(_) => {
                    ui.label("a plane");
                    let back = if has_depth {
                        "As the depth shows"
                    } else if project.shot().floor().is_some() {
                        "The floor"
                    } else {
                        "None"
                    };
                    if ui.button(back).clicked() {
                        self.plane = None;
                    }
                }
                None if has_depth => _ = ui.label("as the depth shows"),
                None if project.shot().floor().is_some() => {
                    let hint = "The plane through the world's origin: a sheet of tags, a stage's floor.";
                    ui.label("the floor").on_hover_text(hint);
                }
                None => _ = ui.label("each point in two frames"),
            }
            let hint = "Click three points of a floor or a desk; things are placed on the plane through them.";
            if ui.button("Three points…").on_hover_text(hint).clicked() {
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
                ui.label("not known");
            }
            let hint = "Click two points whose true distance you know.";
            if ui.button("Two points…").on_hover_text(hint).clicked() {
                self.begin(GroundPurpose::Scale, tools);
            }
        });
        let [a, b] = self.scale_points_m?;
        let mut result = None;
        ui.horizontal_wrapped(|ui| {
            ui.label("Distance");
            let field = numeric(ui, "true distance", &mut self.distance_m, 0.005, " m");
            let is_entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if ui.button("Set").clicked() || is_entered {
                result = Some(set_scale(project, a, b, self.distance_m));
            }
            if ui.button("Cancel").clicked() {
                self.cancel_scale();
            }
        });
        let unit = if is_scaled(project.shot()) { "m" } else { "units" };
        ui.label(RichText::new(format!("Now it is {} {unit}.", fixed(a.distance(b), 4))).weak());
        if matches!(result, Some(Ok(_))) {
            self.cancel_scale();
            self.plane = None;
        }
        result
    }
}

/// Sets the scale. Placed things keep their projected position and their true size.
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
            "The recording was opened with a scale of its own, which holds: open it again, and the scene's does"
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
