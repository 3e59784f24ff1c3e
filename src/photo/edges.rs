//! Depth whose edges lie where the picture's do.
//!
//! Edges of a measured map are ragged, and lie pixels beside those of the picture: a structured-light sensor matches
//! patches of several pixels, its time is not quite the picture's, nor is its place. What it says near an edge is doubtful, and what
//! it says farther from one is not. So doubtful pixels are asked from which trusted one they are reached the cheapest way:
//! a way costs a little for its length, much for colours that part under it, and starting at a pixel costs the more the
//! nearer it is to an edge (geodesic distance: Criminisi et al. 2008, equations 1 and 2; for depth Gong et al. 2013). Surfaces so meet where
//! the colours part most, and half-way where nothing parts, which is where the edge was.
//!
//! How far edges are off is asked of the map itself: how far the strongest change of colour lies from each of them. A map whose
//! edges are on the picture's (a simulated one) is left as it is.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::surfaces::{JUMP, apart};

/// Colours (square roots of light) that are less apart from pixel to pixel are one: noise and fine texture.
const NOISE: f32 = 0.01;
/// What it costs to believe the map at an edge, in the same unit; less by straight line to nothing where it is trusted.
const DOUBT: f32 = 0.1;
/// And what the length of a way costs, for one as long as edges are doubted far.
const WAY: f32 = 0.012;
/// Colours part at an edge that are so far apart, across one pixel.
const PARTED: f32 = 0.03;
/// An edge lies on the picture's where colours part there by this share of the most they do nearby.
const ON_EDGE: f32 = 0.5;

/// How far from an edge of the map what it says is doubtful, px, `most_px` at most; 0 where its edges are the picture's, or there is
/// nothing to tell by. Twice as far as the middle one of its edges is off.
pub fn doubtful_px(depth_m: &[f32], looks: &[[f32; 3]], width: usize, most_px: usize) -> f32 {
    let height = depth_m.len() / width.max(1);
    // Of edges that lie so far from the strongest change of colour across them.
    let mut off = vec![0usize; most_px + 1];
    let mut on_edge = 0;
    for i in 0..depth_m.len() {
        for (at, side, step) in [(i % width, width, 1), (i / width, height, width)] {
            if at < most_px || at + most_px + 1 >= side || !is_edge(depth_m[i], depth_m[i + step]) {
                continue;
            }
            let parted = |n: usize| apart(&looks[i + n * step - most_px * step], &looks[i + (n + 1) * step - most_px * step]);
            // The nearest one of those that are alike.
            let strongest = (0..=2 * most_px)
                .map(|n| (n.abs_diff(most_px), parted(n)))
                .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
            if let Some((far_px, most)) = strongest.filter(|(_, most)| *most > PARTED) {
                off[far_px] += 1;
                on_edge += usize::from(parted(most_px) >= ON_EDGE * most);
            }
        }
    }
    let all: usize = off.iter().sum();
    if 2 * on_edge >= all {
        return 0.0;
    }
    let mut sum = 0;
    let middle = off.iter().take_while(|count| { sum += **count; 2 * sum < all }).count();
    (2 * middle.max(1)).min(most_px) as f32
}

fn is_edge(a: f32, b: f32) -> bool {
    a.max(b) > JUMP * a.min(b)
}

/// The map with its edges on those of the picture, doubted up to `doubtful_px` from them (0: as it is). `looks`: square roots of light; where
/// `guessed`, it is doubted most.
pub fn on_colors(depth_m: &[f32], guessed: &[bool], looks: &[[f32; 3]], width: usize, doubtful_px: f32) -> Vec<f32> {
    let mut out = depth_m.to_vec();
    if doubtful_px <= 0.0 || width == 0 {
        return out;
    }
    let from_edge = from_edges_px(depth_m, width);
    let doubt = |(d, guessed): (&f32, &bool)| if *guessed { DOUBT } else { DOUBT * (1.0 - d / doubtful_px).max(0.0) };
    let mut cost: Vec<f32> = from_edge.iter().zip(guessed).map(doubt).collect();
    // Costs are not negative, so their bits are in their order.
    let place = |cost: f32, i: usize| Reverse((cost.to_bits(), i));
    let mut next: BinaryHeap<_> = (0..cost.len())
        .filter(|&i| guessed[i] || from_edge[i] < doubtful_px + 2.0)
        .map(|i| place(cost[i], i))
        .collect();
    while let Some(Reverse((bits, i))) = next.pop() {
        let so_far = f32::from_bits(bits);
        if so_far > cost[i] {
            continue;
        }
        for (n, length) in around(i, width, depth_m.len()) {
            let all = so_far + WAY / doubtful_px * length + (apart(&looks[i], &looks[n]) - NOISE).max(0.0);
            if all < cost[n] {
                cost[n] = all;
                // What was measured there, as long as it is of the surface that comes.
                out[n] = if is_edge(depth_m[n], out[i]) { out[i] } else { depth_m[n] };
                next.push(place(all, n));
            }
        }
    }
    out
}

/// The eight pixels around, and how far they are, px.
fn around(i: usize, width: usize, count: usize) -> impl Iterator<Item = (usize, f32)> {
    let (x, y) = ((i % width) as i32, (i / width) as i32);
    let height = count / width;
    (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (dx, dy))).filter_map(move |(dx, dy): (i32, i32)| {
        let (px, py) = (x + dx, y + dy);
        let inside = px >= 0 && py >= 0 && px < width as i32 && py < height as i32 && (dx, dy) != (0, 0);
        let length = if dx == 0 || dy == 0 { 1.0 } else { std::f32::consts::SQRT_2 };
        inside.then(|| (py as usize * width + px as usize, length))
    })
}

/// From each pixel's middle to the nearest edge of the map, by straight and diagonal steps, px.
fn from_edges_px(depth_m: &[f32], width: usize) -> Vec<f32> {
    let beside = |i: usize| around(i, width, depth_m.len()).filter(|(_, length)| *length == 1.0);
    let mut far: Vec<f32> = (0..depth_m.len())
        .map(|i| if beside(i).any(|(n, _)| is_edge(depth_m[i], depth_m[n])) { 0.5 } else { f32::INFINITY })
        .collect();
    let mut step = |i: usize, before: fn(usize, usize) -> bool| {
        let nearest = around(i, width, depth_m.len()).filter(|(n, _)| before(*n, i)).map(|(n, length)| far[n] + length);
        far[i] = nearest.fold(far[i], f32::min);
    };
    (0..depth_m.len()).for_each(|i| step(i, |n, i| n < i));
    (0..depth_m.len()).rev().for_each(|i| step(i, |n, i| n > i));
    far
}

/// Nearer surfaces one pixel wider: a pixel on an edge shows both, and is left with the nearer one, so that it neither
/// glows in what is blurred behind nor is blurred away.
pub fn widened(depth_m: &[f32], width: usize) -> Vec<f32> {
    let height = depth_m.len() / width.max(1);
    let own = |i: usize| {
        let (x, y) = (i % width, i / width);
        let beside = [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then_some(i + 1),
            (y > 0).then(|| i - width),
            (y + 1 < height).then_some(i + width),
        ];
        let nearest = beside.into_iter().flatten().map(|n| depth_m[n]).fold(f32::INFINITY, f32::min);
        if depth_m[i] > JUMP * nearest { nearest } else { depth_m[i] }
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
        let doubtful = doubtful_px(&depth, &looks, width, 12);
        assert!((6.0..=10.0).contains(&doubtful), "{doubtful}");
        let out = on_colors(&depth, &vec![false; depth.len()], &looks, width, doubtful);
        assert_eq!(out, stepped(width, height, |_| 20));
        let wide = widened(&out, width);
        assert_eq!((wide[5 * width + 19], wide[5 * width + 20], wide[5 * width + 21]), (1.0, 1.0, 3.0));
    }

    #[test]
    fn where_edges_are_the_pictures_nothing_is_doubted() {
        let (width, height) = (48, 32);
        let looks = parted(width, height);
        let depth = stepped(width, height, |_| 20);
        assert_eq!(doubtful_px(&depth, &looks, width, 12), 0.0);
        assert_eq!(on_colors(&depth, &vec![false; depth.len()], &looks, width, 0.0), depth);
        // And where there is nothing to tell by.
        assert_eq!(doubtful_px(&depth, &vec![[0.3; 3]; depth.len()], width, 12), 0.0);
        assert_eq!(doubtful_px(&[], &[], 0, 12), 0.0);
    }

    #[test]
    fn one_colour_and_slopes_stay() {
        let depth = stepped(48, 32, |_| 21);
        let (grey, measured) = (vec![[0.3; 3]; depth.len()], vec![false; depth.len()]);
        assert_eq!(on_colors(&depth, &measured, &grey, 48, 8.0), depth);
        // A floor that recedes by 2 % a row.
        let floor: Vec<f32> = (0..400).map(|i| 1.02f32.powi(20 - i / 20)).collect();
        assert_eq!(on_colors(&floor, &[false; 400], &[[0.3; 3]; 400], 20, 8.0), floor);
        assert_eq!(widened(&floor, 20), floor);
    }

    #[test]
    fn what_was_guessed_goes_with_what_it_looks_like() {
        // The thing's own last ten columns were not measured, and are held for the wall in its shade.
        let (width, height) = (48, 32);
        let depth = stepped(width, height, |_| 10);
        let guessed: Vec<bool> = (0..depth.len()).map(|i| (10..20).contains(&(i % width))).collect();
        let out = on_colors(&depth, &guessed, &parted(width, height), width, 4.0);
        assert_eq!(out, stepped(width, height, |_| 20));
    }

    #[test]
    fn a_thin_thing_does_not_get_lost() {
        // A dark post 3 px wide, measured 2 px beside where it is seen.
        let (width, height) = (48, 32);
        let post = |first: usize| move |i: usize| (first..first + 3).contains(&(i % width));
        let looks: Vec<_> = (0..width * height).map(|i| [if post(20)(i) { 0.2 } else { 0.8 }; 3]).collect();
        let depth: Vec<f32> = (0..width * height).map(|i| if post(22)(i) { 1.0 } else { 3.0 }).collect();
        let out = on_colors(&depth, &vec![false; depth.len()], &looks, width, 6.0);
        let wanted: Vec<f32> = (0..width * height).map(|i| if post(20)(i) { 1.0 } else { 3.0 }).collect();
        assert_eq!(out, wanted);
    }
}
