//! The poses that frames are given while they come: real ones, predicted where those are late, none where the camera
//! is lost.
//!
//! Poses are only ever added behind the last one, and every one is given out to be recorded. So a frame's poses are the
//! same in the recording, as long as nothing that is added later reaches into the frame: the track must end behind the
//! frame ([`LiveTrack::reaches`]), or the frame is given up, and then no pose is taken from which the recording's reader
//! would bridge the gap that the frame is in. Poses behind a gap wait until a frame needs them, for those in it are
//! predicted, or held still while the evidence fades.

use std::collections::VecDeque;

use super::motion::{LOOKS_BACK_S, Motion};
use super::presence::{FADE_S, WHOLE_S};
use crate::pose::Pose;
use crate::text::{fixed, short};
use crate::tracking::PoseTrack;
use crate::tracking::tum::Line;

/// A pose this near a frame counts as its own: [`PoseTrack`] allows for rounding by a microsecond.
const NEAR_S: f64 = 2e-6;
/// A camera that is found is brought where it is so soon behind the last frame, seconds: long before the next one's exposure.
const BROUGHT_S: f64 = 1e-3;

/// What became of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseTaken {
    Added,
    /// Frames were composited without it, or by a prediction in its place.
    Late,
    /// It cannot be used: a number is not finite, or no camera moves so fast.
    Odd,
}

/// How a frame has its poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracking {
    Tracked,
    Predicted,
    Lost,
}

#[derive(Debug)]
pub struct LiveTrack {
    track: PoseTrack,
    max_gap_s: f64,
    /// How far beyond the last real pose motion is predicted, seconds.
    predict_s: f64,
    /// The newest poses by which the camera goes on, over [`LOOKS_BACK_S`] or a little more: real ones, and behind them those
    /// that were carried.
    seen: Vec<(f64, Pose)>,
    /// The last real one.
    real: Option<(f64, Pose)>,
    /// By how the pictures move, for frames without a real one.
    carried: VecDeque<(f64, Pose)>,
    /// The last frame's time, from one to the next, and how long before its time poses matter, seconds.
    frame_s: f64,
    interval_s: f64,
    reach_s: f64,
    /// Poses that came behind a gap.
    ahead: VecDeque<(f64, Pose)>,
    last_s: f64,
    /// Poses up to here come too late for a frame that was given up.
    given_up_s: f64,
    is_lost: bool,
    new: Vec<Line>,
    /// Poses in a row that agree with each other, up to the last real one; no more than [`MAX_SUPPORT`].
    support: usize,
    /// Poses in a row that agree with each other, and not with the last real one.
    strays: Vec<(f64, Pose)>,
    told: Option<String>,
    /// About a stray beside a place that few poses support, until it is known which of the two is left out.
    doubt: Option<String>,
    has_told_stray: bool,
    /// Whether the current place is the first one.
    is_first_place: bool,
}

/// Poses that are carried and wait for their frames; as many frames may wait.
const MOST_CARRIED: usize = 16;
/// No camera that sees anything is moved or turned faster: m/s, rad/s. A hand's whip pan has 10 rad/s, a car 50 m/s.
const FASTEST_M_S: f64 = 60.0;
const FASTEST_RAD_S: f64 = 60.0;

/// Cap on the support of the current place: eleven consistent poses elsewhere always replace it.
const MAX_SUPPORT: usize = 10;

/// Whether nobody gets from one pose to another in so many seconds. What a sender makes up would be blurred all over the
/// picture, at a cost without bounds.
fn is_wild(from: &Pose, to: &Pose, in_s: f64) -> bool {
    let in_s = in_s.max(0.0);
    let moved_m = from.position_in_world_m().distance(to.position_in_world_m());
    let turned = from.world_from_camera_rotation().angle_between(to.world_from_camera_rotation());
    // Poses of one moment differ by their noise.
    moved_m > 0.05 + FASTEST_M_S * in_s || turned > 0.05 + FASTEST_RAD_S * in_s
}

impl LiveTrack {
    /// Interpolates across at most `max_gap_s`, and predicts up to as far, seconds.
    pub fn new(max_gap_s: f64) -> Self {
        Self {
            track: PoseTrack::growing(max_gap_s),
            max_gap_s,
            predict_s: max_gap_s,
            seen: Vec::new(),
            real: None,
            carried: VecDeque::new(),
            frame_s: f64::NEG_INFINITY,
            interval_s: 0.0,
            reach_s: 0.0,
            ahead: VecDeque::new(),
            last_s: f64::NEG_INFINITY,
            given_up_s: f64::NEG_INFINITY,
            is_lost: true,
            new: Vec::new(),
            support: 0,
            strays: Vec::new(),
            told: None,
            doubt: None,
            has_told_stray: false,
            is_first_place: true,
        }
    }

    pub fn track(&self) -> &PoseTrack {
        &self.track
    }

    /// The poses that were added since this was last asked.
    pub fn take_new(&mut self) -> Vec<Line> {
        std::mem::take(&mut self.new)
    }

    /// Adds a pose that was measured.
    pub fn add(&mut self, time_s: f64, pose: &Pose) -> PoseTaken {
        let numbers = [time_s].into_iter().chain(pose.rotation.to_array()).chain(pose.translation_m.to_array());
        if !numbers.into_iter().all(f64::is_finite) || (pose.rotation.length() - 1.0).abs() > 1e-3 {
            return PoseTaken::Odd;
        }
        // A late one says nothing of where the camera is by now.
        if time_s <= self.real_s() {
            return PoseTaken::Late;
        }
        // Only frames that are far apart may be: then the camera was carried, or the tracker began anew.
        if let Some(real) = self.real.filter(|(before_s, before)| is_wild(before, pose, time_s - before_s)) {
            return self.stray(real, (time_s, *pose));
        }
        self.strays.clear();
        if let Some(doubt) = self.doubt.take() {
            self.tell_stray(doubt);
        }
        match self.ahead.back() {
            Some((newest_s, _)) if time_s <= *newest_s => return PoseTaken::Late,
            None if self.is_lost || !self.is_apart(time_s) => return self.take(time_s, pose),
            _ => self.ahead.push_back((time_s, *pose)),
        }
        PoseTaken::Added
    }

    /// Takes a pose to which no camera gets from the last real one. If more poses agree with it than did with that one, the
    /// camera is there: it counts as lost until no pose is interpolated between the two places.
    fn stray(&mut self, (real_s, real): (f64, Pose), (time_s, pose): (f64, Pose)) -> PoseTaken {
        let agrees = |(s, stray): &(f64, Pose)| time_s > *s && !is_wild(stray, &pose, time_s - s);
        if !self.strays.last().is_some_and(agrees) {
            self.strays.clear();
        }
        self.strays.push((time_s, pose));
        let moved_m = real.position_in_world_m().distance(pose.position_in_world_m());
        let turned_deg =
            real.world_from_camera_rotation().angle_between(pose.world_from_camera_rotation()).to_degrees();
        let apart =
            format!("{} m and {}° away after {} s", short(moved_m), fixed(turned_deg, 0), fixed(time_s - real_s, 3));
        if self.strays.len() <= self.support {
            match self.support {
                MAX_SUPPORT => self.tell_stray(apart),
                _ => _ = self.doubt.get_or_insert(apart),
            }
            return PoseTaken::Odd;
        }
        let poses = self.strays.len();
        self.told = Some(match (self.support, self.is_first_place) {
            (MAX_SUPPORT, _) => format!("the camera has moved abruptly: {poses} consistent poses {apart}"),
            (1, true) => format!("the first pose is left out as implausible: {poses} consistent poses {apart}"),
            (1, false) => format!("a single pose is left out as implausible: {poses} consistent poses {apart}"),
            (few, true) => {
                format!("the first {few} poses are left out as implausible: {poses} consistent ones {apart}")
            }
            (few, false) => format!("{few} poses are left out as implausible: {poses} consistent ones {apart}"),
        });
        (self.doubt, self.is_first_place) = (None, false);
        self.ahead.clear();
        self.carried.clear();
        self.seen.clear();
        (self.real, self.support, self.is_lost) = (None, 0, true);
        let strays = std::mem::take(&mut self.strays);
        strays.into_iter().map(|(time_s, pose)| self.add(time_s, &pose)).last().unwrap_or(PoseTaken::Odd)
    }

    /// Reports the first pose that is dropped.
    fn tell_stray(&mut self, apart: String) {
        if !std::mem::replace(&mut self.has_told_stray, true) {
            self.told = Some(format!("a pose was dropped as implausible: {apart}; further ones are only counted"));
        }
    }

    /// Takes the pending message for the user, if any.
    pub fn told(&mut self) -> Option<String> {
        self.told.take()
    }

    /// Whether no pose is interpolated between the last one and one at a time: the same difference as the reader's.
    fn is_apart(&self, time_s: f64) -> bool {
        self.last_s == f64::NEG_INFINITY || time_s - self.last_s > self.max_gap_s
    }

    /// Adds a pose to the track, unless it is too late.
    fn take(&mut self, time_s: f64, pose: &Pose) -> PoseTaken {
        let bridges = self.is_lost && !self.is_apart(time_s);
        if time_s <= self.last_s || time_s <= self.given_up_s || bridges {
            return PoseTaken::Late;
        }
        if !self.is_lost && !self.is_apart(time_s) {
            self.bring(time_s, pose);
        }
        let pose = self.push(time_s, pose);
        if self.is_lost {
            self.seen.clear();
            self.is_lost = false;
        }
        self.real = Some((time_s, pose));
        self.support = (self.support + 1).min(MAX_SUPPORT);
        self.see(time_s, pose);
        PoseTaken::Added
    }

    /// A pose by which the camera goes on.
    fn see(&mut self, time_s: f64, pose: Pose) {
        self.seen.push((time_s, pose));
        // One before the span is kept.
        let old = self.seen.iter().skip(1).take_while(|(t, _)| *t <= time_s - LOOKS_BACK_S).count();
        self.seen.drain(..old);
    }

    /// Brings a camera that was predicted onto its real way before it is seen again, so that no exposure has the step between
    /// the two in it: nothing is smeared by that. Its way is that from where it was seen last, not from where it was predicted.
    /// Not where exposures reach into each other.
    fn bring(&mut self, to_s: f64, to: &Pose) {
        let Some(&(from_s, from)) = self.seen.last().filter(|(seen_s, _)| self.last_s > seen_s + NEAR_S) else {
            return;
        };
        let time_s = self.last_s + BROUGHT_S;
        let next_from_s = self.frame_s + self.interval_s - self.reach_s;
        if time_s < next_from_s.min(to_s - NEAR_S) {
            let pose = from.interpolate(to, (time_s - from_s) / (to_s - from_s));
            self.push(time_s, &pose);
        }
    }

    /// Takes a pose of a frame in which the camera was not found: the last one, carried on by how the picture moved. It counts
    /// where no real one comes.
    pub fn carry(&mut self, time_s: f64, pose: &Pose) {
        let numbers = [time_s].into_iter().chain(pose.rotation.to_array()).chain(pose.translation_m.to_array());
        let is_wild = self.real.is_none_or(|(before_s, before)| is_wild(&before, pose, time_s - before_s));
        if numbers.into_iter().all(f64::is_finite) && !is_wild {
            self.carried.push_back((time_s, *pose));
        }
        if self.carried.len() > MOST_CARRIED {
            self.carried.pop_front();
        }
    }

    fn real_s(&self) -> f64 {
        self.real.map_or(f64::NEG_INFINITY, |(real_s, _)| real_s)
    }

    /// Adds a pose as the recording's reader will read it.
    fn push(&mut self, time_s: f64, pose: &Pose) -> Pose {
        let line = Line::new(time_s, pose);
        let pose = line.pose();
        if self.track.push(time_s, pose).is_ok() {
            self.new.push(line);
            self.last_s = time_s;
        }
        pose
    }

    /// Whether nothing that is added from now on changes poses up to a time.
    pub fn reaches(&self, to_s: f64) -> bool {
        self.ahead.back().map_or(self.last_s, |(time_s, _)| *time_s) >= to_s + NEAR_S
    }

    /// Takes the poses behind a gap once a frame reaches them, or what was predicted does; up to the next gap.
    fn take_ahead(&mut self, to_s: f64) {
        while let Some((time_s, pose)) = self.ahead.front().copied() {
            let is_reached = time_s <= to_s + 3.0 * NEAR_S || !(self.is_lost || self.is_apart(time_s));
            if !is_reached {
                return;
            }
            self.take(time_s, &pose);
            self.ahead.pop_front();
        }
    }

    /// How long before a time the last real pose was, seconds; less than nothing if one behind it is known.
    pub fn since_real_s(&self, time_s: f64) -> f64 {
        time_s - self.real_s()
    }

    /// How far the pose at a time can be trusted, 0 to 1.
    pub fn trust(&self, time_s: f64) -> f64 {
        Motion::of(&self.seen).map_or(1.0, |motion| motion.trust(time_s))
    }

    /// Sees to it that a frame at a time, which needs poses from before to after it, need not wait any longer: they are
    /// there, or are predicted, or it is given up.
    pub fn settle(&mut self, at_s: f64, [from_s, to_s]: [f64; 2]) -> Tracking {
        let has_pose = |track: &PoseTrack, then| if track.at(at_s).is_ok() { then } else { Tracking::Lost };
        self.take_ahead(to_s);
        if at_s > self.frame_s {
            (self.interval_s, self.frame_s) = (at_s - self.frame_s, at_s);
        }
        self.reach_s = at_s - from_s;
        self.carried.retain(|(time_s, _)| *time_s > self.last_s);
        if self.last_s >= to_s + NEAR_S {
            return has_pose(&self.track, Tracking::Tracked);
        }
        let real_s = self.real_s();
        if self.is_lost || from_s > real_s + self.predict_s.max(WHOLE_S + FADE_S) {
            self.is_lost = true;
            // Where predictions reach into it, the last of them must stay nearer than any pose to come.
            let beyond_s = if self.last_s > from_s { to_s - self.last_s } else { 0.0 };
            self.given_up_s = to_s + beyond_s.max(0.0) + NEAR_S;
            return has_pose(&self.track, Tracking::Predicted);
        }
        let end_s = to_s + 2.0 * NEAR_S;
        self.take_carried(at_s);
        // In steps that are no gap.
        let (first_s, steps) = (self.last_s, ((end_s - self.last_s) / (0.5 * self.max_gap_s)).ceil().max(1.0));
        for step in 1..=steps as u32 {
            let time_s =
                if f64::from(step) == steps { end_s } else { first_s + (end_s - first_s) * f64::from(step) / steps };
            if let Some(pose) = self.predicted(time_s) {
                self.push(time_s, &pose);
            }
        }
        // Of a frame whose own moment is known only the rest of its exposure is predicted.
        let then = if real_s + NEAR_S >= at_s { Tracking::Tracked } else { Tracking::Predicted };
        has_pose(&self.track, then)
    }

    /// The last motion that was seen, on as far as it may be, and still from there.
    fn predicted(&self, time_s: f64) -> Option<Pose> {
        let (newest_s, _) = self.seen.last()?;
        Some(Motion::of(&self.seen)?.at(time_s.min(newest_s + self.predict_s)))
    }

    /// Takes what was carried up to a frame's time, as long as no gap lies before it.
    fn take_carried(&mut self, at_s: f64) {
        while let Some((time_s, pose)) = self.carried.pop_front_if(|(time_s, _)| *time_s <= at_s) {
            if time_s > self.last_s && !self.is_apart(time_s) {
                let pose = self.push(time_s, &pose);
                self.see(time_s, pose);
            }
        }
    }

    /// Drops what no frame from a time on needs.
    pub fn trim(&mut self, from_s: f64) {
        self.track.trim(from_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    fn at(x: f64) -> Pose {
        Pose::from_camera_in_world(DVec3::new(x, 0.0, 0.0), DQuat::from_rotation_y(0.1 * x))
    }

    #[test]
    fn motion_is_predicted_as_it_was_and_late_poses_are_left_out() {
        let mut t = LiveTrack::new(0.1);
        assert_eq!(t.settle(0.005, [0.0, 0.01]), Tracking::Lost);
        // 2 m/s.
        for i in 2..=5 {
            assert_eq!(t.add(0.01 * f64::from(i), &at(0.02 * f64::from(i))), PoseTaken::Added);
        }
        assert_eq!(t.settle(0.035, [0.03, 0.04]), Tracking::Tracked);
        assert_eq!(t.settle(0.08, [0.06, 0.09]), Tracking::Predicted);
        let x = |t: &LiveTrack, time_s| t.track().at(time_s).unwrap().position_in_world_m().x;
        // It dies away: 0.1 + 2 · 0.1 · (1 − e^(−0.4)) at 0.09 s, and evenly until there.
        let expected = 0.1 + 0.2 * (1.0 - (-0.4f64).exp()) * 0.75;
        assert!((x(&t, 0.08) - expected).abs() < 1e-4 && t.track().covers(0.06, 0.09).is_ok());
        let turn = t.track().at(0.08).unwrap().world_from_camera_rotation();
        assert!(turn.angle_between(DQuat::from_rotation_y(0.1 * expected)) < 1e-5);
        assert_eq!(t.add(0.08, &at(0.17)), PoseTaken::Late);
        assert_eq!(t.add(0.10, &at(0.2)), PoseTaken::Added);
        assert_eq!(t.add(f64::NAN, &at(0.2)), PoseTaken::Odd);
        // All that is used is given out, and once.
        assert_eq!(t.take_new().len(), t.track().poses().len());
        assert!(t.take_new().is_empty());
    }

    #[test]
    fn what_no_camera_does_is_left_out_until_it_could_have() {
        let mut t = LiveTrack::new(0.1);
        assert_eq!(t.add(1.0, &at(0.0)), PoseTaken::Added);
        // 3 m in 5 ms, and a turn of 0.9 rad.
        assert_eq!(t.add(1.005, &at(3.0)), PoseTaken::Odd);
        assert_eq!(t.add(1.01, &Pose::from_camera_in_world(DVec3::ZERO, DQuat::from_rotation_y(0.9))), PoseTaken::Odd);
        assert_eq!((t.told(), t.add(1.015, &at(0.1))), (None, PoseTaken::Added));
        let told = t.told().unwrap();
        assert!(told.starts_with("a pose was dropped as implausible: 3 m and ") && told.contains("0.005 s"), "{told}");
        // The tracker is elsewhere from now on.
        assert_eq!(t.add(1.02, &at(6.0)), PoseTaken::Odd);
        assert_eq!(t.add(1.13, &at(6.0)), PoseTaken::Added);
    }

    #[test]
    fn first_pose_far_away_gives_way_to_those_that_agree() {
        // No pose's time is at the gap's very end, where rounding would decide.
        let mut t = LiveTrack::new(0.105);
        assert_eq!(t.add(1.0, &at(1e9)), PoseTaken::Added);
        assert_eq!(t.add(1.01, &at(0.01)), PoseTaken::Odd);
        // Which of the two is wild is not known yet.
        assert_eq!(t.told(), None);
        // Nothing is interpolated between the two places.
        assert_eq!(t.add(1.02, &at(0.02)), PoseTaken::Late);
        let told = t.told().unwrap();
        let expected = "the first pose is left out as implausible: 2 consistent poses 1000000000 m and ";
        assert!(told.starts_with(expected) && told.ends_with("away after 0.020 s"), "{told}");
        let taken: Vec<_> = (3..=15).map(|i| t.add(1.0 + 0.01 * f64::from(i), &at(0.01 * f64::from(i)))).collect();
        assert_eq!(taken.iter().filter(|taken| **taken == PoseTaken::Added).count(), 5, "{taken:?}");
        assert!(t.track().at(1.05).is_err() && t.told().is_none());
        assert!((t.track().at(1.13).unwrap().position_in_world_m().x - 0.13).abs() < 1e-9);
    }

    #[test]
    fn late_pose_far_away_is_late_and_drops_none_that_follow() {
        let mut t = LiveTrack::new(0.1);
        assert_eq!(t.add(1.0, &at(0.0)), PoseTaken::Added);
        // Two that agree would win over one.
        for time_s in [0.98, 0.99, 1.0] {
            assert_eq!(t.add(time_s, &at(3.0)), PoseTaken::Late);
        }
        assert_eq!((t.told(), t.add(1.01, &at(0.01))), (None, PoseTaken::Added));
    }

    #[test]
    fn camera_that_begins_anew_far_away_is_followed_with_the_eleventh_pose() {
        let mut t = LiveTrack::new(0.1);
        for i in 0..100 {
            assert_eq!(t.add(0.01 * f64::from(i), &at(0.0)), PoseTaken::Added);
        }
        // Some that agree with nothing, and with each other neither.
        for (i, x) in [1e3, -1e3, 1e3, -1e3].into_iter().enumerate() {
            assert_eq!(t.add(1.0 + 0.01 * i as f64, &at(x)), PoseTaken::Odd);
        }
        assert_eq!(t.add(1.04, &at(0.0)), PoseTaken::Added);
        let taken: Vec<_> = (0..11).map(|i| t.add(1.05 + 0.01 * f64::from(i), &at(1e3))).collect();
        assert!(taken[..10].iter().all(|taken| *taken == PoseTaken::Odd), "{taken:?}");
        assert_eq!(taken[10], PoseTaken::Added);
        let told = t.told().unwrap();
        assert!(told.starts_with("the camera has moved abruptly: 11 consistent poses 1000 m and "), "{told}");
    }

    #[test]
    fn a_frame_that_was_given_up_stays_without_a_pose() {
        let mut t = LiveTrack::new(0.1);
        t.add(1.0, &at(0.0));
        t.add(1.02, &at(0.1));
        assert_eq!(t.settle(1.115, [1.11, 1.12]), Tracking::Predicted);
        assert_eq!(t.settle(1.295, [1.29, 1.30]), Tracking::Predicted);
        // 5 m/s that die away for a tenth of a second, and still from there: 0.1 + 0.5 · (1 − 1/e).
        let x = |t: &LiveTrack, time_s| t.track().at(time_s).unwrap().position_in_world_m().x;
        assert!((x(&t, 1.12) - 0.41606).abs() < 1e-4 && (x(&t, 1.295) - 0.41606).abs() < 1e-5);
        assert_eq!(t.settle(1.335, [1.33, 1.34]), Tracking::Lost);
        // From here the reader would bridge the frame.
        assert_eq!(t.add(1.36, &at(0.2)), PoseTaken::Late);
        assert_eq!(t.add(1.5, &at(0.3)), PoseTaken::Added);
        assert_eq!(t.add(1.51, &at(0.3)), PoseTaken::Added);
        let whole = PoseTrack::new(t.track().poses().to_vec(), 0.1).unwrap();
        assert!(whole.at(1.335).is_err() && whole.at(1.505).is_ok());
        // What is predicted after it knows nothing of what was before.
        assert_eq!(t.settle(1.525, [1.52, 1.53]), Tracking::Predicted);
        assert!((x(&t, 1.53) - 0.3).abs() < 1e-9);
    }
}
