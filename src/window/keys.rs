//! The page of keys.

use eframe::egui::{self, Align, Align2, Label, Layout, ScrollArea, Ui, Vec2, vec2};

use super::actions;

/// Widths of a key and of its text, and the gaps between columns, points.
const KEY_PT: f32 = 130.0;
const TEXT_PT: f32 = 230.0;
const GAP_PT: f32 = 12.0;
/// Width of the window's own border and margins, points.
const BORDER_PT: f32 = 40.0;

/// Shows the page while it is open.
pub fn show(ctx: &egui::Context, is_open: &mut bool) {
    let room = ctx.content_rect().size() - vec2(BORDER_PT, 80.0);
    let columns = columns(room.x);
    let width = columns as f32 * (KEY_PT + TEXT_PT + 2.0 * GAP_PT);
    let window = egui::Window::new("Keys").open(is_open).resizable(false).anchor(Align2::CENTER_CENTER, Vec2::ZERO);
    window.show(ctx, |ui| {
        ui.set_width(width.min(room.x));
        let height = room.y.max(100.0);
        let area = ScrollArea::vertical().max_height(height).min_scrolled_height(height);
        area.show(ui, |ui| page(ui, columns));
    });
}

/// Number of columns for a width.
fn columns(width: f32) -> usize {
    if width >= 2.0 * (KEY_PT + TEXT_PT + 2.0 * GAP_PT) { 2 } else { 1 }
}

/// Sections of the page, distributed over the columns.
fn page(ui: &mut Ui, columns: usize) {
    ui.horizontal_top(|ui| {
        ui.spacing_mut().item_spacing.x = GAP_PT;
        let sections = actions::page();
        for column in 0..columns {
            ui.vertical(|ui| {
                for (title, lines) in sections.iter().skip(column).step_by(columns) {
                    ui.strong(*title);
                    lines.iter().for_each(|(key, does)| line(ui, key, does));
                    ui.add_space(8.0);
                }
            });
        }
    });
}

/// A key and its text, each wrapped within its width.
fn line(ui: &mut Ui, key: &str, does: &str) {
    ui.horizontal_top(|ui| {
        for (text, width) in [(key, KEY_PT), (does, TEXT_PT)] {
            ui.allocate_ui_with_layout(vec2(width, 0.0), Layout::top_down(Align::Min), |ui| {
                ui.set_width(width);
                ui.add(Label::new(text).wrap());
            });
        }
    });
}
