//! Which analysis of the footage is used: options shared by everything that draws into recordings.

use std::path::PathBuf;

use anyhow::Result;

use super::analyse::make;
use super::{tell, warn};
use crate::analyse::beside;
use crate::recording::Recording;
use crate::shot::{Analysed, AnalysisState, Given, Shot};

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
    pub fn asked(&self) -> Analysed {
        match &self.analysis {
            Some(folder) => Analysed::At(folder.clone()),
            None if self.no_analysis => Analysed::No,
            None => Analysed::Beside,
        }
    }

    /// Analyses a recording with the camera that is given, if that is asked for and was not done.
    pub fn first(&self, recording: &Recording, given: &Given, quiet: bool) -> Result<()> {
        if self.analyse {
            let recorded = Given { scene: None, analysis: Analysed::No, ..given.clone() };
            let shot = Shot::of(recording.clone(), &recorded)?;
            make(&shot, &beside(&recording.path), false, quiet)?;
        }
        Ok(())
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
    if let Some(finds) = shot.lacks_analysis().filter(|_| shot.analysis == AnalysisState::Absent) {
        let recording = shot.recording.path.display();
        tell(quiet, &format!("not analysed: `locard analyse {recording}` finds {finds}"));
    }
}
