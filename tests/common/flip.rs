//! Perceived difference of two pictures by mean FLIP (Andersson et al. 2020), with NVIDIA's own
//! code.

use locard::pixels::Pixels;

/// For a viewer 0.7 m in front of a 0.7 m wide monitor of 3840 pixels.
pub const PIXELS_PER_DEGREE: f32 = nv_flip::DEFAULT_PIXELS_PER_DEGREE;

/// Mean FLIP, 0 (equal) to 1, over the pixels of `mask`, or all. The pictures are sRGB-encoded;
/// 16-bit codes are reduced to 8. The whole pictures are compared; the mask only selects the pixels
/// whose errors are averaged.
///
/// # Panics
/// If the pictures or the mask differ in size, or no pixel is selected.
pub fn mean_flip(reference: &Pixels, test: &Pixels, mask: Option<&[bool]>, pixels_per_degree: f32) -> f64 {
    assert_eq!((reference.width, reference.height), (test.width, test.height), "two pictures of one size");
    assert!(mask.is_none_or(|m| m.len() == reference.width as usize * reference.height as usize), "a value per pixel");
    let image = |p: &Pixels| nv_flip::FlipImageRgb8::with_data(p.width, p.height, &p.codes.to_eight_bit());
    let errors = nv_flip::flip(image(reference), image(test), pixels_per_degree).to_vec();
    let chosen = errors.iter().enumerate().filter(|(i, _)| mask.is_none_or(|m| m[*i]));
    let (sum, count) = chosen.fold((0.0, 0usize), |(sum, count), (_, &e)| (sum + f64::from(e), count + 1));
    assert!(count > 0, "no pixel is selected");
    sum / count as f64
}
