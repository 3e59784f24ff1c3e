//! Ridge logistic regression by iteratively reweighted least squares (le Cessie and van Houwelingen
//! 1992).
//!
//! Minimises Σ log(1 + exp(−y·f)) + λ/2·|w|² with f = b + w·z, where y is ±1, z the features with
//! mean 0 and variance 1 over the training set. The intercept b is not penalised. Each step solves
//! (Zᵀ W Z + λI) δ = −gradient with W = p(1 − p), and is halved until the loss falls.

/// λ: the penalty of scikit-learn's default, C = 1.
const RIDGE: f64 = 1.0;
const MAX_STEPS: usize = 50;
const MAX_HALVINGS: usize = 20;
/// Convergence threshold: change of the loss per sample.
const CONVERGENCE: f64 = 1e-9;

/// A fitted regression.
#[derive(Clone, Debug, PartialEq)]
pub struct LogisticRegression {
    mean: Vec<f64>,
    /// 1/σ of each feature; 0 for a constant one.
    scale: Vec<f64>,
    /// One weight per feature, then the intercept.
    weights: Vec<f64>,
}

impl LogisticRegression {
    /// Fits to samples, each a row of features, of which `is_positive` gives the class. The rows
    /// have one length and finite values.
    pub fn fit(samples: &[&[f64]], is_positive: &[bool]) -> Self {
        let features = samples.first().map_or(0, |sample| sample.len());
        let count = samples.len().max(1) as f64;
        let mean: Vec<f64> = (0..features).map(|j| samples.iter().map(|s| s[j]).sum::<f64>() / count).collect();
        let scale = (0..features).map(|j| {
            let variance = samples.iter().map(|s| (s[j] - mean[j]).powi(2)).sum::<f64>() / count;
            // A constant feature has rounding errors only.
            if variance > 1e-18 * (1.0 + mean[j] * mean[j]) { 1.0 / variance.sqrt() } else { 0.0 }
        });
        let mut regression = Self { scale: scale.collect(), mean, weights: vec![0.0; features + 1] };
        let rows: Vec<Vec<f64>> = samples.iter().map(|sample| regression.standardized(sample)).collect();
        let mut loss = regression.loss(&rows, is_positive);
        for _ in 0..MAX_STEPS {
            let Some(step) = regression.newton_step(&rows, is_positive) else { break };
            let start = regression.weights.clone();
            let mut fraction = 1.0;
            let mut reduced = None;
            for _ in 0..MAX_HALVINGS {
                regression.weights = start.iter().zip(&step).map(|(w, d)| w + fraction * d).collect();
                let candidate = regression.loss(&rows, is_positive);
                if candidate <= loss {
                    reduced = Some(candidate);
                    break;
                }
                fraction *= 0.5;
            }
            let Some(candidate) = reduced else {
                regression.weights = start;
                break;
            };
            let change = loss - candidate;
            loss = candidate;
            if change < CONVERGENCE * count {
                break;
            }
        }
        regression
    }

    /// Logarithm of the odds that a sample is positive.
    pub fn log_odds(&self, sample: &[f64]) -> f64 {
        self.linear(&self.standardized(sample))
    }

    /// The features with mean 0 and variance 1, then 1 for the intercept.
    fn standardized(&self, sample: &[f64]) -> Vec<f64> {
        let features = sample.iter().zip(&self.mean).zip(&self.scale).map(|((v, mean), scale)| (v - mean) * scale);
        features.chain([1.0]).collect()
    }

    fn linear(&self, row: &[f64]) -> f64 {
        row.iter().zip(&self.weights).map(|(v, w)| v * w).sum()
    }

    fn loss(&self, rows: &[Vec<f64>], is_positive: &[bool]) -> f64 {
        let likelihood = rows.iter().zip(is_positive).map(|(row, &positive)| {
            let margin = if positive { self.linear(row) } else { -self.linear(row) };
            // log(1 + exp(−margin)) without overflow.
            (-margin).max(0.0) + (-margin.abs()).exp().ln_1p()
        });
        let penalized = &self.weights[..self.weights.len() - 1];
        likelihood.sum::<f64>() + 0.5 * RIDGE * penalized.iter().map(|w| w * w).sum::<f64>()
    }

    fn newton_step(&self, rows: &[Vec<f64>], is_positive: &[bool]) -> Option<Vec<f64>> {
        let size = self.weights.len();
        let mut hessian = vec![0.0; size * size];
        let mut descent = vec![0.0; size];
        for (row, &positive) in rows.iter().zip(is_positive) {
            let probability = sigmoid(self.linear(row));
            let residual = f64::from(u8::from(positive)) - probability;
            let curvature = probability * (1.0 - probability);
            for (i, &value) in row.iter().enumerate() {
                descent[i] += residual * value;
                let weighted = curvature * value;
                hessian[i * size..=i * size + i].iter_mut().zip(row).for_each(|(h, v)| *h += weighted * v);
            }
        }
        for i in 0..size - 1 {
            descent[i] -= RIDGE * self.weights[i];
            hessian[i * size + i] += RIDGE;
        }
        // Keeps the intercept determined where all probabilities are near 0 or 1.
        hessian[size * size - 1] += 1e-9;
        solve_positive_definite(hessian, descent)
    }
}

/// 1/(1 + exp(−x)).
pub(super) fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Solves a symmetric positive definite system, of which the lower triangle is read, by Cholesky
/// factorisation. `None` if it is not positive definite.
fn solve_positive_definite(mut matrix: Vec<f64>, mut right: Vec<f64>) -> Option<Vec<f64>> {
    let size = right.len();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for i in 0..size {
        let (above, row) = matrix.split_at_mut(i * size);
        for j in 0..i {
            let other = &above[j * size..=j * size + j];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        row[i] = pivot.sqrt();
        right[i] = (right[i] - dot(&row[..i], &right[..i])) / row[i];
    }
    for i in (0..size).rev() {
        right[i] /= matrix[i * size + i];
        let value = right[i];
        (0..i).for_each(|j| right[j] -= matrix[i * size + j] * value);
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cholesky_solves_a_hand_worked_system() {
        // 4x + 2y = 10, 2x + 3y = 11: x = 1, y = 3. The upper triangle is not read.
        let solution = solve_positive_definite(vec![4.0, f64::NAN, 2.0, 3.0], vec![10.0, 11.0]).unwrap();
        assert!((solution[0] - 1.0).abs() < 1e-12 && (solution[1] - 3.0).abs() < 1e-12, "{solution:?}");
        assert_eq!(solve_positive_definite(vec![1.0, 0.0, 2.0, 1.0], vec![1.0, 1.0]), None);
    }

    #[test]
    fn intercept_of_a_constant_feature_is_the_log_odds_of_the_classes() {
        let samples: Vec<&[f64]> = vec![&[7.0]; 8];
        let is_positive: Vec<bool> = (0..8).map(|i| i < 6).collect();
        let regression = LogisticRegression::fit(&samples, &is_positive);
        assert!((regression.log_odds(&[7.0]) - f64::ln(3.0)).abs() < 1e-6, "{regression:?}");
        assert_eq!(regression.weights[0], 0.0);
    }

    #[test]
    fn weight_of_two_points_satisfies_the_stationary_condition() {
        // z = ±1, y = ±1: the gradient −2 σ(−w) + λ w is 0 at w = 0.6748 for λ = 1.
        let regression = LogisticRegression::fit(&[&[3.0], &[5.0]], &[false, true]);
        let w = regression.weights[0];
        assert!((2.0 * sigmoid(-w) - RIDGE * w).abs() < 1e-6, "{w}");
        assert!((w - 0.6748).abs() < 1e-4 && regression.log_odds(&[4.0]).abs() < 1e-6, "{w}");
    }
}
