//! Moments of the noise residue: its strength, correlation and shape.
//!
//! The residue is a channel minus its Gaussian blur of σ = 2 px (as the residue of a denoiser in
//! Lukáš, Fridrich and Goljan 2006). Per channel: standard deviation; correlations at lags of 1 px
//! along rows, columns and the diagonal, and of 2 and 4 px along rows and columns; skewness; excess
//! kurtosis; standard deviation and mean magnitude of the Laplacian. Then the correlations between
//! channels. Sensitive to wrong σ, wrong spatial or colour covariance, and tails.

use super::patches::{PATCH_PX, Planes};
use crate::grey_image::GreyImage;

/// σ of the blur that is subtracted, px.
const BLUR_SIGMA_PX: f64 = 2.0;
/// Half width of the blur's kernel: 4 σ.
const BLUR_REACH_PX: usize = 8;
/// Lags of the correlations, px along rows and columns.
const LAGS_PX: [[usize; 2]; 7] = [[1, 0], [0, 1], [1, 1], [2, 0], [0, 2], [4, 0], [0, 4]];
/// Keeps the correlations of a constant channel finite, squared codes.
const MIN_VARIANCE: f64 = 1e-6;

/// The features of a patch from R, G, B.
pub(super) fn features(rgb: &Planes) -> Vec<f64> {
    let residues = [0, 1, 2].map(|channel: usize| high_pass(&rgb[channel]));
    let mut features = Vec::new();
    for (plane, residue) in rgb.iter().zip(&residues) {
        let moments = Moments::of(residue);
        features.push(moments.variance.sqrt());
        let variance = moments.variance + MIN_VARIANCE;
        features.extend(LAGS_PX.map(|lag| lag_product(residue, lag) / variance));
        features.extend([moments.skewness, moments.excess_kurtosis]);
        let laplacian = laplacian(plane);
        let magnitude = laplacian.iter().map(|v| v.abs()).sum::<f64>() / laplacian.len() as f64;
        features.extend([Moments::of(&laplacian).variance.sqrt(), magnitude]);
    }
    features.extend([[0, 1], [1, 2], [0, 2]].map(|[a, b]: [usize; 2]| correlation(&residues[a], &residues[b])));
    features
}

/// A patch minus its Gaussian blur, row by row. The patch is mirrored about the centres of its
/// outer pixels.
pub(super) fn high_pass(plane: &GreyImage) -> Vec<f64> {
    let kernel = blur_kernel();
    let values: Vec<f64> = plane.values.iter().map(|v| f64::from(*v)).collect();
    let blurred = convolved(&convolved(&values, &kernel, 1), &kernel, PATCH_PX);
    values.iter().zip(blurred).map(|(value, blurred)| value - blurred).collect()
}

fn blur_kernel() -> Vec<f64> {
    let reach = BLUR_REACH_PX as i32;
    let weights: Vec<f64> = (-reach..=reach).map(|i| (-0.5 * (f64::from(i) / BLUR_SIGMA_PX).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

/// Index of a sample beyond a patch's edge, mirrored about the centre of the outer pixel.
fn mirrored(at: isize) -> usize {
    let last = PATCH_PX as isize - 1;
    let at = at.abs();
    (if at > last { 2 * last - at } else { at }) as usize
}

/// A patch convolved along rows (`stride` 1) or columns (`stride` [`PATCH_PX`]).
fn convolved(values: &[f64], kernel: &[f64], stride: usize) -> Vec<f64> {
    let reach = (kernel.len() / 2) as isize;
    (0..values.len())
        .map(|i| {
            let at = i / stride % PATCH_PX;
            let start = i - at * stride;
            let tap = |k: usize| values[start + stride * mirrored(at as isize + k as isize - reach)];
            kernel.iter().enumerate().map(|(k, weight)| weight * tap(k)).sum()
        })
        .collect()
}

fn laplacian(plane: &GreyImage) -> Vec<f64> {
    let at = |x: isize, y: isize| f64::from(plane.values[mirrored(y) * PATCH_PX + mirrored(x)]);
    (0..PATCH_PX * PATCH_PX)
        .map(|i| {
            let (x, y) = ((i % PATCH_PX) as isize, (i / PATCH_PX) as isize);
            at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) - 4.0 * at(x, y)
        })
        .collect()
}

/// Central moments of values.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Moments {
    variance: f64,
    skewness: f64,
    excess_kurtosis: f64,
}

impl Moments {
    fn of(values: &[f64]) -> Self {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let moment = |power: i32| values.iter().map(|v| (v - mean).powi(power)).sum::<f64>() / count;
        let variance = moment(2);
        let scale = variance + MIN_VARIANCE;
        Self { variance, skewness: moment(3) / scale.powf(1.5), excess_kurtosis: moment(4) / (scale * scale) - 3.0 }
    }
}

/// Mean product of pixels of a patch that are `lag` apart.
fn lag_product(residue: &[f64], [right, down]: [usize; 2]) -> f64 {
    let (columns, rows) = (PATCH_PX - right, PATCH_PX - down);
    let row_sum = |y: usize| {
        let from = &residue[y * PATCH_PX..][..columns];
        let to = &residue[(y + down) * PATCH_PX + right..][..columns];
        from.iter().zip(to).map(|(a, b)| a * b).sum::<f64>()
    };
    (0..rows).map(row_sum).sum::<f64>() / (columns * rows) as f64
}

/// Correlation of two lists of values; 0 if either is constant.
pub(super) fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len() as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / count, b.iter().sum::<f64>() / count);
    let product = |x: &[f64], mean_x: f64, y: &[f64], mean_y: f64| {
        x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>()
    };
    let norm = (product(a, mean_a, a, mean_a) * product(b, mean_b, b, mean_b)).sqrt();
    if norm > 1e-9 * count { product(a, mean_a, b, mean_b) / norm } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(value: impl Fn(usize, usize) -> f32) -> GreyImage {
        GreyImage::from_fn(PATCH_PX, PATCH_PX, value)
    }

    #[test]
    fn moments_of_three_values_match_hand_calculation() {
        // 0, 0, 3: mean 1, variance 2, third moment 2, fourth 6.
        let moments = Moments::of(&[0.0, 0.0, 3.0]);
        assert!((moments.variance - 2.0).abs() < 1e-12);
        assert!((moments.skewness - 2.0 / 8.0_f64.sqrt()).abs() < 1e-5, "{moments:?}");
        assert!((moments.excess_kurtosis + 1.5).abs() < 1e-5, "{moments:?}");
    }

    #[test]
    fn checkerboard_has_its_correlations_and_laplacian() {
        let board = plane(|x, y| if (x + y) % 2 == 0 { 110.0 } else { 90.0 });
        let values = features(&[board.clone(), board.clone(), board]);
        // σ; lags 1 → −1, 2 and 4 and the diagonal → 1; kurtosis of ±10 is 1; |Δ| = 80.
        let expected = [10.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, -2.0, 80.0, 80.0];
        for (values, expected) in values.iter().zip(expected) {
            assert!((values - expected).abs() < 0.02 * (1.0 + f64::abs(expected)), "{values} {expected}");
        }
        assert_eq!(values.len(), 3 * 12 + 3);
        assert!(values[36..].iter().all(|r| (r - 1.0).abs() < 1e-9));
    }

    #[test]
    fn blur_leaves_a_plane_of_constant_slope_but_for_the_edges() {
        let ramp = high_pass(&plane(|x, y| 3.0 * x as f32 + 2.0 * y as f32));
        assert!(ramp[16 * PATCH_PX + 16].abs() < 1e-9 && ramp[0].abs() > 1.0);
        assert!(high_pass(&plane(|_, _| 200.0)).iter().all(|v| v.abs() < 1e-9));
    }

    #[test]
    fn features_of_a_constant_patch_are_finite() {
        let flat = plane(|_, _| 7.0);
        assert!(features(&[flat.clone(), flat.clone(), flat]).iter().all(|f| f.is_finite()));
    }
}
