//! How different two pictures look when flipped between: mean FLIP (Andersson et al. 2020), by NVIDIA's own code.

use super::{MeasureError, check_mask, comparable};
use crate::pixels::Pixels;

/// For a viewer 0.7 m in front of a 0.7 m wide monitor of 3840 pixels.
pub const PIXELS_PER_DEGREE: f32 = nv_flip::DEFAULT_PIXELS_PER_DEGREE;

/// Mean FLIP, 0 (alike) to 1, where `mask` is true; everywhere without one. The pictures are sRGB-encoded; 16-bit codes
/// are reduced to 8. The whole pictures are compared; the mask only selects the pixels whose errors are averaged.
pub fn mean_flip(
    reference: &Pixels,
    test: &Pixels,
    mask: Option<&[bool]>,
    pixels_per_degree: f32,
) -> Result<f64, MeasureError> {
    comparable(reference, test)?;
    let pixels = reference.width as usize * reference.height as usize;
    check_mask(mask, pixels)?;
    if !(pixels_per_degree.is_finite() && (1.0..=1000.0).contains(&pixels_per_degree)) {
        let found = f64::from(pixels_per_degree);
        return Err(MeasureError::Option { what: "pixels_per_degree", found, accepted: "1 to 1000" });
    }
    if pixels == 0 {
        return Err(MeasureError::Nothing("a picture without pixels"));
    }
    let image = |p: &Pixels| nv_flip::FlipImageRgb8::with_data(p.width, p.height, &p.codes.to_eight_bit());
    let errors = nv_flip::flip(image(reference), image(test), pixels_per_degree).to_vec();
    let chosen = errors.iter().enumerate().filter(|(i, _)| mask.is_none_or(|m| m[*i]));
    let (sum, count) = chosen.fold((0.0, 0usize), |(sum, count), (_, &e)| (sum + f64::from(e), count + 1));
    if count == 0 {
        return Err(MeasureError::Nothing("no pixel is looked at"));
    }
    Ok(sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(code: u8) -> Pixels {
        Pixels::from_u8(32, 32, vec![code; 3 * 32 * 32]).unwrap()
    }

    #[test]
    fn equal_is_0_and_black_on_white_is_nearly_1() {
        assert_eq!(mean_flip(&flat(90), &flat(90), None, PIXELS_PER_DEGREE), Ok(0.0));
        assert!(mean_flip(&flat(0), &flat(255), None, PIXELS_PER_DEGREE).unwrap() > 0.9);
    }

    #[test]
    fn the_mask_chooses_what_is_averaged() {
        let mut half = vec![90; 3 * 32 * 32];
        half[3 * 32 * 16..].fill(200);
        let half = Pixels::from_u8(32, 32, half).unwrap();
        let rows = |from: usize, to: usize| (0..32 * 32).map(|i| (from..to).contains(&(i / 32))).collect::<Vec<_>>();
        // The filters extend over a few rows.
        assert!(mean_flip(&flat(90), &half, Some(&rows(0, 4)), PIXELS_PER_DEGREE).unwrap() < 0.01);
        assert!(mean_flip(&flat(90), &half, Some(&rows(28, 32)), PIXELS_PER_DEGREE).unwrap() > 0.3);
        assert!(mean_flip(&flat(90), &half, Some(&rows(0, 0)), PIXELS_PER_DEGREE).is_err());
        assert!(mean_flip(&flat(90), &half, None, 0.0).is_err());
    }

    #[test]
    fn sixteen_bits_are_taken_to_eight() {
        let deep = Pixels::from_u16(32, 32, vec![90 * 257 + 100; 3 * 32 * 32]).unwrap();
        assert_eq!(mean_flip(&flat(90), &deep, None, PIXELS_PER_DEGREE), Ok(0.0));
    }
}
