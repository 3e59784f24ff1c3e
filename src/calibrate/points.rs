//! σ at single intensities: merges close ones, and extends them to a curve by the present profile.

use super::bins::chi_square_interval;
use super::noise::round4;
use crate::camera::{NoiseBin, NoiseProfile};

/// Closer points are merged, 8-bit codes.
const MERGE_DISTANCE_CODES: f64 = 8.0;

/// σ at an intensity, 8-bit codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoisePoint {
    pub code: f64,
    pub sigma: f64,
    /// 95 % confidence interval (χ²).
    pub sigma_ci95: [f64; 2],
    pub independent_count: f64,
}

/// Ratio of the points' σ to that of a profile's channel: root mean square, weighted by the number
/// of independent samples. `None` without points.
pub fn sigma_over_profile(points: &[NoisePoint], profile: &NoiseProfile, channel: usize) -> Option<f64> {
    let all: f64 = points.iter().map(|point| point.independent_count).sum();
    let square = |point: &NoisePoint| (point.sigma / profile.sigma(channel, point.code).max(1e-3)).powi(2);
    let sum: f64 = points.iter().map(|point| point.independent_count * square(point)).sum();
    (all > 0.0).then(|| (sum / all).sqrt())
}

/// Sorts points by code and merges close ones.
pub(super) fn merge_close(mut points: Vec<NoisePoint>) -> Vec<NoisePoint> {
    points.sort_by(|a, b| a.code.total_cmp(&b.code));
    let mut out: Vec<NoisePoint> = Vec::new();
    for point in points {
        match out.last_mut() {
            Some(last) if point.code - last.code < MERGE_DISTANCE_CODES => {
                let total = last.independent_count + point.independent_count;
                let mean = |a: f64, b: f64| (a * last.independent_count + b * point.independent_count) / total;
                let (code, variance) = (mean(last.code, point.code), mean(last.sigma.powi(2), point.sigma.powi(2)));
                let sigma = variance.sqrt();
                // The interval of chance, extended to contain both points.
                let chance = chi_square_interval(total).unwrap_or([0.0, 2.0]).map(|factor| sigma * factor.sqrt());
                let sigma_ci95 =
                    [chance[0].min(last.sigma).min(point.sigma), chance[1].max(last.sigma).max(point.sigma)];
                *last = NoisePoint { code, sigma, sigma_ci95, independent_count: total };
            }
            _ => out.push(point),
        }
    }
    out
}

/// A channel's bins: the points, and the present profile beyond and between them, scaled to pass
/// through them.
pub(super) fn extend_by_profile(points: &[NoisePoint], present: Option<(&NoiseProfile, usize)>) -> Vec<NoiseBin> {
    let bin = |code: f64, sigma: f64| NoiseBin { code: round4(code), sigma: round4(sigma) };
    let mut bins: Vec<NoiseBin> = points.iter().map(|point| bin(point.code, point.sigma)).collect();
    if let Some((present, channel)) = present {
        let ratio = |point: &NoisePoint| point.sigma / present.sigma(channel, point.code).max(1e-3);
        for of_present in &present.bins[channel] {
            let after = points.partition_point(|point| point.code <= of_present.code);
            let (below, above) = (points.get(after.wrapping_sub(1)), points.get(after));
            if [below, above]
                .into_iter()
                .flatten()
                .any(|point| (point.code - of_present.code).abs() < MERGE_DISTANCE_CODES)
            {
                continue;
            }
            let ratio = match (below, above) {
                (Some(a), Some(b)) => {
                    let share = (of_present.code - a.code) / (b.code - a.code);
                    ratio(a) + share * (ratio(b) - ratio(a))
                }
                (Some(only), None) | (None, Some(only)) => ratio(only),
                (None, None) => 1.0,
            };
            bins.push(bin(of_present.code, of_present.sigma * ratio));
        }
    }
    bins.sort_by(|a, b| a.code.total_cmp(&b.code));
    bins
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(code: f64, sigma: f64) -> NoisePoint {
        NoisePoint { code, sigma, sigma_ci95: [0.9 * sigma, 1.1 * sigma], independent_count: 500.0 }
    }

    #[test]
    fn profile_beyond_the_points_is_scaled() {
        let present =
            [0.0, 50.0, 100.0, 150.0, 200.0].map(|code| NoiseBin { code, sigma: 1.0 + code / 100.0 }).to_vec();
        let present = NoiseProfile {
            example: None,
            bins: [present.clone(), present.clone(), present],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        // The profile has 1.5 at code 50, where 3 is measured: ratio 2. It has 2.5 at 150, where
        // 2.5 is measured: ratio 1. The ratio is 1.5 halfway.
        let bins = extend_by_profile(&[point(50.0, 3.0), point(150.0, 2.5)], Some((&present, 1)));
        let expected = [(0.0, 2.0), (50.0, 3.0), (100.0, 3.0), (150.0, 2.5), (200.0, 3.0)];
        assert_eq!(bins.iter().map(|b| (b.code, b.sigma)).collect::<Vec<_>>(), expected);
        assert_eq!(extend_by_profile(&[point(50.0, 3.0)], None), [NoiseBin { code: 50.0, sigma: 3.0 }]);
    }

    #[test]
    fn ratio_to_a_profile_is_the_weighted_root_mean_square() {
        let bins = vec![NoiseBin { code: 0.0, sigma: 2.0 }, NoiseBin { code: 100.0, sigma: 4.0 }];
        let profile = NoiseProfile {
            example: None,
            bins: [bins.clone(), bins.clone(), bins],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        // The profile has 3 at code 50: ratio 1. At 100 the ratio is 0.5, with three times the
        // samples: √((1 + 3/4) / 4).
        let often = NoisePoint { independent_count: 1500.0, ..point(100.0, 2.0) };
        let ratio = sigma_over_profile(&[point(50.0, 3.0), often], &profile, 2).unwrap();
        assert!((ratio - 0.4375f64.sqrt()).abs() < 1e-12, "{ratio}");
        assert_eq!(sigma_over_profile(&[], &profile, 0), None);
    }

    #[test]
    fn close_points_are_merged() {
        let all = merge_close(vec![point(90.0, 1.0), point(20.0, 2.0), point(24.0, 3.0)]);
        assert_eq!(all.len(), 2);
        assert!((all[0].code - 22.0).abs() < 1e-12 && (all[0].sigma - 6.5f64.sqrt()).abs() < 1e-12, "{all:?}");
        assert!(all[0].sigma_ci95[0] <= 2.0 && all[0].sigma_ci95[1] >= 3.0 && all[0].independent_count == 1000.0);
    }
}
