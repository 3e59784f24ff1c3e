//! A shot's footage analysed, and what was found taken over while a person works.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::analysed::{AnalysisState, Follows, Sources, follows, refine};
use super::{Shot, ShotError};
use crate::analyse::{
    Analysis, AnalysisError, CaptureInfo, Checkpoints, Interrupted, Progress, RegistrationError, Times, analyse,
    check_writable,
};
use crate::compositor::exposure_time_s;
use crate::frame::{Frame, FrameExposure};
use crate::parallel::processors;
use crate::profile::ShotSettings;
use crate::scene::Scene;

/// Why footage was not analysed.
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
    /// The recording as it was recorded, in the unit and seen by the camera as they are now, without anything in it.
    pub fn as_recorded(&self) -> Self {
        let mut recording = self.recorded.as_ref().clone();
        recording.rescale(self.recording.metres_per_unit);
        recording.set_cameras(|own| self.rig.geometry_over(own));
        let (recording, scene) = (Arc::new(recording), Arc::<Scene>::default());
        let analysis = AnalysisState::Left;
        Self { recording, scene, found_light: None, analysis, held: None, ..self.clone() }
    }

    /// Analyses a whole recording, which must be [`Shot::as_recorded`], and writes the result into
    /// a folder. `told` receives the progress; its error ends the work.
    pub fn analyse(
        &self,
        folder: &Path,
        told: &mut dyn FnMut(Progress) -> Result<(), Interrupted>,
    ) -> Result<(Analysis, Times), AnalyseError> {
        check_writable(folder)?;
        let camera = self.geometry_at(0)?;
        let rig = self.camera();
        let exposure_s = |frame: &Frame| exposure_time_s(&rig, &self.settings, frame, self.interval_s(frame.index));
        let capture = CaptureInfo { response: &rig.response, noise: rig.noise.as_ref(), exposure_s: &exposure_s };
        let mut checkpoints = Checkpoints::of(folder, &self.recording, &camera, &capture);
        let made = analyse(&self.recording, &camera, &capture, processors(), &mut checkpoints, told);
        let failed = |source| AnalyseError::Footage { recording: self.recording.path.clone(), source };
        let (made, times) = made.map_err(failed)?;
        made.write(folder, &self.recording)?;
        times.keep(folder);
        checkpoints.finish();
        Ok((made, times))
    }

    /// What an analysis would tell, where there is none that fits; `None` where one is used or left, and where there are no frames
    /// to compare.
    pub fn lacks_analysis(&self) -> Option<&'static str> {
        let is_there = matches!(self.analysis, AnalysisState::Used(..) | AnalysisState::Left);
        if is_there || self.recording.is_arriving() || self.recording.frame_count() < 2 {
            return None;
        }
        Some(match self.recording.has_depth() {
            true => {
                "where the camera really was and how bright each frame is, so that evidence stays in place and follows the light"
            }
            false => "how bright, how long exposed and how sharp each frame is, so that evidence follows",
        })
    }

    /// Uses an analysis of the recording. Scene, camera and settings stay as they are. Returns the
    /// values that follow the analysis where neither the scene nor the user sets them. An analysis
    /// for another camera is not used.
    pub fn take_analysis(&mut self, folder: PathBuf, analysis: Analysis) -> Result<Vec<Follows>, ShotError> {
        if let Err(problem) = analysis.fits_camera(&self.geometry_at(0)?) {
            self.analysis = AnalysisState::Unfit(folder, problem);
            return Ok(Vec::new());
        }
        let sources = Sources {
            profiles: &self.profiles,
            of_scene: &ShotSettings::default(),
            scene: Path::new(""),
            sets: &self.sets,
        };
        let mut recording = self.recorded.as_ref().clone();
        recording.rescale(self.recording.metres_per_unit);
        let analysis = analysis.without_stale(&recording);
        let follows = follows(&analysis, sources)?;
        Arc::make_mut(&mut self.baseline).follow(follows.clone());
        refine(&mut recording, &analysis);
        recording.set_cameras(|own| self.rig.geometry_over(own));
        self.recording = Arc::new(recording);
        self.floors = Arc::default();
        self.found_light = analysis.lighting().map(Arc::new);
        self.analysis = AnalysisState::Used(folder, Box::new(analysis.findings));
        self.held = None;
        self.follow_scene();
        Ok(follows)
    }

    /// How much brighter each frame was found to be than the recording's median, stops: red, green, blue. Empty if that is not
    /// known, or all are alike.
    pub fn seen_ev(&self) -> Vec<[f64; 3]> {
        let of = |exposure: &FrameExposure| Some(exposure.seen?.factors.map(f64::log2));
        self.recording.exposure.iter().map(of).collect::<Option<_>>().unwrap_or_default()
    }
}
