//! Removes from a residual the traces of a small shift, blur and brightness difference between a
//! frame and its mean picture.
//!
//! For each channel the residual is regressed on first and second differences of the mean picture
//! along both axes. The correction is the fitted part plus the mean of the remaining residual over
//! the usable pixels within 101 × 101 px, which is 0 where there are none.

use super::regression::solved;
use crate::grey_image::GreyImage;

/// Half width of the window of the brightness correction, px.
const WINDOW_REACH: usize = 50;
const RIDGE: f64 = 1e3;

/// The correction of one channel, code values. `mask`: usable pixels; only they enter the
/// regression and the local mean.
pub fn correction(noisy: &GreyImage, mean: &GreyImage, mask: &[bool]) -> GreyImage {
    let (w, h) = (mean.width, mean.height);
    let residual: Vec<f32> = noisy.values.iter().zip(&mean.values).map(|(a, b)| a - b).collect();
    let differences = |x: usize, y: usize| -> [f32; 4] {
        let at = |dx: i64, dy: i64| mean.clamped(x as i64 + dx, y as i64 + dy);
        let (left, right, up, down, middle) = (at(-1, 0), at(1, 0), at(0, -1), at(0, 1), at(0, 0));
        [(right - left) / 2.0, (down - up) / 2.0, right + left - 2.0 * middle, up + down - 2.0 * middle]
    };
    let count = mask.iter().filter(|&&m| m).count().max(1) as f64;
    let offset = residual.iter().zip(mask).filter(|(_, m)| **m).map(|(&r, _)| f64::from(r)).sum::<f64>() / count;
    let (mut normal, mut right) = ([[0.0; 4]; 4], [0.0; 4]);
    for (i, _) in mask.iter().enumerate().filter(|(_, m)| **m) {
        let d = differences(i % w, i / w).map(f64::from);
        for a in 0..4 {
            for b in 0..4 {
                normal[a][b] += d[a] * d[b];
            }
            right[a] += d[a] * (f64::from(residual[i]) - offset);
        }
    }
    for (a, row) in normal.iter_mut().enumerate() {
        row[a] += RIDGE;
    }
    let weights = solved(normal, right).map(|v| v as f32);
    let fitted =
        GreyImage::from_fn(w, h, |x, y| differences(x, y).iter().zip(&weights).map(|(d, w)| d * w).sum::<f32>());
    let used = |i: usize, v: f32| if mask[i] { v } else { 0.0 };
    let rest = GreyImage::from_fn(w, h, |x, y| used(y * w + x, residual[y * w + x] - fitted.values[y * w + x]));
    let [smooth, share] =
        [rest, GreyImage::from_fn(w, h, |x, y| used(y * w + x, 1.0))].map(|image| window_mean(&image));
    let local_mean = |i: usize| if share.values[i] > 0.0 { smooth.values[i] / share.values[i] } else { 0.0 };
    GreyImage::from_fn(w, h, |x, y| fitted.values[y * w + x] + local_mean(y * w + x))
}

/// Mean over the window around each pixel, as far as it is inside the picture.
fn window_mean(image: &GreyImage) -> GreyImage {
    let (w, h) = (image.width, image.height);
    let mut sums = vec![0.0f64; (w + 1) * (h + 1)];
    for y in 0..h {
        let mut row = 0.0;
        for x in 0..w {
            row += f64::from(image.values[y * w + x]);
            sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
        }
    }
    let range = |at: usize, length: usize| (at.saturating_sub(WINDOW_REACH), (at + WINDOW_REACH + 1).min(length));
    GreyImage::from_fn(w, h, |x, y| {
        let ((x0, x1), (y0, y1)) = (range(x, w), range(y, h));
        let at = |x: usize, y: usize| sums[y * (w + 1) + x];
        ((at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0)) / ((x1 - x0) * (y1 - y0)) as f64) as f32
    })
}
