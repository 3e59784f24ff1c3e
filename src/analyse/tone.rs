//! Whether the camera's response is the one that was assumed: by how surfaces of different codes
//! follow one change of light.
//!
//! Where a camera changes its exposure, the light of everything that two frames show changes by one
//! factor. Decoded by the right response, dark and bright surfaces tell the same logarithm of it.
//! By a wrong one each code has a slope of its own,
//!
//!   r(code) = Δ ln L(code) / Δ ln L(middle codes),
//!
//! which is 1 everywhere for the right one (the idea of Mitsunaga and Nayar 1999, without their
//! polynomial). A constant exponent cancels: sRGB and a camera that is a power of it look alike. So
//! this is advice, and nothing follows from it.
//!
//! Below code 24 black level and noise decide, above 200 single channels that clip: neither is
//! judged.

use serde::{Deserialize, Serialize};

use super::robust::scatter;

/// Borders of the bands, codes of 255.
const BORDERS: [f32; 7] = [24.0, 48.0, 72.0, 104.0, 136.0, 168.0, 200.0];
const BANDS: usize = BORDERS.len() - 1;
/// The bands against which the others are compared.
const MIDDLE: [usize; 2] = [2, 3];
/// Light must change by so much between two frames, ln.
const LEAST_CHANGE: f64 = 0.2;
/// Points of a pair in a band, and frames for a band, that say something; bands that do, besides
/// the middle.
const LEAST_POINTS: usize = 40;
const LEAST_FRAMES: usize = 6;
const LEAST_BANDS: usize = 2;
/// Responses that differ by less are the same: what simulated recordings with the right response
/// err by is half of it.
const SAME: f64 = 0.15;
/// And by less than so many σ.
const SURE: f64 = 3.0;

/// What a pair of frames says of one band.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct ToneSample {
    band: usize,
    /// The later frame.
    frame: usize,
    /// Its change of light by the pair's.
    slope: f64,
}

/// How codes of a band follow light, by how the middle ones do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Band {
    /// Codes of 255.
    pub from: f32,
    pub to: f32,
    pub slope: f64,
    pub sigma: f64,
}

impl Band {
    /// Whether it is no accident that it is not 1.
    pub fn differs(&self) -> bool {
        let off = (self.slope - 1.0).abs();
        off > SAME && off > SURE * self.sigma
    }
}

/// Of points that two frames show: their mean codes, and the ratio of their light by that of the
/// whole pair, ln, for each colour.
pub fn of_pair(frame: usize, points: impl Iterator<Item = ([f32; 3], [f64; 3])>, whole: [f64; 3]) -> Vec<ToneSample> {
    if whole.iter().all(|ln| ln.abs() < LEAST_CHANGE) {
        return Vec::new();
    }
    let mut slopes: [Vec<f64>; BANDS] = Default::default();
    for (codes, ratio) in points {
        for c in (0..3).filter(|c| whole[*c].abs() >= LEAST_CHANGE) {
            if let Some(band) = band_of(codes[c]) {
                slopes[band].push(ratio[c] / whole[c]);
            }
        }
    }
    let said = slopes.iter_mut().enumerate().filter(|(_, slopes)| slopes.len() >= LEAST_POINTS);
    said.map(|(band, slopes)| ToneSample { band, frame, slope: scatter(slopes).0 }).collect()
}

fn band_of(code: f32) -> Option<usize> {
    (0..BANDS).find(|band| code >= BORDERS[*band] && code < BORDERS[band + 1])
}

/// The bands that say something, in order, or why none does.
pub fn bands(said: &[ToneSample]) -> Result<Vec<Band>, String> {
    let of = |band: usize| -> Option<(f64, f64)> {
        let mut slopes: Vec<f64> = said.iter().filter(|toned| toned.band == band).map(|toned| toned.slope).collect();
        let mut frames: Vec<usize> = said.iter().filter(|toned| toned.band == band).map(|toned| toned.frame).collect();
        frames.sort_unstable();
        frames.dedup();
        // Pairs with one frame in common are not independent.
        let (middle, spread) = scatter(&mut slopes);
        (frames.len() >= LEAST_FRAMES).then(|| (middle, 1.2533 * spread / (frames.len() as f64).sqrt()))
    };
    let middle: Vec<f64> = MIDDLE.iter().filter_map(|band| of(*band)).map(|(slope, _)| slope).collect();
    let whole = middle.iter().sum::<f64>() / middle.len().max(1) as f64;
    if middle.is_empty() || whole <= 0.0 {
        return Err("too few frames differ in light, or none shows middle codes in both".to_owned());
    }
    let band = |band: usize| {
        let (slope, sigma) = of(band)?;
        Some(Band { from: BORDERS[band], to: BORDERS[band + 1], slope: slope / whole, sigma: sigma / whole })
    };
    let found: Vec<Band> = (0..BANDS).filter_map(band).collect();
    if found.len() < middle.len() + LEAST_BANDS {
        return Err("too few codes are seen in frames that differ in light".to_owned());
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, Response};

    /// Grey surfaces seen by a camera of one response in pairs of frames that differ in light, told
    /// by another response.
    fn told(camera: &Response, assumed: &Response, changes: &[f64]) -> Vec<ToneSample> {
        let code = |light: f64| (255.0 * camera.encode(light)).round() as f32;
        let light = |code: f32| assumed.decode(f64::from(code) / 255.0).ln();
        let mut all = Vec::new();
        for (frame, change) in changes.iter().enumerate() {
            let seen: Vec<(f32, f32)> = (1..4000)
                .map(|k| f64::from(k) / 4000.0)
                .map(|l| (code(l), code(l * change.exp())))
                .filter(|(a, b)| *a > 15.0 && *b > 15.0 && *a < 240.0 && *b < 240.0)
                .collect();
            let mut ratios: Vec<f64> = seen.iter().map(|(a, b)| light(*b) - light(*a)).collect();
            let whole = scatter(&mut ratios).0;
            let points = seen.iter().map(|(a, b)| ([0.5 * (a + b); 3], [light(*b) - light(*a); 3]));
            all.extend(of_pair(frame, points, [whole; 3]));
        }
        all
    }

    const CHANGES: [f64; 8] = [0.3, -0.4, 0.5, 0.25, -0.6, 0.35, -0.3, 0.45];

    #[test]
    fn the_right_response_has_one_slope_and_so_has_its_power() {
        let srgb = Response::default();
        let gamma = |gamma: f64| Response { curve: Curve::Gamma, gamma };
        for (camera, assumed) in [(&srgb, &srgb), (&gamma(2.2), &gamma(1.5))] {
            let found = bands(&told(camera, assumed, &CHANGES)).unwrap();
            assert_eq!(found.len(), BANDS);
            assert!(found.iter().all(|band| (band.slope - 1.0).abs() < 0.06 && !band.differs()), "{found:?}");
        }
    }

    #[test]
    fn another_response_is_told_by_its_dark_codes() {
        let linear = Response { curve: Curve::Linear, ..Response::default() };
        // ln of sRGB's light by that of the code: 2.4·c/(c + 0.055), 1.73 about code 36 and 2.11
        // over the middle bands. Light that is taken for the code changes by the inverse: 1.22
        // times as much in the dark, and half as much as it does in truth.
        let found = bands(&told(&Response::default(), &linear, &CHANGES.map(|ln| 2.0 * ln))).unwrap();
        assert!((found[0].slope - 1.22).abs() < 0.03 && found[0].differs(), "{found:?}");
        assert!(!found[2].differs() && !found[5].differs(), "{found:?}");
    }

    #[test]
    fn steady_light_and_few_frames_say_nothing() {
        let srgb = Response::default();
        assert!(bands(&told(&srgb, &srgb, &[0.1; 20])).is_err());
        assert!(bands(&told(&srgb, &srgb, &CHANGES[..4])).is_err());
        assert!(bands(&[]).is_err());
    }
}
