//! How the camera moved between frames that are far apart: as it was recorded, with what was found at the frames put right.
//!
//! Refined poses stand at the frames. A curve through them knows no swing that is faster than half their rate, and a hand has 8
//! to 12 swings a second. Where frames are far apart and poses were recorded far more often, the recorded way is kept, and it is
//! the corrections that are joined: in the camera's own axes, linear in time. Poses within 7.5 ms are averaged: that halves white
//! jitter of 200 poses a second, and takes 5 % of a swing of 10 a second.

use glam::DAffine3;

use super::state::{State, world_from_camera};
use crate::fit::twist::{self, Twist};
use crate::recording::Recording;
use crate::tracking::{PoseTrack, median_interval_s};

/// Frames farther apart do not tell how the camera moved between them, s.
const APART_S: f64 = 0.09;
/// Poses of a way lie at least so many times as close together.
const OFTEN: f64 = 3.0;
/// Poses are averaged over so many each way, so far apart, s.
const AVERAGED: i32 = 2;
const AVERAGED_S: f64 = 0.00375;
/// Of what is written, the shortest step, s.
const LEAST_STEP_S: f64 = 0.004;

/// Whether frames are so far apart that they do not tell how the camera moved at each of them.
pub fn are_far_apart(recording: &Recording) -> bool {
    recording.kind.has_times() && recording.frame_interval_s > APART_S
}

/// Whether the recorded poses do, where frames are far apart.
pub fn moves_as_recorded(recording: &Recording) -> bool {
    let dense = |s: f64| OFTEN * s <= recording.frame_interval_s;
    are_far_apart(recording) && interval_s(&recording.track).is_some_and(dense)
}

fn interval_s(track: &PoseTrack) -> Option<f64> {
    median_interval_s(&track.poses().iter().map(|(time_s, _)| *time_s).collect::<Vec<_>>())
}

/// The recorded way, with what is wrong in all poses alike put right.
#[derive(Clone, Debug)]
pub struct RecordedWay<'a> {
    pub track: &'a PoseTrack,
    /// Added to frame times to look poses up, s.
    pub later_s: f64,
    /// Appended to every pose, in the camera's axes.
    pub hand_eye: Twist,
}

impl RecordedWay<'_> {
    fn at(&self, time_s: f64) -> Option<DAffine3> {
        let of = |by_s: f64| Some(world_from_camera(&self.track.at(time_s + self.later_s + by_s).ok()?));
        let here = of(0.0)?;
        let off = |k: i32| Some(twist::log(&(here.inverse() * of(AVERAGED_S * f64::from(k))?)));
        // At the track's ends there is only what is there.
        let all = (-AVERAGED..=AVERAGED).map(off).collect::<Option<Vec<Twist>>>();
        let mean = all.map_or(Twist::zeros(), |all| all.iter().sum::<Twist>() / all.len() as f64);
        Some(here * twist::exp(&mean) * twist::exp(&self.hand_eye))
    }

    /// What it lacks at a frame, in the camera's axes.
    pub fn lacks(&self, time_s: f64, state: &State) -> Option<Twist> {
        Some(twist::log(&(self.at(time_s)?.inverse() * state.world_from_camera)))
    }

    pub fn corrected(&self, time_s: f64, by: &Twist) -> Option<DAffine3> {
        Some(self.at(time_s)? * twist::exp(by))
    }

    /// Into how many steps so long a way is cut, so that none of its poses is lost.
    pub fn steps(&self, within_s: f64) -> usize {
        let step_s = interval_s(self.track).unwrap_or(within_s).max(LEAST_STEP_S);
        (within_s / step_s).ceil().max(1.0) as usize
    }
}
