//! The page of keys.

use eframe::egui::{self, Align2, ScrollArea, Ui, Vec2};

use super::actions;

/// Shows it, as long as it is open.
pub fn show(ctx: &egui::Context, is_open: &mut bool) {
    let window = egui::Window::new("Keys").open(is_open).resizable(false).anchor(Align2::CENTER_CENTER, Vec2::ZERO);
    window.show(ctx, |ui| {
        let height = (ctx.content_rect().height() - 80.0).max(100.0);
        ScrollArea::vertical().max_height(height).min_scrolled_height(height).show(ui, page);
    });
}

/// In two columns.
fn page(ui: &mut Ui) {
    ui.columns_const(|[left, right]: &mut [Ui; 2]| {
        for (n, (title, lines)) in actions::page().into_iter().enumerate() {
            let ui = if n % 2 == 0 { &mut *left } else { &mut *right };
            ui.strong(title);
            egui::Grid::new(title).num_columns(2).spacing([16.0, 4.0]).show(ui, |ui| {
                for (key, does) in lines {
                    ui.label(key);
                    ui.label(does);
                    ui.end_row();
                }
            });
            ui.add_space(8.0);
        }
    });
}
