//! How sharp the camera is: the point spread from edges that happen to be in the footage.
//!
//! To the pixels about a straight, isolated edge (edges.rs) goes the fit of `calibrate sharpness` (measure/spread.rs): a step
//! with two slopes, blurred by the pixel's own square, by the way that the edge moved while the shutter was open, and by a
//! Gaussian, whose variance is asked for. In linear green light: it is the sharpest channel behind most mosaics.
//!
//! What is round, out of focus or soft by itself is softer than the camera, nothing is sharper. So the sharp side counts: the
//! 30th percentile of σ² over all edges, and as its interval the order statistics that hold it in two cases of three.
//!
//! Not modelled: point spreads that are no Gaussian or differ over the picture, sharpening in the camera, a response that
//! differs from the profile's.

use glam::DVec3;

use super::edges::{ACROSS, ALONG, Line, edges};
use super::eye::Eye;
use super::pyramid::Plane;
use super::state::{State, moved};
use crate::camera::Response;
use crate::fit::twist;
use crate::frame::Frame;
use crate::measure::spread::{Sample, Step, fit};
use crate::parallel::over_rows;
use crate::pixels::Pixels;

/// Green.
const CHANNEL: usize = 1;
/// Frames that are looked at, at most, and of how many one.
const MOST_FRAMES: usize = 24;
const OF_FRAMES: usize = 3;
/// Edges of a frame, at most.
const MOST_EDGES: usize = 80;
/// Fewer say nothing.
pub const LEAST_EDGES: usize = 40;
/// A smaller σ² is none, px².
const NONE_PX2: f64 = 1e-6;
/// The share of edges that are taken to be sharper.
const PERCENTILE: f64 = 0.3;
/// From this code on (of 255) a channel may be clipped.
const CLIPPED: f32 = 248.0;
/// Edges that moved by more across themselves while the shutter was open do not count, px.
const MOST_MOVED_PX: f64 = 0.7;
/// Without depth a frame counts whose camera moved what is so far away by so little: units of the recording, px.
const NEAREST: f64 = 1.0;
const STILL_PX: f64 = 0.3;
/// A thing in front of another has its edge there: depth is the nearest so far about it, px.
const NEAR_PX: usize = 3;
/// The plateaus of an edge begin so far from it, px; they differ by this much light, and each is even within this share of it.
const PLATEAU_PX: f64 = 3.5;
const LEAST_STEP: f64 = 0.05;
const EVEN: f64 = 0.12;
/// Pixels may lie beside the fit by this share of the step, root mean square.
const CLEAN: f64 = 0.1;
/// Wider blurs are something else's, px.
const WIDEST_PX: f64 = 4.0;
/// A fit's first guess, px², and the step after which it is close enough.
const GUESS_PX2: f64 = 0.5;
const CLOSE: f64 = 1e-3;

/// Edges are counted by σ in steps of this, px, so many.
pub const EDGES_STEP_PX: f64 = 0.05;
const EDGES_STEPS: usize = 40;

/// The camera's point spread.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSpread {
    /// Standard deviation of the Gaussian, px.
    pub sigma_px: f64,
    /// In two cases of three it lies between these.
    pub between_px: [f64; 2],
    pub edges: usize,
    /// By σ, in steps of [`EDGES_STEP_PX`]; the last has the wider ones, too.
    pub by_px: Vec<u32>,
}

/// Gathers edges.
pub struct Spreads<'a> {
    eye: &'a Eye,
    /// Linear light by code.
    light: Vec<f64>,
    threads: usize,
    /// σ² of each, px².
    pub variances: Vec<f64>,
}

/// How the camera moved while it took a frame.
pub struct Motion<'a> {
    pub state: &'a State,
    /// At the frame's moment, m, 0 where unknown.
    pub depth: &'a [f32],
    pub exposure_s: f64,
}

impl Motion<'_> {
    /// Whether nothing farther than the nearest that is looked at without depth moves by more than is borne.
    fn is_still(&self, eye: &Eye) -> bool {
        let speed = twist::turn(&self.state.twist).length() + twist::way(&self.state.twist).length() / NEAREST;
        let focal_px = eye.geometry.intrinsics.fx_px.max(eye.geometry.intrinsics.fy_px);
        focal_px * speed * self.exposure_s <= STILL_PX
    }
}

impl<'a> Spreads<'a> {
    pub fn new(eye: &'a Eye, response: &Response, max_code: u32, threads: usize) -> Self {
        Self { eye, light: response.table(max_code), threads, variances: Vec::new() }
    }

    /// Without depth a frame counts only if the camera hardly moved.
    pub fn add(&mut self, frame: &Frame, motion: &Motion<'_>) {
        let is_at_rest = motion.depth.iter().all(|z| *z == 0.0);
        if is_at_rest && !motion.is_still(self.eye) {
            return;
        }
        let light = self.linear(&frame.pixels);
        let moved_px = |x: usize, y: usize, n: [f32; 2]| match is_at_rest {
            true => Some(0.0),
            false => self.moved_px(motion, x, y, n),
        };
        let wanted = |x: usize, y: usize, n: [f32; 2]| moved_px(x, y, n).is_some_and(|px| px <= MOST_MOVED_PX);
        let lines = edges(&light, &clipped(&frame.pixels), MOST_EDGES, wanted);
        let mut found: Vec<(Line, Option<f64>)> = lines.into_iter().map(|line| (line, None)).collect();
        over_rows(&mut found, 1, self.threads, |_, slot| {
            let (line, variance) = &mut slot[0];
            let (sin, cos) = line.angle.sin_cos();
            *variance = moved_px(line.x, line.y, [cos, sin]).and_then(|px| variance_px2(&light, line, px));
        });
        self.variances.extend(found.into_iter().filter_map(|(_, variance)| variance));
    }

    /// The point spread, or why it is not known.
    pub fn finish(mut self) -> Result<PointSpread, String> {
        let edges = self.variances.len();
        if edges < LEAST_EDGES {
            return Err(format!("{edges} straight edges that stand alone and hardly move; {LEAST_EDGES} are needed"));
        }
        self.variances.sort_by(f64::total_cmp);
        // Of n edges np are sharper, with a standard deviation of √(np(1 − p)).
        let (n, p) = (edges as f64, PERCENTILE);
        let at = |by: f64| {
            let place = (n * p + by * (n * p * (1.0 - p)).sqrt() - 0.5).clamp(0.0, n - 1.0);
            let (low, share) = (place.floor() as usize, place.fract());
            let high = (low + 1).min(edges - 1);
            let variance = self.variances[low] + share * (self.variances[high] - self.variances[low]);
            if variance < NONE_PX2 { 0.0 } else { variance.sqrt() }
        };
        let mut by_px = vec![0; EDGES_STEPS];
        for variance in &self.variances {
            by_px[((variance.max(0.0).sqrt() / EDGES_STEP_PX) as usize).min(EDGES_STEPS - 1)] += 1;
        }
        Ok(PointSpread { sigma_px: at(0.0), between_px: [at(-1.0), at(1.0)], edges, by_px })
    }

    fn linear(&self, pixels: &Pixels) -> Plane {
        let values = pixels.each(|c| self.light[c[CHANNEL] as usize] as f32);
        Plane { width: pixels.width as usize, height: pixels.height as usize, values }
    }

    /// The way of an edge across itself while its row is exposed, px. `None` where depth is unknown.
    fn moved_px(&self, motion: &Motion<'_>, x: usize, y: usize, normal: [f32; 2]) -> Option<f64> {
        let width = self.eye.size().0;
        let rows = motion.depth.chunks(width).skip(y.saturating_sub(NEAR_PX)).take(2 * NEAR_PX + 1);
        let near = rows.flat_map(|row| &row[x.saturating_sub(NEAR_PX)..(x + NEAR_PX + 1).min(width)]);
        let nearest = near.copied().filter(|z| *z > 0.0).fold(f32::MAX, f32::min);
        if nearest == f32::MAX {
            return None;
        }
        let at = f64::from(nearest) * DVec3::from(self.eye.rays[y * width + x].map(f64::from));
        let seen = |time_s: f64| self.eye.geometry.project(moved(at, &motion.state.twist, -time_s));
        let way = seen(0.5 * motion.exposure_s)? - seen(-0.5 * motion.exposure_s)?;
        Some((way.x * f64::from(normal[0]) + way.y * f64::from(normal[1])).abs())
    }
}

/// Where a channel may be clipped.
fn clipped(pixels: &Pixels) -> Vec<bool> {
    let most = CLIPPED / 255.0 * pixels.max_code() as f32;
    pixels.each(|c| c.into_iter().any(|code| code as f32 >= most))
}

/// Of the Gaussian that blurred an edge, px²: below 0 where it is sharper than pixels without any. `None` if it is no clean step.
fn variance_px2(light: &Plane, line: &Line, moved_px: f64) -> Option<f64> {
    let step = Step { offset_px: line.offset_px.into(), angle: line.angle.into(), variance_px2: GUESS_PX2, moved_px };
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
            samples.push(Sample { x: dx, y: dy, light, weight: 1.0 });
            if d.abs() > PLATEAU_PX {
                let side = &mut plateaus[usize::from(d > 0.0)];
                *side = (side.0 + 1.0, side.1 + light, side.2 + light * light);
            }
        }
    }
    let [dark, bright] = plateaus.map(|(n, sum, _)| sum / f64::max(n, 1.0));
    let height = bright - dark;
    let uneven = plateaus.map(|(n, sum, squares)| (squares / n - (sum / n).powi(2)).max(0.0).sqrt());
    if !(height >= LEAST_STEP && uneven.iter().all(|u| *u <= EVEN * height)) {
        return None;
    }
    let found = fit(&samples, step, CLOSE)?;
    let off = (found.left / samples.len() as f64).sqrt();
    let variance = found.step.variance_px2;
    (off <= CLEAN * height && variance <= WIDEST_PX * WIDEST_PX).then_some(variance)
}

/// The frames to look at: of parts of the recording, the ones in which the camera moved least.
pub fn chosen(states: &[Option<State>]) -> Vec<usize> {
    let count = states.len().div_ceil(OF_FRAMES).min(MOST_FRAMES);
    // What turns by 1 rad/s moves like what passes by at 1 m/s at a distance of 1 m.
    let fast = |n: &usize| states[*n].map_or(f64::INFINITY, |state| state.twist.norm());
    let part = |k: usize| k * states.len() / count..(k + 1) * states.len() / count;
    let stillest = |k: usize| part(k).filter(|n| states[*n].is_some()).min_by(|a, b| fast(a).total_cmp(&fast(b)));
    (0..count).filter_map(stillest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics};
    use crate::effects::point_spread::{measuring, twin};
    use crate::fit::twist::Twist;
    use crate::measure::spread::EXACT;

    /// Light of an edge through the middle, dark 0.1 and bright 0.5, with a slope.
    fn drawn(side: usize, angle_deg: f64, sigma_px: f64, moved_px: f64) -> Plane {
        let edge = Step { offset_px: 0.3, angle: angle_deg.to_radians(), variance_px2: sigma_px * sigma_px, moved_px };
        let middle = (side / 2) as f64;
        let light = |i: usize| {
            let (d, t) = edge.place((i % side) as f64 - middle, (i / side) as f64 - middle);
            (0.1 + 0.4 * edge.share(d) + 0.001 * t) as f32
        };
        Plane { width: side, height: side, values: (0..side * side).map(light).collect() }
    }

    #[test]
    fn an_edge_is_found_where_it_is_and_as_soft_as_it_is() {
        for (angle, sigma, moved) in [(7.0, 0.4, 0.0), (-100.0, 0.8, 0.5), (50.0, 1.3, 0.0)] {
            let light = drawn(61, angle, sigma, moved);
            let found = edges(&light, &vec![false; 61 * 61], 20, |_, _, _| true);
            assert!(found.len() >= 2, "{found:?}");
            for line in &found {
                let off = (f64::from(line.angle).to_degrees() - angle).rem_euclid(360.0);
                assert!(off.min(360.0 - off) < 0.5, "{line:?}");
                let variance = variance_px2(&light, line, moved).unwrap();
                assert!((variance.sqrt() - sigma).abs() < 0.02, "{angle}° {sigma} px: {}", variance.sqrt());
            }
            // Where it is clipped nothing can be said, and what is refused is not found.
            assert!(edges(&light, &vec![true; 61 * 61], 20, |_, _, _| true).is_empty());
            assert!(edges(&light, &vec![false; 61 * 61], 20, |_, _, _| false).is_empty());
        }
        // Movement that is not known of makes it softer: σ² + 0.6²/12.
        let light = drawn(61, 20.0, 0.5, 0.6);
        let line = edges(&light, &vec![false; 61 * 61], 1, |_, _, _| true)[0];
        assert!((variance_px2(&light, &line, 0.0).unwrap() - 0.28).abs() < 0.01);
    }

    #[test]
    fn corners_and_stripes_are_no_edges() {
        let side = 61;
        let corner = |i: usize| if i % side > 30 && i / side > 30 { 0.5 } else { 0.1 };
        let stripes = |i: usize| if ((i % side) / 4).is_multiple_of(2) { 0.5 } else { 0.1 };
        let picture =
            |of: &dyn Fn(usize) -> f32| Plane { width: side, height: side, values: (0..side * side).map(of).collect() };
        let measured = |light: &Plane| {
            let found = edges(light, &vec![false; side * side], 50, |_, _, _| true);
            found.into_iter().filter_map(|line| variance_px2(light, &line, 0.0).map(|v| (line, v))).collect::<Vec<_>>()
        };
        let near_the_corner = measured(&picture(&corner));
        assert!(near_the_corner.iter().all(|(line, _)| line.x.max(line.y) > 36), "{near_the_corner:?}");
        assert!(measured(&picture(&stripes)).is_empty());
    }

    fn of(variances: Vec<f64>) -> Result<PointSpread, String> {
        let eye = Eye {
            geometry: Geometry::new(Intrinsics::default(), Distortion::default()),
            rays: Vec::new(),
            loose: 0.0,
            usual_m: 1.0,
        };
        let mut spreads = Spreads::new(&eye, &Response::default(), 255, 1);
        spreads.variances = variances;
        spreads.finish()
    }

    #[test]
    fn the_sharp_side_counts_and_few_edges_say_nothing() {
        // 1, 2, … 100 hundredths: np = 30 lies between the 30th and the 31st; √(100·0.3·0.7) = 4.583 to either side.
        let found = of((1..=100).rev().map(|n| 0.01 * f64::from(n)).collect()).unwrap();
        assert!((found.sigma_px.powi(2) - 0.305).abs() < 1e-9 && found.edges == 100, "{found:?}");
        let [low, high] = found.between_px.map(|px| px * px);
        assert!((low - 0.25917).abs() < 1e-4 && (high - 0.35083).abs() < 1e-4, "{found:?}");
        assert_eq!(of(vec![0.2; 39]).unwrap_err(), "39 straight edges that stand alone and hardly move; 40 are needed");
    }

    #[test]
    fn the_stillest_frame_of_each_part_is_looked_at() {
        let state =
            |speed: f64| Some(State { world_from_camera: glam::DAffine3::IDENTITY, twist: Twist::from_element(speed) });
        let states = [Some(3.0), None, Some(5.0), Some(2.0), Some(4.0), Some(0.1), None].map(|s| s.and_then(state));
        assert_eq!(chosen(&states), [0, 3, 5]);
        assert!(chosen(&[]).is_empty() && chosen(&[None]).is_empty());
    }

    /// σ of an edge that was drawn by coverage and then blurred, slanted by so much.
    fn measured_px(sigma_px: f64, angle_deg: f64) -> f64 {
        const SIDE: usize = 33;
        let edge = Step { offset_px: 0.2, angle: angle_deg.to_radians(), variance_px2: 0.0, moved_px: 0.0 };
        let place = |i: usize| ((i % SIDE) as f64 - 16.0, (i / SIDE) as f64 - 16.0);
        let drawn: Vec<[f64; 4]> =
            (0..SIDE * SIDE).map(|i| [edge.share(edge.place(place(i).0, place(i).1).0); 4]).collect();
        let blurred = twin(&drawn, SIDE, SIDE, sigma_px);
        let sample = |i: usize| {
            let (x, y) = place(i);
            let is_near = x.abs() < 12.0 && y.abs() < 12.0 && edge.place(x, y).0.abs() < 6.0;
            is_near.then_some(Sample { x, y, light: blurred[i][0], weight: 1.0 })
        };
        let samples: Vec<Sample> = (0..SIDE * SIDE).filter_map(sample).collect();
        fit(&samples, Step { variance_px2: 0.3, ..edge }, EXACT).unwrap().step.variance_px2.sqrt()
    }

    #[test]
    fn what_is_set_for_a_measured_edge_measures_as_that() {
        for wanted in [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.3, 2.0] {
            let set = measuring(wanted);
            let all = [5.0, 12.0, 20.0, 30.0, 40.0].map(|angle| measured_px(set, angle));
            let mean = all.iter().sum::<f64>() / 5.0;
            assert!((mean - wanted).abs() < 0.01, "{wanted} px: {set} px measures {all:?}");
        }
        assert_eq!((measuring(0.0), measuring(20.0)), (0.0, 8.0));
    }
}
