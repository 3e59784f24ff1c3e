//! The camera for other programs: written numbers lead back to the poses and to the same pixels.

use std::path::Path;

use exr::prelude::read_first_flat_layer_from_file;
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};
use locard::export::Inputs;
use locard::export::camera::{CameraExport, CameraFormat};
use locard::recording::OpenOptions;
use locard::scene::{Part, Vertex};
use locard::shot::{Shot, ShotOptions};

use crate::files::{describe, open, refused};
use crate::program::{locard, refused as program_refused};

const ALL: [CameraFormat; 3] = [CameraFormat::Chan, CameraFormat::Usda, CameraFormat::Gltf];

/// Exports frames 3 and 4 of the demonstration with its scene. The number of frame 0 is 1001.
fn exported(folder: &Path, formats: &[CameraFormat], scene: &str, sets: &[&str]) -> Shot {
    let options = ShotOptions {
        scene: Some(scene.into()),
        sets: sets.iter().map(|set| (*set).to_owned()).collect(),
        ..ShotOptions::default()
    };
    let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &options).unwrap();
    let export = CameraExport {
        range: 3..5,
        folder: folder.to_owned(),
        formats: formats.to_vec(),
        first_number: 1001,
        fps: None,
        force: false,
    };
    let plan = export.plan(&shot).unwrap();
    plan.check(&Inputs::of(&shot)).unwrap();
    plan.write().unwrap();
    shot
}

const LENS_WITHOUT_DISTORTION: [&str; 4] =
    ["camera.distortion.k1=0", "camera.distortion.k2=0", "camera.distortion.p1=0", "camera.distortion.p2=0"];

fn words(line: &str) -> Vec<f64> {
    line.split(|c: char| !(c.is_ascii_digit() || "+-.e".contains(c))).filter_map(|word| word.parse().ok()).collect()
}

/// S and T of an ST map, row by row, with its width and height.
fn st_map(file: &Path) -> ([usize; 2], Vec<[f64; 2]>) {
    let layer = read_first_flat_layer_from_file(file).unwrap().layer_data;
    let values = |name: &str| -> Vec<f32> {
        let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name)).unwrap();
        channel.sample_data.values_as_f32().collect()
    };
    let st = values("R").into_iter().zip(values("G")).map(|(s, t)| [f64::from(s), f64::from(t)]).collect();
    ([layer.size.0, layer.size.1], st)
}

/// The place in the input of a place in the output of an ST map: both in pixels of the upper left
/// corner's raster.
fn through(([width, height], st): &([usize; 2], Vec<[f64; 2]>), at: DVec2, input: DVec2) -> DVec2 {
    let p = (at - 0.5).clamp(DVec2::ZERO, DVec2::new(*width as f64 - 2.0, *height as f64 - 2.0));
    let (x, y) = (p.x.floor() as usize, p.y.floor() as usize);
    let (u, v) = (p.x - x as f64, p.y - y as f64);
    let value = |x: usize, y: usize| DVec2::from(st[y * width + x]);
    let st = value(x, y) * (1.0 - u) * (1.0 - v)
        + value(x + 1, y) * u * (1.0 - v)
        + value(x, y + 1) * (1.0 - u) * v
        + value(x + 1, y + 1) * u * v;
    DVec2::new(st.x, 1.0 - st.y) * input
}

/// A point of the scene in the file's axes: z up becomes y up.
fn in_file(world: DVec3) -> DVec3 {
    DVec3::new(world.x, world.z, -world.y)
}

/// Points of the demonstration's floor that frame 3 shows.
const POINTS: [DVec3; 4] =
    [DVec3::ZERO, DVec3::new(0.2, 0.15, 0.0), DVec3::new(-0.3, -0.1, 0.02), DVec3::new(0.1, 0.4, 0.1)];

/// The pixels of the points in a frame, by the shot's own camera at the middle row's time.
fn recorded_px(shot: &Shot, frame: usize) -> Vec<DVec2> {
    let (pose, camera) = (shot.recording.pose_at_frame(frame).unwrap(), shot.geometry_at(frame).unwrap());
    POINTS.iter().map(|point| camera.project(pose.transform_point(*point)).unwrap()).collect()
}

fn assert_close(actual: &[DVec2], expected: &[DVec2], tolerance_px: f64) {
    for (actual, expected) in actual.iter().zip(expected) {
        assert!(actual.distance(*expected) < tolerance_px, "{actual} for {expected}");
    }
}

#[test]
fn points_project_to_the_same_pixels_by_the_written_numbers() {
    let temp = tempfile::tempdir().unwrap();
    let shot = exported(temp.path(), &ALL, "scenes/demo.toml", &[]);
    let map = st_map(&temp.path().join("undistort.exr"));
    let plate = DVec2::new(map.0[0] as f64, map.0[1] as f64);
    let recorded = recorded_px(&shot, 4);

    // Nuke: frame 4 has number 1005. Ry·Rx·Rz, a camera that faces along −z, a centred pinhole.
    let text = std::fs::read_to_string(temp.path().join("camera.chan")).unwrap();
    assert_eq!(text.lines().count(), 2);
    let [frame, tx, ty, tz, rx, ry, rz, vfov]: [f64; 8] = words(text.lines().last().unwrap()).try_into().unwrap();
    assert_eq!(frame, 1005.0);
    let [rx, ry, rz, vfov] = [rx, ry, rz, vfov].map(f64::to_radians);
    let rotation = DMat3::from_rotation_y(ry) * DMat3::from_rotation_x(rx) * DMat3::from_rotation_z(rz);
    let focal_px = 0.5 * plate.y / (0.5 * vfov).tan();
    let pinhole = |rotation: DMat3, position: DVec3, focal_px: f64| -> Vec<DVec2> {
        let project = |point: &DVec3| {
            let p = rotation.transpose() * (in_file(*point) - position);
            0.5 * plate + focal_px * DVec2::new(p.x, -p.y) / -p.z
        };
        POINTS.iter().map(|point| through(&map, project(point), DVec2::new(640.0, 480.0))).collect()
    };
    assert_close(&pinhole(rotation, DVec3::new(tx, ty, tz), focal_px), &recorded, 0.01);

    // USD: row vectors; focal length and aperture in the same unit.
    let text = std::fs::read_to_string(temp.path().join("camera.usda")).unwrap();
    let value =
        |name: &str| words(text.lines().find(|line| line.contains(name)).unwrap().split('=').nth(1).unwrap())[0];
    let row = text.lines().find(|line| line.trim_start().starts_with("1005: ")).unwrap();
    let m: [f64; 16] = words(row.split(": ").nth(1).unwrap()).try_into().unwrap();
    let rotation = DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]);
    let focal_px = value("focalLength") / value("horizontalAperture ") * plate.x;
    assert_eq!((value("horizontalApertureOffset"), value("verticalApertureOffset")), (0.0, 0.0));
    assert_close(&pinhole(rotation, DVec3::new(m[12], m[13], m[14]), focal_px), &recorded, 0.01);

    // glTF, by another reader: times in seconds from the recording's first frame on.
    let (document, buffers, _) = gltf::import(temp.path().join("camera.glb")).unwrap();
    let channels: Vec<_> = document.animations().next().unwrap().channels().collect();
    let reader = |n: usize| channels[n].reader(|buffer| Some(&buffers[buffer.index()]));
    let times: Vec<f32> = reader(0).read_inputs().unwrap().collect();
    assert!((f64::from(times[1]) - (shot.recording.timestamps_s[4] - shot.recording.timestamps_s[0])).abs() < 1e-6);
    let gltf::animation::util::ReadOutputs::Translations(positions) = reader(0).read_outputs().unwrap() else {
        panic!()
    };
    let gltf::animation::util::ReadOutputs::Rotations(rotations) = reader(1).read_outputs().unwrap() else { panic!() };
    let position = DVec3::from(positions.last().unwrap().map(f64::from));
    let rotation = glam::DQuat::from_array(rotations.into_f32().last().unwrap().map(f64::from)).normalize();
    let lens = document.cameras().next().unwrap();
    let gltf::camera::Projection::Perspective(lens) = lens.projection() else { panic!() };
    assert!((f64::from(lens.aspect_ratio().unwrap()) - plate.x / plate.y).abs() < 1e-6);
    let focal_px = 0.5 * plate.y / (0.5 * f64::from(lens.yfov())).tan();
    assert_close(&pinhole(DMat3::from_quat(rotation), position, focal_px), &recorded, 0.01);
}

#[test]
fn redistorted_plate_and_recorded_picture_have_the_same_pixels() {
    let temp = tempfile::tempdir().unwrap();
    let shot = exported(temp.path(), &[CameraFormat::Chan], "scenes/marker-1.glb", &[]);
    let [to_plate, to_picture] = ["undistort.exr", "redistort.exr"].map(|name| st_map(&temp.path().join(name)));
    assert_eq!(to_picture.0, [640, 480]);
    let plate = DVec2::new(to_plate.0[0] as f64, to_plate.0[1] as f64);
    let recorded = recorded_px(&shot, 3);
    let there_and_back: Vec<DVec2> = recorded
        .iter()
        .map(|at| through(&to_plate, through(&to_picture, *at, plate), DVec2::new(640.0, 480.0)))
        .collect();
    assert_close(&there_and_back, &recorded, 0.01);
    // All of the picture is on the plate.
    assert!(to_picture.1.iter().flatten().all(|value| (0.0..=1.0).contains(value)));
}

#[test]
fn lens_without_distortion_is_written_to_usd_as_recorded() {
    let temp = tempfile::tempdir().unwrap();
    let shot = exported(temp.path(), &[CameraFormat::Usda], "scenes/demo.toml", &LENS_WITHOUT_DISTORTION);
    assert!(!temp.path().join("undistort.exr").exists());
    let text = std::fs::read_to_string(temp.path().join("camera.usda")).unwrap();
    let value =
        |name: &str| words(text.lines().find(|line| line.contains(name)).unwrap().split('=').nth(1).unwrap())[0];
    // Tenths of a metre: 36 mm of film, 640 pixels wide, 520 px of focal length.
    assert!((value("horizontalAperture ") - 0.36).abs() < 1e-12 && (value("verticalAperture ") - 0.27).abs() < 1e-12);
    assert!((value("focalLength") - 0.36 * 520.0 / 640.0).abs() < 1e-12);
    // The principal point is 1.75 px right of the centre and 1.5 px above it: the window is left
    // of it and below.
    assert!((value("horizontalApertureOffset") + 0.36 * 1.75 / 640.0).abs() < 1e-12);
    assert!((value("verticalApertureOffset") + 0.27 * 1.5 / 480.0).abs() < 1e-12);
    let row = text.lines().find(|line| line.trim_start().starts_with("1004: ")).unwrap();
    let m: [f64; 16] = words(row.split(": ").nth(1).unwrap()).try_into().unwrap();
    let camera_from_file = DMat4::from_cols_array(&m).inverse();
    // OpenUSD: the window is [offset - aperture/2, offset + aperture/2] at the focal length.
    let project = |point: &DVec3| {
        let p: DVec4 = camera_from_file * in_file(*point).extend(1.0);
        let at = value("focalLength") * DVec2::new(p.x, p.y) / -p.z;
        let size = DVec2::new(value("horizontalAperture "), value("verticalAperture "));
        let offset = DVec2::new(value("horizontalApertureOffset"), value("verticalApertureOffset"));
        let share = (at - offset) / size + 0.5;
        DVec2::new(share.x, 1.0 - share.y) * DVec2::new(640.0, 480.0)
    };
    assert_close(&POINTS.iter().map(project).collect::<Vec<_>>(), &recorded_px(&shot, 3), 0.01);
}

#[test]
fn exported_poses_read_back_as_the_recordings() {
    let temp = tempfile::tempdir().unwrap();
    let shot = exported(temp.path(), &ALL, "scenes/marker-1.glb", &[]);
    let list = std::fs::canonicalize("recordings/demo/rgb.txt").unwrap();
    let profile = std::fs::canonicalize("recordings/demo/camera.toml").unwrap();
    for name in ["camera.chan", "camera.usda", "camera.glb"] {
        let first = if name == "camera.glb" { "max_gap_s = 1" } else { "first_frame = 1001" };
        let text = format!(
            "up = [0, 0, 1]\n[frames]\nlist = {list:?}\n[poses]\ntrajectory = \"{name}\"\n{first}\n[camera]\nprofile = {profile:?}\n"
        );
        let read = open(&describe(temp.path(), &text));
        assert_eq!(read.up, Some(DVec3::Z));
        for frame in 3..5 {
            let (own, back) = (shot.recording.pose_at_frame(frame).unwrap(), read.pose_at_frame(frame).unwrap());
            let apart_m = own.position_in_world_m().distance(back.position_in_world_m());
            // A metre along each axis, by the rotation alone.
            let turned = (own.rotation * DVec3::ONE).distance(back.rotation * DVec3::ONE);
            assert!(apart_m < 1e-6 && turned < 1e-6, "{name}: {apart_m} m, {turned}");
        }
        assert!(read.pose_at_frame(0).is_err() && read.pose_at_frame(9).is_err(), "{name}");
        // Without up in the description, the world is the file's.
        let read = open(&describe(temp.path(), &text.replace("up = [0, 0, 1]", "")));
        let own = in_file(shot.recording.pose_at_frame(3).unwrap().position_in_world_m());
        let back = read.pose_at_frame(3).unwrap().position_in_world_m();
        assert!(read.up == Some(DVec3::Y) && own.distance(back) < 1e-6, "{name}: {own} {back}");
    }
    let text = format!("[frames]\nlist = {list:?}\n[poses]\ntrajectory = \"broken.chan\"\n");
    std::fs::write(temp.path().join("broken.chan"), "1 0 0 0\n").unwrap();
    let error = refused(&describe(temp.path(), &text));
    assert!(error.contains("broken.chan, line 1: rx is missing (a line is `frame tx ty tz"), "{error}");
}

#[test]
fn evidence_is_in_place_in_usd_and_gltf() {
    let temp = tempfile::tempdir().unwrap();
    let shot = exported(temp.path(), &ALL, "scenes/demo.toml", &[]);
    let drawn: Vec<_> = shot.scene.objects.iter().filter(|object| !object.parts.is_empty()).collect();
    let vertices = |part: &Part| -> Vec<DVec3> {
        let vertices = &shot.scene.meshes[part.mesh].vertices;
        let placed = |v: &Vertex| part.world_from_mesh.transform_point3(DVec3::from(v.position.map(f64::from)));
        vertices.iter().map(|vertex| in_file(placed(vertex))).collect()
    };
    let expected: Vec<Vec<DVec3>> =
        drawn.iter().map(|object| object.parts.iter().flat_map(vertices).collect()).collect();
    let (document, buffers, images) = gltf::import(temp.path().join("camera.glb")).unwrap();
    assert!(!images.is_empty());
    let objects: Vec<_> = document.nodes().filter(|node| node.children().next().is_some()).collect();
    assert_eq!(objects.len(), expected.len());
    for (node, expected) in objects.iter().zip(&expected) {
        let of =
            |node: &gltf::Node<'_>| DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
        let mut points = Vec::new();
        for part in node.children() {
            let placed = of(node) * of(&part);
            for primitive in part.mesh().unwrap().primitives() {
                let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
                points.extend(
                    reader.read_positions().unwrap().map(|p| placed.transform_point3(DVec3::from(p.map(f64::from)))),
                );
            }
        }
        assert_eq!(points.len(), expected.len());
        assert!(points.iter().zip(expected).all(|(a, b)| a.distance(*b) < 1e-5), "{:?}", node.name());
    }

    let text = std::fs::read_to_string(temp.path().join("camera.usda")).unwrap();
    let parts: usize = drawn.iter().map(|object| object.parts.len()).sum();
    assert_eq!(text.matches("def Mesh ").count(), parts);
    // The first vertex of the first mesh of the first object.
    let after = text.split_once("def Xform \"marker_1\"").unwrap().1;
    let matrix = |text: &str| -> DMat4 {
        let row = text.lines().find(|line| line.contains("matrix4d xformOp:transform = ")).unwrap();
        DMat4::from_cols_array(&words(row.split(" = ").nth(1).unwrap()).try_into().unwrap())
    };
    let mesh = after.split_once("def Mesh ").unwrap().1;
    let points = mesh.lines().find(|line| line.contains("point3f[] points")).unwrap().split(" = ").nth(1).unwrap();
    let first = DVec3::from_slice(&words(points)[..3]);
    let placed = (matrix(after) * matrix(mesh)).transform_point3(first);
    assert!(placed.distance(expected[0][0]) < 1e-5, "{placed} {}", expected[0][0]);
    assert!(text.contains("asset inputs:file = @./textures/texture_") && text.contains("upAxis = \"Y\""));
    assert!(std::fs::read_dir(temp.path().join("textures")).unwrap().count() > 0);
}

#[test]
fn program_lists_files_keeps_existing_ones_and_explains_refusals() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("out");
    let out = folder.to_str().unwrap();
    let command = ["export", "camera", "recordings/demo", "--format", "chan", "--frames", "0..2", "-o", out];
    let output = locard(&command);
    let (stdout, stderr) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success(), "{stderr}");
    let files = ["camera.chan", "frames.csv", "README.txt", "undistort.exr", "redistort.exr"];
    assert_eq!(stdout.lines().collect::<Vec<_>>(), files.map(|name| format!("{out}/{name}")));
    assert!(stderr.contains("camera.chan: the camera is that of an undistorted picture of"), "{stderr}");
    assert!(stderr.contains("rolling shutter is not exported"), "{stderr}");
    let list = std::fs::read_to_string(folder.join("frames.csv")).unwrap();
    assert_eq!(list.lines().nth(2), Some("2,1,1.033333,1,recordings/demo/rgb/00001.jpg,"));
    let readme = std::fs::read_to_string(folder.join("README.txt")).unwrap();
    assert!(readme.contains("rotation order ZXY") && readme.contains("Frames      1 to 2, 30"), "{readme}");

    std::fs::write(folder.join("camera.chan"), "mine").unwrap();
    let error = program_refused(&command);
    assert!(error.contains("camera.chan: exists already, and is kept (--force replaces it)"), "{error}");
    assert_eq!(std::fs::read_to_string(folder.join("camera.chan")).unwrap(), "mine");
    assert!(locard(&[&command[..], &["--force", "-q"]].concat()).stderr.is_empty());
    assert!(std::fs::read_to_string(folder.join("camera.chan")).unwrap().starts_with("1\t"));

    let with = |more: &[&str]| {
        let out = temp.path().join("other");
        program_refused(&[&["export", "camera", "recordings/demo", "-o", out.to_str().unwrap()], more].concat())
    };
    let error = with(&["--format", "fbx"]);
    assert!(error.contains("invalid value 'fbx'") && error.contains("chan, usda, gltf"), "{error}");
    let error = with(&["--format", "gltf", "--fps", "0"]);
    assert!(error.contains("expected 0.001 to 100000 frames per second"), "{error}");
    let error = with(&["--format", "usda", "--frames", "70..80"]);
    assert!(error.contains("expected a range within 0..72"), "{error}");
    let error =
        with(&["--format", "gltf", "--set", "camera.distortion.model=opencv_fisheye", "--set", "camera.fx_px=200"]);
    assert!(error.contains("camera.distortion.p1 is not 0"), "{error}");
    assert!(!temp.path().join("other").exists());
    let error = program_refused(&["export", "camera", "recordings/demo", "--format", "chan", "-o", "recordings/demo"]);
    assert!(error.contains("is the recording's folder, which is never overwritten"), "{error}");
}

#[test]
fn lens_that_varies_has_maps_for_each_frame() {
    let temp = tempfile::tempdir().unwrap();
    let demo = std::fs::canonicalize("recordings/demo").unwrap();
    let camera = |time: &str, focal: f64| format!("{time} 640 480 {focal} {focal} 320 240 36 0 0 0 0 0 - - - -\n");
    let cameras = camera("1.000000", 520.0) + &camera("1.033333", 530.0);
    std::fs::write(temp.path().join("cameras.txt"), cameras).unwrap();
    let frames = format!("1.000000 {0}/rgb/00000.jpg\n1.033333 {0}/rgb/00001.jpg\n", demo.display());
    std::fs::write(temp.path().join("rgb.txt"), frames).unwrap();
    std::fs::write(temp.path().join("poses.txt"), "1 0 0 0 0 0 0 1\n1.1 0 0 0 0 0 0 1\n").unwrap();
    let text = "up = [0, -1, 0]\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\n[camera]\nlist = \"cameras.txt\"\n";
    let recording = describe(temp.path(), text);
    let shot = Shot::open(&recording, &OpenOptions::default(), &ShotOptions::default()).unwrap();
    let folder = temp.path().join("out");
    let export = CameraExport {
        range: 0..2,
        folder: folder.clone(),
        formats: ALL.to_vec(),
        first_number: 1,
        fps: None,
        force: false,
    };
    export.plan(&shot).unwrap().write().unwrap();
    // Nuke and USD animate the lens; glTF has one, with a map per frame.
    let chan = std::fs::read_to_string(folder.join("camera.chan")).unwrap();
    let fov: Vec<f64> = chan.lines().map(|line| words(line)[7].to_radians()).collect();
    assert!((240.0 / (0.5 * fov[0]).tan() - 520.0).abs() < 1e-6 && (240.0 / (0.5 * fov[1]).tan() - 530.0).abs() < 1e-6);
    let usda = std::fs::read_to_string(folder.join("camera.usda")).unwrap();
    assert!(usda.contains("float focalLength.timeSamples = {"));
    // y up is down in the recording's world: half a turn about x.
    assert!(
        chan.starts_with("1\t0.000000000\t0.000000000\t0.000000000\t0.000000000\t0.000000000\t0.000000000\t"),
        "{chan}"
    );
    let (size, st) = st_map(&folder.join("redistort.000001.exr"));
    // The plate has the longer focal length: 0.5 px from the left edge, 319.5 px from the centre.
    let width = st_map(&folder.join("undistort.000001.exr")).0[0] as f64;
    let expected = (0.5 * width - 319.5 * 530.0 / 520.0) / width;
    assert!(size == [640, 480] && (st[0][0] - expected).abs() < 1e-6, "{} {expected}", st[0][0]);
    assert!(folder.join("redistort.000002.exr").exists());
}

#[test]
fn exported_maps_as_the_lens_of_a_profile_project_like_the_lens() {
    let folder = tempfile::tempdir().unwrap();
    let shot = exported(folder.path(), &[CameraFormat::Usda], "scenes/demo.toml", &[]);
    let own = shot.geometry_at(3).unwrap();
    let i = &own.intrinsics;
    let ([plate_width, plate_height], _) = st_map(&folder.path().join("undistort.exr"));
    let camera = format!(
        "version = 1\n[camera]\nwidth_px = {}\nheight_px = {}\nfx_px = {}\nfy_px = {}\ncx_px = {}\ncy_px = {}\n\
         [camera.distortion]\n",
        i.width_px,
        i.height_px,
        i.fx_px,
        i.fx_px,
        0.5 * f64::from(i.width_px),
        0.5 * f64::from(i.height_px)
    );
    let size = format!("undistorted_width_px = {plate_width}\nundistorted_height_px = {plate_height}\n");
    for keys in [
        "undistort = \"undistort.exr\"\n".to_owned(),
        format!("redistort = \"redistort.exr\"\n{size}"),
        "undistort = \"undistort.exr\"\nredistort = \"redistort.exr\"\n".to_owned(),
    ] {
        let profile = folder.path().join("lens.toml");
        std::fs::write(&profile, format!("{camera}{keys}")).unwrap();
        let options = ShotOptions { profile: Some(profile), ..ShotOptions::default() };
        let mapped = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &options).unwrap();
        let table = mapped.geometry_at(3).unwrap();
        for n in 0..1000 {
            let at = DVec2::new(f64::from(n % 40) / 39.0, f64::from(n / 40) / 24.0);
            let at = at * DVec2::new(i.width_px.into(), i.height_px.into());
            let point = own.unproject(at).unwrap() * (1.0 + f64::from(n % 7));
            let off_px = table.project(point).unwrap().distance(at);
            assert!(off_px < 0.02, "{off_px} px at {at}: {keys}");
        }
    }
    let wrong = folder.path().join("wrong.toml");
    std::fs::write(&wrong, format!("{camera}undistort = \"camera.usda\"\n")).unwrap();
    let error = program_refused(&["inspect", wrong.to_str().unwrap()]);
    assert!(error.contains("undistort") && error.contains("an ST map is OpenEXR"), "{error}");
}
