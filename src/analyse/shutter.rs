//! How long each frame was exposed, by how its motion blur differs from its neighbours'.
//!
//! Of frames spread over the recording each is compared with up to three within 20 frames that show nearly the same view and
//! whose motion differs most ([`cross_blur`](super::cross_blur)); the curves' mean, weighted by what they see and by the square of how much the flows
//! differ, has its least value at the exposure. The recording's is the median of the frames that say it clearly, unless a run of
//! them differs by more than a fifth. It is refused where too few do: a camera at rest, or one that moves evenly.
//!
//! The estimate is the exposure that explains the blur by the known motion. If frames are far apart without poses between
//! them, that motion is a mean over two intervals and too slow, and the exposure comes out too long. Rendered blur still
//! matches, because the two errors cancel. Without timestamps the exposure is a fraction of the nominal interval.
//!
//! Not modelled: exposures that differ between the two frames of a pair. A frame is compared with slower ones, whose blur says
//! little, so it is mostly its own that is found.

use std::collections::BTreeMap;

use glam::{DMat2, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::blurred::{Blurred, halvings};
use super::boxes::Tried;
use super::cross_blur::{Curve, compared};
use super::eye::Eye;
use super::mesh::flow;
use super::robust::{median, scatter};
use super::state::State;
use crate::camera::{NoiseProfile, Response};
use crate::fit::twist::Twist;
use crate::frame::Frame;
use crate::parallel::over_rows;

/// Frames are looked at one in so many, but at least and at most so many.
const EVERY: usize = 8;
const LEAST_LOOKS: usize = 12;
const MOST_LOOKS: usize = 200;
/// Frames that a frame is compared with, how many frames away they may be, and by how much the view moves between the two
/// at most, mean of five places by the picture's width.
const PAIRS: usize = 3;
const APART: [usize; 8] = [1, 2, 3, 5, 7, 10, 14, 20];
const FARTHEST_VIEW: f64 = 0.25;
/// Flows must differ by as much, px/s at 520 px of focal length.
const DIVERSE_PX_S: f64 = 250.0;
const AT_FOCAL_PX: f64 = 520.0;
/// What a faster neighbour says counts by this, since its own blur says most.
const FASTER: f64 = 0.7;
/// Exposures that are tried, and the longest by the usual interval and at most, s.
const TRIED: usize = 36;
const LONGEST: f64 = 1.05;
const LONGEST_S: f64 = 0.05;
/// A curve is clear if its ends lie above its least value by this share.
const CLEAR: f64 = 0.3;
/// Fewer clear frames say nothing.
const LEAST_CLEAR: usize = 4;
/// Runs differ by more than this share, and have at least so many frames.
const DIFFERENT: f64 = 0.2;
const LEAST_RUN: usize = 3;
const SIGNIFICANT_SIGMAS: f64 = 3.0;
/// Sharp frames are exposed for so long at least, s: what a median of them errs by.
const SHORTEST_S: f64 = ALIKE_S;
/// Cost of one more run, in frames that deviate by the samples' scatter (at least a tenth).
const FRAMES_PER_RUN: f64 = 3.0;
const MIN_SCATTER_LN: f64 = 0.1;
/// σ of a median by that of one value.
const OF_MEDIAN: f64 = 1.2533;
/// What all frames of a recording err by alike, which their scatter does not tell: by share, and s. Simulated recordings from 5 to
/// 30 ms come out within 1.8 %.
const ALIKE: f64 = 0.01;
const ALIKE_S: f64 = 1e-4;

/// What one frame says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heard {
    pub frame: usize,
    pub exposure_s: f64,
    /// How far its curve rises to the nearer end, by its least value.
    pub clear: f64,
}

/// Frames of one exposure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// The first frame, and the one after the last.
    pub from: usize,
    pub to: usize,
    pub exposure_s: f64,
    pub sigma_s: f64,
    /// Frames that said it.
    pub heard: usize,
}

/// What all of them say.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposed {
    /// In order; each frame lies in one.
    pub runs: Vec<Run>,
    /// Frames that say it clearly, in order.
    pub heard: Vec<Heard>,
}

/// What frames said, of how many that were looked at.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Said {
    heard: Vec<Heard>,
    looked: usize,
}

/// Which frames are compared, and what they said.
pub struct Shutter<'a> {
    eye: &'a Eye,
    response: &'a Response,
    noise: Option<&'a NoiseProfile>,
    tried: Tried,
    threads: usize,
    /// How each frame's motion changes, m/s² and rad/s².
    changes: Vec<Twist>,
    /// Frames, each with those it is compared with.
    plan: Vec<(usize, Vec<usize>)>,
    kept: BTreeMap<usize, Blurred>,
    said: Said,
}

impl<'a> Shutter<'a> {
    /// `states`, `timestamps_s`: one per frame; `interval_s`: the usual one.
    pub fn new(
        eye: &'a Eye,
        response: &'a Response,
        noise: Option<&'a NoiseProfile>,
        states: &[Option<State>],
        timestamps_s: &[f64],
        interval_s: f64,
        threads: usize,
    ) -> Self {
        let longest_s = (LONGEST * interval_s).min(LONGEST_S);
        let tried = Tried { step_s: longest_s / (TRIED - 1) as f64, count: TRIED };
        let plan = plan(eye, states);
        let changes = changes(states, timestamps_s, 2.5 * interval_s);
        Self { eye, response, noise, tried, threads, changes, plan, kept: BTreeMap::new(), said: Said::default() }
    }

    /// Whether the next frame takes part.
    pub fn needs(&self, frame: usize) -> bool {
        self.plan.iter().any(|(own, others)| *own == frame || others.contains(&frame))
    }

    /// Frames come in order. `depth`: at the frame's moment, in its picture.
    pub fn add(&mut self, frame: &Frame, state: State, depth: &[f32]) {
        let index = frame.index;
        if !self.needs(index) {
            return;
        }
        let new =
            Blurred::new(self.eye, frame, (state, self.changes[index]), depth.to_vec(), self.response, self.noise);
        self.kept.insert(index, new);
        let last = |(own, others): &(usize, Vec<usize>)| others.iter().copied().max().unwrap_or(0).max(*own);
        let (ready, rest): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.plan).into_iter().partition(|job| last(job) <= index);
        self.plan = rest;
        self.said.looked += ready.len();
        for (own, others) in ready {
            let mut curves: Vec<(usize, Option<Curve>)> = others.into_iter().map(|other| (other, None)).collect();
            let (kept, eye, tried) = (&self.kept, self.eye, self.tried);
            over_rows(&mut curves, 1, self.threads, |_, slot| {
                let (other, curve) = &mut slot[0];
                if let (Some(i), Some(j)) = (kept.get(other), kept.get(&own)) {
                    *curve = compared(eye, i, j, tried);
                }
            });
            let least = diverse(self.eye);
            let curves: Vec<Curve> =
                curves.into_iter().filter_map(|(_, curve)| curve).filter(|curve| curve.apart > least).collect();
            self.said.heard.extend(least_of(&curves, tried).map(|(exposure_s, clear)| Heard {
                frame: own,
                exposure_s,
                clear,
            }));
        }
        let needed = |frame: usize| self.plan.iter().any(|(own, others)| *own == frame || others.contains(&frame));
        let gone: Vec<usize> = self.kept.keys().copied().filter(|frame| !needed(*frame)).collect();
        gone.iter().for_each(|frame| drop(self.kept.remove(frame)));
    }

    pub fn said(self) -> Said {
        self.said
    }
}

impl Said {
    /// The recording's runs of one exposure, or why there are none.
    pub fn exposed(self, frames: usize) -> Result<Exposed, String> {
        if self.looked == 0 {
            return Err("the camera's motion is too even: blur does not differ between frames".to_owned());
        }
        let mut clear: Vec<Heard> = self.heard.iter().copied().filter(|heard| heard.clear > CLEAR).collect();
        // A frame that is compared with later ones is heard after its neighbours.
        clear.sort_by_key(|heard| heard.frame);
        if clear.len() < LEAST_CLEAR {
            return Err(format!(
                "{} of {} frames looked at say it clearly; {LEAST_CLEAR} are needed",
                clear.len(),
                self.looked
            ));
        }
        Ok(Exposed { runs: runs(&clear, frames), heard: clear })
    }
}

/// px/s of the small pictures.
fn diverse(eye: &Eye) -> f64 {
    let scale = f64::from(1u32 << halvings(eye));
    DIVERSE_PX_S * eye.geometry.intrinsics.fx_px / AT_FOCAL_PX / scale
}

/// Where the mean curve is least, by a parabola through its three least values, and how clearly. `None` without curves, and
/// where it is least at the longest exposure tried.
fn least_of(curves: &[Curve], tried: Tried) -> Option<(f64, f64)> {
    let weight = |curve: &Curve| curve.patches as f64 * curve.apart.powi(2);
    let whole: f64 = curves.iter().map(weight).sum();
    if curves.is_empty() {
        return None;
    }
    let mean = |s: usize| curves.iter().map(|curve| weight(curve) * curve.values[s]).sum::<f64>() / whole;
    let values: Vec<f64> = (0..tried.count).map(mean).collect();
    let k = (0..tried.count).min_by(|a, b| values[*a].total_cmp(&values[*b]))?;
    if k + 1 == tried.count {
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
    // Noise may leave less than nothing.
    let clear = (values[0].min(values[tried.count - 1]) - values[k]) / values[k].max(1e-4);
    Some(((k as f64 + offset) * tried.step_s, clear))
}

/// Frames whose neighbours move otherwise, spread over the recording.
fn plan(eye: &Eye, states: &[Option<State>]) -> Vec<(usize, Vec<usize>)> {
    let frames = states.len();
    let spreads: Vec<Option<DMat2>> = states.iter().map(|state| state.map(|state| spread(eye, &state))).collect();
    let scale = f64::from(1u32 << halvings(eye));
    let least = diverse(eye) * scale;
    let partners = |own: usize| -> Option<(f64, Vec<usize>)> {
        let here = spreads[own]?;
        let mut found: Vec<(f64, usize)> = Vec::new();
        for other in APART.iter().flat_map(|gap| [own.checked_sub(*gap), Some(own + gap)]).flatten() {
            let Some(there) = spreads.get(other).copied().flatten() else { continue };
            let (Some(a), Some(b)) = (states[own], states[other]) else { continue };
            if !is_near(eye, &a, &b) {
                continue;
            }
            let off = here - there;
            let apart = norm(&off).sqrt();
            let is_slower = off.x_axis.x + off.y_axis.y > 0.0;
            if apart > least {
                found.push((if is_slower { apart } else { FASTER * apart }, other));
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        found.truncate(PAIRS);
        let score = found.first()?.0;
        Some((score, found.into_iter().map(|(_, other)| other).collect()))
    };
    let looks = (frames / EVERY).clamp(LEAST_LOOKS, MOST_LOOKS).min(frames);
    let best_of = |part: usize| {
        let (from, to) = (part * frames / looks, (part + 1) * frames / looks);
        let all = (from..to).filter_map(|own| Some((own, partners(own)?)));
        let best = all.max_by(|a, b| a.1.0.total_cmp(&b.1.0).then(b.0.cmp(&a.0)))?;
        Some((best.0, best.1.1))
    };
    (0..looks).filter_map(best_of).collect()
}

/// By the motions of the frames before and after; none where one lacks, or lies more than `most_s` away.
fn changes(states: &[Option<State>], timestamps_s: &[f64], most_s: f64) -> Vec<Twist> {
    let change = |n: usize| -> Option<Twist> {
        let (before, after) = (n.checked_sub(1)?, n + 1);
        let (a, b) = (states[before]?, (*states.get(after)?)?);
        let between_s = timestamps_s[after] - timestamps_s[before];
        (between_s > 0.0 && between_s < most_s).then(|| (b.twist - a.twist) / between_s)
    };
    (0..states.len()).map(|n| change(n).unwrap_or_else(Twist::zeros)).collect()
}

fn norm(m: &DMat2) -> f64 {
    m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Five places of the picture, by tangents.
const PLACES: [(f64, f64); 5] = [(0.0, 0.0), (0.27, 0.2), (-0.27, 0.2), (0.27, -0.2), (-0.27, -0.2)];

/// Points at the places, as far away as is usual, in the camera's axes, m.
fn points(eye: &Eye) -> [DVec3; 5] {
    PLACES.map(|(x, y)| eye.usual_m * DVec3::new(x, y, 1.0))
}

/// Mean of v·vᵀ over five places of the picture, (px/s)², of things as far away as is usual.
fn spread(eye: &Eye, state: &State) -> DMat2 {
    let mut sum = DMat2::ZERO;
    for v in points(eye).into_iter().filter_map(|point| flow(eye, point, state)) {
        let v: DVec2 = v;
        sum += DMat2::from_cols(v * v.x, v * v.y) * (1.0 / PLACES.len() as f64);
    }
    sum
}

/// Whether two frames show the same things in nearly the same places.
fn is_near(eye: &Eye, a: &State, b: &State) -> bool {
    let b_from_a = b.world_from_camera.inverse() * a.world_from_camera;
    let moved = points(eye).map(|point| {
        let (from, to) = (eye.geometry.project(point), eye.geometry.project(b_from_a.transform_point3(point)));
        from.zip(to).map_or(f64::INFINITY, |(from, to)| from.distance(to))
    });
    moved.iter().sum::<f64>() / (moved.len() as f64) < FARTHEST_VIEW * eye.size().0 as f64
}

/// One run, unless rows of frames differ: the parts that have the least Σ|ln s − median| and a cost for each, none shorter than
/// [`LEAST_RUN`]. Neighbours that differ by less than a fifth, or by less than 3 σ, are one.
fn runs(clear: &[Heard], frames: usize) -> Vec<Run> {
    let mut ends = parted(clear);
    let part = |ends: &[usize], n: usize| &clear[if n == 0 { 0 } else { ends[n - 1] }..ends[n]];
    let scatter = successive_scatter(clear);
    let is_same = |a: &[Heard], b: &[Heard]| {
        let step = (middle(a).0 / middle(b).0).ln().abs();
        let sigma = OF_MEDIAN * scatter * (1.0 / a.len() as f64 + 1.0 / b.len() as f64).sqrt();
        step < DIFFERENT.ln_1p().max(SIGNIFICANT_SIGMAS * sigma)
    };
    while let Some(n) = (1..ends.len()).find(|n| is_same(part(&ends, n - 1), part(&ends, *n))) {
        ends.remove(n - 1);
    }
    let border = |n: usize| (clear[ends[n] - 1].frame + clear[ends[n]].frame).div_ceil(2);
    let run = |n: usize| {
        let part = part(&ends, n);
        let (exposure_s, spread_s) = middle(part);
        Run {
            from: if n == 0 { 0 } else { border(n - 1) },
            to: if n + 1 == ends.len() { frames } else { border(n) },
            exposure_s: exposure_s.max(SHORTEST_S),
            sigma_s: (OF_MEDIAN * spread_s / (part.len() as f64).sqrt()).hypot(ALIKE * exposure_s).hypot(ALIKE_S),
            heard: part.len(),
        }
    };
    (0..ends.len()).map(run).collect()
}

/// Where the parts end.
fn parted(clear: &[Heard]) -> Vec<usize> {
    let cost = |from: usize, to: usize| {
        let mut values: Vec<f64> = clear[from..to].iter().map(|heard| heard.exposure_s.max(1e-6).ln()).collect();
        let middle = median(&mut values);
        values.iter().map(|value| (value - middle).abs()).sum::<f64>()
    };
    let run_cost = FRAMES_PER_RUN * successive_scatter(clear).max(MIN_SCATTER_LN);
    // Of the first n frames: the least cost, and where its last part begins.
    let mut best = vec![(f64::INFINITY, 0); clear.len() + 1];
    best[0] = (0.0, 0);
    for to in LEAST_RUN..=clear.len() {
        for from in 0..=to - LEAST_RUN {
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
fn successive_scatter(clear: &[Heard]) -> f64 {
    let ln = |heard: &Heard| heard.exposure_s.max(1e-6).ln();
    let mut steps: Vec<f64> = clear.windows(2).map(|pair| (ln(&pair[1]) - ln(&pair[0])).abs()).collect();
    1.4826 * median(&mut steps) / 2f64.sqrt()
}

/// The median, and one standard deviation by 1.4826·MAD, s.
fn middle(part: &[Heard]) -> (f64, f64) {
    let mut values: Vec<f64> = part.iter().map(|heard| heard.exposure_s).collect();
    scatter(&mut values)
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::camera::Geometry;
    use crate::fit::twist;

    fn heard(frame: usize, exposure_ms: f64) -> Heard {
        Heard { frame, exposure_s: 1e-3 * exposure_ms, clear: 1.0 }
    }

    #[test]
    fn one_exposure_is_one_run_with_the_median() {
        let times_ms = [10.0, 10.2, 9.8, 10.1, 25.0, 9.9, 10.0];
        let all: Vec<Heard> = times_ms.iter().enumerate().map(|(n, ms)| heard(8 * n, *ms)).collect();
        let found = runs(&all, 60);
        assert_eq!(found.len(), 1, "a single frame that is off is no run: {found:?}");
        // |off|: 0, .2, .2, .1, 15, .1, 0: median 0.1 ms; 1.2533 · 1.4826 · 0.1 / √7 is 0.0702; with 0.1 and 0.1 ms alike.
        assert_eq!((found[0].from, found[0].to, found[0].exposure_s, found[0].heard), (0, 60, 0.01, 7));
        assert!((found[0].sigma_s - 1.5798e-4).abs() < 1e-7, "{}", found[0].sigma_s);
    }

    #[test]
    fn a_row_of_frames_that_differs_by_more_than_a_fifth_is_a_run() {
        let row = |longer: f64| -> Vec<Run> {
            let of = |n: usize| 10.0 * if (4..8).contains(&n) { longer } else { 1.0 } + 0.1 * (n % 3) as f64;
            let all: Vec<Heard> = (0..12).map(|n| heard(8 * n + 2, of(n))).collect();
            runs(&all, 100)
        };
        assert_eq!(row(1.15).len(), 1);
        let found = row(2.0);
        let ends: Vec<(usize, usize)> = found.iter().map(|run| (run.from, run.to)).collect();
        // Halfway between the frames 26 and 34, 58 and 66.
        assert_eq!(ends, [(0, 30), (30, 62), (62, 100)]);
        assert!((found[1].exposure_s - 0.0201).abs() < 1e-4 && (found[2].exposure_s - 0.0101).abs() < 1e-4);
    }

    #[test]
    fn scattered_samples_are_one_run() {
        // Of a plain floor at 1/60 s; by a fixed cost frames 9 to 15 would be a run of 28 ms.
        let times_ms = [19.1, 18.3, 20.8, 19.0, 28.8, 18.3, 27.8, 12.4, 17.8, 16.3, 17.3];
        let all: Vec<Heard> = times_ms.iter().enumerate().map(|(n, ms)| heard(2 * n, *ms)).collect();
        let found = runs(&all, 24);
        assert_eq!((found.len(), found[0].exposure_s), (1, 0.0183));
        // Of another: runs of 15.5 and 19.1 ms.
        let times_ms = [15.5, 14.6, 16.5, 14.9, 14.0, 24.5, 9.8, 18.1, 15.8, 18.8, 25.8, 19.1];
        let others: Vec<Heard> = times_ms.iter().enumerate().map(|(n, ms)| heard(2 * n, *ms)).collect();
        assert_eq!(runs(&others, 24).len(), 1);
        // Steps of 2, 1, 2 and 1 between runs are the noise of samples that step all the time.
        let steps = [1.0, 2.0, 1.0, 2.0, 1.0].map(|ms: f64| 10.0 * ms);
        let all: Vec<Heard> = steps.iter().enumerate().map(|(n, ms)| heard(n, *ms)).collect();
        assert!((successive_scatter(&all) - 1.4826 * 2f64.ln() / 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_least_value_of_a_parabola_is_found_between_what_was_tried() {
        let tried = Tried { step_s: 0.001, count: 36 };
        let curve = |at: f64| Curve {
            values: (0..36).map(|s| 0.01 + 0.001 * (f64::from(s) - at).powi(2)).collect(),
            patches: 10,
            apart: 400.0,
        };
        let (exposure_s, clear) = least_of(&[curve(12.3)], tried).unwrap();
        assert!((exposure_s - 0.0123).abs() < 1e-9);
        // At 0 it is 0.01 + 0.15129, at 12 it is 0.01009.
        assert!((clear - (0.16129 - 0.01009) / 0.01009).abs() < 1e-9, "{clear}");
        assert_eq!(least_of(&[curve(50.0)], tried), None, "longer than was tried");
        assert_eq!(least_of(&[], tried), None);
    }

    #[test]
    fn a_motions_change_is_taken_over_both_neighbours() {
        let moving = |x: f64| {
            Some(State { world_from_camera: DAffine3::IDENTITY, twist: twist::twist(DVec3::X * x, DVec3::ZERO) })
        };
        let states = [moving(0.0), moving(1.0), moving(3.0), None, moving(4.0), moving(5.0), moving(6.0)];
        // 3 m/s more within 0.2 s; the last but one's neighbours lie too far apart.
        let found = changes(&states, &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.4], 0.25);
        let found: Vec<f64> = found.iter().map(|change| change[0]).collect();
        assert!((found[1] - 15.0).abs() < 1e-9);
        assert_eq!([found[0], found[2], found[4], found[5], found[6]], [0.0; 5]);
    }

    #[test]
    fn a_camera_that_moves_evenly_is_not_looked_at() {
        let eye = Eye::new(Geometry::pinhole(640, 480, 520.0));
        let turning = |rate: f64| {
            Some(State { world_from_camera: DAffine3::IDENTITY, twist: twist::twist(DVec3::ZERO, DVec3::Y * rate) })
        };
        assert_eq!(plan(&eye, &[turning(1.0); 40]), []);
        assert_eq!(plan(&eye, &[None; 40]), []);
        let response = Response::default();
        let shutter = Shutter::new(&eye, &response, None, &[turning(1.0); 40], &[0.0; 40], 0.033, 1);
        assert!(shutter.said().exposed(40).unwrap_err().contains("too even"));
        // One frame of forty moves: it is compared with its neighbours, and they with it.
        let mut states = [turning(0.0); 40];
        states[20] = turning(1.0);
        let found = plan(&eye, &states);
        let own = found.iter().find(|job| job.0 == 20).unwrap();
        assert_eq!(own.1, [0, 6, 10], "those 20, 14 and 10 frames away");
        assert!(found.iter().all(|job| job.0 == 20 || job.1 == [20]), "{found:?}");
        // The first ten look 40° aside, where things are that it does not see.
        for state in states.iter_mut().take(10).flatten() {
            state.world_from_camera = DAffine3::from_rotation_y(40f64.to_radians());
        }
        let found = plan(&eye, &states);
        assert_eq!(found.iter().find(|job| job.0 == 20).unwrap().1, [10, 13, 15]);
    }
}
