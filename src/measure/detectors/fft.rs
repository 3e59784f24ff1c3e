//! Two-dimensional discrete Fourier transform of sides that are powers of two.

use std::sync::Arc;

use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

/// Columns that are transformed together, so that whole cache lines are read.
const COLUMN_GROUP: usize = 16;

/// Transforms of one size.
pub(super) struct Fft2 {
    pub width: usize,
    pub height: usize,
    rows: Arc<dyn Fft<f32>>,
    columns: Arc<dyn Fft<f32>>,
}

impl Fft2 {
    /// Transforms of the smallest powers of two from `width` and `height` on.
    pub fn holding(width: usize, height: usize) -> Self {
        let (width, height) = (width.next_power_of_two(), height.next_power_of_two());
        let mut planner = FftPlanner::new();
        Self { width, height, rows: planner.plan_fft_forward(width), columns: planner.plan_fft_forward(height) }
    }

    /// Σ v(x, y) exp(−2πi(ux/w + vy/h)), in place, row by row. Rows from `used_rows` on must be 0.
    pub fn forward(&self, values: &mut [Complex32], used_rows: usize) {
        self.rows.process(&mut values[..used_rows * self.width]);
        self.transform_columns(values);
    }

    /// The inverse, without the factor 1/(w h).
    pub fn inverse(&self, values: &mut [Complex32]) {
        values.iter_mut().for_each(|v| *v = v.conj());
        self.forward(values, self.height);
        values.iter_mut().for_each(|v| *v = v.conj());
    }

    fn transform_columns(&self, values: &mut [Complex32]) {
        let group = COLUMN_GROUP.min(self.width);
        let mut lines = vec![Complex32::ZERO; group * self.height];
        for x0 in (0..self.width).step_by(group) {
            for y in 0..self.height {
                let row = &values[y * self.width + x0..][..group];
                row.iter().enumerate().for_each(|(x, v)| lines[x * self.height + y] = *v);
            }
            self.columns.process(&mut lines);
            for y in 0..self.height {
                let row = &mut values[y * self.width + x0..][..group];
                row.iter_mut().enumerate().for_each(|(x, v)| *v = lines[x * self.height + y]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_matches_the_sum_of_its_definition() {
        let fft = Fft2::holding(7, 3);
        assert_eq!((fft.width, fft.height), (8, 4));
        let values: Vec<Complex32> = (0..32).map(|i| Complex32::new((i * i % 13) as f32, (i * 5 % 7) as f32)).collect();
        let mut spectrum = values.clone();
        fft.forward(&mut spectrum, 4);
        for (n, spectrum) in spectrum.iter().enumerate() {
            let mut expected = Complex32::ZERO;
            for (i, value) in values.iter().enumerate() {
                let turns = (i % 8 * (n % 8)) as f32 / 8.0 + (i / 8 * (n / 8)) as f32 / 4.0;
                expected += value * Complex32::cis(-std::f32::consts::TAU * turns);
            }
            assert!((spectrum - expected).norm() < 1e-3, "{n}");
        }
        fft.inverse(&mut spectrum);
        for (spectrum, value) in spectrum.iter().zip(&values) {
            assert!((spectrum / 32.0 - value).norm() < 1e-5);
        }
    }

    #[test]
    fn sides_of_one_pixel_are_transformed() {
        let fft = Fft2::holding(1, 2);
        let mut values = [1.0, 3.0].map(|re| Complex32::new(re, 0.0));
        fft.forward(&mut values, 2);
        assert_eq!(values, [4.0, -2.0].map(|re| Complex32::new(re, 0.0)));
    }
}
