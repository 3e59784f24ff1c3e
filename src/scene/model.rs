//! Loads one glTF file: meshes, materials, textures and lights, in the file's own coordinates.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};

use super::extension;
use super::geometry::{self, PrimitiveAssembly, unit_tangent};
use super::gltf::{Gltf, place};
use super::loaded_models::{LightKind, Model, ModelLight};
use super::loader::{Loader, MAX_PARTS};
use super::reader::ModelReader;
use super::rest_pose::RestPose;
use super::schema::{Light, Primitive};
use super::{Mesh, Part, SceneError, Vertex, nodes};

/// True if a file is a model, by its extension.
pub fn is_model(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
}

/// A model, loaded on first use; `needed_by` is the scene file that references it.
pub(super) fn load(loader: &mut Loader, file: &Path, needed_by: Option<&Path>) -> Result<Rc<Model>, SceneError> {
    if let Some(model) = loader.models.get(file) {
        return Ok(Rc::clone(model));
    }
    if let Some(kept) = loader.insert_loaded(file) {
        loader.models.insert(file.to_owned(), Rc::clone(&kept));
        return Ok(kept);
    }
    let start = loader.counts();
    let model = Rc::new(read(loader, file, needed_by)?);
    if model.parts.is_empty() {
        loader.warn(file, "it has nothing visible".to_owned());
    }
    loader.store(file, &model, start);
    loader.models.insert(file.to_owned(), Rc::clone(&model));
    Ok(model)
}

/// Loads a model; `needed_by` is the scene file that references it.
fn read(loader: &mut Loader, file: &Path, needed_by: Option<&Path>) -> Result<Model, SceneError> {
    let gltf = &Gltf::open(file, needed_by)?;
    loader.scene.files.extend(gltf.files());
    let mut reader = ModelReader {
        gltf,
        loader,
        materials: HashMap::new(),
        textures: HashMap::new(),
        images: HashMap::new(),
        meshes: HashMap::new(),
        skins: HashMap::new(),
    };
    reader.warn_of_ignored_content();
    reader.read()
}

impl ModelReader<'_> {
    /// Adds a warning once, with the file's name.
    pub fn warn(&mut self, text: String) {
        self.loader.warn(&self.gltf.file, text);
    }

    fn warn_of_ignored_content(&mut self) {
        let json = &self.gltf.json;
        for (kind, count) in [("animation", json.animations.len()), ("a camera", json.cameras.len())] {
            if count > 0 {
                self.warn(format!("{kind} is not supported: ignored"));
            }
        }
        for name in json.extensions_used.iter().filter(|name| !extension::is_supported(name)) {
            let text = format!("the extension {name} is not supported: ignored");
            self.warn(extension::with_conversion(text, name, &self.gltf.file));
        }
    }

    fn read(mut self) -> Result<Model, SceneError> {
        let gltf = self.gltf;
        let (mut parts, mut lights) = (Vec::new(), Vec::new());
        let tree = nodes::placed(gltf)?;
        tree.warnings.into_iter().for_each(|warning| self.warn(warning));
        let nodes = tree.nodes.iter().copied();
        let joint_places = if gltf.json.skins.is_empty() { HashMap::new() } else { nodes.collect() };
        for &(index, model_from_node) in &tree.nodes {
            let node = &gltf.json.nodes[index];
            if let Some(mesh) = node.mesh {
                let location = format!("nodes[{index}].mesh");
                let rest = self.rest(mesh, index, &joint_places, &location)?;
                // glTF 2.0, section 3.7.3.1: only the joints place a skinned mesh.
                let model_from_mesh = if rest.skin.is_some() { DAffine3::IDENTITY } else { model_from_node };
                if model_from_mesh.matrix3.determinant() == 0.0 {
                    self.warn(format!("nodes[{index}] is scaled to nothing along an axis: its mesh is left out"));
                } else {
                    let meshes = self.mesh(mesh, &rest, &location)?;
                    if parts.len() + meshes.len() > MAX_PARTS {
                        return Err(gltf.bad("nodes", "more placed meshes", format!("up to {MAX_PARTS}")));
                    }
                    parts.extend(meshes.into_iter().map(|mesh| Part { mesh, world_from_mesh: model_from_mesh }));
                }
            }
            if let Some(light) = &node.extensions.light {
                let location = format!("nodes[{index}].extensions.KHR_lights_punctual.light");
                let list = &gltf.json.extensions.lights.lights;
                let light = gltf.get(list, "lights", light.light, &location);
                match light.and_then(|light| self.light(light, model_from_node, &location)) {
                    Ok(light) => lights.push(light),
                    Err(error) => self.loader.warn_verbatim(format!("{error}; this light is left out")),
                }
            }
        }
        Ok(Model { parts, lights })
    }

    /// The scene's meshes for a mesh of the file, one per primitive.
    fn mesh(&mut self, index: usize, rest: &RestPose<'_>, location: &str) -> Result<Vec<usize>, SceneError> {
        let key = (index, rest.key);
        if let Some(mesh) = self.meshes.get(&key) {
            return Ok(mesh.clone());
        }
        let gltf = self.gltf;
        let mut meshes = Vec::new();
        for (i, primitive) in gltf.get(&gltf.json.meshes, "meshes", index, location)?.primitives.iter().enumerate() {
            if let Some(mesh) = self.primitive(primitive, rest, &format!("meshes[{index}].primitives[{i}]"))? {
                self.loader.scene.meshes.push(Arc::new(mesh));
                meshes.push(self.loader.scene.meshes.len() - 1);
            }
        }
        self.meshes.insert(key, meshes.clone());
        Ok(meshes)
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        rest: &RestPose<'_>,
        location: &str,
    ) -> Result<Option<Mesh>, SceneError> {
        let gltf = self.gltf;
        let assembly = match primitive.mode.unwrap_or(4) {
            4 => PrimitiveAssembly::List,
            5 => PrimitiveAssembly::Strip,
            6 => PrimitiveAssembly::Fan,
            0..=3 => {
                self.warn("points and lines are not supported: ignored".to_owned());
                return Ok(None);
            }
            other => return Err(gltf.bad(format!("{location}.mode"), other, "0 to 6")),
        };
        let Some(position) = primitive.attributes.position else {
            self.warn(format!("{location} has no POSITION: ignored"));
            return Ok(None);
        };
        let position_place = place(location, "POSITION");
        if !gltf.has_bytes(position, &position_place)? {
            gltf.only_in_extension(location, &primitive.extensions, "positions in an accessor with a bufferView")?;
        }
        let vertices = gltf.count(position, &position_place)?;
        let corners = match primitive.indices {
            Some(index) => gltf.count(index, &format!("{location}.indices"))?,
            None => vertices,
        };
        if assembly == PrimitiveAssembly::List && corners % 3 != 0 {
            self.warn(format!("{location}: the last of {corners} corners make no triangle: left out"));
        }
        let material = self.material(primitive.material, &format!("{location}.material"))?;
        let unlit = self.loader.scene.materials[material].unlit;
        // Without normals, triangles do not share vertices, except for unlit materials, which use
        // no normals.
        let flat = primitive.attributes.normal.is_none() && !unlit;
        let triangles = if assembly == PrimitiveAssembly::List { corners } else { corners.saturating_mul(3) };
        let made = vertices.max(if flat { triangles } else { 0 });
        self.loader.count_geometry(&gltf.file, location, made, triangles)?;

        let mut vertices = self.vertices(primitive, position, location)?;
        let indices = match primitive.indices {
            Some(index) => gltf.indices(index, &format!("{location}.indices"), vertices.len())?,
            None => (0..vertices.len() as u32).collect(),
        };
        let mut indices = geometry::triangles(assembly, indices);
        rest.apply(gltf, primitive, &mut vertices, &mut indices, location)?;
        if indices.is_empty() {
            self.warn(format!("{location} has no triangles: ignored"));
            return Ok(None);
        }
        if flat {
            (vertices, indices) = geometry::flat_shaded(&vertices, &indices);
        } else {
            let missing = vertices.iter().filter(|v| v.normal == [0.0; 3]).count();
            if missing > 0 {
                geometry::fill_normals(&mut vertices, &indices);
                if primitive.attributes.normal.is_some() {
                    self.warn(format!("{location}: {missing} normals have no length: computed from the triangles"));
                }
            }
        }
        self.tangents(primitive, material, &mut vertices, &mut indices, location);
        self.warn_of_missing_uv(primitive, material, location);
        Ok(Some(Mesh { vertices, indices, material }))
    }

    /// The attributes of all vertices; normals of unit length or zero.
    fn vertices(&mut self, primitive: &Primitive, position: usize, location: &str) -> Result<Vec<Vertex>, SceneError> {
        let attributes = &primitive.attributes;
        let positions = self.gltf.floats::<3>(position, &place(location, "POSITION"), &["VEC3"], 0.0)?;
        let count = positions.len();
        let normals = self.attribute::<3>(attributes.normal, location, "NORMAL", &["VEC3"], count)?;
        // glTF 2.0, section 3.7.2.1: without normals, tangents are to be ignored.
        let tangents = attributes.tangent.filter(|_| normals.is_some());
        let tangents = self.attribute::<4>(tangents, location, "TANGENT", &["VEC4"], count)?;
        let uv0 = self.attribute::<2>(attributes.uv0, location, "TEXCOORD_0", &["VEC2"], count)?;
        let uv1 = self.attribute::<2>(attributes.uv1, location, "TEXCOORD_1", &["VEC2"], count)?;
        let colors = self.attribute::<4>(attributes.color, location, "COLOR_0", &["VEC3", "VEC4"], count)?;
        let vertex = |(i, position)| Vertex {
            position,
            normal: normals.as_ref().map_or(Vec3::ZERO, |n| Vec3::from(n[i]).normalize_or_zero()).to_array(),
            tangent: tangents.as_ref().map_or([0.0; 4], |t| unit_tangent(t[i])),
            uv0: uv0.as_ref().map_or([0.0; 2], |uv| uv[i]),
            uv1: uv1.as_ref().map_or([0.0; 2], |uv| uv[i]),
            color: colors.as_ref().map_or([1.0; 4], |c| c[i]),
        };
        Ok(positions.into_iter().enumerate().map(vertex).collect())
    }

    /// An attribute other than the position. Non-finite numbers are replaced by 0, with a warning.
    fn attribute<const N: usize>(
        &mut self,
        index: Option<usize>,
        location: &str,
        name: &str,
        shapes: &[&str],
        count: usize,
    ) -> Result<Option<Vec<[f32; N]>>, SceneError> {
        let Some(index) = index else { return Ok(None) };
        let location = place(location, name);
        let actual_count = self.gltf.count(index, &location)?;
        if actual_count != count {
            return Err(self.gltf.bad(location, format!("{actual_count} elements"), format!("{count}, as POSITION")));
        }
        let mut rows = self.gltf.numbers(index, &location, shapes, 1.0)?;
        let odd = rows.as_flattened_mut().iter_mut().filter(|value| !value.is_finite());
        let odd = odd.map(|value| *value = 0.0).count();
        if odd > 0 {
            self.warn(format!("{location}: {odd} numbers are not finite: 0 is used"));
        }
        Ok(Some(rows))
    }

    /// Tangents if the material has a normal map, otherwise none.
    fn tangents(
        &mut self,
        primitive: &Primitive,
        material: usize,
        vertices: &mut Vec<Vertex>,
        indices: &mut [u32],
        location: &str,
    ) {
        let Some(map) = self.loader.scene.materials[material].normal_texture else {
            vertices.iter_mut().for_each(|v| v.tangent = [0.0; 4]);
            return;
        };
        let attributes = &primitive.attributes;
        if attributes.tangent.is_some() && attributes.normal.is_some() {
            if vertices.iter().all(|v| v.tangent != [0.0; 4]) {
                return;
            }
            self.warn(format!("{location}: some tangents have no length: all are recomputed"));
        }
        geometry::tangents(vertices, indices, &map);
    }

    fn warn_of_missing_uv(&mut self, primitive: &Primitive, material: usize, location: &str) {
        let m = &self.loader.scene.materials[material];
        let uses = [
            m.base_color_texture,
            m.metallic_roughness_texture,
            m.normal_texture,
            m.occlusion_texture,
            m.emissive_texture,
        ];
        let there = [primitive.attributes.uv0.is_some(), primitive.attributes.uv1.is_some()];
        if let Some(set) = uses.iter().flatten().map(|t| t.uv_set).find(|&set| !there[set as usize & 1]) {
            self.warn(format!("{location} has no TEXCOORD_{set}, which its material uses: 0, 0 is used"));
        }
    }

    fn light(&mut self, light: &Light, model_from_light: DAffine3, location: &str) -> Result<ModelLight, SceneError> {
        let gltf = self.gltf;
        let bad = |key: &str, actual: &dyn std::fmt::Display, accepted: &str| {
            gltf.bad(format!("{location} -> {key}"), actual, accepted)
        };
        let color = match *light.color {
            [] => Vec3::ONE,
            [red, green, blue] => Vec3::new(red, green, blue),
            _ => return Err(bad("color", &format!("{} numbers", light.color.len()), "red, green and blue")),
        };
        let color = color * light.intensity.unwrap_or(1.0);
        if !color.is_finite() || color.min_element() < 0.0 {
            return Err(bad("color · intensity", &color, "0 or more"));
        }
        let range_m = light.range.unwrap_or(f32::INFINITY);
        if range_m.is_nan() || range_m <= 0.0 {
            return Err(bad("range", &range_m, "more than 0"));
        }
        let kind = match light.kind.as_str() {
            "directional" => LightKind::Directional,
            "point" => LightKind::Point { range_m, spot: None },
            "spot" => {
                let inner = light.spot.inner_cone_angle.unwrap_or(0.0);
                let outer = light.spot.outer_cone_angle.unwrap_or(FRAC_PI_4);
                let widest = outer.clamp(0.0, FRAC_PI_2);
                let angles = [inner.clamp(0.0, widest), widest].map(|angle| angle as f32);
                // Exporters round π/2.
                if !(0.0 <= inner && inner < outer && outer <= FRAC_PI_2 + 1e-6) {
                    let [inner_used, outer_used] = angles;
                    self.warn(format!(
                        "{location} -> spot: inner {inner}, outer {outer}, which are not 0 ≤ inner < outer ≤ π/2: \
                         {inner_used} and {outer_used} are used"
                    ));
                }
                LightKind::Point { range_m, spot: Some(angles) }
            }
            other => return Err(bad("type", &other, "directional, point or spot")),
        };
        if model_from_light.transform_vector3(DVec3::Z).try_normalize().is_none() {
            return Err(bad("its node", &"a scale of 0", "a light that has a direction"));
        }
        Ok(ModelLight { model_from_light, color, kind })
    }
}
