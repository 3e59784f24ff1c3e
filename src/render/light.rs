//! Lights on the GPU: suns, points, and the environment as irradiance map and prefiltered
//! panoramas.

use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};

use super::albedo;
use super::irradiance::irradiance_over_pi;
use super::panorama::{MipLevel, blurred_levels};
use crate::digest::{Digest, Digester};
use crate::gpu::{Gpu, half_texels};
use crate::memo::Memo;
use crate::scene::{Environment, EnvironmentMap, Lighting};
use crate::text::count;

pub const MAX_SUNS: usize = 4;
pub const MAX_POINTS: usize = 8;

/// `PointLight` in shaders/raster.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PointUniform {
    position: [f32; 4],
    color: [f32; 4],
    spot: [f32; 4],
    spot_inner: [f32; 4],
}

crate::uniform! {
    /// `Light` in shaders/raster.wgsl.
    pub struct LightUniform {
        environment: [f32; 4],
        sun_towards: [[f32; 4]; MAX_SUNS],
        sun_color: [[f32; 4]; MAX_SUNS],
        points: [PointUniform; MAX_POINTS],
        map_rows: [[f32; 4]; 3],
        strength: [f32; 4],
    }
}

/// The environment, uploaded once per scene.
#[derive(Debug)]
pub struct EnvironmentLight {
    /// Panorama prefiltered for specular light.
    pub view: wgpu::TextureView,
    /// The irradiance map of render/irradiance.rs.
    pub irradiance: wgpu::TextureView,
    pub sampler: wgpu::Sampler,
    /// Uniform colour without a panorama.
    color: Vec3,
    levels: u32,
    map_from_world: Mat3,
    /// The table of render/albedo.rs.
    pub albedo: wgpu::TextureView,
}

/// A panorama prefiltered for specular light, and its irradiance map.
#[derive(Debug)]
struct PrefilteredMap {
    levels: Vec<MipLevel>,
    irradiance: MipLevel,
}

/// Number of memoized panoramas: the scene's, and the one before it.
const PANORAMA_CAPACITY: usize = 2;

/// Panoramas by the digest of their size, radiance and colour. Each compositor of a scene uploads
/// the same ones: that of the window, of an export and of a photograph.
static PREFILTERED: Memo<Digest, Arc<PrefilteredMap>> = Memo::new(PANORAMA_CAPACITY);

impl PrefilteredMap {
    fn new(map: &EnvironmentMap) -> Self {
        let levels = blurred_levels(map);
        let irradiance = irradiance_over_pi(&levels[0]);
        Self { levels, irradiance }
    }

    fn memoized(map: &EnvironmentMap) -> Arc<Self> {
        // The shader applies the rotation.
        let mut digester = Digester::default();
        digester.add(&map.width);
        digester.add(&map.height);
        digester.add_numbers(map.rgb.as_slice());
        digester.add(&map.color);
        PREFILTERED.get_or_insert_with(digester.finish(), |_| Arc::new(Self::new(map)))
    }
}

fn wide(v: Vec3, w: f32) -> [f32; 4] {
    [v.x, v.y, v.z, w]
}

impl LightUniform {
    /// Lights relative to a camera at `origin_in_world_m`; `strength` scales the occlusion between
    /// objects. Lights beyond the limits are dropped; [`unsupported`] reports that.
    pub fn new(lighting: &Lighting, environment: &EnvironmentLight, origin_in_world_m: DVec3, strength: f32) -> Self {
        let mut uniform = Self {
            environment: wide(environment.color, environment.levels as f32),
            sun_towards: Default::default(),
            sun_color: Default::default(),
            points: Default::default(),
            map_rows: [0, 1, 2].map(|i| wide(environment.map_from_world.row(i), 0.0)),
            strength: [strength, 0.0, 0.0, 0.0],
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

/// A warning if a scene's lighting exceeds the limits.
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
        let steps = albedo::TABLE_SIZE as u32;
        let table = albedo::table().iter().map(|[x, y, z, _]| Vec3::new(*x, *y, *z)).collect();
        let albedo = upload(gpu, "albedo", &[(steps, steps, table)]);
        let (color, prefiltered, map_from_world) = match environment {
            Environment::Uniform(color) => {
                let all = (1, 1, vec![*color]);
                let uniform = PrefilteredMap { levels: vec![all.clone()], irradiance: all };
                (*color, Arc::new(uniform), Mat3::IDENTITY)
            }
            Environment::Map(map) => (Vec3::ZERO, PrefilteredMap::memoized(map), Mat3::from_quat(map.map_from_world)),
        };
        Self {
            view: upload(gpu, "environment", &prefiltered.levels),
            irradiance: upload(gpu, "irradiance", std::slice::from_ref(&prefiltered.irradiance)),
            sampler,
            color,
            levels: prefiltered.levels.len() as u32,
            map_from_world,
            albedo,
        }
    }
}

fn upload(gpu: &Gpu, label: &str, levels: &[MipLevel]) -> wgpu::TextureView {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
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
