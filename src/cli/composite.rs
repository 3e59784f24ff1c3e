//! `locard composite`.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};

use super::analysis::{self, AnalysisArgs};
use super::labels::{LabelArgs, MarkArgs};
use super::open::OpenArgs;
use super::which::Which;
use super::{export_error, print_status, progress, warn};
use locard_engine::compositor::{Compositor, Target};
use locard_engine::export::{Export, Inputs};
use locard_engine::gpu::Gpu;
use locard_engine::label::{DigitalSourceType, SourceLabel};
use locard_engine::recording::Recording;
use locard_engine::shot::{AnalysisChoice, Note, Shot, ShotOptions};
use locard_engine::sink::{self, OutPath, VideoCodec};
use locard_engine::text::count;

/// Codec of a video.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Codec {
    /// 8 bits, or 10 for high dynamic range
    H264,
    /// 10 bits
    Hevc,
    /// ProRes 422 HQ, 10 bits; into .mov or .mkv
    Prores,
}

impl Codec {
    fn codec(self) -> VideoCodec {
        match self {
            Self::H264 => VideoCodec::H264,
            Self::Hevc => VideoCodec::Hevc,
            Self::Prores => VideoCodec::ProRes,
        }
    }
}

#[derive(clap::Args)]
pub struct Args {
    /// Folder or file of the recording
    recording: PathBuf,
    /// A .glb or .gltf in the recording's world coordinates, or a scene.toml
    #[arg(long)]
    scene: PathBuf,
    /// The camera and the effects' parameters; without it, the recording's own
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Set a parameter, as in --set noise.scale=1.5; `locard params` lists them
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    sets: Vec<String>,
    #[command(flatten)]
    which: Which,
    /// Every effect, shadows and occlusion off; the camera's geometry stays on
    #[arg(long, conflicts_with_all = ["only", "without"])]
    plain: bool,
    /// Half-open range of frames, counted from 0, as in 40..50
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    frames: Option<(Option<usize>, Option<usize>)>,
    /// Seed of the noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Also write the virtual layer of each frame as OpenEXR into this folder
    #[arg(long, value_name = "DIR")]
    layers: Option<PathBuf>,
    /// Also write the mask of each frame as PNG into this folder: pixels of objects are red, shaded
    /// ones green
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    #[command(flatten)]
    mark: MarkArgs,
    #[command(flatten)]
    labels: LabelArgs,
    /// Write no record beside the output, by which `locard audit` recomputes it
    #[arg(long)]
    no_record: bool,
    /// Also write the findings and settings of each frame; - for stdout
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// A folder (PNG sequence), a .mp4, .mkv or .mov file, or - for raw RGB on stdout (a pipe or a
    /// device gets raw RGB too)
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    output: PathBuf,
    /// Keep every code value in a video
    #[arg(long)]
    lossless: bool,
    /// Codec of a video; .mov: prores, others: h264
    #[arg(long, value_enum, conflicts_with_all = ["lossless", "preview"])]
    codec: Option<Codec>,
    /// Divide an H.264 or HEVC video into closed groups of N frames at a constant quantiser, so
    /// that parts of whole groups join to the pictures of one run; the file becomes larger
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000), conflicts_with = "preview")]
    closed_groups: Option<u32>,
    /// Convert footage of high dynamic range, or on a logarithmic curve, to standard dynamic range
    #[arg(long, conflicts_with = "preview")]
    sdr: bool,
    /// Leave the sound of the recording's video out of a video
    #[arg(long, conflicts_with = "preview")]
    no_sound: bool,
    /// Write this frame alone, as a .png or .jpg, with the outlines and names of the objects and
    /// the axes of the world
    #[arg(long, value_name = "N", conflicts_with_all = ["frames", "layers", "masks", "mark", "report", "lossless", "strict"], value_parser = super::frame_number)]
    preview: Option<usize>,
    /// Replace output that exists
    #[arg(long)]
    force: bool,
    /// A frame without a pose is an error
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    open: OpenArgs,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

impl Args {
    /// Folder of the mask of a frame, if the command writes it.
    pub fn mask_folder(&self, frame: usize) -> Option<&Path> {
        let (start, end) = self.frames.unwrap_or_default();
        let is_made = start.is_none_or(|start| start <= frame) && end.is_none_or(|end| frame < end);
        self.masks.as_deref().filter(|_| is_made)
    }
}

/// `A..B`; either end may be left out.
pub fn parse_range(text: &str) -> Result<(Option<usize>, Option<usize>), String> {
    let wrong = || format!("{text} is not a range; expected A..B, as in 40..50");
    let (a, b) = text.split_once("..").ok_or_else(wrong)?;
    let end = |t: &str| if t.is_empty() { Ok(None) } else { t.parse().map(Some).map_err(|_| wrong()) };
    Ok((end(a)?, end(b)?))
}

/// The requested frames, checked against the available ones.
pub fn frame_range(requested: Option<(Option<usize>, Option<usize>)>, count: usize) -> Result<Range<usize>> {
    let (a, b) = requested.unwrap_or_default();
    if let (Some(a), Some(b)) = (a, b)
        && a >= b
    {
        bail!("--frames {a}..{b}: the range is empty; its end is exclusive and must be above its start");
    }
    let range = a.unwrap_or(0)..b.unwrap_or(count);
    if range.start >= range.end || range.end > count {
        bail!(
            "--frames {}..{}: expected a range within 0..{count}, because there are {count} frames",
            range.start,
            range.end
        );
    }
    Ok(range)
}

pub fn run(args: Args) -> Result<()> {
    let start = Instant::now();
    let shot_options = shot_options(&args, args.analysis.choice());
    let recording = Recording::open(&args.recording, &args.open.options())?;
    let quiet = args.quiet;
    let (mut shot, (range, export)) = args.analysis.open(recording, &shot_options, quiet, |shot| {
        let (range, export) = apply_options(&args, shot)?;
        check_outputs(&args, shot, export.as_ref())?;
        Ok((range, export))
    })?;
    args.labels.warn(DigitalSourceType::CompositeWithSyntheticElements, args.mark.trace());
    // After the analysis, which may add poses.
    if args.strict {
        shot.check_poses(range.clone())?;
    }
    for note in shot.notes(range.clone()).into_iter().chain(shot.support_gap_notes(range.clone())) {
        warn(quiet, &note.to_string());
    }
    analysis::print_hints(quiet, &shot, args.which.leaves_registration());
    let mut compositor = shot.compositor(Gpu::open()?);
    for text in compositor.warnings() {
        warn(quiet, &text);
    }
    let Some(export) = export else {
        return preview(&args, &mut shot, &mut compositor, range.start);
    };
    let bar = progress(quiet, range.len());
    let done = export.run(&shot, &mut compositor, |_| {
        bar.inc(1);
        true
    });
    bar.finish_and_clear();
    let done = done.map_err(export_error);
    if let (Err(error), OutPath::Stdout, Some(report)) = (&done, &export.out, &export.report)
        && super::is_closed_stdout(error)
    {
        bail!("{}: was not written, because the reader closed the pipe before the last frame", report.display());
    }
    let done = done?;
    for note in done.notes() {
        warn(quiet, &note.to_string());
    }
    let place =
        if export.out == OutPath::Stdout { "standard output".to_owned() } else { args.output.display().to_string() };
    print_status(
        quiet,
        &format!("{} in {:.1} s: {place}", count(done.frames(), "frame"), start.elapsed().as_secs_f64()),
    );
    Ok(())
}

fn shot_options(args: &Args, analysis: AnalysisChoice) -> ShotOptions {
    ShotOptions {
        profile: args.profile.clone(),
        sets: args.sets.clone(),
        scene: Some(args.scene.clone()),
        analysis,
        recorded_poses: args.which.leaves_registration(),
        ..ShotOptions::default()
    }
}

/// The shot and the export of a command that was run before, with a given analysis. Its outputs are
/// not checked.
pub fn reopen(args: &Args, analysis: AnalysisChoice) -> Result<(Shot, Export)> {
    let recording = Recording::open(&args.recording, &args.open.options())?;
    let mut shot = Shot::of(recording, &shot_options(args, analysis))?;
    match apply_options(args, &mut shot)? {
        (_, Some(export)) => Ok((shot, export)),
        (_, None) => bail!("it made a preview of one frame"),
    }
}

/// Fails if an output cannot be written, or would replace something that is kept.
fn check_outputs(args: &Args, shot: &Shot, export: Option<&Export>) -> Result<()> {
    let inputs = Inputs::of(shot);
    match export {
        Some(export) => export.check(&inputs).map_err(export_error),
        None => {
            inputs.check_file(&args.output)?;
            Ok(sink::photograph::check(&args.output, args.force)?)
        }
    }
}

/// Applies the options to the shot, and fails on invalid frames and settings. Returns the frames,
/// and the export unless it is a preview.
fn apply_options(args: &Args, shot: &mut Shot) -> Result<(Range<usize>, Option<Export>)> {
    if let Some(frame) = args.preview {
        super::check_frame(frame, shot.recording.frame_count())?;
    }
    let requested = args.preview.map_or(args.frames, |frame| Some((Some(frame), Some(frame + 1))));
    let range = frame_range(requested, shot.recording.frame_count())?;
    shot.settings.seed = args.seed;
    args.which.apply(&mut shot.settings)?;
    if args.plain {
        shot.settings.plain();
    }
    shot.check(range.clone())?;
    let Args { lossless, force, .. } = *args;
    if args.preview.is_some() {
        return Ok((range, None));
    }
    let out = OutPath::parse(&args.output)?;
    let export = Export {
        range: range.clone(),
        out,
        lossless,
        codec: args.codec.map(Codec::codec),
        closed_groups: args.closed_groups,
        sdr: args.sdr,
        sound: !args.no_sound,
        force,
        layers: args.layers.clone(),
        masks: args.masks.clone(),
        report: args.report.clone(),
        labelled: args.labels.is_labelled(),
        mark: args.mark.mark.clone(),
        recorded: !args.no_record,
    };
    Ok((range, Some(export)))
}

/// Writes one frame with annotations about its objects.
fn preview(args: &Args, shot: &mut Shot, compositor: &mut Compositor, frame: usize) -> Result<()> {
    let pending = shot.picture(compositor, frame, Target::Pixels)?;
    let done = compositor.collect(pending).with_context(|| format!("frame {frame}"))?;
    for note in Note::of_frames(std::slice::from_ref(&done.stats)) {
        warn(args.quiet, &note.to_string());
    }
    let annotated = shot.annotated(frame, &done.pixels)?;
    let label = args.labels.is_labelled().then(|| SourceLabel::composite(&shot.recording.path).of_frame(frame));
    sink::photograph::write(&args.output, &annotated, None, label.as_ref(), args.force)?;
    print_status(args.quiet, &format!("frame {frame}, annotated: {}", args.output.display()));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_ranges_are_parsed_and_checked() {
        assert_eq!(parse_range("40..50"), Ok((Some(40), Some(50))));
        assert_eq!(parse_range("..5"), Ok((None, Some(5))));
        assert!(parse_range("4-5").is_err() && parse_range("a..b").is_err());
        assert_eq!(frame_range(Some((Some(3), None)), 9).unwrap(), 3..9);
        assert!(frame_range(Some((Some(3), Some(10))), 9).unwrap_err().to_string().contains("0..9"));
        for empty in [(3, 3), (50, 40)] {
            let text = frame_range(Some((Some(empty.0), Some(empty.1))), 9).unwrap_err().to_string();
            assert!(text.contains("the range is empty"), "{text}");
        }
        let text = frame_range(Some((Some(9), None)), 9).unwrap_err().to_string();
        assert!(text.contains("--frames 9..9: expected a range within 0..9"), "{text}");
    }
}
