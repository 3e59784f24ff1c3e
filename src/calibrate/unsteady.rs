//! Detects a moving camera. Noise does not depend on the picture; changes from a moving camera do.
//!
//! - *common*: the share of a frame difference's energy that one affine motion of the whole picture
//!   explains. For a small motion u the difference is −∇I·u (Lucas and Kanade 1981); u has 6
//!   parameters, fitted by least squares together with a constant for flicker. Larger motions are
//!   small in a picture reduced by 4 or 16; energy explained there still counts as a share of the
//!   whole picture's.
//! - *patches*: the share of a block's energy that is in its mean, relative to the whole picture's
//!   mean; the median over blocks. Finds frames whose views differ too much for any motion to be
//!   followed.

use super::rounding::CODES16_PER_CODE8;
use super::scene_sums::{BLOCK, SceneSums};
use crate::fit::quantile::upper_median;

/// Noise alone, even smeared by cameras and video codecs, has a common share below 0.03 and patches
/// below 0.25. Cameras that pan, turn or are hand-held have a common share above 0.23 or patches
/// above 0.5.
const MOTION_SHARE: f64 = 0.2;
const PATCH_SHARE: f64 = 0.45;
/// Smallest suspicious common share, at which σ is 6 % too large.
const SUSPECT_SHARE: f64 = 0.12;

/// Kind of unsteadiness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unsteady {
    /// The whole picture moves. Share of the changes that the motion explains.
    Moves(f64),
    /// Half of the picture changes in patches. Their share of the changes.
    Patches(f64),
    /// The picture may move a little. Share of the changes that the motion explains.
    Doubtful(f64),
}

/// Evidence that a scene is not at rest, if any.
pub(crate) fn unsteady(scene: &SceneSums) -> Option<Unsteady> {
    let common = scene.motion.share();
    let unit = (CODES16_PER_CODE8 * CODES16_PER_CODE8 * (BLOCK * BLOCK) as i64) as f64;
    let shares = (scene.blocks.iter().enumerate())
        .filter(|(i, block)| block.squares[1] > 0 && scene.area(*i).pixels() == BLOCK * BLOCK)
        .map(|(_, block)| block.even / (block.squares[1] as f64 / unit));
    let patches = upper_median(shares).unwrap_or(0.0);
    if common >= MOTION_SHARE {
        Some(Unsteady::Moves(common))
    } else if patches >= PATCH_SHARE {
        Some(Unsteady::Patches(patches))
    } else {
        (common >= SUSPECT_SHARE).then_some(Unsteady::Doubtful(common))
    }
}
