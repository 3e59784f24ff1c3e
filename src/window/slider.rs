//! A slider with its number. A press beside the handle brings it there; a press on the handle takes hold of it where it is
//! pressed, so that nothing changes until the pointer moves, and nothing jumps then.

use eframe::egui::{self, Id, Response, Ui, WidgetInfo, style::HandleShape};

use super::fields::{rounded, short, typed};

/// The values of a slider, from end to end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rail {
    pub min: f64,
    pub max: f64,
    /// Equal ways are equal ratios. Where the range has 0, the least ratio ends at [`LEAST`].
    pub by_ratio: bool,
    /// Whole numbers alone.
    pub whole: bool,
}

/// Besides 0 the value nearest to it that a slider by ratios goes to.
const LEAST: f64 = 1e-5;

impl Rail {
    /// Where a value stands, 0 to 1: as egui's slider has it, which does not say.
    fn share(&self, n: f64) -> f64 {
        let Self { min, max, .. } = *self;
        match () {
            () if n <= min => 0.0,
            () if n >= max => 1.0,
            () if !self.by_ratio => (n - min) / (max - min),
            () if min >= 0.0 => {
                let [from, to] = self.decades();
                ((n.log10() - from) / (to - from)).clamp(0.0, 1.0)
            }
            () if n < 0.0 => self.zero() * (1.0 - Self { min: 0.0, max: -min, ..*self }.share(-n)),
            () => self.zero() + (1.0 - self.zero()) * Self { min: 0.0, ..*self }.share(n),
        }
    }

    /// The value at a place, the other way round.
    fn at(&self, share: f64) -> f64 {
        let Self { min, max, .. } = *self;
        let zero = self.zero();
        match () {
            () if share <= 0.0 => min,
            () if share >= 1.0 => max,
            () if !self.by_ratio => min + (max - min) * share,
            () if min >= 0.0 => {
                let [from, to] = self.decades();
                10f64.powf(from + (to - from) * share)
            }
            () if share < zero => -Self { min: 0.0, max: -min, ..*self }.at(1.0 - share / zero),
            () => Self { min: 0.0, ..*self }.at((share - zero) / (1.0 - zero)),
        }
    }

    fn decades(&self) -> [f64; 2] {
        [if self.min > 0.0 { self.min } else { LEAST }, self.max].map(f64::log10)
    }

    /// Where 0 stands of a range by ratios that goes to both sides of it.
    fn zero(&self) -> f64 {
        let [below, above] = [-self.min, self.max].map(|end| end.log10().abs());
        below / (below + above)
    }
}

/// A handle that is held: the value and the pointer's place when it was pressed.
#[derive(Clone, Copy, Debug)]
struct Held {
    value: f64,
    x: f32,
}

/// Shows a slider, and its number to drag and to type; `called` names them to those who do not see them. What is done to
/// either is done to the response; whether either was double-clicked stands beside it, for a slider knows drags alone.
pub fn show(ui: &mut Ui, called: &str, n: &mut f64, rail: Rail, unit: &str) -> (Response, bool) {
    let slider = slide(ui, n, rail);
    let is_twice = ui.input(|i| i.pointer.button_double_clicked(egui::PointerButton::Primary));
    let is_twice = is_twice && slider.contains_pointer();
    slider.widget_info(|| WidgetInfo::slider(true, *n, called));
    let ends = rail.min..=rail.max;
    let length = f64::from(length(ui));
    let at = rail.share(*n);
    let speed = (rail.at(at + 0.5 / length) - rail.at(at - 0.5 / length)).max(f64::MIN_POSITIVE);
    let drag = egui::DragValue::new(n).range(ends).speed(speed).suffix(unit).custom_parser(typed(ui.ctx()));
    let drag = drag.clip_text(true);
    let number = ui.add(drag.custom_formatter(|n, _| short(n)).update_while_editing(false)).labelled_by(slider.id);
    let is_number = number.has_focus() || number.lost_focus();
    let is_twice = is_twice || number.double_clicked();
    (if is_number { number.union(slider) } else { slider.union(number) }, is_twice)
}

/// The way of the handle, points.
fn length(ui: &Ui) -> f32 {
    let half = match ui.visuals().handle_shape {
        HandleShape::Circle => radius(ui),
        HandleShape::Rect { aspect_ratio } => radius(ui) * aspect_ratio,
    };
    (ui.spacing().slider_width - 2.0 * half).max(1.0)
}

/// Of the handle, points.
fn radius(ui: &Ui) -> f32 {
    ui.text_style_height(&egui::TextStyle::Body).max(ui.spacing().interact_size.y) / 2.5
}

fn slide(ui: &mut Ui, n: &mut f64, rail: Rail) -> Response {
    let (length, radius, key) = (length(ui), radius(ui), ui.next_auto_id().with("held"));
    let (pressed, held_still, pointer) = ui.input(|i| {
        // In the pass in which it is let go the slider takes the pointer's place once more.
        let held_still = i.pointer.primary_down() || i.pointer.primary_released();
        (i.pointer.primary_pressed(), held_still, i.pointer.interact_pos())
    });
    let mut held: Option<Held> = ui.data(|data| data.get_temp(key)).filter(|_| held_still && !pressed);
    let value = |given: Option<f64>| {
        let Some(to) = given else { return *n };
        if let (Some(at), true) = (pointer, pressed) {
            let apart = (rail.share(to) - rail.share(*n)).abs() * f64::from(length);
            held = (apart <= f64::from(radius)).then_some(Held { value: *n, x: at.x });
        }
        let moved = match (held, pointer) {
            (Some(held), Some(at)) if at.x == held.x => held.value,
            (Some(held), Some(at)) => rail.at(rail.share(held.value) + f64::from((at.x - held.x) / length)),
            _ => to,
        };
        *n = if rail.whole && moved != *n { moved.round() } else { moved };
        *n
    };
    // A value that is only shown is not given back to be clamped.
    let slider = egui::Slider::from_get_set(rail.min..=rail.max, value).clamping(egui::SliderClamping::Edits);
    let slider = slider.logarithmic(rail.by_ratio).smallest_positive(LEAST).smart_aim(false).show_value(false);
    let response = ui.add(slider);
    keep(ui, key, held);
    response
}

fn keep(ui: &Ui, key: Id, held: Option<Held>) {
    ui.data_mut(|data| match held {
        Some(held) => _ = data.insert_temp(key, held),
        None => data.remove::<Held>(key),
    });
}

/// A slider gives more digits than anybody means.
pub fn meant(n: f64, rail: Rail) -> f64 {
    if rail.whole { n.round() } else { rounded(n) }.clamp(rail.min, rail.max)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATIOS: Rail = Rail { min: 0.01, max: 100.0, by_ratio: true, whole: false };

    #[test]
    fn a_value_stands_where_a_hand_would_put_it() {
        let even = Rail { min: -1.0, max: 3.0, by_ratio: false, whole: false };
        assert_eq!([-1.0, 0.0, 3.0].map(|n| even.share(n)), [0.0, 0.25, 1.0]);
        // Four decades: 0.1 is a quarter of the way.
        assert!((RATIOS.share(0.1) - 0.25).abs() < 1e-12 && (RATIOS.at(0.75) - 10.0).abs() < 1e-9);
        // From 0 on it begins at 1e-5: seven decades.
        let from_zero = Rail { min: 0.0, ..RATIOS };
        assert!(from_zero.share(0.0) == 0.0 && (from_zero.share(1.0) - 5.0 / 7.0).abs() < 1e-12);
        // To both sides 0 is in the middle, and what is mirrored mirrors.
        let both = Rail { min: -100.0, ..RATIOS };
        assert!((both.share(1.0) - (0.5 + 2.5 / 7.0)).abs() < 1e-12);
        assert!((both.share(1.0) + both.share(-1.0) - 1.0).abs() < 1e-12);
        for rail in [even, RATIOS, from_zero, both] {
            for share in [0.05, 0.3, 0.6, 0.95] {
                assert!((rail.share(rail.at(share)) - share).abs() < 1e-9, "{rail:?} {share}");
            }
        }
    }
}
