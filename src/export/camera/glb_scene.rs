//! The evidence as glTF nodes, meshes, materials and textures. Not written: lights, occluders.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use glam::{DAffine3, DMat4, DQuat};
use serde_json::{Map, Value, json};

use super::glb_writer::GlbBuffer;
use super::texture::png;
use crate::scene::{Alpha, Material, Mesh, Scene, SceneTexture, TextureUse, Wrap};

/// Lists of the document; the nodes follow those that are there already.
#[derive(Debug, Default)]
pub struct GlbEvidence {
    pub nodes: Vec<Value>,
    /// Indices of the objects' nodes.
    pub roots: Vec<usize>,
    pub meshes: Vec<Value>,
    pub materials: Vec<Value>,
    pub textures: Vec<Value>,
    pub images: Vec<Value>,
    pub samplers: Vec<Value>,
    pub extensions: BTreeSet<&'static str>,
}

/// A node's transform; none for the identity.
fn set_matrix(node: &mut Value, transform: &DAffine3) {
    if *transform != DAffine3::IDENTITY {
        node["matrix"] = json!(DMat4::from(*transform).to_cols_array());
    }
}

/// `first_node` is the number of nodes that precede.
pub fn write(
    scene: &Scene,
    file_from_world: DQuat,
    first_node: usize,
    buffer: &mut GlbBuffer,
) -> Result<GlbEvidence, image::ImageError> {
    let mut evidence = GlbEvidence::default();
    let (mut meshes, mut materials, mut textures) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    for object in scene.objects.iter().filter(|object| !object.parts.is_empty()) {
        let mut parts = Vec::new();
        for part in &object.parts {
            let mesh = match meshes.get(&part.mesh) {
                Some(known) => *known,
                None => {
                    let of = &scene.meshes[part.mesh];
                    let material = match materials.get(&of.material) {
                        Some(known) => *known,
                        None => {
                            let material = &scene.materials[of.material];
                            for used in texture_uses(material) {
                                if let Entry::Vacant(entry) = textures.entry(used.texture) {
                                    let texture = &scene.textures[used.texture];
                                    entry.insert(add_texture(&mut evidence, buffer, texture)?);
                                }
                            }
                            let json = material_json(material, &textures, &mut evidence.extensions);
                            evidence.materials.push(json);
                            materials.insert(of.material, evidence.materials.len() - 1);
                            evidence.materials.len() - 1
                        }
                    };
                    evidence.meshes.push(mesh_json(of, material, &scene.materials[of.material].name, buffer));
                    meshes.insert(part.mesh, evidence.meshes.len() - 1);
                    evidence.meshes.len() - 1
                }
            };
            let mut node = json!({ "mesh": mesh });
            set_matrix(&mut node, &(object.world_from_model.inverse() * part.world_from_mesh));
            evidence.nodes.push(node);
            parts.push(first_node + evidence.nodes.len() - 1);
        }
        let mut node = json!({ "name": object.name, "children": parts });
        set_matrix(&mut node, &(DAffine3::from_quat(file_from_world) * object.world_from_model));
        evidence.nodes.push(node);
        evidence.roots.push(first_node + evidence.nodes.len() - 1);
    }
    Ok(evidence)
}

fn mesh_json(mesh: &Mesh, material: usize, name: &str, buffer: &mut GlbBuffer) -> Value {
    let vertices = &mesh.vertices;
    let mut attributes = Map::new();
    let mut add = |name: &str, accessor: usize| attributes.insert(name.to_owned(), accessor.into());
    add("POSITION", buffer.floats(&vertices.iter().map(|v| v.position).collect::<Vec<_>>()));
    add("NORMAL", buffer.floats(&vertices.iter().map(|v| v.normal).collect::<Vec<_>>()));
    if vertices.iter().all(|v| v.tangent != [0.0; 4]) {
        add("TANGENT", buffer.floats(&vertices.iter().map(|v| v.tangent).collect::<Vec<_>>()));
    }
    if vertices.iter().any(|v| v.uv0 != [0.0; 2] || v.uv1 != [0.0; 2]) {
        add("TEXCOORD_0", buffer.floats(&vertices.iter().map(|v| v.uv0).collect::<Vec<_>>()));
    }
    if vertices.iter().any(|v| v.uv1 != [0.0; 2]) {
        add("TEXCOORD_1", buffer.floats(&vertices.iter().map(|v| v.uv1).collect::<Vec<_>>()));
    }
    if vertices.iter().any(|v| v.color != [1.0; 4]) {
        add("COLOR_0", buffer.floats(&vertices.iter().map(|v| v.color).collect::<Vec<_>>()));
    }
    json!({ "name": name, "primitives": [{ "attributes": attributes, "indices": buffer.indices(&mesh.indices), "material": material }] })
}

fn add_texture(
    evidence: &mut GlbEvidence,
    buffer: &mut GlbBuffer,
    texture: &SceneTexture,
) -> Result<usize, image::ImageError> {
    evidence.images.push(json!({ "bufferView": buffer.view(&png(texture)?), "mimeType": "image/png" }));
    let wrap = texture.wrap.map(|wrap| match wrap {
        Wrap::Repeat => 10497,
        Wrap::Mirror => 33648,
        Wrap::Clamp => 33071,
    });
    let magnification = if texture.smooth { 9729 } else { 9728 };
    let minification = match (texture.smooth, texture.mipmaps) {
        (true, true) => 9987,
        (false, true) => 9984,
        (true, false) => 9729,
        (false, false) => 9728,
    };
    evidence
        .samplers
        .push(json!({ "magFilter": magnification, "minFilter": minification, "wrapS": wrap[0], "wrapT": wrap[1] }));
    let (source, sampler) = (evidence.images.len() - 1, evidence.samplers.len() - 1);
    evidence.textures.push(json!({ "source": source, "sampler": sampler }));
    Ok(evidence.textures.len() - 1)
}

fn texture_uses(material: &Material) -> impl Iterator<Item = &TextureUse> {
    [
        &material.base_color_texture,
        &material.metallic_roughness_texture,
        &material.normal_texture,
        &material.occlusion_texture,
        &material.emissive_texture,
    ]
    .into_iter()
    .flatten()
}

/// Offset, rotation and scale of a texture's transform. `None` for the identity and for sheared
/// ones, which KHR_texture_transform cannot represent.
fn transform_json(used: &TextureUse) -> Option<Value> {
    let [[a, b, c], [d, e, f]] = used.transform;
    if used.transform == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
        return None;
    }
    // u' = sx cos φ u + sy sin φ v + ox, v' = −sx sin φ u + sy cos φ v + oy.
    let rotation = (-d).atan2(a);
    Some(json!({ "offset": [c, f], "rotation": rotation, "scale": [a.hypot(d), b.hypot(e)] }))
}

fn material_json(
    material: &Material,
    textures: &BTreeMap<usize, usize>,
    extensions: &mut BTreeSet<&'static str>,
) -> Value {
    let mut info = |used: &Option<TextureUse>| -> Option<Value> {
        let used = used.as_ref()?;
        let mut json = json!({ "index": textures.get(&used.texture)?, "texCoord": used.uv_set });
        if let Some(transform) = transform_json(used) {
            extensions.insert("KHR_texture_transform");
            json["extensions"] = json!({ "KHR_texture_transform": transform });
        }
        Some(json)
    };
    let mut json = json!({
        "name": material.name,
        "doubleSided": material.double_sided,
        "pbrMetallicRoughness": {
            "baseColorFactor": material.base_color,
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        },
    });
    if let Some(texture) = info(&material.base_color_texture) {
        json["pbrMetallicRoughness"]["baseColorTexture"] = texture;
    }
    if let Some(texture) = info(&material.metallic_roughness_texture) {
        json["pbrMetallicRoughness"]["metallicRoughnessTexture"] = texture;
    }
    if let Some(mut texture) = info(&material.normal_texture) {
        texture["scale"] = material.normal_scale.into();
        json["normalTexture"] = texture;
    }
    if let Some(mut texture) = info(&material.occlusion_texture) {
        texture["strength"] = material.occlusion_strength.into();
        json["occlusionTexture"] = texture;
    }
    if let Some(texture) = info(&material.emissive_texture) {
        json["emissiveTexture"] = texture;
    }
    match material.alpha {
        Alpha::Opaque => {}
        Alpha::Mask(cutoff) => {
            json["alphaMode"] = "MASK".into();
            json["alphaCutoff"] = cutoff.into();
        }
        Alpha::Blend => json["alphaMode"] = "BLEND".into(),
    }
    // Factors of emission end at 1.
    let strength = material.emissive.into_iter().fold(0.0, f32::max);
    if strength > 0.0 {
        json["emissiveFactor"] = json!(material.emissive.map(|channel| channel / strength.max(1.0)));
    }
    if strength > 1.0 {
        extensions.insert("KHR_materials_emissive_strength");
        json["extensions"]["KHR_materials_emissive_strength"] = json!({ "emissiveStrength": strength });
    }
    if material.unlit {
        extensions.insert("KHR_materials_unlit");
        json["extensions"]["KHR_materials_unlit"] = json!({});
    }
    json
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_transform_is_decomposed() {
        // Half as large, a quarter turn, then moved: by KHR_texture_transform's matrix.
        let used = TextureUse { texture: 0, uv_set: 0, transform: [[0.0, 0.5, 0.1], [-2.0, 0.0, 0.2]] };
        let json = transform_json(&used).unwrap();
        assert!((json["rotation"].as_f64().unwrap() - std::f64::consts::FRAC_PI_2).abs() < 1e-6, "{json}");
        assert_eq!(json["scale"], json!([2.0f32, 0.5f32]));
        let none = TextureUse { transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..used };
        assert_eq!(transform_json(&none), None);
    }
}
