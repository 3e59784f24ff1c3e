//! Matrices that turn and shift, and nothing else.

use glam::{DMat3, DVec3};

use crate::tracking::tum::LARGEST_NORM_ERROR;

/// What is said of one that does more, behind its name.
pub const NOT_RIGID: &str = "is not a turn and a shift (unit axes at right angles, right-handed)";

/// The turn and the shift of three rows of a transform. `None` where it scales, shears, mirrors or holds what is not finite.
pub fn rigid([a, b, c]: [[f64; 4]; 3]) -> Option<(DMat3, DVec3)> {
    let column = |i: usize| DVec3::new(a[i], b[i], c[i]);
    let turn = DMat3::from_cols(column(0), column(1), column(2));
    let off = turn.transpose() * turn - DMat3::IDENTITY;
    let worst = off.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
    // Twice, since a length enters its own square. The determinant is NaN where anything is.
    let is_rigid = worst <= 2.0 * LARGEST_NORM_ERROR && turn.determinant() > 0.0 && column(3).is_finite();
    is_rigid.then(|| (turn, column(3)))
}
