//! `locard record`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use super::warn;
use super::watching::{CameraArgs, OpenCamera};
use locard_engine::cleanup::MadeFolder;
use locard_engine::live::{CaptureEvent, Intake, PictureOutcome, RecorderThread};
use locard_engine::profile::Rig;
use locard_engine::recording::recorder::{Recorder, discard};
use locard_engine::text::count;
use locard_engine::webcam::monotonic_s;

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    camera: CameraArgs,
    /// The camera's profile, kept in the recording
    #[arg(long)]
    profile: Option<PathBuf>,
    /// A new folder
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
}

/// Time that a frame waits for its poses, s. There is no live view, and poses of a network are
/// rarely later. With the half second for which lines are buffered, a power cut loses less than a
/// second.
const POSE_TIMEOUT_S: f64 = 0.2;

/// Creates the parent folder of a recording.
pub fn create_parent(recording: &Path) -> Result<MadeFolder> {
    let folder = recording.parent().unwrap_or(Path::new(""));
    MadeFolder::make(folder).with_context(|| format!("{}: the folder cannot be created", folder.display()))
}

pub fn run(args: &Args) -> Result<()> {
    let camera = OpenCamera::open(&args.camera, args.profile.as_deref())?;
    if let (Some(lens), None) =
        (camera.opened.lens.as_ref().filter(|lens| lens.camera.geometry.is_none()), &args.profile)
    {
        warn(args.camera.pictures.quiet, &lens.description);
    }
    let about = camera.about(args.profile.as_deref())?;
    let was_there = args.output.is_dir();
    let made = create_parent(&args.output)?;
    let writer = RecorderThread::new(Recorder::create(&args.output, &about)?)?;
    // Largest half of an exposure. Poses within it are waited for, also those from tags: after the
    // next frame's pose is measured, the poses between are interpolated and not predicted. A larger
    // reach would raise a frame's opacity before tracking is recovered.
    let (interval_s, reach_s) = (about.interval_s, 0.5 * about.interval_s);
    let mut rig = args.profile.as_deref().map(Rig::of_file).transpose()?.unwrap_or_default();
    rig.follow_frames();
    let lenses = camera.opened.lens_track(&rig);
    let max_wait_s = POSE_TIMEOUT_S.max(1.5 * interval_s);
    let mut intake = Intake::new(about.max_gap_s, max_wait_s, Some(writer)).with_lens_track(lenses);
    let mut session = camera.start()?;
    let (mut not_recorded, mut last_s, mut failure) = (0, f64::NEG_INFINITY, None);
    while failure.is_none() && session.is_running(intake.frames()) {
        match session.next(Instant::now() + Duration::from_millis(50)) {
            CaptureEvent::Picture(decoded) => {
                let (picture, pixels) = *decoded;
                let outcome = intake.add_picture(&picture, pixels, |_| (reach_s, reach_s), monotonic_s());
                not_recorded += u64::from(outcome == PictureOutcome::NotRecorded);
                last_s = picture.time_s;
            }
            CaptureEvent::Nothing => {}
            CaptureEvent::Ended => break,
        }
        session.take_poses(|capture| intake.take_poses(capture, last_s))?;
        // A frame's opacity is recorded with its poses.
        while intake.next(monotonic_s()).is_some() {}
        failure = intake.recorder().and_then(RecorderThread::failure);
    }
    let counts = intake.counts();
    let (kept, ended) = intake.finish().unwrap_or_default();
    if kept == 0 {
        discard(&args.output, was_there);
        drop(made);
    } else {
        made.keep();
    }
    if let Some(error) = failure.or(ended) {
        if kept == 0 {
            bail!("{error}; nothing was recorded");
        }
        bail!("{error}; the recording ends after {} and is complete", count(kept, "frame"));
    }
    if kept == 0 {
        bail!("{}: nothing was recorded: {}", args.output.display(), session.no_picture_error());
    }
    if counts.late + counts.implausible > 0 {
        let (late, odd) = (count(counts.late as usize, "pose"), counts.implausible);
        let text = format!("left out: {late} that came too late, and {odd} that no camera can have made");
        warn(args.camera.pictures.quiet, &text);
    }
    session.close(&format!("{}: {} poses, ", args.output.display(), counts.poses), kept, not_recorded);
    Ok(())
}
