//! Spatially varying gain within each frame. Causes are local tone mapping (phones brighten dark
//! parts of a picture and darken bright ones), vignetting, and an assumed response that differs
//! from the camera's, under which dark and bright surfaces follow an exposure change differently.
//!
//! Two frames i and j show a surface at x_i and x_j. The log ratio of its light, minus that of the
//! frames' gains, is
//!
//!   δ = f_j(x_j) − f_i(x_i),
//!
//! where f is a smooth field over each frame's picture, bilinear between nodes
//! ([`SpatialGain`]). All frames are solved jointly:
//!
//!   min Σ ρ_Cauchy(δ − (f_j(x_j) − f_i(x_i)); σ) / σ²
//!     + Σ f² / [`PRIOR_SIGMA`]² + Σ (f_a − f_b)² / [`SMOOTHNESS_SIGMA`]²
//!
//! over nodes and neighbouring nodes of a frame, by conjugate gradients. A surface's own brightness
//! cancels, so a gain that a surface has in all frames alike is not observable. The field is used
//! only if it also explains held-out pairs.

use std::f64::consts::LN_2;

use serde::{Deserialize, Serialize};

use crate::fit::quantile::median_and_sigma;
use crate::frame::{NODES, NODES_ACROSS, NODES_DOWN, SpatialGain};

/// Distances between the frames of fitted pairs, and of held-out pairs.
pub const GAPS: [usize; 3] = [1, 5, 20];
pub const HELD_OUT: [usize; 2] = [7, 13];
/// Cells of a picture, columns and rows.
const CELLS: [usize; 2] = [8, 6];
const MIN_POINTS_PER_CELL: usize = 16;
/// Error of a cell's median in addition to the scatter of its points, ln.
const CELL_SIGMA: f64 = 0.01;
/// Standard deviation of a node, and of the difference between neighbouring nodes, ln.
const PRIOR_SIGMA: f64 = 0.1;
const SMOOTHNESS_SIGMA: f64 = 0.05;
/// Largest magnitude of a node, stops.
pub const MAX_EV: f64 = 0.7;
/// The field is used if it lowers the scatter of held-out cells to at most this ratio, that is the
/// variance to half, and removes at least this scatter, ln. Glossy floors with moving mirror images
/// have a small effect of the same kind.
const MAX_RESIDUAL_RATIO: f64 = 0.7;
const MIN_REMOVED_SCATTER: f64 = 0.005;
/// Iterations of reweighting, and of conjugate gradients in each.
const REWEIGHTINGS: usize = 4;
const CG_ITERATIONS: usize = 60;

/// Log ratios of a pair of frames by cell.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SpatialGainPair {
    pub from: usize,
    pub to: usize,
    /// Mean position of each cell in both frames (fractions of width and height), δ and its σ.
    cells: Vec<[f32; 6]>,
}

/// Scatter of held-out pairs without and with the field, ln.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialGainFit {
    pub recorded: f64,
    pub left: f64,
    /// Largest magnitude of a node, stops.
    pub max_ev: f64,
    /// True if the field is applied.
    pub is_followed: bool,
}

/// A surface point in two frames: its positions as fractions of width and height, and the ratio of
/// its light, ln.
pub struct RatioSample {
    pub from: [f32; 2],
    pub to: [f32; 2],
    pub ratio: f64,
}

/// Bins the samples by cells of the later picture. `ratio`: log ratio of the whole pair.
pub fn of_pair(from: usize, to: usize, samples: &[RatioSample], ratio: f64) -> SpatialGainPair {
    let mut by_cell: Vec<Vec<&RatioSample>> = vec![Vec::new(); CELLS[0] * CELLS[1]];
    for sample in samples {
        let [x, y] = [0, 1].map(|i| ((sample.to[i] * CELLS[i] as f32) as usize).min(CELLS[i] - 1));
        by_cell[y * CELLS[0] + x].push(sample);
    }
    let cell = |samples: &Vec<&RatioSample>| {
        (samples.len() >= MIN_POINTS_PER_CELL).then(|| {
            let mean = |of: fn(&RatioSample) -> f32| samples.iter().map(|p| of(p)).sum::<f32>() / samples.len() as f32;
            let (middle, spread) = median_and_sigma(samples.iter().map(|p| p.ratio - ratio));
            let sigma = CELL_SIGMA.hypot(spread * (20.0 / samples.len() as f64).sqrt());
            [
                mean(|p| p.from[0]),
                mean(|p| p.from[1]),
                mean(|p| p.to[0]),
                mean(|p| p.to[1]),
                middle as f32,
                sigma as f32,
            ]
        })
    };
    SpatialGainPair { from, to, cells: by_cell.iter().filter_map(cell).collect() }
}

/// The field of each frame, and its fit to held-out pairs; `None` without fitted or held-out pairs.
pub fn solve(pairs: &[SpatialGainPair], frames: usize) -> Option<(Vec<SpatialGain>, SpatialGainFit)> {
    let constraints = |gaps: &[usize]| -> Vec<GainConstraint> {
        pairs.iter().filter(|pair| gaps.contains(&(pair.to - pair.from))).flat_map(GainConstraint::of).collect()
    };
    let (fitted, held_out) = (constraints(&GAPS), constraints(&HELD_OUT));
    if fitted.is_empty() || held_out.is_empty() {
        return None;
    }
    let mut field = vec![0.0; frames * NODES];
    for _ in 0..REWEIGHTINGS {
        let weights: Vec<f64> = fitted.iter().map(|constraint| constraint.weight(&field)).collect();
        conjugate_gradients(&mut field, &fitted, &weights);
    }
    field.iter_mut().for_each(|node| *node = node.clamp(-MAX_EV * LN_2, MAX_EV * LN_2));
    let residual_scatter =
        |residual: &dyn Fn(&GainConstraint) -> f64| median_and_sigma(held_out.iter().map(residual)).1;
    let recorded = residual_scatter(&|constraint| constraint.delta);
    let left = residual_scatter(&|constraint| constraint.delta - constraint.predicted(&field));
    let fitted = SpatialGainFit {
        recorded,
        left,
        max_ev: field.iter().fold(0.0, |largest, node| node.abs().max(largest)) / LN_2,
        is_followed: left < MAX_RESIDUAL_RATIO * recorded
            && (recorded * recorded - left * left).max(0.0).sqrt() > MIN_REMOVED_SCATTER,
    };
    let of_frame = |nodes: &[f64]| SpatialGain(std::array::from_fn(|n| (nodes[n] / LN_2) as f32));
    Some((field.chunks_exact(NODES).map(of_frame).collect(), fitted))
}

/// One equation of the fit: δ of a cell by the nodes around it, four in each frame. Those of the
/// earlier frame have negative weights.
struct GainConstraint {
    nodes: [(usize, f64); 8],
    delta: f64,
    sigma: f64,
}

impl GainConstraint {
    fn of(pair: &SpatialGainPair) -> impl Iterator<Item = Self> {
        pair.cells.iter().map(|[from_x, from_y, to_x, to_y, delta, sigma]| {
            let (from, to) = (SpatialGain::weights([*from_x, *from_y]), SpatialGain::weights([*to_x, *to_y]));
            let nodes = std::array::from_fn(|n| match n {
                0..4 => (pair.from * NODES + from[n].0, -f64::from(from[n].1)),
                _ => (pair.to * NODES + to[n - 4].0, f64::from(to[n - 4].1)),
            });
            Self { nodes, delta: f64::from(*delta), sigma: f64::from(*sigma) }
        })
    }

    fn predicted(&self, field: &[f64]) -> f64 {
        self.nodes.iter().map(|(node, weight)| weight * field[*node]).sum()
    }

    fn weight(&self, field: &[f64]) -> f64 {
        let residual = (self.delta - self.predicted(field)) / (2.0 * self.sigma);
        self.sigma.powi(-2) / (1.0 + residual * residual)
    }
}

/// Conjugate gradients with a Jacobi preconditioner.
fn conjugate_gradients(field: &mut [f64], constraints: &[GainConstraint], weights: &[f64]) {
    let mut diagonal = vec![PRIOR_SIGMA.powi(-2); field.len()];
    for (constraint, weight) in constraints.iter().zip(weights) {
        constraint.nodes.iter().for_each(|(node, share)| diagonal[*node] += weight * share * share);
    }
    for_neighbours(field.len(), |a, b| [a, b].iter().for_each(|n| diagonal[*n] += SMOOTHNESS_SIGMA.powi(-2)));
    let mut residual: Vec<f64> = normal_product(field, constraints, weights).iter().map(|value| -value).collect();
    for (constraint, weight) in constraints.iter().zip(weights) {
        constraint.nodes.iter().for_each(|(node, share)| residual[*node] += weight * share * constraint.delta);
    }
    let preconditioned =
        |residual: &[f64]| residual.iter().zip(&diagonal).map(|(r, diagonal)| r / diagonal).collect::<Vec<_>>();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut direction = preconditioned(&residual);
    let mut norm = dot(&residual, &direction);
    let tolerance = 1e-8 * norm;
    for _ in 0..CG_ITERATIONS {
        if norm <= tolerance {
            break;
        }
        let product = normal_product(&direction, constraints, weights);
        let alpha = norm / dot(&direction, &product);
        field.iter_mut().zip(&direction).for_each(|(node, direction)| *node += alpha * direction);
        residual.iter_mut().zip(&product).for_each(|(residual, product)| *residual -= alpha * product);
        let next = preconditioned(&residual);
        let next_norm = dot(&residual, &next);
        let beta = next_norm / norm;
        direction.iter_mut().zip(&next).for_each(|(direction, next)| *direction = next + beta * *direction);
        norm = next_norm;
    }
}

/// The matrix of the normal equations times a field.
fn normal_product(field: &[f64], constraints: &[GainConstraint], weights: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = field.iter().map(|node| node * PRIOR_SIGMA.powi(-2)).collect();
    for (constraint, weight) in constraints.iter().zip(weights) {
        let predicted = weight * constraint.predicted(field);
        constraint.nodes.iter().for_each(|(node, share)| out[*node] += share * predicted);
    }
    for_neighbours(field.len(), |a, b| {
        let pull = SMOOTHNESS_SIGMA.powi(-2) * (field[a] - field[b]);
        out[a] += pull;
        out[b] -= pull;
    });
    out
}

/// Calls `each` with every pair of neighbouring nodes of a frame.
fn for_neighbours(nodes: usize, mut each: impl FnMut(usize, usize)) {
    for node in 0..nodes {
        let (x, y) = (node % NODES % NODES_ACROSS, node % NODES / NODES_ACROSS);
        if x + 1 < NODES_ACROSS {
            each(node, node + 1);
        }
        if y + 1 < NODES_DOWN {
            each(node, node + NODES_ACROSS);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames that pan over a wall. Each is brighter towards one side, by its own slope.
    fn panned(frames: usize, slope: impl Fn(usize) -> f32) -> Vec<SpatialGainPair> {
        let field = |frame: usize, at: [f32; 2]| slope(frame) * (at[0] - 0.5);
        let mut pairs = Vec::new();
        for to in 0..frames {
            for gap in GAPS.into_iter().chain(HELD_OUT).filter(|gap| *gap <= to) {
                let from = to - gap;
                let samples: Vec<RatioSample> = (0..2400)
                    .map(|n| {
                        let here = [(n % 60) as f32 / 60.0, (n / 60) as f32 / 40.0];
                        let before = [here[0] * 0.9 + 0.05, here[1]];
                        let ratio = f64::from(field(to, here) - field(from, before));
                        // One in 17 is an outlier, such as a moving object.
                        RatioSample { from: before, to: here, ratio: if n % 17 == 0 { ratio + 0.8 } else { ratio } }
                    })
                    .collect();
                pairs.push(of_pair(from, to, &samples, 0.0));
            }
        }
        pairs
    }

    #[test]
    fn oscillating_field_is_recovered_and_a_zero_field_is_not_followed() {
        let slope = |frame: usize| 0.3 * (0.7 * frame as f32).sin();
        let (gains, fitted) = solve(&panned(40, slope), 40).unwrap();
        assert!(fitted.is_followed && fitted.left < 0.25 * fitted.recorded, "{fitted:?}");
        for (frame, across) in gains.iter().enumerate().skip(5).take(30) {
            let difference = std::f32::consts::LN_2 * (across.at([0.9, 0.5]) - across.at([0.1, 0.5]));
            let expected = 0.8 * slope(frame);
            assert!((difference - expected).abs() < 0.03, "{frame}: {difference} for {expected}");
        }
        let (_, fitted) = solve(&panned(40, |_| 0.0), 40).unwrap();
        assert!(!fitted.is_followed, "{fitted:?}");
        assert!(solve(&[], 3).is_none());
    }

    #[test]
    fn nodes_are_clamped_to_the_largest_gain() {
        // The sides' gains drift apart by nearly three stops, by steps that the robust loss keeps.
        let (gains, fitted) = solve(&panned(40, |frame| 0.05 * frame as f32), 40).unwrap();
        let largest = gains.iter().flat_map(|across| across.0).fold(0.0f32, |largest, node| node.abs().max(largest));
        assert!(largest == MAX_EV as f32 && (fitted.max_ev - MAX_EV).abs() < 1e-12, "{largest} {fitted:?}");
    }
}
