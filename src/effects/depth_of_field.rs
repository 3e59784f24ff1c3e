//! Depth of field from the lens.
//!
//! A point at depth z is imaged as the aperture, fx · D · (1/d_s − 1/z) pixels wide (its circle of
//! confusion), upside down in front of the focus plane (vSLRcam (4)-(8); camera/thin_lens.rs). The
//! lens is the camera's (`camera.lens`). Without an aperture nothing is blurred.
//!
//! - `layered` (default): gathers over the image of the aperture, in two layers, the nearer and the
//!   farther of two surfaces. The hidden part of the farther one is filled from its surroundings.
//!   The nearer one's blurred alpha composites both (depth_of_field/layered.rs).
//! - `reference`: the thin lens itself. The layer is drawn through many points of the aperture and
//!   summed, at least two for each square pixel of the largest circle, up to 16,384. Slow; the
//!   ground truth of the other methods.
//! - `poisson`: vSLRcam's, a Poisson disc as wide as the pixel's own circle, then a second one over
//!   the result (depth_of_field/poisson.rs).
//! - `diffusion`: Wang's. Each pixel's light is spread over the aperture's image, from the most
//!   blurred to the sharpest. The only one with stars and hearts (depth_of_field/diffusion.rs).
//!
//! In a photograph whose real surfaces are known, the real part is blurred too, slice by slice;
//! with `layered`, together with the virtual part (depth_of_field/slices.rs).
//!
//! Not modelled: the aperture's change towards the picture's corners (cat's eyes), aberrations,
//! diffraction. With `layered` also: more than two surfaces behind each other within one circle,
//! and circles wider than a quarter of the picture or 400 px (limited to that width).

pub mod diffusion;
mod highlights;
mod image;
mod layered;
pub mod operator;
pub mod poisson;
mod settings;
pub mod slices;
mod surroundings;

use super::{Case, Effect, EffectError, FrameContext, LayerRun, OnReal, Reach};
use crate::camera::{Aperture, Camera, Geometry};
use crate::params::Value;
use crate::render::{Layer, RenderSample, SamplePlan};
use operator::Shape;
pub use settings::{DepthOfField, MAX_CIRCLE_PX, Method, Mix};
use settings::{SHARP_PX, circles_px};

/// Largest number of points of the aperture in the reference.
const MAX_POINTS: u32 = 1 << 14;

impl DepthOfField {
    /// Multiplies each sample of the plan by points of the aperture.
    fn reference(context: &FrameContext<'_>, plan: SamplePlan) -> SamplePlan {
        let Some(opening) = context.capture.opening else { return plan };
        let [_, largest] = circles_px(context);
        let area = std::f32::consts::FRAC_PI_4 * largest * largest;
        let count = plan.samples.len() as u32;
        // Equally many points for each sample, so that the weights of the samples stay the same.
        let each = ((2.0 * area).ceil() as u32).clamp(64, MAX_POINTS).div_ceil(count);
        let aperture = Aperture::of(&opening);
        let radius_m = 0.5 * opening.diameter_m;
        let samples = plan.samples.iter().enumerate().flat_map(|(n, sample)| {
            let aperture = &aperture;
            (0..each).map(move |i| RenderSample {
                weight: sample.weight / each as f32,
                lens_m: aperture.sequence(n as u32 * each + i).map(|c| c * radius_m),
                ..sample.clone()
            })
        });
        SamplePlan { samples: samples.collect(), focus_distance_m: opening.focus_distance_m }
    }
}

impl Effect for DepthOfField {
    fn summary(&self) -> &'static str {
        "blurs objects out of focus as the lens's opening does"
    }
    fn neutral_hint(&self) -> &'static str {
        "everything is in focus, as through a pinhole; an f-number or an opening of the camera's lens, or another focus \
         distance, enables it"
    }
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool {
        circles_px(context)[1] < SHARP_PX
    }
    fn check(&self, camera: &Camera, geometry: &Geometry) -> Result<(), EffectError> {
        let lens = &camera.lens;
        if geometry.needs_cube_map() && (lens.f_number.is_some() || lens.aperture_diameter_mm.is_some_and(|d| d > 0.0))
        {
            return Err(EffectError {
                parameter: "depth_of_field",
                reason: "a picture of 170° and more has none here: leave camera.lens.f_number and aperture_diameter_mm \
                         out, or give --without depth_of_field",
            });
        }
        if self.shape != Shape::Lens && self.method != Method::Diffusion {
            return Err(EffectError {
                parameter: "depth_of_field.shape",
                reason: "star and heart are drawn by depth_of_field.method = diffusion alone; accepted with this method is lens",
            });
        }
        Ok(())
    }
    fn reach(&self, context: &FrameContext<'_>) -> Reach {
        let own_px = match self.method {
            Method::Diffusion => diffusion::reach_px(self, context),
            Method::Layered => layered::read_px(context),
            Method::Poisson | Method::Reference => layered::reach_px(context),
        };
        // The real part is blurred slice by slice whatever the method; `layered` includes the
        // virtual part.
        Reach::both(match (context.real_depths_m, self.method) {
            (None, _) => own_px,
            (Some(_), Method::Layered) => slices::reach_px(context),
            (Some(_), _) => own_px.max(slices::reach_px(context)),
        })
    }
    fn cases(&self) -> Vec<Case> {
        // The benchmark's lens is a pinhole; the cost over a whole picture is measured separately.
        ["layered", "poisson", "diffusion", "reference"]
            .map(|m| (m, vec![("method", Value::Text(m.to_owned()))]))
            .to_vec()
    }

    fn plan(&self, context: &FrameContext<'_>, plan: SamplePlan) -> SamplePlan {
        match self.method {
            Method::Layered | Method::Poisson | Method::Diffusion => plan,
            Method::Reference => Self::reference(context, plan),
        }
    }

    fn reads_geometry(&self) -> bool {
        true
    }

    fn on_real(&self) -> OnReal {
        match self.method {
            Method::Layered => OnReal::ActsAndOccludes,
            Method::Poisson | Method::Diffusion => OnReal::ActsAndBlurs,
            // Occlusion is resolved for each point of the lens.
            Method::Reference => OnReal::Acts,
        }
    }

    fn run(&self, run: &mut LayerRun<'_>, mut layer: Layer) -> Layer {
        let Some(opening) = run.context.capture.opening else { return layer };
        if let Some(real) = layer.real.clone() {
            let together = self.method == Method::Layered;
            layer = slices::run(run, &opening, layer, &real, together);
            if together {
                return layer;
            }
        }
        match self.method {
            Method::Layered => layered::run(run, &opening, layer),
            Method::Poisson => poisson::run(run, self.points as usize, &opening, layer),
            Method::Diffusion => diffusion::run(run, self, &opening, layer),
            Method::Reference => layer,
        }
    }
}

/// Reference for a layer of one depth: each pixel's light spread evenly over the image of the
/// aperture, `circle_px` wide (signed), by `points` points with bilinear weights. `rgba` has `width
/// * height` premultiplied pixels; outside is empty.
pub fn twin(
    rgba: &[[f64; 4]],
    width: usize,
    height: usize,
    circle_px: f64,
    aperture: &Aperture,
    points: u32,
) -> Vec<[f64; 4]> {
    let mut out = vec![[0.0; 4]; rgba.len()];
    for point in (0..points).map(|i| aperture.sequence(i)) {
        let [dx, dy] = point.map(|c| 0.5 * circle_px * c);
        let (x0, y0) = (dx.floor(), dy.floor());
        for (share_x, step_x) in [(1.0 - (dx - x0), 0), (dx - x0, 1)] {
            for (share_y, step_y) in [(1.0 - (dy - y0), 0), (dy - y0, 1)] {
                let (sx, sy) = (x0 as i64 + step_x, y0 as i64 + step_y);
                let share = share_x * share_y / f64::from(points);
                for (i, from) in rgba.iter().enumerate().filter(|(_, p)| p.iter().any(|&c| c != 0.0)) {
                    let (x, y) = ((i % width) as i64 + sx, (i / width) as i64 + sy);
                    if x >= 0 && y >= 0 && x < width as i64 && y < height as i64 {
                        let to = &mut out[y as usize * width + x as usize];
                        (0..4).for_each(|c| to[c] += share * from[c]);
                    }
                }
            }
        }
    }
    out
}
