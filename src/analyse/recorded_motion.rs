//! Motion between frames at a low frame rate: the recorded motion, with the corrections of the
//! frames interpolated.
//!
//! Refined poses exist at the frames only. A curve through them cannot represent motion above half
//! the frame rate, and hand tremor has 8 to 12 Hz. Where the frame rate is low and poses were
//! recorded far more often, the recorded motion is kept and the corrections are interpolated: in
//! the camera's own axes, linear in time. Poses within 7.5 ms are averaged, which halves white
//! jitter at 200 poses per second and attenuates an oscillation of 10 Hz by 5 %.

use glam::DAffine3;

use super::state::{CameraState, world_from_camera};
use crate::fit::twist::{self, Twist};
use crate::recording::Recording;
use crate::tracking::{PoseTrack, median_interval_s};

/// Longest frame interval at which the motion follows from the frames' poses, s.
const MAX_FRAME_INTERVAL_S: f64 = 0.09;
/// Smallest number of recorded poses per frame interval.
const MIN_POSES_PER_FRAME: f64 = 3.0;
/// Moving average of recorded poses: samples to each side, and their interval, s.
const AVERAGE_SAMPLES_PER_SIDE: i32 = 2;
const AVERAGE_STEP_S: f64 = 0.00375;
/// Shortest step between written poses, s.
const MIN_STEP_S: f64 = 0.004;

/// True if frames are too far apart to derive the motion at each from their poses.
pub fn are_far_apart(recording: &Recording) -> bool {
    recording.kind.has_times() && recording.frame_interval_s > MAX_FRAME_INTERVAL_S
}

/// True if frames are too far apart and the recorded poses are dense enough to replace them.
pub fn moves_as_recorded(recording: &Recording) -> bool {
    let dense = |s: f64| MIN_POSES_PER_FRAME * s <= recording.frame_interval_s;
    are_far_apart(recording) && interval_s(&recording.track).is_some_and(dense)
}

fn interval_s(track: &PoseTrack) -> Option<f64> {
    median_interval_s(&track.poses().iter().map(|(time_s, _)| *time_s).collect::<Vec<_>>())
}

/// The recorded motion, corrected by clock and hand-eye offset.
#[derive(Clone, Debug)]
pub struct RecordedMotion<'a> {
    pub track: &'a PoseTrack,
    /// Added to frame times to look poses up, s.
    pub later_s: f64,
    /// Appended to every pose, in the camera's axes.
    pub hand_eye: Twist,
}

impl RecordedMotion<'_> {
    fn at(&self, time_s: f64) -> Option<DAffine3> {
        let pose_after = |by_s: f64| Some(world_from_camera(&self.track.at(time_s + self.later_s + by_s).ok()?));
        let here = pose_after(0.0)?;
        let offset = |k: i32| Some(twist::log(&(here.inverse() * pose_after(AVERAGE_STEP_S * f64::from(k))?)));
        // At the track's ends, where samples are missing, nothing is averaged.
        let all = (-AVERAGE_SAMPLES_PER_SIDE..=AVERAGE_SAMPLES_PER_SIDE).map(offset).collect::<Option<Vec<Twist>>>();
        let mean = all.map_or(Twist::zeros(), |all| all.iter().sum::<Twist>() / all.len() as f64);
        Some(here * twist::exp(&mean) * twist::exp(&self.hand_eye))
    }

    /// The correction at a frame, in the camera's axes: from the recorded pose to the refined one.
    pub fn correction(&self, time_s: f64, state: &CameraState) -> Option<Twist> {
        Some(twist::log(&(self.at(time_s)?.inverse() * state.world_from_camera)))
    }

    pub fn corrected(&self, time_s: f64, by: &Twist) -> Option<DAffine3> {
        Some(self.at(time_s)? * twist::exp(by))
    }

    /// Number of steps for an interval, so that each recorded pose has one.
    pub fn steps(&self, within_s: f64) -> usize {
        let step_s = interval_s(self.track).unwrap_or(within_s).max(MIN_STEP_S);
        (within_s / step_s).ceil().max(1.0) as usize
    }
}
