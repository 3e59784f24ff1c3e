//! `locard calibrate`.

mod camera;
mod existing;
mod sharpness;
mod watched;

use std::io::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;

use anyhow::{Result, bail};

pub use existing::existing;
use existing::{pictures_beside, unreadable};

use locard_engine::calibrate::{
    NoiseCalibration, NoiseOptions, SceneMotion, moving_noise_from_paths, noise_from_paths,
};
use locard_engine::export::Inputs;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::text::count;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Focal length, principal point and distortion, from pictures of a chessboard or of printed
    /// tags
    Camera(camera::Args),
    /// Noise by channel and intensity, from scenes at rest or from a moving camera's textureless
    /// places
    Noise(NoiseArgs),
    /// The blur of lens and sensor, from straight edges in a picture
    Sharpness(sharpness::Args),
}

#[derive(clap::Args)]
struct NoiseArgs {
    /// Pictures of one static scene, or folders of one static scene each; with --moving any
    /// pictures, folders and recordings
    #[arg(required = true)]
    frames: Vec<PathBuf>,
    /// The camera moved: take the noise from textureless places of its pictures, less exact than
    /// from scenes at rest
    #[arg(long, conflicts_with = "mean")]
    moving: bool,
    /// The scene's known mean, for single noisy frames; repeated for each of them
    #[arg(long)]
    mean: Vec<PathBuf>,
    /// The profile to write; its other tables are kept
    #[arg(short = 'o', long = "output", value_name = "PROFILE")]
    output: PathBuf,
    /// Replace the table [camera.noise] of a profile that exists
    #[arg(long)]
    force: bool,
}

pub fn run(args: Args) -> Result<()> {
    match args.what {
        What::Camera(args) => camera::run(&args),
        What::Noise(args) => noise(args),
        What::Sharpness(args) => sharpness::run(&args),
    }
}

fn noise(args: NoiseArgs) -> Result<()> {
    // Checked before the work starts, so that no files of the user are lost.
    let failed = |what: &str| format!("{}: {what}", args.output.display());
    let read = args.frames.iter().chain(&args.mean);
    if let Some(problem) = unreadable(read.clone()).1.into_iter().next() {
        return Err(problem.into());
    }
    Inputs::default().and(read.clone()).and(&pictures_beside(read)).check_file(&args.output)?;
    let (is_there, mut profile) = existing(&args.output)?;
    if profile.has_noise() && !args.force {
        bail!(failed("has a table [camera.noise] already; it is kept unless --force is given"));
    }
    let options = NoiseOptions::default();
    let bar = super::progress(false, 0);
    let mut shown = |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    };
    let calibration = if args.moving {
        moving_noise_from_paths(&args.frames, &options, &mut shown)
    } else {
        noise_from_paths(&args.frames, &args.mean, &options, &mut shown)
    };
    bar.finish_and_clear();
    let calibration = calibration?;
    profile.set_noise(&calibration.profile, &origin(&calibration));
    write_atomically(&args.output, is_there, |file| file.write_all(profile.to_string().as_bytes()))?;
    write!(std::io::stdout().lock(), "{calibration}")?;
    Ok(())
}

/// The method by which the noise was found.
fn origin(calibration: &NoiseCalibration) -> String {
    let frames = count(calibration.frames, "frame");
    match calibration.motion {
        SceneMotion::Resting => format!("`, from {frames} of {} at rest.", count(calibration.scenes, "scene")),
        SceneMotion::Moving => format!(" --moving`, from textureless places of {frames} of a moving camera."),
    }
}
