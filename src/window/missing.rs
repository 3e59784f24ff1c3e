//! Unreadable files of the scene, each with a button to locate it. The scene
//! is reloaded when one of them is back.

use std::path::PathBuf;

use eframe::egui::{self, Label, RichText, Ui};

use super::Project;
use locard_engine::scene::SceneError;

/// True if the file of a visible object or of the light is missing.
pub fn is_any_needed(project: &Project) -> bool {
    project.shot().scene.missing.iter().any(|missing| missing.is_needed)
}

/// Reloads the scene when a missing file may be back. This is not an undo step.
pub fn reload(project: &mut Project) -> Result<(), SceneError> {
    project.change_scene("loaded again", |_| ())
}

/// Shows a line for each missing file. Returns the one whose button was pressed.
pub fn show(ui: &mut Ui, project: &Project) -> Option<PathBuf> {
    let mut located = None;
    for missing in project.shot().scene.missing.iter().filter(|missing| missing.is_needed) {
        let name = missing.file.file_name().unwrap_or(missing.file.as_os_str()).to_string_lossy().into_owned();
        ui.horizontal(|ui| {
            let button = ui.button("Locate…");
            button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("Locate {name}…")));
            if button.clicked() {
                located = Some(missing.file.clone());
            }
            let text = RichText::new(format!("{name} is missing")).color(ui.visuals().warn_fg_color);
            let hint = format!("{}. Nothing is exported without it.", missing.problem);
            ui.add(Label::new(text).truncate()).on_hover_text(hint);
        });
    }
    located
}
