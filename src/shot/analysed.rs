//! The analysis that lies beside a recording, and what of it holds.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::ShotError;
use super::given::{Analysed, Given};
use crate::analyse::{Analysis, FILE_NAME, Findings, beside};
use crate::compositor::Settings;
use crate::effects::exposure::gathered_s;
use crate::effects::point_spread::measuring;
use crate::params::Value;
use crate::profile::{Rig, ShotSettings};
use crate::recording::Recording;
use crate::scene::Lighting;

/// Tables and parameters: of the readout time, and of the camera's sharpness.
const READOUT: (&str, &str) = ("camera", "readout_time_s");
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

/// Who sets parameters besides the recording and the analysis.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    pub profiles: &'a [PathBuf],
    /// The scene file's, and that file.
    pub of_scene: &'a ShotSettings,
    pub scene: &'a Path,
    pub sets: &'a [String],
}

/// An analysis as it is used.
pub struct LoadedAnalysis {
    pub state: AnalysisState,
    pub light: Option<Arc<Lighting>>,
    pub analysis: Option<Analysis>,
}

/// Loads the analysis beside the recording, or the one that is named, and applies it to the
/// recording. `rig` is the camera that the analysis must fit.
pub fn take(recording: &mut Recording, rig: &Rig, given: &Given) -> Result<LoadedAnalysis, ShotError> {
    let without = |state| Ok(LoadedAnalysis { state, light: None, analysis: None });
    let (folder, is_named) = match &given.analysis {
        Analysed::No => return without(AnalysisState::Left),
        Analysed::At(folder) => (folder.clone(), true),
        Analysed::Beside if recording.is_arriving() => return without(AnalysisState::Absent),
        Analysed::Beside => (beside(&recording.path), false),
    };
    if !is_named && !folder.join(FILE_NAME).exists() {
        return without(match folder.is_dir() {
            true => {
                AnalysisState::Unfit(folder, format!("no {FILE_NAME} lies in it: no analysis, or an unfinished one"))
            }
            false => AnalysisState::Absent,
        });
    }
    match fitting(&folder, recording, rig) {
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

/// A parameter that follows what was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Follows {
    pub table: &'static str,
    pub name: &'static str,
    pub value: Value,
}

impl Follows {
    /// Sets what was found.
    pub fn apply<'a>(found: impl IntoIterator<Item = &'a Self>, rig: &mut Rig, settings: &mut Settings) {
        for Self { table, name, value } in found {
            // Within the range: the analysis found it there.
            let _ = rig.set(settings, table, name, value);
        }
    }

    /// Whether it overrides profiles, as the readout time does.
    pub fn overrides_profiles(&self) -> bool {
        (self.table, self.name) == READOUT
    }
}

/// The parameters that nobody else sets: the readout time overrides profiles, the sharpness does
/// not.
pub fn follows(analysis: &Analysis, sources: Sources<'_>) -> Result<Vec<Follows>, ShotError> {
    let mut follows = Vec::new();
    let mut add = |(table, name), number| follows.push(Follows { table, name, value: Value::Number(number) });
    let sets_readout = |text: &String| text.trim_start().starts_with("camera.readout_time_s");
    let is_set = sources.of_scene.has(READOUT.0, READOUT.1) || sources.sets.iter().any(sets_readout);
    if analysis.refined().is_some() && !is_set {
        add(READOUT, analysis.findings.camera.intrinsics.readout_time_s);
    }
    if let Some(sigma_px) = analysis.findings.spread.as_ref().and_then(|spread| spread.sigma_px)
        && !says_spread(sources)?
    {
        add(SHARPNESS, measuring(sigma_px));
    }
    Ok(follows)
}

/// What the recording takes over.
pub fn refine(recording: &mut Recording, analysis: &Analysis) {
    recording.refine(&analysis.refinement(usual_s(recording)));
}

/// Whether a profile or a setting says how sharp the camera is. It may say what is the default, so that it is put over two values
/// that differ: where it says one, both are that afterwards.
fn says_spread(sources: Sources<'_>) -> Result<bool, ShotError> {
    let (table, name) = SHARPNESS;
    let put_over = |number: f64| -> Result<Option<Value>, ShotError> {
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
    Ok(put_over(1.0)? == put_over(2.0)?)
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
