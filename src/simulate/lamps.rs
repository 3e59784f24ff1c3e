//! Lamps of a site: the demonstration's one, or random ones by seed. All are above the camera's
//! field of view.
//!
//! A ceiling panel emits downwards, a bulb emits uniformly in all directions. Not modelled: shades,
//! windows, floor lamps.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::random::Random;

/// Sample points along each side of a panel.
const PANEL_POINTS_PER_SIDE: usize = 8;
const BULB_POINTS: usize = 16;
/// Radius of a bulb, metres.
const BULB_RADIUS_M: f64 = 0.05;
/// Smallest and largest radiance of a white surface in the middle of a site under its lamps.
const WHITE_RADIANCE_RANGE: (f64, f64) = (0.3, 0.65);
/// Centre of a site, metres.
pub const CENTRE_M: DVec3 = DVec3::new(0.0, 0.0, 0.1);
/// Key of the lamps' random numbers, in addition to the seed.
const LAMP_KEY: u64 = 0x6c61_6d70;

/// Shape of a lamp that emits light evenly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LampShape {
    /// A rectangle that emits downwards: half extents along x and y, metres.
    Panel([f64; 2]),
    /// A ball.
    Bulb,
}

/// A lamp of a site, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiteLamp {
    pub centre_m: DVec3,
    pub shape: LampShape,
    /// Linear; 1 is a fully lit white matt surface at camera white.
    pub radiance: DVec3,
}

/// The demonstration's lamp: a rectangle in the ceiling.
pub const DEMO_LAMP: SiteLamp = SiteLamp {
    centre_m: DVec3::new(-0.3, 0.4, 2.49),
    shape: LampShape::Panel([0.3, 0.15]),
    radiance: DVec3::new(88.0, 83.0, 74.0),
};

/// Random lamps by seed. No two are within half a metre of each other.
pub fn random_lamps(count: u32, seed: u64) -> Vec<SiteLamp> {
    let mut random = Random::new([seed, LAMP_KEY, u64::from(count), 0]);
    let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
    let mut lamps: Vec<SiteLamp> = Vec::new();
    let mut shares = Vec::new();
    while lamps.len() < count as usize {
        let is_panel = between(0.0, 1.0) < 0.5;
        let height_m = if is_panel { 2.49 } else { between(1.7, 2.3) };
        let centre_m = DVec3::new(between(-0.9, 1.9), between(-1.9, 0.75), height_m);
        let warm = between(-0.12, 0.12);
        let tint = DVec3::new(1.0 + warm, 1.0, 1.0 - warm);
        let shape = if is_panel { LampShape::Panel([between(0.1, 0.35), between(0.1, 0.35)]) } else { LampShape::Bulb };
        let share = between(0.5, 1.0);
        if lamps.iter().all(|lamp| lamp.centre_m.distance(centre_m) > 0.5) {
            lamps.push(SiteLamp { centre_m, shape, radiance: tint });
            shares.push(share);
        }
    }
    let whole = between(WHITE_RADIANCE_RANGE.0, WHITE_RADIANCE_RANGE.1) / shares.iter().sum::<f64>();
    for (lamp, share) in lamps.iter_mut().zip(&shares) {
        lamp.radiance *= whole * share / lamp.white_radiance(lamp.centre_m - CENTRE_M, DVec3::Z);
    }
    lamps
}

impl SiteLamp {
    /// Sample points of equal radiance on the lamp.
    pub fn points(&self) -> Vec<DVec3> {
        match self.shape {
            LampShape::Panel(half_m) => {
                let place = |k: usize, half: f64| half * (2.0 * (k as f64 + 0.5) / PANEL_POINTS_PER_SIDE as f64 - 1.0);
                let on = |i: usize| {
                    DVec3::new(
                        place(i % PANEL_POINTS_PER_SIDE, half_m[0]),
                        place(i / PANEL_POINTS_PER_SIDE, half_m[1]),
                        0.0,
                    )
                };
                (0..PANEL_POINTS_PER_SIDE * PANEL_POINTS_PER_SIDE).map(|i| self.centre_m + on(i)).collect()
            }
            LampShape::Bulb => {
                let on = |i: usize| {
                    let z = 1.0 - (2 * i + 1) as f64 / BULB_POINTS as f64;
                    let (s, c) = (i as f64 / 1.618_033_988_749_895 * TAU).sin_cos();
                    DVec3::new(c, s, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
                };
                (0..BULB_POINTS).map(|i| self.centre_m + BULB_RADIUS_M * on(i)).collect()
            }
        }
    }

    /// A random point on the lamp: the `k`-th of `count` stratified samples.
    pub fn sample_point(&self, k: usize, count: usize, random: &mut Random) -> DVec3 {
        let (along, by) = ((k as f64 + random.uniform()) / count as f64, random.uniform());
        match self.shape {
            LampShape::Panel(half_m) => {
                self.centre_m + DVec3::new((2.0 * along - 1.0) * half_m[0], (2.0 * by - 1.0) * half_m[1], 0.0)
            }
            LampShape::Bulb => {
                let z = 1.0 - 2.0 * along;
                self.centre_m + BULB_RADIUS_M * (DVec2::from_angle(TAU * by) * (1.0 - z * z).max(0.0).sqrt()).extend(z)
            }
        }
    }

    /// Radiance of a white diffuse surface with normal `n` under a lamp of radiance 1 at `to`: ∫
    /// cos θ cos θ' / (π r²) dA, approximated by the integrand at the lamp's centre times its area.
    pub fn white_radiance(&self, to: DVec3, n: DVec3) -> f64 {
        let r2 = to.length_squared();
        match self.shape {
            LampShape::Panel(half_m) => {
                let area = 4.0 * half_m[0] * half_m[1];
                (n.dot(to).max(0.0) * to.z.max(0.0)) / (PI * r2 * r2) * area
            }
            LampShape::Bulb => n.dot(to).max(0.0) / (r2 * r2.sqrt()) * (BULB_RADIUS_M * BULB_RADIUS_M),
        }
    }

    /// Half extents seen from below, metres.
    pub fn half_extents_m(&self) -> [f64; 2] {
        match self.shape {
            LampShape::Panel(half_m) => half_m,
            LampShape::Bulb => [BULB_RADIUS_M; 2],
        }
    }

    /// Ray parameter of the intersection, in lengths of `direction`.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match self.shape {
            LampShape::Panel(half_m) => {
                let up = (self.centre_m.z - origin.z) / direction.z;
                let at = origin + direction * up - self.centre_m;
                (up > 0.0 && at.x.abs() < half_m[0] && at.y.abs() < half_m[1]).then_some(up)
            }
            LampShape::Bulb => {
                let to = self.centre_m - origin;
                let along = to.dot(direction) / direction.length_squared();
                (along > 0.0 && to.distance(direction * along) < BULB_RADIUS_M).then_some(along)
            }
        }
    }

    /// Blurred mirror image in a surface, as a share of the lamp's radiance: a Gaussian of `width`
    /// around the lamp's rectangle.
    pub fn reflection(&self, p: DVec3, mirrored: DVec3, width: f64) -> f64 {
        let half_m = self.half_extents_m();
        if mirrored.z < 1e-3 {
            return 0.0;
        }
        let at = p + mirrored * ((self.centre_m.z - p.z) / mirrored.z) - self.centre_m;
        let beside = DVec2::new((at.x.abs() - half_m[0]).max(0.0), (at.y.abs() - half_m[1]).max(0.0));
        // The wider the blur, the fainter the image: the ratio of the lamp's area to the blurred
        // image's.
        let spread =
            (2.0 * half_m[0] / (2.0 * half_m[0] + 2.0 * width)) * (2.0 * half_m[1] / (2.0 * half_m[1] + 2.0 * width));
        spread * (-beside.length_squared() / (width * width)).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_lamps_follow_the_seed_and_white_stays_in_range() {
        assert_eq!(random_lamps(3, 7), random_lamps(3, 7));
        for seed in 0..50 {
            for count in 1..=3 {
                let lamps = random_lamps(count, seed);
                assert_eq!(lamps.len(), count as usize);
                let shown = |lamp: &SiteLamp| lamp.radiance.y * lamp.white_radiance(lamp.centre_m - CENTRE_M, DVec3::Z);
                let all: f64 = lamps.iter().map(shown).sum();
                assert!(all > WHITE_RADIANCE_RANGE.0 - 1e-9 && all < WHITE_RADIANCE_RANGE.1 + 1e-9, "{all}");
            }
        }
    }

    #[test]
    fn bulb_and_panel_match_their_analytic_irradiance() {
        let bulb = SiteLamp { centre_m: DVec3::Z, shape: LampShape::Bulb, radiance: DVec3::ONE };
        // E/π of a sphere of radius r at d: L·r²/d².
        assert!((bulb.white_radiance(DVec3::Z * 2.0, DVec3::Z) - 0.0025 / 4.0).abs() < 1e-12);
        let panel = SiteLamp { shape: LampShape::Panel([0.5, 0.25]), ..bulb };
        assert!((panel.white_radiance(DVec3::Z * 2.0, DVec3::Z) - 0.5 / PI / 4.0).abs() < 1e-12);
    }
}
