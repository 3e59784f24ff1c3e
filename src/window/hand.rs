//! What a click or a drag in the picture is for.

use eframe::egui::{self, Align2, Color32, Key, Stroke, vec2};
use glam::DVec2;

use super::picture::Seen;
use crate::pixels::Rect;

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

/// What places are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// So many clicks.
    Points(usize),
    /// A rectangle, by dragging from corner to corner.
    Rect,
}

/// The whole pixels of a rectangle that was picked; `None` if there are none.
pub fn rect(places: &[DVec2]) -> Option<Rect> {
    let [from, to] = places else { return None };
    let [x0, y0, x1, y1] = [from.x, from.y, to.x, to.y].map(|at| at.round() as i32);
    Some(Rect::new(x0, y0, x1, y1)).filter(|rect| !rect.is_empty())
}

#[derive(Clone, Debug)]
struct Asking {
    purpose: Purpose,
    wanted: Wanted,
    /// What a person is told to do.
    hint: String,
    /// Picked so far, px of the picture.
    so_far: Vec<DVec2>,
}

/// Asks a person for places in the picture: one question at a time, the last one holds.
#[derive(Clone, Debug, Default)]
pub struct Hand {
    asking: Option<Asking>,
    answered: Option<(Purpose, Vec<DVec2>)>,
}

impl Hand {
    /// Asks; an earlier question is dropped. The hint says what to pick.
    pub fn ask(&mut self, purpose: Purpose, wanted: Wanted, hint: impl Into<String>) {
        self.asking = Some(Asking { purpose, wanted, hint: hint.into(), so_far: Vec::new() });
        self.answered = None;
    }

    /// What is being asked for.
    pub fn asks_for(&self) -> Option<(Purpose, Wanted)> {
        self.asking.as_ref().map(|asking| (asking.purpose, asking.wanted))
    }

    /// The places that were picked, px of the picture, once; of a rectangle the upper left and the lower right.
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
        let done = match asking.wanted {
            Wanted::Points(count) => {
                asking.so_far.extend(seen.clicked.map(px));
                asking.so_far.len() >= count
            }
            Wanted::Rect => {
                let response = &seen.response;
                let limited = |at| px(seen.placed.picture_px(at).clamp(egui::Vec2::ZERO, seen.size));
                if response.drag_started_by(egui::PointerButton::Primary) {
                    let origin = response.ctx.input(|i| i.pointer.press_origin());
                    asking.so_far = origin.map(limited).into_iter().collect();
                }
                let to = response.interact_pointer_pos().map(limited);
                if let (Some(from), Some(to)) = (asking.so_far.first().copied(), to) {
                    asking.so_far = vec![from, to];
                }
                response.drag_stopped() && asking.so_far.len() == 2
            }
        };
        paint(asking, seen);
        if done {
            let places = match (asking.wanted, asking.so_far.as_slice()) {
                (Wanted::Rect, [a, b]) => vec![a.min(*b), a.max(*b)],
                (_, places) => places.to_vec(),
            };
            self.answered = Some((asking.purpose, places));
            self.asking = None;
        } else if seen.response.ctx.input(|i| i.key_pressed(Key::Escape)) {
            self.asking = None;
        }
    }
}

fn paint(asking: &Asking, seen: &Seen) {
    let (line, shadow) = (Stroke::new(1.5, Color32::WHITE), Stroke::new(3.5, Color32::from_black_alpha(120)));
    let screen = |px: &DVec2| seen.placed.screen(vec2(px.x as f32, px.y as f32));
    let painter = &seen.painter;
    match (asking.wanted, asking.so_far.as_slice()) {
        (Wanted::Rect, [a, b]) => {
            let rect = egui::Rect::from_two_pos(screen(a), screen(b));
            for stroke in [shadow, line] {
                painter.rect_stroke(rect, 0.0, stroke, egui::StrokeKind::Middle);
            }
        }
        (_, places) => {
            for (n, place) in places.iter().enumerate() {
                let at = screen(place);
                for stroke in [shadow, line] {
                    painter.circle_stroke(at, 5.0, stroke);
                }
                let font = egui::FontId::proportional(12.0);
                painter.text(at + vec2(8.0, -8.0), Align2::LEFT_BOTTOM, (n + 1).to_string(), font, Color32::WHITE);
            }
        }
    }
    seen.tell(&asking.hint);
    if seen.pointed.is_some() {
        seen.response.ctx.set_cursor_icon(egui::CursorIcon::Crosshair);
    }
}
