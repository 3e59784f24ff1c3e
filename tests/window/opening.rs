//! The window's display of a recording as it opens.

use std::path::Path;
use std::process::Command;

use crate::harness::{Device, demo, has_label, wait_for_label};
use crate::program;
use eframe::egui;
use egui_kittest::Harness;
use locard::recording::OpenOptions;
use locard::shot::ShotOptions;
use locard::window::{App, Project};

fn filmed(file: &Path, options: &[&str]) {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-f", "lavfi", "-i", "testsrc=s=160x120:d=0.2:r=10", "-pix_fmt", "yuv420p"]);
    assert!(ffmpeg.args(options).arg(file).status().unwrap().success());
}

#[test]
fn unknown_transfer_function_is_reported_when_the_recording_opens() {
    let folder = tempfile::tempdir().unwrap();
    let tags = ["-color_trc", "log100"];
    filmed(&folder.path().join("a.mp4"), &tags);
    std::fs::write(folder.path().join("recording.toml"), "version = 1\n[frames]\nvideo = \"a.mp4\"\n").unwrap();
    let options = ShotOptions { profile: Some(demo().join("camera.toml")), ..ShotOptions::default() };
    let project = Project::open(folder.path(), &OpenOptions::default(), &options).unwrap();
    let mut window = window_without_picture(project);
    window.run_steps(2);
    let text = window.state().message().unwrap().to_owned();
    assert!(text.contains("logarithmic") && has_label(&window, &text), "{text}");
}

#[test]
fn start_page_names_the_folder_of_the_open_recording() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("case 7/walk");
    std::fs::create_dir_all(&folder).unwrap();
    filmed(&folder.join("a.mp4"), &[]);
    std::fs::write(folder.join("recording.toml"), "version = 1\nname = \"demo\"\n[frames]\nvideo = \"a.mp4\"\n")
        .unwrap();
    let options = ShotOptions { profile: Some(demo().join("camera.toml")), ..ShotOptions::default() };
    let project = Project::open(&folder, &OpenOptions::default(), &options).unwrap();
    let mut window = window_without_picture(project);
    window.state_mut().show_start(true);
    window.run_steps(3);
    assert!(has_label(&window, "case 7/walk is open. Open another one, or press ? for the keys."));
    assert!(has_label(&window, "Continue with case 7/walk"));
}

/// Only the surroundings of the picture are checked.
fn window_without_picture(project: Project) -> Harness<'static, App> {
    let builder = Harness::builder().with_size(egui::vec2(1400.0, 900.0));
    builder.renderer(Device::new()).build_eframe(|context| App::new(context, project, None).unwrap())
}

#[test]
fn unreadable_first_frame_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("rec");
    program::copied(&demo(), &recording);
    let frames = std::fs::read_dir(recording.join("rgb")).unwrap().flatten().map(|entry| entry.path());
    let first = frames.min().unwrap();
    let bytes = std::fs::read(&first).unwrap();
    // Opening the recording reads only its header.
    std::fs::write(&first, &bytes[..bytes.len() / 2]).unwrap();
    let project = Project::open(&recording, &OpenOptions::default(), &ShotOptions::default()).unwrap();
    let mut window = window_without_picture(project);
    wait_for_label(&mut window, "This frame cannot be shown");
}
