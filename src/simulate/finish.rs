//! Procedural surface reflectance by position on a face, in metres.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::random::mix;

/// Material of a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// Plank floor, plastered walls, white ceiling, depending on the room's face.
    Room,
    /// Plain concrete on every face.
    Concrete,
    /// White laminate on the floor's face, plaster on the others.
    Desk,
    /// Black glass and plastic with a weak return for a depth sensor.
    Screen,
    /// Rows of grey keys in a light frame.
    Keyboard,
    Paint,
    Cardboard,
    Carpet,
    Walnut,
    Plastic,
    Rubber,
    Paper,
    Socket,
}

/// Diffuse reflectance (linear R, G, B, 0..1) and gloss at one point; gloss is a factor on the
/// finish's.
#[derive(Clone, Copy, Debug)]
pub struct Reflectance {
    pub albedo: DVec3,
    pub gloss: f64,
}

/// Specular parameters of a finish: reflectance at normal incidence, and the width in metres of the
/// lamp's blurred image in the plane of the ceiling.
pub fn gloss(finish: Finish) -> (f64, f64) {
    match finish {
        Finish::Room => (0.035, 0.55),
        Finish::Walnut => (0.03, 0.5),
        Finish::Plastic => (0.05, 0.25),
        Finish::Rubber => (0.03, 0.6),
        Finish::Paint | Finish::Socket => (0.03, 0.7),
        Finish::Cardboard => (0.012, 0.9),
        Finish::Desk | Finish::Screen => (0.02, 0.5),
        Finish::Carpet | Finish::Paper | Finish::Concrete | Finish::Keyboard => (0.0, 1.0),
    }
}

fn hash(x: i64, y: i64, seed: u64) -> f64 {
    let key = mix((x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).rotate_left(32) ^ mix(seed));
    (key >> 11) as f64 / (1u64 << 53) as f64
}

fn smooth(edge0: f64, edge1: f64, x: f64) -> f64 {
    let t = ((x - edge0) / (edge1 - edge0)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Value noise in [0, 1), one cell per unit.
fn noise(p: DVec2, seed: u64) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let f = f * f * (3.0 - 2.0 * f);
    let (x, y) = (cell.x as i64, cell.y as i64);
    let low = hash(x, y, seed) * (1.0 - f.x) + hash(x + 1, y, seed) * f.x;
    let high = hash(x, y + 1, seed) * (1.0 - f.x) + hash(x + 1, y + 1, seed) * f.x;
    low * (1.0 - f.y) + high * f.y
}

/// Octaves of [`noise`], each twice as fine and half as strong; in [0, 1), mean near 0.5.
pub fn fractal(p: DVec2, octaves: u32, seed: u64) -> f64 {
    let (mut sum, mut weight, mut total, mut at) = (0.0, 1.0, 0.0, p);
    for octave in 0..octaves {
        sum += weight * noise(at, seed + u64::from(octave));
        total += weight;
        weight *= 0.5;
        at = at * 2.0 + 17.3;
    }
    sum / total
}

fn wood(q: DVec2, light: DVec3, dark: DVec3) -> DVec3 {
    let warp = fractal(q * DVec2::new(1.1, 6.0), 3, 11);
    let rings = 0.5 + 0.5 * (TAU * (q.y * 20.0 + 4.5 * warp)).sin();
    let grain = fractal(q * DVec2::new(5.0, 150.0), 3, 21);
    let fibre = noise(q * DVec2::new(22.0, 340.0), 31);
    let darkness = 0.4 * rings * rings + 0.45 * grain + 0.3 * smooth(0.6, 0.95, fibre);
    light.lerp(dark, darkness.clamp(0.0, 1.0))
}

/// Oak planks 14 cm wide and 1.1 m long, along x, with a dried stain. `p` is relative to the room's
/// corner.
fn floor(p: DVec2, size: DVec2) -> Reflectance {
    const WIDTH: f64 = 0.14;
    const LENGTH: f64 = 1.1;
    let row = (p.y / WIDTH).floor();
    let along = p.x + LENGTH * hash(row as i64, 0, 41);
    let column = (along / LENGTH).floor();
    let plank = |seed| hash(row as i64, column as i64, seed);
    let q = DVec2::new(p.x + 13.0 * plank(42), p.y + 7.0 * plank(43));
    let tone = 0.78 + 0.4 * plank(44);
    let hue = DVec3::new(1.0, 0.96 + 0.08 * plank(45), 0.9 + 0.2 * plank(46));
    let oak = wood(q, DVec3::new(0.46, 0.29, 0.155), DVec3::new(0.2, 0.105, 0.045)) * tone * hue;
    let across = p.y - row * WIDTH;
    let lengthwise = along - column * LENGTH;
    let to_gap = across.min(WIDTH - across).min(lengthwise).min(LENGTH - lengthwise);
    let gap = 1.0 - smooth(0.0008, 0.0028, to_gap);
    let worn = fractal(p * 2.3, 4, 47);
    let scratch = smooth(0.93, 0.99, noise(DVec2::new(p.x * 3.0 + p.y * 9.0, p.y * 120.0 - p.x * 60.0), 48));
    let mut albedo = oak * (0.86 + 0.28 * worn) * (1.0 - 0.8 * gap) + DVec3::splat(0.05 * scratch);

    // A pool with a ragged edge in front of the boxes, and drops around it: one per cell of 3 cm.
    let from_stain = p - DVec2::new(0.62, size.y - 0.42);
    let ragged = 0.1 * fractal(from_stain * 14.0, 3, 51) + 0.05 * fractal(from_stain * 45.0, 2, 52);
    let pool = 1.0 - smooth(0.1, 0.112, from_stain.length() + ragged);
    let cell = (p * 30.0).floor();
    let drop = |seed| hash(cell.x as i64, cell.y as i64, seed);
    let drop_at = (cell + DVec2::new(drop(53), drop(54))) / 30.0;
    let drop_radius = 0.008 * drop(55).powi(3) * (1.0 - smooth(0.1, 0.32, from_stain.length()));
    let splash =
        if drop_radius > 0.0008 { 1.0 - smooth(-0.001, 0.001, (p - drop_at).length() - drop_radius) } else { 0.0 };
    albedo = albedo.lerp(DVec3::new(0.075, 0.014, 0.01), 0.88 * pool.max(splash));
    Reflectance { albedo, gloss: (1.0 - gap) * (0.35 + 0.75 * worn) * (1.0 + 0.6 * pool) }
}

/// Blotches, trowel marks and sand. A picture at a few millimetres per pixel has a standard
/// deviation of 3 codes.
fn concrete(p: DVec2) -> Reflectance {
    let blotch = fractal(p * 6.0, 3, 131) - 0.5;
    let trowel = fractal(p * 40.0, 3, 132) - 0.5;
    let sand = noise(p * 190.0, 133) - 0.5;
    let shade = 1.0 + 0.18 * blotch + 0.215 * trowel + 0.08 * sand;
    Reflectance { albedo: DVec3::new(0.36, 0.355, 0.34) * shade, gloss: 0.0 }
}

/// Nearly white, with a faint grain along x and ring stains of cups.
fn laminate(p: DVec2) -> Reflectance {
    let grain = fractal(p * DVec2::new(9.0, 120.0), 3, 143) - 0.5;
    let cell = (p / 0.4).floor();
    let ring_at = (cell + 0.5) * 0.4 + 0.1 * (hash(cell.x as i64, cell.y as i64, 144) - 0.5);
    let ring = 1.0 - smooth(0.0015, 0.003, ((p - ring_at).length() - 0.038).abs());
    Reflectance { albedo: DVec3::new(0.80, 0.79, 0.77) * (1.0 + 0.05 * grain - 0.12 * ring), gloss: 1.0 }
}

fn keyboard(face: usize, p: DVec2, size: DVec2) -> Reflectance {
    const KEY_M: f64 = 0.019;
    let from_rim = p.min(size - p).min_element();
    let in_key = (p / KEY_M).fract_gl() * KEY_M;
    let is_key = face == 5 && from_rim > 0.012 && in_key.min_element() > 0.002 && in_key.max_element() < 0.017;
    Reflectance { albedo: if is_key { DVec3::new(0.2, 0.2, 0.21) } else { DVec3::new(0.55, 0.54, 0.51) }, gloss: 0.0 }
}

fn plaster(p: DVec2) -> Reflectance {
    let blotch = fractal(p * 1.7, 4, 61);
    let roller = fractal(p * 55.0, 3, 62);
    let pits = smooth(0.8, 0.97, noise(p * 140.0, 63));
    let scuff = smooth(0.55, 0.85, fractal(p * DVec2::new(6.0, 14.0), 4, 64)) * (1.0 - smooth(0.1, 0.9, p.y));
    let shade = 0.87 + 0.12 * blotch + 0.16 * (roller - 0.5) - 0.12 * pits - 0.12 * scuff;
    Reflectance { albedo: DVec3::new(0.66, 0.655, 0.60) * shade, gloss: 0.0 }
}

fn cardboard(face: usize, p: DVec2, size: DVec2) -> Reflectance {
    let flutes = 0.5 + 0.5 * (TAU * p.x * 140.0).sin();
    let pulp = fractal(p * DVec2::new(90.0, 40.0), 3, 71);
    let mut albedo = DVec3::new(0.47, 0.315, 0.185) * (0.84 + 0.05 * flutes + 0.22 * pulp);
    let mut gloss = 0.5;
    let c = p - 0.5 * size;
    if face == 5 {
        if c.y.abs() < 0.0015 {
            albedo *= 0.35;
        }
        if c.y.abs() < 0.026 {
            albedo = albedo * 0.45 + DVec3::new(0.32, 0.23, 0.12) * 0.6;
            gloss = 3.0;
        }
    } else {
        // Two arrows pointing up over a bar, the sign for "this way up".
        let a = DVec2::new(c.x.abs() - 0.028, c.y);
        let shaft = a.x.abs() < 0.006 && a.y > -0.03 && a.y < 0.018;
        let head = a.y >= 0.012 && a.y < 0.038 && a.x.abs() < 0.9 * (0.038 - a.y);
        let bar = c.x.abs() < 0.06 && (a.y + 0.042).abs() < 0.004;
        if shaft || head || bar {
            albedo = albedo * 0.25 + DVec3::new(0.012, 0.012, 0.02);
        }
        if p.y < 0.02 || p.y > size.y - 0.006 {
            albedo *= 0.86;
        }
    }
    Reflectance { albedo, gloss }
}

fn carpet(p: DVec2, size: DVec2) -> Reflectance {
    let edge = p.min(size - p).min_element();
    let knots = noise(p * 260.0, 81) - 0.5;
    let pile = fractal(p * 30.0, 3, 82) - 0.5;
    let lattice = DVec2::new((PI * (p.x + p.y) / 0.11).sin().abs(), (PI * (p.x - p.y) / 0.11).sin().abs());
    let base = if edge < 0.012 || (edge > 0.045 && edge < 0.06) {
        DVec3::new(0.50, 0.43, 0.31)
    } else if edge < 0.045 {
        DVec3::new(0.045, 0.06, 0.13)
    } else if lattice.min_element() < 0.16 {
        DVec3::new(0.42, 0.31, 0.16)
    } else if lattice.min_element() > 0.86 {
        DVec3::new(0.05, 0.07, 0.15)
    } else {
        DVec3::new(0.24, 0.035, 0.035)
    };
    Reflectance { albedo: base * (1.0 + 0.9 * knots + 0.45 * pile), gloss: 0.0 }
}

fn ball(uv: DVec2) -> Reflectance {
    let ((s, c), (sv, cv)) = ((TAU * uv.x).sin_cos(), (PI * uv.y).sin_cos());
    // Rotated so that the seams are not vertical.
    let n = DVec3::new(sv * c, 0.8 * sv * s - 0.6 * cv, 0.6 * sv * s + 0.8 * cv);
    let curved = (n.x.abs() - 0.55 - 0.3 * n.z * n.z).abs();
    let seam = 1.0 - smooth(0.02, 0.035, n.z.abs().min(n.y.abs()).min(curved));
    let pebbles = noise(uv * DVec2::new(260.0, 130.0), 91);
    let worn = fractal(uv * DVec2::new(12.0, 6.0), 3, 92);
    let orange = DVec3::new(0.5, 0.15, 0.04) * (0.72 + 0.24 * pebbles + 0.25 * worn);
    Reflectance { albedo: orange.lerp(DVec3::splat(0.02), seam), gloss: 1.0 - 0.7 * seam }
}

/// Reflectance at `uv` of a face's chart, which is `size` metres large.
pub fn reflectance(finish: Finish, face: usize, uv: DVec2, size: DVec2) -> Reflectance {
    let p = uv * size;
    match finish {
        Finish::Room if face == 4 => floor(p, size),
        Finish::Room if face == 5 => Reflectance { albedo: DVec3::splat(0.8), gloss: 0.0 },
        Finish::Room => plaster(p),
        Finish::Concrete => concrete(p),
        Finish::Desk if face == 4 => laminate(p),
        Finish::Desk => plaster(p),
        Finish::Screen => {
            Reflectance { albedo: DVec3::splat(0.009) * (0.9 + 0.2 * fractal(p * 20.0, 2, 141)), gloss: 1.0 }
        }
        Finish::Keyboard => keyboard(face, p, size),
        Finish::Paint => {
            let dirt = fractal(p * DVec2::new(4.0, 30.0), 3, 101) * (1.0 - smooth(0.0, 0.05, p.y));
            let groove = if face < 4 && (p.y - size.y + 0.016).abs() < 0.0022 { 0.55 } else { 1.0 };
            let brush = noise(p * DVec2::new(9.0, 300.0), 102);
            Reflectance {
                albedo: DVec3::new(0.72, 0.71, 0.67) * groove * (0.97 + 0.05 * brush - 0.3 * dirt),
                gloss: groove,
            }
        }
        Finish::Cardboard => cardboard(face, p, size),
        Finish::Carpet => carpet(p, size),
        Finish::Walnut => {
            let q = if size.x > size.y { p } else { DVec2::new(p.y, p.x) };
            let grain = wood(q + face as f64 * 3.7, DVec3::new(0.2, 0.105, 0.05), DVec3::new(0.055, 0.026, 0.013));
            Reflectance { albedo: grain * 1.15, gloss: 1.0 }
        }
        Finish::Plastic => {
            let rib = if (uv.y - 0.84).abs() < 0.012 || uv.y > 0.965 { 0.7 } else { 1.0 };
            let scratches = fractal(p * DVec2::new(8.0, 160.0), 3, 111);
            let dust = fractal(p * 9.0, 4, 112) * (1.0 - smooth(0.0, 0.35, uv.y));
            let blue = DVec3::new(0.02, 0.105, 0.33) * rib * (0.8 + 0.35 * scratches);
            Reflectance { albedo: blue + 0.09 * dust, gloss: 1.0 - 0.5 * dust }
        }
        Finish::Rubber => ball(uv),
        Finish::Paper => {
            let line = (p.y / 0.0085).fract();
            let text = line > 0.35
                && line < 0.72
                && p.x > 0.022
                && p.x < size.x - 0.022 - 0.05 * hash((p.y / 0.0085) as i64, 1, 121)
                && p.y > 0.03
                && p.y < size.y - 0.06;
            let letters = noise(p * DVec2::new(420.0, 120.0), 122);
            let title = p.y > size.y - 0.046 && p.y < size.y - 0.034 && p.x > 0.022 && p.x < 0.11;
            let ink = if title {
                0.9
            } else if text {
                smooth(0.3, 0.6, letters) * 0.75
            } else {
                0.0
            };
            Reflectance {
                albedo: DVec3::new(0.79, 0.785, 0.76) * (0.96 + 0.05 * fractal(p * 20.0, 3, 123)) * (1.0 - ink),
                gloss: 0.0,
            }
        }
        Finish::Socket => {
            let c = p - 0.5 * size;
            let hole = DVec2::new(c.x.abs() - 0.0095, c.y).length() < 0.003;
            let well = (c.length() - 0.0215).abs() < 0.0012;
            let shade = if hole {
                0.05
            } else if well {
                0.6
            } else if c.length() < 0.0215 {
                0.86
            } else {
                1.0
            };
            Reflectance { albedo: DVec3::new(0.76, 0.755, 0.72) * shade, gloss: shade }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concrete_contrast_is_three_codes() {
        // Pixels of 4 mm, each the mean of 16 places, as a code of the response 1/2.2.
        let pixel = |x: u32, y: u32| {
            let place = |i: u32| 1e-3 * DVec2::new(f64::from(4 * x + i % 4), f64::from(4 * y + i / 4));
            let albedo = (0..16).map(|i| concrete(place(i)).albedo.y).sum::<f64>() / 16.0;
            255.0 * albedo.powf(1.0 / 2.2)
        };
        let codes: Vec<f64> = (0..200 * 200).map(|i| pixel(i % 200, i / 200)).collect();
        let mean = codes.iter().sum::<f64>() / codes.len() as f64;
        let sigma = (codes.iter().map(|code| (code - mean).powi(2)).sum::<f64>() / codes.len() as f64).sqrt();
        assert!((2.5..3.5).contains(&sigma), "{sigma}");
    }
}
