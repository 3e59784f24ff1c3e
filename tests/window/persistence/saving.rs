//! Opening and saving: questions before any loss, and messages.

use super::*;
use crate::program;

#[test]
fn changed_scene_is_unsaved_until_undone() {
    let mut project = project(None, Some(Path::new(DEMO_SCENE)));
    assert!(project.is_saved());
    project.change_scene("one away", |scene| _ = scene.objects.remove(0)).unwrap();
    project.close_step();
    assert!(!project.is_saved());
    project.undo();
    assert!(project.is_saved());
}

#[test]
fn demonstration_is_not_overwritten_and_a_moved_scene_keeps_its_models() {
    let temp = tempfile::tempdir().unwrap();
    let before = std::fs::read_to_string(DEMO_SCENE).unwrap();
    let mut window = demo();
    let objects = window.state().project().edit().scene.objects.len();
    let place = |scene: &mut locard::scene::SceneFile| {
        scene.objects.push(PlacedModel { model: "marker-4.glb".to_owned(), ..PlacedModel::default() });
    };
    window.state_mut().project_mut().change_scene("placed", place).unwrap();
    settle(&mut window);
    let with_it = shown_codes(&window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    let moved = temp.path().join("case.toml");
    choose(&mut window, &moved);
    run_until(&mut window, |app| app.project().is_saved());
    assert_eq!(std::fs::read_to_string(DEMO_SCENE).unwrap(), before);
    let state = window.state().project();
    assert!(state.is_saved() && state.scene.as_deref() == Some(moved.as_path()));
    let again = project(None, Some(&moved));
    assert!(again.edit().scene == state.edit().scene && again.edit().scene.objects.len() == objects + 1);
    settle(&mut window);
    assert!(shown_codes(&window) == with_it, "it is the same scene");
    // History from before the save still resolves its files.
    press(&mut window, "Undo");
    settle(&mut window);
    assert_eq!(window.state().project().edit().scene.objects.len(), objects);
    assert_eq!(window.state().problem(), None);
}

#[test]
fn recording_without_a_camera_opens_a_chosen_profile() {
    let temp = tempfile::tempdir().unwrap();
    let recording = temp.path().join("rec");
    program::copied(&harness::demo(), &recording);
    std::fs::remove_file(recording.join("camera.toml")).unwrap();
    let text = std::fs::read_to_string(recording.join("recording.toml")).unwrap();
    std::fs::write(recording.join("recording.toml"), text.split("[camera]").next().unwrap()).unwrap();
    let profile = temp.path().join("camera.toml");
    std::fs::copy(harness::demo().join("camera.toml"), &profile).unwrap();
    let mut window = plain();
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    answer(&mut window, &recording, "Open recording");
    run_until(&mut window, |app| app.problem().is_some());
    let problem = window.state().problem().unwrap().to_owned();
    assert!(problem.contains("camera") && !problem.contains("--"), "{problem}");
    // The picture shows a button.
    wait_for_label(&mut window, "Choose profile…");
    press(&mut window, "Choose profile…");
    answer(&mut window, &profile, "Open");
    run_until(&mut window, |app| app.project().profile.as_deref() == Some(profile.as_path()));
    assert_eq!(window.state().project().shot().recording.path, recording);
    settle(&mut window);
}

#[test]
fn placing_continues_after_the_first_save_of_a_new_scene() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = window(project(None, None), egui::vec2(1400.0, 1000.0));
    settle(&mut window);
    let model = std::fs::canonicalize("scenes/marker-1.glb").unwrap().display().to_string();
    let place = |scene: &mut locard::scene::SceneFile| {
        scene.objects.push(PlacedModel { model, ..PlacedModel::default() });
    };
    window.state_mut().project_mut().change_scene("placed", place).unwrap();
    let path = temp.path().join("new.toml");
    window.state_mut().project_mut().save_scene(&path).unwrap();
    assert!(window.state().project().can_place());
    window.run_steps(3);
    assert!(has_label(&window, "Place…"));
}

#[test]
fn save_names_the_written_files_and_asks_before_foreign_profiles() {
    let temp = tempfile::tempdir().unwrap();
    let (recording, scene) = (temp.path().join("rec"), temp.path().join("case.toml"));
    program::copied(&harness::demo(), &recording);
    std::fs::write(&scene, "version = 1\nup = \"z\"\n").unwrap();
    let own = recording.join("mine.toml");
    std::fs::write(&own, "version = 1\n").unwrap();
    let options = ShotOptions { profile: Some(own.clone()), scene: Some(scene.clone()), ..ShotOptions::default() };
    let project = Project::open(&recording, &OpenOptions::default(), &options).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 900.0));
    window.state_mut().set_state_folder(&temp.path().join("state"));
    let save = |window: &mut Harness<'_, App>| {
        window.key_press_modifiers(Modifiers::COMMAND, Key::S);
        window.run_steps(3);
    };
    let model = std::fs::canonicalize("scenes/marker-1.glb").unwrap().display().to_string();
    let change = |window: &mut Harness<'_, App>, scale: f64| {
        set(window, "point_spread", "sigma_px", scale);
        let placed = PlacedModel { model: model.clone(), ..PlacedModel::default() };
        window.state_mut().project_mut().change_scene("placed", |scene| scene.objects.push(placed)).unwrap();
    };
    change(&mut window, 0.5);
    save(&mut window);
    wait_for_label(&mut window, "Save to the profile");
    press(&mut window, "Save to the profile");
    // It is in the recording's folder, and was never named in this session.
    wait_for_label(&mut window, "Overwrite");
    assert!(std::fs::read_to_string(&own).unwrap() == "version = 1\n" && !window.state().project().is_saved());
    press(&mut window, "Overwrite");
    let folder = temp.path().display();
    wait_for_label(&mut window, &format!("Saved the profile {folder}/rec/mine.toml and the scene {folder}/case.toml"));
    // The second time there is no question.
    change(&mut window, 0.25);
    save(&mut window);
    press(&mut window, "Save to the profile");
    run_until(&mut window, |app| app.project().is_saved());
    assert!(std::fs::read_to_string(&own).unwrap().contains("sigma_px = 0.25"));
    save(&mut window);
    wait_for_label(&mut window, "Nothing has changed since it was saved");

    // A scene saved elsewhere becomes a recent one.
    press(&mut window, "File");
    press(&mut window, "Save the scene as…");
    choose(&mut window, &temp.path().join("other"));
    window.state_mut().show_start(true);
    wait_for_label(&mut window, "rec   other.toml");
}

#[test]
fn new_scene_is_saved_with_its_recording_in_a_new_folder() {
    let temp = tempfile::tempdir().unwrap();
    let (recording, elsewhere) = (temp.path().join("rec"), temp.path().join("elsewhere"));
    program::copied(&harness::demo(), &recording);
    std::fs::create_dir(&elsewhere).unwrap();
    let project = Project::open(&recording, &OpenOptions::default(), &ShotOptions::default()).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 900.0));
    // Another scene was saved elsewhere before.
    let state = temp.path().join("state");
    std::fs::create_dir(&state).unwrap();
    let stored = format!("{{\"folders\": {{\"scene\": {elsewhere:?}}}}}");
    std::fs::write(state.join("state.json"), stored).unwrap();
    window.state_mut().set_state_folder(&state);
    let model = std::fs::canonicalize("scenes/marker-1.glb").unwrap().display().to_string();
    let placed = PlacedModel { model, ..PlacedModel::default() };
    window.state_mut().project_mut().change_scene("placed", |scene| scene.objects.push(placed)).unwrap();
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    // Content of the recording's folder.
    wait_for_label(&mut window, "rgb/");
    press(&mut window, "New folder…");
    // Esc cancels the name, not the dialog.
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(has_label(&window, "New folder…") && !has_label(&window, "Create"));
    for name in ["rgb", "case 7"] {
        press(&mut window, "New folder…");
        window.event(egui::Event::Text(name.to_owned()));
        window.run_steps(2);
        window.key_press(Key::Enter);
        // This file exists already.
        match name {
            "rgb" => {
                wait_for_label(
                    &mut window,
                    &format!(
                        "{} was not created: it exists already; choose another name",
                        recording.join(name).display()
                    ),
                );
                press(&mut window, "Cancel the new folder");
            }
            name => wait_for_label(&mut window, name),
        }
    }
    wait_for_label(&mut window, "This folder is empty");
    // Files of the recording are never overwritten, whatever was confirmed.
    let own = recording.join("recording.toml");
    let before = std::fs::read_to_string(&own).unwrap();
    choose(&mut window, &own);
    press(&mut window, "Replace it");
    run_until(&mut window, |app| {
        app.problem().is_some_and(|problem| problem.contains("recording.toml: the file is not a scene"))
    });
    assert_eq!(std::fs::read_to_string(&own).unwrap(), before);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    choose(&mut window, &recording.join("case 7/scene.toml"));
    run_until(&mut window, |app| app.project().is_saved());
    assert_eq!(window.state().project().scene, Some(recording.join("case 7/scene.toml")));
    assert!(recording.join("case 7/scene.toml").is_file());
}

#[test]
fn file_dialog_keeps_the_keyboard_and_starts_in_the_last_folder() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("cases/desk");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("mine.toml"), "version = 1\n[noise]\nscale = 0.5\n").unwrap();
    let mut window = plain();
    window.state_mut().set_state_folder(&temp.path().join("state"));
    let begin = |window: &mut Harness<'_, App>| {
        press(window, "File");
        press(window, "Open a profile…");
        window.run_steps(3);
    };
    let types = |window: &mut Harness<'_, App>, text: &str| {
        window.event(egui::Event::Text(text.to_owned()));
        window.run_steps(3);
    };
    // Esc closes a menu.
    press(&mut window, "File");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(!has_label(&window, "Open a profile…"));
    begin(&mut window);
    // A typed path opens its folder while it is typed, and Enter enters it; the next text is a name
    // in it.
    types(&mut window, temp.path().join("cases").to_str().unwrap());
    window.key_press(Key::Enter);
    window.run_steps(3);
    types(&mut window, "des");
    window.key_press(Key::Enter);
    window.run_steps(3);
    wait_for_label(&mut window, "mine.toml");
    types(&mut window, "mi");
    window.key_press(Key::Enter);
    run_until(&mut window, |app| app.project().profile.as_deref() == Some(&folder.join("mine.toml")));
    settle(&mut window);

    // The next window starts there, with the chosen theme.
    window.key_press(Key::T);
    window.run_steps(2);
    let theme = window.ctx.options(|options| options.theme_preference);
    assert!(theme != egui::ThemePreference::System);
    drop(window);
    let mut window = plain();
    window.state_mut().set_state_folder(&temp.path().join("state"));
    assert_eq!(window.state().documents().theme(), theme);
    begin(&mut window);
    wait_for_label(&mut window, "mine.toml");
    // The program's own folder is one click away.
    press(&mut window, "Locard's profiles");
    wait_for_label(&mut window, "tum-fr1.toml");
}

#[test]
fn foreign_changes_to_a_file_are_reloaded_or_asked_about() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    let theirs = |px: f64| std::fs::write(&profile, format!("version = 1\n[point_spread]\nsigma_px = {px}\n")).unwrap();
    theirs(0.5);
    let mut window = open(Some(&profile), Path::new(DEMO_SCENE));
    let now = |window: &Harness<'_, App>| window.state().project().edit().settings.clone();
    set(&mut window, "point_spread", "sigma_px", 1.5);
    let mine = now(&window);
    theirs(0.125);
    let button = "Read it again";
    wait_for_label(&mut window, button);
    press(&mut window, button);
    run_until(&mut window, |app| app.project().is_saved());
    assert!(now(&window) == project(Some(&profile), None).edit().settings);
    window.run_steps(2);
    press(&mut window, "Undo");
    assert!(now(&window) == mine, "nothing is lost");

    // If the own state is kept, the question returns on saving.
    theirs(0.25);
    wait_for_label(&mut window, button);
    press(&mut window, "Keep mine");
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    assert!(!window.state().project().is_saved());
    press(&mut window, "Save to the profile");
    press(&mut window, "Save mine");
    run_until(&mut window, |app| app.project().is_saved());
    assert!(std::fs::read_to_string(&profile).unwrap().contains("sigma_px = 1.5"));
}

#[test]
fn message_is_shown_in_full_and_can_be_copied() {
    let mut window = plain();
    window.event(egui::Event::PointerGone);
    let nowhere = PathBuf::from("/nowhere/at all/in a rather long folder/with a rather long name.toml");
    drop_file(&mut window, nowhere);
    run_until(&mut window, |app| app.problem().is_some());
    window.run_steps(2);
    let message = window.state().problem().unwrap().to_owned();
    assert!(message.contains("with a rather long name.toml"), "{message}");
    window.get_by_label(&message).click();
    window.run_steps(3);
    press(&mut window, "Copy");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(!has_label(&window, "Copy"));
    assert_eq!(window.query_all_by_label(&message).count(), 1);
}

#[test]
fn file_changed_during_a_save_is_not_overwritten() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    std::fs::write(&profile, "version = 1\n").unwrap();
    let mut project = project(Some(&profile), None);
    project.set("noise", "scale", &Value::Number(0.25)).unwrap();
    let draft = || project.profile_draft(&profile, ProfileScope::All).unless_changed(project.stamp(&profile));
    std::fs::write(&profile, "version = 1\n# theirs\n").unwrap();
    assert!(matches!(draft().write(), Err(locard::window::SaveError::Changed(path)) if path == profile));
    assert_eq!(std::fs::read_to_string(&profile).unwrap(), "version = 1\n# theirs\n");
    let written = project.profile_draft(&profile, ProfileScope::All).write().unwrap();
    project.written(written);
    assert!(project.is_saved());
    // The written file counts as known.
    project.set("noise", "scale", &Value::Number(0.5)).unwrap();
    project.profile_draft(&profile, ProfileScope::All).unless_changed(project.stamp(&profile)).write().unwrap();
    assert!(std::fs::read_to_string(&profile).unwrap().contains("scale = 0.5"));
}

#[test]
fn profile_saved_under_another_name_is_complete_and_keeps_comments() {
    let temp = tempfile::tempdir().unwrap();
    // A recording without a camera.
    let site = temp.path().join("site");
    std::fs::create_dir(&site).unwrap();
    for entry in std::fs::read_dir(harness::demo()).unwrap().flatten() {
        if entry.file_name() != "recording.toml" {
            #[cfg(unix)]
            std::os::unix::fs::symlink(entry.path().canonicalize().unwrap(), site.join(entry.file_name())).unwrap();
        }
    }
    let text = std::fs::read_to_string(harness::demo().join("recording.toml")).unwrap();
    let (text, camera) = text.split_once("[camera]").unwrap();
    assert!(camera.contains("profile"), "{camera}");
    std::fs::write(site.join("recording.toml"), text).unwrap();
    let profile = temp.path().join("mine.toml");
    let own = std::fs::read_to_string(harness::demo().join("camera.toml")).unwrap();
    std::fs::write(&profile, format!("# My own camera.\n{own}")).unwrap();
    let open = |profile: &Path| {
        let options = ShotOptions { profile: Some(profile.to_owned()), ..ShotOptions::default() };
        Project::open(&site, &OpenOptions::default(), &options).unwrap()
    };
    let mut project = open(&profile);
    project.set("noise", "scale", &Value::Number(1.5)).unwrap();
    let other = temp.path().join("other.toml");
    project.save_profile(&other).unwrap();
    let text = std::fs::read_to_string(&other).unwrap();
    assert!(text.starts_with("# My own camera.\n") && text.contains("scale = 1.5"), "{text}");
    assert_eq!(open(&other).edit(), project.edit());
    // Without a previous profile nothing is missing either.
    let mut project = open(&profile);
    project.profile = None;
    let third = temp.path().join("third.toml");
    project.save_profile(&third).unwrap();
    assert_eq!(open(&third).edit().rig.missing_keys(), Vec::<&str>::new());
}
