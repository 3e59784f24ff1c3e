//! Analyses a shot's footage, and applies the result to an open shot.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{AnalysisState, EstimatedParam, Shot, ShotError};
use crate::analyse::{
    Analysis, AnalysisError, CaptureInfo, Checkpoints, Interrupted, Progress, RegistrationError, Times, analyse,
    check_writable,
};
use crate::frame::{Frame, FrameExposure};
use crate::parallel::processors;
use crate::scene::Scene;

/// Why an analysis failed.
#[derive(Debug, thiserror::Error)]
pub enum AnalyseError {
    #[error(transparent)]
    Shot(#[from] ShotError),
    #[error(transparent)]
    Folder(#[from] AnalysisError),
    #[error("{}: {source}", recording.display())]
    Footage { recording: PathBuf, source: RegistrationError },
}

impl AnalyseError {
    pub fn is_interrupted(&self) -> bool {
        matches!(self, Self::Footage { source: RegistrationError::Interrupted(_), .. })
    }
}

impl Shot {
    /// The recording as it was read, without scene and analysis, in the present unit and with the
    /// present camera.
    pub fn as_recorded(&self) -> Self {
        let mut recording = self.recorded.as_ref().clone();
        recording.rescale(self.recording.metres_per_unit);
        if recording.has_measured_depth() {
            recording.set_site(None);
        }
        recording.set_cameras(|own| self.rig.geometry_over(own));
        let (recording, scene) = (Arc::new(recording), Arc::<Scene>::default());
        let analysis = AnalysisState::Ignored;
        Self { recording, scene, estimated_lighting: None, analysis, ..self.clone() }
    }

    /// Analyses a whole recording, which must be [`Shot::as_recorded`], and writes the result into
    /// a folder. `report` receives the progress; its error ends the work.
    pub fn analyse(
        &self,
        folder: &Path,
        report: &mut dyn FnMut(Progress) -> Result<(), Interrupted>,
    ) -> Result<(Analysis, Times), AnalyseError> {
        check_writable(folder)?;
        let camera = self.geometry_at(0)?;
        let rig = self.camera();
        let exposure_s = |frame: &Frame| self.exposure_time(frame).s;
        let capture = CaptureInfo {
            response: &rig.response,
            noise: self.layers.rig_of_profiles().noise.as_ref(),
            exposure_s: &exposure_s,
        };
        let mut checkpoints = Checkpoints::of(folder, &self.recording, &camera, &capture);
        let made = analyse(&self.recording, &camera, &capture, processors(), &mut checkpoints, report);
        let failed = |source| AnalyseError::Footage { recording: self.recording.path.clone(), source };
        let (made, times) = made.map_err(failed)?;
        made.write(folder, &self.recording)?;
        times.keep(folder);
        checkpoints.finish();
        Ok((made, times))
    }

    /// The benefit of an analysis, for a hint to the user. `None` if one is used or switched off,
    /// and for recordings that cannot be analysed: live ones, and single frames.
    pub fn missing_analysis(&self) -> Option<&'static str> {
        let is_settled = matches!(self.analysis, AnalysisState::Used(..) | AnalysisState::Ignored);
        if is_settled || self.recording.is_live() || self.recording.frame_count() < 2 {
            return None;
        }
        Some(if self.recording.has_depth() {
            "where the camera really was and how bright each frame is, so that evidence stays in place and follows the light"
        } else {
            "how bright, how long exposed and how sharp each frame is, so that evidence follows"
        })
    }

    /// Applies an analysis to the recording. Scene, camera and settings stay as they are; the
    /// camera's noise follows the analysis where nothing else gives it. Returns the estimated
    /// parameters that neither profiles nor `--set` override. An analysis for another
    /// camera is not used.
    pub fn apply_analysis(&mut self, folder: PathBuf, analysis: Analysis) -> Result<Vec<EstimatedParam>, ShotError> {
        if let Err(problem) = analysis.fits_camera(&self.geometry_at(0)?) {
            self.analysis = AnalysisState::Unfit(folder, problem);
            return Ok(Vec::new());
        }
        let is_resolved = self.rig.noise == self.layers.resolve()?.rig.noise;
        self.adopt(folder, analysis);
        if is_resolved {
            self.rig.noise = self.layers.resolve()?.rig.noise;
        }
        self.register_depth();
        self.follow_scene();
        Ok(self.estimates())
    }

    /// Estimated exposure of each frame relative to the recording's median, stops: red, green,
    /// blue. Empty if unknown, or equal for all frames.
    pub fn relative_ev(&self) -> Vec<[f64; 3]> {
        let log_factors = |exposure: &FrameExposure| Some(exposure.brightness?.factors.map(f64::log2));
        self.recording.exposure.iter().map(log_factors).collect::<Option<_>>().unwrap_or_default()
    }
}
