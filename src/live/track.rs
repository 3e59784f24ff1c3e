//! Poses of live frames: measured ones, predicted ones where those are late, none where tracking is
//! lost.
//!
//! Poses are only appended, and each one is recorded. A frame has the same poses in the recording
//! as long as no later pose changes them. So the track must end after the frame
//! ([`LiveTrack::reaches`]). Otherwise the frame is given up, and no pose is accepted from which a
//! reader of the recording would interpolate across the frame's gap. Poses after a gap are held
//! back until a frame needs them, because the poses within the gap are predicted, or held still
//! while the evidence fades.

use std::collections::VecDeque;

use super::motion_predictor::{HISTORY_S, MotionPredictor};
use super::opacity_fade::{FADE_S, FULL_OPACITY_S};
use crate::pose::Pose;
use crate::text::{fixed, short};
use crate::tracking::PoseTrack;
use crate::tracking::tum::Line;

/// A pose this close to a frame counts as the frame's own, seconds: [`PoseTrack`] allows for
/// rounding by a microsecond.
const TIME_TOLERANCE_S: f64 = 2e-6;
/// Time after the last frame at which a predicted camera rejoins the measured path, seconds: well
/// before the next exposure.
const REJOIN_DELAY_S: f64 = 1e-3;

/// Outcome of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseOutcome {
    Added,
    /// Frames were composited without it, or with a prediction in its place.
    Late,
    /// Unusable: a number is not finite, or the motion is faster than any camera's.
    Implausible,
}

/// Origin of a frame's poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracking {
    Tracked,
    Predicted,
    Lost,
}

/// Pose track of a live camera: measured, predicted or dead-reckoned poses, append-only.
#[derive(Debug)]
pub struct LiveTrack {
    track: PoseTrack,
    max_gap_s: f64,
    /// Longest prediction after the last measured pose, seconds.
    predict_s: f64,
    /// Poses of the last [`HISTORY_S`] or slightly more, for the prediction: measured ones,
    /// followed by dead-reckoned ones.
    history: Vec<(f64, Pose)>,
    /// The last measured pose.
    measured: Option<(f64, Pose)>,
    /// Poses from the motion of the pictures, for frames without a measured one.
    dead_reckoned: VecDeque<(f64, Pose)>,
    /// Time of the last frame, frame interval, and the time before a frame in which poses matter,
    /// seconds.
    frame_s: f64,
    interval_s: f64,
    reach_s: f64,
    /// Poses after a gap, held back.
    held_back: VecDeque<(f64, Pose)>,
    last_s: f64,
    /// Poses up to this time are late, because of a frame that was given up.
    given_up_s: f64,
    is_lost: bool,
    unrecorded: Vec<Line>,
    /// Number of consecutive consistent poses up to the last measured one, at most [`MAX_SUPPORT`].
    support: usize,
    /// Consecutive poses that agree with each other, but not with the last measured one.
    outliers: Vec<(f64, Pose)>,
    message: Option<String>,
    /// Message about an outlier while the current path has little support, held until one of the
    /// two is rejected.
    pending_rejection: Option<String>,
    has_reported_rejection: bool,
    /// True until the camera has been relocated for the first time.
    is_first_path: bool,
}

/// Capacity for dead-reckoned poses that wait for their frames; as many frames may wait.
const DEAD_RECKONED_CAPACITY: usize = 16;
/// Largest plausible speeds of a camera, m/s and rad/s. A whip pan by hand has 10 rad/s, a car 50
/// m/s.
const MAX_SPEED_M_S: f64 = 60.0;
const MAX_TURN_RATE_RAD_S: f64 = 60.0;

/// Cap on the support of the current path: eleven consistent poses elsewhere always replace it.
const MAX_SUPPORT: usize = 10;

/// True if no camera moves from one pose to the other in this time. Bogus poses would cause motion
/// blur of unbounded extent and cost.
fn is_implausible_motion(from: &Pose, to: &Pose, in_s: f64) -> bool {
    let in_s = in_s.max(0.0);
    let moved_m = from.position_in_world_m().distance(to.position_in_world_m());
    let turned = from.world_from_camera_rotation().angle_between(to.world_from_camera_rotation());
    // Simultaneous poses differ by their noise.
    moved_m > 0.05 + MAX_SPEED_M_S * in_s || turned > 0.05 + MAX_TURN_RATE_RAD_S * in_s
}

impl LiveTrack {
    /// Interpolates across gaps of at most `max_gap_s` and predicts for as long, seconds.
    pub fn new(max_gap_s: f64) -> Self {
        Self {
            track: PoseTrack::growing(max_gap_s),
            max_gap_s,
            predict_s: max_gap_s,
            history: Vec::new(),
            measured: None,
            dead_reckoned: VecDeque::new(),
            frame_s: f64::NEG_INFINITY,
            interval_s: 0.0,
            reach_s: 0.0,
            held_back: VecDeque::new(),
            last_s: f64::NEG_INFINITY,
            given_up_s: f64::NEG_INFINITY,
            is_lost: true,
            unrecorded: Vec::new(),
            support: 0,
            outliers: Vec::new(),
            message: None,
            pending_rejection: None,
            has_reported_rejection: false,
            is_first_path: true,
        }
    }

    pub fn track(&self) -> &PoseTrack {
        &self.track
    }

    /// Takes the poses that were added since the last call.
    pub fn take_unrecorded(&mut self) -> Vec<Line> {
        std::mem::take(&mut self.unrecorded)
    }

    /// Adds a measured pose.
    pub fn add(&mut self, time_s: f64, pose: &Pose) -> PoseOutcome {
        let numbers = [time_s].into_iter().chain(pose.rotation.to_array()).chain(pose.translation_m.to_array());
        if !numbers.into_iter().all(f64::is_finite) || (pose.rotation.length() - 1.0).abs() > 1e-3 {
            return PoseOutcome::Implausible;
        }
        // A late pose has no information about the present position.
        if time_s <= self.measured_s() {
            return PoseOutcome::Late;
        }
        // Implausible motion is accepted only between distant frames: the camera was moved, or the
        // tracker restarted.
        if let Some(measured) =
            self.measured.filter(|(before_s, before)| is_implausible_motion(before, pose, time_s - before_s))
        {
            return self.add_outlier(measured, (time_s, *pose));
        }
        self.outliers.clear();
        if let Some(pending_rejection) = self.pending_rejection.take() {
            self.report_rejection(pending_rejection);
        }
        match self.held_back.back() {
            Some((newest_s, _)) if time_s <= *newest_s => return PoseOutcome::Late,
            None if self.is_lost || !self.is_after_gap(time_s) => return self.append(time_s, pose),
            _ => self.held_back.push_back((time_s, *pose)),
        }
        PoseOutcome::Added
    }

    /// Adds a pose that is implausible after the last measured one. The camera is relocated there
    /// if more poses agree with it than with the current path. It then counts as lost until no pose
    /// is interpolated between the two places.
    fn add_outlier(&mut self, (measured_s, measured): (f64, Pose), (time_s, pose): (f64, Pose)) -> PoseOutcome {
        let agrees = |(s, outlier): &(f64, Pose)| time_s > *s && !is_implausible_motion(outlier, &pose, time_s - s);
        if !self.outliers.last().is_some_and(agrees) {
            self.outliers.clear();
        }
        self.outliers.push((time_s, pose));
        let moved_m = measured.position_in_world_m().distance(pose.position_in_world_m());
        let turned_deg =
            measured.world_from_camera_rotation().angle_between(pose.world_from_camera_rotation()).to_degrees();
        let deviation = format!(
            "{} m and {}° away after {} s",
            short(moved_m),
            fixed(turned_deg, 0),
            fixed(time_s - measured_s, 3)
        );
        if self.outliers.len() <= self.support {
            match self.support {
                MAX_SUPPORT => self.report_rejection(deviation),
                _ => _ = self.pending_rejection.get_or_insert(deviation),
            }
            return PoseOutcome::Implausible;
        }
        let poses = self.outliers.len();
        self.message = Some(match (self.support, self.is_first_path) {
            (MAX_SUPPORT, _) => format!("the camera has moved abruptly: {poses} consistent poses {deviation}"),
            (1, true) => format!("the first pose is left out as implausible: {poses} consistent poses {deviation}"),
            (1, false) => format!("a single pose is left out as implausible: {poses} consistent poses {deviation}"),
            (few, true) => {
                format!("the first {few} poses are left out as implausible: {poses} consistent ones {deviation}")
            }
            (few, false) => format!("{few} poses are left out as implausible: {poses} consistent ones {deviation}"),
        });
        (self.pending_rejection, self.is_first_path) = (None, false);
        self.held_back.clear();
        self.dead_reckoned.clear();
        self.history.clear();
        (self.measured, self.support, self.is_lost) = (None, 0, true);
        let outliers = std::mem::take(&mut self.outliers);
        outliers.into_iter().map(|(time_s, pose)| self.add(time_s, &pose)).last().unwrap_or(PoseOutcome::Implausible)
    }

    /// Reports the first rejected pose.
    fn report_rejection(&mut self, deviation: String) {
        if !std::mem::replace(&mut self.has_reported_rejection, true) {
            self.message =
                Some(format!("a pose was dropped as implausible: {deviation}; further ones are only counted"));
        }
    }

    /// Takes the pending message for the user, if any.
    pub fn take_message(&mut self) -> Option<String> {
        self.message.take()
    }

    /// True if no poses are interpolated between the last pose and this time. Same comparison as
    /// the reader's.
    fn is_after_gap(&self, time_s: f64) -> bool {
        self.last_s == f64::NEG_INFINITY || time_s - self.last_s > self.max_gap_s
    }

    /// Appends a pose, unless it is late.
    fn append(&mut self, time_s: f64, pose: &Pose) -> PoseOutcome {
        let bridges = self.is_lost && !self.is_after_gap(time_s);
        if time_s <= self.last_s || time_s <= self.given_up_s || bridges {
            return PoseOutcome::Late;
        }
        if !self.is_lost && !self.is_after_gap(time_s) {
            self.rejoin(time_s, pose);
        }
        let pose = self.push(time_s, pose);
        if self.is_lost {
            self.history.clear();
            self.is_lost = false;
        }
        self.measured = Some((time_s, pose));
        self.support = (self.support + 1).min(MAX_SUPPORT);
        self.extend_history(time_s, pose);
        PoseOutcome::Added
    }

    /// Adds a pose to the prediction's history.
    fn extend_history(&mut self, time_s: f64, pose: Pose) {
        self.history.push((time_s, pose));
        // Keeps one pose before the span.
        let old = self.history.iter().skip(1).take_while(|(t, _)| *t <= time_s - HISTORY_S).count();
        self.history.drain(..old);
    }

    /// Returns a predicted camera to the measured path before the next exposure, so that no
    /// exposure contains the step and blurs it. The path is interpolated from the last observed
    /// pose, not from the predicted one. Skipped if exposures overlap.
    fn rejoin(&mut self, to_s: f64, to: &Pose) {
        let Some(&(from_s, from)) =
            self.history.last().filter(|(observed_s, _)| self.last_s > observed_s + TIME_TOLERANCE_S)
        else {
            return;
        };
        let time_s = self.last_s + REJOIN_DELAY_S;
        let next_from_s = self.frame_s + self.interval_s - self.reach_s;
        if time_s < next_from_s.min(to_s - TIME_TOLERANCE_S) {
            let pose = from.interpolate(to, (time_s - from_s) / (to_s - from_s));
            self.push(time_s, &pose);
        }
    }

    /// Adds a dead-reckoned pose of a frame without a detection. It is used if no measured pose
    /// arrives.
    pub fn add_dead_reckoned(&mut self, time_s: f64, pose: &Pose) {
        let numbers = [time_s].into_iter().chain(pose.rotation.to_array()).chain(pose.translation_m.to_array());
        let is_implausible =
            self.measured.is_none_or(|(before_s, before)| is_implausible_motion(&before, pose, time_s - before_s));
        if numbers.into_iter().all(f64::is_finite) && !is_implausible {
            self.dead_reckoned.push_back((time_s, *pose));
        }
        if self.dead_reckoned.len() > DEAD_RECKONED_CAPACITY {
            self.dead_reckoned.pop_front();
        }
    }

    fn measured_s(&self) -> f64 {
        self.measured.map_or(f64::NEG_INFINITY, |(measured_s, _)| measured_s)
    }

    /// Appends a pose, rounded as a reader of the recording gets it.
    fn push(&mut self, time_s: f64, pose: &Pose) -> Pose {
        let line = Line::new(time_s, pose);
        let pose = line.pose();
        if self.track.push(time_s, pose).is_ok() {
            self.unrecorded.push(line);
            self.last_s = time_s;
        }
        pose
    }

    /// True if no pose that is added from now on changes the poses up to a time.
    pub fn reaches(&self, to_s: f64) -> bool {
        self.held_back.back().map_or(self.last_s, |(time_s, _)| *time_s) >= to_s + TIME_TOLERANCE_S
    }

    /// Appends the poses held back after a gap, once a frame or the prediction reaches them; up to
    /// the next gap.
    fn append_held_back(&mut self, to_s: f64) {
        while let Some((time_s, pose)) = self.held_back.front().copied() {
            let is_reached = time_s <= to_s + 3.0 * TIME_TOLERANCE_S || !(self.is_lost || self.is_after_gap(time_s));
            if !is_reached {
                return;
            }
            self.append(time_s, &pose);
            self.held_back.pop_front();
        }
    }

    /// Time since the last measured pose, seconds; negative if it is later than `time_s`.
    pub fn since_measured_s(&self, time_s: f64) -> f64 {
        time_s - self.measured_s()
    }

    /// Confidence of the predicted pose at a time, 0 to 1.
    pub fn confidence(&self, time_s: f64) -> f64 {
        MotionPredictor::of(&self.history).map_or(1.0, |motion| motion.confidence(time_s))
    }

    /// Makes the poses of a frame final, for the span in which they matter: measured, or predicted;
    /// or the frame is given up.
    pub fn finalize(&mut self, at_s: f64, [from_s, to_s]: [f64; 2]) -> Tracking {
        let has_pose = |track: &PoseTrack, then| if track.at(at_s).is_ok() { then } else { Tracking::Lost };
        self.append_held_back(to_s);
        if at_s > self.frame_s {
            (self.interval_s, self.frame_s) = (at_s - self.frame_s, at_s);
        }
        self.reach_s = at_s - from_s;
        self.dead_reckoned.retain(|(time_s, _)| *time_s > self.last_s);
        if self.last_s >= to_s + TIME_TOLERANCE_S {
            return has_pose(&self.track, Tracking::Tracked);
        }
        let measured_s = self.measured_s();
        if self.is_lost || from_s > measured_s + self.predict_s.max(FULL_OPACITY_S + FADE_S) {
            self.is_lost = true;
            // Where predictions reach into the frame, the last one must stay nearer than any later
            // pose.
            let beyond_s = if self.last_s > from_s { to_s - self.last_s } else { 0.0 };
            self.given_up_s = to_s + beyond_s.max(0.0) + TIME_TOLERANCE_S;
            return has_pose(&self.track, Tracking::Predicted);
        }
        let end_s = to_s + 2.0 * TIME_TOLERANCE_S;
        self.append_dead_reckoned(at_s);
        // The steps are shorter than a gap.
        let (first_s, steps) = (self.last_s, ((end_s - self.last_s) / (0.5 * self.max_gap_s)).ceil().max(1.0));
        for step in 1..=steps as u32 {
            let time_s =
                if f64::from(step) == steps { end_s } else { first_s + (end_s - first_s) * f64::from(step) / steps };
            if let Some(pose) = self.predicted(time_s) {
                self.push(time_s, &pose);
            }
        }
        // If the pose at the frame's time is measured, only the rest of its exposure is predicted.
        let then = if measured_s + TIME_TOLERANCE_S >= at_s { Tracking::Tracked } else { Tracking::Predicted };
        has_pose(&self.track, then)
    }

    /// Prediction from the history, constant after its time limit.
    fn predicted(&self, time_s: f64) -> Option<Pose> {
        let (newest_s, _) = self.history.last()?;
        Some(MotionPredictor::of(&self.history)?.at(time_s.min(newest_s + self.predict_s)))
    }

    /// Appends the dead-reckoned poses up to a frame's time, as long as there is no gap before
    /// them.
    fn append_dead_reckoned(&mut self, at_s: f64) {
        while let Some((time_s, pose)) = self.dead_reckoned.pop_front_if(|(time_s, _)| *time_s <= at_s) {
            if time_s > self.last_s && !self.is_after_gap(time_s) {
                let pose = self.push(time_s, &pose);
                self.extend_history(time_s, pose);
            }
        }
    }

    /// Drops the poses that no frame from this time on needs.
    pub fn trim(&mut self, from_s: f64) {
        self.track.trim(from_s);
    }
}

#[cfg(test)]
mod tests;
