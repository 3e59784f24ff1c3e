//! Models with skins and morph targets in their rest pose.

use serde_json::{Value, json};

use crate::models::{Model, corners};

/// A translation matrix, column by column.
fn translation(x: f32, y: f32, z: f32) -> [f32; 16] {
    [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0]
}

/// The triangle skinned to joints at nodes 1, 2 and so on. Its own node is translated, which must
/// not affect a skin.
fn skinned(joints: &[Value], inverse_bind: &[[f32; 16]], influences: [[u8; 4]; 3], weights: [[f32; 4]; 3]) -> Model {
    let mut model = Model::triangle();
    let mut nodes = vec![json!({ "mesh": 0, "skin": 0, "translation": [0, 0, 50] })];
    nodes.extend_from_slice(joints);
    let names: Vec<usize> = (1..nodes.len()).collect();
    model.json["scenes"] = json!([{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }]);
    model.json["nodes"] = json!(nodes);
    let joints = model.accessor(5121, "VEC4", 3, influences.as_flattened());
    let weights = model.floats("VEC4", weights.as_flattened());
    model.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    model.primitive()["attributes"]["WEIGHTS_0"] = json!(weights);
    let bytes: Vec<u8> = inverse_bind.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let matrices = model.accessor(5126, "MAT4", inverse_bind.len(), &bytes);
    model.json["skins"] = json!([{ "joints": names, "inverseBindMatrices": matrices }]);
    model
}

const FIRST: [[f32; 4]; 3] = [[1.0, 0.0, 0.0, 0.0]; 3];

#[test]
fn skinned_mesh_is_placed_by_joint_and_inverse_bind_matrix() {
    let joint = json!({ "translation": [0, 3, 0], "scale": [2, 2, 2] });
    let model = skinned(&[joint], &[translation(-0.5, 0.0, 0.0)], [[0; 4]; 3], FIRST);
    let scene = model.load().unwrap();
    assert_eq!(corners(&scene), [[-1.0, 3.0, 0.0], [3.0, 3.0, 0.0], [-1.0, 5.0, 0.0]]);
    assert_eq!(scene.meshes[0].vertices[0].normal, [0.0, 0.0, 1.0]);
    assert_eq!(scene.warnings, [""; 0]);
}

#[test]
fn vertex_with_two_joints_is_interpolated() {
    let joints = [json!({}), json!({ "translation": [0, 0, 8] })];
    let weights = [[1.0, 0.0, 0.0, 0.0], [0.25, 0.75, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0]];
    let model = skinned(&joints, &[translation(0.0, 0.0, 0.0); 2], [[0, 1, 0, 0]; 3], weights);
    assert_eq!(model.corners(), [[0.0, 0.0, 0.0], [2.0, 0.0, 6.0], [0.0, 1.0, 8.0]]);
}

#[test]
fn mirroring_joint_keeps_the_winding_outward() {
    let model = skinned(&[json!({ "scale": [-1, 1, 1] })], &[translation(0.0, 0.0, 0.0)], [[0; 4]; 3], FIRST);
    let scene = model.load().unwrap();
    assert_eq!(corners(&scene), [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-2.0, 0.0, 0.0]]);
    assert_eq!(scene.meshes[0].vertices[0].normal, [0.0, 0.0, 1.0]);
    // The triangle follows only the second joint.
    let joints = [json!({ "scale": [-1, 1, 1] }), json!({})];
    let model = skinned(&joints, &[translation(0.0, 0.0, 0.0); 2], [[1, 0, 0, 0]; 3], FIRST);
    assert_eq!(model.corners(), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
}

#[test]
fn unusable_skin_leaves_the_mesh_at_its_node() {
    let unskinned = [[0.0, 0.0, 50.0], [2.0, 0.0, 50.0], [0.0, 1.0, 50.0]];
    let model = || skinned(&[json!({})], &[translation(7.0, 0.0, 0.0)], [[0; 4]; 3], FIRST);
    let mut outside = model();
    outside.json["scenes"] = json!([{ "nodes": [0] }]);
    let mut without_weights = model();
    without_weights.primitive()["attributes"].as_object_mut().unwrap().remove("WEIGHTS_0");
    for (model, word) in [(outside, "not in the scene"), (without_weights, "no JOINTS_0 or WEIGHTS_0")] {
        let scene = model.load().unwrap();
        assert_eq!(corners(&scene), unskinned);
        assert!(scene.warnings.len() == 1 && scene.warnings[0].contains(word), "{:?}", scene.warnings);
    }
    // A missing joint damages drawn data, so it is an error.
    let error =
        skinned(&[json!({})], &[translation(0.0, 0.0, 0.0)], [[9; 4]; 3], FIRST).load().unwrap_err().to_string();
    assert!(error.contains("JOINTS_0") && error.contains("found 9"), "{error}");
}

#[test]
fn morph_targets_apply_by_their_default_weights() {
    let mut model = Model::triangle();
    let target = model.floats("VEC3", &[0.0, 0.0, 4.0].repeat(3));
    model.primitive()["targets"] = json!([{ "POSITION": target }]);
    assert_eq!(model.corners(), Model::triangle().corners());
    model.json["meshes"][0]["weights"] = json!([0.5]);
    assert_eq!(model.corners(), [[0.0, 0.0, 2.0], [2.0, 0.0, 2.0], [0.0, 1.0, 2.0]]);
    // A node's own weights take precedence; the same mesh is used twice.
    model.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0, "weights": [0.25] }]);
    model.json["scenes"][0]["nodes"] = json!([0, 1]);
    let heights: Vec<f64> = model.corners().iter().map(|corner| corner[2]).collect();
    assert_eq!(heights, [2.0, 2.0, 2.0, 1.0, 1.0, 1.0]);
    model.json["meshes"][0]["weights"] = json!([1e39]);
    let error = model.load().unwrap_err().to_string();
    assert!(error.contains(".targets") && error.contains("a vertex whose position is not finite"), "{error}");
}
