//! `locard analyse`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};

use super::skip::Skip;
use super::{progress, tell, warn};
use crate::analyse::{Analysis, FILE_NAME, FILES, Taken, analyse, beside};
use crate::compositor::exposure_time_s;
use crate::frame::Frame;
use crate::recording::OpenOptions;
use crate::rows::processors;
use crate::shot::{Analysed, Given, Shot};
use crate::sink::atomic::write_atomically;
use crate::unfinished::MadeFolder;
use crate::words::{count, reason, shown};

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
    /// The folder of what is found; otherwise beside the recording, of its name with .analysis, where `composite` finds it
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: Option<PathBuf>,
    /// Make it anew though it is there and fits
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    skip: Skip,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    let given =
        Given { profile: args.profile.clone(), sets: args.sets.clone(), analysis: Analysed::No, ..Given::default() };
    let shot = Shot::open(&args.recording, &args.skip.over(OpenOptions::default()), &given)?;
    let folder = args.output.clone().unwrap_or_else(|| beside(&shot.recording.path));
    for text in &shot.recording.warnings {
        warn(args.quiet, text);
    }
    let made = make(&shot, &folder, args.force, args.quiet)?;
    write!(std::io::stdout().lock(), "{}", made.findings)?;
    let frames = count(shot.recording.frame_count(), "frame");
    tell(args.quiet, &format!("{frames} in {:.1} s: {}", start.elapsed().as_secs_f64(), folder.display()));
    Ok(())
}

/// Analyses a recording that was opened without its analysis, unless the one that is there fits.
pub fn make(shot: &Shot, folder: &Path, force: bool, quiet: bool) -> Result<Analysis> {
    let camera = shot.geometry_at(0)?;
    if let Some(other) = others(folder) {
        bail!(
            "{}: holds {}, which is no part of an analysis; name another folder by -o",
            folder.display(),
            shown(&other)
        );
    }
    if !force
        && let Ok(there) = Analysis::read(folder)
        && there.fits(&shot.recording, &camera).is_ok()
    {
        tell(quiet, &format!("{}: was there and fits; --force makes it anew", folder.display()));
        return Ok(there);
    }
    let bar = progress(quiet, 0);
    let rig = shot.camera();
    let exposure_s = |frame: &Frame| exposure_time_s(&rig, &shot.settings, frame, shot.interval_s(frame.index));
    let taken = Taken { response: &rig.response, noise: rig.noise.as_ref(), exposure_s: &exposure_s };
    let made = analyse(&shot.recording, &camera, &taken, processors(), &mut |done, of| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
        Ok(())
    });
    bar.finish_and_clear();
    let made = made.with_context(|| shot.recording.path.display().to_string())?;
    write(folder, &made, shot).with_context(|| format!("{}: cannot be written", folder.display()))?;
    Ok(made)
}

/// Something in a folder that no analysis has; what an interrupted one left is none.
fn others(folder: &Path) -> Option<String> {
    let names = folder.read_dir().ok()?.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| !name.starts_with('.') && !FILES.contains(&name.as_str())).min()
}

/// The file that tells an analysis goes first and comes last, so that a half-written one is none.
fn write(folder: &Path, made: &Analysis, shot: &Shot) -> Result<()> {
    let there = MadeFolder::make(folder).map_err(|error| anyhow::anyhow!(reason(&error)))?;
    match std::fs::remove_file(folder.join(FILE_NAME)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => bail!(reason(&error)),
        _ => {}
    }
    for (name, text) in made.files(&shot.recording)? {
        write_atomically(&folder.join(name), true, |out| out.write_all(text.as_bytes()))?;
    }
    there.keep();
    Ok(())
}
