//! A picture's colours as depth compares them: square roots of light, in which noise is about the same everywhere.

use crate::camera::Response;
use crate::pixels::{Codes, Pixels};

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

    /// At a pixel of the picture.
    pub fn at(&self, x: u32, y: u32) -> [f32; 3] {
        self.pixels.at(x, y).map(|code| self.of_code[(code >> self.over) as usize])
    }
}
