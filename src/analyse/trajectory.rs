//! Interpolation of the camera's trajectory through refined poses.
//!
//! The motion at a frame is the derivative of the polynomial through the logarithms of the poses
//! around it, up to two on each side. Between two frames the trajectory is the cubic Hermite spline
//! by the poses and motions of both, in the first one's axes.

use glam::DAffine3;

use super::state::CameraState;
use crate::fit::twist::{self, Twist};

/// Number of frames on each side from which the motion is derived.
const FRAMES_PER_SIDE: usize = 2;

/// Derives the motion at each frame from the poses around it, not across gaps of more than
/// `max_gap_s`. Frames without neighbours keep their motion.
pub fn with_motion(times_s: &[f64], states: &[Option<CameraState>], max_gap_s: f64) -> Vec<Option<CameraState>> {
    let posed: Vec<(usize, CameraState)> =
        states.iter().enumerate().filter_map(|(n, state)| Some((n, (*state)?))).collect();
    let interval_s = |n: usize| times_s[posed[n + 1].0] - times_s[posed[n].0];
    let is_joined = |n: usize| interval_s(n) > 0.0 && interval_s(n) <= max_gap_s;
    let mut out = states.to_vec();
    for (n, (frame, here)) in posed.iter().enumerate() {
        let before = (1..=FRAMES_PER_SIDE.min(n)).take_while(|k| is_joined(n - k)).count();
        let after = (0..FRAMES_PER_SIDE.min(posed.len() - 1 - n)).take_while(|k| is_joined(n + k)).count();
        let around: Vec<usize> = (n - before..=n + after).filter(|k| *k != n).collect();
        if around.is_empty() {
            continue;
        }
        // d/dt at 0 of Lagrange's polynomial through (0, 0) and the others: Σ x_k · 1/t_k · Π t_m /
        // (t_m − t_k).
        let at_s = |k: usize| times_s[posed[k].0] - times_s[*frame];
        let inverse = here.world_from_camera.inverse();
        let mut motion = Twist::zeros();
        for k in &around {
            let others = around.iter().filter(|m| *m != k);
            let weight = others.map(|m| at_s(*m) / (at_s(*m) - at_s(*k))).product::<f64>() / at_s(*k);
            motion += weight * twist::log(&(inverse * posed[*k].1.world_from_camera));
        }
        out[*frame] = Some(CameraState { twist: motion, ..*here });
    }
    out
}

/// The pose between two frames, `interval_s` apart, at the fraction `share` of the time between
/// them.
pub fn between(a: &CameraState, b: &CameraState, interval_s: f64, share: f64) -> DAffine3 {
    let whole = twist::log(&(a.world_from_camera.inverse() * b.world_from_camera));
    // ḣ at the end: inverse differential of exp, to first order 1 + ½ ad(h).
    let (start, end) = (a.twist * interval_s, b.twist * interval_s);
    let end = end + 0.5 * bracket(&whole, &end);
    let (s, s2, s3) = (share, share * share, share.powi(3));
    let h = whole * (3.0 * s2 - 2.0 * s3) + start * (s - 2.0 * s2 + s3) + end * (s3 - s2);
    a.world_from_camera * twist::exp(&h)
}

/// ad(x)·y: (ω_x × v_y + v_x × ω_y, ω_x × ω_y).
fn bracket(x: &Twist, y: &Twist) -> Twist {
    let (vx, wx, vy, wy) =
        (twist::translation(x), twist::rotation_vector(x), twist::translation(y), twist::rotation_vector(y));
    twist::twist(wx.cross(vy) + vx.cross(wy), wx.cross(wy))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A camera that turns and moves unevenly.
    fn truth(time_s: f64) -> DAffine3 {
        let x = twist::twist(
            DVec3::new(0.3 * (2.0 * time_s).sin(), 0.1 * time_s, 0.2 * time_s * time_s),
            DVec3::new(0.5 * time_s, 0.4 * (3.0 * time_s).cos(), -0.3 * time_s),
        );
        twist::exp(&x)
    }

    #[test]
    fn smooth_trajectory_is_interpolated_between_poses() {
        let times_s: Vec<f64> = (0..12).map(|i| f64::from(i) / 30.0 + if i % 3 == 0 { 0.004 } else { 0.0 }).collect();
        let at = |t: &f64| Some(CameraState { world_from_camera: truth(*t), twist: Twist::zeros() });
        let states = with_motion(&times_s, &times_s.iter().map(at).collect::<Vec<_>>(), 0.1);
        for k in 2..9 {
            let (a, b) = (states[k].unwrap(), states[k + 1].unwrap());
            let h = 1e-5;
            let motion = twist::log(&(truth(times_s[k] - h).inverse() * truth(times_s[k] + h))) / (2.0 * h);
            assert!((a.twist - motion).norm() < 2e-4, "{k}: {} {motion}", a.twist);
            for share in [0.0, 0.3, 0.5, 1.0] {
                let interval_s = times_s[k + 1] - times_s[k];
                let interpolated = between(&a, &b, interval_s, share);
                assert!(interpolated.abs_diff_eq(truth(times_s[k] + share * interval_s), 2e-6), "{k} {share}");
            }
        }
    }

    #[test]
    fn motion_is_not_derived_across_a_gap() {
        let times_s = [0.0, 0.03, 1.0];
        let still = |x: f64| {
            Some(CameraState { world_from_camera: DAffine3::from_translation(DVec3::X * x), twist: Twist::zeros() })
        };
        let states = with_motion(&times_s, &[still(0.0), still(0.03), still(9.0)], 0.1);
        assert!((states[1].unwrap().twist[0] - 1.0).abs() < 1e-9);
        assert_eq!(states[2].unwrap().twist, Twist::zeros());
    }
}
