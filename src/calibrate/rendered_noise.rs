//! Rendered noise: the difference between a picture with noise and the same picture without.

use super::bins::chi_square_interval;
use super::points::NoisePoint;
use super::rounding::Rounding;
use crate::measure::MeasureError;
use crate::pixels::Pixels;

/// Number of intensity bins over 0 to 255.
const BINS: usize = 16;
/// Smallest number of pixels of a point.
const MIN_PIXELS: f64 = 60.0;
/// Codes closer to an end of the range are skipped, because their noise is clipped.
const CODE_MARGIN: f64 = 10.0;

/// σ of R, G and B by intensity, over the pixels of a mask, of 8-bit pictures that differ by noise
/// alone. The interval assumes independent pixels.
pub fn rendered_noise(with: &Pixels, without: &Pixels, mask: &[bool]) -> Result<[Vec<NoisePoint>; 3], MeasureError> {
    let pixels = without.width as usize * without.height as usize;
    if (with.width, with.height) != (without.width, without.height) {
        let size = |p: &Pixels| format!("{}x{}", p.width, p.height);
        return Err(MeasureError::Sizes { a: size(with), b: size(without) });
    }
    if mask.len() != pixels {
        return Err(MeasureError::Length { what: "the mask", actual: mask.len(), expected: pixels });
    }
    let scale = 255.0 / f64::from(without.max_code());
    // Count, sum of codes, of differences, of their squares.
    let mut sums = [[[0.0; 4]; BINS]; 3];
    for (i, _) in mask.iter().enumerate().filter(|(_, is_visible)| **is_visible) {
        let (x, y) = ((i % without.width as usize) as u32, (i / without.width as usize) as u32);
        let (noisy, plain) = (with.at(x, y), without.at(x, y));
        for c in 0..3 {
            let code = scale * f64::from(plain[c]);
            if (CODE_MARGIN..=255.0 - CODE_MARGIN).contains(&code) {
                let difference = scale * f64::from(noisy[c]) - code;
                let bin = &mut sums[c][(code / 256.0 * BINS as f64) as usize];
                [1.0, code, difference, difference * difference].iter().zip(bin).for_each(|(add, sum)| *sum += add);
            }
        }
    }
    let step = if without.max_code() == 255 { 1.0 } else { scale };
    let rounding = Rounding { frame_step: step, mean_step: Some(step) };
    Ok(sums.map(|bins| {
        let measured = bins.into_iter().filter(|bin| bin[0] >= MIN_PIXELS);
        let point = |[count, codes, sum, squares]: [f64; 4]| {
            let variance = (squares - sum * sum / count) / (count - 1.0);
            let factors = chi_square_interval(count - 1.0)?;
            Some(NoisePoint {
                code: codes / count,
                sigma: rounding.sigma(variance),
                sigma_ci95: factors.map(|factor| rounding.sigma(variance * factor)),
                independent_count: count - 1.0,
            })
        };
        measured.filter_map(point).collect()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rendered_noise_matches_computed_sigma() {
        let without = Pixels::from_u8(10, 10, vec![100; 300]).unwrap();
        // Alternating ±4: variance 16·100/99. Rounding of both adds 1/6.
        let with = Pixels::from_u8(10, 10, (0..300).map(|i| if i / 3 % 2 == 0 { 96 } else { 104 }).collect()).unwrap();
        let channels = rendered_noise(&with, &without, &[true; 100]).unwrap();
        let expected = (1600.0f64 / 99.0 - 1.0 / 6.0).sqrt();
        for points in &channels {
            assert_eq!(points.len(), 1);
            assert!((points[0].sigma - expected).abs() < 1e-6 && points[0].code == 100.0, "{points:?}");
        }
        // Too few pixels, and a mask of another size.
        let few: Vec<bool> = (0..100).map(|i| i < 59).collect();
        assert!(rendered_noise(&with, &without, &few).unwrap().iter().all(Vec::is_empty));
        assert!(rendered_noise(&with, &without, &[true]).is_err());
    }
}
