//! Code values: a loupe that follows the pointer, and numbers in pixels that are large enough. All have 8 bits, as the
//! picture on the screen has; of a camera with 16 the loupe gives its own codes, too.

use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, StrokeKind, pos2, vec2};

use super::picture::Seen;
use super::theme::SMALLEST;
use super::viewer::Shown;
use locard_engine::pixels::Pixels;

/// Pixels across in the loupe, and how large each is, points.
const ACROSS: i32 = 11;
const CELL: f32 = 12.0;
/// Numbers stand in pixels from this size on, screen pixels.
pub const NUMBERS_FROM: f32 = 40.0;

/// A picture in the loupe.
pub struct Side<'a> {
    pub name: &'a str,
    pub shown: &'a Shown,
    /// `None` as long as they are not there.
    pub codes: Option<&'a Pixels>,
}

/// Shows what is under the pointer in each picture, side by side, with its code values.
pub fn show(seen: &Seen, sides: &[Side<'_>]) {
    let Some(pointed) = seen.pointed else { return };
    let (x, y) = (pointed.x.floor() as i32, pointed.y.floor() as i32);
    let square = ACROSS as f32 * CELL;
    let fine = sides.iter().any(|side| side.codes.is_some_and(|codes| codes.max_code() > 255));
    let size = vec2(sides.len() as f32 * (square + 8.0) + 8.0, square + if fine { 75.0 } else { 60.0 });
    let at = seen.placed.screen(pointed);
    let panel = seen.painter.clip_rect();
    // Beside the pointer, where there is room.
    let x0 = if at.x + 28.0 + size.x < panel.max.x { at.x + 28.0 } else { at.x - 28.0 - size.x };
    let y0 = if at.y + 28.0 + size.y < panel.max.y { at.y + 28.0 } else { at.y - 28.0 - size.y };
    let back = Rect::from_min_size(pos2(x0, y0), size);
    let painter = &seen.painter;
    painter.rect_filled(back, 6.0, Color32::from_black_alpha(215));
    for (n, side) in sides.iter().enumerate() {
        let min = back.min + vec2(8.0 + n as f32 * (square + 8.0), 22.0);
        let rect = Rect::from_min_size(min, vec2(square, square));
        let (width, height) = (side.shown.size.0 as f32, side.shown.size.1 as f32);
        let corner = pos2((x - ACROSS / 2) as f32, (y - ACROSS / 2) as f32);
        let part = Rect::from_min_size(corner, vec2(ACROSS as f32, ACROSS as f32));
        // What lies beyond the picture stays dark.
        let inside = part.intersect(Rect::from_min_max(Pos2::ZERO, pos2(width, height)));
        let drawn =
            Rect::from_min_max(rect.min + (inside.min - part.min) * CELL, rect.min + (inside.max - part.min) * CELL);
        let uv = Rect::from_min_max(
            pos2(inside.min.x / width, inside.min.y / height),
            pos2(inside.max.x / width, inside.max.y / height),
        );
        painter.image(side.shown.texels, drawn, uv, Color32::WHITE);
        let middle = Rect::from_center_size(rect.center(), vec2(CELL, CELL));
        painter.rect_stroke(middle, 0.0, Stroke::new(1.0, Color32::WHITE), StrokeKind::Outside);
        let font = FontId::proportional(12.0);
        painter.text(min - vec2(0.0, 4.0), Align2::LEFT_BOTTOM, side.name, font, Color32::from_gray(200));
        let codes =
            side.codes.filter(|codes| x >= 0 && y >= 0 && (x as u32) < codes.width && (y as u32) < codes.height);
        let text = codes.map_or_else(String::new, |codes| {
            let [r, g, b] = codes.eight_bits_at(x as u32, y as u32);
            let own = codes.at(x as u32, y as u32).map(|code| code.to_string()).join(" ");
            if codes.max_code() > 255 { format!("{r} {g} {b}\n{own}") } else { format!("{r} {g} {b}") }
        });
        painter.text(
            rect.left_bottom() + vec2(0.0, 4.0),
            Align2::LEFT_TOP,
            text,
            FontId::monospace(12.0),
            Color32::WHITE,
        );
    }
    let place = back.left_bottom() + vec2(8.0, -3.0);
    let bits = if fine { "codes of 8 bits, of 16 below" } else { "codes of 8 bits" };
    let text = format!("{x}, {y}   {bits}");
    painter.text(place, Align2::LEFT_BOTTOM, text, FontId::monospace(SMALLEST), Color32::from_gray(170));
}

/// Writes code values of 8 bits into the pixels that lie in a part of the panel, if they are large enough.
pub fn numbers(seen: &Seen, clip: Rect, codes: &Pixels, pixels_per_point: f32) {
    let scale = seen.placed.scale;
    if scale * pixels_per_point < NUMBERS_FROM {
        return;
    }
    let painter: Painter = seen.painter.with_clip_rect(clip.intersect(seen.painter.clip_rect()));
    let visible = painter.clip_rect().intersect(seen.placed.rect);
    if !visible.is_positive() {
        return;
    }
    let (min, max) = (seen.placed.picture_px(visible.min).floor(), seen.placed.picture_px(visible.max).ceil());
    let font = FontId::monospace((scale * 0.21).max(SMALLEST));
    for y in min.y as u32..(max.y as u32).min(codes.height) {
        for x in min.x as u32..(max.x as u32).min(codes.width) {
            let at = codes.eight_bits_at(x, y);
            let luma: u32 = at.iter().zip([2, 5, 1]).map(|(code, weight)| u32::from(*code) * weight).sum();
            let ink = if luma * 2 > 8 * 255 { Color32::BLACK } else { Color32::WHITE };
            let centre = seen.placed.screen(vec2(x as f32 + 0.5, y as f32 + 0.5));
            for (row, code) in [-1.0, 0.0, 1.0].into_iter().zip(at) {
                let place = centre + vec2(0.0, row * scale * 0.27);
                painter.text(place, Align2::CENTER_CENTER, code.to_string(), font.clone(), ink);
            }
        }
    }
}
