//! Distortion as OpenLensIO has it, and ours.
//!
//! OpenLensIO 1.0.1 measures on the sensor, in millimetres from the picture's middle, x right and y
//! down. A point (x, y, z) before the entrance pupil is seen at ε'u = F·(x, y)/z from the centre of
//! projection, undistorted, and at ε'd, distorted:
//!
//! ```text
//! ε'u = U(ε'd − ΔC) + ΔC                                        (10), "Brown-Conrady D-U", default
//! ε'd = D(ε'u − ΔC) + ΔC                                        "Brown-Conrady U-D"
//! ε in the picture = ε'd + ΔP                                   (13)
//! U, D: ε·R + (2p₁xy + p₂(r² + 2x²), 2p₂xy + p₁(r² + 2y²))      (16)
//! R = (1 + k₁r² + k₃r⁴ + k₅r⁶) / (1 + k₂r² + k₄r⁴ + k₆r⁶)       (17)
//! ```
//!
//! Ours is OpenCV's: undistorted to distorted, on ε/F, without a denominator and about the centre
//! of projection. With k₂ = k₄ = k₆ = 0 and ΔC = 0, D is ours exactly: k₁F², k₃F⁴, k₅F⁶, p₁F, p₂F.
//! (SMPTE's sheet on OpenCV gives p·F², which does not follow from (16): both sides have F once
//! more.) Anything else is fitted by least squares over the sensor, and the largest error of the
//! fit is reported.

use ciborium::value::Value;
use glam::DVec2;

use super::sample::{map, member, numbers};

const U_D: &str = "Brown-Conrady U-D";
const D_U: &str = "Brown-Conrady D-U";

/// Fitted points per side of the sensor.
const FIT_POINTS: i32 = 21;
/// Largest number of terms of (17) that are read.
const MAX_TERMS: usize = 12;

/// Distortion by OpenLensIO's model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenLens {
    /// True if it maps undistorted to distorted points; otherwise the inverse.
    pub distorts: bool,
    /// k₁ to k₆ and further, alternating between numerator and denominator; mm⁻², mm⁻², mm⁻⁴, mm⁻⁴
    /// …
    pub radial: Vec<f64>,
    /// p₁, p₂ of (16), mm⁻¹.
    pub tangential: [f64; 2],
}

impl OpenLens {
    /// `None` if it is of another model.
    pub(super) fn read(value: &Value) -> Option<Self> {
        let distorts = match member(value, "model") {
            None => false,
            Some(model) => match model.as_text()? {
                U_D => true,
                D_U => false,
                _ => return None,
            },
        };
        let radial = numbers(member(value, "radial")?)?;
        let tangential = member(value, "tangential").map_or(Some(Vec::new()), numbers)?;
        let p = |i| tangential.get(i).copied().unwrap_or(0.0);
        Some(Self { distorts, radial: radial.into_iter().take(MAX_TERMS).collect(), tangential: [p(0), p(1)] })
    }

    /// The model's name.
    pub fn model(&self) -> &'static str {
        if self.distorts { U_D } else { D_U }
    }

    pub(super) fn write(&self) -> Value {
        let list = |numbers: &[f64]| Value::Array(numbers.iter().copied().map(Value::from).collect());
        map([("model", self.model().into()), ("radial", list(&self.radial)), ("tangential", list(&self.tangential))])
    }

    /// (16) and (17), mm.
    pub fn apply(&self, e: DVec2) -> DVec2 {
        let r2 = e.length_squared();
        let (mut above, mut below, mut power) = (1.0, 1.0, 1.0);
        for pair in self.radial.chunks(2) {
            power *= r2;
            above += pair[0] * power;
            below += pair.get(1).unwrap_or(&0.0) * power;
        }
        let [p1, p2] = self.tangential;
        let xy = e.x * e.y;
        e * (above / below)
            + DVec2::new(2.0 * p1 * xy + p2 * (r2 + 2.0 * e.x * e.x), 2.0 * p2 * xy + p1 * (r2 + 2.0 * e.y * e.y))
    }

    /// k1, k2, k3, p1, p2 of OpenCV, if the distortion has that form.
    pub(super) fn as_opencv(&self, focal_mm: f64) -> Option<[f64; 5]> {
        let k = |i: usize| self.radial.get(i).copied().unwrap_or(0.0);
        let is_ours = (0..MAX_TERMS).all(|i| k(i) == 0.0 || self.distorts && matches!(i, 0 | 2 | 4));
        let is_plain = self.tangential == [0.0; 2] || self.distorts;
        let f2 = focal_mm * focal_mm;
        let [p1, p2] = self.tangential.map(|p| p * focal_mm);
        (is_ours && is_plain).then(|| [k(0) * f2, k(2) * f2 * f2, k(4) * f2 * f2 * f2, p1, p2])
    }

    /// Least-squares fit of OpenCV's k1, k2, k3, p1, p2 over the sensor, and its largest error, mm.
    /// OpenCV's model is linear in them, so one system of equations is solved. `None` if the
    /// distortion folds or is not finite.
    pub(super) fn fit(
        &self,
        focal_mm: f64,
        sensor_mm: DVec2,
        offset_mm: DVec2,
        centre_mm: DVec2,
    ) -> Option<([f64; 5], f64)> {
        let point = |x: i32, y: i32| {
            let at = DVec2::new(f64::from(x), f64::from(y)) / f64::from(FIT_POINTS - 1) - 0.5;
            let here = at * sensor_mm - offset_mm;
            let there = self.apply(here - centre_mm) + centre_mm;
            let (u, d) = if self.distorts { (here, there) } else { (there, here) };
            (u / focal_mm, d / focal_mm)
        };
        let grid: Vec<(DVec2, DVec2)> =
            (0..FIT_POINTS).flat_map(|y| (0..FIT_POINTS).map(move |x| (x, y))).map(|(x, y)| point(x, y)).collect();
        // Points of a row keep their order.
        let rows = || grid.chunks(FIT_POINTS as usize).flat_map(|row| row.windows(2));
        let ascends = |pair: &[(DVec2, DVec2)]| pair[1].0.x > pair[0].0.x && pair[1].1.x > pair[0].1.x;
        if !grid.iter().all(|(u, d)| u.is_finite() && d.is_finite()) || !rows().all(ascends) {
            return None;
        }
        // Columns are scaled to equal size for a well-conditioned system.
        let farthest = grid.iter().map(|(u, _)| u.length()).fold(0.0, f64::max);
        let scales = [2, 4, 6, 1, 1].map(|power| farthest.powi(power));
        let columns = |u: DVec2| {
            let (r2, xy) = (u.length_squared(), u.x * u.y);
            let tangential = [DVec2::new(2.0 * xy, r2 + 2.0 * u.y * u.y), DVec2::new(r2 + 2.0 * u.x * u.x, 2.0 * xy)];
            let all = [u * r2, u * r2 * r2, u * r2 * r2 * r2, tangential[0], tangential[1]];
            std::array::from_fn::<DVec2, 5, _>(|i| all[i] / scales[i])
        };
        let (mut matrix, mut right) = ([[0.0; 5]; 5], [0.0; 5]);
        for (u, d) in &grid {
            let columns = columns(*u);
            for i in 0..5 {
                for j in 0..5 {
                    matrix[i][j] += columns[i].dot(columns[j]);
                }
                right[i] += columns[i].dot(*d - *u);
            }
        }
        let solved = solve(matrix, right)?;
        let residual = |(u, d): &(DVec2, DVec2)| {
            let sum: DVec2 = columns(*u).into_iter().zip(solved).map(|(column, k)| column * k).sum();
            (*u + sum - *d).length()
        };
        let worst_mm = focal_mm * grid.iter().map(residual).fold(0.0, f64::max);
        Some((std::array::from_fn(|i| solved[i] / scales[i]), worst_mm))
    }
}

/// Gaussian elimination with partial pivoting. `None` if the matrix is singular.
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    for i in 0..N {
        let pivot = (i..N).max_by(|a, b| matrix[*a][i].abs().total_cmp(&matrix[*b][i].abs()))?;
        matrix.swap(i, pivot);
        right.swap(i, pivot);
        let pivot = matrix[i];
        if pivot[i].is_nan() || pivot[i].abs() < 1e-300 {
            return None;
        }
        for row in i + 1..N {
            let factor = matrix[row][i] / pivot[i];
            for (to, from) in matrix[row].iter_mut().zip(pivot) {
                *to -= factor * from;
            }
            right[row] -= factor * right[i];
        }
    }
    for i in (0..N).rev() {
        let solved_part: f64 = (i + 1..N).map(|j| matrix[i][j] * right[j]).sum();
        right[i] = (right[i] - solved_part) / matrix[i][i];
    }
    right.iter().all(|x| x.is_finite()).then_some(right)
}
