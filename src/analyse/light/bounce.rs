//! Bounce light: a lamp's light reflected by the unseen wall, ceiling or shade beside it.
//!
//! It reaches a surface from within tens of degrees of the lamp, so its shadows are soft. It is
//! modelled as a second lamp of 1.6 m diameter at the same place. cos θ/d² is harmonic in the
//! lamp's position, so that as long as the whole sphere of [`places`] is over a surface's horizon,
//! the mean over it is the share of its centre. Not modelled: the position of the reflecting
//! surfaces. If they are in view, their light is counted twice, because the panorama has it too.

use glam::DVec3;

use super::lamp_fit::LampSource;
use super::occupancy::OccupancyGrid;

/// Diameter of the second lamp, m.
pub const DIAMETER_M: f64 = 1.6;
/// Smallest bounce light that is written, by the white level; less is part of the ambient light.
pub const MIN_SHARE: f64 = 0.02;
/// Sphere radius R, m. Its projection and the lamp's disc of radius r have equal second moments:
/// (2/3)·R² = r²/2.
const RADIUS_M: f64 = 0.5 * DIAMETER_M * 0.866_025_403_784_438_6;
const SPHERE_SAMPLES: usize = 16;
/// π(3 − √5), rad: the angle between successive points of a Fibonacci sphere.
const GOLDEN_RAD: f64 = 2.399_963_229_728_653;

/// Samples of the sphere around a lamp that are visible from the lamp: none lies behind a measured
/// wall.
pub fn places(lamp: &LampSource, occupancy: &OccupancyGrid) -> Vec<LampSource> {
    let on_sphere = |n: usize| {
        let z = 1.0 - (2 * n + 1) as f64 / SPHERE_SAMPLES as f64;
        let (sin, cos) = (GOLDEN_RAD * n as f64).sin_cos();
        let across = (1.0 - z * z).sqrt();
        LampSource { position_m: lamp.position_m + RADIUS_M * DVec3::new(across * cos, across * sin, z), along: None }
    };
    let is_visible = |place: &LampSource| !occupancy.is_occluded(lamp.position_m, DVec3::ZERO, place.position_m);
    let visible: Vec<LampSource> = (0..SPHERE_SAMPLES).map(on_sphere).filter(is_visible).collect();
    if visible.is_empty() { vec![LampSource { along: None, ..*lamp }] } else { visible }
}

/// The mean share of a lamp's [`places`].
pub fn mean_share(places: &[LampSource], share: impl Fn(&LampSource) -> f64) -> f64 {
    places.iter().map(share).sum::<f64>() / places.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::lamp_fit::lamp_irradiance;
    use super::*;

    #[test]
    fn mean_share_of_a_sphere_over_the_horizon_is_that_of_its_centre() {
        let lamp = LampSource { position_m: DVec3::new(1.0, 0.5, 2.0), along: None };
        let all = places(&lamp, &OccupancyGrid::new(&[]));
        assert_eq!(all.len(), SPHERE_SAMPLES);
        assert!(all.iter().all(|place| (place.position_m.distance(lamp.position_m) - RADIUS_M).abs() < 1e-12));
        let irradiance = |place: &LampSource| lamp_irradiance(DVec3::ZERO, DVec3::Z, place);
        assert!(
            (mean_share(&all, irradiance) / irradiance(&lamp) - 1.0).abs() < 0.02,
            "{} {}",
            mean_share(&all, irradiance),
            irradiance(&lamp)
        );
    }

    #[test]
    fn samples_behind_a_measured_ceiling_are_left_out() {
        let ceiling: Vec<DVec3> =
            (0..6400).map(|n| DVec3::new(0.03 * (n % 80) as f64 - 1.2, 0.03 * (n / 80) as f64 - 1.2, 2.5)).collect();
        let lamp = LampSource { position_m: DVec3::new(0.0, 0.0, 2.2), along: None };
        let visible = places(&lamp, &OccupancyGrid::new(&ceiling));
        // Cells are 4 cm wide.
        assert!(visible.iter().all(|place| place.position_m.z < 2.54), "{visible:?}");
        // By hand (1 + 0.3/0.693)/2 = 0.72 of the sphere's area.
        assert!((10..=12).contains(&visible.len()), "{}", visible.len());
    }
}
