//! Blood: a drop that fell straight, spatter, and a pool. Shapes and sizes are our own. Width and
//! length of a stain give the angle of impact: sin(angle) = width / length (Balthazard et al.
//! 1939).

use glam::{Vec2, vec2};

use super::canvas::Canvas;
use super::decal::{Region, coverage, decal, fit, nearest_mm, smooth_step};
use super::glb::Prop;
use super::noise::{noise, value_noise};

const BLOOD: [u8; 3] = [84, 5, 6];
const ROUGHNESS: f32 = 0.28;

/// A round stain of 13 mm with a scalloped edge.
pub fn drop() -> Prop {
    let sheet = Vec2::splat(20.0);
    let stain = Region::around(sheet / 2.0, 256, |angle| {
        let scallops = 0.5 - 0.5 * (16.0 * angle).cos();
        Vec2::splat(6.5 * (1.0 - 0.07 * scallops * scallops))
    });
    stains("blood drop", sheet, 16.0, &[stain])
}

/// A stain of the spatter: its middle, the half of its width and of its length, and the direction
/// of its flight, radians from +x.
struct Stain {
    middle: Vec2,
    half_width: f32,
    half_length: f32,
    angle: f32,
}

/// Stains that flew to +x. Three of the catalogue lie along the axis, with angles of impact of 75°,
/// 45° and 25°.
pub fn spatter() -> Prop {
    let sheet = vec2(240.0, 150.0);
    let measured = [(40.0, 8.0, 75.0f32), (110.0, 6.0, 45.0), (190.0, 5.0, 25.0)].map(|(x, width, impact_deg)| Stain {
        middle: vec2(x, 75.0),
        half_width: width / 2.0,
        half_length: width / 2.0 / impact_deg.to_radians().sin(),
        angle: 0.0,
    });
    let mut regions: Vec<Region> = measured.iter().map(ellipse).collect();
    let mut n = 0;
    while regions.len() < 150 {
        n += 1;
        let random = |k: u32| noise(91, n, k);
        let middle = vec2(8.0 + 224.0 * random(0), 8.0 + 134.0 * random(1));
        let impact = (78.0 - 0.26 * middle.x + 10.0 * (random(2) - 0.5)).to_radians();
        let half_width = 0.35 + 1.9 * random(3).powi(3);
        let from = middle - vec2(-90.0, 75.0);
        let stain = Stain { middle, half_width, half_length: half_width / impact.sin(), angle: from.y.atan2(from.x) };
        // The measured stains stay free, and nothing leaves the sheet.
        let is_free = measured.iter().all(|m| {
            let off = (middle - m.middle).abs();
            off.x > m.half_length + 10.0 || off.y > m.half_width + 6.0
        });
        let fits = (middle - sheet / 2.0).abs().cmplt(sheet / 2.0 - 2.0 - 3.2 * stain.half_length).all();
        if is_free && fits {
            regions.push(ellipse(&stain));
            // A tail at stains that came in flat.
            if impact.sin() < 0.8 && half_width > 0.5 {
                regions.push(tail(&stain));
            }
        }
    }
    stains("blood spatter", sheet, 5.0, &regions)
}

/// A pool of 180 mm by 120 mm with drops beside it.
pub fn pool() -> Prop {
    let sheet = vec2(240.0, 180.0);
    let pool = Region::around(Vec2::ZERO, 240, |angle| {
        let wave = |k: f32, phase: f32| (k * angle + phase).sin();
        Vec2::splat(
            1.0 + 0.10 * wave(2.0, 0.4) + 0.07 * wave(3.0, 2.1) + 0.045 * wave(5.0, 1.0) + 0.02 * wave(9.0, 3.0),
        ) * vec2(1.0, 0.72)
    });
    let mut regions = fit(&[pool], vec2(30.0, 30.0), vec2(180.0, 120.0));
    for (n, [x, y]) in [[37.0, 46.0], [203.0, 38.0], [199.0, 143.0], [40.0, 139.0], [50.0, 37.0]].iter().enumerate() {
        let radius = 1.2 + 2.2 * noise(5, n as u32, 0);
        regions.push(Region::ellipse(vec2(*x, *y), Vec2::splat(radius), 0.0));
    }
    stains("blood pool", sheet, 4.0, &regions)
}

fn ellipse(stain: &Stain) -> Region {
    Region::ellipse(stain.middle, vec2(stain.half_length, stain.half_width), stain.angle)
}

/// A tapering tail, and the small drop at its end.
fn tail(stain: &Stain) -> Region {
    let (length, width) = (stain.half_length, stain.half_width);
    let axis = Vec2::from_angle(stain.angle);
    let points = [[0.3, 0.75], [1.0, 0.25], [1.7, 0.1], [2.0, 0.22], [2.2, 0.0]];
    let side = |sign: f32| points.map(|[x, y]| stain.middle + axis * (x * length) + axis.perp() * (sign * y * width));
    let mut corners = side(1.0).to_vec();
    corners.extend(side(-1.0).into_iter().rev().skip(1));
    Region::new(corners)
}

/// Thinner in the middle than at the rim, where it dries first.
fn stains(name: &'static str, sheet: Vec2, px_per_mm: f32, regions: &[Region]) -> Prop {
    let picture = Canvas::mask(sheet, px_per_mm, BLOOD, |p| {
        let edge = nearest_mm(regions, p);
        if edge > 1.0 {
            return 0.0;
        }
        let thickness = 0.93 - 0.1 * smooth_step(-0.6, -2.0, edge) * (0.6 + 0.4 * value_noise(3, p / 9.0));
        coverage(edge, px_per_mm) * thickness
    });
    decal(name, sheet, picture, ROUGHNESS)
}
