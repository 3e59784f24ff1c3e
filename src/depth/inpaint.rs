//! Inpainting of recorded depth, guided by the picture: fills holes, aligns edges with the
//! picture's.

use super::edges::DepthOrigin;
use super::{edges, holes};
use crate::camera::Intrinsics;

/// Inpaints `depth_m`, row-major in `columns`, 0 where unknown. `is_reliable`: pixels with a
/// reliable consensus; empty without neighbours. `sqrt_colors`: the picture's pixels. A pixel of
/// the map is `step` pixels of the recorded camera.
///
/// Returns true if edges were moved, and `None` without a change if nothing was measured.
pub fn inpaint(
    depth_m: &mut Vec<f32>,
    is_reliable: &[bool],
    sqrt_colors: &[[f32; 3]],
    columns: usize,
    recorded: &Intrinsics,
    step: f64,
) -> Option<bool> {
    let is_shadow = holes::fill(depth_m, sqrt_colors, columns, (recorded.fx_px / step) as f32)?;
    let max_offset_px = (f64::from(recorded.width_px) * edges::MAX_EDGE_OFFSET / step).round() as usize;
    let is_moved = edges::are_misaligned(depth_m, sqrt_colors, columns, max_offset_px);
    if is_moved {
        let origin = |i: usize| {
            if is_shadow[i] {
                DepthOrigin::Extrapolated
            } else if is_reliable.get(i) == Some(&true) {
                DepthOrigin::Consensus
            } else {
                DepthOrigin::Measured
            }
        };
        let origins: Vec<_> = (0..depth_m.len()).map(origin).collect();
        *depth_m = edges::align_edges(depth_m, &origins, sqrt_colors, columns, max_offset_px);
    }
    Some(is_moved)
}
