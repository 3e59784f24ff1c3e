//! Placement surface and scale without depth: a plane through three picked points, and the scale by
//! two points and their true distance.

use eframe::egui::{Key, RichText, Ui, vec2};
use glam::{DVec2, DVec3};

use super::Project;
use super::fields::{numeric, rounded};
use super::picture::PictureOutput;
use super::point_picker::{Click, PointPicker, is_scaled, paint_ring};
use locard_engine::frame::Frame;
use locard_engine::scene::SceneFile;
use locard_engine::shot::metres_per_unit;
use locard_engine::support::plane_through;
use locard_engine::text::fixed;

/// Purpose of picked points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    Plane,
    Scale,
}

impl Task {
    fn points(self) -> usize {
        match self {
            Self::Plane => 3,
            Self::Scale => 2,
        }
    }
}

/// State of the surface and scale controls.
#[derive(Clone, Debug)]
pub struct Ground {
    pub picker: PointPicker,
    task: Option<Task>,
    /// Picked points of the task.
    points_m: Vec<DVec3>,
    /// True distance of the two points of a scale, as entered.
    distance_m: f64,
}

impl Default for Ground {
    fn default() -> Self {
        Self { picker: PointPicker::default(), task: None, points_m: Vec::new(), distance_m: 1.0 }
    }
}

impl Ground {
    /// True if the next click in the picture picks a point of a plane or a scale.
    pub fn is_picking(&self) -> bool {
        self.task.is_some_and(|task| self.points_m.len() < task.points())
    }

    /// True if a plane, a scale or a point is incomplete.
    pub fn is_busy(&self) -> bool {
        self.task.is_some() || self.picker.awaits_second_view()
    }

    pub fn cancel(&mut self) {
        self.picker.cancel();
        (self.task, self.points_m) = (None, Vec::new());
    }

    fn begin(&mut self, task: Task) {
        self.cancel();
        self.task = Some(task);
        if task == Task::Plane {
            self.picker.plane = None;
        }
    }

    /// Handles a click for the plane or the scale. Returns a message.
    pub fn click(&mut self, project: &Project, frame: &Frame, at_px: DVec2) -> Result<Option<String>, String> {
        let Some(task) = self.task else { return Ok(None) };
        let shot = project.shot();
        let support = match self.picker.click(shot, project.up(), frame, at_px)? {
            Click::SecondView(text) => return Ok(Some(text)),
            Click::Point(support) => support,
        };
        self.points_m.push(support.point_m);
        if task != Task::Plane || self.points_m.len() < task.points() {
            return Ok(self.picker.accuracy.clone());
        }
        let eye = shot.recording.pose_at_frame(frame.index).map_err(|e| e.to_string())?.position_in_world_m();
        let towards = shot.recording.up.unwrap_or(eye - self.points_m[0]);
        let plane = plane_through(&self.points_m).map(|fit| fit.plane.facing(towards));
        self.cancel();
        self.picker.plane = Some(plane.map_err(|e| e.to_string())?);
        Ok(Some("Things are placed on the plane through the three points.".to_owned()))
    }

    /// Paints the picked points and an instruction.
    pub fn paint(&self, picture: &PictureOutput, project: &Project, frame: usize) {
        if let Ok(eye) = project.shot().posed_camera(frame) {
            for (n, point) in self.points_m.iter().enumerate() {
                if let Some(px) = eye.project(*point) {
                    paint_ring(picture, picture.placed.screen(vec2(px.x as f32, px.y as f32)), &(n + 1).to_string());
                }
            }
        }
        match self.task.filter(|_| self.is_picking() && !self.picker.awaits_second_view()) {
            Some(Task::Plane) => {
                picture.prompt(&format!("Click three points of the surface ({} of 3)", self.points_m.len() + 1))
            }
            Some(Task::Scale) => {
                picture.prompt(&format!("Click two points whose distance you know ({} of 2)", self.points_m.len() + 1))
            }
            None => {}
        }
        self.picker.paint(picture, project.shot(), frame);
    }

    /// Shows the controls. Returns a message or an error.
    pub fn show(&mut self, ui: &mut Ui, project: &mut Project) -> Option<Result<String, String>> {
        let has_depth = project.shot().recording.has_depth();
        let is_metric = project.shot().recording.kind.is_metric();
        ui.horizontal_wrapped(|ui| {
            ui.label("Surface");
            match self.picker.plane {
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
                        self.picker.plane = None;
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
                self.begin(Task::Plane);
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
                self.begin(Task::Scale);
            }
        });
        let (Some(Task::Scale), [a, b]) = (self.task, self.points_m.as_slice()) else { return None };
        let (a, b) = (*a, *b);
        let mut result = None;
        ui.horizontal_wrapped(|ui| {
            ui.label("Distance");
            let field = numeric(ui, "true distance", &mut self.distance_m, 0.005, " m");
            let is_entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if ui.button("Set").clicked() || is_entered {
                result = Some(set_scale(project, a, b, self.distance_m));
            }
            if ui.button("Cancel").clicked() {
                self.cancel();
            }
        });
        let unit = if is_scaled(project.shot()) { "m" } else { "units" };
        ui.label(RichText::new(format!("Now it is {} {unit}.", fixed(a.distance(b), 4))).weak());
        if matches!(result, Some(Ok(_))) {
            self.cancel();
            self.picker.plane = None;
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
