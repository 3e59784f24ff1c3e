//! A Gaussian over a layer, for effects that spread light: along rows, then along columns.
//!
//! Its taps are the discrete Gaussian exp(−σ²)·Iₙ(σ²) (Lindeberg 1990), whose variance is exactly σ² however small σ is
//! (a sampled or integrated Gaussian misses σ below a pixel). They sum to 1, so that light is kept; less than 1e-4 is
//! left out at the ends.
//!
//! Their excess kurtosis is 1/σ²: below some 2 px the middle is higher and the tails are longer than a Gaussian's. An edge to
//! which a Gaussian is fitted then measures less than σ, at 1 px 0.86 to 0.94 (docs/calibration.md, Sharpness).
//!
//! A blur wider than [`WIDE_PX`] is made at half the resolution, recursively. Means of 2×2 pixels and linear
//! interpolation between them add a variance of 1 px² (1/4 by a mean of two, 3/4 by interpolation between texels two
//! pixels apart), which is subtracted from σ².

use super::LayerRun;
use crate::gpu::{Entry, Shader, Texture};
use crate::render::COLOR;

/// The weight cut off at the ends of the taps.
const LEFT_OUT: f64 = 1e-4;
/// Wider blurs are made at half the resolution, px.
pub const WIDE_PX: f64 = 8.0;
/// Enough taps for that width.
const MOST_TAPS: usize = 40;
/// The variance added by halving and doubling, px².
const HALVING_PX2: f64 = 1.0;

/// exp(−t)·Iₙ(t), by the series of the modified Bessel function; t from 0 to some hundreds.
fn discrete_gaussian(n: u32, t: f64) -> f64 {
    // Terms (t/2)^(2k+n) / (k! (k+n)!), all positive. The first is built factor by factor so that none overflows.
    let mut term = (1..=n).fold((-t).exp(), |product, i| product * 0.5 * t / f64::from(i));
    let mut sum = term;
    for k in 1..1000 {
        let k = f64::from(k);
        term *= 0.25 * t * t / (k * (k + f64::from(n)));
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}

/// The tap in the middle and those on one side of it, for σ up to [`WIDE_PX`]; all of them sum to 1.
pub fn taps(sigma_px: f64) -> Vec<f64> {
    let t = sigma_px * sigma_px;
    let mut taps = vec![discrete_gaussian(0, t)];
    let mut sum = taps[0];
    while sum < 1.0 - LEFT_OUT && taps.len() < MOST_TAPS {
        let tap = discrete_gaussian(taps.len() as u32, t);
        taps.push(tap);
        sum += 2.0 * tap;
    }
    taps.iter().map(|tap| tap / sum).collect()
}

/// σ at half the resolution, in its pixels.
fn halved_px(sigma_px: f64) -> f64 {
    0.5 * (sigma_px * sigma_px - HALVING_PX2).sqrt()
}

/// How far from a pixel the blur looks, px.
pub fn reach_px(sigma_px: f64) -> u32 {
    if sigma_px > WIDE_PX { 2 * reach_px(halved_px(sigma_px)) + 3 } else { taps(sigma_px).len() as u32 - 1 }
}

impl LayerRun<'_> {
    /// Blurs premultiplied light and coverage of a picture of `size` (px). There is nothing outside it.
    pub fn blurred(&mut self, light: &Texture, size: (u32, u32), sigma_px: f64) -> Texture {
        let uniform = |size: (u32, u32)| Blur { size: [size.0 as i32, size.1 as i32] };
        if sigma_px > WIDE_PX {
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
            let pass = self.recorder.pass(Shader::Blur, Entry::from("main").choose("down", down));
            let pass = pass.uniform("blur", &uniform(size)).buffer("taps", taps.clone()).texture("layer", &out);
            [out] = pass.draw([COLOR], size);
        }
        out
    }
}

crate::uniform! {
    struct Blur { size: [i32; 2] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn taps_worked_by_hand() {
        // exp(−1) times I₀(1) = 1.266066, I₁(1) = 0.565159, I₂(1) = 0.135748 (Abramowitz and Stegun, table 9.8).
        for (n, expected) in [(0, 1.266_066), (1, 0.565_159), (2, 0.135_748)] {
            assert!((discrete_gaussian(n, 1.0) - expected * (-1f64).exp()).abs() < 1e-6);
        }
        assert_eq!(taps(0.0), [1.0]);
        // For large σ it is the continuous Gaussian: 1/(8·√2π).
        assert!((taps(WIDE_PX)[0] / 0.049_867_8 - 1.0).abs() < 3e-3, "{}", taps(WIDE_PX)[0]);
        assert!(taps(WIDE_PX).len() <= MOST_TAPS);
    }

    proptest! {
        #[test]
        fn light_is_kept_and_the_variance_is_sigmas(sigma in 0.1f64..8.0) {
            let taps = taps(sigma);
            let sum: f64 = taps[0] + 2.0 * taps[1..].iter().sum::<f64>();
            let variance: f64 = taps.iter().enumerate().map(|(n, tap)| 2.0 * (n * n) as f64 * tap).sum();
            prop_assert!((sum - 1.0).abs() < 1e-12);
            // Minus what the ends would add: at most 1e-4 at 4 σ, or at a pixel or two if σ is small.
            prop_assert!((variance - sigma * sigma).abs() < 4e-3 * sigma * sigma + 4e-4, "{variance}");
        }
    }
}
