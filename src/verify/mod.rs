//! Verifies that virtual objects match real ones: frames of a recording are composited as objects
//! into other frames of it.
//!
//! The whole pipeline runs, with the recorded values and with the estimates of an analysis
//! ([`crate::analyse`]). Registration is measured by phase correlation of patches, brightness by
//! the luma of small flat areas. From both the noise floor is subtracted, which is the result for
//! two frames at rest ([`noise_floor`]). Noise and blur are off, because the source frame already
//! contains them. Motion blur, sharpness and noise have measurements of their own.

mod blur;
mod error;
mod flat_patches;
mod frame_scene;
mod noise;
mod noise_figures;
mod noise_floor;
mod noise_lines;
mod sharpness;

use std::sync::Arc;

pub use blur::{BlurRatio, blur};
pub use error::VerifyError;
pub use frame_scene::frame_scene;
pub use noise::{NoiseComparison, NoiseNotCompared, NoiseScore, noise};
pub use noise_figures::{NoiseFigures, RealAndVirtual, SigmaBin};
pub use noise_floor::DisplacementSummary;
pub use sharpness::{real_px, sharpness_px};

use noise_floor::{luma_sigma, with_noise};

use crate::camera::NoiseProfile;
use crate::fit::quantile::upper_median;
use crate::gpu::Gpu;
use crate::grey_image::GreyImage;
use crate::measure::displacement::{DisplacementOptions, Displacements, displacements};
use crate::pixels::Pixels;
use crate::shot::Shot;

/// Side of a patch, px. It is much larger than the displacements, which can be 10 px.
const PATCH_PX: usize = 64;
/// Half-width of the areas over which luma is averaged, px.
const AREA_RADIUS_PX: i64 = 2;
/// Largest standard deviation of a flat area's luma, and largest mean, codes.
const MAX_FLAT_SIGMA: f64 = 4.0;
const MAX_MEAN_CODE: f64 = 235.0;
/// Smallest contrast of a patch by the noise's σ.
const MIN_CONTRAST_TO_NOISE: f64 = 2.0;
/// Smallest number of patches in a pair.
const MIN_PATCHES: usize = 4;

/// The compared pairs of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VerificationPlan {
    /// One frame in this many becomes an object.
    pub every: usize,
    /// Distance of the frames before and after into which it is composited.
    pub gap: usize,
}

impl Default for VerificationPlan {
    fn default() -> Self {
        Self { every: 10, gap: 8 }
    }
}

/// Differences of the luma of flat areas, 8-bit codes, by the medians of the pairs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brightness {
    /// The median and the largest of the pairs, as measured.
    pub measured: (f64, f64),
    /// Median difference of two frames at rest by noise. `None` without the camera's noise, or
    /// without flat areas at rest.
    pub floor: Option<f64>,
    /// Without the floor, in quadrature: median and largest.
    pub codes: (f64, f64),
}

impl Brightness {
    fn of(measured: &[f64], at_rest: &[f64]) -> Option<Self> {
        let median = upper_median(measured.iter().copied())?;
        let largest = measured.iter().copied().max_by(f64::total_cmp)?;
        let floor = upper_median(at_rest.iter().copied());
        let without = |codes: f64| (codes.powi(2) - floor.unwrap_or(0.0).powi(2)).max(0.0).sqrt();
        Some(Self { measured: (median, largest), floor, codes: (without(median), without(largest)) })
    }
}

/// Deviations of virtual objects from real ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verification {
    /// Number of measured pairs.
    pub pairs: usize,
    /// Number of pairs with texture above the noise but too few matching patches.
    pub unmatched: usize,
    /// Lengths of the patches' displacements.
    pub displaced: Option<DisplacementSummary>,
    /// `None` without flat areas.
    pub brightness: Option<Brightness>,
    /// `None` without fast camera motion.
    pub blur: Option<BlurRatio>,
    /// σ of rendered edges, px.
    pub sharpness_px: Option<f64>,
}

/// Verifies a recording as it was opened. `report(done, of)` receives the progress.
pub fn verify(
    gpu: &Gpu,
    by: &Shot,
    plan: VerificationPlan,
    mut report: impl FnMut(usize, usize),
) -> Result<Verification, VerifyError> {
    let mut shot = by.clone();
    shot.settings.plain();
    let _ = shot.settings.switch("exposure", true);
    let count = shot.recording.frame_count();
    let blur_px = blur::lengths_px(&shot);
    let from = sharpest_frames(&blur_px, plan.every.max(1));
    let steps = from.len() + blur::MAX_PAIRS;
    let noise = by.camera().noise;
    let mut compositor = shot.compositor(gpu.clone());
    let (mut displaced, mut at_rest) = (Vec::new(), Vec::new());
    let (mut brighter, mut brighter_at_rest) = (Vec::new(), Vec::new());
    let (mut pairs, mut unmatched) = (0, 0);
    let lengths = |of_patches: &Displacements| -> Vec<f64> {
        of_patches.patches.iter().map(|patch| patch.displacement_px[0].hypot(patch.displacement_px[1])).collect()
    };
    for (done, n) in from.iter().enumerate() {
        report(done, steps);
        let frame = shot.read(*n)?;
        let options = patch_options(&frame.pixels, noise.as_ref());
        let Some(scene) = frame_scene(&shot, &frame) else { continue };
        compositor.set_scene(scene.clone());
        shot.scene = Arc::new(scene);
        if let Some(profile) = &noise
            && let Some(made) = shot.frames(&mut compositor, *n..n + 1, true, 1)?.next().transpose()?
            && let Some(layer) = made.layer
        {
            let mask: Vec<bool> = layer.rgba.iter().map(|p| p[3] > 0.999).collect();
            let seed = 2 * *n as u64;
            let real = with_noise(&GreyImage::luma_709(&frame.pixels), profile, seed);
            let made = with_noise(&GreyImage::luma_709(&made.pixels), profile, seed + 1);
            at_rest.extend(lengths(&displacements(&real, &made, Some(&mask), &options)?));
            brighter_at_rest.extend(difference(&real, &made, &mask));
        }
        for to in [n.checked_sub(plan.gap), Some(n + plan.gap)].into_iter().flatten().filter(|to| *to < count) {
            let real = shot.read(to)?.pixels;
            let Some(made) = shot.frames(&mut compositor, to..to + 1, true, 1)?.next().transpose()? else { continue };
            let Some(layer) = made.layer else { continue };
            let mask: Vec<bool> = layer.rgba.iter().map(|p| p[3] > 0.999).collect();
            let (real, made) = (GreyImage::luma_709(&real), GreyImage::luma_709(&made.pixels));
            let of_patches = displacements(&real, &made, Some(&mask), &options)?;
            if of_patches.patches.len() >= MIN_PATCHES {
                displaced.extend(lengths(&of_patches));
                pairs += 1;
            } else if of_patches.patches.len() + of_patches.unreliable >= MIN_PATCHES {
                unmatched += 1;
            }
            brighter.extend(difference(&real, &made, &mask));
        }
    }
    Ok(Verification {
        pairs,
        unmatched,
        displaced: DisplacementSummary::of(&mut displaced, &mut at_rest),
        brightness: Brightness::of(&brighter, &brighter_at_rest),
        blur: blur(by, &mut compositor, &blur_px, &mut |done| report(from.len() + done, steps))?,
        sharpness_px: sharpness_px(by, &mut compositor)?,
    })
}

/// Patches whose contrast is well above the camera's noise.
fn patch_options(pixels: &Pixels, noise: Option<&NoiseProfile>) -> DisplacementOptions {
    let usual = DisplacementOptions { patch_px: PATCH_PX, step_px: PATCH_PX / 2, ..Default::default() };
    let luma = GreyImage::luma_709(pixels).values;
    let mean = luma.iter().sum::<f64>() / luma.len().max(1) as f64;
    let sigma = noise.map_or(0.0, |profile| luma_sigma(profile, mean));
    DisplacementOptions { min_contrast: usual.min_contrast.max(MIN_CONTRAST_TO_NOISE * sigma), ..usual }
}

/// The frame with the shortest motion blur of every `every` frames. `blur_px`: blur of each frame.
/// The blur of the source frame displaces an object's edges.
fn sharpest_frames(blur_px: &[Option<f64>], every: usize) -> Vec<usize> {
    let px = |n: usize| blur_px[n].unwrap_or(f64::INFINITY);
    let parts = (0..blur_px.len()).step_by(every).map(|from| from..(from + every).min(blur_px.len()));
    parts.filter_map(|part| part.min_by(|a, b| px(*a).total_cmp(&px(*b)))).collect()
}

/// Median absolute difference of flat areas' luma within `mask`, codes. `None` without flat areas.
fn difference(real: &GreyImage<f64>, made: &GreyImage<f64>, mask: &[bool]) -> Option<f64> {
    let area = |of: &GreyImage<f64>, x: i64, y: i64| {
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        for value in (-AREA_RADIUS_PX..=AREA_RADIUS_PX)
            .flat_map(|dy| (-AREA_RADIUS_PX..=AREA_RADIUS_PX).map(move |dx| of.clamped(x + dx, y + dy)))
        {
            (sum, squares, count) = (sum + value, squares + value * value, count + 1.0);
        }
        let mean = sum / count;
        (mean, (squares / count - mean * mean).max(0.0).sqrt())
    };
    let reach = AREA_RADIUS_PX as usize;
    let mut off = Vec::new();
    for y in (reach..real.height.saturating_sub(reach)).step_by(3) {
        for x in (reach..real.width.saturating_sub(reach)).step_by(3) {
            if !mask[y * real.width + x] {
                continue;
            }
            let ((there, spread), (here, made_spread)) =
                (area(real, x as i64, y as i64), area(made, x as i64, y as i64));
            if spread.max(made_spread) < MAX_FLAT_SIGMA && there.max(here) < MAX_MEAN_CODE {
                off.push((there - here).abs());
            }
        }
    }
    upper_median(off)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sharpest_frames_prefer_a_known_blur() {
        let px = [Some(3.0), None, Some(2.0), None, None, Some(0.0), Some(1.0)];
        assert_eq!(sharpest_frames(&px, 3), [2, 5, 6]);
        assert_eq!(sharpest_frames(&[None; 4], 2), [0, 2], "the first where nothing is known");
    }

    #[test]
    fn noise_floor_is_subtracted_in_quadrature() {
        let brightness = Brightness::of(&[1.5, 1.3, 2.5], &[1.2, 0.9, 1.3]).unwrap();
        assert_eq!((brightness.measured, brightness.floor), ((1.5, 2.5), Some(1.2)));
        // √(1.5² − 1.2²), and √(2.5² − 1.2²).
        assert!((brightness.codes.0 - 0.9).abs() < 1e-12 && (brightness.codes.1 - 4.81f64.sqrt()).abs() < 1e-12);
        let unknown = Brightness::of(&[1.5], &[]).unwrap();
        assert_eq!((unknown.codes, unknown.floor), ((1.5, 1.5), None));
        assert_eq!(Brightness::of(&[1.0], &[2.0]).unwrap().codes, (0.0, 0.0));
        assert_eq!(Brightness::of(&[], &[1.0]), None);
    }
}
