//! Objects in the picture of the window: picked, moved, rotated and scaled.

use crate::gpu;
use crate::harness::{
    click_at, codes, demo_window, press_and_move, press_key, release_at, settle, shown_codes, steps, type_text,
};
use eframe::egui::{self, Event, Key, Modifiers, Pos2, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{DVec2, DVec3};
use locard::compositor::Target;
use locard::scene::{Entry, ItemPlacement, SceneItem, Size};
use locard::shot::Shot;
use locard::window::App;

const MARKER: SceneItem = SceneItem::Object(Entry { object: 0, instance: None });
const CASE: SceneItem = SceneItem::Object(Entry { object: 2, instance: Some(0) });
/// Position in the demonstration's scene.
const MARKER_AT: [f64; 3] = [0.0, 0.12, 0.0];

fn open(frame: usize) -> Harness<'static, App> {
    let mut window = demo_window(&["shadow.cast=false"], egui::vec2(1400.0, 900.0));
    window.state_mut().player_mut().seek(frame);
    settle(&mut window);
    window
}

/// Screen position of a world point.
fn at(window: &Harness<'_, App>, frame: usize, point_m: [f64; 3]) -> Pos2 {
    let px = window.state().project().shot().posed_camera(frame).unwrap().project(point_m.into()).unwrap();
    window.state().on_screen(egui::vec2(px.x as f32, px.y as f32)).unwrap()
}

/// Drags in small steps and releases the button.
fn drag(window: &mut Harness<'_, App>, from: Pos2, to: Pos2) {
    press_and_move(window, from, to);
    release_at(window, to);
}

fn placement(window: &Harness<'_, App>, thing: SceneItem) -> ItemPlacement {
    window.state().project().edit().scene.placement(thing).unwrap()
}

/// The marker, selected by a click on its front.
fn with_marker(frame: usize) -> Harness<'static, App> {
    let mut window = open(frame);
    let on_marker = at(&window, frame, [0.0, 0.12, 0.03]);
    click_at(&mut window, on_marker);
    assert_eq!(window.state().selected(), Some(MARKER));
    window
}

#[test]
fn click_selects_the_visible_object_and_the_list_shows_it() {
    let mut window = open(0);
    assert_eq!(window.state().selected(), None);
    let on_marker = at(&window, 0, [0.0, 0.12, 0.03]);
    click_at(&mut window, on_marker);
    assert_eq!(window.state().selected(), Some(MARKER));
    // Its values are on the left, as sliders in the accessibility tree.
    let y = window.get_by_role_and_label(Role::Slider, "position y");
    assert!(y.value().is_some_and(|text| text.starts_with("0.12")), "{:?}", y.value());
    // One of three instances of a model is an item of its own; a click beside all objects selects
    // none.
    let on_case = at(&window, 0, [0.03, -0.05, 0.005]);
    let name = window.state().project().edit().scene.title(CASE);
    window.get_by_label(&name).click();
    window.run_steps(2);
    assert_eq!(window.state().selected(), Some(CASE));
    press_key(&mut window, Key::Escape);
    let beside = at(&window, 0, [-0.4, 0.4, 0.0]);
    click_at(&mut window, beside);
    assert_eq!(window.state().selected(), None);
    click_at(&mut window, on_case);
    assert_eq!(window.state().selected(), Some(CASE));
    assert_eq!(steps(&window).len(), 1, "looking changes nothing");
}

#[test]
fn keys_between_two_frames_are_all_processed() {
    let mut window = with_marker(0);
    let text = |text: &str| Event::Text(text.to_owned());
    let key = |key: Key, pressed: bool| Event::Key {
        key,
        physical_key: None,
        pressed,
        repeat: false,
        modifiers: Modifiers::NONE,
    };
    let typed = |is: Key, letter: &str| [key(is, true), text(letter), key(is, false)];
    let pressed = |is: Key| [key(is, true), key(is, false)];
    // Twice, followed by a key of the window.
    for _ in 0..2 {
        let letters = [(Key::G, "g"), (Key::X, "x"), (Key::Num1, "1"), (Key::C, "c"), (Key::M, "m")];
        window.input_mut().events.extend(letters.into_iter().flat_map(|(is, letter)| typed(is, letter)));
        window.input_mut().events.extend(pressed(Key::Enter));
    }
    window.input_mut().events.extend(pressed(Key::W));
    window.run_steps(5);
    assert!(placement(&window, MARKER).position_m.abs_diff_eq(DVec3::from(MARKER_AT) + 0.02 * DVec3::X, 1e-12));
    assert_eq!(window.state().view().zoom, None, "the digit is no zoom");
    assert_eq!(steps(&window), ["opened", "marker 1: moved 1 cm", "marker 1: moved 1 cm"]);
    assert!(window.state().view().wipe.is_some(), "the last key is the window's");
    // A scale of 0 or less is ignored: the pointer takes over.
    press_key(&mut window, Key::S);
    type_text(&mut window, "-1");
    press_key(&mut window, Key::Enter);
    assert!(matches!(placement(&window, MARKER).size, Size::Scale(factor) if factor.min_element() > 0.0));
    // Esc first cancels the current action, then clears the selection.
    press_key(&mut window, Key::G);
    press_key(&mut window, Key::Escape);
    assert_eq!(window.state().selected(), Some(MARKER));
    press_key(&mut window, Key::Escape);
    assert_eq!(window.state().selected(), None);
}

#[test]
fn typed_numbers_move_rotate_and_scale_exactly_in_one_step_each() {
    let mut window = with_marker(0);
    let before = placement(&window, MARKER);
    let first = shown_codes(&window);
    press_key(&mut window, Key::G);
    press_key(&mut window, Key::X);
    type_text(&mut window, "0,1");
    window.run_steps(2);
    assert_eq!(placement(&window, MARKER).position_m, DVec3::from(MARKER_AT) + 0.1 * DVec3::X);
    assert_eq!(steps(&window).len(), 1, "it is no step yet");
    // During an action the window's keys are inactive: 1 is a digit, not a zoom.
    assert_eq!(window.state().view().zoom, None);
    press_key(&mut window, Key::Enter);
    settle(&mut window);
    let moved = shown_codes(&window);
    assert!(moved != first);
    let heading = placement(&window, MARKER).heading_deg;
    press_key(&mut window, Key::R);
    type_text(&mut window, "45");
    press_key(&mut window, Key::Enter);
    assert_eq!(placement(&window, MARKER).heading_deg, heading + 45.0);
    press_key(&mut window, Key::S);
    type_text(&mut window, "150%");
    press_key(&mut window, Key::Enter);
    assert_eq!(placement(&window, MARKER).size, Size::Scale(DVec3::splat(1.5)));
    let names = ["opened", "marker 1: moved 10 cm", "marker 1: turned 45°", "marker 1: scaled to 150 %"];
    assert_eq!(steps(&window), names);
    // The picture matches a composite of the scene file.
    settle(&mut window);
    let shot: Shot = window.state().project().shot().clone();
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let pending = shot.picture(&mut compositor, 0, Target::Pixels).unwrap();
    assert!(shown_codes(&window) == codes(&compositor.collect(pending).unwrap().pixels));

    for _ in 0..2 {
        window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
        window.step();
    }
    settle(&mut window);
    assert!(shown_codes(&window) == moved);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.step();
    settle(&mut window);
    assert!(shown_codes(&window) == first && placement(&window, MARKER) == before);
}

#[test]
fn dragged_object_stays_on_the_surface() {
    let mut window = with_marker(0);
    let from = at(&window, 0, [0.0, 0.12, 0.03]);
    // The pointer holds a point above the object's foot, so the object keeps that offset.
    let (stood, stands) = (at(&window, 0, MARKER_AT), at(&window, 0, [-0.1, 0.2, 0.0]));
    let to = from + (stands - stood);
    press_and_move(&mut window, from, to);
    settle(&mut window);
    assert_eq!(steps(&window).len(), 1, "as long as it is held it is no step");
    window.drop_at(to);
    window.run_steps(2);
    let position = placement(&window, MARKER).position_m;
    // The floor is z = 0; the sensor's noise is 1.5 mm, and the plane is fitted to a thousand of
    // its depths.
    assert!(position.abs_diff_eq(DVec3::new(-0.1, 0.2, 0.0), 2e-3), "{position}");
    let names = steps(&window);
    assert!(names.len() == 2 && names[1].starts_with("marker 1: moved 12.") && names[1].ends_with(" cm"), "{names:?}");
    assert_eq!(window.state().selected(), Some(MARKER), "letting go is no click");
    // From there, level and in whole centimetres.
    let (from, to) = (at(&window, 0, [-0.1, 0.2, 0.03]), at(&window, 0, [0.003, 0.154, 0.03]));
    window.event(Event::ModifiersChanged(Modifiers::COMMAND | Modifiers::SHIFT));
    drag(&mut window, from, to);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    let by = placement(&window, MARKER).position_m - position;
    assert!((by * 100.0 - (by * 100.0).round()).abs().max_element() < 1e-6 && by.z == 0.0 && by.x > 0.05, "{by}");
}

#[test]
fn escape_and_right_button_cancel_without_changes() {
    let mut window = with_marker(0);
    let (before, first) = (window.state().project().edit().clone(), shown_codes(&window));
    // An undone step can still be redone.
    press_key(&mut window, Key::G);
    type_text(&mut window, "0.02");
    press_key(&mut window, Key::Enter);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    for key in [Key::G, Key::R, Key::S] {
        press_key(&mut window, key);
        type_text(&mut window, "0.5");
        settle(&mut window);
        assert!(window.state().project().edit() != &before);
        press_key(&mut window, Key::Escape);
        assert!(window.state().project().edit() == &before);
    }
    let from = at(&window, 0, [0.0, 0.12, 0.03]);
    press_and_move(&mut window, from, from + egui::vec2(80.0, 30.0));
    assert!(window.state().project().edit() != &before);
    window.event(Event::PointerButton {
        pos: from,
        button: egui::PointerButton::Secondary,
        pressed: true,
        modifiers: Modifiers::NONE,
    });
    window.step();
    window.drop_at(from);
    window.run_steps(2);
    assert!(window.state().project().edit() == &before);
    // Escape removes the copy.
    window.key_press_modifiers(Modifiers::SHIFT, Key::D);
    window.run_steps(2);
    assert_eq!(window.state().project().edit().scene.objects.len(), before.scene.objects.len() + 1);
    press_key(&mut window, Key::Escape);
    assert!(window.state().project().edit() == &before && window.state().selected() == Some(MARKER));
    settle(&mut window);
    assert!(shown_codes(&window) == first && window.state().project().history().can_redo());
}

#[test]
fn instance_moves_alone_and_is_saved_to_its_own_entry() {
    let mut window = open(0);
    let on_case = at(&window, 0, [0.03, -0.05, 0.005]);
    click_at(&mut window, on_case);
    assert_eq!(window.state().selected(), Some(CASE));
    press_key(&mut window, Key::G);
    press_key(&mut window, Key::Y);
    type_text(&mut window, "-2cm");
    press_key(&mut window, Key::Enter);
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    window.state_mut().project_mut().save_scene(&file).unwrap();
    let expected = std::fs::read_to_string("scenes/demo.toml").unwrap();
    let expected = expected.replace("position_m = [0.03, -0.05, 0.0]", "position_m = [0.03, -0.07, 0.0]");
    // In another folder it names the same models.
    let scenes = std::fs::canonicalize("scenes").unwrap().display().to_string();
    let expected = ["model", "environment"]
        .into_iter()
        .fold(expected, |text, key| text.replace(&format!("{key} = \""), &format!("{key} = \"{scenes}/")));
    let expected = expected.replace("scenes/../", "");
    // By relative names if both are in a folder with a relative name.
    let resolved = |line: &str| match line.split_once(" = \"") {
        Some((key @ ("model" | "environment"), name)) => {
            let place = temp.path().join(name.trim_end_matches('"')).canonicalize().unwrap();
            format!("{key} = \"{}\"\n", place.display())
        }
        _ => format!("{line}\n"),
    };
    let written: String = std::fs::read_to_string(&file).unwrap().lines().map(resolved).collect();
    assert_eq!(written, expected);
}

#[test]
fn handles_move_along_their_axis_rotate_and_scale() {
    let mut window = with_marker(0);
    let centre = at(&window, 0, MARKER_AT);
    // The arrow of z starts above the marker, which is 107 mm high.
    let up = at(&window, 0, [0.0, 0.12, 0.107]) - egui::vec2(0.0, 30.0);
    drag(&mut window, up, up - egui::vec2(0.0, 60.0));
    let position = placement(&window, MARKER).position_m;
    assert!(position.x == 0.0 && position.y == 0.12 && position.z > 0.02, "{position}");
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    // The scale handle is at the upper right; twice the distance doubles the size.
    let size = egui::vec2(68.0, -68.0);
    drag(&mut window, centre + size, centre + 2.0 * size);
    assert_eq!(placement(&window, MARKER).size, Size::Scale(DVec3::splat(2.0)));
    let names = steps(&window);
    assert_eq!(names.last().unwrap(), "marker 1: scaled to 200 %");
    // Ctrl rotates in steps of 5°.
    press_key(&mut window, Key::R);
    window.hover_at(centre + egui::vec2(100.0, 0.0));
    window.step();
    press_key(&mut window, Key::Escape);
    press_key(&mut window, Key::R);
    window.event(Event::ModifiersChanged(Modifiers::COMMAND));
    let turned = DVec2::from_angle((-42.0f64).to_radians()) * 100.0;
    window.hover_at(centre + egui::vec2(turned.x as f32, turned.y as f32));
    window.run_steps(2);
    window.event(Event::Key {
        key: Key::Enter,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers: Modifiers::COMMAND,
    });
    window.run_steps(2);
    assert_eq!(placement(&window, MARKER).heading_deg, 40.0);
}

#[test]
fn keys_nudge_copy_and_delete_objects() {
    let mut window = with_marker(0);
    for _ in 0..3 {
        window.key_press_modifiers(Modifiers::ALT, Key::ArrowRight);
        window.step();
    }
    let by = placement(&window, MARKER).position_m - DVec3::from(MARKER_AT);
    assert!((by.length() - 3e-3).abs() < 1e-9 && by.abs().max_element() > 2.9e-3, "{by}");
    assert_eq!(steps(&window).len(), 2);
    press_key(&mut window, Key::H);
    assert!(window.state().project().edit().scene.objects[0].hidden);
    // Hidden objects cannot be moved.
    press_key(&mut window, Key::G);
    press_key(&mut window, Key::H);
    assert!(!window.state().project().edit().scene.objects[0].hidden);
    let count = window.state().project().edit().scene.objects.len();
    window.key_press_modifiers(Modifiers::SHIFT, Key::D);
    window.run_steps(2);
    press_key(&mut window, Key::Y);
    type_text(&mut window, "-0,2");
    press_key(&mut window, Key::Enter);
    let copy = window.state().selected().unwrap();
    assert_eq!(window.state().project().edit().scene.title(copy), "marker 1 copy");
    assert!((placement(&window, copy).position_m.y - MARKER_AT[1] - by.y + 0.2).abs() < 1e-9);
    press_key(&mut window, Key::Delete);
    assert!(window.state().project().edit().scene.objects.len() == count && window.state().selected().is_none());
    let names = steps(&window);
    let named = ["moved by keys", "hidden", "shown"].map(|what| format!("marker 1: {what}"));
    assert_eq!(names[1..4], named);
    assert_eq!(names[4..], ["marker 1 copy: duplicated, moved 20 cm", "marker 1 copy: deleted"]);
}

#[test]
fn press_and_move_in_one_frame_drags_the_pressed_object() {
    let mut window = with_marker(0);
    let before = placement(&window, MARKER).position_m;
    let from = at(&window, 0, MARKER_AT);
    let to = from + egui::vec2(60.0, 12.0);
    window.hover_at(from);
    window.step();
    // Press and move in one frame of the window.
    let button = egui::PointerButton::Primary;
    window.event(Event::PointerButton { pos: from, button, pressed: true, modifiers: Modifiers::NONE });
    window.hover_at(from + egui::vec2(40.0, 40.0));
    window.step();
    window.hover_at(to);
    window.step();
    window.drop_at(to);
    window.run_steps(2);
    let moved = placement(&window, MARKER).position_m - before;
    assert!(moved.length() > 0.02, "{moved}");
}
