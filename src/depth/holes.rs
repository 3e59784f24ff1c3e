//! Fills depth that the sensor did not measure.
//!
//! The projector of a structured-light sensor stands beside its camera. Where a near object blocks
//! the projected light there is no depth: a sensor shadow behind the object, on one side
//! (Khoshelham & Elberink 2012). Reprojection to another moment leaves the same kind of hole where
//! background is disoccluded. The farther of the two ends of such a hole is extended into it, as in
//! depth-image-based rendering (Fehn 2004). The largest width of a sensor shadow is known: with a
//! baseline b the disparity of a point at z is f·b/z, so the shadow of an edge between z₁ and z₂ is
//! f·b·(1/z₁ − 1/z₂) wide. It lies beside an object, never above or below it. A hole there is as
//! often the object's own rim.
//!
//! Other holes are dark or shiny objects, and rims that the sensor does not measure. In them 1/z is
//! the smoothest interpolation of the measurements around (Laplace's equation: a plane's 1/z is
//! linear in the picture, so planes are continued). Smoothness has little weight between pixels of
//! different colours (as in the colourisation of Levin et al. 2004). A dark object thus takes the
//! depth measured on it, as a whole, and not that of its surroundings.

use super::discontinuity::{DEPTH_STEP, color_distance};

/// Longest distance between a sensor's projector and its camera, m: 75 mm in the Kinect, 95 mm in
/// the widest hand-held one.
const BASELINE_M: f32 = 0.095;
/// Additional width of a sensor shadow with ragged ends, px.
const RAGGED_PX: f32 = 4.0;
/// σ of colours (square roots of light) within one object.
const COLOR_SIGMA: f32 = 0.03;
/// Smallest weight of smoothness, between different objects.
const MIN_WEIGHT: f32 = 1e-3;
/// Rounds of relaxation at each size.
const ROUNDS: usize = 80;
/// Factor of over-relaxation. Sizes are halved, so that each has only its own wavelengths to
/// settle.
const OVER_RELAXATION: f32 = 1.7;

/// Fills the holes (0 and values that are not distances) of a map, row by row. `sqrt_colors`:
/// square roots of its picture's light. `focal_px`: focal length in its pixels. Returns the mask of
/// pixels in a sensor shadow, or `None` if nothing was measured at all.
pub fn fill(depth_m: &mut [f32], sqrt_colors: &[[f32; 3]], width: usize, focal_px: f32) -> Option<Vec<bool>> {
    let is_measured: Vec<bool> = depth_m.iter().map(|z| z.is_finite() && *z > 0.0).collect();
    if width == 0 || !is_measured.contains(&true) {
        return None;
    }
    if !is_measured.contains(&false) {
        return Some(vec![false; depth_m.len()]);
    }
    let height = depth_m.len() / width;
    // For each pixel in a sensor shadow: its width, and the depth of its farther end. Of a row's
    // and a column's the narrower one counts.
    let mut shadow = vec![(u32::MAX, 0.0f32); depth_m.len()];
    let mut has_holes = vec![false; width];
    for (y, row) in is_measured.chunks_exact(width).enumerate().filter(|(_, row)| row.contains(&false)) {
        let widest_px = |near_m: f32, far_m: f32| RAGGED_PX + focal_px * BASELINE_M * (1.0 / near_m - 1.0 / far_m);
        mark_shadows(depth_m, &is_measured, &mut shadow, [y * width, 1, width], widest_px);
        has_holes.iter_mut().zip(row).for_each(|(has, is_measured)| *has |= !is_measured);
    }
    for x in (0..width).filter(|x| has_holes[*x]) {
        // Only holes within one surface.
        let widest_px = |near_m: f32, far_m: f32| if far_m > DEPTH_STEP * near_m { 0.0 } else { RAGGED_PX };
        mark_shadows(depth_m, &is_measured, &mut shadow, [x, width, height], widest_px);
    }
    let is_shadow: Vec<bool> = shadow.iter().map(|(length, _)| *length < u32::MAX).collect();
    for i in (0..depth_m.len()).filter(|&i| is_shadow[i]) {
        depth_m[i] = shadow[i].1;
    }
    let is_fixed: Vec<bool> =
        is_measured.iter().zip(&is_shadow).map(|(is_measured, shadow)| *is_measured || *shadow).collect();
    if is_fixed.contains(&false) {
        let values = depth_m.iter().zip(&is_fixed).map(|(z, fixed)| if *fixed { z.recip() } else { 0.0 }).collect();
        let smooth =
            InpaintGrid { width, values, is_fixed: is_fixed.clone(), sqrt_colors: sqrt_colors.to_vec() }.relaxed();
        // The solution is within the range of the fixed values, but for rounding.
        let measured = || depth_m.iter().zip(&is_fixed).filter(|(_, fixed)| **fixed).map(|(z, _)| *z);
        let range = [measured().fold(f32::INFINITY, f32::min), measured().fold(0.0, f32::max)];
        for i in (0..depth_m.len()).filter(|&i| !is_fixed[i]) {
            depth_m[i] = smooth.values[i].recip().clamp(range[0], range[1]);
        }
    }
    Some(is_shadow)
}

/// Marks, along one line of pixels (first index, step, count), holes that are narrow enough for a
/// sensor shadow. `widest_px` is its largest width, from the nearer and the farther end's depth.
fn mark_shadows(
    depth_m: &[f32],
    is_measured: &[bool],
    shadow: &mut [(u32, f32)],
    [first, step, count]: [usize; 3],
    widest_px: impl Fn(f32, f32) -> f32,
) {
    let at = |n: usize| first + n * step;
    let mut last: Option<usize> = None;
    for n in (0..count).filter(|&n| is_measured[at(n)]) {
        if let Some(before) = last.filter(|before| n - before > 1) {
            let [a, b] = [depth_m[at(before)], depth_m[at(n)]];
            let length = n - before - 1;
            if length as f32 <= widest_px(a.min(b), a.max(b)) {
                for m in (before + 1..n).map(at) {
                    if (length as u32) < shadow[m].0 {
                        shadow[m] = (length as u32, a.max(b));
                    }
                }
            }
        }
        last = Some(n);
    }
}

/// Values, and which of them are fixed.
struct InpaintGrid {
    width: usize,
    values: Vec<f32>,
    is_fixed: Vec<bool>,
    sqrt_colors: Vec<[f32; 3]>,
}

impl InpaintGrid {
    /// Solves Laplace's equation for the values that are not fixed. At least one is fixed.
    fn relaxed(mut self) -> Self {
        let (width, height) = (self.width, self.values.len() / self.width);
        let open: Vec<usize> = (0..self.values.len()).filter(|&i| !self.is_fixed[i]).collect();
        if width.min(height) > 2 {
            // Long wavelengths converge on a grid of half the size.
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
        InpaintGraph::new(&self, &open).relax(&mut self.values);
        self
    }

    /// Half the size: means over 2 × 2 pixels, and of values over the fixed ones alone.
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
            let (mut fixed_count, mut all) = (0.0f32, 0.0f32);
            for n in (y..(y + 2).min(height)).flat_map(|y| (x..(x + 2).min(self.width)).map(move |x| (x, y))) {
                let n = n.1 * self.width + n.0;
                (0..3).for_each(|c| sqrt_colors[c] += self.sqrt_colors[n][c]);
                all += 1.0;
                if self.is_fixed[n] {
                    *value += self.values[n];
                    fixed_count += 1.0;
                }
            }
            *sqrt_colors = sqrt_colors.map(|l| l / all.max(1.0));
            if fixed_count > 0.0 {
                (*value, *fixed) = (*value / fixed_count, true);
            }
        }
        half
    }
}

/// Open pixels and their links, diagonal by diagonal. No two pixels of a diagonal are neighbours,
/// so that a processor works on several at a time. The result is the same as row by row.
struct InpaintGraph {
    /// Indices of the open pixels, then of their neighbours.
    pixels: Vec<u32>,
    /// Neighbours of each open pixel, as indices into `pixels`, with weights.
    beside: Vec<[(u32, f32); 4]>,
}

impl InpaintGraph {
    fn new(grid: &InpaintGrid, open: &[usize]) -> Self {
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
                (place[other], MIN_WEIGHT + (-0.5 * apart * apart).exp())
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
    fn relax(&self, values: &mut [f32]) {
        let mut solution: Vec<f32> = self.pixels.iter().map(|&i| values[i as usize]).collect();
        for round in 0..ROUNDS {
            // The last rounds, without over-relaxation, remove its residual.
            let over = if round + 8 < ROUNDS { OVER_RELAXATION } else { 1.0 };
            let mut relax = |(n, beside): (usize, &[(u32, f32); 4])| {
                let (sum, all) =
                    beside.iter().fold((0.0, 0.0), |(s, a), (n, w)| (s + w * solution[*n as usize], a + w));
                if all > 0.0 {
                    solution[n] += over * (sum / all - solution[n]);
                }
            };
            // Alternating directions.
            if round.is_multiple_of(2) {
                self.beside.iter().enumerate().for_each(&mut relax);
            } else {
                self.beside.iter().enumerate().rev().for_each(&mut relax);
            }
        }
        for (&i, value) in self.pixels.iter().zip(solution).take(self.beside.len()) {
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
    fn sensor_shadow_takes_the_depth_of_its_farther_end() {
        // An object at 1 m in front of a wall at 3 m, and its sensor shadow to the right.
        let row = [3.0, 3.0, 1.0, 1.0, 0.0, 0.0, 3.0, 3.0];
        let mut depth: Vec<f32> = (0..8).flat_map(|_| row).collect();
        let is_shadow = fill(&mut depth, &[GREY; 64], 8, 500.0).unwrap();
        for (row, is_shadow) in depth.chunks(8).zip(is_shadow.chunks(8)) {
            assert_eq!(row, [3.0, 3.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0]);
            assert_eq!(is_shadow, [false, false, false, false, true, true, false, false]);
        }
    }

    #[test]
    fn hole_is_filled_across_its_shorter_side() {
        // A hole two rows high across an object is filled from the rows above and below, not from
        // the walls at its sides.
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
    fn dark_object_takes_the_depth_of_its_few_measured_pixels() {
        // A black square at 1 m in front of a grey wall at 2 m; 12 of its pixels were measured.
        let (width, height) = (96, 80);
        let is_inside = |i: usize| (20..80).contains(&(i % width)) && (10..70).contains(&(i / width));
        let sqrt_colors: Vec<_> = (0..width * height).map(|i| if is_inside(i) { BLACK } else { GREY }).collect();
        let mut depth: Vec<f32> = (0..width * height)
            .map(|i| match is_inside(i) {
                false => 2.0,
                true if (30..34).contains(&(i % width)) && (50..53).contains(&(i / width)) => 1.0,
                true => 0.0,
            })
            .collect();
        assert!(fill(&mut depth, &sqrt_colors, width, 100.0).is_some());
        for (i, z) in depth.iter().enumerate() {
            let expected = if is_inside(i) { 1.0 } else { 2.0 };
            assert!((z / expected - 1.0).abs() < 0.1, "{} {}: {z}", i % width, i / width);
        }
    }

    #[test]
    fn plane_continues_through_a_wide_hole() {
        // 1/z = 0.4 + 0.004 x + 0.002 y.
        let (width, height) = (90, 70);
        let plane = |i: usize| 1.0 / (0.4 + 0.004 * (i % width) as f32 + 0.002 * (i / width) as f32);
        let hole = |i: usize| (20..70).contains(&(i % width)) && (15..60).contains(&(i / width));
        let mut depth: Vec<f32> = (0..width * height).map(|i| if hole(i) { 0.0 } else { plane(i) }).collect();
        assert!(fill(&mut depth, &vec![GREY; width * height], width, 100.0).is_some());
        for (i, z) in depth.iter().enumerate() {
            assert!((z / plane(i) - 1.0).abs() < 0.01, "{} {}: {z} {}", i % width, i / width, plane(i));
        }
    }

    #[test]
    fn single_measurement_fills_the_map() {
        let mut depth = vec![0.0f32; 20];
        depth[7] = 2.5;
        assert!(fill(&mut depth, &[GREY; 20], 5, 500.0).is_some());
        assert!(depth.iter().all(|z| (z - 2.5).abs() < 1e-5), "{depth:?}");
        assert!(fill(&mut [0.0, f32::NAN, -1.0], &[GREY; 3], 3, 500.0).is_none());
        assert!(fill(&mut [], &[], 0, 500.0).is_none());
    }
}
