//! Flat arrows that point at evidence or to the north: printed sheets, 1 mm thick. Their size is
//! our own.

use glam::{Vec2, Vec3, vec2, vec3};

use super::canvas::{Canvas, to_segment};
use super::glb::{Prop, printed};
use super::l_scale::{BLACK, WHITE};
use super::shape::Shape;

const LENGTH_MM: f32 = 100.0;
const WIDTH_MM: f32 = 40.0;
const SHAFT_MM: f32 = 18.0;
/// From the tip to the head's end.
const HEAD_MM: f32 = 42.0;
const THICKNESS_MM: f32 = 1.0;
const YELLOW: [u8; 3] = [247, 203, 24];

/// Lies on y = 0 and points to -z.
pub fn arrow() -> Prop {
    sheet("arrow", YELLOW, "")
}

/// As [`arrow`], white with an N.
pub fn north() -> Prop {
    sheet("north arrow", WHITE, "N")
}

/// The outline from the tip on, counter-clockwise seen from above, in (x, z).
fn outline() -> [Vec2; 7] {
    let (tip, head, end) = (-LENGTH_MM / 2.0, HEAD_MM - LENGTH_MM / 2.0, LENGTH_MM / 2.0);
    let (half, shaft) = (WIDTH_MM / 2.0, SHAFT_MM / 2.0);
    [
        vec2(0.0, tip),
        vec2(-half, head),
        vec2(-shaft, head),
        vec2(-shaft, end),
        vec2(shaft, end),
        vec2(shaft, head),
        vec2(half, head),
    ]
}

fn sheet(name: &'static str, color: [u8; 3], label: &str) -> Prop {
    let outline = outline();
    let uv = |p: Vec2| vec2(p.x / WIDTH_MM + 0.5, p.y / LENGTH_MM + 0.5);
    let blank = uv(vec2(0.0, 20.0));
    let mut shape = Shape::default();
    let [tip, left, shaft_left, end_left, end_right, shaft_right, right] = outline;
    // The head as two strips towards the tip, and the shaft.
    for (a, b, c, d) in [(tip, tip, left, right), (shaft_left, shaft_right, end_left, end_right)] {
        for (y, up) in [(THICKNESS_MM, Vec3::Y), (0.0, Vec3::NEG_Y)] {
            shape.grid(2, 2, |s, t| {
                let p = a.lerp(b, s).lerp(c.lerp(d, s), t);
                (vec3(p.x, y, p.y), up, if y > 0.0 { uv(p) } else { blank })
            });
        }
    }
    for (i, &from) in outline.iter().enumerate() {
        let to = outline[(i + 1) % outline.len()];
        let out = vec2(from.y - to.y, to.x - from.x);
        shape.grid(2, 1, |s, t| {
            let p = from.lerp(to, s);
            (vec3(p.x, t * THICKNESS_MM, p.y), vec3(out.x, 0.0, out.y), blank)
        });
    }
    let mut picture = Canvas::new(WIDTH_MM, LENGTH_MM, 8.0, color);
    let corner = vec2(WIDTH_MM, LENGTH_MM) / 2.0;
    let edges: Vec<[Vec2; 2]> = (0..7).map(|i| [outline[i] + corner, outline[(i + 1) % 7] + corner]).collect();
    // A black line inside the edge.
    picture.paint(BLACK, Vec2::ZERO, corner * 2.0, |p| {
        let edge = edges.iter().map(|[a, b]| to_segment(p, *a, *b)).fold(f32::MAX, f32::min);
        (edge - 2.0).abs() - 0.6
    });
    picture.text(BLACK, label, corner + vec2(0.0, -12.0), [16.0, 2.6, 0.0]);
    Prop {
        name,
        pictures: vec![picture],
        repeat: false,
        materials: vec![printed("printed plastic", 0.5)],
        shapes: vec![(shape, 0)],
    }
}
