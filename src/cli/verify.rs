//! `locard verify`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};

use super::analysis::Analysis;
use super::skip::Skip;
use super::{progress, warn};
use crate::gpu::Gpu;
use crate::recording::OpenOptions;
use crate::shot::{Analysed, AnalysisState, Given, Shot};
use crate::verify::{Plan, Verified, verify};
use crate::words::{count, fixed};

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

/// What passes: a median displacement, px, and a median difference of luma, codes.
const MOST_PX: f64 = 0.7;
const MOST_CODES: f64 = 1.5;

pub fn run(args: &Args) -> Result<()> {
    if args.every == 0 || args.gap == 0 {
        bail!("--every and --gap are at least 1");
    }
    let options = args.skip.over(OpenOptions::default());
    let open = |analysis| {
        let given = Given { profile: args.profile.clone(), sets: args.sets.clone(), analysis, ..Given::default() };
        Shot::open(&args.recording, &options, &given)
    };
    let recorded = open(Analysed::No)?;
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
    let judged = |shot: &Shot| {
        verify(&gpu, shot, plan, |done, of| {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        })
    };
    let by_record = judged(&recorded)?;
    let by_findings = matches!(found.analysis, AnalysisState::Used(..)).then(|| judged(&found)).transpose()?;
    bar.finish_and_clear();
    say(args, &by_record, by_findings.as_ref())
}

fn say(args: &Args, recorded: &Verified, found: Option<&Verified>) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let now = found.unwrap_or(recorded);
    writeln!(out, "pairs        {}, {} frames apart", count(now.pairs, "pair"), args.gap)?;
    let mut failed = Vec::new();
    let mut line =
        |name: &str, unit: &str, most: f64, of: fn(&Verified) -> Option<(f64, f64)>, second: &str| -> Result<()> {
            let told = |of: Option<(f64, f64)>| match of {
                Some((median, worst)) => format!("{} {unit} ({second} {})", fixed(median, 2), fixed(worst, 2)),
                None => "unknown".to_owned(),
            };
            let passes = of(now).is_some_and(|(median, _)| median <= most);
            let refined = found.map_or(String::new(), |found| format!(", as analysed {}", told(of(found))));
            let verdict = if passes { "pass" } else { "FAIL" };
            writeln!(out, "{name:<12} recorded {}{refined}; at most {most} {unit}: {verdict}", told(of(recorded)))?;
            if !passes {
                failed.push(name.to_owned());
            }
            Ok(())
        };
    line("registration", "px", MOST_PX, |v| v.displaced_px, "90 %")?;
    line("gain", "codes", MOST_CODES, |v| v.brighter_codes, "worst pair")?;
    if failed.is_empty() { Ok(()) } else { bail!("{}: {} fail", args.recording.display(), failed.join(" and ")) }
}
