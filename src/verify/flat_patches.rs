//! Patches of a frame that show one smooth surface and the camera's noise.
//!
//! In each patch of 32×32 px a quadratic surface is fitted to each channel:
//!
//! ```text
//! v(x, y) = Σ c_k b_k(x, y)     b = 1, x, y, x² − m, xy, y² − m
//! x, y from −1 to 1, m = mean of x²
//! ```
//!
//! The b_k are orthogonal over the patch, so that each coefficient is a projection. The surface is
//! the clean content of the patch, the residual its noise, without six of 1024 degrees of freedom.
//!
//! A patch is flat if its residual is little stronger than the weakest ones of equal brightness in
//! the recording, not much stronger than the camera's calibrated noise, and little coarser than the
//! finest residuals: texture is coarser than noise. Weaker texture remains and counts as noise of
//! the real picture.

use std::collections::BTreeMap;

use crate::coding::YcbcrColor;
use crate::fit::quantile::lower_quantile;
use crate::grey_image::GreyImage;
use crate::measure::detectors::PATCH_PX;
use crate::pixels::Pixels;

/// Range of brightness within which patches are compared, codes.
const BRIGHTNESS_BIN_CODES: f64 = 32.0;
/// Fewest patches of a range.
const MIN_BIN_PATCHES: usize = 10;
/// Share of a range's patches that are taken for flat ones.
const FLAT_SHARE: f64 = 0.1;
/// Largest σ of Y' by that of the range's flat ones.
const MAX_SIGMA_RATIO: f64 = 1.25;
/// σ of the blur that divides coarse from fine residual, px, largest ratio of both by that of the
/// flat ones, and a σ of fine residual that keeps it finite, codes.
const COARSE_BLUR_PX: f64 = 2.0;
const MAX_COARSENESS_RATIO: f64 = 1.3;
const MIN_FINE_SIGMA: f64 = 0.05;
/// Largest σ by the calibrated one, and the rounding's σ, codes.
const MAX_SIGMA_TO_PROFILE: f64 = 2.0;
const ROUNDING_SIGMA: f64 = 0.29;
/// Codes of unclipped pixels, on the 8-bit scale.
const UNCLIPPED: std::ops::Range<f32> = 3.0..250.0;

/// R, G, B or other planes on the 8-bit scale.
pub type CodePlanes = [GreyImage; 3];

/// R, G and B of a picture, on the 8-bit scale.
pub fn code_planes(pixels: &Pixels) -> CodePlanes {
    let scale = 255.0 / pixels.max_code() as f32;
    [0, 1, 2].map(|c: usize| GreyImage::of_codes(pixels, |codes| scale * codes[c] as f32))
}

/// Y' of R, G and B.
pub fn luma([red, green, blue]: &CodePlanes) -> GreyImage {
    let (rows, _) = YcbcrColor::JFIF.forward();
    let [r, g, b] = rows[0].map(|weight| weight as f32);
    let channels = red.values.iter().zip(&green.values).zip(&blue.values);
    let values = channels.map(|((red, green), blue)| r * red + g * green + b * blue).collect();
    GreyImage { width: red.width, height: red.height, values }
}

/// The patch of a plane from a left upper pixel on.
pub fn patch_of(plane: &GreyImage, [left, top]: [usize; 2]) -> GreyImage {
    GreyImage::from_fn(PATCH_PX, PATCH_PX, |x, y| plane.values[(top + y) * plane.width + left + x])
}

/// A quadratic surface over a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuadraticSurface([f64; 6]);

impl QuadraticSurface {
    /// The values of the basis at a pixel of a patch.
    fn basis(x: usize, y: usize) -> [f64; 6] {
        let side = PATCH_PX as f64;
        let [x, y] = [x, y].map(|at| (2 * at + 1) as f64 / side - 1.0);
        let mean_square = (1.0 - 1.0 / (side * side)) / 3.0;
        [1.0, x, y, x * x - mean_square, x * y, y * y - mean_square]
    }

    /// Least squares.
    pub fn fit(patch: &GreyImage) -> Self {
        let (mut sums, mut squares) = ([0.0; 6], [0.0; 6]);
        for (i, value) in patch.values.iter().enumerate() {
            for (k, basis) in Self::basis(i % PATCH_PX, i / PATCH_PX).into_iter().enumerate() {
                sums[k] += basis * f64::from(*value);
                squares[k] += basis * basis;
            }
        }
        Self(std::array::from_fn(|k| sums[k] / squares[k]))
    }

    pub fn mean(&self) -> f64 {
        self.0[0]
    }

    pub fn at(&self, x: usize, y: usize) -> f64 {
        Self::basis(x, y).iter().zip(&self.0).map(|(basis, factor)| basis * factor).sum()
    }

    /// The patch without the surface.
    pub fn residual(&self, patch: &GreyImage) -> GreyImage {
        let value = |x: usize, y: usize| (f64::from(patch.values[y * PATCH_PX + x]) - self.at(x, y)) as f32;
        GreyImage::from_fn(PATCH_PX, PATCH_PX, value)
    }
}

/// Root mean square of a residual.
pub fn sigma_of(residual: &GreyImage) -> f64 {
    let sum: f64 = residual.values.iter().map(|value| f64::from(*value).powi(2)).sum();
    (sum / residual.values.len().max(1) as f64).sqrt()
}

/// Left upper pixels of the patches of a picture whose grid starts at `origin_px`, row by row.
pub fn patch_grid([width, height]: [usize; 2], origin_px: [usize; 2]) -> Vec<[usize; 2]> {
    let starts = |side: usize, first: usize| (first..(side + 1).saturating_sub(PATCH_PX)).step_by(PATCH_PX);
    starts(height, origin_px[1]).flat_map(|y| starts(width, origin_px[0]).map(move |x| [x, y])).collect()
}

/// The planes with each patch of the grid replaced by its surface. Pixels outside the grid stay.
pub fn smoothed(planes: &CodePlanes, grid: &[[usize; 2]]) -> CodePlanes {
    let mut smooth = planes.clone();
    for (plane, smooth) in planes.iter().zip(&mut smooth) {
        for &[left, top] in grid {
            let surface = QuadraticSurface::fit(&patch_of(plane, [left, top]));
            for (y, x) in (0..PATCH_PX).flat_map(|y| (0..PATCH_PX).map(move |x| (y, x))) {
                smooth.values[(top + y) * plane.width + left + x] = surface.at(x, y) as f32;
            }
        }
    }
    smooth
}

/// Brightness and residual of an unclipped patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchStatistics {
    pub origin_px: [usize; 2],
    /// Mean of Y', codes.
    mean: f64,
    /// Standard deviation of the residual of Y', codes.
    sigma: f64,
    /// σ of the coarse residual over that of the fine one.
    coarseness: f64,
}

/// Statistics of the unclipped patches of a grid.
pub fn patch_statistics(planes: &CodePlanes, grid: &[[usize; 2]]) -> Vec<PatchStatistics> {
    let luma = luma(planes);
    let is_unclipped =
        |at: [usize; 2]| planes.iter().all(|plane| patch_of(plane, at).values.iter().all(|v| UNCLIPPED.contains(v)));
    let statistics = |origin_px: [usize; 2]| {
        let patch = patch_of(&luma, origin_px);
        let surface = QuadraticSurface::fit(&patch);
        let residual = surface.residual(&patch);
        let coarse = residual.blurred(COARSE_BLUR_PX);
        let fine_values = residual.values.iter().zip(&coarse.values).map(|(all, coarse)| all - coarse).collect();
        let fine = GreyImage { values: fine_values, ..coarse };
        PatchStatistics {
            origin_px,
            mean: surface.mean(),
            sigma: sigma_of(&residual),
            coarseness: sigma_of(&coarse) / sigma_of(&fine).max(MIN_FINE_SIGMA),
        }
    };
    grid.iter().copied().filter(|at| is_unclipped(*at)).map(statistics).collect()
}

/// The flat patches of each frame. `profile_sigma`: calibrated σ of Y' at a code.
pub fn flat_patches(frames: &[Vec<PatchStatistics>], profile_sigma: impl Fn(f64) -> f64) -> Vec<Vec<[usize; 2]>> {
    let bin = |patch: &PatchStatistics| (patch.mean.max(0.0) / BRIGHTNESS_BIN_CODES) as usize;
    let mut by_brightness: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    frames.iter().flatten().for_each(|patch| by_brightness.entry(bin(patch)).or_default().push(patch.sigma));
    by_brightness.retain(|_, sigmas| sigmas.len() >= MIN_BIN_PATCHES);
    let weakest: BTreeMap<usize, f64> = by_brightness
        .into_iter()
        .filter_map(|(bin, mut sigmas)| Some((bin, lower_quantile(&mut sigmas, FLAT_SHARE)?)))
        .collect();
    let is_weak = |patch: &PatchStatistics| {
        let calibrated = profile_sigma(patch.mean).hypot(ROUNDING_SIGMA);
        weakest.get(&bin(patch)).is_some_and(|weakest| patch.sigma <= MAX_SIGMA_RATIO * weakest)
            && patch.sigma <= MAX_SIGMA_TO_PROFILE * calibrated
    };
    let mut coarseness: Vec<f64> =
        frames.iter().flatten().filter(|patch| is_weak(patch)).map(|patch| patch.coarseness).collect();
    let finest = lower_quantile(&mut coarseness, FLAT_SHARE).unwrap_or(0.0);
    let is_flat = |patch: &&PatchStatistics| is_weak(patch) && patch.coarseness <= MAX_COARSENESS_RATIO * finest;
    frames.iter().map(|patches| patches.iter().filter(is_flat).map(|patch| patch.origin_px).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::random::Random;

    #[test]
    fn quadratic_surface_is_recovered_and_leaves_no_residual() {
        let value = |x: usize, y: usize| {
            let [x, y] = [x as f32, y as f32];
            40.0 + 0.8 * x - 0.5 * y + 0.02 * x * x - 0.03 * x * y + 0.01 * y * y
        };
        let patch = GreyImage::from_fn(PATCH_PX, PATCH_PX, value);
        let surface = QuadraticSurface::fit(&patch);
        assert!(surface.residual(&patch).values.iter().all(|left| left.abs() < 1e-4));
        assert!((surface.at(31, 0) - f64::from(value(31, 0))).abs() < 1e-4);
        // Σ b_k b_l = 0 for all pairs: 1 and x² − m is the one that depends on m.
        let sum: f64 = (0..PATCH_PX).map(|x| QuadraticSurface::basis(x, 0)[3]).sum();
        assert!(sum.abs() < 1e-12, "{sum}");
    }

    #[test]
    fn smooth_content_follows_the_surface_and_not_the_noise() {
        let mut random = Random::new([1, 0, 0, 0]);
        let plane = GreyImage::from_fn(70, 40, |x, _| 50.0 + 2.0 * x as f32);
        let noisy =
            GreyImage { values: plane.values.iter().map(|v| v + 3.0 * random.normals()[0] as f32).collect(), ..plane };
        let grid = patch_grid([70, 40], [6, 8]);
        assert_eq!(grid, [[6, 8], [38, 8]]);
        let smooth = smoothed(&[noisy.clone(), noisy.clone(), noisy.clone()], &grid);
        for (i, value) in smooth[1].values.iter().enumerate() {
            if i % 70 >= 6 && i / 70 >= 8 {
                // Six coefficients of 1024 values: σ at a corner is at most 3·√(6·6/1024) codes.
                assert!((value - plane_value(i % 70)).abs() < 2.0, "{i}: {value}");
            } else {
                assert_eq!(*value, noisy.values[i], "outside the grid");
            }
        }
    }

    fn plane_value(x: usize) -> f32 {
        50.0 + 2.0 * x as f32
    }

    #[test]
    fn textured_clipped_and_rare_patches_are_not_flat() {
        let mut random = Random::new([2, 0, 0, 0]);
        let (across, down) = (16, 5);
        let [width, height] = [across * PATCH_PX, down * PATCH_PX];
        let stripes = |x: usize, codes: f32| if (x / 8).is_multiple_of(2) { codes } else { -codes };
        // Rows of patches: flat; strong stripes; stripes below the noise; partly white; two dark
        // ones among stripes.
        let value = |x: usize, y: usize| match y / PATCH_PX {
            0 => 100.0,
            1 => 100.0 + stripes(x, 3.0),
            2 => 100.0 + stripes(x, 0.9),
            3 if x % PATCH_PX < 3 => 255.0,
            3 => 100.0,
            _ if x < 2 * PATCH_PX => 20.0,
            _ => 100.0 + stripes(x, 30.0),
        };
        let values: Vec<f32> = (0..width * height)
            .map(|i| (value(i % width, i / width) + 1.5 * random.normals()[0] as f32).clamp(0.0, 255.0))
            .collect();
        let plane = GreyImage { width, height, values };
        let planes = [plane.clone(), plane.clone(), plane];
        let grid = patch_grid([width, height], [0, 0]);
        let statistics = patch_statistics(&planes, &grid);
        assert_eq!(statistics.len(), 4 * across, "the partly white ones are left out");
        // In two frames, so that thresholds of the recording are used.
        let (first, second) = statistics.split_at(across / 2);
        let flat = flat_patches(&[first.to_vec(), second.to_vec()], |_| 1.5);
        let rows = |patches: &[[usize; 2]], row: usize| patches.iter().filter(|[_, y]| *y == row * PATCH_PX).count();
        assert_eq!(rows(&flat[0], 0), across / 2);
        assert_eq!([0, 1, 2, 3, 4].map(|row| rows(&flat[1], row)), [across / 2, 0, 0, 0, 0]);
        let nothing: [Vec<[usize; 2]>; 1] = [Vec::new()];
        assert_eq!(flat_patches(&[statistics], |_| 0.3), nothing, "noise far above the calibrated one");
    }
}
