//! Inpainting of recorded depth guided by the picture: holes are filled, edges moved to those of the picture.

use super::edges::Known;
use super::{edges, holes};
use crate::camera::Intrinsics;

/// Inpaints `depth_m`, row-major in `columns`, 0 where unknown. `is_sure`: pixels on which frames agree; empty without a vote.
/// `sqrt_colors`: the picture's pixels. A pixel of the map is `step` pixels of the recorded camera.
///
/// Returns whether edges were moved, and `None` without a change if nothing was measured.
pub fn inpaint(
    depth_m: &mut Vec<f32>,
    is_sure: &[bool],
    sqrt_colors: &[[f32; 3]],
    columns: usize,
    recorded: &Intrinsics,
    step: f64,
) -> Option<bool> {
    let guessed = holes::fill(depth_m, sqrt_colors, columns, (recorded.fx_px / step) as f32)?;
    let off_px = (f64::from(recorded.width_px) * edges::MOST_OFF / step).round() as usize;
    let is_moved = edges::are_off(depth_m, sqrt_colors, columns, off_px);
    if is_moved {
        let known = |i: usize| match () {
            () if guessed[i] => Known::Guessed,
            () if is_sure.get(i) == Some(&true) => Known::Sure,
            () => Known::Measured,
        };
        let known: Vec<_> = (0..depth_m.len()).map(known).collect();
        *depth_m = edges::on_colors(depth_m, &known, sqrt_colors, columns, off_px);
    }
    Some(is_moved)
}
