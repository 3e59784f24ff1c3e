//! The evidence as USD prims: a transform for each object, with its meshes; materials as
//! `UsdPreviewSurface` with base colour, metallic, roughness, emission and opacity. Not written:
//! textures other than that of the base colour, lights, occluders.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DAffine3, DQuat};

use super::usd_writer::{UsdWriter, list, tuple};
use crate::scene::{Alpha, Material, Mesh, Scene, SceneTexture, TextureUse, Wrap};

/// Folder of the textures, beside the layer.
pub const TEXTURE_FOLDER: &str = "textures";

/// The prims' text, and the textures that they reference.
#[derive(Debug, Default)]
pub struct UsdEvidence {
    pub text: String,
    /// Indices into [`Scene::textures`].
    pub textures: BTreeSet<usize>,
}

/// Name of a texture's file in [`TEXTURE_FOLDER`].
pub fn texture_file(texture: usize) -> String {
    format!("texture_{texture}.png")
}

/// A name as an identifier, unique among those already used.
fn identifier(name: &str, used: &mut BTreeSet<String>) -> String {
    let mut plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !plain.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
        plain.insert(0, '_');
    }
    let mut unique = plain.clone();
    let mut number = 1;
    while !used.insert(unique.clone()) {
        number += 1;
        unique = format!("{plain}_{number}");
    }
    unique
}

pub fn write(scene: &Scene, file_from_world: DQuat) -> UsdEvidence {
    let drawn: Vec<_> = scene.objects.iter().filter(|object| !object.parts.is_empty()).collect();
    if drawn.is_empty() {
        return UsdEvidence::default();
    }
    let materials: BTreeSet<usize> =
        drawn.iter().flat_map(|object| &object.parts).map(|part| scene.meshes[part.mesh].material).collect();
    let mut used = BTreeSet::new();
    let names: BTreeMap<usize, String> =
        materials.iter().map(|n| (*n, identifier(&scene.materials[*n].name, &mut used))).collect();
    let mut out = UsdWriter::at_depth(1);
    out.block("def Xform \"Evidence\"", |out| {
        let mut used = BTreeSet::new();
        for object in drawn {
            let name = identifier(&object.name, &mut used);
            out.block(format_args!("def Xform \"{name}\""), |out| {
                out.transform(&(DAffine3::from_quat(file_from_world) * object.world_from_model));
                let mut used = BTreeSet::new();
                for part in &object.parts {
                    let mesh = &scene.meshes[part.mesh];
                    let material = &scene.materials[mesh.material];
                    let name = identifier(&material.name, &mut used);
                    out.line(format_args!("def Mesh \"{name}\" ("));
                    out.line("    prepend apiSchemas = [\"MaterialBindingAPI\"]");
                    out.block(")", |out| {
                        out.line(format_args!("rel material:binding = </World/Materials/{}>", names[&mesh.material]));
                        write_mesh(out, mesh, material);
                        out.transform(&(object.world_from_model.inverse() * part.world_from_mesh));
                    });
                }
            });
        }
    });
    let mut textures = BTreeSet::new();
    out.block("def Scope \"Materials\"", |out| {
        for (n, name) in &names {
            let material = &scene.materials[*n];
            textures.extend(material.base_color_texture.map(|used| used.texture));
            out.block(format_args!("def Material \"{name}\""), |out| {
                write_material(out, &format!("/World/Materials/{name}"), material, scene);
            });
        }
    });
    UsdEvidence { text: out.text, textures }
}

fn write_mesh(out: &mut UsdWriter, mesh: &Mesh, material: &Material) {
    let positions = || mesh.vertices.iter().map(|vertex| vertex.position);
    let [low, high] = positions().fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[low, high], p| {
        [std::array::from_fn(|i| low[i].min(p[i])), std::array::from_fn(|i| high[i].max(p[i]))]
    });
    out.line(format_args!("uniform bool doubleSided = {}", u8::from(material.double_sided)));
    out.line(format_args!("float3[] extent = [{}, {}]", tuple(low), tuple(high)));
    out.line(format_args!("int[] faceVertexCounts = [{}]", list(std::iter::repeat_n(3, mesh.indices.len() / 3))));
    out.line(format_args!("int[] faceVertexIndices = [{}]", list(&mesh.indices)));
    out.line(format_args!("point3f[] points = [{}]", list(positions().map(tuple))));
    out.line("uniform token subdivisionScheme = \"none\"");
    out.per_vertex("normal3f[] normals", list(mesh.vertices.iter().map(|vertex| tuple(vertex.normal))));
    let color = |of_vertex: [f32; 4]| -> [f32; 3] { std::array::from_fn(|i| material.base_color[i] * of_vertex[i]) };
    if mesh.vertices.iter().any(|vertex| vertex.color != [1.0; 4]) {
        let colors = list(mesh.vertices.iter().map(|vertex| tuple(color(vertex.color))));
        out.per_vertex("color3f[] primvars:displayColor", colors);
    } else {
        out.line(format_args!("color3f[] primvars:displayColor = [{}]", tuple(color([1.0; 4]))));
    }
    if let Some(of) = &material.base_color_texture {
        let coordinates = mesh.vertices.iter().map(|vertex| tuple(texture_coordinates(vertex.uv0, vertex.uv1, of)));
        out.per_vertex("texCoord2f[] primvars:st", list(coordinates));
    }
}

/// Coordinates with the texture's transform applied; USD's second one counts upwards.
fn texture_coordinates(uv0: [f32; 2], uv1: [f32; 2], used: &TextureUse) -> [f32; 2] {
    let [u, v] = if used.uv_set == 0 { uv0 } else { uv1 };
    let [u, v] = used.transform.map(|[a, b, c]| a * u + b * v + c);
    [u, 1.0 - v]
}

fn write_material(out: &mut UsdWriter, path: &str, material: &Material, scene: &Scene) {
    let [r, g, b, alpha] = material.base_color;
    let texture = material.base_color_texture.as_ref();
    out.line(format_args!("token outputs:surface.connect = <{path}/Surface.outputs:surface>"));
    out.block("def Shader \"Surface\"", |out| {
        out.line("uniform token info:id = \"UsdPreviewSurface\"");
        // Unlit materials emit their colour.
        let color = if material.unlit { "emissiveColor" } else { "diffuseColor" };
        match texture {
            Some(_) => out.line(format_args!("color3f inputs:{color}.connect = <{path}/BaseColor.outputs:rgb>")),
            None => out.line(format_args!("color3f inputs:{color} = {}", tuple([r, g, b]))),
        }
        if material.unlit {
            out.line("color3f inputs:diffuseColor = (0, 0, 0)");
        } else {
            out.line(format_args!("color3f inputs:emissiveColor = {}", tuple(material.emissive)));
        }
        out.line(format_args!("float inputs:metallic = {}", material.metallic));
        out.line(format_args!("float inputs:roughness = {}", material.roughness));
        match (material.alpha, texture) {
            (Alpha::Opaque, _) => {}
            (_, Some(_)) => out.line(format_args!("float inputs:opacity.connect = <{path}/BaseColor.outputs:a>")),
            (_, None) => out.line(format_args!("float inputs:opacity = {alpha}")),
        }
        if let Alpha::Mask(cutoff) = material.alpha {
            out.line(format_args!("float inputs:opacityThreshold = {cutoff}"));
        }
        out.line("token outputs:surface");
    });
    let Some(used) = texture else { return };
    out.block("def Shader \"Coordinates\"", |out| {
        out.line("uniform token info:id = \"UsdPrimvarReader_float2\"");
        out.line("string inputs:varname = \"st\"");
        out.line("float2 outputs:result");
    });
    out.block("def Shader \"BaseColor\"", |out| {
        let [wrap_s, wrap_t] = wraps(&scene.textures[used.texture]);
        out.line("uniform token info:id = \"UsdUVTexture\"");
        out.line(format_args!("asset inputs:file = @./{TEXTURE_FOLDER}/{}@", texture_file(used.texture)));
        out.line(format_args!("float4 inputs:scale = {}", tuple([r, g, b, alpha])));
        out.line("token inputs:sourceColorSpace = \"sRGB\"");
        out.line(format_args!("float2 inputs:st.connect = <{path}/Coordinates.outputs:result>"));
        out.line(format_args!("token inputs:wrapS = \"{wrap_s}\""));
        out.line(format_args!("token inputs:wrapT = \"{wrap_t}\""));
        out.line("float outputs:a");
        out.line("float3 outputs:rgb");
    });
}

fn wraps(texture: &SceneTexture) -> [&'static str; 2] {
    texture.wrap.map(|wrap| match wrap {
        Wrap::Repeat => "repeat",
        Wrap::Mirror => "mirror",
        Wrap::Clamp => "clamp",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_valid_and_unique() {
        let mut used = BTreeSet::new();
        let names = ["marker 1", "marker.1", "1", "", "é"].map(|name| identifier(name, &mut used));
        assert_eq!(names, ["marker_1", "marker_1_2", "_1", "_", "__2"]);
    }

    #[test]
    fn second_texture_coordinate_counts_upwards_after_the_transform() {
        let used = TextureUse { texture: 0, uv_set: 1, transform: [[2.0, 0.0, 0.5], [0.0, 1.0, 0.25]] };
        assert_eq!(texture_coordinates([9.0; 2], [0.25, 0.5], &used), [1.0, 0.25]);
    }
}
