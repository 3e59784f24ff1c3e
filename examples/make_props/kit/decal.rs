//! Decals: prints and stains as pictures with an opacity, 0.3 mm above the surface.

use glam::{Vec2, Vec3, vec2, vec3};
use serde_json::json;

use super::canvas::{Canvas, to_segment};
use super::glb::Prop;
use super::shape::Shape;

/// Height over the surface.
const HEIGHT_MM: f32 = 0.3;

/// A picture of `size_mm`, seen from above, its lower edge towards +z. A second face at the height
/// 0 faces down, so that a decal that is put on the ground keeps its height.
pub fn decal(name: &'static str, size_mm: Vec2, picture: Canvas, roughness: f32) -> Prop {
    let mut shape = Shape::default();
    for (y, up) in [(HEIGHT_MM, Vec3::Y), (0.0, Vec3::NEG_Y)] {
        shape.grid(1, 1, |s, t| {
            let p = (vec2(s, t) - 0.5) * size_mm;
            (vec3(p.x, y, p.y), up, vec2(s, t))
        });
    }
    Prop {
        name,
        pictures: vec![picture],
        repeat: false,
        materials: vec![json!({
            "name": name,
            "alphaMode": "BLEND",
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": roughness,
            },
        })],
        shapes: vec![(shape, 0)],
    }
}

/// A region bounded by a closed polygon, mm.
#[derive(Clone)]
pub struct Region {
    corners: Vec<Vec2>,
    low: Vec2,
    high: Vec2,
}

impl Region {
    pub fn new(corners: Vec<Vec2>) -> Self {
        let low = corners.iter().copied().reduce(Vec2::min).unwrap_or_default();
        let high = corners.iter().copied().reduce(Vec2::max).unwrap_or_default();
        Self { corners, low, high }
    }

    /// A closed curve through points (Catmull and Rom 1974, uniform), 8 segments between two.
    pub fn through(points: &[[f32; 2]]) -> Self {
        let at = |i: usize| Vec2::from(points[i % points.len()]);
        let piece = |i: usize| {
            let [a, b, c, d] = [i + points.len() - 1, i, i + 1, i + 2].map(at);
            (0..8u8).map(move |n| {
                let t = f32::from(n) / 8.0;
                let [linear, square, cubic] = [c - a, 2.0 * a - 5.0 * b + 4.0 * c - d, 3.0 * (b - c) + d - a];
                b + 0.5 * t * (linear + t * (square + t * cubic))
            })
        };
        Self::new((0..points.len()).flat_map(piece).collect())
    }

    /// The curve `middle + radii(angle) · (cos, sin)` over a turn.
    pub fn around(middle: Vec2, pieces: u16, radius: impl Fn(f32) -> Vec2) -> Self {
        let at = |i: u16| {
            let angle = f32::from(i) / f32::from(pieces) * std::f32::consts::TAU;
            middle + radius(angle) * Vec2::from_angle(angle)
        };
        Self::new((0..pieces).map(at).collect())
    }

    /// An ellipse with its first semi-axis at `angle`, radians.
    pub fn ellipse(middle: Vec2, half_axes: Vec2, angle: f32) -> Self {
        let turned = Self::around(Vec2::ZERO, 72, |_| half_axes);
        Self::new(turned.corners.iter().map(|p| middle + p.rotate(Vec2::from_angle(angle))).collect())
    }

    /// Distance from the boundary, mm, negative inside. Beyond 2 mm outside, that from the box.
    pub fn distance_mm(&self, p: Vec2) -> f32 {
        let to_box = (self.low - p).max(p - self.high).max_element();
        if to_box > 2.0 {
            return to_box;
        }
        let (mut distance, mut is_inside) = (f32::MAX, false);
        for (i, &a) in self.corners.iter().enumerate() {
            let b = self.corners[(i + 1) % self.corners.len()];
            distance = distance.min(to_segment(p, a, b));
            if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x) {
                is_inside = !is_inside;
            }
        }
        if is_inside { -distance } else { distance }
    }

    fn map(&self, map: impl Fn(Vec2) -> Vec2) -> Self {
        Self::new(self.corners.iter().copied().map(map).collect())
    }
}

/// Scales regions so that their common box has the corner `low` and the given size.
pub fn fit(regions: &[Region], low: Vec2, size: Vec2) -> Vec<Region> {
    let from = regions.iter().map(|r| r.low).reduce(Vec2::min).unwrap_or_default();
    let to = regions.iter().map(|r| r.high).reduce(Vec2::max).unwrap_or_default();
    regions.iter().map(|region| region.map(|p| low + (p - from) / (to - from) * size)).collect()
}

/// Distance from the nearest of some regions, mm.
pub fn nearest_mm(regions: &[Region], p: Vec2) -> f32 {
    regions.iter().map(|region| region.distance_mm(p)).fold(f32::MAX, f32::min)
}

/// Coverage of a pixel at a distance from an edge.
pub fn coverage(distance_mm: f32, px_per_mm: f32) -> f32 {
    (0.5 - distance_mm * px_per_mm).clamp(0.0, 1.0)
}

/// Hermite step from 0 at `from` to 1 at `to`.
pub fn smooth_step(from: f32, to: f32, at: f32) -> f32 {
    let t = ((at - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
