//! Which analysis of the footage is used: options shared by everything that draws into recordings.

use std::path::PathBuf;

use anyhow::Result;

use super::analyse::make;
use super::{tell, warn};
use locard_engine::analyse::beside;
use locard_engine::recording::Recording;
use locard_engine::shot::{AnalysisChoice, AnalysisState, Shot, ShotOptions};

#[derive(clap::Args)]
pub struct Analysis {
    /// What `locard analyse` found, where it does not lie beside the recording
    #[arg(long, value_name = "DIR", conflicts_with = "no_analysis")]
    analysis: Option<PathBuf>,
    /// Take the recording as it was recorded, although it was analysed
    #[arg(long)]
    no_analysis: bool,
    /// Analyse the recording first, where that was not done or does not fit any more
    #[arg(long, conflicts_with_all = ["analysis", "no_analysis"])]
    analyse: bool,
}

impl Analysis {
    pub fn asked(&self) -> AnalysisChoice {
        match &self.analysis {
            Some(folder) => AnalysisChoice::At(folder.clone()),
            None if self.no_analysis => AnalysisChoice::No,
            None => AnalysisChoice::Beside,
        }
    }

    /// Opens the shot, passes it to `check`, and then analyses the recording with the given camera if that is asked for
    /// and was not done. `check` refuses what cannot be before that work, and sees the shot that is returned.
    pub fn open<T>(
        &self,
        recording: Recording,
        given: &ShotOptions,
        quiet: bool,
        check: impl Fn(&mut Shot) -> Result<T>,
    ) -> Result<(Shot, T)> {
        let checked = |recording| -> Result<(Shot, T)> {
            let mut shot = Shot::of(recording, given)?;
            let found = check(&mut shot)?;
            Ok((shot, found))
        };
        if !self.analyse {
            return checked(recording);
        }
        checked(recording.clone())?;
        let recorded = ShotOptions { scene: None, analysis: AnalysisChoice::No, ..given.clone() };
        let shot = Shot::of(recording.clone(), &recorded)?;
        make(&shot, &beside(&recording.path), false, quiet)?;
        checked(recording)
    }
}

/// Where there is none, what one would give; and where it says nothing of the poses, that there is nothing to leave out.
pub fn say(quiet: bool, shot: &Shot, recorded_poses: bool) {
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
        tell(quiet, &format!("not analysed: `locard analyse {recording}` finds {finds}"));
    }
}
