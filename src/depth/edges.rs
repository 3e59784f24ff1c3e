//! Aligns the edges of a depth map with those of the picture.
//!
//! The edges of a measured map are ragged, and pixels away from those of the picture: a
//! structured-light sensor matches patches of several pixels, and differs from the colour camera in
//! time and position. Its depth is unreliable near an edge and reliable farther away. Each
//! unreliable pixel takes its depth from the reliable pixel with the cheapest path to it. The cost
//! of a path is its length, with a small weight, plus the change of colour along it (the geodesic
//! distance of Criminisi et al. 2008, with the sum of both instead of the root of their squares).
//! Starting at an unreliable pixel costs more the nearer it is to an edge, and most if its colour
//! is likelier on the edge's other side (`color_likelihood`). Surfaces thus meet where colours
//! differ most. Where no colours differ they meet half-way, at the measured edge.
//!
//! Only maps with misaligned edges are changed: a simulated map, whose edges are on the picture's,
//! stays as it is.
//!
//! Not modelled: edges that are off by more than the unreliable range; edges between objects of one
//! colour (they stay where they were measured); slits within the sensor shadow of their own sides.

use super::color_likelihood::other_surface_log_ratio;
use super::discontinuity::{DEPTH_STEP, color_distance, is_step};
use super::nearest_edge::{distances_px, each_edge};

/// Largest distance of the map's edges from the picture's, as a fraction of its width. A Kinect's
/// are off by up to 8 of 640 px.
pub const MAX_EDGE_OFFSET: f64 = 8.0 / 640.0;
/// Smaller differences of colour (square roots of light) between neighbours are ignored: noise and
/// fine texture.
const COLOR_NOISE: f32 = 0.02;
/// Starting cost of a pixel at an edge, in the unit of colours. It falls linearly to 0 over the
/// unreliable range.
const EDGE_COST: f32 = 0.3;
/// Unreliable range of consensus depth, as a fraction of the usual one.
const CONSENSUS_RANGE: f32 = 0.5;
/// Additional starting cost per unit of the log likelihood ratio of the other surface.
const COST_PER_LOG_RATIO: f32 = 0.15;
/// Distance from an edge up to which that ratio counts, in unreliable ranges.
const LOG_RATIO_RANGE: f32 = 1.5;
/// Largest starting cost.
const MAX_START_COST: f32 = 0.6;
/// Starting cost of extrapolated depth: less than most contrasts between two objects, and more than
/// a path within one.
const EXTRAPOLATED_COST: f32 = 0.05;
/// Cost of a path as long as the unreliable range.
const LENGTH_COST: f32 = 0.015;
/// Smallest difference of neighbouring colours at an edge of the picture.
const MIN_EDGE_CONTRAST: f32 = 0.03;
/// Smallest contrast at a depth edge that is on the picture's, as a fraction of the largest
/// contrast nearby. 80 % of a simulated map's edges reach it, and 25 to 35 % of a Kinect's.
const MIN_ALIGNED_CONTRAST: f32 = 0.5;

/// True if fewer than half of the map's edges are aligned with the picture's. Only edges with an
/// edge of the picture within `reach_px` count.
pub fn are_misaligned(depth_m: &[f32], sqrt_colors: &[[f32; 3]], width: usize, reach_px: usize) -> bool {
    let height = depth_m.len() / width.max(1);
    let (mut all, mut aligned) = (0usize, 0usize);
    each_edge(depth_m, width, is_step, |[i, beside], _| {
        let step = beside - i;
        let (at, side) = if beside == i + width { (i / width, height) } else { (i % width, width) };
        if at < reach_px || at + reach_px + 1 >= side {
            return;
        }
        let first = i - reach_px * step;
        let contrast = |n: usize| color_distance(&sqrt_colors[first + n * step], &sqrt_colors[first + (n + 1) * step]);
        let max_contrast = (0..=2 * reach_px).map(contrast).fold(0.0, f32::max);
        if max_contrast > MIN_EDGE_CONTRAST {
            all += 1;
            aligned += usize::from(contrast(reach_px) >= MIN_ALIGNED_CONTRAST * max_contrast);
        }
    });
    2 * aligned < all
}

/// The origin of a pixel's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthOrigin {
    /// Measured, or interpolated from measurements around.
    Measured,
    /// A reliable consensus of frames.
    Consensus,
    /// Extrapolated from the background into the sensor's shadow.
    Extrapolated,
}

/// The map with its edges aligned with the picture's. Depth is unreliable up to `reach_px` from an
/// edge, less far for a consensus, and everywhere if extrapolated.
pub fn align_edges(
    depth_m: &[f32],
    origins: &[DepthOrigin],
    sqrt_colors: &[[f32; 3]],
    width: usize,
    reach_px: usize,
) -> Vec<f32> {
    let mut out = depth_m.to_vec();
    let reach_px = reach_px.max(1) as f32;
    let within_px = LOG_RATIO_RANGE * reach_px;
    // Paths start a little beyond the unreliable range.
    let start_px = within_px + 2.0;
    let from_edge = distances_px(depth_m, width, start_px, is_step);
    let log_ratio = other_surface_log_ratio(depth_m, sqrt_colors, width, reach_px, within_px);
    let start_cost = |i: usize| {
        let near_edge = |reach_px: f32| EDGE_COST * (1.0 - from_edge[i] / reach_px).max(0.0);
        let by_origin = match origins[i] {
            DepthOrigin::Extrapolated => EXTRAPOLATED_COST,
            DepthOrigin::Consensus => near_edge(CONSENSUS_RANGE * reach_px),
            DepthOrigin::Measured => near_edge(reach_px),
        };
        (by_origin + COST_PER_LOG_RATIO * log_ratio[i]).min(MAX_START_COST)
    };
    let mut cost: Vec<f32> = (0..depth_m.len()).map(start_cost).collect();
    let neighbourhood = Neighbourhood::new(width, depth_m.len());
    let mut queue = BucketQueue::new(LENGTH_COST / reach_px);
    for i in (0..cost.len()).filter(|&i| origins[i] == DepthOrigin::Extrapolated || from_edge[i] < start_px) {
        queue.push(cost[i], i);
    }
    let mut level = Vec::new();
    while queue.next_level(&mut level) {
        level.retain(|&(bits, i): &(u32, u32)| f32::from_bits(bits) <= cost[i as usize]);
        for &(bits, i) in &level {
            let (so_far, i) = (f32::from_bits(bits), i as usize);
            let mut step = |n: usize, length: f32| {
                let way = so_far + LENGTH_COST / reach_px * length;
                // The difference of colour only adds to the cost.
                if way >= cost[n] {
                    return;
                }
                let all = way + (color_distance(&sqrt_colors[i], &sqrt_colors[n]) - COLOR_NOISE).max(0.0);
                if all < cost[n] {
                    cost[n] = all;
                    // The pixel keeps its own depth if it belongs to the same surface.
                    out[n] = if is_step(depth_m[n], out[i]) { out[i] } else { depth_m[n] };
                    queue.push(all, n);
                }
            };
            match neighbourhood.inside(i) {
                Some(beside) => beside.into_iter().for_each(|(n, length)| step(n, length)),
                None => neighbourhood.of(i).for_each(|(n, length)| step(n, length)),
            }
        }
    }
    out
}

/// A bucket queue of pixels by the cost of their paths (Dial 1969). A step costs more than the
/// width of a bucket, so that no pixel of a bucket is on the path to another.
struct BucketQueue {
    per_cost: f32,
    levels: Vec<Vec<(u32, u32)>>,
    next: usize,
}

impl BucketQueue {
    fn new(min_step: f32) -> Self {
        Self { per_cost: 1.01 / min_step, levels: Vec::new(), next: 0 }
    }

    /// Costs are not negative, so their bits sort like the numbers.
    fn push(&mut self, cost: f32, i: usize) {
        let level = (cost * self.per_cost) as usize;
        if level >= self.levels.len() {
            self.levels.resize_with(level + 1, Vec::new);
        }
        self.levels[level].push((cost.to_bits(), i as u32));
    }

    /// Replaces `level` by the cheapest remaining level. False if there is none.
    fn next_level(&mut self, level: &mut Vec<(u32, u32)>) -> bool {
        level.clear();
        let Some(next) = self.levels.get_mut(self.next) else { return false };
        std::mem::swap(level, next);
        self.next += 1;
        true
    }
}

/// The 8-neighbourhoods of pixels.
struct Neighbourhood {
    width: usize,
    height: usize,
}

impl Neighbourhood {
    fn new(width: usize, count: usize) -> Self {
        Self { width, height: count / width.max(1) }
    }

    /// All eight neighbours with their distances, px. `None` at the rim.
    fn inside(&self, i: usize) -> Option<[(usize, f32); 8]> {
        const FAR: f32 = std::f32::consts::SQRT_2;
        let (x, y, w) = (i % self.width, i / self.width, self.width);
        let is_inside = x > 0 && x + 1 < w && y > 0 && y + 1 < self.height;
        is_inside.then(|| {
            let (above, below) = (i - w, i + w);
            let upper = [(above - 1, FAR), (above, 1.0), (above + 1, FAR), (i - 1, 1.0)];
            let lower = [(i + 1, 1.0), (below - 1, FAR), (below, 1.0), (below + 1, FAR)];
            [upper[0], upper[1], upper[2], upper[3], lower[0], lower[1], lower[2], lower[3]]
        })
    }

    /// The eight neighbours of a pixel, row by row, with their distances, px. Fewer at the rim.
    fn of(&self, i: usize) -> impl Iterator<Item = (usize, f32)> + use<> {
        const FAR: f32 = std::f32::consts::SQRT_2;
        const STEPS: [(isize, isize, f32); 8] = [
            (-1, -1, FAR),
            (0, -1, 1.0),
            (1, -1, FAR),
            (-1, 0, 1.0),
            (1, 0, 1.0),
            (-1, 1, FAR),
            (0, 1, 1.0),
            (1, 1, FAR),
        ];
        let (x, y, width) = (i % self.width, i / self.width, self.width as isize);
        // Whether there are pixels left, right, above and below.
        let (left, right, above, below) = (x > 0, x + 1 < self.width, y > 0, y + 1 < self.height);
        STEPS.into_iter().filter_map(move |(dx, dy, length)| {
            let inside = (dx >= 0 || left) && (dx <= 0 || right) && (dy >= 0 || above) && (dy <= 0 || below);
            inside.then(|| ((i as isize + dy * width + dx) as usize, length))
        })
    }
}

/// The map with nearer surfaces dilated by one pixel. A pixel on an edge shows both surfaces and is
/// assigned to the nearer one, so that it neither glows in the blurred background nor is blurred
/// away. With `sqrt_colors`, only pixels whose colour is a mixture of both surfaces are changed,
/// and not those that the camera's sharpening made darker or brighter than both.
pub fn dilate_foreground(depth_m: &[f32], sqrt_colors: Option<&[[f32; 3]]>, width: usize) -> Vec<f32> {
    let height = depth_m.len() / width.max(1);
    // `near` and `far` are the neighbours on either side.
    let is_mixed = |i: usize, near: usize, far: Option<usize>| {
        let Some((sqrt_colors, far)) = sqrt_colors.zip(far) else { return true };
        let both = color_distance(&sqrt_colors[near], &sqrt_colors[far]);
        color_distance(&sqrt_colors[i], &sqrt_colors[near]) <= both
            && color_distance(&sqrt_colors[i], &sqrt_colors[far]) <= both
    };
    let own = |i: usize| {
        let (x, y) = (i % width, i / width);
        let left = (x > 0).then(|| i - 1);
        let right = (x + 1 < width).then_some(i + 1);
        let above = (y > 0).then(|| i - width);
        let below = (y + 1 < height).then_some(i + width);
        [(left, right), (right, left), (above, below), (below, above)]
            .into_iter()
            .filter_map(|(near, far)| near.map(|near| (near, far)))
            .filter(|(near, far)| depth_m[i] > DEPTH_STEP * depth_m[*near] && is_mixed(i, *near, *far))
            .map(|(near, _)| depth_m[near])
            .fold(depth_m[i], f32::min)
    };
    (0..depth_m.len()).map(own).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dark up to column 20, bright from there on.
    fn dark_and_bright(width: usize, height: usize) -> Vec<[f32; 3]> {
        (0..width * height).map(|i| [if i % width < 20 { 0.2 } else { 0.8 }; 3]).collect()
    }

    /// 1 m up to a column that depends on the row, 3 m from there on.
    fn stepped(width: usize, height: usize, edge: impl Fn(usize) -> usize) -> Vec<f32> {
        (0..width * height).map(|i| if i % width < edge(i / width) { 1.0 } else { 3.0 }).collect()
    }

    #[test]
    fn ragged_edge_moves_to_the_contrast() {
        let (width, height) = (48, 32);
        let sqrt_colors = dark_and_bright(width, height);
        // Off by 1 to 5 px, in either direction.
        let depth = stepped(width, height, |y| [15, 18, 23, 25, 21, 16][y / 2 % 6]);
        assert!(are_misaligned(&depth, &sqrt_colors, width, 8));
        let out = align_edges(&depth, &vec![DepthOrigin::Measured; depth.len()], &sqrt_colors, width, 8);
        assert_eq!(out, stepped(width, height, |_| 20));
        let wide = dilate_foreground(&out, Some(&sqrt_colors), width);
        assert_eq!((wide[5 * width + 19], wide[5 * width + 20], wide[5 * width + 21]), (1.0, 1.0, 3.0));
    }

    #[test]
    fn edges_are_misaligned_if_the_contrast_is_elsewhere() {
        let (width, height) = (48, 32);
        let sqrt_colors = dark_and_bright(width, height);
        let depth = stepped(width, height, |_| 20);
        assert!(!are_misaligned(&depth, &sqrt_colors, width, 8));
        assert!(are_misaligned(&stepped(width, height, |_| 22), &sqrt_colors, width, 8));
        // A uniform picture has no edges.
        assert!(!are_misaligned(&depth, &vec![[0.3; 3]; depth.len()], width, 8));
        assert!(!are_misaligned(&[], &[], 0, 8));
    }

    #[test]
    fn edge_without_contrast_and_slope_stay_unchanged() {
        let depth = stepped(48, 32, |_| 21);
        let (grey, measured) = (vec![[0.3; 3]; depth.len()], vec![DepthOrigin::Measured; depth.len()]);
        assert_eq!(align_edges(&depth, &measured, &grey, 48, 8), depth);
        // A floor that recedes by 2 % per row.
        let floor: Vec<f32> = (0..400).map(|i| 1.02f32.powi(20 - i / 20)).collect();
        assert_eq!(align_edges(&floor, &[DepthOrigin::Measured; 400], &[[0.3; 3]; 400], 20, 8), floor);
        assert_eq!(dilate_foreground(&floor, None, 20), floor);
    }

    #[test]
    fn extrapolated_depth_follows_the_colours() {
        // The last ten columns of the object were not measured, and have the extrapolated depth of
        // the wall.
        let (width, height) = (48, 32);
        let depth = stepped(width, height, |_| 10);
        let is_extrapolated = |i: usize| (10..20).contains(&(i % width));
        let origins: Vec<_> = (0..depth.len())
            .map(|i| if is_extrapolated(i) { DepthOrigin::Extrapolated } else { DepthOrigin::Measured })
            .collect();
        let out = align_edges(&depth, &origins, &dark_and_bright(width, height), width, 8);
        assert_eq!(out, stepped(width, height, |_| 20));
    }

    #[test]
    fn striped_floor_between_dark_legs_keeps_consensus_depth() {
        // Two legs with 14 px of floor between them. Every other pair of rows is as dark as the
        // legs.
        let (width, height) = (48, 32);
        let is_leg = |i: usize| !(16..30).contains(&(i % width));
        let is_dark = |i: usize| is_leg(i) || i / width % 4 < 2;
        let sqrt_colors: Vec<_> = (0..width * height).map(|i| [if is_dark(i) { 0.2 } else { 0.6 }; 3]).collect();
        let depth: Vec<f32> = (0..width * height).map(|i| if is_leg(i) { 1.0 } else { 3.0 }).collect();
        let nearer_count = |origin: DepthOrigin| {
            let out = align_edges(&depth, &vec![origin; depth.len()], &sqrt_colors, width, 8);
            (0..depth.len()).filter(|&i| out[i] < depth[i]).count()
        };
        // At most 4 px of a dark row beside either leg.
        let (all, consensus) = (nearer_count(DepthOrigin::Measured), nearer_count(DepthOrigin::Consensus));
        assert!(consensus <= 8 * height / 2 && all > consensus + height, "{all} {consensus}");
    }

    #[test]
    fn thin_post_moves_to_its_colours() {
        // A dark post 3 px wide, measured 1 px beside its place in the picture.
        let (width, height) = (48, 32);
        let post = |first: usize| move |i: usize| (first..first + 3).contains(&(i % width));
        let sqrt_colors: Vec<_> = (0..width * height).map(|i| [if post(20)(i) { 0.2 } else { 0.8 }; 3]).collect();
        let depth: Vec<f32> = (0..width * height).map(|i| if post(21)(i) { 1.0 } else { 3.0 }).collect();
        let out = align_edges(&depth, &vec![DepthOrigin::Measured; depth.len()], &sqrt_colors, width, 6);
        let expected: Vec<f32> = (0..width * height).map(|i| if post(20)(i) { 1.0 } else { 3.0 }).collect();
        assert_eq!(out, expected);
    }
}
