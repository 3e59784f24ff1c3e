//! Spatially correlated noise, and Gaussian-weighted local means.

use super::random::Random;

/// Standard normal numbers, one per pixel, row by row: white noise filtered with a Gaussian of
/// `sigma_px`, whose squared weights sum to 1. Two numbers d px apart along an axis correlate by
/// exp(−d² / 4σ²), the autocorrelation of the Gaussian.
pub fn correlated_noise(keys: [u64; 3], width: usize, height: usize, sigma_px: f64) -> Vec<f64> {
    let weights = weights(sigma_px);
    let across = width + weights.len() - 1;
    let down = height + weights.len() - 1;
    let white = |i: usize| Random::new([keys[0], keys[1], keys[2], i as u64]).normals()[0];
    let white: Vec<f64> = (0..across * down).map(white).collect();
    let sum = |values: &[f64], at: usize, step: usize| {
        weights.iter().enumerate().map(|(k, weight)| weight * values[at + k * step]).sum::<f64>()
    };
    let rows: Vec<f64> = (0..width * down).map(|i| sum(&white, i / width * across + i % width, 1)).collect();
    (0..width * height).map(|i| sum(&rows, i, width)).collect()
}

/// Local mean of the valid values around each pixel, under a Gaussian of `sigma_px`; `None` stays
/// `None`.
pub fn gaussian_mean(values: &[Option<f64>], width: usize, sigma_px: f64) -> Vec<Option<f64>> {
    let weights = weights(sigma_px);
    let reach = weights.len() / 2;
    // Sums of weights · values and of weights, along rows, then along columns.
    let weighted_sum = |pairs: &[[f64; 2]], place: usize, count: usize, step: usize, i: usize| {
        let inside = (0..weights.len()).filter(|k| (place + k).checked_sub(reach).is_some_and(|at| at < count));
        inside.fold([0.0; 2], |[sum, whole], k| {
            let [value, weight] = pairs[i + k * step - reach * step];
            [sum + weights[k] * value, whole + weights[k] * weight]
        })
    };
    let pairs: Vec<[f64; 2]> = values.iter().map(|value| value.map_or([0.0; 2], |value| [value, 1.0])).collect();
    let rows: Vec<[f64; 2]> = (0..values.len()).map(|i| weighted_sum(&pairs, i % width, width, 1, i)).collect();
    let height = values.len() / width.max(1);
    let mean = |i: usize| {
        let [sum, whole] = weighted_sum(&rows, i / width, height, width, i);
        values[i].map(|_| sum / whole)
    };
    (0..values.len()).map(mean).collect()
}

/// Gaussian weights up to 3σ.
fn weights(sigma_px: f64) -> Vec<f64> {
    let reach = (3.0 * sigma_px).ceil() as i64;
    // At σ = 0 the kernel is the pixel itself.
    let weight = |k: i64| if k == 0 { 1.0 } else { (-0.5 * (k as f64 / sigma_px).powi(2)).exp() };
    let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
    let whole = weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
    weights.into_iter().map(|weight| weight / whole).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_documented_autocorrelation() {
        let (width, height) = (300, 200);
        for sigma in [0.0, 0.4, 1.8] {
            let values = correlated_noise([3, 1, 4], width, height, sigma);
            let mean = |of: &dyn Fn(usize) -> f64, step: usize| {
                let places: Vec<usize> = (0..width * (height - 10)).filter(|i| i % width + step < width).collect();
                places.iter().map(|i| of(*i)).sum::<f64>() / places.len() as f64
            };
            assert!(mean(&|i| values[i], 0).abs() < 0.08);
            // About 57 000 numbers, correlated over 40 at σ = 1.8: five standard errors are 0.13.
            assert!((mean(&|i| values[i] * values[i], 0) - 1.0).abs() < 0.13, "{sigma}");
            for apart in [1, 2, 4] {
                let expected = if sigma == 0.0 { 0.0 } else { (-0.25 * (apart as f64 / sigma).powi(2)).exp() };
                let beside = mean(&|i| values[i] * values[i + apart], apart);
                let below = mean(&|i| values[i] * values[i + apart * width], 0);
                // A narrow Gaussian sampled at whole pixels deviates from the formula.
                assert!(
                    (beside - expected).abs() < 0.13 && (below - expected).abs() < 0.13,
                    "{sigma} {apart} {beside}"
                );
            }
        }
        assert_eq!(weights(0.0), [1.0]);
        assert!(correlated_noise([3, 1, 5], 4, 4, 1.0) != correlated_noise([3, 1, 4], 4, 4, 1.0), "keys count");
    }

    #[test]
    fn gaussian_mean_ignores_invalid_values() {
        let width = 20;
        let stripe: Vec<Option<f64>> = (0..width * 12)
            .map(|i| match i % width {
                10 => Some(1.0),
                15.. => None,
                _ => Some(0.0),
            })
            .collect();
        assert_eq!(gaussian_mean(&stripe, width, 0.0), stripe);
        let mean = gaussian_mean(&stripe, width, 1.5);
        assert!((0..mean.len()).all(|i| mean[i].is_some() == (i % width < 15)));
        // A column under a Gaussian: its maximum is 1 / (σ √2π) = 0.266, its neighbour smaller by
        // exp(−1 / 2σ²).
        for row in [0, 6, 11] {
            let at = |x: usize| mean[row * width + x].unwrap();
            assert!((at(10) - 0.266).abs() < 0.004, "{}", at(10));
            assert!((at(9) / at(10) - 0.801).abs() < 0.004);
        }
        // 3 px from the invalid values, 1 − Q(2.5 / 1.5) = 0.952 of the weights remain; 2 px from
        // the stripe the Gaussian is 0.411.
        assert!((mean[6 * width + 12].unwrap() / (0.266 * 0.411) - 1.0 / 0.952).abs() < 0.03);
        assert_eq!(mean[6 * width].unwrap(), 0.0);
    }
}
