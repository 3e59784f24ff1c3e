//! Notices over the picture: an obstacle with a button to its remedy, and
//! the reason why a click had no effect.

use std::time::Duration;

use eframe::egui::{self, Align, Align2, Label, Layout, Rect, Sense, Ui, UiBuilder, Vec2, pos2, vec2};

use super::picture::{PictureOutput, plate};
use super::question::default_button;

/// Width of a notice in a large panel, points.
const WIDTH: f32 = 380.0;
/// Height that is left for a notice below its upper edge, points.
const HEIGHT: f32 = 110.0;

/// Display time of a refusal, seconds.
const REFUSAL_DURATION_S: f64 = 4.0;

/// The reason why a click had no effect, shown beside its position.
#[derive(Clone, Debug)]
pub struct Refusal {
    text: String,
    at_px: Vec2,
    since_s: f64,
}

impl Refusal {
    pub fn new(picture: &PictureOutput, at_px: Vec2, text: String) -> Self {
        Self { text, at_px, since_s: picture.response.ctx.input(|i| i.time) }
    }

    /// Paints the refusal. Returns false after its display time.
    pub fn show(&self, picture: &PictureOutput) -> bool {
        let ctx = &picture.response.ctx;
        let left_s = REFUSAL_DURATION_S - (ctx.input(|i| i.time) - self.since_s);
        if left_s <= 0.0 {
            return false;
        }
        let at = picture.placed.screen(self.at_px);
        // Towards the centre of the panel.
        let is_right = at.x > picture.painter.clip_rect().center().x;
        let (align, offset) = if is_right { (Align2::RIGHT_TOP, -16.0) } else { (Align2::LEFT_TOP, 16.0) };
        plate(&picture.painter, at + vec2(offset, 16.0), align, &self.text, 13.0);
        ctx.request_repaint_after(Duration::from_secs_f64(left_s));
        true
    }
}

/// A notice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    pub text: String,
    pub remedy: Option<Remedy>,
    /// The user can close it; otherwise it disappears when the work that it is about ends.
    pub can_be_closed: bool,
}

/// Action of a notice's button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    ChooseProfile,
    GoToFrame(usize),
}

impl Remedy {
    fn label(self) -> String {
        match self {
            Self::ChooseProfile => "Choose profile…".to_owned(),
            Self::GoToFrame(frame) => format!("Go to frame {frame}"),
        }
    }
}

/// A button that was pressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoticeButton {
    Remedy(Remedy),
    Close,
}

/// Shows a notice over the picture.
pub fn show(ui: &mut Ui, panel: Rect, notice: &Notice) -> Option<NoticeButton> {
    let width = (panel.width() - 32.0).clamp(80.0, WIDTH);
    let top = (panel.center().y - 0.5 * HEIGHT).max(panel.top() + 8.0);
    let rect = Rect::from_min_size(pos2(panel.center().x - 0.5 * width, top), vec2(width, HEIGHT));
    let builder = UiBuilder::new().max_rect(rect).layout(Layout::top_down(Align::Center));
    // Blocks clicks on the picture below.
    let mut inner = ui.new_child(builder.sense(Sense::click()));
    inner.set_clip_rect(panel);
    let mut pressed = None;
    egui::Frame::popup(inner.style()).show(&mut inner, |ui| {
        ui.set_width(width - 24.0);
        ui.add(Label::new(&notice.text).wrap());
        if let Some(remedy) = notice.remedy {
            ui.add_space(4.0);
            if default_button(ui, &remedy.label(), true).clicked() {
                pressed = Some(NoticeButton::Remedy(remedy));
            }
        }
        if notice.can_be_closed && ui.small_button("Close").clicked() {
            pressed = Some(NoticeButton::Close);
        }
    });
    pressed
}
