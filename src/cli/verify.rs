//! `locard verify`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};

use super::analyse::{check_report, write_report};
use super::analysis::AnalysisArgs;
use super::open::Skip;
use super::{progress, warn};
use locard_engine::analyse;
use locard_engine::fit::quantile::upper_median;
use locard_engine::gpu::Gpu;
use locard_engine::recording::OpenOptions;
use locard_engine::report::{self, SlidePair};
use locard_engine::shot::{AnalysisChoice, AnalysisState, Shot, ShotOptions};
use locard_engine::text::{count, fixed};
use locard_engine::verify::{
    self, Brightness, DisplacementSummary, NoiseComparison, NoiseNotCompared, Verification, VerificationPlan, real_px,
    verify,
};

#[derive(clap::Args)]
pub struct Args {
    /// Folder or file of the recording; it must have depth, or a scan of the place (--scene)
    recording: PathBuf,
    /// The camera; without it, the recording's own
    #[arg(long)]
    profile: Option<PathBuf>,
    /// The scene file with the scan of the place ([site]), which serves where depth was not
    /// measured
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Set a parameter, as in --set camera.readout_time_s=0.02
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    sets: Vec<String>,
    /// Interval of frames between those that are put into others
    #[arg(long, value_name = "N", default_value_t = 10)]
    every: usize,
    /// Number of frames before and after it
    #[arg(long, value_name = "N", default_value_t = 8)]
    gap: usize,
    /// Also write the report of the recording's analysis, with the comparison of noise
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    skip: Skip,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

/// Largest median displacement that passes, px.
const MAX_DISPLACEMENT_PX: f64 = 0.7;
/// Largest median difference of luma that passes, codes.
const MAX_LUMA_CODES: f64 = 1.5;
/// Ratios of virtual to real blur length that pass.
const BLUR_RATIO: (f64, f64) = (0.8, 1.25);
/// Largest difference between the point spreads' σ that passes, px.
const MAX_SIGMA_DIFFERENCE_PX: f64 = 0.15;
/// Number of frames over which slides are measured.
const SLIDE_FRAMES: usize = 20;
/// Largest median slide that passes, px.
const MAX_SLIDE_PX: f64 = 1.0;
/// Largest fraction of pairs whose slide may increase by the refinement.
const MAX_WORSE_FRACTION: f64 = 0.05;
/// Largest increase of a slide by the refinement, px.
const MAX_WORSE_PX: f64 = 0.5;

pub fn run(args: &Args) -> Result<()> {
    if args.every == 0 || args.gap == 0 {
        bail!("--every and --gap are at least 1");
    }
    let options = args.skip.apply_to(OpenOptions::default());
    let open = |analysis| {
        let (profile, sets, scene) = (args.profile.clone(), args.sets.clone(), args.scene.clone());
        let shot_options = ShotOptions { profile, sets, scene, analysis, ..ShotOptions::default() };
        Shot::open(&args.recording, &options, &shot_options)
    };
    let recorded = open(AnalysisChoice::No)?;
    if !recorded.recording.has_depth() {
        bail!(
            "{}: there is no depth, so the positions of visible surfaces are unknown; a scan of the place serves as \
             well: --scene with a scene file that has it in [site] (`locard site`)",
            args.recording.display()
        );
    }
    let state = open(args.analysis.choice())?;
    if let Some(path) = &args.report {
        let AnalysisState::Used(folder, _) = &state.analysis else {
            bail!("{}: --report needs an analysis; make one with `locard analyse`", args.recording.display());
        };
        check_report(path, &recorded, folder)?;
    }
    for note in state.notes(0..state.recording.frame_count()) {
        warn(args.quiet, &note.to_string());
    }
    let gpu = Gpu::open()?;
    let plan = VerificationPlan { every: args.every, gap: args.gap };
    let bar = progress(args.quiet, 0);
    let is_analysed = matches!(state.analysis, AnalysisState::Used(..));
    let runs = 1 + u64::from(is_analysed);
    let verify_shot = |shot: &Shot, run: u64| {
        verify(&gpu, shot, plan, |done, of| {
            bar.set_length(runs * of as u64);
            bar.set_position(run * of as u64 + done as u64);
        })
    };
    let by_record = verify_shot(&recorded, 0)?;
    let by_findings = is_analysed.then(|| verify_shot(&state, 1)).transpose()?;
    let real_px = real_px(&state)?;
    let slides = measure_slides(&recorded, &state)?;
    let noise = verify::noise(&gpu, &state, |done, of| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
        true
    })?;
    bar.finish_and_clear();
    if let (Some(path), AnalysisState::Used(folder, _)) = (&args.report, &state.analysis) {
        let (analysis, times) = (analyse::Analysis::read(folder)?, analyse::Times::read(folder));
        write_report(path, &recorded, (&analysis, &[]), times.as_ref(), noise.as_ref().ok())?;
    }
    print_noise(&noise)?;
    print_verdicts(args, &by_record, by_findings.as_ref(), &real_px, slides.as_deref())
}

/// The comparison of noise, which fails nothing: no model of noise passes for every camera.
fn print_noise(noise: &Result<NoiseComparison, NoiseNotCompared>) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match noise {
        Ok(noise) => noise.lines().iter().try_for_each(|(label, text)| writeln!(out, "{label:<12} {text}"))?,
        Err(why) => writeln!(out, "noise        not compared: {why}")?,
    }
    Ok(())
}

/// Slides with recorded and with refined poses; `None` without an analysis or without measured
/// slides.
fn measure_slides(recorded: &Shot, refined: &Shot) -> Result<Option<Vec<SlidePair>>> {
    let AnalysisState::Used(folder, _) = &refined.analysis else { return Ok(None) };
    let analysis = analyse::Analysis::read(folder)?;
    let (camera, response) = (recorded.geometry_at(0)?, recorded.camera().response);
    let recording = &recorded.recording;
    let source = report::ReportSource {
        recording,
        camera: &camera,
        response: &response,
        analysis: &analysis,
        grounds: &[],
        times: None,
        noise: None,
    };
    Ok(report::slides(&source)?.ok())
}

fn print_verdicts(
    args: &Args,
    recorded: &Verification,
    by_findings: Option<&Verification>,
    real_px: &Result<f64, String>,
    slides: Option<&[SlidePair]>,
) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let now = by_findings.unwrap_or(recorded);
    writeln!(out, "pairs        {}, {} frames apart", count(now.pairs, "pair"), args.gap)?;
    let mut failed = Vec::new();
    let mut line =
        |name: &str, passes: Option<bool>, text: &dyn Fn(&Verification) -> String, bar: &str| -> Result<()> {
            let analysed =
                by_findings.map_or(String::new(), |by_findings| format!(", as analysed {}", text(by_findings)));
            let verdict = match passes {
                Some(true) => "pass",
                Some(false) => "FAIL",
                None => "not judged",
            };
            writeln!(out, "{name:<12} recorded {}{analysed}; {bar}: {verdict}", text(recorded))?;
            if passes == Some(false) {
                failed.push(name.to_owned());
            }
            Ok(())
        };
    line(
        "registration",
        match now.displaced {
            Some(displaced) => Some(now.unmatched <= now.pairs && displaced.px.0 <= MAX_DISPLACEMENT_PX),
            None => (now.unmatched > 0).then_some(false),
        },
        &registration,
        &format!("at most {MAX_DISPLACEMENT_PX} px"),
    )?;
    line(
        "gain",
        now.brightness.map(|brightness| brightness.codes.0 <= MAX_LUMA_CODES),
        &|v| v.brightness.as_ref().map_or_else(|| "unknown, no area is flat".to_owned(), brightness),
        &format!("at most {MAX_LUMA_CODES} codes"),
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
    let (low, high) = BLUR_RATIO;
    let passes = now.blur.map(|b| b.ratio >= low && b.ratio <= high);
    line("blur", passes, &blur, &format!("from {low} to {high}"))?;
    let spread = |v: &Verification| v.sharpness_px.map_or("unknown".to_owned(), |px| format!("{} px", fixed(px, 2)));
    let real = match real_px {
        Ok(px) => format!("real {} px, at most {MAX_SIGMA_DIFFERENCE_PX} px apart", fixed(*px, 2)),
        Err(why) => format!("real unknown: {why}"),
    };
    let passes = now
        .sharpness_px
        .zip(real_px.as_ref().ok())
        .map(|(drawn, real)| (drawn - real).abs() <= MAX_SIGMA_DIFFERENCE_PX);
    line("sharpness", passes, &spread, &real)?;
    for (name, passes, text) in slides.map(slide_lines).unwrap_or_default() {
        let verdict = if passes { "pass" } else { "FAIL" };
        writeln!(out, "{name:<12} {text}: {verdict}")?;
        if !passes {
            failed.push(name.to_owned());
        }
    }
    if failed.is_empty() { Ok(()) } else { bail!("{}: {} fail", args.recording.display(), failed.join(" and ")) }
}

/// The displacement by the error of poses, the measured one, and the noise floor.
fn displaced(displacement: &DisplacementSummary) -> String {
    let px = |px: f64| fixed(px, 2);
    let (median, ninety, measured) = (px(displacement.px.0), px(displacement.px.1), px(displacement.measured.0));
    match displacement.floor {
        Some((floor, _)) => format!(
            "{median} px (± {}, 90 % {ninety}; measured {measured}, of which noise makes {})",
            px(displacement.sigma_px),
            px(floor)
        ),
        None => format!("{median} px (90 % {ninety}, noise's part not measured)"),
    }
}

/// The luma difference by the error of gains, the measured one, and the noise floor.
fn brightness(brightness: &Brightness) -> String {
    let codes = |codes: f64| fixed(codes, 2);
    let (median, largest, measured) =
        (codes(brightness.codes.0), codes(brightness.codes.1), codes(brightness.measured.0));
    match brightness.floor {
        Some(floor) => {
            format!("{median} codes (worst pair {largest}; measured {measured}, of which noise makes {})", codes(floor))
        }
        None => format!("{median} codes (worst pair {largest}, noise's part not measured)"),
    }
}

/// The displacement, or the reason why none was measured, and the number of pairs without a match.
fn registration(verification: &Verification) -> String {
    let verb = if verification.unmatched == 1 { "does" } else { "do" };
    let unmatched = format!("{} with texture {verb} not match", count(verification.unmatched, "pair"));
    match (&verification.displaced, verification.unmatched) {
        (Some(px), 0) => displaced(px),
        (Some(px), _) => format!("{}; {unmatched}", displaced(px)),
        (None, 0) => "unknown, too little texture above the noise".to_owned(),
        (None, _) => format!("unknown, {unmatched}"),
    }
}

/// Lines about slides over [`SLIDE_FRAMES`] frames, and about pairs that got worse.
fn slide_lines(slides: &[SlidePair]) -> Vec<(&'static str, bool, String)> {
    let pooled = |px: &dyn Fn(&SlidePair) -> Vec<f64>| {
        upper_median(slides.iter().filter(|pair| pair.later == SLIDE_FRAMES).flat_map(px))
    };
    let mut lines = Vec::new();
    let recorded = pooled(&|pair| pair.recorded_px.clone());
    let refined = pooled(&|pair| pair.refined_px.clone().unwrap_or_default());
    if let Some(was) = recorded {
        let now = refined.map_or(String::new(), |px| format!(", as analysed {} px", fixed(px, 2)));
        let passes = refined.unwrap_or(was) <= MAX_SLIDE_PX;
        let was = fixed(was, 2);
        let text = format!("over {SLIDE_FRAMES} frames, recorded {was} px{now}; at most {MAX_SLIDE_PX} px");
        lines.push(("slide", passes, text));
    }
    if let Some((worse, of, largest_px)) = report::worse(slides) {
        let passes = worse as f64 <= MAX_WORSE_FRACTION * of as f64 && largest_px <= MAX_WORSE_PX;
        let largest = fixed(largest_px, 2);
        let text = format!(
            "{worse} of {} by more than 0.1 px, {largest} px at most; at most {:.0} %, none by {MAX_WORSE_PX} px",
            count(of, "pair"),
            100.0 * MAX_WORSE_FRACTION
        );
        lines.push(("worse", passes, text));
    }
    lines
}
