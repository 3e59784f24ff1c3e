//! The lamp panel: white matching, the scene's lamps, and adding one.

use std::sync::Arc;

use eframe::egui::{self, Ui, vec2};
use glam::{DVec2, DVec3};

use super::Project;
use super::environment_light;
use super::fields::{color_picker, rounded, row};
use super::object_actions;
use super::point_picker::surface_point;
use super::theme;
use super::tool::{ClickContext, Tools};
use locard_engine::frame::Frame;
use locard_engine::scene::document::{Color, LampTable};
use locard_engine::scene::{Scene, SceneItem, bounds_m};
use locard_engine::shot::FramePoint;

/// Purpose of a click in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LampPick {
    /// Position of a new lamp.
    Position,
    /// A white surface to match the light to.
    White,
}

/// Default height of a lamp above the centre of the scene, m.
const DEFAULT_HEIGHT_M: f64 = 1.0;
const DEFAULT_HEIGHT_NOTE: &str = "No depth here: the lamp hangs 1 m above the scene's middle.";

impl LampPick {
    /// Instruction for the click.
    pub fn prompt(self) -> &'static str {
        match self {
            Self::White => "Click on white paper or paint in the light. Esc ends it",
            Self::Position => "Click where the lamp shall be. Esc ends it",
        }
    }

    /// Handles a click in the picture: matches the light to a white surface, or adds a lamp that
    /// touches the surface. Returns a message.
    pub fn click(self, context: ClickContext<'_>, at_px: DVec2) -> Result<Option<String>, String> {
        let ClickContext { project, ground, frame, selected } = context;
        if self == Self::White {
            return project.match_white(FramePoint { frame: frame.index, at_px }).map(Some);
        }
        match surface_point(ground.plane, project.shot(), frame, at_px) {
            Some(support) => {
                let radius_m = 0.5 * LampTable::default().diameter_or_default_m();
                *selected = Some(project.add_lamp(support.point_m + radius_m * support.normal)?);
                Ok(None)
            }
            None => add_above_centre(project, selected).map(Some),
        }
    }
}

/// Adds a lamp above the centre of the scene. Returns a note.
fn add_above_centre(project: &mut Project, selected: &mut Option<SceneItem>) -> Result<String, String> {
    *selected = Some(project.add_lamp(default_position_m(project))?);
    Ok(DEFAULT_HEIGHT_NOTE.to_owned())
}

/// Shows the panel of the scene's light: white matching, the lamps, and the controls of the
/// selected one. Returns a message.
pub fn show(
    ui: &mut Ui,
    project: &mut Project,
    frame: Option<&Arc<Frame>>,
    selected: &mut Option<SceneItem>,
    tools: &mut Tools,
) -> Option<String> {
    if !project.can_place() {
        return None;
    }
    ui.separator();
    ui.strong("Light");
    let has_depth = frame.is_some_and(|frame| frame.depth.is_some());
    let mut message = environment_light::show(ui, project);
    if has_depth && !project.is_lit_by_models() {
        let is_picking = tools.lamp_pick() == Some(LampPick::White);
        let hint =
            "Then click on white paper or paint: all light becomes as bright and gets the colour that it shows there.";
        let matched = egui::Button::selectable(is_picking, "Match white").frame_when_inactive(true);
        if ui.add(matched).on_hover_text(hint).clicked() {
            tools.toggle_lamp_pick(LampPick::White);
        }
    }
    ui.strong("Lamps");
    for (n, lamp) in project.edit().scene.light.lamp.clone().iter().enumerate() {
        let thing = SceneItem::Lamp(n);
        ui.horizontal(|ui| {
            let (rect, _) = ui.allocate_exact_size(vec2(12.0, 12.0), egui::Sense::hover());
            ui.painter().circle(
                rect.center(),
                5.0,
                theme::of_light(lamp.rgb()),
                ui.visuals().widgets.noninteractive.fg_stroke,
            );
            let is_selected = *selected == Some(thing);
            if ui.selectable_label(is_selected, project.edit().scene.title(thing)).clicked() {
                *selected = (!is_selected).then_some(thing);
            }
        });
    }
    let hint = if has_depth {
        "Then click where it shall be; where no depth is, it hangs 1 m above the scene's middle."
    } else {
        "1 m above the scene's middle, to be moved from there."
    };
    let add =
        egui::Button::selectable(tools.lamp_pick() == Some(LampPick::Position), "Add lamp").frame_when_inactive(true);
    if ui.add(add).on_hover_text(hint).clicked() {
        // Without a camera pose the picture shows why no lamp can be placed.
        let has_camera = frame.is_some_and(|frame| project.shot().posed_camera(frame.index).is_ok());
        if has_depth || !has_camera {
            tools.toggle_lamp_pick(LampPick::Position);
        } else {
            message = Some(add_above_centre(project, selected).unwrap_or_else(|why| why));
        }
    }
    if let Some(SceneItem::Lamp(n)) = *selected
        && let Some(lamp) = project.edit().scene.light.lamp.get(n).cloned()
    {
        ui.separator();
        ui.label(project.edit().scene.title(SceneItem::Lamp(n)));
        message = fields(ui, project, n, &lamp).or(message);
        ui.horizontal(|ui| {
            if ui.button("Duplicate").on_hover_text("Shift+D, and move it").clicked() {
                message = object_actions::duplicate(project, selected);
            }
            if ui.button("Delete").on_hover_text("Del").clicked() {
                message = object_actions::delete(project, selected);
            }
        });
    }
    message
}

/// Point above the centre of the scene's bounding box; above the world's origin in an empty scene.
fn default_position_m(project: &Project) -> DVec3 {
    centre_m(&project.shot().scene) + project.up() * DEFAULT_HEIGHT_M
}

fn centre_m(scene: &Scene) -> DVec3 {
    let boxes = scene.objects.iter().filter_map(|object| bounds_m(scene, object));
    let around = boxes.reduce(|(low, high), (l, h)| (low.min(l), high.max(h)));
    around.map_or(DVec3::ZERO, |(low, high)| 0.5 * (low + high))
}

/// Fields of a lamp. Returns an error.
fn fields(ui: &mut Ui, project: &mut Project, n: usize, lamp: &LampTable) -> Option<String> {
    let mut changed = lamp.clone();
    // Changes of a colour picker form one undo step until the pointer is released.
    let mut done = ui.input(|i| i.pointer.any_released());
    let (mut intensity, mut rgb, mut diameter_or_default_m) =
        (lamp.intensity.unwrap_or(1.0), lamp.rgb(), lamp.diameter_or_default_m());
    egui::Grid::new("lamp").num_columns(2).spacing([8.0, 3.0]).show(ui, |ui| {
        for (axis, value) in ["x", "y", "z"].into_iter().zip(&mut changed.at_m) {
            done |= row(ui, axis, &format!("lamp {axis}"), value, 0.005, " m");
        }
        let speed = |value: f64| 0.01 * value.abs().max(0.1);
        let step = speed(intensity);
        done |= row(ui, "intensity", "lamp intensity", &mut intensity, step, "");
        let most = rgb.into_iter().fold(0.0, f64::max);
        for (color, value) in ["red", "green", "blue"].into_iter().zip(&mut rgb) {
            done |= row(ui, color, &format!("lamp {color}"), value, speed(most), "");
        }
        ui.label("colour").on_hover_text("What white matt that faces it shows at 1 m, times the intensity");
        color_picker(ui, "lamp colour", &mut rgb);
        ui.end_row();
        done |= row(ui, "diameter", "lamp diameter", &mut diameter_or_default_m, 0.002, " m");
    });
    // Rounds to 0.1 mm or five digits, changed values only.
    let short = |to: f64, from: f64| if to == from { to } else { (to * 1e4).round() / 1e4 };
    for (to, from) in changed.at_m.iter_mut().zip(lamp.at_m) {
        *to = short(*to, from);
    }
    let mut what = (changed.at_m != lamp.at_m).then_some("moved");
    if intensity != lamp.intensity.unwrap_or(1.0) {
        (changed.intensity, what) = (Some(rounded(intensity.max(0.0))), Some("intensity"));
    }
    if rgb != lamp.rgb() {
        (changed.color, what) = (Some(Color::Rgb(rgb.map(|c| rounded(c.max(0.0))))), Some("colour"));
    }
    if diameter_or_default_m != lamp.diameter_or_default_m() {
        (changed.diameter_m, what) =
            (Some(short(diameter_or_default_m, lamp.diameter_or_default_m()).max(0.0)), Some("diameter"));
    }
    let mut wrong = None;
    if let Some(what) = what {
        let what = format!("{}: {what}", project.edit().scene.title(SceneItem::Lamp(n)));
        wrong = project.change_scene(&what, |scene| scene.light.lamp[n] = changed).err().map(|e| e.to_string());
    }
    if done {
        project.close_step();
    }
    wrong
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;

    #[test]
    fn default_lamp_position_is_above_the_centre_of_the_scene() {
        let open = |scene: Option<&str>| {
            let given = ShotOptions { scene: scene.map(Into::into), ..ShotOptions::default() };
            Project::open(Path::new("recordings/demo"), &OpenOptions::default(), &given).unwrap()
        };
        // Things from the marker at the left, x = −0.1, to those on the stool at the right, 0 to
        // 0.41 m above the floor.
        let at_m = default_position_m(&open(Some("scenes/demo.toml")));
        assert!((at_m - DVec3::new(0.2, -0.1, 1.25)).abs().max_element() < 0.1, "{at_m}");
        assert_eq!(default_position_m(&open(None)), DVec3::Z);
    }
}
