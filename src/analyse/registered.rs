//! What became of the recorded poses, and what was found besides.

use super::depth_clock::DepthLater;
use super::global::Global;
use super::interrupted::Interrupted;
use super::state::State;
use crate::camera::Geometry;
use crate::recording::{Recording, RecordingError};

/// A readout with a larger σ is not known, s.
pub const SURE_READOUT_S: f64 = 0.001;
/// A delay of depth below this, or within 2σ, is none, s.
const SAME_DEPTH_S: f64 = 0.004;

/// What becomes of the recorded poses.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// They are replaced.
    Refined,
    /// They are right: nothing is changed.
    Right,
    /// There is nothing to check them by: nothing is changed.
    Kept(String),
    /// Nothing can be said.
    Refused(String),
}

#[derive(Clone, Debug)]
pub struct Registration {
    pub verdict: Verdict,
    /// One per frame, refined, or as recorded where the verdict says so. None where no pose was recorded.
    pub states: Vec<Option<State>>,
    pub readout_s: f64,
    pub readout_sigma_s: Option<f64>,
    pub depth: Option<DepthLater>,
    pub global: Option<Global>,
    pub links: usize,
    pub missing: usize,
    /// How far links that were held out of the fit are from the poses, median, px: as recorded and refined.
    pub held_out_px: Option<(f64, f64)>,
    /// Where poses are kept and the pictures tell another motion: by how much what is seen moves otherwise within half a frame's
    /// interval, px.
    pub motion_px: Option<f64>,
    /// Each of these links.
    pub held_out: Vec<Missed>,
    /// One per frame: whether its picture has the code values of the one before.
    pub repeats: Vec<bool>,
}

/// By how much poses miss a link that was held out of the fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missed {
    pub from: usize,
    pub to: usize,
    /// As recorded and as refined, root mean square over the picture, px.
    pub recorded_px: f64,
    pub refined_px: f64,
}

impl Registration {
    /// Added to the depth maps' times, seconds.
    pub fn depth_later_s(&self) -> f64 {
        self.depth.filter(|d| d.later_s.abs() > SAME_DEPTH_S.max(2.0 * d.sigma_s)).map_or(0.0, |d| d.later_s)
    }

    pub fn as_recorded(recording: &Recording, geometry: &Geometry, verdict: Verdict) -> Self {
        Self {
            verdict,
            states: recorded(recording, 0.0),
            readout_s: geometry.intrinsics.readout_time_s,
            readout_sigma_s: None,
            depth: None,
            global: None,
            links: 0,
            missing: 0,
            held_out_px: None,
            motion_px: None,
            held_out: Vec::new(),
            repeats: Vec::new(),
        }
    }
}

/// One per frame, read `later_s` after its time. Where the track has a pose for the frame and ends before that, the camera moves on
/// as it did.
pub fn recorded(recording: &Recording, later_s: f64) -> Vec<Option<State>> {
    let of = |t: &f64| {
        let time_s = t + recording.time_offset_s;
        let beyond = || State::of(&recording.track, time_s).map(|state| state.moved_on(later_s));
        State::of(&recording.track, time_s + later_s).or_else(|_| beyond()).ok()
    };
    recording.timestamps_s.iter().map(of).collect()
}

#[derive(Debug, thiserror::Error)]
pub enum RegistrationError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
