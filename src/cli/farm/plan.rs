//! `locard farm template`.

use std::ffi::OsString;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Parser;
use clap::builder::PossibleValuesParser;

use super::super::analysis::AnalysisArgs;
use super::super::composite::{self, frame_range, parse_range};
use super::super::open::OpenArgs;
use super::super::{print_status, warn};
use super::machine::adapter_kind;
use super::part::composite_arguments;
use locard_engine::analyse::default_folder;
use locard_engine::farm::{ADAPTER_KINDS, FarmJob, FarmPlan, PartCost};
use locard_engine::gpu::Gpu;
use locard_engine::program;
use locard_engine::provenance::ProgramRecord;
use locard_engine::recording::Recording;
use locard_engine::shot::AnalysisChoice;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::sink::{self, OutPath};
use locard_engine::text::{count, number};

/// Frames of a timed run.
const SAMPLE_FRAMES: usize = 4;
/// Places of timed runs, as shares of the range.
const SAMPLE_PLACES: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

#[derive(clap::Args)]
pub struct TemplateArgs {
    /// Folder or file of the recording
    recording: PathBuf,
    /// A .glb or .gltf in the recording's world coordinates, or a scene.toml
    #[arg(long)]
    scene: PathBuf,
    /// The camera and the effects' parameters; without it, the recording's own
    #[arg(long)]
    profile: Option<PathBuf>,
    /// A folder for the templates, scripts and parts
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
    /// The joined output: a folder, or a .mp4, .mkv or .mov file; by default the folder `joined` in
    /// the folder of the templates
    #[arg(long, value_name = "OUT")]
    joined: Option<PathBuf>,
    /// Half-open range of frames, counted from 0, as in 40..50
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    frames: Option<(Option<usize>, Option<usize>)>,
    /// Number of parts; by default it follows from --part-seconds
    #[arg(long, value_name = "N", conflicts_with = "part_seconds")]
    parts: Option<usize>,
    /// Duration of a part, by the measured cost of a few frames on this machine, s
    #[arg(long, value_name = "S", default_value_t = 600.0, value_parser = duration)]
    part_seconds: f64,
    /// Kind of adapter that all machines must have, as in DiscreteGpu, or any; by default this
    /// machine's
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(ADAPTER_KINDS.into_iter().chain(["any"])))]
    adapter_kind: Option<String>,
    /// The program on the machines: a name in their PATH, or a path
    #[arg(long, value_name = "LOCARD", default_value = "locard")]
    program: String,
    /// Replace the files of an earlier plan
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    open: OpenArgs,
    /// No closing line, no warnings
    #[arg(long, short)]
    quiet: bool,
    /// Further options of `locard composite`, after --
    #[arg(last = true, value_name = "COMPOSITE")]
    options: Vec<String>,
}

/// Parses the arguments of a part, to refuse invalid ones before the job starts.
#[derive(Parser)]
#[command(name = "composite")]
struct CompositeLine {
    #[command(flatten)]
    _args: composite::Args,
}

fn duration(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok().filter(|seconds: &f64| (1.0..=1e6).contains(seconds));
    value.ok_or_else(|| "expected seconds, from 1 to 1000000".to_owned())
}

pub fn run(args: &TemplateArgs) -> Result<()> {
    let recording = Recording::open(&args.recording, &args.open.options())?;
    let frames = frame_range(args.frames, recording.frame_count())?;
    locard_engine::scene::load(&args.scene, recording.up)?;
    let folder = absolute(&args.output)?;
    let joined = absolute(args.joined.as_deref().unwrap_or(&folder.join("joined")))?;
    let extension = extension_of(&joined)?;
    let analysis = match args.analysis.choice() {
        AnalysisChoice::At(folder) => Some(absolute(&folder)?),
        AnalysisChoice::No => None,
        _ => Some(default_folder(&recording.path)).filter(|folder| args.analysis.makes_analysis() || folder.is_dir()),
    };
    let kind = match args.adapter_kind.as_deref() {
        Some("any") => None,
        Some(kind) => Some(kind.to_owned()),
        None => Some(adapter_kind(&Gpu::open()?)),
    };
    let mut options = args.open.words();
    let mut analysis_options: Vec<String> =
        options.iter().filter(|word| !word.starts_with("--time-offset")).cloned().collect();
    analysis_options.push("--quiet".to_owned());
    options.extend_from_slice(&args.options);
    if extension.is_some() && !options.iter().any(|word| word == "--no-sound") {
        options.push("--no-sound".to_owned());
    }
    let mut job = FarmJob {
        name: recording.name.clone(),
        plan: FarmPlan::new(frames.clone(), 1, 1)?,
        program: args.program.clone(),
        build: ProgramRecord::current().build,
        adapter_kind: kind,
        recording: absolute(&args.recording)?,
        scene: absolute(&args.scene)?,
        profile: args.profile.as_deref().map(absolute).transpose()?,
        analysis,
        analyses: args.analysis.makes_analysis(),
        analysis_options,
        options,
        parts_folder: folder.join("parts"),
        extension,
        sound: !args.options.iter().any(|word| word == "--no-sound"),
        out: joined,
        cost: None,
    };
    check_options(&job)?;
    if args.parts.is_none() && frames.len() > 1 {
        warn(
            args.quiet,
            "timing five runs of up to four frames, to divide the range by --part-seconds (--parts N skips this)",
        );
        let cost = measured_cost(&job, &frames)?;
        if 2.0 * cost.startup_s > args.part_seconds {
            let text = format!(
                "the program takes {:.1} s to start, over half of --part-seconds {}: give longer parts",
                cost.startup_s,
                number(args.part_seconds)
            );
            warn(args.quiet, &text);
        }
        job.cost = Some(cost);
    }
    let group = closed_groups(&args.options);
    let parts = args.parts.or(job.cost.map(|cost| cost.parts(frames.len(), args.part_seconds))).unwrap_or(1);
    job.plan = FarmPlan::new(frames, parts, group.unwrap_or(1))?;
    job.parts_folder = folder.join(format!("parts-{}", job.plan.parts.len()));
    if let Some(parts) = args.parts.filter(|parts| *parts > job.plan.parts.len()) {
        warn(args.quiet, &format!("--parts {parts}: the range divides into {}", job.plan.summary()));
    }
    if is_inter_coded(&job, &args.options) && group.is_none() {
        let text = "the joined video will have the pictures of its parts, which differ from those of one run: rate control \
                    looks across frames; -- --closed-groups 30 makes them equal, and so do --lossless and ProRes";
        warn(args.quiet, text);
    }
    write(&job, &folder, args)
}

/// Extension of a joined video; `None` for a folder.
fn extension_of(joined: &Path) -> Result<Option<String>> {
    match OutPath::parse(joined)? {
        OutPath::Folder(_) => Ok(None),
        OutPath::Video(path) => Ok(path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase())),
        OutPath::Stdout | OutPath::Stream(_) => {
            bail!("--joined {}: expected a folder or a video file", joined.display())
        }
    }
}

fn absolute(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).with_context(|| format!("{}: has no absolute path", path.display()))
}

/// The recording and options of `locard composite` for all parts, with or without the analysis.
fn composite_words(job: &FarmJob, with_analysis: bool) -> Vec<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let mut words = vec![text(&job.recording), "--scene".to_owned(), text(&job.scene)];
    if let Some(profile) = &job.profile {
        words.extend(["--profile".to_owned(), text(profile)]);
    }
    match job.analysis.as_ref().filter(|_| with_analysis) {
        Some(analysis) => words.extend(["--analysis".to_owned(), text(analysis)]),
        None => words.push("--no-analysis".to_owned()),
    }
    words.extend_from_slice(&job.options);
    words
}

/// Rejects options that make parts overwrite one file, or that prevent joining.
fn check_fit_for_parts(options: &[String]) -> Result<()> {
    let per_run = ["--layers", "--masks", "--report"];
    if let Some(word) = options.iter().find(|word| per_run.iter().any(|option| word.starts_with(option))) {
        bail!("{word}: is one file or folder for a whole run, which parts would overwrite; leave it out");
    }
    if options.iter().any(|word| word == "--no-record") {
        bail!("--no-record: parts are checked and joined by their records; leave it out");
    }
    Ok(())
}

/// Refuses options that parts cannot have, and those that `locard composite` does not.
fn check_options(job: &FarmJob) -> Result<()> {
    check_fit_for_parts(&job.options)?;
    let words = composite_words(job, true);
    let line = composite_arguments(&words, &(0..1), "part");
    if let Err(error) = CompositeLine::try_parse_from(line) {
        let text = error.to_string();
        let first = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
        bail!(
            "the options after --: {first}; `locard composite --help` lists them, and the template sets recording, \
               scene, frames and output"
        );
    }
    Ok(())
}

/// Value of `--closed-groups`.
fn closed_groups(options: &[String]) -> Option<usize> {
    const OPTION: &str = "--closed-groups";
    let inline = options.iter().find_map(|word| word.strip_prefix(OPTION)?.strip_prefix('='));
    let next = options.iter().position(|word| word == OPTION).and_then(|at| options.get(at + 1));
    inline.or(next.map(String::as_str))?.parse().ok()
}

/// True for a video with a codec that predicts between frames.
fn is_inter_coded(job: &FarmJob, options: &[String]) -> bool {
    let is_prores = options.iter().any(|word| word.ends_with("prores"));
    let names_codec = options.iter().any(|word| word.starts_with("--codec"));
    let is_lossless = options.iter().any(|word| word == "--lossless");
    let by_extension = job.extension.as_deref() == Some("mov") && !names_codec;
    job.extension.is_some() && !is_lossless && !is_prores && !by_extension
}

/// Composites a few frames in several places and times them. The range has at least two frames.
fn measured_cost(job: &FarmJob, frames: &Range<usize>) -> Result<PartCost> {
    let temp = tempfile::tempdir().context("a folder for timed frames")?;
    let has_analysis = job.analysis.as_ref().is_some_and(|folder| folder.is_dir());
    let words = composite_words(job, has_analysis);
    let program = std::env::current_exe().context("this program's file")?;
    let run_s = |frames: Range<usize>, name: &str| -> Result<f64> {
        let ending = job.extension.as_ref().map_or(String::new(), |extension| format!(".{extension}"));
        let output = temp.path().join(format!("{name}{ending}"));
        let arguments = composite_arguments(&words, &frames, &output.to_string_lossy());
        let arguments: Vec<OsString> = arguments.into_iter().map(OsString::from).collect();
        let start = Instant::now();
        program::output(&program.to_string_lossy(), &arguments)?;
        Ok(start.elapsed().as_secs_f64())
    };
    let at = |place: f64, length: usize| {
        let latest = frames.end.saturating_sub(length).max(frames.start);
        let start = (frames.start + (place * frames.len() as f64) as usize).min(latest);
        start..(start + length).min(frames.end)
    };
    // The first run fills caches of shaders and files.
    run_s(at(0.5, 1), "warm")?;
    let one_frame_s = run_s(at(0.5, 1), "one")?;
    let length = SAMPLE_FRAMES.min(frames.len());
    let runs_s: Vec<f64> = SAMPLE_PLACES
        .iter()
        .enumerate()
        .map(|(i, &place)| run_s(at(place, length), &i.to_string()))
        .collect::<Result<_>>()?;
    PartCost::of_samples(one_frame_s, length, &runs_s).context(
        "the timed runs show no cost of a frame: those of several frames took no longer than that of one; give --parts",
    )
}

/// Writes the files of the job.
fn write(job: &FarmJob, folder: &Path, args: &TemplateArgs) -> Result<()> {
    let files = job.files()?;
    for (name, _) in &files {
        sink::check_file(&folder.join(name), args.force)?;
    }
    for (name, text) in &files {
        write_atomically(&folder.join(name), args.force, |file| file.write_all(text.as_bytes()))?;
    }
    let plan = &job.plan;
    let cost = job
        .cost
        .map_or(String::new(), |cost| format!(", about {} s each", number(cost.of_part_s(plan.longest()).round())));
    let text = format!(
        "{} in {}{cost}: {}",
        count(plan.frames.len(), "frame"),
        plan.summary(),
        folder.join("README.txt").display()
    );
    print_status(args.quiet, &text);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_whole_runs_and_parts_without_records_are_refused() {
        for (word, expected) in [
            ("--layers=l", "which parts would overwrite"),
            ("--masks", "which parts would overwrite"),
            ("--report", "which parts would overwrite"),
            ("--no-record", "joined by their records"),
        ] {
            let error = check_fit_for_parts(&["--plain".to_owned(), word.to_owned()]).unwrap_err().to_string();
            assert!(error.starts_with(word) && error.contains(expected), "{error}");
        }
        check_fit_for_parts(&["--lossless".to_owned()]).unwrap();
    }

    #[test]
    fn closed_groups_are_read_in_both_forms() {
        let options = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        assert_eq!(closed_groups(&options(&["--closed-groups", "30"])), Some(30));
        assert_eq!(closed_groups(&options(&["--plain", "--closed-groups=12"])), Some(12));
        assert_eq!(closed_groups(&options(&["--plain"])), None);
    }
}
