//! `locard live`: in the window, or without one into a file.

use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};

use super::labels::LabelArgs;
use super::record::create_parent;
use super::watching::{CameraArgs, CameraSession, OpenCamera};
use super::which::Which;
use super::{is_closed_stdout, print_message, warn};
use locard_engine::cleanup::MadeFolder;
use locard_engine::compositor::Composited;
use locard_engine::gpu::Gpu;
use locard_engine::label::{DigitalSourceType, SourceLabel};
use locard_engine::live::{CaptureEvent, LiveCompositor, PictureOutcome, RecorderThread, Tracking};
use locard_engine::recording::recorder::{Recorder, discard};
use locard_engine::shot::{Shot, ShotError, ShotOptions};
use locard_engine::sink::{self, OutPath, Sink, SinkError, SinkOptions};
use locard_engine::source::presentation::Presentation;
use locard_engine::text::{count, fixed};
use locard_engine::webcam::monotonic_s;

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    camera: CameraArgs,
    /// A .glb or .gltf in the poses' world coordinates, or a scene.toml
    #[arg(long, required_if_eq("headless", "true"))]
    scene: Option<PathBuf>,
    /// The camera and the effects' parameters; a stream that reports its lens needs none
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Set a parameter, as in --set noise.scale=1.5; `locard params` lists them
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    sets: Vec<String>,
    #[command(flatten)]
    which: Which,
    /// Seed of the noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Without a window
    #[arg(long, requires = "output")]
    headless: bool,
    /// Also record the input into a new folder, from which `locard composite` makes the same
    /// pictures
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// A folder (PNG sequence), a .mp4 or .mkv file, or - for raw RGB on stdout
    #[arg(short = 'o', long = "output", value_name = "OUT", requires = "headless")]
    output: Option<PathBuf>,
    /// Keep every code value in a video
    #[arg(long)]
    lossless: bool,
    #[command(flatten)]
    labels: LabelArgs,
    /// Replace output that exists
    #[arg(long)]
    force: bool,
}

pub fn run(args: &Args) -> Result<()> {
    match &args.output {
        Some(output) if args.headless => headless(args, output),
        _ => in_window(args),
    }
}

/// Opens the camera before the window, so that errors are printed.
#[cfg(feature = "window")]
fn in_window(args: &Args) -> Result<()> {
    use locard_window::{self, InitialContent, Project};

    if args.camera.pictures.has_limit() || args.which.is_given() || args.force || args.lossless {
        bail!("--frames, --seconds, --only, --without, --lossless and --force go with --headless");
    }
    let camera = OpenCamera::open(&args.camera, args.profile.as_deref())?;
    let shot_options = ShotOptions {
        profile: args.profile.clone(),
        sets: args.sets.clone(),
        scene: args.scene.clone(),
        ..ShotOptions::default()
    };
    let mut project = Project::of(camera.opened.recording(), &shot_options)?;
    project.camera = Some(args.camera.spec().absolute());
    let (camera, record) = (Some(camera.opened), args.record.clone());
    super::tune::check_opened(locard_window::open(InitialContent {
        project: Some(project),
        camera,
        record,
        ..InitialContent::default()
    }))
}

#[cfg(not(feature = "window"))]
fn in_window(_: &Args) -> Result<()> {
    bail!("{}; or name --headless and an output", super::WITHOUT_WINDOW)
}

fn headless(args: &Args, output: &Path) -> Result<()> {
    let out = OutPath::parse(output)?;
    let profile = args.profile.as_deref();
    if args.which.leaves_registration() {
        bail!("--without registration: a camera's poses are used as they come; it goes with `composite` and `photo`");
    }
    let camera = OpenCamera::open(&args.camera, profile)?;
    sink::check(&out, args.force)?;
    let format = camera.opened.camera.negotiated.picture_format;
    let (width, height, interval_s) = (format.width, format.height, camera.opened.interval_s);
    let shot_options = ShotOptions {
        profile: args.profile.clone(),
        sets: args.sets.clone(),
        scene: args.scene.clone(),
        ..ShotOptions::default()
    };
    let mut shot = Shot::of(camera.opened.recording(), &shot_options)?;
    shot.settings.seed = args.seed;
    args.which.apply(&mut shot.settings)?;
    let lacks = |error| match (&camera.opened.lens, error) {
        (Some(lens), ShotError::NoCamera { .. }) if lens.camera.geometry.is_none() => {
            anyhow!("{}; give the camera's profile (--profile), or check the stream", lens.description)
        }
        (_, error) => anyhow::Error::from(error),
    };
    let geometry = shot.geometry_at(0).map_err(lacks)?;
    shot.settings.check(&shot.camera(), &geometry)?;
    for note in shot.notes(0..0) {
        warn(args.camera.pictures.quiet, &note.to_string());
    }
    let mut compositor = shot.compositor(Gpu::open()?);
    for text in compositor.warnings() {
        warn(args.camera.pictures.quiet, &text);
    }
    compositor.prepare(&shot.settings);
    args.labels.warn(DigitalSourceType::CompositeWithSyntheticElements, []);
    let options = SinkOptions {
        force: args.force,
        fps: 1.0 / interval_s,
        times_s: None,
        presentation: Presentation::default(),
        lossless: args.lossless,
        codec: None,
        closed_groups: None,
        soundtrack: None,
        label: args.labels.is_labelled().then(|| SourceLabel::composite(Path::new(&args.camera.camera))),
        width,
        height,
        bits: 8,
    };
    let sink = sink::open(&out, &options)?;
    let about = camera.about(profile)?;
    let was_there = args.record.as_ref().is_some_and(|path| path.is_dir());
    let made = args.record.as_deref().map(create_parent).transpose()?;
    let writer =
        args.record.as_ref().map(|path| Ok::<_, anyhow::Error>(RecorderThread::new(Recorder::create(path, &about)?)?));
    let writer = writer.transpose()?;
    let max_wait_s = camera.opened.max_wait_s();
    let lenses = camera.opened.lens_track(&shot.rig);
    let mut live = LiveCompositor::new(&shot, &mut compositor, about.max_gap_s, max_wait_s, writer, lenses)?;
    let mut tally = LiveTally::default();
    let mut session = camera.start()?;
    let done = write_on_thread(sink, |send| {
        composite_frames(&mut session, &mut live, &mut tally, args.camera.pictures.quiet, send)
    });
    let (frames, counts) = (live.frames(), live.counts());
    let recorded = live.finish();
    if let (Some(path), Some((0, _))) = (&args.record, &recorded) {
        discard(path, was_there);
    } else {
        made.into_iter().for_each(MadeFolder::keep);
    }
    match done {
        Err(error) if !is_closed_stdout(&error) => return Err(error),
        _ => {}
    }
    session.close("", frames, tally.not_recorded);
    if !args.camera.pictures.quiet {
        print_message(&format!(
            "{} tracked, {} by predicted poses, {} without; {} of poses came late",
            count(counts.tracked as usize, "frame"),
            counts.predicted,
            counts.untracked,
            counts.late
        ));
        print_message(&tally.latency.to_string());
    }
    if let Some((0, Some(error))) = recorded {
        bail!("{error}; nothing was recorded");
    }
    if let Some((_, Some(error))) = recorded {
        bail!("{error}; the recording is complete up to there");
    }
    Ok(())
}

/// Statistics for the closing lines.
#[derive(Default)]
struct LiveTally {
    not_recorded: u64,
    latency: LatencyHistogram,
    loss: TrackingLoss,
}

/// Messages about the loss of poses and their return.
#[derive(Default)]
struct TrackingLoss {
    /// The first frame without a pose, its time, and whether it was reported.
    since: Option<(usize, f64, bool)>,
}

impl TrackingLoss {
    /// Shortest loss that is reported, s.
    const MIN_REPORTED_S: f64 = 0.5;

    fn next(&mut self, frame: usize, at_s: f64, is_lost: bool, why: impl FnOnce() -> Option<String>) -> Option<String> {
        if !is_lost {
            let (_, since_s, _) = self.since.take().filter(|(_, _, is_reported)| *is_reported)?;
            return Some(format!("poses again from frame {frame} on, after {} s", fixed(at_s - since_s, 1)));
        }
        let (first, since_s, is_reported) = self.since.get_or_insert((frame, at_s, false));
        if *is_reported || at_s - *since_s < Self::MIN_REPORTED_S {
            return None;
        }
        *is_reported = true;
        let why = why().map_or(String::new(), |why| format!(": {why}"));
        Some(format!("no pose from frame {first} on{why}"))
    }
}

/// Composites frames until the camera ends or the program is interrupted.
fn composite_frames(
    session: &mut CameraSession,
    live: &mut LiveCompositor<'_>,
    tally: &mut LiveTally,
    quiet: bool,
    mut send: impl FnMut(Composited) -> bool,
) -> Result<()> {
    let mut last_s = f64::NEG_INFINITY;
    let mut ended = false;
    loop {
        ended |= !session.is_running(live.frames());
        if ended && live.due_s().is_none() {
            if live.frames() == 0 {
                bail!("nothing was composited: {}", session.no_picture_error());
            }
            return Ok(());
        }
        let timeout_s = live.due_s().map_or(0.02, |due_s| (due_s - monotonic_s()).clamp(0.0, 0.005));
        if !ended {
            match session.next(Instant::now() + Duration::from_secs_f64(timeout_s)) {
                CaptureEvent::Picture(decoded) => {
                    let (picture, pixels) = *decoded;
                    let outcome = live.add_picture(&picture, pixels, monotonic_s());
                    tally.not_recorded += u64::from(outcome == PictureOutcome::NotRecorded);
                    last_s = picture.time_s;
                }
                CaptureEvent::Nothing => {}
                CaptureEvent::Ended => ended = true,
            }
        }
        session.take_poses(|capture| live.take_poses(capture, last_s))?;
        while let Some(submitted) = live.submit(monotonic_s())? {
            let shown = live.collect(submitted)?;
            let now_s = monotonic_s();
            tally.latency.add(shown.taken_s, now_s - shown.arrived_s, now_s);
            let is_lost = shown.tracking == Tracking::Lost;
            if let Some(text) = tally.loss.next(shown.done.frame, shown.taken_s, is_lost, || session.no_pose_reason()) {
                warn(quiet, &text);
            }
            if !send(shown.done) {
                return Ok(());
            }
        }
        let failure = live.recorder().and_then(RecorderThread::failure);
        if let Some(error) = failure {
            warn(quiet, &format!("{error}; the recording ends here and is complete; the pictures continue"));
            live.take_recorder();
        }
    }
}

/// Runs `frames`, whose pictures are written by another thread.
fn write_on_thread(
    mut sink: Box<dyn Sink + Send>,
    frames: impl FnOnce(&mut dyn FnMut(Composited) -> bool) -> Result<()>,
) -> Result<()> {
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel::<Option<Composited>>(4);
        let write = move || -> Result<(), SinkError> {
            for frame in receiver {
                match frame {
                    Some(done) => sink.write(done.frame, &done.pixels)?,
                    None => return sink.finish(),
                }
            }
            Ok(())
        };
        let writing = std::thread::Builder::new().name("writer".to_owned()).spawn_scoped(scope, write)?;
        let done = frames(&mut |frame| sender.send(Some(frame)).is_ok());
        if done.is_ok() {
            let _ = sender.send(None);
        }
        drop(sender);
        // The writer's error takes precedence: it stopped the frames.
        match writing.join() {
            Ok(written) => written?,
            Err(_) => bail!("the writing thread panicked; see the message above"),
        }
        done
    })
}

/// Histograms of latencies, in bins of a millisecond.
struct LatencyHistogram {
    since_capture: Vec<u32>,
    since_arrival: Vec<u32>,
}

impl Default for LatencyHistogram {
    fn default() -> Self {
        Self { since_capture: vec![0; 2000], since_arrival: vec![0; 2000] }
    }
}

impl LatencyHistogram {
    fn add(&mut self, taken_s: f64, since_arrival_s: f64, now_s: f64) {
        let bin = |bins: &mut Vec<u32>, s: f64| bins[((1e3 * s).max(0.0) as usize).min(1999)] += 1;
        bin(&mut self.since_capture, now_s - taken_s);
        bin(&mut self.since_arrival, since_arrival_s);
    }
}

impl std::fmt::Display for LatencyHistogram {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let quantile_text = |bins: &[u32], share: f64| {
            let all: u32 = bins.iter().sum();
            let mut sum = 0;
            let at = bins.iter().position(|n| {
                sum += n;
                f64::from(sum) >= share * f64::from(all)
            });
            let at_ms = at.unwrap_or_default();
            let more = if at_ms == bins.len() - 1 { "more than " } else { "" };
            format!("{more}{}", fixed(at_ms as f64, 0))
        };
        let [taken, came] = [&self.since_capture, &self.since_arrival];
        write!(
            f,
            "from the driver's time to the composite {} ms (median), {} ms (95 %); of these {} and {} ms since the picture \
             came",
            quantile_text(taken, 0.5),
            quantile_text(taken, 0.95),
            quantile_text(came, 0.5),
            quantile_text(came, 0.95)
        )
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn loss_of_poses_and_their_return_are_reported_once() {
        let mut lost = super::TrackingLoss::default();
        let mut at = |frame: usize, is_lost| lost.next(frame, 0.1 * frame as f64, is_lost, || Some("fog".to_owned()));
        // Half a second is too short.
        assert!((0..5).all(|frame| at(frame, true).is_none()) && at(5, false).is_none());
        let opacities: Vec<String> = (6..14).filter_map(|frame| at(frame, true)).collect();
        assert_eq!(opacities, ["no pose from frame 6 on: fog"]);
        assert_eq!(at(14, false).unwrap(), "poses again from frame 14 on, after 0.8 s");
        assert_eq!(at(15, false), None);
    }
}
