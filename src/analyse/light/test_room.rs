//! A synthetic room with known lamps, for tests.

use glam::DVec3;

use super::lamp_fit::LampSource;
use super::occupancy::OccupancyGrid;
use super::voxels::Voxel;

/// A floor with a white box, in voxels of 2 cm, with a texture of ± 10 % and shadows. `lamps`:
/// those of each half of the frames.
pub fn room(lamps: [&[DVec3]; 2]) -> (Vec<Voxel>, Vec<DVec3>) {
    room_with_discs(lamps, 0.0)
}

/// A [`room`] with a part of each lamp's light from a level disc of 1.6 m around it.
pub fn room_with_discs(lamps: [&[DVec3]; 2], share: f64) -> (Vec<Voxel>, Vec<DVec3>) {
    let mut surfaces = Vec::new();
    for i in 0..80 {
        for j in 0..80 {
            let at = DVec3::new(0.025 * f64::from(i) - 1.0, 0.025 * f64::from(j) - 1.0, 0.0);
            surfaces.push((at, DVec3::Z, DVec3::new(0.4, 0.25, 0.12)));
        }
    }
    for i in 0..20 {
        for j in 0..20 {
            let (along, up) = (0.02 * f64::from(i) - 0.19, 0.02 * f64::from(j) + 0.01);
            for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                let n = DVec3::new(x, y, 0.0);
                let at = DVec3::new(0.4, 0.3, 0.0) + 0.2 * n + along * DVec3::new(-y, x, 0.0) + up * DVec3::Z;
                surfaces.push((at, n, DVec3::splat(0.8)));
            }
            let at = DVec3::new(0.4 + along, 0.3 + 0.02 * f64::from(j) - 0.19, 0.4);
            surfaces.push((at, DVec3::Z, DVec3::splat(0.8)));
        }
    }
    let solid: Vec<DVec3> = surfaces.iter().map(|surface| surface.0).collect();
    let occupancy = OccupancyGrid::new(&solid);
    let lit = |(n, (at, normal, albedo)): (usize, &(DVec3, DVec3, DVec3))| {
        let pattern = 1.0 + 0.1 * (7.0 * n as f64).sin();
        let light_of_lamps = |lamps: &[DVec3]| {
            let from = |lamp: DVec3| {
                2.0 * occupancy.lamp_irradiance(*at, *normal, &LampSource { position_m: lamp, along: None })
            };
            // Rings of equal area with the same number of samples.
            let on_disc = |n: usize| {
                let (radius, turn) = (0.8 * ((n / 8) as f64 / 5.0 + 0.1).sqrt(), (n % 8) as f64 + 0.3 * (n / 8) as f64);
                let (sin, cos) = (turn * std::f64::consts::TAU / 8.0).sin_cos();
                DVec3::new(radius * cos, radius * sin, 0.0)
            };
            let shown = |lamp: &DVec3| {
                let spread =
                    if share > 0.0 { (0..40).map(|n| from(*lamp + on_disc(n))).sum::<f64>() / 40.0 } else { 0.0 };
                (1.0 - share) * from(*lamp) + share * spread
            };
            let direct: f64 = lamps.iter().map(shown).sum();
            Some((pattern * *albedo * (0.15 + direct)).as_vec3().to_array())
        };
        let light = [light_of_lamps(lamps[0]), light_of_lamps(lamps[1]), light_of_lamps(lamps[0])];
        Voxel { light, ..Voxel::of_surface(*at, *normal, light[2].unwrap_or_default()) }
    };
    (surfaces.iter().enumerate().map(lit).collect(), solid)
}
