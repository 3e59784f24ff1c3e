//! Image pyramid of a frame's brightness.

use crate::pixels::Pixels;

/// One brightness per pixel, 8-bit code values.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Plane {
    pub fn new(width: usize, height: usize, value: f32) -> Self {
        Self { width, height, values: vec![value; width * height] }
    }

    /// Luma of the codes (BT.601), scaled to 8 bits.
    pub fn of(pixels: &Pixels) -> Self {
        let scale = 255.0 / pixels.max_code() as f32;
        let values = pixels.each(|c| {
            let [r, g, b] = c.map(|code| code as f32);
            scale * (0.299 * r + 0.587 * g + 0.114 * b)
        });
        Self { width: pixels.width as usize, height: pixels.height as usize, values }
    }

    /// A channel's codes, scaled to 8 bits.
    pub fn of_channel(pixels: &Pixels, channel: usize) -> Self {
        let scale = 255.0 / pixels.max_code() as f32;
        let values = pixels.each(|c| scale * c[channel] as f32);
        Self { width: pixels.width as usize, height: pixels.height as usize, values }
    }

    /// Bilinear, at coordinates whose whole numbers are pixel centres; `None` beyond the outermost
    /// centres.
    #[inline]
    pub fn at(&self, x: f32, y: f32) -> Option<f32> {
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
        let a = upper[0] + fx * (upper[1] - upper[0]);
        let b = lower[0] + fx * (lower[1] - lower[0]);
        Some(a + fy * (b - a))
    }

    /// Convolved along rows and columns with a symmetric kernel: its middle, then one side. Edges
    /// repeat.
    pub fn filtered(&self, kernel: &[f32]) -> Self {
        let (w, h) = (self.width, self.height);
        let reach = kernel.len() - 1;
        let mut across = Self::new(w, h, 0.0);
        let mut padded = vec![0.0; w + 2 * reach];
        for (out, row) in across.values.chunks_mut(w.max(1)).zip(self.values.chunks(w.max(1))) {
            padded[..reach].fill(row[0]);
            padded[reach..reach + w].copy_from_slice(row);
            padded[reach + w..].fill(row[w - 1]);
            out.iter_mut().zip(&padded[reach..]).for_each(|(out, value)| *out = kernel[0] * value);
            for (k, weight) in kernel.iter().enumerate().skip(1) {
                let (left, right) = (&padded[reach - k..], &padded[reach + k..]);
                out.iter_mut().zip(left.iter().zip(right)).for_each(|(out, (a, b))| *out += weight * (a + b));
            }
        }
        let mut down = Self::new(w, h, 0.0);
        for (y, out) in down.values.chunks_mut(w.max(1)).enumerate() {
            let row = |y: usize| &across.values[y * w..(y + 1) * w];
            out.iter_mut().zip(row(y)).for_each(|(out, value)| *out = kernel[0] * value);
            for (k, weight) in kernel.iter().enumerate().skip(1) {
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

    /// The slopes along x and y, per pixel of this plane: Sobel's.
    pub fn slopes(&self) -> (Self, Self) {
        let (w, h) = (self.width, self.height);
        let (mut along, mut down) = (Self::new(w, h, 0.0), Self::new(w, h, 0.0));
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
}

/// A Gaussian's samples: the middle, then one side, summing to 1.
pub fn gaussian(sigma: f32) -> Vec<f32> {
    let side: Vec<f32> =
        (0..=(3.5 * sigma).ceil() as usize).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
    let sum = 2.0 * side.iter().sum::<f32>() - side[0];
    side.into_iter().map(|v| v / sum).collect()
}
