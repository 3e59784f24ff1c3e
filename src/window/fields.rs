//! Numeric fields: parsing, formatting, and Esc, which reverts the typed text.

use eframe::egui::{self, Context, Id, Ui};

use locard_engine::text::number;

/// A number to drag or to type, with four decimals; `called` is its accessible name.
pub fn numeric(ui: &mut Ui, called: &str, value: &mut f64, speed: f64, unit: &str) -> egui::Response {
    // Typed text is applied at the end of editing.
    let drag = egui::DragValue::new(value).speed(speed).suffix(unit).custom_parser(typed_parser(ui.ctx()));
    let drag = drag.update_while_editing(false);
    let response = ui.add(drag.custom_formatter(|n, _| number((n * 1e4).round() / 1e4)));
    response.widget_info(|| egui::WidgetInfo::slider(true, *value, called));
    response
}

/// A labelled number. Returns true at the end of a change.
pub fn row(ui: &mut Ui, label: &str, called: &str, value: &mut f64, speed: f64, unit: &str) -> bool {
    ui.label(label);
    let response = numeric(ui, called, value, speed, unit);
    ui.end_row();
    response.drag_stopped() || response.lost_focus()
}

/// A colour button with a picker. The largest channel keeps its value.
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

/// Key of the pass in which Esc was last pressed.
fn last_escape_id() -> Id {
    Id::unique("esc in a field")
}

/// Records Esc during text input; call it before the fields are shown.
pub fn revert_typed(ctx: &Context) {
    let pass = ctx.cumulative_pass_nr();
    ctx.data_mut(|data| data.insert_temp(last_escape_id(), pass));
}

/// True if the text of a field that loses the focus is reverted. Fields check it in two passes: the
/// one in which they lose the focus, and the next.
pub fn is_typed_reverted(ctx: &Context) -> bool {
    let pressed: Option<u64> = ctx.data(|data| data.get_temp(last_escape_id()));
    pressed.is_some_and(|pressed| ctx.cumulative_pass_nr().saturating_sub(pressed) <= 1)
}

/// Parser of a field's text. After Esc it parses nothing: egui applies the text in the pass after
/// Esc, too, but checks the key only in the pass in which it is pressed.
pub fn typed_parser(ctx: &Context) -> impl Fn(&str) -> Option<f64> + use<> {
    let is_typed_reverted = is_typed_reverted(ctx);
    move |text| parse_number(text).filter(|_| !is_typed_reverted)
}

/// Parses a typed number. Decimal commas and fractions, as of shutter times, are accepted.
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

/// Rounds to five significant digits.
pub fn rounded(n: f64) -> f64 {
    format!("{n:.4e}").parse().unwrap_or(n)
}

/// Formats with five significant digits.
pub fn short(n: f64) -> String {
    number(rounded(n))
}

/// Number of passes in which a popup counts as just opened: it is laid out once invisibly and then
/// repositioned.
const OPENING_PASSES: u64 = 3;

/// True if a popup has just been opened, when its list scrolls to the chosen entry.
pub fn has_just_opened(ui: &Ui) -> bool {
    let now = ui.ctx().cumulative_pass_nr();
    let key = ui.scope_id().with("opened");
    ui.data_mut(|data| {
        let frames_shown = data.get_temp::<[u64; 2]>(key).filter(|[_, last]| last + 1 >= now);
        let first = frames_shown.map_or(now, |[first, _]| first);
        data.insert_temp(key, [first, now]);
        now - first < OPENING_PASSES
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_numbers_are_parsed_with_commas_fractions_and_units() {
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
