//! How removing a plane from a small block changes correlated noise, and the inverse.
//!
//! A block's n pixels are y = plane + e, e normal with the covariance R = Σ_k r_k S_k: S_k marks
//! the pairs of pixels that lie k = (|Δx|, |Δy|) apart, r_k is the noise's covariance there (0
//! beyond [`REACH`]). With M = 1 − QQᵀ, Q an orthonormal basis of the planes, the residuals are Me
//! and their covariance MRM = Σ_k r_k B_k, B_k = M S_k M. So
//!
//! - the mean product of residuals that lie j apart has the expectation c_j = Σ_k A_jk r_k, A_jk =
//!   Σ_(S_j) B_k / |S_j|: a linear system that gives r from c, including the low frequencies that
//!   the plane removed;
//! - the mean square is distributed like χ² with ν = tr(MR)² / tr(MRMR) degrees of freedom
//!   (Satterthwaite 1946).

/// Side of a block, pixels. Large enough for the plane to leave most of the noise, small enough to
/// fit into textureless places.
pub(crate) const SIDE: usize = 12;
const PIXELS: usize = SIDE * SIDE;
/// Noise up to this many pixels apart, across or down, may be correlated. Beyond, it is assumed
/// independent.
const REACH: usize = 3;
/// Distances up to [`REACH`] each way.
pub(crate) const LAGS: usize = (REACH + 1) * (REACH + 1);
/// Distances to the neighbour to the right and to the one below.
pub(crate) const NEIGHBOURS: [usize; 2] = [1, REACH + 1];

/// A value for each distance: the noise's covariance, or the mean product of residuals.
pub(crate) type ByLag = [f64; LAGS];
/// Uncorrelated noise of variance 1.
pub(crate) const WHITE: ByLag = {
    let mut white = [0.0; LAGS];
    white[0] = 1.0;
    white
};

/// The block's algebra, made once.
#[derive(Debug)]
pub(crate) struct PlaneDetrend {
    /// B_k, row by row.
    projected_lags: Vec<Vec<f64>>,
    expected: [ByLag; LAGS],
    base: [[f64; PIXELS]; 3],
}

fn lag(a: usize, b: usize) -> Option<usize> {
    let (dx, dy) = ((a % SIDE).abs_diff(b % SIDE), (a / SIDE).abs_diff(b / SIDE));
    (dx <= REACH && dy <= REACH).then_some(dy * (REACH + 1) + dx)
}

/// The mean of a value over the block's pixel pairs, for each distance.
fn mean_by_lag(value: impl Fn(usize, usize) -> f64) -> ByLag {
    let (mut sums, mut pairs) = ([0.0; LAGS], [0.0; LAGS]);
    for a in 0..PIXELS {
        for b in a..PIXELS.min(a + REACH * (SIDE + 1) + 1) {
            if let Some(k) = lag(a, b) {
                sums[k] += value(a, b);
                pairs[k] += 1.0;
            }
        }
    }
    std::array::from_fn(|k| sums[k] / pairs[k])
}

impl PlaneDetrend {
    pub fn new() -> Self {
        let middle = (SIDE as f64 - 1.0) / 2.0;
        let slope = (SIDE as f64 * (0..SIDE).map(|i| (i as f64 - middle).powi(2)).sum::<f64>()).sqrt();
        let base: [[f64; PIXELS]; 3] = [
            [1.0 / SIDE as f64; PIXELS],
            std::array::from_fn(|i| ((i % SIDE) as f64 - middle) / slope),
            std::array::from_fn(|i| ((i / SIDE) as f64 - middle) / slope),
        ];
        let projected_lags: Vec<Vec<f64>> = (0..LAGS).map(|k| projected(&base, k)).collect();
        let mut expected = [[0.0; LAGS]; LAGS];
        for (k, projected_lags) in projected_lags.iter().enumerate() {
            for (row, mean) in expected.iter_mut().zip(mean_by_lag(|a, b| projected_lags[a * PIXELS + b])) {
                row[k] = mean;
            }
        }
        Self { projected_lags, expected, base }
    }

    /// Subtracts the best-fitting plane from a block's values.
    pub fn subtract(&self, values: &mut [f64; PIXELS]) {
        for base in &self.base {
            let share: f64 = base.iter().zip(values.iter()).map(|(b, v)| b * v).sum();
            values.iter_mut().zip(base).for_each(|(v, b)| *v -= share * b);
        }
    }

    /// The mean products of residuals, by distance.
    pub fn products(residuals: &[f64; PIXELS]) -> ByLag {
        let rows: &[[f64; SIDE]] = residuals.as_chunks().0;
        let mut means = [0.0; LAGS];
        for (k, mean) in means.iter_mut().enumerate() {
            let (dx, dy) = (k % (REACH + 1), k / (REACH + 1));
            let sum: f64 = rows
                .iter()
                .zip(&rows[dy..])
                .map(|(above, below)| {
                    let right: f64 = above.iter().zip(&below[dx..]).map(|(a, b)| a * b).sum();
                    let left: f64 = above[dx..].iter().zip(below).map(|(a, b)| a * b).sum();
                    right + left
                })
                .sum();
            *mean = sum / (2 * (SIDE - dx) * (SIDE - dy)) as f64;
        }
        means
    }

    /// The noise's covariance from the mean products of residuals.
    pub fn covariance(&self, products: &ByLag) -> ByLag {
        // The diagonal is by far the largest of each row, so there is no pivoting.
        let (mut matrix, mut right) = (self.expected, *products);
        for i in 0..LAGS {
            for j in i + 1..LAGS {
                let eliminating = matrix[i];
                let factor = matrix[j][i] / eliminating[i];
                matrix[j].iter_mut().zip(eliminating).for_each(|(m, e)| *m -= factor * e);
                right[j] -= factor * right[i];
            }
        }
        for i in (0..LAGS).rev() {
            let solved_part: f64 = (i + 1..LAGS).map(|k| matrix[i][k] * right[k]).sum();
            right[i] = (right[i] - solved_part) / matrix[i][i];
        }
        right
    }

    /// The share of the noise's variance that remains after the plane is removed, 0 to 1.
    pub fn remaining_variance_share(&self, covariance: &ByLag) -> f64 {
        self.expected[0].iter().zip(covariance).map(|(a, r)| a * r).sum::<f64>() / covariance[0]
    }

    /// Degrees of freedom of the mean square of residuals.
    pub fn freedom(&self, covariance: &ByLag) -> f64 {
        let trace = PIXELS as f64 * covariance[0] * self.remaining_variance_share(covariance);
        let squares: f64 = (0..PIXELS * PIXELS)
            .map(|i| {
                self.projected_lags
                    .iter()
                    .zip(covariance)
                    .map(|(projected_lags, r)| r * projected_lags[i])
                    .sum::<f64>()
                    .powi(2)
            })
            .sum();
        trace * trace / squares
    }
}

/// M S_k M, row by row.
fn projected(base: &[[f64; PIXELS]; 3], k: usize) -> Vec<f64> {
    let is_at_lag = |a: usize, b: usize| lag(a, b) == Some(k);
    // S q for each q of the basis, and qᵀ S p.
    let moved = base.map(|q| {
        let sum = |a: usize| (0..PIXELS).filter(|b| is_at_lag(a, *b)).map(|b| q[b]).sum();
        std::array::from_fn::<f64, PIXELS, _>(sum)
    });
    let inner: [[f64; 3]; 3] = base.map(|q| moved.map(|s| q.iter().zip(&s).map(|(a, b)| a * b).sum()));
    let mut all = vec![0.0; PIXELS * PIXELS];
    for (i, value) in all.iter_mut().enumerate() {
        let (a, b) = (i / PIXELS, i % PIXELS);
        *value = f64::from(is_at_lag(a, b));
        for q in 0..3 {
            *value -= base[q][a] * moved[q][b] + moved[q][a] * base[q][b];
            for p in 0..3 {
                *value += base[q][a] * inner[q][p] * base[p][b];
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_noise_loses_three_degrees_of_freedom() {
        let plane = PlaneDetrend::new();
        assert!((plane.freedom(&WHITE) - 141.0).abs() < 1e-9);
        assert!((plane.remaining_variance_share(&WHITE) - 141.0 / 144.0).abs() < 1e-12);
    }

    #[test]
    fn subtraction_removes_planes_and_is_idempotent() {
        let plane = PlaneDetrend::new();
        let mut values: [f64; PIXELS] = std::array::from_fn(|i| 3.0 + 0.5 * (i % SIDE) as f64 - (i / SIDE) as f64);
        plane.subtract(&mut values);
        assert!(values.iter().all(|v| v.abs() < 1e-12));
        // A single pixel: its own product is M's diagonal element squared, a neighbour's is with
        // −(QQᵀ) between the two.
        let mut values = [0.0; PIXELS];
        values[0] = 1.0;
        plane.subtract(&mut values);
        let (once, m) = (values, values[0]);
        plane.subtract(&mut values);
        assert!(values.iter().zip(&once).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!((m - (1.0 - 1.0 / 144.0 - 2.0 * 5.5 * 5.5 / (12.0 * 143.0))).abs() < 1e-12, "{m}");
    }

    /// Both ways: from r by the sum over all pairs of M R M, computed independently here, and from
    /// c back to r.
    #[test]
    fn covariance_inverts_the_detrending() {
        let plane = PlaneDetrend::new();
        let r: ByLag = std::array::from_fn(|k| 0.6f64.powi((k % 4) as i32) * 0.4f64.powi((k / 4) as i32));
        // Residuals of every unit impulse: M's columns. E[e eᵀ] = M R M.
        let columns: Vec<[f64; PIXELS]> = (0..PIXELS)
            .map(|i| {
                let mut unit = [0.0; PIXELS];
                unit[i] = 1.0;
                plane.subtract(&mut unit);
                unit
            })
            .collect();
        let spread: Vec<[f64; PIXELS]> = columns
            .iter()
            .map(|m| std::array::from_fn(|j| (0..PIXELS).map(|i| m[i] * lag(i, j).map_or(0.0, |k| r[k])).sum()))
            .collect();
        let entry = |a: usize, b: usize| -> f64 { spread[a].iter().zip(&columns[b]).map(|(x, y)| x * y).sum() };
        let expected = mean_by_lag(entry);
        let products = PlaneDetrend::products(&columns[30]);
        let counted = mean_by_lag(|a, b| columns[30][a] * columns[30][b]);
        assert!(products.iter().zip(&counted).all(|(a, b)| (a - b).abs() < 1e-15), "{products:?}");
        let covariance = plane.covariance(&expected);
        assert!(covariance.iter().zip(&r).all(|(a, b)| (a - b).abs() < 1e-9), "{covariance:?}");
        assert!((plane.remaining_variance_share(&r) - expected[0]).abs() < 1e-12);
        let (mut trace, mut squares) = (0.0, 0.0);
        for a in 0..PIXELS {
            trace += entry(a, a);
            squares += (0..PIXELS).map(|b| entry(a, b).powi(2)).sum::<f64>();
        }
        assert!((plane.freedom(&r) / (trace * trace / squares) - 1.0).abs() < 1e-9);
    }
}
