//! Light from models and scene files, and the default light.

use glam::{DVec3, Vec3};
use locard::scene::{Environment, Scene, load};
use serde_json::{Value, json};

use crate::models::{Model, load_scene, write_triangle};

/// The triangle's file with one light, whose node is at (1, 2, 3) and turned so that -z is +x.
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
fn spot_of_1000_candela_shows_white_as_two_at_one_metre() {
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
    assert!(scene.warnings[0].contains("no environment light"), "{:?}", scene.warnings);
}

#[test]
fn directional_light_in_lux_becomes_a_sun() {
    let model = with_light(json!({ "type": "directional", "intensity": 250 }));
    let scene = model.load().unwrap();
    let sun = scene.lighting.suns[0];
    assert_eq!(sun.color, Vec3::splat(0.5));
    assert!(sun.towards_light_in_world.abs_diff_eq(Vec3::NEG_X, 1e-6), "{sun:?}");
}

#[test]
fn light_of_a_model_moves_with_it_and_is_scaled_by_white_lx() {
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
fn invalid_light_is_left_out_and_the_model_kept() {
    for (light, word) in [
        (json!({ "type": "area" }), "area"),
        (json!({ "intensity": 1 }), "directional, point or spot"),
        (json!({ "type": "point", "intensity": -1 }), "color · intensity"),
        (json!({ "type": "point", "range": 0 }), "range"),
        (json!({ "type": "point", "color": [1, 1] }), "-> color: found 2 numbers; expected: red, green and blue"),
    ] {
        let scene = with_light(light).load().unwrap();
        assert_eq!((scene.meshes.len(), scene.lighting.points.len()), (1, 0), "{word}");
        let [warning] = &scene.warnings[..] else { panic!("{:?}", scene.warnings) };
        assert!(warning.contains(word) && warning.ends_with("this light is left out"), "{warning}");
    }
    let mut model = with_light(json!({ "type": "point" }));
    model.json["nodes"][1]["extensions"]["KHR_lights_punctual"]["light"] = json!(7);
    let warnings = model.load().unwrap().warnings;
    assert!(warnings[0].contains("found 7") && warnings[0].contains("left out"), "{warnings:?}");
}

#[test]
fn spot_with_inner_angle_not_below_outer_has_a_hard_edge() {
    for (inner, outer, used) in [(0.5, 0.5, [0.5, 0.5]), (0.9, 0.25, [0.25, 0.25]), (0.0, 2.0, [0.0, 1.570_796_4])] {
        let spot = json!({ "type": "spot", "spot": { "innerConeAngle": inner, "outerConeAngle": outer } });
        let scene = with_light(spot).load().unwrap();
        assert_eq!(scene.lighting.points[0].spot.unwrap().1.to_array(), used);
        assert!(scene.warnings[0].contains(&format!("inner {inner}, outer {outer}")), "{:?}", scene.warnings);
    }
}

#[test]
fn spot_angles_equal_in_single_precision_are_accepted() {
    let angles = json!({ "innerConeAngle": 0.089_681_029, "outerConeAngle": 0.089_681_029_319_763_18 });
    let scene = with_light(json!({ "type": "spot", "spot": angles })).load().unwrap();
    assert_eq!(scene.lighting.points[0].spot.unwrap().1.to_array(), [0.089_681_03; 2]);
    // The only warning concerns the missing ambient light.
    assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("no environment light"), "{:?}", scene.warnings);
}

#[test]
fn default_light_shows_white_facing_up_as_about_one() {
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
    // A scene file's default up is z; white_lx alone is no light.
    let scene = load_scene("version = 1\nobjects = [{ model = 'triangle.glb' }]\n[light]\nwhite_lx = 80").unwrap();
    assert!((scene.lighting.suns[0].towards_light_in_world.z - 35f32.to_radians().cos()).abs() < 1e-6);
}

#[test]
fn suns_and_ambient_light_are_read_as_written() {
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
fn panorama_is_aligned_with_the_world_up_axis() {
    let folder = tempfile::tempdir().unwrap();
    write_triangle(folder.path());
    // Two by one pixels: RGBE (128, 64, 32, 129) is (1, 0.5, 0.25), and half of that.
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
    hdr.extend([128, 64, 32, 129, 128, 64, 32, 128]);
    std::fs::write(folder.path().join("room.hdr"), &hdr).unwrap();
    let path = folder.path().join("scene.toml");
    let text = "version = 1\nup = 'z'\nobjects = [{ model = 'triangle.glb' }]\n[light]\nenvironment = 'room.hdr'\n\
                    environment_intensity = 0.5\nenvironment_color = [1, 0.5, 2]\n\
                    environment_rotation_deg = 90"
        .to_owned();
    std::fs::write(&path, &text).unwrap();
    let scene = load(&path, None).unwrap();
    let Environment::Map(map) = &scene.lighting.environment else { panic!("no map") };
    assert_eq!((map.width, map.height, map.color), (2, 1, Vec3::new(0.5, 0.25, 1.0)));
    assert_eq!(**map.rgb, [[1.0, 0.5, 0.25], [0.5, 0.25, 0.125]]);
    assert!((map.map_from_world * Vec3::Z).abs_diff_eq(Vec3::Y, 1e-6));
    // Without rotation the panorama's middle, -z, is the world's +y; a quarter turn moves it to -x.
    assert!((map.map_from_world * Vec3::NEG_X).abs_diff_eq(Vec3::NEG_Z, 1e-6), "{:?}", map.map_from_world);
    // With an up of its own it is aligned with that and rotates about it.
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
fn oversized_or_truncated_panoramas_are_refused() {
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
    // Not an HDR picture.
    std::fs::write(folder.path().join("room.hdr"), "\u{89}PNG").unwrap();
    let error = load(&path, None).unwrap_err().to_string();
    assert!(error.contains("does not begin with #?") && error.contains("a Radiance .hdr file"), "{error}");
    // A header without end.
    std::fs::write(folder.path().join("room.hdr"), "#?RADIANCE\n".to_owned() + &"A=1\n".repeat(20_000)).unwrap();
    let error = load(&path, None).unwrap_err().to_string();
    assert!(error.contains("found no empty line in the first 65536 bytes"), "{error}");
}

/// A triangle lit by a panorama of these bytes, and the panorama's pixels.
fn lighting_origin(name: &str, panorama: &[u8]) -> (Result<Scene, String>, Vec<[f32; 3]>) {
    let folder = tempfile::tempdir().unwrap();
    write_triangle(folder.path());
    std::fs::write(folder.path().join(name), panorama).unwrap();
    let path = folder.path().join("scene.toml");
    let text = format!("version = 1\nobjects = [{{ model = 'triangle.glb' }}]\n[light]\nenvironment = '{name}'");
    std::fs::write(&path, text).unwrap();
    let scene = load(&path, None).map_err(|error| error.to_string());
    let rgb = match scene.as_ref().map(|scene| &scene.lighting.environment) {
        Ok(Environment::Map(map)) => map.rgb.to_vec(),
        _ => Vec::new(),
    };
    (scene, rgb)
}

/// Two pixels, (1, 0.5, 0.25) and half of that, after any header.
fn radiance(header: &str) -> Vec<u8> {
    [header.as_bytes(), b"-Y 1 +X 2\n", &[128, 64, 32, 129, 128, 64, 32, 128]].concat()
}

#[test]
fn radiance_exposure_and_colour_correction_divide_the_pixels() {
    for (header, first) in [
        ("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\n\n", [0.5, 0.25, 0.125]),
        ("#?RADIANCE\nEXPOSURE= 2\nEXPOSURE=0.125\n\n", [4.0, 2.0, 1.0]),
        ("#?RADIANCE\nCOLORCORR=2 1 0.5\nCOLORCORR= 1 2 1\nEXPOSURE=0.5\n\n", [1.0, 0.5, 1.0]),
        // A comment, and a line of a picture that this one was made from.
        ("#?RADIANCE\n#EXPOSURE=9\n\tEXPOSURE=9\n\n", [1.0, 0.5, 0.25]),
    ] {
        let (scene, rgb) = lighting_origin("room.hdr", &radiance(header));
        assert_eq!(rgb, [first, first.map(|v| v / 2.0)], "{header:?}: {:?}", scene.map(|_| ()));
    }
    for (header, word) in [
        ("#?RADIANCE\nEXPOSURE=0\n\n", "EXPOSURE= and a number above 0"),
        ("#?RADIANCE\nEXPOSURE=bright\n\n", "EXPOSURE=bright"),
        ("#?RADIANCE\nCOLORCORR=1 2\n\n", "three numbers"),
        ("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n", "ra_xyze -r"),
    ] {
        let error = lighting_origin("room.hdr", &radiance(header)).0.unwrap_err();
        assert!(error.contains("room.hdr") && error.contains(word), "{error}");
    }
}

#[test]
fn radiance_file_with_another_signature_or_line_ending_loads() {
    for header in [
        "#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n",
        "#?RGBE\n# made by\nFORMAT=32-bit_rle_rgbe\n\n",
        "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n",
    ] {
        let (scene, rgb) = lighting_origin("room.hdr", &radiance(header));
        assert_eq!(rgb, [[1.0, 0.5, 0.25], [0.5, 0.25, 0.125]], "{header:?}: {:?}", scene.map(|_| ()));
    }
}

#[test]
fn panorama_that_is_a_git_lfs_pointer_is_identified() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 123456\n";
    let error = lighting_origin("room.hdr", pointer).0.unwrap_err();
    assert!(error.contains("room.hdr") && error.contains("`git lfs pull`"), "{error}");
}

/// An OpenEXR picture of these channels, all zeros but the last one.
fn openexr(channels: &[&str], window: exr::prelude::IntegerBounds) -> Vec<u8> {
    use exr::prelude::*;
    let value = |name: &str, i: usize| if name == "R" { i as f32 } else { -0.5 };
    let samples = |name: &str| FlatSamples::F32((0..2).map(|i| value(name, i)).collect());
    let list = channels.iter().map(|name| AnyChannel::new(*name, samples(name))).collect();
    let layer = Layer::new((2, 1), LayerAttributes::named("a"), Encoding::UNCOMPRESSED, AnyChannels::sort(list));
    let image = Image::new(ImageAttributes::new(window), layer);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

#[test]
fn openexr_panorama_fills_its_display_window_and_invalid_values_are_reported() {
    use exr::prelude::IntegerBounds;
    let (scene, rgb) = lighting_origin("room.exr", &openexr(&["B", "G", "R"], IntegerBounds::new((-1, 0), (4, 2))));
    let scene = scene.unwrap();
    let Environment::Map(map) = &scene.lighting.environment else { panic!("no map") };
    assert_eq!((map.width, map.height), (4, 2));
    let mut expected = vec![[0.0; 3]; 8];
    expected[2] = [1.0, 0.0, 0.0];
    assert_eq!(rgb, expected);
    assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("4 of its values"), "{:?}", scene.warnings);
    let multilayer = openexr(&["View.B", "View.G", "View.R"], IntegerBounds::new((0, 0), (2, 1)));
    let error = lighting_origin("room.exr", &multilayer).0.unwrap_err();
    assert!(error.contains("View.R") && error.contains("not MultiLayer"), "{error}");
    let error = lighting_origin("room.exr", &multilayer[..40]).0.unwrap_err();
    assert!(error.contains("room.exr") && error.contains("do not decode"), "{error}");
    let huge = openexr(&["B", "G", "R"], IntegerBounds::new((0, 0), (20_000, 10)));
    let error = lighting_origin("room.exr", &huge).0.unwrap_err();
    assert!(error.contains("20000×10 pixels"), "{error}");
}
