//! `locard calibrate sharpness`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use glam::DVec2;

use super::existing::existing;
use crate::cli::pick::numbers;
use locard_engine::calibrate::is_picture;
use locard_engine::calibrate::sharpness::{PARAMETER, combine, edge, notes};
use locard_engine::camera::Response;
use locard_engine::compositor::Settings;
use locard_engine::export::Inputs;
use locard_engine::frame::Frame;
use locard_engine::measure::slanted::SlantedEdge;
use locard_engine::params::Value;
use locard_engine::pixels::{Pixels, Rect};
use locard_engine::profile::Rig;
use locard_engine::recording::OpenOptions;
use locard_engine::shot::{Shot, ShotOptions};
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::still;
use locard_engine::text::{fixed, number};

#[derive(clap::Args)]
pub struct Args {
    /// A recording, or a picture (.png, .jpg)
    input: PathBuf,
    /// The recording's frame with the edge, preferably one at rest
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = crate::cli::frame_number)]
    frame: Option<usize>,
    /// A rectangle that one straight edge crosses: column and row of two corners; may be repeated
    #[arg(long, value_name = "X0,Y0,X1,Y1", required = true, value_parser = corners, allow_hyphen_values = true)]
    edge: Vec<[f64; 4]>,
    /// The camera with its response curve, if the recording lacks it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// The profile to write; everything else in it is kept
    #[arg(short = 'o', long = "output", value_name = "PROFILE")]
    output: Option<PathBuf>,
    /// Replace the sharpness of a profile that has one
    #[arg(long)]
    force: bool,
}

/// Columns and rows of two opposite corners, px.
fn corners(text: &str) -> Result<[f64; 4], String> {
    numbers(text, "600,380,680,460")
}

/// The picture with the edges.
enum EdgeSource {
    Picture(Response, Pixels),
    Recording(Box<Shot>, Box<Frame>),
}

impl EdgeSource {
    fn open(args: &Args) -> Result<Self> {
        if is_picture(&args.input) {
            if args.frame.is_some() {
                bail!("{}: --frame needs a recording, but this is a picture", args.input.display());
            }
            let mut rig = Rig::default();
            if let Some(profile) = &args.profile {
                rig.read(profile, &mut Settings::default())?;
            }
            return Ok(Self::Picture(rig.camera().response, still::read_pixels(&args.input)?));
        }
        let shot_options = ShotOptions { profile: args.profile.clone(), ..ShotOptions::default() };
        let shot = Shot::open(&args.input, &OpenOptions::default(), &shot_options)?;
        let Some(frame) = args.frame else { bail!("which frame of the recording? Give --frame N") };
        crate::cli::check_frame(frame, shot.recording.frame_count())?;
        let frame = shot.read(frame)?;
        Ok(Self::Recording(Box::new(shot), Box::new(frame)))
    }

    /// Motion of the edge in a region during the exposure, px, if it is known.
    fn moved_px(&self, region: Rect) -> Option<DVec2> {
        let Self::Recording(shot, frame) = self else { return None };
        let at = DVec2::new(f64::from(region.x0 + region.x1), f64::from(region.y0 + region.y1)) / 2.0;
        let surface = shot.surface_at(frame, at).ok()?;
        shot.motion_px(frame, at, &surface).ok()
    }

    fn measure(&self, region: Rect, moved_px: [f64; 2]) -> Result<SlantedEdge> {
        let measurement = match self {
            Self::Picture(response, pixels) => edge(pixels, response, region, moved_px)?,
            Self::Recording(shot, frame) => edge(&frame.pixels, &shot.camera().response, region, moved_px)?,
        };
        Ok(measurement)
    }
}

pub fn run(args: &Args) -> Result<()> {
    let (table, name) = PARAMETER;
    let source = EdgeSource::open(args)?;
    let output = args.output.as_deref().map(|path| Ok::<_, anyhow::Error>((path, existing(path)?))).transpose()?;
    if let Some((path, _)) = &output {
        Inputs::default().and([&args.input]).check_file(path)?;
        if let Some(present) = present(path)?.filter(|_| !args.force) {
            bail!(
                "{}: has {table}.{name} = {} already; it is kept (--force replaces it)",
                path.display(),
                number(present)
            );
        }
    }
    let mut out = std::io::stdout().lock();
    let mut edges = Vec::new();
    for corners in &args.edge {
        let [x0, y0, x1, y1] = corners.map(|c| c.clamp(-1e9, 1e9).round() as i32);
        let region = Rect::new(x0.min(x1), y0.min(y1), x0.max(x1), y0.max(y1));
        let moved = source.moved_px(region);
        let moved_px = moved.unwrap_or_default().to_array();
        let place = corners.map(number).join(",");
        let measurement = source.measure(region, moved_px).with_context(|| format!("--edge {place}"))?;
        let percent = |share: f64| fixed(100.0 * share, 1);
        writeln!(
            out,
            "edge       {place}: σ {} ± {} px; 10-90 % {} px with the pixel's own, slanted by {}°, light {} to {} %",
            fixed(measurement.sigma_px, 3),
            fixed(measurement.uncertainty_px, 3),
            measurement.rise_10_90_px.map_or("?".to_owned(), |rise| fixed(rise, 2)),
            fixed(measurement.slant_deg, 1),
            percent(measurement.dark),
            percent(measurement.bright)
        )?;
        if let Some(moved) = moved {
            let across = (DVec2::from(measurement.normal).dot(moved)).abs();
            writeln!(
                out,
                "           moved by {} px, {} px across the edge: subtracted",
                fixed(moved.length(), 2),
                fixed(across, 2)
            )?;
        }
        for note in notes(&measurement, moved_px) {
            writeln!(out, "note       {note}")?;
        }
        edges.push(measurement);
    }
    let Some(all) = combine(&edges) else { return Ok(()) };
    writeln!(out, "{table}.{name} = {} ± {}", fixed(all.sigma_px, 3), fixed(all.uncertainty_px, 3))?;
    if all.between_px > 0.0 {
        writeln!(
            out,
            "note       the edges differ by {} px, more than by chance: round, defocused or moving edges are softer, \
             and a lens is not equally sharp everywhere",
            fixed(all.between_px, 3)
        )?;
    }
    if let Some((path, (is_there, mut profile))) = output {
        let mut settings = Settings::default();
        let value = (1e3 * all.sigma_px).round() / 1e3;
        if let Some(set) = settings.set(table, name, &Value::Number(value)) {
            set?;
        }
        if let Some(params) = settings.tables().into_iter().find(|params| params.table() == table) {
            profile.set_param(params, name);
        }
        write_atomically(path, is_there, |file| file.write_all(profile.to_string().as_bytes()))?;
    }
    Ok(())
}

/// The sharpness in a profile.
fn present(path: &Path) -> Result<Option<f64>> {
    if !path.exists() {
        return Ok(None);
    }
    let (table, name) = PARAMETER;
    let value = |settings: &Settings| {
        let params = settings.tables().into_iter().find(|params| params.table() == table);
        params.and_then(|params| params.get(name))
    };
    let mut settings = Settings::default();
    Rig::default().read(path, &mut settings)?;
    let shot_options =
        value(&settings).filter(|shot_options| value(&Settings::default()).as_ref() != Some(shot_options));
    Ok(match shot_options {
        Some(Value::Number(number)) => Some(number),
        _ => None,
    })
}
