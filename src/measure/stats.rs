//! Difference statistics: mean absolute error, PSNR, number of differing pixels.

use super::{MeasureError, check_mask, comparable};
use crate::pixels::{Codes, Pixels};

/// Differences of two pictures over the selected pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels in which any channel differs.
    pub differing: usize,
    /// Largest difference of code values.
    pub largest: u32,
    /// Mean absolute difference of code values.
    pub mean_absolute: f64,
    /// Mean squared difference of code values.
    pub mean_squared: f64,
    /// Peak signal to noise ratio, dB; infinite for equal pictures.
    pub psnr_db: f64,
}

/// Compares code values where `mask` is true; everywhere without one.
pub fn difference(a: &Pixels, b: &Pixels, mask: Option<&[bool]>) -> Result<Difference, MeasureError> {
    comparable(a, b)?;
    check_mask(mask, a.width as usize * a.height as usize)?;
    let peak = a.max_code();
    match (&a.codes, &b.codes) {
        (Codes::U8(a), Codes::U8(b)) => summed(a, b, mask, peak),
        (Codes::U16(a), Codes::U16(b)) => summed(a, b, mask, peak),
        _ => Err(MeasureError::Depths),
    }
}

fn summed<T: Copy + Into<u32>>(a: &[T], b: &[T], mask: Option<&[bool]>, peak: u32) -> Result<Difference, MeasureError> {
    let (mut pixels, mut differing, mut largest, mut absolute, mut squared) = (0usize, 0usize, 0u32, 0u64, 0.0f64);
    for (i, (a, b)) in a.chunks_exact(3).zip(b.chunks_exact(3)).enumerate() {
        if mask.is_some_and(|m| !m[i]) {
            continue;
        }
        pixels += 1;
        let before = absolute;
        for (&a, &b) in a.iter().zip(b) {
            let d = a.into().abs_diff(b.into());
            largest = largest.max(d);
            absolute += u64::from(d);
            squared += f64::from(d) * f64::from(d);
        }
        differing += usize::from(absolute != before);
    }
    if pixels == 0 {
        return Err(MeasureError::Nothing("no pixel is selected"));
    }
    let values = 3.0 * pixels as f64;
    let mean_squared = squared / values;
    let psnr_db = 10.0 * (f64::from(peak).powi(2) / mean_squared).log10();
    Ok(Difference { pixels, differing, largest, mean_absolute: absolute as f64 / values, mean_squared, psnr_db })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_statistics_match_hand_calculation() {
        let a = Pixels::from_u8(2, 1, vec![10, 20, 30, 40, 50, 60]).unwrap();
        let b = Pixels::from_u8(2, 1, vec![10, 20, 33, 36, 50, 60]).unwrap();
        let all = difference(&a, &b, None).unwrap();
        assert_eq!((all.pixels, all.differing, all.largest), (2, 2, 4));
        assert!((all.mean_absolute - 7.0 / 6.0).abs() < 1e-12 && (all.mean_squared - 25.0 / 6.0).abs() < 1e-12);
        // 10 log10(65025 · 6/25) = 41.933.
        assert!((all.psnr_db - 41.933).abs() < 1e-3, "{}", all.psnr_db);
        let first = difference(&a, &b, Some(&[true, false])).unwrap();
        assert_eq!((first.pixels, first.largest), (1, 3));
        assert_eq!(difference(&a, &a, None).unwrap().psnr_db, f64::INFINITY);
    }

    #[test]
    fn psnr_of_16_bits_refers_to_their_maximum() {
        // 65535 = 257 · 255: codes 257 times as large have the same PSNR as in 8 bits.
        let pixels = |codes: [u16; 6]| Pixels::from_u16(2, 1, codes.map(|code| 257 * code).to_vec()).unwrap();
        let (a, b) = (pixels([10, 20, 30, 40, 50, 60]), pixels([10, 20, 33, 36, 50, 60]));
        let difference = difference(&a, &b, None).unwrap();
        assert_eq!((difference.largest, difference.mean_absolute), (4 * 257, 7.0 * 257.0 / 6.0));
        // 10 log10(65025 · 6/25) = 41.933, as of 8 bits.
        assert!((difference.psnr_db - 41.933).abs() < 1e-3, "{}", difference.psnr_db);
    }

    #[test]
    fn incomparable_pictures_are_an_error() {
        let a = Pixels::from_u8(2, 1, vec![0; 6]).unwrap();
        let tall = Pixels::from_u8(1, 2, vec![0; 6]).unwrap();
        let deep = Pixels::from_u16(2, 1, vec![0; 6]).unwrap();
        assert!(difference(&a, &tall, None).unwrap_err().to_string().contains("2x1 and 1x2"));
        assert_eq!(difference(&a, &deep, None), Err(MeasureError::Depths));
        assert!(matches!(difference(&a, &a, Some(&[true])), Err(MeasureError::Length { .. })));
        assert!(matches!(difference(&a, &a, Some(&[false; 2])), Err(MeasureError::Nothing(_))));
    }
}
