//! What things are placed on where the depth does not say it, and how long a unit is: a plane by three points, a scale by two
//! points and their distance.

use eframe::egui::{Key, RichText, Ui, vec2};
use glam::{DVec2, DVec3};

use super::Project;
use super::fields::{numeric, rounded};
use super::finder::{Click, Finder, is_scaled, mark};
use super::picture::Seen;
use locard_engine::frame::Frame;
use locard_engine::scene::SceneFile;
use locard_engine::shot::{metres_per_unit, plane_through};
use locard_engine::text::fixed;

/// What points are picked for.
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

/// The surface that is placed on, and the scale.
#[derive(Clone, Debug)]
pub struct Ground {
    pub finder: Finder,
    task: Option<Task>,
    /// Picked so far for the task.
    points_m: Vec<DVec3>,
    /// Between the two points of a scale, as a person measured it.
    distance_m: f64,
}

impl Default for Ground {
    fn default() -> Self {
        Self { finder: Finder::default(), task: None, points_m: Vec::new(), distance_m: 1.0 }
    }
}

impl Ground {
    /// Whether the next click in the picture is for a plane or a scale.
    pub fn is_picking(&self) -> bool {
        self.task.is_some_and(|task| self.points_m.len() < task.points())
    }

    /// Whether a plane, a scale or a point is half found.
    pub fn is_busy(&self) -> bool {
        self.task.is_some() || self.finder.is_between()
    }

    pub fn cancel(&mut self) {
        self.finder.cancel();
        (self.task, self.points_m) = (None, Vec::new());
    }

    fn begin(&mut self, task: Task) {
        self.cancel();
        self.task = Some(task);
        if task == Task::Plane {
            self.finder.plane = None;
        }
    }

    /// Takes a click for the plane or the scale. Gives what is to be said.
    pub fn click(&mut self, project: &Project, frame: &Frame, at_px: DVec2) -> Result<Option<String>, String> {
        let Some(task) = self.task else { return Ok(None) };
        let shot = project.shot();
        let support = match self.finder.click(shot, project.up(), frame, at_px)? {
            Click::Again(text) => return Ok(Some(text)),
            Click::Point(support) => support,
        };
        self.points_m.push(support.point_m);
        if task != Task::Plane || self.points_m.len() < task.points() {
            return Ok(self.finder.told.clone());
        }
        let eye = shot.recording.pose_at_frame(frame.index).map_err(|e| e.to_string())?.position_in_world_m();
        let towards = shot.recording.up.unwrap_or(eye - self.points_m[0]);
        let plane = plane_through(&self.points_m).map(|plane| plane.facing(towards));
        self.cancel();
        self.finder.plane = Some(plane.map_err(|e| e.to_string())?);
        Ok(Some("Things are placed on the plane through the three points.".to_owned()))
    }

    /// Shows in the picture what is picked so far.
    pub fn paint(&self, seen: &Seen, project: &Project, frame: usize) {
        if let Ok(eye) = project.shot().eye(frame) {
            for (n, point) in self.points_m.iter().enumerate() {
                if let Some(px) = eye.project(*point) {
                    mark(seen, seen.placed.screen(vec2(px.x as f32, px.y as f32)), &(n + 1).to_string());
                }
            }
        }
        match self.task.filter(|_| self.is_picking() && !self.finder.is_between()) {
            Some(Task::Plane) => {
                seen.tell(&format!("Click three points of the surface ({} of 3)", self.points_m.len() + 1))
            }
            Some(Task::Scale) => {
                seen.tell(&format!("Click two points whose distance you know ({} of 2)", self.points_m.len() + 1))
            }
            None => {}
        }
        self.finder.paint(seen, project.shot(), frame);
    }

    /// The controls. Gives what is to be said, or what went wrong.
    pub fn show(&mut self, ui: &mut Ui, project: &mut Project) -> Option<Result<String, String>> {
        let has_depth = project.shot().recording.has_depth();
        let is_metric = project.shot().recording.kind.is_metric();
        ui.horizontal_wrapped(|ui| {
            ui.label("Surface");
            match self.finder.plane {
                Some(_) => {
                    ui.label("a plane");
                    let back = match has_depth {
                        true => "As the depth shows",
                        false if project.shot().floor().is_some() => "The floor",
                        false => "None",
                    };
                    if ui.button(back).clicked() {
                        self.finder.plane = None;
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
            match is_scaled(project.shot()) {
                true => ui.label(format!("1 unit = {} m", fixed(project.shot().recording.metres_per_unit, 5))),
                false => ui.label("not known"),
            };
            let hint = "Click two points whose true distance you know.";
            if ui.button("Two points…").on_hover_text(hint).clicked() {
                self.begin(Task::Scale);
            }
        });
        let (Some(Task::Scale), [a, b]) = (self.task, self.points_m.as_slice()) else { return None };
        let (a, b) = (*a, *b);
        let mut said = None;
        ui.horizontal_wrapped(|ui| {
            ui.label("Distance");
            let field = numeric(ui, "true distance", &mut self.distance_m, 0.005, " m");
            let is_entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if ui.button("Set").clicked() || is_entered {
                said = Some(set_scale(project, a, b, self.distance_m));
            }
            if ui.button("Cancel").clicked() {
                self.cancel();
            }
        });
        let unit = if is_scaled(project.shot()) { "m" } else { "units" };
        ui.label(RichText::new(format!("Now it is {} {unit}.", fixed(a.distance(b), 4))).weak());
        if matches!(said, Some(Ok(_))) {
            self.cancel();
            self.finder.plane = None;
        }
        said
    }
}

/// What was placed stays where it is seen, in its true size.
fn set_scale(project: &mut Project, a: DVec3, b: DVec3, distance_m: f64) -> Result<String, String> {
    let now = project.shot().recording.metres_per_unit;
    let unit = metres_per_unit(a, b, distance_m, now).ok_or("The distance must be above 0, and the points apart.")?;
    // As many digits as a person's picks have, and more.
    let unit: f64 = format!("{unit:.5e}").parse().unwrap_or(unit);
    let factor = unit / now;
    let changed = project.change_scene("scale set", |scene| {
        scene.metres_per_unit = Some(unit);
        move_apart(scene, factor);
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

/// Moves all things of a scene with a world that becomes larger, about its origin. They keep their size, and lamps shine onto what they
/// shone onto as brightly as before.
fn move_apart(scene: &mut SceneFile, factor: f64) {
    let moved = |c: &mut f64| *c = (*c * factor * 1e4).round() / 1e4;
    for object in &mut scene.objects {
        let own = object.position_m.iter_mut();
        let all = own.chain(object.instances.iter_mut().filter_map(|instance| instance.position_m.as_mut()));
        all.flatten().for_each(moved);
    }
    for lamp in &mut scene.light.lamp {
        lamp.at_m.iter_mut().for_each(moved);
        // Light falls off with the square of the distance.
        lamp.intensity = Some(rounded(lamp.intensity.unwrap_or(1.0) * factor * factor));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::scene::document::PlacedModel;

    #[test]
    fn in_a_world_three_times_as_large_lamps_shine_nine_times_as_bright_from_three_times_as_far() {
        let mut scene = SceneFile::default();
        scene.objects.push(PlacedModel { position_m: Some([0.1, -2.0, 0.0]), ..PlacedModel::default() });
        scene.add_lamp(DVec3::new(1.0, 0.5, 0.25));
        move_apart(&mut scene, 3.0);
        let lamp = &scene.light.lamp[0];
        assert_eq!((lamp.at_m, lamp.intensity, lamp.diameter_m), ([3.0, 1.5, 0.75], Some(9.0), None));
        assert_eq!(scene.objects[0].position_m, Some([0.3, -6.0, 0.0]));
    }
}
