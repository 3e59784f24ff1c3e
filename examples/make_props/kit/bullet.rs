//! Full-metal-jacket bullets of 9 mm Luger, unfired and fired: 9.01 mm (0.355 in; SAAMI Z299.3).
//! The fired one has the marks of a C.I.P. barrel: six lands, bore 8.82 mm, grooves 2.49 mm wide,
//! one turn in 250 mm, clockwise seen from behind.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, vec2, vec3};

use super::glb::{Prop, metal, plain};
use super::noise;
use super::revolve::{line, revolve};
use super::shape::Shape;

const RADIUS_MM: f32 = 4.505;
/// Height of the cylinder's end.
const SHOULDER_MM: f32 = 6.2;
const LENGTH_MM: f32 = 15.2;
const BORE_RADIUS_MM: f32 = 4.41;
const LANDS: f32 = 6.0;
const GROOVE_WIDTH_MM: f32 = 2.49;
const TWIST_MM: f32 = 250.0;
const SEGMENTS: u16 = 48;

/// Stands on its base, the axis along y.
pub fn unfired() -> Prop {
    let mut jacket = Shape::default();
    jacket_end(&mut jacket);
    revolve(&mut jacket, &line([RADIUS_MM, 0.7], [RADIUS_MM, SHOULDER_MM], 3), SEGMENTS);
    ogive(&mut jacket, 0.0);
    bullet("9 mm bullet", jacket, 0.5)
}

/// As [`unfired`], with the marks of the lands.
pub fn fired() -> Prop {
    let mut jacket = Shape::default();
    jacket_end(&mut jacket);
    let (from, to) = (0.7, SHOULDER_MM + 0.8);
    jacket.grid(120, 6, |s, t| {
        let (angle, y) = (s * TAU, from + (to - from) * t);
        let radius = |angle: f32, y: f32| engraved_radius_mm(angle, y);
        let r = radius(angle, y);
        let around = (radius(angle + 0.01, y) - radius(angle - 0.01, y)) / (0.02 * r);
        let way = vec2(angle.cos(), angle.sin());
        let normal = way - way.perp() * around;
        (vec3(r * way.x, y, r * way.y), vec3(normal.x, 0.0, normal.y), vec2(s * 2.0, y / 15.0))
    });
    ogive(&mut jacket, 0.8);
    bullet("fired 9 mm bullet", jacket, 0.62)
}

/// Radius on the cylinder: the bore's under a land, with edges of 0.15 mm, shallower towards the
/// nose.
fn engraved_radius_mm(angle: f32, y: f32) -> f32 {
    let pitch = TAU / LANDS;
    let place = (angle + TAU * y / TWIST_MM).rem_euclid(pitch) - pitch / 2.0;
    let land_width = TAU * (RADIUS_MM + BORE_RADIUS_MM) / 2.0 / LANDS - GROOVE_WIDTH_MM;
    let inside = land_width / 2.0 - place.abs() * RADIUS_MM;
    let depth = (inside / 0.15).clamp(0.0, 1.0);
    let fade = ((SHOULDER_MM + 0.8 - y) / 0.8).clamp(0.0, 1.0);
    ellipse_radius_mm(y) - depth * fade * (RADIUS_MM - BORE_RADIUS_MM)
}

/// Radius of the unmarked jacket: half an ellipse above the cylinder.
fn ellipse_radius_mm(y: f32) -> f32 {
    let share = ((y - SHOULDER_MM) / (LENGTH_MM - SHOULDER_MM)).clamp(0.0, 1.0);
    RADIUS_MM * (1.0 - share * share).max(0.0).sqrt()
}

/// The nose from `above` mm over the cylinder.
fn ogive(shape: &mut Shape, above: f32) {
    let height = LENGTH_MM - SHOULDER_MM;
    let start = (above / height).asin();
    shape.grid(SEGMENTS, 12, |s, t| {
        let (sin, cos) = (start + (PI / 2.0 - start) * t).sin_cos();
        let p = if t == 1.0 { vec2(0.0, LENGTH_MM) } else { vec2(RADIUS_MM * cos, SHOULDER_MM + height * sin) };
        let out = vec2(cos / RADIUS_MM, sin / height);
        let way = Vec2::from_angle(s * TAU);
        (vec3(p.x * way.x, p.y, p.x * way.y), vec3(out.x * way.x, out.y, out.x * way.y), vec2(s * 2.0, p.y / 15.0))
    });
}

/// The jacket's rolled edge at the base.
fn jacket_end(shape: &mut Shape) {
    revolve(shape, &line([3.2, 0.35], [3.2, 0.0], 1), SEGMENTS);
    revolve(shape, &line([3.2, 0.0], [3.95, 0.0], 1), SEGMENTS);
    revolve(shape, &line([3.95, 0.0], [RADIUS_MM, 0.7], 1), SEGMENTS);
}

fn bullet(name: &'static str, jacket: Shape, roughness: f32) -> Prop {
    let mut core = Shape::default();
    revolve(&mut core, &line([0.0, 0.35], [3.2, 0.35], 1), SEGMENTS);
    Prop {
        name,
        pictures: vec![noise::roughness(64)],
        repeat: true,
        materials: vec![
            metal("copper jacket", [0.80, 0.48, 0.30], roughness),
            plain("lead", [0.22, 0.22, 0.23], 1.0, 0.7),
        ],
        shapes: vec![(jacket, 0), (core, 1)],
    }
}
