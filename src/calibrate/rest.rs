//! Stretches of footage in which camera and scene are at rest.
//!
//! Frames are compared by the means of green over large blocks. Two frames differ by the upper
//! quantile of the blocks' changes, after a common gain, flicker, is removed. The smallest
//! difference of consecutive frames of the footage is taken for that of noise, whatever its
//! correlation. A stretch at rest ends where the difference from its first frame is larger: motion
//! adds up, noise does not. Without any rest the slowest motion is taken for noise, but adds up
//! within few frames.
//!
//! The search is generous: motion by a small part of a pixel is left to
//! [`unsteady`](super::unsteady).

use std::ops::Range;

use crate::fit::quantile::upper_quantile;
use crate::grey_image::GreyImage;
use crate::pixels::Pixels;

/// Number of blocks across the larger side.
const BLOCKS: usize = 32;
/// Quantile of the blocks' changes.
const QUANTILE: f64 = 0.95;
/// Largest difference of a stretch's frames, relative to that of noise, and codes added to it.
const MAX_GROWTH: f64 = 2.0;
const MAX_CHANGE_CODES: f64 = 0.3;
/// Consecutive frames that differ by less repeat each other, codes.
const REPEAT_CODES: f64 = 0.05;

/// Finds the longest stretch at rest among frames that are added in order. Memory: 3 kB a frame.
#[derive(Clone, Debug, Default)]
pub struct RestSearch {
    /// Blocks of each frame.
    frames: Vec<GreyImage>,
}

impl RestSearch {
    pub fn add(&mut self, pixels: &Pixels) {
        let scale = 255.0 / pixels.max_code() as f32;
        let green = GreyImage::of_codes(pixels, |[_, green, _]| scale * green as f32);
        self.frames.push(green.reduced((green.width.max(green.height) / BLOCKS).max(1)));
    }

    /// Indices of the frames of the longest stretch.
    pub fn longest(self) -> Range<usize> {
        let consecutive = self.frames.windows(2).map(|pair| change(&pair[0], &pair[1]));
        let noise = consecutive.filter(|change| *change > REPEAT_CODES).min_by(f64::total_cmp).unwrap_or(0.0);
        let allowed = MAX_GROWTH * noise + MAX_CHANGE_CODES;
        let mut longest = 0..self.frames.len().min(1);
        let mut current = longest.clone();
        for (n, frame) in self.frames.iter().enumerate().skip(1) {
            if change(&self.frames[current.start], frame) <= allowed {
                current.end = n + 1;
            } else {
                current = n..n + 1;
            }
            if current.len() > longest.len() {
                longest = current.clone();
            }
        }
        longest
    }
}

/// Difference of two frames' blocks, codes. Infinite for pictures of different sizes.
fn change(from: &GreyImage, to: &GreyImage) -> f64 {
    if (from.width, from.height) != (to.width, to.height) {
        return f64::INFINITY;
    }
    let sum = |image: &GreyImage| image.values.iter().map(|v| f64::from(*v)).sum::<f64>();
    let gain = sum(to) / sum(from).max(f64::MIN_POSITIVE);
    let change = |(from, to): (&f32, &f32)| (f64::from(*to) - gain * f64::from(*from)).abs();
    let mut changes: Vec<f64> = from.values.iter().zip(&to.values).map(change).collect();
    upper_quantile(&mut changes, QUANTILE).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::pcg3d;

    /// A picture with edges, `shift` px to the right, with noise of about 3 codes.
    fn frame(shift: f64, brighter: f64, n: u32) -> Pixels {
        let code = |i: usize| {
            let (x, y) = ((i / 3 % 320) as f64 - shift, (i / 3 / 320) as f64);
            let light = 120.0 + 60.0 * (x / 9.0).sin() * (y / 13.0).cos();
            let noise = f64::from(pcg3d([i as u32, n, 0])[0]) / f64::from(u32::MAX) * 10.0 - 5.0;
            (brighter * light + noise).round().clamp(0.0, 255.0) as u8
        };
        Pixels::from_u8(320, 240, (0..3 * 320 * 240).map(code).collect()).unwrap()
    }

    #[test]
    fn longest_stretch_ends_where_the_camera_moves_by_half_a_pixel_and_ignores_flicker() {
        // Moves, rests for six frames in flickering light, moves, rests for three.
        let shifts = [0.0, 2.0, 4.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.5, 8.0, 8.0, 8.0];
        let mut search = RestSearch::default();
        for (n, shift) in shifts.into_iter().enumerate() {
            search.add(&frame(shift, 1.0 - 0.01 * (n % 3) as f64, n as u32));
        }
        assert_eq!(search.longest(), 3..9);
        assert_eq!(RestSearch::default().longest(), 0..0);
    }
}
