//! Repeats of residue within a picture (copy-move detection by matching of blocks: Fridrich,
//! Soukal and Lukáš 2003; here of the noise residue, at all offsets).
//!
//! The residue is Y' minus its Gaussian blur (σ = 2 px), over its local standard deviation, clipped
//! at 3. Each tile of 32×32 px is correlated with every other place of a window of at most 512×512
//! px around it; the products come from Fourier transforms, the means and variances from
//! summed-area tables. Independent residues have correlations of mean 0 and variance
//!
//! ```text
//! σ² = Σ_k r(k)² / n          n = 32²,  r the residue's autocorrelation (Bartlett 1946)
//! ```
//!
//! The threshold is the smallest z σ with M·φ(z)/z = α, an upper bound on the probability that any
//! of M places of the whole picture exceeds it by chance. Edges and textures repeat as well: a tile
//! that correlates with places that overlap it, beyond the reach of the noise's own correlation, is
//! textured and does not count. This misses similar edges that lie apart, so photographs without
//! any copy have a few repeats (docs/detectors.md). Repeats at less than 32 px are not detected.

use super::PatchSource;
use super::fft::Fft2;
use super::patches::{DetectorPatch, PATCH_PX, rgb_planes, ycbcr};
use crate::grey_image::GreyImage;
use rustfft::num_complex::Complex32;
use std::collections::BTreeMap;

/// Side of the window in which a tile's repeats are sought, px, and distance between windows.
const WINDOW_PX: usize = 512;
const WINDOW_STEP_PX: usize = WINDOW_PX / 2;
const BLUR_SIGMA_PX: f64 = 2.0;
/// Extent of the local standard deviation, px.
const LOCAL_SIGMA_PX: f64 = 4.0;
/// Residue is clipped here, local standard deviations.
const MAX_RESIDUE: f32 = 3.0;
/// Smallest local standard deviation, codes: that of rounding.
const MIN_DEVIATION: f32 = 0.3;
/// Largest lag at which noise is correlated with itself, px.
const NOISE_REACH_PX: usize = 6;
/// Probability that a picture of independent residues has any repeat.
const FALSE_ALARM: f64 = 0.01;

/// A tile, and the place that correlates with it most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileMatch {
    /// Left upper pixel of the tile.
    pub origin_px: [usize; 2],
    /// Left upper pixel of the place, at least 32 px away along rows or columns.
    pub match_px: [usize; 2],
    /// Correlation of the residues, −1 to 1.
    pub correlation: f64,
    /// Correlation that independent residues exceed nowhere in the picture, with a probability of
    /// at least 99 %. Content that repeats exceeds it: the real picture of a pair is the floor.
    pub threshold: f64,
    /// True if the tile correlates with its own surroundings as an edge or a texture does.
    pub is_textured: bool,
}

impl TileMatch {
    /// True if the tile is a repeat, or is repeated.
    pub fn is_repeat(&self) -> bool {
        !self.is_textured && self.correlation > self.threshold
    }
}

/// Features of a match: correlation relative to its threshold, and 1 for a textured tile.
pub(super) fn features(tile: &TileMatch) -> Vec<f64> {
    vec![tile.correlation / tile.threshold, f64::from(u8::from(tile.is_textured))]
}

/// The best match of each patch of a picture. Patches without any other place to compare with, and
/// those without residue, have the correlation 0 at their own place.
pub(super) fn matches(source: &PatchSource, patches: &[&DetectorPatch]) -> Vec<TileMatch> {
    let residue = Residue::new(source);
    let mut by_window: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
    for (i, patch) in patches.iter().enumerate() {
        by_window.entry(window_origin(patch.origin_px, &residue.values)).or_default().push(i);
    }
    let places = |side: usize| side.min(WINDOW_PX) - PATCH_PX + 1;
    let hypotheses = patches.len() * places(residue.values.width) * places(residue.values.height);
    let z = chance_quantile(hypotheses as f64);
    let mut best: Vec<Option<TileMatch>> = vec![None; patches.len()];
    for (origin, tiles) in by_window {
        let window = SearchWindow::new(&residue, origin);
        for pair in tiles.chunks(2) {
            let origins: Vec<[usize; 2]> = pair.iter().map(|i| patches[*i].origin_px).collect();
            for (i, tile) in pair.iter().zip(window.search(&residue, &origins, z)) {
                best[*i] = Some(tile);
            }
        }
    }
    best.into_iter().flatten().collect()
}

/// The window of a tile: on a grid, the tile near its middle.
fn window_origin(tile_px: [usize; 2], picture: &GreyImage) -> [usize; 2] {
    [(tile_px[0], picture.width), (tile_px[1], picture.height)].map(|(at, side)| {
        let start = (at + PATCH_PX / 2 + WINDOW_STEP_PX / 2).saturating_sub(WINDOW_PX / 2) / WINDOW_STEP_PX;
        (start * WINDOW_STEP_PX).min(side.saturating_sub(WINDOW_PX))
    })
}

/// z with `hypotheses`·φ(z)/z = [`FALSE_ALARM`], by bisection.
fn chance_quantile(hypotheses: f64) -> f64 {
    let log_probability = |z: f64| -0.5 * z * z - (z * std::f64::consts::TAU.sqrt()).ln();
    let target = (FALSE_ALARM / hypotheses.max(1.0)).ln();
    let (mut low, mut high) = (0.5, 20.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if log_probability(middle) > target {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// The normalised residue of a picture.
struct Residue {
    /// 0 outside the mask.
    values: GreyImage,
    is_masked: Vec<bool>,
    /// Σ_k r(k)² of the whole picture.
    correlated_pixels: f64,
}

impl Residue {
    fn new(source: &PatchSource) -> Self {
        let [luma, ..] = ycbcr(&rgb_planes(source.pixels));
        let blurred = luma.blurred(BLUR_SIGMA_PX);
        let with_values = |values: Vec<f32>| GreyImage { width: luma.width, height: luma.height, values };
        let is_masked = source.mask.map_or_else(|| vec![true; luma.values.len()], <[bool]>::to_vec);
        let residue: Vec<f32> = (luma.values.iter().zip(&blurred.values).zip(&is_masked))
            .map(|((value, blurred), used)| if *used { value - blurred } else { 0.0 })
            .collect();
        let variance = with_values(residue.iter().map(|v| v * v).collect()).blurred(LOCAL_SIGMA_PX);
        let normalized = residue.iter().zip(&variance.values).map(|(value, variance)| {
            (value / variance.max(MIN_DEVIATION * MIN_DEVIATION).sqrt()).clamp(-MAX_RESIDUE, MAX_RESIDUE)
        });
        let values = with_values(normalized.collect());
        let correlated_pixels = correlated_pixels(&values, [0, 0], [values.width, values.height]);
        Self { values, is_masked, correlated_pixels }
    }
}

/// Σ_k r(k)² of a part of a picture, over lags of up to [`NOISE_REACH_PX`].
fn correlated_pixels(picture: &GreyImage, [x0, y0]: [usize; 2], [width, height]: [usize; 2]) -> f64 {
    let row = |y: usize| &picture.values[(y0 + y) * picture.width + x0..][..width];
    let product = |right: isize, down: usize| {
        let skipped = right.unsigned_abs();
        if down >= height || skipped >= width {
            return 0.0;
        }
        let sum = (0..height - down).map(|y| {
            let (from, to) = (row(y), row(y + down));
            let (from, to) = if right < 0 { (&from[skipped..], to) } else { (from, &to[skipped..]) };
            from.iter().zip(to).map(|(a, b)| f64::from(a * b)).sum::<f64>()
        });
        sum.sum::<f64>()
    };
    let power = product(0, 0);
    if power <= 0.0 {
        return 1.0;
    }
    let reach = NOISE_REACH_PX as isize;
    let mut sum = 1.0;
    for down in 0..=NOISE_REACH_PX {
        for right in -reach..=reach {
            // Half of the lags; the others are equal by symmetry.
            if down > 0 || right > 0 {
                sum += 2.0 * (product(right, down) / power).powi(2);
            }
        }
    }
    sum
}

/// A part of the residue, prepared for the search.
struct SearchWindow {
    origin_px: [usize; 2],
    width: usize,
    height: usize,
    fft: Fft2,
    spectrum: Vec<Complex32>,
    /// Σ (v − v̄)² of each place's pixels; 0 where a place leaves the mask. Row by row.
    energy: Vec<f32>,
}

impl SearchWindow {
    fn new(residue: &Residue, origin_px: [usize; 2]) -> Self {
        let picture = &residue.values;
        let width = (picture.width - origin_px[0]).min(WINDOW_PX);
        let height = (picture.height - origin_px[1]).min(WINDOW_PX);
        let fft = Fft2::holding(width, height);
        let mut spectrum = vec![Complex32::ZERO; fft.width * fft.height];
        let index = |x: usize, y: usize| (origin_px[1] + y) * picture.width + origin_px[0] + x;
        for y in 0..height {
            for x in 0..width {
                spectrum[y * fft.width + x].re = picture.values[index(x, y)];
            }
        }
        fft.forward(&mut spectrum, height);
        // Summed-area table of count, sum and sum of squares.
        let mut table = vec![[0.0f64; 3]; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = [0.0; 3];
            for x in 0..width {
                let value = f64::from(picture.values[index(x, y)]);
                let added = [f64::from(u8::from(residue.is_masked[index(x, y)])), value, value * value];
                row = std::array::from_fn(|k| row[k] + added[k]);
                let above = table[y * (width + 1) + x + 1];
                table[(y + 1) * (width + 1) + x + 1] = std::array::from_fn(|k| above[k] + row[k]);
            }
        }
        let mut energy = Vec::with_capacity((width + 1 - PATCH_PX) * (height + 1 - PATCH_PX));
        for y in 0..=height - PATCH_PX {
            for x in 0..=width - PATCH_PX {
                let corner = |right: usize, down: usize| table[(y + down) * (width + 1) + x + right];
                let [count, sum, squares]: [f64; 3] = std::array::from_fn(|k| {
                    corner(PATCH_PX, PATCH_PX)[k] - corner(0, PATCH_PX)[k] - corner(PATCH_PX, 0)[k] + corner(0, 0)[k]
                });
                let is_complete = count > (PATCH_PX * PATCH_PX) as f64 - 0.5;
                energy.push(if is_complete { (squares - sum * sum / count) as f32 } else { 0.0 });
            }
        }
        Self { origin_px, width, height, fft, spectrum, energy }
    }

    /// The best matches of one or two tiles, by one inverse transform: one tile is the real part,
    /// the other the imaginary part.
    fn search(&self, residue: &Residue, tiles_px: &[[usize; 2]], z: f64) -> Vec<TileMatch> {
        let mut values: Vec<Complex32> = vec![Complex32::ZERO; self.spectrum.len()];
        for (part, [x0, y0]) in tiles_px.iter().enumerate() {
            let tile = |x: usize, y: usize| residue.values.values[(y0 + y) * residue.values.width + x0 + x];
            let pixels = (0..PATCH_PX).flat_map(|y| (0..PATCH_PX).map(move |x| [x, y]));
            let mean = pixels.clone().map(|[x, y]| tile(x, y)).sum::<f32>() / (PATCH_PX * PATCH_PX) as f32;
            // Mirrored, so that the convolution is a correlation.
            for [x, y] in pixels {
                let value = tile(PATCH_PX - 1 - x, PATCH_PX - 1 - y) - mean;
                let sum = &mut values[y * self.fft.width + x];
                *(if part == 0 { &mut sum.re } else { &mut sum.im }) = value;
            }
        }
        self.fft.forward(&mut values, PATCH_PX);
        values.iter_mut().zip(&self.spectrum).for_each(|(value, s)| *value *= s);
        self.fft.inverse(&mut values);
        tiles_px.iter().enumerate().map(|(part, tile)| self.best(residue, &values, part, *tile, z)).collect()
    }

    fn best(&self, residue: &Residue, products: &[Complex32], part: usize, tile_px: [usize; 2], z: f64) -> TileMatch {
        let per_row = self.width + 1 - PATCH_PX;
        let at = [tile_px[0] - self.origin_px[0], tile_px[1] - self.origin_px[1]];
        let own_energy = self.energy[at[1] * per_row + at[0]];
        let scale = 1.0 / (self.fft.width * self.fft.height) as f32;
        let correlated = correlated_pixels(&residue.values, tile_px, [PATCH_PX; 2]).max(residue.correlated_pixels);
        let threshold = z * correlated.sqrt() / PATCH_PX as f64;
        let mut own = 0.0f32;
        let (mut largest, mut place) = (0.0f32, at);
        for y in 0..=self.height - PATCH_PX {
            let row = &products[(y + PATCH_PX - 1) * self.fft.width + PATCH_PX - 1..][..per_row];
            let energies = &self.energy[y * per_row..][..per_row];
            let rows_away = y.abs_diff(at[1]);
            for (x, (product, energy)) in row.iter().zip(energies).enumerate() {
                let norm = energy * own_energy;
                // A residue of at most a few rounded codes has no pattern.
                if norm <= 1.0 {
                    continue;
                }
                let product = if part == 0 { product.re } else { product.im };
                let correlation = scale * product / norm.sqrt();
                let away = rows_away.max(x.abs_diff(at[0]));
                if away >= PATCH_PX {
                    if correlation > largest {
                        largest = correlation;
                        place = [x, y];
                    }
                } else if away > NOISE_REACH_PX {
                    own = own.max(correlation);
                }
            }
        }
        TileMatch {
            origin_px: tile_px,
            match_px: [self.origin_px[0] + place[0], self.origin_px[1] + place[1]],
            correlation: f64::from(largest),
            threshold,
            is_textured: f64::from(own) > threshold,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::patches::patches;
    use super::super::synthetic::Normals;
    use super::*;
    use crate::pixels::Pixels;

    /// White noise of σ = 6 codes in a picture of 192×128 px.
    fn noise(seed: u64) -> Vec<f64> {
        let mut normals = Normals::new(seed);
        (0..192 * 128).map(|_| 128.0 + 6.0 * normals.next()).collect()
    }

    fn matches_of(values: &[f64], mask: Option<&[bool]>) -> Vec<TileMatch> {
        let codes = values.iter().flat_map(|v| [v.round() as u8; 3]).collect();
        let pixels = Pixels::from_u8(192, 128, codes).unwrap();
        let source = PatchSource { mask, ..PatchSource::new(&pixels) };
        let all = patches(&[source]);
        matches(&source, &all.iter().collect::<Vec<_>>())
    }

    #[test]
    fn copied_tile_is_found_at_its_source() {
        let mut values = noise(1);
        // 40×40 px from (11, 20) to (122, 70).
        for y in 0..40 {
            for x in 0..40 {
                values[(70 + y) * 192 + 122 + x] = values[(20 + y) * 192 + 11 + x] + 10.0;
            }
        }
        // The copy contains the tile at (128, 64) but for its upper 6 rows.
        let all = matches_of(&values, None);
        let repeats: Vec<_> = all.iter().filter(|tile| tile.is_repeat()).collect();
        let tile = repeats.iter().find(|tile| tile.origin_px == [128, 64]).unwrap();
        assert_eq!(tile.match_px, [17, 14], "{tile:?}");
        assert!((0.7..0.95).contains(&tile.correlation), "{tile:?}");
    }

    #[test]
    fn independent_noise_has_no_repeats() {
        for seed in 2..6 {
            let all = matches_of(&noise(seed), None);
            assert_eq!(all.len(), 24);
            assert!(all.iter().all(|tile| !tile.is_repeat() && !tile.is_textured), "{all:?}");
        }
    }

    #[test]
    fn stripes_and_edges_are_not_repeats() {
        let with = |content: fn(usize) -> f64| {
            let mut values = noise(7);
            values.iter_mut().enumerate().for_each(|(i, v)| *v += content(i % 192));
            matches_of(&values, None)
        };
        let stripes = with(|x| if x % 8 < 4 { 20.0 } else { 0.0 });
        assert!(stripes.iter().all(|tile| !tile.is_repeat()), "{stripes:?}");
        let edge = with(|x| if x < 112 { 0.0 } else { 60.0 });
        let on_edge: Vec<_> = edge.iter().filter(|tile| tile.origin_px[0] == 96).collect();
        assert!(on_edge.iter().all(|tile| tile.is_textured && tile.correlation > tile.threshold), "{on_edge:?}");
        assert!(edge.iter().all(|tile| !tile.is_repeat()), "{edge:?}");
    }

    #[test]
    fn places_outside_the_mask_are_not_compared() {
        let mut values = noise(8);
        for y in 0..32 {
            for x in 0..32 {
                values[(64 + y) * 192 + 128 + x] = values[y * 192 + x];
            }
        }
        let tile = |mask: Option<&[bool]>| matches_of(&values, mask)[0];
        assert_eq!((tile(None).match_px, tile(None).is_repeat()), ([128, 64], true));
        let mask: Vec<bool> = (0..192 * 128).map(|i| i != 70 * 192 + 140).collect();
        assert!(!tile(Some(&mask)).is_repeat());
    }

    #[test]
    fn chance_quantile_bounds_the_normal_tail() {
        // φ(6)/6 = 6.0759e-9/6.
        assert!((chance_quantile(FALSE_ALARM / (6.0759e-9 / 6.0)) - 6.0).abs() < 1e-4);
    }

    #[test]
    fn windows_cover_the_picture_and_hold_their_tiles() {
        let picture = GreyImage { width: 1920, height: 600, values: Vec::new() };
        for (tile, expected) in [([0, 0], [0, 0]), ([400, 568], [256, 88]), ([1888, 300], [1408, 0])] {
            assert_eq!(window_origin(tile, &picture), expected);
        }
        let small = GreyImage { width: 100, height: 40, values: Vec::new() };
        assert_eq!(window_origin([64, 0], &small), [0, 0]);
    }
}
