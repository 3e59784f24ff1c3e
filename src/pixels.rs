//! Pictures as plain values: camera codes, measured depth, linear light.

use std::borrow::Cow;
use std::io::Write;
use std::sync::Arc;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::coding::PictureCoding;

/// Weights of red, green and blue of ITU-R BT.709: of linear light for luminance, of codes for
/// luma.
pub const WEIGHTS_709: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Luminance of linear light, or luma of codes, by [`WEIGHTS_709`].
pub fn luma_709([r, g, b]: [f64; 3]) -> f64 {
    let [red, green, blue] = WEIGHTS_709;
    red * r + green * g + blue * b
}

/// Lowest code of an 8-bit picture at which a channel may be clipped.
const CLIP_CODE: u32 = 250;
/// Code from which on a channel clips, as a fraction of the largest code.
pub const CLIP_LEVEL: f32 = CLIP_CODE as f32 / 255.0;

/// Camera pixels exactly as delivered: interleaved R, G, B, row by row from the top left, encoded
/// code values. A grey camera's values appear three times.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    pub width: u32,
    pub height: u32,
    pub codes: Codes,
    /// How the codes were coded in the camera or its file. `None` if that is unknown, or if they
    /// were changed since.
    pub coding: Option<Arc<PictureCoding>>,
}

/// Code values of [`Pixels`]; the length is `3 * width * height`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Codes {
    U8(Vec<u8>),
    U16(Vec<u16>),
}

impl Codes {
    /// The values, if they have 8 bits.
    pub fn eight_bit(&self) -> Option<&[u8]> {
        match self {
            Self::U8(codes) => Some(codes),
            Self::U16(_) => None,
        }
    }

    /// The values with 8 bits; those of 16 are rounded to the nearest.
    pub fn to_eight_bit(&self) -> Cow<'_, [u8]> {
        match self {
            Self::U8(codes) => Cow::Borrowed(codes),
            Self::U16(codes) => Cow::Owned(codes.iter().copied().map(eight_bits).collect()),
        }
    }
}

/// The 8-bit code that is nearest to one of 16 bits. Both scales end in the same white: 65535 = 257
/// · 255.
pub fn eight_bits(code: u16) -> u8 {
    ((u32::from(code) + 128) / 257) as u8
}

/// The next whole number below, without a call into the mathematics library: the pixel of a
/// position. Values that are too large become the largest `i32`.
pub fn floor(at: f32) -> i32 {
    let whole = at as i32;
    whole.saturating_sub(i32::from((whole as f32) > at))
}

/// [`floor`] of values nearer to 0 than 2²². It has no range check, so that loops over it are
/// vectorized. Any other value, and NaN, becomes a number of at most 1.3·10⁹.
pub fn floor_of_small(at: f32) -> i32 {
    // Near 1.5·2²³, 32-bit floats are whole numbers: an addition rounds to the nearest one.
    const WHOLE: f32 = 12_582_912.0;
    let nearest = (at + WHOLE) - WHOLE;
    let below = if nearest > at { nearest - 1.0 } else { nearest };
    ((below + WHOLE).to_bits() as i32).wrapping_sub(WHOLE.to_bits() as i32)
}

impl Pixels {
    /// Pixels whose coding is unknown. The length of the codes must be `3 * width * height`.
    pub fn uncoded(width: u32, height: u32, codes: Codes) -> Self {
        Self { width, height, codes, coding: None }
    }

    /// 8-bit pixels. `None` if the length is not `3 * width * height`.
    pub fn from_u8(width: u32, height: u32, codes: Vec<u8>) -> Option<Self> {
        (codes.len() == 3 * width as usize * height as usize).then(|| Self::uncoded(width, height, Codes::U8(codes)))
    }

    /// 16-bit pixels. `None` if the length is not `3 * width * height`.
    pub fn from_u16(width: u32, height: u32, codes: Vec<u16>) -> Option<Self> {
        (codes.len() == 3 * width as usize * height as usize).then(|| Self::uncoded(width, height, Codes::U16(codes)))
    }

    /// The largest code value: 255 or 65535.
    pub fn max_code(&self) -> u32 {
        match self.codes {
            Codes::U8(_) => 255,
            Codes::U16(_) => 65535,
        }
    }

    /// The lowest code value at which a channel may be clipped.
    pub fn clip_code(&self) -> u32 {
        CLIP_CODE * (self.max_code() / 255)
    }

    /// Something of every pixel's code values, row by row.
    pub fn each<T>(&self, of: impl Fn([u32; 3]) -> T) -> Vec<T> {
        match &self.codes {
            Codes::U8(codes) => codes.as_chunks::<3>().0.iter().map(|c| of(c.map(u32::from))).collect(),
            Codes::U16(codes) => codes.as_chunks::<3>().0.iter().map(|c| of(c.map(u32::from))).collect(),
        }
    }

    /// The code values of the pixel in column `x`, row `y`.
    pub fn at(&self, x: u32, y: u32) -> [u32; 3] {
        let i = 3 * (y as usize * self.width as usize + x as usize);
        match &self.codes {
            Codes::U8(c) => [c[i].into(), c[i + 1].into(), c[i + 2].into()],
            Codes::U16(c) => [c[i].into(), c[i + 1].into(), c[i + 2].into()],
        }
    }

    /// Writes a PNG that is compressed fast.
    pub fn write_png(&self, out: impl Write) -> image::ImageResult<()> {
        let (bytes, color): (&[u8], _) = match &self.codes {
            Codes::U8(codes) => (codes, ExtendedColorType::Rgb8),
            Codes::U16(codes) => (bytemuck::cast_slice(codes), ExtendedColorType::Rgb16),
        };
        PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Adaptive).write_image(
            bytes,
            self.width,
            self.height,
            color,
        )
    }

    /// A picture of another size; the pixel at (x, y) is copied from `from(x, y)`.
    pub fn rearranged(&self, width: u32, height: u32, from: impl Fn(u32, u32) -> (u32, u32)) -> Self {
        fn codes<T: Copy>(codes: &[T], stride: u32, places: impl Iterator<Item = (u32, u32)>) -> Vec<T> {
            let pixels = codes.as_chunks::<3>().0;
            places.flat_map(|(x, y)| pixels[y as usize * stride as usize + x as usize]).collect()
        }
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| from(x, y));
        let codes = match &self.codes {
            Codes::U8(of) => Codes::U8(codes(of, self.width, places)),
            Codes::U16(of) => Codes::U16(codes(of, self.width, places)),
        };
        Self::uncoded(width, height, codes)
    }

    /// Codes of a pixel with 8 bits; those of 16 are rounded to the nearest.
    pub fn eight_bits_at(&self, x: u32, y: u32) -> [u8; 3] {
        let i = 3 * (y as usize * self.width as usize + x as usize);
        match &self.codes {
            Codes::U8(c) => [c[i], c[i + 1], c[i + 2]],
            Codes::U16(c) => [c[i], c[i + 1], c[i + 2]].map(eight_bits),
        }
    }
}

/// Distance along the optical axis, one value per pixel, row by row; 0 where nothing was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    pub width: u32,
    pub height: u32,
    /// z in the camera's axes, metres; `width * height` values.
    pub depth_m: Vec<f32>,
    /// When it was measured, on the frames' clock.
    pub timestamp_s: f64,
}

/// The virtual layer of a frame after all layer effects, `width * height` values per field.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayerImage {
    pub width: u32,
    pub height: u32,
    /// Linear, premultiplied: the composite's light is RGB + (1 − A)·`left`·(the camera's light).
    /// Where only A is 0, there is light without coverage: a glow. RGB may be below 0 at the edge
    /// of a nearer real thing, whose pixels show light from behind that the layer covers.
    pub rgba: Vec<[f32; 4]>,
    /// Metres along the optical axis, 0 where A is 0.
    pub depth_m: Vec<f32>,
    /// px/s, raster axes.
    pub velocity: Vec<[f32; 2]>,
    /// Whether there may be light where A is 0: a glow.
    pub light_alone: bool,
    /// Shadow ratio per colour; 1 outside shadows. Where it is 1 and `rgba` is 0, the camera's
    /// codes are unchanged.
    pub left: Vec<[f32; 3]>,
    /// Light that the composite has beyond the formula of `rgba`: noise, and effects that act on
    /// the mixed picture. 0 where the camera's codes are unchanged, and where the composite is
    /// clipped at the largest code.
    pub noise: Vec<[f32; 3]>,
}

impl LayerImage {
    /// A layer without any object.
    pub fn empty(width: u32, height: u32) -> Self {
        let count = width as usize * height as usize;
        Self {
            width,
            height,
            rgba: vec![[0.0; 4]; count],
            depth_m: vec![0.0; count],
            velocity: vec![[0.0; 2]; count],
            light_alone: false,
            left: vec![[1.0; 3]; count],
            noise: vec![[0.0; 3]; count],
        }
    }

    /// Leaves a share of its light and coverage, 0 to 1.
    pub fn fade(&mut self, opacity: f32) {
        if opacity < 1.0 {
            self.rgba.iter_mut().flatten().for_each(|value| *value *= opacity);
        }
    }
}

/// A picture of light: linear, premultiplied R, G, B, A, row by row from the top left, `width *
/// height` values.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    pub width: u32,
    pub height: u32,
    pub rgba: Vec<[f32; 4]>,
}

impl LinearImage {
    /// All transparent.
    pub fn empty(width: u32, height: u32) -> Self {
        Self { width, height, rgba: vec![[0.0; 4]; width as usize * height as usize] }
    }
}

/// A rectangle of whole pixels, half-open: columns `x0..x1`, rows `y0..y1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    pub x0: i32,
    pub y0: i32,
    pub x1: i32,
    pub y1: i32,
}

impl Rect {
    pub fn new(x0: i32, y0: i32, x1: i32, y1: i32) -> Self {
        Self { x0, y0, x1, y1 }
    }

    /// The whole of a picture.
    pub fn full(width: u32, height: u32) -> Self {
        Self::new(0, 0, width as i32, height as i32)
    }

    pub fn width(&self) -> u32 {
        if self.x1 > self.x0 { self.x1.abs_diff(self.x0) } else { 0 }
    }

    pub fn height(&self) -> u32 {
        if self.y1 > self.y0 { self.y1.abs_diff(self.y0) } else { 0 }
    }

    pub fn is_empty(&self) -> bool {
        self.x1 <= self.x0 || self.y1 <= self.y0
    }

    /// Grown by `pixels` on every side, saturating.
    pub fn grown(&self, pixels: i32) -> Self {
        let [x0, y0] = [self.x0, self.y0].map(|low| low.saturating_sub(pixels));
        let [x1, y1] = [self.x1, self.y1].map(|high| high.saturating_add(pixels));
        Self::new(x0, y0, x1, y1)
    }

    /// Moved to the right and down.
    pub fn moved(&self, right: i32, down: i32) -> Self {
        Self::new(self.x0 + right, self.y0 + down, self.x1 + right, self.y1 + down)
    }

    /// The overlap; empty if there is none.
    pub fn intersection(&self, other: &Self) -> Self {
        Self::new(self.x0.max(other.x0), self.y0.max(other.y0), self.x1.min(other.x1), self.y1.min(other.y1))
    }

    /// The smallest rectangle around both. An empty one adds nothing.
    pub fn union(&self, other: &Self) -> Self {
        if self.is_empty() {
            return *other;
        }
        if other.is_empty() {
            return *self;
        }
        Self::new(self.x0.min(other.x0), self.y0.min(other.y0), self.x1.max(other.x1), self.y1.max(other.y1))
    }

    pub fn contains(&self, x: i32, y: i32) -> bool {
        x >= self.x0 && x < self.x1 && y >= self.y0 && y < self.y1
    }

    /// A part of this rectangle's values, row by row.
    pub fn part<T: Copy>(&self, values: &[T], part: Rect) -> Vec<T> {
        if *self == part {
            return values.to_vec();
        }
        let columns = (part.x0 - self.x0) as usize..(part.x1 - self.x0) as usize;
        let rows = values.chunks_exact(self.width().max(1) as usize).skip((part.y0 - self.y0) as usize);
        let mut out = Vec::with_capacity(part.width() as usize * part.height() as usize);
        rows.take(part.height() as usize).for_each(|row| out.extend_from_slice(&row[columns.clone()]));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floor_of_small_matches_floor() {
        let adjacent_floats = |at: f32| [at.next_down(), at, at.next_up()];
        let places = (-9..=9)
            .flat_map(|n| adjacent_floats(0.5 * n as f32))
            .chain([1e6, -1e6].into_iter().flat_map(adjacent_floats));
        for at in places.chain([4e6 + 0.25, -4e6 - 0.25, 0.999_999_9, 1e-30, -1e-30]) {
            assert_eq!((floor(at), floor_of_small(at)), (at.floor() as i32, at.floor() as i32), "{at}");
        }
    }

    #[test]
    fn floor_by_hand() {
        assert_eq!([0.0, 0.9, 1.0, -0.1, -1.0, -1.5].map(floor), [0, 0, 1, -1, -1, -2]);
        assert_eq!([f32::NEG_INFINITY, 1e20].map(floor), [i32::MIN, i32::MAX]);
    }

    #[test]
    fn sixteen_bits_become_the_nearest_of_eight() {
        for code in 0..=u16::MAX {
            assert_eq!(f64::from(eight_bits(code)), (f64::from(code) / 257.0).round(), "{code}");
        }
        // Cut instead of rounded, 255 would be 0, and the one below white 254.
        let codes = Codes::U16(vec![255, 257, 65535 - 128]);
        assert_eq!(codes.to_eight_bit(), [1, 1, 255].as_slice());
        let pixels = Pixels::from_u16(1, 1, vec![128, 129, 65406]).unwrap();
        assert_eq!(pixels.eight_bits_at(0, 0), [0, 1, 254]);
    }

    #[test]
    fn a_rectangle_grows_to_the_end_of_numbers_and_no_further() {
        let all = Rect::new(-3, 2, 5, 7).grown(i32::MAX);
        assert_eq!(all, Rect::new(i32::MIN, i32::MIN + 3, i32::MAX, i32::MAX));
        assert_eq!((all.width(), all.height()), (u32::MAX, u32::MAX - 3));
        assert_eq!((Rect::new(3, 3, 2, 3).width(), Rect::new(3, 3, 2, 3).height()), (0, 0));
        assert_eq!(Rect::new(0, 0, 4, 4).grown(-3), Rect::new(3, 3, 1, 1));
    }
}
