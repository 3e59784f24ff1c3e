//! Optical falloff: vignetting, and lateral chromatic aberration.
//!
//! Not modelled: pixel vignetting (a sensor's own angular response), pupil distortion, and
//! longitudinal chromatic aberration.

use std::f64::consts::PI;

use glam::DVec2;

/// Natural vignetting of a ray (x/z, y/z): cos⁴θ, 0 to 1, where tan θ is the ray's length.
///
/// One factor of cos θ for the foreshortened opening, two for the longer way to the film, and one
/// for the oblique incidence on the film; cos²θ = 1/(1 + tan²θ).
pub fn natural(ray: DVec2) -> f64 {
    (1.0 + ray.length_squared()).powi(-2)
}

/// Mechanical vignetting: a rim in front of the aperture that clips oblique light.
///
/// Seen along a ray, opening and rim are two circles that shift relative to each other by distance
/// · tan θ. Light passes where they overlap, which turns highlights near the corners into cat's
/// eyes. Stopping down removes it, as in a real lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rim {
    /// Distance from the opening along the axis, metres, at least 0.
    pub distance_m: f64,
    /// Metres, above 0. If smaller than the radius of the widest opening, the centre gets darker
    /// too.
    pub radius_m: f64,
}

impl Rim {
    /// The share of the aperture that a ray (x/z, y/z) passes, 0 to 1. For a pinhole 1 within the
    /// rim and 0 beyond.
    pub fn gain(&self, opening_diameter_m: f64, ray: DVec2) -> f64 {
        let radius_m = 0.5 * opening_diameter_m;
        let shift_m = self.distance_m * ray.length();
        if radius_m <= 0.0 {
            return if shift_m <= self.radius_m { 1.0 } else { 0.0 };
        }
        overlap_area(radius_m, self.radius_m, shift_m) / (PI * radius_m * radius_m)
    }

    /// True if a point of the aperture (metres from its centre, in the ray's axes) is reached by
    /// the light of a ray: the shape of the cat's eye.
    pub fn passes(&self, on_opening_m: DVec2, ray: DVec2) -> bool {
        // Along `ray` per metre, light crosses the rim's plane that much further out.
        (on_opening_m + self.distance_m * ray).length() <= self.radius_m
    }
}

/// The area common to two circles whose centres are `apart`, in squares of their unit.
pub fn overlap_area(radius_a: f64, radius_b: f64, apart: f64) -> f64 {
    let (small, large) = (radius_a.min(radius_b), radius_a.max(radius_b));
    if apart <= large - small {
        return PI * small * small;
    }
    if apart >= large + small {
        return 0.0;
    }
    // Two circular segments, on either side of the chord at x from the larger circle's centre.
    let x = (apart * apart + large * large - small * small) / (2.0 * apart);
    let segment = |radius: f64, to_chord: f64| {
        let angle = (to_chord / radius).clamp(-1.0, 1.0).acos();
        radius * radius * (angle - angle.sin() * angle.cos())
    };
    segment(large, x) + segment(small, apart - x)
}

/// Lateral chromatic aberration of one colour: r' = r·(1 + a + b·r²), with r in half diagonals of
/// the picture (0 in the centre, 1 in the corners).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lateral {
    /// Linear part: 0.001 is one pixel in a thousand.
    pub a: f64,
    /// Cubic part.
    pub b: f64,
}

impl Lateral {
    /// r'/r at a radius.
    pub fn scale(&self, radius: f64) -> f64 {
        1.0 + self.a + self.b * radius * radius
    }

    /// Image position of this colour of a point at `at_px`, px.
    pub fn displaced_px(&self, at_px: DVec2, middle_px: DVec2, half_diagonal_px: f64) -> DVec2 {
        let from_middle = at_px - middle_px;
        middle_px + from_middle * self.scale(from_middle.length() / half_diagonal_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::tests::close;
    use proptest::prelude::*;

    #[test]
    fn cos4_falloff_matches_hand_calculation() {
        assert_eq!(natural(DVec2::ZERO), 1.0);
        // At 45° cos⁴ is a quarter, at 30° (tan = 1/√3) it is 9/16.
        close(natural(DVec2::new(0.6, 0.8)), 0.25, 1e-12);
        close(natural(DVec2::new(3f64.sqrt().recip(), 0.0)), 0.5625, 1e-12);
    }

    #[test]
    fn overlap_area_matches_hand_calculation() {
        close(overlap_area(1.0, 1.0, 0.0), PI, 1e-12);
        // Unit circles one apart: 2π/3 − √3/2.
        close(overlap_area(1.0, 1.0, 1.0), 2.0 * PI / 3.0 - 0.75f64.sqrt(), 1e-12);
        close(overlap_area(2.0, 1.0, 1.0), PI, 1e-12);
        assert_eq!((overlap_area(2.0, 1.0, 3.0), overlap_area(1.0, 1.0, 5.0)), (0.0, 0.0));
        // The small circle's centre lies beyond the chord: radii 1.2 and 1 at distance 0.6,
        // compared with the arguments swapped.
        close(overlap_area(1.2, 1.0, 0.6), overlap_area(1.0, 1.2, 0.6), 1e-12);
    }

    #[test]
    fn rim_darkens_the_corners_less_when_stopped_down() {
        let rim = Rim { distance_m: 0.02, radius_m: 0.01 };
        let ray = DVec2::new(0.3, 0.4); // shifts by 10 mm
        assert_eq!(rim.gain(0.02, DVec2::ZERO), 1.0);
        // Unit circles one radius apart: (2π/3 − √3/2)/π
        close(rim.gain(0.02, ray), 0.391_002, 1e-6);
        assert_eq!(rim.gain(0.004, DVec2::new(0.4, 0.0)), 1.0);
        assert_eq!((rim.gain(0.0, DVec2::new(0.49, 0.0)), rim.gain(0.0, DVec2::new(0.51, 0.0))), (1.0, 0.0));
    }

    #[test]
    fn rim_gain_equals_the_share_of_passing_points() {
        let (rim, ray) = (Rim { distance_m: 0.02, radius_m: 0.011 }, DVec2::new(0.3, 0.2));
        let n = 400;
        let (mut inside, mut passing) = (0u32, 0u32);
        for i in 0..n * n {
            let p = DVec2::new(f64::from(i % n) + 0.5, f64::from(i / n) + 0.5) * 2.0 / f64::from(n) - 1.0;
            if p.length() <= 1.0 {
                inside += 1;
                passing += u32::from(rim.passes(p * 0.01, ray));
            }
        }
        close(f64::from(passing) / f64::from(inside), rim.gain(0.02, ray), 2e-3);
    }

    #[test]
    fn lateral_aberration_is_radial() {
        let (middle, corner) = (DVec2::new(320.0, 240.0), DVec2::new(640.0, 480.0));
        let red = Lateral { a: 0.001, b: 0.002 };
        // The corner is 400 px out, r = 1: 0.003 of that.
        let moved = red.displaced_px(corner, middle, 400.0) - corner;
        close(moved.x, 0.96, 1e-9);
        close(moved.y, 0.72, 1e-9);
        // Half way out: 200 px · (0.001 + 0.002/4).
        let half = DVec2::new(520.0, 240.0);
        close((red.displaced_px(half, middle, 400.0) - half).x, 0.3, 1e-9);
        assert_eq!(Lateral::default().displaced_px(corner, middle, 400.0), corner);
    }

    proptest! {
        #[test]
        fn overlap_is_symmetric_and_within_the_smaller(a in 0.01f64..3.0, b in 0.01f64..3.0, d in 0.0f64..7.0) {
            let area = overlap_area(a, b, d);
            prop_assert!((area - overlap_area(b, a, d)).abs() < 1e-9);
            prop_assert!(area >= -1e-12 && area <= PI * a.min(b).powi(2) + 1e-9);
            prop_assert!(overlap_area(a, b, d + 0.01) <= area + 1e-9, "further apart is less");
        }
    }
}
