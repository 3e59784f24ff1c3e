//! Notices over the picture, and messages: each problem has a reason and a link to the remedy.

use std::path::{Path, PathBuf};

use crate::harness::{Device, click_at, demo, drop_file, has_label, pause, run_until, settle, wait_for_label, window};
use crate::program;
use eframe::egui::{self, Event, Modifiers, PointerButton, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use locard::recording::{OpenOptions, Recording};
use locard::shot::ShotOptions;
use locard::window::{App, Project};

const SIZE: egui::Vec2 = egui::vec2(1400.0, 900.0);
const NO_PROFILE: &str = "No camera profile for this recording. Choose one to place evidence.";

/// A copy of the demonstration without a camera.
fn without_camera(folder: &Path) -> PathBuf {
    let recording = folder.join("bare");
    program::copied(&demo(), &recording);
    std::fs::remove_file(recording.join("camera.toml")).unwrap();
    let text = std::fs::read_to_string(recording.join("recording.toml")).unwrap();
    std::fs::write(recording.join("recording.toml"), text.split("[camera]").next().unwrap()).unwrap();
    recording
}

fn open(recording: &Path) -> Project {
    Project::open(recording, &OpenOptions::default(), &ShotOptions::default()).unwrap()
}

/// A window whose first picture is not composited.
fn window_with_problem(project: Project) -> Harness<'static, App> {
    let builder = Harness::builder().with_size(SIZE).renderer(Device::new());
    let mut window = builder.build_eframe(|context| App::new(context, project, None).unwrap());
    run_until(&mut window, |app| app.problem().is_some());
    window.run_steps(2);
    window
}

fn press(window: &mut Harness<'_, App>, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(3);
}

fn middle_of_picture(window: &Harness<'_, App>) -> egui::Rect {
    window.get_by_role_and_label(Role::Image, "picture").rect()
}

fn is_dialog(window: &Harness<'_, App>, name: &str) -> bool {
    window.query_all_by_role(Role::Dialog).any(|node| node.accesskit_node().label().as_deref() == Some(name))
}

#[test]
fn missing_profile_is_shown_in_the_picture_with_a_button_to_choose_one() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = window_with_problem(open(&without_camera(temp.path())));
    let notice = window.get_by_label("Choose profile…").rect();
    let picture = middle_of_picture(&window);
    assert!(has_label(&window, NO_PROFILE) && picture.contains_rect(notice));
    // A closed notice returns as soon as something is to be placed.
    press(&mut window, "Close");
    assert!(!has_label(&window, "Choose profile…"));
    press(&mut window, "Add lamp");
    assert!(has_label(&window, "Choose profile…"));
    click_at(&mut window, picture.left_top() + egui::vec2(60.0, 60.0));
    assert!(window.state().project().edit().scene.light.lamp.is_empty(), "no lamp anywhere");
    window.key_press(egui::Key::Escape);
    window.run_steps(3);
    assert!(!has_label(&window, "Choose profile…"));
    drop_file(&mut window, std::fs::canonicalize("scenes/marker-1.glb").unwrap());
    window.run_steps(3);
    click_at(&mut window, picture.left_top() + egui::vec2(60.0, 60.0));
    assert!(has_label(&window, "Choose profile…") && window.state().project().edit().scene.objects.is_empty());
    press(&mut window, "Choose profile…");
    assert!(is_dialog(&window, "Open a profile"));
}

#[test]
fn frame_without_a_pose_links_to_the_nearest_with_a_pose() {
    let temp = tempfile::tempdir().unwrap();
    let recording = temp.path().join("late");
    program::copied(&demo(), &recording);
    // The poses of the first half are missing.
    let poses = recording.join("groundtruth.txt");
    let text = std::fs::read_to_string(&poses).unwrap();
    let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    std::fs::write(&poses, lines[lines.len() / 2..].join("\n") + "\n").unwrap();
    let mut window = window(open(&recording), SIZE);
    assert!(!has_label(&window, "No camera position for this frame. Choose another frame to place evidence."));
    press(&mut window, "Add lamp");
    assert!(has_label(&window, "No camera position for this frame. Choose another frame to place evidence."));
    let nearest = window.query_all_by_label_contains("Go to frame ").next().unwrap().accesskit_node().label().unwrap();
    press(&mut window, &nearest);
    settle(&mut window);
    let frame: usize = nearest.trim_start_matches("Go to frame ").parse().unwrap();
    assert!(frame > 0 && window.state().player().frame() == frame);
    assert_eq!(window.query_all_by_label_contains("Go to frame ").count(), 0);
}

/// Writes a profile for pictures of 1920x1080 px. Returns it with the size in the profile that it
/// was made from.
fn profile_of_other_size(good: &Path, folder: &Path) -> (PathBuf, [String; 2]) {
    let other = folder.join("hd.toml");
    let mut text = std::fs::read_to_string(good).unwrap();
    let size = [("width_px", 1920), ("height_px", 1080)].map(|(key, to)| {
        let line = text.lines().find(|line| line.starts_with(key)).unwrap().to_owned();
        text = text.replace(&line, &format!("{key} = {to}"));
        line.rsplit(' ').next().unwrap().to_owned()
    });
    std::fs::write(&other, text).unwrap();
    (other, size)
}

#[test]
fn profile_of_another_size_is_refused_with_both_sizes() {
    let temp = tempfile::tempdir().unwrap();
    let good = demo().join("camera.toml").canonicalize().unwrap();
    let (other, [width, height]) = profile_of_other_size(&good, temp.path());
    let options = ShotOptions { profile: Some(good.clone()), ..ShotOptions::default() };
    let mut window = window(Project::open(&demo(), &OpenOptions::default(), &options).unwrap(), SIZE);
    drop_file(&mut window, other);
    run_until(&mut window, |app| app.problem().is_some());
    window.run_steps(2);
    let message = format!("This profile is for 1920x1080; the recording is {width}x{height}");
    assert!(window.state().problem().unwrap().starts_with(&message), "{:?}", window.state().problem());
    assert_eq!(window.state().project().profile, Some(good));
    assert!(window.state().project().shot().geometry_at(0).is_ok());
    // In the picture, too, until it is closed.
    let shown = |window: &Harness<'_, App>| {
        let picture = middle_of_picture(window);
        window.query_all_by_label_contains(&message).filter(|node| picture.contains_rect(node.rect())).count()
    };
    assert_eq!(shown(&window), 1);
    press(&mut window, "Close");
    assert_eq!(shown(&window), 0);
}

#[test]
fn profile_without_a_camera_does_not_replace_one_with_a_camera() {
    let temp = tempfile::tempdir().unwrap();
    let recording = without_camera(temp.path());
    let good = demo().join("camera.toml").canonicalize().unwrap();
    let options = ShotOptions { profile: Some(good.clone()), ..ShotOptions::default() };
    let mut window = window(Project::open(&recording, &OpenOptions::default(), &options).unwrap(), SIZE);
    let bare = temp.path().join("noise.toml");
    std::fs::write(&bare, "version = 1\n[noise]\nscale = 2.0\n").unwrap();
    drop_file(&mut window, bare.clone());
    run_until(&mut window, |app| app.problem().is_some());
    let problem = window.state().problem().unwrap().to_owned();
    assert!(
        problem.starts_with("noise.toml lacks the camera's focal length or principal point: it was not"),
        "{problem}"
    );
    assert_eq!(window.state().project().profile, Some(good));
    assert!(window.state().project().shot().geometry_at(0).is_ok());
}

#[test]
fn profile_without_a_camera_opens_if_no_camera_is_known() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = window_with_problem(open(&without_camera(temp.path())));
    let bare = temp.path().join("noise.toml");
    std::fs::write(&bare, "version = 1\n[noise]\nscale = 2.0\n").unwrap();
    drop_file(&mut window, bare.clone());
    run_until(&mut window, |app| app.project().profile.as_ref() == Some(&bare));
}

#[test]
fn profile_chosen_after_a_refusal_opens_the_refused_recording() {
    let temp = tempfile::tempdir().unwrap();
    let good = demo().join("camera.toml").canonicalize().unwrap();
    let (other_size, _) = profile_of_other_size(&good, temp.path());
    let second = temp.path().join("garage");
    program::copied(&demo(), &second);
    let description = second.join("recording.toml");
    let text = std::fs::read_to_string(&description).unwrap();
    std::fs::write(&description, text.replace("name = \"demo\"", "name = \"garage\"")).unwrap();
    let state = temp.path().join("state");
    std::fs::create_dir(&state).unwrap();
    let stale = serde_json::json!({ "recent": [{
        "recording": second, "scene": null, "profile": other_size, "metres_per_unit": 1.0
    }] });
    std::fs::write(state.join("state.json"), stale.to_string()).unwrap();
    let mut window = window(open(&demo()), SIZE);
    window.state_mut().set_state_folder(&state);
    window.state_mut().show_start(true);
    window.run_steps(3);
    press(&mut window, "garage");
    run_until(&mut window, |app| app.problem().is_some());
    window.run_steps(2);
    // The notice is over the picture of the first recording.
    assert!(window.query_all_by_label_contains("hd.toml was not opened for garage").count() > 0);
    drop_file(&mut window, good.clone());
    run_until(&mut window, |app| app.project().profile.as_ref() == Some(&good));
    assert_eq!(window.state().project().shot().recording.path, second);
}

#[test]
fn new_message_is_visible_beside_a_lasting_problem() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = window_with_problem(open(&without_camera(temp.path())));
    window.state_mut().project_mut().switch("noise", false);
    window.key_press_modifiers(Modifiers::COMMAND, egui::Key::Z);
    window.run_steps(2);
    assert!(has_label(&window, "Undone: Noise: off"));
}

#[test]
fn quick_click_opens_the_full_message() {
    let mut window = window(open(&demo()), SIZE);
    let nowhere = PathBuf::from("/nowhere/at all/with a rather long name.toml");
    drop_file(&mut window, nowhere);
    run_until(&mut window, |app| app.problem().is_some());
    window.run_steps(2);
    let text = window.state().problem().unwrap().to_owned();
    let pos = window.get_by_label(&text).rect().center();
    // Pressed and released between two frames of a slow window.
    let button =
        |pressed| Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE };
    window.hover_at(pos);
    window.step();
    window.input_mut().events.extend([Event::PointerMoved(pos), button(true), button(false)]);
    window.step();
    for _ in 0..3 {
        pause();
        window.step();
    }
    assert!(is_dialog(&window, "Message") && has_label(&window, "Copy"));
}

#[test]
fn refused_profile_comes_before_the_question_about_unsaved_changes() {
    let temp = tempfile::tempdir().unwrap();
    let good = demo().join("camera.toml").canonicalize().unwrap();
    let (other, _) = profile_of_other_size(&good, temp.path());
    let mut window = window(open(&demo()), SIZE);
    window.state_mut().project_mut().switch("noise", false);
    drop_file(&mut window, other);
    run_until(&mut window, |app| app.problem().is_some());
    window.run_steps(3);
    assert!(!has_label(&window, "Save changes?") && !window.state().project().is_saved());
    // Another profile can be opened: now changes would be lost.
    press(&mut window, "Close");
    drop_file(&mut window, good.clone());
    wait_for_label(&mut window, "Save changes?");
    press(&mut window, "Cancel");
    assert!(window.state().project().profile.is_none() && !window.state().project().is_saved());
    drop_file(&mut window, good.clone());
    wait_for_label(&mut window, "Save changes?");
    press(&mut window, "Continue without saving");
    run_until(&mut window, |app| app.project().profile.as_ref() == Some(&good));
    assert!(window.state().project().is_saved());
}

// Slow: waits until the first message, which stays for 4 s, has disappeared.
#[test]
fn recording_warnings_stay_visible_and_a_click_shows_them_in_full() {
    let hlg = "walk.mp4 is in HLG (high dynamic range); the light on objects is wrong";
    let mut recording = Recording::open(&demo(), &OpenOptions::default()).unwrap();
    recording.warnings = vec![hlg.to_owned(), "2 of 30 pictures are missing".to_owned()];
    let mut window = window(Project::of(recording, &ShotOptions::default()).unwrap(), SIZE);
    // The first message has disappeared, and another action was done.
    let begun = std::time::Instant::now();
    while begun.elapsed().as_secs_f64() < 4.5 {
        window.step();
        pause();
    }
    window.state_mut().project_mut().switch("noise", false);
    window.run_steps(3);
    assert!(window.state().message().is_none() && has_label(&window, "2 warnings"));
    press(&mut window, "2 warnings");
    assert!(is_dialog(&window, "Message") && window.query_all_by_label_contains(hlg).count() > 0);
}
