//! Where the camera really was: what was recorded, corrected by the pictures.
//!
//! In turn: clocks, readout and depth's delay on a few links; seven numbers that are wrong in all poses alike ([`clocks`]); a
//! graph of links between frames 1 to 20 apart; once more with the motion by the refined poses, which recorded jitter spoils.
//! Then a gate: links that are held out of the fit (3 and 7 apart) say how much was wrong and how much still is. They share the
//! aligner's own bias and flatter small corrections, so poses that are nearly right are kept as they were recorded, bit for bit.
//!
//! Where no depth was measured, poses stay, and only the motion is the pictures' ([`moving`]).

use super::align::Link;
use super::clocks::{self, AGAIN, AGAIN_FRAMES, CLOCK_FRAMES, Known, RIGHT_PX, ROUNDS};
use super::eye::Eye;
use super::graph;
use super::interrupted::Interrupted;
use super::judging::{asked, in_gauge, judged, repeated};
use super::link_blur::assumed_exposure_s;
use super::links::Pass;
use super::moving;
use super::part::Part;
use super::path;
use super::recorded_way::moves_as_recorded;
use super::registered::{Missed, Registration, RegistrationError, Verdict, recorded};
use super::robust::median;
use super::state::State;
use super::times::{self, Times};
use super::track::MOST_INTERVALS;
use super::working::Work;
use crate::camera::{Geometry, NoiseProfile};
use crate::fit::twist::{self, Twist};
use crate::recording::Recording;

/// Distances between linked frames.
const LINKED: [usize; 5] = [1, 2, 5, 10, 20];
const HELD_OUT: [usize; 2] = [3, 7];
/// Recordings with more frames are linked sparsely: later frames to earlier ones only where these are so many apart, and one link
/// in so many is held out.
const LONG: usize = 1000;
const LONG_BACK: [usize; 0] = [];
const LONG_HELD_OUT: usize = 4;
/// Held-out links must fit better by this share.
const GAINED: f64 = 0.3;
/// Refused above this, px, or with so many links missing.
const WRONG_PX: f64 = 0.75;
const MISSING: f64 = 0.25;

/// `noise`: the camera's, if that was calibrated. `told(done, of)`: how far it is, in frames; an error ends it.
pub fn register(
    recording: &Recording,
    geometry: &Geometry,
    noise: Option<&NoiseProfile>,
    threads: usize,
    part: &mut Part,
    times: &mut Times,
    told: &mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
) -> Result<Registration, RegistrationError> {
    let frames = recording.frame_count();
    let as_recorded = |verdict: Verdict| Registration::as_recorded(recording, geometry, verdict);
    if let Some(why) = unfit(recording, geometry) {
        return Ok(as_recorded(Verdict::Kept(why.to_owned())));
    }
    if !recording.has_depth() {
        const WHY: &str = "there is no depth to align them by";
        // What poses are wrong by is known in metres and by the time between frames.
        if !(recording.kind.is_metric() && recording.kind.has_times()) {
            return Ok(as_recorded(Verdict::Kept(WHY.to_owned())));
        }
        let mut work = Work { recording, noise, threads, part, done: 0, whole: frames, times, told };
        return moving::kept(&mut work, geometry, WHY);
    }
    let [every, again_every] = [CLOCK_FRAMES, AGAIN_FRAMES].map(|most| frames.div_ceil(most));
    let whole = ROUNDS * frames.div_ceil(every) + AGAIN * frames.div_ceil(again_every) + 2 * frames;
    let mut work = Work { recording, noise, threads, part, done: 0, whole, times, told };
    let mut known = Known::new(geometry, frames);
    let mut found = as_recorded(Verdict::Right);
    let given_s = geometry.intrinsics.readout_time_s;
    let refused = |why: String, found: Registration| Ok(Registration { verdict: Verdict::Refused(why), ..found });

    // 1. What is wrong in all poses alike.
    if let Some(why) = clocks::first(&mut work, &mut known, &mut found)? {
        return refused(why, found);
    }

    // 2. All frames, at once.
    let (back_gaps, held_out_every): (&[usize], usize) =
        if frames > LONG { (&LONG_BACK, LONG_HELD_OUT) } else { (&LINKED, 1) };
    let first = Pass {
        gaps: &LINKED,
        back: back_gaps,
        rare: (&[], 1),
        coarsest: usize::MAX,
        finest: 1,
        asks_readout: false,
        every: 1,
        finds_repeats: false,
    };
    let start = known.states(recording);
    let eye = Eye::new(known.geometry.clone());
    let linked = work.links(times::LINKS, &eye, &start, known.depth_later_s, first)?;
    (found.links, found.missing) = (linked.good.len(), linked.refused);
    let whole = linked.good.len() + linked.refused;
    let comparable = whole - linked.few_points;
    let mismatched = linked.refused - linked.few_points;
    let share = 100.0 * linked.refused as f64 / whole.max(1) as f64;
    if linked.refused as f64 > MISSING * whole as f64 && mismatched as f64 <= MISSING * comparable as f64 {
        let others = match comparable {
            0 => String::new(),
            _ => format!(". Of the others {:.0} % fit", 100.0 * linked.good.len() as f64 / comparable as f64),
        };
        let why = format!(
            "{share:.0} % of the links between frames cannot be made (at most {:.0} %): where the poses put them, {} pairs of \
             frames share too little that has texture and depth; blank surfaces, much blur or steps between frames do that{others}",
            100.0 * MISSING,
            linked.few_points
        );
        return refused(why, found);
    }
    if linked.refused as f64 > MISSING * whole as f64 {
        // Links between pictures of little contrast say nothing of the poses.
        let faint =
            if 2 * linked.faint > linked.refused { "the pictures' contrast is hardly above their noise, " } else { "" };
        let why = format!(
            "{share:.0} % of the links between frames do not fit (at most {:.0} %): {faint}the poses, the focal length or the depth are not this \
             recording's, its frames are not in their order, or something that fills much of the picture moves",
            100.0 * MISSING
        );
        return refused(why, found);
    }
    let none = vec![Twist::zeros(); frames];
    let Some(refined) = solved(&mut work, &linked.good, &start, &none) else {
        return refused(NO_SOLUTION.to_owned(), as_recorded(Verdict::Right));
    };

    // 3. What jitter has hidden.
    clocks::again(&mut work, &mut known, &mut found, &refined, given_s)?;

    // 4. Once more from there, with links that are held out of the fit.
    let again = Pass { rare: (&HELD_OUT, held_out_every), coarsest: 1, finest: 0, ..first };
    let eye = Eye::new(known.geometry.clone());
    let linked = work.links(times::AGAIN, &eye, &refined, known.depth_later_s, again)?;
    let takes_part = |link: &Link| LINKED.contains(&link.from.abs_diff(link.to));
    let (linked, held_out): (Vec<Link>, Vec<Link>) = linked.good.into_iter().partition(takes_part);
    let by_first: Vec<Twist> = refined.iter().zip(&start).map(|(now, was)| back(now.as_ref(), was.as_ref())).collect();
    let used = refined;
    let Some(refined) = solved(&mut work, &linked, &used, &by_first) else {
        return refused(NO_SOLUTION.to_owned(), as_recorded(Verdict::Right));
    };

    // 5. Is it better?
    let before = recorded(recording, 0.0);
    found.held_out = judged(&held_out, &before, &refined, &used);
    let middle = |of: fn(&Missed) -> f64| median(&mut found.held_out.iter().map(of).collect::<Vec<_>>());
    let (recorded_px, refined_px) = (middle(|missed| missed.recorded_px), middle(|missed| missed.refined_px));
    found.held_out_px = Some((recorded_px, refined_px));
    if refined_px > WRONG_PX {
        return refused(
            format!(
                "refined poses agree with the alignment of held-out frame pairs to {refined_px:.2} px only; at most {WRONG_PX} px \
                 is accepted"
            ),
            found,
        );
    }
    if asked(&linked, &before, &used) >= RIGHT_PX && refined_px <= (1.0 - GAINED) * recorded_px {
        let refined = in_gauge(&refined, &before, &linked);
        found.verdict = Verdict::Refined;
        found.readout_s = known.geometry.intrinsics.readout_time_s;
        found.states = repeated(refined, &known.repeats);
        found.repeats = known.repeats;
    }
    Ok(found)
}

const NO_SOLUTION: &str = "the links' equations have no solution";

/// Why poses cannot be checked at all.
fn unfit(recording: &Recording, geometry: &Geometry) -> Option<&'static str> {
    if geometry.sees_around() {
        return Some("the picture does not fit a plane in front of the camera");
    }
    if recorded(recording, 0.0).iter().flatten().count() < 3 {
        return Some("fewer than three frames have a pose");
    }
    None
}

/// All frames by their links, with the motion that their poses tell. `None` if the equations have no solution.
fn solved(
    work: &mut Work<'_>,
    links: &[Link],
    states: &[Option<State>],
    held_at: &[Twist],
) -> Option<Vec<Option<State>>> {
    let recording = work.recording;
    let exposure_s = assumed_exposure_s(recording.frame_interval_s);
    let by = work.times.of(times::GRAPH, || graph::solve(links, states, held_at, exposure_s))?;
    let corrected: Vec<_> = states.iter().zip(&by).map(|(state, by)| state.map(|state| state.corrected(by))).collect();
    if moves_as_recorded(recording) {
        return Some(corrected);
    }
    // Across longer intervals no motion is concluded.
    let gap_s = MOST_INTERVALS * recording.frame_interval_s;
    Some(path::with_motion(&recording.timestamps_s, &corrected, gap_s))
}

fn back(now: Option<&State>, was: Option<&State>) -> Twist {
    let motion = |(now, was): (&State, &State)| twist::log(&(now.world_from_camera.inverse() * was.world_from_camera));
    now.zip(was).map_or(Twist::zeros(), motion)
}
