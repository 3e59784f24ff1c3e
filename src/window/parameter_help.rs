//! Texts about a parameter: its tooltip, its values and their unit.

use eframe::egui::{RichText, Ui};

use locard_engine::params::{Kind, Spec, Value};

/// Unit suffix of a number.
pub fn suffix(spec: &Spec, number: f64) -> String {
    match spec.unit {
        "" | "1" => String::new(),
        "frames" if number == 1.0 => " frame".to_owned(),
        unit => format!(" {unit}"),
    }
}

/// A value as its control shows it.
pub fn displayed(value: &Value) -> String {
    match value {
        Value::Bool(true) => "on".to_owned(),
        Value::Bool(false) => "off".to_owned(),
        other => other.to_string(),
    }
}

/// The tooltip of a parameter: `called` is its name with its table, `full` its key in files,
/// `inactive` the condition under which it has an effect, `opened` the profile's value.
pub fn help(ui: &mut Ui, called: &str, full: &str, spec: &Spec, inactive: Option<&str>, opened: Option<&Value>) {
    ui.set_max_width(320.0);
    ui.strong(called);
    ui.label(spec.help);
    if let Some(inactive) = inactive {
        ui.label(RichText::new(format!("Inactive: has an effect {inactive}.")).color(ui.visuals().warn_fg_color));
    }
    let (unit, default) = (suffix(spec, f64::NAN), displayed(&spec.default));
    ui.weak(match spec.kind {
        Kind::Bool => format!("on or off; default {default}"),
        _ => format!("{}{unit}; default {default}", spec.kind),
    });
    let reset = match opened.filter(|opened| **opened != spec.default) {
        Some(opened) => format!("the profile's {}", displayed(opened)),
        None => "default".to_owned(),
    };
    ui.weak(match spec.kind {
        Kind::Number { .. } | Kind::Integer { .. } => format!("Double-click: {reset}. Click the number to type one."),
        _ => format!("Double-click the name: {reset}."),
    });
    ui.weak(match spec.kind {
        Kind::Bool => format!("In files: {full} = true or false; for --set also on or off"),
        _ => format!("In files and for --set: {full}"),
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::compositor::Settings;

    fn spec(table: &str, name: &str) -> Spec {
        let settings = Settings::default();
        let tables = settings.tables();
        let params = tables.into_iter().find(|params| params.table() == table).unwrap();
        params.specs().into_iter().find(|spec| spec.name == name).unwrap()
    }

    #[test]
    fn one_frame_is_singular() {
        let spec = spec("noise", "animation_delay");
        assert_eq!([1.0, 8.0].map(|number| suffix(&spec, number)), [" frame", " frames"]);
    }

    #[test]
    fn switches_are_displayed_as_on_and_off() {
        let default = spec("shadow", "cast").default;
        assert_eq!([displayed(&default), displayed(&Value::Bool(false))], ["on", "off"]);
        assert_eq!(displayed(&Value::Number(0.5)), "0.5");
    }
}
