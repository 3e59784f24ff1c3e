//! `locard record`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use super::warn;
use super::watching::{Agreed, CameraArgs, Next};
use crate::live::{Writer, encoded};
use crate::recording::recorder::{About, Recorder};
use crate::tracking::tum::Line;

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

/// What a recording says of its camera and poses.
pub fn about(agreed: &Agreed, profile: Option<&PathBuf>) -> Result<About> {
    let given = &agreed.camera.given;
    let read =
        |path: &PathBuf| std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()));
    Ok(About {
        interval_s: agreed.interval_s,
        max_gap_s: agreed.poses.max_gap_s(),
        up: agreed.poses.up(),
        camera: Some(given.name.clone()),
        delivered: Some(given.delivered.to_string()),
        has_exposure: given.has_exposure,
        profile: profile.map(read).transpose()?,
    })
}

pub fn run(args: &Args) -> Result<()> {
    let agreed = Agreed::open(&args.camera, args.profile.as_deref())?;
    let writer = Writer::new(Recorder::create(&args.output, &about(&agreed, args.profile.as_ref())?)?)?;
    let mut watching = agreed.start()?;
    let (mut frames, mut not_recorded, mut poses, mut late) = (0, 0, 0, 0);
    let (mut frame_s, mut pose_s) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let mut failure = None;
    while failure.is_none() && watching.goes_on(frames) {
        let next = watching.next(Instant::now() + Duration::from_millis(50));
        match next {
            Next::Picture(came) => {
                let (picture, pixels) = *came;
                if picture.time_s > frame_s {
                    if writer.frame(picture.time_s, encoded(&picture, &pixels), picture.exposure_s) {
                        frames += 1;
                    } else {
                        not_recorded += 1;
                    }
                    frame_s = picture.time_s;
                }
            }
            Next::Nothing => {}
            Next::Ended => break,
        }
        let mut lines = Vec::new();
        for (time_s, pose) in watching.new_poses(frame_s)? {
            // A sender that jumps back is not believed until it has caught up.
            if time_s.is_finite() && time_s > pose_s {
                pose_s = time_s;
                lines.push(Line::new(time_s, &pose));
            } else {
                late += 1;
            }
        }
        poses += lines.len();
        writer.poses(lines);
        failure = writer.failure();
    }
    let (kept, ended) = writer.finish();
    if let Some(error) = failure.or(ended) {
        bail!("{error}; the recording ends after {}, and is whole", crate::words::count(kept, "frame"));
    }
    if late > 0 {
        warn(args.camera.quiet, &format!("{late} poses went back in time, and are left out"));
    }
    watching.close(&format!("{}: {poses} poses, ", args.output.display()), kept, not_recorded);
    Ok(())
}
