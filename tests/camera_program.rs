//! `locard record` and `locard live` with a video in the camera's place.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "common/program.rs"]
mod program;

use std::path::{Path, PathBuf};
use std::process::Command;

use locard::recording::{OpenOptions, Recording};
use locard::source::video::{Overrides, probe};
use program::{locard, refused, said};

/// The demonstration's first frames, so slow that no machine drops many.
fn video(folder: &Path) -> PathBuf {
    let video = folder.join("played.mkv");
    let status = Command::new("ffmpeg")
        .args(["-nostdin", "-loglevel", "error", "-framerate", "4", "-i", "recordings/demo/rgb/%05d.jpg"])
        .args(["-frames:v", "12", "-c:v", "ffv1", "-pix_fmt", "gbrp"])
        .arg(&video)
        .status();
    assert!(status.unwrap().success());
    video
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_video_is_recorded_as_a_camera_is() {
    let temp = tempfile::tempdir().unwrap();
    let (video, site) = (video(temp.path()), temp.path().join("site"));
    let arguments =
        ["record", "--camera", text(&video), "--pose", "file:recordings/demo", "--frames", "5", "-o", text(&site)];
    let output = locard(&arguments);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{told}");
    assert!(told.contains("gives 640x480 rgb at 4.00 Hz; asked for was 640x480 at 30.00 Hz"), "{told}");
    assert!(told.contains("5 frames in "), "{told}");
    let recording = Recording::open(&site, &OpenOptions::default()).unwrap();
    assert_eq!((recording.frame_count(), recording.frame_interval_s), (5, 0.25));
    // The first pose is the first frame's, by a clock of their own.
    let demo = Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
    let (ours, theirs) = (recording.pose_at_frame(0).unwrap(), demo.pose_at_frame(0).unwrap());
    assert!((ours.translation_m - theirs.translation_m).length() < 1e-6);
    assert!(ours.rotation.angle_between(theirs.rotation) < 1e-6);
    // Pictures are the video's, to the code.
    let first = recording.frames(0..1).unwrap().next().unwrap().unwrap();
    let played = probe(&video, &Overrides::default()).unwrap();
    assert!(played.read(0..12).unwrap().any(|pixels| pixels.unwrap() == first.pixels));
    let again = refused(&arguments);
    assert!(again.contains("site: exists already, and is kept; name a new folder"), "{again}");
}

#[test]
fn live_pictures_are_those_of_the_recording() {
    let temp = tempfile::tempdir().unwrap();
    let video = video(temp.path());
    let [site, seen, again] = ["site", "seen", "again"].map(|name| temp.path().join(name));
    let scene = ["--scene", "scenes/demo.toml"];
    let mut arguments = vec!["live", "--camera", text(&video), "--pose", "file:recordings/demo", "--headless"];
    arguments.extend(scene);
    arguments.extend(["--profile", "recordings/demo/camera.toml", "--frames", "3"]);
    arguments.extend(["--record", text(&site), "-o", text(&seen)]);
    let output = locard(&arguments);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{told}");
    // However slow the machine is, what it took it tracked.
    let taken = std::fs::read_dir(&seen).unwrap().count();
    assert!(taken > 0 && told.contains(" tracked, 0 by predicted poses, 0 without"), "{told}");
    said(&[&["composite", text(&site), "-o", text(&again)][..], &scene].concat());
    assert_eq!(std::fs::read_dir(&again).unwrap().count(), taken);
    for frame in 0..taken {
        let [live, again] = [&seen, &again].map(|at| std::fs::read(at.join(format!("frame_{frame:06}.png"))).unwrap());
        assert!(live == again, "frame {frame} differs");
    }
}

#[test]
fn what_is_no_camera_and_what_gives_no_poses_is_told_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let (video, out) = (video(temp.path()), temp.path().join("out"));
    for (arguments, said) in [
        (["--camera", "77", "--pose", "none"], "77: is no camera; there "),
        (["--camera", "none.mp4", "--pose", "none"], "none.mp4: is no camera; there "),
        (
            ["--camera", text(&video), "--pose", "http://x"],
            "accepted are tags, tags:BOARD.toml, opentrackio://…, freed://…, file:RECORDING, none",
        ),
        (["--camera", text(&video), "--pose", "file:scenes"], "scenes: is no recording"),
        (["--camera", "Cargo.toml", "--pose", "none"], "Cargo.toml: "),
    ] {
        let told = refused(&[&["record"][..], &arguments, &["-o", text(&out)]].concat());
        assert!(told.contains(said) && told.lines().count() == 1, "{told}");
        assert!(!out.exists());
    }
}
