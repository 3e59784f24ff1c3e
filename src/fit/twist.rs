//! Rigid motions and their logarithms.
//!
//! A twist is (v, ω): for one unit of its parameter a point x moves as ẋ = ω × x + v. exp maps it
//! to the rigid motion (Rodrigues), log is the inverse. Ad(T) maps a twist from T's source axes to
//! its target axes: T·exp(x)·T⁻¹ = exp(Ad(T)·x) (Murray, Li and Sastry 1994, eq. 2.36, 2.58; there
//! (v, ω) as here).

use glam::{DAffine3, DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, Matrix6, Vector6};

/// Translation first (m), then rotation (rad).
pub type Twist = Vector6<f64>;

/// Below this angle (rad) the series' first terms are exact to machine precision.
const SMALL_ANGLE_RAD: f64 = 1e-6;

pub fn translation(twist: &Twist) -> DVec3 {
    DVec3::new(twist[0], twist[1], twist[2])
}

pub fn rotation_vector(twist: &Twist) -> DVec3 {
    DVec3::new(twist[3], twist[4], twist[5])
}

pub fn twist(way: DVec3, turn: DVec3) -> Twist {
    Vector6::new(way.x, way.y, way.z, turn.x, turn.y, turn.z)
}

pub fn exp(x: &Twist) -> DAffine3 {
    let (v, w) = (translation(x), rotation_vector(x));
    let angle = w.length();
    // V = 1 + (1 − cos θ)/θ² [ω]× + (θ − sin θ)/θ³ [ω]×².
    let (a, b) = if angle < SMALL_ANGLE_RAD {
        (0.5, 1.0 / 6.0)
    } else {
        ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / angle.powi(3))
    };
    let along = v + a * w.cross(v) + b * w.cross(w.cross(v));
    DAffine3::from_rotation_translation(DQuat::from_scaled_axis(w), along)
}

/// Logarithm of a rigid motion, for rotations up to π.
pub fn log(motion: &DAffine3) -> Twist {
    let w = rotation(motion).to_scaled_axis();
    let angle = w.length();
    let t = motion.translation;
    let b = if angle < SMALL_ANGLE_RAD {
        1.0 / 12.0
    } else {
        1.0 / (angle * angle) - (1.0 + angle.cos()) / (2.0 * angle * angle.sin())
    };
    twist(t - 0.5 * w.cross(t) + b * w.cross(w.cross(t)), w)
}

pub fn rotation(motion: &DAffine3) -> DQuat {
    let turn = DQuat::from_mat3(&motion.matrix3).normalize();
    // The shorter of the two rotations.
    if turn.w < 0.0 { -turn } else { turn }
}

pub fn adjoint(motion: &DAffine3) -> Matrix6<f64> {
    let r = matrix(&motion.matrix3);
    let mut a = Matrix6::zeros();
    a.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
    a.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
    a.fixed_view_mut::<3, 3>(0, 3).copy_from(&(cross(motion.translation) * r));
    a
}

fn matrix(m: &DMat3) -> Matrix3<f64> {
    Matrix3::from_column_slice(&m.to_cols_array())
}

/// The cross-product matrix `[v]×`: `v × x = [v]×·x`.
fn cross(v: DVec3) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cases() -> [Twist; 4] {
        [
            twist(DVec3::new(1.0, -2.0, 0.5), DVec3::ZERO),
            twist(DVec3::new(0.3, 0.1, -0.2), DVec3::new(1e-8, 2e-8, -1e-8)),
            twist(DVec3::new(0.3, 0.1, -0.2), DVec3::new(0.4, -1.1, 0.7)),
            twist(DVec3::new(-3.0, 0.0, 2.0), DVec3::new(0.0, 0.0, 2.9)),
        ]
    }

    #[test]
    fn quarter_turn_matches_hand_calculation() {
        // About z by 90° while moving along x at π/2: a quarter of a circle of radius 1, from (0,
        // 0) to (1, 1).
        let quarter = std::f64::consts::FRAC_PI_2;
        let motion = exp(&twist(DVec3::X * quarter, DVec3::Z * quarter));
        assert!((motion.translation - DVec3::new(1.0, 1.0, 0.0)).length() < 1e-12, "{motion:?}");
        assert!((motion.transform_vector3(DVec3::X) - DVec3::Y).length() < 1e-12);
    }

    #[test]
    fn log_inverts_exp() {
        for x in cases() {
            assert!((log(&exp(&x)) - x).norm() < 1e-9, "{x}");
            assert!((exp(&x) * exp(&-x)).abs_diff_eq(DAffine3::IDENTITY, 1e-12));
        }
    }

    #[test]
    fn adjoint_maps_twists_to_other_axes() {
        let t = exp(&cases()[2]);
        for x in cases() {
            let carried = exp(&(adjoint(&t) * x));
            assert!((t * exp(&x) * t.inverse()).abs_diff_eq(carried, 1e-9), "{x}");
        }
    }
}
