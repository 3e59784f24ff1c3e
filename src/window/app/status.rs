//! The status bar below the picture: a mark for warnings, and the newest message in one line.

use eframe::egui::{self, Align, Color32, Label, Layout, RichText, Sense, Ui};

use super::super::list::sign;
use super::super::message::MessageWindow;
use super::App;
use locard_engine::text::count;

/// Tooltip of the message.
const TOOLTIP: &str = "Click to read and copy the whole message";
/// Width of the link to the details of a message, points.
const DETAILS_WIDTH: f32 = 60.0;

/// Content of the status bar.
struct StatusText {
    text: String,
    /// Longer text of the message.
    details: Option<String>,
    color: Color32,
}

impl App {
    /// Shows the status bar. Its height is constant, so that nothing above it moves.
    pub(super) fn status(&mut self, ui: &mut Ui) {
        let height = ui.text_style_height(&egui::TextStyle::Body);
        let size = egui::vec2(ui.available_width(), height);
        ui.allocate_ui_with_layout(size, Layout::left_to_right(Align::Center), |ui| {
            ui.set_min_height(height);
            self.warning_mark(ui);
            let Some(StatusText { text, details, color }) = self.status_text(ui) else { return };
            let label = Label::new(RichText::new(&text).color(color)).truncate().show_tooltip_when_elided(false);
            // Not selectable, because the text may be cut off.
            let label = label.selectable(false).sense(Sense::click());
            let width = ui.available_width() - if details.is_some() { DETAILS_WIDTH } else { 0.0 };
            let response = ui
                .scope(|ui| {
                    ui.set_max_width(width.max(0.0));
                    ui.add(label)
                })
                .inner;
            let mut is_opened =
                response.on_hover_cursor(egui::CursorIcon::PointingHand).on_hover_text(TOOLTIP).clicked();
            if details.is_some() {
                is_opened |= ui.link("Details").clicked();
            }
            if is_opened {
                let whole = details.map_or(text.clone(), |details| format!("{text}\n\n{details}"));
                self.documents.message = Some(MessageWindow::new(whole));
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

    /// The newest message. It covers a persistent problem until it has been read.
    fn status_text(&self, ui: &Ui) -> Option<StatusText> {
        let visuals = ui.visuals();
        let plain = |text: String, color| StatusText { text, details: None, color };
        if let Some(new) = self.document.session.new_message(ui.input(|i| i.time)) {
            let color = if new.is_error { visuals.error_fg_color } else { visuals.text_color() };
            return Some(StatusText { text: new.text.to_owned(), details: new.details.map(str::to_owned), color });
        }
        if let Some(problem) = self.document.session.problem() {
            return Some(plain(problem.to_owned(), visuals.error_fg_color));
        }
        if let Some(message) = self.document.session.message() {
            let details = self.document.session.message_details().map(str::to_owned);
            return Some(StatusText { text: message.to_owned(), details, color: visuals.weak_text_color() });
        }
        // A live camera's panel reports it instead.
        let stats = self.document.session.stats().filter(|_| !self.document.session.is_live())?;
        let why = stats.no_pose.as_ref()?;
        Some(plain(format!("No camera position for this frame; evidence hidden ({why})"), visuals.warn_fg_color))
    }
}
