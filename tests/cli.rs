//! What the program says.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "common/program.rs"]
mod program;

use std::path::Path;
use std::process::Command;

use program::{locard, program, refused, said};

#[test]
fn composite_is_silent_in_a_pipe_and_writes_what_was_asked_for() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let (frames, layers, report) = (path("frames"), path("layers"), path("report.json"));
    let scene = ["--scene", "scenes/demo.toml", "--frames", "5..7"];
    let arguments =
        [&["composite", "recordings/demo"], &scene[..], &["-o", &frames, "--layers", &layers, "--report", &report]]
            .concat();
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

    // Once more: what is there is kept, and that is all there is to say.
    let text = refused(&arguments);
    assert!(text.contains("exists already") && text.lines().count() == 1, "{text}");

    // The same frames as raw values: only they are on the standard output.
    let raw = locard(&[&["composite", "recordings/demo"], &scene[..], &["-o", "-"]].concat());
    assert_eq!((raw.stdout.len(), raw.stderr.len()), (2 * 3 * 640 * 480, 0));
    let first = image::open(Path::new(&frames).join(&files(&frames)[0])).unwrap().into_rgb8();
    assert!(first.as_raw()[..] == raw.stdout[..3 * 640 * 480]);
}

#[test]
fn inspect_tells_what_is_there() {
    let text = said(&["inspect", "scenes/demo.toml"]);
    assert!(text.contains("light      0 suns, 0 lamps, a panorama of 256x128 px"), "{text}");
    assert!(text.contains("object     marker 1: ") && !text.contains("-0.000"), "{text}");
    let temp = tempfile::tempdir().unwrap();
    let sunny = temp.path().join("sunny.toml");
    std::fs::write(&sunny, "version = 1\n[light]\nambient = 0.5\n[[light.sun]]\ntowards = [0, 0, 1]\n").unwrap();
    let text = said(&["inspect", sunny.to_str().unwrap()]);
    assert!(text.contains("light      1 sun, 0 lamps, 0.5 from everywhere"), "{text}");
    let text = said(&["inspect", "scenes/l-scale.glb"]);
    assert!(text.contains("triangles, 1 material\n"), "{text}");
    let text = said(&["inspect", "profiles/simulated.toml"]);
    assert!(text.contains("picture    640x480 px") && text.contains("time_s = 0.0166667 s, iso = 400\n"), "{text}");
    let text = said(&["inspect", "recordings/demo"]);
    assert!(text.contains("exposure   known for 72 of 72 frames"), "{text}");
}

#[test]
fn one_scene_is_one_scene() {
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
    let text = said(&["calibrate", "noise", temp.path().to_str().unwrap(), "-o", profile.to_str().unwrap()]);
    assert!(text.starts_with("1 scene, 3 frames; "), "{text}");
}

#[test]
fn pictures_without_times_are_not_blurred_by_motion() {
    let temp = tempfile::tempdir().unwrap();
    // Two pictures half a metre apart: at 30 a second any exposure would smear what stands 2 m away.
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
    let output = locard(&[
        "composite",
        &recording,
        "--scene",
        "scenes/marker-1.glb",
        "--report",
        &report_path,
        "-o",
        &out,
        "--force",
    ]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && stderr.contains("nothing is blurred by motion"), "{stderr}");
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    for frame in report["frames"].as_array().unwrap() {
        assert_eq!(frame["exposure_time_s"], 0.0);
        assert!(!frame["effects"].as_array().unwrap().contains(&"motion_blur".into()), "{frame}");
    }
}

/// Six of the demonstration's frames, the fourth cut off in the middle, in a folder of its own.
fn with_a_truncated_frame(folder: &Path) {
    std::fs::create_dir(folder.join("rgb")).unwrap();
    let mut list = String::new();
    for i in 0..6 {
        let bytes = std::fs::read(format!("recordings/demo/rgb/{i:05}.jpg")).unwrap();
        let whole = if i == 3 { bytes.len() / 2 } else { bytes.len() };
        std::fs::write(folder.join(format!("rgb/{i:05}.jpg")), &bytes[..whole]).unwrap();
        list += &format!("{} rgb/{i:05}.jpg\n", f64::from(i) / 30.0);
    }
    std::fs::write(folder.join("rgb.txt"), list).unwrap();
    std::fs::write(folder.join("poses.txt"), "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").unwrap();
    let text = "version = 1\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\nmax_gap_s = 2.0\n";
    std::fs::write(folder.join("recording.toml"), text).unwrap();
}

#[test]
fn a_run_that_fails_leaves_no_video_and_loses_none() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let (recording, video) = (path("."), path("out.mkv"));
    let arguments = ["composite", &recording, "--scene", "scenes/marker-1.glb", "--profile", "profiles/simulated.toml"];
    let text = refused(&[&arguments[..], &["-o", &video]].concat());
    assert!(text.contains("00003.jpg") && text.contains("truncated"), "{text}");
    assert!(!Path::new(&video).exists());

    std::fs::write(&video, "what the user had").unwrap();
    refused(&[&arguments[..], &["-o", &video, "--force"]].concat());
    assert_eq!(std::fs::read_to_string(&video).unwrap(), "what the user had");

    let text = refused(&["calibrate", "noise", &path("rgb"), "-o", &path("p.toml")]);
    assert!(text.contains("00003.jpg") && text.contains("truncated"), "{text}");
    let text = refused(&["calibrate", "noise", &path("nowhere"), "-o", &path("p.toml")]);
    assert!(text.contains("nowhere") && !Path::new(&path("p.toml")).exists(), "{text}");
}

#[test]
fn inspect_names_the_pictures_that_end_too_early() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let text = said(&["inspect", temp.path().to_str().unwrap()]);
    assert!(text.contains("files      6 pictures, 1 ends too early; pixels are not decoded\n"), "{text}");
    assert!(text.contains("00003.jpg: the JPEG is truncated"), "{text}");
    let text = said(&["inspect", "recordings/demo"]);
    assert!(text.contains("files      144 pictures, none ends too early; pixels are not decoded\n"), "{text}");
}

#[test]
fn what_cannot_be_written_is_said_before_the_work() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let out = path("v.mkv");
    let arguments = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "0..1", "-o", &out];
    let text = refused(&[&arguments[..], &["--report", &out]].concat());
    assert!(text.contains("is the output already"), "{text}");
    let text = refused(&[&arguments[..], &["--report", &path("no/report.json")]].concat());
    assert!(text.contains("there is no folder"), "{text}");
    assert!(!Path::new(&out).exists());
}

#[test]
fn the_recording_is_not_written_into() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let before = std::fs::read_dir(temp.path().join("rgb")).unwrap().count();
    for (out, told) in
        [(path(""), "is the recording's folder"), (path("rgb/../rgb"), "is the folder of the recording's frames")]
    {
        let profile = ["--scene", "scenes/marker-1.glb", "--profile", "profiles/simulated.toml", "--force", "-o", &out];
        let text = refused(&[&["composite", &path("recording.toml")], &profile[..]].concat());
        assert!(text.contains(told), "{text}");
    }
    assert_eq!(std::fs::read_dir(temp.path().join("rgb")).unwrap().count(), before);
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_nothing_unfinished() {
    let temp = tempfile::tempdir().unwrap();
    let (video, partial) = (temp.path().join("out.mkv"), temp.path().join(".out.partial.mkv"));
    // What a run that was killed left behind does not stand in the way.
    std::fs::write(&partial, "half of a video").unwrap();
    let left_behind = |file: std::fs::Metadata| file.len() == 15;
    let mut running = program()
        .args(["composite", "recordings/demo", "--scene", "scenes/demo.toml", "-o"])
        .arg(&video)
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while std::fs::metadata(&partial).is_ok_and(left_behind) && running.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    Command::new("kill").args(["-INT", &running.id().to_string()]).status().unwrap();
    let output = running.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{text}");
    assert!(text.starts_with("locard: interrupted"), "{text}");
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 0);
}

#[cfg(unix)]
#[test]
fn an_interrupted_simulation_leaves_nothing() {
    let temp = tempfile::tempdir().unwrap();
    for signal in ["-INT", "-TERM"] {
        // A short lens makes a crude site, which is soon lit.
        let sets = ["focal_px=20", "width_px=32", "height_px=24", "frames=10000"].map(|set| ["--set", set]);
        let mut running = program()
            .args(["simulate", "-o"])
            .arg(temp.path().join("site"))
            .args(sets.as_flattened())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let begun = || std::fs::read_dir(temp.path()).unwrap().count() > 0;
        while !begun() && running.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        assert!(begun());
        Command::new("kill").args([signal, &running.id().to_string()]).status().unwrap();
        let output = running.wait_with_output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), text.lines().count()), (Some(130), 1), "{text}");
        assert!(text.starts_with("locard: interrupted; nothing was written"), "{text}");
        assert!(!begun());
    }
}

/// Variables that leave out every adapter are blamed, and what they leave out is named.
#[test]
fn a_filter_that_leaves_nothing_is_told_from_a_missing_driver() {
    let output = program().arg("doctor").env("WGPU_ADAPTER_NAME", "no such card").output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("WGPU_ADAPTER_NAME=no such card leaves out every graphics adapter"), "{text}");
    let first = text.lines().find_map(|line| line.strip_prefix("adapter   ")).unwrap();
    assert!(text.contains(&format!("without it there are: {}", first.split(" (").next().unwrap())), "{text}");
}

#[test]
fn what_is_there_is_named_where_nothing_was_asked_for() {
    let arguments = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "-o", "-", "--only", ""];
    let text = refused(&arguments);
    assert!(
        text.contains("--only") && ["there are: ", "motion_blur", "noise"].iter().all(|name| text.contains(name)),
        "{text}"
    );
    let text = refused(&["simulate", "-o", "recordings/demo"]);
    assert!(text.contains("--force"), "{text}");
    let list = said(&["simulate", "--list"]);
    assert!(list.contains("frames = 72    (") && list.contains("fps = 30 1/s    ("), "{list}");
}

#[test]
fn a_trajectory_that_covers_no_frame_is_an_error() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    std::fs::write(temp.path().join("poses.txt"), "50 0 0 0 0 0 0 1\n51 0 0 0 0 0 0 1\n").unwrap();
    let (recording, out) = (temp.path().to_str().unwrap(), temp.path().join("out"));
    let profile = ["--profile", "profiles/simulated.toml", "-o", out.to_str().unwrap()];
    let text = refused(&[&["composite", recording, "--scene", "scenes/marker-1.glb"], &profile[..]].concat());
    assert!(text.contains("none of the frames 0..6 has a pose"), "{text}");
}

#[test]
fn a_profile_of_noise_alone_stands_above_the_recordings_own() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let noise = "version = 1\n[camera.noise]\nchannel_correlation = [0.0, 0.0, 0.0]\n\
                 neighbour_correlation = [0.0, 0.0]\ncode = [0.0, 255.0]\n\
                 sigma_r = [30.0, 30.0]\nsigma_g = [30.0, 30.0]\nsigma_b = [30.0, 30.0]\n";
    std::fs::write(path("noisy.toml"), noise).unwrap();
    let arguments = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "30..31", "-o", "-"];
    let own = locard(&arguments);
    let noisy = locard(&[&arguments[..], &["--profile", &path("noisy.toml")]].concat());
    assert!(own.status.success() && noisy.status.success(), "{}", String::from_utf8_lossy(&noisy.stderr));
    // The camera stays the recording's, so that the evidence lies where it lay; only its noise is another.
    let changed = own.stdout.iter().zip(&noisy.stdout).filter(|(a, b)| a.abs_diff(**b) > 10).count();
    assert!((500..20_000).contains(&changed), "{changed} of {}", own.stdout.len());
}

#[test]
fn what_no_effect_can_do_is_refused_before_anything_is_written() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let star = ["--scene", "scenes/demo.toml", "--set", "depth_of_field.shape=star"];
    let composite = ["composite", "recordings/demo", "--frames", "5..7", "-o", out.to_str().unwrap()];
    let text = refused(&[&composite[..], &star].concat());
    assert!(text.contains("depth_of_field.shape") && text.contains("diffusion"), "{text}");
    assert!(!out.exists());
    let picture = temp.path().join("a.jpg");
    let photo = ["photo", "recordings/demo", "--frame", "5", "--lux", "300", "-o", picture.to_str().unwrap()];
    let text = refused(&[&photo[..], &star].concat());
    assert!(text.contains("depth_of_field.shape") && !picture.exists(), "{text}");
    // Switched off, it is nobody's business.
    let output = locard(&[&composite[..], &star, &["--without", "depth_of_field"]].concat());
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn frames_whose_depth_has_no_pose_are_told_of() {
    let temp = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(temp.path().join(name), text).unwrap();
    image::RgbImage::from_pixel(64, 48, image::Rgb([90; 3])).save(temp.path().join("a.png")).unwrap();
    image::ImageBuffer::from_pixel(64, 48, image::Luma([1000u16])).save(temp.path().join("depth.png")).unwrap();
    // Poses at the frames' own times; the second frame's depth was measured in the gap between them.
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
    let output = locard(&["composite", &path(""), "--scene", &scene, "--report", &report, "-o", &path("out")]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    assert!(
        stderr.contains("in 1 of 2 frames, though there is depth (frame 1: no pose of the depth: 0.900000 s"),
        "{stderr}"
    );
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    let why = |frame: usize| report["frames"][frame]["no_occlusion"].clone();
    assert!(why(0).is_null() && why(1).as_str().unwrap().contains("gap"), "{report}");
}
