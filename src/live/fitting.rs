//! Whether what is seen is the board that a file describes. Until that is sure there is no pose: evidence must not flash up
//! where a board of other sizes happens to fit a picture.

use crate::pose::Pose;
use crate::tags::Sight;

/// Several tags fit together within this root mean square of their corners, px...
const FITS_PX: f64 = 1.0;
/// ... or within this share of a tag's side: a lens that was calibrated badly.
const FITS_SHARE: f64 = 0.02;
/// So many pictures in a row with several tags tell it; with a single one, which always fits, so many.
const SEVERAL: u32 = 2;
const SINGLE: u32 = 6;
/// So many pictures in a row in which the tags do not fit take it back.
const MISFITS: u32 = 5;
/// Pictures farther apart than this are not in a row, seconds.
const APART_S: f64 = 0.25;
/// A camera turns and moves no faster from one to the next, rad/s and m/s.
const FASTEST: f64 = 10.0;

/// What is known of a board so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fitting {
    fits: bool,
    /// The picture before and its pose.
    before: Option<(f64, Pose)>,
    /// Pictures in a row that fit: with any tags, and with several.
    in_a_row: u32,
    several: u32,
    misfits: u32,
}

impl Fitting {
    /// Takes what a picture says and its pose. Whether that pose can be believed.
    pub fn takes(&mut self, time_s: f64, sight: &Sight, pose: &Pose) -> bool {
        let is_several = sight.tags.len() > 1;
        if is_several && !fits(sight) {
            self.misfit();
            return false;
        }
        let goes_on = self.before.is_some_and(|(before_s, before)| {
            let in_s = time_s - before_s;
            let turned = before.rotation.angle_between(pose.rotation);
            let moved_m = before.position_in_world_m().distance(pose.position_in_world_m());
            in_s <= APART_S && turned < 0.02 + FASTEST * in_s && moved_m < 0.02 + FASTEST * in_s
        });
        if !goes_on {
            (self.in_a_row, self.several) = (0, 0);
        }
        self.before = Some((time_s, *pose));
        self.in_a_row += 1;
        self.several += u32::from(is_several);
        self.misfits = 0;
        self.fits |= self.several >= SEVERAL || self.in_a_row >= SINGLE;
        self.fits
    }

    /// The tags of a picture do not stand to each other as on the board.
    pub fn misfit(&mut self) {
        (self.before, self.in_a_row, self.several) = (None, 0, 0);
        self.misfits += 1;
        self.fits &= self.misfits < MISFITS;
    }

    /// Whether the tags of the newest pictures do not fit.
    pub fn has_misfits(&self) -> bool {
        self.misfits > 0
    }

    pub fn is_sure(&self) -> bool {
        self.fits
    }
}

fn fits(sight: &Sight) -> bool {
    let of_sides: Vec<f64> = sight.corners.seen_px.as_chunks::<4>().0.iter().map(|c| c[0].distance(c[1])).collect();
    let side_px = of_sides.iter().sum::<f64>() / of_sides.len().max(1) as f64;
    sight.best.rms_px() <= FITS_PX.max(FITS_SHARE * side_px)
}
