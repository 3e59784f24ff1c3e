//! Cosine-weighted directions about a surface normal: the mean of the radiance along them is the
//! irradiance over π.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use super::random::Random;

/// Number of directions of the indirect-light gather.
pub const GATHER_DIRECTIONS: usize = 64;
/// 2π(1 − 1/φ), rad: successive points of the spiral never line up (Vogel 1979).
const GOLDEN_RAD: f64 = 2.399_963_229_728_653;

/// Orthonormal basis with the normal as third axis.
pub fn tangent_frame(n: DVec3) -> DMat3 {
    let x = n.any_orthonormal_vector();
    DMat3::from_cols(x, n.cross(x), n)
}

/// The `i`-th of `count` directions on a fixed spiral: gathered light varies smoothly with
/// position.
pub fn spiral_direction(n: DVec3, i: usize, count: usize) -> DVec3 {
    direction_at(n, (i as f64 + 0.5) / count as f64, GOLDEN_RAD * i as f64)
}

/// The `k`-th of `count` stratified random directions.
pub fn random_cosine_direction(n: DVec3, k: usize, count: usize, random: &mut Random) -> DVec3 {
    let r2 = (k as f64 + random.uniform()) / count as f64;
    direction_at(n, r2, TAU * random.uniform())
}

/// The direction above the point of the unit disc with squared radius `r2`.
fn direction_at(n: DVec3, r2: f64, turn_rad: f64) -> DVec3 {
    tangent_frame(n) * (DVec2::from_angle(turn_rad) * r2.sqrt()).extend((1.0 - r2).sqrt())
}
