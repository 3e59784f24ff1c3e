//! Refused files, each with a message of one line that names the fault and its location.

use serde_json::{Value, json};

use crate::models::{Model, load_bytes, load_scene, png, png_header};

/// Loads the model after a change and asserts an error that contains all the words.
#[track_caller]
fn refused(change: impl FnOnce(&mut Model), words: &[&str]) {
    let mut model = Model::triangle();
    change(&mut model);
    let error = model.load().map(|_| ()).expect_err("this must be refused").to_string();
    for word in words.iter().chain(&["model.glb"]) {
        assert!(error.contains(word), "{word:?} is not in: {error}");
    }
    assert!(!error.contains('\n'), "{error}");
}

#[track_caller]
fn refused_json(place: &str, value: Value, words: &[&str]) {
    refused(|model| *model.json.pointer_mut(place).unwrap() = value, words);
}

#[test]
fn truncated_file_is_refused() {
    let whole = Model::triangle().glb();
    for length in [0, 3, 4, 11, 12, 19, 20, 100, whole.len() - 1] {
        let error = load_bytes("model.glb", &whole[..length]).expect_err("truncated").to_string();
        assert!(error.contains("model.glb"), "{error}");
    }
    let error = load_bytes("model.glb", &whole[..whole.len() - 1]).expect_err("truncated").to_string();
    let sizes = format!("{} of {} bytes", whole.len() - 1, whole.len());
    assert!(error.ends_with(&format!("model.glb is incomplete ({sizes}); copy or download it again")), "{error}");
}

#[test]
fn accessor_or_view_out_of_range_is_refused() {
    refused_json(
        "/meshes/0/primitives/0/attributes/POSITION",
        json!(7),
        &["meshes[0].primitives[0].attributes.POSITION", "found 7", "an index into 2 accessors"],
    );
    refused_json("/meshes/0/primitives/0/indices", json!(4_294_967_296u64), &["indices: found 4294967296"]);
    refused_json("/accessors/0/count", json!(6), &["POSITION (accessors[0])", "6 elements of 12 bytes"]);
}

/// Entries of a few bytes each, which used to take a hundred times that in memory.
#[test]
fn oversized_lists_are_refused() {
    refused_json("/nodes", json!(vec![json!({}); (1 << 20) + 1]), &["the glTF JSON", "more than 1048576 entries"]);
    let materials = json!(vec![json!({}); (1 << 16) + 1]);
    refused(|m| m.json["materials"] = materials, &["the glTF JSON", "more than 65536 entries"]);
}

#[test]
fn overflowing_sizes_are_refused() {
    let max = json!(u64::MAX);
    refused_json("/bufferViews/0/byteOffset", max.clone(), &["bufferViews[0]", "buffers[0]"]);
    refused_json("/bufferViews/0/byteLength", max.clone(), &["bufferViews[0]"]);
    refused_json("/bufferViews/0/buffer", json!(3), &["bufferViews[0].buffer", "found 3"]);
    refused_json("/accessors/1/count", json!(u64::MAX / 3 * 3), &["up to 16777216 and 67108864"]);
    refused(|m| m.json["accessors"][0]["byteOffset"] = max, &["POSITION"]);
    refused(|m| m.json["bufferViews"][0]["byteStride"] = json!(0), &["byteStride", "4 to 252"]);
    refused(|m| m.json["bufferViews"][0]["byteStride"] = json!(8), &["a byteStride of 8", "12 or more"]);
    refused_json("/buffers/0/byteLength", json!(1u64 << 40), &["buffers[0]", "byteLength"]);
    refused(
        |m| m.json["accessors"][0] = json!({ "componentType": 5126, "type": "VEC3", "count": 3_000_000 }),
        &["found 3000000", "up to 1048576"],
    );
}

#[test]
fn wrong_types_are_refused() {
    refused_json("/accessors/0/type", json!("VEC2"), &["accessors[0].type", "VEC2", "VEC3"]);
    refused_json("/accessors/0/componentType", json!(5124), &["found 5124"]);
    refused_json("/accessors/1/componentType", json!(5122), &["indices", "5122", "unsigned"]);
    refused_json("/asset/version", json!("1.0"), &["asset.version", "1.0"]);
    refused_json("/nodes", json!({}), &["glTF JSON", "line 1"]);
    refused(|m| m.primitive()["mode"] = json!(9), &["mode", "found 9"]);
    refused(
        |m| m.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]),
        &["KHR_draco_mesh_compression", "KHR_materials_unlit"],
    );
}

#[test]
fn index_beyond_the_vertices_is_refused() {
    refused(|m| m.bin[36 + 4] = 3, &["indices (accessors[1], element 2)", "found 3", "3 vertices"]);
}

#[test]
fn sparse_element_out_of_range_is_refused() {
    refused(
        |m| {
            let index = m.view(&[3]);
            m.json["accessors"][0]["sparse"] = json!({
                "count": 1, "indices": { "bufferView": index, "componentType": 5121 }, "values": { "bufferView": 0 },
            });
        },
        &["sparse.indices", "found 3", "3 elements"],
    );
}

#[test]
fn nodes_that_form_no_tree_are_refused() {
    refused(|m| m.json["nodes"] = json!([{ "children": [1] }, { "children": [0] }]), &["a node below itself"]);
    refused(|m| m.json["nodes"] = json!([{ "children": [0] }]), &["nodes[0]", "a node below itself"]);
    let shared = |roots: Value| {
        move |m: &mut Model| {
            m.json["nodes"] = json!([{ "children": [2] }, { "children": [2] }, {}]);
            m.json["scenes"] = json!([{ "nodes": roots }]);
        }
    };
    refused(shared(json!([0, 1])), &["nodes[1].children", "found 2, which is a child of nodes[0] already"]);
    refused(shared(json!([0, 2])), &["scenes[0].nodes", "found 2, which is a child of nodes[0] already"]);
    refused(shared(json!([2, 0])), &["nodes[0].children", "found 2, which is a child of scenes[0].nodes already"]);
    refused(|m| m.json["nodes"] = json!([{ "children": [5] }]), &["nodes[0].children", "found 5"]);
    refused(|m| m.json["scene"] = json!(1), &["scene", "found 1"]);
    let repeated = json!([{ "children": [1, 1, 1, 1, 1] }, {}]);
    refused(|m| m.json["nodes"] = repeated, &["nodes[0].children", "more children than there are nodes"]);
    let chain: Vec<_> = (0..2000).map(|i| if i < 1999 { json!({ "children": [i + 1] }) } else { json!({}) }).collect();
    refused(|m| m.json["nodes"] = json!(chain), &["more than 512 nodes above it"]);
}

#[test]
fn non_finite_numbers_are_refused() {
    refused(|m| m.bin[12..16].copy_from_slice(&f32::NAN.to_le_bytes()), &["POSITION (accessors[0], element 1)", "NaN"]);
    refused(|m| m.bin[32..36].copy_from_slice(&f32::INFINITY.to_le_bytes()), &["element 2", "inf"]);
    let mut matrix = [1e39, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    refused_json("/nodes/0", json!({ "mesh": 0, "matrix": matrix }), &["nodes[0].matrix", "not finite"]);
    (matrix[0], matrix[3]) = (1.0, 0.5);
    refused_json("/nodes/0", json!({ "mesh": 0, "matrix": matrix }), &["nodes[0].matrix", "last row"]);
    refused_json("/nodes/0", json!({ "mesh": 0, "rotation": [0, 0, 0, 0] }), &["nodes[0].rotation", "length 0"]);
    refused_json("/nodes/0", json!({ "mesh": 0, "scale": [1, 1e39, 1] }), &["nodes[0].scale"]);
}

#[test]
fn oversized_or_invalid_textures_are_refused() {
    refused(|m| m.textured(&png_header(100_000, 100_000)), &["images[0]", "100000×100000", "16384 pixels a side"]);
    refused(|m| m.textured(&png_header(100_000, 1)), &["100000×1", "16384"]);
    refused(|m| m.textured(b"GIF89a......"), &["images[0]", "Gif", "PNG or JPEG"]);
    refused(|m| m.textured(b"what is this"), &["images[0]", "PNG or JPEG"]);
    let whole = png(4, 4, &[77; 64]);
    refused(|m| m.textured(&whole[..whole.len() - 30]), &["images[0]", "a damaged picture"]);
    refused(
        |m| {
            m.textured(&whole);
            m.json["textures"][0]["source"] = json!(1);
        },
        &["textures[0].source", "found 1"],
    );
    refused(
        |m| {
            m.textured(&whole);
            m.json["materials"][0]["normalTexture"] = json!({ "index": 4 });
        },
        &["materials[0].normalTexture.index", "found 4"],
    );
    refused(|m| m.primitive()["material"] = json!(4), &["primitives[0].material", "found 4"]);
}

#[test]
fn missing_or_remote_files_are_refused() {
    refused(|m| m.json["buffers"][0]["uri"] = json!("gone.bin"), &["gone.bin", "cannot be read", "named in"]);
    refused(|m| m.json["buffers"][0]["uri"] = json!("https://example.org/a.bin"), &["buffers[0].uri", "relative"]);
    refused(|m| m.json["buffers"][0]["uri"] = json!("/dev/zero"), &["buffers[0].uri"]);
    refused(|m| m.json["buffers"][0]["uri"] = json!("data:text/plain,hello"), &["without base64"]);
    refused(|m| m.json["buffers"][0]["uri"] = json!("data:;base64,#!"), &["not base64"]);
    refused(|m| m.json["buffers"][0]["uri"] = json!("../"), &["a folder"]);
    let error = load_bytes("model.fbx", b"").expect_err("unknown").to_string();
    assert!(error.contains("model.fbx: unsupported extension .fbx; expected .glb, .gltf or .toml (Blender"), "{error}");
    let error = load_scene("version = 1\nobjects = [{ model = \"gone.glb\" }]").expect_err("missing").to_string();
    assert!(error.contains("gone.glb") && error.contains("named in"), "{error}");
}

/// The model with its geometry only in an extension: accessors without bytes, and the extension at
/// the primitive.
fn compressed_by_draco(model: &mut Model) {
    for accessor in model.json["accessors"].as_array_mut().unwrap() {
        accessor.as_object_mut().unwrap().remove("bufferView");
    }
    model.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    model.primitive()["extensions"] = json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": {} } });
}

#[test]
fn geometry_only_in_an_extension_is_refused_with_a_conversion_command() {
    refused(
        compressed_by_draco,
        &["meshes[0].primitives[0]", "in KHR_draco_mesh_compression only", "`gltf-transform copy ", "-converted.glb`"],
    );
    // Meshopt without the buffer of plain bytes.
    refused(
        |m| {
            m.json["extensionsUsed"] = json!(["EXT_meshopt_compression"]);
            m.json["buffers"] = json!([{ "byteLength": 8, "uri": "data:;base64,AAAAAAAAAAA=" },
                { "byteLength": 44, "extensions": { "EXT_meshopt_compression": { "fallback": true } } }]);
            for view in m.json["bufferViews"].as_array_mut().unwrap() {
                view["buffer"] = json!(1);
            }
        },
        &["buffers[1]", "in EXT_meshopt_compression only", "`gltf-transform copy "],
    );
    // If the plain accessors exist too, they are used.
    let mut model = Model::triangle();
    model.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    model.primitive()["extensions"] = json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": {} } });
    assert_eq!(model.corners(), Model::triangle().corners());
}

#[test]
fn required_unsupported_extension_is_refused_with_a_conversion_command() {
    for (name, command) in [
        ("KHR_draco_mesh_compression", "gltf-transform copy "),
        ("EXT_meshopt_compression", "gltf-transform copy "),
        ("KHR_texture_basisu", "gltf-transform ktxdecompress "),
        ("EXT_texture_webp", "--formats webp` converts it"),
    ] {
        refused(|m| m.json["extensionsRequired"] = json!([name]), &["extensionsRequired", name, command]);
    }
}

#[test]
fn texture_of_an_unsupported_format_is_refused_with_a_conversion_command() {
    refused(|m| m.textured(b"RIFF\x24\0\0\0WEBPVP8 "), &["images[0]", "WebP", "gltf-transform png ", "--formats webp"]);
    refused(|m| m.textured(b"\xabKTX 20\xbb\r\n\x1a\n\0\0"), &["images[0]", "KTX2", "gltf-transform ktxdecompress "]);
    refused(
        |m| {
            m.textured(&png(1, 1, &[9; 4]));
            m.json["textures"] = json!([{ "extensions": { "EXT_texture_webp": { "source": 0 } } }]);
        },
        &["textures[0]", "in EXT_texture_webp only", "PNG or JPEG", "gltf-transform png "],
    );
}

#[test]
fn foreign_file_format_is_named_with_the_next_step() {
    let old = br#"{"asset": {"version": "1.0"}, "accessors": {}, "meshes": {}, "nodes": {}}"#;
    let mut old_container = b"glTF\x01\0\0\0\x14\0\0\0\0\0\0\0\0\0\0\0".to_vec();
    old_container.extend([0; 8]);
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 123456\n";
    let cases: [(&[u8], [&str; 2]); 7] = [
        (old, ["glTF 1.0", "`gltf-pipeline -i "]),
        (&old_container, ["glTF 1.0", "`gltf-pipeline -i "]),
        (pointer, ["a Git LFS pointer", "`git lfs pull`"]),
        (b"\n<!DOCTYPE html><html>", ["a web page", "download the file itself"]),
        (b"PK\x03\x04....", ["a ZIP archive", "unpack it"]),
        (b"Kaydara FBX Binary  \0", ["an FBX file", "Blender"]),
        (b"", ["is empty (0 bytes)", "export or download it again"]),
    ];
    for (bytes, words) in cases {
        let error = load_bytes("model.glb", bytes).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("model.glb") && words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
    }
}
