//! Widths of the parts of a parameter's row, so that they fit a panel of any width.

use std::ops::RangeInclusive;

/// Usual widths, points.
const NAME: f32 = 136.0;
pub const VALUE: f32 = 78.0;
pub const STOPS: f32 = 62.0;
const SLIDER: RangeInclusive<f32> = 20.0..=180.0;
/// Width of an optional value's check box, points.
const CHECK: f32 = 20.0;
const SCROLL_BAR: f32 = 8.0;
/// Smallest width of the names in a narrow panel, points.
const NAME_MIN: f32 = 56.0;
/// Smallest width of a name beside a long value, points.
const NAME_MIN_BESIDE_LONG_VALUE: f32 = 40.0;

/// Widths within a row, points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowWidths {
    pub name: f32,
    /// `None` where there is no room for it.
    pub slider: Option<f32>,
    /// Largest width of the stops. A longer text is truncated.
    pub stops: f32,
}

impl RowWidths {
    /// `row` is the width right of the mark, `beside` the gap between parts; `value` and `stops`
    /// are the widths of their texts. Whether there is a slider does not depend on the texts: it
    /// would come and go during a drag.
    pub fn of(row: f32, beside: f32, is_optional: bool, value: f32, stops: Option<f32>) -> Self {
        let check = if is_optional { CHECK + beside } else { 0.0 };
        let with_stops = |stops: Option<f32>| stops.map_or(0.0, |stops| stops + beside);
        let usual = row - beside - check - VALUE - with_stops(stops.map(|_| STOPS)) - SCROLL_BAR;
        let has_slider = usual - NAME_MIN - beside >= *SLIDER.start();
        let least_slider = if has_slider { SLIDER.start() + beside } else { 0.0 };
        // Names of all rows end at one place, but for a long value.
        let common = (row - (VALUE + STOPS + SLIDER.start() + SCROLL_BAR + 4.0 * beside)).clamp(NAME_MIN, NAME);
        let value = value.max(VALUE);
        let left = row - beside - check - value - with_stops(stops.map(|stops| stops.max(STOPS))) - SCROLL_BAR;
        let name = common.min(left - least_slider).max(NAME_MIN_BESIDE_LONG_VALUE);
        let slider = has_slider.then(|| (left - name - beside).clamp(*SLIDER.start(), *SLIDER.end()));
        let stops =
            row - 2.0 * beside - check - value - SCROLL_BAR - name - slider.map_or(0.0, |slider| slider + beside);
        Self { name, slider, stops: stops.max(0.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_row_stay_within_it_whatever_the_value_is() {
        const BESIDE: f32 = 8.0;
        // A panel of a window of 640 points, and wider ones.
        for row in [262.0_f32, 300.0, 420.0] {
            for is_optional in [false, true] {
                let slider =
                    |stops: Option<f32>, value: f32| RowWidths::of(row, BESIDE, is_optional, value, stops).slider;
                for (value, stops) in
                    [(50.0, None), (50.0, Some(60.0)), (110.0, None), (96.0, Some(84.0)), (90.0, Some(300.0))]
                {
                    let widths = RowWidths::of(row, BESIDE, is_optional, value, stops);
                    let parts = [
                        Some(widths.name),
                        is_optional.then_some(CHECK),
                        widths.slider,
                        Some(value.max(VALUE)),
                        stops.map(|stops| stops.max(STOPS).min(widths.stops)),
                    ];
                    let total: f32 = parts.into_iter().flatten().map(|part| part + BESIDE).sum();
                    assert!(
                        total - BESIDE + SCROLL_BAR <= row + 0.01,
                        "{row} {is_optional} {value} {stops:?}: {widths:?}"
                    );
                    assert!(widths.name >= NAME_MIN_BESIDE_LONG_VALUE);
                    assert_eq!(widths.slider.is_some(), slider(stops, 0.0).is_some(), "it does not come and go");
                }
            }
        }
        let usual = RowWidths::of(420.0, BESIDE, false, 50.0, None);
        assert_eq!((usual.name, usual.slider), (NAME, Some(180.0)));
    }
}
