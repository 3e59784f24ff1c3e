//! What is wrong in all poses alike: their clock, where the camera sits on what was tracked; the readout time and depth's clock.

use super::eye::Eye;
use super::global::{self, Global};
use super::link_blur::assumed_exposure_s;
use super::links::Pass;
use super::registered::{Registration, RegistrationError, SURE_READOUT_S, recorded};
use super::robust::median;
use super::state::State;
use super::times;
use super::unlinked::unlinked;
use super::working::Work;
use crate::camera::Geometry;
use crate::fit::twist::{self, Twist};
use crate::recording::Recording;

const CLOCKED: [usize; 2] = [2, 4];
const CLOCKED_AGAIN: [usize; 2] = [2, 5];
/// Rounds of clock, seven numbers and readout; of the readout by refined poses.
pub const ROUNDS: usize = 4;
pub const AGAIN: usize = 2;
/// Frames that are looked at for the clocks, and for the readout by refined poses.
pub const CLOCK_FRAMES: usize = 45;
pub const AGAIN_FRAMES: usize = 90;
/// Of a step of the readout that is taken.
const DAMPED: f64 = 0.7;
/// Fewer links say nothing.
const LEAST_LINKS: usize = 12;
/// A camera stands no farther than this from what was tracked, m, and is not turned against it by more, rad.
const MOST_WAY_M: f64 = 0.1;
const MOST_TURN_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// No readout is longer, s.
const LONGEST_READOUT_S: f64 = 0.05;
/// A readout time that differs by less is what was given, s.
const SAME_READOUT_S: f64 = 0.002;
/// Poses whose links ask for less than this are right, px.
pub const RIGHT_PX: f64 = 0.25;

/// What all frames share.
pub struct Known {
    pub geometry: Geometry,
    pub clock_s: f64,
    pub hand_eye: Twist,
    pub depth_later_s: f64,
    pub repeats: Vec<bool>,
}

impl Known {
    pub fn new(geometry: &Geometry, frames: usize) -> Self {
        Self {
            geometry: geometry.clone(),
            clock_s: 0.0,
            hand_eye: Twist::zeros(),
            depth_later_s: 0.0,
            repeats: vec![false; frames],
        }
    }

    /// Takes a share of what the readout time lacks, with its σ, s.
    fn follow(&mut self, lacks: Option<(f64, f64)>, share: f64, found: &mut Registration) {
        let Some((step_s, sigma_s)) = lacks else { return };
        found.readout_sigma_s = Some(sigma_s);
        if sigma_s < SURE_READOUT_S {
            let readout_s = &mut self.geometry.intrinsics.readout_time_s;
            *readout_s = (*readout_s + share * step_s).clamp(0.0, LONGEST_READOUT_S);
        }
    }

    /// As recorded, with what is known by now.
    pub fn states(&self, recording: &Recording) -> Vec<Option<State>> {
        let all = recorded(recording, self.clock_s).into_iter().zip(&self.repeats);
        all.map(|(state, repeats)| state.filter(|_| !repeats).map(|state| state.corrected(&self.hand_eye))).collect()
    }
}

/// Clock, readout and the camera's place by a few links of recorded poses; why they cannot be this recording's, if so.
pub fn first(
    work: &mut Work<'_>,
    known: &mut Known,
    found: &mut Registration,
) -> Result<Option<String>, RegistrationError> {
    let recording = work.recording;
    let every = recording.frame_count().div_ceil(CLOCK_FRAMES);
    let exposure_s = assumed_exposure_s(recording.frame_interval_s);
    let mut asks_px = 0.0;
    for round in 0..ROUNDS {
        // After the first, what is left is small.
        let coarsest = if round == 0 { usize::MAX } else { 1 };
        let finds_repeats = round == 0;
        let pass = Pass {
            gaps: &CLOCKED,
            back: &[],
            rare: (&[], 1),
            coarsest,
            finest: 1,
            asks_readout: true,
            every,
            finds_repeats,
        };
        let eye = Eye::new(known.geometry.clone());
        let states = known.states(recording);
        if round == 1 {
            found.depth = work.depth_clock(&eye, &states)?;
            known.depth_later_s = found.depth_later_s();
        }
        let linked = work.links(times::CLOCKS, &eye, &states, known.depth_later_s, pass)?;
        if finds_repeats {
            known.repeats.clone_from(&linked.repeats);
            asks_px = median(&mut linked.good.iter().map(|link| link.displaced_px(&link.e)).collect::<Vec<_>>());
        }
        let global =
            global::global(&linked.good, &states, true, exposure_s).filter(|_| linked.good.len() >= LEAST_LINKS);
        let Some(global) = global else {
            let fit = linked.good.len();
            let links = (fit, fit + linked.refused, LEAST_LINKS);
            let reason = unlinked(recording, &known.geometry, &states, links, CLOCKED[0])?;
            return Ok(Some(reason));
        };
        // Small corrections of an already corrected place add up.
        known.hand_eye = twist::log(&(twist::exp(&known.hand_eye) * twist::exp(&global.hand_eye)));
        known.clock_s += global.clock_s;
        found.global = Some(Global { hand_eye: known.hand_eye, clock_s: known.clock_s, ..global });
        known.follow(global::readout(&linked.good), DAMPED, found);
    }
    if let Some(reason) = found.global.as_ref().filter(|_| asks_px > RIGHT_PX).and_then(out_of_place) {
        return Ok(Some(reason));
    }
    // The clock offset keeps the value of the joint estimate: without a hand-eye offset in the fit it
    // would be biased.
    if let Some(global) = found.global.as_mut().filter(|global| !global.is_hand_eye_significant()) {
        global.hand_eye = Twist::zeros();
        known.hand_eye = Twist::zeros();
    }
    Ok(None)
}

/// Recorded jitter makes the readout look short; refined poses have none. `given_s`: what the camera's profile says.
pub fn again(
    work: &mut Work<'_>,
    known: &mut Known,
    found: &mut Registration,
    refined: &[Option<State>],
    given_s: f64,
) -> Result<(), RegistrationError> {
    found.depth = work.depth_clock(&Eye::new(known.geometry.clone()), refined)?;
    known.depth_later_s = found.depth_later_s();
    let every = work.recording.frame_count().div_ceil(AGAIN_FRAMES);
    let pass = Pass {
        gaps: &CLOCKED_AGAIN,
        back: &[],
        rare: (&[], 1),
        coarsest: 1,
        finest: 0,
        asks_readout: true,
        every,
        finds_repeats: false,
    };
    for _ in 0..AGAIN {
        let eye = Eye::new(known.geometry.clone());
        let linked = work.links(times::CLOCKS, &eye, refined, known.depth_later_s, pass)?;
        known.follow(global::readout(&linked.good), 1.0, found);
    }
    if (known.geometry.intrinsics.readout_time_s - given_s).abs() < SAME_READOUT_S {
        known.geometry.intrinsics.readout_time_s = given_s;
    }
    Ok(())
}

/// Why no camera can be where the poses would have to be wrong by so much: a wrong focal length moves it along its axis, poses of
/// another recording turn it anywhere.
fn out_of_place(global: &Global) -> Option<String> {
    let (way_m, turn) = (twist::way(&global.hand_eye).length(), twist::turn(&global.hand_eye).length());
    let sigma_m = twist::way(&global.hand_eye_sigma).length();
    let is_far = way_m > MOST_WAY_M && way_m > 3.0 * sigma_m;
    (is_far || turn > MOST_TURN_RAD).then(|| {
        format!(
            "the camera would stand {:.0} mm away from where the poses say, turned by {:.0}° (at most {:.0} mm and {:.0}°): poses, focal \
             length or the unit of depth are not this recording's",
            1e3 * way_m,
            turn.to_degrees(),
            1e3 * MOST_WAY_M,
            MOST_TURN_RAD.to_degrees()
        )
    })
}
