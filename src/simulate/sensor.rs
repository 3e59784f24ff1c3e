//! Conversion of linear light to integer code values: response, noise, rounding.
//!
//! σ is defined in code values after the response, where it is observable: a table of sixteen bins
//! for each channel, with its maximum in the mid-tones. The noise is Gaussian. Channels share part
//! of it, and a small kernel spreads it over neighbours without changing its variance. The table's
//! σ is that of integer codes and includes the rounding variance of 1/12; a profile's σ is before
//! rounding, as a calibration estimates it. Near black and white, clipping removes some noise.

use crate::camera::{NoiseBin, NoiseProfile, Response};

use super::random::Random;
use super::render::SimulatedPicture;
use crate::parallel::over_rows;

/// σ of the green channel's integer codes at 8, 24, … 248 for a noise scale of 1.
const GREEN_SIGMA: [f64; 16] = [1.5, 2.0, 2.5, 2.9, 3.2, 3.4, 3.5, 3.5, 3.4, 3.25, 3.05, 2.85, 2.6, 2.35, 2.1, 1.9];
/// The channels' σ relative to green's.
const CHANNEL_SIGMA_FACTORS: [f64; 3] = [1.1, 1.0, 1.25];
/// Variance of rounding to integer code values (Sheppard 1898).
pub(super) const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;

/// A sensor with a known noise model.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    pub response: Response,
    /// Factor on the table of σ; 0 is a noise-free sensor.
    pub noise_scale: f64,
    /// Share of the noise variance that is common to R, G and B: their correlation.
    pub channel_correlation: f64,
    /// Correlation of a pixel with its right and its lower neighbour; at most 0.7.
    pub neighbour_correlation: f64,
    pub seed: u64,
}

impl Sensor {
    /// The centre of a bin on the 8-bit scale.
    fn bin_code(bin: usize) -> f64 {
        16.0 * bin as f64 + 8.0
    }

    /// σ of integer codes, including rounding: interpolated linearly between bin centres, constant
    /// beyond.
    pub fn rounded_sigma(&self, channel: usize, code: f64) -> f64 {
        let at = ((code - 8.0) / 16.0).clamp(0.0, 15.0);
        let (low, high) = (at as usize, (at as usize + 1).min(15));
        let sigma = GREEN_SIGMA[low] + (GREEN_SIGMA[high] - GREEN_SIGMA[low]) * at.fract();
        self.noise_scale * CHANNEL_SIGMA_FACTORS[channel.min(2)] * sigma
    }

    /// σ before rounding.
    pub fn sigma(&self, channel: usize, code: f64) -> f64 {
        (self.rounded_sigma(channel, code).powi(2) - ROUNDING_VARIANCE).max(0.0).sqrt()
    }

    /// σ before rounding: the expected result of a calibration.
    pub fn profile(&self) -> NoiseProfile {
        let bin = |channel, bin| {
            let code = Self::bin_code(bin);
            NoiseBin { code, sigma: self.sigma(channel, code) }
        };
        NoiseProfile {
            example: None,
            bins: [0, 1, 2].map(|channel| (0..16).map(|b| bin(channel, b)).collect()),
            channel_correlation: [self.channel_correlation; 3],
            neighbour_correlation: [self.neighbour_correlation; 2],
        }
    }

    /// The noise-free picture in code values, not rounded; three per pixel. `gain`: factor on the
    /// light. Above white the curve continues linearly, because clipping applies to the noisy
    /// value: saturated pixels have little noise.
    pub fn clean(&self, picture: &SimulatedPicture, gain: f64) -> Vec<f32> {
        self.clean_balanced(picture, [gain; 3])
    }

    /// The noise-free picture with a gain for each colour. All three clip at camera white, before
    /// the response: red and blue are amplified by 1.5 to 2.5 for white, so the sensor is still
    /// saturated where a white balance takes some of that back.
    pub fn clean_balanced(&self, picture: &SimulatedPicture, gains: [f64; 3]) -> Vec<f32> {
        let steepness = self.response.slope_at_code(1.0);
        let encode = |(light, gain): (&f32, f64)| {
            let light = gain * f64::from(*light);
            (255.0 * (self.response.encode(light) + steepness * (light - 1.0).max(0.0))) as f32
        };
        picture.light.iter().flat_map(|light| light.iter().zip(gains)).map(encode).collect()
    }

    /// Adds the noise of one frame to noise-free code values (three per pixel, `width` pixels per
    /// row) and rounds. The noise depends on seed and frame only.
    pub fn sense(&self, clean: &[f32], width: usize, frame: u64, threads: usize) -> Vec<u8> {
        let mut codes = vec![0; clean.len()];
        over_rows(&mut codes, 3 * width, threads, |y, row| {
            let noise = self.noise_row(width, y as u64, frame);
            let clean = clean.get(3 * width * y..).unwrap_or_default();
            for (i, ((out, code), n)) in row.iter_mut().zip(clean).zip(noise).enumerate() {
                let code = f64::from(*code);
                *out = (code + self.sigma(i % 3, code) * n).round().clamp(0.0, 255.0) as u8;
            }
        });
        codes
    }

    /// One row of noise with variance 1, three per pixel.
    fn noise_row(&self, width: usize, y: u64, frame: u64) -> Vec<f64> {
        let [side, middle, _] = kernel(self.neighbour_correlation);
        let mut row = vec![0.0; 3 * width];
        for (weight, y) in [(side, y), (middle, y + 1), (side, y + 2)] {
            let white: Vec<_> = (0..width as u64 + 2).map(|x| self.white(x, y, frame)).collect();
            for (x, three) in white.windows(3).enumerate() {
                for c in 0..3 {
                    row[3 * x + c] += weight * (side * (three[0][c] + three[2][c]) + middle * three[1][c]);
                }
            }
        }
        row
    }

    /// Noise of one pixel, variance 1, independent of all other pixels.
    fn white(&self, x: u64, y: u64, frame: u64) -> [f64; 3] {
        let mut random = Random::new([self.seed ^ 0x006e_6f69_7365, frame, x, y]);
        let ([shared, a], [b, c]) = (random.normals(), random.normals());
        let (common, own) = (self.channel_correlation.sqrt(), (1.0 - self.channel_correlation).sqrt());
        [a, b, c].map(|n| common * shared + own * n)
    }
}

/// The kernel [a, b, a] with 2a² + b² = 1 (unit variance) and 2ab = ρ (correlation of neighbours):
/// 2a⁴ − a² + ρ²/4 = 0.
fn kernel(rho: f64) -> [f64; 3] {
    let a2 = (1.0 - (1.0 - 2.0 * rho * rho).max(0.0).sqrt()) / 4.0;
    let (a, b) = (a2.sqrt(), (1.0 - 2.0 * a2).sqrt());
    [a, b, a]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor() -> Sensor {
        Sensor {
            response: Response::default(),
            noise_scale: 1.0,
            channel_correlation: 0.4,
            neighbour_correlation: 0.5,
            seed: 3,
        }
    }

    #[test]
    fn kernel_keeps_variance_and_has_the_requested_correlation() {
        for rho in [0.0, 0.2, 0.4, 0.7] {
            let [a, b, c] = kernel(rho);
            assert!((a * a + b * b + c * c - 1.0).abs() < 1e-12);
            assert!((a * b + b * c - rho).abs() < 1e-12);
        }
    }

    /// 320×240 of one code, 4 frames: 307,200 values correlated by 0.5 in both directions,
    /// equivalent to about 100,000 independent ones. Their σ is known to 1/√200,000 = 0.22 %, a
    /// correlation to 0.003.
    #[test]
    fn noise_matches_the_sigma_table() {
        let sensor = sensor();
        for code in [40.0f32, 104.0, 200.3] {
            let clean = vec![code; 3 * 320 * 240];
            let (mut square, mut right, mut below, mut red_green, mut n) = ([0.0; 3], 0.0, 0.0, 0.0, 0.0);
            for frame in 0..4 {
                let codes = sensor.sense(&clean, 320, frame, 2);
                let at = |x: usize, y: usize, c: usize| f64::from(codes[3 * (320 * y + x) + c]) - f64::from(code);
                for y in 0..239 {
                    for x in 0..319 {
                        for (c, square) in square.iter_mut().enumerate() {
                            *square += at(x, y, c).powi(2);
                        }
                        right += at(x, y, 1) * at(x + 1, y, 1);
                        below += at(x, y, 1) * at(x, y + 1, 1);
                        red_green += at(x, y, 0) * at(x, y, 1);
                        n += 1.0;
                    }
                }
            }
            for (c, square) in square.iter().enumerate() {
                let sigma = (square / n).sqrt();
                assert!((sigma / sensor.rounded_sigma(c, code.into()) - 1.0).abs() < 0.012, "{code} {c}: {sigma}");
            }
            // Rounding is independent: it lowers the correlation by up to 1/12 over σ².
            assert!((right / square[1] - 0.5).abs() < 0.02, "{}", right / square[1]);
            assert!((below / square[1] - 0.5).abs() < 0.02, "{}", below / square[1]);
            let red_green = red_green / (square[0] * square[1]).sqrt();
            assert!((red_green - 0.4).abs() < 0.02, "{red_green}");
        }
    }
}
