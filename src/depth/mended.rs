//! Recorded depth completed by the picture: its gaps filled, its edges moved to the picture's.

use super::edges::Known;
use super::{edges, holes};
use crate::camera::Intrinsics;

/// Completes `depth_m` (0 where unknown), row by row in `columns`. Which of its pixels are sure, because frames agree on them; none
/// if nobody was asked. `looks` are the picture's pixels. A pixel of the map is `step` pixels of the recorded camera's.
///
/// Whether edges were moved. `None`, and nothing changes, if nothing was measured.
pub fn complete(
    depth_m: &mut Vec<f32>,
    is_sure: &[bool],
    looks: &[[f32; 3]],
    columns: usize,
    recorded: &Intrinsics,
    step: f64,
) -> Option<bool> {
    let guessed = holes::fill(depth_m, looks, columns, (recorded.fx_px / step) as f32)?;
    let off_px = (f64::from(recorded.width_px) * edges::MOST_OFF / step).round() as usize;
    let is_moved = edges::are_off(depth_m, looks, columns, off_px);
    if is_moved {
        let known = |i: usize| match () {
            () if guessed[i] => Known::Guessed,
            () if is_sure.get(i) == Some(&true) => Known::Sure,
            () => Known::Measured,
        };
        let known: Vec<_> = (0..depth_m.len()).map(known).collect();
        *depth_m = edges::on_colors(depth_m, &known, looks, columns, off_px);
    }
    Some(is_moved)
}
