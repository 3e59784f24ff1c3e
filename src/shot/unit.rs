//! The length of a recording's unit.

use glam::DVec3;

use crate::scene::Scene;

/// Length of a recording's unit, m: the scene's, unless another one was given when the recording
/// was opened.
pub fn unit_m(scene: &Scene, opened_unit_m: f64) -> f64 {
    scene.metres_per_unit.filter(|_| opened_unit_m == 1.0).unwrap_or(opened_unit_m)
}

/// The recording's unit, m, with which two points have their true distance. `now` is the present
/// unit, m. `None` if the points coincide or the distance is 0.
pub fn metres_per_unit(from: DVec3, to: DVec3, true_m: f64, now: f64) -> Option<f64> {
    let unit = now * true_m / from.distance(to);
    (unit > 0.0 && unit.is_finite()).then_some(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_of_a_length_matches_hand_computation() {
        // 0.21 m that measure 3.5 units of 0.5 m: the unit is 6 cm.
        let unit = metres_per_unit(DVec3::ZERO, DVec3::X * 1.75, 0.21, 0.5).unwrap();
        assert!((unit - 0.06).abs() < 1e-12, "{unit}");
        assert_eq!(metres_per_unit(DVec3::X, DVec3::X, 0.21, 1.0), None);
    }
}
