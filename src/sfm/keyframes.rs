//! Chooses the frames of a video from which its motion is solved: sharp ones, a little apart.

use glam::{DMat2, DVec2};

use super::patch::{LumaPyramid, PredictedPatch, track_patch};
use crate::fit::quantile::upper_median;
use crate::grey_image::GreyImage;
use crate::pixels::Pixels;

/// Width to which frames are reduced, px.
const REDUCED_WIDTH_PX: usize = 320;
const LEVELS: usize = 4;
/// Patches that are tracked from frame to frame: columns and rows.
const GRID: [usize; 2] = [9, 6];
/// Smallest number of patches that give a displacement.
const MIN_PATCHES: usize = 5;
/// Displacement of a frame that cannot be tracked, as a share of the width: a fast or blurred one.
const UNTRACKED_SHARE: f64 = 0.05;
/// Image motion from one chosen frame to the next, as a share of the width. Matching of features
/// tolerates much more, but a camera that mostly turns is only solved by long tracks: of 90 frames
/// of such a recording, 3 % found no model, every other frame (1.8 % in the mean) one of all.
const KEYFRAME_SHARE: f64 = 0.015;
/// Longest interval between chosen frames, s.
const MAX_INTERVAL_S: f64 = 1.0;
/// Largest number of chosen frames: matching takes about a second for each.
pub const MAX_KEYFRAMES: usize = 240;

/// A frame's motion and sharpness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample {
    /// Median displacement of patches since the frame before, as a share of the width.
    pub share: f64,
    /// Mean square gradient, codes² per px². Comparable among neighbouring frames only.
    pub sharpness: f64,
}

/// Measures one frame after another.
#[derive(Debug, Default)]
pub struct MotionMeter {
    before: Option<LumaPyramid>,
}

impl MotionMeter {
    pub fn measure(&mut self, pixels: &Pixels) -> MotionSample {
        let by = (pixels.width as usize).div_ceil(REDUCED_WIDTH_PX);
        let reduced = GreyImage::luma_601(pixels).reduced(by);
        let (across, down) = reduced.sobel();
        let squares: f64 =
            across.values.iter().zip(&down.values).map(|(x, y)| f64::from(x * x) + f64::from(y * y)).sum();
        let sharpness = squares / reduced.values.len().max(1) as f64;
        let now = LumaPyramid::new(reduced, LEVELS);
        let share = self.before.as_ref().map_or(0.0, |before| displacement_share(before, &now));
        self.before = Some(now);
        MotionSample { share, sharpness }
    }
}

fn displacement_share(before: &LumaPyramid, now: &LumaPyramid) -> f64 {
    let (width, height) = now.size();
    let [columns, rows] = GRID;
    let centres = (0..rows).flat_map(|y| (0..columns).map(move |x| DVec2::new(x as f64 + 0.5, y as f64 + 0.5)));
    let lengths: Vec<f64> = centres
        .map(|cell| cell * DVec2::new(width as f64 / columns as f64, height as f64 / rows as f64))
        .filter_map(|at| {
            let tracked = track_patch(before, now, &PredictedPatch { from: at, to: at, by: DMat2::IDENTITY })?;
            Some((tracked - at).length())
        })
        .collect();
    if lengths.len() < MIN_PATCHES {
        return UNTRACKED_SHARE;
    }
    upper_median(lengths).unwrap_or(0.0) / width.max(1) as f64
}

/// The chosen frames, ascending: the sharpest of each stretch of [`KEYFRAME_SHARE`] of motion or
/// [`MAX_INTERVAL_S`]. In a long video stretches are longer, so that there are at most `max_count`.
pub fn choose(motions: &[MotionSample], times_s: &[f64], max_count: usize) -> Vec<usize> {
    let mut factor = 1.0;
    loop {
        let chosen = choose_by(motions, times_s, factor);
        if chosen.len() <= max_count.max(2) {
            return chosen;
        }
        factor *= 1.2;
    }
}

fn choose_by(motions: &[MotionSample], times_s: &[f64], factor: f64) -> Vec<usize> {
    let mut chosen = Vec::new();
    let (mut start, mut moved) = (0, 0.0);
    for (i, motion) in motions.iter().enumerate() {
        moved += motion.share;
        let time = |i: usize| times_s.get(i).copied().unwrap_or_default();
        let is_last = i + 1 == motions.len();
        if moved >= factor * KEYFRAME_SHARE || time(i) - time(start) >= factor * MAX_INTERVAL_S || is_last {
            let sharpest = (start..=i).max_by(|a, b| motions[*a].sharpness.total_cmp(&motions[*b].sharpness));
            chosen.extend(sharpest);
            (start, moved) = (i + 1, 0.0);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(share: f64, sharpness: f64) -> MotionSample {
        MotionSample { share, sharpness }
    }

    #[test]
    fn sharpest_frame_of_each_stretch_is_chosen() {
        let motions: Vec<MotionSample> = (0..12).map(|i| motion(0.01, if i % 3 == 1 { 9.0 } else { 5.0 })).collect();
        let times: Vec<f64> = (0..12).map(|i| f64::from(i) / 30.0).collect();
        assert_eq!(choose(&motions, &times, 100), [1, 3, 4, 7, 9, 10]);
        assert!(choose(&motions, &times, 3).len() <= 3);
    }

    #[test]
    fn resting_camera_is_sampled_by_time() {
        let motions = [motion(0.0, 1.0); 91];
        let times: Vec<f64> = (0..91).map(|i| f64::from(i) / 30.0).collect();
        assert_eq!(choose(&motions, &times, 100).len(), 3);
        assert!(choose(&[], &[], 100).is_empty());
    }

    #[test]
    fn meter_measures_the_shift_of_the_picture() {
        let picture = |shift: f64| {
            let code = |x: u32, y: u32| {
                let (x, y) = (f64::from(x) - shift, f64::from(y));
                (120.0 + 40.0 * (0.31 * x + 0.2 * y).sin() + 40.0 * (0.17 * x - 0.33 * y).sin()) as u8
            };
            let codes = (0..96).flat_map(|y| (0..160).flat_map(move |x| [code(x, y); 3])).collect();
            Pixels::from_u8(160, 96, codes).unwrap()
        };
        let mut meter = MotionMeter::default();
        assert_eq!(meter.measure(&picture(0.0)).share, 0.0);
        let share = meter.measure(&picture(4.0)).share;
        assert!((share - 4.0 / 160.0).abs() < 0.001, "{share}");
        // Nothing in common.
        let flat = Pixels::from_u8(160, 96, vec![100; 3 * 160 * 96]).unwrap();
        assert_eq!(meter.measure(&flat).share, UNTRACKED_SHARE);
    }
}
