//! The aperture's image at a resolution, for a slice: its weights, and the noise that remains.

use crate::camera::Aperture;

/// Halvings of the resolution.
pub const LEVELS: usize = 4;
/// Radii up to which each resolution is used, px.
const UP_TO_PX: [f64; LEVELS] = [2.5, 8.5, 18.0, 38.0];
/// Half sides of kernels, in pixels of their resolution.
pub const HALVES: [i32; 6] = [1, 2, 4, 6, 9, 13];
/// Number of points of the aperture from which a kernel is made.
const POINTS: u32 = 4096;
/// `(2·13 + 1)²`, rounded up to a multiple of four.
pub const MAX_WEIGHTS: usize = 732;

/// The opening's image at a resolution.
#[derive(Clone, Debug)]
pub struct Kernel {
    pub level: usize,
    /// Index into `HALVES`.
    pub class: usize,
    /// (2·half + 1)² pixels, sum 1.
    pub weights: Vec<f32>,
}

impl Kernel {
    /// `circle_px`: the width (signed), not 0.
    pub fn new(aperture: &Aperture, circle_px: f64) -> Self {
        let radius = 0.5 * circle_px.abs();
        let level = level_of(radius);
        let texel = f64::from(1u32 << level);
        let target_variance = (radius / texel).powi(2) * aperture.variance();
        let added_variance = added_variance(level);
        let points: Vec<[f64; 2]> = (0..POINTS).map(|i| aperture.sequence(i)).collect();
        let (mut low, mut high) = (0.0, radius / texel + 1.0);
        let mut weights = Vec::new();
        let mut class = 0;
        for _ in 0..24 {
            let r = 0.5 * (low + high);
            class = HALVES.iter().position(|&h| f64::from(h) >= r).unwrap_or(HALVES.len() - 1);
            weights = splat(&points, r * circle_px.signum(), HALVES[class]);
            if variance(&weights, HALVES[class]) + added_variance < target_variance { low = r } else { high = r }
        }
        Self { level, class, weights: weights.iter().map(|w| *w as f32).collect() }
    }

    /// Remaining noise variance, Σ w w' ρ over the picture's pixels, whose neighbours have these
    /// correlations.
    fn noise_left(&self, correlations: &[[f64; 3]; 2]) -> f64 {
        let side = (2 * HALVES[self.class] + 1) as usize;
        let rows: Vec<&[f32]> = self.weights.chunks(side).collect();
        let weight_product = |x: usize, y: usize| -> f64 {
            let of_rows = |(a, b): (&&[f32], &&[f32])| -> f64 {
                // To the right and to the left: unless x or y is 0, these are different pairs.
                let right = a.iter().zip(b.iter().skip(x)).map(|(a, b)| f64::from(a * b)).sum::<f64>();
                let left = a.iter().skip(x).zip(b.iter()).map(|(a, b)| f64::from(a * b)).sum::<f64>();
                right + left
            };
            rows.iter().zip(rows.iter().skip(y)).map(of_rows).sum::<f64>()
        };
        if self.level > 0 {
            return 0.5 * weight_product(0, 0) / f64::from(1u32 << (2 * self.level)) * correlated(correlations);
        }
        let pairs = |x: usize, y: usize| match (x, y) {
            (0, 0) => 0.5 * weight_product(0, 0),
            (_, 0) | (0, _) => weight_product(x, y),
            _ => 2.0 * weight_product(x, y),
        };
        let lags = (0..3).flat_map(|y| (0..3).map(move |x| (x, y)));
        lags.map(|(x, y)| correlations[0][x] * correlations[1][y] * pairs(x, y)).sum()
    }
}

/// The resolution at which a radius is drawn: the number of halvings.
fn level_of(radius_px: f64) -> usize {
    UP_TO_PX.iter().filter(|&&max_px| radius_px > max_px).count()
}

/// Distance to which a circle of this radius reaches, with its texels, px.
pub fn reach_of(radius_px: f64) -> f64 {
    radius_px + 3.0 * f64::from(1u32 << level_of(radius_px))
}

/// The variance that a resolution adds, in squares of its pixels: the mean over a texel, and linear
/// interpolation between texels. Half of it counts: an edge through a disc is wider from 10 to 90 %
/// than one through something rounder. With half, edges are within 5 % of the disc's width from 2
/// to 80 px.
fn added_variance(level: usize) -> f64 {
    if level == 0 { 0.0 } else { 0.5 * ((1.0 - 0.25f64.powi(level as i32)) / 12.0 + 1.0 / 6.0) }
}

fn splat(points: &[[f64; 2]], radius: f64, half: i32) -> Vec<f64> {
    let side = 2 * half + 1;
    let mut weights = vec![0.0; (side * side) as usize];
    for point in points {
        let at = point.map(|c| radius * c);
        let low = at.map(f64::floor);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let [x, y] = [low[0] as i32 + dx, low[1] as i32 + dy];
            let share = |at: f64, n: i32| 1.0 - (at - f64::from(n)).abs();
            let place = |n: i32| (n + half).clamp(0, side - 1);
            weights[(place(y) * side + place(x)) as usize] += share(at[0], x) * share(at[1], y) / points.len() as f64;
        }
    }
    weights
}

/// Along one axis (mean of both), px².
fn variance(weights: &[f64], half: i32) -> f64 {
    let side = 2 * half + 1;
    let square = |i: i32| f64::from((i % side - half).pow(2) + (i / side - half).pow(2));
    let middle = |along: fn(i32, i32) -> i32| -> f64 {
        weights.iter().enumerate().map(|(i, w)| w * f64::from(along(i as i32, side) - half)).sum()
    };
    let (x, y) = (middle(|i, side| i % side), middle(|i, side| i / side));
    0.5 * (weights.iter().enumerate().map(|(i, w)| w * square(i as i32)).sum::<f64>() - x * x - y * y)
}

/// The variance that a mean over many correlated pixels leaves, relative to independent ones: Σρ.
fn correlated(correlations: &[[f64; 3]; 2]) -> f64 {
    correlations.iter().map(|axis| axis[0] + 2.0 * (axis[1] + axis[2])).product()
}

/// Share of the pixels' noise variance that remains after blurring. `before` is their variance
/// relative to that of the recorded pixels, which are `enlargement` px wide. A circle of c recorded
/// pixels averages π/4·c² of them, fewer if they are correlated. Without enlargement it follows
/// from the kernel directly.
pub fn noise_left(
    before: f64,
    enlargement: f64,
    kernel: &Kernel,
    diameter_px: f64,
    correlations: &[[f64; 3]; 2],
) -> f64 {
    if enlargement <= 1.0 {
        return kernel.noise_left(correlations).min(1.0);
    }
    let recorded = std::f64::consts::FRAC_PI_4 * (diameter_px / enlargement).powi(2) / correlated(correlations);
    (1.0 / (1.0 + before * recorded)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::diameter_px;
    use super::*;

    #[test]
    fn kernel_of_every_slice_has_the_apertures_variance() {
        let round = Aperture::new(|_| 1.0);
        for slice in 1..=22 {
            let kernel = Kernel::new(&round, diameter_px(slice));
            let weights: Vec<f64> = kernel.weights.iter().map(|w| f64::from(*w)).collect();
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-5, "{slice}");
            let texel = f64::from(1u32 << kernel.level);
            let variance_px2 =
                (variance(&weights, HALVES[kernel.class]) + added_variance(kernel.level)) * texel * texel;
            let expected = (0.5 * diameter_px(slice)).powi(2) / 4.0;
            assert!((variance_px2 / expected - 1.0).abs() < 0.01, "{slice}: {variance_px2}, {expected} expected");
        }
    }
}
