//! How a camera goes on for a moment, by where it was seen last.
//!
//! Its speed is that between the newest pose and one a little older, but no more than before that: one pose that is wrong does
//! not throw the camera away, and a camera that turns back is not sent on. The speed dies away, v·e^(−t/τ): a hand's motion
//! does not last.

use glam::{DQuat, DVec3};

use crate::pose::Pose;

/// Speeds are measured over so long, seconds: half of a frame, so that a tracker's noise does not count for much.
const MEASURED_S: f64 = 0.02;
/// τ, seconds: a hand sways at 1 to 3 Hz, and turns back after a quarter of that.
const LASTS_S: f64 = 0.1;
/// What is off by less than this angle is in its place, rad: a pixel or two of a picture 640 px wide.
const IN_PLACE_RAD: f64 = 3e-3;
/// What is off by this much more is seen to be wrong, rad.
const WRONG_RAD: f64 = 15e-3;
/// Distance at which a camera's way counts as a turn, metres.
const NEAR_M: f64 = 2.0;

/// A frame this near a pose has that one, seconds.
const AT_ONCE_S: f64 = 2e-6;

/// So long before the newest pose others are of use, seconds: two speeds, at 30 Hz and one pose missing.
pub const LOOKS_BACK_S: f64 = 0.1;

/// Speed of a camera: metres a second in the world, radians a second about the world's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Speed {
    m: DVec3,
    rad: DVec3,
}

impl Speed {
    fn between((from_s, from): &(f64, Pose), (to_s, to): &(f64, Pose)) -> Self {
        let in_s = to_s - from_s;
        let turn = to.world_from_camera_rotation() * from.world_from_camera_rotation().conjugate();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        Self {
            m: (to.position_in_world_m() - from.position_in_world_m()) / in_s,
            rad: turn.normalize().to_scaled_axis() / in_s,
        }
    }

    /// How fast things near are seen to move: the square of rad/s, and the same of two speeds that may be opposed.
    fn with(self, other: Self) -> f64 {
        self.rad.dot(other.rad) + self.m.dot(other.m) / (NEAR_M * NEAR_M)
    }

    /// How much of this speed there was in an earlier one, 0 to 1. One share of turn and way, for those of a pose are wrong
    /// together.
    fn lasting(self, earlier: Self) -> f64 {
        let (now, before, along) = (self.with(self), earlier.with(earlier), self.with(earlier));
        match along {
            _ if now == 0.0 => 1.0,
            along if along <= 0.0 => 0.0,
            _ => (before / now).sqrt().min(1.0),
        }
    }
}

/// A camera that goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    last: (f64, Pose),
    speed: Speed,
    /// A single pose says nothing of where the camera goes.
    is_single: bool,
    /// By how much the speed has changed of late, rad/s².
    changes: f64,
    /// The middle of the span over which the speed was measured lies so long before the last pose, seconds.
    lag_s: f64,
}

impl Motion {
    /// By the poses that were seen, ascending in time. `None` without any.
    pub fn of(seen: &[(f64, Pose)]) -> Option<Self> {
        let last = *seen.last()?;
        let is_single = seen.len() == 1;
        let still = Self { last, speed: Speed::default(), is_single, changes: 0.0, lag_s: 0.0 };
        // A little less than half of a frame counts, too: times are rounded.
        let older = |than_s: f64| seen.iter().rev().find(|(s, _)| *s <= than_s - MEASURED_S + 1e-6);
        let Some(before) = older(last.0).or(seen.first().filter(|first| last.0 - first.0 > 1e-4)) else {
            return Some(still);
        };
        let (speed, lag_s) = (Speed::between(before, &last), 0.5 * (last.0 - before.0));
        let Some(first) = older(before.0) else { return Some(Self { speed, lag_s, ..still }) };
        let earlier = Speed::between(first, before);
        let share = speed.lasting(earlier);
        let change = Speed { m: speed.m - earlier.m, rad: speed.rad - earlier.rad };
        let changes = change.with(change).sqrt() / (0.5 * (last.0 - first.0));
        Some(Self { speed: Speed { m: share * speed.m, rad: share * speed.rad }, changes, lag_s, ..still })
    }

    /// Where the camera is at a time behind the last pose.
    pub fn at(&self, time_s: f64) -> Pose {
        let (last_s, last) = &self.last;
        let by_s = LASTS_S * (1.0 - (-(time_s - last_s).max(0.0) / LASTS_S).exp());
        let turn = DQuat::from_scaled_axis(self.speed.rad * by_s);
        Pose::from_camera_in_world(
            last.position_in_world_m() + self.speed.m * by_s,
            (turn * last.world_from_camera_rotation()).normalize(),
        )
    }

    /// How far that can be trusted, 0 to 1: by how far off it is, if the speed goes on changing as it did.
    pub fn trust(&self, time_s: f64) -> f64 {
        let after_s = (time_s - self.last.0).max(0.0);
        if self.is_single && after_s > AT_ONCE_S {
            return 0.0;
        }
        let off_rad = self.changes * after_s * (self.lag_s + 0.5 * after_s);
        (1.0 - (off_rad - IN_PLACE_RAD) / WRONG_RAD).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_S: f64 = 1.0 / 30.0;

    fn seen(angles: &[f64]) -> Vec<(f64, Pose)> {
        let pose = |angle: &f64| Pose::from_camera_in_world(DVec3::X * *angle, DQuat::from_rotation_y(*angle));
        angles.iter().enumerate().map(|(i, angle)| (FRAME_S * i as f64, pose(angle))).collect()
    }

    fn angle(pose: &Pose) -> f64 {
        let turn = pose.world_from_camera_rotation();
        2.0 * turn.y.atan2(turn.w)
    }

    #[test]
    fn an_even_motion_goes_on_and_dies_away() {
        let motion = Motion::of(&seen(&[0.0, 0.01, 0.02, 0.03])).unwrap();
        // 0.3 rad/s for a frame: 0.3 · 0.1 · (1 − e^(−1/3)).
        let after = motion.at(4.0 * FRAME_S);
        assert!((angle(&after) - 0.03 - 0.03 * (1.0 - (-1.0f64 / 3.0).exp())).abs() < 1e-9, "{}", angle(&after));
        assert!((after.position_in_world_m().x - angle(&after)).abs() < 1e-9);
        // It comes to rest after 0.1 s of that speed.
        assert!((angle(&motion.at(9.0)) - 0.06).abs() < 1e-9);
        assert_eq!((motion.trust(4.0 * FRAME_S), motion.trust(9.0)), (1.0, 1.0));
    }

    #[test]
    fn a_pose_that_is_wrong_throws_nothing_away_and_is_not_trusted() {
        for wrong in [[0.0, 0.0, 0.0, 0.05], [0.0, 0.0, 0.05, 0.0]] {
            let motion = Motion::of(&seen(&wrong)).unwrap();
            assert!((angle(&motion.at(1.0)) - wrong[3]).abs() < 1e-9, "{motion:?}");
            assert_eq!(motion.trust(4.0 * FRAME_S), 0.0);
        }
    }

    #[test]
    fn one_that_turns_back_is_not_sent_on() {
        let motion = Motion::of(&seen(&[0.0, 0.02, 0.01])).unwrap();
        assert!((angle(&motion.at(1.0)) - 0.01).abs() < 1e-9);
        assert_eq!(motion.trust(2.0 * FRAME_S), 1.0);
        assert!(motion.trust(3.0 * FRAME_S) < 0.5);
    }

    #[test]
    fn few_poses_are_enough() {
        assert_eq!(Motion::of(&[]), None);
        let one = seen(&[0.3]);
        let single = Motion::of(&one).unwrap();
        assert!((angle(&single.at(1.0)) - 0.3).abs() < 1e-12);
        assert_eq!((single.trust(0.0), single.trust(FRAME_S)), (1.0, 0.0));
        // A second at nearly the same time says no speed.
        assert_eq!(Motion::of(&[one[0], (1e-5, seen(&[0.4])[0].1)]).unwrap().speed, Speed::default());
    }
}
