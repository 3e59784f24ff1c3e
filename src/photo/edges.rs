//! Depth whose edges lie where the picture's do.
//!
//! Edges of a measured map are ragged, and lie a few pixels beside those of the picture. Near one, a pixel asks those
//! around it on which surface they are; those that look like it count most (the weights of the joint bilateral filter of
//! Kopf et al. 2007). It takes the depth of one of them, never something between (which would be a surface that is not there).

use crate::render::over_rows;

use super::surfaces::JUMP;

/// How far it asks, and σ of the weight by distance, px.
const WINDOW_PX: i32 = 5;
const NEAR_SIGMA_PX: f32 = 2.5;
/// σ of the weight by colour: square roots of light, 0 to 1.
const COLOR_SIGMA: f32 = 0.04;
/// So many times more must speak for the other surface: what is measured well stays, also at a right-angled corner (1.95).
const SURE: f32 = 2.0;

/// The map with its edges on those of the picture; `light` is linear, both row by row and `width` wide.
pub fn on_colors(depth_m: &[f32], light: &[[f32; 3]], width: usize) -> Vec<f32> {
    let height = depth_m.len() / width.max(1);
    let looks: Vec<[f32; 3]> = light.iter().map(|l| l.map(|c| c.max(0.0).sqrt())).collect();
    let side = 2 * WINDOW_PX + 1;
    let nearness: Vec<f32> = (0..side * side)
        .map(|i| {
            let (dx, dy) = ((i % side - WINDOW_PX) as f32, (i / side - WINDOW_PX) as f32);
            (-(dx * dx + dy * dy) / (2.0 * NEAR_SIGMA_PX * NEAR_SIGMA_PX)).exp()
        })
        .collect();
    let mut out = depth_m.to_vec();
    over_rows(&mut out, width, |y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let around = || {
                (-WINDOW_PX..=WINDOW_PX)
                    .flat_map(move |dy| (-WINDOW_PX..=WINDOW_PX).map(move |dx| (dx, dy)))
                    .filter_map(move |(dx, dy)| {
                        let (px, py) = (x as i32 + dx, y as i32 + dy);
                        let inside = px >= 0 && py >= 0 && px < width as i32 && py < height as i32;
                        inside.then(|| {
                            (py as usize * width + px as usize, ((dy + WINDOW_PX) * side + dx + WINDOW_PX) as usize)
                        })
                    })
            };
            let (mut least, mut most) = (f32::INFINITY, 0.0f32);
            for (i, _) in around() {
                (least, most) = (least.min(depth_m[i]), most.max(depth_m[i]));
            }
            if most <= JUMP * least {
                continue;
            }
            // Between the two, of which one is this pixel's own.
            let middle = 2.0 / (1.0 / least + 1.0 / most);
            let is_near = *out < middle;
            let own_look = looks[y * width + x];
            let (mut own, mut other) = (0.0, 0.0);
            let mut best = (0.0, *out);
            for (i, n) in around() {
                let apart: f32 = (0..3).map(|c| (looks[i][c] - own_look[c]).powi(2)).sum();
                let weight = nearness[n] * (-apart / (2.0 * COLOR_SIGMA * COLOR_SIGMA)).exp();
                if (depth_m[i] < middle) == is_near {
                    own += weight;
                } else {
                    other += weight;
                    if weight > best.0 {
                        best = (weight, depth_m[i]);
                    }
                }
            }
            if other > SURE * own {
                *out = best.1;
            }
        }
    });
    out
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

    #[test]
    fn a_ragged_edge_goes_where_the_colours_part() {
        // Dark at 1 m up to column 10, bright at 3 m; the depth's edge lies two columns off, to either side by turns.
        let (width, height) = (24, 16);
        let light: Vec<[f32; 3]> = (0..width * height).map(|i| [if i % width < 10 { 0.05 } else { 0.6 }; 3]).collect();
        let edge = |y: usize| if y.is_multiple_of(2) { 8 } else { 12 };
        let depth: Vec<f32> =
            (0..width * height).map(|i| if i % width < edge(i / width) { 1.0 } else { 3.0 }).collect();
        let out = on_colors(&depth, &light, width);
        for (i, z) in out.iter().enumerate() {
            assert_eq!(*z, if i % width < 10 { 1.0 } else { 3.0 }, "column {} row {}", i % width, i / width);
        }
        let wide = widened(&out, width);
        assert_eq!((wide[5 * width + 9], wide[5 * width + 10], wide[5 * width + 11]), (1.0, 1.0, 3.0));
    }

    #[test]
    fn one_colour_and_slopes_stay() {
        let depth: Vec<f32> = (0..400).map(|i| if i % 20 < 9 { 1.0 } else { 2.0 }).collect();
        assert_eq!(on_colors(&depth, &[[0.3; 3]; 400], 20), depth);
        // A floor that recedes by 2 % a row.
        let floor: Vec<f32> = (0..400).map(|i| 1.02f32.powi(20 - i / 20)).collect();
        assert_eq!(on_colors(&floor, &[[0.3; 3]; 400], 20), floor);
        assert_eq!(widened(&floor, 20), floor);
    }
}
