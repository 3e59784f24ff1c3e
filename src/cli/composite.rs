//! `locard composite`.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use anyhow::{Context, Result, bail};

use super::{Interrupted, interruption, progress, tell, warn};
use crate::camera::Geometry;
use crate::compositor::{Composited, Compositor, FrameStats, Settings, Stream};
use crate::gpu::Gpu;
use crate::profile::Rig;
use crate::recording::{OpenOptions, Recording};
use crate::sink::{self, OutPath, SinkOptions};
use crate::words::count;

const INTERRUPTED: Interrupted = Interrupted("frames that were finished stay, a video does not");

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
    /// Only these effects
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["without", "plain"])]
    only: Option<Vec<String>>,
    /// All effects but these
    #[arg(long, value_delimiter = ',', conflicts_with = "plain")]
    without: Option<Vec<String>>,
    /// Every effect and occlusion off; the camera's geometry stays on
    #[arg(long)]
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
    /// Also write what was found and done for each frame
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
        bail!("--frames {}..{}: the recording has the frames 0..{count}", range.start, range.end);
    }
    Ok(range)
}

/// What frames are handed to while the next ones are drawn.
struct Writer {
    sink: Box<dyn sink::Sink + Send>,
    layers: Option<PathBuf>,
}

impl Writer {
    fn write(&mut self, done: &Composited) -> Result<()> {
        if let (Some(folder), Some(layer)) = (&self.layers, &done.layer) {
            sink::exr::write_layers(&layer_path(folder, done.frame), layer)?;
        }
        Ok(self.sink.write(done.frame, &done.pixels)?)
    }
}

fn layer_path(folder: &Path, frame: usize) -> PathBuf {
    folder.join(format!("layer_{frame:06}.exr"))
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
    check_output(&recording, &out)?;

    let mut settings = Settings::default();
    settings.seed = args.seed;
    let mut rig = Rig::default();
    // What is given stands above what the recording brings, key by key.
    for profile in recording.camera_profile.iter().chain(&args.profile) {
        rig.read(profile, &mut settings)?;
    }
    if let Some(geometry) = &recording.geometry {
        rig.default_geometry(geometry);
    }
    for set in &args.sets {
        rig.set_text(set, &mut settings)?;
    }
    if args.only.iter().chain(&args.without).flatten().any(String::is_empty) {
        let known: Vec<&str> = settings.effects.iter().map(|e| e.params().table()).collect();
        bail!("--only and --without need names of effects, commas between; there are: {}", known.join(", "));
    }
    if let Some(names) = &args.only {
        settings.only(names)?;
    }
    if let Some(names) = &args.without {
        settings.without(names)?;
    }
    if args.plain {
        settings.plain();
    }
    let mut camera = rig.camera();
    check_camera(&recording, &camera.geometry)?;
    if args.strict {
        for frame in range.clone() {
            recording.pose_at_frame(frame).with_context(|| format!("frame {frame} has no pose"))?;
        }
    }
    if let Some(Err(first)) = range.clone().map(|frame| recording.pose_at_frame(frame)).reduce(|a, b| a.or(b)) {
        return Err(first).with_context(|| format!("none of the frames {}..{} has a pose", range.start, range.end));
    }
    let scene = crate::scene::load(&args.scene, recording.up)?;
    for text in recording.warnings.iter().chain(&scene.warnings) {
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
        warn(args.quiet, &format!("{text}; `locard calibrate noise` measures it from pictures of a scene at rest"));
    }
    for text in settings.idle(&camera) {
        warn(args.quiet, text);
    }
    if let Some(geometry) = camera.geometry.as_ref().or_else(|| recording.geometry_at_frame(0)) {
        // A lens that cannot be is refused before anything is written.
        camera.lens.opening(geometry)?;
        settings.check(&camera, geometry)?;
    }

    let interrupted = interruption()?;
    let gpu = Gpu::open()?;
    let mut compositor = Compositor::new(gpu, camera.clone(), settings, scene);
    for text in compositor.warnings() {
        warn(args.quiet, &text);
    }
    let layers = args.layers.clone();
    if let Some(folder) = &layers {
        prepare_layers(folder, range.clone(), args.force)?;
    }
    if let Some(report) = &args.report {
        prepare_report(report, &args.output, args.force)?;
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
    let bar = progress(args.quiet, range.len());
    let mut stats: Vec<FrameStats> = Vec::with_capacity(range.len());
    let adapter = compositor.gpu().info.clone();
    let streamed = stream(&recording, range, &rig, &mut compositor, Writer { sink, layers }, &interrupted, |done| {
        bar.inc(1);
        stats.push(done.stats.clone());
    });
    bar.finish_and_clear();
    // Ctrl-C reaches our ffmpeg too: that it stopped is no news then.
    if streamed.is_err() && interrupted.load(Ordering::SeqCst) {
        return Err(INTERRUPTED.into());
    }
    streamed?;
    let mut lacking = stats.iter().filter_map(|s| Some((s.frame, s.no_occlusion.as_ref()?)));
    if let Some((frame, why)) = lacking.next() {
        let number = 1 + lacking.count();
        let of = format!("{number} of {}", count(stats.len(), "frame"));
        warn(args.quiet, &format!("nothing real hides objects in {of}, though there is depth (frame {frame}: {why})"));
    }

    if let Some(path) = &args.report {
        let report = serde_json::json!({
            "adapter": adapter.name,
            "driver": format!("{} {}", adapter.driver, adapter.driver_info),
            "seed": args.seed,
            "frames": stats,
        });
        let text = serde_json::to_string_pretty(&report)?;
        std::fs::write(path, text).with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    let place =
        if args.output.as_os_str() == "-" { "standard output".to_owned() } else { args.output.display().to_string() };
    tell(args.quiet, &format!("{} in {:.1} s: {place}", count(stats.len(), "frame"), start.elapsed().as_secs_f64()));
    Ok(())
}

/// That the camera is known, and is the recording's.
fn check_camera(recording: &Recording, geometry: &Option<Geometry>) -> Result<()> {
    if geometry.is_none() && recording.geometry_at_frame(0).is_none() {
        bail!(
            "nothing says what camera took {}: give --profile with a table [camera] (focal length, principal point); \
             profiles/ has examples",
            recording.path.display()
        );
    }
    let round = recording.geometry_at_frame(0).is_some_and(Geometry::is_round);
    if let Some(g) = geometry {
        let i = &g.intrinsics;
        if round && !g.is_round() {
            bail!(
                "the recording is of 360° pictures, the profile's table [camera] of another camera: leave that table out, or \
                 write model = \"equirectangular\" into [camera.distortion]"
            );
        }
        if g.is_round() && i.width_px != 2 * i.height_px {
            bail!("a 360° picture (equirectangular) is twice as wide as high; found is {}x{}", i.width_px, i.height_px);
        }
        if g.is_round() && i.readout_time_s > 0.0 {
            bail!(
                "camera.readout_time_s = {} is refused: the rows of a 360° picture, put together from several sensors, \
                 have no times of their own; accepted is 0",
                i.readout_time_s
            );
        }
        if (i.width_px, i.height_px) != (recording.width, recording.height) {
            bail!(
                "the camera's picture is {}x{} px, the recording's frames are {}x{}: camera.width_px and \
                 camera.height_px must say what the intrinsics belong to",
                i.width_px,
                i.height_px,
                recording.width,
                recording.height
            );
        }
    }
    Ok(())
}

/// The camera that took a frame.
pub fn camera_of(recording: &Recording, rig: &Rig, frame: usize) -> Result<Geometry> {
    let own = rig.camera().geometry;
    check_camera(recording, &own)?;
    own.or_else(|| recording.geometry_at_frame(frame).cloned()).context("the recording has no camera")
}

/// That frames are not put among the recording's own, where they would be taken for them.
fn check_output(recording: &Recording, out: &OutPath) -> Result<()> {
    let (OutPath::Folder(path) | OutPath::Video(path)) = out else { return Ok(()) };
    // What does not exist is none of them.
    let Ok(there) = path.canonicalize() else { return Ok(()) };
    let same = |other: &Path| other.canonicalize().is_ok_and(|other| other == there);
    let mut files = recording.picture_files().iter().map(PathBuf::as_path);
    let mut folders: Vec<&Path> = files.clone().filter_map(Path::parent).collect();
    folders.dedup();
    let what = match out {
        OutPath::Video(_) if files.any(same) => "the recording's video",
        OutPath::Folder(_) if same(&recording.path) => "the recording's folder",
        OutPath::Folder(_) if folders.into_iter().any(same) => "the folder of the recording's frames",
        _ => return Ok(()),
    };
    bail!("{}: is {what}, which is not written to, with --force neither; choose another place", path.display())
}

/// That the report can be written at the end, and is not the output.
fn prepare_report(report: &Path, output: &Path, force: bool) -> Result<()> {
    if report == output {
        bail!("{}: is the output already; --report needs a file of its own", report.display());
    }
    if report.exists() && !force {
        bail!("{}: exists already; it is kept unless --force is given", report.display());
    }
    let folder = report.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        bail!("{}: cannot be written, for there is no folder {}", report.display(), folder.display());
    }
    Ok(())
}

fn prepare_layers(folder: &Path, mut range: Range<usize>, force: bool) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    if !force && let Some(frame) = range.find(|&n| layer_path(folder, n).exists()) {
        bail!("{}: exists already; it is kept unless --force is given", layer_path(folder, frame).display());
    }
    Ok(())
}

/// Decoding on the recording's threads, drawing here, writing on a thread of its own.
fn stream(
    recording: &Recording,
    range: Range<usize>,
    rig: &Rig,
    compositor: &mut Compositor,
    mut writer: Writer,
    interrupted: &AtomicBool,
    mut done: impl FnMut(&Composited),
) -> Result<()> {
    #[derive(Debug, thiserror::Error)]
    enum Stop {
        #[error(transparent)]
        Recording(#[from] crate::recording::RecordingError),
        /// The writer has an error of its own to tell.
        #[error("writing stopped")]
        Writer,
        #[error(transparent)]
        Interrupted(#[from] Interrupted),
    }
    let own = rig.camera().geometry;
    let times = &recording.timestamps_s;
    let about = |frame: usize| {
        let geometry = own.as_ref().or_else(|| recording.geometry_at_frame(frame));
        let next = times.get(frame + 1).map_or(recording.frame_interval_s, |t| t - times[frame]);
        (geometry, next)
    };
    // Checked before: every frame has one or the other, or takes the first one's.
    let first = about(0).0.context("the recording has no camera")?;
    let frames = recording.frames(range)?.map(|frame| match interrupted.load(Ordering::SeqCst) {
        true => Err(INTERRUPTED.into()),
        false => frame.map_err(Stop::from),
    });
    let stream = Stream {
        track: &recording.track,
        time_offset_s: recording.time_offset_s,
        want_layers: writer.layers.is_some(),
    };
    std::thread::scope(|scope| {
        // The end is said: a writer whose frames only cease must not call the output finished.
        let (sender, receiver) = mpsc::sync_channel::<Option<Composited>>(2);
        let writing = scope.spawn(move || -> Result<()> {
            for frame in receiver {
                match frame {
                    Some(frame) => writer.write(&frame)?,
                    None => return Ok(writer.sink.finish()?),
                }
            }
            Ok(())
        });
        let drawn = compositor.run(
            &stream,
            frames,
            |frame| (about(frame).0.unwrap_or(first), about(frame).1),
            |frame| {
                done(&frame);
                sender.send(Some(frame)).map_err(|_| Stop::Writer)
            },
        );
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
        assert!(text.contains("--frames 9..9: the recording has the frames 0..9"), "{text}");
    }
}
