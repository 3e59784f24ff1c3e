//! Output files: allowed paths, and their state after a run that ends early.

use std::path::Path;
use std::process::Command;

use crate::program::{locard, program, refused, stdout_of, with_a_truncated_frame};
use crate::tier;

#[test]
fn failed_run_leaves_no_video_and_keeps_the_existing_one() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let (recording, video) = (path("."), path("out.mkv"));
    let arguments = ["composite", &recording, "--scene", "scenes/marker-1.glb", "--profile", "profiles/simulated.toml"];
    let arguments = [&arguments[..], tier::no_shadows()].concat();
    let text = refused(&[&arguments[..], &["-o", &video]].concat());
    assert!(text.contains("00003.jpg") && text.contains("truncated"), "{text}");
    assert!(!Path::new(&video).exists());

    let record = format!("{video}.record.json");
    for file in [&video, &record] {
        std::fs::write(file, "what the user had").unwrap();
    }
    refused(&[&arguments[..], &["-o", &video, "--force"]].concat());
    for file in [&video, &record] {
        assert_eq!(std::fs::read_to_string(file).unwrap(), "what the user had");
    }

    let text = refused(&["calibrate", "noise", &path("rgb"), "-o", &path("p.toml")]);
    assert!(text.contains("00003.jpg") && text.contains("truncated"), "{text}");
    let text = refused(&["calibrate", "noise", &path("nowhere"), "-o", &path("p.toml")]);
    assert!(text.contains("nowhere") && !Path::new(&path("p.toml")).exists(), "{text}");
}

#[test]
fn unwritable_output_is_refused_before_the_work() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let out = path("v.mkv");
    let arguments = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "0..1", "-o", &out];
    let text = refused(&[&arguments[..], &["--report", &out]].concat());
    assert!(text.contains("is the output already"), "{text}");
    std::fs::write(path("no"), "").unwrap();
    let text = refused(&[&arguments[..], &["--report", &path("no/report.json")]].concat());
    assert!(text.contains("is a file and no folder"), "{text}");
    assert!(!Path::new(&out).exists());
    let demo = ["recordings/demo", "--frame", "0", "--lux", "300"];
    let scene = ["--scene", "scenes/demo.toml", "-o"];
    let (jpg, png, toml) = (path("no/a.jpg"), path("no/a.png"), path("no/a.toml"));
    for arguments in [
        [&["photo"], &demo[..], &scene, &[&jpg]].concat(),
        vec!["render", "scenes/marker-1.glb", "-o", &png],
        vec!["calibrate", "noise", "recordings/demo/rgb", "-o", &toml],
    ] {
        let text = refused(&arguments);
        assert!(text.contains("is a file and no folder; choose another place"), "{arguments:?}: {text}");
    }
    let folder = path("folder.png");
    std::fs::create_dir(&folder).unwrap();
    let text = refused(&["render", "scenes/marker-1.glb", "--force", "-o", &folder]);
    assert!(text.contains("is a folder; name a file"), "{text}");
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 2);
}

#[test]
fn missing_output_folders_are_created_after_the_input_is_checked() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let sheet = path("new/inner/sheet.png");
    assert!(locard(&["board", "-q", "-o", &sheet]).status.success());
    assert!(Path::new(&sheet).is_file() && Path::new(&path("new/inner/sheet.toml")).is_file());

    std::fs::write(path("a.jls"), b"\xff\xd8\xff\xf7\0\x0b").unwrap();
    std::fs::write(path("a.jpg"), "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n").unwrap();
    std::fs::write(path("a.hdr"), "#?RADIANCE\n").unwrap();
    std::fs::write(path("s.toml"), "version = 1\n[light]\nenvironment = \"a.hdr\"\n").unwrap();
    for (input, message) in [
        (["render", &path("s.toml")].to_vec(), "a.hdr: the panorama"),
        (["calibrate", "camera", &path("a.jls")].to_vec(), "is JPEG-LS, which is not read; convert it"),
        (["calibrate", "noise", &path("a.jpg")].to_vec(), "Git LFS pointer"),
        (["calibrate", "sharpness", &path("a.jpg"), "--edge", "0,0,9,9"].to_vec(), "Git LFS pointer"),
        (["track", &path("a.jpg"), "--profile", "profiles/simulated.toml"].to_vec(), "Git LFS pointer"),
    ] {
        // Neither with a missing folder nor with another error of the output.
        for output in ["none/p.toml", "a.jls/p.toml"] {
            let text = refused(&[&input[..], &["-o", &path(output)]].concat());
            assert!(text.contains(message) && !Path::new(&path("none")).exists(), "{input:?}: {text}");
        }
    }
}

/// The reader of the frames may stop early, but a report covers all of them.
#[test]
fn report_missing_after_a_closed_pipe_is_reported() {
    let temp = tempfile::tempdir().unwrap();
    let report = temp.path().join("r.json");
    let run = |more: &[&std::ffi::OsStr]| {
        let demo =
            ["composite", "recordings/demo", "--scene", tier::any_scene(), "--plain", "--frames", "5..9", "-o", "-"];
        let mut command = program();
        command.args(demo).args(more).stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        let mut running = command.spawn().unwrap();
        drop(running.stdout.take());
        let output = running.wait_with_output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    assert_eq!(run(&[]), (Some(0), String::new()));
    let (code, text) = run(&["--report".as_ref(), report.as_os_str()]);
    assert!(code == Some(2) && text.contains("r.json: was not written") && !report.exists(), "{code:?}: {text}");
}

/// Outputs of one run may not overlap, with `--force` or without.
#[test]
fn overlapping_outputs_of_one_run_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let demo = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "5..7", "--force"];
    let (out, layers, video) = (path("out"), path("layers"), path("v.mkv"));
    std::fs::create_dir(&out).unwrap();
    for report in ["out/frame_000006.png", "layers/layer_000005.exr", "layers/../out/frame_000005.png", "layers", "out"]
    {
        let report = path(report);
        let text = refused(&[&demo[..], &["-o", &out, "--layers", &layers, "--report", &report]].concat());
        assert!(text.contains("is the output already"), "{report}: {text}");
    }
    for layers in [&video, &path("v.mkv/layers")] {
        let text = refused(&[&demo[..], &["-o", &video, "--layers", layers]].concat());
        assert!(text.contains("is written in this run already"), "{text}");
    }
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 1);
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0);
}

/// A replacement of ffmpeg that reads nothing and exits with success.
#[cfg(unix)]
#[test]
fn silent_early_exit_of_ffmpeg_is_a_failure() {
    use std::os::unix::fs::PermissionsExt;
    let temp = tempfile::tempdir().unwrap();
    let (bin, out) = (temp.path().join("bin"), temp.path().join("out"));
    for folder in [&bin, &out] {
        std::fs::create_dir(folder).unwrap();
    }
    let ffmpeg = bin.join("ffmpeg");
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    for script in ["#!/bin/sh\nexit 0\n", "#!/bin/sh\ncat > /dev/null\n"] {
        std::fs::write(&ffmpeg, script).unwrap();
        std::fs::set_permissions(&ffmpeg, std::fs::Permissions::from_mode(0o755)).unwrap();
        let demo = ["composite", "recordings/demo", "--scene", tier::any_scene(), "--plain", "--frames", "0..4", "-o"];
        let output = program().args(demo).arg(out.join("v.mkv")).env("PATH", &path).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{script}: {text}");
        assert!(text.contains("v.mkv: ffmpeg ended before it received all frames"), "{text}");
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0);
    }
}

/// Thread stacks of four GiB, of which one fits.
#[cfg(target_os = "linux")]
#[test]
fn failed_thread_creation_is_reported_in_one_line_and_leaves_no_files() {
    let temp = tempfile::tempdir().unwrap();
    for limit_kb in [2_000_000, 7_000_000] {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("ulimit -v {limit_kb}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_locard")]);
        command.args([
            "composite",
            "recordings/demo",
            "--scene",
            tier::any_scene(),
            "--plain",
            "--frames",
            "0..4",
            "-o",
        ]);
        let output = command.arg(temp.path().join("v.mkv")).env("RUST_MIN_STACK", "4294967296").output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), text.lines().count()), (Some(2), 1), "{limit_kb}: {text}");
        assert!(text.starts_with("locard: the pro"), "{text}");
        assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 0);
    }
}

/// Starts the program and interrupts it as soon as `folder` contains a file. Asserts that it
/// reports this and leaves nothing there.
#[cfg(unix)]
fn assert_interrupted_cleanly(command: &mut Command, folder: &Path, signal: &str) {
    let begun = || std::fs::read_dir(folder).unwrap().count() > 0;
    let mut running = command.stderr(std::process::Stdio::piped()).spawn().unwrap();
    while !begun() && running.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    assert!(begun());
    Command::new("kill").args([signal, &running.id().to_string()]).status().unwrap();
    let output = running.wait_with_output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), text.lines().count()), (Some(2), 1), "{text}");
    assert!(text.starts_with("locard: interrupted; finished files are kept, unfinished ones are removed"), "{text}");
    assert!(!begun(), "{command:?}");
}

/// A frame of many samples takes minutes with a software driver.
#[cfg(unix)]
#[test]
fn heavy_frame_is_interrupted_at_once() {
    let temp = tempfile::tempdir().unwrap();
    let heavy = ["depth_of_field.method=reference", "camera.lens.f_number=0.5", "camera.lens.focus_distance_m=0.2"];
    for out in ["out.mkv", "new/frames"] {
        let mut command = program();
        command.args(["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "71..72"]);
        command
            .args(tier::no_shadows())
            .arg("-o")
            .arg(temp.path().join(out))
            .args(heavy.map(|set| ["--set", set]).as_flattened());
        assert_interrupted_cleanly(&mut command, temp.path(), "-INT");
    }
}

#[test]
fn output_into_the_recording_is_refused() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let before = std::fs::read_dir(temp.path().join("rgb")).unwrap().count();
    for (out, message) in
        [(path(""), "is the recording's folder"), (path("rgb/../rgb"), "is the folder of the recording's frames")]
    {
        let profile = ["--scene", "scenes/marker-1.glb", "--profile", "profiles/simulated.toml", "--force", "-o", &out];
        let text = refused(&[&["composite", &path("recording.toml")], &profile[..]].concat());
        assert!(text.contains(message), "{text}");
    }
    assert_eq!(std::fs::read_dir(temp.path().join("rgb")).unwrap().count(), before);
}

#[cfg(unix)]
#[test]
fn interrupted_run_leaves_no_unfinished_files() {
    let temp = tempfile::tempdir().unwrap();
    let mut command = program();
    command.args(["composite", "recordings/demo", "--scene", "scenes/demo.toml"]).args(tier::no_shadows());
    assert_interrupted_cleanly(command.arg("-o").arg(temp.path().join("out.mkv")), temp.path(), "-INT");
}

#[cfg(unix)]
#[test]
fn interrupted_simulation_leaves_no_files() {
    let temp = tempfile::tempdir().unwrap();
    for signal in ["-INT", "-TERM"] {
        // A short lens gives a crude site, which is lit quickly.
        let sets = ["focal_px=20", "width_px=32", "height_px=24", "frames=10000"].map(|set| ["--set", set]);
        let mut command = program();
        command.args(["simulate", "-o"]).arg(temp.path().join("site")).args(sets.as_flattened());
        assert_interrupted_cleanly(&mut command, temp.path(), signal);
    }
}

/// An ffprobe that waits for a writer signals that the program has started, and blocks it there.
#[cfg(unix)]
#[test]
fn interrupted_commands_exit_with_code_2() {
    use std::os::unix::fs::PermissionsExt;
    let temp = tempfile::tempdir().unwrap();
    let ffprobe = temp.path().join("ffprobe");
    std::fs::write(&ffprobe, "#!/bin/sh\nread said < \"$WAITS_FOR\"\n").unwrap();
    std::fs::set_permissions(&ffprobe, std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::write(temp.path().join("v.mkv"), "").unwrap();
    std::fs::write(temp.path().join("recording.toml"), "version = 1\n[frames]\nvideo = \"v.mkv\"\n").unwrap();
    let path = format!("{}:{}", temp.path().display(), std::env::var("PATH").unwrap());
    let folder = temp.path().to_str().unwrap();
    let out = temp.path().join("out.png");
    let out = out.to_str().unwrap();
    let scene = ["--scene", "scenes/marker-1.glb", "-o", out];
    let commands = [
        [&["composite", folder][..], &scene].concat(),
        [&["photo", folder, "--frame", "0"][..], &scene].concat(),
        vec!["calibrate", "noise", "--moving", folder, "-o", out],
        vec!["meter", folder, "--frame", "0"],
        vec!["inspect", folder],
    ];
    for (command, signal) in commands.iter().zip(["-TERM", "-INT", "-HUP", "-TERM", "-INT"]) {
        // One for each: the previous ffprobe may not have ended yet, and would open it before the
        // program has started.
        let pipe = temp.path().join(format!("pipe{signal}-{}", command[0]));
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let mut program = program();
        program.args(command).env("PATH", &path).env("WAITS_FOR", &pipe);
        let running = program.stderr(std::process::Stdio::piped()).spawn().unwrap();
        // Opens when ffprobe does.
        let _writer = std::fs::File::options().write(true).open(&pipe).unwrap();
        Command::new("kill").args([signal, &running.id().to_string()]).status().unwrap();
        let output = running.wait_with_output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), text.lines().count()), (Some(2), 1), "{command:?}: {text}");
        assert!(text.starts_with("locard: interrupted; "), "{command:?}: {text}");
    }
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 3 + commands.len());
}

/// One rule for all outputs.
#[test]
fn inputs_are_never_overwritten() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    std::fs::copy("scenes/marker-1.glb", path("marker.glb")).unwrap();
    std::fs::copy("profiles/simulated.toml", path("camera.toml")).unwrap();
    std::fs::write(path("scene.toml"), "version = 1\n[[objects]]\nmodel = \"marker.glb\"\n").unwrap();
    let read = ["recording.toml", "rgb.txt", "poses.txt", "rgb/00000.jpg", "scene.toml", "marker.glb", "camera.toml"];
    let before = read.map(|name| std::fs::read(path(name)).unwrap());
    let (folder, scene, profile, out) = (path(""), path("scene.toml"), path("camera.toml"), path("out"));
    let inputs = [&folder, "--scene", &scene, "--profile", &profile, "--force"];
    for name in read.into_iter().chain(["rgb/new.json"]) {
        let text = refused(&[&["composite"], &inputs[..], &["-o", &out, "--report", &path(name)]].concat());
        assert!(text.contains("which is never overwritten"), "{name}: {text}");
    }
    let text = refused(&[&["composite"], &inputs[..], &["-o", &out, "--layers", &path("rgb")]].concat());
    assert!(text.contains("is the folder of the recording's frames"), "{text}");
    for name in ["rgb/00001.jpg", "rgb/new.jpg"] {
        let text = refused(&[&["photo"], &inputs[..], &["--frame", "0", "-o", &path(name)]].concat());
        assert!(text.contains("which is never overwritten"), "{name}: {text}");
    }
    let text = refused(&["calibrate", "noise", &path("rgb"), "--force", "-o", &path("rgb/00000.jpg")]);
    assert!(text.contains("is an input of this run"), "{text}");
    assert!(before == read.map(|name| std::fs::read(path(name)).unwrap()) && !Path::new(&out).exists());
}

#[test]
fn layers_and_report_are_written_into_the_new_frame_folder() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let (out, layers, report) = (path("new"), path("new/layers"), path("new/report.json"));
    let arguments = ["composite", "recordings/demo", "--scene", tier::any_scene(), "--frames", "5..6"];
    let arguments = [&arguments[..], tier::no_shadows(), &["-o", &out]].concat();
    let output = locard(&[&arguments[..], &["--layers", &layers, "--report", &report]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let there = ["frame_000005.png", "layers/layer_000005.exr", "report.json"];
    assert!(there.iter().all(|name| temp.path().join("new").join(name).exists()));
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 3);

    // On standard output, which contains nothing else.
    let text = stdout_of(&[&arguments[..], &["--force", "--report", "-"]].concat());
    let read: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(read["frames"][0]["frame"], 5);
    let arguments = [&arguments[..arguments.len() - 1], &["-", "--report", "-"]].concat();
    assert!(refused(&arguments).contains("is the output already"));
}

#[test]
fn two_concurrent_runs_to_one_output_both_succeed() {
    let temp = tempfile::tempdir().unwrap();
    let frames = tier::fast_or_full(4, 20);
    let range = format!("0..{frames}");
    for out in ["out.mkv", "out"] {
        let out = temp.path().join(out);
        let start = || {
            let scene = ["composite", "recordings/demo", "--scene", tier::any_scene(), "--plain", "--frames", &range];
            program()
                .args(scene)
                .arg("--force")
                .arg("-o")
                .arg(&out)
                .stderr(std::process::Stdio::piped())
                .spawn()
                .unwrap()
        };
        for running in [start(), start()] {
            let output = running.wait_with_output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
    }
    assert_eq!(std::fs::read_dir(temp.path().join("out")).unwrap().count(), frames);
    // Two outputs with their records.
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 4);
    let recording = temp.path().join("recording.toml");
    std::fs::write(&recording, "version = 1\n[frames]\nvideo = \"out.mkv\"\n").unwrap();
    let text = stdout_of(&["inspect", recording.to_str().unwrap()]);
    assert!(text.contains(&format!("frames     {frames} of 640x480")), "{text}");
}

/// No file of this process may exceed 8 kB: a disk that fills up during the run.
#[cfg(target_os = "linux")]
#[test]
fn unfinishable_file_is_removed() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let narrow = |arguments: &[&str]| {
        let mut command = Command::new("sh");
        command.args(["-c", "ulimit -f 8; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_locard")]);
        command.args(arguments).stdout(std::process::Stdio::null());
        // A shader cache does not fit either.
        command.env("MESA_SHADER_CACHE_DISABLE", "true");
        let output = command.output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let frames = tier::fast_or_full("0..30", "0..72");
    let demo = ["composite", "recordings/demo", "--scene", tier::any_scene(), "--plain", "--frames", frames];
    let (video, report) = (path("a.mkv"), path("report.json"));
    let (code, text) = narrow(&[&demo[..], &["-o", &video]].concat());
    assert!(code == Some(2) && text.contains("a.mkv"), "{code:?}: {text}");
    let (code, text) = narrow(&[&demo[..], &["-o", "-", "--report", &report]].concat());
    assert!(code == Some(2) && text.contains("report.json: cannot be written"), "{code:?}: {text}");
    // A larger profile, whose comments would be kept.
    let profile = format!("version = 1\n{}", "# mine\n".repeat(3000));
    std::fs::write(path("p.toml"), &profile).unwrap();
    let frames = path("still");
    std::fs::create_dir(&frames).unwrap();
    for i in 0..3u32 {
        let picture = image::GrayImage::from_fn(256, 256, |x, y| {
            let mixed = (x + 256 * y + 65_536 * i).wrapping_mul(2_654_435_761);
            let up = (mixed ^ (mixed >> 15)).wrapping_mul(2_246_822_519) >> 30;
            image::Luma([(x + up).min(255) as u8])
        });
        picture.save(Path::new(&frames).join(format!("{i}.png"))).unwrap();
    }
    let (code, text) = narrow(&["calibrate", "noise", "--no-example", &frames, "-o", &path("p.toml")]);
    assert!(code == Some(2) && text.contains("p.toml: cannot be written"), "{code:?}: {text}");
    assert_eq!(std::fs::read_to_string(path("p.toml")).unwrap(), profile);
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 2, "the profile and the pictures");

    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = program().arg("params").stdout(full).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(2) && text.contains("standard output: cannot be written: the disk is full"),
        "{text}"
    );
}
