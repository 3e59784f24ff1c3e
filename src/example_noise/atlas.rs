//! The atlas: normalised innovations of the calibration's frames, and the candidates among them for
//! the cells of the synthesis.
//!
//! A candidate is a tile of 80 × 80 luma px of one frame. It starts at a multiple of the coding's
//! unit, so that the traces of the block grid stay in place. Candidates have four classes, one for
//! each parity of a cell's column and row. Tiles of different classes do not overlap, therefore
//! neighbouring cells never repeat each other.

use super::bands::{ALL_BANDS, FIRST_BAND, split};
use super::content::Features;
use super::descriptor::{DESCRIPTOR_BLOCK_PX, Descriptor, DescriptorBlocks, DescriptorScale};
use super::filling::PlaneFilling;
use super::numbers::ModelNumbers;
use super::regression::amplitude;
use super::source_picture::SourcePicture;
pub use super::tile::{CELL_PX, OVERLAP_PX, TILE_PX};
use crate::grey_image::GreyImage;

/// Classes of candidates: parities of a cell's column and row.
pub const CLASSES: usize = 4;
/// Share of a tile's pixels that must be usable; the others are [filled](super::filling).
const MIN_USABLE: f32 = 0.4;
/// Share of a tile's pixels that must not be clipped.
const MIN_UNCLIPPED: f32 = 0.9;
/// Fewest tiles of a class.
pub const MIN_CLASS_TILES: usize = 8;
/// Unit of stored residuals, code values.
pub const RESIDUAL_STEP: f32 = 1.0 / 8.0;
/// Bit of [`SourceFrame::flags`]: the pixel may be used.
pub const USABLE: u8 = 1;
/// Bit of [`SourceFrame::flags`]: the pixel is not clipped.
pub const UNCLIPPED: u8 = 2;
/// Fewest candidates of a class, if less clipped tiles can provide them.
pub const MIN_CANDIDATES: usize = 24;

/// Innovations of one frame: noise of each band over its amplitude, variance about 1. Bands of Y'
/// first, then those of Cb and Cr at their resolution.
#[derive(Clone, Debug, PartialEq)]
pub struct AtlasFrame {
    pub bands: [GreyImage; ALL_BANDS],
}

/// Residuals of a frame in its coded planes, with the content that they belong to.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceFrame {
    /// Size of the coded picture, a multiple of the coding's unit.
    pub size: [usize; 2],
    /// R', G', B' of the picture without noise, rounded.
    pub content: Vec<[u8; 3]>,
    /// Real minus noise-free samples of Y', Cb and Cr, in units of [`RESIDUAL_STEP`].
    pub residuals: [Vec<i16>; 3],
    /// [`USABLE`] and [`UNCLIPPED`] for each px.
    pub flags: Vec<u8>,
    /// `None` if the model's file does not state it.
    pub picture: Option<SourcePicture>,
}

impl SourceFrame {
    /// Content as planes, code values.
    pub fn rgb(&self) -> [GreyImage; 3] {
        let [width, height] = self.size;
        let channel = |c: usize| self.content.iter().map(|code| f32::from(code[c])).collect();
        std::array::from_fn(|c| GreyImage { width, height, values: channel(c) })
    }

    /// 1 where a flag is set, otherwise 0.
    pub fn mask(&self, flag: u8) -> GreyImage {
        let [width, height] = self.size;
        let values = self.flags.iter().map(|flags| if flags & flag == 0 { 0.0 } else { 1.0 }).collect();
        GreyImage { width, height, values }
    }

    /// A plane of residuals, code values.
    pub fn residual(&self, plane: usize, chroma_factor: [usize; 2]) -> GreyImage {
        let factor = if plane == 0 { [1, 1] } else { chroma_factor };
        let [width, height] = [0, 1].map(|axis| self.size[axis] / factor[axis]);
        let values = self.residuals[plane].iter().map(|&v| RESIDUAL_STEP * f32::from(v)).collect();
        GreyImage { width, height, values }
    }
}

/// The parts of a model that follow from its sources.
pub type AtlasParts = (Vec<AtlasFrame>, [Vec<TileCandidate>; CLASSES], DescriptorScale);

/// Innovations of the frames, the candidates among their tiles, and the scale of descriptors.
pub fn build(numbers: &ModelNumbers, sources: &[SourceFrame]) -> AtlasParts {
    let factor = numbers.chroma_factor();
    let of_source = |source: &SourceFrame| numbers.scale.standardised(Features::of(&source.rgb()));
    let features: Vec<Features> = sources.iter().map(of_source).collect();
    let innovations = |(source, features): (&SourceFrame, &Features)| {
        let chroma = features.reduced(factor);
        let masked = PlaneFilling::new(&source.mask(USABLE), factor);
        let mut bands = (0..3).flat_map(|plane| {
            let mut residual = source.residual(plane, factor);
            masked.fill(&mut residual, plane);
            split(&residual, plane)
        });
        let bands = std::array::from_fn(|b| {
            let (features, plane) = if b < FIRST_BAND[1] { (features, 0) } else { (&chroma, 1) };
            let mut band = bands.next().unwrap_or_else(|| GreyImage::uniform(0, 0, 0.0));
            for (i, v) in band.values.iter_mut().enumerate() {
                *v /= amplitude(&numbers.atlas_gains[b], &features.at(i));
            }
            masked.fill(&mut band, plane);
            band
        });
        AtlasFrame { bands }
    };
    let frames = sources.iter().zip(&features).map(innovations).collect();
    let tile_frames = |source: &SourceFrame| FrameTiles {
        blocks: DescriptorBlocks::of(&source.rgb(), None),
        usable: source.mask(USABLE),
        unclipped: source.mask(UNCLIPPED),
    };
    let tiles: Vec<FrameTiles> = sources.iter().map(tile_frames).collect();
    let mut candidates = candidates(&tiles, factor.map(|factor| DESCRIPTOR_BLOCK_PX * factor));
    let descriptors: Vec<Descriptor> = candidates.iter().flatten().map(|candidate| candidate.descriptor).collect();
    let scale = DescriptorScale::of(&descriptors);
    for candidate in candidates.iter_mut().flatten() {
        candidate.descriptor = scale.standardised(&candidate.descriptor);
    }
    (frames, candidates, scale)
}

/// A tile of the atlas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileCandidate {
    pub frame: u32,
    /// Top left corner, luma px.
    pub at: [u32; 2],
    /// Descriptor of the tile's content, standardised in a model.
    pub descriptor: Descriptor,
}

/// A frame's tiles by usability.
pub struct FrameTiles {
    pub blocks: DescriptorBlocks,
    /// 1 where a pixel may be used, otherwise 0.
    pub usable: GreyImage,
    /// 1 where a pixel is not clipped, otherwise 0.
    pub unclipped: GreyImage,
}

/// Mean of a tile's blocks, from its upper left block `block`.
fn tile_mean(blocks: &GreyImage, block: [usize; 2]) -> f32 {
    let side = TILE_PX / DESCRIPTOR_BLOCK_PX;
    let row_sum = |row: usize| blocks.values[row * blocks.width + block[0]..][..side].iter().sum::<f32>();
    (block[1]..block[1] + side).map(row_sum).sum::<f32>() / (side * side) as f32
}

/// How tiles are assigned to classes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Partition {
    /// Quarters of each frame, rotated from frame to frame.
    Quarters,
    /// Squares of this side, in a pattern of 2 × 2, rotated from frame to frame.
    Squares(usize),
    /// Four strips across each frame, rotated from frame to frame.
    Rows,
    Columns,
}

impl Partition {
    /// Class of a tile; `None` if it crosses a border.
    fn class(self, frame: usize, at: [usize; 2], size: [usize; 2]) -> Option<usize> {
        let part = |axis: usize, side: usize| {
            let (first, last) = (at[axis] / side.max(1), (at[axis] + TILE_PX - 1) / side.max(1));
            (first == last).then_some(first)
        };
        let place = match self {
            Self::Quarters => part(0, size[0].div_ceil(2))? + 2 * part(1, size[1].div_ceil(2))?,
            Self::Squares(side) => part(0, side)? % 2 + 2 * (part(1, side)? % 2),
            Self::Rows => part(1, size[1].div_ceil(CLASSES))?,
            Self::Columns => part(0, size[0].div_ceil(CLASSES))?,
        };
        Some((place + frame) % CLASSES)
    }
}

/// Candidates of each class. `unit_px`: the coding's unit, across and down. Empty classes remain if
/// there are too few tiles.
pub fn candidates(frames: &[FrameTiles], unit_px: [usize; 2]) -> [Vec<TileCandidate>; CLASSES] {
    // Usable tiles with the share of their unclipped pixels.
    let mut tiles: Vec<(f32, TileCandidate, [usize; 2])> = Vec::new();
    for (f, frame) in frames.iter().enumerate() {
        let size = [frame.usable.width, frame.usable.height];
        let [usable, unclipped] = [&frame.usable, &frame.unclipped].map(|mask| mask.reduced(DESCRIPTOR_BLOCK_PX));
        for y in (0..(size[1] + 1).saturating_sub(TILE_PX)).step_by(unit_px[1]) {
            for x in (0..(size[0] + 1).saturating_sub(TILE_PX)).step_by(unit_px[0]) {
                let block = [x, y].map(|v| v / DESCRIPTOR_BLOCK_PX);
                if tile_mean(&usable, block) < MIN_USABLE {
                    continue;
                }
                let descriptor = frame.blocks.tile(block.map(|v| v as i64));
                let candidate = TileCandidate { frame: f as u32, at: [x as u32, y as u32], descriptor };
                tiles.push((tile_mean(&unclipped, block), candidate, size));
            }
        }
    }
    let of = |partition: Partition| -> [Vec<TileCandidate>; CLASSES] {
        let mut classes: [Vec<(f32, TileCandidate)>; CLASSES] = Default::default();
        for (share, candidate, size) in &tiles {
            let at = candidate.at.map(|v| v as usize);
            if let Some(class) = partition.class(candidate.frame as usize, at, *size) {
                classes[class].push((*share, *candidate));
            }
        }
        classes.map(|mut tiles| {
            tiles.sort_by(|a, b| b.0.total_cmp(&a.0));
            let good = tiles.partition_point(|tile| tile.0 >= MIN_UNCLIPPED);
            tiles.truncate(good.max(MIN_CANDIDATES));
            tiles.into_iter().map(|tile| tile.1).collect()
        })
    };
    let min_count = |classes: &[Vec<TileCandidate>; CLASSES]| classes.iter().map(Vec::len).min().unwrap_or(0);
    let quarters = of(Partition::Quarters);
    if min_count(&quarters) >= MIN_CANDIDATES {
        return quarters;
    }
    // Masks can leave a quarter empty.
    let others = [Partition::Squares(160), Partition::Squares(128), Partition::Rows, Partition::Columns].map(of);
    let all = std::iter::once(quarters).chain(others);
    // The first of the best.
    all.reduce(|best, next| if min_count(&next) > min_count(&best) { next } else { best }).unwrap_or_default()
}
