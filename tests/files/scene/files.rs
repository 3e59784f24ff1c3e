//! Real files, compared with the gltf crate, and the program's own props.

use std::path::{Path, PathBuf};

use glam::{DVec3, Mat4, Vec3};
use locard::scene::{Scene, SceneDescription, describe, load};

use crate::common::data;

/// Number of corners and bounds of a file by the gltf crate, for files without strips and fans.
fn by_the_gltf_crate(path: &Path) -> (usize, DVec3, DVec3) {
    let (document, buffers, _) = gltf::import(path).unwrap();
    let (mut corners, mut low, mut high) = (0, DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut open: Vec<_> = document.default_scene().unwrap().nodes().map(|n| (n, Mat4::IDENTITY)).collect();
    while let Some((node, parent)) = open.pop() {
        let world = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
            let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
            let positions: Vec<_> = reader.read_positions().unwrap().collect();
            for i in reader.read_indices().unwrap().into_u32() {
                let point = world.transform_point3(Vec3::from(positions[i as usize])).as_dvec3();
                (low, high, corners) = (low.min(point), high.max(point), corners + 1);
            }
        }
        open.extend(node.children().map(|child| (child, world)));
    }
    (corners, low, high)
}

fn gltf_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = entries.filter(|p| p.extension().is_some_and(|e| e == "glb" || e == "gltf")).collect();
    files.sort();
    files
}

#[track_caller]
fn compare(path: &Path) -> (Scene, SceneDescription) {
    let scene = load(path, None).unwrap();
    let description = describe(&scene);
    let (corners, low, high) = by_the_gltf_crate(path);
    assert_eq!(description.triangles * 3, corners, "{}", path.display());
    let bounds = description.objects[0].bounds_in_world_m.unwrap().map(DVec3::from);
    // The gltf crate multiplies matrices in single precision.
    assert!(bounds[0].abs_diff_eq(low, 2e-6) && bounds[1].abs_diff_eq(high, 2e-6), "{}: {bounds:?}", path.display());
    for vertex in scene.meshes.iter().flat_map(|m| &m.vertices) {
        assert!((Vec3::from(vertex.normal).length() - 1.0).abs() < 1e-4, "{}: {vertex:?}", path.display());
    }
    (scene, description)
}

#[test]
fn real_props_load_and_match_the_gltf_crate() {
    let Some(folder) = data("props") else { return };
    let files = gltf_files(&folder);
    assert!(files.len() == 12, "{files:?}");
    for path in files {
        let (scene, _) = compare(&path);
        assert!(!scene.textures.is_empty(), "{}", path.display());
        let mapped = |m: &locard::scene::Mesh| scene.materials[m.material].normal_texture.is_some();
        for vertex in scene.meshes.iter().filter(|m| mapped(m)).flat_map(|m| &m.vertices) {
            let [x, y, z, side] = vertex.tangent;
            let tangent = Vec3::new(x, y, z);
            assert!((tangent.length() - 1.0).abs() < 1e-4 && side.abs() == 1.0, "{}: {vertex:?}", path.display());
            assert!(tangent.dot(vertex.normal.into()).abs() < 1e-3, "{}: {vertex:?}", path.display());
        }
    }
}

#[test]
fn unsupported_extension_of_a_real_prop_is_warned_of_once() {
    let Some(path) = data("props/SunglassesKhronos.glb") else { return };
    let warnings = load(&path, None).unwrap().warnings;
    assert_eq!(warnings.iter().filter(|w| w.contains("KHR_materials_transmission")).count(), 1, "{warnings:?}");
}

#[test]
fn reconstructed_twins_keep_their_vertices() {
    for name in ["twins/tum-fr1-rpy-020.glb", "twins/tum-fr1-rpy-020-rows.glb"] {
        let Some(path) = data(name) else { return };
        let (scene, _) = compare(&path);
        assert_eq!((scene.meshes[0].vertices.len(), scene.meshes[0].indices.len()), (26229, 146_220));
        assert!(scene.materials[0].unlit);
        assert_eq!((scene.textures[0].width, scene.textures[0].height), (640, 480));
    }
}

#[test]
fn cycles_scenes_load() {
    for (name, triangles) in [("defocus-behind", 4), ("motion-translate", 4), ("rolling-shutter", 2)] {
        let Some(path) = data(&format!("cycles/{name}/scene.glb")) else { return };
        let (scene, description) = compare(&path);
        assert_eq!(description.triangles, triangles);
        assert!(scene.materials.iter().all(|m| m.unlit));
        assert_eq!(description.warnings, [""; 0]);
    }
}

#[test]
fn real_panorama_loads() {
    let Some(hdr) = data("hdri/st_fagans_interior_1k.hdr") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, format!("version = 1\n[light]\nenvironment = {:?}", hdr.to_str().unwrap())).unwrap();
    let scene = load(&path, None).unwrap();
    let locard::scene::Environment::Map(map) = &scene.lighting.environment else { panic!("no map") };
    assert_eq!((map.width, map.height, map.rgb.len()), (1024, 512, 1024 * 512));
    assert!(map.rgb.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0));
}

fn own_prop(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
}

#[test]
fn own_props_have_true_size_small_files_and_outward_winding() {
    let mut props = vec![
        ("l-scale.glb".to_owned(), [105.0, 0.8, 105.0]),
        ("cartridge-case-9mm.glb".to_owned(), [9.93, 19.15, 9.93]),
    ];
    props.extend((1..=9).map(|n| (format!("marker-{n}.glb"), [110.0, 106.64, 90.0])));
    for (name, size_mm) in props {
        let path = own_prop(&name);
        assert!(path.metadata().unwrap().len() < 300_000, "{name}");
        let (scene, description) = compare(&path);
        let [low, high] = description.objects[0].bounds_in_world_m.unwrap().map(DVec3::from);
        let size = (high - low) * 1e3;
        assert!(size.abs_diff_eq(size_mm.into(), 0.05), "{name}: {size}");
        assert!(low.y.abs() < 1e-6, "{name} does not stand on y = 0");
        assert!(description.warnings.is_empty(), "{name}: {:?}", description.warnings);
        // Normals point out of the front of every triangle.
        for mesh in &scene.meshes {
            for t in mesh.indices.chunks_exact(3) {
                let [a, b, c] = [0, 1, 2].map(|i| mesh.vertices[t[i] as usize]);
                let front = (Vec3::from(b.position) - Vec3::from(a.position))
                    .cross(Vec3::from(c.position) - Vec3::from(a.position));
                let out: Vec3 = [a, b, c].iter().map(|v| Vec3::from(v.normal)).sum();
                assert!(front.dot(out) > 0.0, "{name}: {a:?} {b:?} {c:?}");
            }
        }
    }
}

#[test]
fn demo_objects_stand_on_the_floor_and_the_stool() {
    let scene = load(&own_prop("demo.toml"), None).unwrap();
    let description = describe(&scene);
    assert_eq!(description.objects.len(), 7);
    assert_eq!(description.warnings, [""; 0]);
    for object in &description.objects {
        let [low, high] = object.bounds_in_world_m.unwrap();
        // The free part of the floor, and the stool's seat: 28 cm around (0.48, -0.28), 41 cm high.
        let on_stool = low[2] > 0.4;
        let (x, y, z, reach) = if on_stool { (0.48, -0.28, 0.41, 0.14) } else { (0.0, 0.0, 0.0, 0.2) };
        assert!((low[2] - z).abs() < 1e-6 && high[2] - z < 0.12, "{object:?}");
        let within = |p: &[f64; 3]| (p[0] - x).abs() < reach && (p[1] - y).abs() < reach;
        assert!(within(&low) && within(&high), "{object:?}");
    }
}
