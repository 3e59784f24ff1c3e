//! Display of code values: a loupe at the pointer, and numbers in magnified pixels. All values have
//! 8 bits, as on the screen; for cameras with 16 bits the loupe also shows the original values.

use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, StrokeKind, pos2, vec2};

use super::picture::PictureOutput;
use super::theme::MIN_TEXT_PT;
use super::viewer::DisplayTexture;
use locard_engine::pixels::Pixels;

/// Width of the loupe, pixels of the picture.
const ACROSS_PX: i32 = 11;
/// Size of a pixel in the loupe, points.
const CELL_PT: f32 = 12.0;
/// Smallest size of a pixel with numbers, screen pixels.
pub const MIN_NUMBERED_PX: f32 = 40.0;

/// A picture in the loupe.
pub struct LoupeSide<'a> {
    pub name: &'a str,
    pub shown: &'a DisplayTexture,
    /// `None` while they are not available.
    pub codes: Option<&'a Pixels>,
}

/// Shows the magnified surroundings of the pointer in each picture, side by side, with code values.
pub fn show(picture: &PictureOutput, sides: &[LoupeSide<'_>]) {
    let Some(pointed) = picture.pointed else { return };
    let (x, y) = (pointed.x.floor() as i32, pointed.y.floor() as i32);
    let square = ACROSS_PX as f32 * CELL_PT;
    let fine = sides.iter().any(|side| side.codes.is_some_and(|codes| codes.max_code() > 255));
    let unit = if fine { "pixel values (8 bit; 16 bit below)" } else { "pixel values (8 bit)" };
    let footer = picture.painter.layout_no_wrap(
        format!("{x}, {y}   {unit}"),
        FontId::monospace(MIN_TEXT_PT),
        Color32::from_gray(170),
    );
    let width = (sides.len() as f32 * (square + 8.0) + 8.0).max(footer.size().x + 16.0);
    let size = vec2(width, square + if fine { 75.0 } else { 60.0 });
    let at = picture.placed.screen(pointed);
    let panel = picture.painter.clip_rect();
    // Beside the pointer, on the side with enough room.
    let x0 = if at.x + 28.0 + size.x < panel.max.x { at.x + 28.0 } else { at.x - 28.0 - size.x };
    let y0 = if at.y + 28.0 + size.y < panel.max.y { at.y + 28.0 } else { at.y - 28.0 - size.y };
    let back = Rect::from_min_size(pos2(x0, y0), size);
    let painter = &picture.painter;
    painter.rect_filled(back, 6.0, Color32::from_black_alpha(215));
    for (n, side) in sides.iter().enumerate() {
        let min = back.min + vec2(8.0 + n as f32 * (square + 8.0), 22.0);
        let rect = Rect::from_min_size(min, vec2(square, square));
        let (width, height) = (side.shown.size.0 as f32, side.shown.size.1 as f32);
        let corner = pos2((x - ACROSS_PX / 2) as f32, (y - ACROSS_PX / 2) as f32);
        let part = Rect::from_min_size(corner, vec2(ACROSS_PX as f32, ACROSS_PX as f32));
        // The area outside the picture stays dark.
        let inside = part.intersect(Rect::from_min_max(Pos2::ZERO, pos2(width, height)));
        let drawn = Rect::from_min_max(
            rect.min + (inside.min - part.min) * CELL_PT,
            rect.min + (inside.max - part.min) * CELL_PT,
        );
        let uv = Rect::from_min_max(
            pos2(inside.min.x / width, inside.min.y / height),
            pos2(inside.max.x / width, inside.max.y / height),
        );
        painter.image(side.shown.texels, drawn, uv, Color32::WHITE);
        let middle = Rect::from_center_size(rect.center(), vec2(CELL_PT, CELL_PT));
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
    let place = back.left_bottom() + vec2(8.0, -3.0 - footer.size().y);
    painter.galley(place, footer, Color32::from_gray(170));
}

/// Writes 8-bit code values into the pixels in a part of the panel, if they are large enough.
pub fn numbers(picture: &PictureOutput, clip: Rect, codes: &Pixels, pixels_per_point: f32) {
    let scale = picture.placed.scale;
    if scale * pixels_per_point < MIN_NUMBERED_PX {
        return;
    }
    let painter: Painter = picture.painter.with_clip_rect(clip.intersect(picture.painter.clip_rect()));
    let visible = painter.clip_rect().intersect(picture.placed.rect);
    if !visible.is_positive() {
        return;
    }
    let (min, max) = (picture.placed.picture_px(visible.min).floor(), picture.placed.picture_px(visible.max).ceil());
    let font = FontId::monospace((scale * 0.21).max(MIN_TEXT_PT));
    for y in min.y as u32..(max.y as u32).min(codes.height) {
        for x in min.x as u32..(max.x as u32).min(codes.width) {
            let at = codes.eight_bits_at(x, y);
            let luma: u32 = at.iter().zip([2, 5, 1]).map(|(code, weight)| u32::from(*code) * weight).sum();
            let ink = if luma * 2 > 8 * 255 { Color32::BLACK } else { Color32::WHITE };
            let centre = picture.placed.screen(vec2(x as f32 + 0.5, y as f32 + 0.5));
            for (row, code) in [-1.0, 0.0, 1.0].into_iter().zip(at) {
                let place = centre + vec2(0.0, row * scale * 0.27);
                painter.text(place, Align2::CENTER_CENTER, code.to_string(), font.clone(), ink);
            }
        }
    }
}
