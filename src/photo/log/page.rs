//! The page of a photo log (page.html): one file with embedded thumbnails, which a browser prints.

use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior};
use serde::Serialize;

use super::entry::{LogEntry, PhotoLog};
use super::finding::Finding;
use super::items::ItemCoverage;
use super::table::{class_of, subject_text, support_text};
use crate::camera::stops::{format_f_number, format_shutter_s};
use crate::photo::particulars::{ScaleInView, Subject, ViewParticulars};
use crate::text::{count, fixed, shown};

const THUMBNAIL_QUALITY: u8 = 82;
/// The file extension turns on HTML escaping.
const TEMPLATE: (&str, &str) = ("page.html", include_str!("page.html"));

#[derive(Serialize)]
struct LogPage {
    version: &'static str,
    title: String,
    /// Labels and values of the case card.
    card: Vec<(&'static str, String)>,
    summary: String,
    series: Vec<LogFault>,
    items: Vec<ItemRow>,
    rows: Vec<PhotoRow>,
}

#[derive(Serialize)]
struct LogFault {
    check: &'static str,
    fault: String,
    remedy: String,
}

#[derive(Serialize)]
struct ItemRow {
    title: String,
    /// Numbers of overviews, mid-range photographs, close-ups without and with scale; empty if it
    /// has none.
    cells: Vec<String>,
    faults: Vec<LogFault>,
}

#[derive(Serialize)]
struct PhotoRow {
    number: String,
    name: String,
    taken: String,
    /// Thumbnail as a `data:` URI, or empty.
    thumbnail: String,
    subject: String,
    class: &'static str,
    lens: String,
    f_number: String,
    shutter: String,
    iso: String,
    distance: String,
    angle: String,
    mm_per_px: String,
    scale: String,
    faults: Vec<LogFault>,
}

impl From<&Finding> for LogFault {
    fn from(finding: &Finding) -> Self {
        // The page has no marks of code.
        let remedy = shown(&finding.remedy).replace('`', "");
        Self { check: finding.check.name(), fault: shown(&finding.fault), remedy }
    }
}

impl From<&ItemCoverage> for ItemRow {
    fn from(item: &ItemCoverage) -> Self {
        let numbers = |numbers: &[u32]| numbers.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
        let cells = [&item.overviews, &item.mid_ranges, &item.close_ups, &item.with_scale];
        let faults = item.findings.iter().map(LogFault::from).collect();
        Self { title: shown(&item.title()), cells: cells.into_iter().map(|n| numbers(n)).collect(), faults }
    }
}

/// The page. Photographs that cannot be read have no thumbnail. The error is a description.
pub fn html(log: &PhotoLog) -> Result<String, String> {
    let card = log.card().map(|card| card.rows()).unwrap_or_default();
    let title =
        log.card().map_or_else(|| "Photo log".to_owned(), |card| format!("Photo log {}", shown(&card.case_number)));
    let page = LogPage {
        version: env!("CARGO_PKG_VERSION"),
        title,
        card: card.into_iter().map(|(label, value)| (label, shown(value))).collect(),
        summary: format!(
            "{}, {}, {}",
            count(log.entries.len(), "photograph"),
            count(log.items.len(), "item"),
            count(log.finding_count(), "fault")
        ),
        series: log.findings.iter().map(LogFault::from).collect(),
        items: log.items.iter().map(ItemRow::from).collect(),
        rows: log.entries.iter().map(photo_row).collect(),
    };
    let mut templates = Environment::new();
    // Undefined names are errors.
    templates.set_undefined_behavior(UndefinedBehavior::Strict);
    let page = templates.render_named_str(TEMPLATE.0, TEMPLATE.1, Serde(page));
    page.map(|page| page + "\n").map_err(|error| error.to_string())
}

fn photo_row(entry: &LogEntry) -> PhotoRow {
    let none = String::new;
    let view = entry.view();
    let of_view = |text: &dyn Fn(&ViewParticulars) -> String| view.map_or_else(none, text);
    let subject = view.and_then(|view| view.subject.as_ref());
    let of_subject = |text: &dyn Fn(&Subject) -> String| subject.map_or_else(none, text);
    PhotoRow {
        number: entry.number().map_or_else(none, |number| number.to_string()),
        name: shown(&entry.name()),
        taken: entry.particulars.as_ref().map_or_else(none, |particulars| shown(&particulars.taken)),
        thumbnail: entry.thumbnail().ok().and_then(|thumbnail| jpeg_uri(&thumbnail)).unwrap_or_default(),
        subject: shown(&subject_text(entry)),
        class: view.and_then(class_of).map_or("", |class| class.name()),
        lens: of_view(&|v| format!("{} mm ({} mm)", fixed(v.focal_length_mm, 1), fixed(v.equivalent_mm, 0))),
        f_number: of_view(&|v| format_f_number(v.f_number)),
        shutter: of_view(&|v| format!("{}, {}", format_shutter_s(v.shutter_s), support_text(v.support))),
        iso: of_view(&|v| fixed(v.iso, 0)),
        distance: of_subject(&|s| format!("{} m", fixed(s.distance_m, 2))),
        angle: of_subject(&|s| format!("{}°", fixed(s.angle_deg, 0))),
        mm_per_px: of_subject(&|s| fixed(s.mm_per_px, 2)),
        scale: of_subject(&|s| s.scale.as_ref().map_or_else(|| "without".to_owned(), scale_text)),
        faults: entry.findings.iter().map(LogFault::from).collect(),
    }
}

fn scale_text(scale: &ScaleInView) -> String {
    format!("with {}, {}° out of plane", shown(&scale.name), fixed(scale.tilt_deg, 0))
}

fn jpeg_uri(thumbnail: &RgbImage) -> Option<String> {
    let mut jpeg = Cursor::new(Vec::new());
    thumbnail.write_with_encoder(JpegEncoder::new_with_quality(&mut jpeg, THUMBNAIL_QUALITY)).ok()?;
    Some(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg.into_inner())))
}
