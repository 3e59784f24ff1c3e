//! Diffuse lighting by a panorama: an irradiance map by surface normal.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, Vec3A};

use super::panorama::{MipLevel, direction, resampled, solid_sr};

/// A lamp's irradiance has a kink at the terminator: interpolation between texels has an error
/// there of up to a quarter of their distance, 1.2 % of a surface facing the lamp. Columns wrap
/// around. The first and the last row lie on the poles, since most surfaces face straight up.
const WIDTH: u32 = 128;
const HEIGHT: u32 = WIDTH / 2 + 1;
/// The panorama is summed in patches; texels per side of a patch.
const PATCHES_ACROSS: u32 = 64;
const PATCH_TEXELS: u32 = 4;

/// A patch of the panorama.
#[derive(Clone, Copy, Default)]
struct PanoramaPatch {
    /// Radiance times solid angle (sr).
    light: Vec3,
    /// Mean direction, weighted by solid angle; not normalised. n · middle is thus exact for a
    /// surface facing the whole patch.
    middle: Vec3,
    /// Mean direction, also weighted by radiance: a lamp is smaller than a patch.
    light_middle: Vec3,
    solid_sr: f32,
}

fn patches(panorama: &MipLevel) -> Vec<PanoramaPatch> {
    let (width, height) = (PATCHES_ACROSS * PATCH_TEXELS, PATCHES_ACROSS / 2 * PATCH_TEXELS);
    let (.., texels) = resampled((panorama.0, panorama.1, &panorama.2), width, height);
    let mut patches = vec![PanoramaPatch::default(); (PATCHES_ACROSS * PATCHES_ACROSS / 2) as usize];
    let mut brightness = vec![0.0; patches.len()];
    for (i, &texel) in (0..).zip(&texels) {
        let (x, y) = (i % width, i / width);
        let towards = direction(x, y, width, height);
        let solid_sr = solid_sr(y, width, height);
        let at = (y / PATCH_TEXELS * PATCHES_ACROSS + x / PATCH_TEXELS) as usize;
        let patch = &mut patches[at];
        patch.light += texel * solid_sr;
        patch.middle += towards * solid_sr;
        patch.light_middle += towards * (texel.element_sum() * solid_sr);
        patch.solid_sr += solid_sr;
        brightness[at] += texel.element_sum() * solid_sr;
    }
    for (patch, brightness) in patches.iter_mut().zip(brightness) {
        patch.middle /= patch.solid_sr;
        patch.light_middle = if brightness > 0.0 { patch.light_middle / brightness } else { patch.middle };
    }
    patches
}

/// Irradiance over π by surface normal, in the panorama's axes: the radiance of a white diffuse
/// surface. It is the cosine-weighted mean of the radiance, so a uniform panorama is reproduced.
pub fn irradiance_over_pi(panorama: &MipLevel) -> MipLevel {
    let patches = patches(panorama);
    let lights: Vec<_> = patches.iter().map(|p| (Vec3A::from(p.light), Vec3A::from(p.light_middle))).collect();
    let mut texels = Vec::with_capacity((WIDTH * HEIGHT) as usize);
    for y in 0..HEIGHT {
        let (sin, cos) = (y as f32 / (HEIGHT - 1) as f32 * PI).sin_cos();
        let facing = |x: u32| {
            let (sin_phi, cos_phi) = (((x as f32 + 0.5) / WIDTH as f32 - 0.5) * TAU).sin_cos();
            Vec3::new(sin * sin_phi, cos, -sin * cos_phi)
        };
        // π, apart from the patches' size. By symmetry all columns have the same patches, rotated
        // or mirrored.
        let whole: f32 = patches.iter().map(|patch| patch.solid_sr * patch.middle.dot(facing(0)).max(0.0)).sum();
        texels.extend((0..WIDTH).map(|x| {
            let normal = Vec3A::from(facing(x));
            let sum = |sum: Vec3A, &(light, middle): &(Vec3A, Vec3A)| sum + light * middle.dot(normal).max(0.0);
            Vec3::from(lights.iter().fold(Vec3A::ZERO, sum)) / whole
        }));
    }
    (WIDTH, HEIGHT, texels)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lookup as in the shader.
    fn filtered_radiance(level: &MipLevel, n: Vec3) -> Vec3 {
        let (width, height) = (level.0 as usize, level.1 as usize);
        let x = (n.x.atan2(-n.z) / TAU + 0.5) * width as f32 - 0.5;
        let y = n.y.clamp(-1.0, 1.0).acos() / PI * (height - 1) as f32;
        let (left, top) = ((x.floor() as i64).rem_euclid(width as i64) as usize, (y as usize).min(height - 2));
        let row = |y: usize| level.2[y * width + left].lerp(level.2[y * width + (left + 1) % width], x - x.floor());
        row(top).lerp(row(top + 1), y - top as f32)
    }

    fn panorama(width: u32, height: u32, light: impl Fn(Vec3) -> Vec3) -> MipLevel {
        let texels = (0..width * height).map(|i| light(direction(i % width, i / width, width, height))).collect();
        (width, height, texels)
    }

    /// The integral, texel by texel.
    fn truth(panorama: &MipLevel, n: Vec3) -> Vec3 {
        let (width, height, texels) = panorama;
        let (mut sum, mut whole) = (Vec3::ZERO, 0.0);
        for (i, &texel) in (0..).zip(texels) {
            let d = direction(i % width, i / width, *width, *height);
            let weight = d.dot(n).max(0.0) * (1.0 - d.y * d.y).sqrt();
            sum += texel * weight;
            whole += weight;
        }
        sum / whole
    }

    /// Uniform over the sphere, and along the axes.
    fn normals() -> impl Iterator<Item = Vec3> {
        let spiral = (0..300).map(|i| {
            let y = 1.0 - (2.0 * i as f32 + 1.0) / 300.0;
            let (s, c) = (i as f32 * 2.399_963_2).sin_cos();
            Vec3::new((1.0 - y * y).sqrt() * c, y, (1.0 - y * y).sqrt() * s)
        });
        spiral.chain(Vec3::AXES.into_iter().flat_map(|a| [a, -a]))
    }

    /// The largest deviation from the integral, relative to the larger of the integral and
    /// `min_radiance`.
    fn worst(panorama: &MipLevel, min_radiance: f32) -> f32 {
        let level = irradiance_over_pi(panorama);
        let relative_error = |n| {
            let truth = truth(panorama, n);
            ((filtered_radiance(&level, n) - truth).abs() / truth.max(Vec3::splat(min_radiance))).max_element()
        };
        normals().map(relative_error).fold(0.0, f32::max)
    }

    #[test]
    fn uniform_panorama_gives_uniform_irradiance() {
        for (width, height) in [(1, 1), (2, 1), (100, 50), (256, 128)] {
            let (.., texels) = irradiance_over_pi(&panorama(width, height, |_| Vec3::new(0.5, 1.0, 2.0)));
            assert!(texels.iter().all(|t| (*t / Vec3::new(0.5, 1.0, 2.0) - 1.0).abs().max_element() < 1e-5));
        }
    }

    #[test]
    fn cosine_panorama_matches_the_analytic_irradiance() {
        // Radiance max(0, y). Facing up: (1/π) ∫ cos² over the hemisphere = 2/3. Facing sideways
        // half of it is visible: (1/π) ∫ y·x = 2/(3π). Facing down: nothing.
        let level = irradiance_over_pi(&panorama(256, 128, |d| Vec3::splat(d.y.max(0.0))));
        for (n, expected) in [(Vec3::Y, 2.0 / 3.0), (Vec3::X, 2.0 / (3.0 * PI)), (Vec3::NEG_Y, 0.0)] {
            assert!(
                (filtered_radiance(&level, n).x - expected).abs() < 1e-3,
                "{n}: {} {expected}",
                filtered_radiance(&level, n)
            );
        }
    }

    #[test]
    fn small_lamp_irradiance_matches_the_integral() {
        for towards in [Vec3::Y, Vec3::new(0.3, 0.9, 0.2), Vec3::new(0.7, -0.1, -0.6), Vec3::new(-0.02, 0.3, 1.0)] {
            // 6° wide. It contributes nine tenths of the light on a surface facing it.
            let shine = |d: Vec3| if d.angle_between(towards) < 3f32.to_radians() { 1300.0 } else { 0.1 };
            let lit = panorama(256, 128, |d| shine(d) * Vec3::new(1.0, 0.8, 0.5));
            let brightest = truth(&lit, towards.normalize());
            let off = worst(&lit, brightest.min_element());
            assert!(off < 0.02, "{towards}: {off} of the brightest, {brightest}");
        }
    }

    #[test]
    fn demonstration_panorama_irradiance_matches_the_integral() {
        let scene = crate::scene::load(std::path::Path::new("scenes/demo.toml"), None).unwrap();
        let crate::scene::Environment::Map(map) = scene.lighting.environment else { panic!("a panorama") };
        let panorama = super::super::panorama::full_resolution(&map);
        let off = worst(&panorama, 0.0);
        assert!(off < 0.02, "{off}");
    }
}
