//! Smoothing of poses with propagated covariances. Both filters act on the parameters of the
//! covariance: a rotation about the camera's axes, and the world's origin in them. So a board that
//! is the world's origin stays at its observed position.
//!
//! Online ([`Smoother`]): exponential smoothing (Brown 1956), y += α (x − y), with α = 1 −
//! e^(−Δt/τ), so that the time constant τ is independent of the interval Δt. The variance of
//! independent noise is multiplied by α/(2 − α). Uniform motion at v lags by v Δt (1 − α)/α = v
//! Δt/(e^(Δt/τ) − 1): nearly v (τ − Δt/2).
//!
//! Offline ([`smooth_poses`]): local linear regression (Cleveland 1979) with the weights
//! e^(−|Δt|/τ), evaluated at the pose's own time. Uniform motion is unchanged, up to the first and
//! the last pose. Far from these the line's slope does not matter; with a = e^(−Δt/τ) the weights
//! are (1 − a)/(1 + a) a^|n|, as of exponential smoothing forwards and backwards, and the variance
//! is multiplied by ((1 − a)/(1 + a))² (1 + a²)/(1 − a²).
//!
//! Neither crosses a gap in which poses are not interpolated.

use glam::{DQuat, DVec3};

use super::covariance::Covariance;
use crate::pose::Pose;

/// Time constants beyond which weights are negligible: e⁻¹⁰.
const SUPPORT_TIME_CONSTANTS: f64 = 10.0;
/// Largest accepted time constant, seconds.
pub const MAX_TIME_CONSTANT_S: f64 = 2.0;

/// Rotation about the camera's axes from one pose to another, rad, and the step of the world's
/// origin in them, m.
fn step(from: &Pose, to: &Pose) -> (DVec3, DVec3) {
    let turn = to.rotation * from.rotation.conjugate();
    // The shorter rotation.
    let turn = if turn.w < 0.0 { -turn } else { turn };
    (turn.to_scaled_axis(), to.translation_m - from.translation_m)
}

fn stepped(from: &Pose, (turn, moved_m): (DVec3, DVec3)) -> Pose {
    Pose::new(DQuat::from_scaled_axis(turn) * from.rotation, from.translation_m + moved_m)
}

/// Online smoothing filter.
#[derive(Clone, Debug)]
pub struct Smoother {
    tau_s: f64,
    max_gap_s: f64,
    last: Option<(Pose, Covariance)>,
}

impl Smoother {
    /// The time constant is above 0, seconds. The filter restarts after a longer gap.
    pub fn new(tau_s: f64, max_gap_s: f64) -> Self {
        Self { tau_s, max_gap_s, last: None }
    }

    /// Adds the next pose, at its covariance's time.
    pub fn next(&mut self, pose: &Pose, covariance: &Covariance) -> (Pose, Covariance) {
        let smoothed = match &self.last {
            Some((last, before)) if (0.0..=self.max_gap_s).contains(&(covariance.time_s - before.time_s)) => {
                let share = 1.0 - (-(covariance.time_s - before.time_s) / self.tau_s).exp();
                let (turn, moved_m) = step(last, pose);
                let upper = std::array::from_fn(|i| {
                    (1.0 - share).powi(2) * before.upper[i] + share.powi(2) * covariance.upper[i]
                });
                (stepped(last, (share * turn, share * moved_m)), Covariance { time_s: covariance.time_s, upper })
            }
            _ => (*pose, *covariance),
        };
        self.last = Some(smoothed);
        smoothed
    }
}

/// Smooths a whole trajectory, ascending in time, with a time constant above 0, seconds.
pub fn smooth_poses(poses: &[(Pose, Covariance)], tau_s: f64, max_gap_s: f64) -> Vec<(Pose, Covariance)> {
    let time_s = |at: usize| poses[at].1.time_s;
    (0..poses.len())
        .map(|at| {
            let joins = |a: usize, b: usize| time_s(b) - time_s(a) <= max_gap_s;
            let is_near = |other: usize| (time_s(other) - time_s(at)).abs() <= SUPPORT_TIME_CONSTANTS * tau_s;
            let first = (1..=at).rev().take_while(|i| joins(i - 1, *i) && is_near(i - 1)).last().map_or(at, |i| i - 1);
            let last = (at + 1..poses.len()).take_while(|i| joins(i - 1, *i) && is_near(*i)).last().unwrap_or(at);
            let after_s: Vec<f64> = (first..=last).map(|i| time_s(i) - time_s(at)).collect();
            let weights = weights_at(&after_s, tau_s);
            let own = &poses[at].0;
            let (mut by, mut upper) = ((DVec3::ZERO, DVec3::ZERO), [0.0; 21]);
            for ((pose, covariance), share) in poses[first..=last].iter().zip(&weights) {
                let (turn, moved_m) = step(own, pose);
                by = (by.0 + *share * turn, by.1 + *share * moved_m);
                upper.iter_mut().zip(covariance.upper).for_each(|(sum, of)| *sum += share.powi(2) * of);
            }
            (stepped(own, by), Covariance { time_s: time_s(at), upper })
        })
        .collect()
}

/// Weights of neighbouring poses, by their times: the least-squares line evaluated at 0.
fn weights_at(after_s: &[f64], tau_s: f64) -> Vec<f64> {
    let weights: Vec<f64> = after_s.iter().map(|t| (-t.abs() / tau_s).exp()).collect();
    let sum = |power: i32| after_s.iter().zip(&weights).map(|(t, w)| w * (t / tau_s).powi(power)).sum::<f64>();
    let (s0, s1, s2) = (sum(0), sum(1), sum(2));
    let det = s0 * s2 - s1 * s1;
    // A single pose is a line through itself.
    if det <= 1e-12 * s0 * s0 {
        return weights.iter().map(|w| w / s0).collect();
    }
    after_s.iter().zip(&weights).map(|(t, w)| w * (s2 - s1 * t / tau_s) / det).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL_S: f64 = 1.0 / 30.0;
    const TAU_S: f64 = 0.05;

    fn covariance(time_s: f64) -> Covariance {
        Covariance { time_s, upper: std::array::from_fn(|i| 1.0 + i as f64) }
    }

    /// Approximately normal numbers: sums of twelve uniform ones.
    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            let mut even = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            (0..12).map(|_| even()).sum::<f64>() - 6.0
        }
    }

    /// A camera at rest, with errors of a millimetre and a milliradian along each axis.
    fn resting(count: usize) -> (Pose, Vec<(Pose, Covariance)>) {
        let truth = Pose::new(DQuat::from_rotation_x(2.6), DVec3::new(0.1, -0.2, 0.8));
        let mut off = noise(5);
        let mut three = || 1e-3 * DVec3::new(off(), off(), off());
        let poses =
            (0..count).map(|i| (stepped(&truth, (three(), three())), covariance(INTERVAL_S * i as f64))).collect();
        (truth, poses)
    }

    /// Variances of rotations and positions about the truth.
    fn variances(truth: &Pose, poses: &[(Pose, Covariance)]) -> [f64; 2] {
        let steps: Vec<_> = poses.iter().map(|(pose, _)| step(truth, pose)).collect();
        let mean = |of: fn(&(DVec3, DVec3)) -> DVec3| {
            steps.iter().map(|both| of(both).length_squared()).sum::<f64>() / (3 * steps.len()) as f64
        };
        [mean(|both| both.0), mean(|both| both.1)]
    }

    /// A camera in uniform motion, in m/s and rad/s, from 0 on.
    fn moving(count: usize, velocity: (DVec3, DVec3)) -> Vec<(Pose, Covariance)> {
        let from = Pose::new(DQuat::from_rotation_x(2.6), DVec3::new(0.1, -0.2, 0.8));
        let at = |t: f64| stepped(&from, (t * velocity.0, t * velocity.1));
        (0..count).map(|i| (at(INTERVAL_S * i as f64), covariance(INTERVAL_S * i as f64))).collect()
    }

    const VELOCITY: (DVec3, DVec3) = (DVec3::new(0.3, -0.5, 0.2), DVec3::new(0.4, 0.1, -0.3));

    fn live(poses: &[(Pose, Covariance)]) -> Vec<(Pose, Covariance)> {
        let mut smoother = Smoother::new(TAU_S, 0.1);
        poses.iter().map(|(pose, covariance)| smoother.next(pose, covariance)).collect()
    }

    #[test]
    fn noise_at_rest_is_reduced_by_the_computed_factor() {
        let (truth, poses) = resting(20_000);
        let before = variances(&truth, &poses);
        let share = 1.0 - (-INTERVAL_S / TAU_S).exp();
        let a = (-INTERVAL_S / TAU_S).exp();
        let forward_backward = ((1.0 - a) / (1.0 + a)).powi(2) * (1.0 + a * a) / (1.0 - a * a);
        for (after, expected) in
            [(live(&poses), share / (2.0 - share)), (smooth_poses(&poses, TAU_S, 0.1), forward_backward)]
        {
            // Computed: α = 0.4866, so 0.3215; a = 0.5134, so 0.1034 · 1.2636/0.7364 = 0.1774.
            assert!((expected - if expected > 0.2 { 0.3215 } else { 0.1774 }).abs() < 1e-4, "{expected}");
            let inner = &after[100..after.len() - 100];
            for (quiet, loud) in variances(&truth, inner).into_iter().zip(before) {
                // Twenty thousand poses, three axes, correlated over some frames: the ratio is
                // known to 2 %.
                assert!((quiet / loud / expected - 1.0).abs() < 0.04, "{quiet} {loud} {expected}");
            }
            // The covariances have the same ratio.
            for (_, covariance) in inner {
                (0..21).for_each(|i| assert!((covariance.upper[i] / (1.0 + i as f64) / expected - 1.0).abs() < 1e-4));
            }
        }
    }

    #[test]
    fn uniform_motion_lags_online_by_the_formula_and_offline_not_at_all() {
        let poses = moving(90, VELOCITY);
        let lag_s = INTERVAL_S / ((INTERVAL_S / TAU_S).exp() - 1.0);
        // Computed: 1/30 / 0.9477 = 35.2 ms, and τ − Δt/2 is 33.3.
        assert!((lag_s - 0.035_172).abs() < 1e-5, "{lag_s}");
        let last = live(&poses);
        let (turn, moved_m) = step(&last[89].0, &poses[89].0);
        assert!((turn - lag_s * VELOCITY.0).length() < 1e-6 && (moved_m - lag_s * VELOCITY.1).length() < 1e-6);
        // Including the ends.
        for (after, truth) in smooth_poses(&poses, TAU_S, 0.1).iter().zip(&poses) {
            let (turn, moved_m) = step(&after.0, &truth.0);
            assert!(turn.length() < 1e-9 && moved_m.length() < 1e-9, "{turn} {moved_m}");
        }
    }

    #[test]
    fn smoothing_does_not_cross_a_gap() {
        let mut poses = moving(20, VELOCITY);
        for (at, (pose, covariance)) in poses.iter_mut().enumerate().skip(10) {
            *pose = Pose::new(DQuat::from_rotation_y(0.1 * at as f64), DVec3::new(0.0, 0.0, 9.0));
            covariance.time_s += 0.1;
        }
        let (whole, after) = (live(&poses), live(&poses[10..]));
        assert_eq!((&whole[10..], whole[10].0), (&after[..], poses[10].0));
        let whole = smooth_poses(&poses, TAU_S, 0.1);
        assert_eq!(whole[..10], smooth_poses(&poses[..10], TAU_S, 0.1));
        assert_eq!(whole[10..], smooth_poses(&poses[10..], TAU_S, 0.1));
        // A single pose is unchanged, and so is one whose clock went back.
        assert_eq!(smooth_poses(&poses[..1], TAU_S, 0.1), poses[..1]);
        let mut smoother = Smoother::new(TAU_S, 0.1);
        smoother.next(&poses[5].0, &poses[5].1);
        assert_eq!(smoother.next(&poses[0].0, &poses[0].1), poses[0]);
    }
}
