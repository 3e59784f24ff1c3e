//! Amplitudes of the bands as a function of content: a gamma regression with logarithmic link.
//!
//! E(e) = exp(g · φ) for the energy e = n² + 0.001 of a band at a pixel, φ = (1, features). The
//! gamma likelihood (McCullagh and Nelder 1989, §8) is maximised by Newton steps with the Hessian
//! at the optimum, ΦᵀΦ / n. Amplitude, code values: exp(g · φ / 2).

use super::content::FEATURES;

/// Coefficients of a band: the constant, then the features.
pub const COEFFICIENTS: usize = FEATURES + 1;
/// Added to energies, so that logarithms stay finite, code values².
pub const ENERGY_FLOOR: f64 = 1e-3;
/// Largest |g · φ|.
pub const EXPONENT_LIMIT: f32 = 12.0;
/// Largest ratio of an energy to its expectation that a step counts.
const RATIO_LIMIT: f64 = 60.0;
const RIDGE: f64 = 1e-3;

/// g of one band: the constant, then one for each feature.
pub type Coefficients = [f64; COEFFICIENTS];

/// exp(g · φ / 2).
pub fn amplitude(g: &[f32; COEFFICIENTS], row: &[f32; FEATURES]) -> f32 {
    let exponent = row.iter().zip(&g[1..]).fold(g[0], |sum, (v, g)| sum + v * g);
    (0.5 * exponent.clamp(-EXPONENT_LIMIT, EXPONENT_LIMIT)).exp()
}

/// Fits the coefficients; `initial` shortens the iteration from 10 to 4 steps. `rows` are features
/// without the constant.
pub fn fit(rows: &[[f32; FEATURES]], energies: &[f64], initial: Option<&Coefficients>) -> Coefficients {
    let count = rows.len().max(1) as f64;
    let phi = |row: &[f32; FEATURES]| -> Coefficients {
        std::array::from_fn(|k| if k == 0 { 1.0 } else { f64::from(row[k - 1]) })
    };
    let mut hessian = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    for p in rows.iter().map(phi) {
        for (line, a) in hessian.iter_mut().zip(p) {
            line.iter_mut().zip(p).for_each(|(h, b)| *h += a * b / count);
        }
    }
    for (i, line) in hessian.iter_mut().enumerate() {
        line[i] += if i == 0 { 1e-9 } else { RIDGE };
    }
    let mean = energies.iter().sum::<f64>() / count;
    let start: Coefficients = std::array::from_fn(|k| if k == 0 { (mean + 1e-9).ln() } else { 0.0 });
    let mut w = initial.copied().unwrap_or(start);
    for _ in 0..if initial.is_some() { 4 } else { 10 } {
        let mut gradient = [0.0; COEFFICIENTS];
        for (row, energy) in rows.iter().zip(energies) {
            let p = phi(row);
            let exponent = dot(&p, &w).clamp(f64::from(-EXPONENT_LIMIT), f64::from(EXPONENT_LIMIT));
            let excess = ((energy / exponent.exp()).min(RATIO_LIMIT) - 1.0) / count;
            gradient.iter_mut().zip(&p).for_each(|(g, p)| *g += excess * p);
        }
        for k in 1..COEFFICIENTS {
            gradient[k] -= RIDGE * w[k];
        }
        let step = solved(hessian, gradient);
        let largest = rows.iter().step_by(50).map(|row| dot(&phi(row), &step).abs()).fold(1e-9, f64::max);
        let length = (1.0 / largest).min(1.0);
        w.iter_mut().zip(&step).for_each(|(w, s)| *w += length * s);
    }
    w
}

fn dot(a: &Coefficients, b: &Coefficients) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves a symmetric positive definite system by Gaussian elimination; 0 in directions without
/// information.
pub fn solved<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> [f64; N] {
    for k in 0..N {
        let pivot = a[k];
        for i in k + 1..N {
            let ratio = if pivot[k] > 0.0 { a[i][k] / pivot[k] } else { 0.0 };
            a[i].iter_mut().zip(&pivot).skip(k).for_each(|(v, p)| *v -= ratio * p);
            b[i] -= ratio * b[k];
        }
    }
    for k in (0..N).rev() {
        let solved_part: f64 = (k + 1..N).map(|j| a[k][j] * b[j]).sum();
        b[k] = if a[k][k] > 0.0 { (b[k] - solved_part) / a[k][k] } else { 0.0 };
    }
    b
}
