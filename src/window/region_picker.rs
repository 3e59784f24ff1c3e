//! Lets the user drag rectangles in the picture for another part of the window.

use eframe::egui::{self, Align2, Color32, Key, Stroke, vec2};
use glam::DVec2;

use super::fields::is_typed_reverted;
use super::picture::{PictureOutput, plate};
use locard_engine::pixels::Rect;

/// The part of the window that needs a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegionPurpose {
    /// Edges to compare in plots, in the real picture and in a virtual object.
    RealEdge,
    VirtualEdge,
    /// A patch whose brightness is plotted over time.
    Patch,
    /// Regions that calibrate the camera.
    PlainPlace,
    Edge,
}

/// A request for one or more regions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionPrompt {
    pub purpose: RegionPurpose,
    /// Instruction to the user.
    pub hint: &'static str,
    /// Smallest usable side of a square, px, displayed while a rectangle is dragged.
    pub min_side_px: u32,
    /// Picks one region after another until Esc.
    pub repeats: bool,
}

/// The rectangle between two corners in whole pixels; `None` if it is empty.
fn pixel_rect([from, to]: [DVec2; 2]) -> Option<Rect> {
    let [x0, y0, x1, y1] = [from.x, from.y, to.x, to.y].map(|at| at.round() as i32);
    Some(Rect::new(x0, y0, x1, y1)).filter(|rect| !rect.is_empty())
}

/// Picks rectangles by dragging from corner to corner.
#[derive(Clone, Debug)]
pub struct RegionPick {
    prompt: RegionPrompt,
    /// The corners of the rectangle being dragged, px of the picture.
    drag: Option<[DVec2; 2]>,
    is_done: bool,
}

impl RegionPick {
    pub fn new(prompt: RegionPrompt) -> Self {
        Self { prompt, drag: None, is_done: false }
    }

    pub fn purpose(&self) -> RegionPurpose {
        self.prompt.purpose
    }

    /// True if it ends.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// Handles drags in the picture and paints the rectangle. Returns a picked one, which may be
    /// empty.
    pub fn update(&mut self, output: &PictureOutput) -> Option<Option<Rect>> {
        let px = |at: egui::Vec2| DVec2::new(at.x.into(), at.y.into());
        let response = &output.response;
        let limited = |at| px(output.placed.picture_px(at).clamp(egui::Vec2::ZERO, output.size));
        if response.drag_started_by(egui::PointerButton::Primary) {
            let origin = response.ctx.input(|i| i.pointer.press_origin());
            self.drag = origin.map(|origin| [limited(origin); 2]);
        }
        if let (Some([_, to]), Some(at)) = (&mut self.drag, response.interact_pointer_pos()) {
            *to = limited(at);
        }
        self.paint(output);
        if let Some([a, b]) = self.drag.take_if(|_| response.drag_stopped()) {
            self.is_done = !self.prompt.repeats;
            return Some(pixel_rect([a.min(b), a.max(b)]));
        }
        // Esc was not consumed by a field.
        self.is_done = response.ctx.input(|i| i.key_pressed(Key::Escape)) && !is_typed_reverted(&response.ctx);
        None
    }

    fn paint(&self, output: &PictureOutput) {
        let (line, shadow) = (Stroke::new(1.5, Color32::WHITE), Stroke::new(3.5, Color32::from_black_alpha(120)));
        let screen = |px: &DVec2| output.placed.screen(vec2(px.x as f32, px.y as f32));
        if let Some([a, b]) = &self.drag {
            let on_screen = egui::Rect::from_two_pos(screen(a), screen(b));
            for stroke in [shadow, line] {
                output.painter.rect_stroke(on_screen, 0.0, stroke, egui::StrokeKind::Middle);
            }
            let at = on_screen.right_bottom() + vec2(12.0, 10.0);
            plate(&output.painter, at, Align2::LEFT_TOP, &size_text(&self.prompt, [a.min(*b), a.max(*b)]), 12.0);
        }
        let end = if self.prompt.repeats { ". Esc ends it" } else { "" };
        output.prompt(&format!("{}{end}", self.prompt.hint));
        if output.pointed.is_some() {
            output.response.ctx.set_cursor_icon(egui::CursorIcon::Crosshair);
        }
    }
}

/// The size of a rectangle and the required size.
fn size_text(prompt: &RegionPrompt, corners: [DVec2; 2]) -> String {
    let (width, height) = pixel_rect(corners).map_or((0, 0), |rect| (rect.width(), rect.height()));
    match prompt.min_side_px {
        0 | 1 => format!("{width} × {height} px"),
        min => format!("{width} × {height} px; {min} × {min} and more are needed"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_text_includes_the_required_size() {
        let prompt =
            |min_side_px| RegionPrompt { purpose: RegionPurpose::Patch, hint: "", min_side_px, repeats: false };
        let corners = [DVec2::new(10.2, 20.0), DVec2::new(40.4, 31.0)];
        assert_eq!(size_text(&prompt(24), corners), "30 × 11 px; 24 × 24 and more are needed");
        assert_eq!(size_text(&prompt(0), corners), "30 × 11 px");
        assert_eq!(size_text(&prompt(0), [corners[0]; 2]), "0 × 0 px");
    }
}
