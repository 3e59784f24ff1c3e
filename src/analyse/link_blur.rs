//! Alignment error caused by a difference in motion blur between the two pictures.
//!
//! A row's exposure t moves the picture along its motion field by t·ξ. Blur kernels are symmetric
//! about their middle, so that equal motions forth and back blur alike; the length by which two
//! frames' kernels differ is
//!
//!   L = t·min(|ξᵢ − A·ξⱼ|, |ξᵢ + A·ξⱼ|),   A = Ad(T_i⁻¹ T_j),   |ξ|² = ξᵀ·metric·ξ
//!
//! The error is about 0.04·L (simulated concrete and desks with exact poses and 2 to 45 px of
//! blur). All n links of a blurred frame share it. Their mean does not reduce a shared error, so
//! each link gets the variance n·(0.04·L)².

use nalgebra::Matrix6;

use super::align::Link;
use super::state::CameraState;
use crate::fit::twist::Twist;

/// Alignment error per difference in blur length.
const ERROR_BY_LENGTH: f64 = 0.04;

/// One standard deviation of a link's error by blur, px. `to_in_from`: the adjoint A.
pub fn error_px(link: &Link, [from, to]: [&CameraState; 2], to_in_from: &Matrix6<f64>, exposure_s: f64) -> f64 {
    let there: Twist = to_in_from * to.twist;
    let forth = link.displaced_px(&(from.twist - there));
    let back = link.displaced_px(&(from.twist + there));
    ERROR_BY_LENGTH * exposure_s * forth.min(back)
}

#[cfg(test)]
pub mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::fit::twist;

    /// Points 1 m away of a camera of 500 px: turns by y and steps along x move them alike.
    pub fn link(from: usize, to: usize, e: Twist) -> Link {
        let metric =
            Matrix6::from_diagonal(&twist::twist(DVec3::splat(500.0f64.powi(2)), DVec3::splat(500.0f64.powi(2))));
        Link {
            from,
            to,
            e,
            information: metric / 0.01f64.powi(2),
            metric,
            correlation: 0.9,
            min_correlation: 0.7,
            overlap: 1.0,
            readout: None,
        }
    }

    fn moving(x_m_per_s: f64) -> CameraState {
        let twist = twist::twist(DVec3::X * x_m_per_s, DVec3::ZERO);
        CameraState { world_from_camera: DAffine3::IDENTITY, twist }
    }

    #[test]
    fn error_follows_the_difference_of_blur_lengths() {
        let error = |from: f64, to: f64| {
            error_px(&link(0, 1, Twist::zeros()), [&moving(from), &moving(to)], &Matrix6::identity(), 0.01)
        };
        // 500 px/m · 0.01 s · (2 − 1) m/s is 5 px, of which 0.04 err.
        assert!((error(2.0, 1.0) - 0.2).abs() < 1e-12, "{}", error(2.0, 1.0));
        assert!((error(1.0, -2.0) - 0.2).abs() < 1e-12, "forth and back blur alike");
        assert_eq!((error(2.0, 2.0), error(2.0, -2.0)), (0.0, 0.0));
    }
}
