//! A kitchen knife, 330 mm long: a blade of 200 mm by 46 mm, 2.2 mm at the spine, and a riveted
//! handle. Its size is our own, as of a chef's knife of 20 cm.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3, vec2, vec3};

use super::glb::{Prop, plain};
use super::shape::Shape;

const BLADE_MM: f32 = 200.0;
const BLADE_HEIGHT_MM: f32 = 46.0;
const SPINE_MM: f32 = 2.2;
const BOLSTER_MM: f32 = 14.0;
const HANDLE_MM: f32 = 116.0;
/// Half of the handle's thickness, without its rivets, and of its height.
const GRIP_MM: Vec2 = vec2(8.95, 12.0);
const RIVET_RISE_MM: f32 = 0.05;
/// Height of the middle plane over the ground.
const MIDDLE_MM: f32 = GRIP_MM.x + RIVET_RISE_MM;
/// From the spine to the handle's axis.
const HANDLE_MIDDLE_MM: f32 = 13.0;
const AROUND: u16 = 32;

/// Lies on its side on y = 0: the tip towards +x, the edge towards +z.
pub fn knife() -> Prop {
    let (mut blade, mut bolster) = (Shape::default(), Shape::default());
    for side in [1.0, -1.0] {
        blade.surface(28, 3, on_middle, |s, t| blade_point(s, t, side));
    }
    // The spine and the heel.
    blade.surface(
        28,
        1,
        |p| p + vec3(0.0, 0.0, 20.0),
        |s, t| {
            let [a, b] = [1.0, -1.0].map(|side| blade_point(s, 0.0, side));
            a.lerp(b, t)
        },
    );
    blade.surface(
        1,
        4,
        |p| p + vec3(20.0, 0.0, 0.0),
        |s, t| blade_point(0.0, t, 1.0).lerp(blade_point(0.0, t, -1.0), s),
    );
    bolster.surface(AROUND, 5, on_axis, |s, t| {
        let ease = t * t * (3.0 - 2.0 * t);
        let half = GRIP_MM.lerp(vec2(SPINE_MM / 2.0, 12.6), ease);
        section(s, half, -BOLSTER_MM * (1.0 - t), HANDLE_MIDDLE_MM - 0.4 * ease, 3.0)
    });
    let mut handle = Shape::default();
    handle.surface(AROUND, 14, on_axis, |s, t| {
        // Rounded at the butt, where the rows are dense; slender in the middle.
        let from_butt = t * t * HANDLE_MM;
        let round = if from_butt < 10.0 { (1.0 - (1.0 - from_butt / 10.0).powi(2)).max(1e-4).sqrt() } else { 1.0 };
        let waist = 1.0 - 0.14 * (std::f32::consts::PI * t * t).sin().powi(2);
        let half = vec2(GRIP_MM.x, GRIP_MM.y * waist) * round;
        section(s, half, -BOLSTER_MM - HANDLE_MM + from_butt, HANDLE_MIDDLE_MM, 3.0)
    });
    let mut rivets = Shape::default();
    for (x, side) in [28.0, 58.0, 88.0].into_iter().flat_map(|x| [(x, 1.0), (x, -1.0)]) {
        let middle = vec3(-BOLSTER_MM - x, side * (GRIP_MM.x + RIVET_RISE_MM), HANDLE_MIDDLE_MM);
        rivets.surface(20, 2, on_middle, |s, t| {
            let p = Vec2::from_angle(s * TAU) * 3.2 * (1.0 - t);
            let drop = if t == 0.0 { 0.35 } else { 0.0 };
            place(middle + vec3(p.x, -side * drop, p.y))
        });
    }
    Prop {
        name: "kitchen knife",
        pictures: Vec::new(),
        repeat: false,
        materials: vec![
            plain("blade", [0.56, 0.57, 0.58], 1.0, 0.30),
            plain("bolster", [0.60, 0.61, 0.62], 1.0, 0.25),
            plain("handle", [0.018, 0.017, 0.016], 0.0, 0.45),
            plain("rivets", [0.6, 0.6, 0.6], 1.0, 0.35),
        ],
        shapes: vec![(blade, 0), (bolster, 1), (handle, 2), (rivets, 3)],
    }
}

/// From the drawing (x from the heel to the tip, y from the middle plane, z from the spine) to the
/// model.
fn place(p: Vec3) -> Vec3 {
    let middle = (BLADE_MM - BOLSTER_MM - HANDLE_MM) / 2.0;
    vec3(p.x - middle, p.y + MIDDLE_MM, p.z - BLADE_HEIGHT_MM / 2.0)
}

/// The point of the blade's middle plane beside a point of the model.
fn on_middle(p: Vec3) -> Vec3 {
    vec3(p.x, MIDDLE_MM, p.z)
}

/// The point of the handle's axis beside a point of the model.
fn on_axis(p: Vec3) -> Vec3 {
    vec3(p.x, MIDDLE_MM, HANDLE_MIDDLE_MM - BLADE_HEIGHT_MM / 2.0)
}

/// A point of the blade at `s` from heel to tip and `t` from spine to edge, on one side.
fn blade_point(s: f32, t: f32, side: f32) -> Vec3 {
    let spine = 9.0 * ((s - 0.35) / 0.65).max(0.0).powi(2);
    let edge = 9.3 + (BLADE_HEIGHT_MM - 9.3) * (1.0 - s.powf(2.8)).max(0.0).powf(0.85);
    let half = SPINE_MM / 2.0 * (1.0 - 0.97 * s);
    // A flat grind down to the edge.
    let thickness = 1.0 - 0.98 * t;
    place(vec3(BLADE_MM * s, side * half * thickness, spine + (edge - spine) * t))
}

/// A point of a superellipse across the x axis, at the share `s` of a turn.
fn section(s: f32, half: Vec2, x: f32, middle_z: f32, power: f32) -> Vec3 {
    let (sin, cos) = (s * TAU).sin_cos();
    let shaped = |v: f32| v.signum() * v.abs().powf(2.0 / power);
    place(vec3(x, half.x * shaped(sin), middle_z + half.y * shaped(cos)))
}
