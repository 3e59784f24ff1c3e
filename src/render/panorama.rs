//! A panorama as the shader wants it: blurred for shine, as harmonics for matt surfaces.

use glam::{Mat3, Vec3};

use crate::scene::EnvironmentMap;

/// Width of the sharpest panorama for reflections; each level has half of it. The roughest, 32 × 16, is as coarse as
/// its poles can bear.
const WIDTH: u32 = 512;
const LEVELS: u32 = 5;
const LOBE_SAMPLES: u32 = 192;

/// Width, height, radiance row by row.
pub type Level = (u32, u32, Vec<Vec3>);

/// The direction, in the panorama's axes, through the middle of a texel: y up, −z in the middle.
fn direction(x: u32, y: u32, width: u32, height: u32) -> Vec3 {
    let phi = ((x as f32 + 0.5) / width as f32 - 0.5) * std::f32::consts::TAU;
    let theta = (y as f32 + 0.5) / height as f32 * std::f32::consts::PI;
    Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
}

/// Between the four texels around a direction.
pub fn at(level: &Level, d: Vec3) -> Vec3 {
    let (width, height, texels) = (level.0 as usize, level.1 as usize, &level.2);
    let x = (d.x.atan2(-d.z) / std::f32::consts::TAU + 0.5) * width as f32 - 0.5;
    let y = (d.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI * height as f32 - 0.5).clamp(0.0, (height - 1) as f32);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let (left, top) = ((x.floor() as i64).rem_euclid(width as i64) as usize, y as usize);
    let (right, bottom) = ((left + 1) % width, (top + 1).min(height - 1));
    let row = |y: usize| texels[y * width + left].lerp(texels[y * width + right], fx);
    row(top).lerp(row(bottom), fy)
}

/// The panorama at its own size.
pub fn sharp(map: &EnvironmentMap) -> Level {
    resampled(map, map.width, map.height)
}

/// The panorama at a given size, each texel the mean of those it covers.
fn resampled(map: &EnvironmentMap, width: u32, height: u32) -> Level {
    let mut texels = vec![Vec3::ZERO; (width * height) as usize];
    for y in 0..height {
        let rows = y * map.height / height..((y + 1) * map.height).div_ceil(height).min(map.height);
        for x in 0..width {
            let columns = x * map.width / width..((x + 1) * map.width).div_ceil(width).min(map.width);
            let mut sum = Vec3::ZERO;
            for row in rows.clone() {
                for column in columns.clone() {
                    sum += Vec3::from(map.rgb[(row * map.width + column) as usize]);
                }
            }
            texels[(y * width + x) as usize] = sum * (map.intensity / (rows.len() * columns.len()).max(1) as f32);
        }
    }
    (width, height, texels)
}

/// Levels from sharp to fully rough, each half as wide as the one before: the panorama seen in a GGX lobe of
/// roughness level/(levels − 1), with the eye along the normal (Karis 2013).
pub fn blurred_levels(map: &EnvironmentMap) -> Vec<Level> {
    let width = WIDTH.min(map.width.max(1 << (LEVELS - 1)));
    let mut sources = vec![resampled(map, width, (width / 2).max(1))];
    while let Some(&(w, h, _)) = sources.last().filter(|l| l.1 > 1) {
        sources.push(resampled(map, w / 2, h / 2));
    }
    let mut levels = vec![sources[0].clone()];
    for level in 1..LEVELS {
        let (w, h) = ((width >> level).max(1), ((width / 2) >> level).max(1));
        let roughness = level as f32 / (LEVELS - 1) as f32;
        let taps = taps(roughness.powi(4), width);
        let texels = (0..w * h).map(|i| seen_in_lobe(&sources, &taps, direction(i % w, i / w, w, h))).collect();
        levels.push((w, h, texels));
    }
    levels
}

/// One sample of a lobe around z.
struct Tap {
    towards: Vec3,
    /// Where on average as much of the panorama lies in a texel as one sample stands for (Křivánek and Colbert 2008):
    /// a lamp that hits one sample in a hundred would leave spots.
    source: usize,
}

fn taps(a2: f32, width: u32) -> Vec<Tap> {
    let texel = 4.0 * std::f32::consts::PI / (width * width / 2) as f32;
    let tap = |i: u32| {
        // Hammersley's points.
        let e1 = (i as f32 + 0.5) / LOBE_SAMPLES as f32;
        let e2 = i.reverse_bits() as f32 * 2.0f32.powi(-32);
        let cos2 = (1.0 - e1) / (1.0 + (a2 - 1.0) * e1);
        let (s, c) = (e2 * std::f32::consts::TAU).sin_cos();
        let half = Vec3::new((1.0 - cos2).sqrt() * c, (1.0 - cos2).sqrt() * s, cos2.sqrt());
        // The density of directions is D/4 where the eye is along the normal.
        let density = a2 / (4.0 * std::f32::consts::PI * (cos2 * (a2 - 1.0) + 1.0).powi(2));
        let share = 1.0 / (density * LOBE_SAMPLES as f32);
        let source = (0.5 * (share / texel).log2() + 0.0).round().max(0.0) as usize;
        Tap { towards: 2.0 * half.z * half - Vec3::Z, source }
    };
    (0..LOBE_SAMPLES).map(tap).filter(|tap| tap.towards.z > 0.0).collect()
}

fn seen_in_lobe(sources: &[Level], taps: &[Tap], normal: Vec3) -> Vec3 {
    let frame = Mat3::from_quat(glam::Quat::from_rotation_arc(Vec3::Z, normal));
    let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
    for tap in taps {
        let source = &sources[tap.source.min(sources.len() - 1)];
        sum += at(source, frame * tap.towards) * tap.towards.z;
        weight += tap.towards.z;
    }
    sum / weight.max(1e-6)
}

/// Irradiance over π as second-order harmonics in world axes, for the polynomial of the
/// shader: Ramamoorthi and Hanrahan 2001, with the cosine's factors (1, 2/3, 1/4) times the
/// basis' squared constants.
pub fn harmonics(map: &EnvironmentMap, world_from_map: Mat3) -> [Vec3; 9] {
    let (w, h, texels) = resampled(map, 128.min(map.width.max(1)), 64.min(map.height.max(1)));
    let mut sums = [Vec3::ZERO; 9];
    let mut solid = 0.0;
    for y in 0..h {
        let theta = (y as f32 + 0.5) / h as f32 * std::f32::consts::PI;
        let area = theta.sin();
        for x in 0..w {
            let d = world_from_map * direction(x, y, w, h);
            let basis =
                [1.0, d.y, d.z, d.x, d.x * d.y, d.y * d.z, 3.0 * d.z * d.z - 1.0, d.x * d.z, d.x * d.x - d.y * d.y];
            let light = texels[(y * w + x) as usize] * area;
            (0..9).for_each(|i| sums[i] += light * basis[i]);
            solid += area;
        }
    }
    // k² · 4π for Y00, Y1m, Y2m: 1, 3, 15, 5/4 and 15/4; times 1, 2/3, 1/4.
    let factors = [1.0, 2.0, 2.0, 2.0, 3.75, 3.75, 0.3125, 3.75, 0.9375];
    std::array::from_fn(|i| sums[i] * (factors[i] / solid))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(light: impl Fn(Vec3) -> f32) -> EnvironmentMap {
        let (width, height) = (128, 64);
        let rgb = (0..width * height).map(|i| [light(direction(i % width, i / width, width, height)); 3]).collect();
        EnvironmentMap {
            width,
            height,
            rgb: std::sync::Arc::new(rgb),
            map_from_world: glam::Quat::IDENTITY,
            intensity: 1.0,
        }
    }

    fn irradiance(l: &[Vec3; 9], n: Vec3) -> f32 {
        (l[0]
            + l[1] * n.y
            + l[2] * n.z
            + l[3] * n.x
            + l[4] * (n.x * n.y)
            + l[5] * (n.y * n.z)
            + l[6] * (3.0 * n.z * n.z - 1.0)
            + l[7] * (n.x * n.z)
            + l[8] * (n.x * n.x - n.y * n.y))
            .x
    }

    #[test]
    fn a_white_sky_lights_white() {
        let l = harmonics(&map(|_| 1.0), Mat3::IDENTITY);
        assert!((irradiance(&l, Vec3::Y) - 1.0).abs() < 1e-3);
        assert!((irradiance(&l, Vec3::new(0.6, 0.0, 0.8)) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_clamped_cosine_by_quadrature() {
        // Radiance max(0, y). For a surface that looks up irradiance over π is
        // (1/π) ∫ cos² over the half sphere = 2/3; for the others the sum below.
        let m = map(|d| d.y.max(0.0));
        let l = harmonics(&m, Mat3::IDENTITY);
        for n in [Vec3::Y, Vec3::X, -Vec3::Y, Vec3::new(0.6, 0.8, 0.0)] {
            let (mut sum, mut area) = (0.0, 0.0);
            for y in 0..64 {
                for x in 0..128 {
                    let d = direction(x, y, 128, 64);
                    let a = (1.0 - d.y * d.y).sqrt();
                    sum += d.y.max(0.0) * d.dot(n).max(0.0) * a;
                    area += a;
                }
            }
            let truth = 4.0 * sum / area;
            // Second order leaves at most 3 % of the peak for such light (Ramamoorthi 2001).
            assert!((irradiance(&l, n) - truth).abs() < 0.03, "{n}: {} {truth}", irradiance(&l, n));
        }
    }

    #[test]
    fn blurred_panoramas_keep_a_white_sky_white() {
        for (_, _, texels) in blurred_levels(&map(|_| 1.0)) {
            assert!(texels.iter().all(|t| (t.x - 1.0).abs() < 1e-4));
        }
    }

    #[test]
    fn a_lamp_is_blurred_without_spots() {
        // A lamp 8° wide in the middle, on the equator. Hits of single samples would be up to ten times the peak.
        let lamp = Vec3::NEG_Z;
        let source = map(|d| if d.angle_between(lamp) < 4f32.to_radians() { 100.0 } else { 0.0 });
        let levels = blurred_levels(&source);
        for (level, roughness) in [(2, 0.5f32), (3, 0.75), (4, 1.0)] {
            let (w, h, texels) = &levels[level];
            let lobe = |normal: Vec3| {
                let a2 = roughness.powi(4);
                let (mut sum, mut weight) = (0.0, 0.0);
                for (i, texel) in source.rgb.iter().enumerate() {
                    let d = direction(i as u32 % 128, i as u32 / 128, 128, 64);
                    let (n_l, n_h) = (normal.dot(d), normal.dot((normal + d).normalize()));
                    let area = (1.0 - d.y * d.y).sqrt();
                    let density = area * n_l.max(0.0) / (n_h * n_h * (a2 - 1.0) + 1.0).powi(2);
                    sum += density * texel[0];
                    weight += density;
                }
                sum / weight
            };
            let peak = lobe(lamp);
            for (i, texel) in texels.iter().enumerate() {
                let truth = lobe(direction(i as u32 % w, i as u32 / w, *w, *h));
                assert!(
                    (texel.x - truth).abs() < 0.12 * peak,
                    "roughness {roughness}, texel {i}: {texel} {truth} {peak}"
                );
            }
        }
    }
}
