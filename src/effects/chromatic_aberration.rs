//! Lateral chromatic aberration: red and blue are enlarged slightly differently from green
//! (camera/falloff.rs, `Lateral`).
//!
//! Around the principal point, r' = r·(1 + a + b·r²) for red and for blue, r in half diagonals of
//! the picture. Green stays, since calibrations of geometry use it alone or all three channels.
//! Objects separate into channels like the real scene, so at a silhouette each channel has its own
//! coverage. The layer has three coverages ([`Layer::coverage`]), and the composite puts each
//! channel over the camera's: out = L_c + (1 − A_c)·camera_c, exactly. The layer's alpha is their
//! mean by luminance. It is above 0 if any channel is covered, so that uncovered pixels stay the
//! camera's; and a composite of the exported layer by this alpha has the right luminance over grey.
//!
//! It runs last on the layer, so that no other effect needs three coverages. The effects before it
//! treat all channels alike and change slowly across the picture, so the order matters only by the
//! shift's share of that change.
//!
//! Not modelled: a spectrum within each channel (fringes have two hues), longitudinal aberration,
//! the dilution of light over a larger picture (by 2a). Red and blue are interpolated linearly and
//! get softer, as by a blur with a variance of at most 1/4 px².

use glam::DVec2;

use super::{Case, Effect, EffectError, FrameContext, LayerRun, Reach};
use crate::camera::falloff::Lateral;
use crate::camera::{Camera, Geometry};
use crate::gpu::Shader;
use crate::params::Value;
use crate::render::{COLOR, Layer};

crate::params! {
    /// Parameters of the chromatic aberration.
    pub struct ChromaticAberration in "chromatic_aberration" at Effects {
        "scale of red relative to green, minus 1: 0.001 is 1 px at 1000 px from the principal point"
        red: f64 = 0.0, "1", -0.02..=0.02;
        "cubic part of red: added to the scale at half a diagonal, growing with the square of the distance"
        red_cubic: f64 = 0.0, "1", -0.02..=0.02;
        "scale of blue relative to green, minus 1"
        blue: f64 = 0.0, "1", -0.02..=0.02;
        "cubic part of blue"
        blue_cubic: f64 = 0.0, "1", -0.02..=0.02;
    }
}

crate::uniform! {
    struct ChromaticAberrationUniform {
        middle: [f32; 2],
        red: [f32; 2],
        blue: [f32; 2],
        size: [i32; 2],
        per_diagonal: f32,
    }
}

impl ChromaticAberration {
    fn of_red(&self) -> Lateral {
        Lateral { a: self.red, b: self.red_cubic }
    }
    fn of_blue(&self) -> Lateral {
        Lateral { a: self.blue, b: self.blue_cubic }
    }

    /// The largest shift of a channel, px.
    fn shift_px(&self, context: &FrameContext<'_>) -> f32 {
        let (middle, half_diagonal) = (principal_point_px(context.picture), whole_half_diagonal_px(context));
        let i = &context.picture.intrinsics;
        let size = DVec2::new(f64::from(i.width_px), f64::from(i.height_px));
        let farthest = middle.abs().max((size - middle).abs()).length();
        let r = farthest / half_diagonal;
        let shift = |part: Lateral| (part.a.abs() + part.b.abs() * r * r) * farthest;
        // 10 % more for the inverse shift, and 1 px for the interpolation.
        1.1 * shift(self.of_red()).max(shift(self.of_blue())) as f32 + 1.0
    }
}

/// Principal point of a picture, px.
fn principal_point_px(geometry: &Geometry) -> DVec2 {
    DVec2::new(geometry.intrinsics.cx_px, geometry.intrinsics.cy_px)
}

fn half_diagonal_px(geometry: &Geometry) -> f64 {
    let i = &geometry.intrinsics;
    0.5 * f64::from(i.width_px).hypot(f64::from(i.height_px))
}

/// Half the diagonal of the recorded camera's whole picture, of which the output may be a part, in
/// output pixels.
fn whole_half_diagonal_px(context: &FrameContext<'_>) -> f64 {
    context.capture.enlargement * half_diagonal_px(&context.capture.recorded)
}

impl Effect for ChromaticAberration {
    fn summary(&self) -> &'static str {
        "separates an object's colours towards the picture's corners as the lens does"
    }
    fn check(&self, _: &Camera, geometry: &Geometry) -> Result<(), EffectError> {
        let reason = "a 360° picture is put together and has no middle from which a lens would part colours: \
                      leave its parameters at their defaults";
        let refused = geometry.is_equirectangular() && *self != Self::default();
        if refused { Err(EffectError { parameter: "chromatic_aberration", reason }) } else { Ok(()) }
    }
    fn neutral_hint(&self) -> &'static str {
        "no colour is shifted; any value other than 0 enables it"
    }
    fn is_neutral(&self, _: &FrameContext<'_>) -> bool {
        *self == Self::default()
    }
    fn reach(&self, context: &FrameContext<'_>) -> Reach {
        Reach::both(self.shift_px(context))
    }
    fn cases(&self) -> Vec<Case> {
        vec![("", vec![("red", Value::Number(0.001)), ("blue", Value::Number(-0.001))])]
    }

    fn run(&self, run: &mut LayerRun<'_>, layer: Layer) -> Layer {
        let (middle, half_diagonal) = (principal_point_px(run.context.picture), whole_half_diagonal_px(run.context));
        let in_layer = middle - DVec2::new(f64::from(run.drawn.x0), f64::from(run.drawn.y0));
        let parts = |part: Lateral| [part.a as f32, part.b as f32];
        let uniform = ChromaticAberrationUniform {
            middle: in_layer.as_vec2().to_array(),
            red: parts(self.of_red()),
            blue: parts(self.of_blue()),
            size: [layer.size.0 as i32, layer.size.1 as i32],
            per_diagonal: half_diagonal.recip() as f32,
        };
        let pass = run.recorder.pass(Shader::ChromaticAberration, "main").uniform("chromatic", &uniform);
        let [color, coverage] = pass.texture("layer", &layer.color).draw([COLOR, COLOR], layer.size);
        let radius_px = self.shift_px(run.context).ceil() as u32;
        run.with_spread_geometry(Layer { color, coverage: Some(coverage), ..layer }, radius_px)
    }
}

/// Source position of the light of a channel at a position, px: the inverse of
/// [`Lateral::displaced_px`].
pub fn source_px(part: Lateral, at_px: DVec2, middle_px: DVec2, half_diagonal_px: f64) -> DVec2 {
    // Newton on the radius: r (1 + a + b r²) = r'.
    let from_middle = at_px - middle_px;
    let radius = from_middle.length() / half_diagonal_px;
    if radius == 0.0 {
        return at_px;
    }
    let mut r = radius;
    for _ in 0..20 {
        r -= (r * part.scale(r) - radius) / (1.0 + part.a + 3.0 * part.b * r * r);
    }
    middle_px + from_middle * (r / radius)
}

/// The aberration of a layer: the premultiplied light and the coverage of each channel. `rgba` has
/// `width * height` premultiplied pixels of the whole picture; outside is empty.
pub fn twin(params: &ChromaticAberration, geometry: &Geometry, rgba: &[[f64; 4]]) -> Vec<[[f64; 3]; 2]> {
    let (width, height) = (i64::from(geometry.intrinsics.width_px), i64::from(geometry.intrinsics.height_px));
    let (middle, half_diagonal) = (principal_point_px(geometry), half_diagonal_px(geometry));
    let at = |x: i64, y: i64| {
        let inside = x >= 0 && y >= 0 && x < width && y < height;
        if inside { rgba[(y * width + x) as usize] } else { [0.0; 4] }
    };
    let parts = [params.of_red(), Lateral::default(), params.of_blue()];
    (0..width * height)
        .map(|i| {
            let place = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let mut out = [[0.0; 3]; 2];
            for (c, part) in parts.into_iter().enumerate() {
                let from = source_px(part, place, middle, half_diagonal) - 0.5;
                let f = from - from.floor();
                let (x, y) = (from.x.floor() as i64, from.y.floor() as i64);
                for (dx, wx) in [(0, 1.0 - f.x), (1, f.x)] {
                    for (dy, wy) in [(0, 1.0 - f.y), (1, f.y)] {
                        let texel = at(x + dx, y + dy);
                        out[0][c] += wx * wy * texel[c];
                        out[1][c] += wx * wy * texel[3];
                    }
                }
            }
            out
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn source_of_a_displaced_position_is_the_position(
            a in -0.02f64..0.02, b in -0.02f64..0.02, x in -100.0f64..700.0, y in -100.0f64..600.0,
        ) {
            let (part, middle) = (Lateral { a, b }, DVec2::new(310.0, 250.0));
            let at = DVec2::new(x, y);
            let there = part.displaced_px(at, middle, 400.0);
            prop_assert!((source_px(part, there, middle, 400.0) - at).length() < 1e-9);
        }
    }
}
