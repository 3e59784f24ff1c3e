//! Estimates from the footage: camera poses, clocks, shutter, gain of each frame, sharpness and the
//! room's light.
//!
//! Everything is estimated from the recording alone, with its uncertainty, and refused where the
//! footage is not sufficient. The result is an [`Analysis`], a folder of text beside the recording,
//! which compositing applies ([`crate::shot`]). The design follows direct visual odometry (Engel
//! 2018) and pose graphs; each file gives its formulas.

mod accept;
mod align;
mod artefact;
mod blur_frame;
mod box_blur;
mod camera_model;
mod capture_info;
mod checkpoint;
mod clocks;
mod cross_blur;
mod dependencies;
mod depth_at_frame;
mod depth_clock;
mod depth_source;
mod edges;
mod evaluation;
mod example_noise;
mod example_noise_findings;
mod findings;
mod findings_summary;
mod folder;
mod fusion;
mod gain;
mod gain_graph;
mod inputs;
mod interrupted;
mod light;
mod light_findings;
mod light_table;
mod link_blur;
mod link_failure;
mod links;
mod motion_only;
mod neighbour_mean;
mod noise_findings;
mod noise_level;
mod pass_runner;
mod plane_sweep;
mod pose_graph;
mod progress;
mod recorded_motion;
mod registration;
mod registration_result;
mod relight;
mod rig_offset;
mod sharpness;
mod shutter;
mod sparse_frames;
mod spatial_gain;
mod spread;
mod stale;
mod state;
mod support_file;
mod surfel_file;
mod times;
mod tone;
mod track;
mod trajectory;
mod view;
mod warp_mesh;

pub use accept::{AcceptOutcome, Outcome, accept};
pub use artefact::{Analysis, AnalysisError, ENVIRONMENT, FILE_NAME, default_folder, digest};
pub(crate) use blur_frame::unit_noise;
pub(crate) use camera_model::is_same_surface;
pub use capture_info::CaptureInfo;
pub use checkpoint::Checkpoints;
pub use findings::Findings;
pub use folder::{check_folder, check_writable};
pub use interrupted::Interrupted;
pub use light::{ASSUMED_LAMP_DIAMETER_M, LampEstimate, MAX_LAMPS, WHITE_REFLECTANCE};
pub use light_findings::{EnvironmentFit, LightFindings};
pub use light_table::panorama_beside;
pub use noise_findings::NoiseFindings;
pub use progress::{AnalysisStage, Progress};
pub use registration_result::{HeldOutResidual, RegistrationError, Verdict};
pub use relight::relight;
pub use sharpness::{drawn_spread_px, footage_spread_px, still_frames};
pub use spatial_gain::SpatialGainFit;
pub use spread::EDGE_BIN_PX;
pub use support_file::write_support_reports;
pub use times::Times;
pub use tone::ToneBand;

use std::ops::Range;
use std::time::{Duration, Instant};

use glam::DQuat;
use serde::{Deserialize, Serialize};

use crate::calibrate::RestSearch;
use crate::camera::Geometry;
use crate::frame::{SpatialGain, Surfel};
use crate::pose::camera_up;
use crate::recording::Recording;
use camera_model::CameraModel;
use depth_source::DepthSource;
use example_noise::ExampleInputs;
use example_noise_findings::ExampleNoiseEstimate;
use findings::GainFindings;
use gain::{GAPS, Gains, Pair};
use light::RoomLight;
use noise_findings::NoiseSampler;
use progress::{Passes, with_timed_progress};
use shutter::{ShutterEstimator, ShutterEvidence};
use spatial_gain::SpatialGainPair;
use state::CameraState;
use tone::ToneSample;

/// Distances between the frames of held-out pairs for the gains.
const HELD_OUT_GAPS: [usize; 3] = [3, 7, 13];

/// Largest root mean square log ratio of held-out pairs for which frames count as equally bright,
/// ln.
const STEADY_LN: f64 = 0.01;
/// [`STEADY_LN`] for refused poses without confirmation. Gains of neighbouring frames then have
/// errors of up to ln 0.003 each.
const STEADY_LN_UNCONFIRMED_POSES: f64 = 0.1;

/// Largest residual of held-out pairs by their log ratio, root mean square. Above it the log ratios
/// are not gains of the camera: frames with wrong poses show different places, which differ in
/// brightness, too.
const MAX_RESIDUAL_SHARE: f64 = 1.0 / 3.0;

/// Analyses a whole recording taken with `camera`. `report` receives the progress; its error ends
/// the work, and `checkpoints` stores the finished stages. The analysis is the same for any number
/// of `threads`, bit for bit. The second result has the duration of each part.
pub fn analyse(
    recording: &Recording,
    camera: &Geometry,
    capture: &CaptureInfo<'_>,
    threads: usize,
    checkpoints: &mut Checkpoints,
    report: &mut dyn FnMut(Progress) -> Result<(), Interrupted>,
) -> Result<(Analysis, Times), RegistrationError> {
    let frames = recording.frame_count();
    let mut passes = Passes { path: 0, exposure: frames };
    let mut times = Times::default();
    let begun = Instant::now();
    let registration =
        registration::register(recording, camera, capture.noise, threads, checkpoints, &mut times, &mut |done, of| {
            passes.path = of;
            report(passes.progress(AnalysisStage::Path, done))
        })?;
    let mut geometry = camera.clone();
    geometry.intrinsics.readout_time_s = registration.readout_s;
    let model = plane_sweep::camera_model_for(geometry, recording, &registration.states);
    let is_refused = matches!(registration.verdict, Verdict::Refused(_));
    // An offset of depth's clock by refused poses is not used.
    let later_s = if is_refused { 0.0 } else { registration.depth_later_s() };
    let states = registration.states.as_slice();
    let comparison = checkpoints.stage(|| {
        compare_frames(recording, &model, capture, (states, later_s), is_refused, threads, &mut times, &mut |n| {
            report(passes.progress(AnalysisStage::Exposure, n))
        })
    })?;
    // Registration can fail for reasons that leave the poses good enough for brightness, blur and
    // light.
    let has_poses = !is_refused || comparison.pair_counts.confirms_poses();
    let SolvedGains { findings: gain, gains, across } = solve_gains(&comparison, frames, has_poses, &mut times);
    let exposure = if has_poses {
        comparison.shutter.exposure_runs(frames)
    } else {
        Err("the camera's poses are unknown".to_owned())
    };
    let inputs = sharpness::SharpnessInputs {
        states: &registration.states,
        depth_later_s: later_s,
        exposure_runs: exposure.as_ref().map_or(&[][..], |exposure| &exposure.runs),
    };
    let passes_took = begun.elapsed();
    report(passes.progress(AnalysisStage::Sharpness, 0))?;
    let spread =
        times.of(times::SHARPNESS, || sharpness::of_recording(recording, &model, capture, &inputs, threads))?;
    report(passes.progress(AnalysisStage::Light, 0))?;
    let factors = artefact::gain_factors(&gains);
    let rotation = |state: &CameraState| DQuat::from_mat3(&state.world_from_camera.matrix3);
    let inputs = light::LightInputs {
        recording,
        model: &model,
        response: capture.response,
        states,
        later_s,
        gains: &factors,
        up: recording.up.unwrap_or_else(|| camera_up(states.iter().flatten().map(rotation))),
        threads,
    };
    let (light, surfels) = if has_poses {
        room_light(&inputs, is_refused, checkpoints, &mut times, &mut |elapsed| {
            report(passes.progress(AnalysisStage::Light, passes.light_after(elapsed, passes_took)))
        })?
    } else {
        (Err("the camera's poses are unknown".to_owned()), Vec::new())
    };
    let tone = match (has_poses, gains.is_empty()) {
        (true, false) => tone::bands(&comparison.tone_samples),
        (true, true) => Err("frames are equally bright".to_owned()),
        (false, _) => Err("the camera's poses are unknown".to_owned()),
    };
    let gain = match gain {
        Some(gain) if !has_poses && !gain.is_followed => {
            Err("the poses were rejected, and it cannot be estimated without them".to_owned())
        }
        gain => gain.ok_or_else(|| comparison.pair_counts.why()),
    };
    let measured = comparison.noise.as_ref().and_then(NoiseFindings::profile);
    let example_noise = match capture.noise.or(measured.as_ref()) {
        Some(noise) => {
            let (rest, has_poses) = (comparison.rest.clone(), !is_refused);
            let inputs = ExampleInputs { recording, model: &model, states, has_poses, rest, later_s, noise, threads };
            let examples = checkpoints.stage(|| times.of(times::EXAMPLE_NOISE, || example_noise::examples(&inputs)))?;
            examples.unwrap_or_else(ExampleNoiseEstimate::none)
        }
        None => ExampleNoiseEstimate::none("the strength of the camera's noise is unknown"),
    };
    let estimates = artefact::Estimates {
        gain,
        gains: &gains,
        across,
        exposure,
        spread,
        noise: comparison.noise,
        example_noise,
        tone,
        light,
        surfels,
    };
    Ok((Analysis::new(recording, camera, &registration, estimates), times))
}

/// Light of the room and surfels, with poses. Refused ones give no surfels. `report` receives the
/// elapsed time.
fn room_light(
    inputs: &light::LightInputs<'_>,
    is_refused: bool,
    checkpoints: &mut Checkpoints,
    times: &mut Times,
    report: &mut dyn FnMut(Duration) -> Result<(), Interrupted>,
) -> Result<(Result<RoomLight, String>, Vec<Surfel>), RegistrationError> {
    let work = || -> Result<_, RegistrationError> {
        let surfels = if is_refused { Vec::new() } else { checkpoints.stage(|| fusion::surfels(inputs, times))? };
        Ok((checkpoints.stage(|| light::of_recording(inputs, None, times))?, surfels))
    };
    let (light, surfels) = with_timed_progress(work, report)??;
    Ok((light, surfels.into_iter().map(Surfel::from_array).collect()))
}

/// Comparisons between frames, from one pass over the recording.
#[derive(Default, Serialize, Deserialize)]
struct FrameComparison {
    pairs: Vec<Pair>,
    shutter: ShutterEvidence,
    tone_samples: Vec<ToneSample>,
    across: Vec<SpatialGainPair>,
    pair_counts: gain::PairCounts,
    noise: Option<NoiseFindings>,
    /// The longest stretch in which camera and scene are at rest.
    rest: Range<usize>,
}

/// Compares the frames of a recording. `states`: one per frame, and the time that is added to the
/// depth maps' times, s. `is_unsure`: whether registration refused the states.
#[expect(clippy::too_many_arguments)]
fn compare_frames(
    recording: &Recording,
    model: &CameraModel,
    capture: &CaptureInfo<'_>,
    (states, later_s): (&[Option<CameraState>], f64),
    is_unsure: bool,
    threads: usize,
    times: &mut Times,
    report: &mut dyn FnMut(usize) -> Result<(), Interrupted>,
) -> Result<FrameComparison, RegistrationError> {
    let gaps: Vec<usize> = GAPS.into_iter().chain(HELD_OUT_GAPS).collect();
    let mut gains = Gains::new(model, capture, &gaps, is_unsure, threads);
    let (times_s, interval_s) = (&recording.timestamps_s, recording.frame_interval_s);
    let mut shutter =
        ShutterEstimator::new(model, capture.response, capture.noise, states, times_s, interval_s, threads);
    let mut depths = DepthSource::new(model, recording, states, later_s, threads)?;
    let mut noise = NoiseSampler::new(capture.noise, recording.frame_count());
    let mut rest = RestSearch::default();
    let mut coming = recording.frames(0..recording.frame_count())?;
    while let Some(frame) = times.of(times::READING, || coming.next()) {
        let frame = frame?;
        report(frame.index)?;
        times.of(times::NOISE, || {
            noise.add(frame.index, &frame.pixels);
            rest.add(&frame.pixels);
        });
        if let Some(state) = states[frame.index] {
            let depth = times.of(times::DEPTHS, || depths.of(model, &frame, &state))?;
            times.of(times::GAIN, || gains.add(&frame, state, &depth, recording.landmarks(frame.index)));
            times.of(times::EXPOSURE, || shutter.add(&frame, state, &depth));
        }
    }
    Ok(FrameComparison {
        pairs: gains.pairs,
        shutter: shutter.evidence(),
        tone_samples: gains.tone_samples,
        across: gains.across,
        pair_counts: gains.counts,
        noise: noise.finish(),
        rest: rest.longest(),
    })
}

/// The gains of the frames and the findings about them.
struct SolvedGains {
    findings: Option<GainFindings>,
    /// ln, one per frame; empty if the frames count as equally bright.
    gains: Vec<Option<[f64; 3]>>,
    /// Gains that vary within the picture.
    across: Option<(Vec<SpatialGain>, SpatialGainFit)>,
}

/// Solves the gains of all frames, and checks them by held-out pairs.
fn solve_gains(comparison: &FrameComparison, frames: usize, has_poses: bool, times: &mut Times) -> SolvedGains {
    let (used, held_out): (Vec<Pair>, Vec<Pair>) =
        comparison.pairs.iter().partition(|pair| GAPS.contains(&(pair.to - pair.from)));
    let solved = times.of(times::GAIN, || gain_graph::solve(&used, frames));
    let steady_ln = if has_poses { STEADY_LN } else { STEADY_LN_UNCONFIRMED_POSES };
    let findings = gain_graph::residuals(&held_out, &solved).map(|(recorded, left)| GainFindings {
        pairs: used.len(),
        recorded,
        left,
        range_ev: range_ev(&solved),
        is_followed: recorded > steady_ln && left < MAX_RESIDUAL_SHARE * recorded,
    });
    let gains = if findings.as_ref().is_some_and(|gain| gain.is_followed) { solved } else { Vec::new() };
    let across = if gains.is_empty() || !has_poses {
        None
    } else {
        times.of(times::GAIN, || spatial_gain::solve(&comparison.across, frames))
    };
    SolvedGains { findings, gains, across }
}

/// Ratio of the brightest to the darkest frame in green, stops.
fn range_ev(gains: &[Option<[f64; 3]>]) -> f64 {
    let green = || gains.iter().flatten().map(|g| g[1]);
    let (low, high) = (green().fold(f64::INFINITY, f64::min), green().fold(f64::NEG_INFINITY, f64::max));
    if high > low { (high - low) / std::f64::consts::LN_2 } else { 0.0 }
}
