//! Repair of a frame's depth: reprojection to the frame's time, consensus, surfels, inpainting.
//!
//! Depth that occludes an object must have no holes. A sensor measures only a few pixels of a black
//! screen, different ones in each frame, and an object behind it would be visible between them.
//! Holes are therefore filled and edges aligned with the picture's (`inpaint`), as for a
//! photograph, but only around the objects.
//!
//! Not modelled: inpainting depends only on measurements within a twentieth of the picture's width
//! around the objects.

use glam::DVec3;

use super::contact;
use super::matte::{self, MattePixel};
use super::proxies::{FAR_M, ProjectedPoint, Proxies, unknown_if_far_m};
use super::smear::MotionField;
use super::sqrt_colors::SqrtColors;
use super::{Rays, inpaint, smooth, vote};
use crate::camera::Response;
use crate::frame::{NeighbourFrame, Surfel};
use crate::parallel::{over_rows, processors};
use crate::pixels::{DepthMap, Pixels, Rect};
use crate::plane::Plane;
use crate::pose::Pose;

/// Margin of the repaired region around the objects, as a fraction of the picture's width. The
/// region is aligned to steps of this size, so that it stays the same while an object moves a
/// little.
const REGION_MARGIN: f64 = 1.0 / 20.0;
/// Margin around the objects in which edges are smoothed, px: the reach of a matte.
const SMOOTHING_MARGIN_PX: i32 = matte::MAX_REACH_PX;
/// Smallest light by which fractions are weighted. In darker light the fractions of two surfaces
/// are those of the pixel's area.
const MIN_LIGHT: f32 = 1e-4;

/// The inputs for repairing a frame's depth.
#[derive(Clone, Copy)]
pub struct Repair<'a> {
    pub rays: &'a Rays,
    /// The map, and the pose at which it was measured; `None` without a sensor.
    pub measured: Option<(&'a DepthMap, &'a Pose)>,
    /// The pose at which the frame was taken.
    pub frame: &'a Pose,
    /// The poses when the shutter opened and when it closed.
    pub shutter: [&'a Pose; 2],
    pub pixels: &'a Pixels,
    pub response: &'a Response,
    /// Support planes of objects.
    pub planes: &'a [Plane],
    /// Models in place of real objects.
    pub proxies: Option<ProxyView<'a>>,
    /// Frames that vote where the map is unreliable.
    pub neighbours: &'a [PosedNeighbour<'a>],
    /// Surfaces from the whole recording.
    pub surfels: &'a [Surfel],
}

/// Models in place of real objects as a camera sees them.
#[derive(Clone, Copy)]
pub struct ProxyView<'a> {
    pub proxies: &'a Proxies,
    pub project: &'a dyn Fn(DVec3) -> ProjectedPoint,
    /// The poses that `project` interpolates, at equal steps over ± the seconds beside them.
    pub poses: (&'a [Pose], f64),
}

impl std::fmt::Debug for ProxyView<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ProxyView").field("proxies", &self.proxies).finish_non_exhaustive()
    }
}

/// Another frame, with the poses at which its map was measured and its picture was taken.
#[derive(Clone, Copy, Debug)]
pub struct PosedNeighbour<'a> {
    pub frame: &'a NeighbourFrame,
    pub map_pose: Pose,
    pub picture_pose: Pose,
}

impl<'a> PosedNeighbour<'a> {
    /// The frame as a voter, with square-root colours.
    pub fn voter(&self, response: &Response) -> vote::VotingFrame<'a> {
        let Self { frame, map_pose, picture_pose } = *self;
        vote::VotingFrame {
            depth: &frame.depth,
            map_pose,
            picture_pose,
            sqrt_colors: SqrtColors::new(&frame.pixels, response),
        }
    }
}

/// The regions in which depth is requested, and up to which depth.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthRequest {
    /// Rectangles, with the depth beyond which a real surface occludes nothing in them, m.
    pub objects: Vec<(Rect, f32)>,
    /// Depth is requested without a limit here.
    pub full_depth_rect: Rect,
    /// The part of it with shadows on real surfaces, where the mattes of all edges are requested.
    pub receiver_rect: Rect,
}

impl DepthRequest {
    /// A request for all depths in a rectangle.
    pub fn all(rect: Rect) -> Self {
        Self { objects: vec![(rect, f32::INFINITY)], full_depth_rect: rect, receiver_rect: Rect::new(0, 0, 0, 0) }
    }

    fn objects_only(&self) -> Self {
        Self { full_depth_rect: Rect::new(0, 0, 0, 0), ..self.clone() }
    }

    /// The requested limit of depth at each pixel of a rectangle, or within `reach_px` of the
    /// pixel, m, row by row; 0 for pixels that are not requested.
    fn max_depth_m(&self, rect: Rect, reach_px: i32) -> Vec<f32> {
        let mut max_depth_m = vec![0.0f32; rect.width() as usize * rect.height() as usize];
        let full_depth = [(self.full_depth_rect, f32::INFINITY)];
        for (requested, limit_m) in self.objects.iter().chain(&full_depth).filter(|(rect, _)| !rect.is_empty()) {
            let part = requested.grown(reach_px).intersection(&rect);
            if part.is_empty() {
                continue;
            }
            let part = part.moved(-rect.x0, -rect.y0);
            for y in part.y0..part.y1 {
                let start = y as usize * rect.width() as usize;
                let row = &mut max_depth_m[start..][part.x0 as usize..part.x1 as usize];
                row.iter_mut().for_each(|max_depth_m| *max_depth_m = max_depth_m.max(*limit_m));
            }
        }
        max_depth_m
    }
}

/// A part of a frame's map, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct RepairedDepth {
    /// Depth of the larger surface of each pixel, m; 0 if it was neither measured nor repaired.
    pub depth_m: Vec<f32>,
    /// Over the part of it with virtual objects.
    pub mattes: Vec<MattePixel>,
    /// Over [`DepthRequest::receiver_rect`].
    pub second_surfaces: Vec<SecondSurface>,
}

/// The other surface of a pixel at an edge: the one that is not in the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SecondSurface {
    /// Its fraction of the pixel's light, for each colour.
    pub light_fraction: [f32; 3],
    /// m; 0 if the pixel shows one surface alone.
    pub depth_m: f32,
}

impl SecondSurface {
    /// The second surface of a pixel that shows I = α·F + (1 − α)·B. The farther surface has the
    /// fraction (1 − α)·B/I of its light, with B = I − α·(F − B).
    fn of(matte: &MattePixel, depth_m: f32, sqrt_color: [f32; 3]) -> Self {
        if matte.near_m >= matte.far_m {
            return Self::default();
        }
        let far = |c: usize| {
            let (light, rest) = (sqrt_color[c] * sqrt_color[c], 1.0 - matte.alpha);
            if light < MIN_LIGHT { rest } else { (rest * (1.0 - matte.fringe[c] / light)).clamp(0.0, 1.0) }
        };
        let far = [far(0), far(1), far(2)];
        if depth_m == matte.near_m {
            return Self { light_fraction: far, depth_m: matte.far_m };
        }
        Self { light_fraction: far.map(|fraction| 1.0 - fraction), depth_m: matte.near_m }
    }
}

impl<'a> Repair<'a> {
    /// Depth over `around` at the frame's time, repaired in and around `near`, a part of it, and
    /// elsewhere as measured. Edges are smoothed where depth is requested. Mattes cover `drawn`, a
    /// part of `near`. The result depends on `near` through the measurements around it.
    pub fn repaired_depth(&self, around: Rect, near: Rect, drawn: Rect, request: &DepthRequest) -> RepairedDepth {
        let region = self.region(near);
        let all = region.union(&around);
        let measured_m = match self.measured {
            Some((depth, measured)) => self.rays.reproject(depth, measured, self.frame, all),
            None => vec![0.0; all.width() as usize * all.height() as usize],
        };
        let sqrt_colors = self.sqrt_colors(region);
        let mut depth_m = all.part(&measured_m, region);
        let width = region.width() as usize;
        let max_depth_m = request.max_depth_m(region, SMOOTHING_MARGIN_PX);
        let is_reliable = self.apply_consensus(&mut depth_m, &sqrt_colors, region, &max_depth_m);
        if let Some(ProxyView { proxies, project, .. }) = self.proxies {
            proxies.rasterize(&mut depth_m, region, project);
        }
        if self.measured.is_none() {
            depth_m.iter_mut().filter(|z| **z == 0.0).for_each(|z| *z = FAR_M);
        }
        // Without any measurement nothing occludes. Without a sensor, models' edges are exact.
        let recorded = &self.rays.geometry().intrinsics;
        if self.measured.is_some()
            && inpaint::inpaint(&mut depth_m, &is_reliable, &sqrt_colors, width, recorded, 1.0) == Some(true)
        {
            smooth::smooth(&mut depth_m, &sqrt_colors, width, &max_depth_m);
        }
        contact::snap_to_planes(&mut depth_m, self.rays, self.frame, region, self.planes);
        let smear = MotionField::new(self.rays.geometry(), self.frame, self.shutter, region);
        let within = drawn.moved(-region.x0, -region.y0);
        let mattes =
            matte::mattes(&depth_m, &sqrt_colors, width, &smear, within, &request.objects_only().max_depth_m(drawn, 0));
        let second_surfaces =
            self.second_surfaces((&depth_m, &sqrt_colors, region), &smear, (&mattes, drawn), request.receiver_rect);
        let mut out = all.part(&measured_m, around);
        depth_m.iter_mut().for_each(|z| *z = unknown_if_far_m(*z));
        copy_overlap(&mut out, around, &depth_m, region);
        RepairedDepth { depth_m: out, mattes, second_surfaces }
    }

    /// The second surfaces of pixels in `part`. `drawn_mattes` over `drawn` are reused.
    fn second_surfaces(
        &self,
        (depth_m, sqrt_colors, region): (&[f32], &[[f32; 3]], Rect),
        smear: &MotionField,
        (drawn_mattes, drawn): (&[MattePixel], Rect),
        part: Rect,
    ) -> Vec<SecondSurface> {
        if part.is_empty() {
            return Vec::new();
        }
        let (columns, width) = (part.width() as usize, region.width() as usize);
        let at = |rect: &Rect, x: i32, y: i32| (y - rect.y0) as usize * rect.width() as usize + (x - rect.x0) as usize;
        // Mattes that are not computed again.
        let both = part.intersection(&drawn);
        let places = (both.y0..both.y1.max(both.y0)).flat_map(|y| (both.x0..both.x1).map(move |x| (x, y)));
        let reused = places.filter_map(|(x, y)| {
            let matte = &drawn_mattes[at(&drawn, x, y)];
            (matte.near_m < matte.far_m).then_some((at(&part, x, y), matte))
        });
        let reused: Vec<_> = reused.collect();
        let mut max_depth_m = vec![f32::INFINITY; columns * part.height() as usize];
        reused.iter().for_each(|(at, _)| max_depth_m[*at] = 0.0);
        let within = part.moved(-region.x0, -region.y0);
        let mut mattes = matte::mattes(depth_m, sqrt_colors, width, smear, within, &max_depth_m);
        reused.iter().for_each(|(at, matte)| mattes[*at] = **matte);
        let mut out = Vec::with_capacity(mattes.len());
        for (y, mattes) in (part.y0..).zip(mattes.chunks_exact(columns)) {
            let first = at(&region, part.x0, y);
            let there = depth_m[first..].iter().zip(&sqrt_colors[first..]);
            out.extend(
                mattes.iter().zip(there).map(|(matte, (z, sqrt_color))| SecondSurface::of(matte, *z, *sqrt_color)),
            );
        }
        out
    }

    /// The rectangle with its margin, within the picture.
    fn region(&self, rect: Rect) -> Rect {
        let (width, height) = (self.pixels.width as i32, self.pixels.height as i32);
        let step = ((f64::from(width) * REGION_MARGIN) as i32).max(1);
        let [x0, y0] = [rect.x0, rect.y0].map(|at| (at - step).div_euclid(step) * step);
        let [x1, y1] = [rect.x1, rect.y1].map(|at| (at + 2 * step - 1).div_euclid(step) * step);
        // A 360° picture wraps around.
        let beyond = if self.rays.geometry().is_equirectangular() { width } else { 0 };
        Rect::new(x0, y0, x1, y1).intersection(&Rect::new(-beyond, 0, width + beyond, height)).union(&rect)
    }

    /// Square roots of light, row by row. Coordinates outside the picture are clamped.
    fn sqrt_colors(&self, region: Rect) -> Vec<[f32; 3]> {
        let (width, height) = (self.pixels.width as i32, self.pixels.height as i32);
        let sqrt_colors = SqrtColors::new(self.pixels, self.response);
        let round = self.rays.geometry().is_equirectangular();
        let column = |x: i32| if round { x.rem_euclid(width) } else { x.clamp(0, width - 1) };
        let mut out = vec![[0.0; 3]; region.width() as usize * region.height() as usize];
        over_rows(&mut out, region.width() as usize, processors(), |row, out| {
            let y = (region.y0 + row as i32).clamp(0, height - 1);
            if region.x0 >= 0 && region.x1 <= width {
                return sqrt_colors.fill_row(region.x0 as u32, y as u32, out);
            }
            (region.x0..).zip(out).for_each(|(x, there)| *there = sqrt_colors.at(column(x) as u32, y as u32));
        });
        out
    }

    /// Replaces unreliable depth of a part by the consensus of the neighbours, and depth that is
    /// still unknown by surfels. Returns the mask of reliable pixels.
    fn apply_consensus(
        &self,
        depth_m: &mut [f32],
        sqrt_colors: &[[f32; 3]],
        part: Rect,
        max_depth_m: &[f32],
    ) -> Vec<bool> {
        let voters: Vec<_> = self.neighbours.iter().map(|neighbour| neighbour.voter(self.response)).collect();
        let target = vote::TargetView { rays: self.rays, pose: *self.frame, part, sqrt_colors, max_depth_m };
        let is_reliable = target.apply_consensus(depth_m, &voters);
        target.fill_unknown(depth_m, self.surfels);
        is_reliable
    }
}

/// Copies the values of one rectangle to another where the two overlap.
fn copy_overlap(values: &mut [f32], rect: Rect, others: &[f32], other: Rect) {
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

    /// A black screen at 1 m, columns 40 to 119 and rows 30 to 89, in front of a bright wall at 2
    /// m. The sensor measures the screen's rim, and one in fifty of its pixels.
    fn screen() -> (Pixels, DepthMap, impl Fn(usize) -> bool) {
        let is_inside = |i: usize| (40..120).contains(&(i % WIDTH)) && (30..90).contains(&(i / WIDTH));
        let codes = (0..WIDTH * HEIGHT).flat_map(|i| [if is_inside(i) { 10 } else { 200 }; 3]).collect();
        let depth_m = (0..WIDTH * HEIGHT)
            .map(|i| match is_inside(i) {
                false => 2.0,
                true if i % 10 == 0 && (i / WIDTH).is_multiple_of(5) => 1.0,
                true if [i - 1, i + 1, i - WIDTH, i + WIDTH].iter().any(|&n| !is_inside(n)) => 1.0,
                true => 0.0,
            })
            .collect();
        let depth = DepthMap { width: WIDTH as u32, height: HEIGHT as u32, depth_m, timestamp_s: 0.0 };
        (Pixels::from_u8(WIDTH as u32, HEIGHT as u32, codes).unwrap(), depth, is_inside)
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

    fn repaired(pixels: &Pixels, depth: &DepthMap, rect: Rect, request: &DepthRequest) -> RepairedDepth {
        repaired_with(&[], pixels, depth, rect, request)
    }

    fn repaired_with(
        surfels: &[Surfel],
        pixels: &Pixels,
        depth: &DepthMap,
        rect: Rect,
        request: &DepthRequest,
    ) -> RepairedDepth {
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
        .repaired_depth(rect, rect, rect, request)
    }

    #[test]
    fn screen_without_measurements_is_filled_by_surfels() {
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
            let depth_m = repaired_with(surfels, &pixels, &depth, rect, &DepthRequest::all(rect)).depth_m;
            let is_near = |i: &usize| (depth_m[*i] - 1.0).abs() < 0.1;
            (0..WIDTH * HEIGHT).filter(|i| inside(*i) == is_near(i)).count() as f64 / (WIDTH * HEIGHT) as f64
        };
        assert!(near(&surfels) > 0.98 && near(&[]) < 0.8, "{} {}", near(&surfels), near(&[]));
    }

    #[test]
    fn screen_with_few_measurements_is_filled() {
        let (pixels, depth, inside) = screen();
        for rect in [Rect::full(160, 120), Rect::new(60, 20, 140, 100), Rect::new(20, 50, 50, 60)] {
            let depth_m = repaired(&pixels, &depth, rect, &DepthRequest::all(rect)).depth_m;
            assert_eq!(depth_m.len(), (rect.width() * rect.height()) as usize);
            for (n, z) in depth_m.iter().enumerate() {
                let (x, y) =
                    (rect.x0 as usize + n % rect.width() as usize, rect.y0 as usize + n / rect.width() as usize);
                let expected = if inside(y * WIDTH + x) { 1.0 } else { 2.0 };
                assert!((z / expected - 1.0).abs() < 0.1, "{x} {y} of {rect:?}: {z}");
            }
        }
    }

    #[test]
    fn occlusion_of_an_object_does_not_depend_on_the_requested_depth() {
        let (pixels, depth, _) = screen();
        let (drawn, nothing) = (Rect::new(50, 20, 110, 100), Rect::new(0, 0, 0, 0));
        for object_m in [0.5f32, 1.5, 3.0] {
            let request =
                DepthRequest { objects: vec![(drawn, object_m)], full_depth_rect: nothing, receiver_rect: nothing };
            let [all, some] =
                [DepthRequest::all(drawn), request].map(|request| repaired(&pixels, &depth, drawn, &request).mattes);
            let hidden = |s: &MattePixel| {
                if object_m > s.far_m {
                    1.0
                } else if object_m > s.near_m {
                    s.alpha
                } else {
                    0.0
                }
            };
            assert!(all.iter().map(hidden).eq(some.iter().map(hidden)), "{object_m}");
        }
    }

    #[test]
    fn second_surface_has_its_fraction_of_the_light_by_hand() {
        // I = 0.25·0.1 + 0.75·0.4 = 0.325 of light. The farther surface has 0.3 of it.
        let matte = MattePixel { near_m: 1.0, far_m: 2.0, alpha: 0.25, fringe: [0.25 * (0.1 - 0.4); 3] };
        let sqrt_color = [0.325f32.sqrt(); 3];
        let far = SecondSurface::of(&matte, 1.0, sqrt_color);
        assert!((far.light_fraction[0] - 0.3 / 0.325).abs() < 1e-5 && far.depth_m == 2.0, "{far:?}");
        let near = SecondSurface::of(&matte, 2.0, sqrt_color);
        assert!((near.light_fraction[1] - 0.025 / 0.325).abs() < 1e-5 && near.depth_m == 1.0, "{near:?}");
        // In the dark by area. A pixel with one surface has no second one.
        assert_eq!(SecondSurface::of(&matte, 1.0, [0.0; 3]).light_fraction, [0.75; 3]);
        assert_eq!(SecondSurface::of(&MattePixel { far_m: 1.0, ..matte }, 1.0, sqrt_color), SecondSurface::default());
    }

    #[test]
    fn second_surfaces_are_the_same_with_and_without_reused_mattes() {
        let (pixels, mut depth, inside) = screen();
        depth.depth_m = (0..WIDTH * HEIGHT).map(|i| if inside(i) { 1.0 } else { 2.0 }).collect();
        let (whole, part) = (Rect::full(160, 120), Rect::new(20, 10, 100, 80));
        let nothing = Rect::new(0, 0, 0, 0);
        let second_surfaces = |object: Rect| {
            let request = DepthRequest { objects: vec![(object, 9.0)], full_depth_rect: part, receiver_rect: part };
            repaired(&pixels, &depth, whole, &request).second_surfaces
        };
        let (alone, beside) = (second_surfaces(nothing), second_surfaces(Rect::new(35, 20, 60, 60)));
        assert!(alone.len() == 80 * 70 && alone.iter().filter(|second| second.depth_m > 0.0).count() > 200);
        assert_eq!(alone, beside);
    }

    #[test]
    fn requested_depth_limits_match_an_example_by_hand() {
        let beside =
            [Rect::new(-9, 0, -3, 1), Rect::new(12, 0, 15, 1), Rect::new(0, -9, 4, -5)].map(|rect| (rect, 9.0));
        let mut objects = vec![(Rect::new(1, 0, 3, 1), 2.0), (Rect::new(2, 0, 9, 1), 1.0)];
        objects.extend(beside);
        let request =
            DepthRequest { objects, full_depth_rect: Rect::new(0, 1, 1, 2), receiver_rect: Rect::new(0, 0, 0, 0) };
        let inf = f32::INFINITY;
        assert_eq!(request.max_depth_m(Rect::new(0, 0, 4, 2), 0), [0.0, 2.0, 2.0, 1.0, inf, 0.0, 0.0, 0.0]);
        assert_eq!(request.max_depth_m(Rect::new(0, 0, 4, 2), 1), [inf, inf, 2.0, 2.0, inf, inf, 2.0, 2.0]);
        assert_eq!(request.objects_only().max_depth_m(Rect::new(2, 1, 4, 2), 0), [0.0; 2]);
    }

    #[test]
    fn map_without_holes_is_unchanged() {
        let (pixels, mut depth, inside) = screen();
        depth.depth_m = (0..WIDTH * HEIGHT).map(|i| if inside(i) { 1.0 } else { 2.0 }).collect();
        let (whole, part) = (Rect::full(160, 120), Rect::new(-3, 5, 30, 50));
        assert_eq!(repaired(&pixels, &depth, whole, &DepthRequest::all(whole)).depth_m, depth.depth_m);
        // An empty map stays empty.
        depth.depth_m.fill(0.0);
        assert!(repaired(&pixels, &depth, part, &DepthRequest::all(part)).depth_m.iter().all(|z| *z == 0.0));
    }
}
