//! A fired 9×19 mm cartridge case: brass, 19.15 mm long, rim 9.93 mm (C.I.P. 9 mm Luger,
//! rounded), a nickelled primer with the firing pin's dent, hollow to the web.

use std::f32::consts::TAU;

use glam::{Vec2, vec2, vec3};
use serde_json::json;

use crate::canvas::Canvas;
use crate::glb::Prop;
use crate::shape::Shape;

const SEGMENTS: u16 = 48;

/// Stands on its head, the axis along y.
pub fn cartridge() -> Prop {
    // Radius and height, mm, outside first; the outward normal is to the right of each run.
    let (mut outside, mut inside, mut primer) = (Shape::default(), Shape::default(), Shape::default());
    for run in [
        line([2.32, 0.0], [4.665, 0.0], 4),
        line([4.665, 0.0], [4.965, 0.3], 1),
        line([4.965, 0.3], [4.965, 1.27], 2),
        line([4.965, 1.27], [4.395, 1.42], 1),
        line([4.395, 1.42], [4.395, 2.25], 2),
        line([4.395, 2.25], [4.94, 3.1], 2),
        line([4.94, 3.1], [4.825, 19.0], 16),
        arc([4.675, 19.0], 0.15, 0.0, 90.0, 3), // the mouth's edge
        line([4.675, 19.15], [4.5, 19.15], 1),
        line([2.25, 0.33], [2.32, 0.0], 1), // the primer's pocket
    ] {
        revolve(&mut outside, &run);
    }
    revolve(&mut inside, &line([4.5, 19.15], [4.2, 6.6], 12));
    revolve(&mut inside, &arc([2.2, 6.6], 2.0, 0.0, -90.0, 6));
    revolve(&mut inside, &line([2.2, 4.6], [0.0, 4.6], 2));
    // The primer, 0.08 mm below the head, with a rounded edge and the pin's dent in its middle.
    revolve(&mut primer, &arc([0.0, -0.42], 1.0, 90.0, 36.87, 6));
    revolve(&mut primer, &line([0.8, 0.18], [0.95, 0.08], 1));
    revolve(&mut primer, &line([0.95, 0.08], [2.0, 0.08], 2));
    revolve(&mut primer, &arc([2.0, 0.33], 0.25, -90.0, 0.0, 4));
    let material = |name: &str, color: [f32; 3], roughness: f32| {
        json!({
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [color[0], color[1], color[2], 1.0],
                "metallicFactor": 1.0, "roughnessFactor": roughness,
                "metallicRoughnessTexture": { "index": 0 },
            },
        })
    };
    Prop {
        name: "9 mm cartridge case",
        pictures: vec![roughness()],
        repeat: true,
        materials: vec![
            material("brass", [0.91, 0.778, 0.423], 0.62),
            material("burnt brass", [0.33, 0.27, 0.16], 1.0),
            material("nickel", [0.697, 0.641, 0.563], 0.55),
        ],
        shapes: vec![(outside, 0), (inside, 1), (primer, 2)],
    }
}

/// A piece of the profile without creases: points (radius, height) and their outward normals.
struct Run(Vec<(Vec2, Vec2)>);

fn line(from: [f32; 2], to: [f32; 2], pieces: u16) -> Run {
    let (from, to) = (Vec2::from(from), Vec2::from(to));
    let out = vec2(to.y - from.y, from.x - to.x);
    Run((0..=pieces).map(|i| (from + (to - from) * f32::from(i) / f32::from(pieces), out)).collect())
}

/// An arc between two angles, degrees counter-clockwise from the direction of growing radius. The
/// outward normal points away from the middle if the angle grows, and towards it if it falls.
fn arc(middle: [f32; 2], radius: f32, from: f32, to: f32, pieces: u16) -> Run {
    let point = |i| {
        let way = Vec2::from_angle((from + (to - from) * f32::from(i) / f32::from(pieces)).to_radians());
        (Vec2::from(middle) + way * radius, way * (to - from).signum())
    };
    Run((0..=pieces).map(point).collect())
}

/// Revolves a run about the axis.
fn revolve(shape: &mut Shape, run: &Run) {
    let rows = run.0.len() as u16 - 1;
    shape.grid(SEGMENTS, rows, |s, t| {
        let (p, out) = run.0[(t * f32::from(rows)).round() as usize];
        let (sin, cos) = (s * TAU).sin_cos();
        let uv = vec2(s * 2.0, (p.y + p.x) / 15.0);
        (vec3(p.x * cos, p.y, p.x * sin), vec3(out.x * cos, out.y, out.x * sin), uv)
    });
}

/// Green is roughness: fine rings from drawing the brass, broken up, and a few stains.
fn roughness() -> Canvas {
    Canvas::from_fn(256, 256, |x, y| {
        let rings = noise(0, x / 64, y);
        let grain = noise(1, x, y);
        let stains = smooth_noise(x, y);
        let value = 0.62 + 0.14 * rings + 0.06 * grain + 0.30 * (stains - 0.5).max(0.0);
        let green = (value * 255.0).round() as u8 & 0xfc; // four grades of 256: a smaller file
        [0, green, 255]
    })
}

/// 0 to 1 from a hash of integers (Jarzynski & Olano 2020, pcg3d).
fn noise(seed: u32, x: u32, y: u32) -> f32 {
    let mut v = [x, y, seed].map(|n| n.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    for _ in 0..2 {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v = v.map(|n| n ^ (n >> 16));
    }
    v[0] as f32 / u32::MAX as f32
}

/// Noise with cells of 32 pixels that tiles at the picture's edges.
fn smooth_noise(x: u32, y: u32) -> f32 {
    let corner = |dx, dy| noise(2, (x / 32 + dx) % 8, (y / 32 + dy) % 8);
    let ease = |n: u32| {
        let f = (n % 32) as f32 / 32.0;
        f * f * (3.0 - 2.0 * f)
    };
    let (u, v) = (ease(x), ease(y));
    let row = |dy| corner(0, dy) * (1.0 - u) + corner(1, dy) * u;
    row(0) * (1.0 - v) + row(1) * v
}
