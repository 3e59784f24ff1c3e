//! A slider with its number. A press beside the handle moves it there. A press on the handle keeps
//! the offset of the pointer: nothing changes until the pointer moves, and the value does not jump.
//! It wraps egui's own slider, which moves the handle to the pointer at every press, reports no
//! double click, and has a number that does not clip its text.

use eframe::egui::{self, Id, Response, Ui, WidgetInfo, style::HandleShape};

use super::fields::{rounded, short, typed_parser};

/// Range and scale of a slider.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SliderScale {
    pub min: f64,
    pub max: f64,
    /// Logarithmic. If the range has 0, the smallest magnitude is [`SMALLEST_POSITIVE`].
    pub by_ratio: bool,
    /// Integers only.
    pub whole: bool,
}

/// Smallest magnitude besides 0 of a logarithmic slider.
const SMALLEST_POSITIVE: f64 = 1e-5;

impl SliderScale {
    /// Position of a value, 0 to 1. Replicates egui's slider, whose mapping is private.
    fn share(&self, n: f64) -> f64 {
        let Self { min, max, .. } = *self;
        if n <= min {
            0.0
        } else if n >= max {
            1.0
        } else if !self.by_ratio {
            (n - min) / (max - min)
        } else if min >= 0.0 {
            let [from, to] = self.decades();
            ((n.log10() - from) / (to - from)).clamp(0.0, 1.0)
        } else if n < 0.0 {
            self.zero() * (1.0 - Self { min: 0.0, max: -min, ..*self }.share(-n))
        } else {
            self.zero() + (1.0 - self.zero()) * Self { min: 0.0, ..*self }.share(n)
        }
    }

    /// Value at a position: the inverse of `share`.
    fn at(&self, share: f64) -> f64 {
        let Self { min, max, .. } = *self;
        let zero = self.zero();
        if share <= 0.0 {
            min
        } else if share >= 1.0 {
            max
        } else if !self.by_ratio {
            min + (max - min) * share
        } else if min >= 0.0 {
            let [from, to] = self.decades();
            10f64.powf(from + (to - from) * share)
        } else if share < zero {
            -Self { min: 0.0, max: -min, ..*self }.at(1.0 - share / zero)
        } else {
            Self { min: 0.0, ..*self }.at((share - zero) / (1.0 - zero))
        }
    }

    fn decades(&self) -> [f64; 2] {
        [if self.min > 0.0 { self.min } else { SMALLEST_POSITIVE }, self.max].map(f64::log10)
    }

    /// Position of 0 in a logarithmic range with both signs.
    fn zero(&self) -> f64 {
        let [below, above] = [-self.min, self.max].map(|end| end.log10().abs());
        below / (below + above)
    }
}

/// Value and position of the pointer at the press on the handle.
#[derive(Clone, Copy, Debug)]
struct HandleDrag {
    value: f64,
    x: f32,
}

/// Shows a slider with its number, which can be dragged and typed; `called` is their accessible
/// name. Returns the union of both responses, and whether either was double-clicked, which a
/// slider's response does not report.
pub fn show(ui: &mut Ui, called: &str, n: &mut f64, scale: SliderScale, unit: &str) -> (Response, bool) {
    let slider = slide(ui, n, scale);
    let is_twice = ui.input(|i| i.pointer.button_double_clicked(egui::PointerButton::Primary));
    let is_twice = is_twice && slider.contains_pointer();
    slider.widget_info(|| WidgetInfo::slider(true, *n, called));
    let ends = scale.min..=scale.max;
    let length = f64::from(length(ui));
    let at = scale.share(*n);
    let speed = (scale.at(at + 0.5 / length) - scale.at(at - 0.5 / length)).max(f64::MIN_POSITIVE);
    let drag = egui::DragValue::new(n).range(ends).speed(speed).suffix(unit).custom_parser(typed_parser(ui.ctx()));
    let drag = drag.clip_text(true);
    let number = ui.add(drag.custom_formatter(|n, _| short(n)).update_while_editing(false)).labelled_by(slider.id);
    let is_number = number.has_focus() || number.lost_focus();
    let is_twice = is_twice || number.double_clicked();
    (if is_number { number.union(slider) } else { slider.union(number) }, is_twice)
}

/// Length of the handle's travel, points.
fn length(ui: &Ui) -> f32 {
    let half = match ui.visuals().handle_shape {
        HandleShape::Circle => radius(ui),
        HandleShape::Rect { aspect_ratio } => radius(ui) * aspect_ratio,
    };
    (ui.spacing().slider_width - 2.0 * half).max(1.0)
}

/// Radius of the handle, points.
fn radius(ui: &Ui) -> f32 {
    ui.text_style_height(&egui::TextStyle::Body).max(ui.spacing().interact_size.y) / 2.5
}

fn slide(ui: &mut Ui, n: &mut f64, scale: SliderScale) -> Response {
    let length = length(ui);
    let radius = radius(ui);
    let key = ui.next_auto_id().with("held");
    let (pressed, held_still, pointer) = ui.input(|i| {
        // The slider also follows the pointer in the pass of the release.
        let held_still = i.pointer.primary_down() || i.pointer.primary_released();
        (i.pointer.primary_pressed(), held_still, i.pointer.interact_pos())
    });
    let mut drag: Option<HandleDrag> = ui.data(|data| data.get_temp(key)).filter(|_| held_still && !pressed);
    let value = |given: Option<f64>| {
        let Some(to) = given else { return *n };
        if let (Some(at), true) = (pointer, pressed) {
            let apart = (scale.share(to) - scale.share(*n)).abs() * f64::from(length);
            drag = (apart <= f64::from(radius)).then_some(HandleDrag { value: *n, x: at.x });
        }
        let moved = match (drag, pointer) {
            (Some(drag), Some(at)) if at.x == drag.x => drag.value,
            (Some(drag), Some(at)) => scale.at(scale.share(drag.value) + f64::from((at.x - drag.x) / length)),
            _ => to,
        };
        *n = if scale.whole && moved != *n { moved.round() } else { moved };
        *n
    };
    // Displaying a value does not clamp it.
    let slider = egui::Slider::from_get_set(scale.min..=scale.max, value).clamping(egui::SliderClamping::Edits);
    let slider =
        slider.logarithmic(scale.by_ratio).smallest_positive(SMALLEST_POSITIVE).smart_aim(false).show_value(false);
    let response = ui.add(slider);
    keep(ui, key, drag);
    response
}

fn keep(ui: &Ui, key: Id, drag: Option<HandleDrag>) {
    ui.data_mut(|data| match drag {
        Some(drag) => _ = data.insert_temp(key, drag),
        None => data.remove::<HandleDrag>(key),
    });
}

/// Rounds a slider's value to plausible digits.
pub fn rounded_value(n: f64, scale: SliderScale) -> f64 {
    if scale.whole { n.round() } else { rounded(n) }.clamp(scale.min, scale.max)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATIOS: SliderScale = SliderScale { min: 0.01, max: 100.0, by_ratio: true, whole: false };

    #[test]
    fn slider_position_and_value_are_inverse() {
        let even = SliderScale { min: -1.0, max: 3.0, by_ratio: false, whole: false };
        assert_eq!([-1.0, 0.0, 3.0].map(|n| even.share(n)), [0.0, 0.25, 1.0]);
        // Four decades: 0.1 is a quarter of the way.
        assert!((RATIOS.share(0.1) - 0.25).abs() < 1e-12 && (RATIOS.at(0.75) - 10.0).abs() < 1e-9);
        // A range from 0 begins at 1e-5: seven decades.
        let from_zero = SliderScale { min: 0.0, ..RATIOS };
        assert!(from_zero.share(0.0) == 0.0 && (from_zero.share(1.0) - 5.0 / 7.0).abs() < 1e-12);
        // Both signs: 0 is in the middle, and the mapping is odd.
        let both = SliderScale { min: -100.0, ..RATIOS };
        assert!((both.share(1.0) - (0.5 + 2.5 / 7.0)).abs() < 1e-12);
        assert!((both.share(1.0) + both.share(-1.0) - 1.0).abs() < 1e-12);
        for scale in [even, RATIOS, from_zero, both] {
            for share in [0.05, 0.3, 0.6, 0.95] {
                assert!((scale.share(scale.at(share)) - share).abs() < 1e-9, "{scale:?} {share}");
            }
        }
    }
}
