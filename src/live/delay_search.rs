//! Online estimate of the delay between a camera's pictures and external poses. The rotation
//! between pictures is compared with the rotation of the poses over a sliding window
//! ([`crate::tracking::delay`]).

use std::collections::VecDeque;

use crate::camera::Intrinsics;
use crate::pose::Pose;
use crate::tracking::PoseTrack;
use crate::tracking::delay::{Delay, DelayFailure, FrameRotation, MAX_SEARCHED_DELAY_S, estimate};
use crate::tracking::turn::ImagePyramid;

/// Length of the sliding window, seconds. The sway of a hand repeats in less.
const WINDOW_S: f64 = 10.0;
/// Time until the first estimate, and from a failed estimate to the next, seconds.
const FIRST_ESTIMATE_S: f64 = 3.0;
const RETRY_S: f64 = 2.0;
/// Time from a successful estimate to the next, seconds. A clock of 50 ppm drifts by half a
/// millisecond in it.
const UPDATE_INTERVAL_S: f64 = 10.0;
/// Largest interval between two pictures that are compared, seconds.
const MAX_PICTURE_INTERVAL_S: f64 = 0.25;
/// Capacities of the window, whatever the time stamps are: pictures at 120 Hz and poses at 2 kHz.
const MAX_MOTIONS: usize = 1200;
const MAX_POSES: usize = 24_000;
/// Largest accepted standard deviation of a delay, seconds: a third of a frame at 30 Hz.
const MAX_SIGMA_S: f64 = 0.01;
/// Smaller changes of the delay are ignored, seconds.
const MIN_CHANGE_S: f64 = 0.002;

/// Reason why the delay is not determined.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DelayError {
    #[error(transparent)]
    NoDelay(#[from] DelayFailure),
    #[error("it is known only within ± {:.0} ms", 1e3 * sigma_s)]
    Uncertain { sigma_s: f64 },
    #[error("the poses' camera is rotated by {degrees}° about its optical axis relative to the pictures")]
    Rotated { degrees: u32 },
}

/// Sliding window over pictures and poses.
#[derive(Debug)]
pub struct DelaySearch {
    camera: Intrinsics,
    max_gap_s: f64,
    previous: Option<(f64, ImagePyramid)>,
    motions: VecDeque<FrameRotation>,
    poses: VecDeque<(f64, Pose)>,
    next_s: f64,
    last_delay: Option<Delay>,
}

impl DelaySearch {
    /// Poses are interpolated across gaps of at most `max_gap_s`.
    pub fn new(camera: Intrinsics, max_gap_s: f64) -> Self {
        let (motions, poses) = (VecDeque::new(), VecDeque::new());
        Self { camera, max_gap_s, previous: None, motions, poses, next_s: f64::NAN, last_delay: None }
    }

    /// Adds a pose at a time of the poses' clock. A pose that is not later than the one before is
    /// ignored.
    pub fn add_pose(&mut self, time_s: f64, pose: &Pose) {
        if time_s.is_finite() && self.poses.back().is_none_or(|(last_s, _)| time_s > *last_s) {
            self.poses.push_back((time_s, *pose));
        }
        let old = |(pose_s, _): &(f64, Pose)| time_s - pose_s > WINDOW_S + 2.0 * MAX_SEARCHED_DELAY_S;
        while self.poses.len() > MAX_POSES || self.poses.front().is_some_and(old) {
            self.poses.pop_front();
        }
    }

    /// Adds a picture. Returns a delay that differs from the last one, or the reason for a failed
    /// estimate; `None` between estimates.
    pub fn add_picture(&mut self, time_s: f64, picture: ImagePyramid) -> Option<Result<Delay, DelayError>> {
        if let Some((from_s, previous)) =
            self.previous.take().filter(|(from_s, _)| time_s - from_s <= MAX_PICTURE_INTERVAL_S)
            && let Some(turn) = previous.rotation_to(&picture, &self.camera)
        {
            self.add_motion(FrameRotation { from_s, to_s: time_s, turn });
        }
        self.previous = Some((time_s, picture));
        self.update(time_s)
    }

    fn add_motion(&mut self, motion: FrameRotation) {
        self.motions.push_back(motion);
        let old = |first: &FrameRotation| motion.to_s - first.from_s > WINDOW_S;
        while self.motions.len() > MAX_MOTIONS || self.motions.front().is_some_and(old) {
            self.motions.pop_front();
        }
    }

    fn update(&mut self, time_s: f64) -> Option<Result<Delay, DelayError>> {
        if self.next_s.is_nan() {
            self.next_s = time_s + FIRST_ESTIMATE_S;
        }
        // The clock was set back: start over.
        if time_s < self.next_s - UPDATE_INTERVAL_S.max(FIRST_ESTIMATE_S) {
            (self.next_s, self.previous) = (time_s + FIRST_ESTIMATE_S, None);
            self.motions.clear();
        }
        if time_s < self.next_s {
            return None;
        }
        let result = self.estimate();
        self.next_s = time_s + if result.is_ok() { UPDATE_INTERVAL_S } else { RETRY_S };
        match (result, self.last_delay) {
            (Ok(new), Some(old)) if (new.delay_s - old.delay_s).abs() <= MIN_CHANGE_S.max(2.0 * new.sigma_s) => None,
            // The last delay stays valid while the camera is at rest.
            (Err(_), Some(_)) => None,
            (Ok(new), _) => {
                self.last_delay = Some(new);
                Some(Ok(new))
            }
            (Err(why), None) => Some(Err(why)),
        }
    }

    fn estimate(&self) -> Result<Delay, DelayError> {
        let motions: Vec<FrameRotation> = self.motions.iter().copied().collect();
        let poses = self.poses.iter().copied().collect();
        // The poses' times are ascending, so this does not fail.
        let track = PoseTrack::new(poses, self.max_gap_s).unwrap_or_default();
        match estimate(&motions, |from_s, to_s| track.motion_between(from_s, to_s), MAX_SEARCHED_DELAY_S)? {
            Delay { sigma_s, .. } if sigma_s > MAX_SIGMA_S => Err(DelayError::Uncertain { sigma_s }),
            Delay { quarters, .. } if quarters != 0 => Err(DelayError::Rotated { degrees: 90 * quarters }),
            delay => Ok(delay),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    const INTERVAL_S: f64 = 1.0 / 30.0;

    fn orientation(t: f64) -> DQuat {
        let sway = |a: f64, b: f64, c: f64| 0.05 * (a * t).sin() + 0.02 * (b * t).cos() + 0.01 * (c * t).sin();
        DQuat::from_scaled_axis(DVec3::new(sway(2.1, 5.3, 11.7), sway(1.7, 4.1, 13.3), 0.5 * sway(3.3, 6.1, 9.7)))
    }

    /// Feeds pictures and poses over a span of seconds. The poses' clock is ahead by `delay_s`.
    /// Returns the results with their times.
    fn feed(
        search: &mut DelaySearch,
        span_s: [f64; 2],
        delay_s: impl Fn(f64) -> f64,
        is_at_rest: bool,
    ) -> Vec<(f64, Result<Delay, DelayError>)> {
        let mut results = Vec::new();
        let orientation_at = |t: f64| if is_at_rest { orientation(0.0) } else { orientation(t) };
        let [first, last] = span_s.map(|s| (s / INTERVAL_S).round() as i32);
        for i in first..last {
            let time_s = INTERVAL_S * f64::from(i);
            for k in 0..3 {
                let t = time_s + INTERVAL_S / 3.0 * f64::from(k);
                search.add_pose(t + delay_s(t), &Pose::from_camera_in_world(DVec3::ZERO, orientation_at(t)));
            }
            let from_s = time_s - INTERVAL_S;
            let turn = (orientation_at(time_s).inverse() * orientation_at(from_s)).to_scaled_axis();
            search.add_motion(FrameRotation { from_s, to_s: time_s, turn });
            results.extend(search.update(time_s).map(|result| (time_s, result)));
        }
        results
    }

    fn search() -> DelaySearch {
        DelaySearch::new(Intrinsics::default(), 0.1)
    }

    #[test]
    fn changed_delay_is_reported_again() {
        let mut search = search();
        let results = feed(&mut search, [0.0, 40.0], |t| if t < 15.0 { 0.083 } else { -0.04 }, false);
        let delays: Vec<f64> = results.iter().map(|(_, result)| result.unwrap().delay_s).collect();
        assert!((results[0].0 - 3.0).abs() < 0.04 && (delays[0] - 0.083).abs() < 2e-3, "{results:?}");
        let last = delays.last().unwrap();
        assert!(delays.len() > 1 && (last + 0.04).abs() < 2e-3, "{results:?}");
    }

    #[test]
    fn resting_camera_gives_no_delay_and_revokes_none() {
        let mut resting = search();
        let results = feed(&mut resting, [0.0, 10.0], |_| 0.083, true);
        assert!(
            results.len() == 4
                && results
                    .iter()
                    .all(|(_, result)| matches!(result, Err(DelayError::NoDelay(DelayFailure::Still { .. })))),
            "{results:?}"
        );
        let mut moved = search();
        assert_eq!(feed(&mut moved, [0.0, 5.0], |_| 0.083, false).len(), 1);
        assert_eq!(feed(&mut moved, [5.0, 60.0], |_| 0.083, true), []);
    }

    #[test]
    fn window_of_many_samples_stays_within_its_capacity() {
        let mut search = search();
        for i in 0..100_000 {
            let time_s = 1e-5 * f64::from(i);
            search.add_pose(time_s, &Pose::IDENTITY);
            search.add_motion(FrameRotation { from_s: time_s, to_s: time_s, turn: DVec3::ZERO });
        }
        assert_eq!((search.poses.len(), search.motions.len()), (MAX_POSES, MAX_MOTIONS));
        search.add_pose(f64::NAN, &Pose::IDENTITY);
        search.add_pose(0.0, &Pose::IDENTITY);
        assert_eq!(search.poses.len(), MAX_POSES);
        feed(&mut search, [100.0, 130.0], |_| 0.0, true);
        assert!(search.poses.len() < 1100 && search.motions.len() <= 301);
    }

    #[test]
    fn constant_delay_is_reported_once() {
        let results = feed(&mut search(), [0.0, 60.0], |_| 0.083, false);
        assert_eq!(results.len(), 1, "{results:?}");
    }

    #[test]
    fn clock_set_back_restarts_the_search() {
        let mut search = search();
        assert_eq!(feed(&mut search, [100.0, 104.0], |_| 0.0, true).len(), 1);
        let results = feed(&mut search, [0.0, 4.0], |_| 0.0, true);
        assert!(results.len() == 1 && (results[0].0 - 3.0).abs() < 0.04, "{results:?}");
    }

    #[test]
    fn delay_less_certain_than_a_third_of_a_frame_is_rejected() {
        let mut is_uncertain = false;
        for drift in 1..20 {
            let mut search = search();
            // The poses' clock has a wrong rate, so that no delay fits all poses.
            feed(&mut search, [0.0, 2.9], |t| 0.004 * f64::from(drift) * t, false);
            match search.estimate() {
                Ok(result) => assert!(result.sigma_s <= MAX_SIGMA_S, "{result:?}"),
                Err(DelayError::Uncertain { sigma_s }) => {
                    assert!(sigma_s > MAX_SIGMA_S);
                    is_uncertain = true;
                }
                Err(DelayError::NoDelay(_) | DelayError::Rotated { .. }) => {}
            }
        }
        assert!(is_uncertain);
    }

    #[test]
    fn distant_pictures_and_poses_out_of_order_are_ignored() {
        let mut search = search();
        for time_s in [5.0, 3.0, 5.0, 6.0] {
            search.add_pose(time_s, &Pose::IDENTITY);
        }
        assert_eq!(search.poses.iter().map(|(time_s, _)| *time_s).collect::<Vec<f64>>(), [5.0, 6.0]);
        let codes = (0..3 * 320 * 240_u32).map(|n| (n / 3 % 320 / 9 * 37 + n / 960 / 11 * 53) as u8).collect();
        let pixels = crate::pixels::Pixels::from_u8(320, 240, codes).unwrap();
        for (time_s, motions) in [(1.0, 0), (1.03, 1), (2.0, 1), (2.2, 2)] {
            search.add_picture(time_s, ImagePyramid::new(&pixels).unwrap());
            assert_eq!(search.motions.len(), motions, "{time_s}");
        }
    }
}
