//! Interpolation between texels.

use std::ops::{Add, Mul, Sub};

/// Weights of a bilinear interpolation for the upper left, upper right, lower left and lower right
/// texel, at a fraction of the way to the right and down.
pub fn bilinear_weights<S>([right, down]: [S; 2]) -> [S; 4]
where
    S: Copy + From<u8> + Sub<Output = S> + Mul<Output = S>,
{
    let one = S::from(1);
    [(one - right) * (one - down), right * (one - down), (one - right) * down, right * down]
}

/// Bilinear interpolation of those texels: along the rows first, then between them.
pub fn bilinear<T, S>([a, b, c, d]: [T; 4], [right, down]: [S; 2]) -> T
where
    T: Add<Output = T> + Mul<S, Output = T>,
    S: Copy + From<u8> + Sub<Output = S>,
{
    let one = S::from(1);
    let (upper, lower) = (a * (one - right) + b * right, c * (one - right) + d * right);
    upper * (one - down) + lower * down
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_interpolation_matches_hand_calculation() {
        // Upper row 1.5, lower row 3.5; three quarters of the way down.
        assert_eq!(bilinear([1.0f32, 2.0, 3.0, 4.0], [0.5, 0.75]), 3.0);
        assert_eq!(bilinear_weights([0.5f64, 0.75]), [0.125, 0.125, 0.375, 0.375]);
    }
}
