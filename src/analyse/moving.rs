//! How the camera moved at each frame, where no depth was measured to know better where it stood.
//!
//! Poses that were recorded often have jitter that a slope over an exposure enlarges. Neighbouring pictures say by how much the
//! camera moved between them: links one and two frames apart, by depth that frames tell of each other, joined in a graph. That
//! depth errs where the poses do, so that where the camera stands stays as it was recorded, and only its motion is taken. Frames that are far apart do not
//! tell it.

use nalgebra::Matrix6;

use super::align::Link;
use super::clocks::RIGHT_PX;
use super::graph;
use super::judging::repeated;
use super::link_blur::assumed_exposure_s;
use super::links::Pass;
use super::path;
use super::recorded_way::are_far_apart;
use super::registered::{Registration, RegistrationError, Verdict, recorded};
use super::state::State;
use super::sweep::eye_of;
use super::times;
use super::track::MOST_INTERVALS;
use super::working::Work;
use crate::camera::Geometry;
use crate::fit::twist::Twist;

const LINKED: [usize; 2] = [1, 2];
/// With so many links missing, nothing is said.
const MISSING: f64 = 0.25;

/// Poses as they were recorded, with the motion that the pictures tell where that differs.
pub fn kept(work: &mut Work<'_>, geometry: &Geometry, why: &str) -> Result<Registration, RegistrationError> {
    let recording = work.recording;
    let found = Registration::as_recorded(recording, geometry, Verdict::Kept(why.to_owned()));
    if are_far_apart(recording) {
        return Ok(found);
    }
    let repeats = work.repeats()?;
    let start = recorded(recording, 0.0);
    let seen: Vec<_> = start.iter().zip(&repeats).map(|(state, repeats)| state.filter(|_| !repeats)).collect();
    let eye = eye_of(geometry.clone(), recording, &seen);
    let pass = Pass {
        gaps: &LINKED,
        back: &LINKED,
        rare: (&[], 1),
        coarsest: usize::MAX,
        finest: 1,
        asks_readout: false,
        every: 1,
        finds_repeats: false,
    };
    let linked = work.links(times::LINKS, &eye, &seen, 0.0, pass)?;
    let found = Registration { links: linked.good.len(), missing: linked.refused, ..found };
    if linked.good.is_empty() || linked.refused as f64 > MISSING * (linked.good.len() + linked.refused) as f64 {
        return Ok(found);
    }
    let none = vec![Twist::zeros(); seen.len()];
    let exposure_s = assumed_exposure_s(work.recording.frame_interval_s);
    let by = work.times.of(times::GRAPH, || graph::solve(&linked.good, &seen, &none, exposure_s));
    let Some(by) = by else { return Ok(found) };
    let corrected: Vec<_> = seen.iter().zip(&by).map(|(state, by)| state.map(|state| state.corrected(by))).collect();
    let moving = path::with_motion(&recording.timestamps_s, &corrected, MOST_INTERVALS * recording.frame_interval_s);
    let is_linked = linked_frames(&linked.good, seen.len());
    let states: Vec<Option<State>> = (0..seen.len())
        .map(|n| {
            let twist = moving[n].filter(|_| is_linked[n]).map(|state| state.twist);
            seen[n].map(|state| State { twist: twist.unwrap_or(state.twist), ..state })
        })
        .collect();
    let differs_px = differs_px(&linked.good, &seen, &states, 0.5 * recording.frame_interval_s);
    if differs_px < RIGHT_PX {
        return Ok(found);
    }
    // A repeated picture stands where its pose says, as before, and moves as the first did.
    let motion = repeated(states, &repeats);
    let with = |(here, motion): (&Option<State>, Option<State>)| {
        here.map(|here| State { twist: motion.map_or(here.twist, |motion| motion.twist), ..here })
    };
    let states = start.iter().zip(motion).map(with).collect();
    Ok(Registration { states, repeats, motion_px: Some(differs_px), ..found })
}

/// Frames with a link to another.
fn linked_frames(links: &[Link], frames: usize) -> Vec<bool> {
    let mut is_linked = vec![false; frames];
    links.iter().for_each(|link| (is_linked[link.from], is_linked[link.to]) = (true, true));
    is_linked
}

/// By how much what is seen moves otherwise within a time, root mean square, px.
fn differs_px(links: &[Link], before: &[Option<State>], after: &[Option<State>], within_s: f64) -> f64 {
    let metric = links.iter().map(|link| link.metric).sum::<Matrix6<f64>>() / links.len().max(1) as f64;
    let square = |(before, after): (&Option<State>, &Option<State>)| {
        let off = (after.as_ref()?.twist - before.as_ref()?.twist) * within_s;
        Some((off.transpose() * metric * off)[0])
    };
    let squares: Vec<f64> = before.iter().zip(after).filter_map(square).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).max(0.0).sqrt()
}
