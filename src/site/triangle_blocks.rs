//! A mesh's triangles in blocks of neighbours, for culling.

use std::ops::Range;

use glam::Vec3;

use super::morton::{bounds, morton_code};

/// Triangles per block.
const BLOCK_TRIANGLES: usize = 256;

/// Corners of a triangle, m.
pub type ScanTriangle = [Vec3; 3];

/// Triangles that are near each other.
#[derive(Clone, Debug)]
pub struct TriangleBlock {
    pub triangles: Range<usize>,
    pub center_m: Vec3,
    pub radius_m: f32,
}

/// Triangles sorted along a Morton curve of their centroids.
#[derive(Clone, Debug, Default)]
pub struct TriangleBlocks {
    pub triangles: Vec<ScanTriangle>,
    pub blocks: Vec<TriangleBlock>,
}

impl TriangleBlocks {
    /// Triangles without area are left out.
    pub fn new(triangles: impl Iterator<Item = ScanTriangle>) -> Self {
        let mut triangles: Vec<ScanTriangle> =
            triangles.filter(|[a, b, c]| (*b - *a).cross(*c - *a).length_squared() > 0.0).collect();
        let (low, high) = bounds(triangles.iter().flatten());
        let scale = ((1u32 << 20) as f32) / (high - low).max_element().max(f32::MIN_POSITIVE);
        triangles.sort_by_cached_key(|corners| morton_code((centroid(corners) - low) * scale));
        let blocks = (0..triangles.len()).step_by(BLOCK_TRIANGLES).map(|start| {
            let range = start..triangles.len().min(start + BLOCK_TRIANGLES);
            let (low, high) = bounds(triangles[range.clone()].iter().flatten());
            TriangleBlock { triangles: range, center_m: 0.5 * (low + high), radius_m: 0.5 * (high - low).length() }
        });
        let blocks = blocks.collect();
        Self { triangles, blocks }
    }
}

fn centroid(corners: &ScanTriangle) -> Vec3 {
    corners.iter().sum::<Vec3>() / 3.0
}
