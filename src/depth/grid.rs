//! Recorded depth on a grid over a photograph, with holes filled and edges aligned with the
//! picture's.

use glam::DVec2;

use super::proxies::unknown_if_far_m;
use super::{edges, inpaint, smooth};
use crate::camera::{Crop, Intrinsics, Response};
use crate::pixels::{Pixels, Rect};

/// Largest number of pixels in the grid.
const MAX_PIXELS: f64 = 2.0e6;

/// The light and depth of a photograph's real part: `width * height` values each, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthGrid {
    pub width: u32,
    pub height: u32,
    /// Pixels of the photograph per pixel of the grid, 1 or more.
    pub enlargement: f64,
    /// z, metres; known everywhere.
    pub depth_m: Vec<f32>,
    /// Linear light; empty if only depth was requested.
    pub light: Vec<[f32; 3]>,
    /// True if nearer surfaces were dilated by a pixel, for the picture's soft edges.
    pub is_dilated: bool,
}

impl DepthGrid {
    /// A grid of the recorded camera's depth (`depth_m`, of its picture's size, 0 where unknown).
    /// `is_measured`: by a sensor; otherwise the depth is that of models, whose edges are exact.
    /// `framed` is the photograph's place in the recorded picture. `None` if the depth has another
    /// size, or nothing was measured in the photograph's view.
    pub fn new(
        pixels: &Pixels,
        recorded: &Intrinsics,
        (depth_m, is_measured): (&[f32], bool),
        framed: &Crop,
        response: &Response,
    ) -> Option<Self> {
        let size = (pixels.width, pixels.height);
        Self::completed((pixels, |at| at), recorded, (depth_m, is_measured), framed, size, response)
    }

    /// The depth without light, from a recorded frame. `size`: the photograph's, px.
    pub fn of_frame(
        pixels: &Pixels,
        recorded: &Intrinsics,
        depth_m: &[f32],
        framed: &Crop,
        size: (u32, u32),
        response: &Response,
    ) -> Option<Self> {
        let source_px = |at| framed.source_px(at);
        let grid = Self::completed((pixels, source_px), recorded, (depth_m, true), framed, size, response);
        grid.map(|grid| Self { light: Vec::new(), ..grid })
    }

    /// `place_of` maps a position in the photograph to one in `pixels`, px.
    fn completed(
        (pixels, place_of): (&Pixels, impl Fn(DVec2) -> DVec2),
        recorded: &Intrinsics,
        (depth_m, is_measured): (&[f32], bool),
        framed: &Crop,
        size: (u32, u32),
        response: &Response,
    ) -> Option<Self> {
        let (recorded_width, recorded_height) = (recorded.width_px as usize, recorded.height_px as usize);
        if depth_m.len() != recorded_width * recorded_height {
            return None;
        }
        // One pixel of the grid per pixel of the recording, or of the photograph if those are
        // larger.
        let area = f64::from(size.0) * f64::from(size.1);
        let enlargement = framed.step.recip().max((area / MAX_PIXELS).sqrt()).max(1.0);
        let side = |pixels: u32| (f64::from(pixels) / enlargement).ceil().max(1.0) as u32;
        let (width, height) = (side(size.0), side(size.1));
        let places =
            || (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)));
        let place = |at: f64, side: usize| at.clamp(0.0, side as f64 - 1.0) as usize;
        let measured = |at: DVec2| {
            let from = framed.source_px(enlargement * at);
            depth_m[place(from.y, recorded_height) * recorded_width + place(from.x, recorded_width)]
        };
        let of_code = response.table(pixels.max_code());
        let light_at = |at: DVec2| {
            let at = place_of(enlargement * at);
            let (x, y) = (place(at.x, pixels.width as usize), place(at.y, pixels.height as usize));
            pixels.at(x as u32, y as u32).map(|code| of_code[code as usize] as f32)
        };
        let mut depth_m: Vec<f32> = places().map(measured).collect();
        let light: Vec<[f32; 3]> = places().map(light_at).collect();
        let sqrt_colors: Vec<[f32; 3]> = light.iter().map(|l| l.map(|c| c.max(0.0).sqrt())).collect();
        let columns = width as usize;
        // A map with aligned edges occludes exactly to the pixel and is not dilated.
        let step = framed.step * enlargement;
        let is_dilated = is_measured && inpaint::inpaint(&mut depth_m, &[], &sqrt_colors, columns, recorded, step)?;
        if is_dilated {
            let everywhere = vec![f32::INFINITY; depth_m.len()];
            smooth::smooth(&mut depth_m, &sqrt_colors, columns, &everywhere);
            depth_m = edges::dilate_foreground(&depth_m, Some(&sqrt_colors), columns);
        }
        Some(Self { width, height, enlargement, depth_m, light, is_dilated })
    }

    /// The index in the grid of a pixel of the photograph, clamped to its rim.
    pub fn index(&self, x: i32, y: i32) -> usize {
        let place = |at: i32, side: u32| ((f64::from(at) + 0.5) / self.enlargement).clamp(0.0, f64::from(side - 1));
        place(y, self.height) as usize * self.width as usize + place(x, self.width) as usize
    }

    /// The pixels of the grid around a rectangle of the photograph, with a border of one pixel, and
    /// their depths, m, row by row. Coordinates outside the grid are clamped.
    pub fn covering(&self, rect: Rect) -> (Rect, Vec<f32>) {
        let first = |at: i32| (f64::from(at) / self.enlargement).floor() as i32 - 1;
        let last = |at: i32| (f64::from(at) / self.enlargement).ceil() as i32 + 1;
        let covered = Rect::new(first(rect.x0), first(rect.y0), last(rect.x1), last(rect.y1));
        let place = |at: i32, side: u32| at.clamp(0, side as i32 - 1) as usize;
        let row = |y: i32| &self.depth_m[place(y, self.height) * self.width as usize..];
        let of_row = |y: i32| (covered.x0..covered.x1).map(move |x| unknown_if_far_m(row(y)[place(x, self.width)]));
        (covered, (covered.y0..covered.y1).flat_map(of_row).collect())
    }

    /// The depth at each pixel of a rectangle of the photograph, metres, row by row.
    pub fn depth_m_in(&self, rect: Rect) -> Vec<f32> {
        let columns = rect.x0..rect.x1;
        let places = (rect.y0..rect.y1).flat_map(|y| columns.clone().map(move |x| (x, y)));
        places.map(|(x, y)| unknown_if_far_m(self.depth_m[self.index(x, y)])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grid_around_a_rectangle_has_a_clamped_border() {
        let depth_m = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let grid = DepthGrid { width: 3, height: 2, enlargement: 2.0, depth_m, light: Vec::new(), is_dilated: false };
        // The first pixel of the grid with a border of one pixel, clamped at the rim.
        let (covered, texels) = grid.covering(Rect::new(0, 0, 2, 2));
        assert_eq!(covered, Rect::new(-1, -1, 2, 2));
        assert_eq!(texels, [1.0, 1.0, 2.0, 1.0, 1.0, 2.0, 4.0, 4.0, 5.0]);
        // Half of the grid's second pixel and of its third.
        let (covered, texels) = grid.covering(Rect::new(3, 1, 5, 2));
        assert_eq!(covered, Rect::new(0, -1, 4, 2));
        assert_eq!(texels, [1.0, 2.0, 3.0, 3.0, 1.0, 2.0, 3.0, 3.0, 4.0, 5.0, 6.0, 6.0]);
    }
}
