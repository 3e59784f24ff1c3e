//! Filters of grey images: convolutions, reductions, gradients.

use glam::DVec2;

use super::GreyImage;

impl GreyImage {
    /// Convolved along rows and columns with a symmetric kernel: its middle, then one side. Edges
    /// repeat.
    pub fn filtered(&self, kernel: &[f32]) -> Self {
        self.filtered_by_axis(kernel, kernel)
    }

    /// Convolved along rows with one symmetric kernel, along columns with another.
    pub fn filtered_by_axis(&self, along_rows: &[f32], along_columns: &[f32]) -> Self {
        let (w, h) = (self.width, self.height);
        let reach = along_rows.len() - 1;
        let mut across = Self::uniform(w, h, 0.0);
        let mut padded = vec![0.0; w + 2 * reach];
        for (out, row) in across.values.chunks_mut(w.max(1)).zip(self.values.chunks(w.max(1))) {
            padded[..reach].fill(row[0]);
            padded[reach..reach + w].copy_from_slice(row);
            padded[reach + w..].fill(row[w - 1]);
            out.iter_mut().zip(&padded[reach..]).for_each(|(out, value)| *out = along_rows[0] * value);
            for (k, weight) in along_rows.iter().enumerate().skip(1) {
                let (left, right) = (&padded[reach - k..], &padded[reach + k..]);
                out.iter_mut().zip(left.iter().zip(right)).for_each(|(out, (a, b))| *out += weight * (a + b));
            }
        }
        let mut down = Self::uniform(w, h, 0.0);
        for (y, out) in down.values.chunks_mut(w.max(1)).enumerate() {
            let row = |y: usize| &across.values[y * w..(y + 1) * w];
            out.iter_mut().zip(row(y)).for_each(|(out, value)| *out = along_columns[0] * value);
            for (k, weight) in along_columns.iter().enumerate().skip(1) {
                let (above, below) = (row(y.saturating_sub(k)), row((y + k).min(h - 1)));
                out.iter_mut().zip(above.iter().zip(below)).for_each(|(out, (a, b))| *out += weight * (a + b));
            }
        }
        down
    }

    /// Half as large: smoothed by (1 4 6 4 1)/16, then every other pixel from the first (Burt and
    /// Adelson 1983). Its pixel k stands on this one's pixel 2k.
    pub fn halved(&self) -> Self {
        let smooth = self.filtered(&[6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0]);
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let rows = smooth.values.chunks(self.width.max(1)).step_by(2);
        Self { width, height, values: rows.flat_map(|row| row.iter().step_by(2).copied()).collect() }
    }

    /// Reduced by the mean of `by * by` pixels. Coordinates are divided by `by`; incomplete blocks
    /// are dropped.
    pub fn reduced(&self, by: usize) -> Self {
        let by = by.max(1);
        if by == 1 {
            return self.clone();
        }
        let share = 1.0 / (by * by) as f32;
        Self::from_fn(self.width / by, self.height / by, |x, y| {
            let row = |j: usize| {
                let from = (by * y + j) * self.width + by * x;
                self.values[from..from + by].iter().sum::<f32>()
            };
            share * (0..by).map(row).sum::<f32>()
        })
    }

    /// Blurred by a Gaussian of this standard deviation, px, truncated at three of them.
    pub fn blurred(&self, sigma_px: f64) -> Self {
        let reach = (3.0 * sigma_px).ceil() as i64;
        let tap = |i: i64| (-0.5 * (i as f64 / sigma_px).powi(2)).exp();
        let sum: f64 = (-reach..=reach).map(tap).sum();
        let taps: Vec<f32> = (-reach..=reach).map(|i| (tap(i) / sum) as f32).collect();
        let mut padded = vec![0.0; self.width + 2 * reach as usize];
        let mut across = Self { width: self.width, height: self.height, values: Vec::with_capacity(self.values.len()) };
        for y in 0..self.height {
            for (i, value) in padded.iter_mut().enumerate() {
                *value = self.clamped(i as i64 - reach, y as i64);
            }
            across
                .values
                .extend(padded.windows(taps.len()).map(|w| w.iter().zip(&taps).map(|(v, t)| v * t).sum::<f32>()));
        }
        let mut out = Self { width: self.width, height: self.height, values: vec![0.0; self.values.len()] };
        for (y, row) in out.values.chunks_mut(self.width.max(1)).enumerate() {
            for (tap, dy) in taps.iter().zip(-reach..) {
                let from = (y as i64 + dy).clamp(0, self.height as i64 - 1) as usize * self.width;
                let source = &across.values[from..from + self.width];
                row.iter_mut().zip(source).for_each(|(value, s)| *value += tap * s);
            }
        }
        out
    }

    /// Gradients along x and y, per px, by Sobel's operator; 0 at the border.
    pub fn sobel(&self) -> (Self, Self) {
        let (w, h) = (self.width, self.height);
        let (mut along, mut down) = (Self::uniform(w, h, 0.0), Self::uniform(w, h, 0.0));
        for y in 1..h.saturating_sub(1) {
            for x in 1..w.saturating_sub(1) {
                let v = |dx: usize, dy: usize| self.values[(y + dy - 1) * w + x + dx - 1];
                let i = y * w + x;
                along.values[i] = ((v(2, 0) - v(0, 0)) + 2.0 * (v(2, 1) - v(0, 1)) + (v(2, 2) - v(0, 2))) / 8.0;
                down.values[i] = ((v(0, 2) - v(0, 0)) + 2.0 * (v(1, 2) - v(1, 0)) + (v(2, 2) - v(2, 0))) / 8.0;
            }
        }
        (along, down)
    }

    /// Gradient at a pixel, per px: central differences.
    pub fn gradient(&self, x: i64, y: i64) -> DVec2 {
        let half = |a: f32, b: f32| 0.5 * f64::from(b - a);
        DVec2::new(
            half(self.clamped(x - 1, y), self.clamped(x + 1, y)),
            half(self.clamped(x, y - 1), self.clamped(x, y + 1)),
        )
    }
}

/// A Gaussian's samples: the middle, then one side, summing to 1.
pub fn gaussian(sigma: f32) -> Vec<f32> {
    let side: Vec<f32> =
        (0..=(3.5 * sigma).ceil() as usize).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
    let sum = 2.0 * side.iter().sum::<f32>() - side[0];
    side.into_iter().map(|v| v / sum).collect()
}
