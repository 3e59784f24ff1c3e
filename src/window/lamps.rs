//! The lamp panel: white matching, the scene's lamps, and adding one.

use std::sync::Arc;

use eframe::egui::{self, Ui, vec2};

use super::Project;
use super::environment_light;
use super::fields::{color_picker, rounded, row};
use super::lamp_pick::{LampPick, add_above_centre};
use super::object_actions;
use super::theme;
use super::tool::ToolStack;
use locard_engine::frame::Frame;
use locard_engine::scene::SceneItem;
use locard_engine::scene::document::{Color, LampTable};

/// Shows the panel of the scene's light: white matching, the lamps, and the controls of the
/// selected one. Returns a message.
pub fn show(
    ui: &mut Ui,
    project: &mut Project,
    frame: Option<&Arc<Frame>>,
    selected: &mut Option<SceneItem>,
    tools: &mut ToolStack,
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
        let hint = "Then click on white paper or paint: the light is matched to its brightness and colour.";
        let matched = egui::Button::selectable(is_picking, "Match white").frame_when_inactive(true);
        if ui.add(matched).on_hover_text(hint).clicked() {
            tools.toggle_lamp_pick(LampPick::White);
        }
    }
    ui.strong("Lamps");
    for (n, lamp) in project.edit().scene.light.lamp.clone().iter().enumerate() {
        let item = SceneItem::Lamp(n);
        ui.horizontal(|ui| {
            let (rect, _) = ui.allocate_exact_size(vec2(12.0, 12.0), egui::Sense::hover());
            ui.painter().circle(
                rect.center(),
                5.0,
                theme::of_light(lamp.rgb()),
                ui.visuals().widgets.noninteractive.fg_stroke,
            );
            let is_selected = *selected == Some(item);
            if ui.selectable_label(is_selected, project.edit().scene.title(item)).clicked() {
                *selected = (!is_selected).then_some(item);
            }
        });
    }
    let hint = if has_depth {
        "Then click a place for it; without depth there, it hangs 1 m above the scene's middle."
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
        ui.label("colour").on_hover_text("Its light on white matt surfaces that face it at 1 m, times the intensity");
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
