//! Noise of a single frame: its difference from a smooth picture where it has no texture.
//!
//! The picture without noise is a Gaussian mean over textureless pixels alone, so that edges beside
//! them do not spread into it. A pixel is textureless if the squared residual around it is at most
//! a small multiple of the variance in the noise table, which the flattest places determine. The
//! first test uses the residual from a narrow mean, which a gradient of the content barely affects.
//! Three further rounds use the residual from the wide mean.
//!
//! Not modelled: noise that is coarser than the mean, noise of texture and edges.

use super::calibration::CalibrationFrame;
use super::content::brightness;
use super::masked_blur::MaskedBlur;
use super::path::{Planes, rgb_of_codes};
use crate::grey_image::GreyImage;

/// Standard deviation of the mean, and of that by which places are judged first, px.
const MEAN_PX: f64 = 8.0;
const NARROW_MEAN_PX: f64 = 2.5;
/// Half side of the areas over which squared residuals are averaged, px.
const AREA_RADIUS_PX: usize = 3;
/// Largest mean squared residual of an area, relative to the variance of the noise of G.
const MAX_VARIANCE: f32 = 5.0;
const ROUNDS: usize = 3;
/// Smallest standard deviation of noise, codes: that of rounding.
const MIN_SIGMA: f32 = 0.3;
/// Variance of rounding, codes².
const ROUNDING: f32 = 1.0 / 12.0;
/// Blur where nothing nearby is textureless, px.
const BLUR_PX: f64 = 2.0;

/// A frame of R', G', B' codes, interleaved, with a smooth picture as its mean and textureless
/// places as its mask. `table`: σ of R, G and B by code.
pub fn textureless_places(codes: Vec<u8>, size: [usize; 2], table: &[[f32; 3]]) -> CalibrationFrame {
    let [width, height] = size;
    let own = rgb_of_codes(&codes, size);
    let light = GreyImage::from_fn(width, height, |x, y| brightness(own.each_ref().map(|p| p.values[y * width + x])));
    let narrow = light.blurred(NARROW_MEAN_PX);
    let variance = |i: usize| table[narrow.values[i].clamp(0.0, 255.0) as usize][1].max(MIN_SIGMA).powi(2) + ROUNDING;
    let mut mask = quiet_areas(&light, &narrow, &variance);
    for _ in 0..ROUNDS {
        let mean = MaskedBlur::new(&mask, size, MEAN_PX).mean_of(|i| light.values[i]);
        let wide = quiet_areas(&light, &mean, &variance);
        // Rejected pixels stay rejected: near edges the masked mean has edge pixels alone.
        mask.iter_mut().zip(wide).for_each(|(usable, quiet)| *usable &= quiet);
    }
    let blur = MaskedBlur::new(&mask, size, MEAN_PX);
    let mean: Planes = own.each_ref().map(|plane| {
        let mut mean = blur.mean_of(|i| plane.values[i]);
        let blurred = plane.blurred(BLUR_PX);
        for (i, mean) in mean.values.iter_mut().enumerate().filter(|(i, _)| !blur.is_known(*i)) {
            *mean = blurred.values[i];
        }
        mean
    });
    CalibrationFrame { mean, noisy: codes, mask, variance_gain: 1.0 }
}

/// Pixels around which the residual from a mean is no larger than noise. `variance`: that of noise
/// at the i-th pixel.
fn quiet_areas(light: &GreyImage, mean: &GreyImage, variance: &impl Fn(usize) -> f32) -> Vec<bool> {
    let relative = |i: usize| (light.values[i] - mean.values[i]).powi(2) / variance(i);
    let (width, height) = (light.width, light.height);
    let relative = GreyImage { width, height, values: (0..width * height).map(relative).collect() };
    let whole = ((2 * AREA_RADIUS_PX + 1) as f32).powi(2);
    let sums = relative.filtered(&[1.0; AREA_RADIUS_PX + 1]);
    sums.values.iter().map(|sum| *sum <= MAX_VARIANCE * whole).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::pcg3d;

    const SIDE: usize = 240;
    const SIGMA: f32 = 3.0;

    /// A wall with a gradient of light, a dark bar and a part with stripes, with uniform noise.
    fn frame() -> Vec<u8> {
        let content = |x: usize, y: usize| match (x, y) {
            (0..20, _) => 40.0,
            (160.., 100..) => 120.0 + if (x / 2).is_multiple_of(2) { 12.0 } else { -12.0 },
            _ => 90.0 + 0.25 * x as f32,
        };
        let code = |i: usize| {
            let noise = pcg3d([i as u32, 5, 0])[0] as f32 / u32::MAX as f32 - 0.5;
            (content(i / 3 % SIDE, i / 3 / SIDE) + SIGMA * 12f32.sqrt() * noise).round() as u8
        };
        (0..3 * SIDE * SIDE).map(code).collect()
    }

    #[test]
    fn noise_of_a_wall_is_found_without_its_edges_and_texture() {
        let places = textureless_places(frame(), [SIDE; 2], &vec![[SIGMA; 3]; 256]);
        let usable = |x: usize, y: usize| places.mask[y * SIDE + x];
        let share = |x0: usize, x1: usize, y0: usize, y1: usize| {
            let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
            places.filter(|(x, y)| usable(*x, *y)).count() as f64 / ((x1 - x0) * (y1 - y0)) as f64
        };
        assert!(share(40, 150, 10, 230) > 0.99, "wall {}", share(40, 150, 10, 230));
        assert!(share(165, 235, 110, 235) < 0.01, "stripes");
        assert!(share(19, 21, 0, 240) < 0.01, "edge");
        let noisy = rgb_of_codes(&places.noisy, [SIDE; 2]);
        let (mut squares, mut count) = (0.0, 0.0);
        for (x, y) in (10..230).flat_map(|y| (40..150).map(move |x| (x, y))) {
            let i = y * SIDE + x;
            squares += (noisy[1].values[i] - places.mean[1].values[i]).powi(2);
            count += 1.0;
        }
        assert!((squares / count / (SIGMA * SIGMA + ROUNDING) - 1.0).abs() < 0.03, "{}", squares / count);
    }
}
