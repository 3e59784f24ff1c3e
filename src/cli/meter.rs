//! `locard meter`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};

use crate::camera::exposure::{Settings, scene_ev};
use crate::camera::metering::{Limits, Metered, Mode, PictureLight, iso_for, meter};
use crate::camera::{Exposure, Lens, stops};
use crate::compositor::Settings as Effects;
use crate::profile::Rig;
use crate::recording::{OpenOptions, Recording};
use crate::words::short;

/// What is taken where nobody says: EVs are usually told for it.
const USUAL_ISO: f64 = 100.0;
/// From this part of clipped pixels on, the picture's mean says too little.
const CLIPPED: f64 = 0.01;

#[derive(clap::Args)]
pub struct Args {
    /// The recording
    recording: PathBuf,
    /// Which of its frames
    #[arg(long, value_name = "N")]
    frame: usize,
    /// The light on the scene, in lux; else it is estimated from the picture and its settings
    #[arg(long, value_name = "LX", allow_hyphen_values = true, value_parser = lux)]
    lux: Option<f64>,
    /// The f-number to meter for, as in 2.8; else the recording's
    #[arg(long, value_name = "F", allow_hyphen_values = true, value_parser = stops::parse_f_number)]
    aperture: Option<f64>,
    /// The shutter time to meter for, as in 1/60; else the recording's
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = stops::parse_shutter_s)]
    shutter: Option<f64>,
    /// The film speed to meter for, 100 to 25600; else the recording's
    #[arg(long, allow_hyphen_values = true, value_parser = stops::parse_iso)]
    iso: Option<f64>,
    /// Stops brighter than correct that are wanted, -5 to 5
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_hyphen_values = true, value_parser = compensation)]
    compensation: f64,
    /// The camera, where the recording does not know it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// What the recording was taken with, as in camera.lens.f_number=4
    #[arg(long, value_name = "TABLE.NAME=VALUE")]
    set: Vec<String>,
    /// Length of a nerfstudio or COLMAP unit
    #[arg(long, default_value_t = 1.0, value_name = "M")]
    metres_per_unit: f64,
    /// As JSON
    #[arg(long)]
    json: bool,
}

fn number_in(text: &str, accepts: impl Fn(f64) -> bool, accepted: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|v| accepts(*v)).ok_or_else(|| format!("{text} is refused: accepted is {accepted}"))
}

fn lux(text: &str) -> Result<f64, String> {
    number_in(text, |v| v > 0.0 && v <= 1e7, "more than 0 and up to 10000000 lux (500 in a room, 100000 in the sun)")
}

fn compensation(text: &str) -> Result<f64, String> {
    number_in(text, |v| v.abs() <= 5.0, "-5 to 5")
}

/// Aperture, time and film speed as far as they are known.
#[derive(Clone, Copy, Default)]
struct Known {
    f_number: Option<f64>,
    time_s: Option<f64>,
    iso: Option<f64>,
}

impl Known {
    fn or(self, other: Self) -> Self {
        Self {
            f_number: self.f_number.or(other.f_number),
            time_s: self.time_s.or(other.time_s),
            iso: self.iso.or(other.iso),
        }
    }

    /// What a profile or `--set` says; an instant or a pinhole is no exposure.
    fn of(rig: &Rig) -> Self {
        let time_s = rig.exposure.time_s.filter(|t| *t > 0.0);
        // Where a diameter stands instead, the lens knows what that makes.
        let lens = rig.camera().geometry.and_then(|geometry| rig.lens.thin_lens(&geometry).ok().flatten());
        let f_number = rig.lens.f_number.or(lens.map(|lens| lens.f_number()));
        Self { f_number, time_s, iso: rig.exposure.iso }
    }

    fn settings(self) -> Option<Settings> {
        let settings = Settings { f_number: self.f_number?, time_s: self.time_s?, iso: self.iso? };
        Some(settings.exact())
    }

    fn missing(self) -> Vec<&'static str> {
        let named = [(self.f_number, "the f-number"), (self.time_s, "the shutter time"), (self.iso, "the film speed")];
        named.into_iter().filter(|(known, _)| known.is_none()).map(|(_, name)| name).collect()
    }
}

/// The light on the scene, and where that is known from.
struct SceneLight {
    lux: f64,
    picture: Option<PictureLight>,
}

pub fn run(args: &Args) -> Result<()> {
    let options = OpenOptions { metres_per_unit: args.metres_per_unit, ..OpenOptions::default() };
    let recording = Recording::open(&args.recording, &options)?;
    let frame = args.frame;
    if frame >= recording.frame_count() {
        bail!("--frame {frame}: the recording has the frames 0..{}", recording.frame_count());
    }
    let (mut rig, mut effects) = (Rig::default(), Effects::default());
    if let Some(path) = args.profile.as_ref().or(recording.camera_profile.as_ref()) {
        rig.read(path, &mut effects)?;
    }
    if let Some(geometry) = recording.geometry_at_frame(frame) {
        rig.default_geometry(geometry);
    }
    // What is typed stands above what the picture says, that above the profile.
    let profile = Known::of(&rig);
    (rig.lens, rig.exposure) = (Lens::default(), Exposure::default());
    for text in &args.set {
        rig.set_text(text, &mut effects)?;
    }
    let typed = Known::of(&rig);
    let said = recording.exposure.get(frame).copied().unwrap_or_default();
    let photo = said.photo;
    let recorded = Known { f_number: photo.f_number, time_s: photo.time_s.or(said.time_s), iso: photo.iso };
    let taken = typed.or(recorded).or(profile);
    let asked = Known { f_number: args.aperture, time_s: args.shutter, iso: args.iso }.or(taken);

    let scene = scene_light(args, &recording, &rig, taken)?;
    let report = Report { args, asked, scene, limits: limits(&rig, asked) };
    let mut out = std::io::stdout().lock();
    if args.json {
        let json = report.json(recording.timestamps_s.get(frame).copied().unwrap_or_default());
        writeln!(out, "{}", serde_json::to_string_pretty(&json)?)?;
        return Ok(());
    }
    report.print(&mut out)
}

fn scene_light(args: &Args, recording: &Recording, rig: &Rig, taken: Known) -> Result<SceneLight> {
    if let Some(lux) = args.lux {
        return Ok(SceneLight { lux, picture: None });
    }
    let Some(settings) = taken.settings() else {
        bail!(
            "nothing says how bright the scene is: {} of frame {} not known (EXIF, a profile or --set \
             camera.lens.f_number=…, camera.exposure.time_s=…, camera.exposure.iso=…); give that, or the light by --lux",
            taken.missing().join(" and "),
            if taken.missing().len() == 1 { format!("{} is", args.frame) } else { format!("{} are", args.frame) }
        );
    };
    let frame = recording.frames(args.frame..args.frame + 1)?.next().context("the frame cannot be read")??;
    let picture = PictureLight::of(&frame.pixels, &rig.response);
    let lux = settings.illuminance_of_picture_lx(picture.mean).with_context(|| {
        format!("frame {} is black: it does not tell how bright the scene is; give the light by --lux", args.frame)
    })?;
    Ok(SceneLight { lux, picture: Some(picture) })
}

/// What the camera can choose from: a usual lens', and the person's own aperture.
fn limits(rig: &Rig, asked: Known) -> Limits {
    let mut limits = Limits::default();
    if let Some(f_number) = asked.f_number {
        limits.widest_f_number = limits.widest_f_number.min(f_number);
        limits.narrowest_f_number = limits.narrowest_f_number.max(f_number);
    }
    match rig.camera().geometry {
        Some(geometry) => {
            // As long as a 35 mm film's side by the picture's longer one.
            let i = &geometry.intrinsics;
            limits.for_focal_length(36.0 * i.fx_px / f64::from(i.width_px.max(i.height_px)))
        }
        None => limits,
    }
}

struct Report<'a> {
    args: &'a Args,
    /// The settings to meter for.
    asked: Known,
    scene: SceneLight,
    limits: Limits,
}

impl Report<'_> {
    fn iso(&self) -> f64 {
        self.asked.iso.unwrap_or(USUAL_ISO)
    }

    /// Settings that would expose correctly, for each mode of which what it needs is known.
    fn proposals(&self) -> Vec<(Mode, Metered)> {
        let (lux, plus) = (self.scene.lux, self.args.compensation);
        let possible = |mode: &Mode| match mode {
            Mode::Program => true,
            Mode::AperturePriority => self.asked.f_number.is_some(),
            Mode::ShutterPriority => self.asked.time_s.is_some(),
            Mode::Manual => self.asked.f_number.is_some() && self.asked.time_s.is_some(),
        };
        // What a mode chooses itself is left out of account.
        let set = Settings {
            f_number: self.asked.f_number.unwrap_or(1.0),
            time_s: self.asked.time_s.unwrap_or(1.0),
            iso: self.iso(),
        }
        .exact();
        let propose = |mode: Mode| match mode {
            // Aperture and time stay; what is left is the film.
            Mode::Manual => iso_for(lux, set, plus),
            _ => meter(mode, lux, set, plus, &self.limits),
        };
        Mode::ALL.into_iter().filter(possible).map(|mode| (mode, propose(mode))).collect()
    }

    fn print(&self, out: &mut impl Write) -> Result<()> {
        let (lux, iso) = (self.scene.lux, self.iso());
        let source = match self.scene.picture {
            Some(light) => format!("estimated from the picture, whose mean light is {:.1} %", 100.0 * light.mean),
            None => "as given".to_owned(),
        };
        writeln!(out, "scene      {} lx, {source}", short(lux.round().max(0.01)))?;
        let at_100 = scene_ev(lux, USUAL_ISO);
        let speed = stops::format_iso(iso);
        let taken = if self.asked.iso.is_none() { " (taken, for no film speed is known)" } else { "" };
        writeln!(out, "           EV {:.2} at {speed}{taken}, EV {at_100:.2} at ISO 100", scene_ev(lux, iso))?;
        match self.asked.settings() {
            Some(settings) => {
                writeln!(out, "settings   {settings}: EV {:.2}", settings.ev())?;
                writeln!(out, "exposed    {}", over(settings.over_ev(lux)))?;
            }
            None => writeln!(out, "settings   not known: {}", self.asked.missing().join(", "))?,
        }
        if self.args.compensation != 0.0 {
            writeln!(out, "wanted     {}", over(self.args.compensation))?;
        }
        for (mode, metered) in self.proposals() {
            let name = match mode {
                Mode::Program => "program",
                Mode::AperturePriority => "aperture",
                Mode::ShutterPriority => "shutter",
                Mode::Manual => "manual",
            };
            let rest = match metered.over_ev {
                off if off.abs() <= 1.0 / 6.0 + 1e-6 => String::new(),
                off => format!("; still {}", over(off)),
            };
            writeln!(out, "{} {name:8} {}{rest}", mode.letter(), metered.settings)?;
        }
        if let Some(light) = self.scene.picture.filter(|light| light.clipped > CLIPPED) {
            let share = 100.0 * light.clipped;
            writeln!(out, "odd        {share:.0} % of the pixels are clipped: the scene is brighter than estimated")?;
        }
        Ok(())
    }

    fn json(&self, timestamp_s: f64) -> Value {
        let (lux, iso) = (self.scene.lux, self.iso());
        let values = |s: &Settings| json!({"text": s.to_string(), "f_number": s.f_number, "time_s": s.time_s, "iso": s.iso, "ev": s.ev()});
        let settings = self.asked.settings();
        let proposals: Vec<Value> = self
            .proposals()
            .iter()
            .map(|(mode, m)| {
                json!({"mode": mode.letter().to_string(), "settings": values(&m.settings), "over_ev": m.over_ev})
            })
            .collect();
        json!({
            "frame": self.args.frame,
            "timestamp_s": timestamp_s,
            "scene": {
                "illuminance_lx": lux,
                "source": if self.scene.picture.is_some() { "picture" } else { "given" },
                "mean_light": self.scene.picture.map(|light| light.mean),
                "clipped": self.scene.picture.map(|light| light.clipped),
                "ev": scene_ev(lux, iso),
                "ev_at_iso_100": scene_ev(lux, USUAL_ISO),
            },
            "settings": settings.as_ref().map(values),
            "missing": self.asked.missing(),
            "over_ev": settings.map(|s| s.over_ev(lux)),
            "compensation_ev": self.args.compensation,
            "proposals": proposals,
        })
    }
}

/// As in "0.50 stops over".
fn over(ev: f64) -> String {
    match ev {
        ev if ev.abs() < 0.005 => "correctly".to_owned(),
        ev if ev > 0.0 => format!("{ev:.2} stops over"),
        ev => format!("{:.2} stops under", -ev),
    }
}
