//! Noise of a frame's brightness at each pyramid level, and the correlation that it leaves of two
//! aligned pictures.
//!
//! Two pictures of one signal of variance s², each with noise of variance n² of its own, correlate
//! by s² / (s² + n²) where they are perfectly aligned (the classical attenuation of a correlation,
//! Spearman 1904). The variance v = s² + n² of the aligned points is measured, so that
//!
//!   ρ = √((1 − n₁²/v₁) · (1 − n₂²/v₂))
//!
//! n² is the smaller of two upper bounds:
//!
//! - The camera's noise profile: σ² of luma at the picture's codes, times Σᵢⱼ wᵢ wⱼ ρ(i − j) along
//!   both axes for the weights w of the level's smoothing.
//! - The variance of the flattest blocks of the level, each without its own plane: a wall's noise,
//!   or a plain floor's noise and texture. Without a profile it counts up to `MAX_WITHOUT_PROFILE`.

use crate::camera::{NoiseProfile, correlations, variance_left};
use crate::fit::quantile::upper_quantile;
use crate::grey_image::{GreyImage, gaussian};
use crate::pixels::Pixels;

/// Luma of BT.601, as the levels have it.
const LUMA: [f64; 3] = [0.299, 0.587, 0.114];
/// Pixel stride at which the profile's σ is evaluated.
const STRIDE: u32 = 8;
/// Side of a block, px of the level, and quantile of the blocks' variances that bounds the noise.
const BLOCK: usize = 16;
const FLAT_QUANTILE: f64 = 0.1;
/// Range of unclipped codes.
const UNCLIPPED: (f32, f32) = (4.0, 250.0);
/// Largest noise variance of any level without a profile, codes²: on gravel even the flattest
/// blocks are texture.
const MAX_WITHOUT_PROFILE: f64 = 4.0;
/// Binomial weights of one halving (Burt and Adelson 1983).
const HALVING: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// Noise variance of luma by a profile, codes² of 255, before any smoothing; mean over the
/// picture's codes.
pub fn luma_variance(profile: &NoiseProfile, pixels: &Pixels) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for y in (0..pixels.height).step_by(STRIDE as usize) {
        for x in (0..pixels.width).step_by(STRIDE as usize) {
            let codes = pixels.eight_bits_at(x, y);
            let [r, g, b] = [0, 1, 2].map(|c| LUMA[c] * profile.sigma(c, f64::from(codes[c])));
            let [red_green, red_blue, green_blue] = profile.channel_correlation;
            sum += r * r + g * g + b * b + 2.0 * (red_green * r * g + red_blue * r * b + green_blue * g * b);
            count += 1.0;
        }
    }
    if count > 0.0 { f64::max(sum / count, 0.0) } else { 0.0 }
}

/// Ratio of the noise variance of a level to that of the picture.
pub fn share_kept(profile: &NoiseProfile, level: usize) -> f64 {
    let weights = smoothing(level);
    profile.neighbour_correlation.map(|neighbour| variance_left(&weights, &correlations(neighbour))).iter().product()
}

/// Weights of the smoothing of a level along one axis: a Gaussian for the finest, repeated halvings
/// for the others.
fn smoothing(level: usize) -> Vec<f32> {
    if level == 0 {
        let side = gaussian(1.0);
        return side.iter().skip(1).rev().chain(&side).copied().collect();
    }
    let mut weights = vec![1.0];
    for halving in 0..level {
        let step = 1 << halving;
        let mut wider = vec![0.0; weights.len() + (HALVING.len() - 1) * step];
        for (k, by) in HALVING.iter().enumerate() {
            wider[k * step..].iter_mut().zip(&weights).for_each(|(wider, weight)| *wider += by * weight);
        }
        weights = wider;
    }
    weights
}

/// The smaller of the two upper bounds on a picture's noise variance, codes². 0 where no block is
/// free of clipping.
pub fn variance_bound(by_profile: Option<f64>, picture: &GreyImage) -> f64 {
    flattest_variance(picture).map_or(0.0, |by_blocks| by_profile.unwrap_or(MAX_WITHOUT_PROFILE).min(by_blocks))
}

/// Upper bound on the noise variance of a level, codes², by its flattest blocks. `None` where no
/// block is free of clipping.
fn flattest_variance(picture: &GreyImage) -> Option<f64> {
    let (across, down) = (picture.width / BLOCK, picture.height / BLOCK);
    let blocks = (0..down).flat_map(|y| (0..across).map(move |x| (BLOCK * x, BLOCK * y)));
    let mut residuals: Vec<f64> = blocks.filter_map(|(x, y)| about_its_plane(picture, x, y)).collect();
    upper_quantile(&mut residuals, FLAT_QUANTILE)
}

/// Variance of a block about its least-squares plane. `None` if it may be clipped.
fn about_its_plane(picture: &GreyImage, left: usize, top: usize) -> Option<f64> {
    let middle = 0.5 * (BLOCK as f64 - 1.0);
    let (mut sum, mut squares, mut along, mut down, mut spread) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for y in 0..BLOCK {
        for x in 0..BLOCK {
            let value = picture.values[(top + y) * picture.width + left + x];
            if value < UNCLIPPED.0 || value > UNCLIPPED.1 {
                return None;
            }
            let (value, dx, dy) = (f64::from(value), x as f64 - middle, y as f64 - middle);
            (sum, squares, spread) = (sum + value, squares + value * value, spread + dx * dx);
            (along, down) = (along + value * dx, down + value * dy);
        }
    }
    let count = (BLOCK * BLOCK) as f64;
    // Three parameters of the plane are fitted.
    let left = squares - sum * sum / count - (along * along + down * down) / spread;
    Some((left / (count - 3.0)).max(0.0))
}

/// Expected correlation of two aligned pictures, each given by the variance of its points and the
/// variance of its noise.
pub fn expected_correlation(of: [(f64, f64); 2]) -> f64 {
    of.iter().map(|(variance, noise)| (1.0 - noise / variance.max(1e-12)).max(0.0)).product::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::view::scattered;
    use super::*;
    use crate::camera::NoiseBin;

    fn profile(neighbour: f64) -> NoiseProfile {
        let bins = vec![NoiseBin { code: 128.0, sigma: 3.0 }];
        NoiseProfile {
            example: None,
            bins: [bins.clone(), bins.clone(), bins],
            channel_correlation: [1.0; 3],
            neighbour_correlation: [neighbour; 2],
        }
    }

    /// Sum of four uniform numbers, σ 1.
    fn white(i: u64) -> f32 {
        let bits = scattered(i);
        let sum: u32 = (0..4).map(|k| (bits >> (16 * k)) as u32 & 0xffff).sum();
        (sum as f32 / 65536.0 - 2.0) * 3f32.sqrt()
    }

    #[test]
    fn predicted_noise_of_each_level_matches_smoothed_white_noise() {
        let (width, height) = (512, 512);
        let values = (0..(width * height) as u64).map(|i| 120.0 + 3.0 * white(i)).collect();
        let mut picture = GreyImage { width, height, values };
        let pixels = Pixels::from_u8(8, 8, vec![128; 3 * 64]).unwrap();
        let whole = luma_variance(&profile(0.0), &pixels);
        assert!((whole - 9.0).abs() < 1e-9, "fully correlated channels of σ 3: {whole}");
        let fine = picture.filtered(&gaussian(1.0));
        for level in 0..3 {
            let plane = if level == 0 { &fine } else { &picture };
            let predicted = whole * share_kept(&profile(0.0), level);
            let mean = plane.values.iter().sum::<f32>() / plane.values.len() as f32;
            let variance =
                plane.values.iter().map(|v| f64::from(v - mean).powi(2)).sum::<f64>() / plane.values.len() as f64;
            // At level 2 128² values are worth some 1,500 independent ones: σ 4 %.
            assert!((variance / predicted - 1.0).abs() < 0.1, "{level}: {variance} for {predicted}");
            let flattest = flattest_variance(plane).unwrap();
            assert!(flattest < predicted && flattest > 0.3 * predicted, "{level}: {flattest} for {predicted}");
            picture = picture.halved();
        }
    }

    #[test]
    fn gradient_is_not_counted_as_noise_and_clipped_blocks_are_ignored() {
        let ramp = |by: f32| GreyImage {
            width: 64,
            height: 64,
            values: (0..64 * 64).map(|i| 60.0 + by * (i % 64) as f32).collect(),
        };
        assert!(flattest_variance(&ramp(1.0)).unwrap() < 1e-6);
        assert_eq!(flattest_variance(&GreyImage::uniform(64, 64, 255.0)), None);
    }

    #[test]
    fn expected_correlation_is_signal_by_total_variance() {
        // s² = 9, n² = 4 in both: 9 / 13.
        assert!((expected_correlation([(13.0, 4.0); 2]) - 9.0 / 13.0).abs() < 1e-12);
        assert_eq!(expected_correlation([(4.0, 9.0), (13.0, 4.0)]), 0.0);
        assert_eq!(expected_correlation([(4.0, 0.0); 2]), 1.0);
    }
}
