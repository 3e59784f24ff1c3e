//! Prints of shoes and bare feet. Shapes and sizes are our own: an outsole of 300 mm (about EU 43),
//! and a bare foot of 262 mm.

use glam::{Vec2, vec2};

use super::canvas::Canvas;
use super::decal::{Region, coverage, decal, fit, nearest_mm, smooth_step};
use super::glb::Prop;
use super::noise::value_noise;

const PX_PER_MM: f32 = 3.0;
const MARGIN_MM: f32 = 10.0;
const SOLE_MM: Vec2 = vec2(108.0, 300.0);
const FOOT_MM: Vec2 = vec2(96.0, 262.0);
const DUST: [u8; 3] = [52, 46, 40];
const BLOOD: [u8; 3] = [88, 12, 10];

/// A shoe's print in dark dust; the toe points to -z.
pub fn shoe(right: bool) -> Prop {
    // A left outsole: the inner side is on the right.
    let outline = Region::through(&[
        [60.0, 0.0],
        [88.0, 18.0],
        [103.0, 58.0],
        [104.0, 95.0],
        [92.0, 140.0],
        [84.0, 180.0],
        [87.0, 225.0],
        [87.0, 265.0],
        [74.0, 292.0],
        [53.0, 300.0],
        [32.0, 292.0],
        [19.0, 265.0],
        [17.0, 225.0],
        [12.0, 180.0],
        [4.0, 135.0],
        [1.0, 95.0],
        [8.0, 50.0],
        [30.0, 12.0],
    ]);
    let outline = &fit(&[outline], Vec2::splat(MARGIN_MM), SOLE_MM)[0];
    let opacity = |p: Vec2| {
        let edge = outline.distance_mm(p);
        if edge > 1.0 {
            return 0.0;
        }
        let sole = p - MARGIN_MM;
        let rim = edge.max(-5.5 - edge);
        let lugs = tread_mm(sole).max(edge + 8.0);
        coverage(rim.min(lugs), PX_PER_MM) * pressure(p, 7, edge) * 0.82
    };
    print("shoe print", SOLE_MM, DUST, right, 0.9, opacity)
}

/// A bare foot's print in blood; the toes point to -z.
pub fn bare(right: bool) -> Prop {
    let sole = Region::through(&[
        [86.0, 66.0],
        [90.0, 88.0],
        [82.0, 112.0],
        [64.0, 134.0],
        [52.0, 155.0],
        [50.0, 178.0],
        [58.0, 205.0],
        [62.0, 232.0],
        [54.0, 254.0],
        [36.0, 263.0],
        [19.0, 255.0],
        [11.0, 232.0],
        [11.0, 200.0],
        [8.0, 160.0],
        [4.0, 125.0],
        [2.0, 95.0],
        [8.0, 74.0],
        [26.0, 66.0],
        [46.0, 60.0],
        [68.0, 56.0],
    ]);
    // Middle, half axes and turn of each toe, from the big one.
    let toes = [
        ([72.0, 24.0], [18.0, 13.0], 1.45),
        ([48.5, 17.5], [10.5, 7.5], 1.5),
        ([32.0, 24.0], [9.5, 7.0], 1.35),
        ([18.5, 35.0], [9.0, 6.5], 1.2),
        ([8.0, 51.0], [8.5, 6.0], 1.05),
    ];
    let toes = toes.map(|(middle, axes, turn)| Region::ellipse(middle.into(), axes.into(), turn));
    let regions: Vec<Region> = [sole].into_iter().chain(toes).collect();
    let regions = fit(&regions, Vec2::splat(MARGIN_MM), FOOT_MM);
    let opacity = |p: Vec2| {
        let edge = nearest_mm(&regions, p);
        if edge > 1.0 {
            return 0.0;
        }
        // Blood is pressed out to the edge.
        let squeezed = 1.0 - 0.25 * smooth_step(-1.0, -5.0, edge);
        coverage(edge, PX_PER_MM) * pressure(p, 23, edge) * squeezed * 0.9
    };
    print("bare footprint", FOOT_MM, BLOOD, right, 0.5, opacity)
}

fn print(
    name: &'static str,
    size_mm: Vec2,
    color: [u8; 3],
    right: bool,
    roughness: f32,
    opacity: impl Fn(Vec2) -> f32,
) -> Prop {
    let sheet = size_mm + 2.0 * MARGIN_MM;
    let side = |p: Vec2| if right { vec2(sheet.x - p.x, p.y) } else { p };
    let picture = Canvas::mask(sheet, PX_PER_MM, color, |p| opacity(side(p)));
    decal(name, sheet, picture, roughness)
}

/// Uneven transfer, 0 to 1; even at the edge, so that the outline keeps its size.
fn pressure(p: Vec2, seed: u32, edge_mm: f32) -> f32 {
    let patches = smooth_step(0.2, 0.75, 0.65 * value_noise(seed, p / 17.0) + 0.35 * value_noise(seed + 1, p / 6.0));
    let grain = value_noise(seed + 2, p / 1.6);
    let uneven = (0.35 + 0.65 * patches) * (0.72 + 0.28 * grain);
    1.0 + (uneven - 1.0) * smooth_step(-0.4, -2.5, edge_mm)
}

/// Distance from the nearest lug of the tread, mm: zigzags at ball and heel, rings below the ball
/// of the big toe.
fn tread_mm(p: Vec2) -> f32 {
    let pivot = p.distance(vec2(54.0, 88.0));
    if pivot < 24.0 {
        return ((pivot + 2.0).rem_euclid(8.0) - 4.0).abs() - 2.4;
    }
    let zigzag = 7.0 * ((p.x / 24.0).rem_euclid(1.0) - 0.5).abs();
    let bars = ((p.y + 2.0 * zigzag).rem_euclid(11.0) - 5.5).abs() - 3.3;
    let arch = 14.0 - (p.y - 199.0).abs(); // no lugs below the arch
    bars.max(arch).max(26.5 - pivot)
}
