//! Where on a floor 32 rays at a time are stopped: a bit for each, at the middle of each texel.
//!
//! A thing's shadow in one direction is its triangles, laid along the ray onto the floor; where two overlap it is not darker.

use std::ops::Range;

use glam::{Vec2, Vec3};

use crate::pixels::floor;

/// How successive numbers are spread evenly (Roberts 2018, R₂): each ray looks at another place within the texels, so that edges
/// are smooth.
pub const SPREAD: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// Rows of a chart, as bits.
#[derive(Debug)]
pub struct Mask {
    pub bits: Vec<u32>,
    width: usize,
    rows: Range<usize>,
}

impl Mask {
    pub fn new(width: usize, rows: Range<usize>) -> Self {
        Self { bits: vec![0; width * rows.len()], width, rows }
    }

    pub fn clear(&mut self) {
        self.bits.fill(0);
    }

    /// Sets a bit wherever one of the triangles lies. `place_of`: where a corner's shadow falls, in texels; what has none
    /// stands above the light.
    pub fn stop(
        &mut self,
        bit: u32,
        corners: &[Vec3],
        triangles: &[[u32; 3]],
        places: &mut Vec<Vec2>,
        place_of: impl Fn(Vec3) -> Option<Vec2>,
    ) {
        places.clear();
        places.extend(corners.iter().map(|corner| place_of(*corner).unwrap_or(Vec2::NAN)));
        for [a, b, c] in triangles {
            let all = [a, b, c].map(|i| places[*i as usize]);
            if all.iter().all(|place| place.is_finite()) {
                let (bits, bit) = (&mut self.bits, 1 << bit);
                spans(all, self.width, &self.rows, |texels| bits[texels].iter_mut().for_each(|word| *word |= bit));
            }
        }
    }
}

/// Where ray `n` looks within a texel, from its middle, texels.
pub fn jitter(n: usize) -> Vec2 {
    (SPREAD * (n as f32 + 0.5)).fract() - 0.5
}

/// The texels, of some rows, whose middles lie in a triangle, row by row.
pub fn spans(corners: [Vec2; 3], width: usize, rows: &Range<usize>, mut each: impl FnMut(Range<usize>)) {
    let [a, b, c] = corners;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    // Middles lie at halves.
    let inside = |low: f32, high: f32, range: &Range<usize>| {
        let first = floor(0.5 - low).saturating_neg().max(range.start as i32) as usize;
        let after = floor(high - 0.5).saturating_add(1).clamp(0, range.end as i32) as usize;
        first..after
    };
    if inside(low.x, high.x, &(0..width)).is_empty() {
        return;
    }
    for row in inside(low.y, high.y, rows) {
        let y = row as f32 + 0.5;
        let (mut from, mut to) = (f32::INFINITY, f32::NEG_INFINITY);
        for (p, q) in [(a, b), (b, c), (c, a)] {
            if (p.y <= y) != (q.y <= y) {
                let x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
                (from, to) = (from.min(x), to.max(x));
            }
        }
        let columns = inside(from, to, &(0..width));
        let start = (row - rows.start) * width;
        if !columns.is_empty() {
            each(start + columns.start..start + columns.end);
        }
    }
}

/// Sums of values by the bits of a word, a byte at a time.
#[derive(Debug)]
pub struct Sums([[Vec3; 256]; 4]);

impl Sums {
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

    #[test]
    fn the_middles_within_a_triangle_and_no_others() {
        let corners = [Vec3::new(0.2, 0.3, 0.0), Vec3::new(6.9, 1.1, 0.0), Vec3::new(2.2, 7.4, 0.0)];
        let inside = |at: Vec2| {
            let side = |i: usize| {
                let (p, q) = (corners[i].truncate(), corners[(i + 1) % 3].truncate());
                (q - p).perp_dot(at - p)
            };
            (0..3).all(|i| side(i) >= 0.0) || (0..3).all(|i| side(i) <= 0.0)
        };
        // All rows at once, and in two bands.
        for between in [8, 3] {
            let mut found = Vec::new();
            for rows in [0..between, between..8] {
                let mut mask = Mask::new(8, rows);
                mask.stop(5, &corners, &[[0, 1, 2]], &mut Vec::new(), |c| Some(c.truncate()));
                found.extend(mask.bits);
            }
            for (i, word) in found.iter().enumerate() {
                let at = Vec2::new((i % 8) as f32 + 0.5, (i / 8) as f32 + 0.5);
                assert_eq!(*word, u32::from(inside(at)) << 5, "{at}");
            }
        }
    }

    #[test]
    fn what_reaches_beyond_the_chart_or_has_no_shadow_harms_nothing() {
        let corners = [Vec3::new(-1e9, -5.0, 0.0), Vec3::new(1e9, -5.0, 0.0), Vec3::new(0.0, 1e9, 0.0)];
        let mut mask = Mask::new(4, 0..4);
        mask.stop(0, &corners, &[[0, 1, 2]], &mut Vec::new(), |c| Some(c.truncate()));
        assert!(mask.bits.iter().all(|word| *word == 1));
        mask.clear();
        mask.stop(0, &corners, &[[0, 1, 2]], &mut Vec::new(), |c| (c.x < 1.0).then_some(Vec2::ZERO));
        assert!(mask.bits.iter().all(|word| *word == 0));
    }

    #[test]
    fn sums_are_those_of_the_bits() {
        let values: Vec<Vec3> = (0..32).map(|i| Vec3::new(i as f32, 1.0, -2.0 * i as f32)).collect();
        let sums = Sums::of(&values);
        for word in [0u32, 1, 0x8000_0001, 0xf0f0_1234, u32::MAX] {
            let by_hand: Vec3 = (0..32).filter(|bit| word >> bit & 1 == 1).map(|bit| values[bit]).sum();
            assert!(sums.sum(word).abs_diff_eq(by_hand, 1e-3));
        }
    }
}
