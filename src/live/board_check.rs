//! Verifies that the visible tags are the described board. Poses are withheld until then: evidence
//! must not flash up where a board with other dimensions happens to fit one picture.

use crate::pose::Pose;
use crate::tags::BoardPose;

/// Largest RMS reprojection error of several tags that fit together, px. The larger one of this and
/// [`MAX_RMS_SHARE`] is used.
const MAX_RMS_PX: f64 = 1.0;
/// Largest RMS reprojection error as a share of a tag's side: tolerates an inaccurate lens
/// calibration.
const MAX_RMS_SHARE: f64 = 0.02;
/// Number of consecutive pictures that confirm the board: with several tags, and with a single one,
/// whose fit proves little.
const CONFIRMING_PICTURES: u32 = 2;
const CONFIRMING_PICTURES_SINGLE_TAG: u32 = 6;
/// Number of consecutive misfits that revoke the confirmation.
const REVOKING_MISFITS: u32 = 5;
/// Largest interval between consecutive pictures, seconds.
const MAX_INTERVAL_S: f64 = 0.25;
/// Largest speeds of the camera between consecutive pictures.
const MAX_SPEED_M_S: f64 = 10.0;
const MAX_TURN_RAD_S: f64 = 10.0;

/// Confirms over several pictures that the visible tags form the configured board.
#[derive(Clone, Copy, Debug, Default)]
pub struct BoardCheck {
    is_confirmed: bool,
    /// Time and pose of the previous picture.
    previous: Option<(f64, Pose)>,
    /// Consecutive pictures that fit: with any number of tags, and with several.
    consecutive: u32,
    consecutive_several: u32,
    misfits: u32,
}

impl BoardCheck {
    /// Adds the tags and the pose of a picture. Returns true if the pose can be used.
    pub fn add(&mut self, time_s: f64, sight: &BoardPose, pose: &Pose) -> bool {
        let has_several = sight.tags.len() > 1;
        if has_several && !tags_fit(sight) {
            self.add_misfit();
            return false;
        }
        let is_consecutive = self.previous.is_some_and(|(previous_s, previous)| {
            let in_s = time_s - previous_s;
            let turned = previous.rotation.angle_between(pose.rotation);
            let moved_m = previous.position_in_world_m().distance(pose.position_in_world_m());
            in_s <= MAX_INTERVAL_S && turned < 0.02 + MAX_TURN_RAD_S * in_s && moved_m < 0.02 + MAX_SPEED_M_S * in_s
        });
        if !is_consecutive {
            (self.consecutive, self.consecutive_several) = (0, 0);
        }
        self.previous = Some((time_s, *pose));
        self.consecutive += 1;
        self.consecutive_several += u32::from(has_several);
        self.misfits = 0;
        self.is_confirmed |=
            self.consecutive_several >= CONFIRMING_PICTURES || self.consecutive >= CONFIRMING_PICTURES_SINGLE_TAG;
        self.is_confirmed
    }

    /// Adds a picture whose tags do not match the board's layout.
    pub fn add_misfit(&mut self) {
        (self.previous, self.consecutive, self.consecutive_several) = (None, 0, 0);
        self.misfits += 1;
        self.is_confirmed &= self.misfits < REVOKING_MISFITS;
    }

    /// True if the tags of the latest pictures do not fit.
    pub fn has_misfits(&self) -> bool {
        self.misfits > 0
    }

    pub fn is_confirmed(&self) -> bool {
        self.is_confirmed
    }
}

fn tags_fit(sight: &BoardPose) -> bool {
    let sides_px: Vec<f64> = sight.corners.seen_px.as_chunks::<4>().0.iter().map(|c| c[0].distance(c[1])).collect();
    let side_px = sides_px.iter().sum::<f64>() / sides_px.len().max(1) as f64;
    sight.best.rms_px() <= MAX_RMS_PX.max(MAX_RMS_SHARE * side_px)
}
