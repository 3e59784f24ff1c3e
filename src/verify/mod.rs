//! Whether virtual things behave as real ones in a recording: frames of it, as things, put into other frames of it.
//!
//! The whole pipeline runs, with the recorded values and with the estimates of an analysis
//! ([`crate::analyse`]). Registration is measured by phase correlation of patches, brightness by the
//! luma of small flat areas. From both the noise floor is subtracted, which is the result for two
//! frames at rest ([`floor`]). Noise and blur are off, because the source frame already contains
//! them. Motion blur and sharpness have measurements of their own.

mod blur;
mod error;
mod floor;
mod sharpness;
mod twin;

use std::sync::Arc;

pub use blur::{Blur, blur};
pub use error::VerifyError;
pub use floor::Displaced;
pub use sharpness::{real_px, sharpness_px};
pub use twin::twin;

use floor::{luma_sigma, with_noise};

use crate::camera::NoiseProfile;
use crate::gpu::Gpu;
use crate::measure::Grey;
use crate::measure::displacement::{DisplacementOptions, Displacements, displacements};
use crate::pixels::Pixels;
use crate::shot::Shot;

/// Patches must be much larger than what they are displaced by, which may be 10 px, px.
const PATCH_PX: usize = 64;
/// Areas over which luma is averaged, px each way from the middle.
const AREA: i64 = 2;
/// An area is flat if its luma's standard deviation is below this, and tells nothing above this mean, codes.
const FLAT: f64 = 4.0;
const CLIPPED: f64 = 235.0;
/// A patch counts if its contrast is this many times the noise's σ.
const MIN_CONTRAST_TO_NOISE: f64 = 2.0;
/// A pair with fewer patches tells nothing of places.
const LEAST_PATCHES: usize = 4;

/// What is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Each so many frames one becomes a thing.
    pub every: usize,
    /// It is put into the frames so many before and after it.
    pub gap: usize,
}

impl Default for Plan {
    fn default() -> Self {
        Self { every: 10, gap: 8 }
    }
}

/// Differences of flat areas' luma, 8-bit codes: of each pair of frames the median.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brightness {
    /// The median and the largest of the pairs, as measured.
    pub measured: (f64, f64),
    /// What noise makes of two frames at rest, median. `None` without the camera's noise, or where
    /// no area counts at rest.
    pub floor: Option<f64>,
    /// Without the floor, in quadrature: median and largest.
    pub codes: (f64, f64),
}

impl Brightness {
    fn of(measured: &mut [f64], at_rest: &mut [f64]) -> Option<Self> {
        measured.sort_by(f64::total_cmp);
        at_rest.sort_by(f64::total_cmp);
        let middle = |of: &[f64]| of.get(of.len() / 2).copied();
        let (median, most) = (middle(measured)?, *measured.last()?);
        let floor = middle(at_rest);
        let without = |codes: f64| (codes.powi(2) - floor.unwrap_or(0.0).powi(2)).max(0.0).sqrt();
        Some(Self { measured: (median, most), floor, codes: (without(median), without(most)) })
    }
}

/// How far virtual is from real.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verified {
    /// Pairs of frames that told something.
    pub pairs: usize,
    /// Pairs that have texture above the noise of which too little matches.
    pub unmatched: usize,
    /// Lengths of the patches' displacements.
    pub displaced: Option<Displaced>,
    /// `None` where no area is flat.
    pub brightness: Option<Brightness>,
    /// `None` where the camera is nowhere fast.
    pub blur: Option<Blur>,
    /// σ of drawn edges, px.
    pub sharpness_px: Option<f64>,
}

/// Verifies a recording as it was opened. `seen(done, of)` hears how far it is.
pub fn verify(gpu: &Gpu, by: &Shot, plan: Plan, mut seen: impl FnMut(usize, usize)) -> Result<Verified, VerifyError> {
    let mut shot = by.clone();
    shot.settings.plain();
    let _ = shot.settings.switch("exposure", true);
    let count = shot.recording.frame_count();
    let blur_px = blur::lengths_px(&shot);
    let from = least_blurred(&blur_px, plan.every.max(1));
    let steps = from.len() + blur::PAIRS;
    let noise = by.camera().noise;
    let mut compositor = shot.compositor(gpu.clone());
    let (mut displaced, mut at_rest) = (Vec::new(), Vec::new());
    let (mut brighter, mut brighter_at_rest) = (Vec::new(), Vec::new());
    let (mut pairs, mut unmatched) = (0, 0);
    let lengths = |found: &Displacements| -> Vec<f64> {
        found.patches.iter().map(|patch| patch.displacement_px[0].hypot(patch.displacement_px[1])).collect()
    };
    for (done, n) in from.iter().enumerate() {
        seen(done, steps);
        let frame = shot.read(*n)?;
        let options = patch_options(&frame.pixels, noise.as_ref());
        let Some(scene) = twin(&shot, &frame) else { continue };
        compositor.set_scene(scene.clone());
        shot.scene = Arc::new(scene);
        if let Some(profile) = &noise
            && let Some(made) = shot.frames(&mut compositor, *n..n + 1, true, 1)?.next().transpose()?
            && let Some(layer) = made.layer
        {
            let mask: Vec<bool> = layer.rgba.iter().map(|p| p[3] > 0.999).collect();
            let seed = 2 * *n as u64;
            let real = with_noise(&Grey::luma(&frame.pixels), profile, seed);
            let made = with_noise(&Grey::luma(&made.pixels), profile, seed + 1);
            at_rest.extend(lengths(&displacements(&real, &made, Some(&mask), &options)?));
            brighter_at_rest.extend(difference(&real, &made, &mask));
        }
        for to in [n.checked_sub(plan.gap), Some(n + plan.gap)].into_iter().flatten().filter(|to| *to < count) {
            let real = shot.read(to)?.pixels;
            let Some(made) = shot.frames(&mut compositor, to..to + 1, true, 1)?.next().transpose()? else { continue };
            let Some(layer) = made.layer else { continue };
            let mask: Vec<bool> = layer.rgba.iter().map(|p| p[3] > 0.999).collect();
            let (real, made) = (Grey::luma(&real), Grey::luma(&made.pixels));
            let found = displacements(&real, &made, Some(&mask), &options)?;
            if found.patches.len() >= LEAST_PATCHES {
                displaced.extend(lengths(&found));
                pairs += 1;
            } else if found.patches.len() + found.doubtful >= LEAST_PATCHES {
                unmatched += 1;
            }
            brighter.extend(difference(&real, &made, &mask));
        }
    }
    Ok(Verified {
        pairs,
        unmatched,
        displaced: Displaced::of(&mut displaced, &mut at_rest),
        brightness: Brightness::of(&mut brighter, &mut brighter_at_rest),
        blur: blur(by, &mut compositor, &blur_px, &mut |done| seen(from.len() + done, steps))?,
        sharpness_px: sharpness_px(by, &mut compositor)?,
    })
}

/// Patches whose contrast is well above the camera's noise.
fn patch_options(pixels: &Pixels, noise: Option<&NoiseProfile>) -> DisplacementOptions {
    let usual = DisplacementOptions { patch_px: PATCH_PX, step_px: PATCH_PX / 2, ..Default::default() };
    let luma = Grey::luma(pixels).values;
    let mean = luma.iter().sum::<f64>() / luma.len().max(1) as f64;
    let sigma = noise.map_or(0.0, |profile| luma_sigma(profile, mean));
    DisplacementOptions { min_contrast: usual.min_contrast.max(MIN_CONTRAST_TO_NOISE * sigma), ..usual }
}

/// Of each `every` frames the one with the shortest motion blur, by each frame's, px: a thing's own
/// blur displaces its edges.
fn least_blurred(blur_px: &[Option<f64>], every: usize) -> Vec<usize> {
    let px = |n: usize| blur_px[n].unwrap_or(f64::INFINITY);
    let parts = (0..blur_px.len()).step_by(every).map(|from| from..(from + every).min(blur_px.len()));
    parts.filter_map(|part| part.min_by(|a, b| px(*a).total_cmp(&px(*b)))).collect()
}

/// The median of |difference| of flat areas' luma where `mask` holds, codes. `None` where it holds nowhere.
fn difference(real: &Grey, made: &Grey, mask: &[bool]) -> Option<f64> {
    let area = |of: &Grey, x: i64, y: i64| {
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        for value in (-AREA..=AREA).flat_map(|dy| (-AREA..=AREA).map(move |dx| of.at(x + dx, y + dy))) {
            (sum, squares, count) = (sum + value, squares + value * value, count + 1.0);
        }
        let mean = sum / count;
        (mean, (squares / count - mean * mean).max(0.0).sqrt())
    };
    let reach = AREA as usize;
    let mut off = Vec::new();
    for y in (reach..real.height.saturating_sub(reach)).step_by(3) {
        for x in (reach..real.width.saturating_sub(reach)).step_by(3) {
            if !mask[y * real.width + x] {
                continue;
            }
            let ((there, spread), (here, made_spread)) =
                (area(real, x as i64, y as i64), area(made, x as i64, y as i64));
            if spread.max(made_spread) < FLAT && there.max(here) < CLIPPED {
                off.push((there - here).abs());
            }
        }
    }
    off.sort_by(f64::total_cmp);
    off.get(off.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_blurred_frames_have_a_known_blur() {
        let px = [Some(3.0), None, Some(2.0), None, None, Some(0.0), Some(1.0)];
        assert_eq!(least_blurred(&px, 3), [2, 5, 6]);
        assert_eq!(least_blurred(&[None; 4], 2), [0, 2], "the first where nothing is known");
    }

    #[test]
    fn noise_is_taken_off_brightness_in_quadrature() {
        let found = Brightness::of(&mut [1.5, 1.3, 2.5], &mut [1.2, 0.9, 1.3]).unwrap();
        assert_eq!((found.measured, found.floor), ((1.5, 2.5), Some(1.2)));
        // √(1.5² − 1.2²), and √(2.5² − 1.2²).
        assert!((found.codes.0 - 0.9).abs() < 1e-12 && (found.codes.1 - 4.81f64.sqrt()).abs() < 1e-12);
        let unknown = Brightness::of(&mut [1.5], &mut []).unwrap();
        assert_eq!((unknown.codes, unknown.floor), ((1.5, 1.5), None));
        assert_eq!(Brightness::of(&mut [1.0], &mut [2.0]).unwrap().codes, (0.0, 0.0));
        assert_eq!(Brightness::of(&mut [], &mut [1.0]), None);
    }
}
