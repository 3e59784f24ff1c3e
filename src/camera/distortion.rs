//! Lens models from rays to image points, with r the distance of (x/z, y/z) from the axis and θ the
//! angle from it:
//!
//! | model | image point | source |
//! |---|---|---|
//! | `opencv` | polynomial in r², tangential terms | Brown, Conrady; OpenCV's `projectPoints` |
//! | `opencv_rational` | ratio of polynomials in r², tangential | the same; COLMAP's FULL_OPENCV |
//! | `fov` | atan(2 r tan(ω/2))/ω | Devernay and Faugeras 2001, (13); COLMAP's FOV |
//! | `opencv_fisheye` | polynomial in θ² | Kannala and Brandt; OpenCV's `fisheye::projectPoints` |
//! | `thin_prism_fisheye` | the same, tangential, thin prism | Weng et al. 1992, on θ; COLMAP |
//! | `equirectangular` | longitude and latitude | 360° pictures |
//! | `st_map` | a table, by ST maps | lens_map.rs |
//!
//! To add a model: a name in [`LensModel`], its branch in `valid_radius`, `slope`, `project` and
//! `unproject` here and in shaders/raster.wgsl or shaders/around.wgsl, its unused parameters in
//! `Distortion::missing`. The round trip test below covers all models.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::{BoundMap, LensMap};
use crate::params::{Params, Value};

crate::choices! {
    /// Mapping from rays to image points.
    pub enum LensModel {
        /// x' = x(1 + k1 r² + k2 r⁴ + k3 r⁶) + tangential p1, p2, on x/z and y/z: OpenCV's
        /// `projectPoints`.
        Opencv = "opencv",
        /// θ_d = θ(1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) from the axis: OpenCV's
        /// `fisheye::projectPoints`.
        OpencvFisheye = "opencv_fisheye",
        /// Longitude to the right of the axis, latitude below it, rad: the whole sphere in a
        /// picture twice as wide as it is high.
        Equirectangular = "equirectangular",
        /// x' = x(1 + k1 r² + k2 r⁴ + k3 r⁶)/(1 + k4 r² + k5 r⁴ + k6 r⁶) + tangential p1, p2:
        /// OpenCV's `projectPoints` with eight coefficients.
        OpencvRational = "opencv_rational",
        /// r' = atan(2 r tan(ω/2))/ω, without other terms.
        Fov = "fov",
        /// (x', y') = θ_d along the direction, as `opencv_fisheye`, + tangential p1, p2 + thin
        /// prism (sx1 θ², sy1 θ²), both on θ times the direction.
        ThinPrismFisheye = "thin_prism_fisheye",
        /// x' by a table over x/z and y/z, from ST maps of another program.
        StMap = "st_map",
    }
}

impl LensModel {
    /// True if image points depend on the angle from the axis, so that the field of view may exceed
    /// a hemisphere.
    pub fn is_fisheye(self) -> bool {
        matches!(self, Self::OpencvFisheye | Self::ThinPrismFisheye)
    }
}

crate::params! {
    /// Coefficients of the models, on normalised image coordinates.
    pub struct Distortion in "camera.distortion" at Depth {
        "projection of the lens" model: LensModel = LensModel::Opencv;
        "radial, r² (θ² of a fisheye)" k1 as "k1": f64 = 0.0, "1", -100.0..=100.0, by_ratio => model isnt "equirectangular or fov or st_map";
        "radial, r⁴ (θ⁴)" k2 as "k2": f64 = 0.0, "1", -1000.0..=1000.0, by_ratio => model isnt "equirectangular or fov or st_map";
        "tangential" p1 as "p1": f64 = 0.0, "1", -10.0..=10.0, by_ratio => model is "opencv or opencv_rational or thin_prism_fisheye";
        "tangential" p2 as "p2": f64 = 0.0, "1", -10.0..=10.0, by_ratio => model is "opencv or opencv_rational or thin_prism_fisheye";
        "radial, r⁶ (θ⁶)" k3 as "k3": f64 = 0.0, "1", -10000.0..=10000.0, by_ratio => model isnt "equirectangular or fov or st_map";
        "radial, θ⁸ of a fisheye; r² of the denominator of a rational model" k4 as "k4": f64 = 0.0, "1", -10000.0..=10000.0, by_ratio => model is "opencv_fisheye or opencv_rational or thin_prism_fisheye";
        "radial, r⁴ of the denominator" k5 as "k5": f64 = 0.0, "1", -10000.0..=10000.0, by_ratio => model is "opencv_rational";
        "radial, r⁶ of the denominator" k6 as "k6": f64 = 0.0, "1", -10000.0..=10000.0, by_ratio => model is "opencv_rational";
        "the angle ω of the model fov" omega as "ω": f64 = 0.0, "rad", 0.0..=3.1 => model is "fov";
        "thin prism, horizontal" sx1 as "sx1": f64 = 0.0, "1", -10.0..=10.0, by_ratio => model is "thin_prism_fisheye";
        "thin prism, vertical" sy1 as "sy1": f64 = 0.0, "1", -10.0..=10.0, by_ratio => model is "thin_prism_fisheye";
        "table of the lens; in a profile `undistort` or `redistort` name its ST maps" map: Option<LensMap> = None => model is "st_map";
    }
}

/// Minimum slope of the radial polynomial within its valid range.
const MIN_SLOPE: f64 = 0.05;
/// Minimum denominator of a rational model within its valid range: at 0 it has a pole.
const MIN_DENOMINATOR: f64 = 0.05;
/// Maximum normalised radius of models on x/z and y/z: 84° off the axis, tan 84° ≈ 9.5.
const MAX_NORMALISED_RADIUS: f64 = 10.0;
/// Minimum angle ω of the model `fov`, rad. Below it the model is a pinhole to within 1e-9.
const MIN_OMEGA: f64 = 1e-4;
/// Iterations of the inverse of tangential and thin-prism terms, which contract by about six times
/// their largest coefficient.
const DECENTRING_ITERATIONS: usize = 100;

/// Longitude to the right and latitude below, rad.
fn longitude_latitude(d: DVec3) -> DVec2 {
    DVec2::new(d.x.atan2(d.z), d.y.atan2(d.x.hypot(d.z)))
}

/// Maximum angle of fisheyes: straight back, one direction would be a whole circle. 3.1 rad is
/// 177.6°.
const MAX_ANGLE_RAD: f64 = 3.1;

impl Distortion {
    pub fn is_identity(&self) -> bool {
        *self == Self::default()
    }

    fn is_fisheye(&self) -> bool {
        self.model.is_fisheye()
    }

    /// The lens without the camera that bound its table: later values of the camera apply to it.
    pub fn unbound(&self) -> Self {
        Self { map: self.map.as_ref().map(LensMap::unbound), ..self.clone() }
    }

    /// The table of `st_map`. `None` for other models, and before a camera binds it.
    pub fn bound_map(&self) -> Option<&BoundMap> {
        self.map.as_ref().filter(|_| self.model == LensModel::StMap)?.bound()
    }

    fn is_equirectangular(&self) -> bool {
        self.model == LensModel::Equirectangular
    }

    /// A non-zero coefficient that does not exist in the model.
    pub fn missing(&self) -> Option<&'static str> {
        let unused: &[_] = match self.model {
            LensModel::Opencv => &["k4", "k5", "k6", "omega", "sx1", "sy1"],
            LensModel::OpencvRational => &["omega", "sx1", "sy1"],
            LensModel::OpencvFisheye => &["p1", "p2", "k5", "k6", "omega", "sx1", "sy1"],
            LensModel::ThinPrismFisheye => &["k5", "k6", "omega"],
            LensModel::Fov => &["k1", "k2", "k3", "k4", "p1", "p2", "k5", "k6", "sx1", "sy1"],
            LensModel::Equirectangular | LensModel::StMap => {
                &["k1", "k2", "k3", "k4", "p1", "p2", "k5", "k6", "omega", "sx1", "sy1"]
            }
        };
        unused.iter().copied().find(|name| self.get(name) != Some(Value::Number(0.0)))
    }

    /// 1 + k4 r² + k5 r⁴ + k6 r⁶ of a rational model.
    fn denominator(&self, r2: f64) -> f64 {
        1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6))
    }

    /// ω and 2 tan(ω/2) of the model `fov`.
    pub fn field_of_view(&self) -> [f64; 2] {
        let omega = self.omega.max(MIN_OMEGA);
        [omega, 2.0 * (0.5 * omega).tan()]
    }

    /// d/dr of r·N/D, the ratio of two polynomials in r².
    fn rational_slope(&self, r: f64) -> f64 {
        let r2 = r * r;
        let (n, d) = (1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3)), self.denominator(r2));
        let by_r2 = |[a, b, c]: [f64; 3]| a + r2 * (2.0 * b + r2 * 3.0 * c);
        let (n_by_r2, d_by_r2) = (by_r2([self.k1, self.k2, self.k3]), by_r2([self.k4, self.k5, self.k6]));
        n / d + 2.0 * r2 * (n_by_r2 * d - n * d_by_r2) / (d * d)
    }

    /// True if the radial function is well behaved at a radius.
    fn is_regular(&self, r: f64) -> bool {
        let has_pole = self.model == LensModel::OpencvRational && self.denominator(r * r) < MIN_DENOMINATOR;
        // A slope of NaN counts as none.
        !has_pole && self.slope(r) >= MIN_SLOPE
    }

    /// Derivative of the radial function: d/dr of r·(1 + k1 r² + k2 r⁴ + k3 r⁶). For a fisheye, θ
    /// replaces r and there is k4 θ⁸.
    pub fn slope(&self, r: f64) -> f64 {
        match self.model {
            LensModel::OpencvRational => return self.rational_slope(r),
            LensModel::Fov => {
                let [omega, double_tan] = self.field_of_view();
                return double_tan / (omega * (1.0 + (double_tan * r).powi(2)));
            }
            // It has no radial function.
            LensModel::StMap => return 1.0,
            _ => {}
        }
        let r2 = r * r;
        let k4 = if self.is_fisheye() { self.k4 } else { 0.0 };
        1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * (7.0 * self.k3 + r2 * 9.0 * k4)))
    }

    /// The radius (normalised, undistorted), or a fisheye's angle (rad), up to which the radial
    /// polynomial is injective. Beyond it the polynomial folds back and would image points twice.
    /// The map continues along its tangent there; see [`Distortion::distort`].
    pub fn valid_radius(&self) -> f64 {
        let flat = !self.is_fisheye() && [self.k1, self.k2, self.k3, self.k4, self.k5, self.k6] == [0.0; 6];
        if self.model == LensModel::Fov {
            // Injective everywhere.
            return MAX_NORMALISED_RADIUS;
        }
        if flat || self.is_equirectangular() || self.model == LensModel::StMap {
            return f64::INFINITY;
        }
        let largest = if self.is_fisheye() { MAX_ANGLE_RAD } else { MAX_NORMALISED_RADIUS };
        // The slope is a polynomial in r²: scan, then bisect to the first crossing.
        let step = 1e-2;
        let mut r = 0.0;
        while r < largest {
            if !self.is_regular(r + step) {
                let (mut low, mut high) = (r, r + step);
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    if self.is_regular(middle) { low = middle } else { high = middle }
                }
                return low;
            }
            r += step;
        }
        largest
    }

    /// Normalised image coordinates of a direction (x right, y down, z forward, any length). `None`
    /// for z ≤ 0. A fisheye may exceed a hemisphere: for it, `None` if the direction is neither in
    /// front of the camera nor within the valid angle.
    pub fn project(&self, direction: DVec3, valid_radius: f64) -> Option<DVec2> {
        let d = direction;
        if self.is_equirectangular() {
            return (d.is_finite() && d != DVec3::ZERO).then(|| longitude_latitude(d));
        }
        if self.is_fisheye() && d.is_finite() {
            let theta = d.truncate().length().atan2(d.z);
            let is_visible = d != DVec3::ZERO && (d.z > 0.0 || theta <= valid_radius);
            return is_visible.then(|| self.fisheye_point(d.truncate().normalize_or_zero(), theta, valid_radius));
        }
        (d.z > 0.0).then(|| self.distort(d.truncate() / d.z, valid_radius))
    }

    /// True without distortion: the camera is a pinhole.
    #[inline]
    pub fn is_none(&self) -> bool {
        let Self { model, k1, k2, k3, p1, p2, .. } = self;
        *model == LensModel::Opencv && [k1, k2, k3, p1, p2].into_iter().all(|coefficient| *coefficient == 0.0)
    }

    /// Like `project`, extended beyond the field of view: a fisheye's curve continues along its
    /// tangent. For `opencv`, only directions in front of the camera are meaningful.
    pub fn project_extended(&self, direction: DVec3, valid_radius: f64) -> DVec2 {
        if self.is_fisheye() {
            let across = direction.truncate();
            let theta = across.length().atan2(direction.z);
            return self.fisheye_point(across.normalize_or_zero(), theta, valid_radius);
        }
        self.project(direction, valid_radius).unwrap_or_default()
    }

    /// The direction (unit length) of normalised image coordinates; the inverse of
    /// [`Distortion::project`]. `None` if there is none.
    pub fn unproject(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec3> {
        if self.is_equirectangular() {
            let ((s, c), (below, level)) = (distorted.x.sin_cos(), distorted.y.sin_cos());
            // The tolerance includes the picture's own border despite rounding.
            let inside = distorted.x.abs() <= PI * (1.0 + 1e-12) && distorted.y.abs() <= 0.5 * PI * (1.0 + 1e-12);
            return inside.then(|| DVec3::new(s * level, below, c * level));
        }
        if !self.is_fisheye() {
            return self.undistort(distorted, valid_radius).map(|p| p.extend(1.0).normalize());
        }
        let radial = self.without_decentring(distorted, valid_radius)?;
        let theta_d = radial.length();
        let theta = self.fisheye_angle(theta_d, valid_radius);
        let is_visible = theta < std::f64::consts::FRAC_PI_2 || theta <= valid_radius;
        let towards = radial.try_normalize().unwrap_or(DVec2::X);
        (is_visible && theta_d.is_finite()).then(|| (towards * theta.sin()).extend(theta.cos()))
    }

    /// A fisheye's angle from the axis, rad, at a radius of its radial part; the inverse of
    /// [`Distortion::fisheye`].
    fn fisheye_angle(&self, theta_d: f64, valid_radius: f64) -> f64 {
        let rim = self.fisheye(valid_radius, valid_radius);
        if theta_d > rim {
            valid_radius + (theta_d - rim) / self.slope(valid_radius)
        } else {
            self.fisheye_inverse(theta_d, valid_radius)
        }
    }

    /// The radial part of a fisheye's image point: without the tangential and the thin-prism terms,
    /// by fixed-point iteration. `None` if it does not converge.
    fn without_decentring(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec2> {
        if self.model != LensModel::ThinPrismFisheye {
            return Some(distorted);
        }
        let mut radial = distorted;
        for _ in 0..DECENTRING_ITERATIONS {
            let theta = self.fisheye_angle(radial.length(), valid_radius);
            let next = distorted - self.decentring(radial.normalize_or_zero() * theta.min(valid_radius));
            let change = next.distance(radial);
            radial = next;
            if change < 1e-14 {
                return Some(radial);
            }
            if !change.is_finite() {
                return None;
            }
        }
        let theta = self.fisheye_angle(radial.length(), valid_radius);
        let error = self.fisheye_point(radial.normalize_or_zero(), theta, valid_radius) - distorted;
        (error.length() < 1e-10).then_some(radial)
    }

    /// A fisheye's image point of a direction across the axis (unit length) and an angle from it.
    fn fisheye_point(&self, towards: DVec2, theta: f64, valid_radius: f64) -> DVec2 {
        let radial = towards * self.fisheye(theta, valid_radius);
        if self.model == LensModel::ThinPrismFisheye {
            return radial + self.decentring(towards * theta.min(valid_radius));
        }
        radial
    }

    /// The tangential and thin-prism terms of `thin_prism_fisheye`, at θ times the direction.
    fn decentring(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        DVec2::new(
            2.0 * self.p1 * p.x * p.y + self.p2 * (r2 + 2.0 * p.x * p.x) + self.sx1 * r2,
            self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * p.x * p.y + self.sy1 * r2,
        )
    }

    /// The model without tangential and thin-prism terms.
    pub fn radial_part(&self) -> Self {
        Self { p1: 0.0, p2: 0.0, sx1: 0.0, sy1: 0.0, ..self.clone() }
    }

    /// Distorts normalised coordinates (x/z, y/z), OpenCV's `projectPoints`: x' = x(1 + k1 r² + k2
    /// r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²), y' likewise. Beyond `valid_radius` (from
    /// [`Distortion::valid_radius`]), the point on the rim is distorted and continued outwards
    /// along its own ray with the rim's slope. The map thus stays one to one, and nothing outside
    /// comes back into the picture.
    pub fn distort(&self, p: DVec2, valid_radius: f64) -> DVec2 {
        if let Some(table) = self.bound_map() {
            return table.distort(p);
        }
        if self.is_equirectangular() {
            return longitude_latitude(p.extend(1.0));
        }
        if self.is_fisheye() {
            return self.fisheye_point(p.normalize_or_zero(), p.length().atan(), valid_radius);
        }
        if p.length_squared() > valid_radius * valid_radius {
            let r = p.length();
            let direction = p / r;
            return self.polynomial(direction * valid_radius)
                + direction * (self.slope(valid_radius) * (r - valid_radius));
        }
        self.polynomial(p)
    }

    /// θ_d of a fisheye, continued beyond the valid angle.
    fn fisheye(&self, theta: f64, valid: f64) -> f64 {
        let rim = theta.min(valid);
        let t = rim * rim;
        let radial = 1.0 + t * (self.k1 + t * (self.k2 + t * (self.k3 + t * self.k4)));
        rim * radial + self.slope(valid) * (theta - rim)
    }

    /// θ from θ_d, which lies between 0 and that of the valid angle. Newton's method with
    /// bisection.
    fn fisheye_inverse(&self, theta_d: f64, valid: f64) -> f64 {
        let (mut low, mut high) = (0.0, valid);
        let mut theta = theta_d.min(valid);
        for _ in 0..60 {
            let error = self.fisheye(theta, valid) - theta_d;
            if error.abs() < 1e-15 {
                break;
            }
            if error > 0.0 {
                high = theta
            } else {
                low = theta
            }
            let newton = theta - error / self.slope(theta);
            theta = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        }
        theta
    }

    fn polynomial(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        if self.model == LensModel::Fov {
            let [omega, double_tan] = self.field_of_view();
            let r = r2.sqrt();
            return if r > 0.0 { p * ((double_tan * r).atan() / (omega * r)) } else { DVec2::ZERO };
        }
        let mut radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        if self.model == LensModel::OpencvRational {
            radial /= self.denominator(r2);
        }
        DVec2::new(
            p.x * radial + 2.0 * self.p1 * p.x * p.y + self.p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * p.x * p.y,
        )
    }

    /// The inverse of [`Distortion::distort`] for models on x/z and y/z, by Newton's method with a
    /// numerical Jacobian and step halving. `None` if no undistorted point is found within 1e-10.
    /// That of `fov` is exact: r = tan(ω r')/(2 tan(ω/2)).
    fn undistort(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec2> {
        if let Some(table) = self.bound_map() {
            return table.undistort(distorted);
        }
        if self.model == LensModel::Fov {
            let [omega, double_tan] = self.field_of_view();
            let radius = distorted.length();
            let rim = (double_tan * valid_radius).atan() / omega;
            let r = if radius > rim {
                valid_radius + (radius - rim) / self.slope(valid_radius)
            } else {
                (omega * radius).tan() / double_tan
            };
            return radius.is_finite().then(|| distorted.normalize_or_zero() * r);
        }
        let mut p = distorted;
        let mut error = (self.distort(p, valid_radius) - distorted).length();
        for _ in 0..60 {
            if error < 1e-13 {
                break;
            }
            let h = 1e-6;
            let base = self.distort(p, valid_radius);
            let dx = (self.distort(p + DVec2::new(h, 0.0), valid_radius) - base) / h;
            let dy = (self.distort(p + DVec2::new(0.0, h), valid_radius) - base) / h;
            let determinant = dx.x * dy.y - dx.y * dy.x;
            if determinant.abs() < 1e-12 {
                return None;
            }
            let e = base - distorted;
            let newton = DVec2::new(dy.y * e.x - dy.x * e.y, dx.x * e.y - dx.y * e.x) / determinant;
            let mut step = 1.0;
            loop {
                let next = p - newton * step;
                let next_error = (self.distort(next, valid_radius) - distorted).length();
                if next_error < error {
                    p = next;
                    error = next_error;
                    break;
                }
                step *= 0.5;
                if step < 1e-6 {
                    return (error < 1e-10).then_some(p);
                }
            }
        }
        (error < 1e-10).then_some(p)
    }
}

#[cfg(test)]
mod tests;
