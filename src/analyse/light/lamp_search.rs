//! Where lamps are: a grid over the room, then descent, and one lamp more as long as that is worth
//! it.

use std::sync::OnceLock;

use glam::{DVec3, USizeVec3};

use super::bounce::{self, mean_share};
use super::lamp_fit::{BasisRow, Fit, LampSource, LitPoint, MAX_LAMPS, PATCH_M, ambient, fit, lamp_irradiance};
use super::occupancy::OccupancyGrid;
use crate::parallel::over_rows;

/// Cells of the grid are so wide, m.
const GRID_M: f64 = 0.35;
/// Of the grid's columns, every `COARSE`th along each horizontal axis is tried first, then the
/// neighbours of the `REFINED` best cells.
const COARSE: usize = 2;
const REFINED: usize = 12;
/// Points that the grid is tried with.
const FEW: usize = 700;
/// Rounds of a fit on the grid, and of one that counts.
const ROUGH: usize = 4;
const MIDDLING: usize = 8;
pub const FINE: usize = 20;
/// A lamp more is kept if the score falls by more than this share, and by this share of what no
/// lamp leaves: less is the pattern on surfaces.
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
pub struct SearchVolume {
    pub low: DVec3,
    pub high: DVec3,
    pub up: DVec3,
}

impl SearchVolume {
    /// Cells of the grid along each axis.
    fn counts(&self) -> USizeVec3 {
        ((self.high - self.low) / GRID_M).ceil().max(DVec3::ONE).as_usizevec3()
    }

    /// The middle of a cell.
    fn middle(&self, cell: USizeVec3) -> DVec3 {
        self.low + (cell.as_dvec3() + 0.5) / self.counts().as_dvec3() * (self.high - self.low)
    }

    /// The axis that is nearest to up.
    fn vertical_axis(&self) -> usize {
        (0..3).max_by(|a, b| self.up[*a].abs().total_cmp(&self.up[*b].abs())).unwrap_or(2)
    }
}

#[derive(Clone, Debug)]
pub struct LampSearchResult {
    pub lamps: Vec<LampSource>,
    pub fit: Fit,
    /// With none, one, two ... lamps.
    pub scores: Vec<f64>,
}

/// Cells all over the room, as places of a lamp.
struct Grid {
    /// Points with which they are tried.
    few: Vec<LitPoint>,
    counts: USizeVec3,
    cells: Vec<Cell>,
}

struct Cell {
    at: DVec3,
    /// Whether light from here falls on each of the few; worked out when the cell is first tried.
    seen: OnceLock<Vec<bool>>,
}

impl Grid {
    fn index(&self, cell: USizeVec3) -> usize {
        (cell.z * self.counts.y + cell.y) * self.counts.x + cell.x
    }

    fn cell(&self, index: usize) -> USizeVec3 {
        let [x, y] = [self.counts.x, self.counts.y];
        USizeVec3::new(index % x, index / x % y, index / x / y)
    }

    /// The cells that are tried first.
    fn coarse(&self, vertical: usize) -> Vec<usize> {
        let is_coarse = |index: &usize| {
            let cell = self.cell(*index);
            (0..3).all(|axis| axis == vertical || cell[axis] % COARSE == COARSE / 2)
        };
        let all = 0..self.cells.len();
        let coarse: Vec<usize> = all.clone().filter(is_coarse).collect();
        if coarse.is_empty() { all.collect() } else { coarse }
    }

    /// A cell and those that touch it.
    fn around(&self, index: usize) -> impl Iterator<Item = usize> {
        let cell = self.cell(index);
        let low = cell.saturating_sub(USizeVec3::ONE);
        let high = (cell + 1).min(self.counts - 1);
        let within = move |axis: usize| low[axis]..=high[axis];
        within(2)
            .flat_map(move |z| within(1).flat_map(move |y| within(0).map(move |x| USizeVec3::new(x, y, z))))
            .map(|cell| self.index(cell))
    }
}

/// A lamp of one kind in a cell, and how well it explains the light.
#[derive(Clone, Copy, Debug)]
struct Trial {
    cell: usize,
    place: LampSource,
    score: f64,
}

pub struct Search<'a> {
    pub points: &'a [LitPoint],
    pub occupancy: &'a OccupancyGrid,
    pub volume: SearchVolume,
    pub threads: usize,
}

impl Search<'_> {
    fn shares(&self, points: &[LitPoint], lamps: &[LampSource]) -> Vec<BasisRow> {
        let of = |point: &LitPoint| {
            let mut shares = ambient(point.normal, self.volume.up);
            for (k, lamp) in lamps.iter().enumerate() {
                shares[2 + k] = self.share(point, lamp);
            }
            shares
        };
        points.iter().map(of).collect()
    }

    fn share(&self, point: &LitPoint, lamp: &LampSource) -> f64 {
        self.occupancy.lamp_irradiance(point.at, point.normal, lamp)
    }

    /// A grid over the room.
    fn grid(&self) -> Grid {
        let step = self.points.len().div_ceil(FEW).max(1);
        let few: Vec<LitPoint> = self.points.iter().step_by(step).copied().collect();
        let mut grid = Grid { few, counts: self.volume.counts(), cells: Vec::new() };
        let count = grid.counts.element_product();
        grid.cells = (0..count).map(|n| Cell { at: self.volume.middle(grid.cell(n)), seen: OnceLock::new() }).collect();
        grid
    }

    pub fn with(&self, lamps: &[LampSource], rounds: usize) -> Fit {
        fit(self.points, &self.shares(self.points, lamps), lamps.len(), rounds)
    }

    /// Averages over the middles of a patch's quarters, because a hard shadow edge inside it would
    /// look like a penumbra.
    fn share_of_patch(&self, point: &LitPoint, lamp: &LampSource) -> f64 {
        let (x, y) = point.normal.any_orthonormal_pair();
        let quarter_m = 0.25 * PATCH_M;
        let middles = [x + y, x - y, y - x, -x - y].map(|way| LitPoint { at: point.at + quarter_m * way, ..*point });
        middles.iter().map(|middle| self.share(middle, lamp)).sum::<f64>() / middles.len() as f64
    }

    /// Of ambient light, of all lamps, and of their bounce light.
    pub fn shares_with_bounce(&self, lamps: &[LampSource]) -> Vec<BasisRow> {
        let spheres: Vec<Vec<LampSource>> = lamps.iter().map(|lamp| bounce::places(lamp, self.occupancy)).collect();
        let mut shares: Vec<BasisRow> = self.points.iter().map(|point| ambient(point.normal, self.volume.up)).collect();
        over_rows(&mut shares, 1, self.threads, |n, shares| {
            let point = &self.points[n];
            for (k, (lamp, sphere)) in lamps.iter().zip(&spheres).enumerate() {
                shares[0][2 + k] = self.share_of_patch(point, lamp);
                shares[0][2 + lamps.len() + k] = mean_share(sphere, |place| self.share(point, place));
            }
        });
        shares
    }

    pub fn lamps(&self, most: usize) -> LampSearchResult {
        let grid = self.grid();
        let mut found = self.with(&[], FINE);
        let mut scores = vec![found.score];
        let mut lamps: Vec<LampSource> = Vec::new();
        // Where there are two lamps, the best place for one is between them. Other places are kept,
        // so that a second lamp is sought beside each.
        let mut kept: Vec<Vec<LampSource>> = vec![Vec::new()];
        while lamps.len() < most.min(MAX_LAMPS) {
            let mut next: Vec<(Vec<LampSource>, Fit)> =
                kept.iter().flat_map(|lamps| self.one_more(&grid, lamps)).collect();
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
        LampSearchResult { lamps, fit: found, scores }
    }

    /// Moves lamps to where they fit best; then takes each away, the oldest first, and seeks it
    /// anew, as long as that lowers the score.
    fn exchanged(&self, grid: &Grid, lamps: &mut Vec<LampSource>) -> Fit {
        let fine = |lamps: &mut Vec<LampSource>| {
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

    /// Scores of a bulb and of a panel in each of the cells, beside lamps that are known.
    fn tried(&self, grid: &Grid, cells: &[usize], lamps: &[LampSource]) -> Vec<Trial> {
        let known = self.shares(&grid.few, lamps);
        let kinds = [None, Some(-self.volume.up)];
        let mut trials: Vec<Trial> = cells
            .iter()
            .flat_map(|cell| kinds.map(|along| (*cell, along)))
            .map(|(cell, along)| Trial {
                cell,
                place: LampSource { at: grid.cells[cell].at, along },
                score: f64::INFINITY,
            })
            .collect();
        over_rows(&mut trials, kinds.len(), self.threads, |_, trials| {
            let cell = &grid.cells[trials[0].cell];
            if lamps.iter().any(|lamp| lamp.at.distance(cell.at) < APART_M) {
                return;
            }
            // The same points see a bulb and a panel.
            let bulb = LampSource { at: cell.at, along: None };
            let seen = cell.seen.get_or_init(|| grid.few.iter().map(|point| self.share(point, &bulb) > 0.0).collect());
            let mut shares = known.clone();
            for trial in trials {
                for ((point, shares), is_seen) in grid.few.iter().zip(&mut shares).zip(seen) {
                    shares[2 + lamps.len()] =
                        if *is_seen { lamp_irradiance(point.at, point.normal, &trial.place) } else { 0.0 };
                }
                trial.score = fit(&grid.few, &shares, lamps.len() + 1, ROUGH).score;
            }
        });
        trials
    }

    /// Places of the grid for one lamp more, the best first.
    fn candidates(&self, grid: &Grid, lamps: &[LampSource]) -> Vec<Trial> {
        let coarse = grid.coarse(self.volume.vertical_axis());
        let mut trials = self.tried(grid, &coarse, lamps);
        trials.sort_by(|a, b| a.score.total_cmp(&b.score));
        let near = trials.iter().filter(|trial| trial.score.is_finite()).take(REFINED);
        let mut finer: Vec<usize> = near.flat_map(|trial| grid.around(trial.cell)).collect();
        finer.sort_unstable();
        finer.dedup();
        finer.retain(|cell| coarse.binary_search(cell).is_err());
        trials.extend(self.tried(grid, &finer, lamps));
        trials.sort_by(|a, b| a.score.total_cmp(&b.score));
        trials
    }

    /// With one lamp more, all of them moved to where they fit best, roughly: from each of the best
    /// places of the grid.
    fn one_more(&self, grid: &Grid, lamps: &[LampSource]) -> Vec<(Vec<LampSource>, Fit)> {
        // The best, and others that are not beside it.
        let mut begun: Vec<LampSource> = Vec::new();
        for Trial { place, score, .. } in self.candidates(grid, lamps) {
            let is_beside = |b: &LampSource| b.along == place.along && b.at.distance(place.at) < 2.0 * GRID_M;
            if score.is_finite() && begun.len() < BEGUN && !begun.iter().any(is_beside) {
                begun.push(place);
            }
        }
        let mut tried: Vec<(Vec<LampSource>, Option<Fit>)> =
            begun.iter().map(|at| ([lamps, &[*at]].concat(), None)).collect();
        over_rows(&mut tried, 1, self.threads, |_, slot| {
            let (lamps, fit) = &mut slot[0];
            self.descended(&grid.few, lamps, FIRST_M, FIRST_M / 4.0);
            *fit = Some(self.with(lamps, FINE));
        });
        tried.into_iter().filter_map(|(lamps, fit)| Some((lamps, fit?))).collect()
    }

    /// Moves lamps by steps that halve, as long as the score falls.
    fn descended(&self, points: &[LitPoint], lamps: &mut [LampSource], first_m: f64, last_m: f64) {
        let mut shares = self.shares(points, lamps);
        let mut best = fit(points, &shares, lamps.len(), MIDDLING).score;
        let mut step_m = first_m;
        while step_m >= last_m {
            let before = best;
            for k in (0..lamps.len()).rev() {
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    for way in [step_m, -step_m] {
                        let at = (lamps[k].at + way * axis).clamp(self.volume.low, self.volume.high);
                        let place = LampSource { at, ..lamps[k] };
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
