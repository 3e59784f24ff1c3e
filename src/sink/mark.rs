//! A visible mark on frames: a line of light text on a darkened plate in the lower left corner.
//! Blended in code values, since it is no light of the scene. The camera's pixels below it change.

use image::{Rgb, RgbImage};

use super::lettering::{self, Style};
use super::{Sink, SinkError};
use crate::pixels::{Codes, Pixels, Rect};

/// Height of the plate, as a share of the picture's height, and at least px.
const HEIGHT_SHARE: f32 = 0.045;
const MIN_HEIGHT_PX: f32 = 14.0;
/// Height of letters and distance from the plate's sides, as a share of the plate's height.
const LETTER_SHARE: f32 = 0.7;
const MARGIN_SHARE: f32 = 0.4;
/// Factor on the code values below the plate.
const PLATE_FACTOR: f32 = 0.35;

/// Marks frames on their way into a sink.
pub struct MarkSink {
    mark: VisibleMark,
    inner: Box<dyn Sink + Send>,
}

impl MarkSink {
    /// Marks frames of `width` × `height` px with a text.
    pub fn new(text: &str, (width, height): (u32, u32), inner: Box<dyn Sink + Send>) -> Self {
        Self { mark: VisibleMark::new(text, width, height), inner }
    }
}

impl Sink for MarkSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.inner.write(frame_index, &self.mark.apply(pixels))
    }

    fn finish(self: Box<Self>) -> Result<(), SinkError> {
        self.inner.finish()
    }
}

/// Coverage of the letters over the plate.
#[derive(Debug)]
pub struct VisibleMark {
    width: usize,
    height: usize,
    /// 0 to 1, row by row.
    ink: Vec<f32>,
}

impl VisibleMark {
    /// The mark for pictures of this size. A longer text is cut at the picture's right side.
    pub fn new(text: &str, width: u32, height: u32) -> Self {
        let plate_px = (HEIGHT_SHARE * height as f32).max(MIN_HEIGHT_PX).min(height as f32).ceil();
        let (letter_px, margin_px) = (LETTER_SHARE * plate_px, MARGIN_SHARE * plate_px);
        let text_px = lettering::width_px(text, letter_px);
        let plate_width = ((text_px + 2.0 * margin_px).ceil() as u32).min(width);
        let mut plate = RgbImage::new(plate_width, plate_px as u32);
        let style = Style { height_px: letter_px, ink: Rgb([255; 3]) };
        let at = (margin_px, 0.5 * (plate_px - letter_px));
        lettering::write(&mut plate, at, plate_width as f32, text, style);
        let ink = plate.pixels().map(|pixel| f32::from(pixel.0[0]) / 255.0).collect();
        Self { width: plate.width() as usize, height: plate.height() as usize, ink }
    }

    /// Bounds of the plate in a picture of this height, px.
    pub fn bounds(&self, height: u32) -> Rect {
        let bottom = height as i32;
        Rect::new(0, (bottom - self.height as i32).max(0), self.width as i32, bottom)
    }

    /// A copy of a picture with the mark.
    pub fn apply(&self, pixels: &Pixels) -> Pixels {
        let mut marked = pixels.clone();
        match &mut marked.codes {
            Codes::U8(codes) => self.blend(codes, pixels.width, 255.0, |value| value as u8),
            Codes::U16(codes) => self.blend(codes, pixels.width, 65535.0, |value| value as u16),
        }
        marked
    }

    fn blend<T: Copy + Into<f32>>(&self, codes: &mut [T], width: u32, white: f32, rounded: impl Fn(f32) -> T) {
        let width = width as usize;
        let top = (codes.len() / (3 * width.max(1))).saturating_sub(self.height);
        for (y, inks) in self.ink.chunks_exact(self.width.max(1)).enumerate() {
            let start = 3 * (top + y) * width;
            let row = codes.get_mut(start..start + 3 * width).unwrap_or_default();
            for (pixel, ink) in row.chunks_exact_mut(3).zip(inks) {
                for code in pixel {
                    let below = PLATE_FACTOR * (*code).into();
                    *code = rounded((below + ink * (white - below) + 0.5).floor());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mark_has_white_letters_on_a_dark_plate_and_keeps_the_rest() {
        let (width, height) = (320, 200);
        let grey = Pixels::from_u8(width, height, vec![200; 3 * 320 * 200]).unwrap();
        let mark = VisibleMark::new("COMPOSITE", width, height);
        let marked = mark.apply(&grey);
        let bounds = mark.bounds(height);
        assert_eq!((bounds.x0, bounds.y0, bounds.y1), (0, 186, 200));
        assert!((0..200).all(|y| (0..320).all(|x| bounds.contains(x, y) || marked.at(x as u32, y as u32) == [200; 3])));
        let codes = marked.codes.eight_bit().unwrap();
        // 14 rows of plate; 0.35 · 200 = 70.
        assert!(codes[..3 * 320 * 186].iter().all(|code| *code == 200));
        assert_eq!(&codes[3 * 320 * 186..][..3], [70; 3]);
        assert!(codes[3 * 320 * 186..].iter().filter(|code| **code > 160).count() > 60);
        assert_eq!(&codes[3 * (320 * 200 - 1)..], [200; 3], "right of the text");
        let deep = Pixels::from_u16(width, height, vec![40_000; 3 * 320 * 200]).unwrap();
        let Codes::U16(codes) = VisibleMark::new("COMPOSITE", width, height).apply(&deep).codes else { unreachable!() };
        assert_eq!(codes[3 * 320 * 186], 14_000);
        // Smaller than the plate.
        let tiny = Pixels::from_u8(2, 3, vec![9; 18]).unwrap();
        assert_eq!(VisibleMark::new("COMPOSITE", 2, 3).apply(&tiny).width, 2);
    }
}
