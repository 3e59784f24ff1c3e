//! Tone that differs across a picture, as phones do it: what is dark is brightened with what is around it, what is bright is darkened.
//!
//!   light(x) · (whole / around(x))^share
//!
//! `around` is the geometric mean of green light under a Gaussian an eighth of the picture's width wide, `whole` that of all of the
//! picture. Phones keep edges sharper than that; what they do to a surface follows in the same way from what else the picture shows.

use super::render::Picture;

/// Cells across; as many pixels down.
const CELLS: usize = 32;
/// σ of the Gaussian, cells.
const SIGMA: f64 = 4.0;
const DARKEST: f64 = 1e-4;

/// The picture with that share of its large-scale contrast taken away.
pub fn toned(mut picture: Picture, share: f64) -> Picture {
    if share == 0.0 {
        return picture;
    }
    let (width, height) = (picture.width as usize, picture.height as usize);
    let side = width.div_ceil(CELLS);
    let (columns, rows) = (width.div_ceil(side), height.div_ceil(side));
    let (mut sums, mut counts) = (vec![0.0; columns * rows], vec![0.0; columns * rows]);
    for (i, light) in picture.light.iter().enumerate() {
        let cell = i / width / side * columns + i % width / side;
        sums[cell] += f64::from(light[1]).max(DARKEST).ln();
        counts[cell] += 1.0;
    }
    let whole = sums.iter().sum::<f64>() / counts.iter().sum::<f64>();
    let around = |cell: usize| {
        let (x, y) = (cell % columns, cell / columns);
        let (mut sum, mut weights) = (0.0, 0.0);
        for other in 0..columns * rows {
            let apart = (other % columns).abs_diff(x).pow(2) + (other / columns).abs_diff(y).pow(2);
            let weight = (-0.5 * apart as f64 / (SIGMA * SIGMA)).exp();
            sum += weight * sums[other];
            weights += weight * counts[other];
        }
        share * (whole - sum / weights)
    };
    let field: Vec<f64> = (0..columns * rows).map(around).collect();
    let along = |at: usize, cells: usize| {
        let at = ((at as f64 + 0.5) / side as f64 - 0.5).clamp(0.0, (cells - 1) as f64);
        let cell = (at as usize).min(cells.saturating_sub(2));
        (cell, (cell + 1).min(cells - 1), at - cell as f64)
    };
    for (i, light) in picture.light.iter_mut().enumerate() {
        let ((left, right, x), (above, below, y)) = (along(i % width, columns), along(i / width, rows));
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
    fn halves() -> Picture {
        let light = (0..320 * 240).map(|i| if i % 320 < 160 { [0.1; 3] } else { [0.4; 3] }).collect();
        Picture { width: 320, height: 240, light, depth_m: vec![1.0; 320 * 240], most_blur_px: 0.0 }
    }

    #[test]
    fn contrast_falls_by_its_share_and_nothing_else_does() {
        let at = |picture: &Picture, x: usize| picture.light[120 * 320 + x][1];
        let by_half = toned(halves(), 0.5);
        // Far from the border the surroundings are the half's own: 0.2 · (0.1 / 0.2)^0.5, and the square root of 4 between them.
        assert!((at(&by_half, 20) - 0.1414).abs() < 0.003, "{}", at(&by_half, 20));
        assert!((at(&by_half, 300) / at(&by_half, 20) - 2.0).abs() < 0.05);
        // What is a step stays one.
        assert!((at(&by_half, 160) / at(&by_half, 159) - 4.0).abs() < 0.1);
        assert_eq!(toned(halves(), 0.0).light, halves().light);
    }
}
