//! Samples a refined trajectory as a pose track, densely enough for linear interpolation between
//! the samples.

use glam::DAffine3;

use super::recorded_motion::RecordedMotion;
use super::state::{self, CameraState};
use super::trajectory;
use crate::fit::twist;
use crate::pose::Pose;

/// Smallest number of poses per frame interval.
const MIN_POSES_PER_INTERVAL: usize = 8;

/// Longest gap between frames across which the trajectory is interpolated, in usual frame
/// intervals.
pub const MAX_GAP_INTERVALS: f64 = 3.5;

/// A frame of the trajectory.
#[derive(Clone, Copy, Debug)]
pub struct TrackKnot {
    pub time_s: f64,
    pub state: CameraState,
    /// Whether the poses of its neighbours are unrelated to its motion, which is then extrapolated
    /// half-way to them: for a repeated picture, or a pose with independent errors.
    pub is_alone: bool,
}

/// Poses by time, strictly ascending. The track is extrapolated by one `usual_s` before the first
/// frame and after the last, so that it covers their exposures and depth maps. There are no poses
/// in gaps longer than `max_gap_s`. Of frames with equal times the first is used. `way`: the
/// recorded motion, if it is followed between the frames.
pub fn poses(knots: &[TrackKnot], usual_s: f64, max_gap_s: f64, way: Option<&RecordedMotion<'_>>) -> Vec<(f64, Pose)> {
    let mut out: Vec<(f64, Pose)> = Vec::new();
    let mut put = |time_s: f64, at: DAffine3| {
        if out.last().is_none_or(|last| time_s > last.0) {
            out.push((time_s, state::pose(&at)));
        }
    };
    let on = |knot: &TrackKnot, by_s: f64| knot.state.world_from_camera * twist::exp(&(by_s * knot.state.twist));
    let correction =
        |knot: &TrackKnot| way.filter(|_| !knot.is_alone).and_then(|way| way.correction(knot.time_s, &knot.state));
    // Extrapolation from a frame.
    let pose_near_knot = |knot: &TrackKnot, by_s: f64| {
        let followed = correction(knot).and_then(|by| way?.corrected(knot.time_s + by_s, &by));
        followed.unwrap_or_else(|| on(knot, by_s))
    };
    let steps =
        |within_s: f64| way.map_or(MIN_POSES_PER_INTERVAL, |way| way.steps(within_s).max(MIN_POSES_PER_INTERVAL));
    let beyond = steps(usual_s);
    let step_s = usual_s / steps(usual_s) as f64;
    for (n, knot) in knots.iter().enumerate() {
        let is_joined = |a: &TrackKnot, b: &TrackKnot| b.time_s - a.time_s <= max_gap_s;
        let before = n.checked_sub(1).map(|b| &knots[b]);
        if before.is_none_or(|before| !is_joined(before, knot)) {
            (1..=beyond)
                .rev()
                .for_each(|k| put(knot.time_s - k as f64 * step_s, pose_near_knot(knot, -(k as f64) * step_s)));
        }
        put(knot.time_s, knot.state.world_from_camera);
        match knots.get(n + 1).filter(|next| is_joined(knot, next)) {
            Some(next) => {
                let interval_s = next.time_s - knot.time_s;
                let by = correction(knot).zip(correction(next));
                let count = steps(interval_s);
                for k in 1..count {
                    let share = k as f64 / count as f64;
                    let followed = by.as_ref().and_then(|(from, to)| {
                        way?.corrected(knot.time_s + share * interval_s, &(from + share * (to - from)))
                    });
                    let at = if let Some(at) = followed {
                        at
                    } else if !(knot.is_alone || next.is_alone) {
                        trajectory::between(&knot.state, &next.state, interval_s, share)
                    } else if 2 * k <= count {
                        on(knot, share * interval_s)
                    } else {
                        on(next, (share - 1.0) * interval_s)
                    };
                    put(knot.time_s + share * interval_s, at);
                }
            }
            None => {
                (1..=beyond).for_each(|k| put(knot.time_s + k as f64 * step_s, pose_near_knot(knot, k as f64 * step_s)))
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::PoseTrack;
    use glam::DVec3;

    fn knot(time_s: f64, x: f64, speed: f64, is_alone: bool) -> TrackKnot {
        let twist = twist::twist(DVec3::X * speed, DVec3::ZERO);
        TrackKnot {
            time_s,
            state: CameraState { world_from_camera: DAffine3::from_translation(DVec3::X * x), twist },
            is_alone,
        }
    }

    fn x(track: &PoseTrack, time_s: f64) -> f64 {
        track.at(time_s).unwrap().position_in_world_m().x
    }

    #[test]
    fn track_interpolates_its_knots_and_extends_by_one_interval() {
        let knots = [knot(0.0, 0.0, 1.0, false), knot(0.1, 0.1, 1.0, false), knot(0.9, 5.0, 2.0, false)];
        let track = PoseTrack::new(poses(&knots, 0.1, 0.3, None), 0.1).unwrap();
        for (time_s, expected) in [(-0.1, -0.1), (0.0, 0.0), (0.0625, 0.0625), (0.2, 0.2), (0.8, 4.8), (1.0, 5.2)] {
            assert!((x(&track, time_s) - expected).abs() < 1e-12, "{time_s}: {}", x(&track, time_s));
        }
        assert!(track.at(0.5).is_err() && track.at(-0.11).is_err());
    }

    #[test]
    fn recorded_motion_is_followed_between_distant_frames() {
        // A swing of 10 a second and 4 mm, recorded 200 times a second, 5 ms late, and 30 mm too
        // far to the right.
        let swing = |time_s: f64| 0.004 * (20.0 * std::f64::consts::PI * time_s).sin();
        let recorded = (-40..300).map(|k| 0.005 * f64::from(k)).map(|time_s| {
            (time_s, state::pose(&DAffine3::from_translation(DVec3::X * (swing(time_s - 0.005) + 0.03))))
        });
        let recorded = PoseTrack::new(recorded.collect(), 0.02).unwrap();
        let way = RecordedMotion { track: &recorded, later_s: 0.005, hand_eye: twist::Twist::zeros() };
        // Of which averaging leaves (1 + 2·cos(ωδ) + 2·cos(2ωδ)) / 5 at δ = 3.75 ms.
        let left = 0.9453;
        // It was found to be right but for a drift of 1 mm from one frame to the next.
        let drift = |time_s: f64| 0.005 * time_s;
        let knots = [0.0, 0.2, 0.4].map(|t| knot(t, swing(t) + drift(t), 0.0, false));
        let track = PoseTrack::new(poses(&knots, 0.2, 0.7, Some(&way)), 0.02).unwrap();
        for k in -18..=98 {
            let time_s = 0.005 * f64::from(k);
            let expected = left * swing(time_s) + drift(time_s.clamp(0.0, 0.4));
            // Straight lines between poses lie h²·ω²/8 of 4 mm inside, once recorded and once
            // written.
            assert!((x(&track, time_s) - expected).abs() < 1.5e-4, "{time_s}: {} {expected}", x(&track, time_s));
        }
        // By the frames alone the swing is lost: it is 4 mm off.
        let track = PoseTrack::new(poses(&knots, 0.2, 0.7, None), 0.1).unwrap();
        assert!((x(&track, 0.025) - swing(0.025)).abs() > 0.003);
    }

    #[test]
    fn repeated_picture_has_the_motion_of_the_first() {
        let knots = [knot(0.0, 0.0, 1.0, false), knot(0.1, 0.0, 1.0, true), knot(0.2, 0.2, 1.0, false)];
        let track = PoseTrack::new(poses(&knots, 0.1, 0.3, None), 0.1).unwrap();
        for by_s in [-0.0125, 0.0, 0.0125] {
            assert!((x(&track, 0.1 + by_s) - by_s).abs() < 1e-12, "{by_s}");
        }
        assert!((x(&track, 0.025) - 0.025).abs() < 1e-12 && (x(&track, 0.0875) + 0.0125).abs() < 1e-12);
    }
}
