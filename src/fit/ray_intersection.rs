//! The least-squares intersection of rays.

use glam::{DMat3, DVec3};

/// The point with the smallest sum of squared distances from lines, each with a point and a unit
/// direction: Σ (I − d dᵀ) x = Σ (I − d dᵀ) o. Not finite for fewer than two directions.
pub fn ray_intersection(rays: impl IntoIterator<Item = (DVec3, DVec3)>) -> DVec3 {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (origin, d) in rays {
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        matrix += across;
        right += across * origin;
    }
    matrix.inverse() * right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skew_lines_meet_halfway_and_one_line_nowhere() {
        // Along x at z = 0, along y at z = 2: nearest to both at (0, 0, 1).
        let lines = [(DVec3::new(5.0, 0.0, 0.0), DVec3::X), (DVec3::new(0.0, -3.0, 2.0), DVec3::Y)];
        assert!((ray_intersection(lines) - DVec3::Z).length() < 1e-12);
        assert!(!ray_intersection(lines[..1].iter().copied()).is_finite());
    }
}
