//! A contact sheet: the photographs of a series, each with its settings below.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};
use image::{ImageBuffer, Rgb, imageops};

use crate::pixels::{Codes, Pixels};

/// Width of each picture on the sheet, px, and the margin around it.
const PICTURE_PX: u32 = 480;
const MARGIN_PX: u32 = 12;
/// Height of the letters, and line spacing.
const LETTERS_PX: f32 = 24.0;
const LINE_PX: u32 = 26;
/// Open Sans; its licence is next to it.
const FONT: &[u8] = include_bytes!("../../assets/OpenSans-Regular.ttf");
const PAPER: Rgb<u8> = Rgb([24, 24, 24]);
const INK: Rgb<u8> = Rgb([230, 230, 230]);

type Picture = ImageBuffer<Rgb<u8>, Vec<u8>>;

/// A photograph in the sheet's size, so that the large ones need not be kept. `None` for 16 bits, which no photograph
/// has.
pub fn small(pixels: &Pixels) -> Option<Picture> {
    let codes = pixels.codes.eight_bit()?;
    let picture = Picture::from_raw(pixels.width, pixels.height, codes.to_vec())?;
    let height = (u64::from(PICTURE_PX) * u64::from(pixels.height) / u64::from(pixels.width.max(1))).max(1) as u32;
    if pixels.width > PICTURE_PX {
        return Some(imageops::thumbnail(&picture, PICTURE_PX, height));
    }
    Some(imageops::resize(&picture, PICTURE_PX, height, imageops::FilterType::CatmullRom))
}

/// The sheet, filled from the upper left, with as many columns as make it about square. Labels may have several lines.
pub fn contact_sheet(pictures: &[(Picture, String)]) -> Pixels {
    let count = pictures.len().max(1) as u32;
    let columns = f64::from(count).sqrt().ceil() as u32;
    let rows = count.div_ceil(columns);
    let lines = pictures.iter().map(|(_, label)| label.lines().count()).max().unwrap_or(0) as u32;
    let tallest = pictures.iter().map(|(picture, _)| picture.height()).max().unwrap_or(0);
    let cell = (PICTURE_PX + MARGIN_PX, tallest + lines * LINE_PX + 2 * MARGIN_PX);
    let mut sheet = Picture::from_pixel(columns * cell.0 + MARGIN_PX, rows * cell.1 + MARGIN_PX, PAPER);
    for (n, (picture, label)) in (0u32..).zip(pictures) {
        let (x, y) = (MARGIN_PX + n % columns * cell.0, MARGIN_PX + n / columns * cell.1);
        imageops::replace(&mut sheet, picture, x.into(), y.into());
        for (line, text) in (0u32..).zip(label.lines()) {
            write(&mut sheet, x, y + picture.height() + MARGIN_PX / 2 + line * LINE_PX, text);
        }
    }
    let (width, height) = sheet.dimensions();
    Pixels { width, height, codes: Codes::U8(sheet.into_raw()) }
}

/// Writes a line whose upper left corner is at (x, y). What does not fit below a picture is cut off.
fn write(sheet: &mut Picture, x: u32, y: u32, text: &str) {
    // The font is part of the program, and a test reads it.
    let Ok(font) = FontRef::try_from_slice(FONT) else { return };
    let font = font.as_scaled(PxScale::from(LETTERS_PX));
    let baseline = y as f32 + font.ascent();
    let mut at = x as f32;
    let mut before: Option<Glyph> = None;
    for letter in text.chars() {
        let mut glyph = font.scaled_glyph(letter);
        at += before.map_or(0.0, |before| font.kern(before.id, glyph.id));
        let next = at + font.h_advance(glyph.id);
        if next > (x + PICTURE_PX) as f32 {
            return;
        }
        glyph.position = point(at, baseline);
        if let Some(outline) = font.outline_glyph(glyph.clone()) {
            let corner = outline.px_bounds().min;
            outline.draw(|i, j, coverage| {
                let (x, y) = (corner.x as i32 + i as i32, corner.y as i32 + j as i32);
                let place = u32::try_from(x).ok().zip(u32::try_from(y).ok());
                if let Some(pixel) = place.and_then(|(x, y)| sheet.get_pixel_mut_checked(x, y)) {
                    ink(pixel, coverage.clamp(0.0, 1.0));
                }
            });
        }
        (at, before) = (next, Some(glyph));
    }
}

/// Blends ink into a pixel by its coverage, in code values: letters are not light of the scene.
fn ink(pixel: &mut Rgb<u8>, coverage: f32) {
    for (code, ink) in pixel.0.iter_mut().zip(INK.0) {
        *code = (f32::from(*code) + coverage * (f32::from(ink) - f32::from(*code))).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_picture_stands_above_its_label() {
        let picture = |code: u8| small(&Pixels::from_u8(60, 40, vec![code; 7200]).unwrap()).unwrap();
        assert_eq!(picture(0).dimensions(), (480, 320));
        let sheet = contact_sheet(&[
            (picture(90), "f/2.8".to_owned()),
            (picture(120), "f/4".to_owned()),
            (picture(150), String::new()),
        ]);
        // Two columns and two rows of 492 × (320 + 26 + 24).
        assert_eq!((sheet.width, sheet.height), (2 * 492 + 12, 2 * 370 + 12));
        assert_eq!([(12, 12), (504, 12), (12, 382)].map(|(x, y)| sheet.at(x, y)[0]), [90, 120, 150]);
        let inked = |x0: u32| {
            let places = (x0..x0 + 100).flat_map(|x| (332..360).map(move |y| (x, y)));
            places.filter(|&(x, y)| sheet.at(x, y)[1] > 130).count()
        };
        assert!(inked(12) > inked(504) && inked(504) > 50, "{} {}", inked(12), inked(504));
    }

    /// Anti-aliased letters: many shades, the stem of an l as high as a T and narrow, and none beyond the picture's
    /// width.
    #[test]
    fn letters_are_a_fonts() {
        let written = |text: &str| {
            let mut sheet = Picture::from_pixel(PICTURE_PX + 100, 40, PAPER);
            write(&mut sheet, 20, 4, text);
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
        assert!(long.enumerate_pixels().all(|(x, _, p)| x < 20 + PICTURE_PX || *p == PAPER));
    }
}
