//! Difficulties of new users of the window.

use std::path::Path;

use crate::harness::{
    Device, click_at, demo, demo_frame, demo_px, has_label, run_until, scene_or_none, search, settle, wait_for,
    wait_for_label, window,
};
use crate::program;
use crate::tier::fast_or_full;
use eframe::egui::{self, Key, Modifiers, Pos2, accesskit::Role, pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use locard::params::Value;
use locard::recording::OpenOptions;
use locard::scene::Entry;
use locard::shot::ShotOptions;
use locard::window::{App, DEMO, DEMO_SCENE, Project, Start};

fn open_at(recording: &Path) -> Harness<'static, App> {
    let options = ShotOptions { scene: Some(DEMO_SCENE.into()), ..ShotOptions::default() };
    window(Project::open(recording, &OpenOptions::default(), &options).unwrap(), egui::vec2(1400.0, 1000.0))
}

fn open() -> Harness<'static, App> {
    open_at(&demo())
}

/// Window of tests that check nothing virtual.
fn open_plain() -> Harness<'static, App> {
    let options = ShotOptions { scene: scene_or_none(), ..ShotOptions::default() };
    window(Project::open(&demo(), &OpenOptions::default(), &options).unwrap(), egui::vec2(1400.0, 1000.0))
}

fn scale(window: &Harness<'_, App>) -> f64 {
    match window.state().project().value("noise", "scale").unwrap() {
        Value::Number(scale) => scale,
        other => panic!("{other}"),
    }
}

fn steps(window: &Harness<'_, App>) -> Vec<String> {
    window.state().project().history().names().0.map(str::to_owned).collect()
}

/// Clicks into the only number field, and types.
fn type_number(window: &mut Harness<'_, App>, text: &str) {
    let all: Vec<_> = window.query_all_by_role(Role::SpinButton).map(|node| node.rect()).collect();
    assert_eq!(all.len(), 1, "one field beside one slider");
    click_at(window, all[0].center());
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text(text.to_owned()));
    window.run_steps(3);
}

#[test]
fn esc_reverts_typed_text() {
    let mut window = open();
    search(&mut window, "noise scale");
    type_number(&mut window, "0.25");
    // The field consumes Esc: the open panel stays.
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(2);
    window.key_press(Key::Escape);
    window.run_steps(4);
    assert!(scale(&window) == 1.0 && steps(&window) == ["opened"], "{:?}", steps(&window));
    assert!(has_label(&window, "Image sequence…"));
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(2);
    type_number(&mut window, "0.5");
    window.key_press(Key::Enter);
    window.run_steps(4);
    assert_eq!(scale(&window), 0.5);

    // A name, and a position.
    let object = Entry { object: 0, instance: window.state().project().edit().scene.entries()[0].instance };
    let title = |window: &Harness<'_, App>| window.state().project().edit().scene.title(object);
    let (before, steps_before) = (title(&window), steps(&window));
    window.get_by_role_and_label(Role::Button, &before).click();
    window.run_steps(2);
    window.get_by_role_and_label(Role::TextInput, "Name").focus();
    window.step();
    window.get_by_role_and_label(Role::TextInput, "Name").type_text("Beweis");
    window.run_steps(2);
    assert!(title(&window) != before);
    window.key_press(Key::Escape);
    window.run_steps(4);
    assert_eq!((title(&window), steps(&window)), (before, steps_before));
    let placement = window.state().project().edit().scene.placement(object);
    let at = window.get_by_role_and_label(Role::Slider, "position x").rect().center();
    click_at(&mut window, at);
    window.event(egui::Event::Text("0.5".to_owned()));
    window.run_steps(2);
    window.key_press(Key::Escape);
    window.run_steps(4);
    assert_eq!(window.state().project().edit().scene.placement(object), placement);
}

/// Position of the handle of the noise scale's slider, 1 of 0 to 8.
fn handle(window: &Harness<'_, App>) -> Pos2 {
    let rail = window.get_by_role_and_label(Role::Slider, "Noise: Amount").rect();
    let half = 0.75 * rail.height() / 2.5;
    pos2(rail.left() + half + (rail.width() - 2.0 * half) * scale(window) as f32 / 8.0, rail.center().y)
}

#[test]
fn press_on_a_slider_handle_changes_nothing_and_a_drag_is_one_step() {
    let mut window = open_plain();
    search(&mut window, "noise scale");
    let at = handle(&window) + egui::vec2(3.0, 0.0);
    click_at(&mut window, at);
    assert!(scale(&window) == 1.0 && steps(&window) == ["opened"], "{}", scale(&window));
    // It moves as far as the pointer.
    let rail = window.get_by_role_and_label(Role::Slider, "Noise: Amount").rect();
    let (before, way) = (handle(&window), 0.125 * (rail.width() - 2.0 * 0.75 * rail.height() / 2.5));
    window.hover_at(at);
    window.step();
    window.drag_at(at);
    window.step();
    for share in [0.4, 1.0] {
        window.hover_at(at + egui::vec2(share * way, 0.0));
        window.step();
    }
    window.drop_at(at + egui::vec2(way, 0.0));
    window.run_steps(2);
    assert!((scale(&window) - 2.0).abs() < 0.02, "{}", scale(&window));
    assert!((handle(&window).x - before.x - way).abs() < 1.0);
    type_number(&mut window, "0.25");
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert!(steps(&window) == ["opened", "Noise: Amount", "Noise: Amount"], "{:?}", steps(&window));
    // A press beside the handle moves it there.
    click_at(&mut window, rail.center());
    assert!((scale(&window) - 4.0).abs() < 0.1, "{}", scale(&window));
    assert_eq!(steps(&window).len(), 4);
}

#[test]
fn double_click_restores_the_profile_value_or_the_default() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    std::fs::write(&profile, "version = 1\n[noise]\nscale = 0.5\n").unwrap();
    let options = ShotOptions { profile: Some(profile), scene: scene_or_none(), ..ShotOptions::default() };
    let project = Project::open(&demo(), &OpenOptions::default(), &options).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 1000.0));
    for (words, slider, name, of_profile) in
        [("noise amount", "Noise: Amount", "scale", 0.5), ("grain size", "Noise: Grain size", "magnification", 1.0)]
    {
        search(&mut window, words);
        let set = Value::Number(3.0);
        window.state_mut().project_mut().set("noise", name, &set).unwrap();
        window.state_mut().project_mut().close_step();
        window.run_steps(2);
        let at = window.get_by_role_and_label(Role::Slider, slider).rect().center();
        window.hover_at(at);
        window.step();
        for _ in 0..2 {
            for pressed in [true, false] {
                let (button, modifiers) = (egui::PointerButton::Primary, Modifiers::NONE);
                // Within the one step: separately it would take a quarter of a second.
                window.input_mut().events.push(egui::Event::PointerButton { pos: at, button, pressed, modifiers });
            }
            window.step();
        }
        window.run_steps(2);
        assert_eq!(window.state().project().value("noise", name), Some(Value::Number(of_profile)), "{slider}");
    }
}

#[test]
fn esc_closes_the_open_panel_and_messages_let_clicks_through() {
    let mut window = open();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(2);
    assert!(has_label(&window, "Image sequence…"));
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert!(!has_label(&window, "Image sequence…"));
    window.state_mut().show_start(true);
    window.run_steps(2);
    assert!(has_label(&window, "Recent") || has_label(&window, "Open a recording…"));
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert!(!has_label(&window, "Open a recording…"));

    // The current action ends before the open panel.
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(2);
    window.get_by_label("Define plane…").click();
    window.run_steps(2);
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert!(has_label(&window, "Image sequence…"));
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert!(!has_label(&window, "Image sequence…"));

    window.state_mut().project_mut().set("noise", "scale", &Value::Number(0.5)).unwrap();
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    window.get_by_label("Undone: Noise: Amount").click();
    window.run_steps(3);
    assert!(has_label(&window, "Copy"));
    let wipe = window.get_by_label("Wipe").rect().center();
    click_at(&mut window, wipe);
    assert!(!has_label(&window, "Copy") && window.state().view().wipe.is_some(), "one click does both");
}

#[test]
fn click_selects_a_recording_and_describes_it() {
    let temp = tempfile::tempdir().unwrap();
    program::copied(&demo(), &temp.path().join("mine"));
    let mut window = open_at(&temp.path().join("mine"));
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    wait_for_label(&mut window, "mine/   recording");
    assert!(has_label(&window, "Open") && !has_label(&window, "Open recording"));
    window.get_by_label("mine/   recording").click();
    window.run_steps(2);
    wait_for_label(
        &mut window,
        fast_or_full("mine: 24 frames, 160 × 120 px, 2.4 s", "mine: 72 frames, 640 × 480 px, 2.4 s"),
    );
    window.get_by_label("Open recording").click();
    run_until(&mut window, |app| app.problem().is_none() && app.project().scene.is_none());
    settle(&mut window);
}

#[test]
fn unknown_exposure_is_reported_at_once() {
    let temp = tempfile::tempdir().unwrap();
    let recording = temp.path().join("dark");
    program::copied(&demo(), &recording);
    let text = std::fs::read_to_string(recording.join("recording.toml")).unwrap();
    let without = text.replace("[exposure]\nlist = \"exposure.txt\"\n", "");
    assert!(without != text);
    std::fs::write(recording.join("recording.toml"), without).unwrap();
    let camera = recording.join("camera.toml");
    let text = std::fs::read_to_string(&camera).unwrap();
    let without: Vec<&str> = text.lines().filter(|line| !line.starts_with("time_s")).collect();
    assert!(without.len() < text.lines().count());
    std::fs::write(&camera, without.join("\n")).unwrap();
    let message =
        "Exposure time unknown; half the frame interval is assumed, at most 1/60 s. Set Camera: exposure, Time.";
    let mut window = open_at(&recording);
    search(&mut window, "motion_blur");
    assert!(has_label(&window, message));
    window.state_mut().project_mut().set("camera.exposure", "time_s", &Value::Number(0.01)).unwrap();
    window.run_steps(2);
    assert!(!has_label(&window, message));
}

#[test]
fn placement_preview_follows_the_pointer() {
    let mut window = open();
    window.state_mut().player_mut().seek(demo_frame(30));
    settle(&mut window);
    let before = window.state().project().edit().scene.clone();
    window.get_by_label("Place…").click();
    window.run_steps(3);
    window.get_by_role_and_label(Role::Button, "marker-3").click();
    window.run_steps(3);
    let middle = |outline: &[Vec<glam::DVec2>]| {
        let all: Vec<_> = outline.concat();
        all.iter().sum::<glam::DVec2>() / all.len() as f64
    };
    for at_px in [demo_px(320.0, 300.0), demo_px(260.0, 330.0)] {
        let at = window.state().on_screen(at_px).unwrap();
        window.hover_at(at);
        // The object is at that position, and extends upwards from it.
        let off_px = demo_px(15.0, 40.0);
        let is_there = |app: &App| {
            let outline = app.preview_outline().filter(|outline| !outline.is_empty());
            outline.map(middle).is_some_and(|at| {
                (at.x - f64::from(at_px.x)).abs() < off_px.x.into()
                    && (at.y - f64::from(at_px.y)).abs() < off_px.y.into()
            })
        };
        run_until(&mut window, is_there);
    }
    assert!(window.state().project().edit().scene == before && steps(&window) == ["opened"]);
    window.key_press(Key::Escape);
    window.run_steps(2);
    assert!(window.state().preview_outline().is_none());
}

#[test]
fn recording_reopens_at_its_last_frame_and_view() {
    let temp = tempfile::tempdir().unwrap();
    let other = temp.path().join("other");
    program::copied(&demo(), &other);
    let mut window = open();
    window.state_mut().set_state_folder(&temp.path().join("state"));
    window.state_mut().player_mut().seek(demo_frame(20));
    settle(&mut window);
    window.state_mut().view_mut().zoom = Some(4.0);
    window.state_mut().view_mut().centre = egui::vec2(0.25, 0.75);
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    window.run_steps(3);
    window.event(egui::Event::Text(other.display().to_string()));
    wait_for_label(&mut window, "Open recording");
    window.get_by_label("Open recording").click();
    run_until(&mut window, |app| app.project().shot().recording.path == other);
    settle(&mut window);
    assert_eq!((window.state().player().frame(), window.state().view().zoom), (0, None));
    window.state_mut().show_start(true);
    wait_for_label(&mut window, "demo   demo.toml");
    window.get_by_label("demo   demo.toml").click();
    run_until(&mut window, |app| app.project().shot().recording.path != other);
    settle(&mut window);
    let view = window.state().view();
    assert_eq!(
        (window.state().player().frame(), view.zoom, view.centre),
        (demo_frame(20), Some(4.0), egui::vec2(0.25, 0.75))
    );
}

#[test]
fn window_without_the_demonstration_opens_a_start_page() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("state");
    let builder = Harness::builder().with_size(egui::vec2(1280.0, 800.0)).renderer(Device::new());
    let (kept, demonstration) = (folder.clone(), std::path::absolute(DEMO).unwrap());
    let mut start = builder.build_eframe(move |context| Start::new(context, Some(&kept)).unwrap());
    start.run_steps(3);
    assert!(has_label(&start, "Open a recording…") && !has_label(&start, "Continue with the demo"));
    assert!(start.query_all_by_label_contains(&demonstration.display().to_string()).count() > 0);
    start.get_by_label("Open a recording…").click();
    start.run_steps(3);
    start.event(egui::Event::Text(std::path::absolute(demo()).unwrap().display().to_string()));
    wait_for_label(&mut start, "Open recording");
    start.get_by_label("Open recording").click();
    wait_for(&mut start, "the recording", |start| start.state().app().is_some_and(App::is_settled));
    assert!(has_label(&start, "Undo"));
    drop(start);
    // It is among the recent recordings.
    let again = Harness::builder().with_size(egui::vec2(1280.0, 800.0)).renderer(Device::new());
    let mut again = again.build_eframe(move |context| Start::new(context, Some(&folder)).unwrap());
    wait_for_label(&mut again, "demo");
}
