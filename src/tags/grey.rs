//! A greyscale picture for the detection of tags.

use glam::DVec2;

use crate::camera::Response;
use crate::pixels::{Codes, Pixels};

/// 8-bit codes, and the linear light of each code.
#[derive(Clone, Debug)]
pub struct Grey {
    pub width: usize,
    pub height: usize,
    pub codes: Vec<u8>,
    light: Vec<f32>,
}

impl Grey {
    /// BT.709 luma; `light` is the response's table of 256 codes.
    pub fn of(pixels: &Pixels, light: Vec<f32>) -> Self {
        let (width, height) = (pixels.width as usize, pixels.height as usize);
        // Weights out of 256.
        let luma = |r: u32, g: u32, b: u32| ((54 * r + 183 * g + 19 * b + 128) >> 8) as u8;
        let codes = match &pixels.codes {
            Codes::U8(codes) => {
                codes.as_chunks::<3>().0.iter().map(|c| luma(c[0].into(), c[1].into(), c[2].into())).collect()
            }
            Codes::U16(codes) => {
                let eight = |code: u16| (u32::from(code) + 128) / 257;
                codes.as_chunks::<3>().0.iter().map(|c| luma(eight(c[0]), eight(c[1]), eight(c[2]))).collect()
            }
        };
        Self { width, height, codes, light }
    }

    /// Linear light of each 8-bit code.
    pub fn table(response: &Response) -> Vec<f32> {
        response.table(255).into_iter().map(|light| light as f32).collect()
    }

    /// True if a point is inside, at least `margin` px from the border.
    pub fn holds(&self, at: DVec2, margin: f64) -> bool {
        let inside = |v: f64, n: usize| v >= margin && v <= n as f64 - margin;
        inside(at.x, self.width) && inside(at.y, self.height)
    }

    /// Bilinear sample of linear light at a point inside, px with pixel centres at +0.5.
    pub fn light_at(&self, at: DVec2) -> f64 {
        let (x, y) = ((at.x - 0.5).max(0.0), (at.y - 0.5).max(0.0));
        let (column, row) =
            ((x as usize).min(self.width.saturating_sub(2)), (y as usize).min(self.height.saturating_sub(2)));
        let (u, v) = (x - column as f64, y - row as f64);
        let value = |dx: usize, dy: usize| {
            let code = self.codes.get((row + dy) * self.width + column + dx).copied().unwrap_or(0);
            f64::from(self.light[usize::from(code)])
        };
        (1.0 - v) * ((1.0 - u) * value(0, 0) + u * value(1, 0)) + v * ((1.0 - u) * value(0, 1) + u * value(1, 1))
    }
}
