//! The window operated by the labels of its controls.

use std::path::Path;

use crate::gpu;
use crate::harness::{
    codes, control_label, demo, demo_frame, demo_px, run_until, scene_or_none, search, settle, shown_codes, window,
};
use crate::program;
use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use locard::compositor::Target;
use locard::params::{Kind, Params, Value};
use locard::recording::OpenOptions;
use locard::shot::{Shot, ShotOptions};
use locard::window::{App, Origin, Project};

fn given(profile: Option<&Path>) -> ShotOptions {
    ShotOptions { profile: profile.map(Into::into), scene: Some("scenes/demo.toml".into()), ..ShotOptions::default() }
}

fn open(profile: Option<&Path>) -> Harness<'static, App> {
    let project = Project::open(&demo(), &OpenOptions::default(), &given(profile)).unwrap();
    window(project, egui::vec2(1400.0, 900.0))
}

/// Window of tests that check nothing virtual.
fn open_plain(profile: Option<&Path>) -> Harness<'static, App> {
    let project = Project::open(&demo(), &OpenOptions::default(), &plain(profile)).unwrap();
    window(project, egui::vec2(1400.0, 900.0))
}

fn plain(profile: Option<&Path>) -> ShotOptions {
    ShotOptions { scene: scene_or_none(), ..given(profile) }
}

/// The picture that `locard composite` writes with these settings.
fn written(sets: &[&str], frame: usize) -> Vec<[u8; 3]> {
    let options = ShotOptions { sets: sets.iter().map(ToString::to_string).collect(), ..given(None) };
    let shot = Shot::open(&demo(), &OpenOptions::default(), &options).unwrap();
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let pending = shot.picture(&mut compositor, frame, Target::Pixels).unwrap();
    codes(&compositor.collect(pending).unwrap().pixels)
}

fn value(window: &Harness<'_, App>, table: &str, name: &str) -> Value {
    let edit = window.state().project().edit();
    let tables: Vec<&dyn Params> = edit.rig.tables().into_iter().chain(edit.settings.tables()).collect();
    tables.into_iter().find(|t| t.table() == table).unwrap().get(name).unwrap()
}

#[test]
fn shown_picture_matches_the_composite_command() {
    let mut window = open(None);
    assert!(shown_codes(&window) == written(&[], 0));
    window.state_mut().player_mut().seek(demo_frame(31));
    settle(&mut window);
    let before = shown_codes(&window);
    assert!(before == written(&[], demo_frame(31)));

    search(&mut window, "noise scale");
    window.get_by_role_and_label(Role::Slider, "Noise: Amount").set_value_accesskit(0.0);
    settle(&mut window);
    assert_eq!(value(&window, "noise", "scale"), Value::Number(0.0));
    let quiet = shown_codes(&window);
    assert!(quiet != before && quiet == written(&["noise.scale=0"], demo_frame(31)));

    // Undo and redo.
    window.get_by_label("Undo").click();
    settle(&mut window);
    assert!(shown_codes(&window) == before && value(&window, "noise", "scale") == Value::Number(1.0));
    window.get_by_label("Redo").click();
    settle(&mut window);
    assert!(shown_codes(&window) == quiet);

    // Switching an effect off.
    search(&mut window, "motion_blur");
    window.get_by_role_and_label(Role::CheckBox, "Motion blur").click();
    settle(&mut window);
    assert!(!window.state().project().edit().settings.is_on("motion_blur"));
    assert!(shown_codes(&window) != quiet);
}

#[test]
fn every_parameter_has_one_control() {
    let mut window = open_plain(None);
    search(&mut window, " ");
    let edit = window.state().project().edit().clone();
    let tables: Vec<&dyn Params> = edit.rig.tables().into_iter().chain(edit.settings.tables()).collect();
    let mut names = std::collections::BTreeSet::new();
    for table in tables {
        for spec in table.specs() {
            let full = control_label(&window, table.table(), spec.name);
            assert!(!full.contains('_') && names.insert(full.clone()), "{full}");
            let role = match spec.kind {
                Kind::Bool => Role::CheckBox,
                Kind::Choice(_) => Role::ComboBox,
                Kind::Points | Kind::LensTable => Role::Label,
                Kind::Number { .. } | Kind::Integer { .. } => Role::Slider,
            };
            let has_value = table.get(spec.name) != Some(Value::None);
            let controls = window.query_all_by_role_and_label(role, &full).count();
            assert_eq!(controls, usize::from(has_value), "{full}");
            let boxes = window.query_all_by_role_and_label(Role::CheckBox, &format!("{full} is given")).count();
            assert_eq!(boxes, usize::from(spec.optional), "{full}");
        }
    }
    assert!(names.len() > 50, "{}", names.len());
    // The search finds labels as well as keys.
    for (words, key) in [("f-number", "camera.lens.f_number"), ("focal length", "fx_px"), ("iso noise", "noise.iso")] {
        let (table, name) = match key.rsplit_once('.') {
            Some((table, name)) => (table, name),
            None => ("camera", key),
        };
        let name = control_label(&window, table, name);
        for looked_for in [words, key] {
            search(&mut window, looked_for);
            let matches = window.query_all_by_label_contains(&name).count();
            assert!(matches > 0, "{looked_for}: {name}");
        }
        assert_eq!(window.query_all_by_label_contains("Vignetting").count(), 0);
    }
    search(&mut window, "zebra");
    assert_eq!(window.query_all_by_label("No setting is called “zebra”.").count(), 1);
}

#[test]
fn panel_keeps_its_width() {
    let mut window = open_plain(None);
    let picture = |window: &Harness<'_, App>| window.get_by_role_and_label(Role::Image, "picture").rect();
    let before = picture(&window);
    for (table, name) in [("camera.lens", "f_number"), ("camera.exposure", "time_s"), ("camera.exposure", "iso")] {
        search(&mut window, &format!("{table}.{name}"));
        let name = control_label(&window, table, name);
        if window.query_by_role_and_label(Role::Button, &format!("{name}: stops")).is_none() {
            window.get_by_label(&format!("{name} is given")).click();
            window.run_steps(3);
        }
        // With its stops within the window.
        let stops = window.get_by_role_and_label(Role::Button, &format!("{name}: stops")).rect();
        assert!(stops.right() <= 1400.0 && stops.width() > 40.0, "{name}: {stops:?}");
    }
    assert_eq!(picture(&window), before);
}

#[test]
fn message_disappears_with_the_next_action() {
    let mut window = open_plain(None);
    let set = |window: &mut Harness<'_, App>, scale: f64| {
        window.state_mut().project_mut().set("noise", "scale", &Value::Number(scale)).unwrap();
        window.state_mut().project_mut().close_step();
        window.run_steps(2);
    };
    set(&mut window, 0.5);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    let undone = "Undone: Noise: Amount";
    let is_reported = |window: &Harness<'_, App>| window.query_all_by_label(undone).count() == 1;
    assert!(is_reported(&window));
    // The message stays as long as nothing else is done.
    window.run_steps(60);
    assert!(is_reported(&window));
    set(&mut window, 0.75);
    assert!(!is_reported(&window));
}

#[test]
fn saved_settings_reopen_and_comments_are_kept() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    let text = "# my camera\nversion = 1\n\n[noise]\nscale = 0.5 # quieter\n";
    std::fs::write(&profile, text).unwrap();
    let mut window = open_plain(Some(&profile));
    assert_eq!(window.state().project().origin("noise", "scale"), Origin::File);
    assert_eq!(window.state().project().origin("noise", "magnification"), Origin::Default);

    search(&mut window, "noise scale");
    window.get_by_role_and_label(Role::Slider, "Noise: Amount").set_value_accesskit(0.75);
    window.run_steps(2);
    search(&mut window, "focus_distance");
    window.get_by_role_and_label(Role::CheckBox, "Camera: lens: Focus distance is given").click();
    settle(&mut window);
    let project = window.state().project();
    assert!(!project.is_saved() && project.origin("noise", "scale") == Origin::User);
    window.state_mut().project_mut().save_profile(&profile).unwrap();
    assert!(window.state().project().is_saved());
    let saved = std::fs::read_to_string(&profile).unwrap();
    let expected = text.replace("0.5 #", "0.75 #") + "\n[camera.lens]\nfocus_distance_m = 1.0\n";
    assert_eq!(saved, expected);

    let again = Project::open(&demo(), &OpenOptions::default(), &plain(Some(&profile))).unwrap();
    assert!(again.edit() == window.state().project().edit());
}

#[test]
fn wipe_and_held_key_show_the_footage() {
    let mut window = open_plain(None);
    window.key_press(Key::W);
    window.step();
    assert_eq!(window.state().view().wipe, Some(0.5));
    let picture = window.get_by_role_and_label(Role::Image, "picture").rect();
    window.drag_at(picture.center());
    window.step();
    window.hover_at(picture.left_center());
    window.run_steps(2);
    window.drop_at(picture.left_center());
    window.step();
    assert_eq!(window.state().view().wipe, Some(0.0));
    // All of it is right of the wipe's line, on the side of the footage, which is unmodified bit
    // for bit.
    let viewer = window.state().viewer();
    let plain = gpu::read_back(viewer.gpu(), &viewer.camera().unwrap().texture);
    let frame = window.state().project().shot().read(0).unwrap();
    assert!(plain.into_iter().map(|[r, g, b, _]| [r, g, b]).eq(codes(&frame.pixels)));
    window.key_down(Key::Backslash);
    window.step();
    assert!(window.state().view().plain);
    window.key_up(Key::Backslash);
    window.step();
    assert!(!window.state().view().plain);
}

#[test]
fn parameters_made_inactive_by_another_are_marked() {
    let mut window = open_plain(None);
    search(&mut window, "noise");
    let inactive = |window: &Harness<'_, App>| window.query_all_by_label("inactive").count();
    let before = inactive(&window);
    for (scale, more) in [(0.0, 2), (1.0, 0)] {
        window.state_mut().project_mut().set("noise", "scale", &Value::Number(scale)).unwrap();
        window.state_mut().project_mut().close_step();
        settle(&mut window);
        let count = inactive(&window);
        assert!(count >= before + more && (more > 0 || count == before), "{scale}: {count}");
    }
}

#[test]
fn invalid_settings_are_reported_until_corrected() {
    let mut window = open(None);
    let before = shown_codes(&window);
    // One blade is within the range, but makes no aperture.
    for (name, number) in [("f_number", 2.0), ("focus_distance_m", 1.0), ("blades", 1.0)] {
        window.state_mut().project_mut().set("camera.lens", name, &Value::Number(number)).unwrap();
        window.state_mut().project_mut().close_step();
    }
    run_until(&mut window, |app| app.problem().is_some());
    let problem = window.state().problem().unwrap().to_owned();
    assert!(problem.contains("camera.lens.blades = 1"), "{problem}");
    assert_eq!(window.query_all_by_label(&problem).count(), 1);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.step();
    settle(&mut window);
    assert!(shown_codes(&window) != before);
    // A value beyond the range changes nothing.
    let edit = window.state().project().edit().clone();
    assert!(window.state_mut().project_mut().set("noise", "scale", &Value::Number(99.0)).is_err());
    assert!(window.state().project().edit() == &edit);
}

#[test]
fn click_places_evidence_on_the_visible_surface() {
    let temp = tempfile::tempdir().unwrap();
    let scene = temp.path().join("scene.toml");
    let text = "# mine\nversion = 1\nup = \"z\"\n";
    std::fs::write(&scene, text).unwrap();
    let options = ShotOptions { scene: Some(scene.clone()), ..ShotOptions::default() };
    let project = Project::open(&demo(), &OpenOptions::default(), &options).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 900.0));
    window.state_mut().player_mut().seek(demo_frame(30));
    settle(&mut window);
    let empty = shown_codes(&window);

    window.get_by_label("Place…").click();
    window.run_steps(3);
    window.get_by_label("marker-1").click();
    window.run_steps(3);
    let at = window.state().on_screen(demo_px(320.0, 300.0)).unwrap();
    window.hover_at(at);
    window.step();
    window.drag_at(at);
    window.step();
    window.drop_at(at);
    settle(&mut window);
    let objects = window.state().project().edit().scene.objects.clone();
    assert_eq!(objects.len(), 1);
    // The floor is z = 0, and the pixel's ray meets it at this point (`locard inspect --pick
    // 320,300 --plane 0,0,1,0`).
    let position = objects[0].position_m.unwrap();
    for (found, expected) in position.into_iter().zip([0.1046, -0.0958, 0.0]) {
        assert!((found - expected).abs() < 1e-3, "{position:?}");
    }
    assert!(shown_codes(&window) != empty);

    // It is saved into the scene file, whose comment is kept, and undone.
    window.key_press(Key::Escape);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    run_until(&mut window, |app| app.project().is_saved());
    let saved = std::fs::read_to_string(&scene).unwrap();
    assert!(saved.starts_with(text) && saved.contains("marker-1.glb"), "{saved}");
    let again = Project::open(&demo(), &OpenOptions::default(), &options).unwrap();
    assert!(again.edit().scene == window.state().project().edit().scene);
    window.get_by_label("Undo").click();
    settle(&mut window);
    assert!(shown_codes(&window) == empty);
}

#[test]
fn closing_asks_before_changes_are_lost() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    std::fs::write(&profile, "version = 1\n").unwrap();
    let mut window = open_plain(Some(&profile));
    let close = |window: &mut Harness<'_, App>| {
        let id = window.input().viewport_id;
        window.input_mut().viewports.get_mut(&id).unwrap().events.push(egui::ViewportEvent::Close);
        window.run_steps(2);
    };
    close(&mut window);
    assert_eq!(window.query_all_by_label("Save and close").count(), 0, "nothing has been changed");
    window.state_mut().project_mut().set("point_spread", "sigma_px", &Value::Number(0.5)).unwrap();
    close(&mut window);
    window.get_by_label("Cancel").click();
    window.run_steps(2);
    assert_eq!(window.query_all_by_label("Save and close").count(), 0);
    close(&mut window);
    window.get_by_label("Save and close").click();
    window.run_steps(3);
    window.get_by_label("Save to the profile").click();
    run_until(&mut window, |app| app.project().is_saved());
    assert!(std::fs::read_to_string(&profile).unwrap().contains("sigma_px = 0.5"));
}

#[test]
fn damaged_frame_is_reported_and_the_others_shown() {
    let temp = tempfile::tempdir().unwrap();
    program::with_a_truncated_frame(temp.path());
    let options = ShotOptions { profile: Some("profiles/simulated.toml".into()), ..ShotOptions::default() };
    let project = Project::open(temp.path(), &OpenOptions::default(), &options).unwrap();
    let mut window = window(project, egui::vec2(1000.0, 700.0));
    window.state_mut().player_mut().seek(3);
    run_until(&mut window, |app| app.problem().is_some());
    assert!(window.state().problem().unwrap().contains("00003.jpg"));
    window.state_mut().player_mut().seek(2);
    run_until(&mut window, App::is_settled);
    assert!(window.state().is_settled() && window.state().problem().is_none());
}

#[test]
fn playback_stops_at_the_shown_frame() {
    let mut window = open(None);
    window.key_press(Key::Space);
    run_until(&mut window, |app| app.player().frame() > 0);
    window.key_press(Key::Space);
    settle(&mut window);
    let frame = window.state_mut().player_mut().frame();
    assert!(frame > 0 && shown_codes(&window) == written(&[], frame), "frame {frame}");
    window.get_by_label("One frame on").click();
    settle(&mut window);
    assert_eq!(window.state_mut().player_mut().frame(), frame + 1);
}

#[test]
fn two_sets_of_settings_are_compared_and_copied() {
    let mut window = open(None);
    let a = shown_codes(&window);
    window.key_press(Key::B);
    window.step();
    window.state_mut().project_mut().set("noise", "scale", &Value::Number(0.0)).unwrap();
    run_until(&mut window, |app| app.is_settled() && app.viewer().comparison().is_some());
    // B is edited, and A is unchanged.
    let other = |window: &Harness<'_, App>| {
        let viewer = window.state().viewer();
        let texels = gpu::read_back(viewer.gpu(), &viewer.comparison().unwrap().texture);
        texels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect::<Vec<_>>()
    };
    let b = shown_codes(&window);
    assert!(b == written(&["noise.scale=0"], 0) && other(&window) == a);
    window.key_press_modifiers(Modifiers::SHIFT, Key::B);
    window.step();
    run_until(&mut window, App::is_settled);
    assert!(
        shown_codes(&window) == a && window.state().project().edit().other.as_ref().is_some_and(|other| !other.is_a)
    );
    window.get_by_label("A to B").click();
    window.run_steps(2);
    let other = window.state().project().edit().other.clone().unwrap();
    assert!(other.settings == window.state().project().edit().settings);
    // Undo restores B, and the inactive set does not count as unsaved.
    window.get_by_label("Undo").click();
    window.run_steps(2);
    let other = window.state().project().edit().other.clone().unwrap();
    assert!(other.settings != window.state().project().edit().settings && window.state().project().is_saved());
}

#[test]
fn timeline_seeks_anywhere_and_plays_its_loop() {
    let mut window = open_plain(None);
    let strip = window.get_by_role_and_label(Role::Slider, "Frame").rect();
    window.hover_at(strip.center());
    window.step();
    window.drag_at(strip.center());
    window.step();
    window.drop_at(strip.center());
    window.step();
    settle(&mut window);
    let middle = demo_frame(36);
    assert_eq!(window.state_mut().player_mut().frame(), middle);
    window.key_press(Key::I);
    window.step();
    window.key_press_modifiers(Modifiers::SHIFT, Key::ArrowRight);
    window.step();
    window.key_press(Key::O);
    window.step();
    assert_eq!(window.state_mut().player_mut().range(), middle..middle + 11);
    window.key_press_modifiers(Modifiers::SHIFT, Key::I);
    window.step();
    assert_eq!(window.state_mut().player_mut().range(), 0..demo_frame(72));
}

#[test]
fn typed_number_takes_effect_when_complete() {
    let mut window = open_plain(None);
    search(&mut window, "noise scale");
    let scale = |window: &Harness<'_, App>| {
        let settings = &window.state().project().edit().settings;
        settings.effects().find(|effect| effect.table() == "noise").unwrap().get("scale").unwrap()
    };
    let before = scale(&window);
    let field = |window: &Harness<'_, App>| {
        let all: Vec<_> = window.query_all_by_role(Role::SpinButton).map(|node| node.rect()).collect();
        assert_eq!(all.len(), 1, "one field beside one slider");
        all[0].center()
    };
    let at = field(&window);
    window.hover_at(at);
    window.step();
    window.drag_at(at);
    window.drop_at(at);
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text("0.25".to_owned()));
    window.run_steps(3);
    assert_eq!(scale(&window), before, "half a number is none");
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert_eq!(scale(&window), Value::Number(0.25));
}
