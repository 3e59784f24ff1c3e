//! How much later the depth sensor's clock runs than the colour camera's.
//!
//! The rims of near things in the depth map, carried to the frame's moment, lie on the picture's edges if the map's own moment
//! is right. So for a grid of offsets the picture's slope on those rims is compared with its slope everywhere; the greatest is
//! the offset (parabola through the best and its neighbours).

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::carried;
use super::eye::Eye;
use super::pyramid::{Plane, gaussian};
use super::state::{State, moved, seen};
use crate::fit::twist;
use crate::frame::Frame;
use crate::parallel::over_rows;

/// Offsets that are tried, seconds.
const STEP_S: f64 = 0.005;
const STEPS: i32 = 9;
/// A depth jump is at least this share of the depth.
const JUMP: f32 = 0.08;
/// Slopes count up to this share of the picture's.
const STEEPEST: f64 = 0.97;
/// What the parabola, and rims that are not sharp, make the offset wrong by besides, one standard deviation, seconds: simulated,
/// 0.6 ms of 20.
const EACH_S: f64 = 0.1 * STEP_S;
/// Points on rims that a frame needs to be heard, and frames.
const LEAST_JUMPS: usize = 300;
const LEAST_FRAMES: usize = 6;
/// Parts of which each is left out once to see how sure the offset is.
const PARTS: usize = 6;

/// For each offset how well depth jumps lie on the picture's edges, frame by frame.
#[derive(Debug, Default)]
pub struct DepthClock {
    scores: Vec<Vec<f64>>,
}

/// Added to the depth maps' times, and one standard deviation, seconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthLater {
    pub later_s: f64,
    pub sigma_s: f64,
}

fn offset_s(n: usize) -> f64 {
    STEP_S * f64::from(n as i32 - STEPS)
}

impl DepthClock {
    /// Hears a frame. One whose camera rests, or without depth, says nothing.
    pub fn add(&mut self, eye: &Eye, frame: &Frame, state: &State, threads: usize) {
        let Some(map) = &frame.depth else { return };
        let (width, _) = eye.size();
        if (map.width as usize, map.height as usize) != eye.size() || twist::turn(&state.twist).length() < 0.1 {
            return;
        }
        let slope = slopes(frame);
        let mean = f64::from(slope.values.iter().sum::<f32>()) / slope.values.len() as f64;
        let rims = rims(&map.depth_m, width);
        if rims.len() < LEAST_JUMPS || mean <= 0.0 {
            return;
        }
        let point = |i: &usize| {
            let there = f64::from(map.depth_m[*i]) * DVec3::from(eye.rays[*i].map(f64::from));
            let y = (i / width) as f64 + 0.5;
            (moved(there, &state.twist, eye.geometry.row_time_s(y)), y)
        };
        let points: Vec<(DVec3, f64)> = rims.iter().map(point).collect();
        let mut scores = vec![f64::NAN; 2 * STEPS as usize + 1];
        over_rows(&mut scores, 1, threads, |n, score| {
            let shift = twist::exp(&((map.timestamp_s + offset_s(n) - frame.timestamp_s) * state.twist));
            let on = points.iter().filter_map(|(point, y)| {
                let (at, _) = seen(&eye.geometry, shift.transform_point3(*point), &state.twist, Some(*y), 2)?;
                slope.at((at.x - 0.5) as f32, (at.y - 0.5) as f32)
            });
            let (sum, count) = on.fold((0.0, 0), |(sum, count), s| (sum + f64::from(s), count + 1));
            if 2 * count > points.len() {
                score[0] = sum / f64::from(count as u32) / mean;
            }
        });
        if scores.iter().all(|score| score.is_finite()) {
            self.scores.push(scores);
        }
    }

    /// `None` if too few frames had something to say, or if the best offset is none of those that were tried.
    pub fn finish(&self) -> Option<DepthLater> {
        let count = self.scores.len();
        if count < LEAST_FRAMES {
            return None;
        }
        let best = |without: Option<usize>| -> Option<f64> {
            let kept = self.scores.iter().enumerate().filter(|(i, _)| Some(i * PARTS / count) != without);
            let mut sums = vec![0.0; 2 * STEPS as usize + 1];
            kept.for_each(|(_, scores)| sums.iter_mut().zip(scores).for_each(|(sum, score)| *sum += score));
            let top = (0..sums.len()).max_by(|a, b| sums[*a].total_cmp(&sums[*b]))?;
            let (before, after) = (sums.get(top.checked_sub(1)?)?, sums.get(top + 1)?);
            let bend = before - 2.0 * sums[top] + after;
            let part = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
            Some(offset_s(top) + STEP_S * part)
        };
        let later_s = best(None)?;
        let without: Vec<f64> = (0..PARTS).filter_map(|part| best(Some(part))).collect();
        let n = without.len() as f64;
        let mean = without.iter().sum::<f64>() / n;
        let spread: f64 = without.iter().map(|x| (x - mean).powi(2)).sum();
        Some(DepthLater { later_s, sigma_s: (spread * (n - 1.0) / n).sqrt().hypot(EACH_S) })
    }
}

fn slopes(frame: &Frame) -> Plane {
    let (along, down) = Plane::of(&frame.pixels).filtered(&gaussian(1.0)).slopes();
    let mut slope: Vec<f32> = along.values.iter().zip(&down.values).map(|(x, y)| x.hypot(*y)).collect();
    let mut sorted = slope.clone();
    let at = ((sorted.len() as f64 * STEEPEST) as usize).min(sorted.len() - 1);
    let most = *sorted.select_nth_unstable_by(at, f32::total_cmp).1;
    slope.iter_mut().for_each(|s| *s = s.min(most));
    Plane { values: slope, ..along }
}

/// Pixels beside which depth jumps back, with nothing unknown near.
fn rims(depth: &[f32], width: usize) -> Vec<usize> {
    let known: Vec<f32> = depth.iter().map(|z| if *z > 0.0 { *z } else { -1.0 }).collect();
    let low = carried::extreme(&known, width, 2, |a, b| if a < b { a } else { b });
    let jumps_at = |i: usize, other: usize| depth[other] - depth[i] > JUMP * depth[i];
    let is_rim = |i: &usize| low[*i] > 0.0 && [i - 1, i + 1, i - width, i + width].iter().any(|o| jumps_at(*i, *o));
    let height = depth.len() / width;
    let inner = (2..height - 2).flat_map(|y| (2..width - 2).map(move |x| y * width + x));
    inner.filter(is_rim).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offset_between_two_steps_is_the_top_of_the_parabola() {
        for later_s in [0.0015, -0.0015, 0.0213, -0.0338] {
            let score = |n| 1.0 - (offset_s(n) - later_s).powi(2);
            let scores: Vec<f64> = (0..=2 * STEPS as usize).map(score).collect();
            let found = DepthClock { scores: vec![scores; LEAST_FRAMES] }.finish().unwrap();
            assert!((found.later_s - later_s).abs() < 1e-6, "{} s, not {later_s} s", found.later_s);
            // All frames agree: the parabola's own uncertainty is left.
            assert!((found.sigma_s - EACH_S).abs() < 1e-6, "{} s", found.sigma_s);
        }
    }
}
