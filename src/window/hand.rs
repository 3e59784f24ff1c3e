//! What the pointer in the picture is for, where a part of the window asks for a rectangle.

use eframe::egui::{self, Align2, Color32, Key, Stroke, Ui, vec2};
use glam::DVec2;

use super::fields::is_taken_back;
use super::picture::{Seen, plate};
use locard_engine::pixels::Rect;

/// Who asked for places in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Edges that plots compare: of the camera's picture, and of something virtual.
    RealEdge,
    VirtualEdge,
    /// A patch whose brightness is followed.
    Patch,
    /// What the camera is calibrated by.
    PlainPlace,
    Edge,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Question {
    pub purpose: Purpose,
    /// What a person is told to do.
    pub hint: &'static str,
    /// The side of a square that is large enough, px; told while a rectangle is dragged.
    pub least_px: u32,
    /// One after another, until Esc.
    pub repeats: bool,
}

/// The whole pixels of a rectangle that was picked; `None` if there are none.
pub fn rect(places: &[DVec2]) -> Option<Rect> {
    let [from, to] = places else { return None };
    let [x0, y0, x1, y1] = [from.x, from.y, to.x, to.y].map(|at| at.round() as i32);
    Some(Rect::new(x0, y0, x1, y1)).filter(|rect| !rect.is_empty())
}

#[derive(Clone, Debug)]
struct Asking {
    question: Question,
    /// From corner to corner so far, px of the picture.
    so_far: Option<[DVec2; 2]>,
}

/// Asks a person for rectangles of the picture, picked by dragging from corner to corner: one question at a time, the last
/// one holds.
#[derive(Clone, Debug, Default)]
pub struct Hand {
    asking: Option<Asking>,
    answered: Option<(Purpose, Vec<DVec2>)>,
}

impl Hand {
    /// A button that asks. It is lit as long as the question stands, and ends it when it is pressed again.
    pub fn button(&mut self, ui: &mut Ui, text: &str, question: Question) {
        let asks = self.asks_for() == Some(question.purpose);
        if ui.add(egui::Button::selectable(asks, text).frame_when_inactive(true)).clicked() {
            self.asking = (!asks).then_some(Asking { question, so_far: None });
            self.answered = None;
        }
    }

    /// What is being asked for.
    pub fn asks_for(&self) -> Option<Purpose> {
        self.asking.as_ref().map(|asking| asking.question.purpose)
    }

    /// The upper left and the lower right of what was picked, px of the picture, once.
    pub fn answer(&mut self, purpose: Purpose) -> Option<Vec<DVec2>> {
        self.answered.take_if(|(of, _)| *of == purpose).map(|(_, places)| places)
    }

    pub fn cancel(&mut self) {
        self.asking = None;
    }

    /// Takes what was clicked and dragged in the picture, and shows what is picked so far.
    pub fn work(&mut self, seen: &Seen) {
        let Some(asking) = &mut self.asking else { return };
        let px = |at: egui::Vec2| DVec2::new(at.x.into(), at.y.into());
        let response = &seen.response;
        let limited = |at| px(seen.placed.picture_px(at).clamp(egui::Vec2::ZERO, seen.size));
        if response.drag_started_by(egui::PointerButton::Primary) {
            let origin = response.ctx.input(|i| i.pointer.press_origin());
            asking.so_far = origin.map(|origin| [limited(origin); 2]);
        }
        if let (Some([_, to]), Some(at)) = (&mut asking.so_far, response.interact_pointer_pos()) {
            *to = limited(at);
        }
        paint(asking, seen);
        if let Some([a, b]) = asking.so_far.filter(|_| response.drag_stopped()) {
            self.answered = Some((asking.question.purpose, vec![a.min(b), a.max(b)]));
            asking.so_far = None;
            if !asking.question.repeats {
                self.asking = None;
            }
        } else if seen.response.ctx.input(|i| i.key_pressed(Key::Escape)) && !is_taken_back(&seen.response.ctx) {
            // That one was not a field's.
            self.asking = None;
        }
    }
}

fn paint(asking: &Asking, seen: &Seen) {
    let (line, shadow) = (Stroke::new(1.5, Color32::WHITE), Stroke::new(3.5, Color32::from_black_alpha(120)));
    let screen = |px: &DVec2| seen.placed.screen(vec2(px.x as f32, px.y as f32));
    if let Some([a, b]) = &asking.so_far {
        let on_screen = egui::Rect::from_two_pos(screen(a), screen(b));
        for stroke in [shadow, line] {
            seen.painter.rect_stroke(on_screen, 0.0, stroke, egui::StrokeKind::Middle);
        }
        let at = on_screen.right_bottom() + vec2(12.0, 10.0);
        plate(&seen.painter, at, Align2::LEFT_TOP, &told(&asking.question, [a.min(*b), a.max(*b)]), 12.0);
    }
    let end = if asking.question.repeats { ". Esc ends it" } else { "" };
    seen.tell(&format!("{}{end}", asking.question.hint));
    if seen.pointed.is_some() {
        seen.response.ctx.set_cursor_icon(egui::CursorIcon::Crosshair);
    }
}

/// How large a rectangle is, and how large it has to be.
fn told(question: &Question, corners: [DVec2; 2]) -> String {
    let (width, height) = rect(&corners).map_or((0, 0), |rect| (rect.width(), rect.height()));
    match question.least_px {
        0 | 1 => format!("{width} × {height} px"),
        least => format!("{width} × {height} px; {least} × {least} and more are needed"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_that_is_needed_is_told() {
        let question = |least_px| Question { purpose: Purpose::Patch, hint: "", least_px, repeats: false };
        let corners = [DVec2::new(10.2, 20.0), DVec2::new(40.4, 31.0)];
        assert_eq!(told(&question(24), corners), "30 × 11 px; 24 × 24 and more are needed");
        assert_eq!(told(&question(0), corners), "30 × 11 px");
        assert_eq!(told(&question(0), [corners[0]; 2]), "0 × 0 px");
    }
}
