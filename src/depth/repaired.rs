//! A sensor's map at a frame's moment, completed with the help of the frame's own picture.
//!
//! Depth that hides an object must have no gaps. A sensor sees only a few places of a black screen, different ones in
//! each frame, and between them the object behind it would show. So gaps are filled and edges moved to the picture's
//! (`mended`), as for a photograph, but only around the objects.
//!
//! Not modelled: gaps depend only on what was measured within a twentieth of the picture's width around the objects.

use super::looks::Looks;
use super::matte::{self, Shared};
use super::smear::Smear;
use super::{Rays, mended, smooth, vote};
use crate::camera::Response;
use crate::frame::Beside;
use crate::pixels::{DepthMap, Pixels, Rect};
use crate::pose::Pose;

/// How far around the objects the map is read, as a share of the picture's width. Also the step by which that region
/// grows, so that an object that moves from frame to frame reads the same region.
const AROUND: f64 = 1.0 / 20.0;

/// The inputs for repairing a frame's depth.
#[derive(Clone, Copy, Debug)]
pub struct Repair<'a> {
    pub rays: &'a Rays,
    pub depth: &'a DepthMap,
    /// The poses at which the map was measured and the frame was taken.
    pub measured: &'a Pose,
    pub frame: &'a Pose,
    /// The poses when the shutter opened and when it closed.
    pub shutter: [&'a Pose; 2],
    pub pixels: &'a Pixels,
    pub response: &'a Response,
    /// Frames that help where the map is doubtful.
    pub neighbours: &'a [Neighbour<'a>],
}

/// Another frame, and the poses at which its map was measured and its picture was taken.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    pub frame: &'a Beside,
    pub measured: Pose,
    pub taken: Pose,
}

/// A part of a frame's map, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Repaired {
    /// Of what most of a pixel shows, m; 0 if nothing was measured around it at all.
    pub depth_m: Vec<f32>,
    /// Over the part of it where things are drawn.
    pub shared: Vec<Shared>,
}

impl<'a> Repair<'a> {
    /// What `rect` shows at the frame's moment, and how its pixels are shared in `drawn`, a part of it. It depends on `rect`
    /// too, through what was measured near it.
    pub fn over(&self, rect: Rect, drawn: Rect) -> Repaired {
        let region = self.region(rect);
        let width = region.width() as usize;
        let mut depth_m = self.rays.reproject(self.depth, self.measured, self.frame, region);
        let looks = self.looks(region);
        self.agree(&mut depth_m, &looks, region);
        // Where nothing was measured, nothing hides.
        let recorded = &self.rays.geometry().intrinsics;
        if mended::complete(&mut depth_m, &looks, width, recorded, 1.0) == Some(true) {
            smooth::smooth(&mut depth_m, &looks, width);
        }
        let smear = Smear::new(self.rays.geometry(), self.frame, self.shutter, region);
        let shared = matte::shares(&depth_m, &looks, width, &smear, drawn.moved(-region.x0, -region.y0));
        Repaired { depth_m: region.part(&depth_m, rect), shared }
    }

    /// The rectangle and its surroundings, as far as the picture goes.
    fn region(&self, rect: Rect) -> Rect {
        let (width, height) = (self.pixels.width as i32, self.pixels.height as i32);
        let step = ((f64::from(width) * AROUND) as i32).max(1);
        let [x0, y0] = [rect.x0, rect.y0].map(|at| (at - step).div_euclid(step) * step);
        let [x1, y1] = [rect.x1, rect.y1].map(|at| (at + 2 * step - 1).div_euclid(step) * step);
        // A 360° picture continues at either rim.
        let beyond = if self.rays.geometry().is_round() { width } else { 0 };
        Rect::new(x0, y0, x1, y1).intersection(&Rect::new(-beyond, 0, width + beyond, height)).union(&rect)
    }

    /// Square roots of light, row by row. Beyond the picture the rim continues.
    fn looks(&self, region: Rect) -> Vec<[f32; 3]> {
        let (width, height) = (self.pixels.width as i32, self.pixels.height as i32);
        let looks = Looks::new(self.pixels, self.response);
        let round = self.rays.geometry().is_round();
        let column = |x: i32| if round { x.rem_euclid(width) } else { x.clamp(0, width - 1) };
        let places = (region.y0..region.y1)
            .map(|y| y.clamp(0, height - 1))
            .flat_map(|y| (region.x0..region.x1).map(move |x| (column(x), y)));
        places.map(|(x, y)| looks.at(x as u32, y as u32)).collect()
    }

    /// Replaces what is doubtful in a part of the map by what the neighbours say.
    fn agree(&self, depth_m: &mut [f32], looks: &[[f32; 3]], part: Rect) {
        let voter = |neighbour: &Neighbour<'a>| vote::Voter {
            depth: &neighbour.frame.depth,
            measured: neighbour.measured,
            taken: neighbour.taken,
            looks: Looks::new(&neighbour.frame.pixels, self.response),
        };
        let voters: Vec<_> = self.neighbours.iter().map(voter).collect();
        vote::Own { rays: self.rays, pose: *self.frame, part, looks }.agreed(depth_m, &voters);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, Distortion, Geometry, Intrinsics};

    const WIDTH: usize = 160;
    const HEIGHT: usize = 120;

    /// A black screen at 1 m, columns 40 to 119 and rows 30 to 89, in front of a bright wall at 2 m. The sensor sees
    /// the screen's rim, and one in fifty of its pixels.
    fn screen() -> (Pixels, DepthMap, impl Fn(usize) -> bool) {
        let inside = |i: usize| (40..120).contains(&(i % WIDTH)) && (30..90).contains(&(i / WIDTH));
        let codes = (0..WIDTH * HEIGHT).flat_map(|i| [if inside(i) { 10 } else { 200 }; 3]).collect();
        let depth_m = (0..WIDTH * HEIGHT)
            .map(|i| match inside(i) {
                false => 2.0,
                true if i % 10 == 0 && (i / WIDTH).is_multiple_of(5) => 1.0,
                true if [i - 1, i + 1, i - WIDTH, i + WIDTH].iter().any(|&n| !inside(n)) => 1.0,
                true => 0.0,
            })
            .collect();
        let depth = DepthMap { width: WIDTH as u32, height: HEIGHT as u32, depth_m, timestamp_s: 0.0 };
        (Pixels::from_u8(WIDTH as u32, HEIGHT as u32, codes).unwrap(), depth, inside)
    }

    fn camera() -> Rays {
        let intrinsics = Intrinsics {
            width_px: WIDTH as u32,
            height_px: HEIGHT as u32,
            fx_px: 130.0,
            fy_px: 130.0,
            cx_px: 80.0,
            cy_px: 60.0,
            ..Default::default()
        };
        Rays::new(&Geometry::new(intrinsics, Distortion::default()))
    }

    fn repaired(pixels: &Pixels, depth: &DepthMap, rect: Rect) -> Repaired {
        let (rays, pose) = (camera(), Pose::IDENTITY);
        let response = Response { curve: Curve::Srgb, ..Default::default() };
        let shutter = [&pose; 2];
        let (measured, frame, response) = (&pose, &pose, &response);
        Repair { rays: &rays, depth, measured, frame, shutter, pixels, response, neighbours: &[] }.over(rect, rect)
    }

    #[test]
    fn a_screen_of_which_little_was_seen_is_whole() {
        let (pixels, depth, inside) = screen();
        for rect in [Rect::full(160, 120), Rect::new(60, 20, 140, 100), Rect::new(20, 50, 50, 60)] {
            let found = repaired(&pixels, &depth, rect).depth_m;
            assert_eq!(found.len(), (rect.width() * rect.height()) as usize);
            for (n, z) in found.iter().enumerate() {
                let (x, y) =
                    (rect.x0 as usize + n % rect.width() as usize, rect.y0 as usize + n / rect.width() as usize);
                let wanted = if inside(y * WIDTH + x) { 1.0 } else { 2.0 };
                assert!((z / wanted - 1.0).abs() < 0.1, "{x} {y} of {rect:?}: {z}");
            }
        }
    }

    #[test]
    fn a_whole_map_stays_as_it_was_measured() {
        let (pixels, mut depth, inside) = screen();
        depth.depth_m = (0..WIDTH * HEIGHT).map(|i| if inside(i) { 1.0 } else { 2.0 }).collect();
        assert_eq!(repaired(&pixels, &depth, Rect::full(160, 120)).depth_m, depth.depth_m);
        // Nothing is made from nothing.
        depth.depth_m.fill(0.0);
        assert!(repaired(&pixels, &depth, Rect::new(-3, 5, 30, 50)).depth_m.iter().all(|z| *z == 0.0));
    }
}
