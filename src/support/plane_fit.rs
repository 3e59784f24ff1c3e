//! The least-squares plane through points.

use glam::{DMat3, DVec3};

use crate::fit::symmetric_eigen;
use crate::plane::{HessePlane, Plane};

/// A plane that was fitted to points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneFit {
    pub plane: HessePlane,
    /// Distance of the points from it: root mean square and maximum, m.
    pub rms_m: f64,
    pub max_m: f64,
}

/// Why points make no plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the points do not define a plane: {0}")]
pub struct PlaneFitError(&'static str);

/// Smallest ratio of width to length of points that do not count as collinear.
const MIN_WIDTH_SHARE: f64 = 0.01;

/// The least-squares plane through three or more points (Pearson 1901).
pub fn plane_through(points_m: &[DVec3]) -> Result<PlaneFit, PlaneFitError> {
    if points_m.len() < 3 {
        return Err(PlaneFitError("it needs three"));
    }
    let count = points_m.len() as f64;
    let middle = points_m.iter().sum::<DVec3>() / count;
    let mut matrix = DMat3::ZERO;
    for p in points_m.iter().map(|p| *p - middle) {
        matrix += DMat3::from_cols(p * p.x, p * p.y, p * p.z);
    }
    let axes = symmetric_eigen(matrix);
    let [_, width, length] = axes.map(|(squares, _)| squares.max(0.0).sqrt());
    if width.is_nan() || width <= MIN_WIDTH_SHARE * length {
        return Err(PlaneFitError("they lie on a line; pick one to its side"));
    }
    let normal = axes[0].1;
    let distance_m = |p: &DVec3| normal.dot(*p - middle).abs();
    Ok(PlaneFit {
        plane: Plane { point_m: middle, normal }.into(),
        rms_m: (points_m.iter().map(|p| distance_m(p).powi(2)).sum::<f64>() / count).sqrt(),
        max_m: points_m.iter().map(distance_m).fold(0.0, f64::max),
    })
}

/// Step to which the normals of supports and facets are rounded, below their accuracy. An object
/// that is moved over a desk then keeps the same plane, and its planar shadow stays valid.
const NORMAL_STEP: f64 = 1.0 / 512.0;

/// A normal of unit length with components rounded to the step. `None` if it is not finite.
pub fn rounded_normal(normal: DVec3) -> Option<DVec3> {
    ((normal / NORMAL_STEP).round() * NORMAL_STEP).try_normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn plane_through_four_points_matches_hand_computation() {
        // Four corners, two of them 2 mm up: each lies 1 mm from the plane between.
        let points = [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.002), (0.0, 1.0, 0.002)].map(DVec3::from);
        let fit = plane_through(&points).unwrap();
        let plane = fit.plane.facing(DVec3::Z);
        assert!(plane.normal.abs_diff_eq(DVec3::Z, 1e-12) && (plane.offset_m - 0.001).abs() < 1e-12, "{plane:?}");
        assert!((fit.rms_m - 0.001).abs() < 1e-9 && (fit.max_m - 0.001).abs() < 1e-9, "{fit:?}");
        assert!(plane.facing(DVec3::NEG_Z).offset_m < 0.0);
        let line = [0.0, 1.0, 3.0].map(|x| DVec3::new(x, 2.0 * x, 0.001 * x * x));
        assert!(plane_through(&line).unwrap_err().to_string().contains("on a line"));
        assert!(plane_through(&points[..2]).unwrap_err().to_string().contains("three"));
    }

    proptest! {
        #[test]
        fn plane_through_points_of_a_plane_is_that_plane(x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64, d in -9.0..9.0f64) {
            let normal = DVec3::new(x, y, z);
            prop_assume!(normal.length() > 0.1);
            let normal = normal.normalize();
            let (a, b) = normal.any_orthonormal_pair();
            let points: Vec<_> = (0..7).map(|n| normal * d + a * f64::from(n).sin() + b * f64::from(3 * n).cos()).collect();
            let fit = plane_through(&points).unwrap();
            let plane = fit.plane.facing(normal);
            prop_assert!(plane.normal.abs_diff_eq(normal, 1e-9) && (plane.offset_m - d).abs() < 1e-9 && fit.max_m < 1e-9, "{fit:?}");
        }
    }
}
