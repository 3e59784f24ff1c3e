//! A picture drawn in millimetres, with antialiased edges.

use glam::{Vec2, vec2};
use image::ExtendedColorType;

use super::glyph;

pub type Color = [u8; 3];

pub struct Canvas {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
    /// Opacity of each pixel, if it is not 255 everywhere.
    pub alpha: Option<Vec<u8>>,
    px_per_mm: f32,
}

impl Canvas {
    pub fn new(width_mm: f32, height_mm: f32, px_per_mm: f32, color: Color) -> Self {
        let [width, height] = [width_mm, height_mm].map(|mm| (mm * px_per_mm).round() as u32);
        Self { width, height, rgb: color.repeat((width * height) as usize), alpha: None, px_per_mm }
    }

    /// A canvas of one pixel per cell, each computed from its column and row.
    pub fn from_fn(width: u32, height: u32, at: impl Fn(u32, u32) -> Color) -> Self {
        let rgb = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| at(x, y)).collect();
        Self { width, height, rgb, alpha: None, px_per_mm: 1.0 }
    }

    /// A picture of one colour with an opacity, 0 to 1, of each place in mm from the top left.
    pub fn mask(size_mm: Vec2, px_per_mm: f32, color: Color, opacity: impl Fn(Vec2) -> f32) -> Self {
        let mut canvas = Self::new(size_mm.x, size_mm.y, px_per_mm, color);
        let pixels = (0..canvas.height).flat_map(|y| (0..canvas.width).map(move |x| vec2(x as f32, y as f32)));
        // 16 grades: a smaller file.
        let grade = |p: Vec2| ((opacity((p + 0.5) / px_per_mm).clamp(0.0, 1.0) * 15.0).round() * 17.0) as u8;
        canvas.alpha = Some(pixels.map(grade).collect());
        canvas
    }

    pub fn color_type(&self) -> ExtendedColorType {
        if self.alpha.is_some() { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 }
    }

    /// Bytes of the pixels in the order of [`color_type`](Self::color_type).
    pub fn texels(&self) -> Vec<u8> {
        let Some(alpha) = &self.alpha else { return self.rgb.clone() };
        self.rgb.chunks_exact(3).zip(alpha).flat_map(|(rgb, &a)| [rgb[0], rgb[1], rgb[2], a]).collect()
    }

    /// Paints where `distance_mm` is negative, in the box from `low` to `high`, mm from the top
    /// left, y down.
    pub fn paint(&mut self, color: Color, low: Vec2, high: Vec2, distance_mm: impl Fn(Vec2) -> f32) {
        let last = |limit: u32, v: f32| (v.max(0.0) as u32).min(limit);
        let (low, high) = ((low - 1.0) * self.px_per_mm, (high + 1.0) * self.px_per_mm);
        for y in last(self.height, low.y)..last(self.height, high.y) {
            for x in last(self.width, low.x)..last(self.width, high.x) {
                let p = (vec2(x as f32, y as f32) + 0.5) / self.px_per_mm;
                let cover = (0.5 - distance_mm(p) * self.px_per_mm).clamp(0.0, 1.0);
                let at = 3 * (y * self.width + x) as usize;
                for (old, new) in self.rgb[at..at + 3].iter_mut().zip(color) {
                    *old = (f32::from(*old) + (f32::from(new) - f32::from(*old)) * cover).round() as u8;
                }
            }
        }
    }

    pub fn rectangle(&mut self, color: Color, low: Vec2, high: Vec2) {
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        self.paint(color, low, high, |p| ((p - middle).abs() - half).max_element());
    }

    pub fn ring(&mut self, color: Color, middle: Vec2, radius: f32, line: f32) {
        let reach = Vec2::splat(radius + line);
        self.paint(color, middle - reach, middle + reach, |p| ((p - middle).length() - radius).abs() - line / 2.0);
    }

    /// Draws a digit `height_mm` high including the strokes, centred at `middle`.
    pub fn digit(&mut self, color: Color, digit: u32, middle: Vec2, height_mm: f32, line_mm: f32) {
        self.strokes(color, &glyph::digit(digit), middle, 0.6, height_mm, line_mm);
    }

    /// Draws a text of digits and capitals `height_mm` high, centred at `middle`, `gap_mm` between
    /// the glyphs.
    pub fn text(&mut self, color: Color, text: &str, middle: Vec2, [height_mm, line_mm, gap_mm]: [f32; 3]) {
        let size = height_mm - line_mm;
        let width = |letter: char| glyph::width(letter) * size + line_mm;
        let total: f32 = text.chars().map(width).sum::<f32>() + gap_mm * (text.len() as f32 - 1.0);
        let mut left = middle.x - total / 2.0;
        for letter in text.chars() {
            let center = vec2(left + width(letter) / 2.0, middle.y);
            self.strokes(color, &glyph::strokes(letter), center, glyph::width(letter), height_mm, line_mm);
            left += width(letter) + gap_mm;
        }
    }

    /// Strokes in a box `width` wide and 1 high, y up, scaled to `height_mm` including their line.
    fn strokes(&mut self, color: Color, strokes: &[Vec<Vec2>], middle: Vec2, width: f32, height_mm: f32, line_mm: f32) {
        let size = height_mm - line_mm;
        let place = |p: Vec2| middle + vec2(p.x - width / 2.0, 0.5 - p.y) * size;
        let strokes: Vec<Vec<Vec2>> = strokes.iter().map(|line| line.iter().copied().map(place).collect()).collect();
        let reach = Vec2::splat(height_mm);
        self.paint(color, middle - reach, middle + reach, |p| {
            let segments = strokes.iter().flat_map(|line| line.windows(2));
            segments.map(|s| to_segment(p, s[0], s[1])).fold(f32::MAX, f32::min) - line_mm / 2.0
        });
    }
}

/// Distance of a point from a segment.
pub fn to_segment(p: Vec2, a: Vec2, b: Vec2) -> f32 {
    let along = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
    p.distance(a + (b - a) * along)
}
