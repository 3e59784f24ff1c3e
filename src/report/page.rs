//! The page around plots and pictures (page.html).

use std::borrow::Cow;
use std::time::Duration;

use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior};
use serde::Serialize;

use super::chart::Ink;
use super::estimates::{Estimate, Mark, estimates};
use super::{MADE_BY, ReportError, ReportSource};
use crate::support::SupportReport;
use crate::text::{count, fixed, shown};
use crate::verify::NoiseComparison;

/// A figure, or the reason for its absence.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    pub title: &'static str,
    pub caption: String,
    pub legend: Vec<(Ink, &'static str)>,
    pub body: Body,
}

/// Content of a figure.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Body {
    /// SVG, from top to bottom.
    Plots { plots: Vec<String> },
    /// Pictures of a place in several frames.
    Strip {
        /// Labels of the pictures of a frame, from top to bottom.
        rows: Vec<(Ink, &'static str)>,
        /// Side of each picture, px.
        side: usize,
        cells: Vec<Cell>,
    },
    /// One wide picture, as a `data:` URI.
    Panorama { picture: String, width: u32, height: u32 },
    /// The caption has the reason.
    LeftOut,
}

/// The pictures of one frame in a strip.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    pub frame: usize,
    /// Whether the place was selected in this frame.
    pub is_start: bool,
    /// Pictures as `data:` URIs, one for each row.
    pub pictures: Vec<String>,
}

impl Figure {
    pub fn left_out(title: &'static str, why: String) -> Self {
        Self { title, caption: why, legend: Vec::new(), body: Body::LeftOut }
    }
}

/// A part of the analysis: its duration, and its share of the total, per cent.
#[derive(Serialize)]
struct PagePart {
    name: String,
    took: String,
    share: String,
}

/// The file extension turns on HTML escaping.
const TEMPLATE: (&str, &str) = ("page.html", include_str!("page.html"));

#[derive(Serialize)]
struct Page {
    made_by: &'static str,
    version: &'static str,
    name: String,
    facts: Vec<String>,
    estimates: Vec<Estimate>,
    figures: Vec<Figure>,
    lines: Vec<(&'static str, String)>,
    /// Names of kept or refused estimates, verdict and reason.
    reasons: Vec<(String, &'static str, String)>,
    whole: String,
    parts: Vec<PagePart>,
}

pub fn page(source: &ReportSource<'_>, figures: Vec<Figure>) -> Result<String, ReportError> {
    let (recording, findings) = (source.recording, &source.analysis.findings);
    let estimates = estimates(findings, source.camera.intrinsics.readout_time_s);
    let (first, last) = (recording.timestamps_s.first(), recording.timestamps_s.last());
    let long_s = first.zip(last).map_or(0.0, |(first, last)| last - first);
    let (whole, parts) = parts(source.times.map_or(&[], |times| times.parts()));
    let page = Page {
        made_by: MADE_BY,
        version: env!("CARGO_PKG_VERSION"),
        name: shown(&recording.name),
        facts: vec![
            shown(&recording.path.display().to_string()),
            recording.kind.to_string(),
            format!("{}, {} s", count(recording.frame_count(), "frame"), fixed(long_s, 1)),
            format!("{} × {} px", recording.width, recording.height),
        ],
        reasons: reasons(&estimates),
        estimates,
        figures,
        lines: lines(source),
        whole,
        parts,
    };
    let mut templates = Environment::new();
    // Undefined names are errors.
    templates.set_undefined_behavior(UndefinedBehavior::Strict);
    Ok(templates.render_named_str(TEMPLATE.0, TEMPLATE.1, Serde(page))? + "\n")
}

/// Labels and texts of the table of estimates, supports and noise.
fn lines(source: &ReportSource<'_>) -> Vec<(&'static str, String)> {
    let supports = source.grounds.iter().flat_map(SupportReport::lines);
    let noise = source.noise.map(NoiseComparison::lines).unwrap_or_default();
    source.analysis.findings.lines().into_iter().chain(supports).chain(noise).collect()
}

/// Kept and refused estimates: names, verdict and reason. Neighbours with the same reason are
/// grouped.
fn reasons(estimates: &[Estimate]) -> Vec<(String, &'static str, String)> {
    let others: Vec<&Estimate> = estimates.iter().filter(|estimate| estimate.mark != Mark::Changed).collect();
    let alike = others.chunk_by(|a, b| (a.verdict, &a.why) == (b.verdict, &b.why));
    let names = |alike: &[&Estimate]| alike.iter().map(|estimate| estimate.name).collect::<Vec<_>>().join(", ");
    alike.map(|alike| (names(alike), alike[0].verdict, alike[0].why.clone())).collect()
}

/// Total duration, and the parts.
fn parts(times: &[(Cow<'static, str>, Duration)]) -> (String, Vec<PagePart>) {
    let whole_s: f64 = times.iter().map(|(_, took)| took.as_secs_f64()).sum();
    let part = |(name, took): &(Cow<'static, str>, Duration)| PagePart {
        name: shown(name),
        took: format!("{} s", fixed(took.as_secs_f64(), 1)),
        share: fixed(100.0 * took.as_secs_f64() / whole_s.max(1e-9), 1),
    };
    (format!("{} s", fixed(whole_s, 1)), times.iter().map(part).collect())
}
