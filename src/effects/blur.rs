//! Separable Gaussian blur of a layer, for effects that spread light.
//!
//! Its taps are a Gaussian at whole pixels, exp(−n²/2s²), with the s whose taps have the variance
//! σ². From 1 px on s is σ to 1e-8 (Poisson's summation: the sampled Gaussian's variance misses σ²
//! by 8π²σ⁴·exp(−2π²σ²)); below, s is larger: 0.53 px for 0.5. They sum to 1, so that light is
//! conserved; less than 1e-4 is truncated at the ends.
//!
//! An edge drawn by coverage and blurred in this way measures the set width, by the fit of
//! `calibrate sharpness`, within 2 % from 0.8 px on (docs/calibration.md, Sharpness). The discrete
//! Gaussian exp(−σ²)·Iₙ(σ²) (Lindeberg 1990) has the same variance, but longer tails and a higher
//! middle: its edge of 1 px measures 0.86 to 0.94. Below 0.7 px three taps are no Gaussian,
//! whatever their weights: the measured width is less than the set one. Best-fitting weights there
//! have negative sides, which make coverage outside of objects.
//!
//! A blur wider than [`MAX_DIRECT_SIGMA_PX`] is computed at half the resolution, recursively. Means
//! of 2×2 pixels and linear interpolation between them add a variance of 1 px² (1/4 by a mean of
//! two, 3/4 by interpolation between texels two pixels apart), which is subtracted from σ².

use super::LayerRun;
use crate::gpu::{Shader, ShaderEntry, Texture};
use crate::render::COLOR;

/// Largest weight that is truncated at the ends of the taps.
const MAX_TRUNCATED_WEIGHT: f64 = 1e-4;
/// Largest σ at full resolution, px. Wider blurs are computed at half the resolution.
pub const MAX_DIRECT_SIGMA_PX: f64 = 8.0;
/// Taps of one side that are enough for that σ.
const MAX_TAPS: usize = 40;
/// The variance added by halving and doubling, px².
const HALVING_PX2: f64 = 1.0;

/// A Gaussian of parameter s at the pixels 0, 1, … of one side; both sides sum to 1.
fn sampled(s_px: f64) -> Vec<f64> {
    let tap = |n: usize| (-0.5 * (n as f64 / s_px).powi(2)).exp();
    let taps: Vec<f64> = (0..MAX_TAPS).map(tap).take_while(|tap| *tap > 1e-18).collect();
    let sum = 2.0 * taps.iter().sum::<f64>() - 1.0;
    taps.iter().map(|tap| tap / sum).collect()
}

fn variance_px2(taps: &[f64]) -> f64 {
    taps.iter().enumerate().map(|(n, tap)| 2.0 * (n * n) as f64 * tap).sum()
}

/// The parameter s of the Gaussian whose samples have the variance σ².
fn parameter_px(sigma_px: f64) -> f64 {
    if sigma_px >= 1.0 {
        return sigma_px;
    }
    // The variance grows with the parameter, which is at most 0.25 px larger than σ.
    let (mut low, mut high) = (sigma_px, sigma_px + 0.25);
    for _ in 0..52 {
        let middle = 0.5 * (low + high);
        let is_narrow = variance_px2(&sampled(middle)) < sigma_px * sigma_px;
        *if is_narrow { &mut low } else { &mut high } = middle;
    }
    0.5 * (low + high)
}

/// The tap in the middle and those on one side of it, for σ up to [`MAX_DIRECT_SIGMA_PX`]; all of
/// them sum to 1.
pub fn taps(sigma_px: f64) -> Vec<f64> {
    if sigma_px == 0.0 {
        return vec![1.0];
    }
    let mut taps = sampled(parameter_px(sigma_px));
    let mut sum = taps[0];
    let kept = 1 + taps[1..]
        .iter()
        .take_while(|tap| {
            let goes_on = sum < 1.0 - MAX_TRUNCATED_WEIGHT;
            sum += if goes_on { 2.0 * **tap } else { 0.0 };
            goes_on
        })
        .count();
    taps.truncate(kept);
    taps.iter().map(|tap| tap / sum).collect()
}

/// σ at half the resolution, in its pixels.
fn halved_px(sigma_px: f64) -> f64 {
    0.5 * (sigma_px * sigma_px - HALVING_PX2).sqrt()
}

/// Radius over which the blur reads, px.
pub fn reach_px(sigma_px: f64) -> u32 {
    if sigma_px > MAX_DIRECT_SIGMA_PX { 2 * reach_px(halved_px(sigma_px)) + 3 } else { taps(sigma_px).len() as u32 - 1 }
}

impl LayerRun<'_> {
    /// Blurs premultiplied light and coverage of a picture of `size` (px). Pixels outside are
    /// empty.
    pub fn blurred(&mut self, light: &Texture, size: (u32, u32), sigma_px: f64) -> Texture {
        let uniform = |size: (u32, u32)| BlurUniform { size: [size.0 as i32, size.1 as i32] };
        if sigma_px > MAX_DIRECT_SIGMA_PX {
            let half = (size.0.div_ceil(2), size.1.div_ceil(2));
            let pass = self.recorder.pass(Shader::Blur, "halved").uniform("blur", &uniform(size));
            let [smaller] = pass.texture("layer", light).draw([COLOR], half);
            let smaller = self.blurred(&smaller, half, halved_px(sigma_px));
            let pass = self.recorder.pass(Shader::Blur, "doubled").uniform("blur", &uniform(half));
            let [out] = pass.texture("layer", &smaller).draw([COLOR], size);
            return out;
        }
        let taps: Vec<f32> = taps(sigma_px).iter().map(|tap| *tap as f32).collect();
        let taps = self.recorder.storage(bytemuck::cast_slice(&taps));
        let mut out = light.clone();
        for down in [0.0, 1.0] {
            let pass = self.recorder.pass(Shader::Blur, ShaderEntry::from("main").choose("down", down));
            let pass = pass.uniform("blur", &uniform(size)).buffer("taps", taps.clone()).texture("layer", &out);
            [out] = pass.draw([COLOR], size);
        }
        out
    }
}

crate::uniform! {
    struct BlurUniform { size: [i32; 2] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn taps_match_hand_computed_values() {
        // exp(−1/2) = 0.606531, exp(−2) = 0.135335, exp(−4.5) = 0.011109, exp(−8) = 0.000335: in
        // all 2.506621, √2π.
        let of_one = [1.0, 0.606_531, 0.135_335, 0.011_109, 0.000_335].map(|tap| tap / 2.506_621);
        assert_eq!(taps(1.0).len(), of_one.len());
        assert!(taps(1.0).iter().zip(of_one).all(|(tap, hand)| (tap - hand).abs() < 3e-6), "{:?}", taps(1.0));
        // Three taps of the variance 0.01: 0.005, 0.99, 0.005.
        assert!((taps(0.1)[0] - 0.99).abs() < 1e-7 && (taps(0.1)[1] - 0.005).abs() < 1e-7, "{:?}", taps(0.1));
        assert!((parameter_px(0.5) - 0.525).abs() < 0.01, "{}", parameter_px(0.5));
        assert_eq!((taps(0.0), taps(1e-3)), (vec![1.0], vec![1.0]));
        // 1/(8·√2π).
        assert!((taps(MAX_DIRECT_SIGMA_PX)[0] / 0.049_867_8 - 1.0).abs() < 1e-4, "{}", taps(MAX_DIRECT_SIGMA_PX)[0]);
        assert!(taps(MAX_DIRECT_SIGMA_PX).len() <= MAX_TAPS);
    }

    proptest! {
        #[test]
        fn taps_sum_to_1_and_have_the_variance_of_sigma(sigma in 0.1f64..8.0) {
            let taps = taps(sigma);
            let sum: f64 = taps[0] + 2.0 * taps[1..].iter().sum::<f64>();
            let variance = variance_px2(&taps);
            prop_assert!((sum - 1.0).abs() < 1e-12);
            // The truncated ends: at most 1e-4 at 4 σ, or at a pixel or two if σ is small.
            prop_assert!((variance - sigma * sigma).abs() < 4e-3 * sigma * sigma + 4e-4, "{variance}");
        }
    }
}
