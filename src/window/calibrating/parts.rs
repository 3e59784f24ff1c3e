//! What measuring noise and measuring sharpness have in common: the list of places, what is taken or left.

use eframe::egui::{self, Align, Layout, RichText, Ui, vec2};

use super::super::region_picker::{self, RegionPicker, RegionPurpose};
use super::super::session::Session;
use locard_engine::pixels::Rect;

/// A place that was picked in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    pub frame: usize,
    pub at: Rect,
}

/// The place of the frame that is shown which was asked for, if it was picked now.
pub fn answer(picker: &mut RegionPicker, purpose: RegionPurpose, session: &Session) -> Option<Picked> {
    let at = picker.take_region(purpose).and_then(|places| region_picker::pixel_rect(&places))?;
    Some(Picked { frame: session.frame()?.index, at })
}

/// What is said of a place.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// It is being measured.
    Waits,
    Good(String),
    /// Why it is left out.
    Bad(String),
}

/// What a person asks for in the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// The frame of a place is to be shown.
    Show(usize),
    Drop(usize),
}

/// What the button behind a verdict needs, points.
const DROP: f32 = 56.0;

/// The places that were picked, each with its verdict and a button that drops it.
pub fn list<'a>(ui: &mut Ui, what: &str, verdicts: impl IntoIterator<Item = &'a Verdict>) -> Option<Asked> {
    let mut asked = None;
    for (n, verdict) in verdicts.into_iter().enumerate() {
        let name = format!("{what} {}", n + 1);
        ui.horizontal_top(|ui| {
            if ui.link(&name).on_hover_text("Show its frame").clicked() {
                asked = Some(Asked::Show(n));
            }
            let room = ui.available_width() - DROP;
            ui.allocate_ui_with_layout(vec2(room, 0.0), Layout::top_down(Align::LEFT), |ui| {
                ui.set_width(room);
                match verdict {
                    Verdict::Waits => ui.weak("…"),
                    Verdict::Good(text) => ui.label(text),
                    Verdict::Bad(why) => ui.label(RichText::new(why).color(ui.visuals().warn_fg_color)),
                };
            });
            let drop = ui.small_button("Drop");
            drop.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("Drop {name}")));
            if drop.clicked() {
                asked = Some(Asked::Drop(n));
            }
        });
    }
    asked
}

/// What is picked, as the picture marks it; those that are left out say so.
pub fn marks<'a>(
    what: &'static str,
    places: &'a [Picked],
    verdicts: &'a [Verdict],
) -> impl Iterator<Item = (usize, Rect, String)> + 'a {
    places.iter().enumerate().map(move |(n, place)| {
        let end = if matches!(verdicts.get(n), Some(Verdict::Bad(_))) { ": left out" } else { "" };
        (place.frame, place.at, format!("{what} {}{end}", n + 1))
    })
}

/// Small and not in the way.
pub fn aside(ui: &mut Ui, text: impl ToString) {
    ui.label(RichText::new(text.to_string()).small().weak());
}

/// Whether what was measured is taken, or left.
pub fn take_or_leave(ui: &mut Ui, what: &str, is_taken: bool) -> Option<bool> {
    ui.horizontal(|ui| {
        if is_taken {
            ui.weak("taken");
        }
        let take = ui.add_enabled(!is_taken, egui::Button::new(format!("Take the {what}")));
        let leave = ui.button(format!("Leave the {what}"));
        match (take.clicked(), leave.clicked()) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        }
    })
    .inner
}
