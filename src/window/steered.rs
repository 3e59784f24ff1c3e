//! A place in the picture that the arrow keys carry about and Enter clicks, for whoever has no pointer.

use eframe::egui::{Color32, Context, Key, Modifiers, Pos2, Stroke, Vec2, vec2};

use super::picture::Seen;

/// So far a key carries it, px of the picture; with Shift by one.
const STEP_PX: f32 = 16.0;
/// Half of the cross's arms, points.
const ARM: f32 = 12.0;

/// See above.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steered {
    at_px: Option<Vec2>,
    clicks: bool,
}

impl Steered {
    /// Takes its keys, while a place is asked for in a picture of that size. It begins in the middle; the pointer takes over
    /// when it is moved.
    pub fn keys(&mut self, ctx: &Context, size_px: Vec2) {
        if ctx.input(|i| i.pointer.delta() != Vec2::ZERO) {
            *self = Self::default();
        }
        let ways = [
            (Key::ArrowLeft, -Vec2::X),
            (Key::ArrowRight, Vec2::X),
            (Key::ArrowUp, -Vec2::Y),
            (Key::ArrowDown, Vec2::Y),
        ];
        // The key with Shift first: without it any modifier would do.
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

    /// Points, and clicks, in the picture.
    pub fn over(&mut self, seen: &mut Seen) {
        let Some(at_px) = self.at_px else { return };
        seen.pointed = Some(at_px);
        if std::mem::take(&mut self.clicks) {
            seen.clicked = Some(at_px);
        }
        let at = seen.placed.screen(at_px);
        for (width, color) in [(3.0, Color32::from_black_alpha(150)), (1.0, Color32::WHITE)] {
            let line = |a: Pos2, b: Pos2| seen.painter.line_segment([a, b], Stroke::new(width, color));
            line(at - vec2(ARM, 0.0), at + vec2(ARM, 0.0));
            line(at - vec2(0.0, ARM), at + vec2(0.0, ARM));
        }
    }
}
