//! The tree of a glTF file's nodes.

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, Mat4, Quat, Vec3};

use super::SceneError;
use super::gltf::Gltf;
use super::schema::Node;

/// Depth of nesting.
const MAX_DEPTH: usize = 512;

/// The nodes of the file's scene, each with its transform in the model. A node with two parents, a cycle or more than
/// 512 levels is an error.
pub(super) fn placed(gltf: &Gltf) -> Result<Vec<(usize, DAffine3)>, SceneError> {
    let nodes = &gltf.json.nodes;
    let parents = parents(gltf)?;
    let (roots, place) = roots(gltf, &parents)?;
    let mut open: Vec<(usize, DAffine3)> = Vec::with_capacity(roots.len());
    let mut is_root = vec![false; nodes.len()];
    for index in roots {
        gltf.get(nodes, "nodes", index, &place)?;
        if let Some(parent) = parents[index] {
            return Err(gltf.bad(place, format!("{index}, a child of nodes[{parent}]"), "nodes without a parent"));
        }
        if std::mem::replace(&mut is_root[index], true) {
            return Err(gltf.bad(place, format!("{index} twice"), "each node once"));
        }
        open.push((index, DAffine3::IDENTITY));
    }
    open.reverse();
    let mut placed = Vec::new();
    while let Some((index, model_from_parent)) = open.pop() {
        let node = &nodes[index];
        let model_from_node = model_from_parent * local(gltf, node, index)?;
        if !model_from_node.is_finite() {
            return Err(gltf.bad(format!("nodes[{index}]"), "a place that is not finite", "finite numbers"));
        }
        placed.push((index, model_from_node));
        open.extend(node.children.iter().rev().map(|&child| (child, model_from_node)));
    }
    Ok(placed)
}

/// Each node's parent, after checking all of them.
fn parents(gltf: &Gltf) -> Result<Vec<Option<usize>>, SceneError> {
    let nodes = &gltf.json.nodes;
    let mut parents = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for &child in &node.children {
            let what = format!("nodes[{i}].children");
            gltf.get(nodes, "nodes", child, &what)?;
            if let Some(other) = parents[child] {
                let found = format!("{child}, which is a child of nodes[{other}] already");
                return Err(gltf.bad(what, found, "one parent for each node"));
            }
            parents[child] = Some(i);
        }
    }
    for start in 0..nodes.len() {
        let (mut at, mut depth) = (start, 1);
        while let Some(parent) = parents[at] {
            if parent == start {
                return Err(gltf.bad(format!("nodes[{start}]"), "a node below itself", "a tree"));
            }
            if depth == MAX_DEPTH {
                let found = format!("more than {MAX_DEPTH} nodes above it");
                return Err(gltf.bad(format!("nodes[{start}]"), found, format!("up to {MAX_DEPTH} levels")));
            }
            (at, depth) = (parent, depth + 1);
        }
    }
    Ok(parents)
}

/// The roots of the scene to show, and the name of their list.
fn roots(gltf: &Gltf, parents: &[Option<usize>]) -> Result<(Vec<usize>, String), SceneError> {
    let json = &gltf.json;
    let index = match json.scene {
        Some(index) => index,
        None if json.scenes.is_empty() => {
            return Ok(((0..parents.len()).filter(|&i| parents[i].is_none()).collect(), "nodes".to_owned()));
        }
        None => 0,
    };
    let scene = gltf.get(&json.scenes, "scenes", index, "scene")?;
    Ok((scene.nodes.clone(), format!("scenes[{index}].nodes")))
}

/// A node's own transform: its matrix, or translation · rotation · scale.
fn local(gltf: &Gltf, node: &Node, index: usize) -> Result<DAffine3, SceneError> {
    let not_finite = |key: &str| gltf.bad(format!("nodes[{index}].{key}"), "a number that is not finite", "finite");
    if let Some(columns) = &node.matrix {
        let matrix: DMat4 = Mat4::from_cols_array(columns).as_dmat4();
        if !matrix.is_finite() {
            return Err(not_finite("matrix"));
        }
        let last = matrix.row(3);
        if !last.abs_diff_eq(glam::DVec4::W, 1e-6) {
            return Err(gltf.bad(format!("nodes[{index}].matrix"), format!("last row {last}"), "0, 0, 0, 1"));
        }
        return Ok(DAffine3::from_mat4(matrix));
    }
    let translation: DVec3 = Vec3::from(node.translation.unwrap_or([0.0; 3])).as_dvec3();
    let scale = Vec3::from(node.scale.unwrap_or([1.0; 3])).as_dvec3();
    let rotation: DQuat = Quat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0])).as_dquat();
    if !translation.is_finite() {
        return Err(not_finite("translation"));
    }
    if !scale.is_finite() {
        return Err(not_finite("scale"));
    }
    // Exporters round: a length within one percent of 1 is normalized.
    let length = rotation.length();
    if length.is_nan() || (length - 1.0).abs() >= 0.01 {
        let found = format!("a quaternion of length {length}");
        return Err(gltf.bad(format!("nodes[{index}].rotation"), found, "length 1"));
    }
    let matrix3 = DMat3::from_quat(rotation.normalize()) * DMat3::from_diagonal(scale);
    Ok(DAffine3 { matrix3, translation })
}
