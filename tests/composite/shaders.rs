//! Parses and validates all WGSL without a GPU.

use locard::compositor::mixed_module;
use locard::gpu::{Interface, Shader, module};

/// Files of shared functions that are not modules of their own.
fn is_part(text: &str) -> bool {
    !text.contains("@fragment") && !text.contains("@compute")
}

#[test]
fn every_shader_module_validates() {
    let mut count = 0;
    for shader in Shader::ALL {
        // The composite's module is assembled below.
        if !is_part(&shader.text()) && *shader != Shader::Composite {
            Interface::new(shader.name(), &shader.module());
            count += 1;
        }
    }
    assert!(count > 15, "{count}");
}

#[test]
fn every_shader_file_is_embedded() {
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
    let mut embedded: Vec<_> = Shader::ALL.iter().map(|shader| shader.name().to_owned()).collect();
    embedded.sort();
    assert_eq!(on_disk, embedded);
}

/// The parts of the mixed stage's effects, with the effects' names.
const PARTS: [(Shader, &str); 4] = [
    (Shader::EdgeBlend, "edge_blend"),
    (Shader::Noise, "noise"),
    (Shader::NoiseGrain, "noise"),
    (Shader::ExampleNoise, "noise"),
];

#[test]
fn composite_shader_validates_with_every_combination_of_mixed_effects() {
    for bits in 0..1usize << PARTS.len() {
        let some: Vec<_> = (0..PARTS.len()).filter(|i| bits >> i & 1 == 1).map(|i| PARTS[i]).collect();
        if (bits >> 1).count_ones() > 1 {
            continue; // one noise or another
        }
        for acted_on_real in [false, true] {
            let (shaders, tail) = mixed_module(&some, acted_on_real);
            let text = module(&shaders) + &tail;
            let globals = Interface::new(&format!("composite {bits:b}"), &text).globals(&["fullscreen_vertex", "main"]);
            assert_eq!(globals.contains_key("real_light"), acted_on_real);
            for (_, name) in &some {
                assert!(text.contains(&format!("pixel = apply_{name}(p, pixel);")));
                // Each part's globals are in a bind group of their own, so that the parts are
                // independent.
                let group = globals[*name].group;
                assert!(group > 0);
                let others = globals.values().filter(|g| g.group == group && !g.name.starts_with(name));
                assert_eq!(others.count(), 0, "{name} is alone in group {group}");
            }
        }
    }
}

#[test]
fn shader_file_is_included_once_per_module() {
    // Both import the same file; so does the composite itself.
    let text = module(&[Shader::Exposure, Shader::RealPart]);
    assert_eq!(text.matches("fn fullscreen_vertex").count(), 1);
    assert_eq!(text.matches("fn slope_at").count(), 1);
}
