//! Text and lines drawn into a picture, blended in code values since they are not light of the
//! scene.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};
use glam::DVec2;
use image::{Rgb, RgbImage};

/// Open Sans; its licence is next to it.
const FONT: &[u8] = include_bytes!("../../assets/OpenSans-Regular.ttf");

/// Appearance of text.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Height of the letters, px.
    pub height_px: f32,
    pub ink: Rgb<u8>,
}

/// Draws a line of text whose upper left corner is at `at`, px. It is clipped at `to_px` on the
/// right.
pub fn write(picture: &mut RgbImage, at: (f32, f32), to_px: f32, text: &str, style: Style) {
    set(text, style.height_px, |font, glyph, baseline, x, next| {
        if at.0 + next > to_px {
            return false;
        }
        let mut glyph = glyph.clone();
        glyph.position = point(at.0 + x, at.1 + baseline);
        if let Some(outline) = font.outline_glyph(glyph) {
            let corner = outline.px_bounds().min;
            outline.draw(|i, j, coverage| {
                blend(picture, corner.x as i32 + i as i32, corner.y as i32 + j as i32, style.ink, coverage);
            });
        }
        true
    });
}

/// Width of a line of text, px.
pub fn width_px(text: &str, height_px: f32) -> f32 {
    let mut width = 0.0;
    set(text, height_px, |_, _, _, _, next| {
        width = next;
        true
    });
    width
}

/// Characters of a text that the font lacks.
pub fn missing_characters(text: &str) -> String {
    let Ok(font) = FontRef::try_from_slice(FONT) else { return String::new() };
    text.chars().filter(|character| font.glyph_id(*character).0 == 0).collect()
}

/// Lays out text: calls `letter` with font, glyph, baseline, start and end, until it returns false.
fn set(
    text: &str,
    height_px: f32,
    mut letter: impl FnMut(&ab_glyph::PxScaleFont<&FontRef<'_>>, &Glyph, f32, f32, f32) -> bool,
) {
    // The font is part of the program and covered by a test.
    let Ok(font) = FontRef::try_from_slice(FONT) else { return };
    let font = font.as_scaled(PxScale::from(height_px));
    let mut at = 0.0;
    let mut before: Option<Glyph> = None;
    for character in text.chars() {
        let glyph = font.scaled_glyph(character);
        at += before.map_or(0.0, |before| font.kern(before.id, glyph.id));
        let next = at + font.h_advance(glyph.id);
        if !letter(&font, &glyph, font.ascent(), at, next) {
            return;
        }
        (at, before) = (next, Some(glyph));
    }
}

/// Draws a line with round caps, `width_px` wide.
pub fn line(picture: &mut RgbImage, from: DVec2, to: DVec2, width_px: f64, ink: Rgb<u8>) {
    let reach = 0.5 * width_px + 1.0;
    let size = DVec2::new(picture.width().into(), picture.height().into());
    let (low, high) = ((from.min(to) - reach).max(DVec2::ZERO), (from.max(to) + reach).min(size));
    if !(low.cmplt(high).all() && from.is_finite() && to.is_finite()) {
        return;
    }
    let along = to - from;
    let steep = along.y.abs() > along.x.abs();
    let (start, end) = if steep { (low.y, high.y) } else { (low.x, high.x) };
    for main in start as u32..end.ceil() as u32 {
        // Position of the line in this row, and its half extent across: at most √2 of its width.
        let middle = f64::from(main) + 0.5;
        let (f, a, d) = if steep { (from.y, from.x, along) } else { (from.x, from.y, DVec2::new(along.y, along.x)) };
        let t = if d.y == 0.0 { 0.0 } else { ((middle - f) / d.y).clamp(0.0, 1.0) };
        let across = a + t * d.x;
        let span = 1.5 * reach + 1.0;
        for other in (across - span).max(0.0) as u32..(across + span).max(0.0).ceil() as u32 {
            let (x, y) = if steep { (other, main) } else { (main, other) };
            let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let nearest = from + along * ((p - from).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
            let coverage = 0.5 * width_px + 0.5 - p.distance(nearest);
            blend(picture, x as i32, y as i32, ink, coverage as f32);
        }
    }
}

/// Blends ink into a pixel by its coverage. Pixels outside the picture are ignored.
fn blend(picture: &mut RgbImage, x: i32, y: i32, ink: Rgb<u8>, coverage: f32) {
    let place = u32::try_from(x).ok().zip(u32::try_from(y).ok());
    let Some(pixel) = place.and_then(|(x, y)| picture.get_pixel_mut_checked(x, y)) else { return };
    for (code, ink) in pixel.0.iter_mut().zip(ink.0) {
        *code = (f32::from(*code) + coverage.clamp(0.0, 1.0) * (f32::from(ink) - f32::from(*code))).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: Rgb<u8> = Rgb([24; 3]);
    const STYLE: Style = Style { height_px: 24.0, ink: Rgb([230; 3]) };

    /// Anti-aliased letters: many shades, the stem of an l as high as a T and narrow, and none
    /// beyond the picture's width.
    #[test]
    fn letters_have_the_proportions_of_the_font() {
        let written = |text: &str| {
            let mut sheet = RgbImage::from_pixel(580, 40, PAPER);
            write(&mut sheet, (20.0, 4.0), 500.0, text, STYLE);
            sheet
        };
        let shades = written("f/2.8  1/60 s  ISO 400").pixels().map(|p| p[0]).collect::<std::collections::HashSet<_>>();
        assert!(shades.len() > 50, "{}", shades.len());
        let sheet = written("l");
        let inked = sheet.enumerate_pixels().filter(|(.., p)| p[0] > 127).map(|(x, y, _)| (x, y));
        let (columns, rows): (Vec<_>, Vec<_>) = inked.unzip();
        let across = columns.iter().max().unwrap() - columns.iter().min().unwrap();
        let down = rows.iter().max().unwrap() - rows.iter().min().unwrap();
        // Open Sans: 1556 of its 2789 units per line.
        assert!(across <= 2 && down.abs_diff((24.0 * 1556.0 / 2789.0) as u32) <= 1, "{across}x{down}");
        let long = written(&"W".repeat(100));
        assert!(long.enumerate_pixels().all(|(x, _, p)| x < 500 || *p == PAPER));
        assert!((width_px("WW", 24.0) - 2.0 * width_px("W", 24.0)).abs() < 1.0 && width_px("", 24.0) == 0.0);
    }

    #[test]
    fn line_has_its_width_and_stays_in_the_picture() {
        for (from, to) in [
            ((5.5, 20.0), (35.5, 20.0)),
            ((20.0, 5.5), (20.0, 35.5)),
            ((8.0, 8.0), (32.0, 32.0)),
            ((30.0, 9.0), (10.0, 31.0)),
        ] {
            let mut picture = RgbImage::from_pixel(40, 40, Rgb([0; 3]));
            let (from, to) = (DVec2::from(from), DVec2::from(to));
            line(&mut picture, from, to, 2.0, Rgb([255; 3]));
            let area: f64 = picture.pixels().map(|p| f64::from(p[0]) / 255.0).sum();
            // Its length times its width, and half a circle at each end.
            let expected = 2.0 * from.distance(to) + std::f64::consts::PI;
            assert!((area - expected).abs() < 0.1 * expected, "{from} {to}: {area}, {expected}");
        }
        let mut picture = RgbImage::from_pixel(40, 40, Rgb([0; 3]));
        line(&mut picture, DVec2::new(-1e6, 20.0), DVec2::new(1e6, 20.0), 1.0, Rgb([255; 3]));
        line(&mut picture, DVec2::NAN, DVec2::new(3.0, 3.0), 1.0, Rgb([255; 3]));
        assert!((0..40).all(|x| picture.get_pixel(x, 19)[0] > 90) && picture.get_pixel(3, 3)[0] == 0);
    }
}
