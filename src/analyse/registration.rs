//! Registration: refines the recorded camera poses by direct alignment of the pictures.
//!
//! 1. Clock offset, hand-eye offset, readout time and depth's clock, by a few links ([`clocks`]).
//! 2. A pose graph of links between frames 1 to 20 apart ([`pose_graph`]).
//! 3. Readout time and depth's clock again, without the bias by recorded jitter.
//! 4. Links and pose graph again, from the refined poses.
//! 5. Acceptance by held-out links (frames 3 and 7 apart): their residuals by recorded and by
//!    refined poses. They share the aligner's own bias and favour small corrections, so poses that
//!    are nearly right are kept as recorded, bit for bit.
//!
//! Without measured depth the poses stay, and only the motion is refined ([`motion_only`]).

use super::align::Link;
use super::camera_model::CameraModel;
use super::checkpoint::Checkpoints;
use super::clocks::{
    self, CLOCK_FRAMES, CLOCK_ITERATIONS, REFINED_CLOCK_FRAMES, REFINED_CLOCK_ITERATIONS, RIGHT_PX, SharedParameters,
};
use super::evaluation::{align_gauge, copy_repeated_states, held_out_residuals, median_residual_px};
use super::interrupted::Interrupted;
use super::links::{LinkPass, Links};
use super::motion_only;
use super::pass_runner::PassRunner;
use super::pose_graph;
use super::recorded_motion::moves_as_recorded;
use super::registration_result::{HeldOutResidual, Registration, RegistrationError, Verdict, recorded};
use super::state::CameraState;
use super::times::{self, Times};
use super::track::MAX_GAP_INTERVALS;
use super::trajectory;
use crate::camera::exposure::assumed_exposure_s;
use crate::camera::{Geometry, NoiseProfile};
use crate::fit::quantile::upper_median;
use crate::fit::twist::{self, Twist};
use crate::recording::Recording;

/// Distances between linked frames.
const LINK_GAPS: [usize; 5] = [1, 2, 5, 10, 20];
const HELD_OUT: [usize; 2] = [3, 7];
/// Recordings with more frames are linked sparsely: without links from later to earlier frames, and
/// with every fourth held-out link.
const LONG_RECORDING_FRAMES: usize = 1000;
const LONG_BACKWARD_GAPS: [usize; 0] = [];
const LONG_HELD_OUT_STRIDE: usize = 4;
/// Smallest relative reduction of the held-out residuals by refined poses.
const MIN_IMPROVEMENT: f64 = 0.3;
/// Largest held-out residual of refined poses, px, and largest fraction of missing links.
/// Registration fails above.
const MAX_HELD_OUT_PX: f64 = 0.75;
const MAX_MISSING_SHARE: f64 = 0.25;

/// `noise`: the camera's, if calibrated. `report(done, of)` receives the progress in frames; its
/// error ends the work.
pub fn register(
    recording: &Recording,
    geometry: &Geometry,
    noise: Option<&NoiseProfile>,
    threads: usize,
    checkpoints: &mut Checkpoints,
    times: &mut Times,
    report: &mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
) -> Result<Registration, RegistrationError> {
    let frames = recording.frame_count();
    let as_recorded = |verdict: Verdict| Registration::as_recorded(recording, geometry, verdict);
    if let Some(why) = unsupported(recording, geometry) {
        return Ok(as_recorded(Verdict::Kept(why.to_owned())));
    }
    if !recording.has_depth() {
        const WHY: &str = "there is no depth to align them by";
        // Errors of poses are known in metres and by the time between frames.
        if !(recording.kind.is_metric() && recording.kind.has_times()) {
            return Ok(as_recorded(Verdict::Kept(WHY.to_owned())));
        }
        let mut runner = PassRunner { recording, noise, threads, checkpoints, done: 0, total: frames, times, report };
        return motion_only::refine_motion(&mut runner, geometry, WHY);
    }
    let [stride, refined_stride] = [CLOCK_FRAMES, REFINED_CLOCK_FRAMES].map(|count| frames.div_ceil(count));
    let clock_frames = CLOCK_ITERATIONS * frames.div_ceil(stride);
    let refined_clock_frames = REFINED_CLOCK_ITERATIONS * frames.div_ceil(refined_stride);
    let total = clock_frames + refined_clock_frames + 2 * frames;
    let mut runner = PassRunner { recording, noise, threads, checkpoints, done: 0, total, times, report };
    let mut shared = SharedParameters::new(geometry, frames);
    let mut registration = as_recorded(Verdict::Right);
    let given_s = geometry.intrinsics.readout_time_s;
    let refused =
        |why: String, registration: Registration| Ok(Registration { verdict: Verdict::Refused(why), ..registration });

    // 1. Shared parameters.
    if let Some(why) = clocks::estimate(&mut runner, &mut shared, &mut registration)? {
        return refused(why, registration);
    }

    // 2. Pose graph of all frames.
    let (backward_gaps, held_out_stride): (&[usize], usize) =
        if frames > LONG_RECORDING_FRAMES { (&LONG_BACKWARD_GAPS, LONG_HELD_OUT_STRIDE) } else { (&LINK_GAPS, 1) };
    let first = LinkPass {
        gaps: &LINK_GAPS,
        backward_gaps,
        sparse: (&[], 1),
        coarsest: usize::MAX,
        finest: 1,
        estimates_readout: false,
        stride: 1,
        finds_repeats: false,
    };
    let start = shared.states(recording);
    let model = CameraModel::new(shared.geometry.clone());
    let linked = runner.links(times::LINKS, &model, &start, shared.depth_later_s, first)?;
    (registration.links, registration.missing) = (linked.good.len(), linked.refused);
    if let Some(why) = missing_links(&linked) {
        return refused(why, registration);
    }
    let none = vec![Twist::zeros(); frames];
    let Some(refined) = solve(&mut runner, &linked.good, &start, &none) else {
        return refused(NO_SOLUTION.to_owned(), as_recorded(Verdict::Right));
    };

    // 3. Readout and depth's clock, without the bias by jitter.
    clocks::estimate_with_refined_poses(&mut runner, &mut shared, &mut registration, &refined, given_s)?;

    // 4. Pose graph again, with links that are held out of the fit.
    let again = LinkPass { sparse: (&HELD_OUT, held_out_stride), coarsest: 1, finest: 0, ..first };
    let model = CameraModel::new(shared.geometry.clone());
    let linked = runner.links(times::AGAIN, &model, &refined, shared.depth_later_s, again)?;
    let takes_part = |link: &Link| LINK_GAPS.contains(&link.from.abs_diff(link.to));
    let (linked, held_out): (Vec<Link>, Vec<Link>) = linked.good.into_iter().partition(takes_part);
    let to_recorded: Vec<Twist> =
        refined.iter().zip(&start).map(|(now, was)| relative_twist(now.as_ref(), was.as_ref())).collect();
    let used = refined;
    let Some(refined) = solve(&mut runner, &linked, &used, &to_recorded) else {
        return refused(NO_SOLUTION.to_owned(), as_recorded(Verdict::Right));
    };

    // 5. Acceptance.
    let before = recorded(recording, 0.0);
    registration.held_out = held_out_residuals(&held_out, &before, &refined, &used);
    let middle = |of: fn(&HeldOutResidual) -> f64| upper_median(registration.held_out.iter().map(of)).unwrap_or(0.0);
    let (recorded_px, refined_px) = (middle(|missed| missed.recorded_px), middle(|missed| missed.refined_px));
    registration.held_out_px = Some((recorded_px, refined_px));
    if refined_px > MAX_HELD_OUT_PX {
        return refused(
            format!(
                "refined poses agree with the alignment of held-out frame pairs to {refined_px:.2} px only; at most {MAX_HELD_OUT_PX} px \
                 is accepted"
            ),
            registration,
        );
    }
    if median_residual_px(&linked, &before, &used) >= RIGHT_PX && refined_px <= (1.0 - MIN_IMPROVEMENT) * recorded_px {
        let refined = align_gauge(&refined, &before, &linked);
        registration.verdict = Verdict::Refined;
        registration.readout_s = shared.geometry.intrinsics.readout_time_s;
        registration.states = copy_repeated_states(refined, &shared.repeats);
        registration.repeats = shared.repeats;
    }
    Ok(registration)
}

/// The reason for which too many links are missing, if they are.
fn missing_links(links: &Links) -> Option<String> {
    let all = links.good.len() + links.refused;
    if links.refused as f64 <= MAX_MISSING_SHARE * all as f64 {
        return None;
    }
    let comparable = all - links.few_points;
    let mismatched = links.refused - links.few_points;
    let share = 100.0 * links.refused as f64 / all.max(1) as f64;
    if mismatched as f64 <= MAX_MISSING_SHARE * comparable as f64 {
        let others = match comparable {
            0 => String::new(),
            _ => format!(". Of the others {:.0} % fit", 100.0 * links.good.len() as f64 / comparable as f64),
        };
        return Some(format!(
            "{share:.0} % of the links between frames cannot be made (at most {:.0} %): where the poses put them, {} pairs of \
             frames share too little that has texture and depth; blank surfaces, much blur or steps between frames do that{others}",
            100.0 * MAX_MISSING_SHARE,
            links.few_points
        ));
    }
    // Links between pictures of little contrast are no evidence against the poses.
    let faint =
        if 2 * links.faint > links.refused { "the pictures' contrast is hardly above their noise, " } else { "" };
    Some(format!(
        "{share:.0} % of the links between frames do not fit (at most {:.0} %): {faint}the poses, the focal length \
         or the depth do not belong to this recording, its frames are out of order, or something that fills much \
         of the picture moves",
        100.0 * MAX_MISSING_SHARE
    ))
}

const NO_SOLUTION: &str = "the links' equations have no solution";

/// The reason for which poses cannot be checked at all, if there is one.
fn unsupported(recording: &Recording, geometry: &Geometry) -> Option<&'static str> {
    if geometry.needs_cube_map() {
        return Some("the picture does not fit a plane in front of the camera");
    }
    if recorded(recording, 0.0).iter().flatten().count() < 3 {
        return Some("fewer than three frames have a pose");
    }
    None
}

/// Solves the pose graph and derives each frame's motion from the poses. `None` if the equations
/// have no solution.
fn solve(
    runner: &mut PassRunner<'_>,
    links: &[Link],
    states: &[Option<CameraState>],
    prior_mean: &[Twist],
) -> Option<Vec<Option<CameraState>>> {
    let recording = runner.recording;
    let exposure_s = assumed_exposure_s(recording.frame_interval_s);
    let by = runner.times.of(times::GRAPH, || pose_graph::solve(links, states, prior_mean, exposure_s))?;
    let corrected: Vec<_> = states.iter().zip(&by).map(|(state, by)| state.map(|state| state.corrected(by))).collect();
    if moves_as_recorded(recording) {
        return Some(corrected);
    }
    // Motion is not interpolated across longer intervals.
    let gap_s = MAX_GAP_INTERVALS * recording.frame_interval_s;
    Some(trajectory::with_motion(&recording.timestamps_s, &corrected, gap_s))
}

/// The motion from the camera's state `now` to `was`, in its own axes; 0 where one is missing.
fn relative_twist(now: Option<&CameraState>, was: Option<&CameraState>) -> Twist {
    let motion = |(now, was): (&CameraState, &CameraState)| {
        twist::log(&(now.world_from_camera.inverse() * was.world_from_camera))
    };
    now.zip(was).map_or(Twist::zeros(), motion)
}
