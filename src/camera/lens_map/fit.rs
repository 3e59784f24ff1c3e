//! Least-squares fit of a lens's table to pairs of places, from the undistorted picture to the
//! recorded one. The pairs need not lie on a grid, so maps of both directions serve.
//!
//! The normal equations of a tensor product of cubic B-splines are banded. Second differences of
//! the control points have a small weight, so that places without pairs continue linearly
//! (P-splines: Eilers and Marx 1996). The number of cells grows until the residuals no longer
//! shrink.

use glam::DVec2;

use super::{LensMap, MapTable, ORDER, cell_of, spline_weights};
use crate::fit::band::BandMatrix;
use crate::fit::quantile::lower_quantile;

/// Places that show the same: in the undistorted picture, px, and in the recorded one, as a
/// fraction of its size from the upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapSample {
    pub undistorted_px: DVec2,
    pub recorded: DVec2,
}

/// Why no table could be fitted.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    #[error("has too few places inside the picture")]
    TooFew,
    /// Root mean square residual, and the place of the largest one in the undistorted picture, px.
    #[error(
        "is not smooth: a table of {MAX_CELLS} cells across deviates from it by {rms_px:.2} px, most at column \
         {:.0}, row {:.0}", at_px[0], at_px[1]
    )]
    Rough { rms_px: f64, at_px: [f64; 2] },
}

/// Cells along the longer side at the first attempt, and at the last.
const MIN_CELLS: usize = 8;
const MAX_CELLS: usize = 64;
/// Smallest number of cells along the shorter side.
const MIN_SHORT_CELLS: usize = 4;
/// Smallest number of pairs.
const MIN_SAMPLES: usize = 64;
/// Weight of second differences, relative to the number of pairs per control point.
const SMOOTHNESS: f64 = 1e-6;
/// Share of the residuals that is below their spread.
const SPREAD_SHARE: f64 = 0.98;
/// Spread of a fit that needs no more cells, px.
const EXACT_PX: f64 = 0.000_5;
/// Share of the residuals that is below their peak: those of a strongly curved corner.
const PEAK_SHARE: f64 = 0.9995;
/// Spread and peak relative to those of fewer cells, above which more of them model noise.
const MIN_IMPROVEMENT: f64 = 0.8;
/// Largest root mean square residual, px. Half a code of 16 bits is 0.06 px of 8192.
const MAX_RMS_PX: f64 = 0.1;
/// Residuals beyond so many spreads are errors of the map: pixels at the rim of its picture, mixed
/// with those outside by a filter.
const OUTLIER: f64 = 3.0;
/// Smallest residual of such a pixel, px.
const MIN_OUTLIER_PX: f64 = 0.02;
/// Largest share of such pixels.
const MAX_OUTLIERS: f64 = 0.05;
/// Steps of a control point's value for each picture: 10⁻⁴ px of 8192.
const VALUE_STEPS: f64 = 1e8;

/// The domain of a fit and its cells.
#[derive(Clone, Copy)]
struct SplineGrid {
    low_px: DVec2,
    high_px: DVec2,
    cells: [usize; 2],
}

impl SplineGrid {
    fn new(samples: &[MapSample], longest: usize) -> Self {
        let places = samples.iter().map(|sample| sample.undistorted_px);
        let (low_px, high_px) =
            places.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), place| (low.min(place), high.max(place)));
        let size = high_px - low_px;
        let side = size.max_element() / longest as f64;
        let cells = size.to_array().map(|length| ((length / side).ceil() as usize).clamp(MIN_SHORT_CELLS, longest));
        Self { low_px, high_px, cells }
    }

    fn size_px(&self) -> DVec2 {
        self.high_px - self.low_px
    }

    fn controls(&self) -> [usize; 2] {
        self.cells.map(|cells| cells + ORDER)
    }

    /// Control points along the shorter side follow each other, for a narrow band.
    fn index(&self, column: usize, row: usize) -> usize {
        let [columns, rows] = self.controls();
        if columns >= rows { column * rows + row } else { row * columns + column }
    }

    fn band_width(&self) -> usize {
        let shorter = self.controls()[0].min(self.controls()[1]);
        ORDER * shorter + ORDER
    }

    /// The control points at a place and their weights.
    fn weights(&self, place_px: DVec2) -> [(usize, f64); 16] {
        let cells = DVec2::new(self.cells[0] as f64, self.cells[1] as f64);
        let place = ((place_px - self.low_px) / self.size_px() * cells).clamp(DVec2::ZERO, cells);
        let ((column, right), (row, down)) = (cell_of(place.x, self.cells[0]), cell_of(place.y, self.cells[1]));
        let (across, downwards) = (spline_weights(right), spline_weights(down));
        std::array::from_fn(|n| {
            let (x, y) = (n % 4, n / 4);
            (self.index(column + x, row + y), across[x][0] * downwards[y][0])
        })
    }

    /// The rows of the smoothness term: second differences along both axes, and the mixed one.
    fn differences(&self) -> Vec<Vec<(usize, f64)>> {
        let [columns, rows] = self.controls();
        let mut differences = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let at = |right: usize, down: usize| self.index(column + right, row + down);
                if column + 2 < columns {
                    differences.push(vec![(at(0, 0), 1.0), (at(1, 0), -2.0), (at(2, 0), 1.0)]);
                }
                if row + 2 < rows {
                    differences.push(vec![(at(0, 0), 1.0), (at(0, 1), -2.0), (at(0, 2), 1.0)]);
                }
                if column + 1 < columns && row + 1 < rows {
                    differences.push(vec![(at(0, 0), 1.0), (at(1, 0), -1.0), (at(0, 1), -1.0), (at(1, 1), 1.0)]);
                }
            }
        }
        differences
    }

    /// Control points by least squares; `None` if the system is singular.
    fn solve(&self, samples: &[MapSample]) -> Option<Vec<DVec2>> {
        let [columns, rows] = self.controls();
        let unknowns = columns * rows;
        let mut system = BandMatrix::new(unknowns, self.band_width());
        let mut add = |terms: &[(usize, f64)], weight: f64| {
            for (n, (a, weight_a)) in terms.iter().enumerate() {
                for (b, weight_b) in &terms[..=n] {
                    system.add(*a.max(b), *a.min(b), weight * weight_a * weight_b);
                }
            }
        };
        samples.iter().for_each(|sample| add(&self.weights(sample.undistorted_px), 1.0));
        let smoothness = SMOOTHNESS * samples.len() as f64 / unknowns as f64;
        self.differences().iter().for_each(|difference| add(difference, smoothness));
        let mut systems = [system.clone(), system];
        for sample in samples {
            for (control, weight) in self.weights(sample.undistorted_px) {
                for (system, place) in systems.iter_mut().zip(sample.recorded.to_array()) {
                    system.add_right(control, weight * place);
                }
            }
        }
        let [x, y] = systems.map(BandMatrix::solved);
        Some(x?.into_iter().zip(y?).map(DVec2::from).collect())
    }
}

/// A fit and its residuals.
struct Fitted {
    grid: SplineGrid,
    controls: Vec<DVec2>,
    residuals_px: Vec<f64>,
}

impl Fitted {
    fn new(samples: &[MapSample], longest: usize, scale_px: DVec2) -> Option<Self> {
        let grid = SplineGrid::new(samples, longest);
        let controls = grid.solve(samples)?;
        let residual = |sample: &MapSample| {
            let terms = grid.weights(sample.undistorted_px);
            let value: DVec2 = terms.iter().map(|(control, weight)| controls[*control] * *weight).sum();
            ((value - sample.recorded) * scale_px).length()
        };
        let residuals_px = samples.iter().map(residual).collect();
        Some(Self { grid, controls, residuals_px })
    }

    fn rms_px(&self) -> f64 {
        let squares: f64 = self.residuals_px.iter().map(|residual| residual * residual).sum();
        (squares / self.residuals_px.len() as f64).sqrt()
    }

    /// A quantile of the residuals, px.
    fn quantile_px(&self, share: f64) -> f64 {
        lower_quantile(&mut self.residuals_px.clone(), share).unwrap_or(f64::INFINITY)
    }

    fn spread_px(&self) -> f64 {
        self.quantile_px(SPREAD_SHARE)
    }

    /// True if it has a smaller spread or peak than one with fewer cells.
    fn is_better_than(&self, coarse: &Self) -> bool {
        let improves = |share: f64| self.quantile_px(share) < MIN_IMPROVEMENT * coarse.quantile_px(share);
        improves(SPREAD_SHARE) || improves(PEAK_SHARE)
    }

    /// The pairs without outliers.
    fn consistent(&self, samples: &[MapSample]) -> Vec<MapSample> {
        let bound_px = (OUTLIER * self.spread_px()).max(MIN_OUTLIER_PX);
        let pairs = samples.iter().zip(&self.residuals_px);
        pairs.filter(|(_, residual)| **residual <= bound_px).map(|(sample, _)| *sample).collect()
    }

    fn longest(&self) -> usize {
        self.grid.cells[0].max(self.grid.cells[1])
    }
}

/// The fit with the fewest cells that is exact, or as good as one with more.
fn refined(samples: &[MapSample], scale_px: DVec2) -> Option<Fitted> {
    let mut best = Fitted::new(samples, MIN_CELLS, scale_px)?;
    while best.spread_px() > EXACT_PX && best.longest() < MAX_CELLS {
        let next = Fitted::new(samples, 2 * best.longest(), scale_px)?;
        if !next.is_better_than(&best) {
            break;
        }
        best = next;
    }
    Some(best)
}

/// Fits a table to pairs of places. `recorded_px` is the recorded picture's size if the pairs state
/// it; otherwise that of the undistorted one scales the residuals.
pub fn fit(
    samples: &[MapSample],
    undistorted_px: [u32; 2],
    recorded_px: Option<[u32; 2]>,
) -> Result<LensMap, FitError> {
    let scale_px = recorded_px.unwrap_or(undistorted_px);
    let scale_px = DVec2::new(scale_px[0].into(), scale_px[1].into());
    let size_px = SplineGrid::new(samples, MIN_CELLS).size_px();
    if samples.len() < MIN_SAMPLES || size_px.min_element() <= 0.0 || !size_px.is_finite() {
        return Err(FitError::TooFew);
    }
    let first = refined(samples, scale_px).ok_or(FitError::TooFew)?;
    let consistent = first.consistent(samples);
    let is_consistent = consistent.len() as f64 >= (1.0 - MAX_OUTLIERS) * samples.len() as f64;
    let (fitted, samples) = if is_consistent && consistent.len() < samples.len() {
        (Fitted::new(&consistent, first.longest(), scale_px).ok_or(FitError::TooFew)?, &*consistent)
    } else {
        (first, samples)
    };
    let rms_px = fitted.rms_px();
    if rms_px.is_nan() || rms_px > MAX_RMS_PX {
        let worst = fitted.residuals_px.iter().zip(samples).max_by(|a, b| a.0.total_cmp(b.0));
        let at_px = worst.map_or([0.0; 2], |(_, sample)| sample.undistorted_px.to_array());
        return Err(FitError::Rough { rms_px, at_px });
    }
    let grid = fitted.grid;
    let [columns, rows] = grid.controls();
    let value = |control: DVec2| (control * VALUE_STEPS).round() / VALUE_STEPS;
    let in_order = (0..columns * rows).map(|n| value(fitted.controls[grid.index(n % columns, n / columns)]));
    Ok(LensMap::new(MapTable {
        undistorted_px,
        recorded_px,
        low_px: grid.low_px,
        high_px: grid.high_px,
        cells: grid.cells,
        controls: in_order.collect(),
    }))
}
