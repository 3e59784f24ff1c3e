//! The projection of `camera::Distortion` with its derivatives, for a solver.
//!
//! Unlike there the polynomial is not continued along its tangent beyond its fold: the fitted
//! corners lie within the picture.

use glam::{DVec2, DVec3};
use nalgebra::SMatrix;

use crate::camera::{Distortion, Geometry, Intrinsics, LensModel};

/// Largest number of parameters of a model.
pub const MAX_PARAMETERS: usize = 9;
/// The parameters that both models start with.
pub const FOCAL: [&str; 4] = ["fx_px", "fy_px", "cx_px", "cy_px"];

/// A camera as a vector: fx, fy, cx, cy (px) and the coefficients of its model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensVector {
    pub model: LensModel,
    /// One value for each of [`LensVector::names`]; the others are 0.
    pub values: [f64; MAX_PARAMETERS],
}

/// Jacobian of a projected point by the camera's parameters.
pub type ByLens = SMatrix<f64, 2, MAX_PARAMETERS>;
/// Jacobian of a projected point by the point in camera coordinates.
pub type ByPoint = SMatrix<f64, 2, 3>;

impl LensVector {
    /// Without distortion. A model other than the fisheye's is Brown and Conrady's.
    pub fn plain(model: LensModel, focal_px: f64, centre_px: DVec2) -> Self {
        let mut values = [0.0; MAX_PARAMETERS];
        values[..4].copy_from_slice(&[focal_px, focal_px, centre_px.x, centre_px.y]);
        Self { model, values }
    }

    fn is_fisheye(&self) -> bool {
        self.model == LensModel::OpencvFisheye
    }

    /// The parameters in order, by their names in a profile.
    pub fn names(&self) -> Vec<&'static str> {
        let distortion: &[_] =
            if self.is_fisheye() { &["k1", "k2", "k3", "k4"] } else { &["k1", "k2", "p1", "p2", "k3"] };
        FOCAL.iter().chain(distortion).copied().collect()
    }

    /// Number of parameters.
    pub fn count(&self) -> usize {
        if self.is_fisheye() { 8 } else { 9 }
    }

    /// The camera of a picture of this size.
    pub fn geometry(&self, width_px: u32, height_px: u32) -> Geometry {
        let [fx_px, fy_px, cx_px, cy_px, a, b, c, d, e] = self.values;
        let intrinsics = Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px, ..Intrinsics::default() };
        let distortion = match self.model {
            LensModel::OpencvFisheye => {
                Distortion { model: self.model, k1: a, k2: b, k3: c, k4: d, ..Distortion::default() }
            }
            _ => Distortion { k1: a, k2: b, p1: c, p2: d, k3: e, ..Distortion::default() },
        };
        Geometry::new(intrinsics, distortion)
    }

    /// Projects a point in camera coordinates, px, with the Jacobians by the parameters and by the
    /// point. `None` outside the model's field of view.
    pub fn project(&self, point: DVec3) -> Option<(DVec2, ByLens, ByPoint)> {
        let (at, by_coefficient, by_point) = if self.is_fisheye() { self.fisheye(point)? } else { self.brown(point)? };
        let [fx, fy, cx, cy, ..] = self.values;
        let (mut by_lens, mut by_place) = (ByLens::zeros(), ByPoint::zeros());
        (by_lens[(0, 0)], by_lens[(1, 1)], by_lens[(0, 2)], by_lens[(1, 3)]) = (at.x, at.y, 1.0, 1.0);
        for (i, by) in by_coefficient.into_iter().enumerate() {
            (by_lens[(0, 4 + i)], by_lens[(1, 4 + i)]) = (fx * by.x, fy * by.y);
        }
        for (i, by) in by_point.into_iter().enumerate() {
            (by_place[(0, i)], by_place[(1, i)]) = (fx * by.x, fy * by.y);
        }
        Some((DVec2::new(fx * at.x + cx, fy * at.y + cy), by_lens, by_place))
    }

    /// Normalised point and its derivatives by the coefficients and the point. Brown (1971), as
    /// OpenCV's projectPoints: x' = x(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 xy + p2 (r² + 2x²), y' =
    /// y(…) + p1 (r² + 2y²) + 2 p2 xy.
    fn brown(&self, point: DVec3) -> Option<(DVec2, [DVec2; 5], [DVec2; 3])> {
        if point.z <= 1e-9 {
            return None;
        }
        let [_, _, _, _, k1, k2, p1, p2, k3] = self.values;
        let p = point.truncate() / point.z;
        let (x, y, r2) = (p.x, p.y, p.length_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let at = p * radial
            + DVec2::new(2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
        let mixed = 2.0 * (x * y * slope + p1 * x + p2 * y);
        let by_x = DVec2::new(radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed);
        let by_y = DVec2::new(mixed, radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x);
        let by_coefficient = [
            p * r2,
            p * (r2 * r2),
            DVec2::new(2.0 * x * y, r2 + 2.0 * y * y),
            DVec2::new(r2 + 2.0 * x * x, 2.0 * x * y),
            p * (r2 * r2 * r2),
        ];
        Some((at, by_coefficient, [by_x / point.z, by_y / point.z, -(by_x * x + by_y * y) / point.z]))
    }

    /// Normalised point and its derivatives for Kannala and Brandt (2006), as OpenCV's fisheye: θ_d
    /// = θ(1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) from the axis, in the point's direction across it.
    fn fisheye(&self, point: DVec3) -> Option<(DVec2, [DVec2; 5], [DVec2; 3])> {
        let [_, _, _, _, k1, k2, k3, k4, _] = self.values;
        let (across, z) = (point.truncate(), point.z);
        let rho = across.length();
        if rho < 1e-9 * z {
            let at = across / z;
            return Some((at, [DVec2::ZERO; 5], [DVec2::X / z, DVec2::Y / z, -at / z]));
        }
        if rho.is_nan() || rho <= 0.0 {
            return None;
        }
        let theta = rho.atan2(z);
        let t2 = theta * theta;
        let distorted = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
        let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        let towards = across / rho;
        // Along `towards` the point moves with θ, across it with θ_d/ρ.
        let (length2, scale) = (rho * rho + z * z, distorted / rho);
        let along = slope * z / length2;
        let change = |axis: DVec2| towards * (along * towards.dot(axis)) + (axis - towards * towards.dot(axis)) * scale;
        let by_point = [change(DVec2::X), change(DVec2::Y), towards * (-slope * rho / length2)];
        let power = |n: i32| towards * theta.powi(n);
        Some((towards * distorted, [power(3), power(5), power(7), power(9), DVec2::ZERO], by_point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{RigidPose, pose_jacobian};
    use glam::DMat3;

    fn lenses() -> [LensVector; 2] {
        let brown = [1159.0, 1154.0, 669.0, 388.0, -0.26, 0.05, -0.0007, 0.0003, -0.11];
        let fisheye = [520.0, 515.0, 640.0, 360.0, 0.05, -0.02, 0.008, -0.001, 0.0];
        [
            LensVector { model: LensModel::Opencv, values: brown },
            LensVector { model: LensModel::OpencvFisheye, values: fisheye },
        ]
    }

    const POINTS: [DVec3; 5] = [
        DVec3::new(0.3, -0.2, 1.4),
        DVec3::new(-2.0, 1.5, 4.0),
        DVec3::new(1e-4, 2e-4, 3.0),
        DVec3::new(0.0, 0.0, 2.0),
        DVec3::new(-1.1, -0.9, 2.5),
    ];

    #[test]
    fn projection_matches_the_camera() {
        for lens in lenses() {
            let geometry = lens.geometry(1280, 720);
            for point in POINTS {
                let at = lens.project(point).unwrap().0;
                assert!(at.distance(geometry.project(point).unwrap()) < 1e-9, "{:?} {point}", lens.model);
            }
            assert_eq!(lens.names().len(), lens.count());
        }
        assert!(lenses()[0].project(DVec3::NEG_Z).is_none());
        // 100° off the axis, within a fisheye's field of view.
        let side = DVec3::new(1.0, 0.0, -0.176);
        let [_, fisheye] = lenses();
        assert!(fisheye.project(side).unwrap().0.distance(fisheye.geometry(9, 9).project(side).unwrap()) < 1e-9);
    }

    /// Every derivative against central differences.
    #[test]
    fn derivatives_match_finite_differences() {
        let close = |analytic: DVec2, low: DVec2, high: DVec2, h: f64, what: &str| {
            let numeric = (high - low) / (2.0 * h);
            assert!(analytic.distance(numeric) < 1e-5 * (1.0 + numeric.length()), "{what}: {analytic} {numeric}");
        };
        let stand = RigidPose {
            rotation: DMat3::from_quat(glam::DQuat::from_scaled_axis(DVec3::new(0.4, -0.3, 0.2))),
            translation: DVec3::new(-3.0, -2.0, 9.0),
        };
        for lens in lenses() {
            for point in POINTS {
                let (_, by_lens, by_point) = lens.project(point).unwrap();
                for i in 0..lens.count() {
                    let h = 1e-6;
                    let at = |h: f64| {
                        let mut lens = lens;
                        lens.values[i] += h;
                        lens.project(point).unwrap().0
                    };
                    close(DVec2::new(by_lens[(0, i)], by_lens[(1, i)]), at(-h), at(h), h, lens.names()[i]);
                }
                for i in 0..3 {
                    let h = 1e-6;
                    let at = |h: f64| lens.project(point + h * DVec3::AXES[i]).unwrap().0;
                    close(DVec2::new(by_point[(0, i)], by_point[(1, i)]), at(-h), at(h), h, "point");
                }
            }
            let board = DVec3::new(4.0, 3.0, 0.0);
            let by = pose_jacobian(&stand, board, &lens.project(stand.point(board)).unwrap().2);
            for i in 0..6 {
                let h = 1e-6;
                let at = |h: f64| {
                    let step = |n: usize| if i / 3 == n { h * DVec3::AXES[i % 3] } else { DVec3::ZERO };
                    lens.project(stand.after_step(step(0), step(1)).point(board)).unwrap().0
                };
                close(DVec2::new(by[(0, i)], by[(1, i)]), at(-h), at(h), h, "stand");
            }
        }
    }
}
