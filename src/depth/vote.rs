//! What several frames say of a part of a frame's depth.
//!
//! One sensor's map is torn at its edges, by pixels and differently in each frame, and of dark things it sees a few places,
//! others each time. So where a frame's own map is doubtful, near its edges and where it has none, the maps of its
//! neighbours vote: each point is carried to the frame by the poses. Of the depths that a pixel is told, the one wins on
//! which most agree.
//!
//! Things move. A neighbour's point counts only if it has the colour that the frame shows there, in light that is made alike:
//! cameras change their exposure and white balance from frame to frame. And where the frame's own map is not doubtful,
//! no other map votes.
//!
//! Not modelled: points that look alike and move; lenses that change from frame to frame.

use std::sync::Mutex;

use super::Rays;
use super::discontinuity::{JUMP, is_step};
use super::moment::BEYOND_PX;
use super::reprojection::{LANES, Over, Points, Reprojection, Tile};
use super::requested::{NOT_REQUESTED, RequestedPixels, gain};
use super::sqrt_colors::SqrtColors;
use crate::parallel::{over_rows, processors};
use crate::pixels::{DepthMap, Rect};
use crate::pose::Pose;

/// Within this share of the picture's width of an edge or a hole a map is doubtful: as far as it may be off.
const DOUBTFUL: f64 = super::edges::MOST_OFF;
/// What lies between the corners of a tile of points lands between them, but for this, px: a lens bends.
const BENT_PX: i32 = 2;
/// Doubtful pixels that a thread works on at a time.
const PIXELS_PER_BLOCK: usize = 256;
/// Pixel stride of the colour samples that estimate a voter's gain.
const EVERY: i32 = 8;
/// Depths on which voters agree differ by less than this factor.
const AGREE: f32 = 1.0 + 0.5 * (JUMP - 1.0);
/// What is agreed upon is sure where at least so many are heard, the frame's own map included, and this share of them agrees.
const FEWEST_HEARD: usize = 4;
const SURE: f32 = 0.8;

/// A neighbouring frame.
pub struct Voter<'a> {
    pub depth: &'a DepthMap,
    /// The poses at which its map was measured and its picture was taken.
    pub measured: Pose,
    pub taken: Pose,
    /// Its picture's.
    pub sqrt_colors: SqrtColors<'a>,
}

/// The frame whose depth is doubtful.
pub struct TargetView<'a> {
    pub rays: &'a Rays,
    /// At which its picture was taken.
    pub pose: Pose,
    /// The part of its picture that is looked at.
    pub part: Rect,
    /// Square roots of the part's light, row by row.
    pub sqrt_colors: &'a [[f32; 3]],
    /// Up to which depth each of its pixels matters, metres.
    pub max_depth_m: &'a [f32],
}

impl TargetView<'_> {
    /// Replaces what is doubtful of the part's `depth_m` (0 where unknown) by what most say. Which pixels are sure because
    /// nearly all say the same; those that are not doubtful are not requested.
    pub fn agreed(&self, depth_m: &mut [f32], voters: &[Voter<'_>]) -> Vec<bool> {
        let mut is_sure = vec![false; depth_m.len()];
        if voters.is_empty() || depth_m.is_empty() {
            return is_sure;
        }
        let width = self.part.width() as usize;
        let reach_px = (DOUBTFUL * f64::from(self.rays.geometry().intrinsics.width_px)).round() as usize;
        let doubtful = doubtful(depth_m, width, reach_px, self.max_depth_m);
        let requested = RequestedPixels::new(&doubtful, self.sqrt_colors, width);
        if requested.places.is_empty() {
            return is_sure;
        }
        let source = self.part.grown(BEYOND_PX).intersection(&self.rays.full());
        if source.is_empty() {
            return is_sure;
        }
        let rows = tiles(source, self.rays.full()).fold(source, |all, tile| all.union(&tile));
        self.rays.prepare(rows.y0..rows.y1);
        let mut told: Vec<Vec<f32>> = vec![Vec::new(); voters.len()];
        let work = Mutex::new(told.iter_mut().zip(voters));
        std::thread::scope(|scope| {
            let work_off = || {
                while let Some((told, voter)) = work.lock().ok().and_then(|mut work| work.next()) {
                    *told = self.carried(voter, source, &requested);
                }
            };
            for _ in 1..processors().min(voters.len()) {
                let _ = std::thread::Builder::new().spawn_scoped(scope, work_off);
            }
            work_off();
        });
        let mut agreed = vec![(0.0, false); requested.places.len()];
        over_rows(&mut agreed, PIXELS_PER_BLOCK, processors(), |block, of_block| {
            let mut heard = Vec::with_capacity(voters.len() + 1);
            for (n, agreed) in (block * PIXELS_PER_BLOCK..).zip(of_block) {
                heard.clear();
                heard.push(depth_m[requested.places[n] as usize]);
                heard.extend(told.iter().map(|told| told[n]));
                *agreed = most(&mut heard);
            }
        });
        for (i, agreed) in requested.places.iter().zip(agreed) {
            (depth_m[*i as usize], is_sure[*i as usize]) = agreed;
        }
        is_sure
    }

    /// A voter's depth at each pixel that is asked for, m; negative where it looks otherwise than the frame does, 0 where it says
    /// nothing.
    fn carried(&self, voter: &Voter<'_>, source: Rect, requested: &RequestedPixels) -> Vec<f32> {
        let mut out = vec![0.0f32; requested.places.len()];
        let (geometry, full) = (self.rays.geometry(), self.rays.full());
        if (voter.depth.width, voter.depth.height) != (full.width(), full.height()) || voter.sqrt_colors.size() != full
        {
            return out;
        }
        let [here, there] = [&self.pose, &voter.taken].map(|pose| Reprojection::new(geometry, &voter.measured, pose));
        let gain = gain(&self.compared(voter, source, &here, &there));
        for rect in tiles(source, full) {
            let ray = |x: i32, y: i32| Some(self.rays.row(y as usize)?[x as usize]);
            let Some(tile) = Tile::of(rect, voter.depth, ray) else { continue };
            // Whether its points may land where the frame is doubtful.
            let here = Over::new(&tile, &here);
            let is_asked = here.around(BENT_PX).is_none_or(|around| {
                requested.within(around.intersection(&self.part).moved(-self.part.x0, -self.part.y0))
            });
            if !is_asked {
                continue;
            }
            let there = Over::new(&tile, &there);
            for y in rect.y0..rect.y1 {
                let Some(rays) = self.rays.row(y as usize) else { continue };
                let landed = here.reproject(voter.depth, y, rays);
                // The pixel in which each lies, and no more: points that covered the pixels around would widen what is near. What
                // one voter leaves open others fill.
                let at = landed.pixels(self.part).map(|place| requested.ranks[place]);
                if at == [NOT_REQUESTED; LANES] {
                    continue;
                }
                let shown = there.reproject(voter.depth, y, rays).pixels(full);
                for lane in (0..LANES).filter(|&lane| at[lane] != NOT_REQUESTED) {
                    let (n, z) = (at[lane] as usize, landed.depth_m[lane]);
                    // Of several points at a pixel the nearest stays.
                    if (out[n] == 0.0 || z < out[n].abs())
                        && let Some(sqrt_colors) = voter.sqrt_colors.nth(shown[lane])
                    {
                        out[n] = if requested.shows(n, [0, 1, 2].map(|c| gain[c] * sqrt_colors[c])) { z } else { -z };
                    }
                }
            }
        }
        out
    }

    /// Colours of the frame and of a voter that show the same, at places spread over the picture.
    fn compared(
        &self,
        voter: &Voter<'_>,
        source: Rect,
        here: &Reprojection<'_>,
        there: &Reprojection<'_>,
    ) -> Vec<([f32; 3], [f32; 3])> {
        let (mut compared, full) = (Vec::new(), self.rays.full());
        for y in (source.y0..source.y1).filter(|y| y % EVERY == 0) {
            let Some(rays) = self.rays.row(y as usize) else { continue };
            let row = &voter.depth.depth_m[y as usize * voter.depth.width as usize..];
            let places: Vec<usize> = (source.x0..source.x1).filter(|x| x % EVERY == 0).map(|x| x as usize).collect();
            for places in places.chunks(LANES) {
                let mut points = Points::default();
                places.iter().enumerate().for_each(|(lane, &x)| points.set(lane, row[x], rays[x]));
                let (landed, shown) =
                    (here.reproject(&points).pixels(self.part), there.reproject(&points).pixels(full));
                let both = landed.into_iter().zip(shown);
                compared.extend(
                    both.filter_map(|(own, theirs)| {
                        self.sqrt_colors.get(own).copied().zip(voter.sqrt_colors.nth(theirs))
                    }),
                );
            }
        }
        compared
    }
}

/// The tiles of the picture that a part of it touches. They are the same ones whichever part it is.
fn tiles(part: Rect, full: Rect) -> impl Iterator<Item = Rect> {
    let side = LANES as i32;
    let first = move |edge: i32| edge.div_euclid(side) * side;
    (first(part.y0)..part.y1).step_by(LANES).flat_map(move |y| {
        (first(part.x0)..part.x1).step_by(LANES).map(move |x| Rect::new(x, y, x + side, y + side).intersection(&full))
    })
}

/// What most agree on, the nearest of what as many do, and whether it is sure. The frame's own value comes first, and stays where
/// it is among them.
fn most(heard: &mut Vec<f32>) -> (f32, bool) {
    let own = heard[0];
    heard.retain(|z| *z > 0.0);
    let all = heard.len();
    let is_sure = |agree: usize| all >= FEWEST_HEARD && agree as f32 >= SURE * all as f32;
    // Mostly all agree.
    if own > 0.0 && heard.iter().all(|other| *other < AGREE * own && own < AGREE * other) {
        return (own, is_sure(heard.len()));
    }
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
        Some(_) if agreed.contains(&own) => (own, is_sure(best)),
        Some(median) => (*median, is_sure(best)),
        None => (0.0, false),
    }
}

/// Where a map is unknown or has an edge that matters, and around.
fn doubtful(depth_m: &[f32], width: usize, reach_px: usize, max_depth_m: &[f32]) -> Vec<bool> {
    let height = depth_m.len() / width;
    // Whether pixels and those beside them belong to two surfaces, a whole row of them at a time: vectors.
    let mark = |torn: &mut [u8], [a, a_before]: [&[f32]; 2], [b, b_before]: [&[f32]; 2]| {
        let before = a_before.iter().zip(b_before).map(|(a, b)| a.max(*b));
        for (((torn, a), b), before) in torn.iter_mut().zip(a).zip(b).zip(before) {
            let near = a.min(*b);
            *torn |= u8::from((near < before) & ((near <= 0.0) | is_step(*a, *b)));
        }
    };
    // Along rows, then all rows' sums at once downwards.
    let mut along = vec![0u8; depth_m.len()];
    over_rows(&mut along, width, processors(), |y, along| {
        let row = |y: usize| [depth_m, max_depth_m].map(|of| &of[y * width..(y + 1) * width]);
        let (own, mut torn) = (row(y), vec![0u8; width]);
        let (left, right) = (own.map(|of| &of[..width - 1]), own.map(|of| &of[1..]));
        mark(&mut torn[..width - 1], left, right);
        mark(&mut torn[1..], right, left);
        [y.wrapping_sub(1), y + 1].into_iter().filter(|y| *y < height).for_each(|y| mark(&mut torn, own, row(y)));
        if torn.contains(&1) {
            let mut sum: u32 = torn.iter().take(reach_px).map(|n| u32::from(*n)).sum();
            for x in 0..width {
                sum += torn.get(x + reach_px).map_or(0, |n| u32::from(*n));
                along[x] = u8::from(sum > 0);
                sum -= if x >= reach_px { u32::from(torn[x - reach_px]) } else { 0 };
            }
        }
    });
    let mut sums = vec![0u16; width];
    let mut out = vec![false; depth_m.len()];
    let row = |y: usize| &along[y * width..][..width];
    (0..reach_px.min(height)).for_each(|y| sums.iter_mut().zip(row(y)).for_each(|(sum, n)| *sum += u16::from(*n)));
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        if y + reach_px < height {
            sums.iter_mut().zip(row(y + reach_px)).for_each(|(sum, n)| *sum += u16::from(*n));
        }
        let matters = max_depth_m[y * width..].iter().map(|max_depth_m| *max_depth_m > 0.0);
        out.iter_mut().zip(sums.iter().zip(matters)).for_each(|(out, (sum, matters))| *out = *sum > 0 && matters);
        if y >= reach_px {
            sums.iter_mut().zip(row(y - reach_px)).for_each(|(sum, n)| *sum -= u16::from(*n));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics, Response};
    use crate::pixels::Pixels;
    use glam::{DQuat, DVec3};

    const WIDTH: usize = 96;
    const HEIGHT: usize = 64;

    #[test]
    fn most_by_hand() {
        let most = |heard: &[f32]| super::most(&mut heard.to_vec());
        assert_eq!(most(&[2.0, 1.0, 1.01, 0.0]), (1.01, false));
        // The frame's own stays where it is one of them.
        assert_eq!(most(&[1.005, 1.0, 1.01, 2.0]), (1.005, false));
        // As many: the nearer.
        assert_eq!(most(&[2.0, 1.0]), (1.0, false));
        // What looks otherwise is told as negative.
        assert_eq!(most(&[2.0, -1.0, -1.0]), (2.0, false));
        assert_eq!(most(&[0.0, -1.0]), (0.0, false));
        // Four of five, and all of four; three are too few.
        assert_eq!(most(&[2.0, 1.0, 1.0, 1.0, 1.0]), (1.0, true));
        assert_eq!(most(&[1.0, 0.0, 1.0, 1.0, 1.0]), (1.0, true));
        assert_eq!(most(&[0.0, 0.0, 1.0, 1.0, 1.0]), (1.0, false));
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
        let sqrt_colors = SqrtColors::new(&own, &response);
        let sqrt_colors: Vec<_> =
            (0..WIDTH * HEIGHT).map(|i| sqrt_colors.at((i % WIDTH) as u32, (i / WIDTH) as u32)).collect();
        let maps: Vec<DepthMap> = ends.iter().map(|end| map(*end)).collect();
        let voter = |depth| Voter {
            depth,
            measured: Pose::IDENTITY,
            taken: Pose::IDENTITY,
            sqrt_colors: SqrtColors::new(&theirs, &response),
        };
        let voters: Vec<_> = maps.iter().map(voter).collect();
        let mut depth_m = map(own_end).depth_m;
        let part = Rect::full(WIDTH as u32, HEIGHT as u32);
        TargetView {
            rays: &rays,
            pose: Pose::IDENTITY,
            part,
            sqrt_colors: &sqrt_colors,
            max_depth_m: &[9.0; WIDTH * HEIGHT],
        }
        .agreed(&mut depth_m, &voters);
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
    fn tiles_that_are_left_out_would_have_said_nothing() {
        // A bent wall with a hole, seen by a camera that moved and turned, through a lens that bends.
        let k = Distortion { k1: 0.26, k2: -0.9, p1: -0.005, p2: 0.003, k3: 1.1, ..Distortion::default() };
        let i = Intrinsics {
            width_px: 96,
            height_px: 64,
            fx_px: 80.0,
            fy_px: 80.0,
            cx_px: 48.0,
            cy_px: 32.0,
            ..Intrinsics::default()
        };
        let (geometry, response) = (Geometry::new(i, k), Response::default());
        let bent = |i: usize| 1.0 + 0.01 * (i % WIDTH) as f32 + if i % 41 < 5 { 0.4 } else { 0.0 };
        let depth_m = (0..WIDTH * HEIGHT).map(|i| if i % 97 < 20 { 0.0 } else { bent(i) }).collect();
        let depth = DepthMap { width: WIDTH as u32, height: HEIGHT as u32, depth_m, timestamp_s: 0.0 };
        let codes = (0..3 * WIDTH * HEIGHT).map(|i| (40 + i * 7 % 160) as u8).collect();
        let pixels = Pixels::from_u8(WIDTH as u32, HEIGHT as u32, codes).unwrap();
        let rays = Rays::new(&geometry);
        rays.prepare(0..HEIGHT as i32);
        let at =
            |x: f64, turn: f64| Pose::from_camera_in_world(DVec3::new(x, 0.02, 0.05), DQuat::from_rotation_z(turn));
        let voter = Voter {
            depth: &depth,
            measured: at(0.0, 0.0),
            taken: at(0.01, 0.02),
            sqrt_colors: SqrtColors::new(&pixels, &response),
        };
        let sqrt_colors = vec![[0.5; 3]; WIDTH * HEIGHT];
        let whole = Rect::full(WIDTH as u32, HEIGHT as u32);
        let own = TargetView {
            rays: &rays,
            pose: at(0.06, -0.1),
            part: whole,
            sqrt_colors: &sqrt_colors,
            max_depth_m: &[9.0; WIDTH * HEIGHT],
        };
        let requested = |doubtful: &dyn Fn(usize) -> bool| {
            let doubtful: Vec<bool> = (0..WIDTH * HEIGHT).map(doubtful).collect();
            RequestedPixels::new(&doubtful, &sqrt_colors, WIDTH)
        };
        let all = own.carried(&voter, whole, &requested(&|_| true));
        assert!(all.iter().filter(|z| **z != 0.0).count() > 2000);
        for (x0, y0) in [(0, 0), (20, 30), (50, 10), (88, 60), (33, 47)] {
            let inside = move |i: usize| (x0..x0 + 8).contains(&(i % WIDTH)) && (y0..y0 + 5).contains(&(i / WIDTH));
            let some = own.carried(&voter, whole, &requested(&inside));
            let of_all: Vec<f32> = (0..all.len()).filter(|i| inside(*i)).map(|i| all[i]).collect();
            assert_eq!(some, of_all, "{x0} {y0}");
        }
        // A part of the picture, also one that goes on beyond it, is told the same depths.
        for part in [Rect::new(-7, 5, 60, 50), Rect::new(30, 20, 110, 70)] {
            let of_part = vec![[0.5; 3]; part.width() as usize * part.height() as usize];
            let own = TargetView { part, sqrt_colors: &of_part, ..own };
            let everywhere = RequestedPixels::new(&vec![true; of_part.len()], &of_part, part.width() as usize);
            let found = own.carried(&voter, whole, &everywhere);
            for (n, z) in found.iter().enumerate() {
                let (x, y) = (part.x0 + n as i32 % part.width() as i32, part.y0 + n as i32 / part.width() as i32);
                if whole.contains(x, y) {
                    assert_eq!(z.abs(), all[y as usize * WIDTH + x as usize].abs(), "{part:?} {x} {y}");
                }
            }
        }
    }

    #[test]
    fn what_is_doubtful_lies_near_what_is_torn() {
        for (width, height) in [(31, 23), (1, 40), (40, 1)] {
            let depth_m: Vec<f32> =
                (0..width * height).map(|i| [1.0, 1.02, 1.1, 0.0, 2.0][(i * 7 / 23 + i % width / 11) % 5]).collect();
            let max_depth_m: Vec<f32> = (0..width * height).map(|i| [0.0, 1.5, 9.0][i / 5 % 3]).collect();
            let place = |i: usize| (i % width, i / width);
            let is_torn = |a: usize, b: usize| {
                let (near, far) = (depth_m[a].min(depth_m[b]), depth_m[a].max(depth_m[b]));
                near < max_depth_m[a].max(max_depth_m[b]) && (near <= 0.0 || far > JUMP * near)
            };
            let all = 0..width * height;
            let step = |a: usize, b: usize| {
                let ((ax, ay), (bx, by)) = (place(a), place(b));
                ax.abs_diff(bx) + ay.abs_diff(by)
            };
            let torn: Vec<usize> =
                all.clone().filter(|a| all.clone().any(|b| step(*a, b) == 1 && is_torn(*a, b))).collect();
            for reach in [0, 1, 4, 60] {
                let near = |a: usize, b: usize| {
                    let ((ax, ay), (bx, by)) = (place(a), place(b));
                    ax.abs_diff(bx) <= reach && ay.abs_diff(by) <= reach
                };
                let expected: Vec<bool> =
                    all.clone().map(|a| max_depth_m[a] > 0.0 && torn.iter().any(|b| near(a, *b))).collect();
                assert_eq!(doubtful(&depth_m, width, reach, &max_depth_m), expected, "{width} {height} {reach}");
            }
        }
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
