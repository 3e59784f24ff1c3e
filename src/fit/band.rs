//! Banded symmetric systems, solved by Cholesky decomposition in linear time.

/// A symmetric positive definite matrix with `width` subdiagonals, and a right side.
#[derive(Clone)]
pub struct BandMatrix {
    /// Row by row: of row r the columns r − width ..= r.
    rows: Vec<f64>,
    width: usize,
    right: Vec<f64>,
}

impl BandMatrix {
    pub fn new(unknowns: usize, width: usize) -> Self {
        Self { rows: vec![0.0; unknowns * (width + 1)], width, right: vec![0.0; unknowns] }
    }

    fn index(&self, row: usize, column: usize) -> usize {
        row * (self.width + 1) + self.width + column - row
    }

    /// Adds to an element of the lower half: row − width ≤ column ≤ row.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        let i = self.index(row, column);
        self.rows[i] += value;
    }

    pub fn add_right(&mut self, row: usize, value: f64) {
        self.right[row] += value;
    }

    /// Solves by L·Lᵀ in place. `None` if the matrix is not positive definite.
    pub fn solved(mut self) -> Option<Vec<f64>> {
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
        Some(self.right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn banded_solution_equals_the_dense_one() {
        let (n, width) = (30, 7);
        let mut dense = nalgebra::DMatrix::<f64>::zeros(n, n);
        let mut equations = BandMatrix::new(n, width);
        for row in 0..n {
            for column in row.saturating_sub(width)..=row {
                let value = ((row * 31 + column * 7) as f64).sin() + if row == column { 20.0 } else { 0.0 };
                equations.add(row, column, value);
                (dense[(row, column)], dense[(column, row)]) = (value, value);
            }
            equations.add_right(row, row as f64);
        }
        let right = nalgebra::DVector::from_fn(n, |k, _| k as f64);
        let expected = dense.cholesky().unwrap().solve(&right);
        for (actual, expected) in equations.solved().unwrap().iter().zip(&expected) {
            assert!((actual - expected).abs() < 1e-12, "{actual} {expected}");
        }
    }

    #[test]
    fn indefinite_matrix_has_no_solution() {
        let mut equations = BandMatrix::new(2, 1);
        equations.add(0, 0, 1.0);
        equations.add(1, 0, 2.0);
        equations.add(1, 1, 1.0);
        assert!(equations.solved().is_none());
    }
}
