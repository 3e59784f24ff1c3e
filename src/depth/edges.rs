//! Depth whose edges lie where the picture's do.
//!
//! Edges of a measured map are ragged, and lie pixels beside those of the picture: a structured-light sensor matches patches
//! of several pixels, and neither its time nor its place is quite the picture's. What it says near an edge is doubtful, and what
//! it says farther from one is not. So each doubtful pixel goes with the trusted one from which it is reached the cheapest way: a
//! way costs a little for its length, and as much as colours change under it (the geodesic distance of Criminisi et al. 2008,
//! with the sum of both in place of the root of their squares); to start at a doubtful pixel costs the more the nearer it is to an
//! edge. Surfaces so meet where colours part most, and half-way where none do, which is where the edge was.
//!
//! Whether a map needs this is asked of itself: one whose edges are on the picture's (a simulated one) is left as it is.
//!
//! Not modelled: edges farther off than is doubted; edges between things of one colour (they stay where they were measured); slits
//! that lie in the shade of their own sides.

use super::apart::{JUMP, apart};

/// How far the map's edges may lie beside the picture's, as a share of its width: those of a Kinect do by up to 8 of 640 px.
pub const MOST_OFF: f64 = 8.0 / 640.0;
/// Colours (square roots of light) that are less apart from pixel to pixel are one: noise and fine texture.
const NOISE: f32 = 0.02;
/// What it costs to believe the map at an edge, in the same unit; less by straight line to nothing where it is trusted.
const DOUBT: f32 = 0.3;
/// To believe what was guessed in a shade: less than most contrasts of two things, and more than a way through one.
const GUESS: f32 = 0.05;
/// And what the length of a way costs, for one as long as edges are doubted far.
const WAY: f32 = 0.015;
/// Colours part at an edge that are so far apart, across one pixel.
const PARTED: f32 = 0.03;
/// An edge lies on the picture's where colours part there by this share of the most they do nearby. So do 80 % of a
/// simulated map's edges, and 25 to 35 % of a Kinect's.
const ON_PICTURE: f32 = 0.5;

/// Whether the map's edges lie beside those of the picture: at less than half of them, of those where colours part within
/// `reach_px`, they do so right there.
pub fn are_off(depth_m: &[f32], looks: &[[f32; 3]], width: usize, reach_px: usize) -> bool {
    let height = depth_m.len() / width.max(1);
    let (mut all, mut on_picture) = (0usize, 0usize);
    for i in 0..depth_m.len() {
        for (at, side, step) in [(i % width, width, 1), (i / width, height, width)] {
            if at < reach_px || at + reach_px + 1 >= side || !is_edge(depth_m[i], depth_m[i + step]) {
                continue;
            }
            let first = i - reach_px * step;
            let parted = |n: usize| apart(&looks[first + n * step], &looks[first + (n + 1) * step]);
            let most = (0..=2 * reach_px).map(parted).fold(0.0, f32::max);
            if most > PARTED {
                all += 1;
                on_picture += usize::from(parted(reach_px) >= ON_PICTURE * most);
            }
        }
    }
    2 * on_picture < all
}

fn is_edge(a: f32, b: f32) -> bool {
    a.max(b) > JUMP * a.min(b)
}

/// The map with its edges on those of the picture, where it is doubted up to `reach_px` from them, and most where it was
/// `guessed`. `looks`: square roots of light.
pub fn on_colors(depth_m: &[f32], guessed: &[bool], looks: &[[f32; 3]], width: usize, reach_px: usize) -> Vec<f32> {
    let mut out = depth_m.to_vec();
    let reach_px = reach_px.max(1) as f32;
    let from_edge = from_edges_px(depth_m, width);
    let doubt = |(d, guessed): (&f32, &bool)| {
        if *guessed { GUESS } else { DOUBT * (1.0 - d / reach_px).max(0.0) }
    };
    let mut cost: Vec<f32> = from_edge.iter().zip(guessed).map(doubt).collect();
    let around = Around::new(width, depth_m.len());
    let mut queue = Queue::new(WAY / reach_px);
    for i in (0..cost.len()).filter(|&i| guessed[i] || from_edge[i] < reach_px + 2.0) {
        queue.push(cost[i], i);
    }
    let mut level = Vec::new();
    while queue.next_level(&mut level) {
        level.retain(|&(bits, i): &(u32, u32)| f32::from_bits(bits) <= cost[i as usize]);
        level.sort_unstable();
        for &(bits, i) in &level {
            let (so_far, i) = (f32::from_bits(bits), i as usize);
            for (n, length) in around.of(i) {
                let way = so_far + WAY / reach_px * length;
                // Colours only add to it.
                if way >= cost[n] {
                    continue;
                }
                let all = way + (apart(&looks[i], &looks[n]) - NOISE).max(0.0);
                if all < cost[n] {
                    cost[n] = all;
                    // What was measured there, as long as it is of the surface that comes.
                    out[n] = if is_edge(depth_m[n], out[i]) { out[i] } else { depth_m[n] };
                    queue.push(all, n);
                }
            }
        }
    }
    out
}

/// Pixels by what it costs to reach them, in levels (Dial 1969). A step costs more than a level is high, so that none of a
/// level's pixels is on the way to another of them.
struct Queue {
    per_cost: f32,
    levels: Vec<Vec<(u32, u32)>>,
    next: usize,
}

impl Queue {
    fn new(least_step: f32) -> Self {
        Self { per_cost: 1.01 / least_step, levels: Vec::new(), next: 0 }
    }

    /// No cost is negative, so their bits are in their order.
    fn push(&mut self, cost: f32, i: usize) {
        let level = (cost * self.per_cost) as usize;
        if level >= self.levels.len() {
            self.levels.resize_with(level + 1, Vec::new);
        }
        self.levels[level].push((cost.to_bits(), i as u32));
    }

    /// Puts the cheapest level in the place of what is there; false where none is left.
    fn next_level(&mut self, level: &mut Vec<(u32, u32)>) -> bool {
        level.clear();
        let Some(next) = self.levels.get_mut(self.next) else { return false };
        std::mem::swap(level, next);
        self.next += 1;
        true
    }
}

/// The pixels around each.
struct Around {
    width: usize,
    height: usize,
}

impl Around {
    fn new(width: usize, count: usize) -> Self {
        Self { width, height: count / width.max(1) }
    }

    /// The eight around a pixel, row by row, and how far they are, px; fewer at the rim.
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
        // Whether there is something left, right, above and below.
        let (left, right, above, below) = (x > 0, x + 1 < self.width, y > 0, y + 1 < self.height);
        STEPS.into_iter().filter_map(move |(dx, dy, length)| {
            let inside = (dx >= 0 || left) && (dx <= 0 || right) && (dy >= 0 || above) && (dy <= 0 || below);
            inside.then(|| ((i as isize + dy * width + dx) as usize, length))
        })
    }
}

/// From each pixel's middle to the nearest edge of the map, by straight and diagonal steps, px.
fn from_edges_px(depth_m: &[f32], width: usize) -> Vec<f32> {
    let around = Around::new(width, depth_m.len());
    let mut far = vec![f32::INFINITY; depth_m.len()];
    for i in 0..depth_m.len() {
        for beside in [(i % width + 1 < width).then_some(i + 1), Some(i + width)].into_iter().flatten() {
            if depth_m.get(beside).is_some_and(|z| is_edge(depth_m[i], *z)) {
                (far[i], far[beside]) = (0.5, 0.5);
            }
        }
    }
    let mut step = |i: usize, before: fn(usize, usize) -> bool| {
        let nearest = around.of(i).filter(|(n, _)| before(*n, i)).map(|(n, length)| far[n] + length);
        far[i] = nearest.fold(far[i], f32::min);
    };
    (0..depth_m.len()).for_each(|i| step(i, |n, i| n < i));
    (0..depth_m.len()).rev().for_each(|i| step(i, |n, i| n > i));
    far
}

/// Nearer surfaces one pixel wider: a pixel on an edge shows both, and is left with the nearer one, so that it neither
/// glows in what is blurred behind nor is blurred away. With `looks` only where it does look like a mixture of the two: what
/// sharpening in the camera makes darker or brighter than both does not.
pub fn widened(depth_m: &[f32], looks: Option<&[[f32; 3]]>, width: usize) -> Vec<f32> {
    let height = depth_m.len() / width.max(1);
    // Beside it on one side, and on the other.
    let is_mixed = |i: usize, near: usize, far: Option<usize>| {
        let Some((looks, far)) = looks.zip(far) else { return true };
        let both = apart(&looks[near], &looks[far]);
        apart(&looks[i], &looks[near]) <= both && apart(&looks[i], &looks[far]) <= both
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

    /// Dark up to column 20, bright from there.
    fn parted(width: usize, height: usize) -> Vec<[f32; 3]> {
        (0..width * height).map(|i| [if i % width < 20 { 0.2 } else { 0.8 }; 3]).collect()
    }

    /// At 1 m up to a column that goes by the row, 3 m from there.
    fn stepped(width: usize, height: usize, edge: impl Fn(usize) -> usize) -> Vec<f32> {
        (0..width * height).map(|i| if i % width < edge(i / width) { 1.0 } else { 3.0 }).collect()
    }

    #[test]
    fn a_ragged_edge_goes_where_the_colours_part() {
        let (width, height) = (48, 32);
        let looks = parted(width, height);
        // Off by 1 to 5 px, to either side.
        let depth = stepped(width, height, |y| [15, 18, 23, 25, 21, 16][y / 2 % 6]);
        assert!(are_off(&depth, &looks, width, 8));
        let out = on_colors(&depth, &vec![false; depth.len()], &looks, width, 8);
        assert_eq!(out, stepped(width, height, |_| 20));
        let wide = widened(&out, Some(&looks), width);
        assert_eq!((wide[5 * width + 19], wide[5 * width + 20], wide[5 * width + 21]), (1.0, 1.0, 3.0));
    }

    #[test]
    fn edges_are_compared_with_the_pictures() {
        let (width, height) = (48, 32);
        let looks = parted(width, height);
        let depth = stepped(width, height, |_| 20);
        assert!(!are_off(&depth, &looks, width, 8));
        assert!(are_off(&stepped(width, height, |_| 22), &looks, width, 8));
        // Nothing tells of it.
        assert!(!are_off(&depth, &vec![[0.3; 3]; depth.len()], width, 8));
        assert!(!are_off(&[], &[], 0, 8));
    }

    #[test]
    fn one_colour_and_slopes_stay() {
        let depth = stepped(48, 32, |_| 21);
        let (grey, measured) = (vec![[0.3; 3]; depth.len()], vec![false; depth.len()]);
        assert_eq!(on_colors(&depth, &measured, &grey, 48, 8), depth);
        // A floor that recedes by 2 % a row.
        let floor: Vec<f32> = (0..400).map(|i| 1.02f32.powi(20 - i / 20)).collect();
        assert_eq!(on_colors(&floor, &[false; 400], &[[0.3; 3]; 400], 20, 8), floor);
        assert_eq!(widened(&floor, None, 20), floor);
    }

    #[test]
    fn what_was_guessed_goes_with_what_it_looks_like() {
        // The thing's own last ten columns were not measured, and are held for the wall in its shade.
        let (width, height) = (48, 32);
        let depth = stepped(width, height, |_| 10);
        let guessed: Vec<bool> = (0..depth.len()).map(|i| (10..20).contains(&(i % width))).collect();
        let out = on_colors(&depth, &guessed, &parted(width, height), width, 8);
        assert_eq!(out, stepped(width, height, |_| 20));
    }

    #[test]
    fn a_thin_thing_does_not_get_lost() {
        // A dark post 3 px wide, measured 1 px beside where it is seen.
        let (width, height) = (48, 32);
        let post = |first: usize| move |i: usize| (first..first + 3).contains(&(i % width));
        let looks: Vec<_> = (0..width * height).map(|i| [if post(20)(i) { 0.2 } else { 0.8 }; 3]).collect();
        let depth: Vec<f32> = (0..width * height).map(|i| if post(21)(i) { 1.0 } else { 3.0 }).collect();
        let out = on_colors(&depth, &vec![false; depth.len()], &looks, width, 6);
        let wanted: Vec<f32> = (0..width * height).map(|i| if post(20)(i) { 1.0 } else { 3.0 }).collect();
        assert_eq!(out, wanted);
    }
}
