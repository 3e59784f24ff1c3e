//! Consensus depth of several frames in a part of a frame.
//!
//! A sensor's map is ragged at its edges, by pixels and differently in each frame. It has few
//! pixels of dark objects, different ones in each frame. Near the edges and in the holes of a
//! frame's own map, the maps of its neighbours are therefore reprojected by the poses. The depth
//! with the most samples in agreement wins.
//!
//! Objects may have moved. A neighbour's sample counts only if it has the colour of the frame
//! there, after a gain correction: exposure and white balance change from frame to frame. Where the
//! frame's own map is reliable it is not changed.
//!
//! Not modelled: moving points of the same colour; lenses that change from frame to frame.

use super::Rays;
use super::discontinuity::{DEPTH_STEP, is_step};
use super::moment::SOURCE_MARGIN_PX;
use super::reprojection::{LANES, PointBatch, ReprojectedTile, Reprojection, TileReprojection};
use super::requested::{NOT_REQUESTED, RequestedPixels, color_gain};
use super::sqrt_colors::SqrtColors;
use crate::parallel::{over_items, over_rows, processors};
use crate::pixels::{DepthMap, Rect};
use crate::pose::Pose;

/// Distance from an edge or a hole within which a map is unreliable, as a fraction of the picture's
/// width.
const UNRELIABLE_RANGE: f64 = super::edges::MAX_EDGE_OFFSET;
/// Margin of the bounding box of a tile's reprojected corners, for lens distortion, px.
const DISTORTION_MARGIN_PX: i32 = 2;
/// Unreliable pixels that a thread works on at a time.
const PIXELS_PER_BLOCK: usize = 256;
/// Pixel stride of the colour samples that estimate a voter's gain.
const COLOR_STRIDE_PX: i32 = 8;
/// Depths in agreement differ by less than this factor.
const AGREEMENT_RATIO: f32 = 1.0 + 0.5 * (DEPTH_STEP - 1.0);
/// Minimum number of samples for a consensus depth to count as reliable, with the frame's own.
const MIN_CONSENSUS_SAMPLES: usize = 4;
/// Minimum fraction of samples in agreement for a consensus depth to count as reliable.
const MIN_CONSENSUS_FRACTION: f32 = 0.8;

/// A neighbouring frame that votes.
pub struct VotingFrame<'a> {
    pub depth: &'a DepthMap,
    /// The poses at which its map was measured and its picture was taken.
    pub map_pose: Pose,
    pub picture_pose: Pose,
    /// The colours of its picture.
    pub sqrt_colors: SqrtColors<'a>,
}

/// The frame whose depth is repaired.
pub struct TargetView<'a> {
    pub rays: &'a Rays,
    /// The pose at which its picture was taken.
    pub pose: Pose,
    /// The part of its picture that is repaired.
    pub part: Rect,
    /// Square roots of the part's light, row by row.
    pub sqrt_colors: &'a [[f32; 3]],
    /// The depth up to which each of its pixels is relevant, m.
    pub max_depth_m: &'a [f32],
}

impl TargetView<'_> {
    /// Replaces unreliable depth of the part (0 where unknown) by the consensus. Returns the mask
    /// of pixels with a reliable consensus.
    pub fn apply_consensus(&self, depth_m: &mut [f32], voters: &[VotingFrame<'_>]) -> Vec<bool> {
        let mut is_reliable = vec![false; depth_m.len()];
        if voters.is_empty() || depth_m.is_empty() {
            return is_reliable;
        }
        let width = self.part.width() as usize;
        let reach_px = (UNRELIABLE_RANGE * f64::from(self.rays.geometry().intrinsics.width_px)).round() as usize;
        let is_unreliable = unreliable_pixels(depth_m, width, reach_px, self.max_depth_m);
        let requested = RequestedPixels::new(&is_unreliable, self.sqrt_colors, width);
        if requested.places.is_empty() {
            return is_reliable;
        }
        let source = self.part.grown(SOURCE_MARGIN_PX).intersection(&self.rays.full());
        if source.is_empty() {
            return is_reliable;
        }
        let rows = tiles(source, self.rays.full()).fold(source, |all, tile| all.union(&tile));
        self.rays.prepare(rows.y0..rows.y1);
        let mut votes: Vec<Vec<f32>> = vec![Vec::new(); voters.len()];
        over_items(votes.iter_mut().zip(voters).collect(), processors(), |(votes, voter)| {
            *votes = self.reprojected_depth(voter, source, &requested);
        });
        let mut winner = vec![(0.0, false); requested.places.len()];
        over_rows(&mut winner, PIXELS_PER_BLOCK, processors(), |block, of_block| {
            let mut samples = Vec::with_capacity(voters.len() + 1);
            for (n, winner) in (block * PIXELS_PER_BLOCK..).zip(of_block) {
                samples.clear();
                samples.push(depth_m[requested.places[n] as usize]);
                samples.extend(votes.iter().map(|votes| votes[n]));
                *winner = consensus(&mut samples);
            }
        });
        for (i, winner) in requested.places.iter().zip(winner) {
            (depth_m[*i as usize], is_reliable[*i as usize]) = winner;
        }
        is_reliable
    }

    /// A voter's depth at each requested pixel, m; negative where its colour differs from the
    /// frame's, 0 where it is unknown.
    fn reprojected_depth(&self, voter: &VotingFrame<'_>, source: Rect, requested: &RequestedPixels) -> Vec<f32> {
        let mut out = vec![0.0f32; requested.places.len()];
        let geometry = self.rays.geometry();
        let full = self.rays.full();
        if (voter.depth.width, voter.depth.height) != (full.width(), full.height()) || voter.sqrt_colors.full() != full
        {
            return out;
        }
        let [here, there] =
            [&self.pose, &voter.picture_pose].map(|pose| Reprojection::new(geometry, &voter.map_pose, pose));
        let gain = color_gain(&self.voter_color_pairs(voter, source, &here, &there));
        for rect in tiles(source, full) {
            let ray = |x: i32, y: i32| Some(self.rays.row(y as usize)?[x as usize]);
            let Some(tile) = ReprojectedTile::of(rect, voter.depth, ray) else { continue };
            // Skips tiles that do not reproject to any requested pixel.
            let here = TileReprojection::new(&tile, &here);
            let is_requested = here.bounds(DISTORTION_MARGIN_PX).is_none_or(|bounds| {
                requested.any_in(bounds.intersection(&self.part).moved(-self.part.x0, -self.part.y0))
            });
            if !is_requested {
                continue;
            }
            let there = TileReprojection::new(&tile, &there);
            for y in rect.y0..rect.y1 {
                let Some(rays) = self.rays.row(y as usize) else { continue };
                let reprojected = here.reproject(voter.depth, y, rays);
                // Each point covers its own pixel alone. Larger splats would dilate near surfaces,
                // and other voters fill the holes.
                let at = reprojected.pixels(self.part).map(|place| requested.ranks[place]);
                if at == [NOT_REQUESTED; LANES] {
                    continue;
                }
                let voter_pixels = there.reproject(voter.depth, y, rays).pixels(full);
                for lane in (0..LANES).filter(|&lane| at[lane] != NOT_REQUESTED) {
                    let (n, z) = (at[lane] as usize, reprojected.depth_m[lane]);
                    // The nearest of several points at a pixel wins.
                    if (out[n] == 0.0 || z < out[n].abs())
                        && let Some(sqrt_color) = voter.sqrt_colors.nth(voter_pixels[lane])
                    {
                        out[n] = if requested.has_color_near(n, [0, 1, 2].map(|c| gain[c] * sqrt_color[c])) {
                            z
                        } else {
                            -z
                        };
                    }
                }
            }
        }
        out
    }

    /// Pairs of the frame's colour and a voter's at the same points, on a grid over the picture.
    fn voter_color_pairs(
        &self,
        voter: &VotingFrame<'_>,
        source: Rect,
        here: &Reprojection<'_>,
        there: &Reprojection<'_>,
    ) -> Vec<([f32; 3], [f32; 3])> {
        let mut pairs = Vec::new();
        let full = self.rays.full();
        for y in (source.y0..source.y1).filter(|y| y % COLOR_STRIDE_PX == 0) {
            let Some(rays) = self.rays.row(y as usize) else { continue };
            let row = &voter.depth.depth_m[y as usize * voter.depth.width as usize..];
            let places: Vec<usize> =
                (source.x0..source.x1).filter(|x| x % COLOR_STRIDE_PX == 0).map(|x| x as usize).collect();
            for places in places.chunks(LANES) {
                let mut points = PointBatch::default();
                places.iter().enumerate().for_each(|(lane, &x)| points.set(lane, row[x], rays[x]));
                let (reprojected, voter_pixels) =
                    (here.reproject(&points).pixels(self.part), there.reproject(&points).pixels(full));
                let both = reprojected.into_iter().zip(voter_pixels);
                pairs.extend(
                    both.filter_map(|(own, theirs)| {
                        self.sqrt_colors.get(own).copied().zip(voter.sqrt_colors.nth(theirs))
                    }),
                );
            }
        }
        pairs
    }
}

/// The tiles of the picture that overlap a part of it. Their grid does not depend on the part.
fn tiles(part: Rect, full: Rect) -> impl Iterator<Item = Rect> {
    let side = LANES as i32;
    let first = move |edge: i32| edge.div_euclid(side) * side;
    (first(part.y0)..part.y1).step_by(LANES).flat_map(move |y| {
        (first(part.x0)..part.x1).step_by(LANES).map(move |x| Rect::new(x, y, x + side, y + side).intersection(&full))
    })
}

/// The depth with the most samples in agreement, the nearest of several such depths, and whether it
/// is reliable. The first sample is the frame's own, and is returned if it is among them.
fn consensus(samples: &mut Vec<f32>) -> (f32, bool) {
    let own = samples[0];
    samples.retain(|z| *z > 0.0);
    let all = samples.len();
    let is_reliable = |in_agreement: usize| {
        all >= MIN_CONSENSUS_SAMPLES && in_agreement as f32 >= MIN_CONSENSUS_FRACTION * all as f32
    };
    // Fast path: all agree.
    if own > 0.0 && samples.iter().all(|other| *other < AGREEMENT_RATIO * own && own < AGREEMENT_RATIO * other) {
        return (own, is_reliable(samples.len()));
    }
    samples.sort_unstable_by(f32::total_cmp);
    let (mut best, mut from) = (0, 0);
    for (n, nearest) in samples.iter().enumerate() {
        let in_agreement = samples[n..].partition_point(|z| *z < AGREEMENT_RATIO * nearest);
        if in_agreement > best {
            (best, from) = (in_agreement, n);
        }
    }
    let winner = &samples[from..from + best];
    match winner.get(best / 2) {
        Some(_) if winner.contains(&own) => (own, is_reliable(best)),
        Some(median) => (*median, is_reliable(best)),
        None => (0.0, false),
    }
}

/// Mask of unreliable pixels: those within `reach_px` of a hole or of a relevant edge.
fn unreliable_pixels(depth_m: &[f32], width: usize, reach_px: usize, max_depth_m: &[f32]) -> Vec<bool> {
    let height = depth_m.len() / width;
    // Marks pixels that belong to another surface than their neighbours, a whole row at a time, as
    // vectors.
    let mark = |is_edge: &mut [u8], [a, a_before]: [&[f32]; 2], [b, b_before]: [&[f32]; 2]| {
        let before = a_before.iter().zip(b_before).map(|(a, b)| a.max(*b));
        for (((is_edge, a), b), before) in is_edge.iter_mut().zip(a).zip(b).zip(before) {
            let near = a.min(*b);
            *is_edge |= u8::from((near < before) & ((near <= 0.0) | is_step(*a, *b)));
        }
    };
    // A dilation along rows, then along all columns at once.
    let mut along = vec![0u8; depth_m.len()];
    over_rows(&mut along, width, processors(), |y, along| {
        let row = |y: usize| [depth_m, max_depth_m].map(|of| &of[y * width..(y + 1) * width]);
        let rows = row(y);
        let mut is_edge = vec![0u8; width];
        let (left, right) = (rows.map(|of| &of[..width - 1]), rows.map(|of| &of[1..]));
        mark(&mut is_edge[..width - 1], left, right);
        mark(&mut is_edge[1..], right, left);
        [y.wrapping_sub(1), y + 1].into_iter().filter(|y| *y < height).for_each(|y| mark(&mut is_edge, rows, row(y)));
        if is_edge.contains(&1) {
            let mut sum: u32 = is_edge.iter().take(reach_px).map(|n| u32::from(*n)).sum();
            for x in 0..width {
                sum += is_edge.get(x + reach_px).map_or(0, |n| u32::from(*n));
                along[x] = u8::from(sum > 0);
                sum -= if x >= reach_px { u32::from(is_edge[x - reach_px]) } else { 0 };
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
    fn consensus_matches_examples_by_hand() {
        let consensus = |samples: &[f32]| super::consensus(&mut samples.to_vec());
        assert_eq!(consensus(&[2.0, 1.0, 1.01, 0.0]), (1.01, false));
        // The frame's own sample is preferred among them.
        assert_eq!(consensus(&[1.005, 1.0, 1.01, 2.0]), (1.005, false));
        // The nearer one of equally many.
        assert_eq!(consensus(&[2.0, 1.0]), (1.0, false));
        // Samples of another colour are negative.
        assert_eq!(consensus(&[2.0, -1.0, -1.0]), (2.0, false));
        assert_eq!(consensus(&[0.0, -1.0]), (0.0, false));
        // Reliable: four of five, and all of four. Three are too few.
        assert_eq!(consensus(&[2.0, 1.0, 1.0, 1.0, 1.0]), (1.0, true));
        assert_eq!(consensus(&[1.0, 0.0, 1.0, 1.0, 1.0]), (1.0, true));
        assert_eq!(consensus(&[0.0, 0.0, 1.0, 1.0, 1.0]), (1.0, false));
    }

    /// Consensus for a dark object at 1 m, columns 30 to 59, in front of a wall at 2 m that is
    /// bright from column 64 on. In each map the object ends at another column.
    fn consensus_depth(own_end: usize, ends: &[usize], voters_code: u8) -> Vec<f32> {
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
        let voter = |depth| VotingFrame {
            depth,
            map_pose: Pose::IDENTITY,
            picture_pose: Pose::IDENTITY,
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
        .apply_consensus(&mut depth_m, &voters);
        depth_m
    }

    #[test]
    fn edge_is_where_most_maps_have_it() {
        // The unreliable range is 1 px at this size.
        let depth_m = consensus_depth(60, &[60, 61, 60, 60], 40);
        assert!(
            (0..WIDTH).all(|x| (depth_m[20 * WIDTH + x] < 1.5) == (30..60).contains(&x)),
            "{:?}",
            &depth_m[..WIDTH]
        );
        let is_edge = consensus_depth(59, &[60, 60, 60, 60], 40);
        assert!(
            (0..WIDTH).all(|x| (is_edge[20 * WIDTH + x] < 1.5) == (30..60).contains(&x)),
            "{:?}",
            &is_edge[..WIDTH]
        );
    }

    #[test]
    fn skipping_tiles_does_not_change_the_reprojected_depth() {
        // A curved wall with holes, a camera that moved and turned, and a lens with distortion.
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
        let voter = VotingFrame {
            depth: &depth,
            map_pose: at(0.0, 0.0),
            picture_pose: at(0.01, 0.02),
            sqrt_colors: SqrtColors::new(&pixels, &response),
        };
        let sqrt_colors = vec![[0.5; 3]; WIDTH * HEIGHT];
        let whole = Rect::full(WIDTH as u32, HEIGHT as u32);
        let target = TargetView {
            rays: &rays,
            pose: at(0.06, -0.1),
            part: whole,
            sqrt_colors: &sqrt_colors,
            max_depth_m: &[9.0; WIDTH * HEIGHT],
        };
        let requested = |is_unreliable: &dyn Fn(usize) -> bool| {
            let is_unreliable: Vec<bool> = (0..WIDTH * HEIGHT).map(is_unreliable).collect();
            RequestedPixels::new(&is_unreliable, &sqrt_colors, WIDTH)
        };
        let all = target.reprojected_depth(&voter, whole, &requested(&|_| true));
        assert!(all.iter().filter(|z| **z != 0.0).count() > 2000);
        for (x0, y0) in [(0, 0), (20, 30), (50, 10), (88, 60), (33, 47)] {
            let is_inside = move |i: usize| (x0..x0 + 8).contains(&(i % WIDTH)) && (y0..y0 + 5).contains(&(i / WIDTH));
            let some = target.reprojected_depth(&voter, whole, &requested(&is_inside));
            let of_all: Vec<f32> = (0..all.len()).filter(|i| is_inside(*i)).map(|i| all[i]).collect();
            assert_eq!(some, of_all, "{x0} {y0}");
        }
        // Parts of the picture have the same depths, also parts that extend beyond it.
        for part in [Rect::new(-7, 5, 60, 50), Rect::new(30, 20, 110, 70)] {
            let of_part = vec![[0.5; 3]; part.width() as usize * part.height() as usize];
            let target = TargetView { part, sqrt_colors: &of_part, ..target };
            let everywhere = RequestedPixels::new(&vec![true; of_part.len()], &of_part, part.width() as usize);
            let reprojected = target.reprojected_depth(&voter, whole, &everywhere);
            for (n, z) in reprojected.iter().enumerate() {
                let (x, y) = (part.x0 + n as i32 % part.width() as i32, part.y0 + n as i32 / part.width() as i32);
                if whole.contains(x, y) {
                    assert_eq!(z.abs(), all[y as usize * WIDTH + x as usize].abs(), "{part:?} {x} {y}");
                }
            }
        }
    }

    #[test]
    fn pixels_near_edges_and_holes_are_unreliable() {
        for (width, height) in [(31, 23), (1, 40), (40, 1)] {
            let depth_m: Vec<f32> =
                (0..width * height).map(|i| [1.0, 1.02, 1.1, 0.0, 2.0][(i * 7 / 23 + i % width / 11) % 5]).collect();
            let max_depth_m: Vec<f32> = (0..width * height).map(|i| [0.0, 1.5, 9.0][i / 5 % 3]).collect();
            let place = |i: usize| (i % width, i / width);
            let is_torn = |a: usize, b: usize| {
                let (near, far) = (depth_m[a].min(depth_m[b]), depth_m[a].max(depth_m[b]));
                near < max_depth_m[a].max(max_depth_m[b]) && (near <= 0.0 || far > DEPTH_STEP * near)
            };
            let all = 0..width * height;
            let step = |a: usize, b: usize| {
                let ((ax, ay), (bx, by)) = (place(a), place(b));
                ax.abs_diff(bx) + ay.abs_diff(by)
            };
            let is_edge: Vec<usize> =
                all.clone().filter(|a| all.clone().any(|b| step(*a, b) == 1 && is_torn(*a, b))).collect();
            for reach in [0, 1, 4, 60] {
                let near = |a: usize, b: usize| {
                    let ((ax, ay), (bx, by)) = (place(a), place(b));
                    ax.abs_diff(bx) <= reach && ay.abs_diff(by) <= reach
                };
                let expected: Vec<bool> =
                    all.clone().map(|a| max_depth_m[a] > 0.0 && is_edge.iter().any(|b| near(a, *b))).collect();
                assert_eq!(
                    unreliable_pixels(&depth_m, width, reach, &max_depth_m),
                    expected,
                    "{width} {height} {reach}"
                );
            }
        }
    }

    #[test]
    fn voters_of_another_color_are_ignored() {
        // The voters have bright pixels where the frame has dark ones.
        assert!(consensus_depth(59, &[60, 60, 60, 60], 150) == consensus_depth(59, &[], 40));
        // Away from edges and holes nothing changes.
        let far_off = consensus_depth(60, &[80, 80, 80, 80], 40);
        assert!((62..WIDTH).all(|x| far_off[20 * WIDTH + x] == 2.0), "{:?}", &far_off[..WIDTH]);
    }
}
