//! The method `diffusion`: Wang 2012, section 3.
//!
//! 1. The blur factor Q of each pixel, its circle (vSLRcam (8), which is Wang's δ for L ≫ f) over the frame's largest; in
//!    steps, each of which has one operator of radius r = R·Q (operator.rs).
//! 2. Each pixel of the original spreads its light by its operator. Within a step what falls together adds up; the
//!    steps are mixed from the largest to the smallest, channel by channel, coverage being one of them:
//!    - `conserving` (default): they add up too, up to a coverage of 1. Light is kept wherever no more than that falls
//!      together, and the order does not matter.
//!    - `printed`: F = min/max, F > K: K·A + K·B (2), else max + min·F (3). Equal values get 1.4 times as bright, other
//!      light is lost, and at F = K there is a jump; K itself, which the paper leaves open, goes with (3).
//! 3. Where Q < w: spread·Q + (1 − Q)·original (4).
//!
//! Beyond the paper: before the focus plane the shape is upside down. As in the paper, what a surface hides is unknown:
//! where a blurred edge uncovers it, coverage falls and the camera's picture shows; a blurred surface does not spread
//! over a sharp one, by (4). Circles are at most 2·R_K wide.

use crate::camera::Opening;
use crate::effects::FrameContext;
use crate::gpu::{FullscreenPass, Gpu, Options, Slot, Texture, assemble};
use crate::render::{COLOR, Layer, LayerRun};

use super::operator::Make;
use super::surroundings::{Surroundings, Tiling, lens};
use super::{DepthOfField, layered};

crate::choices! {
    /// How what is spread from different depths comes together.
    pub enum Mix { Conserving = "conserving", Printed = "printed" }
}

/// Steps of the blur factor besides 0, at most; as in shaders/depth_of_field_diffusion.wgsl.
pub const MOST_STEPS: u32 = 32;

/// The operators of a frame, one below the other.
#[derive(Debug)]
struct Operators {
    opening: Opening,
    largest_radius_px: f32,
    texture: Texture,
}

#[derive(Debug)]
pub struct Passes {
    params: DepthOfField,
    surroundings: Surroundings,
    blur_factors: FullscreenPass,
    spread: FullscreenPass,
    operators: Option<Operators>,
}

/// Of the params' operators.
fn make(params: &DepthOfField) -> Make {
    Make {
        rim: params.rim.into(),
        gaussian_px: params.gaussian_px.into(),
        largest_radius_px: params.largest_radius_px.into(),
    }
}

/// R: of the frame's largest circle, within R_K.
fn largest_radius_px(params: &DepthOfField, context: &FrameContext<'_>) -> f32 {
    layered::largest_radius_px(context).min(params.largest_radius_px)
}

/// How far light is spread.
pub fn reach_px(params: &DepthOfField, context: &FrameContext<'_>) -> f32 {
    largest_radius_px(params, context).ceil() + make(params).margin() as f32
}

/// Steps of half a pixel of radius, as far as there are so many.
pub fn steps(largest_radius_px: f64) -> u32 {
    ((2.0 * largest_radius_px).ceil() as u32).clamp(1, MOST_STEPS)
}

/// The operator of each step: its radius is that share of the largest.
pub fn operators(params: &DepthOfField, opening: &Opening, largest_radius_px: f64) -> Vec<Vec<f64>> {
    let outline = params.shape.outline(opening);
    let steps = steps(largest_radius_px);
    let radius = |step| largest_radius_px * f64::from(step) / f64::from(steps);
    (0..=steps).map(|step| make(params).operator(&outline, radius(step))).collect()
}

impl Operators {
    fn new(gpu: &Gpu, params: &DepthOfField, opening: &Opening, largest_radius_px: f32) -> Self {
        let side = 2 * make(params).half_side() as u32 + 1;
        let format = wgpu::TextureFormat::R32Float;
        let texture = Texture::new(gpu, "operators", side, side * (MOST_STEPS + 1), format, 1);
        let all = operators(params, opening, largest_radius_px.into());
        let texels: Vec<f32> = all.iter().flatten().map(|&t| t as f32).collect();
        texture.write(gpu, side, side * all.len() as u32, &texels);
        Self { opening: *opening, largest_radius_px, texture }
    }
}

impl Passes {
    pub fn new(gpu: &Gpu, params: &DepthOfField) -> Self {
        let shader = assemble("depth_of_field_diffusion");
        let pass = |fragment| {
            let all = [
                ("printed", f64::from(u8::from(params.mix == Mix::Printed))),
                ("mix_ratio", params.mix_ratio.into()),
                ("blend_below", params.blend_below.into()),
                ("margin", make(params).margin() as f64),
                ("half_side", make(params).half_side() as f64),
            ];
            let options = Options { fragment, constants: &all, ..Options::default() };
            FullscreenPass::with(gpu, "diffusion", &shader, &[COLOR], &options)
        };
        Self {
            params: params.clone(),
            surroundings: Surroundings::new(gpu),
            blur_factors: pass("blur_factors"),
            spread: pass("spread"),
            operators: None,
        }
    }

    /// Whether they were made for these parameters.
    pub fn are_of(&self, params: &DepthOfField) -> bool {
        self.params == *params
    }

    pub fn run(
        &mut self,
        run: &mut LayerRun<'_>,
        context: &FrameContext<'_>,
        opening: &Opening,
        layer: Layer,
    ) -> Layer {
        let gpu = run.gpu;
        let largest = largest_radius_px(&self.params, context);
        let made = self.operators.take().filter(|o| (o.opening, o.largest_radius_px) == (*opening, largest));
        let operators = made.unwrap_or_else(|| Operators::new(gpu, &self.params, opening, largest));
        let tiling = Tiling::coarse(layer.size, reach_px(&self.params, context));
        let lens = lens(gpu, context, opening, &layer, tiling, largest, steps(largest.into()));
        let around = self.surroundings.run(run, &lens, &layer, tiling);
        let [factors, out] = ["blur factors", "focused colour"].map(|p| run.pool.get(gpu, p, 0, layer.size, COLOR, 1));
        let slots = [Slot::Buffer(&lens), Slot::Texture(&layer.geometry.view)];
        self.blur_factors.run(gpu, run.encoder, &slots, &[&factors], layer.size);
        let slots = [
            Slot::Buffer(&lens),
            Slot::Texture(&factors.view),
            Slot::Texture(&layer.color.view),
            Slot::Texture(&operators.texture.view),
            Slot::Texture(&around.view),
        ];
        self.spread.run(gpu, run.encoder, &slots, &[&out], layer.size);
        self.operators = Some(operators);
        self.surroundings.passed(run, &lens, &around, layer, out)
    }
}

/// Wang (2) and (3) of one channel.
pub fn mixed(a: f64, b: f64, ratio: f64) -> f64 {
    let (low, high) = (a.min(b), a.max(b));
    if high <= 0.0 {
        return 0.0;
    }
    let f = low / high;
    if f > ratio { ratio * a + ratio * b } else { high + low * f }
}

/// A layer by the paper: its pixels stamped one by one with the operators of their circles (signed, px; NaN where nothing was
/// drawn), the largest first. `rgba` holds `width * height` premultiplied pixels; outside is empty.
pub fn twin(
    rgba: &[[f64; 4]],
    width: usize,
    circles_px: &[f64],
    opening: &Opening,
    params: &DepthOfField,
) -> Vec<[f64; 4]> {
    let height = (rgba.len() / width.max(1)) as i64;
    let largest = 0.5 * circles_px.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    let operators = operators(params, opening, largest);
    let half = make(params).half_side() as i64;
    let factor = |i: usize| 0.5 * circles_px[i].abs() / largest;
    let mut out = vec![[0.0; 4]; rgba.len()];
    for (step, operator) in operators.iter().enumerate().rev() {
        let mut spread = vec![[0.0; 4]; rgba.len()];
        let of_step = |&i: &usize| (factor(i) * (operators.len() - 1) as f64).round() == step as f64;
        for i in (0..rgba.len()).filter(of_step) {
            let side = if circles_px[i] < 0.0 { -1 } else { 1 };
            for (k, share) in operator.iter().enumerate().filter(|(_, share)| **share > 0.0) {
                let [dx, dy] = [k as i64 % (2 * half + 1), k as i64 / (2 * half + 1)].map(|c| side * (c - half));
                let (x, y) = ((i % width) as i64 + dx, (i / width) as i64 + dy);
                if x >= 0 && y >= 0 && x < width as i64 && y < height {
                    let to = &mut spread[y as usize * width + x as usize];
                    (0..4).for_each(|c| to[c] += share * rgba[i][c]);
                }
            }
        }
        for (to, from) in out.iter_mut().zip(&spread) {
            for c in 0..4 {
                to[c] = match params.mix {
                    Mix::Conserving => to[c] + from[c],
                    Mix::Printed => mixed(to[c], from[c], params.mix_ratio.into()),
                };
            }
        }
    }
    for (i, to) in out.iter_mut().enumerate() {
        match params.mix {
            Mix::Conserving => *to = to.map(|c| c / f64::max(to[3], 1.0)),
            Mix::Printed => to[3] = to[3].min(1.0),
        }
        let q = factor(i);
        if q < f64::from(params.blend_below) {
            (0..4).for_each(|c| to[c] = q * to[c] + (1.0 - q) * rgba[i][c]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixing_worked_by_hand() {
        // F = 0.8 > 0.7: 0.7 · 0.9; F = 0.5: 0.6 + 0.3 · 0.5; equal values: 1.4; nothing: the other; F = K: (3).
        for (a, b, expected) in
            [(0.5, 0.4, 0.63), (0.3, 0.6, 0.75), (1.0, 1.0, 1.4), (0.0, 0.8, 0.8), (0.0, 0.0, 0.0), (1.0, 0.7, 1.49)]
        {
            assert!((mixed(a, b, 0.7) - expected).abs() < 1e-12, "{a} {b}");
        }
    }
}
