//! Rasterizes the shadows of 32 rays at a time into bit masks, at the centre of each texel.
//!
//! The shadow of an object in one direction is its projection onto the plane along the ray.
//! Overlapping layers of it are not darker.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::silhouette::{CastBuffers, SilhouetteMesh};
use crate::pixels::floor;

/// Step of the low-discrepancy sequence R₂ (Roberts 2018). Each ray samples another position within
/// the texels, to antialias edges.
pub const R2_STEP: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// Range of a row without steps.
const EMPTY_RANGE: (usize, usize) = (usize::MAX, 0);

/// Bit masks of some rows of a planar shadow.
#[derive(Debug)]
pub struct Mask {
    pub bits: Vec<u32>,
    width: usize,
    rows: Range<usize>,
    cast: CastBuffers,
    /// Change of the number of layers at each texel. Rows are a texel longer than the planar
    /// shadow's. All are 0 between calls of `rasterize`.
    steps: Vec<i32>,
    /// The first and the last texel with a step in each row.
    ranges: Vec<(usize, usize)>,
}

impl Mask {
    pub fn new(width: usize, rows: Range<usize>) -> Self {
        let (bits, steps) = (vec![0; width * rows.len()], vec![0; (width + 1) * rows.len()]);
        Self { bits, width, ranges: vec![EMPTY_RANGE; rows.len()], rows, cast: CastBuffers::default(), steps }
    }

    pub fn clear(&mut self) {
        self.bits.fill(0);
    }

    /// Sets a bit in the shadow of an object. `place_of`: the position of a corner's shadow,
    /// texels; `None` for corners above the light.
    pub fn rasterize(&mut self, bit: u32, silhouette: &SilhouetteMesh, place_of: impl Fn(Vec3) -> Option<Vec2>) {
        let Self { bits, width, rows, cast, steps, ranges } = self;
        silhouette.for_each_edge(cast, place_of, |from, to, layers| {
            let (high, low, layers) = if from.y < to.y { (from, to, -layers) } else { (to, from, layers) };
            let columns_per_row = (low.x - high.x) / (low.y - high.y);
            for row in rows_between(high.y, low.y, rows) {
                let x = high.x + columns_per_row * (row as f32 + 0.5 - high.y);
                let column = first_center(x).clamp(0, *width as i32) as usize;
                let row = row - rows.start;
                steps[row * (*width + 1) + column] += layers;
                let range = &mut ranges[row];
                *range = (range.0.min(column), range.1.max(column));
            }
        });
        let of_rows = bits.chunks_exact_mut((*width).max(1)).zip(steps.chunks_exact_mut(*width + 1)).zip(ranges);
        for ((bits, steps), range) in of_rows.filter(|(_, range)| **range != EMPTY_RANGE) {
            let (first, last) = std::mem::replace(range, EMPTY_RANGE);
            let mut layers = 0;
            for (word, step) in bits[first..last].iter_mut().zip(&mut steps[first..last]) {
                layers += std::mem::take(step);
                *word |= u32::from(layers != 0) << bit;
            }
            steps[last] = 0;
        }
    }
}

/// The first texel whose centre is at a coordinate or after it.
fn first_center(at: f32) -> i32 {
    floor(0.5 - at).saturating_neg()
}

/// Rows with centres between two coordinates, the upper one included.
fn rows_between(high: f32, low: f32, rows: &Range<usize>) -> Range<usize> {
    let row = |at: f32| first_center(at).clamp(rows.start as i32, rows.end as i32) as usize;
    row(high)..row(low)
}

/// Sample position of ray `n` relative to a texel's centre, texels.
pub fn jitter(n: usize) -> Vec2 {
    (R2_STEP * (n as f32 + 0.5)).fract() - 0.5
}

/// Calls `each` with the texels of some rows whose centres are in a triangle, row by row.
pub fn spans(corners: [Vec2; 3], width: usize, rows: &Range<usize>, mut each: impl FnMut(Range<usize>)) {
    let [a, b, c] = corners;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    // Centres are at halves.
    let texel_range = |low: f32, high: f32, range: &Range<usize>| {
        let first = floor(0.5 - low).saturating_neg().max(range.start as i32) as usize;
        let after = floor(high - 0.5).saturating_add(1).clamp(0, range.end as i32) as usize;
        first..after
    };
    if texel_range(low.x, high.x, &(0..width)).is_empty() {
        return;
    }
    for row in texel_range(low.y, high.y, rows) {
        let y = row as f32 + 0.5;
        let (mut from, mut to) = (f32::INFINITY, f32::NEG_INFINITY);
        for (p, q) in [(a, b), (b, c), (c, a)] {
            if (p.y <= y) != (q.y <= y) {
                let x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
                (from, to) = (from.min(x), to.max(x));
            }
        }
        let columns = texel_range(from, to, &(0..width));
        let start = (row - rows.start) * width;
        if !columns.is_empty() {
            each(start + columns.start..start + columns.end);
        }
    }
}

/// Lookup tables for the sum of the values whose bits are set in a word, a byte at a time.
#[derive(Debug)]
pub struct BitSums([[Vec3; 256]; 4]);

impl BitSums {
    pub fn of(values: &[Vec3]) -> Self {
        let value = |bit: usize| values.get(bit).copied().unwrap_or(Vec3::ZERO);
        let of_byte = |byte: usize, bits: usize| -> Vec3 {
            (0..8).filter(|bit| bits >> bit & 1 == 1).map(|bit| value(8 * byte + bit)).sum()
        };
        Self(std::array::from_fn(|byte| std::array::from_fn(|bits| of_byte(byte, bits))))
    }

    pub fn sum(&self, word: u32) -> Vec3 {
        let [a, b, c, d] = word.to_le_bytes().map(usize::from);
        (self.0[0][a] + self.0[1][b]) + (self.0[2][c] + self.0[3][d])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shadow::occluders::Occluders;

    fn silhouette(corners: &[Vec3], triangles: &[[u32; 3]]) -> SilhouetteMesh {
        SilhouetteMesh::of(&Occluders {
            corners: corners.to_vec(),
            triangles: triangles.to_vec(),
            ..Occluders::default()
        })
    }

    /// True if a place is in the projection of one of the triangles.
    fn is_under(at: Vec2, corners: &[Vec3], triangles: &[[u32; 3]]) -> bool {
        triangles.iter().any(|triangle| {
            let corner = |i: usize| corners[triangle[i % 3] as usize].truncate();
            let side = |i: usize| (corner(i + 1) - corner(i)).perp_dot(at - corner(i));
            (0..3).all(|i| side(i) >= 0.0) || (0..3).all(|i| side(i) <= 0.0)
        })
    }

    #[test]
    fn bits_are_set_at_centres_below_triangles_only() {
        let one = [Vec3::new(0.2, 0.3, 0.0), Vec3::new(6.9, 1.1, 0.0), Vec3::new(2.2, 7.4, 0.0)];
        // Pseudorandom: an open mesh that folds over itself, with three triangles on one edge and
        // mixed orientations.
        let scattered: Vec<Vec3> = (0..9).map(|n| (8.0 * (R2_STEP * (n as f32 + 0.3)).fract()).extend(0.0)).collect();
        let tangle = [[0, 1, 2], [1, 2, 3], [2, 1, 4], [5, 6, 7], [7, 8, 0], [3, 3, 5]];
        for (corners, triangles) in [(one.as_slice(), [[0, 1, 2]].as_slice()), (&scattered, &tangle)] {
            // All rows at once, and in two bands.
            for between in [8, 3] {
                let mut words = Vec::new();
                for rows in [0..between, between..8] {
                    let mut mask = Mask::new(8, rows);
                    mask.rasterize(5, &silhouette(corners, triangles), |c| Some(c.truncate()));
                    words.extend(mask.bits);
                }
                for (i, word) in words.iter().enumerate() {
                    let at = Vec2::new((i % 8) as f32 + 0.5, (i / 8) as f32 + 0.5);
                    assert_eq!(*word, u32::from(is_under(at, corners, triangles)) << 5, "{at}");
                }
            }
        }
    }

    #[test]
    fn triangles_beyond_the_planar_shadow_are_clipped() {
        let corners = [Vec3::new(-1e9, -5.0, 0.0), Vec3::new(1e9, -5.0, 0.0), Vec3::new(0.0, 1e9, 0.0)];
        let silhouette = silhouette(&corners, &[[0, 1, 2]]);
        let mut mask = Mask::new(4, 0..4);
        mask.rasterize(0, &silhouette, |c| Some(c.truncate()));
        assert!(mask.bits.iter().all(|word| *word == 1));
        mask.clear();
        mask.rasterize(0, &silhouette, |c| (c.x < 1.0).then_some(Vec2::ZERO));
        assert!(mask.bits.iter().all(|word| *word == 0));
    }

    #[test]
    fn sums_by_tables_match_sums_over_bits() {
        let values: Vec<Vec3> = (0..32).map(|i| Vec3::new(i as f32, 1.0, -2.0 * i as f32)).collect();
        let sums = BitSums::of(&values);
        for word in [0u32, 1, 0x8000_0001, 0xf0f0_1234, u32::MAX] {
            let by_hand: Vec3 = (0..32).filter(|bit| word >> bit & 1 == 1).map(|bit| values[bit]).sum();
            assert!(sums.sum(word).abs_diff_eq(by_hand, 1e-3));
        }
    }
}
