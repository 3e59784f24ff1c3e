//! `locard join`.

use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};

use super::composite::parse_range;
use super::open::Skip;
use super::{print_message, print_status};
use locard_engine::farm::{FrameTimes, JoinOptions, RecordedPart, join, parts_at};
use locard_engine::provenance::CommandRecord;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::sink::OutPath;
use locard_engine::text::count;

#[derive(clap::Args)]
pub struct Args {
    /// Outputs of `locard composite` with their records beside them, in any order, or folders of
    /// such outputs
    #[arg(required = true, value_name = "PART")]
    parts: Vec<PathBuf>,
    /// The joined output: a folder for parts that are folders, a video of the same kind for videos
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    output: PathBuf,
    /// The frames that the parts must cover together, as in 0..7200; by default from the first
    /// part's to the last one's
    #[arg(long, value_name = "A..B", value_parser = whole_range)]
    frames: Option<Range<usize>>,
    /// The recording of the parts: a joined video gets its sound and the times of its frames
    #[arg(long, value_name = "RECORDING")]
    recording: Option<PathBuf>,
    #[command(flatten)]
    skip: Skip,
    /// Leave out the sound of the recording's video
    #[arg(long)]
    no_sound: bool,
    /// Accept parts of several adapters and drivers of one kind, which may round differently
    #[arg(long)]
    any_driver: bool,
    /// Replace output that exists
    #[arg(long)]
    force: bool,
    /// No closing line
    #[arg(long, short)]
    quiet: bool,
}

/// A range with both ends.
pub fn whole_range(text: &str) -> Result<Range<usize>, String> {
    match parse_range(text)? {
        (Some(start), Some(end)) if start < end => Ok(start..end),
        _ => Err(format!("{text} is not a range with both ends; expected A..B, as in 0..50")),
    }
}

pub fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    let parts = parts_at(&args.parts)?;
    let is_video = match OutPath::parse(&args.output)? {
        OutPath::Folder(_) => false,
        OutPath::Video(_) => true,
        OutPath::Stdout | OutPath::Stream(_) => {
            bail!("{}: parts are joined to a folder or a video file; name one", args.output.display())
        }
    };
    let mut options = JoinOptions {
        out: args.output.clone(),
        frames: args.frames.clone(),
        force: args.force,
        any_driver: args.any_driver,
        soundtrack: None,
        times: FrameTimes::Steady,
        command: serde_json::to_value(CommandRecord::current())?,
    };
    if let Some(path) = args.recording.as_ref().filter(|_| is_video) {
        follow_recording(
            &Recording::open(path, &args.skip.apply_to(OpenOptions::default()))?,
            &parts,
            args,
            &mut options,
        )?;
    }
    let is_replaced = RecordedPart::read(&args.output).is_ok_and(|earlier| earlier.is_signed());
    let done = join(&parts, &options)?;
    // Also if the program is quiet.
    if is_replaced {
        print_message(&format!("{}: replaces a signed output; sign it again (`locard sign`)", args.output.display()));
    }
    if parts.iter().any(RecordedPart::is_signed) {
        print_message(
            "the parts are signed: their signatures are not valid for the joined output, which has another record; sign it \
             (`locard sign`)",
        );
    }
    print_status(
        args.quiet,
        &format!(
            "{} of {} joined in {:.1} s: {}",
            count(done.frames, "frame"),
            count(done.parts, "part"),
            start.elapsed().as_secs_f64(),
            args.output.display()
        ),
    );
    Ok(())
}

/// Takes sound and times from the recording of the parts.
fn follow_recording(
    recording: &Recording,
    parts: &[RecordedPart],
    args: &Args,
    options: &mut JoinOptions,
) -> Result<()> {
    let (Some(first), Some(last)) = (parts.first(), parts.last()) else { return Ok(()) };
    let range = first.range().start..last.range().end;
    if range.end > recording.frame_count() {
        bail!(
            "{}: has {}, but {} has frames up to {}; name the recording of the parts",
            recording.path.display(),
            count(recording.frame_count(), "frame"),
            last.path.display(),
            range.end - 1
        );
    }
    if !args.no_sound {
        options.soundtrack = recording.soundtrack(range.clone());
    }
    if let Some(times_s) = recording.times_unless_steady(range) {
        options.times = FrameTimes::Variable(times_s);
    }
    Ok(())
}
