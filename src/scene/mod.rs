//! Everything that is put into the room: meshes, materials, lights. Plain values; no GPU.
//!
//! World coordinates are the recording's, metres. A mesh's own coordinates are those of its file; `world_from_mesh`
//! takes them to the world, including the change of axes.

mod bytes;
mod correction;
mod describe;
pub mod document;
mod edit;
mod error;
mod extension;
mod geometry;
mod gltf;
mod heading;
mod keep;
mod lamp;
mod lay;
mod light;
mod load;
mod loader;
mod material;
mod missing;
mod model;
mod models;
mod nodes;
mod overlap;
mod panorama;
mod picture;
mod place;
mod reader;
mod rest;
mod scene_file;
mod schema;

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3};

use crate::digest::digestible;

pub use correction::LightCorrection;
pub use describe::{Description, ObjectDescription, TextureDescription, bounds_m, describe, odd_size};
pub use document::{Document, Entry, Gauge, SceneFile, Thing};
pub use edit::Stance;
pub use error::SceneError;
pub use heading::Heading;
pub use lay::{Facet, MIN_SUPPORT_COSINE, Posture, Support, lay, relative};
pub use load::{load, load_file, load_file_with, load_with};
pub use missing::MissingFile;
pub use model::is_model;
pub use models::{MissingModels, Models};
pub use overlap::{Overlap, overlaps};
pub use place::Size;

/// The pixels of a Radiance panorama: width, height, linear light row by row. Otherwise what is wrong with it.
pub fn panorama_of(hdr: &[u8]) -> Result<(u32, u32, Vec<[f32; 3]>), String> {
    let panorama::PanoramaPixels { width, height, rgb } =
        panorama::radiance_of(hdr).map_err(|problem| problem.to_string())?;
    Ok((width, height, rgb))
}

/// How a panorama stands on a world's up: takes its axes (y up, −z in the middle) to the world's.
pub fn upright(up: DVec3) -> DQuat {
    place::turn_up(DVec3::Y, up)
}

/// Who said how a scene is lit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LitBy {
    /// The scene file, by its `[light]`, or whoever made the scene.
    #[default]
    Scene,
    /// Nobody: the light is guessed.
    Nobody,
    /// Its models alone.
    Models,
}

/// Everything that the renderer draws.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    pub meshes: Vec<Arc<Mesh>>,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub objects: Vec<Object>,
    pub lighting: Lighting,
    pub lit_by: LitBy,
    /// The world's up, if known: a unit vector.
    pub up_in_world: Option<DVec3>,
    /// How long the recording's unit is by the scene file, metres.
    pub metres_per_unit: Option<f64>,
    /// Where the camera stands in a frame, in the world that the objects are in, by the scene file.
    pub gauge: Option<Gauge>,
    /// Warnings, each given once.
    pub warnings: Vec<String>,
    /// The files that the scene was read from.
    pub files: Vec<PathBuf>,
    /// Files that cannot be read. A box stands in for each model among them.
    pub missing: Vec<MissingFile>,
}

impl Scene {
    /// Whether it has the same meshes, materials, pictures and surrounding light, however they are placed and lit.
    pub fn is_made_of_the_same(&self, other: &Self) -> bool {
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

/// One piece of evidence: the unit with its own blur vector.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    pub name: String,
    /// Without any, it is not drawn.
    pub parts: Vec<Part>,
    /// The model's own axes in the world. Nothing is drawn by it: each part has its own.
    pub world_from_model: DAffine3,
    /// The place that it was given, world axes, metres: the model's origin, or, put on the ground, the place below it.
    pub position_m: DVec3,
    /// What stands in for something real: not drawn, it hides what is behind it. An object has these or `parts`.
    pub hides: Vec<Part>,
    /// Left out by its scene file; it has no parts then.
    pub hidden: bool,
    /// Stands in for something real by its scene file.
    pub occluder: bool,
    /// Takes no light from what it stands on.
    pub shadowless: bool,
    /// Its model cannot be read, and a marked box is drawn in its place.
    pub is_missing: bool,
    /// The real surface below it, on which its shadow falls; `None` if unknown.
    pub support: Option<Support>,
    /// Real things beside it, on which its shadow falls, too. Where two meet the first counts, and the real surface below before both.
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

/// A corner. Colours are linear.
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
    /// Cut off below this value.
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

/// How a texture continues beyond its edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

/// An RGBA picture with 8 bits per channel, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    pub width: u32,
    pub height: u32,
    pub rgba: Arc<Vec<u8>>,
    /// Whether R, G, B are sRGB-encoded (colours) or linear (normals, roughness).
    pub srgb: bool,
    pub wrap: [Wrap; 2],
    /// False for glTF's NEAREST magnification.
    pub smooth: bool,
    /// Whether minification uses mipmaps.
    pub mipmaps: bool,
}

impl Texture {
    /// What a code stands for, 0 to 1 (sRGB: IEC 61966-2-1).
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

/// The light. Linear 1.0 is the camera's white.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    pub suns: Vec<Sun>,
    pub points: Vec<PointLight>,
    pub environment: Environment,
}

/// Light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector from the scene towards the light, world axes.
    pub towards_light_in_world: Vec3,
    /// The linear colour that a white matt surface shows when it faces this light.
    pub color: Vec3,
    /// How wide it stands in the sky: the wider, the softer are its shadows.
    pub diameter_rad: f32,
}

/// A point or spot light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    pub position_in_world_m: DVec3,
    /// The linear colour that a white matt surface shows when it faces this light at 1 m.
    pub color: Vec3,
    /// Its diameter: the wider, the softer are its shadows.
    pub diameter_m: f32,
    /// There is no light beyond it (KHR_lights_punctual); infinity for no limit.
    pub range_m: f32,
    /// Direction of a spot's axis in the world and its inner and outer angle from it, radians.
    pub spot: Option<(Vec3, Vec2)>,
}

digestible! {
    Sun { towards_light_in_world, color, diameter_rad }
    PointLight { position_in_world_m, color, diameter_m, range_m, spot }
}

/// Light from everywhere.
#[derive(Clone, Debug, PartialEq)]
pub enum Environment {
    /// The same radiance from all directions; a white matt surface shows it.
    Uniform(Vec3),
    Map(EnvironmentMap),
}

/// An equirectangular panorama of linear radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    pub width: u32,
    pub height: u32,
    /// Row 0 looks along the panorama's up; column 0 and the last meet behind it.
    pub rgb: Arc<Vec<[f32; 3]>>,
    /// Takes a direction in the world to the panorama's axes: glTF's, y up, −z in the middle.
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

    /// Two pieces of a program, or two moments of one, can each keep a scene and compare them.
    #[test]
    fn a_scene_and_a_camera_are_plain_values() {
        fn plain<T: Clone + PartialEq + Send + Sync + 'static>(value: T) {
            assert!(value.clone() == value);
        }
        plain(super::Scene::default());
        plain(crate::camera::Camera::default());
    }

    #[test]
    fn scene_with_any_other_resource_is_not_made_of_the_same() {
        let texture = Texture {
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
            let answer = scene.is_made_of_the_same(&other);
            assert_eq!(other.is_made_of_the_same(&scene), answer, "the order matters");
            answer
        };
        let around = |scene: &mut Scene, map| scene.lighting.environment = Environment::Map(map);
        let resources: [(&str, Change<'_>); 9] = [
            ("transparency", &|scene| scene.materials[0].alpha = Alpha::Blend),
            ("colour", &|scene| scene.materials[0].base_color = [0.5; 4]),
            ("another material", &|scene| scene.materials.push(Material::default())),
            ("texture", &|scene| scene.textures[0].rgba = Arc::new(vec![0; 4])),
            ("mesh", &|scene| Arc::make_mut(&mut scene.meshes[0]).material = 1),
            ("another mesh", &|scene| scene.meshes.push(scene.meshes[0].clone())),
            ("no panorama", &|scene| scene.lighting.environment = Environment::Uniform(Vec3::ONE)),
            ("panorama", &|scene| around(scene, EnvironmentMap { rgb: Arc::new(vec![[2.0; 3]; 2]), ..map.clone() })),
            ("brighter panorama", &|scene| around(scene, EnvironmentMap { color: Vec3::splat(2.0), ..map.clone() })),
        ];
        for (resource, change) in resources {
            assert!(!is_the_same(change), "{resource}");
        }
        let sun = Sun { towards_light_in_world: Vec3::Z, color: Vec3::ONE, diameter_rad: 0.01 };
        assert!(is_the_same(&|scene| scene.lighting.suns = vec![sun]), "lit otherwise");
        assert!(is_the_same(&|scene| scene.objects[0].move_by(DAffine3::from_translation(DVec3::X))), "moved");
    }
}
