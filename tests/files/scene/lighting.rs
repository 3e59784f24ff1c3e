//! Light: from models, from scene files, and where nobody gives any.

use glam::{DVec3, Vec3};
use locard::scene::{Environment, Scene, load};
use serde_json::{Value, json};

use crate::models::{Model, load_scene, write_triangle};

/// The triangle's file with one light, its node at (1, 2, 3) and turned so that -z is +x.
fn with_light(light: Value) -> Model {
    let mut model = Model::triangle();
    let half = 0.5f64.sqrt();
    model.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    model.json["nodes"] = json!([{ "mesh": 0 }, {
        "translation": [1, 2, 3], "rotation": [0, -half, 0, half], "scale": [3, 3, 3],
        "extensions": { "KHR_lights_punctual": { "light": 0 } },
    }]);
    model.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
    model
}

fn uniform(scene: &Scene) -> Vec3 {
    match &scene.lighting.environment {
        Environment::Uniform(color) => *color,
        Environment::Map(_) => panic!("a map"),
    }
}

#[test]
fn a_spot_of_1000_candela_shows_white_as_two_from_a_metre() {
    let model = with_light(json!({
        "type": "spot", "intensity": 1000, "color": [1, 0.5, 0], "range": 4,
        "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.2 },
    }));
    let scene = model.load().unwrap();
    let light = scene.lighting.points[0];
    assert_eq!(light.color, Vec3::new(2.0, 1.0, 0.0));
    assert_eq!(light.position_in_world_m, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(light.range_m, 4.0);
    let (axis, angles) = light.spot.unwrap();
    assert!(axis.abs_diff_eq(Vec3::X, 1e-6), "{axis}");
    assert_eq!(angles.to_array(), [0.1, 0.2]);
    assert_eq!(uniform(&scene), Vec3::ZERO);
    assert!(scene.warnings[0].contains("no light from around"), "{:?}", scene.warnings);
}

#[test]
fn a_directional_light_in_lux_becomes_a_sun() {
    let model = with_light(json!({ "type": "directional", "intensity": 250 }));
    let scene = model.load().unwrap();
    let sun = scene.lighting.suns[0];
    assert_eq!(sun.color, Vec3::splat(0.5));
    assert!(sun.towards_light_in_world.abs_diff_eq(Vec3::NEG_X, 1e-6), "{sun:?}");
}

#[test]
fn a_model_s_light_moves_with_it_and_white_lx_scales_it() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("lamp.glb"), with_light(json!({ "type": "point", "intensity": 30 })).glb())
        .unwrap();
    let path = folder.path().join("scene.toml");
    let text =
        "version = 1\n[[objects]]\nmodel = 'lamp.glb'\nposition_m = [10, 0, 0]\n[light]\nwhite_lx = 100\nambient = 0.1";
    std::fs::write(&path, text).unwrap();
    let scene = load(&path, None).unwrap();
    let light = scene.lighting.points[0];
    // y is up in the model, z in the world: (1, 2, 3) → (1, -3, 2).
    assert!(light.position_in_world_m.abs_diff_eq(DVec3::new(11.0, -3.0, 2.0), 1e-9), "{light:?}");
    assert!(light.color.abs_diff_eq(Vec3::splat(0.3), 1e-6));
    assert!(light.range_m.is_infinite() && light.spot.is_none());
    assert_eq!(uniform(&scene), Vec3::splat(0.1));
    assert!(scene.lighting.suns.is_empty());
}

#[test]
fn lights_that_cannot_be_are_refused() {
    for (light, word) in [
        (json!({ "type": "area" }), "area"),
        (json!({ "type": "point", "intensity": -1 }), "color · intensity"),
        (json!({ "type": "point", "range": 0 }), "range"),
        (json!({ "type": "spot", "spot": { "innerConeAngle": 0.9, "outerConeAngle": 0.2 } }), "inner 0.9"),
    ] {
        let error = with_light(light).load().expect_err(word).to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn without_light_white_facing_up_is_about_one() {
    let folder = tempfile::tempdir().unwrap();
    write_triangle(folder.path());
    let path = folder.path().join("triangle.glb");
    let alone = load(&path, None).unwrap();
    assert_eq!(uniform(&alone), Vec3::ONE);
    assert!(alone.lighting.suns.is_empty());
    for up in [DVec3::Y, DVec3::NEG_Z, DVec3::new(0.0, 3.0, -4.0)] {
        let scene = load(&path, Some(up)).unwrap();
        let sun = scene.lighting.suns[0];
        let cosine = sun.towards_light_in_world.dot(up.normalize().as_vec3());
        assert!((cosine - 35f32.to_radians().cos()).abs() < 1e-6, "{up}: {sun:?}");
        let shown = uniform(&scene) + sun.color * cosine;
        assert!(shown.abs_diff_eq(Vec3::splat(1.0415), 1e-3), "{up}: {shown}");
    }
    assert!(load(&path, Some(DVec3::ZERO)).is_err());
    // A scene file's up is z where nobody says otherwise; white_lx alone is no light.
    let scene = load_scene("version = 1\nobjects = [{ model = 'triangle.glb' }]\n[light]\nwhite_lx = 80").unwrap();
    assert!((scene.lighting.suns[0].towards_light_in_world.z - 35f32.to_radians().cos()).abs() < 1e-6);
}

#[test]
fn suns_and_ambient_are_as_written() {
    let scene = load_scene(
        "version = 1\nobjects = [{ model = 'triangle.glb' }]\n[light]\nambient = [0.1, 0.2, 0.3]\n\
         [[light.sun]]\ntowards = [0, 0, 5]\ncolor = [1, 0.5, 0.25]\nintensity = 2\n[[light.sun]]\ntowards = [1, 0, 0]",
    )
    .unwrap();
    assert_eq!(uniform(&scene), Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(scene.lighting.suns[0].towards_light_in_world, Vec3::Z);
    assert_eq!(scene.lighting.suns[0].color, Vec3::new(2.0, 1.0, 0.5));
    assert_eq!(scene.lighting.suns[1].color, Vec3::ONE);
}

#[test]
fn a_panorama_stands_on_the_world_s_up() {
    let folder = tempfile::tempdir().unwrap();
    write_triangle(folder.path());
    // Two by one pixels: RGBE (128, 64, 32, 129) is (1, 0.5, 0.25), and half of that.
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
    hdr.extend([128, 64, 32, 129, 128, 64, 32, 128]);
    std::fs::write(folder.path().join("room.hdr"), &hdr).unwrap();
    let path = folder.path().join("scene.toml");
    let text = "version = 1\nup = 'z'\nobjects = [{ model = 'triangle.glb' }]\n[light]\nenvironment = 'room.hdr'\n\
                    environment_intensity = 0.5\nenvironment_rotation_deg = 90"
        .to_owned();
    std::fs::write(&path, &text).unwrap();
    let scene = load(&path, None).unwrap();
    let Environment::Map(map) = &scene.lighting.environment else { panic!("no map") };
    assert_eq!((map.width, map.height, map.intensity), (2, 1, 0.5));
    assert_eq!(**map.rgb, [[1.0, 0.5, 0.25], [0.5, 0.25, 0.125]]);
    assert!((map.map_from_world * Vec3::Z).abs_diff_eq(Vec3::Y, 1e-6));
    // Unturned, the panorama's middle, -z, is the world's +y; a quarter turn takes it to -x.
    assert!((map.map_from_world * Vec3::NEG_X).abs_diff_eq(Vec3::NEG_Z, 1e-6), "{:?}", map.map_from_world);
    // With an up of its own it stands and turns on that.
    std::fs::write(&path, format!("{text}\nenvironment_up = [2, 0, 0]")).unwrap();
    let scene = load(&path, None).unwrap();
    let Environment::Map(own) = &scene.lighting.environment else { panic!("no map") };
    assert!((own.map_from_world * Vec3::X).abs_diff_eq(Vec3::Y, 1e-6));
    std::fs::write(&path, text.replace("up = 'z'", "up = 'x'")).unwrap();
    let scene = load(&path, None).unwrap();
    let Environment::Map(worlds) = &scene.lighting.environment else { panic!("no map") };
    assert!(own.map_from_world.abs_diff_eq(worlds.map_from_world, 1e-6));
    for (line, wrong) in [("environment_up = [0, 0, 0]", "environment_up"), ("ambient = 1", "environment and ambient")]
    {
        std::fs::write(&path, format!("{text}\n{line}")).unwrap();
        let error = load(&path, None).unwrap_err().to_string();
        assert!(error.contains(wrong), "{error}");
    }
    std::fs::write(&path, "version = 1\n[light]\nenvironment_up = 'y'").unwrap();
    assert!(load(&path, None).unwrap_err().to_string().contains("light.environment_up"));
}

#[test]
fn panoramas_that_are_too_large_or_cut_off_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_triangle(folder.path());
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, "version = 1\n[light]\nenvironment = 'room.hdr'").unwrap();
    for (size, word) in
        [("-Y 100000 +X 100000", "100000×100000"), ("-Y 4 +X 8", "do not decode"), ("", "do not decode")]
    {
        let hdr = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n");
        std::fs::write(folder.path().join("room.hdr"), hdr).unwrap();
        let error = load(&path, None).unwrap_err().to_string();
        assert!(error.contains("room.hdr") && error.contains(word), "{error}");
    }
    // No such picture at all.
    std::fs::write(folder.path().join("room.hdr"), "\u{89}PNG").unwrap();
    let error = load(&path, None).unwrap_err().to_string();
    assert!(error.contains("does not begin with #?") && error.contains("a Radiance .hdr file"), "{error}");
    // A header without end.
    std::fs::write(folder.path().join("room.hdr"), "#?RADIANCE\n".to_owned() + &"A=1\n".repeat(20_000)).unwrap();
    let error = load(&path, None).unwrap_err().to_string();
    assert!(error.contains("found no empty line in the first 65536 bytes"), "{error}");
}
