//! `locard record`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use super::warn;
use super::watching::{Agreed, CameraArgs};
use crate::live::{Next, Writer, encoded};
use crate::recording::recorder::Recorder;
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

pub fn run(args: &Args) -> Result<()> {
    let agreed = Agreed::open(&args.camera, args.profile.as_deref())?;
    let about = agreed.about(args.profile.as_deref())?;
    let writer = Writer::new(Recorder::create(&args.output, &about)?)?;
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
                    if writer.frame(picture.time_s, Arc::new(encoded(&picture, &pixels)), picture.exposure_s, Some(1.0))
                    {
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
                watching.covariance(time_s).into_iter().for_each(|covariance| writer.covariance(covariance));
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
        warn(args.camera.pictures.quiet, &format!("{late} poses went back in time, and are left out"));
    }
    watching.close(&format!("{}: {poses} poses, ", args.output.display()), kept, not_recorded);
    Ok(())
}
