//! Where lamps are: a grid over the room, then descent, and one lamp more as long as that is worth it.

use glam::DVec3;

use super::blocked::Blocked;
use super::lit::{Fit, MOST_LAMPS, Place, Point, Shares, ambient, fit, of_lamp};
use crate::rows::over_rows;

/// Cells of the grid are so wide, m.
const GRID_M: f64 = 0.35;
/// Points that the grid is tried with.
const FEW: usize = 700;
/// Rounds of a fit on the grid, and of one that counts.
const ROUGH: usize = 4;
const MIDDLING: usize = 8;
pub const FINE: usize = 20;
/// A lamp more is kept if the score falls by more than this share, and by this share of what no lamp leaves: less is the pattern on
/// surfaces.
pub const WORTH: f64 = 0.1;
pub const WORTH_OF_ALL: f64 = 0.03;
/// Roughly placed, it has to be worth this share of that, or it is not looked at more closely.
const WORTH_A_LOOK: f64 = 0.5;
/// A lamp is exchanged if the score falls by more than this share.
const EXCHANGED: f64 = 0.02;
/// Steps of the descent, m.
const FIRST_M: f64 = 0.2;
const LAST_M: f64 = 0.02;
/// Lamps are at least so far from each other, m.
pub const APART_M: f64 = 0.4;
/// Places of the grid from which the descent begins.
const BEGUN: usize = 4;

/// Where lamps may be.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    pub low: DVec3,
    pub high: DVec3,
    pub up: DVec3,
}

impl Room {
    /// The middles of cells all over it.
    fn cells(&self) -> impl Iterator<Item = DVec3> {
        let Self { low, high, .. } = *self;
        let counts = ((high - low) / GRID_M).ceil().max(DVec3::ONE).as_usizevec3();
        let at =
            move |n: usize, axis: usize| low[axis] + (n as f64 + 0.5) / counts[axis] as f64 * (high[axis] - low[axis]);
        let all = 0..counts.x * counts.y * counts.z;
        all.map(move |n| {
            DVec3::new(at(n % counts.x, 0), at(n / counts.x % counts.y, 1), at(n / counts.x / counts.y, 2))
        })
    }
}

#[derive(Clone, Debug)]
pub struct Found {
    pub lamps: Vec<Place>,
    pub fit: Fit,
    /// With none, one, two ... lamps.
    pub scores: Vec<f64>,
}

/// Places all over the room, and what sees them.
struct Grid {
    /// Points with which they are tried.
    few: Vec<Point>,
    cells: Vec<Cell>,
}

struct Cell {
    at: DVec3,
    /// Whether light from here falls on each of the few.
    seen: Vec<bool>,
}

pub struct Search<'a> {
    pub points: &'a [Point],
    pub blocked: &'a Blocked,
    pub room: Room,
    pub threads: usize,
}

impl Search<'_> {
    fn shares(&self, points: &[Point], lamps: &[Place]) -> Vec<Shares> {
        let of = |point: &Point| {
            let mut shares = ambient(point.normal, self.room.up);
            for (k, lamp) in lamps.iter().enumerate() {
                shares[2 + k] = self.share(point, lamp);
            }
            shares
        };
        points.iter().map(of).collect()
    }

    fn share(&self, point: &Point, lamp: &Place) -> f64 {
        self.blocked.of_lamp(point.at, point.normal, lamp)
    }

    /// A grid over the room.
    fn grid(&self) -> Grid {
        let step = self.points.len().div_ceil(FEW).max(1);
        let few: Vec<Point> = self.points.iter().step_by(step).copied().collect();
        let mut cells: Vec<Cell> = self.room.cells().map(|at| Cell { at, seen: Vec::new() }).collect();
        over_rows(&mut cells, 1, self.threads, |_, cell| {
            let lamp = Place { at: cell[0].at, along: None };
            cell[0].seen = few.iter().map(|point| self.share(point, &lamp) > 0.0).collect();
        });
        Grid { few, cells }
    }

    pub fn with(&self, lamps: &[Place], rounds: usize) -> Fit {
        fit(self.points, &self.shares(self.points, lamps), lamps.len(), rounds)
    }

    pub fn lamps(&self, most: usize) -> Found {
        let grid = self.grid();
        let mut found = self.with(&[], FINE);
        let mut scores = vec![found.score];
        let mut lamps: Vec<Place> = Vec::new();
        // Where there are two lamps, the best place for one is between them. Other places are kept, so that a second lamp is sought beside
        // each.
        let mut kept: Vec<Vec<Place>> = vec![Vec::new()];
        while lamps.len() < most.min(MOST_LAMPS) {
            let mut next: Vec<(Vec<Place>, Fit)> = kept.iter().flat_map(|lamps| self.one_more(&grid, lamps)).collect();
            next.sort_by(|a, b| a.1.score.total_cmp(&b.1.score));
            next.truncate(BEGUN);
            let worth = (WORTH * found.score).max(WORTH_OF_ALL * scores[0]);
            // What the first one is worth is told, if only to say that it is too little.
            let is_worth_a_look = |fit: &Fit| lamps.is_empty() || found.score - fit.score > WORTH_A_LOOK * worth;
            if next.first().is_none_or(|(_, fit)| !is_worth_a_look(fit)) {
                break;
            }
            kept = next.into_iter().map(|(lamps, _)| lamps).collect();
            let Some(best) = kept.first_mut() else { break };
            let better = self.exchanged(&grid, best);
            scores.push(better.score);
            if found.score - better.score < worth {
                break;
            }
            (lamps, found) = (best.clone(), better);
        }
        Found { lamps, fit: found, scores }
    }

    /// Moves lamps to where they fit best; then takes each away, the oldest first, and seeks it anew, as long as that lowers the score.
    fn exchanged(&self, grid: &Grid, lamps: &mut Vec<Place>) -> Fit {
        let fine = |lamps: &mut Vec<Place>| {
            self.descended(self.points, lamps, FIRST_M / 4.0, LAST_M);
            self.with(lamps, FINE)
        };
        let mut fit = fine(lamps);
        let mut k = 0;
        // The last one was sought beside the others as they are.
        while k + 1 < lamps.len() {
            let mut others = lamps.clone();
            others.remove(k);
            let sought = self.one_more(grid, &others).into_iter().min_by(|a, b| a.1.score.total_cmp(&b.1.score));
            k += 1;
            let Some((mut other, _)) = sought else { continue };
            let better = fine(&mut other);
            if better.score < (1.0 - EXCHANGED) * fit.score {
                (*lamps, fit, k) = (other, better, 0);
            }
        }
        fit
    }

    /// With one lamp more, all of them moved to where they fit best, roughly: from each of the best places of the grid.
    fn one_more(&self, Grid { few, cells }: &Grid, lamps: &[Place]) -> Vec<(Vec<Place>, Fit)> {
        let known = self.shares(few, lamps);
        // A bulb at each place, and a panel, which the same points see.
        let kinds =
            |cell: &Cell| [None, Some(-self.room.up)].map(|along| (Place { at: cell.at, along }, f64::INFINITY));
        let mut places: Vec<(Place, f64)> = cells.iter().flat_map(kinds).collect();
        over_rows(&mut places, 2, self.threads, |n, kinds| {
            let cell = &cells[n];
            if lamps.iter().any(|lamp| lamp.at.distance(cell.at) < APART_M) {
                return;
            }
            let mut shares = known.clone();
            for (place, score) in kinds {
                for ((point, shares), is_seen) in few.iter().zip(&mut shares).zip(&cell.seen) {
                    shares[2 + lamps.len()] = if *is_seen { of_lamp(point.at, point.normal, place) } else { 0.0 };
                }
                *score = fit(few, &shares, lamps.len() + 1, ROUGH).score;
            }
        });
        places.sort_by(|a, b| a.1.total_cmp(&b.1));
        // The best, and others that are not beside it.
        let mut begun: Vec<Place> = Vec::new();
        for (at, score) in &places {
            let is_beside = |b: &Place| b.along == at.along && b.at.distance(at.at) < 2.0 * GRID_M;
            if score.is_finite() && begun.len() < BEGUN && !begun.iter().any(is_beside) {
                begun.push(*at);
            }
        }
        let mut tried: Vec<(Vec<Place>, Option<Fit>)> =
            begun.iter().map(|at| ([lamps, &[*at]].concat(), None)).collect();
        over_rows(&mut tried, 1, self.threads, |_, slot| {
            let (lamps, fit) = &mut slot[0];
            self.descended(few, lamps, FIRST_M, FIRST_M / 4.0);
            *fit = Some(self.with(lamps, FINE));
        });
        tried.into_iter().filter_map(|(lamps, fit)| Some((lamps, fit?))).collect()
    }

    /// Moves lamps by steps that halve, as long as the score falls.
    fn descended(&self, points: &[Point], lamps: &mut [Place], first_m: f64, last_m: f64) {
        let mut shares = self.shares(points, lamps);
        let mut best = fit(points, &shares, lamps.len(), MIDDLING).score;
        let mut step_m = first_m;
        while step_m >= last_m {
            let before = best;
            for k in (0..lamps.len()).rev() {
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    for way in [step_m, -step_m] {
                        let at = (lamps[k].at + way * axis).clamp(self.room.low, self.room.high);
                        let place = Place { at, ..lamps[k] };
                        let mut moved = shares.clone();
                        for (point, shares) in points.iter().zip(&mut moved) {
                            shares[2 + k] = self.share(point, &place);
                        }
                        let tried = fit(points, &moved, lamps.len(), MIDDLING).score;
                        if tried < best {
                            (best, shares, lamps[k]) = (tried, moved, place);
                            break;
                        }
                    }
                }
            }
            if best > 0.998 * before {
                step_m *= 0.5;
            }
        }
    }
}
