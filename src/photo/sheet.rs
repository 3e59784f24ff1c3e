//! A contact sheet: photographs of a series side by side, each with its settings below.

use font8x8::UnicodeFonts;
use image::{ImageBuffer, Rgb, imageops};

use crate::image::{Codes, Pixels};

/// Width of each picture on the sheet, px, and what is left free around it.
const PICTURE_PX: u32 = 480;
const MARGIN_PX: u32 = 12;
/// Letters of 8×8 dots.
const DOT_PX: u32 = 2;
const LETTER_PX: u32 = 8 * DOT_PX;
const PAPER: Rgb<u8> = Rgb([24, 24, 24]);
const INK: Rgb<u8> = Rgb([230, 230, 230]);

type Picture = ImageBuffer<Rgb<u8>, Vec<u8>>;

/// A photograph as small as on the sheet, so that the large ones need not be kept. `None` for 16 bits, which no photograph
/// has.
pub fn small(pixels: &Pixels) -> Option<Picture> {
    let Codes::U8(codes) = &pixels.codes else { return None };
    let picture = Picture::from_raw(pixels.width, pixels.height, codes.clone())?;
    let height = (u64::from(PICTURE_PX) * u64::from(pixels.height) / u64::from(pixels.width.max(1))).max(1) as u32;
    if pixels.width > PICTURE_PX {
        return Some(imageops::thumbnail(&picture, PICTURE_PX, height));
    }
    Some(imageops::resize(&picture, PICTURE_PX, height, imageops::FilterType::CatmullRom))
}

/// The sheet: as many columns as make it about square, from the upper left. Labels may have several lines.
pub fn contact_sheet(pictures: &[(Picture, String)]) -> Pixels {
    let count = pictures.len().max(1) as u32;
    let columns = f64::from(count).sqrt().ceil() as u32;
    let rows = count.div_ceil(columns);
    let lines = pictures.iter().map(|(_, label)| label.lines().count()).max().unwrap_or(0) as u32;
    let tallest = pictures.iter().map(|(picture, _)| picture.height()).max().unwrap_or(0);
    let cell = (PICTURE_PX + MARGIN_PX, tallest + lines * (LETTER_PX + 4) + 2 * MARGIN_PX);
    let mut sheet = Picture::from_pixel(columns * cell.0 + MARGIN_PX, rows * cell.1 + MARGIN_PX, PAPER);
    for (n, (picture, label)) in (0u32..).zip(pictures) {
        let (x, y) = (MARGIN_PX + n % columns * cell.0, MARGIN_PX + n / columns * cell.1);
        imageops::replace(&mut sheet, picture, x.into(), y.into());
        for (line, text) in (0u32..).zip(label.lines()) {
            write(&mut sheet, x, y + picture.height() + MARGIN_PX / 2 + line * (LETTER_PX + 4), text);
        }
    }
    let (width, height) = sheet.dimensions();
    Pixels { width, height, codes: Codes::U8(sheet.into_raw()) }
}

/// What does not fit below a picture is cut off.
fn write(sheet: &mut Picture, x: u32, y: u32, text: &str) {
    for (n, letter) in (0..PICTURE_PX / LETTER_PX).zip(text.chars()) {
        let dots = font8x8::BASIC_FONTS.get(letter).unwrap_or([0x7e; 8]);
        for (j, row) in (0u32..).zip(dots) {
            for i in (0..8).filter(|i| row >> i & 1 == 1) {
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let at = (x + n * LETTER_PX + DOT_PX * i + dx, y + DOT_PX * j + dy);
                    if let Some(pixel) = sheet.get_pixel_mut_checked(at.0, at.1) {
                        *pixel = INK;
                    }
                }
            }
        }
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
        // Two columns and two rows of 492 × (320 + 20 + 24).
        assert_eq!((sheet.width, sheet.height), (2 * 492 + 12, 2 * 364 + 12));
        assert_eq!([(12, 12), (504, 12), (12, 376)].map(|(x, y)| sheet.at(x, y)[0]), [90, 120, 150]);
        let inked = |x0: u32| {
            let places = (x0..x0 + 100).flat_map(|x| (332..360).map(move |y| (x, y)));
            places.filter(|&(x, y)| sheet.at(x, y) == [230; 3]).count()
        };
        assert!(inked(12) > inked(504) && inked(504) > 50, "{} {}", inked(12), inked(504));
    }
}
