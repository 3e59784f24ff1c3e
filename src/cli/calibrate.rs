//! `locard calibrate`.

mod camera;
mod existing;
mod sharpness;
mod watched;

use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};

pub use existing::existing;
use existing::{pictures_beside, unreadable};

use locard_engine::calibrate::{
    ExampleCalibration, MeasuredNoise, NoiseCalibration, NoiseOptions, NoiseSource, SceneMotion, noise_from_paths,
};
use locard_engine::example_noise::{NoiseModelFile, file as model_file};
use locard_engine::export::Inputs;
use locard_engine::memo::ByAddress;
use locard_engine::profile::ProfileFile;
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
    /// Noise by channel and intensity, and by example: from scenes at rest, from stretches at
    /// rest of recordings and videos, or from textureless places of any pictures
    Noise(NoiseArgs),
    /// The blur of lens and sensor, from straight edges in a picture
    Sharpness(sharpness::Args),
}

#[derive(clap::Args)]
struct NoiseArgs {
    /// Pictures of one static scene; folders, recordings and videos of one scene each. If nothing
    /// is at rest, the noise is taken from textureless places
    #[arg(required = true)]
    frames: Vec<PathBuf>,
    /// Take the noise from textureless places, even of pictures at rest
    #[arg(long, conflicts_with = "mean")]
    moving: bool,
    /// The scene's known mean, for single noisy frames; repeated for each of them
    #[arg(long)]
    mean: Vec<PathBuf>,
    /// The profile to write; its other tables are kept. Noise by example is written beside it, as a
    /// file that ends in .locnoise
    #[arg(short = 'o', long = "output", value_name = "PROFILE")]
    output: PathBuf,
    /// Write the table alone, without noise by example
    #[arg(long)]
    no_example: bool,
    /// Replace the table [camera.noise] of a profile that exists, and its noise by example
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

/// Checks before the work that no file of the user would be lost. Returns whether the profile
/// exists, and the profile.
fn check_outputs(args: &NoiseArgs, example_file: &Path) -> Result<(bool, ProfileFile)> {
    let failed = |what: &str| format!("{}: {what}", args.output.display());
    let read = args.frames.iter().chain(&args.mean);
    if let Some(problem) = unreadable(read.clone()).1.into_iter().next() {
        return Err(problem.into());
    }
    let inputs = Inputs::default().and(read.clone()).and(&pictures_beside(read));
    inputs.check_file(&args.output)?;
    if !args.no_example {
        inputs.check_file(example_file)?;
    }
    let (is_there, profile) = existing(&args.output)?;
    if profile.has_noise() && !args.force {
        bail!(failed("has a table [camera.noise] already, and is kept (--force replaces it)"));
    }
    if example_file == args.output {
        bail!(failed("ends as a file of noise by example; name the profile *.toml"));
    }
    if example_file.exists() && !args.force && !args.no_example {
        bail!("{}: exists already, and is kept (--force replaces it)", example_file.display());
    }
    Ok((is_there, profile))
}

fn noise(args: NoiseArgs) -> Result<()> {
    let example_file = args.output.with_extension(EXAMPLE_EXTENSION);
    let (is_there, mut profile) = check_outputs(&args, &example_file)?;
    let options = NoiseOptions { with_example: !args.no_example, ..NoiseOptions::default() };
    let bar = super::progress(false, 0);
    let mut shown = |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    };
    let source = if args.moving {
        NoiseSource::Textureless
    } else if args.mean.is_empty() {
        NoiseSource::Best
    } else {
        NoiseSource::KnownMeans(&args.mean)
    };
    let outcome = noise_from_paths(&args.frames, source, &options, &mut shown);
    bar.finish_and_clear();
    let MeasuredNoise { table: mut calibration, example } = outcome?;
    let report = match example {
        Some(Ok(example)) => {
            let written = WrittenExample::write(example, &example_file, args.force)?;
            calibration.profile.example = Some(written.example);
            written.report
        }
        Some(Err(reason)) => format!("no noise by example: {reason}\n"),
        None => String::new(),
    };
    profile.set_noise(&calibration.profile, &origin(&calibration), &args.output);
    write_atomically(&args.output, is_there, |file| file.write_all(profile.to_string().as_bytes()))?;
    write!(std::io::stdout().lock(), "{calibration}{report}")?;
    Ok(())
}

const EXAMPLE_EXTENSION: &str = "locnoise";

/// Noise by example in its file.
struct WrittenExample {
    example: NoiseModelFile,
    report: String,
}

impl WrittenExample {
    fn write(calibration: ExampleCalibration, file: &Path, overwrite: bool) -> Result<Self> {
        let bytes = model_file::to_bytes(&calibration.model)?;
        write_atomically(file, overwrite, |writer| writer.write_all(&bytes))?;
        let report = format!("{calibration}{}: {:.1} MB\n", file.display(), bytes.len() as f64 / 1e6);
        let model = ByAddress(Arc::new(calibration.model));
        Ok(Self { example: NoiseModelFile { file: file.to_owned(), model }, report })
    }
}

/// The method by which the noise was found.
fn origin(calibration: &NoiseCalibration) -> String {
    let frames = count(calibration.frames, "frame");
    match calibration.motion {
        SceneMotion::Resting => format!("`, from {frames} of {} at rest.", count(calibration.scenes, "scene")),
        SceneMotion::Moving => format!("`, from textureless places of {frames} of a moving camera."),
    }
}
