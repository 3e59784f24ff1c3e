//! Rigid transforms.

use glam::{DMat3, DVec3};

use crate::tracking::tum::MAX_NORM_ERROR;

/// The error for other matrices; follows the name.
pub const NOT_RIGID: &str = "is not a rotation and a translation (unit axes at right angles, right-handed)";

/// True if a transform is a lost pose, as written by trackers: non-finite, or without a rotation.
pub fn is_lost(rows: &[[f64; 4]]) -> bool {
    let rotation = rows.iter().take(3).flat_map(|[x, y, z, _]| [*x, *y, *z]);
    !rows.iter().flatten().all(|value| value.is_finite()) || rotation.into_iter().all(|value| value == 0.0)
}

/// Rotation and translation of three rows of a transform. `None` if it scales, shears, mirrors or
/// is not finite.
pub fn rigid([a, b, c]: [[f64; 4]; 3]) -> Option<(DMat3, DVec3)> {
    let column = |i: usize| DVec3::new(a[i], b[i], c[i]);
    let turn = DMat3::from_cols(column(0), column(1), column(2));
    let off = turn.transpose() * turn - DMat3::IDENTITY;
    let worst = off.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
    // Twice the tolerance, since the length is squared. The determinant is NaN if any value is.
    let is_rigid = worst <= 2.0 * MAX_NORM_ERROR && turn.determinant() > 0.0 && column(3).is_finite();
    is_rigid.then(|| (turn, column(3)))
}
