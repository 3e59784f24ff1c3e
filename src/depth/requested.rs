//! Pixels that request depth from other frames or surfels, and the colour test for accepting it.

use crate::fit::quantile::upper_median_in_place;
use crate::parallel::{over_rows, processors};
use crate::pixels::Rect;

/// Side of the blocks in which requested pixels are registered, px.
const BLOCK_PX: usize = 8;
/// Pixels that a thread works on at a time.
const PIXELS_PER_BLOCK: usize = 256;
/// Largest distance of a matching colour (square root of light) from the range of the pixels
/// around: noise and motion blur.
const COLOR_TOLERANCE: f32 = 0.06;
/// Minimum number of colour pairs for an estimate of the gain between two pictures, and the range
/// of reliable colours.
const MIN_PAIRS: usize = 24;
const RELIABLE_COLORS: std::ops::Range<f32> = 0.12..0.97;

/// Pixels of a part of the frame whose depth is requested.
pub struct RequestedPixels {
    /// Indices of the pixels in the part, ascending.
    pub places: Vec<u32>,
    /// Position of each pixel of the part among them; [`NOT_REQUESTED`] for others, and for one
    /// more pixel past the last.
    pub ranks: Vec<u32>,
    /// Lowest and highest of the frame's colours in the 3×3 pixels around each of them.
    ranges: Vec<[[f32; 3]; 2]>,
    /// True for blocks of the part that contain one, row by row.
    blocks: Vec<bool>,
    blocks_per_row: usize,
}

/// Rank of a pixel that is not requested.
pub const NOT_REQUESTED: u32 = u32::MAX;

impl RequestedPixels {
    pub fn new(is_requested: &[bool], sqrt_colors: &[[f32; 3]], width: usize) -> Self {
        let height = is_requested.len() / width;
        let blocks_per_row = width.div_ceil(BLOCK_PX);
        let mut blocks = vec![false; blocks_per_row * height.div_ceil(BLOCK_PX)];
        let (mut places, mut ranks) = (Vec::new(), vec![NOT_REQUESTED; is_requested.len() + 1]);
        for (y, row) in is_requested.chunks_exact(width).enumerate() {
            for (x, piece) in row.chunks(BLOCK_PX).enumerate().filter(|(_, piece)| piece.contains(&true)) {
                blocks[y / BLOCK_PX * blocks_per_row + x] = true;
                let first = y * width + x * BLOCK_PX;
                for i in (first..).zip(piece).filter(|(_, is_requested)| **is_requested).map(|(i, _)| i) {
                    ranks[i] = places.len() as u32;
                    places.push(i as u32);
                }
            }
        }
        let mut ranges = vec![[[0.0; 3]; 2]; places.len()];
        over_rows(&mut ranges, PIXELS_PER_BLOCK, processors(), |n, ranges| {
            for (range, i) in ranges.iter_mut().zip(&places[n * PIXELS_PER_BLOCK..]) {
                let (x, y) = (*i as usize % width, *i as usize / width);
                let (mut low, mut high) = ([f32::INFINITY; 3], [0.0f32; 3]);
                for y in y.saturating_sub(1)..(y + 2).min(height) {
                    for there in &sqrt_colors[y * width + x.saturating_sub(1)..y * width + (x + 2).min(width)] {
                        for c in 0..3 {
                            low[c] = low[c].min(there[c]);
                            high[c] = high[c].max(there[c]);
                        }
                    }
                }
                *range = [low, high];
            }
        });
        Self { places, ranks, ranges, blocks, blocks_per_row }
    }

    /// Position of a pixel of the part among those that are requested; `None` if it is not.
    pub fn rank(&self, pixel: usize) -> Option<usize> {
        self.ranks.get(pixel).filter(|rank| **rank != NOT_REQUESTED).map(|rank| *rank as usize)
    }

    /// True if a rectangle of the part may contain some of them: exact to a block.
    pub fn any_in(&self, rect: Rect) -> bool {
        let block = |at: i32| at as usize / BLOCK_PX;
        !rect.is_empty()
            && (block(rect.y0)..=block(rect.y1 - 1))
                .any(|y| self.blocks[y * self.blocks_per_row..][block(rect.x0)..=block(rect.x1 - 1)].contains(&true))
    }

    /// True if the frame has this colour at or beside the `n`th requested pixel.
    pub fn has_color_near(&self, n: usize, sqrt_colors: [f32; 3]) -> bool {
        let [low, high] = self.ranges[n];
        // A clipped channel is only a lower bound.
        (0..3).all(|c| {
            sqrt_colors[c] > low[c] - COLOR_TOLERANCE
                && (sqrt_colors[c] < high[c] + COLOR_TOLERANCE || high[c] > RELIABLE_COLORS.end)
        })
    }
}

/// Gain of the frame's colours over another picture's: the median ratio of pairs (frame, other),
/// for each channel. 1 with too few pairs.
pub fn color_gain(pairs: &[([f32; 3], [f32; 3])]) -> [f32; 3] {
    [0, 1, 2].map(|c| {
        let is_reliable = |(own, other): &&([f32; 3], [f32; 3])| {
            RELIABLE_COLORS.contains(&own[c]) && RELIABLE_COLORS.contains(&other[c])
        };
        let mut ratios: Vec<f32> = pairs.iter().filter(is_reliable).map(|(own, other)| own[c] / other[c]).collect();
        if ratios.len() < MIN_PAIRS {
            return 1.0;
        }
        upper_median_in_place(&mut ratios).unwrap_or(1.0)
    })
}
