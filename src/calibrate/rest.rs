//! Stretches of footage in which camera and scene are at rest.
//!
//! Frames are compared by the means of green over large blocks, which have little noise: σ / s with
//! blocks of s × s px. The blocks of a moving picture change wherever the content does. A factor
//! common to all blocks, flicker, is taken out. The search is generous: motion by a small part of a
//! pixel is left to [`unsteady`](super::unsteady).
//!
//! σ is that of the finest diagonal detail a − b − c + d of 2 × 2 px, whose variance is 4 σ². Its
//! median leaves out edges.

use std::ops::Range;

use crate::fit::quantile::{upper_median, upper_quantile};
use crate::grey_image::GreyImage;
use crate::pixels::Pixels;

/// Number of blocks across the larger side.
const BLOCKS: usize = 32;
/// Largest change of a block's mean from the stretch's first frame, codes, at `QUANTILE` of all
/// blocks.
const MAX_CHANGE_CODES: f64 = 0.5;
/// Added for noise, in σ / s. Two frames of independent noise differ by 2.8.
const MAX_CHANGE_SIGMAS: f64 = 4.0;
const QUANTILE: f64 = 0.95;
/// Step between measured details, px.
const DETAIL_STEP: usize = 3;
/// Ratio of the standard deviation of a normal distribution to the median of its absolute values.
const SIGMA_BY_MEDIAN: f64 = 1.4826;

/// Finds the longest stretch at rest among frames that are added in order.
#[derive(Clone, Debug, Default)]
pub struct RestSearch {
    /// Blocks of the first frame of the current stretch.
    first: Option<GreyImage>,
    current: Range<usize>,
    longest: Range<usize>,
}

impl RestSearch {
    pub fn add(&mut self, pixels: &Pixels) {
        let scale = 255.0 / pixels.max_code() as f32;
        let green = GreyImage::of_codes(pixels, |[_, green, _]| scale * green as f32);
        let side = (green.width.max(green.height) / BLOCKS).max(1);
        let blocks = green.reduced(side);
        let allowed = MAX_CHANGE_CODES + MAX_CHANGE_SIGMAS * fine_sigma(&green) / side as f64;
        if self.first.as_ref().is_some_and(|first| change(first, &blocks) <= allowed) {
            self.current.end += 1;
        } else {
            self.current = self.current.end..self.current.end + 1;
            self.first = Some(blocks);
        }
        if self.current.len() > self.longest.len() {
            self.longest = self.current.clone();
        }
    }

    /// Indices of the frames of the longest stretch.
    pub fn longest(self) -> Range<usize> {
        self.longest
    }
}

/// σ of the finest diagonal detail.
fn fine_sigma(image: &GreyImage) -> f64 {
    let at = |x: usize, y: usize| f64::from(image.values[y * image.width + x]);
    let rows = (1..image.height).step_by(DETAIL_STEP);
    let places = rows.flat_map(|y| (1..image.width).step_by(DETAIL_STEP).map(move |x| (x, y)));
    let details = places.map(|(x, y)| (at(x, y) - at(x - 1, y) - at(x, y - 1) + at(x - 1, y - 1)).abs());
    upper_median(details).map_or(0.0, |median| 0.5 * SIGMA_BY_MEDIAN * median)
}

/// Change of the blocks after a common gain is removed, codes. Infinite for pictures of different
/// sizes.
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
