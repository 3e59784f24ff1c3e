//! Lateral chromatic aberration: red and blue are enlarged slightly differently from green (camera/falloff.rs,
//! `Lateral`).
//!
//! Around the principal point, r' = r·(1 + a + b·r²) for red and for blue, r in half diagonals of the picture. Green
//! stays, since calibrations of geometry use it alone or all three colours. Objects part as the real scene did, so at a
//! silhouette each colour has its own coverage. One alpha cannot express that: the layer carries three
//! ([`Layer::coverage`]), and the composite puts each colour over the camera's own: out = L_c + (1 − A_c)·camera_c,
//! exactly. The layer's own alpha is their mean by luminance. It is above 0 where any colour is covered, so that
//! untouched pixels stay the camera's; and a composite of the exported layer by it has the right luminance over grey.
//!
//! It comes last on the layer, so that no other effect has to carry three coverages. The effects before it treat all
//! colours alike and change slowly across the picture, so the order matters only by the shift's share of that change.
//!
//! Not modelled: a spectrum within each colour (fringes have two hues), longitudinal aberration, light thinned out over
//! a larger picture (by 2a). Red and blue are interpolated linearly and get softer, as by a blur with a variance of at
//! most 1/4 px².

use glam::DVec2;

use super::{Case, Effect, EffectError, LayerRun, Moment, Reach};
use crate::camera::falloff::Lateral;
use crate::camera::{Camera, Geometry};
use crate::gpu::Shader;
use crate::params::Value;
use crate::render::{COLOR, Layer};

crate::params! {
    /// Parameters of the chromatic aberration.
    pub struct ChromaticAberration in "chromatic_aberration" {
        "how much larger red is than green: 0.001 is 1 px in 1000 from the principal point"
        red: f64 = 0.0, "1", -0.02..=0.02;
        "cubic part of red: what is added to that at half a diagonal, growing with the square"
        red_cubic: f64 = 0.0, "1", -0.02..=0.02;
        "how much larger blue is than green"
        blue: f64 = 0.0, "1", -0.02..=0.02;
        "cubic part of blue"
        blue_cubic: f64 = 0.0, "1", -0.02..=0.02;
    }
}

crate::uniform! {
    struct Uniform {
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

    /// The largest shift of a colour, px.
    fn shift_px(&self, moment: &Moment<'_>) -> f32 {
        let (middle, half_diagonal) = (middle_px(moment.picture), of_whole_px(moment));
        let i = &moment.picture.intrinsics;
        let size = DVec2::new(f64::from(i.width_px), f64::from(i.height_px));
        let farthest = middle.abs().max((size - middle).abs()).length();
        let r = farthest / half_diagonal;
        let shift = |part: Lateral| (part.a.abs() + part.b.abs() * r * r) * farthest;
        // The inverse shift is slightly larger; and one pixel for the interpolation.
        1.1 * shift(self.of_red()).max(shift(self.of_blue())) as f32 + 1.0
    }
}

/// Principal point of a picture, px.
fn middle_px(geometry: &Geometry) -> DVec2 {
    DVec2::new(geometry.intrinsics.cx_px, geometry.intrinsics.cy_px)
}

fn half_diagonal_px(geometry: &Geometry) -> f64 {
    let i = &geometry.intrinsics;
    0.5 * f64::from(i.width_px).hypot(f64::from(i.height_px))
}

/// Half the diagonal of the recorded camera's whole picture, of which this one may be a part, in px of this one.
fn of_whole_px(moment: &Moment<'_>) -> f64 {
    moment.capture.enlargement * half_diagonal_px(moment.capture.recorded)
}

impl Effect for ChromaticAberration {
    fn summary(&self) -> &'static str {
        "parts an object's colours towards the picture's corners as the lens does"
    }
    fn check(&self, _: &Camera, geometry: &Geometry) -> Result<(), EffectError> {
        let reason = "a 360° picture is put together and has no middle from which a lens would part colours: \
                      leave its parameters at their defaults";
        let refused = geometry.is_round() && *self != Self::default();
        if refused { Err(EffectError { parameter: "chromatic_aberration", reason }) } else { Ok(()) }
    }
    fn idles(&self) -> &'static str {
        "no colour is shifted; values other than 0 set it to work"
    }
    fn is_neutral(&self, _: &Moment<'_>) -> bool {
        *self == Self::default()
    }
    fn reach(&self, moment: &Moment<'_>) -> Reach {
        Reach::both(self.shift_px(moment))
    }
    fn cases(&self) -> Vec<Case> {
        vec![("", vec![("red", Value::Number(0.001)), ("blue", Value::Number(-0.001))])]
    }

    fn run(&self, run: &mut LayerRun<'_>, layer: Layer) -> Layer {
        let (middle, half_diagonal) = (middle_px(run.moment.picture), of_whole_px(run.moment));
        let in_layer = middle - DVec2::new(f64::from(run.drawn.x0), f64::from(run.drawn.y0));
        let parts = |part: Lateral| [part.a as f32, part.b as f32];
        let uniform = Uniform {
            middle: in_layer.as_vec2().to_array(),
            red: parts(self.of_red()),
            blue: parts(self.of_blue()),
            size: [layer.size.0 as i32, layer.size.1 as i32],
            per_diagonal: half_diagonal.recip() as f32,
        };
        let pass = run.recorder.pass(Shader::ChromaticAberration, "main").uniform("chromatic", &uniform);
        let [color, coverage] = pass.texture("layer", &layer.color).draw([COLOR, COLOR], layer.size);
        let radius_px = self.shift_px(run.moment).ceil() as u32;
        run.followed(Layer { color, coverage: Some(coverage), ..layer }, radius_px)
    }
}

/// Where the light of a colour that lands at a place comes from, px: the inverse of [`Lateral::displaced_px`].
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

/// A layer with parted colours: the premultiplied light and the coverage of each colour. `rgba` has `width * height`
/// premultiplied pixels of the whole picture; outside is empty.
pub fn twin(params: &ChromaticAberration, geometry: &Geometry, rgba: &[[f64; 4]]) -> Vec<[[f64; 3]; 2]> {
    let (width, height) = (i64::from(geometry.intrinsics.width_px), i64::from(geometry.intrinsics.height_px));
    let (middle, half_diagonal) = (middle_px(geometry), half_diagonal_px(geometry));
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
        fn what_is_displaced_comes_from_there(
            a in -0.02f64..0.02, b in -0.02f64..0.02, x in -100.0f64..700.0, y in -100.0f64..600.0,
        ) {
            let (part, middle) = (Lateral { a, b }, DVec2::new(310.0, 250.0));
            let at = DVec2::new(x, y);
            let there = part.displaced_px(at, middle, 400.0);
            prop_assert!((source_px(part, there, middle, 400.0) - at).length() < 1e-9);
        }
    }
}
