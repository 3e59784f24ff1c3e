//! The analysis that lies beside a recording, and what of it holds.

use std::path::{Path, PathBuf};

use super::error::ShotError;
use super::given::{Analysed, Given};
use crate::analyse::{Analysis, FILE_NAME, Findings, beside};
use crate::compositor::Settings;
use crate::effects::exposure::gathered_s;
use crate::effects::point_spread::measuring;
use crate::params::Value;
use crate::profile::Rig;
use crate::recording::Recording;

/// The table and parameter of the camera's sharpness.
const SHARPNESS: (&str, &str) = ("point_spread", "sigma_px");

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

/// Finds the analysis and lets the recording, the camera and the settings follow it, which `profiles` and `given` made.
pub fn take(
    recording: &mut Recording,
    rig: &mut Rig,
    settings: &mut Settings,
    profiles: &[PathBuf],
    given: &Given,
) -> Result<AnalysisState, ShotError> {
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
            if let Some(sigma_px) = analysis.findings.spread.as_ref().and_then(|spread| spread.sigma_px)
                && !says_spread(settings, profiles, given)?
            {
                let (table, name) = SHARPNESS;
                // Within the range: nothing softer than a few pixels is taken for the camera's.
                let _ = settings.set(table, name, &Value::Number(measuring(sigma_px)));
            }
            recording.refine(&analysis.refinement(usual_s(recording)));
            Ok(AnalysisState::Used(folder, Box::new(analysis.findings)))
        }
        Err(problem) if is_named => Err(ShotError::Analysis { folder, problem }),
        Err(problem) => Ok(AnalysisState::Unfit(folder, problem)),
    }
}

/// Whether a profile or a setting says how sharp the camera is, `settings` being what they give.
fn says_spread(settings: &Settings, profiles: &[PathBuf], given: &Given) -> Result<bool, ShotError> {
    let (table, name) = SHARPNESS;
    let value = |settings: &Settings| settings.tables().into_iter().find(|p| p.table() == table)?.get(name);
    if value(settings) != value(&Settings::default()) {
        return Ok(true);
    }
    // It may say what is the default: another value to begin with would be gone then.
    let mut other = Settings::default();
    let _ = other.set(table, name, &Value::Number(1.0));
    let unsaid = value(&other);
    let mut rig = Rig::default();
    for profile in profiles {
        rig.read(profile, &mut other)?;
    }
    for text in &given.sets {
        rig.set_text(text, &mut other)?;
    }
    Ok(value(&other) != unsaid)
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
