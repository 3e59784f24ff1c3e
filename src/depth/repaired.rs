//! A sensor's map at a frame's moment, completed with the help of the frame's own picture.
//!
//! Depth that hides an object must have no gaps. A sensor sees only a few places of a black screen, different ones in
//! each frame, and between them the object behind it would show. So gaps are filled and edges moved to the picture's
//! (`inpaint`), as for a photograph, but only around the objects.
//!
//! Not modelled: gaps depend only on what was measured within a twentieth of the picture's width around the objects.

use glam::DVec3;

use super::contact::{self, Plane};
use super::matte::{self, MattePixel};
use super::proxies::{FAR_M, Proxies, Seen, known_m};
use super::smear::Smear;
use super::sqrt_colors::SqrtColors;
use super::{Rays, inpaint, smooth, vote};
use crate::camera::Response;
use crate::frame::{Beside, Surfel};
use crate::parallel::{over_rows, processors};
use crate::pixels::{DepthMap, Pixels, Rect};
use crate::pose::Pose;

/// How far around the objects the map is read, as a share of the picture's width. Also the step by which that region
/// grows, so that an object that moves from frame to frame reads the same region.
const AROUND: f64 = 1.0 / 20.0;
/// How far around them edges are smoothed: as far as `matte` looks.
const SEEN_PX: i32 = matte::FARTHEST_PX;

/// In darker light the shares of two surfaces are those of the pixel's area.
const DARKEST: f32 = 1e-4;

/// The inputs for repairing a frame's depth.
#[derive(Clone, Copy)]
pub struct Repair<'a> {
    pub rays: &'a Rays,
    /// The map, and the pose at which it was measured; `None` without a sensor.
    pub measured: Option<(&'a DepthMap, &'a Pose)>,
    /// At which the frame was taken.
    pub frame: &'a Pose,
    /// The poses when the shutter opened and when it closed.
    pub shutter: [&'a Pose; 2],
    pub pixels: &'a Pixels,
    pub response: &'a Response,
    /// What objects stand on.
    pub planes: &'a [Plane],
    /// Models that stand in for real things, and where the camera sees a point.
    pub proxies: Option<(&'a Proxies, &'a dyn Fn(DVec3) -> Seen)>,
    /// Frames that help where the map is doubtful.
    pub neighbours: &'a [Neighbour<'a>],
    /// Surfaces that the whole recording measured.
    pub surfels: &'a [Surfel],
}

/// Another frame, and the poses at which its map was measured and its picture was taken.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    pub frame: &'a Beside,
    pub measured: Pose,
    pub taken: Pose,
}

impl<'a> Neighbour<'a> {
    /// With what its colours are by the camera's response.
    pub fn voter(&self, response: &Response) -> vote::Voter<'a> {
        let Self { frame, measured, taken } = *self;
        vote::Voter { depth: &frame.depth, measured, taken, sqrt_colors: SqrtColors::new(&frame.pixels, response) }
    }
}

/// Where real depth is asked for, and up to where.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Rectangles, and the depth beyond which real things hide nothing in them, metres.
    pub objects: Vec<(Rect, f32)>,
    /// Here all depths are asked for.
    pub all_of: Rect,
    /// The part of it in which shadows fall on real surfaces: the mattes of all edges are asked for.
    pub receiver: Rect,
}

impl Wanted {
    /// All of a rectangle.
    pub fn all(rect: Rect) -> Self {
        Self { objects: vec![(rect, f32::INFINITY)], all_of: rect, receiver: Rect::new(0, 0, 0, 0) }
    }

    fn objects_only(&self) -> Self {
        Self { all_of: Rect::new(0, 0, 0, 0), ..self.clone() }
    }

    /// The depth up to which each pixel of a rectangle, or what is within `reach_px` of it, is asked for, row by row; 0 where
    /// it is not.
    fn max_depth_m(&self, rect: Rect, reach_px: i32) -> Vec<f32> {
        let mut max_depth_m = vec![0.0f32; rect.width() as usize * rect.height() as usize];
        let all_of = [(self.all_of, f32::INFINITY)];
        for (wanted, farthest_m) in self.objects.iter().chain(&all_of).filter(|(wanted, _)| !wanted.is_empty()) {
            let part = wanted.grown(reach_px).intersection(&rect);
            if part.is_empty() {
                continue;
            }
            let part = part.moved(-rect.x0, -rect.y0);
            for y in part.y0..part.y1 {
                let start = y as usize * rect.width() as usize;
                let row = &mut max_depth_m[start..][part.x0 as usize..part.x1 as usize];
                row.iter_mut().for_each(|max_depth_m| *max_depth_m = max_depth_m.max(*farthest_m));
            }
        }
        max_depth_m
    }
}

/// A part of a frame's map, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Repaired {
    /// Of what most of a pixel shows, m; 0 where nothing was measured and nothing repaired.
    pub depth_m: Vec<f32>,
    /// Over the part of it where things are drawn.
    pub shared: Vec<MattePixel>,
    /// Over [`Wanted::receiver`].
    pub receiver: Vec<SecondSurface>,
}

/// The surface of a pixel at an edge that the map does not have there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SecondSurface {
    /// Its share of the pixel's light, for each colour.
    pub light_share: [f32; 3],
    /// m; 0 where the pixel shows one surface alone.
    pub depth_m: f32,
}

impl SecondSurface {
    /// Of a pixel that shows I = α·F + (1 − α)·B: the farther surface's share of the light is (1 − α)·B/I, with B = I − α·(F − B).
    fn of(shared: &MattePixel, depth_m: f32, look: [f32; 3]) -> Self {
        if shared.near_m >= shared.far_m {
            return Self::default();
        }
        let far = |c: usize| {
            let (light, rest) = (look[c] * look[c], 1.0 - shared.share);
            if light < DARKEST { rest } else { (rest * (1.0 - shared.fringe[c] / light)).clamp(0.0, 1.0) }
        };
        let far = [far(0), far(1), far(2)];
        if depth_m == shared.near_m {
            return Self { light_share: far, depth_m: shared.far_m };
        }
        Self { light_share: far.map(|share| 1.0 - share), depth_m: shared.near_m }
    }
}

impl<'a> Repair<'a> {
    /// What `around` shows at the frame's moment: in and around `near`, a part of it, with its gaps filled and its edges on the
    /// picture's, better where that is wanted; elsewhere as it was measured. And how pixels are shared in `drawn`, a part of `near`.
    /// It depends on `near` too, through what was measured near it.
    pub fn over(&self, around: Rect, near: Rect, drawn: Rect, wanted: &Wanted) -> Repaired {
        let region = self.region(near);
        let all = region.union(&around);
        let measured_m = match self.measured {
            Some((depth, measured)) => self.rays.reproject(depth, measured, self.frame, all),
            None => vec![0.0; all.width() as usize * all.height() as usize],
        };
        let sqrt_colors = self.sqrt_colors(region);
        let (mut depth_m, width) = (all.part(&measured_m, region), region.width() as usize);
        let max_depth_m = wanted.max_depth_m(region, SEEN_PX);
        let is_sure = self.agree(&mut depth_m, &sqrt_colors, region, &max_depth_m);
        if let Some((proxies, seen)) = self.proxies {
            proxies.put(&mut depth_m, region, seen);
        }
        if self.measured.is_none() {
            depth_m.iter_mut().filter(|z| **z == 0.0).for_each(|z| *z = FAR_M);
        }
        // Where nothing was measured, nothing hides. Without a sensor, models' edges are where they are.
        let recorded = &self.rays.geometry().intrinsics;
        if self.measured.is_some()
            && inpaint::inpaint(&mut depth_m, &is_sure, &sqrt_colors, width, recorded, 1.0) == Some(true)
        {
            smooth::smooth(&mut depth_m, &sqrt_colors, width, &max_depth_m);
        }
        contact::flatten(&mut depth_m, self.rays, self.frame, region, self.planes);
        let smear = Smear::new(self.rays.geometry(), self.frame, self.shutter, region);
        let within = drawn.moved(-region.x0, -region.y0);
        let shared =
            matte::shares(&depth_m, &sqrt_colors, width, &smear, within, &wanted.objects_only().max_depth_m(drawn, 0));
        let receiver =
            self.second_surfaces((&depth_m, &sqrt_colors, region), &smear, (&shared, drawn), wanted.receiver);
        let mut out = all.part(&measured_m, around);
        depth_m.iter_mut().for_each(|z| *z = known_m(*z));
        put(&mut out, around, &depth_m, region);
        Repaired { depth_m: out, shared, receiver }
    }

    /// The second surfaces of pixels in `part`. `shared` has the mattes that are known already, over `drawn`.
    fn second_surfaces(
        &self,
        (depth_m, sqrt_colors, region): (&[f32], &[[f32; 3]], Rect),
        smear: &Smear,
        (shared, drawn): (&[MattePixel], Rect),
        part: Rect,
    ) -> Vec<SecondSurface> {
        if part.is_empty() {
            return Vec::new();
        }
        let (columns, width) = (part.width() as usize, region.width() as usize);
        let at = |rect: &Rect, x: i32, y: i32| (y - rect.y0) as usize * rect.width() as usize + (x - rect.x0) as usize;
        // What is known needs no second matte.
        let both = part.intersection(&drawn);
        let places = (both.y0..both.y1.max(both.y0)).flat_map(|y| (both.x0..both.x1).map(move |x| (x, y)));
        let known = places.filter_map(|(x, y)| {
            let shared = &shared[at(&drawn, x, y)];
            (shared.near_m < shared.far_m).then_some((at(&part, x, y), shared))
        });
        let known: Vec<_> = known.collect();
        let mut max_depth_m = vec![f32::INFINITY; columns * part.height() as usize];
        known.iter().for_each(|(at, _)| max_depth_m[*at] = 0.0);
        let within = part.moved(-region.x0, -region.y0);
        let mut mattes = matte::shares(depth_m, sqrt_colors, width, smear, within, &max_depth_m);
        known.iter().for_each(|(at, shared)| mattes[*at] = **shared);
        let mut out = Vec::with_capacity(mattes.len());
        for (y, mattes) in (part.y0..).zip(mattes.chunks_exact(columns)) {
            let first = at(&region, part.x0, y);
            let there = depth_m[first..].iter().zip(&sqrt_colors[first..]);
            out.extend(mattes.iter().zip(there).map(|(matte, (z, look))| SecondSurface::of(matte, *z, *look)));
        }
        out
    }

    /// The rectangle and its surroundings, as far as the picture goes.
    fn region(&self, rect: Rect) -> Rect {
        let (width, height) = (self.pixels.width as i32, self.pixels.height as i32);
        let step = ((f64::from(width) * AROUND) as i32).max(1);
        let [x0, y0] = [rect.x0, rect.y0].map(|at| (at - step).div_euclid(step) * step);
        let [x1, y1] = [rect.x1, rect.y1].map(|at| (at + 2 * step - 1).div_euclid(step) * step);
        // A 360° picture continues at either rim.
        let beyond = if self.rays.geometry().is_equirectangular() { width } else { 0 };
        Rect::new(x0, y0, x1, y1).intersection(&Rect::new(-beyond, 0, width + beyond, height)).union(&rect)
    }

    /// Square roots of light, row by row. Beyond the picture the rim continues.
    fn sqrt_colors(&self, region: Rect) -> Vec<[f32; 3]> {
        let (width, height) = (self.pixels.width as i32, self.pixels.height as i32);
        let sqrt_colors = SqrtColors::new(self.pixels, self.response);
        let round = self.rays.geometry().is_equirectangular();
        let column = |x: i32| if round { x.rem_euclid(width) } else { x.clamp(0, width - 1) };
        let mut out = vec![[0.0; 3]; region.width() as usize * region.height() as usize];
        over_rows(&mut out, region.width() as usize, processors(), |row, out| {
            let y = (region.y0 + row as i32).clamp(0, height - 1);
            if region.x0 >= 0 && region.x1 <= width {
                return sqrt_colors.along(region.x0 as u32, y as u32, out);
            }
            (region.x0..).zip(out).for_each(|(x, there)| *there = sqrt_colors.at(column(x) as u32, y as u32));
        });
        out
    }

    /// Replaces unreliable depth of a part by the consensus of the neighbours, and depth that is still unknown by surfels. Returns
    /// which pixels are reliable.
    fn agree(&self, depth_m: &mut [f32], sqrt_colors: &[[f32; 3]], part: Rect, max_depth_m: &[f32]) -> Vec<bool> {
        let voters: Vec<_> = self.neighbours.iter().map(|neighbour| neighbour.voter(self.response)).collect();
        let own = vote::TargetView { rays: self.rays, pose: *self.frame, part, sqrt_colors, max_depth_m };
        let is_sure = own.agreed(depth_m, &voters);
        own.fill_unknown(depth_m, self.surfels);
        is_sure
    }
}

/// Replaces a rectangle's values by another's where the two overlap.
fn put(values: &mut [f32], rect: Rect, others: &[f32], other: Rect) {
    let both = rect.intersection(&other);
    for y in both.y0..both.y1.max(both.y0) {
        let start = |of: &Rect| (y - of.y0) as usize * of.width() as usize + (both.x0 - of.x0) as usize;
        let width = both.width() as usize;
        values[start(&rect)..][..width].copy_from_slice(&others[start(&other)..][..width]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Curve, Distortion, Geometry, Intrinsics};
    use crate::frame::SURFEL_SPACING_M;
    use glam::Vec3;

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

    fn repaired(pixels: &Pixels, depth: &DepthMap, rect: Rect, wanted: &Wanted) -> Repaired {
        repaired_with(&[], pixels, depth, rect, wanted)
    }

    fn repaired_with(surfels: &[Surfel], pixels: &Pixels, depth: &DepthMap, rect: Rect, wanted: &Wanted) -> Repaired {
        let (rays, pose) = (camera(), Pose::IDENTITY);
        let response = Response { curve: Curve::Srgb, ..Default::default() };
        let shutter = [&pose; 2];
        let (measured, frame, response) = (Some((depth, &pose)), &pose, &response);
        Repair {
            rays: &rays,
            measured,
            frame,
            shutter,
            pixels,
            response,
            proxies: None,
            neighbours: &[],
            planes: &[],
            surfels,
        }
        .over(rect, rect, rect, wanted)
    }

    #[test]
    fn screen_that_no_frame_measured_is_whole_by_surfels() {
        let (pixels, mut depth, inside) = screen();
        (0..WIDTH * HEIGHT).filter(|i| inside(*i)).for_each(|i| depth.depth_m[i] = 0.0);
        let response = Response { curve: Curve::Srgb, ..Default::default() };
        let sqrt_color = SqrtColors::new(&pixels, &response).at(80, 60);
        let at = |n: i32| SURFEL_SPACING_M as f32 * n as f32;
        let places = (-40..40).flat_map(|x| (-40..40).map(move |y| Vec3::new(at(x), at(y), 1.0)));
        let surfels: Vec<Surfel> =
            places.map(|position_m| Surfel { position_m, normal: Vec3::NEG_Z, sqrt_color }).collect();
        let rect = Rect::full(WIDTH as u32, HEIGHT as u32);
        let near = |surfels: &[Surfel]| {
            let found = repaired_with(surfels, &pixels, &depth, rect, &Wanted::all(rect)).depth_m;
            let is_near = |i: &usize| (found[*i] - 1.0).abs() < 0.1;
            (0..WIDTH * HEIGHT).filter(|i| inside(*i) == is_near(i)).count() as f64 / (WIDTH * HEIGHT) as f64
        };
        assert!(near(&surfels) > 0.98 && near(&[]) < 0.8, "{} {}", near(&surfels), near(&[]));
    }

    #[test]
    fn a_screen_of_which_little_was_seen_is_whole() {
        let (pixels, depth, inside) = screen();
        for rect in [Rect::full(160, 120), Rect::new(60, 20, 140, 100), Rect::new(20, 50, 50, 60)] {
            let found = repaired(&pixels, &depth, rect, &Wanted::all(rect)).depth_m;
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
    fn an_object_is_hidden_alike_whether_all_depth_is_wanted_or_what_lies_before_it() {
        let (pixels, depth, _) = screen();
        let (drawn, nothing) = (Rect::new(50, 20, 110, 100), Rect::new(0, 0, 0, 0));
        for object_m in [0.5f32, 1.5, 3.0] {
            let wanted = Wanted { objects: vec![(drawn, object_m)], all_of: nothing, receiver: nothing };
            let [all, some] =
                [Wanted::all(drawn), wanted].map(|wanted| repaired(&pixels, &depth, drawn, &wanted).shared);
            let hidden = |s: &MattePixel| match () {
                () if object_m > s.far_m => 1.0,
                () if object_m > s.near_m => s.share,
                () => 0.0,
            };
            assert!(all.iter().map(hidden).eq(some.iter().map(hidden)), "{object_m}");
        }
    }

    #[test]
    fn second_surface_of_an_edge_pixel_has_its_share_of_the_light_by_hand() {
        // I = 0.25·0.1 + 0.75·0.4 = 0.325 of light, of which 0.3 are the farther surface's.
        let matte = MattePixel { near_m: 1.0, far_m: 2.0, share: 0.25, fringe: [0.25 * (0.1 - 0.4); 3] };
        let look = [0.325f32.sqrt(); 3];
        let far = SecondSurface::of(&matte, 1.0, look);
        assert!((far.light_share[0] - 0.3 / 0.325).abs() < 1e-5 && far.depth_m == 2.0, "{far:?}");
        let near = SecondSurface::of(&matte, 2.0, look);
        assert!((near.light_share[1] - 0.025 / 0.325).abs() < 1e-5 && near.depth_m == 1.0, "{near:?}");
        // In the dark by area, and nothing where there is one surface.
        assert_eq!(SecondSurface::of(&matte, 1.0, [0.0; 3]).light_share, [0.75; 3]);
        assert_eq!(SecondSurface::of(&MattePixel { far_m: 1.0, ..matte }, 1.0, look), SecondSurface::default());
    }

    #[test]
    fn second_surfaces_are_the_same_whether_their_mattes_are_known_already_or_not() {
        let (pixels, mut depth, inside) = screen();
        depth.depth_m = (0..WIDTH * HEIGHT).map(|i| if inside(i) { 1.0 } else { 2.0 }).collect();
        let (whole, part) = (Rect::full(160, 120), Rect::new(20, 10, 100, 80));
        let nothing = Rect::new(0, 0, 0, 0);
        let of = |object: Rect| {
            let wanted = Wanted { objects: vec![(object, 9.0)], all_of: part, receiver: part };
            repaired(&pixels, &depth, whole, &wanted).receiver
        };
        let (alone, beside) = (of(nothing), of(Rect::new(35, 20, 60, 60)));
        assert!(alone.len() == 80 * 70 && alone.iter().filter(|second| second.depth_m > 0.0).count() > 200);
        assert_eq!(alone, beside);
    }

    #[test]
    fn where_it_is_wanted_by_hand() {
        let beside =
            [Rect::new(-9, 0, -3, 1), Rect::new(12, 0, 15, 1), Rect::new(0, -9, 4, -5)].map(|rect| (rect, 9.0));
        let mut objects = vec![(Rect::new(1, 0, 3, 1), 2.0), (Rect::new(2, 0, 9, 1), 1.0)];
        objects.extend(beside);
        let wanted = Wanted { objects, all_of: Rect::new(0, 1, 1, 2), receiver: Rect::new(0, 0, 0, 0) };
        let inf = f32::INFINITY;
        assert_eq!(wanted.max_depth_m(Rect::new(0, 0, 4, 2), 0), [0.0, 2.0, 2.0, 1.0, inf, 0.0, 0.0, 0.0]);
        assert_eq!(wanted.max_depth_m(Rect::new(0, 0, 4, 2), 1), [inf, inf, 2.0, 2.0, inf, inf, 2.0, 2.0]);
        assert_eq!(wanted.objects_only().max_depth_m(Rect::new(2, 1, 4, 2), 0), [0.0; 2]);
    }

    #[test]
    fn a_whole_map_stays_as_it_was_measured() {
        let (pixels, mut depth, inside) = screen();
        depth.depth_m = (0..WIDTH * HEIGHT).map(|i| if inside(i) { 1.0 } else { 2.0 }).collect();
        let (whole, part) = (Rect::full(160, 120), Rect::new(-3, 5, 30, 50));
        assert_eq!(repaired(&pixels, &depth, whole, &Wanted::all(whole)).depth_m, depth.depth_m);
        // Nothing is made from nothing.
        depth.depth_m.fill(0.0);
        assert!(repaired(&pixels, &depth, part, &Wanted::all(part)).depth_m.iter().all(|z| *z == 0.0));
    }
}
