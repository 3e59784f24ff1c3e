//! The method `diffusion`: Wang 2012, section 3.
//!
//! 1. The blur factor Q of each pixel: its circle (vSLRcam (8), which is Wang's δ for L ≫ f) over
//!    the frame's largest, in steps. Each step has one operator of radius r = R·Q (operator.rs).
//! 2. Each pixel of the original spreads its light by its operator. Within a step, overlapping
//!    light adds up. The steps are mixed from the largest to the smallest, channel by channel,
//!    including coverage:
//!    - `conserving` (default): they add up too, up to a coverage of 1. Light is conserved up to
//!      that coverage, and the order does not matter.
//!    - `printed`: F = min/max, F > K: K·A + K·B (2), else max + min·F (3). Equal values get 1.4
//!      times as bright, other light is lost, and at F = K there is a jump. The paper leaves F = K
//!      open; here (3) applies.
//! 3. Where Q < w: spread·Q + (1 − Q)·original (4).
//!
//! Beyond the paper: in front of the focus plane the shape is upside down. As in the paper, hidden
//! surfaces are unknown: where a blurred edge uncovers them, coverage falls and the camera's
//! picture is visible; and by (4) a blurred surface does not spread over a sharp one. Circles are
//! at most 2·R_K wide.

use crate::camera::Opening;
use crate::effects::{FrameContext, LayerRun};
use crate::gpu::{Gpu, Shader, ShaderEntry, Texture};
use crate::render::{COLOR, Layer};

use super::layered;
use super::operator::OperatorParams;
use super::settings::{DepthOfField, Mix};
use super::surroundings::{LensUniform, Tiling, surroundings, with_color};

/// Largest number of steps of the blur factor besides 0; the same as in
/// shaders/depth_of_field_diffusion.wgsl.
pub const MAX_STEPS: u32 = 32;

/// Key of the operators.
#[derive(Clone, Debug, PartialEq)]
struct OperatorKey {
    params: DepthOfField,
    opening: Opening,
    largest_radius_px: f32,
}

crate::uniform! {
    struct WangUniform { mix_ratio: f32, blend_below: f32, margin: i32, half_side: i32 }
}

/// Parameters of the operators.
fn operator_params(params: &DepthOfField) -> OperatorParams {
    OperatorParams {
        rim: params.rim.into(),
        gaussian_px: params.gaussian_px.into(),
        largest_radius_px: params.largest_radius_px.into(),
    }
}

/// Converts values in the camera's pixels to pixels of the output picture, within the ranges that
/// operators can represent.
fn enlarged(params: &DepthOfField, context: &FrameContext<'_>) -> DepthOfField {
    let times = context.capture.enlargement as f32;
    DepthOfField {
        rim: params.rim / times,
        gaussian_px: (params.gaussian_px * times).min(4.0),
        largest_radius_px: (params.largest_radius_px * times).min(64.0),
        ..params.clone()
    }
}

/// R: the radius of the frame's largest circle, at most R_K.
fn largest_radius_px(params: &DepthOfField, context: &FrameContext<'_>) -> f32 {
    layered::largest_radius_px(context).min(params.largest_radius_px)
}

/// Distance to which light spreads, px.
pub fn reach_px(params: &DepthOfField, context: &FrameContext<'_>) -> f32 {
    let params = &enlarged(params, context);
    largest_radius_px(params, context).ceil() + operator_params(params).margin() as f32
}

/// Steps of half a pixel of radius, up to `MAX_STEPS`.
pub fn steps(largest_radius_px: f64) -> u32 {
    ((2.0 * largest_radius_px).ceil() as u32).clamp(1, MAX_STEPS)
}

/// The operator of each step; its radius is the step's share of the largest.
pub fn operators(params: &DepthOfField, opening: &Opening, largest_radius_px: f64) -> Vec<Vec<f64>> {
    let outline = params.shape.outline(opening);
    let steps = steps(largest_radius_px);
    let radius = |step| largest_radius_px * f64::from(step) / f64::from(steps);
    (0..=steps).map(|step| operator_params(params).operator(&outline, radius(step))).collect()
}

/// The operators of a frame, stacked vertically.
fn texture(gpu: &Gpu, of: &OperatorKey) -> Texture {
    let side = 2 * operator_params(&of.params).half_side() as u32 + 1;
    let texture = Texture::new(gpu, "operators", side, side * (MAX_STEPS + 1), wgpu::TextureFormat::R32Float, 1);
    let all = operators(&of.params, &of.opening, of.largest_radius_px.into());
    let texels: Vec<f32> = all.iter().flatten().map(|&t| t as f32).collect();
    texture.write(gpu, side, side * all.len() as u32, &texels);
    texture
}

pub fn run(run: &mut LayerRun<'_>, params: &DepthOfField, opening: &Opening, layer: Layer) -> Layer {
    let tiling = Tiling::coarse(layer.size, reach_px(params, run.context));
    let params = &enlarged(params, run.context);
    let largest_radius_px = largest_radius_px(params, run.context);
    let lens = LensUniform::new(run, opening, &layer, tiling, largest_radius_px, steps(largest_radius_px.into()));
    let around = surroundings(run, &lens, &layer, tiling);
    // The key contains only the parameters of the operators.
    let DepthOfField { shape, rim, gaussian_px, largest_radius_px: max_px, .. } = *params;
    let of_operators = DepthOfField { shape, rim, gaussian_px, largest_radius_px: max_px, ..DepthOfField::default() };
    let operators = run
        .recorder
        .memoized_large(OperatorKey { params: of_operators, opening: *opening, largest_radius_px }, texture);
    let pass = run.recorder.pass(Shader::DepthOfFieldDiffusion, "blur_factors").uniform("lens", &lens);
    let [factors] = pass.texture("geometry", &layer.geometry).draw([COLOR], layer.size);
    let wang = WangUniform {
        mix_ratio: params.mix_ratio,
        blend_below: params.blend_below,
        margin: operator_params(params).margin() as i32,
        half_side: operator_params(params).half_side() as i32,
    };
    let entry = ShaderEntry::from("spread").choose("printed", params.mix == Mix::Printed);
    let pass = run.recorder.pass(Shader::DepthOfFieldDiffusion, entry).uniform("lens", &lens).storage("wang", &wang);
    let pass = pass.texture("factors", &factors).texture("color", &layer.color);
    let pass = pass.texture("operators", &operators).texture("around_tiles", &around);
    let [out] = pass.draw([COLOR], layer.size);
    with_color(run, &lens, &around, layer, out)
}

/// Wang (2) and (3) for one channel.
pub fn mixed(a: f64, b: f64, ratio: f64) -> f64 {
    let (low, high) = (a.min(b), a.max(b));
    if high <= 0.0 {
        return 0.0;
    }
    let f = low / high;
    if f > ratio { ratio * a + ratio * b } else { high + low * f }
}

/// A layer by the paper: its pixels are stamped one by one with the operators of their circles
/// (signed, px; NaN where nothing was drawn), the largest first. `rgba` has `width * height`
/// premultiplied pixels; outside is empty.
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
    let half = operator_params(params).half_side() as i64;
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
    use crate::gpu::constant;

    #[test]
    fn largest_number_of_steps_equals_the_shaders() {
        assert_eq!(constant(&Shader::DepthOfFieldDiffusion.module(), "MAX_STEPS"), f64::from(MAX_STEPS));
    }

    #[test]
    fn mix_matches_hand_computed_values() {
        // F = 0.8 > 0.7: 0.7 · 0.9; F = 0.5: 0.6 + 0.3 · 0.5; equal values: 1.4; nothing: the
        // other; F = K: (3).
        for (a, b, expected) in
            [(0.5, 0.4, 0.63), (0.3, 0.6, 0.75), (1.0, 1.0, 1.4), (0.0, 0.8, 0.8), (0.0, 0.0, 0.0), (1.0, 0.7, 1.49)]
        {
            assert!((mixed(a, b, 0.7) - expected).abs() < 1e-12, "{a} {b}");
        }
    }
}
