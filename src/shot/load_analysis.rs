//! Loads the analysis beside a recording and adopts the parts that are valid.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Shot;
use super::error::ShotError;
use super::options::{AnalysisChoice, ShotOptions};
use crate::analyse::{Analysis, FILE_NAME, Findings, default_folder};
use crate::effects::exposure::equivalent_exposure_s;
use crate::fit::quantile::upper_median;
use crate::profile::Rig;
use crate::recording::Recording;

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

impl Shot {
    /// Loads the analysis beside the recording, or the one at a given path, and adopts it if it
    /// fits.
    pub(super) fn load_analysis(&mut self, options: &ShotOptions) -> Result<(), ShotError> {
        let (folder, is_named) = match &options.analysis {
            AnalysisChoice::No => {
                self.analysis = AnalysisState::Ignored;
                return Ok(());
            }
            AnalysisChoice::At(folder) => (folder.clone(), true),
            AnalysisChoice::Beside if self.recording.is_live() => return Ok(()),
            AnalysisChoice::Beside => (default_folder(&self.recording.path), false),
        };
        if !is_named && !folder.join(FILE_NAME).exists() {
            if folder.is_dir() {
                let problem = format!("it has no {FILE_NAME}: it is not an analysis, or an unfinished one");
                self.analysis = AnalysisState::Unfit(folder, problem);
            }
            return Ok(());
        }
        match read_fitting(&folder, &self.recording, &self.rig) {
            Ok(analysis) if options.recorded_poses => self.adopt(folder, analysis.without_registration()),
            Ok(analysis) => self.adopt(folder, analysis),
            Err(problem) if is_named => return Err(ShotError::Analysis { folder, problem }),
            Err(problem) => self.analysis = AnalysisState::Unfit(folder, problem),
        }
        Ok(())
    }

    /// Applies the valid parts of an analysis to the recording as it was read, in the present unit.
    /// The estimated parameters become a layer of the settings. Camera and settings stay.
    pub(super) fn adopt(&mut self, folder: PathBuf, analysis: Analysis) {
        let mut recording = self.recorded.as_ref().clone();
        recording.rescale(self.recording.metres_per_unit);
        let analysis = analysis.without_stale(&recording);
        recording.refine(&analysis.refinement(median_exposure_s(&recording)));
        self.recording = Arc::new(recording);
        self.layers.set_estimates(&analysis);
        self.room = Arc::default();
        self.estimated_lighting = analysis.lighting().map(Arc::new);
        self.analysis = AnalysisState::Used(folder, Box::new(analysis.findings));
    }
}

fn read_fitting(folder: &Path, recording: &Recording, rig: &Rig) -> Result<Analysis, String> {
    let analysis = Analysis::read(folder).map_err(|error| error.to_string())?;
    let camera = rig.geometry_over(recording.geometry_at_frame(0)).ok_or("the camera is not known")?;
    analysis.fits(recording, &camera)?;
    Ok(analysis)
}

/// The median of the frames' recorded exposures, s. `None` if most frames have none.
fn median_exposure_s(recording: &Recording) -> Option<f64> {
    let exposures_s: Vec<f64> = recording.exposure.iter().filter_map(equivalent_exposure_s).collect();
    let is_majority = 2 * exposures_s.len() > recording.frame_count();
    upper_median(exposures_s).filter(|_| is_majority)
}
