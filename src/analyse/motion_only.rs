//! Refines the camera's motion at each frame where no depth was measured. The poses stay as
//! recorded.
//!
//! Recorded poses have jitter, which a derivative over an exposure amplifies. The motion between
//! neighbouring frames follows from links one and two frames apart, by depth of a plane sweep, in a
//! pose graph. That depth depends on the recorded poses and inherits their errors, so only the
//! motion is used. At low frame rates the recorded motion is kept.

use nalgebra::Matrix6;

use super::align::Link;
use super::clocks::RIGHT_PX;
use super::evaluation::copy_repeated_states;
use super::links::LinkPass;
use super::pass_runner::PassRunner;
use super::plane_sweep::camera_model_for;
use super::pose_graph;
use super::recorded_motion::are_far_apart;
use super::registration_result::{Registration, RegistrationError, Verdict, recorded};
use super::state::CameraState;
use super::times;
use super::track::MAX_GAP_INTERVALS;
use super::trajectory;
use crate::camera::Geometry;
use crate::camera::exposure::assumed_exposure_s;
use crate::fit::twist::Twist;

/// Distances between linked frames.
const LINK_GAPS: [usize; 2] = [1, 2];
/// Largest fraction of missing links.
const MAX_MISSING_SHARE: f64 = 0.25;

/// The recorded poses, with refined motion where that differs from the recorded one. `why`: the
/// reason for keeping the poses.
pub fn refine_motion(
    runner: &mut PassRunner<'_>,
    geometry: &Geometry,
    why: &str,
) -> Result<Registration, RegistrationError> {
    let recording = runner.recording;
    let registration = Registration::as_recorded(recording, geometry, Verdict::Kept(why.to_owned()));
    if are_far_apart(recording) {
        return Ok(registration);
    }
    let repeats = runner.repeats()?;
    let start = recorded(recording, 0.0);
    let distinct: Vec<_> = start.iter().zip(&repeats).map(|(state, repeats)| state.filter(|_| !repeats)).collect();
    let model = camera_model_for(geometry.clone(), recording, &distinct);
    let pass = LinkPass {
        gaps: &LINK_GAPS,
        backward_gaps: &LINK_GAPS,
        sparse: (&[], 1),
        coarsest: usize::MAX,
        finest: 1,
        estimates_readout: false,
        stride: 1,
        finds_repeats: false,
    };
    let linked = runner.links(times::LINKS, &model, &distinct, 0.0, pass)?;
    let registration = Registration { links: linked.good.len(), missing: linked.refused, ..registration };
    if linked.good.is_empty() || linked.refused as f64 > MAX_MISSING_SHARE * (linked.good.len() + linked.refused) as f64
    {
        return Ok(registration);
    }
    let none = vec![Twist::zeros(); distinct.len()];
    let exposure_s = assumed_exposure_s(runner.recording.frame_interval_s);
    let by = runner.times.of(times::GRAPH, || pose_graph::solve(&linked.good, &distinct, &none, exposure_s));
    let Some(by) = by else { return Ok(registration) };
    let corrected: Vec<_> =
        distinct.iter().zip(&by).map(|(state, by)| state.map(|state| state.corrected(by))).collect();
    let moving =
        trajectory::with_motion(&recording.timestamps_s, &corrected, MAX_GAP_INTERVALS * recording.frame_interval_s);
    let is_linked = linked_frames(&linked.good, distinct.len());
    let states: Vec<Option<CameraState>> = (0..distinct.len())
        .map(|n| {
            let twist = moving[n].filter(|_| is_linked[n]).map(|state| state.twist);
            distinct[n].map(|state| CameraState { twist: twist.unwrap_or(state.twist), ..state })
        })
        .collect();
    let difference_px = motion_difference_px(&linked.good, &distinct, &states, 0.5 * recording.frame_interval_s);
    if difference_px < RIGHT_PX {
        return Ok(registration);
    }
    // A repeated picture keeps its recorded pose and gets the motion of the picture that it
    // repeats.
    let motion = copy_repeated_states(states, &repeats);
    let with = |(here, motion): (&Option<CameraState>, Option<CameraState>)| {
        here.map(|here| CameraState { twist: motion.map_or(here.twist, |motion| motion.twist), ..here })
    };
    let states = start.iter().zip(motion).map(with).collect();
    Ok(Registration { states, repeats, motion_px: Some(difference_px), ..registration })
}

/// One per frame: whether it has a link.
fn linked_frames(links: &[Link], frames: usize) -> Vec<bool> {
    let mut is_linked = vec![false; frames];
    links.iter().for_each(|link| (is_linked[link.from], is_linked[link.to]) = (true, true));
    is_linked
}

/// Root mean square difference of the displacements within a time by two motions, px.
fn motion_difference_px(
    links: &[Link],
    before: &[Option<CameraState>],
    after: &[Option<CameraState>],
    within_s: f64,
) -> f64 {
    let metric = links.iter().map(|link| link.metric).sum::<Matrix6<f64>>() / links.len().max(1) as f64;
    let square = |(before, after): (&Option<CameraState>, &Option<CameraState>)| {
        let difference = (after.as_ref()?.twist - before.as_ref()?.twist) * within_s;
        Some((difference.transpose() * metric * difference)[0])
    };
    let squares: Vec<f64> = before.iter().zip(after).filter_map(square).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).max(0.0).sqrt()
}
