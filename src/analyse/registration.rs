//! Where the camera really was: what was recorded, corrected by the pictures.
//!
//! In turn: clocks, readout and depth's delay on a few links; seven numbers that are wrong in all poses alike; a graph of links
//! between frames 1 to 20 apart; once more with the motion by the refined poses, which recorded jitter spoils. Then a gate: links
//! that took no part (3 and 7 apart) say how much was wrong and how much still is. Held-out links share the aligner's own bias
//! and flatter small corrections, so poses that are nearly right are kept as they were recorded, bit for bit.

use std::time::Instant;

use glam::DAffine3;
use nalgebra::Matrix6;

use super::align::Link;
use super::depth_clock::{DepthClock, DepthLater};
use super::eye::Eye;
use super::global::{self, Global};
use super::graph;
use super::interrupted::Interrupted;
use super::links::{Links, Pass, links};
use super::path;
use super::robust::median;
use super::state::State;
use super::times::{self, Times};
use super::track::MOST_INTERVALS;
use crate::camera::Geometry;
use crate::fit::twist::{self, Twist};
use crate::recording::{Recording, RecordingError};
use crate::words::fixed;

/// Distances between linked frames.
const LINKED: [usize; 5] = [1, 2, 5, 10, 20];
const CLOCKED: [usize; 2] = [2, 4];
const CLOCKED_AGAIN: [usize; 2] = [2, 5];
const HELD_OUT: [usize; 2] = [3, 7];
/// Rounds of clock, seven numbers and readout.
const ROUNDS: usize = 4;
/// Of a step of the readout that is taken.
const DAMPED: f64 = 0.7;
/// A camera stands no farther than this from what was tracked, m, and is not turned against it by more, rad.
const MOST_WAY_M: f64 = 0.1;
const MOST_TURN_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Rounds of the readout by refined poses.
const AGAIN: usize = 2;
/// No readout is longer, s.
const LONGEST_READOUT_S: f64 = 0.05;
/// A readout time that differs by less is what was given, s.
const SAME_READOUT_S: f64 = 0.002;
/// A readout with a larger σ is not known, s.
pub const SURE_READOUT_S: f64 = 0.001;
/// A delay of depth below this, or within 2σ, is none, s.
const SAME_DEPTH_S: f64 = 0.004;
/// Poses whose links ask for less than this are right, px.
const RIGHT_PX: f64 = 0.25;
/// Held-out links must fit better by this share.
const GAINED: f64 = 0.3;
/// Refused above this, px, or with so many links missing.
const WRONG_PX: f64 = 0.75;
const MISSING: f64 = 0.25;
/// Frames that are looked at for the clocks, for the readout by refined poses, and for depth's clock.
const CLOCK_FRAMES: usize = 45;
const AGAIN_FRAMES: usize = 90;
const DEPTH_FRAMES: usize = 200;

/// What becomes of the recorded poses.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// They are replaced.
    Refined,
    /// They are right: nothing is changed.
    Right,
    /// There is nothing to check them by: nothing is changed.
    Kept(String),
    /// Nothing can be said.
    Refused(String),
}

#[derive(Clone, Debug)]
pub struct Registration {
    pub verdict: Verdict,
    /// One per frame, refined, or as recorded where the verdict says so. None where no pose was recorded.
    pub states: Vec<Option<State>>,
    pub readout_s: f64,
    pub readout_sigma_s: Option<f64>,
    pub depth: Option<DepthLater>,
    pub global: Option<Global>,
    pub links: usize,
    pub missing: usize,
    /// What links that took no part say is wrong, median, px: as recorded and refined.
    pub held_out_px: Option<(f64, f64)>,
    /// Each of these links.
    pub held_out: Vec<Missed>,
    /// One per frame: whether its picture has the code values of the one before.
    pub repeats: Vec<bool>,
}

/// By how much poses miss a link that took no part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missed {
    pub from: usize,
    pub to: usize,
    /// As recorded and as refined, root mean square over the picture, px.
    pub recorded_px: f64,
    pub refined_px: f64,
}

impl Registration {
    /// Added to the depth maps' times, seconds.
    pub fn depth_later_s(&self) -> f64 {
        self.depth.filter(|d| d.later_s.abs() > SAME_DEPTH_S.max(2.0 * d.sigma_s)).map_or(0.0, |d| d.later_s)
    }

    fn as_recorded(recording: &Recording, geometry: &Geometry, verdict: Verdict) -> Self {
        Self {
            verdict,
            states: recorded(recording, 0.0),
            readout_s: geometry.intrinsics.readout_time_s,
            readout_sigma_s: None,
            depth: None,
            global: None,
            links: 0,
            missing: 0,
            held_out_px: None,
            held_out: Vec::new(),
            repeats: Vec::new(),
        }
    }
}

/// One per frame, read `later_s` after its time.
pub fn recorded(recording: &Recording, later_s: f64) -> Vec<Option<State>> {
    let of = |t: &f64| State::of(&recording.track, t + recording.time_offset_s + later_s).ok();
    recording.timestamps_s.iter().map(of).collect()
}

/// `told(done, of)`: how far it is, in frames; an error ends it.
pub fn register(
    recording: &Recording,
    geometry: &Geometry,
    threads: usize,
    times: &mut Times,
    told: &mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
) -> Result<Registration, RegistrationError> {
    let frames = recording.frame_count();
    let as_recorded = |verdict: Verdict| Ok(Registration::as_recorded(recording, geometry, verdict));
    let kept = |why: &str| as_recorded(Verdict::Kept(why.to_owned()));
    let refused = |why: &str| as_recorded(Verdict::Refused(why.to_owned()));
    if !recording.has_depth() {
        return kept("there is no depth to align them by");
    }
    if geometry.sees_around() {
        return kept("the picture does not fit a plane in front of the camera");
    }
    if recorded(recording, 0.0).iter().flatten().count() < 3 {
        return kept("fewer than three frames have one");
    }
    let [every, again_every] = [CLOCK_FRAMES, AGAIN_FRAMES].map(|most| frames.div_ceil(most));
    let whole = ROUNDS * frames.div_ceil(every) + AGAIN * frames.div_ceil(again_every) + 2 * frames;
    let mut work = Work { recording, threads, done: 0, whole, times, told };
    let mut known = Known {
        geometry: geometry.clone(),
        clock_s: 0.0,
        hand_eye: Twist::zeros(),
        depth_later_s: 0.0,
        repeats: vec![false; frames],
    };
    let mut found = Registration::as_recorded(recording, geometry, Verdict::Right);

    // 1. Clocks, readout, the camera's place on what was tracked.
    let mut asks_px = 0.0;
    for round in 0..ROUNDS {
        // After the first, what is left is small.
        let coarsest = if round == 0 { usize::MAX } else { 1 };
        let pass = Pass { gaps: &CLOCKED, back: &[], coarsest, finest: 1, asks_readout: true, every };
        let eye = Eye::new(known.geometry.clone());
        let states = known.states(recording);
        if round == 1 {
            found.depth = work.depth_clock(&eye, &states)?;
            known.depth_later_s = found.depth_later_s();
        }
        let linked = work.links(times::CLOCKS, &eye, &states, known.depth_later_s, pass)?;
        known.repeats.clone_from(&linked.repeats);
        if round == 0 {
            asks_px = median(&mut linked.good.iter().map(|link| link.displaced_px(&link.e)).collect::<Vec<_>>());
        }
        let Some(global) = global::global(&linked.good, &states, true).filter(|_| linked.good.len() >= 12) else {
            return refused(&apart(recording)?);
        };
        // Small corrections of an already corrected place add up.
        known.hand_eye = twist::log(&(twist::exp(&known.hand_eye) * twist::exp(&global.hand_eye)));
        known.clock_s += global.clock_s;
        found.global = Some(Global { hand_eye: known.hand_eye, clock_s: known.clock_s, ..global });
        known.follow(global::readout(&linked.good), DAMPED, &mut found);
    }

    if let Some(why) = found.global.as_ref().filter(|_| asks_px > RIGHT_PX).and_then(out_of_place) {
        return Ok(Registration { verdict: Verdict::Refused(why), ..found });
    }

    // 2. All frames, at once.
    let pass = Pass { gaps: &LINKED, back: &LINKED, coarsest: usize::MAX, finest: 1, asks_readout: false, every: 1 };
    let start = known.states(recording);
    let eye = Eye::new(known.geometry.clone());
    let linked = work.links(times::LINKS, &eye, &start, known.depth_later_s, pass)?;
    (found.links, found.missing) = (linked.good.len(), linked.refused);
    if linked.refused as f64 > MISSING * (linked.good.len() + linked.refused) as f64 {
        let share = 100.0 * linked.refused as f64 / (linked.good.len() + linked.refused) as f64;
        return Ok(Registration {
            verdict: Verdict::Refused(format!(
                "{share:.0} % of the links between frames do not fit: the poses, the focal length or the depth are not this recording's"
            )),
            ..found
        });
    }
    let solved = work.times.of(times::GRAPH, || graph::solve(&linked.good, &start, &vec![Twist::zeros(); frames]));
    let Some(corrections) = solved else { return refused("the links' equations have no solution") };
    let refined = path::with_motion(&recording.timestamps_s, &corrected(&start, &corrections), gap_s(recording));

    // 3. Recorded jitter makes the readout look short; refined poses have none.
    found.depth = work.depth_clock(&eye, &refined)?;
    known.depth_later_s = found.depth_later_s();
    let pass = Pass { gaps: &CLOCKED_AGAIN, back: &[], coarsest: 1, finest: 0, asks_readout: true, every: again_every };
    for _ in 0..AGAIN {
        let eye = Eye::new(known.geometry.clone());
        let linked = work.links(times::CLOCKS, &eye, &refined, known.depth_later_s, pass)?;
        known.follow(global::readout(&linked.good), 1.0, &mut found);
    }
    let given_s = geometry.intrinsics.readout_time_s;
    if (known.geometry.intrinsics.readout_time_s - given_s).abs() < SAME_READOUT_S {
        known.geometry.intrinsics.readout_time_s = given_s;
    }

    // 4. Once more from there, with links that take no part.
    let gaps: Vec<usize> = LINKED.into_iter().chain(HELD_OUT).collect();
    let pass = Pass { gaps: &gaps, back: &LINKED, coarsest: 1, finest: 0, asks_readout: false, every: 1 };
    let eye = Eye::new(known.geometry.clone());
    let linked = work.links(times::AGAIN, &eye, &refined, known.depth_later_s, pass)?;
    let takes_part = |link: &Link| LINKED.contains(&link.from.abs_diff(link.to));
    let (linked, held_out): (Vec<Link>, Vec<Link>) = linked.good.into_iter().partition(takes_part);
    let by_first: Vec<Twist> = refined.iter().zip(&start).map(|(now, was)| back(now.as_ref(), was.as_ref())).collect();
    let Some(corrections) = work.times.of(times::GRAPH, || graph::solve(&linked, &refined, &by_first)) else {
        return refused("the links' equations have no solution");
    };
    let used = refined;
    let refined = path::with_motion(&recording.timestamps_s, &corrected(&used, &corrections), gap_s(recording));

    // 5. Is it better?
    let as_recorded = recorded(recording, 0.0);
    found.held_out = judged(&held_out, &as_recorded, &refined, &used);
    let middle = |of: fn(&Missed) -> f64| median(&mut found.held_out.iter().map(of).collect::<Vec<_>>());
    let (before, after) = (middle(|missed| missed.recorded_px), middle(|missed| missed.refined_px));
    found.held_out_px = Some((before, after));
    found.readout_s = known.geometry.intrinsics.readout_time_s;
    let correction_px = asked(&linked, &as_recorded, &used);
    found.verdict = if after > WRONG_PX {
        Verdict::Refused(format!("links that took no part still miss by {after:.2} px, more than {WRONG_PX}"))
    } else if correction_px < RIGHT_PX || after > (1.0 - GAINED) * before {
        Verdict::Right
    } else {
        Verdict::Refined
    };
    match found.verdict {
        Verdict::Refined => {
            let refined = in_gauge(&refined, &as_recorded, &linked);
            found.states = repeated(refined, &known.repeats);
            found.repeats = known.repeats;
        }
        _ => found.readout_s = given_s,
    }
    Ok(found)
}

#[derive(Debug, thiserror::Error)]
pub enum RegistrationError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Why no camera can be where the poses would have to be wrong by so much: a wrong focal length moves it along its axis, poses of
/// another recording turn it anywhere.
fn out_of_place(global: &Global) -> Option<String> {
    let (way_m, turn) = (twist::way(&global.hand_eye).length(), twist::turn(&global.hand_eye).length());
    let sigma_m = twist::way(&global.hand_eye_sigma).length();
    let is_far = way_m > MOST_WAY_M && way_m > 3.0 * sigma_m;
    (is_far || turn > MOST_TURN_RAD).then(|| {
        format!(
            "the camera would stand {:.0} mm away from where the poses say, turned by {:.0}°: poses, focal length or the unit of depth are not this recording's",
            1e3 * way_m,
            turn.to_degrees()
        )
    })
}

/// Why no frames were linked. Half of a frame's depth tells whether its unit can be right.
fn apart(recording: &Recording) -> Result<String, RecordingError> {
    let middle = recording.frame_count() / 2;
    let depth = recording.frames(middle..middle + 1)?.next().transpose()?.and_then(|frame| frame.depth);
    let mut known: Vec<f64> =
        depth.iter().flat_map(|map| &map.depth_m).filter(|m| **m > 0.0).map(|m| f64::from(*m)).collect();
    let usual = if known.is_empty() {
        "the middle frame has no depth".to_owned()
    } else {
        let metres = fixed(median(&mut known), 3);
        format!("half of the middle frame's depth is beyond {metres} m; if that is wrong, so is depth's unit")
    };
    Ok(format!("the frames' pictures do not overlap where poses and depth say they do, or lack texture; {usual}"))
}

/// What all frames share.
struct Known {
    geometry: Geometry,
    clock_s: f64,
    hand_eye: Twist,
    depth_later_s: f64,
    repeats: Vec<bool>,
}

impl Known {
    /// Takes a share of what the readout time lacks, with its σ, s.
    fn follow(&mut self, lacks: Option<(f64, f64)>, share: f64, found: &mut Registration) {
        let Some((step_s, sigma_s)) = lacks else { return };
        found.readout_sigma_s = Some(sigma_s);
        if sigma_s < SURE_READOUT_S {
            let readout_s = &mut self.geometry.intrinsics.readout_time_s;
            *readout_s = (*readout_s + share * step_s).clamp(0.0, LONGEST_READOUT_S);
        }
    }

    fn states(&self, recording: &Recording) -> Vec<Option<State>> {
        let all = recorded(recording, self.clock_s).into_iter().zip(&self.repeats);
        all.map(|(state, repeats)| state.filter(|_| !repeats).map(|state| state.corrected(&self.hand_eye))).collect()
    }
}

struct Work<'a> {
    recording: &'a Recording,
    threads: usize,
    done: usize,
    whole: usize,
    times: &'a mut Times,
    told: &'a mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
}

impl Work<'_> {
    fn links(
        &mut self,
        part: &'static str,
        eye: &Eye,
        states: &[Option<State>],
        depth_later_s: f64,
        pass: Pass<'_>,
    ) -> Result<Links, RegistrationError> {
        let begun = Instant::now();
        let (before, whole) = (self.done, self.whole);
        let frames = self.recording.frame_count().div_ceil(pass.every);
        let mut ended = Ok(());
        let found = links(eye, self.recording, states, depth_later_s, pass, self.threads, &mut |seen: usize| {
            let share = (seen + 1) * frames / self.recording.frame_count();
            ended = (self.told)(before + share, whole);
            ended.is_ok()
        })?;
        ended?;
        self.done = before + frames;
        self.times.add(part, begun.elapsed().saturating_sub(found.waited));
        self.times.add(times::READING, found.waited);
        Ok(found)
    }

    fn depth_clock(&mut self, eye: &Eye, states: &[Option<State>]) -> Result<Option<DepthLater>, RecordingError> {
        let mut clock = DepthClock::default();
        let frames = self.recording.frame_count();
        let mut coming = self.recording.frames(0..frames)?.step_by(frames.div_ceil(DEPTH_FRAMES).max(1));
        while let Some(frame) = self.times.of(times::READING, || coming.next()) {
            let frame = frame?;
            if let Some(state) = &states[frame.index] {
                self.times.of(times::DEPTH, || clock.add(eye, &frame, state, self.threads));
            }
        }
        Ok(self.times.of(times::DEPTH, || clock.finish()))
    }
}

fn corrected(states: &[Option<State>], by: &[Twist]) -> Vec<Option<State>> {
    states.iter().zip(by).map(|(state, by)| state.map(|state| state.corrected(by))).collect()
}

/// Links tell how frames stand to each other, not where all of them stand: moved as a whole so that what stands in the world is
/// seen, on the whole, where the recorded poses show it. Least squares over the frames in the links' mean metric.
fn in_gauge(refined: &[Option<State>], recorded: &[Option<State>], links: &[Link]) -> Vec<Option<State>> {
    let metric = links.iter().map(|link| link.metric).sum::<Matrix6<f64>>() / links.len().max(1) as f64;
    let mut whole = DAffine3::IDENTITY;
    for _ in 0..3 {
        let (mut h, mut g) = (Matrix6::zeros(), Twist::zeros());
        for (now, was) in refined.iter().zip(recorded).filter_map(|(now, was)| Some(((*now)?, (*was)?))) {
            let here = whole * now.world_from_camera;
            // log(W⁻¹·exp(x)·here) ≈ off + Ad(here⁻¹)·x.
            let off = twist::log(&(was.world_from_camera.inverse() * here));
            let by = twist::adjoint(&here.inverse());
            let across = by.transpose() * metric;
            h += across * by;
            g -= across * off;
        }
        let Some(step) = h.cholesky().map(|h| h.solve(&g)) else { break };
        whole = twist::exp(&step) * whole;
    }
    let moved = |state: State| State { world_from_camera: whole * state.world_from_camera, ..state };
    refined.iter().map(|state| state.map(moved)).collect()
}

/// A frame that repeats the one before stands and moves where that one does.
fn repeated(mut states: Vec<Option<State>>, repeats: &[bool]) -> Vec<Option<State>> {
    for n in 1..states.len() {
        if repeats[n] {
            states[n] = states[n - 1];
        }
    }
    states
}

fn back(now: Option<&State>, was: Option<&State>) -> Twist {
    let motion = |(now, was): (&State, &State)| twist::log(&(now.world_from_camera.inverse() * was.world_from_camera));
    now.zip(was).map_or(Twist::zeros(), motion)
}

/// Across longer intervals no motion is concluded.
fn gap_s(recording: &Recording) -> f64 {
    MOST_INTERVALS * recording.frame_interval_s
}

/// What links aligned with `used` say is wrong, px: with `before`, and with `after`.
fn judged(links: &[Link], before: &[Option<State>], after: &[Option<State>], used: &[Option<State>]) -> Vec<Missed> {
    let of = |link: &Link| {
        let (recorded_px, refined_px) = (asks(link, before, used)?, asks(link, after, used)?);
        Some(Missed { from: link.from, to: link.to, recorded_px, refined_px })
    };
    links.iter().filter_map(of).collect()
}

/// What links aligned with `used` say is wrong with the poses of `states`, median, px.
fn asked(links: &[Link], states: &[Option<State>], used: &[Option<State>]) -> f64 {
    median(&mut links.iter().filter_map(|link| asks(link, states, used)).collect::<Vec<_>>())
}

fn asks(link: &Link, states: &[Option<State>], used: &[Option<State>]) -> Option<f64> {
    let motion =
        |of: &[Option<State>]| Some(of[link.to]?.world_from_camera.inverse() * of[link.from]?.world_from_camera);
    let seen = motion(used)? * twist::exp(&link.e);
    Some(link.displaced_px(&twist::log(&(motion(states)?.inverse() * seen))))
}
