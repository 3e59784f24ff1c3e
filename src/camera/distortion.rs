//! Lens distortion after OpenCV (Brown-Conrady): radial k1, k2, k3 and tangential p1, p2.

use glam::DVec2;

crate::params! {
    /// Coefficients of OpenCV's model, on normalised image coordinates (x/z, y/z).
    pub struct Distortion in "camera.distortion" {
        "radial, r²" k1: f64 = 0.0, "1", -100.0..=100.0;
        "radial, r⁴" k2: f64 = 0.0, "1", -1000.0..=1000.0;
        "tangential" p1: f64 = 0.0, "1", -10.0..=10.0;
        "tangential" p2: f64 = 0.0, "1", -10.0..=10.0;
        "radial, r⁶" k3: f64 = 0.0, "1", -10000.0..=10000.0;
    }
}

/// The polynomial is trusted out to where it still grows this fast.
const LEAST_SLOPE: f64 = 0.05;
/// No lens of this model sees beyond 84° off its axis: tan 84° ≈ 9.5.
const LARGEST_RADIUS: f64 = 10.0;

impl Distortion {
    pub fn is_identity(&self) -> bool {
        *self == Self::default()
    }

    /// d/dr of r·(1 + k1 r² + k2 r⁴ + k3 r⁶).
    pub fn slope(&self, r: f64) -> f64 {
        let r2 = r * r;
        1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3))
    }

    /// The radius (normalised, undistorted) out to which the radial polynomial is one to one.
    /// Beyond it the polynomial folds back and would draw things twice; there the map goes on
    /// along its tangent, see [`Distortion::distort`].
    pub fn valid_radius(&self) -> f64 {
        if self.k1 == 0.0 && self.k2 == 0.0 && self.k3 == 0.0 {
            return f64::INFINITY;
        }
        // The slope is a cubic in r²: scan, then bisect to the first crossing.
        let step = 1e-2;
        let mut r = 0.0;
        while r < LARGEST_RADIUS {
            if self.slope(r + step) < LEAST_SLOPE {
                let (mut low, mut high) = (r, r + step);
                for _ in 0..50 {
                    let middle = 0.5 * (low + high);
                    if self.slope(middle) < LEAST_SLOPE { high = middle } else { low = middle }
                }
                return low;
            }
            r += step;
        }
        LARGEST_RADIUS
    }

    /// Distorts normalised coordinates (x/z, y/z), OpenCV's `projectPoints`:
    /// x' = x(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²), y' likewise.
    /// Beyond `valid_radius` (from [`Distortion::valid_radius`]) the point on the rim is
    /// distorted and carried on outwards along its own ray with the slope at the rim, so that
    /// the map stays one to one and nothing outside comes back into the picture.
    pub fn distort(&self, p: DVec2, valid_radius: f64) -> DVec2 {
        let r = p.length();
        if r > valid_radius {
            let direction = p / r;
            return self.polynomial(direction * valid_radius)
                + direction * (self.slope(valid_radius) * (r - valid_radius));
        }
        self.polynomial(p)
    }

    fn polynomial(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        DVec2::new(
            p.x * radial + 2.0 * self.p1 * p.x * p.y + self.p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * p.x * p.y,
        )
    }

    /// The inverse of [`Distortion::distort`] by Newton's method with a numeric Jacobian and
    /// step halving. `None` where no undistorted point is found within 1e-10.
    pub fn undistort(&self, distorted: DVec2, valid_radius: f64) -> Option<DVec2> {
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
    const FR1: Distortion = Distortion { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633 };

    #[test]
    fn worked_by_hand() {
        // x = 0.3, y = -0.2: r² = 0.13; radial = 1 + 0.034112 - 0.01610739 + 0.0025557701 = 1.02056038
        // x' = 0.3·1.02056038 + 2·(-0.0054)(-0.06) + 0.0026·(0.13 + 0.18) = 0.306168114 + 0.000648 + 0.000806
        let d = FR1.distort(DVec2::new(0.3, -0.2), FR1.valid_radius());
        assert!((d.x - 0.307_622_11).abs() < 1e-7, "{}", d.x);
        // y' = -0.2·1.02056038 - 0.0054·(0.13 + 0.08) + 2·0.0026·(-0.06) = -0.204112076 - 0.001134 - 0.000312
        assert!((d.y + 0.205_558_08).abs() < 1e-7, "{}", d.y);
    }

    #[test]
    fn barrel_folds_where_the_derivative_vanishes() {
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
        #[test]
        fn round_trip(x in -0.9f64..0.9, y in -0.7f64..0.7, k1 in -0.4f64..0.4, k2 in -0.1f64..0.1, p in -0.004f64..0.004) {
            for model in [FR1, Distortion { k1, k2, p1: p, p2: -p, k3: 0.0 }] {
                let valid = model.valid_radius();
                prop_assume!(x.hypot(y) < 0.95 * valid);
                let back = model.undistort(model.distort(DVec2::new(x, y), valid), valid).unwrap();
                prop_assert!((back - DVec2::new(x, y)).length() < 1e-7, "{back}");
            }
        }
    }
}
