//! How far something is that a person waits for.

use eframe::egui::{self, ProgressBar, RichText, Ui, WidgetInfo};

use super::background::Background;

/// A bar, with words in it if there are any; `called` names what is waited for.
pub fn bar(ui: &mut Ui, called: &str, share: f32, text: Option<String>) {
    let bar = match text {
        Some(text) => ProgressBar::new(share).text(text),
        None => ProgressBar::new(share).desired_height(6.0),
    };
    ui.add(bar).widget_info(|| WidgetInfo::labeled(egui::Role::ProgressIndicator, true, called));
}

/// How far work in the background is, or why it broke off.
pub fn of<K: PartialEq, T: Send + 'static>(ui: &mut Ui, called: &str, work: &Background<K, T>) {
    if let Some(share) = work.progress() {
        bar(ui, called, share, None);
        ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
    }
    broken(ui, called, work);
}

/// Why work in the background broke off. How far it is does not show: it is over soon, and begun with every change.
pub fn broken<K: PartialEq, T: Send + 'static>(ui: &mut Ui, called: &str, work: &Background<K, T>) {
    if let Some(why) = work.broken() {
        refused(ui, &format!("{called}: {why}"));
    }
}

/// Why something cannot be had.
pub fn refused(ui: &mut Ui, why: &str) {
    ui.add(egui::Label::new(RichText::new(why).color(ui.visuals().warn_fg_color)).wrap());
}
