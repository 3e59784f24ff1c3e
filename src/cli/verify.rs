//! `locard verify`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};

use super::analysis::Analysis;
use super::skip::Skip;
use super::{progress, warn};
use locard_engine::analyse;
use locard_engine::gpu::Gpu;
use locard_engine::recording::OpenOptions;
use locard_engine::report::{self, SlidePair};
use locard_engine::shot::{AnalysisChoice, AnalysisState, Shot, ShotOptions};
use locard_engine::text::{count, fixed};
use locard_engine::verify::{Brightness, DisplacementSummary, Plan, Verification, real_px, verify};

#[derive(clap::Args)]
pub struct Args {
    /// Folder or file of the recording; it must have depth
    recording: PathBuf,
    /// The camera; without it, the recording's own
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Set a parameter, as in --set camera.readout_time_s=0.02
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    sets: Vec<String>,
    /// Each so many frames, one is put into others
    #[arg(long, value_name = "N", default_value_t = 10)]
    every: usize,
    /// So many frames before and after it
    #[arg(long, value_name = "N", default_value_t = 8)]
    gap: usize,
    #[command(flatten)]
    analysis: Analysis,
    #[command(flatten)]
    skip: Skip,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

/// What passes: a median displacement, px; a median difference of luma, codes; lengths of blur, virtual by real, between these;
/// a difference of point spreads' σ, px.
const MOST_PX: f64 = 0.7;
const MOST_CODES: f64 = 1.5;
const BLUR: (f64, f64) = (0.8, 1.25);
const SPREAD_PX: f64 = 0.15;
/// The median slide over so many frames, px; pairs that get worse by the refinement, and by how much one may.
const SLIDE: usize = 20;
const MOST_SLIDE_PX: f64 = 1.0;
const WORSE: f64 = 0.05;
const MOST_WORSE_PX: f64 = 0.5;

pub fn run(args: &Args) -> Result<()> {
    if args.every == 0 || args.gap == 0 {
        bail!("--every and --gap are at least 1");
    }
    let options = args.skip.over(OpenOptions::default());
    let open = |analysis| {
        let given =
            ShotOptions { profile: args.profile.clone(), sets: args.sets.clone(), analysis, ..ShotOptions::default() };
        Shot::open(&args.recording, &options, &given)
    };
    let recorded = open(AnalysisChoice::No)?;
    if !recorded.recording.has_depth() {
        bail!("{}: there is no depth: nothing says where what its frames show stands", args.recording.display());
    }
    let found = open(args.analysis.asked())?;
    for note in found.notes(0..found.recording.frame_count()) {
        warn(args.quiet, &note.to_string());
    }
    let gpu = Gpu::open()?;
    let plan = Plan { every: args.every, gap: args.gap };
    let bar = progress(args.quiet, 0);
    let is_analysed = matches!(found.analysis, AnalysisState::Used(..));
    let runs = 1 + u64::from(is_analysed);
    let judged = |shot: &Shot, run: u64| {
        verify(&gpu, shot, plan, |done, of| {
            bar.set_length(runs * of as u64);
            bar.set_position(run * of as u64 + done as u64);
        })
    };
    let by_record = judged(&recorded, 0)?;
    let by_findings = is_analysed.then(|| judged(&found, 1)).transpose()?;
    let real_px = real_px(&found)?;
    let slid = slid(&recorded, &found)?;
    bar.finish_and_clear();
    say(args, &by_record, by_findings.as_ref(), &real_px, slid.as_deref())
}

/// Slides by recorded and by refined poses; `None` where nothing is analysed or nothing slides.
fn slid(recorded: &Shot, found: &Shot) -> Result<Option<Vec<SlidePair>>> {
    let AnalysisState::Used(folder, _) = &found.analysis else { return Ok(None) };
    let analysis = analyse::Analysis::read(folder)?;
    let (camera, response) = (recorded.geometry_at(0)?, recorded.camera().response);
    let recording = &recorded.recording;
    let source = report::Source {
        recording,
        camera: &camera,
        response: &response,
        analysis: &analysis,
        grounds: &[],
        times: None,
    };
    Ok(report::slides(&source)?.ok())
}

fn say(
    args: &Args,
    recorded: &Verification,
    found: Option<&Verification>,
    real_px: &Result<f64, String>,
    slid: Option<&[SlidePair]>,
) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let now = found.unwrap_or(recorded);
    writeln!(out, "pairs        {}, {} frames apart", count(now.pairs, "pair"), args.gap)?;
    let mut failed = Vec::new();
    let mut line =
        |name: &str, passes: Option<bool>, told: &dyn Fn(&Verification) -> String, bar: &str| -> Result<()> {
            let analysed = found.map_or(String::new(), |found| format!(", as analysed {}", told(found)));
            let verdict = match passes {
                Some(true) => "pass",
                Some(false) => "FAIL",
                None => "not judged",
            };
            writeln!(out, "{name:<12} recorded {}{analysed}; {bar}: {verdict}", told(recorded))?;
            if passes == Some(false) {
                failed.push(name.to_owned());
            }
            Ok(())
        };
    line(
        "registration",
        match now.displaced {
            Some(displaced) => Some(now.unmatched <= now.pairs && displaced.px.0 <= MOST_PX),
            None => (now.unmatched > 0).then_some(false),
        },
        &registration,
        &format!("at most {MOST_PX} px"),
    )?;
    line(
        "gain",
        now.brightness.map(|brightness| brightness.codes.0 <= MOST_CODES),
        &|v| v.brightness.as_ref().map_or_else(|| "unknown, no area is flat".to_owned(), brightness),
        &format!("at most {MOST_CODES} codes"),
    )?;
    let blur = |v: &Verification| match &v.blur {
        Some(b) => {
            let (low, high) = (fixed(b.between.0, 2), fixed(b.between.1, 2));
            format!(
                "{} of real (half of the areas {low} to {high}; {} px long)",
                fixed(b.ratio, 2),
                fixed(b.length_px, 1)
            )
        }
        None => "unknown, the camera is nowhere fast over texture above the noise".to_owned(),
    };
    let (low, high) = BLUR;
    let passes = now.blur.map(|b| b.ratio >= low && b.ratio <= high);
    line("blur", passes, &blur, &format!("from {low} to {high}"))?;
    let spread = |v: &Verification| v.sharpness_px.map_or("unknown".to_owned(), |px| format!("{} px", fixed(px, 2)));
    let real = match real_px {
        Ok(px) => format!("real {} px, at most {SPREAD_PX} px apart", fixed(*px, 2)),
        Err(why) => format!("real unknown: {why}"),
    };
    let passes = now.sharpness_px.zip(real_px.as_ref().ok()).map(|(drawn, real)| (drawn - real).abs() <= SPREAD_PX);
    line("sharpness", passes, &spread, &real)?;
    for (name, passes, told) in slid.map(slide_lines).unwrap_or_default() {
        let verdict = if passes { "pass" } else { "FAIL" };
        writeln!(out, "{name:<12} {told}: {verdict}")?;
        if !passes {
            failed.push(name.to_owned());
        }
    }
    if failed.is_empty() { Ok(()) } else { bail!("{}: {} fail", args.recording.display(), failed.join(" and ")) }
}

/// What poses miss by, what was measured, and the measurement's floor.
fn displaced(found: &DisplacementSummary) -> String {
    let px = |px: f64| fixed(px, 2);
    let (median, ninety, measured) = (px(found.px.0), px(found.px.1), px(found.measured.0));
    match found.floor {
        Some((floor, _)) => format!(
            "{median} px (± {}, 90 % {ninety}; measured {measured}, of which noise makes {})",
            px(found.sigma_px),
            px(floor)
        ),
        None => format!("{median} px (90 % {ninety}, noise's part not measured)"),
    }
}

/// What gain misses by, what was measured, and the measurement's floor.
fn brightness(found: &Brightness) -> String {
    let codes = |codes: f64| fixed(codes, 2);
    let (median, most, measured) = (codes(found.codes.0), codes(found.codes.1), codes(found.measured.0));
    match found.floor {
        Some(floor) => {
            format!("{median} codes (worst pair {most}; measured {measured}, of which noise makes {})", codes(floor))
        }
        None => format!("{median} codes (worst pair {most}, noise's part not measured)"),
    }
}

/// The displacement, or why none was measured, and the pairs that do not match.
fn registration(found: &Verification) -> String {
    let verb = if found.unmatched == 1 { "does" } else { "do" };
    let unmatched = format!("{} with texture {verb} not match", count(found.unmatched, "pair"));
    match (&found.displaced, found.unmatched) {
        (Some(px), 0) => displaced(px),
        (Some(px), _) => format!("{}; {unmatched}", displaced(px)),
        (None, 0) => "unknown, too little texture above the noise".to_owned(),
        (None, _) => format!("unknown, {unmatched}"),
    }
}

/// What slides over twenty frames, and what got worse.
fn slide_lines(slid: &[SlidePair]) -> Vec<(&'static str, bool, String)> {
    let pooled = |px: &dyn Fn(&SlidePair) -> Vec<f64>| {
        let all: Vec<f64> = slid.iter().filter(|pair| pair.later == SLIDE).flat_map(px).collect();
        report::median_px(&all)
    };
    let mut lines = Vec::new();
    let recorded = pooled(&|pair| pair.recorded_px.clone());
    let refined = pooled(&|pair| pair.refined_px.clone().unwrap_or_default());
    if let Some(was) = recorded {
        let now = refined.map_or(String::new(), |px| format!(", as analysed {} px", fixed(px, 2)));
        let passes = refined.unwrap_or(was) <= MOST_SLIDE_PX;
        let was = fixed(was, 2);
        let told = format!("over {SLIDE} frames, recorded {was} px{now}; at most {MOST_SLIDE_PX} px");
        lines.push(("slide", passes, told));
    }
    if let Some((worse, of, most_px)) = report::worse(slid) {
        let passes = worse as f64 <= WORSE * of as f64 && most_px <= MOST_WORSE_PX;
        let most = fixed(most_px, 2);
        let told = format!(
            "{worse} of {} by more than 0.1 px, {most} px at most; at most {:.0} %, none by {MOST_WORSE_PX} px",
            count(of, "pair"),
            100.0 * WORSE
        );
        lines.push(("worse", passes, told));
    }
    lines
}
