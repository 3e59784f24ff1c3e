//! `locard composite`.

use std::collections::HashSet;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Instant;

use anyhow::{Context, Result, bail};

use super::outputs::{self, Inputs};
use super::which::Which;
use super::{progress, tell, warn};
use crate::compositor::{Composited, Compositor, FrameStats, IN_FLIGHT, Target};
use crate::gpu::Gpu;
use crate::recording::OpenOptions;
use crate::shot::{Composites, Given, Note, Shot};
use crate::sink::atomic::write_atomically;
use crate::sink::{self, OutPath, SinkOptions, is_stdout};
use crate::unfinished::MadeFolder;
use crate::words::count;

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
    /// Every effect and occlusion off; the camera's geometry stays on
    #[arg(long, conflicts_with_all = ["only", "without"])]
    plain: bool,
    /// Half-open range of frames, counted from 0, as in 40..50
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    frames: Option<(Option<usize>, Option<usize>)>,
    /// Seed of the noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Also write one OpenEXR a frame with the virtual layer into this folder
    #[arg(long, value_name = "DIR")]
    layers: Option<PathBuf>,
    /// Also write what was found and done for each frame; - for stdout
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// A folder (PNG sequence), a .mp4 or .mkv file, or - for raw RGB on stdout (a pipe or a device gets raw RGB too)
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    output: PathBuf,
    /// Keep every code value in a video
    #[arg(long)]
    lossless: bool,
    /// Write this frame alone, as a .png or .jpg, with the objects' outlines and names and the world's axes where they stand
    #[arg(long, value_name = "N", conflicts_with_all = ["frames", "layers", "report", "lossless", "strict"], value_parser = super::frame_number)]
    preview: Option<usize>,
    /// Replace output that exists
    #[arg(long)]
    force: bool,
    /// A frame without a pose is an error
    #[arg(long)]
    strict: bool,
    /// Length of a nerfstudio or COLMAP unit
    #[arg(long, default_value_t = 1.0, value_name = "M")]
    metres_per_unit: f64,
    /// Added to frame times when poses are looked up
    #[arg(long, default_value_t = 0.0, value_name = "S", allow_negative_numbers = true)]
    time_offset_s: f64,
    /// No progress bar, no warnings
    #[arg(long, short)]
    quiet: bool,
}

/// `A..B`; either end may be left out.
pub fn parse_range(text: &str) -> Result<(Option<usize>, Option<usize>), String> {
    let wrong = || format!("{text} is not a range; expected A..B, as in 40..50");
    let (a, b) = text.split_once("..").ok_or_else(wrong)?;
    let end = |t: &str| if t.is_empty() { Ok(None) } else { t.parse().map(Some).map_err(|_| wrong()) };
    Ok((end(a)?, end(b)?))
}

/// The requested frames, checked against the available ones.
pub fn frame_range(asked: Option<(Option<usize>, Option<usize>)>, count: usize) -> Result<Range<usize>> {
    let (a, b) = asked.unwrap_or_default();
    if let (Some(a), Some(b)) = (a, b)
        && a >= b
    {
        bail!("--frames {a}..{b}: there is no frame in it; the end, which is not part of it, must be above the start");
    }
    let range = a.unwrap_or(0)..b.unwrap_or(count);
    if range.start >= range.end || range.end > count {
        bail!(
            "--frames {}..{}: accepted is what lies within 0..{count}, for there are {count} frames",
            range.start,
            range.end
        );
    }
    Ok(range)
}

/// Receives frames while the next ones are drawn.
struct Writer {
    /// Made after the sink's folder, which may hold it, and removed before.
    layers: Option<(PathBuf, MadeFolder)>,
    sink: Box<dyn sink::Sink + Send>,
    force: bool,
}

impl Writer {
    fn write(&mut self, done: &Composited) -> Result<()> {
        if let (Some((folder, _)), Some(layer)) = (&self.layers, &done.layer) {
            sink::exr::write_layers(&folder.join(layer_name(done.frame)), layer, self.force)?;
        }
        Ok(self.sink.write(done.frame, &done.pixels)?)
    }

    fn finish(self) -> Result<()> {
        self.sink.finish()?;
        self.layers.into_iter().for_each(|(_, made)| made.keep());
        Ok(())
    }
}

fn layer_name(frame: usize) -> String {
    format!("layer_{frame:06}.exr")
}

pub fn run(args: Args) -> Result<()> {
    let start = Instant::now();
    let options = OpenOptions {
        metres_per_unit: args.metres_per_unit,
        time_offset_s: args.time_offset_s,
        ..OpenOptions::default()
    };
    let given = Given { profile: args.profile.clone(), sets: args.sets.clone(), scene: Some(args.scene.clone()) };
    let mut shot = Shot::open(&args.recording, &options, &given)?;
    if let Some(frame) = args.preview {
        super::check_frame(frame, shot.recording.frame_count())?;
    }
    let asked = args.preview.map_or(args.frames, |frame| Some((Some(frame), Some(frame + 1))));
    let range = frame_range(asked, shot.recording.frame_count())?;
    shot.settings.seed = args.seed;
    args.which.apply(&mut shot.settings)?;
    if args.plain {
        shot.settings.plain();
    }
    shot.check(range.clone())?;
    if args.strict {
        shot.check_poses(range.clone())?;
    }
    let inputs = Inputs::of(&shot);
    let out = match args.preview {
        Some(_) => {
            inputs.check_file(&args.output)?;
            sink::photograph::check(&args.output, args.force)?;
            None
        }
        None => {
            let out = OutPath::parse(&args.output)?;
            check_outputs(&args, &out, &inputs, &range)?;
            Some(out)
        }
    };
    for note in shot.notes(range.clone()).into_iter().chain(shot.standing_notes(range.clone())) {
        warn(args.quiet, &note.to_string());
    }
    let mut compositor = shot.compositor(Gpu::open()?);
    for text in compositor.warnings() {
        warn(args.quiet, &text);
    }
    let Some(out) = out else {
        return preview(&args, &mut shot, &mut compositor, range.start);
    };
    let recording = &shot.recording;
    let sink = sink::open(
        &out,
        &SinkOptions {
            force: args.force,
            fps: 1.0 / recording.frame_interval_s,
            lossless: args.lossless,
            width: recording.width,
            height: recording.height,
            bits: recording.bits,
        },
    )?;
    let layers = args.layers.clone().map(|folder| {
        let made = MadeFolder::make(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        anyhow::Ok((folder, made))
    });
    let layers = layers.transpose()?;
    let bar = progress(args.quiet, range.len());
    let mut stats: Vec<FrameStats> = Vec::with_capacity(range.len());
    let adapter = compositor.gpu().info.clone();
    let writer = Writer { sink, layers, force: args.force };
    let frames = shot.frames(&mut compositor, range, writer.layers.is_some(), IN_FLIGHT)?;
    let written = write(frames, writer, |done| {
        bar.inc(1);
        stats.push(done.stats.clone());
    });
    bar.finish_and_clear();
    written?;
    for note in Note::of_frames(&stats) {
        warn(args.quiet, &note.to_string());
    }

    if let Some(path) = &args.report {
        let report = serde_json::json!({
            "adapter": adapter.name,
            "driver": format!("{} {}", adapter.driver, adapter.driver_info),
            "seed": args.seed,
            "frames": stats,
        });
        let text = serde_json::to_string_pretty(&report)?;
        if is_stdout(path) {
            writeln!(std::io::stdout().lock(), "{text}")?;
        } else {
            write_atomically(path, args.force, |file| file.write_all(text.as_bytes()))?;
        }
    }
    let place = if out == OutPath::Stdout { "standard output".to_owned() } else { args.output.display().to_string() };
    tell(args.quiet, &format!("{} in {:.1} s: {place}", count(stats.len(), "frame"), start.elapsed().as_secs_f64()));
    Ok(())
}

/// Writes one frame with what a person wants to know about its objects.
fn preview(args: &Args, shot: &mut Shot, compositor: &mut Compositor, frame: usize) -> Result<()> {
    let pending = shot.picture(compositor, frame, Target::Pixels)?;
    let done = compositor.collect(pending).with_context(|| format!("frame {frame}"))?;
    for note in Note::of_frames(std::slice::from_ref(&done.stats)) {
        warn(args.quiet, &note.to_string());
    }
    let annotated = shot.annotated(frame, &done.pixels)?;
    sink::photograph::write(&args.output, &annotated, None, args.force)?;
    tell(args.quiet, &format!("frame {frame}, annotated: {}", args.output.display()));
    Ok(())
}

/// Checks that all outputs can be written, before any is begun.
fn check_outputs(args: &Args, out: &OutPath, inputs: &Inputs, range: &Range<usize>) -> Result<()> {
    match out {
        OutPath::Folder(folder) => inputs.check_folder(folder, range.clone().map(sink::folder::frame_name))?,
        OutPath::Video(file) => inputs.check_file(file)?,
        OutPath::Stdout | OutPath::Stream(_) => {}
    }
    sink::check(out, args.force)?;
    if let Some(folder) = &args.layers {
        inputs.check_folder(folder, range.clone().map(layer_name))?;
        if folder.exists() && !folder.is_dir() {
            bail!("{}: is a file; --layers needs a folder", folder.display());
        }
        let mut there = range.clone().map(|frame| folder.join(layer_name(frame))).filter(|file| file.exists());
        if let Some(file) = there.next().filter(|_| !args.force) {
            bail!("{}: exists already; it is kept unless --force is given", file.display());
        }
    }
    let Some(report) = &args.report else { return check_apart(args, out, range) };
    if is_stdout(report) && *out == OutPath::Stdout {
        bail!("{}: is the output already; --report needs a file of its own", report.display());
    }
    check_apart(args, out, range)?;
    if is_stdout(report) {
        return Ok(());
    }
    inputs.check_file(report)?;
    let folder = report.parent().unwrap_or(Path::new(""));
    // The folders of the other outputs are created before the report is written.
    let made = matches!(out, OutPath::Folder(out) if outputs::same(out, folder))
        || args.layers.as_ref().is_some_and(|layers| outputs::same(layers, folder));
    if made && !folder.is_dir() { Ok(()) } else { Ok(sink::check_file(report, args.force)?) }
}

/// Checks that no two written files have the same name, and that none has the name of another's folder.
fn check_apart(args: &Args, out: &OutPath, range: &Range<usize>) -> Result<()> {
    let named = |folder: &Path, name: fn(usize) -> String| {
        let folder = outputs::resolved(folder);
        range.clone().map(move |frame| outputs::resolved(&folder.join(name(frame))))
    };
    let mut files: HashSet<PathBuf> = match out {
        OutPath::Folder(folder) => named(folder, sink::folder::frame_name).collect(),
        OutPath::Video(file) => [outputs::resolved(file)].into(),
        OutPath::Stdout | OutPath::Stream(_) => HashSet::new(),
    };
    let clashes = |files: &HashSet<PathBuf>, at: &Path| at.ancestors().any(|at| files.contains(at));
    if let Some(folder) = &args.layers {
        if clashes(&files, &outputs::resolved(folder)) {
            bail!("{}: is written in this run already; --layers needs a folder of its own", folder.display());
        }
        files.extend(named(folder, layer_name));
    }
    if let Some(report) = args.report.as_ref().filter(|report| !is_stdout(report)) {
        let at = outputs::resolved(report);
        if clashes(&files, &at) || files.iter().any(|file| file.starts_with(&at)) {
            bail!("{}: is the output already; --report needs a file of its own", report.display());
        }
    }
    Ok(())
}

/// Decodes on the recording's threads, draws here, and writes on a thread of its own.
fn write(mut frames: Composites<'_>, mut writer: Writer, mut done: impl FnMut(&Composited)) -> Result<()> {
    std::thread::scope(|scope| {
        // The end is announced: if the frames merely stop, the writer must not report the output as finished.
        let (sender, receiver) = mpsc::sync_channel::<Option<Composited>>(2);
        let write = move || -> Result<()> {
            for frame in receiver {
                match frame {
                    Some(frame) => writer.write(&frame)?,
                    None => return writer.finish(),
                }
            }
            Ok(())
        };
        let writing = std::thread::Builder::new().name("writer".to_owned());
        let writing = writing.spawn_scoped(scope, write).context("no thread can be started that writes")?;
        let stopped = || anyhow::anyhow!("the writing thread stopped early");
        let drawn = frames.try_for_each(|frame| {
            let frame = frame?;
            done(&frame);
            sender.send(Some(frame)).map_err(|_| stopped())
        });
        let finished = drawn.and_then(|()| sender.send(None).map_err(|_| stopped()));
        drop(sender);
        // The writer's error comes first: it is why the frames stopped.
        writing.join().map_err(|_| anyhow::anyhow!("the writing thread failed"))?.and(finished)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges() {
        assert_eq!(parse_range("40..50"), Ok((Some(40), Some(50))));
        assert_eq!(parse_range("..5"), Ok((None, Some(5))));
        assert!(parse_range("4-5").is_err() && parse_range("a..b").is_err());
        assert_eq!(frame_range(Some((Some(3), None)), 9).unwrap(), 3..9);
        assert!(frame_range(Some((Some(3), Some(10))), 9).unwrap_err().to_string().contains("0..9"));
        for empty in [(3, 3), (50, 40)] {
            let text = frame_range(Some((Some(empty.0), Some(empty.1))), 9).unwrap_err().to_string();
            assert!(text.contains("there is no frame in it"), "{text}");
        }
        let text = frame_range(Some((Some(9), None)), 9).unwrap_err().to_string();
        assert!(text.contains("--frames 9..9: accepted is what lies within 0..9"), "{text}");
    }
}
