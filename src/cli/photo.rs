//! `locard photo`.

use std::path::PathBuf;

use anyhow::Result;

use super::labels::{LabelArgs, MarkArgs, Trace};
use super::which::Which;
use super::{analysis, export_error, light, print_status, progress_of, warn};
use locard_engine::camera::Film;
use locard_engine::camera::metering::Mode;
use locard_engine::gpu::Gpu;
use locard_engine::label::DigitalSourceType;
use locard_engine::photo::{self, Focus, PhotoError, PhotoEvent, PhotoRequest};
use locard_engine::provenance::SettingsRecord;
use locard_engine::shot::{AnalysisChoice, Shot};

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub light: light::LightArgs,
    /// A .glb or .gltf in the recording's world coordinates, or a scene.toml
    #[arg(long)]
    pub scene: PathBuf,
    /// p (program), a (aperture priority), s (shutter priority), m (manual); by default it follows
    /// from the given settings
    #[arg(long)]
    pub mode: Option<Mode>,
    /// The focal length in mm; by default the one that shows as much of the recorded picture as the
    /// film's shape allows
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = focal_length)]
    pub focal: Option<f64>,
    /// The middle of the photograph: a place in the recorded picture, in its pixels, or an object
    /// of the scene by its name, which then fills half of the photograph unless --focal or --across
    /// is given
    #[arg(long, value_name = "X,Y|OBJECT")]
    pub aim: Option<String>,
    /// Width of the photograph in columns of the recorded picture
    #[arg(long, value_name = "PX", conflicts_with = "focal", value_parser = columns)]
    pub across: Option<f64>,
    /// The camera stands still while the shutter is open, however long: real and virtual objects
    /// are as blurred as in the frame (the default without --hand-held)
    #[arg(long)]
    pub tripod: bool,
    /// The camera moves while the shutter is open, as the recording's did: its frames are summed
    #[arg(long, conflicts_with = "tripod")]
    pub hand_held: bool,
    /// Focus: a distance in metres, inf, or auto (the middle of the photograph)
    #[arg(long, default_value = "auto", allow_hyphen_values = true, value_parser = focus)]
    pub focus: Focus,
    /// The film: 36x24, aps-c, aps-c-canon, micro-4/3, 1in, 1/2.3in, 6x6 or WIDTHxHEIGHT in mm; by
    /// default the recording's
    #[arg(long)]
    pub film: Option<Film>,
    /// Width of the photograph; by default the number of recorded pixels across it
    #[arg(long, value_name = "PX")]
    pub width: Option<u32>,
    /// A series over the range of one setting, and a contact sheet
    #[arg(long, value_enum)]
    pub bracket: Option<BracketArg>,
    /// The subject, for the photo log: an object of the scene by its name; by default the object of
    /// --aim, or the evidence nearest to the middle
    #[arg(long, value_name = "OBJECT")]
    pub subject: Option<String>,
    /// The number in the photo log; by default that of the replaced photograph, or the next one in
    /// the folder
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub number: Option<u32>,
    #[command(flatten)]
    pub which: Which,
    /// Seed of the grain
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// A .jpg or .png; of a series, NAME-1.jpg and so on, and NAME-sheet.jpg
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub output: PathBuf,
    #[command(flatten)]
    mark: MarkArgs,
    #[command(flatten)]
    labels: LabelArgs,
    /// Replace pictures that exist
    #[arg(long)]
    pub force: bool,
    /// No warnings
    #[arg(long, short)]
    pub quiet: bool,
}

/// The dial that a series varies, as `--bracket` names it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum BracketArg {
    /// f/2.8 to f/22
    Aperture,
    /// Three stops to both sides
    Shutter,
    /// ISO 100 to 25600
    Iso,
    /// From half the distance to twice
    Focus,
}

impl From<BracketArg> for photo::Bracket {
    fn from(bracket: BracketArg) -> Self {
        match bracket {
            BracketArg::Aperture => Self::Aperture,
            BracketArg::Shutter => Self::Shutter,
            BracketArg::Iso => Self::Iso,
            BracketArg::Focus => Self::Focus,
        }
    }
}

impl Args {
    /// The shot of a command that was run before, with a given analysis, and its settings.
    pub fn reopen(&self, analysis: AnalysisChoice) -> Result<(Shot, SettingsRecord)> {
        let shot = self.light.reopen(Some(self.scene.clone()), self.which.leaves_registration(), analysis)?;
        let shot = self.with_settings(shot)?;
        let settings = self.request().settings_record(&shot);
        Ok((shot, settings))
    }

    /// Applies the seed and the choice of effects.
    fn with_settings(&self, mut shot: Shot) -> Result<Shot> {
        shot.settings.seed = self.seed;
        self.which.apply(&mut shot.settings)?;
        Ok(shot)
    }

    pub fn request(&self) -> PhotoRequest {
        PhotoRequest {
            frame: self.light.frame,
            mode: self.mode,
            f_number: self.light.aperture,
            time_s: self.light.shutter,
            iso: self.light.iso,
            compensation_ev: self.light.compensation,
            lux: self.light.lux,
            focal_length_mm: self.focal,
            aim: self.aim.clone(),
            across_px: self.across,
            hand_held: self.hand_held,
            focus: self.focus,
            film: self.film,
            width_px: self.width,
            bracket: self.bracket.map(Into::into),
            output: self.output.clone(),
            mark: self.mark.mark.clone(),
            labelled: self.labels.is_labelled(),
            force: self.force,
            subject: self.subject.clone(),
            number: self.number,
        }
    }
}

fn focus(text: &str) -> Result<Focus, String> {
    let metres = match text.trim().trim_end_matches('m').trim_end() {
        "auto" => return Ok(Focus::Auto),
        "inf" | "infinity" => Some(f64::INFINITY),
        number => number.parse().ok().filter(|m: &f64| (0.01..=1e5).contains(m)),
    };
    metres.map(Focus::Metres).ok_or_else(|| "expected auto, inf, or 0.01 to 100000 m".to_owned())
}

fn focal_length(text: &str) -> Result<f64, String> {
    let mm = text.trim().trim_end_matches("mm").trim_end().parse().ok().filter(|mm| (1.0..=5000.0).contains(mm));
    mm.ok_or_else(|| "expected 1 to 5000 mm".to_owned())
}

fn columns(text: &str) -> Result<f64, String> {
    let px = text.trim().trim_end_matches("px").trim_end().parse().ok().filter(|px: &f64| (1.0..=1e6).contains(px));
    px.ok_or_else(|| "expected 1 to as many columns as the recording has (px)".to_owned())
}

pub fn run(args: &Args) -> Result<()> {
    let shot = args.light.open(Some(args.scene.clone()), args.which.leaves_registration())?;
    let shot = args.with_settings(shot)?;
    let traces = std::iter::once(Trace::Exif).chain(args.mark.trace());
    args.labels.warn(DigitalSourceType::CompositeWithSyntheticElements, traces);
    analysis::print_hints(args.quiet, &shot, args.which.leaves_registration());
    let bar = progress_of(args.quiet, 100, "{msg} {wide_bar} {percent} %, {elapsed}");
    let taken = args.request().take(shot, Gpu::open, &mut |event| {
        match event {
            PhotoEvent::Warning(text) => bar.suspend(|| warn(args.quiet, &text)),
            PhotoEvent::Taking { number, of, share } => {
                bar.set_message(format!("photograph {number} of {of}"));
                bar.set_position((100.0 * share) as u64);
            }
            PhotoEvent::Written { path, settings } => {
                let colon = if settings.is_empty() { "" } else { ": " };
                bar.suspend(|| print_status(args.quiet, &format!("{}{colon}{settings}", path.display())));
            }
        }
        true
    });
    bar.finish_and_clear();
    taken.map_err(|error| match error {
        PhotoError::Export(error) => export_error(error),
        error => error.into(),
    })
}
