//! A picture drawn in millimetres, with antialiased edges.

use glam::{Vec2, vec2};

pub type Color = [u8; 3];

pub struct Canvas {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
    px_per_mm: f32,
}

impl Canvas {
    pub fn new(width_mm: f32, height_mm: f32, px_per_mm: f32, color: Color) -> Self {
        let [width, height] = [width_mm, height_mm].map(|mm| (mm * px_per_mm).round() as u32);
        Self { width, height, rgb: color.repeat((width * height) as usize), px_per_mm }
    }

    /// A canvas of one pixel per cell, each computed from its column and row.
    pub fn from_fn(width: u32, height: u32, at: impl Fn(u32, u32) -> Color) -> Self {
        let rgb = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| at(x, y)).collect();
        Self { width, height, rgb, px_per_mm: 1.0 }
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

    /// Draws a digit in an own stroke font, `height_mm` high including the strokes, centred at
    /// `middle`.
    pub fn digit(&mut self, color: Color, digit: u32, middle: Vec2, height_mm: f32, line_mm: f32) {
        let size = height_mm - line_mm;
        let place = |p: Vec2| middle + vec2(p.x - 0.3, 0.5 - p.y) * size;
        let strokes: Vec<Vec<Vec2>> =
            strokes(digit).into_iter().map(|line| line.into_iter().map(place).collect()).collect();
        let reach = Vec2::splat(height_mm);
        self.paint(color, middle - reach, middle + reach, |p| {
            let segments = strokes.iter().flat_map(|line| line.windows(2));
            segments.map(|s| to_segment(p, s[0], s[1])).fold(f32::MAX, f32::min) - line_mm / 2.0
        });
    }
}

fn to_segment(p: Vec2, a: Vec2, b: Vec2) -> f32 {
    let along = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
    p.distance(a + (b - a) * along)
}

/// The strokes of a digit in a box 0.6 wide and 1 high, y up.
fn strokes(digit: u32) -> Vec<Vec<Vec2>> {
    match digit {
        0 => vec![arc([0.3, 0.5], [0.3, 0.5], 0.0, 360.0)],
        1 => vec![line(&[[0.1, 0.78], [0.36, 1.0], [0.36, 0.0]])],
        2 => {
            let mut top = arc([0.3, 0.7], [0.295, 0.295], 165.0, -46.0);
            top.extend(line(&[[0.0, 0.0], [0.6, 0.0]]));
            vec![top]
        }
        3 => vec![arc([0.28, 0.76], [0.26, 0.24], 155.0, -90.0), arc([0.28, 0.26], [0.31, 0.26], 90.0, -155.0)],
        4 => vec![line(&[[0.45, 0.0], [0.45, 1.0], [0.0, 0.28], [0.62, 0.28]])],
        5 => {
            let mut bow = line(&[[0.54, 1.0], [0.12, 1.0], [0.07, 0.55]]);
            bow.extend(arc([0.28, 0.32], [0.31, 0.32], 132.0, -150.0));
            vec![bow]
        }
        6 => six(),
        7 => vec![line(&[[0.0, 1.0], [0.6, 1.0], [0.2, 0.0]])],
        8 => vec![arc([0.3, 0.76], [0.25, 0.24], 0.0, 360.0), arc([0.3, 0.27], [0.3, 0.27], 0.0, 360.0)],
        9 => six().into_iter().map(|l| l.into_iter().map(|p| vec2(0.6, 1.0) - p).collect()).collect(),
        _ => Vec::new(),
    }
}

fn six() -> Vec<Vec<Vec2>> {
    vec![arc([0.3, 0.3], [0.3, 0.3], 0.0, 360.0), arc([0.62, 0.3], [0.62, 0.7], 180.0, 98.0)]
}

fn line(points: &[[f32; 2]]) -> Vec<Vec2> {
    points.iter().copied().map(Vec2::from).collect()
}

/// An elliptical arc between two angles, degrees counter-clockwise from the right.
fn arc(middle: [f32; 2], radii: [f32; 2], from: f32, to: f32) -> Vec<Vec2> {
    let at = |i: u32| {
        Vec2::from(middle) + Vec2::from(radii) * Vec2::from_angle((from + (to - from) * i as f32 / 40.0).to_radians())
    };
    (0..=40).map(at).collect()
}
