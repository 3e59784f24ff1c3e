//! Gaussian means over the unmasked pixels of a picture (normalised convolution, Knutsson and
//! Westin 1993).

use crate::grey_image::GreyImage;

/// Smallest weight of the unmasked pixels that determine a mean; with less the mean tends to 0.
const MIN_WEIGHT: f32 = 0.02;

/// The blur for one mask.
pub struct MaskedBlur<'a> {
    mask: &'a [bool],
    sigma_px: f64,
    weights: GreyImage,
}

impl<'a> MaskedBlur<'a> {
    /// `mask`: true for each pixel that counts, row by row.
    pub fn new(mask: &'a [bool], [width, height]: [usize; 2], sigma_px: f64) -> Self {
        let weights = mask.iter().map(|counts| if *counts { 1.0 } else { 0.0 }).collect();
        let weights = GreyImage { width, height, values: weights }.blurred(sigma_px);
        Self { mask, sigma_px, weights }
    }

    /// Local mean of `value(i)` over unmasked pixels; `i` is the pixel's index.
    pub fn mean_of(&self, value: impl Fn(usize) -> f32) -> GreyImage {
        let GreyImage { width, height, .. } = self.weights;
        let values = self.mask.iter().enumerate().map(|(i, counts)| if *counts { value(i) } else { 0.0 }).collect();
        let mut sums = GreyImage { width, height, values }.blurred(self.sigma_px);
        sums.values.iter_mut().zip(&self.weights.values).for_each(|(sum, weight)| *sum /= weight.max(MIN_WEIGHT));
        sums
    }

    /// Whether enough unmasked pixels are near the i-th pixel.
    pub fn is_known(&self, i: usize) -> bool {
        self.weights.values[i] >= MIN_WEIGHT
    }
}
