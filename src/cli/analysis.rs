//! Which analysis of the footage is used: options shared by everything that draws into recordings.

use std::path::PathBuf;

use super::{tell, warn};
use crate::shot::{Analysed, AnalysisState, Shot};

#[derive(clap::Args)]
pub struct Analysis {
    /// What `locard analyse` found, where it does not lie beside the recording
    #[arg(long, value_name = "DIR", conflicts_with = "no_analysis")]
    analysis: Option<PathBuf>,
    /// Take the recording as it was recorded, although it was analysed
    #[arg(long)]
    no_analysis: bool,
}

impl Analysis {
    pub fn asked(&self) -> Analysed {
        match &self.analysis {
            Some(folder) => Analysed::At(folder.clone()),
            None if self.no_analysis => Analysed::No,
            None => Analysed::Beside,
        }
    }
}

/// Says what became of it, if it needs saying.
pub fn say(quiet: bool, shot: &Shot) {
    let again = format!("`locard analyse {}`", shot.recording.path.display());
    match &shot.analysis {
        AnalysisState::Unfit(folder, problem) => {
            warn(quiet, &format!("{} is not used: {problem} ({again} makes it anew)", folder.display()));
        }
        AnalysisState::Absent if shot.recording.has_depth() && shot.recording.frame_count() > 1 => tell(
            quiet,
            &format!(
                "not analysed: {again} finds where the camera really was and how bright each frame is, so that evidence stays in place and follows the light"
            ),
        ),
        AnalysisState::Absent | AnalysisState::Left | AnalysisState::Used(..) => {}
    }
}
