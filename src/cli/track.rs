//! `locard track`.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::{print_status, progress, warn};
use locard_engine::compositor::Settings;
use locard_engine::live::LiveOptions;
use locard_engine::profile::Rig;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};
use locard_engine::source::video::{Overrides, probe};
use locard_engine::tags::{Board, Paper, RecordingInputs, Sheet, new_folder, record, track};
use locard_engine::text::{count, reason};

#[derive(clap::Args)]
pub struct Args {
    /// The video, which shows printed tags
    video: PathBuf,
    /// The profile of the camera that took it: focal length and distortion as `locard calibrate
    /// camera` measures them
    #[arg(long)]
    profile: PathBuf,
    /// The positions of the tags; by default the sheet that `locard board` prints
    #[arg(long, value_name = "FILE")]
    board: Option<PathBuf>,
    /// Smooth the poses by a line through those around each, weighted by this time constant,
    /// seconds; by default they are not smoothed
    #[arg(long, value_name = "S", value_parser = LiveOptions::parse_time_constant_s)]
    smooth: Option<f64>,
    /// The folder of the recording
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
    /// Replace a recording that was tracked
    #[arg(long)]
    force: bool,
    /// No progress bar and no warnings
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let inputs: Vec<&Path> = [Some(&args.video), Some(&args.profile), args.board.as_ref()]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    let profile = file::read_text(&args.profile, MAX_DOCUMENT_BYTES)
        .map_err(|error| {
        anyhow::anyhow!(
            "--profile {}: cannot be read: {}; expected a camera's profile, as `locard calibrate camera -o camera.toml` \
             writes it",
            args.profile.display(),
            reason(&error)
        )
    })?;
    let mut rig = Rig::default();
    rig.read_text(&profile, &args.profile, &mut Settings::default())?;
    let camera = rig.camera();
    let Some(geometry) = camera.geometry else {
        let missing = rig.missing_keys().join(", ");
        bail!("{}: [camera] lacks {missing}; `locard calibrate camera` measures them", args.profile.display());
    };
    let board = match &args.board {
        Some(file) => Board::read(file)?,
        None => Sheet::new(Paper::A4).board,
    };
    let video = probe(&args.video, &Overrides::default())?;
    // Checked before the work starts, so that no files of the user are lost.
    let folder = new_folder(&args.output, args.force);
    folder.check(&inputs)?;
    video.warnings.iter().for_each(|text| warn(args.quiet, text));
    let bar = progress(args.quiet, video.timestamps_s.len());
    let tracked = track(&video, &board, &geometry, &camera.response, &mut |done, _| {
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    let mut tracked = tracked.map_err(|error| anyhow::Error::from(error).context(args.video.display().to_string()))?;
    if let Some(tau_s) = args.smooth {
        tracked.smooth(tau_s);
    }
    record(&folder, &RecordingInputs { video: &video, profile: &profile, board: &board, track: &tracked })?;
    write!(std::io::stdout().lock(), "{tracked}")?;
    print_status(args.quiet, &format!("{}: {}", count(tracked.chosen().count(), "pose"), args.output.display()));
    Ok(())
}
