//! Loads the analysis beside a recording and applies the parts that are valid.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::ShotError;
use super::options::{AnalysisChoice, ShotOptions};
use crate::analyse::{Analysis, FILE_NAME, Findings, beside};
use crate::compositor::Settings;
use crate::effects::exposure::equivalent_exposure_s;
use crate::effects::point_spread::sigma_for_measured_px;
use crate::params::Value;
use crate::profile::{Rig, ShotSettings};
use crate::recording::Recording;
use crate::scene::Lighting;

/// Tables and parameters: of the readout time, and of the camera's sharpness.
const READOUT: (&str, &str) = ("camera", "readout_time_s");
const SHARPNESS: (&str, &str) = ("point_spread", "sigma_px");

/// Whether an analysis is used.
#[derive(Clone, Debug, PartialEq)]
pub enum AnalysisState {
    Used(PathBuf, Box<Findings>),
    /// It exists but does not fit, or cannot be read.
    Unfit(PathBuf, String),
    /// None exists.
    Absent,
    /// Switched off.
    Ignored,
}

/// Sources of parameter values besides the recording and the analysis.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    pub profiles: &'a [PathBuf],
    /// The scene file's settings, and that file.
    pub of_scene: &'a ShotSettings,
    pub scene: &'a Path,
    pub sets: &'a [String],
}

/// A loaded analysis, its lighting and its state.
pub struct LoadedAnalysis {
    pub state: AnalysisState,
    pub light: Option<Arc<Lighting>>,
    pub analysis: Option<Analysis>,
}

/// Loads the analysis beside the recording, or the one at a given path, and applies it to the
/// recording. `rig` is the camera that the analysis must fit.
pub fn load_analysis(recording: &mut Recording, rig: &Rig, given: &ShotOptions) -> Result<LoadedAnalysis, ShotError> {
    let without = |state| Ok(LoadedAnalysis { state, light: None, analysis: None });
    let (folder, is_named) = match &given.analysis {
        AnalysisChoice::No => return without(AnalysisState::Ignored),
        AnalysisChoice::At(folder) => (folder.clone(), true),
        AnalysisChoice::Beside if recording.is_live() => return without(AnalysisState::Absent),
        AnalysisChoice::Beside => (beside(&recording.path), false),
    };
    if !is_named && !folder.join(FILE_NAME).exists() {
        return without(if folder.is_dir() {
            AnalysisState::Unfit(folder, format!("no {FILE_NAME} lies in it: no analysis, or an unfinished one"))
        } else {
            AnalysisState::Absent
        });
    }
    match read_fitting(&folder, recording, rig) {
        Ok(analysis) => {
            let analysis = analysis.without_stale(recording);
            let analysis = if given.recorded_poses { analysis.without_registration() } else { analysis };
            refine(recording, &analysis);
            let light = analysis.lighting().map(Arc::new);
            let state = AnalysisState::Used(folder, Box::new(analysis.findings.clone()));
            Ok(LoadedAnalysis { state, light, analysis: Some(analysis) })
        }
        Err(problem) if is_named => Err(ShotError::Analysis { folder, problem }),
        Err(problem) => without(AnalysisState::Unfit(folder, problem)),
    }
}

/// A parameter with the value that the analysis estimated.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedParam {
    pub table: &'static str,
    pub name: &'static str,
    pub value: Value,
}

impl EstimatedParam {
    /// Sets the parameters to the estimated values.
    pub fn apply<'a>(found: impl IntoIterator<Item = &'a Self>, rig: &mut Rig, settings: &mut Settings) {
        for Self { table, name, value } in found {
            // The analysis estimates values within the range.
            let _ = rig.set(settings, table, name, value);
        }
    }

    /// True for the readout time, which overrides profiles.
    pub fn overrides_profiles(&self) -> bool {
        (self.table, self.name) == READOUT
    }
}

/// The estimated parameters that no other source sets. The readout time overrides profiles, the
/// sharpness does not.
pub fn estimated_params(analysis: &Analysis, sources: Sources<'_>) -> Result<Vec<EstimatedParam>, ShotError> {
    let mut params = Vec::new();
    let mut add = |(table, name), number| params.push(EstimatedParam { table, name, value: Value::Number(number) });
    let sets_readout = |text: &String| text.trim_start().starts_with("camera.readout_time_s");
    let is_set = sources.of_scene.has(READOUT.0, READOUT.1) || sources.sets.iter().any(sets_readout);
    if analysis.refined().is_some() && !is_set {
        add(READOUT, analysis.findings.camera.intrinsics.readout_time_s);
    }
    if let Some(sigma_px) = analysis.findings.spread.as_ref().and_then(|spread| spread.sigma_px)
        && !sets_sharpness(sources)?
    {
        add(SHARPNESS, sigma_for_measured_px(sigma_px));
    }
    Ok(params)
}

/// Applies the analysis to the recording's track, timing and exposure.
pub fn refine(recording: &mut Recording, analysis: &Analysis) {
    recording.refine(&analysis.refinement(median_exposure_s(recording)));
}

/// Whether a profile or a setting sets the camera's sharpness. It may set the default value, so the
/// sources are applied to two different values: if they set one, both results are equal.
fn sets_sharpness(sources: Sources<'_>) -> Result<bool, ShotError> {
    let (table, name) = SHARPNESS;
    let applied_to = |number: f64| -> Result<Option<Value>, ShotError> {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        let _ = settings.set(table, name, &Value::Number(number));
        for profile in sources.profiles {
            rig.read(profile, &mut settings)?;
        }
        sources.of_scene.apply(&mut rig, &mut settings, sources.scene)?;
        for text in sources.sets {
            rig.set_text(text, &mut settings)?;
        }
        Ok(settings.tables().into_iter().find(|params| params.table() == table).and_then(|params| params.get(name)))
    };
    Ok(applied_to(1.0)? == applied_to(2.0)?)
}

fn read_fitting(folder: &Path, recording: &Recording, rig: &Rig) -> Result<Analysis, String> {
    let analysis = Analysis::read(folder).map_err(|error| error.to_string())?;
    let camera = rig.geometry_over(recording.geometry_at_frame(0)).ok_or("the camera is not known")?;
    analysis.fits(recording, &camera)?;
    Ok(analysis)
}

/// The median of the frames' recorded exposures, s. `None` if most frames have none.
fn median_exposure_s(recording: &Recording) -> Option<f64> {
    let mut known: Vec<f64> = recording.exposure.iter().filter_map(equivalent_exposure_s).collect();
    known.sort_by(f64::total_cmp);
    known.get(known.len() / 2).copied().filter(|_| 2 * known.len() > recording.frame_count())
}
