//! Frequency bands of a noise plane: the undecimated ("à trous") B₃ spline wavelet transform
//! (Starck and Murtagh 1994).
//!
//! With h_d the kernel (1 4 6 4 1)/16 whose taps are d px apart, applied along x, y or both:
//!
//! | plane | band | formula | radius, px |
//! |---|---|---|---|
//! | Y' | 0 | d − h₁ˣd − h₁ʸd + l₁ (diagonal) | 2 |
//! | | 1 | h₁ʸd − l₁ (high along x) | 2 |
//! | | 2 | h₁ˣd − l₁ (high along y) | 2 |
//! | | 3 | l₁ − l₂ | 6 |
//! | | 4 | l₂ − l₃ | 14 |
//! | | 5 | l₃ | 14 |
//! | Cb, Cr | 0 | d − h₁ˣd (high along x) | 2 |
//! | | 1 | h₁ˣd − l₁ (high along y) | 2 |
//! | | 2 | l₁ − l₂ | 6 |
//! | | 3 | l₂ | 6 |
//!
//! l₁ = h₁ˣʸd, l₂ = h₂ˣʸl₁, l₃ = h₄ˣʸl₂. A plane's bands sum to the plane. Borders repeat. Chroma's
//! px are samples of its own plane.

use crate::grey_image::GreyImage;

/// Bands of Y', Cb and Cr.
pub const BANDS: [usize; 3] = [6, 4, 4];
/// Bands of all planes.
pub const ALL_BANDS: usize = 14;
/// The first band of each plane in lists of all bands.
pub const FIRST_BAND: [usize; 3] = [0, 6, 10];

/// The kernel's middle and one side, with taps `apart` px apart.
fn kernel(apart: usize) -> Vec<f32> {
    let mut taps = vec![0.0; 2 * apart + 1];
    (taps[0], taps[apart], taps[2 * apart]) = (6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0);
    taps
}

fn difference(a: &GreyImage, b: &GreyImage) -> GreyImage {
    let values = a.values.iter().zip(&b.values).map(|(a, b)| a - b).collect();
    GreyImage { width: a.width, height: a.height, values }
}

/// The bands of a plane: 6 for plane 0, Y', otherwise 4.
pub fn split(plane: &GreyImage, index: usize) -> Vec<GreyImage> {
    if plane.values.is_empty() {
        return vec![plane.clone(); BANDS[index]];
    }
    let across = plane.filtered_by_axis(&kernel(1), &[1.0]);
    let low_1 = across.filtered_by_axis(&[1.0], &kernel(1));
    let low_2 = low_1.filtered(&kernel(2));
    if index > 0 {
        return vec![difference(plane, &across), difference(&across, &low_1), difference(&low_1, &low_2), low_2];
    }
    let down = plane.filtered_by_axis(&[1.0], &kernel(1));
    let low_3 = low_2.filtered(&kernel(4));
    let horizontal = difference(&down, &low_1);
    let vertical = difference(&across, &low_1);
    let diagonal = difference(&difference(plane, &across), &horizontal);
    vec![diagonal, horizontal, vertical, difference(&low_1, &low_2), difference(&low_2, &low_3), low_3]
}
