//! All WGSL parses and validates, without a GPU.

use locard::compositor::mixed_shader;
use locard::effects::{self, Stage};
use locard::gpu::{assemble, sources};
use wgpu::naga;

fn validate(name: &str, text: &str) -> naga::Module {
    let module = naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(text)));
    let mut validator =
        naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::all());
    validator.validate(&module).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(text)));
    module
}

/// Files that hold functions for others and are no module of their own.
fn is_part(text: &str) -> bool {
    !text.contains("@fragment") && !text.contains("@compute")
}

#[test]
fn every_module_validates() {
    let mut count = 0;
    for (name, text) in sources() {
        if !is_part(text) {
            validate(name, &assemble(name));
            count += 1;
        }
    }
    assert!(count > 15, "{count}");
}

#[test]
fn every_file_is_embedded() {
    let mut on_disk = Vec::new();
    for folder in ["shaders", "shaders/shared"] {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "wgsl") {
                let name = path.with_extension("").strip_prefix("shaders").unwrap().to_str().unwrap().to_owned();
                on_disk.push(name);
            }
        }
    }
    on_disk.sort();
    let mut embedded: Vec<_> = sources().iter().map(|(n, _)| (*n).to_owned()).collect();
    embedded.sort();
    assert_eq!(on_disk, embedded);
}

#[test]
fn the_composite_validates_with_every_combination_of_mixed_effects() {
    let effects = effects::all();
    for photograph in [false, true] {
        let hook = |e: &dyn effects::Effect| Some((e.params().table(), e.mixed_wgsl(photograph)?));
        let hooks: Vec<_> = effects.iter().filter_map(|e| hook(e.as_ref())).collect();
        assert!(hooks.len() >= 2);
        let of_layer = effects.iter().filter(|e| e.stage() == Stage::Layer);
        let composites = of_layer.filter(|e| e.mixed_wgsl(photograph).is_some()).count();
        assert!(composites <= 1, "each would undo what the one before has made");
        for bits in 0..1usize << hooks.len() {
            let some: Vec<_> = hooks.iter().enumerate().filter(|(i, _)| bits >> i & 1 == 1).map(|(_, h)| *h).collect();
            validate(&format!("composite {bits:b} of a real part that was acted on"), &mixed_shader(&some, true));
            let text = mixed_shader(&some, false);
            validate(&format!("composite {bits:b}"), &text);
            for (name, _) in &some {
                assert!(text.contains(&format!("pixel = apply_{name}(p, pixel);")));
            }
        }
    }
}

#[test]
fn two_effects_may_import_the_same() {
    let one = "// @import shared/hash\n@group(0) @binding(4) var<uniform> one_by: vec4<f32>;\n\
        fn apply_one(p: vec2<i32>, pixel: Mixed) -> Mixed { return Mixed(pixel.code * one_by.x * f32(pcg3d(vec3<u32>(1u)).x), pixel.camera_variance); }\n";
    let two = one.replace("one", "two");
    // What the composite itself imports, too.
    let three = "// @import shared/response\nfn apply_three(p: vec2<i32>, pixel: Mixed) -> Mixed { return pixel; }\n";
    let text = mixed_shader(&[("one", one), ("two", &two), ("three", three)], false);
    validate("composite of three", &text);
    assert!(text.contains("@binding(4) var<uniform> one_by") && text.contains("@binding(5) var<uniform> two_by"));
}
