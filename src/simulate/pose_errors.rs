//! Poses as recorded by a tracker: of a body to which the camera is attached, with jitter and
//! drift, by the tracker's clock.

use glam::{DQuat, DVec3};

use super::flaws::Flaws;
use super::path::{INTERVAL_S, START_S};
use super::random::Random;
use super::random_walk::SmoothWalk;
use crate::pose::Pose;
use crate::tracking::{NotAscending, PoseTrack};

/// Knot interval of the drift, s.
const DRIFT_KNOT_S: f64 = 1.5;

/// Keys of the random numbers, in addition to the seed.
const JITTER_TRANSLATION_KEY: u64 = 16;
const JITTER_ROTATION_KEY: u64 = 17;
/// The drift uses this key and the five after it.
const DRIFT_KEY: u64 = 18;
const HAND_EYE_KEY: u64 = 24;

impl Flaws {
    /// Hand-eye transform: the camera's position on the tracked body, m, and its rotation vector
    /// there, radians. T(camera) = T(tracked)·this. Directions follow from the seed.
    pub fn hand_eye(&self) -> (DVec3, DVec3) {
        let direction = |n| normals([self.seed, HAND_EYE_KEY, n]).normalize_or(DVec3::X);
        (1e-3 * self.hand_eye_mm * direction(0), self.hand_eye_deg.to_radians() * direction(1))
    }

    /// The recorded poses for a camera's true trajectory. At a pose's own time t
    ///
    /// T(tracked, t + later) = T(camera, t) · hand_eye⁻¹ · drift(t) · jitter(t)
    ///
    /// Drift and jitter are a translation and a rotation in the body's axes. Without flaws the
    /// trajectory is unchanged bit for bit.
    pub fn recorded(&self, truth: &PoseTrack) -> Result<PoseTrack, NotAscending> {
        let is_off = [
            self.jitter_mm,
            self.jitter_deg,
            self.drift_mm,
            self.drift_deg,
            self.hand_eye_mm,
            self.hand_eye_deg,
            self.poses_later_s.abs(),
        ];
        if is_off.iter().all(|off| *off == 0.0) {
            return Ok(truth.clone());
        }
        let (at_m, turn) = self.hand_eye();
        let turn = DQuat::from_scaled_axis(turn);
        let tracked_on_camera = Pose::from_camera_in_world(-(turn.inverse() * at_m), turn.inverse());
        let recorded = |(time_s, pose): &(f64, Pose)| {
            let tracked = on(pose, &tracked_on_camera);
            (time_s + self.poses_later_s, on(&tracked, &self.error_at(*time_s)))
        };
        PoseTrack::new(truth.poses().iter().map(recorded).collect(), truth.max_gap_s())
    }

    /// Drift and jitter combined.
    fn error_at(&self, time_s: f64) -> Pose {
        // Each axis has a share, so that the total is the requested size.
        let share = 3f64.sqrt().recip();
        let walk = |n: u64| SmoothWalk::new([self.seed, DRIFT_KEY + n], DRIFT_KNOT_S).at(time_s - START_S);
        let drift = |n| share * DVec3::new(walk(n), walk(n + 1), walk(n + 2));
        let number = ((time_s - START_S) / INTERVAL_S).round() as i64;
        let jitter = |what| share * normals([self.seed, what, number as u64]);
        let way_m = 1e-3 * (self.drift_mm * drift(0) + self.jitter_mm * jitter(JITTER_TRANSLATION_KEY));
        let turn = self.drift_deg.to_radians() * drift(3) + self.jitter_deg.to_radians() * jitter(JITTER_ROTATION_KEY);
        Pose::from_camera_in_world(way_m, DQuat::from_scaled_axis(turn))
    }
}

/// Composition: a body at `inner` in the axes of one at `outer`.
fn on(outer: &Pose, inner: &Pose) -> Pose {
    Pose::from_camera_in_world(
        outer.inverse_transform_point(inner.position_in_world_m()),
        outer.world_from_camera_rotation() * inner.world_from_camera_rotation(),
    )
}

/// Three independent standard normal numbers.
fn normals(keys: [u64; 3]) -> DVec3 {
    let mut random = Random::new([keys[0], keys[1], keys[2], 0]);
    let ([x, y], [z, _]) = (random.normals(), random.normals());
    DVec3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera that moves right and turns about its own vertical.
    fn test_track() -> PoseTrack {
        let pose = |n: i32| {
            let time_s = START_S + INTERVAL_S * f64::from(n);
            let turn = DQuat::from_rotation_y(0.3 * time_s);
            (time_s, Pose::from_camera_in_world(DVec3::new(time_s, 2.0, 3.0), turn))
        };
        PoseTrack::new((0..2000).map(pose).collect(), 0.01).unwrap()
    }

    /// Errors of the recorded poses in the camera's axes: m and radians.
    fn off(flaws: &Flaws) -> Vec<(DVec3, DVec3)> {
        let truth = test_track();
        let recorded = flaws.recorded(&truth).unwrap();
        let pose_error = |(is, was): (&(f64, Pose), &(f64, Pose))| {
            let turn = was.1.rotation * is.1.world_from_camera_rotation();
            (was.1.transform_point(is.1.position_in_world_m()), turn.to_scaled_axis())
        };
        recorded.poses().iter().zip(truth.poses()).map(pose_error).collect()
    }

    fn rms(values: impl Iterator<Item = DVec3>) -> f64 {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v.length_squared(), count + 1.0));
        (sum / count).sqrt()
    }

    #[test]
    fn poses_without_flaws_are_unchanged() {
        let flaws = Flaws { seed: 5, depth_later_s: 0.02, repeat_share: 0.5, ..Flaws::default() };
        assert_eq!(flaws.recorded(&test_track()).unwrap(), test_track());
    }

    #[test]
    fn jitter_has_the_requested_size_and_is_independent_per_pose() {
        let off = off(&Flaws { jitter_mm: 2.0, jitter_deg: 0.1, ..Flaws::default() });
        // 6000 numbers: standard error 0.9 %.
        assert!((rms(off.iter().map(|o| o.0)) / 2e-3 - 1.0).abs() < 0.05);
        assert!((rms(off.iter().map(|o| o.1)) / 0.1f64.to_radians() - 1.0).abs() < 0.05);
        let next = off.windows(2).map(|pair| pair[0].0.dot(pair[1].0)).sum::<f64>() / off.len() as f64;
        assert!(next.abs() < 0.1 * 4e-6, "{next}");
        let both = off.iter().map(|(shift, turn)| shift.dot(*turn)).sum::<f64>() / off.len() as f64;
        assert!(both.abs() < 0.1 * 2e-3 * 0.1f64.to_radians(), "{both}");
    }

    #[test]
    fn drift_is_slow_and_bounded() {
        let off = off(&Flaws { drift_mm: 20.0, drift_deg: 1.0, ..Flaws::default() });
        let largest = |of: fn(&(DVec3, DVec3)) -> DVec3| off.iter().map(|o| of(o).length()).fold(0.0, f64::max);
        assert!(largest(|o| o.0) > 0.006 && largest(|o| o.0) <= 0.02, "{}", largest(|o| o.0));
        assert!(largest(|o| o.1) > 0.3f64.to_radians() && largest(|o| o.1) <= 1f64.to_radians());
        // Slope of a spline: at most 2 · 20 mm in 1.5 s, 0.14 mm in 5 ms.
        assert!(off.windows(2).all(|pair| (pair[1].0 - pair[0].0).length() < 0.14e-3));
    }

    #[test]
    fn recorded_poses_are_offset_by_the_hand_eye_transform() {
        let flaws = Flaws { hand_eye_mm: 30.0, hand_eye_deg: 2.0, poses_later_s: 0.02, ..Flaws::default() };
        let (at_m, turn) = flaws.hand_eye();
        assert!((at_m.length() - 0.03).abs() < 1e-12 && (turn.length() - 2f64.to_radians()).abs() < 1e-12);
        let (truth, recorded) = (test_track(), flaws.recorded(&test_track()).unwrap());
        for (is, was) in recorded.poses().iter().zip(truth.poses()) {
            assert!((is.0 - was.0 - 0.02).abs() < 1e-12);
            let camera = on(&is.1, &Pose::from_camera_in_world(at_m, DQuat::from_scaled_axis(turn)));
            assert!((camera.position_in_world_m() - was.1.position_in_world_m()).length() < 1e-12);
            assert!(camera.rotation.dot(was.1.rotation).abs() > 1.0 - 1e-12);
        }
    }
}
