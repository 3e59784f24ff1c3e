//! The analysis that lies beside a recording, and what of it holds.

use std::path::{Path, PathBuf};

use super::error::ShotError;
use super::given::{Analysed, Given};
use crate::analyse::{Analysis, FILE_NAME, Findings, beside};
use crate::effects::exposure::gathered_s;
use crate::profile::Rig;
use crate::recording::Recording;

/// What became of it.
#[derive(Clone, Debug, PartialEq)]
pub enum AnalysisState {
    Used(PathBuf, Box<Findings>),
    /// It is there and does not fit, or cannot be read.
    Unfit(PathBuf, String),
    /// There is none.
    Absent,
    /// It was not asked for.
    Left,
}

/// Finds the analysis and lets the recording and the camera follow it.
pub fn take(recording: &mut Recording, rig: &mut Rig, given: &Given) -> Result<AnalysisState, ShotError> {
    let (folder, is_named) = match &given.analysis {
        Analysed::No => return Ok(AnalysisState::Left),
        Analysed::At(folder) => (folder.clone(), true),
        Analysed::Beside if recording.is_arriving() => return Ok(AnalysisState::Absent),
        Analysed::Beside => (beside(&recording.path), false),
    };
    if !is_named && !folder.join(FILE_NAME).exists() {
        return Ok(AnalysisState::Absent);
    }
    match fitting(&folder, recording, rig) {
        Ok(analysis) => {
            let says_readout = |text: &String| text.trim_start().starts_with("camera.readout_time_s");
            if analysis.track.is_some() && !given.sets.iter().any(says_readout) {
                // Within the range: it was found there.
                let readout_s = analysis.findings.camera.intrinsics.readout_time_s;
                rig.set_text(&format!("camera.readout_time_s={readout_s}"), &mut Default::default())?;
            }
            recording.refine(&analysis.refinement(usual_s(recording)));
            Ok(AnalysisState::Used(folder, Box::new(analysis.findings)))
        }
        Err(problem) if is_named => Err(ShotError::Analysis { folder, problem }),
        Err(problem) => Ok(AnalysisState::Unfit(folder, problem)),
    }
}

fn fitting(folder: &Path, recording: &Recording, rig: &Rig) -> Result<Analysis, String> {
    let analysis = Analysis::read(folder).map_err(|error| error.to_string())?;
    let camera = rig.geometry_over(recording.geometry_at_frame(0)).ok_or("the camera is not known")?;
    analysis.fits(recording, &camera)?;
    Ok(analysis)
}

/// What the recording says of its median frame; `None` if it says nothing of most.
fn usual_s(recording: &Recording) -> Option<f64> {
    let mut known: Vec<f64> = recording.exposure.iter().filter_map(gathered_s).collect();
    known.sort_by(f64::total_cmp);
    known.get(known.len() / 2).copied().filter(|_| 2 * known.len() > recording.frame_count())
}
