//! The delay between a camera's pictures and poses that come beside them, found while both come: of the last seconds, how the
//! picture moves is compared with how the poses say that the camera turns ([`crate::tracking::delay`]).

use std::collections::VecDeque;

use crate::camera::Intrinsics;
use crate::pose::Pose;
use crate::tracking::PoseTrack;
use crate::tracking::delay::{Delay, Motion, NoDelay, REACH_S, estimate};
use crate::tracking::turn::Reduced;

/// The pictures that are compared are of so many seconds: a hand's sway comes back in less.
const WINDOW_S: f64 = 10.0;
/// The first try is after so much of it, seconds, and then every so often until the delay is found.
const FIRST_S: f64 = 3.0;
const AGAIN_S: f64 = 2.0;
/// A clock of 50 ppm drifts by half a millisecond in so long, seconds.
const FOUND_S: f64 = 10.0;
/// Pictures farther apart than this are not compared, seconds.
const MOST_APART_S: f64 = 0.25;
/// What is kept, whatever the times say: pictures at 120 Hz and poses at 2 kHz.
const MOST_MOTIONS: usize = 1200;
const MOST_POSES: usize = 24_000;
/// A delay that is known worse than this is not believed, seconds: a third of a frame of 30 Hz.
const SURE_S: f64 = 0.01;
/// A delay that changes by less than this stays, seconds.
const SAME_S: f64 = 0.002;

/// What was found, or why nothing was.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Unknown {
    #[error(transparent)]
    NoDelay(#[from] NoDelay),
    #[error("it is known within ± {:.0} ms only", 1e3 * sigma_s)]
    Unsure { sigma_s: f64 },
    #[error("the poses' camera is turned by {degrees}° about its optical axis against the pictures")]
    Turned { degrees: u32 },
}

/// Pictures and poses of the last seconds.
#[derive(Debug)]
pub struct DelaySearch {
    camera: Intrinsics,
    max_gap_s: f64,
    before: Option<(f64, Reduced)>,
    motions: VecDeque<Motion>,
    poses: VecDeque<(f64, Pose)>,
    next_s: f64,
    found: Option<Delay>,
}

impl DelaySearch {
    /// Poses are interpolated across at most `max_gap_s`.
    pub fn new(camera: Intrinsics, max_gap_s: f64) -> Self {
        let (motions, poses) = (VecDeque::new(), VecDeque::new());
        Self { camera, max_gap_s, before: None, motions, poses, next_s: f64::NAN, found: None }
    }

    /// A pose at a time of its own clock. One that goes back is left out.
    pub fn pose(&mut self, time_s: f64, pose: &Pose) {
        if time_s.is_finite() && self.poses.back().is_none_or(|(last_s, _)| time_s > *last_s) {
            self.poses.push_back((time_s, *pose));
        }
        let old = |(pose_s, _): &(f64, Pose)| time_s - pose_s > WINDOW_S + 2.0 * REACH_S;
        while self.poses.len() > MOST_POSES || self.poses.front().is_some_and(old) {
            self.poses.pop_front();
        }
    }

    /// A picture. Now and then this returns the delay, where it is new, or why it is not known.
    pub fn picture(&mut self, time_s: f64, picture: Reduced) -> Option<Result<Delay, Unknown>> {
        if let Some((from_s, before)) = self.before.take().filter(|(from_s, _)| time_s - from_s <= MOST_APART_S)
            && let Some(turn) = before.turn_to(&picture, &self.camera)
        {
            self.motion(Motion { from_s, to_s: time_s, turn });
        }
        self.before = Some((time_s, picture));
        self.look(time_s)
    }

    fn motion(&mut self, motion: Motion) {
        self.motions.push_back(motion);
        let old = |first: &Motion| motion.to_s - first.from_s > WINDOW_S;
        while self.motions.len() > MOST_MOTIONS || self.motions.front().is_some_and(old) {
            self.motions.pop_front();
        }
    }

    fn look(&mut self, time_s: f64) -> Option<Result<Delay, Unknown>> {
        if self.next_s.is_nan() {
            self.next_s = time_s + FIRST_S;
        }
        // A clock that was set back begins anew.
        if time_s < self.next_s - FOUND_S.max(FIRST_S) {
            (self.next_s, self.before) = (time_s + FIRST_S, None);
            self.motions.clear();
        }
        if time_s < self.next_s {
            return None;
        }
        let seen = self.estimate();
        self.next_s = time_s + if seen.is_ok() { FOUND_S } else { AGAIN_S };
        match (seen, self.found) {
            (Ok(new), Some(old)) if (new.delay_s - old.delay_s).abs() <= SAME_S.max(2.0 * new.sigma_s) => None,
            // What was found stays where the camera rests.
            (Err(_), Some(_)) => None,
            (Ok(new), _) => {
                self.found = Some(new);
                Some(Ok(new))
            }
            (Err(why), None) => Some(Err(why)),
        }
    }

    fn estimate(&self) -> Result<Delay, Unknown> {
        let motions: Vec<Motion> = self.motions.iter().copied().collect();
        let poses = self.poses.iter().copied().collect();
        // Only poses that ascend were kept.
        let track = PoseTrack::new(poses, self.max_gap_s).unwrap_or_default();
        match estimate(&motions, |from_s, to_s| track.motion_between(from_s, to_s), REACH_S)? {
            Delay { sigma_s, .. } if sigma_s > SURE_S => Err(Unknown::Unsure { sigma_s }),
            Delay { quarters, .. } if quarters != 0 => Err(Unknown::Turned { degrees: 90 * quarters }),
            found => Ok(found),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    const INTERVAL_S: f64 = 1.0 / 30.0;

    fn looking(t: f64) -> DQuat {
        let sway = |a: f64, b: f64, c: f64| 0.05 * (a * t).sin() + 0.02 * (b * t).cos() + 0.01 * (c * t).sin();
        DQuat::from_scaled_axis(DVec3::new(sway(2.1, 5.3, 11.7), sway(1.7, 4.1, 13.3), 0.5 * sway(3.3, 6.1, 9.7)))
    }

    /// Pictures and poses as they come for so many seconds: the poses' clock is ahead by `delay_s`.
    fn come(
        search: &mut DelaySearch,
        span_s: [f64; 2],
        delay_s: impl Fn(f64) -> f64,
        rests: bool,
    ) -> Vec<(f64, Result<Delay, Unknown>)> {
        let mut told = Vec::new();
        let still = |t: f64| if rests { looking(0.0) } else { looking(t) };
        let [first, last] = span_s.map(|s| (s / INTERVAL_S).round() as i32);
        for i in first..last {
            let time_s = INTERVAL_S * f64::from(i);
            for k in 0..3 {
                let t = time_s + INTERVAL_S / 3.0 * f64::from(k);
                search.pose(t + delay_s(t), &Pose::from_camera_in_world(DVec3::ZERO, still(t)));
            }
            let from_s = time_s - INTERVAL_S;
            let turn = (still(time_s).inverse() * still(from_s)).to_scaled_axis();
            search.motion(Motion { from_s, to_s: time_s, turn });
            told.extend(search.look(time_s).map(|found| (time_s, found)));
        }
        told
    }

    fn search() -> DelaySearch {
        DelaySearch::new(Intrinsics::default(), 0.1)
    }

    #[test]
    fn a_delay_is_told_once_and_again_when_it_has_changed() {
        let mut search = search();
        let told = come(&mut search, [0.0, 40.0], |t| if t < 15.0 { 0.083 } else { -0.04 }, false);
        let delays: Vec<f64> = told.iter().map(|(_, found)| found.unwrap().delay_s).collect();
        assert!((told[0].0 - 3.0).abs() < 0.04 && (delays[0] - 0.083).abs() < 2e-3, "{told:?}");
        let last = delays.last().unwrap();
        assert!(delays.len() > 1 && (last + 0.04).abs() < 2e-3, "{told:?}");
    }

    #[test]
    fn a_camera_that_rests_tells_nothing_and_takes_nothing_back() {
        let mut resting = search();
        let told = come(&mut resting, [0.0, 10.0], |_| 0.083, true);
        assert!(
            told.len() == 4
                && told.iter().all(|(_, found)| matches!(found, Err(Unknown::NoDelay(NoDelay::Still { .. })))),
            "{told:?}"
        );
        let mut moved = search();
        assert_eq!(come(&mut moved, [0.0, 5.0], |_| 0.083, false).len(), 1);
        assert_eq!(come(&mut moved, [5.0, 60.0], |_| 0.083, true), []);
    }

    #[test]
    fn memory_is_bounded_whatever_comes() {
        let mut search = search();
        for i in 0..100_000 {
            let time_s = 1e-5 * f64::from(i);
            search.pose(time_s, &Pose::IDENTITY);
            search.motion(Motion { from_s: time_s, to_s: time_s, turn: DVec3::ZERO });
        }
        assert_eq!((search.poses.len(), search.motions.len()), (MOST_POSES, MOST_MOTIONS));
        search.pose(f64::NAN, &Pose::IDENTITY);
        search.pose(0.0, &Pose::IDENTITY);
        assert_eq!(search.poses.len(), MOST_POSES);
        come(&mut search, [100.0, 130.0], |_| 0.0, true);
        assert!(search.poses.len() < 1100 && search.motions.len() <= 301);
    }

    #[test]
    fn a_delay_that_stays_is_told_once() {
        let told = come(&mut search(), [0.0, 60.0], |_| 0.083, false);
        assert_eq!(told.len(), 1, "{told:?}");
    }

    #[test]
    fn a_clock_that_was_set_back_begins_anew() {
        let mut search = search();
        assert_eq!(come(&mut search, [100.0, 104.0], |_| 0.0, true).len(), 1);
        let told = come(&mut search, [0.0, 4.0], |_| 0.0, true);
        assert!(told.len() == 1 && (told[0].0 - 3.0).abs() < 0.04, "{told:?}");
    }

    #[test]
    fn what_is_known_worse_than_a_third_of_a_frame_is_not_believed() {
        let mut is_unsure = false;
        for drift in 1..20 {
            let mut search = search();
            // The poses' clock goes wrong, so that no delay fits all of them.
            come(&mut search, [0.0, 2.9], |t| 0.004 * f64::from(drift) * t, false);
            match search.estimate() {
                Ok(found) => assert!(found.sigma_s <= SURE_S, "{found:?}"),
                Err(Unknown::Unsure { sigma_s }) => {
                    assert!(sigma_s > SURE_S);
                    is_unsure = true;
                }
                Err(Unknown::NoDelay(_) | Unknown::Turned { .. }) => {}
            }
        }
        assert!(is_unsure);
    }

    #[test]
    fn pictures_that_are_far_apart_and_poses_that_go_back_are_left_out() {
        let mut search = search();
        for time_s in [5.0, 3.0, 5.0, 6.0] {
            search.pose(time_s, &Pose::IDENTITY);
        }
        assert_eq!(search.poses.iter().map(|(time_s, _)| *time_s).collect::<Vec<f64>>(), [5.0, 6.0]);
        let codes = (0..3 * 320 * 240_u32).map(|n| (n / 3 % 320 / 9 * 37 + n / 960 / 11 * 53) as u8).collect();
        let pixels = crate::pixels::Pixels::from_u8(320, 240, codes).unwrap();
        for (time_s, motions) in [(1.0, 0), (1.03, 1), (2.0, 1), (2.2, 2)] {
            search.picture(time_s, Reduced::new(&pixels).unwrap());
            assert_eq!(search.motions.len(), motions, "{time_s}");
        }
    }
}
