//! Estimates the parameters that all frames share: clock offset, hand-eye offset, readout time and
//! the clock offset of depth.

use super::camera_model::CameraModel;
use super::link_failure::{self, LinkCounts};
use super::links::LinkPass;
use super::pass_runner::PassRunner;
use super::registration_result::{MAX_READOUT_SIGMA_S, Registration, RegistrationError, recorded};
use super::rig_offset::{self, ReadoutStep, RigOffset};
use super::state::CameraState;
use super::times;
use crate::camera::Geometry;
use crate::camera::exposure::assumed_exposure_s;
use crate::fit::quantile::upper_median;
use crate::fit::twist::{self, Twist};
use crate::recording::Recording;

/// Distances between linked frames, with recorded and with refined poses.
const CLOCK_GAPS: [usize; 2] = [2, 4];
const REFINED_CLOCK_GAPS: [usize; 2] = [2, 5];
/// Iterations with recorded poses: clock, hand-eye offset and readout. Iterations with refined
/// poses: readout.
pub const CLOCK_ITERATIONS: usize = 4;
pub const REFINED_CLOCK_ITERATIONS: usize = 2;
/// Largest number of frames that are linked to later ones, with recorded and with refined poses.
pub const CLOCK_FRAMES: usize = 45;
pub const REFINED_CLOCK_FRAMES: usize = 90;
/// Fraction of a readout step that is taken with recorded poses.
const READOUT_DAMPING: f64 = 0.7;
/// Smallest number of links for an estimate.
const MIN_LINKS: usize = 12;
/// Largest plausible hand-eye offset, m and rad.
const MAX_HAND_EYE_M: f64 = 0.1;
const MAX_HAND_EYE_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Longest readout time, s.
const MAX_READOUT_S: f64 = 0.05;
/// A readout time that differs by less from the given one is replaced by it, s.
const READOUT_TOLERANCE_S: f64 = 0.002;
/// Poses with a smaller median residual are right, px.
pub const RIGHT_PX: f64 = 0.25;

/// The parameters that all frames share.
pub struct SharedParameters {
    /// Its readout time is estimated.
    pub geometry: Geometry,
    /// Added to a frame's time to look up its pose, s.
    pub clock_s: f64,
    /// Appended to every pose, in the camera's axes.
    pub hand_eye: Twist,
    /// Added to the depth maps' times, s.
    pub depth_later_s: f64,
    /// One per frame: whether its picture has the code values of the one before.
    pub repeats: Vec<bool>,
}

impl SharedParameters {
    pub fn new(geometry: &Geometry, frames: usize) -> Self {
        Self {
            geometry: geometry.clone(),
            clock_s: 0.0,
            hand_eye: Twist::zeros(),
            depth_later_s: 0.0,
            repeats: vec![false; frames],
        }
    }

    /// Takes a fraction of a readout step, if it is certain.
    fn update_readout(&mut self, step: Option<ReadoutStep>, share: f64, registration: &mut Registration) {
        let Some(ReadoutStep { step_s, sigma_s, parts_sigma_s }) = step else { return };
        (registration.readout_sigma_s, registration.readout_parts_sigma_s) = (Some(sigma_s), parts_sigma_s);
        if sigma_s < MAX_READOUT_SIGMA_S {
            let readout_s = &mut self.geometry.intrinsics.readout_time_s;
            *readout_s = (*readout_s + share * step_s).clamp(0.0, MAX_READOUT_S);
        }
    }

    /// The recorded poses, corrected by clock and hand-eye offset. `None` for repeated pictures and
    /// frames without a pose.
    pub fn states(&self, recording: &Recording) -> Vec<Option<CameraState>> {
        let all = recorded(recording, self.clock_s).into_iter().zip(&self.repeats);
        all.map(|(state, repeats)| state.filter(|_| !repeats).map(|state| state.corrected(&self.hand_eye))).collect()
    }
}

/// Estimates clock, hand-eye offset and readout by a few links of recorded poses. Returns a reason
/// if the poses cannot be those of this recording.
pub fn estimate(
    runner: &mut PassRunner<'_>,
    shared: &mut SharedParameters,
    registration: &mut Registration,
) -> Result<Option<String>, RegistrationError> {
    let recording = runner.recording;
    let stride = recording.frame_count().div_ceil(CLOCK_FRAMES);
    let exposure_s = assumed_exposure_s(recording.frame_interval_s);
    let mut median_px = 0.0;
    for round in 0..CLOCK_ITERATIONS {
        // After the first iteration the residuals are small.
        let coarsest = if round == 0 { usize::MAX } else { 1 };
        let finds_repeats = round == 0;
        let pass = LinkPass {
            gaps: &CLOCK_GAPS,
            backward_gaps: &[],
            sparse: (&[], 1),
            coarsest,
            finest: 1,
            estimates_readout: true,
            stride,
            finds_repeats,
        };
        let model = CameraModel::new(shared.geometry.clone());
        let states = shared.states(recording);
        if round == 1 {
            registration.depth = runner.depth_clock(&model, &states)?;
            shared.depth_later_s = registration.depth_later_s();
        }
        let linked = runner.links(times::CLOCKS, &model, &states, shared.depth_later_s, pass)?;
        if finds_repeats {
            shared.repeats.clone_from(&linked.repeats);
            median_px = upper_median(linked.good.iter().map(|link| link.displaced_px(&link.e))).unwrap_or(0.0);
        }
        let offset =
            rig_offset::estimate(&linked.good, &states, true, exposure_s).filter(|_| linked.good.len() >= MIN_LINKS);
        let Some(offset) = offset else {
            let accepted = linked.good.len();
            let links = LinkCounts { accepted, tried: accepted + linked.refused, required: MIN_LINKS };
            let reason = link_failure::explain(recording, &shared.geometry, &states, &links, CLOCK_GAPS[0])?;
            return Ok(Some(reason));
        };
        // Corrections of the corrected offset accumulate.
        shared.hand_eye = twist::log(&(twist::exp(&shared.hand_eye) * twist::exp(&offset.hand_eye)));
        shared.clock_s += offset.clock_s;
        registration.rig_offset = Some(RigOffset { hand_eye: shared.hand_eye, clock_s: shared.clock_s, ..offset });
        shared.update_readout(
            rig_offset::readout(&linked.good, runner.recording.frame_count()),
            READOUT_DAMPING,
            registration,
        );
    }
    if let Some(reason) =
        registration.rig_offset.as_ref().filter(|_| median_px > RIGHT_PX).and_then(implausible_hand_eye)
    {
        return Ok(Some(reason));
    }
    // The clock offset keeps the value of the joint estimate: without a hand-eye offset in the fit
    // it would be biased.
    if let Some(offset) = registration.rig_offset.as_mut().filter(|offset| !offset.is_hand_eye_significant()) {
        offset.hand_eye = Twist::zeros();
        shared.hand_eye = Twist::zeros();
    }
    Ok(None)
}

/// Estimates the readout and the depth clock anew with refined poses: the jitter of recorded poses
/// biases the readout towards short times. `given_s`: readout time of the camera's profile.
pub fn estimate_with_refined_poses(
    runner: &mut PassRunner<'_>,
    shared: &mut SharedParameters,
    registration: &mut Registration,
    refined: &[Option<CameraState>],
    given_s: f64,
) -> Result<(), RegistrationError> {
    registration.depth = runner.depth_clock(&CameraModel::new(shared.geometry.clone()), refined)?;
    shared.depth_later_s = registration.depth_later_s();
    let stride = runner.recording.frame_count().div_ceil(REFINED_CLOCK_FRAMES);
    let pass = LinkPass {
        gaps: &REFINED_CLOCK_GAPS,
        backward_gaps: &[],
        sparse: (&[], 1),
        coarsest: 1,
        finest: 0,
        estimates_readout: true,
        stride,
        finds_repeats: false,
    };
    for _ in 0..REFINED_CLOCK_ITERATIONS {
        let model = CameraModel::new(shared.geometry.clone());
        let linked = runner.links(times::CLOCKS, &model, refined, shared.depth_later_s, pass)?;
        shared.update_readout(rig_offset::readout(&linked.good, runner.recording.frame_count()), 1.0, registration);
    }
    if (shared.geometry.intrinsics.readout_time_s - given_s).abs() < READOUT_TOLERANCE_S {
        shared.geometry.intrinsics.readout_time_s = given_s;
    }
    Ok(())
}

/// The reason for which a hand-eye offset is implausible, if it is. A wrong focal length moves the
/// camera along its axis, poses of another recording turn it anywhere.
fn implausible_hand_eye(offset: &RigOffset) -> Option<String> {
    let (way_m, turn) =
        (twist::translation(&offset.hand_eye).length(), twist::rotation_vector(&offset.hand_eye).length());
    let sigma_m = twist::translation(&offset.hand_eye_sigma).length();
    let is_far = way_m > MAX_HAND_EYE_M && way_m > 3.0 * sigma_m;
    (is_far || turn > MAX_HAND_EYE_RAD).then(|| {
        format!(
            "the camera would be {:.0} mm from its recorded position, rotated by {:.0}° (at most {:.0} mm and {:.0}°): \
             poses, focal length or the depth unit do not belong to this recording",
            1e3 * way_m,
            turn.to_degrees(),
            1e3 * MAX_HAND_EYE_M,
            MAX_HAND_EYE_RAD.to_degrees()
        )
    })
}
