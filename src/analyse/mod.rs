//! What the footage says of itself: where the camera really was, how its clocks and its shutter run, how bright each frame is.
//!
//! Everything is estimated from the recording alone, with how sure it is, and refused where the footage cannot tell. The result
//! is an [`Analysis`], a folder of text beside the recording, which frames are composited by ([`crate::shot`]). The design
//! follows direct visual odometry (Engel 2018) and pose graphs; each file gives its formulas.

mod accept;
mod across;
mod align;
mod artefact;
mod blurred;
mod boxes;
mod carried;
mod clocks;
mod cross_blur;
mod dependencies;
mod depth_clock;
mod depths;
mod edges;
mod eye;
mod findings;
mod found_light;
mod fusion;
mod gain;
mod gain_graph;
mod global;
mod graph;
mod ground;
mod inputs;
mod interrupted;
mod judging;
mod light;
mod light_table;
mod link_blur;
mod links;
mod lit_anew;
mod mesh;
mod moving;
mod noise_level;
mod part;
mod path;
mod progress;
mod pyramid;
mod reading;
mod recorded_way;
mod registered;
mod registration;
mod robust;
mod sharpness;
mod shutter;
mod spread;
mod stale;
mod state;
mod surfel_file;
mod sweep;
mod taken;
mod times;
mod tone;
mod track;
mod unlinked;
mod view;
mod working;
mod written;

pub use accept::{Accepted, Outcome, accept};
pub use across::Fitted;
pub use artefact::{Analysis, AnalysisError, ENVIRONMENT, FILE_NAME, beside, digest};
pub(crate) use blurred::unit_noise;
pub(crate) use eye::is_same;
pub use findings::Findings;
pub use found_light::{Environment, FoundLight};
pub use ground::{Ground, KnownBy, write_grounds};
pub use interrupted::Interrupted;
pub use light::{FoundLamp, LAMP_M, MOST_LAMPS, WHITE};
pub use light_table::panorama_beside;
pub use lit_anew::lit_anew;
pub use part::Part;
pub use progress::{Progress, Stage};
pub(crate) use pyramid::{Plane, gaussian};
pub use registered::{Missed, RegistrationError, Verdict};
pub use sharpness::{drawn_spread_px, footage_spread_px, still_frames};
pub use spread::EDGES_STEP_PX;
pub use taken::Taken;
pub use times::Times;
pub use tone::Band as ToneBand;
pub use written::{check_folder, check_writable};

use std::time::Instant;

use glam::DQuat;
use serde::{Deserialize, Serialize};

use crate::camera::Geometry;
use crate::frame::Surfel;
use crate::pose::held_up;
use crate::recording::Recording;
use across::OfPair;
use depths::Depths;
use eye::Eye;
use findings::Gained;
use gain::{GAPS, Gains, Pair};
use progress::{Passes, by_the_clock};
use shutter::{Said, Shutter};
use state::State;
use tone::Toned;

/// Distances of pairs by which the gains are judged, frames.
const HELD_OUT: [usize; 3] = [3, 7, 13];

/// Frames whose light differs by less, ln, root mean square, are equally bright.
const STEADY: f64 = 0.01;
/// The same by refused poses that nothing confirms. Small gains of neighbouring frames are then wrong by up to ln 0.003 each.
const STEADY_BY_UNSURE_POSES: f64 = 0.1;

/// Gains that leave more than this share of what they explain, root mean square, are not the camera's: frames that show other
/// places than their poses say differ as well.
const EXPLAINED: f64 = 1.0 / 3.0;

/// Analyses a whole recording taken with `camera`. `told` receives the progress; its error ends
/// the work, and `part` keeps the finished stages. The analysis is the same for any number of
/// `threads`, bit for bit. The second result is the time of each part.
pub fn analyse(
    recording: &Recording,
    camera: &Geometry,
    taken: &Taken<'_>,
    threads: usize,
    part: &mut Part,
    told: &mut dyn FnMut(Progress) -> Result<(), Interrupted>,
) -> Result<(Analysis, Times), RegistrationError> {
    let frames = recording.frame_count();
    let mut passes = Passes { path: 0, exposure: frames };
    let mut times = Times::default();
    let begun = Instant::now();
    let registration =
        registration::register(recording, camera, taken.noise, threads, part, &mut times, &mut |done, of| {
            passes.path = of;
            told(passes.progress(Stage::Path, done))
        })?;
    let mut seen_by = camera.clone();
    seen_by.intrinsics.readout_time_s = registration.readout_s;
    let eye = sweep::eye_of(seen_by, recording, &registration.states);
    let is_refused = matches!(registration.verdict, Verdict::Refused(_));
    // A clock of depth that was found by refused poses is none.
    let later_s = if is_refused { 0.0 } else { registration.depth_later_s() };
    let states = registration.states.as_slice();
    let compared = part.stage(|| {
        compared(recording, &eye, taken, (states, later_s), is_refused, threads, &mut times, &mut |n| {
            told(passes.progress(Stage::Exposure, n))
        })
    })?;
    // Registration fails for reasons that leave the poses good enough for brightness, blur and light.
    let is_placed = !is_refused || compared.tried.confirms_poses();
    let (used, held_out): (Vec<Pair>, Vec<Pair>) =
        compared.pairs.iter().partition(|pair| GAPS.contains(&(pair.to - pair.from)));
    let found = times.of(times::GAIN, || gain_graph::solve(&used, frames));
    let steady = if is_placed { STEADY } else { STEADY_BY_UNSURE_POSES };
    let told_of = gain_graph::left(&held_out, &found).map(|(recorded, left)| Gained {
        pairs: used.len(),
        recorded,
        left,
        range_ev: range_ev(&found),
        is_followed: recorded > steady && left < EXPLAINED * recorded,
    });
    let gains_of = if told_of.as_ref().is_some_and(|gain| gain.is_followed) { found } else { Vec::new() };
    let across = match gains_of.is_empty() || !is_placed {
        true => None,
        false => times.of(times::GAIN, || across::solve(&compared.across, frames)),
    };
    let exposed = match is_placed {
        true => compared.said.exposed(frames),
        false => Err("where the camera was is not known".to_owned()),
    };
    let known = sharpness::Known {
        states: &registration.states,
        depth_later_s: later_s,
        exposed: exposed.as_ref().map_or(&[][..], |exposed| &exposed.runs),
    };
    let passes_took = begun.elapsed();
    told(passes.progress(Stage::Sharpness, 0))?;
    let spread = times.of(times::SHARPNESS, || sharpness::of_recording(recording, &eye, taken, &known, threads))?;
    told(passes.progress(Stage::Light, 0))?;
    let factors = artefact::filled(&gains_of);
    let rotation = |state: &State| DQuat::from_mat3(&state.world_from_camera.matrix3);
    let known = light::Known {
        recording,
        eye: &eye,
        response: taken.response,
        states,
        later_s,
        gains: &factors,
        up: recording.up.unwrap_or_else(|| held_up(states.iter().flatten().map(rotation))),
        threads,
    };
    let (light, surfels) = if is_placed {
        let work = || -> Result<_, RegistrationError> {
            let surfels = if is_refused { Vec::new() } else { part.stage(|| fusion::surfels(&known, &mut times))? };
            Ok((part.stage(|| light::of_recording(&known, None, &mut times))?, surfels))
        };
        by_the_clock(work, &mut |elapsed| {
            told(passes.progress(Stage::Light, passes.light_after(elapsed, passes_took)))
        })??
    } else {
        (Err("where the camera was is not known".to_owned()), Vec::new())
    };
    let surfels: Vec<Surfel> = surfels.into_iter().map(Surfel::from_array).collect();
    let tone = match (is_placed, gains_of.is_empty()) {
        (true, false) => tone::bands(&compared.toned),
        (true, true) => Err("frames are equally bright".to_owned()),
        (false, _) => Err("where the camera was is not known".to_owned()),
    };
    let told_of = match told_of {
        Some(gain) if !is_placed && !gain.is_followed => {
            Err("the poses were refused, and without them the pictures do not tell it".to_owned())
        }
        told_of => told_of.ok_or_else(|| compared.tried.why()),
    };
    let found = artefact::Found { gain: told_of, gains: &gains_of, across, exposed, spread, tone, light, surfels };
    Ok((Analysis::new(recording, camera, &registration, found), times))
}

/// What one more pass over the recording gives.
#[derive(Default, Serialize, Deserialize)]
struct Compared {
    pairs: Vec<Pair>,
    said: Said,
    toned: Vec<Toned>,
    across: Vec<OfPair>,
    tried: gain::Tried,
}

/// `states`: one per frame, with what is added to the depth maps' times, s. `is_unsure`: whether registration refused them.
#[expect(clippy::too_many_arguments)]
fn compared(
    recording: &Recording,
    eye: &Eye,
    taken: &Taken<'_>,
    (states, later_s): (&[Option<State>], f64),
    is_unsure: bool,
    threads: usize,
    times: &mut Times,
    told: &mut dyn FnMut(usize) -> Result<(), Interrupted>,
) -> Result<Compared, RegistrationError> {
    let gaps: Vec<usize> = GAPS.into_iter().chain(HELD_OUT).collect();
    let mut gains = Gains::new(eye, taken, &gaps, is_unsure, threads);
    let (times_s, interval_s) = (&recording.timestamps_s, recording.frame_interval_s);
    let mut shutter = Shutter::new(eye, taken.response, taken.noise, states, times_s, interval_s, threads);
    let mut depths = Depths::new(eye, recording, states, later_s, threads)?;
    let mut coming = recording.frames(0..recording.frame_count())?;
    while let Some(frame) = times.of(times::READING, || coming.next()) {
        let frame = frame?;
        told(frame.index)?;
        if let Some(state) = states[frame.index] {
            let depth = times.of(times::DEPTHS, || depths.of(eye, &frame, &state))?;
            times.of(times::GAIN, || gains.add(&frame, state, &depth, recording.landmarks(frame.index)));
            times.of(times::EXPOSURE, || shutter.add(&frame, state, &depth));
        }
    }
    Ok(Compared {
        pairs: gains.pairs,
        said: shutter.said(),
        toned: gains.toned,
        across: gains.across,
        tried: gains.tried,
    })
}

/// Of green, the brightest frame by the darkest, stops.
fn range_ev(gains: &[Option<[f64; 3]>]) -> f64 {
    let green = || gains.iter().flatten().map(|g| g[1]);
    let (low, high) = (green().fold(f64::INFINITY, f64::min), green().fold(f64::NEG_INFINITY, f64::max));
    if high > low { (high - low) / std::f64::consts::LN_2 } else { 0.0 }
}
