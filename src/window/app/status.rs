//! The status bar below the picture: the newest message, in one line.

use eframe::egui::{self, Color32, Label, RichText, Sense, Ui};

use super::super::message::MessageWindow;
use super::App;

/// Tooltip of the message.
const HINT: &str = "Click to read and copy the whole message";

impl App {
    /// Shows the status bar. It has its height without a message too, so that nothing above it
    /// moves.
    pub(super) fn status(&mut self, ui: &mut Ui) {
        let height = ui.text_style_height(&egui::TextStyle::Body);
        ui.allocate_ui(egui::vec2(ui.available_width(), height), |ui| {
            ui.set_min_height(height);
            let Some((text, color)) = self.status_text(ui) else { return };
            let label = Label::new(RichText::new(&text).color(color)).truncate().show_tooltip_when_elided(false);
            // Not selectable: a part of the cut text is of no use.
            let response = ui.add(label.selectable(false).sense(Sense::click()));
            if response.on_hover_cursor(egui::CursorIcon::PointingHand).on_hover_text(HINT).clicked() {
                self.keeper.message = Some(MessageWindow::new(text));
            }
        });
    }

    /// The text and its colour. A new message covers a lasting problem until it has been read.
    fn status_text(&self, ui: &Ui) -> Option<(String, Color32)> {
        let visuals = ui.visuals();
        if let Some(new) = self.session.new_message(ui.input(|i| i.time)) {
            let color = if new.is_wrong { visuals.error_fg_color } else { visuals.text_color() };
            return Some((new.text.to_owned(), color));
        }
        if let Some(problem) = self.session.problem() {
            return Some((problem.to_owned(), visuals.error_fg_color));
        }
        if let Some(said) = self.session.said() {
            return Some((said.to_owned(), visuals.weak_text_color()));
        }
        // The panel of a live camera reports it.
        let stats = self.session.stats().filter(|_| !self.session.is_live())?;
        let why = stats.no_pose.as_ref()?;
        Some((format!("No camera position for this frame; evidence hidden ({why})"), visuals.warn_fg_color))
    }
}
