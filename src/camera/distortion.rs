//! Lens models from rays to image points: Brown-Conrady for ordinary lenses and Kannala-Brandt for
//! fisheyes, both after OpenCV, and equirectangular for 360° pictures.
//!
//! To add a model: a name in [`LensModel`], its branch in `valid_radius`, `slope`, `project` and
//! `unproject` here and in shaders/raster.wgsl or shaders/around.wgsl, its unused parameters in
//! `Distortion::missing`. The round trip test below covers all models.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

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
    }
}

crate::params! {
    /// Coefficients of OpenCV's models, on normalised image coordinates.
    pub struct Distortion in "camera.distortion" at Depth {
        "projection of the lens" model: LensModel = LensModel::Opencv;
        "radial, r² (θ² of a fisheye)" k1 as "k1": f64 = 0.0, "1", -100.0..=100.0, by_ratio => model isnt "equirectangular";
        "radial, r⁴ (θ⁴)" k2 as "k2": f64 = 0.0, "1", -1000.0..=1000.0, by_ratio => model isnt "equirectangular";
        "tangential; not of a fisheye" p1 as "p1": f64 = 0.0, "1", -10.0..=10.0, by_ratio => model is "opencv";
        "tangential; not of a fisheye" p2 as "p2": f64 = 0.0, "1", -10.0..=10.0, by_ratio => model is "opencv";
        "radial, r⁶ (θ⁶)" k3 as "k3": f64 = 0.0, "1", -10000.0..=10000.0, by_ratio => model isnt "equirectangular";
        "radial, θ⁸ of a fisheye alone" k4 as "k4": f64 = 0.0, "1", -10000.0..=10000.0, by_ratio => model is "opencv_fisheye";
    }
}

/// Minimum slope of the radial polynomial within its valid range.
const MIN_SLOPE: f64 = 0.05;
/// Maximum normalised radius of `opencv` lenses: 84° off the axis, tan 84° ≈ 9.5.
const MAX_NORMALISED_RADIUS: f64 = 10.0;
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
        self.model == LensModel::OpencvFisheye
    }

    fn is_equirectangular(&self) -> bool {
        self.model == LensModel::Equirectangular
    }

    /// A non-zero coefficient that does not exist in the model.
    pub fn missing(&self) -> Option<&'static str> {
        let unused: &[_] = match self.model {
            LensModel::Opencv => &[("k4", self.k4)],
            LensModel::OpencvFisheye => &[("p1", self.p1), ("p2", self.p2)],
            LensModel::Equirectangular => {
                &[("k1", self.k1), ("k2", self.k2), ("k3", self.k3), ("k4", self.k4), ("p1", self.p1), ("p2", self.p2)]
            }
        };
        unused.iter().find(|(_, value)| *value != 0.0).map(|(name, _)| *name)
    }

    /// d/dr of r·(1 + k1 r² + k2 r⁴ + k3 r⁶). For a fisheye, θ replaces r and there is k4 θ⁸.
    pub fn slope(&self, r: f64) -> f64 {
        let r2 = r * r;
        let k4 = if self.is_fisheye() { self.k4 } else { 0.0 };
        1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * (7.0 * self.k3 + r2 * 9.0 * k4)))
    }

    /// The radius (normalised, undistorted), or a fisheye's angle (rad), up to which the radial
    /// polynomial is injective. Beyond it the polynomial folds back and would image points twice.
    /// The map continues along its tangent there; see [`Distortion::distort`].
    pub fn valid_radius(&self) -> f64 {
        let flat = !self.is_fisheye() && self.k1 == 0.0 && self.k2 == 0.0 && self.k3 == 0.0;
        if flat || self.is_equirectangular() {
            return f64::INFINITY;
        }
        let largest = if self.is_fisheye() { MAX_ANGLE_RAD } else { MAX_NORMALISED_RADIUS };
        // The slope is a polynomial in r²: scan, then bisect to the first crossing.
        let step = 1e-2;
        let mut r = 0.0;
        while r < largest {
            if self.slope(r + step) < MIN_SLOPE {
                let (mut low, mut high) = (r, r + step);
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    if self.slope(middle) < MIN_SLOPE { high = middle } else { low = middle }
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
            let seen = d != DVec3::ZERO && (d.z > 0.0 || theta <= valid_radius);
            return seen.then(|| d.truncate().normalize_or_zero() * self.fisheye(theta, valid_radius));
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
            return across.normalize_or_zero() * self.fisheye(across.length().atan2(direction.z), valid_radius);
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
        let theta_d = distorted.length();
        let rim = self.fisheye(valid_radius, valid_radius);
        let theta = if theta_d > rim {
            valid_radius + (theta_d - rim) / self.slope(valid_radius)
        } else {
            self.fisheye_inverse(theta_d, valid_radius)
        };
        let seen = theta < std::f64::consts::FRAC_PI_2 || theta <= valid_radius;
        let towards = distorted.try_normalize().unwrap_or(DVec2::X);
        (seen && theta_d.is_finite()).then(|| (towards * theta.sin()).extend(theta.cos()))
    }

    /// Distorts normalised coordinates (x/z, y/z), OpenCV's `projectPoints`: x' = x(1 + k1 r² + k2
    /// r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²), y' likewise. Beyond `valid_radius` (from
    /// [`Distortion::valid_radius`]), the point on the rim is distorted and continued outwards
    /// along its own ray with the rim's slope. The map thus stays one to one, and nothing outside
    /// comes back into the picture.
    pub fn distort(&self, p: DVec2, valid_radius: f64) -> DVec2 {
        if self.is_equirectangular() {
            return longitude_latitude(p.extend(1.0));
        }
        if self.is_fisheye() {
            return p.normalize_or_zero() * self.fisheye(p.length().atan(), valid_radius);
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
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        DVec2::new(
            p.x * radial + 2.0 * self.p1 * p.x * p.y + self.p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * p.x * p.y,
        )
    }

    /// The inverse of [`Distortion::distort`] for `opencv`, by Newton's method with a numerical
    /// Jacobian and step halving. `None` if no undistorted point is found within 1e-10.
    fn undistort(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec2> {
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
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The published model of the camera of TUM's fr1 recordings.
    const FR1: Distortion =
        Distortion { model: LensModel::Opencv, k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633, k4: 0.0 };

    fn fisheye([k1, k2, k3, k4]: [f64; 4]) -> Distortion {
        Distortion { model: LensModel::OpencvFisheye, k1, k2, k3, k4, ..Default::default() }
    }

    #[test]
    fn fisheye_matches_hand_calculation() {
        // (1, 1, √2): 45° off the axis. θ = 0.785398, θ² = 0.616850; 1 + 0.0616850 − 0.0190252 +
        // 0.0070415 − 0.0014478 = 1.0482535, times θ = 0.823296.
        let lens = fisheye([0.1, -0.05, 0.03, -0.01]);
        let at = lens.project(DVec3::new(1.0, 1.0, 2f64.sqrt()), lens.valid_radius()).unwrap();
        assert!((at - DVec2::splat(0.823_296 / 2f64.sqrt())).length() < 1e-6, "{at}");
        // Without coefficients, equal angles are equal distances, even behind the camera: 120° off
        // the axis.
        let equal = fisheye([0.0; 4]);
        let at = equal.project(DVec3::new(0.0, 3f64.sqrt(), -1.0), equal.valid_radius()).unwrap();
        assert!((at - DVec2::new(0.0, 120f64.to_radians())).length() < 1e-12, "{at}");
        assert_eq!(equal.project(DVec3::NEG_Z, equal.valid_radius()), None);
        assert_eq!(equal.project(DVec3::ZERO, equal.valid_radius()), None);
    }

    #[test]
    fn folding_fisheye_continues_monotonically() {
        // θ(1 − 0.1 θ²): slope 1 − 0.3 θ² reaches 0.05 at θ = √(0.95/0.3) = 1.78, 102°.
        let lens = fisheye([-0.1, 0.0, 0.0, 0.0]);
        let valid = lens.valid_radius();
        assert!((valid - (0.95f64 / 0.3).sqrt()).abs() < 1e-9);
        let seen = |degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            lens.project(DVec3::new(s, 0.0, c), valid)
        };
        assert!(seen(101.0).is_some() && seen(103.0).is_none());
        // This one folds before 90°: 0.05 at √(0.95/0.9) = 58.9°. From there to 90° it continues
        // along the tangent.
        let lens = fisheye([-0.3, 0.0, 0.0, 0.0]);
        let valid = lens.valid_radius();
        let mut last = -1.0;
        for i in 0..900 {
            let (s, c) = (f64::from(i) * 0.1).to_radians().sin_cos();
            let at = lens.project(DVec3::new(s, 0.0, c), valid).unwrap();
            assert!(at.x > last && at.y == 0.0, "folds back at {i}");
            last = at.x;
            let back = lens.unproject(at, valid).unwrap();
            assert!((back - DVec3::new(s, 0.0, c)).length() < 1e-9, "{i}: {back}");
        }
        assert_eq!(lens.unproject(DVec2::new(9.0, 0.0), valid), None);
    }

    #[test]
    fn coefficients_of_another_model_are_reported() {
        assert_eq!(Distortion { p2: 0.1, ..fisheye([0.0; 4]) }.missing(), Some("p2"));
        assert_eq!(Distortion { k4: 0.1, ..FR1 }.missing(), Some("k4"));
        assert_eq!((FR1.missing(), fisheye([0.1; 4]).missing()), (None, None));
    }

    #[test]
    fn distortion_matches_hand_calculation() {
        // x = 0.3, y = -0.2: r² = 0.13; radial = 1 + 0.034112 - 0.01610739 + 0.0025557701 =
        // 1.02056038 x' = 0.3·1.02056038 + 2·(-0.0054)(-0.06) + 0.0026·(0.13 + 0.18) = 0.306168114
        // + 0.000648 + 0.000806
        let d = FR1.distort(DVec2::new(0.3, -0.2), FR1.valid_radius());
        assert!((d.x - 0.307_622_11).abs() < 1e-7, "{}", d.x);
        // y' = -0.2·1.02056038 - 0.0054·(0.13 + 0.08) + 2·0.0026·(-0.06) = -0.204112076 - 0.001134
        // - 0.000312
        assert!((d.y + 0.205_558_08).abs() < 1e-7, "{}", d.y);
    }

    #[test]
    fn valid_radius_is_where_the_slope_vanishes() {
        // r(1 - 0.25 r²): slope 1 - 0.75 r² reaches 0.05 at r = sqrt(0.95/0.75).
        let barrel = Distortion { k1: -0.25, ..Default::default() };
        let valid = barrel.valid_radius();
        assert!((valid - (0.95f64 / 0.75).sqrt()).abs() < 1e-9);
        let mut last = -1.0;
        for i in 0..1000 {
            let r = f64::from(i) * 0.01;
            let d = barrel.distort(DVec2::new(r, 0.0), valid).x;
            assert!(d > last, "folds back at {r}");
            last = d;
        }
    }

    proptest! {
        /// One round trip for all models, over their whole field of view.
        #[test]
        fn round_trip(
            around in 0.0..std::f64::consts::TAU, share in 0.0f64..1.0, k1 in -0.4f64..0.4, k2 in -0.1f64..0.1, p in -0.004f64..0.004,
            k in prop::array::uniform4(-0.05f64..0.05),
        ) {
            let brown = Distortion { k1, k2, p1: p, p2: -p, ..Default::default() };
            let round = Distortion { model: LensModel::Equirectangular, ..Default::default() };
            for model in [FR1, brown, fisheye(k), fisheye([k1, k2, 0.0, 0.0]), fisheye([0.0; 4]), round] {
                let valid = model.valid_radius();
                let theta = share * match model.model {
                    LensModel::Opencv => (0.95 * valid).atan().min(0.85),
                    LensModel::OpencvFisheye => valid,
                    LensModel::Equirectangular => PI,
                };
                let d = DVec3::new(theta.sin() * around.cos(), theta.sin() * around.sin(), theta.cos());
                let back = model.unproject(model.project(3.0 * d, valid).unwrap(), valid).unwrap();
                prop_assert!((back - d).length() < 1e-7, "{:?}: {} {}", model, d, back);
            }
        }
    }
}
