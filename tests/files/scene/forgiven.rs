//! Faults in unused data, or that other programs tolerate: they cause a warning at most.

use locard::scene::{Wrap, load};
use serde_json::json;

use crate::models::{Model, corners, load_bytes, load_scene, png};

/// Loads the model, which must be the triangle, and returns its warnings.
#[track_caller]
fn warnings_of(model: &Model) -> Vec<String> {
    let scene = model.load().unwrap();
    assert_eq!(corners(&scene), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    scene.warnings
}

#[test]
fn integral_float_is_accepted_as_an_integer() {
    let mut model = Model::triangle();
    model.json["accessors"][0]["count"] = json!(3.0);
    model.json["accessors"][1]["componentType"] = json!(5123.0);
    model.json["scenes"][0]["nodes"] = json!([0.0]);
    assert_eq!(warnings_of(&model), [""; 0]);
    model.json["accessors"][0]["count"] = json!(2.5);
    assert!(model.load().unwrap_err().to_string().contains("floating point `2.5`"));
}

#[test]
fn root_below_an_unused_node_ignores_the_transform_of_that_node() {
    let mut model = Model::triangle();
    model.json["nodes"] = json!([{ "mesh": 0 }, { "children": [0], "translation": [5, 0, 0] }]);
    let warnings = warnings_of(&model);
    let text = "scenes[0].nodes has 0, a child of nodes[1]: it is placed without that node's transform";
    assert!(warnings.len() == 1 && warnings[0].ends_with(text), "{warnings:?}");
}

#[test]
fn root_listed_twice_is_placed_once() {
    let mut model = Model::triangle();
    model.json["scenes"][0]["nodes"] = json!([0, 0]);
    let warnings = warnings_of(&model);
    assert!(warnings.len() == 1 && warnings[0].contains("has 0 twice"), "{warnings:?}");
}

#[test]
fn fault_outside_the_scene_is_ignored() {
    let mut model = Model::triangle();
    // A cycle, a missing child, a rotation of length 0, a mesh without data.
    model.json["nodes"] = json!([
        { "mesh": 0 }, { "children": [2] }, { "children": [1] }, { "children": [77] },
        { "rotation": [0, 0, 0, 0] }, { "mesh": 1 },
    ]);
    let missing = json!({ "attributes": { "POSITION": 99 } });
    model.json["meshes"].as_array_mut().unwrap().push(json!({ "primitives": [missing] }));
    // An unused buffer whose file is missing.
    model.json["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": 8, "uri": "gone.bin" }));
    assert_eq!(warnings_of(&model), [""; 0]);
}

#[test]
fn indices_of_an_incomplete_triangle_are_left_out() {
    let mut model = Model::triangle();
    let indices = model.accessor(5121, "SCALAR", 5, &[0, 1, 2, 0, 1]);
    model.primitive()["indices"] = json!(indices);
    let warnings = warnings_of(&model);
    assert!(warnings.len() == 1 && warnings[0].contains("the last of 5 corners"), "{warnings:?}");
}

#[test]
fn unknown_sampler_and_material_codes_fall_back_to_defaults() {
    let mut model = Model::triangle();
    model.textured(&png(1, 1, &[255; 4]));
    model.json["samplers"] = json!([{ "wrapS": 1, "wrapT": 33071, "magFilter": 9987, "minFilter": 2 }]);
    model.json["textures"][0]["sampler"] = json!(0);
    model.json["materials"][0]["alphaMode"] = json!("Opaque");
    let scene = model.load().unwrap();
    let texture = &scene.textures[0];
    assert_eq!((texture.wrap, texture.smooth, texture.mipmaps), ([Wrap::Repeat, Wrap::Clamp], true, true));
    let warnings = scene.warnings.join("\n");
    for word in ["wrapS is 1", "magFilter is 9987", "minFilter is 2", "alphaMode is \"Opaque\""] {
        assert!(warnings.contains(word), "{word} in {warnings}");
    }
}

#[test]
fn leading_byte_order_mark_is_skipped() {
    let mut model = Model::triangle();
    model.json["buffers"][0]["uri"] = json!(format!("data:;base64,{}", base64(&model.bin)));
    let scene = load_bytes("model.gltf", format!("\u{feff}{}", model.json).as_bytes()).unwrap();
    assert_eq!(corners(&scene), Model::triangle().corners());
    let scene = load_scene("\u{feff}version = 1\nobjects = [{ model = 'triangle.glb' }]").unwrap();
    assert_eq!(scene.objects.len(), 1);
}

fn base64(bytes: &[u8]) -> String {
    use ::base64::Engine;
    ::base64::engine::general_purpose::STANDARD.encode(bytes)
}

#[test]
fn backslash_in_a_uri_is_read_as_a_slash() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = Model::triangle();
    model.textured(&png(1, 1, &[255; 4]));
    model.json["images"][0] = json!({ "uri": "pictures\\a%20b.png" });
    model.json["buffers"][0]["uri"] = json!("data\\bytes.bin");
    for name in ["data", "pictures"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    std::fs::write(folder.path().join("data/bytes.bin"), &model.bin).unwrap();
    std::fs::write(folder.path().join("pictures/a b.png"), png(1, 1, &[9; 4])).unwrap();
    let path = folder.path().join("model.gltf");
    std::fs::write(&path, model.json.to_string()).unwrap();
    let scene = load(&path, None).unwrap();
    assert_eq!(corners(&scene), Model::triangle().corners());
    assert_eq!(**scene.textures[0].rgba, [9; 4]);
    // A path on another computer is not a file beside the model.
    model.json["buffers"][0]["uri"] = json!("C:\\models\\bytes.bin");
    std::fs::write(&path, model.json.to_string()).unwrap();
    let error = load(&path, None).unwrap_err().to_string();
    assert!(error.contains("buffers[0].uri") && error.contains("a relative file name"), "{error}");
}

#[test]
fn non_finite_normal_is_computed_from_the_triangles() {
    let mut model = Model::triangle();
    let normals = [0.0, 0.0, 1.0, f32::NAN, f32::NAN, f32::NAN, 0.0, 0.0, 1.0];
    let normals = model.floats("VEC3", &normals);
    model.primitive()["attributes"]["NORMAL"] = json!(normals);
    let scene = model.load().unwrap();
    assert!(scene.meshes[0].vertices.iter().all(|vertex| vertex.normal == [0.0, 0.0, 1.0]));
    let warnings = scene.warnings.join("\n");
    assert!(warnings.contains("NORMAL: 3 numbers are not finite") && warnings.contains("1 normals"), "{warnings}");
}
