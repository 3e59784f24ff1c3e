//! Progress bars and failures of background work.

use eframe::egui::{self, ProgressBar, RichText, Ui, WidgetInfo};

use super::background::Background;

/// A progress bar with an optional text; `called` is its accessible name.
pub fn bar(ui: &mut Ui, called: &str, share: f32, text: Option<String>) {
    let bar = match text {
        Some(text) => ProgressBar::new(share).text(text),
        None => ProgressBar::new(share).desired_height(6.0),
    };
    ui.add(bar).widget_info(|| WidgetInfo::labeled(egui::Role::ProgressIndicator, true, called));
}

/// Progress of background work, or its failure.
pub fn of<K: PartialEq, T: Send + 'static>(ui: &mut Ui, called: &str, work: &Background<K, T>) {
    if let Some(share) = work.progress() {
        bar(ui, called, share, None);
        ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
    }
    failure(ui, called, work);
}

/// Failure of background work, without progress: for short work that restarts with every change.
pub fn failure<K: PartialEq, T: Send + 'static>(ui: &mut Ui, called: &str, work: &Background<K, T>) {
    if let Some(why) = work.failure() {
        refused(ui, &format!("{called}: {why}"));
    }
}

/// A wrapped warning.
pub fn refused(ui: &mut Ui, why: &str) {
    ui.add(egui::Label::new(RichText::new(why).color(ui.visuals().warn_fg_color)).wrap());
}
