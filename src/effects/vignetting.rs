//! Vignetting: light falls off towards the picture's corners (camera/falloff.rs).
//!
//! gain = cos⁴θ to the power `natural`, times the share of the aperture that a rim leaves free. It
//! multiplies the layer's light. Coverage stays, except outside a circular fisheye's image circle,
//! where the camera's pixels are black. The rim acts on the aperture of `camera.lens`, so stopping
//! down removes its effect. The gain is computed at the corners of 128 cells across the picture and
//! interpolated: within 1e-4 for the natural part of a lens with a field of view of 90°.
//!
//! Not modelled: pixel vignetting, colour shading, and the change of blurred highlights by a rim
//! (cat's eyes).

use glam::{DVec2, DVec3};

use super::{Case, Effect, EffectError, FrameContext, LayerRun};
use crate::camera::falloff::{Rim, natural};
use crate::camera::{Camera, Geometry, Opening};
use crate::gpu::{Gpu, Shader, Texture};
use crate::params::Value;
use crate::render::{COLOR, Layer};

crate::params! {
    /// Parameters of the vignetting.
    pub struct Vignetting in "vignetting" at Effects {
        "natural: fraction of the fall-off with cos⁴ of the angle: 1 is all of it; 0 is off"
        natural: f64 = 0.0, "1", 0.0..=2.0;
        "mechanical: distance of a rim in front of the aperture; 0 is off"
        rim_distance_mm: f64 = 0.0, "mm", 0.0..=1000.0, by_ratio;
        "mechanical: radius of that rim, at least that of the widest aperture"
        rim_radius_mm: f64 = 20.0, "mm", 0.1..=1000.0, by_ratio => rim_distance_mm isnt "0";
        "diameter of the image circle around the principal point, as of a circular fisheye; none: the whole picture"
        image_circle_px: Option<f64> = None, "px", 1.0..=131072.0, by_ratio;
    }
}

impl Vignetting {
    fn keeps_light(&self) -> bool {
        self.natural == 0.0 && self.rim_distance_mm == 0.0
    }

    fn is_off(&self) -> bool {
        self.keeps_light() && self.image_circle_px.is_none()
    }

    /// Radius of the image circle in the output picture, px.
    fn circle_px(&self, context: &FrameContext<'_>) -> f64 {
        let [made, recorded] = [context.picture, &context.capture.recorded].map(|geometry| geometry.intrinsics.fx_px);
        self.image_circle_px.map_or(NO_CIRCLE_PX, |px| 0.5 * px * made / recorded)
    }

    fn rim(&self) -> Rim {
        Rim { distance_m: 1e-3 * self.rim_distance_mm, radius_m: 1e-3 * self.rim_radius_mm }
    }
}

/// Larger than any picture: no image circle.
const NO_CIRCLE_PX: f64 = 1e9;
/// Number of cells across the picture.
const CELLS: u32 = 128;

/// Key of the gain over a picture.
#[derive(Clone, Debug, PartialEq)]
struct GainKey {
    geometry: Geometry,
    opening: Option<Opening>,
    params: Vignetting,
}

/// The gain over a picture.
#[derive(Clone, Debug)]
struct GainGrid {
    gains: Texture,
    cells: [u32; 2],
}

crate::uniform! {
    struct VignettingUniform {
        cell_share: [f32; 2],
        cells: [f32; 2],
        in_picture: [i32; 2],
        circle_at: [f32; 2],
        circle_radius: f32,
    }
}

impl GainGrid {
    fn new(gpu: &Gpu, of: &GainKey) -> Self {
        let picture = [of.geometry.intrinsics.width_px, of.geometry.intrinsics.height_px];
        let down = (f64::from(CELLS) * f64::from(picture[1]) / f64::from(picture[0])).ceil() as u32;
        let cells = [CELLS, down.clamp(1, 4 * CELLS)];
        let texels: Vec<f32> = (0..=cells[1])
            .flat_map(|y| (0..=cells[0]).map(move |x| [x, y]))
            .map(|corner| {
                let [x, y] = [0, 1].map(|i| f64::from(corner[i]) / f64::from(cells[i]) * f64::from(picture[i]));
                gain(&of.params, &of.geometry, of.opening, DVec2::new(x, y)) as f32
            })
            .collect();
        let (columns, rows) = (cells[0] + 1, cells[1] + 1);
        let gains = Texture::new(gpu, "vignetting", columns, rows, wgpu::TextureFormat::R32Float, 1);
        gains.write(gpu, columns, rows, &texels);
        Self { gains, cells }
    }
}

impl Effect for Vignetting {
    fn summary(&self) -> &'static str {
        "darkens objects towards the picture's corners as the lens does"
    }
    fn check(&self, _: &Camera, geometry: &Geometry) -> Result<(), EffectError> {
        let reason = "a 360° picture is put together and has no middle from which a lens would darken it: \
                      leave its parameters at their defaults";
        let refused = geometry.is_equirectangular() && !self.is_off();
        if refused { Err(EffectError { parameter: "vignetting", reason }) } else { Ok(()) }
    }
    fn neutral_hint(&self) -> &'static str {
        "all of it is off; natural vignetting or one of its rims enables it"
    }
    fn is_neutral(&self, _: &FrameContext<'_>) -> bool {
        self.is_off()
    }
    fn cases(&self) -> Vec<Case> {
        vec![("", vec![("natural", Value::Number(1.0))])]
    }

    fn run(&self, run: &mut LayerRun<'_>, layer: Layer) -> Layer {
        let context = run.context;
        let params = Self { image_circle_px: None, ..self.clone() };
        let of = GainKey { geometry: context.picture.clone(), opening: context.capture.opening, params };
        let grid = run.recorder.memoized_large(of, GainGrid::new);
        let i = &context.picture.intrinsics;
        let [across, down] = grid.cells.map(|cells| cells as f32);
        let uniform = VignettingUniform {
            cell_share: [across / i.width_px as f32, down / i.height_px as f32],
            cells: [across, down],
            in_picture: [run.drawn.x0, run.drawn.y0],
            circle_at: [i.cx_px as f32, i.cy_px as f32],
            circle_radius: self.circle_px(context) as f32,
        };
        let pass = run.recorder.pass(Shader::Vignetting, "main").uniform("vignetting", &uniform);
        let [color] = pass.texture("layer", &layer.color).texture("gains", &grid.gains).draw([COLOR], layer.size);
        Layer { color, ..layer }
    }
}

/// The gain on light at a position in the picture (px), 0 to 1. 0 outside the lens's field of view.
fn gain(params: &Vignetting, geometry: &Geometry, opening: Option<Opening>, at_px: DVec2) -> f64 {
    if params.keeps_light() {
        return 1.0;
    }
    let Some(ray) = geometry.unproject(at_px) else { return 0.0 };
    let ray = ray.truncate();
    let rim = params.rim();
    let free = if rim.distance_m > 0.0 { rim.gain(opening.map_or(0.0, |o| o.diameter_m), ray) } else { 1.0 };
    natural(ray).powf(params.natural) * free
}

/// The gain by the angle itself, and by counting the points of the aperture that the light passes,
/// on a grid of 96 across: within 2e-3.
pub fn twin(params: &Vignetting, geometry: &Geometry, opening: Option<Opening>, at_px: DVec2) -> f64 {
    let Some(ray) = geometry.unproject(at_px) else { return 0.0 };
    let radius_m = 0.5 * opening.map_or(0.0, |o| o.diameter_m);
    let coordinate = |i: u32| (f64::from(i) + 0.5) / 48.0 - 1.0;
    let opening =
        (0..96 * 96).map(|i| DVec2::new(coordinate(i % 96), coordinate(i / 96))).filter(|p| p.length() <= 1.0);
    let (mut points, mut seeing) = (0u32, 0u32);
    for point in opening {
        points += 1;
        seeing += u32::from(params.rim().passes(radius_m * point, ray.truncate() / ray.z));
    }
    let free = if params.rim_distance_mm > 0.0 { f64::from(seeing) / f64::from(points) } else { 1.0 };
    ray.angle_between(DVec3::Z).cos().powf(4.0 * params.natural) * free
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};

    #[test]
    fn gain_matches_hand_computed_values() {
        let geometry = Geometry::new(Intrinsics { width_px: 2000, ..Default::default() }, Distortion::default());
        // 525 px from the middle is 45°: cos⁴ is 1/4; half the power (cos²) is 1/2.
        let at = DVec2::new(320.0 + 525.0, 240.0);
        let gain = |natural, rim_distance_mm, opening| {
            let params = Vignetting { natural, rim_distance_mm, rim_radius_mm: 10.0, image_circle_px: None };
            super::gain(&params, &geometry, opening, at)
        };
        assert!((gain(1.0, 0.0, None) - 0.25).abs() < 1e-12);
        assert!((gain(0.5, 0.0, None) - 0.5).abs() < 1e-12);
        // A rim of the opening's own radius, 10 mm, seen shifted by 10 mm: (2π/3 − √3/2)/π.
        let opening = Opening { diameter_m: 0.02, focus_distance_m: 1.0, blades: 0, rotation_rad: 0.0 };
        assert!((gain(0.0, 10.0, Some(opening)) - 0.391_002).abs() < 1e-6);
        assert!((gain(1.0, 10.0, Some(opening)) - 0.25 * 0.391_002).abs() < 1e-6);
        // Stopped down to a point, the rim blocks either nothing or everything.
        assert_eq!((gain(0.0, 9.9, None), gain(0.0, 10.1, None)), (1.0, 0.0));
    }
}
