//! A fired 9×19 mm cartridge case: brass, 19.15 mm long, rim 9.93 mm (C.I.P. 9 mm Luger,
//! rounded), a nickelled primer with the firing pin's dent, hollow to the web.

use super::glb::{Prop, metal};
use super::noise;
use super::revolve::{arc, line, revolve};
use super::shape::Shape;

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
        revolve(&mut outside, &run, SEGMENTS);
    }
    revolve(&mut inside, &line([4.5, 19.15], [4.2, 6.6], 12), SEGMENTS);
    revolve(&mut inside, &arc([2.2, 6.6], 2.0, 0.0, -90.0, 6), SEGMENTS);
    revolve(&mut inside, &line([2.2, 4.6], [0.0, 4.6], 2), SEGMENTS);
    // The primer, 0.08 mm below the head, with a rounded edge and the pin's dent in its middle.
    revolve(&mut primer, &arc([0.0, -0.42], 1.0, 90.0, 36.87, 6), SEGMENTS);
    revolve(&mut primer, &line([0.8, 0.18], [0.95, 0.08], 1), SEGMENTS);
    revolve(&mut primer, &line([0.95, 0.08], [2.0, 0.08], 2), SEGMENTS);
    revolve(&mut primer, &arc([2.0, 0.33], 0.25, -90.0, 0.0, 4), SEGMENTS);
    Prop {
        name: "9 mm cartridge case",
        pictures: vec![noise::roughness(256)],
        repeat: true,
        materials: vec![
            metal("brass", [0.91, 0.778, 0.423], 0.62),
            metal("burnt brass", [0.33, 0.27, 0.16], 1.0),
            metal("nickel", [0.697, 0.641, 0.563], 0.55),
        ],
        shapes: vec![(outside, 0), (inside, 1), (primer, 2)],
    }
}
