//! How brightness changes across the picture and not with the same surfaces: phones brighten dark parts of a picture and darken
//! bright ones (local tone mapping), lenses darken its corners, and a response that is not the camera's makes dark surfaces
//! follow an exposure otherwise than bright ones.
//!
//! Two frames i and j show a surface at x_i and x_j. What the logarithm of its light changes by beyond the frames' gains is
//!
//!   δ = f_j(x_j) − f_i(x_i),
//!
//! where f is a smooth field over each frame's picture: linear between nodes ([`Across`]). All frames at once:
//!
//!   least Σ ρ_Cauchy(δ − (f_j(x_j) − f_i(x_i)); σ) / σ² + Σ f² / [`PRIOR`]² + Σ (f_a − f_b)² / [`SMOOTH`]²
//!
//! over nodes and neighbouring nodes of a frame, by conjugate gradients. A surface's own brightness cancels, so what a camera does
//! alike to the same things in all frames is not seen. Nothing is followed unless pairs that took no part say it, too.

use std::f64::consts::LN_2;

use serde::{Deserialize, Serialize};

use super::robust::scatter;
use crate::frame::{Across, NODES, NODES_ACROSS, NODES_DOWN};

/// Distances of pairs that are asked, and of those that judge, frames.
pub const GAPS: [usize; 3] = [1, 5, 20];
pub const HELD_OUT: [usize; 2] = [7, 13];
/// Places of a pair: so many across and down, of so many points at least.
const PLACES: [usize; 2] = [8, 6];
const LEAST_POINTS: usize = 16;
/// What a place's median errs by beside its scatter, ln.
const SIGMA: f64 = 0.01;
/// Standard deviation of a node, and of its difference to a neighbour, ln.
const PRIOR: f64 = 0.1;
const SMOOTH: f64 = 0.05;
/// No node says more, stops.
pub const MOST_EV: f64 = 0.7;
/// Followed if held-out places keep half of their variance at most, and scatter by so much less, ln: glossy floors, whose mirror
/// images move, look a little like it.
const LEFT: f64 = 0.7;
const LEAST: f64 = 0.005;
const ROUNDS: usize = 4;
const STEPS: usize = 60;

/// What places in two frames say.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct OfPair {
    pub from: usize,
    pub to: usize,
    /// Of each place: where it is in both frames (shares of width and height), δ and its σ.
    places: Vec<[f32; 6]>,
}

/// How well the field explains pairs that took no part: their scatter, ln, without it and with it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fitted {
    pub recorded: f64,
    pub left: f64,
    /// The largest node's size, stops.
    pub most_ev: f64,
    /// Whether it is followed.
    pub is_followed: bool,
}

/// A surface in two frames: where it is in each, as shares of width and height, and the ratio of its light, ln.
pub struct Point {
    pub from: [f32; 2],
    pub to: [f32; 2],
    pub ratio: f64,
}

/// By places of the later picture. `ratio`: of the whole pair.
pub fn of_pair(from: usize, to: usize, points: &[Point], ratio: f64) -> OfPair {
    let mut by_place: Vec<Vec<&Point>> = vec![Vec::new(); PLACES[0] * PLACES[1]];
    for point in points {
        let [x, y] = [0, 1].map(|i| ((point.to[i] * PLACES[i] as f32) as usize).min(PLACES[i] - 1));
        by_place[y * PLACES[0] + x].push(point);
    }
    let place = |points: &Vec<&Point>| {
        (points.len() >= LEAST_POINTS).then(|| {
            let mean = |of: fn(&Point) -> f32| points.iter().map(|p| of(p)).sum::<f32>() / points.len() as f32;
            let (middle, spread) = scatter(&mut points.iter().map(|p| p.ratio - ratio).collect::<Vec<_>>());
            let sigma = SIGMA.hypot(spread * (20.0 / points.len() as f64).sqrt());
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
    OfPair { from, to, places: by_place.iter().filter_map(place).collect() }
}

/// One per frame, and how well they explain what took no part; `None` where nothing was compared.
pub fn solve(pairs: &[OfPair], frames: usize) -> Option<(Vec<Across>, Fitted)> {
    let of = |gaps: &[usize]| -> Vec<Seen> {
        pairs.iter().filter(|pair| gaps.contains(&(pair.to - pair.from))).flat_map(Seen::of).collect()
    };
    let (seen, held_out) = (of(&GAPS), of(&HELD_OUT));
    if seen.is_empty() || held_out.is_empty() {
        return None;
    }
    let mut field = vec![0.0; frames * NODES];
    for _ in 0..ROUNDS {
        let weights: Vec<f64> = seen.iter().map(|seen| seen.weight(&field)).collect();
        descend(&mut field, &seen, &weights);
    }
    field.iter_mut().for_each(|node| *node = node.clamp(-MOST_EV * LN_2, MOST_EV * LN_2));
    let left_by = |off: &dyn Fn(&Seen) -> f64| scatter(&mut held_out.iter().map(off).collect::<Vec<_>>()).1;
    let (recorded, left) = (left_by(&|seen| seen.off), left_by(&|seen| seen.off - seen.says(&field)));
    let fitted = Fitted {
        recorded,
        left,
        most_ev: field.iter().fold(0.0, |most, node| node.abs().max(most)) / LN_2,
        is_followed: left < LEFT * recorded && (recorded * recorded - left * left).max(0.0).sqrt() > LEAST,
    };
    let of_frame = |nodes: &[f64]| Across(std::array::from_fn(|n| (nodes[n] / LN_2) as f32));
    Some((field.chunks_exact(NODES).map(of_frame).collect(), fitted))
}

/// A place in two frames, by the nodes that say its light: four of each frame, the earlier one's with weights below 0.
struct Seen {
    nodes: [(usize, f64); 8],
    off: f64,
    sigma: f64,
}

impl Seen {
    fn of(pair: &OfPair) -> impl Iterator<Item = Self> {
        pair.places.iter().map(|[from_x, from_y, to_x, to_y, off, sigma]| {
            let (from, to) = (Across::weights([*from_x, *from_y]), Across::weights([*to_x, *to_y]));
            let nodes = std::array::from_fn(|n| match n {
                0..4 => (pair.from * NODES + from[n].0, -f64::from(from[n].1)),
                _ => (pair.to * NODES + to[n - 4].0, f64::from(to[n - 4].1)),
            });
            Self { nodes, off: f64::from(*off), sigma: f64::from(*sigma) }
        })
    }

    fn says(&self, field: &[f64]) -> f64 {
        self.nodes.iter().map(|(node, weight)| weight * field[*node]).sum()
    }

    fn weight(&self, field: &[f64]) -> f64 {
        let off = (self.off - self.says(field)) / (2.0 * self.sigma);
        self.sigma.powi(-2) / (1.0 + off * off)
    }
}

/// Conjugate gradients, each unknown scaled by its own equation.
fn descend(field: &mut [f64], seen: &[Seen], weights: &[f64]) {
    let mut own = vec![PRIOR.powi(-2); field.len()];
    for (seen, weight) in seen.iter().zip(weights) {
        seen.nodes.iter().for_each(|(node, share)| own[*node] += weight * share * share);
    }
    each_neighbours(field.len(), |a, b| [a, b].iter().for_each(|n| own[*n] += SMOOTH.powi(-2)));
    let mut rest: Vec<f64> = applied(field, seen, weights).iter().map(|value| -value).collect();
    for (seen, weight) in seen.iter().zip(weights) {
        seen.nodes.iter().for_each(|(node, share)| rest[*node] += weight * share * seen.off);
    }
    let scaled = |rest: &[f64]| rest.iter().zip(&own).map(|(rest, own)| rest / own).collect::<Vec<_>>();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut way = scaled(&rest);
    let mut size = dot(&rest, &way);
    let enough = 1e-8 * size;
    for _ in 0..STEPS {
        if size <= enough {
            break;
        }
        let pushed = applied(&way, seen, weights);
        let far = size / dot(&way, &pushed);
        field.iter_mut().zip(&way).for_each(|(node, way)| *node += far * way);
        rest.iter_mut().zip(&pushed).for_each(|(rest, pushed)| *rest -= far * pushed);
        let next = scaled(&rest);
        let next_size = dot(&rest, &next);
        let turn = next_size / size;
        way.iter_mut().zip(&next).for_each(|(way, next)| *way = next + turn * *way);
        size = next_size;
    }
}

/// The equations' left side.
fn applied(field: &[f64], seen: &[Seen], weights: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = field.iter().map(|node| node * PRIOR.powi(-2)).collect();
    for (seen, weight) in seen.iter().zip(weights) {
        let said = weight * seen.says(field);
        seen.nodes.iter().for_each(|(node, share)| out[*node] += share * said);
    }
    each_neighbours(field.len(), |a, b| {
        let pull = SMOOTH.powi(-2) * (field[a] - field[b]);
        out[a] += pull;
        out[b] -= pull;
    });
    out
}

/// Nodes beside each other in a frame.
fn each_neighbours(nodes: usize, mut each: impl FnMut(usize, usize)) {
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

    /// Frames that pan over a wall, each brighter towards one side by what it alone knows.
    fn panned(frames: usize, slope: impl Fn(usize) -> f32) -> Vec<OfPair> {
        let field = |frame: usize, at: [f32; 2]| slope(frame) * (at[0] - 0.5);
        let mut pairs = Vec::new();
        for to in 0..frames {
            for gap in GAPS.into_iter().chain(HELD_OUT).filter(|gap| *gap <= to) {
                let from = to - gap;
                let points: Vec<Point> = (0..2400)
                    .map(|n| {
                        let seen = [(n % 60) as f32 / 60.0, (n / 60) as f32 / 40.0];
                        let before = [seen[0] * 0.9 + 0.05, seen[1]];
                        let ratio = f64::from(field(to, seen) - field(from, before));
                        // Some of what is seen moves.
                        Point { from: before, to: seen, ratio: if n % 17 == 0 { ratio + 0.8 } else { ratio } }
                    })
                    .collect();
                pairs.push(of_pair(from, to, &points, 0.0));
            }
        }
        pairs
    }

    #[test]
    fn a_field_that_swings_is_found_and_one_that_is_not_there_is_not_followed() {
        let slope = |frame: usize| 0.3 * (0.7 * frame as f32).sin();
        let (found, fitted) = solve(&panned(40, slope), 40).unwrap();
        assert!(fitted.is_followed && fitted.left < 0.25 * fitted.recorded, "{fitted:?}");
        for (frame, across) in found.iter().enumerate().skip(5).take(30) {
            let says = std::f32::consts::LN_2 * (across.at([0.9, 0.5]) - across.at([0.1, 0.5]));
            assert!((says - 0.8 * slope(frame)).abs() < 0.03, "{frame}: {says} for {}", 0.8 * slope(frame));
        }
        let (_, fitted) = solve(&panned(40, |_| 0.0), 40).unwrap();
        assert!(!fitted.is_followed, "{fitted:?}");
        assert!(solve(&[], 3).is_none());
    }

    #[test]
    fn no_node_leaves_its_bounds() {
        // Its sides grow apart by nearly three stops, slowly enough to be believed.
        let (found, fitted) = solve(&panned(40, |frame| 0.05 * frame as f32), 40).unwrap();
        let most = found.iter().flat_map(|across| across.0).fold(0.0f32, |most, node| node.abs().max(most));
        assert!(most == MOST_EV as f32 && (fitted.most_ev - MOST_EV).abs() < 1e-12, "{most} {fitted:?}");
    }
}
