//! Exposure time of the frames, by the difference of their motion blur from that of other frames.
//!
//! Frames spread over the recording are each compared with up to three others within 20 frames,
//! which show nearly the same view and whose motion differs most
//! ([`cross_blur`](super::cross_blur)). The mean of the curves, weighted by their patches and by
//! the squared difference of the flows, has its minimum at the exposure. The recording's exposure
//! is the median over the frames with a distinct minimum, unless a run of frames differs by more
//! than a fifth. There is no estimate if too few frames have one: with a camera at rest, or one
//! that moves evenly.
//!
//! The estimate is the exposure that explains the blur by the known motion. If frames are far apart
//! without poses between them, that motion is a mean over two intervals and too slow, and the
//! exposure comes out too long. Rendered blur still matches, because the two errors cancel. Without
//! timestamps the exposure is a fraction of the nominal interval.
//!
//! Not modelled: exposures that differ between the two frames of a pair. Frames are preferably
//! compared with slower ones, whose blur has little effect, so the estimate is mostly the frame's
//! own exposure.

use std::collections::BTreeMap;

use glam::{DMat2, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::blur_frame::{BlurFrame, halvings};
use super::box_blur::ExposureGrid;
use super::camera_model::CameraModel;
use super::cross_blur::{BlurCurve, compare};
use super::state::CameraState;
use super::warp_mesh::flow;
use crate::camera::{NoiseProfile, Response};
use crate::fit::quantile::{SIGMA_PER_MAD, median_and_sigma, upper_median, upper_median_in_place};
use crate::fit::twist::Twist;
use crate::frame::Frame;
use crate::parallel::over_rows;

/// Number of compared frames: the recording's by this, within these limits.
const FRAMES_PER_SAMPLE: usize = 8;
const MIN_SAMPLES: usize = 12;
const MAX_SAMPLES: usize = 200;
/// Largest number of frames that a frame is compared with, their distances in frames, and the
/// largest displacement of the view between the two, mean over five points by the picture's width.
const MAX_PARTNERS: usize = 3;
const PARTNER_GAPS: [usize; 8] = [1, 2, 3, 5, 7, 10, 14, 20];
const MAX_VIEW_SHIFT: f64 = 0.25;
/// Smallest difference of the flows, px/s, at this focal length.
const MIN_FLOW_DIFFERENCE_PX_S: f64 = 250.0;
const REFERENCE_FOCAL_PX: f64 = 520.0;
/// Weight of a faster partner, because its own blur dominates the comparison.
const FASTER_PARTNER_WEIGHT: f64 = 0.7;
/// Grid of exposures: number, and the longest by the usual frame interval and at most, s.
const EXPOSURE_COUNT: usize = 36;
const MAX_EXPOSURE_BY_INTERVAL: f64 = 1.05;
const MAX_EXPOSURE_S: f64 = 0.05;
/// Smallest height of a curve's ends over its minimum, by the minimum.
const MIN_CLARITY: f64 = 0.3;
/// Smallest number of frames with a distinct minimum.
const MIN_CLEAR_SAMPLES: usize = 4;
/// Smallest relative difference between runs, and smallest number of samples in a run.
const MIN_RUN_STEP: f64 = 0.2;
const MIN_RUN_SAMPLES: usize = 3;
const SIGNIFICANT_SIGMAS: f64 = 3.0;
/// Shortest exposure of a run, s: the systematic error.
const MIN_EXPOSURE_S: f64 = SYSTEMATIC_SIGMA_S;
/// Cost of one more run, in frames that deviate by the samples' scatter (at least a tenth).
const FRAMES_PER_RUN: f64 = 3.0;
const MIN_SCATTER_LN: f64 = 0.1;
/// σ of a median by that of one value.
const MEDIAN_SIGMA: f64 = 1.2533;
/// Systematic error of all frames: relative, and s. Simulated recordings from 5 to 30 ms come out
/// within 1.8 %.
const SYSTEMATIC_SHARE: f64 = 0.01;
const SYSTEMATIC_SIGMA_S: f64 = 1e-4;

/// The estimate of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExposureSample {
    pub frame: usize,
    pub exposure_s: f64,
    /// Rise of the curve from its minimum to the lower end, by the minimum.
    pub clarity: f64,
}

/// Consecutive frames of one exposure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureRun {
    /// The first frame, and the one after the last.
    pub from: usize,
    pub to: usize,
    pub exposure_s: f64,
    pub sigma_s: f64,
    /// Number of samples.
    #[serde(alias = "heard")]
    pub samples: usize,
}

/// Exposures of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureRuns {
    /// Runs of frames in order; each frame is in one.
    pub runs: Vec<ExposureRun>,
    /// Samples with a distinct minimum, in order.
    pub samples: Vec<ExposureSample>,
}

/// Samples, and the number of frames that were compared.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShutterEvidence {
    samples: Vec<ExposureSample>,
    compared: usize,
}

/// Compares frames, which are added in order.
pub struct ShutterEstimator<'a> {
    model: &'a CameraModel,
    response: &'a Response,
    noise: Option<&'a NoiseProfile>,
    grid: ExposureGrid,
    threads: usize,
    /// Acceleration of the camera at each frame, m/s² and rad/s².
    accelerations: Vec<Twist>,
    /// Frames, each with its partners.
    plan: Vec<(usize, Vec<usize>)>,
    frames: BTreeMap<usize, BlurFrame>,
    evidence: ShutterEvidence,
}

impl<'a> ShutterEstimator<'a> {
    /// `states`, `timestamps_s`: one per frame; `interval_s`: the usual one.
    pub fn new(
        model: &'a CameraModel,
        response: &'a Response,
        noise: Option<&'a NoiseProfile>,
        states: &[Option<CameraState>],
        timestamps_s: &[f64],
        interval_s: f64,
        threads: usize,
    ) -> Self {
        let longest_s = (MAX_EXPOSURE_BY_INTERVAL * interval_s).min(MAX_EXPOSURE_S);
        let grid = ExposureGrid { step_s: longest_s / (EXPOSURE_COUNT - 1) as f64, count: EXPOSURE_COUNT };
        let plan = plan(model, states);
        let accelerations = accelerations(states, timestamps_s, 2.5 * interval_s);
        let (frames, evidence) = (BTreeMap::new(), ShutterEvidence::default());
        Self { model, response, noise, grid, threads, accelerations, plan, frames, evidence }
    }

    /// True if a frame is part of a comparison that is still to be made.
    pub fn needs(&self, frame: usize) -> bool {
        self.plan.iter().any(|(own, others)| *own == frame || others.contains(&frame))
    }

    /// Adds a frame; in order. `depth`: at the frame's time and pixels.
    pub fn add(&mut self, frame: &Frame, state: CameraState, depth: &[f32]) {
        let index = frame.index;
        if !self.needs(index) {
            return;
        }
        let motion = (state, self.accelerations[index]);
        let new = BlurFrame::new(self.model, frame, motion, depth.to_vec(), self.response, self.noise);
        self.frames.insert(index, new);
        let last = |(own, others): &(usize, Vec<usize>)| others.iter().copied().max().unwrap_or(0).max(*own);
        let (ready, rest): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.plan).into_iter().partition(|job| last(job) <= index);
        self.plan = rest;
        self.evidence.compared += ready.len();
        for (own, others) in ready {
            let mut curves: Vec<(usize, Option<BlurCurve>)> = others.into_iter().map(|other| (other, None)).collect();
            let (frames, model, grid) = (&self.frames, self.model, self.grid);
            over_rows(&mut curves, 1, self.threads, |_, slot| {
                let (other, curve) = &mut slot[0];
                if let (Some(i), Some(j)) = (frames.get(other), frames.get(&own)) {
                    *curve = compare(model, i, j, grid);
                }
            });
            let min_px_s = min_flow_difference_px_s(self.model);
            let curves: Vec<BlurCurve> = curves
                .into_iter()
                .filter_map(|(_, curve)| curve)
                .filter(|curve| curve.flow_difference_px_s > min_px_s)
                .collect();
            self.evidence.samples.extend(minimum(&curves, grid).map(|(exposure_s, clarity)| ExposureSample {
                frame: own,
                exposure_s,
                clarity,
            }));
        }
        let needed = |frame: usize| self.plan.iter().any(|(own, others)| *own == frame || others.contains(&frame));
        let gone: Vec<usize> = self.frames.keys().copied().filter(|frame| !needed(*frame)).collect();
        gone.iter().for_each(|frame| drop(self.frames.remove(frame)));
    }

    pub fn evidence(self) -> ShutterEvidence {
        self.evidence
    }
}

impl ShutterEvidence {
    /// The recording's runs of one exposure, or why there are none.
    pub fn exposure_runs(self, frames: usize) -> Result<ExposureRuns, String> {
        if self.compared == 0 {
            return Err("the camera's motion is too even: blur does not differ between frames".to_owned());
        }
        let mut clear: Vec<ExposureSample> =
            self.samples.iter().copied().filter(|sample| sample.clarity > MIN_CLARITY).collect();
        // A frame whose partners are later frames is compared after its neighbours.
        clear.sort_by_key(|sample| sample.frame);
        if clear.len() < MIN_CLEAR_SAMPLES {
            return Err(format!(
                "{} of {} examined frames determine it clearly; {MIN_CLEAR_SAMPLES} are needed",
                clear.len(),
                self.compared
            ));
        }
        Ok(ExposureRuns { runs: runs(&clear, frames), samples: clear })
    }
}

/// Smallest difference of the flows, px/s of the reduced pictures.
fn min_flow_difference_px_s(model: &CameraModel) -> f64 {
    let scale = f64::from(1u32 << halvings(model));
    MIN_FLOW_DIFFERENCE_PX_S * model.geometry.intrinsics.fx_px / REFERENCE_FOCAL_PX / scale
}

/// Minimum of the mean curve, by a parabola through its lowest value and the two beside it, and its
/// clarity. `None` without curves, and where the minimum is at the longest exposure of the grid.
fn minimum(curves: &[BlurCurve], grid: ExposureGrid) -> Option<(f64, f64)> {
    let weight = |curve: &BlurCurve| curve.patches as f64 * curve.flow_difference_px_s.powi(2);
    let whole: f64 = curves.iter().map(weight).sum();
    if curves.is_empty() {
        return None;
    }
    let mean = |s: usize| curves.iter().map(|curve| weight(curve) * curve.values[s]).sum::<f64>() / whole;
    let values: Vec<f64> = (0..grid.count).map(mean).collect();
    let k = (0..grid.count).min_by(|a, b| values[*a].total_cmp(&values[*b]))?;
    if k + 1 == grid.count {
        return None;
    }
    let offset = match k.checked_sub(1).map(|before| values[before]) {
        Some(before) => {
            let (here, after) = (values[k], values[k + 1]);
            let bend = before - 2.0 * here + after;
            if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 }
        }
        None => 0.0,
    };
    // Subtracted noise can make values negative.
    let clarity = (values[0].min(values[grid.count - 1]) - values[k]) / values[k].max(1e-4);
    Some(((k as f64 + offset) * grid.step_s, clarity))
}

/// Frames whose partners move differently, spread over the recording: in each of its parts the
/// frame with the largest difference.
fn plan(model: &CameraModel, states: &[Option<CameraState>]) -> Vec<(usize, Vec<usize>)> {
    let frames = states.len();
    let flow_moments: Vec<Option<DMat2>> =
        states.iter().map(|state| state.map(|state| flow_moment(model, &state))).collect();
    let scale = f64::from(1u32 << halvings(model));
    let min_px_s = min_flow_difference_px_s(model) * scale;
    let partners = |own: usize| -> Option<(f64, Vec<usize>)> {
        let here = flow_moments[own]?;
        let mut estimates: Vec<(f64, usize)> = Vec::new();
        for other in PARTNER_GAPS.iter().flat_map(|gap| [own.checked_sub(*gap), Some(own + gap)]).flatten() {
            let Some(there) = flow_moments.get(other).copied().flatten() else { continue };
            let (Some(a), Some(b)) = (states[own], states[other]) else { continue };
            if !is_same_view(model, &a, &b) {
                continue;
            }
            let difference = here - there;
            let difference_px_s = norm(&difference).sqrt();
            let is_slower = difference.x_axis.x + difference.y_axis.y > 0.0;
            if difference_px_s > min_px_s {
                let weight = if is_slower { 1.0 } else { FASTER_PARTNER_WEIGHT };
                estimates.push((weight * difference_px_s, other));
            }
        }
        estimates.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        estimates.truncate(MAX_PARTNERS);
        let score = estimates.first()?.0;
        Some((score, estimates.into_iter().map(|(_, other)| other).collect()))
    };
    let parts = (frames / FRAMES_PER_SAMPLE).clamp(MIN_SAMPLES, MAX_SAMPLES).min(frames);
    let best_of = |part: usize| {
        let (from, to) = (part * frames / parts, (part + 1) * frames / parts);
        let all = (from..to).filter_map(|own| Some((own, partners(own)?)));
        let best = all.max_by(|a, b| a.1.0.total_cmp(&b.1.0).then(b.0.cmp(&a.0)))?;
        Some((best.0, best.1.1))
    };
    (0..parts).filter_map(best_of).collect()
}

/// Accelerations by the motions of the previous and the next frame; 0 where one is missing, or
/// where they are `max_interval_s` or more apart.
fn accelerations(states: &[Option<CameraState>], timestamps_s: &[f64], max_interval_s: f64) -> Vec<Twist> {
    let acceleration = |n: usize| -> Option<Twist> {
        let (before, after) = (n.checked_sub(1)?, n + 1);
        let (a, b) = (states[before]?, (*states.get(after)?)?);
        let between_s = timestamps_s[after] - timestamps_s[before];
        (between_s > 0.0 && between_s < max_interval_s).then(|| (b.twist - a.twist) / between_s)
    };
    (0..states.len()).map(|n| acceleration(n).unwrap_or_else(Twist::zeros)).collect()
}

/// Frobenius norm.
fn norm(m: &DMat2) -> f64 {
    m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Five directions in the picture, as tangents.
const TEST_DIRECTIONS: [(f64, f64); 5] = [(0.0, 0.0), (0.27, 0.2), (-0.27, 0.2), (0.27, -0.2), (-0.27, -0.2)];

/// Points at typical depth in these directions, in the camera's axes, m.
fn test_points(model: &CameraModel) -> [DVec3; 5] {
    TEST_DIRECTIONS.map(|(x, y)| model.typical_depth_m * DVec3::new(x, y, 1.0))
}

/// Second moment of the flow: mean of v·vᵀ over the test points, (px/s)².
fn flow_moment(model: &CameraModel, state: &CameraState) -> DMat2 {
    let mut sum = DMat2::ZERO;
    for v in test_points(model).into_iter().filter_map(|point| flow(model, point, state)) {
        let v: DVec2 = v;
        sum += DMat2::from_cols(v * v.x, v * v.y) * (1.0 / TEST_DIRECTIONS.len() as f64);
    }
    sum
}

/// True if two frames show nearly the same view.
fn is_same_view(model: &CameraModel, a: &CameraState, b: &CameraState) -> bool {
    let b_from_a = b.world_from_camera.inverse() * a.world_from_camera;
    let moved = test_points(model).map(|point| {
        let (from, to) = (model.geometry.project(point), model.geometry.project(b_from_a.transform_point3(point)));
        from.zip(to).map_or(f64::INFINITY, |(from, to)| from.distance(to))
    });
    moved.iter().sum::<f64>() / (moved.len() as f64) < MAX_VIEW_SHIFT * model.size().0 as f64
}

/// Segments the samples into runs of one exposure: minimum of Σ|ln s − median| plus a cost per run,
/// with at least [`MIN_RUN_SAMPLES`] each. Neighbouring runs that differ by less than a fifth, or
/// by less than 3 σ, are merged.
fn runs(clear: &[ExposureSample], frames: usize) -> Vec<ExposureRun> {
    let mut ends = segment_ends(clear);
    let part = |ends: &[usize], n: usize| &clear[if n == 0 { 0 } else { ends[n - 1] }..ends[n]];
    let scatter = successive_scatter(clear);
    let is_same = |a: &[ExposureSample], b: &[ExposureSample]| {
        let step = (median_exposure(a).0 / median_exposure(b).0).ln().abs();
        let sigma = MEDIAN_SIGMA * scatter * (1.0 / a.len() as f64 + 1.0 / b.len() as f64).sqrt();
        step < MIN_RUN_STEP.ln_1p().max(SIGNIFICANT_SIGMAS * sigma)
    };
    while let Some(n) = (1..ends.len()).find(|n| is_same(part(&ends, n - 1), part(&ends, *n))) {
        ends.remove(n - 1);
    }
    let border = |n: usize| (clear[ends[n] - 1].frame + clear[ends[n]].frame).div_ceil(2);
    let run = |n: usize| {
        let part = part(&ends, n);
        let (exposure_s, spread_s) = median_exposure(part);
        ExposureRun {
            from: if n == 0 { 0 } else { border(n - 1) },
            to: if n + 1 == ends.len() { frames } else { border(n) },
            exposure_s: exposure_s.max(MIN_EXPOSURE_S),
            sigma_s: (MEDIAN_SIGMA * spread_s / (part.len() as f64).sqrt())
                .hypot(SYSTEMATIC_SHARE * exposure_s)
                .hypot(SYSTEMATIC_SIGMA_S),
            samples: part.len(),
        }
    };
    (0..ends.len()).map(run).collect()
}

/// Ends of the segments, by dynamic programming.
fn segment_ends(clear: &[ExposureSample]) -> Vec<usize> {
    let cost = |from: usize, to: usize| {
        let mut values: Vec<f64> = clear[from..to].iter().map(|sample| sample.exposure_s.max(1e-6).ln()).collect();
        let middle = upper_median_in_place(&mut values).unwrap_or(0.0);
        values.iter().map(|value| (value - middle).abs()).sum::<f64>()
    };
    let run_cost = FRAMES_PER_RUN * successive_scatter(clear).max(MIN_SCATTER_LN);
    // For the first n samples: the least cost, and the begin of the last segment.
    let mut best = vec![(f64::INFINITY, 0); clear.len() + 1];
    best[0] = (0.0, 0);
    for to in MIN_RUN_SAMPLES..=clear.len() {
        for from in 0..=to - MIN_RUN_SAMPLES {
            let whole = best[from].0 + run_cost + cost(from, to);
            if whole < best[to].0 {
                best[to] = (whole, from);
            }
        }
    }
    let mut ends = vec![clear.len()];
    while let Some(from) = ends.last().map(|end| best[*end].1).filter(|from| *from > 0) {
        ends.push(from);
    }
    ends.reverse();
    ends
}

/// One standard deviation of ln s, by 1.4826·median |difference|/√2 of successive frames: few steps
/// between runs do not move it.
fn successive_scatter(clear: &[ExposureSample]) -> f64 {
    let ln = |sample: &ExposureSample| sample.exposure_s.max(1e-6).ln();
    let steps = clear.windows(2).map(|pair| (ln(&pair[1]) - ln(&pair[0])).abs());
    SIGMA_PER_MAD * upper_median(steps).unwrap_or(0.0) / 2f64.sqrt()
}

/// The median, and one standard deviation by 1.4826·MAD, s.
fn median_exposure(part: &[ExposureSample]) -> (f64, f64) {
    median_and_sigma(part.iter().map(|sample| sample.exposure_s))
}

#[cfg(test)]
mod tests;
