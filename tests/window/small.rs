//! Small windows, long names: nothing necessary is cut off.

use crate::harness;
use crate::harness::{demo, drop_model, has_label, scene_or_none, settle, window};
use crate::program;
use eframe::egui::{self, Key, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use locard::params::{Value, title};
use locard::recording::OpenOptions;
use locard::shot::ShotOptions;
use locard::window::{App, DEMO_SCENE, Project};

fn open_at(recording: &std::path::Path, size: egui::Vec2) -> Harness<'static, App> {
    let options = ShotOptions { scene: scene_or_none(), ..ShotOptions::default() };
    window(Project::open(recording, &OpenOptions::default(), &options).unwrap(), size)
}

#[test]
fn picture_keeps_half_of_a_small_window() {
    let mut window = open_at(&demo(), egui::vec2(640.0, 480.0));
    for width in [640.0, 900.0, 1000.0, 1280.0] {
        window.set_size(egui::vec2(width, 480.0));
        window.run_steps(4);
        let picture = window.get_by_role_and_label(Role::Image, "picture").rect();
        assert!(picture.width() >= 0.5 * width - 1.0 && picture.height() > 200.0, "{width}: {picture:?}");
    }
}

#[test]
fn small_window_shows_one_panel_at_a_time() {
    let mut window = open_at(&demo(), egui::vec2(640.0, 480.0));
    assert!(has_label(&window, "Search parameters") && !has_label(&window, "Place…"));
    window.get_by_label("Evidence").click();
    window.run_steps(3);
    assert!(has_label(&window, "Place…") && !has_label(&window, "Search parameters"));
}

#[test]
fn small_window_shows_the_evidence_if_a_model_is_dropped_or_missing() {
    let mut window = open_at(&demo(), egui::vec2(640.0, 480.0));
    drop_model(&mut window, std::fs::canonicalize("scenes/marker-1.glb").unwrap());
    assert!(has_label(&window, "upright") && has_label(&window, "flat"));
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("case.toml");
    std::fs::write(&scene, "version = 1\n\n[[objects]]\nmodel = \"knife.glb\"\n").unwrap();
    let options = ShotOptions { scene: Some(scene), ..ShotOptions::default() };
    let project = Project::open(&demo(), &OpenOptions::default(), &options).unwrap();
    let mut window = self::window(project, egui::vec2(640.0, 480.0));
    window.run_steps(2);
    assert!(has_label(&window, "Locate knife.glb…"));
    // The user's choice of a tab is kept afterwards.
    window.get_by_label("Adjustments").click();
    window.run_steps(3);
    assert!(has_label(&window, "Search parameters") && !has_label(&window, "Locate knife.glb…"));
}

#[test]
fn selection_follows_the_scene_without_a_panel() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("case.toml");
    std::fs::write(&scene, "version = 1\n").unwrap();
    let options = ShotOptions { scene: Some(scene), ..ShotOptions::default() };
    let project = Project::open(&demo(), &OpenOptions::default(), &options).unwrap();
    let mut window = window(project, egui::vec2(1280.0, 480.0));
    window.state_mut().project_mut().change_scene("lamp", |scene| _ = scene.add_lamp(glam::DVec3::Z)).unwrap();
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, "lamp 1").click();
    window.run_steps(2);
    assert!(window.state().selected().is_some());
    window.state_mut().view_mut().alone = true;
    window.state_mut().project_mut().undo();
    window.run_steps(2);
    assert_eq!(window.state().selected(), None);
    settle(&mut window);
}

#[test]
fn key_help_fits_a_small_window() {
    for (width, height) in [(640.0, 480.0), (900.0, 600.0)] {
        let mut window = open_at(&demo(), egui::vec2(width, height));
        window.key_press(Key::Questionmark);
        window.run_steps(4);
        let rect = |label: &str| window.get_by_label(label).rect();
        for (key, does) in [("Space", "play, pause; freeze the camera"), ("W", "wipe between camera and composite")] {
            let (key, does) = (rect(key), rect(does));
            assert!(key.left() >= 0.0 && key.right() <= does.left() && does.right() <= width, "{key:?} {does:?}");
        }
    }
}

#[test]
fn long_name_does_not_move_the_buttons() {
    let temp = tempfile::tempdir().unwrap();
    let long = temp.path().join("a folder with a name that is as long as people give them to their cases 2026-11-28");
    program::copied(&demo(), &long);
    let size = egui::vec2(1280.0, 480.0);
    let [short, long] = [demo(), long].map(|recording| open_at(&recording, size).get_by_label("Undo").rect());
    assert!(long.left() - short.left() < 0.16 * size.x && long.right() < 0.4 * size.x, "{short:?} {long:?}");
    assert_eq!(long.top(), short.top());
}

#[test]
fn title_distinguishes_recordings_of_one_name() {
    let temp = tempfile::tempdir().unwrap();
    let recording = temp.path().join("case 7/demo");
    std::fs::create_dir(temp.path().join("case 7")).unwrap();
    program::copied(&demo(), &recording);
    let options = ShotOptions { scene: Some(DEMO_SCENE.into()), ..ShotOptions::default() };
    let project = Project::open(&recording, &OpenOptions::default(), &options).unwrap();
    let window = window(project, egui::vec2(900.0, 600.0));
    assert_eq!(window.state().title(), "case 7/demo – demo.toml – Locard");
}

#[test]
fn toolbar_distinguishes_recordings_of_one_name() {
    let temp = tempfile::tempdir().unwrap();
    let folders = ["case 7", "case 8"].map(|case| temp.path().join(case));
    for folder in folders {
        std::fs::create_dir(&folder).unwrap();
        let recording = folder.join("demo");
        program::copied(&demo(), &recording);
        let window = open_at(&recording, egui::vec2(900.0, 600.0));
        let case = folder.file_name().unwrap().to_str().unwrap();
        assert!(has_label(&window, &format!("{case}/demo")));
    }
}

/// Asserts that the controls whose names start with `called` are side by side in their row and end
/// within the window.
fn row_ends_within(window: &Harness<'static, App>, called: &str) {
    let mut controls: Vec<_> = window.query_all_by_label_contains(called).map(|node| node.rect()).collect();
    controls.sort_by(|a, b| a.left().total_cmp(&b.left()));
    assert!(!controls.is_empty(), "{called}");
    assert!(controls.windows(2).all(|pair| pair[0].right() <= pair[1].left()), "{called} {controls:?}");
    assert!(
        controls[controls.len() - 1].right() <= window.ctx.content_rect().width() - SCROLL_BAR_WIDTH,
        "{called} {controls:?}"
    );
}

/// Width of the scroll bar, points.
const SCROLL_BAR_WIDTH: f32 = 8.0;

#[test]
fn long_values_keep_every_row_within_a_small_window() {
    let mut window = open_at(&demo(), egui::vec2(640.0, 480.0));
    let long = [
        ("camera.exposure", "iso", "ISO", 87_806.0),
        ("noise", "iso", "ISO", 23_456.0),
        ("camera.exposure", "time_s", "Time", 0.012_345),
        ("camera.lens", "f_number", "f-number", 17.959),
        ("camera.distortion", "k1", "k1", -0.000_123_45),
        ("camera", "fx_px", "Focal length, x", 98_765.4),
    ];
    for (table, name, words, value) in long {
        window.state_mut().project_mut().set(table, name, &Value::Number(value)).unwrap();
        harness::search(&mut window, &format!("{table}.{name}"));
        row_ends_within(&window, &format!("{}: {words}", title(table)));
    }
}
