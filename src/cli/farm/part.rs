//! `locard farm part`.

use std::ops::Range;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};

use super::super::join::whole_range;
use super::super::warn;
use super::machine::MachineArgs;
use locard_engine::farm::{PartState, part_name, part_state};
use locard_engine::provenance::record_path;
use locard_engine::text::reason;

#[derive(clap::Args)]
pub struct PartArgs {
    /// The part's frames, half-open, as in 40..50
    #[arg(long, value_name = "A..B", value_parser = whole_range)]
    frames: Range<usize>,
    /// Folder of all parts
    #[arg(long, value_name = "DIR")]
    into: PathBuf,
    /// Write the part as a video with this extension (mp4, mkv or mov); by default a folder of PNG
    /// files
    #[arg(long, value_name = "EXTENSION")]
    video: Option<String>,
    #[command(flatten)]
    machine: MachineArgs,
    /// Recording and options of `locard composite`, after --
    #[arg(last = true, required = true, value_name = "COMPOSITE")]
    composite: Vec<String>,
}

/// Arguments of `locard composite` for a part. They are the same each time, so that the record of a
/// part identifies it.
pub fn composite_arguments(composite: &[String], frames: &Range<usize>, output: &str) -> Vec<String> {
    let range = format!("{}..{}", frames.start, frames.end);
    let mut arguments = vec!["composite".to_owned()];
    arguments.extend_from_slice(composite);
    arguments.extend(["--frames", &range, "-o", output, "--force", "--quiet"].map(str::to_owned));
    arguments
}

pub fn run(args: &PartArgs) -> Result<()> {
    let mut name = part_name(&args.frames);
    if let Some(extension) = &args.video {
        name = format!("{name}.{extension}");
    }
    let output = args.into.join(name);
    let Some(output_text) = output.to_str() else {
        bail!("{}: the folder's name is not Unicode; rename it", output.display());
    };
    let build = args.machine.check_build()?;
    let arguments = composite_arguments(&args.composite, &args.frames, output_text);
    match part_state(&output, &arguments, &build, args.machine.adapter_kind.as_deref()) {
        PartState::Complete => {
            warn(false, &format!("{}: is complete, and is kept", output.display()));
            return Ok(());
        }
        PartState::Outdated(why) => {
            warn(false, &format!("{}: is recreated: {why}", output.display()));
            // While the part is recreated it has no record.
            let record = record_path(&output);
            std::fs::remove_file(&record)
                .map_err(|error| anyhow::anyhow!("{}: cannot be removed: {}", record.display(), reason(&error)))?;
        }
        PartState::Absent => {}
    }
    args.machine.check_adapter()?;
    composite(&arguments)
}

/// Runs `locard composite` in the place of this process, so that whoever ends this process ends it.
#[cfg(unix)]
fn composite(arguments: &[String]) -> Result<()> {
    use std::os::unix::process::CommandExt;
    let program = std::env::current_exe().context("this program's file")?;
    // Returns only on failure.
    let error = Command::new(&program).args(arguments).exec();
    bail!("{}: cannot be started: {}", program.display(), reason(&error))
}

#[cfg(not(unix))]
fn composite(arguments: &[String]) -> Result<()> {
    let program = std::env::current_exe().context("this program's file")?;
    let status = Command::new(&program).args(arguments).status();
    let status =
        status.map_err(|error| anyhow::anyhow!("{}: cannot be started: {}", program.display(), reason(&error)))?;
    // The message of the other process stands already.
    if !status.success() {
        std::process::exit(status.code().unwrap_or(2));
    }
    Ok(())
}
