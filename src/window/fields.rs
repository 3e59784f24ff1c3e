//! Fields for numbers.

use eframe::egui::{self, Ui};

use super::controls::parse_number;
use crate::words::number;

/// A number to drag or to type, with four digits behind the point; `called` names it to those who do not see it.
pub fn numeric(ui: &mut Ui, called: &str, value: &mut f64, speed: f64, unit: &str) -> egui::Response {
    // What is typed counts when it is done.
    let drag = egui::DragValue::new(value).speed(speed).suffix(unit).custom_parser(parse_number);
    let drag = drag.update_while_editing(false);
    let response = ui.add(drag.custom_formatter(|n, _| number((n * 1e4).round() / 1e4)));
    response.widget_info(|| egui::WidgetInfo::slider(true, *value, called));
    response
}
