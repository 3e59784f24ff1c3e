//! Small crops of pictures, enlarged without interpolation, as `data:` URIs.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec2;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};

use crate::pixels::Pixels;

/// Magnification of the pixels.
const MAGNIFICATION: usize = 2;
/// Colour outside of the picture.
const OUTSIDE_COLOUR: [u8; 3] = [128; 3];
/// Range of the cross's arms from its middle, px of the enlarged picture.
const CROSS: std::ops::Range<i64> = 7..26;
const CROSS_COLOUR: [u8; 3] = [255, 214, 10];
const CROSS_RIM: [u8; 3] = [20, 20, 20];
const DOT_COLOUR: [u8; 3] = [255, 40, 160];

/// A square of 8-bit pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    side: usize,
    rgb: Vec<[u8; 3]>,
}

impl Tile {
    /// Crops a square of `side` pixels around the pixel corner nearest to `about`.
    pub fn cut(pixels: &Pixels, about: DVec2, side: usize) -> Self {
        let start = start(about, side);
        let (width, height) = (i64::from(pixels.width), i64::from(pixels.height));
        let tile_pixel = |n: usize| {
            let (x, y) = (start[0] + (n % side) as i64, start[1] + (n / side) as i64);
            let is_inside = x >= 0 && y >= 0 && x < width && y < height;
            if is_inside { pixels.eight_bits_at(x as u32, y as u32) } else { OUTSIDE_COLOUR }
        };
        Self { side, rgb: (0..side * side).map(tile_pixel).collect() }
    }

    /// Maps every pixel.
    pub fn with(&self, of: impl Fn([u8; 3]) -> [u8; 3]) -> Self {
        Self { side: self.side, rgb: self.rgb.iter().copied().map(of).collect() }
    }

    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.rgb
    }

    fn enlarged(&self) -> Self {
        let side = MAGNIFICATION * self.side;
        let enlarged_pixel = |n: usize| self.rgb[n / side / MAGNIFICATION * self.side + n % side / MAGNIFICATION];
        Self { side, rgb: (0..side * side).map(enlarged_pixel).collect() }
    }

    /// Enlarged, each pixel a square.
    pub fn plain(&self) -> Result<String, ImageError> {
        self.enlarged().uri()
    }

    /// Enlarged, with a thin cross at `about`, the position of [`Tile::cut`].
    pub fn crossed(&self, about: DVec2) -> Result<String, ImageError> {
        let start = start(about, self.side);
        let mut large = self.enlarged();
        let at = (about - DVec2::new(start[0] as f64, start[1] as f64)) * MAGNIFICATION as f64;
        let (x, y) = (at.x.floor() as i64, at.y.floor() as i64);
        for (beside, colour) in [(1, CROSS_RIM), (-1, CROSS_RIM), (0, CROSS_COLOUR)] {
            for along in CROSS.flat_map(|n| [n, -n]) {
                large.put(x + along, y + beside, colour);
                large.put(x + beside, y + along, colour);
            }
        }
        large.uri()
    }

    /// Enlarged, with a dot at each of the positions.
    pub fn dotted(&self, about: DVec2, places: &[DVec2]) -> Result<String, ImageError> {
        let start = start(about, self.side);
        let mut large = self.enlarged();
        for place in places {
            let at = (*place - DVec2::new(start[0] as f64, start[1] as f64)) * MAGNIFICATION as f64;
            large.put(at.x.floor() as i64, at.y.floor() as i64, DOT_COLOUR);
        }
        large.uri()
    }

    fn put(&mut self, x: i64, y: i64, colour: [u8; 3]) {
        let side = self.side as i64;
        if x >= 0 && y >= 0 && x < side && y < side {
            self.rgb[(y * side + x) as usize] = colour;
        }
    }

    fn uri(&self) -> Result<String, ImageError> {
        png_uri(&self.rgb, self.side as u32, self.side as u32)
    }
}

/// A picture, row by row.
pub fn png_uri(rgb: &[[u8; 3]], width: u32, height: u32) -> Result<String, ImageError> {
    let mut png = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::Adaptive);
    encoder.write_image(rgb.as_flattened(), width, height, ExtendedColorType::Rgb8)?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}

/// Column and row of the first pixel.
fn start(about: DVec2, side: usize) -> [i64; 2] {
    (about.round() - side as f64 / 2.0).to_array().map(|v| v as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Pixels {
        let codes = (0..8 * 6).flat_map(|n| [n % 8, n / 8, 9]).map(|n| n as u8).collect();
        Pixels::from_u8(8, 6, codes).unwrap()
    }

    #[test]
    fn crop_is_centred_and_grey_outside_the_picture() {
        // The border between columns 2 and 3 and rows 1 and 2 is nearest.
        let tile = Tile::cut(&ramp(), DVec2::new(3.4, 1.8), 4);
        assert_eq!((tile.rgb[0], tile.rgb[3], tile.rgb[15]), ([1, 0, 9], [4, 0, 9], [4, 3, 9]));
        let tile = Tile::cut(&ramp(), DVec2::new(0.0, 6.2), 4);
        assert_eq!((tile.rgb[0], tile.rgb[2], tile.rgb[10]), (OUTSIDE_COLOUR, [0, 4, 9], OUTSIDE_COLOUR));
    }

    #[test]
    fn pixels_become_squares_and_the_cross_is_at_its_position() {
        let decoded = |uri: &str| {
            let png = STANDARD.decode(uri.strip_prefix("data:image/png;base64,").unwrap()).unwrap();
            image::load_from_memory(&png).unwrap().to_rgb8()
        };
        let black = Pixels::from_u8(200, 200, vec![0; 3 * 200 * 200]).unwrap();
        let about = DVec2::new(100.3, 90.8);
        let tile = Tile::cut(&black, about, 64);
        let picture = decoded(&tile.crossed(about).unwrap());
        assert_eq!(picture.dimensions(), (128, 128));
        // 100.3 − (100 − 32) = 32.3 px, enlarged 64.6; 90.8 − (91 − 32) = 31.8, enlarged 63.6.
        assert_eq!((picture[(64 + 7, 63)].0, picture[(64 + 25, 63)].0), (CROSS_COLOUR, CROSS_COLOUR));
        assert_eq!((picture[(64, 63 - 7)].0, picture[(64, 63)].0), (CROSS_COLOUR, [0; 3]));
        assert_eq!(picture[(64 + 26, 63)].0, [0; 3]);
        let dots = decoded(&tile.dotted(about, &[about, DVec2::new(0.0, 0.0)]).unwrap());
        assert_eq!((dots[(64, 63)].0, dots[(65, 63)].0, dots[(0, 0)].0), (DOT_COLOUR, [0; 3], [0; 3]));
        let plain = decoded(&Tile::cut(&ramp(), DVec2::new(2.0, 2.0), 4).plain().unwrap());
        assert_eq!((plain.dimensions(), plain[(3, 4)].0, plain[(2, 5)].0), ((8, 8), [1, 2, 9], [1, 2, 9]));
    }
}
