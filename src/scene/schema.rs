//! JSON of glTF 2.0: the parts that are used, as plain values. Everything else is ignored.
//!
//! Not taken from a crate: the existing one panics on references out of range and truncates indices
//! to 32 bits before they can be checked.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

/// Maximum lengths of lists that are long in large models, and of other lists.
const MAX_LONG_LIST: usize = 1 << 20;
const MAX_LIST: usize = 1 << 16;

/// A list of up to `MAX` entries. An entry of three bytes, `{},`, takes a hundred times that in
/// memory.
fn list<'de, D: Deserializer<'de>, T: Deserialize<'de>, const MAX: usize>(from: D) -> Result<Vec<T>, D::Error> {
    struct BoundedList<T, const MAX: usize>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>, const MAX: usize> Visitor<'de> for BoundedList<T, MAX> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a list of up to {MAX} entries")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
            let mut list = Vec::new();
            while let Some(entry) = entries.next_element()? {
                if list.len() == MAX {
                    return Err(A::Error::custom(format!("a list of more than {MAX} entries")));
                }
                list.push(entry);
            }
            Ok(list)
        }
    }
    from.deserialize_seq(BoundedList::<T, MAX>(PhantomData))
}

/// The top-level object of a glTF file.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Root {
    pub asset: Asset,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub extensions_used: Vec<String>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub extensions_required: Vec<String>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub buffers: Vec<Buffer>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LONG_LIST }>")]
    pub buffer_views: Vec<BufferView>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LONG_LIST }>")]
    pub accessors: Vec<Accessor>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub images: Vec<Image>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub samplers: Vec<Sampler>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub textures: Vec<TextureJson>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub materials: Vec<MaterialJson>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LONG_LIST }>")]
    pub meshes: Vec<MeshJson>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LONG_LIST }>")]
    pub nodes: Vec<Node>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub scenes: Vec<SceneJson>,
    pub scene: Option<usize>,
    pub extensions: RootExtensions,
    pub animations: Vec<IgnoredAny>,
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub skins: Vec<Skin>,
    pub cameras: Vec<IgnoredAny>,
}

/// Names of extensions whose content is not read.
pub(super) type ExtensionNames = BTreeMap<String, IgnoredAny>;

/// Start of the file, common to all versions of glTF.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Head {
    pub asset: Asset,
}

/// The object `asset`: version of the format.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Asset {
    /// `"2.0"`; some files have a number.
    pub version: Value,
}

/// An entry of `buffers`; its length is in bytes.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub byte_length: usize,
    pub uri: Option<String>,
    #[serde(default)]
    pub extensions: ExtensionNames,
}

/// An entry of `bufferViews`: a range of a buffer, bytes.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: Option<usize>,
}

/// An entry of `accessors`: `count` elements of a buffer view. `component_type` is an OpenGL
/// constant.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default)]
    pub byte_offset: usize,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub shape: String,
    pub sparse: Option<Sparse>,
}

/// Elements that replace those of an accessor.
#[derive(Debug, Deserialize)]
pub(super) struct Sparse {
    pub count: usize,
    pub indices: SparsePart,
    pub values: SparsePart,
}

/// The indices or the values of replaced elements.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparsePart {
    pub buffer_view: usize,
    #[serde(default)]
    pub byte_offset: usize,
    /// Present for the indices only.
    pub component_type: Option<u32>,
}

/// An entry of `images`: a file, or a buffer view.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Image {
    pub uri: Option<String>,
    pub buffer_view: Option<usize>,
}

/// An entry of `samplers`: filters and wrap modes as OpenGL constants.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Sampler {
    pub mag_filter: Option<u32>,
    pub min_filter: Option<u32>,
    pub wrap_s: Option<u32>,
    pub wrap_t: Option<u32>,
}

/// An entry of `textures`: indices of its sampler and its image.
#[derive(Debug, Deserialize)]
pub(super) struct TextureJson {
    pub sampler: Option<usize>,
    pub source: Option<usize>,
    #[serde(default)]
    pub extensions: ExtensionNames,
}

/// An entry of `materials`; colours are linear.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct MaterialJson {
    pub name: Option<String>,
    pub pbr_metallic_roughness: PbrMetallicRoughness,
    pub normal_texture: Option<TextureInfo>,
    pub occlusion_texture: Option<TextureInfo>,
    pub emissive_texture: Option<TextureInfo>,
    pub emissive_factor: Option<[f32; 3]>,
    pub alpha_mode: Option<String>,
    pub alpha_cutoff: Option<f32>,
    pub double_sided: bool,
    pub extensions: MaterialExtensions,
}

/// Metallic-roughness parameters of a material, factors from 0 to 1.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct PbrMetallicRoughness {
    pub base_color_factor: Option<[f32; 4]>,
    pub base_color_texture: Option<TextureInfo>,
    pub metallic_factor: Option<f32>,
    pub roughness_factor: Option<f32>,
    pub metallic_roughness_texture: Option<TextureInfo>,
}

/// Extensions of a material.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_unlit")]
    pub unlit: Option<IgnoredAny>,
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub emissive_strength: Option<EmissiveStrength>,
}

/// Factor on a material's emitted light (`KHR_materials_emissive_strength`).
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct EmissiveStrength {
    pub emissive_strength: Option<f32>,
}

/// A texture of a material, with the set of coordinates.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureInfo {
    pub index: usize,
    #[serde(default)]
    pub tex_coord: u32,
    /// Scale of a normal texture.
    pub scale: Option<f32>,
    /// Strength of an occlusion texture.
    pub strength: Option<f32>,
    #[serde(default)]
    pub extensions: TextureInfoExtensions,
}

/// Extensions of a texture of a material.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub transform: Option<TextureTransform>,
}

/// Transform of texture coordinates (`KHR_texture_transform`); the rotation is in radians.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub offset: Option<[f32; 2]>,
    pub rotation: Option<f32>,
    pub scale: Option<[f32; 2]>,
    pub tex_coord: Option<u32>,
}

/// An entry of `meshes`.
#[derive(Debug, Deserialize)]
pub(super) struct MeshJson {
    pub primitives: Vec<Primitive>,
    /// Morph target weights, unless the node has its own.
    #[serde(default, deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub weights: Vec<f32>,
}

/// A part of a mesh with one material: indices of accessors; `mode` is an OpenGL constant.
#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    pub attributes: Attributes,
    pub indices: Option<usize>,
    pub material: Option<usize>,
    pub mode: Option<u32>,
    #[serde(default, deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub targets: Vec<MorphTarget>,
    #[serde(default)]
    pub extensions: ExtensionNames,
}

/// A morph target. Displacements of tangents are not read.
#[derive(Debug, Deserialize)]
pub(super) struct MorphTarget {
    #[serde(rename = "POSITION")]
    pub position: Option<usize>,
    #[serde(rename = "NORMAL")]
    pub normal: Option<usize>,
}

/// Accessors of a primitive's vertices.
#[derive(Debug, Deserialize)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub position: Option<usize>,
    #[serde(rename = "NORMAL")]
    pub normal: Option<usize>,
    #[serde(rename = "TANGENT")]
    pub tangent: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    pub uv0: Option<usize>,
    #[serde(rename = "TEXCOORD_1")]
    pub uv1: Option<usize>,
    #[serde(rename = "COLOR_0")]
    pub color: Option<usize>,
    #[serde(rename = "JOINTS_0")]
    pub joints0: Option<usize>,
    #[serde(rename = "JOINTS_1")]
    pub joints1: Option<usize>,
    #[serde(rename = "WEIGHTS_0")]
    pub weights0: Option<usize>,
    #[serde(rename = "WEIGHTS_1")]
    pub weights1: Option<usize>,
}

/// An entry of `nodes`: a matrix by columns, or translation (m), rotation and scale.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub children: Vec<usize>,
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    /// Morph target weights that override the mesh's; empty if the node has none.
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub weights: Vec<f32>,
    pub matrix: Option<[f32; 16]>,
    pub translation: Option<[f32; 3]>,
    /// x, y, z, w.
    pub rotation: Option<[f32; 4]>,
    pub scale: Option<[f32; 3]>,
    pub extensions: NodeExtensions,
}

/// An entry of `skins`: nodes of its joints, and the accessor of their matrices.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Skin {
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub joints: Vec<usize>,
    pub inverse_bind_matrices: Option<usize>,
}

/// Extensions of a node.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub light: Option<LightUse>,
}

/// Index of a node's light (`KHR_lights_punctual`).
#[derive(Debug, Deserialize)]
pub(super) struct LightUse {
    pub light: usize,
}

/// An entry of `scenes`: its root nodes.
#[derive(Debug, Deserialize)]
pub(super) struct SceneJson {
    #[serde(default)]
    pub nodes: Vec<usize>,
}

/// Extensions of the file.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub lights: Lights,
}

/// The lights of the file (`KHR_lights_punctual`).
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Lights {
    #[serde(deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub lights: Vec<Light>,
}

/// A light: intensity in lx or cd, range in m.
#[derive(Debug, Deserialize)]
pub(super) struct Light {
    #[serde(rename = "type", default)]
    pub kind: String,
    /// Linear red, green and blue; white if empty.
    #[serde(default, deserialize_with = "list::<_, _, { MAX_LIST }>")]
    pub color: Vec<f32>,
    pub intensity: Option<f32>,
    pub range: Option<f32>,
    #[serde(default)]
    pub spot: Spot,
}

/// Angles of a spot light from its axis, radians.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Spot {
    pub inner_cone_angle: Option<f64>,
    pub outer_cone_angle: Option<f64>,
}
