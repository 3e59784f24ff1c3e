//! Short-term prediction of the camera's pose.
//!
//! The velocity is measured between the newest pose and a slightly older one. It is limited by the
//! velocity before that, so that one outlier causes no large prediction, and a camera that reverses
//! is not predicted onwards. It decays as v·e^(−t/τ), as the motion of a hand does not last.

use glam::{DQuat, DVec3};

use crate::pose::Pose;

/// Time over which a velocity is measured, seconds: half a frame, so that the tracker's noise
/// averages out.
const VELOCITY_SPAN_S: f64 = 0.02;
/// Time constant τ of the decay, seconds. A hand sways at 1 to 3 Hz and reverses after a quarter of
/// the period.
const DECAY_TIME_S: f64 = 0.1;
/// Prediction error up to which the confidence is 1, rad: a pixel or two of a picture 640 px wide.
const NEGLIGIBLE_ERROR_RAD: f64 = 3e-3;
/// Further error at which the confidence reaches 0, rad: visibly wrong.
const ERROR_RANGE_RAD: f64 = 15e-3;
/// Distance at which a translation is converted to an angle, metres.
const REFERENCE_DISTANCE_M: f64 = 2.0;

/// A frame this close to a pose has that pose, seconds.
const SIMULTANEOUS_S: f64 = 2e-6;

/// Poses up to this age are of use, seconds: two velocities at 30 Hz with one pose missing.
pub const HISTORY_S: f64 = 0.1;

/// Velocity of a camera in world coordinates, m/s and rad/s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Velocity {
    linear_m_s: DVec3,
    angular_rad_s: DVec3,
}

impl Velocity {
    fn between((from_s, from): &(f64, Pose), (to_s, to): &(f64, Pose)) -> Self {
        let in_s = to_s - from_s;
        let turn = to.world_from_camera_rotation() * from.world_from_camera_rotation().conjugate();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        Self {
            linear_m_s: (to.position_in_world_m() - from.position_in_world_m()) / in_s,
            angular_rad_s: turn.normalize().to_scaled_axis() / in_s,
        }
    }

    /// Inner product of two velocities, as apparent motion of objects at [`REFERENCE_DISTANCE_M`],
    /// (rad/s)².
    fn dot_apparent(self, other: Self) -> f64 {
        self.angular_rad_s.dot(other.angular_rad_s)
            + self.linear_m_s.dot(other.linear_m_s) / (REFERENCE_DISTANCE_M * REFERENCE_DISTANCE_M)
    }

    /// Share of this velocity that an earlier one already had, 0 to 1. Rotation and translation
    /// have the same share, because the errors of a pose affect both.
    fn persistence(self, earlier: Self) -> f64 {
        let (now, before, along) = (self.dot_apparent(self), earlier.dot_apparent(earlier), self.dot_apparent(earlier));
        match along {
            _ if now == 0.0 => 1.0,
            along if along <= 0.0 => 0.0,
            _ => (before / now).sqrt().min(1.0),
        }
    }
}

/// Prediction from the latest poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionPredictor {
    last: (f64, Pose),
    velocity: Velocity,
    /// A single pose gives no velocity.
    is_single: bool,
    /// Acceleration, rad/s².
    acceleration_rad_s2: f64,
    /// Time from the middle of the velocity's span to the last pose, seconds.
    lag_s: f64,
}

impl MotionPredictor {
    /// Builds a prediction from poses of ascending times. `None` without any.
    pub fn of(history: &[(f64, Pose)]) -> Option<Self> {
        let last = *history.last()?;
        let is_single = history.len() == 1;
        let at_rest = Self { last, velocity: Velocity::default(), is_single, acceleration_rad_s2: 0.0, lag_s: 0.0 };
        // Tolerates rounded time stamps.
        let older = |than_s: f64| history.iter().rev().find(|(s, _)| *s <= than_s - VELOCITY_SPAN_S + 1e-6);
        let Some(before) = older(last.0).or(history.first().filter(|first| last.0 - first.0 > 1e-4)) else {
            return Some(at_rest);
        };
        let (velocity, lag_s) = (Velocity::between(before, &last), 0.5 * (last.0 - before.0));
        let Some(first) = older(before.0) else { return Some(Self { velocity, lag_s, ..at_rest }) };
        let earlier = Velocity::between(first, before);
        let persistence = velocity.persistence(earlier);
        let change = Velocity {
            linear_m_s: velocity.linear_m_s - earlier.linear_m_s,
            angular_rad_s: velocity.angular_rad_s - earlier.angular_rad_s,
        };
        let acceleration_rad_s2 = change.dot_apparent(change).sqrt() / (0.5 * (last.0 - first.0));
        Some(Self {
            velocity: Velocity {
                linear_m_s: persistence * velocity.linear_m_s,
                angular_rad_s: persistence * velocity.angular_rad_s,
            },
            acceleration_rad_s2,
            lag_s,
            ..at_rest
        })
    }

    /// Predicted pose at a time after the last pose.
    pub fn at(&self, time_s: f64) -> Pose {
        let (last_s, last) = &self.last;
        let effective_s = DECAY_TIME_S * (1.0 - (-(time_s - last_s).max(0.0) / DECAY_TIME_S).exp());
        let turn = DQuat::from_scaled_axis(self.velocity.angular_rad_s * effective_s);
        Pose::from_camera_in_world(
            last.position_in_world_m() + self.velocity.linear_m_s * effective_s,
            (turn * last.world_from_camera_rotation()).normalize(),
        )
    }

    /// Confidence of the prediction, 0 to 1, from its error if the acceleration continues.
    pub fn confidence(&self, time_s: f64) -> f64 {
        let after_s = (time_s - self.last.0).max(0.0);
        if self.is_single && after_s > SIMULTANEOUS_S {
            return 0.0;
        }
        let error_rad = self.acceleration_rad_s2 * after_s * (self.lag_s + 0.5 * after_s);
        (1.0 - (error_rad - NEGLIGIBLE_ERROR_RAD) / ERROR_RANGE_RAD).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_S: f64 = 1.0 / 30.0;

    fn history(angles: &[f64]) -> Vec<(f64, Pose)> {
        let pose = |angle: &f64| Pose::from_camera_in_world(DVec3::X * *angle, DQuat::from_rotation_y(*angle));
        angles.iter().enumerate().map(|(i, angle)| (FRAME_S * i as f64, pose(angle))).collect()
    }

    fn angle(pose: &Pose) -> f64 {
        let turn = pose.world_from_camera_rotation();
        2.0 * turn.y.atan2(turn.w)
    }

    #[test]
    fn uniform_motion_is_predicted_with_decay() {
        let predictor = MotionPredictor::of(&history(&[0.0, 0.01, 0.02, 0.03])).unwrap();
        // 0.3 rad/s for a frame: 0.3 · 0.1 · (1 − e^(−1/3)).
        let after = predictor.at(4.0 * FRAME_S);
        assert!((angle(&after) - 0.03 - 0.03 * (1.0 - (-1.0f64 / 3.0).exp())).abs() < 1e-9, "{}", angle(&after));
        assert!((after.position_in_world_m().x - angle(&after)).abs() < 1e-9);
        // The motion ends after 0.1 s at the initial velocity.
        assert!((angle(&predictor.at(9.0)) - 0.06).abs() < 1e-9);
        assert_eq!((predictor.confidence(4.0 * FRAME_S), predictor.confidence(9.0)), (1.0, 1.0));
    }

    #[test]
    fn outlier_is_not_extrapolated_and_has_no_confidence() {
        for wrong in [[0.0, 0.0, 0.0, 0.05], [0.0, 0.0, 0.05, 0.0]] {
            let predictor = MotionPredictor::of(&history(&wrong)).unwrap();
            assert!((angle(&predictor.at(1.0)) - wrong[3]).abs() < 1e-9, "{predictor:?}");
            assert_eq!(predictor.confidence(4.0 * FRAME_S), 0.0);
        }
    }

    #[test]
    fn reversing_camera_is_not_extrapolated() {
        let predictor = MotionPredictor::of(&history(&[0.0, 0.02, 0.01])).unwrap();
        assert!((angle(&predictor.at(1.0)) - 0.01).abs() < 1e-9);
        assert_eq!(predictor.confidence(2.0 * FRAME_S), 1.0);
        assert!(predictor.confidence(3.0 * FRAME_S) < 0.5);
    }

    #[test]
    fn prediction_from_few_poses_is_at_rest() {
        assert_eq!(MotionPredictor::of(&[]), None);
        let one = history(&[0.3]);
        let single = MotionPredictor::of(&one).unwrap();
        assert!((angle(&single.at(1.0)) - 0.3).abs() < 1e-12);
        assert_eq!((single.confidence(0.0), single.confidence(FRAME_S)), (1.0, 0.0));
        // A second pose at nearly the same time gives no velocity.
        assert_eq!(MotionPredictor::of(&[one[0], (1e-5, history(&[0.4])[0].1)]).unwrap().velocity, Velocity::default());
    }
}
