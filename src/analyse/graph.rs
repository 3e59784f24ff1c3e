//! The corrections of all frames at once, from their links and from what was recorded.
//!
//! A link measures e_ij = c_i − A·c_j, A = Ad(T_i⁻¹ T_j), with the information H/50: neighbouring points err alike, so
//! thousands of them know less than as many that do not. Cauchy's weights on the displacement in the picture, of scale
//! max(median, 0.15 px); links beyond six scales are left out. Each frame is held to its recorded pose by 1 cm and 0.5°.
//! Links reach a few frames, so the equations form a band, solved by Cholesky in time linear in the frames.

use nalgebra::Matrix6;

use super::align::{Link, median};
use super::state::State;
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
        let mut equations = Band::new(count, band);
        for (frame, at) in held_at.iter().enumerate() {
            equations.add(frame, frame, &held);
            equations.add_right(frame, &(held * at));
        }
        for ((link, a), w) in links.iter().zip(&adjoints).zip(&weights) {
            let information = link.information * (w / ALIKE);
            let across = a.transpose() * information;
            equations.add(link.from, link.from, &information);
            equations.add(link.to, link.to, &(across * a));
            if link.from > link.to {
                equations.add(link.from, link.to, &-(information * a));
            } else {
                equations.add(link.to, link.from, &-across);
            }
            equations.add_right(link.from, &(information * link.e));
            equations.add_right(link.to, &-(across * link.e));
        }
        corrections = equations.solved()?;
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

/// A symmetric matrix of 6×6 blocks that is 0 beyond `band` blocks from the diagonal, and a right side.
struct Band {
    /// Row by row: of row r the columns r − width ..= r.
    rows: Vec<f64>,
    width: usize,
    right: Vec<f64>,
}

impl Band {
    fn new(blocks: usize, band: usize) -> Self {
        let width = 6 * band + 5;
        Self { rows: vec![0.0; 6 * blocks * (width + 1)], width, right: vec![0.0; 6 * blocks] }
    }

    fn index(&self, row: usize, column: usize) -> usize {
        row * (self.width + 1) + self.width + column - row
    }

    /// Adds a block; `row` ≥ `column`.
    fn add(&mut self, row: usize, column: usize, block: &Matrix6<f64>) {
        for r in 0..6 {
            for c in 0..6 {
                let (at_row, at_column) = (6 * row + r, 6 * column + c);
                if at_column <= at_row {
                    let i = self.index(at_row, at_column);
                    self.rows[i] += block[(r, c)];
                }
            }
        }
    }

    fn add_right(&mut self, block: usize, values: &Twist) {
        for r in 0..6 {
            self.right[6 * block + r] += values[r];
        }
    }

    /// By L·Lᵀ in place. `None` if the matrix is not positive.
    fn solved(mut self) -> Option<Vec<Twist>> {
        let n = self.right.len();
        for row in 0..n {
            let first = row.saturating_sub(self.width);
            for column in first..=row {
                let from = first.max(column.saturating_sub(self.width));
                let (a, b) = (self.index(row, from), self.index(column, from));
                let terms = column - from;
                let dot: f64 = self.rows[a..a + terms].iter().zip(&self.rows[b..b + terms]).map(|(x, y)| x * y).sum();
                let i = self.index(row, column);
                let rest = self.rows[i] - dot;
                self.rows[i] = if column < row {
                    rest / self.rows[self.index(column, column)]
                } else if rest > 0.0 {
                    rest.sqrt()
                } else {
                    return None;
                };
            }
        }
        for row in 0..n {
            let first = row.saturating_sub(self.width);
            let i = self.index(row, first);
            let dot: f64 = self.rows[i..i + row - first].iter().zip(&self.right[first..row]).map(|(l, x)| l * x).sum();
            self.right[row] = (self.right[row] - dot) / self.rows[self.index(row, row)];
        }
        for row in (0..n).rev() {
            let x = self.right[row] / self.rows[self.index(row, row)];
            self.right[row] = x;
            for column in row.saturating_sub(self.width)..row {
                self.right[column] -= self.rows[self.index(row, column)] * x;
            }
        }
        Some(self.right.chunks(6).map(Twist::from_column_slice).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_is_solved_as_the_whole_matrix_is() {
        let (blocks, band) = (5, 2);
        let n = 6 * blocks;
        let mut dense = nalgebra::DMatrix::<f64>::zeros(n, n);
        let mut equations = Band::new(blocks, band);
        for row in 0..blocks {
            for column in row.saturating_sub(band)..=row {
                let value = |r: usize, c: usize| ((row * 31 + column * 7 + r * 3 + c) as f64).sin();
                let mut block = Matrix6::from_fn(value);
                if row == column {
                    block = block * block.transpose() + Matrix6::identity() * 40.0;
                }
                equations.add(row, column, &block);
                dense.view_mut((6 * row, 6 * column), (6, 6)).copy_from(&block);
                dense.view_mut((6 * column, 6 * row), (6, 6)).copy_from(&block.transpose());
            }
            equations.add_right(row, &Twist::from_fn(|k, _| (row * 6 + k) as f64));
        }
        let right = nalgebra::DVector::from_fn(n, |k, _| k as f64);
        let expected = dense.cholesky().unwrap().solve(&right);
        let found = equations.solved().unwrap();
        for (k, x) in expected.iter().enumerate() {
            assert!((found[k / 6][k % 6] - x).abs() < 1e-9, "{k}: {x}");
        }
    }
}
