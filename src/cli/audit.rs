//! `locard audit`.

use std::path::{Path, PathBuf};
use std::sync::mpsc;

use anyhow::{Context, Result, bail};
use clap::Parser;

use super::{Cli, Command, composite, print_line, print_list, progress, warn};
use locard_engine::gpu::Gpu;
use locard_engine::provenance::audit::{
    ForwardSink, FrameAudit, RecomputedFrame, RecomputedOutcome, changed_inputs, changed_outputs, spread,
};
use locard_engine::provenance::{
    DeviceRecord, OutputKind, ProgramRecord, Record, as_read, output_of_record, record_path,
};
use locard_engine::shot::AnalysisChoice;
use locard_engine::sink::Sink;
use locard_engine::text::count;

#[derive(clap::Args)]
pub struct Args {
    /// The output of `locard composite`: a folder of frames or a video, with its record beside it
    output: PathBuf,
    /// Recompute only so many of the frames, spread evenly, as in 5 or 1%
    #[arg(long, value_name = "N|N%", value_parser = sample)]
    sample: Option<AuditSample>,
    /// Only compare files with the record; recompute no frame
    #[arg(long, conflicts_with_all = ["sample", "within"])]
    files_only: bool,
    /// Accept frames that differ by up to N code values, as another graphics driver makes them
    #[arg(long, value_name = "N", default_value_t = 0)]
    within: u32,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

/// How many frames are recomputed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AuditSample {
    Frames(usize),
    Percent(f64),
}

fn sample(text: &str) -> Result<AuditSample, String> {
    let parsed = match text.trim().strip_suffix('%') {
        Some(percent) => percent.trim().parse().ok().filter(|p| *p > 0.0 && *p <= 100.0).map(AuditSample::Percent),
        None => text.trim().parse().ok().filter(|n| *n > 0).map(AuditSample::Frames),
    };
    parsed.ok_or_else(|| "expected a number of frames, as in 5, or a share, as in 1%".to_owned())
}

impl AuditSample {
    fn frames(self, of: usize) -> usize {
        match self {
            Self::Frames(frames) => frames.min(of),
            Self::Percent(percent) => ((percent / 100.0 * of as f64).ceil() as usize).clamp(1, of.max(1)),
        }
    }
}

pub fn run(args: &Args) -> Result<()> {
    // The record stands for its output.
    let named = output_of_record(&args.output).unwrap_or_else(|| args.output.clone());
    let record = Record::read(&named)?;
    if record.pictures.is_empty() || record.work.inputs.is_empty() {
        bail!("{}: lists no pictures or no inputs, so nothing can be compared", record_path(&named).display());
    }
    // Paths in the record start at the folder of its command.
    let output = std::path::absolute(&named)?;
    if let Err(error) = std::env::set_current_dir(&record.work.command.folder) {
        let folder = record.work.command.folder.display();
        warn(args.quiet, &format!("{folder}: {error}; the recorded paths are read from the current folder"));
    }
    let all: Vec<usize> = record.pictures.iter().map(|picture| picture.frame).collect();
    let frames: Vec<usize> = match args.sample {
        Some(sample) => spread(sample.frames(all.len()), all.len()).into_iter().map(|at| all[at]).collect(),
        None => all,
    };
    let program = ProgramRecord::current();
    if program != record.work.program {
        let ProgramRecord { name, version, build } = &record.work.program;
        print_line(&format!(
            "another build of the program: the output was made by {name} {version}, build {}, this is {}",
            short(build),
            short(&program.build)
        ))?;
    }
    let mut problems = changed_inputs(&record, Path::new(""));
    let inputs = problems.len();
    print_line(&format!("inputs: {} of {} as recorded", record.work.inputs.len() - inputs, record.work.inputs.len()))?;
    problems.extend(changed_outputs(&record, &output, &frames));
    print_list(&problems)?;
    if problems.len() == inputs {
        let all = record.pictures.len();
        let share = if record.output.kind == OutputKind::Video {
            String::new()
        } else {
            format!(", {} of {all} pictures", frames.len())
        };
        print_line(&format!("output: as it was written{share}"))?;
    }
    let recomputed = if args.files_only { Vec::new() } else { recompute(args, &record, &output, &frames)? };
    let worst = conclude(&recomputed)?;
    match worst {
        _ if !problems.is_empty() => bail!(
            "{}: {} not as recorded (listed above)",
            args.output.display(),
            count(problems.len(), "file") + if problems.len() == 1 { " is" } else { " are" }
        ),
        Some(codes) if codes > args.within => {
            bail!("{}: recomputed frames differ from the recorded ones (listed above)", args.output.display())
        }
        _ => Ok(()),
    }
}

/// The first digits of a digest.
fn short(digest: &str) -> &str {
    digest.get(..12).unwrap_or("unknown")
}

/// Recomputes frames by the recorded command.
fn recompute(args: &Args, record: &Record, output: &Path, frames: &[usize]) -> Result<Vec<RecomputedFrame>> {
    let arguments = std::iter::once("locard").chain(record.work.command.arguments.iter().map(String::as_str));
    let Ok(Cli { command: Command::Composite(command) }) = Cli::try_parse_from(arguments) else {
        let name = record.work.command.arguments.first().map_or("no command", String::as_str);
        print_line(&format!("frames: not recomputed; this program repeats `composite` alone, the record has {name}"))?;
        return Ok(Vec::new());
    };
    let analysis =
        record.work.inputs.iter().find(|input| input.role == "analysis").and_then(|input| input.path.parent());
    let analysis = analysis.map_or(AnalysisChoice::No, |folder| AnalysisChoice::At(folder.to_owned()));
    let (shot, export) = composite::reopen(&command, analysis).context("the recorded command cannot be repeated")?;
    if as_read(&export.settings_record(&shot)) != as_read(&record.work.settings)
        || shot.settings.seed != record.work.seed
    {
        bail!("the recorded command has other settings or another seed than the record states: the record was edited");
    }
    let count_now = shot.recording.frame_count();
    if let Some(frame) = frames.iter().find(|frame| **frame >= count_now) {
        bail!("frame {frame}: the recording has {} now", count(count_now, "frame"));
    }
    let mut compositor = shot.compositor(Gpu::open()?);
    let device = DeviceRecord::of(&compositor.gpu().info);
    if device != record.work.device {
        let device_text = |device: &DeviceRecord| format!("{}, {}", device.adapter, device.driver);
        print_line(&format!(
            "another device: the output was made on {}, this is {}",
            device_text(&record.work.device),
            device_text(&device)
        ))?;
    }
    let (sender, finished) = mpsc::channel();
    let mut sink: Box<dyn Sink + Send> = export.finishing(&shot, Box::new(ForwardSink(sender)));
    let audit = FrameAudit::new(record, output);
    let bar = progress(args.quiet, frames.len());
    let mut recomputed = Vec::with_capacity(frames.len());
    for run in frames.chunk_by(|a, b| a + 1 == *b) {
        let range = run[0]..run[run.len() - 1] + 1;
        let composites = shot.frames(&mut compositor, range, false, locard_engine::compositor::IN_FLIGHT)?;
        for composited in composites {
            let composited = composited?;
            let stated = audit.picture(composited.frame);
            if stated.is_some_and(|picture| picture.rect_px != composited.stats.rect_px) {
                let rect_px = composited.stats.rect_px;
                bail!("frame {}: the bounds of its changed pixels are {rect_px:?}, not as recorded", composited.frame);
            }
            sink.write(composited.frame, &composited.pixels)?;
            recomputed.extend(finished.try_iter().map(|(frame, pixels)| audit.compare(frame, &pixels)));
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(recomputed)
}

/// Prints the comparison. Returns the largest difference in code values, if any frame was made
/// again.
fn conclude(recomputed: &[RecomputedFrame]) -> Result<Option<u32>> {
    if recomputed.is_empty() {
        return Ok(None);
    }
    let unequal: Vec<&RecomputedFrame> =
        recomputed.iter().filter(|frame| frame.outcome != RecomputedOutcome::Equal).collect();
    print_line(&format!(
        "frames: {} of {} recomputed are equal bit for bit",
        recomputed.len() - unequal.len(),
        recomputed.len()
    ))?;
    let line = |frame: &&RecomputedFrame| match &frame.outcome {
        RecomputedOutcome::Equal => String::new(),
        RecomputedOutcome::Differs(by) => {
            let b = by.bounds;
            format!(
                "frame {}: equal within {}; {} differ, 99 % of them within {}, in columns {}..{}, rows {}..{}",
                frame.frame,
                count(by.max_codes as usize, "code"),
                count(by.pixels, "pixel"),
                count(by.p99_codes as usize, "code"),
                b.x0,
                b.x1,
                b.y0,
                b.y1
            )
        }
        RecomputedOutcome::Unequal(why) => format!("frame {}: not equal; {why}", frame.frame),
    };
    print_list(&unequal.iter().map(line).collect::<Vec<_>>())?;
    let codes = |frame: &&RecomputedFrame| match &frame.outcome {
        RecomputedOutcome::Equal => 0,
        RecomputedOutcome::Differs(by) => by.max_codes,
        RecomputedOutcome::Unequal(_) => u32::MAX,
    };
    Ok(unequal.iter().map(codes).max().or(Some(0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sample_is_a_number_or_a_share_of_frames() {
        assert_eq!(sample("5"), Ok(AuditSample::Frames(5)));
        assert_eq!(sample("1 %"), Ok(AuditSample::Percent(1.0)));
        for text in ["0", "0%", "101%", "a", "-3", ""] {
            assert!(sample(text).unwrap_err().contains("expected a number of frames"), "{text}");
        }
        assert_eq!(AuditSample::Percent(1.0).frames(250), 3);
        assert_eq!((AuditSample::Percent(1.0).frames(3), AuditSample::Frames(9).frames(3)), (1, 3));
    }
}
