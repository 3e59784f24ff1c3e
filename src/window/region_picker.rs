//! Lets the user drag rectangles in the picture for another part of the window.

use eframe::egui::{self, Align2, Color32, Key, Stroke, Ui, vec2};
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

/// The picked rectangle in whole pixels; `None` if it is empty.
pub fn pixel_rect(corners: &[DVec2]) -> Option<Rect> {
    let [from, to] = corners else { return None };
    let [x0, y0, x1, y1] = [from.x, from.y, to.x, to.y].map(|at| at.round() as i32);
    Some(Rect::new(x0, y0, x1, y1)).filter(|rect| !rect.is_empty())
}

#[derive(Clone, Debug)]
struct ActivePrompt {
    prompt: RegionPrompt,
    /// The corners of the rectangle being dragged, px of the picture.
    drag: Option<[DVec2; 2]>,
}

/// Picks rectangles by dragging from corner to corner. A new prompt replaces the current one.
#[derive(Clone, Debug, Default)]
pub struct RegionPicker {
    active: Option<ActivePrompt>,
    picked: Option<(RegionPurpose, Vec<DVec2>)>,
}

impl RegionPicker {
    /// A button that starts a prompt. It is highlighted while the prompt is active; pressing it
    /// again cancels the prompt.
    pub fn button(&mut self, ui: &mut Ui, text: &str, prompt: RegionPrompt) {
        let is_active = self.active_purpose() == Some(prompt.purpose);
        if ui.add(egui::Button::selectable(is_active, text).frame_when_inactive(true)).clicked() {
            self.active = (!is_active).then_some(ActivePrompt { prompt, drag: None });
            self.picked = None;
        }
    }

    /// The purpose of the active prompt.
    pub fn active_purpose(&self) -> Option<RegionPurpose> {
        self.active.as_ref().map(|active| active.prompt.purpose)
    }

    /// Takes the upper left and lower right corner of the last picked region, px of the picture.
    pub fn take_region(&mut self, purpose: RegionPurpose) -> Option<Vec<DVec2>> {
        self.picked.take_if(|(of, _)| *of == purpose).map(|(_, corners)| corners)
    }

    pub fn cancel(&mut self) {
        self.active = None;
    }

    /// Handles drags in the picture and paints the rectangle.
    pub fn update(&mut self, seen: &PictureOutput) {
        let Some(active) = &mut self.active else { return };
        let px = |at: egui::Vec2| DVec2::new(at.x.into(), at.y.into());
        let response = &seen.response;
        let limited = |at| px(seen.placed.picture_px(at).clamp(egui::Vec2::ZERO, seen.size));
        if response.drag_started_by(egui::PointerButton::Primary) {
            let origin = response.ctx.input(|i| i.pointer.press_origin());
            active.drag = origin.map(|origin| [limited(origin); 2]);
        }
        if let (Some([_, to]), Some(at)) = (&mut active.drag, response.interact_pointer_pos()) {
            *to = limited(at);
        }
        paint(active, seen);
        if let Some([a, b]) = active.drag.filter(|_| response.drag_stopped()) {
            self.picked = Some((active.prompt.purpose, vec![a.min(b), a.max(b)]));
            active.drag = None;
            if !active.prompt.repeats {
                self.active = None;
            }
        } else if seen.response.ctx.input(|i| i.key_pressed(Key::Escape)) && !is_typed_reverted(&seen.response.ctx) {
            // Esc was not consumed by a field.
            self.active = None;
        }
    }
}

fn paint(active: &ActivePrompt, seen: &PictureOutput) {
    let (line, shadow) = (Stroke::new(1.5, Color32::WHITE), Stroke::new(3.5, Color32::from_black_alpha(120)));
    let screen = |px: &DVec2| seen.placed.screen(vec2(px.x as f32, px.y as f32));
    if let Some([a, b]) = &active.drag {
        let on_screen = egui::Rect::from_two_pos(screen(a), screen(b));
        for stroke in [shadow, line] {
            seen.painter.rect_stroke(on_screen, 0.0, stroke, egui::StrokeKind::Middle);
        }
        let at = on_screen.right_bottom() + vec2(12.0, 10.0);
        plate(&seen.painter, at, Align2::LEFT_TOP, &size_text(&active.prompt, [a.min(*b), a.max(*b)]), 12.0);
    }
    let end = if active.prompt.repeats { ". Esc ends it" } else { "" };
    seen.prompt(&format!("{}{end}", active.prompt.hint));
    if seen.pointed.is_some() {
        seen.response.ctx.set_cursor_icon(egui::CursorIcon::Crosshair);
    }
}

/// The size of a rectangle and the required size.
fn size_text(prompt: &RegionPrompt, corners: [DVec2; 2]) -> String {
    let (width, height) = pixel_rect(&corners).map_or((0, 0), |rect| (rect.width(), rect.height()));
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
