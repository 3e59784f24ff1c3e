//! Whether the camera moved. Noise knows nothing of the picture; what a moving camera changes does.
//!
//! - *common*: the share of a frame difference's energy that one affine motion of the whole picture explains. For a
//!   small motion u the difference is −∇I·u (Lucas and Kanade 1981), u = 6 numbers, least squares beside a constant for
//!   the light's flicker. Larger motions are small in a picture reduced by 4 or 16; what is explained there still
//!   counts as a share of the whole picture's energy.
//! - *patches*: the share of a block's energy in its mean, the whole picture's mean taken off; the median over blocks.
//!   Finds frames that show too different a view for any motion to be followed.

use super::rounding::UNIT;
use super::scene_sums::{BLOCK, SceneSums};

/// Noise alone, also of cameras and video codecs that smear it, has a common share below 0.03 and patches below 0.25;
/// cameras that pan, turn or are held by hand have one above 0.23 or the other above 0.5.
const MOVES: f64 = 0.2;
const IN_PATCHES: f64 = 0.45;
/// From here on σ is too large by 6 %.
const DOUBTFUL: f64 = 0.12;

/// What unsteady frames look like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unsteady {
    /// The whole picture moves: the share of the changes that this explains.
    Moves(f64),
    /// Half of the picture changes in patches: their share of the changes.
    Patches(f64),
    /// The picture may move a little: the share of the changes that this explains.
    Doubtful(f64),
}

/// What speaks against a scene at rest, if anything does.
pub(crate) fn unsteady(scene: &SceneSums) -> Option<Unsteady> {
    let common = scene.motion.share();
    let unit = (UNIT * UNIT * (BLOCK * BLOCK) as i64) as f64;
    let mut shares: Vec<f64> = (scene.blocks.iter().enumerate())
        .filter(|(i, block)| block.squares[1] > 0 && scene.area(*i).pixels() == BLOCK * BLOCK)
        .map(|(_, block)| block.even / (block.squares[1] as f64 / unit))
        .collect();
    shares.sort_by(f64::total_cmp);
    let patches = shares.get(shares.len() / 2).copied().unwrap_or(0.0);
    if common >= MOVES {
        Some(Unsteady::Moves(common))
    } else if patches >= IN_PATCHES {
        Some(Unsteady::Patches(patches))
    } else {
        (common >= DOUBTFUL).then_some(Unsteady::Doubtful(common))
    }
}
