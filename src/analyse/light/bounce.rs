//! Bounce light: what the unseen wall, ceiling or shade near a lamp reflects.
//!
//! Surfaces near a lamp are brighter by it than all others, E ∝ 1/d², and nearly all of their reflected light comes from within a
//! distance of a few d. So it reaches a place from about the lamp's direction, as the lamp's own light does, but from tens of
//! degrees around it: its shadows are soft. It is modelled as a second, wide lamp at the lamp's place. Not modelled: where those
//! surfaces are, and that one of them may be seen.

use glam::DVec3;

use super::lit::Place;

/// Diameter of the wide lamp, m.
pub const DIAMETER_M: f64 = 1.6;
/// Bounce light that is a smaller share of all light at the place is left to the light from around.
pub const MIN_SHARE: f64 = 0.02;
/// A lamp that gives white which looks up less than this, by what it shows at 1 m, is at the horizon: its bounce light is left out,
/// too.
pub const MIN_EVEN: f64 = 1e-3;
/// Places by which its shares are averaged: on a sphere whose projection has the disc's second moment, r²/2 = (2/3)·R².
const PLACES: usize = 16;
const RADIUS_M: f64 = 0.5 * DIAMETER_M * 0.866_025_403_784_438_6;
/// π(3 − √5), rad: the angle between successive places of a Fibonacci sphere.
const GOLDEN_RAD: f64 = 2.399_963_229_728_653;

/// The mean of a share over the sphere around a lamp.
pub fn mean_share(lamp: &Place, share: impl Fn(&Place) -> f64) -> f64 {
    let on_sphere = |n: usize| {
        let z = 1.0 - (2 * n + 1) as f64 / PLACES as f64;
        let (sin, cos) = (GOLDEN_RAD * n as f64).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Place { at: lamp.at + RADIUS_M * DVec3::new(across * cos, across * sin, z), along: None }
    };
    (0..PLACES).map(|n| share(&on_sphere(n))).sum::<f64>() / PLACES as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_a_sphere_that_is_hidden_shows_half() {
        let lamp = Place { at: DVec3::new(1.0, 2.0, 3.0), along: None };
        let share = |place: &Place| if place.at.z > 3.0 { 1.0 } else { 0.0 };
        assert_eq!(mean_share(&lamp, share), 0.5);
        assert!((mean_share(&lamp, |place| place.at.distance(lamp.at)) - RADIUS_M).abs() < 1e-12);
    }
}
