//! Deterministic noise.

use glam::Vec2;

use super::canvas::Canvas;

/// Green is roughness: fine rings from drawing the brass, broken up, and a few stains. `side_px`
/// is a multiple of 32; stains repeat after 256 px.
pub fn roughness(side_px: u32) -> Canvas {
    Canvas::from_fn(side_px, side_px, |x, y| {
        let rings = noise(0, x / 64, y);
        let grain = noise(1, x, y);
        let stains = smooth_noise(x, y);
        let value = 0.62 + 0.14 * rings + 0.06 * grain + 0.30 * (stains - 0.5).max(0.0);
        let green = (value * 255.0).round() as u8 & 0xfc; // four grades of 256: a smaller file
        [0, green, 255]
    })
}

/// 0 to 1 from a hash of integers (Jarzynski & Olano 2020, pcg3d).
pub fn noise(seed: u32, x: u32, y: u32) -> f32 {
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
pub fn smooth_noise(x: u32, y: u32) -> f32 {
    let corner = |dx, dy| noise(2, (x / 32 + dx) % 8, (y / 32 + dy) % 8);
    let ease = |n: u32| {
        let f = (n % 32) as f32 / 32.0;
        f * f * (3.0 - 2.0 * f)
    };
    let (u, v) = (ease(x), ease(y));
    let row = |dy| corner(0, dy) * (1.0 - u) + corner(1, dy) * u;
    row(0) * (1.0 - v) + row(1) * v
}

/// Smooth noise, 0 to 1, of a place in cells, with the hash's seed.
pub fn value_noise(seed: u32, place: Vec2) -> f32 {
    let cell = place.floor();
    let f = place - cell;
    let f = f * f * (3.0 - 2.0 * f);
    let corner = |dx: i32, dy: i32| noise(seed, (cell.x as i32 + dx) as u32, (cell.y as i32 + dy) as u32);
    let row = |dy| corner(0, dy) * (1.0 - f.x) + corner(1, dy) * f.x;
    row(0) * (1.0 - f.y) + row(1) * f.y
}
