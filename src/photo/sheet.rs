//! A contact sheet: the photographs of a series, each with its settings below.

use image::{Rgb, RgbImage, imageops};

use crate::pixels::{Codes, Pixels};
use crate::sink::lettering::{Style, write};

/// Width of each picture on the sheet, px.
const PICTURE_PX: u32 = 480;
const MARGIN_PX: u32 = 12;
/// Text style.
const LABEL_STYLE: Style = Style { height_px: 24.0, ink: Rgb([230, 230, 230]) };
const LINE_PX: u32 = 26;
const PAPER: Rgb<u8> = Rgb([24, 24, 24]);

type SheetPicture = RgbImage;

/// A photograph reduced to the sheet's size, to save memory. `None` for 16 bits, which photographs
/// do not have.
pub fn thumbnail(pixels: &Pixels) -> Option<SheetPicture> {
    let codes = pixels.codes.eight_bit()?;
    let picture = SheetPicture::from_raw(pixels.width, pixels.height, codes.to_vec())?;
    let height = (u64::from(PICTURE_PX) * u64::from(pixels.height) / u64::from(pixels.width.max(1))).max(1) as u32;
    if pixels.width > PICTURE_PX {
        return Some(imageops::thumbnail(&picture, PICTURE_PX, height));
    }
    Some(imageops::resize(&picture, PICTURE_PX, height, imageops::FilterType::CatmullRom))
}

/// The sheet, filled from the upper left, with a number of columns that makes it about square.
/// Labels may have several lines.
pub fn contact_sheet(pictures: &[(SheetPicture, String)]) -> Pixels {
    let count = pictures.len().max(1) as u32;
    let columns = f64::from(count).sqrt().ceil() as u32;
    let rows = count.div_ceil(columns);
    let lines = pictures.iter().map(|(_, label)| label.lines().count()).max().unwrap_or(0) as u32;
    let tallest = pictures.iter().map(|(picture, _)| picture.height()).max().unwrap_or(0);
    let cell = (PICTURE_PX + MARGIN_PX, tallest + lines * LINE_PX + 2 * MARGIN_PX);
    let mut sheet = SheetPicture::from_pixel(columns * cell.0 + MARGIN_PX, rows * cell.1 + MARGIN_PX, PAPER);
    for (n, (picture, label)) in (0u32..).zip(pictures) {
        let (x, y) = (MARGIN_PX + n % columns * cell.0, MARGIN_PX + n / columns * cell.1);
        imageops::replace(&mut sheet, picture, x.into(), y.into());
        for (line, text) in (0u32..).zip(label.lines()) {
            let top = y + picture.height() + MARGIN_PX / 2 + line * LINE_PX;
            // Labels are clipped to the space below the picture.
            write(&mut sheet, (x as f32, top as f32), (x + PICTURE_PX) as f32, text, LABEL_STYLE);
        }
    }
    let (width, height) = sheet.dimensions();
    Pixels::uncoded(width, height, Codes::U8(sheet.into_raw()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contact_sheet_places_labels_below_pictures() {
        let picture = |code: u8| thumbnail(&Pixels::from_u8(60, 40, vec![code; 7200]).unwrap()).unwrap();
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
}
