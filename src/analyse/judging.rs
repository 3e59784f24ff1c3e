//! Whether refined poses are better than recorded ones, and where all of them stand.

use glam::DAffine3;
use nalgebra::Matrix6;

use super::align::Link;
use super::registered::Missed;
use super::robust::median;
use super::state::State;
use crate::fit::twist::{self, Twist};

/// What links aligned with `used` say is wrong, px: with `before`, and with `after`.
pub fn judged(
    links: &[Link],
    before: &[Option<State>],
    after: &[Option<State>],
    used: &[Option<State>],
) -> Vec<Missed> {
    let of = |link: &Link| {
        let (recorded_px, refined_px) = (asks(link, before, used)?, asks(link, after, used)?);
        Some(Missed { from: link.from, to: link.to, recorded_px, refined_px })
    };
    links.iter().filter_map(of).collect()
}

/// What links aligned with `used` say is wrong with the poses of `states`, median, px.
pub fn asked(links: &[Link], states: &[Option<State>], used: &[Option<State>]) -> f64 {
    median(&mut links.iter().filter_map(|link| asks(link, states, used)).collect::<Vec<_>>())
}

fn asks(link: &Link, states: &[Option<State>], used: &[Option<State>]) -> Option<f64> {
    let motion =
        |of: &[Option<State>]| Some(of[link.to]?.world_from_camera.inverse() * of[link.from]?.world_from_camera);
    let seen = motion(used)? * twist::exp(&link.e);
    Some(link.displaced_px(&twist::log(&(motion(states)?.inverse() * seen))))
}

/// Links tell how frames stand to each other, not where all of them stand: moved as a whole so that what stands in the world is
/// seen, on the whole, where the recorded poses show it. Least squares over the frames in the links' mean metric.
pub fn in_gauge(refined: &[Option<State>], recorded: &[Option<State>], links: &[Link]) -> Vec<Option<State>> {
    let metric = links.iter().map(|link| link.metric).sum::<Matrix6<f64>>() / links.len().max(1) as f64;
    let mut whole = DAffine3::IDENTITY;
    for _ in 0..3 {
        let (mut h, mut g) = (Matrix6::zeros(), Twist::zeros());
        for (now, was) in refined.iter().zip(recorded).filter_map(|(now, was)| Some(((*now)?, (*was)?))) {
            let here = whole * now.world_from_camera;
            // log(W⁻¹·exp(x)·here) ≈ off + Ad(here⁻¹)·x.
            let off = twist::log(&(was.world_from_camera.inverse() * here));
            let by = twist::adjoint(&here.inverse());
            let across = by.transpose() * metric;
            h += across * by;
            g -= across * off;
        }
        let Some(step) = h.cholesky().map(|h| h.solve(&g)) else { break };
        whole = twist::exp(&step) * whole;
    }
    let moved = |state: State| State { world_from_camera: whole * state.world_from_camera, ..state };
    refined.iter().map(|state| state.map(moved)).collect()
}

/// A frame that repeats the one before stands and moves where that one does.
pub fn repeated(mut states: Vec<Option<State>>, repeats: &[bool]) -> Vec<Option<State>> {
    for n in 1..states.len() {
        if repeats[n] {
            states[n] = states[n - 1];
        }
    }
    states
}
