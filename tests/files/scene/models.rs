//! Small models with results computed by hand.

use locard::scene::{Alpha, Wrap};
use serde_json::json;

use crate::models::{Model, corners, load_bytes, png};

const RED: [u8; 4] = [255, 0, 0, 255];

#[test]
fn single_triangle_keeps_its_coordinates() {
    let scene = Model::triangle().load().unwrap();
    assert_eq!(corners(&scene), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let mesh = &scene.meshes[0];
    assert_eq!((mesh.vertices.len(), mesh.indices.len()), (3, 3));
    assert_eq!(mesh.vertices[0].normal, [0.0, 0.0, 1.0]);
    assert_eq!(mesh.vertices[0].color, [1.0; 4]);
    assert_eq!(scene.objects[0].name, "model");
    assert_eq!(scene.warnings, [""; 0]);
}

#[test]
fn transforms_of_nested_nodes_are_multiplied() {
    let mut model = Model::triangle();
    // A quarter turn about z and a doubled y, below a translation, below a matrix that mirrors x.
    model.json["scenes"] = json!([{ "nodes": [2] }]);
    model.json["nodes"] = json!([
        { "mesh": 0, "rotation": [0.0, 0.0, 0.5f64.sqrt(), 0.5f64.sqrt()], "scale": [1, 2, 1] },
        { "children": [0], "translation": [10, 0, 0] },
        { "children": [1], "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 0.99999] },
    ]);
    assert_eq!(model.corners(), [[-10.0, 0.0, 5.0], [-10.0, 2.0, 5.0], [-8.0, 0.0, 5.0]]);
    let scene = model.load().unwrap();
    assert!(scene.objects[0].parts[0].world_from_mesh.matrix3.determinant() < 0.0);
}

#[test]
fn file_without_scenes_shows_all_roots() {
    let mut model = Model::triangle();
    model.json["scenes"].take();
    model.json.as_object_mut().unwrap().remove("scenes");
    model.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0, "translation": [0, 0, 1] }]);
    let scene = model.load().unwrap();
    assert_eq!(scene.meshes.len(), 1, "a mesh placed twice is one mesh");
    assert_eq!(scene.objects[0].parts.len(), 2);
}

#[test]
fn strips_fans_and_lists_of_a_square_agree() {
    let square = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    for (mode, order) in [(5, [0u8, 1, 2, 3]), (6, [0, 1, 3, 2])] {
        let mut model = Model::triangle();
        let position = model.floats("VEC3", &square);
        let indices = model.accessor(5121, "SCALAR", 4, &order);
        *model.primitive() = json!({ "attributes": { "POSITION": position }, "indices": indices, "mode": mode });
        let scene = model.load().unwrap();
        assert_eq!(scene.meshes[0].indices.len(), 6, "mode {mode}");
        assert!(scene.meshes[0].vertices.iter().all(|v| v.normal == [0.0, 0.0, 1.0]), "mode {mode}");
        let mut points = corners(&scene);
        points.sort_by(|a, b| a.partial_cmp(b).unwrap());
        points.dedup();
        assert_eq!(points.len(), 4, "mode {mode}");
    }
}

#[test]
fn points_and_lines_are_left_out_with_one_warning() {
    let mut model = Model::triangle();
    let triangle = model.primitive().clone();
    let mut points = triangle.clone();
    points["mode"] = json!(0);
    model.json["meshes"][0]["primitives"] = json!([points, triangle, points]);
    let scene = model.load().unwrap();
    assert_eq!(scene.meshes.len(), 1);
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(scene.warnings[0].contains("points and lines are not supported"));
}

#[test]
fn unsupported_features_are_warned_of_once() {
    let mut model = Model::triangle();
    model.json["animations"] = json!([{ "channels": [], "samplers": [] }, { "channels": [], "samplers": [] }]);
    model.json["cameras"] = json!([{ "type": "perspective" }]);
    model.json["extensionsUsed"] = json!(["KHR_materials_clearcoat", "KHR_materials_unlit"]);
    let warnings = model.load().unwrap().warnings.join("\n");
    for word in ["animation", "camera", "KHR_materials_clearcoat"] {
        assert_eq!(warnings.matches(word).count(), 1, "{word} in {warnings}");
    }
    assert!(!warnings.contains("unlit"));
}

#[test]
fn integers_interleaved_and_sparse_elements_are_read() {
    let mut model = Model::triangle();
    // Two unsigned bytes of uv and a colour of three shorts in steps of 12 bytes.
    let mut bytes = Vec::new();
    for row in [[0u8, 255], [51, 0], [255, 255]] {
        bytes.extend(row);
        bytes.extend([0, 0]);
        bytes.extend([65535u16, 0, 13107].iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend([0, 0]);
    }
    let uv = model.accessor(5121, "VEC2", 3, &bytes);
    let view = model.json["accessors"][uv]["bufferView"].as_u64().unwrap() as usize;
    model.json["bufferViews"][view]["byteStride"] = json!(12);
    model.json["accessors"][uv]["normalized"] = json!(true);
    let color = json!({ "bufferView": view, "byteOffset": 4, "componentType": 5123, "type": "VEC3", "count": 3, "normalized": true });
    model.json["accessors"].as_array_mut().unwrap().push(color);
    // The third position moves to (0, 3, 0).
    let index = model.view(&[2]);
    let value: Vec<u8> = [0.0f32, 3.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let value = model.view(&value);
    model.json["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": { "bufferView": index, "componentType": 5121 }, "values": { "bufferView": value },
    });
    model.primitive()["attributes"]["TEXCOORD_1"] = json!(uv);
    model.primitive()["attributes"]["COLOR_0"] = json!(uv + 1);
    let scene = model.load().unwrap();
    let vertices = &scene.meshes[0].vertices;
    assert_eq!(vertices[1].uv1, [0.2, 0.0]);
    assert_eq!(vertices[2].uv1, [1.0, 1.0]);
    assert_eq!(vertices[2].color, [1.0, 0.0, 0.2, 1.0]);
    assert_eq!(corners(&scene)[2], [0.0, 3.0, 0.0]);
}

#[test]
fn image_used_as_colour_and_data_gives_two_textures_sharing_memory() {
    let mut model = Model::triangle();
    model.textured(&png(1, 2, &[RED, [0, 255, 0, 128]].concat()));
    let pbr = &mut model.json["materials"][0]["pbrMetallicRoughness"];
    pbr["metallicRoughnessTexture"] = json!({ "index": 0 });
    model.json["materials"][0]["emissiveTexture"] = json!({ "index": 0 });
    model.json["textures"][0]["sampler"] = json!(0);
    model.json["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9729 }]);
    let scene = model.load().unwrap();
    let material = &scene.materials[0];
    assert_eq!(scene.textures.len(), 2);
    let color = material.base_color_texture.unwrap().texture;
    let data = material.metallic_roughness_texture.unwrap().texture;
    assert_eq!(material.emissive_texture.unwrap().texture, color);
    assert!(scene.textures[color].srgb && !scene.textures[data].srgb);
    assert!(std::sync::Arc::ptr_eq(&scene.textures[color].rgba, &scene.textures[data].rgba));
    let texture = &scene.textures[color];
    assert_eq!(**texture.rgba, [RED, [0, 255, 0, 128]].concat());
    assert_eq!(texture.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert!(!texture.smooth && !texture.mipmaps);
}

#[test]
fn texture_transforms_scale_then_rotate_then_translate() {
    let mut model = Model::triangle();
    model.textured(&png(1, 1, &RED));
    model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = json!({
        "KHR_texture_transform": {
            "offset": [0.5, 0.25], "rotation": std::f64::consts::FRAC_PI_2, "scale": [2, 3], "texCoord": 1,
        },
    });
    let uv = model.primitive()["attributes"]["TEXCOORD_0"].clone();
    model.primitive()["attributes"]["TEXCOORD_1"] = uv;
    let scene = model.load().unwrap();
    let used = scene.materials[0].base_color_texture.unwrap();
    assert_eq!(used.uv_set, 1);
    // A quarter turn counter-clockwise on a picture whose v points down: (u, v) → (v, −u).
    let expected = [[0.0, 3.0, 0.5], [-2.0, 0.0, 0.25]];
    for (actual, expected) in used.transform.as_flattened().iter().zip(expected.as_flattened()) {
        assert!((actual - expected).abs() < 1e-6, "{:?}", used.transform);
    }
}

#[test]
fn materials_are_read_completely() {
    let mut model = Model::triangle();
    model.json["materials"] = json!([{
        "name": "glass", "doubleSided": true, "alphaMode": "MASK", "alphaCutoff": 0.3,
        "emissiveFactor": [1, 0.5, 0],
        "pbrMetallicRoughness": { "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 1.5 },
        "extensions": { "KHR_materials_unlit": {}, "KHR_materials_emissive_strength": { "emissiveStrength": 8 } },
    }]);
    model.primitive()["material"] = json!(0);
    let scene = model.load().unwrap();
    let material = &scene.materials[0];
    assert_eq!(material.emissive, [8.0, 4.0, 0.0]);
    assert_eq!(material.base_color, [0.1, 0.2, 0.3, 0.4]);
    assert_eq!((material.metallic, material.roughness), (0.5, 1.0));
    assert_eq!(material.alpha, Alpha::Mask(0.3));
    assert!(material.unlit && material.double_sided);
    assert!(scene.warnings[0].contains("roughnessFactor is 1.5, outside 0 to 1: 1 is used"), "{:?}", scene.warnings);
}

#[test]
fn tangents_exist_only_with_a_normal_map() {
    let mut model = Model::triangle();
    model.textured(&png(1, 1, &RED));
    assert_eq!(model.load().unwrap().meshes[0].vertices[0].tangent, [0.0; 4]);
    model.json["materials"][0]["normalTexture"] = json!({ "index": 0, "scale": 0.5 });
    let scene = model.load().unwrap();
    assert_eq!(scene.meshes[0].vertices[0].tangent, [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(scene.materials[0].normal_scale, 0.5);
    // The file's own tangents are used, normalised, if it has normals and a normal map too.
    let tangent = model.floats("VEC4", &[0.0, 3.0, 0.0, -1.0].repeat(3));
    model.primitive()["attributes"]["TANGENT"] = json!(tangent);
    assert_eq!(model.load().unwrap().meshes[0].vertices[0].tangent, [1.0, 0.0, 0.0, 1.0]);
    let normal = model.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    model.primitive()["attributes"]["NORMAL"] = json!(normal);
    assert_eq!(model.load().unwrap().meshes[0].vertices[0].tangent, [0.0, 1.0, 0.0, -1.0]);
    model.json["materials"][0].as_object_mut().unwrap().remove("normalTexture");
    assert_eq!(model.load().unwrap().meshes[0].vertices[0].tangent, [0.0; 4]);
}

#[test]
fn gltf_reads_neighbouring_files_and_data_uris() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = Model::triangle();
    model.json["buffers"][0]["uri"] = json!("the%20bytes.bin");
    std::fs::write(folder.path().join("the bytes.bin"), &model.bin).unwrap();
    let path = folder.path().join("model.gltf");
    std::fs::write(&path, model.json.to_string()).unwrap();
    assert_eq!(corners(&locard::scene::load(&path, None).unwrap()), Model::triangle().corners());
    // Three bytes of zeros make four letters A; all positions are 0, the indices are 0.
    let text = "A".repeat(model.bin.len() / 3 * 4);
    model.json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{text}"));
    model.json["buffers"][0]["byteLength"] = json!(42);
    let scene = load_bytes("model.gltf", model.json.to_string().as_bytes()).unwrap();
    assert_eq!(corners(&scene), [[0.0; 3]; 3]);
}

#[test]
fn unlit_models_without_normals_keep_shared_vertices() {
    let mut model = Model::triangle();
    let indices = model.accessor(5121, "SCALAR", 6, &[0, 1, 2, 2, 1, 0]);
    model.primitive()["indices"] = json!(indices);
    assert_eq!(model.load().unwrap().meshes[0].vertices.len(), 6);
    model.json["materials"] = json!([{ "extensions": { "KHR_materials_unlit": {} } }]);
    model.primitive()["material"] = json!(0);
    assert_eq!(model.load().unwrap().meshes[0].vertices.len(), 3);
}
