//! Checks the assumed response of the camera by exposure changes.
//!
//! When a camera changes its exposure, all light changes by one factor. Decoded by the right
//! response, dark and bright surfaces have the same log ratio. With a wrong response each code has
//! its own slope,
//!
//!   r(code) = Δ ln L(code) / Δ ln L(middle codes),
//!
//! which is 1 everywhere for the right one (the idea of Mitsunaga and Nayar 1999, without their
//! polynomial). A constant exponent cancels: sRGB and a power of it cannot be distinguished.
//! Therefore the result is advice only and is not applied.
//!
//! Codes below 24, where black level and noise dominate, and above 200, where single channels clip,
//! are not used.

use crate::fit::quantile::{median_and_sigma, upper_median_in_place};
use serde::{Deserialize, Serialize};

/// Limits of the bands, codes of 255.
const BAND_LIMITS: [f32; 7] = [24.0, 48.0, 72.0, 104.0, 136.0, 168.0, 200.0];
const BANDS: usize = BAND_LIMITS.len() - 1;
/// The reference bands.
const MIDDLE_BANDS: [usize; 2] = [2, 3];
/// Smallest change of light between two frames, ln.
const MIN_CHANGE_LN: f64 = 0.2;
/// Smallest number of a pair's points in a band, of a band's frames, and of bands besides the
/// middle ones.
const MIN_POINTS: usize = 40;
const MIN_FRAMES: usize = 6;
const MIN_OTHER_BANDS: usize = 2;
/// Largest deviation of a slope from 1 for the assumed response: twice the error of simulated
/// recordings with the right response.
const MAX_DEVIATION: f64 = 0.15;
/// Deviations within this number of σ are not significant.
const SIGNIFICANT_SIGMAS: f64 = 3.0;

/// Slope of one band by a pair of frames.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct ToneSample {
    band: usize,
    /// The later frame.
    frame: usize,
    /// Log ratio of the band by that of the pair.
    slope: f64,
}

/// Slope of a band by that of the middle bands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToneBand {
    /// Codes of 255.
    pub from: f32,
    pub to: f32,
    pub slope: f64,
    pub sigma: f64,
}

impl ToneBand {
    /// True if the slope differs significantly from 1.
    pub fn differs(&self) -> bool {
        let off = (self.slope - 1.0).abs();
        off > MAX_DEVIATION && off > SIGNIFICANT_SIGMAS * self.sigma
    }
}

/// Slopes by the points of a pair of frames: their mean codes and log ratios by channel. `whole`:
/// log ratios of the pair.
pub fn of_pair(frame: usize, points: impl Iterator<Item = ([f32; 3], [f64; 3])>, whole: [f64; 3]) -> Vec<ToneSample> {
    if whole.iter().all(|ln| ln.abs() < MIN_CHANGE_LN) {
        return Vec::new();
    }
    let mut slopes: [Vec<f64>; BANDS] = Default::default();
    for (codes, ratio) in points {
        for c in (0..3).filter(|c| whole[*c].abs() >= MIN_CHANGE_LN) {
            if let Some(band) = band_of(codes[c]) {
                slopes[band].push(ratio[c] / whole[c]);
            }
        }
    }
    let samples = slopes.iter_mut().enumerate().filter(|(_, slopes)| slopes.len() >= MIN_POINTS);
    let slope = |(band, slopes): (usize, &mut Vec<f64>)| {
        Some(ToneSample { band, frame, slope: upper_median_in_place(slopes)? })
    };
    samples.filter_map(slope).collect()
}

fn band_of(code: f32) -> Option<usize> {
    (0..BANDS).find(|band| code >= BAND_LIMITS[*band] && code < BAND_LIMITS[band + 1])
}

/// The bands with enough samples, in order, or the reason for which there are none.
pub fn bands(samples: &[ToneSample]) -> Result<Vec<ToneBand>, String> {
    let band_slope = |band: usize| -> Option<(f64, f64)> {
        let slopes = samples.iter().filter(|toned| toned.band == band).map(|toned| toned.slope);
        let mut frames: Vec<usize> =
            samples.iter().filter(|toned| toned.band == band).map(|toned| toned.frame).collect();
        frames.sort_unstable();
        frames.dedup();
        // Pairs with one frame in common are not independent.
        let (middle, spread) = median_and_sigma(slopes);
        (frames.len() >= MIN_FRAMES).then(|| (middle, 1.2533 * spread / (frames.len() as f64).sqrt()))
    };
    let middle: Vec<f64> = MIDDLE_BANDS.iter().filter_map(|band| band_slope(*band)).map(|(slope, _)| slope).collect();
    let whole = middle.iter().sum::<f64>() / middle.len().max(1) as f64;
    if middle.is_empty() || whole <= 0.0 {
        return Err("too few frames differ in light, or none shows middle codes in both".to_owned());
    }
    let band = |band: usize| {
        let (slope, sigma) = band_slope(band)?;
        Some(ToneBand {
            from: BAND_LIMITS[band],
            to: BAND_LIMITS[band + 1],
            slope: slope / whole,
            sigma: sigma / whole,
        })
    };
    let tone_bands: Vec<ToneBand> = (0..BANDS).filter_map(band).collect();
    if tone_bands.len() < middle.len() + MIN_OTHER_BANDS {
        return Err("too few codes are seen in frames that differ in light".to_owned());
    }
    Ok(tone_bands)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, Response};
    use crate::fit::quantile::upper_median;

    /// Grey surfaces in pairs of frames with different light, encoded by one response and decoded
    /// by another.
    fn samples(camera: &Response, assumed: &Response, changes: &[f64]) -> Vec<ToneSample> {
        let code = |light: f64| (255.0 * camera.encode(light)).round() as f32;
        let light = |code: f32| assumed.decode(f64::from(code) / 255.0).ln();
        let mut all = Vec::new();
        for (frame, change) in changes.iter().enumerate() {
            let code_pairs: Vec<(f32, f32)> = (1..4000)
                .map(|k| f64::from(k) / 4000.0)
                .map(|l| (code(l), code(l * change.exp())))
                .filter(|(a, b)| *a > 15.0 && *b > 15.0 && *a < 240.0 && *b < 240.0)
                .collect();
            let whole = upper_median(code_pairs.iter().map(|(a, b)| light(*b) - light(*a))).unwrap();
            let points = code_pairs.iter().map(|(a, b)| ([0.5 * (a + b); 3], [light(*b) - light(*a); 3]));
            all.extend(of_pair(frame, points, [whole; 3]));
        }
        all
    }

    const CHANGES: [f64; 8] = [0.3, -0.4, 0.5, 0.25, -0.6, 0.35, -0.3, 0.45];

    #[test]
    fn right_response_and_its_powers_have_a_slope_of_one() {
        let srgb = Response::default();
        let gamma = |gamma: f64| Response { curve: Curve::Gamma, gamma, ..Response::default() };
        for (camera, assumed) in [(&srgb, &srgb), (&gamma(2.2), &gamma(1.5))] {
            let bands = bands(&samples(camera, assumed, &CHANGES)).unwrap();
            assert_eq!(bands.len(), BANDS);
            assert!(bands.iter().all(|band| (band.slope - 1.0).abs() < 0.06 && !band.differs()), "{bands:?}");
        }
    }

    #[test]
    fn wrong_response_differs_in_dark_codes() {
        let linear = Response { curve: Curve::Linear, ..Response::default() };
        // ln of sRGB's light by that of the code: 2.4·c/(c + 0.055), 1.73 about code 36 and 2.11
        // over the middle bands. Light that is taken for the code changes by the inverse: 1.22
        // times as much in the dark, and half as much as it does in truth.
        let bands = bands(&samples(&Response::default(), &linear, &CHANGES.map(|ln| 2.0 * ln))).unwrap();
        assert!((bands[0].slope - 1.22).abs() < 0.03 && bands[0].differs(), "{bands:?}");
        assert!(!bands[2].differs() && !bands[5].differs(), "{bands:?}");
    }

    #[test]
    fn steady_light_and_few_frames_have_no_bands() {
        let srgb = Response::default();
        assert!(bands(&samples(&srgb, &srgb, &[0.1; 20])).is_err());
        assert!(bands(&samples(&srgb, &srgb, &CHANGES[..4])).is_err());
        assert!(bands(&[]).is_err());
    }
}
