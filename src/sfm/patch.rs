//! Tracks a patch from one picture into another (Lucas and Kanade 1981).
//!
//! The patch's pixels x + d lie at y + A d + u in the other picture. A is the affine map that the
//! known geometry predicts. u minimises Σ w (T̂(d) − Î(y + A d + u))², coarse to fine. T̂ and Î
//! have zero mean and unit variance within the window: gain and offset of brightness do not matter.
//! w is a Gaussian.

use glam::{DMat2, DVec2};

use crate::grey_image::GreyImage;
use crate::pixels::Pixels;

/// Half side of the window, px of its level.
const REACH: i64 = 6;
/// Standard deviation of the window's weights, px of its level.
const WINDOW_SIGMA: f64 = 3.5;
/// Gauss-Newton steps of a level, and the step that ends them, px of the level.
const MAX_STEPS: usize = 12;
const CONVERGED_PX: f64 = 0.01;
/// Largest displacement that a level accepts, px of the level.
const MAX_DISPLACEMENT: f64 = 5.0;
/// Smallest standard deviation of a window, 8-bit codes.
const MIN_CONTRAST: f64 = 2.5;
/// Smallest ratio of the eigenvalues of the normal equations: the patch is no straight edge.
const MIN_EIGENVALUE_RATIO: f64 = 0.03;
/// Smallest correlation of the patches at the finest level.
const MIN_CORRELATION: f64 = 0.85;

/// A picture's luma at full, half, quarter … resolution.
#[derive(Clone, Debug)]
pub struct LumaPyramid(Vec<GreyImage>);

impl LumaPyramid {
    /// `levels` is at least 1.
    pub fn new(finest: GreyImage, levels: usize) -> Self {
        let mut all = vec![finest];
        while all.len() < levels {
            let Some(coarser) = all.last().map(GreyImage::halved) else { break };
            all.push(coarser);
        }
        Self(all)
    }

    pub fn of(pixels: &Pixels, levels: usize) -> Self {
        Self::new(GreyImage::luma_601(pixels), levels)
    }

    /// Width and height at full resolution, px.
    pub fn size(&self) -> (usize, usize) {
        self.0.first().map_or((0, 0), |finest| (finest.width, finest.height))
    }
}

/// The predicted map of a patch around `from` to the other picture, px at full resolution.
#[derive(Clone, Copy, Debug)]
pub struct PredictedPatch {
    pub from: DVec2,
    pub to: DVec2,
    pub by: DMat2,
}

/// Position of the patch's centre in `other`. `None` if it cannot be found reliably.
pub fn track_patch(picture: &LumaPyramid, other: &LumaPyramid, predicted: &PredictedPatch) -> Option<DVec2> {
    let mut to = predicted.to;
    for (level, (template, target)) in picture.0.iter().zip(&other.0).enumerate().rev() {
        // A coarser level's pixel k stands on pixel 2k of the finer one.
        let scale = f64::from(1 << level);
        let at_level = |at: DVec2| (at - 0.5) / scale + 0.5;
        let from_level = |at: DVec2| (at - 0.5) * scale + 0.5;
        let aligned = align(template, target, at_level(predicted.from), at_level(to), &predicted.by);
        match aligned {
            Some((offset, correlation)) if level > 0 || correlation >= MIN_CORRELATION => to = from_level(offset),
            // A coarse level may lack contrast or reach over the border; a finer one decides.
            _ if level > 0 => {}
            _ => return None,
        }
    }
    Some(to)
}

/// A window's samples with zero mean and unit variance, by the window's weights.
struct PatchSamples {
    values: Vec<f64>,
    deviation: f64,
}

fn normalised(values: Vec<f64>, weights: &[f64]) -> PatchSamples {
    let mean: f64 = values.iter().zip(weights).map(|(v, w)| v * w).sum();
    let variance: f64 = values.iter().zip(weights).map(|(v, w)| w * (v - mean).powi(2)).sum();
    let deviation = variance.sqrt();
    PatchSamples { values: values.into_iter().map(|v| (v - mean) / deviation.max(1e-9)).collect(), deviation }
}

/// Displacements of a window's samples, and their weights, which sum to 1.
fn window() -> (Vec<DVec2>, Vec<f64>) {
    let reach = -REACH..=REACH;
    let offsets: Vec<DVec2> =
        reach.clone().flat_map(|y| reach.clone().map(move |x| DVec2::new(x as f64, y as f64))).collect();
    let weights: Vec<f64> = offsets.iter().map(|d| (-0.5 * d.length_squared() / WINDOW_SIGMA.powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    (offsets, weights.into_iter().map(|w| w / sum).collect())
}

/// The aligned position in the target, and the correlation there.
fn align(template: &GreyImage, target: &GreyImage, from: DVec2, to: DVec2, by: &DMat2) -> Option<(DVec2, f64)> {
    let (offsets, weights) = window();
    let margin = REACH as f64 + 1.0;
    if !template.holds(from, margin) {
        return None;
    }
    let patch = normalised(offsets.iter().map(|d| template.sample(from + *d)).collect(), &weights);
    if patch.deviation < MIN_CONTRAST {
        return None;
    }
    let mut at = to;
    for _ in 0..MAX_STEPS {
        if !target.holds(at, margin) || (at - to).length() > MAX_DISPLACEMENT {
            return None;
        }
        let position = |d: &DVec2| at + *by * *d;
        let sampled = normalised(offsets.iter().map(|d| target.sample(position(d))).collect(), &weights);
        if sampled.deviation < 0.5 * MIN_CONTRAST {
            return None;
        }
        let (mut normal, mut right, mut correlation) = (DMat2::ZERO, DVec2::ZERO, 0.0);
        for (((d, w), t), i) in offsets.iter().zip(&weights).zip(&patch.values).zip(&sampled.values) {
            let p = position(d);
            let slope = |step: DVec2| target.sample(p + step) - target.sample(p - step);
            let gradient = DVec2::new(slope(DVec2::new(0.5, 0.0)), slope(DVec2::new(0.0, 0.5))) / sampled.deviation;
            normal += DMat2::from_cols(gradient * (w * gradient.x), gradient * (w * gradient.y));
            right += gradient * (w * (t - i));
            correlation += w * t * i;
        }
        let half_trace = 0.5 * (normal.x_axis.x + normal.y_axis.y);
        let root = (half_trace * half_trace - normal.determinant()).max(0.0).sqrt();
        if half_trace - root < MIN_EIGENVALUE_RATIO * (half_trace + root) {
            return None;
        }
        let step = normal.inverse() * right;
        if !step.is_finite() {
            return None;
        }
        if step.length() < CONVERGED_PX {
            return Some((at + step, correlation));
        }
        at += step.clamp_length_max(2.0);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth texture: sums of waves of 7 to 20 px.
    fn texture(at: DVec2) -> f32 {
        let wave = |x: f64, y: f64, phase: f64| (x * at.x + y * at.y + phase).sin();
        (120.0 + 30.0 * (wave(0.5, 0.3, 0.0) + wave(-0.35, 0.6, 1.0) + wave(0.8, -0.15, 2.0))) as f32
    }

    fn picture(of: impl Fn(DVec2) -> f32) -> LumaPyramid {
        LumaPyramid::new(GreyImage::from_fn(120, 100, |x, y| of(DVec2::new(x as f64 + 0.5, y as f64 + 0.5))), 3)
    }

    #[test]
    fn patch_is_found_through_shift_gain_and_offset() {
        let shift = DVec2::new(3.37, -2.81);
        let first = picture(texture);
        let second = picture(|at| 0.7 * texture(at - shift) + 20.0);
        let from = DVec2::new(60.0, 50.0);
        let tracked = track_patch(&first, &second, &PredictedPatch { from, to: from, by: DMat2::IDENTITY }).unwrap();
        assert!((tracked - from - shift).length() < 0.03, "{tracked}");
    }

    #[test]
    fn known_rotation_is_applied() {
        let (turn, centre) = (DMat2::from_angle(0.5), DVec2::new(60.0, 50.0));
        let first = picture(texture);
        let second = picture(|at| texture(centre + turn.transpose() * (at - centre)));
        let from = centre + DVec2::new(4.0, -6.0);
        let to = centre + turn * (from - centre);
        let predicted = PredictedPatch { from, to: to + DVec2::new(1.5, 1.0), by: turn };
        let tracked = track_patch(&first, &second, &predicted).unwrap();
        assert!((tracked - to).length() < 0.06, "{tracked} beside {to}");
        let unturned = PredictedPatch { by: DMat2::IDENTITY, ..predicted };
        assert!(track_patch(&first, &second, &unturned).is_none_or(|at| (at - to).length() > 0.1));
    }

    #[test]
    fn flat_straight_and_foreign_patches_are_refused() {
        let from = DVec2::new(60.0, 50.0);
        let predicted = PredictedPatch { from, to: from, by: DMat2::IDENTITY };
        let flat = picture(|at| 100.0 + 0.01 * at.x as f32);
        assert_eq!(track_patch(&flat, &flat, &predicted), None);
        let edge = picture(|at| if at.x < 60.0 { 50.0 } else { 150.0 });
        assert_eq!(track_patch(&edge, &edge, &predicted), None);
        let other = picture(|at| texture(DVec2::new(2.0 * at.y + 11.0, 1.7 * at.x)));
        assert_eq!(track_patch(&picture(texture), &other, &predicted), None);
        let outside = PredictedPatch { to: DVec2::new(-5.0, 50.0), ..predicted };
        assert_eq!(track_patch(&picture(texture), &picture(texture), &outside), None);
    }
}
