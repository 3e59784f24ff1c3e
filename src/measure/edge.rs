//! Measures an edge: its position, its width, and the length of the motion blur that caused it.

use glam::DVec2;

use super::MeasureError;
use crate::grey_image::GreyImage;

/// An edge along a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Position of the half-way crossing, in pixels from the first sample.
    pub position_px: f64,
    /// Width from 10 % to 90 % of the step, pixels.
    pub width_10_90_px: f64,
    /// Values before and after the edge.
    pub before: f64,
    pub after: f64,
}

/// Finds the edge in a profile of evenly spaced samples, `pitch_px` apart, rising or falling. The
/// first and last tenth of the profile (at least one sample) must be flat; their means are 0 % and
/// 100 %.
pub fn edge(profile: &[f64], pitch_px: f64) -> Result<Edge, MeasureError> {
    if !(pitch_px.is_finite() && pitch_px > 0.0) {
        return Err(MeasureError::Option { what: "pitch_px", actual: pitch_px, accepted: "more than 0" });
    }
    let n = profile.len();
    if n < 4 {
        return Err(MeasureError::Nothing("an edge needs four samples or more"));
    }
    let flat = (n / 10).max(1);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (before, after) = (mean(&profile[..flat]), mean(&profile[n - flat..]));
    let step = after - before;
    if !step.is_finite() || step.abs() < 1e-9 {
        return Err(MeasureError::Nothing("the profile has no edge: both its ends are alike"));
    }
    let share: Vec<f64> = profile.iter().map(|v| (v - before) / step).collect();
    // From the half-way crossing outwards, so that ripples on the flats do not count.
    let crossing = |level: f64, i: usize| i as f64 + (level - share[i]) / (share[i + 1] - share[i]);
    let rises = |level: f64, i: usize| share[i] < level && share[i + 1] >= level;
    let missing = MeasureError::Nothing("the profile does not pass 10, 50 and 90 %");
    let middle = (0..n - 1).find(|&i| rises(0.5, i)).ok_or_else(|| missing.clone())?;
    let low = (0..=middle).rev().find(|&i| rises(0.1, i)).ok_or_else(|| missing.clone())?;
    let high = (middle..n - 1).find(|&i| rises(0.9, i)).ok_or(missing)?;
    Ok(Edge {
        position_px: pitch_px * crossing(0.5, middle),
        width_10_90_px: pitch_px * (crossing(0.9, high) - crossing(0.1, low)),
        before,
        after,
    })
}

/// Linear motion during the exposure, estimated from an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxBlur {
    /// Length of the edge's motion, pixels. Below one sample it cannot be distinguished from a
    /// sharp edge between two samples.
    pub length_px: f64,
    /// The middle of the motion, in pixels from the profile's first sample.
    pub position_px: f64,
    /// Root mean square residual of the fit, as a share of the step. Large if the edge is not a
    /// blurred step.
    pub residual: f64,
}

/// Fits a box-blurred step to a profile (as for [`edge`]) by least squares. Each sample is the mean
/// over `aperture_px`: 1 for pixels. Unlike a width between crossings, the fit does not depend on
/// the sample spacing.
pub fn box_blur(profile: &[f64], pitch_px: f64, aperture_px: f64) -> Result<BoxBlur, MeasureError> {
    let start = edge(profile, pitch_px)?;
    if !(aperture_px.is_finite() && aperture_px > 0.0) {
        return Err(MeasureError::Option { what: "aperture_px", actual: aperture_px, accepted: "more than 0" });
    }
    let residual = |position: f64, length: f64| residual(profile, pitch_px, aperture_px, position, length);
    let (mut position, mut length) = (start.position_px, start.width_10_90_px / 0.8);
    let mut best = residual(position, length);
    let mut step = 0.5 * start.width_10_90_px.max(pitch_px);
    while step > 1e-4 * pitch_px {
        let tries = [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)];
        let candidate = tries
            .map(|(p, l)| (position + p, (length + l).max(0.0)))
            .map(|(p, l)| (residual(p, l), p, l))
            .into_iter()
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match candidate {
            Some((value, p, l)) if value < best => (best, position, length) = (value, p, l),
            _ => step *= 0.5,
        }
    }
    Ok(BoxBlur { length_px: length, position_px: position, residual: best / (start.after - start.before).abs() })
}

/// The residual of a profile after fitting a blurred step's offset and height.
fn residual(profile: &[f64], pitch: f64, aperture: f64, position: f64, length: f64) -> f64 {
    let half = 0.5 * length;
    // ∫ clamp(s/L + 1/2, 0, 1) ds.
    let area = |s: f64| {
        if s <= -half {
            0.0
        } else if s >= half {
            s
        } else {
            (s + half).powi(2) / (2.0 * length)
        }
    };
    let model = |i: usize| {
        let x = i as f64 * pitch - position;
        (area(x + 0.5 * aperture) - area(x - 0.5 * aperture)) / aperture
    };
    let n = profile.len() as f64;
    let (mut m, mut v, mut mm, mut mv, mut vv) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (i, &value) in profile.iter().enumerate() {
        let model = model(i);
        (m, v, mm, mv, vv) = (m + model, v + value, mm + model * model, mv + model * value, vv + value * value);
    }
    let (mm, mv, vv) = (mm - m * m / n, mv - m * v / n, vv - v * v / n);
    let explained = if mm > 0.0 { mv * mv / mm } else { 0.0 };
    ((vv - explained).max(0.0) / n).sqrt()
}

/// The values along a line from `from` to `to` (raster coordinates, pixel centres at +0.5),
/// `pitch_px` apart. Each is the mean over `across_px` perpendicular to the line, bilinear between
/// pixels.
pub fn profile(
    picture: &GreyImage<f64>,
    from: [f64; 2],
    to: [f64; 2],
    pitch_px: f64,
    across_px: f64,
) -> Result<Vec<f64>, MeasureError> {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length = dx.hypot(dy);
    if !(length.is_finite() && length > 0.0 && length < 1e6) {
        return Err(MeasureError::Option { what: "length", actual: length, accepted: "more than 0, below 1e6 px" });
    }
    if !(pitch_px.is_finite() && pitch_px >= 0.01) {
        return Err(MeasureError::Option { what: "pitch_px", actual: pitch_px, accepted: "0.01 or more" });
    }
    if !(across_px.is_finite() && (0.0..=1e4).contains(&across_px)) {
        return Err(MeasureError::Option { what: "across_px", actual: across_px, accepted: "0 to 10000" });
    }
    let (ux, uy) = (dx / length, dy / length);
    let rows = across_px.round().max(1.0);
    let samples = (length / pitch_px).floor() as usize + 1;
    Ok((0..samples)
        .map(|i| {
            let along = i as f64 * pitch_px;
            let sum: f64 = (0..rows as usize)
                .map(|row| {
                    let side = (row as f64 + 0.5) / rows * across_px - 0.5 * across_px;
                    picture.sample(DVec2::new(from[0] + ux * along - uy * side, from[1] + uy * along + ux * side))
                })
                .sum();
            sum / rows
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sharp edge at `position`, blurred over `length`, sampled by pixels: brute force over 200
    /// slices each.
    fn blurred(n: usize, position: f64, length: f64) -> Vec<f64> {
        (0..n)
            .map(|i| {
                let slices = (0..200).map(|s| {
                    let x = i as f64 + (f64::from(s) + 0.5) / 200.0;
                    if length == 0.0 {
                        f64::from(x > position)
                    } else {
                        ((x - position) / length + 0.5).clamp(0.0, 1.0)
                    }
                });
                50.0 + 100.0 * slices.sum::<f64>() / 200.0
            })
            .collect()
    }

    #[test]
    fn box_blur_length_is_accurate_to_a_twentieth_of_a_pixel() {
        for length in [2.0, 3.3, 5.0, 8.0, 12.5, 20.0, 40.0] {
            for shift in [0.0, 0.3, 0.5] {
                let profile = blurred(80, 40.0 + shift, length);
                let blur = box_blur(&profile, 1.0, 1.0).unwrap();
                // Sample 0 is the pixel whose centre is at 0.5.
                assert!((blur.position_px + 0.5 - 40.0 - shift).abs() < 0.02, "{blur:?} at {shift}");
                assert!((blur.length_px - length).abs() < 0.05, "{blur:?} for {length} at {shift}");
                assert!(blur.residual < 0.01);
            }
        }
        assert!(box_blur(&[0.0; 20], 1.0, 1.0).is_err() && box_blur(&blurred(80, 40.0, 3.0), 1.0, 0.0).is_err());
    }

    #[test]
    fn box_blur_is_robust_to_noise_and_rejects_a_gaussian_edge() {
        let mut profile = blurred(80, 40.2, 10.0);
        for (i, value) in profile.iter_mut().enumerate() {
            *value += 2.0 * (i as f64 * 12.9898).sin();
        }
        let blur = box_blur(&profile, 1.0, 1.0).unwrap();
        assert!((blur.length_px - 10.0).abs() < 0.4 && blur.residual > 0.01, "{blur:?}");
        let soft: Vec<f64> = (0..80).map(|i| (f64::from(i - 40) / 6.0).tanh()).collect();
        assert!(box_blur(&soft, 1.0, 1.0).unwrap().residual > 0.01);
    }

    #[test]
    fn ramp_width_matches_hand_calculation() {
        let ramp: Vec<f64> = (0..21).map(|i| f64::from((i - 5).clamp(0, 10))).collect();
        let rising = edge(&ramp, 0.5).unwrap();
        assert!((rising.position_px - 5.0).abs() < 1e-12 && (rising.width_10_90_px - 4.0).abs() < 1e-12, "{rising:?}");
        let falling: Vec<f64> = ramp.iter().rev().map(|v| v - 3.0).collect();
        let falling_edge = edge(&falling, 0.5).unwrap();
        assert!(
            (falling_edge.position_px - 5.0).abs() < 1e-12 && (falling_edge.width_10_90_px - 4.0).abs() < 1e-12,
            "{falling_edge:?}"
        );
        assert_eq!((falling_edge.before, falling_edge.after), (7.0, -3.0));
    }

    #[test]
    fn profile_without_an_edge_is_an_error() {
        assert!(edge(&[1.0; 20], 1.0).is_err() && edge(&[0.0, 1.0], 1.0).is_err());
        assert!(edge(&[0.0, 0.0, 1.0, 1.0], 0.0).is_err() && edge(&[f64::NAN; 9], 1.0).is_err());
    }

    #[test]
    fn profile_samples_perpendicular_to_the_line() {
        // Pixels whose centres have x + y > 40: the last dark centres are at 40, the first bright
        // ones at 41.
        let picture = GreyImage::new(60, 60, (0..3600).map(|i| f64::from(i % 60 + i / 60 + 1 > 40)).collect()).unwrap();
        let along = profile(&picture, [8.0, 8.0], [32.0, 32.0], 0.25, 9.0).unwrap();
        let step = edge(&along, 0.25).unwrap();
        assert!((step.position_px - (20.25 - 8.0) * 2f64.sqrt()).abs() < 0.15, "{step:?}");
        assert!(profile(&picture, [8.0, 8.0], [8.0, 8.0], 0.25, 9.0).is_err());
        assert!(profile(&picture, [8.0, 8.0], [9.0, f64::NAN], 0.25, 9.0).is_err());
    }
}
