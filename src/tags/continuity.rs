//! Resolves the pose ambiguity of a flat tag: at a distance its picture is nearly the same when it
//! leans the other way. The poses of neighbouring pictures decide, because a camera does not jump.

use glam::DQuat;

use super::sight::BoardPose;
use super::solve::PoseSolution;
use crate::pose::Pose;
use crate::tracking::covariance::Covariance;

/// Longest interval between poses that are compared, seconds.
const MAX_INTERVAL_S: f64 = 0.5;
/// The closer of two poses is chosen if the other is at least this many times as far...
const MIN_DISTANCE_RATIO: f64 = 1.5;
/// ... or farther by this angle, rad.
const MIN_DIFFERENCE_RAD: f64 = 0.1;

/// A chosen pose with its time.
#[derive(Clone, Debug, PartialEq)]
pub struct ChosenPose {
    pub time_s: f64,
    pub solved: PoseSolution,
    /// True if the picture or its neighbours determine which of the two poses it is.
    pub is_certain: bool,
}

impl ChosenPose {
    pub fn covariance(&self) -> Covariance {
        let mut upper = (0..6).flat_map(|i| (i..6).map(move |j| self.solved.covariance[(i, j)]));
        Covariance { time_s: self.time_s, upper: std::array::from_fn(|_| upper.next().unwrap_or_default()) }
    }

    pub(super) fn set_covariance(&mut self, covariance: &Covariance) {
        let places = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
        for ((i, j), value) in places.zip(covariance.upper) {
            (self.solved.covariance[(i, j)], self.solved.covariance[(j, i)]) = (value, value);
        }
    }
}

/// Pose at a time, extrapolated at constant velocity from the last two poses of `past`, whose times
/// ascend or descend towards it. `None` if the last one is too far away.
pub fn extrapolated_pose(past: &[(f64, Pose)], time_s: f64) -> Option<Pose> {
    let (now_s, now) = *past.last().filter(|last| (time_s - last.0).abs() <= MAX_INTERVAL_S)?;
    let Some((before_s, before)) =
        past.len().checked_sub(2).map(|i| past[i]).filter(|p| (now_s - p.0).abs() <= MAX_INTERVAL_S && p.0 != now_s)
    else {
        return Some(now);
    };
    let share = ((time_s - now_s) / (now_s - before_s)).clamp(0.0, 3.0);
    let turn = (now.world_from_camera_rotation() * before.rotation).to_scaled_axis() * share;
    let position = now.position_in_world_m() + share * (now.position_in_world_m() - before.position_in_world_m());
    Some(Pose::from_camera_in_world(position, DQuat::from_scaled_axis(turn) * now.world_from_camera_rotation()))
}

/// Chooses the pose of a picture that is closest to the expected one.
pub fn choose_pose(time_s: f64, sight: &BoardPose, expected: Option<&Pose>) -> ChosenPose {
    let best = || sight.best.clone();
    let Some(other) = &sight.other else { return ChosenPose { time_s, solved: best(), is_certain: true } };
    let Some(expected) = expected else { return ChosenPose { time_s, solved: best(), is_certain: false } };
    let far = |solved: &PoseSolution| solved.pose.rotation.angle_between(expected.rotation);
    let (own, its) = (far(&sight.best), far(other));
    let (near, farther) = (own.min(its), own.max(its));
    let is_certain = farther > (MIN_DISTANCE_RATIO * near).max(1e-9) || farther - near > MIN_DIFFERENCE_RAD;
    let solved = if its < own && is_certain { other.clone() } else { best() };
    ChosenPose { time_s, solved, is_certain }
}

/// Chooses along a video, forwards and backwards from unambiguous pictures. `None` for pictures
/// without a pose.
pub fn choose_along(sights: &[(f64, Option<BoardPose>)]) -> Vec<Option<ChosenPose>> {
    let mut all: Vec<Option<ChosenPose>> = vec![None; sights.len()];
    pass(sights, (0..sights.len()).collect(), &mut all);
    // Pictures that were ambiguous in the first pass follow from later ones.
    pass(sights, (0..sights.len()).rev().collect(), &mut all);
    all
}

fn pass(sights: &[(f64, Option<BoardPose>)], order: Vec<usize>, all: &mut [Option<ChosenPose>]) {
    let mut past: Vec<(f64, Pose)> = Vec::new();
    for i in order {
        let (time_s, Some(sight)) = &sights[i] else { continue };
        if !all[i].as_ref().is_some_and(|chosen| chosen.is_certain) {
            let expected = extrapolated_pose(&past, *time_s);
            all[i] = Some(choose_pose(*time_s, sight, expected.as_ref()));
        }
        match &all[i] {
            Some(chosen) if chosen.is_certain => {
                past.push((*time_s, chosen.solved.pose));
                if past.len() > 2 {
                    past.remove(0);
                }
            }
            _ => past.clear(),
        }
    }
}
