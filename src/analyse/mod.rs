//! What the footage says of itself: where the camera really was, how its clocks and its shutter run, how bright each frame is.
//!
//! Everything is estimated from the recording alone, with how sure it is, and refused where the footage cannot tell. The result
//! is an [`Analysis`], a folder of text beside the recording, which frames are composited by ([`crate::shot`]). The design
//! follows direct visual odometry (Engel 2018) and pose graphs; each file gives its formulas.

mod accept;
mod align;
mod artefact;
mod blurred;
mod boxes;
mod carried;
mod cross_blur;
mod depth_clock;
mod depths;
mod edges;
mod eye;
mod findings;
mod gain;
mod global;
mod graph;
mod inputs;
mod interrupted;
mod links;
mod mesh;
mod path;
mod pyramid;
mod registration;
mod robust;
mod sharpness;
mod shutter;
mod spread;
mod state;
mod sweep;
mod taken;
mod times;
mod track;
mod view;

pub use accept::{Accepted, Outcome, accept};
pub use artefact::{Analysis, AnalysisError, FILE_NAME, FILES, beside};
pub(crate) use eye::is_same;
pub use findings::Findings;
pub use interrupted::Interrupted;
pub use registration::{Missed, RegistrationError, Verdict};
pub use sharpness::{drawn_spread_px, footage_spread_px, still_frames};
pub use taken::Taken;
pub use times::Times;

use crate::camera::Geometry;
use crate::recording::Recording;
use depths::Depths;
use findings::Gained;
use gain::{GAPS, Gains, Pair};
use shutter::Shutter;

/// Distances of pairs by which the gains are judged, frames.
const HELD_OUT: [usize; 3] = [3, 7, 13];

/// Frames whose light differs by less, ln, root mean square, are equally bright.
const STEADY: f64 = 0.01;

/// Gains that leave more than this share of what they explain, root mean square, are not the camera's: frames that show other
/// places than their poses say differ as well.
const EXPLAINED: f64 = 1.0 / 3.0;

/// Looks at a whole recording, as seen by `camera`. `told(done, of)` hears how far it is, in frames looked at; its error ends
/// the work. The analysis is the same for any number of `threads`, bit for bit; beside it is how long its parts took.
pub fn analyse(
    recording: &Recording,
    camera: &Geometry,
    taken: &Taken<'_>,
    threads: usize,
    told: &mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
) -> Result<(Analysis, Times), RegistrationError> {
    let frames = recording.frame_count();
    let (mut whole, mut times) = (0, Times::default());
    let registration = registration::register(recording, camera, threads, &mut times, &mut |done, of| {
        whole = of;
        told(done, of + frames)
    })?;
    let mut seen_by = camera.clone();
    seen_by.intrinsics.readout_time_s = registration.readout_s;
    let eye = sweep::eye_of(seen_by, recording, &registration.states);
    let gaps: Vec<usize> = GAPS.into_iter().chain(HELD_OUT).collect();
    let mut gains = Gains::new(&eye, taken.response, &gaps, threads);
    let is_placed = !matches!(registration.verdict, Verdict::Refused(_));
    let states = if is_placed { registration.states.as_slice() } else { &[] };
    let mut shutter = Shutter::new(
        &eye,
        taken.response,
        taken.noise,
        states,
        &recording.timestamps_s,
        recording.frame_interval_s,
        threads,
    );
    let later_s = registration.depth_later_s();
    // Poses that are another recording's would compare other things.
    if is_placed {
        let mut depths = Depths::new(&eye, recording, states, later_s, threads)?;
        let mut coming = recording.frames(0..frames)?;
        while let Some(frame) = times.of(times::READING, || coming.next()) {
            let frame = frame?;
            told(whole + frame.index, whole + frames)?;
            if let Some(state) = registration.states[frame.index] {
                let depth = times.of(times::DEPTHS, || depths.of(&eye, &frame, &state))?;
                times.of(times::GAIN, || gains.add(&frame, state, &depth));
                if recording.kind.has_times() {
                    times.of(times::EXPOSURE, || shutter.add(&frame, state, &depth));
                }
            }
        }
    }
    let (used, held_out): (Vec<Pair>, Vec<Pair>) =
        gains.pairs.iter().partition(|pair| GAPS.contains(&(pair.to - pair.from)));
    let found = times.of(times::GAIN, || gain::solve(&used, frames));
    let told_of = gain::left(&held_out, &found).map(|(recorded, left)| Gained {
        pairs: used.len(),
        recorded,
        left,
        range_ev: range_ev(&found),
        is_followed: recorded > STEADY && left < EXPLAINED * recorded,
    });
    let gains_of = if told_of.as_ref().is_some_and(|gain| gain.is_followed) { found } else { Vec::new() };
    let exposed = match (is_placed, recording.kind.has_times()) {
        (true, true) => shutter.finish(),
        (true, false) => Err("the recording keeps no times".to_owned()),
        (false, _) => Err("where the camera was is not known".to_owned()),
    };
    let known = sharpness::Known {
        states: &registration.states,
        depth_later_s: later_s,
        exposed: exposed.as_ref().map_or(&[][..], |exposed| &exposed.runs),
    };
    let spread = times.of(times::SHARPNESS, || sharpness::of_recording(recording, &eye, taken, &known, threads))?;
    Ok((Analysis::new(recording, camera, &registration, told_of, &gains_of, exposed, spread), times))
}

/// Of green, the brightest frame by the darkest, stops.
fn range_ev(gains: &[Option<[f64; 3]>]) -> f64 {
    let green = || gains.iter().flatten().map(|g| g[1]);
    let (low, high) = (green().fold(f64::INFINITY, f64::min), green().fold(f64::NEG_INFINITY, f64::max));
    if high > low { (high - low) / std::f64::consts::LN_2 } else { 0.0 }
}
