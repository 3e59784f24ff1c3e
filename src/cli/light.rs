//! How bright a recording's scene is, and with which settings its frames were taken: for the meter and for photographs.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use crate::camera::exposure::{Exposure, Settings};
use crate::camera::metering::{Limits, PictureLight};
use crate::camera::{Lens, stops};
use crate::compositor::Settings as Effects;
use crate::profile::Rig;
use crate::recording::{OpenOptions, Recording};

/// The film speed that is taken where nobody says: EVs are usually told for it.
pub const USUAL_ISO: f64 = 100.0;

/// What the meter and the photograph ask alike.
#[derive(clap::Args)]
pub struct Site {
    /// The recording
    pub recording: PathBuf,
    /// Which of its frames
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = super::frame_number)]
    pub frame: usize,
    /// The f-number, as in 2.8
    #[arg(long, value_name = "F", allow_hyphen_values = true, value_parser = stops::parse_f_number)]
    pub aperture: Option<f64>,
    /// The shutter time, as in 1/60
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = stops::parse_shutter_s)]
    pub shutter: Option<f64>,
    /// The film speed, 100 to 25600; else the recording's
    #[arg(long, allow_hyphen_values = true, value_parser = stops::parse_iso)]
    pub iso: Option<f64>,
    /// Stops brighter than correct that are wanted, -5 to 5
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_hyphen_values = true, value_parser = compensation)]
    pub compensation: f64,
    /// The light on the scene, in lux; else it is estimated from the picture and its settings
    #[arg(long, value_name = "LX", allow_hyphen_values = true, value_parser = lux)]
    pub lux: Option<f64>,
    /// The camera and the effects' parameters, above the recording's own
    #[arg(long)]
    pub profile: Option<PathBuf>,
    /// Set a parameter, as in --set camera.lens.blades=5; of camera.exposure and camera.lens.f_number, what the recording
    /// was taken with
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    pub sets: Vec<String>,
    /// Length of a nerfstudio or COLMAP unit
    #[arg(long, default_value_t = 1.0, value_name = "M")]
    pub metres_per_unit: f64,
}

/// A recording with its camera.
pub struct Opened {
    pub recording: Recording,
    pub rig: Rig,
    pub effects: Effects,
    /// With what the frame was taken.
    pub taken: Known,
}

impl Site {
    pub fn open(&self) -> Result<Opened> {
        let options = OpenOptions { metres_per_unit: self.metres_per_unit, ..OpenOptions::default() };
        let recording = Recording::open(&self.recording, &options)?;
        super::check_frame(self.frame, recording.frame_count())?;
        let (mut rig, mut effects) = (Rig::default(), Effects::default());
        for profile in recording.camera_profile.iter().chain(&self.profile) {
            rig.read(profile, &mut effects)?;
        }
        if let Some(geometry) = recording.geometry_at_frame(self.frame) {
            rig.lay_over(geometry);
        }
        let taken = Known::taken(&rig, &self.sets, &recording, self.frame)?;
        for text in &self.sets {
            rig.set_text(text, &mut effects)?;
        }
        Ok(Opened { recording, rig, effects, taken })
    }
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
pub struct Known {
    pub f_number: Option<f64>,
    pub time_s: Option<f64>,
    pub iso: Option<f64>,
}

impl Known {
    pub fn or(self, other: Self) -> Self {
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

    /// The settings that a frame was taken with. What is typed stands above what the picture says, that above the profile
    /// (`rig`, before anything typed).
    fn taken(rig: &Rig, sets: &[String], recording: &Recording, frame: usize) -> Result<Self> {
        let mut typed = rig.clone();
        (typed.lens, typed.exposure) = (Lens::default(), Exposure::default());
        for text in sets {
            typed.set_text(text, &mut Effects::default())?;
        }
        let said = recording.exposure.get(frame).copied().unwrap_or_default();
        let photo = said.photo;
        let recorded = Self { f_number: photo.f_number, time_s: photo.time_s.or(said.time_s), iso: photo.iso };
        Ok(Self::of(&typed).or(recorded).or(Self::of(rig)))
    }

    pub fn settings(self) -> Option<Settings> {
        let settings = Settings { f_number: self.f_number?, time_s: self.time_s?, iso: self.iso? };
        Some(settings.exact())
    }

    pub fn missing(self) -> Vec<&'static str> {
        let named = [(self.f_number, "the f-number"), (self.time_s, "the shutter time"), (self.iso, "the film speed")];
        named.into_iter().filter(|(known, _)| known.is_none()).map(|(_, name)| name).collect()
    }
}

/// The light on the scene, and where that is known from.
pub struct SceneLight {
    pub lux: f64,
    pub picture: Option<PictureLight>,
}

pub fn scene_light(
    lux: Option<f64>,
    recording: &Recording,
    frame: usize,
    rig: &Rig,
    taken: Known,
) -> Result<SceneLight> {
    if let Some(lux) = lux {
        return Ok(SceneLight { lux, picture: None });
    }
    let Some(settings) = taken.settings() else {
        bail!(
            "nothing says how bright the scene is: {} of frame {} not known (EXIF, a profile or --set \
             camera.lens.f_number=…, camera.exposure.time_s=…, camera.exposure.iso=…); give that, or the light by --lux",
            taken.missing().join(" and "),
            if taken.missing().len() == 1 { format!("{frame} is") } else { format!("{frame} are") }
        );
    };
    let picture = recording.frames(frame..frame + 1)?.next().context("the frame cannot be read")??;
    let picture = PictureLight::of(&picture.pixels, &rig.response);
    let lux = settings.illuminance_of_picture_lx(picture.mean).with_context(|| {
        format!("frame {frame} is black: it does not tell how bright the scene is; give the light by --lux")
    })?;
    Ok(SceneLight { lux, picture: Some(picture) })
}

/// What the camera can choose from: a usual lens', and the person's own aperture.
pub fn limits(rig: &Rig, asked: Known) -> Limits {
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
