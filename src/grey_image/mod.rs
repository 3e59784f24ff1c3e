//! Pictures of one value per pixel.

mod filter;
mod morphology;

use glam::DVec2;

use crate::interpolation::bilinear;
use crate::pixels::{Pixels, luma_709};

pub use filter::gaussian;
pub use morphology::{dilated, eroded};

/// Values of any unit, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct GreyImage<T = f32> {
    pub width: usize,
    pub height: usize,
    /// `width * height` values.
    pub values: Vec<T>,
}

impl<T> GreyImage<T> {
    /// `None` if the length is not `width * height`.
    pub fn new(width: usize, height: usize, values: Vec<T>) -> Option<Self> {
        (width.checked_mul(height) == Some(values.len())).then_some(Self { width, height, values })
    }

    /// Evaluates a function of column and row.
    pub fn from_fn(width: usize, height: usize, value: impl Fn(usize, usize) -> T) -> Self {
        let value = &value;
        let values = (0..height).flat_map(|y| (0..width).map(move |x| value(x, y))).collect();
        Self { width, height, values }
    }

    /// Evaluates a function of every pixel's code values.
    pub fn of_codes(pixels: &Pixels, value: impl Fn([u32; 3]) -> T) -> Self {
        Self { width: pixels.width as usize, height: pixels.height as usize, values: pixels.each(value) }
    }

    /// True if a point is inside, at least `margin` px from the border.
    pub fn holds(&self, at: DVec2, margin: f64) -> bool {
        let is_inside = |v: f64, n: usize| v >= margin && v <= n as f64 - margin;
        is_inside(at.x, self.width) && is_inside(at.y, self.height)
    }
}

impl<T: Copy + Default> GreyImage<T> {
    pub fn uniform(width: usize, height: usize, value: T) -> Self {
        Self { width, height, values: vec![value; width * height] }
    }

    /// The value of a pixel, with the border repeated beyond it. 0 for an empty picture.
    pub fn clamped(&self, x: i64, y: i64) -> T {
        let clamped_index = |v: i64, n: usize| v.min(n as i64 - 1).max(0) as usize;
        self.values
            .get(clamped_index(y, self.height) * self.width + clamped_index(x, self.width))
            .copied()
            .unwrap_or_default()
    }

    /// Bilinear sample of a function of the values, with the border repeated, px with pixel centres
    /// at +0.5.
    pub fn sample_of(&self, at: DVec2, value: impl Fn(T) -> f64) -> f64 {
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
        bilinear(corners.map(|(dx, dy)| value(self.clamped(left as i64 + dx, top as i64 + dy))), [x - left, y - top])
    }

    /// Bilinear sample, with the border repeated, px with pixel centres at +0.5.
    pub fn sample(&self, at: DVec2) -> f64
    where
        T: Into<f64>,
    {
        self.sample_of(at, T::into)
    }
}

impl GreyImage<f64> {
    /// Luma of encoded codes (BT.709 weights), on the 8-bit scale.
    pub fn luma_709(pixels: &Pixels) -> Self {
        let scale = 255.0 / f64::from(pixels.max_code());
        Self::of_codes(pixels, |codes| scale * luma_709(codes.map(f64::from)))
    }
}

impl GreyImage {
    /// Luma of encoded codes (BT.601 weights), on the 8-bit scale.
    pub fn luma_601(pixels: &Pixels) -> Self {
        let scale = 255.0 / pixels.max_code() as f32;
        Self::of_codes(pixels, |codes| {
            let [r, g, b] = codes.map(|code| code as f32);
            scale * (0.299 * r + 0.587 * g + 0.114 * b)
        })
    }

    /// A channel's codes, on the 8-bit scale.
    pub fn of_channel(pixels: &Pixels, channel: usize) -> Self {
        let scale = 255.0 / pixels.max_code() as f32;
        Self::of_codes(pixels, |codes| scale * codes[channel] as f32)
    }

    /// Bilinear sample in 32 bits, at coordinates whose whole numbers are pixel centres; `None`
    /// beyond the outermost centres.
    #[inline]
    pub fn sample_inside(&self, x: f32, y: f32) -> Option<f32> {
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        if column + 1 >= self.width || row + 1 >= self.height {
            return None;
        }
        let (fx, fy) = (x - column as f32, y - row as f32);
        let i = row * self.width + column;
        let (upper, lower) = (&self.values[i..i + 2], &self.values[i + self.width..i + self.width + 2]);
        // One multiplication less for each pair than by weights.
        let a = upper[0] + fx * (upper[1] - upper[0]);
        let b = lower[0] + fx * (lower[1] - lower[0]);
        Some(a + fy * (b - a))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_of_a_ramp_are_exact_and_repeat_the_border() {
        let ramp = GreyImage::from_fn(4, 3, |x, y| (10 * x + 100 * y) as f32);
        assert_eq!(ramp.sample(DVec2::new(2.0, 1.25)), 90.0);
        assert_eq!((ramp.sample(DVec2::new(-5.0, 0.5)), ramp.clamped(9, 9)), (0.0, 230.0));
        assert_eq!((ramp.sample_inside(1.5, 0.75), ramp.sample_inside(3.0, 0.0)), (Some(90.0), None));
        assert_eq!(GreyImage::<f32>::uniform(0, 0, 1.0).clamped(0, 0), 0.0);
        assert_eq!(GreyImage::new(2, 2, vec![0.0; 3]), None::<GreyImage>);
    }
}
