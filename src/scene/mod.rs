//! Scene contents to be rendered: meshes, materials, lights. Plain values; no GPU.
//!
//! World coordinates are the recording's, metres. A mesh's own coordinates are those of its file;
//! `world_from_mesh` transforms them to the world, including the change of axes.

mod bytes;
mod describe;
pub mod document;
mod edit;
mod error;
mod extension;
mod gauge;
mod geometry;
mod gltf;
mod heading;
mod kind;
mod lamp;
mod light;
mod light_correction;
mod load;
mod loaded_models;
mod loader;
mod material;
mod missing;
mod model;
mod nodes;
mod overlap;
mod panorama;
mod picture;
mod place;
mod reader;
mod rest_pose;
mod resting;
mod reuse;
mod scan;
mod scene_file;
mod schema;
mod site;

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3};

use crate::digest::digestible;
use crate::plane::Plane;

pub use describe::{ObjectDescription, SceneDescription, TextureDescription, bounds_m, describe, size_warning};
pub use document::{Document, Entry, SceneFile, SceneItem};
pub use edit::ItemPlacement;
pub use error::SceneError;
pub use gauge::Gauge;
pub use heading::Heading;
pub use kind::ObjectKind;
pub use light_correction::LightCorrection;
pub use load::{load, load_file, load_file_with, load_with};
pub use loaded_models::{LoadedModels, MissingModels};
pub use missing::MissingFile;
pub use model::is_model;
pub use overlap::{Overlap, overlaps};
pub use place::Size;
pub use resting::{Facet, MIN_SUPPORT_COSINE, Posture, place_at_rest, relative};
pub use scan::{read_scan, read_scan_watched};
pub use site::{SitePlacement, SiteTable};

/// Decodes a Radiance panorama: width, height, linear light row by row. The error is a description.
pub fn decode_panorama(hdr: &[u8]) -> Result<(u32, u32, Vec<[f32; 3]>), String> {
    let panorama::PanoramaPixels { width, height, rgb } =
        panorama::radiance_of(hdr).map_err(|problem| problem.to_string())?;
    Ok((width, height, rgb))
}

/// Rotation of a panorama's axes (y up, −z in the middle) to a world with the given up.
pub fn world_from_panorama(up: DVec3) -> DQuat {
    place::shortest_rotation(DVec3::Y, up)
}

/// Origin of a scene's lighting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightingOrigin {
    /// The scene file's `[light]`, or the code that built the scene.
    #[default]
    Scene,
    /// The default lighting.
    Default,
    /// Lights of the models only.
    Models,
}

/// Input of the renderer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    pub meshes: Vec<Arc<Mesh>>,
    pub materials: Vec<Material>,
    pub textures: Vec<SceneTexture>,
    pub objects: Vec<Object>,
    pub lighting: Lighting,
    pub lighting_origin: LightingOrigin,
    /// The world's up, if known: a unit vector.
    pub up_in_world: Option<DVec3>,
    /// Length of the recording's unit according to the scene file, metres.
    pub metres_per_unit: Option<f64>,
    /// Camera pose of a frame in the objects' world, according to the scene file.
    pub gauge: Option<Gauge>,
    /// A scan of the place, according to the scene file.
    pub site: Option<SitePlacement>,
    /// Warnings without duplicates.
    pub warnings: Vec<String>,
    /// The files that the scene was read from.
    pub files: Vec<PathBuf>,
    /// Files that cannot be read. Missing models are replaced by a box.
    pub missing: Vec<MissingFile>,
}

impl Scene {
    /// True if meshes, materials, textures and environment are equal, regardless of placement and
    /// lights.
    pub fn has_same_resources(&self, other: &Self) -> bool {
        let shared = |a: &Arc<Mesh>, b: &Arc<Mesh>| Arc::ptr_eq(a, b) || a == b;
        let around = match (&self.lighting.environment, &other.lighting.environment) {
            (Environment::Map(a), Environment::Map(b)) if Arc::ptr_eq(&a.rgb, &b.rgb) => {
                let placed = |map: &EnvironmentMap| (map.width, map.height, map.map_from_world, map.color);
                placed(a) == placed(b)
            }
            (a, b) => a == b,
        };
        around
            && self.materials == other.materials
            && self.textures == other.textures
            && self.meshes.len() == other.meshes.len()
            && self.meshes.iter().zip(&other.meshes).all(|(a, b)| shared(a, b))
    }
}

/// One piece of evidence: the unit that has its own motion vectors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    pub name: String,
    /// Role in photographs.
    pub kind: ObjectKind,
    /// Drawn meshes.
    pub parts: Vec<Part>,
    /// The model's axes in the world. Rendering uses the transforms of the parts.
    pub world_from_model: DAffine3,
    /// Requested position, world axes, metres: the model's origin, or, on the ground, the point
    /// below it.
    pub position_m: DVec3,
    /// Meshes of a proxy of a real object: not drawn, they occlude. An object has these or `parts`.
    pub occluder_parts: Vec<Part>,
    /// Hidden by its scene file; it has no parts then.
    pub hidden: bool,
    /// Proxy of a real object by its scene file.
    pub occluder: bool,
    /// Casts no shadow on the surface that supports it.
    pub shadowless: bool,
    /// The model cannot be read, and a marked box is drawn in its place.
    pub is_missing: bool,
    /// The real surface below the object, which receives its shadow; `None` if unknown.
    pub support: Option<Plane>,
    /// Real planar patches beside the object, which receive its shadow, too. Where two intersect,
    /// the first takes precedence; the surface below takes precedence over both.
    pub facets: Vec<Facet>,
}

/// A placed mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    pub world_from_mesh: DAffine3,
}

/// Triangles with one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    pub vertices: Vec<Vertex>,
    /// Three per triangle, counter-clockwise seen from outside (glTF), all below `vertices.len()`.
    pub indices: Vec<u32>,
    /// Index into [`Scene::materials`].
    pub material: usize,
}

/// Vertex attributes. Colours are linear.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    pub position: [f32; 3],
    /// Unit length; computed from the triangles if the file has none.
    pub normal: [f32; 3],
    /// xyz of unit length, w = ±1 for the bitangent's side (glTF); zero without a normal map.
    pub tangent: [f32; 4],
    pub uv0: [f32; 2],
    pub uv1: [f32; 2],
    /// Multiplied with the base colour; white if the file has none.
    pub color: [f32; 4],
}

/// glTF's alpha modes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alpha {
    Opaque,
    /// Alpha cutoff.
    Mask(f32),
    Blend,
}

/// A metallic-roughness material. Factors are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    pub name: String,
    pub base_color: [f32; 4],
    pub metallic: f32,
    pub roughness: f32,
    /// Emitted light, including KHR_materials_emissive_strength.
    pub emissive: [f32; 3],
    pub normal_scale: f32,
    pub occlusion_strength: f32,
    pub alpha: Alpha,
    pub double_sided: bool,
    pub unlit: bool,
    pub base_color_texture: Option<TextureUse>,
    /// G roughness, B metallic.
    pub metallic_roughness_texture: Option<TextureUse>,
    pub normal_texture: Option<TextureUse>,
    pub occlusion_texture: Option<TextureUse>,
    pub emissive_texture: Option<TextureUse>,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".to_owned(),
            base_color: [1.0; 4],
            metallic: 1.0,
            roughness: 1.0,
            emissive: [0.0; 3],
            normal_scale: 1.0,
            occlusion_strength: 1.0,
            alpha: Alpha::Opaque,
            double_sided: false,
            unlit: false,
            base_color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            occlusion_texture: None,
            emissive_texture: None,
        }
    }
}

/// A texture as a material uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureUse {
    /// Index into [`Scene::textures`].
    pub texture: usize,
    /// 0 or 1.
    pub uv_set: u32,
    /// KHR_texture_transform as rows of a 2×3 matrix: `u' = rows[0]·(u, v, 1)`.
    pub transform: [[f32; 3]; 2],
}

/// Wrap mode of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

/// An RGBA picture with 8 bits per channel, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneTexture {
    pub width: u32,
    pub height: u32,
    pub rgba: Arc<Vec<u8>>,
    /// True if R, G, B are sRGB-encoded (colours), false if linear (normals, roughness).
    pub srgb: bool,
    pub wrap: [Wrap; 2],
    /// False for glTF's NEAREST magnification.
    pub smooth: bool,
    /// True if minification uses mipmaps.
    pub mipmaps: bool,
}

impl SceneTexture {
    /// Decodes a code value, 0 to 1 (sRGB: IEC 61966-2-1).
    pub fn linear(&self, code: u8) -> f32 {
        let value = f32::from(code) / 255.0;
        if !self.srgb {
            value
        } else if value <= 0.04045 {
            value / 12.92
        } else {
            ((value + 0.055) / 1.055).powf(2.4)
        }
    }
}

/// Lights. Linear 1.0 is the camera's white.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    pub suns: Vec<Sun>,
    pub points: Vec<PointLight>,
    pub environment: Environment,
}

/// A directional light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector from the scene towards the light, world axes.
    pub towards_light_in_world: Vec3,
    /// Linear radiance of a white diffuse surface facing this light.
    pub color: Vec3,
    /// Angular diameter; it determines the penumbrae.
    pub diameter_rad: f32,
}

/// A point or spot light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    pub position_in_world_m: DVec3,
    /// Linear radiance of a white diffuse surface facing this light at 1 m.
    pub color: Vec3,
    /// Diameter; it determines the penumbrae.
    pub diameter_m: f32,
    /// Range limit (KHR_lights_punctual); infinity for none.
    pub range_m: f32,
    /// Axis direction of a spot in the world and its inner and outer angle from it, radians.
    pub spot: Option<(Vec3, Vec2)>,
}

digestible! {
    Sun { towards_light_in_world, color, diameter_rad }
    PointLight { position_in_world_m, color, diameter_m, range_m, spot }
}

/// Environment light.
#[derive(Clone, Debug, PartialEq)]
pub enum Environment {
    /// The same radiance from all directions, which is that of a white diffuse surface.
    Uniform(Vec3),
    Map(EnvironmentMap),
}

/// An equirectangular panorama of linear radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    pub width: u32,
    pub height: u32,
    /// Row 0 is the panorama's up; the first and the last column meet behind it.
    pub rgb: Arc<Vec<[f32; 3]>>,
    /// Rotation of world directions to the panorama's axes: glTF's, y up, −z in the middle.
    pub map_from_world: glam::Quat,
    /// Factor on the radiance: red, green, blue.
    pub color: Vec3,
}

impl Default for Lighting {
    fn default() -> Self {
        Self { suns: Vec::new(), points: Vec::new(), environment: Environment::Uniform(Vec3::ONE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Change<'a> = &'a dyn Fn(&mut Scene);

    /// Scenes can be stored and compared by any code and across threads.
    #[test]
    fn scene_and_camera_are_plain_values() {
        fn plain<T: Clone + PartialEq + Send + Sync + 'static>(value: T) {
            assert!(value.clone() == value);
        }
        plain(super::Scene::default());
        plain(crate::camera::Camera::default());
    }

    #[test]
    fn any_changed_resource_makes_scenes_differ() {
        let texture = SceneTexture {
            width: 1,
            height: 1,
            rgba: Arc::new(vec![255; 4]),
            srgb: true,
            wrap: [Wrap::Repeat; 2],
            smooth: true,
            mipmaps: true,
        };
        let map = EnvironmentMap {
            width: 2,
            height: 1,
            rgb: Arc::new(vec![[1.0; 3]; 2]),
            map_from_world: glam::Quat::IDENTITY,
            color: Vec3::ONE,
        };
        let scene = Scene {
            meshes: vec![Arc::new(Mesh { vertices: Vec::new(), indices: Vec::new(), material: 0 })],
            materials: vec![Material::default()],
            textures: vec![texture],
            objects: vec![Object::default()],
            lighting: Lighting { environment: Environment::Map(map.clone()), ..Lighting::default() },
            ..Scene::default()
        };
        let is_the_same = |change: Change<'_>| {
            let mut other = scene.clone();
            change(&mut other);
            assert!(other != scene, "nothing was changed");
            let answer = scene.has_same_resources(&other);
            assert_eq!(other.has_same_resources(&scene), answer, "the order matters");
            answer
        };
        let set_environment = |scene: &mut Scene, map| scene.lighting.environment = Environment::Map(map);
        let resources: [(&str, Change<'_>); 9] = [
            ("transparency", &|scene| scene.materials[0].alpha = Alpha::Blend),
            ("colour", &|scene| scene.materials[0].base_color = [0.5; 4]),
            ("another material", &|scene| scene.materials.push(Material::default())),
            ("texture", &|scene| scene.textures[0].rgba = Arc::new(vec![0; 4])),
            ("mesh", &|scene| Arc::make_mut(&mut scene.meshes[0]).material = 1),
            ("another mesh", &|scene| scene.meshes.push(scene.meshes[0].clone())),
            ("no panorama", &|scene| scene.lighting.environment = Environment::Uniform(Vec3::ONE)),
            ("panorama", &|scene| {
                set_environment(scene, EnvironmentMap { rgb: Arc::new(vec![[2.0; 3]; 2]), ..map.clone() })
            }),
            ("brighter panorama", &|scene| {
                set_environment(scene, EnvironmentMap { color: Vec3::splat(2.0), ..map.clone() })
            }),
        ];
        for (resource, change) in resources {
            assert!(!is_the_same(change), "{resource}");
        }
        let sun = Sun { towards_light_in_world: Vec3::Z, color: Vec3::ONE, diameter_rad: 0.01 };
        assert!(is_the_same(&|scene| scene.lighting.suns = vec![sun]), "lit otherwise");
        assert!(is_the_same(&|scene| scene.objects[0].move_by(DAffine3::from_translation(DVec3::X))), "moved");
    }
}
