//! Square roots of linear light, for comparing pictures: shot noise is nearly uniform in them.

use crate::camera::Response;
use crate::pixels::{Codes, Pixels, Rect};

/// Bits of a code that are decoded: finer differences are noise.
const BITS: u32 = 10;

/// The square roots of a picture's linear light, 0 to 1, by a table of code values.
pub struct SqrtColors<'a> {
    pixels: &'a Pixels,
    of_code: Vec<f32>,
    /// Low bits of a code that are dropped.
    dropped_bits: u32,
}

impl<'a> SqrtColors<'a> {
    pub fn new(pixels: &'a Pixels, response: &Response) -> Self {
        let (bits, dropped_bits) = match pixels.codes {
            Codes::U8(_) => (8, 0),
            Codes::U16(_) => (BITS, 16 - BITS),
        };
        let light = response.table((1 << bits) - 1).into_iter();
        Self { pixels, of_code: light.map(|light| light.max(0.0).sqrt() as f32).collect(), dropped_bits }
    }

    /// The picture's rectangle.
    pub fn full(&self) -> Rect {
        Rect::full(self.pixels.width, self.pixels.height)
    }

    /// Fills `out` with a row's pixels from a column on.
    pub fn fill_row(&self, x: u32, y: u32, out: &mut [[f32; 3]]) {
        assert!(x as usize + out.len() <= self.pixels.width as usize, "the row is shorter");
        let codes = 3 * (y as usize * self.pixels.width as usize + x as usize)..;
        match &self.pixels.codes {
            Codes::U8(all) => {
                let sqrt = |code: u8| self.of_code[usize::from(code)];
                let codes = all[codes].as_chunks().0.iter();
                codes.zip(out).for_each(|(&[r, g, b], out)| *out = [sqrt(r), sqrt(g), sqrt(b)]);
            }
            Codes::U16(all) => {
                let sqrt = |code: u16| self.of_code[usize::from(code >> self.dropped_bits)];
                let codes = all[codes].as_chunks().0.iter();
                codes.zip(out).for_each(|(&[r, g, b], out)| *out = [sqrt(r), sqrt(g), sqrt(b)]);
            }
        }
    }

    /// The colour of a pixel.
    pub fn at(&self, x: u32, y: u32) -> [f32; 3] {
        let sqrt = |code: u32| self.of_code[(code >> self.dropped_bits) as usize];
        let [r, g, b] = self.pixels.at(x, y);
        [sqrt(r), sqrt(g), sqrt(b)]
    }

    /// The colour of a pixel by its row-major index; `None` past the last.
    pub fn nth(&self, i: usize) -> Option<[f32; 3]> {
        match &self.pixels.codes {
            Codes::U8(all) => {
                let [r, g, b] = all.as_chunks::<3>().0.get(i)?;
                Some([self.of_code[usize::from(*r)], self.of_code[usize::from(*g)], self.of_code[usize::from(*b)]])
            }
            Codes::U16(all) => {
                let sqrt = |code: u16| self.of_code[usize::from(code >> self.dropped_bits)];
                let [r, g, b] = all.as_chunks::<3>().0.get(i)?;
                Some([sqrt(*r), sqrt(*g), sqrt(*b)])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_by_row_and_by_index_match_those_by_position() {
        let codes: Vec<u16> = (0..3 * 5 * 4).map(|n| n * 1021).collect();
        let eight = codes.iter().map(|code| (code >> 8) as u8).collect();
        let pictures = [Pixels::from_u8(5, 4, eight).unwrap(), Pixels::from_u16(5, 4, codes).unwrap()];
        for pixels in &pictures {
            let sqrt_colors = SqrtColors::new(pixels, &Response::default());
            for (x, y) in (0..4).flat_map(|y| (0..5).map(move |x| (x, y))) {
                let mut row = vec![[0.0; 3]; 5 - x as usize];
                sqrt_colors.fill_row(x, y, &mut row);
                assert_eq!(
                    (row[0], sqrt_colors.nth((y * 5 + x) as usize)),
                    (sqrt_colors.at(x, y), Some(sqrt_colors.at(x, y)))
                );
                assert_eq!(row.last(), Some(&sqrt_colors.at(4, y)));
            }
            assert_eq!(sqrt_colors.nth(20), None);
        }
    }
}
