//! Damaged files never make the loader panic.

use std::sync::LazyLock;

use locard::scene::{SceneError, load};
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::models::{Model, glb, load_bytes, png};

/// A small file with an example of every feature.
static RICH: LazyLock<Model> = LazyLock::new(|| {
    let mut model = Model::triangle();
    model.textured(&png(2, 2, &[200; 16]));
    let normal = model.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    let color = model.accessor(5121, "VEC4", 3, &[128; 12]);
    model.json["accessors"][color]["normalized"] = json!(true);
    let (index, value) = (model.view(&[1]), model.view(&[0; 12]));
    model.json["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": { "bufferView": index, "componentType": 5121 }, "values": { "bufferView": value },
    });
    model.json["bufferViews"][0]["byteStride"] = json!(12);
    model.primitive()["attributes"]["NORMAL"] = json!(normal);
    model.primitive()["attributes"]["COLOR_0"] = json!(color);
    let mut strip = model.primitive().clone();
    strip["mode"] = json!(5);
    strip["attributes"].as_object_mut().unwrap().remove("NORMAL");
    model.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(strip);
    model.json["materials"][0]["normalTexture"] = json!({ "index": 0, "texCoord": 0, "scale": 0.5 });
    model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
        json!({ "KHR_texture_transform": { "offset": [0.5, 0.5], "rotation": 1.0, "scale": [2.0, 2.0] } });
    model.json["samplers"] = json!([{ "wrapS": 33071 }]);
    model.json["textures"][0]["sampler"] = json!(0);
    model.json["scenes"] = json!([{ "nodes": [1, 2] }]);
    model.json["nodes"] = json!([
        { "mesh": 0, "scale": [1.0, 2.0, 3.0] },
        { "children": [0], "rotation": [0.0, 0.0, 0.0, 1.0], "translation": [1.0, 0.0, 0.0] },
        { "extensions": { "KHR_lights_punctual": { "light": 0 } }, "mesh": 0 },
    ]);
    model.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "spot", "intensity": 10.0, "range": 2.0, "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.2 } },
    ] } });
    model
});

/// True if the loader returns a valid scene or an error without a caught panic.
fn is_valid_or_error(result: &Result<locard::scene::Scene, SceneError>) -> bool {
    match result {
        Ok(scene) => scene.meshes.iter().all(|m| {
            m.indices.len() % 3 == 0
                && m.indices.iter().all(|&i| (i as usize) < m.vertices.len())
                && m.material < scene.materials.len()
                && m.vertices
                    .iter()
                    .all(|v| v.position.iter().chain(&v.normal).chain(&v.tangent).all(|x| x.is_finite()))
        }),
        Err(SceneError::DecoderPanic { .. }) => false,
        Err(_) => true,
    }
}

/// All numbers of a JSON in their order.
fn numbers<'a>(value: &'a mut Value, numbers_in: &mut Vec<&'a mut Value>) {
    match value {
        Value::Number(_) => numbers_in.push(value),
        Value::Array(list) => list.iter_mut().for_each(|v| numbers(v, numbers_in)),
        Value::Object(map) => map.values_mut().for_each(|v| numbers(v, numbers_in)),
        _ => {}
    }
}

#[test]
fn undamaged_file_loads() {
    let scene = RICH.load().unwrap();
    assert_eq!((scene.meshes.len(), scene.textures.len(), scene.lighting.points.len()), (2, 2, 1));
    assert!(is_valid_or_error(&Ok(scene)));
}

#[test]
fn every_truncation_is_refused() {
    let whole = RICH.glb();
    for length in 0..whole.len() {
        let result = load_bytes("model.glb", &whole[..length]);
        assert!(result.is_err() && is_valid_or_error(&result), "{length} bytes: {result:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let mut bytes = RICH.glb();
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let result = load_bytes("model.glb", &bytes);
        prop_assert!(is_valid_or_error(&result), "{:?}", result.map(|_| ()));
    }

    #[test]
    fn arbitrary_binary_chunk_never_panics(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..9)) {
        let mut bin = RICH.bin.clone();
        for (place, value) in changes {
            let place = place.index(bin.len());
            bin[place] = value;
        }
        let result = load_bytes("model.glb", &glb(&RICH.json, &bin));
        prop_assert!(is_valid_or_error(&result), "{:?}", result.map(|_| ()));
    }

    #[test]
    fn arbitrary_numbers_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![
            (0u64..20).prop_map(|n| json!(n)),
            any::<u64>().prop_map(|n| json!(n)),
            any::<u32>().prop_map(|n| json!(n)),
            (-3i64..0).prop_map(|n| json!(n)),
            prop_oneof![Just(1e39), Just(-1e300), Just(0.0), Just(1e-300), Just(3e38)].prop_map(|n| json!(n)),
            Just(Value::Null),
        ]), 1..4)
    ) {
        let mut json = RICH.json.clone();
        let mut all = Vec::new();
        numbers(&mut json, &mut all);
        for (place, value) in changes {
            let place = place.index(all.len());
            *all[place] = value;
        }
        let result = load_bytes("model.glb", &glb(&json, &RICH.bin));
        prop_assert!(is_valid_or_error(&result), "{:?}", result.map(|_| ()));
    }

    #[test]
    fn arbitrary_scene_text_never_panics(text in "(version = 1\n)?(\\PC|\n|\\[|\\]|=|objects|light|up|1|'){0,60}") {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text).unwrap();
        prop_assert!(is_valid_or_error(&load(&path, None)));
    }
}
