//! The lamps of a site: the demonstration's one, or others by a seed, all above what its camera sees.
//!
//! A panel in the ceiling shines downwards, a bulb evenly into all directions. Not modelled: shades, windows, lamps that stand on
//! the floor.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::random::Random;

/// Along each side of a panel, and over a bulb.
const SIDE: usize = 8;
const AROUND: usize = 16;
/// A bulb's radius, metres.
const BULB_M: f64 = 0.05;
/// What a white surface shows in the middle of a site by its lamps, at least and at most.
const BRIGHT: (f64, f64) = (0.3, 0.65);
/// The middle of a site, metres.
pub const MIDDLE_M: DVec3 = DVec3::new(0.0, 0.0, 0.1);
/// Random numbers of a site's lamps, beside its seed.
const LAMPS: u64 = 0x6c61_6d70;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// A rectangle that shines downwards: half its extent along x and y, metres.
    Panel([f64; 2]),
    /// A ball.
    Bulb,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    pub centre_m: DVec3,
    pub form: Form,
    /// Linear; 1 is a fully lit white matt surface at camera white.
    pub radiance: DVec3,
}

/// The demonstration's: a rectangle in the ceiling.
pub const USUAL: Lamp = Lamp {
    centre_m: DVec3::new(-0.3, 0.4, 2.49),
    form: Form::Panel([0.3, 0.15]),
    radiance: DVec3::new(88.0, 83.0, 74.0),
};

/// So many lamps by a seed. No two are within half a metre of each other.
pub fn scattered(count: u32, seed: u64) -> Vec<Lamp> {
    let mut random = Random::new([seed, LAMPS, u64::from(count), 0]);
    let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
    let mut lamps: Vec<Lamp> = Vec::new();
    let mut shares = Vec::new();
    while lamps.len() < count as usize {
        let is_panel = between(0.0, 1.0) < 0.5;
        let height_m = if is_panel { 2.49 } else { between(1.7, 2.3) };
        let centre_m = DVec3::new(between(-0.9, 1.9), between(-1.9, 0.75), height_m);
        let warm = between(-0.12, 0.12);
        let tint = DVec3::new(1.0 + warm, 1.0, 1.0 - warm);
        let form = match is_panel {
            true => Form::Panel([between(0.1, 0.35), between(0.1, 0.35)]),
            false => Form::Bulb,
        };
        let share = between(0.5, 1.0);
        if lamps.iter().all(|lamp| lamp.centre_m.distance(centre_m) > 0.5) {
            lamps.push(Lamp { centre_m, form, radiance: tint });
            shares.push(share);
        }
    }
    let whole = between(BRIGHT.0, BRIGHT.1) / shares.iter().sum::<f64>();
    for (lamp, share) in lamps.iter_mut().zip(&shares) {
        lamp.radiance *= whole * share / lamp.share(lamp.centre_m - MIDDLE_M, DVec3::Z);
    }
    lamps
}

impl Lamp {
    /// Places on it, all of them as bright.
    pub fn points(&self) -> Vec<DVec3> {
        match self.form {
            Form::Panel(half_m) => {
                let place = |k: usize, half: f64| half * (2.0 * (k as f64 + 0.5) / SIDE as f64 - 1.0);
                let on = |i: usize| DVec3::new(place(i % SIDE, half_m[0]), place(i / SIDE, half_m[1]), 0.0);
                (0..SIDE * SIDE).map(|i| self.centre_m + on(i)).collect()
            }
            Form::Bulb => {
                let on = |i: usize| {
                    let z = 1.0 - (2 * i + 1) as f64 / AROUND as f64;
                    let (s, c) = (i as f64 / 1.618_033_988_749_895 * TAU).sin_cos();
                    DVec3::new(c, s, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
                };
                (0..AROUND).map(|i| self.centre_m + BULB_M * on(i)).collect()
            }
        }
    }

    /// A place on it by chance: the `k`-th of `count` that share it evenly.
    pub fn place(&self, k: usize, count: usize, random: &mut Random) -> DVec3 {
        let (along, by) = ((k as f64 + random.uniform()) / count as f64, random.uniform());
        match self.form {
            Form::Panel(half_m) => {
                self.centre_m + DVec3::new((2.0 * along - 1.0) * half_m[0], (2.0 * by - 1.0) * half_m[1], 0.0)
            }
            Form::Bulb => {
                let z = 1.0 - 2.0 * along;
                self.centre_m + BULB_M * (DVec2::from_angle(TAU * by) * (1.0 - z * z).max(0.0).sqrt()).extend(z)
            }
        }
    }

    /// The radiance of a white matt surface with normal `n` under a lamp of radiance 1 at `to`: ∫ cos θ cos θ' / (π r²) dA,
    /// approximated by the integrand at the lamp's centre times its area.
    pub fn share(&self, to: DVec3, n: DVec3) -> f64 {
        let r2 = to.length_squared();
        match self.form {
            Form::Panel(half_m) => {
                let area = 4.0 * half_m[0] * half_m[1];
                (n.dot(to).max(0.0) * to.z.max(0.0)) / (PI * r2 * r2) * area
            }
            Form::Bulb => n.dot(to).max(0.0) / (r2 * r2.sqrt()) * (BULB_M * BULB_M),
        }
    }

    /// Half of its extent as it is seen from below, metres.
    pub fn half_m(&self) -> [f64; 2] {
        match self.form {
            Form::Panel(half_m) => half_m,
            Form::Bulb => [BULB_M; 2],
        }
    }

    /// How far along a ray it is met, in lengths of `direction`.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match self.form {
            Form::Panel(half_m) => {
                let up = (self.centre_m.z - origin.z) / direction.z;
                let at = origin + direction * up - self.centre_m;
                (up > 0.0 && at.x.abs() < half_m[0] && at.y.abs() < half_m[1]).then_some(up)
            }
            Form::Bulb => {
                let to = self.centre_m - origin;
                let along = to.dot(direction) / direction.length_squared();
                (along > 0.0 && to.distance(direction * along) < BULB_M).then_some(along)
            }
        }
    }

    /// The blurred mirror image in a surface, as a share of its radiance: a Gaussian around the lamp's rectangle, as wide as
    /// `width`.
    pub fn mirrored(&self, p: DVec3, mirrored: DVec3, width: f64) -> f64 {
        let half_m = self.half_m();
        if mirrored.z < 1e-3 {
            return 0.0;
        }
        let at = p + mirrored * ((self.centre_m.z - p.z) / mirrored.z) - self.centre_m;
        let beside = DVec2::new((at.x.abs() - half_m[0]).max(0.0), (at.y.abs() - half_m[1]).max(0.0));
        // The wider the blur, the fainter: the ratio of the lamp's area to the blurred image's.
        let spread =
            (2.0 * half_m[0] / (2.0 * half_m[0] + 2.0 * width)) * (2.0 * half_m[1] / (2.0 * half_m[1] + 2.0 * width));
        spread * (-beside.length_squared() / (width * width)).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_gives_lamps_apart_from_each_other_that_are_as_bright_as_they_should_be() {
        assert_eq!(scattered(3, 7), scattered(3, 7));
        for seed in 0..50 {
            for count in 1..=3 {
                let lamps = scattered(count, seed);
                assert_eq!(lamps.len(), count as usize);
                let shown = |lamp: &Lamp| lamp.radiance.y * lamp.share(lamp.centre_m - MIDDLE_M, DVec3::Z);
                let all: f64 = lamps.iter().map(shown).sum();
                assert!(all > BRIGHT.0 - 1e-9 && all < BRIGHT.1 + 1e-9, "{all}");
            }
        }
    }

    #[test]
    fn a_bulb_lights_as_a_point_does_and_a_panel_as_its_area() {
        let bulb = Lamp { centre_m: DVec3::Z, form: Form::Bulb, radiance: DVec3::ONE };
        // E/π of a ball of radius r at d: L·r²/d².
        assert!((bulb.share(DVec3::Z * 2.0, DVec3::Z) - 0.0025 / 4.0).abs() < 1e-12);
        let panel = Lamp { form: Form::Panel([0.5, 0.25]), ..bulb };
        assert!((panel.share(DVec3::Z * 2.0, DVec3::Z) - 0.5 / PI / 4.0).abs() < 1e-12);
    }
}
