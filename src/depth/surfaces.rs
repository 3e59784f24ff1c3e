//! The surfaces of a photograph's real part, made once from its picture and the recorded depth.

use glam::DVec2;

use super::{behind, edges, holes};
use crate::camera::{Framed, Intrinsics, Response};
use crate::pixels::{Pixels, Rect};

/// What is made up behind a surface reaches at most so far, pixels of the grid.
const MOST_BEHIND_PX: f64 = 96.0;
/// The grid has no more pixels.
const MOST_PIXELS: f64 = 2.0e6;

/// What a photograph's real part shows, on a grid over it: `width * height` values each, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    pub width: u32,
    pub height: u32,
    /// Pixels of the photograph for one of the grid, 1 or more.
    pub enlargement: f64,
    /// z, metres; known everywhere.
    pub depth_m: Vec<f32>,
    /// Of what stands behind the nearest surface, as far as its blur may uncover it; else the surface's own.
    pub behind_m: Vec<f32>,
    /// Linear light of the two.
    pub light: Vec<[f32; 3]>,
    pub behind_light: Vec<[f32; 3]>,
}

impl Surfaces {
    /// By the recorded camera's depth (`depth_m`, its picture's size, 0 where nothing is known). `framed` says where in the
    /// recorded picture the photograph lies. Circles are at most `reach_px` of the photograph in radius. `None` where the
    /// depth is of another size, or nothing was measured in what the photograph shows.
    pub fn new(
        pixels: &Pixels,
        recorded: &Intrinsics,
        depth_m: &[f32],
        framed: &Framed,
        response: &Response,
        reach_px: f64,
    ) -> Option<Self> {
        let (whole_width, whole_height) = (recorded.width_px as usize, recorded.height_px as usize);
        if depth_m.len() != whole_width * whole_height {
            return None;
        }
        // A pixel of the grid for one of the recording, or of the photograph where that is coarser.
        let area = f64::from(pixels.width) * f64::from(pixels.height);
        let enlargement = framed.step.recip().max((area / MOST_PIXELS).sqrt()).max(1.0);
        let side = |pixels: u32| (f64::from(pixels) / enlargement).ceil().max(1.0) as u32;
        let (width, height) = (side(pixels.width), side(pixels.height));
        let places =
            || (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)));
        let place = |at: f64, side: usize| at.clamp(0.0, side as f64 - 1.0) as usize;
        let measured = |at: DVec2| {
            let from = framed.source_px(enlargement * at);
            depth_m[place(from.y, whole_height) * whole_width + place(from.x, whole_width)]
        };
        let most = f64::from(pixels.max_code());
        let seen = |at: DVec2| {
            let at = enlargement * at;
            let (x, y) = (place(at.x, pixels.width as usize), place(at.y, pixels.height as usize));
            pixels.at(x as u32, y as u32).map(|code| response.decode(f64::from(code) / most) as f32)
        };
        let mut depth_m: Vec<f32> = places().map(measured).collect();
        let light: Vec<[f32; 3]> = places().map(seen).collect();
        let looks: Vec<[f32; 3]> = light.iter().map(|l| l.map(|c| c.max(0.0).sqrt())).collect();
        let columns = width as usize;
        let of_recorded = framed.step * enlargement;
        let guessed = holes::fill(&mut depth_m, &looks, columns, (recorded.fx_px / of_recorded) as f32)?;
        let off_px = (f64::from(recorded.width_px) * edges::MOST_OFF / of_recorded).round() as usize;
        let depth_m = if edges::are_off(&depth_m, &looks, columns, off_px) {
            let on_colors = edges::on_colors(&depth_m, &guessed, &looks, columns, off_px);
            edges::widened(&on_colors, Some(&looks), columns)
        } else {
            edges::widened(&depth_m, None, columns)
        };
        let reach = (1.3 * reach_px / enlargement + 3.0).min(MOST_BEHIND_PX) as usize;
        let (behind_m, behind_light) = behind::made_up(&depth_m, &light, columns, reach);
        Some(Self { width, height, enlargement, depth_m, behind_m, light, behind_light })
    }

    /// Nearest and farthest depth, metres.
    pub fn range_m(&self) -> [f64; 2] {
        let least = self.depth_m.iter().copied().fold(f32::INFINITY, f32::min);
        let most = self.depth_m.iter().chain(&self.behind_m).copied().fold(0.0, f32::max);
        [least.into(), most.into()]
    }

    /// Column and row of the grid under a pixel of the photograph or beside it.
    fn index(&self, x: i32, y: i32) -> usize {
        let place = |at: i32, side: u32| ((f64::from(at) + 0.5) / self.enlargement).clamp(0.0, f64::from(side - 1));
        place(y, self.height) as usize * self.width as usize + place(x, self.width) as usize
    }

    /// Nearest and farthest depth in squares of `side_px` over a rectangle of the photograph, row by row.
    pub fn ranges_m(&self, rect: Rect, side_px: u32) -> Vec<[f32; 2]> {
        let side = side_px as i32;
        let tiles = |from: i32, to: i32| (from..to).step_by(side_px as usize);
        let step = (self.enlargement as usize).clamp(1, side_px as usize);
        // One pixel of the grid more: light between pixels is picked from its neighbours.
        let more = self.enlargement.ceil() as i32;
        let range = |x0: i32, y0: i32| {
            let mut range = [f32::INFINITY, 0.0f32];
            let span = |from: i32| (from - more..from + side + more).step_by(step).chain([from + side + more]);
            for i in span(y0).flat_map(|y| span(x0).map(move |x| (x, y))).map(|(x, y)| self.index(x, y)) {
                range = [range[0].min(self.depth_m[i]), range[1].max(self.behind_m[i]).max(self.depth_m[i])];
            }
            range
        };
        tiles(rect.y0, rect.y1).flat_map(|y| tiles(rect.x0, rect.x1).map(move |x| range(x, y))).collect()
    }
}
