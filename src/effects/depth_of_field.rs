//! Depth of field from the lens.
//!
//! A point at depth z is imaged as the opening, fx · D · (1/d_s − 1/z) pixels wide, upside down in front of the focus
//! plane (vSLRcam (4)-(8); camera/thin_lens.rs). The lens is the camera's (`camera.lens`). Without an opening nothing
//! is blurred.
//!
//! - `layered` (default): gathers over the image of the opening, keeping the nearer of two surfaces apart from the
//!   farther. What the nearer one hides is filled from what is seen around it. The nearer one's own blurred alpha puts
//!   both together (depth_of_field/layered.rs).
//! - `reference`: the thin lens itself. The layer is drawn through many points of the opening and summed, at least two
//!   for each square pixel of the largest circle, up to 16,384. Slow; the others are judged by it.
//! - `poisson`: vSLRcam's, a Poisson disc as wide as the pixel's own circle, then a second one over the result
//!   (depth_of_field/poisson.rs).
//! - `diffusion`: Wang's. Each pixel's light is spread over the opening's picture, from the most blurred to the
//!   sharpest. The only one with stars and hearts (depth_of_field/diffusion.rs).
//!
//! In a photograph whose real surfaces are known, the real part is blurred too, slice by slice; with `layered`,
//! together with the virtual part (depth_of_field/slices.rs).
//!
//! Not modelled: the opening's change towards the picture's corners (cat's eyes), aberrations, diffraction. With
//! `layered` also: more than two surfaces behind each other within one circle, and circles wider than a quarter of the
//! picture or 400 px (drawn that wide).

pub mod diffusion;
mod highlights;
mod image;
mod layered;
pub mod operator;
pub mod poisson;
mod settings;
pub mod slices;
mod surroundings;

use super::{Case, Effect, EffectError, LayerRun, Moment, OnReal, Reach};
use crate::camera::{Aperture, Camera, Geometry};
use crate::params::Value;
use crate::render::{Layer, Sample, SamplePlan};
use operator::Shape;
pub use settings::{DepthOfField, Method, Mix, WIDEST_PX};
use settings::{SHARP_PX, circles_px};

const MOST_POINTS: u32 = 1 << 14;

impl DepthOfField {
    /// Points of the opening for each moment already in the plan.
    fn reference(moment: &Moment<'_>, plan: SamplePlan) -> SamplePlan {
        let Some(opening) = moment.capture.opening else { return plan };
        let [_, largest] = circles_px(moment);
        let area = std::f32::consts::FRAC_PI_4 * largest * largest;
        let moments = plan.samples.len() as u32;
        // Equally many for each moment, so that the weights of the moments stay the same.
        let each = ((2.0 * area).ceil() as u32).clamp(64, MOST_POINTS).div_ceil(moments);
        let aperture = Aperture::of(&opening);
        let radius_m = 0.5 * opening.diameter_m;
        let samples = plan.samples.iter().enumerate().flat_map(|(moment, sample)| {
            let aperture = &aperture;
            (0..each).map(move |i| Sample {
                weight: sample.weight / each as f32,
                lens_m: aperture.sequence(moment as u32 * each + i).map(|c| c * radius_m),
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
    fn idles(&self) -> &'static str {
        "everything is in focus, as through a pinhole; an f-number or an opening of the camera's lens, or another focus \
         distance, sets it to work"
    }
    fn is_neutral(&self, moment: &Moment<'_>) -> bool {
        circles_px(moment)[1] < SHARP_PX
    }
    fn check(&self, camera: &Camera, geometry: &Geometry) -> Result<(), EffectError> {
        let lens = &camera.lens;
        if geometry.sees_around() && (lens.f_number.is_some() || lens.aperture_diameter_mm.is_some_and(|d| d > 0.0)) {
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
    fn reach(&self, moment: &Moment<'_>) -> Reach {
        let own_px = match self.method {
            Method::Diffusion => diffusion::reach_px(self, moment),
            Method::Layered => layered::look_px(moment),
            Method::Poisson | Method::Reference => layered::reach_px(moment),
        };
        // The real part is blurred slice by slice whatever the method; `layered` includes the virtual part.
        Reach::both(match (moment.real_depths_m, self.method) {
            (None, _) => own_px,
            (Some(_), Method::Layered) => slices::reach_px(moment),
            (Some(_), _) => own_px.max(slices::reach_px(moment)),
        })
    }
    fn cases(&self) -> Vec<Case> {
        // The benchmark's lens is a pinhole; the cost over a whole picture is measured separately.
        ["layered", "poisson", "diffusion", "reference"]
            .map(|m| (m, vec![("method", Value::Text(m.to_owned()))]))
            .to_vec()
    }

    fn plan(&self, moment: &Moment<'_>, plan: SamplePlan) -> SamplePlan {
        match self.method {
            Method::Layered | Method::Poisson | Method::Diffusion => plan,
            Method::Reference => Self::reference(moment, plan),
        }
    }

    fn reads_geometry(&self) -> bool {
        true
    }

    fn on_real(&self) -> OnReal {
        match self.method {
            Method::Layered => OnReal::ActsAndHides,
            Method::Poisson | Method::Diffusion => OnReal::Acts,
            // Each point of the lens draws what is seen from there.
            Method::Reference => OnReal::ActsAlone,
        }
    }

    fn run(&self, run: &mut LayerRun<'_>, mut layer: Layer) -> Layer {
        let Some(opening) = run.moment.capture.opening else { return layer };
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

/// A layer of one depth through an opening: each pixel's light spread evenly over the image of the aperture,
/// `circle_px` wide (signed), by `points` points with bilinear weights. `rgba` has `width * height` premultiplied
/// pixels; outside is empty.
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
