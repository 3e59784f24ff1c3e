//! Textures over the UV charts of surfaces.

use glam::DVec2;

use crate::parallel::over_rows;

/// A grid over a face's UV chart, interpolated bilinearly between cell centres.
#[derive(Clone, Debug)]
pub struct SiteChart {
    width: usize,
    height: usize,
    /// Linear R, G, B and gloss.
    cells: Vec<[f32; 4]>,
}

impl SiteChart {
    pub fn new(width: usize, height: usize, cells: Vec<[f32; 4]>) -> Option<Self> {
        (width > 0 && cells.len() == width * height).then_some(Self { width, height, cells })
    }

    pub fn from_fn(width: usize, height: usize, threads: usize, value: impl Fn(DVec2) -> [f32; 4] + Sync) -> Self {
        let mut cells = vec![[0.0; 4]; width * height];
        over_rows(&mut cells, width, threads, |y, row| {
            for (x, cell) in row.iter_mut().enumerate() {
                *cell = value(DVec2::new((x as f64 + 0.5) / width as f64, (y as f64 + 0.5) / height as f64));
            }
        });
        Self { width, height, cells }
    }

    /// Colour at `uv` in [0, 1]²; constant outside the outermost cells' centres.
    pub fn at(&self, uv: DVec2) -> [f32; 4] {
        let x = (uv.x * self.width as f64 - 0.5).clamp(0.0, (self.width - 1) as f64);
        let y = (uv.y * self.height as f64 - 0.5).clamp(0.0, (self.height - 1) as f64);
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let cell = |x: usize, y: usize| self.cells[y * self.width + x];
        let (a, b, c, d) = (cell(x0, y0), cell(x1, y0), cell(x0, y1), cell(x1, y1));
        std::array::from_fn(|i| (a[i] * (1.0 - fx) + b[i] * fx) * (1.0 - fy) + (c[i] * (1.0 - fx) + d[i] * fx) * fy)
    }
}
