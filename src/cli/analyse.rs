//! `locard analyse`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};

use super::calibrate::existing;
use super::open::Skip;
use super::{print_status, progress_of, warn};
use locard_engine::analyse::{
    AcceptOutcome, Analysis, Findings, Outcome, Progress, Times, accept, check_folder, default_folder,
    write_support_reports,
};
use locard_engine::export::{Inputs, resolved};
use locard_engine::profile::ProfileFile;
use locard_engine::recording::OpenOptions;
use locard_engine::report;
use locard_engine::scene;
use locard_engine::shot::{AnalysisChoice, Note, Shot, ShotOptions};
use locard_engine::sink;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file;
use locard_engine::support::SupportReport;
use locard_engine::text::{count, fixed, number};
use locard_engine::verify::NoiseComparison;

/// Largest report, bytes.
const MAX_REPORT_BYTES: u64 = 64 << 20;

#[derive(clap::Args)]
pub struct Args {
    /// Folder or file of the recording
    recording: PathBuf,
    /// The camera; without it, the recording's own
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Set a parameter of the camera, as in --set camera.fx_px=520
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    sets: Vec<String>,
    /// Length of a unit, for formats without a scale (nerfstudio, COLMAP, Metashape …)
    #[arg(long, default_value_t = 1.0, value_name = "M")]
    metres_per_unit: f64,
    /// The folder of the analysis; by default beside the recording, with its name and .analysis,
    /// where `composite` finds it
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: Option<PathBuf>,
    /// Also find the surfaces that support this scene's objects and those beside them that receive
    /// their shadows: printed, written into that folder's supports.toml and into the page
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Also write the results as a page for a browser, with plots and pictures: one HTML file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the camera's results (readout, point spread, exposure) into this profile; everything
    /// else in it is kept. A new one begins as a copy of --profile
    #[arg(long, value_name = "PROFILE")]
    accept: Option<PathBuf>,
    /// Repeat the analysis even if a valid one exists
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    skip: Skip,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

impl Args {
    fn options(&self) -> OpenOptions {
        self.skip.apply_to(OpenOptions { metres_per_unit: self.metres_per_unit, ..OpenOptions::default() })
    }
}

pub fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    let shot_options = ShotOptions {
        profile: args.profile.clone(),
        sets: args.sets.clone(),
        analysis: AnalysisChoice::No,
        ..ShotOptions::default()
    };
    let mut shot = Shot::open(&args.recording, &args.options(), &shot_options)?;
    let folder = args.output.clone().unwrap_or_else(|| default_folder(&shot.recording.path));
    for text in &shot.recording.warnings {
        warn(args.quiet, text);
    }
    // An invalid scene is an error before the analysis starts.
    if let Some(scene) = &args.scene {
        shot.set_site_of(&scene::load(scene, shot.recording.up)?)?;
    }
    if let Some(report) = &args.report {
        check_report(report, &shot, &folder)?;
    }
    let updated_profile = args.accept.as_deref().map(|path| profile_to_update(path, args, &shot)).transpose()?;
    let (analysis, times) = make(&shot, &folder, args.force, args.quiet)?;
    write!(std::io::stdout().lock(), "{}", analysis.findings)?;
    let scene_support =
        args.scene.as_deref().map(|scene| Ok::<_, anyhow::Error>((scene, support_reports(scene, args, &folder)?)));
    let scene_support = scene_support.transpose()?;
    let grounds = scene_support.as_ref().map_or(&[][..], |(_, grounds)| grounds);
    for (name, text) in grounds.iter().flat_map(SupportReport::lines) {
        writeln!(std::io::stdout().lock(), "{name:<11}{text}")?;
    }
    if let Some(path) = &args.report {
        write_report(path, &shot, (&analysis, grounds), times.as_ref(), None)?;
    }
    if let (Some(path), Some(mut profile)) = (&args.accept, updated_profile) {
        let accepted = accept(&analysis.findings, &mut profile);
        if accepted.iter().any(|accepted| matches!(accepted.outcome, Outcome::Written { .. })) {
            write_atomically(path, true, |out| out.write_all(profile.to_string().as_bytes()))?;
        }
        print_accepted(&accepted, &analysis.findings, shot.recording.track.clock_offset_s())?;
    }
    if let Some((scene, grounds)) = &scene_support {
        write_support_reports(&folder, scene, grounds)?;
    }
    let frames = count(shot.recording.frame_count(), "frame");
    print_status(args.quiet, &format!("{frames} in {:.1} s: {}", start.elapsed().as_secs_f64(), folder.display()));
    Ok(())
}

/// Reads the profile for `--accept` before the analysis starts: an invalid profile is an error.
fn profile_to_update(path: &Path, args: &Args, shot: &Shot) -> Result<ProfileFile> {
    let (is_there, profile) = existing(path)?;
    if is_there {
        return Ok(profile);
    }
    Inputs::of(shot).check_file(path)?;
    match &args.profile {
        Some(from) => Ok(existing(from)?.1),
        None => Ok(profile),
    }
}

/// Prints a line for each key, with the value before and after.
fn print_accepted(accepted: &[AcceptOutcome], findings: &Findings, time_offset_s: f64) -> Result<()> {
    let mut out = std::io::stdout().lock();
    for AcceptOutcome { key, outcome } in accepted {
        match outcome {
            Outcome::Written { before, after } => {
                let before = before.map_or("unsaid".to_owned(), number);
                writeln!(out, "accepted   {key}: {before} -> {}", number(*after))?;
            }
            Outcome::Kept(why) => writeln!(out, "accepted   {key} stays: {why}")?,
        }
    }
    let registered = &findings.registration;
    if let Some(clock_s) = registered.clock_s.filter(|_| registered.is_refined()) {
        let offset_s = fixed(time_offset_s + clock_s, 4);
        writeln!(
            out,
            "accepted   the clock of the poses is not written: it belongs to the tracker, and is stored in the \
             analysis (in a recording.toml: poses.time_offset_s = {offset_s})"
        )?;
    }
    Ok(())
}

/// Checks before the analysis starts that the report can be written, and replaces nothing but a
/// report.
pub fn check_report(path: &Path, shot: &Shot, folder: &Path) -> Result<()> {
    Inputs::of(shot).check_file(path)?;
    sink::check_file(path, true)?;
    if resolved(path).parent() == Some(&resolved(folder)) {
        bail!("{}: the folder of an analysis contains nothing else; choose another folder", path.display());
    }
    let is_page = || file::read_text(path, MAX_REPORT_BYTES).is_ok_and(|text| text.contains(report::MADE_BY));
    if path.is_file() && path.metadata().is_ok_and(|there| there.len() > 0) && !is_page() {
        bail!(
            "{}: exists already and is not a report of an analysis, so it is kept; choose another file",
            path.display()
        );
    }
    Ok(())
}

/// The support of a scene's objects, with the camera poses of the analysis in a folder.
fn support_reports(scene: &Path, args: &Args, folder: &Path) -> Result<Vec<SupportReport>> {
    let (profile, sets) = (args.profile.clone(), args.sets.clone());
    let analysis = AnalysisChoice::At(folder.to_owned());
    let shot_options = ShotOptions { profile, sets, scene: Some(scene.to_owned()), analysis, ..ShotOptions::default() };
    let shot = Shot::open(&args.recording, &args.options(), &shot_options)?;
    shot.scene.warnings.iter().for_each(|text| warn(args.quiet, text));
    if shot.up().is_none() {
        warn(args.quiet, "neither the scene nor the recording defines up, so the supports of objects are unknown");
    }
    let grounds = shot.support_report();
    // The same notes as those of `composite`, except for gaps in the lines of the support reports:
    // an object that is sunk into a table may be above a floor.
    let is_reported = |note: &Note| match note {
        Note::Gap { name, gap_m, .. } => {
            grounds.iter().any(|ground| ground.name == *name && ground.includes_gap(*gap_m))
        }
        _ => false,
    };
    let notes = shot.support_gap_notes(0..shot.recording.frame_count()).into_iter().filter(|note| !is_reported(note));
    notes.for_each(|note| warn(args.quiet, &note.to_string()));
    Ok(grounds)
}

pub fn write_report(
    path: &Path,
    shot: &Shot,
    (analysis, grounds): (&Analysis, &[SupportReport]),
    times: Option<&Times>,
    noise: Option<&NoiseComparison>,
) -> Result<()> {
    let camera = shot.geometry_at(0)?;
    let response = shot.camera().response;
    let source = report::ReportSource {
        recording: &shot.recording,
        camera: &camera,
        response: &response,
        analysis,
        grounds,
        times,
        noise,
    };
    let page = report::html(&source).with_context(|| format!("{}: cannot be created", path.display()))?;
    write_atomically(path, true, |out| out.write_all(page.as_bytes()))?;
    Ok(())
}

/// Analyses a recording that was opened without its analysis, or returns the existing analysis if
/// it fits, with the times that it took.
pub fn make(shot: &Shot, folder: &Path, force: bool, quiet: bool) -> Result<(Analysis, Option<Times>)> {
    check_folder(folder)?;
    if !force
        && let Ok(there) = Analysis::read(folder)
        && there.fits(&shot.recording, &shot.geometry_at(0)?).is_ok()
        && there.is_current(&shot.recording)
    {
        print_status(quiet, &format!("{}: exists and is up to date; --force repeats it", folder.display()));
        return Ok((there, Times::read(folder)));
    }
    let bar = progress_of(quiet, 0, "{wide_bar} {percent} %, {msg}");
    let analysis = shot.analyse(folder, &mut |Progress { done, of, stage }| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
        bar.set_message(stage.name());
        Ok(())
    });
    bar.finish_and_clear();
    let (analysis, times) = analysis?;
    Ok((analysis, Some(times)))
}
