//! A greyscale picture for the detection of tags.

use glam::DVec2;

use crate::camera::Response;
use crate::grey_image::GreyImage;
use crate::pixels::{Pixels, eight_bits};

/// 8-bit luma codes, and the linear light of each code.
#[derive(Clone, Debug)]
pub struct LumaCodes {
    pub codes: GreyImage<u8>,
    light: Vec<f32>,
}

impl LumaCodes {
    /// BT.709 luma; `light` is the response's table of 256 codes.
    pub fn of(pixels: &Pixels, light: Vec<f32>) -> Self {
        // Weights out of 256.
        let luma = |[r, g, b]: [u32; 3]| ((54 * r + 183 * g + 19 * b + 128) >> 8) as u8;
        let is_eight_bit = pixels.max_code() == 255;
        let eight_bit = |code: u32| if is_eight_bit { code } else { u32::from(eight_bits(code as u16)) };
        Self { codes: GreyImage::of_codes(pixels, |codes| luma(codes.map(eight_bit))), light }
    }

    /// Linear light of each 8-bit code.
    pub fn table(response: &Response) -> Vec<f32> {
        response.table(255).into_iter().map(|light| light as f32).collect()
    }

    /// Bilinear sample of linear light, px with pixel centres at +0.5.
    pub fn light_at(&self, at: DVec2) -> f64 {
        self.codes.sample_of(at, |code| f64::from(self.light[usize::from(code)]))
    }
}
