//! The bar above the picture.

use eframe::egui::{self, Ui};

use super::super::session::FROZEN;
use super::App;
use crate::words::quoted;

impl App {
    pub(super) fn bar(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            let recording = &self.session.project.shot().recording;
            let place = recording.path.display().to_string();
            let camera = match self.session.project.shot().profiles() {
                [] => "no profile".to_owned(),
                profiles => profiles.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join("\n"),
            };
            ui.strong(quoted(&recording.name)).on_hover_text(format!("{place}\n{camera}"));
            if self.session.is_live() {
                // As long as the name of what is frozen is, so that nothing beside it moves.
                let room = egui::RichText::new(FROZEN).strong().color(egui::Color32::TRANSPARENT);
                ui.label(room);
            }
            // It keeps its room, so that nothing beside it moves.
            let star = egui::RichText::new("•").color(match self.session.project.is_saved() {
                true => egui::Color32::TRANSPARENT,
                false => ui.visuals().strong_text_color(),
            });
            ui.label(star);
            self.keeper.menu(ui, &mut self.session);
            ui.separator();
            let (undo, redo) = (self.session.project.history().can_undo(), self.session.project.history().can_redo());
            if ui.add_enabled(undo, egui::Button::new("Undo")).on_hover_text("Ctrl+Z").clicked() {
                self.undo();
            }
            if ui.add_enabled(redo, egui::Button::new("Redo")).on_hover_text("Ctrl+Shift+Z").clicked() {
                self.redo();
            }
            ui.toggle_value(&mut self.shows_history, "History");
            let unsaved = !self.session.project.is_saved();
            if ui.add_enabled(unsaved, egui::Button::new("Save")).on_hover_text("Ctrl+S").clicked() {
                self.keeper.save();
            }
            ui.toggle_value(&mut self.keeper.shows_output, "Export").on_hover_text("Ctrl+E");
            ui.separator();
            if ui.selectable_label(self.view.zoom.is_none(), "Fit").on_hover_text("F").clicked() {
                self.view.zoom = None;
            }
            if ui.selectable_label(self.view.zoom == Some(1.0), "100 %").on_hover_text("1").clicked() {
                self.view.zoom_to(1.0);
            }
            let mut wiped = self.view.wipe.is_some();
            if ui.toggle_value(&mut wiped, "Wipe").on_hover_text("W: drag the line in the picture").changed() {
                self.view.wipe = wiped.then_some(0.5);
            }
            let edits_b = self.session.project.edit().other.as_ref().map(|other| other.is_a);
            let hint = "B: two settings beside each other";
            if ui.selectable_label(edits_b.is_some(), "A|B").on_hover_text(hint).clicked() {
                self.compare();
            }
            if let Some(edits_b) = edits_b {
                for (name, is_edited) in [("A", !edits_b), ("B", edits_b)] {
                    let label = ui.selectable_label(is_edited, name).on_hover_text("Shift+B: edit the other one");
                    if label.clicked() && !is_edited {
                        self.session.project.exchange();
                    }
                }
                let text = if edits_b { "B to A" } else { "A to B" };
                if ui.button(text).on_hover_text("Copy the settings that are edited to the other one").clicked() {
                    self.session.project.copy_to_other();
                }
            }
            ui.toggle_value(&mut self.view.loupe, "Loupe").on_hover_text("L: code values at the pointer");
            ui.separator();
            ui.toggle_value(&mut self.shows_keys, "Keys").on_hover_text("?");
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if self.session.lacks_camera() && ui.button("Open a profile…").clicked() {
                    self.keeper.choose_profile(&self.session.project);
                }
                let visuals = ui.visuals();
                let (wrong, odd, weak) = (visuals.error_fg_color, visuals.warn_fg_color, visuals.weak_text_color());
                // Of a camera it stands below the picture.
                let stats = self.session.stats().filter(|_| !self.session.is_live());
                let no_pose = || stats.and_then(|stats| stats.no_pose.clone());
                let told = match (self.session.problem(), self.session.said()) {
                    (Some(problem), _) => Some((problem.to_owned(), wrong)),
                    (None, Some(said)) => Some((said.to_owned(), weak)),
                    (None, None) => no_pose().map(|why| (format!("Nothing is drawn here: {why}"), odd)),
                };
                let Some((text, color)) = told else { return };
                let label = egui::Label::new(egui::RichText::new(&text).color(color)).truncate();
                let response = ui.add(label.sense(egui::Sense::click()));
                if response.on_hover_text("Click: all of it").clicked() {
                    self.keeper.message = Some(text);
                }
            });
        });
    }
}
