//! A cursor in the picture for keyboard users: the arrow keys move it, Enter clicks.

use eframe::egui::{Color32, Context, Key, Modifiers, Pos2, Stroke, Vec2, vec2};

use super::picture::PictureOutput;

/// Step of an arrow key, px of the picture; with Shift 1 px.
const STEP_PX: f32 = 16.0;
/// Length of the arms of the crosshair, points.
const ARM_LENGTH_PT: f32 = 12.0;

/// Position of the cursor, if it is active, and a pending click.
#[derive(Clone, Copy, Debug, Default)]
pub struct KeyboardCursor {
    at_px: Option<Vec2>,
    clicks: bool,
}

impl KeyboardCursor {
    /// Consumes the arrow keys and Enter while a point of the picture is requested. The cursor
    /// starts at the centre of the picture; a motion of the pointer deactivates it.
    pub fn consume_keys(&mut self, ctx: &Context, size_px: Vec2) {
        if ctx.input(|i| i.pointer.delta() != Vec2::ZERO) {
            *self = Self::default();
        }
        let ways = [
            (Key::ArrowLeft, -Vec2::X),
            (Key::ArrowRight, Vec2::X),
            (Key::ArrowUp, -Vec2::Y),
            (Key::ArrowDown, Vec2::Y),
        ];
        // Keys with Shift first: the binding without modifiers matches any.
        for (modifiers, step_px) in [(Modifiers::SHIFT, 1.0), (Modifiers::NONE, STEP_PX)] {
            for (key, way) in ways {
                let times = ctx.input_mut(|i| i.count_and_consume_key(modifiers, key));
                if times > 0 {
                    let from = self.at_px.unwrap_or(0.5 * size_px);
                    let to = from + way * step_px * times as f32;
                    self.at_px = Some(to.clamp(vec2(0.5, 0.5), size_px - vec2(0.5, 0.5)));
                }
            }
        }
        self.clicks = self.at_px.is_some() && ctx.input_mut(|i| i.consume_key(Modifiers::NONE, Key::Enter));
    }

    /// Overrides the pointer of the picture and paints the crosshair.
    pub fn apply(&mut self, picture: &mut PictureOutput) {
        let Some(at_px) = self.at_px else { return };
        picture.pointed = Some(at_px);
        if std::mem::take(&mut self.clicks) {
            picture.clicked = Some(at_px);
        }
        let at = picture.placed.screen(at_px);
        for (width, color) in [(3.0, Color32::from_black_alpha(150)), (1.0, Color32::WHITE)] {
            let line = |a: Pos2, b: Pos2| picture.painter.line_segment([a, b], Stroke::new(width, color));
            line(at - vec2(ARM_LENGTH_PT, 0.0), at + vec2(ARM_LENGTH_PT, 0.0));
            line(at - vec2(0.0, ARM_LENGTH_PT), at + vec2(0.0, ARM_LENGTH_PT));
        }
    }
}
