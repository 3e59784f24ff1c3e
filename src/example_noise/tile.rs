//! Size of the synthesis' cells, and of their sources in the atlas.

/// Distance of cells, luma px.
pub const CELL_PX: usize = 64;
/// Overlap of neighbouring cells, luma px.
pub const OVERLAP_PX: usize = 16;
/// Side of a cell with both overlaps, and of its source, luma px.
pub const TILE_PX: usize = CELL_PX + OVERLAP_PX;
