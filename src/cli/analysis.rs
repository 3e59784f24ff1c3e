//! Which analysis of the footage is used: options shared by everything that draws into recordings.

use std::path::PathBuf;

use anyhow::Result;

use super::analyse::make;
use super::tell;
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

/// Where there is none, what one would give.
pub fn say(quiet: bool, shot: &Shot) {
    if let Some(finds) = shot.lacks_analysis().filter(|_| shot.analysis == AnalysisState::Absent) {
        let recording = shot.recording.path.display();
        tell(quiet, &format!("not analysed: `locard analyse {recording}` finds {finds}"));
    }
}
