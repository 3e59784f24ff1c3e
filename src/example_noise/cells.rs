//! Cells of the synthesis and their sources in the atlas.
//!
//! Cell (i, j) covers luma px 64 i − 16 to 64 i + 63 of the coded picture across, and the same down
//! for j: 80 px, of which the first 16 overlap the cell before it. In the overlap weights are
//! sin(π/2 (t + ½)/16) of the later and the cosine of the earlier cell, so that their squares sum
//! to 1 and the variance of independent noise stays.
//!
//! Source of a cell: m = ⌈n / 24⌉ (at most 64) of the n candidates of the class
//! (i & 1) + 2 (j & 1) are drawn by hashes. The source is the one with the
//! [descriptor](super::descriptor) nearest to that of the cell's content. Its expected rank by
//! distance is about 24 among all candidates, without any sorting.
//! Each draw is h mod n for the three words h of pcg3d(key + (i, j, 1 + draw / 3)).
//! pcg3d(key + (i, j, 0)) gives the tile's mirroring: bit 31 of the first word across, of the
//! second down. The key is that of the frame in which the cell was
//! [refreshed](super::persistence).

use super::atlas::{CELL_PX, CLASSES, OVERLAP_PX, TileCandidate};
use super::descriptor::{DESCRIPTOR_BLOCK_PX, Descriptor, DescriptorBlocks, DescriptorScale};
use super::persistence::FrameKeys;
use crate::hash::pcg3d;

/// Expected rank of the drawn candidate by distance.
pub const EXPECTED_RANK: usize = 24;
const BLOCK_PX: i64 = DESCRIPTOR_BLOCK_PX as i64;
/// Largest number of draws.
const MAX_DRAWS: usize = 64;

/// Source of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileSource {
    pub frame: u32,
    /// Top left corner of the tile, luma px.
    pub at: [u32; 2],
    /// Mirrored across, down.
    pub mirrored: [bool; 2],
}

/// Number of cells that cover a length, luma px.
pub fn cell_count(length: usize) -> usize {
    (length + OVERLAP_PX).div_ceil(CELL_PX)
}

/// Weight of a cell at the t-th luma or chroma sample of its tile. `factor`: luma px per sample.
pub fn weight(t: usize, factor: usize) -> f32 {
    let (cell, overlap) = (CELL_PX / factor, OVERLAP_PX / factor);
    let rise = |t: usize| (std::f32::consts::FRAC_PI_2 * (t as f32 + 0.5) / overlap as f32).sin();
    if t < overlap {
        rise(t)
    } else if t >= cell {
        rise(cell + overlap - 1 - t)
    } else {
        1.0
    }
}

/// Sources of all cells of a picture of this size, row by row.
pub fn sources(
    blocks: &DescriptorBlocks,
    size: [usize; 2],
    scale: &DescriptorScale,
    candidates: &[Vec<TileCandidate>; CLASSES],
    keys: &FrameKeys,
) -> Vec<TileSource> {
    let first_block = |cell: usize| (cell * CELL_PX) as i64 / BLOCK_PX - OVERLAP_PX as i64 / BLOCK_PX;
    let [columns, rows] = size.map(cell_count);
    let cells = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let source = |(i, j): (usize, usize)| {
        let descriptor = scale.standardised(&blocks.tile([first_block(i), first_block(j)]));
        source([i as u32, j as u32], &descriptor, candidates, keys)
    };
    cells.map(source).collect()
}

/// Source of one cell, by the standardised descriptor of its content.
pub fn source(
    cell: [u32; 2],
    descriptor: &Descriptor,
    candidates: &[Vec<TileCandidate>; CLASSES],
    keys: &FrameKeys,
) -> TileSource {
    let key = keys.of_cell(cell);
    let hash = |n: u32| pcg3d([cell[0].wrapping_add(key[0]), cell[1].wrapping_add(key[1]), n.wrapping_add(key[2])]);
    let class = &candidates[(cell[0] & 1) as usize + 2 * (cell[1] & 1) as usize];
    let draws = class.len().div_ceil(EXPECTED_RANK).clamp(1, MAX_DRAWS);
    let distance = |c: &TileCandidate| c.descriptor.iter().zip(descriptor).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
    let mut nearest = (f32::INFINITY, 0);
    for draw in 0..draws {
        let word = hash(1 + draw as u32 / 3)[draw % 3];
        let index = word as usize % class.len();
        let d = distance(&class[index]);
        if d < nearest.0 {
            nearest = (d, index);
        }
    }
    let mirror = hash(0);
    let TileCandidate { frame, at, .. } = class[nearest.1];
    TileSource { frame, at, mirrored: [0, 1].map(|axis| mirror[axis] >> 31 == 1) }
}
