//! Output and messages of the program.

use std::path::Path;

use crate::common::data_if_any;
use crate::program::{copied, locard, program, refused, stdout_of, with_a_truncated_frame};
use crate::tier;

#[test]
fn composite_is_silent_in_a_pipe_and_writes_the_requested_frames() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let (frames, layers, report) = (path("frames"), path("layers"), path("report.json"));
    let scene = ["--scene", tier::any_scene(), "--frames", "5..7"];
    let arguments =
        [&["composite", "recordings/demo"], &scene[..], &["-o", &frames, "--layers", &layers, "--report", &report]]
            .concat();
    let arguments = [&arguments[..], tier::no_shadows()].concat();
    let output = locard(&arguments);
    assert!(output.status.success() && output.stdout.is_empty() && output.stderr.is_empty(), "{output:?}");
    let files = |folder: &str| {
        let mut names: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    assert_eq!(
        (files(&frames).len(), files(&layers)),
        (2, vec!["layer_000005.exr".to_owned(), "layer_000006.exr".to_owned()])
    );
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    assert_eq!(report["frames"].as_array().unwrap().len(), 2);

    // A second run keeps the existing files and reports only that.
    let text = refused(&arguments);
    assert!(text.contains("exists already") && text.lines().count() == 1, "{text}");

    // The same frames as raw values: standard output contains nothing else.
    let raw = locard(&[&["composite", "recordings/demo"], &scene[..], &["-o", "-"], tier::no_shadows()].concat());
    assert_eq!((raw.stdout.len(), raw.stderr.len()), (2 * 3 * 640 * 480, 0));
    let first = image::open(Path::new(&frames).join(&files(&frames)[0])).unwrap().into_rgb8();
    assert!(first.as_raw()[..] == raw.stdout[..3 * 640 * 480]);
}

#[test]
fn inspect_describes_the_recording() {
    let text = stdout_of(&["inspect", "scenes/demo.toml"]);
    assert!(text.contains("light      0 suns, 1 lamp, a panorama of 256x128 px"), "{text}");
    assert!(text.contains("object     marker 1: ") && !text.contains("-0.000"), "{text}");
    let temp = tempfile::tempdir().unwrap();
    let sunny = temp.path().join("sunny.toml");
    std::fs::write(&sunny, "version = 1\n[light]\nambient = 0.5\n[[light.sun]]\ntowards = [0, 0, 1]\n").unwrap();
    let text = stdout_of(&["inspect", sunny.to_str().unwrap()]);
    assert!(text.contains("light      1 sun, 0 lamps, 0.5 from everywhere"), "{text}");
    let text = stdout_of(&["inspect", "scenes/l-scale.glb"]);
    assert!(text.contains("triangles, 1 material\n"), "{text}");
    let text = stdout_of(&["inspect", "profiles/simulated.toml"]);
    assert!(text.contains("picture    640x480 px") && text.contains("time_s = 0.0166667 s, iso = 400\n"), "{text}");
    let text = stdout_of(&["inspect", "recordings/demo"]);
    assert!(text.contains("exposure   known for 72 of 72 frames"), "{text}");
}

#[test]
fn folder_of_one_scene_calibrates_as_one_scene() {
    let temp = tempfile::tempdir().unwrap();
    for i in 0..3u32 {
        // Every level, with one code up or down.
        let picture = image::GrayImage::from_fn(256, 256, |x, y| {
            let mixed = (x + 256 * y + 65_536 * i).wrapping_mul(2_654_435_761);
            let up = (mixed ^ (mixed >> 15)).wrapping_mul(2_246_822_519) >> 30;
            image::Luma([(x + up).min(255) as u8])
        });
        picture.save(temp.path().join(format!("{i}.png"))).unwrap();
    }
    let profile = temp.path().join("p.toml");
    let text = stdout_of(&["calibrate", "noise", temp.path().to_str().unwrap(), "-o", profile.to_str().unwrap()]);
    assert!(text.starts_with("1 scene, 3 frames; "), "{text}");
}

#[test]
fn pictures_without_times_have_no_motion_blur() {
    let temp = tempfile::tempdir().unwrap();
    // Two pictures half a metre apart: at 30 a second any exposure would blur an object 2 m away.
    let mut entries = Vec::new();
    for i in 0..2 {
        let name = format!("{i}.png");
        image::RgbImage::from_pixel(64, 48, image::Rgb([90; 3])).save(temp.path().join(&name)).unwrap();
        let x = 0.5 * f64::from(i);
        entries.push(format!(
            r#"{{"file_path": "{name}", "transform_matrix": [[1,0,0,{x}],[0,1,0,0],[0,0,1,2],[0,0,0,1]]}}"#
        ));
    }
    let camera = r#""fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48"#;
    let text = format!(r#"{{{camera}, "frames": [{}]}}"#, entries.join(","));
    std::fs::write(temp.path().join("transforms.json"), text).unwrap();
    let report = temp.path().join("report.json");
    let path = |p: &Path| p.to_str().unwrap().to_owned();
    let (recording, report_path, out) = (path(temp.path()), path(&report), path(&temp.path().join("out")));
    let scene = ["--scene", "scenes/marker-1.glb", "--report", &report_path, "-o", &out, "--force"];
    let output = locard(&[&["composite", &recording], &scene[..], tier::no_shadows()].concat());
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && stderr.contains("nothing is blurred by motion"), "{stderr}");
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    for frame in report["frames"].as_array().unwrap() {
        assert_eq!(frame["exposure_time_s"], 0.0);
        assert!(!frame["effects"].as_array().unwrap().contains(&"motion_blur".into()), "{frame}");
    }
}

#[test]
fn inspect_names_truncated_pictures() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let text = stdout_of(&["inspect", temp.path().to_str().unwrap()]);
    assert!(text.contains("files      6 pictures, 1 cannot be read\n"), "{text}");
    assert!(text.contains("00003.jpg: the JPEG is truncated"), "{text}");
    let text = stdout_of(&["inspect", "recordings/demo"]);
    assert!(text.contains("files      144 pictures, none ends too early\n"), "{text}");
}

#[test]
fn inspect_takes_the_camera_from_a_profile_and_units_from_the_format() {
    let temp = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(temp.path().join(name), text).unwrap();
    image::RgbImage::from_pixel(64, 48, image::Rgb([90; 3])).save(temp.path().join("0.png")).unwrap();
    let camera = r#""fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48"#;
    let frame = r#"{"file_path": "0.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,2],[0,0,0,1]]}"#;
    write("transforms.json", &format!(r#"{{{camera}, "frames": [{frame}]}}"#));
    let folder = temp.path().to_str().unwrap();
    let pick = ["inspect", folder, "--frame", "0", "--pick", "32,24", "--plane", "0,0,1,0"];
    let text = stdout_of(&pick);
    assert!(text.contains("camera at  0.0000 0.0000 2.0000 units, looks along"), "{text}");
    assert!(text.contains("world      0.0000 0.0000 0.0000 units (on the plane, depth 2.0000 units)"), "{text}");
    let text = stdout_of(&[&pick[..], &["--metres-per-unit", "0.5"]].concat());
    assert!(text.contains("0.0000 0.0000 1.0000 m, looks along") && !text.contains("units"), "{text}");

    std::fs::remove_file(temp.path().join("transforms.json")).unwrap();
    write("rgb.txt", "0 0.png\n");
    write("poses.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n");
    write("recording.toml", "version = 1\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\n");
    write(
        "camera.toml",
        "version = 1\n[camera]\nwidth_px = 64\nheight_px = 48\nfx_px = 61\nfy_px = 60\ncx_px = 32\ncy_px = 24\n",
    );
    assert!(stdout_of(&["inspect", folder]).contains("camera     unknown: give a --profile"));
    let profile = temp.path().join("camera.toml");
    let text = stdout_of(&["inspect", folder, "--profile", profile.to_str().unwrap()]);
    assert!(text.contains("camera     fx 61.00 fy 60.00 cx 32.00 cy 24.00 px"), "{text}");
}

#[test]
fn huge_number_is_printed_in_few_digits() {
    let composite_options = ["--set", "noise.scale=1e300", "--frames", "0..1", "-o", "-"];
    let text =
        refused(&[&["composite", "recordings/demo", "--scene", "scenes/demo.toml"][..], &composite_options].concat());
    assert!(text.contains("noise.scale = 1e300: expected"), "{text}");
    let inspect_options = ["--frame", "0", "--pick", "1e300,-1e300", "--plane", "0,0,1,1e300"];
    let text = refused(&[&["inspect", "recordings/demo"][..], &inspect_options].concat());
    assert!(text.len() < 200 && text.contains("1e300,-1e300"), "{text}");
}

#[test]
fn malformed_values_are_refused_with_an_example() {
    let inspect = ["inspect", "recordings/demo", "--frame", "0", "--pick"];
    let text = refused(&[&inspect[..], &["32"]].concat());
    assert!(text.contains("32: expected 2 numbers with commas between, as in 320,240.5"), "{text}");
    let text = refused(&[&inspect[..], &["32,24", "--plane", "0,0,1"]].concat());
    assert!(text.contains("0,0,1: expected 4 numbers with commas between, as in 0,0,1,0.75"), "{text}");
    let text = refused(&["calibrate", "sharpness", "recordings/demo", "--frame", "0", "--edge", "1,2"]);
    assert!(text.contains("1,2: expected 4 numbers with commas between, as in 600,380,680,460"), "{text}");
    let text = refused(&["track", "recordings/demo/rgb.mp4", "--profile", "nosuch", "-o", "tracked"]);
    assert!(text.contains("--profile nosuch: cannot be read") && text.contains("locard calibrate camera"), "{text}");
}

/// If variables exclude every adapter, the message names them and the excluded adapters.
#[test]
fn adapter_filter_without_matches_is_distinguished_from_a_missing_driver() {
    let output = program().arg("doctor").env("WGPU_ADAPTER_NAME", "no such card").output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("WGPU_ADAPTER_NAME=no such card leaves out every graphics adapter"), "{text}");
    let first = text.lines().find_map(|line| line.strip_prefix("adapter   ")).unwrap();
    assert!(text.contains(&format!("without it there are: {}", first.split(" (").next().unwrap())), "{text}");
}

#[test]
fn empty_selection_lists_the_available_names() {
    let arguments = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "-o", "-", "--only", ""];
    let text = refused(&arguments);
    assert!(
        text.contains("--only") && ["there are: ", "motion_blur", "noise"].iter().all(|name| text.contains(name)),
        "{text}"
    );
    let text = refused(&["simulate", "-o", "recordings/demo"]);
    assert!(text.contains("--force"), "{text}");
    let list = stdout_of(&["simulate", "--list"]);
    assert!(list.contains("frames = 72    (") && list.contains("fps = 30 1/s    ("), "{list}");
}

#[test]
fn trajectory_that_covers_no_frame_is_an_error() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    std::fs::write(temp.path().join("poses.txt"), "50 0 0 0 0 0 0 1\n51 0 0 0 0 0 0 1\n").unwrap();
    let (recording, out) = (temp.path().to_str().unwrap(), temp.path().join("out"));
    let profile = ["--profile", "profiles/simulated.toml", "-o", out.to_str().unwrap()];
    let text = refused(&[&["composite", recording, "--scene", "scenes/marker-1.glb"], &profile[..]].concat());
    assert!(text.contains("none of the recording's 6 frames has a pose"), "{text}");
}

#[test]
fn range_without_poses_passes_the_footage_through() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let (folder, out) = (temp.path().to_str().unwrap(), temp.path().join("out"));
    // Frames at 0, 1/30, ... 5/30 s; the last two are after the poses.
    std::fs::write(temp.path().join("poses.txt"), "0 0 0 0 0 0 0 1\n0.11 0 0 0 0 0 0 1\n").unwrap();
    let scene = ["--scene", "scenes/marker-1.glb", "--profile", "profiles/simulated.toml"];
    let arguments = [&["composite", folder], &scene[..], &["--frames", "4..6", "-o", out.to_str().unwrap()]].concat();
    let arguments = [&arguments[..], tier::no_shadows()].concat();
    let text = refused(&[&arguments[..], &["--strict"]].concat());
    assert!(text.contains("frame 4 has no pose") && !out.exists(), "{text}");
    let output = locard(&arguments);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("no pose for 2 of 2 frames (frame 4"), "{text}");
    for i in 4..6 {
        let recorded = image::open(format!("recordings/demo/rgb/{i:05}.jpg")).unwrap().into_rgb8();
        assert!(recorded == image::open(out.join(format!("frame_{i:06}.png"))).unwrap().into_rgb8());
    }
}

#[test]
fn incomplete_camera_is_refused_unless_the_recording_has_one() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("fx.toml"), "version = 1\n[camera]\nfx_px = 500\n").unwrap();
    let (recording, out, profile) = (path(""), path("out"), path("fx.toml"));
    let arguments =
        ["composite", &recording, "--scene", "scenes/marker-1.glb", "--plain", "--frames", "0..1", "-o", &out];
    for options in [["--set", "camera.readout_time_s=0"], ["--set", "camera.width_px=640"], ["--profile", &profile]] {
        let text = refused(&[&arguments[..], &options].concat());
        assert!(
            text.contains("the given camera is incomplete")
                && text.contains("camera.fy_px")
                && text.contains("camera.cx_px"),
            "{text}"
        );
        assert!(!text.contains("camera.readout_time_s"), "{text}");
    }
    for options in [&[][..], &["--set", "camera.exposure.time_s=0"], &["--set", "noise.scale=0"]] {
        let text = refused(&[&arguments[..], options].concat());
        assert!(text.contains("is unknown: give a profile"), "{text}");
    }
    assert!(!Path::new(&out).exists());
    let whole = ["width_px=640", "height_px=480", "fx_px=520", "fy_px=520", "cx_px=320", "cy_px=240"];
    let whole: Vec<String> = whole.iter().flat_map(|set| ["--set".to_owned(), format!("camera.{set}")]).collect();
    let whole: Vec<&str> = whole.iter().map(String::as_str).collect();
    assert!(locard(&[&arguments[..], &whole].concat()).status.success());

    // The demonstration has a camera: further values override parts of it.
    let demo = |sets: &[&str]| {
        let scene =
            ["composite", "recordings/demo", "--scene", tier::any_scene(), "--plain", "--frames", "30..31", "-o", "-"];
        let output = locard(&[&scene[..], sets].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let own = demo(&[]);
    assert!(own == demo(&["--set", "camera.readout_time_s=0.015"]), "as it has it");
    assert!(own != demo(&["--profile", &profile]));
}

#[test]
fn truncated_picture_with_trailing_data_is_refused() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let frame = path("rgb/00003.jpg");
    let ended = [&std::fs::read(&frame).unwrap()[..], b"\xff\xd9"].concat();
    std::fs::write(&frame, ended).unwrap();
    let (recording, out) = (path(""), path("out"));
    let arguments = ["composite", &recording, "--scene", "scenes/marker-1.glb", "--profile", "profiles/simulated.toml"];
    let text = refused(&[&arguments[..], &["-o", &out]].concat());
    assert!(text.contains("00003.jpg: the JPEG is truncated after"), "{text}");
    let text = stdout_of(&["inspect", &recording]);
    assert!(text.contains("6 pictures, 1 cannot be read"), "{text}");
}

#[test]
fn plane_without_a_normal_is_refused() {
    let arguments = ["inspect", "recordings/demo", "--frame", "30", "--pick", "320,300", "--plane", "0,0,0,0"];
    assert!(refused(&arguments).contains("--plane: 0,0,0,0 is not a plane: the normal A,B,C has no length"));
}

#[test]
fn profile_of_noise_alone_overrides_the_recorded_noise_and_keeps_the_camera() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let noise = "version = 1\n[camera.noise]\nchannel_correlation = [0.0, 0.0, 0.0]\n\
                 neighbour_correlation = [0.0, 0.0]\ncode = [0.0, 255.0]\n\
                 sigma_r = [30.0, 30.0]\nsigma_g = [30.0, 30.0]\nsigma_b = [30.0, 30.0]\n";
    std::fs::write(path("noisy.toml"), noise).unwrap();
    let arguments = ["composite", "recordings/demo", "--scene", tier::any_scene(), "--frames", "30..31", "-o", "-"];
    let arguments = [&arguments[..], tier::no_shadows()].concat();
    let own = locard(&arguments);
    let noisy = locard(&[&arguments[..], &["--profile", &path("noisy.toml")]].concat());
    assert!(own.status.success() && noisy.status.success(), "{}", String::from_utf8_lossy(&noisy.stderr));
    // The camera is the recording's, so the evidence is in the same place; only its noise changes.
    let changed = own.stdout.iter().zip(&noisy.stdout).filter(|(a, b)| a.abs_diff(**b) > 10).count();
    assert!((500..20_000).contains(&changed), "{changed} of {}", own.stdout.len());
}

#[test]
fn another_seed_gives_other_noise_and_the_same_seed_the_same() {
    let temp = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(temp.path().join(name), text).unwrap();
    image::RgbImage::from_pixel(64, 48, image::Rgb([90; 3])).save(temp.path().join("a.png")).unwrap();
    write("rgb.txt", "0 a.png\n1 a.png\n");
    write("poses.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n");
    write(
        "recording.toml",
        "version = 1\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\nmax_gap_s = 2.0\n\
         [camera]\nprofile = \"camera.toml\"\n",
    );
    write(
        "camera.toml",
        "version = 1\n[camera]\nwidth_px = 64\nheight_px = 48\nfx_px = 60\nfy_px = 60\ncx_px = 32\ncy_px = 24\n\
         [camera.noise]\nchannel_correlation = [0.0, 0.0, 0.0]\nneighbour_correlation = [0.0, 0.0]\n\
         code = [0.0, 255.0]\nsigma_r = [30.0, 30.0]\nsigma_g = [30.0, 30.0]\nsigma_b = [30.0, 30.0]\n",
    );
    let marker = std::fs::canonicalize("scenes/marker-1.glb").unwrap();
    write("scene.toml", &format!("version = 1\n[[objects]]\nmodel = {marker:?}\nposition_m = [0, 0, 0.3]\n"));
    let (recording, scene) = (temp.path().to_str().unwrap(), temp.path().join("scene.toml"));
    let of_seed = |seed: &str| {
        let usual = ["composite", recording, "--scene", scene.to_str().unwrap(), "--frames", "0..1", "-o", "-"];
        let output = locard(&[&usual[..], &["--only", "noise", "--seed", seed], tier::no_shadows()].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let first = of_seed("1");
    assert!(first == of_seed("1"));
    // The marker covers more than 50 pixels, whose noise has σ 30 in each channel.
    let differing = first.iter().zip(&of_seed("2")).filter(|(a, b)| a.abs_diff(**b) > 10).count();
    assert!(differing > 50, "{differing} values differ");
}

#[test]
fn impossible_effect_settings_are_refused_before_any_output() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let star = ["--scene", tier::any_scene(), "--set", "depth_of_field.shape=star"];
    let composite = ["composite", "recordings/demo", "--frames", "5..7", "-o", out.to_str().unwrap()];
    let text = refused(&[&composite[..], &star].concat());
    assert!(text.contains("depth_of_field.shape") && text.contains("diffusion"), "{text}");
    assert!(!out.exists());
    let picture = temp.path().join("a.jpg");
    let photo = ["photo", "recordings/demo", "--frame", "5", "--lux", "300", "-o", picture.to_str().unwrap()];
    let text = refused(&[&photo[..], &star].concat());
    assert!(text.contains("depth_of_field.shape") && !picture.exists(), "{text}");
    // An effect that is off is not checked.
    let output = locard(&[&composite[..], &star, &["--without", "depth_of_field"], tier::no_shadows()].concat());
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn frames_with_depth_but_no_pose_are_reported() {
    let temp = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(temp.path().join(name), text).unwrap();
    image::RgbImage::from_pixel(64, 48, image::Rgb([90; 3])).save(temp.path().join("a.png")).unwrap();
    image::ImageBuffer::from_pixel(64, 48, image::Luma([1000u16])).save(temp.path().join("depth.png")).unwrap();
    // Poses at the frames' own times; the second frame's depth was measured in the gap between
    // them.
    write("rgb.txt", "0 a.png\n1 a.png\n");
    write("depth.txt", "0 depth.png\n0.9 depth.png\n");
    write("poses.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n");
    write(
        "recording.toml",
        "version = 1\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\nmax_gap_s = 0.5\n\
         [depth]\nlist = \"depth.txt\"\nscale = 1000\n[camera]\nprofile = \"camera.toml\"\n",
    );
    write(
        "camera.toml",
        "version = 1\n[camera]\nwidth_px = 64\nheight_px = 48\nfx_px = 60\nfy_px = 60\ncx_px = 32\ncy_px = 24\n",
    );
    let marker = std::fs::canonicalize("scenes/marker-1.glb").unwrap();
    write("scene.toml", &format!("version = 1\n[[objects]]\nmodel = {marker:?}\nposition_m = [0, 0, 0.5]\n"));
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let (report, scene) = (path("report.json"), path("scene.toml"));
    let (recording, out) = (path(""), path("out"));
    let arguments = ["composite", &recording, "--scene", &scene, "--report", &report, "-o", &out];
    let output = locard(&[&arguments[..], tier::no_shadows()].concat());
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    assert!(
        stderr.contains("in 1 of 2 frames, although there is depth (frame 1: no pose of the depth: 0.900000 s"),
        "{stderr}"
    );
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    let why = |frame: usize| report["frames"][frame]["no_occlusion"].clone();
    assert!(why(0).is_null() && why(1).as_str().unwrap().contains("gap"), "{report}");
}

/// Parses "poses 7.2 ms earlier fit …", ms.
fn earlier_ms(inspected: &str) -> f64 {
    let line = inspected.lines().find_map(|line| line.strip_prefix("clock      poses ")).expect(inspected);
    let (number, rest) = line.split_once(" ms ").expect(line);
    number.parse::<f64>().unwrap() * if rest.starts_with("earlier") { 1.0 } else { -1.0 }
}

#[test]
fn clock_offset_of_poses_is_found_from_the_pictures() {
    let temp = tempfile::tempdir().unwrap();
    let late = temp.path().join("late");
    copied(Path::new("recordings/demo"), &late);
    let description = std::fs::read_to_string(late.join("recording.toml")).unwrap();
    let named = "trajectory = \"groundtruth.txt\"\n";
    let moved = description.replace(named, &format!("{named}time_offset_s = 0.1\n"));
    std::fs::write(late.join("recording.toml"), moved).unwrap();
    // The camera translates as much as it rotates, which reduces the precision: 4 ms is one
    // standard deviation.
    let text = stdout_of(&["inspect", late.to_str().unwrap(), "--clock"]);
    assert!((earlier_ms(&text) - 100.0).abs() < 12.0 && text.contains("(now 0.1000)"), "{text}");
    if !tier::is_full() {
        return;
    }
    let Some(tum) = data_if_any("tum-fr1-rpy") else { return };
    // By full alignment its poses fit 5 ms earlier.
    let text = stdout_of(&["inspect", tum.to_str().unwrap(), "--profile", "profiles/tum-fr1.toml", "--clock"]);
    assert!((earlier_ms(&text) - 5.0).abs() < 4.0, "{text}");
}
