//! The list of placed evidence, with selection, visibility and warnings.

use eframe::egui::{self, RichText, Stroke, Ui, vec2};

use super::Project;
use super::scene_checks::SceneChecks;
use super::tilt;
use locard_engine::scene::SceneItem;

/// Shows the list. A click selects; the check box shows and hides. Returns an error.
pub fn show(
    ui: &mut Ui,
    project: &mut Project,
    checks: &SceneChecks,
    selected: &mut Option<SceneItem>,
) -> Option<String> {
    let (scene, version) = (project.edit().scene.clone(), project.scene_version());
    let mut switched = None;
    egui::ScrollArea::vertical().max_height(220.0).auto_shrink([false, true]).show(ui, |ui| {
        for (object, entry) in scene.entries().into_iter().enumerate() {
            ui.horizontal(|ui| {
                let title = scene.title(entry);
                let mut is_shown = !scene.is_hidden(entry);
                let response = ui.checkbox(&mut is_shown, "").on_hover_text("Shown, or hidden");
                response.widget_info(|| {
                    egui::WidgetInfo::selected(egui::Role::CheckBox, true, is_shown, format!("{title}: shown"))
                });
                if response.changed() {
                    switched = Some((entry, !is_shown, title.clone()));
                }
                let name = title.clone();
                let is_selected = *selected == Some(entry.into());
                let text = if is_shown { RichText::new(title) } else { RichText::new(title).weak() };
                if ui.selectable_label(is_selected, text).clicked() {
                    *selected = (!is_selected).then_some(entry.into());
                }
                let mut warnings: Vec<String> = checks.notes(version, object).map(ToString::to_string).collect();
                warnings.extend(checks.tilt(version, object).and_then(|tilt| tilt::text(project, entry, &tilt)));
                if project.shot().scene.objects.get(object).is_some_and(|object| object.is_missing) {
                    sign(ui, &format!("{name}: model missing")).on_hover_text("A marked box stands in for its model");
                }
                if !warnings.is_empty() {
                    sign(ui, &format!("{name}: placement fault")).on_hover_text(warnings.join("\n"));
                }
            });
        }
    });
    let object = selected.and_then(|selected| scene.entries().iter().position(|entry| selected == (*entry).into()));
    for note in object.into_iter().flat_map(|object| checks.notes(version, object)) {
        ui.label(RichText::new(note.to_string()).small().color(ui.visuals().warn_fg_color));
    }
    let (entry, hidden, title) = switched?;
    let what = format!("{title}: {}", if hidden { "hidden" } else { "shown" });
    let done = project.change_scene(&what, |scene| scene.set_hidden(entry, hidden));
    project.close_step();
    done.err().map(|e| e.to_string())
}

/// A warning triangle.
pub fn sign(ui: &mut Ui, called: &str) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(vec2(14.0, 14.0), egui::Sense::hover());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, called));
    let (ink, middle) = (ui.visuals().warn_fg_color, rect.center_bottom() - vec2(0.0, 1.5));
    let corners = vec![rect.center_top(), rect.right_bottom() - vec2(0.0, 1.0), rect.left_bottom() - vec2(0.0, 1.0)];
    ui.painter().add(egui::Shape::closed_line(corners, Stroke::new(1.5, ink)));
    ui.painter().line_segment([middle - vec2(0.0, 7.5), middle - vec2(0.0, 4.0)], Stroke::new(1.5, ink));
    ui.painter().circle_filled(middle - vec2(0.0, 1.8), 0.9, ink);
    response
}
