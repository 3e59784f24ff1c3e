//! Depth where the sensor measured none.
//!
//! A structured-light sensor sees from one place and projects its light from another next to it. Where a near thing
//! blocks the light there is no depth: a shade behind the thing, on one side (Khoshelham & Elberink 2012). The same
//! holds for what comes into view when depth is carried to another moment. The farther of the two ends of such a gap
//! continues in it, as in views synthesised from depth (Fehn 2004). The largest width of a shade is known: with a
//! baseline b the disparity of a point at z is f·b/z, so the shade of an edge between z₁ and z₂ is f·b·(1/z₁ − 1/z₂)
//! wide. The projector stands beside the camera, so a shade lies beside a thing, never above or below it: a gap there is
//! the thing's own rim as often.
//!
//! Other gaps are dark or shiny things, and rims that the sensor does not see. In them 1/z is the smoothest
//! interpolation of what was measured around (Laplace's equation: a plane's 1/z is linear in the picture, so planes
//! continue through them). Smoothness counts little between pixels that look different (as in the colourisation of
//! Levin et al. 2004). So a dark thing takes the depth measured on it, as a whole, and not that of its surroundings.

use super::discontinuity::{JUMP, color_distance};

/// Longest distance between a sensor's projector and its camera, metres: 75 mm in the Kinect, 95 mm in the widest
/// hand-held one.
const BASELINE_M: f32 = 0.095;
/// How much the ends of a shade may be frayed in addition, px.
const FRAYED_PX: f32 = 4.0;
/// σ of colours (square roots of light) within one thing, and the weight that remains between different things.
const COLOR_SIGMA: f32 = 0.03;
const BETWEEN_THINGS: f32 = 1e-3;
/// Rounds of relaxation at each size, and over-relaxation (1.7: sizes are halved, so each has only its own wavelengths
/// to settle).
const ROUNDS: usize = 80;
const OVER: f32 = 1.7;

/// Fills the gaps (0 and values that are not distances) of a map, row by row. `sqrt_colors`: square roots of its picture's
/// light. `focal_px`: focal length in its pixels. Returns which pixels are in a shade. `None` if nothing was measured
/// at all.
pub fn fill(depth_m: &mut [f32], sqrt_colors: &[[f32; 3]], width: usize, focal_px: f32) -> Option<Vec<bool>> {
    let known: Vec<bool> = depth_m.iter().map(|z| z.is_finite() && *z > 0.0).collect();
    if width == 0 || !known.contains(&true) {
        return None;
    }
    if !known.contains(&false) {
        return Some(vec![false; depth_m.len()]);
    }
    let height = depth_m.len() / width;
    // For each pixel in a shade: the shade's width, and the depth of its farther end. The shorter way across decides.
    let mut shade = vec![(u32::MAX, 0.0f32); depth_m.len()];
    let mut has_gaps = vec![false; width];
    for (y, row) in known.chunks_exact(width).enumerate().filter(|(_, row)| row.contains(&false)) {
        let widest_px = |near_m: f32, far_m: f32| FRAYED_PX + focal_px * BASELINE_M * (1.0 / near_m - 1.0 / far_m);
        shades(depth_m, &known, &mut shade, [y * width, 1, width], widest_px);
        has_gaps.iter_mut().zip(row).for_each(|(has, known)| *has |= !known);
    }
    for x in (0..width).filter(|x| has_gaps[*x]) {
        // One surface continues.
        let widest_px = |near_m: f32, far_m: f32| if far_m > JUMP * near_m { 0.0 } else { FRAYED_PX };
        shades(depth_m, &known, &mut shade, [x, width, height], widest_px);
    }
    let is_shade: Vec<bool> = shade.iter().map(|(length, _)| *length < u32::MAX).collect();
    for i in (0..depth_m.len()).filter(|&i| is_shade[i]) {
        depth_m[i] = shade[i].1;
    }
    let is_fixed: Vec<bool> = known.iter().zip(&is_shade).map(|(known, shade)| *known || *shade).collect();
    if is_fixed.contains(&false) {
        let values = depth_m.iter().zip(&is_fixed).map(|(z, fixed)| if *fixed { z.recip() } else { 0.0 }).collect();
        let smooth = Grid { width, values, is_fixed: is_fixed.clone(), sqrt_colors: sqrt_colors.to_vec() }.relaxed();
        // A smooth map stays within the range of what it is fixed to, but rounding may not.
        let measured = || depth_m.iter().zip(&is_fixed).filter(|(_, fixed)| **fixed).map(|(z, _)| *z);
        let range = [measured().fold(f32::INFINITY, f32::min), measured().fold(0.0, f32::max)];
        for i in (0..depth_m.len()).filter(|&i| !is_fixed[i]) {
            depth_m[i] = smooth.values[i].recip().clamp(range[0], range[1]);
        }
    }
    Some(is_shade)
}

/// Marks, along one line of pixels (first index, step, count), gaps narrow enough to be a shade between their ends: up to
/// `widest_px`, by the nearer end's depth and the farther one's.
fn shades(
    depth_m: &[f32],
    known: &[bool],
    shade: &mut [(u32, f32)],
    [first, step, count]: [usize; 3],
    widest_px: impl Fn(f32, f32) -> f32,
) {
    let at = |n: usize| first + n * step;
    let mut last: Option<usize> = None;
    for n in (0..count).filter(|&n| known[at(n)]) {
        if let Some(before) = last.filter(|before| n - before > 1) {
            let [a, b] = [depth_m[at(before)], depth_m[at(n)]];
            let length = n - before - 1;
            if length as f32 <= widest_px(a.min(b), a.max(b)) {
                for m in (before + 1..n).map(at) {
                    if (length as u32) < shade[m].0 {
                        shade[m] = (length as u32, a.max(b));
                    }
                }
            }
        }
        last = Some(n);
    }
}

/// Values, and which of them are fixed.
struct Grid {
    width: usize,
    values: Vec<f32>,
    is_fixed: Vec<bool>,
    sqrt_colors: Vec<[f32; 3]>,
}

impl Grid {
    /// Makes the others smooth between the fixed ones, of which there is at least one.
    fn relaxed(mut self) -> Self {
        let (width, height) = (self.width, self.values.len() / self.width);
        let open: Vec<usize> = (0..self.values.len()).filter(|&i| !self.is_fixed[i]).collect();
        if width.min(height) > 2 {
            // Long wavelengths settle on a grid of half the size.
            let half = self.half().relaxed();
            for &i in &open {
                self.values[i] = half.values[i / width / 2 * half.width + i % width / 2];
            }
        } else {
            let (sum, count) = (0..self.values.len())
                .filter(|&i| self.is_fixed[i])
                .fold((0.0, 0.0f32), |(sum, count), i| (sum + self.values[i], count + 1.0));
            open.iter().for_each(|&i| self.values[i] = sum / count.max(1.0));
        }
        Links::new(&self, &open).settle(&mut self.values);
        self
    }

    /// Means of squares of 2 × 2; for values, of the fixed ones.
    fn half(&self) -> Self {
        let height = self.values.len() / self.width;
        let (w, h) = (self.width.div_ceil(2), height.div_ceil(2));
        let mut half = Self {
            width: w,
            values: vec![0.0; w * h],
            is_fixed: vec![false; w * h],
            sqrt_colors: vec![[0.0; 3]; w * h],
        };
        for (i, ((value, fixed), sqrt_colors)) in
            half.values.iter_mut().zip(&mut half.is_fixed).zip(&mut half.sqrt_colors).enumerate()
        {
            let (x, y) = (2 * (i % w), 2 * (i / w));
            let (mut stay, mut all) = (0.0f32, 0.0f32);
            for n in (y..(y + 2).min(height)).flat_map(|y| (x..(x + 2).min(self.width)).map(move |x| (x, y))) {
                let n = n.1 * self.width + n.0;
                (0..3).for_each(|c| sqrt_colors[c] += self.sqrt_colors[n][c]);
                all += 1.0;
                if self.is_fixed[n] {
                    *value += self.values[n];
                    stay += 1.0;
                }
            }
            *sqrt_colors = sqrt_colors.map(|l| l / all.max(1.0));
            if stay > 0.0 {
                (*value, *fixed) = (*value / stay, true);
            }
        }
        half
    }
}

/// Open pixels and their links, diagonal by diagonal. No two pixels of a diagonal are neighbours, so that a processor
/// works on several at a time. The result is the same as row by row.
struct Links {
    /// Pixels: the open ones, then their neighbours.
    pixels: Vec<u32>,
    /// For each open pixel its neighbours, as indices into `pixels`, with weights.
    beside: Vec<[(u32, f32); 4]>,
}

impl Links {
    fn new(grid: &Grid, open: &[usize]) -> Self {
        let (width, height) = (grid.width, grid.values.len() / grid.width);
        let mut pixels: Vec<u32> = open.iter().map(|&i| i as u32).collect();
        pixels.sort_by_key(|&i| i as usize % width + i as usize / width);
        let mut place = vec![u32::MAX; grid.values.len()];
        for (n, &i) in pixels.iter().enumerate() {
            place[i as usize] = n as u32;
        }
        let mut beside = Vec::with_capacity(open.len());
        for n in 0..open.len() {
            let i = pixels[n] as usize;
            let (x, y) = (i % width, i / width);
            let mut link = |is_there: bool, other: usize| {
                if !is_there {
                    return (n as u32, 0.0);
                }
                if place[other] == u32::MAX {
                    place[other] = pixels.len() as u32;
                    pixels.push(other as u32);
                }
                let apart = color_distance(&grid.sqrt_colors[i], &grid.sqrt_colors[other]) / COLOR_SIGMA;
                (place[other], BETWEEN_THINGS + (-0.5 * apart * apart).exp())
            };
            beside.push([
                link(x > 0, i.wrapping_sub(1)),
                link(x + 1 < width, i + 1),
                link(y > 0, i.wrapping_sub(width)),
                link(y + 1 < height, i + width),
            ]);
        }
        Self { pixels, beside }
    }

    /// Relaxes the open pixels.
    fn settle(&self, values: &mut [f32]) {
        let mut held: Vec<f32> = self.pixels.iter().map(|&i| values[i as usize]).collect();
        for round in 0..ROUNDS {
            // The last rounds settle what over-relaxation leaves.
            let over = if round + 8 < ROUNDS { OVER } else { 1.0 };
            let mut settle = |(n, beside): (usize, &[(u32, f32); 4])| {
                let (sum, all) = beside.iter().fold((0.0, 0.0), |(s, a), (n, w)| (s + w * held[*n as usize], a + w));
                if all > 0.0 {
                    held[n] += over * (sum / all - held[n]);
                }
            };
            // Alternating directions.
            if round.is_multiple_of(2) {
                self.beside.iter().enumerate().for_each(&mut settle);
            } else {
                self.beside.iter().enumerate().rev().for_each(&mut settle);
            }
        }
        for (&i, value) in self.pixels.iter().zip(held).take(self.beside.len()) {
            values[i as usize] = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: [f32; 3] = [0.5; 3];
    const BLACK: [f32; 3] = [0.05; 3];

    #[test]
    fn a_shade_is_what_stands_farther_at_its_ends() {
        // A thing at 1 m in front of a wall at 3 m, and its shade to the right.
        let row = [3.0, 3.0, 1.0, 1.0, 0.0, 0.0, 3.0, 3.0];
        let mut depth: Vec<f32> = (0..8).flat_map(|_| row).collect();
        let guessed = fill(&mut depth, &[GREY; 64], 8, 500.0).unwrap();
        for (row, guessed) in depth.chunks(8).zip(guessed.chunks(8)) {
            assert_eq!(row, [3.0, 3.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0]);
            assert_eq!(guessed, [false, false, false, false, true, true, false, false]);
        }
    }

    #[test]
    fn the_shorter_way_through_a_shade_decides() {
        // A gap two rows high across a thing: filled from its own rows, not from the walls at its sides.
        let mut depth = vec![1.0f32; 9 * 9];
        for y in 0..9 {
            (depth[y * 9], depth[y * 9 + 8]) = (4.0, 4.0);
        }
        depth[3 * 9 + 1..3 * 9 + 8].fill(0.0);
        depth[4 * 9 + 1..4 * 9 + 8].fill(f32::NAN);
        assert!(fill(&mut depth, &[GREY; 81], 9, 500.0).is_some());
        assert!((1..8).all(|x| depth[3 * 9 + x] == 1.0 && depth[4 * 9 + x] == 1.0), "{:?}", &depth[27..45]);
    }

    #[test]
    fn a_dark_thing_takes_its_own_depth_where_little_of_it_was_measured() {
        // A black square at 1 m in front of a grey wall at 2 m; 12 of its pixels were measured.
        let (width, height) = (96, 80);
        let inside = |i: usize| (20..80).contains(&(i % width)) && (10..70).contains(&(i / width));
        let sqrt_colors: Vec<_> = (0..width * height).map(|i| if inside(i) { BLACK } else { GREY }).collect();
        let mut depth: Vec<f32> = (0..width * height)
            .map(|i| match inside(i) {
                false => 2.0,
                true if (30..34).contains(&(i % width)) && (50..53).contains(&(i / width)) => 1.0,
                true => 0.0,
            })
            .collect();
        assert!(fill(&mut depth, &sqrt_colors, width, 100.0).is_some());
        for (i, z) in depth.iter().enumerate() {
            let wanted = if inside(i) { 1.0 } else { 2.0 };
            assert!((z / wanted - 1.0).abs() < 0.1, "{} {}: {z}", i % width, i / width);
        }
    }

    #[test]
    fn planes_go_on_through_wide_gaps() {
        // 1/z = 0.4 + 0.004 x + 0.002 y.
        let (width, height) = (90, 70);
        let plane = |i: usize| 1.0 / (0.4 + 0.004 * (i % width) as f32 + 0.002 * (i / width) as f32);
        let gap = |i: usize| (20..70).contains(&(i % width)) && (15..60).contains(&(i / width));
        let mut depth: Vec<f32> = (0..width * height).map(|i| if gap(i) { 0.0 } else { plane(i) }).collect();
        assert!(fill(&mut depth, &vec![GREY; width * height], width, 100.0).is_some());
        for (i, z) in depth.iter().enumerate() {
            assert!((z / plane(i) - 1.0).abs() < 0.01, "{} {}: {z} {}", i % width, i / width, plane(i));
        }
    }

    #[test]
    fn borders_and_lone_measurements_go_on() {
        let mut depth = vec![0.0f32; 20];
        depth[7] = 2.5;
        assert!(fill(&mut depth, &[GREY; 20], 5, 500.0).is_some());
        assert!(depth.iter().all(|z| (z - 2.5).abs() < 1e-5), "{depth:?}");
        assert!(fill(&mut [0.0, f32::NAN, -1.0], &[GREY; 3], 3, 500.0).is_none());
        assert!(fill(&mut [], &[], 0, 500.0).is_none());
    }
}
