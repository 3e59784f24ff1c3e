//! The displacement of one picture's content relative to another's, by phase correlation of patches
//! (Kuglin and Hines 1975).
//!
//! Each patch is weighted with a Hann window. Its cross-power spectrum, whitened and transformed
//! back, peaks at the whole-pixel shift. The fraction is the slope of the phase plane: the d that
//! maximises Σ W(k)·cos(arg C(k) − k·d) over the low frequencies, W = |C| (noise-weighted least
//! squares of the phases, for small errors). The second picture's patch is then resampled at that
//! shift (bicubic), so that the window does not pull towards 0. This repeats until no shift
//! remains.
//!
//! The standard error is that of the least-squares shift between the two aligned patches
//! ([`standard_error`]). Along a straight edge it is unbounded.

use super::{MeasureError, check_mask};
use crate::fit::quantile::midpoint_median;
use crate::grey_image::GreyImage;
use glam::{DMat2, DVec2};
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Selection and acceptance of patches.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplacementOptions {
    /// Side of a patch, pixels, 8 to 512.
    pub patch_px: usize,
    /// Distance between patches, pixels.
    pub step_px: usize,
    /// Patches with a smaller windowed standard deviation are skipped, in the pictures' unit.
    pub min_contrast: f64,
    /// Minimum agreement of the phases, 0 to 1; patches below are unreliable.
    pub min_confidence: f64,
    /// Maximum standard error along the weakest direction, pixels; patches above are unreliable.
    pub max_sigma_px: f64,
    /// Share of a patch that must lie in the mask, 0 to 1.
    pub min_mask_share: f64,
}

impl Default for DisplacementOptions {
    fn default() -> Self {
        Self {
            patch_px: 32,
            step_px: 16,
            min_contrast: 2.0,
            min_confidence: 0.75,
            max_sigma_px: 0.4,
            min_mask_share: 0.95,
        }
    }
}

/// One patch's displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchDisplacement {
    /// The patch's centre in the first picture, raster coordinates.
    pub centre_px: [f64; 2],
    /// Content at x in the first picture is at x + this in the second.
    pub displacement_px: [f64; 2],
    /// Weighted agreement of the phases: 0 to 1.
    pub confidence: f64,
    /// Standard error along the weakest direction, pixels.
    pub sigma_px: f64,
}

/// The displacements of all patches.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Displacements {
    pub patches: Vec<PatchDisplacement>,
    /// Number of skipped patches: outside the mask; without contrast, or without texture in some
    /// direction; unreliable.
    pub masked: usize,
    pub flat: usize,
    pub unreliable: usize,
}

impl Displacements {
    /// Median length of the displacements, pixels. `None` without patches.
    pub fn median_length_px(&self) -> Option<f64> {
        midpoint_median(self.patches.iter().map(|p| p.displacement_px[0].hypot(p.displacement_px[1])))
    }

    /// Median along x and along y, pixels. `None` without patches.
    pub fn median_px(&self) -> Option<[f64; 2]> {
        Some([
            midpoint_median(self.patches.iter().map(|p| p.displacement_px[0]))?,
            midpoint_median(self.patches.iter().map(|p| p.displacement_px[1]))?,
        ])
    }
}

/// Measures the displacement of `b`'s content relative to `a`'s, patch by patch where `mask` is
/// true (at `a`'s position).
pub fn displacements(
    a: &GreyImage<f64>,
    b: &GreyImage<f64>,
    mask: Option<&[bool]>,
    options: &DisplacementOptions,
) -> Result<Displacements, MeasureError> {
    if (a.width, a.height) != (b.width, b.height) {
        let size = |of: &GreyImage<f64>| format!("{}x{}", of.width, of.height);
        return Err(MeasureError::Sizes { a: size(a), b: size(b) });
    }
    check_mask(mask, a.width * a.height)?;
    let side = options.patch_px;
    if !(8..=512).contains(&side) {
        return Err(MeasureError::Option { what: "patch_px", actual: side as f64, accepted: "8 to 512" });
    }
    if options.step_px == 0 {
        return Err(MeasureError::Option { what: "step_px", actual: 0.0, accepted: "1 or more" });
    }
    let correlator = Correlator::new(side);
    let mut all = Displacements::default();
    for y in (0..(a.height + 1).saturating_sub(side)).step_by(options.step_px) {
        for x in (0..(a.width + 1).saturating_sub(side)).step_by(options.step_px) {
            if let Some(mask) = mask {
                let inside: usize =
                    (y..y + side).map(|row| mask[row * a.width + x..][..side].iter().filter(|m| **m).count()).sum();
                if (inside as f64) < options.min_mask_share * (side * side) as f64 {
                    all.masked += 1;
                    continue;
                }
            }
            match correlator.measure(a, b, x, y, options) {
                PatchResult::Flat => all.flat += 1,
                PatchResult::Unreliable => all.unreliable += 1,
                PatchResult::Displaced(patch) => all.patches.push(patch),
            }
        }
    }
    Ok(all)
}

enum PatchResult {
    Flat,
    Unreliable,
    Displaced(PatchDisplacement),
}

type Spectrum = Vec<Complex<f64>>;

struct Correlator {
    side: usize,
    window: Vec<f64>,
    fft: Arc<dyn Fft<f64>>,
}

impl Correlator {
    fn new(side: usize) -> Self {
        let mut planner = FftPlanner::new();
        let hann = |i: usize| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / side as f64).cos();
        let window = (0..side * side).map(|i| hann(i % side) * hann(i / side)).collect();
        Self { side, window, fft: planner.plan_fft_forward(side) }
    }

    fn measure(
        &self,
        a: &GreyImage<f64>,
        b: &GreyImage<f64>,
        x: usize,
        y: usize,
        options: &DisplacementOptions,
    ) -> PatchResult {
        let (spectrum_a, contrast_a) = self.patch(a, x as f64, y as f64);
        let (_, contrast_b) = self.patch(b, x as f64, y as f64);
        let contrast = contrast_a.min(contrast_b);
        if contrast.is_nan() || contrast < options.min_contrast {
            return PatchResult::Flat;
        }
        let mut shift = [0.0; 2];
        for _ in 0..4 {
            // The closer the windows, the more content they share, so it is repeated until the peak
            // stays.
            let (moved, _) = self.patch(b, x as f64 + shift[0], y as f64 + shift[1]);
            let rest = self.peak(&cross(&spectrum_a, &moved));
            shift = [shift[0] + rest[0], shift[1] + rest[1]];
            if rest == [0.0; 2] {
                break;
            }
        }
        let mut confidence = 0.0;
        for _ in 0..6 {
            let (moved, contrast) = self.patch(b, x as f64 + shift[0], y as f64 + shift[1]);
            if contrast <= 0.0 {
                return PatchResult::Unreliable;
            }
            let (rest, agreement) = self.slope(&cross(&spectrum_a, &moved));
            confidence = agreement;
            shift = [shift[0] + rest[0], shift[1] + rest[1]];
            if rest[0].hypot(rest[1]) < 1e-3 {
                break;
            }
        }
        // Beyond half a patch, the two windows have different content.
        if confidence < options.min_confidence || shift[0].hypot(shift[1]) > 0.5 * self.side as f64 {
            return PatchResult::Unreliable;
        }
        let here = resampled(a, x as f64, y as f64, self.side);
        let there = resampled(b, x as f64 + shift[0], y as f64 + shift[1], self.side);
        let sigma_px = standard_error(&here, &there, &self.window, self.side);
        if sigma_px > options.max_sigma_px {
            return PatchResult::Flat;
        }
        let half = 0.5 * self.side as f64;
        let centre_px = [x as f64 + half, y as f64 + half];
        PatchResult::Displaced(PatchDisplacement { centre_px, displacement_px: shift, confidence, sigma_px })
    }

    /// The windowed patch's spectrum, and its weighted standard deviation.
    fn patch(&self, picture: &GreyImage<f64>, x: f64, y: f64) -> (Spectrum, f64) {
        let values = resampled(picture, x, y, self.side);
        let weight: f64 = self.window.iter().sum();
        let mean = values.iter().zip(&self.window).map(|(v, w)| v * w).sum::<f64>() / weight;
        let variance = values.iter().zip(&self.window).map(|(v, w)| w * (v - mean).powi(2)).sum::<f64>() / weight;
        let mut spectrum: Spectrum =
            values.iter().zip(&self.window).map(|(v, w)| Complex::new((v - mean) * w, 0.0)).collect();
        self.both_ways(&mut spectrum);
        (spectrum, variance.sqrt())
    }

    fn both_ways(&self, data: &mut [Complex<f64>]) {
        self.fft.process(data);
        for row in 0..self.side {
            for column in 0..row {
                data.swap(row * self.side + column, column * self.side + row);
            }
        }
        // The result stays transposed: frequency (kx, ky) is at kx * side + ky.
        self.fft.process(data);
    }

    /// The whole-pixel shift at which the phases of `cross` agree best.
    fn peak(&self, cross: &Spectrum) -> [f64; 2] {
        // A compromise between phase correlation, which frequencies without content corrupt, and
        // plain correlation, whose peak is wide.
        let mut phases: Spectrum =
            cross.iter().map(|c| if c.norm() > 0.0 { c / c.norm().sqrt() } else { *c }).collect();
        // The phase of `cross` rises with frequency times shift, so the forward transform peaks at
        // the shift.
        self.both_ways(&mut phases);
        // Transposed twice: rows are rows again.
        let best = (0..phases.len()).max_by(|&i, &j| phases[i].re.total_cmp(&phases[j].re)).unwrap_or(0);
        let signed = |i: usize| if 2 * i > self.side { i as f64 - self.side as f64 } else { i as f64 };
        [signed(best % self.side), signed(best / self.side)]
    }

    /// The shift given by the slope of the phases, and their agreement with it, 0 to 1.
    fn slope(&self, cross: &Spectrum) -> ([f64; 2], f64) {
        let n = self.side as i64;
        // Above half of Nyquist, aliasing and interpolation corrupt the phases.
        let reach = n / 4;
        let mut terms = Vec::new();
        for kx in -reach..=reach {
            for ky in -reach..=reach {
                if (kx, ky) > (0, 0) && kx * kx + ky * ky <= reach * reach {
                    let c = cross[(kx.rem_euclid(n) * n + ky.rem_euclid(n)) as usize];
                    terms.push((TAU * kx as f64 / n as f64, TAU * ky as f64 / n as f64, c.arg(), c.norm()));
                }
            }
        }
        let total: f64 = terms.iter().map(|t| t.3).sum();
        if total <= 0.0 {
            return ([0.0; 2], 0.0);
        }
        let mut d = [0.0f64; 2];
        for _ in 0..20 {
            // Newton's method on Σ w cos(φ − ω·d), with cos clamped to at least 0.1 so that it
            // ascends.
            let (mut g, mut h) = ([0.0; 2], [0.0; 3]);
            for &(wx, wy, phase, weight) in &terms {
                let rest = phase - wx * d[0] - wy * d[1];
                let (sin, cos) = (weight * rest.sin(), weight * rest.cos().max(0.1));
                g = [g[0] + sin * wx, g[1] + sin * wy];
                h = [h[0] + cos * wx * wx, h[1] + cos * wx * wy, h[2] + cos * wy * wy];
            }
            let determinant = h[0] * h[2] - h[1] * h[1];
            if determinant <= 1e-12 * h[0] * h[2] {
                break;
            }
            let step = [(h[2] * g[0] - h[1] * g[1]) / determinant, (h[0] * g[1] - h[1] * g[0]) / determinant];
            d = [d[0] + step[0].clamp(-0.5, 0.5), d[1] + step[1].clamp(-0.5, 0.5)];
            if step[0].hypot(step[1]) < 1e-5 {
                break;
            }
        }
        let agreement = terms.iter().map(|&(wx, wy, phase, w)| w * (phase - wx * d[0] - wy * d[1]).cos()).sum::<f64>();
        (d, agreement / total)
    }
}

/// Standard error of the shift between two aligned patches along its weakest direction, pixels;
/// infinite where their texture does not define a shift.
///
/// Both are smoothed (binomial, σ 1 px), to the frequencies that the phases use. With window w,
/// slopes ∇a and ∇b, and the difference r, least squares (Lucas and Kanade 1981) has the covariance
/// of unequal variances (White 1980)
///
///   J⁻¹ S J⁻¹,   J = Σ w²·sym(∇a ∇bᵀ),   S = κ·½·Σ w⁴ r²·(∇a ∇aᵀ + ∇b ∇bᵀ)
///
/// Noise of the two pictures is independent and vanishes from ∇a ∇bᵀ, so that an edge with noise
/// has no slope along itself. Neighbouring r correlate by ρ: along each axis κ = Σ exp(−d²/2L²) ≈
/// √(2π)·L with ρ = exp(−1/2L²), so κ = √(−π/ln ρ). The result is the true error where r is noise,
/// and up to twice the error where blur or depth leave structure in r.
fn standard_error(a: &[f64], b: &[f64], window: &[f64], side: usize) -> f64 {
    let (a, b) = (smoothed(a, side), matched_brightness(a, b, window));
    let b = smoothed(&b, side);
    let slopes = |of: &[f64], p: usize| DVec2::new(of[p + 1] - of[p - 1], of[p + side] - of[p - side]) / 2.0;
    let (mut information, mut scatter) = (DMat2::ZERO, DMat2::ZERO);
    let (mut power, mut lagged) = (0.0, DVec2::ZERO);
    for y in 3..side - 3 {
        for x in 3..side - 3 {
            let p = y * side + x;
            let (of_a, of_b) = (slopes(&a, p), slopes(&b, p));
            let w = window[p] * window[p];
            let rest = |p: usize| a[p] - b[p];
            let outer = |u: DVec2, v: DVec2| DMat2::from_cols(u * v.x, u * v.y);
            information += 0.5 * w * (outer(of_a, of_b) + outer(of_b, of_a));
            scatter += 0.5 * (w * rest(p)).powi(2) * (outer(of_a, of_a) + outer(of_b, of_b));
            power += w * rest(p).powi(2);
            lagged += w * rest(p) * DVec2::new(rest(p + 1), rest(p + side));
        }
    }
    let [weak, _] = eigenvalues(information);
    if weak.is_nan() || weak <= 0.0 {
        return f64::INFINITY;
    }
    let rho = (lagged / power.max(1e-12)).clamp(DVec2::splat(0.01), DVec2::splat(0.99));
    let correlation_length = |rho: f64| (-PI / rho.ln()).sqrt().max(1.0);
    let kappa = correlation_length(rho.x) * correlation_length(rho.y);
    let inverse = information.inverse();
    let [_, variance] = eigenvalues(kappa * (inverse * scatter * inverse));
    variance.sqrt()
}

/// `b` with the brightness and contrast of `a`, by weighted least squares.
fn matched_brightness(a: &[f64], b: &[f64], window: &[f64]) -> Vec<f64> {
    let weight: f64 = window.iter().sum();
    let mean = |of: &[f64]| of.iter().zip(window).map(|(v, w)| v * w).sum::<f64>() / weight;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let (mut both, mut own) = (0.0, 0.0);
    for ((a, b), w) in a.iter().zip(b).zip(window) {
        both += w * (a - mean_a) * (b - mean_b);
        own += w * (b - mean_b).powi(2);
    }
    let gain = both / own.max(1e-12);
    b.iter().map(|b| mean_a + gain * (b - mean_b)).collect()
}

/// Binomial smoothing of five pixels along both axes; two pixels at the border are unchanged.
fn smoothed(patch: &[f64], side: usize) -> Vec<f64> {
    let pass = |of: &[f64], step: usize, inside: &dyn Fn(usize) -> bool| -> Vec<f64> {
        let at = |p: usize| {
            if !inside(p) {
                return of[p];
            }
            (of[p - 2 * step] + of[p + 2 * step] + 4.0 * (of[p - step] + of[p + step]) + 6.0 * of[p]) / 16.0
        };
        (0..of.len()).map(at).collect()
    };
    let along = pass(patch, 1, &|p| (2..side - 2).contains(&(p % side)));
    pass(&along, side, &|p| (2..side - 2).contains(&(p / side)))
}

/// Eigenvalues of a symmetric matrix, the smaller first.
fn eigenvalues(m: DMat2) -> [f64; 2] {
    let middle = 0.5 * (m.x_axis.x + m.y_axis.y);
    let half = (0.5 * (m.x_axis.x - m.y_axis.y)).hypot(m.x_axis.y);
    [middle - half, middle + half]
}

/// Spectrum of `a` times the conjugate of `b`'s: its phase rises with the frequency times the shift
/// from a to b.
fn cross(a: &Spectrum, b: &Spectrum) -> Spectrum {
    a.iter().zip(b).map(|(a, b)| a * b.conj()).collect()
}

/// A square of `side` pixels whose corner is at (x, y) pixels, interpolated bicubically
/// (Catmull-Rom).
fn resampled(picture: &GreyImage<f64>, x: f64, y: f64, side: usize) -> Vec<f64> {
    let (i, j) = (x.floor(), y.floor());
    let (wx, wy) = (cubic(x - i), cubic(y - j));
    let (i, j) = (i as i64 - 1, j as i64 - 1);
    // Along rows first: side + 3 of them.
    let rows: Vec<f64> = (0..side as i64 + 3)
        .flat_map(|row| (0..side as i64).map(move |column| (row, column)))
        .map(|(row, column)| (0..4).map(|k| wx[k as usize] * picture.clamped(i + column + k, j + row)).sum())
        .collect();
    (0..side * side).map(|p| (0..4).map(|k| wy[k] * rows[p + k * side]).sum()).collect()
}

fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, -0.5 * t2 + 0.5 * t3]
}
