//! Local tone mapping as in phones: dark regions are brightened, bright regions darkened.
//!
//! light(x) · (whole / around(x))^share
//!
//! `around` is the geometric mean of green light under a Gaussian with σ of an eighth of the
//! picture's width, `whole` the geometric mean of the entire picture. Phones preserve edges better;
//! the dependence of a surface's brightness on the rest of the picture is the same.

use super::render::SimulatedPicture;

/// Cells across; the cells are square.
const CELLS_ACROSS: usize = 32;
/// σ of the Gaussian, cells.
const SIGMA_CELLS: f64 = 4.0;
const MIN_LIGHT: f64 = 1e-4;

/// Reduces the large-scale contrast of a picture by a share.
pub fn locally_tone_mapped(mut picture: SimulatedPicture, share: f64) -> SimulatedPicture {
    if share == 0.0 {
        return picture;
    }
    let (width, height) = (picture.width as usize, picture.height as usize);
    let side = width.div_ceil(CELLS_ACROSS);
    let (columns, rows) = (width.div_ceil(side), height.div_ceil(side));
    let (mut sums, mut counts) = (vec![0.0; columns * rows], vec![0.0; columns * rows]);
    for (i, light) in picture.light.iter().enumerate() {
        let cell = i / width / side * columns + i % width / side;
        sums[cell] += f64::from(light[1]).max(MIN_LIGHT).ln();
        counts[cell] += 1.0;
    }
    let whole = sums.iter().sum::<f64>() / counts.iter().sum::<f64>();
    let cell_mean = |cell: usize| {
        let (x, y) = (cell % columns, cell / columns);
        let (mut sum, mut weights) = (0.0, 0.0);
        for other in 0..columns * rows {
            let squared_distance = (other % columns).abs_diff(x).pow(2) + (other / columns).abs_diff(y).pow(2);
            let weight = (-0.5 * squared_distance as f64 / (SIGMA_CELLS * SIGMA_CELLS)).exp();
            sum += weight * sums[other];
            weights += weight * counts[other];
        }
        share * (whole - sum / weights)
    };
    let field: Vec<f64> = (0..columns * rows).map(cell_mean).collect();
    let cells_and_share = |at: usize, cells: usize| {
        let at = ((at as f64 + 0.5) / side as f64 - 0.5).clamp(0.0, (cells - 1) as f64);
        let cell = (at as usize).min(cells.saturating_sub(2));
        (cell, (cell + 1).min(cells - 1), at - cell as f64)
    };
    for (i, light) in picture.light.iter_mut().enumerate() {
        let ((left, right, x), (above, below, y)) =
            (cells_and_share(i % width, columns), cells_and_share(i / width, rows));
        let row = |row: usize| (1.0 - x) * field[row * columns + left] + x * field[row * columns + right];
        let factor = ((1.0 - y) * row(above) + y * row(below)).exp() as f32;
        *light = light.map(|light| light * factor);
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The left half is four times as dark as the right one.
    fn halves() -> SimulatedPicture {
        let light = (0..320 * 240).map(|i| if i % 320 < 160 { [0.1; 3] } else { [0.4; 3] }).collect();
        SimulatedPicture { width: 320, height: 240, light, depth_m: vec![1.0; 320 * 240], max_blur_px: 0.0 }
    }

    #[test]
    fn local_tone_reduces_large_scale_contrast_only() {
        let at = |picture: &SimulatedPicture, x: usize| picture.light[120 * 320 + x][1];
        let by_half = locally_tone_mapped(halves(), 0.5);
        // Far from the border the surroundings are the half itself: 0.2 · (0.1 / 0.2)^0.5, and the
        // square root of 4 between the halves.
        assert!((at(&by_half, 20) - 0.1414).abs() < 0.003, "{}", at(&by_half, 20));
        assert!((at(&by_half, 300) / at(&by_half, 20) - 2.0).abs() < 0.05);
        // A step edge stays sharp.
        assert!((at(&by_half, 160) / at(&by_half, 159) - 4.0).abs() < 0.1);
        assert_eq!(locally_tone_mapped(halves(), 0.0).light, halves().light);
    }
}
