//! `scene.toml`: placement of objects, and refused files.

use glam::DVec3;
use locard::scene::{describe, load};

use crate::models::{corners, load_scene, write_triangle};

/// The corners of the triangle placed with these lines.
fn placed(lines: &str) -> Vec<[f64; 3]> {
    corners(&load_scene(&format!("version = 1\n[[objects]]\nmodel = 'triangle.glb'\n{lines}")).unwrap())
}

// The triangle: (0, 0, 0), (2, 0, 0), (0, 1, 0).

#[test]
fn model_up_axis_is_rotated_to_the_world_up_axis() {
    assert_eq!(placed(""), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(placed("up = 'z'"), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(placed("up = [3, 0, 0]")[1], [0.0, 0.0, 2.0]);
    let scene = |text: &str| corners(&load_scene(text).unwrap());
    let down = scene("version = 1\nup = '-y'\nobjects = [{ model = 'triangle.glb' }]");
    assert_eq!(down, [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, -1.0, 0.0]]);
}

#[test]
fn scene_up_axis_overrides_the_recording_up_axis() {
    let folder = tempfile::tempdir().unwrap();
    write_triangle(folder.path());
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, "version = 1\nobjects = [{ model = 'triangle.glb' }]").unwrap();
    assert_eq!(corners(&load(&path, Some(DVec3::Y)).unwrap())[2], [0.0, 1.0, 0.0]);
    std::fs::write(&path, "version = 1\nup = 'z'\nobjects = [{ model = 'triangle.glb' }]").unwrap();
    assert_eq!(corners(&load(&path, Some(DVec3::Y)).unwrap())[2], [0.0, 0.0, 1.0]);
}

#[test]
fn rotations_apply_about_world_x_then_y_then_z() {
    // (2, 0, 0): x leaves it, z takes it to (0, 2, 0). (0, 0, 1): x to (0, -1, 0), z to (1, 0, 0).
    let expected = [[5.0, 0.0, 0.0], [5.0, 2.0, 0.0], [6.0, 0.0, 0.0]];
    assert_eq!(placed("rotation_deg = [90, 0, 90]\nposition_m = [5, 0, 0]"), expected);
    assert_eq!(placed("quaternion = [0.5, 0.5, 0.5, 0.5]\nposition_m = [5, 0, 0]"), expected);
    assert_eq!(placed("rotation_deg = [0, 90, 0]")[1], [0.0, 0.0, -2.0]);
    // y before z: (2, 0, 0) goes to (0, 0, -2) and stays there; (0, 0, 1) to (0, -1, 0) to (1, 0,
    // 0).
    assert_eq!(placed("rotation_deg = [90, 90, 90]")[1..], [[0.0, 0.0, -2.0], [1.0, 0.0, 0.0]]);
}

#[test]
fn scale_applies_along_model_axes_and_size_sets_the_largest_extent() {
    assert_eq!(placed("scale = 3")[1..], [[6.0, 0.0, 0.0], [0.0, 0.0, 3.0]]);
    assert_eq!(placed("scale = [1, 10, 1]")[1..], [[2.0, 0.0, 0.0], [0.0, 0.0, 10.0]]);
    assert_eq!(placed("size_m = 0.5\nrotation_deg = [0, 45, 0]")[0], [0.0; 3]);
    assert_eq!(placed("size_m = 0.5")[1..], [[0.5, 0.0, 0.0], [0.0, 0.0, 0.25]]);
}

#[test]
fn grounded_model_stands_on_its_position() {
    // Upside down the triangle extends from 0 to -1, so it is lifted by 1.
    let corners = placed("ground = true\nrotation_deg = [180, 0, 0]\nposition_m = [0, 0, 0.2]");
    assert_eq!(corners, [[0.0, 0.0, 1.2], [2.0, 0.0, 1.2], [0.0, 0.0, 0.2]]);
}

#[test]
fn instances_inherit_unset_values_from_their_object() {
    let scene = load_scene(
        "version = 1\n[[objects]]\nmodel = 'triangle.glb'\nname = 'case'\nscale = 2\nposition_m = [9, 9, 9]\n\
         [[objects.instances]]\nposition_m = [1, 0, 0]\n[[objects.instances]]\nname = 'other'\nsize_m = 1\n\
         [[objects]]\nmodel = 'triangle.glb'",
    )
    .unwrap();
    let names: Vec<_> = scene.objects.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["case 1", "other", "triangle"]);
    assert_eq!(scene.meshes.len(), 1, "a model is read once");
    let corners = corners(&scene);
    assert_eq!(corners[1], [5.0, 0.0, 0.0]);
    assert_eq!(corners[4], [10.0, 9.0, 9.0]);
    assert_eq!(corners[7], [2.0, 0.0, 0.0]);
}

#[test]
fn errors_in_scene_files_name_their_location() {
    for (text, words) in [
        ("version = 1\nobject = []", ["line 2", "unknown field `object`"]),
        (
            "version = 1\n\n[[objects]]\nmodel = 'a.glb'\nscalle = 2",
            ["line 5", "`model`, `name`, `kind`, `hidden`, `shadowless`, `occluder`, `up`, `ground`"],
        ),
        ("version = 1\n[light]\nsky = 1", ["line 3", "`environment`, `environment_intensity`"]),
        ("version = 1\n[[light.sun]]\ncolour = 1", ["line 3", "`towards`, `color`, `intensity`"]),
        ("version = 1\nup = 'upwards'", ["line 2", "\"-z\" or [x, y, z]"]),
        ("version = 1\nup = [0, 0, 0]", ["up", "a vector with a length"]),
        ("objects = []", ["scene.toml: line 1: missing field `version`", "add `version = 1`"]),
        ("version = 1\n[light]\nambient = 'dim'", ["light.ambient: 'dim': expected", "a number or [r, g, b]"]),
        ("version = 2", ["version: found 2", "expected: 1"]),
        ("version = 1\nobjects = [{ model = 'a.obj' }]", ["objects[0] (a.obj).model", ".glb or .gltf"]),
        (
            "version = 1\nobjects = [{ model = 'triangle.glb', scale = 0 }]",
            ["objects[0] (triangle.glb).scale", "other than 0"],
        ),
        ("version = 1\nobjects = [{ model = 'triangle.glb', scale = nan }]", ["scale", "NaN"]),
        ("version = 1\nobjects = [{ model = 'triangle.glb', scale = 'big' }]", ["line 2", "a number or [x, y, z]"]),
        (
            "version = 1\nobjects = [{ model = 'triangle.glb', scale = 1, size_m = 1 }]",
            ["scale and size_m", "one of them"],
        ),
        ("version = 1\nobjects = [{ model = 'triangle.glb', size_m = -1 }]", ["size_m", "more than 0"]),
        ("version = 1\nobjects = [{ model = 'triangle.glb', quaternion = [0, 0, 0, 2] }]", ["quaternion", "length 2"]),
        (
            "version = 1\nobjects = [{ model = 'triangle.glb', quaternion = [0, 0, 0, 1], rotation_deg = [0, 0, 0] }]",
            ["rotation_deg and quaternion", "one of them"],
        ),
        (
            "version = 1\nobjects = [{ model = 'triangle.glb', position_m = [0, inf, 0] }]",
            ["objects[0].position_m[1]", "inf"],
        ),
        ("version = 1\n[light]\nambient = [nan, 0, 0]", ["light.ambient[0]", "NaN"]),
        (
            "version = 1\n[[objects]]\nmodel = 'triangle.glb'\n[[objects.instances]]\n[[objects.instances]]\nscale = 0",
            ["instances[1].scale", "other than 0"],
        ),
        ("version = 1\n[light]\nambient = -1", ["light.ambient", "0 or more"]),
        ("version = 1\n[light]\nwhite_lx = 0", ["light.white_lx", "more than 0"]),
        ("version = 1\n[light]\nenvironment_intensity = 2", ["light.environment_intensity", "no light.environment"]),
        ("version = 1\n[[light.sun]]\ntowards = [0, 0, 0]", ["light.sun[0].towards", "a vector with a length"]),
        ("version 1", ["line 1", "scene.toml"]),
    ] {
        let error = load_scene(text).map(|_| ()).expect_err(text).to_string();
        for word in words {
            assert!(error.contains(word), "{word:?} is not in: {error}");
        }
        assert!(error.contains("scene.toml") && !error.contains('\n'), "{error}");
    }
}

#[test]
fn sizes_implausible_in_metres_are_warned_of() {
    for (scale, odd) in [(1.0, false), (6.0, true), (0.001, false), (0.0001, true)] {
        let scene =
            load_scene(&format!("version = 1\nobjects = [{{ model = 'triangle.glb', scale = {scale:?} }}]")).unwrap();
        let description = describe(&scene);
        assert_eq!(description.warnings.iter().any(|w| w.contains("is it in metres?")), odd, "{scale}");
        assert_eq!(description.triangles, 1);
        let [low, high] = description.objects[0].bounds_in_world_m.unwrap();
        assert!(low == [0.0; 3] && (DVec3::from(high) - DVec3::new(2.0 * scale, 0.0, scale)).length() < 1e-9);
    }
}
