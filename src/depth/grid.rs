//! The recorded depth on a grid over a photograph, with its gaps filled and its edges moved to the picture's.

use super::proxies::known_m;
use glam::DVec2;

use super::{edges, inpaint, smooth};
use crate::camera::{Crop, Intrinsics, Response};
use crate::pixels::{Pixels, Rect};

/// The largest number of pixels in the grid.
const MOST_PIXELS: f64 = 2.0e6;

/// The light and depth of a photograph's real part: `width * height` values each, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthGrid {
    pub width: u32,
    pub height: u32,
    /// Pixels of the photograph per pixel of the grid, 1 or more.
    pub enlargement: f64,
    /// z, metres; known everywhere.
    pub depth_m: Vec<f32>,
    /// Linear light; empty if the depth alone is wanted.
    pub light: Vec<[f32; 3]>,
    /// Whether nearer surfaces have been widened by a pixel, for the picture's soft edges.
    pub is_widened: bool,
}

impl DepthGrid {
    /// From the recorded camera's depth (`depth_m`, of its picture's size, 0 where unknown). `is_measured`: by a sensor, else it is
    /// that of models alone, whose edges are where they are. `framed` is the photograph's place in the recorded picture. `None` if
    /// the depth has another size, or nothing was measured in the photograph's view.
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

    /// The depth alone, without light, by a frame as it was recorded. `size`: the photograph's.
    pub fn of_frame(
        pixels: &Pixels,
        recorded: &Intrinsics,
        depth_m: &[f32],
        framed: &Crop,
        size: (u32, u32),
        response: &Response,
    ) -> Option<Self> {
        let looked_at = |at| framed.source_px(at);
        let grid = Self::completed((pixels, looked_at), recorded, (depth_m, true), framed, size, response);
        grid.map(|grid| Self { light: Vec::new(), ..grid })
    }

    /// `place_of`: where in the picture a place in the photograph is.
    fn completed(
        (pixels, place_of): (&Pixels, impl Fn(DVec2) -> DVec2),
        recorded: &Intrinsics,
        (depth_m, is_measured): (&[f32], bool),
        framed: &Crop,
        size: (u32, u32),
        response: &Response,
    ) -> Option<Self> {
        let (whole_width, whole_height) = (recorded.width_px as usize, recorded.height_px as usize);
        if depth_m.len() != whole_width * whole_height {
            return None;
        }
        // One pixel of the grid per pixel of the recording, or of the photograph if those are larger.
        let area = f64::from(size.0) * f64::from(size.1);
        let enlargement = framed.step.recip().max((area / MOST_PIXELS).sqrt()).max(1.0);
        let side = |pixels: u32| (f64::from(pixels) / enlargement).ceil().max(1.0) as u32;
        let (width, height) = (side(size.0), side(size.1));
        let places =
            || (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)));
        let place = |at: f64, side: usize| at.clamp(0.0, side as f64 - 1.0) as usize;
        let measured = |at: DVec2| {
            let from = framed.source_px(enlargement * at);
            depth_m[place(from.y, whole_height) * whole_width + place(from.x, whole_width)]
        };
        let of_code = response.table(pixels.max_code());
        let seen = |at: DVec2| {
            let at = place_of(enlargement * at);
            let (x, y) = (place(at.x, pixels.width as usize), place(at.y, pixels.height as usize));
            pixels.at(x as u32, y as u32).map(|code| of_code[code as usize] as f32)
        };
        let mut depth_m: Vec<f32> = places().map(measured).collect();
        let light: Vec<[f32; 3]> = places().map(seen).collect();
        let sqrt_colors: Vec<[f32; 3]> = light.iter().map(|l| l.map(|c| c.max(0.0).sqrt())).collect();
        let columns = width as usize;
        // A map whose edges are on the picture's hides exactly to the pixel and needs no widening.
        let step = framed.step * enlargement;
        let is_widened = is_measured && inpaint::inpaint(&mut depth_m, &[], &sqrt_colors, columns, recorded, step)?;
        if is_widened {
            let everywhere = vec![f32::INFINITY; depth_m.len()];
            smooth::smooth(&mut depth_m, &sqrt_colors, columns, &everywhere);
            depth_m = edges::widened(&depth_m, Some(&sqrt_colors), columns);
        }
        Some(Self { width, height, enlargement, depth_m, light, is_widened })
    }

    /// The index in the grid of a pixel of the photograph, clamped to its rim.
    pub fn index(&self, x: i32, y: i32) -> usize {
        let place = |at: i32, side: u32| ((f64::from(at) + 0.5) / self.enlargement).clamp(0.0, f64::from(side - 1));
        place(y, self.height) as usize * self.width as usize + place(x, self.width) as usize
    }

    /// The pixels of the grid around a rectangle of the photograph, one more on each side, and their depths, metres, row by row. The
    /// grid's rim continues.
    pub fn around(&self, rect: Rect) -> (Rect, Vec<f32>) {
        let first = |at: i32| (f64::from(at) / self.enlargement).floor() as i32 - 1;
        let last = |at: i32| (f64::from(at) / self.enlargement).ceil() as i32 + 1;
        let around = Rect::new(first(rect.x0), first(rect.y0), last(rect.x1), last(rect.y1));
        let place = |at: i32, side: u32| at.clamp(0, side as i32 - 1) as usize;
        let row = |y: i32| &self.depth_m[place(y, self.height) * self.width as usize..];
        let of_row = |y: i32| (around.x0..around.x1).map(move |x| known_m(row(y)[place(x, self.width)]));
        (around, (around.y0..around.y1).flat_map(of_row).collect())
    }

    /// The depth at each pixel of a rectangle of the photograph, metres, row by row.
    pub fn over(&self, rect: Rect) -> Vec<f32> {
        let columns = rect.x0..rect.x1;
        let places = (rect.y0..rect.y1).flat_map(|y| columns.clone().map(move |x| (x, y)));
        places.map(|(x, y)| known_m(self.depth_m[self.index(x, y)])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_around_a_rectangle_by_hand() {
        let depth_m = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let grid = DepthGrid { width: 3, height: 2, enlargement: 2.0, depth_m, light: Vec::new(), is_widened: false };
        // Its upper left pixel: the first pixel of the grid, and one more all around, where the rim continues.
        let (around, texels) = grid.around(Rect::new(0, 0, 2, 2));
        assert_eq!(around, Rect::new(-1, -1, 2, 2));
        assert_eq!(texels, [1.0, 1.0, 2.0, 1.0, 1.0, 2.0, 4.0, 4.0, 5.0]);
        // Half of the grid's second pixel and of its third.
        let (around, texels) = grid.around(Rect::new(3, 1, 5, 2));
        assert_eq!(around, Rect::new(0, -1, 4, 2));
        assert_eq!(texels, [1.0, 2.0, 3.0, 3.0, 1.0, 2.0, 3.0, 3.0, 4.0, 5.0, 6.0, 6.0]);
    }
}
