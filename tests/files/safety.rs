//! Foreign input does no harm: terminal output, the amount of data read, and replaced files.

use std::path::Path;

use crate::models;
use crate::program;
use crate::program::{locard, refused, stdout_of, with_a_truncated_frame};
use crate::tier;
use locard::source::video::{Overrides, probe};

/// Composites one frame of the demonstration.
fn demo() -> [&'static str; 6] {
    ["composite", "recordings/demo", "--scene", tier::any_scene(), "--frames", "5..6"]
}

/// A link in place of an output: its target is written, and the link stays.
#[cfg(unix)]
#[test]
fn symbolic_link_is_never_replaced() {
    use std::os::unix::fs::symlink;
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(path("far")).unwrap();
    let names = ["report.json", "frames/frame_000005.png", "v.mkv", "a.jpg"];
    std::fs::create_dir(path("frames")).unwrap();
    for (i, name) in names.iter().enumerate() {
        std::fs::write(path(&format!("far/{i}")), "mine").unwrap();
        symlink(path(&format!("far/{i}")), path(name)).unwrap();
    }
    let (report, frames, video, photo) = (path(names[0]), path("frames"), path(names[2]), path(names[3]));
    let runs = [
        [&demo()[..], &["--plain", "-o", &frames, "--report", &report]].concat(),
        [&demo()[..], &["--plain", "-o", &video]].concat(),
        ["photo", "recordings/demo", "--frame", "5", "--lux", "300"].to_vec(),
    ];
    let mut runs = runs.to_vec();
    runs[2].extend(["--scene", tier::any_scene(), "--only", "motion_blur", "-q", "-o", &photo]);
    runs[2].extend(tier::no_shadows());
    for run in &runs {
        let text = refused(run);
        assert!(text.contains("exists already"), "{text}");
        let done = locard(&[&run[..], &["--force"]].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
    for (i, name) in names.iter().enumerate() {
        assert!(Path::new(&path(name)).is_symlink(), "{name}");
        assert!(std::fs::metadata(path(&format!("far/{i}"))).unwrap().len() > 100, "{name}");
    }
    assert_eq!(std::fs::read_dir(path("far")).unwrap().count(), names.len());

    // A frame's name that links to an input.
    std::fs::copy("scenes/marker-1.glb", path("marker.glb")).unwrap();
    std::fs::write(path("scene.toml"), "version = 1\n[[objects]]\nmodel = \"marker.glb\"\n").unwrap();
    std::fs::remove_file(path(names[1])).unwrap();
    symlink(path("scene.toml"), path(names[1])).unwrap();
    let text = refused(&["composite", demo()[1], "--scene", &path("scene.toml"), "-o", &frames, "--force"]);
    assert!(text.contains("is an input of this run"), "{text}");
}

/// Without `--force`: a failure of this test replaces nothing.
#[cfg(target_os = "linux")]
#[test]
fn standard_output_and_pipes_are_accepted_as_outputs() {
    use std::process::{Command, Stdio};
    let temp = tempfile::tempdir().unwrap();
    let (text, frames, pipe) = (temp.path().join("x.txt"), temp.path().join("out"), temp.path().join("pipe"));
    std::fs::write(&text, "").unwrap();
    let appending = || std::fs::File::options().append(true).open(&text).unwrap();
    for _ in 0..2 {
        let mut run = program::program();
        run.args(demo()).args(["--plain", "--report", "/dev/stdout", "-o"]).arg(&frames).stdout(appending());
        assert!(run.status().unwrap().success());
        std::fs::remove_dir_all(&frames).unwrap();
    }
    let read = std::fs::read_to_string(&text).unwrap();
    assert_eq!(read.matches("\"adapter\"").count(), 2, "{read}");
    let text = refused(&[&demo()[..], &["-o", "/dev/stdout", "--report", "-"]].concat());
    assert!(text.contains("is the output already"), "{text}");

    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = Command::new("timeout").args(["60", "wc", "-c"]).arg(&pipe).stdout(Stdio::piped()).spawn().unwrap();
    let done = locard(&[&demo()[..], &["--plain", "-o", pipe.to_str().unwrap()]].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let read = String::from_utf8(reader.wait_with_output().unwrap().stdout).unwrap();
    assert!(read.starts_with("921600 "), "3 * 640 * 480, not {read}");
    let named = temp.path().join("v.mkv");
    std::os::unix::fs::symlink(&pipe, &named).unwrap();
    let text = refused(&[&demo()[..], &["-o", named.to_str().unwrap(), "--force"]].concat());
    assert!(text.contains("v.mkv: is a pipe or a device") && text.lines().count() == 1, "{text}");
    assert!(named.is_symlink());
}

#[test]
fn failed_run_leaves_no_empty_folder() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let scene = ["--scene", "scenes/marker-1.glb", "--profile", "profiles/simulated.toml", "--frames", "3..4"];
    let scene = [&scene[..], tier::no_shadows()].concat();
    for out in ["new/out", "new/v.mkv"] {
        let (out, layers) = (path(out), path("new/layers"));
        let text = refused(&[&["composite", &path("")], &scene[..], &["-q", "-o", &out, "--layers", &layers]].concat());
        assert!(text.contains("truncated") && !Path::new(&path("new")).exists(), "{text}");
    }
}

/// Escape sequences in C0, C1 (whose byte alone is not UTF-8), and one that sets the title.
#[cfg(unix)]
#[test]
fn wrong_arguments_are_escaped_and_shortened_on_the_terminal() {
    use std::os::unix::ffi::OsStrExt;
    let evil = b"a\x1b]0;pwn\x07\n\xc2\x9bz";
    let raw = [&evil[..], b"\xff"].concat();
    let long = vec![b'x'; 100_000];
    let option = [b"--", &evil[..]].concat();
    let cases: [&[&[u8]]; 8] = [
        &[b"inspect", b"recordings/demo", b"--frame", evil],
        &[b"render", b"scenes/demo.toml", b"--from", evil, b"-o", b"a.png"],
        &[evil],
        &[&raw],
        &[b"inspect", b"x", &option],
        &[b"photo", b"x", b"--bracket", evil],
        &[b"inspect", b"recordings/demo", b"--frame", &long],
        &[&long],
    ];
    for arguments in cases {
        let arguments = arguments.iter().map(|argument| std::ffi::OsStr::from_bytes(argument));
        let output = program::program().args(arguments).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.starts_with("error: ") && text.contains("For more information, try '--help'."), "{text}");
        assert!(text.chars().all(|c| c == '\n' || !c.is_control()) && text.len() < 10_000, "{text:?}");
        assert!(
            text.contains("\\u{1b}]0;pwn\\u{7}\\n\\u{9b}z") || text.contains("xxx… (100000 bytes in all)"),
            "{text}"
        );
    }
    let output = program::program().args(["inspect", "x", "--fram", "3"]).output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("a similar argument exists: '--frame'"), "{text}");
}

/// A sparse file takes no space on the disk, and is not read either: it exceeds the memory.
#[cfg(target_os = "linux")]
#[test]
fn oversized_file_is_refused_by_its_length() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let at = |name: &str| temp.path().join(name);
    let narrow = |what: &Path| {
        let mut command = std::process::Command::new("sh");
        command.args(["-c", "ulimit -v 700000; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_locard"), "inspect"]);
        let output = command.arg(what).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!((output.status.code(), text.lines().count()), (Some(2), 1), "{text}");
        text
    };
    let grow = |name: &str, bytes: u64| {
        std::fs::File::options().create(true).append(true).open(at(name)).unwrap().set_len(bytes).unwrap();
    };
    grow("poses.txt", 6 << 30);
    assert!(narrow(temp.path()).contains("poses.txt: cannot be read: it holds 6442450944 bytes; at most 1073741824"));
    grow("recording.toml", 5 << 20);
    let message = "it holds 5242880 bytes; at most 4194304 are read";
    assert!(narrow(temp.path()).contains(&format!("recording.toml: cannot be read: {message}")));
    for name in ["recording.toml", "rgb.txt"] {
        std::fs::remove_file(at(name)).unwrap();
    }
    grow("transforms.json", 17 << 20);
    let listing = "it holds 17825792 bytes; at most 16777216 are read";
    assert!(narrow(temp.path()).contains(&format!("transforms.json: cannot be read: {listing}")));
    std::fs::remove_file(at("transforms.json")).unwrap();
    std::fs::create_dir_all(at("mav0/cam0")).unwrap();
    std::fs::write(at("mav0/cam0/data.csv"), "#t,f\n0,a.png\n").unwrap();
    grow("mav0/cam0/sensor.yaml", 5 << 20);
    assert!(narrow(temp.path()).contains(&format!("sensor.yaml: cannot be read: {message}")));
}

/// A word of 10 MB in place of a picture's name, whose search used to take a second.
#[test]
fn impossible_file_name_is_refused_while_reading() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let long = "x".repeat(10_000_000);
    std::fs::write(temp.path().join("rgb.txt"), format!("0 rgb/00000.jpg\n1 rgb/{long}\n")).unwrap();
    let text = refused(&["inspect", temp.path().to_str().unwrap()]);
    assert!(text.contains("rgb.txt, line 2: the file's name is `rgb/xxx"), "{text}");
    assert!(text.contains("xxx… (10000004 bytes in all)`; expected up to 4096 bytes") && text.len() < 400, "{text}");
}

#[test]
fn scene_beyond_the_object_limit_is_refused() {
    let temp = tempfile::tempdir().unwrap();
    let scene = temp.path().join("scene.toml");
    // Bounds are computed for every object: of one triangle in the fast tier.
    models::write_triangle(temp.path());
    let triangle = temp.path().join("triangle.glb");
    let model = tier::fast_or_full(triangle, "scenes/marker-1.glb".into());
    std::fs::copy(model, temp.path().join("marker.glb")).unwrap();
    let write = |instances: usize| {
        let places = "[[objects.instances]]\nposition_m = [0, 0, 0]\n".repeat(instances);
        let objects = "[[objects]]\nmodel = \"marker.glb\"\n".repeat(2);
        std::fs::write(&scene, format!("version = 1\n{objects}{places}")).unwrap();
    };
    write(16_384);
    let text = refused(&["inspect", scene.to_str().unwrap()]);
    assert!(text.contains("scene.toml: the placed objects: found 16385; expected: up to 16384"), "{text}");
    write(16_383);
    assert!(stdout_of(&["inspect", scene.to_str().unwrap()]).contains("marker 16383: "));
}

#[test]
fn inspect_reads_the_profile_named_by_a_recording() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let at = |name: &str| temp.path().join(name);
    let mut description = std::fs::read_to_string(at("recording.toml")).unwrap();
    description += "[camera]\nprofile = \"camera.toml\"\n";
    std::fs::write(at("recording.toml"), description).unwrap();
    let folder = temp.path().to_str().unwrap();
    for arguments in [&["inspect", folder][..], &["inspect", folder, "--frame", "0"]] {
        let text = refused(arguments);
        assert!(text.contains("camera.toml") && text.contains("no such file") && text.lines().count() == 1, "{text}");
    }
    std::fs::write(at("camera.toml"), "garbage").unwrap();
    let text = refused(&["inspect", folder]);
    assert!(text.contains("camera.toml: line 1") && text.lines().count() == 1, "{text}");
    // Of another size than the frames.
    let camera = |width: u32| {
        let rest = "height_px = 480\nfx_px = 520\nfy_px = 521\ncx_px = 320\ncy_px = 240\n";
        std::fs::write(at("camera.toml"), format!("version = 1\n[camera]\nwidth_px = {width}\n{rest}")).unwrap();
    };
    camera(320);
    assert!(refused(&["inspect", folder]).contains("the camera's picture is 320x480 px"));
    camera(640);
    assert!(stdout_of(&["inspect", folder]).contains("camera     fx 520.00 fy 521.00 cx 320.00 cy 240.00 px"));
    #[cfg(unix)]
    {
        std::fs::remove_file(at("camera.toml")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(at("camera.toml")).status().unwrap().success());
        assert!(refused(&["inspect", folder]).contains("it is a pipe or a device"));
    }
}

#[test]
fn no_message_prints_hundreds_of_digits() {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let write = |name: &str, text: &str| std::fs::write(path(name), text).unwrap();
    let short = |text: String| {
        assert!(!text.contains("0000000000000000000"), "{text}");
        text
    };
    let out = path("out");
    let late = ["--time-offset-s", "1e300", "-o", &out];
    assert!(short(refused(&[&demo()[..], &late].concat())).contains("1.00000e300 s lies after the last pose"));
    std::fs::copy("scenes/marker-1.glb", path("marker.glb")).unwrap();
    write(
        "far.toml",
        "version = 1\n[[objects]]\nmodel = \"marker.glb\"\nposition_m = [1e200, 0, 0]\n[light]\nambient = 1e30\n",
    );
    let text = short(stdout_of(&["inspect", &path("far.toml")]));
    assert!(text.contains("from 1.00000e200 ") && text.contains("1e30 from everywhere"), "{text}");
    write("bad.toml", "version = 1\n[[objects]]\nmodel = \"marker.glb\"\nsize_m = -1e300\n");
    assert!(short(refused(&["inspect", &path("bad.toml")])).contains("size_m: found -1e300"));
    let noise = "version = 1\n[camera.noise]\nchannel_correlation = [0.0, 0.0, 0.0]\nneighbour_correlation = [0.0, 0.0]\n\
                 code = [0.0, 255.0]\nsigma_r = [1e200, 3.0]\nsigma_g = [3.0, 3.0]\nsigma_b = [3.0, 3.0]\n";
    write("noise.toml", noise);
    let output = locard(&["inspect", &path("noise.toml")]);
    short(String::from_utf8([output.stdout, output.stderr].concat()).unwrap());
    write("recording.toml", "version = 1\nname = 1e300\n[frames]\nlist = \"rgb.txt\"\n");
    assert!(
        short(refused(&["inspect", &path("recording.toml")])).contains("floating point `1e300`, expected a string")
    );
    write("recording.toml", "version = 1\n[frames]\nimages = \"rgb\"\nfps = -1e300\n");
    assert!(short(refused(&["inspect", &path("recording.toml")])).contains("frames.fps = -1e300"));
}

#[test]
fn oversized_picture_is_reported_as_such_and_not_as_truncated() {
    let temp = tempfile::tempdir().unwrap();
    with_a_truncated_frame(temp.path());
    let whole = std::fs::read("recordings/demo/rgb/00003.jpg").unwrap();
    std::fs::write(temp.path().join("rgb/00003.jpg"), whole).unwrap();
    let large = std::fs::File::options().write(true).open(temp.path().join("rgb/00004.jpg")).unwrap();
    large.set_len(6 << 30).unwrap();
    let text = stdout_of(&["inspect", temp.path().to_str().unwrap()]);
    assert!(text.contains("files      6 pictures, 1 cannot be read\n"), "{text}");
    assert!(text.contains("00004.jpg: cannot be read: it holds 6442450944 bytes"), "{text}");
}

#[test]
fn oversized_vector_is_refused_by_its_range_and_not_its_length() {
    let text = refused(&["render", "scenes/demo.toml", "--from", "1e300,0,0", "-o", "a.png"]);
    assert!(text.contains("1e300,0,0: expected numbers from -1000000000 to 1000000000"), "{text}");
    let text = refused(&["render", "scenes/demo.toml", "--from", "1,0", "-o", "a.png"]);
    assert!(text.contains("1,0: expected 3 numbers with commas between, as in 0.4,-0.2,1.5"), "{text}");
}

#[test]
fn photo_without_evidence_in_view_is_reported() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("a.png");
    let demo = ["photo", "recordings/demo", "--scene", "scenes/demo.toml", "--lux", "0.001", "--iso", "100", "-o"];
    // The evidence is in front of the camera, outside of the cropped part.
    let part = ["--frame", "71", "--only", "motion_blur", "--focus", "inf", "--aim", "20,20", "--across", "40"];
    let run = |hand: &[&str]| {
        let out = [out.to_str().unwrap(), "--force"];
        let done = locard(&[&demo[..], &out, &part, tier::no_shadows(), hand].concat());
        let text = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.success() && text.contains("no object of the scene is in the picture"), "{text}");
        text
    };
    let (stand, hand) = (run(&[]), run(&["--hand-held"]));
    assert!(stand.contains("too dark") && !stand.contains("further from the recording's ends"), "{stand}");
    assert!(hand.contains("a larger --iso helps, or a frame further from the recording's ends"), "{hand}");
}

/// A recording of the demonstration's first frame, with additional lines in its description.
fn one_frame(folder: &Path, more: &str) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::copy("recordings/demo/rgb/00000.jpg", folder.join("0.jpg")).unwrap();
    std::fs::write(folder.join("rgb.txt"), "0 0.jpg\n").unwrap();
    std::fs::write(folder.join("recording.toml"), format!("version = 1\n[frames]\nlist = \"rgb.txt\"\n{more}"))
        .unwrap();
}

#[test]
fn error_in_a_file_outside_the_recording_does_not_quote_it() {
    let temp = tempfile::tempdir().unwrap();
    let (inside, secret) = (temp.path().join("rec"), temp.path().join("secret.txt"));
    std::fs::write(&secret, "root:x:0:0\n").unwrap();
    let name = secret.to_str().unwrap().to_owned();
    let path = inside.to_str().unwrap();
    for named in ["../secret.txt", &name] {
        one_frame(&inside, &format!("[poses]\ntrajectory = \"{named}\"\n"));
        let text = refused(&["inspect", path]);
        assert!(!text.contains("root"), "{text}");
        assert!(text.contains("secret.txt, line 1: ") && text.contains("outside the recording's folder"), "{text}");
    }
    #[cfg(unix)]
    {
        one_frame(&inside, "");
        std::fs::remove_file(inside.join("rgb.txt")).unwrap();
        std::os::unix::fs::symlink(&secret, inside.join("rgb.txt")).unwrap();
        let text = refused(&["inspect", path]);
        assert!(!text.contains("root") && text.contains("rgb.txt, line 1: "), "{text}");
    }
    // The same for an error beside the list by which a EuRoC folder is opened.
    let mav = temp.path().join("euroc/mav0");
    let truth = mav.join("state_groundtruth_estimate0");
    std::fs::create_dir_all(mav.join("cam0")).unwrap();
    std::fs::create_dir_all(&truth).unwrap();
    let camera = "resolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [500, 500, 320, 240]\n\
                  distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n\
                  T_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n";
    std::fs::write(mav.join("cam0/sensor.yaml"), camera).unwrap();
    std::fs::write(mav.join("cam0/data.csv"), "0,0.png\n").unwrap();
    std::fs::write(truth.join("data.csv"), "0,here\n").unwrap();
    let text = refused(&["inspect", mav.join("cam0/data.csv").to_str().unwrap()]);
    assert!(text.contains("data.csv, line 1: ") && text.contains("`here`"), "{text}");
    // Inside the folder it is quoted, which helps to correct it.
    one_frame(&inside, "[poses]\ntrajectory = \"poses.txt\"\n");
    std::fs::write(inside.join("poses.txt"), "root:x:0:0\n").unwrap();
    let text = refused(&["inspect", path]);
    assert!(text.contains("`root:x:0:0`"), "{text}");
}

#[test]
fn output_over_the_analysis_is_refused_even_with_force() {
    let temp = tempfile::tempdir().unwrap();
    let (recording, analysis) = (temp.path().join("rec"), temp.path().join("rec.analysis"));
    one_frame(&recording, "");
    std::fs::create_dir(&analysis).unwrap();
    let path = |folder: &Path, name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (at, out) = (path(&recording, ""), path(temp.path(), "out"));
    let camera = ["--set", "camera.width_px=640", "--set", "camera.height_px=480", "--set", "camera.fx_px=500"];
    let more = ["--set", "camera.fy_px=500", "--set", "camera.cx_px=320", "--set", "camera.cy_px=240", "--force"];
    std::fs::write(recording.join("poses.txt"), "0 0 0 1 0 0 0 1\n").unwrap();
    let trajectory = "[poses]\ntrajectory = \"poses.txt\"\n";
    one_frame(&recording, trajectory);
    for name in ["analysis.toml", "poses.txt", "frames.txt", "environment.hdr", "supports.toml"] {
        let file = path(&analysis, name);
        std::fs::write(&file, "mine").unwrap();
        let run = ["composite", &at, "--scene", tier::any_scene(), "-o", &out, "--report", &file];
        let text = refused(&[&run[..], &camera, &more].concat());
        assert!(text.contains(&format!("{name}: lies in the folder of the recording's analysis")), "{text}");
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
    }
    let folder = path(&analysis, "");
    let run = ["composite", &at, "--scene", tier::any_scene(), "-o", &folder];
    let text = refused(&[&run[..], &camera, &more].concat());
    assert!(text.contains("is the folder of the recording's analysis"), "{text}");
    assert!(!Path::new(&out).exists());
}

#[test]
fn playlist_in_place_of_a_video_is_refused_without_opening_its_files() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    let film = ["-nostdin", "-v", "error", "-f", "lavfi", "-i", "testsrc=size=64x48:rate=5:duration=1"];
    let mut ffmpeg = std::process::Command::new("ffmpeg");
    assert!(ffmpeg.args(film).args(["-c:v", "mpeg2video"]).arg(at("film.ts")).status().unwrap().success());
    assert!(std::process::Command::new("mkfifo").arg(at("pipe.ts")).status().unwrap().success());
    let video = at("v.mp4");
    let of = |text: &str| {
        std::fs::write(&video, text).unwrap();
        probe(&video, &Overrides::default()).map(|_| ()).unwrap_err().to_string()
    };
    let hls = |named: &str, end: &str| {
        format!("#EXTM3U\n#EXT-X-VERSION:3\n#EXT-X-TARGETDURATION:1\n#EXTINF:1.0,\n{named}\n{end}")
    };
    for text in [
        hls("film.ts", "#EXT-X-ENDLIST\n"),
        // A playlist that would be waited for indefinitely, and one that never ends.
        hls("pipe.ts", "#EXT-X-ENDLIST\n"),
        hls("film.ts", ""),
        "ffconcat version 1.0\nfile 'film.ts'\n".to_owned(),
    ] {
        let error = of(&text);
        assert!(error.contains("v.mp4: is not a supported video container"), "{text}: {error}");
        assert!(error.contains("MPEG-TS") && error.contains("Playlists"), "{error}");
    }
    // The film itself is read.
    assert_eq!(probe(&at("film.ts"), &Overrides::default()).unwrap().timestamps_s.len(), 5);
}
