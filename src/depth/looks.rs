//! A picture's colours as depth compares them: square roots of light, in which noise is about the same everywhere.

use crate::camera::Response;
use crate::pixels::{Codes, Pixels, Rect};

/// Only the first bits of codes are decoded: finer differences are noise here.
const BITS: u32 = 10;

pub struct Looks<'a> {
    pixels: &'a Pixels,
    of_code: Vec<f32>,
    /// Bits of a code that are left out.
    over: u32,
}

impl<'a> Looks<'a> {
    pub fn new(pixels: &'a Pixels, response: &Response) -> Self {
        let (bits, over) = match pixels.codes {
            Codes::U8(_) => (8, 0),
            Codes::U16(_) => (BITS, 16 - BITS),
        };
        let light = response.table((1 << bits) - 1).into_iter();
        Self { pixels, of_code: light.map(|light| light.max(0.0).sqrt() as f32).collect(), over }
    }

    /// The picture.
    pub fn size(&self) -> Rect {
        Rect::full(self.pixels.width, self.pixels.height)
    }

    /// Fills `out` with a row's pixels from a column on.
    pub fn along(&self, x: u32, y: u32, out: &mut [[f32; 3]]) {
        assert!(x as usize + out.len() <= self.pixels.width as usize, "the row is shorter");
        let codes = 3 * (y as usize * self.pixels.width as usize + x as usize)..;
        match &self.pixels.codes {
            Codes::U8(all) => {
                let look = |code: u8| self.of_code[usize::from(code)];
                let codes = all[codes].as_chunks().0.iter();
                codes.zip(out).for_each(|(&[r, g, b], looks)| *looks = [look(r), look(g), look(b)]);
            }
            Codes::U16(all) => {
                let look = |code: u16| self.of_code[usize::from(code >> self.over)];
                let codes = all[codes].as_chunks().0.iter();
                codes.zip(out).for_each(|(&[r, g, b], looks)| *looks = [look(r), look(g), look(b)]);
            }
        }
    }

    /// At a pixel of the picture.
    pub fn at(&self, x: u32, y: u32) -> [f32; 3] {
        let look = |code: u32| self.of_code[(code >> self.over) as usize];
        let [r, g, b] = self.pixels.at(x, y);
        [look(r), look(g), look(b)]
    }

    /// The same by its number, row by row; `None` beyond the last.
    pub fn nth(&self, i: usize) -> Option<[f32; 3]> {
        match &self.pixels.codes {
            Codes::U8(all) => {
                let [r, g, b] = all.as_chunks::<3>().0.get(i)?;
                Some([self.of_code[usize::from(*r)], self.of_code[usize::from(*g)], self.of_code[usize::from(*b)]])
            }
            Codes::U16(all) => {
                let look = |code: u16| self.of_code[usize::from(code >> self.over)];
                let [r, g, b] = all.as_chunks::<3>().0.get(i)?;
                Some([look(*r), look(*g), look(*b)])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_and_a_number_give_what_a_place_gives() {
        let codes: Vec<u16> = (0..3 * 5 * 4).map(|n| n * 1021).collect();
        let eight = codes.iter().map(|code| (code >> 8) as u8).collect();
        let pictures = [Pixels::from_u8(5, 4, eight).unwrap(), Pixels::from_u16(5, 4, codes).unwrap()];
        for pixels in &pictures {
            let looks = Looks::new(pixels, &Response::default());
            for (x, y) in (0..4).flat_map(|y| (0..5).map(move |x| (x, y))) {
                let mut row = vec![[0.0; 3]; 5 - x as usize];
                looks.along(x, y, &mut row);
                assert_eq!((row[0], looks.nth((y * 5 + x) as usize)), (looks.at(x, y), Some(looks.at(x, y))));
                assert_eq!(row.last(), Some(&looks.at(4, y)));
            }
            assert_eq!(looks.nth(20), None);
        }
    }
}
