//! What several frames say of a part of a frame's depth.
//!
//! One sensor's map is torn at its edges, by pixels and differently in each frame, and of dark things it sees a few places,
//! others each time. So where a frame's own map is doubtful, near its edges and where it has none, the maps of its
//! neighbours vote: each point is carried to the frame by the poses. Of the depths that a pixel is told, the one wins on
//! which most agree.
//!
//! Things move. A neighbour's point counts only if it has the colour that the frame shows there, in light that is made alike:
//! cameras change their exposure and white balance from frame to frame. And where the frame's own map is not doubtful,
//! nobody else is asked.
//!
//! Not modelled: points that look alike and move; lenses that change from frame to frame.

use std::sync::Mutex;

use glam::{DVec3, Mat3, Vec2, Vec3};

use super::Rays;
use super::apart::JUMP;
use super::looks::Looks;
use crate::camera::{Distortion, Geometry, LensModel};
use crate::pixels::{DepthMap, Rect};
use crate::pose::Pose;
use crate::rows::processors;

/// Within this share of the picture's width of an edge or a hole a map is doubtful: as far as it may be off.
const DOUBTFUL: f64 = super::edges::MOST_OFF;
/// A voter may show what moves into the part from so far outside, px.
const BEYOND_PX: i32 = 64;
/// Colours (square roots of light) are alike within this of the range of the pixels around: noise, and the blur of motion.
const ALIKE: f32 = 0.06;
/// Every so many pixels colours are compared to find how much brighter a voter's picture is, and the fewest that tell.
const EVERY: usize = 5;
const FEWEST: usize = 60;
/// A ratio of colours that are darker or brighter tells nothing.
const TELLING: std::ops::Range<f32> = 0.12..0.97;
/// Depths on which voters agree differ by less than this factor.
const AGREE: f32 = 1.0 + 0.5 * (JUMP - 1.0);

/// A neighbouring frame.
pub struct Voter<'a> {
    pub depth: &'a DepthMap,
    /// The poses at which its map was measured and its picture was taken.
    pub measured: Pose,
    pub taken: Pose,
    /// Its picture's.
    pub looks: Looks<'a>,
}

/// The frame whose depth is doubtful.
pub struct Own<'a> {
    pub rays: &'a Rays,
    /// At which its picture was taken.
    pub pose: Pose,
    /// The part of its picture that is looked at.
    pub part: Rect,
    /// Square roots of the part's light, row by row.
    pub looks: &'a [[f32; 3]],
}

impl Own<'_> {
    /// Replaces what is doubtful of the part's `depth_m` (0 where unknown) by what most say.
    pub fn agreed(&self, depth_m: &mut [f32], voters: &[Voter<'_>]) {
        if voters.is_empty() || depth_m.is_empty() {
            return;
        }
        let width = self.part.width() as usize;
        let reach_px = (DOUBTFUL * f64::from(self.rays.geometry().intrinsics.width_px)).round() as usize;
        let doubtful = doubtful(depth_m, width, reach_px);
        if !doubtful.contains(&true) {
            return;
        }
        let source = self.part.grown(BEYOND_PX).intersection(&self.rays.full());
        self.rays.prepare(source.y0..source.y1.max(source.y0));
        let mut told: Vec<Vec<f32>> = vec![Vec::new(); voters.len()];
        let work = Mutex::new(told.iter_mut().zip(voters));
        std::thread::scope(|scope| {
            let carry = || {
                while let Some((told, voter)) = work.lock().ok().and_then(|mut work| work.next()) {
                    *told = self.carried(voter, source, &doubtful);
                }
            };
            for _ in 1..processors().min(voters.len()) {
                let _ = std::thread::Builder::new().spawn_scoped(scope, carry);
            }
            carry();
        });
        let mut heard = Vec::with_capacity(voters.len() + 1);
        for i in (0..depth_m.len()).filter(|&i| doubtful[i]) {
            heard.clear();
            heard.push(depth_m[i]);
            heard.extend(told.iter().map(|told| told[i]));
            depth_m[i] = most(&mut heard);
        }
    }

    /// A voter's depth at each doubtful pixel, m; 0 where it says nothing.
    fn carried(&self, voter: &Voter<'_>, source: Rect, doubtful: &[bool]) -> Vec<f32> {
        let geometry = self.rays.geometry();
        let mut out = vec![0.0f32; doubtful.len()];
        if (voter.depth.width, voter.depth.height) != (geometry.intrinsics.width_px, geometry.intrinsics.height_px) {
            return out;
        }
        let (lens, full) = (Lens::new(geometry), self.rays.full());
        let [here, there] = [&self.pose, &voter.taken].map(|pose| Way::between(&voter.measured, pose));
        let (width, height) = (self.part.width() as i32, self.part.height() as i32);
        let mut points = Vec::new();
        let mut compared = Vec::new();
        for y in source.y0..source.y1 {
            let Some(rays) = self.rays.row(y as usize) else { continue };
            for x in source.x0..source.x1 {
                let z = voter.depth.depth_m[y as usize * voter.depth.width as usize + x as usize];
                if z.is_nan() || z <= 0.0 {
                    continue;
                }
                let point = z * Vec3::from(rays[x as usize]);
                let seen = here.of(point);
                let Some(at) = lens.project(seen) else { continue };
                // The pixel in which it lies, and no more: points that covered the pixels around would widen what is near. What
                // one voter leaves open others fill.
                let (column, row) = (floor(at.x) - self.part.x0, floor(at.y) - self.part.y0);
                if column < 0 || row < 0 || column >= width || row >= height {
                    continue;
                }
                let i = (row * width + column) as usize;
                let compares = (x as usize).is_multiple_of(EVERY) && (y as usize).is_multiple_of(EVERY);
                if !doubtful[i] && !compares {
                    continue;
                }
                let Some(shown) = lens.project(there.of(point)) else { continue };
                let (column, row) = (floor(shown.x), floor(shown.y));
                if !full.contains(column, row) {
                    continue;
                }
                let looks = voter.looks.at(column as u32, row as u32);
                if compares {
                    compared.push((self.looks[i], looks));
                }
                if doubtful[i] {
                    points.push((i, if geometry.is_round() { seen.length() } else { seen.z }, looks));
                }
            }
        }
        let gain = gain(&compared);
        // Of several points at a pixel the nearest stays, negative where it looks otherwise than the frame does.
        for (i, z, looks) in points {
            if out[i] == 0.0 || z < out[i].abs() {
                let brought = [0, 1, 2].map(|c| gain[c] * looks[c]);
                out[i] = if self.shows(i, brought) { z } else { -z };
            }
        }
        out
    }

    /// Whether the frame shows this colour at or beside a pixel.
    fn shows(&self, i: usize, looks: [f32; 3]) -> bool {
        let (width, height) = (self.part.width() as usize, self.part.height() as usize);
        let (x, y) = (i % width, i / width);
        let (mut low, mut high) = ([f32::INFINITY; 3], [0.0f32; 3]);
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            for there in &self.looks[y * width + x.saturating_sub(1)..y * width + (x + 2).min(width)] {
                for c in 0..3 {
                    low[c] = low[c].min(there[c]);
                    high[c] = high[c].max(there[c]);
                }
            }
        }
        // What is clipped may have been anything brighter.
        (0..3).all(|c| looks[c] > low[c] - ALIKE && (looks[c] < high[c] + ALIKE || high[c] > TELLING.end))
    }
}

/// The next whole number below: without a call into the mathematics library. Far outside a picture it does not matter.
fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole.saturating_sub(i32::from((whole as f32) > x))
}

/// What most agree on; the nearest of what as many do. The frame's own value comes first, and stays where it is among them.
fn most(heard: &mut Vec<f32>) -> f32 {
    let own = heard[0];
    heard.retain(|z| *z > 0.0);
    heard.sort_unstable_by(f32::total_cmp);
    let (mut best, mut from) = (0, 0);
    for (n, nearest) in heard.iter().enumerate() {
        let agree = heard[n..].partition_point(|z| *z < AGREE * nearest);
        if agree > best {
            (best, from) = (agree, n);
        }
    }
    let agreed = &heard[from..from + best];
    match agreed.get(best / 2) {
        Some(_) if agreed.contains(&own) => own,
        Some(median) => *median,
        None => 0.0,
    }
}

/// By how much a voter's colours are to be multiplied, by the median of those that are seen twice.
fn gain(compared: &[([f32; 3], [f32; 3])]) -> [f32; 3] {
    [0, 1, 2].map(|c| {
        let tells = |(own, other): &&([f32; 3], [f32; 3])| TELLING.contains(&own[c]) && TELLING.contains(&other[c]);
        let mut ratios: Vec<f32> = compared.iter().filter(tells).map(|(own, other)| own[c] / other[c]).collect();
        if ratios.len() < FEWEST {
            return 1.0;
        }
        let middle = ratios.len() / 2;
        *ratios.select_nth_unstable_by(middle, f32::total_cmp).1
    })
}

/// Where a map is unknown or has an edge, and around.
fn doubtful(depth_m: &[f32], width: usize, reach_px: usize) -> Vec<bool> {
    let height = depth_m.len() / width;
    let is_torn = |i: usize, beside: usize| {
        let (a, b) = (depth_m[i], depth_m[beside]);
        a <= 0.0 || b <= 0.0 || a.max(b) > JUMP * a.min(b)
    };
    let mut torn = vec![0u32; depth_m.len()];
    for i in 0..depth_m.len() {
        let right = (i % width + 1 < width).then_some(i + 1);
        let below = (i / width + 1 < height).then_some(i + width);
        for beside in [right, below].into_iter().flatten().filter(|&beside| is_torn(i, beside)) {
            (torn[i], torn[beside]) = (1, 1);
        }
    }
    // A sliding sum along rows, then along columns.
    let slide = |values: &mut [u32], first: usize, step: usize, count: usize| {
        let held: Vec<u32> = (0..count).map(|n| values[first + n * step]).collect();
        let mut sum: u32 = held.iter().take(reach_px).sum();
        for n in 0..count {
            sum += held.get(n + reach_px).copied().unwrap_or(0);
            values[first + n * step] = u32::from(sum > 0);
            sum -= if n >= reach_px { held[n - reach_px] } else { 0 };
        }
    };
    (0..height).for_each(|y| slide(&mut torn, y * width, 1, width));
    (0..width).for_each(|x| slide(&mut torn, x, width, height));
    torn.into_iter().map(|n| n > 0).collect()
}

/// From one camera's axes to another's.
struct Way {
    turn: Mat3,
    shift_m: Vec3,
}

impl Way {
    fn between(from: &Pose, to: &Pose) -> Self {
        let carried = |point: DVec3| to.transform_point(from.inverse_transform_point(point));
        let origin = carried(DVec3::ZERO);
        let axis = |axis: DVec3| (carried(axis) - origin).as_vec3();
        Self { turn: Mat3::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z)), shift_m: origin.as_vec3() }
    }

    fn of(&self, point: Vec3) -> Vec3 {
        self.turn * point + self.shift_m
    }
}

/// A camera's projection in single precision, where it has OpenCV's distortion (the formula of camera/distortion.rs): a
/// thousandth px is enough here.
struct Lens<'a> {
    geometry: &'a Geometry,
    focal_px: Vec2,
    middle_px: Vec2,
    radial: [f32; 3],
    tangential: Vec2,
    /// Beyond it, the exact one is asked.
    valid2: f32,
}

impl<'a> Lens<'a> {
    fn new(geometry: &'a Geometry) -> Self {
        let (i, Distortion { model, k1, k2, k3, p1, p2, .. }) = (&geometry.intrinsics, &geometry.distortion);
        let valid = if *model == LensModel::Opencv { geometry.valid_radius().min(1e6) as f32 } else { -1.0 };
        Self {
            geometry,
            focal_px: Vec2::new(i.fx_px as f32, i.fy_px as f32),
            middle_px: Vec2::new(i.cx_px as f32, i.cy_px as f32),
            radial: [k1, k2, k3].map(|k| *k as f32),
            tangential: Vec2::new(*p1 as f32, *p2 as f32),
            valid2: valid * valid.abs(),
        }
    }

    fn project(&self, point: Vec3) -> Option<Vec2> {
        let p = point.truncate() / point.z;
        let r2 = p.length_squared();
        if point.z <= 0.0 || r2 > self.valid2 {
            return self.geometry.project(point.as_dvec3()).map(|at| at.as_vec2());
        }
        let [k1, k2, k3] = self.radial;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let Vec2 { x: p1, y: p2 } = self.tangential;
        let tangential = Vec2::new(
            2.0 * p1 * p.x * p.y + p2 * (r2 + 2.0 * p.x * p.x),
            p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y,
        );
        Some((p * radial + tangential) * self.focal_px + self.middle_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Intrinsics, Response};
    use crate::pixels::Pixels;

    const WIDTH: usize = 96;
    const HEIGHT: usize = 64;

    #[test]
    fn single_precision_is_enough() {
        let i = Intrinsics { fx_px: 517.3, fy_px: 516.5, cx_px: 319.1, cy_px: 255.8, ..Intrinsics::default() };
        let k = Distortion { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633, ..Distortion::default() };
        for geometry in [Geometry::new(i.clone(), k), Geometry::new(i, Distortion::default())] {
            let lens = Lens::new(&geometry);
            // A little beyond the corners, too, and behind the camera.
            for (x, y) in (-7..=7).flat_map(|x| (-6..=6).map(move |y| (0.1 * f64::from(x), 0.1 * f64::from(y)))) {
                let exact = geometry.project(1.7 * DVec3::new(x, y, 1.0)).unwrap();
                let found = lens.project(1.7 * Vec3::new(x as f32, y as f32, 1.0)).unwrap().as_dvec2();
                assert!((found - exact).length() < 1e-3, "{x} {y}: {found} is not {exact}");
            }
            assert!(lens.project(Vec3::new(0.1, 0.1, -1.0)).is_none());
        }
    }

    #[test]
    fn most_by_hand() {
        assert_eq!(most(&mut vec![2.0, 1.0, 1.01, 0.0]), 1.01);
        // The frame's own stays where it is one of them.
        assert_eq!(most(&mut vec![1.005, 1.0, 1.01, 2.0]), 1.005);
        // As many: the nearer.
        assert_eq!(most(&mut vec![2.0, 1.0]), 1.0);
        // What looks otherwise is told as negative.
        assert_eq!(most(&mut vec![2.0, -1.0, -1.0]), 2.0);
        assert_eq!(most(&mut vec![0.0, -1.0]), 0.0);
    }

    /// A dark thing at 1 m, columns 30 to 59, before a wall at 2 m that is bright from column 64 on, as maps that end at a
    /// column each.
    fn agreed(own_end: usize, ends: &[usize], voters_code: u8) -> Vec<f32> {
        let map = |end: usize| {
            let depth_m =
                (0..WIDTH * HEIGHT).map(|i| if (30..end).contains(&(i % WIDTH)) { 1.0 } else { 2.0 }).collect();
            DepthMap { width: WIDTH as u32, height: HEIGHT as u32, depth_m, timestamp_s: 0.0 }
        };
        let picture = |dark: u8| {
            let codes = (0..WIDTH * HEIGHT).flat_map(|i| [if (30..64).contains(&(i % WIDTH)) { dark } else { 200 }; 3]);
            Pixels::from_u8(WIDTH as u32, HEIGHT as u32, codes.collect()).unwrap()
        };
        let (rays, response) = (Rays::new(&Geometry::pinhole(WIDTH as u32, HEIGHT as u32, 80.0)), Response::default());
        let (own, theirs) = (picture(40), picture(voters_code));
        let looks = Looks::new(&own, &response);
        let looks: Vec<_> = (0..WIDTH * HEIGHT).map(|i| looks.at((i % WIDTH) as u32, (i / WIDTH) as u32)).collect();
        let maps: Vec<DepthMap> = ends.iter().map(|end| map(*end)).collect();
        let voter = |depth| Voter {
            depth,
            measured: Pose::IDENTITY,
            taken: Pose::IDENTITY,
            looks: Looks::new(&theirs, &response),
        };
        let voters: Vec<_> = maps.iter().map(voter).collect();
        let mut depth_m = map(own_end).depth_m;
        let part = Rect::full(WIDTH as u32, HEIGHT as u32);
        Own { rays: &rays, pose: Pose::IDENTITY, part, looks: &looks }.agreed(&mut depth_m, &voters);
        depth_m
    }

    #[test]
    fn several_maps_say_where_a_thing_ends() {
        // Doubtful is 1 px at this size.
        let depth_m = agreed(60, &[60, 61, 60, 60], 40);
        assert!(
            (0..WIDTH).all(|x| (depth_m[20 * WIDTH + x] < 1.5) == (30..60).contains(&x)),
            "{:?}",
            &depth_m[..WIDTH]
        );
        let torn = agreed(59, &[60, 60, 60, 60], 40);
        assert!((0..WIDTH).all(|x| (torn[20 * WIDTH + x] < 1.5) == (30..60).contains(&x)), "{:?}", &torn[..WIDTH]);
    }

    #[test]
    fn what_looks_otherwise_has_no_vote() {
        // They saw something bright where the frame shows something dark.
        assert!(agreed(59, &[60, 60, 60, 60], 150) == agreed(59, &[], 40));
        // And nobody is asked away from edges and holes.
        let far_off = agreed(60, &[80, 80, 80, 80], 40);
        assert!((62..WIDTH).all(|x| far_off[20 * WIDTH + x] == 2.0), "{:?}", &far_off[..WIDTH]);
    }
}
