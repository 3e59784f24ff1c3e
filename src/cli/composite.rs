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
use super::{NOTHING_SEEN, progress, tell, warn};
use crate::camera::{Geometry, Intrinsics};
use crate::compositor::{Composited, Compositor, FrameStats, Settings, Stream};
use crate::gpu::Gpu;
use crate::params::{Params, Value};
use crate::profile::Rig;
use crate::recording::{OpenOptions, Recording};
use crate::sink::atomic::write_atomically;
use crate::sink::{self, OutPath, SinkOptions};
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
    /// A folder (PNG sequence), a .mp4 or .mkv file, or - for raw RGB on stdout
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    output: PathBuf,
    /// Keep every code value in a video
    #[arg(long)]
    lossless: bool,
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

/// `A..B`, either end may be left out.
pub fn parse_range(text: &str) -> Result<(Option<usize>, Option<usize>), String> {
    let wrong = || format!("{text} is not a range; expected A..B, as in 40..50");
    let (a, b) = text.split_once("..").ok_or_else(wrong)?;
    let end = |t: &str| if t.is_empty() { Ok(None) } else { t.parse().map(Some).map_err(|_| wrong()) };
    Ok((end(a)?, end(b)?))
}

/// The frames asked for, checked against those there are.
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

/// What frames are handed to while the next ones are drawn.
struct Writer {
    sink: Box<dyn sink::Sink + Send>,
    layers: Option<PathBuf>,
    force: bool,
}

impl Writer {
    fn write(&mut self, done: &Composited) -> Result<()> {
        if let (Some(folder), Some(layer)) = (&self.layers, &done.layer) {
            sink::exr::write_layers(&folder.join(layer_name(done.frame)), layer, self.force)?;
        }
        Ok(self.sink.write(done.frame, &done.pixels)?)
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
    let recording = Recording::open(&args.recording, &options)?;
    let range = frame_range(args.frames, recording.frame_count())?;
    let out = OutPath::parse(&args.output)?;

    let mut settings = Settings::default();
    settings.seed = args.seed;
    let mut rig = Rig::default();
    // What is given stands above what the recording brings, key by key.
    for profile in recording.camera_profile.iter().chain(&args.profile) {
        rig.read(profile, &mut settings)?;
    }
    if let Some(geometry) = &recording.geometry {
        rig.lay_over(geometry);
    }
    for set in &args.sets {
        rig.set_text(set, &mut settings)?;
    }
    args.which.apply(&mut settings)?;
    if args.plain {
        settings.plain();
    }
    let mut camera = rig.camera();
    // Frames without a camera have no pose either, and are passed through whatever the camera.
    let knows = |frame: &usize| rig.geometry_over(recording.geometry_at_frame(*frame)).is_some();
    let first = camera_of(&recording, &rig, (0..recording.frame_count()).find(knows).unwrap_or(0))?;
    let camera_at = |frame| if knows(&frame) { camera_of(&recording, &rig, frame) } else { Ok(first.clone()) };
    let cameras = range.clone().map(camera_at).collect::<Result<Vec<_>>>()?;
    // A lens that cannot be is refused before anything is written.
    camera.lens.opening(&first)?;
    if args.strict {
        for frame in range.clone() {
            recording.pose_at_frame(frame).with_context(|| format!("frame {frame} has no pose"))?;
        }
    }
    let mut poses = (0..recording.frame_count()).map(|frame| recording.pose_at_frame(frame));
    if let (Some(Err(first)), true) = (poses.next(), poses.all(|pose| pose.is_err())) {
        let count = count(recording.frame_count(), "frame");
        return Err(first).with_context(|| format!("none of the recording's {count} has a pose; its first one"));
    }
    let scene = crate::scene::load(&args.scene, recording.up)?;
    let inputs = Inputs::of(&recording).and(&recording.camera_profile).and(&args.profile).and(&scene.files);
    check_outputs(&args, &out, &inputs, &range)?;
    let missing = recording.missing_poses(range.clone());
    for text in recording.warnings.iter().chain(&missing).chain(&scene.warnings) {
        warn(args.quiet, text);
    }
    let unknown_exposure = camera.exposure.time_s.is_none() && camera.exposure.shutter_angle_deg.is_none();
    if unknown_exposure && recording.exposure.iter().all(|e| e.time_s.is_none()) && !args.plain {
        let text = if recording.kind.has_times() {
            "nothing says how long the frames were exposed: half the frame interval is taken"
        } else {
            // Between pictures whose times mean nothing there is no motion to blur along.
            camera.exposure.time_s = Some(0.0);
            "the pictures bear no times, so that nothing is blurred by motion"
        };
        warn(args.quiet, &format!("{text}; --set camera.exposure.time_s=SECONDS sets an exposure"));
    }
    if camera.noise.is_none() && !args.plain {
        let text =
            "nothing says how noisy this camera is: objects are drawn without noise, and look too clean beside it";
        warn(
            args.quiet,
            &format!(
                "{text}; `locard calibrate noise` measures it from pictures of a scene at rest, with --moving from the recording itself"
            ),
        );
    }
    for text in settings.idle(&camera) {
        warn(args.quiet, text);
    }
    settings.check(&camera, &first)?;
    let gpu = Gpu::open()?;
    let mut compositor = Compositor::new(gpu, scene);
    for text in compositor.warnings() {
        warn(args.quiet, &text);
    }
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
    let layers = args.layers.clone();
    if let Some(folder) = &layers {
        std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    let bar = progress(args.quiet, range.len());
    let mut stats: Vec<FrameStats> = Vec::with_capacity(range.len());
    let adapter = compositor.gpu().info.clone();
    let stream = Stream {
        camera: &camera,
        settings: &settings,
        track: &recording.track,
        time_offset_s: recording.time_offset_s,
        want_layers: layers.is_some(),
    };
    let writer = Writer { sink, layers, force: args.force };
    let streamed = run_stream(&recording, (range, &cameras), &mut compositor, &stream, writer, |done| {
        bar.inc(1);
        stats.push(done.stats.clone());
    });
    bar.finish_and_clear();
    streamed?;
    let mut lacking = stats.iter().filter_map(|s| Some((s.frame, s.no_occlusion.as_ref()?)));
    if let Some((frame, why)) = lacking.next() {
        let number = 1 + lacking.count();
        let of = format!("{number} of {}", count(stats.len(), "frame"));
        warn(args.quiet, &format!("nothing real hides objects in {of}, though there is depth (frame {frame}: {why})"));
    }
    if stats.iter().all(|s| !s.objects_in_sight && s.no_pose.is_none()) {
        warn(args.quiet, NOTHING_SEEN);
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
    let place =
        if args.output.as_os_str() == "-" { "standard output".to_owned() } else { args.output.display().to_string() };
    tell(args.quiet, &format!("{} in {:.1} s: {place}", count(stats.len(), "frame"), start.elapsed().as_secs_f64()));
    Ok(())
}

/// The camera that took a frame: what was given, over the recording's own.
pub fn camera_of(recording: &Recording, rig: &Rig, frame: usize) -> Result<Geometry> {
    let own = recording.geometry_at_frame(frame);
    let Some(geometry) = rig.geometry_over(own) else {
        let path = recording.path.display();
        if rig.gives_geometry() {
            let missing = rig.missing_keys().iter().map(|key| format!("camera.{key}")).collect::<Vec<_>>().join(", ");
            bail!(
                "what is given makes no camera, and {path} has none of its own that it could lie over: {missing} must be \
                 given too, by --profile or --set"
            );
        }
        bail!(
            "nothing says what camera took {path}: give --profile with a table [camera] (focal length, principal point); \
             profiles/ has examples"
        );
    };
    if geometry.is_round() || own.is_some_and(Geometry::is_round) {
        check_round(&geometry)?;
    }
    let Intrinsics { width_px, height_px, .. } = geometry.intrinsics;
    if (width_px, height_px) != (recording.width, recording.height) {
        bail!(
            "the camera's picture is {width_px}x{height_px} px, the recording's frames are {}x{}: camera.width_px and \
             camera.height_px must say what the intrinsics belong to",
            recording.width,
            recording.height
        );
    }
    if let Some(name) = geometry.distortion.missing() {
        let model = geometry.distortion.get("model").unwrap_or(Value::None);
        bail!("camera.distortion.{name} is not 0, but the model {model} has no {name}; set it to 0, or name its model");
    }
    Ok(geometry)
}

/// Of a camera that takes 360° pictures, or is said to take a recording's: that it can.
fn check_round(geometry: &Geometry) -> Result<()> {
    let i = &geometry.intrinsics;
    if !geometry.is_round() {
        bail!(
            "the recording is of 360° pictures, the profile's table [camera] of another camera: leave that table out, or \
             write model = \"equirectangular\" into [camera.distortion]"
        );
    }
    if i.width_px != 2 * i.height_px {
        bail!("a 360° picture (equirectangular) is twice as wide as high; found is {}x{}", i.width_px, i.height_px);
    }
    if i.readout_time_s > 0.0 {
        bail!(
            "camera.readout_time_s = {} is refused: the rows of a 360° picture, put together from several sensors, \
             have no times of their own; accepted is 0",
            i.readout_time_s
        );
    }
    Ok(())
}

fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// That all outputs can be written, before any is begun.
fn check_outputs(args: &Args, out: &OutPath, inputs: &Inputs, range: &Range<usize>) -> Result<()> {
    match out {
        OutPath::Folder(folder) => inputs.check_folder(folder, range.clone().map(sink::folder::frame_name))?,
        OutPath::Video(file) => inputs.check_file(file)?,
        OutPath::Stdout => {}
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
        bail!("-: is the output already; --report needs a file of its own");
    }
    check_apart(args, out, range)?;
    if is_stdout(report) {
        return Ok(());
    }
    inputs.check_file(report)?;
    let folder = report.parent().unwrap_or(Path::new(""));
    // Those of the other outputs are made before it is written.
    let made = matches!(out, OutPath::Folder(out) if outputs::same(out, folder))
        || args.layers.as_ref().is_some_and(|layers| outputs::same(layers, folder));
    if made && !folder.is_dir() { Ok(()) } else { Ok(sink::check_file(report, args.force)?) }
}

/// That no two of the files that are written have one name, nor one the name of another's folder.
fn check_apart(args: &Args, out: &OutPath, range: &Range<usize>) -> Result<()> {
    let named = |folder: &Path, name: fn(usize) -> String| {
        let folder = outputs::resolved(folder);
        range.clone().map(move |frame| folder.join(name(frame)))
    };
    let mut files: HashSet<PathBuf> = match out {
        OutPath::Folder(folder) => named(folder, sink::folder::frame_name).collect(),
        OutPath::Video(file) => [outputs::resolved(file)].into(),
        OutPath::Stdout => HashSet::new(),
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

/// Decoding on the recording's threads, drawing here, writing on a thread of its own.
fn run_stream(
    recording: &Recording,
    (range, cameras): (Range<usize>, &[Geometry]),
    compositor: &mut Compositor,
    stream: &Stream<'_>,
    mut writer: Writer,
    mut done: impl FnMut(&Composited),
) -> Result<()> {
    #[derive(Debug, thiserror::Error)]
    enum Stop {
        #[error(transparent)]
        Recording(#[from] crate::recording::RecordingError),
        /// The writer has an error of its own to tell.
        #[error("writing stopped")]
        Writer,
    }
    let times = &recording.timestamps_s;
    let about = |frame: usize| {
        (&cameras[frame - range.start], crate::frame::interval_s(times, frame, recording.frame_interval_s))
    };
    let frames = recording.frames(range.clone())?.map(|frame| frame.map_err(Stop::from));
    std::thread::scope(|scope| {
        // The end is said: a writer whose frames only cease must not call the output finished.
        let (sender, receiver) = mpsc::sync_channel::<Option<Composited>>(2);
        let write = move || -> Result<()> {
            for frame in receiver {
                match frame {
                    Some(frame) => writer.write(&frame)?,
                    None => return Ok(writer.sink.finish()?),
                }
            }
            Ok(())
        };
        let writing = std::thread::Builder::new().name("writer".to_owned());
        let writing = writing.spawn_scoped(scope, write).context("no thread can be started that writes")?;
        let drawn = compositor.run(stream, frames, about, |frame| {
            done(&frame);
            sender.send(Some(frame)).map_err(|_| Stop::Writer)
        });
        let finished = drawn.is_ok() && sender.send(None).is_ok();
        drop(sender);
        let written = writing.join().map_err(|_| anyhow::anyhow!("the writing thread failed"))?;
        match drawn {
            // What the writer has to say comes first: it is why the frames stopped.
            Err(stopped) => written.and(Err(stopped.into())),
            Ok(()) if finished => written,
            Ok(()) => written.and_then(|()| bail!("the writing thread stopped early")),
        }
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
