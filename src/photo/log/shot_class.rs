//! Classes of photographs of an item: overview, mid-range, close-up.
//!
//! Guides describe the classes by their content and give no numbers: the overview shows the scene,
//! the mid-range photograph the item with its surroundings, the close-up is filled by the item
//! (docs/photo-log.md has the sources). Here the width of the field at the item decides:
//! millimetres per pixel times the picture's width, compared with the item's longest side.

use crate::photo::particulars::{ObjectInView, ViewParticulars};

/// A close-up's field is at most so many times as wide as the item is long.
const MAX_CLOSE_UP_SIZES: f64 = 4.0;
/// Bounds of that field, m: an item of any size may lie beside a scale of 150 mm that covers half
/// of the width; of an item of any size, a field wider than an arm's reach is no close-up.
const CLOSE_UP_FIELD_M: (f64, f64) = (0.3, 1.5);
/// A mid-range photograph's field is at most so many times as wide as the item is long: it covers
/// 2 % of the width and can be recognised.
const MAX_MID_RANGE_SIZES: f64 = 50.0;
/// Bounds of that field, m. The upper one is that of a normal lens (50 mm on 36×24) at 20 feet, the
/// far end of the distance that American courses teach for medium views: 6.1 m · 36/50.
const MID_RANGE_FIELD_M: (f64, f64) = (1.0, 4.4);

/// Class of a photograph with respect to one item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShotClass {
    Overview,
    MidRange,
    CloseUp,
}

impl ShotClass {
    /// Name in the log.
    pub fn name(self) -> &'static str {
        match self {
            Self::Overview => "overview",
            Self::MidRange => "mid-range",
            Self::CloseUp => "close-up",
        }
    }

    /// Class by the item's longest side and the width of the field at the item, metres.
    pub fn of_field(size_m: f64, field_m: f64) -> Self {
        let within = |sizes: f64, (low, high): (f64, f64)| field_m <= (sizes * size_m).clamp(low, high);
        if within(MAX_CLOSE_UP_SIZES, CLOSE_UP_FIELD_M) {
            Self::CloseUp
        } else if within(MAX_MID_RANGE_SIZES, MID_RANGE_FIELD_M) {
            Self::MidRange
        } else {
            Self::Overview
        }
    }

    /// Class of a photograph for one of its objects. `None` out of view. A photograph without a
    /// named subject is one of the site: with a field of 1 m or more it is an overview, not a
    /// mid-range photograph, since small rooms have no farther standpoint.
    pub fn of(view: &ViewParticulars, object: &ObjectInView) -> Option<Self> {
        let field_m = field_m(view, object);
        let is_of_site = view.subject.as_ref().is_none_or(|subject| !subject.is_named);
        let class = (object.in_view > 0.0).then(|| Self::of_field(object.size_m, field_m))?;
        let is_overview = class == Self::MidRange && is_of_site && field_m >= MID_RANGE_FIELD_M.0;
        Some(if is_overview { Self::Overview } else { class })
    }
}

/// Width of the field at an object, metres.
pub fn field_m(view: &ViewParticulars, object: &ObjectInView) -> f64 {
    1e-3 * object.mm_per_px * f64::from(view.width_px)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn class_follows_from_the_field_and_the_size() {
        use ShotClass::{CloseUp, MidRange, Overview};
        // A cartridge case of 19 mm: 0.3 m and 1 m, the lower bounds.
        assert_eq!(
            [0.3, 0.31, 1.0, 1.01].map(|m| ShotClass::of_field(0.019, m)),
            [CloseUp, MidRange, MidRange, Overview]
        );
        // A knife of 0.3 m: 1.2 m, and the upper bound.
        assert_eq!(
            [1.2, 1.21, 4.4, 4.41].map(|m| ShotClass::of_field(0.3, m)),
            [CloseUp, MidRange, MidRange, Overview]
        );
        // A marker of 0.05 m: 0.3 m, 2.5 m.
        assert_eq!([0.3, 2.5, 2.51].map(|m| ShotClass::of_field(0.05, m)), [CloseUp, MidRange, Overview]);
        // A body of 1.8 m: 1.5 m.
        assert_eq!([1.5, 1.6].map(|m| ShotClass::of_field(1.8, m)), [CloseUp, MidRange]);
    }
}
