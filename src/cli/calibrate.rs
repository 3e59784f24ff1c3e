//! `locard calibrate`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, anyhow, bail};

use toml_edit::{DocumentMut, Item, Table, TableLike};

use super::outputs::Inputs;
use crate::calibrate::{Method, NoiseCalibration, NoiseOptions, moving_noise_from_paths, noise_from_paths};
use crate::profile_noise::noise_table_toml;
use crate::sink::{self, atomic::write_atomically};
use crate::words::{count, reason};

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Noise by channel and intensity, from scenes at rest or from a moving camera's textureless places
    Noise(NoiseArgs),
}

#[derive(clap::Args)]
struct NoiseArgs {
    /// Pictures of one static scene, or folders of one static scene each; with --moving any pictures, folders and recordings
    #[arg(required = true)]
    frames: Vec<PathBuf>,
    /// The camera moved: take the noise from textureless places of its pictures, less exact than from scenes at rest
    #[arg(long, conflicts_with = "mean")]
    moving: bool,
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
    let failed = |what: &str| format!("{}: {what}", args.output.display());
    let read = args.frames.iter().chain(&args.mean);
    Inputs::default().and(read.clone()).and(&pictures_beside(read)).check_file(&args.output)?;
    // A profile that is there is added to.
    sink::check_file(&args.output, true)?;
    let (is_there, text) = match std::fs::read_to_string(&args.output) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => (false, "version = 1\n".to_owned()),
        read => (true, read.map_err(|error| anyhow!(failed(&format!("cannot be read: {}", reason(&error)))))?),
    };
    let mut profile: DocumentMut = text.parse().with_context(|| failed("not TOML"))?;
    if noise_of(&mut profile).with_context(|| failed("refused"))?.iter().next().is_some() && !args.force {
        bail!(failed("has a table [camera.noise] already; it is kept unless --force is given"));
    }
    let options = NoiseOptions::default();
    let calibration = if args.moving {
        moving_noise_from_paths(&args.frames, &options)?
    } else {
        noise_from_paths(&args.frames, &args.mean, &options)?
    };
    replace(noise_of(&mut profile)?, &noise_table_toml(&calibration.profile));
    sign(&mut profile, &calibration);
    write_atomically(&args.output, is_there, |file| file.write_all(profile.to_string().as_bytes()))?;
    write!(std::io::stdout().lock(), "{calibration}")?;
    Ok(())
}

/// What lies in those of the inputs that are folders.
fn pictures_beside<'a>(inputs: impl Iterator<Item = &'a PathBuf>) -> Vec<PathBuf> {
    inputs.filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten().map(|entry| entry.path()).collect()
}

/// The table `[camera.noise]`, made where there is none.
fn noise_of(profile: &mut DocumentMut) -> Result<&mut dyn TableLike> {
    let mut camera = Table::new();
    camera.set_implicit(true);
    profile.entry("version").or_insert_with(|| toml_edit::value(1));
    let camera = profile.entry("camera").or_insert(Item::Table(camera));
    let camera = camera.as_table_like_mut().context("camera is not a table")?;
    let noise = camera.entry("noise").or_insert_with(toml_edit::table);
    noise.as_table_like_mut().context("camera.noise is not a table")
}

/// How the line over the table begins that says where its noise came from.
const SIGNATURE: &str = "# By `locard calibrate noise";

/// Says over the table by which method its noise was found, in place of what was said there before.
fn sign(profile: &mut DocumentMut, calibration: &NoiseCalibration) {
    let frames = count(calibration.frames, "frame");
    let how = match calibration.method {
        Method::Resting => format!("`, from {frames} of {} at rest.", count(calibration.scenes, "scene")),
        Method::Moving => format!(" --moving`, from textureless places of {frames} of a moving camera."),
    };
    let noise = profile.get_mut("camera").and_then(|camera| camera.get_mut("noise"));
    let Some(decor) = noise.and_then(Item::as_table_mut).map(Table::decor_mut) else { return };
    let before = decor.prefix().and_then(|prefix| prefix.as_str()).unwrap_or("\n");
    let kept: String = before.split_inclusive('\n').filter(|line| !line.starts_with(SIGNATURE)).collect();
    decor.set_prefix(format!("{kept}{SIGNATURE}{how}\n"));
}

/// Puts new values for old ones; comments and everything else in the file stay as they are.
fn replace(old: &mut dyn TableLike, new: &toml::Table) {
    let gone: Vec<String> =
        old.iter().map(|(key, _)| key.to_owned()).filter(|key| !new.contains_key(key.as_str())).collect();
    for key in gone {
        old.remove(&key);
    }
    for (key, list) in new {
        let numbers = list.as_array().into_iter().flatten().filter_map(toml::Value::as_float);
        let mut value = toml_edit::Value::Array(numbers.collect());
        match old.get_mut(key).and_then(Item::as_value_mut) {
            Some(before) => {
                *value.decor_mut() = before.decor().clone();
                *before = value;
            }
            None => _ = old.insert(key, Item::Value(value)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROFILE: &str = "# mine\nversion = 1 # the only one\n\n[camera]   # a Kinect\nfx_px = 5.250e2\n\n\
        # measured in May\n[camera.noise]\ncode = [0.0] # old\nodd = 3\n\n[noise]\nscale = 1.50  # more\n";

    fn replaced(text: &str) -> String {
        let mut profile: DocumentMut = text.parse().unwrap();
        let noise = "code = [8.0, 24.5]\nsigma_r = [1.0, 2.25]".parse().unwrap();
        replace(noise_of(&mut profile).unwrap(), &noise);
        profile.to_string()
    }

    #[test]
    fn only_the_noise_is_replaced() {
        let expected =
            PROFILE.replace("code = [0.0] # old\nodd = 3\n", "code = [8.0, 24.5] # old\nsigma_r = [1.0, 2.25]\n");
        assert_eq!(replaced(PROFILE), expected);
        let without = PROFILE.replace("# measured in May\n[camera.noise]\ncode = [0.0] # old\nodd = 3\n\n", "");
        let added = replaced(&without);
        assert!(added.contains("[camera.noise]\ncode = [8.0, 24.5]\nsigma_r = [1.0, 2.25]\n"), "{added}");
        for line in without.lines() {
            assert!(added.lines().any(|l| l == line), "{line} is gone:\n{added}");
        }
    }

    #[test]
    fn a_new_profile_has_a_version_and_the_noise() {
        let text = replaced("version = 1\n");
        assert_eq!(text, "version = 1\n\n[camera.noise]\ncode = [8.0, 24.5]\nsigma_r = [1.0, 2.25]\n");
        assert!(
            noise_of(&mut "camera = 3".parse().unwrap()).err().unwrap().to_string().contains("camera is not a table")
        );
    }
}
