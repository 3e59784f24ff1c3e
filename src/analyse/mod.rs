//! What the footage says of itself: where the camera really was, how its clocks and its shutter run, how bright each frame is.
//!
//! Everything is estimated from the recording alone, with how sure it is, and refused where the footage cannot tell. The result
//! is an [`Analysis`], a folder of text beside the recording, which frames are composited by ([`crate::shot`]). The design
//! follows direct visual odometry (Engel 2018) and pose graphs; each file gives its formulas.

mod align;
mod artefact;
mod blurred;
mod boxes;
mod carried;
mod cross_blur;
mod depth_clock;
mod edges;
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
mod shutter;
mod spread;
mod state;
mod track;
mod view;

pub use artefact::{Analysis, AnalysisError, FILE_NAME, FILES, beside};
pub use findings::Findings;
pub use interrupted::Interrupted;
pub use registration::{RegistrationError, Verdict};

use crate::camera::{Geometry, NoiseProfile, Response};
use crate::frame::Frame;
use crate::recording::{Recording, RecordingError};
use findings::Gained;
use gain::{GAPS, Gains, Pair};
use registration::Registration;
use shutter::{Run, Shutter};
use spread::{Motion, PointSpread, Spreads, chosen};
use view::{Eye, View};

/// Distances of pairs by which the gains are judged, frames.
const HELD_OUT: [usize; 3] = [3, 7, 13];

/// Frames whose light differs by less, ln, root mean square, are equally bright.
const STEADY: f64 = 0.01;

/// What is known of the camera besides its geometry.
pub struct Taken<'a> {
    pub response: &'a Response,
    /// Its noise, if that was calibrated.
    pub noise: Option<&'a NoiseProfile>,
    /// How long a frame's rows gather light, s, by what is known of the frame.
    pub exposure_s: &'a dyn Fn(&Frame) -> f64,
}

/// Looks at a whole recording, as seen by `camera`. `told(done, of)` hears how far it is, in frames looked at; its error ends
/// the work. The result is the same for any number of `threads`, bit for bit.
pub fn analyse(
    recording: &Recording,
    camera: &Geometry,
    taken: &Taken<'_>,
    threads: usize,
    told: &mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
) -> Result<Analysis, RegistrationError> {
    let frames = recording.frame_count();
    let mut whole = 0;
    let registration = registration::register(recording, camera, threads, &mut |done, of| {
        whole = of;
        told(done, of + frames)
    })?;
    let mut seen_by = camera.clone();
    seen_by.intrinsics.readout_time_s = registration.readout_s;
    let eye = Eye::new(seen_by);
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
    // Poses that are another recording's would compare other things.
    if is_placed {
        for frame in recording.frames(0..frames)? {
            let frame = frame?;
            told(whole + frame.index, whole + frames)?;
            if let Some(state) = registration.states[frame.index] {
                let depth = View::depth_of(&eye, &frame, &state, registration.depth_later_s());
                gains.add(&frame, state, &depth);
                shutter.add(&frame, state, &depth);
            }
        }
    }
    let (used, held_out): (Vec<Pair>, Vec<Pair>) =
        gains.pairs.iter().partition(|pair| GAPS.contains(&(pair.to - pair.from)));
    let found = gain::solve(&used, frames);
    let told_of = gain::left(&held_out, &found).map(|(recorded, left)| Gained {
        pairs: used.len(),
        recorded,
        left,
        range_ev: range_ev(&found),
        is_followed: recorded > STEADY.max(2.0 * left),
    });
    let gains_of = if told_of.as_ref().is_some_and(|gain| gain.is_followed) { found } else { Vec::new() };
    let exposed = if is_placed { shutter.finish() } else { Err("where the camera was is not known".to_owned()) };
    let spread = point_spread(recording, &eye, taken, &registration, exposed.as_deref().unwrap_or_default(), threads)?;
    Ok(Analysis::new(recording, camera, &registration, told_of, &gains_of, exposed, spread))
}

/// The camera's sharpness, from some of the frames, or why it is not known.
fn point_spread(
    recording: &Recording,
    eye: &Eye,
    taken: &Taken<'_>,
    registration: &Registration,
    exposed: &[Run],
    threads: usize,
) -> Result<Result<PointSpread, String>, RecordingError> {
    let mut spreads = Spreads::new(eye, taken.response, if recording.bits > 8 { 0xffff } else { 0xff }, threads);
    for n in chosen(&registration.states) {
        let Some(state) = registration.states[n] else { continue };
        for frame in recording.frames(n..n + 1)? {
            let mut frame = frame?;
            let run = exposed.iter().find(|run| (run.from..run.to).contains(&n));
            frame.exposure.blurred_s = run.map(|run| run.exposure_s);
            let depth = View::depth_of(eye, &frame, &state, registration.depth_later_s());
            spreads.add(&frame, &Motion { state: &state, depth: &depth, exposure_s: (taken.exposure_s)(&frame) });
        }
    }
    Ok(spreads.finish())
}

/// Of green, the brightest frame by the darkest, stops.
fn range_ev(gains: &[Option<[f64; 3]>]) -> f64 {
    let green = || gains.iter().flatten().map(|g| g[1]);
    let (low, high) = (green().fold(f64::INFINITY, f64::min), green().fold(f64::NEG_INFINITY, f64::max));
    if high > low { (high - low) / std::f64::consts::LN_2 } else { 0.0 }
}
