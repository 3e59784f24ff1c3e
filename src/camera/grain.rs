//! Grain by film speed and format, relative to what was calibrated: at the profile's own film
//! speed and format every factor is exactly 1, and the grain is the calibrated noise.
//!
//! **Amplitude.** A pixel of value x (linear light, a part of full scale) at film speed S has
//! gathered N = x·K/S photons: twice the speed is half the light. Their number scatters by √N
//! (Poisson), so the shot noise of x has variance x·S/K, proportional to S. Noise of reading
//! out is a fixed number of electrons r, its variance (r·S/K)² goes with S². With the ratio
//! k = S/S₀ and the share s that reading out has in the calibrated variance,
//!
//!   σ²(k) = σ²(1) · ((1 − s)·k + s·k²)
//!
//! at every code value: the response and its slope are the same at all speeds and cancel. s is
//! taken from the calibrated σ itself, see [`read_share`].
//!
//! **Size.** Grain lies on the film, so in the picture it grows with the picture's width and
//! with a smaller format. That is also the price of a smaller format: the same σ over larger
//! grains is what fewer photons for each part of the picture look like. A faster film has
//! coarser grain, too; how much is a matter of its emulsion. Here the diameter goes with the
//! fourth root of the speed (twice from ISO 100 to 1600): a choice, not a measurement.
//!
//! Not modelled: noise of a fixed pattern, of quantising, of amplifiers behind the gain (which
//! does not grow), two-gain sensors, the camera's own noise reduction, and, where another film is
//! asked for, that a sensor's noise (unlike film's) does not get coarser.

use super::{NoiseProfile, Response};

/// How film and picture differ from the calibrated ones; all 1 where they do not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GrainRatios {
    /// Film speed over the profile's, above 0.
    pub iso: f64,
    /// Width of the film over that of the profile's, above 0.
    pub film_width: f64,
    /// Width of the picture in pixels over that of the profile's, above 0.
    pub picture_width: f64,
}

impl Default for GrainRatios {
    fn default() -> Self {
        Self { iso: 1.0, film_width: 1.0, picture_width: 1.0 }
    }
}

impl GrainRatios {
    /// By how much the diameter of grains in pixels exceeds the calibrated pattern's.
    pub fn size(&self) -> f64 {
        self.iso.powf(0.25) * self.picture_width / self.film_width
    }

    /// By how much σ at a code value exceeds the calibrated one; `read_share` is 0 to 1.
    pub fn sigma(&self, read_share: f64) -> f64 {
        // Multiplied out it is (1 − s)·k + s·k², but here k = 1 gives exactly 1.
        (self.iso * (1.0 + read_share * (self.iso - 1.0))).sqrt()
    }
}

fn slope(response: &Response, code: f64) -> f64 {
    response.slope_at_code((code / 255.0).clamp(0.0, 1.0))
}

/// σ of reading out in a channel, in linear light (255 is full scale): that of the darkest bin.
pub fn read_light(noise: &NoiseProfile, response: &Response, channel: usize) -> f64 {
    let darkest = noise.bins.get(channel).and_then(|bins| bins.first());
    darkest.map_or(0.0, |bin| bin.sigma / slope(response, bin.code))
}

/// The share of reading out in the calibrated variance of a channel at a code value (8-bit
/// scale), 0 to 1.
///
/// In linear light the noise of reading out is the same everywhere, and in the darkest bin it
/// is nearly all there is. So σ_read = σ(darkest) / slope(darkest), brought to the code value
/// by the response's slope there. An upper bound, as some light fell on the darkest bin too.
pub fn read_share(noise: &NoiseProfile, response: &Response, channel: usize, code: f64) -> f64 {
    if channel >= noise.bins.len() {
        return 0.0;
    }
    let read = read_light(noise, response, channel) * slope(response, code);
    let sigma = noise.sigma(channel, code);
    if sigma > 0.0 { (read / sigma).powi(2).min(1.0) } else { 0.0 }
}

/// σ of the grain of a channel at a code value, both on the 8-bit scale: the calibrated one
/// at another film speed.
pub fn sigma(noise: &NoiseProfile, response: &Response, channel: usize, code: f64, ratios: &GrainRatios) -> f64 {
    noise.sigma(channel, code) * ratios.sigma(read_share(noise, response, channel, code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, NoiseBin};
    use proptest::prelude::*;

    /// A sensor whose full scale is 1000 electrons, which it reads with 4 electrons of noise.
    fn sensor() -> (NoiseProfile, Response) {
        let bins: Vec<NoiseBin> = (0..=255)
            .map(|code| {
                let electrons = f64::from(code) / 255.0 * 1000.0;
                NoiseBin { code: f64::from(code), sigma: (electrons + 16.0).sqrt() * 255.0 / 1000.0 }
            })
            .collect();
        let bins = [bins.clone(), bins.clone(), bins];
        let noise = NoiseProfile { bins, channel_correlation: [0.0; 3], neighbour_correlation: [0.0; 2] };
        (noise, Response { curve: Curve::Linear, ..Default::default() })
    }

    #[test]
    fn at_its_own_speed_it_is_the_calibrated_noise() {
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
    fn four_times_the_speed_is_the_sensor_with_a_quarter_of_the_light() {
        let (noise, response) = sensor();
        let faster = GrainRatios { iso: 4.0, ..Default::default() };
        for code in [0.0, 10.0, 128.0, 255.0] {
            // Full scale is 250 electrons now.
            let electrons = code / 255.0 * 250.0;
            let expected = (electrons + 16.0f64).sqrt() * 255.0 / 250.0;
            assert!((sigma(&noise, &response, 0, code, &faster) / expected - 1.0).abs() < 1e-9, "{code}");
        }
        // Worked by hand: in the light √k alone is 2, black goes with k, 4.
        assert_eq!((faster.sigma(0.0), faster.sigma(1.0)), (2.0, 4.0));
        assert!((faster.sigma(0.25) - 7f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_share_of_reading_out_worked_by_hand() {
        let (noise, response) = sensor();
        assert_eq!(read_share(&noise, &response, 0, 0.0), 1.0);
        // At full scale 16 of 1016.
        assert!((read_share(&noise, &response, 0, 255.0) - 16.0 / 1016.0).abs() < 1e-9);
        // sRGB is flatter above: black's noise counts for less there.
        let srgb = Response::default();
        assert!(read_share(&noise, &srgb, 0, 255.0) < 0.02 * read_share(&noise, &response, 0, 255.0));
        assert_eq!(read_share(&noise, &response, 9, 128.0), 0.0);
    }

    #[test]
    fn grains_grow_with_speed_and_smaller_film() {
        let speed = |iso: f64| GrainRatios { iso, ..Default::default() }.size();
        assert_eq!((speed(16.0), speed(1.0 / 16.0)), (2.0, 0.5));
        // Half the film's width enlarges everything on it twice; so does a picture twice as wide.
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
