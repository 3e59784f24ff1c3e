//! The bar above the picture.

use eframe::egui::{self, Color32, Ui};

use super::super::session::FROZEN;
use super::super::titles;
use super::App;
use locard_engine::text::shown;

/// Largest share of the window's width for the recording's name.
const NAME_SHARE: f32 = 0.16;

impl App {
    /// The recording's folder and its parent. Long names are elided so that the buttons keep their
    /// places.
    fn recording_name(&self, ui: &mut Ui) {
        let name = shown(&titles::of_recording(&self.document.session.project));
        let room = NAME_SHARE * ui.ctx().content_rect().width();
        let font = egui::TextStyle::Body.resolve(ui.style());
        let width = |text: &str| ui.painter().layout_no_wrap(text.to_owned(), font.clone(), Color32::WHITE).size().x;
        let text = titles::elided(&name, |text| width(text) <= room);
        let label = egui::Label::new(egui::RichText::new(text).strong()).extend();
        ui.add(label).on_hover_text(titles::paths(&self.document.session.project));
    }

    pub(super) fn bar(&mut self, ui: &mut Ui) {
        ui.horizontal_wrapped(|ui| {
            self.recording_name(ui);
            if self.document.session.is_live() {
                // Reserves the width of the suffix of a frozen recording, so that nothing beside it
                // moves.
                let room = egui::RichText::new(FROZEN).strong().color(egui::Color32::TRANSPARENT);
                ui.label(room);
            }
            // Always laid out, so that nothing beside it moves.
            let unsaved_mark = egui::RichText::new("•").color(if self.document.session.project.is_saved() {
                egui::Color32::TRANSPARENT
            } else {
                ui.visuals().strong_text_color()
            });
            ui.label(unsaved_mark);
            self.documents.menu(ui, &mut self.document.session);
            ui.separator();
            let (undo, redo) = (
                self.document.session.project.history().can_undo(),
                self.document.session.project.history().can_redo(),
            );
            if ui.add_enabled(undo, egui::Button::new("Undo")).on_hover_text("Ctrl+Z").clicked() {
                self.undo();
            }
            if ui.add_enabled(redo, egui::Button::new("Redo")).on_hover_text("Ctrl+Shift+Z").clicked() {
                self.redo();
            }
            ui.toggle_value(&mut self.shows_history, "History");
            let unsaved = !self.document.session.project.is_saved();
            if ui.add_enabled(unsaved, egui::Button::new("Save")).on_hover_text("Ctrl+S").clicked() {
                self.documents.save();
            }
            ui.toggle_value(&mut self.documents.output_jobs.is_open, "Export").on_hover_text("Ctrl+E");
            ui.separator();
            if ui.selectable_label(self.document.view.zoom.is_none(), "Fit").on_hover_text("F").clicked() {
                self.document.view.zoom = None;
            }
            if ui.selectable_label(self.document.view.zoom == Some(1.0), "100 %").on_hover_text("1").clicked() {
                self.document.view.zoom_to(1.0);
            }
            let mut wiped = self.document.view.wipe.is_some();
            if ui.toggle_value(&mut wiped, "Wipe").on_hover_text("W: drag the line in the picture").changed() {
                self.document.view.wipe = wiped.then_some(0.5);
            }
            let edits_b = self.document.session.project.edit().other.as_ref().map(|other| other.is_a);
            let hint = "B: two settings beside each other";
            if ui.selectable_label(edits_b.is_some(), "A|B").on_hover_text(hint).clicked() {
                self.compare();
            }
            if let Some(edits_b) = edits_b {
                for (name, is_edited) in [("A", !edits_b), ("B", edits_b)] {
                    let label = ui.selectable_label(is_edited, name).on_hover_text("Shift+B: switch between A and B");
                    if label.clicked() && !is_edited {
                        self.document.session.project.swap_variant();
                    }
                }
                let text = if edits_b { "B to A" } else { "A to B" };
                if ui.button(text).on_hover_text("Copy the edited settings to the other variant").clicked() {
                    self.document.session.project.copy_to_other();
                }
            }
            ui.toggle_value(&mut self.document.view.loupe, "Loupe")
                .on_hover_text("L: pixel values (8 bit) at the pointer");
            ui.separator();
            ui.toggle_value(&mut self.shows_keys, "Keys").on_hover_text("Keyboard shortcuts (?)");
        });
    }
}
