//! `locard audit`.

mod recompute;

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use clap::Parser;

use super::{Cli, Command, message, print_line, print_list, warn};
use locard_engine::export::mask_name;
use locard_engine::photo::log::{recorded_photographs, unrecorded_pictures};
use locard_engine::provenance::audit::{
    ChangedFile, OtherBounds, RecomputedFrame, RecomputedOutcome, changed_inputs, changed_mask, changed_outputs, spread,
};
use locard_engine::provenance::{
    OutputKind, PictureRecord, ProgramRecord, Record, output_of_record, record_path, video_programs,
};
use locard_engine::text::{count, reason};

#[derive(clap::Args)]
pub struct Args {
    /// The output of `locard composite`, `photo` or `case-card` with its record beside it: a folder
    /// of frames, a video, a photograph or a folder of photographs
    output: PathBuf,
    /// Recompute only so many of the frames or photographs, spread evenly, as in 5 or 1%
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
    if named.is_dir() && !record_path(&named).exists() {
        let unread = |error: std::io::Error| anyhow!("{}: cannot be read: {}", named.display(), reason(&error));
        let photographs = recorded_photographs(&named).map_err(unread)?;
        if !photographs.is_empty() {
            return audit_series(args, &photographs, &unrecorded_pictures(&named).map_err(unread)?);
        }
    }
    audit(args, &named, args.sample)
}

/// Audits photographs and case cards of one folder. Pictures without a record are failures.
fn audit_series(args: &Args, photographs: &[PathBuf], unrecorded: &[PathBuf]) -> Result<()> {
    let all = photographs.len();
    let sampled = args.sample.map_or(all, |sample| sample.frames(all));
    let sampled: Vec<&PathBuf> = spread(sampled, all).into_iter().map(|at| &photographs[at]).collect();
    // An audit changes to the folder of the recorded command.
    let sampled = sampled.into_iter().map(std::path::absolute).collect::<std::io::Result<Vec<_>>>()?;
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let lines: Vec<String> = unrecorded.iter().map(|picture| format!("{}: has no record", name(picture))).collect();
    let mut failures = unrecorded.len();
    print_list(&lines)?;
    for photograph in &sampled {
        print_line(&name(photograph))?;
        if let Err(error) = audit(args, photograph, None) {
            print_line(&message(&error))?;
            failures += 1;
        }
    }
    if failures > 0 {
        let photographs = count(sampled.len() + unrecorded.len(), "photograph");
        bail!("{}: {failures} of {photographs} not as recorded (listed above)", args.output.display());
    }
    Ok(())
}

fn audit(args: &Args, named: &Path, sample: Option<AuditSample>) -> Result<()> {
    let record = Record::read(named)?;
    if record.pictures.is_empty() || record.work.inputs.is_empty() {
        bail!("{}: lists no pictures or no inputs, so nothing can be compared", record_path(named).display());
    }
    // Paths in the record start at the folder of its command.
    let output = std::path::absolute(named)?;
    if let Err(error) = std::env::set_current_dir(&record.work.command.folder) {
        let folder = record.work.command.folder.display();
        warn(args.quiet, &format!("{folder}: {error}; the recorded paths are read from the current folder"));
    }
    let all: Vec<usize> = record.pictures.iter().map(|picture| picture.frame).collect();
    let frames: Vec<usize> = match sample {
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
    let outputs = changed_outputs(&record, &output, &frames);
    let is_output_recorded = outputs.is_empty();
    problems.extend(outputs);
    let arguments = std::iter::once("locard").chain(record.work.command.arguments.iter().map(String::as_str));
    let command = Cli::try_parse_from(arguments).ok().map(|cli| cli.command);
    if let Some(Command::Composite(command)) = &command {
        problems.extend(changed_masks(&record, &frames, |frame| command.mask_folder(frame))?);
    }
    print_list(&problems)?;
    if is_output_recorded {
        let all = record.pictures.len();
        let share = match record.output.kind {
            OutputKind::Frames => format!(", {} of {all} pictures", frames.len()),
            OutputKind::Video | OutputKind::Photograph => String::new(),
        };
        print_line(&format!("output: as it was written{share}"))?;
    }
    let recomputed = match &command {
        _ if args.files_only => Vec::new(),
        Some(Command::Composite(command)) => recompute::frames(command, &record, &output, &frames, args.quiet)?,
        Some(Command::Photo(command)) => vec![recompute::photograph(command, &record, &output)?],
        Some(Command::CaseCard(command)) => vec![recompute::card(command, &record, &output)?],
        _ => {
            let name = record.work.command.arguments.first().map_or("no command", String::as_str);
            print_line(&format!(
                "not recomputed: this program repeats `composite`, `photo` and `case-card`, the record has {name}"
            ))?;
            Vec::new()
        }
    };
    let is_equal = conclude(&record, &recomputed, args.within)?;
    if !problems.is_empty() {
        let files = count(problems.len(), "file") + if problems.len() == 1 { " is" } else { " are" };
        bail!("{}: {files} not as recorded (listed above)", named.display());
    }
    if !is_equal {
        bail!("{}: recomputed {}s differ from the recorded ones (listed above)", named.display(), noun(&record));
    }
    Ok(())
}

/// The first digits of a digest.
fn short(digest: &str) -> &str {
    digest.get(..12).unwrap_or("unknown")
}

/// Files of masks that are not the recorded ones. `folder` gives the folder of a frame's mask.
fn changed_masks<'a>(
    record: &Record,
    frames: &[usize],
    folder: impl Fn(usize) -> Option<&'a Path>,
) -> Result<Vec<ChangedFile>> {
    let sampled = record.pictures.iter().filter(|picture| frames.binary_search(&picture.frame).is_ok());
    let masked: Vec<_> = sampled.filter_map(|picture| Some((picture, folder(picture.frame)?))).collect();
    let Some((_, first)) = masked.first() else { return Ok(Vec::new()) };
    if !first.is_dir() {
        print_line(&format!("masks: the folder {} is not there, its files are not compared", first.display()))?;
        return Ok(Vec::new());
    }
    let change =
        |(picture, folder): &(&PictureRecord, &Path)| changed_mask(picture, &folder.join(mask_name(picture.frame)));
    let changes: Vec<ChangedFile> = masked.iter().filter_map(change).collect();
    print_line(&format!("masks: {} of {} files as recorded", masked.len() - changes.len(), masked.len()))?;
    Ok(changes)
}

/// The word for a picture of an output.
fn noun(record: &Record) -> &'static str {
    if record.output.kind == OutputKind::Photograph { "picture" } else { "frame" }
}

/// How a frame that is not equal differs.
fn comparison(frame: &RecomputedFrame) -> String {
    let codes = match &frame.outcome {
        RecomputedOutcome::Equal => "its codes are equal".to_owned(),
        RecomputedOutcome::Differs(difference) => format!("differs {difference}"),
        RecomputedOutcome::Unequal(why) => format!("not equal; {why}"),
    };
    let place = |bounds: Option<[i32; 4]>| match bounds {
        Some([left, top, right, bottom]) => format!("columns {left}..{right}, rows {top}..{bottom}"),
        None => "none".to_owned(),
    };
    let bounds = frame.other_bounds.map(|OtherBounds { recomputed, recorded }| {
        format!("; bounds {}, recorded {}", place(recomputed), place(recorded))
    });
    codes + &bounds.unwrap_or_default()
}

/// Prints the comparison. True if no recomputed picture differs by more than `within` code values.
/// Bounds and masks must be equal, unless differences are accepted.
fn conclude(record: &Record, recomputed: &[RecomputedFrame], within: u32) -> Result<bool> {
    if recomputed.is_empty() {
        return Ok(true);
    }
    let unequal: Vec<&RecomputedFrame> = recomputed.iter().filter(|frame| !frame.is_equal()).collect();
    let noun = noun(record);
    print_line(&format!(
        "{noun}s: {} of {} recomputed are equal to the record bit for bit",
        recomputed.len() - unequal.len(),
        recomputed.len()
    ))?;
    let name = |frame: usize| match record.output.kind {
        OutputKind::Photograph => noun.to_owned(),
        OutputKind::Frames | OutputKind::Video => format!("{noun} {frame}"),
    };
    let line = |frame: &&RecomputedFrame| format!("{}: {}", name(frame.frame), comparison(frame));
    print_list(&unequal.iter().map(line).collect::<Vec<_>>())?;
    let masks: Vec<(usize, usize)> =
        recomputed.iter().filter_map(|frame| Some((frame.frame, frame.mask_px?))).collect();
    let other_masks: Vec<String> = masks
        .iter()
        .filter(|(_, px)| *px > 0)
        .map(|(frame, px)| format!("{}: its mask differs in {}", name(*frame), count(*px, "pixel")))
        .collect();
    if !masks.is_empty() {
        print_line(&format!("masks: {} of {} recomputed are equal", masks.len() - other_masks.len(), masks.len()))?;
        print_list(&other_masks)?;
    }
    if !unequal.is_empty() {
        print_other_programs(record)?;
    }
    let codes = |frame: &&RecomputedFrame| match &frame.outcome {
        RecomputedOutcome::Equal => 0,
        RecomputedOutcome::Differs(by) => by.max_codes,
        RecomputedOutcome::Unequal(_) => u32::MAX,
    };
    let is_within = unequal.iter().map(codes).max().unwrap_or(0) <= within;
    Ok(is_within && (within > 0 || unequal.is_empty() && other_masks.is_empty()))
}

/// Prints the video programs whose versions differ from the recorded ones.
fn print_other_programs(record: &Record) -> Result<()> {
    if record.work.programs.is_empty() {
        return Ok(());
    }
    let installed = video_programs();
    for (name, recorded) in &record.work.programs {
        let version = installed.get(name).map_or("missing", String::as_str);
        if version != recorded {
            print_line(&format!(
                "another {name}: the output was made with \"{recorded}\", here it is \"{version}\"; it may decode \
                 video to other pixels"
            ))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comparison_of_a_frame_has_codes_and_other_bounds() {
        let other_bounds = Some(OtherBounds { recomputed: Some([126, 71, 320, 153]), recorded: None });
        let frame = |outcome| RecomputedFrame { frame: 4, outcome, other_bounds, mask_px: None };
        let bounds = "bounds columns 126..320, rows 71..153, recorded none";
        assert_eq!(comparison(&frame(RecomputedOutcome::Equal)), format!("its codes are equal; {bounds}"));
        let text = comparison(&frame(RecomputedOutcome::Unequal("no file".to_owned())));
        assert_eq!(text, format!("not equal; no file; {bounds}"));
    }

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
