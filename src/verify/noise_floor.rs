//! Noise floor of the displacement measurement: its result for exact poses.
//!
//! A frame is composited into itself by its own pose. Both pictures get independent noise like the
//! camera's, as two frames at rest have. The remaining displacement is the floor f of the
//! measurement, by noise, lack of texture and resampling. Noise adds to a displacement b in
//! quadrature, so with a measured m
//!
//!   b = √max(m² − f², 0)
//!
//! Both pictures of the pair at rest also contain the frame's own noise, which acts as texture. The
//! floor is therefore rather too low. Not modelled: errors of depth, differences in blur between
//! frames; they remain in b.

use crate::analyse::unit_noise;
use crate::camera::NoiseProfile;
use crate::fit::quantile::nearest_quantile;
use crate::grey_image::GreyImage;
use crate::pixels::WEIGHTS_709;

/// Number of patches that count as one: they overlap by half in both directions.
const OVERLAPPING_PATCHES: f64 = 4.0;

/// Adds noise of the camera, which depends on the seed only.
pub fn with_noise(picture: &GreyImage<f64>, profile: &NoiseProfile, seed: u64) -> GreyImage<f64> {
    let sigma: Vec<f64> = (0..256u32).map(|code| luma_sigma(profile, code.into())).collect();
    let noise = unit_noise(picture.width, picture.height, seed, profile.neighbour_correlation);
    let with = |(value, noise): (&f64, &f32)| value + sigma[value.clamp(0.0, 255.0) as usize] * f64::from(*noise);
    GreyImage { values: picture.values.iter().zip(&noise.values).map(with).collect(), ..*picture }
}

/// σ of luma for equal codes in all channels.
pub fn luma_sigma(profile: &NoiseProfile, code: f64) -> f64 {
    let [r, g, b] = [0, 1, 2].map(|c| WEIGHTS_709[c] * profile.sigma(c, code));
    let [red_green, red_blue, green_blue] = profile.channel_correlation;
    let across = red_green * r * g + red_blue * r * b + green_blue * g * b;
    (r * r + g * g + b * b + 2.0 * across).max(0.0).sqrt()
}

/// Lengths of patches' displacements, px: measured, noise floor, and without the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplacementSummary {
    /// Measured median and 90 % quantile.
    pub measured: (f64, f64),
    /// The floor, median and 90 %. `None` without the camera's
    /// noise, or without patches at rest.
    pub floor: Option<(f64, f64)>,
    /// Without the floor: median and 90 %. As measured if the floor is unknown.
    pub px: (f64, f64),
    /// One standard deviation of the median without the floor.
    pub sigma_px: f64,
}

impl DisplacementSummary {
    /// Summarizes all patches of all pairs, and of the pairs at rest. `None` without patches.
    pub fn of(measured: &mut [f64], at_rest: &mut [f64]) -> Option<Self> {
        let (of_pairs, sigma) = summary(measured)?;
        let Some((floor, floor_sigma)) = summary(at_rest) else {
            return Some(Self { measured: of_pairs, floor: None, px: of_pairs, sigma_px: sigma });
        };
        let square = of_pairs.0.powi(2) - floor.0.powi(2);
        // σ of m² − f².
        let square_sigma = 2.0 * (of_pairs.0 * sigma).hypot(floor.0 * floor_sigma);
        let px = square.max(0.0).sqrt();
        let sigma_px = (square.max(0.0) + square_sigma).sqrt() - px;
        let ninety = (of_pairs.1.powi(2) - floor.1.powi(2)).max(0.0).sqrt().max(px);
        Some(Self { measured: of_pairs, floor: Some(floor), px: (px, ninety), sigma_px })
    }
}

/// Median and 90 %, and one standard deviation of the median by the values of the ranks beside it.
fn summary(values: &mut [f64]) -> Option<((f64, f64), f64)> {
    let count = values.len() as f64;
    let mut at = |share: f64| nearest_quantile(values, share.clamp(0.0, 1.0));
    // The rank of a median has a standard deviation of √n / 2.
    let ranks = 0.5 * (OVERLAPPING_PATCHES / count).sqrt();
    Some(((at(0.5)?, at(0.9)?), 0.5 * (at(0.5 + ranks)? - at(0.5 - ranks)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths of errors of σ 0.3 px along each axis about a displacement.
    fn lengths(count: usize, by_px: f64, seed: u64) -> Vec<f64> {
        let noise = unit_noise(2 * count, 1, seed, [0.0; 2]).values;
        noise.chunks(2).map(|xy| (by_px + 0.3 * f64::from(xy[0])).hypot(0.3 * f64::from(xy[1]))).collect()
    }

    #[test]
    fn floor_removes_the_noise_of_exact_poses_and_keeps_a_displacement() {
        let summary =
            |by_px: f64| DisplacementSummary::of(&mut lengths(800, by_px, 1), &mut lengths(800, 0.0, 2)).unwrap();
        let (exact, moved) = (summary(0.0), summary(1.0));
        // Rayleigh: the median is 1.177 σ.
        assert!((exact.measured.0 - 0.353).abs() < 0.03, "{exact:?}");
        assert!(exact.px.0 < 2.0 * exact.sigma_px && exact.px.0 < 0.15, "{exact:?}");
        assert!((moved.px.0 - 1.0).abs() < 0.05 && moved.px.0 > 2.0 * moved.sigma_px, "{moved:?}");
        assert!(moved.px.1 >= moved.px.0 && moved.px.1 < moved.measured.1, "{moved:?}");
    }

    #[test]
    fn nothing_is_subtracted_for_unknown_noise() {
        let summary = DisplacementSummary::of(&mut lengths(100, 0.0, 1), &mut []).unwrap();
        assert_eq!((summary.px, summary.floor), (summary.measured, None));
        assert_eq!(DisplacementSummary::of(&mut [], &mut [0.3]), None);
    }
}
