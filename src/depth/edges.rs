//! Moves the edges of a depth map to those of the picture.
//!
//! The edges of a measured map are ragged, and pixels away from those of the picture: a structured-light sensor matches
//! patches of several pixels, and neither its time nor its place is quite the picture's. Its depth is doubtful near an
//! edge and reliable farther away. So each doubtful pixel takes its depth from the trusted pixel with the cheapest path
//! to it. A path costs a little for its length, and as much as colours change along it (the geodesic distance of
//! Criminisi et al. 2008, with the sum of both instead of the root of their squares). Starting at a doubtful pixel
//! costs more the nearer it is to an edge, and most where it looks like what is on the edge's other side (`likeness`).
//! Surfaces thus meet where colours differ most, and where no colours differ, half-way, which is where the edge was.
//!
//! Whether a map needs this is found from the map itself: one whose edges are on the picture's (a simulated one) is
//! left as it is.
//!
//! Not modelled: edges that are off by more than the range of doubt; edges between things of one colour (they stay
//! where they were measured); slits within the shade of their own sides.

use super::discontinuity::{JUMP, color_distance, is_step};
use super::likeness::otherness;
use super::nearest_edge::{distances_px, each_edge};

/// How far the map's edges may be from the picture's, as a share of its width. A Kinect's are off by up to 8 of 640 px.
pub const MOST_OFF: f64 = 8.0 / 640.0;
/// Smaller differences of colour (square roots of light) from pixel to pixel are ignored: noise and fine texture.
const NOISE: f32 = 0.02;
/// The cost of trusting the map at an edge, in the same unit. It falls linearly to 0 where the map is trusted.
const DOUBT: f32 = 0.3;
/// The range of doubt where most frames agree on the depth, as a share of the usual one.
const SURE: f32 = 0.5;
/// What is added for each e-fold by which a pixel's colour is likelier on the other surface, up to where, in ranges of doubt, and
/// the most that it costs.
const PER_OTHERNESS: f32 = 0.15;
const SEEN: f32 = 1.5;
const MOST_DOUBT: f32 = 0.6;
/// The cost of trusting a guess in a shade: less than most contrasts between two things, and more than a path through
/// one.
const GUESS: f32 = 0.05;
/// The cost of a path as long as the range of doubt.
const WAY: f32 = 0.015;
/// Colours that differ by more than this across one pixel are an edge of the picture.
const PARTED: f32 = 0.03;
/// A depth edge is on the picture's if colours differ there by this share of the largest difference nearby. That holds
/// for 80 % of a simulated map's edges, and 25 to 35 % of a Kinect's.
const ON_PICTURE: f32 = 0.5;

/// Whether the map's edges are away from the picture's. Only edges with an edge of the picture within `reach_px` count;
/// fewer than half of them are right on it.
pub fn are_off(depth_m: &[f32], sqrt_colors: &[[f32; 3]], width: usize, reach_px: usize) -> bool {
    let height = depth_m.len() / width.max(1);
    let (mut all, mut on_picture) = (0usize, 0usize);
    each_edge(depth_m, width, is_step, |[i, beside], _| {
        let step = beside - i;
        let (at, side) = if beside == i + width { (i / width, height) } else { (i % width, width) };
        if at < reach_px || at + reach_px + 1 >= side {
            return;
        }
        let first = i - reach_px * step;
        let parted = |n: usize| color_distance(&sqrt_colors[first + n * step], &sqrt_colors[first + (n + 1) * step]);
        let most = (0..=2 * reach_px).map(parted).fold(0.0, f32::max);
        if most > PARTED {
            all += 1;
            on_picture += usize::from(parted(reach_px) >= ON_PICTURE * most);
        }
    });
    2 * on_picture < all
}

/// How a pixel of the map came to its depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// It was measured, or follows from what was measured around.
    Measured,
    /// Most frames agree on it.
    Sure,
    /// It lies in a shade.
    Guessed,
}

/// The map with its edges moved to the picture's. It is doubted up to `reach_px` from them, less where it is sure, and where it
/// was guessed. `sqrt_colors`: square roots of light.
pub fn on_colors(
    depth_m: &[f32],
    known: &[Known],
    sqrt_colors: &[[f32; 3]],
    width: usize,
    reach_px: usize,
) -> Vec<f32> {
    let mut out = depth_m.to_vec();
    let reach_px = reach_px.max(1) as f32;
    let within_px = SEEN * reach_px;
    // Ways begin a little farther away than anything is doubted.
    let begins_px = within_px + 2.0;
    let from_edge = distances_px(depth_m, width, begins_px, is_step);
    let other = otherness(depth_m, sqrt_colors, width, reach_px, within_px);
    let doubt = |i: usize| {
        let near_edge = |reach_px: f32| DOUBT * (1.0 - from_edge[i] / reach_px).max(0.0);
        let by_map = match known[i] {
            Known::Guessed => GUESS,
            Known::Sure => near_edge(SURE * reach_px),
            Known::Measured => near_edge(reach_px),
        };
        (by_map + PER_OTHERNESS * other[i]).min(MOST_DOUBT)
    };
    let mut cost: Vec<f32> = (0..depth_m.len()).map(doubt).collect();
    let around = Around::new(width, depth_m.len());
    let mut queue = Queue::new(WAY / reach_px);
    for i in (0..cost.len()).filter(|&i| known[i] == Known::Guessed || from_edge[i] < begins_px) {
        queue.push(cost[i], i);
    }
    let mut level = Vec::new();
    while queue.next_level(&mut level) {
        level.retain(|&(bits, i): &(u32, u32)| f32::from_bits(bits) <= cost[i as usize]);
        for &(bits, i) in &level {
            let (so_far, i) = (f32::from_bits(bits), i as usize);
            let mut step = |n: usize, length: f32| {
                let way = so_far + WAY / reach_px * length;
                // Colours only add to the cost.
                if way >= cost[n] {
                    return;
                }
                let all = way + (color_distance(&sqrt_colors[i], &sqrt_colors[n]) - NOISE).max(0.0);
                if all < cost[n] {
                    cost[n] = all;
                    // The depth measured there, if it belongs to the surface that spreads.
                    out[n] = if is_step(depth_m[n], out[i]) { out[i] } else { depth_m[n] };
                    queue.push(all, n);
                }
            };
            match around.inside(i) {
                Some(beside) => beside.into_iter().for_each(|(n, length)| step(n, length)),
                None => around.of(i).for_each(|(n, length)| step(n, length)),
            }
        }
    }
    out
}

/// Pixels by the cost to reach them, in levels (Dial 1969). A step costs more than the height of a level, so no pixel
/// of a level is on the path to another.
struct Queue {
    per_cost: f32,
    levels: Vec<Vec<(u32, u32)>>,
    next: usize,
}

impl Queue {
    fn new(least_step: f32) -> Self {
        Self { per_cost: 1.01 / least_step, levels: Vec::new(), next: 0 }
    }

    /// Costs are not negative, so their bits sort like the numbers.
    fn push(&mut self, cost: f32, i: usize) {
        let level = (cost * self.per_cost) as usize;
        if level >= self.levels.len() {
            self.levels.resize_with(level + 1, Vec::new);
        }
        self.levels[level].push((cost.to_bits(), i as u32));
    }

    /// Replaces `level` by the cheapest level left. False if there is none.
    fn next_level(&mut self, level: &mut Vec<(u32, u32)>) -> bool {
        level.clear();
        let Some(next) = self.levels.get_mut(self.next) else { return false };
        std::mem::swap(level, next);
        self.next += 1;
        true
    }
}

/// The neighbours of pixels.
struct Around {
    width: usize,
    height: usize,
}

impl Around {
    fn new(width: usize, count: usize) -> Self {
        Self { width, height: count / width.max(1) }
    }

    /// The same where there are all eight.
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

/// Nearer surfaces, widened by one pixel. A pixel on an edge shows both surfaces and is given to the nearer one, so
/// that it neither glows in the blurred background nor is blurred away. With `sqrt_colors`, only pixels that look like a
/// mixture of the two are changed: those that the camera's sharpening made darker or brighter than both are not.
pub fn widened(depth_m: &[f32], sqrt_colors: Option<&[[f32; 3]]>, width: usize) -> Vec<f32> {
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
            .filter(|(near, far)| depth_m[i] > JUMP * depth_m[*near] && is_mixed(i, *near, *far))
            .map(|(near, _)| depth_m[near])
            .fold(depth_m[i], f32::min)
    };
    (0..depth_m.len()).map(own).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dark up to column 20, bright from there on.
    fn parted(width: usize, height: usize) -> Vec<[f32; 3]> {
        (0..width * height).map(|i| [if i % width < 20 { 0.2 } else { 0.8 }; 3]).collect()
    }

    /// 1 m up to a column that depends on the row, 3 m from there on.
    fn stepped(width: usize, height: usize, edge: impl Fn(usize) -> usize) -> Vec<f32> {
        (0..width * height).map(|i| if i % width < edge(i / width) { 1.0 } else { 3.0 }).collect()
    }

    #[test]
    fn a_ragged_edge_goes_where_the_colours_part() {
        let (width, height) = (48, 32);
        let sqrt_colors = parted(width, height);
        // Off by 1 to 5 px, in either direction.
        let depth = stepped(width, height, |y| [15, 18, 23, 25, 21, 16][y / 2 % 6]);
        assert!(are_off(&depth, &sqrt_colors, width, 8));
        let out = on_colors(&depth, &vec![Known::Measured; depth.len()], &sqrt_colors, width, 8);
        assert_eq!(out, stepped(width, height, |_| 20));
        let wide = widened(&out, Some(&sqrt_colors), width);
        assert_eq!((wide[5 * width + 19], wide[5 * width + 20], wide[5 * width + 21]), (1.0, 1.0, 3.0));
    }

    #[test]
    fn edges_are_compared_with_the_pictures() {
        let (width, height) = (48, 32);
        let sqrt_colors = parted(width, height);
        let depth = stepped(width, height, |_| 20);
        assert!(!are_off(&depth, &sqrt_colors, width, 8));
        assert!(are_off(&stepped(width, height, |_| 22), &sqrt_colors, width, 8));
        // The picture gives no evidence.
        assert!(!are_off(&depth, &vec![[0.3; 3]; depth.len()], width, 8));
        assert!(!are_off(&[], &[], 0, 8));
    }

    #[test]
    fn one_colour_and_slopes_stay() {
        let depth = stepped(48, 32, |_| 21);
        let (grey, measured) = (vec![[0.3; 3]; depth.len()], vec![Known::Measured; depth.len()]);
        assert_eq!(on_colors(&depth, &measured, &grey, 48, 8), depth);
        // A floor that recedes by 2 % per row.
        let floor: Vec<f32> = (0..400).map(|i| 1.02f32.powi(20 - i / 20)).collect();
        assert_eq!(on_colors(&floor, &[Known::Measured; 400], &[[0.3; 3]; 400], 20, 8), floor);
        assert_eq!(widened(&floor, None, 20), floor);
    }

    #[test]
    fn what_was_guessed_goes_with_what_it_looks_like() {
        // The thing's own last ten columns were not measured, and are taken for the wall in its shade.
        let (width, height) = (48, 32);
        let depth = stepped(width, height, |_| 10);
        let is_shade = |i: usize| (10..20).contains(&(i % width));
        let guessed: Vec<_> =
            (0..depth.len()).map(|i| if is_shade(i) { Known::Guessed } else { Known::Measured }).collect();
        let out = on_colors(&depth, &guessed, &parted(width, height), width, 8);
        assert_eq!(out, stepped(width, height, |_| 20));
    }

    #[test]
    fn a_striped_floor_between_dark_legs_stays_where_frames_agree_on_it() {
        // Two legs, and 14 px of floor between: every other pair of rows is as dark as they are.
        let (width, height) = (48, 32);
        let is_leg = |i: usize| !(16..30).contains(&(i % width));
        let is_dark = |i: usize| is_leg(i) || i / width % 4 < 2;
        let sqrt_colors: Vec<_> = (0..width * height).map(|i| [if is_dark(i) { 0.2 } else { 0.6 }; 3]).collect();
        let depth: Vec<f32> = (0..width * height).map(|i| if is_leg(i) { 1.0 } else { 3.0 }).collect();
        let lost = |known: Known| {
            let out = on_colors(&depth, &vec![known; depth.len()], &sqrt_colors, width, 8);
            (0..depth.len()).filter(|&i| out[i] < depth[i]).count()
        };
        // Of a dark row up to 4 px beside either leg.
        let (all, sure) = (lost(Known::Measured), lost(Known::Sure));
        assert!(sure <= 8 * height / 2 && all > sure + height, "{all} {sure}");
    }

    #[test]
    fn a_thin_thing_does_not_get_lost() {
        // A dark post 3 px wide, measured 1 px away from where it is seen.
        let (width, height) = (48, 32);
        let post = |first: usize| move |i: usize| (first..first + 3).contains(&(i % width));
        let sqrt_colors: Vec<_> = (0..width * height).map(|i| [if post(20)(i) { 0.2 } else { 0.8 }; 3]).collect();
        let depth: Vec<f32> = (0..width * height).map(|i| if post(21)(i) { 1.0 } else { 3.0 }).collect();
        let out = on_colors(&depth, &vec![Known::Measured; depth.len()], &sqrt_colors, width, 6);
        let wanted: Vec<f32> = (0..width * height).map(|i| if post(20)(i) { 1.0 } else { 3.0 }).collect();
        assert_eq!(out, wanted);
    }
}
