//! Clock offset between the depth sensor and the colour camera.
//!
//! Occluding edges of the depth map, reprojected to the frame's time, lie on the picture's edges if
//! the map's time is right. For a grid of offsets the mean picture gradient on these edges is
//! divided by its mean over the picture. The offset is the maximum (parabola through the best value
//! and its neighbours).

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::camera_model::CameraModel;
use super::state::{CameraState, move_point, project_rolling_shutter};
use crate::fit::quantile::upper_quantile;
use crate::fit::twist;
use crate::frame::Frame;
use crate::grey_image::{GreyImage, eroded, gaussian};
use crate::parallel::over_rows;

/// Grid of offsets: its step, s, and the number of steps to each side.
const STEP_S: f64 = 0.005;
const STEPS_PER_SIDE: i32 = 9;
/// Smallest depth step of an occluding edge, by the depth.
const MIN_EDGE_STEP: f32 = 0.08;
/// Gradients are clamped to this quantile of the picture's.
const GRADIENT_CLAMP_QUANTILE: f64 = 0.97;
/// Error by the parabola and by soft edges, one standard deviation, s. Simulated: 0.6 ms of 20.
const SYSTEMATIC_SIGMA_S: f64 = 0.1 * STEP_S;
/// Smallest numbers of edge points in a frame, and of frames.
const MIN_EDGE_POINTS: usize = 300;
const MIN_FRAMES: usize = 6;
/// Parts of the frames for the jackknife.
const JACKKNIFE_PARTS: usize = 6;

/// Scores by frame and offset: mean gradient on depth edges by the picture's mean gradient.
#[derive(Debug, Default)]
pub struct DepthClock {
    scores: Vec<Vec<f64>>,
}

/// Offset of depth's clock: added to the depth maps' times, with one standard deviation, s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthOffset {
    pub offset_s: f64,
    pub sigma_s: f64,
}

fn offset_s(n: usize) -> f64 {
    STEP_S * f64::from(n as i32 - STEPS_PER_SIDE)
}

impl DepthClock {
    /// Adds a frame. Frames without depth or with a camera that hardly turns are ignored.
    pub fn add(&mut self, model: &CameraModel, frame: &Frame, state: &CameraState, threads: usize) {
        let Some(map) = &frame.depth else { return };
        let (width, _) = model.size();
        if (map.width as usize, map.height as usize) != model.size()
            || twist::rotation_vector(&state.twist).length() < 0.1
        {
            return;
        }
        let slope = clamped_gradient(frame);
        let mean = f64::from(slope.values.iter().sum::<f32>()) / slope.values.len() as f64;
        let edges = occluding_edges(&map.depth_m, width);
        if edges.len() < MIN_EDGE_POINTS || mean <= 0.0 {
            return;
        }
        let point = |i: &usize| {
            let there = f64::from(map.depth_m[*i]) * DVec3::from(model.rays[*i].map(f64::from));
            let y = (i / width) as f64 + 0.5;
            (move_point(there, &state.twist, model.geometry.row_time_s(y)), y)
        };
        let points: Vec<(DVec3, f64)> = edges.iter().map(point).collect();
        let mut scores = vec![f64::NAN; 2 * STEPS_PER_SIDE as usize + 1];
        over_rows(&mut scores, 1, threads, |n, score| {
            let shift = twist::exp(&((map.timestamp_s + offset_s(n) - frame.timestamp_s) * state.twist));
            let on = points.iter().filter_map(|(point, y)| {
                let (at, _) = project_rolling_shutter(
                    &model.geometry,
                    shift.transform_point3(*point),
                    &state.twist,
                    Some(*y),
                    2,
                )?;
                slope.sample_inside((at.x - 0.5) as f32, (at.y - 0.5) as f32)
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

    /// `None` for too few frames, or if the maximum lies at the end of the grid.
    pub fn finish(&self) -> Option<DepthOffset> {
        let count = self.scores.len();
        if count < MIN_FRAMES {
            return None;
        }
        let best = |without: Option<usize>| -> Option<f64> {
            let kept = self.scores.iter().enumerate().filter(|(i, _)| Some(i * JACKKNIFE_PARTS / count) != without);
            let mut sums = vec![0.0; 2 * STEPS_PER_SIDE as usize + 1];
            kept.for_each(|(_, scores)| sums.iter_mut().zip(scores).for_each(|(sum, score)| *sum += score));
            let top = (0..sums.len()).max_by(|a, b| sums[*a].total_cmp(&sums[*b]))?;
            let (before, after) = (sums.get(top.checked_sub(1)?)?, sums.get(top + 1)?);
            let bend = before - 2.0 * sums[top] + after;
            let part = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
            Some(offset_s(top) + STEP_S * part)
        };
        let offset_s = best(None)?;
        let without: Vec<f64> = (0..JACKKNIFE_PARTS).filter_map(|part| best(Some(part))).collect();
        let n = without.len() as f64;
        let mean = without.iter().sum::<f64>() / n;
        let spread: f64 = without.iter().map(|x| (x - mean).powi(2)).sum();
        Some(DepthOffset { offset_s, sigma_s: (spread * (n - 1.0) / n).sqrt().hypot(SYSTEMATIC_SIGMA_S) })
    }
}

/// Gradient magnitude of the smoothed luma.
fn clamped_gradient(frame: &Frame) -> GreyImage {
    let (along, down) = GreyImage::luma_601(&frame.pixels).filtered(&gaussian(1.0)).sobel();
    let mut slope: Vec<f32> = along.values.iter().zip(&down.values).map(|(x, y)| x.hypot(*y)).collect();
    let max_slope = upper_quantile(&mut slope.clone(), GRADIENT_CLAMP_QUANTILE).unwrap_or(0.0);
    slope.iter_mut().for_each(|s| *s = s.min(max_slope));
    GreyImage { values: slope, ..along }
}

/// Pixels on the near side of a depth step, with no unknown depth within 2 px.
fn occluding_edges(depth: &[f32], width: usize) -> Vec<usize> {
    let depth_or_min: Vec<f32> = depth.iter().map(|z| if *z > 0.0 { *z } else { -1.0 }).collect();
    let low = eroded(&depth_or_min, width, 2);
    let is_step = |i: usize, other: usize| depth[other] - depth[i] > MIN_EDGE_STEP * depth[i];
    let is_edge = |i: &usize| low[*i] > 0.0 && [i - 1, i + 1, i - width, i + width].iter().any(|o| is_step(*i, *o));
    let height = depth.len() / width;
    let inner = (2..height - 2).flat_map(|y| (2..width - 2).map(move |x| y * width + x));
    inner.filter(is_edge).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offset_between_two_steps_is_the_top_of_the_parabola() {
        for expected_s in [0.0015, -0.0015, 0.0213, -0.0338] {
            let score = |n| 1.0 - (offset_s(n) - expected_s).powi(2);
            let scores: Vec<f64> = (0..=2 * STEPS_PER_SIDE as usize).map(score).collect();
            let offset = DepthClock { scores: vec![scores; MIN_FRAMES] }.finish().unwrap();
            assert!((offset.offset_s - expected_s).abs() < 1e-6, "{} s, not {expected_s} s", offset.offset_s);
            // All frames agree, so only the systematic uncertainty remains.
            assert!((offset.sigma_s - SYSTEMATIC_SIGMA_S).abs() < 1e-6, "{} s", offset.sigma_s);
        }
    }
}
