//! Point spread: what lens and sensor blur of a picture that is in focus, as one measured width.
//!
//! A Gaussian of `sigma_px` over premultiplied light and coverage, along rows and then along columns. Its taps are the
//! discrete Gaussian exp(−σ²)·Iₙ(σ²) (Lindeberg 1990), whose variance is exactly σ² however small σ is: an edge that the
//! renderer has covered by areas gets as wide as the camera's (a sampled or integrated Gaussian misses σ below a
//! pixel). The taps sum to 1, so that light is kept; what is left out at the ends is less than 1e-4.
//!
//! For an edge, σ is its 10-90 % width over 2.563.
//!
//! Not modelled: a width that changes over the picture, by colour or with the opening; tails (veiling glare); what the
//! camera's own sharpening makes of edges; by how much the renderer's four samples a pixel are coarser than areas.

use super::{Effect, FrameContext, Stage};
use crate::gpu::{FullscreenPass, Gpu, Options, Slot, assemble, constants};
use crate::params::{Params, Value};
use crate::render::{COLOR, GEOMETRY, Layer, LayerRun};

crate::params! {
    /// Parameters of the point spread.
    pub struct PointSpread in "point_spread" {
        "standard deviation of the blur of lens and sensor; 0.39 of an edge's 10-90 % width; 0 is off; an enlarged photograph's is 8 px at most"
        sigma_px: f64 = 0.0, "px", 0.0..=8.0;
    }
}

/// What is cut off at the ends of the taps.
const LEFT_OUT: f64 = 1e-4;
/// Length of `weights` in shaders/point_spread.wgsl: enough for 8 px.
const MOST_TAPS: usize = 40;

#[derive(Debug, Default)]
pub struct PointSpreadEffect {
    params: PointSpread,
    /// For a width.
    passes: Option<(f64, Passes)>,
}

#[derive(Debug)]
struct Passes {
    taps: Vec<f64>,
    /// Along rows and along columns.
    light: [FullscreenPass; 2],
    geometry: [FullscreenPass; 2],
}

/// `PointSpread` of shaders/point_spread.wgsl.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    size: [i32; 4],
    weights: [[f32; 4]; MOST_TAPS],
}

/// exp(−t)·Iₙ(t), by the series of the modified Bessel function; t from 0 to some hundreds.
fn discrete_gaussian(n: u32, t: f64) -> f64 {
    // Terms (t/2)^(2k+n) / (k! (k+n)!), all above 0; the first by its factors, so that none overflows.
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

/// The tap in the middle and those on one side of it; all of them sum to 1.
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

impl Passes {
    fn new(gpu: &Gpu, sigma_px: f64) -> Self {
        let taps = taps(sigma_px);
        let shader = assemble("point_spread");
        let pass = |fragment, format, down| {
            let constants = [("radius", taps.len() as f64 - 1.0), ("down", down)];
            let options = Options { fragment, constants: &constants, ..Options::default() };
            FullscreenPass::with(gpu, "point_spread", &shader, &[format], &options)
        };
        Self {
            light: [0.0, 1.0].map(|down| pass("main", COLOR, down)),
            geometry: [0.0, 1.0].map(|down| pass("passing", GEOMETRY, down)),
            taps,
        }
    }
}

impl PointSpreadEffect {
    /// In the picture that is made. What is blurred in the camera's is so in an enlargement of it; at most 8 px.
    fn sigma_px(&self, context: &FrameContext<'_>) -> f64 {
        (self.params.sigma_px * context.enlargement()).min(8.0)
    }
}

impl Effect for PointSpreadEffect {
    fn stage(&self) -> Stage {
        Stage::Layer
    }
    fn summary(&self) -> &'static str {
        "makes objects as unsharp as lens and sensor are in focus"
    }
    fn params(&self) -> &dyn Params {
        &self.params
    }
    fn params_mut(&mut self) -> &mut dyn Params {
        &mut self.params
    }
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool {
        // Narrower, and no tap reaches the neighbours.
        taps(self.sigma_px(context)).len() < 2
    }
    fn reach_px(&self, context: &FrameContext<'_>) -> f32 {
        taps(self.sigma_px(context)).len() as f32 - 1.0
    }
    fn cases(&self) -> Vec<(&'static str, Vec<(&'static str, Value)>)> {
        vec![("", vec![("sigma_px", Value::Number(0.7))])]
    }

    fn run(&mut self, run: &mut LayerRun<'_>, context: &FrameContext<'_>, layer: Layer) -> Layer {
        let gpu = run.gpu;
        let sigma_px = self.sigma_px(context);
        let made = self.passes.take().filter(|(of, _)| *of == sigma_px);
        let (_, passes) = self.passes.insert(made.unwrap_or_else(|| (sigma_px, Passes::new(gpu, sigma_px))));
        let mut uniform =
            Uniform { size: [layer.size.0 as i32, layer.size.1 as i32, 0, 0], weights: [[0.0; 4]; MOST_TAPS] };
        for (weight, tap) in uniform.weights.iter_mut().zip(&passes.taps) {
            weight[0] = *tap as f32;
        }
        let uniform = constants(gpu, "point_spread", bytemuck::bytes_of(&uniform));
        let mut color = layer.color;
        for (slot, pass) in passes.light.iter().enumerate() {
            let to = run.pool.get(gpu, "spread colour", slot, layer.size, COLOR, 1);
            pass.run(gpu, run.encoder, &[Slot::Buffer(&uniform), Slot::Texture(&color.view)], &[&to], layer.size);
            color = to;
        }
        let mut geometry = layer.geometry;
        for (slot, pass) in passes.geometry.iter().enumerate().filter(|_| run.geometry_is_read) {
            let to = run.pool.get(gpu, "spread geometry", slot, layer.size, GEOMETRY, 1);
            pass.run(gpu, run.encoder, &[Slot::Buffer(&uniform), Slot::Texture(&geometry.view)], &[&to], layer.size);
            geometry = to;
        }
        Layer { color, geometry, ..layer }
    }
}

/// A layer spread: `rgba` holds `width * height` premultiplied pixels; outside is empty.
pub fn twin(rgba: &[[f64; 4]], width: usize, height: usize, sigma_px: f64) -> Vec<[f64; 4]> {
    let taps = taps(sigma_px);
    let tap = |n: i64| taps.get(n.unsigned_abs() as usize).copied().unwrap_or(0.0);
    let reach = taps.len() as i64 - 1;
    let at = |x: i64, y: i64| {
        let inside = x >= 0 && y >= 0 && x < width as i64 && y < height as i64;
        if inside { rgba[y as usize * width + x as usize] } else { [0.0; 4] }
    };
    let spread = |i: usize| {
        let (x, y) = ((i % width) as i64, (i / width) as i64);
        let mut sum = [0.0; 4];
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let from = at(x + dx, y + dy);
                (0..4).for_each(|c| sum[c] += tap(dx) * tap(dy) * from[c]);
            }
        }
        sum
    };
    (0..rgba.len()).map(spread).collect()
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
        // Far out it is the Gaussian: 1/(8·√2π).
        assert!((taps(8.0)[0] / 0.049_867_8 - 1.0).abs() < 3e-3, "{}", taps(8.0)[0]);
        assert!(taps(8.0).len() <= MOST_TAPS);
    }

    proptest! {
        #[test]
        fn light_is_kept_and_the_variance_is_sigmas(sigma in 0.1f64..8.0) {
            let taps = taps(sigma);
            let sum: f64 = taps[0] + 2.0 * taps[1..].iter().sum::<f64>();
            let variance: f64 = taps.iter().enumerate().map(|(n, tap)| 2.0 * (n * n) as f64 * tap).sum();
            prop_assert!((sum - 1.0).abs() < 1e-12);
            // Less what the ends would add: at most 1e-4 at 4 σ, or at a pixel or two where σ is small.
            prop_assert!((variance - sigma * sigma).abs() < 4e-3 * sigma * sigma + 4e-4, "{variance}");
        }
    }
}
