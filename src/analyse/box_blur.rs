//! Box blur of picture blocks along a flow, for a grid of exposures.

use glam::DVec2;

use crate::grey_image::GreyImage;

/// Side of a block, px.
pub const BLOCK: usize = 16;

/// A grid of exposures: 0, step, 2·step, … s.
#[derive(Clone, Copy, Debug)]
pub struct ExposureGrid {
    pub step_s: f64,
    pub count: usize,
}

pub const PIXELS: usize = BLOCK * BLOCK;
/// A square block of a picture, row by row.
pub type Block = [f32; PIXELS];

/// Samples a block of a plane at a subpixel offset; `None` where it reaches beyond the plane. Cubic
/// convolution, which hardly blurs.
pub fn sample_block(plane: &GreyImage, x: usize, y: usize, by: DVec2, out: &mut Block) -> Option<()> {
    const ROWS: usize = BLOCK + 3;
    let (px, py) = (x as f64 + by.x, y as f64 + by.y);
    let (column, row) = (px.floor(), py.floor());
    let last = (BLOCK + 1) as f64;
    if !(column >= 1.0 && row >= 1.0 && column + last < plane.width as f64 && row + last < plane.height as f64) {
        return None;
    }
    let [a, b, c, d] = cubic_weights((px - column) as f32);
    let (column, row) = (column as usize - 1, row as usize - 1);
    let mut across = [[0.0f32; BLOCK]; ROWS];
    for (dy, out) in across.iter_mut().enumerate() {
        let i = (row + dy) * plane.width + column;
        let v = &plane.values[i..i + BLOCK + 3];
        for (dx, out) in out.iter_mut().enumerate() {
            *out = a * v[dx] + b * v[dx + 1] + c * v[dx + 2] + d * v[dx + 3];
        }
    }
    let [a, b, c, d] = cubic_weights((py - py.floor()) as f32);
    for (dy, out) in out.as_chunks_mut::<BLOCK>().0.iter_mut().enumerate() {
        for (dx, out) in out.iter_mut().enumerate() {
            *out = a * across[dy][dx] + b * across[dy + 1][dx] + c * across[dy + 2][dx] + d * across[dy + 3][dx];
        }
    }
    Some(())
}

/// Weights of cubic convolution for four values, at a fraction beyond the second (Keys 1981, a =
/// −½).
pub fn cubic_weights(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [-0.5 * f3 + f2 - 0.5 * f, 1.5 * f3 - 2.5 * f2 + 1.0, -1.5 * f3 + 2.0 * f2 + 0.5 * f, 0.5 * f3 - 0.5 * f2]
}

/// A block blurred along a flow (px/s) for each exposure s of the grid: the mean over −s/2 ≤ t ≤
/// s/2 of the picture at x + v·t. `None` where the longest blur reaches beyond the picture.
///
/// yₖ is the mean of the picture at x ± v·k·step. An exposure of 2k steps reaches to yₖ, one of 2k
/// − 1 to half a step before. Its mean follows from the trapezoidal and the midpoint rule, each
/// with the end correction of Euler and Maclaurin, so that it is exact for a parabola:
///
///   2k steps:      (y₀/2 + y₁ + … + yₖ₋₁ + yₖ/2 − (yₖ₊₁ − yₖ₋₁)/24) / k
///   2k − 1 steps:  (y₀/2 + y₁ + … + yₖ₋₁ + (yₖ − yₖ₋₁)/24) / (k − ½)
pub fn box_blurred(
    plane: &GreyImage,
    x: usize,
    y: usize,
    flow: DVec2,
    grid: ExposureGrid,
    out: &mut Vec<Block>,
) -> Option<()> {
    out.clear();
    let mut before = [0.0; PIXELS];
    sample_block(plane, x, y, DVec2::ZERO, &mut before)?;
    out.push(before);
    let mut sum: Block = before.map(|value| 0.5 * value);
    let (mut ahead, mut behind) = ([0.0; PIXELS], [0.0; PIXELS]);
    let mut sample = |k: usize| -> Option<Block> {
        let by = flow * (k as f64 * grid.step_s);
        sample_block(plane, x, y, by, &mut ahead)?;
        sample_block(plane, x, y, -by, &mut behind)?;
        Some(std::array::from_fn(|p| 0.5 * (ahead[p] + behind[p])))
    };
    let mut here = sample(1)?;
    for k in 1.. {
        let steps = k as f32;
        if out.len() < grid.count {
            out.push(std::array::from_fn(|p| (sum[p] + (here[p] - before[p]) / 24.0) / (steps - 0.5)));
        }
        if out.len() == grid.count {
            break;
        }
        let after = sample(k + 1)?;
        out.push(std::array::from_fn(|p| (sum[p] + 0.5 * here[p] - (after[p] - before[p]) / 24.0) / steps));
        sum.iter_mut().zip(&here).for_each(|(sum, value)| *sum += value);
        (before, here) = (here, after);
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The value at (24, 24) of the picture `value(x, y)`, blurred by `flow` for each exposure of
    /// the grid.
    fn blurred(value: impl Fn(f32, f32) -> f32, flow: DVec2) -> Vec<f32> {
        let values = (0..48 * 48).map(|i| value((i % 48) as f32, (i / 48) as f32)).collect();
        let plane = GreyImage { width: 48, height: 48, values };
        let mut out = Vec::new();
        box_blurred(&plane, 16, 16, flow, ExposureGrid { step_s: 0.001, count: 5 }, &mut out).unwrap();
        out.iter().map(|block| block[8 * BLOCK + 8]).collect()
    }

    #[test]
    fn blurred_parabola_matches_the_analytic_mean() {
        // The mean of x² over ±h is h²/3, over n steps of 1 px n²/12.
        let along = blurred(|x, _| (x - 24.0).powi(2), DVec2::new(1000.0, 0.0));
        for (actual, expected) in along.iter().zip([0.0, 1.0 / 12.0, 1.0 / 3.0, 0.75, 4.0 / 3.0]) {
            assert!((actual - expected).abs() < 1e-5, "{along:?}");
        }
        assert_eq!(along.len(), 5);
        // The sign of the flow does not matter, and a blur along the other axis has no effect.
        assert_eq!(blurred(|x, _| (x - 24.0).powi(2), DVec2::new(-1000.0, 0.0)), along);
        assert_eq!(blurred(|_, y| (y - 24.0).powi(2), DVec2::new(1000.0, 0.0)), [0.0; 5]);
        // A linear ramp does not change.
        let slope = blurred(|x, y| 2.0 * x + y, DVec2::new(700.0, -300.0));
        assert!(slope.iter().all(|value| (value - 72.0).abs() < 1e-4), "{slope:?}");
    }

    #[test]
    fn blur_that_reaches_beyond_the_picture_is_refused() {
        let plane = GreyImage::uniform(48, 48, 1.0);
        let grid = ExposureGrid { step_s: 0.001, count: 5 };
        assert!(box_blurred(&plane, 16, 16, DVec2::new(9000.0, 0.0), grid, &mut Vec::new()).is_none());
        assert!(box_blurred(&plane, 40, 16, DVec2::ZERO, grid, &mut Vec::new()).is_none());
    }
}
