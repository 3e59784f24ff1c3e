//! Recorded depth completed by the picture: its gaps filled, its edges moved to the picture's.

use super::{edges, holes};
use crate::camera::Intrinsics;

/// Completes `depth_m` (0 where unknown), row by row in `columns`. `looks` are the picture's pixels. A pixel of the map
/// is `step` pixels of the recorded camera's.
///
/// Whether nearer surfaces were widened by a pixel, for the picture's soft edges. `None`, and nothing changes, if
/// nothing was measured.
pub fn complete(
    depth_m: &mut Vec<f32>,
    looks: &[[f32; 3]],
    columns: usize,
    recorded: &Intrinsics,
    step: f64,
) -> Option<bool> {
    let guessed = holes::fill(depth_m, looks, columns, (recorded.fx_px / step) as f32)?;
    let off_px = (f64::from(recorded.width_px) * edges::MOST_OFF / step).round() as usize;
    // A map whose edges are on the picture's hides exactly to the pixel and needs no widening.
    let is_widened = edges::are_off(depth_m, looks, columns, off_px);
    if is_widened {
        let on_colors = edges::on_colors(depth_m, &guessed, looks, columns, off_px);
        *depth_m = edges::widened(&on_colors, Some(looks), columns);
    }
    Some(is_widened)
}
