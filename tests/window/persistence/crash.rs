//! Recovery of work after a crash, a kill or a lost device.

use super::*;
use crate::tier::{fast_or_full, is_full};

/// A window whose recovery file lies in `state` and that does not restart, after one edit.
fn edited_window(state: &Path) -> Harness<'static, App> {
    let mut window = plain();
    window.state_mut().set_state_folder(state);
    window.state_mut().restart_with(|| "a test does not start anew".to_owned());
    window.run_steps(2);
    set(&mut window, "noise", "scale", 0.25);
    window
}

#[test]
fn lost_device_is_reported_and_work_is_left_for_the_next_start() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = edited_window(temp.path());
    let edit = window.state().project().edit().clone();
    window.state().viewer().gpu().device.destroy();
    run_until(&mut window, |app| app.problem().is_some_and(|problem| problem.contains("graphics device was lost")));
    assert!(window.state().problem().unwrap().contains("does not start anew"));
    // The window keeps running: new settings draw no picture, and nothing fails.
    set(&mut window, "noise", "scale", 0.5);
    window.run_steps(5);
    drop(window);
    let left = RecoverableWork::find_in(&temp.path().join("work"));
    assert!(left.len() == 1 && left[0].work.edit == edit);
}

/// Writes recoverable work into a folder, as a window that has ended.
fn leave(folder: &Path, project: &Project, frame: usize) {
    let place = folder.join("work");
    std::fs::create_dir_all(&place).unwrap();
    let (scene, profile) = (project.scene.as_deref(), project.profile.as_deref());
    let mut work = UnsavedWork::new(&project.shot().recording.path, 1.0, profile, scene, project.edit().clone())
        .with_history(project.history().record(50));
    work.frame = frame;
    std::fs::write(place.join("1.json"), serde_json::to_string(&work).unwrap()).unwrap();
}

/// The demonstration itself; in the fast tier without its scene and shadows, which are not part of
/// these tests.
fn demonstration() -> Harness<'static, App> {
    let options = if is_full() {
        ShotOptions { scene: Some(DEMO_SCENE.into()), ..ShotOptions::default() }
    } else {
        ShotOptions { sets: vec!["shadow.cast=false".to_owned()], ..ShotOptions::default() }
    };
    window(Project::open(Path::new(DEMO), &OpenOptions::default(), &options).unwrap(), egui::vec2(1400.0, 1000.0))
}

fn count(folder: &Path) -> usize {
    std::fs::read_dir(folder).map_or(0, Iterator::count)
}

#[test]
fn work_left_by_a_crash_is_offered_and_restored() {
    let temp = tempfile::tempdir().unwrap();
    let mut lost = project(None, Some(Path::new(DEMO_SCENE)));
    lost.set("noise", "scale", &Value::Number(0.25)).unwrap();
    lost.switch("halation", false);
    lost.change_scene("one away", |scene| _ = scene.objects.remove(0)).unwrap();
    leave(temp.path(), &lost, demo_frame(12));
    let mut window = demo();
    window.state_mut().set_state_folder(temp.path());
    wait_for_label(&mut window, "Restore");
    press(&mut window, "Restore");
    run_until(&mut window, |app| app.project().edit() == lost.edit());
    settle(&mut window);
    assert_eq!(window.state_mut().player_mut().frame(), demo_frame(12));
    assert!(!window.state().project().is_saved());
    // It is kept for the next crash, and the state of the files is the first step.
    assert_eq!(count(&temp.path().join("work")), 2);
    (0..3).for_each(|_| press(&mut window, "Undo"));
    assert!(window.state().project().is_saved());
    drop(window);
    assert_eq!(count(&temp.path().join("work")), 0, "an orderly end leaves nothing");

    // It is among the recent recordings of the start page.
    let mut window = demonstration();
    window.state_mut().set_state_folder(temp.path());
    window.state_mut().show_start(true);
    window.run_steps(3);
    // With its folder in the fast tier, where the reduced demonstration is another recording of
    // that name.
    let recent = fast_or_full("/demo   demo.toml", "demo   demo.toml");
    assert!(window.query_all_by_label_contains(recent).count() > 0 && has_label(&window, "Open a recording…"));
    press(&mut window, "Continue with the demo");
    assert!(!has_label(&window, "Continue with the demo"));

    // Discarded work is not offered again. A newly opened window would find it, too.
    drop(window);
    leave(temp.path(), &lost, 0);
    let mut window = demo();
    window.state_mut().set_state_folder(temp.path());
    wait_for_label(&mut window, "Discard");
    press(&mut window, "Discard");
    assert!(RecoverableWork::find_in(&temp.path().join("work")).is_empty());
}

#[test]
fn restored_work_keeps_its_undo_history() {
    let temp = tempfile::tempdir().unwrap();
    let mut lost = project(None, harness::scene_or_none().as_deref());
    for scale in [0.25, 0.5, 0.75] {
        lost.set("noise", "scale", &Value::Number(scale)).unwrap();
        lost.close_step();
    }
    lost.undo();
    leave(temp.path(), &lost, 0);
    let mut window = plain();
    window.state_mut().set_state_folder(temp.path());
    wait_for_label(&mut window, "Restore");
    // The default button.
    window.key_press(Key::Enter);
    let scale = |app: &App| app.project().value("noise", "scale");
    run_until(&mut window, |app| scale(app) == Some(Value::Number(0.5)));
    settle(&mut window);
    press(&mut window, "Redo");
    assert_eq!(scale(window.state()), Some(Value::Number(0.75)));
    press(&mut window, "Undo");
    press(&mut window, "Undo");
    assert_eq!(scale(window.state()), Some(Value::Number(0.25)));
    assert_eq!(harness::steps(&window), ["opened", "Noise: Amount", "Noise: Amount", "Noise: Amount"]);
    press(&mut window, "Undo");
    assert!(window.state().project().is_saved());
}

#[test]
fn edit_before_a_press_is_saved_while_the_button_is_down() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = plain();
    window.state_mut().set_state_folder(temp.path());
    window.run_steps(2);
    set(&mut window, "noise", "scale", 2.0);
    let picture = window.get_by_role_and_label(Role::Image, "picture").rect();
    harness::press_and_move(&mut window, picture.center(), picture.center() + egui::vec2(30.0, 0.0));
    assert!(window.ctx.input(|i| i.pointer.any_down()));
    let is_written = || {
        let files = std::fs::read_dir(temp.path().join("work")).unwrap();
        files.flatten().any(|entry| is_work(&entry.path()))
    };
    wait_for(&mut window, "the edit", |_| is_written());
    assert!(window.ctx.input(|i| i.pointer.any_down()));
}

#[test]
fn drag_interrupted_by_a_crash_is_not_in_the_recovery_file() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = plain();
    window.state_mut().set_state_folder(temp.path());
    harness::search(&mut window, "noise scale");
    set(&mut window, "noise", "scale", 2.0);
    let work = || {
        let files = std::fs::read_dir(temp.path().join("work")).unwrap().map(|entry| entry.unwrap().path());
        let text = files.filter(|path| is_work(path)).find_map(|path| std::fs::read_to_string(path).ok())?;
        Some(serde_json::from_str::<UnsavedWork>(&text).unwrap())
    };
    let scale = |project: &Project| match project.value("noise", "scale") {
        Some(Value::Number(scale)) => scale,
        other => panic!("{other:?}"),
    };
    wait_for(&mut window, "the first change", |_| work().is_some());
    let before = work().unwrap();
    let rail = window.get_by_role_and_label(Role::Slider, "Noise: Amount").rect();
    harness::press_and_move(&mut window, rail.center(), rail.center() + egui::vec2(30.0, 0.0));
    assert!(scale(window.state().project()) > 4.0);
    // Longer than the delay that collects changes.
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_millis(400) {
        window.step();
        harness::pause();
    }
    assert!(work().unwrap().edit == before.edit, "the state before the drag");
    harness::release_at(&mut window, rail.center() + egui::vec2(30.0, 0.0));
    wait_for(&mut window, "the drag", |_| work().is_some_and(|work| work.edit != before.edit));
    assert!(work().unwrap().edit == *window.state().project().edit());
}

#[test]
fn device_lost_during_a_move_leaves_the_scene_before_the_move() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = edited_window(temp.path());
    let before = window.state().project().edit().clone();
    let mut scene = before.scene.clone();
    scene.add_lamp(glam::DVec3::Z);
    window.state_mut().project_mut().set_uncommitted_scene(scene).unwrap();
    window.state().viewer().gpu().device.destroy();
    run_until(&mut window, |app| app.problem().is_some_and(|problem| problem.contains("graphics device was lost")));
    drop(window);
    let left = RecoverableWork::find_in(&temp.path().join("work"));
    assert!(left.len() == 1 && left[0].work.edit == before);
}

#[test]
fn picture_is_drawn_after_the_question_about_left_work() {
    let temp = tempfile::tempdir().unwrap();
    let mut lost = project(None, Some(Path::new(DEMO_SCENE)));
    lost.set("noise", "scale", &Value::Number(0.25)).unwrap();
    leave(temp.path(), &lost, demo_frame(12));
    let (folder, project) = (temp.path().to_owned(), project(None, Some(Path::new(DEMO_SCENE))));
    let builder = Harness::builder().with_size(egui::vec2(1280.0, 720.0)).renderer(Device::new());
    let mut window = builder.build_eframe(move |context| {
        let mut app = App::new(context, project, None).unwrap();
        app.set_state_folder(&folder);
        app
    });
    // The question appears in the first frame, and nothing is drawn meanwhile.
    assert!(has_label(&window, "Restore"));
    let begun = Instant::now();
    let wait = Duration::from_secs_f64(fast_or_full(0.2, 2.0));
    while begun.elapsed() < wait {
        window.step();
        let viewer = window.state().viewer();
        assert!(viewer.composite().is_none() && viewer.in_flight() == 0);
    }
    press(&mut window, "Not now");
    settle(&mut window);
    assert!(window.state().viewer().composite().is_some());
}

const KILLED: &str = "LOCARD_TEST_KILLED";

/// Child process of the next test, not a test of its own: edits, stores its work and saves as fast
/// as it can.
#[test]
fn child_edits_until_killed() {
    let Some(folder) = std::env::var_os(KILLED).map(PathBuf::from) else { return };
    let (profile, scene) = (folder.join("p.toml"), folder.join("s.toml"));
    let mut project = project(None, None);
    let mut autosave = Autosave::begin(&folder.join("work")).unwrap();
    let begun = Instant::now();
    let model = std::path::absolute("scenes/marker-1.glb").unwrap().to_str().unwrap().to_owned();
    autosave.update(project.version(), begun, || None);
    for n in 1..u32::MAX {
        project.set("noise", "scale", &Value::Number(f64::from(n % 64) / 8.0)).unwrap();
        project.close_step();
        let placed = PlacedModel { model: model.clone(), ..PlacedModel::default() };
        let change = |scene: &mut locard::scene::SceneFile| scene.objects = vec![placed; 1 + n as usize % 5];
        project.change_scene("placed", change).unwrap();
        // The clock advances with each edit.
        let now = begun + Duration::from_secs(3 * u64::from(n));
        let edit = project.edit().clone();
        autosave.update(project.version(), now, || None);
        // No further change for a second.
        let now = now + Duration::from_secs(1);
        autosave.update(project.version(), now, || {
            Some(UnsavedWork::new(Path::new(DEMO), 1.0, Some(&profile), Some(&scene), edit))
        });
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
fn window_killed_twenty_times_restores_its_work_and_keeps_files_intact() {
    let temp = tempfile::tempdir().unwrap();
    let work = temp.path().join("work");
    let (profile, scene) = (temp.path().join("p.toml"), temp.path().join("s.toml"));
    for run in 0..20 {
        let mut editing = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "persistence::crash::child_edits_until_killed", "--nocapture"])
            .env(KILLED, temp.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(editing.stdout.take().unwrap()).lines();
        // Killed after this number of edits, wherever it is.
        let edited = lines.map(Result::unwrap).filter(|line| line.contains("edited")).nth(3 + 2 * run);
        assert!(edited.is_some());
        editing.kill().unwrap();
        editing.wait().unwrap();
        let mut works = RecoverableWork::find_in(&work);
        assert_eq!(works.len(), 1, "run {run}");
        let left = works.pop().unwrap();
        let objects = left.work.edit.scene.objects.len();
        assert!((1..=5).contains(&objects), "{objects}");
        let saved = project(Some(&profile), Some(&scene));
        assert!((1..=5).contains(&saved.edit().scene.objects.len()));
        // The recovery file opens.
        let mut taken_up = project(Some(&profile), Some(&scene));
        taken_up.restore(left.work.edit.clone(), HistoryRecord::default()).unwrap();
        assert!(taken_up.edit() == &left.work.edit);
        left.discard();
        assert_eq!(count(&work), 0, "run {run}");
    }
}

#[test]
fn question_about_unsaved_work_counts_each_instance() {
    let temp = tempfile::tempdir().unwrap();
    let mut lost = project(None, Some(Path::new(DEMO_SCENE)));
    lost.set("noise", "scale", &Value::Number(0.25)).unwrap();
    leave(temp.path(), &lost, 0);
    let mut window = plain();
    window.state_mut().set_state_folder(temp.path());
    wait_for_label(&mut window, "Restore");
    let placed = lost.shot().scene.objects.len();
    assert!(placed > lost.edit().scene.objects.len() && has_label(&window, &format!("{placed} objects")));
}
