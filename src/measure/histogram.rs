//! Intensity histograms.

use super::{MeasureError, check_mask};
use crate::grey_image::GreyImage;
use crate::pixels::Pixels;

/// Histograms of a mask's pixels: luma, red, green and blue on the 8-bit scale, in `bins` of equal
/// width from 0 to 255; each sums to 1. Empty if the mask is empty.
pub fn histograms(pixels: &Pixels, mask: &[bool], bins: usize) -> Result<[Vec<f64>; 4], MeasureError> {
    check_mask(Some(mask), pixels.width as usize * pixels.height as usize)?;
    if bins == 0 {
        return Err(MeasureError::Option { what: "bins", actual: 0.0, accepted: "1 or more" });
    }
    let (luma, scale) = (GreyImage::luma_709(pixels), 255.0 / f64::from(pixels.max_code()));
    let mut counts = [(); 4].map(|()| vec![0.0; bins]);
    let mut all = 0.0;
    for (i, luma) in luma.values.iter().enumerate().filter(|(i, _)| mask[*i]) {
        let [r, g, b] = pixels.at(i as u32 % pixels.width, i as u32 / pixels.width).map(|code| scale * f64::from(code));
        for (counts, value) in counts.iter_mut().zip([*luma, r, g, b]) {
            counts[((value / 256.0 * bins as f64) as usize).min(bins - 1)] += 1.0;
        }
        all += 1.0;
    }
    let share = |counts: Vec<f64>| counts.into_iter().map(|count| count / all).collect();
    Ok(if all > 0.0 { counts.map(share) } else { Default::default() })
}

/// Surroundings of a mask: pixels at most `reach` px from it along rows and columns, and not in
/// `without`.
pub fn dilated_ring(mask: &[bool], without: &[bool], width: usize, reach: usize) -> Vec<bool> {
    if width == 0 {
        return Vec::new();
    }
    // Distance to the last mask pixel along rows, then along columns, from both ends.
    let spread = |from: &[bool], step: usize, length: usize, starts: &dyn Fn(usize) -> usize, count: usize| {
        let mut out = vec![false; from.len()];
        for line in 0..count {
            let start = starts(line);
            for forward in [true, false] {
                let mut since = usize::MAX;
                for k in 0..length {
                    let i = start + step * if forward { k } else { length - 1 - k };
                    since = if from[i] { 0 } else { since.saturating_add(1) };
                    out[i] |= since <= reach;
                }
            }
        }
        out
    };
    let height = mask.len() / width;
    let rows = spread(mask, 1, width, &|y| y * width, height);
    let all = spread(&rows, width, height, &|x| x, width);
    all.iter().zip(mask).zip(without).map(|((near, inside), without)| *near && !inside && !without).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histogram_shares_match_hand_calculation() {
        // Lumas 0, 128 and 255.
        let pixels = Pixels::from_u8(3, 1, vec![0, 0, 0, 128, 128, 128, 255, 255, 255]).unwrap();
        let grey = [1.0 / 3.0, 2.0 / 3.0];
        assert_eq!(histograms(&pixels, &[true; 3], 2).unwrap(), [grey; 4]);
        assert_eq!(histograms(&pixels, &[false, true, false], 4).unwrap(), [[0.0, 0.0, 1.0, 0.0]; 4]);
        assert!(histograms(&pixels, &[false; 3], 4).unwrap().iter().all(Vec::is_empty));
        assert!(histograms(&pixels, &[true], 4).is_err() && histograms(&pixels, &[true; 3], 0).is_err());
        // 16 bits, and separate channels: R 0, G half, B full; luma 0.7152 · 128 + 0.0722 · 255 =
        // 110.
        let pixels = Pixels::from_u16(1, 1, vec![0, 128 * 257, 65535]).unwrap();
        let [luma, r, g, b] = histograms(&pixels, &[true], 4).unwrap();
        assert_eq!((luma, r), (vec![0.0, 1.0, 0.0, 0.0], vec![1.0, 0.0, 0.0, 0.0]));
        assert_eq!((g, b), (vec![0.0, 0.0, 1.0, 0.0], vec![0.0, 0.0, 0.0, 1.0]));
    }

    #[test]
    fn surroundings_match_hand_calculation() {
        let mask: Vec<bool> = (0..35).map(|i| i == 17).collect();
        let mut without = vec![false; 35];
        without[16] = true;
        // The middle of 7×5 pixels: 3×3 around it, without itself and its left neighbour.
        let ring = dilated_ring(&mask, &without, 7, 1);
        let places: Vec<usize> = (0..35).filter(|i| ring[*i]).collect();
        assert_eq!(places, [9, 10, 11, 18, 23, 24, 25]);
    }
}
