//! A greyscale picture for the detection of boards.

use glam::DVec2;

/// Grey values of any unit, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct GreyImage {
    pub width: usize,
    pub height: usize,
    /// `width * height` values.
    pub values: Vec<f32>,
}

impl GreyImage {
    /// Evaluates a function of column and row.
    pub fn new(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Self {
        let value = &value;
        let values = (0..height).flat_map(|y| (0..width).map(move |x| value(x, y))).collect();
        Self { width, height, values }
    }

    /// The value of a pixel, with the border repeated beyond it. 0 for an empty picture.
    pub fn at(&self, x: i64, y: i64) -> f32 {
        let inside = |v: i64, n: usize| v.clamp(0, n as i64 - 1).max(0) as usize;
        self.values.get(inside(y, self.height) * self.width + inside(x, self.width)).copied().unwrap_or(0.0)
    }

    /// True if a point is inside, at least `margin` px from the border.
    pub fn holds(&self, at: DVec2, margin: f64) -> bool {
        let inside = |v: f64, n: usize| v >= margin && v <= n as f64 - margin;
        inside(at.x, self.width) && inside(at.y, self.height)
    }

    /// Bilinear sample at a point, px with pixel centres at +0.5.
    pub fn sample(&self, at: DVec2) -> f64 {
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (u, v) = (x - x0, y - y0);
        let value = |dx, dy| f64::from(self.at(x0 as i64 + dx, y0 as i64 + dy));
        (1.0 - v) * ((1.0 - u) * value(0, 0) + u * value(1, 0)) + v * ((1.0 - u) * value(0, 1) + u * value(1, 1))
    }

    /// Reduced by the mean of `by * by` pixels. Coordinates are divided by `by`; incomplete blocks
    /// are dropped.
    pub fn reduced(&self, by: usize) -> Self {
        let by = by.max(1);
        if by == 1 {
            return self.clone();
        }
        let share = 1.0 / (by * by) as f32;
        Self::new(self.width / by, self.height / by, |x, y| {
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
                *value = self.at(i as i64 - reach, y as i64);
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

    /// Gradient at a pixel, per px: central differences.
    pub fn slope(&self, x: i64, y: i64) -> DVec2 {
        let half = |a: f32, b: f32| 0.5 * f64::from(b - a);
        DVec2::new(half(self.at(x - 1, y), self.at(x + 1, y)), half(self.at(x, y - 1), self.at(x, y + 1)))
    }
}
