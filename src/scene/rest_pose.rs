//! The rest pose of a mesh: its morph targets at their default weights (glTF 2.0, section 3.7.2.2),
//! then its skin at the joints' own transforms (section 3.7.3).

use std::collections::HashMap;
use std::rc::Rc;

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::geometry::unit_tangent;
use super::gltf::{Gltf, place};
use super::reader::{ModelReader, RestKey};
use super::schema::{Attributes, Primitive};
use super::{SceneError, Vertex};

/// The rest pose of a mesh at a node.
pub(super) struct RestPose<'a> {
    pub key: RestKey,
    /// Morph target weights.
    weights: &'a [f32],
    /// `model_from_mesh` of each joint.
    pub skin: Option<Rc<Vec<DAffine3>>>,
}

impl<'a> ModelReader<'a> {
    /// The rest pose of a mesh at a node; `model_from_node` has all nodes of the scene.
    pub fn rest(
        &mut self,
        mesh: usize,
        node: usize,
        model_from_node: &HashMap<usize, DAffine3>,
        location: &str,
    ) -> Result<RestPose<'a>, SceneError> {
        let gltf = self.gltf;
        let mesh = gltf.get(&gltf.json.meshes, "meshes", mesh, location)?;
        let node_json = &gltf.json.nodes[node];
        let has_own_weights = !node_json.weights.is_empty();
        let weights = if has_own_weights { &node_json.weights } else { &mesh.weights };
        let mut key = (None, has_own_weights.then_some(node));
        let Some(skin) = node_json.skin else { return Ok(RestPose { key, weights, skin: None }) };
        if mesh.primitives.iter().any(|p| p.attributes.joints0.is_none() || p.attributes.weights0.is_none()) {
            self.warn(format!("{location} has no JOINTS_0 or WEIGHTS_0: nodes[{node}].skin is ignored"));
            return Ok(RestPose { key, weights, skin: None });
        }
        let matrices = self.skin(skin, model_from_node, &format!("nodes[{node}].skin"))?;
        key.0 = matrices.is_some().then_some(skin);
        Ok(RestPose { key, weights, skin: matrices })
    }

    /// The joint matrices of a skin: `model_from_joint` times the inverse bind matrix. `None` if a
    /// joint is not in the scene.
    fn skin(
        &mut self,
        index: usize,
        model_from_node: &HashMap<usize, DAffine3>,
        location: &str,
    ) -> Result<Option<Rc<Vec<DAffine3>>>, SceneError> {
        if let Some(skin) = self.skins.get(&index) {
            return Ok(skin.clone());
        }
        let gltf = self.gltf;
        let skin = gltf.get(&gltf.json.skins, "skins", index, location)?;
        let count = skin.joints.len();
        let joint_from_mesh = match skin.inverse_bind_matrices {
            None => vec![DAffine3::IDENTITY; count],
            Some(accessor) => {
                let location = format!("skins[{index}].inverseBindMatrices");
                let columns = gltf.floats::<16>(accessor, &location, &["MAT4"], 0.0)?;
                if columns.len() < count {
                    return Err(gltf.bad(
                        location,
                        format!("{} matrices", columns.len()),
                        format!("{count}, one a joint"),
                    ));
                }
                columns.iter().map(|c| DAffine3::from_mat4(glam::Mat4::from_cols_array(c).as_dmat4())).collect()
            }
        };
        let joints = skin.joints.iter().map(|joint| model_from_node.get(joint));
        let matrices = joints.zip(joint_from_mesh).map(|(joint, joint_from_mesh)| Some(*joint? * joint_from_mesh));
        let matrices = matrices.collect::<Option<Vec<_>>>().map(Rc::new);
        if matrices.is_none() {
            self.warn(format!("skins[{index}] has a joint that is not in the scene: the skin is ignored"));
        }
        self.skins.insert(index, matrices.clone());
        Ok(matrices)
    }
}

impl RestPose<'_> {
    /// Applies the rest pose to the vertices of a primitive. A triangle's winding is flipped if the
    /// joints of its first vertex mirror it.
    pub fn apply(
        &self,
        gltf: &Gltf,
        primitive: &Primitive,
        vertices: &mut [Vertex],
        indices: &mut [u32],
        location: &str,
    ) -> Result<(), SceneError> {
        for (i, (target, &weight)) in primitive.targets.iter().zip(self.weights).enumerate() {
            if weight != 0.0 {
                let location = |name| format!("{location}.targets[{i}].{name}");
                displace(gltf, target.position, weight, vertices, &location("POSITION"), |v| &mut v.position)?;
                let normals = target.normal.filter(|_| primitive.attributes.normal.is_some());
                displace(gltf, normals, weight, vertices, &location("NORMAL"), |v| &mut v.normal)?;
            }
        }
        if !primitive.targets.is_empty() && self.weights.iter().any(|&weight| weight != 0.0) {
            for vertex in vertices.iter_mut() {
                vertex.normal = Vec3::from(vertex.normal).normalize_or_zero().to_array();
            }
            check_finite(gltf, vertices, &format!("{location}.targets"))?;
        }
        let Some(matrices) = &self.skin else { return Ok(()) };
        let influences = influences(gltf, &primitive.attributes, vertices.len(), location)?;
        let mut is_mirrored = Vec::with_capacity(vertices.len());
        for (vertex, influence) in vertices.iter_mut().zip(&influences) {
            let model_from_mesh = blended(gltf, matrices, influence, location)?;
            is_mirrored.push(skinned(vertex, &model_from_mesh));
        }
        check_finite(gltf, vertices, location)?;
        for triangle in indices.chunks_exact_mut(3) {
            if is_mirrored.get(triangle[0] as usize) == Some(&true) {
                triangle.swap(1, 2);
            }
        }
        Ok(())
    }
}

fn check_finite(gltf: &Gltf, vertices: &[Vertex], location: &str) -> Result<(), SceneError> {
    if vertices.iter().all(|vertex| Vec3::from(vertex.position).is_finite()) {
        return Ok(());
    }
    Err(gltf.bad(location, "a vertex whose position is not finite", "finite numbers"))
}

/// Adds a morph target's displacements.
fn displace(
    gltf: &Gltf,
    accessor: Option<usize>,
    weight: f32,
    vertices: &mut [Vertex],
    location: &str,
    of: impl Fn(&mut Vertex) -> &mut [f32; 3],
) -> Result<(), SceneError> {
    let Some(accessor) = accessor else { return Ok(()) };
    let actual_count = gltf.count(accessor, location)?;
    if actual_count != vertices.len() {
        return Err(gltf.bad(location, format!("{actual_count} elements"), format!("{}, as POSITION", vertices.len())));
    }
    for (vertex, by) in vertices.iter_mut().zip(gltf.floats::<3>(accessor, location, &["VEC3"], 0.0)?) {
        let value = of(vertex);
        *value = (Vec3::from(*value) + weight * Vec3::from(by)).to_array();
    }
    Ok(())
}

/// Joints of a vertex and their weights; unused ones have weight 0.
#[derive(Clone, Copy, Default)]
struct Influence {
    joints: [f32; 8],
    weights: [f32; 8],
}

fn influences(
    gltf: &Gltf,
    attributes: &Attributes,
    count: usize,
    location: &str,
) -> Result<Vec<Influence>, SceneError> {
    let mut influences = vec![Influence::default(); count];
    let sets = [
        (attributes.joints0, attributes.weights0, "JOINTS_0", "WEIGHTS_0"),
        (attributes.joints1, attributes.weights1, "JOINTS_1", "WEIGHTS_1"),
    ];
    for (set, (joints, weights, joints_name, weights_name)) in sets.into_iter().enumerate() {
        let (Some(joints), Some(weights)) = (joints, weights) else { continue };
        let read = |accessor, name| {
            let location = place(location, name);
            let rows = gltf.floats::<4>(accessor, &location, &["VEC4"], 0.0)?;
            if rows.len() == count {
                return Ok(rows);
            }
            Err(gltf.bad(location, format!("{} elements", rows.len()), format!("{count}, as POSITION")))
        };
        let (joints, weights) = (read(joints, joints_name)?, read(weights, weights_name)?);
        for ((row, joints), weights) in influences.iter_mut().zip(joints).zip(weights) {
            row.joints[4 * set..][..4].copy_from_slice(&joints);
            row.weights[4 * set..][..4].copy_from_slice(&weights);
        }
    }
    Ok(influences)
}

/// The weighted mean of the joint matrices. Without any weight the first joint applies.
fn blended(
    gltf: &Gltf,
    matrices: &[DAffine3],
    Influence { joints, weights }: &Influence,
    location: &str,
) -> Result<DAffine3, SceneError> {
    let matrix = |joint: f32| {
        let accepted = || format!("an index into {} joints", matrices.len());
        matrices.get(joint as usize).ok_or_else(|| gltf.bad(place(location, "JOINTS_0"), joint, accepted()))
    };
    let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    if total <= 0.0 {
        return matrix(joints[0]).copied();
    }
    let (mut matrix3, mut translation) = (DMat3::ZERO, DVec3::ZERO);
    for (&joint, &weight) in joints.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
        let share = f64::from(weight) / total;
        let of_joint = matrix(joint)?;
        matrix3 += of_joint.matrix3 * share;
        translation += of_joint.translation * share;
    }
    Ok(DAffine3 { matrix3, translation })
}

/// Transforms a vertex to the model, and returns true if that mirrors it. Its normal and tangent
/// stay of unit length or zero.
fn skinned(vertex: &mut Vertex, model_from_mesh: &DAffine3) -> bool {
    vertex.position = model_from_mesh.transform_point3(Vec3::from(vertex.position).as_dvec3()).as_vec3().to_array();
    let linear = model_from_mesh.matrix3;
    let is_mirrored = linear.determinant() < 0.0;
    // The cofactor matrix is the inverse transpose times the determinant, and exists for singular
    // matrices, too.
    let cofactors = DMat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    );
    let side = if is_mirrored { -1.0 } else { 1.0 };
    let normal = cofactors * Vec3::from(vertex.normal).as_dvec3() * side;
    vertex.normal = normal.normalize_or_zero().as_vec3().to_array();
    let [x, y, z, w] = vertex.tangent;
    let tangent = (linear * DVec3::new(x.into(), y.into(), z.into())).as_vec3();
    vertex.tangent = unit_tangent(tangent.extend(w * side as f32).to_array());
    is_mirrored
}
