//! `locard send`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use glam::DVec3;

use super::{interrupt, print_status, progress_of, warn};
use locard_engine::camera::LensModel;
use locard_engine::pose::Pose;
use locard_engine::recording::OpenOptions;
use locard_engine::shot::{Shot, ShotOptions};
use locard_engine::stream::{LensState, Protocol, Sender};
use locard_engine::text::{count, fixed};

#[derive(clap::Args)]
pub struct Args {
    /// The recording whose poses are sent
    recording: PathBuf,
    /// The destination: opentrackio://HOST:PORT or freed://HOST:PORT; without a host, this machine
    #[arg(long, value_name = "URL")]
    to: String,
    /// Speed relative to the recording
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Repeat the recording until interrupted; the clock continues
    #[arg(long = "loop")]
    repeat: bool,
    /// The camera whose lens is sent, if the recording lacks it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Length of a unit, for formats without a scale (nerfstudio, COLMAP, Metashape …)
    #[arg(long, value_name = "M")]
    metres_per_unit: Option<f64>,
    /// No progress bar and no warnings
    #[arg(long, short)]
    quiet: bool,
}

fn speed(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|speed| (1e-3..=1e4).contains(speed));
    number.ok_or_else(|| "expected a number from 0.001 to 10000".to_owned())
}

pub fn run(args: &Args) -> Result<()> {
    let options = OpenOptions { metres_per_unit: args.metres_per_unit.unwrap_or(1.0), ..OpenOptions::default() };
    let shot = Shot::open(
        &args.recording,
        &options,
        &ShotOptions { profile: args.profile.clone(), ..ShotOptions::default() },
    )?;
    let recording = &shot.recording;
    let poses = poses_on_frame_clock(&shot);
    let (Some(&(first_s, _)), Some(&(last_s, _))) = (poses.first(), poses.last()) else {
        bail!("{}: the recording has no poses to send", args.recording.display());
    };
    let interval_s = if poses.len() > 1 { (last_s - first_s) / (poses.len() - 1) as f64 } else { 1.0 };
    let lens = lens(&shot, args.quiet);
    let mut sender = Sender::open(&args.to, &recording.name, 1.0 / interval_s, lens)?;
    for (time_s, pose) in &poses {
        sender.check(*time_s, pose)?;
    }
    notes(&shot, args);

    let length = if args.repeat { 0 } else { poses.len() };
    let bar = progress_of(args.quiet || args.repeat, length, "{wide_bar} {pos}/{len} poses, {eta} left");
    interrupt::defer_first();
    let began = Instant::now();
    let round_s = last_s - first_s + interval_s;
    let (mut sent, mut is_ended) = (0, false);
    'rounds: for round in 0u32.. {
        for (time_s, pose) in &poses {
            let time_s = time_s + f64::from(round) * round_s;
            is_ended = !wait_until(began + Duration::from_secs_f64((time_s - first_s) / args.speed));
            if is_ended {
                break 'rounds;
            }
            sender.send(time_s, pose)?;
            sent += 1;
            bar.inc(1);
        }
        if !args.repeat {
            break;
        }
    }
    bar.finish_and_clear();
    let took = fixed(began.elapsed().as_secs_f64(), 1);
    let done = format!("{} sent to {} in {took} s", count(sent, "pose"), sender.target().at);
    if is_ended {
        warn(args.quiet, &format!("ended: {done}"));
    } else {
        print_status(args.quiet, &done);
    }
    Ok(())
}

/// Waits until a time. Returns false as soon as the program is interrupted.
fn wait_until(due: Instant) -> bool {
    const POLL_INTERVAL: Duration = Duration::from_millis(50);
    loop {
        let left = due.saturating_duration_since(Instant::now());
        if interrupt::is_requested() || left.is_zero() {
            return !interrupt::is_requested();
        }
        std::thread::sleep(left.min(POLL_INTERVAL));
    }
}

/// The poses on the clock of the frames, which is used to look up a stream's poses. Times are
/// shifted so that none is negative, which streams do not support.
fn poses_on_frame_clock(shot: &Shot) -> Vec<(f64, Pose)> {
    let track = &shot.recording.track;
    let first_s = track.poses_in_frame_time().next().map_or(0.0, |pose| pose.0);
    let shift_s = if first_s < 0.0 { -first_s.floor() } else { 0.0 };
    track.poses_in_frame_time().map(|(time_s, pose)| (time_s + shift_s, pose)).collect()
}

/// The lens that is sent. `None` if it is unknown, or if it changes.
fn lens(shot: &Shot, quiet: bool) -> Option<LensState> {
    let geometry = shot.known_geometry_at(0)?;
    let camera = shot.camera();
    let frames = 0..shot.recording.frame_count();
    if frames.into_iter().any(|frame| shot.known_geometry_at(frame).is_some_and(|other| other != geometry)) {
        warn(quiet, "the camera is not the same in all frames: no lens is sent");
        return None;
    }
    let distortion = &geometry.distortion;
    if distortion.model.is_fisheye() {
        warn(quiet, "OpenTrackIO has no fisheye: the lens is sent without its distortion");
    }
    if matches!(distortion.model, LensModel::OpencvRational | LensModel::Fov | LensModel::StMap) {
        warn(quiet, "the lens is sent without its distortion: its model is not sent; expected opencv");
    }
    Some(LensState::of(&geometry, &camera.lens, &camera.exposure, 1.0 / shot.recording.frame_interval_s))
}

fn notes(shot: &Shot, args: &Args) {
    let recording = &shot.recording;
    if !recording.kind.is_metric() && recording.metres_per_unit == 1.0 {
        warn(args.quiet, "the recording's unit is assumed to be a metre; --metres-per-unit sets its length");
    }
    if let Some(up) = recording.up.filter(|up| up.distance(DVec3::Z) > 1e-3) {
        let protocol = match Protocol::of(&args.to) {
            Some(Protocol::FreeD) => "FreeD",
            _ => "OpenTrackIO",
        };
        let [x, y, z] = up.to_array().map(|v| fixed(v, 2));
        let text = format!("up is {x} {y} {z} in the recording and z in {protocol}: positions are sent unchanged");
        warn(args.quiet, &text);
    }
    if recording.track.poses_in_frame_time().next().is_some_and(|pose| pose.0 < 0.0) {
        warn(
            args.quiet,
            "the recording begins before time 0, which streams cannot represent: its times are shifted by whole \
             seconds",
        );
    }
}
