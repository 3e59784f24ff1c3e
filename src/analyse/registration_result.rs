//! Result of registration: verdict on the recorded poses, refined states and shared parameters.

use super::depth_clock::DepthOffset;
use super::interrupted::Interrupted;
use super::rig_offset::RigOffset;
use super::state::CameraState;
use crate::camera::Geometry;
use crate::recording::{Recording, RecordingError};

/// Largest σ of an accepted readout time, s.
pub const MAX_READOUT_SIGMA_S: f64 = 0.001;
/// A smaller offset of depth's clock, or one within 2σ, is taken for 0, s.
const MIN_DEPTH_OFFSET_S: f64 = 0.004;

/// Verdict on the recorded poses.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The poses are replaced.
    Refined,
    /// The poses are right and stay unchanged.
    Right,
    /// The poses cannot be checked and stay unchanged. The reason.
    Kept(String),
    /// Registration failed. The reason.
    Refused(String),
}

/// Poses of all frames and the parameters that they share. σ are standard deviations.
#[derive(Clone, Debug)]
pub struct Registration {
    pub verdict: Verdict,
    /// One per frame: refined, or as recorded, by the verdict. `None` where no pose was recorded.
    pub states: Vec<Option<CameraState>>,
    pub readout_s: f64,
    pub readout_sigma_s: Option<f64>,
    /// σ of the readout time by the spread between parts of the recording.
    pub readout_parts_sigma_s: Option<f64>,
    pub depth: Option<DepthOffset>,
    pub rig_offset: Option<RigOffset>,
    /// Numbers of accepted and rejected links.
    pub links: usize,
    pub missing: usize,
    /// Median residuals of held-out links, px: by recorded and by refined poses.
    pub held_out_px: Option<(f64, f64)>,
    /// If only the motion is refined: root mean square difference of the displacements within half
    /// a frame interval, px.
    pub motion_px: Option<f64>,
    /// Residuals of the held-out links.
    pub held_out: Vec<HeldOutResidual>,
    /// One per frame: whether its picture has the code values of the one before.
    pub repeats: Vec<bool>,
}

/// Residuals of a link that was held out of the fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOutResidual {
    pub from: usize,
    pub to: usize,
    /// Residual by recorded poses, root mean square over the picture, px.
    pub recorded_px: f64,
    /// Residual by refined poses, root mean square over the picture, px.
    pub refined_px: f64,
}

impl Registration {
    /// Added to the depth maps' times, s; 0 where the estimate is not significant.
    pub fn depth_later_s(&self) -> f64 {
        let significant = self.depth.filter(|d| d.offset_s.abs() > MIN_DEPTH_OFFSET_S.max(2.0 * d.sigma_s));
        significant.map_or(0.0, |d| d.offset_s)
    }

    pub fn as_recorded(recording: &Recording, geometry: &Geometry, verdict: Verdict) -> Self {
        Self {
            verdict,
            states: recorded(recording, 0.0),
            readout_s: geometry.intrinsics.readout_time_s,
            readout_sigma_s: None,
            readout_parts_sigma_s: None,
            depth: None,
            rig_offset: None,
            links: 0,
            missing: 0,
            held_out_px: None,
            motion_px: None,
            held_out: Vec::new(),
            repeats: Vec::new(),
        }
    }
}

/// Recorded states, one per frame, read `later_s` after the frame's time. Where the track has a
/// pose at the frame's time and none at the later one, the state is extrapolated.
pub fn recorded(recording: &Recording, later_s: f64) -> Vec<Option<CameraState>> {
    let state_at = |&time_s: &f64| {
        let beyond = || CameraState::of(&recording.track, time_s).map(|state| state.extrapolated(later_s));
        CameraState::of(&recording.track, time_s + later_s).or_else(|_| beyond()).ok()
    };
    recording.timestamps_s.iter().map(state_at).collect()
}

/// Why registration ended early.
#[derive(Debug, thiserror::Error)]
pub enum RegistrationError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
