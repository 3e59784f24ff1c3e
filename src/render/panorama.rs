//! Panoramas prefiltered for specular light. For diffuse light see render/irradiance.rs.

use std::ops::Range;

use glam::{Mat3, Vec2, Vec3};

use crate::interpolation::bilinear;
use crate::scene::EnvironmentMap;

/// Width of the sharpest level for reflections; each level halves it. The roughest, 32 × 16, is as
/// coarse as the poles allow.
const WIDTH: u32 = 512;
const ROUGHNESS_LEVELS: u32 = 5;
const LOBE_SAMPLES: u32 = 192;

/// Width, height, radiance row by row.
pub type MipLevel = (u32, u32, Vec<Vec3>);

/// The direction through a texel's centre, in the panorama's axes: y is up, −z in the middle.
pub fn direction(x: u32, y: u32, width: u32, height: u32) -> Vec3 {
    direction_at(Vec2::new(x as f32, y as f32) + 0.5, width, height)
}

/// The direction at texel coordinates from the upper left.
pub fn direction_at(place: Vec2, width: u32, height: u32) -> Vec3 {
    let phi = (place.x / width as f32 - 0.5) * std::f32::consts::TAU;
    let theta = place.y / height as f32 * std::f32::consts::PI;
    Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
}

/// Texel coordinates of a direction, from the upper left.
pub fn texel_coordinates(d: Vec3, width: u32, height: u32) -> Vec2 {
    let x = d.x.atan2(-d.z) / std::f32::consts::TAU + 0.5;
    let y = d.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI;
    Vec2::new(x * width as f32, y * height as f32)
}

/// The solid angle of a texel of a row, sr.
pub fn solid_sr(y: u32, width: u32, height: u32) -> f32 {
    let edge = |y: u32| (y as f32 / height as f32 * std::f32::consts::PI).cos();
    (edge(y) - edge(y + 1)) * std::f32::consts::TAU / width as f32
}

/// Bilinear interpolation at a direction.
pub fn at(level: &MipLevel, d: Vec3) -> Vec3 {
    let (width, height, texels) = (level.0 as usize, level.1 as usize, &level.2);
    let Vec2 { x, y } = texel_coordinates(d, level.0, level.1) - 0.5;
    let y = y.clamp(0.0, (height - 1) as f32);
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let (left, top) = ((x.floor() as i64).rem_euclid(width as i64) as usize, y as usize);
    let (right, bottom) = ((left + 1) % width, (top + 1).min(height - 1));
    let texel = |x: usize, y: usize| texels[y * width + x];
    bilinear([texel(left, top), texel(right, top), texel(left, bottom), texel(right, bottom)], [fx, fy])
}

/// The panorama at its own size.
pub fn full_resolution(map: &EnvironmentMap) -> MipLevel {
    of_size(map, map.width, map.height)
}

fn of_size(map: &EnvironmentMap, width: u32, height: u32) -> MipLevel {
    let mut level = resampled((map.width, map.height, &map.rgb), width, height);
    level.2.iter_mut().for_each(|texel| *texel *= map.color);
    level
}

/// Resamples a picture (width, height, row by row). Each texel is the area-weighted mean of the
/// covered texels.
pub fn resampled<T: Copy + Into<Vec3>>(picture: (u32, u32, &[T]), width: u32, height: u32) -> MipLevel {
    let (from_width, from_height, from) = picture;
    let columns: Vec<_> = (0..width).map(|x| covered_cells(x, width, from_width)).collect();
    let mut texels = Vec::with_capacity((width * height) as usize);
    for y in 0..height {
        let (rows, row_shares) = covered_cells(y, height, from_height);
        for (columns, column_shares) in &columns {
            let mut sum = Vec3::ZERO;
            for (row, row_share) in rows.clone().zip(&row_shares) {
                for (column, share) in columns.clone().zip(column_shares) {
                    sum += (row_share * share) * from[row * from_width as usize + column].into();
                }
            }
            texels.push(sum);
        }
    }
    (width, height, texels)
}

/// The cells, of `from` equal ones, that the i-th of `to` covers, and the weight of each.
fn covered_cells(i: u32, to: u32, from: u32) -> (Range<usize>, Vec<f32>) {
    let (i, to, from) = (u64::from(i), u64::from(to), u64::from(from));
    let (start, end) = (i * from, (i + 1) * from);
    let parts = start / to..end.div_ceil(to);
    let shares = parts.clone().map(|p| (end.min((p + 1) * to) - start.max(p * to)) as f32 / from as f32).collect();
    (parts.start as usize..parts.end as usize, shares)
}

/// Levels from sharp to fully rough, each half as wide as the previous: the panorama filtered with
/// a GGX lobe of roughness level/(levels − 1), with the eye along the normal (Karis 2013).
pub fn blurred_levels(map: &EnvironmentMap) -> Vec<MipLevel> {
    let width = WIDTH.min(map.width.max(1 << (ROUGHNESS_LEVELS - 1)));
    let mut sources = vec![of_size(map, width, (width / 2).max(1))];
    while let Some((w, h, texels)) = sources.last().filter(|l| l.1 > 1) {
        sources.push(resampled((*w, *h, texels), w / 2, h / 2));
    }
    let mut levels = vec![sources[0].clone()];
    for level in 1..ROUGHNESS_LEVELS {
        let (w, h) = ((width >> level).max(1), ((width / 2) >> level).max(1));
        let roughness = level as f32 / (ROUGHNESS_LEVELS - 1) as f32;
        let taps = taps(roughness.powi(4), width);
        let texels = (0..w * h).map(|i| filtered_by_lobe(&sources, &taps, direction(i % w, i / w, w, h))).collect();
        levels.push((w, h, texels));
    }
    levels
}

/// One sample of a lobe around z.
struct Tap {
    towards: Vec3,
    /// Source level whose texels cover about the solid angle of one sample (Křivánek and Colbert
    /// 2008). Otherwise a lamp that is hit by one sample in a hundred would leave spots.
    source: usize,
}

fn taps(a2: f32, width: u32) -> Vec<Tap> {
    let texel = 4.0 * std::f32::consts::PI / (width * width / 2) as f32;
    let tap = |i: u32| {
        // Hammersley points.
        let e1 = (i as f32 + 0.5) / LOBE_SAMPLES as f32;
        let e2 = i.reverse_bits() as f32 * 2.0f32.powi(-32);
        let cos2 = (1.0 - e1) / (1.0 + (a2 - 1.0) * e1);
        let (s, c) = (e2 * std::f32::consts::TAU).sin_cos();
        let half = Vec3::new((1.0 - cos2).sqrt() * c, (1.0 - cos2).sqrt() * s, cos2.sqrt());
        // The density of directions is D/4 with the eye along the normal.
        let density = a2 / (4.0 * std::f32::consts::PI * (cos2 * (a2 - 1.0) + 1.0).powi(2));
        let share = 1.0 / (density * LOBE_SAMPLES as f32);
        let source = (0.5 * (share / texel).log2()).round().max(0.0) as usize;
        Tap { towards: 2.0 * half.z * half - Vec3::Z, source }
    };
    (0..LOBE_SAMPLES).map(tap).filter(|tap| tap.towards.z > 0.0).collect()
}

fn filtered_by_lobe(sources: &[MipLevel], taps: &[Tap], normal: Vec3) -> Vec3 {
    let frame = Mat3::from_quat(glam::Quat::from_rotation_arc(Vec3::Z, normal));
    let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
    for tap in taps {
        let source = &sources[tap.source.min(sources.len() - 1)];
        sum += at(source, frame * tap.towards) * tap.towards.z;
        weight += tap.towards.z;
    }
    sum / weight.max(1e-6)
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
            color: Vec3::ONE,
        }
    }

    #[test]
    fn resampling_preserves_total_light() {
        // One bright texel; sizes that do not divide each other.
        for (x, y) in [(0, 0), (37, 20), (99, 49)] {
            let mut texels = vec![Vec3::ZERO; 100 * 50];
            texels[y * 100 + x] = Vec3::ONE;
            for (w, h) in [(64, 32), (100, 50), (7, 3), (256, 128)] {
                let (.., to) = resampled((100, 50, &texels), w, h);
                let sum: f32 = to.iter().map(|t| t.x).sum();
                let expected = (w * h) as f32 / 5000.0;
                assert!((sum / expected - 1.0).abs() < 1e-4, "{x}, {y} to {w}x{h}: {sum}, not {expected}");
            }
        }
    }

    #[test]
    fn prefiltering_preserves_a_white_sky() {
        for (_, _, texels) in blurred_levels(&map(|_| 1.0)) {
            assert!(texels.iter().all(|t| (t.x - 1.0).abs() < 1e-4));
        }
    }

    #[test]
    fn prefiltered_lamp_has_no_spots() {
        // A lamp 8° wide in the middle, on the equator. Isolated samples that hit it would give up
        // to ten times the peak.
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
