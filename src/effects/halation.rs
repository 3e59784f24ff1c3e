//! Halation: light goes through the film, is reflected by its base, and exposes the surroundings.
//!
//! out = (1 − s)·L + s·(G ∗ L), with G a Gaussian whose weights sum to 1 (blur.rs): light is
//! conserved. The glow also extends over the camera's picture, without coverage; coverage does not
//! change. A sensor's cover glass has the same effect. It runs after the exposure, since the light
//! on the film is reflected.
//!
//! Not modelled: the red colour of the glow (the red layer lies deepest), the dark ring of a
//! totally reflecting base, and the glow of real light that an object occludes.

use super::{Case, Effect, FrameContext, LayerRun, Reach, blur};
use crate::gpu::Shader;
use crate::params::Value;
use crate::render::{COLOR, Layer};

crate::params! {
    /// Parameters of the halation.
    pub struct Halation in "halation" at Effects {
        "share of an object's light that the film's base reflects; 0 is off"
        share as "Amount": f64 = 0.0, "1", 0.0..=1.0;
        "standard deviation of the reflected light"
        sigma_px as "Blur σ": f64 = 12.0, "px", 1.0..=64.0 => share isnt "0";
    }
}

crate::uniform! {
    struct HalationUniform { share: f32 }
}

impl Effect for Halation {
    fn summary(&self) -> &'static str {
        "lets bright objects glow as film does"
    }
    fn neutral_hint(&self) -> &'static str {
        "its amount is 0; a larger value enables it"
    }
    fn is_neutral(&self, _: &FrameContext<'_>) -> bool {
        self.share == 0.0
    }
    fn reach(&self, context: &FrameContext<'_>) -> Reach {
        Reach::both(blur::reach_px(context.drawn_px(self.sigma_px)) as f32)
    }
    fn cases(&self) -> Vec<Case> {
        let share = ("share", Value::Number(0.1));
        vec![("", vec![share.clone()]), ("narrow", vec![share, ("sigma_px", Value::Number(3.0))])]
    }
    fn run(&self, run: &mut LayerRun<'_>, layer: Layer) -> Layer {
        let around = run.blurred(&layer.color, layer.size, run.context.drawn_px(self.sigma_px));
        let uniform = HalationUniform { share: self.share as f32 };
        let pass = run.recorder.pass(Shader::Halation, "main").uniform("halation", &uniform);
        let [color] = pass.texture("layer", &layer.color).texture("around", &around).draw([COLOR], layer.size);
        Layer { color, light_alone: true, ..layer }
    }
}

/// The halation of a layer, by the sampled Gaussian itself. `rgba` has `width * height`
/// premultiplied pixels; outside is empty.
pub fn twin(rgba: &[[f64; 4]], width: usize, params: &Halation) -> Vec<[f64; 4]> {
    let (reach, s) = ((5.0 * params.sigma_px).ceil() as i64, params.sigma_px);
    let tap = |d: i64| (-0.5 * (d as f64 / s).powi(2)).exp();
    let sum: f64 = (-reach..=reach).map(tap).sum();
    let taps: Vec<f64> = (-reach..=reach).map(|d| tap(d) / sum).collect();
    let convolved = |from: &[[f64; 4]], step: usize, length: usize, place: &dyn Fn(usize) -> usize| -> Vec<[f64; 4]> {
        let at = |i: usize| {
            let own = place(i) as i64;
            let mut sum = [0.0; 4];
            for (tap, d) in taps.iter().zip(-reach..) {
                if (0..length as i64).contains(&(own + d)) {
                    let texel = from[(i as i64 + d * step as i64) as usize];
                    (0..4).for_each(|c| sum[c] += tap * texel[c]);
                }
            }
            sum
        };
        (0..from.len()).map(at).collect()
    };
    let height = rgba.len() / width.max(1);
    let across = convolved(rgba, 1, width, &|i| i % width);
    let around = convolved(&across, width, height, &|i| i / width);
    let mixed = |(own, around): (&[f64; 4], &[f64; 4])| {
        let light = |c: usize| (1.0 - params.share) * own[c] + params.share * around[c];
        [light(0), light(1), light(2), own[3]]
    };
    rgba.iter().zip(&around).map(mixed).collect()
}
