//! Lights on the GPU: suns, points, and the environment as harmonics and blurred panoramas.

use glam::{DVec3, Mat3, Vec3};

use super::albedo;
use crate::gpu::{Gpu, half_texels};
use crate::scene::{Environment, EnvironmentMap, Lighting};
use crate::words::count;

pub const MAX_SUNS: usize = 4;
pub const MAX_POINTS: usize = 8;
/// Width of the sharpest panorama for reflections; each level has half of it.
const ENVIRONMENT_WIDTH: u32 = 256;
const ENVIRONMENT_LEVELS: u32 = 6;
const LOBE_SAMPLES: u32 = 96;

/// `PointLight` of shaders/raster.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PointUniform {
    position: [f32; 4],
    color: [f32; 4],
    spot: [f32; 4],
    spot_inner: [f32; 4],
}

/// `Light` of shaders/raster.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct LightUniform {
    environment: [f32; 4],
    sun_towards: [[f32; 4]; MAX_SUNS],
    sun_color: [[f32; 4]; MAX_SUNS],
    points: [PointUniform; MAX_POINTS],
    irradiance: [[f32; 4]; 9],
    map_rows: [[f32; 4]; 3],
    albedo: [[f32; 4]; albedo::STEPS * albedo::STEPS],
}

/// The environment, made once a scene.
#[derive(Debug)]
pub struct EnvironmentLight {
    pub view: wgpu::TextureView,
    pub sampler: wgpu::Sampler,
    levels: u32,
    irradiance: [[f32; 4]; 9],
    map_from_world: Mat3,
    albedo: Vec<[f32; 4]>,
}

fn wide(v: Vec3, w: f32) -> [f32; 4] {
    [v.x, v.y, v.z, w]
}

impl LightUniform {
    /// Lights around a camera that stands at `origin_in_world_m`. Lights beyond the limits
    /// are left out; [`unsupported`] says so.
    pub fn new(lighting: &Lighting, environment: &EnvironmentLight, origin_in_world_m: DVec3) -> Self {
        let mut uniform = Self {
            environment: [environment.levels as f32, 0.0, 0.0, 0.0],
            sun_towards: Default::default(),
            sun_color: Default::default(),
            points: Default::default(),
            irradiance: environment.irradiance,
            map_rows: [0, 1, 2].map(|i| wide(environment.map_from_world.row(i), 0.0)),
            albedo: std::array::from_fn(|i| environment.albedo[i]),
        };
        for (i, sun) in lighting.suns.iter().take(MAX_SUNS).enumerate() {
            uniform.sun_towards[i] = wide(sun.towards_light_in_world, 0.0);
            uniform.sun_color[i] = wide(sun.color, 0.0);
        }
        for (i, point) in lighting.points.iter().take(MAX_POINTS).enumerate() {
            let position = (point.position_in_world_m - origin_in_world_m).as_vec3();
            let (axis, inner, outer) =
                point.spot.map_or((Vec3::Z, -2.0, -2.0), |(axis, a)| (axis, a.x.cos(), a.y.cos()));
            uniform.points[i] = PointUniform {
                position: wide(position, 1.0 / point.range_m),
                color: wide(point.color, 0.0),
                spot: wide(axis, outer),
                spot_inner: [inner, 0.0, 0.0, 0.0],
            };
        }
        uniform
    }
}

/// What a scene's lighting asks for beyond what is drawn.
pub fn unsupported(lighting: &Lighting) -> Option<String> {
    (lighting.suns.len() > MAX_SUNS || lighting.points.len() > MAX_POINTS).then(|| {
        format!(
            "the scene has {} and {}; the first {MAX_SUNS} and {MAX_POINTS} are drawn",
            count(lighting.suns.len(), "sun"),
            count(lighting.points.len(), "lamp")
        )
    })
}

impl EnvironmentLight {
    pub fn new(gpu: &Gpu, environment: &Environment) -> Self {
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("environment"),
            address_mode_u: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let albedo = albedo::table();
        match environment {
            Environment::Uniform(color) => {
                let mut irradiance = [[0.0; 4]; 9];
                irradiance[0] = wide(*color, 0.0);
                let view = upload(gpu, &[(1, 1, vec![*color])]);
                Self { view, sampler, levels: 0, irradiance, map_from_world: Mat3::IDENTITY, albedo }
            }
            Environment::Map(map) => {
                let map_from_world = Mat3::from_quat(map.map_from_world);
                let levels = blurred_levels(map);
                let view = upload(gpu, &levels);
                let irradiance = harmonics(map, map_from_world.transpose()).map(|c| wide(c, 0.0));
                Self { view, sampler, levels: levels.len() as u32, irradiance, map_from_world, albedo }
            }
        }
    }
}

type Level = (u32, u32, Vec<Vec3>);

fn upload(gpu: &Gpu, levels: &[Level]) -> wgpu::TextureView {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("environment"),
        size: wgpu::Extent3d { width: levels[0].0, height: levels[0].1, depth_or_array_layers: 1 },
        mip_level_count: levels.len() as u32,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    for (level, (width, height, texels)) in levels.iter().enumerate() {
        let texels: Vec<_> = texels.iter().map(|c| wide(c.min(Vec3::splat(60000.0)), 1.0)).collect();
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level: level as u32,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::All,
            },
            bytemuck::cast_slice(&half_texels(&texels)),
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * width), rows_per_image: None },
            wgpu::Extent3d { width: *width, height: *height, depth_or_array_layers: 1 },
        );
    }
    texture.create_view(&Default::default())
}

/// The direction, in the panorama's axes, through the middle of a texel: y up, −z in the middle.
fn direction(x: u32, y: u32, width: u32, height: u32) -> Vec3 {
    let phi = ((x as f32 + 0.5) / width as f32 - 0.5) * std::f32::consts::TAU;
    let theta = (y as f32 + 0.5) / height as f32 * std::f32::consts::PI;
    Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
}

fn texel_at(d: Vec3, width: u32, height: u32) -> usize {
    let u = d.x.atan2(-d.z) / std::f32::consts::TAU + 0.5;
    let v = d.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI;
    let x = ((u * width as f32) as u32).min(width - 1);
    let y = ((v * height as f32) as u32).min(height - 1);
    (y * width + x) as usize
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

/// Levels from sharp to fully rough: each the panorama seen in a GGX lobe of roughness
/// level/(levels − 1), with the eye along the normal (Karis 2013, "Real Shading in UE4").
fn blurred_levels(map: &EnvironmentMap) -> Vec<Level> {
    let width = ENVIRONMENT_WIDTH.min(map.width.max(1 << (ENVIRONMENT_LEVELS - 1)));
    let sharp = resampled(map, width, (width / 2).max(1));
    // A coarser source keeps small lights from sparkling through few samples.
    let coarse = resampled(map, (width / 4).max(1), (width / 8).max(1));
    let mut levels = vec![sharp];
    for level in 1..ENVIRONMENT_LEVELS {
        let (w, h) = ((width >> level).max(1), ((width / 2) >> level).max(1));
        let roughness = level as f32 / (ENVIRONMENT_LEVELS - 1) as f32;
        let a2 = roughness.powi(4);
        let source = if roughness < 0.35 { &levels[0] } else { &coarse };
        let mut texels = Vec::with_capacity((w * h) as usize);
        for y in 0..h {
            for x in 0..w {
                let n = direction(x, y, w, h);
                let t = n.any_orthonormal_vector();
                let b = n.cross(t);
                let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
                for i in 0..LOBE_SAMPLES {
                    // Hammersley's points.
                    let e1 = (i as f32 + 0.5) / LOBE_SAMPLES as f32;
                    let e2 = i.reverse_bits() as f32 * 2.0f32.powi(-32);
                    let cos = ((1.0 - e1) / (1.0 + (a2 - 1.0) * e1)).sqrt();
                    let sin = (1.0 - cos * cos).max(0.0).sqrt();
                    let (s, c) = (e2 * std::f32::consts::TAU).sin_cos();
                    let half = t * (sin * c) + b * (sin * s) + n * cos;
                    let towards = half * (2.0 * n.dot(half)) - n;
                    let n_l = n.dot(towards);
                    if n_l > 0.0 {
                        sum += source.2[texel_at(towards, source.0, source.1)] * n_l;
                        weight += n_l;
                    }
                }
                texels.push(sum / weight.max(1e-6));
            }
        }
        levels.push((w, h, texels));
    }
    levels
}

/// Irradiance over π as second-order harmonics in world axes, for the polynomial of the
/// shader: Ramamoorthi and Hanrahan 2001, with the cosine's factors (1, 2/3, 1/4) times the
/// basis' squared constants.
fn harmonics(map: &EnvironmentMap, world_from_map: Mat3) -> [Vec3; 9] {
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
}
