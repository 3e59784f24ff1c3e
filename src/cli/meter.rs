//! `locard meter`.

use std::io::Write;

use anyhow::Result;
use serde_json::{Value, json};

use super::light::LightArgs;
use locard_engine::camera::exposure::{ExposureSettings, scene_ev};
use locard_engine::camera::metering::{Limits, MeteredSettings, Mode, iso_for, meter};
use locard_engine::camera::stops;
use locard_engine::shot::{DEFAULT_ISO, PartialExposure, SceneLight};
use locard_engine::text::short;

/// Largest fraction of clipped pixels with a reliable mean of the picture.
const MAX_CLIPPED_FRACTION: f64 = 0.01;

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    light: LightArgs,
    /// As JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let (json, args) = (args.json, &args.light);
    let shot = args.open(None, false)?;
    let frame = args.frame;
    if let Some(geometry) = shot.known_geometry_at(frame) {
        shot.rig.lens.opening(&geometry)?;
    }
    let settings = PartialExposure { f_number: args.aperture, time_s: args.shutter, iso: args.iso }
        .or(shot.exposure_settings(frame));
    let scene = shot.scene_light(frame, args.lux)?;
    let report = MeterReport { args, settings, scene, limits: shot.limits(frame, settings.f_number) };
    let mut out = std::io::stdout().lock();
    if json {
        let json = report.json(shot.recording.timestamps_s.get(frame).copied().unwrap_or_default());
        writeln!(out, "{}", serde_json::to_string_pretty(&json)?)?;
        return Ok(());
    }
    report.print(&mut out)
}

struct MeterReport<'a> {
    args: &'a LightArgs,
    /// The settings to meter for.
    settings: PartialExposure,
    scene: SceneLight,
    limits: Limits,
}

impl MeterReport<'_> {
    fn iso(&self) -> f64 {
        self.settings.iso.unwrap_or(DEFAULT_ISO)
    }

    /// Settings that would expose correctly, for each mode whose inputs are known.
    fn proposals(&self) -> Vec<(Mode, MeteredSettings)> {
        let (lux, plus) = (self.scene.lux, self.args.compensation);
        let possible = |mode: &Mode| match mode {
            Mode::Program => true,
            Mode::AperturePriority => self.settings.f_number.is_some(),
            Mode::ShutterPriority => self.settings.time_s.is_some(),
            Mode::Manual => self.settings.f_number.is_some() && self.settings.time_s.is_some(),
        };
        // The values that a mode chooses itself are ignored.
        let set = ExposureSettings {
            f_number: self.settings.f_number.unwrap_or(1.0),
            time_s: self.settings.time_s.unwrap_or(1.0),
            iso: self.iso(),
        }
        .exact();
        let propose = |mode: Mode| match mode {
            // Aperture and time stay; only the film speed is left.
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
        writeln!(out, "scene      {} lx, {source}", short(if lux < 10.0 { lux } else { lux.round() }))?;
        let at_100 = scene_ev(lux, DEFAULT_ISO);
        let speed = stops::format_iso(iso);
        let taken = if self.settings.iso.is_none() { " (taken, for no film speed is known)" } else { "" };
        writeln!(out, "           EV {:.2} at {speed}{taken}, EV {at_100:.2} at ISO 100", scene_ev(lux, iso))?;
        match self.settings.settings() {
            Some(settings) => {
                writeln!(out, "settings   {settings}: EV {:.2}", settings.ev())?;
                writeln!(out, "exposed    {}", deviation_text(settings.over_ev(lux)))?;
            }
            None => writeln!(out, "settings   not known: {}", self.settings.missing().join(", "))?,
        }
        if self.args.compensation != 0.0 {
            writeln!(out, "requested  {}", deviation_text(self.args.compensation))?;
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
                off => format!("; still {}", deviation_text(off)),
            };
            writeln!(out, "{} {name:8} {}{rest}", mode.letter(), metered.settings)?;
        }
        if let Some(light) = self.scene.picture.filter(|light| light.clipped > MAX_CLIPPED_FRACTION) {
            let share = 100.0 * light.clipped;
            writeln!(out, "odd        {share:.0} % of the pixels are clipped: the scene is brighter than estimated")?;
        }
        Ok(())
    }

    fn json(&self, timestamp_s: f64) -> Value {
        let (lux, iso) = (self.scene.lux, self.iso());
        let values = |s: &ExposureSettings| json!({"text": s.to_string(), "f_number": s.f_number, "time_s": s.time_s, "iso": s.iso, "ev": s.ev()});
        let settings = self.settings.settings();
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
                "ev_at_iso_100": scene_ev(lux, DEFAULT_ISO),
            },
            "settings": settings.as_ref().map(values),
            "missing": self.settings.missing(),
            "over_ev": settings.map(|s| s.over_ev(lux)),
            "compensation_ev": self.args.compensation,
            "proposals": proposals,
        })
    }
}

/// For example "0.50 stops over".
fn deviation_text(ev: f64) -> String {
    match ev {
        ev if ev.abs() < 0.005 => "correctly".to_owned(),
        ev if ev > 0.0 => format!("{ev:.2} stops over"),
        ev => format!("{:.2} stops under", -ev),
    }
}
