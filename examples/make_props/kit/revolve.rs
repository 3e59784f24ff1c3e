//! Surfaces of revolution.

use std::f32::consts::TAU;

use glam::{Vec2, vec2, vec3};

use super::shape::Shape;

/// A piece of the profile without creases: points (radius, height) and their outward normals.
pub struct Run(pub Vec<(Vec2, Vec2)>);

/// A straight piece of the profile, from and to a radius and a height, mm.
pub fn line(from: [f32; 2], to: [f32; 2], pieces: u16) -> Run {
    let (from, to) = (Vec2::from(from), Vec2::from(to));
    let out = vec2(to.y - from.y, from.x - to.x);
    Run((0..=pieces).map(|i| (from + (to - from) * f32::from(i) / f32::from(pieces), out)).collect())
}

/// An arc between two angles, degrees counter-clockwise from the direction of growing radius. The
/// outward normal points away from the middle if the angle grows, and towards it if it falls.
pub fn arc(middle: [f32; 2], radius: f32, from: f32, to: f32, pieces: u16) -> Run {
    let point = |i| {
        let way = Vec2::from_angle((from + (to - from) * f32::from(i) / f32::from(pieces)).to_radians());
        (Vec2::from(middle) + way * radius, way * (to - from).signum())
    };
    Run((0..=pieces).map(point).collect())
}

/// Revolves a run about the y axis.
pub fn revolve(shape: &mut Shape, run: &Run, segments: u16) {
    let rows = run.0.len() as u16 - 1;
    shape.grid(segments, rows, |s, t| {
        let (p, out) = run.0[(t * f32::from(rows)).round() as usize];
        let (sin, cos) = (s * TAU).sin_cos();
        let uv = vec2(s * 2.0, (p.y + p.x) / 15.0);
        (vec3(p.x * cos, p.y, p.x * sin), vec3(out.x * cos, out.y, out.x * sin), uv)
    });
}
