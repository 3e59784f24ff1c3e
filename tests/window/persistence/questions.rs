//! Questions by keys: Enter takes the default answer, Esc cancels.

use super::*;

fn press_key(window: &mut Harness<'_, App>, key: Key) {
    window.key_press(key);
    window.run_steps(3);
}

/// Requests the window to close.
fn close(window: &mut Harness<'_, App>) {
    let root = window.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default();
    root.events.push(egui::ViewportEvent::Close);
    window.step();
    window.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default().events.clear();
    window.run_steps(2);
}

#[test]
fn esc_keeps_the_window_open_and_enter_saves() {
    let temp = tempfile::tempdir().unwrap();
    let scene = temp.path().join("case.toml");
    std::fs::write(&scene, "version = 1\n").unwrap();
    let mut window = window(project(None, Some(&scene)), egui::vec2(1280.0, 720.0));
    set(&mut window, "noise", "scale", 0.5);
    close(&mut window);
    assert!(has_label(&window, "Save changes?"));
    press_key(&mut window, Key::Escape);
    assert!(!has_label(&window, "Save changes?") && !window.state().project().is_saved());
    close(&mut window);
    press_key(&mut window, Key::Enter);
    run_until(&mut window, |app| app.project().is_saved());
    assert!(std::fs::read_to_string(&scene).unwrap().contains("scale = 0.5"));
}

/// Presses a key in the question about a file changed by another program: the own state stays.
fn assert_own_state_kept(key: Key) {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    std::fs::write(&profile, "version = 1\n").unwrap();
    let mut window = window(project(Some(&profile), None), egui::vec2(1280.0, 720.0));
    // The question consumes the key: the panel stays open.
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(2);
    std::fs::write(&profile, "version = 1\n[noise]\nscale = 0.125\n").unwrap();
    wait_for_label(&mut window, "Read it again");
    press_key(&mut window, key);
    assert!(!has_label(&window, "Read it again") && has_label(&window, "Image sequence…"));
    // Files are read on another thread.
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_millis(400) {
        window.step();
        harness::pause();
    }
    assert_eq!(harness::steps(&window), ["opened"]);
    assert_eq!(window.state().project().value("noise", "scale"), Some(Value::Number(1.0)));
}

#[test]
fn esc_keeps_the_own_state_of_a_file_changed_on_disk() {
    assert_own_state_kept(Key::Escape);
}

#[test]
fn enter_keeps_the_own_state_of_a_file_changed_on_disk() {
    assert_own_state_kept(Key::Enter);
}

#[test]
fn esc_leaves_unsaved_work_for_the_next_start() {
    let temp = tempfile::tempdir().unwrap();
    let mut lost = project(None, None);
    lost.set("noise", "scale", &Value::Number(0.25)).unwrap();
    let place = temp.path().join("work");
    std::fs::create_dir_all(&place).unwrap();
    let work = UnsavedWork::new(&harness::demo(), 1.0, None, None, lost.edit().clone());
    std::fs::write(place.join("1.json"), serde_json::to_string(&work).unwrap()).unwrap();
    let mut window = window(project(None, None), egui::vec2(1280.0, 720.0));
    window.state_mut().set_state_folder(temp.path());
    wait_for_label(&mut window, "Restore unsaved work?");
    press_key(&mut window, Key::Escape);
    assert!(!has_label(&window, "Restore unsaved work?") && window.state().project().is_saved());
    drop(window);
    assert_eq!(RecoverableWork::find_in(&place).len(), 1);
}

#[test]
fn enter_twice_in_a_file_dialog_replaces_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let there = temp.path().join("there.toml");
    std::fs::write(&there, "# mine\n").unwrap();
    let mut window = window(project(None, None), egui::vec2(1280.0, 720.0));
    press(&mut window, "File");
    press(&mut window, "Save the profile as…");
    window.run_steps(3);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text(there.display().to_string()));
    window.run_steps(3);
    press_key(&mut window, Key::Enter);
    wait_for_label(&mut window, "Replace it");
    press_key(&mut window, Key::Enter);
    assert!(!has_label(&window, "Replace it") && has_label(&window, "Save here"));
    press_key(&mut window, Key::Enter);
    wait_for_label(&mut window, "Replace it");
    // Esc returns to the name and keeps the dialog open.
    press_key(&mut window, Key::Escape);
    assert!(!has_label(&window, "Replace it") && has_label(&window, "Save here"));
    assert_eq!(std::fs::read_to_string(&there).unwrap(), "# mine\n");
}

#[test]
fn recent_recordings_of_one_name_are_distinguished_by_folder() {
    let temp = tempfile::tempdir().unwrap();
    let state = temp.path().join("state");
    std::fs::create_dir(&state).unwrap();
    let entry = |folder: &str| {
        let recording = temp.path().join(folder).join("room").display().to_string();
        serde_json::json!({ "recording": recording, "scene": null, "profile": null, "metres_per_unit": 1.0 })
    };
    let stored = serde_json::json!({ "recent": [entry("a"), entry("b")] });
    std::fs::write(state.join("state.json"), stored.to_string()).unwrap();
    let mut window = window(project(None, None), egui::vec2(1280.0, 720.0));
    window.state_mut().set_state_folder(&state);
    window.state_mut().show_start(true);
    window.run_steps(3);
    assert!(has_label(&window, "a/room") && has_label(&window, "b/room"));
}
