//! Nearest surface and background of a photograph's real part, from its picture and recorded depth.

use super::grid::DepthGrid;
use super::{background, edges};
use crate::pixels::Rect;

/// Largest extrapolation of the background behind a surface, pixels of the grid.
const MAX_BACKGROUND_PX: f64 = 96.0;

/// The nearest surface on a photograph's grid, and the background behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    pub nearest: DepthGrid,
    /// z of the background as far as the surface's blur may uncover it; otherwise the surface's
    /// own.
    pub background_m: Vec<f32>,
    /// Linear light of the background, or the surface's own.
    pub background_light: Vec<[f32; 3]>,
}

impl Surfaces {
    /// Surfaces for circles of confusion with a radius of up to `reach_px` of the photograph.
    pub fn new(grid: &DepthGrid, reach_px: f64) -> Self {
        let mut nearest = grid.clone();
        let columns = grid.width as usize;
        if !nearest.is_dilated {
            nearest.depth_m = edges::dilate_foreground(&nearest.depth_m, None, columns);
            nearest.is_dilated = true;
        }
        let reach = (1.3 * reach_px / nearest.enlargement + 3.0).min(MAX_BACKGROUND_PX) as usize;
        let (background_m, background_light) =
            background::extrapolate_background(&nearest.depth_m, &nearest.light, columns, reach);
        Self { nearest, background_m, background_light }
    }

    /// Nearest and farthest depth, m.
    pub fn range_m(&self) -> [f64; 2] {
        let nearest_m = self.nearest.depth_m.iter().copied().fold(f32::INFINITY, f32::min);
        let farthest_m = self.nearest.depth_m.iter().chain(&self.background_m).copied().fold(0.0, f32::max);
        [nearest_m.into(), farthest_m.into()]
    }

    /// Nearest and farthest depth in squares of `side_px` over a rectangle of the photograph, row
    /// by row.
    pub fn ranges_m(&self, rect: Rect, side_px: u32) -> Vec<[f32; 2]> {
        let side = side_px as i32;
        let tiles = |from: i32, to: i32| (from..to).step_by(side_px as usize);
        let step = (self.nearest.enlargement as usize).clamp(1, side_px as usize);
        // A margin of a pixel of the grid, because light is interpolated.
        let margin = self.nearest.enlargement.ceil() as i32;
        let range = |x0: i32, y0: i32| {
            let mut range = [f32::INFINITY, 0.0f32];
            let span = |from: i32| (from - margin..from + side + margin).step_by(step).chain([from + side + margin]);
            for i in span(y0).flat_map(|y| span(x0).map(move |x| (x, y))).map(|(x, y)| self.nearest.index(x, y)) {
                range = [
                    range[0].min(self.nearest.depth_m[i]),
                    range[1].max(self.background_m[i]).max(self.nearest.depth_m[i]),
                ];
            }
            range
        };
        tiles(rect.y0, rect.y1).flat_map(|y| tiles(rect.x0, rect.x1).map(move |x| range(x, y))).collect()
    }
}
