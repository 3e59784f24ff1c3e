//! The corrections of all frames at once, from their links and from what was recorded.
//!
//! A link measures e_ij = c_i − A·c_j, A = Ad(T_i⁻¹ T_j), with the information H/50: neighbouring points err alike, so
//! thousands of them know less than as many that do not. Cauchy's weights on the displacement in the picture, of scale
//! max(median, 0.15 px); links beyond six scales are left out. Each frame is held to its recorded pose by 1 cm and 0.5°.
//! Links reach a few frames, so the equations form a band, solved by Cholesky in time linear in the frames.

use nalgebra::Matrix6;

use super::align::Link;
use super::robust::median;
use super::state::State;
use crate::fit::band::Band;
use crate::fit::twist::{self, Twist};

const ROUNDS: usize = 6;
const ALIKE: f64 = 50.0;
const LEAST_SCALE_PX: f64 = 0.15;
const BEYOND: f64 = 6.0;
const HELD_M: f64 = 0.01;
const HELD_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// One correction per frame, in its camera's axes; `held_at` for a frame without links. `held_at`: one per frame, the correction
/// that leads back to the recorded pose. `None` if the equations have no solution.
pub fn solve(links: &[Link], states: &[Option<State>], held_at: &[Twist]) -> Option<Vec<Twist>> {
    let count = states.len();
    let band = links.iter().map(|link| link.from.abs_diff(link.to)).max().unwrap_or(0);
    let held = Matrix6::from_diagonal(&twist::twist(
        glam::DVec3::splat(HELD_M.powi(-2)),
        glam::DVec3::splat(HELD_RAD.powi(-2)),
    ));
    let adjoints: Vec<Matrix6<f64>> = links
        .iter()
        .map(|link| {
            let (i, j) = (states[link.from]?, states[link.to]?);
            Some(twist::adjoint(&(i.world_from_camera.inverse() * j.world_from_camera)))
        })
        .collect::<Option<_>>()?;
    let mut weights = vec![1.0; links.len()];
    let mut corrections = held_at.to_vec();
    for _ in 0..ROUNDS {
        let mut equations = Band::new(6 * count, 6 * band + 5);
        for (frame, at) in held_at.iter().enumerate() {
            add(&mut equations, frame, frame, &held);
            add_right(&mut equations, frame, &(held * at));
        }
        for ((link, a), w) in links.iter().zip(&adjoints).zip(&weights) {
            let information = link.information * (w / ALIKE);
            let across = a.transpose() * information;
            add(&mut equations, link.from, link.from, &information);
            add(&mut equations, link.to, link.to, &(across * a));
            if link.from > link.to {
                add(&mut equations, link.from, link.to, &-(information * a));
            } else {
                add(&mut equations, link.to, link.from, &-across);
            }
            add_right(&mut equations, link.from, &(information * link.e));
            add_right(&mut equations, link.to, &-(across * link.e));
        }
        corrections = equations.solved()?.chunks(6).map(Twist::from_column_slice).collect();
        let left = |(link, a): (&Link, &Matrix6<f64>)| {
            link.displaced_px(&(link.e - corrections[link.from] + a * corrections[link.to]))
        };
        let residuals_px: Vec<f64> = links.iter().zip(&adjoints).map(left).collect();
        let scale = median(&mut residuals_px.clone()).max(LEAST_SCALE_PX);
        let weight = |off: f64| if off > BEYOND * scale { 0.0 } else { 1.0 / (1.0 + (off / (2.0 * scale)).powi(2)) };
        weights = residuals_px.iter().map(|off| weight(*off)).collect();
    }
    Some(corrections)
}

/// Adds a block at rows and columns of frames; `row` ≥ `column`.
fn add(equations: &mut Band, row: usize, column: usize, block: &Matrix6<f64>) {
    for (r, c) in (0..6).flat_map(|r| (0..6).map(move |c| (r, c))) {
        let (at_row, at_column) = (6 * row + r, 6 * column + c);
        if at_column <= at_row {
            equations.add(at_row, at_column, block[(r, c)]);
        }
    }
}

fn add_right(equations: &mut Band, frame: usize, values: &Twist) {
    values.iter().enumerate().for_each(|(k, value)| equations.add_right(6 * frame + k, *value));
}
