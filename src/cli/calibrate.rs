//! `locard calibrate`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use crate::calibrate::{NoiseOptions, noise_from_paths};
use crate::profile_noise::noise_table_toml;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Noise by channel and intensity, from static scenes
    Noise(NoiseArgs),
}

#[derive(clap::Args)]
struct NoiseArgs {
    /// Pictures of one static scene, or folders of one static scene each
    #[arg(required = true)]
    frames: Vec<PathBuf>,
    /// The scene's known mean, for single noisy frames; once for each of them
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
    let What::Noise(args) = args.what;
    // Before the work: what the user has is not lost.
    let mut profile = match std::fs::read_to_string(&args.output) {
        Ok(text) => text.parse::<toml::Table>().with_context(|| format!("{}: not TOML", args.output.display()))?,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => toml::Table::new(),
        Err(error) => return Err(error).with_context(|| format!("{}: cannot be read", args.output.display())),
    };
    profile.entry("version").or_insert(toml::Value::Integer(1));
    let camera = profile.entry("camera").or_insert_with(|| toml::Value::Table(toml::Table::new()));
    let toml::Value::Table(camera) = camera else {
        bail!("{}: camera is not a table", args.output.display());
    };
    if camera.contains_key("noise") && !args.force {
        bail!("{}: has a table [camera.noise] already; it is kept unless --force is given", args.output.display());
    }
    let calibration = noise_from_paths(&args.frames, &args.mean, &NoiseOptions::default())?;
    camera.insert("noise".to_owned(), toml::Value::Table(noise_table_toml(&calibration.profile)));
    let text = toml::to_string(&profile)?;
    let partial = args.output.with_extension("toml.partial");
    std::fs::write(&partial, text)
        .and_then(|()| std::fs::rename(&partial, &args.output))
        .with_context(|| format!("{}: cannot be written", args.output.display()))?;
    write!(std::io::stdout().lock(), "{calibration}")?;
    Ok(())
}
