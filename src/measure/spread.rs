//! Edge spread function of a straight edge, and its fit to pixels.
//!
//! A pixel integrates the light on its square. The square's projection onto the edge's normal (cos
//! φ, sin φ) is the trapezoid that results from two boxes of
//! cos φ
//! and
//! sin φ
//! , with a variance of 1/12 px² at every angle. Before it comes the Gaussian of lens and sensor,
//! and the motion of the edge during the exposure, which is a box too. So
//!
//! ```text
//! E(d) = ∫∫∫ Φ((d − u − v − w)/σ)        u, v, w over those boxes
//! ```
//!
//! With G(x) = ∫∫ Φ(x/σ) = ((x² + σ²)·Φ(x/σ) + σx·φ(x/σ))/2 the two of the pixel are a second
//! difference of G. The third is summed by three-point Gauss-Legendre quadrature, whose variance is
//! the box's.
//!
//! The pixels themselves are fitted, each at its own distance d, without bins: the light is
//! (a + bd + ct)·(1 − E) + (a' + b'd + c't)·E, t the position along the edge. For each offset,
//! angle and σ² the six coefficients follow by linear least squares (variable projection: Golub
//! and Pereyra 1973). The three follow by Gauss-Newton.

use statrs::function::erf::erf;

/// Minimum variance, px²: a Gaussian that no pixel resolves.
const MIN_VARIANCE_PX2: f64 = 1e-8;
const MAX_ITERATIONS: usize = 40;
/// Convergence threshold of a step in offset, angle and variance, px, tenths of a radian, px².
pub(crate) const CONVERGENCE: f64 = 1e-7;
/// Step sizes of the numerical derivatives: px, radians, px².
const DERIVATIVE_STEPS: [f64; 3] = [1e-3, 1e-4, 1e-3];
/// Three-point Gauss-Legendre nodes of a box of length 1, and their weights.
const GAUSS_LEGENDRE_3: [(f64, f64); 3] =
    [(-0.387_298_334_620_741_7, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.387_298_334_620_741_7, 5.0 / 18.0)];

/// One pixel: its centre, relative to a position near the edge, and its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EdgeSample {
    pub x: f64,
    pub y: f64,
    pub light: f64,
    /// Inverse variance, in any unit.
    pub weight: f64,
}

/// Position of the edge, and its blur.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EdgeStep {
    /// Distance from the samples' origin along the normal, px.
    pub offset_px: f64,
    /// The direction of the normal towards the brighter side, from x to y, radians.
    pub angle: f64,
    /// Variance of the Gaussian, px².
    pub variance_px2: f64,
    /// Motion of the edge across itself during the exposure, px.
    pub moved_px: f64,
}

/// A fitted edge.
#[derive(Clone, Debug)]
pub(crate) struct EdgeFit {
    pub step: EdgeStep,
    /// (a, b, c) of the side behind the edge and of the one before it.
    pub sides: [[f64; 3]; 2],
    /// Variances of offset, angle and σ² if the samples' weights are inverse variances.
    pub variances: [f64; 3],
    /// Sum of weighted squared residuals.
    pub left: f64,
}

impl EdgeStep {
    /// Distance from the edge and position along it, px.
    pub fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let (sin, cos) = self.angle.sin_cos();
        (cos * x + sin * y - self.offset_px, cos * y - sin * x)
    }

    /// The share of the brighter side's light at a distance from the edge, 0 to 1.
    pub fn share(&self, distance_px: f64) -> f64 {
        let sigma = self.variance_px2.max(MIN_VARIANCE_PX2).sqrt();
        let (sin, cos) = self.angle.sin_cos();
        let (wide, narrow) = (sin.abs().max(cos.abs()), sin.abs().min(cos.abs()));
        let at = |d: f64| {
            if narrow < 1e-4 {
                return (normal_integral_1(d + 0.5 * wide, sigma) - normal_integral_1(d - 0.5 * wide, sigma)) / wide;
            }
            let (outer, inner) = (0.5 * (wide + narrow), 0.5 * (wide - narrow));
            let far = normal_integral_2(d + outer, sigma) + normal_integral_2(d - outer, sigma);
            (far - normal_integral_2(d + inner, sigma) - normal_integral_2(d - inner, sigma)) / (wide * narrow)
        };
        if self.moved_px < 1e-6 {
            return at(distance_px);
        }
        // Three points represent a box as long as the edge is softer than their spacing.
        if self.moved_px > 0.3 {
            let until = |d: f64| {
                if narrow < 1e-4 {
                    return (normal_integral_2(d + 0.5 * wide, sigma) - normal_integral_2(d - 0.5 * wide, sigma))
                        / wide;
                }
                let (outer, inner) = (0.5 * (wide + narrow), 0.5 * (wide - narrow));
                let far = normal_integral_3(d + outer, sigma) + normal_integral_3(d - outer, sigma);
                (far - normal_integral_3(d + inner, sigma) - normal_integral_3(d - inner, sigma)) / (wide * narrow)
            };
            let half = 0.5 * self.moved_px;
            return (until(distance_px + half) - until(distance_px - half)) / self.moved_px;
        }
        GAUSS_LEGENDRE_3.iter().map(|(place, weight)| weight * at(distance_px + place * self.moved_px)).sum()
    }

    fn moved_by(mut self, which: usize, by: f64) -> Self {
        match which {
            0 => self.offset_px += by,
            1 => self.angle += by,
            _ => self.variance_px2 = (self.variance_px2 + by).max(MIN_VARIANCE_PX2),
        }
        self
    }
}

/// Φ and φ.
fn normal(x: f64) -> (f64, f64) {
    (0.5 * (1.0 + erf(x * std::f64::consts::FRAC_1_SQRT_2)), (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt())
}

/// ∫ Φ(x/σ).
fn normal_integral_1(x: f64, sigma: f64) -> f64 {
    let (whole, dense) = normal(x / sigma);
    x * whole + sigma * dense
}

/// ∫∫ Φ(x/σ).
fn normal_integral_2(x: f64, sigma: f64) -> f64 {
    let (whole, dense) = normal(x / sigma);
    0.5 * ((x * x + sigma * sigma) * whole + sigma * x * dense)
}

/// ∫∫∫ Φ(x/σ).
fn normal_integral_3(x: f64, sigma: f64) -> f64 {
    let (whole, dense) = normal(x / sigma);
    ((x * x * x + 3.0 * x * sigma * sigma) * whole + sigma * (x * x + 2.0 * sigma * sigma) * dense) / 6.0
}

/// The basis functions of the six coefficients at a sample.
fn terms(step: &EdgeStep, sample: &EdgeSample) -> [f64; 6] {
    let (d, t) = step.place(sample.x, sample.y);
    let share = step.share(d);
    // Positions are in tens of pixels, so that all terms have similar magnitudes.
    let (d, t) = (0.1 * d, 0.1 * t);
    let rest = 1.0 - share;
    [rest, d * rest, t * rest, share, d * share, t * share]
}

/// The six coefficients for an edge, and each sample's residual, times the root of its weight.
fn project(step: &EdgeStep, samples: &[EdgeSample]) -> Option<([f64; 6], Vec<f64>)> {
    let all: Vec<[f64; 6]> = samples.iter().map(|sample| terms(step, sample)).collect();
    let (mut matrix, mut right) = ([[0.0; 6]; 6], [0.0; 6]);
    for (terms, sample) in all.iter().zip(samples) {
        for i in 0..6 {
            let weighed = terms[i] * sample.weight;
            right[i] += weighed * sample.light;
            (0..6).for_each(|j| matrix[i][j] += weighed * terms[j]);
        }
    }
    let numbers = solve(matrix, right)?;
    let left = all.iter().zip(samples).map(|(terms, sample)| {
        let model: f64 = terms.iter().zip(&numbers).map(|(term, number)| term * number).sum();
        (sample.light - model) * sample.weight.sqrt()
    });
    Some((numbers, left.collect()))
}

/// Fits an edge to samples, from an initial guess, until a step is shorter than `close`
/// ([`CONVERGENCE`]). `None` if they do not determine it.
pub(crate) fn fit(samples: &[EdgeSample], from: EdgeStep, close: f64) -> Option<EdgeFit> {
    let squares = |left: &[f64]| left.iter().map(|r| r * r).sum::<f64>();
    let mut step = from;
    let (mut numbers, mut left) = project(&step, samples)?;
    let mut damping = 1e-3;
    let mut matrix;
    let mut rounds = 0;
    loop {
        let mut slopes = Vec::new();
        for (which, by) in DERIVATIVE_STEPS.into_iter().enumerate() {
            // σ² cannot be below 0: there the one-sided derivative is used.
            let by_less = if which == 2 && step.variance_px2 <= by { 0.0 } else { by };
            let (_, more) = project(&step.moved_by(which, by), samples)?;
            let (_, less) = project(&step.moved_by(which, -by_less), samples)?;
            slopes.push(more.iter().zip(&less).map(|(a, b)| (a - b) / (by + by_less)).collect::<Vec<f64>>());
        }
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        matrix = [0, 1, 2].map(|i| [0, 1, 2].map(|j| product(&slopes[i], &slopes[j])));
        let right = [0, 1, 2].map(|i| -product(&slopes[i], &left));
        let before = squares(&left);
        let mut moved = f64::INFINITY;
        while damping < 1e12 {
            let damped: [[f64; 3]; 3] = std::array::from_fn(|i| {
                std::array::from_fn(|j| matrix[i][j] * if i == j { 1.0 + damping } else { 1.0 })
            });
            let by = solve(damped, right)?;
            let tried = (0..3).fold(step, |step, i| step.moved_by(i, by[i]));
            match project(&tried, samples) {
                Some((fitted, rest)) if squares(&rest) <= before => {
                    moved = (tried.offset_px - step.offset_px).abs()
                        + 10.0 * (tried.angle - step.angle).abs()
                        + (tried.variance_px2 - step.variance_px2).abs();
                    (step, numbers, left) = (tried, fitted, rest);
                    damping = (0.2 * damping).max(1e-9);
                    break;
                }
                _ => damping *= 5.0,
            }
        }
        rounds += 1;
        if moved < close || !moved.is_finite() || rounds == MAX_ITERATIONS {
            break;
        }
    }
    let variance =
        |i: usize| solve(matrix, std::array::from_fn(|j| f64::from(u8::from(i == j)))).map(|column| column[i]);
    let variances = [variance(0)?, variance(1)?, variance(2)?];
    let [a, b, c, a2, b2, c2] = numbers;
    let sides = [[a, 0.1 * b, 0.1 * c], [a2, 0.1 * b2, 0.1 * c2]];
    let whole = step.offset_px.is_finite() && variances.iter().all(|v| v.is_finite() && *v >= 0.0);
    whole.then(|| EdgeFit { step, sides, variances, left: squares(&left) })
}

impl EdgeFit {
    /// The fitted light at a pixel.
    pub fn light(&self, x: f64, y: f64) -> f64 {
        let (d, t) = self.step.place(x, y);
        let share = self.step.share(d);
        let [behind, before] = self.sides.map(|[a, b, c]| a + b * d + c * t);
        behind * (1.0 - share) + before * share
    }
}

/// Gaussian elimination with pivoting.
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    for i in 0..N {
        let pivot = (i..N).max_by(|a, b| matrix[*a][i].abs().total_cmp(&matrix[*b][i].abs()))?;
        if matrix[pivot][i].is_nan() || matrix[pivot][i].abs() < 1e-300 {
            return None;
        }
        matrix.swap(i, pivot);
        right.swap(i, pivot);
        for j in i + 1..N {
            let factor = matrix[j][i] / matrix[i][i];
            (i..N).for_each(|k| matrix[j][k] -= factor * matrix[i][k]);
            right[j] -= factor * right[i];
        }
    }
    for i in (0..N).rev() {
        let solved_part: f64 = (i + 1..N).map(|k| matrix[i][k] * right[k]).sum();
        right[i] = (right[i] - solved_part) / matrix[i][i];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(angle_deg: f64, sigma_px: f64, moved_px: f64) -> EdgeStep {
        EdgeStep { offset_px: 0.0, angle: angle_deg.to_radians(), variance_px2: sigma_px * sigma_px, moved_px }
    }

    #[test]
    fn edge_spread_matches_hand_calculation() {
        // Vertical and sharp: the pixel's own square, ±1/2.
        let sharp = step(0.0, 0.0, 0.0);
        for (d, share) in [(-0.6, 0.0), (-0.25, 0.25), (0.0, 0.5), (0.4, 0.9), (0.5, 1.0)] {
            assert!((sharp.share(d) - share).abs() < 1e-3, "{d}: {}", sharp.share(d));
        }
        // At 45° a triangle of half-width √½: behind half of it lies 1 − (1/2)²/2.
        let diagonal = step(45.0, 0.0, 0.0);
        let half = 0.5 * std::f64::consts::FRAC_1_SQRT_2;
        assert!((diagonal.share(half) - 0.875).abs() < 1e-3 && (diagonal.share(0.0) - 0.5).abs() < 1e-9);
        // A wide Gaussian with the box: σ² + 1/12 = 9 + 1/12; Φ(3/3.0139) = 0.8402.
        assert!((step(20.0, 3.0, 0.0).share(3.0) - 0.8402).abs() < 2e-4);
        // Variances add: Gaussian, pixel, movement.
        let moved = step(0.0, 1.0, 1.5);
        let variance: f64 = (-400..400)
            .map(|i| {
                let d = 0.02 * f64::from(i);
                (moved.share(d + 0.01) - moved.share(d - 0.01)) * d * d
            })
            .sum();
        assert!((variance - 1.0 - 1.0 / 12.0 - 1.5 * 1.5 / 12.0).abs() < 1e-3, "{variance}");
    }

    #[test]
    fn fit_recovers_the_simulated_edge() {
        let truth = EdgeStep { offset_px: 0.37, ..step(12.0, 0.8, 0.0) };
        let samples: Vec<EdgeSample> = (0..900)
            .map(|i| {
                let (x, y) = (f64::from(i % 30) - 14.5, f64::from(i / 30) - 14.5);
                let (d, t) = truth.place(x, y);
                let share = truth.share(d);
                let light = (0.2 + 0.001 * t) * (1.0 - share) + (0.7 + 0.002 * d) * share;
                EdgeSample { x, y, light, weight: 1.0 }
            })
            .collect();
        let fitted = fit(&samples, EdgeStep { offset_px: 0.0, ..step(10.0, 1.5, 0.0) }, CONVERGENCE).unwrap();
        assert!((fitted.step.variance_px2.sqrt() - 0.8).abs() < 1e-4, "{fitted:?}");
        assert!((fitted.step.offset_px - 0.37).abs() < 1e-4 && (fitted.step.angle.to_degrees() - 12.0).abs() < 1e-3);
        assert!((fitted.sides[1][1] - 0.002).abs() < 1e-5 && (fitted.sides[0][2] - 0.001).abs() < 1e-5, "{fitted:?}");
        let sample = &samples[16 * 30 + 17];
        assert!((fitted.light(sample.x, sample.y) - sample.light).abs() < 1e-6);
    }
}
