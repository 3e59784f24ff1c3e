//! A camera of Brown's model with four radial coefficients, as photogrammetry programs export it:
//! x' = x(1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + tangential p1, p2, then u = fx x' + skew y' + cx,
//! v = fy y' + cy.
//!
//! Locard's lens models have neither an r⁸ term nor a skew. The r⁸ term is replaced by a ratio of
//! two polynomials (`opencv_rational`), fitted over the picture; a fit that is off by more than
//! [`MAX_FIT_ERROR_PX`] is refused. A skew is left out if it displaces no pixel by more than
//! [`MAX_SKEW_PX`].

use nalgebra::{DMatrix, DVector};

use super::parts::geometry_from;
use crate::camera::{Geometry, LensModel};
use crate::text::fixed;

/// Largest error of the fit to an r⁸ term anywhere in the picture, px.
const MAX_FIT_ERROR_PX: f64 = 0.05;
/// Largest displacement by a skew that is left out, px.
const MAX_SKEW_PX: f64 = 0.25;
/// Displacement by a skew that needs no warning, px.
const NEGLIGIBLE_SKEW_PX: f64 = 0.01;
/// Smallest denominator of a fitted ratio, far from a pole.
const MIN_FIT_DENOMINATOR: f64 = 0.5;
/// Samples of the radius for the fit.
const FIT_SAMPLES: usize = 200;
/// Iterations that weight samples by their error, so that the largest error falls.
const FIT_ITERATIONS: usize = 10;
/// Part of the radius added beyond the picture's corner.
const RADIUS_MARGIN: f64 = 1.005;
/// Largest normalised radius that is fitted: 84° from the axis.
const MAX_RADIUS: f64 = 10.0;

/// The parameters of the model, in px and on x/z and y/z. The upper left corner of the picture is
/// (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrownCamera {
    pub size_px: [f64; 2],
    pub focal_px: [f64; 2],
    pub centre_px: [f64; 2],
    pub skew_px: f64,
    /// k1 to k4.
    pub radial: [f64; 4],
    /// p1 and p2 in OpenCV's order: p1 multiplies 2xy in x'.
    pub tangential: [f64; 2],
}

/// A ratio of polynomials in r² that replaces the radial polynomial.
#[derive(Clone, Copy, Debug)]
struct RadialRatio {
    numerator: [f64; 3],
    denominator: [f64; 3],
    error_px: f64,
}

impl BrownCamera {
    /// The geometry, and a warning about a skew that is left out.
    pub fn geometry(&self) -> Result<(Geometry, Option<String>), String> {
        let warning = self.skew_warning()?;
        let [k1, k2, k3, k4] = self.radial;
        let mut values = vec![
            ("width_px", self.size_px[0]),
            ("height_px", self.size_px[1]),
            ("fx_px", self.focal_px[0]),
            ("fy_px", self.focal_px[1]),
            ("cx_px", self.centre_px[0]),
            ("cy_px", self.centre_px[1]),
            ("p1", self.tangential[0]),
            ("p2", self.tangential[1]),
        ];
        if k4 == 0.0 {
            values.extend([("k1", k1), ("k2", k2), ("k3", k3)]);
            return Ok((geometry_from(LensModel::Opencv, &values).map_err(|e| e.to_string())?, warning));
        }
        // The ranges of focal length and size are checked before they are used.
        geometry_from(LensModel::Opencv, &values).map_err(|e| e.to_string())?;
        let RadialRatio { numerator: n, denominator: d, .. } = self.ratio()?;
        values.extend([("k1", n[0]), ("k2", n[1]), ("k3", n[2]), ("k4", d[0]), ("k5", d[1]), ("k6", d[2])]);
        Ok((geometry_from(LensModel::OpencvRational, &values).map_err(|e| e.to_string())?, warning))
    }

    /// The displacement of a corner from the principal point on normalised coordinates.
    fn corner_radius(&self) -> f64 {
        let across = |axis: usize| {
            let to_edge = self.centre_px[axis].abs().max((self.size_px[axis] - self.centre_px[axis]).abs());
            to_edge / self.focal_px[axis]
        };
        across(0).hypot(across(1))
    }

    fn skew_warning(&self) -> Result<Option<String>, String> {
        let half_height = self.centre_px[1].abs().max((self.size_px[1] - self.centre_px[1]).abs()) / self.focal_px[1];
        let shift_px = (self.skew_px * half_height).abs();
        if shift_px <= NEGLIGIBLE_SKEW_PX {
            return Ok(None);
        }
        let shift = format!("the skew displaces pixels by up to {} px", fixed(shift_px, 2));
        if shift_px <= MAX_SKEW_PX {
            return Ok(Some(format!("{shift}: left out")));
        }
        Err(format!("{shift}; up to {MAX_SKEW_PX} px can be left out: adjust the cameras again without a skew"))
    }

    fn polynomial(&self, r2: f64) -> f64 {
        let [k1, k2, k3, k4] = self.radial;
        1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    }

    /// The undistorted radius of the picture's corner, or the radius up to which the polynomial is
    /// injective if it is smaller.
    fn undistorted_radius(&self) -> f64 {
        let corner = self.corner_radius().min(MAX_RADIUS);
        let step = 1e-3 * corner.max(1e-6);
        let (mut r, mut distorted) = (0.0, 0.0);
        while r < 3.0 * corner {
            let next = (r + step) * self.polynomial((r + step).powi(2));
            // False for NaN, too.
            let is_rising = next - distorted > 0.05 * step;
            if !is_rising {
                return r;
            }
            (r, distorted) = (r + step, next);
            if distorted >= corner {
                break;
            }
        }
        r * RADIUS_MARGIN
    }

    /// The best ratio of polynomials with up to three terms in the denominator.
    fn ratio(&self) -> Result<RadialRatio, String> {
        let radius = self.undistorted_radius();
        let fits = [3, 2, 1].into_iter().filter_map(|terms| self.fit(radius, terms));
        let best = fits.min_by(|a, b| a.error_px.total_cmp(&b.error_px));
        best.filter(|fit| fit.error_px <= MAX_FIT_ERROR_PX).ok_or_else(|| {
            let off = best.map_or_else(|| "no fit".to_owned(), |fit| format!("{} px off", fixed(fit.error_px, 3)));
            format!(
                "k4 is {}: an r⁸ term is supported where it can be fitted within {MAX_FIT_ERROR_PX} px ({off}): adjust the \
                 cameras again without k4, or export pictures without distortion",
                self.radial[3]
            )
        })
    }

    /// The ratio over radii up to `radius` with the smallest of the largest errors: N − P·D = 0 is
    /// linear in the coefficients of both, and is solved by reweighted least squares.
    fn fit(&self, radius: f64, denominator_terms: usize) -> Option<RadialRatio> {
        let largest = radius * radius;
        let shares: Vec<f64> = (0..FIT_SAMPLES).map(|sample| (sample + 1) as f64 / FIT_SAMPLES as f64).collect();
        let values: Vec<f64> = shares.iter().map(|share| self.polynomial(share * largest)).collect();
        if !values.iter().all(|value| value.is_finite()) {
            return None;
        }
        let mut weights: Vec<f64> = shares.iter().map(|share| share.sqrt()).collect();
        let mut best: Option<RadialRatio> = None;
        for _ in 0..FIT_ITERATIONS {
            let matrix = DMatrix::from_fn(FIT_SAMPLES, 3 + denominator_terms, |row, column| {
                let power = shares[row].powi(1 + (column % 3) as i32);
                weights[row] * if column < 3 { power } else { -values[row] * power }
            });
            let right = DVector::from_fn(FIT_SAMPLES, |row, _| weights[row] * (values[row] - 1.0));
            let solution = matrix.try_svd(true, true, f64::EPSILON, 1000)?.solve(&right, 1e-12).ok()?;
            // By powers of r² instead of the share.
            let coefficient = |index: usize| {
                let power = 1 + (index % 3) as i32;
                solution.get(index).map_or(0.0, |value| value / largest.powi(power))
            };
            let (numerator, denominator) = ([0, 1, 2].map(coefficient), [3, 4, 5].map(coefficient));
            let series = |[a, b, c]: [f64; 3], t: f64| 1.0 + t * (a + t * (b + t * c));
            let focal_px = self.focal_px[0].max(self.focal_px[1]);
            let error_px = |(share, value): (&f64, &f64)| {
                let r2 = share * largest;
                focal_px * r2.sqrt() * (series(numerator, r2) / series(denominator, r2) - value).abs()
            };
            let errors_px: Vec<f64> = shares.iter().zip(&values).map(error_px).collect();
            let worst_px = errors_px.iter().copied().fold(0.0, f64::max);
            let is_regular = shares.iter().all(|share| series(denominator, share * largest) >= MIN_FIT_DENOMINATOR);
            if !worst_px.is_finite() {
                break;
            }
            if is_regular && best.is_none_or(|best| worst_px < best.error_px) {
                best = Some(RadialRatio { numerator, denominator, error_px: worst_px });
            }
            if worst_px == 0.0 {
                break;
            }
            weights.iter_mut().zip(&errors_px).for_each(|(weight, error)| *weight *= (error / worst_px + 1e-3).sqrt());
            let heaviest = weights.iter().copied().fold(0.0, f64::max);
            weights.iter_mut().for_each(|weight| *weight /= heaviest);
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};
    use proptest::prelude::*;

    fn camera(radial: [f64; 4]) -> BrownCamera {
        BrownCamera {
            size_px: [5280.0, 3956.0],
            focal_px: [4758.85, 4758.85],
            centre_px: [2654.84, 1975.17],
            skew_px: 0.0,
            radial,
            tangential: [-0.001_15, -0.001_24],
        }
    }

    /// The model's own formula, px.
    fn projected(camera: &BrownCamera, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let radial = p * camera.polynomial(r2);
        let [p1, p2] = camera.tangential;
        let x = radial.x + 2.0 * p1 * p.x * p.y + p2 * (r2 + 2.0 * p.x * p.x);
        let y = radial.y + p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y;
        DVec2::from(camera.focal_px) * DVec2::new(x, y) + DVec2::from(camera.centre_px)
    }

    #[test]
    fn octic_term_of_a_real_calibration_is_fitted_below_a_twentieth_of_a_pixel() {
        // A drone's camera by Metashape.
        let camera = camera([-0.157_62, -0.164_33, 0.430_42, -0.499_19]);
        let (geometry, warning) = camera.geometry().unwrap();
        assert!(geometry.distortion.model == LensModel::OpencvRational && warning.is_none());
        let mut worst = 0.0f64;
        for (x, y) in (-40..=40).flat_map(|x| (-32..=32).map(move |y| (0.02 * f64::from(x), 0.02 * f64::from(y)))) {
            let p = DVec2::new(x, y);
            let at = projected(&camera, p);
            // The corners are at 0.82; beyond it the polynomial folds back into the picture.
            if p.length() <= 0.82 && at.x >= 0.0 && at.y >= 0.0 && at.x <= 5280.0 && at.y <= 3956.0 {
                worst = worst.max(geometry.project(p.extend(1.0)).unwrap().distance(at));
            }
        }
        assert!(worst > 0.0 && worst < 0.05, "{worst} px");
    }

    #[test]
    fn octic_term_that_no_ratio_fits_is_refused() {
        let error = camera([0.1, -5.0, 40.0, -90.0]).geometry().unwrap_err();
        assert!(error.starts_with("k4 is -90: ") && error.contains("without k4"), "{error}");
    }

    #[test]
    fn without_an_octic_term_the_polynomial_is_exact() {
        let camera = camera([-0.1, 0.4, 0.2, 0.0]);
        let (geometry, _) = camera.geometry().unwrap();
        let p = DVec2::new(0.2, 0.1);
        let at = geometry.project(DVec3::new(0.4, 0.2, 2.0)).unwrap();
        assert!(geometry.distortion.model == LensModel::Opencv && at.distance(projected(&camera, p)) < 1e-9);
    }

    #[test]
    fn skew_is_left_out_with_its_displacement_or_refused() {
        let with = |skew_px: f64| BrownCamera { skew_px, ..camera([0.0; 4]) }.geometry();
        // (3956 − 1975.17)/4758.85 = 0.41624.
        assert_eq!(with(0.02).unwrap().1, None);
        assert_eq!(with(-0.5).unwrap().1.unwrap(), "the skew displaces pixels by up to 0.21 px: left out");
        assert!(with(0.7).unwrap_err().contains("up to 0.29 px; up to 0.25 px can be left out"));
    }

    proptest! {
        #[test]
        fn arbitrary_cameras_never_panic(
            values in prop::array::uniform8(prop::num::f64::ANY), radial in prop::array::uniform4(prop::num::f64::ANY), small in prop::array::uniform4(-1.0f64..1.0),
        ) {
            let [w, h, fx, fy, cx, cy, skew_px, p1] = values;
            for (size_px, focal_px, radial) in [([w, h], [fx, fy], radial), ([64.0, 48.0], [50.0, 51.0], small)] {
                let _ = BrownCamera { size_px, focal_px, centre_px: [cx, cy], skew_px, radial, tangential: [p1, 0.0] }.geometry();
            }
        }
    }
}
