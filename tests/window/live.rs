//! A camera in the window, played back from a video of a printed sheet. The assertions do not
//! depend on the machine's speed.

use std::path::Path;
use std::process::Command;

use crate::filmed;
use crate::filmed::Site;
use crate::fixture;
use crate::gpu;
use crate::harness;
use crate::harness::{
    Device, click_at, codes, drop_file, drop_model, has_label, run_until, shown_codes, wait_for, wait_for_label,
};
use crate::sheet;
use crate::sheet::{CAMERA, CameraPose, Sheet};
use crate::tier::{fast_or_full, is_full};
use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::DVec2;
use locard::compositor::Target;
use locard::live::{self, LiveOptions, LiveSpec};
use locard::params::Value;
use locard::recording::{OpenOptions, Recording};
use locard::shot::{Shot, ShotOptions};
use locard::window::{App, Project};

/// The site's video repeated. In the fast tier it is compressed, at a third of the frame rate.
fn endless(site: &Site) -> String {
    if is_full() {
        return site.endless();
    }
    const ENCODED: [&str; 6] = ["-c:v", "libx264rgb", "-preset", "ultrafast", "-crf", "20"];
    const SLOWER_BY: &str = "3";
    const REPEATED: &str = "39";
    let made = fixture::once("window-live", &[], (CAMERA.profile(), ENCODED, SLOWER_BY, REPEATED), |folder| {
        let ffmpeg = |before: [&str; 2], from: &str, codec: &[&str], to: &str| {
            let mut ffmpeg = Command::new("ffmpeg");
            ffmpeg.args(["-v", "error"]).args(before).args(["-i", from]).args(codec).arg(to);
            assert!(ffmpeg.status().unwrap().success());
        };
        let (slow, to) = (site.path("slow.mkv"), folder.join("endless.mkv"));
        ffmpeg(["-itsscale", SLOWER_BY], &site.path("site.mkv"), &ENCODED, &slow);
        ffmpeg(["-stream_loop", REPEATED], &slow, &["-c", "copy"], to.to_str().unwrap());
    });
    let path = site.path("endless.mkv");
    std::fs::copy(made.join("endless.mkv"), &path).unwrap();
    path
}

/// A window with a camera that plays the site's video, poses from its tags, and the marker beside
/// the sheet.
fn live_window(site: &Site, sets: &[&str]) -> Harness<'static, App> {
    window_of(site, &endless(site), sets)
}

fn window_of(site: &Site, video: &str, sets: &[&str]) -> Harness<'static, App> {
    let profile = Path::new(&site.path("camera.toml")).to_owned();
    let camera = locard::profile::Rig::of_file(&profile).unwrap().camera();
    let tags = format!("tags:{}", site.path("board.toml"));
    let opened = live::open(&LiveSpec::new(video, &tags), Some(&camera)).unwrap();
    let shadows: &[&str] = if is_full() { &[] } else { &["shadow.cast=false", "shadow.on_evidence=false"] };
    let sets = sets.iter().chain(shadows).map(ToString::to_string).collect();
    let options =
        ShotOptions { profile: Some(profile), sets, scene: Some(site.scene().into()), ..ShotOptions::default() };
    let mut project = Project::of(opened.recording(), &options).unwrap();
    project.camera = Some(LiveSpec::new(video, &tags));
    let builder = Harness::builder().with_size(egui::vec2(1400.0, 900.0)).renderer(Device::new());
    let mut window = builder.build_eframe(|context| App::new(context, project, Some(opened)).unwrap());
    run_until(&mut window, |app| app.viewer().composite().is_some());
    window
}

/// A shot's frame, composited anew.
fn composited(shot: &Shot, frame: usize) -> Vec<[u8; 3]> {
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let pending = shot.picture(&mut compositor, frame, Target::Pixels).unwrap();
    codes(&compositor.collect(pending).unwrap().pixels)
}

#[test]
fn frozen_camera_becomes_a_recording_and_resumes() {
    let site = Site::shared(&CAMERA);
    let mut window = live_window(&site, &[]);
    // Frame numbers, which seed the noise, restart.
    window.state_mut().project_mut().set("noise", "scale", &Value::Number(0.0)).unwrap();
    assert!(has_label(&window, "Freeze") && has_label(&window, "LIVE") && !has_label(&window, "Play"));
    run_until(&mut window, |app| app.player().frame() > 4);
    window.key_press(Key::Space);
    window.step();
    run_until(&mut window, |app| !app.project().shot().recording.is_live() && app.is_settled());
    assert_eq!(window.state().problem(), None);
    assert!(has_label(&window, "Back to live") && has_label(&window, "Play") && !has_label(&window, "Freeze"));
    let shot = window.state().project().shot().clone();
    let (count, frame) = (shot.recording.frame_count(), window.state().player().frame());
    assert!(count > 4 && frame == count - 1, "{frame} of {count}");
    assert_eq!(shown_codes(&window), composited(&shot, frame));
    // It needs only its own profile and poses.
    let path = &shot.recording.path;
    let alone = ShotOptions { scene: Some(site.path("scene.toml").into()), ..ShotOptions::default() };
    let alone = Shot::open(path, &OpenOptions::default(), &alone).unwrap();
    assert_eq!(shown_codes(&window), composited(&alone, frame));
    assert!(shown_codes(&window) != codes(&alone.read(frame).unwrap().pixels), "the marker is seen");
    // Changes still count as unsaved, though the recording contains them.
    let profile = Path::new(&site.path("saved.toml")).to_owned();
    window.state_mut().project_mut().save_profile(&profile).unwrap();
    let text = std::fs::read_to_string(&profile).unwrap();
    assert!(text.contains("[noise]\nscale = 0"), "{text}");
    // Changes made while frozen are kept.
    window.state_mut().project_mut().switch("motion_blur", false);
    window.key_press(Key::C);
    window.step();
    run_until(&mut window, |app| app.project().shot().recording.is_live() && app.player().frame() > frame);
    assert!(!window.state().project().edit().settings.is_on("motion_blur") && has_label(&window, "Freeze"));
}

#[test]
fn recording_made_while_live_gives_the_same_pictures() {
    let site = Site::shared(&CAMERA);
    let mut window = live_window(&site, &[]);
    let folder = Path::new(&site.path("recorded")).to_owned();
    let many = fast_or_full(6, 20);
    run_until(&mut window, |app| app.shown_frame().is_some_and(|frame| frame > many));
    window.state_mut().record(folder.clone());
    // Frames are renumbered from the first recorded one.
    run_until(&mut window, |app| app.shown_frame().is_some_and(|frame| frame < many));
    wait_for_label(&mut window, "Stop");
    // A machine slower than the camera always has another picture in progress.
    let mut shown: Vec<(usize, Vec<[u8; 3]>)> = Vec::new();
    while shown.len() < 4 {
        let last = shown.last().map(|(last, _)| *last);
        run_until(&mut window, |app| app.shown_frame().is_some_and(|frame| last.is_none_or(|last| last < frame)));
        shown.push((window.state().shown_frame().unwrap(), shown_codes(&window)));
    }
    window.get_by_label("Stop").click();
    wait_for_label(&mut window, "Record…");
    let options = ShotOptions { scene: Some(site.path("scene.toml").into()), ..ShotOptions::default() };
    let shot = Shot::of(Recording::open(&folder, &OpenOptions::default()).unwrap(), &options).unwrap();
    for (frame, codes) in shown {
        assert!(codes == composited(&shot, frame), "frame {frame}");
    }
    assert!(window.state().message().unwrap().starts_with("Recorded "), "{:?}", window.state().message());
}

#[test]
fn click_places_evidence_on_the_sheet_while_live() {
    let site = Site::shared(&CAMERA);
    let mut window = live_window(&site, &[]);
    assert!(has_label(&window, "on the floor"));
    let marker = Path::new("scenes/marker-1.glb").canonicalize().unwrap();
    let before = window.state().project().edit().scene.objects.len();
    drop_model(&mut window, marker);
    let at_px = DVec2::new(320.0, 250.0);
    let at = window.state().on_screen(egui::vec2(320.0, 250.0)).unwrap();
    // Sometimes the camera points away, and there is nothing to place the evidence on.
    while window.state().project().edit().scene.objects.len() == before {
        click_at(&mut window, at);
        harness::pause();
    }
    let [x, y, z] = window.state().project().edit().scene.objects[before].position_m.unwrap();
    // It is on the sheet's plane, within rounding, if one of these frames shows that point.
    assert!(z.abs() < 1e-4, "{z}");
    let truth = (0..filmed::FRAMES).map(|i| filmed::place(i as f64 / filmed::FPS));
    let off_px = truth.map(|place| place.project(&CAMERA, glam::DVec3::new(x, y, z)).distance(at_px));
    assert!(off_px.fold(f64::INFINITY, f64::min) < 1.0);
}

/// Requests the window to close.
fn close(window: &mut Harness<'_, App>) {
    let id = window.input().viewport_id;
    window.input_mut().viewports.get_mut(&id).unwrap().events.push(egui::ViewportEvent::Close);
    window.run_steps(2);
}

#[test]
fn closing_asks_before_ending_a_camera_recording() {
    let site = Site::shared(&CAMERA);
    let mut window = live_window(&site, &[]);
    close(&mut window);
    assert!(!has_label(&window, "Cancel"), "nothing is recorded");
    let folder = Path::new(&site.path("recorded")).to_owned();
    window.state_mut().record(folder.clone());
    wait_for_label(&mut window, "Stop");
    close(&mut window);
    assert!(has_label(&window, "End the recording and close"));
    window.get_by_label("Cancel").click();
    window.run_steps(2);
    assert!(has_label(&window, "Stop") && !has_label(&window, "Cancel"));
    // Another recording, with unsaved changes: one question covers both.
    window.state_mut().project_mut().set("noise", "scale", &Value::Number(0.5)).unwrap();
    drop_file(&mut window, Path::new("recordings/demo").canonicalize().unwrap());
    wait_for_label(&mut window, "Continue without saving");
    assert_eq!(window.query_all_by_label_contains("The camera is being recorded.").count(), 1);
    window.get_by_label("Cancel").click();
    window.run_steps(2);
    window.state_mut().project_mut().undo();
    drop_file(&mut window, Path::new("recordings/demo").canonicalize().unwrap());
    wait_for_label(&mut window, "End the recording and continue");
    window.get_by_label("End the recording and continue").click();
    run_until(&mut window, |app| !app.project().shot().recording.is_live());
    let recording = Recording::open(&folder, &OpenOptions::default()).unwrap();
    assert!(recording.frame_count() > 0);
}

/// The first frame of the site's video.
fn one_frame(site: &Site) -> String {
    let (all, one) = (site.path("site.mkv"), site.path("one.mkv"));
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-i", &all, "-frames:v", "1", "-c", "copy", &one]);
    assert!(ffmpeg.status().unwrap().success());
    one
}

#[test]
fn video_of_one_frame_shows_it_and_its_end() {
    let site = Site::shared(&CAMERA);
    let mut window = window_of(&site, &one_frame(&site), &[]);
    wait_for_label(&mut window, "the camera has ended; its last picture is shown");
    assert!(window.state().viewer().composite().is_some());
}

#[test]
fn ended_camera_can_be_frozen_repeatedly() {
    let site = Site::shared(&CAMERA);
    let mut window = window_of(&site, &site.path("site.mkv"), &[]);
    wait_for_label(&mut window, "the camera has ended; its last picture is shown");
    let mut frozen = Vec::new();
    for _ in 0..2 {
        run_until(&mut window, App::is_settled);
        window.key_press(Key::Space);
        window.step();
        run_until(&mut window, |app| !app.project().shot().recording.is_live() && app.is_settled());
        let count = window.state().project().shot().recording.frame_count();
        frozen.push((count, window.state().player().frame(), shown_codes(&window)));
        window.key_press(Key::C);
        window.step();
        run_until(&mut window, |app| app.project().shot().recording.is_live() && app.is_settled());
        // The last frame is still there.
        assert!(shown_codes(&window) == frozen[0].2 || window.state().player().frame() + 1 < frozen[0].0);
    }
    assert!(frozen[0].0 > 1 && frozen[1] == frozen[0], "{} {}", frozen[0].0, frozen[1].0);
}

#[test]
fn plots_exist_only_while_the_camera_is_frozen() {
    let site = Site::shared(&CAMERA);
    let noise = "[camera.noise]\nchannel_correlation = [0.5, 0.5, 0.5]\nneighbour_correlation = [0.5, 0.5]\n\
                 code = [0.0, 255.0]\nsigma_r = [1.0, 1.0]\nsigma_g = [1.0, 1.0]\nsigma_b = [1.0, 1.0]\n";
    std::fs::write(site.path("camera.toml"), CAMERA.profile() + noise).unwrap();
    let mut window = live_window(&site, &[]);
    window.get_by_label("Match").click();
    let waits = |window: &Harness<'_, App>| window.query_all_by_label_contains("No plot is drawn").count() == 1;
    window.run_steps(3);
    assert!(waits(&window));
    window.key_press(Key::Space);
    window.step();
    run_until(&mut window, |app| !app.project().shot().recording.is_live() && app.is_settled());
    let plot_count =
        |window: &Harness<'_, App>| window.query_all_by_label_contains("Noise relative to profile").count();
    wait_for(&mut window, "the plot", |window| {
        assert!(!waits(window));
        plot_count(window) > 0
    });
    window.key_press(Key::C);
    window.run_steps(3);
    assert!(waits(&window) && plot_count(&window) == 0);
}

/// Replaces the text of a field.
fn replace_text(window: &mut Harness<'_, App>, field: &str, text: &str) {
    window.get_by_role_and_label(Role::TextInput, field).focus();
    window.step();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.step();
    window.get_by_role_and_label(Role::TextInput, field).type_text(text);
    window.run_steps(2);
}

fn open_camera_dialog(window: &mut Harness<'_, App>) {
    window.get_by_label("File").click();
    window.run_steps(2);
    window.get_by_label("Live camera…").click();
    wait_for_label(window, "Start");
}

#[test]
fn camera_dialog_shows_the_current_options_and_restarts_with_new_ones() {
    let site = Site::shared(&CAMERA);
    let mut window = live_window(&site, &[]);
    let value = |window: &Harness<'_, App>, field: &str| {
        window.get_by_role_and_label(Role::TextInput, field).accesskit_node().value().unwrap_or_default()
    };
    open_camera_dialog(&mut window);
    assert!(window.query_by_role_and_label(Role::Dialog, "Live camera").is_some(), "a screen reader says where one is");
    // Options with which the camera was opened.
    assert_eq!(value(&window, "Board"), site.path("board.toml"));
    assert_eq!(value(&window, "Camera"), site.path("endless.mkv"));
    replace_text(&mut window, "Smoothing", "five");
    assert_eq!(window.query_all_by_label_contains("Smoothing: expected seconds").count(), 1);
    assert!(window.get_by_label("Start").accesskit_node().is_disabled());
    replace_text(&mut window, "Smoothing", "0.05");
    replace_text(&mut window, "Rate", "25");
    replace_text(&mut window, "Pictures", "320x240");
    // The file dialog replaces the camera dialog, which returns afterwards.
    window.get_by_label("Choose a board…").click();
    wait_for_label(&mut window, "Choose a board");
    assert!(!has_label(&window, "Start"));
    window.key_press(Key::Escape);
    wait_for_label(&mut window, "Start");
    window.get_by_label("Start").click();
    run_until(&mut window, |app| app.project().camera.as_ref().is_some_and(|from| from.options.smooth_s.is_some()));
    let expected =
        LiveOptions { smooth_s: Some(0.05), rate_hz: Some(25.0), size: Some((320, 240)), ..LiveOptions::default() };
    assert_eq!(window.state().project().camera.as_ref().unwrap().options, expected);
    run_until(&mut window, |app| app.viewer().composite().is_some());
    open_camera_dialog(&mut window);
    assert_eq!(["Smoothing", "Rate", "Pictures"].map(|field| value(&window, field)), ["0.05", "25", "320x240"]);
    // For a stream the dialog has a delay.
    window.get_by_label("from a stream").click();
    window.run_steps(2);
    replace_text(&mut window, "Delay", "auto");
    assert!(!window.get_by_label("Start").accesskit_node().is_disabled());
    replace_text(&mut window, "Delay", "late");
    assert!(window.get_by_label("Start").accesskit_node().is_disabled());
}

#[test]
fn enter_in_a_camera_dialog_field_ends_typing_without_starting() {
    let site = Site::shared(&CAMERA);
    let mut window = live_window(&site, &[]);
    open_camera_dialog(&mut window);
    replace_text(&mut window, "Rate", "25");
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert!(has_label(&window, "Start") && window.state().project().camera.as_ref().unwrap().options.rate_hz.is_none());
    // Without a focus, Enter presses the filled button.
    window.key_press(Key::Enter);
    run_until(&mut window, |app| app.project().camera.as_ref().is_some_and(|from| from.options.rate_hz == Some(25.0)));
}

/// After a refusal the typed text is kept, the reason is shown beside it, and the fields have the
/// keyboard.
#[test]
fn refused_camera_leaves_the_dialog_as_typed() {
    let site = Site::shared(&CAMERA);
    let mut window = live_window(&site, &[]);
    open_camera_dialog(&mut window);
    replace_text(&mut window, "Rate", "25");
    replace_text(&mut window, "Camera", "nowhere.mkv");
    window.get_by_label("Start").click();
    let is_refused =
        |window: &Harness<'_, App>| window.query_all_by_label_contains("there is no such file").count() > 0;
    wait_for(&mut window, "the refusal", is_refused);
    let value = |window: &Harness<'_, App>, field: &str| {
        window.get_by_role_and_label(Role::TextInput, field).accesskit_node().value().unwrap_or_default()
    };
    assert_eq!(value(&window, "Rate"), "25");
    assert!(value(&window, "Camera").ends_with("nowhere.mkv"), "{}", value(&window, "Camera"));
    replace_text(&mut window, "Profile", "c");
    assert_eq!(value(&window, "Profile"), "c");
    assert!(window.query_by_role_and_label(Role::Dialog, "Live camera").is_some());
}

/// A video of the sheet as it is held in front of a camera for calibration: at rest in one place
/// after the other, repeated.
fn calibration_video(site: &Site) -> String {
    let printed = image::open(site.path("board.png")).unwrap().into_luma8();
    let sheet = Sheet::of(printed.width() as usize, printed.height() as usize, printed.into_raw());
    let stands = [[0.0, -0.1], [0.4, 0.0], [-0.4, 0.1], [0.05, 0.42], [0.0, -0.45], [0.35, 0.35], [-0.3, -0.3]];
    for (n, [x, y]) in stands.into_iter().enumerate() {
        let target = glam::DVec3::new(0.1 * y, -0.1 * x, 0.0);
        let place = CameraPose::look_at(glam::DVec3::new(x, y, 0.55), target, 0.2 * n as f64);
        let codes = sheet.photograph(&CAMERA, 3, 1.0, n as u64, |_| place);
        image::RgbImage::from_raw(640, 480, codes).unwrap().save(site.path(&format!("held-{n}.png"))).unwrap();
    }
    let (stands_per_s, pictures) = fast_or_full(("1", "fps=5"), ("0.5", "fps=10"));
    let (from, once, to) = (site.path("held-%d.png"), site.path("held-once.mkv"), site.path("held.mkv"));
    let codec = ["-c:v", "libx264rgb", "-preset", "ultrafast", "-qp", "0"];
    let made = ["-framerate", stands_per_s, "-i", &from, "-vf", pictures];
    let repeated = ["-stream_loop", "20", "-i", &once, "-c", "copy", &to];
    for arguments in [[&made[..], &codec, &[&once]].concat(), repeated.to_vec()] {
        assert!(Command::new("ffmpeg").args(["-v", "error"]).args(arguments).status().unwrap().success());
    }
    to
}

// Slow: the video of the sheet plays in real time and has to show four poses of it.
#[test]
fn live_camera_calibration_is_accepted_or_discarded() {
    let site = Site::shared(&CAMERA);
    let wrong = sheet::Camera { focal_px: 700.0, k1: 0.0, ..CAMERA };
    std::fs::write(site.path("camera.toml"), wrong.profile()).unwrap();
    let (video, profile) = (calibration_video(&site), Path::new(&site.path("camera.toml")).to_owned());
    let camera = locard::profile::Rig::of_file(&profile).unwrap().camera();
    let opened = live::open(&LiveSpec::new(&video, "none"), Some(&camera)).unwrap();
    let options = ShotOptions { profile: Some(profile), ..ShotOptions::default() };
    let mut project = Project::of(opened.recording(), &options).unwrap();
    project.camera = Some(LiveSpec::new(&video, "none"));
    let builder = Harness::builder().with_size(egui::vec2(1400.0, 900.0)).renderer(Device::new());
    let mut window = builder.build_eframe(|context| App::new(context, project, Some(opened)).unwrap());
    window.step();
    window.get_by_label("Calibrate").click();
    wait_for_label(&mut window, "Calibrate camera…");
    window.get_by_label("Calibrate camera…").click();
    wait_for_label(&mut window, "Cancel");
    assert!(window.get_by_label("Finish").accesskit_node().is_disabled(), "three views at least");
    let views = |window: &Harness<'_, App>| -> usize {
        let node = window.query_all_by_label_contains(" of 20 views, ").next().unwrap();
        let text = node.accesskit_node().label().or(node.accesskit_node().value()).unwrap();
        text.split(' ').next().unwrap().parse().unwrap()
    };
    let has_views = |window: &Harness<'_, App>| views(window) >= 4;
    wait_for(&mut window, "a fourth view", has_views);
    assert!(window.query_all_by_label_contains("missing: ").count() > 0);
    window.get_by_label("Finish").click();
    wait_for_label(&mut window, "Apply to profile: camera");
    let fx = |window: &Harness<'_, App>| match window.state().project().value("camera", "fx_px") {
        Some(Value::Number(fx)) => fx,
        other => panic!("{other:?}"),
    };
    assert_eq!(fx(&window), 700.0, "nothing is taken by itself");
    assert!(window.query_all_by_label_contains("700.").count() > 0, "it stands beside");
    window.get_by_label("Apply to profile: camera").click();
    window.run_steps(2);
    assert!((fx(&window) / CAMERA.focal_px - 1.0).abs() < 0.02, "{}", fx(&window));
    assert!(window.get_by_label("Apply to profile: camera").accesskit_node().is_disabled());
    let Some(Value::Number(k1)) = window.state().project().value("camera.distortion", "k1") else { panic!() };
    assert!((k1 - CAMERA.k1).abs() < 0.05, "{k1}");
    // One undo step.
    window.get_by_label("Undo").click();
    window.run_steps(2);
    assert_eq!(fx(&window), 700.0);
    window.get_by_label("Discard: camera").click();
    window.run_steps(2);
    assert!(!has_label(&window, "Apply to profile: camera") && has_label(&window, "Calibrate camera…"));
}
