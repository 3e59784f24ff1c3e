//! The choice of an analysis: options shared by all commands that composite into recordings.

use std::path::PathBuf;

use anyhow::Result;

use super::analyse::make;
use super::{print_status, warn};
use locard_engine::analyse::default_folder;
use locard_engine::recording::Recording;
use locard_engine::scene;
use locard_engine::shot::{AnalysisChoice, AnalysisState, Shot, ShotOptions};

#[derive(clap::Args)]
pub struct AnalysisArgs {
    /// The results of `locard analyse`, if they are not beside the recording
    #[arg(long, value_name = "DIR", conflicts_with = "no_analysis")]
    analysis: Option<PathBuf>,
    /// Use the recording as it was recorded, even if it was analysed
    #[arg(long)]
    no_analysis: bool,
    /// Analyse the recording first, unless a valid analysis exists
    #[arg(long, conflicts_with_all = ["analysis", "no_analysis"])]
    analyse: bool,
}

impl AnalysisArgs {
    pub fn choice(&self) -> AnalysisChoice {
        match &self.analysis {
            Some(folder) => AnalysisChoice::At(folder.clone()),
            None if self.no_analysis => AnalysisChoice::No,
            None => AnalysisChoice::Beside,
        }
    }

    /// True if the recording is to be analysed.
    pub fn makes_analysis(&self) -> bool {
        self.analyse
    }

    /// Opens the shot and passes it to `check`. With `--analyse` and without an analysis that fits,
    /// the recording is then analysed with the given camera, and the shot is opened and checked
    /// again. `check` thus finds invalid options before the analysis, and receives the shot that is
    /// returned.
    pub fn open<T>(
        &self,
        recording: Recording,
        shot_options: &ShotOptions,
        quiet: bool,
        check: impl Fn(&mut Shot) -> Result<T>,
    ) -> Result<(Shot, T)> {
        let checked = |recording| -> Result<(Shot, T)> {
            let mut shot = Shot::of(recording, shot_options)?;
            let state = check(&mut shot)?;
            Ok((shot, state))
        };
        if !self.analyse {
            return checked(recording);
        }
        checked(recording.clone())?;
        let recorded = ShotOptions { scene: None, analysis: AnalysisChoice::No, ..shot_options.clone() };
        let mut shot = Shot::of(recording.clone(), &recorded)?;
        if let Some(scene) = &shot_options.scene {
            shot.set_site_of(&scene::load(scene, shot.recording.up)?)?;
        }
        make(&shot, &default_folder(&recording.path), false, quiet)?;
        checked(recording)
    }
}

/// Prints the benefit of an analysis if there is none, and a warning if `--without registration`
/// has no effect.
pub fn print_hints(quiet: bool, shot: &Shot, recorded_poses: bool) {
    let is_moved = matches!(&shot.analysis, AnalysisState::Used(_, findings) if findings.registration.pose_lines > 0);
    if recorded_poses && !is_moved {
        let why = match shot.analysis {
            AnalysisState::Used(..) => "the analysis kept the recorded poses",
            _ => "no analysis is used",
        };
        warn(quiet, &format!("--without registration changes nothing: {why}"));
    }
    if let Some(finds) = shot.missing_analysis().filter(|_| shot.analysis == AnalysisState::Absent) {
        let recording = shot.recording.path.display();
        print_status(quiet, &format!("not analysed: `locard analyse {recording}` finds {finds}"));
    }
}
