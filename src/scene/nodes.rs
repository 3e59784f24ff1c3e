//! Node hierarchy of a glTF file.

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, Mat4, Quat, Vec3};

use super::SceneError;
use super::gltf::Gltf;
use super::schema::Node;

/// Depth of nesting.
const MAX_DEPTH: usize = 512;
/// Largest accepted deviation of a matrix's last row from 0, 0, 0, 1. Ignoring it moves a point by
/// that share of its distance.
const MAX_LAST_ROW_ERROR: f64 = 1e-4;

/// The nodes of the file's scene.
pub(super) struct Tree {
    /// Node indices with their transforms in the model, parents before their children.
    pub nodes: Vec<(usize, DAffine3)>,
    pub warnings: Vec<String>,
}

/// A node to be visited.
struct NodeVisit {
    index: usize,
    parent: Option<usize>,
    level: usize,
    model_from_parent: DAffine3,
}

/// Computes the transforms of the nodes in the file's scene. A node with two parents, a cycle or
/// more than 512 levels is an error. Nodes outside the scene are not checked.
pub(super) fn placed(gltf: &Gltf) -> Result<Tree, SceneError> {
    let nodes = &gltf.json.nodes;
    let (roots, place, warnings) = roots(gltf)?;
    let step = |index| NodeVisit { index, parent: None, level: 1, model_from_parent: DAffine3::IDENTITY };
    let mut open: Vec<NodeVisit> = roots.into_iter().rev().map(step).collect();
    let mut placed = Vec::new();
    let mut is_placed = vec![false; nodes.len()];
    let mut parents = vec![None; nodes.len()];
    while let Some(NodeVisit { index, parent, level, model_from_parent }) = open.pop() {
        let above = |start: usize| std::iter::successors(Some(start), |&node| parents[node]);
        let children_of = |node: usize| format!("nodes[{node}].children");
        if std::mem::replace(&mut is_placed[index], true) {
            if parent.is_some_and(|parent| above(parent).any(|node| node == index)) {
                return Err(gltf.bad(format!("nodes[{index}]"), "a node below itself", "a tree"));
            }
            let other = parents[index].map_or(place.clone(), |other| format!("nodes[{other}]"));
            let actual = format!("{index}, which is a child of {other} already");
            return Err(gltf.bad(parent.map_or(place, children_of), actual, "one parent for each node"));
        }
        if level > MAX_DEPTH {
            let actual = format!("more than {MAX_DEPTH} nodes above it");
            return Err(gltf.bad(format!("nodes[{index}]"), actual, format!("up to {MAX_DEPTH} levels")));
        }
        parents[index] = parent;
        let node = &nodes[index];
        let model_from_node = model_from_parent * local(gltf, node, index)?;
        if !model_from_node.is_finite() {
            return Err(gltf.bad(format!("nodes[{index}]"), "a place that is not finite", "finite numbers"));
        }
        placed.push((index, model_from_node));
        // Each node has one parent, so only a file that lists a node twice has more entries.
        if open.len() + node.children.len() > 2 * nodes.len() {
            let actual = "more children than there are nodes";
            return Err(gltf.bad(children_of(index), actual, "one parent for each node"));
        }
        for &child in node.children.iter().rev() {
            gltf.get(nodes, "nodes", child, children_of(index))?;
            let (parent, level) = (Some(index), level + 1);
            open.push(NodeVisit { index: child, parent, level, model_from_parent: model_from_node });
        }
    }
    Ok(Tree { nodes: placed, warnings })
}

/// The roots of the default scene without duplicates, the name of their list, and warnings.
fn roots(gltf: &Gltf) -> Result<(Vec<usize>, String, Vec<String>), SceneError> {
    let json = &gltf.json;
    let mut parents = vec![None; json.nodes.len()];
    for (i, node) in json.nodes.iter().enumerate() {
        for &child in &node.children {
            if let Some(parent) = parents.get_mut(child) {
                *parent = Some(i);
            }
        }
    }
    if json.scene.is_none() && json.scenes.is_empty() {
        let roots = (0..parents.len()).filter(|&i| parents[i].is_none()).collect();
        return Ok((roots, "nodes".to_owned(), Vec::new()));
    }
    let index = json.scene.unwrap_or(0);
    let scene = gltf.get(&json.scenes, "scenes", index, "scene")?;
    let place = format!("scenes[{index}].nodes");
    let mut roots = Vec::with_capacity(scene.nodes.len());
    let mut warnings = Vec::new();
    let mut is_listed = vec![false; parents.len()];
    for &root in &scene.nodes {
        gltf.get(&json.nodes, "nodes", root, &place)?;
        if std::mem::replace(&mut is_listed[root], true) {
            warnings.push(format!("{place} has {root} twice: it is placed once"));
            continue;
        }
        if let Some(parent) = parents[root] {
            warnings.push(format!(
                "{place} has {root}, a child of nodes[{parent}]: it is placed without that node's transform"
            ));
        }
        roots.push(root);
    }
    Ok((roots, place, warnings))
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
        // Exporters round.
        if !last.abs_diff_eq(glam::DVec4::W, MAX_LAST_ROW_ERROR) {
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
        let actual = format!("a quaternion of length {length}");
        return Err(gltf.bad(format!("nodes[{index}].rotation"), actual, "length 1"));
    }
    let matrix3 = DMat3::from_quat(rotation.normalize()) * DMat3::from_diagonal(scale);
    Ok(DAffine3 { matrix3, translation })
}
