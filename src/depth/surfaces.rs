//! The surfaces of a photograph's real part, made once from its picture and the recorded depth.

use super::grid::DepthGrid;
use super::{behind, edges};
use crate::pixels::Rect;

/// The farthest that depth and light behind a surface are synthesised, pixels of the grid.
const MOST_BEHIND_PX: f64 = 96.0;

/// The nearest surfaces on a photograph's grid, and what stands behind them.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    pub nearest: DepthGrid,
    /// z of what is behind the nearest surface, as far as its blur may uncover it; otherwise the surface's own.
    pub behind_m: Vec<f32>,
    /// Linear light of the same.
    pub behind_light: Vec<[f32; 3]>,
}

impl Surfaces {
    /// For circles of up to `reach_px` of the photograph in radius.
    pub fn new(grid: &DepthGrid, reach_px: f64) -> Self {
        let (mut nearest, columns) = (grid.clone(), grid.width as usize);
        if !nearest.is_widened {
            nearest.depth_m = edges::widened(&nearest.depth_m, None, columns);
            nearest.is_widened = true;
        }
        let reach = (1.3 * reach_px / nearest.enlargement + 3.0).min(MOST_BEHIND_PX) as usize;
        let (behind_m, behind_light) = behind::made_up(&nearest.depth_m, &nearest.light, columns, reach);
        Self { nearest, behind_m, behind_light }
    }

    /// Nearest and farthest depth, metres.
    pub fn range_m(&self) -> [f64; 2] {
        let least = self.nearest.depth_m.iter().copied().fold(f32::INFINITY, f32::min);
        let most = self.nearest.depth_m.iter().chain(&self.behind_m).copied().fold(0.0, f32::max);
        [least.into(), most.into()]
    }

    /// Nearest and farthest depth in squares of `side_px` over a rectangle of the photograph, row by row.
    pub fn ranges_m(&self, rect: Rect, side_px: u32) -> Vec<[f32; 2]> {
        let side = side_px as i32;
        let tiles = |from: i32, to: i32| (from..to).step_by(side_px as usize);
        let step = (self.nearest.enlargement as usize).clamp(1, side_px as usize);
        // One more pixel of the grid: light is sampled between pixels.
        let more = self.nearest.enlargement.ceil() as i32;
        let range = |x0: i32, y0: i32| {
            let mut range = [f32::INFINITY, 0.0f32];
            let span = |from: i32| (from - more..from + side + more).step_by(step).chain([from + side + more]);
            for i in span(y0).flat_map(|y| span(x0).map(move |x| (x, y))).map(|(x, y)| self.nearest.index(x, y)) {
                range = [
                    range[0].min(self.nearest.depth_m[i]),
                    range[1].max(self.behind_m[i]).max(self.nearest.depth_m[i]),
                ];
            }
            range
        };
        tiles(rect.y0, rect.y1).flat_map(|y| tiles(rect.x0, rect.x1).map(move |x| range(x, y))).collect()
    }
}
