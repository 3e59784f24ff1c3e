//! A flat tag that is far off looks nearly the same when it leans the other way. Which of the two poses it was, the pictures
//! around it say: a camera does not jump.

use glam::DQuat;

use super::sight::Sight;
use super::solve::Solved;
use crate::pose::Pose;
use crate::tracking::covariance::Covariance;

/// Poses farther apart in time say nothing of each other, seconds.
const REACH_S: f64 = 0.5;
/// The nearer of two poses is taken if the other is so many times as far...
const NEARER: f64 = 1.5;
/// ... or, as an angle, by this much farther, rad.
const FARTHER_RAD: f64 = 0.1;

/// A pose that was chosen, at its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    pub time_s: f64,
    pub solved: Solved,
    /// Whether the picture or those around it leave no doubt which of two poses it is.
    pub certain: bool,
}

impl Chosen {
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

/// Where a camera that goes on as it went will be at a time. `past` ascends in time towards it, or descends; the last two
/// count. `None` if the last one is too long ago.
pub fn expected(past: &[(f64, Pose)], time_s: f64) -> Option<Pose> {
    let (now_s, now) = *past.last().filter(|last| (time_s - last.0).abs() <= REACH_S)?;
    let Some((before_s, before)) =
        past.len().checked_sub(2).map(|i| past[i]).filter(|p| (now_s - p.0).abs() <= REACH_S && p.0 != now_s)
    else {
        return Some(now);
    };
    let share = ((time_s - now_s) / (now_s - before_s)).clamp(0.0, 3.0);
    let turn = (now.world_from_camera_rotation() * before.rotation).to_scaled_axis() * share;
    let position = now.position_in_world_m() + share * (now.position_in_world_m() - before.position_in_world_m());
    Some(Pose::from_camera_in_world(position, DQuat::from_scaled_axis(turn) * now.world_from_camera_rotation()))
}

/// Of what a picture allows, what is nearest to where the camera was expected.
pub fn chosen(time_s: f64, sight: &Sight, expected: Option<&Pose>) -> Chosen {
    let best = || sight.best.clone();
    let Some(other) = &sight.other else { return Chosen { time_s, solved: best(), certain: true } };
    let Some(expected) = expected else { return Chosen { time_s, solved: best(), certain: false } };
    let far = |solved: &Solved| solved.pose.rotation.angle_between(expected.rotation);
    let (own, its) = (far(&sight.best), far(other));
    let (near, farther) = (own.min(its), own.max(its));
    let certain = farther > (NEARER * near).max(1e-9) || farther - near > FARTHER_RAD;
    let solved = if its < own && certain { other.clone() } else { best() };
    Chosen { time_s, solved, certain }
}

/// Chooses along a video, from what is certain on, forwards and backwards. `None` where no pose is.
pub fn along(sights: &[(f64, Option<Sight>)]) -> Vec<Option<Chosen>> {
    let mut all: Vec<Option<Chosen>> = vec![None; sights.len()];
    pass(sights, (0..sights.len()).collect(), &mut all);
    // What began in doubt is known from what came after it.
    pass(sights, (0..sights.len()).rev().collect(), &mut all);
    all
}

fn pass(sights: &[(f64, Option<Sight>)], order: Vec<usize>, all: &mut [Option<Chosen>]) {
    let mut past: Vec<(f64, Pose)> = Vec::new();
    for i in order {
        let (time_s, Some(sight)) = &sights[i] else { continue };
        if !all[i].as_ref().is_some_and(|chosen| chosen.certain) {
            let expected = expected(&past, *time_s);
            all[i] = Some(chosen(*time_s, sight, expected.as_ref()));
        }
        match &all[i] {
            Some(chosen) if chosen.certain => {
                past.push((*time_s, chosen.solved.pose));
                if past.len() > 2 {
                    past.remove(0);
                }
            }
            _ => past.clear(),
        }
    }
}
