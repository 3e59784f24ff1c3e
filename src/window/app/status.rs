//! The status bar below the picture: a mark for warnings, and the newest message in one line.

use eframe::egui::{self, Align, Color32, Label, Layout, RichText, Sense, Ui};

use super::super::list::sign;
use super::super::message::MessageWindow;
use super::App;
use locard_engine::text::count;

/// Tooltip of the message.
const TOOLTIP: &str = "Click to read and copy the whole message";

impl App {
    /// Shows the status bar. Its height is constant, so that nothing above it moves.
    pub(super) fn status(&mut self, ui: &mut Ui) {
        let height = ui.text_style_height(&egui::TextStyle::Body);
        let size = egui::vec2(ui.available_width(), height);
        ui.allocate_ui_with_layout(size, Layout::left_to_right(Align::Center), |ui| {
            ui.set_min_height(height);
            self.warning_mark(ui);
            let Some((text, color)) = self.status_text(ui) else { return };
            let label = Label::new(RichText::new(&text).color(color)).truncate().show_tooltip_when_elided(false);
            // Not selectable, because the text may be cut off.
            let response = ui.add(label.selectable(false).sense(Sense::click()));
            if response.on_hover_cursor(egui::CursorIcon::PointingHand).on_hover_text(TOOLTIP).clicked() {
                self.documents.message = Some(MessageWindow::new(text));
            }
        });
    }

    /// Shows a mark while the recording has warnings. A click shows them in full.
    fn warning_mark(&mut self, ui: &mut Ui) {
        let warnings = self.document.warnings.of(&self.document.session.project);
        if warnings.is_empty() {
            return;
        }
        let (mark, text) = (count(warnings.len(), "warning"), warnings.join("\n\n"));
        let sign = sign(ui, "warning").interact(Sense::click());
        let label = Label::new(RichText::new(mark).color(ui.visuals().warn_fg_color));
        let response = ui.add(label.selectable(false).sense(Sense::click())) | sign;
        if response.on_hover_cursor(egui::CursorIcon::PointingHand).on_hover_text(&text).clicked() {
            self.documents.message = Some(MessageWindow::new(text));
        }
        ui.separator();
    }

    /// The text and its colour. A new message covers a persistent problem until it has been read.
    fn status_text(&self, ui: &Ui) -> Option<(String, Color32)> {
        let visuals = ui.visuals();
        if let Some(new) = self.document.session.new_message(ui.input(|i| i.time)) {
            let color = if new.is_error { visuals.error_fg_color } else { visuals.text_color() };
            return Some((new.text.to_owned(), color));
        }
        if let Some(problem) = self.document.session.problem() {
            return Some((problem.to_owned(), visuals.error_fg_color));
        }
        if let Some(message) = self.document.session.message() {
            return Some((message.to_owned(), visuals.weak_text_color()));
        }
        // A live camera's panel reports it instead.
        let stats = self.document.session.stats().filter(|_| !self.document.session.is_live())?;
        let why = stats.no_pose.as_ref()?;
        Some((format!("No camera position for this frame; evidence hidden ({why})"), visuals.warn_fg_color))
    }
}
