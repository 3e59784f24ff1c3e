//! The table of a photo log: its rows as text, and as CSV (RFC 4180).

use super::entry::LogEntry;
use super::shot_class::ShotClass;
use crate::camera::stops::{format_f_number, format_shutter_s};
use crate::photo::particulars::{CameraSupport, Subject, ViewParticulars};
use crate::text::fixed;

/// Columns of the CSV file, with units.
pub const COLUMNS: [&str; 21] = [
    "number",
    "file",
    "taken",
    "subject",
    "class",
    "focal_length_mm",
    "equivalent_mm",
    "f_number",
    "shutter",
    "iso",
    "support",
    "exposure_deviation_ev",
    "focus_m",
    "distance_m",
    "angle_deg",
    "mm_per_px",
    "scale",
    "scale_tilt_deg",
    "recording",
    "frame",
    "findings",
];

/// Class of a photograph by its subject; `None` without a subject in view.
pub fn class_of(view: &ViewParticulars) -> Option<ShotClass> {
    let subject = view.subject.as_ref()?;
    ShotClass::of(view, view.object(&subject.name)?)
}

/// Name of the subject, or the site if the photographer named none.
pub fn subject_text(entry: &LogEntry) -> String {
    match (entry.view(), entry.card()) {
        (_, Some(card)) => format!("case card {}", card.case_number),
        (Some(view), None) => {
            let named = view.subject.as_ref().filter(|subject| subject.is_named);
            named.map_or_else(|| "the site".to_owned(), |subject| subject.name.clone())
        }
        (None, None) => String::new(),
    }
}

pub fn support_text(support: CameraSupport) -> &'static str {
    match support {
        CameraSupport::Tripod => "tripod",
        CameraSupport::HandHeld => "hand-held",
    }
}

/// The CSV file: a header, then one line for each photograph.
pub fn csv(entries: &[LogEntry]) -> String {
    let header = COLUMNS.join(",");
    entries.iter().map(row).fold(header, |text, row| text + "\r\n" + &row.map(|field| escaped(&field)).join(","))
        + "\r\n"
}

fn row(entry: &LogEntry) -> [String; 21] {
    let none = String::new;
    let view = entry.view();
    let of_view = |text: &dyn Fn(&ViewParticulars) -> String| view.map_or_else(none, text);
    let subject = view.and_then(|view| view.subject.as_ref());
    let of_subject = |text: &dyn Fn(&Subject) -> String| subject.map_or_else(none, text);
    let scale = subject.and_then(|subject| subject.scale.as_ref());
    let findings: Vec<String> = entry.findings.iter().map(|f| format!("{}: {}", f.check.name(), f.fault)).collect();
    [
        entry.number().map_or_else(none, |number| number.to_string()),
        entry.name(),
        entry.particulars.as_ref().map_or_else(none, |particulars| particulars.taken.clone()),
        subject_text(entry),
        view.and_then(class_of).map_or_else(none, |class| class.name().to_owned()),
        of_view(&|v| fixed(v.focal_length_mm, 1)),
        of_view(&|v| fixed(v.equivalent_mm, 0)),
        of_view(&|v| format_f_number(v.f_number).trim_start_matches("f/").to_owned()),
        of_view(&|v| format_shutter_s(v.shutter_s).trim_end_matches('s').trim_end().to_owned()),
        of_view(&|v| fixed(v.iso, 0)),
        of_view(&|v| support_text(v.support).to_owned()),
        of_view(&|v| fixed(v.exposure_deviation_ev, 2)),
        of_view(&|v| v.focus_distance_m.map_or("infinity".to_owned(), |focus_m| fixed(focus_m, 3))),
        of_subject(&|s| fixed(s.distance_m, 3)),
        of_subject(&|s| fixed(s.angle_deg, 1)),
        of_subject(&|s| fixed(s.mm_per_px, 4)),
        scale.map_or_else(none, |scale| scale.name.clone()),
        scale.map_or_else(none, |scale| fixed(scale.tilt_deg, 1)),
        of_view(&|v| v.recording.clone()),
        of_view(&|v| v.frame.to_string()),
        findings.join("; "),
    ]
}

/// A field of a CSV line: quoted if it contains a comma, a quote or a line break. A leading sign
/// that a spreadsheet takes for a formula is kept as text by a leading apostrophe, unless it is a
/// number.
fn escaped(field: &str) -> String {
    let is_formula = field.starts_with(['=', '+', '-', '@']) && field.parse::<f64>().is_err();
    let field = if is_formula { format!("'{field}") } else { field.to_owned() };
    if field.contains([',', '"', '\n', '\r']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_with_separators_are_quoted_and_formulas_disarmed() {
        assert_eq!(escaped("marker 1"), "marker 1");
        assert_eq!(escaped("a, \"b\""), "\"a, \"\"b\"\"\"");
        assert_eq!((escaped("-0.33"), escaped("=1+1")), ("-0.33".to_owned(), "'=1+1".to_owned()));
    }
}
