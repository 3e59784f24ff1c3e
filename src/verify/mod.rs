//! Whether virtual things behave as real ones in a recording: frames of it, as things, put into other frames of it.
//!
//! Through the whole pipeline, with what was recorded and with what was found out ([`crate::analyse`]). A place is judged by the
//! phase correlation of patches, less what that reads of exact poses ([`floor`]), brightness by the luma of small areas, so that noise and blur, which the thing's own picture
//! has already, do not count. Those effects are off. Motion blur and sharpness are judged each by itself.

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

use floor::with_noise;

use crate::gpu::Gpu;
use crate::measure::Grey;
use crate::measure::displacement::{DisplacementOptions, Displacements, displacements};
use crate::shot::Shot;

/// Patches must be much larger than what they are displaced by, which may be 10 px, px.
const PATCH_PX: usize = 64;
/// Areas over which luma is averaged, px each way from the middle.
const AREA: i64 = 2;
/// An area is flat if its luma's standard deviation is below this, and tells nothing above this mean, codes.
const FLAT: f64 = 4.0;
const CLIPPED: f64 = 235.0;
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

/// How far virtual is from real.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verified {
    /// Pairs of frames that told something.
    pub pairs: usize,
    /// Lengths of the patches' displacements.
    pub displaced: Option<Displaced>,
    /// Of the pairs' median differences of luma the median and the largest, 8-bit codes.
    pub brighter_codes: Option<(f64, f64)>,
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
    let from: Vec<usize> = (0..count).step_by(plan.every.max(1)).collect();
    let steps = from.len() + blur::PAIRS;
    let noise = by.camera().noise;
    let mut compositor = shot.compositor(gpu.clone());
    let (mut displaced, mut at_rest, mut brighter, mut pairs) = (Vec::new(), Vec::new(), Vec::new(), 0);
    let options = DisplacementOptions { patch_px: PATCH_PX, step_px: PATCH_PX / 2, ..Default::default() };
    let lengths = |found: &Displacements| -> Vec<f64> {
        found.patches.iter().map(|patch| patch.displacement_px[0].hypot(patch.displacement_px[1])).collect()
    };
    for (done, n) in from.iter().enumerate() {
        seen(done, steps);
        let frame = shot.read(*n)?;
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
            }
            brighter.extend(difference(&real, &made, &mask));
        }
    }
    brighter.sort_by(f64::total_cmp);
    let middle = brighter.get(((brighter.len() as f64 - 1.0) * 0.5).round() as usize).copied();
    Ok(Verified {
        pairs,
        displaced: Displaced::of(&mut displaced, &mut at_rest),
        brighter_codes: middle.zip(brighter.last().copied()),
        blur: blur(by, &mut compositor, &mut |done| seen(from.len() + done, steps))?,
        sharpness_px: sharpness_px(by, &mut compositor)?,
    })
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
