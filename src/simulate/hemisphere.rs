//! Directions about a surface's normal, as dense as the cosine: a sum over them of the light along each is the irradiance by π.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use super::random::Random;

/// Directions from which a surface gathers what bounces.
pub const BOUNCES: usize = 64;
/// 2π(1 − 1/φ), rad: successive points of the spiral never line up (Vogel 1979).
const GOLDEN_RAD: f64 = 2.399_963_229_728_653;

/// Two axes across the normal, and the normal.
pub fn axes(n: DVec3) -> DMat3 {
    let x = n.any_orthonormal_vector();
    DMat3::from_cols(x, n.cross(x), n)
}

/// The `i`-th of `count` on a fixed spiral: what is gathered is smooth from place to place.
pub fn on_spiral(n: DVec3, i: usize, count: usize) -> DVec3 {
    at(n, (i as f64 + 0.5) / count as f64, GOLDEN_RAD * i as f64)
}

/// The `k`-th of `count` by chance.
pub fn about_cosine(n: DVec3, k: usize, count: usize, random: &mut Random) -> DVec3 {
    let r2 = (k as f64 + random.uniform()) / count as f64;
    at(n, r2, TAU * random.uniform())
}

/// Over the point of the unit disc with the squared radius `r2`.
fn at(n: DVec3, r2: f64, turn_rad: f64) -> DVec3 {
    axes(n) * (DVec2::from_angle(turn_rad) * r2.sqrt()).extend((1.0 - r2).sqrt())
}
