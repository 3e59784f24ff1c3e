//! Options shared by `locard meter` and `locard photo`.

use std::path::PathBuf;

use anyhow::Result;

use super::analysis::AnalysisArgs;
use super::open::Skip;
use locard_engine::camera::stops;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::shot::{AnalysisChoice, Shot, ShotOptions};

#[derive(clap::Args)]
pub struct LightArgs {
    /// The recording
    pub recording: PathBuf,
    /// The frame of the recording
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = super::frame_number)]
    pub frame: usize,
    /// The f-number, as in 2.8
    #[arg(long, value_name = "F", allow_hyphen_values = true, value_parser = stops::parse_f_number)]
    pub aperture: Option<f64>,
    /// The shutter time, as in 1/60
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = stops::parse_shutter_s)]
    pub shutter: Option<f64>,
    /// The film speed, 100 to 25600; by default the recording's
    #[arg(long, allow_hyphen_values = true, value_parser = stops::parse_iso)]
    pub iso: Option<f64>,
    /// Exposure compensation: this many stops brighter than correct, -5 to 5
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_hyphen_values = true, value_parser = compensation)]
    pub compensation: f64,
    /// The light on the scene, in lux; by default it is estimated from the picture and its settings
    #[arg(long, value_name = "LX", allow_hyphen_values = true, value_parser = lux)]
    pub lux: Option<f64>,
    /// The camera and the effects' parameters; overrides the recording's own
    #[arg(long)]
    pub profile: Option<PathBuf>,
    /// Set a parameter, as in --set camera.lens.blades=5; camera.exposure and camera.lens.f_number
    /// describe how the recording was taken
    #[arg(long = "set", value_name = "TABLE.NAME=VALUE")]
    pub sets: Vec<String>,
    /// Length of a unit, for formats without a scale (nerfstudio, COLMAP, Metashape …)
    #[arg(long, default_value_t = 1.0, value_name = "M")]
    pub metres_per_unit: f64,
    #[command(flatten)]
    pub analysis: AnalysisArgs,
    #[command(flatten)]
    pub skip: Skip,
}

impl LightArgs {
    /// Opens the recording, with the scene of a photograph.
    pub fn open(&self, scene: Option<PathBuf>, recorded_poses: bool) -> Result<Shot> {
        let options = self.shot_options(scene, recorded_poses, self.analysis.choice());
        Ok(self.analysis.open(self.open_recording()?, &options, false, |_| Ok(()))?.0)
    }

    /// The shot of a command that was run before, with a given analysis.
    pub fn reopen(&self, scene: Option<PathBuf>, recorded_poses: bool, analysis: AnalysisChoice) -> Result<Shot> {
        Ok(Shot::of(self.open_recording()?, &self.shot_options(scene, recorded_poses, analysis))?)
    }

    fn open_recording(&self) -> Result<Recording> {
        let options =
            self.skip.apply_to(OpenOptions { metres_per_unit: self.metres_per_unit, ..OpenOptions::default() });
        let recording = Recording::open(&self.recording, &options)?;
        super::check_frame(self.frame, recording.frame_count())?;
        Ok(recording)
    }

    fn shot_options(&self, scene: Option<PathBuf>, recorded_poses: bool, analysis: AnalysisChoice) -> ShotOptions {
        let (profile, sets) = (self.profile.clone(), self.sets.clone());
        ShotOptions { profile, sets, scene, analysis, recorded_poses, ..ShotOptions::default() }
    }
}

fn number_in(text: &str, is_accepted: impl Fn(f64) -> bool, accepted: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|v| is_accepted(*v)).ok_or_else(|| format!("expected {accepted}"))
}

fn lux(text: &str) -> Result<f64, String> {
    number_in(text, |v| v > 0.0 && v <= 1e7, "more than 0 and up to 10000000 lux (500 in a room, 100000 in the sun)")
}

fn compensation(text: &str) -> Result<f64, String> {
    number_in(text, |v| v.abs() <= 5.0, "-5 to 5")
}
