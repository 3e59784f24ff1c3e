//! `locard record`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use super::warn;
use super::watching::{Agreed, CameraArgs};
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

/// So long a frame waits for its poses, seconds: nobody looks, and poses of a network are rarely later. With the half
/// second for which lines are held, a power cut costs less than a second.
const PATIENCE_S: f64 = 0.2;

/// Makes the folder that a recording's own folder goes into.
pub fn folder_for(recording: &Path) -> Result<MadeFolder> {
    let folder = recording.parent().unwrap_or(Path::new(""));
    MadeFolder::make(folder).with_context(|| format!("{}: the folder cannot be made", folder.display()))
}

pub fn run(args: &Args) -> Result<()> {
    let agreed = Agreed::open(&args.camera, args.profile.as_deref())?;
    if let (Some(lens), None) =
        (agreed.opened.lens.as_ref().filter(|lens| lens.camera.geometry.is_none()), &args.profile)
    {
        warn(args.camera.pictures.quiet, &lens.description);
    }
    let about = agreed.about(args.profile.as_deref())?;
    let was_there = args.output.is_dir();
    let made = folder_for(&args.output)?;
    let writer = RecorderThread::new(Recorder::create(&args.output, &about)?)?;
    // As far as an exposure may reach. Even poses from tags have to be waited for there: the next frame's is measured, and what
    // lies between is not predicted then. No farther, or what is found again would rise before it is found.
    let (interval_s, reach_s) = (about.interval_s, 0.5 * about.interval_s);
    let mut rig = args.profile.as_deref().map(Rig::of_file).transpose()?.unwrap_or_default();
    rig.follow_frames();
    let lenses = agreed.opened.lens_track(&rig);
    let patience_s = PATIENCE_S.max(1.5 * interval_s);
    let mut intake = Intake::new(about.max_gap_s, patience_s, Some(writer)).with_lens_track(lenses);
    let mut watching = agreed.start()?;
    let (mut not_recorded, mut last_s, mut failure) = (0, f64::NEG_INFINITY, None);
    while failure.is_none() && watching.goes_on(intake.frames()) {
        match watching.next(Instant::now() + Duration::from_millis(50)) {
            CaptureEvent::Picture(decoded) => {
                let (picture, pixels) = *decoded;
                let outcome = intake.add_picture(&picture, pixels, |_| (reach_s, reach_s), monotonic_s());
                not_recorded += u64::from(outcome == PictureOutcome::NotRecorded);
                last_s = picture.time_s;
            }
            CaptureEvent::Nothing => {}
            CaptureEvent::Ended => break,
        }
        watching.give_poses(|capture| intake.take_poses(capture, last_s))?;
        // With its poses a frame's presence is recorded.
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
        bail!("{error}; the recording ends after {}, and is whole", count(kept, "frame"));
    }
    if kept == 0 {
        bail!("{}: nothing was recorded: {}", args.output.display(), watching.nothing());
    }
    if counts.late + counts.implausible > 0 {
        let (late, odd) = (count(counts.late as usize, "pose"), counts.implausible);
        let text = format!("left out: {late} that came too late, and {odd} that no camera can have made");
        warn(args.camera.pictures.quiet, &text);
    }
    watching.close(&format!("{}: {} poses, ", args.output.display(), counts.poses), kept, not_recorded);
    Ok(())
}
