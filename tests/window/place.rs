//! Placement in the window: on a plane through three points, hidden objects, and misplaced ones.

use std::path::Path;

use crate::harness::{
    click_at, demo_frame, demo_px, demo_window, drop_model, press_key, run_until, settle, shown_codes, wait_for,
};
use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::{DVec2, DVec3};
use locard::scene::{Entry, SceneItem};
use locard::window::App;

/// The frame of all these tests.
fn frame() -> usize {
    demo_frame(30)
}

fn open() -> Harness<'static, App> {
    open_with(&[])
}

fn open_without_shadows() -> Harness<'static, App> {
    open_with(&["shadow.cast=false"])
}

fn open_with(sets: &[&str]) -> Harness<'static, App> {
    let mut window = demo_window(sets, egui::vec2(1400.0, 900.0));
    window.state_mut().player_mut().seek(frame());
    settle(&mut window);
    window
}

/// Clicks at the projection of a world point.
fn click(window: &mut Harness<'_, App>, point_m: [f64; 3]) {
    let px = window.state().project().shot().posed_camera(frame()).unwrap().project(point_m.into()).unwrap();
    let at = window.state().on_screen(egui::vec2(px.x as f32, px.y as f32)).unwrap();
    click_at(window, at);
}

#[test]
fn object_is_placed_by_keys_alone() {
    let mut window = open();
    drop_model(&mut window, Path::new("scenes/marker-1.glb").canonicalize().unwrap());
    window.run_steps(2);
    let before = window.state().project().edit().scene.objects.len();
    // From the middle: two steps of 16 px to the right, one of a pixel down.
    let middle = 0.5 * demo_px(640.0, 480.0);
    let at_px = DVec2::new(f64::from(middle.x) + 32.0, f64::from(middle.y) + 1.0);
    for _ in 0..2 {
        window.key_press(Key::ArrowRight);
        window.step();
    }
    window.key_press_modifiers(Modifiers::SHIFT, Key::ArrowDown);
    window.step();
    assert_eq!(window.state().player().frame(), frame(), "no frame further");
    window.key_press(Key::Enter);
    window.run_steps(2);
    let objects = &window.state().project().edit().scene.objects;
    assert_eq!(objects.len(), before + 1);
    let at_m = DVec3::from_array(objects[before].position_m.unwrap());
    let (shot, frame) = (window.state().project().shot(), window.state().project().shot().read(frame()).unwrap());
    let there = shot.surface_at(&frame, at_px).unwrap().plane.point_m;
    assert!(at_m.distance(there) < 1e-3, "{at_m} {there}");
}

#[test]
fn object_is_rotated_by_dragging_from_its_position() {
    let mut window = open();
    drop_model(&mut window, Path::new("scenes/marker-3.glb").canonicalize().unwrap());
    window.run_steps(2);
    let (objects, steps) =
        (window.state().project().edit().scene.objects.len(), window.state().project().history().names().0.count());
    let on_screen = |window: &Harness<'_, App>, point_m: [f64; 3]| {
        let px = window.state().project().shot().posed_camera(frame()).unwrap().project(point_m.into()).unwrap();
        window.state().on_screen(egui::vec2(px.x as f32, px.y as f32)).unwrap()
    };
    let (at_m, towards_m) = ([0.1, -0.2, 0.0], [0.25, -0.05, 0.0]);
    let (from, to) = (on_screen(&window, at_m), on_screen(&window, towards_m));
    window.hover_at(from);
    window.step();
    window.drag_at(from);
    for share in [0.1, 0.4, 0.7, 1.0, 1.0] {
        window.hover_at(from + (to - from) * share);
        window.step();
    }
    window.drop_at(to);
    window.run_steps(2);
    let edit = window.state().project().edit();
    assert_eq!(
        (edit.scene.objects.len(), window.state().project().history().names().0.count()),
        (objects + 1, steps + 1)
    );
    let placed = DVec3::from(edit.scene.objects[objects].position_m.unwrap());
    assert!(placed.distance(at_m.into()) < 5e-3, "{placed}");
    // Its front points along the drag, within the depth's noise and whole degrees.
    let front = faces(&window, Entry { object: objects, instance: None });
    let along = (DVec3::from(towards_m) - DVec3::from(at_m)).truncate();
    assert!(front.angle_to(along).to_degrees().abs() < 3.0, "{front} {along}");
}

#[test]
fn transform_interrupts_a_placement_which_then_continues() {
    let mut window = open_without_shadows();
    drop_model(&mut window, Path::new("scenes/marker-3.glb").canonicalize().unwrap());
    window.run_steps(2);
    let count = |window: &Harness<'_, App>| window.state().project().edit().scene.objects.len();
    let before = count(&window);
    click(&mut window, [0.1, -0.2, 0.0]);
    assert_eq!(count(&window), before + 1);
    // The placed object is moved. The click that ends the transform places nothing.
    press_key(&mut window, Key::G);
    click(&mut window, [0.25, -0.05, 0.0]);
    assert_eq!(count(&window), before + 1);
    click(&mut window, [-0.1, 0.1, 0.0]);
    assert_eq!(count(&window), before + 2);
}

#[test]
fn typed_name_is_one_undo_step() {
    let mut window = open_without_shadows();
    let names =
        |window: &Harness<'_, App>| window.state().project().history().names().0.map(str::to_owned).collect::<Vec<_>>();
    let title = |window: &Harness<'_, App>| {
        let scene = &window.state().project().edit().scene;
        scene.title(Entry { object: 0, instance: scene.entries()[0].instance })
    };
    let before = title(&window);
    window.get_by_role_and_label(Role::Button, &before).click();
    window.run_steps(2);
    let steps = names(&window).len();
    for (new, more) in [("Beweis 1", 1), ("2", 2)] {
        window.get_by_role_and_label(Role::TextInput, "Name").focus();
        window.step();
        window.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
        window.step();
        // An emptied name does not fall back to the model's.
        window.key_press(egui::Key::Backspace);
        window.step();
        for letter in new.chars() {
            window.get_by_role_and_label(Role::TextInput, "Name").type_text(&letter.to_string());
            window.step();
        }
        assert_eq!(title(&window), new);
        window.key_press(egui::Key::Enter);
        window.run_steps(2);
        let all = names(&window);
        assert_eq!(all.len(), steps + more, "{all:?}");
    }
    assert_eq!(names(&window)[steps..], [format!("{before}: renamed"), "Beweis 1: renamed".to_owned()]);
    window.state_mut().project_mut().undo();
    window.run_steps(2);
    assert_eq!(title(&window), "Beweis 1");
}

#[test]
fn three_points_define_a_plane_on_which_objects_rest() {
    let mut window = open_without_shadows();
    window.get_by_label("Define plane…").click();
    window.run_steps(2);
    // The floor is z = 0, and the depth has a noise of 1.5 mm.
    for point_m in [[-0.4, -0.3, 0.0], [0.3, -0.4, 0.0], [-0.1, 0.5, 0.0]] {
        click(&mut window, point_m);
    }
    window.get_by_label("on a plane");
    let before = window.state().project().edit().scene.objects.len();
    window.get_by_label("Place…").click();
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, "marker-3").click();
    window.run_steps(2);
    click(&mut window, [0.1, -0.2, 0.0]);
    let objects = &window.state().project().edit().scene.objects;
    assert_eq!(objects.len(), before + 1);
    let position_m = objects[before].position_m.unwrap();
    for (found, expected) in position_m.into_iter().zip([0.1, -0.2, 0.0]) {
        assert!((found - expected).abs() < 4e-3, "{position_m:?}");
    }
    settle(&mut window);
}

/// Horizontal direction of an object's front: a marker faces −y, turned by its heading
/// counter-clockwise as seen from above.
fn faces(window: &Harness<'_, App>, entry: Entry) -> DVec2 {
    let heading_deg = window.state().project().edit().scene.heading_deg(entry, DVec3::Z).unwrap();
    DVec2::from_angle((heading_deg - 90.0).to_radians())
}

#[test]
fn placed_object_faces_the_camera_and_its_heading_is_the_full_rotation() {
    let mut window = open_without_shadows();
    // The first marker is turned by its rotation: its heading includes that, and is edited from
    // there.
    let marker = Entry { object: 0, instance: None };
    window.get_by_label("marker 1").click();
    window.run_steps(3);
    let heading = |window: &Harness<'_, App>| {
        window.get_by_role_and_label(Role::Slider, "heading").accesskit_node().numeric_value().unwrap()
    };
    assert!((heading(&window) - 12.0).abs() < 1e-9, "{}", heading(&window));
    window.get_by_role_and_label(Role::Slider, "heading").set_value_accesskit(40.0);
    window.run_steps(3);
    let placed = window.state().project().edit().scene.objects[0].clone();
    assert_eq!((placed.rotation_deg, placed.heading_deg), (Some([0.0, 0.0, 12.0]), Some(28.0)));
    assert!(faces(&window, marker).abs_diff_eq(DVec2::from_angle((-50.0f64).to_radians()), 1e-9));

    window.get_by_label("Place…").click();
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, "marker-3").click();
    window.run_steps(2);
    for point_m in [[0.1, -0.2, 0.0], [-0.3, -0.3, 0.0]] {
        click(&mut window, point_m);
        let Some(SceneItem::Object(entry)) = window.state().selected() else { panic!() };
        let to_camera =
            window.state().project().shot().posed_camera(frame()).unwrap().position_m() - DVec3::from(point_m);
        let off = faces(&window, entry).dot(to_camera.truncate().normalize());
        // The depth is noisy, and the heading is rounded to a tenth of a degree.
        assert!(off > 0.9999, "{point_m:?}: {off}");
    }
    settle(&mut window);
}

#[test]
fn misplaced_objects_are_reported_and_hidden_ones_not_drawn() {
    let mut window = open();
    let before = shown_codes(&window);
    let issue_count = |window: &Harness<'_, App>| window.query_all_by_label_contains("placement fault").count();
    // The check runs on another thread.
    let twice = window.state().project().edit().scene.objects[0].clone();
    let name = twice.name.clone().unwrap();
    let add = |scene: &mut locard::scene::SceneFile| scene.objects.push(twice);
    window.state_mut().project_mut().change_scene("twice", add).unwrap();
    settle(&mut window);
    wait_for(&mut window, "each of the two", |window| issue_count(window) == 2);
    // First the older object is hidden, then the other too.
    let boxes = format!("{name}: shown");
    window.get_all_by_label(&boxes).next().unwrap().click();
    window.run_steps(2);
    settle(&mut window);
    let first = Entry { object: 0, instance: None };
    assert!(window.state().project().edit().scene.is_hidden(first));
    assert!(shown_codes(&window) == before, "one of two in one place");
    window.get_all_by_label(&boxes).last().unwrap().click();
    window.run_steps(2);
    settle(&mut window);
    assert!(shown_codes(&window) != before);
    window.state_mut().project_mut().undo();
    window.state_mut().project_mut().undo();
    run_until(&mut window, App::is_settled);
    assert!(!window.state().project().edit().scene.is_hidden(first));
}

// Slow: the shadows are computed anew for each of five pictures.
#[test]
fn object_shadow_is_switched_off_and_object_becomes_a_stand_in() {
    let mut window = open_with(&["shadow.cast=true"]);
    let first = Entry { object: 0, instance: None };
    click(&mut window, [0.0, 0.12, 0.03]);
    assert_eq!(window.state().selected(), Some(first.into()));
    let with_both = shown_codes(&window);
    let state = |window: &Harness<'_, App>| {
        let scene = &window.state().project().edit().scene;
        (scene.is_shadowless(first), scene.is_occluder(first))
    };
    let press = |window: &mut Harness<'_, App>, label: &str| {
        window.get_by_label(label).click();
        window.run_steps(2);
        settle(window);
    };
    press(&mut window, "Casts a shadow");
    assert_eq!(state(&window), (true, false));
    let bare = shown_codes(&window);
    assert!(bare != with_both);
    press(&mut window, "Occluder (invisible, hides what is behind it)");
    assert_eq!(state(&window), (true, true));
    let drawn = |window: &Harness<'_, App>| !window.state().project().shot().scene.objects[0].parts.is_empty();
    assert!(!drawn(&window) && shown_codes(&window) != bare);
    // One step each, and back to the same picture.
    press(&mut window, "Occluder (invisible, hides what is behind it)");
    press(&mut window, "Casts a shadow");
    assert!(drawn(&window) && shown_codes(&window) == with_both);
    let history: Vec<_> = window.state().project().history().names().0.map(str::to_owned).collect();
    let steps = ["without its shadow", "occluder", "evidence", "with its shadow"];
    assert!(steps.iter().all(|steps| history.contains(&format!("marker 1: {steps}"))), "{history:?}");
}
