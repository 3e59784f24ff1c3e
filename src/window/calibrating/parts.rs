//! Common parts of the noise and sharpness sections: the list of picked regions, and the buttons to
//! accept or discard.

use eframe::egui::{self, Align, Layout, RichText, Ui, vec2};

use super::super::region_picker::RegionPurpose;
use super::super::session::Session;
use super::super::tool::ToolStack;
use locard_engine::pixels::Rect;

/// A picked region of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameRegion {
    pub frame: usize,
    pub at: Rect,
}

/// A newly picked region of the displayed frame.
pub fn answer(tools: &mut ToolStack, purpose: RegionPurpose, session: &Session) -> Option<FrameRegion> {
    let at = tools.take_region(purpose)?;
    Some(FrameRegion { frame: session.frame()?.index, at })
}

/// Result of a picked region.
#[derive(Clone, Debug, PartialEq)]
pub enum RegionVerdict {
    /// Not measured yet.
    Waits,
    Good(String),
    /// Excluded, with the reason.
    Bad(String),
}

/// An action on an entry of the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ListAction {
    /// Shows the frame of the region.
    Show(usize),
    Drop(usize),
}

/// Width of the button behind a verdict, points.
const DROP_BUTTON_PT: f32 = 56.0;

/// The picked regions, each with its verdict and a button to remove it.
pub fn list<'a>(ui: &mut Ui, what: &str, verdicts: impl IntoIterator<Item = &'a RegionVerdict>) -> Option<ListAction> {
    let mut action = None;
    for (n, verdict) in verdicts.into_iter().enumerate() {
        let name = format!("{what} {}", n + 1);
        ui.horizontal_top(|ui| {
            if ui.link(&name).on_hover_text("Show its frame").clicked() {
                action = Some(ListAction::Show(n));
            }
            let room = ui.available_width() - DROP_BUTTON_PT;
            ui.allocate_ui_with_layout(vec2(room, 0.0), Layout::top_down(Align::LEFT), |ui| {
                ui.set_width(room);
                match verdict {
                    RegionVerdict::Waits => ui.weak("…"),
                    RegionVerdict::Good(text) => ui.label(text),
                    RegionVerdict::Bad(why) => ui.label(RichText::new(why).color(ui.visuals().warn_fg_color)),
                };
            });
            let drop = ui.small_button("Drop");
            drop.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("Drop {name}")));
            if drop.clicked() {
                action = Some(ListAction::Drop(n));
            }
        });
    }
    action
}

/// Marks of the picked regions for the picture; excluded ones are labelled.
pub fn marks<'a>(
    what: &'static str,
    places: &'a [FrameRegion],
    verdicts: &'a [RegionVerdict],
) -> impl Iterator<Item = (usize, Rect, String)> + 'a {
    places.iter().enumerate().map(move |(n, place)| {
        let end = if matches!(verdicts.get(n), Some(RegionVerdict::Bad(_))) { ": left out" } else { "" };
        (place.frame, place.at, format!("{what} {}{end}", n + 1))
    })
}

/// A small secondary label.
pub fn aside(ui: &mut Ui, text: impl ToString) {
    ui.label(RichText::new(text.to_string()).small().weak());
}

/// The user's decision on a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    Apply,
    Discard,
}

/// Buttons to apply or discard a measurement of `quantity`, which their accessible names contain:
/// several measurements can be shown at once.
pub fn apply_or_discard(ui: &mut Ui, quantity: &str, is_applied: bool) -> Option<Decision> {
    ui.horizontal(|ui| {
        if is_applied {
            ui.weak("applied");
        }
        let button = |ui: &mut Ui, text: &str, is_enabled: bool| {
            let response = ui.add_enabled(is_enabled, egui::Button::new(text));
            let name = || format!("{text}: {quantity}");
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, response.enabled(), name()));
            response
        };
        let apply = button(ui, "Apply to profile", !is_applied).on_hover_text("Ctrl+S saves it");
        let discard = button(ui, "Discard", true);
        if apply.clicked() { Some(Decision::Apply) } else { discard.clicked().then_some(Decision::Discard) }
    })
    .inner
}
