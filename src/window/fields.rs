//! Fields for numbers, to drag and to type: how a number is read and shown, and Esc, which takes back what was typed.

use eframe::egui::{self, Context, Id, Ui};

use locard_engine::text::number;

/// A number to drag or to type, with four digits behind the point; `called` names it to those who do not see it.
pub fn numeric(ui: &mut Ui, called: &str, value: &mut f64, speed: f64, unit: &str) -> egui::Response {
    // What is typed counts when it is done.
    let drag = egui::DragValue::new(value).speed(speed).suffix(unit).custom_parser(typed(ui.ctx()));
    let drag = drag.update_while_editing(false);
    let response = ui.add(drag.custom_formatter(|n, _| number((n * 1e4).round() / 1e4)));
    response.widget_info(|| egui::WidgetInfo::slider(true, *value, called));
    response
}

/// A number with its label; whether a change of it has ended.
pub fn row(ui: &mut Ui, label: &str, called: &str, value: &mut f64, speed: f64, unit: &str) -> bool {
    ui.label(label);
    let response = numeric(ui, called, value, speed, unit);
    ui.end_row();
    response.drag_stopped() || response.lost_focus()
}

/// A button of that colour that opens a picker. How bright the brightest of the three is stays.
pub fn color_picker(ui: &mut Ui, called: &str, rgb: &mut [f64; 3]) {
    let most = Some(rgb.iter().copied().fold(0.0, f64::max)).filter(|most| *most > 0.0).unwrap_or(1.0);
    let mut hue = rgb.map(|c| (c / most) as f32);
    let response = ui.color_edit_button_rgb(&mut hue);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, called));
    let brightest = hue.into_iter().fold(0.0, f32::max);
    if response.changed() && brightest > 0.0 {
        *rgb = hue.map(|c| rounded(most * f64::from(c / brightest)));
    }
}

/// Where the pass is kept in which Esc was pressed last.
fn escaped() -> Id {
    Id::unique("esc in a field")
}

/// To be called when Esc is pressed while something is typed, before the fields are shown.
pub fn take_back(ctx: &Context) {
    let pass = ctx.cumulative_pass_nr();
    ctx.data_mut(|data| data.insert_temp(escaped(), pass));
}

/// Whether what a field loses the keyboard with is to be taken back. A field asks in two passes: in the one in which it loses
/// the keyboard, and in the next.
pub fn is_taken_back(ctx: &Context) -> bool {
    let pressed: Option<u64> = ctx.data(|data| data.get_temp(escaped()));
    pressed.is_some_and(|pressed| ctx.cumulative_pass_nr().saturating_sub(pressed) <= 1)
}

/// Reads what is typed into a field. egui hands a field's text over in the pass after Esc too, and asks for the key only in
/// the pass in which it is pressed; so nothing is read then.
pub fn typed(ctx: &Context) -> impl Fn(&str) -> Option<f64> + use<> {
    let is_taken_back = is_taken_back(ctx);
    move |text| parse_number(text).filter(|_| !is_taken_back)
}

/// A number as a person types it: a decimal comma is understood, and so is a fraction, as of a shutter time.
pub fn parse_number(text: &str) -> Option<f64> {
    let plain = |text: &str| {
        let text = text.trim().trim_end_matches(|c: char| c.is_alphabetic() || c.is_whitespace() || c == '/');
        let text = if text.contains('.') { text.replace(',', "") } else { text.replace(',', ".") };
        text.parse::<f64>().ok().filter(|n| n.is_finite())
    };
    match text.split_once('/') {
        Some((above, below)) if below.trim().starts_with(|c: char| c.is_ascii_digit()) => {
            Some(plain(above)? / plain(below)?).filter(|n| n.is_finite())
        }
        _ => plain(text),
    }
}

/// To five significant digits.
pub fn rounded(n: f64) -> f64 {
    format!("{n:.4e}").parse().unwrap_or(n)
}

/// As it is shown.
pub fn short(n: f64) -> String {
    number(rounded(n))
}

/// A popup is laid out once unseen, and moved to where it fits.
const OPENS_FOR: u64 = 3;

/// Whether what is in a popup is shown for the first time since it was closed: then its list goes to what is chosen.
pub fn has_just_opened(ui: &Ui) -> bool {
    let now = ui.ctx().cumulative_pass_nr();
    let key = ui.scope_id().with("opened");
    ui.data_mut(|data| {
        let seen = data.get_temp::<[u64; 2]>(key).filter(|[_, last]| last + 1 >= now);
        let first = seen.map_or(now, |[first, _]| first);
        data.insert_temp(key, [first, now]);
        now - first < OPENS_FOR
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_people_type_them() {
        for (text, number) in [
            ("1.5", Some(1.5)),
            ("1,5", Some(1.5)),
            (" 0,016 s", Some(0.016)),
            ("1/60", Some(1.0 / 60.0)),
            ("1/60 s", Some(1.0 / 60.0)),
            ("1,000.5", Some(1000.5)),
            ("-3e-4", Some(-3e-4)),
            ("80 1/s", None),
            ("1/0", None),
            ("", None),
            ("soft", None),
        ] {
            assert_eq!(parse_number(text), number, "{text}");
        }
        assert_eq!((short(0.1 + 0.2), short(1234567.0)), ("0.3".to_owned(), "1234600".to_owned()));
    }
}
