//! What the window keeps of a person's work, and what leaves it as files; worked as a person would.

#![cfg(feature = "window")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "common/gpu.rs"]
mod gpu;
#[path = "common/program.rs"]
mod program;
#[path = "common/window.rs"]
mod worked;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use locard::compositor::Target;
use locard::params::Value;
use locard::pixels::Pixels;
use locard::recording::OpenOptions;
use locard::scene::document::PlacedModel;
use locard::shot::{Given, Shot};
use locard::window::{App, Autosave, DEMO, DEMO_SCENE, Left, Project, State, Work, command_line};
use worked::{codes, settle, shown, until, window};

fn project(profile: Option<&Path>, scene: Option<&Path>) -> Project {
    let given = Given { profile: profile.map(Into::into), scene: scene.map(Into::into), ..Given::default() };
    Project::open(Path::new(DEMO), &OpenOptions::default(), &given).unwrap()
}

fn open(profile: Option<&Path>, scene: &Path) -> Harness<'static, App> {
    window(project(profile, Some(scene)), egui::vec2(1400.0, 1000.0))
}

/// The first frames of the demonstration are the same for all of these.
fn demo() -> Harness<'static, App> {
    open(None, Path::new(DEMO_SCENE))
}

/// What `locard composite` writes with these settings.
fn written(sets: &[&str], frame: usize) -> Vec<[u8; 3]> {
    let sets = sets.iter().map(ToString::to_string).collect();
    let given = Given { sets, scene: Some(DEMO_SCENE.into()), ..Given::default() };
    let mut shot = Shot::open(Path::new(DEMO), &OpenOptions::default(), &given).unwrap();
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let pending = shot.picture(&mut compositor, frame, Target::Pixels).unwrap();
    codes(&compositor.collect(pending).unwrap().pixels)
}

fn picture(path: &Path) -> Vec<[u8; 3]> {
    let read = image::open(path).unwrap().to_rgb8();
    codes(&Pixels::from_u8(read.width(), read.height(), read.into_raw()).unwrap())
}

fn set(window: &mut Harness<'_, App>, table: &str, name: &str, number: f64) {
    let project = window.state_mut().project_mut();
    project.set(table, name, &Value::Number(number)).unwrap();
    project.close_step();
}

/// Answers a dialog that asks for a file to write.
fn choose(window: &mut Harness<'_, App>, path: &Path) {
    answer(window, path, "Save here");
}

fn answer(window: &mut Harness<'_, App>, path: &Path, button: &str) {
    window.run_steps(3);
    let field = window.get_by_role_and_label(Role::TextInput, "File name");
    field.focus();
    window.step();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.step();
    window.get_by_role_and_label(Role::TextInput, "File name").type_text(path.to_str().unwrap());
    window.run_steps(2);
    window.get_by_label(button).click();
    window.run_steps(2);
}

fn all_over(app: &App) -> bool {
    app.keeper().jobs().is_some_and(|jobs| !jobs.is_busy() && jobs.entries.iter().all(|entry| entry.state.is_over()))
}

fn has(window: &Harness<'_, App>, label: &str) -> bool {
    window.query_all_by_label(label).count() > 0
}

/// Until it is shown: files are listed and written on threads of their own.
fn shows(window: &mut Harness<'_, App>, label: &str) {
    let begun = Instant::now();
    while !has(window, label) {
        assert!(begun.elapsed() < Duration::from_secs(60), "{label} is not shown");
        window.step();
        std::thread::yield_now();
    }
}

fn press(window: &mut Harness<'_, App>, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(3);
}

#[test]
fn exports_are_what_was_set_when_they_were_begun() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = demo();
    window.state_mut().player_mut().seek(31);
    settle(&mut window);
    let before = shown(&window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(3);
    press(&mut window, "frame 31 alone");
    press(&mut window, "Pictures…");
    choose(&mut window, &temp.path().join("out"));
    // What is changed from now on is not in it; a second one is.
    set(&mut window, "noise", "scale", 0.0);
    window.key_press(Key::W);
    window.run_steps(2);
    press(&mut window, "Snapshot…");
    choose(&mut window, &temp.path().join("quiet"));
    until(&mut window, all_over);
    settle(&mut window);
    let exported = picture(&temp.path().join("out/frame_000031.png"));
    assert!(exported == before && exported == written(&[], 31));
    let snapshot = picture(&temp.path().join("quiet.png"));
    assert!(snapshot == shown(&window) && snapshot != before, "the wipe is not in it");

    // A folder that cannot be made is said, and the next one goes on.
    std::fs::write(temp.path().join("file"), "").unwrap();
    press(&mut window, "Pictures…");
    choose(&mut window, &temp.path().join("file/out"));
    until(&mut window, all_over);
    let entries = &window.state().keeper().jobs().unwrap().entries;
    assert!(matches!(&entries[2].state, State::Failed(why) if why.contains("file/out")), "{:?}", entries[2]);
    assert!(entries[..2].iter().all(|entry| matches!(entry.state, State::Done(_))), "{entries:?}");

    // Cancelled, a video leaves nothing.
    press(&mut window, "all 72 frames");
    press(&mut window, "Video…");
    let video = temp.path().join("cut.mkv");
    choose(&mut window, &video);
    press(&mut window, &format!("Cancel {}", video.display()));
    until(&mut window, all_over);
    assert_eq!(window.state().keeper().jobs().unwrap().entries[3].state, State::Cancelled);
    let mut names: Vec<_> = std::fs::read_dir(temp.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["file", "out", "quiet.png"]);
}

#[test]
fn a_photograph_from_the_window_is_that_of_the_program() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = demo();
    set(&mut window, "noise", "scale", 0.5);
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(3);
    for (dial, text) in [("Width, px", "320"), ("Light, lx", "300"), ("Aperture", "f/4"), ("Focal length, mm", "30000")]
    {
        window.get_by_role_and_label(Role::TextInput, dial).focus();
        window.step();
        window.get_by_role_and_label(Role::TextInput, dial).type_text(text);
        window.run_steps(2);
    }
    // No lens is so long.
    assert!(has(&window, "Focal length: 30000 is refused: accepted is 1 to 5000"));
    let focal = window.get_by_role_and_label(Role::TextInput, "Focal length, mm");
    focal.focus();
    window.step();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.key_press(Key::Delete);
    window.run_steps(3);
    press(&mut window, "Photograph…");
    let taken = temp.path().join("taken.png");
    choose(&mut window, &taken);
    until(&mut window, all_over);
    let state = window.state().keeper().jobs().unwrap().entries[0].state.clone();
    assert!(matches!(&state, State::Done(said) if said.contains("f/4")), "{state:?}");
    let by_program = temp.path().join("program.png");
    let dials = ["--aperture", "4", "--lux", "300", "--width", "320", "--set", "noise.scale=0.5"];
    let of = ["photo", DEMO, "--frame", "0", "--scene", DEMO_SCENE, "-o", by_program.to_str().unwrap()];
    program::said(&[&of[..], &dials].concat());
    assert!(picture(&taken) == picture(&by_program));
    let exif =
        exif::Reader::new().read_from_container(&mut BufReader::new(std::fs::File::open(&taken).unwrap())).unwrap();
    let f_number = exif.get_field(exif::Tag::FNumber, exif::In::PRIMARY).unwrap();
    assert_eq!(f_number.display_value().with_unit(&exif).to_string(), "f/4");
}

#[test]
fn the_command_line_composites_what_is_shown() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("it's a case");
    std::fs::create_dir(&folder).unwrap();
    let profile = folder.join("mine.toml");
    std::fs::write(&profile, "version = 1\n[noise]\nscale = 0.5\n[halation]\non = false\n").unwrap();
    let mut window = open(Some(&profile), Path::new(DEMO_SCENE));
    let project = window.state_mut().project_mut();
    for (table, name, value) in [
        ("noise", "scale", Value::Number(0.0)),
        ("camera.lens", "f_number", Value::Number(1.4)),
        ("camera.lens", "focus_distance_m", Value::Number(0.8)),
        ("camera", "fx_px", Value::Number(540.1)),
        ("camera.exposure", "time_s", Value::Number(0.02)),
        ("motion_blur", "method", Value::Text("copies".to_owned())),
        ("depth", "occlusion", Value::Bool(false)),
    ] {
        project.set(table, name, &value).unwrap();
    }
    project.switch("edge_blend", false);
    project.switch("halation", true);
    window.state_mut().player_mut().seek(31);
    settle(&mut window);
    let line = command_line(window.state().project(), 31);
    assert_eq!(line.before, [""; 0]);
    assert!(line.text.contains("--set noise.scale=0 ") && line.text.contains("edge_blend.on=false"), "{}", line.text);
    let text = line.text.strip_prefix("locard ").unwrap();
    let program = program::program().get_program().to_owned();
    let output = Command::new("sh").args(["-c", &format!("\"$0\" {text}")]).arg(program).current_dir(&folder).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{text}: {}", String::from_utf8_lossy(&output.stderr));
    assert!(picture(&folder.join("composited/frame_000031.png")) == shown(&window), "{text}");

    // What a file has to say first is said.
    let project = window.state_mut().project_mut();
    project.change_scene("light", |scene| scene.light.environment_intensity = Some(0.5)).unwrap();
    assert_eq!(command_line(project, 31).before.len(), 1);
}

#[test]
fn what_is_switched_off_is_off_when_it_opens_again() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    let text = "# my camera\nversion = 1\n\n[noise]\nscale = 0.5 # quieter\n";
    std::fs::write(&profile, text).unwrap();
    let mut window = open(Some(&profile), Path::new(DEMO_SCENE));
    window.state_mut().project_mut().switch("noise", false);
    window.state_mut().project_mut().switch("vignetting", false);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    until(&mut window, |app| app.project().is_saved());
    let saved = std::fs::read_to_string(&profile).unwrap();
    assert_eq!(saved, format!("{text}on = false\n\n[vignetting]\non = false\n"));
    let again = project(Some(&profile), Some(Path::new(DEMO_SCENE)));
    assert!(again.edit() == window.state().project().edit() && !again.edit().settings.is_on("noise"));
}

#[test]
fn the_demonstration_is_not_written_to_and_a_scene_moves_with_its_models() {
    let temp = tempfile::tempdir().unwrap();
    let before = std::fs::read_to_string(DEMO_SCENE).unwrap();
    let mut window = demo();
    let objects = window.state().project().edit().scene.objects.len();
    let place = |scene: &mut locard::scene::SceneFile| {
        scene.objects.push(PlacedModel { model: "marker-4.glb".to_owned(), ..PlacedModel::default() });
    };
    window.state_mut().project_mut().change_scene("placed", place).unwrap();
    settle(&mut window);
    let with_it = shown(&window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    let moved = temp.path().join("case.toml");
    choose(&mut window, &moved);
    until(&mut window, |app| app.project().is_saved());
    assert_eq!(std::fs::read_to_string(DEMO_SCENE).unwrap(), before);
    let state = window.state().project();
    assert!(state.is_saved() && state.scene.as_deref() == Some(moved.as_path()));
    let again = project(None, Some(&moved));
    assert!(again.edit().scene == state.edit().scene && again.edit().scene.objects.len() == objects + 1);
    settle(&mut window);
    assert!(shown(&window) == with_it, "it is the same scene");
    // What was before the save is found from the new place too.
    press(&mut window, "Undo");
    settle(&mut window);
    assert_eq!(window.state().project().edit().scene.objects.len(), objects);
    assert_eq!(window.state().problem(), None);
}

#[test]
fn a_profile_is_opened_for_a_recording_without_a_camera() {
    let temp = tempfile::tempdir().unwrap();
    let recording = temp.path().join("rec");
    program::copied(Path::new(DEMO), &recording);
    std::fs::remove_file(recording.join("camera.toml")).unwrap();
    let text = std::fs::read_to_string(recording.join("recording.toml")).unwrap();
    std::fs::write(recording.join("recording.toml"), text.split("[camera]").next().unwrap()).unwrap();
    let profile = temp.path().join("camera.toml");
    std::fs::copy(Path::new(DEMO).join("camera.toml"), &profile).unwrap();
    let mut window = demo();
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    answer(&mut window, &recording, "Open");
    until(&mut window, |app| app.problem().is_some());
    let problem = window.state().problem().unwrap().to_owned();
    assert!(problem.contains("camera") && !problem.contains("--"), "{problem}");
    // A button stands beside it.
    press(&mut window, "Open a profile…");
    answer(&mut window, &profile, "Open");
    until(&mut window, |app| app.project().profile.as_deref() == Some(profile.as_path()));
    assert_eq!(window.state().project().shot().recording.path, recording);
    settle(&mut window);
}

#[test]
fn after_the_first_save_of_a_new_scene_placing_goes_on() {
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
    assert!(has(&window, "Place…"));
}

#[test]
fn saving_names_what_it_wrote_and_asks_before_others_profiles() {
    let temp = tempfile::tempdir().unwrap();
    let (recording, scene) = (temp.path().join("rec"), temp.path().join("case.toml"));
    program::copied(Path::new(DEMO), &recording);
    std::fs::write(&scene, "version = 1\nup = \"z\"\n").unwrap();
    let own = recording.join("mine.toml");
    std::fs::write(&own, "version = 1\n").unwrap();
    let given = Given { profile: Some(own.clone()), scene: Some(scene.clone()), ..Given::default() };
    let project = Project::open(&recording, &OpenOptions::default(), &given).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 900.0));
    window.state_mut().keep_in(&temp.path().join("state"));
    let save = |window: &mut Harness<'_, App>| {
        window.key_press_modifiers(Modifiers::COMMAND, Key::S);
        window.run_steps(3);
    };
    let model = std::fs::canonicalize("scenes/marker-1.glb").unwrap().display().to_string();
    let change = |window: &mut Harness<'_, App>, scale: f64| {
        set(window, "noise", "scale", scale);
        let placed = PlacedModel { model: model.clone(), ..PlacedModel::default() };
        window.state_mut().project_mut().change_scene("placed", |scene| scene.objects.push(placed)).unwrap();
    };
    change(&mut window, 0.5);
    save(&mut window);
    // It lies in the recording's folder, and was never named here.
    shows(&mut window, "Write into it");
    assert!(std::fs::read_to_string(&own).unwrap() == "version = 1\n" && !window.state().project().is_saved());
    press(&mut window, "Write into it");
    let folder = temp.path().display();
    shows(&mut window, &format!("Saved the scene {folder}/case.toml and the profile {folder}/rec/mine.toml"));
    // The second time it is not asked.
    change(&mut window, 0.25);
    save(&mut window);
    until(&mut window, |app| app.project().is_saved());
    assert!(std::fs::read_to_string(&own).unwrap().contains("scale = 0.25"));
    save(&mut window);
    shows(&mut window, "Nothing has changed since it was saved");

    // A scene that is saved elsewhere is what was opened lately.
    press(&mut window, "File");
    press(&mut window, "Save the scene as…");
    choose(&mut window, &temp.path().join("other"));
    window.state_mut().show_start(true);
    shows(&mut window, "rec   other.toml");
}

#[test]
fn the_dialog_keeps_the_keyboard_and_begins_where_one_was() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("cases/desk");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("mine.toml"), "version = 1\n[noise]\nscale = 0.5\n").unwrap();
    let mut window = demo();
    window.state_mut().keep_in(&temp.path().join("state"));
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
    assert!(!has(&window, "Open a profile…"));
    begin(&mut window);
    // A path leads to its folder while it is typed, and Enter goes into it; what is typed next is a name there.
    types(&mut window, temp.path().join("cases").to_str().unwrap());
    window.key_press(Key::Enter);
    window.run_steps(3);
    types(&mut window, "des");
    window.key_press(Key::Enter);
    window.run_steps(3);
    shows(&mut window, "mine.toml");
    types(&mut window, "mi");
    window.key_press(Key::Enter);
    until(&mut window, |app| app.project().profile.as_deref() == Some(&folder.join("mine.toml")));
    settle(&mut window);

    // The next window begins there, in the theme that was chosen.
    window.key_press(Key::T);
    window.run_steps(2);
    let theme = window.ctx.options(|options| options.theme_preference);
    assert!(theme != egui::ThemePreference::System);
    drop(window);
    let mut window = demo();
    window.state_mut().keep_in(&temp.path().join("state"));
    assert_eq!(window.state().keeper().theme(), theme);
    begin(&mut window);
    shows(&mut window, "mine.toml");
    // Those of the program are one click away.
    press(&mut window, "Locard's profiles");
    shows(&mut window, "tum-fr1.toml");
}

#[test]
fn what_somebody_else_writes_is_read_again_or_asked_about() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    let scale = |scale: f64| std::fs::write(&profile, format!("version = 1\n[noise]\nscale = {scale}\n")).unwrap();
    scale(0.5);
    let mut window = open(Some(&profile), Path::new(DEMO_SCENE));
    let now = |window: &Harness<'_, App>| window.state().project().edit().settings.clone();
    set(&mut window, "noise", "scale", 1.5);
    let mine = now(&window);
    scale(0.125);
    let asked = "Read it again";
    let begun = Instant::now();
    while !has(&window, asked) && begun.elapsed() < Duration::from_secs(60) {
        window.step();
        std::thread::yield_now();
    }
    press(&mut window, asked);
    until(&mut window, |app| app.project().is_saved());
    assert!(now(&window) == project(Some(&profile), None).edit().settings);
    window.run_steps(2);
    press(&mut window, "Undo");
    assert!(now(&window) == mine, "nothing is lost");

    // Kept as it is here, it is asked about when it is saved.
    scale(0.25);
    let begun = Instant::now();
    while !has(&window, asked) && begun.elapsed() < Duration::from_secs(60) {
        window.step();
        std::thread::yield_now();
    }
    press(&mut window, "Keep what is here");
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    assert!(!window.state().project().is_saved());
    press(&mut window, "Save mine");
    until(&mut window, |app| app.project().is_saved());
    assert!(std::fs::read_to_string(&profile).unwrap().contains("scale = 1.5"));
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

#[test]
fn a_message_is_shown_whole_and_can_be_copied() {
    let mut window = demo();
    window.event(egui::Event::PointerGone);
    let nowhere = PathBuf::from("/nowhere/at all/in a rather long folder/with a rather long name.toml");
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(nowhere)));
    until(&mut window, |app| app.problem().is_some());
    window.run_steps(2);
    let told = window.state().problem().unwrap().to_owned();
    assert!(told.contains("with a rather long name.toml"), "{told}");
    window.get_by_label(&told).click();
    window.run_steps(3);
    press(&mut window, "Copy");
    window.key_press(Key::Escape);
    window.run_steps(3);
    assert!(!has(&window, "Copy"));
    assert_eq!(window.query_all_by_label(&told).count(), 1);
}

#[test]
fn a_series_asks_for_its_own_files() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = demo();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(3);
    for (dial, text) in [("Width, px", "64"), ("Light, lx", "300")] {
        window.get_by_role_and_label(Role::TextInput, dial).focus();
        window.step();
        window.get_by_role_and_label(Role::TextInput, dial).type_text(text);
        window.run_steps(2);
    }
    window.get_by_role_and_label(Role::ComboBox, "Series").click();
    window.run_steps(3);
    press(&mut window, "through the film speeds");
    // The second of the series is there, and nothing of the name itself.
    let there = temp.path().join("s-2.png");
    std::fs::write(&there, "what the user had").unwrap();
    press(&mut window, "Photograph…");
    choose(&mut window, &temp.path().join("s.png"));
    assert_eq!(std::fs::read_to_string(&there).unwrap(), "what the user had");
    // The dialog comes to rest in its new size.
    window.run_steps(10);
    assert!(window.query_by_label_contains("s-2.png is there already").is_some());
    press(&mut window, "Replace them");
    let had = b"what the user had".as_slice();
    until(&mut window, |_| std::fs::read(&there).is_ok_and(|bytes| bytes != had));
    // Cancelled, those that are finished stay.
    press(&mut window, &format!("Cancel {}", temp.path().join("s.png").display()));
    until(&mut window, all_over);
    assert_eq!(window.state().keeper().jobs().unwrap().entries[0].state, State::Cancelled);
    assert!(picture(&there).len() > 64 && picture(&temp.path().join("s-1.png")).len() > 64);
    assert!(!temp.path().join("s-sheet.png").exists());
}

#[test]
fn a_lost_device_is_told_and_the_work_is_left_for_the_new_start() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = demo();
    window.state_mut().keep_in(temp.path());
    window.state_mut().restarts_by(|| "a test does not start anew".to_owned());
    window.run_steps(2);
    set(&mut window, "noise", "scale", 0.25);
    let edit = window.state().project().edit().clone();
    window.state().viewer().gpu().device.destroy();
    until(&mut window, |app| app.problem().is_some_and(|problem| problem.contains("graphics device was lost")));
    assert!(window.state().problem().unwrap().contains("does not start anew"));
    // It goes on being a window: what is set now is no picture, and nothing breaks.
    set(&mut window, "noise", "scale", 0.5);
    window.run_steps(5);
    drop(window);
    let left = Left::found(&temp.path().join("work"));
    assert!(left.len() == 1 && left[0].work.edit == edit);
}

#[test]
fn what_another_program_writes_while_it_is_saved_is_not_written_over() {
    let temp = tempfile::tempdir().unwrap();
    let profile = temp.path().join("mine.toml");
    std::fs::write(&profile, "version = 1\n").unwrap();
    let mut project = project(Some(&profile), None);
    project.set("noise", "scale", &Value::Number(0.25)).unwrap();
    let draft = || project.profile_draft(&profile).unless_changed(project.stamp(&profile));
    std::fs::write(&profile, "version = 1\n# theirs\n").unwrap();
    assert!(matches!(draft().write(), Err(locard::window::SaveError::Changed(path)) if path == profile));
    assert_eq!(std::fs::read_to_string(&profile).unwrap(), "version = 1\n# theirs\n");
    let written = project.profile_draft(&profile).write().unwrap();
    project.written(written);
    assert!(project.is_saved());
    // What was written is known as it is.
    project.set("noise", "scale", &Value::Number(0.5)).unwrap();
    project.profile_draft(&profile).unless_changed(project.stamp(&profile)).write().unwrap();
    assert!(std::fs::read_to_string(&profile).unwrap().contains("scale = 0.5"));
}

/// Work that was left in a folder, by a window that is no more.
fn leave(folder: &Path, project: &Project, frame: usize) {
    let place = folder.join("work");
    std::fs::create_dir_all(&place).unwrap();
    let (scene, profile) = (project.scene.as_deref(), project.profile.as_deref());
    let mut work = Work::new(&project.shot().recording.path, 1.0, profile, scene, project.edit().clone());
    work.frame = frame;
    std::fs::write(place.join("1.json"), serde_json::to_string(&work).unwrap()).unwrap();
}

fn count(folder: &Path) -> usize {
    std::fs::read_dir(folder).map_or(0, Iterator::count)
}

#[test]
fn work_that_a_crash_left_is_offered_and_taken_up() {
    let temp = tempfile::tempdir().unwrap();
    let mut lost = project(None, Some(Path::new(DEMO_SCENE)));
    lost.set("noise", "scale", &Value::Number(0.25)).unwrap();
    lost.switch("halation", false);
    lost.change_scene("one away", |scene| _ = scene.objects.remove(0)).unwrap();
    leave(temp.path(), &lost, 12);
    let mut window = demo();
    window.state_mut().keep_in(temp.path());
    window.run_steps(3);
    press(&mut window, "Take it up");
    until(&mut window, |app| app.project().edit() == lost.edit());
    settle(&mut window);
    assert_eq!(window.state_mut().player_mut().frame(), 12);
    assert!(!window.state().project().is_saved());
    // It is still there should the next crash come, and what was in the files is one step back.
    assert_eq!(count(&temp.path().join("work")), 2);
    press(&mut window, "Undo");
    assert!(window.state().project().is_saved());
    drop(window);
    assert_eq!(count(&temp.path().join("work")), 0, "an orderly end leaves nothing");

    // It was opened lately, and the start page says so.
    let mut window = demo();
    window.state_mut().keep_in(temp.path());
    window.state_mut().show_start(true);
    window.run_steps(3);
    assert!(has(&window, "demo   demo.toml") && has(&window, "Open a recording…"));
    press(&mut window, "Stay with the demonstration");
    assert!(!has(&window, "Stay with the demonstration"));

    // Thrown away, it is not offered again.
    leave(temp.path(), &lost, 0);
    let mut window = demo();
    window.state_mut().keep_in(temp.path());
    window.run_steps(3);
    press(&mut window, "Throw it away");
    assert!(Left::found(&temp.path().join("work")).is_empty());
}

const KILLED: &str = "LOCARD_TEST_KILLED";

/// Not a test: what the next one kills. It edits, keeps its work and saves, as fast as it can.
#[test]
fn edits_until_it_is_killed() {
    let Some(folder) = std::env::var_os(KILLED).map(PathBuf::from) else { return };
    let (profile, scene) = (folder.join("p.toml"), folder.join("s.toml"));
    let mut project = project(None, None);
    let mut autosave = Autosave::begin(&folder.join("work")).unwrap();
    let begun = Instant::now();
    let model = std::path::absolute("scenes/marker-1.glb").unwrap().to_str().unwrap().to_owned();
    autosave.keep(project.version(), begun, || None);
    for n in 1..u32::MAX {
        project.set("noise", "scale", &Value::Number(f64::from(n % 64) / 8.0)).unwrap();
        project.close_step();
        let placed = PlacedModel { model: model.clone(), ..PlacedModel::default() };
        let change = |scene: &mut locard::scene::SceneFile| scene.objects = vec![placed; 1 + n as usize % 5];
        project.change_scene("placed", change).unwrap();
        // Time passes as fast as it edits.
        let now = begun + Duration::from_secs(3 * u64::from(n));
        let edit = project.edit().clone();
        autosave
            .keep(project.version(), now, || Some(Work::new(Path::new(DEMO), 1.0, Some(&profile), Some(&scene), edit)));
        project.save_profile(&profile).unwrap();
        project.save_scene(&scene).unwrap();
        while n == 1 && !std::fs::read_dir(folder.join("work")).unwrap().any(|entry| is_work(&entry.unwrap().path())) {
            std::thread::yield_now();
        }
        println!("edited {n}");
    }
}

fn is_work(path: &Path) -> bool {
    let name = path.file_name().unwrap().to_string_lossy();
    name.ends_with(".json") && !name.starts_with('.')
}

#[test]
fn killed_twenty_times_it_offers_the_work_back_and_the_files_are_whole() {
    let temp = tempfile::tempdir().unwrap();
    let work = temp.path().join("work");
    let (profile, scene) = (temp.path().join("p.toml"), temp.path().join("s.toml"));
    for run in 0..20 {
        let mut editing = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "edits_until_it_is_killed", "--nocapture"])
            .env(KILLED, temp.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(editing.stdout.take().unwrap()).lines();
        // Wherever it stands after so many edits.
        let edited = lines.map(Result::unwrap).filter(|line| line.contains("edited")).nth(3 + 2 * run);
        assert!(edited.is_some());
        editing.kill().unwrap();
        editing.wait().unwrap();
        let mut found = Left::found(&work);
        assert_eq!(found.len(), 1, "run {run}");
        let left = found.pop().unwrap();
        let objects = left.work.edit.scene.objects.len();
        assert!((1..=5).contains(&objects), "{objects}");
        let saved = project(Some(&profile), Some(&scene));
        assert!((1..=5).contains(&saved.edit().scene.objects.len()));
        // What is kept opens again.
        let mut taken_up = project(Some(&profile), Some(&scene));
        taken_up.take_up(left.work.edit.clone()).unwrap();
        assert!(taken_up.edit() == &left.work.edit);
        left.throw_away();
        assert_eq!(count(&work), 0, "run {run}");
    }
}
