//! Extrapolates the depth and light of the background behind the edges of the nearest surface.
//!
//! A blurred edge transmits light from places that no camera saw (one step of the layered depth
//! images of Shade et al. 1998). The surface beside an edge is extended behind it, pixel by pixel.
//! Each new pixel is the mean of the known background pixels around it.

use super::discontinuity::DEPTH_STEP;

/// Depth and linear light of the background, row by row, extrapolated up to `reach_px` inwards from
/// an edge. Elsewhere they are the surface's own.
pub fn extrapolate_background(
    depth_m: &[f32],
    light: &[[f32; 3]],
    width: usize,
    reach_px: usize,
) -> (Vec<f32>, Vec<[f32; 3]>) {
    let height = depth_m.len() / width.max(1);
    let (mut background_m, mut background_light) = (depth_m.to_vec(), light.to_vec());
    let mut is_extrapolated = vec![false; depth_m.len()];
    let neighbours = |i: usize| {
        let (x, y) = ((i % width) as i32, (i / width) as i32);
        (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (x + dx, y + dy))).filter_map(move |(px, py)| {
            let inside = px >= 0 && py >= 0 && px < width as i32 && py < height as i32 && (px, py) != (x, y);
            inside.then(|| py as usize * width + px as usize)
        })
    };
    let is_background = |z: f32, i: usize| z > DEPTH_STEP * depth_m[i];
    let mut edge: Vec<usize> =
        (0..depth_m.len()).filter(|&i| neighbours(i).any(|n| is_background(depth_m[n], i))).collect();
    for _ in 0..reach_px {
        let mut new = Vec::with_capacity(edge.len());
        for &i in &edge {
            // Means of neighbours that are background, recorded or extrapolated before.
            let mut sum = [0.0f32; 5];
            for n in neighbours(i).filter(|&n| is_background(background_m[n], i)) {
                let [r, g, b] = background_light[n];
                for (sum, part) in sum.iter_mut().zip([r, g, b, 1.0 / background_m[n], 1.0]) {
                    *sum += part;
                }
            }
            if sum[4] > 0.0 {
                new.push((i, sum[4] / sum[3], [0, 1, 2].map(|c| sum[c] / sum[4])));
            }
        }
        for &(i, z, light) in &new {
            (background_m[i], background_light[i], is_extrapolated[i]) = (z, light, true);
        }
        let mut next: Vec<usize> = new
            .iter()
            .flat_map(|&(i, z, _)| neighbours(i).map(move |n| (n, z)))
            .filter(|&(n, z)| !is_extrapolated[n] && is_background(z, n))
            .map(|(n, _)| n)
            .collect();
        next.sort_unstable();
        next.dedup();
        if next.is_empty() {
            break;
        }
        edge = next;
    }
    (background_m, background_light)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn background_beside_an_edge_extends_behind_it() {
        // A dark post at 1 m, columns 8 to 15, in front of a wall at 2 m that is brighter on the
        // right.
        let (width, height) = (24, 9);
        let depth: Vec<f32> =
            (0..width * height).map(|i| if (8..16).contains(&(i % width)) { 1.0 } else { 2.0 }).collect();
        let wall = |x: usize| if x < 12 { 0.2 } else { 0.8 };
        let light: Vec<[f32; 3]> =
            (0..width * height).map(|i| if depth[i] < 1.5 { [0.0; 3] } else { [wall(i % width); 3] }).collect();
        let (background_m, background_light) = extrapolate_background(&depth, &light, width, 3);
        for i in 0..width * height {
            let x = i % width;
            let uncovered = (8..11).contains(&x) || (13..16).contains(&x);
            assert_eq!(background_m[i], if depth[i] < 1.5 && !uncovered { 1.0 } else { 2.0 }, "column {x}");
            let expected = if uncovered { wall(x) } else { light[i][0] };
            assert!((background_light[i][1] - expected).abs() < 1e-6, "column {x}");
        }
    }
}
