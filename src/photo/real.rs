//! The real part of a photograph: the recording's own pixels, summed and resampled. They are
//! exposed later, in the composite, so that nothing is clipped before.

use std::borrow::Borrow;
use std::ops::Range;

use crate::camera::{Crop, Response, correlations, variance_left};
use crate::parallel::{over_rows, processors};
use crate::pixels::{Codes, Pixels};

/// Real pixels at the photograph's size, 16 bits.
#[derive(Clone, Debug)]
pub struct RealPart {
    pub pixels: Pixels,
    /// Mean share of the noise variance that remains after summing and resampling; up to 1.
    pub noise_left: f64,
}

/// The frames within the shutter time, and their weights. A frame represents its interval, centred
/// on its timestamp. The weights of the existing frames sum to 1.
pub fn shutter_weights(timestamps_s: &[f64], interval_s: f64, frame: usize, time_s: f64) -> (Range<usize>, Vec<f64>) {
    let alone = (frame..frame + 1, vec![1.0]);
    let Some(&middle) = timestamps_s.get(frame).filter(|_| time_s > interval_s && interval_s > 0.0) else {
        return alone;
    };
    let part = |t: f64| {
        let shared = (t - middle).abs() - 0.5 * (time_s + interval_s);
        (-shared).clamp(0.0, interval_s)
    };
    let is_exposed = |n: &usize| timestamps_s.get(*n).is_some_and(|t| part(*t) > 1e-9 * interval_s);
    let first = (0..=frame).rev().take_while(is_exposed).last().unwrap_or(frame);
    let end = (frame..timestamps_s.len()).take_while(is_exposed).last().unwrap_or(frame) + 1;
    let parts: Vec<f64> = (first..end).map(|n| part(timestamps_s[n])).collect();
    let whole: f64 = parts.iter().sum();
    (first..end, parts.iter().map(|p| p / whole).collect())
}

/// Summed linear light of pictures, in rows of R, G, B.
#[derive(Clone, Debug)]
struct SummedLight {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
}

impl RealPart {
    /// Sums frames of one size (weight, pixels) and resamples the framed part to a size in pixels.
    /// If neither is needed, the code values are the recording's. `neighbours`: correlation of a
    /// pixel's noise with the neighbours' to the right and below.
    pub fn new(
        frames: &[(f64, impl Borrow<Pixels>)],
        response: &Response,
        framed: &Crop,
        (width, height): (u32, u32),
        neighbours: [f64; 2],
    ) -> Self {
        let summed: f64 = frames.iter().map(|(weight, _)| weight * weight).sum();
        if let ([(_, pixels)], true) = (frames, framed.is_exact()) {
            return Self { pixels: cut(pixels.borrow(), framed, width, height), noise_left: summed };
        }
        let light = sum(frames, response);
        let across = Taps::new(light.width, framed.left_px, framed.step, width);
        let down = Taps::new(light.height, framed.top_px, framed.step, height);

        let (columns, rows) = (width as usize, height as usize);
        let mut wide = vec![[0.0f32; 3]; columns * light.height];
        over_rows(&mut wide, columns, processors(), |y, row| {
            let from = &light.rgb[y * light.width..(y + 1) * light.width];
            row.iter_mut().enumerate().for_each(|(x, out)| *out = across.of(x, |i| from[i]));
        });
        let encode = response.encoder();
        let mut codes = vec![[0u16; 3]; columns * rows];
        over_rows(&mut codes, columns, processors(), |y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let light = down.of(y, |i| wide[i * columns + x]);
                *out = light.map(|l| (65535.0 * encode(f64::from(l))).round() as u16);
            }
        });
        let codes = Codes::U16(codes.into_flattened());
        let left = across.noise_left(neighbours[0]) * down.noise_left(neighbours[1]);
        Self { pixels: Pixels::uncoded(width, height, codes), noise_left: summed * left }
    }
}

/// Copies pixel for pixel.
fn cut(pixels: &Pixels, framed: &Crop, width: u32, height: u32) -> Pixels {
    let (left, top) = (framed.left_px as u32, framed.top_px as u32);
    let scale = 65535 / pixels.max_code();
    let place = |n: u32, side: u32| n.min(side.saturating_sub(1));
    let codes = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .flat_map(|(x, y)| pixels.at(place(left + x, pixels.width), place(top + y, pixels.height)))
        .map(|code| (code * scale) as u16)
        .collect();
    Pixels::uncoded(width, height, Codes::U16(codes))
}

fn sum(frames: &[(f64, impl Borrow<Pixels>)], response: &Response) -> SummedLight {
    let (width, height) = frames.first().map_or((0, 0), |(_, pixels)| {
        let Pixels { width, height, .. } = pixels.borrow();
        (*width as usize, *height as usize)
    });
    let mut rgb = vec![[0.0f32; 3]; width * height];
    for (weight, pixels) in frames {
        let pixels: &Pixels = pixels.borrow();
        let light: Vec<f32> =
            response.table(pixels.max_code()).into_iter().map(|light| (weight * light) as f32).collect();
        over_rows(&mut rgb, width, processors(), |y, row| {
            for (x, sum) in row.iter_mut().enumerate() {
                let codes = pixels.at(x as u32, y as u32);
                (0..3).for_each(|c| sum[c] += light[codes[c] as usize]);
            }
        });
    }
    SummedLight { width, height, rgb }
}

/// Resampling weights of a row.
struct Taps {
    /// Index of the first source pixel of each pixel, and weights that sum to 1.
    parts: Vec<(i64, Vec<f32>)>,
    last: i64,
}

/// Catmull-Rom cubic (Keys 1981, a = −1/2): interpolates, with slopes from the neighbours.
fn cubic(x: f64) -> f64 {
    let x = x.abs();
    match x {
        x if x < 1.0 => (1.5 * x - 2.5) * x * x + 1.0,
        x if x < 2.0 => ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0,
        _ => 0.0,
    }
}

impl Taps {
    /// `count` pixels, each `step` source pixels wide, starting at `edge`. For minification the
    /// filter is widened.
    fn new(source: usize, edge: f64, step: f64, count: u32) -> Self {
        let spread = step.max(1.0);
        let parts = (0..count).map(|n| {
            let middle = edge + (f64::from(n) + 0.5) * step - 0.5;
            let first = (middle - 2.0 * spread).ceil() as i64;
            let end = (middle + 2.0 * spread).floor() as i64;
            let weights: Vec<f64> = (first..=end).map(|i| cubic((i as f64 - middle) / spread)).collect();
            let whole: f64 = weights.iter().sum();
            (first, weights.iter().map(|w| (w / whole) as f32).collect())
        });
        Self { parts: parts.collect(), last: source as i64 - 1 }
    }

    /// The border is repeated beyond the source.
    fn of(&self, n: usize, at: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        let (first, weights) = &self.parts[n];
        let mut sum = [0.0; 3];
        for (i, weight) in (*first..).zip(weights) {
            let from = at(i.clamp(0, self.last) as usize);
            (0..3).for_each(|c| sum[c] += weight * from[c]);
        }
        sum
    }

    fn noise_left(&self, neighbours: f64) -> f64 {
        let correlations = correlations(neighbours);
        let left = self.parts.iter().map(|(_, weights)| variance_left(weights, &correlations)).sum::<f64>();
        left / self.parts.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Curve;

    fn linear() -> Response {
        Response { curve: Curve::Linear, ..Default::default() }
    }

    fn row(codes: &[u8]) -> Pixels {
        let rgb = codes.iter().flat_map(|c| [*c; 3]).collect();
        Pixels::from_u8(codes.len() as u32, 1, rgb).unwrap()
    }

    fn greens(real: &RealPart) -> Vec<u32> {
        (0..real.pixels.width).map(|x| real.pixels.at(x, 0)[1]).collect()
    }

    #[test]
    fn unresampled_codes_are_unchanged() {
        let framed = Crop { left_px: 1.0, top_px: 0.0, step: 1.0 };
        let real = RealPart::new(&[(1.0, row(&[0, 17, 254, 255]))], &Response::default(), &framed, (2, 1), [0.0; 2]);
        assert_eq!((greens(&real), real.noise_left), (vec![17 * 257, 254 * 257], 1.0));
    }

    #[test]
    fn frames_are_summed_in_linear_light() {
        let framed = Crop { left_px: 0.0, top_px: 0.0, step: 1.0 };
        let frames = [(0.25, row(&[40, 80])), (0.75, row(&[80, 0]))];
        let real = RealPart::new(&frames, &linear(), &framed, (2, 1), [0.0; 2]);
        // 0.25 · 40 + 0.75 · 80 = 70; 0.25 · 80 = 20.
        assert_eq!(greens(&real), [70 * 257, 20 * 257]);
        assert!((real.noise_left - 0.625).abs() < 1e-12);
        // Half of 0.181 and half of nothing is 0.09 of light, sRGB code 84.6.
        let halves = [(0.5, row(&[118])), (0.5, row(&[0]))];
        let grey = RealPart::new(&halves, &Response::default(), &framed, (1, 1), [0.0; 2]);
        assert_eq!((f64::from(greens(&grey)[0]) / 257.0).round(), 85.0);
    }

    #[test]
    fn resampling_preserves_ramps_and_does_not_overshoot() {
        let framed = Crop { left_px: 4.0, top_px: 0.0, step: 0.5 };
        let ramp: Vec<u8> = (0..16).map(|i| 10 * i).collect();
        let real = RealPart::new(&[(1.0, row(&ramp))], &linear(), &framed, (8, 2), [0.0; 2]);
        // The first pixel's centre is at 4.25: a quarter before that of pixel 4.
        let expected: Vec<u32> = (0..8).map(|n| (257.0 * (37.5 + 5.0 * f64::from(n))).round() as u32).collect();
        assert_eq!(greens(&real), expected);
        // Catmull-Rom weights at a quarter are (−9, 111, 29, −3)/128; their squares sum to 0.80627.
        let at_a_quarter = [9.0f64, 111.0, 29.0, 3.0].map(|w| (w / 128.0).powi(2)).iter().sum::<f64>();
        assert!((real.noise_left - at_a_quarter * at_a_quarter).abs() < 1e-6, "{}", real.noise_left);
        // Three source pixels in one: nearly their mean, by the widened filter.
        let small = Crop { left_px: 0.5, top_px: 0.0, step: 3.0 };
        let real = RealPart::new(&[(1.0, row(&ramp))], &linear(), &small, (5, 1), [0.0; 2]);
        assert!(greens(&real)[1..4].windows(2).all(|w| (w[1] - w[0]).abs_diff(30 * 257) < 20), "{:?}", greens(&real));
        assert!(real.noise_left < 0.5);
    }

    #[test]
    fn shutter_weights_cover_whole_and_partial_frames() {
        let times: Vec<f64> = (0..10).map(|n| 0.1 * f64::from(n)).collect();
        let (range, parts) = shutter_weights(&times, 0.1, 5, 0.2);
        assert_eq!(range, 4..7);
        // 0.2 s around frame 5: all of it and half of each neighbour.
        for (actual, expected) in parts.iter().zip([0.25, 0.5, 0.25]) {
            assert!((actual - expected).abs() < 1e-9, "{parts:?}");
        }
        assert_eq!(shutter_weights(&times, 0.1, 5, 0.1), (5..6, vec![1.0]));
        assert_eq!(shutter_weights(&times, 0.1, 5, 0.004), (5..6, vec![1.0]));
        // At the recording's end there are fewer frames.
        let (range, parts) = shutter_weights(&times, 0.1, 9, 0.3);
        assert_eq!(range, 8..10);
        assert!((parts.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
