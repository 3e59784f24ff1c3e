//! Point spread: the blur of lens and sensor in focus, as one measured width.
//!
//! A Gaussian of `sigma_px` over premultiplied light and coverage (blur.rs), whose variance is σ²:
//! an edge that the renderer has covered by area becomes as wide as the camera's, from 0.8 px on. σ
//! is an edge's 10-90 % width divided by 2.563.
//!
//! Not modelled: a width that varies over the picture, with colour or with the aperture; tails
//! (veiling glare); the camera's own sharpening of edges; the coarseness of the renderer's four
//! samples per pixel compared with areas.

use super::{Case, Effect, FrameContext, LayerRun, OnReal, Reach, blur};
use crate::params::Value;
use crate::render::Layer;

crate::params! {
    /// Parameters of the point spread.
    pub struct PointSpread in "point_spread" at Effects {
        "standard deviation of the blur of lens and sensor: 0.39 times an edge's 10-90 % width; 0 is off; at most 8 px in an enlarged photograph"
        sigma_px as "Sharpness (lens blur)": f64 = 0.0, "px", 0.0..=8.0;
    }
}

impl PointSpread {
    /// σ in the output picture. An enlargement also enlarges the camera's blur; at most 8 px.
    fn drawn_px(&self, context: &FrameContext<'_>) -> f64 {
        context.drawn_px(self.sigma_px).min(blur::MAX_DIRECT_SIGMA_PX)
    }
}

impl Effect for PointSpread {
    fn summary(&self) -> &'static str {
        "blurs objects as lens and sensor do in focus"
    }
    fn neutral_hint(&self) -> &'static str {
        "its blur reaches no neighbouring pixel; a larger lens blur enables it"
    }
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool {
        // No tap reaches the neighbours.
        blur::reach_px(self.drawn_px(context)) == 0
    }
    fn reach(&self, context: &FrameContext<'_>) -> Reach {
        Reach::both(blur::reach_px(self.drawn_px(context)) as f32)
    }
    fn cases(&self) -> Vec<Case> {
        vec![("", vec![("sigma_px", Value::Number(0.7))])]
    }
    fn on_real(&self) -> OnReal {
        OnReal::BlursVirtual
    }
    fn run(&self, run: &mut LayerRun<'_>, layer: Layer) -> Layer {
        let sigma_px = self.drawn_px(run.context);
        let color = run.blurred(&layer.color, layer.size, sigma_px);
        run.with_spread_geometry(Layer { color, ..layer }, blur::reach_px(sigma_px))
    }
}

/// Set σ and σ measured on an edge drawn with it, px: mean of edges slanted by 5 to 40°. They
/// differ for few taps, which are no Gaussian.
const SET_AND_MEASURED_PX: [(f64, f64); 9] = [
    (0.0, 0.0),
    (0.15, 0.0845),
    (0.2, 0.1209),
    (0.3, 0.2093),
    (0.4, 0.3135),
    (0.5, 0.4346),
    (0.6, 0.566),
    (0.7, 0.6882),
    (0.8, 0.797),
];

/// The `sigma_px` to set for edges that measure `measured_px`.
pub fn sigma_for_measured_px(measured_px: f64) -> f64 {
    let after = SET_AND_MEASURED_PX.partition_point(|(_, measured)| *measured <= measured_px);
    let (Some((a, from)), Some((b, to))) =
        (SET_AND_MEASURED_PX.get(after.wrapping_sub(1)), SET_AND_MEASURED_PX.get(after))
    else {
        return measured_px.clamp(0.0, blur::MAX_DIRECT_SIGMA_PX);
    };
    a + (b - a) * (measured_px - from) / (to - from)
}

/// A blurred layer. `rgba` has `width * height` premultiplied pixels; outside is empty.
pub fn twin(rgba: &[[f64; 4]], width: usize, height: usize, sigma_px: f64) -> Vec<[f64; 4]> {
    let taps = blur::taps(sigma_px);
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
