//! Point spread of the camera, from straight edges in the footage.
//!
//! The model of `calibrate sharpness` (measure/spread.rs) is fitted to the pixels around a
//! straight, isolated edge (edges.rs): a step between two slopes, blurred by the pixel's square, by
//! the edge's displacement during the exposure, and by a Gaussian, whose variance is estimated. In
//! linear green light: green is the sharpest channel behind most colour filter arrays.
//!
//! Rounded, soft or defocused edges are softer than the camera's point spread, and none is sharper.
//! Therefore the estimate is the 30th percentile of σ² over all edges. Its interval are the order
//! statistics that contain it with a probability of two thirds.
//!
//! Not modelled: point spreads that are not Gaussian or vary over the picture, sharpening in the
//! camera, a response that differs from the profile's.

use glam::DVec3;

use super::camera_model::CameraModel;
use super::edges::{ACROSS, ALONG, EdgeLine, edges};
use super::state::{CameraState, move_point};
use crate::camera::Response;
use crate::fit::twist;
use crate::frame::Frame;
use crate::grey_image::GreyImage;
use crate::measure::spread::{EdgeSample, EdgeStep, fit};
use crate::parallel::over_rows;
use crate::pixels::Pixels;

/// Green.
const CHANNEL: usize = 1;
/// Largest number of frames, and number of the recording's frames per measured one.
const MAX_FRAMES: usize = 24;
const FRAME_STRIDE: usize = 3;
/// Largest number of edges in a frame.
const MAX_EDGES_PER_FRAME: usize = 80;
/// Smallest number of edges for an estimate.
pub const MIN_EDGES: usize = 40;
/// A smaller σ² is taken for 0, px².
const MIN_VARIANCE_PX2: f64 = 1e-6;
/// Quantile of σ² that is taken for the camera's.
const QUANTILE: f64 = 0.3;
/// Smallest code of 255 at which a channel may be clipped.
const CLIPPED_CODE: f32 = 248.0;
/// Largest displacement of an edge along its normal during the exposure, px.
const MAX_EDGE_MOTION_PX: f64 = 0.7;
/// Assumed distance of frames without depth, units of the recording, and largest displacement at it
/// during the exposure, px.
const ASSUMED_DISTANCE: f64 = 1.0;
const MAX_STILL_MOTION_PX: f64 = 0.3;
/// Radius around an edge in which its depth is the smallest one, px: an occluding edge moves with
/// the nearer surface.
const DEPTH_RADIUS_PX: usize = 3;
/// Distance of an edge's plateaus from it, px; smallest difference of their light; largest standard
/// deviation of each by that.
const PLATEAU_PX: f64 = 3.5;
const MIN_STEP: f64 = 0.05;
const MAX_PLATEAU_SIGMA: f64 = 0.12;
/// Largest root mean square residual of the fit by the step.
const MAX_RESIDUAL: f64 = 0.1;
/// Largest σ of a camera's point spread, px.
const MAX_SIGMA_PX: f64 = 4.0;
/// Initial variance of a fit, px², and its tolerance.
const INITIAL_VARIANCE_PX2: f64 = 0.5;
const FIT_TOLERANCE: f64 = 1e-3;

/// Histogram of the edges by σ: width of a bin, px, and number of bins.
pub const EDGE_BIN_PX: f64 = 0.05;
const EDGE_BINS: usize = 40;

/// The camera's point spread.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSpreadEstimate {
    /// Standard deviation of the Gaussian, px.
    pub sigma_px: f64,
    /// Interval of σ with a confidence of two thirds.
    pub between_px: [f64; 2],
    /// Number of edges.
    pub edges: usize,
    /// Histogram of the edges by σ, with bins of [`EDGE_BIN_PX`]; the last one includes all wider
    /// edges.
    pub by_px: Vec<u32>,
}

/// Measures the edges of frames.
pub struct EdgeSpreads<'a> {
    model: &'a CameraModel,
    /// Linear light by code.
    light: Vec<f64>,
    threads: usize,
    /// σ² of each, px².
    pub variances: Vec<f64>,
}

/// Motion of the camera during a frame's exposure.
pub struct FrameMotion<'a> {
    pub state: &'a CameraState,
    /// Depth at the frame's time, m or the recording's unit; 0 where unknown.
    pub depth: &'a [f32],
    pub exposure_s: f64,
}

impl FrameMotion<'_> {
    /// True if points beyond [`ASSUMED_DISTANCE`] move by at most [`MAX_STILL_MOTION_PX`].
    fn is_still(&self, model: &CameraModel) -> bool {
        let speed = twist::rotation_vector(&self.state.twist).length()
            + twist::translation(&self.state.twist).length() / ASSUMED_DISTANCE;
        let focal_px = model.geometry.intrinsics.fx_px.max(model.geometry.intrinsics.fy_px);
        focal_px * speed * self.exposure_s <= MAX_STILL_MOTION_PX
    }
}

impl<'a> EdgeSpreads<'a> {
    pub fn new(model: &'a CameraModel, response: &Response, max_code: u32, threads: usize) -> Self {
        Self { model, light: response.table(max_code), threads, variances: Vec::new() }
    }

    /// Measures the edges of a frame. Frames without depth are ignored unless the camera hardly
    /// moved.
    pub fn add(&mut self, frame: &Frame, motion: &FrameMotion<'_>) {
        let has_no_depth = motion.depth.iter().all(|z| *z == 0.0);
        if has_no_depth && !motion.is_still(self.model) {
            return;
        }
        let light = self.linear(&frame.pixels);
        let moved_px = |x: usize, y: usize, n: [f32; 2]| {
            if has_no_depth { Some(0.0) } else { self.moved_px(motion, x, y, n) }
        };
        let is_slow = |x: usize, y: usize, n: [f32; 2]| moved_px(x, y, n).is_some_and(|px| px <= MAX_EDGE_MOTION_PX);
        let lines = edges(&light, &clipped(&frame.pixels), MAX_EDGES_PER_FRAME, is_slow);
        let mut measured: Vec<(EdgeLine, Option<f64>)> = lines.into_iter().map(|line| (line, None)).collect();
        over_rows(&mut measured, 1, self.threads, |_, slot| {
            let (line, variance) = &mut slot[0];
            let (sin, cos) = line.angle.sin_cos();
            *variance = moved_px(line.x, line.y, [cos, sin]).and_then(|px| variance_px2(&light, line, px));
        });
        self.variances.extend(measured.into_iter().filter_map(|(_, variance)| variance));
    }

    /// The point spread, or the reason for which it is unknown.
    pub fn finish(mut self) -> Result<PointSpreadEstimate, String> {
        let edges = self.variances.len();
        if edges < MIN_EDGES {
            return Err(format!("{edges} straight edges that stand alone and hardly move; {MIN_EDGES} are needed"));
        }
        self.variances.sort_by(f64::total_cmp);
        // The rank of the quantile p among n edges is np, with a standard deviation of √(np(1 −
        // p)).
        let (n, p) = (edges as f64, QUANTILE);
        let at = |by: f64| {
            let place = (n * p + by * (n * p * (1.0 - p)).sqrt() - 0.5).clamp(0.0, n - 1.0);
            let (low, share) = (place.floor() as usize, place.fract());
            let high = (low + 1).min(edges - 1);
            let variance = self.variances[low] + share * (self.variances[high] - self.variances[low]);
            if variance < MIN_VARIANCE_PX2 { 0.0 } else { variance.sqrt() }
        };
        let mut by_px = vec![0; EDGE_BINS];
        for variance in &self.variances {
            by_px[((variance.max(0.0).sqrt() / EDGE_BIN_PX) as usize).min(EDGE_BINS - 1)] += 1;
        }
        Ok(PointSpreadEstimate { sigma_px: at(0.0), between_px: [at(-1.0), at(1.0)], edges, by_px })
    }

    fn linear(&self, pixels: &Pixels) -> GreyImage {
        let values = pixels.each(|c| self.light[c[CHANNEL] as usize] as f32);
        GreyImage { width: pixels.width as usize, height: pixels.height as usize, values }
    }

    /// Displacement of an edge along its normal during the exposure of its row, px. `None` where
    /// depth is unknown.
    fn moved_px(&self, motion: &FrameMotion<'_>, x: usize, y: usize, normal: [f32; 2]) -> Option<f64> {
        let width = self.model.size().0;
        let rows = motion.depth.chunks(width).skip(y.saturating_sub(DEPTH_RADIUS_PX)).take(2 * DEPTH_RADIUS_PX + 1);
        let near = rows.flat_map(|row| &row[x.saturating_sub(DEPTH_RADIUS_PX)..(x + DEPTH_RADIUS_PX + 1).min(width)]);
        let nearest = near.copied().filter(|z| *z > 0.0).fold(f32::MAX, f32::min);
        if nearest == f32::MAX {
            return None;
        }
        let at = f64::from(nearest) * DVec3::from(self.model.rays[y * width + x].map(f64::from));
        let projected = |time_s: f64| self.model.geometry.project(move_point(at, &motion.state.twist, -time_s));
        let way = projected(0.5 * motion.exposure_s)? - projected(-0.5 * motion.exposure_s)?;
        Some((way.x * f64::from(normal[0]) + way.y * f64::from(normal[1])).abs())
    }
}

/// Mask of the pixels in which a channel may be clipped.
fn clipped(pixels: &Pixels) -> Vec<bool> {
    let clip_code = CLIPPED_CODE / 255.0 * pixels.max_code() as f32;
    pixels.each(|c| c.into_iter().any(|code| code as f32 >= clip_code))
}

/// Variance of the Gaussian that blurred an edge, px²; negative for an edge sharper than the
/// pixels' own blur. `None` if it is no clean step.
fn variance_px2(light: &GreyImage, line: &EdgeLine, moved_px: f64) -> Option<f64> {
    let step = EdgeStep {
        offset_px: line.offset_px.into(),
        angle: line.angle.into(),
        variance_px2: INITIAL_VARIANCE_PX2,
        moved_px,
    };
    let reach = ALONG.hypot(ACROSS).ceil() as usize;
    let mut samples = Vec::new();
    let mut plateaus = [(0.0, 0.0, 0.0); 2];
    for y in line.y.checked_sub(reach)?..(line.y + reach + 1).min(light.height) {
        for x in line.x.checked_sub(reach)?..(line.x + reach + 1).min(light.width) {
            let (dx, dy) = (x as f64 - line.x as f64, y as f64 - line.y as f64);
            let (d, t) = step.place(dx, dy);
            if d.abs() > ACROSS.into() || t.abs() > ALONG.into() {
                continue;
            }
            let light = f64::from(light.values[y * light.width + x]);
            samples.push(EdgeSample { x: dx, y: dy, light, weight: 1.0 });
            if d.abs() > PLATEAU_PX {
                let side = &mut plateaus[usize::from(d > 0.0)];
                *side = (side.0 + 1.0, side.1 + light, side.2 + light * light);
            }
        }
    }
    let [dark, bright] = plateaus.map(|(n, sum, _)| sum / f64::max(n, 1.0));
    let height = bright - dark;
    let uneven = plateaus.map(|(n, sum, squares)| (squares / n - (sum / n).powi(2)).max(0.0).sqrt());
    if !(height >= MIN_STEP && uneven.iter().all(|u| *u <= MAX_PLATEAU_SIGMA * height)) {
        return None;
    }
    let profile = fit(&samples, step, FIT_TOLERANCE)?;
    let off = (profile.left / samples.len() as f64).sqrt();
    let variance = profile.step.variance_px2;
    (off <= MAX_RESIDUAL * height && variance <= MAX_SIGMA_PX * MAX_SIGMA_PX).then_some(variance)
}

/// Number of frames from which the point spread of a recording is measured.
pub fn measured_frames(frame_count: usize) -> usize {
    frame_count.div_ceil(FRAME_STRIDE).min(MAX_FRAMES)
}

/// The frame with the least camera motion in each of `count` parts of the recording.
pub fn stillest_frames(states: &[Option<CameraState>], count: usize) -> Vec<usize> {
    // A rotation of 1 rad/s moves the picture like a translation of 1 m/s at a distance of 1 m.
    let fast = |n: &usize| states[*n].map_or(f64::INFINITY, |state| state.twist.norm());
    let part = |k: usize| k * states.len() / count..(k + 1) * states.len() / count;
    let stillest = |k: usize| part(k).filter(|n| states[*n].is_some()).min_by(|a, b| fast(a).total_cmp(&fast(b)));
    (0..count).filter_map(stillest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics};
    use crate::effects::point_spread::{sigma_for_measured_px, twin};
    use crate::fit::twist::Twist;
    use crate::measure::spread::CONVERGENCE;

    /// Light of an edge through the middle, dark 0.1 and bright 0.5, with a slope.
    fn drawn(side: usize, angle_deg: f64, sigma_px: f64, moved_px: f64) -> GreyImage {
        let edge =
            EdgeStep { offset_px: 0.3, angle: angle_deg.to_radians(), variance_px2: sigma_px * sigma_px, moved_px };
        let middle = (side / 2) as f64;
        let light = |i: usize| {
            let (d, t) = edge.place((i % side) as f64 - middle, (i / side) as f64 - middle);
            (0.1 + 0.4 * edge.share(d) + 0.001 * t) as f32
        };
        GreyImage { width: side, height: side, values: (0..side * side).map(light).collect() }
    }

    #[test]
    fn detected_edge_has_the_true_place_direction_and_sigma() {
        for (angle, sigma, moved) in [(7.0, 0.4, 0.0), (-100.0, 0.8, 0.5), (50.0, 1.3, 0.0)] {
            let light = drawn(61, angle, sigma, moved);
            let lines = edges(&light, &vec![false; 61 * 61], 20, |_, _, _| true);
            assert!(lines.len() >= 2, "{lines:?}");
            for line in &lines {
                let off = (f64::from(line.angle).to_degrees() - angle).rem_euclid(360.0);
                assert!(off.min(360.0 - off) < 0.5, "{line:?}");
                let variance = variance_px2(&light, line, moved).unwrap();
                assert!((variance.sqrt() - sigma).abs() < 0.02, "{angle}° {sigma} px: {}", variance.sqrt());
            }
            // No edges in clipped areas, and none that the predicate rejects.
            assert!(edges(&light, &vec![true; 61 * 61], 20, |_, _, _| true).is_empty());
            assert!(edges(&light, &vec![false; 61 * 61], 20, |_, _, _| false).is_empty());
        }
        // Unknown motion makes the edge softer: σ² + 0.6²/12.
        let light = drawn(61, 20.0, 0.5, 0.6);
        let line = edges(&light, &vec![false; 61 * 61], 1, |_, _, _| true)[0];
        assert!((variance_px2(&light, &line, 0.0).unwrap() - 0.28).abs() < 0.01);
    }

    #[test]
    fn corners_and_stripes_are_not_measured() {
        let side = 61;
        let corner = |i: usize| if i % side > 30 && i / side > 30 { 0.5 } else { 0.1 };
        let stripes = |i: usize| if ((i % side) / 4).is_multiple_of(2) { 0.5 } else { 0.1 };
        let picture = |of: &dyn Fn(usize) -> f32| GreyImage {
            width: side,
            height: side,
            values: (0..side * side).map(of).collect(),
        };
        let measured = |light: &GreyImage| {
            let lines = edges(light, &vec![false; side * side], 50, |_, _, _| true);
            lines.into_iter().filter_map(|line| variance_px2(light, &line, 0.0).map(|v| (line, v))).collect::<Vec<_>>()
        };
        let near_the_corner = measured(&picture(&corner));
        assert!(near_the_corner.iter().all(|(line, _)| line.x.max(line.y) > 36), "{near_the_corner:?}");
        assert!(measured(&picture(&stripes)).is_empty());
    }

    fn of(variances: Vec<f64>) -> Result<PointSpreadEstimate, String> {
        let model = CameraModel {
            geometry: Geometry::new(Intrinsics::default(), Distortion::default()),
            rays: Vec::new(),
            inverse_depth_tolerance: 0.0,
            typical_depth_m: 1.0,
        };
        let mut spreads = EdgeSpreads::new(&model, &Response::default(), 255, 1);
        spreads.variances = variances;
        spreads.finish()
    }

    #[test]
    fn estimate_is_the_30th_percentile_and_needs_40_edges() {
        // 1, 2, … 100 hundredths: np = 30 lies between the 30th and the 31st; √(100·0.3·0.7) =
        // 4.583 to either side.
        let spread = of((1..=100).rev().map(|n| 0.01 * f64::from(n)).collect()).unwrap();
        assert!((spread.sigma_px.powi(2) - 0.305).abs() < 1e-9 && spread.edges == 100, "{spread:?}");
        let [low, high] = spread.between_px.map(|px| px * px);
        assert!((low - 0.25917).abs() < 1e-4 && (high - 0.35083).abs() < 1e-4, "{spread:?}");
        assert_eq!(of(vec![0.2; 39]).unwrap_err(), "39 straight edges that stand alone and hardly move; 40 are needed");
    }

    #[test]
    fn stillest_frame_of_each_part_is_chosen() {
        let state = |speed: f64| {
            Some(CameraState { world_from_camera: glam::DAffine3::IDENTITY, twist: Twist::from_element(speed) })
        };
        let states = [Some(3.0), None, Some(5.0), Some(2.0), Some(4.0), Some(0.1), None].map(|s| s.and_then(state));
        assert_eq!(stillest_frames(&states, measured_frames(states.len())), [0, 3, 5]);
        assert!(stillest_frames(&[], 0).is_empty() && stillest_frames(&[None], 2).is_empty());
    }

    /// Measured σ of an edge that is rendered by coverage and then blurred.
    fn measured_px(sigma_px: f64, angle_deg: f64) -> f64 {
        const SIDE: usize = 33;
        let edge = EdgeStep { offset_px: 0.2, angle: angle_deg.to_radians(), variance_px2: 0.0, moved_px: 0.0 };
        let place = |i: usize| ((i % SIDE) as f64 - 16.0, (i / SIDE) as f64 - 16.0);
        let drawn: Vec<[f64; 4]> =
            (0..SIDE * SIDE).map(|i| [edge.share(edge.place(place(i).0, place(i).1).0); 4]).collect();
        let blurred = twin(&drawn, SIDE, SIDE, sigma_px);
        let sample = |i: usize| {
            let (x, y) = place(i);
            let is_near = x.abs() < 12.0 && y.abs() < 12.0 && edge.place(x, y).0.abs() < 6.0;
            is_near.then_some(EdgeSample { x, y, light: blurred[i][0], weight: 1.0 })
        };
        let samples: Vec<EdgeSample> = (0..SIDE * SIDE).filter_map(sample).collect();
        fit(&samples, EdgeStep { variance_px2: 0.3, ..edge }, CONVERGENCE).unwrap().step.variance_px2.sqrt()
    }

    #[test]
    fn rendered_edge_with_compensated_sigma_measures_as_intended() {
        for expected in [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.3, 2.0] {
            let set = sigma_for_measured_px(expected);
            let all = [5.0, 12.0, 20.0, 30.0, 40.0].map(|angle| measured_px(set, angle));
            let mean = all.iter().sum::<f64>() / 5.0;
            assert!((mean - expected).abs() < 0.01, "{expected} px: {set} px measures {all:?}");
        }
        assert_eq!((sigma_for_measured_px(0.0), sigma_for_measured_px(20.0)), (0.0, 8.0));
    }
}
