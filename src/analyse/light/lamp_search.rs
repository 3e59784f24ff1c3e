//! Searches lamps: a grid over the room, then descent. Lamps are added as long as each lowers the
//! score enough.

use std::sync::OnceLock;

use glam::{DVec3, USizeVec3};

use super::bounce::{self, mean_share};
use super::lamp_fit::{BasisRow, LampFit, LampSource, LitPoint, MAX_LAMPS, PATCH_M, ambient, fit, lamp_irradiance};
use super::occupancy::OccupancyGrid;
use crate::parallel::over_rows;

/// Width of a grid cell, m.
const GRID_M: f64 = 0.35;
/// Stride of the grid's columns in the coarse pass, and number of its best cells whose neighbours
/// are evaluated afterwards.
const COARSE_STRIDE: usize = 2;
const REFINED_CELLS: usize = 12;
/// Number of points in fits on the grid.
const GRID_POINTS: usize = 700;
/// Iterations of a fit on the grid, during descent, and of a final one.
const GRID_ITERATIONS: usize = 4;
const DESCENT_ITERATIONS: usize = 8;
pub const FINAL_ITERATIONS: usize = 20;
/// Smallest reduction of the score by an additional lamp: by the score before, and by the score
/// without lamps. A smaller one can be due to texture.
pub const MIN_GAIN: f64 = 0.1;
pub const MIN_GAIN_OF_TOTAL: f64 = 0.03;
/// Smallest reduction at an approximate position, by the required one, for a closer search.
const MIN_APPROXIMATE_GAIN: f64 = 0.5;
/// Smallest relative reduction of the score for the relocation of a lamp.
const MIN_RELOCATION_GAIN: f64 = 0.02;
/// First and last step of the descent, m.
const FIRST_STEP_M: f64 = 0.2;
const LAST_STEP_M: f64 = 0.02;
/// Smallest distance between lamps, m.
pub const MIN_LAMP_DISTANCE_M: f64 = 0.4;
/// Number of grid cells from which the descent begins.
const DESCENT_STARTS: usize = 4;

/// The volume in which lamps are searched.
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

    /// The axis nearest to up.
    fn vertical_axis(&self) -> usize {
        (0..3).max_by(|a, b| self.up[*a].abs().total_cmp(&self.up[*b].abs())).unwrap_or(2)
    }
}

/// The lamps with the lowest score, and the fit of their light.
#[derive(Clone, Debug)]
pub struct LampSearchResult {
    pub lamps: Vec<LampSource>,
    pub fit: LampFit,
    /// Scores with 0, 1, 2 … lamps.
    pub scores: Vec<f64>,
}

/// Grid of candidate positions for a lamp.
struct LampGrid {
    /// Points of the fits.
    few: Vec<LitPoint>,
    counts: USizeVec3,
    cells: Vec<LampGridCell>,
}

struct LampGridCell {
    position_m: DVec3,
    /// Whether each of the grid's points is visible from here; computed on first use. No memo: one
    /// value for each cell, borrowed by all threads of the search.
    visible: OnceLock<Vec<bool>>,
}

impl LampGrid {
    fn index(&self, cell: USizeVec3) -> usize {
        (cell.z * self.counts.y + cell.y) * self.counts.x + cell.x
    }

    fn cell(&self, index: usize) -> USizeVec3 {
        let [x, y] = [self.counts.x, self.counts.y];
        USizeVec3::new(index % x, index / x % y, index / x / y)
    }

    /// Cells of the coarse pass.
    fn coarse(&self, vertical: usize) -> Vec<usize> {
        let is_coarse = |index: &usize| {
            let cell = self.cell(*index);
            (0..3).all(|axis| axis == vertical || cell[axis] % COARSE_STRIDE == COARSE_STRIDE / 2)
        };
        let all = 0..self.cells.len();
        let coarse: Vec<usize> = all.clone().filter(is_coarse).collect();
        if coarse.is_empty() { all.collect() } else { coarse }
    }

    /// A cell and its neighbours.
    fn neighbourhood(&self, index: usize) -> impl Iterator<Item = usize> {
        let cell = self.cell(index);
        let low = cell.saturating_sub(USizeVec3::ONE);
        let high = (cell + 1).min(self.counts - 1);
        let within = move |axis: usize| low[axis]..=high[axis];
        within(2)
            .flat_map(move |z| within(1).flat_map(move |y| within(0).map(move |x| USizeVec3::new(x, y, z))))
            .map(|cell| self.index(cell))
    }
}

/// A lamp of one kind in a cell, and its score.
#[derive(Clone, Copy, Debug)]
struct Trial {
    cell: usize,
    place: LampSource,
    score: f64,
}

/// Inputs of a search for lamps.
pub struct Search<'a> {
    pub points: &'a [LitPoint],
    pub occupancy: &'a OccupancyGrid,
    pub volume: SearchVolume,
    pub threads: usize,
}

impl Search<'_> {
    fn shares(&self, points: &[LitPoint], lamps: &[LampSource]) -> Vec<BasisRow> {
        let basis_row = |point: &LitPoint| {
            let mut shares = ambient(point.normal, self.volume.up);
            for (k, lamp) in lamps.iter().enumerate() {
                shares[2 + k] = self.share(point, lamp);
            }
            shares
        };
        points.iter().map(basis_row).collect()
    }

    fn share(&self, point: &LitPoint, lamp: &LampSource) -> f64 {
        self.occupancy.lamp_irradiance(point.position_m, point.normal, lamp)
    }

    /// A grid over the room.
    fn grid(&self) -> LampGrid {
        let step = self.points.len().div_ceil(GRID_POINTS).max(1);
        let few: Vec<LitPoint> = self.points.iter().step_by(step).copied().collect();
        let mut grid = LampGrid { few, counts: self.volume.counts(), cells: Vec::new() };
        let count = grid.counts.element_product();
        grid.cells = (0..count)
            .map(|n| LampGridCell { position_m: self.volume.middle(grid.cell(n)), visible: OnceLock::new() })
            .collect();
        grid
    }

    pub fn with(&self, lamps: &[LampSource], rounds: usize) -> LampFit {
        fit(self.points, &self.shares(self.points, lamps), lamps.len(), rounds)
    }

    /// Mean over the middles of a patch's quarters, because a hard shadow edge inside a patch would
    /// look like a penumbra.
    fn share_of_patch(&self, point: &LitPoint, lamp: &LampSource) -> f64 {
        let (x, y) = point.normal.any_orthonormal_pair();
        let quarter_m = 0.25 * PATCH_M;
        let middles = [x + y, x - y, y - x, -x - y]
            .map(|way| LitPoint { position_m: point.position_m + quarter_m * way, ..*point });
        middles.iter().map(|middle| self.share(middle, lamp)).sum::<f64>() / middles.len() as f64
    }

    /// Rows of ambient light, of all lamps, and of their bounce light.
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

    pub fn lamps(&self, max_lamps: usize) -> LampSearchResult {
        let grid = self.grid();
        let mut solution = self.with(&[], FINAL_ITERATIONS);
        let mut scores = vec![solution.score];
        let mut lamps: Vec<LampSource> = Vec::new();
        // With two lamps in the room, the best position for one is between them. Therefore several
        // positions are kept, and a second lamp is searched for each.
        let mut kept: Vec<Vec<LampSource>> = vec![Vec::new()];
        while lamps.len() < max_lamps.min(MAX_LAMPS) {
            let mut next: Vec<(Vec<LampSource>, LampFit)> =
                kept.iter().flat_map(|lamps| self.with_one_more(&grid, lamps)).collect();
            next.sort_by(|a, b| a.1.score.total_cmp(&b.1.score));
            next.truncate(DESCENT_STARTS);
            let worth = (MIN_GAIN * solution.score).max(MIN_GAIN_OF_TOTAL * scores[0]);
            // The score with the first lamp is always recorded, because it is reported.
            let is_promising =
                |fit: &LampFit| lamps.is_empty() || solution.score - fit.score > MIN_APPROXIMATE_GAIN * worth;
            if next.first().is_none_or(|(_, fit)| !is_promising(fit)) {
                break;
            }
            kept = next.into_iter().map(|(lamps, _)| lamps).collect();
            let Some(best) = kept.first_mut() else { break };
            let better = self.relocate(&grid, best);
            scores.push(better.score);
            if solution.score - better.score < worth {
                break;
            }
            (lamps, solution) = (best.clone(), better);
        }
        LampSearchResult { lamps, fit: solution, scores }
    }

    /// Moves lamps to where they fit best. Then removes each, the oldest first, and searches it
    /// again, as long as that lowers the score.
    fn relocate(&self, grid: &LampGrid, lamps: &mut Vec<LampSource>) -> LampFit {
        let fine = |lamps: &mut Vec<LampSource>| {
            self.descend(self.points, lamps, FIRST_STEP_M / 4.0, LAST_STEP_M);
            self.with(lamps, FINAL_ITERATIONS)
        };
        let mut fit = fine(lamps);
        let mut k = 0;
        // The last one was searched with the others in place.
        while k + 1 < lamps.len() {
            let mut others = lamps.clone();
            others.remove(k);
            let sought = self.with_one_more(grid, &others).into_iter().min_by(|a, b| a.1.score.total_cmp(&b.1.score));
            k += 1;
            let Some((mut other, _)) = sought else { continue };
            let better = fine(&mut other);
            if better.score < (1.0 - MIN_RELOCATION_GAIN) * fit.score {
                (*lamps, fit, k) = (other, better, 0);
            }
        }
        fit
    }

    /// Scores of a bulb and of a panel in each of the cells, in addition to given lamps.
    fn evaluate(&self, grid: &LampGrid, cells: &[usize], lamps: &[LampSource]) -> Vec<Trial> {
        let base_shares = self.shares(&grid.few, lamps);
        let kinds = [None, Some(-self.volume.up)];
        let mut trials: Vec<Trial> = cells
            .iter()
            .flat_map(|cell| kinds.map(|along| (*cell, along)))
            .map(|(cell, along)| Trial {
                cell,
                place: LampSource { position_m: grid.cells[cell].position_m, along },
                score: f64::INFINITY,
            })
            .collect();
        over_rows(&mut trials, kinds.len(), self.threads, |_, trials| {
            let cell = &grid.cells[trials[0].cell];
            if lamps.iter().any(|lamp| lamp.position_m.distance(cell.position_m) < MIN_LAMP_DISTANCE_M) {
                return;
            }
            // Visibility is the same for a bulb and a panel.
            let bulb = LampSource { position_m: cell.position_m, along: None };
            let visible =
                cell.visible.get_or_init(|| grid.few.iter().map(|point| self.share(point, &bulb) > 0.0).collect());
            let mut shares = base_shares.clone();
            for trial in trials {
                for ((point, shares), is_visible) in grid.few.iter().zip(&mut shares).zip(visible) {
                    shares[2 + lamps.len()] =
                        if *is_visible { lamp_irradiance(point.position_m, point.normal, &trial.place) } else { 0.0 };
                }
                trial.score = fit(&grid.few, &shares, lamps.len() + 1, GRID_ITERATIONS).score;
            }
        });
        trials
    }

    /// Candidate positions of an additional lamp, the best first.
    fn candidates(&self, grid: &LampGrid, lamps: &[LampSource]) -> Vec<Trial> {
        let coarse = grid.coarse(self.volume.vertical_axis());
        let mut trials = self.evaluate(grid, &coarse, lamps);
        trials.sort_by(|a, b| a.score.total_cmp(&b.score));
        let near = trials.iter().filter(|trial| trial.score.is_finite()).take(REFINED_CELLS);
        let mut finer: Vec<usize> = near.flat_map(|trial| grid.neighbourhood(trial.cell)).collect();
        finer.sort_unstable();
        finer.dedup();
        finer.retain(|cell| coarse.binary_search(cell).is_err());
        trials.extend(self.evaluate(grid, &finer, lamps));
        trials.sort_by(|a, b| a.score.total_cmp(&b.score));
        trials
    }

    /// Adds a lamp at each of the best grid cells, and moves all lamps to where they approximately
    /// fit best.
    fn with_one_more(&self, grid: &LampGrid, lamps: &[LampSource]) -> Vec<(Vec<LampSource>, LampFit)> {
        // The best candidates that are not near each other.
        let mut begun: Vec<LampSource> = Vec::new();
        for Trial { place, score, .. } in self.candidates(grid, lamps) {
            let is_beside =
                |b: &LampSource| b.along == place.along && b.position_m.distance(place.position_m) < 2.0 * GRID_M;
            if score.is_finite() && begun.len() < DESCENT_STARTS && !begun.iter().any(is_beside) {
                begun.push(place);
            }
        }
        let mut tried: Vec<(Vec<LampSource>, Option<LampFit>)> =
            begun.iter().map(|at| ([lamps, &[*at]].concat(), None)).collect();
        over_rows(&mut tried, 1, self.threads, |_, slot| {
            let (lamps, fit) = &mut slot[0];
            self.descend(&grid.few, lamps, FIRST_STEP_M, FIRST_STEP_M / 4.0);
            *fit = Some(self.with(lamps, FINAL_ITERATIONS));
        });
        tried.into_iter().filter_map(|(lamps, fit)| Some((lamps, fit?))).collect()
    }

    /// Coordinate descent of the lamps' positions, with halving steps.
    fn descend(&self, points: &[LitPoint], lamps: &mut [LampSource], first_m: f64, last_m: f64) {
        let mut shares = self.shares(points, lamps);
        let mut best = fit(points, &shares, lamps.len(), DESCENT_ITERATIONS).score;
        let mut step_m = first_m;
        while step_m >= last_m {
            let before = best;
            for k in (0..lamps.len()).rev() {
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    for way in [step_m, -step_m] {
                        let at = (lamps[k].position_m + way * axis).clamp(self.volume.low, self.volume.high);
                        let place = LampSource { position_m: at, ..lamps[k] };
                        let mut moved = shares.clone();
                        for (point, shares) in points.iter().zip(&mut moved) {
                            shares[2 + k] = self.share(point, &place);
                        }
                        let tried = fit(points, &moved, lamps.len(), DESCENT_ITERATIONS).score;
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
