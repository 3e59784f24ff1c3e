//! Fired cartridge cases of further calibres. The outside follows the maximum cartridge drawings
//! (SAAMI Z299.1 for .22 LR, SAAMI Z299.3 for .45 Auto, C.I.P. and SAAMI Z299.4 for .223
//! Remington); wall and web are our own.

use glam::{Vec2, vec2, vec3};

use super::decal::smooth_step;
use super::glb::{Prop, metal};
use super::noise;
use super::revolve::{Run, arc, line, revolve};
use super::shape::Shape;

const SEGMENTS: u16 = 36;
const BRASS: [f32; 3] = [0.91, 0.778, 0.423];
const BURNT: [f32; 3] = [0.33, 0.27, 0.16];
const NICKEL: [f32; 3] = [0.697, 0.641, 0.563];

/// .45 Auto (11.43×23 mm): 22.81 mm long, rim 12.19 mm.
pub fn auto_45() -> Prop {
    let outside = vec![
        line([2.74, 0.0], [5.8, 0.0], 2),
        line([5.8, 0.0], [6.095, 0.28], 1),
        line([6.095, 0.28], [6.095, 1.24], 1),
        line([6.095, 1.24], [5.08, 1.4], 1),
        line([5.08, 1.4], [5.08, 2.2], 1),
        line([5.08, 2.2], [6.045, 3.4], 1),
        line([6.045, 3.4], [6.005, 22.66], 4),
        arc([5.855, 22.66], 0.15, 0.0, 90.0, 3),
        line([5.855, 22.81], [5.72, 22.81], 1),
        line([2.67, 0.33], [2.74, 0.0], 1),
    ];
    let inside = vec![
        line([5.72, 22.81], [5.45, 7.0], 3),
        arc([3.45, 7.0], 2.0, 0.0, -90.0, 4),
        line([3.45, 5.0], [0.0, 5.0], 1),
    ];
    case(".45 Auto cartridge case", &outside, &inside, &primer(2.67))
}

/// .223 Remington (5.56×45 mm): 44.70 mm long, rim 9.60 mm, shoulder 9.00 mm, neck 6.43 mm.
pub fn remington_223() -> Prop {
    let outside = vec![
        line([2.29, 0.0], [4.5, 0.0], 2),
        line([4.5, 0.0], [4.8, 0.3], 1),
        line([4.8, 0.3], [4.8, 1.14], 1),
        line([4.8, 1.14], [4.215, 1.3], 1),
        line([4.215, 1.3], [4.215, 2.2], 1),
        line([4.215, 2.2], [4.79, 3.13], 1),
        line([4.79, 3.13], [4.5, 36.52], 6),
        line([4.5, 36.52], [3.215, 39.55], 2),
        line([3.215, 39.55], [3.215, 44.6], 2),
        arc([3.115, 44.6], 0.1, 0.0, 90.0, 3),
        line([3.115, 44.7], [2.87, 44.7], 1),
        line([2.22, 0.33], [2.29, 0.0], 1),
    ];
    let inside = vec![
        line([2.87, 44.7], [2.87, 39.4], 1),
        line([2.87, 39.4], [4.12, 36.4], 1),
        line([4.12, 36.4], [3.9, 7.0], 3),
        arc([2.4, 7.0], 1.5, 0.0, -90.0, 4),
        line([2.4, 5.5], [0.0, 5.5], 1),
    ];
    case(".223 Remington cartridge case", &outside, &inside, &primer(2.22))
}

/// .22 Long Rifle: 15.57 mm long, rim 7.06 mm, struck at the rim.
pub fn rimfire_22() -> Prop {
    let outside = vec![
        arc([3.28, 0.25], 0.25, -90.0, 0.0, 3),
        line([3.53, 0.25], [3.53, 0.84], 1),
        arc([3.28, 0.84], 0.25, 0.0, 90.0, 3),
        line([3.28, 1.09], [2.87, 1.09], 1),
        line([2.87, 1.09], [2.87, 15.5], 4),
        arc([2.8, 15.5], 0.07, 0.0, 90.0, 2),
        line([2.8, 15.57], [2.6, 15.57], 1),
    ];
    let inside = vec![line([2.6, 15.57], [2.6, 0.9], 3), line([2.6, 0.9], [0.0, 0.9], 1)];
    let mut prop = case(".22 LR cartridge case", &outside, &inside, &[]);
    let mut head = Shape::default();
    // The pin's dent at the rim, 0.3 mm deep, with soft edges.
    let height = |p: Vec2| {
        let along = 1.0 - smooth_step(0.25, 0.75, (p.x - 2.5).abs());
        let across = 1.0 - smooth_step(0.35, 0.85, p.y.abs());
        0.3 * along * across
    };
    head.grid(72, 18, |s, t| {
        let way = Vec2::from_angle(s * std::f32::consts::TAU);
        let p = way * 3.28 * (1.0 - t);
        let (dx, dz) = (vec2(0.02, 0.0), vec2(0.0, 0.02));
        let slope = vec2(height(p + dx) - height(p - dx), height(p + dz) - height(p - dz)) / 0.04;
        let uv = p / 7.0;
        (vec3(p.x, height(p), p.y), vec3(slope.x, -1.0, slope.y), uv)
    });
    prop.shapes.push((head, 0));
    prop
}

/// A struck primer, 0.08 mm below the head.
fn primer(radius: f32) -> Vec<Run> {
    vec![
        arc([0.0, -0.42], 1.0, 90.0, 36.87, 4),
        line([0.8, 0.18], [0.95, 0.08], 1),
        line([0.95, 0.08], [radius - 0.25, 0.08], 1),
        arc([radius - 0.25, 0.33], 0.25, -90.0, 0.0, 3),
    ]
}

fn case(name: &'static str, outside: &[Run], inside: &[Run], primer: &[Run]) -> Prop {
    let shapes = [outside, inside, primer].into_iter().enumerate().filter(|(_, runs)| !runs.is_empty());
    let shape = |runs: &[Run]| {
        let mut shape = Shape::default();
        runs.iter().for_each(|run| revolve(&mut shape, run, SEGMENTS));
        shape
    };
    Prop {
        name,
        pictures: vec![noise::roughness(64)],
        repeat: true,
        materials: vec![metal("brass", BRASS, 0.62), metal("burnt brass", BURNT, 1.0), metal("nickel", NICKEL, 0.55)],
        shapes: shapes.map(|(material, runs)| (shape(runs), material)).collect(),
    }
}
