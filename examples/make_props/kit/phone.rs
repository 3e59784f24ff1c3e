//! A smartphone, 147 × 71.5 × 7.8 mm, of no maker: a metal frame with rounded edges, black glass.
//! Its size is our own, as of phones with a 6.1-inch display.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3, vec2, vec3};

use super::glb::{Prop, plain};
use super::shape::Shape;

const HALF_MM: Vec2 = vec2(35.75, 73.5);
const THICKNESS_MM: f32 = 7.8;
/// Radius of the corners, and of the frame's edges.
const CORNER_MM: f32 = 11.0;
const EDGE_MM: f32 = 2.0;
/// From the outline to the glass, and to the display.
const GLASS_MM: f32 = 1.3;
const DISPLAY_MM: f32 = 4.0;
const CORNER_PIECES: u16 = 10;
/// Points of the outline.
const PIECES: u16 = 4 * (CORNER_PIECES + 1);

/// Lies on y = 0, display up, its upper end towards -z.
pub fn phone() -> Prop {
    let mut frame = Shape::default();
    let top = THICKNESS_MM - 0.01;
    // Inset, height and the direction of the normal, degrees up from outwards.
    let arc = |from: f32, n: u8| (0..=n).map(move |i| from + 90.0 * f32::from(i) / f32::from(n));
    let lower = arc(-90.0, 6).map(|deg| (EDGE_MM, deg));
    let upper = arc(0.0, 6).map(|deg| (THICKNESS_MM - EDGE_MM, deg));
    let profile: Vec<[f32; 3]> = lower
        .chain(upper)
        .map(|(middle, deg)| {
            let (sin, cos) = deg.to_radians().sin_cos();
            [EDGE_MM * (1.0 - cos), middle + EDGE_MM * sin, deg]
        })
        .filter(|[inset, height, _]| *height < EDGE_MM * 2.0 || *inset <= GLASS_MM)
        .collect();
    frame.grid(PIECES, profile.len() as u16 - 1, |s, t| {
        let [inset, height, deg] = profile[(t * (profile.len() - 1) as f32).round() as usize];
        let (p, way) = outline(s, inset);
        let (sin, cos) = deg.to_radians().sin_cos();
        (vec3(p.x, height, p.y), vec3(way.x * cos, sin, way.y * cos), Vec2::ZERO)
    });
    let mut glass = Shape::default();
    let last = profile.last().copied().unwrap_or_default();
    ring(&mut frame, [last[0], GLASS_MM + 0.1], [last[1], top]);
    ring(&mut glass, [GLASS_MM + 0.1, DISPLAY_MM], [top, top]);
    flat(&mut glass, EDGE_MM, 0.0, Vec3::NEG_Y);
    let mut display = Shape::default();
    flat(&mut display, DISPLAY_MM, top, Vec3::Y);
    // The front camera, in a black circle.
    let mut camera = Shape::default();
    let middle = vec2(0.0, 7.0 - HALF_MM.y);
    camera.grid(24, 1, |s, t| {
        let p = middle + Vec2::from_angle(s * TAU) * 1.9 * t;
        (vec3(p.x, THICKNESS_MM, p.y), Vec3::Y, Vec2::ZERO)
    });
    Prop {
        name: "smartphone",
        pictures: Vec::new(),
        repeat: false,
        materials: vec![
            plain("frame", [0.30, 0.30, 0.32], 1.0, 0.32),
            plain("black glass", [0.004, 0.004, 0.005], 0.0, 0.06),
            plain("display", [0.010, 0.011, 0.014], 0.0, 0.06),
            plain("camera", [0.001, 0.001, 0.002], 0.0, 0.04),
        ],
        shapes: vec![(frame, 0), (glass, 1), (display, 2), (camera, 3)],
    }
}

/// Point and outward normal of the outline, `inset` mm inside, at the share `s` of its points, in
/// (x, z).
fn outline(s: f32, inset: f32) -> (Vec2, Vec2) {
    let point = (s * f32::from(PIECES)).round() as u16 % PIECES;
    let (corner, step) = (point / (CORNER_PIECES + 1), point % (CORNER_PIECES + 1));
    let angle = PI / 2.0 * (f32::from(corner) + f32::from(step) / f32::from(CORNER_PIECES));
    let way = Vec2::from_angle(angle);
    let quarter = Vec2::from_angle(PI / 2.0 * (f32::from(corner) + 0.5)).signum();
    (quarter * (HALF_MM - CORNER_MM) + way * (CORNER_MM - inset), way)
}

/// The strip between two insets at two heights, facing up.
fn ring(shape: &mut Shape, insets: [f32; 2], heights: [f32; 2]) {
    shape.grid(PIECES, 1, |s, t| {
        let (p, _) = outline(s, insets[0] + (insets[1] - insets[0]) * t);
        (vec3(p.x, heights[0] + (heights[1] - heights[0]) * t, p.y), Vec3::Y, Vec2::ZERO)
    });
}

/// The flat face within an inset.
fn flat(shape: &mut Shape, inset: f32, height: f32, up: Vec3) {
    shape.grid(PIECES, 1, |s, t| {
        let (p, _) = outline(s, inset);
        (vec3(p.x * (1.0 - t), height, p.y * (1.0 - t)), up, Vec2::ZERO)
    });
}
