//! Film grain by film speed and format, relative to the calibrated noise. At the profile's own film
//! speed and format every factor is exactly 1, and the grain is the calibrated noise.
//!
//! **Amplitude.** A pixel of value x (linear light, as a share of full scale) at film speed S has
//! collected N = x·K/S photons: twice the speed is half the light. Their number has a standard
//! deviation of √N (Poisson), so the shot noise of x has variance x·S/K, proportional to S. Read
//! noise is a fixed number of electrons r; its variance (r·S/K)² is proportional to S². With the
//! ratio k = S/S₀ and the read noise's share s of the calibrated variance,
//!
//! σ²(k) = σ²(1) · ((1 − s)·k + s·k²)
//!
//! at every code value: the response and its slope are the same at all speeds and cancel. s is
//! estimated from the calibrated σ itself, see [`read_share`].
//!
//! **Size.** Grain is fixed on the film, so in the picture it grows with the picture's width and
//! with a smaller format. That is also the price of a smaller format: the same σ over larger grains
//! is equivalent to fewer photons for each part of the picture. A faster film has coarser grain,
//! too; how much depends on its emulsion. Here the diameter is proportional to the fourth root of
//! the speed (doubled from ISO 100 to 1600): a choice, not a measurement.
//!
//! Not modelled: fixed-pattern noise, quantisation, noise added after the gain (which does not
//! grow), dual-gain sensors, the camera's own noise reduction. With another film, a sensor's noise
//! becomes coarser too, which in reality only film's does.
//! reality only film's does.

use super::{NoiseProfile, Response};

/// Film and picture relative to the calibrated ones. All ratios are 1 if they are the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GrainRatios {
    /// Film speed relative to the profile's, above 0.
    pub iso: f64,
    /// Width of the film relative to the profile's, above 0.
    pub film_width: f64,
    /// Width of the picture in pixels relative to the profile's, above 0.
    pub picture_width: f64,
}

impl Default for GrainRatios {
    fn default() -> Self {
        Self { iso: 1.0, film_width: 1.0, picture_width: 1.0 }
    }
}

impl GrainRatios {
    /// The diameter of grains in pixels, relative to the calibrated pattern's.
    pub fn size(&self) -> f64 {
        self.iso.powf(0.25) * self.picture_width / self.film_width
    }

    /// σ at a code value, relative to the calibrated one. `read_share` is 0 to 1.
    pub fn sigma(&self, read_share: f64) -> f64 {
        // Equal to (1 − s)·k + s·k², but exactly 1 for k = 1.
        (self.iso * (1.0 + read_share * (self.iso - 1.0))).sqrt()
    }
}

fn slope(response: &Response, code: f64) -> f64 {
    response.slope_at_code((code / 255.0).clamp(0.0, 1.0))
}

/// σ of a channel's read noise in linear light (255 is full scale): that of the darkest bin.
pub fn read_light(noise: &NoiseProfile, response: &Response, channel: usize) -> f64 {
    let darkest = noise.bins.get(channel).and_then(|bins| bins.first());
    darkest.map_or(0.0, |bin| bin.sigma / slope(response, bin.code))
}

/// The share of read noise in the calibrated variance of a channel at a code value (8-bit scale), 0
/// to 1.
///
/// In linear light the read noise is constant, and in the darkest bin it is nearly all of the
/// noise. So σ_read = σ(darkest) / slope(darkest), converted to the code value by the response's
/// slope there. This is an upper bound, as the darkest bin received some light too.
pub fn read_share(noise: &NoiseProfile, response: &Response, channel: usize, code: f64) -> f64 {
    if channel >= noise.bins.len() {
        return 0.0;
    }
    let read = read_light(noise, response, channel) * slope(response, code);
    let sigma = noise.sigma(channel, code);
    if sigma > 0.0 { (read / sigma).powi(2).min(1.0) } else { 0.0 }
}

/// σ of a channel's grain at a code value, both on the 8-bit scale: the calibrated one at another
/// film speed.
pub fn sigma(noise: &NoiseProfile, response: &Response, channel: usize, code: f64, ratios: &GrainRatios) -> f64 {
    noise.sigma(channel, code) * ratios.sigma(read_share(noise, response, channel, code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, NoiseBin};
    use proptest::prelude::*;

    /// A sensor whose full scale is 1000 electrons, with a read noise of 4 electrons.
    fn sensor() -> (NoiseProfile, Response) {
        let bins: Vec<NoiseBin> = (0..=255)
            .map(|code| {
                let electrons = f64::from(code) / 255.0 * 1000.0;
                NoiseBin { code: f64::from(code), sigma: (electrons + 16.0).sqrt() * 255.0 / 1000.0 }
            })
            .collect();
        let bins = [bins.clone(), bins.clone(), bins];
        let noise =
            NoiseProfile { example: None, bins, channel_correlation: [0.0; 3], neighbour_correlation: [0.0; 2] };
        (noise, Response { curve: Curve::Linear, ..Default::default() })
    }

    #[test]
    fn grain_at_the_calibrated_speed_is_the_calibrated_noise() {
        let (noise, _) = sensor();
        for curve in [Curve::Linear, Curve::Srgb, Curve::Gamma] {
            let response = Response { curve, ..Default::default() };
            for code in 0..=255 {
                let own = sigma(&noise, &response, 1, f64::from(code), &GrainRatios::default());
                assert_eq!(own, noise.sigma(1, f64::from(code)));
            }
        }
        assert_eq!(GrainRatios::default().size(), 1.0);
    }

    #[test]
    fn quadruple_speed_equals_a_quarter_of_the_light() {
        let (noise, response) = sensor();
        let faster = GrainRatios { iso: 4.0, ..Default::default() };
        for code in [0.0, 10.0, 128.0, 255.0] {
            // Full scale is 250 electrons now.
            let electrons = code / 255.0 * 250.0;
            let expected = (electrons + 16.0f64).sqrt() * 255.0 / 250.0;
            assert!((sigma(&noise, &response, 0, code, &faster) / expected - 1.0).abs() < 1e-9, "{code}");
        }
        // By hand: in bright light √k alone is 2; black is proportional to k, 4.
        assert_eq!((faster.sigma(0.0), faster.sigma(1.0)), (2.0, 4.0));
        assert!((faster.sigma(0.25) - 7f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn read_noise_share_matches_hand_calculation() {
        let (noise, response) = sensor();
        assert_eq!(read_share(&noise, &response, 0, 0.0), 1.0);
        // 16 of 1016 at full scale.
        assert!((read_share(&noise, &response, 0, 255.0) - 16.0 / 1016.0).abs() < 1e-9);
        // sRGB is flatter at the top, so black's noise counts for less there.
        let srgb = Response::default();
        assert!(read_share(&noise, &srgb, 0, 255.0) < 0.02 * read_share(&noise, &response, 0, 255.0));
        assert_eq!(read_share(&noise, &response, 9, 128.0), 0.0);
    }

    #[test]
    fn grain_size_grows_with_speed_and_smaller_film() {
        let speed = |iso: f64| GrainRatios { iso, ..Default::default() }.size();
        assert_eq!((speed(16.0), speed(1.0 / 16.0)), (2.0, 0.5));
        // Half the film's width doubles the size of everything on it; so does a picture twice as
        // wide.
        assert_eq!(GrainRatios { film_width: 0.5, ..Default::default() }.size(), 2.0);
        assert_eq!(GrainRatios { picture_width: 2.0, ..Default::default() }.size(), 2.0);
        assert_eq!(GrainRatios { picture_width: 2.0, film_width: 2.0, iso: 1.0 }.size(), 1.0);
    }

    proptest! {
        #[test]
        fn grain_grows_with_iso(code in 0.0f64..255.0, iso in 0.1f64..100.0, more in 1.01f64..4.0) {
            let (noise, response) = sensor();
            let at = |iso: f64| {
                let ratios = GrainRatios { iso, ..Default::default() };
                (sigma(&noise, &response, 2, code, &ratios), ratios.size())
            };
            let ((a, small), (b, large)) = (at(iso), at(iso * more));
            prop_assert!(b > a && large > small);
            prop_assert!(b / a >= more.sqrt() - 1e-9 && b / a <= more + 1e-9);
        }
    }
}
