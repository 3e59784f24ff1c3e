//! The evidence kit: every file has the dimensions of the catalogue, and is reproduced by
//! `examples/make_props`.

mod catalogue;
#[path = "../../../examples/make_props/kit/mod.rs"]
mod computed;
mod measure;

use std::collections::BTreeSet;
use std::sync::Mutex;

use glam::Vec3;
use locard::scene::{Alpha, Scene, load};

use catalogue::{folder, read};
use measure::Model;

const TOLERANCE_MM: f64 = 0.05;
const TOLERANCE_REFLECTANCE: f64 = 0.002;

fn models() -> BTreeSet<String> {
    let below = |prefix: &str| {
        let entries = std::fs::read_dir(folder().join(prefix)).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.ends_with(".glb")).map(|name| format!("{prefix}{name}")).collect::<Vec<_>>()
    };
    below("").into_iter().chain(below("kit/")).collect()
}

#[test]
fn catalogue_lists_every_supplied_model_once() {
    let catalogue = read();
    assert_eq!((catalogue.version, catalogue.licence.as_str()), (1, "CC0-1.0"));
    let files: Vec<String> = catalogue.items.iter().flat_map(|item| item.files.clone()).collect();
    assert_eq!(files.iter().cloned().collect::<BTreeSet<_>>(), models());
    assert_eq!(files.len(), models().len(), "a file is listed twice");
    for item in &catalogue.items {
        assert!([&item.name, &item.description, &item.source].iter().all(|text| !text.is_empty()), "{:?}", item.files);
    }
}

#[test]
fn every_model_has_the_dimensions_of_the_catalogue() {
    for item in read().items {
        for file in &item.files {
            let scene = load(&folder().join(file), None).unwrap();
            assert_eq!(scene.warnings, [""; 0], "{file}");
            let model = Model::of(&scene);
            let (size_mm, lowest_mm) = model.size_mm();
            assert!(size_mm.abs_diff_eq(item.size_mm.into(), TOLERANCE_MM), "{file}: {size_mm} mm");
            assert!(lowest_mm.abs() < 1e-3, "{file} does not stand on y = 0 but on {lowest_mm} mm");
            for feature in &item.features {
                let value = model.measure(&feature.measure);
                let (expected, tolerance) = match (feature.mm, feature.reflectance) {
                    (Some(mm), None) => (mm, TOLERANCE_MM),
                    (None, Some(reflectance)) => (reflectance, TOLERANCE_REFLECTANCE),
                    _ => panic!("{file}: {} needs either mm or reflectance", feature.name),
                };
                println!("{file}: {}: {value:.3}, catalogue {expected}", feature.name);
                assert!((value - expected).abs() <= tolerance, "{file}: {}: {value}, not {expected}", feature.name);
            }
        }
    }
}

/// Triangles that face against their normals.
fn inside_out(scene: &Scene) -> usize {
    let corners = scene
        .meshes
        .iter()
        .flat_map(|mesh| mesh.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|i| mesh.vertices[t[i] as usize])));
    let is_inside_out = |[a, b, c]: &[locard::scene::Vertex; 3]| {
        let [p, q, r] = [a, b, c].map(|v| Vec3::from(v.position));
        let out: Vec3 = [a, b, c].iter().map(|v| Vec3::from(v.normal)).sum();
        (q - p).cross(r - p).dot(out) <= 0.0
    };
    corners.filter(is_inside_out).count()
}

#[test]
fn kit_models_have_outward_winding_and_small_files() {
    let mut total_bytes = 0;
    for file in models().iter().filter(|file| file.starts_with("kit/")) {
        let path = folder().join(file);
        let bytes = path.metadata().unwrap().len();
        assert!(bytes < 120_000, "{file}: {bytes} bytes");
        total_bytes += bytes;
        assert_eq!(inside_out(&load(&path, None).unwrap()), 0, "{file}");
    }
    assert!(total_bytes < 1_500_000, "{total_bytes} bytes");
}

#[test]
fn decals_are_blended_and_mostly_transparent() {
    // Surfaces of a mean opacity below a half cast no shadow (src/shadow/occluders.rs).
    let mut count = 0;
    for file in models() {
        let scene = load(&folder().join(&file), None).unwrap();
        for material in scene.materials.iter().filter(|material| material.alpha == Alpha::Blend) {
            let texture = &scene.textures[material.base_color_texture.unwrap().texture];
            let sum: u64 = texture.rgba.chunks_exact(4).map(|rgba| u64::from(rgba[3])).sum();
            let mean = sum as f64 / 255.0 / f64::from(texture.width * texture.height);
            assert!((0.01..0.45).contains(&mean), "{file}: {mean}");
            count += 1;
        }
    }
    assert_eq!(count, 7);
}

// Slow: 65 models are drawn and packed.
// Sines differ in their last bits on other systems.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn committed_models_are_reproduced_byte_for_byte() {
    let items = computed::items();
    assert_eq!(items.iter().map(|item| item.file.clone()).collect::<BTreeSet<_>>(), models());
    let open = Mutex::new(items.into_iter());
    let compare = || {
        loop {
            let Some(item) = open.lock().unwrap().next() else { return };
            let committed = std::fs::read(folder().join(&item.file)).unwrap();
            let bytes = (item.make)().to_glb().unwrap();
            assert!(bytes == committed, "{}: cargo run --example make_props writes other bytes", item.file);
        }
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            (0..2).map(|_| std::thread::Builder::new().spawn_scoped(scope, compare).unwrap()).collect();
        threads.into_iter().for_each(|thread| thread.join().unwrap());
    });
}
