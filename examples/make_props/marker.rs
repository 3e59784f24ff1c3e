//! A numbered evidence marker: a folded sheet of yellow plastic, 110 mm wide.

use glam::{Vec2, Vec3, vec2, vec3};
use serde_json::json;

use crate::canvas::Canvas;
use crate::glb::Prop;
use crate::shape::Shape;

const WIDTH_MM: f32 = 110.0;
/// From the middle of the marker to the outside of a foot.
const FOOT_MM: f32 = 45.0;
/// A panel from its foot to the beginning of the fold.
const PANEL_MM: f32 = 112.0;
const THICKNESS_MM: f32 = 2.0;
/// Radius of the fold's outside.
const FOLD_MM: f32 = 4.0;

const YELLOW: [u8; 3] = [247, 203, 24];
const BLACK: [u8; 3] = [22, 22, 22];

pub fn marker(digit: u32) -> Prop {
    // The panel leans by `lean` from upright so that the fold's arc meets both sides smoothly.
    let lean = lean();
    let profile = |t: f32, inset: f32| -> (Vec2, Vec2) {
        // (z, y) and the outward normal, along foot, panel, fold, panel, foot; t from 0 to 1.
        let fold_turn = std::f32::consts::PI - 2.0 * lean;
        let side = if t < 0.5 { 1.0 } else { -1.0 };
        let from_foot = 1.0 - (2.0 * t - 1.0).abs(); // 0 at the feet, 1 at the top
        let out = |angle: f32| vec2(angle.cos(), angle.sin());
        let top = vec2(0.0, PANEL_MM * lean.cos() - FOLD_MM * lean.sin());
        let (point, way) = if from_foot <= PANEL_SHARE {
            let way = out(lean);
            let foot = vec2(FOOT_MM, 0.0);
            (foot + vec2(-lean.sin(), lean.cos()) * PANEL_MM * (from_foot / PANEL_SHARE), way)
        } else {
            let way = out(lean + fold_turn / 2.0 * (from_foot - PANEL_SHARE) / (1.0 - PANEL_SHARE));
            (top + way * FOLD_MM, way)
        };
        let point = point - way * inset;
        (vec2(point.x * side, point.y.max(0.0)), vec2(way.x * side, way.y))
    };
    let mut shape = Shape::default();
    let rows = 50; // the flat panels end on a row
    // Each side separately, since one picture would otherwise mirror the other.
    for (from, side) in [(0.0, 1.0), (0.5, -1.0)] {
        for (inset, facing) in [(0.0, 1.0), (THICKNESS_MM, -1.0)] {
            shape.grid(12, rows / 2, |s, t| {
                let (p, way) = profile((from + t / 2.0 + if side < 0.0 { 1e-6 } else { -1e-6 }).clamp(0.0, 1.0), inset);
                let x = (s - 0.5) * WIDTH_MM;
                let from_foot = if side > 0.0 { t } else { 1.0 - t };
                // The inside is plain: it uses the margin beside the digit.
                let uv = vec2(if side > 0.0 { s } else { 1.0 - s }, 1.0 - from_foot);
                let uv = if facing > 0.0 { uv } else { vec2(0.02, 0.3) };
                (vec3(x, p.y, p.x), vec3(0.0, way.y, way.x) * facing, uv)
            });
        }
    }
    for x in [-1.0, 1.0] {
        shape.grid(1, rows, |s, t| {
            let (p, _) = profile(t, s * THICKNESS_MM);
            (vec3(x * WIDTH_MM / 2.0, p.y, p.x), Vec3::X * x, vec2(0.02, 0.3))
        });
    }
    for t in [0.0, 1.0] {
        shape.grid(12, 1, |s, inset| {
            let (p, _) = profile(t, inset * THICKNESS_MM);
            (vec3((s - 0.5) * WIDTH_MM, 0.0, p.x), Vec3::NEG_Y, vec2(0.02, 0.3))
        });
    }
    Prop {
        name: "evidence marker",
        pictures: vec![picture(digit)],
        repeat: false,
        materials: vec![json!({
            "name": "yellow plastic",
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 0.42,
            },
        })],
        shapes: vec![(shape, 0)],
    }
}

/// The share of half the profile's parameter that the flat panel takes.
const PANEL_SHARE: f32 = 0.8;

/// Solves foot = panel · sin(lean) + fold radius · cos(lean) by bisection.
fn lean() -> f32 {
    let (mut low, mut high) = (0.0f32, 1.5f32);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        let foot = PANEL_MM * middle.sin() + FOLD_MM * middle.cos();
        if foot < FOOT_MM { low = middle } else { high = middle }
    }
    low
}

/// The texture of one panel: the digit, and a bar of centimetres above the foot. v is linear in the
/// profile's parameter, so the panel's 112 mm take the picture's lower 0.8.
fn picture(digit: u32) -> Canvas {
    let height = PANEL_MM / PANEL_SHARE;
    let mut canvas = Canvas::new(WIDTH_MM, height, 5.0, YELLOW);
    let top = height - PANEL_MM;
    canvas.digit(BLACK, digit, vec2(WIDTH_MM / 2.0, top + 47.0), 80.0, 13.0);
    let bar = height - 14.0;
    canvas.rectangle(BLACK, vec2(4.5, bar - 0.5), vec2(105.5, bar + 6.5));
    for cm in 0..10u8 {
        let color = if cm % 2 == 0 { [240, 240, 240] } else { BLACK };
        let x = 5.0 + 10.0 * f32::from(cm);
        canvas.rectangle(color, vec2(x, bar), vec2(x + 10.0, bar + 6.0));
    }
    canvas
}
